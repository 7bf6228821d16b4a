"""What a model misses returns with each period of a motion, so that further periods tell less than rows of noise do.

Batches are a second or two long, and know nothing of errors that return after a period: those of friction that go with
the position, of gears, and of encoders whose steps a controller answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.display import few_digits

from .batch_means import BATCH_LENGTHS, LONG, summed
from .factor import Factor

__all__ = ["MotionSums", "ReturningErrors", "added_returning", "returning_errors", "sentence_of_returning"]

Array = NDArray[np.float64]
AWAY = 0.5
"""Mean square of the difference of positions that lie a lag apart, over that of unrelated ones, beyond which a joint
has moved away, and may come back."""
ALIKE, MOSTLY = 0.05, 0.5
"""Standard deviations of its positions within which each joint must be where it was, and part of the rows of which this
holds: a motion may begin with a ramp."""
LATEST = 0.875
"""Part of a stretch up to which its period is looked for; the rest is compared."""
COARSE = 4096
"""Rows, about, by which the period is looked for before it is told to the row."""
SUMS = 64
"""Sums in a period, of which correlations are taken: what is slower moves parameters, and what is faster averages
out."""
COMPARED = 500
"""Rows, at most about twice as many, of which the median tells the period to the row."""
PARTS = 16
"""Parts whose scatter is the standard error of a correlation."""
SURE = 3.0
"""Standard errors from which a correlation counts."""
HELD, LONGEST = 2_000_000, 2**17
"""Numbers of rows that are kept until the end, and samples from which on none is: two minutes at 1 kHz."""
FEWEST_SUMS = 4
"""Sums of combined rows of which a correlation is taken."""
SAME_PERIOD, SAME_MOTION = 0.002, 0.02
"""Part of their periods, and of the standard deviations of their positions, up to which two motions differ that are
one: of the robot and its clock, from day to day."""


@dataclass(frozen=True, eq=False)
class ReturningErrors:
    """Errors that return with each period of one motion.

    Attributes
    ----------
    period : float
        s.
    periods : float
        How many of them there are.
    positions : ndarray
        (2, N): mean and standard deviation of each joint's position, by which the motion is told from others.
    correlation : ndarray
        (N,) of what is left of each joint's torques, from one period to the next; 0 where it does not surely return.
    alike : float
        Part of the rows at which the robot is where it was.
    counts : ndarray of int
        (N,) rows of each joint.
    """

    period: float
    periods: float
    positions: Array
    correlation: Array
    alike: float
    counts: NDArray[np.intp]

    @property
    def raised(self) -> Array:
        """(N,): by how much of itself the variance of the mean of these rows is larger than that of noise.

        With p periods ``ρ (1 - 1/p + 1 - 2/p + ...) 2``, which is ``(p - 1) ρ`` for a whole number of them.
        """
        later = np.arange(1.0, np.ceil(self.periods))
        return np.asarray(2.0 * self.alike * self.correlation * np.sum(1.0 - later / self.periods))

    def is_of(self, other: ReturningErrors) -> bool:
        """Whether both are of one motion."""
        if self.positions.shape != other.positions.shape:
            return False
        size = np.maximum(self.positions[1], other.positions[1])
        return bool(
            abs(self.period - other.period) <= SAME_PERIOD * self.period
            and np.all(np.abs(self.positions - other.positions) <= SAME_MOTION * size)
        )

    def with_more(self, other: ReturningErrors) -> ReturningErrors:
        """Return the errors of the periods of both, of one motion."""
        periods = self.periods + other.periods
        share = other.periods / periods
        return replace(
            self,
            periods=periods,
            correlation=(1.0 - share) * self.correlation + share * other.correlation,
            alike=(1.0 - share) * self.alike + share * other.alike,
            counts=self.counts + other.counts,
        )

    def over(self, counts: Sequence[int]) -> ReturningErrors:
        """Return the errors of more rows of the same motion, so many of each joint."""
        given = np.array(counts)
        return replace(self, periods=self.periods * given.sum() / max(self.counts.sum(), 1), counts=given)


def added_returning(first: Sequence[ReturningErrors], second: Sequence[ReturningErrors]) -> tuple[ReturningErrors, ...]:
    """Return the errors of both data sets: periods of one motion add up, those of different motions are independent."""
    found = list(first)
    for one in second:
        place = next((k for k, other in enumerate(found) if other.is_of(one)), None)
        if place is None:
            found.append(one)
        else:
            found[place] = found[place].with_more(one)
    return tuple(found)


def sentence_of_returning(returning: Sequence[ReturningErrors], joint_names: Sequence[str]) -> str:
    """Say what makes intervals wider."""
    first = min(returning, key=lambda one: one.period)
    correlation = np.max([one.correlation for one in returning], axis=0)
    most = int(np.argmax(correlation))
    return (
        f"Intervals are wider than noise asks for: the motion repeats every {few_digits(first.period, 3)} s, and "
        f"what is left of the torques returns with it ({joint_names[most]}: a correlation of "
        f"{few_digits(float(correlation[most]), 2)}), so that its periods are not independent. Record motions "
        "that do not repeat."
    )


class MotionSums:
    """Keeps the positions, and the sums of neighbouring rows ``[W omega]``, of the begin of some data.

    So they stand in bounded memory, for base parameters that are known at the end.
    """

    def __init__(self) -> None:
        self._t: list[Array] = []
        self._q: list[Array] = []
        self._sums: list[list[Array]] = []
        self._every, self._size = 1, 1  # samples from one position to the next, and in a sum
        self._seen, self._counts = 0, np.zeros(0, dtype=int)

    def add(self, t: Array | None, q: Array, rows: Sequence[Array], mask: NDArray[np.bool_] | None) -> None:
        """Add samples that follow; each call but the last brings a multiple of 1024."""
        used = [None if mask is None else mask[:, k] for k in range(len(rows))]
        if self._takes(t, q, [len(q) if one is None else int(one.sum()) for one in used]):
            self._add([summed(own, self._size, one) for own, one in zip(rows, used, strict=True)])

    def add_combined(self, t: Array | None, q: Array, sums: Sequence[Array], counts: Sequence[int]) -> None:
        """Add samples of which the sums over 64 of each joint are known, and how many rows of it these are."""
        if self._size < LONG and self._sums:
            found = self._period()
            if found is not None and 2 * found[0] <= sum(map(len, self._t)):
                self._seen = LONGEST  # two periods of single rows tell more than many of sums
        if self._takes(t, q, counts):
            while self._size < LONG:
                self._coarser()
            self._add([summed(own, self._size // LONG) for own in sums])

    def _takes(self, t: Array | None, q: Array, counts: Sequence[int]) -> bool:
        """Take times and positions of samples, unless they have no times, or enough were seen."""
        if t is None or self._seen >= LONGEST:
            return False
        self._seen += len(q)
        self._counts = np.array(counts) + (self._counts if self._counts.size else 0)
        self._t.append(t[:: self._every])
        self._q.append(q[:: self._every])
        while sum(map(len, self._t)) > 4 * COARSE and self._every < BATCH_LENGTHS[-1]:
            self._every *= 2
            self._t, self._q = ([np.concatenate(own)[::2]] for own in (self._t, self._q))
        return True

    def _add(self, sums: list[Array]) -> None:
        self._sums.append(sums)
        while self._size < BATCH_LENGTHS[-1] and sum(own.size for part in self._sums for own in part) > HELD:
            self._coarser()

    def _coarser(self) -> None:
        self._size *= 2
        if self._sums:
            self._sums = [[summed(np.concatenate(own), 2) for own in zip(*self._sums, strict=True)]]

    def repeats(self) -> bool:
        """Whether the motion does."""
        return bool(self._t) and self._period() is not None

    def _period(self) -> tuple[int, float, NDArray[np.bool_]] | None:
        return _period([np.concatenate(self._t)], [np.concatenate(self._q)])

    def returning(self, factors: Sequence[Factor], base: Array) -> ReturningErrors | None:
        """Tell what returns of what some base parameters leave, in all the data, whose factors these are."""
        left = [
            np.concatenate([own[:, -1] - own[:, :-1] @ base[factor.columns] for own in parts])
            for factor, parts in zip(factors, zip(*self._sums, strict=True), strict=True)
        ]
        t, q = np.concatenate(self._t), np.concatenate(self._q)
        # A sum is spread evenly over its samples where positions are told more often.
        ends, asked = self._size * np.arange(len(left[0]) + 1), self._every * np.arange(len(q) + 1)
        parts = [np.diff(np.interp(asked, ends, np.concatenate([[0.0], np.cumsum(own)]))) for own in left]
        # A period is seldom a whole number of such sums: of one alone half would be compared with its neighbour.
        shortest = 1 if self._size <= self._every else FEWEST_SUMS * self._size // self._every
        found = returning_errors([(t, q, np.column_stack(parts))], self._counts, shortest)
        return None if found is None else found.over([f.count for f in factors])


def returning_errors(
    stretches: Sequence[tuple[Array, Array, Array]], counts: Sequence[int] | NDArray[np.intp], shortest: int = 1
) -> ReturningErrors | None:
    """Tell what returns with a motion, of one stretch after the other: time, positions (S, N), what is left (S, N).

    None where the motion does not repeat, or nothing surely returns with it. `counts` are the rows of each joint;
    correlations are those of sums of so many rows of the stretches as are the `shortest` at least.
    """
    found = _period([t for t, _, _ in stretches], [q for _, q, _ in stretches])
    if found is None:
        return None
    lag, step, alike = found
    q, left = (np.concatenate([own[k] for own in stretches]) for k in (1, 2))
    count = max(round(lag / SUMS), shortest)
    sums = np.cumsum(np.concatenate([np.zeros((1, left.shape[1])), np.nan_to_num(left)]), axis=0)
    sums = sums[count:] - sums[:-count]
    first, second = sums[:-lag], sums[lag:]
    both = alike[: len(first), np.newaxis]
    cuts = np.linspace(0, len(first), PARTS, endpoint=False).astype(int)
    product = np.add.reduceat(both * first * second, cuts)
    square = np.add.reduceat(both * 0.5 * (first**2 + second**2), cuts)
    whole = np.maximum(square.sum(axis=0), 1e-300)
    correlation = product.sum(axis=0) / whole
    error = np.sqrt(np.sum((product - correlation * square) ** 2, axis=0)) / whole
    correlation = np.where(correlation > SURE * error, correlation, 0.0)
    if not correlation.any():
        return None
    periods = len(q) / lag
    last = q[-int(periods) * lag :]
    positions = np.array([last.mean(axis=0), last.std(axis=0)])
    return ReturningErrors(lag * step, periods, positions, correlation, float(np.mean(alike)), np.array(counts))


def _period(t: Sequence[Array], q: Sequence[Array]) -> tuple[int, float, NDArray[np.bool_]] | None:
    """Return the rows after which a motion repeats, the time between two rows, and which rows are alike one later.

    None where the motion, of one stretch after the other, does not repeat.
    """
    steps = np.concatenate([np.diff(own) for own in t])
    if not len(steps) or np.ptp(steps) > 0.01 * np.median(steps):
        return None
    positions = np.concatenate(q)
    moved = positions[:, np.ptp(positions, axis=0) > 0.0]
    lag = _lag(moved)
    if lag is None:
        return None
    alike = np.all(np.abs(moved[lag:] - moved[:-lag]) < ALIKE * np.std(moved, axis=0), axis=1)
    return None if np.mean(alike) < MOSTLY else (lag, float(np.mean(steps)), alike)


def _lag(q: Array) -> int | None:
    """The rows (S, N) after which positions first return; None where they do not."""
    if not q.size:
        return None
    x = (q - q.mean(axis=0)) / np.std(q, axis=0)
    count, every = len(x), max(len(x) // COARSE, 1)
    few = x[::every]
    size = 1 << (2 * len(few)).bit_length()
    products = np.fft.irfft(np.sum(np.abs(np.fft.rfft(few, size, axis=0)) ** 2, axis=1), size)[: len(few)]
    squares = np.concatenate([[0.0], np.cumsum(np.sum(few**2, axis=1))])
    both = squares[:0:-1] + squares[-1] - squares[:-1]  # of the rows before, and of those after a lag
    apart = 1.0 - 2.0 * products / np.maximum(both, 1e-300)
    apart = apart[: int(LATEST * len(few))]
    away = np.flatnonzero(apart > AWAY)
    if not len(away):
        return None
    after = apart[away[0] :]
    near = np.flatnonzero(after < 2.0 * max(float(after.min()), 1e-3))
    # The first group of lags that are as near as the nearest, and the nearest of these for most rows: ramps are none.
    group = near[: 1 + int(np.flatnonzero(np.append(np.diff(near) > 1, True))[0])]

    def nearest(lag: int, reach: int, step: int) -> int:
        lags = np.arange(max(lag - reach, 1), min(lag + reach, count - 1) + 1, step)
        rows = np.arange(0, count - lags[-1], max((count - lags[-1]) // COMPARED, 1))
        return int(lags[np.argmin([np.median(np.sum((x[rows + k] - x[rows]) ** 2, axis=1)) for k in lags])])

    lag = every * int(away[0] + group[np.argmin(after[group])])
    return nearest(nearest(lag, lag // SUMS, every), every, 1)
