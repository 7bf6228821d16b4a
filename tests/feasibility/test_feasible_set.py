import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, TotalMass

seeds = st.integers(0, 2**32 - 1)


def link_only(model, delta):
    """Parameters of the two links, friction 1."""
    full = np.ones(22)
    full[:10], full[11:21] = delta, delta
    return full


@given(seed=seeds, count=st.integers(4, 12), size=st.floats(0.01, 3.0))
@settings(max_examples=60, deadline=None)
def test_bodies_of_points_are_feasible_under_both(two_links, point_cloud_parameters, seed, count, size):
    rng = np.random.default_rng(seed)
    delta = point_cloud_parameters(rng.uniform(0.1, 2.0, count), size * rng.normal(size=(count, 3)))
    for consistency in ("inertia", "full"):
        assert FeasibleSet(two_links, consistency).contains(link_only(two_links, delta))


@given(seed=seeds)
@settings(max_examples=100, deadline=None)
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


def test_prints_what_it_holds(two_links):
    feasible = FeasibleSet(two_links, "inertia", [TotalMass(maximum=9.0)])
    assert repr(feasible) == (
        "FeasibleSet('inertia': 5 blocks (2 of links, 2 of terms, 1 of constraints), 22 parameters, margin 1e-06)"
    )
    assert "total mass &lt;= 9 kg" in feasible._repr_html_()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"consistency": "ful"}, 'did you mean "full"'),
        ({"margin": 0.0}, "margin must be a positive number"),
        ({"margin": float("nan")}, "margin must be a positive number"),
        ({"constraints": TotalMass(maximum=1.0)}, "constraints must be a list"),
    ],
)
def test_bad_options_are_refused(two_links, options, message):
    with pytest.raises(InputError, match=message):
        FeasibleSet(two_links, **options)


@pytest.mark.parametrize(
    ("base", "message"),
    [(np.zeros(5), "the model's 6 base parameters, got an array of shape"), ([1, 2, 3, np.nan, 1, 1], "number 4")],
)
def test_bad_vectors_are_refused(two_links, base, message):
    with pytest.raises(InputError, match=message):
        FeasibleSet(two_links).as_base(base)
