"""Everything that the numbers of a log say about its quality."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.recording.detection.clock import ClockStatistics, clock_statistics
from steelyard.recording.detection.intervals import Intervals
from steelyard.recording.detection.repeated import find_repeated
from steelyard.recording.detection.resolution import noise_deviation, resolution
from steelyard.recording.detection.saturation import find_saturation
from steelyard.recording.detection.stiction import find_stiction

if TYPE_CHECKING:
    from steelyard.recording.recording import Recording

__all__ = ["Diagnosis", "diagnose"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What `Recording.diagnose` finds.

    Attributes
    ----------
    source : str
    clock : ClockStatistics
    position_resolution, position_noise, torque_resolution, torque_noise : ndarray
        (N,) step of the values, 0 where none is seen, and standard deviation of white noise on them.
    stiction, saturation, repeated : Intervals
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
    repeated: Intervals
    missing: Intervals | None

    def sentences(self) -> tuple[str, ...]:
        """What was found, with the option of [processing] that leaves it out; empty where all is well."""
        found = list(self.clock.sentences())
        for one, option in (
            (self.stiction, "stiction = true"),
            (self.saturation, "saturation = true"),
            (self.repeated, "repeated = true"),
        ):
            found += [f"{sentence[:-1]} (`{option}` leaves them out)." for sentence in one.sentences()]
        if self.missing is not None:
            found += list(self.missing.sentences())
        return tuple(found)

    def __repr__(self) -> str:
        found = len(self.sentences())
        return f"Diagnosis({self.source!r}: {f'{found} findings' if found else 'nothing found'})"

    def __str__(self) -> str:
        return "\n".join((repr(self), *self.sentences()))

    def _repr_html_(self) -> str:
        items = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in self.sentences())
        head = "<tr><th>joint</th><th>position: step</th><th>noise</th><th>torque: step</th><th>noise</th></tr>"
        rows = "".join(
            f"<tr><td>{j + 1}</td>" + "".join(f"<td>{value:.3g}</td>" for value in values) + "</tr>"
            for j, values in enumerate(
                zip(
                    self.position_resolution,
                    self.position_noise,
                    self.torque_resolution,
                    self.torque_noise,
                    strict=True,
                )
            )
        )
        return (
            f"<table><caption>{html.escape(repr(self))}; {html.escape(repr(self.clock))}</caption>{head}{rows}</table>"
            + (f"<ul>{items}</ul>" if items else "")
        )


def diagnose(recording: Recording) -> Diagnosis:
    """Look for everything at once; see `Recording.diagnose`."""
    return Diagnosis(
        recording.source,
        clock_statistics(recording),
        resolution(recording.q),
        noise_deviation(recording.q),
        resolution(recording.torque),
        noise_deviation(recording.torque),
        find_stiction(recording),
        find_saturation(recording),
        find_repeated(recording),
        recording.missing,
    )
