"""Criteria against covariances of least squares and condition numbers of whole regressors."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.excitation.criterion import Criterion, Spectrum, Subset, identifiability, make_subset
from steelyard.excitation.vjp import RegressorInformation


@pytest.fixture
def motion(random):
    return tuple(random.normal(size=(3, 60, 3)))


@pytest.fixture
def base_regressor(arm, motion):
    base = arm.base_parameters()
    return arm.regressor(*motion)[:, :, base.independent].reshape(-1, base.count)


@pytest.fixture
def information(arm, motion):
    return RegressorInformation.exact(arm, *motion, np.ones(3))


def figure(arm, information, kind, subset=None, nuisance="unknown"):
    return Criterion(kind, make_subset(arm, subset, nuisance)).figure(Spectrum.of(information))


def test_all_parameters(arm, base_regressor, information):
    assert figure(arm, information, "condition") == pytest.approx(np.linalg.cond(base_regressor), rel=1e-9)
    covariance = np.linalg.inv(base_regressor.T @ base_regressor)
    assert figure(arm, information, "a") == pytest.approx(np.trace(covariance), rel=1e-9)
    assert figure(arm, information, "d") == pytest.approx(-np.linalg.slogdet(covariance)[1], rel=1e-9)


def test_a_subset_has_the_marginal_covariance_of_least_squares(arm, base_regressor, information):
    base = arm.base_parameters()
    columns = [int(c) for c in arm.link_columns[2]]
    rows = [k for k in range(base.count) if np.abs(base.K[k, columns]).max() > 0]
    assert 0 < len(rows) < base.count
    covariance = np.linalg.inv(base_regressor.T @ base_regressor)[np.ix_(rows, rows)]
    for name in ("link3", "payload"):
        assert figure(arm, information, "a", name) == pytest.approx(np.trace(covariance), rel=1e-9)
        assert figure(arm, information, "d", name) == pytest.approx(-np.linalg.slogdet(covariance)[1], rel=1e-9)
        assert figure(arm, information, "condition", name) ** 2 == pytest.approx(np.linalg.cond(covariance), rel=1e-9)


def test_where_the_others_are_known_the_columns_of_the_subset_remain(arm, motion, information):
    subset = make_subset(arm, "link3", "known")
    chosen = [arm.parameter_names.index(name) for name in subset.names]
    columns = arm.regressor(*motion)[:, :, chosen].reshape(-1, len(chosen))
    whole = arm.regressor(*motion)[:, :, arm.link_columns[2]].reshape(-1, 10)
    assert np.linalg.matrix_rank(columns) == len(chosen) == np.linalg.matrix_rank(whole)
    assert figure(arm, information, "condition", "link3", "known") == pytest.approx(np.linalg.cond(columns), rel=1e-8)


def test_joints_mean_their_terms_and_links_do_not(arm):
    joint, link = make_subset(arm, "joint2", "known"), make_subset(arm, "link2", "known")
    assert {"Fvj2", "Fcj2"} <= set(joint.names)
    assert set(link.names) < set(joint.names)
    assert make_subset(arm, ["Fvj1"], "known").names == ("Fvj1",)


def test_the_objective_bounds_the_condition_number_from_above_and_meets_it(arm, information):
    criterion = Criterion("condition", make_subset(arm, None))
    exact = 2.0 * np.log(criterion.figure(Spectrum.of(information)))
    values = [criterion.evaluate(Spectrum.of(information), sharpness)[0] for sharpness in (1.0, 4.0, 32.0, 1e4)]
    assert values == sorted(values, reverse=True)
    assert values[-1] == pytest.approx(exact, abs=1e-3)
    assert values[-1] >= exact - 1e-12


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda arm: make_subset(arm, "elbow"), "'elbow' is no parameter, link or joint of arm; it has the joints"),
        (lambda arm: make_subset(arm, []), "at least one"),
        (lambda arm: make_subset(arm, "m1"), "m1 has no effect on the torques"),
        (lambda arm: make_subset(arm, None, "half"), "nuisance must be"),
        (lambda arm: Criterion("e", make_subset(arm, None)), "criterion must be one of condition, d, a"),
    ],
)
def test_bad_choices_are_refused(arm, make, message):
    with pytest.raises(sy.InputError, match=message):
        make(arm)


@pytest.fixture
def slow_factor(random):
    """Return a matrix whose singular values are known, and so far apart that its square has lost the least ones."""
    rows, columns = (np.linalg.qr(random.normal(size=(size, 6)))[0] for size in (40, 6))
    return rows * np.geomspace(1e5, 1e-4, 6) @ columns.T


@pytest.mark.parametrize(
    ("kind", "expected"), [("condition", 1e9), ("d", 6 * np.log(10.0)), ("a", 1e8 / (1 - 10**-3.6))]
)
def test_factors_tell_what_squares_have_lost(slow_factor, kind, expected):
    subset = Subset(tuple("abcdef"), np.eye(6), True)
    spectrum = Spectrum.of(slow_factor.T @ slow_factor, lambda: slow_factor)
    assert Criterion(kind, subset).figure(spectrum) == pytest.approx(expected, rel=1e-4)


def test_there_is_a_gradient_where_the_square_has_none(slow_factor, random):
    criterion = Criterion("condition", Subset(tuple("abcdef"), np.eye(6), True))
    step = random.normal(size=slow_factor.shape) * 2e-7

    def value(size):
        moved = slow_factor + size * step
        return 2.0 * np.log(np.linalg.cond(moved))

    spectrum = Spectrum.of(slow_factor.T @ slow_factor, lambda: slow_factor)
    gradient = criterion.evaluate(spectrum, 300.0)[1]
    ours = 2.0 * np.einsum("si,ij,sj->", step, gradient, slow_factor)
    assert ours == pytest.approx((value(1.0) - value(-1.0)) / 2.0, rel=2e-3)


@pytest.mark.parametrize(
    ("subset", "nuisance"),
    [pytest.param(None, "unknown", marks=pytest.mark.slow), ("link3", "unknown"), ("link3", "known")],
)
def test_uncertainty_is_the_spread_of_least_squares(arm, motion, information, base_regressor, random, subset, nuisance):
    """The noise is one percent of the torques of the parameters that cause the largest ones."""
    chosen = make_subset(arm, subset, nuisance)
    found = identifiability(Spectrum.of(information), chosen, len(base_regressor))
    strongest = np.linalg.svd(base_regressor)[2][0]
    noise = 0.01 * np.sqrt(np.mean((base_regressor @ strongest) ** 2))
    if nuisance == "known":
        matrix, own = base_regressor @ chosen.directions, np.eye(len(chosen.names))
    else:
        matrix, own = base_regressor, chosen.directions
    drawn = np.linalg.lstsq(matrix, noise * random.normal(size=(len(matrix), 20_000)), rcond=None)[0]
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(own.T @ drawn)).max())
    assert found.uncertainty == pytest.approx(spread, rel=0.03)
    assert found.unidentifiable == ()
