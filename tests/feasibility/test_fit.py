import numpy as np
import pytest

from steelyard.dynamics import Coulomb, Model, Viscous
from steelyard.errors import InputError
from steelyard.estimators import ConstantPullbackPrior, EntropicPrior, EuclideanPrior, l_curve
from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet, TotalMass, check, verify_document
from steelyard.recording import Samples
from steelyard.regression import Estimate, Information, least_squares
from steelyard.robot import Inertia, Robot


@pytest.fixture(scope="module")
def arm():
    rows = [("-pi/2", 0.0, 0.3, "q"), ("0", 0.5, 0.0, "q"), ("pi/2", 0.3, 0.0, "q")]
    return Model(Robot.from_dh(rows, name="arm").with_terms(Viscous(), Coulomb()))


@pytest.fixture(scope="module")
def truth(arm, point_cloud_parameters):
    rng = np.random.default_rng(20)
    values = {}
    for link in range(3):
        body = point_cloud_parameters(rng.uniform(0.1, 0.5, 8), 0.15 * rng.normal(size=(8, 3)))
        symbols = "Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m".split()  # noqa: SIM905
        values |= {f"{symbol}{link + 1}": value for symbol, value in zip(symbols, body, strict=True)}
        values |= {f"Fvj{link + 1}": 0.4, f"Fcj{link + 1}": 0.2}
    return np.array([values[name] for name in arm.parameter_names])


def information(arm, truth, noise, count=400):
    rng = np.random.default_rng(21)
    q, dq, ddq = rng.normal(size=(3, count, 3)) * np.array([1.5, 1.5, 4.0])[:, None, None]
    torque = arm.inverse_dynamics(q, dq, ddq, truth) + noise * rng.normal(size=(count, 3)) * [1.0, 0.5, 0.2]
    return Information.from_samples(arm, Samples(q=q, dq=dq, ddq=ddq, torque=torque))


@pytest.mark.parametrize("weights", [pytest.param("joint", marks=pytest.mark.slow), None, [1.0, 2.0, 5.0]])
def test_exact_data_give_the_true_robot_back(arm, truth, weights):
    info = information(arm, truth, 0.0)
    estimate = fit(info, FeasibleSet(arm), weights)
    np.testing.assert_allclose(estimate.base, arm.base_parameters().K @ truth, atol=1e-4)
    assert estimate.relative_error < 1e-5
    np.testing.assert_allclose(estimate.damping, 0.4, atol=1e-4)
    np.testing.assert_allclose(estimate.friction, 0.2, atol=1e-4)


@pytest.mark.parametrize("consistency", ["inertia", "full"])
def test_noisy_data_give_a_feasible_robot(arm, truth, consistency):
    info = information(arm, truth, 3.0)
    feasible = FeasibleSet(arm, consistency)
    assert check(feasible, base=least_squares(info, "joint").base).status == "infeasible"
    estimate = fit(info, feasible)
    assert feasible.contains(estimate.parameters)
    assert estimate.relative_error >= least_squares(info).relative_error
    assert estimate.relative_error < 1.05 * least_squares(info).relative_error
    assert estimate.joint_relative_error.shape == (3,)
    assert np.all(estimate.damping >= 0)


def test_feasible_least_squares_stay_what_they_are(arm, truth):
    info = information(arm, truth, 1e-3)
    plain = least_squares(info, "joint")
    assert check(FeasibleSet(arm), base=plain.base).status == "feasible"
    estimate = fit(info, FeasibleSet(arm))
    assert np.all(np.abs(estimate.base - plain.base) < 0.05 * plain.standard_error)
    np.testing.assert_allclose(estimate.standard_error, plain.standard_error, rtol=1e-4)


def test_estimate_survives_the_disk(arm, truth, tmp_path):
    estimate = fit(information(arm, truth, 3.0), FeasibleSet(arm))
    estimate.save(tmp_path / "estimate.json")
    loaded = Estimate.load(tmp_path / "estimate.json")
    np.testing.assert_array_equal(loaded.parameters, estimate.parameters)
    assert verify_document(loaded.certificate)
    assert loaded.certificate["verdict"] == "feasible"
    assert loaded.remarks == estimate.remarks


def test_data_of_another_model_is_refused(arm, truth):
    other = Model(Robot.from_dh([("0", 0.0, 0.0, "q")]))
    with pytest.raises(InputError, match="belongs to another model"):
        fit(information(arm, truth, 1.0), FeasibleSet(other))


@pytest.mark.parametrize("size", [1e-6, *(pytest.param(size, marks=pytest.mark.slow) for size in (1e-3, 1.0)), 1e4])
def test_light_and_heavy_robots(size):
    """From a milligram a link to tens of tonnes, noise-free data gives the truth back, without being told the mass."""
    model = Model(Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), (0, 0.3, 0, "q")]).with_terms(Viscous()))
    random = np.random.default_rng(4)
    truth = np.zeros(model.parameter_count)
    for columns in model.link_columns:
        spread = random.uniform(0.3, 1.0, 3) * 0.01 * size
        mass, com = random.uniform(0.5, 5.0) * size, 0.1 * random.normal(size=3)
        truth[columns] = Inertia.from_com(mass=mass, com=com, about_com=np.diag(spread.sum() - spread)).parameters
        truth[columns[-1] + 1] = size
    q, dq, ddq = random.normal(size=(3, 300, 3))
    samples = Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, truth))
    estimate = fit(Information.from_samples(model, samples), FeasibleSet(model))
    np.testing.assert_allclose(estimate.base, model.base_parameters().values(truth), rtol=1e-6)


