"""Simulations of a robot file: with the parameters of an estimate or of the description, and torques from a file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.excitation.motion_limits import described_limits
from steelyard.files import listed, read_table, reading_table
from steelyard.regression import Estimate
from steelyard.regression.estimate import estimate_file
from steelyard.robot import Robot, RobotFile
from steelyard.simulation import (
    Event,
    Measurement,
    MotorControl,
    SimulationResult,
    at_rest,
    joint_limits,
    motor_coordinates,
    simulate,
)

from .default_terms import model_of_estimate
from .saved import matching_estimate, parameters_of_description

if TYPE_CHECKING:
    from collections.abc import Sequence

    from steelyard.excitation import Trajectory

    from .elastic.elastic_model import ElasticModel

__all__ = ["FileSimulation", "simulate_files"]

Array = NDArray[np.float64]
# Hz, of the samples where torques come from a file, so that they show the motion between its rows.
LEAST_RATE = 1000.0
_FOLLOWED, _SMALL_RANGE = 0.1, 0.1  # share of a joint's range, and rad or m that smaller ranges count as
_PASSED = 1.01  # of an effort limit, which feedback passes by less where a motion uses it up
GAINS = (1600.0, 80.0)
"""Of the controller that follows a trajectory, 1/s² and 1/s: a natural frequency of 40 rad/s as that of `play`,
critically damped. With 12 rad/s the last joint of a UR10, of friction that its inertia hardly outweighs, was up to
2.8 rad off, and that of a TX40 0.58 rad; with these 0.27 and 0.074."""


@dataclass(frozen=True, eq=False)
class FileSimulation:
    """A simulation and where it came from.

    Attributes
    ----------
    inputs : tuple of Path
        The files that were read.
    parameters : str
        Whose parameters they are, in words.
    options : dict
        What was asked for.
    notes : tuple of str
        What was made of the torques of a file, and which torques the drives of the robot could not give.
    """

    model: Model
    result: SimulationResult
    inputs: tuple[Path, ...]
    parameters: str
    options: dict[str, Any]
    notes: tuple[str, ...] = ()


def simulate_files(
    robot: str | Path | RobotFile,
    estimate: str | Path | None = None,
    *,
    duration: float | None = None,
    initial: list[float] | None = None,
    torque: str | Path | None = None,
    follow: str | Path | None = None,
    method: str = "automatic",
    rate: float | None = None,
    sign_width: float = 1e-3,
    stop_at_limits: bool = False,
) -> FileSimulation:
    """Simulate the robot of a file.

    Parameters
    ----------
    robot : str, Path or RobotFile
        URDF or robot.toml.
    estimate : str or Path, optional
        What :meth:`steelyard.Estimate.save` wrote; the values of the description (CAD) where not given.
    duration : float, optional
        s; that of the torques or of the trajectory where there is one, otherwise 5 s.
    initial : list of float, optional
        N joint positions; zeros, or the start of the trajectory.
    torque : str or Path, optional
        A CSV or Parquet file with columns ``t`` and ``tau1`` to ``tauN``, in equal steps of time: each row's torques
        are held until the next, the last row's on and on, and its first time is 0 s of the simulation. Samples come
        at the table's rate, or the least multiple of it that is 1 kHz at least.
    follow : str or Path, optional
        A trajectory (see :func:`steelyard.load_trajectory`) that the robot follows under computed torque with the same
        parameters, at 1 kHz, with the gains `GAINS`.
    method, rate, sign_width
        See :func:`steelyard.simulate`.
    stop_at_limits : bool
        End the run where a joint passes a limit of the description.

    Raises
    ------
    InputError
        If a file or an option cannot be used.
    """
    file = RobotFile.load(robot)
    model = model_of_estimate(estimate, file)
    inputs = [file.path, *([model.robot.source] if model.robot.source is not None else [])]
    parameters, base, whose = _parameters(model, estimate)
    elastic = None if estimate is None else _elastic(model, estimate)
    if torque is not None and follow is not None:
        raise InputError("Give either --torque or --follow: the motors obey one of them.")
    if initial is not None and len(initial) != model.dof:
        raise InputError(
            f"--initial gives {len(initial)} positions, but {model.robot.name} has {model.dof} joints: "
            f"{listed(model.robot.joint_names)}."
        )
    q0, dq0 = np.zeros(model.dof) if initial is None else np.array(initial), np.zeros(model.dof)
    motors: Any = None
    notes: tuple[str, ...] = ()
    if torque is not None:
        motors = TorqueTable.read(torque, model.dof, rate)
        duration = motors.duration if duration is None else duration
        notes = motors.notes(duration)
    if follow is not None:
        from steelyard.control import ComputedTorque
        from steelyard.excitation import load_trajectory

        trajectory = load_trajectory(follow, model.robot)
        start = trajectory.motion(np.zeros(1))
        q0, dq0 = start[0][0] if initial is None else q0, start[1][0]
        kp, kd = GAINS
        motors = ComputedTorque(model, parameters, trajectory, kp=kp, kd=kd, base=base, compensate_drives=True)
        if duration is None:
            # Whole samples: the robot rests at the end, and a log with a last interval of its own is an uneven one.
            spacing = motors.sample_time if rate is None else 1.0 / rate
            duration = math.ceil(trajectory.duration / spacing - 1e-6) * spacing
    initial_positions = q0
    if elastic is not None:
        model, parameters, base = elastic.model, elastic.parameters, False
        notes = (*notes, *_notes_on_motors(elastic))
        whose += ", with its elastic joints"
        dq0 = _with_motors(model, dq0)
        q0 = at_rest(model, parameters, q0)
        motors = None if motors is None else MotorControl(motors, model)
    events: tuple[Event, ...] = (joint_limits(model.robot),) if stop_at_limits else ()
    result = simulate(
        model,
        parameters,
        q0,
        dq0,
        5.0 if duration is None else duration,
        motors,
        base=base,
        method=method,
        rate=rate,
        sign_width=sign_width,
        events=events,
    )
    if follow is not None and initial is None:  # which may be far away from where the trajectory begins
        notes = (*notes, *_notes_on_following(result, trajectory, model.robot.position_units))
    if motors is not None:
        at_drives = result.torque if elastic is None else result.torque[:, motor_coordinates(model)]
        notes = (*notes, *_notes_on_drives(at_drives, model.robot))
    options = {
        **result.options,
        "initial": initial_positions.tolist(),
        "torque": None if torque is None else str(torque),
        "follow": None if follow is None else str(follow),
        "gains": list(GAINS) if follow is not None else None,
        "stop_at_limits": stop_at_limits,
        "notes": list(notes),
    }
    inputs += [] if estimate is None else [estimate_file(estimate)]
    inputs += [Path(path) for path in (torque, follow) if path is not None]
    return FileSimulation(model, result, tuple(dict.fromkeys(inputs)), whose, options, notes)


def _elastic(model: Model, estimate: str | Path) -> ElasticModel | None:
    """Return the model with the elastic joints of an estimate, which must be able to move."""
    loaded = matching_estimate(model, estimate)
    if not loaded.elastic_model:
        return None
    from .elastic.elastic_model import elastic_model_of  # loaded for elastic joints alone

    found = elastic_model_of(model, loaded, str(estimate))
    if found is not None and found.without_inertia:
        raise InputError(
            f"{estimate}: holds no inertia of the motor of {', '.join(found.without_inertia)}, without which elastic "
            "joints cannot be simulated; state motor_inertia in [elastic] and identify the robot anew."
        )
    return found


def _with_motors(model: Model, values: Array) -> Array:
    """Values (N,) of the joints, for links and motors alike, (N + J,)."""
    found = np.concatenate([values, np.zeros(model.dof - len(values))])
    found[motor_coordinates(model)] = values
    return found


def _notes_on_motors(elastic: ElasticModel) -> tuple[str, ...]:
    """Say which coordinates are those of motors, and which joints are elastic."""
    robot, count = elastic.model.robot, len(elastic.joints)
    first = robot.dof - count + 1
    which = f"{first}" if count == 1 else f"{first} to {robot.dof}"
    plural = "" if count == 1 else "s"
    found = [
        f"joint{plural} {', '.join(elastic.joints)} bend{'s' if count == 1 else ''} as identified: coordinate{plural} "
        f"{which} of the results {'is' if count == 1 else 'are'} the motor{plural}, on the joint side of the gear",
        "torques act at motors, which is also what a controller sees; transmissions begin bent by what they hold at "
        "rest",
    ]
    if elastic.verdict.parameters is None:
        found.append("these parameters are not proved to be physically possible together")
    return tuple(found)


def _notes_on_following(result: SimulationResult, trajectory: Trajectory, units: Sequence[str]) -> tuple[str, ...]:
    """Say how far joints come off the trajectory, the farthest one first."""
    wanted = trajectory.motion(np.minimum(result.t, trajectory.duration))[0]
    off = np.abs(result.q[:, : trajectory.dof] - wanted).max(axis=0)
    lost = off > _FOLLOWED * np.maximum(np.ptp(wanted, axis=0), _SMALL_RANGE)
    names = result.joint_names
    told = [f"{names[k]} by {off[k]:.3g} {units[k]}" for k in np.argsort(-off) if lost[k] or k == np.argmax(off)]
    if not lost.any():
        return (f"the robot comes off the trajectory by up to {off.max():.3g} {units[int(np.argmax(off))]}",)
    return (
        f"this is not the motion of the trajectory, off which come {listed(told)}: the controller does not hold joints "
        "of much friction and little inertia",
    )


def _notes_on_drives(torque: Array, robot: Robot) -> tuple[str, ...]:
    """Say which joints take more torque (S, N) than the description allows, for a simulated drive gives any."""
    most, allowed = np.fmax.reduce(np.abs(torque), axis=0), described_limits(robot)["torque"]
    beyond = [
        f"{name} takes {most[k]:.4g} of {allowed[k]:.4g} N·m or N"
        for k, name in enumerate(robot.joint_names)
        if most[k] > _PASSED * allowed[k]
    ]
    if not beyond:
        return ()
    return (f"drives have no limits here, and the efforts of the description are passed: {listed(beyond)}",)


def _parameters(model: Model, estimate: str | Path | None) -> tuple[Array, bool, str]:
    """Return parameters, whether they are base parameters, and whose they are."""
    if estimate is None:
        open_terms = model.terms_left_open
        zeros = f", with 0 for the terms that it does not state: {open_terms}" if open_terms else ""
        return parameters_of_description(model), False, f"the description (CAD){zeros}"
    loaded: Estimate = matching_estimate(model, estimate)
    if loaded.parameters is not None:
        return loaded.parameters, False, f"{estimate} ({loaded.method})"
    return loaded.base, True, f"{estimate} ({loaded.method}), base parameters"


class TorqueTable:
    """Torques of a file, as a controller: each row holds until the next.

    Parameters
    ----------
    t : ndarray
        (S,) s, in equal steps from zero.
    torque : ndarray
        (S, N).
    rate : float, optional
        Hz, of the samples that are wanted.

    Attributes
    ----------
    sample_time : float
        s, at which the controller is called: that of the rows, or a whole part of it, of at most 1 ms.
    duration : float
        s.

    Raises
    ------
    InputError
        If the rate is neither a multiple of that of the rows nor a whole part of it.
    """

    def __init__(self, t: Array, torque: Array, rate: float | None = None) -> None:
        self._start, self._torque = float(t[0]), torque
        self._row = float(t[-1] - t[0]) / (len(t) - 1)
        self.duration = self._row * (len(t) - 1)
        parts = max(1, math.ceil(self._row * LEAST_RATE - 1e-6))
        if rate is not None and np.isfinite(rate) and rate > 0.0:
            samples = rate * self._row  # in a row
            whole = round(max(samples, 1.0 / samples))
            if abs(max(samples, 1.0 / samples) - whole) > 1e-3 * whole:
                raise InputError(
                    f"--rate must be that of the torques, {1.0 / self._row:.6g} Hz, times or divided by a whole "
                    f"number, got {rate:.6g} Hz."
                )
            if samples > 1.0:
                parts = whole * math.ceil(parts / whole)
        self.sample_time = self._row / parts

    def notes(self, duration: float) -> tuple[str, ...]:
        """Say what is made of the table in a simulation of a duration, s."""
        found = [f"each row's torques are held until the next, for {self._row:.6g} s; they are not interpolated"]
        if abs(self._start) > 1e-3 * self._row:
            found.append(f"the table's first time, {self._start:.6g} s, is 0 s of the simulation")
        if duration > self.duration * (1.0 + 1e-9):
            found.append(f"the table ends after {self.duration:.6g} s; the torques of its last row are held from there")
        return tuple(found)

    @classmethod
    def read(cls, path: str | Path, count: int, rate: float | None = None) -> TorqueTable:
        """Read a CSV or Parquet file with columns t and tau1 to tauN."""
        import polars

        source = Path(path)
        if source.suffix not in (".csv", ".parquet"):
            raise InputError(f"{source}: torques are read from .csv or .parquet, got {source.suffix or 'no suffix'!r}.")
        frame = read_table(source, "give a table with t and tau1, tau2, …")
        names = ["t", *(f"tau{k + 1}" for k in range(count))]
        missing = [name for name in names if name not in frame.columns]
        if missing:
            raise InputError(f"{source}: has no column {missing[0]!r}; needed are {listed(names)}.")
        with reading_table(source, "numbers"):
            table = frame.select(polars.col(names).cast(polars.Float64)).to_numpy()
        if len(table) < 2 or not np.isfinite(table).all():
            raise InputError(f"{source}: needs two rows of finite numbers at least; some are missing.")
        steps = np.diff(table[:, 0])
        if not (steps > 0.0).all() or np.ptp(steps) > 0.01 * steps.mean():
            raise InputError(
                f"{source}: its times must increase in equal steps, found {steps.min():.6g} to {steps.max():.6g} s."
            )
        return cls(table[:, 0], table[:, 1:], rate)

    def start(self, measurement: Measurement) -> None:
        """Do nothing: the table has no state."""

    def torque(self, measurement: Measurement) -> Array:
        """Return the torques of the row at this time; the last row holds from its time on."""
        row: Array = self._torque[min(math.floor(measurement.t / self._row + 1e-6), len(self._torque) - 1)]
        return row
