"""What part of a feedback, or how many times it, a robot of unknown inertia bears and needs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["FeedbackShare"]

Array = NDArray[np.float64]

FIRST = 1.0 / 256.0
"""With which all joints begin. With the whole feedback at once, robots of a thirtieth of the credible masses passed
their limits of velocity 30 to 170 times over, since their swing grows tenfold within a few samples. With 1/1024 heavy
robots fall too far."""
RISE = 0.004
"""s in which a share doubles. The robot falls for some 30 ms meanwhile, to a quarter of the limits of velocity of
simulated arms. With 3 ms robots of a tenth of the credible masses are taken back too late."""
AGAIN = 0.02  # s in which it doubles once it was taken back
TAKEN_BACK = 1.0 / 16.0
"""By which a share is multiplied where its joint swings. With 1/4, arms of a tenth of the credible masses passed their
limits 1.7 times over; what is too little rises again where the joint runs away."""
CEILING = 0.5  # of the share at which a joint swung, to which it rises again
RUNAWAY = 0.2
"""Of the limit of velocity, beyond its reference, from which a joint that still gets faster runs away: its share rises
beyond one. With 0.3 heavy arms fall to 1.1 of their limits, with 0.15 a UR5 begins to swing."""
FAST = 0.001
"""s in which a share beyond one doubles while its joint runs away: a joint that does so with the whole feedback is
heavy, and does not swing soon. With 4 ms a link that falls at 45 rad/s² passed its limit of 2 rad/s."""
MOST = 1000.0  # share beyond which none rises, whatever a joint does
LEAST = 1.0 / 256.0  # share below which none is taken back, so that a joint that others swing is not let go
SWING = 0.03
"""Of the limit of velocity, by which a velocity must turn back to count: a reference turns ten times more slowly than
`WITHIN`, and a loop that is stable swings less."""
READINGS = 1.0  # of the encoder within a sample, which a swing must exceed, too: coarse ones jump by a third of it
WITHIN = 0.02  # s from one turn to the next, which are a swing if the damping drove the joint between them


class FeedbackShare:
    """Shares of a feedback, one for each joint, that rise to one, and further where a joint runs away.

    They are taken back where a joint begins to swing.

    A sampled loop whose velocities are late is unstable where the inertia is much smaller than the one that its gains
    are for: the velocity turns within a few samples, and the damping drives the joint. What it gives to the joint is
    exactly the sum of its torques times the ways between samples (Hannaford and Ryu, "Time-domain passivity control of
    haptic interfaces", IEEE Transactions on Robotics and Automation 18, 2002).

    Parameters
    ----------
    velocity : ndarray
        (N,) limits of velocity, rad/s or m/s.

    Attributes
    ----------
    values : ndarray
        (N,) the shares; more than 1 where a joint has more inertia than the feedback is for.
    taken_back : list of (float, int)
        Times at which a share was taken back, s, and the indices of the joints.

    Examples
    --------
    A joint of 1 kg m² with a damping of 1500 N m s/rad, of which a loop of 1 kHz bears 1000 if it acts a sample late:

    >>> share, q, dq, largest = FeedbackShare(np.array([2.0])), np.zeros(1), np.array([0.05]), 0.0
    >>> torque = asked = np.zeros(1)
    >>> rises = np.array([True])
    >>> for k in range(1000):
    ...     torque, asked = asked, -1500.0 * share.follow(0.001 * k, q, np.zeros(1), dq, torque, rises) * dq
    ...     dq = dq + 0.001 * torque
    ...     q, largest = q + 0.001 * dq, max(largest, float(abs(dq[0])))
    >>> largest < 0.3, len(share.taken_back) > 0, float(abs(dq[0])) < 0.01
    (True, True, True)
    """

    def __init__(self, velocity: Array) -> None:
        size = len(velocity)
        self.values: Array = np.full(size, FIRST)
        self.taken_back: list[tuple[float, int]] = []
        self._least, self._runaway = SWING * velocity, RUNAWAY * velocity
        self._most, self._doubling = np.full(size, MOST), np.full(size, RISE)
        self._direction, self._extreme = np.zeros(size), np.zeros(size)  # no direction before a joint moves
        self._turned = np.full(size, -np.inf)
        self._work, self._reading = np.zeros(size), np.full(size, np.inf)
        self._last: tuple[float, Array] | None = None

    def follow(
        self, t: float, q: Array, wanted: Array, dq: Array, damping: Array, may_rise: NDArray[np.bool_]
    ) -> Array:
        """Take in a measurement, and return the shares (N,) until the next one.

        Parameters
        ----------
        t : float
            s.
        q, wanted, dq : ndarray
            (N,) positions, velocities of the reference, and velocities as the feedback knows them.
        damping : ndarray
            (N,) torques of the damping since the measurement before, N·m or N.
        may_rise : ndarray
            (N,) whether the share may rise beyond one: not where the drive is at its limit of torque, nor in a fast
            motion, whose torques drive a light joint beyond its reference, too.
        """
        if self._last is not None and t > self._last[0]:
            passed, way = t - self._last[0], q - self._last[1]
            self._work += damping * (way - passed * wanted)
            moved = way != 0.0
            self._reading = np.where(moved, np.minimum(self._reading, np.abs(way)), self._reading)
            least = np.maximum(self._least, READINGS * self._reading / passed)
            further = self._direction * (dq - self._extreme) > 0.0
            runs_away = may_rise & further & (self._direction * (dq - wanted) > self._runaway)
            goal = np.where(runs_away, MOST, np.minimum(np.maximum(self.values, 1.0), self._most))
            doubling = np.where(runs_away & (self.values >= 1.0), max(FAST, passed), self._doubling)
            self.values = np.minimum(self.values * np.exp2(np.minimum(passed / doubling, 60.0)), goal)
            self._most = np.maximum(self._most, self.values)
            self._extreme = np.where(further, dq, self._extreme)
            for joint in np.flatnonzero(np.abs(dq - self._extreme) > least):
                self._turn(t, int(joint), float(dq[joint]))
        self._last = t, q.copy()
        return self.values

    def release(self) -> None:
        """Let all shares begin at one at most, since the feedback is now for inertias that were measured."""
        self._most[:] = MOST
        self.values = np.minimum(self.values, 1.0)

    def _turn(self, t: float, joint: int, speed: float) -> None:
        starts = self._direction[joint] == 0.0
        self._direction[joint], self._extreme[joint] = np.sign(speed - self._extreme[joint]), speed
        driven, self._work[joint] = self._work[joint] > 0.0, 0.0
        swings = driven and t - self._turned[joint] <= WITHIN
        # A start is no turn, and a swing is counted once.
        self._turned[joint] = -np.inf if starts or swings else t
        if swings:
            self._most[joint] = max(CEILING * self.values[joint], LEAST)
            self.values[joint] = max(TAKEN_BACK * self.values[joint], LEAST)
            self._doubling[joint] = AGAIN
            self.taken_back.append((t, joint))
