"""Finding the faults of a log in its numbers, and the rows where they are."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from ..clock import ClockStatistics as ClockStatistics
    from ..clock import clock_statistics as clock_statistics
    from .delay import DelayEstimate as DelayEstimate
    from .delay import advanced as advanced
    from .delay import estimate_delay as estimate_delay
    from .detectors import DETECTORS as DETECTORS
    from .detectors import Interval as Interval
    from .detectors import Intervals as Intervals
    from .detectors import faulty_rows as faulty_rows
    from .detectors import find_missing as find_missing
    from .detectors import find_repeated as find_repeated
    from .detectors import find_saturation as find_saturation
    from .detectors import find_stiction as find_stiction
    from .detectors import find_stuck_torque as find_stuck_torque
    from .detectors import noise_deviation as noise_deviation
    from .detectors import remedy_of as remedy_of
    from .detectors import resolution as resolution
    from .detectors import saturation_levels as saturation_levels
    from .detectors import stiction_duration as stiction_duration
    from .diagnosis import Diagnosis as Diagnosis
    from .diagnosis import diagnose as diagnose
    from .transmission import Transmission as Transmission
    from .transmission import diagnose_transmission as diagnose_transmission

__all__ = import_at_first_use(__name__, __file__)
