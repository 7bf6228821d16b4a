"""Fourier trajectories against numerical derivatives."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.excitation import FourierTrajectory


def test_derivatives_are_derivatives(random):
    trajectory = FourierTrajectory(
        a=random.normal(size=(3, 5)), b=random.normal(size=(3, 5)), center=random.normal(size=3), frequency=0.2
    )
    t = np.linspace(0.0, 5.0, 50)
    h = 1e-6
    q, dq, ddq = trajectory.motion(t)
    before, after = trajectory.motion(t - h), trajectory.motion(t + h)
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), dq, atol=1e-6)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), ddq, atol=1e-6)
    np.testing.assert_allclose(trajectory.motion(t + trajectory.period)[0], q, atol=1e-9)
    np.testing.assert_allclose(q[:-1].mean(axis=0), trajectory.center, atol=1e-9)


def test_sampling_covers_whole_periods():
    trajectory = FourierTrajectory(a=np.ones((1, 1)), b=np.zeros((1, 1)), center=np.zeros(1), frequency=0.08)
    t, q, _, _ = trajectory.sample(1000.0, periods=3)
    assert (len(t), t[0], t[-1]) == (37500, 0.0, pytest.approx(37.499))
    assert q.shape == (37500, 1)


def test_sizes_that_do_not_fit_are_refused():
    with pytest.raises(sy.InputError, match=r"a of a Fourier trajectory must be real numbers, got \[\['1'\]\]"):
        FourierTrajectory(a=[["1"]], b=[[1.0]], center=[0.0], frequency=1.0)
    with pytest.raises(sy.InputError, match="of one shape"):
        FourierTrajectory(a=np.ones((2, 3)), b=np.ones((2, 2)), center=np.zeros(2), frequency=1.0)
    with pytest.raises(sy.InputError, match="frequency must be positive"):
        FourierTrajectory(a=np.ones((1, 1)), b=np.ones((1, 1)), center=np.zeros(1), frequency=0.0)
