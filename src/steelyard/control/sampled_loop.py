"""What linear feedback makes of a robot near rest, when it acts in sampled time: growth of errors, and margins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

__all__ = ["Feedback", "SampledLoop"]

Array = NDArray[np.float64]
Transfer = tuple[Array, Array]

_NEUTRAL = 1e-5  # per sample; double poles at one, of what nothing holds, are found with errors above 1e-6
_LARGEST_MARGIN = 1e3
_FREQUENCIES = 200


@dataclass(frozen=True, eq=False)
class Feedback:
    """Joint torques for a joint error, ``tau = -stiffness e - damping de/dt - integral sum(e) sample_time``.

    Attributes
    ----------
    stiffness, damping : ndarray
        (P, N, N) at P configurations.
    integral : ndarray or None
        (P, N, N).
    """

    stiffness: Array
    damping: Array
    integral: Array | None = None

    def times(self, factor: float) -> Feedback:
        """Return the feedback with all its gains multiplied."""
        integral = None if self.integral is None else factor * self.integral
        return Feedback(factor * self.stiffness, factor * self.damping, integral)


class SampledLoop:
    """A robot at rest at P configurations, with held torques and estimated velocities.

    To first order, ``inertia d²e/dt² = -friction de/dt + tau``. That is exact near rest; gravity and Coriolis torques
    count as compensated, and Coulomb friction, which only takes energy away, as none. Between samples the motion under
    a held torque is solved exactly, so that the eigenvalues of one sample time's map tell whether errors grow.

    Parameters
    ----------
    inertia, friction : ndarray
        (P, N, N) inertia matrices, positive definite, and viscous friction.
    sample_time : float
        s.
    transfer : tuple of ndarray or None
        Numerator and denominator of the velocity estimate over the sampled position, in powers of 1/z, the
        denominator's first element being 1; None for the true velocity.

    Examples
    --------
    A unit mass under damping alone, with the true velocity: stable as long as damping times sample time is below 2.

    >>> one = np.ones((1, 1, 1))
    >>> loop = SampledLoop(one, 0 * one, 0.001, None)
    >>> round(loop.gain_margin(Feedback(0 * one, 500.0 * one)), 3)
    4.0
    """

    def __init__(self, inertia: Array, friction: Array, sample_time: float, transfer: Transfer | None) -> None:
        count, size = inertia.shape[0], inertia.shape[-1]
        inverse = np.linalg.inv(inertia)
        # The free motion and the held torque in one matrix exponential (Van Loan 1978).
        whole = np.zeros((count, 3 * size, 3 * size))
        whole[:, :size, size : 2 * size] = np.eye(size)
        whole[:, size : 2 * size, size : 2 * size] = -inverse @ friction
        whole[:, size : 2 * size, 2 * size :] = inverse
        flow = expm(sample_time * whole)
        self._size, self._sample_time = size, sample_time
        self._transition = flow[:, : 2 * size, : 2 * size]
        self._input = flow[:, : 2 * size, 2 * size :]
        self._filter = None if transfer is None else _realised(transfer)

    def growth(self, feedback: Feedback) -> Array:
        """Return by what factor a sample time the worst error grows (P,); at most 1 in a stable loop."""
        return np.asarray(np.abs(np.linalg.eigvals(self._closed(feedback)[0])).max(axis=-1), dtype=np.float64)

    def is_stable(self, feedback: Feedback) -> NDArray[np.bool_]:
        """Tell at which of the configurations no error grows (P,)."""
        return np.asarray(self.growth(feedback) <= 1.0 + _NEUTRAL)

    def fastest(self, feedback: Feedback, which: int) -> int:
        """Return the joint that moves most in what grows fastest at one configuration."""
        values, vectors = np.linalg.eig(self._closed(feedback)[0][which])
        moved = np.abs(vectors[: self._size, np.argmax(np.abs(values))])
        return int(np.argmax(moved))

    def gain_margin(self, feedback: Feedback) -> float:
        """Return by what factor all the gains may be multiplied before the loop is unstable at one configuration.

        It is below 1 where the loop is unstable as it is, and at most 1000.
        """

        def stable(factor: float) -> bool:
            return bool(self.is_stable(feedback.times(factor)).all())

        low, high = 1.0, 1.0
        if stable(1.0):
            while high < _LARGEST_MARGIN and stable(high):
                low, high = high, 2.0 * high
            if high >= _LARGEST_MARGIN:
                return _LARGEST_MARGIN
        else:
            while low > 1.0 / _LARGEST_MARGIN and not stable(low):
                low, high = 0.5 * low, low
        for _ in range(14):  # to 1e-4
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if stable(middle) else (low, middle)
        return low

    def sensitivity_peak(self, feedback: Feedback) -> float:
        """Return the largest gain from a disturbing torque to the torque that acts, over all frequencies.

        The closest that the Nyquist curve comes to -1 is the inverse of it: a peak of 2 leaves a gain margin of 2 and a
        phase margin of 29 degrees at least (Åström and Murray, Feedback Systems, section 12.2). Infinite where the
        loop is unstable.
        """
        if not self.is_stable(feedback).all():
            return float("inf")
        closed, gain, entry = self._closed(feedback)
        angles = np.geomspace(1e-4, np.pi, _FREQUENCIES)
        z = np.exp(1j * angles)[:, None, None, None]
        moved = np.linalg.solve(
            z * np.eye(closed.shape[-1]) - closed, np.broadcast_to(entry, closed.shape[:1] + entry.shape[1:])
        )
        return float(np.linalg.norm(np.eye(self._size) - gain @ moved, ord=2, axis=(-2, -1)).max())

    def _closed(self, feedback: Feedback) -> tuple[Array, Array, Array]:
        """Return one sample time's map of the closed loop, the gains of its state, and how a torque enters."""
        size, count = self._size, len(self._transition)
        one = np.eye(size)
        order = 0 if self._filter is None else len(self._filter[1])
        integrates = feedback.integral is not None
        width = size * (2 + order + integrates)
        free, gain = np.zeros((count, width, width)), np.zeros((count, size, width))
        entry = np.zeros((count, width, size))
        places, speeds = slice(0, size), slice(size, 2 * size)
        free[:, : 2 * size, : 2 * size] = self._transition
        entry[:, : 2 * size] = self._input
        gain[:, :, places] = feedback.stiffness
        if self._filter is None:
            gain[:, :, speeds] = feedback.damping
        else:
            direct, carried, fed = self._filter
            inside = slice(2 * size, (2 + order) * size)
            gain[:, :, places] += direct * feedback.damping
            if order:
                free[:, inside, inside] = np.kron(carried, one)
                free[:, inside, places] = np.kron(fed[:, None], one)
                gain[:, :, 2 * size : 3 * size] = feedback.damping
        if feedback.integral is not None:  # the sum holds the present error already
            last = slice(width - size, width)
            free[:, last, last] = one
            free[:, last, places] = self._sample_time * one
            gain[:, :, last] = feedback.integral
            gain[:, :, places] += self._sample_time * feedback.integral
        return free - entry @ gain, gain, entry


def _realised(transfer: Transfer) -> tuple[float, Array, Array]:
    """Return a filter's direct gain, the map of its state and how the input enters; the output is the first state."""
    numerator, denominator = transfer
    order = max(len(numerator), len(denominator)) - 1
    b, a = (np.concatenate((x, np.zeros(order + 1 - len(x)))) for x in (numerator, denominator))
    carried = np.eye(order, k=1)
    if order:
        carried[:, 0] -= a[1:]
    return float(b[0]), carried, b[1:] - a[1:] * b[0]
