"""Constraints beyond the physics of single bodies: what else is known of the robot."""

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError

from ..lmi import AffineBlock
from ..protocols import ModelLike

__all__ = ["CenterOfMassBox", "Constraint", "Equality", "TotalMass", "constraints_from_dict", "link_index"]


@dataclass(frozen=True, eq=False)
class Equality:
    """A linear equation coefficients · δ[indices] = value."""

    name: str
    indices: npt.NDArray[np.intp]
    coefficients: npt.NDArray[np.float64]
    value: float


class Constraint(Protocol):
    """Anything that gives blocks (and equations) for a model; users may add their own classes."""

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Matrices that must be positive semidefinite."""

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Equations that must hold."""


def link_index(model: ModelLike, link: str, where: str) -> int:
    """Index of a link by name.

    Raises
    ------
    InputError
        If there is no such link; the message suggests the closest name.
    """
    names = list(model.robot.link_names)
    if link in names:
        return names.index(link)
    close = difflib.get_close_matches(str(link), names, n=1, cutoff=0.0)
    raise InputError(
        f"{where} names the link {link!r}, which the robot does not have; did you mean {close[0]!r}? "
        f"(links: {', '.join(names)})"
    )


def _parameter(model: ModelLike, symbol: str, link: int) -> int:
    return list(model.parameter_names).index(f"{symbol}{link + 1}")


def _linear(name: str, unit: str, indices: Sequence[int], row: Sequence[float], constant: float) -> AffineBlock:
    coefficients = np.asarray(row, dtype=float).reshape(-1, 1, 1)
    return AffineBlock(
        name, np.array([[constant]]), np.asarray(indices, dtype=np.intp), coefficients, kind="constraint", unit=unit
    )


