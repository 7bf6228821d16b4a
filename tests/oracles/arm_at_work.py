"""An arm of two joints that picks things up and puts them down, and how far estimates of it are from the truth."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from two_joint_arm import unstated_parameters

import steelyard as sy

Array = NDArray[np.float64]
RATE, NOISE = 500, 0.1
"""Hz, and the standard deviation of the noise of torques, N·m."""


class Work:
    """A motion, and the torques of an arm that carries so much of the payload, part by part of so many seconds."""

    def __init__(
        self,
        model: sy.Model,
        parts: list[tuple[float, float]],
        rest: tuple[float, float] = (0.0, 0.0),
        rate: int = RATE,
        slowest: float = 0.0,
    ) -> None:
        ends = np.cumsum([seconds for seconds, _ in parts])
        self.t = np.arange(round(rate * ends[-1])) / rate
        # Time itself slows down before the arm rests, or is slow.
        begin, end = rest
        speed = np.interp(self.t, [begin - 0.5, begin, end, end + 0.5], [1.0, slowest, slowest, 1.0])
        speed = speed**2 * (3.0 - 2.0 * speed) if end else np.ones_like(self.t)
        phase, change = np.cumsum(speed) / rate, np.gradient(speed, 1.0 / rate)
        q, dq, ddq = np.zeros((3, len(self.t), 2))
        for pace, shift in zip(np.array([[3.0, 4.0], [1.3, 2.2]]), np.array([[0.0, 1.0], [2.0, 3.0]]), strict=True):
            wave = pace * phase[:, None] + shift
            q += 0.5 * np.sin(wave)
            dq += 0.5 * pace * np.cos(wave) * speed[:, None]
            ddq += 0.5 * pace * (np.cos(wave) * change[:, None] - pace * np.sin(wave) * speed[:, None] ** 2)
        self.motion = q, dq, ddq
        self.part = np.searchsorted(ends, self.t, side="right").clip(max=len(parts) - 1)
        carried = np.array([share for _, share in parts])[self.part]
        alone, loaded = (model.inverse_dynamics(*self.motion, unstated_parameters(x)) for x in (0.0, 1.0))
        self.carried = carried
        self.torque = alone + carried[:, None] * (loaded - alone)  # the payload's part is linear in its parameters
        self.torque += NOISE * np.random.default_rng(1).normal(size=alone.shape)

    def feed(self, estimator: sy.OnlineEstimator, begin: float = 0.0, end: float = np.inf) -> None:
        rows = (self.t >= begin) & (self.t < end)
        estimator.update(self.t[rows], self.motion[0][rows], self.torque[rows])


def never_and_often_stopped(
    model: sy.Model, work: Work, stops: Array, path: Path
) -> tuple[sy.OnlineEstimator, sy.OnlineEstimator]:
    """Two estimators at the same work, of which one is saved and loaded at each stop; both leave the same file."""
    never, stopped = (sy.OnlineEstimator(model, rate=RATE, detect_changes=True) for _ in range(2))
    last = 0.0
    for end in stops:
        for estimator in (never, stopped):
            work.feed(estimator, last, end)
        stopped.save(path)
        stopped, last = sy.OnlineEstimator.load(path, model), end
    stopped.save(path)
    never.save(path.with_stem("never"))
    assert path.read_bytes() == path.with_stem("never").read_bytes()
    return never, stopped


def deviations(estimator: sy.OnlineEstimator, true: Array) -> Array:
    """How far least squares of what counts is from the truth, in its own standard errors."""
    found = sy.least_squares(estimator.information)
    return np.abs(found.base - estimator.model.base_parameters().K @ true) / found.standard_error
