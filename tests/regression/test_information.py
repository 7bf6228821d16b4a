"""Information against whole least squares by NumPy; merging in any order and chunking."""

import csv
import inspect
import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import steelyard as sy
from steelyard.identification.wam import TRAJECTORIES
from steelyard.regression import ParameterCovariance


@pytest.fixture(scope="module")
def arm():
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.1, 0, "q")], name="arm")
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia()))


def samples_of(model, count, seed=0, noise=(0.5, 0.2, 0.05), mask=None):
    random = np.random.default_rng(seed)
    q, dq, ddq = random.normal(size=(3, count, model.dof)) * np.array([1.0, 2.0, 5.0])[:, None, None]
    parameters = np.random.default_rng(99).normal(size=model.parameter_count)
    torque = model.inverse_dynamics(q, dq, ddq, parameters) + random.normal(size=q.shape) * noise
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, mask=mask)


def part(samples, rows):
    mask = None if samples.mask is None else samples.mask[rows]
    return sy.Samples(
        q=samples.q[rows], dq=samples.dq[rows], ddq=samples.ddq[rows], torque=samples.torque[rows], mask=mask
    )


def stacked(model, samples):
    """Return the whole base regressor and regressand, joint by joint, as NumPy sees them."""
    base = model.base_parameters()
    H = model.regressor(samples.q, samples.dq, samples.ddq)[:, :, base.independent]
    keep = np.ones(samples.q.shape, dtype=bool) if samples.mask is None else samples.mask
    return [(H[keep[:, k], k], samples.torque[keep[:, k], k]) for k in range(model.dof)]


def gram(factor):
    return factor.triangle.T @ factor.triangle


def test_least_squares_is_numpys(arm):
    samples = samples_of(arm, 500)
    rows = stacked(arm, samples)
    W, omega = np.vstack([w for w, _ in rows]), np.concatenate([t for _, t in rows])
    information = sy.Information.from_samples(arm, samples)
    expected = np.linalg.lstsq(W, omega, rcond=None)[0]
    estimate = sy.least_squares(information, weights=None)
    np.testing.assert_allclose(estimate.base, expected, rtol=1e-9, atol=1e-11)
    residual = omega - W @ expected
    assert estimate.relative_error == pytest.approx(np.linalg.norm(residual) / np.linalg.norm(omega), rel=1e-12)
    assert information.condition_number == pytest.approx(np.linalg.cond(W), rel=1e-9)
    # Thesis equations 4.27 and 4.28, by the normal equations.
    variance = residual @ residual / (len(omega) - W.shape[1])
    deviation = np.sqrt(np.diag(variance * np.linalg.inv(W.T @ W)))
    plain = sy.least_squares(sy.Information.from_samples(arm, samples, batch_means=False), weights=None)
    np.testing.assert_allclose(plain.standard_error, deviation, rtol=1e-8)
    np.testing.assert_allclose(plain.relative_standard_error, deviation / np.abs(expected), rtol=1e-8)
    whole = ParameterCovariance.of_reduced(information.reduced(None))
    np.testing.assert_allclose(whole.matrix, variance * np.linalg.inv(W.T @ W), rtol=1e-7, atol=1e-12)


def test_joint_weights_are_equations_4_30_to_4_36(arm):
    samples = samples_of(arm, 400, seed=3)
    rows = stacked(arm, samples)
    W, omega = np.vstack([w for w, _ in rows]), np.concatenate([t for _, t in rows])
    ols = np.linalg.lstsq(W, omega, rcond=None)[0]
    n = W.shape[1]
    weights = [1 / np.sqrt(np.sum((t - w @ ols) ** 2) / (len(t) - n)) for w, t in rows]
    weighted = np.vstack([g * w for g, (w, _) in zip(weights, rows, strict=True)])
    target = np.concatenate([g * t for g, (_, t) in zip(weights, rows, strict=True)])
    estimate = sy.least_squares(sy.Information.from_samples(arm, samples), "joint")
    np.testing.assert_allclose(estimate.weights, weights, rtol=1e-9)
    np.testing.assert_allclose(estimate.base, np.linalg.lstsq(weighted, target, rcond=None)[0], rtol=1e-8, atol=1e-10)
    errors = [np.linalg.norm(t - w @ estimate.base) / np.linalg.norm(t) for w, t in rows]
    np.testing.assert_allclose(estimate.joint_relative_error, errors, rtol=1e-9)
    explicit = sy.least_squares(sy.Information.from_samples(arm, samples), weights)
    np.testing.assert_allclose(explicit.base, estimate.base, rtol=1e-8, atol=1e-11)


