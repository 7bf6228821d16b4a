"""Writes the result of a simulation as CSV, Parquet or NPZ."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import replaced_file

if TYPE_CHECKING:
    from .result import SimulationResult

__all__ = ["save_result"]

SUFFIXES = (".csv", ".parquet", ".npz")


def save_result(result: SimulationResult, path: Path) -> Path:
    """Write a result; the file appears whole or not at all.

    Parameters
    ----------
    result : SimulationResult
    path : Path
        With the suffix .csv, .parquet or .npz.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        For another suffix, or where the file cannot be written.
    """
    if path.suffix not in SUFFIXES:
        raise InputError(f"{path}: a simulation is saved as {', '.join(SUFFIXES)}, got {path.suffix or 'no suffix'!r}.")
    with replaced_file(path) as file:
        if path.suffix == ".npz":
            np.savez(file, **_arrays(result))  # type: ignore[arg-type]
        else:
            import polars

            frame = polars.DataFrame(_columns(result))
            if path.suffix == ".csv":
                frame.write_csv(file)
            else:
                frame.write_parquet(file)
    return path


def _columns(result: SimulationResult) -> dict[str, NDArray[np.float64] | NDArray[np.intp]]:
    runs, samples = (len(result.q), len(result.t)) if result.is_batch else (1, len(result.t))
    columns: dict[str, NDArray[np.float64] | NDArray[np.intp]] = {}
    if result.is_batch:
        columns["run"] = np.repeat(np.arange(runs), samples)
    columns["t"] = np.tile(result.t, runs)
    for name, values in (("q", result.q), ("dq", result.dq), ("ddq", result.ddq), ("tau", result.torque)):
        flat = values.reshape(-1, result.joint_count)
        columns |= {f"{name}{k + 1}": flat[:, k] for k in range(result.joint_count)}
    for name in ("kinetic_energy", "potential_energy", "dissipated"):
        columns[name] = getattr(result, name).reshape(-1)
    return columns


def _arrays(result: SimulationResult) -> dict[str, NDArray[np.float64] | NDArray[np.str_]]:
    if not result.is_batch:  # the columns of a log, which Recording.read takes
        return {**_columns(result), "joint_names": np.array(result.joint_names)}  # type: ignore[dict-item]
    names = ("t", "q", "dq", "ddq", "torque", "kinetic_energy", "potential_energy", "dissipated", "end_time")
    status = np.array([s.value for s in result.status])  # type: ignore[attr-defined]
    return {**{name: getattr(result, name) for name in names}, "status": status}
