"""One robot of a fleet, at one time: from its Informations, or its logs, to its estimate and both verdicts.

It is what :func:`steelyard.identify` does once the logs are reduced; the model, the conditions and what is known of the
robot beforehand are made once for all robots of one description.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from steelyard.collision.robot_geometry import files_of_meshes
from steelyard.dynamics import Model
from steelyard.errors import InputError, SteelyardError
from steelyard.estimators.cross_validation import FEWEST_FOLDS
from steelyard.estimators.physical_prior import PhysicalPrior, physical_prior
from steelyard.estimators.plausible_fit import plausible_fit, tried_prior
from steelyard.feasibility import FeasibleSet, check
from steelyard.files import file_hash, plain
from steelyard.identification.given import (
    given_constraints,
    given_logs,
    is_information,
    wider_model,
    without_informations,
)
from steelyard.identification.log_reader import ReducedLog
from steelyard.identification.parameter_table import parameter_table
from steelyard.identification.prediction_verdict import few_rows_of, prediction_verdict, said_of
from steelyard.identification.reduced_logs import copies_among, overlaps_among
from steelyard.recording.formats import content_hashes, contents_of, unchanged
from steelyard.recording.formats.hashes import LogContent
from steelyard.recording.formats.log_sets import place_of
from steelyard.regression import Information, ParameterCovariance, least_squares, torque_gains
from steelyard.regression.parameter_covariance import FEWEST_DEGREES
from steelyard.robot import RobotFile

from .checkpoints import checkpoint_key, robot_content
from .data_sets import reduced_logs
from .manifest import FleetEntry
from .packed import packed, unpacked

__all__ = [
    "Description",
    "Known",
    "description_of",
    "hashed_files",
    "inputs_of",
    "known_of",
    "model_of",
    "robot_estimate",
    "something_came",
    "task_of",
    "with_contents",
]


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


class Description(NamedTuple):
    """The description of robots as it was when a run began, by which each process knows whether it has the same.

    Attributes
    ----------
    path : str
    content : str
        Follows from all that was read of it, also from files that it includes.
    files : tuple of str
        The hashes of the robot file, of the description that it names and of the meshes, which are the same on each
        machine.
    """

    path: str
    content: str
    files: tuple[str, ...]


def description_of(robot: str) -> Description:
    """Read a description, to tell what it is now."""
    return _told(robot, RobotFile.load(robot))


def _told(robot: str, file: RobotFile) -> Description:
    source = file.robot.source
    # The shapes of links, which decide what is known of them, stand in the description and in meshes alone.
    meshes = [] if source is None or not source.is_file() else files_of_meshes(file.robot, source)
    files = tuple(file_hash(path) for path in (file.path, source, *meshes) if path is not None and path.is_file())
    sections = [file.section(name) for name in ("log", "processing", "constraints")]
    content = checkpoint_key(sections, files, plain(given_constraints(file)), robot_content(file.robot))
    return Description(robot, content, files)


# Known by its content, too: processes of a cluster, and notebooks, outlive what was read from a path.
@lru_cache(maxsize=64)  # asked for row by row, of which neighbours may be of other descriptions
def _file_and_models(robot: Description) -> tuple[RobotFile, tuple[Model, ...]]:
    file = RobotFile.load(robot.path)
    if _told(robot.path, file).files != robot.files:
        raise InputError(
            f"{robot.path}, or a file that it names, was changed after the run began, or is another one where this "
            "robot was estimated; keep the same files everywhere, and run again."
        )
    model = Model.from_file(file)
    wider = wider_model(file, model)
    return file, (model,) if wider is None else (model, wider)


def model_of(robot: Description, with_rotors: bool) -> Model:
    """Return the model of a description, with rotor inertia at every joint or as it states."""
    return _file_and_models(robot)[1][-1 if with_rotors else 0]


@lru_cache(maxsize=4)
def known_of(robot: Description, with_rotors: bool) -> Known:
    """Return what is known of the robots of a description, with rotor inertia at every joint or as it states."""
    file, models = _file_and_models(robot)
    model = model_of(robot, with_rotors)
    constraints = given_constraints(file)
    feasible_set = FeasibleSet(model, constraints=constraints)
    return Known(file, models[0], model, feasible_set, physical_prior(model, constraints))


def task_of(entry: FleetEntry, robot: Description, intervals: str) -> dict[str, Any]:
    """Return what `robot_estimate` needs of a robot, as plain data.

    What paths, folders and patterns stand for is found out here alone: an object store is asked once.
    """
    left_out: dict[str, str] = {}
    passed_over: list[str] = []
    checks, reduced_checks = without_informations(list(entry.validate))
    return {
        "label": entry.label,
        "robot": robot,
        "logs": _logs_of(entry.logs, left_out, passed_over),
        "left_out": left_out,
        "passed_over": passed_over,
        "informations": list(entry.files("informations")),
        "validate": [*(given_logs(checks, None)[0] if checks else ()), *reduced_checks],
        "intervals": intervals,
        "contents": [],
    }


def robot_estimate(common: Any, task: dict[str, Any]) -> bytes:
    """Estimate one robot; what goes wrong is part of the answer, so that no robot stops the others.

    Parameters
    ----------
    common : None
    task : dict
        What `task_of` returned, also `with_contents`.

    Returns
    -------
    bytes
        Packed: ``"reason"`` alone where nothing came of it.
    """
    try:
        with unchanged(task["contents"]):
            return packed(_estimate(task))
    except SteelyardError as error:
        return packed({"reason": str(error)})
    except (ArithmeticError, LookupError, OSError, TypeError, ValueError, np.linalg.LinAlgError, MemoryError) as error:
        told = " ".join(str(error).split())[:300]
        return packed({"reason": f"a fault of steelyard, {type(error).__name__} ({told}); identify it by itself."})


def something_came(content: bytes) -> bool:
    """Tell whether what `robot_estimate` returned is an estimate of all the logs; only these are kept.

    Not each reason follows from the data alone: a disk that was full, or memory that did not suffice, may do so later.
    """
    found = unpacked(content)
    return not found["reason"] and not found["left_out"]


def _estimate(task: dict[str, Any]) -> dict[str, Any]:
    robot, left_out = task["robot"], dict(task["left_out"])
    if task["informations"]:
        known, loaded = _loaded(robot, task["informations"], left_out)
        parts = [part for _, part in loaded]
        information, stretches = Information.total(parts), tuple(parts)
        remarks = [*_told_of(left_out), *parts[0].remarks]
        if len(parts) < FEWEST_FOLDS:
            stretches = ()
        given = [(path, "identification", part) for path, part in loaded]
        own: list[ReducedLog] = []  # whose rows are not known
    else:
        known, information, stretches, remarks, own = _reduced(robot, task["logs"], left_out)
        given = [(log.name, "identification", log.information) for log in own]
    remarks += task["passed_over"]
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
    hashes = {one.log: one.hashes for one in task["contents"]}
    contents = {name: hashes.get(name) or content_hashes(name) for name, _, _ in given}
    copies = copies_among(given, contents)
    remarks += copies.values()
    alike = {given[index][0] for index in copies}
    every = (*own, *(replace(log, fitted=False) for log in others))
    remarks += overlaps_among([log for log in every if log.name not in alike])
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
        "contents": ["".join(contents[name]) for name, role, _ in given if role == "identification"],
        "base": unconstrained.base,
        "covariance": covariance.matrix,
        "freedom": covariance.degrees_of_freedom,
        "short": _is_short(covariance),
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
        "units_are_suspect": any(log.units_are_suspect for log in (*own, *others)),
        "table": rows,
        "left_out": left_out,
        "remarks": list(dict.fromkeys(remarks)),
    }


def _is_short(covariance: ParameterCovariance) -> bool:
    """Whether the data has so few rows of some joint that nothing tells how large its noise is."""
    found = covariance.correlation
    return found is not None and bool(np.min(found.degrees_of_freedom) <= FEWEST_DEGREES)


def _loaded(
    robot: Description, paths: Sequence[str], left_out: dict[str, str]
) -> tuple[Known, list[tuple[str, Information]]]:
    """Read Informations of a robot; what cannot be used of several goes to `left_out`.

    Where nothing states terms, some may be with rotors and some without: the more of these are used, or of as many
    those with rotors, as logs are reduced.
    """
    _, models = _file_and_models(robot)
    loaded: dict[bool, list[tuple[str, Information]]] = {True: [], False: []}
    for path in paths:
        try:
            part = Information.load(path)
            loaded[part.model_among(models, path) is not models[0]].append((path, part))
        except InputError as error:
            left_out[path] = str(error)
    with_rotors = len(loaded[True]) >= len(loaded[False])
    if not loaded[with_rotors]:
        raise InputError(left_out[paths[-1]])
    known = known_of(robot, with_rotors)
    for path, part in loaded[not with_rotors]:
        try:
            part.model_among([known.model], path)
        except InputError as error:
            left_out[path] = str(error)
    return known, loaded[with_rotors]


def _reduced(
    robot: Description, logs: Sequence[str], left_out: dict[str, str]
) -> tuple[Known, Information, tuple[Information, ...], list[str], list[ReducedLog]]:
    """Reduce logs; the rotors of robots whose terms nobody states belong to the model, as siblings have the same.

    What cannot be used of several logs goes to `left_out`, so that it stops none of the others.
    """
    known = known_of(robot, True)
    each: list[ReducedLog] = []
    found = reduced_logs(known.file, known.model, logs, each, left_out=left_out)
    return known, found.information, found.stretches, [*_told_of(left_out), *found.remarks], each


def _logs_of(paths: Sequence[str], left_out: dict[str, str], passed_over: list[str]) -> list[str]:
    """Return the logs that paths, folders and patterns stand for; to `left_out` goes what stands for none."""
    found: dict[str, str] = {}
    for path in paths:
        try:
            for log in map(str, given_logs([path], None, passed_over)[0]):
                found.setdefault(place_of(log), log)
        except InputError as error:
            left_out[path] = str(error)
    if paths and not found:
        raise InputError(left_out[paths[-1]])
    return list(found.values())


def _told_of(left_out: Mapping[str, str]) -> list[str]:
    return [f"{path} was left out: {reason}" for path, reason in left_out.items()]


def _validation(known: Known, paths: Sequence[str]) -> tuple[list[Information], list[ReducedLog]]:
    """Informations, or logs that are reduced, of what the fit does not see, and these logs one by one."""
    found: list[Information] = []
    each: list[ReducedLog] = []
    for path in paths:
        if is_information(path):
            information = Information.load(path)
        else:
            information = reduced_logs(known.file, known.model, [path], each).information
        information.model_among([known.model], path)
        found.append(information)
    return found, each


def hashed_files(common: None, task: dict[str, Any]) -> bytes:
    """Hash the files of a task."""
    files = [name for key in ("logs", "left_out", "informations", "validate") for name in task[key]]
    return packed([tuple(one) for one in contents_of(files)])


def with_contents(task: dict[str, Any], hashed: bytes) -> dict[str, Any]:
    """Return a task with the contents of its files, which `hashed_files` told, and as which alone they are read."""
    return {**task, "contents": [LogContent(*one) for one in unpacked(hashed)]}


def inputs_of(task: dict[str, Any]) -> list[Any]:
    """Return what the result of a task with contents follows from, as plain data: hashes of files, and the robot."""
    # Remarks name the files, and a log is read by its suffix: one with the same content is another one.
    contents = [[log, *hashes] for log, hashes, _ in task["contents"]]
    return [task["label"], task["intervals"], task["robot"].content, contents, task["passed_over"]]
