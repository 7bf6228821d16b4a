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
RISE = 0.0035
"""s in which all shares double while a joint escapes: while it gets faster beyond its reference. The robot falls for
some 30 ms meanwhile, to a half of the limits of velocity of simulated arms. With 3 ms a Panda of a thirtieth of the
credible masses passed its limits."""
CALM = 0.08
"""s in which they double where no joint escapes. What caught the robot is about what its masses need; shares that went
on to one at once were a hundred times that of a light robot, before its swing was seen."""
SPARE = 4.0  # times the share that caught the robot, to which they rise so, and to one at most
TAKEN_BACK = 0.25
"""By which shares are multiplied where a joint swings. With 1/16 arms of a fifth of the credible masses fell at once,
at up to 2.6 times their limits of velocity."""
CEILING = 0.5  # of the share at which a joint swung, to which it rises again
ESCAPE = 0.03  # of the limit of velocity, beyond its reference, from which a joint escapes
GROWS = 0.003  # s within which its velocity was the largest so far, where it still gets faster: what noise hides
RUNAWAY = 0.2
"""Of the limit of velocity, beyond its reference, from which a joint that still gets faster runs away: its share rises
beyond one. With 0.3 heavy arms fall to 1.1 of their limits, with 0.15 a UR5 begins to swing."""
URGENT, FAST = 0.5, 0.001
"""Of the limit of velocity from which on a share doubles in so many s, where its joint runs away, but at most doubles
from one sample to the next: at 250 Hz shares that grew 16 times swung, at up to 9 times the limit. Without it a last
link of ten times the credible masses passed its limit by 3 %; from 0.2 of the limit on, a heavy Panda swung."""
MOST = 1000.0  # share beyond which none rises, whatever a joint does
LEAST = 1.0 / 256.0  # share below which none is taken back, so that a joint that others swing is not let go
SWING = 0.03
"""Of the limit of velocity, by which a velocity must turn back to count: a reference turns ten times more slowly than
`WITHIN`, and a loop that is stable swings less."""
COARSE = 0.1
"""Of the limit of velocity, by which one reading of the encoder changes the velocity that is followed here. With 12
bits one reading within 1 ms is 0.6 of a limit of 2.5 rad/s: behind such peaks no joint was seen to get faster, and arms
of ten times the credible masses fell at up to 2.7 times their limits. With 0.05 a Panda swung, with 0.4 it fell."""
READINGS = 1.0  # of the encoder within a sample, which a swing must exceed, too: coarse ones jump by a third of it
NOISY = 4.0
"""Standard deviations of white noise of a position that count as one reading of its encoder, whose steps have 3.5."""
STRETCH, FEWEST, NEWEST = 24, 8, 0.1
"""Samples over which the noise is measured, and after which it is first known; what the last stretch counts for."""
WITHIN = 0.02
"""s from one turn to the next, which are a swing if the damping drove the joint between them. A joint that turned
within this time does not escape: without that, shares rose with the swing of light joints, to 128 and 3.5 limits of
velocity."""

SLOWEST, LARGE, GREW, TIMES = 0.08, 0.15, 1.05, 2
"""s from one turn to the next, of the limit of velocity and of the span between the two turns before, from which on a
swing grows, and how often in succession it must grow to count as one whatever its damping gave it. With measurements
that come 5 ms late arms turned at 2.2 to 12 times their limits and went on swinging, none taken back; now they turn at
1.9 times at most, while they are caught. With one time shares of an xArm 7 are taken back until it falls."""


