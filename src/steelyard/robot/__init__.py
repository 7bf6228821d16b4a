"""Robots: the tree of joints and links, the terms of the drives, and reading and writing of descriptions."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .description import DescriptionFormat as DescriptionFormat
    from .description import description_format as description_format
    from .file import RobotFile as RobotFile
    from .inertia import INERTIA_SYMBOLS as INERTIA_SYMBOLS
    from .inertia import Inertia as Inertia
    from .joint import Attachment as Attachment
    from .joint import Drives as Drives
    from .joint import Joint as Joint
    from .joint import JointKind as JointKind
    from .joint import Link as Link
    from .mjcf_writer import write_mjcf as write_mjcf
    from .robot import Condition as Condition
    from .robot import Robot as Robot
    from .robot import Term as Term
    from .robot import TermParameter as TermParameter
    from .urdf_writer import write_urdf as write_urdf

__all__ = import_at_first_use(__name__, __file__)
