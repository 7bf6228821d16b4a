"""SDF, the format of Gazebo, as a format of descriptions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .description import DescriptionFormat, Locked
from .joint import Drives
from .robot import Robot
from .sdf_document import SdfReader

__all__ = ["SDF", "SdfFormat"]


class SdfFormat(DescriptionFormat):
    """SDF."""

    tells_gravity = True

    def read(self, path: Path, tip: str | None, locked: Locked, gravity: ArrayLike | None) -> Robot:
        """See `Robot.from_sdf`."""
        return Robot.from_sdf(path, tip, locked, gravity)

    def refusal(self, robot: Robot) -> str:
        """Say which links stand in other files."""
        if robot.source is None:
            return ""
        reader = SdfReader(robot.source)
        reader.tree()
        here = {name for link in robot.links for name in (link.name, *link.absorbed)} & reader.included
        if not here:
            return ""
        return (
            f"{robot.source} includes {min(here)} from another file, so that it is not written with the identified "
            "parameters: identify the robot from that file."
        )

    def write(self, robot: Robot, parameters: NDArray[np.float64], drives: Drives, source: Path, target: Path) -> None:
        """See `write_sdf`."""
        from .sdf_writer import write_sdf  # what writes is loaded when something is written

        write_sdf(robot, parameters, drives, source, target)


SDF = SdfFormat()
