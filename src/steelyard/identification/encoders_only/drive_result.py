"""The result of an identification from commands and positions: the values of drives, and the files that hold them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import few_digits, html_table, text_table
from steelyard.errors import InputError
from steelyard.files import listed, replaced_folder, write_json
from steelyard.robot import Drives, Robot
from steelyard.robot.description import URDF, DescriptionFormat, description_format
from steelyard.simulation.driven_joints import COULOMB, DRIVE_PARAMETERS

from ..saved_result import DRIVES
from .drive_choice import DriveChoice
from .drive_settings import FRICTION_LAWS, DriveSettings

__all__ = ["WORDS", "DriveValue", "PositionIdentification", "described_alike", "descriptions_of_results"]

Array = NDArray[np.float64]

FORMAT = "steelyard drives 1"

WORDS = {
    "rotor_inertia": "rotor inertia",
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "coulomb_lower": "Coulomb friction, lower end",
    "coulomb_middle": "Coulomb friction, middle",
    "coulomb_upper": "Coulomb friction, upper end",
    "load_friction": "friction by load",
    "stiffness": "spring",
    "offset": "torque bias",
    "encoder": "encoder bias",
    "kp": "position gain",
    "kd": "velocity gain",
    "gain": "gain",
    "torque_loss": "loss of torque",
    "delay": "delay",
}


@dataclass(frozen=True)
class DriveValue:
    """One number of a drive.

    Attributes
    ----------
    joint : str
        Its joint; all of them where they share it (``"all"``), or a link.
    kind : str
        What it is, such as ``"rotor_inertia"``.
    value, lower, upper : float
        With a 95 % interval.
    unit : str
    word : str
        ``"measured"``, ``"weak"`` (an interval of more than a tenth either way), or ``"not seen"`` (one that reaches
        the bound of what is possible, so that nothing may be there).
    """

    joint: str
    kind: str
    value: float
    lower: float
    upper: float
    unit: str
    word: str


@dataclass(frozen=True, eq=False, repr=False)
class PositionIdentification:
    """The values of a robot's drives, identified from commands and positions; `identify_from_positions` returns it.

    Attributes
    ----------
    robot : Robot
    settings : DriveSettings
    values : tuple of DriveValue
    rotor_inertia, viscous, coulomb, load_friction, stiffness, offset, encoder, kp, kd, gain, torque_loss : ndarray
        (N,) of all joints, found or given. Coulomb friction that varies over the travel with its mean; friction by
        load is a part of the links' torque that is added to it; springs are at rest in the middle of the travel; the
        loss is that part of a drive's torque, of 1 N·m or N, by which it falls behind the law of the drive.
    coulomb_by_position : ndarray
        (3, N) at the lower end, in the middle and at the upper end of the travel, with lines between.
    travel : ndarray
        (2, N) ends of the travel in the logs of the fit, rad or m.
    choice : DriveChoice or None
        How further terms were chosen, where they were.
    delay : float
        s.
    parameters : ndarray
        (10 n,) of the links, feasible: those of the description but where links were freed.
    error : ndarray
        (N,) rms of measured less simulated positions in the logs of the fit, rad or m, each simulated from its commands
        alone.
    validation_error : ndarray or None
        (N,) in the logs that were held out.
    tracking_error : ndarray
        (N,) rms of commands less positions, for comparison; NaN where commands are no positions.
    remarks : tuple of str
    logs, validation_logs : tuple of str
    settled : bool
        Whether the search converged.
    """

    robot: Robot
    settings: DriveSettings
    values: tuple[DriveValue, ...]
    drives: Array
    encoder: Array
    travel: Array
    choice: DriveChoice | None
    parameters: Array
    error: Array
    validation_error: Array | None
    tracking_error: Array
    remarks: tuple[str, ...]
    logs: tuple[str, ...]
    validation_logs: tuple[str, ...]
    settled: bool
    robot_file: Path

    def __getattr__(self, name: str) -> Array:
        if name in DRIVE_PARAMETERS[:-1]:
            return np.asarray(self.drives[DRIVE_PARAMETERS.index(name)])
        raise AttributeError(name)

    @property
    def coulomb_by_position(self) -> Array:
        """Coulomb friction (3, N) at both ends and in the middle of the travel."""
        first = DRIVE_PARAMETERS.index(COULOMB[0])
        return np.asarray(self.drives[first : first + 3])

    @property
    def coulomb(self) -> Array:
        """Coulomb friction (N,), its mean over the travel."""
        lower, middle, upper = self.coulomb_by_position
        return np.asarray(0.25 * lower + 0.5 * middle + 0.25 * upper)

    @property
    def delay(self) -> float:
        """The delay that all joints share, s."""
        return float(self.drives[-1, 0])

    @property
    def headline(self) -> str:
        """The result in one sentence."""
        rms = 1e3 * np.sqrt(np.mean((self.error if self.validation_error is None else self.validation_error) ** 2))
        where = "in the logs of the fit" if self.validation_error is None else "in logs that were held out"
        kinds = sorted(set(self.robot.position_units), reverse=True)
        unit = " or ".join({"rad": "mrad", "m": "mm"}[kind] for kind in kinds)
        counts = [sum(value.word == word for value in self.values) for word in ("measured", "weak", "not seen")]
        return (
            f"Simulated from its commands alone, {self.robot.name} is within {rms:.3g} {unit} (rms) of what was "
            f"measured {where}. Of {len(self.values)} values {counts[0]} are measured, {counts[1]} weak, "
            f"{counts[2]} not seen."
        )

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return the heads and rows of the values."""
        rows: list[tuple[str, ...]] = [
            (
                value.joint,
                WORDS.get(value.kind, value.kind),
                few_digits(value.value),
                few_digits(value.lower),
                few_digits(value.upper),
                value.unit,
                value.word,
            )
            for value in self.values
        ]
        return ("joint", "what", "value", "from", "to", "unit", ""), rows

    def joint_table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return the heads and rows of the errors of each joint, mrad or mm."""
        errors = {"error": self.error, "held out": self.validation_error, "command less position": self.tracking_error}
        told = {head: column for head, column in errors.items() if column is not None and not np.isnan(column).all()}
        units = [{"rad": "mrad", "m": "mm"}[kind] for kind in self.robot.position_units]
        rows = [
            (name, *(few_digits(1e3 * float(column[k]), 3) for column in told.values()), units[k])
            for k, name in enumerate(self.robot.joint_names)
        ]
        return ("joint", *told, "unit"), rows

    def to_dict(self) -> dict[str, Any]:
        """Return plain data; entries of joints have the names of simulators (armature, damping, frictionloss)."""
        low, high = self.travel
        places_of = np.stack([low, 0.5 * (low + high), high], axis=1).tolist()
        levels_of = self.coulomb_by_position.T.tolist()
        alike_of = [len(set(levels)) == 1 for levels in levels_of]
        joints = {
            name: {
                "armature": self.rotor_inertia[k],
                "damping": self.viscous[k],
                "frictionloss": self.coulomb[k],
                "torque_bias": self.offset[k],
                **({} if alike else {"frictionloss_by_position": {"position": places, "frictionloss": levels}}),
                "load_friction": self.load_friction[k],
                "stiffness": self.stiffness[k],
                "springref": places[1],
                "encoder_bias": self.encoder[k],
                "kp": self.kp[k],
                "kd": self.kd[k],
                "gain": self.gain[k],
                **({"torque_loss": self.torque_loss[k]} if self.torque_loss[k] else {}),
                "delay": self.delay,
                "error": self.error[k],
                "validation_error": None if self.validation_error is None else self.validation_error[k],
            }
            for k, (name, places, levels, alike) in enumerate(
                zip(self.robot.joint_names, places_of, levels_of, alike_of, strict=True)
            )
        }
        law = FRICTION_LAWS[self.settings.friction]()
        return {
            "format": FORMAT,
            "robot": self.robot.name,
            "robot_file": str(self.robot_file),
            "joints": joints,
            "friction_law": {"name": self.settings.friction, "ahead": law.ahead, "slip": law.slip},
            "values": [vars(value) for value in self.values],
            "link_parameters": dict(zip(self.robot.parameter_names, self.parameters.tolist(), strict=True)),
            "settings": self.settings.to_dict(),
            "logs": self.logs,
            "validation_logs": self.validation_logs,
            "settled": self.settled,
            "remarks": self.remarks,
            "headline": self.headline,
        }

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write ``drives.json`` and the descriptions with what was found; the files appear together.

        Parameters
        ----------
        folder : str or Path
            Made where it is missing.

        Returns
        -------
        tuple of Path
            The files.
        """
        folder = Path(folder)
        sources = descriptions_of_results(self.robot, self.robot_file, self.settings)
        for source in sources:
            place = folder / source.name
            if place.exists() and place.samefile(source):
                raise InputError(f"{place}: is what was read, and the results would replace it; give another folder.")
        with replaced_folder(folder) as made:
            write_json(self.to_dict(), made / DRIVES)
            for source in sources:
                self.write_description(source, made / source.name)
            names = sorted(path.name for path in made.iterdir())
        return tuple(folder / name for name in names)

    def write_description(self, source: str | Path, target: str | Path) -> None:
        """Write a copy of a URDF, MJCF or SDF with armature, damping, friction loss and freed inertias.

        Raises
        ------
        InputError
            If the description is of another robot, or of a format that is only read.
        """
        source = Path(source)
        kind, robot = described_alike(self.robot, source)
        order = [self.robot.joint_names.index(name) for name in robot.joint_names]
        links = np.array(robot.parameters)
        if self.settings.free:
            own = np.reshape(self.parameters, (-1, 10))
            for name in self.settings.free:
                place, here = robot.link_names.index(name), self.robot.link_names.index(name)
                links.reshape(-1, 10)[place] = own[here]
        drives = Drives.unknown(robot.dof).with_known(
            damping=self.viscous[order],
            friction=self.coulomb[order],
            rotor_inertia=self.rotor_inertia[order],
            **self._springs(order),
        )
        kind.write(robot, links, drives, source, Path(target))

    def _springs(self, order: list[int]) -> dict[str, Array]:
        """Springs of joints in an order; none where none was looked for."""
        found = np.array(
            [any(v.kind == "stiffness" and v.joint == name for v in self.values) for name in self.robot.joint_names]
        )
        if not found.any():
            return {}
        at = np.where(found, self.travel.mean(axis=0), np.nan)
        return {"spring_stiffness": np.where(found, self.stiffness, np.nan)[order], "spring_rest": at[order]}

    def __repr__(self) -> str:
        heads, rows = self.joint_table()
        errors = text_table(heads, rows, numbers=tuple(range(1, len(heads) - 1)))
        parts = [self.headline, errors, text_table(*self.table())]
        return "\n\n".join([*parts, *self.remarks])

    def _repr_html_(self) -> str:
        heads, rows = self.table()
        return html_table(self.headline, heads, rows, self.remarks)


def descriptions_of_results(robot: Robot, robot_file: Path, settings: DriveSettings) -> list[Path]:
    """Return the descriptions that get the results, under their own names: the robot's first, where it has one."""
    sources = [] if robot.source is None else [Path(robot.source)]
    sources += [robot_file.parent / name for name in settings.also]
    names = [source.name for source in sources]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(
            f"[drive], key 'also': two descriptions are called {twice}, as their results would be; rename one."
        )
    return sources


def described_alike(own: Robot, source: Path) -> tuple[DescriptionFormat, Robot]:
    """Return the format of a description and the robot that it has, which must be the same as this one."""
    is_own = own.source is not None and source == Path(own.source)
    read, arguments = (own.read_with, own.xacro_arguments) if is_own else ({}, None)
    kind = description_format(source, arguments) or URDF
    robot = kind.read(source, read.get("tip"), read.get("locked") or (), (0, 0, -9.81))
    if sorted(robot.joint_names) != sorted(own.joint_names) or len(robot.links) != len(own.links):
        raise InputError(
            f"{source}: does not describe this robot, whose joints are {listed(own.joint_names)}; it has "
            f"{listed(robot.joint_names)}."
        )
    return kind, robot
