"""Data sets of many robots, each reduced to one Information."""

from __future__ import annotations

import os
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.files import listed, plain
from steelyard.identification.given import (
    GivenLog,
    UnusableLogsError,
    given_logs,
    given_robot,
    given_settings,
    wider_model,
    without_informations,
)
from steelyard.identification.log_reader import LogReader, LogTask, ReducedGroup, ReducedLog, drawn_rows
from steelyard.identification.reduced_logs import copies_among, overlaps_among, require_once
from steelyard.recording import Samples
from steelyard.recording.formats import contents_of, require_unwritten, unchanged, written_states
from steelyard.recording.formats.hashes import LogContent
from steelyard.regression import Information, least_squares
from steelyard.regression.batch_means import BatchMeansTree
from steelyard.regression.reduction import empty_factors, errors_of
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import Robot, RobotFile

from .checkpoints import Checkpoints, checkpoint_key, robot_content
from .executors import Executor, Here
from .log_reduction import first_of, run_in_order
from .packed import packed, unpacked

__all__ = ["DataSet", "ReducedDataSet", "reduce_data_sets", "reduced_logs"]

FEW = 100
"""Rows that are kept of a log to be drawn, where nobody draws them."""


@dataclass(frozen=True, eq=False)
class DataSet:
    """The logs of one robot.

    Attributes
    ----------
    robot : str, Path, RobotFile or Robot
    logs : sequence of str or Path
        Paths, folders, patterns, or addresses of objects, as :func:`steelyard.identify` takes them; ``.json`` is an
        Information of logs that were reduced before, and is added.
    columns, processing : mapping, optional
        Keys of ``[log]`` and ``[processing]``, in place of those of the robot file.
    rotors : bool
        Whether a robot whose terms nobody stated is reduced with the inertia of rotors, as `identify` does to tell
        whether the logs show one.
    """

    robot: str | os.PathLike[str] | RobotFile | Robot
    logs: Sequence[str | os.PathLike[str]]
    columns: Mapping[str, Any] | None = None
    processing: Mapping[str, Any] | None = None
    rotors: bool = False


