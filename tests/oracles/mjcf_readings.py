"""Our own reading of an MJCF beside what MuJoCo compiles of it."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.robot.mjcf_compiled import CompiledMjcf, compiled
from steelyard.robot.mjcf_document import MjcfDocument, read_mjcf_document
from steelyard.robot.mjcf_reading import BeyondReadingError, read_compiled
from steelyard.robot.mjcf_remarks import mjcf_remarks

TOLERANCE = 1e-9


def _major_version() -> int:
    try:
        return int(version("mujoco").split(".")[0])
    except PackageNotFoundError:
        return 0


EXACT = pytest.mark.skipif(
    _major_version() < 4,
    reason="MuJoCo 4 (the oracle) is not installed; 3.2 has axes of inertias to 1e-6, and takes no backslash in a path "
    "and no powers of the speed in damping",
)
ON_LIMITS = {"range": "limited", "actfrcrange": "actfrclimited"}
OF_SITES = 6
NUMBERS = ("ref", "pos", "armature", "damping", "friction", "stiffness", "range", "actfrcrange")


def readings(path: Path) -> tuple[MjcfDocument, CompiledMjcf | Exception, CompiledMjcf | Exception]:
    """Return a document, our own reading of it, and that of MuJoCo, or why there is none."""
    document = read_mjcf_document(path)
    found: list[CompiledMjcf | Exception] = []
    for reader in (read_compiled, compiled):
        try:
            found.append(reader(document))
        except (InputError, BeyondReadingError) as error:
            found.append(error)
    return document, found[0], found[1]


def differences(document: MjcfDocument, ours: CompiledMjcf, theirs: CompiledMjcf) -> list[str]:
    """Return in what two readings differ, beyond rounding; empty where in nothing that concerns a robot."""
    found: list[str] = []

    def compare(what: str, one, other, scale: float = 1.0) -> None:
        if not np.allclose(one, other, rtol=TOLERANCE, atol=TOLERANCE * scale):
            found.append(f"{what}: {one} and {other}")

    def same(what: str, one, other) -> None:
        if one != other:
            found.append(f"{what}: {one} and {other}")

    compare("gravity", ours.gravity, theirs.gravity)
    moving = theirs.moving()
    for index, (one, other) in enumerate(zip_longest(ours.bodies, theirs.bodies, fillvalue={})):
        name = other.get("name")
        for key in ("name", "parentid"):
            same(f"{key} of body {name}", one.get(key), other.get(key))
        if one and other:
            same(f"mocap of {name}", one["mocapid"] >= 0, other["mocapid"] >= 0)
            for key in ("placement", "gravcomp"):
                compare(f"{key} of {name}", one[key], other[key])
            if index in moving:
                values = [row["inertia"].parameters for row in (one, other)]
                compare(f"inertia of {name}", *values, max(np.abs(values[1]).max(), 1e-3))
    for index, (one, other) in enumerate(zip_longest(ours.joints, theirs.joints, fillvalue={})):
        name, kind = other.get("name"), other.get("type")
        for key in ("name", "type", "bodyid", "limited", "actfrclimited", "poly"):
            same(f"{key} of joint {name}", one.get(key), other.get(key))
        for key, value in theirs.of_actuators(index).items():
            compare(f"{key} by the actuators of {name}", ours.of_actuators(index)[key], value)
        if one and other and kind in (2, 3):  # free and ball joints have neither axis nor reference
            for key in (*NUMBERS, "axis"):
                if key not in ON_LIMITS or other[ON_LIMITS[key]]:
                    compare(f"{key} of {name}", one[key], other[key])
    for one, other in zip_longest(ours.equalities, theirs.equalities, fillvalue={}):
        for key in ("name", "type", "active0"):
            same(f"{key} of an equality", one.get(key), other.get(key))
        if one and other and other["objtype"] != OF_SITES:
            for key in ("obj1id", "obj2id"):
                same(f"{key} of an equality", one[key], other[key])
            if other["type"] in (2, 3):
                compare("polynomial", one["data"][:5], other["data"][:5])
    for one, other in zip_longest(ours.tendons, theirs.tendons, fillvalue={}):
        for key in ("name", "joints", "is_spatial"):
            same(f"{key} of a tendon", one.get(key), other.get(key))
    if not found:
        names = [
            [[row["name"] or f"{noun}{index}" for index, row in enumerate(rows)] for noun, rows in pairs]
            for pairs in ((("body", one.bodies), ("joint", one.joints)) for one in (ours, theirs))
        ]
        same("remarks", mjcf_remarks(document, ours, *names[0]), mjcf_remarks(document, theirs, *names[1]))
    return found
