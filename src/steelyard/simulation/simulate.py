"""Simulation: forward dynamics in time (thesis section 5.1), with the loop of sensing, commanding and integrating."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.functions import given_parameters
from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.files import listed, tell
from steelyard.files.arguments import positive, read_whole, real_array

from .actuators import Actuators
from .bristle_friction import BristleFriction
from .compiled import motion_functions
from .contact import Contact, Environment
from .controller import Controller, Measurement, checked_torque
from .events import Event, Status
from .integrators import FIXED_STEP_METHODS, LIBRARY_METHODS, DormandPrince, FixedStep, Integrator, LibraryMethod
from .plant import Plant, TorqueFunction
from .sensors import SensorReadings, Sensors
from .simulation_result import IMPOSSIBLE, Measured, SimulationResult
from .stopping_conditions import StoppingConditions
from .watch import Watch

__all__ = ["METHODS", "Experiment", "Request", "first_impossible", "least_inertia", "simulate"]

Array = NDArray[np.float64]

# Inertia matrices whose eigenvalues are computed after a simulation, over all runs, but at least eight of each run. An
# eigenvalue decomposition takes longer than a step of a batch, so that not every sample is checked.
MOST = 400
_LARGEST = 1e8  # samples of all joints and runs, which would take 6 GB
_TOLD = 100  # steps after which it is told how far the simulation has come


def simulate(
    model: Model,
    parameters: ArrayLike,
    q0: ArrayLike,
    dq0: ArrayLike,
    duration: float,
    torque: TorqueFunction | Controller | None = None,
    *,
    base: bool = False,
    method: str = "automatic",
    relative_tolerance: float = 1e-8,
    absolute_tolerance: float = 1e-10,
    step: float | None = None,
    sign_width: float = 1e-3,
    events: Sequence[Event] | Event = (),
    sample_time: float | None = None,
    sensors: Sensors | None = None,
    actuators: Actuators | None = None,
    environment: Environment | None = None,
    stopping_conditions: StoppingConditions | None = None,
    rate: float | None = None,
    seed: int = 0,
) -> SimulationResult:
    """Simulate a robot, or many at once: the motion that torques, gravity, friction and contact cause.

    A run that cannot be continued ends with a status and the time, not with an exception, and does not stop the others
    of its batch.

    Parameters
    ----------
    model : Model
        A term that needs a channel of a log, such as a temperature, acts as at its reference. The bristles of friction
        with presliding are not bent at the start, and follow the motion, which is integrated with the method
        ``"runge_kutta_4"`` then; what they hold counts as potential energy.
    parameters : array_like
        (n,), or (n_b,) with `base`; (R, n) for runs of different robots.
    q0, dq0 : array_like
        (N,) at the start, rad or m and per s; (R, N) for R runs.
    duration : float
        s.
    torque : callable, Controller or None
        None: the motors are off. A function of t, q and dq that returns torques (N,), N·m or N, is evaluated within
        every step; in a batch t is (R, 1), and q, dq and the torques are (R, N). A :class:`Controller` is called once
        each sample time, and its torques are held.
    base : bool
        Whether `parameters` are base parameters.
    method : str
        ``"dormand_prince"`` (adaptive, order 5, all the runs of a batch at once), ``"dop853"`` (adaptive, order 8),
        ``"radau"``, ``"bdf"``, ``"lsoda"`` (adaptive, for stiff friction), ``"runge_kutta_4"`` and ``"rosenbrock"``
        (fixed steps, the latter for tight friction in control loops), or ``"automatic"``.
    relative_tolerance, absolute_tolerance : float
        Tolerances of the local error of the adaptive methods.
    step : float, optional
        Largest step of the fixed-step methods, s; by default 1 ms for ``"runge_kutta_4"`` and 0.25 ms for
        ``"rosenbrock"``.
    sign_width : float
        Velocity w of the smooth sign, rad/s or m/s: Coulomb friction is ``Fc v / sqrt(v² + w²)``. 0 for the exact sign,
        with which joints that stick chatter.
    events : Event or sequence of Event
        Zero crossings that are located, and that may end a run.
    sample_time : float, optional
        With a sample time (s) a torque *function* is called only once each sample time, and its torques are held.
    sensors : Sensors, optional
        The sensors that the controller and the recording see; exact by default.
    actuators : Actuators, optional
        The drives between the controller and the joints; ideal by default.
    environment : Environment, optional
        An environment that the robot touches, such as :class:`ElasticContact`.
    stopping_conditions : StoppingConditions, optional
        Ends a run that leaves its limits.
    rate : float, optional
        Rate of the samples that are returned, Hz; by default the control rate where there is one, otherwise 1000 Hz.
    seed : int
        Seed of the noise of the sensors.

    Raises
    ------
    InputError
        If an argument does not fit; never for what happens in the simulation.

    References
    ----------
    Sousa 2014, section 5.1; Dormand and Prince 1980; Verwer, Spee, Blom and Hundsdorfer 1999.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> point_mass = np.zeros(10)
    >>> point_mass[9] = 2.0
    >>> fall = simulate(model, point_mass, q0=[0.0], dq0=[0.0], duration=1.0)
    >>> fall.status.value, bool(np.ptp(fall.energy) < 1e-5)
    ('finished', True)
    """
    positive(relative_tolerance, "relative_tolerance", "1")
    positive(absolute_tolerance, "absolute_tolerance", "rad")
    read_whole(seed, "seed")
    request = Request(
        model,
        parameters,
        q0,
        dq0,
        duration,
        torque,
        base,
        method,
        sign_width,
        step,
        events,
        sample_time,
        sensors,
        actuators,
        environment,
        stopping_conditions,
        rate,
    )
    options: dict[str, Any] = {
        **request.summary(),
        "relative_tolerance": relative_tolerance,
        "absolute_tolerance": absolute_tolerance,
        "seed": seed,
    }
    # A run that diverges passes through infinity: its status says so, not a warning.
    with one_thread(), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return Experiment(request, relative_tolerance, absolute_tolerance, seed, options).result()


class Experiment:
    """Runs a simulation and assembles its result.

    Parameters
    ----------
    relative, absolute : float
        Relative and absolute tolerance of the adaptive methods.
    seed : int
        Seed of the sensors.
    options : dict
        Options that are stored in the result.
    """

    def __init__(self, request: Request, relative: float, absolute: float, seed: int, options: dict[str, Any]) -> None:
        self.request, self.options, self.seed = request, options, seed
        self.runs, self.count = request.runs, request.model.dof
        functions = motion_functions(
            request.model, base=request.base, smooth=request.sign_width > 0.0, each=request.each
        )
        held = request.sample_time is not None or request.function is None
        self.plant = Plant(
            functions,
            request.parameters,
            request.sign_width,
            self.runs,
            None if held else request.function,
            request.contact,
            request.bristles,
        )
        adaptive = request.method not in FIXED_STEP_METHODS
        self.watch = Watch(
            self.plant,
            request.state,
            request.events,
            request.duration,
            passive=request.torque is None and request.contact is None,
            times=None if request.is_ticked else request.times,
            dense=adaptive and not request.is_batch,
        )
        self.integrator = self._integrator(relative, absolute)
        self.states = np.full((self.runs, len(request.times), 2 * self.count), np.nan)
        self.torques = np.full((self.runs, len(request.times), self.count), np.nan)
        self.bent = None if request.bristles is None else np.full_like(self.torques, np.nan)
        sensors = request.sensors
        self.readings = None if sensors is None else sensors.start(self.runs, self.count, seed)
        self.seen = None if self.readings is None else _Log(self.readings, self.torques.shape)

    def _integrator(self, relative: float, absolute: float) -> Integrator:
        request, common = self.request, (self.plant, self.watch, self.request.state)
        if request.method in FIXED_STEP_METHODS:
            return FixedStep(*common, request.method, request.largest_step)
        if request.method == "dormand_prince":
            return DormandPrince(*common, relative, absolute)
        return LibraryMethod(*common, request.method, relative, absolute)

    def result(self) -> SimulationResult:
        """Run the simulation and return its result."""
        if self.request.is_ticked:
            self._by_ticks()
        else:
            self.watch.begin()
            if not self.watch.all_ended:
                self.integrator.advance(0.0, self.request.duration)
            assert self.watch.samples is not None
            self.states = self.watch.samples
        if self.request.sample_time is None:
            self._torques_afterwards()
        return self._assembled()

    def _by_ticks(self) -> None:
        """Sense, command and integrate, tick by tick."""
        request, plant, watch, integrator, n = self.request, self.plant, self.watch, self.integrator, self.count
        ticks, commanded = request.ticks.tolist(), request.sample_time is not None
        controller = request.controller
        drives = None if request.actuators is None else request.actuators.start(self.runs, n)
        check = None
        if request.stopping_conditions is not None:
            names = tuple(request.model.robot.joint_names)
            check = request.stopping_conditions.start(len(ticks), names, 0.0, request.tick)
        last = len(ticks) - 1
        for k, t in enumerate(ticks):
            state = integrator.state
            if k % _TOLD == 0:
                tell("simulating", t, ticks[-1], "s")
            if commanded:
                measurement = self._measurement(t, state)
                if k == 0 and controller is not None:
                    controller.start(measurement)
                command = self._command(t, measurement, state)
                plant.held[...] = command if drives is None else drives.apply(command, request.tick)
            if k % request.every == 0:
                self._record(k // request.every, t, state)
            elif commanded and self.readings is not None:
                self.readings.torque(t, plant.held)
            if k == 0:
                watch.begin()
            if check is not None:
                for run, reason in check.reason(k, state[:, :n], state[:, n:]).items():
                    watch.end(run, Status.STOPPED, t, f"stopped at {t:.6g} s: {reason}", state[run])
            if k == last or watch.all_ended:
                return
            integrator.advance(t, ticks[k + 1])

    def _measurement(self, t: float, state: Array) -> Measurement:
        """Return the measurement for the controller, (N,) for one run or (R, N) for a batch."""
        n, contact = self.count, self.plant.contact
        q, dq = state[:, :n], state[:, n:]
        force = None if contact is None else contact.state(t, q, dq)[1]
        if self.readings is not None:
            seen = self.readings.measure(t, q, dq, force)
            q, dq, torque, force = seen.q, seen.dq, seen.torque, seen.force  # type: ignore[assignment]
        else:
            q, dq = q.copy(), dq.copy()
            torque = self.plant.held.copy()
        if self.request.is_batch:
            return Measurement(t, q, dq, torque, force)
        one = (None if x is None else x[0] for x in (dq, torque, force))
        return Measurement(t, q[0], *one)

    def _command(self, t: float, measurement: Measurement, state: Array) -> Array:
        if self.request.controller is None:
            assert self.request.function is not None
            return self.plant.called(self.request.function, t, state)
        shape = (self.runs, self.count) if self.request.is_batch else (self.count,)
        torque = checked_torque(self.request.controller.torque(measurement), shape)
        torque = torque if self.request.is_batch else torque[np.newaxis]
        self.plant.notice(t, state, torque)
        return torque

    def _record(self, row: int, t: float, state: Array) -> None:
        ended = self.watch.ended
        if self.bent is not None and self.request.bristles is not None:
            self.bent[~ended, row] = self.request.bristles.states[~ended]
        if not self.watch.some_ended:
            self.states[:, row] = state
            self.torques[:, row] = self.plant.held
        else:
            self.states[~ended, row] = state[~ended]
            self.torques[~ended, row] = self.plant.held[~ended]
        if self.seen is not None and self.request.sample_time is not None:
            self.seen.record(row, t, self.plant.held)

    def _torques_afterwards(self) -> None:
        """Compute torques of a function and readings of the sensors at the samples, after the integration."""
        request, n = self.request, self.count
        for row, t in enumerate(request.times.tolist()):
            state = self.states[:, row]
            known = np.isfinite(state).all(axis=1)
            if not known.any():
                return
            if request.function is None:
                self.torques[known, row] = 0.0
            else:
                self.torques[known, row] = self.plant.called(request.function, t, state)[known]
            if self.seen is not None and self.readings is not None:
                contact = self.plant.contact
                q, dq = np.ascontiguousarray(state[:, :n]), np.ascontiguousarray(state[:, n:])
                force = None if contact is None else contact.state(t, q, dq)[1]
                self.readings.measure(t, q, dq, force)
                self.seen.record(row, t, self.torques[:, row])

    def _assembled(self) -> SimulationResult:
        """Compute accelerations and energies at the samples, and assemble the result."""
        request, watch, n = self.request, self.watch, self.count
        shape = self.states.shape[:2]
        accelerations, energies = np.full((*shape, n), np.nan), np.full((*shape, 3), np.nan)
        forces = None if request.contact is None else np.full((*shape, 6), np.nan)
        for run in range(self.runs):
            known = np.isfinite(self.states[run]).all(axis=1)
            state, torque = self.states[run, known], self.torques[run, known]
            if request.contact is not None and forces is not None and len(state):
                times = request.times[known][:, np.newaxis]
                jacobian, wrench = request.contact.state(times, state[:, :n], state[:, n:])
                forces[run, known] = wrench
                torque = torque + (wrench[:, np.newaxis] @ jacobian)[:, 0]
            if self.bent is not None and request.bristles is not None:
                bent, rows = self.bent[run, known], np.full(len(state), run)
                torque = torque - request.bristles.torques(bent, state[:, n:], rows)
            if len(state):
                accelerations[run, known], energies[run, known] = self.plant.along(run, state, torque)
            if self.bent is not None and request.bristles is not None:
                stored, lost = request.bristles.energies(bent, state[:, n:], rows)
                energies[run, known, 1] += stored
                energies[run, known, 2] += lost
        power = energies[..., 2]
        gaps = np.diff(request.times) * 0.5 * (power[:, 1:] + power[:, :-1])
        dissipated = np.concatenate([0.0 * power[:, :1], np.cumsum(gaps, axis=1)], axis=1)
        watch.end_time[~watch.ended] = request.duration
        final = np.where(watch.ended[:, np.newaxis], watch.final, self.integrator.state)
        seen = None if self.seen is None else self.seen.measured(np.isfinite(self.states).all(axis=2))
        for run in range(self.runs):
            watch.message[run] += self._impossible(run)
        arrays = {
            "q": self.states[..., :n],
            "dq": self.states[..., n:],
            "ddq": accelerations,
            "torque": self.torques,
            "kinetic_energy": energies[..., 0],
            "potential_energy": energies[..., 1],
            "dissipated": dissipated,
        }
        whole = SimulationResult(
            t=request.times,
            status=tuple(watch.status),
            end_time=watch.end_time,
            message=tuple(watch.message),
            final_q=final[:, :n],
            final_dq=final[:, n:],
            joint_names=tuple(request.model.robot.joint_names),
            method=request.method,
            events=tuple(sorted(watch.occurrences, key=lambda o: (o.t, o.run))),
            measured=seen,
            force=forces,
            options=self.options,
            pieces=tuple(watch.pieces or ()),
            **arrays,
        )
        return whole if request.is_batch else whole.run(0)

    def _impossible(self, run: int) -> str:
        """Return a remark where the inertia matrix of a run was not positive definite, at its divergence or before."""
        cause = f"{IMPOSSIBLE}, which steelyard check (steelyard.check) explains"
        if self.watch.status[run] is Status.DIVERGED:
            least = float(least_inertia(self.plant, run, self.watch.final[[run], : self.count])[0])
            if least <= 0.0:
                return f"; the inertia matrix has the eigenvalue {least:.3g} there: {cause}"
        q = self.states[run, :, : self.count]
        known = np.flatnonzero(np.isfinite(q).all(axis=1))
        found = first_impossible(self.plant, run, q[known]) if known.size else None
        if found is None:
            return ""
        t = self.request.times[known[found[0]]]
        text = f"the inertia matrix is not positive definite at {t:.6g} s (eigenvalue {found[1]:.3g})"
        return f"{'; ' if self.watch.message[run] else ''}{text}: {cause}"


class _Log:
    """The readings of the sensors at the samples."""

    def __init__(self, readings: SensorReadings, shape: tuple[int, ...]) -> None:
        self._readings = readings
        self.q, self.dq, self.torque = (np.full(shape, np.nan) for _ in range(3))
        self.force = np.full((*shape[:2], 6), np.nan)
        self._has = [False, False]

    def record(self, row: int, t: float, applied: Array) -> None:
        self.torque[:, row] = self._readings.torque(t, applied)
        last = self._readings.last
        self.q[:, row] = last.q
        if last.dq is not None:
            self.dq[:, row] = last.dq
            self._has[0] = True
        if last.force is not None:
            self.force[:, row] = last.force
            self._has[1] = True

    def measured(self, known: NDArray[np.bool_]) -> Measured:
        """Return the readings, with NaN after the ends of the runs."""
        for array in (self.q, self.dq, self.torque, self.force):
            array[~known] = np.nan
        return Measured(self.q, self.torque, self.dq if self._has[0] else None, self.force if self._has[1] else None)


def least_inertia(plant: Plant, run: int, q: Array) -> Array:
    """Return the least eigenvalues (m,) of a run's total inertia matrices at q (m, N); NaN where not finite."""
    functions, n = plant.functions, plant.count
    parameters = plant.parameters[run] if functions.each else plant.parameters
    kernel = functions.model.kernel("total_inertia_matrix", base=functions.base)
    matrices = kernel(np.ascontiguousarray(q), parameters).reshape(-1, n, n)
    finite = np.isfinite(matrices).all(axis=(1, 2))
    least = np.full(len(q), np.nan)
    least[finite] = np.linalg.eigvalsh(matrices[finite])[:, 0]
    return least


