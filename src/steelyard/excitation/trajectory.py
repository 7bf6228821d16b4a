"""The interface of trajectories, and how trajectories are sampled and saved."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files import listed, replaced_file, write_json, write_table, write_text

from .ros import joint_trajectory_text

__all__ = [
    "FORMAT",
    "SUFFIXES",
    "SampledTrajectory",
    "Trajectory",
    "sample_times",
    "save_trajectory",
    "times_of",
    "unnamed",
]

Array = NDArray[np.float64]
FORMAT = "steelyard-trajectory-1"
SUFFIXES = (".json", ".csv", ".parquet", ".yaml", ".yml")
TABLE_RATE, ROS_RATE = 1000.0, 100.0  # Hz; controllers of ROS interpolate


@runtime_checkable
class Trajectory(Protocol):
    """A motion of N joints in time.

    Attributes
    ----------
    duration : float
        Time from the first to the last instant, s.
    dof : int
        Number N of joints.
    """

    @property
    def duration(self) -> float:
        """Time from the first to the last instant, s."""
        ...

    @property
    def dof(self) -> int:
        """Number N of joints."""
        ...

    def motion(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq, (S, N) each, at times (S,), s."""
        ...

    def sample(self, rate: float) -> tuple[Array, Array, Array, Array]:
        """Return t (S,), q, dq and ddq (S, N) at `rate` (Hz)."""
        ...

    def save(self, path: str | Path) -> None:
        """Write the trajectory to a file; its suffix determines the format."""
        ...


def times_of(t: ArrayLike) -> Array:
    """Check and convert times (S,).

    Raises
    ------
    InputError
        If `t` is not a one-dimensional array of finite numbers.
    """
    times = np.asarray(t, dtype=np.float64)
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError(f"t must be a row (S,) of finite times in s, got shape {times.shape}.")
    return times


def sample_times(duration: float, rate: float) -> Array:
    """Return the instants at `rate` (Hz) from 0 to the first one that is not before `duration` (s).

    Raises
    ------
    InputError
        If the rate is not positive.
    """
    if not (np.isfinite(rate) and rate > 0.0):
        raise InputError(f"rate must be positive, in Hz, got {rate!r}.")
    return np.arange(int(np.ceil(duration * rate - 1e-9)) + 1) / rate


def unnamed(count: int) -> list[str]:
    """Return the names that files give to joints whose names nobody gave."""
    return [f"joint{k + 1}" for k in range(count)]


class SampledTrajectory:
    """Base class of the trajectories of this package: sampling from the first to the last instant, and saving."""

    def sample(self: Trajectory, rate: float) -> tuple[Array, Array, Array, Array]:
        """Return t (S,), q, dq and ddq (S, N) from the first to the last instant at `rate` (Hz)."""
        t = sample_times(self.duration, rate)
        return (t, *self.motion(t))

    def save(self: Trajectory, path: str | Path) -> None:
        """Write the trajectory; see :func:`steelyard.excitation.save_trajectory`."""
        save_trajectory(self, path)


def save_trajectory(
    trajectory: Trajectory, path: str | Path, *, rate: float | None = None, joint_names: Sequence[str] | None = None
) -> None:
    """Write a trajectory; the file is written completely or not at all.

    Parameters
    ----------
    trajectory : Trajectory
    path : str or Path
        A ``.json`` file holds the coefficients, from which `load_trajectory` makes the same trajectory. The other
        formats hold samples: ``.csv`` and ``.parquet`` in columns t, q1 …, dq1 …, ddq1 …, and ``.yaml`` as a ROS 2
        ``trajectory_msgs/msg/JointTrajectory``.
    rate : float, optional
        Rate of the samples, Hz: by default 1000, and 100 for ROS, whose controllers interpolate.
    joint_names : sequence of str, optional
        Names of the joints for ROS and JSON; joint1, joint2 and so on by default.

    Raises
    ------
    InputError
        If the suffix, the rate or the names do not fit, or the trajectory has no coefficients.

    Examples
    --------
    >>> import tempfile
    >>> from steelyard.excitation import QuinticTrajectory, load_trajectory
    >>> trajectory = QuinticTrajectory.point_to_point([[0.0], [1.0]], [2.0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_trajectory(trajectory, Path(folder) / "move.json")
    ...     load_trajectory(Path(folder) / "move.json").duration
    2.0
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{target}: a trajectory is saved as {', '.join(SUFFIXES)}, got the suffix {target.suffix!r}.")
    names = tuple(joint_names or unnamed(trajectory.dof))
    if len(names) != trajectory.dof or len(set(names)) < len(names):
        raise InputError(f"{target}: {trajectory.dof} different joint names are needed, got {listed(names)}.")
    if suffix == ".json":
        write_json({"format": FORMAT, "joint_names": list(names), **_coefficients(trajectory)}, target, indent=None)
        return
    ros = suffix in (".yaml", ".yml")
    t = sample_times(trajectory.duration, (ROS_RATE if ros else TABLE_RATE) if rate is None else rate)
    motion = trajectory.motion(t)
    if ros:
        write_text(joint_trajectory_text(names, t, *motion), target)
        return
    with replaced_file(target) as file:
        _write_table(file, suffix, t, motion)


def _coefficients(trajectory: Trajectory) -> dict[str, Any]:
    to_dict = getattr(trajectory, "to_dict", None)
    if to_dict is None:
        raise InputError(
            f"A trajectory of type {type(trajectory).__name__} has no method to_dict() that returns its coefficients; "
            "save it as .csv, .parquet or .yaml."
        )
    found: dict[str, Any] = to_dict()
    return found


def _write_table(file: BinaryIO, suffix: str, t: Array, motion: tuple[Array, Array, Array]) -> None:
    import polars

    columns = {"t": t}
    for name, values in zip(("q", "dq", "ddq"), motion, strict=True):
        columns |= {f"{name}{k + 1}": values[:, k] for k in range(values.shape[1])}
    write_table(polars.DataFrame(columns), file, suffix)
