"""Time stamps: their order, their period, and the places of the rows on an even clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from steelyard.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["JITTER_SILENT", "check_order", "check_period", "row_numbers"]

JITTER_SILENT = 0.01
"""Largest deviation of an interval from the period, as a fraction of it, that nobody needs to hear of."""
GAP = 1.5
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-6, 0.5
TOGETHER, MANY = 2.0, 64
"""Where the mean interval over many rows is so many times the median one, rows were written several at a time."""
CLEAR_INTERVAL = 0.42
"""Of a period: where all intervals are so near to whole multiples of it, each tells how many rows it spans."""
BLOCK, MOST_BLOCKS = 128, 200
COARSE, FINE, FINEST = 0.15, 0.0015, 0.0001
"""Of the period: half widths of the searches for it."""
FEW_ROWS, WANDERING = 8, 1.8
"""Over so many rows jitter about an even clock spreads as over one, that of a wandering clock 2.8 times as much."""
DRIFT = 401
"""Rows over which a clock drifts by much less than a period."""
GATHERED = 0.2
"""How much the stamps gather about whole periods, from 0 to 1, with which each tells its number: 1 without jitter, 0.5
with up to 0.3 periods either way, 0.23 with 0.4."""
IN_TIME = 4.0
"""Votes of a row that is in time against rows that are late: a computer that is busy stamps late, and never early."""
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


def check_period(period: float, source: str) -> None:
    """Refuse a sample period in s that no robot log has: the unit of time is wrong then."""
    if SHORTEST_PERIOD <= period < LONGEST_PERIOD:
        return
    units = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    fitting = [unit for unit, scale in units.items() if 1e-4 <= period * scale < LONGEST_PERIOD]
    remedy = f'`time_unit = "{fitting[0]}"` would fit' if fitting else "check `time`, `time_unit` and `rate`"
    raise InputError(
        f"{source} has a sample period of {period:.6g} s; expected between {SHORTEST_PERIOD:g} and "
        f"{LONGEST_PERIOD:g} s: {remedy} in [log]."
    )


def row_numbers(t: NDArray[np.float64], period: float | None = None) -> tuple[float, NDArray[np.float64]]:
    """Return the sample period in s, and the number (S,) of each row on an even clock: missing rows are left out of it.

    An interval of a jittery clock may be longer than one and a half periods, or shorter than half of one, with no row
    missing. Rows are missing where the stamps *stay* behind the even clock: where the median of the stamps after a long
    interval lies later than that before it by a period and more.

    `period`, where it is known from other rows of the log, spares the search for it.

    Examples
    --------
    >>> stamps = np.delete(np.arange(300), [100, 101]) * 0.01
    >>> period, rows = row_numbers(stamps + 0.0045 * np.sin(np.arange(298) ** 2))
    >>> round(period, 4), np.flatnonzero(np.diff(rows) > 1).tolist(), int(rows[-1])
    (0.01, [99], 299)
    """
    steps = np.diff(t)
    typical = float(np.median(steps))
    if len(t) > 2 * MANY:
        mean = float(np.median(t[MANY:] - t[:-MANY])) / MANY
        typical = mean if mean > TOGETHER * typical else typical
    ratio = steps / typical
    if np.all((np.abs(ratio - np.round(ratio)) < CLEAR_INTERVAL) & (ratio > 0.5)):
        typical = float(steps.sum() / np.round(ratio).sum())
        numbers = np.concatenate([[0.0], np.cumsum(np.round(steps / typical))])
        return _slope(t, numbers), numbers
    if _wanders(t, typical):
        numbers = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(ratio), 1.0))])
        return _slope(t, numbers), numbers
    regular = _most_regular(t, typical) if period is None else _most_regular(t, period, FINE)
    counted = _counted(t, regular)
    numbers = _displaced(t, regular) if counted is None else counted
    period = _slope(t, numbers)
    # Where so many rows are missing that their places are lost in the jitter, the stamps still tell the period.
    return (period if abs(period - regular) < 2e-3 * regular else regular), numbers


def _wanders(t: NDArray[np.float64], typical: float) -> bool:
    """Whether the intervals vary by themselves, so that stamps stray ever further from any even clock."""
    steps = np.diff(t)
    # Seen where no row can be missing: gaps would look like a clock that strays.
    long = np.concatenate([[0], np.cumsum(steps > GAP * typical)])
    whole = long[FEW_ROWS:] == long[:-FEW_ROWS]
    if np.count_nonzero(whole) < 4 * FEW_ROWS:
        return False

    def spread(values: NDArray[np.float64]) -> float:
        return float(np.median(np.abs(values - np.median(values))))

    return spread((t[FEW_ROWS:] - t[:-FEW_ROWS])[whole]) > WANDERING * spread(steps[: len(whole)][whole])


def _most_regular(t: NDArray[np.float64], typical: float, width: float = COARSE) -> float:
    """Period near the typical interval whose multiples the stamps gather about, whatever rows are missing."""
    size = min(BLOCK, len(t))
    starts = np.unique(np.linspace(0, len(t) - size, min(MOST_BLOCKS, max(1, 2 * len(t) // size))).astype(int))
    blocks = t[starts[:, None] + np.arange(size)]
    blocks = blocks - blocks.mean(axis=1, keepdims=True)

    def gathered(period: float) -> float:
        return float(np.mean(np.abs(np.mean(np.exp(2j * np.pi / period * blocks), axis=1)) ** 2))

    while width > FINEST:
        periods = typical * np.linspace(1.0 - width, 1.0 + width, 301 if width == COARSE else 21)
        typical = float(periods[int(np.argmax([gathered(float(period)) for period in periods]))])
        width = FINE if width == COARSE else 0.1 * width
    return typical


def _slope(t: NDArray[np.float64], numbers: NDArray[np.float64]) -> float:
    centred = numbers - numbers.mean()
    return float(centred @ (t - t.mean()) / (centred @ centred))


def _counted(t: NDArray[np.float64], period: float) -> NDArray[np.float64] | None:
    """Number rows by the whole periods nearest to their stamps, never backwards; None where stamps are too unsteady.

    What a stamp is off the whole periods, on the average over its neighbours, is the slow drift of the clock. The
    rest is how many rows are missing so far, which can only grow. Of all such staircases the one with the least sum
    of absolute deviations is found, where being stamped early weighs more: rows that are written late, several at a
    time, are outvoted by a few that are in time.
    """
    from scipy.ndimage import uniform_filter1d

    cycles = (t - t[0]) / period
    phasor = np.exp(2j * np.pi * cycles)
    smooth = uniform_filter1d(phasor.real, DRIFT, mode="nearest") + 1j * uniform_filter1d(
        phasor.imag, DRIFT, mode="nearest"
    )
    if np.median(np.abs(smooth)) < GATHERED:
        return None
    drift = np.unwrap(np.angle(smooth)) / (2.0 * np.pi)
    missing = cycles - drift - np.arange(len(t))
    lowest = int(np.floor(missing.min()))
    levels = np.arange(lowest, int(np.ceil(missing.max())))
    # The step from a level to the next lies where the first row asks for it, or later, as long as rows are against it.
    begins = np.searchsorted(np.maximum.accumulate(missing), levels, side="right")
    ends = np.searchsorted(np.minimum.accumulate(missing[::-1])[::-1], levels + 1.0, side="left")
    steps = np.minimum(begins, ends)
    for place in np.flatnonzero(ends > begins):
        votes = np.clip(1.0 - 2.0 * (missing[begins[place] : ends[place]] - levels[place]), -1.0, 1.0)
        votes[votes > 0.0] *= IN_TIME
        steps[place] = begins[place] + int(np.argmax(np.concatenate([[0.0], np.cumsum(votes)])))
    rises = np.bincount(np.sort(steps), minlength=len(t) + 1)[: len(t)]
    numbers = np.arange(len(t)) + np.cumsum(rises)
    return np.asarray(numbers - numbers[0], dtype=np.float64)


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
