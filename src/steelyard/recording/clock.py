"""The clock of a log: the numbers of its rows, its period, jitter and gaps, and whether its stamps are right."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_sentences
from steelyard.errors import InputError

from .measurements import Measurements

__all__ = [
    "CLOCK_ROWS",
    "FEWEST_ROWS",
    "JITTER_SILENT",
    "ClockStatistics",
    "clock_of",
    "clock_statistics",
    "row_numbers",
    "steady_clock",
    "with_evidence",
]

Array = NDArray[np.float64]
CLOCK_ROWS = 50_000
"""Rows that are looked at together; the same for a log in memory and one that is read in pieces, so that both agree."""
FEWEST_ROWS = 8
"""Rows below which the clock of a log cannot be measured."""
MARGIN = 200
"""Rows on either side of an interval that tell whether rows are missing there: several windows of `row_numbers`."""
TICK = 256
"""Every so many rows one stamp is kept, by which rows are found again."""
LOCAL = 41
"""Rows beyond which a clock may wander: what a stamp is off its neighbours is evidence, its drift is none."""
VELOCITY_REACH = 3
"""Rows on either side from which the velocity comes that turns time into travel; nearer ones carry more noise."""
COLOUR = 1.5
"""Third differences of white noise are correlated, so that evidence is worth less than as many independent rows."""
SURE = 0.2
"""Largest standard deviation of the share that decides; with a larger one, neither clock makes a visible difference."""
JITTER_SILENT = 0.01
"""Largest deviation of an interval from the period, as a fraction of it, that is not remarked on."""
GAP = 1.5
"""Periods; longer intervals are looked at for missing rows."""
TOGETHER, MANY = 2.0, 64
"""Where the mean interval over many rows is so many times the median one, rows were written several at a time."""
CLEAR_INTERVAL = 0.42
"""The share of a period within which intervals are clear: where all intervals are so near to whole multiples of it,
each tells how many rows it spans."""
ALIKE = 1.4
"""Where no interval is so many times another one, none is farther from their median than `CLEAR_INTERVAL` allows."""
BLOCK, MOST_BLOCKS = 128, 200
"""Rows of a block, within which stamps must keep in phase with a period, and blocks by which the period is searched."""
COARSE, FINE, FINEST = 0.15, 0.0015, 0.0001
"""Half widths of the searches for the period, as shares of it."""
FEW_ROWS, WANDERING = 8, 1.8
"""Over so many rows jitter about an even clock spreads as over one, that of a wandering clock 2.8 times as much."""
DRIFT = 401
"""Rows over which a clock drifts by much less than a period."""
GATHERED = 0.2
"""Least concentration of the stamps about whole periods, from 0 to 1, with which each stamp gives its own number. It is
1 without jitter, 0.5 with up to 0.3 periods either way, 0.23 with 0.4."""
IN_TIME = 4.0
"""Weight of a row that is in time, relative to rows that are late: a busy computer stamps late, and never early."""
NEIGHBOURS = 40
"""Rows on either side of a long interval that tell whether the stamps stay displaced."""
ENOUGH = 10
"""Rows on the shorter side without which a single missing row cannot be distinguished from jitter."""
MISSING = 0.6
"""Periods by which stamps must stay behind after a long interval for a row to count as missing there."""
LONGEST_STALL = 5.0
"""s: nothing keeps a logger for longer, so that another run or episode begins behind a longer gap."""
MOST_PASSES = 100
"""Passes over a log; each finds those gaps that are the clearest within a window."""


@dataclass(frozen=True, eq=False)
class ClockStatistics:
    """The clock of a log, as `clock_statistics` measures it.

    Attributes
    ----------
    count : int
        Rows of the log.
    period : float
        s: slope of the line through stamps and row numbers, missing rows counted.
    jitter : float
        s: root mean square deviation of the stamps from that line.
    largest : float
        Greatest deviation of an interval from the period (in gaps: from a whole number of periods), as a fraction of
        the period.
    gap_rows, skipped : ndarray
        (G,) the last row (from 0) before each gap, and how many are missing there.
    gaps : ndarray
        (G, 2) s, begin and end of each gap.
    doubtful : ndarray
        Rows that are stamped so late beside missing ones that nothing tells their numbers.
    ticks : ndarray
        Every 256th stamp in s, and the last.
    share, share_deviation : float
        How much of what the stamps are off an even clock shows in the positions, with its standard deviation: 1 where
        the stamps are right, 0 where the rows were taken evenly and only the stamps are not. NaN where not looked for.
    """

    count: int
    period: float
    jitter: float
    largest: float
    gap_rows: NDArray[np.int64]
    skipped: NDArray[np.int64]
    gaps: Array
    doubtful: NDArray[np.int64]
    ticks: Array
    share: float = float("nan")
    share_deviation: float = float("nan")

    @property
    def pauses(self) -> NDArray[np.bool_]:
        """(G,) which of the gaps are so long that nothing was recorded, rather than that rows are missing."""
        return np.asarray(np.ptp(self.gaps, axis=1) > LONGEST_STALL)

    @property
    def paused(self) -> float:
        """s in which nothing was recorded."""
        return float(np.ptp(self.gaps, axis=1)[self.pauses].sum())

    @property
    def missing(self) -> int:
        """Number of rows that are missing in gaps other than pauses."""
        return int(self.skipped[~self.pauses].sum())

    @property
    def verdict(self) -> str:
        """ "even", "stamps" (they are right), "even clock" (the rows were taken evenly) or "unclear"."""
        if not self.largest > JITTER_SILENT:
            return "even"
        if not self.share_deviation < SURE:
            return "unclear"
        return "stamps" if self.share > 0.5 else "even clock"

    def numbers(self, start: int, stop: int) -> NDArray[np.int64]:
        """Number the rows start:stop on the even clock, missing rows counted."""
        rows = np.arange(start, stop)
        before = np.concatenate([[0], np.cumsum(self.skipped)])
        return np.asarray(rows + before[np.searchsorted(self.gap_rows, rows, side="left")])

    def sentences(self) -> tuple[str, ...]:
        """Return one sentence for each irregularity, none for an even clock without gaps."""
        return tuple(self.irregularities.values())

    @property
    def irregularities(self) -> dict[str, str]:
        """Sentences on "gaps", "pauses" and "jitter", where there are such."""
        found = {}
        if self.missing:
            gaps = self.gaps[~self.pauses]
            found["gaps"] = (
                f"{self.missing} rows are missing in {len(gaps)} gaps of up to {np.ptp(gaps, axis=1).max():.4g} s, "
                f"the first {gaps[0, 0] - self.ticks[0]:.6g} s after the first row."
            )
        if self.pauses.any():
            gaps = self.gaps[self.pauses]
            found["pauses"] = (
                f"Nothing was recorded for up to {np.ptp(gaps, axis=1).max():.4g} s in {len(gaps)} pauses, the first "
                f"{gaps[0, 0] - self.ticks[0]:.6g} s after the first row."
            )
        if self.verdict != "even":
            share = f"{100 * self.share:.0f} ± {100 * self.share_deviation:.0f} %"
            reason = {
                "stamps": f"the positions follow the stamps ({share} of the deviations show in them): the rows were "
                "taken at uneven times",
                "even clock": f"the positions follow the even clock ({share} of the deviations show in them): the "
                "rows were taken evenly and only the stamps are unsteady",
                "unclear": "the positions do not show which is right, and it makes no visible difference",
            }[self.verdict]
            found["jitter"] = (
                f"Intervals between stamps are off an even clock of {1.0 / self.period:.6g} Hz by up to "
                f"{100 * self.largest:.3g} % of the period; {reason}."
            )
        return found

    def __repr__(self) -> str:
        return (
            f"ClockStatistics({1.0 / self.period:.6g} Hz, jitter {100 * self.jitter / self.period:.2g} % of the "
            "period, "
            f"{self.missing} rows missing, {self.verdict})"
        )

    def _repr_html_(self) -> str:
        return html_sentences(repr(self), self.sentences())


def clock_statistics(recording: Measurements) -> ClockStatistics:
    """Measure the clock of a recording from its stamps, and judge it by the positions where they are unsteady.

    Where a row was taken off an even clock by δ, its position is off the course of its neighbours by the velocity
    times δ. The share is the regression of the one on the other, both in third differences, which the motion itself
    hardly passes; joints weigh by their noise.

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
    t, q = recording.t, recording.q
    if len(t) < FEWEST_ROWS:
        raise InputError(f"{recording.source} has {len(t)} rows, too few to judge its clock by.")
    pieces = [slice(start, start + CLOCK_ROWS) for start in range(0, len(t), CLOCK_ROWS)]
    clock = clock_of(t[piece] for piece in pieces)
    return with_evidence(clock, ((t[piece], q[piece]) for piece in pieces))


