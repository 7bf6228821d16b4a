"""Trajectories, and the design of trajectories that excite a robot's dynamics for identification."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .design import ExcitationDesign as ExcitationDesign
    from .design import ExcitationObjective as ExcitationObjective
    from .design import design_excitation as design_excitation
    from .fourier import FourierTrajectory as FourierTrajectory
    from .fourier import RestToRestTrajectory as RestToRestTrajectory
    from .limit_margins import Margin as Margin
    from .motion_constraints import JointLimit as JointLimit
    from .motion_constraints import MotionConstraint as MotionConstraint
    from .motion_limits import MotionLimits as MotionLimits
    from .motion_limits import limits_from_file as limits_from_file
    from .motion_search import SearchOptions as SearchOptions
    from .spline import QuinticTrajectory as QuinticTrajectory
    from .spline import SplineTrajectory as SplineTrajectory
    from .trajectory import Trajectory as Trajectory
    from .trajectory import save_trajectory as save_trajectory
    from .trajectory_files import load_trajectory as load_trajectory

__all__ = import_at_first_use(__name__, __file__)
