"""Recordings of a robot: reading logs, finding their faults, and processing them to samples."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .automatic import decide as decide
    from .chunks import Chunk as Chunk
    from .chunks import process_chunks as process_chunks
    from .chunks import read_chunks as read_chunks
    from .chunks import read_middle as read_middle
    from .columns import LogColumns as LogColumns
    from .cutoff import CutoffChoice as CutoffChoice
    from .cutoff import choose_cutoff as choose_cutoff
    from .diagnosis import DelayEstimate as DelayEstimate
    from .diagnosis import Diagnosis as Diagnosis
    from .diagnosis import Intervals as Intervals
    from .diagnosis import clock_statistics as clock_statistics
    from .diagnosis import estimate_delay as estimate_delay
    from .diagnosis import find_repeated as find_repeated
    from .diagnosis import find_saturation as find_saturation
    from .diagnosis import find_stiction as find_stiction
    from .diagnosis import find_stuck_torque as find_stuck_torque
    from .filters import Butterworth as Butterworth
    from .filters import FourierFit as FourierFit
    from .filters import KalmanSmoother as KalmanSmoother
    from .filters import MotionFilter as MotionFilter
    from .filters import SavitzkyGolay as SavitzkyGolay
    from .filters import find_period as find_period
    from .formats import LogFile as LogFile
    from .measurements import Measurements as Measurements
    from .options import Processing as Processing
    from .periodic import PeriodicAverage as PeriodicAverage
    from .periodic import average_periods as average_periods
    from .recognition import ColumnMeaning as ColumnMeaning
    from .recognition import Layout as Layout
    from .recognition import find_columns as find_columns
    from .recording import Recording as Recording
    from .samples import Samples as Samples

__all__ = import_at_first_use(__name__, __file__)
