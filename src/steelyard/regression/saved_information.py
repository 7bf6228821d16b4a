"""Informations as JSON files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import read_json, shown, write_json

from .blocks import BLOCK_LENGTHS
from .factor import Factor
from .reduction import as_covariance

__all__ = ["FORMAT", "read_document", "write_document"]

FORMAT = "steelyard-information-1"
LARGEST = 1e30  # of a number in a file, so that sums of squares stay finite


def write_document(path: str | Path, fields: dict[str, Any]) -> None:
    """Write the fields of an Information; the file appears whole or not at all."""
    document: dict[str, Any] = {"format": FORMAT}
    for name, value in fields.items():
        if name in ("factors", "torque_factors"):
            document[name] = [_plain(factor) for factor in value]
        elif name == "block_factors":
            document[name] = [[_plain(factor) for factor in level] for level in value]
        elif isinstance(value, np.ndarray):
            document[name] = value.tolist()
        else:
            document[name] = value
    write_json(document, path, indent=None)


def read_document(path: str | Path) -> dict[str, Any]:
    """Read them again.

    Raises
    ------
    InputError
        If the file is missing or is something else.
    """
    document = read_json(path, remedy="give an Information that steelyard saved")
    try:
        if document["format"] != FORMAT:
            raise InputError(f"{path}: format is {shown(document['format'])}, expected {FORMAT!r}.")
        fields: dict[str, Any] = {
            name: tuple(document[name]) for name in ("base_names", "base_expressions", "joint_names")
        }
        fields["remarks"] = tuple(document.get("remarks", ()))
        for name, texts in fields.items():
            if not all(isinstance(text, str) for text in texts):
                raise ValueError(f"{name!r} must be texts")
        count, joints = len(fields["base_names"]), len(fields["joint_names"])
        if len(fields["base_expressions"]) != count:
            raise ValueError(f"there are {count} names but {len(fields['base_expressions'])} expressions")
        factors = fields["factors"] = tuple(_factor(entry, count) for entry in document["factors"])
        if [f.joint for f in factors] not in ([None], list(range(joints))):
            raise ValueError("there must be one factor for each joint, or one for all")
        measured = tuple(_factor(entry, count) for entry in document.get("torque_factors", ()))
        if measured and [f.joint for f in measured] != list(range(joints)):
            raise ValueError("there must be one torque factor for each joint")
        fields["torque_factors"] = measured
        levels = tuple(tuple(_factor(e, count) for e in level) for level in document.get("block_factors", ()))
        if levels and len(levels) != len(BLOCK_LENGTHS):
            raise ValueError(f"there must be block factors for {len(BLOCK_LENGTHS)} lengths")
        for level in levels:
            pairs = list(zip(level, factors, strict=True))
            if any(b.joint != f.joint or not np.array_equal(b.columns, f.columns) for b, f in pairs):
                raise ValueError("block factors must be of the same columns as the factors")
        fields["block_factors"] = levels
        fields["filtered_torque"] = document.get("filtered_torque", False)
        if not isinstance(fields["filtered_torque"], bool):
            raise ValueError("'filtered_torque' must be true or false")
        covariance = document.get("covariance")
        fields["covariance"] = None if covariance is None else as_covariance(_finite(covariance), joints)
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: is not an Information that was saved by steelyard ({shown(str(error))}).") from None
    return fields


def _plain(factor: Factor) -> dict[str, Any]:
    return {
        "joint": factor.joint,
        "columns": factor.columns.tolist(),
        "count": factor.count,
        "triangle": factor.triangle.tolist(),
    }


def _factor(entry: dict[str, Any], width: int) -> Factor:
    joint, columns, count = entry["joint"], entry["columns"], entry["count"]
    for number, least in [
        (count, 0),
        *((column, 0) for column in columns),
        *([(joint, 0)] if joint is not None else []),
    ]:
        if isinstance(number, bool) or not isinstance(number, int) or number < least:
            raise ValueError(f"{shown(number)} is no count or index")
    if sorted(set(columns)) != columns or (columns and columns[-1] >= width):
        raise ValueError(f"columns must be different indices below {width}, in ascending order")
    triangle = _finite(entry["triangle"])
    if triangle.shape != (len(columns) + 1, len(columns) + 1) or np.any(np.tril(triangle, -1) != 0.0):
        raise ValueError(f"a factor of {len(columns)} columns must be an upper triangle of one row more")
    return Factor(joint, np.array(columns, dtype=np.intp), triangle, count)


def _finite(rows: Any) -> NDArray[np.float64]:
    flat = [value for row in rows for value in row]
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in flat):
        raise ValueError("a matrix must hold numbers")
    matrix = np.array(rows, dtype=np.float64)
    if np.max(np.abs(matrix), initial=0.0) > LARGEST:
        raise ValueError(f"a matrix holds numbers beyond {LARGEST:g}")
    return matrix
