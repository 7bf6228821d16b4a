"""Defects of descriptions, planted into the inertials of a URDF."""

from __future__ import annotations

import sysconfig
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from steelyard.robot import Inertia, Robot

ROBOTS = ("z1_description/urdf/z1.urdf", "xarm_description/urdf/xarm7.urdf")


def installed() -> Path:
    """The folder of the robots of example-robot-data."""
    return Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"


def made(mass, com, tensor) -> Inertia:
    return Inertia.from_com(float(mass), com, tensor)


def slipped(tensor, place, factor):
    changed = np.array(tensor)
    changed[place, place] *= factor
    return changed


def steiner(mass, com):
    return mass * (com @ com * np.eye(3) - np.outer(com, com))


def products_flipped(tensor):
    return 2.0 * np.diag(np.diagonal(tensor)) - tensor


def swapped(tensor):
    """The largest and the smallest moment exchanged."""
    order = np.argsort(np.diagonal(tensor))
    places = np.arange(3)
    places[[order[0], order[2]]] = places[[order[2], order[0]]]
    return tensor[np.ix_(places, places)]


Change = Callable[[float, np.ndarray, np.ndarray, np.ndarray], Inertia]
DEFECTS: dict[str, tuple[Change, str]] = {
    "mass in g": (lambda m, c, A, R: made(1e3 * m, c, A), "unit: mass in g"),
    "mass and inertia in g": (lambda m, c, A, R: made(1e3 * m, c, 1e3 * A), "unit: mass and inertia in g"),
    "lengths in mm": (lambda m, c, A, R: made(m, 1e3 * c, 1e6 * A), "unit: lengths in mm"),
    "centre of mass in mm": (lambda m, c, A, R: made(m, 1e3 * c, A), "unit: centre of mass in mm"),
    "inertia in kg mm²": (lambda m, c, A, R: made(m, c, 1e6 * A), "unit: inertia in kg mm²"),
    "inertia in g mm²": (lambda m, c, A, R: made(m, c, 1e9 * A), "unit: inertia in g mm²"),
    "decimal slip of the mass": (lambda m, c, A, R: made(10 * m, c, A), "decimal slip of the mass"),
    "decimal slip of ixx": (lambda m, c, A, R: made(m, c, slipped(A, 0, 10.0)), "decimal slip of ixx"),
    "decimal slip of izz": (lambda m, c, A, R: made(m, c, slipped(A, 2, 10.0)), "decimal slip of izz"),
    "signs of products": (lambda m, c, A, R: made(m, c, products_flipped(A)), "sign of"),
    "swapped axes": (lambda m, c, A, R: made(m, c, swapped(A)), "swapped axes"),
    "about the origin": (lambda m, c, A, R: made(m, c, A + steiner(m, c)), "inertia about the origin"),
    "axes of the base": (lambda m, c, A, R: made(m, R @ c, R @ A @ R.T), "inertia in the axes of the base"),
    "copied link": (lambda m, c, A, R: made(m, c, A), "copied link"),
    "placeholder": (lambda m, c, A, R: made(1.0, np.zeros(3), np.eye(3)), "placeholder"),
}


def weight(defect: str, m, c, A, R) -> float:
    """How much a defect matters in a link."""
    values = np.linalg.eigvalsh(A)
    apart = values[2] / max(values[0], 1e-12)
    match defect:
        case "signs of products":
            scale = np.sqrt(np.outer(np.diagonal(A), np.diagonal(A)))
            return float(np.abs(A / scale - np.eye(3)).max())
        case "about the origin":
            return float(m * (c @ c) / values[2])
        case "axes of the base":
            return float(np.linalg.norm(R @ A @ R.T - A) / np.linalg.norm(A)) + float(np.linalg.norm(R @ c - c))
        case "swapped axes":
            diagonal = np.sort(np.diagonal(A))
            return float(diagonal[2] / diagonal[0])
    return float(apart)


def planted(path: Path, defect: str) -> tuple[Robot, str]:
    """Return a robot with a defect in the link where it matters most, and the name of the link."""
    robot = Robot.from_urdf(path)
    axes, parts = [], []
    for joint, link in zip(robot.joints, robot.links, strict=True):
        above = np.eye(3) if joint.parent < 0 else axes[joint.parent]
        axes.append(above @ joint.placement(0.0)[:3, :3])
        own = link.own_inertia
        parts.append((own.mass, own.com, own.about_com, axes[-1]))
    index = max(range(len(parts)), key=lambda k: weight(defect, *parts[k]))
    if defect == "copied link":
        index, source = 2, 1
        changed = made(*parts[source][:3])
    else:
        changed = DEFECTS[defect][0](*parts[index])
    links = list(robot.links)
    old = links[index]
    total = old.inertia - old.own_inertia + changed
    links[index] = replace(old, own_inertia=changed, inertia=total)
    return replace(robot, links=tuple(links)), old.name


def named(cause: str, defect: str) -> bool:
    """Whether the cause that was named is that of the defect."""
    return cause.startswith(DEFECTS[defect][1])
