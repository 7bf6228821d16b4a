"""Faults of a stream that hardly show in its errors: delays, signs of weak joints, noise of encoders."""

import re

import numpy as np
import pytest
from numpy.typing import NDArray

import steelyard as sy

Array = NDArray[np.float64]
RATE = 250.0
BODY = sy.Inertia.from_com(3.0, [-0.15, 0.02, 0.05], np.diag([0.02, 0.03, 0.04])).parameters
TRUE = np.concatenate([[*(size * BODY), 0.6 * size, 0.9 * size] for size in (2.0, 1.0, 0.2)])
"""Of a shoulder, an elbow and a wrist with viscous and Coulomb friction."""


@pytest.fixture(scope="module")
def model() -> sy.Model:
    rows = [("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.3, 0, "q")]
    return sy.Model(sy.Robot.from_dh(rows, name="arm").with_terms(sy.Viscous(), sy.Coulomb()))


def waves(seed: int, t: Array) -> tuple[Array, Array, Array]:
    """A motion of three joints, of four frequencies each."""
    random = np.random.default_rng([seed, 1])
    pace, size = 2.0 * np.pi * random.uniform(0.1, 0.7, (4, 3)), random.uniform(0.1, 0.4, (4, 3))
    angle = pace[:, None] * t[:, None] + random.uniform(0.0, 6.0, (4, 1, 3))
    place = size[:, None]
    return (
        np.sum(place * np.sin(angle), axis=0),
        np.sum(place * pace[:, None] * np.cos(angle), axis=0),
        -np.sum(place * pace[:, None] ** 2 * np.sin(angle), axis=0),
    )


def watched(
    model: sy.Model,
    seed: int,
    *,
    late: tuple[float, ...] = (0.0, 0.0, 0.0),
    noise: float = 1e-5,
    torque_noise: float = 0.02,
    signs: tuple[float, ...] = (1.0, 1.0, 1.0),
    seconds: float = 15.0,
    **options: object,
) -> sy.OnlineEstimator:
    """What an estimator has learned of positions with noise (rad) and torques with such a part of noise."""
    t, random = np.arange(round(RATE * seconds)) / RATE, np.random.default_rng(seed)
    q = waves(seed, t)[0]
    torque = np.column_stack(
        [model.inverse_dynamics(*waves(seed, t - delay), TRUE)[:, k] for k, delay in enumerate(late)]
    )
    torque += torque_noise * np.sqrt(np.mean(torque**2, axis=0)) * random.normal(size=q.shape)
    estimator = sy.OnlineEstimator(model, rate=RATE, **options)  # type: ignore[arg-type]
    estimator.update(t, q + noise * random.normal(size=q.shape), torque * signs)
    estimator.estimate()
    return estimator


def remark(estimator: sy.OnlineEstimator, words: str) -> str:
    """The remark that holds these words, empty where there is none."""
    return next((one for one in estimator.remarks if words in one), "")


FAULTS = "look to be logged", "looks wrong", "Noise of the positions"


@pytest.mark.parametrize("seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 23))])
def test_nothing_is_told_of_a_sound_stream(model: sy.Model, seed: int) -> None:
    estimator = watched(model, seed)
    assert [words for words in FAULTS if remark(estimator, words)] == []


@pytest.mark.parametrize(("delay", "word"), [(0.004, "later"), (-0.004, "earlier")])
def test_torques_out_of_step_are_told_with_what_mends_them(model: sy.Model, delay: float, word: str) -> None:
    told = remark(watched(model, 1, late=(delay,) * 3), "look to be logged")
    assert f"{word} than the motion" in told
    (given,) = re.findall(r"torque_delay=(\S+)`", told)
    assert float(given) == pytest.approx(delay, abs=5e-4)
    mended = watched(model, 1, late=(delay,) * 3, torque_delay=float(given))
    assert remark(mended, "look to be logged") == ""


def test_one_joint_out_of_step_is_named(model: sy.Model) -> None:
    told = remark(watched(model, 1, late=(0.0, 0.004, 0.0)), "look to be logged")
    assert re.search(r"joint2's (3\.[5-9]|4\.[0-5]) ± \S+ ms later", told)
    assert "joint1" not in told


@pytest.mark.slow
@pytest.mark.parametrize("joint", [0, 1, 2])
def test_a_torque_of_the_wrong_sign_is_told_of_the_last_joint_too(model: sy.Model, joint: int) -> None:
    signs = np.where(np.arange(3) == joint, -1.0, 1.0)
    told = remark(watched(model, 1, signs=tuple(signs), seconds=7.0), "looks wrong")
    assert told.startswith(f"The sign of the torque of joint{joint + 1} looks wrong")


def missed(model: sy.Model, estimator: sy.OnlineEstimator) -> int:
    """How many intervals do not hold the truth."""
    true = model.base_parameters().values(TRUE)
    low, high = estimator.intervals().T
    return int(np.sum((true < low) | (true > high)))


def test_noise_of_the_positions_is_told_and_makes_intervals_wider(model: sy.Model) -> None:
    clean, noisy = (watched(model, 1, noise=noise) for noise in (1e-5, 1e-3))
    assert remark(clean, "Noise of the positions") == ""
    assert "which counts in `intervals`" in remark(noisy, "Noise of the positions")
    count = model.base_parameters().count
    alone = 1.96 * np.asarray(sy.least_squares(noisy.information, weights="joint").standard_error)
    halves = np.ptp(noisy.intervals(), axis=1) / 2.0
    off = np.abs(np.mean(noisy.intervals(), axis=1) - model.base_parameters().values(TRUE))
    assert np.sum(off > alone) > 0.3 * count
    assert np.sum(off > halves) <= 0.1 * count


@pytest.mark.slow
@pytest.mark.parametrize("noise", [1e-4, 3e-4, 1e-3])
def test_intervals_hold_whatever_the_noise_of_the_encoders(model: sy.Model, noise: float) -> None:
    count = model.base_parameters().count
    outside = sum(missed(model, watched(model, seed, noise=noise)) for seed in range(20))
    assert outside <= 0.1 * 20 * count
