"""Distances of every pair of shapes against Pinocchio, and what is built on them, on robots of example-robot-data."""

from itertools import combinations

import numpy as np
import pytest

pinocchio_distances = pytest.importorskip("pinocchio_distances")

from pinocchio_distances import PinocchioDistances, pinocchio, urdf  # noqa: E402

from steelyard import Robot  # noqa: E402
from steelyard.collision import RobotGeometry, SelfCollision, TablePlane, WorkspaceBox  # noqa: E402
from steelyard.collision.configurations import place_links  # noqa: E402
from steelyard.collision.distances import PairDistances  # noqa: E402

pytestmark = pytest.mark.usefixtures("meshes_in_this_process")

FAST = ["ur5_robot", "panda", "panda_collision"]
SLOW = ["kinova", "z1", "anymal-kinova", "a1", "romeo", "tiago_no_hand"]


def configurations(robot, count, random):
    return random.uniform(-1.5, 1.5, (count, robot.dof))


def pairs_of(geometry):
    """All the pairs of shapes that move against each other."""
    shapes = geometry.shapes
    return [(i, j) for i, j in combinations(range(len(shapes)), 2) if shapes[i].body != shapes[j].body]


@pytest.mark.parametrize("stem", [*FAST, *(pytest.param(stem, marks=pytest.mark.slow) for stem in SLOW)])
def test_distances_of_all_pairs(stem, random):
    path = urdf(stem)
    robot = Robot.from_urdf(path, locked=unmovable(path))
    geometry = RobotGeometry.from_urdf(robot)
    pairs = pairs_of(geometry)
    q = configurations(robot, 8, random)
    ours = PairDistances(geometry.shapes, [[pair] for pair in pairs]).distances(place_links(robot, q), np.inf)
    theirs = PinocchioDistances(path, geometry, pairs)(q)
    assert (theirs > 0).any()
    assert (theirs < 0).any()
    # Both stop at 1e-6 m, and farther apart at as much of the distance.
    assert (np.abs(ours - theirs) <= 2e-6 * np.maximum(1.0, np.abs(theirs))).all()


def unmovable(path):
    """Joints of more than one degree of freedom."""
    model = pinocchio.buildModelFromUrdf(str(path))
    return [model.names[i] for i, joint in enumerate(model.joints) if i > 0 and joint.nv > 1]


@pytest.mark.parametrize("stem", ["ur5_robot", pytest.param("kinova", marks=pytest.mark.slow)])
def test_distances_of_exact_meshes(stem, random):
    path = urdf(stem)
    robot = Robot.from_urdf(path)
    geometry = RobotGeometry.from_urdf(robot, meshes="exact")
    pairs = pairs_of(geometry)
    q = configurations(robot, 10, random)
    ours = PairDistances(geometry.shapes, [[pair] for pair in pairs]).distances(place_links(robot, q), np.inf)
    theirs = PinocchioDistances(path, geometry, pairs, exact=True)(q)
    apart = theirs > 1e-6
    np.testing.assert_allclose(ours[apart], theirs[apart], atol=1e-6)
    assert (ours[~apart] <= 0).all()


@pytest.mark.slow
def test_the_least_distance_of_links_of_many_shapes(random):
    """Links of several shapes, compared with the least of Pinocchio's distances over their pairs."""
    path = urdf("panda_collision")
    robot = Robot.from_urdf(path, locked=["panda_finger_joint1", "panda_finger_joint2"])
    geometry = RobotGeometry.from_urdf(robot)
    limit = SelfCollision(geometry, margin=0.02, horizon=0.3)
    pairs = pairs_of(geometry)
    q = configurations(robot, 30, random)
    theirs = PinocchioDistances(path, geometry, pairs)(q)
    for column, links in enumerate(limit.watched):
        wanted = {frozenset(pair) for pair in links}
        members = [
            index
            for index, (i, j) in enumerate(pairs)
            if frozenset((geometry.shapes[i].link, geometry.shapes[j].link)) in wanted
        ]
        least = theirs[:, members].min(axis=1)
        np.testing.assert_allclose(limit.distances(q)[:, column], least, atol=3e-6)
        expected = np.minimum(least, 0.3) - limit.margins[column]
        np.testing.assert_allclose(limit.clearance(q)[:, column], expected, atol=3e-6)


@pytest.mark.parametrize("link", ["tool0", "ee_link", "forearm_link"])
def test_the_workspace_against_frame_placements(link, random):
    path = urdf("ur5_robot")
    robot = Robot.from_urdf(path)
    limit = WorkspaceBox(robot, link, (-0.5, -0.6, -0.2), (0.7, np.inf, 1.0), point=(0.01, 0.02, 0.03))
    q = configurations(robot, 20, random)
    model = pinocchio.buildModelFromUrdf(str(path))
    data = model.createData()
    clearance = limit.clearance(q)
    assert clearance.shape == (20, 5)
    for row, configuration in enumerate(q):
        pinocchio.framesForwardKinematics(model, data, configuration)
        x, y, z = data.oMf[model.getFrameId(link)].act(np.array([0.01, 0.02, 0.03]))
        np.testing.assert_allclose(limit.positions(configuration)[0], [x, y, z], atol=1e-12)
        np.testing.assert_allclose(clearance[row], [x + 0.5, 0.7 - x, y + 0.6, z + 0.2, 1.0 - z], atol=1e-12)


def test_the_table_against_all_vertices_of_the_meshes(random):
    """The heights of all the vertices of all the meshes of a body, placed by Pinocchio."""
    path = urdf("ur5_robot")
    robot = Robot.from_urdf(path)
    geometry = RobotGeometry.from_urdf(robot).without(["ee_link"])
    normal, offset = np.array([0.2, -0.3, 2.0]), -1.5
    limit = TablePlane(geometry, normal, offset, margin=0.03, ignore=["shoulder_link"])
    assert limit.labels == robot.link_names[1:]
    q = configurations(robot, 20, random)
    oracle = PinocchioDistances(path, geometry, [], exact=True)
    shapes = oracle.geometry.geometryObjects
    for row, clearance in zip(q, limit.clearance(q), strict=True):
        pinocchio.updateGeometryPlacements(oracle.model, oracle.placements, oracle.geometry, oracle.data, row)
        for link, value in zip(limit.labels, clearance, strict=True):
            number = oracle.geometry.getGeometryId(f"{link}_0")
            placed = oracle.data.oMg[number]
            vertices = shapes[number].geometry.vertices() @ placed.rotation.T + placed.translation
            expected = ((vertices @ normal - offset) / np.linalg.norm(normal)).min() - 0.03
            assert value == pytest.approx(expected, abs=1e-12)
