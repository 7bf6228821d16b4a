"""Balances of momentum and energy: Pinocchio's matrices, exact recovery from a simulation by SciPy, masks and noise."""

from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics.algorithms.regressor import momentum_balance_with_numpy
from steelyard.dynamics.layout import ParameterLayout
from steelyard.errors import InputError
from steelyard.estimators import ESTIMATORS, energy, energy_information, momentum, momentum_information
from steelyard.estimators.energy_and_momentum import balance_parts
from steelyard.feasibility import verify_document

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def elbow():
    rows = [("pi/2", 0.0, 0.3, "q"), (0, 0.4, 0, "q")]
    return sy.Model(sy.Robot.from_dh(rows).with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia()))


TRUTH = np.array([0.2, 0.01, 0.02, 0.3, -0.01, 0.2, 0.1, 0.2, -0.1, 2.0, 0.7, 0.5, 0.05] * 2)


@pytest.fixture(scope="module")
def moved(elbow):
    """Samples of a smooth motion whose accelerations are wrong on purpose; torques are those of the right ones."""
    t = np.arange(0.0, 5.0, 0.004)[:, None]
    speeds, sizes = np.array([[2.0, 3.1], [5.3, 4.4]]), np.array([[0.7, 0.9], [0.3, 0.25]])
    q = sum(a * np.sin(w * t + a) for w, a in zip(speeds, sizes, strict=True))
    dq = sum(a * w * np.cos(w * t + a) for w, a in zip(speeds, sizes, strict=True))
    ddq = sum(-a * w**2 * np.sin(w * t + a) for w, a in zip(speeds, sizes, strict=True))
    torque = elbow.inverse_dynamics(q, dq, ddq, TRUTH)
    return sy.Samples(q=q, dq=dq, ddq=np.full_like(q, 1e6), torque=torque, t=t[:, 0])


def test_balances_are_those_of_pinocchio(tmp_path, monkeypatch):
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from estimators import URDF

    path = tmp_path / "elbow.urdf"
    path.write_text(URDF.replace('name="j2" type="revolute"', 'name="j2" type="prismatic"'))
    robot = sy.Robot.from_urdf(path)
    model, parameters = sy.Model(robot.with_terms()), np.array(robot.with_terms().parameters)
    arm = pinocchio.buildModelFromUrdf(str(path))
    data = arm.createData()
    q, dq = np.random.default_rng(2).normal(size=(2, 4, 3))
    kept, flow = (part @ parameters for part in momentum_balance_with_numpy(ParameterLayout(model.robot), q, dq))
    for k in range(4):
        mass = pinocchio.crba(arm, data, q[k])
        mass = np.triu(mass) + np.triu(mass, 1).T
        assert np.allclose(kept[k], mass @ dq[k], rtol=1e-10, atol=1e-10)
        coriolis = pinocchio.computeCoriolisMatrix(arm, data, q[k], dq[k])
        gravity = pinocchio.computeGeneralizedGravity(arm, data, q[k])
        assert np.allclose(flow[k], gravity - coriolis.T @ dq[k], rtol=1e-10, atol=1e-10)


def test_the_truth_comes_out_without_accelerations(monkeypatch):
    """Torques are those of Pinocchio along a smooth motion, with friction added; no accelerations are told."""
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from estimators import COULOMB, URDF, VISCOUS, Laboratory

    laboratory = Laboratory(duration=12.0)
    t = laboratory.times[500::2]  # beyond the polynomial from rest
    q, dq, ddq = laboratory.reference(t)
    arm = pinocchio.buildModelFromXML(URDF)
    data = arm.createData()
    torque = np.array([pinocchio.rnea(arm, data, *one) for one in zip(q, dq, ddq, strict=True)])
    # Without Coulomb friction: sums over samples are no integrals of jumps.
    truth = np.array(laboratory.base)
    truth[[name.startswith("Fc") for name in laboratory.model.base_parameters().expressions]] = 0.0
    samples = sy.Samples(q=q, dq=dq, ddq=np.full_like(q, 1e6), torque=torque + VISCOUS * dq, t=t)
    for information in (momentum_information, energy_information):
        found = sy.least_squares(information(laboratory.model, samples)).base
        assert np.allclose(found, truth, rtol=0, atol=1e-6)
    # With it, and rows near standstill left out, they are near; balances of momentum whatever friction does there.
    torque = samples.torque + COULOMB * np.sign(dq)
    jumps = sy.Samples(q=q, dq=dq, ddq=samples.ddq, torque=torque, t=t, mask=np.abs(dq) > 0.1)
    found = sy.least_squares(energy_information(laboratory.model, jumps)).base
    assert np.allclose(found, laboratory.base, rtol=0, atol=2e-2)
    found = sy.least_squares(momentum_information(laboratory.model, jumps)).base
    assert np.allclose(found, laboratory.base, rtol=0, atol=1e-4)
    stuck = np.where(np.abs(dq) > 0.1, torque, samples.torque - COULOMB * dq / 0.1)
    stuck = sy.Samples(q=q, dq=dq, ddq=samples.ddq, torque=stuck, t=t, mask=jumps.mask)
    found = sy.least_squares(momentum_information(laboratory.model, stuck)).base
    assert np.allclose(found, laboratory.base, rtol=0, atol=1e-2)
    assert (
        momentum_information(laboratory.model, jumps).count
        > 0.9 * 3 * momentum_information(laboratory.model, samples).factors[0].count
    )


