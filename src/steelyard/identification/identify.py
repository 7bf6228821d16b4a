"""The main job: from a robot and its logs to a physically feasible model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.estimators.estimator import Estimator, estimate_with, find_estimator
from steelyard.feasibility import FeasibleSet, check
from steelyard.feasibility.constraints import constraints_from_dict
from steelyard.recording import (
    CutoffChoice,
    LogColumns,
    Processing,
    Recording,
    Samples,
    chunks,
    decide,
    process_chunks,
    read_middle,
)
from steelyard.recording.automatic import DECISION_ROWS
from steelyard.recording.diagnosis import DETECTORS, faulty_rows
from steelyard.recording.survey import LogSurvey
from steelyard.regression import Estimate, Information, least_squares
from steelyard.regression.batch_means import BatchSums
from steelyard.regression.reduction import empty_factors
from steelyard.robot import RobotFile

from .log_checks import implausible_mass, swapped_positions, swapped_torques
from .result import Identification, Prediction, Trace

__all__ = ["LogReader", "identify"]

Array = NDArray[np.float64]
_TRACE_POINTS = 1200  # points of the curves of a log: about as many as a figure of the report has pixels
_READING_LINES = 20  # lines of progress while logs are read
_ALL_POINTS = 24_000  # of all the logs of a role together, so that thousands of them do not fill the memory
_DECIDING_LOGS, _DECIDING_ROWS, _FEWEST_ROWS = 12, 200_000, 10_000
"""Logs and rows, of all logs together and of each, by which the processing of all is decided: they stand in memory."""
Progress = Callable[[str], None]


@in_one_thread
def identify(
    robot: str | Path | RobotFile,
    logs: Sequence[str | Path],
    *,
    validate: Sequence[str | Path] = (),
    weights: Literal["joint"] | None = "joint",
    consistency: Literal["full", "inertia"] = "full",
    prefer: Literal["auto", "lightest", "cad"] | None = "auto",
    residual_slack: float = 5e-4,
    estimator: str | Estimator = "fit",
    chunk_rows: int = 200_000,
    progress: Progress | None = None,
) -> Identification:
    """Identify the dynamic parameters of a robot from its logs.

    The logs are processed chunk by chunk and reduced to an Information, from which the unconstrained estimate, its
    verdict and the feasible estimate come without the data.

    Parameters
    ----------
    robot : str, Path or RobotFile
        A URDF, or a robot.toml with terms, log columns, processing and constraints.
    logs : sequence of path
        Each is one recording; files recorded side by side are joined by ``+``.
    validate : sequence of path
        Logs on which both estimates are tried without refitting.
    weights : {"joint", None}
        See :func:`steelyard.least_squares`.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.
    prefer : {"auto", "lightest", "cad", None}
        See :func:`steelyard.fit`; ``"auto"`` is ``"cad"`` where the description has a mass for every link, otherwise
        ``"lightest"``.
    residual_slack : float
        See :func:`steelyard.fit`.
    estimator : str or callable
        What estimates the parameters: :func:`steelyard.fit`, an estimator that another package adds, by its name, or a
        function ``estimator(info, feasible_set, **options)``. The options are `weights`, `prefer` and `residual_slack`.
    chunk_rows : int
        Rows of a log that stand in memory together.
    progress : callable, optional
        Called with a few words before each step.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If the robot, a log or an option cannot be used; the message says why and what to do.
    """
    say = progress or (lambda _: None)
    if not logs:
        raise InputError("At least one log is needed to identify a robot; give the path of a CSV, Parquet or NPZ file.")
    find_estimator(estimator)  # which is refused before logs are read
    file = RobotFile.load(robot)
    model = Model.from_file(file)
    reader = LogReader(file, model, chunk_rows)
    if reader.columns.finds_gains:
        raise InputError(
            f"{file.path}, [log]: drive gains are to be found, and currents alone tell no torques; find them with "
            "`steelyard payload ROBOT UNLOADED LOADED` and a payload of known mass, and write them as `gain`."
        )
    constraints = constraints_from_dict(
        file.section("constraints"), folder=file.path.parent, allow_extensions=file.allow_extensions
    )
    feasible_set = FeasibleSet(model, consistency, list(constraints))

    say(f"{model.robot.name}: {model.dof} joints, {model.base_parameters().count} base parameters")
    reader.decide(logs, say)
    parts: list[tuple[str, str, Information, _Thinned]] = []
    sums = BatchSums(empty_factors(model))
    for role, group in (("identification", logs), ("validation", validate)):
        for number, log in enumerate(group):
            # One line for each of thousands of logs would push everything else off the screen.
            if number % max(len(group) // _READING_LINES, 1) == 0:
                say(f"reading {log}{f' ({number + 1} of {len(group)})' if len(group) > 1 else ''}")
            points = _TRACE_POINTS if number == 0 else min(max(_ALL_POINTS // len(group), 100), _TRACE_POINTS)
            parts.append((str(log), role, *reader.reduce(log, points, sums if group is logs else None)))
    information = _total([p[2] for p in parts if p[1] == "identification"])
    information = replace(information, batch_means=sums.factors())
    _require_excitation(information, model)

    say("least squares")
    unconstrained = least_squares(information, weights)
    say("is it physically possible?")
    verdict = check(feasible_set, base=unconstrained.base)
    if prefer == "auto":
        prefer = "cad" if _has_cad(model) else "lightest"
    say("feasible fit")
    options = {"weights": weights, "prefer": prefer, "residual_slack": residual_slack}
    estimate = estimate_with(estimator, information, feasible_set, **options)
    estimate = replace(estimate, description=reader.description)
    predictions = tuple(_predict(model, unconstrained, estimate, *part) for part in parts)
    remarks = dict.fromkeys(reader.remarks)
    for log, _, _, thinned in parts:
        samples = thinned.samples
        found = swapped_torques(model, samples) or swapped_positions(model, samples)
        remarks.update(dict.fromkeys(f"{log}: {sentence}" for sentence in found))
    remarks.update(dict.fromkeys(_dear(unconstrained, estimate)))
    if not reader.units_are_suspect:
        remarks.update(dict.fromkeys(implausible_mass(model, estimate, parts[0][3].samples)))
    return Identification(
        model=model,
        information=information,
        feasible_set=feasible_set,
        unconstrained=unconstrained,
        verdict=verdict,
        estimate=estimate,
        predictions=predictions,
        weak=unconstrained.weak,
        remarks=tuple(remarks),
        robot_file=file.path,
        logs=tuple(map(str, logs)),
        validation_logs=tuple(map(str, validate)),
        options={
            "weights": weights,
            "consistency": consistency,
            "prefer": prefer,
            "residual_slack": residual_slack,
            "estimator": estimator if isinstance(estimator, str) else getattr(estimator, "__name__", repr(estimator)),
            "margin": feasible_set.margin,
            "chunk_rows": chunk_rows,
            "log": reader.columns.to_dict(),
            "processing": reader.stated.to_dict(),
            "decided": reader.decided,
            "constraints": file.section("constraints"),
        },
        cutoff_choices=tuple(reader.cutoff_choices),
    )


class LogReader:
    """Reads logs as the robot file says, and collects the remarks on them."""

    def __init__(self, file: RobotFile, model: Model, chunk_rows: int) -> None:
        self.model = model
        self.chunk_rows = chunk_rows
        self.columns = LogColumns.from_dict(file.section("log"), f"{file.path}, [log]")
        self.stated = Processing.from_dict(file.section("processing"), f"{file.path}, [processing]")
        self.processing = self.stated
        self.decided: dict[str, object] = {}
        self.remarks: list[str] = []
        self.units_are_suspect = False
        self.cutoff_choices: list[tuple[str, CutoffChoice]] = []
        self.description = dict(file.description)

    def decide(self, logs: Sequence[str | Path], say: Progress) -> None:
        """Decide what [processing] leaves to the data, once for all logs, so that all have the same filter."""
        if not self.stated.is_open:
            return
        count = min(len(logs), _DECIDING_LOGS)
        chosen = [logs[int(i)] for i in np.linspace(0, len(logs) - 1, count).round()]
        rows = min(DECISION_ROWS, max(_FEWEST_ROWS, _DECIDING_ROWS // count))
        say(f"choosing the filter by {count} log{'s' * (count > 1)}")
        recordings = [
            read_middle(log, self.columns, self.stated, rows, list(self.model.robot.joint_names)) for log in chosen
        ]
        # No model has currents that each drive turns into torques in its own way.
        decision = decide(self.stated, recordings, None if self.columns.finds_gains else self.model)
        self.processing = decision.processing
        names = [name for name in ("cutoff", "velocity_threshold") if getattr(self.stated, name) == "auto"]
        self.decided = {name: getattr(decision.processing, name) for name in names}
        others = f" ({count} of {len(logs)} logs were looked at.)" if count < len(logs) else ""
        self.remarks.extend(f"{remark}{others}" for remark in decision.remarks)
        if decision.cutoff_choice is not None:
            self.cutoff_choices.append(("all logs", decision.cutoff_choice))

    def reduce(self, log: str | Path, points: int, sums: BatchSums | None) -> tuple[Information, _Thinned]:
        """Reduce one log, and keep a copy of its samples, thinned to so many or twice as many points.

        The sums of blocks are kept for all the logs together: they are nine tenths of an Information.
        """
        thinned = _Thinned(points)
        information = Information.from_chunks(self.model, self._watched(log, thinned), batch_means=False, sums=sums)
        thinned.finish()
        return information, thinned

    def _watched(self, log: str | Path, thinned: _Thinned) -> Iterator[Samples]:
        survey = LogSurvey()
        for samples in self._samples(log, survey):
            self.remarks.extend(f"{log}: {remark}" for remark in samples.remarks)
            thinned.add(samples)
            yield samples
        self.remarks.extend(f"{log}: {remark}" for remark in self._against_robot(survey))
        self.units_are_suspect |= bool(survey.unit_remarks())

    def _against_robot(self, survey: LogSurvey) -> tuple[str, ...]:
        """Compare a log with what the joints can do."""
        robot = self.model.robot
        driving = [robot.joints[i] for i in robot.driving_joints]
        limits = [[getattr(joint, key) for joint in driving] for key in ("lower", "upper", "velocity_limit")]
        return survey.limit_remarks(*limits)

    def _samples(self, log: str | Path, survey: LogSurvey) -> Iterator[Samples]:
        joints = list(self.model.robot.joint_names)

        def look(recording: Recording) -> None:
            handled = [option for option in DETECTORS if getattr(self.processing, option) is not False]
            part = f" (Seen in the first {recording.count} rows.)" if recording.count == chunks.CHOICE_ROWS else ""
            self.remarks.extend(f"{log}: {sentence}{part}" for sentence in faulty_rows(recording, handled))
            self._against_robot(LogSurvey.of(recording))  # what is sure to be wrong is refused at once

        if self.processing.needs_whole_log:
            recording = Recording.read(log, self.columns, joints)
            look(recording)
            survey.add(recording)
            yield recording.process(self.processing, self.model)
        else:
            yield from process_chunks(
                log, self.columns, self.processing, self.chunk_rows, joints, self.model, look, survey
            )


class _Thinned:
    """Every k-th sample of a stream, with k doubling as the stream grows."""

    def __init__(self, points: int) -> None:
        self.points = points
        self.every, self.seen = 1, 0
        self.parts: list[tuple[Array, ...]] = []

    def add(self, samples: Samples) -> None:
        count = samples.count
        start = -self.seen % self.every
        rows = slice(start, count, self.every)
        t = np.arange(self.seen, self.seen + count, dtype=float) if samples.t is None else samples.t
        part = (t[rows], samples.q[rows], samples.dq[rows], samples.ddq[rows], samples.torque[rows])
        self.parts.append(tuple(a.copy() for a in part))
        self.seen += count
        while sum(len(p[0]) for p in self.parts) > 2 * self.points:
            whole = tuple(np.concatenate(columns)[::2] for columns in zip(*self.parts, strict=True))
            self.parts = [whole]
            self.every *= 2

    def finish(self) -> None:
        """Let go of the longer arrays, of which these are views."""
        self.parts = [tuple(array.copy() for array in part) for part in self.parts]

    @property
    def t(self) -> Array:
        return np.concatenate([p[0] for p in self.parts])

    @property
    def samples(self) -> Samples:
        q, dq, ddq, torque = (np.concatenate([p[i] for p in self.parts]) for i in range(1, 5))
        return Samples(q=q, dq=dq, ddq=ddq, torque=torque)


def _total(parts: list[Information]) -> Information:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def _require_excitation(information: Information, model: Model) -> None:
    rows = information.count
    if rows <= information.base_count:
        raise InputError(
            f"The logs leave {rows} rows for {information.base_count} base parameters of {model.robot.name}; "
            "record a longer motion, trim less or lower velocity_threshold."
        )


def _has_cad(model: Model) -> bool:
    parameters = np.asarray(model.robot.parameters)
    return all(parameters[columns[9]] > 0.0 for columns in model.link_columns)


def _dear(unconstrained: Estimate, estimate: Estimate) -> tuple[str, ...]:
    """Warn where the feasible fit explains the data far worse than plain least squares."""
    before, after = unconstrained.relative_error, estimate.relative_error
    if after < 2.0 * before or after < 0.05:
        return ()
    return (
        f"No possible robot explains these torques well ({after:.0%} error, plain least squares {before:.0%}): "
        "check the signs, units and order of the columns, the direction of gravity, and the constraints.",
    )


def _predict(
    model: Model,
    unconstrained: Estimate,
    estimate: Estimate,
    name: str,
    role: str,
    information: Information,
    thinned: _Thinned,
) -> Prediction:
    samples = thinned.samples
    motion = (samples.q, samples.dq, samples.ddq)
    pick = model.base_parameters().Pb  # parameters Pb beta move the robot as beta does
    trace = Trace(
        thinned.t,
        samples.torque,
        model.inverse_dynamics(*motion, pick @ unconstrained.base),
        model.inverse_dynamics(*motion, pick @ estimate.base),
    )
    return Prediction(
        name=name,
        role=role,
        row_count=information.count,
        unconstrained_error=information.relative_error(unconstrained.base),
        feasible_error=information.relative_error(estimate.base),
        joint_unconstrained_error=information.joint_relative_error(unconstrained.base),
        joint_feasible_error=information.joint_relative_error(estimate.base),
        trace=trace,
    )
