"""Identification from logs with a payload: of the payload or, where that is known, of the gains of the drives."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.estimators.carried_body import CarriedBody, Changes, mounting
from steelyard.estimators.drive_gains import DriveGains, KnownPayload, estimate_drive_gains
from steelyard.estimators.payload_estimate import (
    KnownRobot,
    PayloadEstimate,
    PayloadQuantity,
    estimate_payload,
    unexplained_with,
)
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.constraints.toml_section import read_placement
from steelyard.files import TomlTable, suggestion, write_json
from steelyard.recording.chunks import CHUNK_ROWS
from steelyard.regression import Estimate, Information, least_squares
from steelyard.regression.body_change import BodyChange
from steelyard.regression.time_blocks import FOLDS, TimeBlocks
from steelyard.robot import RobotFile
from steelyard.robot.inertia import inertia_tensor

from .default_terms import decide_rotors, model_of_estimate
from .given import given_constraints, wider_model
from .log_reader import LogReader
from .reduced_logs import reduced_logs, told_by_rows
from .saved import matching_estimate

__all__ = [
    "DriveGainIdentification",
    "PayloadIdentification",
    "identify_drive_gains",
    "identify_payload",
    "payload_mounting",
]

Array = NDArray[np.float64]
PAYLOAD_FORMAT, GAINS_FORMAT = "steelyard-payload-1", "steelyard-drive-gains-1"
KEYS = ("frame", "placement", "changes", "mass", "center_of_mass", "inertia")
Given = str | Path | Sequence[str | Path] | Information
"""Logs of one kind: a path, several, or an Information that was made of them."""
_SUSPECT, _BETTER = 1.5, 0.75
"""Error of the loaded log over that of the robot alone from which other places of the payload are tried, and share of
it that the best of them leaves at most. A payload of 1.5 kg in the wrong hand of a Baxter leaves 8.4 % and not 1 %;
fixed to a finger in the place of the hand of a Panda, 7.4 % and not 1 %. Likewise the error of the unloaded log over
that of the robot alone from which the logs are not of one robot: 19 % and not 8 % where two columns of torques of the
loaded log changed places."""
_MOST_FRAMES = 3


@dataclass(frozen=True, eq=False)
class PayloadIdentification:
    """The result of :func:`identify_payload`.

    Attributes
    ----------
    estimate : PayloadEstimate
        The payload in the mounting frame, with intervals.
    robot_name : str
    frame : str
        In which it is mounted, a link of the description.
    placement : (4, 4) array
        Of the mounting frame in that frame.
    robot_file : Path
    unloaded_logs, loaded_logs : tuple of str
    known_robot : str or None
        The saved estimate that stood for the robot.
    options : dict
        All the choices, as plain data.
    stated_mass : float or None
        kg, where ``[payload]`` states one; it has no part in the estimate.
    remarks : tuple of str
        What the user should know, a sentence each.
    doubts : tuple of str
        Those of the remarks for which the intervals do not hold; they stand before what they are about.
    """

    estimate: PayloadEstimate
    robot_name: str
    frame: str
    placement: Array = field(repr=False)
    robot_file: Path
    unloaded_logs: tuple[str, ...]
    loaded_logs: tuple[str, ...]
    known_robot: str | None
    options: dict[str, Any] = field(repr=False)
    stated_mass: float | None = None
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"PayloadIdentification({self.robot_name}: {self.estimate['mass']})"

    def __str__(self) -> str:
        notes = (f"Note: {remark}" for remark in self.remarks if remark not in self.doubts)
        return "\n".join([*self.sentences(), str(self.estimate), *notes])

    def sentences(self) -> tuple[str, ...]:
        """The findings as sentences, what makes them doubtful first."""
        estimate = self.estimate
        mass = estimate["mass"]
        moved = "" if np.array_equal(self.placement, np.eye(4)) else ", moved as [payload] says"
        upper = f"{mass.upper:.4g} kg" if np.isfinite(mass.upper) else "any mass"
        if mass.lower <= 0.0:
            heavy = f"The data do not show that anything is carried: it may weigh nothing, and up to {upper}"
        elif np.isnan(mass.value):
            heavy = (
                f"The motion does not show the mass of the payload; it is at least {mass.lower:.4g} kg, up to {upper}"
            )
        elif self.doubts:
            heavy = f"The payload comes out at {mass.value:.4g} kg"
        elif np.isnan(mass.lower):
            heavy = f"The payload weighs {mass.value:.4g} kg"
        else:
            heavy = (
                f"The payload weighs {mass.value:.4g} kg, with a probability of 95 % between {mass.lower:.4g} and "
                f"{upper}"
            )
        found = [
            *self.doubts,
            f"{heavy}.",
            f"Places and axes are those of the frame {self.frame}{moved}.",
            f"The torques of the loaded log are explained to {estimate.loaded_error:.2%}, by the robot alone to "
            f"{estimate.robot_alone_error:.2%}."
            + (
                f" Those of the unloaded log are explained to {estimate.unloaded_error:.2%}."
                if np.isfinite(estimate.unloaded_error)
                else ""
            ),
        ]
        if self.stated_mass is not None:
            place = "within" if self.stated_mass in mass else "outside"
            found.append(f"The mass of {self.stated_mass:.4g} kg that [payload] states lies {place} the interval.")
        for standing, words in (
            ("bounded", "The motion hardly shows these, but a real body cannot have just any"),
            ("open", "The motion does not show these, and nothing bounds them"),
        ):
            names = [one.meaning for one in estimate.quantities if one.standing == standing]
            if names:
                found.append(f"{words}: {', '.join(names)}.")
        return tuple(found)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data: dictionaries, lists, texts and numbers."""
        estimate = self.estimate
        errors = ("condition_number", "unloaded_error", "loaded_error", "robot_alone_error", "distance")
        return {
            "format": PAYLOAD_FORMAT,
            "robot": self.robot_name,
            "robot_file": str(self.robot_file),
            "frame": self.frame,
            "placement": self.placement,
            "unloaded_logs": self.unloaded_logs,
            "loaded_logs": self.loaded_logs,
            "known_robot": self.known_robot,
            "mass": estimate.mass,
            "center_of_mass": estimate.center_of_mass,
            "inertia_about_com": estimate.inertia,
            "stated_mass": self.stated_mass,
            "quantities": estimate.quantities,
            "parameters": estimate.parameters,
            "friction": {
                "names": estimate.friction_names,
                "unloaded": estimate.friction,
                "loaded": estimate.loaded_friction,
                "standard_error_of_change": estimate.friction_error,
            },
            **{name: getattr(estimate, name) for name in errors},
            "independent_rows": estimate.inflation,
            "options": self.options,
            "remarks": self.remarks,
            "certificate": estimate.certificate,
        }

    def save(self, path: str | Path) -> None:
        """Write it as JSON, numbers that are not known as null; the file appears whole or not at all."""
        write_json(self.to_dict(), path)


