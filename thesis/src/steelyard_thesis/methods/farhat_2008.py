"""Farhat, Mata, Page and Valero 2008: standard parameters under Sylvester's criterion, by nonlinear optimisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .link_conditions import LinkConditions, SylvesterMinors
from .nonlinear_method import NonlinearMethod

__all__ = ["Farhat2008"]


@dataclass(frozen=True)
class Farhat2008(NonlinearMethod):
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
    >>> info = sy.Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, names)
    >>> estimate = Farhat2008().fit(info, sy.FeasibleSet(model, "inertia", [sy.TotalMass(maximum=10.0)]))
    >>> bool(estimate.base[0] > 0), estimate.consistency
    (True, 'inertia')
    """

    name: ClassVar[str] = "Farhat et al. 2008"
    source: ClassVar[str] = (
        "N. Farhat, V. Mata, A. Page, F. Valero, Identification of dynamic parameters of a 3-DOF RPS parallel "
        "manipulator, Mechanism and Machine Theory 43(1), 2008"
    )

    def _conditions(self) -> list[LinkConditions]:
        return [SylvesterMinors(self.triangle_inequality)]