@dataclass(frozen=True)
class TotalMass:
    """The mass of some links together, in kg (thesis 2.66, 4.39).

    Parameters
    ----------
    maximum, minimum : float, optional
        Bounds.
    equal : float, optional
        The exact mass, instead of bounds.
    links : sequence of str, optional
        Names of the links that are weighed together; all of them where absent.

    Raises
    ------
    InputError
        If no bound is given, a bound is not a number, or the bounds contradict each other.

    Examples
    --------
    >>> TotalMass(maximum=27.0)
    TotalMass(maximum=27.0)
    """

    maximum: float | None = None
    minimum: float | None = None
    equal: float | None = None
    links: Sequence[str] | None = None

    def __post_init__(self) -> None:
        if self.links is not None:
            object.__setattr__(self, "links", (self.links,) if isinstance(self.links, str) else tuple(self.links))
            if not self.links:
                raise InputError("TotalMass got an empty list of links; name at least one, or leave `links` out.")
        for key in ("maximum", "minimum", "equal"):
            value = getattr(self, key)
            if value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise InputError(f"TotalMass must have a finite number of kg as {key}, got {value!r}.")
            if value < 0 or (value == 0 and key != "minimum"):
                raise InputError(f"TotalMass must have a positive {key}, got {value} kg; masses are positive.")
        if self.maximum is None and self.minimum is None and self.equal is None:
            raise InputError("TotalMass needs a bound; give maximum, minimum or equal, in kg.")
        if self.equal is not None and (self.maximum is not None or self.minimum is not None):
            raise InputError("TotalMass takes either equal or bounds (maximum, minimum), not both; remove one.")
        if self.maximum is not None and self.minimum is not None and self.minimum > self.maximum:
            raise InputError(
                f"TotalMass has minimum {self.minimum} kg above its maximum {self.maximum} kg; swap or correct them."
            )

    def __repr__(self) -> str:
        given = ((key, getattr(self, key)) for key in ("maximum", "minimum", "equal", "links"))
        return f"TotalMass({', '.join(f'{key}={value!r}' for key, value in given if value is not None)})"

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> "TotalMass":
        """From ``{"maximum": 27.0}``, as in ``robot.toml``."""
        _known_keys(entry, ("maximum", "minimum", "equal", "links"), "total_mass")
        return cls(**entry)

    def _masses(self, model: ModelLike) -> tuple[str, list[int]]:
        names = self.links if self.links is not None else tuple(model.robot.link_names)
        links = [link_index(model, name, "TotalMass") for name in names]
        label = "total mass" if self.links is None else f"mass of {' + '.join(names)}"
        return label, [_parameter(model, "m", link) for link in dict.fromkeys(links)]

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Bounds as 1 x 1 blocks."""
        label, indices = self._masses(model)
        found = []
        if self.maximum is not None:
            row = [-1.0] * len(indices)
            found.append(_linear(f"{label} <= {self.maximum:g} kg", "kg", indices, row, self.maximum))
        if self.minimum is not None:
            row = [1.0] * len(indices)
            found.append(_linear(f"{label} >= {self.minimum:g} kg", "kg", indices, row, -self.minimum))
        return tuple(found)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """The exact mass as an equation."""
        label, indices = self._masses(model)
        if self.equal is None:
            return ()
        name = f"{label} = {self.equal:g} kg"
        return (Equality(name, np.asarray(indices, dtype=np.intp), np.ones(len(indices)), self.equal),)


@dataclass(frozen=True)
class CenterOfMassBox:
    """The centre of mass of a link within a box along the axes of the link frame (thesis 4.38).

    Parameters
    ----------
    link : str
    lower, upper : (3,)
        Corners, in metres, in the link frame.

    Raises
    ------
    InputError
        If a corner is not three numbers or a lower bound is above the upper one.

    Examples
    --------
    >>> CenterOfMassBox("forearm", lower=(-0.1, -0.1, 0.0), upper=(0.1, 0.1, 0.5))
    CenterOfMassBox(link='forearm', lower=(-0.1, -0.1, 0.0), upper=(0.1, 0.1, 0.5))
    """

    link: str
    lower: Sequence[float]
    upper: Sequence[float]

    def __post_init__(self) -> None:
        for key in ("lower", "upper"):
            try:
                corner = tuple(float(value) for value in getattr(self, key))
            except (TypeError, ValueError):
                corner = ()
            if len(corner) != 3 or any(math.isnan(value) for value in corner):
                raise InputError(
                    f"CenterOfMassBox of link {self.link!r} must have three numbers (metres) as {key}, "
                    f"got {getattr(self, key)!r}."
                )
            object.__setattr__(self, key, corner)
        for axis, low, high in zip("xyz", self.lower, self.upper, strict=True):
            if low > high:
                raise InputError(
                    f"CenterOfMassBox of link {self.link!r} has lower {axis} {low:g} m above upper {axis} {high:g} m; "
                    "swap or correct them."
                )

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> "CenterOfMassBox":
        """From ``{"link": "link1", "lower": [..], "upper": [..]}``, as in ``robot.toml``."""
        _known_keys(entry, ("link", "lower", "upper"), "center_of_mass_box")
        missing = [key for key in ("link", "lower", "upper") if key not in entry]
        if missing:
            raise InputError(f"[[constraints.center_of_mass_box]] lacks {missing[0]!r}; give link, lower and upper.")
        return cls(**entry)

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Six (or fewer, where a bound is infinite) 1 x 1 blocks, in kg m: l - m lower and m upper - l."""
        link = link_index(model, self.link, "CenterOfMassBox")
        mass = _parameter(model, "m", link)
        found = []
        for axis, low, high in zip("xyz", self.lower, self.upper, strict=True):
            moment = _parameter(model, f"l{axis}", link)
            name = f"link {link + 1} ({self.link}): centre of mass"
            if math.isfinite(low):
                found.append(_linear(f"{name} {axis} >= {low:g} m", "kg m", (moment, mass), (1.0, -low), 0.0))
            if math.isfinite(high):
                found.append(_linear(f"{name} {axis} <= {high:g} m", "kg m", (moment, mass), (-1.0, high), 0.0))
        return tuple(found)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """None."""
        return ()


def _known_keys(entry: Any, known: tuple[str, ...], where: str) -> None:
    if not isinstance(entry, Mapping):
        raise InputError(f"{where} in [constraints] must be a table with {', '.join(known)}, got {entry!r}.")
    for key in entry:
        if key not in known:
            close = difflib.get_close_matches(str(key), known, n=1, cutoff=0.0)
            raise InputError(f"{where} in [constraints] has an unknown key {key!r}; did you mean {close[0]!r}?")


def constraints_from_dict(section: Mapping[str, Any]) -> tuple[Constraint, ...]:
    """Constraints from the ``[constraints]`` section of ``robot.toml``.

    Parameters
    ----------
    section : mapping
        ``total_mass``: one table or a list of them; ``center_of_mass_box``: a list of tables (or one).

    Raises
    ------
    InputError
        For unknown or missing keys and impossible values.

    Examples
    --------
    >>> constraints_from_dict({"total_mass": {"maximum": 27.0}})
    (TotalMass(maximum=27.0),)
    """
    kinds: dict[str, Callable[[Mapping[str, Any]], Constraint]] = {
        "total_mass": TotalMass.from_dict,
        "center_of_mass_box": CenterOfMassBox.from_dict,
    }
    _known_keys(section, tuple(kinds), "the section")
    found: list[Constraint] = []
    for key, entries in section.items():
        for entry in entries if isinstance(entries, (list, tuple)) else [entries]:
            found.append(kinds[key](entry))
    return tuple(found)
