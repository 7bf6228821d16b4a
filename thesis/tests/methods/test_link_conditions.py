"""Conditions on links and their derivatives, against their definitions, the thesis's polynomials and differences."""

import numpy as np
import pytest

from steelyard_thesis.methods.link_conditions import Diagonals, Eigenvalues, SylvesterMinors, inertia_about_com

CONDITIONS = [kind(triangle) for kind in (Diagonals, Eigenvalues, SylvesterMinors) for triangle in (False, True)]


@pytest.fixture
def bodies():
    """Random parameters with positive mass; some are impossible bodies."""
    found = np.random.default_rng(5).normal(size=(12, 10))
    found[:, 9] = np.abs(found[:, 9]) + 0.1
    return found


def com_inertia(link):
    """Huygens and Steiner with a centre of mass: I = L - m (|r|² 1 - r rᵀ)."""
    L = link[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
    r = link[6:9] / link[9]
    return L - link[9] * (r @ r * np.eye(3) - np.outer(r, r))


def test_inertia_about_the_center_of_mass(bodies):
    np.testing.assert_allclose(inertia_about_com(bodies), [com_inertia(b) for b in bodies], rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("triangle", [False, True])
def test_values_are_those_of_the_matrices(bodies, triangle):
    tensors = np.array([com_inertia(b) for b in bodies])
    if triangle:
        tensors = np.array([np.trace(t) / 2 * np.eye(3) - t for t in tensors])
    np.testing.assert_allclose(Diagonals(triangle).values(bodies), [np.diag(t) for t in tensors], rtol=1e-9)
    np.testing.assert_allclose(Eigenvalues(triangle).values(bodies), np.linalg.eigvalsh(tensors), rtol=1e-9, atol=1e-9)
    minors = [[np.linalg.det(t[:k, :k]) * b[9] ** 2 for k in (1, 2, 3)] for t, b in zip(tensors, bodies, strict=True)]
    np.testing.assert_allclose(SylvesterMinors(triangle).values(bodies), minors, rtol=1e-8, atol=1e-8)


def test_minors_are_the_polynomials_of_the_thesis(bodies):
    """Equations 3.3 and 3.4 as printed; 3.5 is garbled there."""
    xx, xy, _, yy, _, _, x, y, z, m = bodies.T
    first = xx * m**2 - y**2 * m - z**2 * m
    second = xx * yy * m**2 - xx * x**2 * m - xx * z**2 * m - xy**2 * m**2 - 2 * xy * x * y * m - yy * y**2 * m
    second += -yy * z**2 * m + x**2 * z**2 + y**2 * z**2 + z**4
    np.testing.assert_allclose(SylvesterMinors().values(bodies)[:, :2].T, [first, second], rtol=1e-10, atol=1e-10)


def test_minors_need_no_division(bodies):
    bodies[:, 9] = 0.0
    values = SylvesterMinors().values(bodies)
    assert np.all(np.isfinite(values))
    np.testing.assert_array_equal(values[:, 0], 0.0)


@pytest.mark.parametrize("conditions", CONDITIONS, ids=str)
def test_first_derivatives(conditions, bodies):
    found, step = conditions.jacobian(bodies), 1e-6
    for k in range(10):
        change = step * np.eye(10)[k]
        difference = (conditions.values(bodies + change) - conditions.values(bodies - change)) / (2 * step)
        np.testing.assert_allclose(found[:, :, k], difference, rtol=1e-6, atol=1e-6 * np.abs(found).max())


@pytest.mark.parametrize("conditions", CONDITIONS, ids=str)
def test_second_derivatives(conditions, bodies):
    multipliers, step = np.random.default_rng(6).normal(size=(len(bodies), 3)), 1e-6
    found = conditions.curvature(bodies, multipliers)
    for k in range(10):
        change = step * np.eye(10)[k]
        slopes = (conditions.jacobian(bodies + change) - conditions.jacobian(bodies - change)) / (2 * step)
        expected = np.einsum("kcj,kc->kj", slopes, multipliers)
        np.testing.assert_allclose(found[:, k], expected, rtol=1e-5, atol=1e-6 * np.abs(found).max())


def test_minors_have_no_slope_where_two_eigenvalues_vanish():
    """The flaw of Sylvester's criterion for a solver: a rod has a determinant of zero and no way to raise it."""
    rod = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]])
    assert np.linalg.eigvalsh(inertia_about_com(rod))[0].tolist() == [0.0, 0.0, 1.0]
    np.testing.assert_array_equal(SylvesterMinors().jacobian(rod)[0, 2], 0.0)
    assert np.abs(Eigenvalues().jacobian(rod)[0, 0]).max() == pytest.approx(1.0)
