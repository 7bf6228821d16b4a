"""The result of a simulation, and how it is saved."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table
from steelyard.errors import InputError
from steelyard.files import replaced_file, write_table
from steelyard.recording import Recording

from .events import Occurrence, Status
from .watch import Interpolant

__all__ = ["IMPOSSIBLE", "Measured", "SimulationResult", "save_result"]

Array = NDArray[np.float64]
IMPOSSIBLE = "these parameters are not physically possible"
"""What the message of a run says where they are not, and no other."""
_ALONG_TIME = ("q", "dq", "ddq", "torque", "kinetic_energy", "potential_energy", "dissipated")


@dataclass(frozen=True, eq=False)
class Measured:
    """Readings of the sensors at the times of a result, in the shapes of its arrays.

    Attributes
    ----------
    q, torque : ndarray
        (S, N) or (R, S, N).
    dq : ndarray or None
        None where velocities are not measured.
    force : ndarray or None
        (S, 6) or (R, S, 6), where there is an environment.
    """

    q: Array
    torque: Array
    dq: Array | None = None
    force: Array | None = None


@dataclass(frozen=True, eq=False, repr=False)
class SimulationResult:
    """The motion of one run or of R runs, and how each of them ended.

    For one run, S is the number of samples until its end. In a batch every run has all S samples, with NaN after its
    end.

    Attributes
    ----------
    t : ndarray
        (S,) times, s.
    q, dq, ddq : ndarray
        (S, N) or (R, S, N): rad or m, and per s, per s².
    torque : ndarray
        (S, N) or (R, S, N) torques of the actuators, N·m or N; held torques act from their time on.
    kinetic_energy, potential_energy : ndarray
        (S,) or (R, S), J, of links, rotors and springs. In base parameters the potential is known up to a constant.
    dissipated : ndarray
        (S,) or (R, S), J: the work of friction and offsets since the start, by the trapezoidal rule over the samples.
    status : Status or tuple of Status
        A batch has one for each run.
    end_time : float or ndarray
        Time at which the run ended, s; (R,) in a batch.
    message : str or tuple of str
        The reason and the time where a run ended early, and a remark where its inertia matrix was not positive
        definite; otherwise empty.
    final_q, final_dq : ndarray
        (N,) or (R, N) at the ends of the runs.
    joint_names : tuple of str
    method : str
        Integration method that was used.
    events : tuple of Occurrence
        Events that occurred, in the order of time.
    measured : Measured or None
        Readings of the sensors, where there were sensors.
    force : ndarray or None
        (S, 6) or (R, S, 6): the environment's wrench on the link, base axes, force before moment, N and N·m.
    options : mapping
        Options of the simulation, as plain numbers and texts.
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    torque: Array
    kinetic_energy: Array
    potential_energy: Array
    dissipated: Array
    status: Status | tuple[Status, ...]
    end_time: float | Array
    message: str | tuple[str, ...]
    final_q: Array
    final_dq: Array
    joint_names: tuple[str, ...]
    method: str
    events: tuple[Occurrence, ...] = ()
    measured: Measured | None = None
    force: Array | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    pieces: tuple[tuple[float, float, Interpolant], ...] = ()

    @property
    def energy(self) -> Array:
        """Kinetic and potential energy together, J."""
        return self.kinetic_energy + self.potential_energy

    @property
    def is_batch(self) -> bool:
        """Whether these are several runs."""
        return self.q.ndim == 3

    @property
    def dof(self) -> int:
        """Number N of joints."""
        return int(self.q.shape[-1])

    def at(self, t: ArrayLike) -> tuple[Array, Array]:
        """Return positions and velocities between the samples.

        An adaptive method with one run uses its own interpolant. Otherwise cubic polynomials pass through the positions
        and velocities of the samples.

        Parameters
        ----------
        t : array_like
            () or (k,) times within the run, s.

        Returns
        -------
        q, dq : ndarray
            (N,) or (k, N); (R, N) or (R, k, N) in a batch.

        Raises
        ------
        InputError
            If a time is outside the run, or the times are no number and no row of numbers.
        """
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        if times.ndim > 1:
            raise InputError(f"at() takes one time or a row of times, got an array of shape {times.shape}.")
        last = float(self.pieces[-1][1] if self.pieces else self.t[-1])
        if not ((times >= self.t[0]) & (times <= last)).all():
            raise InputError(f"at() knows times from {self.t[0]:.6g} to {last:.6g} s, got {np.asarray(t).tolist()}.")
        state = self._of_method(times) if self.pieces else self._of_cubics(times)
        if np.ndim(t) == 0:
            state = state[..., 0, :]
        return state[..., : self.dof], state[..., self.dof :]

    def _of_method(self, times: Array) -> Array:
        begins = np.array([piece[0] for piece in self.pieces])
        rows = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, None)
        one = np.zeros(1, dtype=np.intp)
        return np.concatenate([self.pieces[k][2](one, times[i : i + 1]) for i, k in enumerate(rows)])

    def _of_cubics(self, times: Array) -> Array:
        if len(self.t) == 1:
            state = np.concatenate([self.q, self.dq], axis=-1)
            return np.repeat(state, len(times), axis=-2)
        k = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 2)
        h = (self.t[k + 1] - self.t[k])[:, np.newaxis]
        s = (times - self.t[k])[:, np.newaxis] / h
        q0, q1, v0, v1 = (x[..., i, :] for x in (self.q, self.dq) for i in (k, k + 1))
        bend, twist = (q1 - q0) - h * v0, h * (v0 + v1) - 2.0 * (q1 - q0)
        q = q0 + s * (h * v0 + s * ((bend - twist) + s * twist))
        dq = (h * v0 + s * (2.0 * (bend - twist) + s * 3.0 * twist)) / h
        return np.concatenate([q, dq], axis=-1)

    def run(self, index: int) -> SimulationResult:
        """Return one run of a batch, without the samples after its end.

        Raises
        ------
        InputError
            If this is no batch, or has no such run.
        """
        if not self.is_batch:
            raise InputError("run() picks a run of a batch, and this result is a single run; use it as it is.")
        if not 0 <= index < len(self.q):
            raise InputError(f"The batch has runs 0 to {len(self.q) - 1}, got {index}.")
        kept = int(np.isfinite(self.q[index]).all(axis=1).sum())

        def cut(array: Array) -> Array:
            return array[index, :kept]

        measured = self.measured
        if measured is not None:
            rest = [None if x is None else cut(x) for x in (measured.dq, measured.force)]
            measured = Measured(cut(measured.q), cut(measured.torque), *rest)
        arrays: dict[str, Any] = {name: cut(getattr(self, name)) for name in _ALONG_TIME}
        ends: dict[str, Any] = {
            name: getattr(self, name)[index] for name in ("status", "message", "final_q", "final_dq")
        }
        return replace(
            self,
            t=self.t[:kept],
            end_time=float(np.asarray(self.end_time)[index]),
            events=tuple(e for e in self.events if e.run == index),
            measured=measured,
            force=None if self.force is None else cut(self.force),
            **arrays,
            **ends,
        )

    def recording(self, run: int | None = None) -> Recording:
        """Return the log of a run: the readings of the sensors, or the true values where there were none.

        Row k holds the positions at its time and the torques that begin to act then, as the log of a control loop does.

        Parameters
        ----------
        run : int, optional
            Index of the run in a batch.

        Raises
        ------
        InputError
            If this is a batch and no run is given.
        """
        if run is not None:
            return self.run(run).recording()
        if self.is_batch:
            raise InputError(f"The batch has {len(self.q)} runs; name one, as in recording(run=0).")
        names, source = self.joint_names, "simulation"
        seen = self.measured
        if seen is None:
            return Recording(t=self.t, q=self.q, torque=self.torque, velocity=self.dq, source=source, joint_names=names)
        return Recording(t=self.t, q=seen.q, torque=seen.torque, velocity=seen.dq, source=source, joint_names=names)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write to .csv, .parquet or .npz: t, q1, …, dq1, …, ddq1, …, tau1, … and energies; in a batch also `run`.

        Raises
        ------
        InputError
            For another suffix, or where the file cannot be written.
        """
        return save_result(self, Path(path))

    def __repr__(self) -> str:
        size = f"{len(self.t)} samples x {self.dof} joints, {self.method}"
        if not isinstance(self.status, Status):
            counts = ", ".join(f"{self.status.count(s)} {s.value}" for s in Status if s in self.status)
            return f"SimulationResult({len(self.q)} runs, {size}: {counts})"
        text = "" if not self.message else f", {self.message}"
        return f"SimulationResult({size}: {self.status.value} at {self.end_time:.6g} s{text})"

    def _repr_html_(self) -> str:
        rows = [
            (name, _range(self.q[..., k]), _most(self.dq[..., k]), _most(self.torque[..., k]))
            for k, name in enumerate(self.joint_names)
        ]
        table = html_table(repr(self), ("joint", "position", "speed at most", "torque at most"), rows)
        return f"{table}<p>Energy: {_range(self.energy)} J</p>"


def _range(values: Array) -> str:
    known = values[np.isfinite(values)]
    return f"{known.min():.4g} … {known.max():.4g}" if known.size else "unknown"


def _most(values: Array) -> str:
    known = values[np.isfinite(values)]
    return f"{np.abs(known).max():.4g}" if known.size else "unknown"


SUFFIXES = (".csv", ".parquet", ".npz")


def save_result(result: SimulationResult, path: Path) -> Path:
    """Write a result; the file is written completely or not at all.

    Parameters
    ----------
    path : Path
        With the suffix .csv, .parquet or .npz.

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

            write_table(polars.DataFrame(_columns(result)), file, path.suffix)
    return path


