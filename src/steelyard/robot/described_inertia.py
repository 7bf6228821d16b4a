"""Judgement of the inertials of a description, and the nearest possible inertials where no body can have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.files import listed

from .inertia import Inertia, parameters_of_pseudo_inertia, pseudo_inertia
from .robot import Robot

__all__ = ["ROUNDING", "DescribedBody", "described_bodies", "possible_body", "remark_on_base", "standing_bodies"]

Array = NDArray[np.float64]

THINNEST = 0.05
"""Least radius of gyration of a link relative to its largest: of 80 links of 12 arms three have less."""

LEAST_GYRATION = 1e-3
"""m; a link of which the description says less has moments of inertia that were left out."""

ALIKE = 3
"""So many links of one arm, all with the same inertial about their frame's origin, were never weighed."""

ROUNDING = -1e-9  # of the largest second moment: what few digits do

_EQUAL = 1e-9


@dataclass(frozen=True, eq=False)
class DescribedBody:
    """The inertial that a description gives to one of its links, in the frame of that link.

    Attributes
    ----------
    name : str
        The link of the source.
    placement : (4, 4)
        Its frame in that of the moving link.
    inertia : Inertia or None
        What the description says; None where it says nothing.
    problem : str
        Why it cannot be believed, as in "is a placeholder (1 kg, ...)"; empty where it can.
    """

    name: str
    placement: Array
    inertia: Inertia | None
    problem: str = ""

    @property
    def is_usable(self) -> bool:
        """Whether its mass can be believed."""
        return self.inertia is not None and not self.problem

    @property
    def parameters(self) -> Array:
        """The ten parameters in the frame of the moving link, (10,)."""
        assert self.inertia is not None
        return self.inertia.moved(self.placement).parameters


def described_bodies(robot: Robot) -> list[list[DescribedBody]]:
    """Return what the description says of every moving link: of the link itself, then of each link that is fixed to it.

    Placeholders that are recognised: no mass; the same round moment of inertia about every axis with a round mass and
    the centre of mass in the frame's origin, as templates, simulators' examples and exporters leave them; one inertial
    that all links of an arm share.

    Examples
    --------
    >>> [part.inertia for part in described_bodies(Robot.from_dh([(0, 0.5, 0, "q")]))[0]]
    [None]
    """
    # Each link is on the one before it; the four rotors of a quadrotor are alike for a reason.
    is_one_arm = all(joint.parent == index - 1 for index, joint in enumerate(robot.joints))
    shared = is_one_arm and _shared([link.inertia for link in robot.links])
    found = []
    for link in robot.links:
        # A robot that was built in code may have a total alone.
        parts = [(link.name, np.eye(4), link.own_inertia)]
        parts += [(one.name, one.placement, one.inertia) for one in link.attachments]
        if not _adds_up(link.inertia, parts):
            parts = [(link.name, np.eye(4), link.inertia)]
        bodies = [DescribedBody(name, placement, part, _placeholder(part)) for name, placement, part in parts]
        if shared and not bodies[0].problem:
            bodies[0] = replace(bodies[0], problem=f"is the same for {len(robot.links)} links")
        found.append(bodies)
    return found


def standing_bodies(robot: Robot) -> list[DescribedBody]:
    """Return the base, and what is fixed to it, where moments of inertia are such as no body has."""
    parts = [DescribedBody(robot.base_link, np.eye(4), robot.base_inertia)]
    parts += [DescribedBody(one.name, one.placement, one.inertia) for one in robot.base_attachments]
    found = []
    for part in parts:
        if part.inertia is not None and part.inertia.mass > 0.0:
            tensor = part.inertia.about_com
            values = np.linalg.eigvalsh(0.5 * np.trace(tensor) * np.eye(3) - tensor)
            if values[0] < ROUNDING * max(values[-1], 0.0):
                found.append(part)
    return found


def remark_on_base(robot: Robot) -> str:
    """Say that simulators refuse the description for a body that stands still, and what mends it; else nothing.

    What is identified says nothing of such a body, and leaves it as it is.
    """
    names = [part.name for part in standing_bodies(robot)]
    if not names or robot.source is None:
        return ""
    has = "stands still and has" if len(names) == 1 else "stand still and have"
    return (
        f"{listed(names)} {has} moments of inertia that no body has, in the description and in what is written: the "
        "motion tells nothing of them, but simulators such as MuJoCo refuse the file. Mend it by: steelyard inspect "
        f"{robot.source} --repair --output REPAIRED{robot.source.suffix}"
    )


