"""Follows the runs during integration: samples, events, and the detection of runs that diverge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from steelyard.errors import InputError

from .events import Event, Occurrence, Status
from .plant import Plant

__all__ = ["ABSURD_SPEED", "Interpolant", "Runaway", "Watch"]

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
End = Callable[[int, float, str, Array], None]

# Joint speed (rad/s or m/s) above which a run has diverged: fifty thousand revolutions a minute. Robots with impossible
# parameters reach it long before their states overflow.
ABSURD_SPEED = 5e3
# An adaptive method must advance on average by at least the fraction SLOWEST of the duration with each attempted step,
# measured over WINDOW attempts. More slowly it would need more than 1e9 attempts, which take hours.
WINDOW, SLOWEST = 2000, 1e-9
MOST = 50_000_000  # attempted steps of one run, up to hours of computing


class Runaway:
    """Ends runs that an adaptive method would never finish, because its steps become ever shorter.

    Parameters
    ----------
    state : ndarray
        (R, 2 N) at the start. Ten times its largest speed is allowed, where this is above `ABSURD_SPEED`.
    duration : float
        Duration of the runs, s.
    end : callable
        Function that ends a run: of its index, the time, the message and the state (2 N,).
    """

    def __init__(self, plant: Plant, state: Array, duration: float, end: End) -> None:
        runs = plant.runs
        self._end, self._count, self._plant = end, plant.count, plant
        self._limit = np.maximum(ABSURD_SPEED, 10.0 * np.abs(state[:, plant.count :]).max(axis=1, initial=0.0))
        self._attempts = np.zeros(runs, dtype=np.int64)
        self._since = np.zeros(runs)
        self._slowest = SLOWEST * WINDOW * duration

    def check(self, rows: Rows, t: Array, state: Array) -> None:
        """Check runs (m,) after an attempted step that led to times (m,) and states (m, 2 N)."""
        self.speed(rows, t, state)
        self._attempts[rows] += 1
        attempts = self._attempts[rows]
        for k in np.flatnonzero(attempts % WINDOW == 0).tolist():
            run, now = int(rows[k]), float(t[k])
            if now - self._since[run] < self._slowest:
                text = f"{WINDOW} steps got {now - self._since[run]:.3g} s further, to {now:.6g} s: time stands still"
                self._end(run, now, text, state[k])
            elif attempts[k] >= MOST:
                self._end(run, now, f"{MOST} steps led no further than {now:.6g} s", state[k])
            self._since[run] = now

    def speed(self, rows: Rows, t: Array, state: Array) -> None:
        """End the runs in which a joint is faster than any robot's."""
        speeds = np.abs(state[:, self._count :])
        if not (speeds > ABSURD_SPEED).any():
            return
        for k in np.flatnonzero(speeds.max(axis=1) > self._limit[rows]).tolist():
            robot = self._plant.functions.model.robot
            joint = robot.driving_joints[int(np.argmax(speeds[k]))]
            unit = "rad/s" if robot.joints[joint].rotates else "m/s"
            text = (
                f"joint {robot.joints[joint].name!r} reached {speeds[k].max():.3g} {unit}, which no robot does, "
                f"at {t[k]:.6g} s"
            )
            self._end(int(rows[k]), float(t[k]), text, state[k])


# Function of indices (k,) into the rows of a step and of times (k,) within this step that returns states (k, 2 N).
Interpolant = Callable[[Rows, Array], Array]

# The kinetic energy of a robot that nothing drives may grow to this multiple of what it can have gained. No error of
# integration within the tolerances comes near it, while parameters of impossible robots soon exceed it.
LARGEST_ENERGY_GAIN = 100.0


