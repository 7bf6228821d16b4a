"""Farhat, Mata, Page and Valero 2008: standard parameters under Sylvester's criterion, by nonlinear optimisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy.typing as npt

from steelyard.dynamics.threads import one_thread
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Estimate, Information

from .link_conditions import SylvesterMinors
from .method import Problem, Progress, Weights, require_choice, require_positive
from .nonlinear_program import NonlinearProgram
from .nonlinear_solvers import SOLVERS, SolverName, solve_program
from .starting_point import starting_point

__all__ = ["Farhat2008"]


@dataclass(frozen=True)
class Farhat2008:
    """Regression over standard parameters under Sylvester's criterion.

    The leading principal minors of each link's inertia about the centre of mass, times m² (thesis 3.1 to 3.5), and its
    mass must be positive; the objective is that of `Mata2005` (thesis 2.69).

    Known flaws: minors say nothing of how far a matrix is from being possible (they are of third degree in it), have no
    slope where two eigenvalues vanish, and do not make a convex problem, so that neither convergence nor the best
    answer is guaranteed; the work of an iteration grows with the cube of the number of links; inertias that violate the
    triangle inequality are let through. The paper does not detail its optimisation.

    Attributes
    ----------
    solver : {"slsqp", "trust-constr", "ipopt"}
        ``"slsqp"`` is an SQP method; the others are interior-point methods with second derivatives. Where the data is
        ill-conditioned ``"ipopt"`` comes much closer to the optimum.
    iterations : int
        Limit; thesis 6.3.2 uses 300 and others. More helps where the data is ill-conditioned.
    tolerance : float
        Of the solver.
    residual_weight, prior_weight : float
        λ_ω and λ_β. β̂ is K times the prior, or plain least squares where there is no prior.
    triangle_inequality : bool
        Ask the same of the second moments about the centre of mass, so that the answer is feasible in the sense of
        "full"; not in the paper.

    References
    ----------
    N. Farhat, V. Mata, A. Page, F. Valero, "Identification of dynamic parameters of a 3-DOF RPS parallel manipulator",
    Mechanism and Machine Theory 43(1), 2008.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> names = model.base_parameters().names
    >>> info = Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, names)
    >>> estimate = Farhat2008().fit(info, FeasibleSet(model, "inertia", [sy.TotalMass(maximum=10.0)]))
    >>> bool(estimate.base[0] > 0), estimate.consistency
    (True, 'inertia')
    """

    name: ClassVar[str] = "Farhat et al. 2008"
    source: ClassVar[str] = (
        "N. Farhat, V. Mata, A. Page, F. Valero, Identification of dynamic parameters of a 3-DOF RPS parallel "
        "manipulator, Mechanism and Machine Theory 43(1), 2008"
    )

    solver: SolverName = "slsqp"
    iterations: int = 1000
    tolerance: float = 1e-9
    residual_weight: float = 1.0
    prior_weight: float = 0.0
    triangle_inequality: bool = False

    def __post_init__(self) -> None:
        require_choice(self, "solver", SOLVERS)
        require_positive(self, "iterations", "tolerance", "residual_weight", zero=["prior_weight"])

    @property
    def _title(self) -> str:
        return f"{self.name}, with the triangle inequality" if self.triangle_inequality else self.name

    def fit(
        self,
        information: Information,
        feasible: FeasibleSet,
        *,
        weights: Weights = "joint",
        prior: npt.ArrayLike | None = None,
        progress: Progress | None = None,
    ) -> Estimate:
        """Identify; see `Method.fit`. Linear constraints of the set are honoured."""
        problem = Problem.of(information, feasible, weights)
        known = problem.as_prior(prior)
        base = problem.least_squares if known is None else problem.base_of(known)
        program = NonlinearProgram(
            problem,
            SylvesterMinors(self.triangle_inequality),
            residual_weight=self.residual_weight,
            prior_weight=self.prior_weight,
            prior_base=base,
            triangle=self.triangle_inequality,
        )
        with one_thread():
            start = starting_point(problem, known)
            outcome = solve_program(program, start, self.solver, self.iterations, self.tolerance, progress)
        return problem.estimate(self._title, outcome.parameters, remarks=[outcome.sentence()])
