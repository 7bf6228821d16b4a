"""Bounds of what an estimate leaves possible: intervals of parameters and least masses, with proofs (thesis 8.1)."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .intervals import ParameterInterval as ParameterInterval
    from .intervals import ParameterIntervals as ParameterIntervals
    from .intervals import parameter_intervals as parameter_intervals
    from .lightest_robot import LeastMass as LeastMass
    from .lightest_robot import LightestRobot as LightestRobot
    from .lightest_robot import lightest_robot as lightest_robot

__all__ = import_at_first_use(__name__, __file__)
