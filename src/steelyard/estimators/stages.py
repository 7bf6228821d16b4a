"""The problems that a fit solves: the least residual, the choice of the same base parameters, and among near-equals."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.linalg

from steelyard.conic import Cone, ConicSolution, Outcome, Rows
from steelyard.errors import SolverError
from steelyard.feasibility.cone_program import Conditions, Part, Program, total, unidentifiable_conditions
from steelyard.feasibility.dual_bound import PARAMETER_BOUND, ConvexProblem, Multipliers
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.feasibility.interior import pull_inside
from steelyard.feasibility.tie_break import TieBreak
from steelyard.feasibility.units import Units

from .prior import PreparedPrior
from .reduced import ReducedRegression

__all__ = ["CLOSE_CHOICE", "GAP", "Choice", "Fitting", "Optimum"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

DEAR_MARGIN = 1e-5
"""Units are taken anew where the margin costs more than this part of the squared residual, since links are smaller than
their units."""

CHEAP_MARGIN = 0.2e-6
"""The margin is lessened until it costs about this part of the objective, as long as the answer stays in the set."""

LESSER_MARGIN = 0.1
"""Part of the margin that is kept while the preference chooses among the parameters of one base vector: the optimum
lies on the boundary of those with the whole margin."""

PRICE = 1e-6
"""A mass bound stops the residual where its multiplier is more than this part of the squared residual."""


def base_dependent_conditions(feasible_set: FeasibleSet) -> Conditions:
    """Over (β, δ_d)."""
    return Conditions(feasible_set, feasible_set.base_dependent)


@dataclass(frozen=True, eq=False)
class Optimum:
    """The least objective below a mass bound.

    Attributes
    ----------
    parameters : (n,)
    base : (n_b,)
    squared_residual : float
    attained : bool
        Whether the mass bound is not what stops it.
    bound : float
        In kg; infinite without.
    lower_bound : float
        No feasible parameters with a mass below the bound, and within the parameter bound, have a lesser objective, in
        units of the squared residual.
    price_of_margin : float
        What the distance from the boundary costs, to first order, relative to the objective.
    beyond : tuple of int
        Links whose parameters lie beyond the parameter bound.
    margin : float
        With which it was found.
    multipliers : (rows,)
        Of the stacked blocks of the set, in SI; the solver's own, from which the lower bound was made.
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
    """How a problem is put to the solver.

    Attributes
    ----------
    apart : bool
        Whether the residuals are unknowns of their own in any case.
    around : bool
        Whether units are those of the point found before, not those of the robot.
    balanced : bool
        Whether the solver may take the units as they are, see `Program.solve`.
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
"""What is tried, one after the other, each around the best point of those before and in units of its residual, until
the measured gap is small."""

CLOSE_CHOICE = 1e-3
"""Relative gap with which a choice counts as the preferred one."""

GAP = 1e-6
"""Relative gap with which an optimum counts as found."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Parameters that a preference chose.

    Attributes
    ----------
    parameters : (n,)
    gap : float
        By how much no others among which it chose are better, relative to the size of what it weighs; nan where no
        bound is known.
    least_mass : float
        No others among which it chose are lighter, in kg.
    """

    parameters: Vector = field(repr=False)
    gap: float
    least_mass: float


@dataclass(eq=False)
class Fitting:
    """A regression within a feasible set, and what the solver said on the way.

    Attributes
    ----------
    feasible_set : FeasibleSet
    regression : ReducedRegression
    units : Units
    solver : str
    prior : PreparedPrior, optional
    prior_weight : float
        Factor of the prior's distance beside half the squared residual, in units of its variance.
    """

    feasible_set: FeasibleSet
    regression: ReducedRegression
    units: Units
    solver: str
    prior: PreparedPrior | None = None
    prior_weight: float = 0.0
    iterations: int = 0
    seconds: float = 0.0
    statuses: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        independent = np.asarray(self.feasible_set.model.base_parameters().independent, np.intp)
        self._scale = self.regression.scale
        self._origin = self.feasible_set.lift @ self.regression.middle(self.units.parameters[independent])
        self._attempt = ATTEMPTS[0]
        self._typical = self.units.parameters

    @cached_property
    def _parameter_bound_rows(self) -> Matrix:
        """Rows over δ that are at most 1 within the parameter bound, (k, n): one a link, two for every other."""
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
        """Over (β, δ_d)."""
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
        """Measure from this point, in units of its residual, from now on."""
        self._origin = parameters
        residual2 = self.regression.squared_residual(self.feasible_set.K @ parameters)
        self._scale = max(residual2, self.regression.least_size)

    def _middle(self, program: Program) -> Vector:
        """The point of least objective without conditions, in the metric that the prior has at its centre.

        Around it the objective has no large constant, beside which the solver could not tell small differences.
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
        except np.linalg.LinAlgError:  # friction that neither prior nor data tell
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
        # Links of a thousandth stand beside others; the point found tells their sizes.
        units = self.units.around(self._origin).parameters if around else typical
        origin = self._origin + feasible_set.lift @ (base - feasible_set.K @ self._origin)
        return Program.along(feasible_set, conditions, units, origin, margin, typical)

    @property
    def is_identifiable(self) -> bool:
        """Whether the base parameters tell all parameters, and the data tells all of them."""
        return not (self.feasible_set.unidentifiable.shape[1] or self.regression.unidentifiable.shape[1])

    def objective(self, program: Program) -> Part:
        """The squared residual, and the prior beside it."""
        base = self.feasible_set.K @ program.origin
        data = self.regression.objective(program.columns, base, self._scale, self._attempt.apart)
        if self.prior is None:
            return data
        whole = total([data, self.prior.part(program).times(self._prior_factor)], len(program.columns))
        return whole.times(1.0 / max(1.0, self._prior_factor))

    @property
    def _prior_factor(self) -> float:
        """Of the distance, where the squared residual is divided by its scale.

        Half the squared residual in units of its variance, beside the weight times the distance: all that times
        2 variance / scale.
        """
        return 2.0 * self.prior_weight * self.regression.variance / self._scale

    def value(self, parameters: Vector) -> float:
        """The objective at δ, in units of the squared residual."""
        value = self.regression.squared_residual(self.feasible_set.K @ parameters)
        if self.prior is not None:
            value += 2.0 * self.prior_weight * self.regression.variance * self.prior.distance(parameters)
        return value

    def size(self, value: float) -> float:
        """What gaps of an objective with this value are relative to."""
        return max(value, self.regression.least_size)

    def least(self, margin: float, bound: float) -> Optimum:
        """The least objective with a total mass below the bound.

        Raises
        ------
        SolverError
            If no parameters satisfy the conditions, or the solver found none.
        """
        if self.prior is not None:
            self._origin = self._middle(self._base_program(margin))
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
            # What the margin costs is no fault of the solver's, once it has been lessened.
            if gap <= GAP or (gap - best.price <= GAP and number > 1):
                break
        assert best is not None
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

    def _found(self, margin: float, bound: float, before: "_Found | None") -> "_Found | None":
        """One attempt; None where it failed after another one had found something."""
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
        enough = value - 0.1 * GAP * self.size(value)
        stopped = bool(np.isfinite(bound) and limits[0] @ parameters > 0.99 and prices[0] > PRICE * self.size(value))
        if np.isfinite(bound) and not stopped:  # a bound that holds without the mass bound, too
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
        parameters = pull_inside(self.feasible_set, found.parameters, best.parameters)
        return replace(found, parameters=parameters, value=self.value(parameters), inside=True)

    def _problem(self, parameters: Vector, value: float) -> ConvexProblem:
        """The objective as it looks from δ."""
        feasible_set, regression = self.feasible_set, self.regression
        root = regression.R @ feasible_set.K
        gradient = 2.0 * (root.T @ regression.residuals(feasible_set.K @ parameters))
        entropy = 0.0
        if self.prior is not None:
            factor = 2.0 * self.prior_weight * regression.variance
            gradient = gradient + factor * self.prior.slope(parameters)
            root = np.vstack([root, np.sqrt(factor) * self.prior.root()])
            entropy = factor * self.prior.entropy
        return ConvexProblem(
            feasible_set=feasible_set,
            point=parameters,
            directions=np.eye(feasible_set.parameter_count),
            units=self._typical,
            value=value,
            gradient=gradient,
            root=root,
            rows=np.zeros((0, feasible_set.parameter_count)),
            slack=np.zeros(0),
            size=self.size(value),
            entropy=entropy,
        )

    def same_base(
        self, preference: TieBreak | PreparedPrior, base: Vector, margin: float, near: Vector
    ) -> Choice | None:
        """The preferred parameters that have this base vector (as far as the data tells it), or None.

        What the solver finds outside is pulled towards parameters of that base vector that are `near`, if these are
        feasible.
        """
        best: tuple[Choice, ConicSolution] | None = None
        for around in (True, False):
            found = self._of_base(preference, base, margin, near, around)
            if found is not None and (best is None or found[0].gap < best[0].gap):
                best = found
            if best is not None and best[0].gap <= CLOSE_CHOICE and best[1].outcome is Outcome.SOLVED:
                break
        if best is None:
            return None
        self.statuses.append(best[1].status)
        return best[0]

    def _of_base(
        self, preference: TieBreak | PreparedPrior, base: Vector, margin: float, near: Vector, around: bool
    ) -> tuple[Choice, ConicSolution] | None:
        """One attempt at it, in units of the point found or in those of the robot."""
        program = self._unidentifiable_program(LESSER_MARGIN * margin, base, around)
        objective, unit = _in_units(preference.part(program))
        solution = self._record(program.solve(objective, solver=self.solver))
        if not solution.usable:
            return None
        found = program.parameters(solution.primal)
        if not self.feasible_set.contains(found):
            inside = near + self.feasible_set.lift @ (base - self.feasible_set.K @ near)
            if not self.feasible_set.contains(inside):
                return None
            found = pull_inside(self.feasible_set, found, inside)
        problem = self._preferring(preference, found)
        problem = replace(problem, directions=program.conditions.matrix, units=program.columns)
        blocks = unit * program.stacked_dual(solution.dual)
        return self._choice(problem, Multipliers(blocks, np.zeros(0)), problem.value), solution

    def near(self, preference: TieBreak | PreparedPrior, margin: float, limit: float, bound: float) -> Choice | None:
        """The preferred parameters with a squared residual of at most `limit`, or None."""
        regression, feasible_set = self.regression, self.feasible_set
        program = self._base_program(margin)
        objective, unit = _in_units(preference.part(program))
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
        # The residual's limit enters with its multiplier, so that its curvature counts.
        price = max(unit * float(solution.dual[start]) / (2 * radius**2), 0.0)
        preferred, root = self._preferring(preference, found), regression.R @ feasible_set.K
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

    def _preferring(self, preference: TieBreak | PreparedPrior, parameters: Vector) -> ConvexProblem:
        """The preference as it looks from δ."""
        count = self.feasible_set.parameter_count
        return ConvexProblem(
            feasible_set=self.feasible_set,
            point=parameters,
            directions=np.eye(count),
            units=self._typical,
            value=preference.value(parameters),
            gradient=preference.slope(parameters),
            root=preference.root(),
            rows=np.zeros((0, count)),
            slack=np.zeros(0),
            size=preference.size(parameters),
            entropy=preference.entropy,
        )

    def _choice(self, problem: ConvexProblem, multipliers: Multipliers, value: float) -> Choice:
        """With the bounds that the multipliers prove."""
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
    """What one attempt found."""

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
        """Points of the set first, then the least."""
        return (not self.inside, self.value)


def _in_units(part: Part) -> tuple[Part, float]:
    """In units of its largest coefficient, and that."""
    size = max(float(np.abs(part.q).max(initial=0.0)), float(part.P.diagonal().max(initial=0.0))) or 1.0
    return part.times(1.0 / size), size


def _limit_rows(program: Program, limits: Matrix, most: Vector) -> Rows:
    """limits δ ≤ most."""
    return Rows(limits @ program.scaled_matrix, most - limits @ program.origin, Cone("nonnegative", len(limits)))
