"""Regressors of torque and energy: from the joint axes, and evaluated by NumPy where compiling would not pay.

Each joint's unit motion is carried into the frames of the links beyond it, and multiplied by the wrench of the link,
which is linear in its ten parameters. For the joints below a link that turns, three of its ten columns follow from
those of its parent, because mass on the joint axis might as well belong to the parent (see :mod:`.regrouping`). These
columns are read from those of the parent where that takes fewer operations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.graph.expression import is_zero

from ..layout import Entries, ParameterLayout
from .kinematics import ZERO, JointFrame, Vector3, add, cross, dot, joint_frames, scale, times, transposed
from .newton_euler import Motion, link_motions, robot_gravity
from .regrouping import JointLine, joint_line

__all__ = [
    "kinetic_energy_regressor",
    "momentum_balance",
    "momentum_balance_with_numpy",
    "potential_energy_regressor",
    "regressor",
    "regressor_with_numpy",
    "term_torques",
]

_DIAGONAL = (0, 3, 5)
_PRODUCT = {(0, 1): 1, (0, 2): 2, (1, 2): 4}


def _row(motion: Motion, angular: Vector3, linear: Vector3) -> list[Any]:
    """Power of the wrench of a moving body on a unit motion, by its ten parameters."""
    w, dw, u, a = motion.angular_velocity, motion.angular_acceleration, motion.u, motion.acceleration
    x, y, z = angular
    xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    first = add(times(transposed(u), linear), cross(a, angular))
    return [
        x * dw[0] + (y * xz - z * xy),
        y * u[2][1] - x * u[2][0] + z * (u[0][0] - u[1][1]),
        x * u[1][0] + y * (u[2][2] - u[0][0]) - z * u[1][2],
        y * dw[1] + (z * xy - x * yz),
        x * (u[1][1] - u[2][2]) - y * u[0][1] + z * u[0][2],
        z * dw[2] + (x * yz - y * xz),
        *first,
        dot(linear, a),
    ]


def _nonzero(v: Vector3) -> list[int]:
    return [i for i in range(3) if not is_zero(v[i])]


def _second_moment(row: Sequence[Any], i: int, j: int, factor: Any) -> Any:
    """Torque of the second moment of mass ``factor`` at (i, j) and (j, i): ``L = tr(S) 1 - S``."""
    if i == j:
        others = [k for k in range(3) if k != i]
        return factor * (row[_DIAGONAL[others[0]]] + row[_DIAGONAL[others[1]]])
    return -(factor * row[_PRODUCT[min(i, j), max(i, j)]])


def _read_from_parent(row: list[Any], parent: Sequence[Any], line: JointLine) -> None:
    """Replace the columns of the link that the parent's columns and the link's others determine."""
    k, sign = line.axis
    parent_k, parent_sign = line.parent_axis
    # Mass spread along the axis: its second moment belongs to either link.
    i, j = (k + 1) % 3, (k + 2) % 3
    pi, pj = (parent_k + 1) % 3, (parent_k + 2) % 3
    row[_DIAGONAL[j]] = (parent[_DIAGONAL[pi]] + parent[_DIAGONAL[pj]]) - row[_DIAGONAL[i]]
    here, there = _nonzero(line.point), _nonzero(line.parent_point)
    if len(here) + len(there) <= 3:
        # A first moment along the axis, which passes at the two points.
        value = parent[6 + parent_k] * parent_sign
        for n in there:
            factor = line.parent_point[n] * parent_sign
            value = value + _second_moment(parent, n, parent_k, 2.0 * factor if n == parent_k else factor)
        for n in here:
            value = value - _second_moment(row, n, k, line.point[n] * sign)
        row[6 + k] = sign * value
    if not here and not there:
        row[9] = parent[9]  # a mass on the axis, at the origins


def _carried(frame: JointFrame, twists: dict[int, tuple[Vector3, Vector3]]) -> dict[int, tuple[Vector3, Vector3]]:
    """Return motions of the parent link as they are in the frame of the link."""
    here: dict[int, tuple[Vector3, Vector3]] = {}
    for source, (angular, linear) in twists.items():
        angular, linear = frame.to_link(angular), frame.to_link(add(linear, cross(angular, frame.base_point)))
        here[source] = (angular, add(linear, cross(angular, frame.arm)))
    return here


def regressor(
    frames: Sequence[JointFrame], dq: Sequence[Any], ddq: Sequence[Any], gravity: Vector3
) -> dict[tuple[int, int], Any]:
    """Compute the regressor of the rigid links (thesis eq. 2.22) from the joint axes.

    With ``dq = 0``, ``ddq`` in the place of velocities and no gravity it is the regressor of the momentum ``M dq``.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    dq, ddq : sequence of scalar
        N velocities and accelerations.
    gravity : Vector3
        In the base frame, m/s².

    Returns
    -------
    dict
        Scalars by (torque row, 10 * link + parameter); what is missing is 0.
    """
    motions = link_motions(frames, dq, ddq, gravity)
    carried: list[dict[int, tuple[Vector3, Vector3]]] = []
    rows: list[dict[int, list[Any]]] = []
    entries: dict[tuple[int, int], Any] = {}
    for index, frame in enumerate(frames):
        parent = frame.joint.parent
        line = joint_line(frame)
        here = _carried(frame, carried[parent]) if parent >= 0 else {}
        here[index] = frame.unit_motion
        carried.append(here)
        rows.append({})
        for source, (angular, linear) in here.items():
            row = _row(motions[index], angular, linear)
            if line is not None and source != index:
                _read_from_parent(row, rows[parent][source], line)
            rows[index][source] = row
            joint = frames[source].joint
            for parameter, value in enumerate(row):
                key = (joint.coordinate, 10 * index + parameter)
                scaled = value if joint.multiplier == 1.0 else joint.multiplier * value
                entries[key] = entries[key] + scaled if key in entries else scaled
    return entries


def momentum_balance(frames: Sequence[JointFrame], dq: Sequence[Any], gravity: Vector3) -> tuple[Entries, Entries]:
    """Split the regressor of the rigid links into the rate of a momentum and the rest: ``H = dP/dt + R``.

    The momentum of a joint is that of the links beyond it along its unit motion s. It changes by the wrench that the
    torque is, and because s moves with its own link, ``ds/dt = v x s`` (v: the twist of that link). So
    ``R = -(v x s) · h - s · gravity`` with the momentum h of each link: no accelerations. In matrices
    ``P = M dq`` and ``R = g - C' dq`` with ``C + C' = dM/dt``.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    dq : sequence of scalar
        N velocities.
    gravity : Vector3
        In the base frame, m/s².

    Returns
    -------
    momentum, rest : dict
        As that of `regressor`.

    References
    ----------
    A. De Luca, R. Mattone, Actuator failure detection and isolation using generalized momenta, Proc. IEEE
    International Conference on Robotics and Automation, 2003.
    """
    still = [0.0] * len(dq)
    momenta, resting = link_motions(frames, still, dq, ZERO), link_motions(frames, still, still, gravity)
    carried: list[dict[int, tuple[Vector3, Vector3]]] = []
    turning: list[dict[int, tuple[Vector3, Vector3]]] = []
    momentum: Entries = {}
    rest: Entries = {}
    for index, frame in enumerate(frames):
        parent = frame.joint.parent
        here = _carried(frame, carried[parent]) if parent >= 0 else {}
        rates = _carried(frame, turning[parent]) if parent >= 0 else {}
        angular, linear = here[index] = frame.unit_motion
        w, v = momenta[index].angular_acceleration, momenta[index].acceleration
        rates[index] = (cross(w, angular), add(cross(w, linear), cross(v, angular)))
        carried.append(here)
        turning.append(rates)
        for source, motion in here.items():
            joint = frames[source].joint
            held = zip(_row(resting[index], *motion), _row(momenta[index], *rates[source]), strict=True)
            for entries, row in ((momentum, _row(momenta[index], *motion)), (rest, [a - b for a, b in held])):
                for parameter, value in enumerate(row):
                    key = (joint.coordinate, 10 * index + parameter)
                    entries[key] = entries.get(key, 0.0) + joint.multiplier * value
    return momentum, rest


# The model evaluated with NumPy, sample by sample side by side, where compiling would not pay.

Array = NDArray[np.float64]


def regressor_with_numpy(
    layout: ParameterLayout, q: Array, dq: Array, ddq: Array, channels: list[Array] | None = None
) -> Array:
    """Return the regressor (S, N, n) of links and terms at S samples of a motion, (S, N) each."""
    robot = layout.robot
    result = np.zeros((len(q), robot.dof, len(layout.names)))
    frames = joint_frames(robot, list(q.T), np)
    for (row, column), value in layout.with_links(
        regressor(frames, list(dq.T), list(ddq.T), robot_gravity(robot))
    ).items():
        result[:, row, column] = value
    for row, column, value in layout.terms(list(q.T), list(dq.T), list(ddq.T), np, channels=channels):
        result[:, row, column] = value
    return result


def momentum_balance_with_numpy(
    layout: ParameterLayout, q: Array, dq: Array, channels: list[Array] | None = None
) -> tuple[Array, Array]:
    """Return P and R (S, N, n) of links and terms at S samples: the regressor is ``dP/dt + R``.

    The inertia of a term may not depend on positions.
    """
    robot = layout.robot
    frames, positions, speeds = joint_frames(robot, list(q.T), np), list(q.T), list(dq.T)
    momentum, rest = np.zeros((2, len(q), robot.dof, len(layout.names)))
    for result, entries in zip((momentum, rest), momentum_balance(frames, speeds, robot_gravity(robot)), strict=True):
        for (row, column), value in layout.with_links(entries).items():
            result[:, row, column] = value
    for (row, column), value in layout.term_momenta(positions, speeds, np).items():
        momentum[:, row, column] = value
    still = list(np.zeros_like(q).T)
    for row, column, value in layout.terms(positions, speeds, still, np, channels=channels):
        rest[:, row, column] = value
    return momentum, rest


def term_torques(
    layout: ParameterLayout, q: Array, dq: Array, ddq: Array, parameters: Array, channels: list[Array] | None = None
) -> Array:
    """Return the torques (S, N) of the terms."""
    torques = np.zeros_like(q)
    for row, column, value in layout.terms(list(q.T), list(dq.T), list(ddq.T), np, channels=channels):
        torques[:, row] += parameters[column] * value
    return torques


# Kinetic and potential energy of the rigid links, linear in their parameters, over generic scalars.


def kinetic_energy_regressor(frames: Sequence[JointFrame], dq: Sequence[Any]) -> list[list[Any]]:
    """Return for each link the ten coefficients of its kinetic energy ``w'L w/2 + v.(w x l) + m v.v/2``, J.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    dq : sequence of scalar
        N velocities.
    """
    twists: list[tuple[Vector3, Vector3]] = []
    rows: list[list[Any]] = []
    for frame in frames:
        joint = frame.joint
        velocity = frame.own(dq)
        below_w, below_v = twists[joint.parent] if joint.parent >= 0 else (ZERO, ZERO)
        w = frame.to_link(below_w)
        v = frame.to_link(add(below_v, cross(below_w, frame.base_point)))
        if frame.rotates:
            w = add(w, scale(frame.axis, velocity))
        else:
            v = add(v, scale(frame.axis, velocity))
        v = add(v, cross(w, frame.arm))
        twists.append((w, v))
        half = scale(w, 0.5)
        x, y, z = w
        rows.append([half[0] * x, x * y, x * z, half[1] * y, y * z, half[2] * z, *cross(v, w), 0.5 * dot(v, v)])
    return rows


def potential_energy_regressor(frames: Sequence[JointFrame], gravity: Vector3) -> list[list[Any]]:
    """Return for each link the ten coefficients of its potential energy ``-g.(m p + R l)``, J.

    It is zero for mass at the origin of the base frame.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    gravity : Vector3
        In the base frame, m/s².
    """
    seen: list[tuple[Vector3, Any]] = []  # gravity in the link frame, and its product with the origin's place
    rows: list[list[Any]] = []
    for frame in frames:
        below, height = seen[frame.joint.parent] if frame.joint.parent >= 0 else (gravity, 0.0)
        here = frame.to_link(below)
        height = height + dot(below, frame.base_point) + dot(here, frame.arm)
        seen.append((here, height))
        rows.append([0.0] * 6 + [-x for x in here] + [-height])
    return rows
