"""Steelyard weighs a robot by moving it.

It turns a robot description and a motion log into the robot's dynamic parameters, physically possible and with a
proof, and hands them back as a URDF, JSON and a report.
"""

from .first_use import import_at_first_use

__version__ = "0.1.0"

# The names stand in the list that type checkers read.
__all__ = sorted([*import_at_first_use(__name__, f"{__file__}i"), "__version__"])
