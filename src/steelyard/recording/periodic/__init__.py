"""Periodic motion: its period, averages over the periods, and the noise that they show."""

from .averaging import PeriodicAverage as PeriodicAverage
from .averaging import average_periods as average_periods
from .period import Period as Period
from .period import find_period as find_period

__all__ = ["Period", "PeriodicAverage", "average_periods", "find_period"]