def first_impossible(plant: Plant, run: int, q: Array) -> tuple[int, float] | None:
    """Find the first of a run's positions (S, N) at which its inertia matrix is not positive definite.

    Parameters
    ----------
    q : ndarray
        (S, N) positions of the samples. The first and some evenly spread ones are checked; where one of them has no
        positive definite matrix, all samples between it and the one before are checked.

    Returns
    -------
    (int, float) or None
        Index of the sample, and the least eigenvalue at it.
    """
    some = np.unique(np.linspace(0, len(q) - 1, min(len(q), max(8, MOST // plant.runs))).round().astype(np.intp))
    found = np.flatnonzero(least_inertia(plant, run, q[some]) <= 0.0)
    if not found.size:
        return None
    place = int(found[0])
    begin, end = (0 if place == 0 else int(some[place - 1]) + 1), int(some[place]) + 1
    least = least_inertia(plant, run, q[begin:end])
    first = int(np.flatnonzero(least <= 0.0)[0])
    return begin + first, float(least[first])


METHODS = ("automatic", "dormand_prince", *LIBRARY_METHODS, *FIXED_STEP_METHODS)
DEFAULT_RATE = 1000.0  # Hz, of the output samples
# Largest steps, s. With 0.25 ms `rosenbrock` is within 5e-6 rad of Radau in a loop at 1 kHz with the friction of a WAM
# (sign width 1e-4 rad/s), at 0.25 s of computing for 10 s; with 1 ms it is within 7e-5 rad.
DEFAULT_STEP = {"runge_kutta_4": 1e-3, "rosenbrock": 2.5e-4}


@dataclass
class Request:
    """The arguments of :func:`steelyard.simulate`, checked and converted.

    Parameters
    ----------
    model, parameters, q0, dq0, duration, torque, base, method, sign_width, step, events, sample_time, sensors, \
actuators, environment, stopping_conditions, rate
        See :func:`steelyard.simulate`.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    model: Model
    parameters: Any
    q0: Any
    dq0: Any
    duration: float
    torque: Any
    base: bool
    method: str
    sign_width: float
    step: float | None
    events: Any
    sample_time: float | None
    sensors: Sensors | None
    actuators: Actuators | None
    environment: Environment | None
    stopping_conditions: StoppingConditions | None
    rate: float | None

    def __post_init__(self) -> None:
        self.duration = positive(self.duration, "duration", "s")
        self._arrays()
        self._bristles()
        self._torque()
        self._classes()
        if isinstance(self.sign_width, bool) or not (np.isfinite(self.sign_width) and self.sign_width >= 0.0):
            raise InputError(f"sign_width must be at least 0 rad/s (0: the exact sign), got {self.sign_width!r}.")
        if self.method not in METHODS:
            raise InputError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}.")
        if self.method == "automatic":
            self.method = self._best_method()
        if self.step is not None:
            positive(self.step, "step", "s")
            if self.method not in FIXED_STEP_METHODS:
                raise InputError(
                    f"step is for the fixed-step methods ({', '.join(FIXED_STEP_METHODS)}); {self.method} chooses its "
                    "own by relative_tolerance and absolute_tolerance."
                )
        self._rates()

    def _arrays(self) -> None:
        n = self.model.dof
        arrays = {
            name: real_array(value, name, "an array of numbers") for name, value in (("q0", self.q0), ("dq0", self.dq0))
        }
        arrays["parameters"] = np.array(given_parameters(self.model, self.parameters, base=self.base))
        size = self.model.base_parameters().count if self.base else self.model.parameter_count
        kind = "base parameters" if self.base else "parameters"
        for name, width, what in (("q0", n, "joints"), ("dq0", n, "joints"), ("parameters", size, kind)):
            shape = arrays[name].shape
            if len(shape) not in (1, 2) or shape[-1] != width:
                raise InputError(
                    f"{self.model.robot.name} has {width} {what}: {name} must have shape ({width},), or (R, {width}) "
                    f"for R runs, got {shape}."
                )
        self._refuse_unknown(arrays)
        sizes = {len(a) for a in arrays.values() if a.ndim == 2}
        if len(sizes) > 1:
            shapes = ", ".join(f"{name} {a.shape}" for name, a in arrays.items())
            raise InputError(f"q0, dq0 and parameters must agree on the number of runs, got {shapes}.")
        self.is_batch = bool(sizes)
        self.runs = sizes.pop() if sizes else 1
        if self.runs == 0:
            raise InputError("A batch needs one run at least, got none.")
        self.each = arrays["parameters"].ndim == 2
        self.parameters = arrays["parameters"]
        self.state = np.concatenate([np.broadcast_to(arrays[name], (self.runs, n)) for name in ("q0", "dq0")], axis=1)

    def _bristles(self) -> None:
        """Take friction that remembers the motion out of the model, to be integrated with it."""
        self.bristles: BristleFriction | None = None
        whole, self.model = self.model, self.model.without_channels
        if not whole.remembers:
            self.parameters = whole.parameters_without_channels(self.parameters, self.base)
            return
        if self.method not in ("automatic", "runge_kutta_4"):
            raise InputError(
                f"{whole.robot.name} has friction that remembers the motion, which is simulated with the method "
                f"'runge_kutta_4' alone, got {self.method!r}; leave out the method."
            )
        self.method = "runge_kutta_4"
        if self.base:
            self.parameters, self.base = self.parameters @ whole.base_parameters().Pb.T, False
        self.bristles = BristleFriction(whole, self.parameters, self.state)
        self.parameters = whole.parameters_without_channels(np.where(self.bristles.places, 0.0, self.parameters))
        if self.step is None:
            given = np.broadcast_to(self.parameters, (self.runs, self.parameters.shape[-1]))
            pairs = zip(self.state[:, : whole.dof], given, strict=True)
            inertias = np.array([self.model.total_inertia_matrix(*one) for one in pairs])
            self.step = min(DEFAULT_STEP["runge_kutta_4"], self.bristles.longest_step(inertias))

    def _refuse_unknown(self, arrays: dict[str, Array]) -> None:
        for name, array in arrays.items():
            if np.isfinite(array).all():
                continue
            if name == "parameters" and not self.base:
                unknown = np.flatnonzero(~np.isfinite(np.atleast_2d(array)).all(axis=0))
                names = [self.model.parameter_names[k] for k in unknown]
                raise InputError(
                    f"The parameters {listed(names, 6)} of {self.model.robot.name} are not finite numbers; "
                    "give an estimate, or values for what the description leaves out."
                )
            raise InputError(
                f"{name} must be finite, got {array.tolist() if array.size < 20 else 'values that are not'}."
            )

    def _torque(self) -> None:
        torque = self.torque
        self.controller: Controller | None = None
        self.function: Callable[..., Any] | None = None
        if self.sample_time is not None:
            positive(self.sample_time, "sample_time", "s")
        if torque is None:
            if self.sample_time is not None:
                raise InputError("sample_time is for a torque; without one (motors off) leave it out, or give rate.")
        elif isinstance(torque, Controller):
            own = positive(torque.sample_time, f"sample time of {type(torque).__name__}", "s")
            if self.sample_time not in (None, own):
                raise InputError(
                    f"{type(torque).__name__} works at a sample time of {own:.6g} s, but sample_time is "
                    f"{self.sample_time:.6g}; leave it out."
                )
            self.controller, self.sample_time = torque, own
        elif callable(torque):
            self.function = torque
        else:
            raise InputError(
                "torque must be None (motors off), a function of t, q and dq, or a controller with sample_time, start "
                f"and torque, got {type(torque).__name__}."
            )
        if self.actuators is not None and self.sample_time is None:
            raise InputError(
                "actuators act on torques that are held; give a controller, or a sample_time for the function."
            )

    def _classes(self) -> None:
        for value, kind, name in (
            (self.sensors, Sensors, "sensors"),
            (self.actuators, Actuators, "actuators"),
            (self.stopping_conditions, StoppingConditions, "stopping_conditions"),
        ):
            if value is not None and not isinstance(value, kind):
                raise InputError(f"{name} must be a {kind.__name__} object, got {type(value).__name__}.")
        events = (self.events,) if isinstance(self.events, Event) else tuple(self.events)
        for event in events:
            if not isinstance(event, Event):
                raise InputError(f"events must be Event objects, got {type(event).__name__}; wrap a function in Event.")
        self.events: Sequence[Event] = events
        self.contact = None if self.environment is None else Contact(self.model, self.environment)

    def _best_method(self) -> str:
        """Choose a method; docs/how-to/simulate.md has the measurements behind the choice."""
        if not self._has_coulomb_friction():
            return "runge_kutta_4" if self.sample_time is not None else "dormand_prince"
        # Adaptive methods find no step across the jump of an exact sign.
        return "rosenbrock" if self.sample_time is not None or self.is_batch or not self.sign_width else "radau"

    def _has_coulomb_friction(self) -> bool:
        """Return whether there is Coulomb friction: torques that jump where a velocity changes its sign."""
        n, rows = self.model.dof, np.atleast_2d(self.parameters)
        kernel = self.model.kernel("drive_torque", base=self.base)
        # Velocities so small that viscous friction is far below 1e-9 N·m, and different for each joint, so that jumps
        # of coupled joints do not cancel.
        slow, still = 1e-12 * (1.0 + np.arange(n) / 7.0), np.zeros(n)
        jumps = [kernel.sample(still, slow, still, p) - kernel.sample(still, -slow, still, p) for p in rows]
        return bool(np.abs(jumps).max(initial=0.0) > 1e-9)

    def _rates(self) -> None:
        """Choose the ticks, at which torques are set and stopping conditions checked, and the samples among them."""
        if self.rate is not None:
            positive(self.rate, "rate", "Hz")
        self.is_ticked = (
            self.sample_time is not None or self.stopping_conditions is not None or self.method in FIXED_STEP_METHODS
        )
        if self.sample_time is None:
            self.tick = 1.0 / (DEFAULT_RATE if self.rate is None else self.rate)
            self.every = 1
        else:
            self.tick = self.sample_time
            ratio = 1.0 if self.rate is None else 1.0 / (self.rate * self.sample_time)
            self.every = round(ratio)
            if self.every < 1 or abs(ratio - self.every) > 1e-6 * ratio:
                raise InputError(
                    f"rate must be the control rate {1.0 / self.sample_time:.6g} Hz divided by a whole number, "
                    f"got {self.rate:.6g} Hz."
                )
        ticks = self.duration / self.tick
        if ticks * max(1.0, self.runs * self.model.dof / self.every) > _LARGEST:
            raise InputError(
                f"{self.duration:g} s at {1.0 / (self.tick * self.every):g} Hz are too many samples for the memory, of "
                f"{self.runs} runs of {self.model.dof} joints; give a shorter duration, a lower rate, or fewer runs."
            )
        count = int(np.ceil(self.duration / self.tick - 1e-9))
        self.ticks = np.minimum(np.arange(count + 1) * self.tick, self.duration)
        if self.ticks[-1] - self.ticks[-2] < 1e-6 * self.tick:
            self.ticks = np.append(self.ticks[:-2], self.duration)
        self.times = self.ticks[:: self.every]
        self.largest_step = DEFAULT_STEP.get(self.method, 0.0) if self.step is None else self.step

    def summary(self) -> dict[str, ArrayLike | str | None]:
        """Return the options in plain numbers and texts."""
        return {
            "duration": self.duration,
            "method": self.method,
            "base": self.base,
            "sign_width": self.sign_width,
            "step": self.largest_step if self.method in FIXED_STEP_METHODS else None,
            "sample_time": self.sample_time,
            "rate": 1.0 / (self.tick * self.every),
            "runs": self.runs if self.is_batch else None,
            "torque": "none" if self.torque is None else type(self.torque).__name__,
        }
