"""Models of the sensors: encoders, numerical velocities, noise, delay and sampling."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import per_joint, positive, read_whole

from .controller import Measurement

__all__ = ["SensorReadings", "Sensors"]

Array = NDArray[np.float64]
VELOCITIES = ("exact", "numerical", "none")


@dataclass(frozen=True, eq=False)
class Sensors:
    """The sensors of a robot. Values for each joint are one number for all joints, or (N,).

    Parameters
    ----------
    encoder_resolution : array_like
        Angle or length of one count, rad or m; 0 for exact positions.
    velocity : {"numerical", "exact", "none"}
        The velocity that a controller receives: the difference quotient of two encoder positions (at the start, where
        there is only one, the true velocity), the true velocity, or none.
    velocity_cutoff : float or None
        Cut-off frequency of a first-order low-pass filter on the numerical velocity, Hz.
    torque_noise : array_like
        Standard deviation of the measured torques, N·m or N.
    torque_time_constant : float
        Correlation time of this noise, a first-order autoregressive process, s; 0 for white noise.
    torque_delay : float
        Delay of the torque channel relative to the position channel, s.
    force_noise : array_like
        Standard deviation of the noise of the measured wrench, a number or (6,), N and N·m.
    rate : float or None
        Sampling rate of the sensors, Hz; between samples the last reading is repeated. With None they are read whenever
        the controller runs.
    seed : int or None
        Seed of the noise; None takes that of the simulation. The same seed gives the same bytes.

    Raises
    ------
    InputError
        If a value is out of its range.

    Examples
    --------
    >>> readings = Sensors(encoder_resolution=0.1).start(runs=1, count=2, seed=0)
    >>> readings.measure(0.0, np.array([[0.26, -0.04]]), np.zeros((1, 2)), None).q.round(3).tolist()
    [[0.3, -0.0]]
    """

    encoder_resolution: ArrayLike = 0.0
    velocity: str = "numerical"
    velocity_cutoff: float | None = None
    torque_noise: ArrayLike = 0.0
    torque_time_constant: float = 0.0
    torque_delay: float = 0.0
    force_noise: ArrayLike = 0.0
    rate: float | None = None
    seed: int | None = None

    def __post_init__(self) -> None:
        if self.velocity not in VELOCITIES:
            raise InputError(f"velocity of Sensors must be one of {', '.join(VELOCITIES)}, got {self.velocity!r}.")
        for name in ("torque_time_constant", "torque_delay"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value < math.inf:
                raise InputError(f"{name} of Sensors must be at least 0 s, got {value!r}.")
        if self.seed is not None:
            read_whole(self.seed, "seed of Sensors")
        for name in ("velocity_cutoff", "rate"):
            if getattr(self, name) is not None:
                positive(getattr(self, name), f"{name} of Sensors", "Hz")

    def start(self, runs: int, count: int, seed: int) -> SensorReadings:
        """Return the state of the sensors of R runs of N joints before their first reading.

        Parameters
        ----------
        runs, count : int
            Numbers R and N.
        seed : int
            Seed that is used where the attribute `seed` is None.
        """
        return SensorReadings(self, runs, count, seed if self.seed is None else self.seed)


class SensorReadings:
    """The state of the sensors between two readings."""

    def __init__(self, sensors: Sensors, runs: int, count: int, seed: int) -> None:
        self._sensors = sensors
        self._resolution = per_joint(sensors.encoder_resolution, count, "encoder_resolution")
        self._counts = self._resolution > 0.0
        self._coarse = bool(self._counts.any())
        self._noise = per_joint(sensors.torque_noise, count, "torque_noise")
        self._noisy = bool(self._noise.any())
        self._force_noise = per_joint(sensors.force_noise, 6, "force_noise")
        self._torque_generator, self._force_generator = (np.random.default_rng([seed, k]) for k in (1, 2))
        self._deviation: Array | None = None
        self._held: Measurement | None = None
        self._velocity: Array | None = None
        self._history: list[tuple[float, Array]] = []
        self._read: tuple[float, Array] | None = None
        self._shape = (runs, count)

    @property
    def last(self) -> Measurement:
        """The last reading."""
        assert self._held is not None
        return self._held

    def measure(self, t: float, q: Array, dq: Array, force: Array | None) -> Measurement:
        """Read the sensors at time t, (R, N) each; the torque is that of the last reading of the torque channel."""
        sensors, held = self._sensors, self._held
        if held is not None and not self._is_due(t, held.t):
            return Measurement(t, held.q, held.dq, held.torque, held.force)
        if self._coarse:
            safe = np.where(self._counts, self._resolution, 1.0)
            q = np.where(self._counts, np.round(q / safe) * safe, q)
        else:
            q = q.copy()
        velocity = None if sensors.velocity == "none" else dq.copy() if sensors.velocity == "exact" else None
        if sensors.velocity == "numerical":
            velocity = self._numerical(t, q, dq)
        if force is not None:
            force = force.copy()
            if self._force_noise.any():
                force += self._force_noise * self._force_generator.standard_normal(force.shape)
        self._held = Measurement(t, q, velocity, None if self._read is None else self._read[1], force)
        return self._held

    def torque(self, t: float, applied: Array) -> Array:
        """Read the torque channel at time t, at which the torques `applied` begin to act."""
        sensors = self._sensors
        self._history.append((t, applied.copy()))
        earlier = t - sensors.torque_delay + 1e-12  # rounding errors must not delay the torque by another sample
        while len(self._history) > 1 and self._history[1][0] <= earlier:
            self._history.pop(0)
        if self._read is not None and not self._is_due(t, self._read[0]):
            return self._read[1]
        value = self._history[0][1]
        if self._noisy:
            value = value + self._noise * self._drawn(t)
        self._read = (t, value)
        return value

    def _is_due(self, t: float, last: float) -> bool:
        rate = self._sensors.rate
        # A time that rounding errors put just before a sampling instant counts as this instant.
        return rate is None or math.floor(t * rate + 1e-6) > math.floor(last * rate + 1e-6)

    def _numerical(self, t: float, q: Array, dq: Array) -> Array:
        held = self._held
        if held is None or self._velocity is None:  # the first reading is as if the sensors had run before
            self._velocity = dq.copy()
            return self._velocity
        step = t - held.t
        velocity = (q - held.q) / step
        if self._sensors.velocity_cutoff is not None:
            keep = math.exp(-2.0 * math.pi * self._sensors.velocity_cutoff * step)
            velocity = keep * self._velocity + (1.0 - keep) * velocity
        self._velocity = velocity
        return velocity

    def _drawn(self, t: float) -> Array:
        """Draw noise of unit variance, white or with its time constant."""
        white = self._torque_generator.standard_normal(self._shape)
        constant = self._sensors.torque_time_constant
        if self._deviation is None or self._read is None or constant == 0.0:
            self._deviation = white
        else:
            keep = math.exp(-(t - self._read[0]) / constant)
            self._deviation = keep * self._deviation + math.sqrt(1.0 - keep * keep) * white
        return self._deviation
