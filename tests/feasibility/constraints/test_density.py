"""Bodies within boxes and ellipsoids, against clouds of points and meshes."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import CenterOfMassBox, DensityInBox, DensityInEllipsoid, FeasibleSet, TotalMass, check
from steelyard.robot import Inertia, Robot
from steelyard.robot.inertia import moment_row, pseudo_inertia, transformation

seeds = st.integers(0, 2**32 - 1)


def smallest(constraint, model, link):
    """Least eigenvalue of all blocks, for the ten parameters of the second link."""
    delta = np.zeros(22)
    delta[11:21] = link
    return min(block.smallest_eigenvalue(delta) for block in constraint.blocks(model))


def scalars(constraint, model, link):
    delta = np.zeros(22)
    delta[11:21] = link
    return np.array([float(b.evaluate(delta)[0, 0]) for b in constraint.blocks(model) if b.size == 1])


def random_rotation(rng):
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return rotation * np.sign(np.linalg.det(rotation))


def test_pseudo_inertia_is_that_of_the_model(two_links):
    link = np.random.default_rng(1).normal(size=10)
    delta = np.zeros(22)
    delta[11:21] = link
    condition = two_links.conditions("full")[1]
    np.testing.assert_allclose(
        pseudo_inertia(link), np.tensordot(delta[condition.indices], condition.coefficients, axes=1), atol=1e-15
    )


@given(seed=seeds)
def test_moments_are_integrals_of_quadratic_functions(point_cloud_parameters, seed):
    rng = np.random.default_rng(seed)
    masses, points = rng.uniform(0.1, 2.0, 7), rng.normal(size=(7, 3))
    quadratic = rng.normal(size=(4, 4))
    quadratic += quadratic.T
    there = np.column_stack([points, np.ones(7)])
    expected = masses @ np.einsum("ki,ij,kj->k", there, quadratic, there)
    assert moment_row(quadratic) @ point_cloud_parameters(masses, points) == pytest.approx(expected)


@given(seed=seeds)
def test_moved_bodies_have_the_parameters_of_moved_points(point_cloud_parameters, seed):
    rng = np.random.default_rng(seed)
    masses, points = rng.uniform(0.1, 2.0, 5), rng.normal(size=(5, 3))
    placement = np.eye(4)
    placement[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]  # with or without a reflection
    placement[:3, 3] = rng.normal(size=3)
    moved = points @ placement[:3, :3].T + placement[:3, 3]
    np.testing.assert_allclose(
        transformation(placement) @ point_cloud_parameters(masses, points),
        point_cloud_parameters(masses, moved),
        atol=1e-12,
    )


@given(seed=seeds, count=st.integers(1, 9))
def test_bodies_within_a_box_satisfy_it(two_links, point_cloud_parameters, seed, count):
    rng = np.random.default_rng(seed)
    lower = rng.normal(size=3)
    upper = lower + rng.uniform(0.05, 2.0, 3)
    points = rng.uniform(lower, upper, (count, 3))
    points[0] = np.where(rng.integers(2, size=3), lower, upper)  # a corner
    link = point_cloud_parameters(rng.uniform(0.1, 2.0, count), points)
    assert smallest(DensityInBox("forearm", lower, upper), two_links, link) > -1e-13 * np.abs(link).max() * 10


@given(seed=seeds)
def test_points_beside_a_box_are_refused(two_links, point_cloud_parameters, seed):
    rng = np.random.default_rng(seed)
    lower, upper = np.array([-0.1, -0.2, 0.0]), np.array([0.1, 0.2, 0.7])
    points = rng.uniform(lower, upper, (1, 3))
    axis = rng.integers(3)
    points[0, axis] = upper[axis] + 1e-3 if rng.integers(2) else lower[axis] - 1e-3
    link = point_cloud_parameters(np.array([2.0]), points)
    assert smallest(DensityInBox("forearm", lower, upper), two_links, link) < -1e-5


def test_point_on_a_face_is_on_the_boundary(two_links, point_cloud_parameters):
    box = DensityInBox("forearm", (-0.1, -0.2, 0.0), (0.1, 0.2, 0.7))
    link = point_cloud_parameters(np.array([2.0]), np.array([[0.1, 0.05, 0.3]]))
    found = scalars(box, two_links, link)
    assert found.min() == pytest.approx(0.0, abs=1e-15)
    assert np.sum(np.abs(found) < 1e-15) == 5  # the five products with that face


def test_box_tells_more_than_the_centre_of_mass(two_links):
    """A body of 1 kg between -0.1 and 0.1 m, whose moment of inertia is that of a ball of radius 0.25 m."""
    ball = 0.4 * 0.25**2
    link = np.array([ball, 0, 0, ball, 0, ball, 0, 0, 0, 1.0])
    corners = ((-0.1,) * 3, (0.1,) * 3)
    delta = np.zeros(22)
    delta[11:21] = link
    assert all(b.smallest_eigenvalue(delta) > 0 for b in CenterOfMassBox("forearm", *corners).blocks(two_links))
    assert smallest(DensityInBox("forearm", *corners), two_links, link) < 0


@given(seed=seeds)
def test_box_implies_the_box_of_the_centre_of_mass(two_links, seed):
    """For moments of no particular body: whatever satisfies the density's conditions."""
    rng = np.random.default_rng(seed)
    lower, upper = np.array([-0.3, 0.1, -0.2]), np.array([0.2, 0.4, 0.6])
    center, mass = rng.uniform(-1, 1, 3), rng.uniform(0.1, 3.0)
    spread = rng.normal(size=(3, 3)) * rng.uniform(0, 0.3)
    second = spread @ spread.T + mass * np.outer(center, center)
    about_origin = np.trace(second) * np.eye(3) - second
    link = np.concatenate([about_origin[np.triu_indices(3)], mass * center, [mass]])
    if smallest(DensityInBox("forearm", lower, upper), two_links, link) >= 0:
        assert np.all((center >= lower) & (center <= upper))
    if np.any((center < lower) | (center > upper)):
        assert smallest(DensityInBox("forearm", lower, upper), two_links, link) < 0