def steady_clock(count: int, period: float) -> ClockStatistics:
    """Return the clock of `count` rows without stamps, a period in s apart."""
    none = np.empty(0, dtype=np.int64)
    ends = np.array([0.0, (count - 1) * period])
    return ClockStatistics(count, period, 0.0, 0.0, none, none, np.empty((0, 2)), none, ends)


def clock_of(blocks: Iterable[Array]) -> ClockStatistics:
    """Measure the clock of a log whose stamps come in blocks of `CLOCK_ROWS`, the last one shorter."""
    count = 0
    none = np.empty(0, np.int64)
    rows, skips, gaps, doubtful = [none], [none], [np.empty((0, 2))], [none]
    ticks: list[Array] = []
    periods: list[float] = []
    number, origin, guess = 0, 0.0, float("nan")
    # Of numbers n and of what the stamps are off a first guess of the line: count, n, n², r, n r, r².
    sums = np.zeros(6)
    low, high, last = np.inf, -np.inf, 0.0
    for first, t, start, stop in _windows(blocks):
        period, numbers = row_numbers(t, periods[-1] if periods else None)
        periods.append(period)
        if not count:
            origin, guess = float(t[0]), period
        steps = np.diff(t[start : stop + 1])  # the intervals that this window decides
        off = steps - guess
        if numbers[-1] - numbers[0] >= len(t):  # rows are missing somewhere
            spans = np.diff(numbers)[start:stop]
            wide = np.flatnonzero(spans > 1.0) + start
            rows.append(wide + first)
            skips.append(np.asarray(spans[wide - start] - 1.0, dtype=np.int64))
            gaps.append(np.column_stack([t[wide], t[wide + 1]]))
            found = _doubtful(t, numbers, period) + first
            doubtful.append(found[(found > first + start) & (found <= first + stop)])
            off = steps - guess * spans
        low, high = min(low, off.min(initial=np.inf)), max(high, off.max(initial=-np.inf))
        # Rows behind the intervals, and the very first one.
        begin = start + 1 if count else 0
        n = number + numbers[begin : stop + 1] - numbers[start]
        r = (t[begin : stop + 1] - origin) - guess * n
        sums += [n.size, n.sum(), _product(n, n), r.sum(), _product(n, r), _product(r, r)]
        ticks.append(t[begin + (-first - begin) % TICK : stop + 1 : TICK].copy())
        number, count, last = int(n[-1]), first + stop + 1, float(t[stop])
    size, sum_n, sum_nn, sum_r, sum_nr, sum_rr = sums
    spread = sum_nn - sum_n**2 / size
    slope = (sum_nr - sum_n * sum_r / size) / spread
    variance = (sum_rr - sum_r**2 / size - slope**2 * spread) / size
    period, typical = guess + slope, float(np.median(periods))
    if abs(period - typical) > 2e-3 * typical:
        # Where so many rows are missing that their places are lost in the jitter, the stamps still tell the period.
        period = typical
    # Differences of stamps are no better than the stamps' own resolution.
    rounding = 4.0 * np.finfo(float).eps * max(abs(origin), abs(last))
    return ClockStatistics(
        count=count,
        period=period,
        jitter=float(np.sqrt(max(variance, 0.0))),
        largest=max(float(max(high, -low)) - rounding, 0.0) / period,
        gap_rows=np.concatenate(rows),
        skipped=np.concatenate(skips),
        gaps=np.concatenate(gaps),
        doubtful=np.concatenate(doubtful),
        ticks=np.append(np.concatenate(ticks), last),
    )


