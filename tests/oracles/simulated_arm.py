"""An arm of three joints whose parameters are known, moved at random, with noise that lasts for some samples."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.signal import lfilter

from steelyard.dynamics import Coulomb, Model, Offset, Viscous
from steelyard.feasibility import FeasibleSet
from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import Inertia, Robot

MASSES = (6.0, 4.0, 1.5)


@dataclass(frozen=True, eq=False)
class SimulatedArm:
    """What is true, and what was seen."""

    model: Model
    truth: np.ndarray
    samples: Samples
    information: Information
    stretches: tuple[Information, ...]

    @property
    def feasible_set(self) -> FeasibleSet:
        return FeasibleSet(self.model)


@cache  # whose kernels and base parameters are computed once
def _model() -> Model:
    robot = Robot.from_dh([("-pi/2", 0.0, 0.3, "q"), ("0", 0.4, 0.0, "q"), ("pi/2", 0.3, 0.0, "q")])
    return Model(robot.with_terms(Viscous(), Coulomb(), Offset()))


def simulated_arm(seed: int, seconds: float = 10.0, noise: float = 0.2, size: float = 0.8, still=()) -> SimulatedArm:
    """Boxes of 0.3 m by 0.1 m by 0.1 m along the links, friction, and a motion of five harmonics in every joint."""
    random = np.random.default_rng([seed, 14])
    model = _model()
    truth = np.zeros(len(model.parameter_names))
    feasible_set = FeasibleSet(model)
    for columns, mass in zip(feasible_set.link_columns, MASSES, strict=True):
        center = random.uniform(-0.05, 0.05, 3) - np.array([0.15, 0.0, 0.0])
        about_com = mass / 12 * np.diag([0.1**2 + 0.1**2, 0.3**2 + 0.1**2, 0.3**2 + 0.1**2])
        truth[columns] = Inertia.from_com(mass, center, about_com).parameters
    terms = np.setdiff1d(np.arange(len(truth)), feasible_set.link_columns)
    truth[terms] = random.uniform(0.2, 2.0, len(terms))
    t = np.arange(0.0, seconds, 0.01)
    q, dq, ddq = np.zeros((3, len(t), 3))
    for joint in range(3):
        for harmonic in range(1, 6):
            w = 2 * np.pi * 0.1 * harmonic * (1 + 0.05 * joint)
            a, b = random.normal(size=2)
            q[:, joint] += a * np.sin(w * t) + b * np.cos(w * t)
            dq[:, joint] += w * (a * np.cos(w * t) - b * np.sin(w * t))
            ddq[:, joint] -= w * w * (a * np.sin(w * t) + b * np.cos(w * t))
        scale = 0.0 if joint in still else size / np.abs(q[:, joint]).max()
        for values in (q, dq, ddq):
            values[:, joint] *= scale
    white = random.normal(size=q.shape)
    colored = lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], random.normal(size=q.shape), axis=0)
    torque = model.inverse_dynamics(q, dq, ddq, truth) + noise * (white + colored) / np.sqrt(2)
    samples = Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t)
    blocks = TimeBlocks(empty_factors(model))
    information = Information.from_chunks(model, [samples], blocks=blocks)
    return SimulatedArm(model, truth, samples, information, information.stretches(blocks))


def blurred(arm: SimulatedArm, seed: int, by: float = 0.3) -> np.ndarray:
    """Parameters of CAD whose masses are wrong by so much, a link at random, and of terms nothing."""
    random = np.random.default_rng([seed, 15])
    given = np.full(len(arm.truth), np.nan)
    for columns in arm.feasible_set.link_columns:
        given[columns] = arm.truth[columns] * np.exp(by * random.normal())
    return given
