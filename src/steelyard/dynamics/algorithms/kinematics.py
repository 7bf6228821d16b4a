"""Positions and motions of a tree of joints, written over generic scalars.

A scalar is a float, a NumPy array (a batch of samples), a graph node, or anything else with ``+ - *``; `algebra` is
the module that brings ``sin`` and ``cos`` for it (``numpy``, ``steelyard.graph``, ``sympy``, ``jax.numpy``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import listed
from steelyard.robot import Joint, Robot

__all__ = ["JointFrame", "Matrix3", "Vector3", "add", "cross", "dot", "joint_frames", "link_poses", "scale", "times"]

Vector3 = tuple[Any, Any, Any]
Matrix3 = tuple[Vector3, Vector3, Vector3]
ZERO: Vector3 = (0.0, 0.0, 0.0)
IDENTITY: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def dot(a: Vector3, b: Vector3) -> Any:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector3, b: Vector3) -> Vector3:
    """Return the vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def add(a: Vector3, b: Vector3) -> Vector3:
    """Return the sum."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vector3, b: Vector3) -> Vector3:
    """Return the difference."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vector3, factor: Any) -> Vector3:
    """Return `a` times a scalar."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def times(matrix: Matrix3, v: Vector3) -> Vector3:
    """Return the product of a matrix and a vector."""
    return (dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v))


def transposed(matrix: Matrix3) -> Matrix3:
    """Return the transpose."""
    a, b, c = matrix
    return ((a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2]))


def matrix_add(a: Matrix3, b: Matrix3) -> Matrix3:
    """Return the sum of two matrices."""
    return (add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2]))


def product(a: Matrix3, b: Matrix3) -> Matrix3:
    """Return the product of two matrices."""
    columns = transposed(b)
    return tuple(tuple(dot(row, column) for column in columns) for row in a)  # type: ignore[return-value]


def unit_vector(a: Vector3) -> tuple[int, float] | None:
    """Return index and sign of the only element where `a` is plus or minus a coordinate axis, otherwise None."""
    places = [i for i in range(3) if a[i] != 0.0]
    if len(places) != 1 or abs(a[places[0]]) != 1.0:
        return None
    return places[0], float(a[places[0]])


def _vector(values: NDArray[np.float64]) -> Vector3:
    return (float(values[0]), float(values[1]), float(values[2]))


def _matrix(values: NDArray[np.float64]) -> Matrix3:
    return (_vector(values[0]), _vector(values[1]), _vector(values[2]))


def _is_signed_permutation(matrix: NDArray[np.float64]) -> bool:
    return bool(np.all((matrix == 0.0) | (np.abs(matrix) == 1.0)))


@dataclass(frozen=True)
class JointFrame:
    """One joint at one position, which takes vectors from either of its two links to the other.

    The joint's point is fixed in the parent's link frame at `base_point`, and the origin of the moved link frame
    stands at `arm` from it, in the moved frame. All the frames are link frames.

    Attributes
    ----------
    factors : tuple of Matrix3
        Rotation from the link frame to the parent's, as a product of one or three matrices.
    arm : Vector3
        Constant for a rotation; holds the joint position for a translation.
    axis, parent_axis : Vector3
        Joint axis in the moved link frame and in the parent's, constant.
    """

    joint: Joint
    factors: tuple[Matrix3, ...]
    base_point: Vector3
    arm: Vector3
    axis: Vector3
    parent_axis: Vector3

    @property
    def rotates(self) -> bool:
        """Whether the joint turns (it slides otherwise)."""
        return self.joint.kind != "prismatic"

    def own(self, rates: Sequence[Any]) -> Any:
        """Return the joint's own velocity or acceleration from those of the coordinates; mimic joints have a factor."""
        k, value = self.joint.multiplier, rates[self.joint.coordinate]
        return value if k == 1.0 else k * value

    def to_parent(self, v: Vector3) -> Vector3:
        """Turn a vector from the moved link frame into the parent's."""
        for factor in reversed(self.factors):
            v = times(factor, v)
        return v

    def to_link(self, v: Vector3) -> Vector3:
        """Turn a vector from the parent's link frame into the moved one."""
        for factor in self.factors:
            v = times(transposed(factor), v)
        return v

    @property
    def unit_motion(self) -> tuple[Vector3, Vector3]:
        """Angular velocity and velocity of the link's origin per joint velocity, in the link frame."""
        return (self.axis, cross(self.axis, self.arm)) if self.rotates else (ZERO, self.axis)