def _doubtful(t: Array, numbers: Array, period: float) -> NDArray[np.int64]:
    """Find runs of rows beside missing ones whose stamps are nearer to another place of the even clock than theirs."""
    skipped = np.diff(numbers) > 1.0
    off = (t - t[0]) / period - numbers
    if np.ptp(off) < 0.5:
        return np.empty(0, dtype=np.int64)
    from scipy.ndimage import median_filter

    late = np.abs(off - median_filter(off, LOCAL, mode="nearest")) > 0.5
    edges = np.flatnonzero(np.diff(np.concatenate([[False], late, [False]]).astype(np.int8)))
    begins, ends = edges[::2], edges[1::2]
    before = np.concatenate([[0], np.cumsum(skipped), [np.count_nonzero(skipped)]])
    # From the interval before the run to the one behind it.
    beside = before[ends] > before[np.maximum(begins - 1, 0)]
    # A row in front or behind may be as late, and seem in time at the place of a missing one.
    spans = [np.arange(max(a - 2, 0), min(b + 2, len(t))) for a, b in zip(begins[beside], ends[beside], strict=True)]
    return np.unique(np.concatenate(spans)) if spans else np.empty(0, dtype=np.int64)


def _windows(blocks: Iterable[Array]) -> Iterator[tuple[int, Array, int, int]]:
    """Yield overlapping stretches of stamps: first row, stamps, and the intervals start:stop that each decides."""
    held, first, decided = np.empty(0), 0, 0
    pending: Array | None = None
    for block in blocks:
        if pending is not None:
            held = np.concatenate([held, pending])
            stop = first + len(held) - 1 - MARGIN
            if stop - decided > MARGIN:
                yield first, held, decided - first, stop - first
                decided = stop
                keep = decided - MARGIN - first
                held, first = held[keep:], first + keep
        pending = block
    if pending is not None:
        held = np.concatenate([held, pending])
        yield first, held, decided - first, len(held) - 1


