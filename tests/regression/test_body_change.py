"""A body that is picked up or put down within a log is told, with its mass; other logs are not accused of one."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from simulated_arm import simulated_arm

from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.regression.body_change import BodyChange, body_change
from steelyard.regression.drift import friction_drifts
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import Inertia

ARM = simulated_arm(1, seconds=60.0)
TIME = np.linspace(0.0, 1.0, len(ARM.samples.q))
HALF = np.where(TIME[:, None] > 0.45, 1.0, 0.0)
VALUES = dict(zip(ARM.model.parameter_names, ARM.truth, strict=True))


def blocks_of(samples: Samples) -> TimeBlocks:
    blocks = TimeBlocks(empty_factors(ARM.model))
    Information.from_chunks(ARM.model, [samples], blocks=blocks)
    return blocks


def change(samples: Samples) -> BodyChange | None:
    base = ARM.model.base_parameters()
    body = base.K[:, np.asarray(ARM.model.link_columns[-1])]
    return body_change(blocks_of(samples), base.names, {"hand": body}, 0.0, 60.0)


def friction() -> NDArray[np.float64]:
    speed, joints = ARM.samples.dq, range(1, 4)
    viscous, coulomb = (np.array([VALUES[f"F{kind}j{joint}"] for joint in joints]) for kind in "vc")
    return np.asarray(viscous * speed + coulomb * np.sign(speed))


def stribeck(samples: Samples) -> NDArray[np.float64]:
    return np.asarray(1.5 * np.exp(-((samples.dq / 0.1) ** 2)) * np.tanh(samples.dq / 0.01))


def carried(samples: Samples, mass: float) -> NDArray[np.float64]:
    parameters = np.zeros(ARM.model.parameter_count)
    box = Inertia.from_com(mass, np.array([0.05, 0.02, 0.1]), mass * 0.002 * np.eye(3))
    parameters[np.asarray(ARM.model.link_columns[-1])] = box.parameters
    return np.asarray(ARM.model.inverse_dynamics(samples.q, samples.dq, samples.ddq, parameters))


def moved(speed: NDArray[np.float64], samples: Samples = ARM.samples) -> Samples:
    """The arm at other speeds and accelerations, without noise."""
    dq, ddq = speed * samples.dq, speed * samples.ddq
    torque = ARM.model.inverse_dynamics(samples.q, dq, ddq, ARM.truth)
    noise = samples.torque - ARM.model.inverse_dynamics(samples.q, samples.dq, samples.ddq, ARM.truth)
    return replace(samples, dq=dq, ddq=ddq, torque=torque + noise)


@pytest.mark.parametrize("model", ["right", "warming up", "without Stribeck friction"])
@pytest.mark.parametrize(("mass", "where"), [(0.5, "after"), (3.0, "after"), (1.0, "before")])
def test_a_body_is_told_with_its_mass_and_its_time(mass: float, where: str, model: str) -> None:
    own = ARM.samples.torque + (HALF if where == "after" else 1.0 - HALF) * carried(ARM.samples, mass)
    if model == "warming up":
        own = own + 0.5 * np.exp(-3.0 * TIME[:, None]) * friction()
    if model == "without Stribeck friction":
        own = own + stribeck(ARM.samples)
    found = change(replace(ARM.samples, torque=own))
    assert found is not None
    signed = mass if where == "after" else -mass
    assert found.mass == pytest.approx(signed, abs=3.0 * found.standard_error)
    assert found.mass == pytest.approx(signed, rel=0.1)
    assert found.earliest < 27.0 < found.latest < found.earliest + 6.0
    begin, end = found.trim
    assert end > 33.0 - 0.1 if begin < 1.0 else begin > 27.0


@pytest.mark.parametrize(
    "kind",
    [
        "nothing",
        "warm",
        "friction",
        "stribeck",
        "rotors",
        "rest",
        "slow",
        "offset",
        "growing offset",
        "gain",
        "swapped",
    ],
)
def test_other_logs_are_not_accused(kind: str) -> None:
    samples = ARM.samples
    moving = np.where(np.abs(TIME[:, None] - 0.5) < 0.1, 0.0, 1.0)
    if kind == "rest":
        samples = moved(moving)
    if kind == "slow":
        samples = moved(0.3 + 0.7 * HALF)
    extra = {
        "warm": 0.5 * np.exp(-3.0 * TIME[:, None]) * friction(),
        "friction": 0.5 * HALF * friction(),
        "stribeck": stribeck(samples),
        "rest": stribeck(samples),
        "slow": stribeck(samples),
        "rotors": 0.3 * samples.ddq,
        "offset": HALF * np.array([0.0, 2.0, 0.0]),
        "growing offset": TIME[:, None] * np.array([0.0, 2.0, 0.0]),
        "gain": 0.1 * HALF * samples.torque,
        "swapped": samples.torque[:, [1, 0, 2]] - samples.torque,
    }.get(kind, 0.0)
    assert change(replace(samples, torque=samples.torque + extra)) is None


def test_friction_that_warms_up_is_told_as_such() -> None:
    warm = replace(ARM.samples, torque=ARM.samples.torque + 0.5 * np.exp(-3.0 * TIME[:, None]) * friction())
    assert change(warm) is None
    assert friction_drifts(blocks_of(warm), ARM.model.base_parameters().names)


def test_a_log_that_is_too_short_says_nothing() -> None:
    part = slice(0, 400)
    own = (ARM.samples.torque + carried(ARM.samples, 3.0) * (TIME[:, None] > 2.0 / 60.0))[part]
    q, dq, ddq = (one[part] for one in (ARM.samples.q, ARM.samples.dq, ARM.samples.ddq))
    assert change(Samples(q=q, dq=dq, ddq=ddq, torque=own)) is None
