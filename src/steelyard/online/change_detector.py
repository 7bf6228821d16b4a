"""Tells when a robot is no longer the one that was estimated, by torques that stay beside what is predicted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.regression import Information
from steelyard.regression.factor import Reduced, column_lengths
from steelyard.regression.reduction import residuals_of_rows

from .running_information import stacked
from .saved_state import Stateful

__all__ = ["FEWEST", "USUAL", "Change", "ChangeDetector", "Prediction", "Stretches", "least_told"]

Array = NDArray[np.float64]

USUAL = 3.0
"""How many times as large as usual the mean square of the residuals must be to speak for a change at all."""

ALARM = 100.0
"""The sum of such excesses above which a change is told. *Measured*: with 30, and at most 20 for a stretch, changes are
noticed 0.05 s earlier, and 9 were told that did not happen in two minutes of a UR10 with friction that its model does
not describe (7), 3 in 44 s of a KR300 (0), and 6 in two minutes of a simulated arm with Stribeck friction (1)."""

MOST = 50.0
"""The most that a single stretch counts, so that one jolt is no change: it takes three stretches at least."""

MEMORY = 200
"""Stretches over which the usual size of the residuals is averaged."""

FEWEST = 40
"""Stretches from which the usual size is known."""

UNTOLD = 1e-6
"""Part of the length of a column of the regression that is added to it on the diagonal: what the data do not tell of a
parameter has an end, far beyond what any change makes of it."""


@dataclass(frozen=True, eq=False)
class Change:
    """A change of the robot that was noticed.

    Attributes
    ----------
    t : float
        When it began, by the residuals; the time of the samples.
    noticed : float
        Time of the sample with which it was noticed.
    joint_names : tuple of str
        Whose torques are no longer predicted, the clearest first.
    before : Information
        The data up to then, less the last second before it was noticed; empty where they are not known to be of one
        robot.
    robots : tuple of int
        Numbers of the robot before and since then: 0 for the first, and so on. One that was met before has its number
        again; where both are the same one, it was only off for a while, or nothing is known of what it was before.
    known : bool
        Whether the robot since then is one that was met before.

    Examples
    --------
    A pendulum is hung with a weight after ten seconds:

    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> estimator = sy.OnlineEstimator(model, detect_changes=True)
    >>> alone = sy.Inertia.from_com(2.0, [-0.5, 0, 0], 0.1 * np.eye(3)).parameters
    >>> weight = sy.Inertia.from_com(1.0, [0, 0, 0], 0.01 * np.eye(3)).parameters
    >>> t = np.arange(15000)[:, None] / 1000
    >>> torque = model.inverse_dynamics(np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t), alone)
    >>> more = model.inverse_dynamics(np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t), weight)
    >>> torque += np.where(t >= 10.0, more, 0.0) + 0.1 * np.random.default_rng(1).normal(size=t.shape)
    >>> estimator.update(t[:, 0], np.sin(2 * t), torque)
    >>> [change.joint_names for change in estimator.changes], round(estimator.changes[0].t, 1)
    ([('joint1',)], 10.0)
    """

    t: float
    noticed: float
    joint_names: tuple[str, ...]
    before: Information = field(repr=False)
    robots: tuple[int, int] = (0, 1)
    known: bool = False


def least_told(lengths: Array) -> Array:
    """Return a triangle that ends what data do not tell, by the lengths of the columns of what they tell."""
    return np.diag(UNTOLD * np.where(lengths > 0.0, lengths, lengths.max() or 1.0))


@dataclass(frozen=True, eq=False)
class Prediction:
    """What least squares predict of the torques to come, and how uncertain that is.

    A robot that begins another motion shows parameters that the one before hid. Its torques are not those that were
    predicted, and the robot is still the same one. *Measured* without this, on robots whose description has no masses:
    of 19 that moved slowly and then fast, and had not changed, 17 were taken for changed ones.

    Attributes
    ----------
    triangle : ndarray
        (n_b, n_b) of the data so far, of which each row has about the variance 1; its columns come first in memory.
    weights : ndarray
        (N,), by which the rows of each joint were multiplied.
    answer, data : ndarray
        (n_b,): base parameters of the last answer, and of the data near it.
    """

    triangle: Array
    weights: Array
    answer: Array
    data: Array

    @classmethod
    def of(cls, problem: Reduced, near: Array, weights: Array) -> Prediction:
        """Predict by a regression, and by base parameters (n_b,) what it does not tell."""
        from scipy.linalg import solve_triangular

        triangle = stacked(np.asfortranarray(problem.R), least_told(column_lengths(problem.R)))
        left = problem.R.T @ (problem.rho - problem.R @ near)
        step = solve_triangular(triangle, solve_triangular(triangle, left, trans="T"))
        return cls(triangle, weights, near, near + step)

    def state(self) -> list[Array]:
        """Return all of it, for a file."""
        return [self.triangle, self.weights, self.answer, self.data]

    @classmethod
    def of_state(cls, state: Sequence[Array]) -> Prediction:
        """Return the prediction of which `state` told."""
        triangle, *others = state
        return cls(np.asfortranarray(triangle), *others)

    def residuals(self, model: Model, rows: Sequence[Array], used: NDArray[np.bool_], length: int) -> Array:
        """Return residuals (S, N) of rows that come next, over the root of their variance relative to that of noise.

        Parameters
        ----------
        model : Model
        rows : sequence of ndarray
            ``[W omega]`` of each joint, (S, c + 1), that follow each other closely.
        used : ndarray of bool
            (S, N), which of them count.
        length : int
            The number of samples over which residuals are averaged.
        """
        by_answer, by_data = (residuals_of_rows(model, rows, base) for base in (self.answer, self.data))
        by_data /= np.sqrt(1.0 + self.leverage(model, rows, used, length))
        sums = (np.abs(np.sum(residuals * used, axis=0)) for residuals in (by_answer, by_data))
        return np.where(np.less(*sums), by_answer, by_data)

    def leverage(self, model: Model, rows: Sequence[Array], used: NDArray[np.bool_], length: int) -> Array:
        """Return the variance (N,) of what the data predict of averages of such rows, relative to that of their noise.

        The parameters are as in `residuals`. The mean of the noise of `length` samples has as many times less variance,
        so that what is uncertain of the base parameters counts as many times more beside it.
        """
        from scipy.linalg import solve_triangular

        means = np.zeros((len(self.answer), len(rows)))
        for k, (own, columns) in enumerate(zip(rows, model.base_columns.joints, strict=True)):
            if used[:, k].any():
                means[columns, k] = self.weights[k] * own[used[:, k], :-1].mean(axis=0)
        told: Array = length * np.sum(solve_triangular(self.triangle, means, trans="T") ** 2, axis=0)
        return told


class Stretches(Stateful):
    """Averages of residuals over stretches of so many samples.

    Parameters
    ----------
    joints, length : int
    """

    _STATE = ("_sum", "_count", "_filled")

    def __init__(self, joints: int, length: int) -> None:
        self.length = length
        self._sum, self._count, self._filled = np.zeros(joints), np.zeros(joints, dtype=int), 0

    @property
    def begun(self) -> bool:
        """Whether a stretch has begun and not ended."""
        return self._filled > 0

    def add(self, residuals: Array, used: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]] | None:
        """Add residuals (S, N); return the squares (N,) of the averages of a stretch that ends, and of which joints."""
        self._sum += np.sum(residuals * used, axis=0)
        self._count += used.sum(axis=0)
        self._filled += len(residuals)
        if self._filled < self.length:
            return None
        shown = 2 * self._count > self._filled
        squares = np.where(shown, self._sum / np.maximum(self._count, 1), 0.0) ** 2
        self._sum[:], self._count[:], self._filled = 0.0, 0, 0
        return squares, shown


class ChangeDetector(Stateful):
    """A cumulative sum of how much larger than usual the residuals are (Page's test).

    Residuals are averaged over stretches of `length` samples. Their squares over their usual mean square, averaged over
    the joints, less 3 and at most 50, are added up, and the sum never falls below zero: where it passes 100, the robot
    has changed, and it did so when the sum last left zero. What is usual is the average over the last 200 stretches
    before that, so that errors that the model always makes raise no alarm. They are those of motion: at rest there is
    noise alone, beside which any motion would be a change, one after the other.

    Parameters
    ----------
    joints : int
    length : int
        Samples.

    Examples
    --------
    >>> detector = ChangeDetector(joints=1, length=50)
    >>> residuals = np.random.default_rng(1).normal(size=(5000, 1))
    >>> residuals[4000:] += 2.0
    >>> t, used = np.arange(5000) / 1000, np.ones((5000, 1), dtype=bool)
    >>> parts = (slice(k, k + 50) for k in range(0, 5000, 50))
    >>> next(part.stop for part in parts if detector.add(t[part], residuals[part], used[part])), detector.began
    (4150, 4.0)

    References
    ----------
    E. S. Page, Continuous inspection schemes, Biometrika 41, 1954.
    """

    _STATE = ("usual", "seen", "_stretches", "excess", "began", "shares", "_began_filling", "_moving", "_waiting")

    def __init__(self, joints: int, length: int) -> None:
        self.length = length
        self.usual, self.seen = np.zeros(joints), np.zeros(joints, dtype=int)
        self.rest()

    def rest(self) -> None:
        """Begin anew after a change, with the same usual size of residuals."""
        self._stretches = Stretches(len(self.usual), self.length)
        self.excess, self.began, self._began_filling = 0.0, float("nan"), float("nan")
        self.shares, self._moving = np.zeros(len(self.usual)), 0
        # Since the sum left zero. Were they left out where the sum comes back, what is usual would be the average of
        # the small ones alone: with one joint it shrinks until noise is a change.
        self._waiting: list[tuple[Array, NDArray[np.bool_]]] = []

    def add(self, t: Array, residuals: Array, used: NDArray[np.bool_], moves: NDArray[np.bool_] | None = None) -> bool:
        """Add residuals (S, N) at times (S,); return whether they are those of a robot that has changed.

        Whether it moves, (S,), decides which of them count in what is usual: all of them where absent.
        """
        if not self._stretches.begun:
            self._began_filling, self._moving = float(t[0]), 0
        self._moving += len(t) if moves is None else int(np.count_nonzero(moves))
        ended = self._stretches.add(residuals, used)
        if ended is None:
            return False
        squares, shown = ended
        known = shown & self.known
        if known.any():
            shares = np.where(known, squares / np.where(known, self.usual, 1.0), 0.0)
            excess = min(float(shares[known].mean()) - USUAL, MOST)
            if excess > 0.0 and self.excess == 0.0:
                self.began, self.shares = self._began_filling, np.zeros(len(squares))
            self.excess = max(0.0, self.excess + excess)
            if self.excess > 0.0:
                self.shares = self.shares + shares
            if self.excess > ALARM:
                return True
        if 2 * self._moving > self.length:
            self._waiting.append((squares, shown))
        if self.excess == 0.0:
            for one in self._waiting:
                self._average(*one)
            self._waiting = []
        return False

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) of which joints it is known what is usual."""
        return (self.seen >= FEWEST) & (self.usual > 0.0)

    def _average(self, squares: Array, shown: NDArray[np.bool_]) -> None:
        """Let the squares of a stretch count in what is usual, by no more than they may speak for a change."""
        bounded = np.where(self.known, np.minimum(squares, (USUAL + MOST) * self.usual), squares)
        self.seen[shown] = np.minimum(self.seen[shown] + 1, MEMORY)
        share = 1.0 / np.maximum(self.seen, 1)
        self.usual = np.where(shown, self.usual + share * (bounded - self.usual), self.usual)
