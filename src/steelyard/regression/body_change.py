"""A body that was picked up or put down in the course of a log."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from .time_blocks import TimeBlocks

__all__ = ["BodyChange", "body_change"]

Array = NDArray[np.float64]

FEWEST_BLOCKS = 8
"""Of fewer nobody knows how much they differ anyway."""
CHANCE = 1e-8
"""Probability that blocks which differ anyway look like such a body at any of the boundaries."""
SHARE = 0.5
"""Part of how the blocks differ that the body must explain: sound logs, simulated and real, have up to 0.18, one of a
robot with a counterbalance that the model lacks 0.55; bodies of 0.5 to 3 kg in the middle 0.56 to 0.99."""
SURE = 6.0
"""Mass over its standard error."""
DRIFTS = 4.0
"""Friction that warms up has the shape of an exponential of so many time constants, or of a line, or of both."""
RANK = 1e-9
"""Squares of the motion, relative to those of the columns, below which a combination counts as not shown."""
RINGING = 0.5
"""s to cut off at the ends for the filters, and that they cut off already where they were left to choose."""
STEPS, LIGHTEST = 8, 1e-3
"""Steps from the linear answer to a point mass, and kg below which nothing is sought."""
_UPPER = np.triu_indices(3)
FRICTION = re.compile(r"F(v|c)[jm]\d+$")
"""Base parameters that are the friction of a joint or of a motor, by their names."""
_TERMS = re.compile(r"F\w+[jm]\d+$")


@dataclass(frozen=True)
class BodyChange:
    """A body at the end of a chain that is there in one part of a log only.

    Attributes
    ----------
    link : str
        That carries it.
    earliest, latest : float
        s, between which it was picked up or put down.
    first, last : float
        s, the begin and the end of the log.
    mass : float
        kg; negative where it was put down.
    standard_error : float
        kg, of the mass.
    """

    link: str
    earliest: float
    latest: float
    first: float
    last: float
    mass: float
    standard_error: float

    @property
    def trim(self) -> list[float]:
        """The seconds to cut off at both ends, so that the longer of the two parts is left."""
        before, after = self.earliest - self.first, self.last - self.latest
        cut = float(np.ceil(10.0 * (self.last - self.first - max(before, after) + RINGING)) / 10.0)
        return [RINGING, cut] if before >= after else [cut, RINGING]

    def sentence(self, log: str) -> str:
        """Say it of a log.

        Examples
        --------
        >>> BodyChange("flange", 11.8, 13.0, 0.0, 40.0, -0.52, 0.02).sentence("a.csv")
        'In a.csv the robot changes between 11.8 and 13.0 s: flange looks to put down a body of 0.52 ± 0.04 kg.'
        """
        what = "put down" if self.mass < 0.0 else "pick up"
        half = 2.0 * self.standard_error
        places = max(0, -int(np.floor(np.log10(max(half, 1e-9)))))
        weighs = f"{abs(self.mass):.{places}f} ± {half:.{places}f} kg"
        when = f"between {self.earliest:.1f} and {self.latest:.1f} s"
        return f"In {log} the robot changes {when}: {self.link} looks to {what} a body of {weighs}."

    def weighing(self, robot: str = "ROBOT") -> str:
        """Say by which command the two parts of the log tell more of it, as the end of a sentence."""
        return f"from both, in files of their own, `steelyard payload {robot} UNLOADED LOADED` tells what was carried."


def body_change(
    blocks: TimeBlocks, base_names: Sequence[str], bodies: Mapping[str, Array], first: float, last: float
) -> BodyChange | None:
    """Find a body that hangs on the end of a chain in the first or in the second part of a log.

    The blocks differ, by errors of the model in different motions too: as much as further parameters of the last link
    explain, free in every block. A point mass that comes or goes at one boundary must explain most of that, more than
    chance gives at any boundary, and more than steps of friction and offsets at the same time. Friction may drift.

    Parameters
    ----------
    blocks : TimeBlocks
        Of one log.
    base_names : sequence of str
        Of the base parameters of the blocks, n_b.
    bodies : mapping from str to (n_b, 10)
        What the ten parameters of a link at the end of a chain add to the base parameters, by the name of the link.
    first, last : float
        s, the begin and the end of the log.

    Returns
    -------
    BodyChange or None
        The most certain; None where there is none, or the log is too short to tell.

    Examples
    --------
    An arm of two links, in a vertical plane, that carries 2 kg from 60 % of 10 s on:

    >>> import steelyard as sy
    >>> from steelyard.regression.reduction import empty_factors
    >>> robot = sy.Robot.from_dh([(0, 0.4, 0, "q"), (0, 0.3, 0, "q")], gravity=(0, -9.81, 0))
    >>> model, random, t = sy.Model(robot), np.random.default_rng(0), np.linspace(0.0, 10.0, 2000)
    >>> q, dq, ddq = random.uniform(-2.0, 2.0, (3, 2000, 2))
    >>> arm, body = np.zeros((2, 20))
    >>> arm[[3, 5, 6, 9]], arm[[13, 15, 16, 19]] = (0.1, 0.1, -0.6, 3.0), (0.03, 0.03, -0.2, 2.0)
    >>> body[[13, 15, 16, 19]] = 0.02, 0.02, 0.2, 2.0
    >>> torque = model.inverse_dynamics(q, dq, ddq, arm)
    >>> torque[t > 6.0] += model.inverse_dynamics(q, dq, ddq, body)[t > 6.0]
    >>> samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque + random.normal(0.0, 0.5, (2000, 2)))
    >>> blocks, base = TimeBlocks(empty_factors(model)), model.base_parameters()
    >>> _ = sy.Information.from_chunks(model, [samples], blocks=blocks)
    >>> body_change(blocks, base.names, {"link2": base.K[:, 10:]}, 0.0, 10.0).sentence("a.csv")
    'In a.csv the robot changes between 5.8 and 6.4 s: link2 looks to pick up a body of 2.00 ± 0.03 kg.'
    """
    found = []
    held = blocks.held
    if len(held) >= FEWEST_BLOCKS:
        log = _Log.of(blocks, list(base_names))
        for link, columns in bodies.items():
            one = log.step(columns)
            if one is not None:
                place, mass, error = one
                earliest, latest = first + log.ends[place - 1 : place + 1] * (last - first)
                found.append(BodyChange(link, float(earliest), float(latest), first, last, mass, error))
    return max(found, key=lambda one: abs(one.mass) / one.standard_error, default=None)


class _Log:
    """Weighted squares of every block, fitted by the base parameters of all and by friction that drifts smoothly."""

    def __init__(self, squares: Sequence[Array], ends: Array, names: Sequence[str]) -> None:
        self.ends, self.squares = ends, [block[:-1, :-1] for block in squares]
        self.torques = [block[:-1, -1] for block in squares]
        unit = np.eye(len(names))
        self.friction = unit[:, [k for k, name in enumerate(names) if FRICTION.match(name)]]
        self.terms = unit[:, [k for k, name in enumerate(names) if _TERMS.match(name)]]
        middle = ends - 0.5 * np.diff(ends, prepend=0.0)
        shapes = np.column_stack([middle, np.exp(-DRIFTS * middle)])
        self.common = [np.hstack([unit, *(self.friction * one for one in now)]) for now in shapes - shapes.mean(axis=0)]
        self.seen = [common.T @ own for common, own in zip(self.common, self.squares, strict=True)]
        self.total = np.sum([s @ c for s, c in zip(self.seen, self.common, strict=True)], axis=0)
        self.right = np.sum([c.T @ y for c, y in zip(self.common, self.torques, strict=True)], axis=0)
        self.inverse, self.rank = _inverse(self.total, self.total)
        self.fit = self.inverse @ self.right
        self.parts = [
            (each, np.cumsum(each[::-1], axis=0)[::-1])
            for each in map(np.array, (self.seen, self.squares, self.torques))
        ]

    @classmethod
    def of(cls, blocks: TimeBlocks, names: Sequence[str]) -> _Log:
        held, width = blocks.held, len(names) + 1
        squares = [np.zeros((width, width)) for _ in held]
        for joint, factor in enumerate(blocks.empty):
            own = [kept[joint].T @ kept[joint] for _, kept in held]
            total, count = np.sum(own, axis=0), sum(int(counts[joint]) for counts, _ in held)
            inverse, rank = _inverse(total[:-1, :-1], total[:-1, :-1])
            left = total[-1, -1] - total[-1, :-1] @ inverse @ total[:-1, -1]
            if count > rank and left > 1e-12 * total[-1, -1]:
                places = np.ix_(*2 * [[*factor.columns, width - 1]])
                for block, one in zip(squares, own, strict=True):
                    block[places] += one * (count - rank) / left
        rows = np.cumsum([max(counts) for counts, _ in held])
        return cls(squares, rows / rows[-1], names)

    def step(self, body: Array) -> tuple[int, float, float] | None:
        """Return the block in which a body comes or goes, its mass, and the standard error of that."""
        differ, freedom = self.differ(body)
        if differ <= 0.0:  # rounding, of a log without noise
            return None
        count = len(self.ends) - 2
        tried = [self.since(place, body) for place in range(1, count + 1)]
        place = 1 + int(np.argmax([one[0] + one[3] @ one[4] for one in tried]))
        once, rank, squares, right, change = tried[place - 1]
        if right @ change < SHARE * (differ - once):
            return None
        near = _nearest_point_mass(squares, right, change[[9, 6, 7, 8]])
        if near is None:
            return None
        x, told, explained = near
        left, freedom = max(differ - once - explained, 1e-9 * differ), freedom - rank - 4
        if freedom < 1 or explained < SHARE * (explained + left):
            return None
        chance = count * fdtrc(4, freedom, explained / 4 / (left / freedom))
        mass, error = float(x[0]), float(np.sqrt(told * left / freedom))
        if chance > CHANCE or abs(mass) < SURE * error:
            return None
        for others in (self.terms, self.fit[: len(self.terms), None]):  # friction and offsets; gains of the torques
            *_, right, answer = self.since(place, others)
            if right @ answer > explained:
                return None
        return place, mass, error

    def differ(self, columns: Array) -> tuple[float, int]:
        """Return how much of the squares further columns explain that are free in every block, and their rank."""
        total, right, rank = self.total.copy(), self.right.copy(), -self.rank
        explained = -float(self.right @ self.fit)
        for own, seen, torque in zip(self.squares, self.seen, self.torques, strict=True):
            block = columns.T @ own @ columns
            inverse, shown = _inverse(block, block)
            cross, mine = seen @ columns, columns.T @ torque
            total -= cross @ inverse @ cross.T
            right -= cross @ inverse @ mine
            explained, rank = explained + float(mine @ inverse @ mine), rank + shown
        inverse, shown = _inverse(total, self.total)
        return explained + float(right @ inverse @ right), rank + shown

    def since(self, place: int, columns: Array) -> tuple[float, int, Array, Array, Array]:
        """Return what further columns explain in one block, their rank, and the regression on those after it.

        The regression is its squares, its right side and its answer, without what the columns explain in that block.
        """
        width = columns.shape[1]
        seen, blocks, torques = ((each[place], onwards[place + 1]) for each, onwards in self.parts)
        cross = np.hstack([one @ columns for one in seen])
        whole = np.zeros((2 * width, 2 * width))
        whole[:width, :width], whole[width:, width:] = (columns.T @ one @ columns for one in blocks)
        own = whole - cross.T @ self.inverse @ cross
        right = np.concatenate([columns.T @ one for one in torques]) - cross.T @ self.fit
        inverse, rank = _inverse(own[:width, :width], whole[:width, :width])
        squares = own[width:, width:] - own[width:, :width] @ inverse @ own[:width, width:]
        after = right[width:] - own[width:, :width] @ inverse @ right[:width]
        answer = _inverse(squares, whole[width:, width:])[0] @ after
        return float(right[:width] @ inverse @ right[:width]), rank, squares, after, answer


def _inverse(squares: Array, scale: Array) -> tuple[Array, int]:
    """Return the inverse of what is shown, relative to the diagonal of `scale`, and the rank."""
    lengths = np.sqrt(np.maximum(np.diag(scale), 0.0))
    factors = np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)
    values, vectors = np.linalg.eigh(squares * np.outer(factors, factors))
    shown = values > RANK
    kept = vectors[:, shown] * factors[:, None]
    return (kept / values[shown]) @ kept.T, int(shown.sum())


def _nearest_point_mass(squares: Array, right: Array, x: Array) -> tuple[Array, float, float] | None:
    """Fit a mass and its first moment, (4,), by Gauss-Newton steps; None where the mass is not shown.

    Also returned are the variance of the mass, of rows with a variance of one, and what the point mass explains.
    """
    for _ in range(STEPS):
        mass, moment = x[0], x[1:]
        if not abs(mass) > LIGHTEST:
            return None
        inertia = (moment @ moment * np.eye(3) - np.outer(moment, moment)) / mass
        body = np.concatenate([inertia[_UPPER], moment, [mass]])
        slopes = np.zeros((10, 4))
        slopes[:6, 0], slopes[9, 0] = -inertia[_UPPER] / mass, 1.0
        for k, axis in enumerate(np.eye(3)):
            crossed = np.outer(axis, moment)
            slopes[:6, 1 + k] = (2.0 * moment[k] * np.eye(3) - crossed - crossed.T)[_UPPER] / mass
            slopes[6 + k, 1 + k] = 1.0
        own = slopes.T @ squares @ slopes
        inverse, _ = _inverse(own, own)
        x = x + inverse @ slopes.T @ (right - squares @ body)
    if (inverse @ own)[0, 0] < 1.0 - 1e-6 or not np.isfinite(x).all():
        return None
    return x, float(inverse[0, 0]), float(2.0 * right @ body - body @ squares @ body)
