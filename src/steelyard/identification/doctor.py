"""Examination of a recording: what is wrong with it, and which lines of robot.toml mend it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import capital
from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.estimators.marginal_likelihood import body_priors
from steelyard.files import listed
from steelyard.recording import DelayEstimate, LogColumns, LogFile, Processing, Recording, choose_cutoff, estimate_delay
from steelyard.recording.clock import FEWEST_ROWS, ClockStatistics, clock_of
from steelyard.recording.columns import TIME_UNITS
from steelyard.recording.correction import Settings, toml_inline
from steelyard.recording.cutoff.by_spectra import noise_share
from steelyard.recording.diagnosis import DETECTORS, Diagnosis
from steelyard.recording.diagnosis.rest import HeldJoints
from steelyard.recording.even import EvenClock, evened, longest_part
from steelyard.recording.formats import LogFiles
from steelyard.recording.log_sample import LogSample, sample_of
from steelyard.recording.logged_joints import locked_that_move, logged_joints
from steelyard.recording.options import AUTO
from steelyard.recording.recognition import Layout
from steelyard.recording.survey import LogSurvey
from steelyard.regression import Estimate, Information, least_squares
from steelyard.regression.body_change import BodyChange
from steelyard.regression.drift import FrictionDrift, drift_sentence, friction_drifts
from steelyard.regression.factor import column_lengths
from steelyard.regression.reduction import empty_factors, errors_of
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import Robot, RobotFile
from steelyard.robot.description import read_description

from .default_terms import rotors_of_log
from .doubts import mistakes_in_logs
from .examination import HARMS, Examination, Finding, Harm, merged, stated_remedy
from .given import GivenLog, GivenRobot, GivenSamples, One, given_constraints, given_logs, given_robot, wider_model
from .late_logs import LateLog, late_hypotheses, late_logs
from .log_reader import DRAWN_ROWS, LogReader, LogTask, ReducedLog, against_limits
from .prediction_verdict import few_rows_of, said_of
from .reduced_logs import SHORTEST_DRIFT, change_in_log
from .unlogged_torques import told_by_unlogged_torques
from .wrong_scale import scale_by_description

__all__ = ["examine"]

Array = NDArray[np.float64]
MOST_REMEDIES = 20
"""Remedies, one after the other, with which a log is tried to be read; each mends one fault."""
POINTS = 1200  # samples that are kept of a log, of which mistakes are looked for in some hundreds
COUNTS = 200.0
"""Steps of the encoder over a joint's travel, below which steps and not motion make the accelerations."""
NOISY = 0.1
"""Part of the power of a joint's accelerations that may be noise of its positions: its inertia becomes as much too
small. The cutoff that the data chooses keeps the median of the joints below 0.01; single joints of sound logs have
0.06."""
COARSE = 0.1
"""Step of the torques over their standard deviation: a tenth adds 3 % of noise."""
TWO_RATES = 0.1
"""Share of the rows that seem to be missing one at a time, from which the log may have two rates: a servo was read
every 5.3 ms while it was driven, and every 3.5 ms while it was not."""
LONGEST_DELAY = 0.05  # s, up to which delays are looked for where no longer one is supposed
LOUD = 0.5
"""Noise of the torques over their standard deviation. On simulated and real arms joints with small torques come to
0.49, and are identified well."""
DELAY_GAIN = 0.05
"""Part of the residual that falls where a delay is taken out, at least: a KUKA KR300 whose joints stick seems to be
late by 23 ± 7 ms, and 3 % fall. Delays of whole rows that were planted take a fifth and more."""
HALF = 0.5
"""Part of the error of the torques that a unit may leave to be believed: the wrong one explains next to nothing."""
BLIND_GAIN = 0.2
"""The same without a robot, where products of sines stand in for its model: they gained up to 4 % on sound logs."""
OVERFITTED = 1.75
"""Error of least squares on stretches that are left out in turn, over that on the whole log (geometric mean of the
joints). Sound logs, simulated and real, have 1.01 to 1.46, runs of a few s that do not show an arm 2.07 to 3.75.
Condition numbers tell less: a sound log of a light arm has 7650, and a KUKA KR300 that is shown poorly 5450."""
MOSTLY_WEAK = 0.6
"""Part of the base parameters that may be weak, by standard errors that allow for errors that last. Logs of eleven
simulated arms have 0.3 to 0.5, a UR10 0.55 and a TX40 0.58; short runs of a Gen3 and single motions of a KUKA KR300
0.69 to 0.74."""
HARDLY_SHOWN = 1e6
"""Condition number, with columns of length one, from which some combination of base parameters shows in next to
nothing, however few of them are weak: sound logs have 4 to 10, and joints that all move alike 3e8."""
STRETCHES = 5
CLIPPED = 0.01
"""Share of a joint's rows whose torque is clipped, or stands still, from which the answer is wrong, not only worse."""
MOST_NAMED = 6
WARM_UP = (
    "Warm the robot up before the log begins, or log a temperature and take the term friction_by_channel in the place "
    "of viscous and coulomb; the column of time may stand for a temperature."
)
_KINDS = {"missing": "missing values", "exclude_joints": "stuck torque", "velocity": "measured velocity"}
_REST_OF_STAMPS = 1e8  # s; stamps beyond it count from 1970


