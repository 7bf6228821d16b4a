"""Stopping conditions, which end a run that exceeds its limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import per_joint

__all__ = ["StoppingCheck", "StoppingConditions"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StoppingConditions:
    """Limits that a run must keep. Values for each joint are one number for all joints, or (N,).

    They are checked once each sample time against the true motion.

    Parameters
    ----------
    velocity : array_like
        Largest speed, rad/s or m/s.
    lower, upper : array_like
        Least and largest positions, rad or m.
    tracking : array_like
        Largest tracking error, the distance from the reference, rad or m.
    reference : Trajectory or None
        The reference of `tracking`: an object with a method ``motion(t)``, which takes times (S,) and returns positions
        (S, N) first. After its `duration` the reference stays at its last position.

    Raises
    ------
    InputError
        If a limit is out of its range, or `tracking` has no reference.

    Examples
    --------
    >>> stop = StoppingConditions(velocity=2.0).start(1, ("shoulder",), 0.0, 0.001)
    >>> stop.reason(0, np.zeros((1, 1)), np.array([[2.5]]))
    {0: "joint 'shoulder' moves at 2.5, the limit is 2"}
    """

    velocity: ArrayLike = np.inf
    lower: ArrayLike = -np.inf
    upper: ArrayLike = np.inf
    tracking: ArrayLike = np.inf
    reference: Any = None

    def __post_init__(self) -> None:
        if self.reference is None and np.isfinite(np.asarray(self.tracking, dtype=np.float64)).any():
            raise InputError("tracking of StoppingConditions needs reference, the trajectory that is to be followed.")
        if self.reference is not None and not callable(getattr(self.reference, "motion", None)):
            raise InputError(
                "reference of StoppingConditions must be a trajectory with motion(t), got "
                f"{type(self.reference).__name__}."
            )

    def start(self, ticks: int, names: tuple[str, ...], start: float, sample_time: float) -> StoppingCheck:
        """Return the check for a number of ticks, one each sample time from `start` on, and joints of these names."""
        return StoppingCheck(self, ticks, names, start, sample_time)


class StoppingCheck:
    """Checks the stopping conditions of R runs at each tick."""

    def __init__(
        self,
        conditions: StoppingConditions,
        ticks: int,
        names: tuple[str, ...],
        start: float,
        sample_time: float,
    ) -> None:
        count = len(names)
        self._names = names
        self._velocity = per_joint(conditions.velocity, count, "velocity of StoppingConditions", zero=False)
        self._lower, self._upper = (
            per_joint(getattr(conditions, side), count, f"{side} of StoppingConditions", signed=True)
            for side in ("lower", "upper")
        )
        if not (self._lower < self._upper).all():
            raise InputError(
                f"lower of StoppingConditions must be below upper, got {self._lower.tolist()} and "
                f"{self._upper.tolist()}."
            )
        self._tracking = per_joint(conditions.tracking, count, "tracking of StoppingConditions", zero=False)
        self._reference: Array | None = None
        if conditions.reference is not None:
            t = start + sample_time * np.arange(ticks)
            duration = getattr(conditions.reference, "duration", None)
            self._reference = np.asarray(
                conditions.reference.motion(t if duration is None else np.minimum(t, duration))[0]
            )
            if self._reference.shape != (ticks, count):
                raise InputError(
                    f"reference of StoppingConditions must be a trajectory of {count} joints, got "
                    f"{self._reference.shape[-1]}."
                )
        self._ranges = bool(np.isfinite(self._lower).any() or np.isfinite(self._upper).any())

    def reason(self, tick: int, q: Array, dq: Array) -> dict[int, str]:
        """Return for each run (by index) that exceeds a limit at a tick the reason for which it must stop."""
        fast = np.abs(dq) > self._velocity
        far = (q < self._lower) | (q > self._upper) if self._ranges else None
        distance = None if self._reference is None else np.abs(q - self._reference[tick])
        lost = None if distance is None else distance > self._tracking
        # This counts in a fifth of the time of `any`.
        if not any(one is not None and np.count_nonzero(one) for one in (fast, far, lost)):
            return {}
        reasons: dict[int, str] = {}
        for run in range(len(q)):
            for joint, name in enumerate(self._names):
                text = ""
                if fast[run, joint]:
                    text = f"moves at {dq[run, joint]:.4g}, the limit is {self._velocity[joint]:.4g}"
                elif far is not None and far[run, joint]:
                    text = (
                        f"is at {q[run, joint]:.4g}, allowed are {self._lower[joint]:.4g} to {self._upper[joint]:.4g}"
                    )
                elif lost is not None and distance is not None and lost[run, joint]:
                    text = (
                        f"is {distance[run, joint]:.4g} away from its reference, the limit is "
                        f"{self._tracking[joint]:.4g}"
                    )
                if text:
                    reasons[run] = f"joint {name!r} {text}"
                    break
        return reasons
