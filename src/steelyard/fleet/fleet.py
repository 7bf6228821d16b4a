"""Many robots: each estimated by itself, held against its siblings, and against what it was."""

from __future__ import annotations

import datetime
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.display import few_digits, text_table
from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import SteelyardError
from steelyard.files.arguments import all_listed, by_name, listed
from steelyard.identification.log_reader import Progress
from steelyard.identification.prediction_verdict import UNTESTED, WRONG
from steelyard.regression.parameter_covariance import NORMAL

from .causes import TURNABLE, Cause, gains_in_own_motion, possible_causes, variations
from .checkpoints import Checkpoints, checkpoint_key
from .executors import Executor, Here, Workers
from .log_reduction import first_of, run_in_order
from .manifest import FleetEntry, FleetManifest
from .packed import unpacked
from .robot_estimate import (
    description_of,
    hashed_files,
    inputs_of,
    model_of,
    robot_estimate,
    something_came,
    task_of,
    with_contents,
)
from .siblings import FEWEST, LEAST_HELD, Batch, Deviation, SiblingComparison, compare_siblings, held_before
from .torque_units import other_units
from .variation import median_of_shown, pseudo_inverse, shown_parameters, unexplained

__all__ = ["Finding", "Fleet", "RobotGroup", "RobotRow", "identify_fleet"]

Array = NDArray[np.float64]
Kind = Literal["batch", "siblings", "drift"]
KINDS = ("batch", "siblings", "drift")  # in the order in which they are told
MOST_SENTENCES = 40
"""The most sentences that are printed; the tables have all findings."""
MANY_TIMES = 3.0
"""Error beside that of the siblings whose data is explained, above which that of a robot is not: of a model that lacks
something, errors vary by half; the other sign of one joint's torque leaves seven times as much."""
ROUGH = 5
"""Robots of a group below which intervals hold less than they say: of links that were named in simulated fleets of
four, which are those where chance made the others look alike, 6 of 10 held the truth; of five, 9 of 10."""
MANY_SIBLINGS = 15
"""Robots of a group below which it is said that only large differences are told. Of UR5s whose friction varies by 6 %,
one that has 50 % more in a joint is found in 1 of 12 fleets of ten, 6 of 10 of twelve, and all of sixteen."""
HEAVY = 0.1
"""Reciprocal of the degrees of freedom from which heavy tails are told. With ten, Student's distribution has one robot
in 2000 five standard deviations out, and a normal one has one in 1.7 million."""
DOCTOR = "`steelyard doctor LOG ROBOT` looks for such mistakes, and tells the line that mends them."
LINES = 20
"""The most lines of progress that are printed while robots are estimated."""
NEARLY_ALL = 0.8
"""Part of a change from which on it is told to have been there since a date. The noise of a change that is named is a
fifth of it or less; a part that wore evenly had half of its wear at a date, and more later."""
SURE = 0.05
"""Probability, of all causes of a group together, by which the siblings as a whole have drifted."""


@dataclass(frozen=True, eq=False)
class RobotRow:
    """One robot at one date, and its result.

    Attributes
    ----------
    entry : FleetEntry
    reason : str
        Why nothing came of it; empty where something did.
    values : mapping
        What `robot_estimate` told: ``"base"``, ``"covariance"``, ``"parameters"``, ``"word"`` and so on.
    """

    entry: FleetEntry
    reason: str
    values: Mapping[str, Any] = field(repr=False)


@dataclass(frozen=True, eq=False)
class Finding:
    """A robot that differs from its siblings, or from what it was, in one part; or robots of another batch.

    Attributes
    ----------
    kind : {"batch", "siblings", "drift"}
    robot, group, date : str
        The first and the last are empty for a batch.
    since : str
        Of a drift: the first date from which on it was half of what it is, or more.
    deviation : Deviation
    sentence : str
    history : tuple of (str, float)
        Of a drift: the date and the amplitude against the first date, of each later one, beyond what changed in the
        siblings until then; of a link as a whole, as a part of what it is at last.
    ratio : float or None
        Of a drift: how many times what it was, beyond what changed in the siblings.
    robots : tuple of str
        Of a batch.
    """

    kind: Kind
    robot: str
    group: str
    date: str
    since: str
    deviation: Deviation = field(repr=False)
    sentence: str
    history: tuple[tuple[str, float], ...] = field(default=(), repr=False)
    ratio: float | None = None
    robots: tuple[str, ...] = field(default=(), repr=False)

    @property
    def line(self) -> str:
        """The sentence, with the robot of which it is."""
        return f"{self.robot}: {self.sentence}" if self.robot else self.sentence


@dataclass(frozen=True, eq=False)
class RobotGroup:
    """Robots that are built alike.

    Attributes
    ----------
    name : str
    model : Model
    latest : tuple of int
        For each robot the number, among the rows of the fleet, of its latest date.
    last : tuple of int
        Numbers of the latest rows of the robots with several dates.
    siblings : SiblingComparison or None
        None where there are fewer than three robots.
    drift : SiblingComparison or None
        What changed from the first date to the latest; None where fewer than three robots have several dates.
    alike : str
        Which robots of that name these are, where there are several models of them, as in ``" like A-17"``.
    """

    name: str
    model: Model = field(repr=False)
    latest: tuple[int, ...] = field(repr=False)
    last: tuple[int, ...] = field(repr=False)
    siblings: SiblingComparison | None = field(default=None, repr=False)
    drift: SiblingComparison | None = field(default=None, repr=False)
    alike: str = ""