def joint_frames(
    robot: Robot, q: Sequence[Any], algebra: Any, lengths: Mapping[str, Any] | None = None
) -> list[JointFrame]:
    """Place all the joints.

    Parameters
    ----------
    q : sequence of scalar
        N joint positions, rad or m.
    algebra : module
        Brings ``sin`` and ``cos``.
    lengths : mapping, optional
        A scalar for each symbolic length of the robot, m.

    Returns
    -------
    list of JointFrame
        One for each joint of the robot.
    """
    missing = [name for name in robot.lengths if lengths is None or name not in lengths]
    if missing:
        raise InputError(
            f"{robot.name} has lengths without a value: {listed(missing)}; give them with robot.with_lengths, or as "
            "lengths in [description] of robot.toml."
        )
    return [_joint_frame(joint, q, algebra, lengths or {}) for joint in robot.joints]


def coordinate_count(frames: Sequence[JointFrame]) -> int:
    """Return the number N of joint coordinates."""
    return 1 + max(frame.joint.coordinate for frame in frames)


def _shift(placement: NDArray[np.float64], symbols: Mapping[str, Vector3], lengths: Mapping[str, Any]) -> Vector3:
    """Return the translation of a placement, symbolic lengths included."""
    result = _vector(placement[:3, 3])
    for name, direction in symbols.items():
        result = add(result, scale(direction, lengths[name]))
    return result


def _joint_frame(joint: Joint, q: Sequence[Any], algebra: Any, lengths: Mapping[str, Any]) -> JointFrame:
    before, after = np.asarray(joint.before), np.asarray(joint.after)
    turn_before, turn_after = before[:3, :3], after[:3, :3]
    coordinate = q[joint.coordinate]
    value = coordinate if joint.multiplier == 1.0 else joint.multiplier * coordinate
    base_point = _shift(before, joint.before_lengths, lengths)
    axis = _vector(turn_after.T @ np.array([0.0, 0.0, 1.0]) + 0.0)
    parent_axis = _vector(turn_before[:, 2] + 0.0)
    to_link = _matrix(turn_after.T)
    arm = times(to_link, _shift(after, joint.after_lengths, lengths))
    if joint.kind == "prismatic":
        turn = turn_before @ turn_after
        # The point slides with the link: its place in the parent, seen from the link, goes into the arm.
        start = add(add(times(_matrix(turn.T), base_point), arm), scale(axis, joint.offset))
        return JointFrame(joint, (_matrix(turn),), ZERO, add(start, scale(axis, value)), axis, parent_axis)
    if joint.offset:
        turn_before = turn_before @ _turn_about_z(joint.offset)
    s, c = algebra.sin(value), algebra.cos(value)
    turn_z: Matrix3 = ((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))
    first, last = _matrix(turn_before), _matrix(turn_after)
    if _is_signed_permutation(turn_before) and _is_signed_permutation(turn_after):
        factors: tuple[Matrix3, ...] = (first, turn_z, last)
    else:
        factors = (product(product(first, turn_z), last),)
    return JointFrame(joint, factors, base_point, arm, axis, parent_axis)


def _turn_about_z(angle: float) -> NDArray[np.float64]:
    s, c = (0.0 if abs(x) < 1e-15 else float(x) for x in (np.sin(angle), np.cos(angle)))
    s, c = (float(np.sign(x)) if abs(abs(x) - 1.0) < 1e-15 else x for x in (s, c))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def link_poses(frames: Sequence[JointFrame]) -> list[tuple[Matrix3, Vector3]]:
    """Return rotation and position (m) of every link frame in the base frame."""
    poses: list[tuple[Matrix3, Vector3]] = []
    for frame in frames:
        turn, place = poses[frame.joint.parent] if frame.joint.parent >= 0 else (IDENTITY, ZERO)
        own = frame.factors[0]
        for factor in frame.factors[1:]:
            own = product(own, factor)
        point = add(frame.base_point, times(own, frame.arm))
        poses.append((product(turn, own), add(place, times(turn, point))))
    return poses
