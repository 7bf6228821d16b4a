"""Distances of the collision geometry of a URDF as Pinocchio sees them, in the numbering of ours."""

from collections import Counter

import numpy as np
import pytest
from pinocchio_oracle import URDFS, driving_matrix, pinocchio

pytest.importorskip("coal", reason="coal (the collision library) is not installed")

__all__ = ["PinocchioDistances", "pinocchio", "urdf"]


def urdf(stem):
    """Return the URDF of example-robot-data with this name."""
    found = [path for path in URDFS if path.stem == stem]
    if not found:
        pytest.skip(f"{stem} of example-robot-data is not installed")
    return found[0]


class PinocchioDistances:
    """Signed distances of pairs of shapes; meshes as hulls that the package coal makes itself, or as they are."""

    def __init__(self, path, geometry, pairs, exact=False):
        robot = geometry.robot
        self.model = pinocchio.buildModelFromUrdf(str(path))
        self.placements = self.model.createData()
        self.matrix, self.offset = driving_matrix(robot)
        self.joints = [self.model.joints[self.model.getJointId(joint.name)] for joint in robot.joints]
        folders = [str(folder) for folder in path.parents]
        self.geometry = pinocchio.buildGeomFromUrdf(
            self.model, str(path), pinocchio.GeometryType.COLLISION, package_dirs=folders
        )
        seen = Counter()
        numbers = []
        for shape in geometry.shapes:
            numbers.append(self.geometry.getGeometryId(f"{shape.link}_{seen[shape.link]}"))
            seen[shape.link] += 1
        assert max(numbers) < len(self.geometry.geometryObjects)
        if not exact:
            for one in self.geometry.geometryObjects:
                if hasattr(one.geometry, "buildConvexHull"):
                    one.geometry.buildConvexHull(True, "Qt")
                    one.geometry = one.geometry.convex
        self.geometry.removeAllCollisionPairs()
        for first, second in pairs:
            self.geometry.addCollisionPair(pinocchio.CollisionPair(numbers[first], numbers[second]))
        self.data = pinocchio.GeometryData(self.geometry)

    def state(self, q):
        """Return Pinocchio's configuration; joints that the robot does not have are at their neutral position."""
        full = pinocchio.neutral(self.model)
        for joint, value in zip(self.joints, self.matrix @ q + self.offset, strict=True):
            full[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        return full

    def __call__(self, q):
        rows = []
        for row in np.atleast_2d(q):
            pinocchio.computeDistances(self.model, self.placements, self.geometry, self.data, self.state(row))
            rows.append([result.min_distance for result in self.data.distanceResults])
        return np.array(rows)
