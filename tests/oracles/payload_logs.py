"""Logs of simulated arms with and without something in their hand: Pinocchio moves them, not this project."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pinocchio_oracle import URDFS, pinocchio
from scipy.signal import lfilter

import steelyard as sy

ARMS = {
    "ur5": ("ur5_robot.urdf", ()),
    "ur10": ("ur10_robot.urdf", ()),
    "panda": ("panda.urdf", ("panda_finger_joint1", "panda_finger_joint2")),
}
RATE, PERIOD, PERIODS, HARMONICS = 250.0, 10.0, 4, 5
CORRELATION = 0.8  # of the noise of neighbouring torques
ENCODER = 2e-5  # rad


@dataclass(frozen=True)
class Payload:
    """The truth: mass, centre of mass and inertia about it, in the mounting frame."""

    mass: float
    com: np.ndarray
    about_com: np.ndarray

    @classmethod
    def random(cls, random, mass):
        """A body as dense as plastics or aluminium, some centimetres in front of the flange."""
        size = 0.05 * np.cbrt(mass) * random.uniform(0.7, 1.6, 3)
        com = np.array([*random.uniform(-0.05, 0.05, 2), random.uniform(0.05, 0.15)])
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        box = mass / 3.0 * np.diag(np.sum(size**2) - size**2)
        return cls(mass, com, turn @ box @ turn.T)

    @property
    def parameters(self):
        return sy.Inertia.from_com(self.mass, self.com, self.about_com).parameters


class SimulatedArm:
    """An arm of example-robot-data with friction, played by Pinocchio."""

    def __init__(self, name):
        file, locked = ARMS[name]
        self.path, self.locked = next(p for p in URDFS if p.name == file), locked
        self.pin = pinocchio.buildModelFromUrdf(str(self.path))
        if locked:
            ids = [self.pin.getJointId(joint) for joint in locked]
            self.pin = pinocchio.buildReducedModel(self.pin, ids, pinocchio.neutral(self.pin))
        random = np.random.default_rng(7)
        count = self.pin.nv
        scale = np.geomspace(8.0, 1.0, count)
        self.viscous = scale * random.uniform(0.5, 1.5, count)
        self.coulomb = scale * random.uniform(0.5, 1.5, count)
        self.offset = 0.2 * scale * random.normal(size=count)

    @cached_property
    def model(self):
        robot = sy.Robot.from_urdf(self.path, locked=self.locked)
        return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))

    def motion(self, random, reach=0.7):
        """Positions, velocities and accelerations of a Fourier series within the limits."""
        t = np.arange(0.0, PERIODS * PERIOD, 1.0 / RATE)
        count = self.pin.nv
        w = 2 * np.pi / PERIOD * np.arange(1, HARMONICS + 1)
        a, b = random.normal(size=(2, HARMONICS, count)) / np.sqrt(np.arange(1, HARMONICS + 1))[:, None]
        sine, cosine = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        q, dq, ddq = sine @ a + cosine @ b, (cosine * w) @ a - (sine * w) @ b, -(sine * w**2) @ a - (cosine * w**2) @ b
        low, high = np.maximum(self.pin.lowerPositionLimit, -np.pi), np.minimum(self.pin.upperPositionLimit, np.pi)
        span = np.abs(q).max(axis=0)
        speed = np.abs(dq).max(axis=0)
        factor = reach * np.minimum(0.5 * (high - low) / span, np.minimum(self.pin.velocityLimit, 2.5) / speed)
        return t, 0.5 * (low + high) + factor * q, factor * dq, factor * ddq

    def torques(self, q, dq, ddq, payload=None, frame=None, load_friction=0.0):
        """By Pinocchio, with friction; `load_friction` of the torque that the links need is added to Coulomb's."""
        model = self.pin.copy()
        if payload is not None:
            body = pinocchio.Inertia(payload.mass, payload.com, payload.about_com)
            place = pinocchio.SE3(np.eye(4) if frame is None else np.asarray(frame))
            model.appendBodyToJoint(model.njoints - 1, body, place)
        data = model.createData()
        links = np.array([pinocchio.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)])
        coulomb = self.coulomb + load_friction * np.abs(links)
        return links + self.viscous * dq + coulomb * np.sign(dq) + self.offset

    def log(self, random, payload=None, noise=0.015, frame=None, load_friction=0.0, motion=None, gains=None):
        """A recording, with noise on encoders and torques; `noise` relative to the root mean square of each joint."""
        t, q, dq, ddq = self.motion(random) if motion is None else motion
        torque = self.torques(q, dq, ddq, payload, frame, load_friction)
        errors = lfilter([np.sqrt(1.0 - CORRELATION**2)], [1.0, -CORRELATION], random.normal(size=torque.shape), axis=0)
        torque = torque + noise * np.sqrt(np.mean(torque**2, axis=0)) * errors
        if gains is not None:
            torque = torque / gains
        if noise:
            q = q + ENCODER * random.normal(size=q.shape)
        return sy.Recording(t=t, q=q, torque=torque)

    def samples(self, random, payload=None, **options):
        """The same without encoders, as samples for a regression."""
        motion = options.pop("motion", None) or self.motion(random)
        recording = self.log(random, payload, motion=motion, **options)
        _, q, dq, ddq = motion
        return sy.Samples(q=q, dq=dq, ddq=ddq, torque=recording.torque)
