"""Pieces of a motion that begin in motion and could end at rest, and the choice of the one that teaches most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.excitation.criterion import Criterion, Spectrum
from steelyard.excitation.design_problem import DesignProblem, Iterate, coefficient_scale, minimise
from steelyard.excitation.family import Basis, PointFamily
from steelyard.excitation.limit_margins import Verifier
from steelyard.excitation.motion_constraints import MotionConstraint, joint_limits
from steelyard.excitation.motion_limits import MotionLimits
from steelyard.excitation.spline import splines
from steelyard.excitation.trajectory import SampledTrajectory, times_of
from steelyard.excitation.vjp import RegressorInformation
from steelyard.once import cached_property

__all__ = ["Segment", "SegmentFamily", "SegmentPlanner", "starting_points"]

Array = NDArray[np.float64]
State = tuple[Array, Array, Array]

_FIXED = 3
"""Control points that position, velocity and acceleration at the beginning determine."""
_INSTANTS = 20.0
"""Hz at which the criterion and the limits are evaluated in the search. The limits are checked at 1 kHz afterwards."""
_MORE = 2  # smaller starts, where none of the others led to a motion that keeps its limits
_LEAST_ADDED = 1e-9  # part of the precision, below which what a motion adds to it is rounding
_ROUNDS: tuple[tuple[float, int], ...] = ((8.0, 120), (8.0, 60), (8.0, 30))
"""Sharpness and iterations of the search from each start, half a second for seven joints. One start with so many is
worth more than two with half as many, which cost the same: over 30 s of a WAM that is followed perfectly 2.96 in place
of 2.58 times the information of trajectory A a second. Six starts with half as many have 2.62, ten times as many
iterations no more than `_SegmentProblem.objective` gives these, 3.2."""


@dataclass(frozen=True)
class SegmentFamily(PointFamily):
    """B-splines of degree five from any state to rest; the coefficients are the control points.

    The first three points follow from position, velocity and acceleration at the beginning, and the last one stands for
    three equal ones, with which the motion ends at rest.

    Attributes
    ----------
    period : float
        s.
    size : int
        Number P of control points, the last three counted once; at least 5.
    """

    name: str = "segment"

    @property
    def step(self) -> float:
        """s."""
        return 1.0 / _INSTANTS

    def basis(self, t: Array) -> Basis:
        """Return the basis at times (S,)."""
        clipped = np.clip(t, 0.0, self.period)
        folded = []
        for one in splines(np.eye(self.size + 2), self.period):
            values = np.asarray(one(clipped))
            own = values[:, : self.size].copy()
            own[:, -1] += values[:, self.size :].sum(axis=1)
            folded.append(own)
        return folded[0], folded[1], folded[2]

    def excitation(self, coefficients: Array) -> Segment:
        """Return the motion."""
        return Segment(coefficients, self.period)

    trajectory = excitation


def starting_points(family: SegmentFamily, state: State) -> Array:
    """Return the first three control points (N, 3) of a motion that begins with q, dq and ddq, (N,) each."""
    rows = np.array([part[0, :_FIXED] for part in family.basis(np.zeros(1))])
    return np.asarray(np.linalg.solve(rows, np.array(state)).T)


@dataclass(frozen=True, eq=False)
class Segment(SampledTrajectory):
    """A motion of B-splines of degree five that ends at rest.

    Attributes
    ----------
    points : ndarray
        (N, P) control points, rad or m; the last one counts three times.
    duration : float
        s.
    """

    points: Array
    duration: float

    @property
    def dof(self) -> int:
        """Number N of joints."""
        return len(self.points)

    @cached_property
    def _splines(self) -> tuple[Any, Any, Any]:
        return splines(np.concatenate([self.points, self.points[:, [-1, -1]]], axis=1), self.duration)

    def motion(self, t: ArrayLike) -> State:
        """Return q, dq and ddq, (S, N) each, at times (S,); at rest after the end."""
        times = times_of(t)
        clipped = np.clip(times, 0.0, self.duration)
        q, dq, ddq = (np.asarray(s(clipped), dtype=np.float64) for s in self._splines)
        over = times >= self.duration
        dq[over] = ddq[over] = 0.0
        return q, dq, ddq


@dataclass(frozen=True, eq=False, kw_only=True)
class _SegmentProblem(DesignProblem):
    """A design problem whose motions all begin in one state."""

    fixed: Array

    def coefficients(self, x: Array) -> Array:
        """Return the control points (N, P)."""
        return np.asarray(self.fixed + self.scale * x.reshape(self.scale.shape))

    def objective(self, motion: State, sharpness: float) -> tuple[float, list[Array]]:
        """Return minus the logarithm of the precision that the motion adds, and its gradients by q, dq and ddq.

        The precision is what grows with the time of motion: one over the trace of the covariance, or the geometric mean
        of the eigenvalues of the information. The logarithm of the whole of it changes the less the more is known
        already, and the limits, whose weight in the search does not, would outweigh it.
        """
        value, slopes = super().objective(motion, sharpness)
        added = max(-float(np.expm1(value - self._known)), _LEAST_ADDED)  # of the precision that there is then
        return value - float(np.log(added)), [slope / added for slope in slopes]

    @cached_property
    def _known(self) -> float:
        """The same criterion of what is known before the motion."""
        return self.criterion.evaluate(Spectrum.of(self.prior.T @ self.prior, lambda: self.prior))[0]


@dataclass(frozen=True, eq=False)
class SegmentPlanner:
    """Finds the motion from the present state to rest after which the parameters are known best.

    Attributes
    ----------
    limits : MotionLimits
        Positions, velocities and accelerations of the reference.
    constraints : sequence of MotionConstraint
        Further ones, such as predicted torques and distances of bodies.
    duration : float
        s, from the present state to rest.
    spacing : float
        s between two control points.
    rate : float
        Of the samples, Hz, less what their correlation takes away.
    starts : int
        Random starts of the search.
    """

    regressor: RegressorInformation
    criterion: Criterion
    limits: MotionLimits
    constraints: Sequence[MotionConstraint] = ()
    duration: float = 5.0
    spacing: float = 0.45
    rate: float = 10.0
    starts: int = 1
    seed: int = 0

    @cached_property
    def family(self) -> SegmentFamily:
        """The motions among which one is chosen."""
        return SegmentFamily(self.duration, max(6, round(self.duration / self.spacing) + 3))

    @cached_property
    def _verifier(self) -> Verifier:
        return Verifier(self.family)

    def plan(self, state: State, known: Array) -> Segment | None:
        """Return the best motion that was found, which keeps its limits at 1 kHz, or None where none does.

        Parameters
        ----------
        state : tuple of ndarray
            q, dq and ddq at the beginning, (N,) each.
        known : ndarray
            (n_b, n_b) factor R of the information R'R that there is already.
        """
        problem = self._problem(state, known)
        random = np.random.default_rng(self.seed)
        best: Segment | None = None
        least = np.inf
        for attempt in range(self.starts + _MORE):
            if attempt >= self.starts and best is not None:
                break
            start = self._random_start(problem, random)
            if attempt >= self.starts:  # a smaller motion keeps its limits more easily
                start *= 0.3
            found = minimise(problem, Iterate(start, []), _ROUNDS, lambda: False)
            kept = self._verifier.repaired(problem, found.x)
            if kept is None:
                continue
            loss = problem.criterion.loss(problem.criterion.figure(problem.spectrum(*problem.motion(kept))[0]))
            if best is None or loss < least:
                best, least = self.family.trajectory(problem.coefficients(kept)), loss
        return best

    def _problem(self, state: State, known: Array) -> _SegmentProblem:
        count = int(np.ceil(self.duration * _INSTANTS))
        times = self.duration * np.arange(count) / count
        limits, family = self.limits, self.family
        scale = coefficient_scale(limits, family.basis(times))
        scale[:, :_FIXED] = 0.0
        fixed = np.repeat(state[0][:, None], family.size, axis=1)
        fixed[:, :_FIXED] = starting_points(family, state)
        fixed[:, _FIXED:] = fixed[:, [_FIXED - 1]]
        return _SegmentProblem(
            family=family,
            regressor=self.regressor,
            criterion=self.criterion,
            constraints=(*joint_limits(limits), *self.constraints),
            center=state[0],
            scale=scale,
            prior=known,
            count=self.duration * self.rate,
            times=times,
            period_count=count,
            external_count=len(self.constraints),
            initial_count=count,
            fixed=fixed,
        )

    def _random_start(self, problem: _SegmentProblem, random: np.random.Generator) -> Array:
        """Return coefficients of a random walk between random positions within the limits."""
        shape = problem.scale.shape
        lower, upper = self.limits.ranges
        span, middle = upper - lower, 0.5 * (upper + lower)
        knots = random.uniform(-0.45, 0.45, (shape[0], 4)) * span[:, None] + middle[:, None]
        places = np.linspace(0.0, 3.0, shape[1] - _FIXED)
        targets = np.array([np.interp(places, np.arange(4), row) for row in knots])
        wanted = targets - problem.fixed[:, _FIXED:]
        x = np.zeros(shape)
        x[:, _FIXED:] = 0.3 * wanted / np.where(problem.scale[:, _FIXED:] > 0.0, problem.scale[:, _FIXED:], 1.0)
        return np.clip(x, -2.0, 2.0).ravel()
