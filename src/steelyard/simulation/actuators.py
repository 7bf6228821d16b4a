"""Models of the drives: saturation, rate limit, and quantisation of the current."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import per_joint

__all__ = ["ActuatorOutputs", "Actuators"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Actuators:
    """The drives of a robot. Values for each joint are one number for all joints, or (N,).

    A command passes through the saturation, then the rate limit, then the quantisation of the current.

    Parameters
    ----------
    saturation : array_like
        Largest torque, N·m or N.
    rate_limit : array_like
        Largest rate of change of the torque, N·m/s or N/s. With a rate limit the torques start from zero.
    torque_constant : array_like or None
        Torque at the joint for one ampere, N·m/A or N/A.
    current_range : array_like or None
        Largest current of the current controller, A.
    current_bits : int or None
        Resolution of the current: there are ``2**bits - 1`` levels from minus to plus the range, one of them zero.

    Raises
    ------
    InputError
        If a value is out of its range, or only some of `torque_constant`, `current_range` and `current_bits` are given.

    Examples
    --------
    >>> Actuators(saturation=5.0).start(runs=1, count=2).apply(np.array([[7.0, -3.0]]), 0.001).tolist()
    [[5.0, -3.0]]
    """

    saturation: ArrayLike = np.inf
    rate_limit: ArrayLike = np.inf
    torque_constant: ArrayLike | None = None
    current_range: ArrayLike | None = None
    current_bits: int | None = None

    def __post_init__(self) -> None:
        given = [value is not None for value in (self.torque_constant, self.current_range, self.current_bits)]
        if any(given) and not all(given):
            raise InputError(
                "Actuators with a quantised current need torque_constant, current_range and current_bits together."
            )
        bits = self.current_bits
        if bits is not None and (isinstance(bits, bool) or not isinstance(bits, int) or not 2 <= bits <= 32):
            raise InputError(f"current_bits of Actuators must be a whole number from 2 to 32, got {bits!r}.")

    def start(self, runs: int, count: int) -> ActuatorOutputs:
        """Return the state of the drives of R runs of N joints at the start, with zero torques."""
        return ActuatorOutputs(self, runs, count)


class ActuatorOutputs:
    """The state of the drives between two commands."""

    def __init__(self, actuators: Actuators, runs: int, count: int) -> None:
        self._saturation = per_joint(actuators.saturation, count, "saturation", zero=False)
        self._rate = per_joint(actuators.rate_limit, count, "rate_limit", zero=False)
        self._is_slow = bool(np.isfinite(self._rate).any())
        self._level: Array | None = None
        if actuators.current_bits is not None:
            constant = per_joint(actuators.torque_constant, count, "torque_constant", zero=False)
            largest = per_joint(actuators.current_range, count, "current_range", zero=False)
            if not (np.isfinite(constant).all() and np.isfinite(largest).all()):
                raise InputError(
                    "torque_constant and current_range of Actuators must be finite, got "
                    f"{constant.tolist()} and {largest.tolist()}."
                )
            self._steps = 2 ** (actuators.current_bits - 1) - 1
            self._level = constant * largest / self._steps
        self._last = np.zeros((runs, count))

    def apply(self, command: Array, sample_time: float) -> Array:
        """Return the torques (R, N) for a command that comes `sample_time` (s) after the last one."""
        torque = np.clip(command, -self._saturation, self._saturation)
        if self._is_slow:
            change = self._rate * sample_time
            torque = np.clip(torque, self._last - change, self._last + change)
            self._last = torque
        if self._level is not None:
            torque = np.clip(np.round(torque / self._level), -self._steps, self._steps) * self._level
        return torque
