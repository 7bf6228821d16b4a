"""Tells, once a robot is known, whether it was another one when it began to move: the search for changes, backwards."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.regression.factor import Reduced, column_lengths
from steelyard.regression.reduction import residuals_of_rows, rows_of_entries

from .change_detector import FEWEST, ChangeDetector, Prediction, least_told
from .earlier_robots import AS_USUAL
from .running_information import stacked
from .saved_state import Stateful

__all__ = ["TOGETHER", "EarlierPart", "FirstStretch"]

Array = NDArray[np.float64]
Answers = Callable[[Reduced], Array]

APART = 2.5
"""How many times the squared residuals of two robots one robot must leave, each as the estimator answers it.
*Measured*: where a WAM picks something up, one robot leaves 2.9 to 13 times as much with 1 or 2 kg, after 0.3 to 2.3 s,
and 2.0 to 3.5 times with 0.5 kg. Where nothing changed, alarms were raised with a UR10 whose friction the model leaves
out in part, at 1.3 times, and with a KR300 whose counterbalance it leaves out, at 1.6 to 2.0 times, and 2.0 to 6.5
times of least squares."""

TOGETHER = 20
"""Averages of which the regressor is evaluated at once."""


FEW = 6
"""Averages among which no change is looked for: two are left out, and there must be some before them and after."""


@dataclass(frozen=True, eq=False)
class EarlierPart:
    """The samples that are of another robot than those after them.

    Attributes
    ----------
    count, end : int
        How many there are, from the first one, and the number of the first one that is of the robot after it.
    is_of_one : bool
        Whether they are known to be of one robot themselves: they are more than any parameters explain, and least
        squares leave about what is usual of them.
    shares : ndarray
        (N,), how clearly each joint shows it.
    usual : ndarray
        (N,), the mean square of averages of the residuals of the robot after it.
    seen : ndarray of int
        (N,), of how many averages.
    """

    count: int
    end: int
    is_of_one: bool
    shares: Array = field(repr=False)
    usual: Array = field(repr=False)
    seen: NDArray[np.intp] = field(repr=False)


class FirstStretch(Stateful):
    """The motion and the torques since a robot is there, until it is known whether all of them are of one robot.

    `ChangeDetector` must know first which residuals are usual, and takes a robot that changes before for one with what
    it was before and after. Seen from the end the same change comes late: what was measured last is then what is known,
    and the detector looks at the averages before it, the newest first.

    Of samples at rest, which may last for hours, the first are kept: where the robot changes later, they are those of
    before.

    Parameters
    ----------
    model : Model
    length : int
        Samples that are averaged.
    """

    def __init__(self, model: Model, length: int) -> None:
        self.model, self.length = model, length
        self._hold(np.zeros((0, 2 + 5 * model.dof)))

    def _hold(self, rows: Array) -> None:
        self._parts, self.moving = [rows], int(rows[:, -1].sum())
        self._at_rest = len(rows) - self.moving

    @property
    def count(self) -> int:
        """Samples."""
        return self.moving + self._at_rest

    @property
    def most(self) -> int:
        """Samples in motion of which it is full: each half tells the detector a robot, and what is usual of it."""
        return 4 * FEWEST * self.length

    def state(self) -> dict[str, Any]:
        """Return the samples."""
        return {"rows": np.vstack(self._parts)}

    def restore(self, state: Mapping[str, Any]) -> Self:
        """Take samples over."""
        self._hold(state["rows"])
        return self

    def add(self, t: Array, motion: Sequence[Array], used: NDArray[np.bool_], moves: NDArray[np.bool_]) -> None:
        """Add times (S,), q, dq, ddq and torque (S, N), which of these count, and whether the robot moves, (S,)."""
        shown = used.any(axis=1)
        shown &= moves | (self._at_rest + np.cumsum(shown & ~moves) <= self.most // 2)
        self._parts.append(np.column_stack([t, *motion, used, moves])[shown])
        moving = int(np.count_nonzero(moves & shown))
        self.moving, self._at_rest = self.moving + moving, self._at_rest + len(self._parts[-1]) - moving

    def after(self, count: int) -> FirstStretch:
        """Return the samples without so many at the beginning."""
        found = FirstStretch(self.model, self.length)
        found._hold(np.vstack(self._parts)[count:])
        return found

    def samples(self, part: slice) -> tuple[Array, list[Array], NDArray[np.bool_]]:
        """Return times (S,), rows ``[W omega]`` of each joint, (S, c + 1), and which of them count, (S, N)."""
        if len(self._parts) > 1:
            self._parts = [np.vstack(self._parts)]
        whole = self._parts[0][part]
        q, dq, ddq, torque, used = np.split(whole[:, 1:-1], 5, axis=1)
        entries = self.model.base_columns.entries(*(np.ascontiguousarray(one) for one in (q, dq, ddq)))
        return whole[:, 0], rows_of_entries(self.model, entries, torque), used > 0.0

    def earlier_part(
        self, weights: Array, answer: Array, answers: Answers, alarm: Array | None = None, newest: int = 0
    ) -> EarlierPart | None:
        """Return the samples that are of another robot than the newest ones, None where nothing tells of such.

        Parameters
        ----------
        weights : ndarray
            (N,), of the joints.
        answer : ndarray
            (n_b,): base parameters that answer all of the samples.
        answers : callable
            Gives those that answer some of them, by their regression.
        alarm : (N,) ndarray, optional
            How clearly each joint shows a change that was noticed meanwhile: then it is only asked when it came.
        newest : int
            Samples at the end in which it is no early one.
        """
        if self.count < newest + FEW * self.length:
            return None
        averages = _Averages.of(self, weights, answer)
        joints = len(weights)
        shown = averages.alarm() if alarm is None else (alarm, np.zeros(joints), np.zeros(joints, dtype=int))
        if shown is None:
            return None
        first, numbers = averages.likeliest_change(), np.arange(len(averages.rows))
        if (len(numbers) - first) * self.length <= newest:
            return None
        # Without the averages on both sides, which may be of both robots.
        before, since = numbers[: first - 1], numbers[first + 1 :]
        one, *two = (averages.left(part, answers) for part in (np.append(before, since), before, since))
        if one <= APART * sum(two):
            return None
        counts = len(before) * self.length, (len(numbers) - len(since)) * self.length
        told = averages.shown[before].sum(axis=0)
        left, usual = averages.reduced(before)[-1, -1] ** 2, weights**2 * self.length * told @ shown[1]
        # So few that any parameters explain them would not show where the change was.
        is_of_one = told.sum() > len(answer) and not 0.0 < AS_USUAL * usual < left
        return EarlierPart(*counts, bool(is_of_one), *shown)


@dataclass(frozen=True, eq=False)
class _Averages:
    """Averages over stretches of samples.

    Attributes
    ----------
    model : Model
    length : int
        Samples that are averaged.
    near : ndarray
        (n_b,), base parameters.
    means : list of ndarray
        Of the rows ``[W omega]`` of each joint, (K, c + 1), omega less what these base parameters predict.
    shown : ndarray of bool
        (K, N), whether most samples count.
    weights : ndarray
        (N,)
    rows : ndarray
        (K, N, n_b + 1), the same rows, of about the variance 1.
    """

    model: Model
    length: int
    near: Array
    means: list[Array]
    shown: NDArray[np.bool_]
    weights: Array
    rows: Array

    @classmethod
    def of(cls, first: FirstStretch, weights: Array, near: Array) -> _Averages:
        """Average the samples of a stretch, from the first one on."""
        length, columns = first.length, first.model.base_columns.joints
        means: list[list[Array]] = [[] for _ in columns]
        shown, size, end = [], TOGETHER * length, first.count - first.count % length
        for start in range(0, end, size):
            _, rows, used = first.samples(slice(start, min(start + size, end)))
            counts = used.reshape(-1, length, used.shape[1]).sum(axis=1)
            shown.append(2 * counts > length)
            for joint, (own, place) in enumerate(zip(rows, columns, strict=True)):
                own[:, -1] -= own[:, :-1] @ near[place]
                sums = (own * used[:, [joint]]).reshape(-1, length, own.shape[1]).sum(axis=1)
                means[joint].append(sums / np.maximum(counts[:, [joint]], 1))
        joined, told = [np.vstack(own) for own in means], np.vstack(shown)
        whole = np.zeros((len(told), len(columns), len(near) + 1))
        for joint, (own, place) in enumerate(zip(joined, columns, strict=True)):
            whole[:, joint, [*place, len(near)]] = weights[joint] * np.sqrt(length) * told[:, [joint]] * own
        return cls(first.model, length, near, joined, told, weights, whole)

    def nothing(self) -> Array:
        """Return the triangle of no rows, in which what data do not tell has an end."""
        found = np.zeros(2 * self.rows.shape[2:], order="F")
        found[:-1, :-1] = least_told(column_lengths(np.vstack(list(self.rows[:, :, :-1]))))
        return found

    def reduced(self, part: NDArray[np.intp]) -> Array:
        """Return the triangle of some of them."""
        return np.asarray(np.linalg.qr(np.vstack([*list(self.rows[part]), self.nothing()]), mode="r"))

    def left(self, part: NDArray[np.intp], answers: Answers) -> float:
        """Return the squared residuals that the answer to some of them leaves."""
        triangle = self.reduced(part)
        R, rho = triangle[:-1, :-1], triangle[:-1, -1]
        away = R @ (answers(_reduced(R, rho + R @ self.near)) - self.near) - rho
        return float(away @ away + triangle[-1, -1] ** 2)

    def alarm(self) -> tuple[Array, Array, NDArray[np.intp]] | None:
        """Look for a change, the newest averages first; return how clearly each joint shows it, and what is usual."""
        detector, triangle = ChangeDetector(len(self.weights), 1), self.nothing()
        for number in range(len(self.rows) - 1, -1, -1):
            if len(self.rows) - number > FEWEST:
                own, used = [joint[[number]] for joint in self.means], self.shown[[number]]
                problem = _reduced(triangle[:-1, :-1], triangle[:-1, -1])
                prediction = Prediction.of(problem, np.zeros(len(self.near)), self.weights)
                uncertain = prediction.leverage(self.model, own, used, self.length)
                residuals = residuals_of_rows(self.model, own, prediction.data) / np.sqrt(1.0 + uncertain)
                if detector.add(np.array([float(number)]), residuals, used):
                    return detector.shares, detector.usual, detector.seen
            triangle = stacked(triangle, self.rows[number])
        return None

    def likeliest_change(self) -> int:
        """Return the number of averages before the change that explains most."""
        left = np.zeros(len(self.rows) + 1)
        for order in (range(len(self.rows)), range(len(self.rows) - 1, -1, -1)):
            triangle = self.nothing()
            for number in order:
                triangle = stacked(triangle, self.rows[number])
                left[number + (order.step > 0)] += triangle[-1, -1] ** 2
        return 2 + int(np.argmin(left[2:-2]))


def _reduced(R: Array, rho: Array) -> Reduced:
    """A regression of which only this is asked."""
    return Reduced(R, rho, 0.0, 0, 0.0)
