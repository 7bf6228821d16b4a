"""Distances against formulas and quadratic programmes that know nothing of GJK, and what must not change them."""

import copy
import pickle

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

import steelyard as sy
from steelyard.collision import Box, Capsule, Cylinder, Mesh, PlacedShape, RobotGeometry, SelfCollision, Sphere
from steelyard.collision.configurations import place_links
from steelyard.collision.distances import PairDistances
from steelyard.robot.placement import rotation_y, rpy_rotation

pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")

SHAPES = {
    "sphere": Sphere(0.11),
    "capsule": Capsule(0.07, 0.3),
    "cylinder": Cylinder(0.1, 0.2),
    "box": Box((0.1, 0.3, 0.2)),
    "mesh": Mesh(np.random.default_rng(5).normal(size=(30, 3)) * (0.1, 0.05, 0.15)),
}


@pytest.fixture(scope="module")
def arm():
    return sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.5, 0, "q"), ("pi/2", 0.5, 0, "q")], name="arm")


def core(shape):
    """Corners whose hull, grown by a radius, is the shape; cylinders with 400 corners at each end."""
    match shape:
        case Sphere():
            return np.zeros((1, 3)), shape.radius
        case Capsule():
            return np.array([[0, 0, -0.5], [0, 0, 0.5]]) * shape.length, shape.radius
        case Box():
            signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
            return signs * np.array(shape.size) / 2, 0.0
        case Cylinder():
            angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
            rim = shape.radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
            return np.vstack([rim + np.array([0, 0, sign * shape.length / 2]) for sign in (-1, 1)]), 0.0
    return shape.vertices, 0.0


def hull_distance(first, second):
    """Distance of two hulls: the shortest difference of two convex combinations of corners."""
    heavy = 1e4  # the sums of the weights are 1 to its square
    sums = np.zeros((2, len(first) + len(second)))
    sums[0, : len(first)] = sums[1, len(first) :] = heavy
    matrix = np.vstack([np.hstack([first.T, -second.T]), sums])
    weights = nnls(matrix, np.array([0, 0, 0, heavy, heavy]), maxiter=10000)[0]
    return float(np.linalg.norm(weights[: len(first)] @ first - weights[len(first) :] @ second))


def hull_depth(first, second):
    """Depth of two hulls that overlap: the least distance of 0 to a face of the hull of all differences."""
    return float((-ConvexHull((first[:, None] - second[None]).reshape(-1, 3)).equations[:, 3]).min())


def placed(corners, pose):
    return corners @ pose[:3, :3].T + pose[:3, 3]


@pytest.mark.parametrize("first", SHAPES)
@pytest.mark.parametrize("second", SHAPES)
def test_distances_and_depths_of_every_kind(first, second, arm, random):
    """The second shape is carried by the second link, the first one by the base."""
    q = random.uniform(-1.5, 1.5, (6, 3))
    turns = [rpy_rotation(*random.uniform(-3, 3, 3)) for _ in range(2)]
    turns[0][:3, 3] = (1.0, 0.3, 0.05)
    one, other = SHAPES[first], SHAPES[second]
    shapes = [PlacedShape.on(arm, "base", one, turns[0]), PlacedShape.on(arm, "link2", other, turns[1])]
    ours = PairDistances(shapes, [[(0, 1)]]).distances(place_links(arm, q), np.inf)[:, 0]
    model = sy.Model(arm)
    tolerance = 1e-4 if "cylinder" in (first, second) else 5e-6
    (corners, radius), (others, other_radius) = core(one), core(other)
    for configuration, value in zip(q, ours, strict=True):
        here = placed(corners, turns[0])
        there = placed(others, model.pose(configuration, "link2") @ turns[1])
        distance = hull_distance(here, there)
        if distance < 1e-6 and len(here) > 2 and len(there) > 2 and not radius and not other_radius:
            assert value == pytest.approx(-hull_depth(here, there), abs=tolerance)
        elif distance > 1e-6:
            assert value == pytest.approx(distance - radius - other_radius, abs=tolerance)


def test_depth_of_boxes_that_overlap(arm):
    base, hand = Box((1.0, 1.0, 1.0)), Box((0.2, 0.2, 0.2))
    shapes = [PlacedShape.on(arm, "base", base), PlacedShape.on(arm, "link1", hand)]
    q = np.array([[0.0, 0.0, 0.0], [np.pi / 2, 0.0, 0.0]])  # the hand is half in the base
    found = PairDistances(shapes, [[(0, 1)]]).distances(place_links(arm, q), np.inf)
    np.testing.assert_allclose(found, -0.1, atol=1e-6)


