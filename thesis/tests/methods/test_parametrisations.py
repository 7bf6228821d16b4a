"""Maps from free numbers to links: as published, with right derivatives, and what they reach and do not."""

import numpy as np
import pytest

from steelyard_thesis.methods.parametrisations import CholeskyOfBody, LogCholesky

ALL = [CholeskyOfBody(), CholeskyOfBody(second_moments=True), LogCholesky()]


@pytest.fixture
def theta():
    return np.random.default_rng(3).normal(size=(9, 10))


def published(t):
    """Thesis (2.71), line by line."""
    return [
        t[0] ** 2 * (t[2] ** 2 + t[3] ** 2) + t[4] ** 2,
        -(t[0] ** 2) * t[1] * t[2] + t[4] * t[5],
        -(t[0] ** 2) * t[1] * t[3] + t[4] * t[6],
        t[0] ** 2 * (t[1] ** 2 + t[3] ** 2) + t[5] ** 2 + t[7] ** 2,
        -(t[0] ** 2) * t[2] * t[3] + t[5] * t[6] + t[7] * t[8],
        t[9] ** 2 + t[0] ** 2 * (t[1] ** 2 + t[2] ** 2) + t[6] ** 2 + t[8] ** 2,
        t[0] ** 2 * t[1],
        t[0] ** 2 * t[2],
        t[0] ** 2 * t[3],
        t[0] ** 2,
    ]


def tensor(link):
    return link[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)


def pseudo_inertia(link):
    L, first = tensor(link), link[6:9, None]
    return np.block([[np.trace(L) / 2 * np.eye(3) - L, first], [first.T, link[9:, None]]])


def six_by_six(link):
    x, y, z = link[6:9]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.block([[tensor(link), cross.T], [cross, link[9] * np.eye(3)]])


def test_cholesky_of_body_is_as_published(theta):
    np.testing.assert_allclose(CholeskyOfBody().inertial(theta), [published(t) for t in theta], rtol=1e-12, atol=1e-14)


def test_log_cholesky_is_that_of_pinocchio(theta):
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    if not hasattr(pin, "LogCholeskyParameters"):
        pytest.skip("this Pinocchio has no log-Cholesky parameters")
    order = [9, 6, 7, 8, 0, 1, 3, 2, 4, 5]  # m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz
    found, slopes = LogCholesky().inertial(theta), LogCholesky().jacobian(theta)
    for t, link, slope in zip(theta, found, slopes, strict=True):
        other = pin.LogCholeskyParameters(t)
        np.testing.assert_allclose(link[order], other.toDynamicParameters(), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(slope[order], other.calculateJacobian(), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("map_", ALL, ids=str)
def test_derivatives(map_, theta):
    slopes, step = np.random.default_rng(4).normal(size=theta.shape), 1e-6
    first, second = map_.jacobian(theta), map_.curvature(theta, slopes)
    for k in range(10):
        change = step * np.eye(10)[k]
        by_values = (map_.inertial(theta + change) - map_.inertial(theta - change)) / (2 * step)
        by_slopes = (map_.jacobian(theta + change) - map_.jacobian(theta - change)) / (2 * step)
        np.testing.assert_allclose(first[:, :, k], by_values, rtol=1e-6, atol=1e-8 * np.abs(first).max())
        expected = np.einsum("ks,ksj->kj", slopes, by_slopes)
        np.testing.assert_allclose(second[:, k], expected, rtol=1e-6, atol=1e-8 * np.abs(second).max())


@pytest.mark.parametrize("map_", ALL, ids=str)
def test_every_body_has_its_numbers(map_):
    """Whatever a real body can have is reached: clouds of points have all of it."""
    random = np.random.default_rng(8)
    clouds = []
    for _ in range(20):
        masses, places = random.uniform(0.1, 1.0, 5), random.normal(size=(5, 3))
        L = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, places, strict=True))
        clouds.append([*L[np.triu_indices(3)], *(masses @ places), masses.sum()])
    bodies = np.array(clouds)
    np.testing.assert_allclose(map_.inertial(map_.theta(bodies)), bodies, rtol=1e-9, atol=1e-10)


def test_published_map_reaches_what_violates_the_triangle_inequality():
    needle = np.array([[5.0, 0, 0, 1.0, 0, 1.0, 0, 0, 0, 1.0]])
    np.testing.assert_allclose(
        CholeskyOfBody().inertial(CholeskyOfBody().theta(needle)), needle, rtol=1e-12, atol=1e-12
    )
    assert np.linalg.eigvalsh(pseudo_inertia(needle[0]))[0] < 0.0
    for other in ALL[1:]:
        with pytest.raises(np.linalg.LinAlgError):
            other.theta(needle)


def test_published_map_does_not_guarantee_feasibility(theta):
    """Semidefinite always, definite not: no mass where θ1 = 0, an inertia of lower rank where a pivot is zero."""
    for link in CholeskyOfBody().inertial(theta):
        assert np.linalg.eigvalsh(six_by_six(link))[0] > -1e-12
    massless, flat = theta[:1].copy(), theta[:1].copy()
    massless[0, 0], flat[0, 9] = 0.0, 0.0
    assert CholeskyOfBody().inertial(massless)[0, 9] == 0.0
    assert abs(np.linalg.eigvalsh(six_by_six(CholeskyOfBody().inertial(flat)[0]))[0]) < 1e-12


def test_zero_is_stationary_for_every_objective():
    np.testing.assert_array_equal(CholeskyOfBody().jacobian(np.zeros((1, 10))), 0.0)


def test_signs_of_the_published_numbers_mean_nothing(theta):
    other = theta.copy()
    other[:, [0, 9]] *= -1.0
    other[:, 4:7] *= -1.0
    np.testing.assert_allclose(CholeskyOfBody().inertial(other), CholeskyOfBody().inertial(theta), rtol=1e-14)


def test_log_cholesky_is_always_fully_feasible(theta):
    for link in LogCholesky().inertial(theta):
        assert np.linalg.eigvalsh(pseudo_inertia(link))[0] > 0.0
    np.testing.assert_allclose(LogCholesky().theta(LogCholesky().inertial(theta)), theta, rtol=1e-8, atol=1e-8)
