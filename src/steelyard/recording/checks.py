"""Faults that only the numbers of a log show: degrees, signs, swapped joints, joints at rest, limits."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from steelyard.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from steelyard.recording.recording import Recording

__all__ = ["against_limits", "measured_velocity", "standstill", "stuck_torques"]

DEGREE = pi / 180.0
BLOCK = 0.02
"""Positions and measured velocities are compared over blocks this long (s), where encoder noise no longer counts."""
MOVING = 5e-3
"""Root mean square velocity (rad/s or m/s) from which a joint counts as moving."""


def measured_velocity(recording: Recording) -> tuple[str, ...]:
    """Compare the measured velocities with the derivative of the positions, block by block.

    Faults that are certain raise InputError: a ratio of 57.3 (degrees), -1 (sign) or another far from 1 at near perfect
    correlation, a velocity that stands still while the joint moves, and a joint whose velocity is that of another.
    Lesser disagreement is a remark.
    """
    measured = recording.velocity
    if measured is None or recording.count < 3:
        return ()
    size = max(1, round(BLOCK * recording.rate))
    blocks = (recording.count - 1) // size
    if blocks < 20:
        return ()
    ends = np.arange(blocks + 1) * size
    derived = np.diff(recording.q[ends], axis=0) / np.diff(recording.t[ends])[:, None]
    # Half of either end, so that both averages are centred on the same instant.
    sums = np.add.reduceat(measured[: ends[-1]], ends[:-1], axis=0) + 0.5 * (measured[ends[1:]] - measured[ends[:-1]])
    averaged = sums / size
    size_derived = np.sqrt(np.mean(derived**2, axis=0))
    size_measured = np.sqrt(np.mean(averaged**2, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.nan_to_num((derived.T @ averaged / blocks) / np.outer(size_derived, size_measured))
    remarks = []
    for i in map(int, np.flatnonzero(size_derived > MOVING)):
        label = recording.joint_label(i)
        if size_measured[i] < 1e-3 * size_derived[i]:
            raise InputError(
                f"{recording.source}: the measured velocity of {label} stands still while its position moves; "
                'name the right columns with `velocity` in [log], or leave them out with `velocity = "none"`.'
            )
        ratio = size_derived[i] / size_measured[i]
        if abs(cosine[i, i]) > 0.97:
            remarks += _judge_ratio(recording, label, float(np.copysign(ratio, cosine[i, i])))
            continue
        j = int(np.argmax(cosine[i]))
        if (
            j != i
            and cosine[i, j] > 0.99
            and cosine[i, i] < 0.8
            and abs(size_derived[i] / size_measured[j] - 1.0) < 0.1
        ):
            raise InputError(
                f"{recording.source}: the position of {label} moves as the measured velocity of "
                f"{recording.joint_label(j)}; their columns are swapped: "
                "put `position` and `velocity` in [log] in the same order of joints."
            )
        if cosine[i, i] < 0.8:
            remarks.append(
                f"The measured velocity of {label} follows the derivative of its position poorly "
                f"(correlation {cosine[i, i]:.2f})."
            )
    return tuple(remarks)


def _judge_ratio(recording: Recording, label: str, ratio: float) -> list[str]:
    """Judge derivative over measured velocity, where the two have the same course."""
    head = (
        f"{recording.source}: the position of {label} changes {ratio:.4g} times as fast as its measured velocity says"
    )
    if abs(ratio * DEGREE - 1.0) < 0.05:
        raise InputError(f'{head}; the positions are in degrees: state `position_unit = "deg"` in [log].')
    if abs(ratio / DEGREE - 1.0) < 0.05:
        raise InputError(f'{head}; the velocities are in degrees per s: state `velocity_unit = "deg/s"` in [log].')
    if abs(ratio + 1.0) < 0.2:
        raise InputError(
            f'{head}; the two have opposite signs: correct the log, or leave out velocities with `velocity = "none"`.'
        )
    if not 0.5 < ratio < 2.0:
        raise InputError(
            f"{head}; expected 1: correct `time_unit`, `rate`, `position_unit` or `velocity_unit` in [log], "
            'or leave out velocities with `velocity = "none"`.'
        )
    if abs(ratio - 1.0) > 0.05:
        return [f"The position of {label} changes {ratio:.3g} times as fast as its measured velocity says."]
    return []


def standstill(recording: Recording) -> tuple[str, ...]:
    """Remark on joints that do not move, on constant torques and on turns that look like degrees."""
    remarks = []
    travel = np.ptp(recording.q, axis=0)
    if recording.count > 1 and not travel.any():
        raise InputError(f"{recording.source}: no joint moves; check `position` in [log], or record a motion.")
    for j in range(recording.joint_count):
        label = recording.joint_label(j)
        torque = recording.torque[:, j]
        if travel[j] == 0.0:
            remarks.append(
                f"The position of {label} is {recording.q[0, j]:.6g} throughout: it is held, or its sensor is stuck."
            )
        if recording.count > 1 and not np.ptp(torque):
            remarks.append(
                f"The torque of {label} is {torque[0]:.6g} throughout: its sensor is stuck or not connected."
            )
        if np.abs(recording.q[:, j]).max() > 8.0 * pi:
            remarks.append(
                f"The position of {label} goes from {recording.q[:, j].min():.5g} to {recording.q[:, j].max():.5g}, "
                'many turns; if it is in degrees, state `position_unit = "deg"` in [log].'
            )
    return tuple(remarks)


def stuck_torques(
    lowest: NDArray[np.float64], highest: NDArray[np.float64], travel: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Joints whose torque is one number throughout while they move: (N,) extremes of torque, travel in rad or m."""
    return np.flatnonzero((lowest == highest) & (travel > 1e-3))


