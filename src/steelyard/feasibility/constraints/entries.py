"""Reading the values of constraints from robot.toml or arguments: numbers, vectors, rotations, placements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.files import TomlTable, read_number
from steelyard.robot.placement import rpy_rotation

__all__ = ["read_placement", "read_quantity", "read_rotation", "read_vector", "table"]

Matrix = npt.NDArray[np.float64]
Rows = tuple[tuple[float, ...], ...]

_ROTATION_ERROR = 1e-6
"""Rows of a matrix that was written with six digits are orthogonal and of length 1 to about this."""


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

    Returns
    -------
    tuple of three rows

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

    Returns
    -------
    tuple of four rows

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
