"""Changes that an estimate makes to a description of any format: inertias of links, and friction of joints."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files import listed

from .inertia import Inertia, pseudo_inertia
from .joint import Attachment, Link
from .robot import Robot
from .xml_edit import number_text

__all__ = [
    "DescriptionChanges",
    "description_changes",
    "is_same",
    "moment_texts",
    "remark_on_held",
    "require_robot",
    "require_target",
]

Matrix = NDArray[np.float64]

# What differs by less, relative to a value, or to mass and second moments, is the rounding of sums.
SAME = 1e-12
MOST_NAMED = 3


@dataclass(frozen=True)
class DescriptionChanges:
    """The values that are written into a description; values that an estimate leaves as they are do not appear.

    Parameters
    ----------
    inertias : dict
        The inertia for the element of a link, by its name. It is the whole one that moves with the link, without what
        hangs on locked joints; these are among them where they keep a part of theirs alone.
    emptied : tuple of str
        Names of links that are fixed to those: they have no inertia of their own then.
    drives : dict
        The values for a joint, by its name.
    """

    inertias: dict[str, Inertia]
    emptied: tuple[str, ...]
    drives: dict[str, dict[str, float]]

    def __bool__(self) -> bool:
        return bool(self.inertias or self.emptied or self.drives)


def description_changes(robot: Robot, parameters: ArrayLike, drives: Mapping[str, ArrayLike]) -> DescriptionChanges:
    """Return what parameters change in the description of a robot.

    Parameters
    ----------
    robot : Robot
        As it was read from the description.
    parameters : (n,) array
        Values of `robot.parameter_names`.
    drives : mapping from name to (N,) array
        Names of fields of `Joint`, such as ``damping``, and their values for each coordinate, all joints that mimic its
        own together; NaN leaves a value as it was.

    Raises
    ------
    InputError
        When an array has the wrong size, a link's mass is not positive, a link that carries others on locked joints is
        no possible body, or a value of a joint is negative.
    """
    values = _vector(parameters, len(robot.parameter_names), "parameters")
    inertias: dict[str, Inertia] = dict(robot.base_mended)
    emptied: list[str] = []
    for link, start in zip(robot.links, robot.link_starts, strict=True):
        if link.inertia is None or not is_same(link.inertia.parameters, values[start : start + 10]):
            inertias |= _inertias_of(link, values[start : start + 10])
            emptied += [one.name for one in link.attachments if not one.locked]
    changed: dict[str, dict[str, float]] = {}
    for name, given in drives.items():
        wanted = _vector(given, robot.dof, name)
        for joint in robot.joints:
            value, felt = float(wanted[joint.coordinate]), getattr(robot.felt_joints[joint.coordinate], name)
            if np.isnan(value) or abs(value - felt) <= SAME * abs(felt):
                continue
            if not 0.0 <= value < np.inf:
                raise InputError(
                    f'joint "{joint.name}": its {name.replace("_", " ")} is {value:g}, but it must be finite and at '
                    "least 0; constrain it when fitting, or give NaN to leave the description's value"
                )
            if joint.mimics is None:
                changed.setdefault(joint.name, {})[name] = value
            elif not np.isnan(getattr(joint, name)):
                # The value of the coordinate is the whole one, that of the mimic joints too.
                changed.setdefault(joint.name, {})[name] = 0.0
    return DescriptionChanges(inertias, tuple(emptied), changed)


def require_target(source: Path, target: Path, robot: Robot, kind: str) -> None:
    """Refuse a target that is the description itself (`kind`, such as "URDF"), a folder, or in no folder."""
    for given in {source, robot.source or source}:
        if target.resolve() == given.resolve() or (target.exists() and given.exists() and target.samefile(given)):
            raise InputError(f"{target}: this is the {kind} that was read, which is never changed; give another target")
    if target.is_dir():
        raise InputError(f"{target}: this is a folder; give the name of a file")
    if not target.parent.is_dir():
        raise InputError(f"{target}: the folder {target.parent} does not exist; make it first")


def require_robot(
    source: Path, robot: Robot, kind: str, links: Container[str], joints: Container[str], noun: str = "link"
) -> None:
    """Refuse a description (`kind`, such as "URDF") without a link (`noun`) or a joint of the robot."""
    for what, names, known in (
        (noun, [name for link in robot.links for name in (link.name, *link.absorbed)], links),
        ("joint", [joint.name for joint in robot.joints], joints),
    ):
        absent = next((name for name in names if name not in known), None)
        if absent is not None:
            raise InputError(
                f'{source}: it has no {what} "{absent}" of robot "{robot.name}"; give the {kind} that the robot was '
                "read from"
            )


def moment_texts(inertia: Inertia) -> dict[str, str]:
    """Return the moments about the center of mass as they are written, by the names of URDF and SDF."""
    second = inertia.about_com
    return {
        f"i{'xyz'[row]}{'xyz'[column]}": number_text((second[row, column] + second[column, row]) / 2)
        for row in range(3)
        for column in range(row, 3)
    }


def _vector(values: ArrayLike, size: int, name: str) -> Matrix:
    array = np.asarray(values, dtype=float)
    if array.shape != (size,):
        raise InputError(f"{name} must have shape ({size},), got {array.shape}")
    return array


def is_same(old: Matrix, new: Matrix, tolerance: float = SAME) -> bool:
    """Tell whether the ten parameters of two bodies are the same, relative to mass and largest second moment."""
    old, new = pseudo_inertia(old), pseudo_inertia(new)
    scale = np.sqrt(np.abs(np.diagonal(old)))
    scale[:3] = scale[:3].max()
    return bool((np.abs(new - old) <= tolerance * np.outer(scale, scale)).all())


def remark_on_held(robot: Robot, parameters: ArrayLike) -> str:
    """Say which links on locked joints are written with a part of their inertia alone; else nothing.

    Parameters
    ----------
    robot : Robot
        As it was read from the description.
    parameters : (n,) array
        Values of `robot.parameter_names`.
    """
    values, found = _vector(parameters, len(robot.parameter_names), "parameters"), []
    for link, start in zip(robot.links, robot.link_starts, strict=True):
        held = _held(link)
        try:
            share = _share_of_held(link, Inertia.from_parameters(values[start : start + 10]), held)
        except InputError:  # which is told where it is written
            continue
        if share < 1.0:
            found.append(f"{listed([one.name for one, _ in held], MOST_NAMED)} with {share:.2g} of it, for {link.name}")
    if not found:
        return ""
    return (
        f"The description is written with less inertia behind locked joints ({'; '.join(found)}): with all that it "
        "says of them, no possible body would remain of the estimate for the link that carries them. The sum is the "
        "estimate where the joints are locked; elsewhere it is as right as the description is."
    )


def _inertias_of(link: Link, parameters: Matrix) -> dict[str, Inertia]:
    """The inertias to write for a link and what it carries on locked joints, by the names of their elements.

    What hangs on locked joints keeps its own inertia, which is taken from the estimate, since a simulator may move it;
    it is written only where it takes a part of that, see `_share_of_held`.
    """
    if not np.isfinite(parameters).all():
        raise InputError(f'link "{link.name}": its parameters must be finite, got {parameters.tolist()}')
    inertia = Inertia.from_parameters(parameters)
    if inertia.mass <= 0.0:
        raise InputError(
            f'link "{link.name}": its mass is {inertia.mass:g} kg, which no body has; '
            "write the estimate of a feasible fit or correction"
        )
    held = _held(link)
    share = _share_of_held(link, inertia, held)
    parts = {one.name: Inertia.from_parameters(share * own.parameters) for one, own in held} if share < 1.0 else {}
    for one, own in held:
        inertia = inertia - parts.get(one.name, own).moved(one.placement)
    return {link.name: inertia, **parts}


def _held(link: Link) -> list[tuple[Attachment, Inertia]]:
    return [(one, one.inertia) for one in link.attachments if one.locked and one.inertia is not None]


def _share_of_held(link: Link, estimate: Inertia, held: list[tuple[Attachment, Inertia]]) -> float:
    """What of their inertia links on locked joints keep: all, or as much as leaves half of the estimate to the link.

    The half is of the pseudo-inertia, in every direction. A share of the whole estimate for each of them would be
    possible as well, but their centres of mass would no longer be where the description has them.
    """
    whole = sum((own.moved(one.placement).pseudo_inertia for one, own in held), np.zeros((4, 4)))
    rest = np.linalg.eigvalsh(estimate.pseudo_inertia - whole)
    if not held or rest[0] > 0.0:
        return 1.0
    try:
        root = np.linalg.inv(np.linalg.cholesky(estimate.pseudo_inertia))
    except np.linalg.LinAlgError:
        raise InputError(
            f'link "{link.name}": without {listed([one.name for one, _ in held], MOST_NAMED)}, which hang on locked '
            f"joints and keep their inertia, its estimate would have a pseudo-inertia with the eigenvalue {rest[0]:g}, "
            "which no body has; write the estimate of a feasible fit or correction"
        ) from None
    return float(0.5 / np.linalg.eigvalsh(root @ whole @ root.T)[-1])
