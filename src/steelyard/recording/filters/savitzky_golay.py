"""Savitzky-Golay filter: polynomials fitted over a moving window, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from steelyard.errors import InputError

from .motion_filter import Array, Motion, MotionFilter, Response, above, whole

__all__ = ["SavitzkyGolay"]


@dataclass(frozen=True)
class SavitzkyGolay(MotionFilter):
    """Least-squares polynomials over a moving window; position, velocity and acceleration of the middle are taken.

    Polynomials up to the degree pass unchanged, derivatives included; slow motion so loses next to nothing, and there
    is no error of differences. Beyond the cutoff the response falls slowly, with ripples: it suppresses less noise
    than a Butterworth filter of the same cutoff. Its memory is the window, so that a gap or a spike harms no more
    than that. Half a window at each end stands on the polynomial of the first (last) full window.

    Parameters
    ----------
    window
        s; None chooses that whose response is nearest to 1/2 at the cutoff.
    degree
        Of the polynomials, 2 to 8.
    cutoff
        Hz; None takes that of [processing].

    References
    ----------
    A. Savitzky and M. J. E. Golay, Analytical Chemistry 36, 1964. R. W. Schafer, What is a Savitzky-Golay filter?,
    IEEE Signal Processing Magazine 28, 2011.

    Examples
    --------
    >>> t = np.arange(200)[:, None] / 100.0
    >>> motion = SavitzkyGolay(window=0.2).motion(t[:, 0], t**4, 100.0, "quartic")
    >>> bool(np.allclose(motion.ddq, 12.0 * t**2))
    True
    """

    kind: ClassVar[str] = "savitzky_golay"

    window: float | None = None
    degree: int = 4
    cutoff: float | None = None

    def _clean(self, where: str) -> None:
        for name, what in (("window", "a time in s"), ("cutoff", "a frequency in Hz")):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, above(0.0, getattr(self, name), f"{where}, key {name!r},", what))
        whole(self.degree, 2, 8, f"{where}, key 'degree',")

    def settled(self, cutoff: float | None, order: int, where: str) -> Self:
        """See `MotionFilter.settled`."""
        if self.window is not None:
            return self
        chosen = cutoff if self.cutoff is None else self.cutoff
        if chosen is None:
            raise InputError(f'{where}: the filter "savitzky_golay" needs `window` in s, or a `cutoff` in Hz.')
        return replace(self, cutoff=chosen)

    def half_window(self, rate: float) -> int:
        """Rows on either side of the middle."""
        least = self.degree // 2 + 1
        if self.window is not None:
            return max(least, round(0.5 * self.window * rate))
        assert self.cutoff is not None
        # A first guess (Schafer 2011, eq. 12, at -3 dB), then the integer nearest to half the amplitude.
        f = np.array([self.cutoff / rate])
        guess = max(least, round((self.degree + 1.0) / (6.4 * float(f[0]))))
        low, high = least, max(4 * guess, least + 8)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if _gain(middle, self.degree, 0, f)[0] > 0.5 else (low, middle)
        errors = [abs(_gain(m, self.degree, 0, f)[0] - 0.5) for m in (low, high)]
        return (low, high)[int(np.argmin(errors))]

    def motion(self, t: Array, q: Array, rate: float, source: str) -> Motion:
        """See `MotionFilter.motion`."""
        from scipy.signal import savgol_filter

        half = self.half_window(rate)
        length = 2 * half + 1
        if length > len(q):
            raise InputError(
                f"{source} has {len(q)} rows but the window of the filter takes {length}; "
                "shorten `window`, raise `cutoff`, or use a longer log."
            )
        q, dq, ddq = (
            np.ascontiguousarray(savgol_filter(q, length, self.degree, deriv=order, delta=1.0 / rate, axis=0))
            for order in range(3)
        )
        return Motion(q, dq, ddq)

    def response(self, frequencies: ArrayLike, rate: float) -> Response:
        """See `MotionFilter.response`."""
        f = np.asarray(frequencies, dtype=np.float64) / rate
        half = self.half_window(rate)
        return Response(*(_gain(half, self.degree, order, f) for order in range(3)))

    def padding(self, rate: float) -> int:
        """See `MotionFilter.padding`: a whole window, so that the ends of a log are treated as ends only there."""
        return 2 * self.half_window(rate) + ceil(self.degree / 2) + 1

    def settling(self, rate: float) -> float:
        """See `MotionFilter.settling`. It is half a window, over which the last polynomial is used off its middle."""
        return self.half_window(rate) / rate


def _gain(half: int, degree: int, derivative: int, frequencies: Array) -> Array:
    """Response at frequencies in cycles a sample, relative to the true derivative of a sine."""
    from scipy.signal import savgol_coeffs

    k = np.arange(-half, half + 1)
    coefficients = savgol_coeffs(2 * half + 1, degree, deriv=derivative, use="dot")
    gain = np.ones_like(frequencies)
    for place in np.flatnonzero(frequencies):  # one at a time, because windows may be long
        w = 2.0 * np.pi * frequencies[place]
        wave, scale = (np.sin(w * k), w) if derivative == 1 else (np.cos(w * k), 1.0 if derivative == 0 else -(w**2))
        gain[place] = coefficients @ wave / scale
    return gain
