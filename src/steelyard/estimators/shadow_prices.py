"""Shadow prices: by how much each condition raises the regression error."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.display import html_table, percent, text_table
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.feasibility.feasible_set import FeasibleSet, reduced_regression
from steelyard.feasibility.growth import mass_bound_of
from steelyard.files import plain, read_number
from steelyard.lmi import vector_to_symmetric

from .fitting_problems import GAP, Fitting, Optimum
from .reduced_regression import ReducedRegression

__all__ = ["ShadowPrice", "ShadowPrices", "shadow_prices"]

Vector = npt.NDArray[np.float64]

ACTIVE = 1e-7
"""A condition is active if one unit on its diagonal lowers the squared residual by more than this part of it.
Multipliers of inactive conditions are zero to the solver's accuracy of 1e-8 only."""


@dataclass(frozen=True, eq=False)
class ShadowPrice:
    """Price of one condition or of a group of them.

    Attributes
    ----------
    name : str
    kind : str
        ``"link"``, ``"term"``, ``"constraint"`` or ``"group"``.
    active : bool
        Whether the residual would fall without the condition.
    squared_saving : float
        By how much the squared residual falls if the condition is dropped.
    saving : float
        By which part the relative error falls: 0.01 means that an error of 5 % falls to 4.95 %.
    marginal : float
        Derivative of that part by a number that is added to the diagonal of the condition: the price of a margin. nan
        for groups.
    unit : str
        Unit of that number; ``"SI unit"`` if the elements of the diagonal have several.
    """

    name: str
    kind: str
    active: bool
    squared_saving: float
    saving: float
    marginal: float
    unit: str


