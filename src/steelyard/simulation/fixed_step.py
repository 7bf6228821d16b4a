"""The fixed-step methods: all the runs of a batch advance together."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .integrator import Integrator
from .plant import Plant
from .runaway import ABSURD_SPEED
from .status import Status
from .steps import DAMPING, rosenbrock, runge_kutta_4
from .watch import Rows, Watch

__all__ = ["FIXED_STEP_METHODS", "FixedStep"]

Array = NDArray[np.float64]
FIXED_STEP_METHODS = ("runge_kutta_4", "rosenbrock")


class FixedStep(Integrator):
    """Makes steps of one size.

    Where torques are held, a whole step of all the runs is one call of a compiled function.

    Parameters
    ----------
    plant, watch, state
        See :class:`Integrator`.
    method : str
        Of `FIXED_STEP_METHODS`.
    step : float
        Largest step, s; what `advance` covers is divided into equal ones.
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
            if not abs(following.sum()) < ABSURD_SPEED:  # cheaper than to look at each of them
                self._diverged(begin, step, following)
            previous, self.state, self._other = self.state, following, self.state
            if every:
                self._show(begin, end if k == count - 1 else t + (k + 1) * step, previous)
            if watch.ended.any():
                self.state[watch.ended] = watch.final[watch.ended]
                if watch.ended.all():
                    return

    def _made(self, t: float, step: float, state: Array) -> Array:
        """Make a step with torques that change within it."""
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
        """Show the step to the watch; between its ends a state is that of a shorter step."""
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
        stop = self.state[rows]
        times = np.full(len(rows), begin), np.full(len(rows), end)
        self.watch.piece(rows, *times, stop, interpolate)

    def _diverged(self, t: float, step: float, state: Array) -> None:
        """End the runs whose values are not finite, or absurd, after a step from t; the others go on."""
        for run in np.flatnonzero(~np.isfinite(state).all(axis=1) & ~self.watch.ended):
            self.watch.end(
                int(run), Status.DIVERGED, t, f"the motion is not finite after {t:.6g} s", self.state[run].copy()
            )
        going = np.flatnonzero(~self.watch.ended)
        self.watch.runaway.speed(going, np.full(len(going), t + step), state[going])
        state[self.watch.ended] = self.watch.final[self.watch.ended]
