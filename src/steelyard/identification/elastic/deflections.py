"""Deflections of elastic joints in any recording, from what was identified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table, text_table
from steelyard.errors import InputError
from steelyard.estimators.joint_stiffness import JointStiffness
from steelyard.files import write_json
from steelyard.recording import Processing
from steelyard.recording.formats.registry import write_log
from steelyard.regression import Estimate

from ..default_terms import model_of_estimate
from ..given import Data, GivenRobot, given_logs, given_robot
from ..log_reader import Progress
from ..result import Identification
from ..saved_result import SavedResult
from .second_encoders import TwoEncoders, at_later, own_section, read_two_encoders
from .transmission_torques import Transmissions, unseen_motions

__all__ = ["Deflections", "LogDeflections", "predict_deflections"]

Array = NDArray[np.float64]
PREDICTION_FORMAT = "steelyard-deflections-1"


@dataclass(frozen=True, eq=False)
class LogDeflections:
    """Predicted deflections of the elastic joints in one log, and the measured ones where it has second encoders.

    Attributes
    ----------
    name : str
        Of the log.
    joint_names : tuple of str
        The J elastic joints.
    t : ndarray
        (S,) s.
    torque : ndarray
        (S, J) what the transmissions carry, by the model of the links, N·m or N.
    predicted : ndarray
        (S, J) motor position less link position, rad or m.
    standard_error : ndarray
        (S, J) of the predicted ones, from that of the compliance.
    measured : ndarray or None
        (S, J) the same as measured, less zero, delay and errors of the second encoders, which are those of this log.
    delay : ndarray or None
        (J,) of the second encoders in this log, s.
    """

    name: str
    joint_names: tuple[str, ...]
    t: Array
    torque: Array
    predicted: Array
    standard_error: Array
    measured: Array | None = None
    delay: Array | None = None

    def numbers(self) -> list[dict[str, float | str]]:
        """Return for each joint, in SI units: RMS and peak of the deflection, and what of the measured is unexplained.

        RMS values are about the mean. The delay is that of the second encoder in this log.
        """
        found: list[dict[str, float | str]] = []
        for j, name in enumerate(self.joint_names):
            predicted = self.predicted[:, j] - self.predicted[:, j].mean()
            row: dict[str, float | str] = {
                "joint": name,
                "RMS torque": float(np.std(self.torque[:, j])),
                "RMS predicted": float(np.std(predicted)),
                "standard error": float(np.std(self.standard_error[:, j])),
                "peak": float(np.abs(self.predicted[:, j]).max()),
            }
            if self.measured is not None and self.delay is not None:
                measured = self.measured[:, j] - self.measured[:, j].mean()
                row["RMS measured"] = float(np.std(measured))
                row["unexplained"] = float(np.std(measured - predicted))
                row["delay"] = float(self.delay[j])
            found.append(row)
        return found

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Heads and rows of `numbers`."""
        found = self.numbers()
        rows = [tuple(one if isinstance(one, str) else f"{one:.3e}" for one in row.values()) for row in found]
        return tuple(found[0]), rows

    def __str__(self) -> str:
        heads, rows = self.table()
        return f"{self.name}\n{text_table(heads, rows, numbers=tuple(range(1, len(heads))))}"

    def _repr_html_(self) -> str:
        return html_table(f"Deflections, {self.name}", *self.table())

    def save_samples(self, path: str | Path) -> Path:
        """Write time, torque and deflections of every row as a log: .csv, .npz or .parquet.

        Raises
        ------
        InputError
            For another suffix.
        """
        columns = {"t": self.t}
        groups = {"torque": self.torque, "deflection": self.predicted, "measured": self.measured}
        for what, values in groups.items():
            if values is not None:
                columns |= {f"{what}_{name}": values[:, j] for j, name in enumerate(self.joint_names)}
        return write_log(Path(path), columns)

    def to_dict(self) -> dict[str, Any]:
        """Return the table as plain data, in rad (m) and s, without the samples."""
        return {"log": self.name, "joints": self.numbers()}