class FeedbackShare:
    """Shares of a feedback, one for each joint: they rise while a joint escapes, and are taken back where one swings.

    All rise together, since joints move each other: feedback for one that is much stiffer than for its neighbours, in
    the ratio of their inertias, throws these about. So they are taken back together, too, or those beyond one alone.

    A sampled loop whose velocities are late is unstable where the inertia is much smaller than the one that its gains
    are for: the velocity turns within a few samples, and the damping drives the joint. What it gives to the joint is
    exactly the sum of its torques times the ways between samples (Hannaford and Ryu, "Time-domain passivity control of
    haptic interfaces", IEEE Transactions on Robotics and Automation 18, 2002). That of a joint alone counts, since
    what joints give to each other has any sign.

    Parameters
    ----------
    velocity : ndarray
        (N,) limits of velocity, rad/s or m/s.

    Attributes
    ----------
    values : ndarray
        (N,) the shares; more than 1 where a joint has more inertia than the feedback is for.
    forward : ndarray
        (N,) the shares at which the first joint no longer escaped, 1 at most: what of the assumed masses the robot has.
        More of their weight would throw a light robot up.
    reading : ndarray
        (N,) how coarse positions are: a step of an encoder, or some standard deviations of noise; 0 while not known.
    speeds : ndarray
        (N,) velocities as far as the positions show them: neither steps nor noise of an encoder.
    taken_back : list of (float, int)
        Times at which a share was taken back, s, and the indices of the joints.

    Examples
    --------
    A joint of 1 kg m² with a damping of 1500 N m s/rad, of which a loop of 1 kHz bears 1000 if it acts a sample late:

    >>> share, q, dq, largest = FeedbackShare(np.array([2.0])), np.zeros(1), np.array([0.05]), 0.0
    >>> torque = asked = np.zeros(1)
    >>> rises = np.array([True])
    >>> for k in range(2000):
    ...     torque, asked = asked, -1500.0 * share.follow(0.001 * k, q, np.zeros(1), dq, torque, rises) * dq
    ...     dq = dq + 0.001 * torque
    ...     q, largest = q + 0.001 * dq, max(largest, float(abs(dq[0])))
    >>> largest < 0.3, len(share.taken_back) > 0, float(abs(dq[0])) < 0.01
    (True, True, True)
    """

    def __init__(self, velocity: Array) -> None:
        size = len(velocity)
        self.values: Array = np.full(size, FIRST)
        self.forward = self.values
        self.taken_back: list[tuple[float, int]] = []
        self.speeds, self.reading, self._step = np.zeros(size), np.zeros(size), COARSE * velocity
        self._least, self._escape, self._runaway = SWING * velocity, ESCAPE * velocity, RUNAWAY * velocity
        self._urgent = URGENT * velocity
        self._most = np.full(size, MOST)
        self._direction, self._extreme = np.zeros(size), np.zeros(size)  # no direction before a joint moves
        self._peak, self._span, self._large = np.zeros(size), np.zeros(size), LARGE * velocity
        self._larger = np.zeros(size, dtype=int)
        # Times of the last turn that may be the first of a swing, of the last turn, and of the largest velocity since.
        self._turned, self._since, self._fastest = np.full((3, size), -np.inf)
        self._work, self._step_seen = np.zeros(size), np.full(size, np.inf)
        self._noise = _PositionNoise(size)
        self._escapes, self._caught = np.zeros(size, dtype=bool), False
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
            (N,) torques of the damping of each joint alone since the measurement before, N·m or N.
        may_rise : ndarray
            (N,) whether the share may rise beyond one: not where the drive is at its limit of torque, nor on the way
            back to the reference, nor in a fast motion, whose torques drive a light joint beyond its reference, too.
        """
        if self._last is not None and t > self._last[0]:
            passed, way = t - self._last[0], q - self._last[1]
            self._work += damping * (way - passed * wanted)
            self._step_seen = np.where(way != 0.0, np.minimum(self._step_seen, np.abs(way)), self._step_seen)
            known = np.isfinite(self._step_seen)
            noise = self._noise.deviations(q)
            steps = np.array([self._step_seen, NOISY * noise])
            reading = self.reading = np.where(np.isfinite(steps), steps, 0.0).max(axis=0)
            # Time over which one reading is `COARSE`, and of the filter: none before a reading is known.
            lasts = reading / self._step
            self.speeds = dq + np.exp(-passed / np.maximum(lasts, 1e-9)) * (self.speeds - dq)
            dq, within = self.speeds, np.maximum(passed, lasts)
            least = np.where(known, np.maximum(self._least, READINGS * reading / within), np.inf)
            least[(self._direction != 0.0) & np.isinf(noise)] = np.inf  # noise turns back at once, which is no swing
            further = self._direction * (dq - self._extreme) > 0.0
            steady = (self._work <= 0.0) & (t - self._since > WITHIN)
            beyond = np.where(steady, self._direction * (dq - wanted), 0.0)
            runs_away = may_rise & further & (beyond > self._runaway)
            self._fastest = np.where(further, t, self._fastest)
            escapes = (beyond > self._escape) & (t - self._fastest < GROWS)
            escapes |= reading > 3.0 * self._escape * within  # a velocity that is shown in jumps does not tell
            self._caught = self._caught or bool((self._escapes & ~escapes).any())
            self._escapes = escapes
            enough = min(SPARE * float(self.forward.max()), 1.0) if self._caught and not escapes.any() else 1.0
            goal = np.where(runs_away, MOST, np.minimum(np.maximum(self.values, enough), self._most))
            doubling = np.where(runs_away & (beyond > self._urgent), max(FAST, passed), RISE if escapes.any() else CALM)
            self.values = np.minimum(self.values * np.exp2(np.minimum(passed / doubling, 60.0)), goal)
            if not self._caught:
                self.forward = np.minimum(self.values, 1.0)
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
        self.forward, self._caught = np.ones_like(self.values), True

    def _turn(self, t: float, joint: int, speed: float) -> None:
        starts, peak = self._direction[joint] == 0.0, self._extreme[joint]
        self._direction[joint], self._extreme[joint] = np.sign(speed - peak), speed
        driven, self._work[joint] = self._work[joint] > 0.0, 0.0
        # Where measurements are late, torques and motions that belong together are not seen together: the damping of a
        # swing seems to take energy from it, which grows all the same.
        span, soon = abs(peak - self._peak[joint]), t - self._since[joint] <= SLOWEST
        larger = soon and span > self._large[joint] and span > GREW * self._span[joint]
        self._larger[joint] = self._larger[joint] + 1 if larger else 0
        self._peak[joint], self._span[joint] = peak, span
        swings = (driven and t - self._turned[joint] <= WITHIN) or self._larger[joint] >= TIMES
        self._since[joint] = -np.inf if starts else t
        # A start is no turn, and a swing is counted once.
        self._turned[joint] = -np.inf if starts or swings else t
        self._larger[joint] = 0 if swings else self._larger[joint]
        if swings:
            # Those of joints that ran away are beyond what holds the rest, and swing their neighbours.
            raised = self.values > 1.0
            back = raised | ~raised.any()
            self._most[back] = np.maximum(CEILING * self.values[back], LEAST)
            self.values = np.where(back, np.maximum(TAKEN_BACK * self.values, LEAST), self.values)
            self.taken_back.append((t, joint))


class _PositionNoise:
    """The standard deviation of white noise of measured positions, by their third differences.

    Neighbouring ones of noise have a mean product of -15 times its variance. Those of a motion are small, and of one
    sign for longer, but where it swings with fewer than four samples a period.
    """

    def __init__(self, size: int) -> None:
        self._variances = np.full(size, np.inf)
        self._positions: list[Array] = []

    def deviations(self, q: Array) -> Array:
        """Take in positions (N,) of the next sample, and return the standard deviations (N,); infinite at first."""
        self._positions.append(q.copy())
        count, first = len(self._positions), bool(np.isinf(self._variances).any())
        if count > (FEWEST if first else STRETCH):
            third = np.diff(self._positions, 3, axis=0)
            found = np.maximum(np.mean(-third[1:] * third[:-1], axis=0), 0.0) / 15.0
            if count <= STRETCH:
                return np.asarray(np.sqrt(found))
            self._variances = found if first else self._variances + NEWEST * (found - self._variances)
            self._positions = self._positions[-3:]
        return np.asarray(np.sqrt(self._variances))
