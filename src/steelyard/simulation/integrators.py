"""The integration methods: fixed steps, Dormand-Prince for many runs at once, and those of SciPy."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.files import tell, without_warnings

from .compiled import DAMPING, rosenbrock, runge_kutta_4
from .events import Status
from .plant import Plant
from .watch import ABSURD_SPEED, Rows, Watch

__all__ = ["FIXED_STEP_METHODS", "LIBRARY_METHODS", "DormandPrince", "FixedStep", "Integrator", "LibraryMethod"]

Array = NDArray[np.float64]


class Integrator(ABC):
    """Integrates R runs in time.

    Parameters
    ----------
    watch : Watch
        Receives the steps, and records which runs have ended.
    state : ndarray
        (R, 2 N) at the start.

    Attributes
    ----------
    state : ndarray
        (R, 2 N) present states; runs that have ended stay at their last state.
    """

    def __init__(self, plant: Plant, watch: Watch, state: Array) -> None:
        self.plant, self.watch = plant, watch
        self.state = np.array(state, dtype=np.float64, order="C")

    @abstractmethod
    def advance(self, t: float, end: float) -> None:
        """Integrate the runs that have not ended from t to `end`, while the torques of the plant are held."""


LONG = 0.5
"""s of an interval from which its integration tells how far it has come; those between two commands are shorter."""
FIXED_STEP_METHODS = ("runge_kutta_4", "rosenbrock")


class FixedStep(Integrator):
    """Integrates with equal steps; all runs of a batch advance together.

    Where torques are held, a whole step of all runs is one call of a compiled function.

    Parameters
    ----------
    plant, watch, state
        See :class:`Integrator`.
    method : str
        One of `FIXED_STEP_METHODS`.
    step : float
        Largest step, s; `advance` divides its interval into equal steps.
    """

    def __init__(self, plant: Plant, watch: Watch, state: Array, method: str, step: float) -> None:
        super().__init__(plant, watch, state)
        self.step, self.method = step, method
        self._other = np.empty_like(self.state)
        functions = plant.functions
        self._compiled = plant.is_held and functions.fits_one_piece(method)
        self._calls: tuple[Callable[[], None], Callable[[], None]] | None = None
        if self._compiled:
            forth = plant.bound(method, self.state, plant.held, self._other)
            back = plant.bound(method, self._other, plant.held, self.state)
            self._calls = (forth, back)
            self._partial = (np.empty_like(self.state), np.empty_like(self.state))
            self._between = plant.bound(method, self._partial[0], plant.held, self._partial[1])
        elif method == "rosenbrock":
            n = plant.count
            self._place = (np.empty_like(self.state), np.empty((plant.runs, n)), np.empty((plant.runs, n + n * n)))
            self._damp = plant.bound("damped", *self._place)

    def advance(self, t: float, end: float) -> None:
        """Make the steps from t to `end`."""
        count = max(1, math.ceil((end - t) / self.step - 1e-9))
        step = (end - t) / count
        watch, every = self.watch, self.watch.every_step
        for k in range(count):
            begin = t + k * step
            if self._calls is not None:
                self.plant.step[0] = step
                self._calls[0]()
                self._calls = self._calls[::-1]
                following = self._other
            else:
                following = self._made(begin, step, self.state)
            values = following.ravel()
            if not values.dot(values) < ABSURD_SPEED**2:  # cheaper than checking every element
                self._diverged(begin, step, following)
            previous, self.state, self._other = self.state, following, self.state
            if every:
                self._show(begin, end if k == count - 1 else t + (k + 1) * step, previous)
            if self.plant.bristles is not None:
                self.plant.bristles.step_made(self.state)
            if watch.some_ended:
                self.state[watch.ended] = watch.final[watch.ended]
                if watch.all_ended:
                    return

    def _made(self, t: float, step: float, state: Array) -> Array:
        """Compute a step with torques that change within it."""
        plant, n = self.plant, self.plant.count

        def acceleration(fraction: float, q: Array, dq: Array) -> Array:
            return plant.acceleration(t + fraction * step, np.concatenate([q, dq], axis=1))

        def damped(q: Array, dq: Array, factor: float) -> tuple[Array, Callable[[Array], Array]]:
            place, torque, out = self._place
            place[:, :n], place[:, n:] = q, dq
            torque[...] = plant.forces(t, place)
            plant.step[0] = factor / DAMPING
            self._damp()
            matrix = out[:, n:].reshape(-1, n, n).copy()
            return out[:, :n].copy(), lambda x: (matrix @ x[..., np.newaxis])[..., 0]

        q, dq = state[:, :n], state[:, n:]
        if self.method == "rosenbrock":
            return np.concatenate(rosenbrock(damped, acceleration, q, dq, step), axis=1)
        return np.concatenate(runge_kutta_4(acceleration, q, dq, step), axis=1)

    def _show(self, begin: float, end: float, previous: Array) -> None:
        """Pass the step to the watch; a state within the step is that of a shorter step."""
        start = previous.copy()

        def interpolate(which: Rows, t: Array) -> Array:
            result = np.empty((len(which), start.shape[1]))
            for k, (place, time) in enumerate(zip(which, t, strict=True)):
                row = rows[place]
                if time == end:
                    result[k] = stop[place]
                elif time == begin:
                    result[k] = start[row]
                elif self._calls is not None:
                    self._partial[0][...] = start
                    self.plant.step[0] = time - begin
                    self._between()
                    result[k] = self._partial[1][row]
                else:
                    result[k] = self._made(begin, time - begin, start)[row]
            return result

        rows = np.flatnonzero(~self.watch.ended)
        if not len(rows):  # the only run has just diverged
            return
        stop = self.state[rows]
        times = np.full(len(rows), begin), np.full(len(rows), end)
        self.watch.piece(rows, *times, stop, interpolate)

    def _diverged(self, t: float, step: float, state: Array) -> None:
        """End the runs whose state is not finite, or too fast, after a step from t; the others go on."""
        for run in np.flatnonzero(~np.isfinite(state).all(axis=1) & ~self.watch.ended):
            self.watch.end(
                int(run), Status.DIVERGED, t, f"the motion is not finite after {t:.6g} s", self.state[run].copy()
            )
        going = np.flatnonzero(~self.watch.ended)
        self.watch.runaway.speed(going, np.full(len(going), t + step), state[going])
        state[self.watch.ended] = self.watch.final[self.watch.ended]


# Dormand and Prince 1980, J. Comput. Appl. Math. 6(1), table 2: nodes, stages, and the last row minus the embedded one.
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
# The continuous extension of order 4 (Hairer, Nørsett and Wanner 1993, section II.6): coefficients of the term that is
# added to the cubic.
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
# The step-size control of Hairer, Nørsett and Wanner 1993, section II.4, with the factors of SciPy.
_SAFETY, _SMALLEST, _LARGEST = 0.9, 0.2, 10.0
# The smallest step relative to the time. With smaller ones the time itself would hardly change, because of rounding.
CLOCK = 16.0 * np.finfo(np.float64).eps


class DormandPrince(Integrator):
    """The method of Dormand and Prince of order 5 for many runs at once, each with its own adaptive step size.

    Parameters
    ----------
    plant, watch, state
        See :class:`Integrator`.
    relative, absolute : float
        Relative and absolute tolerance of the local error of positions and velocities.
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
                if end - t > LONG:
                    tell("simulating", float(time.min()), end, "s")
                rows, time, y, slope, step = self._attempt(rows, time, y, slope, step, end)

    def _attempt(
        self, rows: Rows, time: Array, y: Array, slope: Array, step: Array, end: float
    ) -> tuple[Rows, Array, Array, Array, Array]:
        """Try a step of every run that has not reached `end`; return the runs that still have not, and their states."""
        left = end - time
        last = step * 1.0000001 >= left  # avoids a tiny last step
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
        # A step that was shortened to end at `end` is no reason for a smaller next step.
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
    """The interpolated states within one step of some runs."""

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


