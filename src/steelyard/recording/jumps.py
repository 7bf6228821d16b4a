"""Positions that jump: by whole turns, to a wild reading and back, or to where they stay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.display import joint_label
from steelyard.files.arguments import LARGEST

from .samples import column_extremes

__all__ = ["position_jumps", "turn_remarks", "turned_on", "without_wild"]

TURN = 2.0 * np.pi
STEADY = 0.5
"""rad that a joint moves between two rows at most, at a jump and in the steps on either side of it: 25 rad/s at 50 Hz.
Motors in front of gears turn faster, and what jumps there stays as it is."""

SUDDEN = 20.0
"""rad/s or m/s by which no joint changes its velocity from one row to the next. Knees of legged robots turn at this
speed, wrists of arms at a third of it; a link of an arm that meets a wall loses less."""

LEAST_JUMP = 0.05
"""rad or m; a smaller jump may be one count of a coarse encoder. Five of twice the size in 20 s of an arm that moves at
1 rad/s move estimates by as much as noise does."""

FEW = 0.01
"""Part of the rows of a joint up to which single positions count as wild: more are no readings that went wrong."""


@np.errstate(over="ignore", invalid="ignore")  # the step between two huge numbers is infinite, and no turn
def turned_on(q: NDArray[np.float64]) -> tuple[NDArray[np.float64], tuple[int, ...]]:
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
    low, high = column_extremes(q)
    far = ~(high - low <= TURN - STEADY)  # true also where values are missing
    for j in map(int, np.flatnonzero(far)):  # no step of the others is as long
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


@np.errstate(over="ignore", invalid="ignore")
def without_wild(t: NDArray[np.float64], q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make single positions missing that are far from both their neighbours, which are near each other.

    A filter makes an acceleration of a wild reading over its whole response, which the model takes for true: *measured*
    on an arm of three joints, five readings that were 1 rad off, of 20 000, moved estimates by up to 10 standard
    errors, and the prediction was good.

    Parameters
    ----------
    t : ndarray
        (S,) s.
    q : ndarray
        (S, N), rad or m; NaN where values are missing.

    Returns
    -------
    ndarray
        (S, N), `q` itself where nothing is wild.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(200) / 100
    >>> angle = np.sin(t)[:, None]
    >>> angle[70] += 1.0
    >>> np.flatnonzero(np.isnan(without_wild(t, angle))).tolist()
    [70]
    """
    result = q
    for j in range(q.shape[1]) if len(q) >= 3 else ():
        steps = np.diff(q[:, j])
        far = np.flatnonzero(np.abs(steps) > LEAST_JUMP)
        rows = np.intersect1d(far + 1, far, assume_unique=True)  # with a long step before and one after
        if not len(rows) or rows.size > FEW * len(q):
            continue
        most = np.maximum(SUDDEN * (t[rows + 1] - t[rows - 1]), LEAST_JUMP)
        before, after = steps[rows - 1], steps[rows]
        off = (np.minimum(np.abs(before), np.abs(after)) > most) & (np.abs(before + after) <= most)
        off &= np.abs(q[rows, j]) <= LARGEST  # beyond it is damage, for which a log is refused
        if off.any():
            result = result.copy() if result is q else result
            result[rows[off], j] = np.nan
    return result


@np.errstate(over="ignore", invalid="ignore")
def position_jumps(t: NDArray[np.float64], q: NDArray[np.float64]) -> tuple[NDArray[np.intp], ...]:
    """Find rows whose position is further from the row before than a joint moves, and which the next rows follow.

    An encoder does so that slips, is set to another zero, or goes on after it stood still; and two runs without a pause
    between their stamps. A filter makes a push of it that no torque explains.

    Parameters
    ----------
    t : ndarray
        (S,) s.
    q : ndarray
        (S, N), rad or m, without wild readings.

    Returns
    -------
    tuple of ndarray
        The rows of each joint; none where they are so many that the position is noise, or another quantity.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(200) / 100
    >>> angle = np.sin(t)[:, None]
    >>> angle[70:] += 1.0
    >>> [rows.tolist() for rows in position_jumps(t, angle)]
    [[70]]
    """
    found = []
    for steps in np.diff(q, axis=0).T:
        here = steps[1:-1]
        off = np.minimum(np.abs(here - steps[:-2]), np.abs(here - steps[2:]))
        rows = np.flatnonzero(off > np.maximum(SUDDEN * np.diff(t)[1:-1], LEAST_JUMP)) + 2
        found.append(rows if rows.size <= FEW * len(q) else rows[:0])
    return tuple(found)


def turn_remarks(q: NDArray[np.float64], joint_names: Sequence[str] | None = None) -> tuple[str, ...]:
    """Say of which joints positions (S, N) jump by whole turns, which reading takes out."""
    return tuple(
        f"The position of {joint_label(j, joint_names)} jumps by a turn {count} "
        f"time{'s' * (count > 1)}: it was logged modulo a turn, and was put together."
        for j, count in enumerate(turned_on(q)[1])
        if count
    )
