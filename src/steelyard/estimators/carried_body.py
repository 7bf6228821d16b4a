"""A robot that carries something: the parameters of both, and which of them two logs can show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import BaseParameters, Model
from steelyard.dynamics.base_parameters import base_parameters_of
from steelyard.dynamics.conditions import body_conditions
from steelyard.errors import InputError
from steelyard.feasibility.constraints import Constraint, Equality
from steelyard.feasibility.constraints.toml_section import read_placement
from steelyard.files import suggestion
from steelyard.lmi import AffineBlock
from steelyard.once import cached_property
from steelyard.robot import INERTIA_SYMBOLS
from steelyard.robot.inertia import transformation

__all__ = ["PAYLOAD", "CarriedBody", "CarryingModel", "Changes", "OfTheRobot", "changing_parameters", "mounting"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

PAYLOAD = "payload"
"""Name of the carried body among the links."""


Changes = Literal["nothing", "friction", "friction-and-offset"]


def changing_parameters(model: Model, changes: Changes = "friction") -> Indices:
    """Return the indices of the joints' parameters that may be other ones while a body is carried.

    Parameters
    ----------
    changes : {"nothing", "friction", "friction-and-offset"}
        Friction is what depends on velocities alone, whatever the terms are called; an offset is constant.

    Raises
    ------
    InputError
        For any other word.

    Examples
    --------
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 1.0, 0, "q")]).with_terms(sy.Viscous(), sy.RotorInertia(), sy.Offset())
    >>> model = sy.Model(robot)
    >>> [model.parameter_names[k] for k in changing_parameters(model)]
    ['Fvj1']
    """
    words = ("nothing", "friction", "friction-and-offset")
    if changes not in words:
        raise InputError(f"changes must be one of {', '.join(words)}, got {changes!r}; {suggestion(changes, words)}")
    if changes == "nothing":
        return np.zeros(0, dtype=np.intp)
    random = np.random.default_rng(20140101)
    q, ddq = random.normal(size=(2, 3, model.dof))
    dq = np.outer([1.0, -1.0, 2.0], random.normal(size=model.dof))  # of both signs, which is all that Coulomb's sees
    plain = model.without_channels  # a body changes no friction by a logged signal
    steady = plain.regressor(q, np.tile(dq[:1], (3, 1)), ddq)
    constant = plain.regressor(q, dq, ddq)
    found = np.all(steady == steady[:1], axis=(0, 1))
    if changes == "friction":
        found &= np.any(constant != constant[:1], axis=(0, 1))
    links = np.concatenate([np.asarray(columns) for columns in model.link_columns])
    places = np.array([model.parameter_names.index(plain.parameter_names[k]) for k in np.flatnonzero(found)], dtype=int)
    return np.setdiff1d(places, links)


@dataclass(frozen=True, eq=False)
class CarriedBody:
    """The place at which a rigid body is fixed to a robot.

    Parameters
    ----------
    model : Model
    link : int
        Index of the moving link that carries it.
    placement : (4, 4) array
        The mounting frame in the frame of that link; the parameters of the body are told in the mounting frame.
    changes : {"nothing", "friction", "friction-and-offset"}
        Which parameters of the joints may be other ones while the body is carried, see `changing_parameters`.
    """

    model: Model
    link: int
    placement: Array = field(default_factory=lambda: np.eye(4), repr=False)
    changes: Changes = "friction"

    @cached_property
    def friction(self) -> Indices:
        """Indices of the friction parameters that may change, (f,)."""
        return changing_parameters(self.model, self.changes)

    @cached_property
    def body_names(self) -> tuple[str, ...]:
        """The ten parameters of the body, numbered as one more link."""
        return tuple(f"{symbol}{len(self.model.robot.links) + 1}" for symbol in INERTIA_SYMBOLS)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The ten parameters of the body, then the friction that is found beside it, (10 + f,)."""
        changed = (f"{self.model.parameter_names[k]} loaded" for k in self.friction)
        return (*self.body_names, *changed)

    @cached_property
    def effects(self) -> Array:
        """The effects of the body and of a change of friction on the robot's base parameters, (n_b, 10 + f)."""
        K = self.model.base_parameters().K
        own = np.asarray(self.model.link_columns[self.link])
        return np.hstack([K[:, own] @ transformation(self.placement), K[:, self.friction]])

    @cached_property
    def base(self) -> BaseParameters:
        """The combinations of the body and of changes of friction that can be told where the robot is known."""
        return base_parameters_of(self.effects, self.names)

    @cached_property
    def shown_effects(self) -> Array:
        """The effects of these combinations on the robot's base parameters, (n_b, r)."""
        return np.asarray(self.effects[:, self.base.independent])

    @cached_property
    def of_robot(self) -> Array:
        """What the robot's base parameters take from the changes in the base parameters of both, (r, n_b).

        Friction is told as it is while the body is carried, not as a change of it.
        """
        place = {int(k): row for row, k in enumerate(self.model.base_parameters().independent)}
        found = np.zeros((self.base.count, self.model.base_parameters().count))
        for column, k in enumerate(self.friction.tolist(), start=10):
            if k in place:
                found[:, place[k]] -= self.base.K[:, column]
        return found

    def body_conditions(self, consistency: str, start: int) -> tuple[AffineBlock, ...]:
        """The condition that the body has a mass density, its parameters beginning at an index."""
        return body_conditions([PAYLOAD], [start], consistency)

    def friction_conditions(self, consistency: str, start: int) -> tuple[AffineBlock, ...]:
        """The conditions of the friction beside the body, its parameters beginning at an index."""
        place = {int(k): start + i for i, k in enumerate(self.friction)}
        found = []
        for block in self.model.conditions(consistency):
            if block.kind == "term" and all(int(k) in place for k in block.indices):
                moved = np.array([place[int(k)] for k in block.indices], dtype=np.intp)
                found.append(replace(block, name=f"{block.name} (loaded)", indices=moved))
        return tuple(found)


