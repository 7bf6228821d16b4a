"""The problems that a fit solves: the least residual, the choice of the same base parameters, and among near-equals."""

from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sparse

from steelyard.errors import SolverError

from ..conic import Cone, ConicSolution, Outcome
from ..feasible_set import FeasibleSet
from .interior import pull_inside
from .objective import Part, total
from .preference import Preference
from .prior import PreparedPrior
from .program import Conditions, Program, Rows, widened
from .reduced import ReducedRegression
from .units import Units

__all__ = ["Fitting", "Optimum"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

DEAR_MARGIN = 1e-5
"""Units are taken anew where the margin costs more than this part of the squared residual, since links are smaller than
their units."""

LESSER_MARGINS = (0.1, 1e-2, 1e-4)
"""Parts of the margin that are kept while the preference chooses among the parameters of one base vector: the optimum
lies on the boundary of those with the whole margin, and plain least squares may give links smaller than that."""

PRICE = 1e-6
"""A mass bound stops the residual where its multiplier is more than this part of the squared residual."""

_BASE_CONDITIONS: "WeakKeyDictionary[FeasibleSet, Conditions]" = WeakKeyDictionary()
_FREE_CONDITIONS: "WeakKeyDictionary[FeasibleSet, Conditions]" = WeakKeyDictionary()


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
    """

    parameters: Vector = field(repr=False)
    base: Vector = field(repr=False)
    squared_residual: float
    attained: bool
    bound: float


@dataclass(eq=False)
class Fitting:
    """A regression within a feasible set, and what the solver said on the way.

    Attributes
    ----------
    feasible : FeasibleSet
    regression : ReducedRegression
    units : Units
    solver : str
    prior : PreparedPrior, optional
    prior_weight : float
        Factor of the prior's distance beside half the squared residual, in units of its variance.
    """

    feasible: FeasibleSet
    regression: ReducedRegression
    units: Units
    solver: str
    prior: PreparedPrior | None = None
    prior_weight: float = 0.0
    iterations: int = 0
    seconds: float = 0.0
    statuses: list[str] = field(default_factory=list)

    def _record(self, solution: ConicSolution) -> ConicSolution:
        self.iterations += solution.iterations
        self.seconds += solution.seconds
        self.statuses.append(solution.status)
        return solution

    def _base_program(self, margin: float) -> Program:
        """Over (β - β̂, δ_d)."""
        feasible = self.feasible
        conditions = _BASE_CONDITIONS.get(feasible)
        if conditions is None:
            conditions = _BASE_CONDITIONS[feasible] = Conditions(feasible, feasible.base_dependent)
        base = feasible.model.base_parameters()
        order = np.concatenate([np.asarray(base.independent, np.intp), np.asarray(base.dependent, np.intp)])
        units = self.units.parameters
        origin = feasible.lift @ self.regression.base
        program = Program(feasible, conditions, units, units[order], origin, margin)
        return program if self.prior is None else replace(program, origin=self._middle(program))

    def _middle(self, program: Program) -> Vector:
        """The point of least objective without conditions, in the metric that the prior has at its centre.

        Around it the objective has no large constant, beside which the solver could not tell small differences.
        """
        if self.prior is None:
            return program.origin
        matrix = program.scaled_matrix
        factor = self._prior_factor
        data = self.regression.R * (program.columns[: len(self.regression.base)] / np.sqrt(self.regression.scale))
        curvature = factor * self.prior.curvature()
        P = matrix.T @ (curvature @ matrix)
        P[: len(data), : len(data)] += 2.0 * (data.T @ data)
        q = matrix.T @ (curvature @ (program.origin - self.prior.reference))
        sizes = np.sqrt(np.maximum(np.diagonal(P), 1e-300))
        scaled = P / np.outer(sizes, sizes)
        try:
            step = scipy.linalg.cho_solve(scipy.linalg.cho_factor(scaled), q / sizes)
        except np.linalg.LinAlgError:  # friction that neither prior nor data tell
            step = np.linalg.lstsq(scaled, q / sizes, rcond=1e-13)[0]
        return np.asarray(program.origin - matrix @ (step / sizes))

    def _free_program(self, margin: float, base: Vector) -> Program:
        """Over what neither motion nor data show, at a base vector."""
        feasible, undetermined = self.feasible, self.regression.undetermined
        if undetermined.shape[1]:
            conditions = Conditions(feasible, np.hstack([feasible.lift @ undetermined, feasible.unidentifiable]))
        else:
            known = _FREE_CONDITIONS.get(feasible)
            conditions = known if known is not None else Conditions(feasible, feasible.unidentifiable)
            _FREE_CONDITIONS[feasible] = conditions
        units = self.units.parameters
        sizes = np.abs(conditions.matrix / units[:, None]).max(axis=0, initial=0.0)
        columns = 1.0 / np.where(sizes > 0, sizes, 1.0)
        return Program(feasible, conditions, units, columns, feasible.lift @ base, margin)

    @property
    def is_determined(self) -> bool:
        """Whether the base parameters tell all parameters, and the data tells all of them."""
        return not (self.feasible.unidentifiable.shape[1] or self.regression.undetermined.shape[1])

    def objective(self, program: Program) -> Part:
        """The squared residual, and the prior beside it."""
        shift = None if self.prior is None else self.feasible.K @ program.origin - self.regression.base
        P, q, rows = self.regression.objective(program.columns, shift)
        data = Part(P, q, rows, len(q) - len(program.columns))
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
        return 2.0 * self.prior_weight * self.regression.variance / self.regression.scale

    def least(self, margin: float, bound: float) -> Optimum:
        """The least objective with a total mass below the bound.

        Raises
        ------
        SolverError
            If no parameters satisfy the conditions, or the solver found none.
        """
        found, solution, price = self._least(margin, bound)
        if price > DEAR_MARGIN:
            before, value = self.units, self._value(found)
            self.units = before.refined(found)
            again, finer, _ = self._least(margin, bound)
            if self._value(again) <= value * (1 + 1e-6) and finer.outcome.usable:
                found, solution = again, finer
            else:  # the solver did worse, though more was allowed
                self.units = before
        base = self.feasible.K @ found
        squared = self.regression.squared_residual(base)
        stopped = np.isfinite(bound) and self._stopped(solution, found, bound, squared)
        return Optimum(found, base, squared, not stopped, bound)

    def _value(self, parameters: Vector) -> float:
        """The objective at δ, in units of the squared residual."""
        value = self.regression.squared_residual(self.feasible.K @ parameters)
        if self.prior is not None:
            value += self._prior_factor * self.regression.scale * self.prior.distance(parameters)
        return value

    def _least(self, margin: float, bound: float) -> tuple[Vector, ConicSolution, float]:
        """Parameters, the solution, and what the margin costs relative to the squared residual."""
        program = self._base_program(margin)
        objective = self.objective(program)
        rows = objective.rows
        if np.isfinite(bound):
            rows = (_mass_rows(program, bound, len(objective.q)), *rows)
        solution = self._record(program.solve(objective.P, objective.q, rows, self.solver, balanced=self.is_determined))
        if solution.outcome is Outcome.INFEASIBLE:
            below = f" and a total mass below {bound:g} kg" if np.isfinite(bound) else ""
            raise SolverError(
                f"no parameters satisfy all of the {len(self.feasible.blocks)} conditions with margin {margin:g}"
                f"{below} ({solution.solver}: {solution.status}); loosen the constraints, which contradict each other."
            )
        solution.require("fit the data within the feasible set")
        price = program.price_of_margin(solution.dual) * max(1.0, self._prior_factor)
        return program.parameters(solution.primal), solution, price

    def _stopped(self, solution: ConicSolution, parameters: Vector, bound: float, squared: float) -> bool:
        """Whether the residual would fall further with more mass: the bound is reached and has a price."""
        row = sum(cone.rows for cone in _BASE_CONDITIONS[self.feasible].cones)
        mass = float(parameters[self.feasible.mass_indices].sum())
        return bool(mass > 0.99 * bound and solution.dual[row] > PRICE * squared / self.regression.scale)

    def same_base(
        self, preference: Preference | PreparedPrior, base: Vector, margin: float, inside: Vector | None = None
    ) -> Vector | None:
        """The preferred parameters that have this base vector (as far as the data tells it), or None.

        With the first part of the margin that gives some. Where parameters of that base vector are known that are
        feasible, what the solver finds outside is pulled towards them.
        """
        for part in LESSER_MARGINS if inside is None else LESSER_MARGINS[:1]:
            program = self._free_program(part * margin, base)
            objective = preference.part(program)
            solution = self._record(program.solve(objective.P, objective.q, objective.rows, self.solver))
            if solution.outcome.usable and np.all(np.isfinite(solution.primal)):
                found = program.parameters(solution.primal)
                if self.feasible.contains(found):
                    return found
                if inside is not None and self.feasible.contains(inside):
                    return pull_inside(self.feasible, found, inside)
        return None

    def near(self, preference: Preference | PreparedPrior, margin: float, limit: float, bound: float) -> Vector | None:
        """The preferred parameters with a squared residual of at most `limit`, or None."""
        program = self._base_program(margin)
        objective = preference.part(program)
        room = max(limit - self.regression.residual2, 0.0) + self.regression.tiny
        ball = self.regression.ball(program.columns, float(np.sqrt(room)))
        rows = [Rows(widened(ball.matrix, len(objective.q)), ball.right, ball.cone), *objective.rows]
        if np.isfinite(bound):
            rows.append(_mass_rows(program, 2 * bound, len(objective.q)))
        solution = self._record(program.solve(objective.P, objective.q, rows, self.solver, balanced=self.is_determined))
        if not (solution.outcome.usable and np.all(np.isfinite(solution.primal))):
            return None
        return program.parameters(solution.primal)


def _mass_rows(program: Program, bound: float, size: int) -> Rows:
    """The total mass is at most `bound`."""
    masses = program.feasible.mass_indices
    row = program.scaled_matrix[masses].sum(axis=0) / bound
    matrix = sparse.csc_array(np.concatenate([row, np.zeros(size - len(row))])[None])
    return Rows(matrix, np.array([1.0 - program.origin[masses].sum() / bound]), Cone("nonnegative", 1))
