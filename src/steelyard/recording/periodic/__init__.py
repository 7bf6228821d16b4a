"""Periodic motion: its period, averages over the periods, and the noise that they show."""

from steelyard.recording.periodic.averaging import PeriodicAverage as PeriodicAverage
from steelyard.recording.periodic.averaging import average_periods as average_periods
from steelyard.recording.periodic.period import Period as Period
from steelyard.recording.periodic.period import find_period as find_period

__all__ = ["Period", "PeriodicAverage", "average_periods", "find_period"]
