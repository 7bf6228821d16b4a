"""Pinocchio's view of a robot, in the coordinates of ours."""

from pathlib import Path

import numpy as np
import pytest

pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")


def collection():
    places = [Path(p) for p in pinocchio.__path__]
    for place in places:
        for parent in place.parents:
            found = sorted((parent / "share" / "example-robot-data" / "robots").glob("**/*.urdf"))
            if found:
                return found
    return []


URDFS = collection()


def driving_matrix(robot):
    """Map coordinates to joint values, (joints, N), and the joints' offsets."""
    matrix, offset = np.zeros((len(robot.joints), robot.dof)), np.zeros(len(robot.joints))
    for row, joint in enumerate(robot.joints):
        matrix[row, joint.coordinate] = joint.multiplier
        offset[row] = joint.offset
    return matrix, offset


class Oracle:
    """Pinocchio's model of a URDF in which mimic joints move freely, driven from our coordinates."""

    def __init__(self, path, robot):
        self.model = pinocchio.buildModelFromUrdf(str(path))
        self.data = self.model.createData()
        self.matrix, self.offset = driving_matrix(robot)
        ids = [self.model.getJointId(joint.name) for joint in robot.joints]
        assert len(set(ids)) == self.model.nv
        self.velocity = [self.model.joints[i].idx_v for i in ids]
        self.position = [(self.model.joints[i].idx_q, self.model.joints[i].nq) for i in ids]
        self.ids = ids

    def state(self, q, dq, ddq):
        values = self.matrix @ q + self.offset
        full = pinocchio.neutral(self.model)
        for value, (index, size) in zip(values, self.position, strict=True):
            full[index : index + size] = value if size == 1 else (np.cos(value), np.sin(value))
        v, a = np.zeros((2, self.model.nv))
        v[self.velocity], a[self.velocity] = self.matrix @ dq, self.matrix @ ddq
        return full, v, a

    def torque(self, q, dq, ddq):
        return self.matrix.T @ pinocchio.rnea(self.model, self.data, *self.state(q, dq, ddq))[self.velocity]

    def inertia_matrix(self, q):
        full = pinocchio.crba(self.model, self.data, self.state(q, q, q)[0])
        full = np.triu(full) + np.triu(full, 1).T
        return self.matrix.T @ full[np.ix_(self.velocity, self.velocity)] @ self.matrix

    def regressor(self, q, dq, ddq):
        """Pinocchio's columns are m, m c, then the rotational inertia xx xy yy xz yz zz at the joint frame."""
        full = pinocchio.computeJointTorqueRegressor(self.model, self.data, *self.state(q, dq, ddq))
        full = self.matrix.T @ full[self.velocity]
        ours = []
        for joint in self.ids:
            columns = full[:, 10 * (joint - 1) : 10 * joint]
            ours.append(columns[:, [4, 5, 7, 6, 8, 9, 1, 2, 3, 0]])
        return np.concatenate(ours, axis=1)
