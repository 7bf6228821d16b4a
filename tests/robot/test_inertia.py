"""Inertia, against clouds of point masses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from steelyard.errors import InputError
from steelyard.robot import INERTIA_SYMBOLS, Inertia


def points(seed: int) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    return generator.uniform(0.1, 2.0, 12), generator.uniform(-1.0, 1.0, (12, 3))


def second_moments(masses: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Inertia tensor of point masses by its definition, sum m (r.r I - r r')."""
    return sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, positions, strict=True))


def body(masses: np.ndarray, positions: np.ndarray) -> Inertia:
    return Inertia(masses.sum(), masses @ positions, second_moments(masses, positions))


def placement(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(rng=generator).as_matrix()
    matrix[:3, 3] = generator.uniform(-2.0, 2.0, 3)
    return matrix


seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_moving_the_frame_is_moving_the_points(seed):
    masses, positions = points(seed)
    moved = body(masses, positions).moved(placement(seed))
    expected = body(masses, positions @ placement(seed)[:3, :3].T + placement(seed)[:3, 3])
    assert np.allclose(moved.parameters, expected.parameters, rtol=1e-12, atol=1e-11)


@given(seeds)
def test_from_com_is_the_parallel_axis_theorem(seed):
    masses, positions = points(seed)
    com = np.average(positions, axis=0, weights=masses)
    made = Inertia.from_com(masses.sum(), com, second_moments(masses, positions - com))
    assert np.allclose(made.parameters, body(masses, positions).parameters, rtol=1e-12, atol=1e-12)
    assert np.allclose(made.com, com)
    assert np.allclose(made.about_com, second_moments(masses, positions - com), atol=1e-11)


@given(seeds)
def test_the_pseudo_inertia_is_the_second_moment_of_the_points(seed):
    masses, positions = points(seed)
    homogeneous = np.column_stack([positions, np.ones(len(masses))])
    expected = np.einsum("i,ij,ik->jk", masses, homogeneous, homogeneous)
    assert np.allclose(body(masses, positions).pseudo_inertia, expected, atol=1e-12)


@given(seeds)
def test_bodies_add_and_subtract(seed):
    masses, positions = points(seed)
    whole, first, rest = body(masses, positions), body(masses[:5], positions[:5]), body(masses[5:], positions[5:])
    assert np.allclose((first + rest).parameters, whole.parameters)
    assert np.allclose((whole - rest).parameters, first.parameters)


def test_parameters_are_in_the_order_of_the_thesis():
    numbers = np.arange(1.0, 11.0)
    made = Inertia.from_parameters(numbers)
    assert dict(zip(INERTIA_SYMBOLS, made.parameters, strict=True)) == dict(zip(INERTIA_SYMBOLS, numbers, strict=True))
    assert made.about_origin.tolist() == [[1, 2, 3], [2, 4, 5], [3, 5, 6]]
    assert made.first_moment.tolist() == [7, 8, 9]
    assert made.mass == 10


def test_product_of_inertia_is_the_matrix_element():
    made = body(np.array([2.0]), np.array([[3.0, 5.0, 0.0]]))
    assert made.parameters[1] == -30.0


def test_values_cannot_be_changed():
    made = Inertia.zero()
    with pytest.raises(ValueError, match="read-only"):
        made.first_moment[0] = 1.0


def test_a_wrong_shape_is_refused():
    with pytest.raises(InputError, match=r"The first moment of a body must have the shape \(3,\), got \(2,\)"):
        Inertia(1.0, np.zeros(2), np.eye(3))
    with pytest.raises(InputError, match=r"The centre of mass of a body must have the shape \(3,\), got \(2,\)"):
        Inertia.from_com(1.0, (0.1, 0.2), np.eye(3))
    with pytest.raises(InputError, match=r"The parameters of a body must have the shape \(10,\), got \(9,\)"):
        Inertia.from_parameters(np.zeros(9))


def test_half_of_an_inertia_is_refused():
    """The products of one triangle were taken as they are, and halved where the frame was moved."""
    with pytest.raises(InputError, match=r"symmetric matrix, .* write each product of inertia at both of its places"):
        Inertia.from_com(2.0, (0, 0, 0), [[2.0, 0.5, 0.1], [0.0, 3.0, 0.2], [0.0, 0.0, 4.0]])


def test_what_rounding_leaves_of_a_point_mass_need_not_be_symmetric():
    """A description of a hand has a frame without size, of which a rotation leaves this much."""
    left = 1e-20 * np.array([[2.7, -0.34, 2.7], [-0.17, 5.4, 0.34], [1.4, 0.34, 1.0]])
    assert Inertia.from_com(1.0, [0.1, 0.0, 0.0], left).mass == 1.0
