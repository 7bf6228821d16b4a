"""The diagnosis of a log: all detectors together, and the sentences on what they found."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table

from ..clock import ClockStatistics, clock_statistics
from ..measurements import Measurements
from .detectors import (
    DETECTORS,
    Intervals,
    fault,
    find_missing,
    find_repeated,
    find_saturation,
    find_stuck_torque,
    noise_deviation,
    resolution,
    stuck_while_others_move,
    with_remedy,
)

__all__ = ["Diagnosis", "diagnose"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Quality of a log, as `Recording.diagnose` finds it.

    Attributes
    ----------
    source : str
    clock : ClockStatistics
    position_resolution, position_noise, torque_resolution, torque_noise : ndarray
        (N,) step of the values, 0 where none is seen, and standard deviation of white noise on them.
    stiction : Intervals
        What `find_stiction` finds, without rests at the begin and the end of the log and those of all joints together.
    saturation, stuck_torque, repeated : Intervals
    missing : Intervals or None
        Values that the log did not hold and that were filled.
    """

    source: str
    clock: ClockStatistics
    position_resolution: Array
    position_noise: Array
    torque_resolution: Array
    torque_noise: Array
    stiction: Intervals
    saturation: Intervals
    stuck_torque: Intervals
    repeated: Intervals
    missing: Intervals | None

    def sentences(self) -> tuple[str, ...]:
        """Return what was found, with the option of [processing] that leaves it out; nothing where all is well."""
        found = list(self.clock.sentences())
        for option in DETECTORS:
            found += with_remedy(getattr(self, option), option)
        if self.missing is not None:
            found += list(self.missing.sentences())
        return tuple(found)

    def faults(self, handled: Collection[str] = (), slowest: Array | None = None) -> dict[str, tuple[str, ...]]:
        """Return the sentences on rows that would harm a regression, by the option of [processing] that handles them.

        Options that are `handled` already, and those of which there is nothing to say, are left out; see `faulty_rows`.
        """
        found = {option: fault(getattr(self, option), option, slowest) for option in DETECTORS if option not in handled}
        return {option: sentences for option, sentences in found.items() if sentences}

    def __repr__(self) -> str:
        found = len(self.sentences())
        return f"Diagnosis({self.source!r}: {f'{found} findings' if found else 'nothing found'})"

    def __str__(self) -> str:
        return "\n".join((repr(self), *self.sentences()))

    def _repr_html_(self) -> str:
        columns = (self.position_resolution, self.position_noise, self.torque_resolution, self.torque_noise)
        rows = [(j, *(f"{value:.3g}" for value in row)) for j, row in enumerate(zip(*columns, strict=True), start=1)]
        heads = ("joint", "position: step", "noise", "torque: step", "noise")
        return html_table(f"{self!r}; {self.clock!r}", heads, rows, self.sentences())


def diagnose(recording: Measurements) -> Diagnosis:
    """Run all detectors on a recording; see `Recording.diagnose`."""
    return Diagnosis(
        recording.source,
        clock_statistics(recording),
        resolution(recording.q),
        noise_deviation(recording.q),
        resolution(recording.torque),
        noise_deviation(recording.torque),
        stuck_while_others_move(recording),
        find_saturation(recording),
        find_stuck_torque(recording),
        find_repeated(recording),
        find_missing(recording),
    )
