"""The arguments of an identification: a robot, and logs as paths or in memory, of which some cannot be used."""

from __future__ import annotations

import glob
import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from steelyard.dynamics import Model, RotorInertia
from steelyard.errors import LONGEST_MESSAGE, InputError, printable
from steelyard.feasibility.constraints import Constraint, constraints_from_dict
from steelyard.files import require_file, shown
from steelyard.recording import LogFile, Measurements, Processing, Samples
from steelyard.recording.columns import LogColumns
from steelyard.recording.formats.registry import Table
from steelyard.robot import Robot, RobotFile

__all__ = [
    "Data",
    "GivenLog",
    "GivenRobot",
    "GivenSamples",
    "One",
    "UnusableLogs",
    "UnusableLogsError",
    "describes_masses",
    "digests",
    "files_named",
    "given_constraints",
    "given_logs",
    "given_robot",
    "given_settings",
    "is_information",
    "may_be_several",
    "wider_model",
    "without_informations",
]


@dataclass(frozen=True, eq=False)
class GivenSamples:
    """Samples that need no processing, under a name."""

    samples: Samples
    name: str

    def __str__(self) -> str:
        return self.name

    def digest(self) -> str:
        """Return the SHA-256 hash of the values, by which one can tell whether data is the same."""
        told = hashlib.sha256()
        for array in (self.samples.q, self.samples.dq, self.samples.ddq, self.samples.torque, self.samples.mask):
            told.update(b"none" if array is None else np.ascontiguousarray(array).data)
        return told.hexdigest()


GivenRobot = str | os.PathLike[str] | RobotFile | Robot | Model
One = str | os.PathLike[str] | Measurements | Samples | Table
Data = One | Sequence[One]
"""One log, or several: each a path (files recorded side by side are joined by ``+``), or what is in memory."""
GivenLog = str | Path | LogFile | GivenSamples
TOLD = 10
"""Logs that a refusal names; of thousands the reasons are mostly the same few."""


def given_robot(robot: GivenRobot) -> tuple[RobotFile, Model]:
    """Return the robot file and the model of what was given as a robot.

    Parameters
    ----------
    robot : path, RobotFile, Robot or Model

    Raises
    ------
    InputError
        If it is none of these, or cannot be used.
    """
    if isinstance(robot, Model):
        return replace(RobotFile.of(robot.robot), terms_are_default=False), robot
    if isinstance(robot, RobotFile | Robot | str | os.PathLike):
        file = _without_references(RobotFile.load(robot))
        return file, Model.from_file(file)
    raise InputError(
        f"The robot is {_named(robot)}; give the path of a description or of a robot.toml, a sy.Robot or a sy.Model."
    )


def _without_references(file: RobotFile) -> RobotFile:
    """Return the file with the columns of references and commands unread in [log]: `qd1` there is no velocity."""
    named = [file.section("controller").get("reference"), file.section("drive").get("command")]
    unread = [name for one in named if one is not None for name in ([one] if isinstance(one, str) else one)]
    own = file.section("log").get("unread", ())
    return file.with_settings("log", unread=[*([own] if isinstance(own, str) else own), *unread]) if unread else file


def wider_model(file: RobotFile, model: Model) -> Model | None:
    """Return the model with rotor inertia at every joint; None where the robot has it, or its terms are stated."""
    stated = not file.terms_are_default or any(isinstance(term, RotorInertia) for term in model.robot.terms)
    return None if stated else model.with_rotors


def describes_masses(model: Model) -> bool:
    """Return whether the description has a mass for every link."""
    parameters = np.asarray(model.robot.parameters)
    return all(parameters[columns[9]] > 0.0 for columns in model.link_columns)


def given_settings(
    file: RobotFile, columns: LogColumns | Mapping[str, Any] | None, processing: Processing | Mapping[str, Any] | None
) -> RobotFile:
    """Return a robot file whose sections ``[log]`` and ``[processing]`` hold these keys in place of their own."""
    for section, kind, settings in (("log", LogColumns, columns), ("processing", Processing, processing)):
        if isinstance(settings, LogColumns | Processing) and isinstance(settings, kind):
            file = file.with_settings(section, **settings.to_dict())
        elif isinstance(settings, Mapping):
            file = file.with_settings(section, **settings)
        elif settings is not None:
            argument = "columns" if section == "log" else section
            raise InputError(f"`{argument}` is {_named(settings)}; give a mapping of the keys of [{section}].")
    return file


def given_constraints(file: RobotFile, further: Sequence[Constraint] | None = None) -> list[Constraint]:
    """Return the constraints of a robot file and those that were given beside it."""
    own = constraints_from_dict(
        file.section("constraints"), folder=file.path.parent, allow_extensions=file.allow_extensions
    )
    if further is not None and not isinstance(further, (list, tuple)):
        raise InputError(f"`constraints` is {_named(further)}; give a list, such as [sy.TotalMass(maximum=20.0)].")
    return [*own, *(further or ())]


