"""Friction that drifts within a log, as it does while a gear warms up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .body_change import FRICTION
from .time_blocks import TimeBlocks

__all__ = ["FrictionDrift", "drift_sentence", "friction_drifts"]

Array = NDArray[np.float64]

FEWEST_BLOCKS = 8
"""A line through fewer has a slope of which little is known."""
SURE = 6.0
"""Slope over its standard error. Errors of the model last longer than noise, so that single sound joints come to 3.2.
Warming up with one time constant is curved: over three of them it comes to 9.6."""
STEADY = 0.8
"""Part of the variance between blocks that a line must explain: what jumps, or goes to and fro, is no drift. Warming up
has 0.88, sound logs up to 0.51."""
LEAST = 0.05
"""Change over the log, relative to the mean friction, below which it is not told."""
WORTH = 0.02
"""Part of the error of the joint, white noise included, that must vanish with the drift: half and more where
friction falls by a third, up to 0.7 % on sound logs, real ones among them."""
MOST_SAID = 3


@dataclass(frozen=True)
class FrictionDrift:
    """Friction of a joint that grows or falls in the course of a log.

    Attributes
    ----------
    joint : int
        From 0.
    first, last : float
        Friction at the begin and the end of the log, relative to its mean: 1.2 is a fifth more.
    changes : dict of str to float
        Parameters of this friction, and how many times the change of the friction the change of one is, relative to
        its mean, where it alone changes.
    """

    joint: int
    first: float
    last: float
    changes: Mapping[str, float] = field(default_factory=dict)


def friction_drifts(blocks: TimeBlocks, base_names: Sequence[str]) -> tuple[FrictionDrift, ...]:
    """Find joints whose viscous and Coulomb friction grows or falls steadily in the course of a log.

    In each block of time the friction that the rows of the whole log show is scaled so that it explains most of what
    they leave there. A line through these scales tells whether friction drifts.

    Parameters
    ----------
    blocks : TimeBlocks
        Of one log.
    base_names : sequence of str
        Of the base parameters of the blocks; friction is known by the names ``Fvj1``, ``Fcj1``, ``Fvm1`` and so on.

    Returns
    -------
    tuple of FrictionDrift
        The largest change first; empty where the log is too short to tell.

    Examples
    --------
    Friction of 2 N·m that falls to 1 while a joint without inertia goes to and fro:

    >>> from steelyard.regression.factor import Factor
    >>> t = np.linspace(0.0, 1.0, 6400)
    >>> side = np.sign(np.sin(400 * t))
    >>> rows = np.column_stack([side, (2.0 - t) * side + np.random.default_rng(0).normal(0.0, 0.1, 6400)])
    >>> blocks = TimeBlocks((Factor(0, np.array([0]), np.zeros((2, 2)), 0),))
    >>> blocks.add([rows])
    >>> [drift] = friction_drifts(blocks, ["Fcj1"])
    >>> round(drift.first, 1), round(drift.last, 1)
    (1.3, 0.7)
    """
    found = []
    held = blocks.held
    for joint, factor in enumerate(blocks.empty):
        friction = [place for place, column in enumerate(factor.columns) if FRICTION.match(base_names[column])]
        parts = [(int(counts[joint]), kept[joint]) for counts, kept in held if counts[joint] > 0]
        if not friction or len(parts) < FEWEST_BLOCKS:
            continue
        names = [str(base_names[factor.columns[place]]) for place in friction]
        drift = _drift(joint, friction, names, [count for count, _ in parts], [rows for _, rows in parts])
        if drift is not None:
            found.append(drift)
    return tuple(sorted(found, key=lambda one: -abs(one.last - one.first)))


def drift_sentence(log: str, drifts: Sequence[FrictionDrift], joint_names: Sequence[str]) -> str:
    """Say it of the joints of a log: drifts of one joint at least, the largest change first.

    Examples
    --------
    >>> drift_sentence("a.csv", [FrictionDrift(0, 1.2, 0.85)], ["elbow"])
    'In a.csv friction changes steadily with time: at elbow it goes from 120 % to 85 % of its mean.'
    """
    each = [f"at {joint_names[one.joint]} it goes from {one.first:.0%} to {one.last:.0%}" for one in drifts[:MOST_SAID]]
    each = [part.replace("%", " %") for part in each]
    more = f"; and at {len(drifts) - MOST_SAID} more joints" if len(drifts) > MOST_SAID + 1 else ""
    more = "; and at one more joint" if len(drifts) == MOST_SAID + 1 else more
    return f"In {log} friction changes steadily with time: {', '.join(each)} of its mean{more}."


def _drift(
    joint: int, friction: Sequence[int], names: Sequence[str], counts: Sequence[int], parts: Sequence[Array]
) -> FrictionDrift | None:
    whole = np.vstack(parts)
    lengths = np.linalg.norm(whole[:, :-1], axis=0)
    lengths[lengths == 0.0] = 1.0
    own = np.linalg.lstsq(whole[:, :-1] / lengths, whole[:, -1], rcond=1e-9)[0] / lengths
    scales: list[float] = []
    weights: list[float] = []
    left = 0.0
    for rows in parts:
        shown = rows[:, friction] @ own[friction]
        error = rows[:, -1] - rows[:, :-1] @ own
        norm2 = float(shown @ shown)
        left += float(error @ error)
        weights.append(norm2)
        scales.append(1.0 + float(shown @ error) / norm2 if norm2 > 0.0 else 1.0)
    scale, weight = np.array(scales), np.array(weights)
    ends = np.cumsum(counts, dtype=float)
    time = (ends - 0.5 * np.asarray(counts)) / ends[-1]
    if not weight.sum() > 0.0 or not left > 0.0:
        return None
    time0, scale0 = np.average(time, weights=weight), np.average(scale, weights=weight)
    spread = float(weight @ (time - time0) ** 2)
    slope = float(weight @ ((time - time0) * (scale - scale0))) / spread
    variance, unexplained = (float(weight @ (scale - scale0 - b * (time - time0)) ** 2) for b in (0.0, slope))
    if not variance > 0.0 or unexplained > (1.0 - STEADY) * variance:
        return None
    significance = abs(slope) / np.sqrt(max(unexplained, 1e-12 * variance) / (len(scale) - 2) / spread)
    if significance < SURE or abs(slope) < LEAST or slope**2 * spread < WORTH * left:
        return None
    first, last = (float(scale0 + slope * (end - time0)) for end in (0.0, 1.0))
    each = whole[:, friction] * own[friction]
    norms2 = np.sum(each**2, axis=0)
    norms2[norms2 == 0.0] = np.inf
    alone = each.T @ each.sum(axis=1) / norms2
    return FrictionDrift(joint, first, last, dict(zip(names, map(float, alone), strict=True)))
