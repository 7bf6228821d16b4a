"""Filters that turn measured positions into positions, velocities and accelerations: one a file, with one base.

The base is `MotionFilter`; `zero_phase.py` holds the filtering of signals itself, forwards and backwards.
"""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .butterworth import Butterworth as Butterworth
    from .fourier_series import FourierFit as FourierFit
    from .fourier_series import FourierSeries as FourierSeries
    from .fourier_series import Period as Period
    from .fourier_series import find_period as find_period
    from .kalman import KalmanSmoother as KalmanSmoother
    from .kalman import SmoothedMotion as SmoothedMotion
    from .motion_filter import Motion as Motion
    from .motion_filter import MotionFilter as MotionFilter
    from .motion_filter import Response as Response
    from .motion_filter import whole as whole
    from .savitzky_golay import SavitzkyGolay as SavitzkyGolay

__all__ = import_at_first_use(__name__, __file__)
