"""Centres of mass in convex hulls, against linear programming, meshes and clouds of points."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from steelyard.dynamics import Model
from steelyard.errors import InputError, MissingExtraError
from steelyard.feasibility import CenterOfMassHull, FeasibleSet, check
from steelyard.feasibility.constraints.center_of_mass import convex_hull, read_points
from steelyard.robot import Robot

seeds = st.integers(0, 2**32 - 1)
CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def worst(constraint, model, place, mass=2.0):
    """Least block and largest error of the equations with the centre of mass there."""
    delta = np.zeros(22)
    delta[17:21] = [*(mass * np.asarray(place)), mass]
    blocks = [float(b.evaluate(delta)[0, 0]) for b in constraint.blocks(model)]
    errors = [abs(float(e.coefficients @ delta[e.indices] - e.value)) for e in constraint.equalities(model)]
    return min(blocks, default=np.inf), max(errors, default=0.0)


def is_mean_of(points, place):
    """Whether weights exist that make the place a mean of the points."""
    count = len(points)
    equations = np.vstack([points.T, np.ones(count)])
    found = linprog(np.zeros(count), A_eq=equations, b_eq=np.append(place, 1.0), bounds=(0, None))
    return found.status == 0


@given(seed=seeds, count=st.integers(4, 30))
def test_hull_of_random_points_is_their_means(two_links, seed, count):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3)) * rng.uniform(0.01, 1.0, 3) + rng.normal(size=3)
    hull = CenterOfMassHull("forearm", points)
    inside = rng.dirichlet(np.ones(count)) @ points
    assert worst(hull, two_links, inside)[0] > 0
    place = points.mean(axis=0) + rng.normal(size=3) * points.std(axis=0)
    value = worst(hull, two_links, place)[0]
    if abs(value) > 1e-6:
        assert (value > 0) == is_mean_of(points, place)


@pytest.mark.slow
def test_all_points_are_in_their_hull(two_links):
    points = np.random.default_rng(1).normal(size=(500, 3))
    hull = CenterOfMassHull("forearm", points)
    assert min(worst(hull, two_links, point)[0] for point in points) > -1e-13
    assert len(hull.points) < 100


def test_triangles_of_a_plane_facet_count_once(two_links):
    rng = np.random.default_rng(2)
    for turn in (np.eye(3), np.linalg.qr(rng.normal(size=(3, 3)))[0]):
        grid = np.array([[x, y, z] for x in range(4) for y in range(4) for z in range(4)], dtype=float)
        hull = convex_hull(0.1 * grid @ turn.T)
        assert (len(hull.vertices), len(hull.normals)) == (8, 6)
        # Facets 0.3 m apart, of a cube.
        np.testing.assert_allclose(hull.normals @ hull.normals.T @ np.ones(6), np.zeros(6), atol=1e-12)
        np.testing.assert_allclose((hull.normals @ hull.vertices.T).max(axis=1), hull.offsets, atol=1e-15)


def test_facets_of_a_box_are_exact(two_links):
    hull = convex_hull(CUBE)
    assert sorted(map(tuple, hull.normals.tolist())) == sorted(
        map(tuple, [*np.eye(3).tolist(), *(-np.eye(3)).tolist()])
    )
    np.testing.assert_array_equal(hull.offsets, np.ones(6))


@pytest.mark.parametrize("turned", [False, True])
def test_points_in_a_plane_bind_to_it(two_links, turned):
    rng = np.random.default_rng(3)
    flat = np.column_stack([rng.uniform(-1, 1, (20, 2)), np.full(20, 0.25)])
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0] if turned else np.eye(3)
    points = flat @ rotation.T
    hull = CenterOfMassHull("forearm", points)
    assert len(hull.hull.plane_values) == 1
    assert len(hull.equalities(two_links)) == 1
    inside, error = worst(hull, two_links, points.mean(axis=0))
    assert inside > 0
    assert error < 1e-14
    assert worst(hull, two_links, points.mean(axis=0) + 0.01 * rotation[:, 2])[1] == pytest.approx(0.02)
    assert worst(hull, two_links, 1.1 * flat[np.argmax(flat[:, 0])] @ rotation.T)[0] < 0


def test_points_on_a_line_bind_to_it(two_links):
    direction = np.array([1.0, 2.0, -2.0]) / 3
    points = np.array([0.1, 0.2, 0.3]) + np.array([-0.2, 0.0, 0.4])[:, None] * direction
    hull = CenterOfMassHull("forearm", points)
    assert (len(hull.hull.plane_values), len(hull.points), len(hull.equalities(two_links))) == (2, 2, 2)
    inside, error = worst(hull, two_links, points[0] + 0.6 * direction)
    assert inside == pytest.approx(0.0, abs=1e-14)
    assert error < 1e-15
    assert worst(hull, two_links, points[0] + 0.61 * direction)[0] == pytest.approx(-0.02)


@pytest.mark.parametrize("points", [[[0.1, 0.2, 0.3]], [[0.1, 0.2, 0.3]] * 5])
def test_one_point_is_the_centre_of_mass(two_links, points):
    hull = CenterOfMassHull("forearm", points)
    assert (len(hull.hull.plane_values), hull.blocks(two_links)) == (3, ())
    assert worst(hull, two_links, [0.1, 0.2, 0.3])[1] < 1e-15
    assert worst(hull, two_links, [0.1, 0.25, 0.3])[1] == pytest.approx(0.1)


def test_thin_bodies_are_no_planes(two_links):
    points = CUBE * [0.5, 0.5, 1e-5] + [0.0, 0.0, 0.1]
    hull = CenterOfMassHull("forearm", points)
    assert len(hull.hull.plane_values) == 0
    assert worst(hull, two_links, [0.1, 0.1, 0.1 + 0.9e-5])[0] > 0
    assert worst(hull, two_links, [0.1, 0.1, 0.1 + 1.1e-5])[0] < 0


def test_flat_mesh_in_single_precision_is_flat():
    rng = np.random.default_rng(4)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = np.column_stack([rng.uniform(-1, 1, (50, 2)), np.zeros(50)]) @ rotation.T
    assert len(convex_hull(points.astype(np.float32).astype(float)).plane_values) == 1


@pytest.mark.parametrize("tolerance", [pytest.param(1e-3, marks=pytest.mark.slow), 1e-2])
def test_fewer_facets_reach_beyond_by_no_more_than_the_tolerance(tolerance):
    sphere = np.random.default_rng(5).normal(size=(800, 3))
    sphere *= 0.1 / np.linalg.norm(sphere, axis=1, keepdims=True)
    exact, coarse = convex_hull(sphere), convex_hull(sphere, tolerance)
    assert len(coarse.normals) < 0.6 * len(exact.normals)
    assert np.max(coarse.normals @ sphere.T - coarse.offsets[:, None]) < 1e-15
    # How far the coarse hull reaches in the direction of each exact facet, by linear programming.
    for normal, offset in zip(exact.normals[::40], exact.offsets[::40], strict=True):
        reach = linprog(-normal, A_ub=coarse.normals, b_ub=coarse.offsets, bounds=(None, None))
        assert -reach.fun <= offset + tolerance + 1e-9


def test_mesh_file_gives_its_centre_of_mass_inside(two_links, tmp_path, meshes_in_this_process):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    mesh = trimesh.creation.annulus(r_min=40, r_max=60, height=300)
    mesh.apply_translation([10, 20, 30])
    for suffix in (".stl", ".obj", ".ply"):
        path = tmp_path / f"link{suffix}"
        mesh.export(path)
        hull = CenterOfMassHull.from_mesh(
            "forearm", path, scale=0.001, placement={"xyz": (0, 0, 1), "rpy": (0, 0, np.pi)}
        )
        # In the hole, though no material is there.
        value, _ = worst(hull, two_links, [-0.01, -0.02, 1.03])
        assert value == pytest.approx(2.0 * 0.06 * np.cos(np.pi / 32), rel=0.02)
        assert worst(hull, two_links, [-0.01, -0.02, 1.181])[0] == pytest.approx(-0.002, rel=1e-3)


def test_files_of_points(tmp_path):
    points = np.random.default_rng(6).normal(size=(7, 3))
    np.save(tmp_path / "points.npy", points)
    np.savetxt(tmp_path / "points.txt", points, fmt="%.17g", header="x y z")
    (tmp_path / "points.csv").write_text("x;y;z\n" + "\n".join(";".join(map(repr, row)) for row in points.tolist()))
    for name in ("points.npy", "points.txt", "points.csv"):
        np.testing.assert_array_equal(read_points(tmp_path / name), points)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", b"", "holds no points"),
        ("a.csv", b"x,y,z\n", "holds no points"),
        ("a.csv", b"1,2\n", "line 1 has 2 numbers"),
        ("a.csv", b"x,y,z\n1,2,3\n1,two,3\n", "line 3 is '1,two,3'"),
        ("a.csv", b"x,y,z\na,b,c\n", "line 2 is 'a,b,c'"),
        ("a.csv", b"1,2,nan\n", "row 1 is not finite"),
        ("a.csv", b"\xff\xfe\x00", "is not UTF-8"),
        ("a.npy", b"no array", "is no array of numbers"),
        ("a.npy", b"", "is no array of numbers"),
        ("a.stl", b"", "is empty; export it again"),
        pytest.param("a.obj", b"# nothing", "the mesh cannot be read|has no vertices", marks=pytest.mark.slow),
        pytest.param("a.step", b"step", "the mesh cannot be read|has no vertices", marks=pytest.mark.slow),
        ("a", b"a", "the mesh cannot be read|has no vertices"),
    ],
)
@pytest.mark.usefixtures("meshes_in_this_process")
def test_files_without_points_are_refused(tmp_path, name, content, message):
    if name.split(".")[-1] not in ("csv", "npy"):
        pytest.importorskip("trimesh", reason="trimesh is not installed")
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_points(path)
    assert str(path) in str(caught.value)


def test_missing_and_strange_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        read_points(tmp_path / "none.stl")
    with pytest.raises(InputError, match="is a folder"):
        read_points(tmp_path)
    np.save(tmp_path / "objects.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="is no array of numbers"):
        read_points(tmp_path / "objects.npy")
    np.save(tmp_path / "flat.npy", np.ones(6))
    with pytest.raises(InputError, match=r"an array of shape \(6,\)"):
        read_points(tmp_path / "flat.npy")


def test_meshes_need_a_package(tmp_path, monkeypatch):
    (tmp_path / "link.stl").write_bytes(b"solid")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    monkeypatch.setattr("steelyard.collision.mesh_files.coal_or_none", lambda: None)
    with pytest.raises(MissingExtraError, match=r"coal>="):
        read_points(tmp_path / "link.stl")


def test_millimetres_are_noticed(tmp_path):
    np.save(tmp_path / "link.npy", 300 * CUBE)
    with pytest.raises(InputError, match=r"extend over 600 m; give scale=0\.001"):
        CenterOfMassHull.from_mesh("a", tmp_path / "link.npy")
    assert CenterOfMassHull.from_mesh("a", tmp_path / "link.npy", scale=1).points[0] == (-300.0, -300.0, -300.0)


def test_hull_decides_what_moves_alike():
    """A pendulum with l = 1 kg m has Lzz >= l²/m, and its centre of mass at l/m."""
    model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    hull = CenterOfMassHull("link1", 0.5 * CUBE + [0.75, 0, 0])
    assert check(FeasibleSet(model, constraints=[hull]), base=[0.2501, 1.0, 0.0]).feasible is True
    verdict = check(FeasibleSet(model, constraints=[hull]), base=[0.2499, 1.0, 0.0])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()
    assert any("within hull, facet" in name for name, _ in verdict.certificate.blocks)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CenterOfMassHull("a", []), r"rows of three numbers \(m\), got the shape \(0,\)"),
        (lambda: CenterOfMassHull("a", [[1, 2]]), r"got the shape \(1, 2\)"),
        (lambda: CenterOfMassHull("a", "mesh.stl"), "rows of three numbers"),
        (lambda: CenterOfMassHull("a", [[0, 0, np.nan]]), "has a point that is not finite"),
        (lambda: CenterOfMassHull("a", CUBE, tolerance=-1), "at least 0 m"),
    ],
)
def test_impossible_points_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