def test_stretches_are_apart_and_masks_leave_out_windows(elbow, moved):
    halves = [moved.rows(0, 700), moved.rows(700, moved.count)]
    apart = momentum_information(elbow, halves)
    both = momentum_information(elbow, halves[0]) + momentum_information(elbow, halves[1])
    assert apart.count == both.count
    assert np.allclose(sy.least_squares(apart).base, sy.least_squares(both).base)
    wrong = moved.torque.copy()
    wrong[300:310, 0] = 1e3
    mask = np.ones_like(wrong, dtype=bool)
    mask[300:310, 0] = False
    spoiled = sy.Samples(q=moved.q, dq=moved.dq, ddq=moved.ddq, torque=wrong, t=moved.t, mask=mask)
    for make in (momentum_information, energy_information):
        info, clean = make(elbow, spoiled), make(elbow, moved)
        assert info.count < clean.count
        assert np.allclose(sy.least_squares(info).base, sy.least_squares(clean).base, atol=0.05)
    assert momentum_information(elbow, spoiled).factors[1].count == momentum_information(elbow, moved).factors[1].count


def test_what_torques_do_near_standstill_is_taken_out(elbow, moved):
    """Any polynomial of second order over a passage, however large, changes nothing; over one that is used it does."""
    slow = np.abs(moved.dq) < 0.2
    random = np.random.default_rng(1)
    torque = moved.torque.copy()
    for joint in range(2):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], slow[:, joint].astype(int), [0]])))
        for first, last in edges.reshape(-1, 2):
            s = np.linspace(-1.0, 1.0, last - first)
            torque[first:last, joint] += 100.0 * np.polyval(random.normal(size=3), s)
    both = [
        sy.Samples(q=moved.q, dq=moved.dq, ddq=moved.ddq, torque=one, t=moved.t, mask=~slow)
        for one in (moved.torque, torque)
    ]
    clean, spoiled = (sy.least_squares(momentum_information(elbow, one)).base for one in both)
    assert np.allclose(spoiled, clean, rtol=0, atol=1e-6)
    used = sy.Samples(q=moved.q, dq=moved.dq, ddq=moved.ddq, torque=torque, t=moved.t)
    assert np.abs(sy.least_squares(momentum_information(elbow, used)).base - clean).max() > 0.1


def test_noise_that_a_controller_turns_into_torques_adds_no_power(elbow, moved):
    """The product of both noises is 2.5 W on average, as much as half of the friction."""
    noise = 0.05 * np.random.default_rng(1).normal(size=moved.q.shape)
    noisy = sy.Samples(q=moved.q, dq=moved.dq + noise, ddq=moved.ddq, torque=moved.torque - 1e3 * noise, t=moved.t)
    assert -np.mean(np.sum(noise * (noisy.torque - moved.torque), axis=1)) > 4.0
    estimate = sy.least_squares(energy_information(elbow, noisy))
    off = (estimate.base - elbow.base_parameters().values(TRUTH)) / estimate.standard_error
    assert np.abs(off).max() < 3.0


