"""Rucker and Wensing 2022: least squares over log-Cholesky parameters of the pseudo-inertia."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from steelyard.feasibility import FeasibleSet

from .factored_fit import FactoredFit
from .factored_method import FactoredMethod, Vector
from .method import Problem, Progress
from .parametrisations import LogCholesky

__all__ = ["Rucker2022"]


@dataclass(frozen=True)
class Rucker2022(FactoredMethod):
    """Nonlinear least squares over the logarithmic Cholesky factors of pseudo-inertias: the modern heir of `Ting2006`.

    Every θ gives a positive definite pseudo-inertia ("full" consistency) and every one has exactly one θ, so that
    nothing is lost and any optimiser without constraints will do. Terms that must not be negative are exponentials.

    Known flaws: where the best answer lies on the boundary of what is possible, as it usually does with noise, some θ
    run off to minus infinity, so that the optimum is approached and never reached; there is no proof of optimality;
    where masses can grow without end the descent follows them until it is stopped. An answer that rounding leaves on
    the boundary is moved inside by as little as proves it feasible.

    Attributes
    ----------
    solver : {"newton", "gauss-newton", "levenberg-marquardt"}
        The paper leaves it open. ``"newton"`` has exact second derivatives and the damping of Levenberg and Marquardt;
        it needs the fewest and cheapest steps. The others are SciPy's least squares.
    iterations : int
        Limit.
    tolerance : float
        On the gradient, in units of the squared residual of least squares.

    References
    ----------
    C. Rucker, P. M. Wensing, "Smooth parameterization of rigid-body inertia", IEEE Robotics and Automation Letters
    7(2), 2022.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> names = model.base_parameters().names
    >>> info = sy.Information.from_factor(10 * np.eye(3), [6.0, 5.0, 1.0], 0.02, 100, names)
    >>> estimate = Rucker2022().fit(info, sy.FeasibleSet(model, "inertia"))
    >>> estimate.base.round(4).tolist(), estimate.consistency
    ([0.6, 0.5, 0.1], 'inertia')
    """

    name: ClassVar[str] = "log-Cholesky (Rucker and Wensing 2022)"
    source: ClassVar[str] = (
        "C. Rucker, P. M. Wensing, Smooth parameterization of rigid-body inertia, IEEE Robotics and Automation Letters "
        "7(2), 2022"
    )

    def _descent(self, problem: Problem, progress: Progress | None) -> FactoredFit:
        return FactoredFit(problem, LogCholesky(), problem.rho, exponential=True)

    def _answer(self, feasible_set: FeasibleSet, parameters: Vector, start: Vector) -> Vector:
        if not feasible_set.contains(parameters) and feasible_set.contains(start):
            return feasible_set.pull_inside(parameters, start)
        return parameters
