"""Dormand-Prince 4(5) for many runs at once, each with steps of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .integrator import Integrator
from .plant import Plant
from .status import Status
from .watch import Rows, Watch

__all__ = ["CLOCK", "DormandPrince"]

Array = NDArray[np.float64]

# Dormand and Prince 1980, J. Comput. Appl. Math. 6(1), table 2: nodes, stages, and the last row less the embedded one.
_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_A = [
    np.array(row)
    for row in (
        (1 / 5,),
        (3 / 40, 9 / 40),
        (44 / 45, -56 / 15, 32 / 9),
        (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
        (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
    )
]
_E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
# The continuous extension of order 4 (Hairer, Nørsett and Wanner 1993, section II.6): what is added to the cubic.
_D = np.array(
    [
        -12715105075 / 11282082432,
        0.0,
        87487479700 / 32700410799,
        -10690763975 / 1880347072,
        701980252875 / 199316789632,
        -1453857185 / 822651844,
        69997945 / 29380423,
    ]
)
_SAFETY, _SMALLEST, _LARGEST = 0.9, 0.2, 10.0
CLOCK = 16.0 * np.finfo(np.float64).eps  # the step, relative to the time, below which the clock stands still


class DormandPrince(Integrator):
    """Makes steps of the size that the tolerance allows, for each run its own.

    Parameters
    ----------
    plant, watch, state
        See :class:`Integrator`.
    relative, absolute : float
        Tolerances of the local error of positions and velocities.
    """

    def __init__(self, plant: Plant, watch: Watch, state: Array, relative: float, absolute: float) -> None:
        super().__init__(plant, watch, state)
        self._relative, self._absolute = relative, absolute
        self._step = np.full(plant.runs, np.nan)

    def advance(self, t: float, end: float) -> None:
        """Make the steps from t to `end`."""
        rows = np.flatnonzero(~self.watch.ended)
        time = np.full(len(rows), t)
        y = self.state[rows]
        slope = self._slope(time, y, rows)
        unknown = np.isnan(self._step[rows])
        if unknown.any():
            self._step[rows] = np.where(unknown, self._first_step(time, y, slope, rows, end), self._step[rows])
        step = self._step[rows]
        with np.errstate(all="ignore"):  # a run that diverges passes through infinity
            while rows.size:
                rows, time, y, slope, step = self._attempt(rows, time, y, slope, step, end)

    def _attempt(
        self, rows: Rows, time: Array, y: Array, slope: Array, step: Array, end: float
    ) -> tuple[Rows, Array, Array, Array, Array]:
        """Try a step of every run that is on its way; return those that still are."""
        left = end - time
        last = step * 1.0000001 >= left  # no sliver of a step is left over
        h = np.where(last, left, step)[:, np.newaxis]
        now = time[:, np.newaxis]
        stages = np.empty((7, *y.shape))
        stages[0] = slope
        for k in range(1, 7):
            following = y + h * _sum(_A[k - 1], stages[:k])
            stages[k] = self._slope((now + _C[k] * h)[:, 0], following, rows)
        scale = self._absolute + self._relative * np.maximum(np.abs(y), np.abs(following))
        error = np.sqrt(np.mean((h * _sum(_E, stages) / scale) ** 2, axis=1))
        good = (error <= 1.0) & np.isfinite(following).all(axis=1) & np.isfinite(stages[6]).all(axis=1)
        factor = np.clip(_SAFETY * np.maximum(error, 1e-10) ** -0.2, _SMALLEST, _LARGEST)
        factor = np.where(good, factor, np.where(np.isfinite(error), np.minimum(factor, 1.0), _SMALLEST))
        proposed = h[:, 0] * factor
        if good.any():
            reached = np.where(last, end, time + h[:, 0])
            which = slice(None) if good.all() else np.flatnonzero(good)
            if self.watch.every_step:
                interpolate = _Extension(time[which], y[which], following[which], h[which], stages[:, which])
                self.watch.piece(rows[which], time[which], reached[which], following[which], interpolate)
            time, y, slope = time.copy(), y.copy(), slope.copy()
            time[which], y[which], slope[which] = reached[which], following[which], stages[6][which]
        self.watch.runaway.check(rows, time, y)
        # A step that was cut by the end says nothing against a longer one.
        step = np.where(good & last, np.maximum(step, proposed), proposed)
        stuck = ~good & (proposed < CLOCK * np.maximum(np.abs(time), 1e-3))
        for k in np.flatnonzero(stuck).tolist():
            text = f"the step size reached the limit of the clock at {time[k]:.6g} s"
            self.watch.end(int(rows[k]), Status.DIVERGED, float(time[k]), text, y[k])
        self._step[rows] = step
        going = ~self.watch.ended[rows] & ~(good & last)
        if going.all():
            return rows, time, y, slope, step
        self.state[rows] = y
        self.state[self.watch.ended] = self.watch.final[self.watch.ended]
        return rows[going], time[going], y[going], slope[going], step[going]

    def _slope(self, t: Array, y: Array, rows: Rows) -> Array:
        n = self.plant.count
        subset = None if len(rows) == self.plant.runs else rows
        return np.concatenate([y[:, n:], self.plant.acceleration(t[:, np.newaxis], y, subset)], axis=1)

    def _first_step(self, t: Array, y: Array, slope: Array, rows: Rows, end: float) -> Array:
        """Guess a step from the first two derivatives (Hairer, Nørsett and Wanner 1993, section II.4)."""
        scale = self._absolute + self._relative * np.abs(y)
        with np.errstate(all="ignore"):
            d0, d1 = (np.sqrt(np.mean((x / scale) ** 2, axis=1)) for x in (y, slope))
            first = np.where((d0 < 1e-5) | (d1 < 1e-5), 1e-6, 0.01 * d0 / d1)
            ahead = self._slope(t + first, y + first[:, np.newaxis] * slope, rows)
            d2 = np.sqrt(np.mean(((ahead - slope) / scale) ** 2, axis=1)) / first
            most = np.maximum(d1, d2)
            second = np.where(most <= 1e-15, np.maximum(1e-6, first * 1e-3), (0.01 / most) ** 0.2)
            guess = np.minimum(100.0 * first, second)
        return np.where(np.isfinite(guess) & (guess > 0.0), np.minimum(guess, end - t), 1e-9)


def _sum(weights: Array, stages: Array) -> Array:
    """Return the weighted sum of stages."""
    total: Array = (weights @ stages.reshape(len(stages), -1)).reshape(stages.shape[1:])
    return total


class _Extension:
    """The states within one step of some runs."""

    def __init__(self, t: Array, start: Array, stop: Array, step: Array, stages: Array) -> None:
        self._t, self._step = t, step
        change = stop - start
        rest = step * stages[0] - change
        self._terms = (start, change, rest, change - step * stages[6] - rest, step * _sum(_D, stages))

    def __call__(self, which: Rows, t: Array) -> Array:
        s = ((t - self._t[which])[:, np.newaxis]) / self._step[which]
        r1, r2, r3, r4, r5 = (term[which] for term in self._terms)
        result: Array = r1 + s * (r2 + (1.0 - s) * (r3 + s * (r4 + (1.0 - s) * r5)))
        return result
