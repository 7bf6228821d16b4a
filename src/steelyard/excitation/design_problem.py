"""The optimisation problem of an excitation design: objective and limits over the coefficients of a family."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .criterion import Criterion, Spectrum
from .family import Basis, Family
from .motion_constraints import MotionConstraint
from .motion_limits import MotionLimits
from .vjp import RegressorInformation

__all__ = ["DesignProblem", "coefficient_scale"]

Array = NDArray[np.float64]
_STRIDE = 3
_NO_LIMIT = np.pi  # rad or m: half the range of a joint that has no limit of position


def coefficient_scale(limits: MotionLimits, basis: Basis) -> Array:
    """Return for each coefficient, (N, P), the largest value that keeps the limits when it acts alone."""
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
    family : Family
    regressor : RegressorInformation
    criterion : Criterion
    constraints : tuple of MotionConstraint
    center : ndarray
        (N,) configuration about which the joints move.
    scale : ndarray
        (N, P).
    prior : ndarray
        (n_b, n_b) factor R of the information R'R that is there already.
    count : float
        How many samples the period will give.
    times : ndarray
        Instants of the whole motion at which the limits are looked at, s; those of the period come first.
    judged : int
        How many of them belong to the period and give the objective.
    given : int
        How many of the constraints, the last ones, were given from outside. They may cost much, and are looked at
        at one in three of the instants only; what lies between is found when all is verified.
    regular : int
        How many of the instants were there from the beginning; those that were added later count for all constraints.
    tightening : float
        Part of its scale that is kept free of each limit.
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
    judged: int
    given: int
    regular: int
    tightening: float = 1e-3

    @cached_property
    def basis(self) -> Basis:
        """Basis at `times`."""
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
        """Return the criterion, and its gradients (judged, N) by q, dq and ddq."""
        own = [np.ascontiguousarray(part[: self.judged]) for part in motion]
        spectrum, parts = self.spectrum(own[0], own[1], own[2])
        value, adjoint = self.criterion.evaluate(spectrum, sharpness)
        return value, list(self.regressor.vjp(own[0], own[1], own[2], parts, self.count * adjoint))

    def spectrum(self, q: Array, dq: Array, ddq: Array) -> tuple[Spectrum, list[Array]]:
        """Return the information of motion (judged, N) and of what is known, and what the regressor needs of it."""
        mean, parts = self.regressor.information(q, dq, ddq)
        size = np.sqrt(self.count)
        known = self.prior.T @ self.prior
        return Spectrum.of(
            known + self.count * mean, lambda: np.vstack([self.prior, size * self.regressor.factor(parts)])
        ), parts

    @cached_property
    def looked_at(self) -> list[NDArray[np.intp]]:
        """For each constraint the indices of the instants at which it is looked at."""
        everything = np.arange(len(self.times))
        some = everything[(everything % _STRIDE == 0) | (everything >= self.regular)]
        own = len(self.constraints) - self.given
        return [everything if k < own else some for k in range(len(self.constraints))]

    def clearances(self, motion: tuple[Array, Array, Array]) -> list[Array]:
        """Return for each constraint its clearances in units of its scale, (S, m), where it is looked at."""
        return [
            np.asarray(c.clearance(*(part[where] for part in motion))) / np.asarray(c.scale)
            for c, where in zip(self.constraints, self.looked_at, strict=True)
        ]

    def with_times(self, more: Array) -> DesignProblem:
        """Return the same problem with further instants at which the limits are looked at."""
        fresh = np.setdiff1d(np.round(more, 9), np.round(self.times, 9))
        return replace(self, times=np.concatenate([self.times, fresh]))

    def with_prior(self, prior: Array) -> DesignProblem:
        """Return the same problem with a factor (n_b, n_b) of information that is there already."""
        return replace(self, prior=prior)
