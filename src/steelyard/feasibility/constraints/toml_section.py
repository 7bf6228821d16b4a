"""Reading the section [constraints] of a robot file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from steelyard.errors import InputError, faults_told
from steelyard.extensions import Extensions
from steelyard.files import TomlTable, made_from_table, shown, suggestion
from steelyard.regression import Estimate

from .. import constraints
from .constraint import Constraint
from .entries import table

__all__ = ["CONSTRAINTS", "constraints_from_dict"]


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
        "center_of_mass_hull": f"{__package__}.hull:CenterOfMassHull",
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

    Returns
    -------
    tuple of Constraint

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
    if key in CONSTRAINTS.own and reader is not None:
        return reader(entry, folder)
    where = f"[[constraints.{key}]]"
    given = TomlTable(entry, where, None)
    if reader is None:
        return made_from_table(kind, given, where)
    with faults_told(f"{where} cannot be used", "correct its keys, or mend its package"):
        return reader(entry, folder)


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
