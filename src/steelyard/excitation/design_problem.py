"""The optimisation problem of an excitation design, over the coefficients of a family, and its minimisation.

The criterion is minimised under all the limits by an augmented Lagrangian over L-BFGS: limits are weighted by
multipliers that learn from their violation (Hestenes 1969; Nocedal and Wright 2006, section 17.4), so that each
minimisation in between is free of constraints. The smooth stand-in of the condition number is sharpened from one to the
next.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.optimize  # at import, since its own library of linear algebra can be limited to one thread only then
from numpy.typing import NDArray

from steelyard.once import cached_property

from .criterion import Criterion, Spectrum
from .family import Basis, Family
from .motion_constraints import MotionConstraint
from .motion_limits import MotionLimits
from .vjp import RegressorInformation

__all__ = ["COARSE", "FINE", "DesignProblem", "Iterate", "Stopped", "coefficient_scale", "minimise"]

Array = NDArray[np.float64]
# Constraints that were given from outside, such as distances of bodies, are evaluated at one in so many instants during
# the search, because they cost more than all the rest. Violations in between are found when the motion is verified.
_STRIDE = 3
_NO_LIMIT = np.pi  # rad or m: half the range of a joint that has no limit of position
COARSE: tuple[tuple[float, int], ...] = ((4.0, 60), (12.0, 80))
"""Sharpness and largest number of iterations of each round, from a random start.