@dataclass(frozen=True, eq=False)
class Fleet:
    """The result of :func:`identify_fleet`.

    Attributes
    ----------
    manifest : FleetManifest
    rows : tuple of RobotRow
        In the order of the manifest.
    groups : tuple of RobotGroup
    findings : tuple of Finding
        Batches, then robots that differ from their siblings, then those that have drifted; the surest first.
    remarks : tuple of str
    unexplained : tuple of RobotRow
        Whose own data no parameters that a robot can have explain, while that of siblings is explained, or whose
        torques are in another unit than those of the others. No part of them is compared.
    """

    manifest: FleetManifest
    rows: tuple[RobotRow, ...] = field(repr=False)
    groups: tuple[RobotGroup, ...] = field(repr=False)
    findings: tuple[Finding, ...] = field(repr=False)
    remarks: tuple[str, ...] = field(default=(), repr=False)
    unexplained: tuple[RobotRow, ...] = field(default=(), repr=False)

    @property
    def failed(self) -> tuple[RobotRow, ...]:
        """The rows whose robots could not be estimated."""
        return tuple(row for row in self.rows if row.reason)

    @property
    def left_out(self) -> tuple[tuple[RobotRow, str, str], ...]:
        """The logs that could not be used, of robots that were estimated by others: row, log and reason of each."""
        return tuple((row, log, reason) for row in self.rows for log, reason in row.values.get("left_out", {}).items())

    @property
    def unpredicted(self) -> tuple[RobotRow, ...]:
        """The rows that were compared, or had no siblings, although the model does not predict their torques."""
        return tuple(row for row in self.rows if row.values.get("word") == "wrong" and row not in self.unexplained)

    @property
    def batches(self) -> tuple[Finding, ...]:
        """What robots of one batch have in common, and those of others have not; the surest first."""
        return tuple(one for one in self.findings if one.kind == "batch")

    @property
    def differing(self) -> tuple[str, ...]:
        """Robots that differ from their siblings, the surest first; of a batch only those that differ from it too."""
        return tuple(dict.fromkeys(one.robot for one in self.findings if one.kind == "siblings"))

    @property
    def drifted(self) -> tuple[str, ...]:
        """Robots that drifted, the surest first."""
        return tuple(dict.fromkeys(one.robot for one in self.findings if one.kind == "drift"))

    @property
    def headline(self) -> str:
        """What was found, in one sentence."""
        count = len({row.entry.id for row in self.rows})
        robots = f"{count} robot{'s' * (count != 1)}"
        parts = []
        if self.batches:
            sizes = [len(robots) for robots in dict.fromkeys(one.robots for one in self.batches)]
            parts.append(f"{all_listed(sizes)} are of {'another batch' if len(sizes) == 1 else 'other batches'}")
        if any(group.siblings is not None for group in self.groups):
            number = len(self.differing)
            parts.append(f"{number or 'none'} {'differ' if number > 1 else 'differs'} from {_their(number)} siblings")
        if any(group.drift is not None for group in self.groups):
            number = len(self.drifted)
            parts.append(f"{number or 'none'} ha{'ve' if number > 1 else 's'} drifted")
        if self.unexplained:
            number = len({row.entry.id for row in self.unexplained})
            parts.append(f"no parameters like those of siblings explain the data of {number}")
        if self.unpredicted:
            number = len(self.unpredicted)
            parts.append(f"the model does not predict the torques of {number} of {len(self.rows)} entries")
        if self.failed:
            parts.append(f"nothing came of {len(self.failed)} of {len(self.rows)} entries")
        if self.left_out:
            count = len(self.left_out)
            parts.append(f"{count} log{'s were' if count > 1 else ' was'} left out that cannot be used")
        return (
            f"{robots}: {', '.join(parts)}." if parts else f"{robots}, of which none has siblings to compare it with."
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """The headline, and a sentence for each finding."""
        return (self.headline, *(one.line for one in self.findings), *self.remarks)

    def __str__(self) -> str:
        lines = [self.headline]
        lines += [one.line for one in self.findings[:MOST_SENTENCES]]
        if len(self.findings) > MOST_SENTENCES:
            lines.append(f"({len(self.findings) - MOST_SENTENCES} more; findings.parquet and fleet.html have all.)")
        lines += self.remarks
        if self.failed:
            rows = [(row.entry.label, row.reason) for row in self.failed[:MOST_SENTENCES]]
            lines.append(text_table(("robot", "nothing came of it, because"), rows))
        if self.left_out:
            told = self.left_out[:MOST_SENTENCES]
            rows = [(row.entry.label, why if log in why else f"{log}: {why}") for row, log, why in told]
            lines.append(text_table(("robot", "a log was left out, because"), rows))
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data: the findings and the reasons; the tables are files of their own."""
        return {
            "format": "steelyard-fleet-1",
            "name": self.manifest.name,
            "headline": self.headline,
            "false_discovery_rate": self.manifest.false_discovery_rate,
            "batches": [list(one.robots) for one in self.batches],
            "differing": list(self.differing),
            "drifted": list(self.drifted),
            "unexplained": [row.entry.label for row in self.unexplained],
            "unpredicted": [row.entry.label for row in self.unpredicted],
            "findings": [
                _finding_row(one) | {"history": list(one.history), "robots": list(one.robots)} for one in self.findings
            ],
            "failed": [{"robot": r.entry.id, "date": r.entry.date, "reason": r.reason} for r in self.failed],
            "left_out": [
                {"robot": row.entry.id, "date": row.entry.date, "log": log, "reason": reason}
                for row, log, reason in self.left_out
            ],
            "remarks": list(self.remarks),
        }

    def robot_rows(self) -> list[dict[str, Any]]:
        """One mapping for each robot and date: what came of it, both verdicts, its batch, and what differs."""
        common: dict[tuple[str, str], list[str]] = {}
        for one in self.batches:
            for robot in one.robots:
                common.setdefault((one.group, robot), []).append(one.deviation.cause.name)
        differing: dict[tuple[str, str], list[Finding]] = {}
        for one in self.findings:
            differing.setdefault((one.robot, one.date), []).append(one)
        chance: dict[int, float] = {}
        unexplained = [(row.entry.id, row.entry.date) for row in self.unexplained]
        for group in self.groups:
            if group.siblings is not None:
                chance.update(zip(group.latest, map(float, group.siblings.robot_probability), strict=True))
        found = []
        for number, row in enumerate(self.rows):
            own, values = differing.get((row.entry.id, row.entry.date), []), row.values
            model = _model_of(row)
            mass = None
            if model is not None:
                mass = float(sum(values["parameters"][columns[9]] for columns in model.link_columns))
            found.append(
                {
                    "robot": row.entry.id,
                    "group": row.entry.group,
                    "date": row.entry.date,
                    "reason": row.reason,
                    "rows": values.get("rows"),
                    "left_out": len(values.get("left_out", ())),
                    "least_squares": values.get("feasible"),
                    "possible": values.get("possible"),
                    "prediction": values.get("word"),
                    "predicted": values.get("source"),
                    "model_error": values.get("model_error"),
                    "relative_error": values.get("relative_error"),
                    "condition_number": values.get("condition_number"),
                    "total_mass": mass,
                    "batch": ", ".join(common.get((row.entry.group, row.entry.id), [])) or None,
                    "differs": None if number not in chance else any(one.kind == "siblings" for one in own),
                    "probability": chance.get(number),
                    "unexplained": (row.entry.id, row.entry.date) in unexplained,
                    "drifted": any(one.kind == "drift" for one in own),
                    "cause": own[0].deviation.cause.name if own else None,
                    "sentence": " ".join(one.sentence for one in own) or None,
                    "remarks": " ".join(values.get("remarks", ())) or None,
                }
            )
        return found

    def finding_rows(self) -> list[dict[str, Any]]:
        """One mapping for each finding."""
        return [_finding_row(one) for one in self.findings]

    def parameter_columns(self) -> dict[str, list[Any] | Array]:
        """The long table: each parameter of each robot and date, and each cause against the siblings, by column.

        Base parameters have the interval of the data alone; standard parameters are those of the answer; those of
        siblings are ratios or differences, drawn towards the siblings by as much as the data leaves open, but for
        those of robots that differ. Units are those of what has one, and empty for ratios.
        """
        parts: list[dict[str, Any]] = []

        def add(
            row: RobotRow, kind: str, names: Sequence[str], units: Sequence[str | None], value: Array, *ends: Array
        ) -> None:
            part = {"row": row, "kind": kind, "names": list(names), "units": list(units), "value": value}
            parts.append(part | dict(zip(("lower", "upper"), ends, strict=True)))

        for row in self.rows:
            model = _model_of(row)
            if model is None:
                continue
            values = row.values
            base = np.asarray(values["base"])
            half = np.full(len(base), np.nan)
            if not values["filtered"]:
                half = NORMAL * np.sqrt(np.diagonal(values["covariance"]))
            half = np.where(np.isfinite(half), half, np.nan)
            add(row, "base", model.base_parameters().expressions, [None] * len(base), base, base - half, base + half)
            parameters = np.asarray(values["parameters"])
            open_ended = np.full(len(parameters), np.nan)
            if values["table"]:
                rows = values["table"]
                told = [np.array([_number(one[key]) for one in rows]) for key in ("value", "lower", "upper")]
                add(row, "answer", [one["name"] for one in rows], [one["unit"] for one in rows], *told)
            else:
                names, none = [str(name) for name in model.parameter_names], [None] * len(parameters)
                add(row, "answer", names, none, parameters, open_ended, open_ended)
        for group in self.groups:
            for kind, numbers, compared in (
                ("beside siblings", group.latest, group.siblings),
                ("drift", group.last, group.drift),
            ):
                if compared is None:
                    continue
                kept = [k for k, one in enumerate(compared.causes) if one.kind != "link" and not compared.hidden[k]]
                names, units = ([getattr(compared.causes[k], key) for k in kept] for key in ("name", "unit"))
                nominal = np.array([compared.causes[k].nominal for k in kept])
                value, error = (nominal * one[:, kept] for one in compared.shrunk)
                for place, number in enumerate(numbers):
                    half = NORMAL * error[place]
                    add(self.rows[number], kind, names, units, value[place], value[place] - half, value[place] + half)
        counts = [len(part["names"]) for part in parts]
        whose = [part["row"].entry for part, count in zip(parts, counts, strict=True) for _ in range(count)]
        columns: dict[str, list[Any] | Array] = {
            "robot": [entry.id for entry in whose],
            "date": [entry.date for entry in whose],
        }
        columns["kind"] = [part["kind"] for part, count in zip(parts, counts, strict=True) for _ in range(count)]
        columns["parameter"] = [name for part in parts for name in part["names"]]
        columns["unit"] = [unit for part in parts for unit in part["units"]]
        for key in ("value", "lower", "upper"):
            columns[key] = np.concatenate([part[key] for part in parts]) if parts else np.zeros(0)
        return columns


def _their(number: int) -> str:
    return "their" if number > 1 else "its"


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _model_of(row: RobotRow) -> Model | None:
    return None if row.reason else model_of(row.values["description"], bool(row.values["with_rotors"]))


def _finding_row(one: Finding) -> dict[str, Any]:
    deviation, cause = one.deviation, one.deviation.cause
    scale = cause.nominal
    return {
        "kind": one.kind,
        "robot": one.robot,
        "robots": ", ".join(one.robots),
        "group": one.group,
        "date": one.date,
        "since": one.since,
        "cause": cause.name,
        "part": cause.part,
        "what": cause.what,
        "unit": cause.unit,
        "change": scale * deviation.amplitude,
        "lower": scale * deviation.lower,
        "upper": scale * deviation.upper,
        "ratio": (1.0 + deviation.amplitude if one.ratio is None else one.ratio) if cause.has_ratio else float("nan"),
        "standard_deviations": deviation.deviations,
        "probability": deviation.probability,
        "alternatives": ", ".join(other.name for other in deviation.alternatives),
        "sentence": one.sentence,
    }


@in_one_thread
def identify_fleet(
    manifest: FleetManifest | str | Path,
    *,
    executor: Executor | None = None,
    checkpoints: Checkpoints | None = None,
    progress: Progress | None = None,
) -> Fleet:
    """Estimate the robots of a fleet, and tell which differ from their siblings, and which have drifted.

    Each robot is estimated by itself, as by :func:`steelyard.identify`. Robots of one group and one model are siblings;
    see :func:`compare_siblings` for how they are compared. A robot with several dates is compared with its siblings as
    it was last, and what changed since its first date with what changed in its siblings. Robots that fall into two
    heaps, as after a change of a supplier, are told as batches, and each is then compared without what its batch has in
    common. A robot of which nothing comes keeps no other from being estimated: its row tells the reason.

    Parameters
    ----------
    manifest : FleetManifest or path
    executor : Executor, optional
        Where robots are estimated: ``Here()`` by default, ``Workers(2)`` for two processes, or a cluster. No byte of
        the result depends on it.
    checkpoints : Checkpoints, optional
        Keep what is finished, and take what an earlier run has finished.
    progress : callable, optional
        Called with a few words before each step.

    Returns
    -------
    Fleet

    Raises
    ------
    InputError
        If the manifest cannot be used.

    Examples
    --------
    Pendulums, of which one has twice the friction of the others:

    >>> import numpy as np, tempfile, pathlib
    >>> import steelyard as sy
    >>> robot = "[description]\\nrows = [[0.0, 0.3, 0.0, 'q']]\\n[[terms]]\\nkind = 'viscous'"
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> _ = (folder / "robot.toml").write_text(robot)
    >>> model = sy.Model.load(folder / "robot.toml")
    >>> t, random = np.arange(0.0, 8.0, 0.01)[:, None], np.random.default_rng(1)
    >>> q, dq, ddq, lines = np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t), ["id,robot,informations"]
    >>> for k in range(5):
    ...     torque = 0.6 * ddq + (2.0 if k == 3 else 1.0) * dq + 0.01 * random.normal(size=t.shape)
    ...     samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)
    ...     sy.Information.from_samples(model, samples).save(folder / f"{k}.json")
    ...     lines.append(f"A-{k},robot.toml,{k}.json")
    >>> _ = (folder / "robots.csv").write_text("\\n".join(lines))
    >>> fleet = sy.fleet.identify_fleet(folder / "robots.csv")
    >>> fleet.differing
    ('A-3',)
    """
    say = progress or (lambda _: None)
    given = manifest if isinstance(manifest, FleetManifest) else FleetManifest.load(manifest)
    say(f"{given.name}: {len(given.entries)} entries")
    rows = _estimated(given, Here() if executor is None else executor, checkpoints, say)
    groups, findings, remarks = [], [], []
    copies = _copies(rows)
    grouped = _grouped(rows, copies)
    strange = _strangers(rows, grouped)
    grouped = {key: [k for k in numbers if k not in strange] for key, numbers in grouped.items()}
    scaled: list[int] = []
    for numbers in grouped.values():
        own, said = _in_other_unit(rows, numbers)
        scaled += own
        remarks += said
    strange_or_scaled = sorted({*strange, *scaled})
    grouped = {key: [k for k in numbers if k not in scaled] for key, numbers in grouped.items()}
    models = Counter(name for name, _ in grouped)
    for (name, _), numbers in grouped.items():
        say(f"siblings{f' of {name}' if name else ''}: {len({rows[k].entry.id for k in numbers})} robots")
        alike = f" like {rows[numbers[0]].entry.id}" if models[name] > 1 else ""
        group, found, told = _compared(name, alike, rows, numbers, given.false_discovery_rate)
        groups.append(group)
        findings += found
        remarks += told
    findings.sort(
        key=lambda one: (KINDS.index(one.kind), one.deviation.probability, one.robot, one.deviation.cause.name)
    )
    for name in (name for name, count in models.items() if count > 1):
        remarks.append(
            f"{_called(name, capital=True)} has robots of {models[name]} models, with other lengths or other terms: "
            "each is compared with those of its own model alone."
        )
    if strange:
        remarks.append(_unexplained([rows[k] for k in strange]))
    suspect = [row.entry.label for row in rows if row.values.get("units_are_suspect")]
    if suspect:
        remarks.append(
            f"By their rates, positions or speeds the logs of {listed(suspect)} seem to be in other units than those "
            f"that are stated, and what differs in these entries may be no more than that. {DOCTOR}"
        )
    filtered = sum(bool(row.values.get("filtered")) for row in rows)
    if filtered:
        remarks.append(
            f"The torques of {filtered} entries were filtered and their regressor was not, so that no interval holds: "
            "they are left out of the comparison of siblings."
        )
    short = [row.entry.label for row in rows if not row.reason and row.values["short"]]
    if short:
        remarks.append(
            "The logs are too short to tell how large the noise of each joint is, so that no interval holds: "
            f"{listed(short)}. They are left out of the comparison of siblings; give longer logs."
        )
    if copies:
        pairs = [f"{rows[first].entry.label} and {rows[k].entry.label}" for k, first in copies.items()]
        remarks.append(
            f"The same data was given for {listed(pairs)}: of each two, only the first is compared with siblings; "
            "correct the paths in the manifest."
        )
    shared = _shared(rows, copies)
    if shared:
        pairs = [f"{rows[first].entry.label} and {rows[k].entry.label}" for first, k in shared]
        remarks.append(
            f"A log was given for two entries, {listed(pairs)}: they are alike in it, and others may seem to differ; "
            "correct the paths in the manifest (the pattern A-1*.csv finds the logs of A-10, too)."
        )
    blind = sum(not row.reason and row.entry.gives_informations for row in rows)
    if blind:
        remarks.append(
            f"{blind} entr{'y gives' if blind == 1 else 'ies give'} Informations, which hold no rows: what impacts and "
            "other short events leave counts as noise there. Give the logs where that may hide a poor prediction."
        )
    not_explained = tuple(rows[k] for k in strange_or_scaled)
    remarks += _poorly_predicted([row for row in rows if not row.reason and row not in not_explained])
    return Fleet(given, tuple(rows), tuple(groups), tuple(findings), tuple(dict.fromkeys(remarks)), not_explained)


def _estimated(
    manifest: FleetManifest, executor: Executor, checkpoints: Checkpoints | None, say: Progress
) -> list[RobotRow]:
    """Estimate each robot; what was finished before is taken from the checkpoints."""
    found: list[dict[str, Any]] = [{} for _ in manifest.entries]
    numbers, tasks, keys = [], [], None
    described = cache(description_of)  # of this run: the next one may find another description at the same path
    for number, entry in enumerate(manifest.entries):
        try:
            tasks.append(task_of(entry, described(str(entry.robot)), manifest.intervals))
            numbers.append(number)
        except SteelyardError as error:
            found[number] = {"reason": str(error)}
    if checkpoints is not None:
        say(f"hashing the files of {len(tasks)} entries")
        # On a cluster where they lie. Processes of this machine would take longer to start than files to be hashed.
        where = Here() if isinstance(executor, Workers) else executor
        hashes = run_in_order(hashed_files, first_of, None, [[task] for task in tasks], where)
        tasks = [with_contents(task, hashed) for task, hashed in zip(tasks, hashes, strict=True)]
        keys = [checkpoint_key("robot", *inputs_of(task)) for task in tasks]
    every, groups = max(-(-len(tasks) // LINES), 1), [[task] for task in tasks]
    contents = run_in_order(robot_estimate, first_of, None, groups, executor, keys, checkpoints, keep=something_came)
    for done, (number, content) in enumerate(zip(numbers, contents, strict=True), start=1):
        found[number] = {**unpacked(content), "description": tasks[done - 1]["robot"]}
        if done % every == 0 or done == len(tasks):
            say(f"estimated {done} of {len(tasks)} ({manifest.entries[number].label})")
    return [
        RobotRow(entry, str(values["reason"]), values) for entry, values in zip(manifest.entries, found, strict=True)
    ]


def _grouped(rows: Sequence[RobotRow], copies: Container[int]) -> dict[tuple[str, tuple[str, ...]], list[int]]:
    """Numbers of the rows of each group but for copies; robots whose base parameters are others are no siblings.

    Not only their names: arms of other lengths have base parameters of the same names, which are other combinations.
    """
    found: dict[tuple[str, tuple[str, ...]], list[int]] = {}
    for number, row in enumerate(rows):
        model = _model_of(row)
        if model is None or row.values["filtered"] or row.values["short"] or number in copies:
            continue
        names = (*map(str, model.parameter_names), *model.base_parameters().expressions)
        found.setdefault((row.entry.group, names), []).append(number)
    return found


def _strangers(rows: Sequence[RobotRow], grouped: Mapping[Any, Sequence[int]]) -> list[int]:
    """Numbers of rows whose own data no parameters explain, in groups where those of others are explained.

    What such a robot differs in is no friction and no mass: compared all the same, one whose log was in degrees lacked
    all of a link, and one with the joints in another order had a link that was lighter by twice what it weighs. Where
    most models are wrong, something that all robots have is missing in them, and what they show can be compared; but
    for those that leave many times what is left in the others. One that is wrong as masses of no credible robot explain
    the data, such as where a torque reads ten times too much, is told by that torque; but for those whose torques all
    have the other sign, where there are as many of them that there is no mean.
    """
    found: list[int] = []
    for numbers in grouped.values():
        wrong = [k for k in numbers if rows[k].values["word"] == "wrong"]
        errors = {k: float(rows[k].values["least_squares_error"]) for k in numbers}
        explained = [k for k in numbers if k not in wrong]
        few = 2 * len(wrong) < len(numbers)
        if wrong and (few or len(explained) >= FEWEST):
            most = MANY_TIMES * float(np.median([errors[k] for k in explained]))
            usual = np.median([rows[k].values["base"] for k in explained], axis=0)
            found += [k for k in wrong if errors[k] > (min(most, WRONG) if few else most)]
            found += [k for k in wrong if not few and errors[k] <= most and _is_turned(rows[k], usual)]
    return sorted(found)


def _in_other_unit(rows: Sequence[RobotRow], numbers: Sequence[int]) -> tuple[list[int], list[str]]:
    """Numbers of rows whose torques are in another unit than those of most; and sentences."""
    found = other_units(*_arrays(rows, numbers)[:2]) if numbers else []
    left_out = [numbers[k] for one in found for k in one.robots]
    others = listed([rows[k].entry.label for k in numbers if k not in left_out], 8)
    said = []
    for one in found:
        units = ", as where the units of the logs differ"
        if one.units is not None:
            units = f", as where theirs are in {one.units[0]} and those of the others in {one.units[1]}"
        said.append(
            f"The torques of {len(one.robots)} of {len(numbers)} entries "
            f"({listed([rows[numbers[k]].entry.label for k in one.robots], 8)}) are {few_digits(one.factor, 3)} times "
            f"those of the others ({others}){units}: state `torque_unit`, or `gain`, in [log] of the robot file of "
            "each, and run again. The former are not compared with siblings."
        )
    return left_out, said


def _is_turned(row: RobotRow, usual: Array) -> bool:
    """Whether base parameters are the opposite of the usual ones, as where the sign of all torques is."""
    precision = 1.0 / np.diagonal(row.values["covariance"])
    return bool(np.sum(precision * row.values["base"] * usual) < -0.5 * np.sum(precision * usual**2))


def _unexplained(rows: Sequence[RobotRow]) -> str:
    errors = [max(float(row.values[key]) for key in ("least_squares_error", "relative_error")) for row in rows]
    told = listed([f"{row.entry.label} ({100.0 * error:.3g} %)" for row, error in zip(rows, errors, strict=True)])
    return (
        f"No parameters that a robot can have explain the data of {told}: so much of the torques is left, while the "
        "data of siblings is explained. So these are not compared with siblings: see whether their logs are of these "
        f"robots, in the units, with the signs and with the joints in the order that are stated. {DOCTOR}"
    )


def _poorly_predicted(rows: Sequence[RobotRow]) -> list[str]:
    """Say which robots the model predicts poorly: where it does so for all, none differs by that."""
    told = []
    for word, what in (("wrong", "does not predict"), ("poor", "predicts poorly")):
        # Where nothing was held out, no more is claimed of a model either.
        of = [
            row for row in rows if row.values["word"] == word and (word == "wrong" or row.values["source"] != UNTESTED)
        ]
        of.sort(key=lambda row: (-row.values["model_error"], by_name(row.entry.label)))
        if of:
            told.append(
                f"The model {what} the torques of {len(of)} of {len(rows)} entries: "
                f"{listed([row.entry.label for row in of])}. So what differs among them may be what the model lacks, "
                f"or a mistake in their logs or the robot file. {DOCTOR}"
            )
    return told


def _copies(rows: Sequence[RobotRow]) -> dict[int, int]:
    """Return the numbers of rows whose data is that of a row before, with the number of that one.

    Noise makes no two logs give the same numbers to the last bit. Counted as siblings, copies would not vary, and any
    other robot would differ from them.
    """
    first: dict[bytes, int] = {}
    found: dict[int, int] = {}
    for number, row in enumerate(rows):
        if not row.reason:
            told = np.asarray(row.values["base"]).tobytes() + np.asarray(row.values["covariance"]).tobytes()
            before = first.setdefault(told, number)
            if before != number:
                found[number] = before
    return found


def _shared(rows: Sequence[RobotRow], copies: Container[int]) -> list[tuple[int, int]]:
    """Pairs of rows to which one of several logs was given twice."""
    first: dict[str, int] = {}
    found: dict[tuple[int, int], None] = {}
    for number, row in enumerate(rows):
        for content in row.values.get("contents", ()) if number not in copies else ():
            before = first.setdefault(content, number)
            if before != number:
                found[before, number] = None
    return list(found)


def _called(name: str, *, capital: bool = False) -> str:
    called = f"the group {name}" if name else "the fleet"
    return f"{called[0].upper()}{called[1:]}" if capital else called


def _compared(
    name: str, alike: str, rows: Sequence[RobotRow], numbers: Sequence[int], rate: float
) -> tuple[RobotGroup, list[Finding], list[str]]:
    by_robot: dict[str, list[int]] = {}
    # Sums, and the robots by which variances are begun, depend on the order: it is that of the names.
    for number in sorted(numbers, key=lambda k: by_name(rows[k].entry.id)):
        by_robot.setdefault(rows[number].entry.id, []).append(number)
    dates = [sorted(own, key=lambda k: rows[k].entry.date) for own in by_robot.values()]
    latest = [own[-1] for own in dates]
    several = [own for own in dates if len(own) > 1]
    firsts, lasts = [own[0] for own in several], [own[-1] for own in several]
    model = _model_of(rows[numbers[0]])
    assert model is not None
    parameters = np.array([rows[k].values["parameters"] for k in latest])
    bases, covariances, freedoms = _arrays(rows, latest)
    shown = shown_parameters(bases, covariances)
    gains = _gains(rows, latest)
    findings: list[Finding] = []
    remarks: list[str] = []
    called = _called(name)
    siblings = drift = None
    usual = np.ones(len(latest), dtype=bool)
    for _ in range(2):
        known = np.median(parameters[usual], axis=0)
        base = median_of_shown(bases[usual], shown[usual])
        base = np.where(shown[usual].any(axis=0), base, model.base_parameters().K @ known)
        usual_gains = _usual_gains(gains, usual, shown)
        causes = possible_causes(model, known, base, usual_gains)
        in_own_motion = {} if gains is None else gains_in_own_motion(model, causes, gains)
        directions = variations(model, causes)
        if len(latest) >= FEWEST:
            siblings = compare_siblings(
                bases, covariances, causes, directions, rate=rate, freedoms=freedoms, own=in_own_motion
            )
        if siblings is None or not siblings.batches:
            break
        # Sizes are parts of what the others have, which the medians over both batches are not.
        for batch in siblings.batches:
            usual[list(batch.robots)] = False
        if np.sum(usual) < FEWEST:
            break
    if siblings is not None:
        found, remarks = _beside_siblings(name, alike, [rows[k] for k in latest], siblings)
        findings += found
    else:
        remarks.append(
            f"{_called(name, capital=True)} has {len(latest)} robot{'s' * (len(latest) > 1)}{alike} of which something "
            f"came, and siblings are compared where there are {FEWEST} or more."
        )
    if len(several) >= FEWEST:
        before, before_errors, before_freedoms = _arrays(rows, firsts)
        after, after_errors, after_freedoms = _arrays(rows, lasts)
        again = [len(dates_of) > 1 for dates_of in dates]
        gains_first = _gains(rows, firsts)
        gains_before = {}
        if siblings is not None and gains_first is not None:
            # A torque that reads as that of siblings now has changed by a part of what it was. How it was spread over
            # the links then is not how it would be now: told by that, one that read twice too much was a link.
            for k, was in gains_in_own_motion(model, causes, gains_first).items():
                now = siblings.probability[again, k] <= siblings.threshold
                gains_before[k] = np.where(now[:, None], np.nan, was)
        drift = compare_siblings(
            after - before,
            after_errors + before_errors,
            causes,
            directions,
            rate=rate,
            freedoms=np.minimum(before_freedoms, after_freedoms),
            own={k: own[again] for k, own in in_own_motion.items()},
            before=before,
            own_before=gains_before,
        )
        for one in drift.deviations:
            own = several[one.robot]
            history = _history(rows, several, own, one, drift.mean)
            since, whole = _since(history)
            row = rows[own[-1]]
            when = rows[own[0]].entry.date
            as_it_was = _beside_own(one, before[one.robot], np.median(before, axis=0), drift.mean)
            told = sentence(as_it_was, "drift", when=when, since=since, evenly=not whole)
            if beyond := _beyond_scale(one, drift):
                told = f"Beyond {beyond[0]}, {_inside(told)}"
            ratio = 1.0 + as_it_was.amplitude
            findings.append(Finding("drift", row.entry.id, name, row.entry.date, since, one, told, history, ratio))
        remarks += _heavy_tails(f"What changed in robots{alike} of {called}", drift)
        changed = [
            f"{_what(cause)} by {_amount(cause, value)} ({_amount(cause, lower)} to {_amount(cause, upper)})"
            for cause, value, lower, upper in _common(drift)
        ]
        if changed:
            remarks.append(
                f"In {called}, there changed on average{' in robots' * bool(alike)}{alike} from the first date to the "
                f"latest: {all_listed(changed)}."
            )
    elif several:
        remarks.append(
            f"{len(several)} robot{'s' * (len(several) > 1)}{alike} of {called} "
            f"{'have' if len(several) > 1 else 'has'} several dates, and drift is told from what changes in siblings "
            f"where there are {FEWEST} or more; compare single ones with steelyard "
            "compare."
        )
    group = RobotGroup(name, model, tuple(latest), tuple(lasts), siblings, drift, alike)
    return group, findings, remarks


def _beside_siblings(
    name: str, alike: str, rows: Sequence[RobotRow], siblings: SiblingComparison
) -> tuple[list[Finding], list[str]]:
    """Tell batches and robots that differ, and what to know of the comparison; rows are those that were compared."""
    findings: list[Finding] = []
    names = [row.entry.id for row in rows]
    within = f" of {_called(name)}" if name else ""
    for place, batch in enumerate(siblings.batches):
        robots = tuple(names[k] for k in batch.robots)
        larger = [before for before in siblings.batches[:place] if set(batch.robots) < set(before.robots)]
        common = _beside_batches(batch.deviation, larger)
        words = sentence(common, "batch")
        if common is not batch.deviation:
            words = f"Beyond what they share with a larger batch, {_inside(words)}"
        told = (
            f"{len(robots)} of {len(rows)} robots{alike}{within} are of another batch, "
            f"as after a change of a supplier: {listed(robots, 8)}. {words}"
        )
        findings.append(Finding("batch", "", name, "", "", common, told, robots=robots))
    for one in siblings.deviations:
        row, own = rows[one.robot], [batch for batch in siblings.batches if one.robot in batch.robots]
        beside = _beside_batches(one, own)
        told = sentence(beside, "siblings")
        beyond = ["what its batch has in common"] if own else []
        beyond += _beyond_scale(one, siblings)
        if beyond:
            told = f"Beyond {all_listed(beyond)}, {_inside(told)}"
        findings.append(Finding("siblings", row.entry.id, name, row.entry.date, "", beside, told))
    remarks = _heavy_tails(f"What robots{alike} of {_called(name)} vary by", siblings)
    hidden = [_what(siblings.causes[k]) for k in np.flatnonzero(siblings.hidden) if siblings.causes[k].kind != "link"]
    if hidden:
        remarks.append(
            f"Fewer than {FEWEST} robots{alike} of {_called(name)} have logs that show {all_listed(hidden)}: what is "
            "usual there is not known, and none is compared in it."
        )
    if len(rows) < MANY_SIBLINGS:
        remarks.append(
            f"With {len(rows)} robots{alike} in {_called(name)}, what is usual among siblings is hardly known: only "
            f"large differences are told{', and their sizes are rough' * (len(rows) < ROUGH)}."
        )
    return findings, remarks


def _heavy_tails(what: str, compared: SiblingComparison) -> list[str]:
    """Say where sound robots are further out than a normal distribution makes likely, and what follows."""
    parts = [k for k, cause in enumerate(compared.causes) if cause.kind != "link" and compared.tails[k] >= HEAVY]
    if not parts:
        return []
    parts.sort(key=lambda k: (-compared.tails[k], k))
    named = all_listed(_what(compared.causes[k]) for k in parts[:3])
    where = f"most of all {named}" if len(parts) > 3 else named
    return [
        f"{what} seems to have heavier tails than a normal distribution, {where} (as Student's distribution with "
        f"{1.0 / compared.tails[parts[0]]:.0f} degrees of freedom): some sound robots are far from the others in these "
        "parts. So a robot is named only for what is beyond these tails, and a fault must be larger to be named there."
    ]


def _beyond_scale(one: Deviation, compared: SiblingComparison) -> list[str]:
    """Say that a further part of a robot is told beside the factor of all its torques, where one was found."""
    scaled = [other for other in compared.deviations if other.robot == one.robot and other.cause.kind == "scale"]
    return ["that factor of all its torques"] if scaled and one not in scaled else []


def _inside(told: str) -> str:
    """Return a sentence as it goes on behind a comma."""
    return f"{told[0].lower()}{told[1:]}"


def _beside_batches(one: Deviation, batches: Iterable[Batch]) -> Deviation:
    """A difference as a part of what the robots of batches have, where these differ in the same part.

    Friction that is 1.8 times that of the others, in a batch that has 1.2 times theirs, is 1.5 times that of the batch.
    """
    if not one.cause.has_ratio or one.cause.kind == "gain":
        return one
    times = 1.0 + sum(batch.deviation.amplitude for batch in batches if batch.deviation.cause is one.cause)
    if times == 1.0 or times <= LEAST_HELD:
        return one
    amplitude, lower, upper, error = (
        value / times for value in (one.amplitude, one.lower, one.upper, one.standard_error)
    )
    cause = replace(one.cause, nominal=one.cause.nominal * (1.0 if one.cause.kind == "friction" else times))
    return replace(one, cause=cause, amplitude=amplitude, lower=lower, upper=upper, standard_error=error)


def _arrays(rows: Sequence[RobotRow], numbers: Iterable[int]) -> tuple[Array, Array, Array]:
    """Base parameters, their covariances, and the degrees of freedom of these, robot by robot."""
    chosen = [rows[k].values for k in numbers]
    base, covariance, freedom = (np.array([v[key] for v in chosen]) for key in ("base", "covariance", "freedom"))
    return base, covariance, freedom


def _gains(rows: Sequence[RobotRow], numbers: Sequence[int]) -> Array | None:
    """How base parameters change with the gain of each joint's torque, in each robot's motion, (R, n_b, N).

    None where the data of no robot tells the joints apart, NaN for robots whose data does not.
    """
    told = [rows[k].values["gains"] for k in numbers]
    shapes = [np.shape(one) for one in told if one is not None]
    return np.array([np.full(shapes[0], np.nan) if one is None else one for one in told]) if shapes else None


def _usual_gains(gains: Array | None, usual: NDArray[np.bool_], shown: NDArray[np.bool_]) -> Array | None:
    """The same in the motions of most of the siblings that are `usual`, (n_b, N); None where no data tells."""
    told = usual if gains is None else usual & np.isfinite(gains).all(axis=(1, 2))
    if gains is None or not told.any():
        return None
    return np.column_stack([median_of_shown(one, shown[told]) for one in np.moveaxis(gains[told], 2, 0)])


def _beside_own(one: Deviation, own: Array, siblings: Array, mean: Array) -> Deviation:
    """A drift whose amplitude is a part of what the robot itself was at the first date, beside the siblings' change.

    The amplitude that was found is a part of what siblings are at the latest date: friction that was 1.5 times theirs,
    and doubles, grows by 1.5 of it. So does the mass of a link, whose change in kilograms stays as it is.
    """
    # A gain is told as a part of the robot's own already.
    if one.weights is None or one.cause.kind == "gain" or not one.cause.has_ratio:
        return one
    common = float(one.weights @ mean)
    first = held_before(one.weights, own - siblings, mean)
    if first <= LEAST_HELD:
        return one
    ends = np.array([one.amplitude, one.lower, one.upper])
    if one.cause.kind == "mass":
        amplitude, lower, upper = map(float, ends / first)
        cause = replace(one.cause, nominal=first * one.cause.nominal)
        return replace(one, cause=cause, amplitude=amplitude, lower=lower, upper=upper)
    amplitude, lower, upper = map(float, (1.0 - common) * (1.0 + (ends + common) / first) - 1.0)
    return replace(one, amplitude=amplitude, lower=lower, upper=upper)


def _history(
    rows: Sequence[RobotRow], several: Sequence[Sequence[int]], own: Sequence[int], one: Deviation, mean: Array
) -> tuple[tuple[str, float], ...]:
    """The amplitude at each later date, beyond what changed in the siblings from the first date until then.

    A winter between two summers changes all robots, and is gone at last: with what changed until the last date, a joint
    that wore evenly over five dates, of which two were in winter, had half of its wear at the third and less at the
    fourth.
    """
    weights = one.weights
    assert weights is not None
    others = [dates for dates in several if dates is not own]

    def changes(dates: Sequence[int]) -> Array:
        base = np.asarray(rows[dates[0]].values["base"])
        return np.array([weights @ (np.asarray(rows[k].values["base"]) - base) for k in dates])

    when = {k: _days(rows[k].entry.date) for dates in several for k in dates}
    found = changes(own)
    among = [np.interp([when[k] for k in own], [when[k] for k in dates], changes(dates)) for dates in others]
    common = np.median(among, axis=0) if among else np.zeros(len(own))
    common[-1] = float(weights @ mean)  # as the change is told
    return tuple((rows[k].entry.date, float(v)) for k, v in zip(own[1:], (found - common)[1:], strict=True))


def _days(date: str) -> float:
    """A date as a number of days; a time without a zone as if it were in UTC."""
    when = datetime.datetime.fromisoformat(date)
    return (when if when.tzinfo else when.replace(tzinfo=datetime.UTC)).timestamp() / 86400.0


def _since(history: Sequence[tuple[str, float]]) -> tuple[str, bool]:
    """From which date on a change was half of what it is at last, or more; and whether it was nearly all of it then.

    Examples
    --------
    >>> _since([("2026-01-01", 0.1), ("2026-02-01", 0.6), ("2026-03-01", 0.6)])
    ('2026-02-01', True)
    >>> _since([("2026-01-01", 0.2), ("2026-02-01", 0.4), ("2026-03-01", 0.6)])
    ('2026-02-01', False)
    """
    final = history[-1][1]
    parts = [value / final if final else 1.0 for _, value in history]
    first = len(parts) - 1
    while first and parts[first - 1] >= 0.5:
        first -= 1
    return history[first][0], min(parts[first:]) >= NEARLY_ALL


def _common(drift: SiblingComparison) -> list[tuple[Cause, float, float, float]]:
    """Return what changed in all siblings: causes whose mean change leaves zero out, all of them together."""
    from scipy.special import stdtr, stdtrit

    freedom = max(len(drift.robot_probability) - 1.0, 1.0)
    inverse = np.asarray(np.linalg.pinv(drift.mean_covariance, hermitian=True))

    def together(causes: Sequence[Cause]) -> tuple[Array, Array]:
        """The mean changes by these causes, each beside the others, and their standard errors."""
        columns = np.hstack([one.directions for one in causes])
        covariance = pseudo_inverse(columns.T @ inverse @ columns)
        return covariance @ (columns.T @ (inverse @ drift.mean)), np.sqrt(np.diagonal(covariance))

    def chances(causes: Sequence[Cause]) -> Array:
        values, errors = together(causes)
        return np.asarray(2.0 * stdtr(freedom, -np.abs(values) / np.maximum(errors, 1e-300)))

    sure = SURE / len(drift.causes)
    left = [cause for cause in drift.causes if cause.kind != "link"]
    chosen: list[Cause] = []
    while left:  # the likeliest, then what is left beside it
        whole = unexplained(inverse, np.hstack([one.directions for one in chosen])) if chosen else inverse
        columns = np.hstack([cause.directions for cause in left])
        told = np.sum(columns * (whole @ columns), axis=0)
        shown = told > 0.02 * np.sum(columns * (inverse @ columns), axis=0)
        away = np.where(shown, np.abs(columns.T @ whole @ drift.mean) / np.sqrt(np.where(shown, told, 1.0)), 0.0)
        best = int(np.argmax(away))
        if 2.0 * float(stdtr(freedom, -away[best])) > sure:
            break
        cause = left.pop(best)
        # Friction that does not change by one factor: its terms are told, each by its own.
        of_joint = [one for one in (*chosen, *left) if one.part == cause.part and "friction" in one.what]
        terms = [one for one in of_joint if one.kind == "term"]
        factors = [one for one in chosen if one.kind == "friction" and one.part == cause.part and cause.kind == "term"]
        if factors:
            left.append(cause)
            chosen.remove(factors[0])
        elif cause.kind == "friction" and any(one in chosen for one in terms):
            chosen += [one for one in terms if one not in chosen]
            left = [one for one in left if one not in terms]
        else:
            chosen.append(cause)
    while chosen and float(np.max(chances(chosen))) > sure:  # what those that were found later explain as well
        del chosen[int(np.argmax(chances(chosen)))]
    if not chosen:
        return []
    chosen.sort(key=drift.causes.index)
    values, errors = together(chosen)
    reach = float(stdtrit(freedom, 0.975)) * errors
    ends = zip(chosen, values, values - reach, values + reach, strict=True)
    return [(cause, *(_of_first(cause, float(one)) for one in told)) for cause, *told in ends]  # type: ignore[misc]


def _of_first(cause: Cause, change: float) -> float:
    """A change as a part of what was at the first date, where it is told as a ratio; amplitudes are of the latest."""
    return change / max(1.0 - change, 1e-6) if cause.has_ratio else change


def _what(cause: Cause) -> str:
    if cause.kind == "friction":
        return f"the friction of {cause.part}"
    if cause.kind == "mass":
        return f"the mass of {cause.part}"
    return f"the {cause.what} of {cause.part}"


def _whole(link: Cause, beside: Cause) -> str:
    own = beside.kind == "mass" and beside.part == link.part
    return "another centre of mass or inertia of it" if own else f"the link {link.part}"


def _amount(cause: Cause, value: float) -> str:
    if cause.has_ratio:
        return f"{_signed(100.0 * value)} %"
    return f"{_signed(value * cause.nominal)} {cause.unit}".rstrip()


def _signed(value: float) -> str:
    return f"{'+' * (value >= 0.0)}{few_digits(value, 2)}"


def _interval(low: float, high: float, digits: int = 3) -> str:
    least, most = few_digits(low, digits), few_digits(high, digits)
    if np.isfinite(low) and np.isfinite(high):
        return f"{least} to {most}"
    return f"{least} or more" if np.isfinite(low) else f"{most} or less"


def sentence(one: Deviation, kind: Kind, *, when: str = "", since: str = "", evenly: bool = False) -> str:
    """Say in words in what a robot differs from its siblings, or from what it was, or a batch from the others.

    What changed evenly was not all there at the date since which it is told.

    Examples
    --------
    >>> import numpy as np
    >>> friction = Cause("Fcj3", "term", "elbow", "Coulomb friction", "N·m", 2.0, np.ones((1, 1)))
    >>> sentence(Deviation(0, friction, 1.1, 0.1, 0.9, 1.3, 11.0, 1e-20), "siblings")
    'The Coulomb friction of elbow is 2.1 times that of its siblings (1.9 to 2.3), 4.2 N·m where they have 2 N·m.'
    >>> mass = Cause("mass of forearm", "mass", "forearm", "mass", "kg", 6.0, np.ones((1, 1)))
    >>> sentence(Deviation(0, mass, 0.1, 0.01, 0.08, 0.12, 10.0, 1e-18), "siblings")
    'The link forearm is 0.6 kg heavier than that of its siblings (0.48 to 0.72 kg), 10 %, if it is made like theirs.'
    >>> mass = replace(mass, nominal=1.0, unit="")  # of a robot whose masses nobody describes
    >>> print(sentence(Deviation(0, mass, 0.1, 0.01, 0.08, 0.12, 10.0, 1e-18), "siblings"))  # doctest: +ELLIPSIS
    The link forearm is 10 % heavier than that of its siblings (8 to 12 %), if it is made like theirs and the links ...
    >>> gain = Cause("torque gain of elbow", "gain", "elbow", "torque gain", "", 1.0, np.ones((1, 1)))
    >>> print(sentence(Deviation(0, gain, -2.0, 0.1, -2.2, -1.8, 20.0, 1e-80), "siblings"))  # doctest: +ELLIPSIS
    The torque measured at elbow for the same motion is -1 times that of its siblings (-1.2 to -0.8), as where the ...
    """
    cause, low, high = one.cause, one.lower, one.upper
    size, sign = abs(cause.nominal * one.amplitude), 1.0 if one.amplitude >= 0.0 else -1.0
    ends = sorted((sign * cause.nominal * low, sign * cause.nominal * high))
    others = {
        "batch": "that of the others",
        "siblings": "that of its siblings",
        "drift": f"what it was on {when}, beyond what changed in its siblings",
    }[kind]
    if cause.kind == "link":
        than = {"batch": "than that of the others", "siblings": "than its siblings", "drift": f"than on {when}"}[kind]
        text = f"The link {cause.part} has another mass, centre of mass or inertia {than}"
    elif cause.kind == "mass":
        share = f"{few_digits(100.0 * abs(one.amplitude), 2)} %"
        much, within, also = f"{few_digits(size, 2)} kg", f"{_interval(ends[0], ends[1], 2)} kg", f", {share}"
        if not cause.unit:
            ends = [100.0 * end for end in ends]
            much, within, also = share, f"{_interval(ends[0], ends[1], 2)} %", ""
        text = (
            f"The link {cause.part} is {much} {'heavier' if sign > 0.0 else 'lighter'} than {others} ({within}){also}, "
            f"if it is made like {'it was' if kind == 'drift' else 'theirs'}"
        )
        if not cause.unit:  # which torques show in combinations with those of other links
            text += " and the links weigh what is assumed of them, as the description states no mass"
    elif cause.kind in TURNABLE:
        measured = cause.what.removesuffix(" gain")
        text = (
            f"The {measured} measured at {cause.part} for the same motion is {few_digits(1.0 + one.amplitude, 3)} "
            f"times {others} ({_interval(1.0 + low, 1.0 + high)})"
        )
    elif cause.has_ratio:
        times = few_digits(1.0 + one.amplitude, 3)
        text = f"{_what(cause)} is {times} times {others} ({_interval(1.0 + low, 1.0 + high)})"
        if cause.kind == "term" and kind != "drift":
            value = cause.nominal * (1.0 + one.amplitude)
            text += f", {few_digits(value, 3)} {cause.unit} where they have {few_digits(cause.nominal, 3)} {cause.unit}"
    else:
        unit = f" {cause.unit}".rstrip()
        text = (
            f"{_what(cause)} is {few_digits(size, 2)}{unit} {'higher' if sign > 0.0 else 'lower'} than {others} "
            f"({_interval(ends[0], ends[1], 2)}{unit})"
        )
    if kind == "drift":
        text += f", {'half of it or more ' * evenly}since {since}" if since else ""
    if cause.kind in TURNABLE and 1.0 + (high if cause.kind == "scale" else one.amplitude) < 0.0:
        wired = "this joint is wired and logged" if cause.kind == "gain" else "they are logged"
        text += f", as where the sign of the torque or of the position is turned; see how {wired}"
    elif cause.kind == "scale":
        unit = "" if 0.75 < 1.0 + one.amplitude < 1.33 else "in another unit or "  # lb·ft are 1.36 N·m
        text += f", as where they are logged {unit}by another controller"
    elif cause.kind == "gain":
        text += ", as with a sensor of another scale or another motor constant"
    elif cause.kind == "link":
        text += ", as with something attached to it; an encoder near it whose zero is off looks alike"
    elif not cause.can_be(1.0 + high):
        text += (
            f", which no {'link' if cause.kind == 'mass' else 'drive'} has: what differs is something else, such as "
            "the zero of an encoder or how the log was made"
        )
    if one.alternatives:
        named = [_what(other) if other.kind != "link" else _whole(other, cause) for other in one.alternatives[:3]]
        text += f"; {' or '.join(named)} would explain it about as well"
    return f"{text[0].upper()}{text[1:]}."
