"""Torques that are clipped count nowhere: they neither move the estimate nor look like another robot."""

import numpy as np
import pytest
from numpy.typing import NDArray
from two_joint_arm import unstated_arm, unstated_parameters

import steelyard as sy
from steelyard.online.torque_limits import TorqueLimits

Array = NDArray[np.float64]
TRUE = unstated_parameters()
T = np.arange(3000) / 1000
WAVE = 9.0 * np.sin(6.0 * T)


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return unstated_arm()


def levels(torque: Array, chunk: int) -> TorqueLimits:
    """What is known of a single joint after its torques have come, so many at a time."""
    limits = TorqueLimits(1, 1000.0)
    for start in range(0, len(torque), chunk):
        come = torque[: start + chunk]
        limits.learn(torque[start : start + chunk, None], lambda _, come=come: come)
    return limits


@pytest.mark.parametrize("chunk", [1, 10, 1000])
@pytest.mark.parametrize(
    ("torque", "low", "high"),
    [
        (np.clip(WAVE, -np.inf, 7.0), -np.inf, 7.0),
        (np.clip(WAVE, -7.5, 7.0), -7.5, 7.0),
        (np.clip(WAVE[500:], -7.5, 7.0), -7.5, 7.0),
        (WAVE, -np.inf, np.inf),
        (np.round(WAVE, 1), -np.inf, np.inf),  # steps of 0.1 N m
        (np.repeat(WAVE[::10], 10), -np.inf, np.inf),  # torques that come at 100 Hz
        (np.where(T < 1.0, np.clip(WAVE, -7.5, 7.0), WAVE), -np.inf, np.inf),  # of another motion, none
        (np.full(3000, 2.0), 2.0, 2.0),  # a dead sensor
    ],
)
def test_levels_are_those_at_which_torques_stand(torque: Array, low: float, high: float, chunk: int) -> None:
    assert levels(torque, chunk).levels.tolist() == [[low, high]]


@pytest.mark.parametrize("chunk", [1, 7, 600])
def test_rows_near_a_level_are_told_whatever_their_parts(chunk: int) -> None:
    torque = np.clip(WAVE, -np.inf, 7.0)[:, None]
    limits = levels(torque[:, 0], 3000)
    parts = [limits.near(torque[k:], min(chunk, 3000 - k)) for k in range(0, 3000, chunk)]
    found = np.concatenate([part for part in parts if part is not None])[:, 0]
    at = np.flatnonzero(torque[:, 0] >= 7.0)
    expected = np.min(np.abs(np.arange(3000)[:, None] - at), axis=1) <= 25
    assert np.array_equal(found, expected)


def watched(model: sy.Model, seed: int, most: float, detect: bool) -> sy.OnlineEstimator:
    """12 s of an arm whose torques are at most so large a part of their largest size."""
    t, random = np.arange(12000) / 1000, np.random.default_rng(seed)
    pace, size = random.uniform(1.0, 4.0, (3, 1, 2)), random.uniform(0.2, 0.6, (3, 1, 2))
    angle = pace * t[:, None] + random.uniform(0.0, 6.0, (3, 1, 2))
    q, dq = np.sum(size * np.sin(angle), axis=0), np.sum(size * pace * np.cos(angle), axis=0)
    torque = model.inverse_dynamics(q, dq, -np.sum(size * pace**2 * np.sin(angle), axis=0), TRUE)
    torque += 0.02 * np.sqrt(np.mean(torque**2, axis=0)) * random.normal(size=q.shape)
    limit = most * np.abs(torque).max(axis=0)
    estimator = sy.OnlineEstimator(model, detect_changes=detect)
    estimator.update(t, q, np.clip(torque, -limit, limit))
    return estimator


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 12))
def test_a_drive_at_its_limit_is_no_other_robot(model: sy.Model, seed: int) -> None:
    estimator = watched(model, seed, 0.6, True)
    assert estimator.change_count == 0
    assert "at its limit" in " ".join(estimator.remarks)


@pytest.mark.slow
@pytest.mark.parametrize("most", [0.8, 0.5])
def test_intervals_hold_beside_torques_at_a_limit(model: sy.Model, most: float) -> None:
    true, outside = model.base_parameters().values(TRUE), 0
    for seed in range(20):
        low, high = watched(model, seed, most, False).intervals().T
        outside += int(np.sum((true < low) | (true > high)))
    assert outside <= 0.1 * 20 * len(true)
