"""Shapes: their lowest points, hulls and bounding capsules, against brute force."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from steelyard.collision import Box, Capsule, Cylinder, Mesh, Sphere
from steelyard.collision.distances import segment_distance_bound
from steelyard.collision.shapes import most_neighbours
from steelyard.errors import InputError
from steelyard.robot.placement import rpy_rotation


def bone(random, count=60):
    """Vertices of an oblong, hollow body."""
    points = random.normal(size=(count, 3)) * (0.05, 0.3, 0.08)
    return points + np.array([0.2, -0.1, 0.4])


def surface(shape, random):
    """Many points on and in a shape, its corners among them."""
    match shape:
        case Sphere():
            u = random.normal(size=(20000, 3))
            return shape.radius * u / np.linalg.norm(u, axis=1, keepdims=True)
        case Capsule():
            ball = surface(Sphere(shape.radius), random)
            return ball + np.sign(ball[:, 2:]) * (0.0, 0.0, shape.length / 2)
        case Cylinder():
            angle = random.uniform(0, 2 * np.pi, 20000)
            rim = np.stack([np.cos(angle), np.sin(angle)], axis=1) * shape.radius
            return np.column_stack([rim, random.choice([-0.5, 0.5], 20000) * shape.length])
        case Box():
            return random.choice([-0.5, 0.5], (200, 3)) * shape.size
        case Mesh():
            return shape.vertices


@pytest.mark.parametrize(
    ("shape", "tolerance"),
    [(Sphere(0.3), 1e-3), (Capsule(0.1, 0.4), 1e-3), (Cylinder(0.2, 0.5), 1e-6), (Box((0.1, 0.7, 0.3)), 1e-12)],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_lowest_points_of_primitives(shape, tolerance, random):
    points = surface(shape, random)
    directions = random.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lowest = shape.lowest(directions)
    reached = np.einsum("ij,ij->i", directions, lowest)
    sampled = (directions @ points.T).min(axis=1)
    assert (reached <= sampled + 1e-12).all()
    np.testing.assert_allclose(reached, sampled, atol=tolerance)


def test_lowest_point_of_a_mesh_is_that_of_all_its_vertices(random):
    mesh = Mesh(bone(random, 500))
    directions = random.normal(size=(200, 3))
    reached = np.einsum("ij,ij->i", directions, mesh.lowest(directions))
    np.testing.assert_allclose(reached, (directions @ mesh.vertices.T).min(axis=1), atol=1e-14)


@pytest.mark.parametrize("kind", ["sphere", "capsule", "cylinder", "box", "oblong mesh", "round mesh", "flat mesh"])
def test_bounding_capsules_hold_their_shapes(kind, random):
    shape = {
        "sphere": Sphere(0.3),
        "capsule": Capsule(0.1, 0.4),
        "cylinder": Cylinder(0.3, 0.1),
        "box": Box((0.2, 0.9, 0.4)),
        "oblong mesh": Mesh(bone(random)),
        "round mesh": Mesh(random.normal(size=(300, 3))),
        "flat mesh": Mesh(random.normal(size=(30, 3)) * (1.0, 1.0, 0.0) + 0.5),
    }[kind]
    bounds = shape.bounds
    axis = bounds.end - bounds.start
    points = surface(shape, random)
    along = np.clip((points - bounds.start) @ axis / max(axis @ axis, 1e-300), 0.0, 1.0)
    away = np.linalg.norm(points - bounds.start - along[:, None] * axis, axis=1)
    assert away.max() <= bounds.radius + 1e-12
    assert bounds.radius <= 2.0 * np.linalg.norm(points - points.mean(axis=0), axis=1).max(), "it is no loose bound"


def test_hulls_are_closed_and_point_outward(random):
    corners, triangles = Mesh(bone(random, 200)).hull
    a, b, c = (corners[triangles[:, column]] for column in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(ConvexHull(corners).volume, rel=1e-12)
    edges = {(one, other) for t in triangles.tolist() for one, other in zip(t, t[1:] + t[:1], strict=True)}
    assert len(edges) == 3 * len(triangles)
    assert {edge[::-1] for edge in edges} == edges


def test_flat_meshes_have_two_sides():
    square = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1], [0.5, 0.5, 1]], dtype=float)
    corners, triangles = Mesh(square).hull
    assert len(corners) == 4
    assert len(triangles) == 4


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sphere(0.0), "a sphere: radius must be positive and finite, in m, got 0"),
        (lambda: Sphere("1"), "radius must be a number in m, got '1'"),
        (lambda: Capsule(0.1, -1.0), "a capsule: length must be positive"),
        (lambda: Cylinder(np.nan, 1.0), "a cylinder: radius must be positive and finite"),
        (lambda: Box((1.0, 2.0)), "size must be three numbers"),
        (lambda: Box((1.0, 2.0, True)), "size must be a number in m, got True"),
        (lambda: Mesh(np.zeros((4, 2))), r"of shape \(k, 3\), got shape \(4, 2\)"),
        (lambda: Mesh(np.full((4, 3), np.inf)), "vertices must be finite"),
        (lambda: Mesh(np.outer(np.arange(5), [1.0, 2.0, 3.0])), "5 different vertices span no surface"),
        (lambda: Mesh(np.zeros((0, 3))), "0 different vertices span no surface"),
        (lambda: Mesh(np.eye(3), [[0, 1, 3]]), "name vertices that do not exist; it has 3 vertices"),
        (lambda: Mesh(np.eye(3), exact=True), "an exact surface needs triangles"),
    ],
)
def test_bad_shapes_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_segment_bounds_are_tight_lower_bounds(random):
    """Against the least distance on a fine grid of both segments, parallel and pointlike ones included."""
    ends = random.uniform(-1, 1, (4, 300, 3))
    ends[3, :60] = ends[2, :60] + (ends[1, :60] - ends[0, :60])  # parallel
    ends[3, 60:90] = ends[2, 60:90]  # a point
    ends[3, 90:120] = ends[2, 90:120] + (ends[1, 90:120] - ends[0, 90:120]) * 0.7 + 1e-6  # nearly parallel
    grid = np.linspace(0, 1, 61)[:, None, None]
    first, second = (a + grid * (b - a) for a, b in (ends[:2], ends[2:]))
    sampled = np.linalg.norm(first[:, None] - second[None], axis=-1).min(axis=(0, 1))
    bound = segment_distance_bound((ends[0], ends[1]), (ends[2], ends[3]))
    assert (bound <= sampled).all()
    assert (sampled - bound).max() < 0.05


def drum(corners):
    """A prism whose two faces have many corners each, with rounding."""
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.vstack([np.column_stack([ring, np.full(corners, height)]) for height in (0.0, 0.5)])


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_faces_of_many_corners_are_cut_in_strips(turn):
    """Coal counts the neighbours of a corner in one byte."""
    coal = pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    points = drum(400) @ rpy_rotation(turn, 2 * turn, 0.0)[:3, :3].T
    mesh = Mesh(points)
    corners, triangles = mesh.hull
    assert len(corners) == 800
    assert most_neighbours(triangles) < 20
    a, b, c = (corners[triangles[:, column]] for column in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(ConvexHull(points).volume, rel=1e-12)
    assert mesh.collision_object(coal).num_points == 800


def test_corners_of_too_many_neighbours_are_refused():
    coal = pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    cone = Mesh(np.vstack([drum(300)[:300], [[0.0, 0.0, 1.0]]]))
    with pytest.raises(
        InputError, match="a corner of the convex hull of its mesh has 300 neighbours, and coal takes at most 255"
    ):
        cone.collision_object(coal)
