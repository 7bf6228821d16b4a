"""Positions that were logged modulo a turn are put together again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["turn_remarks", "turned_on"]

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
STEADY = 0.5
"""rad that a joint moves between two rows at most, at a jump and in the steps on either side of it: 25 rad/s at 50 Hz.
Motors in front of gears turn faster, and what jumps there stays as it is."""


def turned_on(q: Array) -> tuple[Array, tuple[int, ...]]:
    """Take jumps by a whole turn out of positions, as encoders of joints that turn on and on make them.

    A jump counts where the joint moves on after it as before: what is left of the step without the turn is small, and
    so are the steps before and after. No joint that slides jumps by 6.283 m.

    Parameters
    ----------
    q : ndarray
        (S, N), rad or m; NaN where values are missing.

    Returns
    -------
    ndarray
        (S, N), with the first row as it was; `q` itself where nothing jumps.
    tuple of int
        How many jumps each joint had.

    Examples
    --------
    >>> import numpy as np
    >>> angle = np.linspace(0.0, 15.0, 200)
    >>> found, jumps = turned_on(np.mod(angle, 2 * np.pi)[:, None])
    >>> bool(np.allclose(found[:, 0], angle)), jumps
    (True, (2,))
    """
    jumps = np.zeros(q.shape[1], dtype=int)
    result = q
    for j in range(q.shape[1]):
        there = np.flatnonzero(np.isfinite(q[:, j]))
        steps = np.diff(q[there, j])
        of_turns = np.flatnonzero(np.abs(np.abs(steps) - TURN) < STEADY)
        if not len(of_turns) or np.median(np.abs(steps)) >= STEADY:
            continue
        # Noise makes several jumps in a row, to and fro; the steps before and after them are small.
        others = np.delete(np.arange(-1, len(steps) + 1), of_turns + 1)
        small = np.concatenate([[True], np.abs(steps) < STEADY, [True]])[others + 1]
        after = np.searchsorted(others, of_turns)
        of_turns = of_turns[small[after - 1] & small[after]]
        jumps[j] = len(of_turns)
        if len(of_turns):
            change = np.zeros(len(there))
            change[of_turns + 1] = -np.sign(steps[of_turns]) * TURN
            turns = np.cumsum(change)
            result = result.copy() if result is q else result
            result[there, j] += turns
    return result, tuple(jumps.tolist())


def turn_remarks(q: Array, joint_names: Sequence[str] | None = None) -> tuple[str, ...]:
    """Say of which joints positions (S, N) jump by whole turns, which reading takes out."""
    return tuple(
        f"The position of joint {j + 1}{'' if joint_names is None else f' ({joint_names[j]})'} jumps by a turn {count} "
        f"time{'s' * (count > 1)}: it was logged modulo a turn, and was put together."
        for j, count in enumerate(turned_on(q)[1])
        if count
    )
