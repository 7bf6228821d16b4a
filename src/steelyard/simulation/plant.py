"""The simulated robots: their torques, accelerations and energies, computed by compiled code."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from steelyard.graph import Kernel
from steelyard.recording.samples import is_finite

from .bristle_friction import BristleFriction
from .compiled import MotionFunctions
from .contact import Contact
from .controller import checked_torque

__all__ = ["Plant", "TorqueFunction"]

Array = NDArray[np.float64]
TorqueFunction = Callable[[Array, Array, Array], Array]
# Width (rad/s) of the smooth sign whose secant `rosenbrock` uses where the sign itself is exact. It must not be 0,
# because the secant 1 / sqrt(v² + w²) is infinite at rest.
_SMALLEST_WIDTH = 1e-12


class Plant:
    """R robots of one model with the torques that act on them.

    Parameters
    ----------
    parameters : ndarray
        (n,), or (R, n) with the parameters of each run.
    sign_width : float
        Width of the smooth sign of Coulomb friction, rad/s; 0 for the exact sign.
    runs : int
        Number R of runs.
    torque : callable, optional
        A function of t (R, 1), q and dq (R, N) that returns the torques of all runs (R, N); by default the torques
        `held` act.
    contact : Contact, optional
        Contact with the environment.
    bristles : BristleFriction, optional
        Friction that remembers the motion.

    Attributes
    ----------
    held : ndarray
        (R, N) torques of the actuators, which act until they are set again.
    """

    def __init__(
        self,
        functions: MotionFunctions,
        parameters: Array,
        sign_width: float,
        runs: int,
        torque: TorqueFunction | None = None,
        contact: Contact | None = None,
        bristles: BristleFriction | None = None,
    ) -> None:
        self.functions = functions
        self.count, self.runs = functions.count, runs
        self.parameters = np.ascontiguousarray(parameters, dtype=np.float64)
        self.width = np.array([max(sign_width, _SMALLEST_WIDTH)])
        self.step = np.zeros(1)
        self.held = np.zeros((runs, self.count))
        self.torque = torque
        self.contact = contact
        self.bristles = bristles
        self._state = np.zeros((runs, 2 * self.count))
        self._torque = np.zeros((runs, self.count))
        self._out = np.zeros((runs, self.count))
        self._accelerate = self.bound("acceleration", self._state, self._torque, self._out)
        self._all = np.zeros((runs, 2 * self.count))
        self._unknown: dict[int, tuple[float, int, float]] = {}

    @property
    def is_held(self) -> bool:
        """Whether the torques do not change between two settings of `held`."""
        return self.torque is None and self.contact is None and self.bristles is None

    def bound(self, name: str, state: Array, torque: Array, out: Array) -> Callable[[], None]:
        """Return a compiled function that reads and writes the memory of these arrays, which must not be replaced."""
        return self.functions.kernel(name).bound(state, torque, self.parameters, self.width, self.step, out)

    def forces(self, t: Array | float, state: Array, rows: NDArray[np.intp] | None = None) -> Array:
        """Return the torques (m, N) of actuators and environment at states (m, 2 N) of all the runs, or of `rows`."""
        if self.is_held:
            return self.held if rows is None else self.held[rows]
        n = self.count
        torque: Array
        if self.torque is None:
            torque = self.held if rows is None else self.held[rows]
        elif rows is None:
            torque = self.called(self.torque, t, state)
        else:  # the function expects all runs, also those that have ended
            self._all[rows] = state
            times = np.zeros((self.runs, 1))
            times[rows] = t
            torque = self.called(self.torque, times, self._all)[rows]
        if self.contact is not None:
            torque = torque + self.contact.torque(t, state[:, :n], state[:, n:])
        if self.bristles is not None:
            which = slice(None) if rows is None else rows
            torque = torque - self.bristles.torques(self.bristles.at(state, which), state[:, n:], which)
        return torque

    def called(self, function: TorqueFunction, t: Array | float, state: Array) -> Array:
        """Call a user's torque function with copies of the state, and check what it returns."""
        q, dq = state[:, : self.count].copy(), state[:, self.count :].copy()
        if self.runs == 1:
            time = np.asarray(t, dtype=np.float64).reshape(-1)[0]
            torque = checked_torque(function(time, q[0], dq[0]), (self.count,))[np.newaxis]
        else:
            torque = checked_torque(function(np.broadcast_to(t, (self.runs, 1)), q, dq), (self.runs, self.count))
        self.notice(t, state, torque)
        return torque

    def notice(self, t: Array | float, state: Array, torque: Array) -> None:
        """Remember torques (R, N) that are not finite at a finite state, for the message with which a run ends."""
        if is_finite(torque):
            return
        times = np.broadcast_to(t, (self.runs, 1))
        wrong = ~np.isfinite(torque)
        for run in np.flatnonzero(wrong.any(axis=1) & np.isfinite(state).all(axis=1)).tolist():
            joint = int(np.argmax(wrong[run]))
            self._unknown[run] = float(times[run, 0]), joint, float(torque[run, joint])

    def unknown_torque(self, run: int, t: float) -> str:
        """Return a sentence part about the last torque of a run that was not finite, if it came at time t or later."""
        time, joint, value = self._unknown.get(run, (-1.0, 0, 0.0))
        if time < t:
            return ""
        name = self.functions.model.robot.joint_names[joint]
        return f"; torque returned {'NaN' if math.isnan(value) else value} for joint {name!r} at {time:.6g} s"

    def acceleration(self, t: Array | float, state: Array, rows: NDArray[np.intp] | None = None) -> Array:
        """Return the accelerations (m, N) at states (m, 2 N) of all the runs, or of `rows`; t is a scalar or (m, 1)."""
        if rows is None:
            self._state[...] = state
            self._torque[...] = self.forces(t, state)
            self._accelerate()
            return self._out.copy()
        kernel = self.functions.kernel("acceleration")
        parameters = self.parameters[rows] if self.functions.each else self.parameters
        return kernel(state, self.forces(t, state, rows), parameters, self.width, self.step)

    def jacobian(self, run: int, state: Array) -> Array:
        """Return the derivatives (2 N, 2 N) of ``[dq ddq]`` by the state (2 N,) of one run, at constant torques."""
        n, functions = self.count, self.functions
        parameters = self.parameters[run] if functions.each else self.parameters
        kernel = functions.derivatives()
        rest = (self.width,) if functions.smooth else ()
        motion = (state[:n], state[n:], self._rows("acceleration", run, state[np.newaxis], self.held[[run]])[0])
        by_q, by_dq, inertia = kernel.sample(*motion, parameters, *rest).reshape(3, n, n)
        result = np.zeros((2 * n, 2 * n))
        result[:n, n:] = np.eye(n)
        result[n:] = -np.linalg.solve(inertia, np.concatenate([by_q, by_dq], axis=1))
        return result

    def along(self, run: int, state: Array, torque: Array) -> tuple[Array, Array]:
        """Return accelerations (S, N) and kinetic energy, potential energy and power of friction (S, 3) of one run."""
        return self._rows("acceleration", run, state, torque), self._rows("energy", run, state, torque)[:, :3]

    def energy(self, run: int, state: Array) -> Array:
        """Return kinetic energy, potential energy, power of friction, and drive torques at rest, (m, 3 + N)."""
        return self._rows("energy", run, state, np.zeros((len(state), self.count)))

    def _rows(self, name: str, run: int, state: Array, torque: Array) -> Array:
        kernel: Kernel = self.functions.kernel(name)
        parameters = self.parameters[run] if self.functions.each else self.parameters
        if self.functions.each:
            parameters = np.tile(parameters, (len(state), 1))
        return kernel(state, torque, parameters, self.width, self.step)
