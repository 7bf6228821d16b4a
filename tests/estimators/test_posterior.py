"""Samples of the posterior: against rejection sampling and closed forms, with diagnostics that tell what chains are."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import truncnorm

import steelyard as sy
from steelyard.errors import InputError
from steelyard.estimators import ESTIMATORS, ConstantPullbackPrior, EntropicPrior, bayesian, posterior
from steelyard.estimators.posterior import _Walk, effective_count, split_r_hat
from steelyard.feasibility.constraints import MeasuredMass
from steelyard.regression import ParameterCovariance

BODY = np.array([2.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.1, 0.2, 0.0, 3.0])


def pendulum(friction, noise=0.3, seed=1):
    robot = sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous())
    model = sy.Model(robot)
    random = np.random.default_rng(seed)
    q, dq, ddq = random.normal(size=(3, 200, 1))
    truth = np.append(BODY, friction)
    torque = model.inverse_dynamics(q, dq, ddq, truth) + noise * random.normal(size=(200, 1))
    return model, sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))


def test_what_the_estimator_by_name_does_not_read_is_refused():
    model, info = pendulum(0.5)
    with pytest.raises(InputError, match=r"tells no mass of link1; add the inertials"):
        bayesian(info, sy.FeasibleSet(model))
    for option in ({"prior": None}, {"prior_weight": 3.0}, {"prefer": "lightest"}):
        with pytest.raises(InputError, match="bayesian has a prior of its own; leave out prior"):
            sy.identify(model, "absent.csv", estimator="bayesian", **option)


def test_effective_counts_and_r_hat_are_those_of_known_chains():
    random = np.random.default_rng(0)
    chains = lfilter([np.sqrt(1 - 0.8**2)], [1.0, -0.8], random.normal(size=(4, 21000)), axis=1)[:, 1000:]
    assert effective_count(chains) == pytest.approx(80_000 * 0.2 / 1.8, rel=0.1)
    assert effective_count(random.normal(size=(4, 5000))) == pytest.approx(20_000, rel=0.1)
    assert split_r_hat(chains) < 1.01
    apart = chains + np.array([[0.0], [0.0], [0.0], [1.0]])
    assert split_r_hat(apart) > 1.05
    assert effective_count(apart) < 200
    assert split_r_hat(chains * np.array([[1.0], [1.0], [1.0], [3.0]])) > 1.05  # of the same mean


@pytest.mark.slow
def test_what_physics_cuts_off_is_cut_off_the_normal_distribution():
    # The friction by data alone is normal about a value below zero; what links can be has no say in it.
    model, info = pendulum(-0.01)
    feasible_set = sy.FeasibleSet(model)
    prior = ConstantPullbackPrior(np.append(BODY, 0.0))
    found = posterior(info, feasible_set, prior, 400.0, steps=1000, names=["Fvj1", "m1"])
    plain = sy.least_squares(info)
    place = [str(name) for name in info.base_names].index("Fvj1")
    # The prior moves the other base parameters, which are hardly correlated with it.
    rows = np.linalg.inv(ParameterCovariance.of(info, plain.base, plain.weights).matrix)
    curvature = feasible_set.K.T @ rows @ feasible_set.K
    metric = 400.0 * prior.prepare(feasible_set).curvature().toarray()
    covariance = np.linalg.inv(curvature + metric)
    center = covariance @ (feasible_set.K.T @ rows @ plain.base + metric @ np.append(BODY, 0.0))
    index, size = 10, np.sqrt(covariance[10, 10])
    expected = truncnorm(-center[index] / size, np.inf, center[index], size)
    row = found["Fvj1"]
    assert plain.base[place] < 0.5 * size
    assert row.mean == pytest.approx(expected.mean(), rel=0.08)
    assert row.deviation == pytest.approx(expected.std(), rel=0.1)
    assert row.lower == 0.0
    assert row.upper == pytest.approx(expected.ppf(0.95), rel=0.1)
    assert row.laplace_lower < 0.0
    assert found.converged
    assert found.largest_r_hat < 1.01
    assert all(feasible_set.contains(sample) for sample in found.samples)
    assert feasible_set.contains(found.estimate.parameters)


@pytest.mark.slow
def test_a_chain_that_begins_at_the_boundary_comes_to_the_others(monkeypatch):
    model, info = pendulum(0.5)
    feasible_set = sy.FeasibleSet(model)
    usual = _Walk.starts

    def starts(walk, chains):
        points = usual(walk, chains)
        outside = np.array([2.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.1, 0.2, 0.0, 0.0, 0.5])  # a first moment without mass
        ways = [share * (outside - points[0]) for share in 1.0 - np.geomspace(1e-9, 1.0, 200)]
        points[0] += (1.0 - 1e-3) * next(way for way in ways if feasible_set.contains(points[0] + way))
        return points

    monkeypatch.setattr(_Walk, "starts", starts)
    found = posterior(info, feasible_set, EntropicPrior(np.append(BODY, 0.5)), 11.0, steps=300, names=["m1"])
    assert found.largest_r_hat < 1.03
    assert found.least_effective_count > 200


@pytest.mark.slow
def test_samples_are_those_that_rejection_leaves_where_the_cone_cuts():
    model, info = pendulum(0.05, 3.0)
    feasible_set = sy.FeasibleSet(model)
    reference = np.append(BODY, 0.0)
    prior = ConstantPullbackPrior(reference, term_deviations=np.full(11, 0.2))
    found = posterior(info, feasible_set, prior, 3.0, steps=2000, kept=4000)
    plain = sy.least_squares(info)
    rows = np.linalg.inv(ParameterCovariance.of(info, plain.base, plain.weights).matrix)
    prepared = prior.prepare(feasible_set, 3.0)
    metric = 3.0 * prepared.curvature().toarray()
    covariance = np.linalg.inv(feasible_set.K.T @ rows @ feasible_set.K + metric)
    center = covariance @ (feasible_set.K.T @ rows @ plain.base + metric @ reference)
    drawn = np.random.default_rng(5).multivariate_normal(center, covariance, 15_000, method="eigh")
    kept = drawn[[feasible_set.contains(one) for one in drawn]]
    assert 500 < len(kept) < 10_000  # of Laplace's distribution, a good part is impossible
    assert found.inside == pytest.approx(len(kept) / len(drawn), abs=0.03)
    deviation = kept.std(axis=0)
    assert np.all(np.abs(found.samples.mean(axis=0) - kept.mean(axis=0)) < 0.12 * deviation)
    assert np.allclose(found.samples.std(axis=0), deviation, rtol=0.1)


@pytest.mark.slow
def test_laplace_and_samples_agree_where_the_posterior_is_inside():
    model, info = pendulum(0.5)
    feasible_set = sy.FeasibleSet(model)
    combinations = {f"base {k}": row for k, row in enumerate(feasible_set.K)}
    prior = EntropicPrior(np.append(BODY, 0.5))
    found = posterior(info, feasible_set, prior, 400.0, combinations=combinations, steps=2500, kept=10_000)
    assert found.inside > 0.999
    assert found.converged
    assert max(abs(row.laplace_ratio - 1.0) for row in found) < 0.1


def density(info, feasible_set, reference, weight, stiffness):
    """Minus the logarithm, of the formula: the data's normal distribution, tr(P0⁻¹ P) - log det P, friction's square.

    Of one link and its viscous friction; points are (p, 11). Infinite where the pseudo-inertia is not definite.
    """
    plain = sy.least_squares(info)
    rows = np.linalg.inv(ParameterCovariance.of(info, plain.base, plain.weights).matrix)

    def pseudo(points):
        xx, xy, xz, yy, yz, zz, lx, ly, lz, m = points[:, :10].T
        half = 0.5 * (xx + yy + zz)
        top = [[half - xx, -xy, -xz, lx], [-xy, half - yy, -yz, ly], [-xz, -yz, half - zz, lz], [lx, ly, lz, m]]
        return np.moveaxis(np.array(top), 2, 0)

    inverse = np.linalg.inv(pseudo(reference[None])[0])

    def value(points):
        matrices = pseudo(points)
        left = points @ feasible_set.K.T - plain.base
        values = np.linalg.eigvalsh(matrices)
        inside = (values[:, 0] > 0.0) & (points[:, 10] >= 0.0)
        divergence = np.einsum("ij,pji->p", inverse, matrices) - np.log(np.where(inside[:, None], values, 1.0)).sum(1)
        expected = weight * divergence + 0.5 * stiffness * (points[:, 10] - reference[10]) ** 2
        return np.where(inside, 0.5 * np.einsum("pi,ij,pj->p", left, rows, left) + expected, np.inf)

    return value


def metropolis(value, points, steps, seed=3):
    """Random-walk Metropolis of many chains; half the steps are left out, in which they learn the size of their steps.

    Each chain proposes by the covariance of the others, with which it is not correlated.
    """
    random = np.random.default_rng(seed)
    halves = np.array_split(np.arange(len(points)), 2)
    at, scale, drawn = value(points), 2.38 / np.sqrt(points.shape[1]), []
    for step in range(steps):
        for mine, others in (halves, halves[::-1]):
            root = np.linalg.cholesky(np.cov(points[others].T) + 1e-14 * np.eye(points.shape[1]))
            moved = points[mine] + scale * random.standard_normal((len(mine), points.shape[1])) @ root.T
            there = value(moved)
            taken = np.log(random.random(len(mine))) < at[mine] - there
            points[mine[taken]], at[mine[taken]] = moved[taken], there[taken]
        if step >= steps // 2:
            drawn.append(points.copy())
    return np.concatenate(drawn)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["inside", "boundary"])
def test_intervals_are_those_of_a_random_walk_and_laplace_s_where_the_posterior_is_inside(where):
    """A sampler and a density that share no code with ours; moments of the link are compared in their deviations."""
    # Friction that the description tells is weighted as the link is; of a spread about zero it is so once.
    friction, stiffness = (0.5, 100.0 / 0.5**2) if where == "inside" else (-0.01, 1.0 / 0.5**2)
    model, info = pendulum(friction)
    feasible_set = sy.FeasibleSet(model)
    reference = np.append(BODY, max(friction, 0.0))
    prior = EntropicPrior(reference, term_deviations=np.full(11, 0.5))
    found = posterior(info, feasible_set, prior, 100.0, steps=2500, kept=10_000)
    random = np.random.default_rng(4)
    starts = found.mode * (1.0 + 0.01 * random.normal(size=(120, 11)))
    starts[:, 10] += 0.01 * random.random(120)
    drawn = metropolis(density(info, feasible_set, reference, 100.0, stiffness), starts, 2500)
    deviation = drawn.std(axis=0)
    assert np.all(np.abs(found.samples.mean(axis=0) - drawn.mean(axis=0)) < 0.1 * deviation)
    named = [row for row in found if row.name in model.parameter_names]
    assert len(named) == 11
    for row in named:
        own = drawn[:, list(model.parameter_names).index(row.name)]
        width = np.diff(np.quantile(own, (0.025, 0.975)))[0]
        if row.name != "Fvj1" or where == "inside":
            assert row.upper - row.lower == pytest.approx(width, rel=0.1), row.name
            assert abs(row.lower - np.quantile(own, 0.025)) < 0.1 * width, row.name
            assert row.laplace_ratio == pytest.approx(1.0, abs=0.1), row.name
        else:
            # Pressed against zero: the shortest interval begins there, and Laplace's reaches where nothing can be.
            assert row.lower == 0.0
            assert row.upper == pytest.approx(np.quantile(own, 0.95), rel=0.1)
            assert row.laplace_lower < 0.0
            assert row.laplace_ratio > 1.3


@pytest.mark.slow
def test_equations_hold_and_the_estimator_has_a_name():
    model, info = pendulum(0.5)
    feasible_set = sy.FeasibleSet(model, constraints=[MeasuredMass(3.0)])
    prior = EntropicPrior(np.append(BODY, 0.5))
    found = posterior(info, feasible_set, prior, 100.0, steps=100, names=["m1"])
    assert np.allclose(found.samples[:, 9], 3.0, rtol=0, atol=1e-12)
    estimate = bayesian(info, feasible_set, prior=prior, steps=60)
    assert (estimate.method, ESTIMATORS.get("bayesian")) == ("mean of the posterior", bayesian)
    assert feasible_set.contains(estimate.parameters)
    assert "independent, R-hat at most" in estimate.remarks[-1]


@pytest.mark.slow
@pytest.mark.parametrize("consistency", ["full", "inertia"])
def test_the_description_is_the_prior_of_the_estimator_by_name(tmp_path, consistency):
    inertia = '<inertia ixx="1.9" ixy="0" ixz="0" iyy="1.9" iyz="0" izz="1.9"/>'
    (tmp_path / "arm.urdf").write_text(
        f'<robot name="arm"><link name="base"/><link name="a"><inertial><mass value="3"/>{inertia}</inertial></link>'
        '<joint name="j" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint></robot>'
    )
    model = sy.Model(sy.Robot.from_urdf(tmp_path / "arm.urdf").with_terms(sy.Viscous()))
    q, dq, ddq = np.random.default_rng(2).normal(size=(3, 200, 1))
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=2.0 * ddq + 0.5 * dq + 0.1 * np.sin(40.0 * q))
    feasible_set = sy.FeasibleSet(model, consistency)
    estimate = bayesian(sy.Information.from_samples(model, samples), feasible_set, steps=60)
    assert feasible_set.contains(estimate.parameters)
    assert estimate.remarks[-1].endswith("links are expected to be right to 30%.")


def test_a_posterior_without_finite_mass_is_refused():
    model, info = pendulum(0.5)
    with pytest.raises(InputError, match="no posterior exists without a prior"):
        posterior(info, sy.FeasibleSet(model))
    with pytest.raises(InputError, match="steps"):
        posterior(info, sy.FeasibleSet(model), EntropicPrior(np.append(BODY, 0.5)), steps=1)
