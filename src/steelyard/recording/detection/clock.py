"""The clock of a log: its period, jitter and gaps, and whether stamps or an even clock tell the truth."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.recording.timing import row_numbers

if TYPE_CHECKING:
    from steelyard.recording.recording import Recording

__all__ = ["ClockStatistics", "clock_statistics"]

Array = NDArray[np.float64]
EVEN = 1e-3
"""Jitter, as a fraction of the period, that is no jitter."""
CLEAR = 1.5
"""Ratio of the roughness of the positions over either clock from which one is preferred."""


@dataclass(frozen=True, eq=False)
class ClockStatistics:
    """What `clock_statistics` returns.

    Attributes
    ----------
    period : float
        s: slope of the line through stamps and row numbers, missing rows counted.
    jitter : float
        s: root mean square deviation of the stamps from that line.
    interval_deviation, shortest, longest : float
        s: standard deviation of the intervals without gaps, least and greatest interval.
    missing : int
        Rows that gaps leave out.
    gaps : ndarray
        (G, 2) s, begin and end of each gap.
    roughness : float
        Third differences of the positions over the even clock, relative to those over the stamps: above one the stamps
        are right, below one the rows were taken evenly and only the stamps are not. NaN where there is no jitter.
    """

    period: float
    jitter: float
    interval_deviation: float
    shortest: float
    longest: float
    missing: int
    gaps: Array
    roughness: float

    @property
    def verdict(self) -> str:
        """ "even", "stamps" (they are right), "even clock" (the rows were taken evenly) or "unclear"."""
        if not self.jitter > EVEN * self.period:
            return "even"
        if self.roughness > CLEAR:
            return "stamps"
        return "even clock" if self.roughness < 1.0 / CLEAR else "unclear"

    def sentences(self) -> tuple[str, ...]:
        """What there is to say, with the remedy."""
        found = []
        if self.missing:
            longest = np.ptp(self.gaps, axis=1).max()
            found.append(
                f"{self.missing} rows are missing in {len(self.gaps)} gaps of up to {longest:.4g} s, the first at "
                f't = {self.gaps[0, 0]:.6g} s: use `resample = true`, or the filter "kalman".'
            )
        if self.verdict != "even":
            remedy = {
                "stamps": "positions are smoother over the stamps, which are right: use `resample = true`, or the "
                "filter "
                '"kalman"',
                "even clock": "positions are smoother over an even clock, so that only the stamps are unsteady: state "
                f"`rate = {1.0 / self.period:.6g}` in [log]",
                "unclear": "the positions do not tell whether the rows or only the stamps are unsteady",
            }[self.verdict]
            found.append(
                f"The stamps are off an even clock of {1.0 / self.period:.6g} Hz by {self.jitter:.3g} s "
                f"({100 * self.jitter / self.period:.2g} % of the period); {remedy}."
            )
        return tuple(found)

    def __repr__(self) -> str:
        return (
            f"ClockStatistics({1.0 / self.period:.6g} Hz, jitter {100 * self.jitter / self.period:.2g} % of the "
            "period, "
            f"{self.missing} rows missing, {self.verdict})"
        )

    def _repr_html_(self) -> str:
        items = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in self.sentences())
        return f"<p>{html.escape(repr(self))}</p>" + (f"<ul>{items}</ul>" if items else "")


def clock_statistics(recording: Recording) -> ClockStatistics:
    """Measure the clock of a recording from its stamps.

    Raises
    ------
    InputError
        For fewer than 8 rows.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.delete(np.arange(1000), [400, 401]) / 100
    >>> clock_statistics(Recording(t=t, q=np.sin(t)[:, None], torque=np.cos(t)[:, None]))
    ClockStatistics(100 Hz, jitter ... % of the period, 2 rows missing, even)
    """
    t = recording.t
    if len(t) < 8:
        raise InputError(f"{recording.source} has {len(t)} rows, too few to judge its clock by.")
    steps = np.diff(t)
    period, index = row_numbers(t)
    skipped = np.diff(index) - 1.0
    centred, stamps = index - index.mean(), t - t.mean()
    deviation = stamps - period * centred
    wide = skipped > 0
    regular = steps[~wide]
    jitter = float(np.sqrt(np.mean(deviation**2)))
    even = t.mean() + period * centred
    return ClockStatistics(
        period=period,
        jitter=jitter,
        interval_deviation=float(regular.std()),
        shortest=float(steps.min()),
        longest=float(steps.max()),
        missing=int(skipped.sum()),
        gaps=np.column_stack([t[:-1][wide], t[1:][wide]]),
        roughness=_roughness(even, recording.q) / _roughness(t, recording.q)
        if jitter > EVEN * period
        else float("nan"),
    )


def _roughness(t: Array, q: Array) -> float:
    """Root mean square of the third divided differences, scaled by joint."""
    order = np.argsort(t, kind="stable")
    t, table = t[order], (q / np.maximum(q.std(axis=0), 1e-12))[order]
    for distance in range(1, 4):
        spans = np.maximum(t[distance:] - t[:-distance], 1e-12)
        table = np.diff(table, axis=0) / spans[:, None]
    return float(np.sqrt(np.median(table**2))) + 1e-300
