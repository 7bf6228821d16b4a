"""Model-based controllers: blocks that run in the simulator, and whose model part is generated as source."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .active_observer import ActiveObserver as ActiveObserver
    from .adaptive_force import AdaptiveForceControl as AdaptiveForceControl
    from .adaptive_force import ForceControlOptions as ForceControlOptions
    from .block import ControlBlock as ControlBlock
    from .closed_loop import ClosedLoop as ClosedLoop
    from .computed_torque import ComputedTorque as ComputedTorque
    from .feedforward_tracking import FeedforwardTracking as FeedforwardTracking
    from .gravity_compensation import GravityCompensation as GravityCompensation
    from .impedance import ImpedanceControl as ImpedanceControl
    from .joint_feedback import JointFeedback as JointFeedback
    from .joint_references import ConstantReference as ConstantReference
    from .joint_references import FunctionReference as FunctionReference
    from .joint_references import JointReference as JointReference
    from .joint_references import TrajectoryReference as TrajectoryReference
    from .play import play as play
    from .poses import ConstantPose as ConstantPose
    from .poses import PoseFunction as PoseFunction
    from .poses import PoseReference as PoseReference
    from .poses import PoseTarget as PoseTarget
    from .poses import PoseTrajectory as PoseTrajectory
    from .poses import rotation_matrix as rotation_matrix
    from .poses import rotation_vector as rotation_vector
    from .position_tracking import PositionTracking as PositionTracking
    from .stiffness import StiffnessEstimator as StiffnessEstimator
    from .task_dynamics import NullSpaceControl as NullSpaceControl
    from .task_space import TaskSpaceControl as TaskSpaceControl
    from .tool import Tool as Tool
    from .velocities import FilteredDifference as FilteredDifference
    from .velocities import MeasuredVelocity as MeasuredVelocity
    from .velocities import NumericalDifference as NumericalDifference
    from .velocities import VelocityEstimator as VelocityEstimator

__all__ = import_at_first_use(__name__, __file__)
