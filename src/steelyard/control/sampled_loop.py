"""Stability of linear feedback on a robot near rest in sampled time: growth of errors, and stability margins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

__all__ = ["Feedback", "SampledLoop"]

Array = NDArray[np.float64]
Transfer = tuple[Array, Array]

# Growth per sample that still counts as stable. A motion that no feedback acts on has a double pole at one, whose
# eigenvalues are computed with errors above 1e-6.
_NEUTRAL = 1e-5
_LARGEST_MARGIN = 1e3  # beyond it the search for the gain margin ends: gains that far from unstable need no number
_FREQUENCIES = 200  # on a logarithmic scale, about 45 in each decade


@dataclass(frozen=True, eq=False)
class Feedback:
    """Linear feedback of joint errors e, ``tau = -stiffness e - damping de/dt - integral sum(e) sample_time``.

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
        """Return the feedback with all its gains multiplied by a factor."""
        integral = None if self.integral is None else factor * self.integral
        return Feedback(factor * self.stiffness, factor * self.damping, integral)


class SampledLoop:
    """A robot at rest at P configurations, with torques that are held between samples and estimated velocities.

    The robot is linearised as ``inertia d²e/dt² = -friction de/dt + tau``, which is exact near rest. Gravity and
    Coriolis torques are taken to be compensated, and Coulomb friction, which only dissipates energy, is left out. The
    motion under a held torque is solved exactly, so that errors grow if and only if the map from one sample to the next
    has an eigenvalue of magnitude above one.

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
        """Return the factor (P,) by which the fastest error grows in a sample time; at most 1 in a stable loop."""
        return np.asarray(np.abs(np.linalg.eigvals(self._closed(feedback)[0])).max(axis=-1), dtype=np.float64)

    def is_stable(self, feedback: Feedback) -> NDArray[np.bool_]:
        """Return for each configuration (P,) whether no error grows."""
        return np.asarray(self.growth(feedback) <= 1.0 + _NEUTRAL)

    def fastest(self, feedback: Feedback, which: int) -> int:
        """Return the joint that moves most in the fastest growing error at one configuration."""
        values, vectors = np.linalg.eig(self._closed(feedback)[0][which])
        moved = np.abs(vectors[: self._size, np.argmax(np.abs(values))])
        return int(np.argmax(moved))

    def gain_margin(self, feedback: Feedback) -> float:
        """Return the largest factor by which all gains can be multiplied with a stable loop at all configurations.

        The factor is below 1 where the loop is unstable as it is, and at most 1000.
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
        for _ in range(14):  # halves the factor of 2 between the bounds down to 1e-4
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if stable(middle) else (low, middle)
        return low

    def sensitivity_peak(self, feedback: Feedback) -> float:
        """Return the maximum of the sensitivity function: the gain from a disturbing torque to the torque that acts.

        Its inverse is the least distance of the Nyquist curve from -1. A peak of 2 guarantees a gain margin of 2 and a
        phase margin of 29 degrees (Åström and Murray, Feedback Systems, section 12.2). The result is infinite where
        the loop is unstable.
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
        """Return the transition matrix of the closed loop over a sample time, its gain and its input matrix."""
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
        if feedback.integral is not None:  # the sum includes the present error
            last = slice(width - size, width)
            free[:, last, last] = one
            free[:, last, places] = self._sample_time * one
            gain[:, :, last] = feedback.integral
            gain[:, :, places] += self._sample_time * feedback.integral
        return free - entry @ gain, gain, entry


def _realised(transfer: Transfer) -> tuple[float, Array, Array]:
    """Return direct gain, transition and input matrix of a filter whose output is its first state."""
    numerator, denominator = transfer
    order = max(len(numerator), len(denominator)) - 1
    b, a = (np.concatenate((x, np.zeros(order + 1 - len(x)))) for x in (numerator, denominator))
    carried = np.eye(order, k=1)
    if order:
        carried[:, 0] -= a[1:]
    return float(b[0]), carried, b[1:] - a[1:] * b[0]
