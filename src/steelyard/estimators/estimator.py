"""The interface of estimators, the table of estimators by name, and the Estimate that an estimator returns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError, faults_told
from steelyard.extensions import Extensions
from steelyard.feasibility.certificates import FeasibilityCertificate
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.files import shown, suggestion
from steelyard.regression import Estimate, Information, ParameterCovariance
from steelyard.robot.joint import joint_geometry

__all__ = ["ESTIMATORS", "Estimator", "estimate_with", "find_estimator", "proved_estimate"]

Vector = npt.NDArray[np.float64]

Estimator = Callable[..., Estimate]
"""Called as ``estimator(info, feasible_set, **options)``; `proved_estimate` makes its answer from parameters.

One that makes rows of its own has an attribute ``rows(model, samples, count=5)``, which `steelyard.identify` calls with
a callable that reads all the samples: it returns their Information, which then takes the place of that of the rows as
they were measured, and the Informations of so many contiguous parts.

One that needs the motion of the robot without noise has an attribute ``rows_of_motion(samples, feasible_set, motion,
weights=, count=)`` in its place: it gets the samples of each log, and for each samples or a function of base
parameters, as the table [controller] of the robot file tells them. With an attribute ``needs_controller`` that is true,
this table has to tell the reference and the gains.

One of these that friction near standstill still moves, by rows there or around passages that it leaves out, has an
attribute ``counts_slow_rows`` that is true: what this friction does to least squares of the rows as measured widens its
intervals, too.

