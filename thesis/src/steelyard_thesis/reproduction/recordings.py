"""The real recordings: each as a model and two parts, one to identify from and one held out."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Coulomb, Model, MotorSide, Offset, RotorInertia, Viscous
from steelyard.recording import LogColumns, Processing, Recording, Samples
from steelyard.regression import Information
from steelyard.robot import Robot

__all__ = ["RealRobot", "kinova_gen3", "parted", "staubli_tx40", "ur10"]


@dataclass(frozen=True, eq=False)
class RealRobot:
    """A robot and what was recorded of it.

    Attributes
    ----------
    name : str
    model : Model
    training : Information
        To identify from.
    held_out : Information or None
        To try the estimates on.
    split : str
        What is held out, in words.
    weights : "joint" or None
    prior : (n,) or None
        Standard parameters from CAD.
    """

    name: str
    model: Model
    training: Information
    held_out: Information | None
    split: str
    weights: Literal["joint"] | None = "joint"
    prior: NDArray[np.float64] | None = None


def staubli_tx40(data: Path) -> tuple[Model, Samples]:
    """Return the arm with its coupled wrist, and its motor-side recording on the joint side.

    Positions are filtered and decimated, and slow rows left out, as its publishers say.
    """
    folder = data / "staubli_tx40"
    ratios = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
    to_motor, to_torque, coupling = ratios.copy(), ratios.copy(), np.eye(6)
    to_motor[5, 4] = to_torque[4, 5] = 32.0
    coupling[4, 5] = 1.0  # motor 6 turns with joint 5 as well; ratios are taken out of the recording
    robot = Robot.from_urdf(folder / "tx40_mdh_modified.urdf")
    model = Model(robot.with_terms(Viscous(), Coulomb(), Offset(), MotorSide(coupling=coupling)))
    columns = LogColumns.from_dict(
        {
            "rate": 5000.0,
            "position": "qm{}",
            "torque": "taum{}",
            "position_matrix": np.linalg.inv(to_motor).tolist(),
            "position_offset": [0, "-pi/2", "pi/2", 0, 0, 0],
            "torque_matrix": to_torque.tolist(),
        }
    )
    files = [folder / "raw_q_motor_5khz.csv", folder / "raw_tau_motor_5khz.csv"]
    slowest = (0.05009095, 0.05009095, 0.07504916, 0.0715585, 0.05585054, 0.12217305)
    processing = Processing(cutoff=100.0, order=4, decimate=(10, 10), trim=0.0, velocity_threshold=slowest)
    return model, Recording.read(files, columns, joints=6).process(processing)


def ur10(data: Path) -> tuple[Model, Samples]:
    """Return the arm, and its recording, filtered at ten times the frequency of the motion."""
    folder = data / "ur10_unisa"
    model = Model(_with_drives(Robot.from_dh(_ur10_rows(folder / "dh.json"), name="ur10")))
    # Ten times the frequency of the motion, as the thesis has it.
    processing = Processing(cutoff=3.66, trim=0.0, velocity_threshold=None)
    return model, Recording.read(folder / "exciting.csv", joints=6).process(processing)


def kinova_gen3(data: Path) -> tuple[Model, Samples, Samples]:
    """Return the arm, with inertias from CAD, and two of its recordings."""
    folder = data / "kinova_gen3"
    model = Model(_with_drives(Robot.from_urdf(folder / "gen3.urdf")))
    processing = Processing(cutoff=3.0, torque_cutoff=3.0, order=3, trim=0.0, velocity_threshold=None)
    logs = (Recording.read(folder / f"opti_traj_testing{k}.csv", joints=7) for k in (1, 2))
    one, two = (log.process(processing) for log in logs)
    return model, one, two


def parted(samples: Samples) -> tuple[Samples, Samples]:
    """Return the first two thirds of the samples, and the last third."""
    border = 2 * samples.count // 3
    return _rows(samples, slice(0, border)), _rows(samples, slice(border, samples.count))


def _rows(samples: Samples, rows: slice) -> Samples:
    mask = None if samples.mask is None else samples.mask[rows]
    return Samples(
        q=samples.q[rows], dq=samples.dq[rows], ddq=samples.ddq[rows], torque=samples.torque[rows], mask=mask
    )


def _with_drives(robot: Robot) -> Robot:
    return robot.with_terms(Viscous(), Coulomb(), Offset(), RotorInertia())


def _ur10_rows(path: Path) -> list[Any]:
    content = json.loads(path.read_text(encoding="utf-8"))
    return [[*row[:3], "q"] for row in content["rows"]]  # every joint turns; the file counts its q
