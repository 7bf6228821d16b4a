"""Constraints on the configuration of a robot: collisions of its links, obstacles, a table, a workspace."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .geometry_tables import GEOMETRY_KEYS as GEOMETRY_KEYS
    from .geometry_tables import geometry_from_dict as geometry_from_dict
    from .mesh_files import find_mesh as find_mesh
    from .mesh_files import read_mesh as read_mesh
    from .mesh_files import read_meshes as read_meshes
    from .robot_geometry import RobotGeometry as RobotGeometry
    from .robot_geometry import shapes_of_moving_links as shapes_of_moving_links
    from .robot_geometry import visual_shapes as visual_shapes
    from .self_collision import LeftOut as LeftOut
    from .self_collision import SelfCollision as SelfCollision
    from .shapes import Box as Box
    from .shapes import Capsule as Capsule
    from .shapes import Cylinder as Cylinder
    from .shapes import Mesh as Mesh
    from .shapes import PlacedShape as PlacedShape
    from .shapes import Shape as Shape
    from .shapes import Sphere as Sphere
    from .shapes import moments_of_surface as moments_of_surface
    from .workspace import Obstacle as Obstacle
    from .workspace import ObstacleClearance as ObstacleClearance
    from .workspace import TablePlane as TablePlane
    from .workspace import WorkspaceBox as WorkspaceBox

__all__ = import_at_first_use(__name__, __file__)
