"""Drives from commands and encoders alone, where no torque was measured: the motion is matched by simulation."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .drive_result import DriveValue as DriveValue
    from .drive_result import PositionIdentification as PositionIdentification
    from .drive_settings import DriveSettings as DriveSettings
    from .positions import identify_from_positions as identify_from_positions

__all__ = import_at_first_use(__name__, __file__)
