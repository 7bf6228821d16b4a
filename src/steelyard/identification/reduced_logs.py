"""The logs of an identification, each reduced to what replaces its rows, and what these say of the robot together."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.regression.batch_means import BatchMeansTree
from steelyard.regression.body_change import BodyChange, body_change
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks

from .given import GivenLog
from .log_reader import (
    DRAWN_ROWS,
    LogReader,
    LogReduction,
    LogTask,
    Progress,
    ReducedLog,
    drawn_rows,
    one_by_one,
)
from .parameter_table import MANY_PARAMETERS

if TYPE_CHECKING:
    from steelyard.regression.drift import FrictionDrift

__all__ = [
    "ReducedLogs",
    "change_in_log",
    "copies_among",
    "overlaps_among",
    "reduced_logs",
    "require_once",
    "told_by_rows",
]

SHORTEST_DRIFT = 60.0
"""s of a log below which no drift of friction is looked for: gears warm up in minutes, and what changes in seconds is
the motion."""
_MOVING, _SAME_POSITION, _FEWEST_SHARED = 0.05, 1e-6, 10
"""Shares of the greatest speed and of the travel, and rows; see `overlaps_among`."""
_TRACE_POINTS = 1200  # points of the curves of a log: about as many as a figure of the report has pixels
_ALL_POINTS = 24_000  # of all the logs of a role together, so that thousands of them do not fill the memory


@dataclass(frozen=True, eq=False)
class ReducedLogs:
    """What is kept of the logs of an identification.

    Attributes
    ----------
    given : dict from str to GivenLog
        All of them by their names.
    logs : tuple of ReducedLog
        Those of the fit first, then those of the validation.
    information : Information
        Of those of the fit, together, and of what was reduced before.
    earlier : tuple of Information
        What was reduced before.
    blocks : TimeBlocks
        The stretches of the logs of the fit.
    copies : dict from int to str
        Which logs hold the rows of one before them, see `copies_among`.
    changes : dict from str to BodyChange
        Logs within which a body is picked up or put down.
    drifts : dict from str to tuple of FrictionDrift
        Logs within which friction drifts.
    drift_sentences : tuple of str
        What that means, a sentence for each.
    """

    given: dict[str, GivenLog]
    logs: tuple[ReducedLog, ...]
    information: Information
    earlier: tuple[Information, ...]
    blocks: TimeBlocks
    copies: dict[int, str]
    changes: dict[str, BodyChange]
    drifts: dict[str, tuple[FrictionDrift, ...]]
    drift_sentences: tuple[str, ...]

    def narrowed(self, wider: Model, model: Model) -> ReducedLogs:
        """Return the logs for a model that lacks some terms of the wider one; what they are together is left."""
        return replace(self, logs=tuple(log.narrowed(wider, model) for log in self.logs))


def reduced_logs(
    reader: LogReader,
    logs: Sequence[GivenLog],
    validation: Sequence[GivenLog],
    model: Model,
    reduction: LogReduction | None,
    say: Progress,
    informations: Sequence[tuple[str, Information]] = (),
) -> ReducedLogs:
    """Reduce the logs for a model, and look at each for what changes within it.

    Parameters
    ----------
    reader : LogReader
        That has decided how logs are processed; it is told of remarks and columns.
    logs, validation : sequence of GivenLog
    model : Model
    reduction : callable, optional
        See :func:`steelyard.identify`.
    say : callable
    informations : sequence of (str, Information)
        Of further logs of the fit that were reduced before, and their names.
    """
    tasks = [
        _task(log, number, len(group), group is logs)
        for group in (logs, validation)
        for number, log in enumerate(group)
    ]
    means, blocks = BatchMeansTree(), TimeBlocks(empty_factors(model))
    kept: list[ReducedLog] = []
    changes: dict[str, BodyChange] = {}
    drifts: dict[str, tuple[FrictionDrift, ...]] = {}
    sentences: list[str] = []
    for group in (reduction or one_by_one)(reader, tasks, model, say):
        means.add(group.batch_means)
        for log in group.logs:
            reader.note(log)
            kept.append(replace(log, blocks=()))  # which are joined with those of the other logs
            if not log.fitted:
                continue
            own = TimeBlocks.of_held(blocks.empty, log.blocks)
            t = log.drawn.samples.t
            changed = change_in_log(model, own, log.drawn.samples)
            if changed is not None:  # whose friction seems to change, too
                changes[log.name] = changed
            elif t is not None and np.ptp(t) >= SHORTEST_DRIFT:
                from steelyard.regression.drift import drift_sentence, friction_drifts  # short logs need none

                found = friction_drifts(own, model.base_parameters().names)
                if found:
                    drifts[log.name] = found
                    sentences.append(drift_sentence(log.name, found, model.robot.joint_names))
            blocks.append(own)
    earlier = [one for _, one in informations]
    copies = copies_among(
        [(log.name, log.role, log.information) for log in kept]
        + [(name, "identification", one) for name, one in informations]
    )
    reader.remarks.extend((*copies.values(), *overlaps_among([log for k, log in enumerate(kept) if k not in copies])))
    for name, one in informations:
        reader.remarks.append(f"{name}: {one.count} rows that were reduced before are in the fit, and not looked at.")
    fitted = [log.information for log in kept if log.fitted]
    if fitted:
        fitted = [replace(Information.total(fitted), batch_means=means.total())]
    information = Information.total([*fitted, *earlier])
    given = {str(log): log for log in (*validation, *logs)}
    told = tuple(sentences)
    return ReducedLogs(given, tuple(kept), information, tuple(earlier), blocks, copies, changes, drifts, told)


def _task(log: GivenLog, number: int, count: int, fitted: bool) -> LogTask:
    """Say what is to be kept of one of `count` logs of a role: of the first one more than of the others."""
    points = _TRACE_POINTS if number == 0 else min(max(_ALL_POINTS // count, 100), _TRACE_POINTS)
    rows = DRAWN_ROWS if number == 0 else drawn_rows(count, 200)
    return LogTask(log, points, rows, count, fitted)


def copies_among(
    logs: Sequence[tuple[str, str, Information]], contents: Mapping[str, Hashable] = MappingProxyType({})
) -> dict[int, str]:
    """Find logs that hold the very rows of one before them, and say of each what that does to the answer.

    Parameters
    ----------
    logs : sequence of (str, str, Information)
        Name, role and reduction of each log, those of the fit first. Sums of products that are the same to ten digits
        are those of the same rows: noise alone makes others different.
    contents : mapping, optional
        What tells the contents of logs, by name; logs of the same contents are copies as well. Logs that were
        processed for themselves may have other rows left out, which changes their sums.

    Returns
    -------
    dict
        The sentence by the index of the log.
    """
    first: dict[Hashable, int] = {}
    found = {}
    for index, (name, role, information) in enumerate(logs):
        rows = told_by_rows(information)
        keys = [rows, contents[name]] if name in contents else [rows]
        before = min(first.setdefault(key, index) for key in keys)
        if before == index or not information.count:
            continue
        other, other_role, _ = logs[before]
        same = "the rows of this log" if other == name else f"the rows of {other}"
        if role != other_role:
            found[index] = f"{name}: {same} were used in the fit, so that its error is no test of a prediction."
        else:
            harm = "twice, so that intervals are too narrow" if role == "identification" else "once"
            found[index] = f"{name}: {same} were given twice, and count {harm}."
    return found


def overlaps_among(logs: Sequence[ReducedLog]) -> tuple[str, ...]:
    """Find logs that share some rows, as parts of one recording may, and say of each pair what that does to the answer.

    It is told by the rows that are kept to be drawn: all of short logs, the extremes of long ones. Two are the same row
    where they have the same time, exactly the same torques and, up to what filters make of the ends of a part, the same
    positions, while the robot moves. Two runs of one motion have that by chance alone, in few rows, however coarse the
    steps of their torques are.
    """
    known = [(log, samples) for log in logs for samples in (log.drawn.samples,) if samples.t is not None]
    # Whole ns on the clocks of the logs, of which each counts from its own first row.
    clocks = [log.clock_origin + _nanoseconds(samples) for log, samples in known]
    begin = min((int(clock.min()) for clock in clocks if len(clock)), default=0)
    sums: list[NDArray[np.float64]] = [np.empty(0)]
    numbers, places = [np.empty(0, dtype=np.intp)], [np.empty(0, dtype=np.intp)]
    for index, ((_, samples), clock) in enumerate(zip(known, clocks, strict=True)):
        speed = np.abs(samples.dq).max(axis=1, initial=0.0)
        moving = np.flatnonzero(speed > _MOVING * speed.max(initial=0.0))
        own = np.asarray(1e-9 * (clock[moving] - begin), dtype=np.float64)
        for joint in range(samples.joint_count):  # a product of matrices would round rows by where they stand
            own += np.sqrt(joint + 2.0) * samples.torque[moving, joint]
        sums.append(own)
        numbers.append(np.full(len(moving), index))
        places.append(moving)
    mixed, number, place = np.concatenate(sums), np.concatenate(numbers), np.concatenate(places)
    order = np.argsort(mixed, kind="stable")
    same = np.flatnonzero((np.diff(mixed[order]) == 0.0) & (np.diff(number[order]) != 0))
    rows, others = order[same], order[same + 1]
    told = []
    for first, second in np.unique(np.column_stack([number[rows], number[others]]), axis=0):
        (log, one), (other_log, other) = known[first], known[second]
        pair = (number[rows] == first) & (number[others] == second)
        here, there = place[rows[pair]], place[others[pair]]
        assert other.t is not None
        equal = (clocks[first][here] == clocks[second][there]) & (one.torque[here] == other.torque[there]).all(axis=1)
        near = np.abs(one.q[here] - other.q[there]) <= _SAME_POSITION * np.ptp(one.q, axis=0)
        t = other.t[there][equal & near.all(axis=1)]
        if len(t) < _FEWEST_SHARED:
            continue
        if log.role != other_log.role:
            harm = "were used in the fit, so that its error is no test of a prediction there"
        else:
            harm = f"count twice{', so that intervals are too narrow' * log.fitted}; leave them out of one of the two"
        told.append(
            f"{other_log.name}: rows from t = {t.min():.6g} to {t.max():.6g} s are rows of {log.name}, too, and {harm}."
        )
    return tuple(told)


def _nanoseconds(samples: Samples) -> NDArray[np.int64]:
    # Within what 64 bits hold, also of differences; no clock shows more.
    return np.rint(np.clip(1e9 * np.asarray(samples.t), -2e18, 2e18)).astype(np.int64)


def require_once(logs: Iterable[GivenLog], informations: Iterable[tuple[str, Information]]) -> tuple[str, ...]:
    """Return the hashes of logs in files, and of the logs that Informations hold; refuse those that are there twice."""
    from steelyard.recording.formats import content_hashes  # what is not asked for is not loaded

    given = [(name, one.contents) for name, one in informations]
    for log in logs:
        hashes = content_hashes(str(log)) if isinstance(log, str | Path) else ()  # none where there is no such file
        given.append((str(log), ("+".join(hashes),) if hashes else ()))
    holders: dict[str, str] = {}
    for name, contents in given:
        for content in contents:
            if content in holders:
                raise InputError(f"{name}: has rows that {holders[content]} has, too; leave one of them out.")
            holders[content] = name
    return tuple(holders)


def told_by_rows(information: Information) -> Hashable:
    """Return what is the same for Informations of the very same rows, and for no others where there is noise."""
    # Sums of squares of one mixture of all columns; the last digits depend on how blocks were joined.
    mixed = [factor.triangle @ np.linspace(1.0, 2.0, len(factor.triangle)) for factor in information.factors]
    return tuple((f.count, f"{one @ one:.9e}") for f, one in zip(information.factors, mixed, strict=True))


def change_in_log(model: Model, blocks: TimeBlocks, kept: Samples) -> BodyChange | None:
    """Tell whether a link at the end of a chain picks up or puts down a body in the course of a log.

    Parameters
    ----------
    blocks : TimeBlocks
        Of the rows of the log, with the base parameters of the model.
    kept : Samples
        Rows of all the log.
    """
    if kept.t is None or not len(kept.t) or model.parameter_count > MANY_PARAMETERS:
        return None
    base, robot = model.base_parameters(), model.robot
    ends = {robot.link_names[k]: base.K[:, np.asarray(model.link_columns[k])] for k in robot.end_links}
    return body_change(blocks, base.names, ends, float(np.min(kept.t)), float(np.max(kept.t)))