def test_a_joint_of_two_rows_outweighs_no_other():
    """Both are met exactly by parameters of that joint alone, and so say nothing of its noise."""
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")])
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    random = np.random.default_rng(0)
    parameters, t = random.uniform(0.2, 1.0, model.parameter_count), np.arange(3000) / 100
    speeds = random.uniform(1.0, 5.0, (2, 2, 1))
    parts = [sum(np.sin(w * t + k + s * np.pi / 2) * w**s for k, w in enumerate(speeds)).T for s in range(3)]
    exact = model.inverse_dynamics(*parts, parameters)
    mask = np.ones(exact.shape, bool)
    mask[:, 1] = False
    mask[[700, 1900], 1] = True
    noisy = exact + 0.1 * random.standard_normal(exact.shape)
    q, dq, ddq = parts
    info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=noisy, mask=mask))
    weights = info.joint_weights("joint")
    assert weights[0] == pytest.approx(10.0, rel=0.03)
    assert weights[1] < weights[0]
    W = np.asarray(model.kernel("regressor", base=True)(q, dq, ddq)).reshape(len(q), 2, -1)
    error = np.linalg.norm(W[:, 0] @ sy.least_squares(info, "joint").base - exact[:, 0])
    assert error < 1e-3 * np.linalg.norm(exact[:, 0])  # 5e-3 where the two rows were taken for exact


def test_masked_rows_count_for_nothing(arm):
    random = np.random.default_rng(1)
    mask = random.random((300, 3)) > 0.4
    samples = samples_of(arm, 300, mask=mask)
    torque = np.where(mask, samples.torque, 1e6)  # what is masked must not matter
    wild = sy.Samples(q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=torque, mask=mask)
    information = sy.Information.from_samples(arm, wild)
    assert [f.count for f in information.factors] == mask.sum(axis=0).tolist()
    rows = stacked(arm, samples)
    for factor, (W, t) in zip(information.factors, rows, strict=True):
        whole = np.column_stack([W[:, factor.columns], t])
        np.testing.assert_allclose(gram(factor), whole.T @ whole, rtol=1e-10, atol=1e-9)


@settings(max_examples=settings.default.max_examples // 4)
@given(st.lists(st.integers(1, 2999), min_size=1, max_size=6, unique=True), st.randoms(use_true_random=False))
def test_any_chunking_in_any_order_is_the_whole(arm, cuts, shuffler):
    samples = samples_of(arm, 3000)
    whole = sy.Information.from_samples(arm, samples)
    edges = [0, *sorted(cuts), 3000]
    parts = [sy.Information.from_samples(arm, part(samples, slice(a, b))) for a, b in itertools.pairwise(edges)]
    shuffler.shuffle(parts)
    total = parts[0]
    for other in parts[1:]:
        total = total + other
    assert total.count == whole.count
    for ours, theirs in zip(total.factors, whole.factors, strict=True):
        size = np.abs(gram(theirs)).max()
        np.testing.assert_allclose(gram(ours), gram(theirs), atol=1e-12 * size, rtol=0)
    a, b = total.reduced(), whole.reduced()
    np.testing.assert_allclose(a.R, b.R, atol=1e-12 * np.abs(b.R).max(), rtol=0)
    np.testing.assert_allclose(a.rho, b.rho, atol=1e-12 * np.abs(b.rho).max(), rtol=0)
    assert sy.least_squares(total).base == pytest.approx(sy.least_squares(whole).base, rel=1e-9, abs=1e-11)


def test_prediction_on_another_log_needs_no_refit(arm):
    one, other = samples_of(arm, 300, seed=1), samples_of(arm, 200, seed=2)
    estimate = sy.least_squares(sy.Information.from_samples(arm, one))
    rows = stacked(arm, other)
    residual = np.concatenate([t - W @ estimate.base for W, t in rows])
    expected = np.linalg.norm(residual) / np.linalg.norm(other.torque)
    information = sy.Information.from_samples(arm, other)
    assert information.relative_error(estimate.base) == pytest.approx(expected, rel=1e-10)
    rms = [np.sqrt(np.mean((t - W @ estimate.base) ** 2)) for W, t in rows]
    np.testing.assert_allclose(information.joint_rms_error(estimate.base), rms, rtol=1e-9)


def test_poor_excitation_is_named(arm):
    samples = samples_of(arm, 400)
    still = np.zeros_like(samples.q)
    motion = [samples.q.copy(), samples.dq.copy(), samples.ddq.copy()]
    for array in motion:
        array[:, 2] = 0.0  # the third joint never moves
    information = sy.Information.from_samples(
        arm, sy.Samples(q=motion[0], dq=motion[1], ddq=motion[2], torque=still + 1.0)
    )
    named = " ; ".join(information.unidentifiable)
    assert "Fvj3" in named
    assert "Fcj3" in named
    assert "Fvj1" not in named
    assert information.condition_number > 1e12
    estimate = sy.least_squares(information)
    k = estimate.base_names.index("Fvj3")
    assert np.isinf(estimate.standard_error[k])
    assert "does not determine" in estimate.remarks[0]
    assert np.all(np.isfinite(estimate.base))
    healthy = sy.Information.from_samples(arm, samples)
    assert healthy.unidentifiable == ()


def test_save_and_load(arm, tmp_path):
    information = sy.Information.from_samples(arm, samples_of(arm, 100))
    information.save(tmp_path / "information.json")
    loaded = sy.Information.load(tmp_path / "information.json")
    for a, b in zip(loaded.factors, information.factors, strict=True):
        np.testing.assert_array_equal(a.triangle, b.triangle)
        assert (a.joint, a.count, a.columns.tolist()) == (b.joint, b.count, b.columns.tolist())
    assert (loaded + information).count == 2 * information.count
    assert [p.name for p in tmp_path.iterdir()] == ["information.json"]


def test_reference_trajectory_of_the_thesis(wam):
    _, q, dq, ddq = TRAJECTORIES["A"].sample(1000.0)
    parameters = np.random.default_rng(5).normal(size=wam.parameter_count)
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=wam.inverse_dynamics(q, dq, ddq, parameters))
    estimate = sy.least_squares(sy.Information.from_samples(wam, samples))
    truth = wam.base_parameters().K @ parameters
    np.testing.assert_allclose(estimate.base, truth, atol=1e-10 * np.abs(truth).max())


