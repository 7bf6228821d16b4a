"""The motion that a robot makes under its controller, by its parameters: what instruments and output errors need."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError, SolverError
from steelyard.files.arguments import per_joint, positive, read_whole
from steelyard.recording import Recording, Samples
from steelyard.simulation import Controller, Measurement, SimulationResult, Status, simulate

__all__ = ["ClosedLoop", "without_standstill"]

Array = NDArray[np.float64]

SIGN_WIDTH = 1e-4
"""rad/s or m/s. With 1e-3, joints creep where they should stick: the output error of positions of a log without noise
was then off by 0.8 standard errors of one with 0.1 mrad, and by 0.2 with 1e-4, in the same time."""

READINGS = 32
"""Simulations over which `expected` averages: each draw of the noise with its negative, so that what the loop makes of
it linearly cancels, and 16 draws of what friction makes of it. A batch of 32 takes twice as long as a single run."""


class ClosedLoop:
    """The motion of a robot under its controller, by base parameters, at the times of measured samples.

    Without noise of the sensors: so the motion depends on the noise of a log through the parameters alone. Call it with
    base parameters (n_b,).

    Parameters
    ----------
    model : Model
    controller : Controller
        As the robot has it, with the reference that it followed: an object of :mod:`steelyard.control` or of your own.
    times : array_like
        (S,), s since the controller began; multiples of its sample time.
    start : array_like
        (N,) positions at time 0, rad or m, from rest; those of the reference at 0 s where it began there.
    start_velocity : array_like, optional
        (N,), rad/s or m/s.
    velocity_threshold : float or (N,)
        Rows of a joint in which its simulated velocity is below this are left out, rad/s or m/s: near standstill
        friction is no jump, and noise hides its sign.
    process : callable, optional
        From the `Recording` of the simulated motion to its samples: what was done to the log, such as
        ``lambda recording: recording.process(cutoff=80.0)``. What a filter takes away, or a difference quotient, it
        then takes from both alike. By default the motion as it is.
    position_noise : float or (N,)
        Standard deviation of the white noise of the positions that the controller reads, rad or m. The controller turns
        it into torques, which shake friction where a joint turns around, so that the mean of many noisy motions is not
        the motion without noise: `expected` is that mean.
    seed : int
        Of that noise.
    sign_width : float
        See :func:`steelyard.simulate`; as a rule smaller than there, since joints that creep where they should stick
        bias output errors.
    method : str
        See :func:`steelyard.simulate`.

    Examples
    --------
    >>> import steelyard as sy
    >>> from steelyard.control import JointFeedback
    >>> model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)))
    >>> wave = lambda t: ([np.sin(t)], [np.cos(t)], [-np.sin(t)])
    >>> controller = JointFeedback(wave, kp=400.0, kd=40.0, count=1)
    >>> loop = ClosedLoop(model, controller, np.arange(0.0, 2.0, 0.01), [0.0], [1.0])
    >>> motion = loop([0.5])
    >>> bool(np.abs(motion.q[:, 0] - np.sin(motion.t)).max() < 2e-3)
    True
    """

    def __init__(
        self,
        model: Model,
        controller: Controller,
        times: ArrayLike,
        start: ArrayLike,
        start_velocity: ArrayLike | None = None,
        *,
        velocity_threshold: ArrayLike = 0.0,
        process: Callable[[Recording], Samples] | None = None,
        position_noise: ArrayLike = 0.0,
        seed: int = 0,
        sign_width: float = SIGN_WIDTH,
        method: str = "automatic",
    ) -> None:
        self.position_noise = per_joint(position_noise, model.dof, "position_noise", finite=True)
        self.seed = read_whole(seed, "seed")
        self.model, self.controller, self.method, self.sign_width = model, controller, method, sign_width
        self.process = process
        self.times = np.asarray(times, dtype=np.float64)
        increasing = self.times.ndim == 1 and len(self.times) >= 2 and np.all(np.diff(self.times) > 0.0)
        if not (increasing and np.isfinite(self.times).all()):
            raise InputError("The times of a closed loop must be at least two finite, increasing numbers of s, (S,).")
        tick = positive(controller.sample_time, "sample time of the controller", "s")
        places = np.round(self.times / tick)
        if np.abs(places * tick - self.times).max() > 0.01 * tick or self.times[0] < -0.01 * tick:
            raise InputError(
                f"The times of the samples must be multiples of the controller's sample time of {tick:.6g} s since it "
                "began; resample the log, or state the rate of the controller."
            )
        self._rows = places.astype(np.intp)
        self._duration = float(max(self._rows[-1], 1) * tick)
        n, speed = model.dof, 0.0 if start_velocity is None else start_velocity
        self.start = per_joint(start, n, "start", finite=True, signed=True)
        self.start_velocity = per_joint(speed, n, "start_velocity", finite=True, signed=True)
        self.threshold = per_joint(velocity_threshold, n, "velocity_threshold")

    @property
    def reference_motion(self) -> Samples | None:
        """What the robot would do if it followed its reference exactly; None where the controller does not tell it.

        The torques are zero: they are not known without parameters.
        """
        reference = getattr(self.controller, "reference", None)
        if reference is None or not callable(getattr(reference, "at", None)):
            return None
        rows = [reference.at(float(t)) for t in self.times]
        q, dq, ddq = (np.array([row[k] for row in rows]) for k in range(3))
        # The least torque that a recording may have: none is stuck at a value.
        torque = np.zeros_like(q) if self.process is None else 1e-300 * ddq
        return self._samples(q, dq, ddq, torque)

    def __call__(self, base: ArrayLike) -> Samples:
        """Return the motion of base parameters (n_b,), with the torques that the controller commands.

        Raises
        ------
        SolverError
            If the simulation diverges, or no samples can be made of its motion.
        """
        result = self._simulated(np.asarray(base, dtype=np.float64), self.start, self.start_velocity)
        if result.status is not Status.FINISHED:
            raise SolverError(f"the simulation ended at {float(result.end_time):.4g} s: {result.message}")
        return self._simulated_samples(*(x[self._rows] for x in (result.q, result.dq, result.ddq, result.torque)))

    def several(self, bases: ArrayLike) -> Sequence[Samples]:
        """Return the motions of several robots, (R, n_b), which are simulated together.

        Raises
        ------
        SolverError
            If one of the simulations diverges, or no samples can be made of its motion.
        """
        return [
            self._simulated_samples(*run) for run in self._batch(np.asarray(bases, dtype=np.float64), self.controller)
        ]

    def expected(self, base: ArrayLike) -> Samples:
        """Return what the sensors of a robot with base parameters (n_b,) read on average, with `position_noise`.

        It is what a log is to be compared with; without noise it is the motion itself.

        Raises
        ------
        SolverError
            If one of the simulations diverges, or no samples can be made of its motion.
        """
        if not self.position_noise.any():
            return self(base)
        given = np.tile(np.asarray(base, dtype=np.float64), (1 + READINGS, 1))
        still, *shaken = self._batch(given, _Shaken(self.controller, self.position_noise, self.seed))
        # Draws cancel in the mean of the readings, which is that of the positions.
        read = self._simulated_samples(*(np.mean(x, axis=0) for x in zip(*shaken, strict=True)))
        # Rows are chosen by the motion without noise: its mean over draws would choose them by these.
        return replace(read, mask=self._simulated_samples(*still).mask)

    def _batch(self, bases: Array, controller: Controller) -> list[tuple[Array, ...]]:
        """q, dq, ddq and torque at the times of the samples, for each of several robots."""
        shape = (len(bases), self.model.dof)
        start, speed = np.broadcast_to(self.start, shape), np.broadcast_to(self.start_velocity, shape)
        result = self._simulated(bases, start, speed, controller)
        assert isinstance(result.status, tuple)
        for status, message in zip(result.status, result.message, strict=True):
            if status is not Status.FINISHED:
                raise SolverError(f"the simulation of one of {len(bases)} robots ended early: {message}")
        return list(zip(*(x[:, self._rows] for x in (result.q, result.dq, result.ddq, result.torque)), strict=True))

    def _simulated(self, base: Array, q0: Array, dq0: Array, controller: Controller | None = None) -> SimulationResult:
        options: dict[str, Any] = {"base": True, "method": self.method, "sign_width": self.sign_width}
        return simulate(self.model, base, q0, dq0, self._duration, controller or self.controller, **options)

    def _simulated_samples(self, q: Array, dq: Array, ddq: Array, torque: Array) -> Samples:
        """Return the samples of a simulated motion, which is no log of the user that could be at fault."""
        try:
            return self._samples(q, dq, ddq, torque)
        except InputError as error:
            raise SolverError(
                "no samples can be made of the simulated motion, such as one of a robot too heavy to move"
            ) from error

    def _samples(self, q: Array, dq: Array, ddq: Array, torque: Array) -> Samples:
        if self.process is None:
            found = Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=self.times)
        else:
            found = self.process(Recording(t=self.times, q=q, torque=torque))
        return without_standstill(found, self.threshold)


class _Shaken:
    """A controller that reads positions with noise: none in the first run, draws, and their negatives."""

    def __init__(self, controller: Controller, deviation: Array, seed: int) -> None:
        self.controller, self.deviation, self.seed = controller, deviation, seed
        self.sample_time = controller.sample_time

    def start(self, measurement: Measurement) -> None:
        self._random = np.random.default_rng(self.seed)
        self._first = self._read(measurement)
        self.controller.start(self._first)

    def torque(self, measurement: Measurement) -> Array:
        # A controller starts with the reading of its first call.
        return self.controller.torque(self._read(measurement) if measurement.t > self._first.t else self._first)

    def _read(self, measurement: Measurement) -> Measurement:
        drawn = self.deviation * self._random.standard_normal((READINGS // 2, len(self.deviation)))
        return replace(measurement, q=measurement.q + np.concatenate([np.zeros_like(drawn[:1]), drawn, -drawn]))


def without_standstill(samples: Samples, threshold: ArrayLike) -> Samples:
    """Leave out the rows in which a joint moves more slowly than a threshold, a number or (N,), rad/s or m/s."""
    least = np.asarray(threshold, dtype=np.float64)
    if not least.any():
        return samples
    return replace(samples, mask=samples.used_rows & (np.abs(samples.dq) >= least))