One that brings a prior of its own has an attribute ``has_prior`` that is true, and takes no other."""

_CONSISTENT = 1e-6
"""Relative difference up to which what an estimate says is what its parameters make: rounding is far below that, and a
number that belongs to other parameters far above it."""

DUST = 1e-12
"""Times the size of a link: numbers of it up to this are zero. Solvers and linear algebra leave 1e-13 at best."""


def _checked_estimator(name: str, offered: object) -> Estimator:
    if not callable(offered):
        raise TypeError(f"expected a function of an Information and a FeasibleSet, got {shown(offered)}")
    return offered


ESTIMATORS: Extensions[Estimator] = Extensions(
    "estimators",
    "estimator",
    {
        "bayesian": f"{__package__}.posterior:bayesian",
        "energy": f"{__package__}.energy_and_momentum:energy",
        "fit": f"{__package__}.fit:fit",
        "maximum_likelihood": f"{__package__}.maximum_likelihood:maximum_likelihood",
        "momentum": f"{__package__}.energy_and_momentum:momentum",
        "instrumental_variables": f"{__package__}.instrumental_variables:of_instruments",
        "output_error": f"{__package__}.output_error:of_outputs",
    },
    _checked_estimator,
)


@in_one_thread
def proved_estimate(
    info: Information,
    feasible_set: FeasibleSet,
    parameters: Vector,
    method: str,
    *,
    weights: npt.NDArray[np.float64] | None = None,
    remarks: Iterable[str] = (),
    optimality_gap: float | None = None,
) -> Estimate:
    """Return the estimate of feasible parameters, with their proof, their errors and their standard errors.

    Parameters
    ----------
    info : Information
        The data.
    feasible_set : FeasibleSet
    parameters : (n,)
        A point of the set.
    method : str
        How they were found, in a few words.
    weights : (N,), optional
        By which joints were weighted.
    remarks : iterable of str
        What the user should know, beside what the data says of itself.
    optimality_gap : float, optional
        See :class:`steelyard.Estimate`.

    Returns
    -------
    Estimate
        Its base parameters are K times the parameters.

    Raises
    ------
    InputError
        If the data has other base parameters than the set, as those of another robot, or has them in another order.
    SolverError
        If the parameters are not feasible.
    """
    model = feasible_set.model
    _require_same_base(info, model)
    parameters = np.asarray(parameters, dtype=np.float64)
    if parameters.shape != (feasible_set.parameter_count,) or not np.isfinite(parameters).all():
        raise InputError(
            f"{method} must give {feasible_set.parameter_count} finite parameters, got {shown(parameters.tolist())}."
        )
    if not feasible_set.contains(parameters):
        raise SolverError(
            f"The parameters that {method} found are not feasible, so that they are no answer; "
            "steelyard.check tells which conditions they violate."
        )
    # Before the proof, so that what is proved, written and shown are the same numbers.
    parameters = _without_dust(feasible_set, parameters)
    joint_names = info.joint_names
    of_robot: dict[str, Any] = {}
    if isinstance(model, Model):
        of_robot = {
            **model.drives(parameters).always_told(),
            "description": {"joints": joint_geometry(model.robot.joints)},
        }
        joint_names = joint_names or tuple(model.robot.joint_names)  # reduced data does not name them
    # The certificate is about the standard parameters, which users take; the base parameters follow from them.
    certificate = FeasibilityCertificate.of_parameters(feasible_set, parameters)
    base = feasible_set.K @ parameters
    covariance = ParameterCovariance.of(info, base, weights)
    return Estimate(
        method=method,
        base_names=info.base_names,
        base_expressions=certificate.base_expressions,  # reduced data may have names of its own
        base=certificate.base,
        standard_error=covariance.standard_error,
        error_correlation=covariance.error_correlation,
        filtered_torque=info.filtered_torque,
        joint_names=joint_names,
        relative_error=info.relative_error(base),
        row_count=info.count,
        condition_number=info.condition_number,
        joint_relative_error=info.joint_relative_error(base) if info.has_joint_errors else None,
        weights=weights,
        parameter_names=tuple(model.parameter_names),
        parameters=parameters,
        consistency=feasible_set.consistency,
        **of_robot,
        certificate=certificate.document(),
        remarks=(*info.remarks, *remarks),
        optimality_gap=optimality_gap,
    )


def _without_dust(feasible_set: FeasibleSet, parameters: Vector) -> Vector:
    """Return the parameters with zero where a number of a link is rounding beside the size of that link.

    Where a link is symmetric and no data says otherwise, solvers end at a centre of mass of 1e-49 m, which in a
    description or a table looks like a result.
    """
    columns = feasible_set.link_columns
    bodies = parameters[columns]
    mass, second = np.abs(bodies[:, 9]), 0.5 * np.abs(bodies[:, [0, 3, 5]]).sum(axis=1)
    sizes = np.repeat(np.column_stack([second, np.sqrt(mass * second)]), [6, 3], axis=1)
    cleaned = parameters.copy()
    cleaned[columns[:, :9]] = np.where(np.abs(bodies[:, :9]) <= DUST * sizes, 0.0, bodies[:, :9])
    return cleaned if feasible_set.contains(cleaned) else parameters


@in_one_thread
def estimate_with(estimator: str | Estimator, info: Information, feasible_set: FeasibleSet, **options: Any) -> Estimate:
    """Estimate with an estimator by name, or with a function.

    Parameters
    ----------
    estimator : str or callable
        ``"fit"``, a name that another package adds, or ``estimator(info, feasible_set, **options)``.
    info : Information
    feasible_set : FeasibleSet
    **options
        Those of the estimator.

    Returns
    -------
    Estimate
        Of an estimator of another package it is checked that the parameters are feasible, and that they have the base
        parameters and the error that the estimate says.

    Raises
    ------
    InputError
        If there is no such estimator.
    SolverError
        If it fails, or gives no feasible estimate of this robot.
    """
    found = find_estimator(estimator)
    if estimator in ESTIMATORS.own or found is ESTIMATORS.get("fit"):
        return found(info, feasible_set, **options)
    name = f"`{estimator}`" if isinstance(estimator, str) else getattr(estimator, "__name__", "given")
    with faults_told(f"The estimator {name} failed", 'mend it, or use estimator="fit"', SolverError):
        return _checked(found(info, feasible_set, **options), info, feasible_set)


def find_estimator(estimator: str | Estimator) -> Estimator:
    """Return the estimator of that name, or the function itself.

    Raises
    ------
    InputError
        If there is none; names the closest one.
    """
    found = ESTIMATORS.get(estimator) if isinstance(estimator, str) else estimator
    if found is None:
        raise InputError(f"There is no estimator {estimator!r}; {suggestion(str(estimator), ESTIMATORS.names())}")
    if not callable(found):
        raise InputError(f"estimator must be a name or a function, got {shown(estimator)}.")
    return found


def _checked(given: object, info: Information, feasible_set: FeasibleSet) -> Estimate:
    """Return what an estimator gives, if all that it says of its parameters is so."""
    if not isinstance(given, Estimate):
        raise TypeError(f"expected a steelyard.Estimate, got {shown(given)}")
    if given.parameters is None:
        raise TypeError("expected an Estimate with the parameters of all links, got one with base parameters alone")
    own = proved_estimate(info, feasible_set, given.parameters, given.method, weights=given.weights)
    for name in ("base_expressions", "parameter_names", "joint_names", "consistency", "row_count"):
        if getattr(given, name) != getattr(own, name):
            raise ValueError(f"its {name} are not those of the robot and the data: {shown(getattr(given, name))}")
    for name in ("base", "relative_error"):
        said, made = np.asarray(getattr(given, name)), np.asarray(getattr(own, name))
        rounding = _CONSISTENT * np.abs(made).max()
        if said.shape != made.shape or not np.allclose(said, made, rtol=_CONSISTENT, atol=rounding):
            raise ValueError(f"its parameters do not make the {name} that it says")
    if given.standard_error.shape != own.standard_error.shape:
        raise ValueError(f"its standard_error has the shape {given.standard_error.shape}")
    # What nobody measured is not told, and the proof is that of these parameters.
    return replace(
        given,
        parameters=own.parameters,
        base=own.base,
        certificate=own.certificate,
        damping=own.damping,
        friction=own.friction,
        rotor_inertia=own.rotor_inertia,
        offset=own.offset,
        joint_relative_error=own.joint_relative_error,
        condition_number=own.condition_number,
        optimality_gap=None,
    )


def _require_same_base(info: Information, model: Any) -> None:
    if info.base_names == info.base_expressions:
        return  # of a regression that was reduced elsewhere, which has names of its own
    base = model.base_parameters()
    names, expressions = (tuple(getattr(base, name, ())) for name in ("names", "expressions"))  # other makes lack them
    if not names or info.base_expressions == expressions:
        return
    if info.base_names != names and sorted(info.base_names) == sorted(names):
        raise InputError(
            "The data has the base parameters of the feasible set in another order, such as that of a robot with its "
            "terms in another order; use the Information and the FeasibleSet of one model."
        )
    pairs = zip_longest(info.base_expressions, expressions, fillvalue="nothing")
    own, other = next(pair for pair in pairs if pair[0] != pair[1])
    raise InputError(
        f"The data is of another robot than the feasible set, or of other lengths: one of its base parameters is "
        f"{shown(own)} where the set has {shown(other)}; use the Information and the FeasibleSet of one model."
    )
