"""The physics: kinematics, Newton-Euler dynamics, regressor, drive terms, base parameters, and the model."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .base_parameters import BaseParameters as BaseParameters
    from .functions import DEFAULT_FUNCTIONS as DEFAULT_FUNCTIONS
    from .model import Model as Model
    from .model_source import model_project as model_project
    from .terms import Coulomb as Coulomb
    from .terms import MotorSide as MotorSide
    from .terms import Offset as Offset
    from .terms import RotorInertia as RotorInertia
    from .terms import Viscous as Viscous
    from .terms import term_from_dict as term_from_dict

__all__ = import_at_first_use(__name__, __file__)
