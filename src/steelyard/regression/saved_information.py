"""Informations as JSON files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from steelyard.errors import InputError
from steelyard.files import read_json, shown, write_json

from .factor import Factor

__all__ = ["FORMAT", "read_document", "write_document"]

FORMAT = "steelyard-information-1"


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
        fields["factors"] = tuple(_factor(entry) for entry in document["factors"])
        fields["torque_factors"] = tuple(_factor(entry) for entry in document.get("torque_factors", ()))
        levels = document.get("block_factors", ())
        fields["block_factors"] = tuple(tuple(_factor(entry) for entry in level) for level in levels)
        covariance = document.get("covariance")
        fields["covariance"] = None if covariance is None else np.array(covariance, dtype=np.float64)
        fields["remarks"] = tuple(document.get("remarks", ()))
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: is not an Information that was saved by steelyard ({error}).") from None
    return fields


def _plain(factor: Factor) -> dict[str, Any]:
    return {
        "joint": factor.joint,
        "columns": factor.columns.tolist(),
        "count": factor.count,
        "triangle": factor.triangle.tolist(),
    }


def _factor(entry: dict[str, Any]) -> Factor:
    return Factor(
        entry["joint"], np.array(entry["columns"], dtype=np.intp), np.array(entry["triangle"]), entry["count"]
    )
