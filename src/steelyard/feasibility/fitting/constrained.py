"""Least squares within the feasible set, on a reduced regression."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import InputError, SolverError

from ..conic import Cone, ConicProblem, ConicSolution, Outcome, solve
from ..constraints import TotalMass
from ..feasible_set import FeasibleSet
from ..protocols import ReducedLike
from .interior import MARGIN_FACTORS, pull_inside
from .preference import Preference, closest_to_cad, lightest

__all__ = ["FeasibleFit", "fit_reduced"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

MASS_BOUND = 1000.0
"""Bound on the total mass while the best residual is looked for, in kg (20 times a known mass, where that is more)."""

LARGEST_BOUND, HEAVIER_PAYS = 1e7, 0.9
"""The bound is raised, up to the first, where a hundred times the mass leaves less than the second of the squared
residual: then the robot is that heavy."""

TRACE_PER_MASS = 100.0
"""Bound on the sum of the traces of all blocks, for each kg of the mass bound."""

TIE_TOLERANCES = (1e-8, 1e-6)
"""What the preferred answer may cost, relative to the squared residual, where least squares is feasible; the second
where the solver finds no answer within the first."""

PRICE_FRACTION = 0.008
"""Part of the price of feasibility that the preferred answer may cost: what the model misses anyway says how near is
near."""

DEAREST = 0.02
"""That part is at most this, relative to the squared residual."""

RIDGE = 1e-12
"""Curvature that settles unknowns which neither data nor conditions bound, in units of the scaled objective."""


@dataclass(frozen=True, eq=False)
class FeasibleFit:
    """Constrained least squares of a reduced regression.

    Attributes
    ----------
    base : (n_b,)
    parameters : (n,)
        Every block is proved positive definite there.
    squared_residual : float
        ‖W β - ω‖² of the (weighted) regression.
    best_squared_residual : float
        Lowest that was found, with the mass bound.
    unconstrained_squared_residual : float
    total_mass : float
        In kg.
    attained : bool
        Whether an optimum exists below the mass bound.
    mass_bound : float
        In kg.
    iterations : int
        Of the solver, in both stages.
    remarks : tuple of str
        What the user should know, in sentences.
    """

    base: Vector = field(repr=False)
    parameters: Vector = field(repr=False)
    squared_residual: float
    best_squared_residual: float
    unconstrained_squared_residual: float
    total_mass: float
    attained: bool
    mass_bound: float
    iterations: int
    remarks: tuple[str, ...]


def fit_reduced(
    reduced: ReducedLike,
    feasible: FeasibleSet,
    prefer: Literal["lightest", "cad"] | None = "lightest",
    tolerance: float = 5e-4,
) -> FeasibleFit:
    """Minimise ‖R K δ - ρ‖² + residual2 over the feasible set (thesis 3.53, 3.58), in two stages.

    First the least residual with a bound on the total mass, since the residual of a robot's data often keeps falling
    as unidentifiable masses grow without end. Then, among all answers whose squared residual is at most (1 + tolerance)
    times the least one, the preferred; where plain least squares is feasible the tolerance is not
    spent, and only ties (to 1e-8) are decided by preference.

    Parameters
    ----------
    reduced : Reduced
        R (n_b, n_b), rho (n_b,), residual2, count, norm2.
    feasible : FeasibleSet
    prefer : {"lightest", "cad", None}
        ``None`` returns the first stage as it is.
    tolerance : float
        Fraction of the squared residual that may be spent where plain least squares is infeasible; 0.008 of what
        feasibility itself costs, where that is more.

    Returns
    -------
    FeasibleFit

    Raises
    ------
    InputError
        For an unknown preference, a negative tolerance, ``"cad"`` without CAD, or data of another model.
    SolverError
        If the set is empty or no point of it was found.
    """
    if prefer not in ("lightest", "cad", None):
        raise InputError(f'prefer must be "lightest", "cad" or None, got {prefer!r}.')
    if isinstance(tolerance, bool) or not isinstance(tolerance, (int, float)) or not 0 <= tolerance < np.inf:
        raise InputError(f"tolerance must be a number of at least 0, such as 5e-4, got {tolerance!r}.")
    preference = {"lightest": lightest, "cad": closest_to_cad}[prefer](feasible) if prefer is not None else None
    regression = _Regression.of(reduced, feasible)
    bound = _mass_bound(feasible)

    outside: Vector | None = None
    for factor in MARGIN_FACTORS:
        margin = factor * feasible.margin
        best = _optimum(regression, margin, bound)
        found, near, iterations = best.parameters, 0.0, best.iterations
        if preference is not None:
            near = max(tolerance, min(PRICE_FRACTION * regression.price(best.squared_residual), DEAREST))
            ties = regression.least_squares_is_feasible(best.squared_residual) or tolerance < TIE_TOLERANCES[0]
            found, more = _preferred(regression, preference, margin, best, TIE_TOLERANCES if ties else (near,))
            iterations += more
        if feasible.contains(found):
            if outside is not None:
                found = pull_inside(feasible, outside, found)
            return regression.report(found, best, prefer, near, iterations)
        outside = found if outside is None else outside
    raise SolverError(
        "Clarabel ended outside the feasible set with every margin tried; check that the constraints leave room and "
        f"that units are SI, or give FeasibleSet a larger margin than {feasible.margin:g}."
    )


@dataclass(frozen=True, eq=False)
class _Optimum:
    """Least residual below a mass bound."""

    parameters: Vector
    squared_residual: float
    attained: bool
    bound: float
    iterations: int


def _optimum(regression: "_Regression", margin: float, bound: float) -> _Optimum:
    """First stage; the bound is raised where the robot turns out to be heavier."""

    def below(limit: float) -> _Optimum:
        solution = regression.least_residual(margin, limit)
        parameters = regression.parameters(solution)
        attained = not regression.stopped_by_bound(solution, parameters, limit)
        return _Optimum(parameters, regression.squared_residual(parameters), attained, limit, solution.iterations)

    best = below(bound)
    while not best.attained and best.bound < LARGEST_BOUND:
        try:
            heavier = below(100.0 * best.bound)
        except SolverError:  # the answer below the lower bound stands
            break
        if heavier.squared_residual > HEAVIER_PAYS * best.squared_residual:
            break
        best = heavier
    return best


def _preferred(
    regression: "_Regression", preference: Preference, margin: float, best: _Optimum, tolerances: tuple[float, ...]
) -> tuple[Vector, int]:
    """Second stage: the preferred parameters within the first tolerance that works, else the optimum; iterations."""
    iterations = 0
    for spent in tolerances:
        limit = best.squared_residual * (1 + spent)
        solution = regression.preferred(preference, margin, limit, best.bound, best.parameters)
        iterations += solution.iterations
        candidate = regression.parameters(solution)
        allowed = best.squared_residual * (1 + 1.01 * spent) + 2 * regression.tiny
        affordable = regression.squared_residual(candidate) <= allowed
        if solution.outcome.usable and affordable and regression.feasible.contains(candidate):
            return candidate, iterations
    return best.parameters, iterations


def _mass_bound(feasible: FeasibleSet) -> float:
    """The mass bound, in kg; well above what CAD and the constraints say of the mass."""
    cad = np.asarray(feasible.model.robot.parameters, dtype=float)[feasible.mass_indices]
    known = [float(cad.sum())] if np.all(np.isfinite(cad)) else []
    for constraint in feasible.constraints:
        if isinstance(constraint, TotalMass):
            known += [value for value in (constraint.minimum, constraint.equal) if value is not None]
    return max([MASS_BOUND, *(20.0 * mass for mass in known)])


@dataclass(frozen=True, eq=False)
class _Regression:
    """A reduced regression, scaled, over (y, β, δ_d) with y = (R β - ρ) / √scale."""

    reduced: ReducedLike
    feasible: FeasibleSet
    R: Matrix
    rho: Vector
    scale: float

    @classmethod
    def of(cls, reduced: ReducedLike, feasible: FeasibleSet) -> "_Regression":
        R, rho = np.asarray(reduced.R, dtype=float), np.asarray(reduced.rho, dtype=float)
        count = feasible.K.shape[0]
        if R.ndim != 2 or R.shape[1] != count or rho.shape != (R.shape[0],):
            raise InputError(
                f"the data belongs to another model: its reduced regression has R of shape {R.shape}, but the "
                f"feasible set is of a model with {count} base parameters; use the Information of the same model."
            )
        if not (np.all(np.isfinite(R)) and np.all(np.isfinite(rho)) and reduced.norm2 > 0):
            raise InputError("the data holds no usable samples: its torques are all zero or not finite numbers.")
        # In units of the unconstrained squared residual, or of a millionth of ‖ω‖² where the data has almost no noise.
        return cls(reduced, feasible, R, rho, max(float(reduced.residual2), 1e-6 * float(reduced.norm2)))

    @property
    def tiny(self) -> float:
        """Squared residual that the solver does not resolve."""
        return 1e-9 * self.scale

    def parameters(self, solution: ConicSolution) -> Vector:
        """δ of a solution."""
        unknowns = solution.primal[len(self.rho) :]
        return self.feasible.project_on_equations(self.feasible.base_dependent @ unknowns)

    def squared_residual(self, parameters: Vector) -> float:
        """‖W K δ - ω‖²."""
        error = self.R @ (self.feasible.K @ parameters) - self.rho
        return float(error @ error) + float(self.reduced.residual2)

    def _problem(
        self, P: sparse.csc_array, q: Vector, margin: float, bound: float, radius: float | None
    ) -> ConicProblem:
        """Equations, bounds, the ball ‖y‖ ≤ radius where given, and the blocks."""
        feasible, stack = self.feasible, self.feasible.stack
        rows, count = len(self.rho), feasible.parameter_count
        transform = feasible.base_dependent
        root = np.sqrt(self.scale)
        regression = np.hstack([self.R / root, np.zeros((rows, count - self.R.shape[1]))])
        mass_row = transform[feasible.mass_indices].sum(axis=0)
        bounds = np.vstack([mass_row / bound, feasible.trace_row @ transform / (TRACE_PER_MASS * bound)])

        def beside(right: Any) -> sparse.csc_array:
            return sparse.csc_array(sparse.hstack([sparse.csc_array((right.shape[0], rows)), right]))

        equations = sparse.csc_array(feasible.equation_matrix @ transform)
        pieces = [
            sparse.hstack([-sparse.eye_array(rows), sparse.csc_array(regression)]),
            beside(equations),
            beside(sparse.csc_array(bounds)),
            beside(-feasible.stacked_base_dependent),
        ]
        values = [self.rho / root, feasible.equation_values, np.ones(2), stack.constant - margin * stack.identity]
        cones = [
            Cone("zero", rows + equations.shape[0]),
            Cone("nonnegative", 2 + stack.scalar_count),
            *(Cone("semidefinite", size) for size in stack.matrix_sizes),
        ]
        if radius is not None:
            ball = sparse.vstack([sparse.csc_array((1, rows)), -sparse.eye_array(rows)])
            pieces.append(sparse.hstack([ball, sparse.csc_array((rows + 1, count))]))
            values.append(np.concatenate([[radius], np.zeros(rows)]))
            cones.append(Cone("second-order", rows + 1))
        A = sparse.csc_array(sparse.vstack(pieces, format="csc"))
        return ConicProblem(P, q, A, np.concatenate(values), tuple(cones))

    def least_residual(self, margin: float, bound: float) -> ConicSolution:
        """First stage: minimise ‖y‖²."""
        rows, count = len(self.rho), self.feasible.parameter_count
        weights = np.concatenate([np.full(rows, 2.0), np.full(count, RIDGE)])
        P = sparse.csc_array(sparse.diags_array(weights, format="csc"))
        solution = solve(self._problem(P, np.zeros(rows + count), margin, bound, None))
        if solution.outcome is Outcome.INFEASIBLE:
            raise SolverError(
                f"no parameters satisfy all of the {len(self.feasible.blocks)} conditions with margin {margin:g} and "
                f"a total mass below {bound:g} kg (Clarabel: {solution.status}); loosen the constraints, which "
                "contradict each other."
            )
        return solution.require("fit the data within the feasible set")

    def stopped_by_bound(self, solution: ConicSolution, parameters: Vector, bound: float) -> bool:
        """Whether the residual would fall further with more mass: the bound is reached and has a price."""
        start = len(self.rho) + len(self.feasible.equalities)
        price = solution.dual[start : start + 2]
        use = np.array(
            [
                parameters[self.feasible.mass_indices].sum() / bound,
                self.feasible.trace_row @ parameters / (TRACE_PER_MASS * bound),
            ]
        )
        objective = self.squared_residual(parameters) / self.scale
        return bool(np.any((use > 0.99) & (price > 1e-6 * objective)))

    def preferred(
        self, preference: Preference, margin: float, limit: float, bound: float, start: Vector
    ) -> ConicSolution:
        """Second stage: minimise the preference subject to a squared residual of at most `limit`."""
        rows = len(self.rho)
        radius = float(np.sqrt((max(limit - float(self.reduced.residual2), 0.0) + self.tiny) / self.scale))
        P, q = preference.quadratic(self.feasible.base_dependent, max(1.0, 1e-3 * abs(preference.value(start))))
        P = sparse.csc_array(sparse.block_diag([sparse.csc_array((rows, rows), dtype=float), P], format="csc"))
        return solve(self._problem(P, np.concatenate([np.zeros(rows), q]), margin, 2 * bound, radius))

    def price(self, best: float) -> float:
        """What the conditions cost in squared residual, relative to that of plain least squares."""
        return max(best / max(float(self.reduced.residual2), self.tiny) - 1.0, 0.0)

    def least_squares_is_feasible(self, best: float) -> bool:
        """Whether the conditions cost nothing, so that the base parameters are those of plain least squares."""
        return best <= float(self.reduced.residual2) * (1 + 1e-7) + self.tiny

    def report(
        self, parameters: Vector, best: _Optimum, prefer: str | None, tolerance: float, iterations: int
    ) -> FeasibleFit:
        """Pack the answer, with remarks in words."""
        feasible = self.feasible
        mass = float(parameters[feasible.mass_indices].sum())
        value = self.squared_residual(parameters)
        remarks = []
        if not best.attained:
            remarks.append(
                f"No optimum below {best.bound:g} kg: the residual keeps falling as masses that the motion does not "
                "show "
                "grow."
            )
            if prefer is None:
                remarks.append(f"The answer lies at that bound, with a total mass of {mass:.4g} kg.")
        chosen = {"lightest": "the lightest", "cad": "the closest to CAD"}
        if prefer is not None and not self.least_squares_is_feasible(best.squared_residual):
            remarks.append(
                f"Among all answers within {100 * tolerance:.2g} % of the least squared residual this is "
                f"{chosen[prefer]}: total mass {mass:.4g} kg, at a price of "
                f"{100 * max(0.0, value / best.squared_residual - 1):.2g} % in squared residual."
            )
        elif prefer is not None:
            remarks.append(
                f"Among all standard parameters of these base parameters this is {chosen[prefer]}: total mass "
                f"{mass:.4g} kg."
            )
        unconstrained = float(self.reduced.residual2)
        return FeasibleFit(
            base=feasible.K @ parameters,
            parameters=parameters,
            squared_residual=value,
            best_squared_residual=best.squared_residual,
            unconstrained_squared_residual=unconstrained,
            total_mass=mass,
            attained=best.attained,
            mass_bound=best.bound,
            iterations=iterations,
            remarks=tuple(remarks),
        )
