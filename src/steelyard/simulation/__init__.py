"""Forward dynamics in time: integrators, sampled control loops, sensors, actuators, contact."""

from .actuators import Actuators
from .contact import ElasticContact, Environment
from .controller import Controller
from .events import Event, Occurrence, at_time, joint_limits
from .measurement import Measurement
from .result import Measured, SimulationResult
from .safety import Safety
from .sensors import Sensors
from .simulate import simulate
from .status import Status

__all__ = [
    "Actuators",
    "Controller",
    "ElasticContact",
    "Environment",
    "Event",
    "Measured",
    "Measurement",
    "Occurrence",
    "Safety",
    "Sensors",
    "SimulationResult",
    "Status",
    "at_time",
    "joint_limits",
    "simulate",
]
