"""Filters that turn measured positions into positions, velocities and accelerations: one a file, behind one base."""

from steelyard.recording.filters.butterworth import Butterworth as Butterworth
from steelyard.recording.filters.fourier import FourierFit as FourierFit
from steelyard.recording.filters.kalman import KalmanSmoother as KalmanSmoother
from steelyard.recording.filters.kalman import SmoothedMotion as SmoothedMotion
from steelyard.recording.filters.motion_filter import Motion as Motion
from steelyard.recording.filters.motion_filter import MotionFilter as MotionFilter
from steelyard.recording.filters.motion_filter import Response as Response
from steelyard.recording.filters.savitzky_golay import SavitzkyGolay as SavitzkyGolay
from steelyard.recording.filters.table import FILTERS as FILTERS
from steelyard.recording.filters.table import filter_from as filter_from

__all__ = [
    "FILTERS",
    "Butterworth",
    "FourierFit",
    "KalmanSmoother",
    "Motion",
    "MotionFilter",
    "Response",
    "SavitzkyGolay",
    "SmoothedMotion",
    "filter_from",
]