class Watch:
    """Follows R runs: samples them, locates their events, and records how each of them ends.

    Parameters
    ----------
    state : ndarray
        (R, 2 N) at the start.
    duration : float
        Duration of the runs, s.
    passive : bool
        Whether nothing drives the robots, so that their energy must not grow.
    times : ndarray, optional
        (S,) output times at which steps are sampled; None where the caller takes the samples.
    dense : bool
        Whether the interpolants of a single run are kept.

    Attributes
    ----------
    ended : ndarray
        (R,) of bool, whether a run has ended.
    some_ended, all_ended : bool
        Whether any of the runs have, or all; asked after every step, where a look at the array takes longer.
    final : ndarray
        (R, 2 N) last states of the runs that ended.
    runaway : Runaway
        Its `check` is called by the adaptive methods after every attempted step.
    """

    def __init__(
        self,
        plant: Plant,
        state: Array,
        events: Sequence[Event],
        duration: float,
        *,
        passive: bool = False,
        times: Array | None = None,
        dense: bool = False,
    ) -> None:
        runs, width = state.shape
        self.plant, self.events = plant, tuple(events)
        self.ended = np.zeros(runs, dtype=bool)
        self.some_ended = self.all_ended = False
        self.final = state.copy()
        self.end_time = np.full(runs, np.nan)
        self.status: list[Status] = [Status.FINISHED] * runs
        self.message = [""] * runs
        self.occurrences: list[Occurrence] = []
        self.times = times
        self.samples = None if times is None else np.full((runs, len(times), width), np.nan)
        self._next = np.zeros(runs, dtype=np.intp)
        self.pieces: list[tuple[float, float, Interpolant]] | None = [] if dense and runs == 1 else None
        self._energy = _PassiveEnergy(plant, state) if passive else None
        self.runaway = Runaway(plant, state, duration, self._diverged)
        self._before: list[Array] = [self._value(e, np.arange(runs), np.zeros(runs), state) for e in self.events]
        if self.samples is not None and times is not None and len(times) and times[0] == 0.0:
            self.samples[:, 0] = state
            self._next[:] = 1

    @property
    def every_step(self) -> bool:
        """Whether integrators must pass every step to `piece`."""
        return bool(self.events) or self.times is not None or self.pieces is not None or self._energy is not None

    def end(self, run: int, status: Status, t: float, message: str, state: Array) -> None:
        """End a run; where it has ended already, nothing changes."""
        if not self.ended[run]:
            if status is Status.DIVERGED:
                message += self.plant.unknown_torque(run, t)
            self.ended[run] = True
            self.some_ended, self.all_ended = True, bool(self.ended.all())
            self.status[run], self.end_time[run], self.message[run] = status, t, message
            self.final[run] = state

    def begin(self) -> None:
        """Find the runs that start beyond an event; to be called once the start has been recorded."""
        n = self.plant.count
        for event, value in zip(self.events, self._before, strict=True):
            if not event.from_start:
                continue
            for run in np.flatnonzero(value * event.direction > 0.0).tolist():
                state = self.final[run].copy()
                self.occurrences.append(Occurrence(event.name, 0.0, state[:n], state[n:], run))
                if event.terminal:
                    text = event.name if event.describe is None else event.describe(state[:n], state[n:])
                    self.end(run, Status.EVENT, 0.0, f"{text} at 0 s, where it starts", state)

    def _diverged(self, run: int, t: float, message: str, state: Array) -> None:
        self.end(run, Status.DIVERGED, t, message, state)

    def piece(self, rows: Rows, t0: Array, t1: Array, stop: Array, interpolate: Interpolant) -> None:
        """Process one step of some runs.

        Parameters
        ----------
        rows : ndarray
            (m,) indices of the runs.
        t0, t1 : ndarray
            (m,) times at which their steps begin and end.
        stop : ndarray
            (m, 2 N) states at t1.
        interpolate : Interpolant
            States within the step.
        """
        until = t1.copy()
        for number, event in enumerate(self.events):
            after = self._value(event, rows, t1, stop)
            before = self._before[number][rows]
            rising = (before < 0.0) & (after >= 0.0) & (event.direction >= 0)
            falling = (before > 0.0) & (after <= 0.0) & (event.direction <= 0)
            if event.from_start:
                rising |= (before == 0.0) & (after > 0.0) & (event.direction > 0)
                falling |= (before == 0.0) & (after < 0.0) & (event.direction < 0)
            self._before[number][rows] = after
            for place in np.flatnonzero(rising | falling):
                self._locate(event, int(place), rows, t0, until, interpolate)
        if self.samples is not None:
            self._sample(rows, until, interpolate)
        if self.pieces is not None:
            self.pieces.append((float(t0[0]), float(until[0]), interpolate))
        if self._energy is not None:
            self._energy.check(self, rows, t1, stop)

    def _value(self, event: Event, rows: Rows, t: Array, state: Array) -> Array:
        n = self.plant.count
        single = self.plant.runs == 1
        given: tuple[Any, ...] = (
            (float(t[0]), state[0, :n], state[0, n:]) if single else (t, state[:, :n], state[:, n:])
        )
        value = np.asarray(event.function(*given), dtype=np.float64)
        if value.shape != (() if single else rows.shape):
            expected = "a number" if single else f"an array of shape {rows.shape}"
            raise InputError(f"event {event.name!r} must return {expected}, got shape {value.shape}.")
        value = value.reshape(rows.shape)
        if np.isnan(value).any():
            k = int(np.argmax(np.isnan(value)))
            raise InputError(
                f"event {event.name!r} must return numbers, but returned NaN at {t[k]:.6g} s, where q is "
                f"{state[k, :n].tolist()}."
            )
        return value

    def _locate(self, event: Event, place: int, rows: Rows, t0: Array, until: Array, interpolate: Interpolant) -> None:
        """Locate an event within the step of one run; an event after the end of the run is ignored."""
        which, one = np.array([place]), rows[place : place + 1]

        def at(t: float) -> Array:
            return interpolate(which, np.array([t]))

        def value(t: float) -> float:
            return float(self._value(event, one, np.array([t]), at(t))[0])

        begin, end = float(t0[place]), float(until[place])
        first, last = value(begin), value(end)
        if first * last > 0.0:  # another event ended the step before it, or rounding of the interpolant
            return
        t = end if last == 0.0 else begin if first == 0.0 else float(brentq(value, begin, end, xtol=1e-14, rtol=1e-14))
        state, n, run = at(t)[0], self.plant.count, int(one[0])
        self.occurrences.append(Occurrence(event.name, t, state[:n].copy(), state[n:].copy(), run))
        if event.terminal:
            until[place] = t
            text = event.name if event.describe is None else event.describe(state[:n], state[n:])
            if self.ended[run] and self.status[run] is Status.EVENT:  # this event of the same step comes first
                self.ended[run] = False
            self.end(run, Status.EVENT, t, f"{text} at {t:.6g} s", state)

    def _sample(self, rows: Rows, until: Array, interpolate: Interpolant) -> None:
        assert self.times is not None
        assert self.samples is not None
        while True:
            upcoming = self._next[rows]
            due = upcoming < len(self.times)
            due[due] &= self.times[upcoming[due]] <= until[due]
            which = np.flatnonzero(due)
            if not which.size:
                return
            self.samples[rows[which], upcoming[which]] = interpolate(which, self.times[upcoming[which]])
            self._next[rows[which]] += 1


