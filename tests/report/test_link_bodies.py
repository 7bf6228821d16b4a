"""Ellipsoids and boxes of links, against the inertia of solids in closed form."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.report.link_bodies import link_body

TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])  # a rotation with rational elements
CENTER = np.array([0.2, -0.4, 0.1])


def turned(mass: float, about_com: list[float]) -> sy.Inertia:
    return sy.Inertia.from_com(mass, CENTER, TURN @ np.diag(about_com) @ TURN.T)


def test_an_ellipsoid_is_found_again() -> None:
    a, b, c, mass = 0.5, 0.2, 0.1, 3.0
    body = link_body(turned(mass, [mass / 5 * x for x in (b * b + c * c, a * a + c * c, a * a + b * b)]).parameters)
    assert body is not None
    assert body.possible
    assert body.mass == mass
    np.testing.assert_allclose(body.center, CENTER, rtol=1e-12)
    np.testing.assert_allclose(body.semi_axes, [a, b, c], rtol=1e-9)
    np.testing.assert_allclose(np.abs(body.axes.T @ TURN), np.eye(3), atol=1e-9)
    assert np.linalg.det(body.axes) == pytest.approx(1.0)


def test_a_box_is_found_again() -> None:
    x, y, z, mass = 0.6, 0.3, 0.05, 1.5
    body = link_body(turned(mass, [mass / 12 * s for s in (y * y + z * z, x * x + z * z, x * x + y * y)]).parameters)
    assert body is not None
    np.testing.assert_allclose(body.sides, [x, y, z], rtol=1e-9)


def test_a_rod_is_thin_and_possible() -> None:
    body = link_body(turned(2.0, [0.0, 0.5, 0.5]).parameters)
    assert body is not None
    assert body.possible
    np.testing.assert_allclose(body.semi_axes[1:], 0.0, atol=1e-12)


@pytest.mark.parametrize("about_com", [[0.1, 0.1, 0.3], [-0.1, 0.2, 0.2]], ids=["triangle", "negative"])
def test_what_no_body_can_be_has_no_ellipsoid(about_com: list[float]) -> None:
    body = link_body(turned(2.0, about_com).parameters)
    assert body is not None
    assert not body.possible
    np.testing.assert_allclose(body.center, CENTER, rtol=1e-12)


@pytest.mark.parametrize("mass", [0.0, -1.0, np.nan])
def test_without_mass_nothing_is_drawn(mass: float) -> None:
    assert link_body([1, 0, 0, 1, 0, 1, 0, 0, 0, mass]) is None
