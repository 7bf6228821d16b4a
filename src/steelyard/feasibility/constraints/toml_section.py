"""The section [constraints] of a robot file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from steelyard.files import TomlTable
from steelyard.regression import Estimate

from .center_of_mass import CenterOfMassBox, CenterOfMassSphere
from .constraint import Constraint
from .density import DensityInBox, DensityInEllipsoid
from .entries import table
from .hull import CenterOfMassHull
from .linear import ConfidenceInterval, LinearBound, confidence_intervals
from .masses import MeasuredMass, TotalMass
from .symmetry import EqualLinks, SymmetricLink

__all__ = ["constraints_from_dict"]

_Reader = Callable[[Mapping[str, Any], Path | None], Constraint]


def constraints_from_dict(section: Mapping[str, Any], folder: str | Path | None = None) -> tuple[Constraint, ...]:
    """Constraints from the ``[constraints]`` section of ``robot.toml``.

    Parameters
    ----------
    section : mapping
        For each kind (``total_mass``, ``measured_mass``, ``linear_bound``, ``confidence_interval``,
        ``center_of_mass_box``, ``center_of_mass_sphere``, ``center_of_mass_hull``, ``density_in_box``,
        ``density_in_ellipsoid``, ``symmetric_link``, ``equal_links``) a table, or a list of tables.
    folder : str or Path, optional
        What paths in it are relative to: the folder of the robot file. The working directory where absent.

    Returns
    -------
    tuple of Constraint

    Raises
    ------
    InputError
        For unknown or missing keys and impossible values.
    MissingExtraError
        If a mesh is to be read without trimesh.

    Examples
    --------
    >>> constraints_from_dict({"total_mass": {"maximum": 27.0}})
    (TotalMass(maximum=27.0),)
    """
    kinds: dict[str, _Reader] = {
        "total_mass": TotalMass.from_dict,
        "measured_mass": MeasuredMass.from_dict,
        "linear_bound": LinearBound.from_dict,
        "confidence_interval": ConfidenceInterval.from_dict,
        "center_of_mass_box": CenterOfMassBox.from_dict,
        "center_of_mass_sphere": CenterOfMassSphere.from_dict,
        "center_of_mass_hull": CenterOfMassHull.from_dict,
        "density_in_box": DensityInBox.from_dict,
        "density_in_ellipsoid": DensityInEllipsoid.from_dict,
        "symmetric_link": SymmetricLink.from_dict,
        "equal_links": EqualLinks.from_dict,
    }
    tables = TomlTable(section, "[constraints]", tuple(kinds), "is no kind of constraint")
    place = None if folder is None else Path(folder)
    found: list[Constraint] = []
    for key, entries in tables.items():
        for entry in entries if isinstance(entries, (list, tuple)) else [entries]:
            if key == "confidence_interval" and isinstance(entry, Mapping) and "estimate" in entry:
                found.extend(_of_estimate(entry, place))
            else:
                found.append(kinds[key](entry, place))
    return tuple(found)


def _of_estimate(entry: Mapping[str, Any], folder: Path | None) -> tuple[ConfidenceInterval, ...]:
    """All intervals of a saved estimate."""
    given = table(entry, "confidence_interval", ("estimate",), ("deviations", "combinations"))
    path = given.text("estimate", "a path") or ""
    combinations = given.get("combinations")
    if combinations is not None and not isinstance(combinations, list):
        raise given.refuse("combinations", "a list of texts")
    return confidence_intervals(Estimate.load(Path(folder or ".") / path), given.get("deviations", 3.0), combinations)
