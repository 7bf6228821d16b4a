"""What infeasibility tells: possible values of every parameter, reasons, prices (thesis 8.1)."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .conflict import Conflict as Conflict
    from .degree import BaseParameterDegree as BaseParameterDegree
    from .explanation import InfeasibilityExplanation as InfeasibilityExplanation
    from .explanation import explain_infeasibility as explain_infeasibility
    from .intervals import ParameterInterval as ParameterInterval
    from .intervals import ParameterIntervals as ParameterIntervals
    from .intervals import parameter_intervals as parameter_intervals
    from .lightest import LeastMass as LeastMass
    from .lightest import LightestRobot as LightestRobot
    from .lightest import lightest_robot as lightest_robot

__all__ = import_at_first_use(__name__, __file__)
