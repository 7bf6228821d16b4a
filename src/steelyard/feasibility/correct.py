"""The nearest physically possible parameters."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, ConicSolution, Outcome, find_solver, solve
from steelyard.errors import InputError, SolverError

from .certificates import FeasibilityCertificate
from .feasible_set import FeasibleSet
from .interior import MARGIN_FACTORS, pull_inside
from .metric import Metric

__all__ = ["Correction", "correct"]

Vector = npt.NDArray[np.float64]

UNIDENTIFIABLE_WEIGHT, LEAST_WEIGHT = 1e-9, 1e-6
"""Weight of squares of what has no distance, against the squared distance: keeps masses finite where the infimum is at
infinity. Multiplied by the squared distance where that is below 1, down to the second."""

FINE = 1e-3
"""Below this squared distance, in units of the parameters given, the problem is solved again in units of it."""

FINEST = 1e-6
"""Those units are no smaller than this part of the ones before: one step goes no further than can be trusted."""

REFINEMENTS = 3
"""How often at most. In the Euclidean metric once is enough: less than that of the largest parameter is rounding."""


_METRICS = {
    "given": "the given metric",
    "covariance": "the metric of the covariance",
    "data": "the data's own metric",
}


@dataclass(frozen=True, eq=False)
class Correction:
    """Answer of `correct`.

    Attributes
    ----------
    base : (n_b,)
        Feasible base parameters K δ.
    parameters : (n,)
        Feasible standard parameters δ.
    squared_distance : float
        dᵀ M d with d = β - K δ, or d = δ̂ - δ where standard parameters were given; M is the metric, 1 where none was
        given.
    status : str
        ``"already feasible"`` where nothing had to change, or ``"corrected"``.
    certificate : FeasibilityCertificate
    iterations : int
        Of the solver.
    squared_euclidean_distance : float
        dᵀ d.
    metric : str
        ``"Euclidean"``, ``"given"``, ``"covariance"`` or ``"data"``.
    solver : str
    outcome : Outcome
        How the solver ended.
    """

    base: Vector = field(repr=False)
    parameters: Vector = field(repr=False)
    squared_distance: float
    status: str
    certificate: FeasibilityCertificate = field(repr=False)
    iterations: int
    squared_euclidean_distance: float
    metric: str = "Euclidean"
    solver: str = "Clarabel"
    outcome: Outcome = Outcome.SOLVED

    def __str__(self) -> str:
        kind = self.certificate.feasible_set.consistency
        if self.status == "already feasible":
            return f'Already feasible under "{kind}" consistency; what was given stays as it is.'
        text = f'Corrected to be feasible under "{kind}" consistency; squared distance {self.squared_distance:.6g}'
        if self.metric != "Euclidean":
            text += f" in {_METRICS[self.metric]} (Euclidean: {self.squared_euclidean_distance:.6g})"
        return f"{text}."


def correct(
    feasible: FeasibleSet,
    base: npt.ArrayLike | None = None,
    parameters: npt.ArrayLike | None = None,
    metric: Any = None,
    solver: str = "clarabel",
    covariance: npt.ArrayLike | None = None,
) -> Correction:
    """The feasible parameters closest to given ones (thesis 3.40, 3.56), at least `feasible.margin` within the set.

    Parameters
    ----------
    feasible : FeasibleSet
    base : (n_b,), optional
        Base parameters β; d = β - K δ.
    parameters : (n,), optional
        Standard parameters δ̂, instead; d = δ̂ - δ.
    metric : (k, k) or Information, optional
        What is meant by closest, where it is not the length of d: a positive semidefinite matrix M for dᵀ M d (k = n_b,
        or n for standard parameters), or data, in whose metric the distance is by how much the squared residual of the
        (by joint weighted) regression rises above that of least squares, if β is that of least squares. Directions
        without weight are settled by the least Euclidean change.
    solver : str
        One of `solver_table`.
    covariance : (k, k), optional
        Of what was given, e.g. of an estimate; M is its inverse (Mahalanobis distance).

    Returns
    -------
    Correction
        Every block at its parameters is proved positive definite.

    Raises
    ------
    InputError
        If not exactly one of `base` and `parameters` is given, they do not fit the model, or the metric is not a
        positive semidefinite matrix of the right size.
    SolverError
        If the set is empty or the solver finds no point of it.

    Examples
    --------
    >>> from steelyard.dynamics import Model
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> correction = correct(FeasibleSet(model), base=[-0.6, 0.0, 0.0])
    >>> print(correction)
    Corrected to be feasible under "full" consistency; squared distance 0.36...

    With an estimate whose first parameter is known ten times as well as the others:

    >>> print(correct(FeasibleSet(model), base=[-0.6, 0.0, 0.0], covariance=np.diag([0.01, 1.0, 1.0])))
    Corrected to be feasible under "full" consistency; squared distance 36.0... in the metric of the covariance
    (Euclidean: 0.36...).
    """
    if (base is None) == (parameters is None):
        raise InputError("correct takes either base= or parameters=; give exactly one of them.")
    title = find_solver(solver).title
    nearest = _Nearest.of(feasible, base, parameters, metric, covariance, solver)
    outside: Vector | None = None
    early: Correction | None = None
    for factor in MARGIN_FACTORS:
        found, outcome, iterations, status = nearest.search(factor * feasible.margin)
        if outcome is Outcome.INFEASIBLE and feasible.constraints:
            if factor > MARGIN_FACTORS[0]:  # there is room, but not for more margin
                break
            raise SolverError(
                f"no parameters satisfy all of the {len(feasible.blocks)} conditions with margin {feasible.margin:g} "
                f"({title}: {status}); loosen the constraints, which contradict each other."
            )
        if found is None:
            continue
        if nearest.squared(found) < FINE and nearest.keeps_margin(nearest.unchanged(found)):
            return nearest.correction(nearest.unchanged(found), "already feasible", outcome, iterations, title)
        if not feasible.contains(found):
            outside = found if outside is None else outside
            continue
        if outside is not None:
            found = pull_inside(feasible, outside, found)
        correction = nearest.correction(found, "corrected", outcome, iterations, title)
        if outcome is not Outcome.STOPPED:
            return correction
        early = correction if early is None else early
    if early is not None:
        return early
    raise SolverError(
        f"{title} ended outside the feasible set with every margin tried; check that the constraints leave room and "
        f"that units are SI, or give FeasibleSet a larger margin than {feasible.margin:g}."
    )


@dataclass(frozen=True, eq=False)
class _Nearest:
    """Minimise ‖R d‖², where d are the first `measured` of the unknowns and δ = origin + matrix x is in the set.

    All unknowns are in units of the largest parameter given, and the squared distance in units of that of a step of
    this size.
    """

    feasible: FeasibleSet
    given: Vector
    standard: bool
    metric: Metric
    solver: str
    origin: Vector
    coefficients: sparse.csc_array
    matrix: npt.NDArray[np.float64]
    unit: float

    @classmethod
    def of(
        cls, feasible: FeasibleSet, base: Any, parameters: Any, metric: Any, covariance: Any, solver: str
    ) -> "_Nearest":
        """From the arguments of `correct`."""
        standard = parameters is not None
        if standard:
            given = feasible.as_parameters(parameters)
            origin, matrix = given, np.eye(feasible.parameter_count)
            coefficients = feasible.stack.coefficients
        else:
            given = feasible.as_base(base)
            origin, matrix = feasible.lift @ given, feasible.base_dependent
            coefficients = feasible.stacked_base_dependent
        chosen = Metric.of(metric, covariance, feasible, standard)
        unit = float(np.abs(given).max(initial=0.0))
        return cls(feasible, given, standard, chosen, solver, origin, coefficients, matrix, unit if unit > 0 else 1.0)

    def difference(self, parameters: Vector) -> Vector:
        """d."""
        return (parameters if self.standard else self.feasible.K @ parameters) - self.given

    def squared(self, parameters: Vector) -> float:
        """Squared distance in the units of the problem."""
        return self.metric.squared(self.difference(parameters)) / (self.unit * self.metric.size) ** 2

    def unchanged(self, parameters: Vector) -> Vector:
        """The same unidentifiable parameters with exactly what was given."""
        if self.standard:
            return self.origin
        return parameters - self.feasible.lift @ self.difference(parameters)

    def parameters(self, solution: ConicSolution) -> Vector:
        """δ of a solution."""
        step = self.unit * solution.primal[: self.matrix.shape[1]]
        return self.feasible.project_on_equations(self.origin + self.matrix @ step)

    def search(self, margin: float) -> tuple[Vector | None, Outcome, int, str]:
        """The best δ found with this margin, if any, the outcome, the iterations and the solver's word."""
        solution = self.solve(margin, 1.0, 1.0)
        if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
            return None, solution.outcome, solution.iterations, solution.status
        found, outcome, iterations = self.parameters(solution), solution.outcome, solution.iterations
        scale = 1.0
        for _ in range(1 if self.metric.factor is None else REFINEMENTS):
            distance = self.squared(found)
            if distance >= FINE * scale:
                break
            scale = max(distance, FINEST * scale)
            solution = self.solve(margin, scale, min(1.0, max(distance * self.unit**2, LEAST_WEIGHT)))
            iterations += solution.iterations
            if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
                break
            finer = self.parameters(solution)
            inside, before = self.feasible.contains(finer), self.feasible.contains(found)
            if inside and (self.squared(finer) < distance or not before):
                found, outcome = finer, solution.outcome
        return found, outcome, iterations, solution.status

    def solve(self, margin: float, scale: float, weight: float) -> ConicSolution:
        """Solve with this margin; the squared distance is divided by `scale`, the other squares have this weight."""
        feasible, stack = self.feasible, self.feasible.stack
        count, measured = self.matrix.shape[1], len(self.given)
        hidden = UNIDENTIFIABLE_WEIGHT * weight / scale
        weights = np.full(count, hidden)
        weights[:measured] = 0.0
        equations = feasible.equation_matrix @ self.matrix
        values = stack.constant + stack.coefficients @ self.origin - margin * stack.identity
        rows = [sparse.csc_array(equations), -self.coefficients]
        right = [(feasible.equation_values - feasible.equation_matrix @ self.origin) / self.unit, values / self.unit]
        cones = [
            Cone("zero", len(equations)),
            Cone("nonnegative", stack.scalar_count),
            *(Cone("semidefinite", size) for size in stack.matrix_sizes),
        ]
        if self.metric.is_diagonal:
            squares = self._diagonal()
            weights[:measured] = np.where(squares > 0, 2.0 * squares / scale, hidden)
        else:
            seen, unseen = self._seen()
            extra = seen.shape[0] + unseen.shape[0]
            both = sparse.csc_array(sparse.vstack([seen, unseen]))
            image = sparse.csc_array(sparse.hstack([both, sparse.csc_array((extra, count - measured))]))
            rows = [sparse.csc_array(sparse.hstack([part, sparse.csc_array((part.shape[0], extra))])) for part in rows]
            rows.insert(0, sparse.csc_array(sparse.hstack([image, sparse.csc_array(-np.eye(extra))])))
            right.insert(0, np.zeros(extra))
            cones.insert(0, Cone("zero", extra))
            tail = np.full(extra, hidden)
            tail[: seen.shape[0]] = 2.0 / scale
            weights = np.concatenate([weights, tail])
        problem = ConicProblem(
            P=sparse.csc_array(sparse.diags_array(weights, format="csc")),
            q=np.zeros(len(weights)),
            A=sparse.csc_array(sparse.vstack(rows, format="csc")),
            b=np.concatenate(right),
            cones=tuple(cones),
        )
        return solve(problem, solver=self.solver)

    def _diagonal(self) -> Vector:
        """Weights of the squares of d, where each counts by itself."""
        if self.metric.factor is None:
            return np.ones(len(self.given))
        return np.asarray(np.sum((self.metric.factor / self.metric.size) ** 2, axis=0), dtype=float)

    def _seen(self) -> tuple[sparse.csc_array, sparse.csc_array]:
        """R in units of its size, and directions in which it sees nothing."""
        assert self.metric.factor is not None
        return sparse.csc_array(self.metric.factor / self.metric.size), sparse.csc_array(self.metric.unseen)

    def keeps_margin(self, parameters: Vector) -> bool:
        """Whether δ is in the set with at least half the margin, so that nothing need be changed."""
        eigenvalues = self.feasible.stack.smallest_eigenvalues(parameters)
        return bool(np.all(eigenvalues >= 0.5 * self.feasible.margin)) and self.feasible.contains(parameters)

    def correction(self, parameters: Vector, status: str, outcome: Outcome, iterations: int, solver: str) -> Correction:
        """Pack the answer."""
        difference = self.difference(parameters)
        certificate = FeasibilityCertificate.of_parameters(self.feasible, parameters)
        return Correction(
            base=certificate.base,
            parameters=parameters,
            squared_distance=self.metric.squared(difference),
            status=status,
            certificate=certificate,
            iterations=iterations,
            squared_euclidean_distance=float(difference @ difference),
            metric=self.metric.name,
            solver=solver,
            outcome=outcome,
        )
