"""The state of the bristles of Dahl's and LuGre's friction along a motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.robot import Robot
from steelyard.robot.robot import PRESLIDING

__all__ = ["BristleStates", "Bristles", "bristle_states", "bristle_step"]

Array = NDArray[np.float64]


class BristleStates(NamedTuple):
    """States of bristles along a motion.

    Attributes
    ----------
    states : ndarray
        (S, K) the deflection u of each, over that of steady sliding with Coulomb friction.
    rates : ndarray
        (S, K) ``d du/dt``, rad/s or m/s.
    weights : ndarray
        (S, K) what a change of the state at the beginning changes here: 1 there, and near 0 once a joint has slid.
    """

    states: Array
    rates: Array
    weights: Array


def bristle_states(
    q: ArrayLike,
    dq: ArrayLike,
    displacement: ArrayLike,
    ratio: ArrayLike = 0.0,
    velocity: ArrayLike = 1.0,
    *,
    starts: Sequence[int] = (0,),
    first: ArrayLike = 0.0,
) -> BristleStates:
    """Integrate the states of bristles along a measured motion.

    The state u of LuGre friction follows ``du/dt = (dq - |dq| u / g(dq)) / d`` with ``g(dq) = 1 + r exp(-(dq / v)²)``.
    Over a step in which the joint moves one way at one speed this has a closed form, which is taken; Dahl's is the case
    r = 0.

    Parameters
    ----------
    q, dq : array_like
        (S, K) rad or m, and per s, row after row in time; or (S, 1), where all K have the same motion.
    displacement, ratio, velocity : array_like
        (K,) the presliding displacement d (rad or m), what breaks away above Coulomb friction, relative to that (r),
        and the Stribeck velocity v.
    starts : sequence of int
        Rows at which a motion begins, so that nothing is remembered from the row before.
    first : array_like
        (K,) the states at these rows.

    References
    ----------
    P. R. Dahl, A solid friction model, Aerospace Corporation, 1968. C. Canudas de Wit et al., A new model for control
    of systems with friction, IEEE Transactions on Automatic Control 40, 1995.

    Examples
    --------
    A joint that starts to slide gets to Coulomb friction over its presliding displacement:

    >>> q = np.linspace(0.0, 0.05, 6)[:, None]
    >>> bristle_states(q, np.full_like(q, 0.1), [0.01]).states[:, 0].round(3)
    array([0.   , 0.632, 0.865, 0.95 , 0.982, 0.993])
    """
    positions, speeds = (np.asarray(one, dtype=np.float64) for one in (q, dq))
    numbers = (np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in (displacement, ratio, velocity, first))
    d, r, v, u = np.broadcast_arrays(*numbers)
    bound = 1.0 + r * np.exp(-np.minimum((speeds / v) ** 2, 700.0))  # (S, K)
    moved = np.diff(positions, axis=0, prepend=positions[:1])
    middle = 0.5 * (bound + np.vstack([bound[:1], bound[:-1]]))
    passed, kept, pulled = bristle_step(moved, middle, d, np)
    begun = list(starts)
    passed[begun], kept[begun], pulled[begun] = 0.0, 0.0, u
    states = _recursion(kept, pulled)
    total = np.cumsum(passed, axis=0)
    rows = np.searchsorted(begun, np.arange(len(total)), side="right") - 1
    return BristleStates(states, speeds - np.abs(speeds) * states / bound, np.exp(total[begun][rows] - total))


def bristle_step(moved: Any, bound: Any, displacement: Any, algebra: Any) -> tuple[Any, Any, Any]:
    """Return what one step does to the state u of bristles, over generic scalars: ``kept * u + pulled`` comes after it.

    It is exact where the joint moves one way and breaks away at one deflection, as at one speed.

    Parameters
    ----------
    moved : scalar
        By how much the joint moves, rad or m, with its sign.
    bound : scalar
        Deflection g at which the bristles break away.
    displacement : scalar
        Presliding displacement d, rad or m.
    algebra : module
        Brings ``sign`` and ``exp`` for the scalars.

    Returns
    -------
    passed, kept, pulled : scalar
        The way in units of ``d g``, and how the state changes.
    """
    way = algebra.sign(moved)
    passed = way * moved / (displacement * bound)
    kept = algebra.exp(-passed)
    return passed, kept, way * bound * (1.0 - kept)


def _recursion(factors: Array, terms: Array) -> Array:
    """Return u with ``u[k] = factors[k] u[k - 1] + terms[k]`` along the first axis, by doubling the steps."""
    found, reach, factors = terms.copy(), 1, factors.copy()
    while reach < len(found) and factors[reach:].any():
        found[reach:] += factors[reach:] * found[:-reach].copy()
        factors[reach:] *= factors[:-reach].copy()
        reach *= 2
    return found


class Bristles:
    """The bristles of all the joints of a robot whose friction has some.

    Attributes
    ----------
    joints : ndarray of int
        (K,) coordinates whose friction has a state, from 0.
    shapes : ndarray
        (3, K) displacements, ratios and velocities.
    """

    channel = PRESLIDING
    """Name of the channel that their states are."""

    def __init__(self, robot: Robot) -> None:
        found = {}
        for k in range(robot.dof):
            told = [shape for term in robot.terms if (shape := term.bristles(k)) is not None]
            if told:
                found[k] = told[0]
        self.dof = robot.dof
        self.joints = np.array(list(found), dtype=np.intp)
        self.shapes = np.array(list(found.values())).reshape(-1, 3).T

    def are(self, others: Bristles) -> bool:
        """Whether these have the states of others, in any motion."""
        return np.array_equal(self.joints, others.joints) and np.array_equal(self.shapes, others.shapes)

    def along(
        self, q: Array, dq: Array, starts: Sequence[int] = (0,), first: Array | None = None
    ) -> tuple[Array, Array]:
        """Return states and weights (S, N) along a motion (S, N); zeros, of weight zero, at the other joints.

        `first` are the states (N,) at the rows where it begins, zeros where they are not known.
        """
        own = self.joints
        states, weights = np.zeros((2, len(q), self.dof))
        if len(q) and len(own):
            known = 0.0 if first is None else first[own]
            found = bristle_states(q[:, own], dq[:, own], *self.shapes, starts=starts, first=known)
            states[:, own], weights[:, own] = found.states, found.weights
        return states, weights
