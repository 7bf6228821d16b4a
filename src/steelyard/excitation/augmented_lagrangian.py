"""Minimises the criterion under all the limits: augmented Lagrangian over L-BFGS.

Limits are weighted by multipliers that learn from their violation (Hestenes 1969; Nocedal and Wright 2006, section
17.4), so that each minimisation in between is free of constraints. The smooth stand-in of the condition number is
sharpened from one to the next.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .design_problem import DesignProblem

__all__ = ["COARSE", "FINE", "Iterate", "Stopped", "minimise"]

Array = NDArray[np.float64]
COARSE: tuple[tuple[float, int], ...] = ((4.0, 60), (12.0, 80))
"""Sharpness and iterations of each round, from a random start."""

FINE: tuple[tuple[float, int], ...] = ((16.0, 150), (24.0, 150), (32.0, 200), (32.0, 200))
"""The same, from where the first rounds ended."""

_PENALTY = 15.0
_MEMORY = 20


class Stopped(Exception):  # noqa: N818 - not an error
    """Raised inside a minimisation that is to end."""


@dataclass
class Iterate:
    """Where a minimisation stands.

    Attributes
    ----------
    x : ndarray
        (N P,).
    multipliers : list of ndarray
        For each constraint, (S, m).
    """

    x: Array
    multipliers: list[Array]


def minimise(
    problem: DesignProblem,
    start: Iterate,
    rounds: Sequence[tuple[float, int]],
    stop: Callable[[], bool],
) -> Iterate:
    """Run some rounds.

    Parameters
    ----------
    problem : DesignProblem
    start : Iterate
        Its multipliers are empty at first.
    rounds : sequence of (float, int)
        Sharpness and largest number of iterations.
    stop : callable
        Asked before every evaluation; where it says True the work ends with what there is.

    Returns
    -------
    Iterate
    """
    import scipy.optimize

    minimize: Any = scipy.optimize.minimize  # its stubs know no further arguments with defaults
    now = Iterate(start.x.copy(), list(start.multipliers))
    if not now.multipliers:
        now.multipliers = [np.zeros((0, len(c.labels))) for c in problem.constraints]
    now.multipliers = [_padded(m, len(w)) for m, w in zip(now.multipliers, problem.looked_at, strict=True)]
    for sharpness, iterations in rounds:

        def evaluate(x: Array, sharpness: float = sharpness) -> tuple[float, Array]:
            if stop():
                raise Stopped
            return _augmented(problem, x, now.multipliers, sharpness)

        def keep(x: Array) -> None:
            now.x = np.array(x)

        try:
            found = minimize(
                evaluate,
                now.x,
                jac=True,
                method="L-BFGS-B",
                callback=keep,
                options={"maxiter": iterations, "maxfun": 2 * iterations, "maxcor": _MEMORY},
            )
        except Stopped:
            return now
        now.x = np.asarray(found.x)
        clearances = problem.clearances(problem.motion(now.x))
        now.multipliers = [
            np.maximum(0.0, m + _PENALTY * (problem.tightening - c))
            for m, c in zip(now.multipliers, clearances, strict=True)
        ]
    return now


def _padded(multipliers: Array, count: int) -> Array:
    return np.vstack([multipliers, np.zeros((count - len(multipliers), multipliers.shape[1]))])


def _augmented(problem: DesignProblem, x: Array, multipliers: Sequence[Array], sharpness: float) -> tuple[float, Array]:
    motion = problem.motion(x)
    value, slopes = problem.objective(motion, sharpness)
    total = [np.zeros_like(part) for part in motion]
    for whole, part in zip(total, slopes, strict=True):
        whole[: problem.judged] = part
    for constraint, known, where in zip(problem.constraints, multipliers, problem.looked_at, strict=True):
        scale = np.asarray(constraint.scale)
        q, dq, ddq = motion if len(where) == len(motion[0]) else tuple(part[where] for part in motion)
        push = known + _PENALTY * (problem.tightening - np.asarray(constraint.clearance(q, dq, ddq)) / scale)
        np.maximum(push, 0.0, out=push)
        if not push.any():
            continue
        value += float((push * push).sum()) / (2.0 * _PENALTY)
        for whole, part in zip(total, constraint.vjp(q, dq, ddq, -push / scale), strict=True):
            whole[where] += part
    return value, problem.chain(total, problem.basis)