def largest_within(quadratic, lower, upper):
    """Largest value of a quadratic function in a box: over its inside, faces, edges and corners."""
    best = -np.inf
    for side in product((None, lower, upper), repeat=3):
        free = [k for k in range(3) if side[k] is None]
        place = np.array([0.0 if corner is None else corner[k] for k, corner in enumerate(side)])
        if free:
            slope = quadratic[free, :3] @ place + quadratic[free, 3]
            place[free] = np.linalg.solve(quadratic[np.ix_(free, free)], -slope)
        if np.all((place >= lower) & (place <= upper)):
            point = np.append(place, 1.0)
            best = max(best, point @ quadratic @ point)
    return best


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.slow) for k in range(2, 6))])
def test_largest_moment_in_a_box(two_links, seed):
    """The conditions let no moment pass beyond what a point in the box has; CVXPY finds the largest."""
    cvxpy = pytest.importorskip("cvxpy", reason="CVXPY is not installed")
    rng = np.random.default_rng(seed)
    lower, upper = np.array([-0.5, 0.0, 0.25]), np.array([0.5, 0.75, 1.0])
    quadratic = rng.normal(size=(4, 4))
    quadratic += quadratic.T
    link = cvxpy.Variable(10)
    limits = [link[9] == 1.0]
    for block in DensityInBox("forearm", lower, upper).blocks(two_links):
        parts = zip(block.indices - 11, block.coefficients, strict=True)
        limits.append(sum(link[k] * matrix for k, matrix in parts) >> 0)
    problem = cvxpy.Problem(cvxpy.Maximize(moment_row(quadratic) @ link), limits)
    problem.solve(solver=cvxpy.CLARABEL)
    assert problem.value == pytest.approx(largest_within(quadratic, lower, upper), abs=1e-6)


@given(seed=seeds, count=st.integers(1, 9))
def test_bodies_within_an_ellipsoid_satisfy_it(two_links, point_cloud_parameters, seed, count):
    rng = np.random.default_rng(seed)
    center, axes, rotation = rng.normal(size=3), rng.uniform(0.05, 1.0, 3), random_rotation(rng)
    ball = rng.normal(size=(count, 3))
    ball *= rng.uniform(0, 1, (count, 1)) ** (1 / 3) / np.linalg.norm(ball, axis=1, keepdims=True)
    ball[0] /= np.linalg.norm(ball[0])  # on the surface
    points = center + (ball * axes) @ rotation.T
    masses = rng.uniform(0.1, 2.0, count)
    ellipsoid = DensityInEllipsoid("forearm", center, axes, rotation)
    assert smallest(ellipsoid, two_links, point_cloud_parameters(masses, points)) > -1e-11
    # All of them on the surface: the trace is zero; further out it is negative.
    shell = ball / np.linalg.norm(ball, axis=1, keepdims=True)
    for factor in (1.0, 1.01):
        link = point_cloud_parameters(masses, center + factor * (shell * axes) @ rotation.T)
        (value,) = scalars(ellipsoid, two_links, link)
        assert value == pytest.approx((1 - factor**2) * masses.sum(), abs=1e-9)