def test_links_of_grams_beside_links_of_kilograms():
    """Noise-free data gives every base parameter of the light links back, too, with one margin for all."""
    model = Model(Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.1, 0.2, "q"), (0, 0.1, 0, "q")]))
    random = np.random.default_rng(5)
    truth = np.zeros(model.parameter_count)
    for columns, mass, length in zip(model.link_columns, (50.0, 10.0, 1e-3, 5e-4), (0.2, 0.2, 0.02, 0.01), strict=True):
        spread, com = random.uniform(0.3, 1.0, 3) * mass * length**2, length * random.normal(size=3)
        truth[columns] = Inertia.from_com(mass=mass, com=com, about_com=np.diag(spread.sum() - spread)).parameters
    q, dq, ddq = random.normal(size=(3, 300, 4))
    samples = Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, truth))
    estimate = fit(Information.from_samples(model, samples), FeasibleSet(model), weights=None)
    np.testing.assert_allclose(estimate.base, model.base_parameters().values(truth), rtol=1e-5)


def test_kinds_of_least_squares_are_named(arm, truth):
    rng = np.random.default_rng(22)
    q, dq, ddq = rng.normal(size=(3, 300, 3))
    noise = rng.multivariate_normal(np.zeros(3), [[4.0, 1.5, 0.0], [1.5, 1.0, 0.3], [0.0, 0.3, 0.5]], size=300)
    samples = Samples(q=q, dq=dq, ddq=ddq, torque=arm.inverse_dynamics(q, dq, ddq, truth) + noise)
    covariance = [[4.0, 1.5, 0.0], [1.5, 1.0, 0.3], [0.0, 0.3, 0.5]]
    info = Information.from_samples(arm, samples, covariance)
    estimate = fit(info, FeasibleSet(arm))
    assert estimate.method == "feasible generalised least squares"
    assert estimate.weights is None
    # Errors are told in torques, joint by joint, though the rows are mixed.
    predicted = arm.inverse_dynamics(q, dq, ddq, estimate.parameters)
    error = np.linalg.norm(predicted - samples.torque, axis=0) / np.linalg.norm(samples.torque, axis=0)
    np.testing.assert_allclose(estimate.joint_relative_error, error, rtol=1e-6)
    assert (
        fit(Information.from_samples(arm, samples), FeasibleSet(arm)).method == "feasible joint-weighted least squares"
    )


@pytest.mark.slow
def test_prior_weight_from_the_corner(arm, truth):
    info, feasible = information(arm, truth, 3.0), FeasibleSet(arm)
    known = ConstantPullbackPrior(truth)
    curve = l_curve(info, feasible, known)
    estimate = fit(info, feasible, prior=known, prior_weight="corner")
    np.testing.assert_allclose(estimate.parameters, curve.parameters[curve.corner_index], rtol=1e-5, atol=1e-6)
    assert any(f"with a weight of {curve.corner:.4g}" in remark for remark in estimate.remarks)


@pytest.mark.slow
def test_a_strong_prior_is_the_answer(arm, truth):
    feasible = FeasibleSet(arm)
    other = np.where(truth == 0.4, 0.5, truth) * 1.1
    estimate = fit(information(arm, truth, 3.0), feasible, prior=EntropicPrior(other), prior_weight=1e9)
    np.testing.assert_allclose(estimate.parameters, other, rtol=1e-3, atol=1e-4)


def test_bad_weights_of_priors_are_refused(arm, truth):
    info, feasible = information(arm, truth, 1.0), FeasibleSet(arm)
    with pytest.raises(InputError, match="needs a prior; got 'corner'"):
        fit(info, feasible, prior_weight="corner")
    with pytest.raises(InputError, match='a number or "corner"'):
        fit(info, feasible, prior=EuclideanPrior(truth), prior_weight="knee")
    with pytest.raises(InputError, match=r"prior_weight must be a positive number .*leave the prior out.*, got 0"):
        fit(info, feasible, prior=EuclideanPrior(truth), prior_weight=0)
    with pytest.raises(InputError, match="prior must be a prior such as"):
        fit(info, feasible, prior="cad")


def test_every_solver_gives_the_same_fit(arm, truth):
    pytest.importorskip("scs", reason="the solver SCS is not installed")
    info = information(arm, truth, 3.0)
    feasible = FeasibleSet(arm, constraints=[TotalMass(maximum=12.0)])
    expected = fit(info, feasible, prefer=None)
    estimate = fit(info, feasible, prefer=None, solver="scs")
    assert estimate.relative_error == pytest.approx(expected.relative_error, rel=1e-5)
    with pytest.raises(InputError, match="there is no solver 'cvxopt'"):
        fit(info, feasible, solver="cvxopt")


def test_torques_that_are_all_zero_are_refused():
    model = Model(Robot.from_dh([(0, 0.3, 0, "q")]))
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 50, 1))
    information = Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=np.zeros_like(q)))
    with pytest.raises(InputError, match="no usable samples"):
        fit(information, FeasibleSet(model))