def _columns(result: SimulationResult) -> dict[str, NDArray[np.float64] | NDArray[np.intp]]:
    runs, samples = (len(result.q), len(result.t)) if result.is_batch else (1, len(result.t))
    columns: dict[str, NDArray[np.float64] | NDArray[np.intp]] = {}
    if result.is_batch:
        columns["run"] = np.repeat(np.arange(runs), samples)
    columns["t"] = np.tile(result.t, runs)
    for name, values in (("q", result.q), ("dq", result.dq), ("ddq", result.ddq), ("tau", result.torque)):
        flat = values.reshape(-1, result.dof)
        columns |= {f"{name}{k + 1}": flat[:, k] for k in range(result.dof)}
    for name in ("kinetic_energy", "potential_energy", "dissipated"):
        columns[name] = getattr(result, name).reshape(-1)
    return columns


def _arrays(result: SimulationResult) -> dict[str, NDArray[np.float64] | NDArray[np.str_]]:
    if not result.is_batch:  # the columns of a log, which Recording.read takes
        return {**_columns(result), "joint_names": np.array(result.joint_names)}  # type: ignore[dict-item]
    names = ("t", "q", "dq", "ddq", "torque", "kinetic_energy", "potential_energy", "dissipated", "end_time")
    status = np.array([s.value for s in result.status])  # type: ignore[attr-defined]
    return {**{name: getattr(result, name) for name in names}, "status": status}
