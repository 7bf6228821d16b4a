"""Constraints beyond the physics of single bodies: what else is known of the robot."""

from .basic import CenterOfMassBox as CenterOfMassBox
from .basic import Constraint as Constraint
from .basic import Equality as Equality
from .basic import TotalMass as TotalMass
from .basic import constraints_from_dict as constraints_from_dict

__all__ = ["CenterOfMassBox", "Constraint", "Equality", "TotalMass", "constraints_from_dict"]
