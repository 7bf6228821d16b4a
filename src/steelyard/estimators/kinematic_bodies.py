"""Bodies that span the joints of a robot: what is known of its links where nothing but the kinematics is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard import collision  # its shapes are loaded when bodies are asked for
from steelyard.robot import Robot
from steelyard.robot.placement import axis_frame, inverse

__all__ = ["kinematic_bodies", "lengths_beyond", "reach_of"]

Array = NDArray[np.float64]

SLENDERNESS = 0.06
"""Radius of a body relative to the reach of the robot and what reaches beyond its joint, added.

On 17 arms with known masses, bodies of one density a robot have 0.63 to 1.5 times (half of the links) and 0.21 to
9.8 times (all) the mass of the link; the standard deviation of the logarithm is 0.72. With 0.04 it is 0.77, with 0.1
it is 0.73."""

FREE_END = 0.3
"""Radius of a last link, or one that slides, whose length nothing tells, relative to the mean length of the links up to
it."""

LEAST_RADIUS, LEAST_END = 0.02, 0.03
"""m, of a link, and of a last one, which holds a hand or a camera. Links of small robots are as thick as their motors
(of the smallest servos for joints 20 by 34 by 26 mm, 18 g), and not as their reach asks for. Without these a body of
10 g was assumed for a pan-tilt head of 0.6 kg whose axes are 6 cm apart, and the torques of a sound log looked as if in
mN·m."""

SHORTEST_REACH = 0.01
"""m; a robot all of whose joints meet in one point has no known size."""

ASSUMED_REACH = 0.3
"""m, of a robot without a known size."""

MANY_POINTS = 1000
"""Points of a link from which on not all pairs are compared, which takes 24 bytes each: 24 MB for a thousand points."""


def lengths_beyond(robot: Robot) -> Array:
    """Length in m of the longest chain, stretched, from each joint on, (joints,).

    Strokes of prismatic joints with limits count, but for that of a rail on which all else moves: it lies still, and
    arms on longer rails are not thicker. Ten metres of it made an arm of 0.8 m weigh 3.5 tons.

    Examples
    --------
    >>> lengths_beyond(Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")])).round(12).tolist()
    [0.9, 0.4]
    """
    found = np.zeros(len(robot.joints))
    for index in reversed(range(len(robot.joints))):
        joint = robot.joints[index]
        found[index] += float(np.linalg.norm(joint.after[:3, 3]))
        is_rail = joint.parent < 0 and found[index] >= SHORTEST_REACH
        if not joint.rotates and np.isfinite(joint.upper - joint.lower) and not is_rail:
            found[index] += joint.upper - joint.lower
        if joint.parent >= 0:
            through = found[index] + float(np.linalg.norm(joint.before[:3, 3]))
            found[joint.parent] = max(found[joint.parent], through)
    return found


def reach_of(robot: Robot) -> float:
    """Length in m of the longest chain of joints, stretched, from the first joint on."""
    return float(lengths_beyond(robot).max(initial=0.0))


def kinematic_bodies(robot: Robot) -> tuple[collision.PlacedShape, ...]:
    """A body for each link that spans its joints: a capsule from its own joint to the farthest of the next ones.

    Where two neighbouring joints stand apart along the axis of the second, the description does not tell which of the
    two links fills that length, and each takes half.

    Returns
    -------
    tuple of PlacedShape
        One a link, in the frame of the link.

    Examples
    --------
    >>> kinematic_bodies(Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")]))[0]
    PlacedShape(Capsule(radius=0.108, length=0.5) on 'link1')
    """
    beyond = lengths_beyond(robot)
    reach = float(beyond.max(initial=0.0))
    known = reach >= SHORTEST_REACH
    reach = reach if known else ASSUMED_REACH
    found = []
    for index, points in enumerate(_points(robot)):
        one, other = _ends(points)
        difference = points[one] - points[other]
        length = float(np.linalg.norm(difference))
        radius = SLENDERNESS * (reach + beyond[index])
        last = index in robot.end_links
        own = robot.joints[index]
        # In a robot without any length, an axis that slides is as unknown as a last link: the sphere about a joint is
        # that of a wrist, and made the bridge of a gantry weigh seven grams.
        slides = not known and not own.rotates
        if length < SHORTEST_REACH and (last or slides):
            radius = FREE_END * _mean_length(robot, index, reach)
        if known:
            radius = max(radius, LEAST_END if last else LEAST_RADIUS)
        placement = np.eye(4)
        shape: collision.Shape = collision.Sphere(radius)
        if length > 1e-6 * reach:
            placement = axis_frame(difference)
            shape = collision.Capsule(radius, length)
        placement[:3, 3] = (points[one] + points[other]) / 2.0
        found.append(collision.PlacedShape(shape, robot.links[index].name, index, placement))
    return tuple(found)


def _ends(points: Array) -> tuple[int, int]:
    """Return the two of some points that are farthest apart, (K, 3); of many, two that are nearly so."""
    if len(points) <= MANY_POINTS:
        distances = np.linalg.norm(points[:, None] - points[None], axis=2)
        found = np.unravel_index(np.argmax(distances), distances.shape)
        return int(found[0]), int(found[1])
    one = other = 0
    for _ in range(3):  # from a point to the farthest one, and on from there
        one, other = other, int(np.argmax(np.linalg.norm(points - points[other], axis=1)))
    return one, other


def _mean_length(robot: Robot, index: int, reach: float) -> float:
    """Mean length in m of the links from the base to a link, which itself does not count unless it is the only one."""
    count, parent = 0, robot.joints[index].parent
    while parent >= 0:
        count, parent = count + 1, robot.joints[parent].parent
    return reach / max(count, 1)


def _points(robot: Robot) -> list[Array]:
    """Points of every link: where it meets its joints, and the frames that are fixed to it."""
    found: list[list[Array]] = [[] for _ in robot.joints]
    for index, joint in enumerate(robot.joints):
        back = inverse(joint.after)
        found[index] += [np.zeros(3), back[:3, 3]]
        found[index] += [one.placement[:3, 3] for one in robot.links[index].attachments]
        for point, along in _places(robot, index):
            if joint.parent >= 0:
                found[joint.parent].append(point)
            # The link's own frame has moved with the joint; seen from it, the shared length lies along the joint's z.
            found[index].append(back[:3, 3] - along * back[:3, 2])
    return [np.array(points) for points in found]


def _places(robot: Robot, index: int) -> list[tuple[Array, float]]:
    """Points in the link before a joint to which that reaches, and how far along the axis before the joint they lie."""
    joint = robot.joints[index]
    origin, axis = joint.before[:3, 3], joint.before[:3, 2]
    if not joint.rotates:
        ends = [end for end in (joint.lower, joint.upper) if np.isfinite(end)]
        return [(origin + end * axis, 0.0) for end in ends or [0.0]]
    if joint.parent < 0:
        return [(origin, 0.0)]
    before = inverse(robot.joints[joint.parent].after)[:3, 3]
    along = 0.5 * float((origin - before) @ axis)
    return [(origin - along * axis, along)]