@in_one_thread
def examine(
    log: One,
    robot: GivenRobot | None = None,
    *,
    topic: str | Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Examination:
    """Look for everything that is wrong with a recording, and for what mends it.

    The log is read as `identify` reads it. A fault for which it would be refused becomes a finding, its remedy is
    applied, and the reading goes on, so that all faults are found at once. What robot.toml already deals with is no
    finding. With a robot, its model also says whether torques and motion belong together, and what the motion shows.

    Parameters
    ----------
    log : path, Recording, data frame or mapping of arrays
        As `identify` takes it; files recorded side by side are joined by ``+``.
    robot : str, Path, RobotFile, Robot or Model, optional
        A description, or a robot.toml, whose sections [log] and [processing] count.
    topic : str or sequence of str, optional
        Of a bag, in place of `topic` in [log].
    progress : callable, optional
        Called with a few words before each step.

    Raises
    ------
    InputError
        If the robot or the log cannot be used, and nothing that could be written into robot.toml mends that.

    Examples
    --------
    >>> import tempfile
    >>> t = np.arange(4000) / 1000
    >>> torque = np.clip(8 * np.sin(5 * t), -6.0, 6.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Recording(t=t, q=np.sin(2 * t)[:, None], torque=torque[:, None]).save(Path(folder) / "sine.csv")
    ...     found = examine(path)
    >>> [(one.kind, one.toml) for one in found.findings]
    [('saturation', '[processing]\\nsaturation = true')]
    """
    given = given_logs(log, None)[0]
    if len(given) != 1 or isinstance(given[0], GivenSamples):
        raise InputError(
            "One log at a time is examined, as it was recorded; give its path, a Recording or its columns."
        )
    stated: Settings = {"log": {"topic": topic if isinstance(topic, str) else list(topic)}} if topic else {}
    return _Patient(given[0], robot, stated, progress or (lambda _: None)).examined()


@dataclass(frozen=True, eq=False)
class _Fit:
    """Least squares by the model, and what they were made of."""

    reader: LogReader
    log: ReducedLog
    estimate: Estimate
    stretches: tuple[Information, ...]
    change: BodyChange | None
    drifts: tuple[FrictionDrift, ...]

    def late(self, log: GivenLog) -> list[LateLog]:
        """Tell whether the torques are late, as `identify` does."""
        errors = [errors_of(self.reader.model, window, self.estimate.base) for window in self.log.drawn.windows]
        return late_logs(self.reader, [log], [self.log], self.log.information, [errors], self.estimate)

    def overfitting(self) -> float | None:
        """Error on stretches that are left out in turn, over that on the whole log; None where the log is too short."""
        if len(self.stretches) < STRETCHES:
            return None
        within = np.array([factor.residual2(self.estimate.base) for factor in self.log.information.factors])
        beyond = Information.held_out_squares(self.stretches, lambda others: least_squares(others, "joint").base)
        told = (within > 0.0) & (beyond > 0.0)
        return float(np.exp(0.5 * np.mean(np.log(beyond[told] / within[told])))) if told.any() else None


class _Patient:
    """A log that is being examined: its findings so far, and the settings with which it is read."""

    def __init__(
        self, log: str | Path | LogFile, robot: GivenRobot | None, given: Settings, say: Callable[[str], None]
    ) -> None:
        self.file: RobotFile | None = None
        self.model: Model | None = None
        if robot is not None:
            self.file, self.model = given_robot(robot)
        file = self.file
        self.log, self.say = log, say
        own = {} if file is None else {name: file.section(name) for name in ("log", "processing")}
        self.stated = merged(own, given)
        self.settings: Settings = merged({}, self.stated)
        self.findings: list[Finding] = []
        self.facts: dict[str, str] = {}
        self.sample: LogSample | None = None
        self.late: list[LateLog] = []

    @property
    def _robot(self) -> Robot | None:
        """The robot that was logged, where it is known."""
        return None if self.model is None else self.model.robot

    @property
    def joints(self) -> tuple[str, ...] | None:
        """The names of its joints."""
        return None if self._robot is None else self._robot.joint_names

    @property
    def columns(self) -> LogColumns:
        """[log] with the remedies so far."""
        columns = LogColumns.from_dict(self.settings.get("log", {}), "[log]")
        return columns if self.model is None else columns.of_joints(self.model.robot.position_units)

    @property
    def processing(self) -> Processing:
        """[processing] with the remedies so far."""
        return Processing.from_dict(self.settings.get("processing", {}), "[processing]")

    def add(self, finding: Finding, used: bool = True) -> None:
        """Take a finding down, and use its remedy from now on."""
        self.findings.append(finding)
        if used:
            self.settings = merged(self.settings, finding.remedy)

    def _refuse(self, kind: str, statement: str, share: float, advice: str) -> bool:
        """Take down what no line of robot.toml mends; False, since the log cannot be used as it is."""
        self.add(Finding(kind, statement, "refused", share, advice=advice))
        return False

    @property
    def remedies(self) -> Settings:
        """The lines of all findings; those of findings that change the columns come last."""
        found: Settings = {}
        for finding in sorted(self.findings, key=lambda one: one.kind == "held joint"):
            found = merged(found, finding.remedy)
        return found

    def examined(self) -> Examination:
        """Examine the log."""
        self.say("reading the log")
        files = LogFiles(self.log, self.columns)
        layout = self._layout(files)
        if self.model is not None:
            layout = layout.of_joints(self.model.robot.position_units)
        self.layout = layout
        name = files.name
        self.sample = sample_of(files, layout)
        if self.sample is not None:
            self.facts["looked at"] = str(self.sample)
        if not self._stamps_can_be_used(files, layout):
            return self._result(name, layout)
        if self.model is not None:
            moving = locked_that_move(self.log, self.columns, layout, self.model.robot)
            if moving:
                self.add(Finding("locked joint", moving.statement, "wrong", 1.0, advice=moving.advice))
        if self.sample is not None:
            self.log = self.sample.middle
            self._elsewhere(self.sample)
        recording = self._read()
        survey = LogSurvey.of(recording)
        diagnosis = recording.diagnose()
        clock = self._clock(recording, self._whole_clock(diagnosis.clock))
        for statement in survey.jump_remarks():
            advice = "Cut the log there, and give the pieces that are right as logs of their own; filters spread jumps."
            self.add(Finding("position jumps", statement, "wrong", 1.0, advice=advice))
        self._signals(recording, diagnosis)
        suspect = self._units(survey)
        information = None
        if self.model is not None and self.file is not None:
            information = self._with_model(recording, survey, diagnosis, suspect)
        else:
            for finding in suspect:
                self.add(finding)
        if suspect:
            recording = self._read()  # what follows is measured in the right units
            diagnosis = recording.diagnose()
            clock = self._whole_clock(diagnosis.clock)
        heads, rows = self._measures(recording, diagnosis)
        if not any(one.harm == "wrong" for one in self.findings):
            self._delay(recording)
        self._transmissions(recording)
        self._tell(recording, clock, layout)
        return self._result(name, layout, heads, rows, recording, information)

    def _layout(self, files: LogFiles) -> Layout:
        """Find the columns; joints of a bare description of which the log has none are taken to be held."""
        try:
            return files.layout(self._robot)
        except InputError:
            if self.file is None or self.joints is None or not self.file.robot.source or "tip" in self.file.description:
                raise
            if self.file.path.suffix.lower() == ".toml" or not self.file.path.is_file():
                raise
            found = logged_joints(files, self.joints)
            locked = list(found.others)
            statement = f"The log says nothing of {', '.join(locked)}: {found.reason}."
            remedy: Settings = {"description": {"locked": locked}}
            self.add(Finding("joints without columns", statement, "refused", 1.0, remedy), used=False)
            robot = read_description(self.file.path, None, locked)
            self.file = replace(self.file, robot=robot, description={**self.file.description, "locked": locked})
            self.model = Model.from_file(self.file)
            return files.layout(self._robot)

    def _result(
        self,
        name: str,
        layout: Layout,
        heads: tuple[str, ...] = (),
        rows: tuple[tuple[str, ...], ...] = (),
        recording: Recording | None = None,
        information: Information | None = None,
    ) -> Examination:
        order = list(HARMS)
        findings = sorted(self.findings, key=lambda one: (order.index(one.harm), -one.weight))
        return Examination(
            name, tuple(findings), self.remedies, self.facts, heads, rows, layout, recording, information
        )

    def _time(self) -> Settings:
        """Name the column of time, without which a rate is all that is known: rows may be missing."""
        assert self.layout is not None
        return {key: value for key, value in self.layout.settings().items() if key in ("time", "time_unit")}

    # Reading

    def _stamps_can_be_used(self, files: LogFiles, layout: Layout) -> bool:
        """Look at the stamps as they stand in the log; False where nothing in robot.toml makes them usable."""
        if layout.time is None:
            self.facts["stamps"] = "none; the rate is stated"
            return True
        sample = self.sample
        t = layout.seconds(files.read(layout.stamps)) if sample is None or sample.t is None else sample.t
        if len(t) < FEWEST_ROWS or not np.isfinite(t).all():
            return True
        if abs(t[0]) > _REST_OF_STAMPS:
            self.facts["stamps"] = f"count from 1970 ({_day(float(t[0]))})"
        steps = np.diff(t)
        if self.columns.rate is not None or (steps > 0.0).all():
            return True
        repeated, back = np.count_nonzero(steps == 0.0), np.count_nonzero(steps < 0.0)
        rate = _rate_behind(t)
        if rate is None and not back:
            row = int(np.argmax(steps == 0.0)) + 1
            statement = (
                f"{files.name}, {files.where(row)}, repeats the time {t[row]:.9g} s of the row before "
                f"({repeated} rows do so)."
            )
            advice = "Write the stamps with more digits, or state `rate` in [log] if the rows come evenly."
            return self._refuse("repeated stamps", statement, repeated / len(t), advice)
        if rate is None:
            row = int(np.argmax(steps < 0.0)) + 1
            statement = (
                f"{files.name}, {files.where(row)}, goes back in time from {t[row - 1]:.9g} s to {t[row]:.9g} s "
                f"({back} rows do so)."
            )
            advice = f"Split the log before {files.where(row)}, where a new run begins, or sort its rows."
            return self._refuse("stamps that go back", statement, back / len(t), advice)
        raw = files.read(layout.names) if sample is None else sample.middle.read(layout.names)
        others = [raw[name] for name in layout.names if name not in layout.stamps]
        same = np.flatnonzero(np.diff(layout.seconds(raw)) == 0.0)
        copies = np.all([column[same + 1] == column[same] for column in others], axis=0) if len(same) else np.zeros(1)
        if repeated and copies.mean() > 0.5 and repeated < 0.5 * len(t):
            statement = (
                f"{repeated} rows of {files.name} repeat the row before, its stamp included, the first in "
                f"{files.where(int(np.argmax(steps == 0.0)) + 1)}."
            )
            advice = "Remove the rows that repeat the time of the row before; they were written twice."
            return self._refuse("rows written twice", statement, repeated / len(t), advice)
        what = [f"{repeated} repeat the one before"] if repeated else []
        what += [f"{back} go back"] if back else []
        statement = (
            f"Of the {len(t)} stamps of {files.name} {' and '.join(what)}: they are rounded or unsteady, and on the "
            f"whole the rate is {rate:.6g} Hz."
        )
        self.add(Finding("repeated stamps", statement, "refused", 1.0, {"log": {**self._time(), "rate": rate}}))
        return True

    def _read(self) -> Recording:
        """Read the log; what it would be refused for becomes findings, as long as a line of robot.toml mends it."""
        for _ in range(MOST_REMEDIES):
            try:
                recording = Recording.read(self.log, self.columns, self._robot)
                if self.model is not None:
                    against_limits(LogSurvey.of(recording), self.model.robot)
                travel = np.ptp(recording.q, axis=0)
                lowest, highest = recording.torque.min(axis=0), recording.torque.max(axis=0)
                self.processing.check_torques(recording, lowest, highest, travel)
                return recording
            except InputError as error:
                remedy = stated_remedy(str(error))
                if not remedy or merged(self.settings, remedy) == self.settings:
                    raise
                self.add(Finding(_kind_of(remedy), str(error), "refused", 1.0, remedy))
        return Recording.read(self.log, self.columns, self._robot)

    # What needs nothing but the log

    def _clock(self, recording: Recording, clock: ClockStatistics) -> ClockStatistics | None:
        """Look at the clock: uneven stamps and missing rows."""
        if self.columns.rate is not None:
            return None
        rate = 1.0 / clock.period
        jitter = clock.irregularities.get("jitter", "")
        if clock.verdict == "even clock":
            remedy: Settings = {"log": {**self._time(), "rate": _round_rate(rate, 1e-4)}}
            self.add(Finding("jitter", jitter, "worse", clock.largest, remedy))
        elif clock.verdict == "stamps" and "resample" not in self.settings.get("processing", {}):
            remedy = {"processing": {"resample": True}}
            statement = f"{jitter} The positions are interpolated to an even clock, which costs some of the bandwidth."
            self.add(Finding("jitter", statement, "worse", clock.largest, remedy))
        elif jitter:
            self.facts["jitter"] = jitter
        if clock.pauses.any():
            self.facts["pauses"] = clock.irregularities["pauses"]
        if clock.missing and "longest_gap" not in self.settings.get("processing", {}):
            self._gaps(recording, clock)
        return clock

    def _whole_clock(self, clock: ClockStatistics) -> ClockStatistics:
        """Return the clock of the whole log, by that of what was looked at."""
        t = self._whole_time()
        if t is None or self.columns.rate is not None or not np.isfinite(t).all():
            return clock
        return replace(clock_of([t]), share=clock.share, share_deviation=clock.share_deviation)

    def _whole_time(self) -> Array | None:
        """Return the stamps of all rows of a long log, s from the first, in the unit that is known by now."""
        assert self.layout is not None
        if self.sample is None or self.sample.t is None:
            return None
        unit = self.columns.time_unit
        known = self.layout.time_rest is not None or unit is None
        t: Array = self.sample.t - self.sample.t[0]
        return t if known else t * (TIME_UNITS[str(unit)] / TIME_UNITS[self.layout.time_unit])

    def _gaps(self, recording: Recording, clock: ClockStatistics) -> None:
        even = EvenClock(clock, self.processing.resample or True, None, True, recording.source)
        parts = 1 if even.as_is else len(even.parts)
        statement = clock.irregularities["gaps"]
        share = clock.missing / (clock.count + clock.missing)
        if share > TWO_RATES and np.median(clock.skipped) < 1.5:
            statement = (
                f"{len(clock.gaps)} of {clock.count - 1} intervals between stamps are about twice as long as the "
                "others: every so often a row is missing, or the rate changes within the log."
            )
        if parts == 1:
            longest = float(np.ptp(clock.gaps, axis=1).max())
            remedy: Settings = {"processing": {"longest_gap": float(f"{1.01 * longest:.3g}")}}
            statement += " Gaps as short are filled for the filters, and their rows are not used."
            self.add(Finding("gaps", statement, "worse", share, remedy))
            return
        statement += f" The log falls into {parts} parts, and the filters spoil both ends of each."
        advice = "Record again without gaps (a buffered logger, a lower rate), or use the log as it is."
        self.add(Finding("gaps", statement, "worse", share, advice=advice))

    def _elsewhere(self, sample: LogSample) -> None:
        """Look for faulty rows in the stretches of a long log that are not examined otherwise."""
        if sample.incomplete and self.columns.missing != "fill":
            statement = (
                f"In {sample.incomplete} of the {sample.count} rows a position or a torque is no finite number; "
                '`missing = "fill"` in [log] fills them for the filters, and their rows are not used.'
            )
            share = sample.incomplete / sample.count
            self.add(Finding("missing values", statement, "refused", share, {"log": {"missing": "fill"}}))
        for stretch in sample.others:
            try:
                recording = Recording.read(stretch, self.columns, self._robot)
            except InputError:  # what the middle shows, too, is found there
                continue
            self._faulty_rows(recording.diagnose(), f" (Seen in rows {stretch.rows}.)", self._before_fit)

    def _faulty_rows(
        self,
        diagnosis: Diagnosis,
        where: str = "",
        options: Collection[str] = DETECTORS,
        slowest: NDArray[np.float64] | None = None,
    ) -> None:
        """Look at rows that would harm a regression, and that no option of [processing] handles by now."""
        handled = [option for option in DETECTORS if getattr(self.processing, option) is not False]
        for option, sentences in diagnosis.faults(handled, slowest).items():
            if option not in options:
                continue
            share = float(getattr(diagnosis, option).flags.mean(axis=0).max())
            harm: Harm = "wrong" if option in ("saturation", "stuck_torque") and share > CLIPPED else "worse"
            remedy: Settings = {"processing": {option: True}}
            self.add(Finding(option, " ".join(sentences) + where, harm, share, remedy))

    @property
    def _before_fit(self) -> set[str]:
        """Detectors of faulty rows that wait for no fit: whether a joint that rests harms one, its filter decides.

        Rows in which a joint with Coulomb friction waits are left out unasked. On 16 simulated pick-and-place logs of
        four robots whose joints were told to stick, leaving them out changed no interval and no error for the worse.
        """
        decides = self.model is not None and self.file is not None and self.processing.velocity_threshold == AUTO
        return set(DETECTORS) - ({"stiction"} if decides else set())

    def _signals(self, recording: Recording, diagnosis: Diagnosis) -> None:
        """Look at rows that would harm a regression, at joints that do not move, and at coarse or noisy channels."""
        self._faulty_rows(diagnosis, options=self._before_fit)
        held = HeldJoints.of(recording)
        if held.mask.all():
            statement = f"{recording.source}: no joint moves by more than the noise of its position."
            self.add(Finding("no motion", statement, "refused", 1.0, advice="Record a motion of the robot."))
            return
        if held.mask.any():
            self._held(recording, held)
        for j in np.flatnonzero(~held.mask & (diagnosis.position_resolution > 0.0)):
            counts = float(np.ptp(recording.q[:, j]) / diagnosis.position_resolution[j])
            if counts < COUNTS:
                statement = (
                    f"{capital(recording.joint_label(int(j)))} moves over {counts:.0f} steps of its encoder "
                    f"({diagnosis.position_resolution[j]:.3g}), too few for its accelerations."
                )
                advice = "Move the joint farther, or log its position with more digits."
                self.add(Finding("resolution", statement, "worse", 1.0 / counts, advice=advice))
        spread = recording.torque.std(axis=0)
        for j in np.flatnonzero(spread > 0.0):
            step, noise = diagnosis.torque_resolution[j] / spread[j], diagnosis.torque_noise[j] / spread[j]
            label = recording.joint_label(int(j))
            if step > COARSE:
                size = diagnosis.torque_resolution[j]
                statement = f"The torque of {label} has steps of {size:.3g}, {step:.0%} of its spread."
                advice = "Log the torque with more digits, or move so that it changes more."
                self.add(Finding("torque resolution", statement, "worse", float(step), advice=advice))
            elif noise > LOUD:
                size = diagnosis.torque_noise[j]
                statement = f"{capital(label)} has noise of {size:.3g} on its torque, {noise:.0%} of its spread."
                advice = "Record for longer, or move the joint faster and farther."
                self.add(Finding("torque noise", statement, "worse", float(noise), advice=advice))

    def _held(self, recording: Recording, held: HeldJoints) -> None:
        """Joints that do not move are locked where a description says what they carry."""
        told = [f"{reason}." for reason in held.reasons(recording)]
        told.append(
            "If it did move, its encoder is dead or `position` in [log] names a wrong column: mend that in the place "
            "of locking it, which would weigh the links wrongly."
        )
        remedy = self._locked(recording, held)
        advice = "" if remedy else "Record a motion of it, or lock it with `locked` in [description]."
        share = float(held.mask.mean())
        # The log is examined as it is: with the joint locked the robot would be another one.
        self.add(Finding("held joint", " ".join(told), "worse", share, remedy, advice), used=False)

    def _locked(self, recording: Recording, held: HeldJoints) -> Settings:
        """Lock joints where they are, and read the columns of the others; empty where [log] counts joints otherwise."""
        lists = [value for table in self.settings.values() for key, value in table.items() if isinstance(value, list)]
        plain = all(len(value) != recording.joint_count or isinstance(value[0], str) for value in lists)
        matrices = {"position_matrix", "torque_matrix", "position_offset"} & self.settings.get("log", {}).keys()
        if self.file is None or self.joints is None or matrices or not plain:
            return {}
        before = self.file.description.get("locked", {})
        locked = dict.fromkeys(before, 0.0) if isinstance(before, list | tuple) else dict(before)
        places = map(int, np.flatnonzero(held.mask))
        locked |= {self.joints[j]: float(f"{held.position[j]:.6g}") for j in places}
        log: dict[str, Any] = {}
        for kind in ("position", "velocity", "acceleration", "torque"):
            names = getattr(self.layout, kind)
            if names is not None and len(names) == len(held.mask):
                kept = [k for k in range(len(names)) if not held.mask[k]]
                log[kind] = [names[k] for k in kept]
                units = self.settings.get("log", {}).get(f"{kind}_unit")
                if isinstance(units, list):
                    log[f"{kind}_unit"] = [units[k] for k in kept]
        return {"description": {"locked": locked}, "log": log}

    def _units(self, survey: LogSurvey) -> list[Finding]:
        """Return what the sizes of positions, speeds and the rate say of units."""
        return [
            Finding(_kind_of(remedy), one, "wrong", 1.0, remedy, "" if remedy else "Check units and gear ratios.")
            for one in survey.unit_remarks()
            for remedy in [stated_remedy(one)]
        ]

    # What needs the model

    def _with_model(
        self, recording: Recording, survey: LogSurvey, diagnosis: Diagnosis, suspect: Sequence[Finding]
    ) -> Information | None:
        """Look for mistakes by the robot's model, and at what the motion shows."""
        assert self.file is not None
        assert self.model is not None
        self.say("does the model explain the torques?")
        if self.columns.finds_gains:
            self.facts["model"] = "drive gains are to be found, so that torques were not compared with the model"
            self._faulty_rows(diagnosis, options=set(DETECTORS) - self._before_fit)
            return None
        try:
            fit = self._fit()
        except InputError as error:
            advice = "Record a longer motion, or state what the message names."
            self.add(Finding("processing", str(error), "refused", 1.0, stated_remedy(str(error)), advice), used=False)
            return None
        unsure = []
        for finding in suspect:
            better = self._better_with(finding, fit)
            if better is None:
                unsure.append(finding)
            else:
                fit = better
                self.add(finding)
        fit = self._with_rotors(fit)
        information, estimate = fit.log.information, fit.estimate
        if information.count <= information.base_count:
            statement = f"The log leaves {information.count} rows for {information.base_count} base parameters."
            self.add(Finding("too few rows", statement, "refused", 1.0, advice="Record a longer motion."))
            return None
        slowest = fit.reader.processing.for_joints("velocity_threshold", recording)
        self._faulty_rows(diagnosis, options=set(DETECTORS) - self._before_fit, slowest=slowest)
        name = str(self.log)
        if fit.change is not None:
            statement = f"{fit.change.sentence(name)} The line below keeps the longer part; {fit.change.weighing()}"
            remedy: Settings = {"processing": {"trim": fit.change.trim}}
            self.add(Finding("robot changes", statement, "wrong", 1.0, remedy), used=False)
            for finding in unsure:
                self.add(finding)
        else:
            self._mistakes(name, fit, recording, survey, unsure)
        self.facts["model"] = (
            f"least squares leave {estimate.relative_error:.2%} of the torques; condition number "
            f"{information.condition_number:.4g} with {information.base_count} base parameters"
        )
        self._noise(recording, fit.reader.processing)
        return information

    def _mistakes(
        self, name: str, fit: _Fit, recording: Recording, survey: LogSurvey, unsure: Sequence[Finding]
    ) -> None:
        """Look for mistakes in the log of one robot, and without them at what the motion shows."""
        assert self.model is not None
        reader, information, estimate, file = fit.reader, fit.log.information, fit.estimate, self._file()
        worst = float(np.nanmax(information.joint_relative_error(estimate.base), initial=estimate.relative_error))
        priors, samples = body_priors(self.model, given_constraints(file)), {name: fit.log.samples}
        found = mistakes_in_logs(reader, file, priors, {name: self.log}, samples, {name: worst}, self.say).get(name, ())
        layout = reader.layouts.get(name)
        scale = scale_by_description(self.model, [fit.log.samples], file, layout)
        if scale is not None and found and scale.outweighs(found[0]):
            found = ()
        for hypothesis in found[:1]:
            others = "".join(
                f" Or: {one.statement} ({one.evidence}): {toml_inline(one.settings)}." for one in found[1:]
            )
            statement = f"{hypothesis.statement}: with the line below {hypothesis.evidence}.{others}"
            harm: Harm = "worse" if hypothesis.kind in ("delay", "term", "payload", "terms") else "wrong"
            self.add(Finding(hypothesis.kind, statement, harm, hypothesis.error_before, hypothesis.settings))
        if not found or found[0].kind == "delay":  # which the least residual may not confirm
            self.late = fit.late(self.log)
        if not found:
            for finding in unsure:
                self.add(finding)
            self._beyond_limits(survey)
            if scale is not None:
                weight, kind = abs(float(np.log(scale.factor))), f"{scale.of.removesuffix('s')} scale"
                right = f"If the description is right, {toml_inline(scale.settings)} mends it."
                self.add(Finding(kind, scale.sentence, "wrong", weight, advice=right if scale.settings else ""))
            self._excitation(fit)
            self._events(name, fit)
            if fit.drifts and recording.duration >= SHORTEST_DRIFT:
                largest = fit.drifts[0]
                told = drift_sentence(name, fit.drifts, self.model.robot.joint_names)
                weight = abs(largest.last - largest.first)
                self.add(Finding("friction drift", told, "worse", weight, advice=WARM_UP))

    def _fit(self, further: Settings | None = None) -> _Fit:
        """Fit the model to the log with the remedies so far, and further settings."""
        assert self.model is not None
        reader = LogReader(self._file(further), self.model)
        reader.decide([self.log], self.say)
        log = reader.reduced(LogTask(self.log, POINTS, DRAWN_ROWS, 1, True), self.model)
        reader.note(log)
        blocks = TimeBlocks.of_held(empty_factors(self.model), log.blocks)
        stretches = log.information.stretches(blocks, STRETCHES)
        change = change_in_log(self.model, blocks, log.drawn.samples)
        drifts = () if change else friction_drifts(blocks, self.model.base_parameters().names)
        return _Fit(reader, log, least_squares(log.information, "joint"), stretches, change, drifts)

    def _with_rotors(self, fit: _Fit) -> _Fit:
        """Fit with the inertia of rotors where nobody states terms and the log shows it, as `identify` does unasked."""
        assert self.model is not None
        wider = wider_model(self._file(), self.model)
        if wider is None:
            return fit
        decision = rotors_of_log(fit.reader, self.log, wider, POINTS)
        if not decision.taken:
            return fit
        self.model = wider
        self.facts["rotors"] = f"the model has the inertia of a rotor at every joint: {decision.reason}"
        return self._fit()

    def _better_with(self, finding: Finding, before: _Fit) -> _Fit | None:
        """Fit the model with the remedy of a finding that the motion alone suggests; None where that does not help."""
        if not finding.remedy:
            return None
        try:
            fit = self._fit(finding.remedy)
        except InputError:
            return None
        return fit if fit.estimate.relative_error < HALF * before.estimate.relative_error else None

    def _beyond_limits(self, survey: LogSurvey) -> None:
        """Tell what goes beyond the limits of the description; find_mistakes has found no unit or order to blame."""
        assert self.model is not None
        for sentence in against_limits(survey, self.model.robot):
            advice = "Check the limits of the description, the zero of the joint, and the order of the columns."
            self.add(Finding("limits", sentence, "worse", 0.0, advice=advice))

    def _events(self, name: str, fit: _Fit) -> None:
        """Tell of few rows that hold much of the error, as where the arm ran into a stop."""
        assert self.model is not None
        few = few_rows_of(name, "identification", fit.log.information, self.model, fit.estimate.base, fit.log.drawn)
        if few:
            advice = 'Empty the torques of these moments in the log, and state missing = "fill" in [log].'
            self.add(Finding("few rows", said_of(few), "worse", few[0].relative_error, advice=advice))

    def _excitation(self, fit: _Fit) -> None:
        """Say whether the motion shows the robot: by the error on stretches that are left out, and by what is weak."""
        information = fit.log.information
        unlogged = told_by_unlogged_torques(fit.reader.model, information)  # no motion shows these
        errors = dict(zip(fit.estimate.base_expressions, fit.estimate.relative_standard_error, strict=True))
        weak = [name for name in fit.estimate.weak if name not in unlogged]
        count, unseen = information.base_count, [name for name in information.unidentifiable if name not in unlogged]
        reasons = []
        if unseen:
            reasons.append(f"{len(unseen)} of {count} base parameters are not determined at all")
        ratio = fit.overfitting()
        if ratio is not None and ratio > OVERFITTED:
            reasons.append(
                f"least squares predict stretches that are left out with {ratio:.2g} times the error on the whole log"
            )
        if len(weak) > MOSTLY_WEAK * count:
            reasons.append(f"{len(weak)} of {count} base parameters are smaller than twice their standard error")
        if not reasons and not unlogged:
            columns = information.reduced(None).R
            shown = np.linalg.svd(columns / column_lengths(columns), compute_uv=False)
            if shown[0] > HARDLY_SHOWN * shown[-1]:
                reasons.append("a combination of base parameters hardly shows at all")
        if not reasons:
            return
        order = [*unseen, *sorted((name for name in weak if name not in unseen), key=lambda name: -errors[name])]
        named = listed(order, MOST_NAMED) if order else ""
        statement = (
            f"The motion shows the robot poorly: {', and '.join(reasons)} (condition number "
            f"{information.condition_number:.4g}).{f' Weakest are {named}.' if named else ''}"
        )
        file = self.file
        described = None if file is None else file.path if file.path.is_file() else file.robot.source
        advice = f"`steelyard excite {described or 'ROBOT'} --output excitation` designs a motion that shows them."
        self.add(Finding("excitation", statement, "worse", len(weak) / count, advice=advice))

    def _noise(self, recording: Recording, processing: Processing) -> None:
        """Compare the cutoff with the noise of the positions."""
        cutoff = processing.cutoff
        if not isinstance(cutoff, float) or not cutoff < 0.5 * recording.rate:
            return
        self.facts["cutoff"] = f"{cutoff:.4g} Hz{'' if self._states_cutoff else ', chosen by the torques'}"
        self._share_of_noise(recording, cutoff)

    @property
    def _states_cutoff(self) -> bool:
        return bool(self.stated.get("processing", {}).get("cutoff", "auto") != "auto")

    def _share_of_noise(self, recording: Recording, cutoff: float) -> None:
        # What positions jump over a gap has power at all frequencies, as noise has.
        even = longest_part(recording)
        share = noise_share(even.q, even.rate, [cutoff], self.processing.order)[0]
        share[HeldJoints.of(recording).mask] = np.nan
        noisy = np.flatnonzero(share > NOISY)
        if not len(noisy):
            return
        worst = int(np.nanargmax(share))
        names = ", ".join(recording.joint_label(int(j)) for j in noisy)
        statement = (
            f"At the cutoff of {cutoff:.4g} Hz noise of the positions makes up to {share[worst]:.0%} of the power of "
            f"the accelerations ({names}), and inertias become too small."
        )
        if self._states_cutoff:
            remedy: Settings = {"processing": {"cutoff": "auto"}}
            self.add(Finding("position noise", statement, "worse", float(share[worst]), remedy))
            return
        advice = "Move faster and farther, or use a finer encoder."
        self.add(Finding("position noise", statement, "worse", float(share[worst]), advice=advice))

    def _delay(self, recording: Recording) -> None:
        """Estimate the delay of the torques behind the motion."""
        stated = self.stated.get("processing", {}).get("delay", 0.0)
        if isinstance(stated, str) or self.columns.finds_gains:
            return
        self.say("are torques and motion in step?")
        told = next((one for one in self.findings if one.kind == "delay"), None)
        told_delay = stated if told is None else told.remedy["processing"]["delay"]
        supposed = float(np.max(np.abs(np.asarray(told_delay) - np.asarray(stated))))
        found = self._estimated_delay(recording, stated, max(LONGEST_DELAY, 1.5 * supposed))
        if told is not None:
            self.findings.remove(told)  # what the estimate does not confirm is not told
        if found is None:
            self._late(stated)
            return
        here, there = (int(np.argmin(np.abs(found.lags - lag))) for lag in (0.0, found.delay))
        fallen = 1.0 - float(np.mean(found.residuals[there] / np.maximum(found.residuals[here], 1e-300)))
        by = "the signals show" if self.model is None else "the model shows"
        width = f"{1e3 * found.delay:.3g} ± {1e3 * found.standard_deviation:.2g} ms"
        if not found.is_sure or fallen < (BLIND_GAIN if self.model is None else DELAY_GAIN):
            if self._late(stated):
                return
            self.facts["delay"] = f"torques are {width} behind the motion, as {by}; that is not significant"
            return
        remedy: Settings = {"processing": {"delay": _significant(np.asarray(stated, dtype=float) + found.delay)}}
        statement = (
            f"Torques are logged {width.removeprefix('-')} {'later' if found.delay > 0 else 'earlier'} than the motion "
            f"that they belong to, as {by}: without the delay the unexplained part falls by {fallen:.0%}."
        )
        self.add(Finding("delay", statement, "worse", fallen, remedy))

    def _late(self, stated: Any) -> bool:
        """Tell of a delay that matters to the numbers of an answer, where the least residual does not tell it."""
        if not self.late or self.model is None:
            return False
        [(one, *_)] = late_hypotheses(self.late, stated, self.model.robot.joint_names).values()
        statement = f"{one.statement}: without the delay {one.evidence}."
        weight = 1.0 - one.error_after / max(one.error_before, 1e-300)
        self.add(Finding("delay", statement, "worse", weight, one.settings))
        return True

    def _transmissions(self, recording: Recording) -> None:
        """Look at ratios and gaps of transmissions whose other side is logged too, and at commands."""
        if self.file is None or self.joints is None or not (self.file.section("elastic") or self.file.section("drive")):
            return
        from .encoders_only.drive_kinematics import transmission_findings  # loaded where robot.toml names such columns

        self.say("gear ratios and backlash")
        try:
            found, facts = transmission_findings(self.log, self.file, self.columns, recording, self.joints)
        except InputError as error:
            self.facts["transmissions"] = f"not looked at: {error}"
            return
        self.facts.update(facts)
        for one in found:
            self.add(one, used=False)

    def _estimated_delay(self, recording: Recording, stated: Any, longest: float) -> DelayEstimate | None:
        """Estimate the delay by the longest stretch without gaps; None where it does not tell."""
        kept = {key: value for key, value in self.settings.get("processing", {}).items() if key in DETECTORS}
        try:
            part = longest_part(recording)
            cutoff = choose_cutoff(part, self.processing.order).cutoff
            options = {**kept, "cutoff": cutoff, "velocity_threshold": None, "delay": stated}
            samples = part.process(Processing.from_dict(options, "[processing]"))
            model = None if self.model is None else self.model.without_logged_channels
            return estimate_delay(samples, model, longest)
        except InputError:  # too short, or no least residual
            return None

    # Words

    def _measures(
        self, recording: Recording, diagnosis: Diagnosis
    ) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
        """Return a table of what was measured of each joint."""
        size = max(1, round(0.02 * recording.rate))
        # Between rows that a gap parts nobody knows the speed.
        parts, _ = evened(recording)
        speeds = [
            np.abs(np.gradient(part.q[::size], axis=0)) * part.rate / size for part in parts if part.count > 2 * size
        ]
        speed = np.concatenate(speeds or [np.zeros((1, recording.joint_count))])
        slow = np.mean(speed < 0.05 * np.sqrt(np.mean(speed**2, axis=0)), axis=0)
        columns = (
            np.ptp(recording.q, axis=0),
            speed.max(axis=0),
            diagnosis.position_resolution,
            diagnosis.position_noise,
            recording.torque.std(axis=0),
            diagnosis.torque_resolution,
            diagnosis.torque_noise,
            100.0 * slow,
        )
        heads = ("joint", "travel", "speed", "step", "noise", "torque", "its step", "its noise", "near rest, %")
        rows = tuple(
            (name, *("–" if value == 0.0 else f"{value:.3g}" for value in values))
            for name, values in zip(recording.column_labels, zip(*columns, strict=True), strict=True)
        )
        return heads, rows

    def _tell(self, recording: Recording, clock: ClockStatistics | None, layout: Layout) -> None:
        """Tell rate, gaps and the spectra where nothing else has."""
        rate = f"{recording.rate:.6g} Hz" if clock is None else f"{1.0 / clock.period:.6g} Hz by the stamps"
        count, duration = recording.count, recording.duration
        if self.sample is not None:
            count = self.sample.count
            t = self._whole_time()
            duration = (count - 1) / recording.rate if t is None or self.columns.rate is not None else float(t[-1])
        facts = {"rows": f"{count}, {duration:.6g} s at {rate}"}
        if clock is not None:
            facts["rows"] = f"{count}, {duration - clock.paused:.6g} s at {rate}"
            facts["clock"] = repr(clock).removeprefix("ClockStatistics(").removesuffix(")")
        if "cutoff" not in self.facts:
            try:
                choice = choose_cutoff(longest_part(recording), self.processing.order)
                facts["cutoff"] = f"{choice.cutoff:.4g} Hz by the spectra of the positions"
                if self.model is None:
                    stated = self.stated.get("processing", {}).get("cutoff", choice.cutoff)
                    self._share_of_noise(recording, float(stated) if isinstance(stated, float) else choice.cutoff)
            except InputError as error:
                facts["cutoff"] = "not known"
                if not any(one.harm == "refused" and not one.remedy for one in self.findings):
                    advice = "Record a longer motion."
                    self.add(Finding("too little motion", str(error), "refused", 1.0, advice=advice))
        facts.update({f"guess {number}": guess for number, guess in enumerate(layout.guesses, start=1)})
        self.facts = {**facts, **self.facts}

    def _file(self, further: Settings | None = None) -> RobotFile:
        """Return the robot file with the remedies so far, and further settings."""
        assert self.file is not None
        settings = merged(self.settings, further or {})
        sections = {**self.file.sections, **{name: settings.get(name, {}) for name in ("log", "processing")}}
        return replace(self.file, sections=sections)


def _rate_behind(t: Array) -> float | None:
    """Return the rate in Hz of rows whose stamps repeat or go back; None where a new run begins among them."""
    steps, span = np.diff(t), float(t[-1] - t[0])
    if span <= 0.0:
        return None
    period = span / (len(t) - 1)
    # Rounded stamps are off an even clock by their step; a clock that was set anew, or a second run, by far more.
    step = float(np.median(steps[steps > 0.0]))
    off = t - t[0] - period * np.arange(len(t))
    if np.ptp(off) > 0.01 * span + 4.0 * step:
        return None
    return _round_rate(1.0 / period, min(step / span, 0.01))


def _round_rate(rate: float, tolerance: float) -> float:
    """Return the roundest number within a relative tolerance of a rate.

    Examples
    --------
    >>> _round_rate(999.86, 1e-3), _round_rate(124.37, 1e-4)
    (1000.0, 124.37)
    """
    for digits in range(1, 9):
        rounded = float(f"{rate:.{digits}g}")
        if abs(rounded - rate) <= tolerance * rate:
            return rounded
    return rate


def _kind_of(remedy: Settings) -> str:
    """Name a fault by what mends it."""
    key = next((key for table in remedy.values() for key in table), "unit")
    if key.endswith("_unit"):
        return key.replace("_", " ")
    return _KINDS.get(key, key)


def _significant(values: Array) -> Any:
    rounded = np.vectorize(lambda value: float(f"{value:.3g}"))(values)
    return rounded.tolist() if rounded.ndim else float(rounded)


def _day(seconds: float) -> str:
    from datetime import UTC, datetime

    try:
        return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    except (OverflowError, ValueError, OSError):
        return f"{seconds:.10g} s"
