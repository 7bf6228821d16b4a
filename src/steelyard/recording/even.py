"""Rows on an even clock: missing values and short gaps are filled, long gaps split the log."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import LARGEST
from steelyard.once import cached_property

from .clock import FEWEST_ROWS, JITTER_SILENT, TICK, ClockStatistics, clock_statistics
from .measurements import Measurements
from .samples import is_finite

__all__ = ["EvenClock", "Part", "evened", "filled", "longest_part"]

Log = TypeVar("Log", bound=Measurements)
JITTER_ACCEPTED = 0.1
"""Largest deviation of an interval from the period, as a fraction of it, that is taken for even sampling when asked."""
PERIODS_FILLED, TIME_FILLED = 5.0, 0.02
"""Sample periods, or s, that a gap may last to be filled by default, whichever is longer.

A cubic spline over noisy positions bulges by a quarter of their noise for each row that is missing. Over 20 rows that
is five times the noise, for 0.02 s, of which a filter at 5 Hz leaves a tenth; nor has an arm's motion, slower than some
5 Hz, time to be anything but cubic. Splitting there would give up the ends of both parts instead.
"""
BRIDGED = 2.5
"""Sample periods of an interval from which the rows inside are made up: two rows at least are missing."""
CONTEXT = 64
"""Rows on either side that an interpolating cubic spline needs to be that of the whole log: each dampens by 0.27."""


@dataclass(frozen=True)
class Part:
    """Rows start:stop of a log, between its ends and gaps that are not filled, and the `count` even rows they make."""

    start: int
    stop: int
    count: int


class EvenClock:
    """Places the rows of a log on an even clock, as `resample` in [processing] says.

    Parameters
    ----------
    clock : ClockStatistics
        Of the log, with the evidence for or against its stamps.
    resample : bool or float
        True places uneven rows on an even clock, a number is the rate of the even rows in Hz, false refuses uneven
        rows.
    longest_gap : float or None
        s, the longest gap that is filled; by default five sample periods or 0.02 s, whichever is longer.
    needs_even_rows : bool
        False where rows may stay at uneven times, and gaps open.
    source : str
        For messages.

    Attributes
    ----------
    as_is : bool
        Whether the rows stay where they are.
    by_stamps : bool
        Whether the rows were taken at uneven times, which the stamps tell.
    parts : tuple of Part
    remarks : tuple of str

    Raises
    ------
    InputError
        For a log that is uneven where that is refused, or a rate below that of the log.
    """

    def __init__(
        self,
        clock: ClockStatistics,
        resample: bool | float,
        longest_gap: float | None,
        needs_even_rows: bool,
        source: str,
    ) -> None:
        self.clock, self.source = clock, source
        rate = None if isinstance(resample, bool) else resample
        if rate is not None and rate * clock.period < 0.9:
            raise InputError(
                f"{source} has a rate of {1.0 / clock.period:.6g} Hz and `resample` asks for {rate:.6g} Hz; "
                "resample to at least the rate of the log and lower it with `decimate`."
            )
        self.by_stamps = clock.verdict == "stamps"
        uneven = bool(len(clock.gaps)) or self.by_stamps or clock.largest > JITTER_ACCEPTED
        if uneven and resample is False and needs_even_rows:
            self._refuse()
        self._stamps_count = resample is False or clock.verdict in ("even", "stamps")
        self.as_is = rate is None and not (uneven and needs_even_rows)
        self.period = clock.period if rate is None else 1.0 / rate
        self._longest = max(PERIODS_FILLED * clock.period, TIME_FILLED) if longest_gap is None else longest_gap
        lengths = (clock.skipped + 1) * clock.period
        long = np.zeros(len(lengths), bool) if self.as_is else lengths > max(self._longest, 1.5 * clock.period) + 1e-9
        starts = [0, *(int(row) + 1 for row in clock.gap_rows[long])]
        stops = [*starts[1:], clock.count]
        self.parts = tuple(Part(a, b, self._count(a, b)) for a, b in zip(starts, stops, strict=True))
        self.remarks = self._remarks(long)

    def _refuse(self) -> None:
        clock = self.clock
        remedy = "let `resample` in [processing] have its default, true, or split the log"
        if len(clock.gaps):
            longest = int(np.argmax(clock.skipped))
            raise InputError(
                f"{self.source} has {len(clock.gaps)} gaps where rows are missing, the longest of "
                f"{np.ptp(clock.gaps[longest]):.6g} s from t = {clock.gaps[longest, 0]:.9g} s (row "
                f"{clock.gap_rows[longest] + 1}); {remedy} there."
            )
        raise InputError(
            f"{self.source} is sampled unevenly: intervals are off the period of {clock.period:.6g} s by up to "
            f"{100 * clock.largest:.3g} % of it; {remedy}."
        )

    def _remarks(self, long: NDArray[np.bool_]) -> tuple[str, ...]:
        clock = self.clock
        if self.as_is:
            if JITTER_SILENT < clock.largest <= JITTER_ACCEPTED and not self.by_stamps:
                return (
                    f"The intervals between samples are off the period of {clock.period:.6g} s by up to "
                    f"{100 * clock.largest:.2g} %; even sampling was assumed.",
                )
            return clock.sentences()
        found = list(clock.sentences())
        rate = 1.0 / self.period
        if self.by_stamps or self.period != clock.period:
            found.append(f"Rows were interpolated at {rate:.6g} Hz.")
        elif clock.verdict != "even":
            found.append(f"Rows were placed on the even clock of {rate:.6g} Hz.")
        short, longer = clock.skipped[~long], int(long.sum())
        if short.size:
            most = (int(short.max()) + 1) * clock.period
            found.append(
                f"Gaps of up to {most:.4g} s were filled for the filters; what was filled is not used "
                "(`longest_gap` in [processing] chooses which are)."
            )
        if longer:
            found.append(
                f"At {longer} gaps of more than {self._longest:.4g} s the log was split, and each part processed by "
                "itself."
            )
        return tuple(found)

    @cached_property
    def _after(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers of the first rows behind the gaps, and the missing rows before and after each."""
        total = np.concatenate([[0], np.cumsum(self.clock.skipped)])
        return self.clock.gap_rows + 1 + total[1:], total

    def _count(self, start: int, stop: int) -> int:
        if self.as_is:
            return stop - start
        if self.by_stamps:
            # The ends of a part are known to the rows around them only; see `placed`, which knows the stamps.
            first, last = self._stamp(start), self._stamp(stop - 1)
            return int(np.floor((last - first) / self.period * (1.0 + 1e-12))) + 1
        numbers = self.clock.numbers(stop - 1, stop)[0] - self.clock.numbers(start, start + 1)[0]
        return int(np.floor(numbers * self.clock.period / self.period * (1.0 + 1e-12))) + 1

    def _stamp(self, row: int) -> float:
        """Return the stamp of a row at an end of the log or of a gap."""
        clock = self.clock
        if row == 0:
            return float(clock.ticks[0])
        if row == clock.count - 1:
            return float(clock.ticks[-1])
        gap = int(np.searchsorted(clock.gap_rows, row))
        begins = gap < len(clock.gap_rows) and clock.gap_rows[gap] == row
        return float(clock.gaps[gap, 0] if begins else clock.gaps[gap - 1, 1])

    def rows(self, part: Part, start: int, stop: int) -> tuple[int, int]:
        """Return the rows first:last of the log from which the even rows start:stop of a part are made."""
        if self.as_is:
            return part.start + start, part.start + stop
        ends = np.array([start, stop - 1]) * self.period
        if self.by_stamps:
            ticks = self.clock.ticks
            found = np.searchsorted(ticks, self._stamp(part.start) + ends)
            first, last = (int(found[0]) - 1) * TICK, int(found[1]) * TICK
        else:
            after, total = self._after
            numbers = self.clock.numbers(part.start, part.start + 1)[0] + ends / self.clock.period
            gap = np.searchsorted(after, numbers, side="right")
            # A place inside a gap is that of the row before it.
            before = np.append(self.clock.gap_rows, self.clock.count - 1)[gap]
            first, last = np.minimum(numbers - total[gap], before).astype(int).tolist()
        return max(part.start, first - CONTEXT), min(part.stop, last + CONTEXT + 2)

    def placed(self, recording: Log, first: int, part: Part, start: int, stop: int) -> Log:
        """Return the even rows start:stop of a part, from a recording whose first row is row `first` of the log.

        Positions and measured velocities and accelerations by cubic splines, torques linearly; rows that were made up
        count as missing.
        """
        if self.as_is:
            return self.restamped(recording, first)
        from scipy.interpolate import CubicSpline  # few logs need it

        origin = self._stamp(part.start)
        grid = np.arange(start, stop, dtype=np.float64)
        if self.by_stamps:
            at = (recording.t - origin) / self.period
            grid[-1] = min(grid[-1], at[-1])
        else:
            numbers = self.clock.numbers(first, first + recording.count)
            if len(self.clock.doubtful):
                known = ~np.isin(np.arange(first, first + recording.count), self.clock.doubtful)
                known[[0, -1]] = True
                numbers, recording = numbers[known], recording.chosen(known)
            at = (numbers - self.clock.numbers(part.start, part.start + 1)[0]) * (self.clock.period / self.period)
        after = np.clip(np.searchsorted(at, grid), 1, len(at) - 1)
        exact = at[after] == grid
        exact_before = at[after - 1] == grid
        wide = BRIDGED if self.by_stamps or self.period != self.clock.period else 1.5
        made_up = ((at[after] - at[after - 1]) * self.period > wide * self.clock.period) & ~exact & ~exact_before

        def smooth(values: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
            if values is None or len(at) == 1:  # a row alone between two gaps
                return values
            return np.asarray(CubicSpline(at, values, axis=0)(grid))

        def flagged(flags: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
            """Return the even rows that lie on a flagged row of the log, or beside one."""
            if flags is None:
                return np.zeros((len(grid), recording.joint_count), bool)
            return np.asarray((flags[after] & ~exact_before[:, None]) | (flags[after - 1] & ~exact[:, None]))

        q = smooth(recording.q)
        assert q is not None
        absent = flagged(recording.position_missing) | made_up[:, None]
        silent = flagged(recording.torque_missing)
        return replace(
            recording,
            t=origin + np.arange(start, stop, dtype=np.float64) * self.period,
            q=q,
            torque=np.column_stack([np.interp(grid, at, column) for column in recording.torque.T]),
            velocity=smooth(recording.velocity),
            acceleration=smooth(recording.acceleration),
            channels=None
            if recording.channels is None
            else {
                name: np.column_stack([np.interp(grid, at, column) for column in values.T])
                for name, values in recording.channels.items()
            },
            position_missing=absent if absent.any() else None,
            torque_missing=silent if silent.any() else None,
            stated_rate=1.0 / self.period,
        )

    def restamped(self, recording: Log, first: int) -> Log:
        """Return the rows as they are, with times of the even clock where that is right and the stamps are not.

        For filters that take rows at any times. The recording's first row is row `first` of the log.
        """
        if self._stamps_count or self.clock.largest <= JITTER_ACCEPTED:
            return recording
        numbers = self.clock.numbers(first, first + recording.count)
        return replace(recording, t=(self.clock.ticks[0] + numbers * self.clock.period).astype(np.float64))


def evened(
    recording: Log, resample: bool | float = True, longest_gap: float | None = None, needs_even_rows: bool = True
) -> tuple[list[Log], tuple[str, ...]]:
    """Place a recording on an even clock; return it in parts where gaps are too long to be filled, and remarks.

    See `EvenClock`.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.delete(np.arange(1000), [300, 301, *range(600, 700)]) / 100
    >>> parts, _ = evened(Recording(t=t, q=np.sin(t)[:, None], torque=np.cos(t)[:, None]))
    >>> [(part.count, int(part.missing.count[0]) if part.missing else 0) for part in parts]
    [(600, 2), (300, 0)]
    """
    if recording.count < FEWEST_ROWS:
        return [recording], ()
    even = EvenClock(clock_statistics(recording), resample, longest_gap, needs_even_rows, recording.source)
    if even.as_is:
        return [even.restamped(recording, 0)], even.remarks
    return [
        even.placed(recording.rows(part.start, part.stop), part.start, part, 0, part.count) for part in even.parts
    ], even.remarks


def longest_part(recording: Log) -> Log:
    """Return the longest stretch of a recording without gaps, on an even clock."""
    return max(evened(recording, True, None, True)[0], key=lambda part: part.count)


def filled(
    t: NDArray[np.float64], values: NDArray[np.float64] | None, what: str, source: str
) -> tuple[NDArray[np.float64] | None, NDArray[np.bool_] | None]:
    """Replace NaN in columns (S, N) by monotone cubic interpolation over t (S,), at the ends by the nearest value.

    Returns
    -------
    values : ndarray or None
    missing : ndarray of bool or None
        (S, N) where values were NaN; None where none was.

    Raises
    ------
    InputError
        Where a column other than a torque has fewer than two numbers. A torque may be missing throughout, as drivers
        leave it out of single joints: it is 0 then, and none of its rows counts.
    """
    if values is None or is_finite(values):
        return values, None
    missing = np.isnan(values)
    if not missing.any():
        return values, None
    from scipy.interpolate import PchipInterpolator

    result = values.copy()
    for j in map(int, np.flatnonzero(missing.any(axis=0))):
        own, none = values[:, j], missing[:, j]
        good = np.abs(own) <= LARGEST  # what is beyond is refused, and would overflow here
        if np.count_nonzero(good) < 2 and what == "torque":
            result[none, j] = own[good].sum()
            continue
        if np.count_nonzero(good) < 2:
            raise InputError(
                f"{source}: the {what} of joint {j + 1} has {np.count_nonzero(good)} numbers in {len(t)} rows, too "
                "few to fill "
                "the others."
            )
        inside = np.clip(t, t[good][0], t[good][-1])
        result[none, j] = PchipInterpolator(t[good], own[good])(inside[none])
    return result, missing
