"""Trajectories as files: coefficients as JSON, samples as CSV, Parquet or a ROS 2 JointTrajectory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import read_json, reading_table, replaced_file, require_file, shown, write_json, write_text

from .fourier import FourierTrajectory, RestToRestTrajectory
from .quintic import QuinticTrajectory
from .ros import joint_trajectory_text, read_joint_trajectory
from .spline import SplineTrajectory
from .trajectory import Trajectory, sample_times

__all__ = ["FORMAT", "load_trajectory", "save_trajectory"]

Array = NDArray[np.float64]
FORMAT = "steelyard-trajectory-1"
SUFFIXES = (".json", ".csv", ".parquet", ".yaml", ".yml")
LARGEST, LONGEST = 1e12, 1e7  # of positions and their derivatives; s
TABLE_RATE, ROS_RATE = 1000.0, 100.0  # Hz


def save_trajectory(
    trajectory: Trajectory,
    path: str | Path,
    *,
    rate: float | None = None,
    joint_names: Sequence[str] | None = None,
) -> None:
    """Write a trajectory; the file appears whole or not at all.

    Parameters
    ----------
    trajectory : Trajectory
    path : str or Path
        ``.json`` holds the coefficients, from which `load_trajectory` makes the same trajectory. The others hold
        samples: ``.csv`` and ``.parquet`` columns t, q1 …, dq1 …, ddq1 …, and ``.yaml`` a ROS 2
        ``trajectory_msgs/msg/JointTrajectory``.
    rate : float, optional
        Of the samples, Hz: 1000 by default, 100 for ROS, whose controllers interpolate.
    joint_names : sequence of str, optional
        For ROS and JSON; joint1, joint2 and so on by default.

    Raises
    ------
    InputError
        If the suffix, the rate or the names do not fit, or the trajectory has no coefficients.

    Examples
    --------
    >>> import tempfile
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
    names = tuple(joint_names or (f"joint{k + 1}" for k in range(trajectory.joint_count)))
    if len(names) != trajectory.joint_count or len(set(names)) < len(names):
        raise InputError(
            f"{target}: {trajectory.joint_count} different joint names are needed, got {', '.join(names)}."
        )
    if suffix == ".json":
        write_json(_document(trajectory, names), target, indent=None)
        return
    ros = suffix in (".yaml", ".yml")
    t = sample_times(trajectory.duration, (ROS_RATE if ros else TABLE_RATE) if rate is None else rate)
    motion = trajectory.motion(t)
    if ros:
        write_text(joint_trajectory_text(names, t, *motion), target)
        return
    with replaced_file(target) as file:
        _write_table(file, suffix, t, motion)


def load_trajectory(path: str | Path) -> Trajectory:
    """Read what `save_trajectory` wrote.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Trajectory
        The same one from JSON. From samples, the polynomials of degree five that pass through them, with their
        velocities and accelerations.

    Raises
    ------
    InputError
        If the file is missing or is something else.
    """
    source = Path(path)
    suffix = source.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            f"{source}: a trajectory is read from {', '.join(SUFFIXES)}, got the suffix {source.suffix!r}."
        )
    trajectory = _loaded(source, suffix)
    if trajectory.duration <= LONGEST:
        with np.errstate(all="ignore"):
            motion = trajectory.motion(np.linspace(0.0, trajectory.duration, 200))
    if not trajectory.duration <= LONGEST or not all(np.all(np.abs(values) <= LARGEST) for values in motion):
        raise InputError(f"{source}: holds a motion beyond {LARGEST:g} rad or m, or {LONGEST:g} s; save it again.")
    return trajectory


def _loaded(source: Path, suffix: str) -> Trajectory:
    try:
        if suffix == ".json":
            return _from_document(read_json(source), source)
        if suffix in (".yaml", ".yml"):
            return QuinticTrajectory(*read_joint_trajectory(source))
        return QuinticTrajectory(*_read_table(source, suffix))
    except OSError as error:
        raise InputError(f"{source}: cannot be read ({error.strerror or error}).") from None
    except InputError as error:
        message = str(error)
        raise InputError(message if message.startswith(str(source)) else f"{source}: {message}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{source}: is not a trajectory that was saved by steelyard ({shown(str(error))}).") from None


