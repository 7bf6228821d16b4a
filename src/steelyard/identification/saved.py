"""Saved estimates: whether one is feasible, why or why not, the nearest feasible one, and its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import (
    CertificateCheck,
    FeasibilityCertificate,
    FeasibleSet,
    InfeasibilityExplanation,
    LightestRobot,
    ParameterIntervals,
    Verdict,
    check,
    correct,
    explain_infeasibility,
    lightest_robot,
    load_certificate,
    parameter_intervals,
    verify_certificate,
    verify_document,
)
from steelyard.feasibility.certificates import speaks_of
from steelyard.feasibility.certificates.certificate import LAST_DIGITS
from steelyard.feasibility.certificates.rational import nearest_double, parse_number
from steelyard.files import write_json
from steelyard.regression import Estimate
from steelyard.robot import RobotFile

from .default_terms import model_of_estimate, model_with
from .given import given_constraints

__all__ = [
    "EstimateExplanation",
    "check_certificate",
    "check_estimate",
    "correct_estimate",
    "explain_estimate",
    "matching_estimate",
    "parameters_for_source",
    "parameters_of_description",
    "parameters_of_estimate",
    "set_and_estimate",
]

ROUNDING = 1e-13
"""What computing K δ in floating point may be off by, relative to the sum of what is added: up to a hundred terms, each
off by half a unit in the last place, with room for other orders of summation."""


def check_estimate(
    robot: str | Path | RobotFile, estimate: str | Path, consistency: Literal["full", "inertia"] = "full"
) -> Verdict:
    """Tell whether a robot with the parameters of a saved estimate could exist.

    Parameters
    ----------
    robot : str, Path or RobotFile
        URDF or robot.toml, whose constraints count too.
    estimate : str or Path
        What :meth:`steelyard.Estimate.save` wrote; its standard parameters are checked where it has them, otherwise
        its base parameters.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.

    Raises
    ------
    InputError
        If a file cannot be used, or the estimate belongs to another robot.
    """
    file = RobotFile.load(robot)
    model = model_of_estimate(estimate, file)
    feasible_set = _feasible_set(file, model, consistency)
    loaded = _estimate_of(model, estimate, certified=False)
    if loaded.parameters is None:
        return check(feasible_set, base=loaded.base)
    verdict = check(feasible_set, parameters=loaded.parameters)
    if verdict.feasible:
        # For impossible parameters the verdict says why. Possible ones are refused where the file contradicts itself.
        matching_estimate(model, estimate)
        if loaded.elastic_model:
            from .elastic.elastic_model import elastic_verdict  # loaded for elastic joints alone

            return elastic_verdict(model, loaded, str(estimate), consistency)
    return verdict


def check_certificate(
    certificate: str | Path,
    robot: str | Path | RobotFile | None = None,
    estimate: str | Path | None = None,
    consistency: Literal["full", "inertia"] = "full",
) -> CertificateCheck:
    """Verify a saved certificate in exact arithmetic, and, where a robot is given, that it speaks of it.

    Parameters
    ----------
    certificate : str or Path
        What ``save`` of a certificate wrote.
    robot : str, Path or RobotFile, optional
        URDF or robot.toml: the statement of the certificate must be that of this robot.
    estimate : str or Path, optional
        Its base parameters must be those of the certificate, to the last digit.
    consistency : {"full", "inertia"}
        Of the robot's set.

    Raises
    ------
    InputError
        If a file cannot be used.
    """
    verified = verify_certificate(certificate)
    if robot is None or not verified:
        return verified
    document = load_certificate(certificate)
    file = RobotFile.load(robot)
    base = None
    if estimate is None:
        model = model_with(document["statement"]["parameter_names"], file)
        feasible_set = _feasible_set(file, model, consistency)
    else:
        model, feasible_set, loaded = set_and_estimate(file, estimate, consistency)
        base = loaded.base
        if loaded.elastic_model.get("parameter_names") == list(document["statement"]["parameter_names"]):
            from .elastic.elastic_model import elastic_model_of  # loaded for elastic joints alone

            elastic = elastic_model_of(model, loaded, str(estimate))
            assert elastic is not None
            feasible_set = FeasibleSet(elastic.model, consistency)
            base = FeasibilityCertificate.of_parameters(feasible_set, elastic.parameters).base
    different = speaks_of(document, feasible_set, base)
    if different and not speaks_of(document, feasible_set, base, rounding=LAST_DIGITS):
        return _proved_anew(document, feasible_set, verified, file.path)
    if different:
        whose = f"{estimate}" if different == "base parameters" else f"{file.path} under {consistency!r} consistency"
        sentence = f"The proof is valid, but it speaks of something else: its {different} differ from those of {whose}."
        if different == "consistency":
            own = document["statement"]["consistency"]
            sentence = (
                f"The proof is valid, but it speaks of something else: of {own!r} consistency and not of "
                f"{consistency!r}; give --consistency {own} to ask that."
            )
        return CertificateCheck(False, sentence, 0.0, 0.0)
    return verified


def _proved_anew(
    document: Mapping[str, Any], feasible_set: FeasibleSet, verified: CertificateCheck, robot: Path
) -> CertificateCheck:
    """Return what is proved of a robot whose numbers differ from those of a certificate in their last digits.

    The certificate proves nothing of this robot then, so that its base parameters are judged once more.
    """
    numbers = [nearest_double(parse_number(value)) for value in document["statement"]["base"]]
    certificate = check(feasible_set, base=numbers).certificate if np.all(np.isfinite(numbers)) else None
    here = f"{robot} has other last digits here, as processors make them"
    if certificate is not None and certificate.to_dict()["verdict"] == document["verdict"]:
        found = certificate.verify()
        if found:
            return replace(found, sentence=f"{found.sentence} ({here}; so this was proved anew for its own.)")
    sentence = (
        f"The proof is valid, but {here}, and for its own the same is not proved; verify the certificate alone, "
        "without ROBOT, or make another with: steelyard check ROBOT ESTIMATE --output FILE"
    )
    return replace(verified, valid=False, sentence=sentence, gap=0.0, trace_bound=0.0)


def correct_estimate(
    robot: str | Path | RobotFile,
    estimate: str | Path,
    consistency: Literal["full", "inertia"] = "full",
    metric: Literal["deviation", "euclidean"] = "deviation",
) -> Estimate:
    """Return the physically possible estimate that is nearest to a saved one.

    Parameters
    ----------
    robot : str, Path or RobotFile
        URDF or robot.toml, whose constraints count too.
    estimate : str or Path
        What :meth:`steelyard.Estimate.save` wrote.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.
    metric : {"deviation", "euclidean"}
        Whether each base parameter counts in units of its standard deviation, or all count in SI units. What the data
        does not determine has an infinite deviation and may change freely.

    Returns
    -------
    Estimate
        Its errors are NaN, because there is no data to compute them from.

    Raises
    ------
    InputError
        If a file cannot be used, or the estimate belongs to another robot.
    SolverError
        If no parameters satisfy the constraints.
    """
    model, feasible_set, loaded = set_and_estimate(robot, estimate, consistency)
    if loaded.parameters is not None:
        own = FeasibilityCertificate.of_parameters(feasible_set, loaded.parameters)
        if own.verify():
            # Other parameters have the same base parameters, but whoever chose these had reasons for them.
            return replace(
                loaded,
                base=own.base,
                consistency=consistency,
                certificate=own.document(),
                remarks=(*loaded.remarks, f'Already feasible under "{consistency}" consistency; nothing changed.'),
                optimality_gap=None,  # it was measured for the conditions of the fit
            )
    weights = None
    if metric == "deviation":
        with np.errstate(divide="ignore"):
            weights = np.diag(np.where(loaded.standard_error > 0, 1.0 / loaded.standard_error**2, 0.0))
        exact = loaded.standard_error == 0
        weights[exact, exact] = max(1.0, float(weights.max(initial=0.0)))
    found = correct(feasible_set, base=loaded.base, metric=weights)
    told = str(found)
    if loaded.parameters is not None and found.status == "already feasible":
        told = (
            f'The base parameters are feasible under "{consistency}" consistency and stay as they are; the standard '
            "parameters were not, and were found anew."
        )
    return replace(
        loaded,
        method=loaded.method if found.status == "already feasible" else f"{loaded.method}, corrected",
        base=found.base,
        parameter_names=model.parameter_names,
        parameters=found.parameters,
        joint_names=loaded.joint_names or tuple(model.robot.joint_names),  # reduced data does not name them
        consistency=consistency,
        relative_error=loaded.relative_error if found.status == "already feasible" else float("nan"),
        joint_relative_error=loaded.joint_relative_error if found.status == "already feasible" else None,
        **model.drives(found.parameters).always_told(),
        certificate=found.certificate.document(),
        remarks=(*loaded.remarks, told),
        optimality_gap=None,  # it was measured for the parameters before, and for the conditions of their fit
    )


def _feasible_set(file: RobotFile, model: Model, consistency: Literal["full", "inertia"]) -> FeasibleSet:
    return FeasibleSet(model, consistency, given_constraints(file))


def set_and_estimate(
    robot: str | Path | RobotFile, estimate: str | Path, consistency: Literal["full", "inertia"]
) -> tuple[Model, FeasibleSet, Estimate]:
    """The model of a robot file, its feasible set with the constraints of the file, and an estimate of this robot."""
    file = RobotFile.load(robot)
    model = model_of_estimate(estimate, file)
    loaded = matching_estimate(model, estimate)
    return model, _feasible_set(file, model, consistency), loaded


def matching_estimate(model: Model, estimate: str | Path) -> Estimate:
    """Load a saved estimate and make sure that it belongs to a model, and that it is what it says.

    Its base parameters must be those of its parameters. Where it says that its parameters are feasible, that is proved
    again in exact arithmetic for this model; its certificate must prove it, for this model and for these numbers.

    Parameters
    ----------
    estimate : str or Path
        What :meth:`steelyard.Estimate.save` wrote.

    Raises
    ------
    InputError
        If the file cannot be used, the estimate belongs to another robot, or its numbers contradict each other.
    """
    loaded = _estimate_of(model, estimate, certified=True)
    if loaded.parameters is None:
        return loaded
    base = model.base_parameters()
    rounding = ROUNDING * (np.abs(base.K) @ np.abs(loaded.parameters))
    for name, given, made, error in zip(
        base.expressions, loaded.base, base.values(loaded.parameters), rounding, strict=True
    ):
        if not abs(given - made) <= error:
            raise InputError(
                f"{estimate}: gives {given:.15g} for the base parameter {name}, but its parameters make {made:.15g} of "
                "it; save the estimate anew."
            )
    if loaded.consistency is not None:
        _require_proof(model, loaded, str(estimate))
    return loaded


def _estimate_of(model: Model, estimate: str | Path, *, certified: bool) -> Estimate:
    loaded = Estimate.load(estimate, certified=certified)
    names = (loaded.base_expressions, loaded.parameter_names or tuple(model.parameter_names))
    if names != (model.base_parameters().expressions, tuple(model.parameter_names)):
        raise InputError(
            f"{estimate}: has the parameters of another robot or of other terms than {model.robot.name} has; give the "
            "robot file that it was identified with."
        )
    loaded.require_geometry(model.robot, model.robot.name)
    return loaded


def _require_proof(model: Model, loaded: Estimate, where: str) -> None:
    """Refuse an estimate that is not proved to be as feasible as it says."""
    feasible_set = FeasibleSet(model, "inertia" if loaded.consistency == "inertia" else "full")
    assert loaded.parameters is not None
    verified = FeasibilityCertificate.of_parameters(feasible_set, loaded.parameters).verify()
    if verified and loaded.certificate is not None:
        verified = verify_document(loaded.certificate, where)
        # Last digits may be those of another processor: the parameters were proved for this one's above.
        different = speaks_of(loaded.certificate, feasible_set, loaded.base, rounding=LAST_DIGITS)
        if verified and different:
            raise InputError(
                f"{where}: its certificate speaks of another robot than {model.robot.name}: its {different} differ; "
                "give the robot file that it was identified with."
            )
    if not verified:
        raise InputError(
            f"{where}: says that its parameters are feasible ({loaded.consistency!r}), which is not proved. "
            f'{verified.sentence} Identify anew, or set "consistency" and "certificate" to null in the file to use its '
            "numbers without a proof."
        )


def parameters_of_estimate(model: Model, estimate: str | Path, *, base: bool = False) -> NDArray[np.float64]:
    """Return the parameters of a saved estimate, for a model that is to hold them.

    Parameters
    ----------
    model : Model
    estimate : str or Path
    base : bool
        The base parameters instead of the standard ones.

    Returns
    -------
    ndarray
        (n,), or (n_b,).

    Raises
    ------
    InputError
        If the file cannot be used, belongs to another robot, or holds base parameters alone where standard ones are
        asked for.
    """
    loaded = matching_estimate(model, estimate)
    if base:
        return loaded.base
    if loaded.parameters is None:
        raise InputError(f"{estimate}: holds base parameters alone; use --base, or identify with a feasible method.")
    return loaded.parameters


def parameters_of_description(model: Model, *, base: bool = False) -> NDArray[np.float64]:
    """Return the values of the description (CAD), with zeros for friction and rotors of which it says nothing.

    Parameters
    ----------
    model : Model
    base : bool
        The base parameters instead of the standard ones.

    Returns
    -------
    ndarray
        (n,), or (n_b,).

    Raises
    ------
    InputError
        If the description leaves the inertia of a link open.
    """
    values = np.array(model.robot.parameters)
    for link, columns in zip(model.robot.links, model.link_columns, strict=True):
        if np.isnan(values[columns]).any():
            raise InputError(
                f"{model.robot.name}: the description gives no inertia for the link {link.name!r}; give an estimate."
            )
    values = np.nan_to_num(values)
    return model.base_parameters().values(values) if base else values


def parameters_for_source(
    model: Model, estimate: str | Path | None, *, cad: bool, base: bool = False
) -> NDArray[np.float64] | None:
    """Return the numbers that stand in generated source: of an estimate, of the description, or none.

    Parameters
    ----------
    model : Model
    estimate : str or Path or None
    cad : bool
        The description's own values.
    base : bool
        The base parameters instead of the standard ones.

    Raises
    ------
    InputError
        If both are asked for, or the values cannot be used.
    """
    if cad and estimate is not None:
        raise InputError("Give either an estimate or --cad: the source holds one set of numbers.")
    if cad:
        return parameters_of_description(model, base=base)
    return None if estimate is None else parameters_of_estimate(model, estimate, base=base)


@dataclass(frozen=True, eq=False)
class EstimateExplanation:
    """An explanation why a saved estimate is impossible, or of what is known of its parameters; see `explain_estimate`.

    Attributes
    ----------
    feasible : bool or None
        None where it is too close to the boundary to tell.
    reasons : InfeasibilityExplanation or None
        Where the estimate is infeasible.
    lightest : LightestRobot or None
        Where it is feasible.
    intervals : ParameterIntervals or None
        Where it is feasible.
    """

    feasible: bool | None
    reasons: InfeasibilityExplanation | None
    lightest: LightestRobot | None
    intervals: ParameterIntervals | None

    def __str__(self) -> str:
        parts = [part for part in (self.reasons, self.lightest, self.intervals) if part is not None]
        return "\n\n".join(map(str, parts)) or "Too close to the boundary to tell whether it is feasible."

    def to_dict(self) -> dict[str, Any]:
        """Return the explanation as plain data."""
        parts = {"reasons": self.reasons, "lightest": self.lightest, "intervals": self.intervals}
        return {"feasible": self.feasible, **{key: part.to_dict() for key, part in parts.items() if part is not None}}

    def save(self, path: str | Path) -> None:
        """Write the explanation as JSON, with null for numbers that are not finite.

        The file appears whole or not at all.
        """
        write_json(self.to_dict(), path)


def explain_estimate(
    robot: str | Path | RobotFile, estimate: str | Path, consistency: Literal["full", "inertia"] = "full"
) -> EstimateExplanation:
    """Tell why a saved estimate is impossible, or, where it is possible, what is known of each parameter.

    Parameters
    ----------
    robot : str, Path or RobotFile
        URDF or robot.toml, whose constraints count too.
    estimate : str or Path
        What :meth:`steelyard.Estimate.save` wrote; its base parameters are what counts.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.

    Raises
    ------
    InputError
        If a file cannot be used, or the estimate belongs to another robot.
    """
    _, feasible_set, loaded = set_and_estimate(robot, estimate, consistency)
    verdict = check(feasible_set, base=loaded.base)
    if verdict.feasible is False:
        errors = loaded.standard_error
        known = not loaded.filtered_torque and bool(np.all(np.isfinite(errors)) and np.all(errors > 0))
        covariance = np.diag(errors**2) if known else None
        return EstimateExplanation(
            False, explain_infeasibility(feasible_set, base=loaded.base, covariance=covariance), None, None
        )
    if verdict.feasible is None:
        return EstimateExplanation(None, None, None, None)
    return EstimateExplanation(
        True, None, lightest_robot(feasible_set, loaded.base), parameter_intervals(feasible_set, base=loaded.base)
    )