@dataclass(frozen=True, eq=False)
class Deflections:
    """Predicted deflections of several logs: what :func:`predict_deflections` returns.

    Attributes
    ----------
    robot_name : str
    logs : tuple of LogDeflections
    """

    robot_name: str
    logs: tuple[LogDeflections, ...]

    def __str__(self) -> str:
        names = ", ".join(self.logs[0].joint_names)
        return "\n".join([f"{self.robot_name}: deflections of {names}, in rad or m.", *map(str, self.logs)])

    def _repr_html_(self) -> str:
        return "".join(one._repr_html_() for one in self.logs)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data: dictionaries, lists, texts and numbers."""
        return {
            "format": PREDICTION_FORMAT,
            "robot": self.robot_name,
            "logs": [one.to_dict() for one in self.logs],
        }

    def save(self, path: str | Path) -> None:
        """Write it as JSON; the file appears whole or not at all."""
        write_json(self.to_dict(), path)


def predict_deflections(
    robot: GivenRobot, estimate: str | Path | Identification, logs: Data, *, progress: Progress | None = None
) -> Deflections:
    """Predict the deflections of elastic joints in any recording, from what was identified.

    Parameters
    ----------
    robot : str, Path or RobotFile
        A robot.toml with a section ``[elastic]``.
    estimate : str, Path or Identification
        A folder that ``steelyard identify`` wrote for it, its estimate.json, or the result itself.
    logs : path, Recording, data frame, mapping of arrays, or sequence of these
        They need no second encoders; where they have them, the measured deflections are told beside the predicted.
    progress : callable, optional
        Called with a few words before each step.

    Raises
    ------
    InputError
        If the estimate has no elastic joints, or a file cannot be used.

    Examples
    --------
    A pendulum whose motor follows a motion, while its link hangs behind a spring of 700 N·m/rad:

    >>> import tempfile
    >>> import numpy as np, steelyard as sy
    >>> text = (
    ...     'terms = []\\n[description]\\nrows = [[0, 0.3, 0, "q"]]\\ngravity = [0, -9.81, 0]\\n[processing]\\n'
    ...     'cutoff = "none"\\n[elastic]\\njoints = [1]\\nposition = "link{}"\\n'
    ... )
    >>> t = np.arange(0.0, 20.0, 0.01)
    >>> q = 0.8 * np.sin(3 * t) + np.sin(1.1 * t)
    >>> tau = 0.6 * (-7.2 * np.sin(3 * t) - 1.21 * np.sin(1.1 * t)) + 5.0 * np.cos(q)
    >>> noise = 1e-5 * np.random.default_rng(0).normal(size=t.size)
    >>> log = {"t": t, "q1": q + tau / 700.0, "tau1": tau, "link1": q + noise}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "robot.toml"
    ...     _ = path.write_text(text)
    ...     result = sy.identify(path, log)
    ...     found = predict_deflections(path, result, log)
    >>> round(result.elastic_joints[0].stiffness, -1)
    700.0
    >>> bool(found.logs[0].numbers()[0]["unexplained"] < 3e-5)
    True
    """
    say = progress or (lambda _: None)
    given, _ = given_logs(logs, None)
    if not given:
        raise InputError("At least one log is needed to predict deflections; give the path of one, such as a CSV.")
    file, model = given_robot(robot)
    settings, where = own_section(file)
    if isinstance(estimate, Identification):
        decided: Any = estimate.options["decided"]
        name, saved = "The result", estimate.estimate
        processing: Processing | None = Processing.from_dict({**file.section("processing"), **decided})
    else:
        loaded = SavedResult.load(estimate)
        name, saved, processing = str(loaded.path), loaded.estimate, loaded.processing
    joints = _elastic_joints_of(saved, name)
    model = model_of_estimate(saved, file, model)
    if saved.parameters is None or tuple(model.parameter_names) != saved.parameter_names:
        raise InputError(f"{name}: does not belong to {file.path}; identify the robot anew.")
    places = settings.indices(list(model.robot.joint_names), where)
    if [joint.joint for joint in joints] != [model.robot.joint_names[place] for place in places]:
        raise InputError(f"{name}: has other elastic joints than {where}; identify the robot anew.")
    transmissions = Transmissions(model, np.asarray(saved.parameters))
    found = []
    for log in given:
        say(f"reading {log}")
        one = read_two_encoders(log, file, model, processing, needs_second=False)
        found.append(_deflections(transmissions, joints, one))
    return Deflections(model.robot.name, tuple(found))


def _elastic_joints_of(estimate: Estimate, where: str) -> tuple[JointStiffness, ...]:
    """The elastic joints of a saved estimate; an estimate that has none is refused."""
    if not estimate.elastic_joints:
        raise InputError(
            f"{where}: has no elastic joints; identify the robot with a section [elastic] in its robot.toml."
        )
    return tuple(JointStiffness.from_dict(one, where) for one in estimate.elastic_joints)


def _deflections(transmissions: Transmissions, joints: Sequence[JointStiffness], one: TwoEncoders) -> LogDeflections:
    """Predict the deflections of a log from its motion, and compare them with what its second encoders say."""
    t = one.t
    q, dq, ddq = unseen_motions(one, joints, transmissions)[0]
    torque = transmissions.torques(q, dq, ddq)[:, list(one.places)]
    for j, (place, joint) in enumerate(zip(one.places, joints, strict=True)):
        torque[:, j] -= transmissions.missing_rotor(place, joint) * ddq[:, place]
    rates = np.gradient(torque, t, axis=0)
    predicted = np.column_stack([joint.deflections(torque[:, j], rates[:, j]) for j, joint in enumerate(joints)])
    error = np.column_stack([torque[:, j] * joint.compliance_standard_error for j, joint in enumerate(joints)])
    measured = delays = None
    if one.second is not None:
        measured, delays = _measured(one, joints, predicted)
    names = tuple(joint.joint for joint in joints)
    return LogDeflections(one.name, names, t, torque, predicted, error, measured, delays)


def _measured(one: TwoEncoders, joints: Sequence[JointStiffness], predicted: Array) -> tuple[Array, Array]:
    """The measured deflections without zero and delay, those of this log, and without the encoder errors of the fit."""
    assert one.second is not None
    sign, measured, delays = one.settings.sign, np.zeros_like(predicted), np.zeros(len(joints))
    for j, (place, joint) in enumerate(zip(one.places, joints, strict=True)):
        first, velocity = one.first.q[:, place], sign * one.second.dq[:, place]
        later = at_later(one.t, one.second.q[:, place], joint.delay)
        shown_one = sign * (first - later) - joint.encoder_error(first, velocity)
        columns = np.column_stack([np.ones_like(velocity), velocity])
        zero, left = np.linalg.lstsq(columns, shown_one - predicted[:, j], rcond=None)[0]
        measured[:, j] = shown_one - zero - left * velocity
        delays[j] = joint.delay + left
    return measured, delays
