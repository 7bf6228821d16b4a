"""What runs while the robot moves."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .change_detector import Change as Change
    from .change_detector import ChangeDetector as ChangeDetector
    from .online_estimator import OnlineEstimate as OnlineEstimate
    from .online_estimator import OnlineEstimator as OnlineEstimator

__all__ = import_at_first_use(__name__, __file__)
