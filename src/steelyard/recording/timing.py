"""Time stamps: order, rate, jitter, gaps, and an even grid where the log has none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from steelyard.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from steelyard.recording.recording import Recording

__all__ = ["JITTER_ACCEPTED", "check_even", "check_order", "check_period", "resampled", "row_numbers"]

JITTER_ACCEPTED = 0.1
"""Largest deviation of an interval from the period, as a fraction of it, that is taken for even sampling."""
JITTER_SILENT = 0.01
GAP = 1.5
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-6, 0.5
GAP_FILLED = 5.0
BRIDGED = 2.5
"""Intervals from which interpolated rows count as made up: two rows at least are missing."""
CLEAR_INTERVAL = 0.42
"""Of a period: where all intervals are so near to whole multiples of it, each tells how many rows it spans."""
BLOCK, MOST_BLOCKS = 128, 200
NEIGHBOURS = 40
"""Rows on either side of a long interval that tell whether the stamps stay displaced."""
ENOUGH = 10
"""Rows on the shorter side without which a single missing row cannot be told from jitter."""
MISSING = 0.6
MOST_PASSES = 100


def check_order(t: NDArray[np.float64], where: Callable[[int], str], source: str) -> None:
    """Refuse stamps that repeat or go back; `where` says where a row stands."""
    steps = np.diff(t)
    bad = steps <= 0.0
    if not bad.any():
        return
    row = int(np.argmax(bad)) + 1
    count = np.count_nonzero(bad)
    if steps[row - 1] == 0.0:
        raise InputError(
            f"{source}, {where(row)}, repeats the time {t[row]:.9g} s of the row before ({count} rows do so); "
            "remove the repeated rows, or state `rate` in [log] if the stamps are only rounded."
        )
    raise InputError(
        f"{source}, {where(row)}, goes back in time from {t[row - 1]:.9g} s to {t[row]:.9g} s ({count} rows do so); "
        "sort the rows, or split the log where a new run begins."
    )


def check_period(t: NDArray[np.float64], source: str) -> None:
    """Refuse a sample period that no robot log has: the unit of time is wrong then."""
    period = float(np.median(np.diff(t)))
    if SHORTEST_PERIOD <= period < LONGEST_PERIOD:
        return
    units = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    fitting = [unit for unit, scale in units.items() if 1e-4 <= period * scale < LONGEST_PERIOD]
    remedy = f'`time_unit = "{fitting[0]}"` would fit' if fitting else "check `time`, `time_unit` and `rate`"
    raise InputError(
        f"{source} has a sample period of {period:.6g} s; expected between {SHORTEST_PERIOD:g} and "
        f"{LONGEST_PERIOD:g} s: {remedy} in [log]."
    )


def row_numbers(t: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return the sample period in s, and the number (S,) of each row on an even clock: missing rows are left out of it.

    An interval of a jittery clock may be longer than one and a half periods, or shorter than half of one, with no row
    missing. Rows are missing where the stamps *stay* behind the even clock: where the median of the stamps after a long
    interval lies later than that before it by a period and more.

    Examples
    --------
    >>> stamps = np.delete(np.arange(300), [100, 101]) * 0.01
    >>> period, rows = row_numbers(stamps + 0.0045 * np.sin(np.arange(298) ** 2))
    >>> round(period, 4), np.flatnonzero(np.diff(rows) > 1).tolist(), int(rows[-1])
    (0.01, [99], 299)
    """
    steps = np.diff(t)
    typical = float(np.median(steps))
    ratio = steps / typical
    if np.all((np.abs(ratio - np.round(ratio)) < CLEAR_INTERVAL) & (ratio > 0.5)):
        typical = float(steps.sum() / np.round(ratio).sum())
        numbers = np.concatenate([[0.0], np.cumsum(np.round(steps / typical))])
        return _slope(t, numbers), numbers
    regular = _most_regular(t, typical)
    numbers = _displaced(t, regular)
    period = _slope(t, numbers)
    # Where so many rows are missing that their places are lost in the jitter, the stamps still tell the period.
    return (period if abs(period - regular) < 2e-3 * regular else regular), numbers