@pytest.fixture(scope="module")
def limit(arm):
    rod = rotation_y(np.pi / 2)
    rod[0, 3] = -0.25
    shapes = [PlacedShape.on(arm, name, Capsule(0.03, 0.5), rod) for name in arm.link_names]
    shapes += [PlacedShape.on(arm, "base", Box((0.3, 0.3, 0.1)))]
    shapes += [PlacedShape.on(arm, "link3", one) for one in (Sphere(0.05), Box((0.2, 0.02, 0.1)))]
    return SelfCollision(RobotGeometry(arm, shapes), margin=0.01, horizon=0.2)


def test_the_horizon_cuts_distances_and_changes_nothing_below(limit, random):
    q = random.uniform(-3, 3, (300, 3))
    whole = limit.distances(q)
    assert (whole > 0.2).any()
    assert (whole < 0.2).any()
    np.testing.assert_array_equal(limit.clearance(q), np.minimum(whole, 0.2) - limit.margins)


def test_a_batch_is_its_samples(limit, random):
    q = random.uniform(-3, 3, (25, 3))
    one_by_one = np.vstack([limit.clearance(configuration) for configuration in q])
    np.testing.assert_allclose(limit.clearance(q), one_by_one, atol=2e-6)
    weights = np.ones((25, len(limit.labels)))
    rows = [limit.vjp(p[None], None, None, weights[:1])[0] for p in q]
    np.testing.assert_allclose(limit.vjp(q, None, None, weights)[0], np.vstack(rows), atol=1e-4)


def test_long_batches_are_cut_in_parts(limit, random):
    q = random.uniform(-3, 3, (2500, 3))
    picked = [0, 2047, 2048, 2499]
    np.testing.assert_allclose(limit.clearance(q)[picked], limit.clearance(q[picked]), atol=2e-6)


def test_constraints_can_be_copied_by_value(limit, random):
    q = random.uniform(-3, 3, (5, 3))
    expected = limit.clearance(q)
    for twin in (copy.deepcopy(limit), pickle.loads(pickle.dumps(limit))):
        assert twin.labels == limit.labels
        np.testing.assert_array_equal(twin.clearance(q), expected)


def test_exact_meshes_see_hollows_that_hulls_fill(arm):
    """A U of three boxes as one mesh: a ball between its arms is free of the surface, but in the hull."""
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    parts = [trimesh.creation.box((0.4, 0.05, 0.1)), *(trimesh.creation.box((0.05, 0.4, 0.1)) for _ in range(2))]
    for part, shift in zip(parts, [(0, -0.2, 0), (-0.2, 0, 0), (0.2, 0, 0)], strict=True):
        part.apply_translation(shift)
    fork = trimesh.util.concatenate(parts)
    place = np.eye(4)
    place[:3, 3] = (0.5, 0.0, 0.0)
    ball = PlacedShape.on(arm, "link1", Sphere(0.04))
    q = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.45, 0.0, 0.0]])
    measured = {}
    for exact in (False, True):
        shapes = [PlacedShape.on(arm, "base", Mesh(fork.vertices, fork.faces, exact), place), ball]
        measured[exact] = PairDistances(shapes, [[(0, 1)]]).distances(place_links(arm, q), np.inf)[:, 0]
    # Between the arms, the nearest walls are at x = 0.5 ± 0.175 and at y = -0.175.
    assert measured[True][0] == pytest.approx(0.175 - 0.04, abs=1e-6)
    x, y = 0.5 * np.cos(0.3), 0.5 * np.sin(0.3)
    assert measured[True][1] == pytest.approx(min(x - 0.325, 0.675 - x, y + 0.175) - 0.04, abs=1e-6)
    assert (measured[False][:2] < 0).all()
    assert (measured[False] <= measured[True]).all()


def test_surfaces_that_cross_have_the_depth_of_their_hulls(arm):
    corners = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)])
    hull = ConvexHull(corners)
    surface = Mesh(corners, hull.simplices, exact=True)
    shapes = [PlacedShape.on(arm, "base", Box((1.0, 1.0, 1.0))), PlacedShape.on(arm, "link1", surface)]
    found = PairDistances(shapes, [[(0, 1)]]).distances(place_links(arm, np.zeros((1, 3))), np.inf)
    np.testing.assert_allclose(found, -0.1, atol=1e-6)
