"""The physics: kinematics, Newton-Euler dynamics, regressor, drive terms, base parameters, and the model."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .base_parameters import BaseParameters as BaseParameters
    from .by_joint import ByJoint as ByJoint
    from .elastic_robot import AtCoordinates as AtCoordinates
    from .elastic_robot import Transmission as Transmission
    from .elastic_robot import elastic_robot as elastic_robot
    from .friction_terms import ChannelFriction as ChannelFriction
    from .friction_terms import CoulombByDirection as CoulombByDirection
    from .friction_terms import LoadFriction as LoadFriction
    from .friction_terms import PiecewiseFriction as PiecewiseFriction
    from .friction_terms import PolynomialFriction as PolynomialFriction
    from .friction_terms import SmoothCoulomb as SmoothCoulomb
    from .friction_terms import Stribeck as Stribeck
    from .friction_terms import ViscousByDirection as ViscousByDirection
    from .functions import DEFAULT_FUNCTIONS as DEFAULT_FUNCTIONS
    from .model import Model as Model
    from .model_source import model_project as model_project
    from .presliding import Dahl as Dahl
    from .presliding import LuGre as LuGre
    from .spring_terms import Cogging as Cogging
    from .spring_terms import Counterbalance as Counterbalance
    from .spring_terms import Screw as Screw
    from .spring_terms import Spring as Spring
    from .spring_terms import Tendon as Tendon
    from .terms import Coulomb as Coulomb
    from .terms import MotorSide as MotorSide
    from .terms import Offset as Offset
    from .terms import RotorInertia as RotorInertia
    from .terms import ShapedTerm as ShapedTerm
    from .terms import Viscous as Viscous
    from .terms import term_from_dict as term_from_dict

__all__ = import_at_first_use(__name__, __file__)
