"""The main jobs, composed of the rooms above: identification of a robot from logs, and work with saved estimates."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from ..control.closed_loop import ClosedLoop as ClosedLoop
    from ..control.play import play as play
    from ..estimators.physical_prior import LinkPrior as LinkPrior
    from ..estimators.physical_prior import PhysicalPrior as PhysicalPrior
    from ..estimators.physical_prior import physical_prior as physical_prior
    from ..recording.correction import Correction as Correction
    from .comparison import Comparison as Comparison
    from .comparison import compare_estimates as compare_estimates
    from .default_terms import model_of_estimate as model_of_estimate
    from .doctor import examine as examine
    from .elastic import Deflections as Deflections
    from .elastic import LogDeflections as LogDeflections
    from .elastic import SecondEncoders as SecondEncoders
    from .elastic import predict_deflections as predict_deflections
    from .encoders_only import DriveSettings as DriveSettings
    from .encoders_only import DriveValue as DriveValue
    from .encoders_only import PositionIdentification as PositionIdentification
    from .encoders_only import identify_from_positions as identify_from_positions
    from .examination import Examination as Examination
    from .examination import Finding as Finding
    from .excite import excite as excite
    from .first_robot_file import FirstRobotFile as FirstRobotFile
    from .first_robot_file import first_robot_file as first_robot_file
    from .identify import identify as identify
    from .mistakes import Hypothesis as Hypothesis
    from .mistakes import find_mistakes as find_mistakes
    from .next_steps import NextStep as NextStep
    from .next_steps import next_steps as next_steps
    from .payload import DriveGainIdentification as DriveGainIdentification
    from .payload import PayloadIdentification as PayloadIdentification
    from .payload import identify_drive_gains as identify_drive_gains
    from .payload import identify_payload as identify_payload
    from .result import Identification as Identification
    from .result import Prediction as Prediction
    from .result import Trace as Trace
    from .saved import EstimateExplanation as EstimateExplanation
    from .saved import check_certificate as check_certificate
    from .saved import check_estimate as check_estimate
    from .saved import correct_estimate as correct_estimate
    from .saved import explain_estimate as explain_estimate
    from .saved import parameters_for_source as parameters_for_source
    from .saved import parameters_of_description as parameters_of_description
    from .saved import parameters_of_estimate as parameters_of_estimate
    from .validation import Validation as Validation
    from .validation import validate_estimate as validate_estimate
    from .wam import demonstrate as demonstrate

__all__ = import_at_first_use(__name__, __file__)
