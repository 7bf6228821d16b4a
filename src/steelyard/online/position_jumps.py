"""Positions as they arrive, held against the ones before: what no joint can do in one sample is no motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.recording.survey import STEADY, TURN, farthest

from .even_stream import GREATEST
from .saved_state import Stateful

__all__ = ["PositionJumps"]

Array = NDArray[np.float64]


class PositionJumps(Stateful):
    """Leaves out single positions that are far from both their neighbours, and tells where positions have jumped.

    A filter makes a jump of a position an acceleration of hundreds of rad/s² over its whole response, which the model
    takes for true: *measured* on an arm of three joints, five single readings that were 10 rad off, of 20 000, moved
    the estimate by up to 36 standard errors. The row before cannot tell a wild reading from an encoder that has slipped
    or has other units from now on; so a row that does not follow the one before waits for the next one.

    Parameters
    ----------
    rate : float
        Hz.
    rotates : ndarray of bool
        (N,): whether a jump of the joint by one turn is none.
    longest_gap : float
        s, over which nothing is known of the motion.

    Attributes
    ----------
    counts : dict
        Rows that were left out, jumps, and turns that were put together.

    Examples
    --------
    >>> q = np.sin(np.arange(100) / 1000.0)
    >>> q[40] += 1.0
    >>> q[70:] += 0.3
    >>> positions = PositionJumps(1000.0, np.array([True]), 0.02)
    >>> found = positions.add(np.column_stack([np.arange(100) / 1000.0, q, np.zeros(100)]))
    >>> [(begins, len(rows)) for begins, rows in found], positions.counts["wild"]
    ([(False, 69), (True, 30)], 1)
    """

    _STATE = ("counts", "_last", "_velocity", "_doubted", "_waiting", "_turns")

    def __init__(self, rate: float, rotates: NDArray[np.bool_], longest_gap: float) -> None:
        self.rate, self.rotates, self.longest_gap = rate, rotates, longest_gap
        self.counts = dict.fromkeys(("wild", "jumps", "turns"), 0)
        self._last: Array | None = None  # time and positions of the newest row that followed
        self._velocity: Array | None = None
        self._doubted: Array | None = None  # the same of a row that did not, and the whole row
        self._waiting = np.zeros(0)
        self._turns = np.zeros(len(rotates))

    def add(self, rows: Array) -> list[tuple[bool, Array]]:
        """Take rows of time, positions and more, (S, 1 + N + ...).

        Returns
        -------
        list of (bool, ndarray)
            Rows that follow each other, and whether the positions have jumped before them.
        """
        with np.errstate(invalid="ignore", over="ignore"):  # a damaged message may hold any number
            return self._added(rows) if len(rows) else []

    def _added(self, rows: Array) -> list[tuple[bool, Array]]:
        width = 1 + len(self.rotates)
        if self._turns.any():
            rows = rows.copy()
            rows[:, 1:width] += self._turns
        if self._last is not None and self._velocity is not None and self._doubted is None:
            known = np.vstack([self._last, rows[:, :width]])
            steps = np.diff(known, axis=0)
            in_order = np.all((steps[:, 0] > 0.0) & (steps[:, 0] <= self.longest_gap))
            if in_order and np.all(np.abs(known) <= GREATEST):
                times = np.maximum(steps[:, :1], 1.0 / self.rate)
                velocities = np.vstack([self._velocity, steps[:, 1:] / times])
                if np.all(np.abs(np.diff(velocities, axis=0)) * times <= farthest(times)):
                    self._last, self._velocity = known[-1], velocities[-1]
                    return [(False, rows)]
        return self._one_by_one(rows)

    def _one_by_one(self, rows: Array) -> list[tuple[bool, Array]]:
        width = 1 + len(self.rotates)
        found: list[tuple[bool, list[Array]]] = [(False, [])]
        before = self._turns.copy()
        for given in rows:
            row = given.copy()
            row[1:width] += self._turns - before
            own = row[:width]
            newest = self._last if self._doubted is None else self._doubted
            known = bool(np.all(np.abs(own) <= GREATEST))
            step = np.inf if newest is None or not known else float(own[0] - newest[0])
            if not known or -self.longest_gap <= step <= 0.0:
                # Left out by its time, or as no number, by who counts these; no reading beside one in doubt is better.
                if self._doubted is None or not known:
                    found[-1][1].append(row)
            elif not 0.0 < step <= self.longest_gap or own[0] - self._last_time() > self.longest_gap:
                self.counts["wild"] += self._doubted is not None
                self._last, self._velocity, self._doubted = own, None, None
                found[-1][1].append(row)
            else:
                self._next(row, own, found)
        return [(begins, np.array(kept)) for begins, kept in found if kept]

    def _last_time(self) -> float:
        assert self._last is not None
        return float(self._last[0])

    def _next(self, row: Array, own: Array, found: list[tuple[bool, list[Array]]]) -> None:
        assert self._last is not None
        rest = np.zeros(len(self.rotates))
        velocity = rest if self._velocity is None else self._velocity
        if self._follows(self._last, velocity, own) and not self._stays(velocity, own):
            self.counts["wild"] += self._doubted is not None
        elif self._doubted is None:
            turns = self._turns_between(self._last, velocity, own)
            if turns is None:
                self._doubted, self._waiting = own, row
                return
            self._turns += turns
            self.counts["turns"] += int(np.count_nonzero(turns))
            row[1 : 1 + len(turns)] += turns  # of which `own` is a part
        elif self._velocity is None and self._follows(
            self._doubted, self._velocity_between(self._last, self._doubted), own
        ):
            found[-1][1].append(self._waiting)  # a joint that turns fast when it is first seen
            self._last = self._doubted
        elif self._follows(self._doubted, velocity, own) or self._follows(self._doubted, rest, own):
            self.counts["jumps"] += 1
            found.append((True, [self._waiting]))
            self._last = self._doubted
        else:
            self.counts["wild"] += 1
            self._doubted, self._waiting = own, row
            return
        self._velocity = self._velocity_between(self._last, own)
        self._last, self._doubted = own, None
        found[-1][1].append(row)

    def _time_between(self, before: Array, after: Array) -> float:
        return max(float(after[0] - before[0]), 1.0 / self.rate)

    def _velocity_between(self, before: Array, after: Array) -> Array:
        return np.asarray((after[1:] - before[1:]) / self._time_between(before, after))

    def _away(self, before: Array, velocity: Array, after: Array) -> Array:
        """How far positions (N,) are from where a velocity leads."""
        return np.asarray(np.abs(after[1:] - before[1:] - velocity * self._time_between(before, after)))

    def _follows(self, before: Array, velocity: Array, after: Array) -> bool:
        farthest_away = farthest(np.array(self._time_between(before, after)))
        return bool(np.all(self._away(before, velocity, after) <= farthest_away))

    def _stays(self, velocity: Array, own: Array) -> bool:
        """Whether a row is nearer to the one in doubt than to those before: positions have jumped there.

        In the time of two samples a joint may get twice as far, so that the row after a small jump would follow those
        before it, too.
        """
        if self._doubted is None:
            return False
        assert self._last is not None
        to_doubted = min(self._away(self._doubted, v, own).max() for v in (velocity, np.zeros_like(velocity)))
        return bool(to_doubted < self._away(self._last, velocity, own).max())

    def _turns_between(self, before: Array, velocity: Array, after: Array) -> Array | None:
        """The whole turns (N,) without which a row follows the one before, rad; None where there are none."""
        steps = after[1:] - before[1:] - velocity * self._time_between(before, after)
        turns = np.where(self.rotates & (np.abs(np.abs(steps) - TURN) < STEADY), -np.sign(steps) * TURN, 0.0)
        moved = after.copy()
        moved[1:] += turns
        return turns if turns.any() and self._follows(before, velocity, moved) else None

    def remarks(self) -> tuple[str, ...]:
        """Return what the user should know of the positions, in sentences."""
        count, found = self.counts, []
        if count["wild"]:
            found.append(
                f"{count['wild']} samples had a position that is too far from those before and after for a joint to "
                "move there and back; they were left out."
            )
        if count["jumps"]:
            found.append(
                f"{count['jumps']} times positions jumped further than a joint moves in one sample, and stayed there; "
                "the filters started anew each time. See whether an encoder slipped, was set to another zero or stood "
                "still, and whether the units are the same throughout."
            )
        if count["turns"]:
            found.append(f"{count['turns']} times a position jumped by a turn, and was put together.")
        return tuple(found)