def test_rotation_may_be_roll_pitch_and_yaw():
    turned = DensityInEllipsoid("a", (0, 0, 0), (0.1, 0.2, 0.3), (0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(np.diag(turned.quadratic), [-25.0, -100.0, -1 / 0.09, 1.0])
    assert DensityInEllipsoid("a", (0, 0, 0), 0.5).semi_axes == (0.5, 0.5, 0.5)


def test_meshes_are_within_their_bounds(two_links):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    rng = np.random.default_rng(2)
    for _ in range(5):
        mesh = trimesh.convex.convex_hull(rng.normal(size=(30, 3)) * [0.05, 0.1, 0.3] + rng.normal(size=3))
        inertia = Inertia.from_com(float(mesh.mass), mesh.center_mass, mesh.moment_inertia)
        lower, upper = mesh.bounds
        assert smallest(DensityInBox("forearm", lower, upper), two_links, inertia.parameters) > 0
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        around = DensityInEllipsoid("forearm", middle, half * 3**0.5)
        assert smallest(around, two_links, inertia.parameters) > 0
        # Moments beyond the box: the same shape, 2.5 times as large about its centre.
        grown = Inertia.from_com(float(mesh.mass), mesh.center_mass, 2.5**2 * mesh.moment_inertia)
        assert smallest(DensityInBox("forearm", lower, upper), two_links, grown.parameters) < 0


def test_bodies_of_mujoco_are_within_their_bounds(two_links):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    text = """<mujoco><worldbody><body>
      <geom type="capsule" fromto="0 0 0  0.1 0.2 0.3" size="0.04"/>
      <geom type="ellipsoid" pos="0.1 0.2 0.3" size="0.1 0.05 0.08"/>
    </body></worldbody></mujoco>"""
    body = mujoco.MjModel.from_xml_string(text)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, body.body_iquat[1])
    axes = rotation.reshape(3, 3)
    about_com = axes @ np.diag(body.body_inertia[1]) @ axes.T
    inertia = Inertia.from_com(float(body.body_mass[1]), body.body_ipos[1], about_com)
    box = DensityInBox("forearm", (-0.04, -0.04, -0.04), (0.2, 0.25, 0.38))
    assert smallest(box, two_links, inertia.parameters) > 0


@pytest.mark.parametrize(
    ("moment", "status"),
    [(0.476, "infeasible"), (0.4765, "feasible"), (1.0499, "feasible"), (1.0501, "infeasible")],
)
def test_moment_of_inertia_between_bounds_worked_out_by_hand(moment, status):
    """l = 1 kg m, at most 2.1 kg within x, y = -0.5 to 0.5 m: 1/2.1 <= Lzz <= 2.1 (0.25 + 0.25) kg m²."""
    model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    for consistency in ("full", "inertia"):
        box = DensityInBox("link1", (-0.5, -0.5, -0.2), (0.5, 0.5, 0.2))
        feasible = FeasibleSet(model, consistency, [box, TotalMass(maximum=2.1)])
        verdict = check(feasible, base=[moment, 1.0, 0.0])
        assert verdict.status == status
        assert verdict.certificate.verify()


def test_positive_density_is_added_once(two_links):
    box = DensityInBox("forearm", (-1, -1, -1), (1, 1, 1))
    ellipsoid = DensityInEllipsoid("forearm", (0, 0, 0), 2.0)
    full = [b.size for b in FeasibleSet(two_links, "full", [box, ellipsoid]).blocks if b.size > 1]
    inertia = [b.size for b in FeasibleSet(two_links, "inertia", [box, ellipsoid]).blocks if b.size > 1]
    assert full == [4, 4]
    assert inertia == [6, 6, 4]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DensityInBox("a", (0, 0, 0), (1, 0, 1)), "lower y .* must be below upper y, got 0 and 0 m"),
        (lambda: DensityInBox("a", (0, 0, -np.inf), (1, 1, 1)), "lower of DensityInBox of link 'a' must be three num"),
        (lambda: DensityInBox("a", (0, 0, 0), "xyz"), "upper of DensityInBox of link 'a' must be three numbers"),
        (lambda: DensityInEllipsoid("a", (0, 0, 0), 0.0), "must be positive"),
        (lambda: DensityInEllipsoid("a", (0, 0, 0), (1, 2)), "semi_axes of DensityInEllipsoid of link 'a' must be thr"),
        (lambda: DensityInEllipsoid("a", (0, 0, 0), 1, np.diag([1, 1, -1])), "must be a rotation matrix"),
        (lambda: DensityInEllipsoid("a", (0, 0, 0), 1, 2 * np.eye(3)), "must be a rotation matrix"),
        (lambda: DensityInEllipsoid("a", (0, 0, 0), 1, "z"), "roll, pitch and yaw"),
    ],
)
def test_impossible_shapes_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
