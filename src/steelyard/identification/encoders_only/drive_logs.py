"""Logs of commands and positions: what is read of them, where they are parted, and which show no drive."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import few_digits
from steelyard.errors import InputError
from steelyard.recording import LogColumns, Recording, Samples
from steelyard.recording.columns import POSITION_UNITS
from steelyard.recording.diagnosis.detectors import noise_deviation
from steelyard.recording.formats import LogFiles
from steelyard.recording.survey import LogSurvey
from steelyard.robot import Robot, RobotFile

from ..given import UnusableLogs, given_logs
from ..log_reader import against_limits
from .drive_settings import DriveSettings
from .shooting import PositionLog

__all__ = ["read_drive_logs", "refuse_still", "rms_of_joints"]

Array = NDArray[np.float64]

LONGEST_GAP = 0.1
"""s, between rows that still belong to one motion; at longer gaps a log is parted."""

LEAST_ROWS = 10
"""The fewest rows in a stretch of the motion without gaps."""

STILL = 2e-3
"""rad or m that a joint must move at least, beyond what the noise of its encoder spreads over."""

NOISE_SPREAD = 8.0
"""Standard deviations from the lowest to the highest of thousands of rows of white noise."""

SAME = 1e-6
"""rms of commands less positions, relative to the joint's travel, from which on they are one and the same signal."""


def read_drive_logs(
    file: RobotFile, settings: DriveSettings, logs: Any, validate: Any
) -> tuple[list[PositionLog], list[PositionLog], list[str]]:
    """Read the logs of an identification and those of its validation, and part them where their times have gaps.

    Also returned are remarks on positions that look to be in another unit, or of motors.

    Parameters
    ----------
    logs, validate : path, mapping of arrays, or a sequence of them

    Raises
    ------
    InputError
        Where a column is missing, a log is too short, its commands are the positions themselves, or its positions are
        surely in degrees; of several logs all are told.
    """
    _refuse_samples(logs)
    _refuse_samples(validate)
    remarks: dict[str, None] = {}  # in order, each once
    parts: tuple[list[PositionLog], list[PositionLog]] = ([], [])
    fitted, held_out = given_logs(logs, validate)
    unusable, every = UnusableLogs(), (*fitted, *held_out)
    for given, found in zip((fitted, held_out), parts, strict=True):
        for number, log in enumerate(given):
            with unusable.noting(log, len(every)):
                found += _read(file, settings, log, number, remarks)
    unusable.refuse(every)
    return *_each_once(*parts, remarks), list(remarks)


def _each_once(
    fitted: Sequence[PositionLog], held_out: Sequence[PositionLog], remarks: dict[str, None]
) -> tuple[list[PositionLog], list[PositionLog]]:
    """Leave out logs that hold the very rows of one before them, and add to `remarks` that they do."""
    kept: tuple[list[PositionLog], list[PositionLog]] = ([], [])
    first: dict[tuple[bytes, bytes], tuple[str, bool]] = {}
    for log, is_fitted in [*((log, True) for log in fitted), *((log, False) for log in held_out)]:
        rows = (log.q.tobytes(), log.command.tobytes())
        if rows not in first:
            first[rows] = log.name, is_fitted
            kept[0 if is_fitted else 1].append(log)
            continue
        other, was_fitted = first[rows]
        harm = "given twice" if is_fitted == was_fitted else "used in the fit, so that its error tests no prediction"
        remarks[f"{log.name}: the rows of {other} were {harm}; this log is left out."] = None
    return kept


def refuse_still(robot: Robot, logs: Sequence[PositionLog]) -> None:
    """Refuse a joint that stands still in all logs; it may in one of them.

    Raises
    ------
    InputError
        If one does.
    """
    travel = np.max([np.ptp(log.q, axis=0) - NOISE_SPREAD * noise_deviation(log.q) for log in logs], axis=0)
    for k, joint in enumerate(robot.joint_names):
        if travel[k] < STILL:
            names = ", ".join(dict.fromkeys(log.name for log in logs))
            raise InputError(
                f'{names}: joint "{joint}" stands still (it moves by {max(travel[k], 0.0):.2g}), so that nothing shows '
                "its drive; lock it in [description], or record a motion of it."
            )


def rms_of_joints(parts: Sequence[Array]) -> Array:
    """Return the root of the mean square (N,) over the rows of several logs, each (S, N)."""
    return np.asarray(np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0)))


def _refuse_samples(logs: Any) -> None:
    listed = logs if isinstance(logs, list | tuple) else [logs]
    other = next((one for one in listed if isinstance(one, Recording | Samples)), None)
    if other is not None:
        raise InputError(
            f"A {type(other).__name__} does not hold the commands of the drives; give the log itself: its path, a "
            "mapping of arrays or a data frame."
        )


