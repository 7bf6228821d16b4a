"""Symmetric and equal links, against clouds of points that are so."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from steelyard.dynamics import Coulomb, Model, Viscous
from steelyard.errors import InputError
from steelyard.feasibility import EqualLinks, FeasibleSet, SymmetricLink, check, correct
from steelyard.robot import Robot

seeds = st.integers(0, 2**32 - 1)
PLANES = {"yz": 0, "xz": 1, "xy": 2}


def errors(constraint, model, delta):
    return np.array([e.coefficients @ delta[e.indices] - e.value for e in constraint.equalities(model)])


def forearm(link):
    delta = np.zeros(22)
    delta[11:21] = link
    return delta


def reflected(points, normal, through):
    normal = np.asarray(normal) / np.linalg.norm(normal)
    return points - 2 * np.outer((points - through) @ normal, normal)


def turned(points, axis, angle, through):
    """Rodrigues' formula."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    r = points - through
    along = np.outer(r @ axis, axis)
    return through + along + np.cos(angle) * (r - along) + np.sin(angle) * np.cross(axis, r)


def test_plane_of_the_frame_is_three_zeros(two_links):
    names = [e.name for e in SymmetricLink("forearm", plane="xz").equalities(two_links)]
    what = "link 2 (forearm) symmetric about plane xz"
    assert names == [f"{what}: Lxy2 = 0", f"{what}: Lyz2 = 0", f"{what}: ly2 = 0"]


def test_axis_of_the_frame(two_links):
    names = [e.name.split(": ")[1] for e in SymmetricLink("forearm", axis="z").equalities(two_links)]
    assert names == ["Lxx2 - Lyy2 = 0", "Lxy2 = 0", "Lxz2 = 0", "Lyz2 = 0", "lx2 = 0", "ly2 = 0"]
    half = [e.name.split(": ")[1] for e in SymmetricLink("forearm", axis="z", order=2).equalities(two_links)]
    assert half == ["Lxz2 = 0", "Lyz2 = 0", "lx2 = 0", "ly2 = 0"]


def test_two_planes_are_both(two_links):
    both = SymmetricLink("forearm", plane=["xz", "yz"]).equalities(two_links)
    assert [e.name.split(": ")[1] for e in both] == ["Lxy2 = 0", "Lxz2 = 0", "Lyz2 = 0", "lx2 = 0", "ly2 = 0"]
    assert both[0].name.startswith("link 2 (forearm) symmetric about plane xz and symmetric about plane yz")


@given(seed=seeds, named=st.sampled_from([None, "xy", "xz", "yz"]), shifted=st.booleans())
@example(seed=2001178363, named=None, shifted=False)  # a plane 0.5 degrees off parallel to the axis x
@example(seed=2001178363, named=None, shifted=True)
def test_reflected_points_satisfy_a_plane(two_links, point_cloud_parameters, seed, named, shifted):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3) if named is None else np.eye(3)[PLANES[named]]
    through = rng.normal(size=3) if shifted else np.zeros(3)
    half, masses = rng.normal(size=(4, 3)), rng.uniform(0.1, 2.0, 4)
    constraint = SymmetricLink("forearm", plane=normal if named is None else named, through=through)
    points = np.vstack([half, reflected(half, normal, through)])
    link = point_cloud_parameters(np.concatenate([masses, masses]), points)
    found = errors(constraint, two_links, forearm(link))
    assert len(found) == 3
    np.testing.assert_allclose(found, 0.0, atol=1e-10 * (1 + np.abs(link).max()))
    one_sided = point_cloud_parameters(np.concatenate([masses, 1.5 * masses]), points)
    assert np.abs(errors(constraint, two_links, forearm(one_sided))).max() > 1e-6


@given(seed=seeds, order=st.integers(2, 6), shifted=st.booleans())
@example(seed=100000, order=2, shifted=False)  # an axis 0.1 degrees off the plane yz
@example(seed=100000, order=2, shifted=True)
def test_turned_points_satisfy_an_axis(two_links, point_cloud_parameters, seed, order, shifted):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    through = rng.normal(size=3) if shifted else np.zeros(3)
    part, masses = rng.normal(size=(3, 3)), rng.uniform(0.1, 2.0, 3)
    points = np.vstack([turned(part, axis, 2 * np.pi * k / order, through) for k in range(order)])
    link = point_cloud_parameters(np.tile(masses, order), points)
    constraint = SymmetricLink("forearm", axis=axis, order=order, through=through)
    found = errors(constraint, two_links, forearm(link))
    assert len(found) == (4 if order == 2 else 6)
    np.testing.assert_allclose(found, 0.0, atol=1e-10 * (1 + np.abs(link).max()))
    if order == 2:
        full = SymmetricLink("forearm", axis=axis, through=through)
        assert np.abs(errors(full, two_links, forearm(link))).max() > 1e-6


def test_symmetry_that_shows_in_the_motion_decides(two_links):
    """ly2 is a base parameter: a forearm that is symmetric about xz has none."""
    base = np.array([3.0, 0.1, 0.8, 0.3, 0.1, 0.1])
    feasible = FeasibleSet(two_links, constraints=[SymmetricLink("forearm", plane="xz")])
    assert check(FeasibleSet(two_links), base=base).feasible is True
    assert check(feasible, base=base).feasible is False
    nearest = correct(feasible, base=base)
    np.testing.assert_allclose(nearest.base, [3.0, 0.1, 0.8, 0.3, 0.0, 0.1], atol=1e-5)
    assert nearest.squared_distance == pytest.approx(0.01, rel=1e-4)
    assert feasible.contains(nearest.parameters)
    assert check(feasible, base=nearest.base).feasible is True


