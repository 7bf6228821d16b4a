"""Families of trajectories: derivatives, continuity, rest at both ends, and the bases that the design works with."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.excitation import (
    FourierTrajectory,
    QuinticTrajectory,
    RestToRestTrajectory,
    SplineTrajectory,
    Trajectory,
)
from steelyard.excitation.family import FourierFamily, QuinticFamily, SplineFamily, make_family

FAMILIES = [
    FourierFamily(5.0, 3, 1.2, 2),
    FourierFamily(5.0, 3, 0.0),
    FourierFamily(5.0, 3, 0.8, 2, slow_time=1.5),
    SplineFamily(6.0, 9),
    QuinticFamily(6.0, 5),
]


def coefficients(family, joints=2):
    return np.random.default_rng(8).normal(size=(joints, family.size))


def trajectories():
    for family in FAMILIES:
        yield family.trajectory(coefficients(family))
    random = np.random.default_rng(4)
    times = np.array([0.0, 0.4, 1.1, 1.3])
    yield QuinticTrajectory(times, *random.normal(size=(3, 4, 2)))


@pytest.mark.parametrize("trajectory", list(trajectories()), ids=repr)
def test_derivatives_are_derivatives(trajectory):
    assert isinstance(trajectory, Trajectory)
    h = 1e-5
    t = np.random.default_rng(2).uniform(2 * h, trajectory.duration - 2 * h, 60)
    _, dq, ddq = trajectory.motion(t)
    before, after = trajectory.motion(t - h), trajectory.motion(t + h)
    near_knot = np.zeros(len(t), dtype=bool)
    if isinstance(trajectory, QuinticTrajectory):
        near_knot = np.abs(t[:, None] - trajectory.times).min(axis=1) < 2 * h
    np.testing.assert_allclose(((after[0] - before[0]) / (2 * h))[~near_knot], dq[~near_knot], atol=2e-5)
    np.testing.assert_allclose(((after[1] - before[1]) / (2 * h))[~near_knot], ddq[~near_knot], atol=2e-4)


@pytest.mark.parametrize("family", [f for f in FAMILIES if getattr(f, "ramp_time", 1.0) > 0.0], ids=repr)
def test_motion_is_at_rest_at_both_ends(family):
    trajectory = family.trajectory(coefficients(family))
    t = np.array([-1.0, 0.0, trajectory.duration, trajectory.duration + 1.0])
    q, dq, ddq = trajectory.motion(t)
    np.testing.assert_allclose(dq, 0.0, atol=1e-12)
    np.testing.assert_allclose(ddq, 0.0, atol=1e-9)
    np.testing.assert_allclose(q[0], q[1], atol=1e-12)
    np.testing.assert_allclose(q[2], q[3], atol=1e-12)
    sampled = trajectory.sample(130.0)
    assert sampled[0][-1] >= trajectory.duration - 1e-9
    assert np.abs(np.diff(sampled[1], axis=0)).max() < 1.1 * np.abs(sampled[2]).max() / 130.0


@pytest.mark.parametrize("family", FAMILIES, ids=repr)
def test_basis_gives_the_motion_of_the_trajectory(family):
    x = coefficients(family)
    t = np.random.default_rng(3).uniform(0.0, family.duration, 40)
    for ours, theirs in zip(family.basis(t), family.trajectory(x).motion(t), strict=True):
        np.testing.assert_allclose(ours @ x.T, theirs, atol=1e-9)
    still = family.basis(t)
    np.testing.assert_allclose(still[0] @ family.constant, 1.0, atol=1e-12)
    np.testing.assert_allclose(still[1] @ family.constant, 0.0, atol=1e-9)


def test_leads_follow_the_path_of_the_series_and_are_never_faster():
    family = FourierFamily(4.0, 3, 1.5)
    x = coefficients(family, 3)
    trajectory = family.trajectory(x)
    assert isinstance(trajectory, RestToRestTrajectory)
    t = np.linspace(0.0, 1.5, 200)
    q, dq, _ = trajectory.motion(t)
    phase, rate, _ = trajectory.phase(t)
    series = family.excitation(x)
    np.testing.assert_allclose(q, series.motion(phase)[0], atol=1e-12)
    np.testing.assert_allclose(np.trapezoid(rate, t), phase[-1] - phase[0], rtol=1e-4)
    assert np.all(np.abs(dq) <= np.abs(series.motion(phase)[1]) + 1e-12)
    q, dq, ddq = trajectory.motion(1.5 + np.linspace(0.0, 4.0, 50))
    for ours, theirs in zip((q, dq, ddq), series.motion(np.linspace(0.0, 4.0, 50)), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_slow_passages_follow_the_path_at_a_twentieth_of_the_speed_and_go_on_where_the_last_one_ended():
    family = FourierFamily(4.0, 3, 1.5, 2, slow_time=5.0)
    x = coefficients(family, 3)
    trajectory, series = family.trajectory(x), family.excitation(x)
    assert trajectory.duration == pytest.approx(2 * 1.5 + 2 * (4.0 + 2 * 1.5 + 5.0))
    assert np.allclose(trajectory.slow_passages, [(5.5, 13.5), (17.5, 25.5)])
    t = np.linspace(0.0, trajectory.duration, 20_001)
    q, dq, _ = trajectory.motion(t)
    phase, rate, change = trajectory.phase(t)
    np.testing.assert_allclose(q, series.motion(phase)[0], atol=1e-12)
    np.testing.assert_allclose(np.gradient(phase, t)[1:-1], rate[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(rate, t)[1:-1], change[1:-1], atol=1e-4)
    assert rate.min() >= 0.0
    assert rate.max() <= 1.0
    for begin, end in trajectory.slow_passages:
        slow = (t > begin + 1.5) & (t < end - 1.5)
        np.testing.assert_allclose(rate[slow], 0.05, atol=1e-12)
        np.testing.assert_allclose(dq[slow], 0.05 * series.motion(phase[slow])[1], atol=1e-12)
    # Between the passages lies one whole period, so that the second begins where the first one ended.
    first, second = (trajectory.phase(np.array(ends))[0] for ends in trajectory.slow_passages)
    assert second[0] - first[1] == pytest.approx(4.0)
    assert first[1] - first[0] == pytest.approx(1.5 * 1.05 + 0.05 * 5.0)


def test_a_move_is_the_minimum_jerk_polynomial():
    """Hogan 1984: 10 u^3 - 15 u^4 + 6 u^5."""
    t = np.linspace(0.0, 2.0, 21)
    q = QuinticTrajectory.point_to_point([[1.0], [4.0]], [2.0]).motion(t)[0][:, 0]
    u = t / 2.0
    np.testing.assert_allclose(q, 1.0 + 3.0 * (10 * u**3 - 15 * u**4 + 6 * u**5), atol=1e-12)


def test_splines_agree_with_scipy():
    from scipy.interpolate import BSpline

    points = np.random.default_rng(5).normal(size=(2, 6))
    whole = np.hstack([points[:, [0, 0]], points, points[:, [-1, -1]]])
    knots = np.concatenate([np.zeros(5), np.linspace(0, 3.0, whole.shape[1] - 4), np.full(5, 3.0)])
    t = np.linspace(0.1, 2.9, 30)
    theirs = BSpline(knots, whole.T, 5)(t, nu=2)
    np.testing.assert_allclose(SplineTrajectory(points, 3.0).motion(t)[2], theirs, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: QuinticTrajectory([0, 1], [[0]], [[0]], [[0]]), r"times of shape \(K,\)"),
        (lambda: QuinticTrajectory([0, 0], [[0], [1]], [[0], [0]], [[0], [0]]), "must increase from 0"),
        (lambda: QuinticTrajectory([0, 1], [[0], [np.nan]], [[0], [0]], [[0], [0]]), "finite"),
        (lambda: QuinticTrajectory.point_to_point([[0.0], [1.0]], [1.0, 2.0]), "K - 1 durations"),
        (lambda: SplineTrajectory([[1.0]], 1.0), "P at least 2"),
        (lambda: SplineTrajectory([[1.0, 2.0]], 0.0), "duration must be positive"),
        (
            lambda: make_family("waves", period=1, harmonics=1, points=None, ramp_time=None, periods=1),
            "family must be one",
        ),
        (
            lambda: make_family("fourier", period=0, harmonics=1, points=None, ramp_time=None, periods=1),
            "period must be",
        ),
        (
            lambda: make_family("fourier", period=1, harmonics=0, points=None, ramp_time=None, periods=1),
            "harmonics must be",
        ),
        (
            lambda: make_family("fourier", period=1, harmonics=1, points=None, ramp_time=0.0, periods=1, slow_time=2.0),
            "so do slow passages",
        ),
        (
            lambda: make_family(
                "fourier", period=1, harmonics=1, points=None, ramp_time=None, periods=1, slow_time=-1.0
            ),
            "slow_time must be a time",
        ),
        (lambda: make_family("fourier", period=1, harmonics=1, points=4, ramp_time=None, periods=1), "points belong"),
        (
            lambda: make_family("spline", period=1, harmonics=1, points=4, ramp_time=None, periods=2),
            "periods, ramp_time and slow_time",
        ),
        (lambda: make_family("spline", period=1, harmonics=1, points=2, ramp_time=None, periods=1), "points must be"),
        (lambda: SplineTrajectory(points=[["a", "b"]], duration=1.0), "points of a spline must be real numbers"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(make, message):
    with pytest.raises(sy.InputError, match=message):
        make()


def test_leads_and_rates_must_be_positive():
    series = FourierTrajectory(a=[[1.0]], b=[[0.0]], center=[0.0], frequency=1.0)
    with pytest.raises(sy.InputError, match="ramp_time must be positive"):
        RestToRestTrajectory(series, 0.0)
    with pytest.raises(sy.InputError, match="periods must be"):
        RestToRestTrajectory(series, 1.0, 0)
    with pytest.raises(sy.InputError, match="slow_time must be"):
        RestToRestTrajectory(series, 1.0, 1, float("nan"))
    with pytest.raises(sy.InputError, match="rate must be positive"):
        RestToRestTrajectory(series, 1.0).sample(0.0)
    with pytest.raises(sy.InputError, match="row"):
        RestToRestTrajectory(series, 1.0).motion(0.5)
