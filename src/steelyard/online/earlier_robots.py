"""Robots that were met before a change, as without what is now carried: one that comes back is known again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.once import cached_property
from steelyard.regression import Information

from .change_detector import FEWEST, USUAL, Prediction, Stretches
from .running_information import CountedRows

__all__ = ["AS_USUAL", "MOST_EARLIER", "RECALLED", "RECALLING", "EarlierRobot"]

Array = NDArray[np.float64]

RECALLING = 5.0
"""s of motion after a change for which earlier robots are looked for. One that comes back later is noticed to change
again."""

RECALLED = 20
"""Stretches, of 0.05 s each, that an earlier robot must predict."""

AS_USUAL = 2.0
"""How many times as large as usual the mean squares of its residuals may be then, on average of the joints."""

SURE = 1.0
"""Variance of what is predicted, relative to that of the noise of what is averaged, beyond which nothing is told by it:
a robot of which little is known could be any."""

MOST_EARLIER = 4
"""Earlier robots that are kept: the first, and the last ones. Each has the size of an estimator's sums, 3 MB for seven
joints with drives."""


@dataclass(eq=False)
class EarlierRobot:
    """What was known of a robot when it changed.

    Attributes
    ----------
    number : int
        0 for the first, and so on.
    rows : CountedRows
    prediction : Prediction
    usual : ndarray
        (N,), see `ChangeDetector`.
    seen : ndarray of int
        (N,)
    reference, parameters : ndarray
        (n,): those near which its links were assumed to be, and the last answer.
    weights : ndarray
        (N,), of the joints in it.
    stretches : Stretches
        Of the residuals since the last change.
    shares : list of ndarray
        (N,), the squares of the last ones, in parts of the usual ones.
    """

    number: int
    rows: CountedRows
    prediction: Prediction
    usual: Array
    seen: NDArray[np.intp]
    reference: Array
    parameters: Array
    weights: Array
    stretches: Stretches
    shares: list[Array] = field(default_factory=list)

    @cached_property
    def information(self) -> Information:
        """Its data."""
        return self.rows.information()

    def begin(self) -> None:
        """Look anew whether it has come back."""
        self.stretches, self.shares = Stretches(len(self.usual), self.stretches.length), []

    def look(self, model: Model, rows: Sequence[Array], used: NDArray[np.bool_]) -> bool:
        """Look at rows that come next; return whether a stretch ended, so that `share` may be another one."""
        length = self.stretches.length
        sure = self.prediction.leverage(model, rows, used, length) < SURE
        residuals = self.prediction.residuals(model, rows, used, length)
        ended = self.stretches.add(residuals, used & sure & (self.seen >= FEWEST) & (self.usual > 0.0))
        if ended is None:
            return False
        squares, shown = ended
        self.shares = self.shares[1 - RECALLED :]
        self.shares.append(np.where(shown, squares / np.where(shown, self.usual, 1.0), np.nan))
        return True

    def share(self, joints: Sequence[int]) -> float:
        """Return how large the squared residuals of the last second are, usual ones being 1.

        Infinite where that does not speak for this robot, or where the joints by which the change was noticed have
        hardly moved.
        """
        told = np.array(self.shares).reshape(-1, len(self.usual))
        there = 2 * np.isfinite(told).sum(axis=0) >= RECALLED
        if not there[list(joints)].all():
            return np.inf
        means = np.nanmean(told[:, there], axis=0)
        whole = float(means.mean())
        return whole if whole < AS_USUAL and means.max() < USUAL else np.inf

    def state(self) -> dict[str, Any]:
        """Return all of it, for a file."""
        return {
            "number": self.number,
            "rows": self.rows.state(),
            "prediction": self.prediction.state(),
            "arrays": [self.usual, self.seen, self.reference, self.parameters, self.weights],
            "stretches": self.stretches.state(),
            "shares": self.shares,
        }

    @classmethod
    def of_state(cls, state: Mapping[str, Any], rows: CountedRows, length: int) -> EarlierRobot:
        """Return the robot of which `state` told, with rows that are empty so far, and stretches of so many samples."""
        prediction = Prediction.of_state(state["prediction"])
        usual, seen, reference, parameters, weights = state["arrays"]
        stretches = Stretches(len(usual), length).restore(state["stretches"])
        known = state["number"], rows.restore(state["rows"]), prediction, usual, seen, reference, parameters, weights
        return cls(*known, stretches, state["shares"])
