"""Moments of solid shapes beside textbook formulas, trimesh and MuJoCo."""

import numpy as np
import pytest

from steelyard.collision import Box, Capsule, Cylinder, Mesh, PlacedShape, Sphere
from steelyard.collision.shapes import moments_of_surface
from steelyard.robot import Robot
from steelyard.robot.inertia import Inertia, parameters_of_pseudo_inertia, pseudo_inertia
from steelyard.robot.placement import rpy_rotation

SHAPES = (Sphere(0.3), Box((0.1, 0.2, 0.5)), Cylinder(0.2, 0.7), Capsule(0.2, 0.7))


def about_center(shape):
    """Volume and inertia about the centre at a density of 1 kg/m³."""
    inertia = Inertia.from_parameters(parameters_of_pseudo_inertia(shape.moments))
    return inertia.mass, inertia.about_com


def test_textbook_formulas():
    # Solid sphere 2/5 m r², box m (b² + c²) / 12, cylinder m (3 r² + h²) / 12 and m r² / 2.
    volume, inertia = about_center(SHAPES[0])
    assert volume == pytest.approx(4 / 3 * np.pi * 0.3**3)
    assert np.allclose(inertia, 0.4 * volume * 0.3**2 * np.eye(3), rtol=1e-14)

    volume, inertia = about_center(SHAPES[1])
    assert volume == pytest.approx(0.01)
    assert np.allclose(inertia, 0.01 / 12 * np.diag([0.2**2 + 0.5**2, 0.1**2 + 0.5**2, 0.1**2 + 0.2**2]), rtol=1e-14)

    volume, inertia = about_center(SHAPES[2])
    assert volume == pytest.approx(np.pi * 0.2**2 * 0.7)
    across = volume * (3 * 0.2**2 + 0.7**2) / 12
    assert np.allclose(inertia, np.diag([across, across, volume * 0.2**2 / 2]), rtol=1e-14)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.kind)
def test_primitives_agree_with_mujoco(shape):
    mujoco = pytest.importorskip("mujoco")
    size = {
        "sphere": lambda: [shape.radius],
        "box": lambda: np.array(shape.size) / 2,
        "cylinder": lambda: [shape.radius, shape.length / 2],
        "capsule": lambda: [shape.radius, shape.length / 2],
    }[shape.kind]()
    numbers = " ".join(map(str, size))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body><freejoint/><geom type="{shape.kind}" size="{numbers}" density="1"/></body>'
        "</worldbody></mujoco>"
    )
    volume, inertia = about_center(shape)
    assert volume == pytest.approx(model.body_mass[1], rel=1e-12)
    assert np.allclose(np.linalg.eigvalsh(inertia), np.sort(model.body_inertia[1]), rtol=1e-12)


def test_hulls_of_points_agree_with_trimesh():
    trimesh = pytest.importorskip("trimesh")
    random = np.random.default_rng(5)
    for _ in range(5):
        points = random.normal(size=(40, 3)) * [0.3, 0.1, 0.05] + random.normal(size=3)
        hull = trimesh.convex.convex_hull(points)
        volume, inertia = about_center(Mesh(points))
        assert volume == pytest.approx(hull.volume, rel=1e-10)
        assert np.allclose(inertia, hull.moment_inertia, rtol=1e-9, atol=1e-9 * np.abs(inertia).max())


def test_the_hull_counts_where_a_surface_is_open():
    corners = np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.2) for z in (0, 0.5)])
    triangles = Mesh(corners).hull[1]
    whole, damaged = Mesh(corners, triangles, exact=True), Mesh(corners, triangles[2:], exact=True)
    assert np.allclose(whole.moments, damaged.moments)
    assert whole.moments[3, 3] == pytest.approx(0.01)


def test_a_surface_far_from_the_origin_keeps_its_digits():
    corners, triangles = Mesh(np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.2) for z in (0, 0.5)])).hull
    found = moments_of_surface(corners + np.array([1e4, 0, 0]), triangles)
    assert found[3, 3] == pytest.approx(0.01, rel=1e-9)
    assert found[0, 3] / found[3, 3] == pytest.approx(1e4 + 0.05, rel=1e-14)


def test_flat_meshes_have_no_volume():
    assert Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])).moments[3, 3] == pytest.approx(0.0, abs=1e-15)


def test_placed_moments_and_boxes():
    robot = Robot.from_dh([(0, 0.5, 0, "q")])
    placement = rpy_rotation(0.3, -0.5, 1.1)
    placement[:3, 3] = 0.1, 0.2, -0.3
    for shape in SHAPES:
        placed = PlacedShape.on(robot, "link1", shape, placement)
        expected = Inertia.from_parameters(parameters_of_pseudo_inertia(shape.moments)).moved(placement)
        assert np.allclose(placed.moments, pseudo_inertia(expected.parameters), atol=1e-15)
        # The lowest point of a shape along an axis is where its farthest points are, of many.
        directions = np.random.default_rng(1).normal(size=(20_000, 3))
        points = shape.lowest(directions) @ placement[:3, :3].T + placement[:3, 3]
        lower, upper = placed.box
        assert np.all(points >= lower - 1e-12)
        assert np.all(points <= upper + 1e-12)
        assert np.allclose(points.min(axis=0), lower, atol=0.01)
        assert np.allclose(points.max(axis=0), upper, atol=0.01)
