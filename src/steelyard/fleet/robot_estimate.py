"""One robot of a fleet, at one time: from its Informations, or its logs, to its estimate and both verdicts.

It is what :func:`steelyard.identify` does once the logs are reduced; the model, the conditions and what is known of the
robot beforehand are made once for all robots of one description.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from steelyard.collision.robot_geometry import files_of_meshes
from steelyard.display import shortened
from steelyard.dynamics import Model
from steelyard.errors import InputError, SteelyardError
from steelyard.estimators.cross_validation import FEWEST_FOLDS
from steelyard.estimators.physical_prior import PhysicalPrior, physical_prior
from steelyard.estimators.plausible_fit import plausible_fit, tried_prior
from steelyard.feasibility import FeasibleSet, check
from steelyard.files import file_hash, plain
from steelyard.identification.given import given_constraints, given_logs, wider_model
from steelyard.identification.log_reader import ReducedLog
from steelyard.identification.parameter_table import parameter_table
from steelyard.identification.prediction_verdict import few_rows_of, prediction_verdict, said_of
from steelyard.identification.reduced_logs import copies_among
from steelyard.recording.formats import content_hash, hashed_log
from steelyard.regression import Information, ParameterCovariance, least_squares, torque_gains
from steelyard.robot import RobotFile

from .checkpoints import robot_content
from .data_sets import reduced_logs
from .manifest import FleetEntry, is_information
from .packed import packed, unpacked

__all__ = ["Known", "inputs_of", "known_of", "model_of", "robot_estimate", "something_came", "task_of"]


@dataclass(frozen=True, eq=False)
class Known:
    """The knowledge that all robots of one description share.

    Attributes
    ----------
    file : RobotFile
    stated : Model
        As the robot file states it.
    model : Model
        The same, or with the inertia of rotors.
    feasible_set : FeasibleSet
    prior : PhysicalPrior
    """

    file: RobotFile
    stated: Model
    model: Model
    feasible_set: FeasibleSet
    prior: PhysicalPrior


@lru_cache(maxsize=64)  # asked for row by row, of which neighbours may be of other descriptions
def _file_and_models(robot: str) -> tuple[RobotFile, tuple[Model, ...]]:
    file = RobotFile.load(robot)
    model = Model.from_file(file)
    wider = wider_model(file, model)
    return file, (model,) if wider is None else (model, wider)


def model_of(robot: str, with_rotors: bool) -> Model:
    """Return the model of a description, with rotor inertia at every joint or as it states."""
    return _file_and_models(robot)[1][-1 if with_rotors else 0]


@lru_cache(maxsize=4)
def known_of(robot: str, with_rotors: bool) -> Known:
    """Return what is known of the robots of a description, with rotor inertia at every joint or as it states."""
    file, models = _file_and_models(robot)
    model = model_of(robot, with_rotors)
    constraints = given_constraints(file)
    feasible_set = FeasibleSet(model, constraints=constraints)
    return Known(file, models[0], model, feasible_set, physical_prior(model, constraints))


def task_of(entry: FleetEntry, intervals: str) -> dict[str, Any]:
    """Return what `robot_estimate` needs of a robot, as plain data."""
    return {
        "label": entry.label,
        "robot": str(entry.robot),
        "logs": list(entry.logs),
        "informations": list(entry.files("informations")),
        "validate": list(entry.files("validate")),
        "intervals": intervals,
    }


def robot_estimate(common: Any, task: dict[str, Any]) -> bytes:
    """Estimate one robot; what goes wrong is part of the answer, so that no robot stops the others.

    Parameters
    ----------
    common : None
    task : dict
        What `task_of` returned.

    Returns
    -------
    bytes
        Packed: ``"reason"`` alone where nothing came of it.
    """
    try:
        return packed(_estimate(task))
    except SteelyardError as error:
        return packed({"reason": str(error)})
    except (ArithmeticError, LookupError, OSError, TypeError, ValueError, np.linalg.LinAlgError, MemoryError) as error:
        told = " ".join(str(error).split())[:300]
        return packed({"reason": f"a fault of steelyard, {type(error).__name__} ({told}); identify it by itself."})


def something_came(content: bytes) -> bool:
    """Tell whether what `robot_estimate` returned is an estimate; only these are kept.

    Not each reason follows from the data alone: a disk that was full, or memory that did not suffice, may do so later.
    """
    return not unpacked(content)["reason"]


def _estimate(task: dict[str, Any]) -> dict[str, Any]:
    robot = task["robot"]
    if task["informations"]:
        parts = [Information.load(path) for path in task["informations"]]
        known = _known_for(robot, parts[0], task["informations"][0])
        for path, part in zip(task["informations"], parts, strict=True):
            _require_model(part, known.model, path)
        information, stretches, remarks = Information.total(parts), tuple(parts), list(parts[0].remarks)
        if len(parts) < FEWEST_FOLDS:
            stretches = ()
        given = [(path, "identification", part) for path, part in zip(task["informations"], parts, strict=True)]
        own: list[ReducedLog] = []  # whose rows are not known
    else:
        known, information, stretches, remarks, own = _reduced(robot, task["logs"])
        given = [(log.name, "identification", log.information) for log in own]
    model, feasible_set = known.model, known.feasible_set
    if information.count <= information.base_count:
        raise InputError(
            f"{task['label']}: {information.count} rows do not suffice for {information.base_count} base parameters; "
            "give longer logs."
        )
    unconstrained = least_squares(information)
    covariance = ParameterCovariance.of(information, unconstrained.base, unconstrained.weights)
    verdict = check(feasible_set, base=unconstrained.base)
    tried = tried_prior(information, stretches, feasible_set, unconstrained, prior=known.prior)
    plausible = plausible_fit(information, feasible_set, unconstrained, tried)
    estimate = plausible.estimate
    assert estimate.parameters is not None
    validation, others = _validation(known, task["validate"])
    given += [(path, "validation", part) for path, part in zip(task["validate"], validation, strict=True)]
    copies = copies_among(given, {name: _content(name) for name, _, _ in given})
    remarks += copies.values()
    validation = [part for index, (_, role, part) in enumerate(given) if role == "validation" and index not in copies]
    few = [
        rows
        for role, logs in (("identification", own), ("validation", others))
        for log in logs
        for rows in few_rows_of(log.name, role, log.information, model, estimate.base, log.drawn)
    ]
    prediction = prediction_verdict(
        information,
        estimate.base,
        validation=validation,
        held_out_error=plausible.held_out_error,
        fold_count=len(stretches),
        few_rows=few,
        units=model.robot.torque_units,
    )
    if few:
        remarks.append(said_of(few))
    rows: list[dict[str, Any]] = []
    if task["intervals"] == "all":
        table = parameter_table(
            information,
            plausible.plausible_set,
            estimate,
            unconstrained,
            term_scales=plausible.term_deviations,
        )
        rows = [
            {key: row[key] for key in ("name", "meaning", "unit", "value", "lower", "upper", "basis")}
            for row in table.to_list()
        ]
    return {
        "reason": "",
        "with_rotors": model is not known.stated,
        "rows": information.count,
        "base": unconstrained.base,
        "covariance": covariance.matrix,
        "freedom": covariance.degrees_of_freedom,
        "gains": torque_gains(information, unconstrained.weights),
        "parameters": estimate.parameters,
        "possible": bool(feasible_set.contains(estimate.parameters)),
        "feasible": verdict.status,
        "word": prediction.word,
        "source": prediction.source,
        "model_error": prediction.model_error,
        "relative_error": prediction.relative_error,
        "least_squares_error": unconstrained.relative_error,
        "condition_number": information.condition_number,
        "filtered": information.filtered_torque,
        "table": rows,
        "remarks": list(dict.fromkeys(remarks)),
    }


def _known_for(robot: str, information: Information, path: str) -> Known:
    """What is known of the model of which an Information is; with rotors where it has them and nothing states terms."""
    _, models = _file_and_models(robot)
    for index, model in enumerate(models):
        if model.base_parameters().expressions == information.base_expressions:
            return known_of(robot, index > 0)
    raise _other_model(path, models[0], information)


def _require_model(information: Information, model: Model, path: str) -> None:
    if model.base_parameters().expressions != information.base_expressions:
        raise _other_model(path, model, information)


def _other_model(path: str, model: Model, information: Information) -> InputError:
    own, given = model.base_parameters().expressions, information.base_expressions
    alone = next((one for one in given if one not in own), None)
    told = f"; it alone has {shortened(alone, 60)}" if alone is not None else ""
    return InputError(
        f"{path}: is of another robot or of other terms than {model.robot.name}: {len(given)} base parameters where "
        f"this has {len(own)}{told}; reduce the logs with the robot of the manifest."
    )


def _reduced(
    robot: str, logs: Sequence[str]
) -> tuple[Known, Information, tuple[Information, ...], list[str], list[ReducedLog]]:
    """Reduce logs; the rotors of robots whose terms nobody states belong to the model, as siblings have the same."""
    known = known_of(robot, True)
    each: list[ReducedLog] = []
    found = reduced_logs(known.file, known.model, given_logs(list(logs), None)[0], each.append)
    return known, found.information, found.stretches, list(found.remarks), each


def _validation(known: Known, paths: Sequence[str]) -> tuple[list[Information], list[ReducedLog]]:
    """Informations, or logs that are reduced, of what the fit does not see, and these logs one by one."""
    found: list[Information] = []
    each: list[ReducedLog] = []
    for path in paths:
        if is_information(path):
            information = Information.load(path)
        else:
            information = reduced_logs(known.file, known.model, given_logs([path], None)[0], each.append).information
        _require_model(information, known.model, path)
        found.append(information)
    return found, each


def inputs_of(task: dict[str, Any]) -> list[Any]:
    """Return what the result of a task follows from, as plain data: hashes of files, and the robot."""
    file, _ = _file_and_models(task["robot"])
    sections = [file.section(name) for name in ("log", "processing", "constraints")]
    # The shapes of links, which decide what is known of them, stand in the description and in meshes alone.
    described = [file_hash(path) for path in (file.path, file.robot.source) if path is not None and path.is_file()]
    known = _known_by_files(task["robot"], *described)
    logs = [str(log) for log in given_logs(task["logs"], None)[0]] if task["logs"] else []
    files = [*logs, *task["informations"], *task["validate"]]
    # Remarks name the files, and a log is read by its suffix: one with the same content is another one.
    contents = [[path, *_content(path)] for path in files]
    return [task["label"], task["intervals"], sections, described, known, robot_content(file.robot), contents]


@lru_cache(maxsize=64)  # as `_file_and_models`
def _known_by_files(robot: str, *described: str) -> tuple[Any, ...]:
    """What is known of the robots of a description with these hashes by meshes and constraints, as plain data."""
    file, _ = _file_and_models(robot)
    source = file.robot.source
    meshes = [] if source is None or not source.is_file() else files_of_meshes(file.robot, source)
    return [file_hash(path) for path in meshes], plain(given_constraints(file))


def _content(log: str) -> tuple[str, ...]:
    """What tells the contents of a log, whose files may be several."""
    return tuple(content_hash(entry) for entry in hashed_log(log))