def test_answers_are_proved_and_what_cannot_be_balanced_is_refused(elbow, moved):
    feasible_set = sy.FeasibleSet(elbow)
    for estimator, information in ((momentum, momentum_information), (energy, energy_information)):
        assert ESTIMATORS.get(estimator.__name__) is estimator
        estimate = estimator(information(elbow, moved), feasible_set)
        assert verify_document(estimate.certificate).valid
        assert any("averaged over windows of 0.2 s" in remark for remark in estimate.remarks)
        assert estimate.method == f"feasible balance of {estimator.__name__}"
        halves = [information(elbow, moved.rows(*part)) for part in ((0, 700), (700, moved.count))]
        assert estimator(halves[0] + halves[1], feasible_set).method == estimate.method
        with pytest.raises(InputError, match=f"{estimator.__name__} needs rows of balances"):
            estimator(sy.Information.from_samples(elbow, moved), feasible_set)
    untimed = sy.Samples(q=moved.q, dq=moved.dq, ddq=moved.ddq, torque=moved.torque)
    with pytest.raises(InputError, match="have no times"):
        momentum_information(elbow, untimed)
    with pytest.raises(InputError, match="holds 6 of the samples"):
        momentum_information(elbow, moved, window=0.024)
    seldom = sy.Samples(*(one[::10] for one in (moved.q, moved.dq, moved.ddq, moved.torque)), t=moved.t[::10])
    assert momentum_information(elbow, seldom).count == 2 * (-(-(seldom.count - 16) // 2))  # 16 samples a window
    with pytest.raises(InputError, match=r"lasts 5 s.*momentum_information with a shorter window"):
        momentum_information(elbow, moved, window=9.0)


def test_errors_of_parts_are_those_of_the_rows_as_measured(elbow, moved):
    """Each row stands in one part, and predictions of all estimators are judged alike."""
    noise = np.random.default_rng(1).normal(size=moved.q.shape)
    noisy = sy.Samples(q=moved.q, dq=moved.dq, ddq=noise, torque=moved.torque + noise, t=moved.t)
    plain = sy.Information.from_samples(elbow, noisy)
    base = elbow.base_parameters().values(TRUTH)
    for kept in ("momentum", "energy"):
        whole, parts = balance_parts(kept, elbow, noisy)
        assert len(parts) == 5
        assert np.allclose(whole.joint_relative_error(base), plain.joint_relative_error(base), rtol=1e-9)
        rows = [[factor.count for factor in part.torque_factors] for part in parts]
        assert np.sum(rows, axis=0).tolist() == [moved.count] * 2
        assert sum(part.count for part in parts) == whole.count
        assert not whole.remarks


@pytest.mark.slow
def test_fewer_windows_than_parameters_are_refused(elbow, moved):
    """Rows as measured are enough, but 75 samples hold five windows of two joints."""
    with pytest.raises(InputError, match="leave 10 rows of the estimator for 12"):
        sy.identify(elbow, moved.rows(0, 75), estimator="momentum")


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["momentum", "energy"])
def test_identify_tells_errors_of_samples(elbow, moved, estimator):
    """Windows average noise of the torques out; what the model leaves of samples is that noise and not less."""
    noise = np.random.default_rng(1).normal(size=moved.q.shape)
    acceleration = np.gradient(moved.dq, moved.t, axis=0)
    torque = elbow.inverse_dynamics(moved.q, moved.dq, acceleration, TRUTH) + noise
    samples = sy.Samples(q=moved.q, dq=moved.dq, ddq=acceleration, torque=torque, t=moved.t)
    found = sy.identify(elbow, samples, estimator=estimator)
    assert np.allclose(found.prediction.joint_error, noise.std(axis=0), rtol=0.05)
    assert found.estimate.method == f"feasible balance of {estimator}"
    assert any(f"the estimator's own rows: balance of {estimator} without" in remark for remark in found.remarks)


@pytest.mark.slow
def test_noise_of_encoders_brings_less_bias_than_least_squares(monkeypatch):
    """One log of the benchmark: Pinocchio moves the arm, with 0.1 mrad of noise and no careful filter."""
    pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from estimators import ESTIMATORS as SIDE_BY_SIDE
    from estimators import Laboratory

    laboratory = Laboratory(duration=4.0)
    samples = laboratory.samples(1)
    off = {}
    for name in ("least squares", "balance of momentum", "balance of energy"):
        estimate = SIDE_BY_SIDE[name](laboratory, samples)
        assert verify_document(estimate.certificate).valid
        off[name] = np.abs(estimate.base - laboratory.base)
    assert np.median(off["balance of momentum"] / off["least squares"]) < 0.1
    assert np.median(off["balance of energy"] / off["least squares"]) < 0.3
