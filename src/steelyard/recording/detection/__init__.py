"""Faults of a log that can be found in its numbers, and where they are."""

from steelyard.recording.detection.clock import ClockStatistics as ClockStatistics
from steelyard.recording.detection.clock import clock_statistics as clock_statistics
from steelyard.recording.detection.delay import DelayEstimate as DelayEstimate
from steelyard.recording.detection.delay import advanced as advanced
from steelyard.recording.detection.delay import estimate_delay as estimate_delay
from steelyard.recording.detection.diagnosis import DETECTORS as DETECTORS
from steelyard.recording.detection.diagnosis import Diagnosis as Diagnosis
from steelyard.recording.detection.diagnosis import diagnose as diagnose
from steelyard.recording.detection.diagnosis import faulty_rows as faulty_rows
from steelyard.recording.detection.intervals import Interval as Interval
from steelyard.recording.detection.intervals import Intervals as Intervals
from steelyard.recording.detection.repeated import find_repeated as find_repeated
from steelyard.recording.detection.resolution import noise_deviation as noise_deviation
from steelyard.recording.detection.resolution import resolution as resolution
from steelyard.recording.detection.saturation import find_saturation as find_saturation
from steelyard.recording.detection.saturation import saturation_levels as saturation_levels
from steelyard.recording.detection.stiction import find_stiction as find_stiction
from steelyard.recording.detection.stiction import stiction_duration as stiction_duration

__all__ = [
    "DETECTORS",
    "ClockStatistics",
    "DelayEstimate",
    "Diagnosis",
    "Interval",
    "Intervals",
    "advanced",
    "clock_statistics",
    "diagnose",
    "estimate_delay",
    "faulty_rows",
    "find_repeated",
    "find_saturation",
    "find_stiction",
    "noise_deviation",
    "resolution",
    "saturation_levels",
    "stiction_duration",
]
