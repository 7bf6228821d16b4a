"""Robots with elastic joints: stiffness, deflections, and motors that move beside the links."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .deflections import Deflections as Deflections
    from .deflections import LogDeflections as LogDeflections
    from .deflections import predict_deflections as predict_deflections
    from .second_encoders import SecondEncoders as SecondEncoders

__all__ = import_at_first_use(__name__, __file__)
