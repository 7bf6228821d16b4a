"""The section [constraints] of a robot file: its tables, and the numbers, vectors and placements in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError, faults_told
from steelyard.extensions import Extensions
from steelyard.files import TomlTable, made_from_table, read_number, shown, suggestion
from steelyard.regression import Estimate
from steelyard.robot.placement import rpy_rotation

from .. import constraints
from .constraint import Constraint

__all__ = [
    "CONSTRAINTS",
    "constraints_from_dict",
    "read_placement",
    "read_quantity",
    "read_rotation",
    "read_vector",
    "table",
]

Matrix = npt.NDArray[np.float64]
Rows = tuple[tuple[float, ...], ...]

_ROTATION_ERROR = 1e-6
"""Rows of a matrix that was written with six digits are orthogonal and of length 1 to about this."""


def _checked_constraint(name: str, offered: object) -> type[Constraint]:
    if isinstance(offered, type) and all(callable(getattr(offered, key, None)) for key in ("blocks", "equalities")):
        return offered
    raise TypeError(f"expected a class with the methods blocks and equalities, got {shown(offered)}")


CONSTRAINTS: Extensions[type[Constraint]] = Extensions(
    "constraints",
    "constraint",
    {
        "total_mass": f"{__package__}.masses:TotalMass",
        "measured_mass": f"{__package__}.masses:MeasuredMass",
        "linear_bound": f"{__package__}.linear:LinearBound",
        "confidence_interval": f"{__package__}.linear:ConfidenceInterval",
        "center_of_mass_box": f"{__package__}.center_of_mass:CenterOfMassBox",
        "center_of_mass_sphere": f"{__package__}.center_of_mass:CenterOfMassSphere",
        "center_of_mass_hull": f"{__package__}.center_of_mass:CenterOfMassHull",
        "density_in_box": f"{__package__}.density:DensityInBox",
        "density_in_ellipsoid": f"{__package__}.density:DensityInEllipsoid",
        "symmetric_link": f"{__package__}.symmetry:SymmetricLink",
        "equal_links": f"{__package__}.symmetry:EqualLinks",
    },
    _checked_constraint,
)
"""By the key under ``[constraints]``; a file is imported when one of its kinds is asked for."""


def constraints_from_dict(
    section: Mapping[str, Any], folder: str | Path | None = None, *, allow_extensions: bool = False
) -> tuple[Constraint, ...]:
    """Constraints from the ``[constraints]`` section of ``robot.toml``.

    Parameters
    ----------
    section : mapping
        For each kind (``total_mass``, ``measured_mass``, ``linear_bound``, ``confidence_interval``,
        ``center_of_mass_box``, ``center_of_mass_sphere``, ``center_of_mass_hull``, ``density_in_box``,
        ``density_in_ellipsoid``, ``symmetric_link``, ``equal_links``, one that a package adds, or ``"module:Class"``) a
        table, or a list of tables.
    folder : str or Path, optional
        Folder of the robot file, to which paths are relative; by default the working directory.
    allow_extensions : bool
        Whether a class that the section names by its import path may be imported.

    Raises
    ------
    InputError
        For unknown, forbidden or missing keys and impossible values.
    MissingExtraError
        If a mesh is to be read without trimesh.

    Examples
    --------
    >>> constraints_from_dict({"total_mass": {"maximum": 27.0}})
    (TotalMass(maximum=27.0),)
    """
    place = None if folder is None else Path(folder)
    found: list[Constraint] = []
    for key, entries in TomlTable(section, "[constraints]", None).items():
        kind = CONSTRAINTS.at(key, "[constraints]", allow_extensions) if ":" in key else CONSTRAINTS.get(key)
        if kind is None:
            close = suggestion(key, CONSTRAINTS.names())
            raise InputError(f"[constraints]: {shown(key)} is no kind of constraint; {close}")
        for entry in entries if isinstance(entries, (list, tuple)) else [entries]:
            if key == "confidence_interval" and isinstance(entry, Mapping) and "estimate" in entry:
                found.extend(_of_estimate(entry, place))
            else:
                found.append(_made(kind, key, entry, place))
    return tuple(found)


def _made(kind: type[Constraint], key: str, entry: Any, folder: Path | None) -> Constraint:
    """One constraint: by the method ``from_dict(entry, folder)`` of its class, or else with its keys as arguments."""
    reader: Callable[[Any, Path | None], Constraint] | None = getattr(kind, "from_dict", None)
    if key in CONSTRAINTS.own:
        return _of_ours(kind, key, entry) if reader is None else reader(entry, folder)
    where = f"[[constraints.{key}]]"
    given = TomlTable(entry, where, None)
    if reader is None:
        return made_from_table(kind, given, where)
    with faults_told(f"{where} cannot be used", "correct its keys, or mend its package"):
        return reader(entry, folder)


def _of_ours(kind: Any, key: str, entry: Any) -> Constraint:
    """One constraint of ours, whose fields are the keys of its table, but for those that its `repr` leaves out."""
    keys = {one.name: one.default is MISSING for one in fields(kind) if one.repr}
    required = [name for name, needed in keys.items() if needed]
    made: Constraint = kind(**table(entry, key, required, [name for name in keys if name not in required]))
    return made


def _of_estimate(entry: Mapping[str, Any], folder: Path | None) -> tuple[Constraint, ...]:
    """The confidence intervals of a saved estimate."""
    given = table(entry, "confidence_interval", ("estimate",), ("deviations", "combinations"))
    path = given.text("estimate", "a path") or ""
    combinations = given.get("combinations")
    if combinations is not None and not isinstance(combinations, list):
        raise given.refuse("combinations", "a list of texts")
    return constraints.confidence_intervals(
        Estimate.load(Path(folder or ".") / path), given.get("deviations", 3.0), combinations
    )


def table(entry: Any, kind: str, required: Sequence[str] = (), optional: Sequence[str] = ()) -> TomlTable:
    """A table of ``[constraints]`` with all of its required keys and no unknown one.

    Raises
    ------
    InputError
        If it is no table, a key is missing or unknown.
    """
    found = TomlTable(entry, f"[[constraints.{kind}]]", (*required, *optional))
    found.require(*required)
    return found


def read_quantity(value: Any, what: str, unit: str = "", *, positive: bool = False, nonnegative: bool = False) -> float:
    """A finite number; `what` and `unit` stand in the message.

    Raises
    ------
    InputError
        If it is not a number, or not such a one.
    """
    if nonnegative:
        expected = f"a number of at least 0 {unit}".rstrip()
    else:
        expected = f"a {'positive ' if positive else ''}number{f' of {unit}' if unit else ''}"
    return read_number(value, what, expected, above=0 if positive else None, least=0 if nonnegative else None)


def read_vector(value: Any, what: str, unit: str) -> tuple[float, float, float]:
    """Three finite numbers.

    Raises
    ------
    InputError
        If it is something else.
    """
    found = _numbers(value)
    if found is None or found.shape != (3,) or not np.all(np.isfinite(found)):
        raise InputError(f"{what} must be three numbers{f' ({unit})' if unit else ''}, got {value!r}.")
    x, y, z = found.tolist()
    return x, y, z


def read_rotation(value: Any, what: str) -> Rows:
    """A rotation matrix, from its three rows or from roll, pitch and yaw.

    Parameters
    ----------
    value : (3, 3) or (3,)
        The matrix, whose columns are the directions of the turned axes, or URDF's ``rpy`` in radians.
    what : str
        Begins the message.

    Raises
    ------
    InputError
        If it is neither, or the matrix is no rotation.
    """
    found = _numbers(value)
    if found is not None and found.shape == (3,) and np.all(np.isfinite(found)):
        return _rows(rpy_rotation(*found.tolist())[:3, :3])
    if found is None or found.shape != (3, 3) or not np.all(np.isfinite(found)):
        raise InputError(f"{what} must be roll, pitch and yaw (rad) or a 3 x 3 matrix, got {value!r}.")
    error = float(np.abs(found @ found.T - np.eye(3)).max())
    if error > _ROTATION_ERROR or np.linalg.det(found) < 0:
        raise InputError(
            f"{what} must be a rotation matrix, with orthogonal rows of length 1 and determinant 1, "
            f"got {found.tolist()}."
        )
    return _rows(found)


def read_placement(value: Any, what: str) -> Rows:
    """A placement, from its four rows or from a table ``{xyz = ..., rpy = ...}`` as in URDF.

    Raises
    ------
    InputError
        If it is neither, or the matrix is no rigid motion.
    """
    found = np.eye(4)
    if isinstance(value, Mapping):
        unknown = [key for key in value if key not in ("xyz", "rpy")]
        if unknown or not value:
            raise InputError(f"{what} must hold xyz (m) and rpy (rad), got {dict(value)!r}.")
        found[:3, 3] = read_vector(value.get("xyz", (0, 0, 0)), f"xyz of {what}", "m")
        angles = read_vector(value.get("rpy", (0, 0, 0)), f"rpy of {what}", "rad")
        found[:3, :3] = read_rotation(angles, f"rpy of {what}")
        return _rows(found)
    given = _numbers(value)
    if given is None or given.shape != (4, 4) or not np.all(np.isfinite(given)):
        raise InputError(f"{what} must be a 4 x 4 matrix, or xyz (m) and rpy (rad), got {value!r}.")
    if not np.array_equal(given[3], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(f"{what} must have 0, 0, 0, 1 as its last row, got {given[3].tolist()}.")
    found[:3, :3] = read_rotation(given[:3, :3], f"the rotation of {what}")
    found[:3, 3] = given[:3, 3]
    return _rows(found)


def _numbers(value: Any) -> Matrix | None:
    if isinstance(value, str | bytes | Mapping):
        return None
    try:
        array = np.asarray(value)
        return None if array.dtype.kind not in "iuf" else array.astype(float) + 0.0
    except (TypeError, ValueError):
        return None


def _rows(matrix: Matrix) -> Rows:
    return tuple(tuple(row) for row in matrix.tolist())
