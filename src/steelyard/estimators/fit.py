"""Identification: least squares within the feasible set, from an Information to an Estimate."""

from typing import Literal

import numpy as np
import numpy.typing as npt

from steelyard import estimators
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.feasibility import TieBreak
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.regression import Estimate, Information, method_name

from .estimator import proved_estimate
from .prior import Prior
from .reduced_fit import fit_reduced

__all__ = ["fit"]


@in_one_thread
def fit(
    info: Information,
    feasible_set: FeasibleSet,
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    prefer: Literal["lightest", "cad"] | TieBreak | Prior | None = "lightest",
    residual_slack: float = 5e-4,
    prior: Prior | None = None,
    prior_weight: float | Literal["corner"] = 1.0,
    solver: str = "clarabel",
) -> Estimate:
    """Fit the data among physically possible parameters alone (thesis 3.53, 3.58).

    If the conditions, the constraints or a prior bound all masses, or if plain least squares is feasible, the base
    parameters are those of the least residual, and the tie-break chooses among the standard parameters that have them.
    Otherwise the residual often keeps falling as masses that the motion does not show grow without bound. No optimum
    exists then, and many answers fit nearly as well. The result is the preferred one among all parameters whose squared
    residual is at most (1 + residual_slack) times the least one below a mass bound. The remarks of the estimate say
    which case applied.

    Parameters
    ----------
    info : Information
        Data of the same model as `feasible_set`. Its kind decides the kind of fit: ordinary or joint-weighted from
        samples, generalised with a `covariance`, robust from `robust_information`.
    feasible_set : FeasibleSet
    weights : "joint", None or (N,)
        As in `least_squares`. ``"joint"`` means ordinary least squares if the data does not tell the rows of the joints
        apart.
    prefer : {"lightest", "cad", None}, TieBreak or Prior
        Which parameters are preferred: those of least total mass, those closest to the inertial parameters of the
        description, the point that the solver returns within the mass bound, those of a tie-break of your own, or
        those closest to a prior.
    residual_slack : float
        Fraction by which the squared residual may rise for the tie-break if masses can grow without bound and plain
        least squares is infeasible; at least 0.008 of what feasibility itself costs. 0 allows no rise.
    prior : Prior, optional
        `EuclideanPrior`, `EntropicPrior` or `ConstantPullbackPrior`: minimise ½ (squared residual) / (variance of the
        noise) + prior_weight · (distance from the prior). The prior then takes the place of `prefer`.
    prior_weight : float or "corner"
        1 / τ² if the prior is expected to be right to a relative deviation τ and the noise of all rows is independent.
        The noise of neighbouring samples is not, so that larger weights are usual. ``"corner"`` takes the corner of
        `l_curve`.
    solver : str
        Name of a solver. By default a fit with a prior is first searched for from within the set, to more digits than
        Clarabel reaches, and Clarabel solves what that leaves.

    Returns
    -------
    Estimate
        Its `parameters` are proved feasible, and `base` is K times these; `certificate` holds the proof. Its
        `optimality_gap` is measured from a lower bound of the residual that does not depend on the solver's accuracy.

    Raises
    ------
    InputError
        For unknown options, ``"cad"`` without CAD, an impossible prior, or data of another model.
    SolverError
        If no parameters satisfy all conditions, or the solver finds none.

    See Also
    --------
    steelyard.least_squares : The same without regard to physics.
    steelyard.correct : The nearest feasible parameters, without data.
    steelyard.estimators.l_curve : Residual against distance from the prior, for all weights.
    steelyard.feasibility.lightest_robot : The least mass with which an estimate is possible at all.

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
    values = info.joint_weights(weights) if info.is_weighted(weights) else None
    problem = info.reduced(values)
    weight = prior_weight
    if isinstance(weight, str):
        if weight != "corner" or prior is None:
            expected = 'a positive number or "corner", and needs a prior' if prior is None else 'a number or "corner"'
            raise InputError(f"prior_weight must be {expected}; got {weight!r}.")
        weight = estimators.l_curve(info, feasible_set, prior, weights=values, solver=solver).corner
    found = fit_reduced(problem, feasible_set, prefer, residual_slack, prior, weight, solver)

    remarks = list(found.remarks)
    unidentifiable = np.asarray(info.unidentifiable_mask)
    parameters, described = _as_described(unidentifiable, feasible_set, found.parameters)
    if unidentifiable.any():
        decides = "tie-break" if prior is None else "prior"
        but = f" ({', '.join(described)} as in the description)" if described else ""
        remarks.append(
            f"The data does not determine {len(info.unidentifiable)} of {info.base_count} base parameters, which the "
            f"{decides} decides{but}: {'; '.join(info.unidentifiable)}."
        )
    return proved_estimate(
        info,
        feasible_set,
        parameters,
        f"feasible {method_name(info, values is not None)}",
        weights=values,
        remarks=remarks,
        optimality_gap=found.optimality_gap if np.isfinite(found.optimality_gap) else None,
    )


def _as_described(
    unidentifiable: npt.NDArray[np.bool_], feasible_set: FeasibleSet, parameters: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], list[str]]:
    """Return the parameters with those terms as in the description for which nothing else asks, and their names.

    Nothing asks for the friction and the rotor of a joint that stands still, which would be zero in what is written.
    *Measured* in MuJoCo: a joint of 0.014 kg·m², of which its rotor has 0.010, stays within 7 mrad of where a
    controller with 5 N·m·s/rad at 500 Hz holds it; with zeros it had 0.0025 kg·m² and flew away, and as described, with
    an armature that is 30 % too large, it stays within 7 mrad.
    """
    said = np.asarray(feasible_set.model.robot.parameters, dtype=np.float64)
    if said.shape != parameters.shape or not unidentifiable.any():
        return parameters, []
    K = np.asarray(feasible_set.K)
    terms = np.setdiff1d(np.arange(len(parameters)), feasible_set.link_columns)
    hidden = K[:, terms].any(axis=0) & ~K[np.ix_(~unidentifiable, terms)].any(axis=0)
    at_zero = np.abs(parameters[terms]) <= 2.0 * feasible_set.margin
    columns = terms[hidden & at_zero & np.isfinite(said[terms]) & (said[terms] != 0.0)]
    changed = parameters.copy()
    changed[columns] = said[columns]
    if not len(columns) or not feasible_set.contains(changed):
        return parameters, []
    return changed, [str(feasible_set.model.parameter_names[column]) for column in columns]
