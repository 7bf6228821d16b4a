"""Where the joints of a robot are, as plain data: it tells whether the frames of the links are those of another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .robot import Robot

__all__ = ["differing_joint", "joint_geometry"]

# Angles and lengths (rad, m) by which placements may differ: more than the rounding of "1.5708" in a description, and
# much less than an identified inertia can tell.
SAME_PLACEMENT = 1e-4


def joint_geometry(robot: Robot) -> list[dict[str, Any]]:
    """Return of every joint, mimic joints among them, what the frame of its link rests on, as plain data.

    Where the base stands is left out: nothing of an inertia in the frame of a moving link depends on it.

    Parameters
    ----------
    robot : Robot

    Examples
    --------
    >>> joint_geometry(Robot.from_dh([(0, 0.5, 0, "q")], name="pendulum"))[0]["after"]
    [1.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    """
    return [
        {
            "name": joint.name,
            "turns": joint.rotates,
            "parent": joint.parent,
            "before": joint.before[:3].ravel().tolist() if joint.parent >= 0 else [],
            "after": joint.after[:3].ravel().tolist(),
            "motion": [float(joint.coordinate), joint.multiplier, joint.offset],
        }
        for joint in robot.joints
    ]


def differing_joint(recorded: Sequence[Any], robot: Robot) -> str:
    """Return the name of the first joint that is placed or moves otherwise than was recorded; empty where none does.

    Parameters
    ----------
    recorded : sequence of mapping
        What `joint_geometry` returned for a robot with the same joints.
    robot : Robot

    Raises
    ------
    TypeError, ValueError, KeyError
        If it is something else.
    """
    for one, own in zip(recorded, joint_geometry(robot), strict=True):
        same = all(one[key] == own[key] for key in ("name", "turns", "parent"))
        if not same or not all(
            len(one[key]) == len(own[key]) and np.allclose(one[key], own[key], rtol=0.0, atol=SAME_PLACEMENT)
            for key in ("before", "after", "motion")
        ):
            return str(own["name"])
    return ""
