"""Constant placements."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from steelyard.robot.placement import axis_frame, inverse, rotation_x, rotation_y, rotation_z, rpy_rotation, translation

angles = st.floats(-10.0, 10.0)
entries = st.floats(-1.0, 1.0).filter(lambda value: value == 0.0 or abs(value) > 1e-12)


@pytest.mark.parametrize("rotation", [rotation_x, rotation_y, rotation_z])
@pytest.mark.parametrize("quarters", range(-6, 7))
def test_quarter_turns_are_exact(rotation, quarters):
    matrix = rotation(quarters * math.pi / 2)
    assert set(np.unique(matrix)) <= {-1.0, 0.0, 1.0}
    assert not np.signbit(matrix[matrix == 0.0]).any()
    axis = {rotation_x: "x", rotation_y: "y", rotation_z: "z"}[rotation]
    assert np.allclose(matrix[:3, :3], Rotation.from_euler(axis, 90 * quarters, degrees=True).as_matrix(), atol=1e-14)


@given(roll=angles, pitch=angles, yaw=angles)
def test_rpy_turns_about_fixed_axes(roll, pitch, yaw):
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    assert np.allclose(rpy_rotation(roll, pitch, yaw)[:3, :3], expected, atol=1e-13)


@given(axis=st.tuples(entries, entries, entries).filter(any), scale=st.sampled_from([1e-200, 1e-3, 1.0, 1e200]))
def test_axis_frame_takes_z_to_the_axis(axis, scale):
    matrix = axis_frame([scale * value for value in axis])[:3, :3]
    assert np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    assert np.allclose(matrix[:, 2], np.array(axis) / np.linalg.norm(axis), atol=1e-14)


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_coordinate_axes_are_exact_permutations(place, sign):
    axis = np.zeros(3)
    axis[place] = 3.0 * sign
    matrix = axis_frame(axis)[:3, :3]
    assert np.array_equal(np.abs(matrix).sum(axis=0), np.ones(3))
    assert np.array_equal(matrix[:, 2], axis / 3.0)
    assert np.linalg.det(matrix) == 1.0


def test_a_nearly_aligned_axis_keeps_its_tilt():
    matrix = axis_frame((0.0, -1.0, -4.37114e-08))
    assert matrix[2, 2] == pytest.approx(-4.37114e-08, rel=1e-12)


def test_an_axis_without_length_is_refused():
    with pytest.raises(ValueError, match="no length"):
        axis_frame((0.0, 0.0, 0.0))


@given(angle=angles, shift=st.tuples(entries, entries, entries))
def test_inverse(angle, shift):
    placement = rotation_y(angle) @ translation(*shift)
    assert np.allclose(inverse(placement), np.linalg.inv(placement), atol=1e-13)
