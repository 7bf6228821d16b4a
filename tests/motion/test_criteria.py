"""Criteria against covariances of least squares and condition numbers of whole regressors."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.motion.criterion import Criterion, make_subset
from steelyard.motion.pull_back import RegressorPullBack


@pytest.fixture
def motion(random):
    return tuple(random.normal(size=(3, 60, 3)))


@pytest.fixture
def base_regressor(arm, motion):
    base = arm.base_parameters()
    return arm.regressor(*motion)[:, :, base.independent].reshape(-1, base.count)


@pytest.fixture
def information(arm, motion):
    return RegressorPullBack.exact(arm, *motion, np.ones(3))


def figure(arm, information, kind, subset=None, others="unknown"):
    return Criterion(kind, make_subset(arm, subset, others)).figure(information)


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
    exact = 2.0 * np.log(criterion.figure(information))
    values = [criterion.evaluate(information, sharpness)[0] for sharpness in (1.0, 4.0, 32.0, 1e4)]
    assert values == sorted(values, reverse=True)
    assert values[-1] == pytest.approx(exact, abs=1e-3)
    assert values[-1] >= exact - 1e-12


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda arm: make_subset(arm, "elbow"), "'elbow' is no parameter, link or joint of arm; it has the joints"),
        (lambda arm: make_subset(arm, []), "at least one"),
        (lambda arm: make_subset(arm, "m1"), "m1 has no effect on the torques"),
        (lambda arm: make_subset(arm, None, "half"), "others must be"),
        (lambda arm: Criterion("e", make_subset(arm, None)), "criterion must be one of condition, d, a"),
    ],
)
def test_bad_choices_are_refused(arm, make, message):
    with pytest.raises(sy.InputError, match=message):
        make(arm)
