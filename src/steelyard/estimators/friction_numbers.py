"""Numbers of laws of friction by all joints together, with rows that are made white where noise lasts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.recording.diagnosis.detectors import runs
from steelyard.regression.coloured_noise import ColouredNoise, autoregression

from .friction_candidates import Shape

__all__ = ["FrictionNumbers", "MovableLaw", "NumberedJoint", "WhiteRows", "numbers_together"]

Array = NDArray[np.float64]

MOST_STEPS = 6
"""Steps of Gauss and Newton at most, which begin where each joint by itself has its least error."""
FARTHEST = 0.2
"""The most that one step moves the logarithm of a number of a shape."""
SETTLED = 1e-3
"""Change of the logarithms below which no further step is taken: a tenth of what a log tells at best."""


class WhiteRows:
    """A filter that whitens the rows of a joint, by an autoregressive model of the residuals of a fit.

    Parameters
    ----------
    residuals : ndarray
        (S,) N·m or N.
    used : ndarray of bool
        (S,) rows that count.
    starts : sequence of int
        Rows that do not follow the row before: of a further log, or behind a gap.

    Examples
    --------
    >>> from scipy.signal import lfilter
    >>> noise = lfilter([1.0], [1.0, -0.9], np.random.default_rng(1).normal(size=4000))
    >>> white = WhiteRows(noise, np.ones(4000, bool), [0]).of(noise[:, None])[:, 0]
    >>> round(float(np.std(white)), 1), abs(float(np.corrcoef(white[1:], white[:-1])[0, 1])) < 0.05
    (1.0, True)
    """

    def __init__(self, residuals: Array, used: NDArray[np.bool_], starts: Sequence[int]) -> None:
        self.used = used
        ends = [*sorted({0, *starts}), len(residuals)]
        self._pieces = [slice(a, b) for a, b in pairwise(ends) if b > a]
        parts = [residuals[piece][a:b] for piece in self._pieces for a, b in runs(used[piece])]
        reflections, variance = autoregression(parts, "bic")
        least = 1e-12 * float(np.abs(residuals).max(initial=0.0))
        deviation = max(float(np.sqrt(variance)), least, 1e-150)
        self._noise = ColouredNoise(("joint",), (reflections,), np.array([deviation]), np.eye(1))

    def of(self, rows: Array) -> Array:
        """Return rows (S, c) whitened; those that do not count are zero."""
        return np.vstack([self._noise.whiten_joint(0, rows[piece], self.used[piece])[0] for piece in self._pieces])


@dataclass(frozen=True, eq=False)
class MovableLaw:
    """A law at a joint whose shape is to be found.

    Attributes
    ----------
    columns : callable
        Shapes -> for each the (S, c) columns, c coefficients.
    shape : tuple of float
        Where the search begins.
    free : tuple of int
        Which of its numbers are moved.
    lower, upper : tuple of float
        Limits of all of them.
    """

    columns: Callable[[Sequence[Shape]], list[Array]]
    shape: Shape
    free: tuple[int, ...]
    lower: Shape
    upper: Shape


class NumberedJoint(NamedTuple):
    """The rows of a joint: what makes them white, its regressor (S, n) and torque (S,), which base parameters those
    columns are of, and its laws.
    """

    white: WhiteRows
    regressor: Array
    torque: Array
    own: Sequence[int]
    laws: tuple[MovableLaw, ...]


class FrictionNumbers(NamedTuple):
    """Base parameters (n_b,), and for each joint the shapes and coefficients of its laws.

    Standard errors are those of the last step of Gauss and Newton, with rows that are white: of the coefficients as
    they are, and of the free numbers of the shapes relative to these.
    """

    base: Array
    shapes: list[list[Shape]]
    coefficients: list[list[Array]]
    coefficient_errors: list[list[Array]]
    free_errors: list[list[Array]]


def numbers_together(joints: Sequence[NumberedJoint], width: int) -> FrictionNumbers:
    """Find base parameters, coefficients and shapes by weighted least squares of all joints together.

    A link moves several joints, so that all their torques tell its parameters, and with them what is friction of each;
    and where noise lasts, fast changes tell more than slow ones. Steps are those of Gauss and Newton in the logarithms
    of the shapes. The width is the number of base parameters.

    Examples
    --------
    A knee of viscous friction, in noise that lasts:

    >>> from scipy.signal import lfilter
    >>> random, t = np.random.default_rng(1), np.arange(4000) / 100.0
    >>> dq = np.sin(t) + 0.5 * np.sin(2.3 * t)
    >>> def knee(shapes):
    ...     return [(np.sign(dq) * np.maximum(np.abs(dq) - speed, 0.0))[:, None] for (speed,) in shapes]
    >>> noise = 0.02 * lfilter([0.3], [1.0, -0.95], random.normal(size=4000))
    >>> torque = 2.0 * dq - knee([(0.5,)])[0][:, 0] + noise
    >>> white = WhiteRows(noise, np.ones(4000, bool), [0])
    >>> law = MovableLaw(knee, (0.45,), (0,), (0.1,), (1.0,))
    >>> found = numbers_together([NumberedJoint(white, dq[:, None], torque, [0], (law,))], 1)
    >>> found.base.round(1), np.round(found.shapes[0][0], 2), found.coefficients[0][0].round(1)
    (array([2.]), array([0.5]), array([-1.]))
    >>> found.coefficient_errors[0][0].round(3), found.free_errors[0][0].round(3)
    (array([0.01]), array([0.002]))
    """
    ready = [_ReadyJoint(joint) for joint in joints]
    shapes = [[law.shape for law in joint.laws] for joint in joints]
    best: tuple[Array, list[list[Shape]], list[list[Array]]] | None = None
    least, length = np.inf, 1.0
    moves: list[list[Array]] = []
    for _ in range(MOST_STEPS + 1):
        if best is not None:
            shapes = [
                [_moved(law, shape, length * move) for law, shape, move in zip(joint.laws, old, of_joint, strict=True)]
                for joint, old, of_joint in zip(joints, best[1], moves, strict=True)
            ]
        factors = [one.factor(own, None) for one, own in zip(ready, shapes, strict=True)]
        counts = [[columns.shape[1] for columns in one.columns] for one in ready]
        found, squares = _solved(joints, factors, counts, width)
        if squares >= least:
            length *= 0.5
            if length < 0.2:
                break
            continue
        best, least, length = (found[:width], shapes, _split(found[width:], counts)), squares, 1.0
        free = [[len(law.free) for law in joint.laws] for joint in joints]
        both = [[*one, *two] for one, two in zip(counts, free, strict=True)]
        slopes = [one.factor(own, numbers) for one, own, numbers in zip(ready, shapes, best[2], strict=True)]
        if not sum(map(sum, free)):
            break
        found, _ = _solved(joints, slopes, both, width)
        moves = [one[len(own) :] for one, own in zip(_split(found[width:], both), counts, strict=True)]
        if max(float(np.abs(move).max(initial=0.0)) for one in moves for move in one) < SETTLED:
            break
    assert best is not None
    base, shapes, coefficients = best
    errors = _split(_standard_errors(joints, slopes, both, width)[width:], both)
    ends = [len(own) for own in counts]
    return FrictionNumbers(
        base,
        shapes,
        coefficients,
        [own[:end] for own, end in zip(errors, ends, strict=True)],
        [own[end:] for own, end in zip(errors, ends, strict=True)],
    )


def _moved(law: MovableLaw, shape: Shape, move: Array) -> Shape:
    logarithms = np.log(np.array(shape))
    logarithms[list(law.free)] += np.clip(move, -FARTHEST, FARTHEST)
    return tuple(float(one) for one in np.clip(np.exp(logarithms), law.lower, law.upper))


def _split(values: Array, counts: Sequence[Sequence[int]]) -> list[list[Array]]:
    ends = np.cumsum([count for of_joint in counts for count in of_joint])
    parts = iter(np.split(values, ends[:-1]) if len(ends) else [])
    return [[next(parts) for _ in of_joint] for of_joint in counts]


class _ReadyJoint:
    """A joint whose regressor is whitened and eliminated once."""

    def __init__(self, joint: NumberedJoint) -> None:
        self.joint = joint
        white = joint.white.of(np.column_stack([joint.regressor, joint.torque]))
        self.basis, self.triangle = np.linalg.qr(white[:, :-1])
        self.torque = white[:, -1]
        self.columns: list[Array] = []

    def factor(self, shapes: Sequence[Shape], numbers: Sequence[Array] | None) -> Array:
        """The triangular factor of regressor, columns of the laws (their slopes behind them), and torque.

        Slopes are those with the logarithms of the free numbers, which need the coefficients.
        """
        if numbers is None:
            plain = [law.columns([shape])[0] for law, shape in zip(self.joint.laws, shapes, strict=True)]
            self.columns = _parts(self.joint.white, plain)
            beside = self.columns
        else:
            beside = self.columns + _parts(
                self.joint.white,
                [_slopes(*one) for one in zip(self.joint.laws, shapes, numbers, strict=True)],
            )
        rows = np.column_stack([*beside, self.torque])
        inside = self.basis.T @ rows
        beyond = np.linalg.qr(rows - self.basis @ inside, mode="r")
        lower = np.hstack([np.zeros((len(beyond), self.triangle.shape[1])), beyond])
        return np.vstack([np.hstack([self.triangle, inside]), lower])


def _parts(white: WhiteRows, parts: Sequence[Array]) -> list[Array]:
    if not parts:
        return []
    return np.split(white.of(np.hstack(parts)), np.cumsum([one.shape[1] for one in parts])[:-1], axis=1)


def _slopes(law: MovableLaw, shape: Shape, numbers: Array) -> Array:
    step = 1e-3
    ends = []
    for place in law.free:
        for sign in (1.0, -1.0):
            end = list(shape)
            end[place] *= float(np.exp(sign * step))
            ends.append(tuple(end))
    if not ends:
        return np.zeros((len(law.columns([shape])[0]), 0))
    torques = [columns @ numbers for columns in law.columns(ends)]
    return np.column_stack([(a - b) / (2.0 * step) for a, b in zip(torques[::2], torques[1::2], strict=True)])


def _solved(
    joints: Sequence[NumberedJoint], factors: Sequence[Array], counts: Sequence[Sequence[int]], width: int
) -> tuple[Array, float]:
    """Least squares of base parameters and of what each joint has beside them, and the squared residual."""
    scaled, lengths, target = _stacked(joints, factors, counts, width)
    found = np.linalg.lstsq(scaled, target, rcond=1e-9)[0]
    left = target - scaled @ found
    return found / lengths, float(left @ left)


def _standard_errors(
    joints: Sequence[NumberedJoint], factors: Sequence[Array], counts: Sequence[Sequence[int]], width: int
) -> Array:
    """Of the same, where the noise of the rows has a standard deviation of 1; infinite where nothing is told."""
    scaled, lengths, _ = _stacked(joints, factors, counts, width)
    _, values, vectors = np.linalg.svd(scaled, full_matrices=False)
    told = values > 1e-9 * values[0]
    errors = np.linalg.norm(vectors[told] / values[told, None], axis=0)
    return np.where(np.isfinite(lengths), errors / lengths, np.inf)


def _stacked(
    joints: Sequence[NumberedJoint], factors: Sequence[Array], counts: Sequence[Sequence[int]], width: int
) -> tuple[Array, Array, Array]:
    """The triangular factors of all joints, with columns for base parameters and for what each joint has beside.

    Columns have length 1; what they were divided by is infinite where a column is zero.
    """
    whole = np.zeros((sum(map(len, factors)), width + sum(map(sum, counts))))
    target = np.concatenate([factor[:, -1] for factor in factors])
    row, column = 0, width
    for joint, factor, own in zip(joints, factors, counts, strict=True):
        rows, beside = slice(row, row + len(factor)), slice(column, column + sum(own))
        whole[rows, list(joint.own)] = factor[:, : len(joint.own)]
        whole[rows, beside] = factor[:, len(joint.own) : -1]
        row, column = rows.stop, beside.stop
    lengths = np.linalg.norm(whole, axis=0)
    lengths[lengths == 0.0] = np.inf
    return whole / lengths, lengths, target
