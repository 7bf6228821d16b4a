"""Friction that remembers the motion, in a simulation: the state of its bristles along the steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model

__all__ = ["BristleFriction"]

Array = NDArray[np.float64]

RESOLVED = 0.3
"""Phase, rad, of the fastest vibration of a joint on its bristles that a step may turn by: the error of a step of order
4 is then 2e-5 of the amplitude. The method is stable to 2.8."""


class BristleFriction:
    """The friction of the bristles of R runs, with their states where the present step began.

    Within a step the state follows in closed form from how far the joint has moved since, as along a measured motion;
    see :func:`steelyard.dynamics.bristles.bristle_states`.

    Parameters
    ----------
    model : Model
        With friction that has a state.
    parameters : ndarray
        (n,), or (R, n).
    state : ndarray
        (R, 2 N) at the start, where the bristles are not bent.

    Attributes
    ----------
    states : ndarray
        (R, N) at the beginning of the present step.
    """

    def __init__(self, model: Model, parameters: Array, state: Array) -> None:
        n = model.dof
        self._count = n
        self._own = own = model.bristles.joints
        self._shapes = model.bristles.shapes
        numbers = [model.robot.driving_joints[k] + 1 for k in own]
        names = {f"{symbol}{number}" for symbol in ("Fcj", "Fbj") for number in numbers}
        self.places = np.array([name in names for name in model.parameter_names])
        still, moving = np.zeros(n), np.zeros(n)
        moving[own] = 1.0
        coulomb, damping = [], []
        for each in np.atleast_2d(parameters):
            share = np.where(self.places, each, 0.0)
            bent, loose = {model.bristles.channel: moving}, {model.bristles.channel: still}
            coulomb.append(model.drive_torque(still, still, share, still, channels=bent)[own])
            damping.append(model.drive_torque(moving, still, share, still, channels=loose)[own])
        self._coulomb, self._damping = np.array(coulomb), np.array(damping)
        self.states = np.zeros((len(state), n))
        self._start = state.copy()

    def longest_step(self, inertias: Array) -> float:
        """Return the longest step, s, that follows joints of inertias (m, N, N) vibrating on their bristles."""
        lightest = np.array([np.diagonal(np.linalg.pinv(one))[self._own] for one in inertias]).max(axis=0)
        stiffness, damping = (np.abs(one).max(axis=0) for one in (self._coulomb / self._shapes[0], self._damping))
        fastest = np.sqrt(stiffness * lightest) + damping * lightest
        return float(RESOLVED / max(fastest.max(initial=0.0), 1e-9))

    def at(self, state: Array, rows: NDArray[np.intp] | slice = slice(None)) -> Array:
        """Return the states (m, N) of the bristles where the present step has led to states (m, 2 N)."""
        own, n = self._own, self._count
        d, _, _ = self._shapes
        begin, result = self._start[rows], self.states[rows].copy()
        moved = (state[:, :n] - begin[:, :n])[:, own]
        middle = 0.5 * (self._bound(begin[:, n:][:, own]) + self._bound(state[:, n:][:, own]))
        slid = np.sign(moved) * middle
        result[:, own] = slid + (result[:, own] - slid) * np.exp(-np.abs(moved) / (d * middle))
        return result

    def torques(self, bent: Array, dq: Array, rows: NDArray[np.intp] | slice = slice(None)) -> Array:
        """Return the torques (m, N) of friction, against the motion, by states and speeds (m, N)."""
        result = np.zeros_like(dq)
        u, v = bent[:, self._own], dq[:, self._own]
        coulomb, damping = self._numbers(rows)
        result[:, self._own] = coulomb * u + damping * self._rates(u, v)
        return result

    def energies(self, bent: Array, dq: Array, rows: NDArray[np.intp] | slice = slice(None)) -> tuple[Array, Array]:
        """Return the energy that bent bristles hold (m,), J, and the power that is lost (m,), W."""
        u, v = bent[:, self._own], dq[:, self._own]
        coulomb, damping = self._numbers(rows)
        rates = self._rates(u, v)
        held = 0.5 * (coulomb * self._shapes[0] * u * u).sum(axis=1)
        lost = (coulomb * u * (v - rates) + damping * rates * v).sum(axis=1)
        return held, lost

    def step_made(self, state: Array) -> None:
        """Take the states (R, 2 N) at the end of the present step as the beginning of the next."""
        self.states = self.at(state)
        self._start = state.copy()

    def _numbers(self, rows: NDArray[np.intp] | slice) -> tuple[Array, Array]:
        if len(self._coulomb) == 1:
            return self._coulomb, self._damping
        return self._coulomb[rows], self._damping[rows]

    def _bound(self, dq: Array) -> Array:
        _, ratio, velocity = self._shapes
        return np.asarray(1.0 + ratio * np.exp(-np.minimum((dq / velocity) ** 2, 700.0)))

    def _rates(self, u: Array, dq: Array) -> Array:
        return np.asarray(dq - np.abs(dq) * u / self._bound(dq))
