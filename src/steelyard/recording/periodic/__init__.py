"""Periodic motion: its period, averages over the periods, and the noise that they show."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .averaging import PeriodicAverage as PeriodicAverage
    from .averaging import average_periods as average_periods
    from .period import Period as Period
    from .period import find_period as find_period

__all__ = import_at_first_use(__name__, __file__)
