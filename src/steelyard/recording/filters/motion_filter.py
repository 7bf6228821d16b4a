"""The interface of filters of positions."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files import TomlSection

from ..columns import number

__all__ = ["Motion", "MotionFilter", "Response", "above", "whole"]

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """Filtered positions and their derivatives, (S, N) each."""

    q: Array
    dq: Array
    ddq: Array


class Response(NamedTuple):
    """Gains of a filter at frequencies, relative to the true motion, (F,) each; phases are unchanged.

    1 is perfect. `velocity` and `acceleration` compare with the true derivatives of the sine.
    """

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True)
class MotionFilter(TomlSection):
    """A filter of positions without phase shift, which also gives their derivatives.

    Its fields are the keys of the table ``filter`` in ``[processing]`` beside ``kind``.
    """

    section_name: ClassVar[str] = "filter"
    kind: ClassVar[str]
    needs_whole_log: ClassVar[bool] = False
    """Whether a log has to stand in memory for it; the others work chunk by chunk."""
    takes_uneven_times: ClassVar[bool] = False
    """Whether the rows may stand at any times."""

    @abstractmethod
    def settled(self, cutoff: float | None, order: int, where: str) -> Self:
        """Return the filter with what it leaves open taken from `cutoff` (Hz) and `order` of [processing].

        Raises
        ------
        InputError
            Where the filter is not determined then; `where` names it.
        """

    @abstractmethod
    def motion(self, t: Array, q: Array, rate: float, source: str) -> Motion:
        """Filter positions (S, N) at times (S,) in s, whose mean rate is `rate` (Hz), and derive them twice.

        Raises
        ------
        InputError
            Where there are too few rows, or the filter does not fit the rate; `source` names the log.
        """

    @abstractmethod
    def response(self, frequencies: ArrayLike, rate: float) -> Response:
        """Return the response at frequencies (F,) in Hz, at a sample rate in Hz, far from the ends of a log."""

    def padding(self, rate: float) -> int:
        """Return the number of rows after which what lies beyond them no longer shows."""
        raise NotImplementedError(f"{self.kind} needs the whole log")

    @abstractmethod
    def settling(self, rate: float) -> float:
        """Return the time in s at either end of a log that is spoilt, as the filter does not know what lies beyond."""

    def described(self) -> dict[str, Any]:
        """Return the filter as a table of robot.toml."""
        return {"kind": self.kind, **self.to_dict()}


def above(lowest: float, value: Any, where: str, what: str) -> float:
    """Return a number that is greater than another, or raise InputError."""
    if isinstance(value, str) or not number(value, where) > lowest:
        raise InputError(f"{where} is {value!r}; it must be {what}.")
    return float(value)


def whole(value: Any, lowest: int, highest: int, where: str) -> int:
    """Return a whole number within bounds, or raise InputError."""
    if not isinstance(value, int) or isinstance(value, bool) or not lowest <= value <= highest:
        raise InputError(f"{where} is {value!r}; it must be a whole number from {lowest} to {highest}.")
    return value
