"""Forward dynamics in time: integrators, sampled control loops, sensors, actuators, contact."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .actuators import Actuators as Actuators
    from .contact import ElasticContact as ElasticContact
    from .contact import Environment as Environment
    from .controller import Controller as Controller
    from .controller import Measurement as Measurement
    from .events import Event as Event
    from .events import Occurrence as Occurrence
    from .events import Status as Status
    from .events import at_time as at_time
    from .events import joint_limits as joint_limits
    from .motors import MotorControl as MotorControl
    from .motors import at_rest as at_rest
    from .motors import motor_coordinates as motor_coordinates
    from .sensors import Sensors as Sensors
    from .simulate import simulate as simulate
    from .simulation_result import Measured as Measured
    from .simulation_result import SimulationResult as SimulationResult
    from .stopping_conditions import StoppingConditions as StoppingConditions

__all__ = import_at_first_use(__name__, __file__)
