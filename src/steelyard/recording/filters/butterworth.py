"""Butterworth filter forwards and backwards, derivatives by central differences."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from .motion_filter import Array, Motion, MotionFilter, Response, above, whole
from .zero_phase import filter_padding, filter_settling, first_derivative, low_pass

__all__ = ["Butterworth"]


@dataclass(frozen=True)
class Butterworth(MotionFilter):
    """Butterworth filter forwards and backwards, then central differences of fourth order (thesis section 4.3.3).

    Its response is flat to the order 2n and falls without ripples. The differences make velocities too small by
    the factor (8 sin(w h) - sin(2 w h)) / (6 w h), about 1 - (w h)^4 / 30, accelerations by its square: at 0.5 Hz by
    6.5e-12 of them at 1 kHz, and by 1.0e-6 at 50 Hz.

    Parameters
    ----------
    cutoff
        Hz, where the amplitude is halved; None takes that of [processing].
    order
        Of the filter that is applied twice; None takes that of [processing].

    Examples
    --------
    >>> Butterworth(cutoff=5.0, order=3).response([0.0, 5.0], rate=1000.0).position.round(3).tolist()
    [1.0, 0.5]
    """

    kind: ClassVar[str] = "butterworth"

    cutoff: float | None = None
    order: int | None = None

    def _clean(self, where: str) -> None:
        if self.cutoff is not None:
            object.__setattr__(self, "cutoff", above(0.0, self.cutoff, f"{where}, key 'cutoff',", "a frequency in Hz"))
        if self.order is not None:
            whole(self.order, 1, 10, f"{where}, key 'order',")

    def settled(self, cutoff: float | None, order: int, where: str) -> Self:
        """See `MotionFilter.settled`; without a cutoff it only differentiates."""
        return replace(
            self,
            cutoff=cutoff if self.cutoff is None else self.cutoff,
            order=order if self.order is None else self.order,
        )

    def smoothed(self, values: Array, rate: float, source: str) -> Array:
        """Filter the columns."""
        if self.cutoff is None:
            return values
        return low_pass(values, rate, self.cutoff, self.order or 3, source)

    def motion(self, t: Array, q: Array, rate: float, source: str) -> Motion:
        """See `MotionFilter.motion`."""
        smooth = self.smoothed(q, rate, source)
        dq = first_derivative(smooth, rate)
        return Motion(smooth, dq, first_derivative(dq, rate))

    def response(self, frequencies: ArrayLike, rate: float) -> Response:
        """See `MotionFilter.response`."""
        f = np.asarray(frequencies, dtype=np.float64)
        gain = np.ones_like(f)
        if self.cutoff is not None:
            ratio = np.tan(np.pi * np.minimum(f / rate, 0.5)) / np.tan(np.pi * self.cutoff / rate)
            gain = 1.0 / (1.0 + ratio ** (2 * (self.order or 3)))
        # (8 sin x - sin 2x) / 6x at x = 2 pi f / rate, by sinc(y) = sin(pi y) / (pi y).
        difference = (4.0 * np.sinc(2.0 * f / rate) - np.sinc(4.0 * f / rate)) / 3.0
        return Response(gain, gain * difference, gain * difference**2)

    def padding(self, rate: float) -> int:
        """See `MotionFilter.padding`."""
        if self.cutoff is None or self.cutoff >= rate / 2.0:
            return 8
        return filter_padding(rate, self.cutoff, self.order or 3) + 8

    def settling(self, rate: float) -> float:
        """See `MotionFilter.settling`: until a thousandth of the transient is left; then two differences."""
        differences = 4.0 / rate
        if self.cutoff is None or self.cutoff >= rate / 2.0:
            return differences
        return filter_settling(rate, self.cutoff, self.order or 3) + differences