def _adds_up(total: Inertia | None, parts: Sequence[tuple[str, Array, Inertia | None]]) -> bool:
    """Return whether the total of a link is the sum of its parts; it counts alone where somebody has changed it."""
    if total is None:
        return True
    known = [part.moved(placement).parameters for _, placement, part in parts if part is not None]
    return bool(np.allclose(np.sum(known, axis=0) if known else np.zeros(10), total.parameters, rtol=1e-9, atol=1e-12))


def _placeholder(inertia: Inertia | None) -> str:
    if inertia is None:
        return ""
    if not inertia.mass > 0.0:
        return f"has no mass ({inertia.mass:g} kg)" if inertia.mass == 0.0 else f"has a mass of {inertia.mass:g} kg"
    moment = _isotropic_moment(inertia)
    if moment is None or moment == 0.0 or not _is_round(moment) or not _is_round(inertia.mass):
        return ""
    if np.abs(inertia.first_moment).max() > _EQUAL * inertia.mass:
        return ""
    return f"is a placeholder ({inertia.mass:g} kg, {moment:g} kg m² about every axis)"


def _isotropic_moment(inertia: Inertia) -> float | None:
    """The moment of inertia about the centre of mass, where it is the same about every axis."""
    tensor = inertia.about_com
    moment = float(np.trace(tensor)) / 3.0
    size = max(abs(moment), np.finfo(float).tiny)
    return moment if np.abs(tensor - moment * np.eye(3)).max() <= _EQUAL * size else None


def _is_round(value: float) -> bool:
    """Return whether a number has one digit alone."""
    return abs(float(f"{value:.0e}") - value) <= _EQUAL * abs(value)


def _shared(inertias: Sequence[Inertia | None]) -> bool:
    """Whether all the links have one inertial, which is about the origin of their frames or the same about all axes."""
    if len(inertias) < ALIKE:
        return False
    values = [inertia.parameters for inertia in inertias if inertia is not None]
    if len(values) < len(inertias) or not np.allclose(values, values[0], rtol=_EQUAL, atol=0.0):
        return False
    first = inertias[0]
    assert first is not None
    at_origin = np.abs(first.first_moment).max() <= _EQUAL * first.mass
    return first.mass > 0.0 and bool(at_origin or _isotropic_moment(first) is not None)


def possible_body(parameters: Array, shape: Array) -> tuple[Array, str]:
    """The nearest body that can exist, with the same mass and centre of mass.

    The second moments about the centre of mass, a 3 x 3 matrix, become the nearest (in the Frobenius norm) without
    principal values below those of a body of a least thickness.

    Parameters
    ----------
    parameters : (10,)
        With a positive mass.
    shape : (4, 4)
        Pseudo-inertia of a body whose second moments are taken where the description gives none.

    Returns
    -------
    (10,)
    str
        What was wrong, as the end of a sentence about moments of inertia; empty where nothing was.

    Examples
    --------
    A rod of 1 kg and 0.6 m without thickness:

    >>> body, problem = possible_body(np.array([0.03, 0, 0, 0.03, 0, 0.0, 0, 0, 0, 1.0]), np.eye(4))
    >>> body.round(6).tolist()[:6], problem
    ([0.030075, 0.0, 0.0, 0.030075, 0.0, 0.00015], 'belong to a body thinner than links are')
    """
    matrix = pseudo_inertia(parameters)
    mass, first = matrix[3, 3], matrix[:3, 3]
    second = matrix[:3, :3] - np.outer(first, first) / mass
    values, axes = np.linalg.eigh(second / mass)
    if np.abs(values).max() < LEAST_GYRATION**2:
        about = shape[:3, :3] - np.outer(shape[:3, 3], shape[:3, 3]) / shape[3, 3]
        values, axes = np.linalg.eigh(about / shape[3, 3])
        problem = "are zero"
    else:
        least = max(THINNEST**2 * float(np.abs(values).max()), LEAST_GYRATION**2)
        if values[0] >= least:
            return parameters, ""
        # What was written with few digits is not wrong for that.
        problem = "belong to no body" if values[0] < -0.02 * values[2] else "belong to a body thinner than links are"
        values = np.maximum(values, least)
    matrix = matrix.copy()
    matrix[:3, :3] = mass * (axes * values) @ axes.T + np.outer(first, first) / mass
    return np.asarray(parameters_of_pseudo_inertia(matrix)), problem
