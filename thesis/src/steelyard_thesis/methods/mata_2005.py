"""Mata, Benimeli, Farhat and Valera 2005: standard parameters under nonlinear conditions, by SQP, in two steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .link_conditions import Diagonals, Eigenvalues, LinkConditions
from .nonlinear_method import NonlinearMethod

__all__ = ["Mata2005"]


@dataclass(frozen=True)
class Mata2005(NonlinearMethod):
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
    >>> info = sy.Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, names)
    >>> estimate = Mata2005().fit(info, sy.FeasibleSet(model, "inertia", [sy.TotalMass(maximum=10.0)]))
    >>> bool(estimate.base[0] > 0), estimate.consistency
    (True, 'inertia')
    """

    name: ClassVar[str] = "Mata et al. 2005"
    source: ClassVar[str] = (
        "V. Mata, F. Benimeli, N. Farhat, A. Valera, Dynamic parameter identification in industrial robots considering "
        "physical feasibility, Advanced Robotics 19(1), 2005"
    )

    two_steps: bool = True

    def _conditions(self) -> list[LinkConditions]:
        last = Eigenvalues(self.triangle_inequality)
        return [Diagonals(self.triangle_inequality), last] if self.two_steps else [last]
