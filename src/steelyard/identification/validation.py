"""Validation of a saved estimate: how well it predicts logs that were not used to find it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table, text_table
from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.estimators.marginal_likelihood import body_priors
from steelyard.files import listed, write_json
from steelyard.recording.chunks import CHUNK_ROWS
from steelyard.regression import Estimate, Information
from steelyard.regression.batch_means import BATCH_LENGTHS, BatchMeansTree
from steelyard.robot import RobotFile

from .default_terms import model_of_estimate
from .doubts import mistakes_in_logs
from .given import Data, GivenLog, GivenRobot, given_constraints, given_logs, given_robot
from .log_reader import DRAWN_ROWS, LogReader, LogTask, Progress, ReducedLog, one_by_one
from .mistakes import sentence
from .prediction_verdict import FEWEST_BATCHES, PredictionVerdict, few_rows_of, prediction_verdict
from .saved import matching_estimate
from .saved_result import RECORD, SavedResult

__all__ = ["LogError", "Validation", "read_as_fitted", "validate_estimate"]

Array = NDArray[np.float64]
VALIDATION_FORMAT = "steelyard-validation-1"
FEWEST_ROWS = FEWEST_BATCHES * BATCH_LENGTHS[0]
"""The fewest rows of a joint, all logs together: fewer do not tell noise from errors, and most of them are near the
ends, which filters spoil. A third of a second of a UR5 at 250 Hz, without a mistake, was called poor or wrong."""

FAR_WORSE, HARDLY_WHITE = 4.0, 0.3
"""How many times more of the torque of a joint than in the logs of the fit is left unexplained, and the white part of
it, where that is told though the prediction is good. *Measured*: logs that a robot made with other motions and rates
leave 1.0 to 2.5 times as much in MuJoCo, halves of a TX40's log 0.9 to 1.8, two motions of a Gen3 1.8 to 3.9; friction
or a rotor inertia of 1.5 times the size 9.5 and 4.1, torques that are 20 ms late 5.2 at one joint."""

_POINTS = 1200  # of each log that are kept, to look for mistakes where it is predicted poorly


_RIGID = (
    "The estimate is of a robot with elastic joints, but the robot file has no table [elastic]: links were taken to "
    "move as the motors do; give the robot.toml of the identification."
)


@dataclass(frozen=True, eq=False)
class LogError:
    """The error with which one log is predicted.

    Attributes
    ----------
    name : str
        The log.
    row_count : int
        Rows used: samples times joints, less what was masked.
    relative_error : float
        Over all the joints (thesis eq. 4.37); 0.05 means 5 %.
    joint_relative_error, joint_error : ndarray
        (N,): relative, and the root mean square, N·m or N. Empty where the joints have no errors of their own.
    """

    name: str
    row_count: int
    relative_error: float
    joint_relative_error: Array = field(repr=False)
    joint_error: Array = field(repr=False)


@dataclass(frozen=True, eq=False)
class Validation:
    """The result of :func:`validate_estimate`.

    Attributes
    ----------
    robot_name : str
    estimate : str
        As it was given.
    method : str
        How the estimate was found, in words.
    prediction : PredictionVerdict
        Over all the logs together: the word, and per joint relative error, root mean square, and noise floor.
    logs : tuple of LogError
        Of each log.
    processing : dict
        How the logs were processed.
    remarks : tuple of str
        What the user should know, a sentence each.
    seen : tuple of str
        The logs that were used to make the estimate: their errors are no test of a prediction.
    """

    robot_name: str
    estimate: str
    method: str
    prediction: PredictionVerdict
    logs: tuple[LogError, ...]
    processing: dict[str, Any] = field(repr=False)
    remarks: tuple[str, ...] = field(default=(), repr=False)
    seen: tuple[str, ...] = ()

    def _rows(self) -> list[tuple[str, ...]]:
        return [(log.name, str(log.row_count), f"{100 * log.relative_error:.3g} %") for log in self.logs]

    def __str__(self) -> str:
        told = self.prediction
        if len(self.seen) == len(self.logs):  # in the place of the word, which is one on the fit
            none = f"No log was predicted: {listed(self.seen)} made this estimate; give one that it has not seen."
            told = replace(told, sentences=(none,))
        parts = [str(told)]
        if len(self.logs) > 1:
            parts.append(text_table(("log", "rows", "error"), self._rows(), numbers=(1, 2)))
        parts.extend(f"Note: {remark}" for remark in self.remarks)
        return "\n".join(parts)

    def _repr_html_(self) -> str:
        each = html_table("", ("log", "rows", "error"), self._rows(), self.remarks)
        return self.prediction._repr_html_() + each

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data: dictionaries, lists, texts and numbers."""
        return {
            "format": VALIDATION_FORMAT,
            "robot": self.robot_name,
            "estimate": self.estimate,
            "method": self.method,
            "prediction": self.prediction.to_dict(),
            "logs": self.logs,
            "processing": self.processing,
            "remarks": self.remarks,
            "seen": self.seen,
        }

    def save(self, path: str | Path) -> None:
        """Write it as JSON, numbers that are not known as null; the file appears whole or not at all."""
        write_json(self.to_dict(), path)