@given(seed=seeds, kind=st.sampled_from(["same", "mirrored", "placed", "both"]))
def test_equal_bodies_satisfy_the_equations(two_links, point_cloud_parameters, seed, kind):
    rng = np.random.default_rng(seed)
    points, masses = rng.normal(size=(5, 3)), rng.uniform(0.1, 2.0, 5)
    options, other = {}, points
    if kind in ("mirrored", "both"):
        normal = rng.normal(size=3)
        options["mirror"] = normal
        other = reflected(other, normal, np.zeros(3))
    if kind in ("placed", "both"):
        placement = np.eye(4)
        placement[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        placement[:3, 0] *= np.linalg.det(placement[:3, :3])
        placement[:3, 3] = rng.normal(size=3)
        options["placement"] = placement
        other = other @ placement[:3, :3].T + placement[:3, 3]
    delta = np.zeros(22)
    delta[:10] = point_cloud_parameters(masses, points)
    delta[11:21] = point_cloud_parameters(masses, other)
    constraint = EqualLinks("upper arm", "forearm", **options)
    found = errors(constraint, two_links, delta)
    assert len(found) == 10
    np.testing.assert_allclose(found, 0.0, atol=1e-11 * (1 + np.abs(delta).max()))
    delta[11:21] = point_cloud_parameters(1.1 * masses, other)
    assert np.abs(errors(constraint, two_links, delta)).max() > 1e-3


def test_mirrored_limbs_of_the_plane_xz(two_links):
    what = "link 2 (forearm) mirrors link 1 (upper arm)"
    names = [e.name for e in EqualLinks("upper arm", "forearm", mirror="xz").equalities(two_links)]
    assert names[:3] == [f"{what}: -Lxx1 + Lxx2 = 0", f"{what}: Lxy1 + Lxy2 = 0", f"{what}: -Lxz1 + Lxz2 = 0"]
    assert names[7] == f"{what}: ly1 + ly2 = 0"


def test_terms_of_the_joints():
    model = Model(Robot.from_dh([("0", 0.3, 0.0, "q"), ("0", 0.3, 0.0, "q")]).with_terms(Viscous(), Coulomb()))
    found = EqualLinks("link1", "link2", terms=True).equalities(model)
    assert [e.name.split(": ")[1] for e in found[10:]] == ["-Fvj1 + Fvj2 = 0", "-Fcj1 + Fcj2 = 0"]
    assert len(EqualLinks("link1", "link2", terms="Fcj").equalities(model)) == 11
    with pytest.raises(InputError, match=r"asks for equal 'Fv', which the joint of link 1 .* \(it has Fvj, Fcj\)"):
        EqualLinks("link1", "link2", terms=["Fv"]).equalities(model)


def test_equal_links_take_part_in_the_verdict(two_links):
    """With equal links Lzz1 = Lzz2, so m2 = beta1 - beta3 is known, which must be enough for l2."""
    feasible = FeasibleSet(two_links, constraints=[EqualLinks("upper arm", "forearm")])
    # m2 = 0.1 kg, Lzz2 = 0.8 kg m², |l2| = 0.28: l2² = 0.0784 < 0.08.
    assert check(feasible, base=[0.9, 0.1, 0.8, 0.28, 0.0, 0.1]).feasible is True
    verdict = check(feasible, base=[0.9, 0.1, 0.8, 0.29, 0.0, 0.1])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SymmetricLink("a"), "needs a plane or an axis"),
        (lambda: SymmetricLink("a", plane="zz"), "plane of SymmetricLink of link 'a' must be yz, xz, xy"),
        (lambda: SymmetricLink("a", plane=(0, 0, 0)), "must not be zero"),
        (lambda: SymmetricLink("a", plane=(0, 1)), "must be three numbers"),
        (lambda: SymmetricLink("a", plane=[]), "must be three numbers"),
        (lambda: SymmetricLink("a", axis="xy"), "axis of SymmetricLink of link 'a' must be x, y, z or three numbers"),
        (lambda: SymmetricLink("a", axis=3), "axis .* must be three numbers, got 3"),
        (lambda: SymmetricLink("a", plane="xy", order=3), "an order without an axis"),
        (lambda: SymmetricLink("a", axis="x", order=1), "whole number of at least 2, got 1"),
        (lambda: SymmetricLink("a", axis="x", through=(0, 0)), "through of .* must be three numbers"),
        (lambda: EqualLinks("a", "a"), "names one link twice"),
        (lambda: EqualLinks("a", "b", mirror="x"), "mirror of EqualLinks of 'a' and 'b' must be yz"),
        (lambda: EqualLinks("a", "b", placement=np.eye(3)), "a 4 x 4 matrix"),
        (lambda: EqualLinks("a", "b", placement={"rpy": (0, 0, 0), "x": 1}), r"must hold xyz \(m\) and rpy"),
        (lambda: EqualLinks("a", "b", placement=np.diag([1, 1, -1, 1])), "must be a rotation matrix"),
        (lambda: EqualLinks("a", "b", placement=np.ones((4, 4))), "0, 0, 0, 1 as its last row"),
        (lambda: EqualLinks("a", "b", terms=3), "true, false or a list of symbols, got 3"),
    ],
)
def test_what_cannot_be_understood_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_prints_what_was_given():
    assert (
        repr(SymmetricLink("a", axis="z", through=(0, 0, 1))) == "SymmetricLink('a', axis='z', through=(0.0, 0.0, 1.0))"
    )
    assert repr(EqualLinks("a", "b")) == "EqualLinks('a', 'b')"
