"""Choice of the friction that a drive has beside the usual, by simulating stretches that are left out of the fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from steelyard.display import few_digits
from steelyard.errors import InputError
from steelyard.robot import Robot

from .drive_logs import LEAST_ROWS
from .drive_settings import BY_LOAD, BY_POSITION, SPRING
from .shooting import COARSEST_STEP, PositionLog, Shooting

__all__ = ["DriveChoice", "choose_drive_terms"]

Array = NDArray[np.float64]
Terms = tuple[frozenset[str], ...]

STRETCHES = 4
"""The number of stretches that are left out in turn, of all logs together; each log is one stretch at least."""

BETTER = 0.02
"""By how much the error on stretches that are left out must fall for a term, as in the choice by torques."""

SETTLED = 1e-3
"""Relative change of the squared error with which these searches end: a twentieth of what a term must gain. On a leg
robot that is after 3 steps, where 1e-6 takes up to 16 for the last 0.02 %."""

SHARE = 0.25
"""The share of a joint's way that must be in what is left, for a stretch to say something of it."""

WORDS = {
    BY_POSITION: "Coulomb friction that varies over the travel",
    BY_LOAD: "Coulomb friction that grows with the load",
    SPRING: "a spring",
}


@dataclass(frozen=True, eq=False)
class DriveChoice:
    """Terms that were chosen.

    Attributes
    ----------
    terms : tuple of frozenset of str
        Of each joint, beside the usual.
    stated : tuple of frozenset of str
        Those that were there before.
    plain_error, error : ndarray
        (N,) rms of the positions in stretches that were left out, simulated from their commands, without what was
        chosen and with it; NaN for a joint of which no stretch says anything.
    stretches : int
        That were left out in turn.
    """

    terms: Terms
    stated: Terms
    plain_error: Array
    error: Array
    stretches: int

    def remarks(self, robot: Robot) -> list[str]:
        """Say what was chosen, and by what."""
        how = f"by leaving out {self.stretches} stretches of the logs of the fit in turn"
        added = {
            term: [
                name
                for name, own, before in zip(robot.joint_names, self.terms, self.stated, strict=True)
                if term in own - before
            ]
            for term in WORDS
        }
        if not any(added.values()):
            return [f"No term of friction was added: none predicts the joints better, {how}."]
        listed = "; ".join(f"{WORDS[term]} at {', '.join(names)}" for term, names in added.items() if names)
        before, after = (few_digits(1e3 * _together(one), 3) for one in (self.plain_error, self.error))
        return [
            f"Added: {listed}. Chosen {how}: the error in them is {after} instead of {before} mrad or mm (rms). "
            "Descriptions hold one Coulomb friction, the mean over the travel; drives.json holds all."
        ]


def choose_drive_terms(
    problem: Callable[[Sequence[frozenset[str]]], Shooting],
    logs: Sequence[PositionLog],
    stated: Sequence[frozenset[str]],
    weights: str,
    say: Callable[[str], None],
) -> DriveChoice:
    """Choose terms of drives joint by joint, by blocked validation.

    In each round every candidate is added at all joints that lack it, and fitted; one stretch of the logs after the
    other is left out, see :meth:`Shooting.left_out`. A joint takes the candidate that predicts it best, if the error
    falls by 2 % at least and in more than half of the stretches. Rounds end when no joint takes one. The simulations
    have steps of 5 ms, whose error is far below what models leave.

    Parameters
    ----------
    problem : callable
        From the terms of each joint to the problem.
    stated : sequence of frozenset of str
        What each joint has anyway.
    weights : {"joint", "equal"}
    say : callable
        Is told what is being done.
    """
    stretches = _stretches(logs)
    counts = _told(logs, stretches)

    def validated(terms: Sequence[frozenset[str]]) -> Array:
        """Squared errors (F, N) of what is left out."""
        return replace(problem(terms), longest_step=COARSEST_STEP).left_out(stretches, weights, SETTLED)

    current, errors = tuple(stated), validated(stated)
    first, open_joints = errors, np.ones(len(stated), dtype=bool)
    while open_joints.any():
        best, chosen = errors, list(current)
        for candidate, words in WORDS.items():
            trial = tuple(
                own | {candidate} if is_open else own for own, is_open in zip(current, open_joints, strict=True)
            )
            if trial == current:
                continue
            say(f"friction: leaving out {len(stretches)} stretches in turn, with {words}")
            found = validated(trial)
            for joint in range(len(current)):
                own = counts[:, joint]
                if own.sum() < 2 or trial[joint] == current[joint]:
                    continue
                falls = np.sum(found[own, joint] < errors[own, joint]) > 0.5 * own.sum()
                enough = found[own, joint].sum() < (1.0 - BETTER) ** 2 * errors[own, joint].sum()
                if falls and enough and found[own, joint].sum() < best[own, joint].sum():
                    best = np.where(np.arange(len(current)) == joint, found, best)
                    chosen[joint] = trial[joint]
        open_joints = np.array([new != old for new, old in zip(chosen, current, strict=True)])
        if not open_joints.any():
            break
        together = validated(chosen)
        if not np.sum(together[counts]) < np.sum(errors[counts]):  # what helps each joint alone, may not help all
            break
        current, errors = tuple(chosen), together
    sizes = np.array([end - begin for _, begin, end in stretches])
    before, after = (_rms(one, counts, sizes) for one in (first, errors))
    return DriveChoice(current, tuple(stated), before, after, len(stretches))


def _stretches(logs: Sequence[PositionLog]) -> list[tuple[int, int, int]]:
    """Part the logs: index of a log, and rows from one to before another."""
    total = sum(len(log.t) for log in logs)
    found = []
    for number, log in enumerate(logs):
        ends = np.linspace(0, len(log.t), 1 + max(1, round(STRETCHES * len(log.t) / total))).astype(int)
        found += [(number, int(begin), int(end)) for begin, end in pairwise(ends)]
    if total < STRETCHES * LEAST_ROWS:
        raise InputError(
            f"The logs have {total} rows, too few to choose friction by leaving out one stretch after the other; leave "
            "friction as it is stated, or record longer."
        )
    return found


def _told(logs: Sequence[PositionLog], stretches: Sequence[tuple[int, int, int]]) -> NDArray[np.bool_]:
    """Return whether each stretch says something of each joint (F, N): it moves there, and enough in what is left."""
    ways = np.array([np.abs(np.diff(logs[log].q[begin:end], axis=0)).sum(axis=0) for log, begin, end in stretches])
    whole = ways.sum(axis=0)
    return np.asarray((ways > 0.0) & (whole - ways > SHARE * whole))


def _rms(squares: Array, counts: NDArray[np.bool_], sizes: NDArray[np.intp]) -> Array:
    rows = np.sum(counts * sizes[:, np.newaxis], axis=0)
    found = np.full(squares.shape[1], np.nan)
    np.divide(np.sum(np.where(counts, squares, 0.0), axis=0), rows, out=found, where=rows > 0)
    return np.asarray(np.sqrt(found))


def _together(errors: Array) -> float:
    there = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(there**2))) if len(there) else 0.0