A low sharpness makes the objective smooth, so that poor starts are left quickly."""

FINE: tuple[tuple[float, int], ...] = ((16.0, 150), (24.0, 150), (32.0, 200), (32.0, 200))
"""Sharpness and largest number of iterations of each round of the refinement, from the results of the first rounds.
With a sharpness of 32 the smooth condition number exceeds the true one by at most a factor of n_b^(1/32), 14 % for 70
base parameters."""

# Weight of the squared violation (relative to the scale of a limit) against the logarithm of the criterion. The result
# depends little on it: from 1.5 to 150 the condition numbers of motions for a WAM were between 58 and 62 (four starts,
# two seeds); 50 and more took up to half as long again.
_PENALTY = 15.0
_MEMORY = 20  # pairs of L-BFGS


def coefficient_scale(limits: MotionLimits, basis: Basis) -> Array:
    """Return for each coefficient, (N, P), the largest value within the limits when all others are zero."""
    half = 0.5 * (limits.upper - limits.lower)
    sizes = [half, limits.velocity, limits.acceleration]
    scale = np.full((len(half), basis[0].shape[1]), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for size, values in zip(sizes, basis, strict=True):
            largest = np.abs(values).max(axis=0)
            one = size[:, None] / largest[None, :]
            scale = np.fmin(scale, np.where(largest > 1e-12, one, np.inf))
    return np.where(np.isfinite(scale), scale, _NO_LIMIT)


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Objective and limits of a design, over scaled coefficients x (N P,).

    The coefficients of the family are ``center * constant + scale * x``, (N, P).

    Attributes
    ----------
    center : ndarray
        (N,) configuration about which the joints move.
    scale : ndarray
        (N, P) scale of the coefficients.
    prior : ndarray
        (n_b, n_b) factor R of the prior information R'R.
    count : float
        Number of samples that the motion will give.
    times : ndarray
        Instants of the whole motion at which the limits are checked, s; those of the period come first.
    period_count : int
        Number of these instants that belong to the period and enter the objective.
    external_count : int
        Number of constraints that were given from outside; they are the last ones. Since they may be expensive, they
        are evaluated at one in three instants only.
    initial_count : int
        Number of instants that were there from the beginning. All constraints are evaluated at those added later.
    tightening : float
        Fraction of the scale of each limit that is kept free.
    """

    family: Family
    regressor: RegressorInformation
    criterion: Criterion
    constraints: tuple[MotionConstraint, ...]
    center: Array
    scale: Array
    prior: Array
    count: float
    times: Array
    period_count: int
    external_count: int
    initial_count: int
    tightening: float = 1e-3

    @cached_property
    def basis(self) -> Basis:
        """The basis at `times`."""
        return self.family.basis(self.times)

    @property
    def unknowns(self) -> int:
        """Number of scaled coefficients."""
        return int(self.scale.size)

    def coefficients(self, x: Array) -> Array:
        """Return the coefficients (N, P) of the family."""
        return np.asarray(self.center[:, None] * self.family.constant + self.scale * x.reshape(self.scale.shape))

    def motion(self, x: Array, basis: Basis | None = None) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq (S, N) at `times`, or for another basis."""
        whole = self.coefficients(x).T
        q, dq, ddq = (np.ascontiguousarray(b @ whole) for b in (self.basis if basis is None else basis))
        return q, dq, ddq

    def chain(self, slopes: Sequence[Array], basis: Basis) -> Array:
        """Return the gradient (N P,) by x, from gradients (S, N) by q, dq and ddq."""
        total = sum(slope.T @ b for slope, b in zip(slopes, basis, strict=True))
        return np.asarray((self.scale * total).ravel())

    def objective(self, motion: tuple[Array, Array, Array], sharpness: float) -> tuple[float, list[Array]]:
        """Return the criterion, and its gradients (period_count, N) by q, dq and ddq."""
        own = [np.ascontiguousarray(part[: self.period_count]) for part in motion]
        spectrum, parts = self.spectrum(own[0], own[1], own[2])
        value, adjoint = self.criterion.evaluate(spectrum, sharpness)
        return value, list(self.regressor.vjp(own[0], own[1], own[2], parts, self.count * adjoint))

    def spectrum(self, q: Array, dq: Array, ddq: Array) -> tuple[Spectrum, list[Array]]:
        """Return the spectrum of the information of a motion with the prior, and the parts for `vjp`."""
        mean, parts = self.regressor.information(q, dq, ddq)
        size = np.sqrt(self.count)
        known = self.prior.T @ self.prior
        return Spectrum.of(
            known + self.count * mean, lambda: np.vstack([self.prior, size * self.regressor.factor(parts)])
        ), parts

    @cached_property
    def checked_instants(self) -> list[NDArray[np.intp]]:
        """For each constraint the indices of the instants at which it is evaluated."""
        everything = np.arange(len(self.times))
        some = everything[(everything % _STRIDE == 0) | (everything >= self.initial_count)]
        own = len(self.constraints) - self.external_count
        return [everything if k < own else some for k in range(len(self.constraints))]

    def clearances(self, motion: tuple[Array, Array, Array]) -> list[Array]:
        """Return for each constraint its clearances in units of its scale, (S, m), where it is evaluated."""
        return [
            np.asarray(c.clearance(*(part[where] for part in motion))) / np.asarray(c.scale)
            for c, where in zip(self.constraints, self.checked_instants, strict=True)
        ]

    def with_times(self, more: Array) -> DesignProblem:
        """Return the same problem with further instants at which the limits are checked."""
        fresh = np.setdiff1d(np.round(more, 9), np.round(self.times, 9))
        return replace(self, times=np.concatenate([self.times, fresh]))


class Stopped(Exception):  # noqa: N818 - not an error
    """Raised inside a minimisation to end it early."""


@dataclass
class Iterate:
    """The state of a minimisation.

    Attributes
    ----------
    x : ndarray
        (N P,) scaled coefficients.
    multipliers : list of ndarray
        For each constraint the multipliers (S, m).
    """

    x: Array
    multipliers: list[Array]


def minimise(
    problem: DesignProblem,
    start: Iterate,
    rounds: Sequence[tuple[float, int]],
    stop: Callable[[], bool],
    advance: Callable[[float], None] = lambda share: None,
) -> Iterate:
    """Minimise the criterion under all constraints by rounds of the augmented Lagrangian.

    Parameters
    ----------
    problem : DesignProblem
    start : Iterate
        Its list of multipliers is empty at the first call.
    rounds : sequence of (float, int)
        Sharpness and largest number of iterations.
    stop : callable
        Called before every evaluation; where it returns True, the minimisation ends with the present iterate.
    advance : callable
        Called with the share of all iterations, from 0 to 1, that are done or were not needed.
    """
    minimize: Any = scipy.optimize.minimize  # its stubs know no further arguments with defaults
    now = Iterate(start.x.copy(), list(start.multipliers))
    if not now.multipliers:
        now.multipliers = [np.zeros((0, len(c.labels))) for c in problem.constraints]
    now.multipliers = [_padded(m, len(w)) for m, w in zip(now.multipliers, problem.checked_instants, strict=True)]
    whole, before = sum(iterations for _, iterations in rounds), 0
    for sharpness, iterations in rounds:
        done = itertools.count(before + 1)

        def evaluate(x: Array, sharpness: float = sharpness) -> tuple[float, Array]:
            if stop():
                raise Stopped
            return _augmented(problem, x, now.multipliers, sharpness)

        def keep(x: Array, done: Iterator[int] = done) -> None:
            now.x = np.array(x)
            advance(next(done) / whole)

        try:
            found = minimize(
                evaluate,
                now.x,
                jac=True,
                method="L-BFGS-B",
                callback=keep,
                options={"maxiter": iterations, "maxfun": 2 * iterations, "maxcor": _MEMORY},
            )
        except Stopped:
            return now
        now.x = np.asarray(found.x)
        before += iterations
        advance(before / whole)
        clearances = problem.clearances(problem.motion(now.x))
        now.multipliers = [
            np.maximum(0.0, m + _PENALTY * (problem.tightening - c))
            for m, c in zip(now.multipliers, clearances, strict=True)
        ]
    return now


def _padded(multipliers: Array, count: int) -> Array:
    return np.vstack([multipliers, np.zeros((count - len(multipliers), multipliers.shape[1]))])


def _augmented(problem: DesignProblem, x: Array, multipliers: Sequence[Array], sharpness: float) -> tuple[float, Array]:
    motion = problem.motion(x)
    value, slopes = problem.objective(motion, sharpness)
    total = [np.zeros_like(part) for part in motion]
    for whole, part in zip(total, slopes, strict=True):
        whole[: problem.period_count] = part
    for constraint, known, where in zip(problem.constraints, multipliers, problem.checked_instants, strict=True):
        scale = np.asarray(constraint.scale)
        q, dq, ddq = motion if len(where) == len(motion[0]) else tuple(part[where] for part in motion)
        push = known + _PENALTY * (problem.tightening - np.asarray(constraint.clearance(q, dq, ddq)) / scale)
        np.maximum(push, 0.0, out=push)
        if not push.any():
            continue
        value += float((push * push).sum()) / (2.0 * _PENALTY)
        for whole, part in zip(total, constraint.vjp(q, dq, ddq, -push / scale), strict=True):
            whole[where] += part
    return value, problem.chain(total, problem.basis)
