"""Estimation and excitation that run while the robot moves."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .active_excitation import ActiveExcitation as ActiveExcitation
    from .active_excitation import ExcitationStep as ExcitationStep
    from .change_detector import Change as Change
    from .change_detector import ChangeDetector as ChangeDetector
    from .online_estimator import OnlineEstimate as OnlineEstimate
    from .online_estimator import OnlineEstimator as OnlineEstimator
    from .online_payload import OnlinePayload as OnlinePayload
    from .online_payload import OnlinePayloadEstimate as OnlinePayloadEstimate
    from .pick_up import PickUp as PickUp
    from .pick_up import PickUpRun as PickUpRun
    from .pick_up import simulated_pick_up as simulated_pick_up
    from .pick_up import watch_pick_up as watch_pick_up
    from .simulated_excitation import SimulatedExcitation as SimulatedExcitation
    from .simulated_excitation import excite_on_the_fly as excite_on_the_fly
    from .source_project import generate_online as generate_online

__all__ = import_at_first_use(__name__, __file__)
