"""Estimates the stiffness of an environment from joint changes of force and position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import positive

__all__ = ["StiffnessEstimator"]

Array = NDArray[np.float64]

# An increment agrees with the estimate where its own stiffness is between half and twice of it. Noise alone changes
# increments that are ten times as large as it by some per cent only: a larger disagreement is a change of the surface.
_AGREES = 2.0


class StiffnessEstimator:
    """Estimates a stiffness by least squares of increments of position on increments of force, with forgetting.

    An increment is the change since an anchor. It is taken as soon as the tool has moved by `smallest_displacement` and
    the force has changed by `smallest_force`, so that both changes stand out of the noise however slow the motion is;
    then the anchor moves to the present measurement. Increments that take longer than `span` are dropped. So are
    increments whose slope is no stiffness between `lower` and `upper`, because a change of the environment itself
    changes the force without a motion. Two consecutive increments that both differ from the estimate by more than a
    factor of two, in the same direction, replace everything before them. Old increments are forgotten only when new
    ones arrive: while nothing moves, the estimate and its weight stay as they are.

    The estimator regresses position on force, which gives the compliance, because the noise of the positions, which
    encoders resolve coarsely, then averages out. In a regression of force on position this noise would bias every
    stiffness towards zero.

    Parameters
    ----------
    initial : float
        Stiffness before the first contact, N/m.
    smallest_displacement : float
        Least change of position of an increment, m; ten times the noise of the tool's position, or more.
    smallest_force : float
        Least change of force of an increment, N; ten times the noise of the sensor, or more.
    memory : float
        Number of increments after which the weight of an increment has fallen to 1/e.
    span : float
        Longest duration of an increment, s.
    lower, upper : float
        Range of possible stiffnesses, N/m.
    smoothing : float
        Time constant of a first-order filter through which position and force both pass, s; 0 for none. A linear
        spring between two signals is the same spring between the filtered signals, so that the filter causes no bias.
        With n samples within the time constant it leaves ``1/sqrt(2 n)`` of the noise, and it delays the response to a
        change of the stiffness by the time constant.

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
        smallest_displacement: float = 5e-5,
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
        self._displacement = positive(smallest_displacement, "smallest_displacement", "m")
        self._force = positive(smallest_force, "smallest_force", "N")
        self._keep = float(np.exp(-1.0 / positive(memory, "memory", "1")))
        self._span = positive(span, "span", "s")
        self._smoothing = positive(smoothing, "smoothing", "s", zero=True)
        self.start(())

    def start(self, shape: tuple[int, ...]) -> None:
        """Forget all measurements.

        Parameters
        ----------
        shape : tuple of int
            Shape of the batch of runs; () for one run.
        """
        self.stiffness = np.full(shape, self._initial)
        self._weight = np.full(shape, self._force**2)
        self._product = self._weight / self._initial
        self._anchor_position, self._anchor_force = np.zeros(shape), np.zeros(shape)
        self._anchor_time = np.full(shape, -np.inf)
        self._touched = np.zeros(shape, dtype=np.bool_)
        self._smooth, self._time = np.zeros((2, *shape)), -np.inf
        # The number of samples that position and force are means of, as a fraction of the number that the settled
        # filter averages over; 1 without smoothing.
        self._count = self._anchor_count = np.zeros(shape) if self._smoothing else np.ones(shape)
        self._contradicts, self._set_aside = np.zeros(shape, dtype=np.int64), np.zeros((2, *shape))

    def update(self, t: float, position: Array, force: Array, contact: NDArray[np.bool_]) -> Array:
        """Update the estimate with a measurement.

        Parameters
        ----------
        t : float
            Time, s.
        position : ndarray
            (...,) position of the tool along the normal, positive into the environment, m.
        force : ndarray
            (...,) force with which the tool presses, N.
        contact : ndarray
            (...,) of bool, whether the tool is in contact.

        Returns
        -------
        ndarray
            (...,) the estimated stiffness, N/m.
        """
        if self._smoothing:
            position, force = self._smoothed(t, position, force, contact)
        displacement, change = position - self._anchor_position, force - self._anchor_force
        whole = contact & self._touched & (t - self._anchor_time <= self._span)
        ready = (
            whole
            & (np.abs(displacement) >= self._displacement)
            & (np.abs(change) >= self._force * self._relative_noise())
        )
        # An anchor from the first samples of a contact is noisy. Once four times as many samples have been averaged,
        # which halves the noise, the anchor moves to the present mean.
        moves = ready | ~whole | (self._count >= 4.0 * self._anchor_count)
        if moves.any():
            product, weight = displacement * change, change * change
            counts = ready & (weight >= self._lower * product) & (weight <= self._upper * product)
            expected = self.stiffness * product
            side = np.where(weight > _AGREES * expected, 1, np.where(expected > _AGREES * weight, -1, 0))
            # One increment that contradicts the estimate is set aside: it may be an accident. A second one in the same
            # direction replaces the estimate.
            anew = counts & (side != 0) & (side == self._contradicts)
            usual = counts & (side == 0)
            keep = np.where(usual, self._keep, 1.0)
            self._weight = np.where(anew, self._set_aside[0], keep * self._weight) + np.where(usual | anew, weight, 0.0)
            self._product = np.where(anew, self._set_aside[1], keep * self._product) + np.where(
                usual | anew, product, 0.0
            )
            self._contradicts = np.where(counts, np.where(anew, 0, side), self._contradicts)
            self._set_aside = np.where(counts, np.stack((weight, product)), self._set_aside)
            self.stiffness = self._weight / self._product
            self._anchor_position = np.where(moves, position, self._anchor_position)
            self._anchor_force = np.where(moves, force, self._anchor_force)
            self._anchor_time = np.where(moves, t, self._anchor_time)
            self._anchor_count = np.where(moves, self._count, self._anchor_count)
            self._touched = contact
        return self.stiffness

    def _relative_noise(self) -> Array | float:
        """Return the noise of an increment (...,), relative to one between two outputs of the settled filter."""
        if not self._smoothing:
            return 1.0
        tiny = np.finfo(np.float64).tiny
        result: Array = np.sqrt(0.5 / np.maximum(self._count, tiny) + 0.5 / np.maximum(self._anchor_count, tiny))
        return result

    def _smoothed(self, t: float, position: Array, force: Array, contact: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return the filtered position and force.

        From the beginning of a contact the result is the mean of all samples, until its noise is as low as that of the
        filter. A filter that starts at the first sample would keep the noise of this sample for several time constants.
        """
        share = -float(np.expm1(-(t - self._time) / self._smoothing))
        self._time = t
        settled = share / (2.0 - share)  # variance after the settled filter, relative to that of a sample
        before = np.where(contact, self._count, 0.0)
        self._count = np.where(contact, np.minimum(before + settled, 1.0), 0.0)
        weight = np.where(before + settled >= 1.0, share, settled / np.maximum(self._count, settled))
        given = np.stack((position, force))
        self._smooth = self._smooth + np.maximum(weight, share) * (given - self._smooth)
        return self._smooth[0], self._smooth[1]
