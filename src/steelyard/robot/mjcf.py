"""MJCF, the format of MuJoCo, as a format of descriptions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .description import DescriptionFormat, Locked
from .joint import Drives
from .robot import Robot

__all__ = ["MJCF", "MjcfFormat"]


class MjcfFormat(DescriptionFormat):
    """MJCF."""

    tells_gravity = True
    holds = ("damping", "friction", "rotor_inertia", "stiffness", "quadratic_damping", "cubic_damping")

    def read(self, path: Path, tip: str | None, locked: Locked, gravity: ArrayLike | None) -> Robot:
        """See `Robot.from_mjcf`."""
        return Robot.from_mjcf(path, tip, locked, gravity)

    def write(self, robot: Robot, parameters: NDArray[np.float64], drives: Drives, source: Path, target: Path) -> None:
        """See `write_mjcf`."""
        from .mjcf_writer import write_mjcf  # what writes is loaded when something is written

        write_mjcf(robot, parameters, drives, source, target)


MJCF = MjcfFormat()
