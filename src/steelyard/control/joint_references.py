"""References for the joints of a robot: constant positions, a trajectory, or a function of time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import positive

__all__ = [
    "ConstantReference",
    "FunctionReference",
    "JointReference",
    "TrajectoryReference",
    "configurations_of",
    "joint_reference",
]

Array = NDArray[np.float64]

# Samples of a trajectory that are computed in one call: at 1 kHz about two seconds. One call per sample would take
# longer than the controller itself.
_BLOCK = 2048


@runtime_checkable
class JointReference(Protocol):
    """Desired positions, velocities and accelerations of the joints as functions of time."""

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq, (..., N) each, at time t (s)."""


class ConstantReference:
    """Constant joint positions.

    Parameters
    ----------
    q : array_like
        (..., N), rad or m.

    Examples
    --------
    >>> ConstantReference([0.5, 1.0]).at(3.0)[0].tolist()
    [0.5, 1.0]
    """

    def __init__(self, q: ArrayLike) -> None:
        self.q = np.array(q, dtype=np.float64)
        if self.q.ndim == 0 or not np.isfinite(self.q).all():
            raise InputError(f"A constant reference is finite joint positions (..., N), got {q!r}.")
        self._still = np.zeros_like(self.q)

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return the positions, with velocities and accelerations of zero."""
        return self.q, self._still, self._still


class FunctionReference:
    """A motion given by a function of time.

    Parameters
    ----------
    function : callable
        From a time (s) to q, dq and ddq, (..., N) each.

    Examples
    --------
    >>> ramp = FunctionReference(lambda t: ([2.0 * t], [2.0], [0.0]))
    >>> [float(x[0]) for x in ramp.at(0.5)]
    [1.0, 2.0, 0.0]
    """

    def __init__(self, function: Callable[[float], Any]) -> None:
        self._function = function

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq at time t (s)."""
        found = self._function(t)
        if not isinstance(found, tuple | list) or len(found) != 3:
            raise InputError(
                "A function that is a reference must return positions, velocities and accelerations as three arrays; "
                f"at {t:g} s it returned {type(found).__name__}."
            )
        q, dq, ddq = (np.asarray(array, dtype=np.float64) for array in found)
        return q, dq, ddq


class TrajectoryReference:
    """A trajectory that begins at a given time; before its start and after its end the joints stand still.

    Samples at multiples of the sample time are computed in blocks and kept; samples at other times are computed one by
    one.

    Parameters
    ----------
    trajectory : object
        An object with a method ``motion(t)``, which returns q, dq and ddq (S, N) for times (S,), and an attribute
        `duration` or `period` (s).
    start : float
        Time at which the trajectory begins, s.
    repeat : bool
        Whether the trajectory starts again at its end, as a periodic motion may.
    sample_time : float
        Sample time of the controller, s.

    Examples
    --------
    >>> from steelyard.excitation import FourierTrajectory
    >>> wave = FourierTrajectory(a=[[1.0]], b=[[0.0]], center=[0.5], frequency=1.0)
    >>> reference = TrajectoryReference(wave, start=2.0)
    >>> [float(x[0]) for x in reference.at(1.0)], float(reference.at(2.0)[1][0])
    ([0.5, 0.0, 0.0], 1.0)
    """

    def __init__(
        self, trajectory: Any, *, start: float = 0.0, repeat: bool = False, sample_time: float = 0.001
    ) -> None:
        duration = getattr(trajectory, "duration", None) or getattr(trajectory, "period", None)
        if not callable(getattr(trajectory, "motion", None)) or duration is None:
            raise InputError(
                "A trajectory must have motion(t) and a duration, as those of steelyard.excitation do, got "
                f"{type(trajectory).__name__}."
            )
        self.trajectory = trajectory
        self.duration = float(duration)
        self.start = positive(start, "start", "s", zero=True)
        self.repeat = bool(repeat)
        self._rate = 1.0 / positive(sample_time, "sample_time", "s")
        self._blocks: dict[int, tuple[Array, Array, Array]] = {}
        q, _, _ = self._motion(np.array([0.0, self.duration]))
        self._ends = tuple((place, np.zeros_like(place), np.zeros_like(place)) for place in q)

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq, (N,) each, at time t (s)."""
        since = t - self.start
        if since < 0.0:
            return self._ends[0]
        if self.repeat:
            since %= self.duration
        elif since > self.duration:
            return self._ends[1]
        place = since * self._rate
        index = round(place)
        if abs(place - index) > 1e-6 or index > self.duration * self._rate:
            q, dq, ddq = self._motion(np.array([since]))
            return q[0], dq[0], ddq[0]
        block, row = divmod(index, _BLOCK)
        kept = self._blocks.get(block)
        if kept is None:
            times = np.minimum((block * _BLOCK + np.arange(_BLOCK)) / self._rate, self.duration)
            kept = self._blocks[block] = self._motion(times)
        return kept[0][row], kept[1][row], kept[2][row]

    def _motion(self, times: Array) -> tuple[Array, Array, Array]:
        q, dq, ddq = (np.asarray(array, dtype=np.float64) for array in self.trajectory.motion(times))
        return q, dq, ddq


def configurations_of(reference: JointReference) -> Array:
    """Return positions (P, N) of a reference: 32 evenly spread over a trajectory, otherwise those at 0 s."""
    if isinstance(reference, TrajectoryReference):
        times = np.linspace(0.0, reference.duration, 32)
        return np.asarray(reference.trajectory.motion(times)[0], dtype=np.float64)
    first = np.asarray(reference.at(0.0)[0], dtype=np.float64)
    return first.reshape(-1, first.shape[-1])


def joint_reference(reference: Any, count: int, *, sample_time: float = 0.001) -> JointReference:
    """Convert what a user gives to a reference.

    Parameters
    ----------
    reference : object
        A :class:`JointReference`, a trajectory, positions (..., N), or a function from a time to q, dq and ddq.
    count : int
        Number N of joints.
    sample_time : float
        Sample time of the controller, s.

    Raises
    ------
    InputError
        If `reference` is none of these, or has another number of joints.
    """
    found: JointReference
    if callable(getattr(reference, "motion", None)):
        found = TrajectoryReference(reference, sample_time=sample_time)
    elif isinstance(reference, JointReference):
        found = reference
    elif callable(reference):
        found = FunctionReference(reference)
    else:
        try:
            found = ConstantReference(reference)
        except (TypeError, ValueError):
            raise InputError(
                "A reference must be a trajectory, joint positions, or a function from a time to positions, "
                f"velocities and accelerations, got {type(reference).__name__}."
            ) from None
    first = found.at(0.0)
    if len(first) != 3:
        raise InputError(
            f"A reference must give positions, velocities and accelerations; {type(found).__name__} gives {len(first)} "
            "arrays."
        )
    sizes = {array.shape[-1] if array.ndim else 0 for array in first}
    if sizes != {count}:
        raise InputError(f"The robot has {count} joints, and the reference gives {sorted(sizes)} numbers at 0 s.")
    return found
