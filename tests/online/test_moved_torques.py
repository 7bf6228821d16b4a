"""Torques that are logged later or earlier than the motion count with the motion to which they belong."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from two_joint_arm import unstated_arm, unstated_parameters

import steelyard as sy
from steelyard.online.even_stream import Stretch
from steelyard.online.moved_torques import MovedTorques

Array = NDArray[np.float64]
TRUE = unstated_parameters()
PACE = np.array([3.0, 4.0])
DELAYS = np.array([0.0033, -0.0018])  # s, of joint 1 and 2


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return unstated_arm()


def motion(t: Array) -> tuple[Array, Array, Array]:
    angle = PACE * t[:, None]
    return np.sin(angle), PACE * np.cos(angle), -(PACE**2) * np.sin(angle)


def logged(model: sy.Model, t: Array, delays: Array) -> Array:
    """Torques as they were by so much before each time."""
    return np.column_stack(
        [model.inverse_dynamics(*motion(t - delay), TRUE)[:, k] for k, delay in enumerate(delays.tolist())]
    )


@pytest.mark.parametrize("sizes", [(1,), (7, 1, 30), (400,)])
def test_torques_come_beside_their_motion(sizes: tuple[int, ...]) -> None:
    """Of cubic polynomials, which the interpolation passes through; the ends have none, nor has what needs a gap."""
    t = np.arange(400) / 1000
    whole = 2.0 - 3.0 * t + 40.0 * t**2 - 90.0 * t**3

    def true(at: Array) -> Array:
        return 2.0 - 3.0 * at + 40.0 * at**2 - 90.0 * at**3

    torque = np.column_stack([true(t - delay) for delay in DELAYS])
    used = np.ones((400, 2), dtype=bool)
    used[200, 1] = False
    moved, edges = MovedTorques(1000.0, DELAYS), [0]
    while edges[-1] < 400:
        edges.append(edges[-1] + sizes[len(edges) % len(sizes)])
    found = []
    for begin, end in pairwise(edges):
        part = slice(begin, end)
        values = np.column_stack([t, whole])[part]
        found.append(moved.add(Stretch(begin == 0, t[part], values, torque[part], used[part])))
    told = [one for one in found if one is not None]
    assert [one.begins for one in told] == [True] + [False] * (len(told) - 1)
    times, values, torques, known = (
        np.concatenate([getattr(one, name) for one in told]) for name in ("t", "values", "torque", "used")
    )
    count = 400 - moved.ahead
    assert np.array_equal(times, t[:count])
    assert np.array_equal(values[:, 1], whole[:count])
    assert np.allclose(np.where(known, torques, whole[:count, None]), whole[:count, None], rtol=0.0, atol=1e-12)
    assert np.flatnonzero(~known[:, 0]).tolist() == []
    assert np.flatnonzero(~known[:, 1]).tolist() == [0, 1, 2, 200, 201, 202, 203]


@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_an_estimator_that_knows_the_delay_learns_what_one_in_step_does(model: sy.Model, derivatives: int) -> None:
    t = np.arange(4000) / 1000
    noise = 0.01 * np.random.default_rng(1).normal(size=(4000, 2))
    in_step, told, untold = (sy.OnlineEstimator(model, **given) for given in ({}, {"torque_delay": DELAYS}, {}))
    given = motion(t)[: derivatives + 1]
    for estimator, delays in ((in_step, np.zeros(2)), (told, DELAYS), (untold, DELAYS)):
        estimator.update(t, given[0], logged(model, t, delays) + noise, *given[1:])
    true = model.base_parameters().values(TRUE)
    errors = [np.abs(one.estimate().base - true).max() for one in (in_step, told, untold)]
    assert errors[1] < 1.5 * errors[0] + 1e-3
    assert errors[2] > 5.0 * errors[1]
    assert told.delay == pytest.approx(in_step.delay + 0.005)
    assert told.time == pytest.approx(in_step.time - 0.005)


def test_samples_count_alike_one_by_one_and_together(model: sy.Model) -> None:
    t = np.arange(700) / 1000
    q, _, _ = motion(t)
    torque = logged(model, t, DELAYS)
    kept = (t < 0.3) | (t > 0.35)
    one, all_together = (sy.OnlineEstimator(model, cutoff=40.0, torque_delay=DELAYS) for _ in range(2))
    for k in np.flatnonzero(kept):
        one.update(t[k], q[k], torque[k])
    one.flush()
    all_together.update(t[kept], q[kept], torque[kept])
    assert one.stream_counts["gaps"] == 1
    for a, b in zip(one.factors(), all_together.factors(), strict=True):
        assert a.count == b.count
        grams = [factor.triangle.T @ factor.triangle for factor in (a, b)]
        assert np.allclose(*grams, rtol=1e-10, atol=1e-10 * np.abs(grams[0]).max())


@pytest.mark.parametrize("wrong", [2.0, np.nan, [0.001, 0.002, 0.003], "late"])
def test_delays_that_are_none_are_refused(model: sy.Model, wrong: Any) -> None:
    with pytest.raises(sy.InputError, match="torque_delay"):
        sy.OnlineEstimator(model, torque_delay=wrong)
