"""The main job, composed of the rooms above: logs in, feasible model out."""

from .demonstration import demonstrate as demonstrate
from .identify import identify as identify
from .result import Identification as Identification
from .result import Prediction as Prediction
from .result import Trace as Trace
from .verdict import check_estimate as check_estimate

__all__ = ["Identification", "Prediction", "Trace", "check_estimate", "demonstrate", "identify"]
