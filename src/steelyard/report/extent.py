"""Selects what a report shows of a result with thousands of logs, each with its errors and remarks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from steelyard.errors import InputError
from steelyard.files import listed
from steelyard.identification import Identification, Prediction

__all__ = ["MOST_LOGS", "MOST_REMARKS", "default_log", "gathered", "shared_words", "short_names", "shown_logs"]

MOST_LOGS = 12  # of each role, with their joints and curves
MOST_REMARKS = 40  # about two screens
_EXAMPLES = 2  # logs that are named where many have the same remark


def default_log(identification: Identification) -> int:
    """Return which prediction comes first: that of the first log for validation, or else of the first log.

    It is always among the logs that are shown.

    Raises
    ------
    InputError
        Where there is none.
    """
    if not identification.predictions:
        raise InputError("no torques can be drawn of logs that were reduced before; identify with a log beside them.")
    roles = [prediction.role for prediction in identification.predictions]
    return roles.index("validation") if "validation" in roles else 0


def shown_logs(identification: Identification) -> list[int]:
    """Return which predictions are shown in full: of each role the first ones, or the first and those of most error.

    Returns
    -------
    list of int
        Indices of `predictions`, ascending.
    """
    chosen: list[int] = []
    predictions = identification.predictions
    for role in ("identification", "validation"):
        group = [index for index, prediction in enumerate(predictions) if prediction.role == role]
        if len(group) > MOST_LOGS:
            worst = sorted(group[1:], key=lambda index: -predictions[index].feasible_error)
            group = sorted([group[0], *worst[: MOST_LOGS - 1]])
        chosen += group
    return sorted(chosen)


def shared_words(predictions: Sequence[Prediction], shown: Sequence[int]) -> str:
    """Return a sentence on the logs that are not shown, or nothing where all are."""
    if len(shown) == len(predictions):
        return ""
    errors = sorted(prediction.feasible_error for prediction in predictions)
    middle = errors[len(errors) // 2]
    return (
        f"Of {len(predictions)} logs {len(shown)} are shown: the first, and those of the largest error. The errors of "
        f"all of them (feasible) lie between {errors[0]:.2%} and {errors[-1]:.2%}, half of them below {middle:.2%}."
    )


def short_names(identification: Identification) -> tuple[str, ...]:
    """Return a name for each prediction: its file, or as much of its path as tells it from the others."""
    names = [prediction.name for prediction in identification.predictions]
    short = ["+".join(Path(part).name for part in name.split("+")) for name in names]
    counts = Counter(short)
    return tuple(s if counts[s] == 1 else name for s, name in zip(short, names, strict=True))


def gathered(remarks: Iterable[str], logs: Iterable[str]) -> tuple[str, ...]:
    """Return remarks without repetition: the same remark on several logs is one, and at most `MOST_REMARKS` remain.

    Parameters
    ----------
    remarks : iterable of str
        What is of one log begins with its name and a colon.
    logs : iterable of str
        Their names.

    Examples
    --------
    >>> gathered(["a: It jitters.", "Odd.", "b: It jitters.", "c: It jitters."], ["a", "b", "c"])
    ('a, b and 1 more: It jitters.', 'Odd.')
    """
    known = set(logs)
    groups: dict[str, list[str]] = {}
    for remark in dict.fromkeys(remarks):
        log, colon, text = remark.partition(": ")
        if colon and log in known:
            groups.setdefault(text, []).append(log)
        else:
            groups.setdefault(remark, [])
    lines = []
    for text, names in groups.items():
        lines.append(f"{listed(names, _EXAMPLES)}: {text}" if names else text)
    if len(lines) > MOST_REMARKS:
        rest = len(lines) - MOST_REMARKS + 1
        lines = [*lines[: MOST_REMARKS - 1], f"There are {rest} more remarks; run.json holds all of them."]
    return tuple(lines)