def _read(
    file: RobotFile, settings: DriveSettings, log: Any, number: int, remarks: dict[str, None]
) -> list[PositionLog]:
    """Read a log, part it where its times have gaps, and add to `remarks` what its units look like."""
    robot = file.robot
    section = file.section("log")
    for key in ("torque", "torque_unit", "torque_matrix", "torque_sign", "gain", "velocity", "acceleration"):
        section.pop(key, None)
    files = LogFiles(log, LogColumns.from_dict(section, f"{file.path}, [log]"))
    matrix = np.eye(robot.dof) if files.columns.position_matrix is None else np.array(files.columns.position_matrix)
    factors = np.diag(matrix)
    if not np.array_equal(matrix, np.diag(factors)):
        raise InputError(
            f"{file.path}, [log]: position_matrix makes joints of several motors, which the gains of drives do not "
            "follow; give positions and commands of the joints themselves, or a matrix with nothing beside its "
            "diagonal where they are in a unit of their own."
        )
    name = files.name if isinstance(log, str | Path) else f"log {number + 1}"
    command = settings.command_columns(robot, files.names)
    scale = () if settings.scale is None else (settings.scale,)
    missing = [column for column in (*command, *scale) if column not in files.names]
    if missing:
        raise InputError(
            f"{name} has no column {missing[0]!r}, which [drive] names for the commands; it has "
            f"{', '.join(files.names[:30])}: correct `{'scale' if missing[0] in scale else 'command'}`."
        )
    columns = {**section, "torque": list(command), "torque_unit": "N·m", "velocity": "none", "acceleration": "none"}
    read = LogColumns.from_dict(columns, f"{file.path}, [log]").of_joints(robot.position_units)
    try:
        recording = Recording.read(log, read, robot)
    except InputError:
        _refuse_uncommanded(robot, files, command, name)
        raise
    if any(recording.lacks_torque(joint) for joint in range(robot.dof)):
        _refuse_uncommanded(robot, files, command, name)
    survey = LogSurvey.of(recording)
    against_limits(survey, robot)  # what is sure to be wrong is refused
    remarks.update(dict.fromkeys(f"{name}: {one}" for one in survey.unit_remarks()))
    told = np.array(recording.torque)
    if settings.law == "position":
        layout = recording.layout
        units = () if layout is None else layout.units["position"]
        if units:
            told *= factors * [POSITION_UNITS[unit] for unit in units]
        told += 0.0 if files.columns.position_offset is None else np.array(files.columns.position_offset)
    if scale:
        factor = np.asarray(files.read(list(scale))[scale[0]])
        bad = np.flatnonzero(~np.isfinite(factor))
        if len(bad):
            raise InputError(
                f"{name} has no finite number in column {scale[0]!r} in {len(bad)} of {len(factor)} rows, first on row "
                f"{bad[0] + 1}; remove those rows, or split the log there."
            )
        told *= factor[:, np.newaxis]
    q, t = np.array(recording.q), np.array(recording.t)
    first = float(t[0])
    if section.get("missing") == "fill":
        no_command, no_position = (
            np.zeros(q.shape, dtype=bool) if one is None else one
            for one in (recording.torque_missing, recording.position_missing)
        )
        known, told = _held(no_command, told)
        known &= ~no_position.any(axis=1)
        q, t, told = q[known], t[known], told[known]
        if len(t) < LEAST_ROWS:
            raise InputError(f"{name} has {len(t)} rows with all positions and commands; record {LEAST_ROWS} at least.")
    _refuse_copies(robot, settings, name, q, told)
    ends = [0, *(np.flatnonzero(np.diff(t) > LONGEST_GAP) + 1).tolist(), len(t)]
    # Times since the epoch resolve no more than a quarter of a microsecond.
    parts = [
        PositionLog(t[a:b] - t[a], q[a:b], told[a:b], name, float(t[a]) - first)
        for a, b in pairwise(ends)
        if b - a >= LEAST_ROWS
    ]
    if not parts:
        raise InputError(
            f"{name} has {len(t)} rows, {few_digits(float(np.median(np.diff(t))))} s apart, and nowhere {LEAST_ROWS} "
            f"in a row without a gap of more than {LONGEST_GAP:g} s; drives show at ten rows a second and more, better "
            "at a hundred."
        )
    return parts


def _held(missing: NDArray[np.bool_], command: Array) -> tuple[NDArray[np.bool_], Array]:
    """Return which rows (S,) have commands of all joints, and commands (S, N) that hold until the next one."""
    rows = np.where(missing, 0, np.arange(len(command))[:, np.newaxis])
    last = np.maximum.accumulate(rows, axis=0)
    held = np.take_along_axis(command, last, axis=0)
    return np.asarray(~np.take_along_axis(missing, last, axis=0).any(axis=1)), held


def _refuse_uncommanded(robot: Robot, files: LogFiles, columns: Sequence[str], name: str) -> None:
    there = files.read(list(columns))
    for joint, column in zip(robot.joint_names, columns, strict=True):
        if not np.isfinite(np.asarray(there[column], dtype=float)).any():
            raise InputError(
                f'{name} has no command of joint "{joint}" in any row (column {column!r} is empty): lock the joint in '
                "[description] if its drive was off."
            )


def _refuse_copies(robot: Robot, settings: DriveSettings, name: str, q: Array, command: Array) -> None:
    travel, apart = np.ptp(q, axis=0), rms_of_joints([command - q])
    for k, joint in enumerate(robot.joint_names):
        if settings.law == "position" and apart[k] < SAME * travel[k]:
            raise InputError(
                f'{name}: the commands of joint "{joint}" are its measured positions; `command` must name what the '
                "drive was told, or the log did not keep it."
            )
