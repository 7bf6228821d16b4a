"""Identification: least squares within the feasible set, from an Information to an Estimate."""

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from steelyard.dynamics import Model
from steelyard.regression import Estimate, Information, standard_deviations

from .feasible_set import FeasibleSet
from .fitting import fit_reduced
from .proof import FeasibilityCertificate

__all__ = ["fit"]


def fit(
    info: Information,
    feasible: FeasibleSet,
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    prefer: Literal["lightest", "cad"] | None = "lightest",
    tolerance: float = 5e-4,
) -> Estimate:
    """Fit the data among physically possible parameters alone (thesis 3.53, 3.58).

    Where plain least squares is infeasible, many answers fit nearly as well, and the best of all may not even exist,
    because the residual keeps falling as masses that the motion does not show grow without end. So the answer is the
    preferred one among all whose squared residual is at most (1 + tolerance) times the least one below a mass bound;
    its remarks say so. Where least squares is feasible, the preference chooses among its standard parameters only.

    Parameters
    ----------
    info : Information
        Of the same model as `feasible`.
    feasible : FeasibleSet
    weights : "joint", None or (N,)
        As in `least_squares`. ``"joint"`` is ordinary least squares where the rows of the joints are not known apart.
    prefer : {"lightest", "cad", None}
        Least total mass; closest to the inertial parameters of CAD; or what the solver returns within the mass bound.
    tolerance : float
        Fraction of the squared residual that may be spent where plain least squares is infeasible; 0.008 of what
        feasibility itself costs, where that is more. 0 spends nothing.

    Returns
    -------
    Estimate
        Its `parameters` are proved feasible, and K times them is its `base`; `certificate` holds the proof.

    Raises
    ------
    InputError
        For unknown options, ``"cad"`` without CAD, or data of another model.
    SolverError
        If no parameters satisfy all conditions, or the solver finds none.

    See Also
    --------
    steelyard.least_squares : The same without regard to physics.
    steelyard.correct : The nearest feasible parameters, without data.

    References
    ----------
    C. D. Sousa, PhD thesis, University of Coimbra, 2014, section 3.5.

    Examples
    --------
    >>> import numpy as np
    >>> from steelyard.dynamics import Model
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], name="pendulum", gravity=(0, -9.81, 0)))
    >>> names = model.base_parameters().names
    >>> names
    ('Lzz1', 'lx1', 'ly1')
    >>> info = Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, names)
    >>> estimate = fit(info, FeasibleSet(model))
    >>> bool(estimate.base[0] > 0), estimate.consistency
    (True, 'full')
    """
    used: Any = weights
    if isinstance(weights, str) and weights == "joint" and not info.by_joint:
        used = None
    values = None if used is None else info.joint_weights(used)
    problem = info.reduced(values)
    found = fit_reduced(problem, feasible, prefer, tolerance)

    model = feasible.model
    damping, friction = model.joint_friction(found.parameters) if isinstance(model, Model) else (None, None)
    remarks = list(found.remarks)
    if info.undetermined:
        remarks.append(
            f"The data does not determine {len(info.undetermined)} of {info.base_count} base parameters, which the "
            f"preference decides: {'; '.join(info.undetermined)}."
        )
    certificate = FeasibilityCertificate(feasible, found.base, found.parameters)
    method = "least squares" if values is None else "joint-weighted least squares"
    return Estimate(
        method=f"feasible {method}",
        base_names=info.base_names,
        base_expressions=info.base_expressions,
        base=found.base,
        standard_deviation=standard_deviations(problem, found.base, np.asarray(info.undetermined_mask)),
        joint_names=info.joint_names,
        relative_error=info.relative_error(found.base),
        row_count=info.count,
        condition_number=info.condition_number,
        joint_relative_error=info.joint_relative_error(found.base) if info.by_joint else None,
        weights=values,
        parameter_names=tuple(model.parameter_names),
        parameters=found.parameters,
        consistency=feasible.consistency,
        damping=damping,
        friction=friction,
        certificate=certificate.to_dict(),
        remarks=tuple(remarks),
    )
