# The rooms, and the public names that need none, one a line and each from where it is defined: what type checkers read,
# and what __init__.py looks names up in.

from steelyard.excitation.design import ExcitationDesign as ExcitationDesign

from . import codegen as codegen
from . import collision as collision
from . import conic as conic
from . import control as control
from . import dynamics as dynamics
from . import estimators as estimators
from . import excitation as excitation
from . import feasibility as feasibility
from . import fleet as fleet
from . import graph as graph
from . import identification as identification
from . import lmi as lmi
from . import online as online
from . import recording as recording
from . import regression as regression
from . import report as report
from . import robot as robot
from . import simulation as simulation
from .dynamics.base_parameters import BaseParameters as BaseParameters
from .dynamics.model import Model as Model
from .dynamics.terms import Coulomb as Coulomb
from .dynamics.terms import MotorSide as MotorSide
from .dynamics.terms import Offset as Offset
from .dynamics.terms import RotorInertia as RotorInertia
from .dynamics.terms import Viscous as Viscous
from .errors import InputError as InputError
from .errors import MissingExtraError as MissingExtraError
from .errors import SolverError as SolverError
from .errors import SteelyardError as SteelyardError
from .estimators.fit import fit as fit
from .excitation.design import design_excitation as design_excitation
from .excitation.motion_limits import MotionLimits as MotionLimits
from .excitation.trajectory_files import load_trajectory as load_trajectory
from .feasibility.check import Verdict as Verdict
from .feasibility.check import check as check
from .feasibility.constraints.center_of_mass import CenterOfMassBox as CenterOfMassBox
from .feasibility.constraints.masses import TotalMass as TotalMass
from .feasibility.correct import correct as correct
from .feasibility.feasible_set import FeasibleSet as FeasibleSet
from .identification.identify import identify as identify
from .identification.play import play as play
from .identification.result import Identification as Identification
from .online.online_estimator import OnlineEstimate as OnlineEstimate
from .online.online_estimator import OnlineEstimator as OnlineEstimator
from .recording.columns import LogColumns as LogColumns
from .recording.options import Processing as Processing
from .recording.recording import Recording as Recording
from .recording.samples import Samples as Samples
from .regression.estimate import Estimate as Estimate
from .regression.information import Information as Information
from .regression.least_squares import least_squares as least_squares
from .robot.file import RobotFile as RobotFile
from .robot.inertia import Inertia as Inertia
from .robot.joint import Joint as Joint
from .robot.joint import Link as Link
from .robot.robot import Robot as Robot
from .robot.robot import Term as Term
from .robot.robot import TermParameter as TermParameter
from .simulation.simulate import simulate as simulate
from .simulation.simulation_result import SimulationResult as SimulationResult

__version__: str
