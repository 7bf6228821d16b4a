"""Logs in, signal processing, samples out."""

from steelyard.recording.chunks import Chunk as Chunk
from steelyard.recording.chunks import process_chunks as process_chunks
from steelyard.recording.chunks import read_chunks as read_chunks
from steelyard.recording.chunks import read_middle as read_middle
from steelyard.recording.columns import LogColumns as LogColumns
from steelyard.recording.cutoff import CutoffChoice as CutoffChoice
from steelyard.recording.cutoff import TorqueCutoffChoice as TorqueCutoffChoice
from steelyard.recording.cutoff import choose_cutoff as choose_cutoff
from steelyard.recording.decision import decide as decide
from steelyard.recording.detection import DelayEstimate as DelayEstimate
from steelyard.recording.detection import Diagnosis as Diagnosis
from steelyard.recording.detection import Intervals as Intervals
from steelyard.recording.detection import clock_statistics as clock_statistics
from steelyard.recording.detection import estimate_delay as estimate_delay
from steelyard.recording.detection import find_repeated as find_repeated
from steelyard.recording.detection import find_saturation as find_saturation
from steelyard.recording.detection import find_stiction as find_stiction
from steelyard.recording.filters import Butterworth as Butterworth
from steelyard.recording.filters import FourierFit as FourierFit
from steelyard.recording.filters import KalmanSmoother as KalmanSmoother
from steelyard.recording.filters import MotionFilter as MotionFilter
from steelyard.recording.filters import SavitzkyGolay as SavitzkyGolay
from steelyard.recording.periodic import PeriodicAverage as PeriodicAverage
from steelyard.recording.periodic import average_periods as average_periods
from steelyard.recording.periodic import find_period as find_period
from steelyard.recording.processing import Processing as Processing
from steelyard.recording.recording import Recording as Recording
from steelyard.recording.samples import Samples as Samples

__all__ = [
    "Butterworth",
    "Chunk",
    "CutoffChoice",
    "DelayEstimate",
    "Diagnosis",
    "FourierFit",
    "Intervals",
    "KalmanSmoother",
    "LogColumns",
    "MotionFilter",
    "PeriodicAverage",
    "Processing",
    "Recording",
    "Samples",
    "SavitzkyGolay",
    "TorqueCutoffChoice",
    "average_periods",
    "choose_cutoff",
    "clock_statistics",
    "decide",
    "estimate_delay",
    "find_period",
    "find_repeated",
    "find_saturation",
    "find_stiction",
    "process_chunks",
    "read_chunks",
    "read_middle",
]
