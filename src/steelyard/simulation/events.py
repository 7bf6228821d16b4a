"""What a simulation watches for: instants at which a function of time and motion passes through zero."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.robot import Robot

__all__ = ["Event", "Occurrence", "Status", "at_time", "joint_limits"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Event:
    """A function of time and motion whose passages through zero are located.

    A function that is exactly zero at the start of a step, such as at the start of the run, does not count as passing.

    Parameters
    ----------
    function : callable
        Of t, q and dq. In one run they are a float and (N,) arrays, and it returns a number; in a batch (m,) and
        (m, N), and it returns (m,).
    name : str
    direction : {-1, 0, 1}
        Only falling (-1) or rising (1) passages; 0 for both.
    terminal : bool
        Whether it ends the run.
    describe : callable, optional
        Of q and dq (N,) at the event: what happened, for the message.
    from_start : bool
        A run that starts beyond zero, where the direction leads to, or leaves zero in this direction, counts as
        passing.

    Raises
    ------
    InputError
        If the direction is something else, or 0 with `from_start`, or the function cannot be called.

    Examples
    --------
    >>> Event(lambda t, q, dq: q[..., 0], "the pendulum hangs", direction=-1).terminal
    True
    """

    function: Callable[[Any, Array, Array], Any]
    name: str = "event"
    direction: int = 0
    terminal: bool = True
    describe: Callable[[Array, Array], str] | None = None
    from_start: bool = False

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise InputError(f"function of event {self.name!r} must be callable, got {type(self.function).__name__}.")
        if self.direction not in (-1, 0, 1):
            raise InputError(f"direction of event {self.name!r} must be -1, 0 or 1, got {self.direction!r}.")
        if self.from_start and self.direction == 0:
            raise InputError(f"event {self.name!r} with from_start needs a direction, -1 or 1.")


@dataclass(frozen=True, eq=False)
class Occurrence:
    """One passage through zero.

    Attributes
    ----------
    name : str
        Of the event.
    t : float
        s.
    q, dq : ndarray
        (N,).
    run : int
        Of a batch.
    """

    name: str
    t: float
    q: Array
    dq: Array
    run: int = 0


class Status(StrEnum):
    """How a run ended.

    Attributes
    ----------
    FINISHED
        At the end of its duration.
    EVENT
        At an event that ends runs.
    DIVERGED
        Nothing could be computed beyond, a joint became absurdly fast, or the energy of a passive robot grew beyond
        reason.
    STOPPED
        By a stopping condition.

    Examples
    --------
    >>> Status.DIVERGED == "diverged"
    True
    """

    FINISHED = "finished"
    EVENT = "event"
    DIVERGED = "diverged"
    STOPPED = "stopped"


def at_time(t: float, name: str | None = None, terminal: bool = True) -> Event:
    """Return the event of an instant.

    Parameters
    ----------
    t : float
        s.
    name : str, optional
    terminal : bool

    Returns
    -------
    Event

    Examples
    --------
    >>> at_time(2.0).name
    'time 2 s'
    """
    return Event(lambda now, q, dq: now - t, f"time {t:g} s" if name is None else name, direction=1, terminal=terminal)


def joint_limits(
    robot: Robot, lower: ArrayLike | None = None, upper: ArrayLike | None = None, terminal: bool = True
) -> Event:
    """Return the event of a joint that passes a limit of its position, or starts beyond it.

    Parameters
    ----------
    robot : Robot
    lower, upper : array_like, optional
        (N,) rad or m; those of the robot's description where not given.
    terminal : bool

    Returns
    -------
    Event

    Raises
    ------
    InputError
        If there is no limit at all, or the shapes do not fit.

    Examples
    --------
    >>> import steelyard as sy
    >>> pendulum = sy.Robot.from_dh([(0, 1.0, 0, "q")])
    >>> joint_limits(pendulum, upper=[1.0]).function(0.0, np.array([0.75]), np.zeros(1)).item()
    0.25
    """
    joints = [robot.joints[k] for k in robot.driving_joints]
    below = np.array([j.lower for j in joints] if lower is None else lower, dtype=np.float64)
    above = np.array([j.upper for j in joints] if upper is None else upper, dtype=np.float64)
    if below.shape != (robot.dof,) or above.shape != (robot.dof,):
        raise InputError(
            f"{robot.name} has {robot.dof} joints: lower and upper must have shape ({robot.dof},), got {below.shape} "
            f"and {above.shape}."
        )
    if not (np.isfinite(below).any() or np.isfinite(above).any()):
        raise InputError(f"{robot.name} has no joint limits; give lower or upper.")

    def margin(t: Any, q: Array, dq: Array) -> Any:
        return np.minimum(q - below, above - q).min(axis=-1)

    def describe(q: Array, dq: Array) -> str:
        k = int(np.argmin(np.minimum(q - below, above - q)))
        side, limit = ("lower", below[k]) if q[k] - below[k] < above[k] - q[k] else ("upper", above[k])
        return f"joint {joints[k].name!r} passed its {side} limit {limit:.6g}"

    return Event(margin, "joint limit", direction=-1, terminal=terminal, describe=describe, from_start=True)
