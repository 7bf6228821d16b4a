"""Placements of a description in rational numbers: rotations that are orthogonal exactly, close to those given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.robot import Joint, Robot
from steelyard.robot.placement import inverse, rpy_rotation

__all__ = [
    "DUST",
    "ExactMatrix",
    "Number",
    "exact_placement",
    "placed_back",
    "quotient",
    "robot_with_right_angles",
    "times",
    "transposed",
    "with_right_angles",
]

Number = int | Fraction
"""Whole numbers stand as they are: most are 0 or 1, and Python's fractions take ten times as long."""

ExactMatrix = tuple[tuple[Number, ...], ...]
Rows = Sequence[Sequence[Any]]
Matrix = NDArray[np.float64]

DUST = 1e-12
"""Elements of rotations (and lengths in m) below this are what products of rounded numbers leave of a zero."""

ROUNDED_DIGITS = (4, 5, 6)
"""Digits behind the point of a multiple of π/2 that stands for it: 1.5708 and 3.14159 do; 1.57 is an angle of its own.
With more digits it is within `SINGLE_PRECISION`."""

SINGLE_PRECISION = 2e-7
"""Angles this close to a multiple of π/2 stand for it: descriptions that were computed in single precision have axes
such as (0, 1, -4.37114e-08), and nobody builds to this. A thousandth of a degree, 1.7e-5 rad, is far above it."""

RECOGNIZED = 1e-11
"""How closely an angle is read back from a rotation, also where two axes of roll, pitch and yaw nearly coincide."""


def exact_placement(placement: Matrix) -> ExactMatrix:
    """Return a placement (4, 4) in rational numbers: what a float prints, with a rotation that is orthogonal exactly.

    The rotation comes from a quaternion, whose elements need not have the length 1 to give a rational rotation. Its
    elements differ from those given by rounding, 1e-16; zeros and ones stay.
    """
    turn = placement[:3, :3]
    rows: list[tuple[Number, ...]] = []
    for row, length in zip(_exact_rotation(turn), placement[:3, 3].tolist(), strict=True):
        rows.append((*row, Fraction(repr(length)) if abs(length) > DUST else 0))
    return (*rows, (0, 0, 0, 1))


def quotient(value: Number, divisor: Number) -> Number:
    """Return the exact quotient, as a whole number where it is one.

    Examples
    --------
    >>> quotient(6, -3), quotient(1, 4)
    (-2, Fraction(1, 4))
    """
    if divisor == 1:
        return value
    found = Fraction(value) / divisor
    return found.numerator if found.denominator == 1 else found


def times(a: Rows, b: Rows) -> list[list[Any]]:
    """Return the product of two matrices (4, 4) of exact or long numbers, most of which are 0."""
    found: list[list[Any]] = [[0] * 4 for _ in range(4)]
    for i, row in enumerate(a):
        for k, value in enumerate(row):
            if value:
                for j, other in enumerate(b[k]):
                    if other:
                        found[i][j] += value * other
    return found


def transposed(a: Rows) -> list[list[Any]]:
    """Return the transpose of such a matrix."""
    return [list(column) for column in zip(*a, strict=True)]


def placed_back(placement: Rows) -> list[list[Any]]:
    """Return the inverse of a placement in such numbers."""
    turn = [[placement[j][i] for j in range(3)] for i in range(3)]
    shift = [-sum((turn[i][j] * placement[j][3] for j in range(3)), 0) for i in range(3)]
    return [[*row, value] for row, value in zip(turn, shift, strict=True)] + [[0, 0, 0, 1]]


def _exact_rotation(turn: Matrix) -> list[tuple[Number, ...]]:
    # Four times the products of the elements of the quaternion w, x, y, z; the largest column is the most accurate.
    a, b, c = turn.tolist()
    products = [
        [1 + a[0] + b[1] + c[2], c[1] - b[2], a[2] - c[0], b[0] - a[1]],
        [c[1] - b[2], 1 + a[0] - b[1] - c[2], a[1] + b[0], a[2] + c[0]],
        [a[2] - c[0], a[1] + b[0], 1 - a[0] + b[1] - c[2], b[2] + c[1]],
        [b[0] - a[1], a[2] + c[0], b[2] + c[1], 1 - a[0] - b[1] + c[2]],
    ]
    largest = max(range(4), key=lambda k: products[k][k])
    w, x, y, z = (_clean(value / products[largest][largest]) for value in products[largest])
    length = w * w + x * x + y * y + z * z
    return [
        tuple(quotient(value, length) for value in row)
        for row in (
            (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
        )
    ]


def _clean(value: float) -> Number:
    nearest = round(value)
    return nearest if abs(value - nearest) < DUST else Fraction(value)


@cache
def _residues() -> tuple[float, ...]:
    """Return by how much multiples of π/2 up to 2π change when they are rounded or cut off."""
    found = []
    for angle in (multiple * math.pi / 2 for multiple in range(1, 5)):
        for digits in ROUNDED_DIGITS:
            found += [round(angle, digits) - angle, math.floor(angle * 10**digits) / 10**digits - angle]
    return tuple(abs(value) for value in found)


def robot_with_right_angles(robot: Robot) -> Robot:
    """Return the robot with rounded right angles made exact, see `with_right_angles`; itself where there are none."""
    joints: list[Joint] = []
    for joint in robot.joints:
        before, after = with_right_angles(joint.before), with_right_angles(joint.after)
        if joint.parent >= 0:
            # Fixed joints may have been merged into either placement, so that only both together are a right angle.
            first = joints[joint.parent].after
            between = first @ before
            meant = with_right_angles(between)
            before = before if meant is between else inverse(first) @ meant
        written = before is joint.before and after is joint.after
        joints.append(joint if written else replace(joint, before=before, after=after))
    return robot if tuple(joints) == robot.joints else replace(robot, joints=tuple(joints))


def with_right_angles(placement: Matrix) -> Matrix:
    """Return the placement (4, 4) that is meant where roll, pitch or yaw is a rounded multiple of π/2, such as 1.5708.

    Other angles stay as they are: 1e-5 rad is 1e-5 rad.

    Examples
    --------
    >>> from steelyard.robot.placement import rotation_x
    >>> with_right_angles(rotation_x(1.5708))[2].tolist()
    [0.0, 1.0, 0.0, 0.0]
    >>> with_right_angles(rotation_x(1e-5))[2, 1].item()
    9.999999999833334e-06
    """
    turn = placement[:3, :3]
    pitch = math.atan2(-turn[2, 0], math.hypot(turn[2, 1], turn[2, 2]))
    if math.hypot(turn[2, 1], turn[2, 2]) > 1e-9:
        roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    else:
        roll, yaw = 0.0, math.atan2(-turn[0, 1], turn[1, 1])
    angles = [roll, pitch, yaw]
    meant = [_meant(angle) for angle in angles]
    if meant == angles:
        return placement
    found = rpy_rotation(*meant)
    found[:3, 3] = placement[:3, 3]
    return found


def _meant(angle: float) -> float:
    right = round(angle / (math.pi / 2)) * math.pi / 2
    rest = abs(angle - right)
    if rest < DUST:
        return angle
    stands_for_it = rest < SINGLE_PRECISION or any(abs(rest - residue) < RECOGNIZED for residue in _residues())
    return right if stands_for_it else angle
