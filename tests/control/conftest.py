"""Robots whose dynamics Pinocchio computes: a plant that knows nothing of the code under test."""

from functools import cached_property

import numpy as np
import pytest

import steelyard as sy
from steelyard.simulation import Measurement


class Plant:
    """A robot of a URDF, moved by Pinocchio's forward dynamics under held torques (Runge-Kutta of order 4).

    Besides the links it may have friction and rotors, in the formulas of the thesis (2.10 to 2.12) written out anew.
    """

    def __init__(self, path, link, viscous=0.0, coulomb=0.0, rotor=0.0):
        import pinocchio

        self.pin = pinocchio
        self.model = pinocchio.buildModelFromUrdf(str(path))
        self.data = self.model.createData()
        self.frame = self.model.getFrameId(link)
        self.count = self.model.nv
        self.viscous, self.coulomb, self.rotor = viscous, coulomb, rotor

    @cached_property
    def below(self):
        return np.tril_indices(self.count, -1)

    def pose(self, q):
        self.pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.frame].homogeneous.copy()

    def jacobian(self, q, point=(0.0, 0.0, 0.0)):
        aligned = self.pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        found = self.pin.computeFrameJacobian(self.model, self.data, q, self.frame, aligned).copy()
        arm = self.pose(q)[:3, :3] @ np.asarray(point)
        found[:3] -= self.pin.skew(arm) @ found[3:]
        return found

    def acceleration(self, q, dq, torque, wrench=None):
        effort = torque - self.viscous * dq - self.coulomb * np.sign(dq)
        if wrench is not None:
            effort = effort + self.jacobian(q).T @ wrench
        if self.rotor == 0.0:  # most tests, in a third of the time
            return self.pin.aba(self.model, self.data, q, dq, effort).copy()
        inertia = self.inertia_matrix(q) + self.rotor * np.eye(self.count)
        return np.linalg.solve(inertia, effort - self.pin.nonLinearEffects(self.model, self.data, q, dq))

    def inertia_matrix(self, q):
        found = self.pin.crba(self.model, self.data, q).copy()
        found[self.below] = found.T[self.below]  # only the upper triangle is filled in
        return found

    def tool_acceleration(self, q, dq, ddq):
        """Acceleration of the frame's origin and angular acceleration, base axes."""
        aligned = self.pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        self.pin.forwardKinematics(self.model, self.data, q, dq, ddq)
        self.pin.updateFramePlacements(self.model, self.data)
        return self.pin.getFrameClassicalAcceleration(self.model, self.data, self.frame, aligned).vector.copy()

    def run(self, controller, q, dq, duration, wrench=None, velocity=True, steps=1):
        """Close the loop; return times, positions and velocities at the controller's calls."""
        q, dq = np.array(q, dtype=float), np.array(dq, dtype=float)
        sample_time, force = controller.sample_time, (lambda t: None) if wrench is None else wrench
        h = sample_time / steps

        def slope(t, state):
            return np.concatenate((state[1], self.acceleration(*state, torque, force(t)))).reshape(2, -1)

        times, places, speeds = [], [], []
        for k in range(round(duration / sample_time) + 1):
            t = k * sample_time
            times.append(t)
            places.append(q)
            speeds.append(dq)
            seen = Measurement(t=t, q=q, dq=dq if velocity else None, force=force(t))
            if k == 0:
                controller.start(seen)
            torque = controller.torque(seen).copy()
            state = np.stack((q, dq))
            for i in range(steps):
                at = t + i * h
                k1 = slope(at, state)
                k2 = slope(at + h / 2, state + h / 2 * k1)
                k3 = slope(at + h / 2, state + h / 2 * k2)
                k4 = slope(at + h, state + h * k3)
                state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            q, dq = state
        return np.array(times), np.array(places), np.array(speeds)


@pytest.fixture(scope="session")
def plant_class():
    return Plant


LINKS = {"ur5": ("ur5_robot.urdf", "tool0"), "xarm7": ("xarm7.urdf", "link7")}


@pytest.fixture(scope="session", params=LINKS)
def arm(request):
    """Model, parameters, plant and the name of the tool's link of a robot with 6 joints and one with 7."""
    return arm_of(request.param)


@pytest.fixture(scope="session")
def redundant():
    """As `arm`, with 7 joints."""
    return arm_of("xarm7")


@pytest.fixture(scope="session")
def six():
    """As `arm`, with 6 joints."""
    return arm_of("ur5")


_known = {}


def arm_of(name):
    if name not in _known:
        oracle = pytest.importorskip("pinocchio_oracle", reason="Pinocchio (the oracle) is not installed")
        file, link = LINKS[name]
        path = next((p for p in oracle.URDFS if p.name == file), None)
        if path is None:
            pytest.skip(f"example-robot-data with {file} is not installed")
        robot = sy.Robot.from_urdf(path)
        _known[name] = (sy.Model(robot), robot.parameters, Plant(path, link), link)
    return _known[name]


def state_of(model, random, speed=1.0):
    """A bent configuration, away from singularities, and velocities."""
    q = random.uniform(-0.3, 0.3, model.dof)
    q[1:4] += [-0.6, 1.2, 0.4] if model.dof == 6 else [0.4, 0.3, 1.3]
    q[4:6] += 0.8
    return q, random.uniform(-speed, speed, model.dof)


@pytest.fixture
def bent():
    return state_of