@pytest.mark.parametrize(
    ("content", "phrase"),
    [
        ("", "is not JSON"),
        ("{}", "is not an Information"),
        (json.dumps({"format": "steelyard-estimate-3"}), "expected 'steelyard-information-2'"),
        (None, "cannot be read"),
    ],
)
def test_what_is_no_information_is_refused(tmp_path, content, phrase):
    path = tmp_path / "information.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(sy.InputError) as caught:
        sy.Information.load(path)
    assert phrase in str(caught.value)
    assert str(path) in str(caught.value)


def test_what_does_not_fit_is_refused(arm, wam):
    samples = samples_of(arm, 50)
    with pytest.raises(sy.InputError, match="The samples have 3 joints, but wam has 7"):
        sy.Information.from_samples(wam, samples)
    information = sy.Information.from_samples(arm, samples)
    with pytest.raises(sy.InputError, match="different base parameters"):
        information + sy.Information.empty(wam)
    with pytest.raises(sy.InputError, match="weights must be 3 positive numbers"):
        sy.least_squares(information, [1.0, -1.0, 1.0])
    with pytest.raises(sy.InputError, match="got 'joints'"):
        sy.least_squares(information, "joints")
    with pytest.raises(sy.InputError, match="one number a base parameter"):
        information.relative_error([1.0])
    with pytest.raises(sy.InputError, match=r"needs R of shape \(2, 2\)"):
        sy.Information.from_factor(np.eye(3), [0, 0], 1.0, 10, ["a", "b"])


@pytest.mark.data
def test_the_real_wams_reduced_regression(shared_data):
    """Published least squares, relative error and condition number of the real robot (wam7/README.md)."""
    data = np.load(shared_data / "wam7" / "iros2013_reduced_regression.npz")
    information = sy.Information.from_factor(
        data["R1"],
        data["rho1"],
        float(data["rho2_norm_sqr"]),
        int(data["n_rows"]),
        [str(n) for n in data["base_expressions"]],
    )
    estimate = sy.least_squares(information)
    with (shared_data / "wam7" / "base_parameters_iros2013.csv").open() as file:
        published = [float(row["beta_ols_rerun_fullprec"]) for row in csv.DictReader(file)]
    np.testing.assert_allclose(estimate.base, published, rtol=1e-9)
    assert estimate.relative_error == pytest.approx(0.0561657801, abs=1e-10)
    assert information.condition_number == pytest.approx(48.3946416, abs=1e-6)
    # Joints that are not known apart cannot be weighted: "joint" is ordinary least squares then, as in `fit`.
    assert information.joint_weights("joint").tolist() == [1.0]
    assert estimate.method == "ordinary least squares"
    assert estimate.weights is None


def test_the_default_is_that_of_the_feasible_fit(arm):
    """What is compared must be the same problem: all take "joint" where nothing else is said."""
    random = np.random.default_rng(4)
    samples = samples_of(arm, 400, seed=5)
    noisy = sy.Samples(
        q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=samples.torque + random.normal(size=(400, 3)) * [5, 1, 0.1]
    )
    information = sy.Information.from_samples(arm, noisy)
    plain = sy.least_squares(information)
    np.testing.assert_array_equal(plain.base, sy.least_squares(information, "joint").base)
    assert np.abs(plain.base - sy.least_squares(information, None).base).max() > 1e-3 * np.abs(plain.base).max()
    feasible = sy.fit(information, sy.FeasibleSet(arm))
    np.testing.assert_array_equal(feasible.weights, plain.weights)
    functions = [sy.least_squares, sy.fit, sy.Information.reduced, sy.Information.joint_weights]
    functions.append(ParameterCovariance.of)
    assert {inspect.signature(function).parameters["weights"].default for function in functions} == {"joint"}


def test_weak_parameters_go_by_the_standard_error(arm):
    estimate = sy.least_squares(sy.Information.from_samples(arm, samples_of(arm, 300)))
    size = np.abs(estimate.base)
    wider = replace(estimate, standard_error=2.0 * size)
    assert wider.weak == wider.base_expressions
    assert replace(wider, standard_error=0.6 * size).weak == wider.base_expressions
    assert replace(wider, standard_error=0.4 * size).weak == ()
    assert "200 %" in wider._repr_html_()
