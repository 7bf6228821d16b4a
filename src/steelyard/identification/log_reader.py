"""Logs of an identification: read in chunks, reduced, and thinned for drawing."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Hashable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.threads import TOGETHER, in_turns, one_thread, require_wanted
from steelyard.errors import InputError
from steelyard.files import listed
from steelyard.files.advance import ahead
from steelyard.recording import (
    CutoffChoice,
    LogColumns,
    LogFile,
    Processing,
    Recording,
    Samples,
    chunks,
    decide,
    process_chunks,
)
from steelyard.recording.automatic import DECISION_ROWS
from steelyard.recording.cutoff.by_torques import HIGHEST
from steelyard.recording.diagnosis import DETECTORS, faulty_rows
from steelyard.recording.formats import require_unwritten, written_states
from steelyard.recording.options import AUTO
from steelyard.recording.recognition import Layout
from steelyard.recording.samples import regrouped
from steelyard.recording.survey import LogSurvey
from steelyard.regression import Information
from steelyard.regression.batch_means import BatchMeans, BatchMeansTree
from steelyard.regression.factor import solve
from steelyard.regression.reduction import FEWEST_EXACT, empty_factors, narrowed, reduce_by_joint, residuals
from steelyard.regression.repeated_motion import MotionSums
from steelyard.regression.time_blocks import FOLDS, MOST, TimeBlocks
from steelyard.robot import Robot, RobotFile

from .given import GivenLog, GivenSamples, UnusableLogs, wider_model

if TYPE_CHECKING:
    from steelyard.dynamics.bristles import Bristles

__all__ = [
    "DRAWN_ROWS",
    "DrawnLog",
    "DrawnRows",
    "JoinedSections",
    "LogReader",
    "LogReduction",
    "LogTask",
    "Progress",
    "ReducedGroup",
    "ReducedLog",
    "ReducedSection",
    "SectionedLog",
    "ThinnedSamples",
    "against_limits",
    "drawn_rows",
    "one_by_one",
]

Array = NDArray[np.float64]
Progress = Callable[[str], None]

_FITTED_ROWS = 1000
"""Rows to which the preliminary model of what is drawn is fitted. Joints of arms have up to 60 columns; 4000 rows took
two fifths of the time of all that is drawn of a section."""
_LONGER = 4
"""The preliminary model is fitted anew whenever a log is so many times as long as it was before."""
_MOST_WAITING = 8  # tables of extremes

_READING_LINES = 20  # lines of progress while logs are read
_DECIDING_LOGS, _DECIDING_ROWS, _FEWEST_ROWS = 12, 200_000, 10_000
"""Logs and rows, of all logs together and of each, by which the processing of all is decided: they stand in memory."""


DRAWN_ROWS = 20_000
"""Rows of a log that are kept to be drawn, and to see short events; of a longer one its extremes. All joints share
them: 20 000 are 700 pieces of the log of seven joints, each with four extremes of each joint, and 172 of 29 joints."""
_ALL_DRAWN_ROWS = 120_000  # of many logs together


def drawn_rows(count: int, least: int) -> int:
    """Return how many rows of each of so many logs are kept to be drawn, at least these few."""
    return min(max(_ALL_DRAWN_ROWS // count, least), DRAWN_ROWS)


class LogTask(NamedTuple):
    """A log that is to be reduced.

    Attributes
    ----------
    log : str, Path, LogFile or GivenSamples
    points, rows : int
        How many of its rows are kept for averages, and to be drawn.
    logs : int
        How many logs there are together, of each of which fewer stretches are kept.
    fitted : bool
        Whether the estimate rests on it; false for a log of the validation.
    """

    log: GivenLog
    points: int
    rows: int
    logs: int
    fitted: bool


@dataclass(frozen=True, eq=False)
class DrawnLog:
    """The rows of a log that are drawn, as `DrawnRows` chose them.

    Attributes
    ----------
    windows : tuple of Samples
        Stretches of neighbouring rows.
    seen, piece : int
        Rows of the log, and of each of the pieces whose extremes are here; 1 where all rows are.
    """

    samples: Samples
    windows: tuple[Samples, ...]
    seen: int
    piece: int

    @classmethod
    def joined(cls, parts: Sequence[DrawnLog]) -> DrawnLog:
        """Return those of a log whose sections these are, in order."""
        if len(parts) == 1:
            return parts[0]
        windows = [window for part in parts for window in part.windows]
        return cls(
            Samples.joined([part.samples for part in parts]),
            tuple(windows[:: -(-len(windows) // DrawnRows.WINDOWS)]) if windows else (),
            sum(part.seen for part in parts),
            max(part.piece for part in parts),
        )

    def for_model(self, model: Model) -> DrawnLog:
        """Return the same with a model in its samples, where they have a regressor."""

        windows = tuple(_with_model(window, model) for window in self.windows)
        return replace(self, samples=_with_model(self.samples, model), windows=windows)

    def narrowed(self, wider: Model, model: Model) -> DrawnLog:
        """Return the same for a model that lacks some terms of the wider one."""
        windows = tuple(narrowed(window, wider, model) for window in self.windows)
        return replace(self, samples=narrowed(self.samples, wider, model), windows=windows)


@dataclass(frozen=True, eq=False)
class ReducedLog:
    """The reduced form of a log, which replaces its rows.

    Attributes
    ----------
    fitted : bool
        Whether the estimate rests on it.
    blocks : tuple
        Its stretches, as `TimeBlocks.held` tells them; none where the estimate does not rest on it.
    samples : Samples
        Thinned.
    layout : Layout or None
        What its columns were understood to be; None of samples.
    clock_origin : int
        Where on the clock of the log the times of its samples are 0, ns.
    """

    name: str
    fitted: bool
    information: Information
    blocks: tuple[tuple[NDArray[np.intp], tuple[Array, ...]], ...]
    samples: Samples
    drawn: DrawnLog
    remarks: tuple[str, ...]
    layout: Layout | None
    units_are_suspect: bool
    clock_origin: int = 0

    @property
    def role(self) -> Literal["identification", "validation"]:
        """What the log is for."""
        return "identification" if self.fitted else "validation"

    def for_model(self, model: Model) -> ReducedLog:
        """Return the same with a model in its samples, where they have a regressor."""

        return replace(self, samples=_with_model(self.samples, model), drawn=self.drawn.for_model(model))

    def narrowed(self, wider: Model, model: Model) -> ReducedLog:
        """Return the same for a model that lacks some terms of the wider one."""
        information, samples = self.information.narrowed(wider, model), narrowed(self.samples, wider, model)
        return replace(self, information=information, samples=samples, drawn=self.drawn.narrowed(wider, model))


class ReducedGroup(NamedTuple):
    """Logs that were reduced, those of the fit without their batch means, and these of all of them together."""

    logs: tuple[ReducedLog, ...]
    batch_means: BatchMeans

    @classmethod
    def of(cls, logs: Sequence[ReducedLog]) -> ReducedGroup:
        """Take the batch means out of the logs of the fit, and add them in order."""
        tree = BatchMeansTree()
        for log in logs:
            tree.add(log.information.batch_means if log.fitted else ())
        bare = (
            replace(log, information=replace(log.information, batch_means=())) if log.fitted else log for log in logs
        )
        return cls(tuple(bare), tree.total())


class LogReduction(Protocol):
    """A function that reduces logs: one by one in this process, in several processes, or on a cluster."""

    def __call__(
        self, reader: LogReader, tasks: Sequence[LogTask], model: Model, say: Progress
    ) -> Iterator[ReducedGroup]:
        """Yield groups of 1, 2, 4 ... reduced logs in the order of the tasks; only the last group may be smaller.

        Raises
        ------
        UnusableLogsError
            After the last, with all that cannot be used; `reader.unusable` may name some already.
        """
        ...


def one_by_one(reader: LogReader, tasks: Sequence[LogTask], model: Model, say: Progress) -> Iterator[ReducedGroup]:
    """Reduce logs in this process, and yield them one after the other; see `LogReduction`."""
    usable = [task for task in tasks if task.log not in reader.unusable]  # as the choice of the filter found out

    def begun(number: int) -> ReducedLog | SectionedLog | InputError:
        try:
            return reader.begun(usable[number], model)
        except InputError as error:  # the logs behind it are looked through all the same
            return error

    # Of whole logs one is in memory at a time; and one that is given twice is read from one stream.
    alone = reader.processing.needs_whole_log or len({str(task.log) for task in usable}) < len(usable)
    with contextlib.closing(in_turns(begun, len(usable), 1 if alone else TOGETHER)) as found:
        for number, task in enumerate(usable):
            # One line for each of thousands of logs would push everything else off the screen.
            if number % max(len(usable) // _READING_LINES, 1) == 0:
                say(f"reading {task.log}{f' ({number + 1} of {len(usable)})' if len(usable) > 1 else ''}")
            with reader.unusable.noting(task.log, len(tasks), say):
                one = next(found)
                if isinstance(one, InputError):
                    raise one
                if isinstance(one, SectionedLog):  # by as many threads as the logs have
                    one = reader.joined(one, model)
            if not reader.unusable:  # nothing comes of the set any more; the others are looked through
                assert isinstance(one, ReducedLog)
                yield ReducedGroup.of([one])
    reader.unusable.refuse([task.log for task in tasks])


class LogReader:
    """Reads logs as the robot file says, and collects the remarks on them."""

    def __init__(self, file: RobotFile, model: Model, chunk_rows: int = chunks.CHUNK_ROWS) -> None:
        self.file = file
        self.model = model
        self.chunk_rows = chunks.positive_rows(chunk_rows, "chunk_rows")
        columns = LogColumns.from_dict(file.section("log"), f"{file.path}, [log]")
        self.columns = columns.of_joints(model.robot.position_units)
        self.stated = Processing.from_dict(file.section("processing"), f"{file.path}, [processing]")
        self.processing = self.near_rest = self.stated
        self.decided: dict[str, object] = {}
        self.reasons: dict[str, str] = {}
        self.remarks: list[str] = []
        self.unusable = UnusableLogs()
        self.units_are_suspect = False
        self.clock_origin = 0  # of the log that was read last
        self.cutoff_choices: list[tuple[str, CutoffChoice]] = []
        self.layouts: dict[str, Layout] = {}
        self._streams: dict[str | int, chunks.LogStream] = {}
        self._changing_streams = Lock()
        self._written: dict[str, Mapping[str, Hashable]] = {}  # of each log, see `written_states`

    def require_torques(self) -> None:
        """Refuse logs of currents whose gains are to be found."""
        if self.columns.finds_gains:
            raise InputError(
                f"{self.file.path}, [log]: drive gains are to be found, and currents alone are no torques; state "
                "`gain = [...]`, N·m per A of each joint, or find them with `steelyard payload ROBOT UNLOADED LOADED` "
                "and a payload of known mass."
            )

    def decide(self, given: Sequence[GivenLog], say: Progress, leave_out: bool = False) -> None:
        """Decide what [processing] leaves to the data, once for all logs, so that all have the same filter.

        Logs that cannot be used are put to `unusable`, for whoever reduces the logs to refuse them all; the others
        decide. With `leave_out` it is as if they had not been given.

        Raises
        ------
        InputError
            Where no log can be used.
        """
        logs = [log for log in given if not isinstance(log, GivenSamples)]
        if not self.stated.is_open or not logs:
            return
        recordings: list[Recording] = []
        while not recordings:
            usable = [log for log in logs if log not in self.unusable]
            if not usable:
                self.unusable.refuse(given)
            count = min(len(usable), _DECIDING_LOGS)
            chosen = [usable[int(i)] for i in np.linspace(0, len(usable) - 1, count).round()]
            rows = min(DECISION_ROWS, max(_FEWEST_ROWS, _DECIDING_ROWS // count))
            say(f"choosing the filter by {count} log{'s' * (count > 1)}")
            for log in chosen:
                with self.unusable.noting(log, len(given), say), self._reading(log):
                    recordings.append(chunks.middle_of(self._open(log), self.stated, rows))
            if leave_out and len(recordings) < count:
                recordings = []  # another choice, of those that are left
        if not any(one.torque.size and one.facts["torque"].ranges.any() for one in recordings):
            raise InputError(
                f"{recordings[0].source}: no torque changes within {recordings[0].count} rows; check `torque` in "
                "[log], or record it again."
            )
        # No model has currents that each drive turns into torques in its own way. Rotors that a model lacks are drawn
        # into what it has: a cutoff of 1.4 Hz made up for them where 8.6 Hz was right.
        model = wider_model(self.file, self.model) or self.model
        decision = decide(self.stated, recordings, None if self.columns.finds_gains else model)
        self.processing, self.near_rest = decision.processing, decision.near_rest
        names = [name for name in ("cutoff", "velocity_threshold") if getattr(self.stated, name) == "auto"]
        self.decided = {name: getattr(decision.processing, name) for name in names}
        self.reasons = decision.reasons
        others = f" ({count} of {len(logs)} logs were looked at.)" if count < len(logs) else ""
        self.remarks.extend(f"{remark}{others}" for remark in decision.remarks)
        if decision.cutoff_choice is not None:
            self.cutoff_choices.append(("all logs", decision.cutoff_choice))

    def reduced(self, task: LogTask, model: Model) -> ReducedLog:
        """Reduce a log by itself in a model's base parameters, with its batch means; nothing is noted here."""
        begun = self.begun(task, model)
        return begun if isinstance(begun, ReducedLog) else self.joined(begun, model)

    def begun(self, task: LogTask, model: Model) -> ReducedLog | SectionedLog:
        """Reduce a log; only open one of several sections."""
        log = self.opened(task, model)
        if log is None:
            with self._reading(task.log):
                return self._reduced_whole(task, model)
        return self.joined(log, model) if log.sections == 1 else log

    def joined(self, log: SectionedLog, model: Model) -> ReducedLog:
        """Reduce the sections of an opened log, and join them; see `reduced`."""
        joined = JoinedSections(log, model)
        with contextlib.closing(self._sections(log, model)) as sections:
            for section in sections:
                joined.add(section)
        return joined.reduced()

    def _sections(self, log: SectionedLog, model: Model) -> Generator[ReducedSection, None, None]:
        """Reduce the sections of a log in their order, two at a time where linear algebra may use two threads."""
        if not log.opened.can_move or log.sections == 1:
            for section in range(log.sections):
                yield self.reduced_section(log, section, model)
            return
        from steelyard.graph.large_arrays import return_free_memory  # only long logs need it

        return_free_memory()  # of the rows by which the processing was decided
        yield from in_turns(lambda section: self.reduced_section(log, section, model), log.sections)

    def opened(self, task: LogTask, model: Model) -> SectionedLog | None:
        """Open a log that is read in sections; None of one that is not."""
        if isinstance(task.log, GivenSamples) or self.processing.needs_whole_log:
            return None
        own = self.unwritten()
        with self._reading(task.log):
            used = own._processing_of(task.log)
            opened = chunks.OpenedLog(self._open(task.log), used, model, partial(own._look, task.log))
        return SectionedLog(task, opened, tuple(own.remarks), next(iter(own.layouts.values()), None))

    def reduced_section(self, log: SectionedLog, section: int, model: Model) -> ReducedSection:
        """Reduce one section of a log, in this process or in another one."""
        with one_thread() as allowed:  # pieces are read and filtered before they are reduced, where a thread is free
            lead = chunks.LEAD if allowed > 1 else 0
        opened, task = log.opened, log.task
        opened.use_model(model)
        before, behind = opened.count(section), opened.count(section + 1)
        seen, thinned = chunks.SeenRows(), ThinnedSamples(task.points, opened.count(), before)
        # The errors of what is predicted are those of its rows; estimates move by 1e-4 standard errors at most.
        exact = FEWEST_EXACT if section or task.fitted else None
        stream = opened.samples(section, seen, lead)
        with self._reading(task.log):
            motion = MotionSums() if task.fitted and section == 0 else None  # which tells how it goes on
            kept = _kept_of(stream, task, model, thinned, motion, opened.sections, behind - before, exact, lead)
        if opened.sections > 1:
            from steelyard.graph.large_arrays import return_free_memory  # only long logs need it

            return_free_memory()
        return ReducedSection(
            information=kept.information,
            blocks=kept.blocks,
            samples=thinned.samples if thinned.count else None,
            drawn=kept.drawn,
            survey=seen.survey.state,
            masked=seen.masked,
        )

    def unwritten(self) -> LogReader:
        """Return a reader of the same kind, which has noted nothing yet."""
        own = copy(self)
        own.remarks, own.layouts, own.units_are_suspect, own.clock_origin = [], {}, False, 0
        return own

    def _reduced_whole(self, task: LogTask, model: Model) -> ReducedLog:
        own = self.unwritten()
        thinned = ThinnedSamples(task.points)
        motion = MotionSums() if task.fitted else None
        kept = _kept_of(own._watched(task.log, model), task, model, thinned, motion)
        return ReducedLog(
            name=str(task.log),
            fitted=task.fitted,
            information=kept.information,
            blocks=kept.blocks,
            samples=thinned.samples,
            drawn=kept.drawn,
            remarks=tuple(own.remarks),
            layout=next(iter(own.layouts.values()), None),
            units_are_suspect=own.units_are_suspect,
            clock_origin=own.clock_origin,
        )

    def note(self, reduced: ReducedLog) -> None:
        """Take note of what was seen of a log that was reduced by itself.

        Raises
        ------
        InputError
            Where its columns would be read in other units than those of another log.
        """
        self._note_columns(reduced.name, reduced.layout)
        self.remarks.extend(reduced.remarks)
        self.units_are_suspect |= reduced.units_are_suspect

    def thinned(self, log: GivenLog, points: int) -> ThinnedSamples:
        """Return the samples of one log, thinned to so many or twice as many points, without reducing it."""
        kept = ThinnedSamples(points)
        for samples in self._watched(log, self.model):
            kept.add(samples)
        return kept

    def samples(self, logs: Sequence[GivenLog]) -> Iterator[Samples]:
        """Read logs once more, for rows that are made in another way; nothing is noted of them."""
        own = self.unwritten()
        for log in logs:
            yield from ahead(own._watched(log, self.model), chunks.LEAD)

    def _watched(self, log: GivenLog, model: Model) -> Generator[Samples, None, None]:
        """Read a log; note what is seen of it."""
        if isinstance(log, GivenSamples):
            self._require_samples(log)
            self.remarks.extend(f"{log}: {remark}" for remark in log.samples.remarks)
            yield from regrouped([_with_channels(log.samples, model, str(log))], self.chunk_rows)
            return
        survey = LogSurvey()
        for samples in self._samples(log, survey, model):
            self.remarks.extend(f"{log}: {remark}" for remark in samples.remarks)
            yield samples
        self.remarks.extend(f"{log}: {remark}" for remark in against_limits(survey, self.model.robot))
        self.units_are_suspect |= bool(survey.unit_remarks())

    def _require_samples(self, given: GivenSamples) -> None:
        robot, count = self.model.robot, given.samples.joint_count
        if count != robot.dof:
            raise InputError(
                f"{given} has samples of {count} joints, but {robot.name} has {robot.dof} "
                f"({listed(robot.joint_names)}); give one column for each of them, in this order."
            )
        if not given.samples.used_rows.any():
            raise InputError(f"{given} has samples of which `mask` leaves none to use; give some that are.")

    def middle(self, log: GivenLog, rows: int) -> Recording | Samples:
        """Return so many rows in the middle of a log; of one that was given as samples these."""
        if isinstance(log, GivenSamples):
            start = max(0, (log.samples.count - rows) // 2)
            return log.samples.rows(start, start + rows)
        with self._reading(log):
            return chunks.middle_of(self._open(log), self.processing, rows)

    @contextlib.contextmanager
    def _reading(self, log: GivenLog) -> Iterator[None]:
        """Name the path of a log in what is wrong with it; where it was written since it was read, tell that alone."""
        if str(log) not in self._written:
            self._written[str(log)] = written_states([log])
        try:
            with _told_where(log):
                yield
        except Exception:  # rows of two contents may be any fault
            with _told_where(log):
                require_unwritten(self._written[str(log)])
            raise

    def _open(self, log: str | Path | LogFile) -> chunks.LogStream:
        """Open a log whose rows are counted and timed, once for all that is read of it; the last few stay open."""
        key = id(log) if isinstance(log, LogFile) else str(log)
        with self._changing_streams:
            found = self._streams.pop(key, None)
        found = found or chunks.LogStream(log, self.columns, self.model.robot)
        with self._changing_streams:
            while len(self._streams) >= _DECIDING_LOGS:
                del self._streams[next(iter(self._streams))]
            self._streams[key] = found
        return found

    def _processing_of(self, log: GivenLog) -> Processing:
        """How a log is processed: as all are, but for a cutoff that others chose and its own rate does not allow."""
        cutoff = self.processing.cutoff
        if isinstance(log, GivenSamples) or "cutoff" not in self.decided or not isinstance(cutoff, float):
            return self.processing
        rate = self._open(log).rate
        if cutoff <= HIGHEST * rate:
            return self.processing
        remark = (
            f"{log}: Positions were filtered at {HIGHEST * rate:.4g} Hz, the highest cutoff for {rate:.4g} samples a "
            f"second, and not at the {cutoff:.4g} Hz that other logs chose."
        )
        if remark not in self.remarks:
            self.remarks.append(remark)
        return replace(self.processing, cutoff=HIGHEST * rate)

    def dense(self, log: GivenLog, rows: int) -> Samples | None:
        """Return samples of the middle of a log at its own rate; None where it is hardly longer than half of that."""
        middle = self.middle(log, rows)
        if isinstance(middle, Samples):
            return middle if middle.t is not None else None
        # Filters and masks need the ends of the log; what is read is its middle.
        return middle.process(self._processing_of(log), self.model) if middle.count > rows // 2 else None

    def _note_columns(self, log: str, layout: Layout | None) -> None:
        """Keep what the columns of a log were understood to be."""
        if layout is not None:
            for other, one in self.layouts.items():
                if one == layout:
                    layout = one  # of thousands of logs
                    break
                if one.position == layout.position and one.units["position"] != layout.units["position"]:
                    units = [each.units["position"][0] for each in (one, layout)]
                    raise InputError(
                        f"The positions {layout.position[0]} … {layout.position[-1]} would be read in {units[0]} of "
                        f"{other} and in {units[1]} of {log}; say which with "
                        f'`position_unit = "{units[0]}"` or `position_unit = "{units[1]}"` in [log].'
                    )
            self.layouts[log] = layout

    def _look(self, log: str | Path | LogFile, recording: Recording) -> None:
        """Look at the first rows of a log, as they were read."""
        self._note_columns(str(log), recording.layout)
        self.clock_origin = recording.clock_origin
        handled = [option for option in DETECTORS if getattr(self.processing, option) is not False]
        part = f" (Seen in the first {recording.count} rows.)" if recording.count == chunks.CHOICE_ROWS else ""
        decided = self.processing.velocity_threshold != AUTO  # before, nobody knows which rows are left out
        slowest = self.processing.for_joints("velocity_threshold", recording) if decided else None
        self.remarks.extend(f"{log}: {sentence}{part}" for sentence in faulty_rows(recording, handled, slowest))
        if recording.layout is not None and self.model.robot.described_joints:
            from steelyard.recording.logged_joints import locked_that_move  # few robots have such joints

            moving = locked_that_move(log, self.columns, recording.layout, self.model.robot)
            self.remarks.extend([f"{log}: {moving.statement} {moving.advice}"] if moving else [])
        against_limits(LogSurvey.of(recording), self.model.robot)  # what is sure to be wrong is refused at once

    def _samples(self, log: str | Path | LogFile, survey: LogSurvey, model: Model) -> Iterator[Samples]:
        joints = self.model.robot
        look = partial(self._look, log)
        if self.processing.needs_whole_log:
            recording = Recording.read(log, self.columns, joints)
            look(recording)
            survey.add(recording)
            yield recording.process(self._processing_of(log), model)
        else:
            # Of the pieces that are processed together none is joined with the next, which costs time and memory only.
            rows = min(self.chunk_rows, chunks.PIECE_ROWS)
            used = self._processing_of(log)
            yield from process_chunks(log, self.columns, used, rows, joints, model, look, survey)


@contextlib.contextmanager
def _told_where(log: GivenLog) -> Iterator[None]:
    """Let what is wrong with a log name its path: partitions of a data set have files of one name."""
    try:
        yield
    except InputError as error:
        path, told = str(log), str(error)
        if path not in told and told.startswith(name := Path(path).name):
            told = path + told.removeprefix(name)
        raise InputError(told) from None


class _Kept(NamedTuple):
    """The sums that are kept of a log, or of a section of it, beside thinned samples; see `ReducedLog`."""

    information: Information
    blocks: tuple[tuple[NDArray[np.intp], tuple[Array, ...]], ...]
    drawn: DrawnLog


def _kept_of(
    stream: Generator[Samples, None, None],
    task: LogTask,
    model: Model,
    thinned: ThinnedSamples,
    motion: MotionSums | None,
    sections: int = 1,
    total: int = 0,
    exact: int | None = None,
    lead: int = chunks.LEAD,
) -> _Kept:
    """Reduce the `total` samples, or more, of one of so many sections of a log, and thin them on the way."""
    drawn = DrawnRows(model, max(task.rows // sections, 1), total)
    # Of many logs one may be longer than all the others, and is then to be cut into folds by itself.
    most = max(-(-MOST // (task.logs * sections)), FOLDS if sections == 1 else 1)
    blocks = TimeBlocks(empty_factors(model), most) if task.fitted else None

    def watched() -> Iterator[Samples]:
        with contextlib.closing(stream):  # and with it the thread that reads ahead
            for samples in stream:
                require_wanted()
                drawn.add(samples)
                thinned.add(samples)
                yield samples

    information = Information.from_chunks(model, ahead(watched(), lead), blocks=blocks, exact=exact, motion=motion)
    drawn.finish()
    if not task.fitted:  # of a log that is only predicted the shortest batches do, which tell its white noise
        information = replace(information, batch_means=information.batch_means[:1])
    return _Kept(information, () if blocks is None else blocks.held, drawn.kept)


@dataclass(frozen=True)
class SectionedLog:
    """A log that was opened, of which any section can be reduced, in this process or in another one.

    Attributes
    ----------
    opened : OpenedLog
    remarks : tuple of str
        What was seen of its first rows.
    """

    task: LogTask
    opened: chunks.OpenedLog
    remarks: tuple[str, ...]
    layout: Layout | None

    @property
    def sections(self) -> int:
        """How many sections there are."""
        return self.opened.sections


@dataclass(frozen=True, eq=False)
class ReducedSection:
    """The reduced form of a section of a log, which replaces its rows; see `ReducedLog`.

    Attributes
    ----------
    blocks : tuple
    survey : dict of ndarray
        As `LogSurvey.state` tells it.
    masked : dict of ndarray
        How many rows of each joint were masked, by the reason.
    """

    information: Information
    blocks: tuple[tuple[NDArray[np.intp], tuple[Array, ...]], ...]
    samples: Samples | None
    drawn: DrawnLog
    survey: dict[str, Array]
    masked: dict[str, NDArray[np.intp]]

    def for_model(self, model: Model) -> ReducedSection:
        """Return the same with a model in its samples, where they have a regressor."""
        samples = None if self.samples is None else _with_model(self.samples, model)
        return replace(self, samples=samples, drawn=self.drawn.for_model(model))


class JoinedSections:
    """Joins the sections of a log, in their order, to what the log as a whole comes to.

    They were reduced in the model's base parameters.
    """

    def __init__(self, log: SectionedLog, model: Model) -> None:
        self.log, self.model = log, model
        self._seen, self._means, self._blocks = chunks.SeenRows(), BatchMeansTree(), TimeBlocks(empty_factors(model))
        self._information: list[Information] = []
        self._samples: list[Samples] = []
        self._drawn: list[DrawnLog] = []

    def add(self, section: ReducedSection) -> None:
        """Add the section that follows."""
        self._means.add(section.information.batch_means)
        bare = replace(section.information, batch_means=())
        self._information = [Information.total([*self._information, bare])]
        self._blocks.append(TimeBlocks.of_held(self._blocks.empty, section.blocks))
        if section.samples is not None:
            self._samples.append(section.samples)
        self._drawn.append(section.drawn)
        self._seen.survey.join(section.survey, self.log.opened.first)
        for name, counts in section.masked.items():
            self._seen.mask(name, counts)

    def reduced(self) -> ReducedLog:
        """Return what all of them come to."""
        name, opened, information = str(self.log.task.log), self.log.opened, self._information[0]
        # What the first section told of, and the motion goes on.
        returning = tuple(one.over([f.count for f in information.factors]) for one in information.returning)
        with _told_where(self.log.task.log):
            ending = opened.ending(self._seen, any(factor.count for factor in information.factors))
        limits = against_limits(self._seen.survey, self.model.robot)
        remarks = (f"{name}: {remark}" for remark in (*opened.remarks, *ending, *limits))
        return ReducedLog(
            name=name,
            fitted=self.log.task.fitted,
            information=replace(information, batch_means=self._means.total(), returning=returning),
            blocks=self._blocks.held,
            samples=Samples.joined(self._samples),
            drawn=DrawnLog.joined(self._drawn),
            remarks=(*self.log.remarks, *remarks),
            layout=self.log.layout,
            units_are_suspect=bool(self._seen.survey.unit_remarks()),
            clock_origin=opened.stream.clock_origin,
        )


def against_limits(survey: LogSurvey, robot: Robot) -> tuple[str, ...]:
    """Compare a log with what the joints of a robot can do; see `steelyard.Recording.check_against`."""
    driving = [robot.joints[i] for i in robot.driving_joints]
    low, high, fastest = ([getattr(joint, key) for joint in driving] for key in ("lower", "upper", "velocity_limit"))
    return survey.limit_remarks(low, high, fastest, robot.position_units)


class DrawnRows:
    """The rows of a stream that are drawn, and stretches of neighbouring ones, in bounded memory.

    A short log keeps all its rows. A long one is cut into pieces of equal length, of each of which those rows remain at
    which the torque of some joint, or what a preliminary model leaves of it, is least or greatest: no peak is lost,
    which every k-th row would lose. The model is fitted by least squares to rows of the whole log so far, whenever this
    has become four times as long.

    Parameters
    ----------
    rows : int
        About so many remain.
    total : int
        How many samples the whole stream will have at least: pieces as long as they will be need not be merged.

    Examples
    --------
    >>> import numpy as np, steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")]))
    >>> torque = np.sin(np.arange(5000.0))[:, None]
    >>> torque[1234] = 9.0
    >>> drawn, motion = DrawnRows(model, 400), np.zeros((5000, 1))
    >>> drawn.add(sy.Samples(q=motion, dq=motion, ddq=motion, torque=torque)), drawn.finish()
    (None, None)
    >>> drawn.kept.samples.torque.max(), drawn.kept.samples.count <= 800, drawn.kept.piece
    (np.float64(9.0), True, 64)
    """

    WINDOWS, WINDOW_ROWS = 8, 4096

    def __init__(self, model: Model, rows: int, total: int = 0) -> None:
        self.model, self.limit, self._total = model, rows, total
        self.piece, self.seen, self._fitted = 1, 0, 0  # rows of a piece, of the stream, and of it at the last fit
        self._set_pieces()
        self._made_for: tuple[Model | None, Bristles | None] = None, None
        self._waiting: list[Array] = []
        self._waiting_rows = 0  # for which those stand, once there are pieces
        self._pieces: Array | None = None  # (P, 4 N, D): the rows of each piece by what they are an extreme of
        self._windows: dict[int, list[Array]] = {}
        self._stride = 1
        self._base: Array | None = None

    def _set_pieces(self) -> None:
        """Set how many pieces there are at most, and how long the stretches are."""
        self._most = max(self.limit // (4 * self.model.dof), 2)
        self._window_rows = min(self.WINDOW_ROWS, max(self.limit // 4, 1))

    def add(self, samples: Samples) -> None:
        """Add the samples that follow."""
        first = self.seen
        if samples.regressor is not None and not first:
            own = 2 + 5 * self.model.dof
            self.limit = max(self.limit * own // (own + samples.regressor.shape[1]), 200)
            self._set_pieces()
        self._made_for = samples.regressor_model, samples.bristles
        self._keep_windows(samples)
        self.seen += samples.count
        if self._pieces is None:
            if self.seen <= self.limit:
                self._waiting.append(_table_of(samples, first))
                return
            waiting = np.concatenate([*self._waiting, _table_of(samples, first, slice(0, 0))])
            self._fit(waiting, samples, first)
            self._pieces = np.empty((0, 4 * self.model.dof, waiting.shape[1]))
            self._waiting = []
            while self._total // self.piece > self._most:
                self.piece *= 2
            if len(waiting):
                self._cut(self._samples(waiting), 0)
        elif self.seen >= _LONGER * self._fitted:
            self._fit(self._pieces.reshape(-1, self._pieces.shape[2]), samples, first)
        self._cut(samples, first)

    def _keep_windows(self, samples: Samples) -> None:
        length, end = self._window_rows, self.seen + samples.count
        while end > self.WINDOWS * length * self._stride:
            self._stride *= 2
        self._windows = {k: parts for k, parts in self._windows.items() if k % self._stride == 0}
        for k in range(self.seen // length, -(-end // length)):
            if k % self._stride == 0:
                rows = slice(max(k * length - self.seen, 0), (k + 1) * length - self.seen)
                self._windows.setdefault(k, []).append(_table_of(samples, self.seen, rows))

    def _cut(self, samples: Samples, number: int) -> None:
        """Cut what waits and the samples that follow it, the first of them with this number, into pieces.

        There are at most `_most` pieces; of what is too short for one the extremes so far go on waiting. Few rows are
        ever put together in a table: those that remain.
        """
        assert self._pieces is not None
        count, predicted = samples.count, self._predicted(samples)

        def drawn(rows: slice, size: int) -> Array:
            """Return of each group of so many of these rows those that are an extreme of it, (G, 4 N, D)."""
            places = _extreme_rows(samples.torque[rows], predicted[rows], size)
            chosen = rows.start + places + size * np.arange(len(places))[:, None]
            return _table_of(samples, number, chosen.ravel()).reshape(*chosen.shape, -1)

        while len(self._pieces) + (self._waiting_rows + count) // self.piece > self._most:
            self.piece *= 2
            self._pieces = self._merged(self._pieces)
        size = self.piece
        # What waited from before begins the first piece.
        missing = min(-self._waiting_rows % size, count) if self._waiting_rows else 0
        if missing:
            self._wait(drawn(slice(0, missing), missing)[0], missing)
        found = [self._pieces]
        if self._waiting_rows == size:
            found.append(self._extremes(np.concatenate(self._waiting)[None]))
            self._waiting, self._waiting_rows = [], 0
        end = missing + (count - missing) // size * size
        if end > missing:
            found.append(drawn(slice(missing, end), size))
        self._pieces = np.concatenate(found)
        if end < count:
            self._wait(drawn(slice(end, count), count - end)[0], count - end)

    def _wait(self, extremes: Array, size: int) -> None:
        """Keep the extremes of so many samples until the piece that they begin or go on with is whole."""
        self._waiting.append(extremes)
        self._waiting_rows += size
        if len(self._waiting) > _MOST_WAITING:
            self._waiting = [self._extremes(np.concatenate(self._waiting)[None])[0]]

    def _merged(self, pieces: Array) -> Array:
        even = len(pieces) // 2 * 2
        if not even:
            return pieces
        return np.concatenate([self._extremes(pieces[:even].reshape(even // 2, -1, pieces.shape[2])), pieces[even:]])

    def _extremes(self, groups: Array) -> Array:
        """Return the rows of each group (G, R, D) at which torque or residual of a joint is least or greatest."""
        samples = self._samples(groups.reshape(-1, groups.shape[2]))
        places = _extreme_rows(samples.torque, self._predicted(samples), groups.shape[1])
        return np.asarray(groups[np.arange(len(groups))[:, None], places])

    def _predicted(self, samples: Samples) -> Array:
        """Return the torques that the preliminary model predicts."""
        assert self._base is not None
        if samples.regressor is not None:
            return samples.torque - np.vstack([errors for _, errors in residuals(self.model, samples, self._base)])
        parameters = self.model.base_parameters().Pb @ self._base
        return np.asarray(self.model.inverse_dynamics(samples.q, samples.dq, samples.ddq, parameters))

    def _fit(self, earlier: Array, samples: Samples, first: int) -> None:
        """Fit the preliminary model to rows that were seen before, a table, and to some of the samples that follow."""

        def spread(count: int) -> NDArray[np.intp]:
            return np.unique(np.linspace(0, count - 1, _FITTED_ROWS).astype(np.intp))

        table = np.concatenate([earlier, _table_of(samples, first, spread(samples.count))])
        chosen = self._samples(table[spread(len(table))])
        factors = reduce_by_joint(self.model, replace(chosen, mask=None))
        self._base = solve(replace(Information.empty(self.model), factors=factors).reduced(None))
        self._fitted = self.seen

    def _samples(self, table: Array) -> Samples:
        return _samples_of(table, self.model.dof, *self._made_for)

    def finish(self) -> None:
        """Let go of what is not drawn."""
        if self._pieces is None:
            table = np.concatenate(self._waiting) if self._waiting else np.empty((0, 2 + 5 * self.model.dof))
        else:
            parts = [self._pieces.reshape(-1, self._pieces.shape[2])]
            if self._waiting_rows:
                parts.append(self._extremes(np.concatenate(self._waiting)[None])[0])
            table = np.concatenate(parts)
            table = table[np.unique(table[:, 0], return_index=True)[1]]
        samples = self._samples(table)
        windows = [np.concatenate(parts) for _, parts in sorted(self._windows.items())]
        if len(windows) > 1 and self._stride == 1:
            windows = [np.concatenate(windows)]  # of which none is missing
        kept = tuple(self._samples(window) for window in windows if len(window) > 1)
        self.kept = DrawnLog(samples, kept, self.seen, self.piece)
        self._waiting, self._pieces, self._windows = [], None, {}


class ThinnedSamples:
    """Every k-th sample of a stream, with k doubling as the stream grows.

    Parameters
    ----------
    points : int
        So many remain at least, and at most twice as many.
    total : int
        How many samples the whole stream will have at least.
    first : int
        The number of the first that is added, where these are some from its middle.
    """

    def __init__(self, points: int, total: int = 0, first: int = 0) -> None:
        self.points = points
        self.every, self.seen = 1, first
        while -(-total // self.every) > 2 * points:
            self.every *= 2
        self._joints = 0
        self._made_for: tuple[Model | None, Bristles | None] = None, None
        self._parts: list[Array] = []

    def add(self, samples: Samples) -> None:
        """Add the samples that follow."""
        self._joints, self._made_for = samples.joint_count, (samples.regressor_model, samples.bristles)
        self._parts.append(_table_of(samples, self.seen, slice(-self.seen % self.every, None, self.every)))
        self.seen += samples.count
        while self.count > 2 * self.points:
            self._parts = [np.concatenate(self._parts)[::2].copy()]
            self.every *= 2

    @property
    def count(self) -> int:
        """How many were kept."""
        return sum(map(len, self._parts))

    @property
    def samples(self) -> Samples:
        """What was kept."""
        return _samples_of(np.concatenate(self._parts), self._joints, *self._made_for)


def _with_channels(samples: Samples, model: Model, name: str) -> Samples:
    """Return samples with the regressor of a model whose terms need channels, as those of a log have it."""
    if not model.robot.channels or samples.regressor_model is model:
        return samples
    samples = samples if samples.filtered_torque else samples.with_presliding(model)
    if samples.filtered_torque:
        raise InputError(
            f"The torques of {name} were filtered, and what terms need of its channels was not; give the model to "
            "Recording.process, which filters both."
        )
    entries = model.base_columns.entries(samples.q, samples.dq, samples.ddq, samples.channels_for(model))
    return replace(samples, regressor=entries, regressor_model=model)


def _with_model(samples: Samples, model: Model) -> Samples:
    return samples if samples.regressor is None else replace(samples, regressor_model=model)


def _extreme_rows(torque: Array, predicted: Array, size: int) -> NDArray[np.intp]:
    """Return which rows of each group of so many neighbours are those extremes, (G, 4 N)."""
    from steelyard.graph.extreme_rows import extreme_rows  # only long logs need it

    return extreme_rows(torque, predicted, size)


def _table_of(samples: Samples, first: int, rows: slice | NDArray[np.intp] = slice(None)) -> Array:
    """Return rows of samples as one array: number in the stream, time, motion, torques, mask, and the regressor.

    `first` is the number of the first of these samples. All the samples of a log have a regressor, or none has.
    """
    numbers = np.arange(first, first + samples.count, dtype=float)[rows]
    t = numbers if samples.t is None else samples.t[rows]
    motion = [one[rows] for one in (samples.q, samples.dq, samples.ddq, samples.torque)]
    columns = [numbers, t, *motion, samples.used_rows[rows]]
    if samples.regressor is not None:
        columns += [(samples.channels or {})[name][rows] for name in _channels(samples.regressor_model)]
        columns.append(samples.regressor[rows])
    return np.column_stack(columns)


def _samples_of(table: Array, joints: int, regressor_model: Model | None, bristles: Bristles | None) -> Samples:
    """Return the samples that `_table_of` made an array of."""
    q, dq, ddq, torque, mask = (table[:, 2 + k * joints : 2 + (k + 1) * joints] for k in range(5))
    names = _channels(regressor_model)
    used, regressor = mask > 0.5, table[:, 2 + (5 + len(names)) * joints :]
    channels = {name: table[:, 2 + k * joints : 2 + (k + 1) * joints] for k, name in enumerate(names, start=5)}
    return Samples(
        q=q,
        dq=dq,
        ddq=ddq,
        torque=torque,
        mask=None if used.all() else used,
        t=table[:, 1].copy(),
        regressor=regressor if regressor.shape[1] else None,
        regressor_model=regressor_model if regressor.shape[1] else None,
        channels=channels or None,
        bristles=bristles,
    )


def _channels(model: Model | None) -> tuple[str, ...]:
    """Names of the channels that the terms of a model need, which its samples have then, as they have a regressor."""
    return () if model is None else model.robot.channels