@in_one_thread
def validate_estimate(
    robot: GivenRobot,
    estimate: str | Path,
    logs: Data,
    *,
    chunk_rows: int = CHUNK_ROWS,
    progress: Progress | None = None,
) -> Validation:
    """Tell how well a saved estimate predicts logs, without fitting anything.

    The logs are processed as those of the fit were, as the ``run.json`` beside the estimate tells, with what the data
    decided then; where there is none, as the robot file says. The word follows the rules of `PredictionVerdict`, with
    the errors on the data of the fit from the estimate. Where it is poor or wrong, the remarks tell what may be wrong
    with a log, or what the robot carries.

    Parameters
    ----------
    robot : str, Path, RobotFile, Robot or Model
        URDF or robot.toml, which also says what the columns of the logs are; or what is in memory.
    estimate : str or Path
        A folder that ``steelyard identify`` wrote, or what :meth:`steelyard.Estimate.save` wrote.
    logs : path, Recording, Samples, data frame, mapping of arrays, or sequence of these
        As :func:`steelyard.identify` takes them.
    chunk_rows : int
        Rows of a log that stand in memory together.
    progress : callable, optional
        Called with a few words before each step.

    Raises
    ------
    InputError
        If a file cannot be used, or the estimate belongs to another robot.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np, steelyard as sy
    >>> robot = 'terms = []\\n[description]\\nrows = [["pi/2", 0, 0, "q"]]\\n[processing]\\ncutoff = "none"\\n'
    >>> t = np.arange(0.0, 10.0, 0.01)
    >>> q, dq, ddq = np.sin(t)[:, None], np.cos(t)[:, None], -np.sin(t)[:, None]
    >>> with tempfile.TemporaryDirectory() as name:
    ...     folder = Path(name)
    ...     _ = (folder / "robot.toml").write_text(robot)
    ...     model = sy.Model.load(folder / "robot.toml")
    ...     torque = model.inverse_dynamics(q, dq, ddq, [1, 0, 0, 1, 0, 1, 0.5, 0, 0, 2])
    ...     _ = sy.Recording(t=t, q=q, torque=torque).save(folder / "log.csv")
    ...     info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    ...     _ = sy.least_squares(info).save(folder / "estimate.json")
    ...     found = validate_estimate(folder / "robot.toml", folder / "estimate.json", [folder / "log.csv"])
    >>> found.prediction.word
    'good'
    """
    passed_over: list[str] = []
    given, _ = given_logs(logs, None, passed_over)
    if not given:
        raise InputError(
            "At least one log is needed to validate an estimate; give the path of one, such as a CSV or a bag."
        )
    result = SavedResult.load(estimate)
    file, model = given_robot(robot)
    model = model_of_estimate(result.estimate, file, model)
    loaded = matching_estimate(model, result.path)
    read = read_as_fitted(file, model, result, given, chunk_rows, progress)
    remarks = [*passed_over, *read.remarks]
    longest = max(factor.count for factor in read.information.factors)
    if longest < FEWEST_ROWS:
        raise InputError(
            f"{', '.join(map(str, given))}: {longest} rows of a joint are left, too few to judge a prediction, since "
            f"filters spoil the ends; give logs of {FEWEST_ROWS} rows or more."
        )
    verdict = prediction_verdict(
        read.information,
        loaded.base,
        validation=[log.information for log in read.logs],
        fit_error=loaded.relative_error,
        joint_fit_error=loaded.joint_relative_error,
        units=model.robot.torque_units,
        few_rows=[
            few
            for log in read.logs
            for few in few_rows_of(log.name, log.role, log.information, model, loaded.base, log.drawn)
        ],
    )
    each = []
    for log in read.logs:
        rows, none = log.information, np.zeros(0)
        each.append(
            LogError(
                log.name,
                rows.count,
                rows.relative_error(loaded.base),
                rows.joint_relative_error(loaded.base) if rows.has_joint_errors else none,
                rows.joint_rms_error(loaded.base) if rows.has_joint_errors else none,
            )
        )
    if verdict.is_usable:
        remarks.extend(_worse_joints(verdict, loaded))
    if verdict.word in ("poor", "wrong"):
        priors = body_priors(model, given_constraints(file))
        errors = {log.name: float(np.max(log.joint_relative_error, initial=log.relative_error)) for log in each}
        say = progress or (lambda _: None)
        by_name, samples = {str(log): log for log in given}, {log.name: log.samples for log in read.logs}
        mistakes = mistakes_in_logs(read.reader, file, priors, by_name, samples, errors, say)
        remarks.extend(f"{name}: {sentence(found)}" for name, found in mistakes.items())
    return Validation(
        model.robot.name,
        str(estimate),
        loaded.method,
        verdict,
        tuple(each),
        read.reader.processing.to_dict(),
        tuple(dict.fromkeys(remarks)),
        read.seen,
    )


