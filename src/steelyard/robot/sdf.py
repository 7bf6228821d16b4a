"""SDF, the format of Gazebo, as a format of descriptions."""

from __future__ import annotations

from pathlib import Path

from numpy.typing import ArrayLike

from .description import DescriptionFormat, Locked
from .robot import Robot

__all__ = ["SDF", "SdfFormat"]


class SdfFormat(DescriptionFormat):
    """SDF."""

    tells_gravity = True

    def read(self, path: Path, tip: str | None, locked: Locked, gravity: ArrayLike | None) -> Robot:
        """See `Robot.from_sdf`."""
        return Robot.from_sdf(path, tip, locked, gravity)


SDF = SdfFormat()