@in_one_thread
def identify_payload(
    robot: str | Path | RobotFile,
    loaded: Given,
    unloaded: Given = (),
    *,
    estimate: str | Path | Estimate | None = None,
    frame: str | None = None,
    placement: ArrayLike | None = None,
    changes: Changes | None = None,
    consistency: Literal["full", "inertia"] = "full",
    weights: Literal["joint"] | None = "joint",
    chunk_rows: int = CHUNK_ROWS,
    progress: Callable[[str], None] | None = None,
) -> PayloadIdentification:
    """Find mass, centre of mass and inertia of what a robot carries.

    Parameters
    ----------
    robot : str, Path or RobotFile
        A URDF, or a robot.toml with terms, log columns, processing, constraints and a section ``[payload]``.
    loaded : path, sequence of path, or Information
        Logs with the payload.
    unloaded : path, sequence of path, or Information, optional
        Logs of the same robot without it; the payload is then what differs, and nothing need be known of the robot.
    estimate : path or Estimate, optional
        The identified robot, instead of `unloaded`: what it keeps is its base parameters and their covariance.
    frame : str, optional
        The mounting frame, a link of the description; that of ``[payload]``, or the last link, where absent.
    placement : array_like, optional
        (4, 4) of the mounting frame in that frame.
    changes : {"nothing", "friction", "friction-and-offset"}, optional
        What of the joints may be other than without the payload; that of ``[payload]``, or ``"friction"``, where
        absent.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.
    weights : {"joint", None}
        See :func:`steelyard.least_squares`.
    chunk_rows : int
        Rows of a log that stand in memory together.
    progress : callable, optional
        Called with a few words before each step.

    Raises
    ------
    InputError
        If the robot, a log or an option cannot be used; the message says why and what to do.

    See Also
    --------
    steelyard.estimators.estimate_payload : The same from Informations.
    steelyard.identification.excite : Designs a motion that shows a payload, with the subset ``"payload"``.
    """
    if (estimate is None) == _is_nothing(unloaded):
        raise InputError(
            "A payload is found from a log without and a log with it, or from the latter and an estimate of the robot: "
            "give UNLOADED and LOADED, or LOADED and --estimate."
        )
    logs = _Logs(robot, loaded, unloaded, frame, placement, changes, chunk_rows, progress, estimate)
    if any(logs.find):
        raise InputError(
            f"{logs.file.path}, [log]: drive gains are to be found, and currents alone tell no mass; find the gains "
            "with a payload of known mass first (identify_drive_gains), and write them as `gain`."
        )
    saved = matching_estimate(logs.model, estimate) if isinstance(estimate, str | Path) else estimate
    known = None if saved is None else _known(logs.model, saved)
    logs.read(consistency)
    logs.say("least squares of both" if known is None else "least squares")
    found = estimate_payload(
        logs.body,
        logs.loaded,
        logs.unloaded,
        robot=known,
        consistency=consistency,
        constraints=logs.constraints if known is None else (),
        weights=weights,
    )
    if saved is None and logs.unloaded is not None:
        saved = least_squares(logs.unloaded, weights)
    of_robot = np.nan if saved is None else saved.relative_error
    heavy, another = _heavier_than(logs.model, saved, found["mass"]), _another_robot(found.unloaded_error, of_robot)
    elsewhere = () if heavy else _mounted_elsewhere(logs, found.loaded_error, of_robot, known, weights)
    doubts = (*logs.changes_within, *(elsewhere or (*another, *heavy)))
    mass = logs.section.number("mass") if "mass" in logs.section else None
    return PayloadIdentification(
        estimate=found,
        robot_name=logs.model.robot.name,
        frame=logs.frame,
        placement=logs.placement,
        robot_file=logs.file.path,
        unloaded_logs=logs.paths["unloaded"],
        loaded_logs=logs.paths["loaded"],
        known_robot=None if estimate is None else str("estimate" if isinstance(estimate, Estimate) else estimate),
        options={"consistency": consistency, "weights": weights, **logs.options},
        stated_mass=mass,
        remarks=tuple(dict.fromkeys((*doubts, *found.remarks, *logs.remarks))),
        doubts=doubts,
    )