class CarryingModel:
    """A robot and the body that it carries, as one model: what feasibility asks of a model (`ModelLike`).

    Its parameters are those of the robot, then the ten of the body, then the friction while it is carried. Its base
    parameters are those of the robot, then what the loaded log shows beyond them.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Coulomb()))
    >>> both = CarryingModel(CarriedBody(model, 0))
    >>> both.parameter_names[-3:], both.base_parameters().names
    (('lz2', 'm2', 'Fcj1 loaded'), ('Lzz1', 'lx1', 'ly1', 'Fcj1', 'Lzz2', 'lx2', 'ly2', 'Fcj1 loaded'))
    """

    def __init__(self, body: CarriedBody) -> None:
        self.body = body
        model = body.model
        unknown = np.full(len(body.names), np.nan)
        self.robot = SimpleNamespace(
            name=f"{model.robot.name} with {PAYLOAD}",
            link_names=(*model.robot.link_names, PAYLOAD),
            parameters=np.concatenate([np.asarray(model.robot.parameters), unknown]),
            joints=model.robot.joints,
            terms=model.robot.terms,
        )
        self.parameter_names: Sequence[str] = (*model.parameter_names, *body.names)

    @cached_property
    def _base(self) -> BaseParameters:
        own, carried, count = self.body.model.base_parameters(), self.body.base, self.body.model.parameter_count
        independent = np.concatenate([own.independent, count + carried.independent])
        dependent = np.concatenate([own.dependent, count + carried.dependent])
        upper = np.hstack([own.Kd, np.zeros((own.count, len(carried.dependent)))])
        # Friction beside the body takes that of the robot alone with it; what this adds in terms of base parameters of
        # the robot is left out, so that the independent parameters keep their own base parameters.
        friction = np.zeros((carried.count, count))
        friction[:, self.body.friction] = -carried.K[:, 10:]
        left = friction[:, own.dependent] - friction[:, own.independent] @ own.Kd
        lower = np.hstack([left, carried.Kd])
        return BaseParameters(tuple(self.parameter_names), independent, dependent, np.vstack([upper, lower]))

    def base_parameters(self) -> BaseParameters:
        """The base parameters of both."""
        return self._base

    def conditions(self, consistency: str) -> tuple[AffineBlock, ...]:
        """The conditions of the robot, of the body, and of the friction beside it."""
        count = self.body.model.parameter_count
        return (
            *self.body.model.conditions(consistency),
            *self.body.body_conditions(consistency, count),
            *self.body.friction_conditions(consistency, count + 10),
        )

    @property
    def maps(self) -> tuple[Array, Array]:
        """From these base parameters to those of the robot: in the log without the body, and in the one with it."""
        count, body = self.body.model.base_parameters().count, self.body
        alone = np.hstack([np.eye(count), np.zeros((count, body.base.count))])
        loaded = np.hstack([np.eye(count) + body.shown_effects @ body.of_robot, body.shown_effects])
        return alone, loaded


@dataclass(frozen=True, eq=False)
class OfTheRobot:
    """A constraint on the robot alone, as one on the robot and what it carries.

    The parameters of the model, which is of the robot alone, come first.
    """

    constraint: Constraint
    model: Model

    def blocks(self, model: Any) -> tuple[AffineBlock, ...]:
        """Matrices that must be positive semidefinite."""
        return self.constraint.blocks(self.model)

    def equalities(self, model: Any) -> tuple[Equality, ...]:
        """Equations that must hold."""
        return self.constraint.equalities(self.model)


def mounting(model: Model, frame: str | None, placement: ArrayLike | None) -> tuple[int, Array, str]:
    """Find the link and the mounting frame of a payload.

    Parameters
    ----------
    model : Model
    frame : str, optional
        A link of the description that moves, or one that is fixed to such a link; the last moving link where absent.
    placement : array_like, optional
        (4, 4) of the mounting frame in that frame; the same where absent.

    Returns
    -------
    link : int
    placement : (4, 4) array
    name : str
        Of the frame.

    Raises
    ------
    InputError
        If there is no such link, it does not move, it is not clear which link is the last, or a placement is none.
    """
    robot = model.robot
    if frame is None:
        ends = [robot.link_names[k] for k in robot.end_links]
        if len(ends) > 1:
            raise InputError(
                f"{robot.name} has several last links, {', '.join(ends)}; say which frame the payload is mounted in, "
                "with --frame or frame = ... in [payload]."
            )
        frame = ends[0]
    link, place = robot.frame(frame)
    if link < 0:
        raise InputError(
            f"The payload is said to be mounted in {frame!r} of {robot.name}, which does not move, so that no motion "
            "shows it; name a link that a joint moves."
        )
    inner = np.eye(4) if placement is None else np.asarray(read_placement(placement, "placement"))
    return link, np.asarray(place @ inner), frame
