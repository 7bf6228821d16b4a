import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steelyard.errors import InputError
from steelyard.feasibility import EqualLinks, FeasibleSet, LinearBound, MeasuredMass, SymmetricLink, TotalMass

seeds = st.integers(0, 2**32 - 1)


def link_only(model, delta):
    """Parameters of the two links, friction 1."""
    full = np.ones(22)
    full[:10], full[11:21] = delta, delta
    return full


@given(seed=seeds, count=st.integers(4, 12), size=st.floats(0.01, 3.0))
def test_bodies_of_points_are_feasible_under_both(two_links, point_cloud_parameters, seed, count, size):
    rng = np.random.default_rng(seed)
    delta = point_cloud_parameters(rng.uniform(0.1, 2.0, count), size * rng.normal(size=(count, 3)))
    for consistency in ("inertia", "full"):
        assert FeasibleSet(two_links, consistency).contains(link_only(two_links, delta))


@given(seed=seeds)
def test_full_is_the_triangle_inequality_and_inertia_is_positive_moments(two_links, seed):
    """Compared with principal moments about the centre of mass, computed by the parallel axis theorem."""
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    moments = rng.uniform(-0.1, 1.0, 3)
    mass, center = rng.uniform(0.5, 3.0), rng.normal(size=3)
    about_origin = rotation @ np.diag(moments) @ rotation.T
    about_origin = about_origin + mass * (center @ center * np.eye(3) - np.outer(center, center))
    delta = np.concatenate([about_origin[np.triu_indices(3)], mass * center, [mass]])
    low, middle, high = np.sort(moments)
    full = FeasibleSet(two_links, "full").contains(link_only(two_links, delta))
    inertia = FeasibleSet(two_links, "inertia").contains(link_only(two_links, delta))
    assert inertia == (low > 0)
    assert full == (low + middle > high)


def test_two_point_masses_are_on_the_boundary(two_links, point_cloud_parameters):
    rod = point_cloud_parameters(np.ones(2), np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]))
    assert not FeasibleSet(two_links, "inertia").contains(link_only(two_links, rod))


def test_friction_may_be_zero_but_not_negative(two_links, point_cloud_parameters):
    rng = np.random.default_rng(5)
    delta = link_only(two_links, point_cloud_parameters(np.ones(6), rng.normal(size=(6, 3))))
    feasible = FeasibleSet(two_links)
    delta[10] = 0.0
    assert feasible.contains(delta)
    delta[10] = -1e-12
    assert not feasible.contains(delta)
    assert FeasibleSet(two_links, terms=False).contains(delta)


def test_base_dependent_space_is_thesis_3_13(thesis_wam):
    feasible = FeasibleSet(thesis_wam)
    delta = np.random.default_rng(6).normal(size=119)
    dependent = delta[thesis_wam.base_parameters().dependent]
    np.testing.assert_allclose(
        feasible.base_dependent @ np.concatenate([feasible.K @ delta, dependent]), delta, atol=1e-12
    )
    np.testing.assert_allclose(feasible.K @ feasible.unidentifiable, 0.0, atol=1e-12)


def test_equations_are_part_of_the_set(two_links, point_cloud_parameters):
    rng = np.random.default_rng(7)
    delta = link_only(two_links, point_cloud_parameters(np.ones(6), rng.normal(size=(6, 3))))
    assert FeasibleSet(two_links, constraints=[TotalMass(equal=12.0)]).contains(delta)
    assert not FeasibleSet(two_links, constraints=[TotalMass(equal=12.1)]).contains(delta)


def test_equations_hold_to_rounding_of_the_parameters(two_links, point_cloud_parameters):
    """A forearm that is symmetric about xz, but for a product of inertia of 1e-20 that was rounded from others."""
    rng = np.random.default_rng(8)
    half = rng.normal(size=(3, 3))
    link = point_cloud_parameters(np.ones(6), np.vstack([half, half * [1, -1, 1]]))
    feasible = FeasibleSet(two_links, constraints=[SymmetricLink("forearm", plane="xz")])
    for error, inside in ((0.0, True), (1e-20, True), (1e-12, False), (-1e-3, False)):
        delta = link_only(two_links, link)
        delta[[12, 15, 18]] = error  # Lxy2, Lyz2, ly2
        assert feasible.contains(delta) == inside


