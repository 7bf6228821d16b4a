"""Logs of an identification: read in chunks, reduced, and thinned for drawing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
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
    read_middle,
)
from steelyard.recording.automatic import DECISION_ROWS
from steelyard.recording.diagnosis import DETECTORS, faulty_rows
from steelyard.recording.recognition import Layout
from steelyard.recording.samples import regrouped
from steelyard.recording.survey import LogSurvey
from steelyard.regression import Information
from steelyard.regression.batch_means import BatchSums
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import MOST, TimeBlocks
from steelyard.robot import Robot, RobotFile

from .given import GivenLog, GivenSamples

__all__ = ["LogReader", "Progress", "ThinnedSamples", "against_limits"]

Array = NDArray[np.float64]
Progress = Callable[[str], None]

_DECIDING_LOGS, _DECIDING_ROWS, _FEWEST_ROWS = 12, 200_000, 10_000
"""Logs and rows, of all logs together and of each, by which the processing of all is decided: they stand in memory."""


class LogReader:
    """Reads logs as the robot file says, and collects the remarks on them."""

    def __init__(self, file: RobotFile, model: Model, chunk_rows: int) -> None:
        self.model = model
        self.chunk_rows = chunk_rows
        self.columns = LogColumns.from_dict(file.section("log"), f"{file.path}, [log]")
        self.stated = Processing.from_dict(file.section("processing"), f"{file.path}, [processing]")
        self.processing = self.stated
        self.decided: dict[str, object] = {}
        self.reasons: dict[str, str] = {}
        self.remarks: list[str] = []
        self.units_are_suspect = False
        self.cutoff_choices: list[tuple[str, CutoffChoice]] = []
        self.layouts: dict[str, Layout] = {}

    def decide(self, given: Sequence[GivenLog], say: Progress) -> None:
        """Decide what [processing] leaves to the data, once for all logs, so that all have the same filter."""
        logs = [log for log in given if not isinstance(log, GivenSamples)]
        if not self.stated.is_open or not logs:
            return
        count = min(len(logs), _DECIDING_LOGS)
        chosen = [logs[int(i)] for i in np.linspace(0, len(logs) - 1, count).round()]
        rows = min(DECISION_ROWS, max(_FEWEST_ROWS, _DECIDING_ROWS // count))
        say(f"choosing the filter by {count} log{'s' * (count > 1)}")
        recordings = [
            read_middle(log, self.columns, self.stated, rows, list(self.model.robot.joint_names)) for log in chosen
        ]
        if not any(one.torque.size and np.ptp(one.torque, axis=0).any() for one in recordings):
            raise InputError(
                f"{recordings[0].source}: no torque changes within {recordings[0].count} rows; check `torque` in "
                "[log], or record it again."
            )
        # No model has currents that each drive turns into torques in its own way.
        decision = decide(self.stated, recordings, None if self.columns.finds_gains else self.model)
        self.processing = decision.processing
        names = [name for name in ("cutoff", "velocity_threshold") if getattr(self.stated, name) == "auto"]
        self.decided = {name: getattr(decision.processing, name) for name in names}
        self.reasons = decision.reasons
        others = f" ({count} of {len(logs)} logs were looked at.)" if count < len(logs) else ""
        self.remarks.extend(f"{remark}{others}" for remark in decision.remarks)
        if decision.cutoff_choice is not None:
            self.cutoff_choices.append(("all logs", decision.cutoff_choice))

    def reduce(
        self,
        log: GivenLog,
        points: int,
        sums: BatchSums | None = None,
        blocks: TimeBlocks | None = None,
        logs: int = 1,
        model: Model | None = None,
    ) -> tuple[Information, ThinnedSamples]:
        """Reduce one log, and keep a copy of its samples, thinned to so many or twice as many points.

        Parameters
        ----------
        log : str, Path, LogFile or GivenSamples
        points : int
        sums : BatchSums, optional
            Receives the sums of batches. They are kept for all the logs together: they are nine tenths of an
            Information.
        blocks : TimeBlocks, optional
            Receives the stretches of the log.
        logs : int
            How many logs there are: each of many logs is one stretch.
        model : Model, optional
            In whose base parameters the log is reduced, in place of the model by which it is processed.
        """
        model = self.model if model is None else model
        thinned = ThinnedSamples(points)
        own = None if blocks is None else TimeBlocks(empty_factors(model), -(-MOST // logs))
        information = Information.from_chunks(
            model, self._watched(log, thinned), batch_means=False, sums=sums, blocks=own
        )
        if blocks is not None and own is not None:
            blocks.append(own)
        thinned.finish()
        return information, thinned

    def thinned(self, log: GivenLog, points: int) -> ThinnedSamples:
        """Return the samples of one log, thinned to so many or twice as many points, without reducing it."""
        kept = ThinnedSamples(points)
        for _ in self._watched(log, kept):
            pass
        kept.finish()
        return kept

    def _watched(self, log: GivenLog, thinned: ThinnedSamples) -> Iterator[Samples]:
        if isinstance(log, GivenSamples):
            self._require_joints(log)
            self.remarks.extend(f"{log}: {remark}" for remark in log.samples.remarks)
            for samples in regrouped([log.samples], self.chunk_rows):
                thinned.add(samples)
                yield samples
            return
        survey = LogSurvey()
        for samples in self._samples(log, survey):
            self.remarks.extend(f"{log}: {remark}" for remark in samples.remarks)
            thinned.add(samples)
            yield samples
        self.remarks.extend(f"{log}: {remark}" for remark in against_limits(survey, self.model.robot))
        self.units_are_suspect |= bool(survey.unit_remarks())

    def _require_joints(self, given: GivenSamples) -> None:
        robot, count = self.model.robot, given.samples.joint_count
        if count != robot.dof:
            raise InputError(
                f"{given} has samples of {count} joints, but {robot.name} has {robot.dof} "
                f"({', '.join(robot.joint_names)}); give one column for each of them, in this order."
            )

    def dense(self, log: GivenLog, rows: int) -> Samples | None:
        """Return samples of the middle of a log at its own rate; None where it is hardly longer than half of that."""
        if isinstance(log, GivenSamples):
            start = max(0, (log.samples.count - rows) // 2)
            return log.samples.rows(start, start + rows) if log.samples.t is not None else None
        recording = read_middle(log, self.columns, self.processing, rows, list(self.model.robot.joint_names))
        # Filters and masks need the ends of the log; what is read is its middle.
        return recording.process(self.processing, self.model) if recording.count > rows // 2 else None

    def _note_columns(self, log: str, layout: Layout | None) -> None:
        """Keep what the columns of a log were understood to be."""
        if layout is not None:
            robot = self.model.robot
            layout = layout.with_sliding([not robot.joints[i].rotates for i in robot.driving_joints])
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

    def _samples(self, log: str | Path | LogFile, survey: LogSurvey) -> Iterator[Samples]:
        joints = list(self.model.robot.joint_names)

        def look(recording: Recording) -> None:
            self._note_columns(str(log), recording.layout)
            handled = [option for option in DETECTORS if getattr(self.processing, option) is not False]
            part = f" (Seen in the first {recording.count} rows.)" if recording.count == chunks.CHOICE_ROWS else ""
            self.remarks.extend(f"{log}: {sentence}{part}" for sentence in faulty_rows(recording, handled))
            against_limits(LogSurvey.of(recording), self.model.robot)  # what is sure to be wrong is refused at once

        if self.processing.needs_whole_log:
            recording = Recording.read(log, self.columns, joints)
            look(recording)
            survey.add(recording)
            yield recording.process(self.processing, self.model)
        else:
            yield from process_chunks(
                log, self.columns, self.processing, self.chunk_rows, joints, self.model, look, survey
            )


def against_limits(survey: LogSurvey, robot: Robot) -> tuple[str, ...]:
    """Compare a log with what the joints of a robot can do; see `steelyard.Recording.check_against`."""
    driving = [robot.joints[i] for i in robot.driving_joints]
    limits = [[getattr(joint, key) for joint in driving] for key in ("lower", "upper", "velocity_limit")]
    return survey.limit_remarks(*limits)


class ThinnedSamples:
    """Every k-th sample of a stream, with k doubling as the stream grows."""

    def __init__(self, points: int) -> None:
        self.points = points
        self.every, self.seen = 1, 0
        self.model: Model | None = None
        self.parts: list[tuple[NDArray[Any], ...]] = []

    def add(self, samples: Samples) -> None:
        """Add the samples that follow."""
        count = samples.count
        start = -self.seen % self.every
        rows = slice(start, count, self.every)
        t = np.arange(self.seen, self.seen + count, dtype=float) if samples.t is None else samples.t
        mask = np.ones(samples.q.shape, dtype=bool) if samples.mask is None else samples.mask
        part = [t[rows], samples.q[rows], samples.dq[rows], samples.ddq[rows], samples.torque[rows], mask[rows]]
        if samples.regressor is not None:  # of all the samples of a log, or of none
            part.append(samples.regressor[rows])
        self.model = samples.regressor_model
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
        """(S,) s."""
        return np.concatenate([p[0] for p in self.parts])

    @property
    def samples(self) -> Samples:
        """What was kept."""
        t, q, dq, ddq, torque, mask, *rest = (np.concatenate(columns) for columns in zip(*self.parts, strict=True))
        return Samples(
            q=q,
            dq=dq,
            ddq=ddq,
            torque=torque,
            mask=None if mask.all() else mask,
            t=t,
            regressor=rest[0] if rest else None,
            regressor_model=self.model,
        )