def against_limits(
    recording: Recording, lower: ArrayLike, upper: ArrayLike, velocity_limit: ArrayLike
) -> tuple[str, ...]:
    """Compare with limits, see `Recording.check_against`."""
    low, high, fastest = (np.asarray(values, dtype=np.float64) for values in (lower, upper, velocity_limit))
    for values in (low, high, fastest):
        if values.shape != (recording.joint_count,):
            raise InputError(
                f"{recording.source} has {recording.joint_count} joints but there are limits for {values.size}; "
                "use the robot that was logged, or name the columns with `position` in [log]."
            )
    reach_low, reach_high = recording.q.min(axis=0), recording.q.max(axis=0)
    tolerance = 0.02 + 0.01 * np.where(np.isfinite(high - low), high - low, 0.0)

    def fits(j: int, k: int, scale: float = 1.0) -> bool:
        """Whether the positions of column k would fit joint j."""
        return bool(scale * reach_low[k] >= low[j] - tolerance[j] and scale * reach_high[k] <= high[j] + tolerance[j])

    joints = range(recording.joint_count)
    outside = [j for j in joints if not fits(j, j)]
    # Three times beyond is no calibration error: with all joints fitting after the change of unit, it is certain.
    far = [j for j in outside if max(-reach_low[j], reach_high[j]) > 3.0 * max(abs(low[j]), abs(high[j]), 0.5)]
    if far and all(fits(j, j, DEGREE) for j in joints):
        j = far[0]
        raise InputError(
            f"{recording.source}: the position of {recording.joint_label(j)} goes from {reach_low[j]:.5g} to "
            f"{reach_high[j]:.5g} rad, far beyond its limits of {low[j]:.4g} and {high[j]:.4g} rad, "
            "and all joints fit theirs as degrees; "
            'state `position_unit = "deg"` in [log].'
        )
    remarks = []
    for j in outside:
        partners = [k for k in joints if k != j and fits(j, k) and fits(k, j)]
        swapped = (
            f"; with {recording.joint_label(partners[0])} in its place both would fit" if len(partners) == 1 else ""
        )
        remarks.append(
            f"The position of {recording.joint_label(j)} goes from {reach_low[j]:.4g} to {reach_high[j]:.4g}, "
            f"beyond its limits of {low[j]:.4g} and {high[j]:.4g}{swapped}."
        )
    if recording.count > 2:
        size = max(1, round(BLOCK * recording.rate))
        coarse, stamps = recording.q[::size], recording.t[::size]
        if stamps.size > 1:
            speed = np.abs(np.diff(coarse, axis=0) / np.diff(stamps)[:, None]).max(axis=0)
            for j in map(int, np.flatnonzero(speed > 1.5 * fastest)):
                remarks.append(
                    f"{recording.joint_label(j).capitalize()} moves at {speed[j]:.4g} per s, beyond its velocity "
                    f"limit of {fastest[j]:.4g}; check the units of time and position."
                )
    return tuple(remarks)