@dataclass(frozen=True, eq=False)
class ReducedDataSet:
    """The reduced form of a data set, which replaces its rows.

    Attributes
    ----------
    information : Information
        Of all the logs together, with batch means.
    stretches : tuple of Information
        Contiguous parts of all the logs, for cross-validation; of what was reduced before each is a part.
    logs : tuple of str
    remarks : tuple of str
    decided : dict
        The options of processing that the data decided.
    """

    information: Information
    stretches: tuple[Information, ...]
    logs: tuple[str, ...]
    remarks: tuple[str, ...]
    decided: dict[str, Any]

    def __str__(self) -> str:
        total, logs = self.information, len(self.logs)
        hidden = f"; they do not show {listed(total.unidentifiable, 3)}" if total.unidentifiable else ""
        lines = [
            f"{logs} log{'s' * (logs > 1)}: {total.count} rows of {len(total.joint_names)} joints for "
            f"{total.base_count} base parameters, condition number {total.condition_number:.3g}{hidden}."
        ]
        if self.decided:
            options = listed([f"`{name}`" for name in self.decided])
            lines.append(f"These logs decided {options}, and those of another day may decide otherwise; state it.")
        return "\n".join([*lines, *(f"Note: {remark}" for remark in self.remarks)])

    def to_dict(self) -> dict[str, Any]:
        """Return what is known of it as plain data, without the numbers of the Information."""
        total = self.information
        return {
            "logs": self.logs,
            "rows": total.count,
            "base_parameters": total.base_names,
            "condition_number": total.condition_number,
            "not_shown": total.unidentifiable,
            "decided": self.decided,
            "remarks": self.remarks,
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the Information with its remarks; the file appears whole or not at all."""
        remarks = dict.fromkeys((*self.information.remarks, *self.remarks))
        replace(self.information, remarks=tuple(remarks)).save(Path(path))


@dataclass(frozen=True, eq=False)
class _Task:
    file: RobotFile
    logs: tuple[GivenLog, ...]
    informations: tuple[str, ...]
    rotors: bool
    contents: tuple[LogContent, ...] = ()

    def model(self, informations: Sequence[tuple[str, Information]]) -> Model:
        """The model of what was reduced before, which may have been with the rotors or without; else as is asked."""
        model = Model.from_file(self.file)
        wider = wider_model(self.file, model) or model
        for path, one in informations[:1]:
            return one.model_among([wider, model], path)
        return wider if self.rotors else model


def reduced_logs(
    file: RobotFile,
    model: Model,
    logs: Sequence[GivenLog],
    each: list[ReducedLog] | None = None,
    informations: Sequence[tuple[str, Information]] = (),
    left_out: dict[str, str] | None = None,
) -> ReducedDataSet:
    """Reduce the logs of one robot in this process, in the base parameters of a model, and add what was reduced before.

    `each` receives each log by itself, with the rows in which short events show. With `left_out` logs that cannot be
    used stop nothing while others are left: each is put there by its name, and why.
    """
    if file.section("elastic"):
        raise InputError(
            f"{file.path}: joints give way, as the table [elastic] says, and the sums of logs are those of a rigid "
            "robot; use `steelyard identify` for each, or take a robot file without this table."
        )
    for path, information in informations:
        information.model_among([model], path)
    earlier = [information for _, information in informations]
    written = written_states(logs)
    reader = LogReader(file, model)
    reader.require_torques()
    logs = _that_open(reader, logs, left_out)
    tree, blocks, parts = BatchMeansTree(), TimeBlocks(empty_factors(model)), []
    drawn = FEW if each is None and len(logs) < 2 else drawn_rows(max(len(logs), 1), FEW)
    used: list[GivenLog] = []
    kept: list[ReducedLog] = []
    windows: list[Samples] = []  # of several logs, which may hold one motion
    rows: list[ReducedLog] = []  # of several logs, which may share some
    for log in logs:
        if log in reader.unusable:
            continue
        with reader.unusable.noting(log, len(logs)):
            found = reader.reduced(LogTask(log, FEW, drawn, len(logs), True), model)
        if log in reader.unusable or (reader.unusable and left_out is None):
            continue
        ((one,), means) = ReducedGroup.of([found])
        used.append(log)
        reader.note(one)
        if each is not None:
            kept.append(one)
        tree.add(means)
        blocks.append(TimeBlocks.of_held(blocks.empty, one.blocks))
        parts.append(one.information)
        windows += one.drawn.windows if len(logs) > 1 else ()
        rows += [replace(one, blocks=())] if len(logs) > 1 else []
    if left_out is None:
        reader.unusable.refuse(logs)
    elif logs and not used:
        raise _nothing_left(reader, logs)
    else:
        left_out.update(reader.unusable.reasons)
    if len(used) < len(logs):  # those that were left out took part in the choice of the filter
        return reduced_logs(file, model, used, each, informations, left_out)
    require_unwritten(written)
    if each is not None:
        each += kept
    own = [replace(Information.total(parts), batch_means=tree.total())] if parts else []
    names = (*map(str, used), *(path for path, _ in informations))
    copies = copies_among([(name, "identification", one) for name, one in zip(names, [*parts, *earlier], strict=True)])
    overlaps = overlaps_among([log for k, log in enumerate(rows) if k not in copies])
    stretches = [part for one in own for part in one.stretches(blocks)]
    if windows and not any(one.returning for one in own):
        base = least_squares(own[0]).base
        own = [own[0].with_returning([(window, errors_of(model, window, base)) for window in windows])]
    return ReducedDataSet(
        Information.total([*own, *earlier]),
        (*stretches, *(replace(one, batch_means=()) for one in earlier)),
        names,
        tuple(dict.fromkeys((*reader.remarks, *copies.values(), *overlaps))),
        {name: plain(value) for name, value in reader.decided.items()},
    )


def _that_open(reader: LogReader, logs: Sequence[GivenLog], left_out: dict[str, str] | None) -> Sequence[GivenLog]:
    """Decide how logs are processed; return those that can be opened, as far as the decision has to know."""
    if left_out is None:
        reader.decide(logs, lambda _: None)
        return logs
    try:
        reader.decide(logs, lambda _: None, leave_out=True)
    except UnusableLogsError:
        raise _nothing_left(reader, logs) from None
    left_out.update(reader.unusable.reasons)
    return [log for log in logs if log not in reader.unusable]


def _nothing_left(reader: LogReader, logs: Sequence[GivenLog]) -> InputError:
    """Return what is said of a robot without a log that can be used, in one line of a table."""
    last = list(reader.unusable.reasons.values())[-1]
    return InputError(f"none of {len(logs)} logs can be used; of the last: {last}")


def _reduced(common: Any, task: _Task) -> bytes:
    with unchanged(task.contents):
        informations = [(path, Information.load(path)) for path in task.informations]
        contents = require_once(task.logs, informations)
        found = reduced_logs(task.file, task.model(informations), task.logs, informations=informations)
    found = replace(found, information=replace(found.information, contents=contents))
    return packed([getattr(found, one.name) for one in fields(found)])


def _hashed(common: Any, task: _Task) -> bytes:
    return packed(list(map(tuple, contents_of(map(str, (*task.logs, *task.informations))))))


def reduce_data_sets(
    data_sets: Sequence[DataSet], executor: Executor | None = None, checkpoints: Checkpoints | None = None
) -> Generator[ReducedDataSet, None, None]:
    """Reduce data sets, each to one Information, and yield them in their order.

    Each is reduced by itself, with a filter that its own logs choose, so that the result does not depend on where it
    was reduced, and the next run computes only what is new.

    Parameters
    ----------
    data_sets : sequence of DataSet
    executor : Executor, optional
        Where; in this process by default.
    checkpoints : Checkpoints, optional
        What is there already is not computed again.

    Raises
    ------
    InputError
        If a robot or a log cannot be used.

    Examples
    --------
    >>> import numpy as np, tempfile, pathlib
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 0.3, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    >>> t, path = np.arange(0.0, 8.0, 0.01), pathlib.Path(tempfile.mkdtemp()) / "run.csv"
    >>> q = 0.8 * np.sin(3 * t) + np.sin(1.1 * t)
    >>> table = np.column_stack([t, q, 5.0 * np.cos(q)])
    >>> np.savetxt(path, table, header="t,q1,tau1", delimiter=",", comments="")
    >>> [reduced] = sy.fleet.reduce_data_sets([sy.fleet.DataSet(robot, [path])])
    >>> reduced.information.count > 700, len(reduced.stretches)
    (True, 5)
    """
    executor = Here() if executor is None else executor
    tasks, passed_over = [], []
    for one in data_sets:
        file = given_settings(given_robot(one.robot)[0], one.columns, one.processing)
        if not one.logs:
            raise InputError("A data set has no logs; give the path of one.")
        logs, earlier = without_informations(list(one.logs))
        passed_over.append(list[str]())
        tasks.append(_Task(file, given_logs(logs, None, passed_over[-1])[0], earlier, one.rotors))
    groups, keys = [[task] for task in tasks], None
    if checkpoints is not None:
        hashes = run_in_order(_hashed, first_of, None, groups, executor)
        contents = [tuple(LogContent(*one) for one in unpacked(content)) for content in hashes]
        groups = [[replace(task, contents=told)] for task, told in zip(tasks, contents, strict=True)]
        keys = [_key(task) for (task,) in groups]
    reduced = run_in_order(_reduced, first_of, None, groups, executor, keys, checkpoints)
    for content, passed in zip(reduced, passed_over, strict=True):
        found = ReducedDataSet(*unpacked(content))
        yield replace(found, remarks=(*passed, *found.remarks))


def _key(task: _Task) -> str:
    file = task.file
    contents = [[log, *hashes] for log, hashes, _ in task.contents]
    sections = [file.section("log"), file.section("processing")]
    robot = robot_content(file.robot)
    return checkpoint_key("data set", robot, file.terms, sections, file.terms_are_default, task.rotors, contents)
