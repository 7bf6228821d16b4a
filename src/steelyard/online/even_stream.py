"""Samples as they arrive, made even: what is late, repeated, missing or not a number is found, mended or left out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from steelyard.recording.diagnosis.detectors import resolution
from steelyard.recording.survey import STEADY

from .saved_state import Stateful
from .torque_limits import ALIKE, TorqueLimits

__all__ = ["EvenStream", "Stretch"]

Array = NDArray[np.float64]

ON_TIME = 1e-3
"""Part of the sample time by which a time stamp may be off and count as even: nothing moves in a microsecond."""

RATE_OFF = 0.05
"""Relative difference between the rate that was said and the rate that is measured, from which it is told."""

GREATEST = 1e12
"""No position, time or torque is greater; a damaged message may hold 1e308, whose square is no number any more."""

KEPT = 5000
"""The newest samples among which torques at a limit are looked for."""


@dataclass(eq=False)
class Stretch:
    """Even samples that follow each other.

    Attributes
    ----------
    begins : bool
        Whether samples are missing before it, so that filters must start anew.
    t : (S,)
    values : (S, C)
        Positions, and what derivatives are measured.
    torque : (S, N)
        Zero where it is missing.
    used : (S, N) of bool
        Where there is a torque.
    """

    begins: bool
    t: Array = field(repr=False)
    values: Array = field(repr=False)
    torque: Array = field(repr=False)
    used: NDArray[np.bool_] = field(repr=False)


class EvenStream(Stateful):
    """Puts samples at even times, by linear interpolation between neighbours that are near enough.

    Parameters
    ----------
    rate : float
        Hz.
    longest_gap : float
        s; over longer ones nothing is interpolated.

    Attributes
    ----------
    counts : dict
        Samples received, those left out and why, and how often samples were missing.
    limits : TorqueLimits
        At which the torques that came stand.
    """

    _STATE = (
        "counts",
        "limits",
        "_newest",
        "_written",
        "_last",
        "_origin",
        "_next",
        "_begins",
        "_time",
        "_steps",
        "_away",
    )

    def __init__(self, rate: float, joints: int, longest_gap: float) -> None:
        self.rate, self.joints, self.longest_gap = rate, joints, longest_gap
        self.counts = dict.fromkeys(
            ("received", "not finite", "repeated", "late", "interpolated", "gaps", "clock resets", "torques missing"), 0
        )
        self.limits = TorqueLimits(joints, rate)
        self._newest = np.full((KEPT, 2 * joints), np.nan)  # positions and torques, in a ring
        self._written = 0
        self._last: Array | None = None
        self._origin, self._next = 0.0, 0
        self._begins = True
        self._time, self._steps, self._away = 0.0, 0, 0.0

    def add(self, rows: Array) -> list[Stretch]:
        """Add rows of time, values and torque, (S, 1 + C + N), in the order in which they came."""
        self.counts["received"] += len(rows)
        with np.errstate(invalid="ignore"):
            sane = np.abs(rows) <= GREATEST
        rows = np.where(sane, rows, np.nan)
        finite = np.isfinite(rows[:, : -self.joints]).all(axis=1)
        if not finite.all():
            self.counts["not finite"] += int(np.sum(~finite))
            rows = rows[finite]
        newest = rows[-KEPT:]
        places = (self._written + np.arange(len(newest))) % KEPT
        self._newest[places, : self.joints] = newest[:, 1 : 1 + self.joints]
        self._newest[places, self.joints :] = newest[:, -self.joints :]
        self._written += len(newest)
        self.limits.learn(newest[:, -self.joints :], self._while_moving)
        found: list[Stretch] = []
        previous = None if self._last is None else float(self._last[0])
        steps = np.diff(rows[:, 0], prepend=rows[0, 0] if previous is None and len(rows) else previous or 0.0)
        if np.all((steps > 0.0) & (steps <= self.longest_gap)):
            return self._joined(rows, found)
        kept: list[int] = []
        for index, t in enumerate(rows[:, 0].tolist()):
            step = np.inf if previous is None else t - previous
            if step == 0.0:
                self.counts["repeated"] += 1
                continue
            if -self.longest_gap <= step < 0.0:
                self.counts["late"] += 1
                continue
            if not 0.0 < step <= self.longest_gap:
                if previous is not None:
                    self.counts["gaps" if step > 0.0 else "clock resets"] += 1
                    self._away += max(step, 0.0)
                self._joined(rows[kept], found)
                self._last, self._begins, kept = None, True, []
            previous = t
            kept.append(index)
        return self._joined(rows[kept], found)

    def begin_anew(self) -> None:
        """Let the next row begin a stretch of its own, as after a gap."""
        self._last, self._begins = None, True

    def _joined(self, rows: Array, found: list[Stretch]) -> list[Stretch]:
        """Put the next rows of one stretch at even times."""
        if not len(rows):
            return found
        if self._last is None:
            self._origin, self._next = float(rows[0, 0]), 0
        else:
            self._time += float(rows[-1, 0] - self._last[0])
            self._steps += len(rows)
        grid = self._origin + (self._next + np.arange(len(rows))) / self.rate
        if not np.all(np.abs(rows[:, 0] - grid) <= ON_TIME / self.rate):
            last = int(np.floor((rows[-1, 0] - self._origin) * self.rate + ON_TIME))
            grid = self._origin + np.arange(self._next, last + 1) / self.rate
            known = rows if self._last is None else np.vstack([self._last, rows])
            self._last = rows[-1]
            if not len(grid):
                return found
            rows, between = _between(known, grid, ON_TIME / self.rate)
            self.counts["interpolated"] += between
        else:
            self._last = rows[-1]
        self._next += len(grid)
        torque = rows[:, -self.joints :]
        used = np.isfinite(torque)
        if not used.all():
            self.counts["torques missing"] += int(np.sum(~used))
            torque = np.where(used, torque, 0.0)
        found.append(Stretch(self._begins, grid, rows[:, 1 : -self.joints], torque, used))
        self._begins = False
        return found

    def _while_moving(self, joint: int) -> Array:
        """Return the torques of a joint (M,) among the newest samples where its position changed, the oldest first."""
        newest = np.roll(self._newest[:, [joint, self.joints + joint]], -(self._written % KEPT), axis=0)
        moved = np.diff(newest[:, 0], prepend=np.nan) != 0.0
        return np.asarray(newest[moved & np.isfinite(newest[:, 1]), 1])

    def at_limit(self) -> Array:
        """Return the part (N,) of the newest samples in which the torque of a joint that moves stands at a limit."""
        found = np.zeros(self.joints)
        for joint in np.flatnonzero(self.limits.known).tolist():
            shown = self._while_moving(joint)
            low, high = self.limits.levels[joint]
            found[joint] = np.mean((shown <= low) | (shown >= high)) if len(shown) else 0.0
        return found

    def never_changes(self) -> NDArray[np.bool_]:
        """Return of which joints (N,) that move the torque is the same in all of the newest samples."""
        found = np.zeros(self.joints, dtype=bool)
        for joint in range(self.joints):
            shown, q = self._while_moving(joint), self._newest[:, joint]
            still = len(shown) > ALIKE and np.ptp(shown) == 0.0
            found[joint] = still and np.nanmax(q) - np.nanmin(q) > STEADY
        return found

    def encoder_steps(self) -> Array:
        """Return the steps (N,) of the encoders, rad or m, by the newest samples; 0 where none is seen."""
        return resolution(self._newest[np.isfinite(self._newest[:, 0]), : self.joints])

    @property
    def measured_rate(self) -> float:
        """Samples a second without gaps, Hz; NaN before there are a hundred."""
        return self._steps / self._time if self._steps >= 100 and self._time > 0.0 else float("nan")

    def remarks(self) -> tuple[str, ...]:
        """Return what the user should know of the samples, in sentences."""
        count, found = self.counts, []
        ms = 1e3 * self.longest_gap
        for key, text in (
            (
                "not finite",
                "samples had a time or a position that is no finite number, or beyond 1e12, as times since 1970 are in "
                "ms and ns, where s are expected; they were left out",
            ),
            ("repeated", "samples had the time stamp of the one before; they were left out"),
            ("late", "samples had a time before that of the one before; they were left out"),
            (
                "torques missing",
                "torques of single joints were no finite numbers, or beyond 1e12; these joints' rows were left out",
            ),
            (
                "interpolated",
                f"samples were missing, or came at uneven times or not quite at {self.rate:.4g} Hz; "
                "they were interpolated",
            ),
            ("gaps", f"times samples were missing for more than {ms:g} ms; the filters started anew each time"),
            ("clock resets", f"times the clock went back by more than {ms:g} ms; the filters started anew each time"),
        ):
            if count[key]:
                found.append(f"{count[key]} {text}.")
        if 2 * count["repeated"] > count["received"]:
            found.append(
                "Most samples have the time stamp of the one before; give each its own time, in double precision: in "
                "single precision times since 1970 are 128 s apart."
            )
        if 2 * count["gaps"] > count["received"]:
            found.append(
                f"Most samples are {self._away / count['gaps']:.4g} s after the one before, so that nothing is learnt "
                f"from them at the {self.rate:.4g} Hz that were said; give times in s, and the `rate` at which samples "
                "come."
            )
            return tuple(found)
        measured = self.measured_rate
        if abs(measured - self.rate) > RATE_OFF * self.rate:
            found.append(
                f"Samples come at {measured:.4g} Hz, not at the {self.rate:.4g} Hz that were said; "
                f"give rate={measured:.4g}."
            )
        return tuple(found)


def _between(known: Array, t: Array, on_time: float) -> tuple[Array, int]:
    """Rows at times between those of known rows, and how many are none of these.

    They are not a number beside a torque that is none. A row that came within `on_time` of its time is taken as it is,
    so that what is missing elsewhere in a batch changes nothing of it.
    """
    place = np.clip(np.searchsorted(known[:, 0], t, side="right"), 1, max(len(known) - 1, 1))
    if len(known) == 1:
        return np.repeat(known, len(t), axis=0), 0
    before, after = known[place - 1], known[place]
    is_before, is_after = t - before[:, 0] <= on_time, after[:, 0] - t <= on_time
    share = ((t - before[:, 0]) / (after[:, 0] - before[:, 0]))[:, None]
    found = np.where(is_before[:, None], before, np.where(is_after[:, None], after, before + share * (after - before)))
    return np.asarray(found), int(np.sum(~(is_before | is_after)))