@dataclass(frozen=True, eq=False)
class DriveGainIdentification:
    """The result of :func:`identify_drive_gains`.

    Attributes
    ----------
    estimate : DriveGains
    robot_name : str
    payload : KnownPayload
        What set the scale.
    frame : str
    placement : (4, 4) array
    robot_file : Path
    unloaded_logs, loaded_logs : tuple of str
    options : dict
    remarks : tuple of str
    """

    estimate: DriveGains
    robot_name: str
    payload: KnownPayload
    frame: str
    placement: Array = field(repr=False)
    robot_file: Path
    unloaded_logs: tuple[str, ...]
    loaded_logs: tuple[str, ...]
    options: dict[str, Any] = field(repr=False)
    remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"DriveGainIdentification({self.robot_name}: {self.toml_line})"

    def __str__(self) -> str:
        return "\n".join([*self.sentences(), str(self.estimate), *(f"Note: {remark}" for remark in self.remarks)])

    @property
    def toml_line(self) -> str:
        """The line of ``[log]`` that states the gains."""
        return f"gain = [{', '.join(f'{gain:.6g}' for gain in self.gains)}]"

    @property
    def gains(self) -> Array:
        """(N,) of all joints, those that were stated included."""
        stated = self.options["log"].get("gain")
        given = np.ones(len(self.estimate.gains))
        if isinstance(stated, (list, tuple)):
            given = np.array([1.0 if isinstance(one, str) else one for one in stated])
        return np.where(self.estimate.found, self.estimate.gains, given)

    def sentences(self) -> tuple[str, ...]:
        """The findings as sentences."""
        known = {1: "its mass", 4: "its mass and its centre of mass", 10: "all its parameters"}
        return (
            f"The drive gains of {self.robot_name}, N·m or N for a unit of the currents, with intervals of 95 %, by a "
            f"payload of {self.payload.mass:.4g} kg of which {known[len(self.payload.known)]} "
            f"{'are' if len(self.payload.known) > 1 else 'is'} known.",
            f"The currents of both logs are explained to {self.estimate.relative_error:.2%}, joint by joint.",
            f"In [log] of the robot file: {self.toml_line}",
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data: dictionaries, lists, texts and numbers."""
        estimate = self.estimate
        return {
            "format": GAINS_FORMAT,
            "robot": self.robot_name,
            "robot_file": str(self.robot_file),
            "frame": self.frame,
            "placement": self.placement,
            "payload": self.payload,
            "unloaded_logs": self.unloaded_logs,
            "loaded_logs": self.loaded_logs,
            "joints": estimate.joint_names,
            "found": estimate.found,
            "gains": self.gains,
            "lower": estimate.lower,
            "upper": estimate.upper,
            "relative_error": estimate.relative_error,
            "distance": estimate.distance,
            "options": self.options,
            "remarks": self.remarks,
        }

    def save(self, path: str | Path) -> None:
        """Write it as JSON, numbers that are not known as null; the file appears whole or not at all."""
        write_json(self.to_dict(), path)


@in_one_thread
def identify_drive_gains(
    robot: str | Path | RobotFile,
    loaded: Given,
    unloaded: Given,
    *,
    payload: KnownPayload | float | None = None,
    find: Sequence[bool] | None = None,
    frame: str | None = None,
    placement: ArrayLike | None = None,
    changes: Changes | None = None,
    consistency: Literal["full", "inertia"] = "full",
    chunk_rows: int = CHUNK_ROWS,
    progress: Callable[[str], None] | None = None,
) -> DriveGainIdentification:
    """Find how much torque a unit of current makes at each joint, from logs without and with a known payload.

    Parameters
    ----------
    robot : str, Path or RobotFile
        A robot.toml, whose ``[log]`` says ``"find"`` in `gain` where a gain is unknown.
    loaded, unloaded
        Logs with the payload and without it, as in `identify_payload`.
    payload : KnownPayload or float, optional
        What is known of the payload; a number is its mass, kg. What ``[payload]`` states where absent.
    find : sequence of bool, optional
        (N,) which gains are to be found; what ``[log]`` says where absent. For Informations, of which it says nothing.
    frame, placement, changes, consistency, chunk_rows, progress
        As in `identify_payload`.

    Raises
    ------
    InputError
        If no gain is to be found, nothing is known of the payload, or a file or an option cannot be used.

    See Also
    --------
    steelyard.estimators.estimate_drive_gains : The same from Informations.
    steelyard.estimators.gains_from_equations : From logs without payload, where link masses are known.
    """
    if _is_nothing(unloaded):
        raise InputError(
            "Drive gains are found from a log without and a log with a known payload: give UNLOADED and LOADED."
        )
    logs = _Logs(robot, loaded, unloaded, frame, placement, changes, chunk_rows, progress)
    asked = logs.find if find is None else tuple(find)
    if not any(asked):
        raise InputError(
            f'{logs.file.path}, [log]: no drive gain is to be found; write gain = "find", or "find" in the place of '
            "those that are unknown."
        )
    if isinstance(payload, (int, float)):
        payload = KnownPayload(payload)
    known = payload or _stated(logs.section)
    if known is None:
        raise InputError(
            f"{logs.section.where}: drive gains are to be found, which needs a payload of known mass in one of the "
            "logs: give --mass, or mass in [payload]."
        )
    logs.read()
    logs.say("drive gains")
    assert logs.unloaded is not None
    found = estimate_drive_gains(
        logs.body,
        logs.loaded,
        logs.unloaded,
        known,
        asked,
        consistency=consistency,
        constraints=logs.constraints,
    )
    return DriveGainIdentification(
        estimate=found,
        robot_name=logs.model.robot.name,
        payload=known,
        frame=logs.frame,
        placement=logs.placement,
        robot_file=logs.file.path,
        unloaded_logs=logs.paths["unloaded"],
        loaded_logs=logs.paths["loaded"],
        options={"consistency": consistency, **logs.options},
        remarks=tuple(dict.fromkeys((*found.remarks, *logs.remarks))),
    )


class _Logs:
    """A robot file, what it says of a payload, and the logs of both kinds, reduced."""

    def __init__(
        self,
        robot: str | Path | RobotFile,
        loaded: Given,
        unloaded: Given,
        frame: str | None,
        placement: ArrayLike | None,
        changes: Changes | None,
        chunk_rows: int,
        progress: Callable[[str], None] | None,
        estimate: str | Path | Estimate | None = None,
    ) -> None:
        self.say = progress or (lambda _: None)
        self.file = RobotFile.load(robot)
        self.model = model_of_estimate(estimate, self.file)
        self.section = _section(self.file)
        self.changes = changes or self.section.text("changes") or "friction"
        if self.changes not in get_args(Changes):
            raise InputError(
                f"{self.section.where}: changes is {self.changes!r}; {suggestion(self.changes, get_args(Changes))}"
            )
        link, place, self.frame, self.placement = payload_mounting(self.file, self.model, frame, placement)
        self.body = CarriedBody(self.model, link, place, self.changes)  # type: ignore[arg-type]
        self.given = {"unloaded": unloaded, "loaded": loaded}
        self.paths = {role: _paths(one) for role, one in self.given.items()}
        if _is_nothing(loaded):
            raise InputError(
                "At least one log with the payload is needed; give the path of one, such as a CSV or a bag."
            )
        self.reader = LogReader(self.file, self.model, chunk_rows)
        self.find = self.reader.columns.gains_to_find(self.model.dof)
        self.constraints = given_constraints(self.file)
        # Of what was reduced before the terms are decided, and of currents no rotor is told before their gains are.
        read = self.paths["unloaded"] and self.paths["loaded"] and not any(self.find)
        self._wider = wider_model(self.file, self.model) if read else None
        self._blocks: dict[str, TimeBlocks] = {}
        self._changes: list[tuple[str, str, BodyChange]] = []

    def read(self, consistency: Literal["full", "inertia"] = "full") -> None:
        """Reduce the logs, for a model with the inertia of rotors where nobody states terms and the logs show it."""
        # Of one kind alone: with a payload it is another robot, and neither explains the torques of the other.
        deciding = self.paths["unloaded"] or self.paths["loaded"]
        if deciding:
            self.reader.decide(deciding, self.say)
        self._names: dict[Hashable, tuple[str, str]] = {}
        self._data = {
            role: one if isinstance(one, Information) else self._reduced(self.paths[role], role)
            for role, one in self.given.items()
        }
        self._decide_rotors(consistency)

    def _decide_rotors(self, consistency: Literal["full", "inertia"]) -> None:
        """Take the model with rotors where least squares show one in the logs without the payload.

        Without it what differs between two motions, and what a model lacks in one, counts as payload. *Measured* on a
        simulated arm with rotors of a tenth of its torques: with another motion in the unloaded log, 2 kg came out at
        1.95 (1.84 to 2.06) and not 1.99 kg (1.97 to 2.01).
        """
        wider, unloaded = self._wider, self.unloaded
        if wider is None or unloaded is None:
            return
        self.say("have the rotors an inertia that shows?")
        feasible_set = FeasibleSet(self.model, consistency, self.constraints)
        stretches = unloaded.stretches(self._blocks["unloaded"], FOLDS)
        decision = decide_rotors(feasible_set, wider, unloaded, stretches, by_description=False)
        if not decision.taken:
            self._data = {role: one and one.narrowed(wider, self.model) for role, one in self._data.items()}
            return
        self.model = self.reader.model = wider
        self.body = replace(self.body, model=wider)
        self.reader.remarks.append(decision.sentence(self.file.path.name))

    def _reduced(self, logs: Sequence[str], role: str) -> Information | None:
        """Reduce the logs of one kind together."""
        if not logs:
            return None
        found = reduced_logs(self.reader, logs, (), self._wider or self.model, None, self.say)
        for log in found.logs:
            other, before = self._names.setdefault(told_by_rows(log.information), (log.name, role))
            if before != role:
                named = log.name if log.name == other else f"{other} and {log.name}"
                raise InputError(
                    f"{named}: the same rows are given without and with the payload, so that nothing tells it; give a "
                    "log of each."
                )
        self._changes.extend((log, role, change) for log, change in found.changes.items())
        self._blocks[role] = found.blocks
        self.reader.remarks.extend(found.drift_sentences)
        return found.information

    @property
    def unloaded(self) -> Information | None:
        return self._data["unloaded"]

    @property
    def loaded(self) -> Information:
        found = self._data["loaded"]
        assert found is not None
        return found

    @property
    def changes_within(self) -> tuple[str, ...]:
        """Say of each log that is of a payload in one part only what to give of it."""
        found = []
        for log, role, change in self._changes:
            after = (change.mass > 0.0) == (role == "loaded")
            part = f"after {change.latest:.1f} s" if after else f"before {change.earliest:.1f} s"
            found.append(
                f"{change.sentence(log)} What is told of the payload is right for neither part, and no interval holds: "
                f"give of this log what was recorded {part} alone."
            )
        return tuple(found)

    @property
    def remarks(self) -> tuple[str, ...]:
        return tuple(self.reader.remarks)

    @property
    def options(self) -> dict[str, Any]:
        """All the choices, as plain data."""
        return {
            "changes": self.changes,
            "log": self.reader.columns.to_dict(),
            "processing": self.reader.stated.to_dict(),
            "decided": self.reader.decided,
            "constraints": self.file.section("constraints"),
        }


def _section(file: RobotFile) -> TomlTable:
    return TomlTable(file.section("payload"), f"{file.path}, [payload]", KEYS)


def payload_mounting(
    file: RobotFile, model: Model, frame: str | None = None, placement: ArrayLike | None = None
) -> tuple[int, Array, str, Array]:
    """Find where a payload is mounted: as stated, or as the section ``[payload]`` of a robot file says.

    Parameters
    ----------
    placement : (4, 4) array_like, optional
        Both instead of what the section says.

    Returns
    -------
    link : int
        Index of the moving link that carries it.
    place : (4, 4) array
        The mounting frame in that link.
    frame : str
    placement : (4, 4) array
        The mounting frame in that frame.
    """
    section = _section(file)
    if placement is None and "placement" in section:
        placement = read_placement(section["placement"], f"{section.where}: placement")
    inner = np.eye(4) if placement is None else np.asarray(placement, dtype=float)
    link, place, name = mounting(model, frame or section.text("frame", "the name of a link"), inner)
    return link, place, name, inner


def _is_nothing(logs: Given) -> bool:
    return not isinstance(logs, (str, Path, Information)) and len(logs) == 0


def _stated(section: TomlTable) -> KnownPayload | None:
    """Return what [payload] says of a known payload."""
    if "mass" not in section:
        return None
    center = (
        section.numbers("center_of_mass", 3, expected="three numbers in m") if "center_of_mass" in section else None
    )
    inertia = None
    if "inertia" in section:
        rows = "six numbers in kg m², xx xy xz yy yz zz about the centre of mass"
        inertia = inertia_tensor(section.numbers("inertia", 6, expected=rows))
    return KnownPayload(section.number("mass"), center, inertia)


def _paths(logs: Given) -> tuple[str, ...]:
    if isinstance(logs, Information):
        return ()
    return (str(logs),) if isinstance(logs, (str, Path)) else tuple(map(str, logs))


def _mounted_elsewhere(
    logs: _Logs, error: float, of_robot: float, robot: KnownRobot | None, weights: Literal["joint"] | None
) -> tuple[str, ...]:
    """Say where a payload would explain the loaded log far better, as where the wrong arm of two was named."""
    if not error > _SUSPECT * of_robot:
        return ()
    names = logs.model.robot.link_names
    errors = {
        link: unexplained_with(
            replace(logs.body, link=link, placement=np.eye(4)), logs.loaded, logs.unloaded, robot=robot, weights=weights
        )
        for link in range(len(names))
        if link != logs.body.link
    }
    best = min(errors, key=lambda link: errors[link][0], default=None)
    if best is None or errors[best][0] > _BETTER * error or errors[best][1] > _SUSPECT * of_robot:
        return ()
    held = ", ".join(one.name for one in logs.model.robot.links[best].attachments[:_MOST_FRAMES])
    return (
        f"The payload looks to be mounted elsewhere: fixed to {names[best]}{f' (which carries {held})' if held else ''}"
        f" it would explain the torques of the loaded log to {errors[best][0]:.2%} and not {error:.2%}; say where it "
        "is with --frame, or frame in [payload].",
    )


def _heavier_than(model: Model, robot: Estimate | None, mass: PayloadQuantity) -> tuple[str, ...]:
    """Say where the payload outweighs what carries it, as where the torques of its log have another unit."""
    told = None if robot is None else robot.parameters
    parameters = np.asarray(model.robot.parameters, dtype=float) if told is None else told
    links = float(sum(parameters[columns[9]] for columns in model.link_columns))
    if not mass.lower > links > 0.0:
        return ()
    weight = f"at least {mass.lower:.3g}" if np.isnan(mass.value) else f"{mass.value:.3g}"
    return (
        f"The payload would weigh more than all the moving links, {weight} and not {links:.3g} kg: check that "
        "the torques of the loaded log have the unit and the gains of the others.",
    )


def _another_robot(error: float, of_robot: float) -> tuple[str, ...]:
    """Say where no payload at all makes one robot of both logs, as where the torques of one have another unit."""
    if not error > _SUSPECT * of_robot:
        return ()
    return (
        f"More than a payload differs between the logs: with the loaded log the unloaded one is explained to "
        f"{error:.2%}, by itself to {of_robot:.2%}. The intervals do not hold; check that units, signs, gains and the "
        "order of the joints are the same in both logs, and that nothing else was changed on the robot.",
    )


def _known(model: Model, loaded: Estimate) -> KnownRobot:
    if loaded.base_expressions != model.base_parameters().expressions:
        raise InputError(
            f"The estimate has the parameters of another robot or of other terms than {model.robot.name} has; give the "
            "robot file that it was identified with."
        )
    loaded.require_geometry(model.robot, model.robot.name)
    known = np.isfinite(loaded.standard_error)
    # Standard errors are those of least squares, from which an answer with a prior is further away on purpose. What the
    # data does not tell belongs to the answer, and cannot be taken from both.
    base = loaded.base if loaded.unconstrained_base is None or not known.all() else loaded.unconstrained_base
    return KnownRobot(base, loaded.covariance)
