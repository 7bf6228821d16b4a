"""How infeasible each base parameter is."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, Outcome, solve

from ..feasible_set import FeasibleSet
from .conflict import Conflict

__all__ = ["BaseParameterDegree", "change_alone", "rank_correlation"]

Vector = npt.NDArray[np.float64]

ABSENT = 1e-7
"""A base parameter with less weight than this in a conflict cannot end it."""


@dataclass(frozen=True, eq=False)
class BaseParameterDegree:
    """What one base parameter has to do with the infeasibility of an estimate.

    Attributes
    ----------
    name : str
        E.g. ``"Lzz1R"``: the parameter that leads the combination, with an R where it is regrouped with others.
    expression : str
        The combination of standard parameters, e.g. ``"Lzz1 + m2"``.
    value : float
    change : float
        From the estimate to the nearest feasible base parameters.
    share : float
        Of this parameter in the squared distance; shares add to 1, and single ones may be negative where the metric
        is not diagonal.
    alone : float
        Smallest change of this parameter alone that makes the estimate feasible, with its sign; infinite where none
        does.
    deviation : float
        Standard deviation; nan where it is not known, infinite where the data does not determine the parameter.
    """

    name: str
    expression: str
    value: float
    change: float
    share: float
    alone: float
    deviation: float

    @property
    def relative_deviation(self) -> float:
        """Standard deviation over the size of the parameter (thesis 4.29)."""
        return self.deviation / abs(self.value) if self.value else float("inf")

    @property
    def change_in_deviations(self) -> float:
        """The change over the standard deviation."""
        return self.change / self.deviation if self.deviation else float("nan")


def change_alone(
    feasible: FeasibleSet, base: Vector, index: int, conflicts: tuple[Conflict, ...], solver: str
) -> float:
    """The smallest change of one base parameter that makes all of them feasible; infinite where there is none.

    Parameters
    ----------
    feasible : FeasibleSet
    base : (n_b,)
    index : int
    conflicts : tuple of Conflict
        Of these base parameters; each must end.
    solver : str
    """
    if not conflicts:
        return 0.0
    weights = np.array([conflict.direction[index] for conflict in conflicts])
    if np.any(np.abs(weights) < ABSENT) or np.any(np.sign(weights) != np.sign(weights[0])):
        return float("inf")
    sign = float(np.sign(weights[0]))
    stack, unit = feasible.stack, sign * feasible.lift[:, index]
    needed = max((conflict.threshold - conflict.value) / abs(w) for conflict, w in zip(conflicts, weights, strict=True))
    # In units of what the conflicts tell to be necessary.
    directions = np.hstack([needed * unit[:, None], feasible.unidentifiable])
    reference, count = feasible.lift @ base, directions.shape[1]
    coefficients = stack.coefficients @ directions
    values = stack.constant + stack.coefficients @ reference
    equations = feasible.equation_matrix @ directions
    problem = ConicProblem(
        P=sparse.csc_array((count, count)),
        q=np.concatenate([[1.0], np.zeros(count - 1)]),
        A=sparse.csc_array(np.vstack([equations, -coefficients])),
        b=np.concatenate([feasible.equation_values - feasible.equation_matrix @ reference, values]),
        cones=(
            Cone("zero", len(equations)),
            Cone("nonnegative", stack.scalar_count),
            *(Cone("semidefinite", size) for size in stack.matrix_sizes),
        ),
    )
    solution = solve(problem, solver=solver)
    if (
        solution.outcome is Outcome.INFEASIBLE
        or not solution.outcome.usable
        or not np.all(np.isfinite(solution.primal))
    ):
        return float("inf")
    left = values + coefficients @ solution.primal
    if _smallest_eigenvalue(feasible, left) < -1e-4 * needed * float(
        np.abs(stack.coefficients @ unit).max(initial=0.0)
    ):
        return float("inf")
    return float(sign * needed * solution.primal[0])


def _smallest_eigenvalue(feasible: FeasibleSet, stacked: Vector) -> float:
    return min((float(np.linalg.eigvalsh(D)[0]) for D in feasible.stack.matrices(stacked)), default=0.0)


def rank_correlation(first: Vector, second: Vector) -> tuple[float, float]:
    """Spearman's rank correlation, and the probability of one as strong by chance; nan where it does not exist.

    Examples
    --------
    >>> round(rank_correlation(np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 10.0, 100.0, 50.0]))[0], 12)
    0.8
    """
    from scipy.special import betainc
    from scipy.stats import rankdata

    kept = ~(np.isnan(first) | np.isnan(second))
    one, other = rankdata(first[kept]), rankdata(second[kept])
    if len(one) < 3 or np.ptp(one) == 0 or np.ptp(other) == 0:
        return float("nan"), float("nan")
    value = float(np.corrcoef(one, other)[0, 1])
    freedom = len(one) - 2
    # Student's t with t² = ρ² f / (1 - ρ²).
    chance = float(betainc(freedom / 2.0, 0.5, max(0.0, 1.0 - value**2)))
    return value, chance