def test_projection_keeps_base_parameters_where_it_can(two_links):
    """m2 is not identifiable alone, and Lzz1 may take up what it changes; ly2 shows in the motion."""
    rng = np.random.default_rng(9)
    delta = rng.normal(size=22)
    hidden = FeasibleSet(two_links, constraints=[MeasuredMass(2.0, "forearm")])
    moved = hidden.project_on_equations(delta)
    assert moved[20] == 2.0
    np.testing.assert_allclose(hidden.K @ moved, hidden.K @ delta, atol=1e-13)
    shown = FeasibleSet(two_links, constraints=[SymmetricLink("forearm", plane="xz")])
    moved = shown.project_on_equations(delta)
    assert moved[[12, 15, 18]].tolist() == [0.0, 0.0, 0.0]
    np.testing.assert_allclose((shown.K @ moved)[[0, 1, 2, 3, 5]], (shown.K @ delta)[[0, 1, 2, 3, 5]], atol=1e-13)


@given(seed=seeds)
def test_projection_satisfies_all_equations_exactly_where_they_are_zeros(two_links, seed):
    rng = np.random.default_rng(seed)
    feasible = FeasibleSet(
        two_links,
        constraints=[
            EqualLinks("upper arm", "forearm", mirror="xz"),
            SymmetricLink("forearm", axis="x"),
            LinearBound("0.3*m1 + lx2 - 0.7*Lzz1", equal=1.3),
        ],
    )
    moved = feasible.project_on_equations(rng.normal(size=22) * 10.0 ** rng.uniform(-4, 4, 22))
    errors = feasible.equation_matrix @ moved - feasible.equation_values
    np.testing.assert_allclose(errors[:-1], 0.0, atol=0.0)
    assert feasible.satisfies_equations(moved)


def test_what_equations_say_of_base_parameters(two_links):
    """m2 = 2 says nothing of them, ly2 = 0 does, and so does Lzz1 + m2 = 3."""
    feasible = FeasibleSet(
        two_links,
        constraints=[
            MeasuredMass(2.0, "forearm"),
            SymmetricLink("forearm", plane="xz"),
            LinearBound("Lzz1 + m2 + 4*lx2", equal=3.0),
        ],
    )
    matrix, values = feasible.base_equations
    assert matrix.shape == (2, 6)
    for beta, holds in (
        ([3, 1, 1, 0, 0, 1], True),
        ([1, 5, 2, 0.5, 0, 1], True),
        ([3, 1, 1, 0, 0.1, 1], False),
        ([3, 1, 1, 0.1, 0, 1], False),
    ):
        assert np.allclose(matrix @ beta, values, atol=1e-12) == holds
    matrix, values = FeasibleSet(two_links).base_equations
    assert (matrix.shape, values.shape) == ((0, 6), (0,))


def test_prints_what_it_holds(two_links):
    feasible = FeasibleSet(two_links, "inertia", [TotalMass(maximum=9.0)])
    assert repr(feasible) == (
        "FeasibleSet('inertia': 5 blocks (2 of links, 2 of terms, 1 of constraints), 22 parameters, margin 1e-06)"
    )
    assert "total mass &lt;= 9 kg" in feasible._repr_html_()
    exact = FeasibleSet(two_links, constraints=[TotalMass(equal=9.0), SymmetricLink("forearm", plane="xz")])
    assert "(2 of links, 2 of terms), 4 equations, 22 parameters" in repr(exact)
    assert "<td>total mass = 9 kg</td><td>equation</td>" in exact._repr_html_()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"consistency": "ful"}, 'did you mean "full"'),
        ({"margin": 0.0}, "margin must be a positive number"),
        ({"margin": float("nan")}, "margin must be a positive number"),
        ({"constraints": TotalMass(maximum=1.0)}, "constraints must be a list"),
        ({"constraints": [27.0]}, r"objects such as TotalMass\(maximum=27.0\), got 27.0"),
        ({"constraints": [TotalMass(equal=3), TotalMass(equal=4)]}, "contradicts 'total mass = 3 kg'"),
    ],
)
def test_bad_options_are_refused(two_links, options, message):
    with pytest.raises(InputError, match=message):
        FeasibleSet(two_links, **options)


@pytest.mark.parametrize(
    ("base", "message"),
    [
        (np.zeros(5), "the model's 6 base parameters, got an array of shape"),
        ([1, 2, 3, np.nan, 1, 1], "number 4"),
        (["a"] * 6, r"base must be the model's 6 base parameters, got \['a', "),
    ],
)
def test_bad_vectors_are_refused(two_links, base, message):
    with pytest.raises(InputError, match=message):
        FeasibleSet(two_links).as_base(base)
