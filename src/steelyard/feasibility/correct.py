"""The nearest physically possible parameters."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.conic import Outcome, find_solver
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError

from .certificates import FeasibilityCertificate
from .feasible_set import MARGIN_FACTORS, FeasibleSet
from .nearest_point import FINE, Metric, NearestPoint

__all__ = ["Correction", "correct"]

Vector = npt.NDArray[np.float64]

_METRICS = {
    "given": "the given metric",
    "covariance": "the metric of the covariance",
    "data": "the data's own metric",
}

RELATIVE_MARGINS = (1e-9, 1e-8, 1e-7, 1e-6)
"""Margins relative to the largest parameter, that are tried where none of `MARGIN_FACTORS` was enough: a solver is
accurate to 1e-8 of the largest number, and base parameters of millions ask for masses a thousand times larger, where
this is more than 1 SI unit. Two of 640 hard inputs of a seven-joint arm had no answer without these."""


@dataclass(frozen=True, eq=False)
class Correction:
    """The answer of `correct`.

    Attributes
    ----------
    base : (n_b,)
        Feasible base parameters K δ.
    parameters : (n,)
        Feasible standard parameters δ.
    squared_distance : float
        dᵀ M d with d = β - K δ, or d = δ̂ - δ if standard parameters were given; M is the metric, by default the unit
        matrix.
    status : str
        ``"already feasible"`` if nothing had to change, or ``"corrected"``.
    certificate : FeasibilityCertificate
    iterations : int
        Iterations of the solver.
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


@in_one_thread
def correct(
    feasible_set: FeasibleSet,
    base: npt.ArrayLike | None = None,
    parameters: npt.ArrayLike | None = None,
    metric: Any = None,
    covariance: npt.ArrayLike | None = None,
    solver: str = "clarabel",
) -> Correction:
    """The feasible parameters closest to given ones (thesis 3.40, 3.56), at least `feasible_set.margin` within the set.

    Parameters
    ----------
    feasible_set : FeasibleSet
    base : (n_b,), optional
        Base parameters β; d = β - K δ.
    parameters : (n,), optional
        Standard parameters δ̂, instead; d = δ̂ - δ.
    metric : (k, k) or Information, optional
        Metric of the distance; by default it is Euclidean. Either a positive semidefinite matrix M for dᵀ M d (k = n_b,
        or n for standard parameters), or data: then dᵀ M d is the rise of the squared residual of the joint-weighted
        regression above that of least squares, if β is the least-squares solution. Directions without weight are
        decided by the least Euclidean change.
    covariance : (k, k), optional
        Covariance of the given parameters, such as that of an estimate; M is its inverse (Mahalanobis distance).
    solver : str
        One of `solver_table`.

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
    given = _Given.of(feasible_set, base, parameters, metric, covariance, solver)
    outside: Vector | None = None
    early: Correction | None = None

    def margins() -> Iterator[float]:
        yield from (factor * feasible_set.margin for factor in MARGIN_FACTORS)
        if outside is not None and early is None:
            size = float(np.abs(outside).max())
            yield from (
                part * size for part in RELATIVE_MARGINS if part * size > MARGIN_FACTORS[-1] * feasible_set.margin
            )

    for margin in margins():
        found, solution, _, iterations = given.problem.search(margin, given.difference, feasible_set.contains)
        outcome = solution.outcome
        if outcome is Outcome.INFEASIBLE and feasible_set.constraints:
            if margin > feasible_set.margin:  # there is room, but not for more margin
                break
            raise SolverError(
                f"no parameters satisfy all of the {len(feasible_set.blocks)} conditions with margin "
                f"{feasible_set.margin:g} ({title}: {solution.status}); loosen the constraints, which contradict each "
                "other."
            )
        if found is None:
            continue
        unchanged = given.unchanged(found)
        if given.problem.squared(given.difference(found)) < FINE and _keeps_margin(feasible_set, unchanged):
            return given.correction(unchanged, "already feasible", outcome, iterations, title)
        if not feasible_set.contains(found):
            outside = found if outside is None else outside
            continue
        if outside is not None:
            found = feasible_set.pull_inside(outside, found)
        correction = given.correction(found, "corrected", outcome, iterations, title)
        if outcome is not Outcome.STOPPED:
            return correction
        early = correction if early is None else early
    if early is not None:
        return early
    raise SolverError(
        f"{title} ended outside the feasible set with every margin tried; check that the constraints leave room and "
        f"that units are SI, or give FeasibleSet a larger margin than {feasible_set.margin:g}."
    )


def _keeps_margin(feasible_set: FeasibleSet, parameters: Vector) -> bool:
    """Return whether δ is in the set with at least half the margin, so that it need not be changed."""
    eigenvalues = feasible_set.stack.smallest_eigenvalues(parameters)
    return bool(np.all(eigenvalues >= 0.5 * feasible_set.margin)) and feasible_set.contains(parameters)


@dataclass(frozen=True, eq=False)
class _Given:
    """The arguments of `correct`, and the search for the nearest feasible parameters."""

    problem: NearestPoint
    values: Vector
    standard: bool

    @classmethod
    def of(
        cls, feasible_set: FeasibleSet, base: Any, parameters: Any, metric: Any, covariance: Any, solver: str
    ) -> "_Given":
        """From the arguments of `correct`."""
        standard = parameters is not None
        if standard:
            given = feasible_set.as_parameters(parameters)
            origin, matrix = given, np.eye(feasible_set.parameter_count)
        else:
            given = feasible_set.as_base(base)
            origin, matrix = feasible_set.lift @ given, feasible_set.base_dependent
        unit = float(np.abs(given).max(initial=0.0)) or 1.0
        chosen = Metric.of(metric, covariance, feasible_set, standard)
        return cls(NearestPoint(feasible_set, origin, matrix, len(given), chosen, unit, solver), given, standard)

    def difference(self, parameters: Vector) -> Vector:
        """d."""
        return (parameters if self.standard else self.problem.feasible_set.K @ parameters) - self.values

    def unchanged(self, parameters: Vector) -> Vector:
        """The parameters that were given, with the unidentifiable parts of δ if base parameters were given."""
        if self.standard:
            return self.values
        return parameters - self.problem.feasible_set.lift @ self.difference(parameters)

    def correction(self, parameters: Vector, status: str, outcome: Outcome, iterations: int, solver: str) -> Correction:
        """Pack the answer."""
        difference, metric = self.difference(parameters), self.problem.metric
        certificate = FeasibilityCertificate.of_parameters(self.problem.feasible_set, parameters)
        return Correction(
            base=certificate.base,
            parameters=parameters,
            squared_distance=metric.squared(difference),
            status=status,
            certificate=certificate,
            iterations=iterations,
            squared_euclidean_distance=float(difference @ difference),
            metric=metric.name,
            solver=solver,
            outcome=outcome,
        )