def given_logs(
    data: Data, validate: Data | None, remarks: list[str] | None = None
) -> tuple[tuple[GivenLog, ...], tuple[GivenLog, ...]]:
    """Return the logs of an identification and those of its validation, each under a name of its own.

    `remarks` receives a sentence for each set in which files were passed over that may hold logs.

    Raises
    ------
    InputError
        If something is no log.
    """
    logs = [*_listed(data, "data", remarks)]
    validation = [] if validate is None else [*_listed(validate, "validate", remarks)]
    taken = Counter(name for name, _ in (*logs, *validation) if name)
    expressions = [*_expressions("data", len(logs)), *_expressions("validate", len(validation))]
    found = [
        _log(one, f"{name} ({expression})" if name and taken[name] > 1 else name or expression)
        for (name, one), expression in zip([*logs, *validation], expressions, strict=True)
    ]
    return tuple(found[: len(logs)]), tuple(found[len(logs) :])


def _listed(data: object, name: str, remarks: list[str] | None) -> list[tuple[str, Any]]:
    """Return logs one by one, each with the name that it has by itself; an empty one where it has none."""
    paths = [data] if isinstance(data, (str, os.PathLike)) else data
    if isinstance(paths, (list, tuple)) and all(isinstance(one, (str, os.PathLike)) for one in paths):
        return [("", one) for one in _expanded(paths, remarks)]
    from steelyard.recording.formats.memory import REMEDY, is_table  # what is not asked for is not loaded

    if isinstance(data, Samples) or is_table(data):
        return [(_own_name(data), data)]
    if not isinstance(data, Iterable) or isinstance(data, (bytes, np.ndarray)):
        raise InputError(f"{name} is {_named(data)}, which does not say what its columns are; {REMEDY}.")
    found = list(data)
    for one in found:
        if not isinstance(one, (str, os.PathLike, Samples)) and not is_table(one):
            raise InputError(
                f"{name} is a list that holds {_named(one)}, which does not say what it is; {REMEDY}, or a list of "
                "these."
            )
    return [(_own_name(one), one) for one in found]


def is_information(path: str) -> bool:
    """Whether a path is that of an Information, and not of a log."""
    return path.lower().endswith(".json")


def files_named(patterns: Iterable[str], remedy: str) -> tuple[str, ...]:
    """Return the files that paths and patterns stand for, those of a pattern in the order of their names.

    Raises
    ------
    InputError
        If a file is missing, or nothing has a name like a pattern; the message ends with the remedy.
    """
    found: list[str] = []
    for pattern in patterns:
        if "://" in pattern or not glob.has_magic(pattern) or os.path.exists(pattern):
            if "://" not in pattern:
                require_file(pattern.split("+")[0], remedy)
            found.append(pattern)
            continue
        files = sorted(one for one in glob.glob(pattern, recursive=True) if os.path.isfile(one))
        if not files:
            raise InputError(f"{shown(pattern)}: no file has such a name; {remedy}.")
        found += files
    return tuple(dict.fromkeys(found))


def without_informations(data: Data) -> tuple[Data, tuple[str, ...]]:
    """Return the logs of some data, and the files of Informations among them."""
    given = [data] if isinstance(data, (str, os.PathLike)) else data
    if not isinstance(given, (list, tuple)):
        return data, ()
    named = [isinstance(one, (str, os.PathLike)) and is_information(os.fspath(one)) for one in given]
    logs = [one for one, apart in zip(given, named, strict=True) if not apart]
    return (
        logs if any(named) else data,
        files_named([os.fspath(one) for one, apart in zip(given, named, strict=True) if apart], "correct its path"),
    )


def may_be_several(text: str) -> bool:
    """Whether a path looks like one that stands for others: an address, a pattern or a folder, which may be a bag."""
    return "://" in text or any(mark in text for mark in "*?[") or os.path.isdir(text)


def _expanded(
    paths: Sequence[str | os.PathLike[str]], remarks: list[str] | None = None
) -> list[str | os.PathLike[str]]:
    """Return the logs that paths, folders, patterns and addresses stand for; what a set finds again counts once."""
    texts = [os.fspath(path) for path in paths]
    if not any(map(may_be_several, texts)):
        return list(paths)
    # What is not asked for is not loaded.
    from steelyard.recording.formats.log_sets import is_log_set, logs_in, place_of

    sets = [logs_in(text, remarks) if is_log_set(text) else None for text in texts]
    named = {place_of(text) for text, found in zip(texts, sets, strict=True) if found is None}
    result: list[str | os.PathLike[str]] = []
    for path, found in zip(paths, sets, strict=True):
        for one in [path] if found is None else found:
            place = place_of(os.fspath(one))
            if found is None or place not in named:
                result.append(one)
                named.add(place)
    return result


