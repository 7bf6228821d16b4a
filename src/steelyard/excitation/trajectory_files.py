"""Reads saved trajectories: coefficients from JSON, samples from CSV, Parquet or a ROS 2 JointTrajectory."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import listed, read_json, read_table, reading_table, require_format, shown
from steelyard.robot import Robot

from .fourier import FourierTrajectory, RestToRestTrajectory
from .ros import read_joint_trajectory
from .spline import QuinticTrajectory, SplineTrajectory
from .trajectory import FORMAT, SUFFIXES, Trajectory, unnamed

__all__ = ["load_trajectory"]

Array = NDArray[np.float64]
# Larger positions, velocities or accelerations, or durations (s), come from a damaged file: no robot has them, and
# their squares would overflow later.
LARGEST, LONGEST = 1e12, 1e7


def load_trajectory(path: str | Path, robot: Robot | None = None) -> Trajectory:
    """Read a trajectory that `save_trajectory` wrote.

    Parameters
    ----------
    path : str or Path
    robot : Robot, optional
        The robot that it is to move.

    Returns
    -------
    Trajectory
        From JSON the same trajectory. From samples a :class:`QuinticTrajectory`, whose polynomials of degree five have
        the positions, velocities and accelerations of the samples.

    Raises
    ------
    InputError
        If the file is missing, is not a trajectory, or is one of other joints than those of the robot. CSV and Parquet
        do not name joints, so that only their number is compared.
    """
    source = Path(path)
    suffix = source.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            f"{source}: a trajectory is read from {', '.join(SUFFIXES)}, got the suffix {source.suffix!r}."
        )
    trajectory, names = _loaded(source, suffix)
    if robot is not None:
        _require_joints(source, trajectory.dof, names, robot)
    if trajectory.duration <= LONGEST:
        with np.errstate(all="ignore"):
            motion = trajectory.motion(np.linspace(0.0, trajectory.duration, 200))
    if not trajectory.duration <= LONGEST or not all(np.all(np.abs(values) <= LARGEST) for values in motion):
        raise InputError(f"{source}: holds a motion beyond {LARGEST:g} rad or m, or {LONGEST:g} s; save it again.")
    return trajectory


def _require_joints(source: Path, count: int, names: Any, robot: Robot) -> None:
    own = list(robot.joint_names)
    if count != len(own):
        raise InputError(
            f"{source}: is a motion of {count} joints, but {robot.name} has {len(own)} ({listed(own)}); give a motion "
            "of this robot."
        )
    if names is not None and names not in (own, unnamed(count)):
        given = listed(names) if isinstance(names, list) else shown(names)
        raise InputError(
            f"{source}: is a motion of the joints {given}, but those of {robot.name} are {listed(own)}, in this order; "
            "give a motion of this robot."
        )


def _loaded(source: Path, suffix: str) -> tuple[Trajectory, Any]:
    """Return the trajectory, and the names of its joints as the file has them, None where it has none."""
    try:
        if suffix == ".json":
            document = read_json(source)
            return _from_document(document, source), document.get("joint_names")
        if suffix in (".yaml", ".yml"):
            names, motion = read_joint_trajectory(source)
            return QuinticTrajectory(*motion), names
        return QuinticTrajectory(*_read_table(source)), None
    except OSError as error:
        raise InputError(f"{source}: cannot be read ({error.strerror or error}).") from None
    except InputError as error:
        message = str(error)
        raise InputError(message if message.startswith(str(source)) else f"{source}: {message}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{source}: is not a trajectory that was saved by steelyard ({shown(str(error))}).") from None


def _make_fourier(document: dict[str, Any]) -> Trajectory:
    series = FourierTrajectory(**{name: document[name] for name in ("a", "b", "center", "frequency")})
    if "ramp_time" not in document:
        return series
    return RestToRestTrajectory(
        series, document["ramp_time"], document["periods"], float(document.get("slow_time", 0.0))
    )


_FAMILIES: dict[str, Callable[[dict[str, Any]], Trajectory]] = {
    "fourier": _make_fourier,
    "spline": lambda d: SplineTrajectory(d["points"], d["duration"]),
    "quintic": lambda d: QuinticTrajectory(d["times"], d["q"], d["dq"], d["ddq"]),
}


def _from_document(document: dict[str, Any], source: Path) -> Trajectory:
    require_format(document["format"], FORMAT, source, "give a trajectory that steelyard saved")
    make = _FAMILIES.get(document["family"])
    if make is None:
        raise InputError(f"{source}: family is {shown(document['family'])}, expected one of {', '.join(_FAMILIES)}.")
    return make(document)


def _read_table(path: Path) -> tuple[Array, Array, Array, Array]:
    import polars

    frame = read_table(path, "give a trajectory")
    count = sum(name.startswith("q") for name in frame.columns)
    wanted = ["t", *(f"{name}{k + 1}" for name in ("q", "dq", "ddq") for k in range(count))]
    missing = [name for name in wanted if name not in frame.columns]
    if missing or count == 0:
        raise InputError(
            f"{path}: a trajectory has the columns t, q1 …, dq1 …, ddq1 …, but {(missing or ['q1'])[0]} is missing."
        )
    with reading_table(path, "numbers"):
        values = frame.select(wanted).cast(polars.Float64).to_numpy()
    if not len(values):
        raise InputError(f"{path}: a trajectory has rows of numbers, and there are none; save it again.")
    if not np.isfinite(values).all():
        raise InputError(f"{path}: some of its numbers are missing or not finite; save it again.")
    t, q, dq, ddq = np.split(values, [1, 1 + count, 1 + 2 * count], axis=1)
    return t[:, 0] - t[0, 0], q, dq, ddq
