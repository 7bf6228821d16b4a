"""The first robot.toml of a robot: everything that a description and a log tell, each guess with its reason."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.display import html_table, shortened, text_table
from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.recording import LogColumns
from steelyard.recording.columns import FIND
from steelyard.recording.correction import Settings, toml_value
from steelyard.recording.formats import LogFiles
from steelyard.recording.logged_joints import LoggedJoints, logged_joints
from steelyard.recording.recognition import Layout
from steelyard.robot import RobotFile
from steelyard.robot.description import URDF, description_format

from .default_terms import rotors_of_log
from .doctor import POINTS, examine
from .examination import Examination, merged
from .log_reader import LogReader

__all__ = ["FirstRobotFile", "Guess", "first_robot_file"]

_REDUCTION = re.compile(rb"<mechanicalReduction>\s*([-+0-9.eE]+)\s*</mechanicalReduction>")
_TERMS = {
    "viscous": "friction that grows with speed: every joint has grease and seals",
    "coulomb": "friction that has the sign of the speed: every joint has bearings, and gears have more",
    "offset": "a constant torque: few sensors and drives read exactly zero at rest",
    "rotor_inertia": "the description tells inertias of rotors",
}
_REASONS = {
    "rate": "what the log is sampled at",
    "longest_gap": "the gaps of the log are as long, and are filled",
}
_WIDEST = 100  # columns of a comment behind a value; longer ones stand above it


@dataclass(frozen=True)
class Guess:
    """A guess that stands in the file.

    Attributes
    ----------
    section, key : str
        Where.
    value : str
        As TOML.
    reason : str
        Why.
    """

    section: str
    key: str
    value: str
    reason: str


@dataclass(frozen=True, eq=False)
class FirstRobotFile:
    """A robot.toml, with the guesses that stand in it.

    Attributes
    ----------
    text : str
        Of the file.
    guesses : tuple of Guess
    examination : Examination or None
        Of the log, where there is one; what it found is in the text.
    to_complete : str
        What is to be written into the file before it can be used, in a sentence; empty where nothing is.
    """

    text: str
    guesses: tuple[Guess, ...]
    examination: Examination | None = None
    to_complete: str = ""

    def __str__(self) -> str:
        rows = [
            (f"[{one.section}]", one.key, shortened(one.value, 44), shortened(one.reason, 90)) for one in self.guesses
        ]
        return text_table(("section", "key", "value", "reason"), rows)

    def _repr_html_(self) -> str:
        rows = [(one.section, one.key, one.value, one.reason) for one in self.guesses]
        return html_table("robot.toml", ("section", "key", "value", "reason"), rows)


@in_one_thread
def first_robot_file(
    robot: str | Path,
    log: str | Path | None = None,
    *,
    folder: str | Path = ".",
    topic: str | Sequence[str] | None = None,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    progress: Callable[[str], None] | None = None,
) -> FirstRobotFile:
    """Write down everything that a description, and a log, tell of how a robot is to be identified.

    Parameters
    ----------
    robot : str or Path
        A description: URDF, MJCF, SDF and so on; arguments of a xacro may follow its path.
    log : str or Path, optional
        Files recorded side by side are joined by ``+``. A log tells columns and units, joints that do not move,
        whether rotors have inertia, the filter, and what is wrong with it (see `examine`): the lines that mend it stand
        in the file.
    folder : str or Path
        Where the file will be, from which the path of the description counts.
    topic : str or sequence of str, optional
        Of a bag that is read; several that belong together.
    settings : mapping, optional
        Keys of [log] and [processing] that are known, by section, such as ``{"log": {"time": "clock"}}``.
    progress : callable, optional
        Called with a few words before each step.

    Returns
    -------
    FirstRobotFile
        With a text that loads as it is.

    Raises
    ------
    InputError
        If the description or the log cannot be used.

    Examples
    --------
    >>> link = '<link name="{}"><inertial><mass value="1"/>{}</inertial></link>'
    >>> inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    >>> joint = '<joint name="elbow" type="continuous"><parent link="base"/><child link="arm"/></joint>'
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place:
    ...     path = Path(place) / "one.urdf"
    ...     _ = path.write_text(f'<robot name="one"><link name="base"/>{link.format("arm", inertia)}{joint}</robot>')
    ...     made = first_robot_file(path, folder=place)
    >>> [guess.key for guess in made.guesses]
    ['name', 'urdf', 'gravity', 'viscous', 'coulomb', 'offset']
    """
    say = progress or (lambda _: None)
    if Path(robot).suffix.lower() == ".toml":
        raise InputError(
            f"{robot} is a robot file already, which every other command takes as it is; to guess another one, give "
            "the description that it names, such as a URDF."
        )
    draft = _Draft(RobotFile.load(robot), Path(folder))
    if log is None:
        draft.rotors_of_description()
    else:
        if topic:
            draft.state("log", "topic", topic if isinstance(topic, str) else list(topic), "given")
        for section, keys in (settings or {}).items():
            if section not in ("log", "processing"):
                raise InputError(f"[{section}] is not guessed by a log; write it into the robot file afterwards.")
            for key, value in keys.items():
                draft.state(section, key, value, "given")
        draft.see(log, say)
    text, guesses = draft.written()
    return FirstRobotFile(text, guesses, draft.examination, draft.to_complete)


class _Draft:
    """A robot file as far as it is known."""

    def __init__(self, file: RobotFile, folder: Path) -> None:
        self.source, self.robot, self.folder = file.path, file.robot, folder
        self.key = "urdf" if description_format(file.path) is URDF else "file"
        self.settings: Settings = {}
        self.reasons: dict[tuple[str, str], str] = {}
        self.joints = LoggedJoints(tuple(self.robot.joint_names))
        self.terms: dict[str, str] = {term["kind"]: _TERMS[term["kind"]] for term in file.terms}
        self.coupling: list[list[int]] | None = None
        if "xacro_arguments" in file.description:
            self.state("description", "xacro_arguments", dict(file.description["xacro_arguments"]), "given")
        self.left_out = ""
        self.to_complete = ""
        self.layout: Layout | None = None
        self.examination: Examination | None = None
        self.log: str | Path | None = None

    # What is known

    def rotors_of_description(self) -> None:
        """Take rotor inertias in where the description has gears."""
        ratios = _gear_ratios(self.source)
        if ratios:
            least, most = min(ratios), max(ratios)
            between = f"{least:g} to {most:g}" if most > least else f"{most:g}"
            self.terms["rotor_inertia"] = f"the description has gears of {between}, behind which rotors weigh much"
        elif "rotor_inertia" not in self.terms:
            self.left_out = "where motors drive through gears; a log would tell"

    def see(self, log: str | Path, say: Callable[[str], None]) -> None:
        """Take in what a log tells."""
        self.log = log
        self.joints = self._logged_joints(LogFiles(log, LogColumns.from_dict(self.settings.get("log", {}))))
        if self.joints.others:
            self.state("description", "locked", list(self.joints.others), f"{self.joints.reason}; held at 0")
        terms = set(self.terms)
        self.examination = examine(log, self._loaded(), progress=say)
        self._mend(self.examination)
        if self.to_complete:  # currents of several drives are on as many scales, and fit no model
            self.left_out = "where motors drive through gears; currents do not tell before the drive gains are known"
        else:
            say("have the rotors an inertia that shows?")
            self._judge_rotors()
            if self.terms.keys() != terms:
                self._look_again(say)
        file = self._loaded()
        names = list(file.robot.joint_names)
        layout = LogFiles(log, LogColumns.from_dict(self.settings.get("log", {}))).layout(names)
        self.layout = layout.of_joints(file.robot.position_units)
        self._decide(file, say)

    def _look_again(self, say: Callable[[str], None]) -> None:
        """Examine the log with the terms that were found: what they hid shows beside them, such as a wrong factor."""
        assert self.log is not None
        assert self.examination is not None
        found = examine(self.log, self._loaded(), progress=say)
        further = tuple(one for one in found.findings if one.harm == "wrong" and one.remedy)
        if further:
            self._mend(replace(found, findings=further))
            self.examination = replace(found, findings=(*further, *self.examination.findings))

    def _logged_joints(self, files: LogFiles) -> LoggedJoints:
        """Find the joints of which a log speaks; of one that has currents and no torques the gains are to be stated."""
        try:
            return logged_joints(files, self.robot.joint_names)
        except InputError:
            files.columns = replace(files.columns, gain=FIND)
            found = logged_joints(files, self.robot.joint_names)
        self.state("log", "gain", FIND, "as long as no gains are stated")
        self.to_complete = (
            f"{files.name} has currents and no torques: state the drive gains, N·m per A at each joint (the torque "
            "constant of the motor times the ratio of its gears), in the line `gain` of [log], or let `steelyard "
            "payload ROBOT UNLOADED LOADED` find them with a payload of known mass."
        )
        return found

    def state(self, section: str, key: str, value: Any, reason: str) -> None:
        """Write a key down, with its reason."""
        self.settings = merged(self.settings, {section: {key: value}})
        self.reasons[section, key] = reason

    def _mend(self, found: Examination) -> None:
        """Take over the lines that mend a log, each with what was found."""
        for finding in found.findings:
            for section, table in finding.remedy.items():
                if section == "terms":
                    for term in table:
                        self.terms.setdefault(term["kind"], finding.statement)
                        self.coupling = term.get("coupling", self.coupling)
                    if self.coupling is not None:  # motors have all terms of joints, but for those that stand here
                        self.terms = {term["kind"]: self.terms[term["kind"]] for term in table}
                elif section == "constraints":
                    continue  # what a payload weighs is for the user to say
                else:
                    for key in table:
                        self.reasons[section, key] = finding.statement
        remedies = {name: table for name, table in found.remedies.items() if name not in ("terms", "constraints")}
        before = self.settings.get("description", {}).get("locked")
        self.settings = merged(self.settings, remedies)
        after = self.settings.get("description", {}).get("locked")
        if before is not None and after != before:
            self.reasons["description", "locked"] += f" Of others {self.joints.reason}."

    def _judge_rotors(self) -> None:
        """Take rotor inertias in where the log shows them, as `steelyard.identify` does where nobody states terms."""
        if self.terms.keys() & {"rotor_inertia", "motor_side"}:
            return
        file = self._loaded()
        model = Model.from_file(file)
        wider = model.with_rotors
        reader = LogReader(file, model)
        try:
            reader.decide([self._path], lambda _: None)
            decision = rotors_of_log(reader, self._path, wider, POINTS)
        except InputError:  # a log that cannot be used has its findings already
            self.left_out = "where motors drive through gears; the log does not tell"
            return
        if decision.taken:
            self.terms["rotor_inertia"] = decision.reason
        else:
            self.left_out = f"where motors drive through gears; {decision.reason}"

    def _decide(self, file: RobotFile, say: Callable[[str], None]) -> None:
        """Write down what the data decides of the filter and of slow rows."""
        reader = LogReader(file, Model.from_file(file))
        if reader.columns.finds_gains:
            return
        try:
            reader.decide([self._path], say)
        except InputError:
            return
        for key, value in reader.decided.items():
            if value is None:
                continue
            rounded = [float(f"{one:.4g}") for one in value] if isinstance(value, tuple) else float(f"{value:.6g}")
            reason = reader.reasons.get(key, "Chosen by the data")
            self.state("processing", key, rounded, f'{reason}. With "auto" every log chooses again.')

    @property
    def _path(self) -> str:
        """The path of the log, or the paths joined by +."""
        assert self.log is not None
        return os.fspath(self.log)

    def _loaded(self) -> RobotFile:
        """Return the draft as a robot file."""
        text, _ = self._text(self.source.resolve(), commented=False)
        return RobotFile.from_dict(tomllib.loads(text), self.source.resolve().with_name("robot.toml"))

    # The text

    def written(self) -> tuple[str, tuple[Guess, ...]]:
        """Return the text of the file, and the guesses in it."""
        try:
            path = Path(os.path.relpath(self.source.resolve(), self.folder.resolve()))
        except ValueError:  # another drive
            path = self.source.resolve()
        return self._text(path, commented=True)

    def _text(self, description: Path, commented: bool) -> tuple[str, tuple[Guess, ...]]:
        sheet = _Sheet(commented)
        tell = f" and {Path(self._path).name} tell" if self.log is not None else " tells"
        sheet.comment(
            f"The robot {self.robot.name}, as {self.source.name}{tell}. Everything here is a guess; behind # stands "
            "why. Change what is wrong."
        )
        sheet.state("", "name", self.robot.name, "the name in the description")
        self._description(sheet, description)
        self._terms(sheet)
        if self.log is not None:
            self._log(sheet)
        self._processing(sheet)
        if commented:
            self._limits(sheet)
        return sheet.text, tuple(sheet.guesses)

    def _description(self, sheet: _Sheet, description: Path) -> None:
        sheet.section("description")
        sheet.state("description", self.key, description.as_posix(), "given")
        table = dict(self.settings.get("description", {}))
        if "locked" in table:
            sheet.state("description", "locked", table["locked"], self.reasons["description", "locked"])
            last = self._last_link()
            if self.joints.others and last is not None:
                sheet.alternative(f"tip = {toml_value(last)}", "instead: nothing is mounted beyond this link")
        if "xacro_arguments" in table:
            sheet.state("description", "xacro_arguments", table["xacro_arguments"], "given")
        gravity = table.get("gravity", [float(value) for value in self.robot.gravity])
        reason = self.reasons.get(("description", "gravity"), "m/s², in the frame of the base: upright")
        sheet.state("description", "gravity", gravity, reason)
        if ("description", "gravity") not in self.reasons:
            hung = [-float(value) + 0.0 for value in gravity]
            sheet.alternative(f"gravity = {toml_value(hung)}", "hung from a ceiling")

    def _last_link(self) -> str | None:
        """The link that the last of the logged joints moves, where all of them are in one chain."""
        for joint, link in zip(self.robot.joints, self.robot.links, strict=True):
            if joint.name == self.joints.names[-1]:
                return link.name
        return None

    def _terms(self, sheet: _Sheet) -> None:
        for kind, reason in self.terms.items():
            sheet.blank()
            sheet.line("[[terms]]")
            sheet.line(f'kind = "{kind}"', reason)
            if kind == "motor_side":
                sheet.line(f"coupling = {toml_value(self.coupling)}")
            sheet.guesses.append(Guess("terms", kind, "true", reason))
        if self.left_out:
            sheet.blank()
            sheet.alternative("[[terms]]", self.left_out)
            sheet.alternative('kind = "rotor_inertia"')

    def _log(self, sheet: _Sheet) -> None:
        sheet.section("log")
        table = dict(self.settings.get("log", {}))
        if self.layout is not None:
            found = self.layout.settings()
            table = {**found, **{key: value for key, value in table.items() if key not in found}}
        meanings = {} if self.layout is None else {one.column: one for one in self.layout.table}
        columns = list(meanings)  # of which rows of a matrix, as of coupled joints, are none
        for key, value in table.items():
            reason = self.reasons.get(("log", key), _REASONS.get(key, ""))
            if isinstance(value, list) and value and all(one in columns for one in value) and key != "time":
                comments = [f"{meanings[one].joint}, {meanings[one].unit}: by {meanings[one].by}" for one in value]
                sheet.listed("log", key, value, comments, reason)
                continue
            if not reason and key == "time":
                first = value if isinstance(value, str) else value[0]
                reason = f"by {meanings[first].by}" if first in meanings else ""
            if not reason and key.endswith("_unit"):
                reason = "as the columns say, or as is usual"
            if key == "gain" and self.to_complete:
                sheet.comment(self.to_complete)
                sheet.alternative(f"gain = [{', '.join('…' for _ in self.joints.names)}]", ", ".join(self.joints.names))
            sheet.state("log", key, value, reason or "as was found")
        if self.layout is not None:
            for guess in self.layout.guesses:
                sheet.comment(guess)
        if self.examination is not None and "rows" in self.examination.facts and "rate" not in table:
            rate = self.examination.facts["rows"]
            sheet.comment(f"Rows: {rate}; `rate = ...` would be used in place of the stamps.")

    def _processing(self, sheet: _Sheet) -> None:
        table = self.settings.get("processing", {})
        if not table:
            return
        sheet.section("processing")
        for key, value in table.items():
            sheet.state("processing", key, value, self.reasons.get(("processing", key), "as was found"))
        if self.examination is not None and "delay" not in table and "delay" in self.examination.facts:
            sheet.alternative("delay = 0.0", self.examination.facts["delay"])

    def _limits(self, sheet: _Sheet) -> None:
        """The limits of the joints that are left, as the description has them."""
        locked = self.settings.get("description", {}).get("locked", ())
        joints = [self.robot.joints[index] for index in self.robot.driving_joints]
        joints = [joint for joint in joints if joint.name not in locked]
        kinds = {
            "lower": ([joint.lower for joint in joints], "rad or m"),
            "upper": ([joint.upper for joint in joints], "rad or m"),
            "velocity": ([joint.velocity_limit for joint in joints], "rad/s or m/s"),
            "effort": ([joint.effort_limit for joint in joints], "N·m or N"),
        }
        told = {key: (values, unit) for key, (values, unit) in kinds.items() if np.isfinite(values).any()}
        if not told or not all(joint.lower <= joint.upper for joint in joints):
            return
        sheet.section("limits")
        names = ", ".join(joint.name for joint in joints)
        sheet.comment(f"As the description has them, of {names}; motions that are designed keep them.")
        for key, (values, unit) in told.items():
            sheet.state("limits", key, list(map(float, values)), f"{unit}, from the description")


class _Sheet:
    """The lines of a robot file while they are written."""

    def __init__(self, commented: bool) -> None:
        self.lines: list[str] = []
        self.guesses: list[Guess] = []
        self.commented = commented

    @property
    def text(self) -> str:
        return "\n".join(self.lines) + "\n"

    def blank(self) -> None:
        self.lines.append("")

    def section(self, name: str) -> None:
        self.lines += ["", f"[{name}]"]

    def comment(self, words: str) -> None:
        """Write a comment over as many lines as it takes."""
        if not self.commented:
            return
        line = "#"
        for word in _plain(words).split():
            if len(line) + len(word) > _WIDEST and line != "#":
                self.lines.append(line)
                line = "#"
            line += f" {word}"
        self.lines.append(line)

    def line(self, content: str, reason: str = "") -> None:
        """Write a line, with its reason behind it where there is room, or else above it."""
        reason = _plain(reason)
        if not self.commented or not reason:
            self.lines.append(content)
        elif len(content) + len(reason) + 3 <= _WIDEST:
            self.lines.append(f"{content} # {reason}")
        else:
            self.comment(reason)
            self.lines.append(content)

    def state(self, section: str, key: str, value: Any, reason: str) -> None:
        self.line(f"{key} = {toml_value(value)}", reason)
        self.guesses.append(Guess(section or "robot", key, toml_value(value), _plain(reason)))

    def listed(self, section: str, key: str, values: Sequence[str], comments: Sequence[str], reason: str) -> None:
        """Write a list with a comment for each of its values."""
        self.comment(reason) if reason else None
        self.lines.append(f"{key} = [")
        for value, comment in zip(values, comments, strict=True):
            behind = f" # {_plain(comment)}" if self.commented else ""
            self.lines.append(f"    {toml_value(value)},{behind}")
            self.guesses.append(Guess(section, key, toml_value(value), _plain(comment)))
        self.lines.append("]")

    def alternative(self, content: str, reason: str = "") -> None:
        """Write a line that does not count unless its # is removed."""
        if self.commented:
            self.comment(reason) if len(content) + len(reason) > _WIDEST else None
            short = len(content) + len(reason) <= _WIDEST
            self.lines.append(f"# {content}" + (f" # {_plain(reason)}" if reason and short else ""))


def _plain(words: str) -> str:
    """Return words without what would end a comment."""
    return " ".join("".join(one if one.isprintable() else " " for one in words).split())


def _gear_ratios(source: Path) -> list[float]:
    """Return the ratios of gears that a description states."""
    found = []
    for match in _REDUCTION.findall(source.read_bytes()):
        try:
            ratio = abs(float(match))
        except ValueError:
            continue
        if ratio > 1.0:
            found.append(ratio)
    return found
