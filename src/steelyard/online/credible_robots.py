"""Robots that a description could stand for, where masses and friction are not known: what limits the first torques."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.estimators.kinematic_bodies import ASSUMED_REACH, SHORTEST_REACH, reach_of
from steelyard.estimators.physical_prior import PhysicalPrior, nonnegative_terms, physical_prior
from steelyard.excitation import MotionLimits
from steelyard.once import cached_property
from steelyard.robot.inertia import parameters_of_pseudo_inertia, pseudo_inertia

__all__ = ["CredibleRobots", "random_motions"]

Array = NDArray[np.float64]

MASS_DEVIATION = {"description": 0.3, "shape": 0.5, "kinematics": 0.72}
"""Standard deviation of the logarithm of a link's mass: 0.48 with shapes and 0.72 for bodies that span the joints, on
17 arms with known masses; what descriptions with inertials are taken to be wrong by."""
COMMON_DEVIATION = 0.6
"""Standard deviation of the logarithm of the masses of all the links together, where the description does not state
them."""
SHIFT = 0.5  # standard deviation of a centre of mass, in radii of gyration of the link
STRETCH = 0.3  # the same of the logarithm of the size of a link
DRIVE_SHARE = 0.3
"""Size of a friction or rotor parameter: what makes this part of the torque of its joint, as in fits with a prior."""
LEAST_TORQUE = 0.01
"""The least torque of every other joint, as a share of the largest: the last joint of an arm carries nothing, and has
friction."""
_COUNT = 600
"""Robots that are drawn. Their sample covariance has full rank for robots with fewer base parameters, and is made
regular for others."""
_STATES = 400  # random states within the limits, over which torques are averaged


def random_motions(limits: MotionLimits, count: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Return random q, dq and ddq within limits, (count, N) each; without a limit within 1 of the nearest one or 0."""
    random = np.random.default_rng([seed, count])
    lower, upper = limits.ranges
    size = len(lower)
    speed = np.where(np.isfinite(limits.velocity), limits.velocity, 1.0)
    change = np.where(np.isfinite(limits.acceleration), limits.acceleration, 3.0)
    q = random.uniform(lower, upper, (count, size))
    return q, random.uniform(-1.0, 1.0, q.shape) * speed, random.uniform(-1.0, 1.0, q.shape) * change


@dataclass(frozen=True, eq=False)
class CredibleRobots:
    """Random robots with the kinematics of a model: where masses are unknown, bodies that span the joints.

    Attributes
    ----------
    limits : MotionLimits
        Within which torques are averaged, for the size of friction.
    prior : PhysicalPrior
        What is known of the links.
    """

    model: Model
    limits: MotionLimits
    prior: PhysicalPrior

    @classmethod
    def of(cls, model: Model, limits: MotionLimits) -> CredibleRobots:
        """Gather what is known of a robot."""
        return cls(model, limits, physical_prior(model))

    @cached_property
    def parameters(self) -> Array:
        """(n,): those of the prior, with terms of zero."""
        return np.nan_to_num(self.prior.parameters)

    @cached_property
    def torque_sizes(self) -> Array:
        """(N,): root mean square torque of each joint of the prior over random motions, at least a part of the most."""
        torques = self.model.inverse_dynamics(*random_motions(self.limits, _STATES), self.parameters)
        sizes = np.sqrt(np.mean(np.asarray(torques) ** 2, axis=0))
        least = LEAST_TORQUE * np.where(np.isfinite(self.limits.torque), self.limits.torque, sizes.max())
        return np.asarray(np.maximum(sizes, np.maximum(least, 1e-6)))

    @cached_property
    def term_deviations(self) -> Array:
        """(n,): standard deviation of friction, rotor inertias and other terms; infinite for links."""
        model = self.model
        found = np.full(model.parameter_count, np.inf)
        links = set(np.asarray(model.link_columns).ravel().tolist())
        regressor = np.asarray(model.regressor(*random_motions(self.limits, _STATES)))
        seen = np.sqrt(np.mean(regressor**2, axis=0))  # (N, n)
        for column in range(model.parameter_count):
            if column in links:
                continue
            effects = seen[:, column]
            joints = effects > 1e-9 * max(float(effects.max()), 1e-300)
            sizes = DRIVE_SHARE * self.torque_sizes[joints] / effects[joints]
            found[column] = float(sizes.max()) if joints.any() else 1.0
        return found

    @cached_property
    def drawn(self) -> Array:
        """(600, n) parameters of random robots, every one of them possible."""
        model, random = self.model, np.random.default_rng(0)
        found = np.zeros((_COUNT, model.parameter_count))
        unknown = reach_of(model.robot) < SHORTEST_REACH
        common = np.exp(COMMON_DEVIATION * random.standard_normal(_COUNT))
        for columns, link in zip(model.link_columns, self.prior.links, strict=True):
            matrix = pseudo_inertia(link.parameters)
            mass = max(float(matrix[3, 3]), 1e-9)
            radius = np.sqrt(max(float(np.trace(matrix[:3, :3])) / mass, 1e-6))
            factor = np.exp(MASS_DEVIATION[link.source] * random.standard_normal(_COUNT))
            if link.source != "description":
                factor = factor * common
            change = np.tile(np.eye(4), (_COUNT, 1, 1))
            size = np.exp(STRETCH * random.standard_normal(_COUNT)) if link.source != "description" else np.ones(_COUNT)
            change[:, :3, :3] *= size[:, None, None]
            shift = SHIFT if link.source != "description" else 0.3 * SHIFT
            if unknown and link.source == "kinematics":  # the sphere about the joint stands for a link of any shape
                radius = ASSUMED_REACH
            change[:, :3, 3] = shift * radius * random.standard_normal((_COUNT, 3))
            moved = factor[:, None, None] * (change @ matrix @ np.swapaxes(change, 1, 2))
            found[:, np.asarray(columns)] = parameters_of_pseudo_inertia(moved)
        terms = np.flatnonzero(np.isfinite(self.term_deviations))
        values = self.term_deviations[terms] * random.standard_normal((_COUNT, len(terms)))
        signs = nonnegative_terms(model)[terms]
        found[:, terms] = np.where(signs, np.abs(values), values)
        return found

    @cached_property
    def covariance(self) -> Array:
        """(n_b, n_b): second moment of the base parameters about those of the prior, made regular."""
        base = self.model.base_parameters()
        errors = (self.drawn - self.parameters) @ np.asarray(base.K).T
        matrix = errors.T @ errors / _COUNT
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        regular = matrix / np.outer(scale, scale) + 0.02 * np.eye(len(scale))
        return np.asarray(regular * np.outer(scale, scale))