class _PassiveEnergy:
    """Bounds the kinetic energy of robots that nothing drives.

    Kinetic energy can grow by the decrease of potential energy, and by the work of constant torques (offsets) over the
    displacement of a joint. A run ends where it exceeds `LARGEST_ENERGY_GAIN` times the sum of these.
    """

    def __init__(self, plant: Plant, state: Array) -> None:
        self._plant = plant
        energy = np.concatenate([plant.energy(r, state[r : r + 1]) for r in range(plant.runs)])
        self._first = state.copy()
        self._kinetic = energy[:, 0]
        self._lowest, self._highest = energy[:, 1].copy(), energy[:, 1].copy()
        self._work = np.zeros(plant.runs)

    def check(self, watch: Watch, rows: Rows, t: Array, state: Array) -> None:
        plant, n = self._plant, self._plant.count
        if plant.functions.each:
            energy = np.concatenate([plant.energy(int(r), state[k : k + 1]) for k, r in enumerate(rows)])
        else:
            energy = plant.energy(0, state)
        kinetic, potential = energy[:, 0], energy[:, 1]
        self._lowest[rows] = np.fmin(self._lowest[rows], potential)
        self._highest[rows] = np.fmax(self._highest[rows], potential)
        displacement = np.abs(state[:, :n] - self._first[rows, :n])
        self._work[rows] = np.fmax(self._work[rows], (np.abs(energy[:, 3:]) * displacement).sum(axis=1))
        possible = np.abs(self._kinetic[rows]) + self._highest[rows] - self._lowest[rows] + self._work[rows]
        for k in np.flatnonzero(np.abs(kinetic) > LARGEST_ENERGY_GAIN * possible + 1e-3):
            run = int(rows[k])
            text = f"the kinetic energy of a robot that nothing drives became {kinetic[k]:.3g} J"
            watch.end(run, Status.DIVERGED, float(t[k]), f"{text} at {t[k]:.6g} s", state[k])