@dataclass(frozen=True, eq=False)
class ShadowPrices:
    """The answer of `shadow_prices`, largest savings first.

    Attributes
    ----------
    prices : tuple of ShadowPrice
        Prices of the single conditions.
    groups : tuple of ShadowPrice
        Prices of all links, all terms, all constraints, and of the triangle inequality.
    squared_residual : float
        Under all conditions.
    relative_error : float
    least_squares_error : float
        Relative error without any condition.
    parameters : (n,)
        Under all conditions.
    mass_bound : float
        In kg, on the total mass.
    stopped_by_bound : bool
        Whether the mass bound keeps the residual from falling further.
    optimality_gap : float
        Measured: no squared residual from which savings were taken could be less by more than this part of the one
        under all conditions.
    consistency : str
    """

    prices: tuple[ShadowPrice, ...]
    groups: tuple[ShadowPrice, ...]
    squared_residual: float
    relative_error: float
    least_squares_error: float
    parameters: Vector = field(repr=False)
    mass_bound: float
    stopped_by_bound: bool
    optimality_gap: float
    consistency: str

    @property
    def active(self) -> tuple[ShadowPrice, ...]:
        """The conditions without which the residual would fall."""
        return tuple(price for price in self.prices if price.active)

    def __getitem__(self, name: str) -> ShadowPrice:
        for price in (*self.groups, *self.prices):
            if price.name == name:
                return price
        known = ", ".join(price.name for price in (*self.groups, *self.prices))
        raise InputError(f"there is no price of {name!r}; these are {known}.")

    def sentences(self) -> tuple[str, ...]:
        """The answer in sentences."""
        cost = ""
        if self.least_squares_error > 1e-9:
            cost = f", by {percent(self.relative_error / self.least_squares_error - 1.0)} of itself"
        found = [
            f'Feasibility under "{self.consistency}" consistency raises the relative error from '
            f"{percent(self.least_squares_error, 4)} to {percent(self.relative_error, 4)}{cost}.",
            f"{len(self.active)} of {len(self.prices)} conditions are active.",
        ]
        if self.stopped_by_bound:
            found.append(
                f"The total mass is at its bound of {self.mass_bound:g} kg; with more the residual would fall a little "
                "further."
            )
        if not self.optimality_gap <= 2 * GAP:
            found.append(
                f"Squared residuals are proved to be the least to within {self.optimality_gap:.1g} of the one under "
                "all conditions, so that savings below that mean nothing."
            )
        return tuple(found)

    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for price in (*self.groups, *(p for p in self.prices if p.active)):
            marginal = "" if math.isnan(price.marginal) else percent(price.marginal)
            rows.append((percent(price.saving), f"{price.squared_saving:.5g}", marginal, price.unit, price.name))
        return rows

    def __str__(self) -> str:
        return "\n".join((*self.sentences(), text_table(HEADS, self._rows(), numbers=(0, 1, 2))))

    def _repr_html_(self) -> str:
        return html_table(" ".join(self.sentences()), HEADS, self._rows())

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data for JSON, with None for numbers that are not finite."""
        return {**plain(self)}


HEADS = ("saved", "squared", "marginal", "per", "condition")


@in_one_thread
def shadow_prices(
    info: Any,
    feasible_set: FeasibleSet,
    *,
    weights: Any = "joint",
    mass_bound: float | None = None,
    solver: str = "clarabel",
) -> ShadowPrices:
    """Find how much each condition raises the regression error: per unit of margin, and if it is dropped.

    Parameters
    ----------
    info : Information
        Or its reduced form, `Information.reduced`.
    feasible_set : FeasibleSet
    weights : "joint", None or (N,)
        Weights of the joints, as in `fit`; errors are those of the weighted regression.
    mass_bound : float, optional
        Bound on the total mass in kg in the fits that are compared, since residuals may fall without end as masses
        grow. By default that of `fit`: 20 times the mass in the description or in a `TotalMass`, otherwise 1000 kg, or
        10 to 50 times the mass that would explain the torques. A link whose condition is dropped does not count.
    solver : str
        As in `solve`.

    Returns
    -------
    ShadowPrices
        The savings of single conditions need not add up to that of their group: if two conditions prevent the same
        gain, dropping either one alone saves nothing.

    Raises
    ------
    InputError
        For data of another model, or a bad argument.
    SolverError
        If no parameters satisfy all conditions.

    See Also
    --------
    explain_infeasibility : Which conditions an estimate violates.

    Examples
    --------
    Data of a pendulum whose moment of inertia comes out as -0.1 kg m²:

    >>> import numpy as np
    >>> import steelyard as sy
    >>> from steelyard.feasibility import FeasibleSet
    >>> model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> names = model.base_parameters().names
    >>> information = sy.Information.from_factor(np.eye(3), [-0.1, 0.0, 0.0], 0.01, 100, names)
    >>> prices = shadow_prices(information, FeasibleSet(model))
    >>> [(price.name, round(price.squared_saving, 3)) for price in prices.active]
    [('body of link1', 0.01)]
    """
    if mass_bound is not None:
        mass_bound = read_number(mass_bound, "mass_bound", "a positive number of kg", above=0)
    reduced = reduced_regression(info, weights, feasible_set)
    norm2 = float(reduced.norm2)
    regression = ReducedRegression.of(reduced, feasible_set)
    scale = regression.units(feasible_set)
    bound = mass_bound_of(feasible_set, scale) if mass_bound is None else mass_bound
    gaps = []

    def least(allowed: FeasibleSet) -> Optimum:
        fitting = Fitting(allowed, regression, regression.units(allowed).with_cad(), solver)
        found = fitting.least(allowed.margin, bound)
        gaps.append(found.squared_residual - found.lower_bound)
        return found

    whole = least(feasible_set)
    size = max(whole.squared_residual, regression.noise_floor)

    def saving(allowed: FeasibleSet) -> float:
        return max(whole.squared_residual - least(allowed).squared_residual, 0.0)

    def price(name: str, kind: str, saved: float, active: bool, marginal: float, unit: str) -> ShadowPrice:
        left = max(size - saved, 0.0) / size
        return ShadowPrice(name, kind, active, saved, 1.0 - math.sqrt(left), marginal, unit)

    prices = []
    for index, (block, place) in enumerate(zip(feasible_set.blocks, feasible_set.stack.slices, strict=True)):
        # d(squared residual) / dr of D - r 1, from the multipliers (weak duality).
        slope = float(np.trace(vector_to_symmetric(whole.multipliers[place])))
        active = slope > ACTIVE * max(size, 1e-6 * norm2)
        saved = saving(feasible_set.without((index,))) if active else 0.0
        relative = slope / (2.0 * size) if active else 0.0
        unit = (block.unit or "SI unit") if block.size == 1 else "SI unit"
        prices.append(price(block.name, block.kind, saved, active, relative, unit))
    groups = []
    for kind, name in (("link", "all links"), ("term", "all terms"), ("constraint", "all constraints")):
        members = [i for i, block in enumerate(feasible_set.blocks) if block.kind == kind]
        if members:
            active = any(prices[i].active for i in members)
            groups.append(price(name, "group", saving(feasible_set.without(members)), active, math.nan, ""))
    if feasible_set.consistency == "full":
        weaker = FeasibleSet(
            feasible_set.model, "inertia", feasible_set.constraints, feasible_set.margin, feasible_set.terms
        )
        saved = saving(weaker)
        groups.append(price("triangle inequality", "group", saved, saved > ACTIVE * norm2, math.nan, ""))
    return ShadowPrices(
        prices=tuple(sorted(prices, key=lambda p: (-p.squared_saving, -p.marginal))),
        groups=tuple(sorted(groups, key=lambda p: -p.squared_saving)),
        squared_residual=whole.squared_residual,
        relative_error=math.sqrt(whole.squared_residual / norm2),
        least_squares_error=math.sqrt(float(reduced.residual2) / norm2),
        parameters=whole.parameters,
        mass_bound=bound,
        stopped_by_bound=not whole.attained,
        optimality_gap=max(gaps) / size,
        consistency=feasible_set.consistency,
    )
