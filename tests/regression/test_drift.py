"""Friction that changes with time is told; sound logs, and errors of other kinds, are not accused of it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from simulated_arm import simulated_arm

import steelyard as sy
from steelyard.regression import Information
from steelyard.regression.drift import FrictionDrift, friction_drifts
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks

ARM = simulated_arm(1, seconds=60.0)


def drifts(extra: NDArray[np.float64], model: sy.Model = ARM.model) -> tuple[FrictionDrift, ...]:
    samples = replace(ARM.samples, torque=ARM.samples.torque + extra)
    blocks = TimeBlocks(empty_factors(model))
    Information.from_chunks(model, [samples], blocks=blocks)
    return friction_drifts(blocks, model.base_parameters().names)


def friction(joint: int) -> NDArray[np.float64]:
    values = dict(zip(ARM.model.parameter_names, ARM.truth, strict=True))
    velocity = ARM.samples.dq[:, joint]
    total = values[f"Fvj{joint + 1}"] * velocity + values[f"Fcj{joint + 1}"] * np.sign(velocity)
    return np.asarray(total)


@pytest.mark.parametrize("of_motors", [False, True])
def test_friction_that_falls_while_a_joint_warms_up(of_motors: bool) -> None:
    count = ARM.model.dof
    model = sy.Model(ARM.model.robot.with_terms(sy.MotorSide(np.eye(count)))) if of_motors else ARM.model
    extra = np.zeros_like(ARM.samples.torque)
    time = np.linspace(0.0, 3.0, len(extra))
    extra[:, 1] = 0.5 * np.exp(-time) * friction(1)
    (drift,) = drifts(extra, model)
    assert drift.joint == 1
    # Of 1 + exp(-t) / 2 over three time constants the mean is 1.158; the best line goes from 1.367 to 0.950.
    assert drift.first == pytest.approx(1.367 / 1.158, abs=0.05)
    assert drift.last == pytest.approx(0.950 / 1.158, abs=0.05)


@pytest.mark.parametrize("kind", ["nothing", "growing offset", "friction to and fro", "growing noise"])
def test_what_is_no_drift_of_friction_is_not_told(kind: str) -> None:
    extra = np.zeros_like(ARM.samples.torque)
    time = np.linspace(0.0, 1.0, len(extra))
    if kind == "growing offset":
        extra[:, 1] = time
    if kind == "friction to and fro":
        extra[:, 1] = 0.3 * np.sin(2 * np.pi * 2 * time) * friction(1)
    if kind == "growing noise":
        extra[:, 1] = time * np.random.default_rng(0).normal(size=len(extra))
    assert drifts(extra) == ()
