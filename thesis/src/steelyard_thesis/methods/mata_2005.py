"""Mata, Benimeli, Farhat and Valera 2005: standard parameters under nonlinear conditions, by SQP, in two steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy.typing as npt

from steelyard.dynamics.threads import one_thread
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Estimate, Information

from .link_conditions import Diagonals, Eigenvalues, LinkConditions
from .method import Problem, Progress, Weights, require_choice, require_positive
from .nonlinear_program import NonlinearProgram
from .nonlinear_solvers import SOLVERS, SolverName, solve_program
from .starting_point import starting_point

__all__ = ["Mata2005"]


@dataclass(frozen=True)
class Mata2005:
    """Regression over standard parameters; the inertias about the centre of mass have positive eigenvalues.

    The first step asks masses and diagonals of these inertias to be positive, the second, which starts from there,
    masses and eigenvalues. The objective is λ_ω ‖ω - W K δ‖² + λ_β ‖β̂ - K δ‖² (thesis 2.69).

    Known flaws: eigenvalues have no derivative where two of them meet, and the conditions are not convex as they are
    written, so that neither convergence nor the best answer is guaranteed; the work of an iteration grows with the
    cube of the number of links; inertias that violate the triangle inequality are let through.

    Attributes
    ----------
    solver : {"slsqp", "trust-constr", "ipopt"}
        ``"slsqp"`` is an SQP method, as in the paper; the others are interior-point methods with second derivatives.
    iterations : int
        Limit for each step; thesis 6.3.2 uses 300 and others. More helps where the data is ill-conditioned.
    tolerance : float
        Of the solver.
    residual_weight, prior_weight : float
        λ_ω and λ_β; neither the paper nor the thesis tells their values. β̂ is K times the prior, or plain least squares
        where there is no prior.
    two_steps : bool
        Whether the first step is taken.
    triangle_inequality : bool
        Ask the same of the second moments about the centre of mass, so that the answer is feasible in the sense of
        "full"; not in the paper.

    References
    ----------
    V. Mata, F. Benimeli, N. Farhat, A. Valera, "Dynamic parameter identification in industrial robots considering
    physical feasibility", Advanced Robotics 19(1), 2005.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> names = model.base_parameters().names
    >>> info = Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, names)
    >>> estimate = Mata2005().fit(info, FeasibleSet(model, "inertia", [sy.TotalMass(maximum=10.0)]))
    >>> bool(estimate.base[0] > 0), estimate.consistency
    (True, 'inertia')
    """

    name: ClassVar[str] = "Mata et al. 2005"
    source: ClassVar[str] = (
        "V. Mata, F. Benimeli, N. Farhat, A. Valera, Dynamic parameter identification in industrial robots considering "
        "physical feasibility, Advanced Robotics 19(1), 2005"
    )

    solver: SolverName = "slsqp"
    iterations: int = 1000
    tolerance: float = 1e-9
    residual_weight: float = 1.0
    prior_weight: float = 0.0
    two_steps: bool = True
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
        shared: dict[str, Any] = {
            "residual_weight": self.residual_weight,
            "prior_weight": self.prior_weight,
            "prior_base": base,
            "triangle": self.triangle_inequality,
        }
        remarks = []
        with one_thread():
            point = inside = starting_point(problem, known)
            steps: list[tuple[str, LinkConditions]] = [("Step 2", Eigenvalues(self.triangle_inequality))]
            if self.two_steps:
                steps.insert(0, ("Step 1", Diagonals(self.triangle_inequality)))
            for step, condition in steps:
                program = NonlinearProgram(problem, condition, **shared)
                last = isinstance(condition, Eigenvalues)
                outcome = solve_program(
                    program, point, self.solver, self.iterations, self.tolerance, progress, inside, repair=last
                )
                point = outcome.parameters
                remarks.append(outcome.sentence(step if self.two_steps else ""))
        return problem.estimate(self._title, point, remarks=remarks)