def with_evidence(clock: ClockStatistics, blocks: Iterable[tuple[Array, Array]]) -> ClockStatistics:
    """Judge unsteady stamps by the positions: blocks of stamps (S,) and positions (S, N), `CLOCK_ROWS` at a time."""
    if not clock.largest > JITTER_SILENT:
        return clock
    total = np.zeros((1, 4))
    first = 0
    for t, q in blocks:
        numbers = clock.numbers(first, first + len(t)).astype(np.float64)
        total = total + _evidence(t, q, numbers - numbers[:1], clock.period)
        first += len(t)
    xx, xy, yy, size = total.T
    moving = xx > 1e-20 * np.maximum(yy, 1e-300)
    xx, xy, yy, size = (a[moving] for a in (xx, xy, yy, size))
    if not len(xx):
        return clock
    noise = np.maximum(yy - xy**2 / xx, 1e-12 * yy) / np.maximum(size, 1.0)
    noise = np.maximum(noise, 1e-300)
    weight = float(np.sum(xx / noise))
    share, deviation = float(np.sum(xy / noise)) / weight, COLOUR / np.sqrt(weight)
    return replace(clock, share=share, share_deviation=float(deviation))


def _evidence(t: Array, q: Array, numbers: Array, period: float) -> Array:
    """Return sums over rows (N, 4): xx, xy, yy and count, of travel x that stamps imply and y that positions show."""
    from scipy.ndimage import uniform_filter1d

    reach = VELOCITY_REACH
    if len(t) < 2 * LOCAL:
        return np.zeros((q.shape[1], 4))
    off = (t - t[0]) / period - numbers
    off = off - uniform_filter1d(off, LOCAL, mode="nearest")
    spans = numbers[2 * reach :] - numbers[: -2 * reach]
    speed = (q[2 * reach :] - q[: -2 * reach]) / spans[:, None]  # per row
    x = speed * off[reach:-reach, None]
    y = q[reach:-reach]
    whole = np.diff(numbers)[reach:-reach] == 1
    usable = whole[:-2] & whole[1:-1] & whole[2:]
    edge = LOCAL // 2
    usable[:edge] = usable[len(usable) - edge :] = False
    x, y = np.diff(x, n=3, axis=0)[usable], np.diff(y, n=3, axis=0)[usable]
    return np.stack([(x * x).sum(axis=0), (x * y).sum(axis=0), (y * y).sum(axis=0), np.full(q.shape[1], len(x))], -1)


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
    if len(steps) and float(steps.max()) < ALIKE * float(steps.min()):
        # Every ratio below is one, whatever the median: the same numbers in a sixth of the time.
        numbers = np.arange(len(t), dtype=np.float64)
        return _slope(t, numbers), numbers
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
    """Say whether the intervals vary independently, so that stamps stray ever further from any even clock."""
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
    """Return the period near the typical one about whose multiples the stamps gather, whatever rows are missing."""
    size = min(BLOCK, len(t))
    starts = np.unique(np.linspace(0, len(t) - size, min(MOST_BLOCKS, max(1, 2 * len(t) // size))).astype(int))
    blocks = t[starts[:, None] + np.arange(size)]
    blocks = blocks - blocks.mean(axis=1, keepdims=True)

    def gathered(period: float) -> float:
        # Single precision is a tenth of the work, and periods that differ by the least step differ more in this.
        cycles = blocks / period
        phases = (2.0 * np.pi * (cycles - np.rint(cycles))).astype(np.float32)
        return float(np.mean(np.cos(phases).mean(axis=1) ** 2 + np.sin(phases).mean(axis=1) ** 2))

    while width > FINEST:
        periods = typical * np.linspace(1.0 - width, 1.0 + width, 301 if width == COARSE else 21)
        typical = float(periods[int(np.argmax([gathered(float(period)) for period in periods]))])
        width = FINE if width == COARSE else 0.1 * width
    return typical


def _slope(t: NDArray[np.float64], numbers: NDArray[np.float64]) -> float:
    centred = numbers - numbers.mean()
    return _product(centred, t - t.mean()) / _product(centred, centred)


def _product(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    # BLAS would share it among threads that wait for each other: on a busy machine for 50 ms.
    return float(np.einsum("i,i->", one, other))


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