def _fourier(trajectory: FourierTrajectory) -> dict[str, Any]:
    return {
        "a": trajectory.a.tolist(),
        "b": trajectory.b.tolist(),
        "center": trajectory.center.tolist(),
        "frequency": trajectory.frequency,
    }


def _document(trajectory: Trajectory, names: tuple[str, ...]) -> dict[str, Any]:
    document: dict[str, Any] = {"format": FORMAT, "joint_names": list(names)}
    match trajectory:
        case FourierTrajectory():
            return {**document, "family": "fourier", **_fourier(trajectory)}
        case RestToRestTrajectory():
            leads = {"ramp_time": trajectory.ramp_time, "periods": trajectory.periods}
            return {**document, "family": "fourier", **_fourier(trajectory.series), **leads}
        case SplineTrajectory():
            return {
                **document,
                "family": "spline",
                "points": trajectory.points.tolist(),
                "duration": trajectory.duration,
            }
        case QuinticTrajectory():
            arrays = {name: getattr(trajectory, name).tolist() for name in ("times", "q", "dq", "ddq")}
            return {**document, "family": "quintic", **arrays}
    raise InputError(
        f"A trajectory of type {type(trajectory).__name__} has no coefficients that are known here; save it as .csv, "
        ".parquet or .yaml."
    )


def _make_fourier(document: dict[str, Any]) -> Trajectory:
    series = FourierTrajectory(**{name: document[name] for name in ("a", "b", "center", "frequency")})
    return (
        RestToRestTrajectory(series, document["ramp_time"], document["periods"]) if "ramp_time" in document else series
    )


_FAMILIES: dict[str, Callable[[dict[str, Any]], Trajectory]] = {
    "fourier": _make_fourier,
    "spline": lambda d: SplineTrajectory(d["points"], d["duration"]),
    "quintic": lambda d: QuinticTrajectory(d["times"], d["q"], d["dq"], d["ddq"]),
}


def _from_document(document: dict[str, Any], source: Path) -> Trajectory:
    if document["format"] != FORMAT:
        raise InputError(f"{source}: format is {shown(document['format'])}, expected {FORMAT!r}.")
    make = _FAMILIES.get(document["family"])
    if make is None:
        raise InputError(f"{source}: family is {shown(document['family'])}, expected one of {', '.join(_FAMILIES)}.")
    return make(document)


def _write_table(file: BinaryIO, suffix: str, t: Array, motion: tuple[Array, Array, Array]) -> None:
    import polars

    columns = {"t": t}
    for name, values in zip(("q", "dq", "ddq"), motion, strict=True):
        columns |= {f"{name}{k + 1}": values[:, k] for k in range(values.shape[1])}
    frame = polars.DataFrame(columns)
    if suffix == ".csv":
        frame.write_csv(file)
    else:
        frame.write_parquet(file)


def _read_table(path: Path, suffix: str) -> tuple[Array, Array, Array, Array]:
    import polars

    require_file(path, "give a trajectory")
    with reading_table(path, "a table"):
        frame = polars.read_csv(path, glob=False) if suffix == ".csv" else polars.read_parquet(path, glob=False)
    count = sum(name.startswith("q") for name in frame.columns)
    wanted = ["t", *(f"{name}{k + 1}" for name in ("q", "dq", "ddq") for k in range(count))]
    missing = [name for name in wanted if name not in frame.columns]
    if missing or count == 0:
        raise InputError(
            f"{path}: a trajectory has the columns t, q1 …, dq1 …, ddq1 …, but {(missing or ['q1'])[0]} is missing."
        )
    with reading_table(path, "numbers"):
        values = frame.select(wanted).cast(polars.Float64).to_numpy()
    t, q, dq, ddq = np.split(values, [1, 1 + count, 1 + 2 * count], axis=1)
    return t[:, 0] - t[0, 0], q, dq, ddq
