"""Least squares within the feasible set, on a reduced regression."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from steelyard.display import percent
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError
from steelyard.feasibility.dual_bound import PARAMETER_BOUND
from steelyard.feasibility.feasible_set import MARGIN_FACTORS, FeasibleSet
from steelyard.feasibility.growth import growing_links, mass_bound_of
from steelyard.feasibility.tie_break import TieBreak, closest_to_cad, lightest
from steelyard.feasibility.units import Units
from steelyard.files import read_number
from steelyard.regression import Reduced, column_lengths

from .fitting_problems import CLOSE_CHOICE, GAP, Choice, Fitting, Optimum
from .prior import PreparedPrior, Prior
from .reduced_regression import ReducedRegression

__all__ = ["FeasibleFit", "fit_reduced"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

TIE_TOLERANCES = (1e-8, 1e-6)
"""Part by which the squared residual may rise for the preferred answer if the base parameters are those of the optimum
but the solver finds no other parameters with exactly these. The second is used if plain least squares is feasible and
none is found within the first. Neither exceeds `GAP`, so that the answer still counts as the optimum."""

PRICE_FRACTION = 0.008
"""The preferred answer may raise the squared residual by this part of the price of feasibility: where the model misses
the data by much, differences that are small beside that mean little."""

DEAREST = 0.02
"""Largest such rise, relative to the squared residual."""

LOOSE_CHOICE = 0.5
"""Relative gap of a choice up to which the remark states it; above, the gap says nothing about the choice."""

WITHOUT_EFFECT = 1e-12
"""A parameter whose column of the regressor is shorter than this part of the longest column has no effect on the data:
the column consists of rounding errors."""


@dataclass(frozen=True, eq=False)
class FeasibleFit:
    """The answer of `fit_reduced`.

    Attributes
    ----------
    base : (n_b,)
    parameters : (n,)
        Every block is proved positive definite at them.
    squared_residual : float
        ‖W β - ω‖² of the (weighted) regression.
    best_squared_residual : float
        Least squared residual that was found below the mass bound.
    unconstrained_squared_residual : float
    total_mass : float
        In kg.
    attained : bool
        Whether an optimum exists below the mass bound, rather than at it.
    exact : bool
        Whether the base parameters are those of the optimum, so that the tie-break did not raise the residual.
    mass_bound : float
        In kg; infinite if conditions, constraints or a prior bound the masses anyway.
    growing_links : tuple of str
        Links whose masses neither the motion nor the conditions bound.
    prior_weight, prior_distance : float or None
    optimality_gap : float
        Measured: no feasible parameters within the mass bound and `PARAMETER_BOUND` have a squared residual that is
        smaller than `best_squared_residual`, or than `squared_residual` where the answer is `exact`, by more than this
        part of it; parts of less than 1e-10 ‖ω‖² are not told. With a prior, of what is minimised.
    tie_break_gap : float or None
        Measured: none of the answers among which the tie-break chose is better than this one by more than this part of
        the tie-break's value. None if nothing was chosen.
    statuses : tuple of str
        Status of the solver for each problem that was solved.
    iterations : int
        Iterations of the solver in all problems together.
    seconds : float
        Time that the solver itself took.
    remarks : tuple of str
        Sentences for the user.
    """

    base: Vector = field(repr=False)
    parameters: Vector = field(repr=False)
    squared_residual: float
    best_squared_residual: float
    unconstrained_squared_residual: float
    total_mass: float
    attained: bool
    exact: bool
    mass_bound: float
    growing_links: tuple[str, ...]
    prior_weight: float | None
    prior_distance: float | None
    optimality_gap: float
    tie_break_gap: float | None
    statuses: tuple[str, ...]
    iterations: int
    seconds: float
    remarks: tuple[str, ...]


@in_one_thread
def fit_reduced(
    reduced: Reduced,
    feasible_set: FeasibleSet,
    prefer: Literal["lightest", "cad"] | TieBreak | Prior | None = "lightest",
    residual_slack: float = 5e-4,
    prior: Prior | None = None,
    prior_weight: float = 1.0,
    solver: str = "clarabel",
    gap: float = GAP,
) -> FeasibleFit:
    """Minimise ‖R K δ - ρ‖² + residual2 over the feasible set (thesis 3.53, 3.58).

    If no mass can grow without bound, or if plain least squares is feasible, the base parameters are the optimum, and
    the tie-break chooses among the standard parameters that have them. Otherwise the residual often keeps falling as
    masses grow, and the answer is the preferred one among all whose squared residual is at most (1 + residual_slack)
    times the least one below a mass bound.

    Parameters
    ----------
    reduced : Reduced
        R (n_b, n_b), rho (n_b,), residual2, count, norm2.
    feasible_set : FeasibleSet
    prefer : {"lightest", "cad", None}, TieBreak or Prior
        As in `fit`; ``None`` returns the least residual as the solver finds it.
    residual_slack : float
        Fraction by which the squared residual may rise for the tie-break if masses can grow without bound and plain
        least squares is infeasible; at least 0.008 of what feasibility itself costs. 0 allows no rise.
    prior : Prior, optional
        Minimise ½ (squared residual) / (its variance) + prior_weight · (distance from the prior) instead; `prefer` and
        `residual_slack` then have no effect.
    prior_weight : float
        1 / τ² for a prior that is expected to be right to a relative deviation τ.
    solver : str
        A name from `steelyard.conic.solver_table`.
    gap : float
        Part of the objective by which the optimum may be missed, as far as is proved.

    Raises
    ------
    InputError
        For an unknown tie-break or solver, a negative residual_slack or weight, ``"cad"`` without CAD, a prior that is
        impossible, or data of another model.
    SolverError
        If the set is empty or the solver finds no point of it.
    """
    read_number(residual_slack, "residual_slack", "a number of at least 0, such as 5e-4", least=0)
    regression = ReducedRegression.of(reduced, feasible_set)
    scale = regression.units(feasible_set)
    units = scale.with_cad()
    fitting = Fitting(feasible_set, regression, units, solver, gap=gap)
    tie_break = None
    if prior is None:
        tie_break = _tie_break(prefer, feasible_set, units)
    else:
        if not isinstance(prior, Prior):
            raise InputError(f"prior must be a prior such as EntropicPrior(), got {prior!r}.")
        expected = "a positive number such as 1.0 (leave the prior out for a fit without one)"
        fitting.prior_weight = read_number(prior_weight, "prior_weight", expected, above=0)
        fitting.prior = prior.prepare(feasible_set, fitting.prior_weight)
    growing = () if prior is not None else growing_links(feasible_set, regression.unidentifiable)
    bound = mass_bound_of(feasible_set, scale) if growing else np.inf

    outside: Vector | None = None
    for factor in MARGIN_FACTORS:
        margin = factor * feasible_set.margin
        answer = _answer(fitting, tie_break, growing, margin, bound, residual_slack)
        answer.parameters = _settled(feasible_set, regression.R, answer.parameters, fitting.prior or tie_break)
        if feasible_set.contains(answer.parameters):
            if outside is not None:
                answer.parameters = feasible_set.pull_inside(outside, answer.parameters)
            return _report(fitting, tie_break, growing, answer)
        outside = answer.parameters if outside is None else outside
    raise SolverError(
        f"the solver ({solver}) ended outside the feasible set with every margin tried; check that the constraints "
        f"leave room and that units are SI, or give FeasibleSet a larger margin than {feasible_set.margin:g}."
    )


@dataclass
class _Answer:
    """Parameters, the optimum that they come from, and how they were chosen."""

    parameters: Vector
    best: Optimum
    exact: bool
    spent: float = 0.0
    choice: Choice | None = None


def _answer(
    fitting: Fitting,
    tie_break: TieBreak | PreparedPrior | None,
    growing: tuple[int, ...],
    margin: float,
    bound: float,
    residual_slack: float,
) -> _Answer:
    """Find the optimum, then choose the preferred parameters among those that fit as well."""
    feasible_set, regression = fitting.feasible_set, fitting.regression
    plain = _plain(fitting, margin)
    if plain is not None:
        return _Answer(plain.parameters, plain, True)
    best = fitting.least(margin, bound)
    margin = best.margin
    if fitting.prior is not None or fitting.is_identifiable or tie_break is None:
        return _Answer(best.parameters, best, best.attained)
    as_it_is = _price(regression, best) <= 1e-7
    if as_it_is or not growing:
        found = fitting.same_base(tie_break, regression.base, margin, best.parameters) if as_it_is else None
        if found is None:
            found = fitting.same_base(tie_break, best.base, margin, best.parameters)
        if found is not None and found.parameters[feasible_set.mass_indices].sum() <= 2 * bound:
            return _Answer(found.parameters, best, True, choice=found)
    ties = as_it_is or not growing or residual_slack < TIE_TOLERANCES[0]
    spent = max(residual_slack, min(PRICE_FRACTION * _price(regression, best), DEAREST))
    allowances = TIE_TOLERANCES if as_it_is else TIE_TOLERANCES[:1] if ties else (spent,)
    for allowed in allowances:
        limit = best.squared_residual * (1 + allowed)
        found = fitting.near(tie_break, margin, limit, bound)
        if found is None or not feasible_set.contains(found.parameters):
            continue
        most = best.squared_residual * (1 + 1.01 * allowed) + 2 * regression.tiny
        if regression.squared_residual(feasible_set.K @ found.parameters) <= most:
            return _Answer(found.parameters, best, ties, 0.0 if ties else allowed, found)
    return _Answer(best.parameters, best, best.attained)


def _plain(fitting: Fitting, margin: float) -> Optimum | None:
    """Plain least squares, if it determines all parameters and these are in the set; else None."""
    feasible_set, regression = fitting.feasible_set, fitting.regression
    if fitting.prior is not None or not fitting.is_identifiable:
        return None
    parameters = feasible_set.lift @ regression.base
    if not feasible_set.satisfies_equations(parameters):
        return None
    least = feasible_set.stack.smallest_eigenvalues(parameters).min(initial=np.inf)
    if least < margin or not feasible_set.contains(parameters):
        return None
    return Optimum(parameters, regression.base, regression.residual2, True, np.inf, regression.residual2)


def _price(regression: ReducedRegression, best: Optimum) -> float:
    """Rise of the squared residual due to the conditions, relative to that of plain least squares."""
    excess = max(best.squared_residual - regression.residual2 - regression.noise_floor, 0.0)
    return excess / max(regression.residual2, regression.noise_floor)


def _tie_break(
    prefer: str | TieBreak | Prior | None, feasible_set: FeasibleSet, units: Units
) -> TieBreak | PreparedPrior | None:
    if isinstance(prefer, TieBreak):
        prefer.check(feasible_set.parameter_count)
        return prefer
    if isinstance(prefer, Prior):
        return prefer.prepare(feasible_set)
    if prefer is None:
        return None
    if prefer == "lightest":
        return lightest(feasible_set, units)
    if prefer == "cad":
        return closest_to_cad(feasible_set)
    raise InputError(f'prefer must be "lightest", "cad" or None, a TieBreak or a prior, got {prefer!r}.')


def _told_of_the_optimum(feasible_set: FeasibleSet, best: Optimum, gap: float, with_prior: bool) -> list[str]:
    """Remarks about an optimum that is not proved, or that lies far out."""
    told = []
    if best.beyond:
        names = feasible_set.model.robot.link_names
        links = ", ".join(names[link] for link in best.beyond)
        told.append(
            f"The motion hardly shows some parameters of {links}: the least residual pulls them beyond "
            f"{PARAMETER_BOUND:.0f} times what is typical of this robot, and may fall further beyond that."
        )
    if not gap <= GAP:
        what = "objective" if with_prior else "squared residual"
        told.append(
            f"The {what} is not proved to be the least: the bound that the solver's answer gives lies "
            f"{gap:.2g} of it lower"
            + (
                f", of which {best.price_of_margin:.2g} is the price of a margin of {best.margin:.2g} from the "
                "boundary of what is feasible."
                if best.price_of_margin > 0.1 * gap
                else "."
            )
        )
    return told


def _within(gap: float) -> str:
    """Words for the gap of the choice; empty if the gap is negligible."""
    if not np.isfinite(gap) or gap > LOOSE_CHOICE:
        return ", as far as the solver could tell"
    return f" to within {percent(gap, 1)}" if gap > CLOSE_CHOICE else ""


def _rounded_down(value: float) -> float:
    """The number rounded down to three digits; zero for numbers that are not positive."""
    if not (np.isfinite(value) and value > 0):
        return 0.0
    unit = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(np.floor(value / unit * (1 + 1e-9)) * unit)


def _report(
    fitting: Fitting, tie_break: TieBreak | PreparedPrior | None, growing: tuple[int, ...], answer: _Answer
) -> FeasibleFit:
    """The answer with its measured gap and its remarks."""
    feasible_set, regression, best = fitting.feasible_set, fitting.regression, answer.best
    parameters = answer.parameters
    base = feasible_set.K @ parameters
    mass = float(parameters[feasible_set.mass_indices].sum())
    value = regression.squared_residual(base)
    objective = fitting.value(parameters if answer.exact else best.parameters)
    gap = max((objective - best.lower_bound) / fitting.size(objective), 0.0)
    remarks = []
    if not best.attained:
        remarks.append(
            f"No optimum below {best.bound:.4g} kg: the residual still falls there as masses that the motion does not "
            "show grow."
        )
        if tie_break is None:
            remarks.append(f"The answer lies at that bound, with a total mass of {mass:.4g} kg.")
    remarks += _told_of_the_optimum(feasible_set, best, gap, fitting.prior is not None)
    distance = None
    if fitting.prior is not None:
        distance = fitting.prior.distance(parameters)
        least = max(regression.residual2, regression.noise_floor)
        ratio = np.sqrt(max(value / least, 1.0))
        times = f"{ratio:.4g}"
        compared = "as much as" if times == "1" else f"{times} times what"
        remarks.append(
            f"The answer stays near a prior ({fitting.prior.label}, with a weight of {fitting.prior_weight:.4g}): it "
            f"leaves {compared} plain least squares leaves unexplained of the data."
        )
    elif tie_break is not None and answer.choice is None and not fitting.is_identifiable:
        remarks.append(
            f"The solver found no parameters that fit as well and are {tie_break.name}; these are the ones of the "
            f"least residual that it ended at, with a total mass of {mass:.4g} kg."
        )
    elif tie_break is not None and answer.choice is not None:
        among, at_a_price = "standard parameters of these base parameters", ""
        if not answer.exact:
            among = f"answers within {percent(answer.spent, 2)} of the least squared residual"
            paid = max(0.0, value / best.squared_residual - 1)
            at_a_price = f", at a price of {percent(paid, 2)} in squared residual"
        remarks.append(
            f"Among all {among} this is {tie_break.name}{_within(answer.choice.gap)}: total mass {mass:.4g} "
            f"kg{at_a_price}."
        )
        least = _rounded_down(answer.choice.least_mass)
        if tie_break.name == "the lightest" and answer.exact and least > 0.5 * mass:
            remarks.append(f"No robot lighter than {least:.3g} kg has these base parameters.")
    names = feasible_set.model.robot.link_names
    return FeasibleFit(
        base=base,
        parameters=parameters,
        squared_residual=value,
        best_squared_residual=best.squared_residual,
        unconstrained_squared_residual=regression.residual2,
        total_mass=mass,
        attained=best.attained,
        exact=answer.exact,
        mass_bound=best.bound,
        growing_links=tuple(names[link] for link in growing),
        prior_weight=fitting.prior_weight if fitting.prior is not None else None,
        prior_distance=distance,
        optimality_gap=gap,
        tie_break_gap=None if answer.choice is None else answer.choice.gap,
        statuses=tuple(fitting.statuses),
        iterations=fitting.iterations,
        seconds=fitting.seconds,
        remarks=tuple(remarks),
    )


def _settled(
    feasible_set: FeasibleSet, R: Matrix, parameters: Vector, tie_break: TieBreak | PreparedPrior | None
) -> Vector:
    """Replace parameters that have no effect on the torques by their preferred values, or by zero.

    An example is the friction of a joint that does not move or whose torque is not used. A solver leaves such a
    parameter wherever it stopped, often at a large value: beside masses in kg the tie-break gives it little weight, or
    none if only the residual was minimised. As neither the data nor a condition couples it to other parameters, its
    value can be chosen exactly and by itself. A prior keeps the parameters that it is about. R is the triangle of the
    reduced regression.
    """
    lengths = column_lengths(R @ feasible_set.K)
    without_effect = lengths <= WITHOUT_EFFECT * lengths.max(initial=0.0)
    if not without_effect.any():
        return parameters
    without_effect &= ~np.any(feasible_set.equation_matrix != 0.0, axis=0)
    low, high = np.full(len(parameters), -np.inf), np.full(len(parameters), np.inf)
    for block in feasible_set.blocks:
        used = [int(i) for i, c in zip(block.indices, block.coefficients, strict=True) if np.any(c)]
        if block.size > 1 or len(used) != 1:
            without_effect[used] = False
            continue
        index = used[0]
        coefficient = float(block.coefficients[list(block.indices).index(index), 0, 0])
        edge = (feasible_set.margin - float(block.constant[0, 0])) / coefficient
        if coefficient > 0:
            low[index] = max(low[index], edge)
        else:
            high[index] = min(high[index], edge)
    without_effect &= low <= high
    if isinstance(tie_break, PreparedPrior):
        without_effect &= ~tie_break.known
    result = parameters.copy()
    for index in map(int, np.flatnonzero(without_effect)):
        target = tie_break.alone(index, result) if isinstance(tie_break, TieBreak) else 0.0
        result[index] = np.clip(target, low[index], high[index])
    return result
