"""The map of Nakanishi 2008 and Ting 2006 without its flaws: a margin, and the consistency that is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from steelyard.dynamics.threads import one_thread
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Estimate, Information

from .factored_fit import FACTORED_SOLVERS, FactoredFit, FactoredSolver
from .method import Problem, Progress, Weights, require_choice, require_positive
from .parametrisations import CholeskyOfBody
from .starting_point import starting_point

__all__ = ["NakanishiCorrected"]


@dataclass(frozen=True)
class NakanishiCorrected:
    """Nonlinear least squares over Cholesky factors, corrected: not a published method.

    As `Nakanishi2008`, but with the margin of the feasible set added to all matrices, so that every θ is strictly
    feasible and the answer is proved so, and, for sets of "full" consistency, with the Cholesky factor of the second
    moments about the centre of mass instead of the inertia, so that the triangle inequality holds. Its minimum is that
    of `steelyard.fit`.

    Known flaws: stationary points that are not the best remain (θ = 0 is one), as does the missing proof of optimality;
    where masses can grow without end the descent follows them until it is stopped.

    Attributes
    ----------
    solver : {"newton", "gauss-newton", "levenberg-marquardt"}
        The papers name none. ``"newton"`` has exact second derivatives and the damping of Levenberg and Marquardt; it
        needs the fewest and cheapest steps. The others are SciPy's least squares.
    iterations : int
        Limit.
    tolerance : float
        On the gradient, in units of the squared residual of least squares.

    References
    ----------
    J. Nakanishi, R. Cory, M. Mistry, J. Peters, S. Schaal, "Operational space control: a theoretical and empirical
    comparison", International Journal of Robotics Research 27(6), 2008.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> names = model.base_parameters().names
    >>> info = Information.from_factor(10 * np.eye(3), [6.0, 5.0, 1.0], 0.02, 100, names)
    >>> estimate = NakanishiCorrected().fit(info, FeasibleSet(model, "inertia"))
    >>> estimate.base.round(4).tolist(), estimate.consistency
    ([0.6, 0.5, 0.1], 'inertia')
    """

    name: ClassVar[str] = "Nakanishi et al. 2008, corrected"
    source: ClassVar[str] = (
        "after J. Nakanishi, R. Cory, M. Mistry, J. Peters, S. Schaal, Operational space control: a theoretical and "
        "empirical comparison, International Journal of Robotics Research 27(6), 2008"
    )

    solver: FactoredSolver = "newton"
    iterations: int = 1000
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        require_choice(self, "solver", FACTORED_SOLVERS)
        require_positive(self, "iterations", "tolerance")

    def fit(
        self,
        information: Information,
        feasible: FeasibleSet,
        *,
        weights: Weights = None,
        prior: npt.ArrayLike | None = None,
        progress: Progress | None = None,
    ) -> Estimate:
        """Identify; see `Method.fit`. The prior is where the descent starts."""
        problem = Problem.of(information, feasible, weights)
        problem.refuse_constraints(self.name)
        with one_thread():
            start = starting_point(problem, problem.as_prior(prior))
            full = feasible.consistency == "full"
            shift = problem.margin_shift(full)
            shift[problem.others] = feasible.margin * np.isfinite(problem.lower_bounds[problem.others])
            descent = FactoredFit(problem, CholeskyOfBody(second_moments=full), problem.rho, shift=shift)
            outcome = descent.solve(start, self.solver, self.iterations, self.tolerance, progress)
        return problem.estimate(self.name, outcome.parameters, remarks=[outcome.sentence()])
