"""Constraints: further knowledge of a robot, beyond the physics of single bodies."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .center_of_mass import CenterOfMassBox as CenterOfMassBox
    from .center_of_mass import CenterOfMassHull as CenterOfMassHull
    from .center_of_mass import CenterOfMassSphere as CenterOfMassSphere
    from .constraint import Constraint as Constraint
    from .constraint import Equality as Equality
    from .constraint import ModelLike as ModelLike
    from .density import DensityInBox as DensityInBox
    from .density import DensityInEllipsoid as DensityInEllipsoid
    from .linear import ConfidenceInterval as ConfidenceInterval
    from .linear import LinearBound as LinearBound
    from .linear import confidence_intervals as confidence_intervals
    from .masses import MeasuredMass as MeasuredMass
    from .masses import TotalMass as TotalMass
    from .symmetry import EqualLinks as EqualLinks
    from .symmetry import SymmetricLink as SymmetricLink
    from .toml_section import constraints_from_dict as constraints_from_dict

__all__ = import_at_first_use(__name__, __file__)
