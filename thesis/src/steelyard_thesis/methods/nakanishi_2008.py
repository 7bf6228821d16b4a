"""Nakanishi, Cory, Mistry, Peters and Schaal 2008: least squares over Cholesky factors, as published and corrected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .factored_fit import FactoredFit
from .factored_method import FactoredMethod
from .method import Problem, Progress
from .parametrisations import CholeskyOfBody

__all__ = ["Nakanishi2008", "NakanishiCorrected"]


@dataclass(frozen=True)
class Nakanishi2008(FactoredMethod):
    """Nonlinear least squares over √m, the centre of mass and a Cholesky factor of the inertia about it, as published.

    The map is that of `Ting2006` (thesis 2.70, 2.71); what is approached are the predictions of plain least squares
    (thesis 2.72), so that the objective is the squared residual. Terms that must not be negative are squares.

    Known flaws: the map reaches the boundary (θ1 = 0: no mass; a zero on the diagonal of the factor: an inertia of
    lower rank), and the best θ usually lies there, so that the answer is feasible in the limit only and not proved so;
    it reaches every inertia that is positive definite about the centre of mass, and thus also those that violate the
    triangle inequality; θ = 0 and many other points are stationary without being the best; θ and other signs of it
    mean the same. `NakanishiCorrected` mends the first two.

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
    >>> info = sy.Information.from_factor(10 * np.eye(3), [6.0, 5.0, 1.0], 0.02, 100, names)
    >>> estimate = Nakanishi2008().fit(info, sy.FeasibleSet(model, "inertia"))
    >>> estimate.base.round(4).tolist(), estimate.consistency
    ([0.6, 0.5, 0.1], 'inertia')
    """

    name: ClassVar[str] = "Nakanishi et al. 2008"
    source: ClassVar[str] = (
        "J. Nakanishi, R. Cory, M. Mistry, J. Peters, S. Schaal, Operational space control: a theoretical and "
        "empirical comparison, International Journal of Robotics Research 27(6), 2008"
    )

    def _descent(self, problem: Problem, progress: Progress | None) -> FactoredFit:
        return FactoredFit(problem, CholeskyOfBody(), problem.rho)


@dataclass(frozen=True)
class NakanishiCorrected(FactoredMethod):
    """Nonlinear least squares over Cholesky factors, corrected: not a published method.

    As `Nakanishi2008`, but with the margin of the feasible set added to all matrices, so that every θ is strictly
    feasible and the answer is proved so, and, for sets of "full" consistency, with the Cholesky factor of the second
    moments about the centre of mass instead of the inertia, so that the triangle inequality holds. Its minimum is that
    of `steelyard.fit`.

    Known flaws: stationary points that are not the best remain (θ = 0 is one), as does the missing proof of optimality;
    where masses can grow without end the descent follows them until it is stopped.

    Attributes and references are those of `Nakanishi2008`.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> names = model.base_parameters().names
    >>> info = sy.Information.from_factor(10 * np.eye(3), [6.0, 5.0, 1.0], 0.02, 100, names)
    >>> estimate = NakanishiCorrected().fit(info, sy.FeasibleSet(model, "inertia"))
    >>> estimate.base.round(4).tolist(), estimate.consistency
    ([0.6, 0.5, 0.1], 'inertia')
    """

    name: ClassVar[str] = "Nakanishi et al. 2008, corrected"
    source: ClassVar[str] = (
        "after J. Nakanishi, R. Cory, M. Mistry, J. Peters, S. Schaal, Operational space control: a theoretical and "
        "empirical comparison, International Journal of Robotics Research 27(6), 2008"
    )

    def _descent(self, problem: Problem, progress: Progress | None) -> FactoredFit:
        full = problem.feasible_set.consistency == "full"
        shift = problem.margin_shift(full)
        shift[problem.others] = problem.feasible_set.margin * np.isfinite(problem.lower_bounds[problem.others])
        return FactoredFit(problem, CholeskyOfBody(second_moments=full), problem.rho, shift=shift)