def _most_regular(t: NDArray[np.float64], typical: float) -> float:
    """Period near the typical interval whose multiples the stamps gather about, whatever rows are missing."""
    size = min(BLOCK, len(t))
    starts = np.unique(np.linspace(0, len(t) - size, min(MOST_BLOCKS, max(1, 2 * len(t) // size))).astype(int))
    blocks = t[starts[:, None] + np.arange(size)]
    blocks = blocks - blocks.mean(axis=1, keepdims=True)

    def gathered(period: float) -> float:
        return float(np.mean(np.abs(np.mean(np.exp(2j * np.pi / period * blocks), axis=1)) ** 2))

    width, periods = 0.15, np.array([typical])
    for _ in range(3):
        periods = periods[0] * np.linspace(1.0 - width, 1.0 + width, 301 if width > 0.1 else 21)
        periods = periods[[int(np.argmax([gathered(float(period)) for period in periods]))]]
        width = 0.0015 if width > 0.1 else 0.1 * width
    return float(periods[0])


def _slope(t: NDArray[np.float64], numbers: NDArray[np.float64]) -> float:
    centred = numbers - numbers.mean()
    return float(centred @ (t - t.mean()) / (centred @ centred))


def _displaced(t: NDArray[np.float64], period: float) -> NDArray[np.float64]:
    """Number rows so that the medians of the stamps before and after each long interval lie on one clock."""
    from scipy.ndimage import maximum_filter1d

    count = len(t)
    numbers = np.arange(count, dtype=np.float64)
    rows = np.flatnonzero(np.diff(t) > GAP * period)  # the last before each long interval
    places = rows[:, None] + np.arange(NEIGHBOURS)
    behind, ahead = places - NEIGHBOURS + 1, places + 1
    few = np.minimum(rows + 1, count - 1 - rows) < ENOUGH
    for _ in range(MOST_PASSES):
        late = t - period * numbers
        before, after = (
            np.nanmedian(np.where((at >= 0) & (at < count), late[np.clip(at, 0, count - 1)], np.nan), axis=1)
            for at in (behind, ahead)
        )
        rise = (after - before) / period
        # Of those within one window only the clearest, for it shows in the windows of the others, too.
        clear = np.zeros(count)
        clear[rows] = np.maximum(rise, 0.0)
        peak = np.asarray(maximum_filter1d(clear, 2 * NEIGHBOURS + 1))
        found = rows[(rise > np.where(few, MISSING + 1.0, MISSING)) & (clear[rows] == peak[rows])]
        if not len(found):
            break
        skipped = np.zeros(count)
        skipped[found + 1] = np.maximum(np.round(clear[found]), 1.0)
        numbers += np.cumsum(skipped)
    return numbers


def check_even(recording: Recording) -> tuple[str, ...]:
    """Return remarks on small jitter; refuse gaps and larger jitter."""
    if recording.count < 2:
        return ()
    steps = np.diff(recording.t)
    period, numbers = row_numbers(recording.t)
    if recording.stated_rate is not None:
        period = 1.0 / recording.stated_rate
    ratio = steps / period
    gaps = np.diff(numbers) > 1.0
    if gaps.any():
        row = int(np.argmax(np.where(gaps, ratio, 0.0)))
        raise InputError(
            f"{recording.source} has {np.count_nonzero(gaps)} gaps where rows are missing, the longest of "
            f"{steps[row]:.6g} s from t = {recording.t[row]:.6g} s ({recording.where(row)}); "
            "split the log there, or set `resample = true` in [processing]."
        )
    deviation = np.abs(ratio - 1.0)
    row = int(np.argmax(deviation))
    jitter = float(deviation[row])
    if jitter > JITTER_ACCEPTED:
        raise InputError(
            f"{recording.source} is sampled unevenly: an interval at t = {recording.t[row]:.6g} s "
            f"({recording.where(row)}) is off the period of {period:.6g} s by {100 * jitter:.3g} % "
            f"(accepted: {100 * JITTER_ACCEPTED:g} %); set `resample = true` in [processing], "
            "or state `rate` in [log] if the stamps are only rounded."
        )
    if jitter > JITTER_SILENT:
        return (
            f"The intervals between samples are off the period of {period:.6g} s by up to {100 * jitter:.2g} %; "
            "even sampling was assumed.",
        )
    return ()


def resampled(
    recording: Recording, rate: float | None, longest_gap: float | None
) -> tuple[Recording, NDArray[np.float64]]:
    """Interpolate onto an even grid; also return the gaps of two rows and more, (G, 2) begin and end in s.

    Positions and measured velocities and accelerations by cubic splines, torques linearly. The grid begins at the first
    stamp; its rate is `rate` (Hz) or that of the mean interval between gaps.

    Raises
    ------
    InputError
        For a gap longer than `longest_gap` (s; by default five sample periods), or a rate below that of the log.
    """
    from scipy.interpolate import CubicSpline

    t = recording.t
    steps = np.diff(t)
    period, _ = row_numbers(t)
    limit = GAP_FILLED * period if longest_gap is None else longest_gap
    longest = int(np.argmax(steps))
    if steps[longest] > max(limit, GAP * period):
        raise InputError(
            f"{recording.source} has a gap of {steps[longest]:.6g} s from t = {t[longest]:.6g} s "
            f"({recording.where(longest)}), longer than the {limit:.6g} s that may be bridged; split the log there "
            "(or raise `longest_gap` in [processing])."
        )
    if rate is not None and rate * period < 0.9:
        raise InputError(
            f"{recording.source} has a rate of {1.0 / period:.6g} Hz and `resample` asks for {rate:.6g} Hz; "
            "resample to at least the rate of the log and lower it with `decimate`."
        )
    new_period = period if rate is None else 1.0 / rate
    count = int(np.floor((t[-1] - t[0]) / new_period * (1.0 + 1e-12))) + 1
    grid = t[0] + np.arange(count) * new_period
    grid[-1] = min(grid[-1], t[-1])
    torque = np.column_stack([np.interp(grid, t, column) for column in recording.torque.T])

    def smooth(values: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
        return None if values is None else np.asarray(CubicSpline(t, values, axis=0)(grid))

    q = smooth(recording.q)
    assert q is not None

    def flagged(flags: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
        """Rows of the grid that lie beside a flagged one of the log."""
        if flags is None:
            return None
        after = np.clip(np.searchsorted(t, grid), 1, t.size - 1)
        return np.asarray(flags[after] | flags[after - 1])

    wide = steps > BRIDGED * period
    gaps = np.column_stack([t[:-1][wide], t[1:][wide]])
    remark = f"Resampled at {1.0 / new_period:.6g} Hz"
    remark += f", bridging {len(gaps)} gaps of up to {steps.max():.4g} s." if len(gaps) else "."
    even = replace(
        recording,
        t=grid,
        q=q,
        torque=torque,
        velocity=smooth(recording.velocity),
        acceleration=smooth(recording.acceleration),
        position_missing=flagged(recording.position_missing),
        torque_missing=flagged(recording.torque_missing),
        stated_rate=1.0 / new_period,
        remarks=(*recording.remarks, remark),
    )
    return even, gaps
