"""Which links of a description no body can be: by eigenvalues of pseudo-inertias, from the raw numbers of the file."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from steelyard.identification.preflight import preflight
from steelyard.robot import Robot
from steelyard.robot.urdf_document import urdf_content

CLEAR = 1e-7
"""Of the trace: eigenvalues nearer to zero are the rounding of what is written."""

KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
Body = tuple[str, float, np.ndarray]


def _tensor(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> np.ndarray:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def bodies_of_urdf(path: Path) -> Iterator[Body]:
    """Yield name, mass and inertia about the centre of mass of the links of a URDF."""
    for link in ElementTree.fromstring(urdf_content(path)).iter():
        held = next((one for one in link if one.tag.endswith("inertial")), None) if link.tag.endswith("link") else None
        if held is not None:
            parts = {one.tag.split("}")[-1]: one for one in held}
            moments = [float(parts["inertia"].get(key, "nan")) for key in KEYS]
            yield link.get("name", ""), float(parts["mass"].get("value", "nan")), _tensor(*moments)


def bodies_of_sdf(path: Path) -> Iterator[Body]:
    """Yield name, mass and inertia about the centre of mass of the links of an SDF without nested models."""
    for link in ElementTree.parse(path).getroot().iter("link"):
        held = link.find("inertial")
        if held is not None:
            moments = [float(held.findtext(f"inertia/{key}") or float(key in ("ixx", "iyy", "izz"))) for key in KEYS]
            yield link.get("name", ""), float(held.findtext("mass") or 1.0), _tensor(*moments)


def bodies_of_mjcf(path: Path) -> Iterator[Body]:
    """Yield name, mass and inertia of the bodies of an MJCF that have an inertial, as MuJoCo parses them."""
    import mujoco

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of settings that are out of date
        try:
            spec = mujoco.MjSpec.from_file(str(path))
        except ValueError:
            return
    if (
        spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        or spec.compiler.balanceinertia
    ):
        return
    if max(spec.compiler.boundmass, spec.compiler.boundinertia) > 0.0:
        return
    for body in spec.bodies:
        if body.explicitinertial and body.name:
            xx, yy, zz, xy, xz, yz = body.fullinertia
            full = np.isfinite(body.fullinertia).all()
            yield body.name, float(body.mass), _tensor(xx, xy, xz, yy, yz, zz) if full else np.diag(body.inertia)


READERS = {"urdf": bodies_of_urdf, "xacro": bodies_of_urdf, "sdf": bodies_of_sdf, "mjcf": bodies_of_mjcf}


def is_possible(mass: float, about_com: np.ndarray) -> bool | None:
    """Whether a body can have a mass and an inertia about its centre of mass; None within rounding of the bound."""
    second = 0.5 * np.trace(about_com) * np.eye(3) - about_com
    size = np.trace(np.abs(second))
    if mass == 0.0 or size == 0.0:
        return None  # a frame, or a point
    # With a unit of length in which mass and moments are alike.
    pseudo = np.zeros((4, 4))
    pseudo[:3, :3], pseudo[3, 3] = second / size, np.sign(mass)
    least = np.linalg.eigvalsh(pseudo)[0]
    return None if abs(least) < CLEAR else bool(least > 0.0)


def disagreements(robot: Robot, path: Path, kind: str) -> tuple[int, int, list[str]]:
    """Compare with what `inspect` says of links: how many are judged, how many impossible, and what differs."""
    # Shapes tell causes, not what is possible; without them no mesh is read.
    told = {one.link: one.possible for one in preflight(replace(robot, source=None)).links}
    fixed = {robot.base_link, *(one.name for one in robot.base_attachments)}
    moving = {name for link in robot.links for name in (link.name, *link.absorbed)}
    judged = impossible = 0
    differing = []
    for name, mass, tensor in READERS[kind](path):
        expected = is_possible(mass, tensor)
        if expected is None or name in fixed or name not in moving:
            continue
        judged += 1
        impossible += not expected
        if told.get(name) != expected:
            differing.append(f"{name}: {told.get(name)} is said to be possible, {expected} is right")
    return judged, impossible, differing
