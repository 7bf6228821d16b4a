"""Runs that cannot come to an end: speeds that no robot has, and steps so short that time stands still."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .plant import Plant

__all__ = ["ABSURD_SPEED", "Runaway"]

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
End = Callable[[int, float, str, Array], None]

ABSURD_SPEED = 5e3  # rad/s or m/s, fifty thousand turns a minute
WINDOW = 2000  # attempts of a step over which the pace is measured
SLOWEST = 1e-9  # of the duration, that an attempt must gain on average: otherwise a thousand million are needed
MOST = 50_000_000  # attempts of one run


class Runaway:
    """Ends runs that an adaptive method would follow for ever, as ever shorter steps follow ever faster joints.

    Parameters
    ----------
    plant : Plant
    state : ndarray
        (R, 2 N) at the start; ten times its largest speed is allowed, where that is more.
    duration : float
        s.
    end : callable
        Of a run, its time, the message and its state (2 N,).
    """

    def __init__(self, plant: Plant, state: Array, duration: float, end: End) -> None:
        runs = plant.runs
        self._end, self._count, self._plant = end, plant.count, plant
        self._limit = np.maximum(ABSURD_SPEED, 10.0 * np.abs(state[:, plant.count :]).max(axis=1, initial=0.0))
        self._attempts = np.zeros(runs, dtype=np.int64)
        self._since = np.zeros(runs)
        self._slowest = SLOWEST * WINDOW * duration

    def check(self, rows: Rows, t: Array, state: Array) -> None:
        """Look at runs (m,) after an attempt of a step, which led to their times (m,) and states (m, 2 N)."""
        self.speed(rows, t, state)
        self._attempts[rows] += 1
        attempts = self._attempts[rows]
        for k in np.flatnonzero(attempts % WINDOW == 0).tolist():
            run, now = int(rows[k]), float(t[k])
            if now - self._since[run] < self._slowest:
                text = f"{WINDOW} steps got {now - self._since[run]:.3g} s further, to {now:.6g} s: time stands still"
                self._end(run, now, text, state[k])
            elif attempts[k] >= MOST:
                self._end(run, now, f"{MOST} steps led no further than {now:.6g} s", state[k])
            self._since[run] = now

    def speed(self, rows: Rows, t: Array, state: Array) -> None:
        """End the runs of which a joint is absurdly fast."""
        speeds = np.abs(state[:, self._count :])
        if not (speeds > ABSURD_SPEED).any():
            return
        for k in np.flatnonzero(speeds.max(axis=1) > self._limit[rows]).tolist():
            robot = self._plant.functions.model.robot
            joint = robot.driving_joints[int(np.argmax(speeds[k]))]
            unit = "rad/s" if robot.joints[joint].rotates else "m/s"
            text = (
                f"joint {robot.joints[joint].name!r} reached {speeds[k].max():.3g} {unit}, which no robot does, "
                f"at {t[k]:.6g} s"
            )
            self._end(int(rows[k]), float(t[k]), text, state[k])
