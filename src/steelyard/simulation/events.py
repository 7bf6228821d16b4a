"""Events, at which a function of time and motion passes through zero, and the ways in which a run ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import real_array
from steelyard.robot import Robot

__all__ = ["Event", "Occurrence", "Status", "at_time", "joint_limits"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Event:
    """An event: a function of time and motion whose zero crossings a simulation locates.

    A function that is exactly zero at the start of a step, such as at the start of the run, does not count as crossing
    zero.

    Parameters
    ----------
    function : callable
        Function of t, q and dq. For one run these are a float and (N,) arrays, and the function returns a number; for
        a batch they are (m,) and (m, N) arrays, and it returns (m,).
    name : str
        Name of the event in messages and results.
    direction : {-1, 0, 1}
        -1 for falling and 1 for rising crossings only; 0 for both.
    terminal : bool
        Whether the event ends the run.
    describe : callable, optional
        Function of q and dq (N,) at the event that returns what happened, for the message.
    from_start : bool
        Whether a run that starts on the side to which `direction` leads, or that starts at zero and leaves it in this
        direction, counts as crossing.

    Raises
    ------
    InputError
        If the direction is none of these, or is 0 with `from_start`, or the function cannot be called.

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
    """An event that occurred.

    Attributes
    ----------
    name : str
        Name of the event.
    t : float
        Time, s.
    q, dq : ndarray
        (N,) motion at this time.
    run : int
        Index of the run in a batch.
    """

    name: str
    t: float
    q: Array
    dq: Array
    run: int = 0


class Status(StrEnum):
    """The ways in which a run ends.

    Attributes
    ----------
    FINISHED
        The run reached the end of its duration.
    EVENT
        A terminal event ended it.
    DIVERGED
        The integration could not go on, a joint became faster than any robot's, or the energy of a passive robot grew
        far beyond what it could gain.
    STOPPED
        A stopping condition ended it.

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
    """Return the event that a given time is reached.

    Parameters
    ----------
    t : float
        Time, s.
    name : str, optional
        Name of the event; by default it tells the time.
    terminal : bool
        Whether the event ends the run.

    Examples
    --------
    >>> at_time(2.0).name
    'time 2 s'
    """
    return Event(lambda now, q, dq: now - t, f"time {t:g} s" if name is None else name, direction=1, terminal=terminal)


def joint_limits(
    robot: Robot, lower: ArrayLike | None = None, upper: ArrayLike | None = None, terminal: bool = True
) -> Event:
    """Return the event that a joint passes a limit of its position, or starts beyond it.

    Parameters
    ----------
    robot : Robot
    lower, upper : array_like, optional
        (N,) limits, rad or m; those of the robot's description by default, see `Robot.position_limits`.
    terminal : bool
        Whether the event ends the run.

    Raises
    ------
    InputError
        If no joint has a limit, or the shapes do not fit.

    Examples
    --------
    >>> import steelyard as sy
    >>> pendulum = sy.Robot.from_dh([(0, 1.0, 0, "q")])
    >>> joint_limits(pendulum, upper=[1.0]).function(0.0, np.array([0.75]), np.zeros(1)).item()
    0.25
    """
    described = robot.position_limits
    below = np.array(real_array(described[0] if lower is None else lower, "lower of joint_limits"))
    above = np.array(real_array(described[1] if upper is None else upper, "upper of joint_limits"))
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
        return f"joint {robot.joint_names[k]!r} passed its {side} limit {limit:.6g}"

    return Event(margin, "joint limit", direction=-1, terminal=terminal, describe=describe, from_start=True)
