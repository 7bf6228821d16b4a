"""MJCF, the format of MuJoCo, as a format of descriptions."""

from __future__ import annotations

from pathlib import Path

from numpy.typing import ArrayLike

from .description import DescriptionFormat, Locked
from .robot import Robot

__all__ = ["MJCF", "MjcfFormat"]


class MjcfFormat(DescriptionFormat):
    """MJCF."""

    tells_gravity = True

    def read(self, path: Path, tip: str | None, locked: Locked, gravity: ArrayLike | None) -> Robot:
        """See `Robot.from_mjcf`."""
        return Robot.from_mjcf(path, tip, locked, gravity)


MJCF = MjcfFormat()
