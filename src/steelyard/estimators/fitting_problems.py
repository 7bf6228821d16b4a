"""The problems that a fit solves: the least objective, then the choice among parameters that fit as well or nearly."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
import numpy.typing as npt
import scipy.linalg

from steelyard.conic import Cone, ConicSolution, Outcome, Rows
from steelyard.errors import SolverError
from steelyard.feasibility.barrier import (
    LinearConditions,
    add_log_determinants,
    log_determinants,
    matrix_conditions,
    newton_solutions,
)
from steelyard.feasibility.cone_program import Conditions, Part, Program, total, unidentifiable_conditions
from steelyard.feasibility.dual_bound import PARAMETER_BOUND, ConvexProblem, Multipliers
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.feasibility.tie_break import TieBreak
from steelyard.feasibility.units import Units
from steelyard.lmi import symmetric_to_vector, vector_to_symmetric
from steelyard.once import cached_property

from .prior import PreparedPrior
from .reduced_regression import ReducedRegression

__all__ = ["CLOSE_CHOICE", "GAP", "Choice", "Fitting", "Optimum", "WarmAnswer", "WarmFit", "start_near"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

DEAR_MARGIN = 1e-5
"""If the margin costs more than this part of the squared residual, units are computed anew from the point that was
found, since links are smaller than their units. Doing so always costs 10 % more iterations (100 random fits); never
doing so changes none of these, but robots of grams need it."""

CHEAP_MARGIN = 0.2e-6
"""The margin is reduced until it costs about this part of the objective, as long as the answer stays in the set.
Without that, the margin cost up to 5e-6 of the squared residual for robots of grams, more than the gap that counts as
optimal."""

LESSER_MARGIN = 0.1
"""Part of the margin that is kept while the tie-break chooses among the parameters of one base vector. The optimum
lies on the boundary of those with the whole margin, which leaves no room to choose in. Of 100 random fits 87 % of the
choices are within 1e-3 of the best one; with the whole margin it is 72 %, with half of it 83 %, with a hundredth 86
%."""

PRICE = 1e-6
"""A mass bound counts as what keeps the residual from falling if its multiplier is more than this part of the squared
residual; smaller multipliers are within the accuracy of the solver."""


def base_dependent_conditions(feasible_set: FeasibleSet) -> Conditions:
    """The conditions over (β, δ_d)."""
    return Conditions(feasible_set, feasible_set.base_dependent)


@dataclass(frozen=True, eq=False)
class Optimum:
    """The least objective below a mass bound.

    Attributes
    ----------
    parameters : (n,)
    base : (n_b,)
    attained : bool
        Whether the optimum lies below the mass bound, rather than at it.
    bound : float
        Mass bound in kg; infinite if there is none.
    lower_bound : float
        No feasible parameters with a mass below the bound, and within the parameter bound, have a lesser objective, in
        units of the squared residual.
    price_of_margin : float
        Rise of the objective due to the margin, to first order, relative to the objective.
    beyond : tuple of int
        Links whose parameters lie beyond the parameter bound.
    margin : float
        Margin with which the optimum was found.
    multipliers : (rows,)
        Multipliers of the stacked blocks of the set, in SI, as the solver returned them; the lower bound follows from
        them.
    """

    parameters: Vector = field(repr=False)
    base: Vector = field(repr=False)
    squared_residual: float
    attained: bool
    bound: float
    lower_bound: float
    price_of_margin: float = 0.0
    beyond: tuple[int, ...] = ()
    margin: float = 0.0
    multipliers: Vector = field(default_factory=lambda: np.zeros(0), repr=False)


@dataclass(frozen=True)
class Attempt:
    """One way to state the problem for the solver.

    Attributes
    ----------
    apart : bool
        Whether the residuals become unknowns even if R is well conditioned.
    around : bool
        Whether units are those of the point that was found before, rather than typical ones of the robot.
    balanced : bool
        Whether the solver need not scale the problem, see `Program.solve`.
    accuracy : float
        Of the solver.
    bounded : bool
        Whether only robots within `PARAMETER_BOUND` are asked for. The best of all may lie far out, or nowhere.
    """

    apart: bool = False
    around: bool = False
    balanced: bool = True
    accuracy: float = 1e-8
    bounded: bool = False


ATTEMPTS = (
    Attempt(),
    Attempt(apart=True, around=True, balanced=False),
    Attempt(apart=True, around=True, balanced=False, accuracy=1e-10),
    Attempt(apart=True, around=True, balanced=False, bounded=True),
    Attempt(around=True, balanced=False, bounded=True),
    Attempt(apart=True, around=True, balanced=False, accuracy=1e-10, bounded=True),
    Attempt(balanced=False, accuracy=1e-10, bounded=True),
    Attempt(apart=True, around=True, balanced=False, bounded=True),
    Attempt(apart=True, around=True, balanced=False, accuracy=1e-10),
)
"""The attempts, made in this order until the measured gap is at most `GAP`, each around the best point that was found
before and in units of its residual. The first suffices for most robots; those after it differ in what helps where
joints hardly move or masses differ by orders of magnitude. Bounds on all parameters come late, because the optimum of
the bounded problem may be worse than one that lies beyond, by up to 4e-4."""

SEARCHED_FIRST = "clarabel"
"""The solver beside which fits with a prior are first searched for from within the set: it is the default. Whoever
names another one wants to see what that one finds."""

SEARCH_ACCURACY = 1e-12
"""Complementarity at which a search from within ends, in units of half the squared residual over its variance. With
1e-10 it takes two steps less, and base parameters with small multipliers are off by 2.5e-9 of the largest."""

SEARCH_ENOUGH = 1e-8
"""Complementarity at which a search counts as ended where rounding lets it go no further."""

SEARCH_STEPS = 40
"""After which a search from within is given up: those that arrive take 9 to 33 as a rule (random arms). The others
stand still where noise a ten-thousandth of the torques makes the data 1e13 times as steep as the prior."""

CLOSE_CHOICE = 1e-3
"""A choice whose relative gap is at most this counts as the preferred one."""

GAP = 1e-6
"""An optimum whose relative gap is at most this counts as found, unless less is asked for: far below what any data
tells of the residual, and within reach of an interior-point method in double precision."""


@dataclass(frozen=True, eq=False)
class Choice:
    """The parameters that a tie-break chose.

    Attributes
    ----------
    parameters : (n,)
    gap : float
        None of the parameters among which it chose is better by more than this part of the tie-break's size; nan if no
        bound is known.
    least_mass : float
        None of the parameters among which it chose has a smaller total mass, in kg.
    """

    parameters: Vector = field(repr=False)
    gap: float
    least_mass: float


@dataclass(eq=False)
class Fitting:
    """Least squares within a feasible set: the programs, and the record of the solver's runs.

    Attributes
    ----------
    prior_weight : float
        Factor of the prior's distance beside half the squared residual, in units of its variance.
    gap : float
        An optimum whose relative gap is at most this counts as found.
    """

    feasible_set: FeasibleSet
    regression: ReducedRegression
    units: Units
    solver: str
    prior: PreparedPrior | None = None
    prior_weight: float = 0.0
    gap: float = GAP
    iterations: int = 0
    seconds: float = 0.0
    statuses: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        independent = np.asarray(self.feasible_set.model.base_parameters().independent, np.intp)
        self._scale = self.regression.scale
        self._origin = self.feasible_set.lift @ self.regression.ridge(self.units.parameters[independent])
        self._attempt = ATTEMPTS[0]
        self._typical = self.units.parameters

    @cached_property
    def _parameter_bound_rows(self) -> Matrix:
        """Rows over δ that are at most 1 within the bound on parameters, (k, n): one per link, two per term."""
        columns = self.feasible_set.link_columns
        links = np.zeros((len(columns), len(self._typical)))
        for row, own in zip(links, columns, strict=True):
            moments, mass = own[[0, 3, 5]], own[9]
            row[moments] = 0.5 / (PARAMETER_BOUND * self._typical[moments])
            row[mass] = 1.0 / (PARAMETER_BOUND * self._typical[mass])
        others = np.setdiff1d(np.arange(len(self._typical)), columns)
        terms = np.zeros((len(others), len(self._typical)))
        terms[np.arange(len(others)), others] = 1.0 / (PARAMETER_BOUND * self._typical[others])
        return np.vstack([links, terms, -terms])

    def _record(self, solution: ConicSolution) -> ConicSolution:
        self.iterations += solution.iterations
        self.seconds += solution.seconds
        return solution

    def _base_program(self, margin: float) -> Program:
        """The program over (β, δ_d)."""
        feasible_set = self.feasible_set
        conditions = feasible_set.kept(base_dependent_conditions)
        base = feasible_set.model.base_parameters()
        order = np.concatenate([np.asarray(base.independent, np.intp), np.asarray(base.dependent, np.intp)])
        typical = self.units.parameters
        units = self.units.around(self._origin).parameters if self._attempt.around else typical
        return Program(feasible_set, conditions, units, units[order], self._origin, margin, typical)

    def _solve(self, program: Program, part: Part, rows: Sequence[Rows]) -> ConicSolution:
        balanced = self.is_identifiable and self._attempt.balanced
        return self._record(program.solve(part, rows, self.solver, balanced, self._attempt.accuracy))

    def _around(self, parameters: Vector) -> None:
        """Make this point the origin of the following programs, and its residual their unit."""
        self._origin = parameters
        residual2 = self.regression.squared_residual(self.feasible_set.K @ parameters)
        self._scale = max(residual2, self.regression.least_size)

    def _unconstrained(self, program: Program) -> Vector:
        """The minimum of the objective without conditions, with the curvature that the prior has at its reference.

        Around it the objective has no large constant, which would hide small differences from the solver.
        """
        if self.prior is None:
            return program.origin
        matrix = program.scaled_matrix
        factor, root = self._prior_factor, np.sqrt(self._scale)
        data = self.regression.R * (program.columns[: len(self.regression.base)] / root)
        error = self.regression.residuals(self.feasible_set.K @ program.origin) / root
        curvature = factor * self.prior.curvature()
        P = matrix.T @ (curvature @ matrix)
        P[: len(data), : len(data)] += 2.0 * (data.T @ data)
        q = matrix.T @ (curvature @ (program.origin - self.prior.reference))
        q[: len(data)] += 2.0 * (data.T @ error)
        sizes = np.sqrt(np.maximum(np.diagonal(P), 1e-300))
        scaled = P / np.outer(sizes, sizes)
        try:
            step = scipy.linalg.cho_solve(scipy.linalg.cho_factor(scaled), q / sizes)
        except np.linalg.LinAlgError:  # friction that neither the prior nor the data determines
            step = np.linalg.lstsq(scaled, q / sizes, rcond=1e-13)[0]
        return np.asarray(program.origin - matrix @ (step / sizes))

    def _unidentifiable_program(self, margin: float, base: Vector, around: bool) -> Program:
        """Over what neither motion nor data show, at a base vector; around parameters that have nearly that one."""
        feasible_set, unidentifiable = self.feasible_set, self.regression.unidentifiable
        if unidentifiable.shape[1]:
            directions = np.hstack([feasible_set.lift @ unidentifiable, feasible_set.unidentifiable])
            conditions = Conditions(feasible_set, directions)
        else:
            conditions = feasible_set.kept(unidentifiable_conditions)
        typical = self.units.parameters
        # Masses of links may differ by a factor of a thousand; the point that was found tells their sizes.
        units = self.units.around(self._origin).parameters if around else typical
        origin = self._origin + feasible_set.lift @ (base - feasible_set.K @ self._origin)
        return Program.along(feasible_set, conditions, units, origin, margin, typical)

    @property
    def is_identifiable(self) -> bool:
        """Whether the data determines all base parameters, and these all standard parameters."""
        return not (self.feasible_set.unidentifiable.shape[1] or self.regression.unidentifiable.shape[1])

    def objective(self, program: Program) -> Part:
        """The squared residual, plus the prior if there is one."""
        base = self.feasible_set.K @ program.origin
        data = self.regression.objective(program.columns, base, self._scale, self._attempt.apart)
        if self.prior is None:
            return data
        whole = total([data, self.prior.part(program).times(self._prior_factor)], len(program.columns))
        return whole.times(1.0 / max(1.0, self._prior_factor))

    @property
    def _prior_factor(self) -> float:
        """Factor of the prior's distance if the squared residual is divided by its scale.

        The objective is ½ (squared residual) / variance + weight · distance, multiplied by 2 variance / scale.
        """
        return 2.0 * self.prior_weight * self.regression.variance / self._scale

    def value(self, parameters: Vector) -> float:
        """The objective at δ, in units of the squared residual."""
        value = self.regression.squared_residual(self.feasible_set.K @ parameters)
        if self.prior is not None:
            value += 2.0 * self.prior_weight * self.regression.variance * self.prior.distance(parameters)
        return value

    def size(self, value: float) -> float:
        """Size to which gaps of an objective with this value are relative."""
        return max(value, self.regression.least_size)

    def least(self, margin: float, bound: float) -> Optimum:
        """The least objective with a total mass below the bound.

        Raises
        ------
        SolverError
            If no parameters satisfy the conditions, or the solver found none.
        """
        best, lower = self._searched(margin) or self._attempted(margin, bound)
        self.statuses.append(best.status)
        self.units = best.units
        self._attempt = ATTEMPTS[0]
        self._around(best.parameters)
        base = self.feasible_set.K @ best.parameters
        squared = self.regression.squared_residual(base)
        links = self._parameter_bound_rows[: len(self.feasible_set.link_columns)]
        beyond = tuple(np.flatnonzero(links @ best.parameters > 1.0).tolist())
        return Optimum(
            best.parameters,
            base,
            squared,
            not best.stopped,
            bound,
            lower,
            best.price,
            beyond,
            best.margin,
            best.multipliers,
        )

    def _searched(self, margin: float) -> "tuple[_Found, float] | None":
        """Search near a prior from within the set, to digits that a conic solver does not reach; None where it fails.

        Only for the default solver, which solves what this leaves.
        """
        prior, regression, feasible_set = self.prior, self.regression, self.feasible_set
        if prior is None or self.solver != SEARCHED_FIRST:
            return None
        scaled = regression.R @ feasible_set.K / np.sqrt(regression.variance)
        curvature, slope = scaled.T @ scaled, scaled.T @ regression.rho / np.sqrt(regression.variance)
        held = np.diagonal(curvature) + self.prior_weight * prior.diagonal > 0.0
        if not np.all(held | prior.known):  # a barrier alone would drive a parameter ever further
            return None
        search = self._search(margin)
        start = start_near(prior, self.prior_weight, curvature, slope, self.units.parameters, search.inside)
        if start is None:
            return None
        found = self._ended(search, start, margin)
        if found is not None and found.price > CHEAP_MARGIN and self._gap(found) > self.gap:
            margin *= CHEAP_MARGIN / found.price
            found = self._ended(self._search(margin), found.parameters, margin)
        return None if found is None or self._gap(found) > self.gap else (found, found.lower_bound)

    def _gap(self, found: "_Found") -> float:
        return (found.value - found.lower_bound) / self.size(found.value)

    def _search(self, margin: float) -> "WarmFit":
        conditions = self.feasible_set.kept(base_dependent_conditions)
        return WarmFit(self.feasible_set, conditions.margins(margin, self._typical))

    def _ended(self, search: "WarmFit", start: Vector, margin: float) -> "_Found | None":
        """Where a search from within ends, and what its multipliers prove; None where it does not arrive."""
        prior, regression, feasible_set = self.prior, self.regression, self.feasible_set
        assert prior is not None
        search.begin(start)
        try:
            answer = search.solve(
                regression.R,
                regression.rho,
                regression.variance,
                prior,
                self.prior_weight,
                accuracy=SEARCH_ACCURACY,
                most_steps=SEARCH_STEPS,
            )
        except np.linalg.LinAlgError:  # numbers too far apart for a factor
            return None
        self.iterations += answer.steps
        self.seconds += answer.seconds
        if answer.complementarity > SEARCH_ENOUGH or not feasible_set.contains(answer.parameters):
            return None
        parameters, value = answer.parameters, self.value(answer.parameters)
        blocks = 2.0 * regression.variance * answer.multipliers
        enough = value - 0.1 * self.gap * self.size(value)
        lower = self._problem(parameters, value).lower_bound(Multipliers(blocks, np.zeros(0)), enough)
        price = float(search.margins @ blocks) / self.size(value)
        return _Found(parameters, value, lower, False, price, True, self.units, margin, "Solved", blocks)

    def _attempted(self, margin: float, bound: float) -> "tuple[_Found, float]":
        """The best point of attempts with a conic solver, and a lower bound."""
        if self.prior is not None:
            self._origin = self._unconstrained(self._base_program(margin))
        best: _Found | None = None
        within: _Found | None = None
        lower, units = -np.inf, self.units
        for number, attempt in enumerate(ATTEMPTS):
            self._attempt = attempt
            near = within if attempt.bounded else best
            if near is not None:
                self._around(near.parameters)
                self.units = units.refined(near.parameters) if near.price > DEAR_MARGIN else units
            found = self._found(margin, bound, best)
            if found is None:
                continue
            if best is not None and best.inside and not found.inside:
                found = self._pulled(found, best)
            lower = max(lower, found.lower_bound)
            if best is None or found.order < best.order:
                best = found
            reached = bool(np.all(self._parameter_bound_rows @ found.parameters <= 1.0))
            if reached and (within is None or found.order < within.order):
                within = found
            gap = (best.value - lower) / self.size(best.value)
            if best.inside and best.price > CHEAP_MARGIN:
                margin = best.margin * CHEAP_MARGIN / best.price
            # The price of the margin, once that has been reduced, does not count as an error of the solver.
            if gap <= self.gap or (gap - best.price <= self.gap and number > 1):
                break
        assert best is not None
        return best, lower

    def _found(self, margin: float, bound: float, before: "_Found | None") -> "_Found | None":
        """Make one attempt; None if it fails after another one has found a point."""
        program = self._base_program(margin)
        objective = self.objective(program)
        limits, most = self._limits(bound)
        rows = (_limit_rows(program, limits, most),) if len(limits) else ()
        solution = self._solve(program, objective, rows)
        failed = solution.outcome is Outcome.INFEASIBLE or not solution.usable
        if before is not None and failed:
            return None
        if solution.outcome is Outcome.INFEASIBLE:
            below = f" and a total mass below {bound:g} kg" if np.isfinite(bound) else ""
            raise SolverError(
                f"no parameters satisfy all of the {len(self.feasible_set.blocks)} conditions with margin {margin:g}"
                f"{below} ({solution.solver}: {solution.status}); loosen the constraints, which contradict each other."
            )
        solution.require("fit the data within the feasible set")
        unit = self._scale * max(1.0, self._prior_factor)
        parameters = program.parameters(solution.primal)
        value = self.value(parameters)
        start = program.conditions.rows.shape[0]
        blocks, prices = unit * program.stacked_dual(solution.dual), unit * solution.dual[start : start + len(limits)]
        problem = self._problem(parameters, value)
        enough = value - 0.1 * self.gap * self.size(value)
        stopped = bool(np.isfinite(bound) and limits[0] @ parameters > 0.99 and prices[0] > PRICE * self.size(value))
        if np.isfinite(bound) and not stopped:  # the lower bound then holds for all masses
            limits, most, prices = limits[1:], most[1:], prices[1:]
        bounded = replace(problem, rows=-limits, slack=most - limits @ parameters)
        lower = bounded.lower_bound(Multipliers(blocks, prices), enough)
        cost = program.price_of_margin(solution.dual) * unit / self.size(value)
        inside = self.feasible_set.contains(parameters)
        return _Found(parameters, value, lower, stopped, cost, inside, self.units, margin, solution.status, blocks)

    def _limits(self, bound: float) -> tuple[Matrix, Vector]:
        """Rows over δ, and what they may be at most: the mass bound where there is one, then the parameter bound."""
        count = self.feasible_set.parameter_count
        rows = [np.zeros((0, count))]
        if np.isfinite(bound):
            mass = np.zeros((1, count))
            mass[0, self.feasible_set.conditioned_masses] = 1.0 / bound
            rows.append(mass)
        if self._attempt.bounded:
            rows.append(self._parameter_bound_rows)
        limits = np.vstack(rows)
        return limits, np.ones(len(limits))

    def _pulled(self, found: "_Found", best: "_Found") -> "_Found":
        """A point just outside, moved into the set along the line to one that is inside."""
        parameters = self.feasible_set.pull_inside(found.parameters, best.parameters)
        return replace(found, parameters=parameters, value=self.value(parameters), inside=True)

    def _problem(self, parameters: Vector, value: float) -> ConvexProblem:
        """The objective around δ, for its lower bound."""
        feasible_set, regression = self.feasible_set, self.regression
        root = regression.R @ feasible_set.K
        gradient = 2.0 * (root.T @ regression.residuals(feasible_set.K @ parameters))
        entropy = 0.0
        if self.prior is not None:
            factor = 2.0 * self.prior_weight * regression.variance
            gradient = gradient + factor * self.prior.slope(parameters)
            root = np.vstack([root, np.sqrt(factor) * self.prior.root()])
            entropy = factor * self.prior.entropy
        return self._convex(parameters, value, gradient, root, self.size(value), entropy)

    def _convex(
        self, parameters: Vector, value: float, gradient: Vector, root: Matrix, size: float, entropy: float
    ) -> ConvexProblem:
        """A problem over all parameters, without bounds on them."""
        count = self.feasible_set.parameter_count
        return ConvexProblem(
            feasible_set=self.feasible_set,
            point=parameters,
            directions=np.eye(count),
            units=self._typical,
            value=value,
            gradient=gradient,
            root=root,
            rows=np.zeros((0, count)),
            slack=np.zeros(0),
            size=size,
            entropy=entropy,
        )

    def same_base(
        self, tie_break: TieBreak | PreparedPrior, base: Vector, margin: float, near: Vector
    ) -> Choice | None:
        """The preferred parameters that have this base vector (as far as the data determines it), or None.

        If the solver ends outside the set, its point is moved towards the feasible parameters `near`, which have the
        same base vector.
        """
        found = []
        for around in (True, False):
            choice = self._of_base(tie_break, base, margin, near, around)
            if choice is not None:
                found.append(choice)
                if _order_of_choice(choice) < (False, False, np.inf):
                    break
        if not found:
            return None
        best, solution = min(found, key=_order_of_choice)
        self.statuses.append(solution.status)
        return best

    def _of_base(
        self, tie_break: TieBreak | PreparedPrior, base: Vector, margin: float, near: Vector, around: bool
    ) -> tuple[Choice, ConicSolution] | None:
        """Make one attempt, in units of the point that was found or in typical ones of the robot."""
        program = self._unidentifiable_program(LESSER_MARGIN * margin, base, around)
        objective, unit = _in_units(tie_break.part(program))
        solution = self._record(program.solve(objective, solver=self.solver))
        if not solution.usable:
            return None
        found = program.parameters(solution.primal)
        if not self.feasible_set.contains(found):
            inside = near + self.feasible_set.lift @ (base - self.feasible_set.K @ near)
            if not self.feasible_set.contains(inside):
                return None
            found = self.feasible_set.pull_inside(found, inside)
        problem = self._preferring(tie_break, found)
        problem = replace(problem, directions=program.conditions.matrix, units=program.columns)
        blocks = unit * program.stacked_dual(solution.dual)
        return self._choice(problem, Multipliers(blocks, np.zeros(0)), problem.value), solution

    def near(self, tie_break: TieBreak | PreparedPrior, margin: float, limit: float, bound: float) -> Choice | None:
        """The preferred parameters with a squared residual of at most `limit`, or None."""
        regression, feasible_set = self.regression, self.feasible_set
        program = self._base_program(margin)
        objective, unit = _in_units(tie_break.part(program))
        radius = float(np.sqrt(max(limit - regression.outside, regression.tiny)))
        ball = regression.ball(program.columns, radius, regression.residuals(feasible_set.K @ program.origin))
        limits, most = self._limits(2 * bound)
        solution = self._solve(program, objective, (ball, _limit_rows(program, limits, most)))
        if not solution.usable:
            return None
        self.statuses.append(solution.status)
        found = program.parameters(solution.primal)
        base = feasible_set.K @ found
        start = program.conditions.rows.shape[0]
        behind = start + len(ball.right)
        # The limit of the residual is added with its multiplier, so that its curvature tightens the bound.
        price = max(unit * float(solution.dual[start]) / (2 * radius**2), 0.0)
        preferred, root = self._preferring(tie_break, found), regression.R @ feasible_set.K
        problem = replace(
            preferred,
            value=preferred.value + price * (regression.squared_residual(base) - limit),
            gradient=preferred.gradient + 2.0 * price * (root.T @ regression.residuals(base)),
            root=np.vstack([preferred.root, np.sqrt(price) * root]),
            rows=-limits,
            slack=most - limits @ found,
        )
        blocks, prices = unit * program.stacked_dual(solution.dual), unit * solution.dual[behind : behind + len(limits)]
        return self._choice(problem, Multipliers(blocks, prices), preferred.value)

    def _preferring(self, tie_break: TieBreak | PreparedPrior, parameters: Vector) -> ConvexProblem:
        """The tie-break around δ, for its lower bound."""
        value, size = tie_break.value(parameters), tie_break.size(parameters)
        return self._convex(parameters, value, tie_break.slope(parameters), tie_break.root(), size, tie_break.entropy)

    def _choice(self, problem: ConvexProblem, multipliers: Multipliers, value: float) -> Choice:
        """The choice, with the lower bounds that the multipliers prove."""
        lower = problem.lower_bound(multipliers, problem.value - 0.1 * GAP * problem.size)
        count = self.feasible_set.parameter_count
        masses = np.zeros(count)
        masses[self.feasible_set.mass_indices] = 1.0
        mass = float(masses @ problem.point)
        only = replace(
            problem, value=mass, gradient=masses, root=np.zeros((0, count)), size=max(mass, 1e-300), entropy=0.0
        )
        return Choice(problem.point, (value - lower) / problem.size, only.lower_bound(multipliers))


@dataclass(frozen=True, eq=False)
class _Found:
    """Result of one attempt."""

    parameters: Vector
    value: float
    lower_bound: float
    stopped: bool
    price: float
    inside: bool
    units: Units
    margin: float
    status: str
    multipliers: Vector

    @property
    def order(self) -> tuple[bool, float]:
        """Sort key: points inside the set first, then the least value."""
        return (not self.inside, self.value)


def _order_of_choice(found: tuple[Choice, ConicSolution]) -> tuple[bool, bool, float]:
    """Sort key: choices with a small gap first, among them those that the solver was content with, then by the gap."""
    choice, solution = found
    return (not choice.gap <= CLOSE_CHOICE, solution.outcome is not Outcome.SOLVED, choice.gap)


def _in_units(part: Part) -> tuple[Part, float]:
    """The part divided by its largest coefficient, and that coefficient."""
    size = max(float(np.abs(part.q).max(initial=0.0)), float(part.P.diagonal().max(initial=0.0))) or 1.0
    return part.times(1.0 / size), size


def _limit_rows(program: Program, limits: Matrix, most: Vector) -> Rows:
    """The rows limits · δ ≤ most."""
    return Rows(limits @ program.scaled_matrix, most - limits @ program.origin, Cone("nonnegative", len(limits)))


# The search from within the set, beside a prior

FIRST_BARRIER = 1e-2
"""At which a search starts where there is no answer before; it moves answers by a tenth of what noise does."""

REDUCTION = 0.05
"""The factor by which the complementarity is reduced in each step. With 0.2 a cold start takes 18 steps, with 0.01 some
warm ones lose their centre and take 30; 0.05 takes 9 to 12 cold, 3 to 6 warm (the seven-joint arm)."""

TO_BOUNDARY = 0.95
"""Part of the way to the boundary of the set that a step goes at most."""

CAREFUL = 0.3
"""The same of searches that begin far from their end. Long steps lead to the boundary, along which they crawl: with the
usual part searches for robots of ten times the assumed masses had not arrived after 3000 steps; with this, 60 do."""

SHORTEST = 1e-6
"""Part of a step: where rounding lets even this leave the set, the search has ended."""

STATIONARY = 1e-9
"""Squared length of a Newton step in the local metric, below which it moves nothing."""

MOST_STEPS = 80
"""Far more than any start needs; it ends searches that rounding keeps from their end."""

START = 1e-3
"""Terms start at this part of their size where least squares have them at less, or below zero. With a tenth, the fits
of a cross-validation take twice as many steps, since most of what is friction of motors in a model with that of joints,
too, is next to zero."""


@dataclass(frozen=True, eq=False)
class WarmAnswer:
    """The point that a search reached.

    Attributes
    ----------
    parameters : (n,)
        Inside the set, whether or not the search ended.
    multipliers : (rows,)
        Of the stacked blocks of the set: a point of the dual cone, from which a lower bound of the objective follows.
    complementarity : float
        Of each condition, where the search was last close to the central path; infinite where it never was.
    converged : bool
        Whether the optimum was reached to the accuracy that was asked for, before the time or the steps ran out.
    """

    parameters: Vector = field(repr=False)
    multipliers: Vector = field(repr=False)
    complementarity: float
    converged: bool
    steps: int
    seconds: float


class WarmFit:
    """Minimises ½ ‖R K δ - ρ‖² / variance + weight · (distance from the prior) within a feasible set.

    A primal-dual interior-point method whose every iterate lies inside the set, so that it may be stopped at any time.
    Linear conditions have multipliers; matrices stay positive definite by a barrier as small as the complementarity,
    and by the prior's own logarithm of determinants. The margins (rows,) are stacked matrices that are subtracted from
    the blocks of the set; its margin in SI where absent. A step goes at most a part `to_boundary` of the way to
    the boundary of the set.

    Attributes
    ----------
    start : (n,) or None
        Where the next search starts.
    multipliers : (rows,)
        Those of the linear conditions with which it starts.
    """

    def __init__(
        self, feasible_set: FeasibleSet, margins: Vector | None = None, to_boundary: float = TO_BOUNDARY
    ) -> None:
        self.feasible_set = feasible_set
        self._to_boundary = to_boundary
        self.K = np.asarray(feasible_set.K)
        stack = feasible_set.stack
        self.margins = feasible_set.margin * stack.identity if margins is None else margins
        blocks = [
            replace(block, constant=block.constant - own)
            for block, own in zip(stack.blocks, stack.matrices(self.margins), strict=True)
        ]
        self._lines = LinearConditions(blocks, feasible_set.parameter_count)
        self._rows, self._constants = self._lines.rows, self._lines.constants
        self._groups = matrix_conditions(blocks)
        self._basis = feasible_set.equation_directions
        self.start: Vector | None = None
        self.multipliers = np.ones(len(self._rows))

    def inside(self, parameters: Vector) -> bool:
        """Return whether every condition holds with the margin, and matrices have the factors that a step needs."""
        if not np.all(self._rows @ parameters + self._constants > 0.0):
            return False
        try:
            for own, coefficients, constants in self._groups:
                matrices = constants + np.einsum("bi,biac->bac", parameters[own], coefficients)
                np.linalg.cholesky(matrices)
                # The barrier has an elimination of its own, which rounds otherwise.
                if not np.isfinite(log_determinants(matrices)).all():
                    return False
        except np.linalg.LinAlgError:
            return False
        return True

    def begin(self, parameters: Vector) -> None:
        """Start the next search here, inside the set.

        Raises
        ------
        SolverError
            If the parameters are not inside the set.
        """
        if not self.inside(parameters) or not self.feasible_set.satisfies_equations(parameters):
            raise SolverError("A search must start inside the feasible set; give parameters that satisfy it.")
        self.start = np.array(parameters)
        self.multipliers = FIRST_BARRIER / (self._rows @ parameters + self._constants)

    def solve(
        self,
        R: Vector,
        rho: Vector,
        variance: float,
        prior: PreparedPrior,
        weight: float,
        *,
        accuracy: float = 1e-6,
        seconds: float = np.inf,
        most_steps: int = MOST_STEPS,
    ) -> WarmAnswer:
        """Search from where the last search ended.

        Parameters
        ----------
        R, rho : (n_b, n_b), (n_b,)
            The reduced regression, weighted.
        variance : float
            Of its rows.
        accuracy : float
            Complementarity at which the search ends.
        seconds : float
            After which it is stopped where it is.
        most_steps : int
            After which it is stopped where it is, too.
        """
        begun = perf_counter()
        assert self.start is not None
        point, multipliers = self.start, self.multipliers
        scaled = (R @ self.K) / np.sqrt(variance)
        target = rho / np.sqrt(variance)
        curvature = scaled.T @ scaled
        slacks = self._rows @ point + self._constants
        # The multipliers may be far from the path where the data changed: the complementarity starts where they are.
        barrier = max(accuracy, min(FIRST_BARRIER, float(np.max(slacks * multipliers, initial=0.0))))
        steps, converged, reached = 0, False, np.inf
        while steps < most_steps and perf_counter() - begun < seconds:
            gradient = scaled.T @ (scaled @ point - target)
            hessian = curvature.copy()
            prior.add_derivatives(point[None], np.array([weight]), gradient[None], hessian[None])
            self._add_barriers(point, barrier, gradient, hessian)
            stiffness = multipliers / slacks
            self._lines.add_squares(np.sqrt(stiffness)[None], hessian[None])
            gradient -= self._rows.T @ (barrier / slacks)
            step = newton_solutions(hessian[None], -gradient[None, None], self._basis)[0, 0]
            decrease = -float(gradient @ step)
            change = self._rows @ step
            change_of_multipliers = barrier / slacks - multipliers - stiffness * change
            length = min(1.0, self._to_boundary * self._longest(point, step, slacks, change))
            dual_length = min(1.0, self._to_boundary * _times_until_zero(multipliers, change_of_multipliers))
            moved = point + length * step
            while length > SHORTEST and not self.inside(moved):
                length *= 0.5
                moved = point + length * step
            if length <= SHORTEST:  # as near to the boundary as rounding lets it
                break
            point = moved
            multipliers = multipliers + dual_length * change_of_multipliers
            slacks = self._rows @ point + self._constants
            steps += 1
            off_center = float(np.max(np.abs(slacks * multipliers / barrier - 1.0), initial=0.0))
            centered = length > 0.5 and decrease <= max(STATIONARY, barrier) and off_center < 0.9
            if centered:
                reached = barrier
            if barrier <= accuracy and length == 1.0 and decrease <= min(STATIONARY, accuracy) and off_center < 0.9:
                converged = True
                break
            if centered:
                barrier = max(accuracy, REDUCTION * barrier)
        self.start, self.multipliers = point, multipliers
        blocks = self._stacked(point, multipliers, reached if np.isfinite(reached) else barrier)
        return WarmAnswer(point, blocks, reached, converged, steps, perf_counter() - begun)

    def _stacked(self, point: Vector, multipliers: Vector, barrier: float) -> Vector:
        """Return the multipliers of all blocks, those of matrices by their barrier."""
        stack = self.feasible_set.stack
        values = stack.constant + stack.coefficients @ point - self.margins
        found = np.zeros(len(values))
        found[: stack.scalar_count] = multipliers
        for rows in stack.rows_by_size.values():
            found[rows] = barrier * symmetric_to_vector(
                np.asarray(np.linalg.inv(vector_to_symmetric(values[rows])), dtype=float)
            )
        return found

    def _add_barriers(self, point: Vector, factor: float, gradient: Vector, hessian: Vector) -> None:
        for own, coefficients, constants in self._groups:
            matrices = constants + np.einsum("bi,biac->bac", point[own], coefficients)
            add_log_determinants(matrices[None], coefficients, own, np.array([-factor]), gradient[None], hessian[None])

    def _longest(self, point: Vector, step: Vector, slacks: Vector, change: Vector) -> float:
        """Return how many times the step reaches the boundary of the set."""
        longest = _times_until_zero(slacks, change)
        for own, coefficients, constants in self._groups:
            matrices = constants + np.einsum("bi,biac->bac", point[own], coefficients)
            roots = np.linalg.inv(np.linalg.cholesky(matrices))
            moved = roots @ np.einsum("bi,biac->bac", step[own], coefficients) @ roots.swapaxes(-1, -2)
            least = float(np.linalg.eigvalsh(moved)[:, 0].min())
            if least < 0.0:
                longest = min(longest, -1.0 / least)
        return longest


def _times_until_zero(values: Vector, change: Vector) -> float:
    """Return how many times a change can be added to positive values until the first of them is zero."""
    falling = change < 0.0
    return float(np.min(values[falling] / -change[falling], initial=np.inf))


def start_near(
    prior: PreparedPrior,
    weight: float,
    curvature: Vector,
    slope: Vector,
    sizes: Vector,
    inside: Callable[[Vector], bool],
) -> Vector | None:
    """Parameters inside a set: the prior's; None where conditions forbid these.

    Terms that the prior does not know are those of least squares beside its links, if they are positive.

    Parameters
    ----------
    curvature, slope : (n, n), (n,)
        Of the data: the objective is ½ δᵀ curvature δ - slope · δ beside the prior.
    sizes : (n,)
        Typical sizes of terms.
    inside : callable
        Whether parameters (n,) are inside.
    """
    start = prior.reference.copy()
    terms = np.setdiff1d(np.arange(len(start)), prior.feasible_set.link_columns)
    zero = terms[start[terms] == 0.0]
    stiffness = curvature[np.ix_(zero, zero)] + np.diag(weight * prior.diagonal[zero])
    likely = np.linalg.lstsq(stiffness, (slope - curvature @ start)[zero])[0]
    least = START * sizes[zero]
    for values in (np.maximum(likely, least), least):
        start[zero] = values
        if prior.feasible_set.satisfies_equations(start) and inside(start):
            return start
    return None
