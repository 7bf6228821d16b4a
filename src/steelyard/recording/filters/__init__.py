"""Filters that turn measured positions into positions, velocities and accelerations: one a file, behind one base."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .butterworth import Butterworth as Butterworth
    from .fourier import FourierFit as FourierFit
    from .kalman import KalmanSmoother as KalmanSmoother
    from .kalman import SmoothedMotion as SmoothedMotion
    from .motion_filter import Motion as Motion
    from .motion_filter import MotionFilter as MotionFilter
    from .motion_filter import Response as Response
    from .savitzky_golay import SavitzkyGolay as SavitzkyGolay
    from .table import FILTERS as FILTERS
    from .table import filter_from as filter_from

__all__ = import_at_first_use(__name__, __file__)