def _own_name(data: object) -> str:
    return data.source if isinstance(data, Measurements) and data.source != "recording" else ""


def _expressions(name: str, count: int) -> list[str]:
    return [name] if count == 1 else [f"{name}[{index}]" for index in range(count)]


def _log(data: Any, name: str) -> GivenLog:
    if isinstance(data, Samples):
        return GivenSamples(data, name)
    if isinstance(data, (str, os.PathLike)):
        return os.fspath(data)
    from steelyard.recording.formats.memory import memory_log

    return memory_log(data, name)


def _named(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    kind = type(value).__name__
    return f"{'an' if kind[:1].lower() in 'aeiou' else 'a'} {kind}"


def digests(logs: Iterable[object]) -> dict[str, str]:
    """Return the SHA-256 hash of what was in memory, by its name."""
    return {str(log): log.digest() for log in logs if not isinstance(log, (str, Path)) and hasattr(log, "digest")}


class UnusableLogsError(InputError):
    """Logs of a set that cannot be used: how many of how many, and a line for each of the first ten with its reason.

    Parameters
    ----------
    reasons : mapping from str to str
        Why each of them cannot, by its name.
    count : int
        How many logs the set has.

    Examples
    --------
    >>> raise UnusableLogsError({"b.csv": "b.csv is empty; expected rows.", "c.csv": "It has no torques."}, 3)
    Traceback (most recent call last):
    steelyard.identification.given.UnusableLogsError: 2 of 3 logs cannot be used; mend them, or leave them out:
    b.csv is empty; expected rows.
    c.csv: It has no torques.
    """

    longest: ClassVar[int] = (TOLD + 2) * LONGEST_MESSAGE

    def __init__(self, reasons: Mapping[str, str], count: int) -> None:
        self.reasons = dict(reasons)
        self.count = count
        many = len(self.reasons)
        it = "it" if many == 1 else "them"
        lines = [f"{many} of {count} logs cannot be used; mend {it}, or leave {it} out:"]
        for log, reason in list(self.reasons.items())[:TOLD]:
            line = reason if printable(log) in reason else f"{log}: {reason}"
            lines.append(line.replace("\n", "\\n"))  # a name may hold one
        if many > TOLD:
            lines.append(f"And {many - TOLD} more.")
        super().__init__("\n".join(lines))

    @property
    def lines(self) -> tuple[str, ...]:
        """How many cannot be used, and what is said of each."""
        return tuple(str(self).split("\n"))

    def __reduce__(self) -> tuple[type[UnusableLogsError], tuple[dict[str, str], int]]:
        return type(self), (self.reasons, self.count)


class UnusableLogs:
    """The logs of a set that were found to be unusable so far, while the others are looked through.

    Attributes
    ----------
    reasons : dict from str to str
        Why each of them is, by its name.

    Examples
    --------
    >>> found = UnusableLogs()
    >>> for log in ("a.csv", "b.csv"):
    ...     with found.noting(log, count=2):
    ...         if log == "b.csv":
    ...             raise InputError("b.csv is empty; expected rows.")
    >>> found.reasons
    {'b.csv': 'b.csv is empty; expected rows.'}
    """

    def __init__(self) -> None:
        self.reasons: dict[str, str] = {}

    def __bool__(self) -> bool:
        return bool(self.reasons)

    def __contains__(self, log: object) -> bool:
        return str(log) in self.reasons

    @contextmanager
    def noting(self, log: GivenLog, count: int, say: Callable[[str], None] = lambda _: None) -> Iterator[None]:
        """Note why a log cannot be used, one of so many; nothing is held back where it is the only one."""
        try:
            yield
        except InputError as error:
            if count == 1:
                raise
            self.note(log, str(error), say)

    def note(self, log: GivenLog, reason: str, say: Callable[[str], None] = lambda _: None) -> None:
        """Note why a log cannot be used; the first is told at once, as it may take long to look through the others."""
        if not self.reasons:
            say(f"{log} cannot be used; looking through the other logs, to tell all that cannot")
        self.reasons.setdefault(str(log), reason)

    def refuse(self, logs: Sequence[GivenLog]) -> None:
        """Refuse a set of logs of which some cannot be used.

        Parameters
        ----------
        logs : sequence
            All of the set, in whose order they are told.

        Raises
        ------
        UnusableLogsError
            If there are any.
        """
        found = {name: self.reasons[name] for name in map(str, logs) if name in self.reasons}
        if found:
            raise UnusableLogsError(found, len(logs))
