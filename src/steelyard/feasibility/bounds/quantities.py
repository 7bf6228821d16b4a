"""Quantities with intervals: standard parameters, combinations of them, the total mass, and centres of mass."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.files import suggestion
from steelyard.regression import ParameterCovariance
from steelyard.robot.inertia import INERTIA_SYMBOLS

from ..feasible_set import FeasibleSet

__all__ = ["Quantity", "quantities", "standard_errors"]

Vector = npt.NDArray[np.float64]

Combination = npt.ArrayLike | Mapping[str, float]

_KINDS = {"L": ("kg m²", "moment of inertia"), "l": ("kg m", "first moment"), "m": ("kg", "mass")}


@dataclass(frozen=True, eq=False)
class Quantity:
    """A combination row · δ, or a ratio (row · δ) / (mass · δ).

    Attributes
    ----------
    meaning : str
        Description for people.
    row : (n,)
    mass : (n,) or None
    moments : tuple of (n,)
        For a centre of mass, the moments of inertia with (row · δ)² ≤ (moment · δ) (mass · δ).
    never_negative : bool
        Whether the conditions themselves keep it from being negative.
    """

    name: str
    meaning: str
    unit: str
    row: Vector = field(repr=False)
    mass: Vector | None = field(default=None, repr=False)
    moments: tuple[Vector, ...] = field(default=(), repr=False)
    never_negative: bool = False

    def value(self, parameters: Vector) -> float:
        """Return the value for parameters δ, (n,); NaN for a ratio to no mass."""
        value = float(self.row @ parameters)
        if self.mass is None:
            return value
        mass = float(self.mass @ parameters)
        return value / mass if mass > 0.0 else float("nan")

    def slope(self, parameters: Vector) -> Vector:
        """Return by how much it changes with each parameter, to first order at δ, (n,)."""
        if self.mass is None:
            return self.row
        return (self.row - self.value(parameters) * self.mass) / float(self.mass @ parameters)


def quantities(
    feasible_set: FeasibleSet, names: Sequence[str] | None = None, combinations: Mapping[str, Combination] | None = None
) -> tuple[Quantity, ...]:
    """The quantities of a robot by name.

    Parameters
    ----------
    feasible_set : FeasibleSet
    names : sequence of str, optional
        Standard parameters, ``"total mass"``, and ``"cx1"``, ``"cy1"``, ``"cz1"`` for the centre of mass of the first
        link. By default all of them, save parameters of terms that move no torque, which no joint has: those of laws
        that act at other joints, and those that state that friction dissipates.
    combinations : mapping, optional
        Further quantities by name: rows (n,), or mappings from names of parameters to coefficients.

    Raises
    ------
    InputError
        For an unknown name, or a row that does not fit.
    """
    own = {name: _combination(feasible_set, name, value) for name, value in (combinations or {}).items()}
    standard = {quantity.name: quantity for quantity in _standard(feasible_set)}
    for name in own:
        if name in standard:
            raise InputError(
                f"combinations must not use the name {name!r}, which the robot itself has; choose another."
            )
    known = standard | own
    if names is None:
        absent = ~np.any(feasible_set.K != 0.0, axis=0)
        absent[feasible_set.link_columns] = False  # of a link every number exists, shown or not
        return tuple(one for name, one in known.items() if name in own or not absent[one.row != 0.0].any())
    chosen = (names,) if isinstance(names, str) else tuple(names)
    for name in chosen:
        if name not in known:
            raise InputError(
                f"there is no quantity {name!r}; names are those of the standard "
                "parameters, 'total mass', 'cx1', 'cy1', 'cz1' for the centre of mass of the first link, and those in "
                f"combinations=; {suggestion(str(name), known)}"
            )
    return tuple(known[name] for name in dict.fromkeys([*chosen, *own]))


def standard_errors(feasible_set: FeasibleSet, covariance: ParameterCovariance, rows: npt.ArrayLike) -> Vector:
    """Standard errors of combinations row · δ by the data alone.

    Parameters
    ----------
    covariance : ParameterCovariance
        Of the base parameters.
    rows : (k, n)

    Returns
    -------
    (k,)
        Infinite where the data do not tell the combination.
    """
    given = np.asarray(rows, dtype=float)
    combinations = given @ feasible_set.lift
    sizes = 1e-9 * (np.abs(combinations) @ np.abs(feasible_set.K) + np.abs(given))
    told = np.all(np.abs(combinations @ feasible_set.K - given) <= sizes, axis=1)
    # Of parameters that the data tell, rounding may be left in directions that they do not tell.
    hidden = np.where(covariance.unknown[:, None], covariance.unidentifiable, 0.0)
    told &= np.all(np.abs(combinations @ hidden) <= 1e-6 * np.abs(combinations) @ np.abs(hidden), axis=1)
    return np.where(told, np.linalg.norm(combinations @ covariance.root, axis=1), np.inf)


def _standard(feasible_set: FeasibleSet) -> list[Quantity]:
    names = list(feasible_set.model.parameter_names)
    links = list(feasible_set.model.robot.link_names)
    positive, terms = _positive(feasible_set), _of_terms(feasible_set)
    identity = np.eye(len(names))
    found = []
    inertial = {f"{symbol}{i + 1}": (symbol, link) for i, link in enumerate(links) for symbol in INERTIA_SYMBOLS}
    for index, name in enumerate(names):
        if name in inertial:
            symbol, link = inertial[name]
            unit, kind = _KINDS[symbol[0]]
            axes = f" {symbol[1:]}" if symbol[1:] else ""
            meaning = f"{kind}{axes} of {link}"
        else:
            unit, meaning = terms.get(index, ("", name))
        found.append(Quantity(name, meaning, unit, identity[index], never_negative=index in positive))
    total = identity[feasible_set.mass_indices].sum(axis=0)
    found.append(Quantity("total mass", "mass of all links", "kg", total, never_negative=True))
    for i, link in enumerate(links):
        for axis in "xyz":
            row, mass = identity[names.index(f"l{axis}{i + 1}")], identity[feasible_set.mass_indices[i]]
            moments = tuple(identity[names.index(f"L{other}{other}{i + 1}")] for other in "xyz" if other != axis)
            found.append(Quantity(f"c{axis}{i + 1}", f"centre of mass {axis} of {link}", "m", row, mass, moments))
    return found


def _positive(feasible_set: FeasibleSet) -> set[int]:
    """Indices of the parameters that the conditions themselves keep from being negative."""
    found = set(feasible_set.link_columns[:, [0, 3, 5, 9]].ravel().tolist())  # Lxx, Lyy, Lzz and m
    for block in feasible_set.blocks:
        if (
            block.size == 1
            and len(block.indices) == 1
            and block.constant[0, 0] == 0
            and block.coefficients[0, 0, 0] > 0
        ):
            found.add(int(block.indices[0]))
    return found


def _of_terms(feasible_set: FeasibleSet) -> dict[int, tuple[str, str]]:
    """Units and meanings of the parameters of terms, if these are known."""
    names = {name: index for index, name in enumerate(feasible_set.model.parameter_names)}
    found = {
        int(b.indices[0]): (b.unit, feasible_set.model.parameter_names[int(b.indices[0])])
        for b in feasible_set.blocks
        if b.kind == "term" and len(b.indices) == 1 and b.unit
    }
    robot = feasible_set.model.robot
    for position, joint in enumerate(getattr(robot, "joints", ())):
        for term in getattr(robot, "terms", ()):
            for parameter in term.parameters:
                index = names.get(f"{parameter.symbol}{position + 1}")
                if index is not None:
                    unit = parameter.unit_prismatic if joint.kind == "prismatic" else parameter.unit
                    found[index] = found.get(index, (unit, ""))[0], f"{parameter.description} of {joint.name}"
    return found


def _numbers(name: str, value: npt.ArrayLike) -> Vector:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"the coefficients of combination {name!r} must be numbers, got {value!r}.") from None


def _combination(feasible_set: FeasibleSet, name: str, value: Combination) -> Quantity:
    names = list(feasible_set.model.parameter_names)
    row = np.zeros(len(names))
    if isinstance(value, Mapping):
        for key, coefficient in value.items():
            if key not in names:
                raise InputError(
                    f"combination {name!r} names the parameter {key!r}, which the robot does not have; "
                    f"{suggestion(str(key), names)}"
                )
            row[names.index(key)] = _numbers(name, coefficient)
    else:
        given = _numbers(name, value)
        if given.shape != row.shape:
            raise InputError(
                f"combination {name!r} must have one coefficient for each of the {len(names)} standard parameters, "
                f"got an array of shape {given.shape}."
            )
        row = given.copy()
    if not np.all(np.isfinite(row)) or not np.any(row):
        raise InputError(f"combination {name!r} must have finite coefficients, not all of them zero.")
    positive = _positive(feasible_set)
    used = np.flatnonzero(row)
    masses = set(feasible_set.mass_indices.tolist())
    unit = "kg" if masses.issuperset(used.tolist()) else ""
    return Quantity(name, name, unit, row, never_negative=all(int(i) in positive and row[i] > 0 for i in used))