LIBRARY_METHODS = {"dop853": "DOP853", "radau": "Radau", "bdf": "BDF", "lsoda": "LSODA"}


class LibraryMethod(Integrator):
    """Integrates each run by itself with a method of SciPy.

    DOP853 is for tight tolerances; Radau, BDF and LSODA are for stiff friction.

    Parameters
    ----------
    plant, watch, state
        See :class:`Integrator`.
    method : str
        One of `LIBRARY_METHODS`.
    relative, absolute : float
        Relative and absolute tolerance of the local error.
    """

    def __init__(self, plant: Plant, watch: Watch, state: Array, method: str, relative: float, absolute: float) -> None:
        super().__init__(plant, watch, state)
        import scipy.integrate

        self._solver = getattr(scipy.integrate, LIBRARY_METHODS[method])
        self._options: dict[str, Any] = {
            "rtol": max(relative, 2.3e-14),  # SciPy warns of smaller ones
            "atol": absolute,
        }
        self._exact = method in ("radau", "bdf", "lsoda") and plant.is_held
        self._step: list[float | None] = [None] * plant.runs

    def advance(self, t: float, end: float) -> None:
        """Make the steps from t to `end`, run by run."""
        for run in np.flatnonzero(~self.watch.ended):
            self._run(int(run), t, end)
        self.state[self.watch.ended] = self.watch.final[self.watch.ended]

    def _run(self, run: int, t: float, end: float) -> None:
        rows = np.array([run])
        subset = None if self.plant.runs == 1 else rows
        n, plant = self.plant.count, self.plant
        slope = np.empty(2 * n)

        def function(time: float, y: Array) -> Array:
            slope[:n] = y[n:]
            slope[n:] = plant.acceleration(time, y[np.newaxis], subset)[0]
            return slope.copy()

        options = dict(self._options)
        if self._exact:
            options["jac"] = lambda time, y: plant.jacobian(run, y)
        first = self._step[run]
        if first is not None:
            options["first_step"] = min(first, end - t)
        state, time = self.state[run].copy(), t
        with np.errstate(all="ignore"), without_warnings:  # LSODA warns of failures that its status reports
            try:
                if not np.isfinite(function(t, state)).all():
                    raise FloatingPointError
                solver = self._solver(function, t, state, end, **options)
                while solver.status == "running":
                    solver.step()
                    if end - t > LONG:
                        tell("simulating", solver.t, end, "s")
                    stuck = solver.t - time < CLOCK * max(abs(time), 1e-3)  # LSODA would go on for hours
                    if solver.status == "failed" or stuck or not np.isfinite(solver.y).all():
                        raise FloatingPointError
                    self._show(rows, time, solver)
                    state, time = solver.y.copy(), float(solver.t)
                    self.watch.runaway.check(rows, np.array([time]), state[np.newaxis])
                    if self.watch.ended[run]:
                        return
                    if solver.step_size is not None and solver.status == "running":
                        self._step[run] = float(solver.step_size)
            except (FloatingPointError, ValueError, np.linalg.LinAlgError):
                text = f"the solver could not go beyond {time:.6g} s"
                self.watch.end(run, Status.DIVERGED, time, text, state)
                return
        self.state[run] = state

    def _show(self, rows: Rows, begin: float, solver: Any) -> None:
        if not self.watch.every_step or not solver.t > begin:
            return
        dense = solver.dense_output()

        def interpolate(which: Rows, t: Array) -> Array:
            return np.atleast_2d(dense(t).T)

        stop = solver.y[np.newaxis].copy()
        if math.isfinite(stop.sum()):
            self.watch.piece(rows, np.array([begin]), np.array([float(solver.t)]), stop, interpolate)
