"""What every trajectory can do: tell its motion at any time, be sampled, be saved."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

__all__ = ["Trajectory", "sample_times", "times_of"]

Array = NDArray[np.float64]


@runtime_checkable
class Trajectory(Protocol):
    """A motion of N joints in time.

    Attributes
    ----------
    duration : float
        s, from the first to the last instant.
    joint_count : int
        Number N of joints.
    """

    @property
    def duration(self) -> float:
        """Time from the first to the last instant, s."""
        ...

    @property
    def joint_count(self) -> int:
        """Number N of joints."""
        ...

    def motion(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq, (S, N) each, at times (S,) in s."""
        ...

    def sample(self, rate: float) -> tuple[Array, Array, Array, Array]:
        """Return t (S,), q, dq and ddq (S, N) at `rate` Hz."""
        ...

    def save(self, path: str | Path) -> None:
        """Write the trajectory; the suffix says in which format."""
        ...


def times_of(t: ArrayLike) -> Array:
    """Check and convert times (S,).

    Raises
    ------
    InputError
        If they are not a row of finite numbers.
    """
    times = np.asarray(t, dtype=np.float64)
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError(f"t must be a row (S,) of finite times in s, got shape {times.shape}.")
    return times


def sample_times(duration: float, rate: float) -> Array:
    """Return the instants from 0 to the first one not before `duration`, at `rate` Hz.

    Raises
    ------
    InputError
        If the rate is not positive.
    """
    if not (np.isfinite(rate) and rate > 0.0):
        raise InputError(f"rate must be positive, in Hz, got {rate!r}.")
    return np.arange(int(np.ceil(duration * rate - 1e-9)) + 1) / rate
