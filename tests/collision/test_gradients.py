"""Gradients of all the constraints against central differences, where these are smooth."""

import numpy as np
import pytest

from steelyard import Robot
from steelyard.collision import (
    Box,
    Capsule,
    Cylinder,
    Mesh,
    Obstacle,
    ObstacleClearance,
    PlacedShape,
    RobotGeometry,
    SelfCollision,
    Sphere,
    TablePlane,
    WorkspaceBox,
)
from steelyard.excitation.motion_constraints import MotionConstraint
from steelyard.robot.placement import rotation_y, translation

ROBOT = """<robot name="crane">
  <link name="floor"/><link name="post"/><link name="slide"/><link name="boom"/><link name="hook"/><link name="jaw"/>
  <link name="flange"/>
  <joint name="turn" type="revolute"><parent link="floor"/><child link="post"/><origin xyz="0 0 0.3" rpy="0.1 0 0"/>
    <axis xyz="0 0.2 1"/><limit lower="-2" upper="2"/></joint>
  <joint name="lift" type="prismatic"><parent link="post"/><child link="slide"/><origin xyz="0.1 0 0.4"/>
    <axis xyz="0 0 1"/><limit lower="-0.2" upper="0.4"/></joint>
  <joint name="swing" type="revolute"><parent link="slide"/><child link="boom"/><origin xyz="0.05 0.05 0"/>
    <axis xyz="0 1 0.3"/><limit lower="-2" upper="2"/></joint>
  <joint name="roll" type="continuous"><parent link="boom"/><child link="hook"/><origin xyz="0.5 0 0" rpy="0 0.2 0.1"/>
    <axis xyz="1 0 0.5"/></joint>
  <joint name="hold" type="fixed"><parent link="hook"/><child link="flange"/><origin xyz="0.1 0.02 0"/></joint>
  <joint name="grip" type="revolute"><parent link="boom"/><child link="jaw"/><origin xyz="0.4 0 -0.1"/>
    <axis xyz="0 0 1"/><mimic joint="swing" multiplier="-0.7" offset="0.2"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def crane(tmp_path_factory):
    """A tree with a slide, a fixed link and a mimic joint, with shapes of every kind."""
    path = tmp_path_factory.mktemp("crane") / "crane.urdf"
    path.write_text(ROBOT)
    robot = Robot.from_urdf(path)
    corners = np.random.default_rng(3).normal(size=(40, 3)) * (0.08, 0.03, 0.03)
    lying = rotation_y(np.pi / 2)
    shapes = [
        ("floor", Box((0.5, 0.6, 0.1)), None),
        ("post", Cylinder(0.04, 0.5), translation(0.0, 0.0, 0.2)),
        ("boom", Capsule(0.02, 0.4), translation(0.25, 0.0, 0.0) @ lying),
        ("hook", Mesh(corners), translation(0.05, 0.0, -0.02)),
        ("flange", Sphere(0.05), None),
        ("jaw", Cylinder(0.02, 0.1), translation(0.1, 0.0, -0.05) @ lying),
        ("jaw", Box((0.05, 0.02, 0.03)), translation(0.15, 0.0, -0.05)),
    ]
    return RobotGeometry(robot, [PlacedShape.on(robot, link, shape, place) for link, shape, place in shapes])


def limits_of(geometry):
    pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    wall = [
        Obstacle("wall", Box((0.1, 1.0, 1.0)), translation(0.6, 0.2, 0.5)),
        Obstacle("ball", Sphere(0.2), translation(-0.3, -0.4, 0.6), margin=0.1),
        Obstacle("pipe", Capsule(0.05, 1.0), translation(0.3, 0.5, 0.6)),
    ]
    return {
        "self-collision": SelfCollision(geometry, 0.01, horizon=0.6, exclude=[("floor", "post")]),
        "obstacles": ObstacleClearance(geometry, wall, 0.02, horizon=0.6),
        "table": TablePlane(geometry, (0.1, -0.2, 1.0), 0.2),
        "workspace": WorkspaceBox(geometry.robot, "flange", (-0.5, -0.5, 0.0), (0.6, 0.5, 1.0), (0.1, 0.0, 0.2)),
    }


def differences(limit, q, step):
    """Central differences (S, m, N)."""
    gradient = np.empty((len(q), len(limit.labels), q.shape[1]))
    for joint in range(q.shape[1]):
        shift = np.zeros(q.shape[1])
        shift[joint] = step
        gradient[:, :, joint] = (limit.clearance(q + shift) - limit.clearance(q - shift)) / (2 * step)
    return gradient


@pytest.mark.parametrize("kind", ["self-collision", "obstacles", "table", "workspace"])
def test_gradients(kind, crane, random):
    limit = limits_of(crane)[kind]
    assert isinstance(limit, MotionConstraint)
    q = random.uniform(-1.2, 1.2, (100, crane.robot.dof)) * (1.0, 0.3, 1.0, 1.0)
    fine, coarse = (differences(limit, q, step) for step in (5e-4, 1e-3))
    compared = 0
    for column, label in enumerate(limit.labels):
        # Where nearest points jump, or the horizon begins, differences of two widths disagree.
        smooth = np.abs(fine - coarse)[:, column].max(axis=1) < 2e-3
        assert smooth.mean() > 0.6, label
        weights = np.zeros((len(q), len(limit.labels)))
        weights[:, column] = random.uniform(0.5, 2.0, len(q))
        by_q, by_dq, by_ddq = limit.vjp(q, q, q, weights)
        expected = weights[:, column, None] * fine[:, column]
        np.testing.assert_allclose(by_q[smooth], expected[smooth], atol=8e-3, err_msg=label)
        assert not by_dq.any()
        assert not by_ddq.any()
        compared += np.count_nonzero(np.abs(fine[smooth, column]).max(axis=1) > 1e-3)
    assert compared > 30 * len(limit.labels), "most were beyond the horizon"


@pytest.mark.parametrize("kind", ["self-collision", "obstacles", "table", "workspace"])
def test_pull_back_adds_up(kind, crane, random):
    """The gradient of a sum is the sum of the gradients, and samples without weight have none."""
    limit = limits_of(crane)[kind]
    q = random.uniform(-1.0, 1.0, (12, crane.robot.dof))
    weights = random.normal(size=(12, len(limit.labels)))
    weights[3] = 0.0
    single = np.zeros(q.shape)
    for column in range(len(limit.labels)):
        alone = np.zeros_like(weights)
        alone[:, column] = weights[:, column]
        single += limit.vjp(q, None, None, alone)[0]
    whole = limit.vjp(q, None, None, weights)[0]
    np.testing.assert_allclose(whole, single, atol=1e-12)
    assert not whole[3].any()
