"""The methods of SciPy: DOP853 for tight tolerances, Radau, BDF and LSODA for stiff friction."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .dormand_prince import CLOCK
from .integrator import Integrator
from .plant import Plant
from .status import Status
from .watch import Rows, Watch

__all__ = ["LIBRARY_METHODS", "LibraryMethod"]

Array = NDArray[np.float64]
LIBRARY_METHODS = {"dop853": "DOP853", "radau": "Radau", "bdf": "BDF", "lsoda": "LSODA"}


class LibraryMethod(Integrator):
    """Runs a solver of SciPy on each run by itself.

    Parameters
    ----------
    plant, watch, state
        See :class:`Integrator`.
    method : str
        Of `LIBRARY_METHODS`.
    relative, absolute : float
        Tolerances of the local error.
    """

    def __init__(self, plant: Plant, watch: Watch, state: Array, method: str, relative: float, absolute: float) -> None:
        super().__init__(plant, watch, state)
        import scipy.integrate

        self._solver = getattr(scipy.integrate, LIBRARY_METHODS[method])
        self._options: dict[str, Any] = {"rtol": max(relative, 2.3e-14), "atol": absolute}
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
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # LSODA warns of what its status says
            try:
                if not np.isfinite(function(t, state)).all():
                    raise FloatingPointError
                solver = self._solver(function, t, state, end, **options)
                while solver.status == "running":
                    solver.step()
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
