"""Logs that cannot be used: those of a set are told all at once, so that they are mended in one go."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import ClassVar

from steelyard.errors import LONGEST_MESSAGE, InputError, printable

from .given import GivenLog

__all__ = ["UnusableLogs", "UnusableLogsError"]

TOLD = 10
"""Logs that a refusal names; of thousands the reasons are mostly the same few."""


class UnusableLogsError(InputError):
    """Logs of a set that cannot be used: how many of how many, and a line for each of the first ten with its reason.

    Parameters
    ----------
    reasons : mapping from str to str
        Why each of them cannot, by its name.
    count : int
        How many logs the set has.

    Examples
    --------
    >>> raise UnusableLogsError({"b.csv": "b.csv is empty; expected rows.", "c.csv": "It has no torques."}, 3)
    Traceback (most recent call last):
    steelyard.identification.unusable_logs.UnusableLogsError: 2 of 3 logs cannot be used; mend them, or leave them out:
    b.csv is empty; expected rows.
    c.csv: It has no torques.
    """

    longest: ClassVar[int] = (TOLD + 2) * LONGEST_MESSAGE

    def __init__(self, reasons: Mapping[str, str], count: int) -> None:
        self.reasons = dict(reasons)
        self.count = count
        many = len(self.reasons)
        it = "it" if many == 1 else "them"
        lines = [f"{many} of {count} logs cannot be used; mend {it}, or leave {it} out:"]
        for log, reason in list(self.reasons.items())[:TOLD]:
            line = reason if printable(log) in reason else f"{log}: {reason}"
            lines.append(line.replace("\n", "\\n"))  # a name may hold one
        if many > TOLD:
            lines.append(f"And {many - TOLD} more.")
        super().__init__("\n".join(lines))

    @property
    def lines(self) -> tuple[str, ...]:
        """How many cannot be used, and what is said of each."""
        return tuple(str(self).split("\n"))

    def __reduce__(self) -> tuple[type[UnusableLogsError], tuple[dict[str, str], int]]:
        return type(self), (self.reasons, self.count)


class UnusableLogs:
    """The logs of a set that were found to be unusable so far, while the others are looked through.

    Attributes
    ----------
    reasons : dict from str to str
        Why each of them is, by its name.

    Examples
    --------
    >>> found = UnusableLogs()
    >>> for log in ("a.csv", "b.csv"):
    ...     with found.noting(log, count=2):
    ...         if log == "b.csv":
    ...             raise InputError("b.csv is empty; expected rows.")
    >>> found.reasons
    {'b.csv': 'b.csv is empty; expected rows.'}
    """

    def __init__(self) -> None:
        self.reasons: dict[str, str] = {}

    def __bool__(self) -> bool:
        return bool(self.reasons)

    def __contains__(self, log: object) -> bool:
        return str(log) in self.reasons

    @contextmanager
    def noting(self, log: GivenLog, count: int, say: Callable[[str], None] = lambda _: None) -> Iterator[None]:
        """Note why a log cannot be used, one of so many; nothing is held back where it is the only one."""
        try:
            yield
        except InputError as error:
            if count == 1:
                raise
            self.note(log, str(error), say)

    def note(self, log: GivenLog, reason: str, say: Callable[[str], None] = lambda _: None) -> None:
        """Note why a log cannot be used; the first is told at once, as it may take long to look through the others."""
        if not self.reasons:
            say(f"{log} cannot be used; looking through the other logs, to tell all that cannot")
        self.reasons.setdefault(str(log), reason)

    def refuse(self, logs: Sequence[GivenLog]) -> None:
        """Refuse a set of logs of which some cannot be used.

        Parameters
        ----------
        logs : sequence
            All of the set, in whose order they are told.

        Raises
        ------
        UnusableLogsError
            If there are any.
        """
        found = {name: self.reasons[name] for name in map(str, logs) if name in self.reasons}
        if found:
            raise UnusableLogsError(found, len(logs))
