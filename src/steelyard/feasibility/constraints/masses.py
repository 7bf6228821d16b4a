"""Constraints on masses: the total mass, that of some links, and links that were weighed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.errors import InputError
from steelyard.files import is_real
from steelyard.lmi import AffineBlock

from .constraint import Equality, LinkParameters, ModelLike, call_text, scalar_block
from .toml_section import read_quantity

__all__ = ["MeasuredMass", "TotalMass"]


@dataclass(frozen=True)
class TotalMass:
    """Bounds the total mass of some or all links, in kg (thesis 2.66, 4.39).

    Parameters
    ----------
    maximum, minimum : float, optional
        Bounds; equal ones give an exact mass.
    equal : float, optional
        The exact mass, instead of bounds.
    links : sequence of str, optional
        Names of the links whose masses are added; by default all links.

    Raises
    ------
    InputError
        If no bound is given, a bound is not a number, or the bounds contradict each other.

    See Also
    --------
    MeasuredMass : A mass with its uncertainty.

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
        object.__setattr__(self, "links", _links(self.links, "TotalMass"))
        for key in ("maximum", "minimum", "equal"):
            value = getattr(self, key)
            if value is None:
                continue
            if not is_real(value) or not math.isfinite(value):
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

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Return the bounds as 1 x 1 blocks."""
        label, indices = _masses(model, self.links, "total mass", "mass of", "TotalMass")
        if self._exact is not None:
            return ()
        return _bounds(label, indices, self.minimum, self.maximum)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Return the exact mass as an equation; none where it is bounded."""
        label, indices = _masses(model, self.links, "total mass", "mass of", "TotalMass")
        return () if self._exact is None else (_exactly(label, indices, self._exact),)

    @property
    def _exact(self) -> float | None:
        if self.maximum is not None and self.maximum == self.minimum:
            return float(self.maximum)
        return self.equal


@dataclass(frozen=True)
class MeasuredMass:
    """Uses the weight of a link, or of several together.

    Parameters
    ----------
    value : float
        In kg.
    links : str or sequence of str, optional
        The links that were weighed together; by default all moving links of the robot.
    standard_deviation : float, optional
        Standard deviation of the weight in kg, including other parts on the scale. Without it, or with 0, the mass is
        exact.
    deviations : float
        Number of standard deviations by which the mass may differ.

    Raises
    ------
    InputError
        If a value is not a number or cannot be a mass.

    Notes
    -----
    The mass lies in value ± deviations · standard_deviation, two 1 x 1 blocks; without a standard deviation it is
    an equation. The mass of a link in the model includes all parts that are fixed to it.

    Examples
    --------
    >>> MeasuredMass(2.41, "forearm", standard_deviation=0.01)
    MeasuredMass(2.41, links=('forearm',), standard_deviation=0.01)
    """

    value: float
    links: str | Sequence[str] | None = None
    standard_deviation: float | None = None
    deviations: float = 3.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", _links(self.links, "MeasuredMass"))
        object.__setattr__(self, "value", read_quantity(self.value, "value of MeasuredMass", "kg", positive=True))
        if self.standard_deviation is not None:
            deviation = read_quantity(
                self.standard_deviation, "standard_deviation of MeasuredMass", "kg", nonnegative=True
            )
            object.__setattr__(self, "standard_deviation", deviation)
        factor = read_quantity(self.deviations, "deviations of MeasuredMass", positive=True)
        object.__setattr__(self, "deviations", factor)

    def __repr__(self) -> str:
        return call_text(self, self.value)

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Upper limit of the mass, and the lower one if it is above 0."""
        label, indices = _masses(model, self.links, "weighed total mass", "weighed mass of", "MeasuredMass")
        if not self.standard_deviation:
            return ()
        reach = self.deviations * self.standard_deviation
        low = self.value - reach
        return _bounds(label, indices, low if low > 0 else None, self.value + reach)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Return the exact mass as an equation; none where it is bounded."""
        label, indices = _masses(model, self.links, "weighed total mass", "weighed mass of", "MeasuredMass")
        return () if self.standard_deviation else (_exactly(label, indices, self.value),)


def _links(links: str | Sequence[str] | None, where: str) -> tuple[str, ...] | None:
    if links is None:
        return None
    found = (links,) if isinstance(links, str) else links
    if not isinstance(found, Sequence) or not all(isinstance(name, str) for name in found):
        raise InputError(f"{where} must have names of links as links, got {links!r}.")
    if not found:
        raise InputError(f"{where} got an empty list of links; name at least one, or leave `links` out.")
    return tuple(dict.fromkeys(found))


def _masses(
    model: ModelLike, links: str | Sequence[str] | None, of_all: str, of_some: str, where: str
) -> tuple[str, list[int]]:
    names = tuple(model.robot.link_names) if links is None else tuple(links)
    label = of_all if links is None else f"{of_some} {' + '.join(names)}"
    return label, [LinkParameters.of(model, name, where).mass for name in names]


def _bounds(label: str, indices: list[int], low: float | None, high: float | None) -> tuple[AffineBlock, ...]:
    found = []
    if high is not None:
        found.append(scalar_block(f"{label} <= {high:g} kg", "kg", indices, [-1.0] * len(indices), high))
    if low is not None:
        found.append(scalar_block(f"{label} >= {low:g} kg", "kg", indices, [1.0] * len(indices), -low))
    return tuple(found)


def _exactly(label: str, indices: list[int], value: float) -> Equality:
    return Equality(f"{label} = {value:g} kg", np.asarray(indices, dtype=np.intp), np.ones(len(indices)), value)
