"""Estimates the stiffness of an environment from how force and place change together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.simulation.arguments import positive

__all__ = ["StiffnessEstimator"]

Array = NDArray[np.float64]

_AGREES = 2.0  # times the estimate, or by it, that an increment may be off


class StiffnessEstimator:
    """Least squares of place increments on force increments, with forgetting only while something is to be learnt.

    An increment is taken from an anchor, as soon as the tool has moved by `smallest_way` and the force has changed by
    `smallest_force`, so that each stands out of the noise, however slow the motion; then the anchor moves on. What
    takes longer than `span` is dropped. An increment whose slope is not that of a spring between `lower` and `upper` is
    dropped, too: a change of the environment itself changes the force without a motion. Two increments in turn that are
    off by more than twice forget all before them. While nothing moves, the estimate and its weight stay as they are.

    It is the compliance that is estimated, since noise of the places, which encoders give coarsely, then averages out;
    in a regression of forces on places it would make every stiffness look softer.

    Parameters
    ----------
    initial : float
        What is believed before the first contact, N/m.
    smallest_way : float
        m; ten times the noise of the tool's position, or more.
    smallest_force : float
        N; ten times the noise of the sensor, or more.
    memory : float
        Number of increments after which one counts 1/e.
    span : float
        Longest time of an increment, s.
    lower, upper : float
        Stiffness that is possible, N/m.
    smoothing : float
        Time constant of a filter of the first order through which place and force both pass, s. A spring is one
        between what leaves the filters, too, and of the noise of n samples within the time constant ``1/sqrt(2 n)`` is
        left, but a change of the stiffness is seen so much later.

    Attributes
    ----------
    stiffness : ndarray
        (...,) the estimate, N/m.

    Examples
    --------
    >>> estimator = StiffnessEstimator(initial=500.0)
    >>> estimator.start(())
    >>> for k in range(200):
    ...     depth = 0.002 + 0.001 * np.sin(0.05 * k)
    ...     found = estimator.update(0.001 * k, np.array(depth), np.array(3000.0 * depth), np.array(True))
    >>> round(float(found), -1)
    3000.0
    """

    def __init__(
        self,
        *,
        initial: float = 1000.0,
        smallest_way: float = 5e-5,
        smallest_force: float = 0.5,
        memory: float = 10.0,
        span: float = 0.2,
        lower: float = 10.0,
        upper: float = 1e6,
        smoothing: float = 0.0,
    ) -> None:
        self._initial = positive(initial, "initial", "N/m")
        self._lower, self._upper = positive(lower, "lower", "N/m"), positive(upper, "upper", "N/m")
        if not self._lower <= self._initial <= self._upper:
            raise InputError(
                f"The initial stiffness must be between lower and upper, got {lower:g} <= {initial:g} <= {upper:g}."
            )
        self._way = positive(smallest_way, "smallest_way", "m")
        self._force = positive(smallest_force, "smallest_force", "N")
        self._keep = float(np.exp(-1.0 / positive(memory, "memory", "1")))
        self._span = positive(span, "span", "s")
        self._smoothing = positive(smoothing, "smoothing", "s", zero=True)
        self.start(())

    def start(self, shape: tuple[int, ...]) -> None:
        """Forget everything.

        Parameters
        ----------
        shape : tuple of int
            Of the runs, () for one.
        """
        self.stiffness = np.full(shape, self._initial)
        self._weight = np.full(shape, self._force**2)
        self._product = self._weight / self._initial
        self._anchor_place, self._anchor_force = np.zeros(shape), np.zeros(shape)
        self._anchor_time = np.full(shape, -np.inf)
        self._touched = np.zeros(shape, dtype=np.bool_)
        self._smooth, self._time = np.zeros((2, *shape)), -np.inf
        # Samples of which place and force are means, as a share of those in the filter at last: 1 without smoothing.
        self._count = self._anchor_count = np.zeros(shape) if self._smoothing else np.ones(shape)
        self._doubt, self._aside = np.zeros(shape, dtype=np.int64), np.zeros((2, *shape))

    def update(self, t: float, place: Array, force: Array, contact: NDArray[np.bool_]) -> Array:
        """Take in a measurement.

        Parameters
        ----------
        t : float
            s.
        place : ndarray
            (...,) of the tool along the normal, into the environment, m.
        force : ndarray
            (...,) with which the tool presses, N.
        contact : ndarray
            (...,) of bool.

        Returns
        -------
        ndarray
            `stiffness`.
        """
        if self._smoothing:
            place, force = self._smoothed(t, place, force, contact)
        way, change = place - self._anchor_place, force - self._anchor_force
        whole = contact & self._touched & (t - self._anchor_time <= self._span)
        ready = whole & (np.abs(way) >= self._way) & (np.abs(change) >= self._force * self._noisier())
        # An anchor from the first samples of a contact is noisy; a mean over four times as many is a better one.
        moves = ready | ~whole | (self._count >= 4.0 * self._anchor_count)
        if moves.any():
            product, weight = way * change, change * change
            counts = ready & (weight >= self._lower * product) & (weight <= self._upper * product)
            expected = self.stiffness * product
            side = np.where(weight > _AGREES * expected, 1, np.where(expected > _AGREES * weight, -1, 0))
            # One increment that contradicts the estimate is set aside; after a second one all before are forgotten.
            anew = counts & (side != 0) & (side == self._doubt)
            usual = counts & (side == 0)
            keep = np.where(usual, self._keep, 1.0)
            self._weight = np.where(anew, self._aside[0], keep * self._weight) + np.where(usual | anew, weight, 0.0)
            self._product = np.where(anew, self._aside[1], keep * self._product) + np.where(usual | anew, product, 0.0)
            self._doubt = np.where(counts, np.where(anew, 0, side), self._doubt)
            self._aside = np.where(counts, np.stack((weight, product)), self._aside)
            self.stiffness = self._weight / self._product
            self._anchor_place = np.where(moves, place, self._anchor_place)
            self._anchor_force = np.where(moves, force, self._anchor_force)
            self._anchor_time = np.where(moves, t, self._anchor_time)
            self._anchor_count = np.where(moves, self._count, self._anchor_count)
            self._touched = contact
        return self.stiffness

    def _noisier(self) -> Array | float:
        """Return how many times noisier an increment is than one between two settled filters (...,)."""
        if not self._smoothing:
            return 1.0
        tiny = np.finfo(np.float64).tiny
        result: Array = np.sqrt(0.5 / np.maximum(self._count, tiny) + 0.5 / np.maximum(self._anchor_count, tiny))
        return result

    def _smoothed(self, t: float, place: Array, force: Array, contact: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return place and force behind the filter.

        From the beginning of a contact it is the mean of what has been seen, until that is as quiet as the filter; to
        begin the filter at the first sample would leave the noise of that one for long.
        """
        share = -float(np.expm1(-(t - self._time) / self._smoothing))
        self._time = t
        settled = share / (2.0 - share)  # the variance that the filter leaves, of that of a sample
        before = np.where(contact, self._count, 0.0)
        self._count = np.where(contact, np.minimum(before + settled, 1.0), 0.0)
        weight = np.where(before + settled >= 1.0, share, settled / np.maximum(self._count, settled))
        given = np.stack((place, force))
        self._smooth = self._smooth + np.maximum(weight, share) * (given - self._smooth)
        return self._smooth[0], self._smooth[1]