def _worse_joints(verdict: PredictionVerdict, estimate: Estimate) -> list[str]:
    """Say of which joints far more is left unexplained than in the logs of the fit."""
    if estimate.weights is None:  # the reciprocals of what was left
        return []
    times = verdict.joint_error * estimate.weights
    far = np.flatnonzero((times > FAR_WORSE) & (verdict.whiteness < HARDLY_WHITE))
    if not len(far):
        return []
    names, units = verdict.joint_names, verdict.units
    told = [
        f"{verdict.joint_error[k]:.3g} {units[k]} at {names[k]} ({times[k]:.2g} times)"
        for k in far[np.argsort(-times[far])]
    ]
    return [
        f"Far more is left unexplained than in the logs of the fit: {listed(told)}. These logs ask for what the others "
        "did not show, or friction, drive or load has changed since: identify them, and steelyard compare tells what "
        "differs."
    ]


@dataclass(frozen=True, eq=False)
class FittedLogs:
    """Logs that were processed as those of a saved estimate were.

    Attributes
    ----------
    reader : LogReader
        That read them.
    logs : tuple of ReducedLog
        Without their batch means.
    information : Information
        Of all of them together, with the batch means of all.
    remarks : tuple of str
        On the logs, and on how they were processed.
    seen : tuple of str
        Those that were used to make the estimate.
    """

    reader: LogReader
    logs: tuple[ReducedLog, ...]
    information: Information
    remarks: tuple[str, ...]
    seen: tuple[str, ...]


def read_as_fitted(
    file: RobotFile,
    model: Model,
    result: SavedResult,
    logs: Sequence[GivenLog],
    chunk_rows: int = CHUNK_ROWS,
    progress: Progress | None = None,
) -> FittedLogs:
    """Reduce logs, processed as those of a saved estimate were."""
    say = progress or (lambda _: None)
    reader = LogReader(file, model, chunk_rows)
    reader.require_torques()
    remarks = []
    used = result.processing
    if used is None:
        remarks.append(
            f"No {RECORD} stands beside {result.path}, so that the logs were processed as {file.path} says; with other "
            "filters than those of the fit, errors differ."
        )
    else:
        reader.stated = reader.processing = used
        reader.decided = result.decided
    seen = tuple(str(log) for log in logs if result.has_seen(log))
    remarks += [f"{log}: was used to make {result.name}, so that its error is no test of a prediction." for log in seen]
    if result.estimate.elastic_model.get("link_motion"):
        if file.section("elastic"):
            from .elastic.elastic_joints import links_of_logs  # loaded for elastic joints alone

            logs, told = links_of_logs(file, model, result.estimate, logs, used)
            remarks += [told] if told else []
        else:
            remarks.append(_RIGID)
    reader.decide(logs, say)
    reduced, means = [], BatchMeansTree()
    for (one,), _ in one_by_one(
        reader, [LogTask(log, _POINTS, DRAWN_ROWS, len(logs), False) for log in logs], model, say
    ):
        reader.note(one)
        if one.information.count == 0:
            reason = (
                f"{one.name}: no rows are left after processing, so that nothing can be predicted; give a longer log, "
                "trim less or lower velocity_threshold."
            )
            if len(logs) == 1:
                raise InputError(reason)
            reader.unusable.note(one.name, reason, say)
            continue
        means.add(one.information.batch_means)
        reduced.append(replace(one, information=replace(one.information, batch_means=())))
    reader.unusable.refuse(logs)
    information = Information.total([one.information for one in reduced])
    information = replace(information, batch_means=means.total())
    return FittedLogs(reader, tuple(reduced), information, (*remarks, *reader.remarks), seen)
