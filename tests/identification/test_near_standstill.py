"""Friction near standstill that the model lacks widens intervals by as much as it moves numbers, and noise does not."""

from dataclasses import replace

import numpy as np
import pytest
from two_joint_arm import LINKS, two_joint_model

import steelyard as sy
from steelyard.identification import near_standstill
from steelyard.identification.near_standstill import FALL, SLOW, standstill_errors
from steelyard.regression import ParameterCovariance
from steelyard.regression.reduction import residuals

NOISE = 0.05


@pytest.fixture(scope="module")
def model():
    return two_joint_model()


@pytest.fixture(scope="module")
def truth(model):
    names = {str(name): column for column, name in enumerate(model.parameter_names)}
    values = np.zeros(len(names))
    for columns, link in zip(model.link_columns, LINKS, strict=True):
        values[columns] = link
    for joint in (1, 2):
        for name, value in (("Fv", 0.4), ("Fc", 1.0), ("Fo", 0.1)):
            values[names[f"{name}j{joint}"]] = value
    return values


def samples_of(model, truth, seed, breakaway=0.0, rows=6000, width=0.05):
    """Rows at 250 Hz with white noise, and friction beside the model's that falls off over a part of the velocities."""
    random = np.random.default_rng(seed)
    t = np.arange(rows) / 250.0
    a, b = random.normal(size=(2, 3, 2))
    w = 2.0 * np.pi * np.array([[0.11, 0.13], [0.29, 0.23], [0.53, 0.47]])
    phase = t[:, None, None] * w
    q = np.sum(a * np.sin(phase) + b * np.cos(phase), axis=1)
    dq = np.sum(w * (a * np.cos(phase) - b * np.sin(phase)), axis=1)
    ddq = -np.sum(w**2 * (a * np.sin(phase) + b * np.cos(phase)), axis=1)
    usual = np.sqrt(np.mean(dq**2, axis=0))
    torque = model.inverse_dynamics(q, dq, ddq, truth) + NOISE * random.normal(size=q.shape)
    torque += breakaway * np.sign(dq) * np.exp(-np.abs(dq) / (width * usual))
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t)


def told(model, samples, every=1, base=None):
    info = sy.Information.from_samples(model, samples)
    plain = sy.least_squares(info)
    base = plain.base if base is None else base
    left = np.concatenate([part for _, part in residuals(model, samples, base)])
    pieces = range(0, samples.count, 500 * every)
    stretches = [(samples.rows(k, k + 500), left[k : k + 500]) for k in pieces]
    return info, plain, standstill_errors(model, info, plain, stretches, base)


def widths(model, info, plain, errors):
    covariance = ParameterCovariance.of(info, plain.base, plain.weights)
    known = np.isfinite(plain.standard_error)
    wider = covariance if errors is None else covariance.with_independent_errors(errors)
    return wider.standard_error[known] / np.asarray(plain.standard_error)[known]


def test_the_change_is_that_of_a_fit_without_these_rows(model, truth, monkeypatch):
    """Least squares that read the rows again say the same, whatever parameters the residuals are taken at."""
    samples = samples_of(model, truth, 1, breakaway=0.5)
    found, by_parts = [], near_standstill._without
    monkeypatch.setattr(near_standstill, "_without", lambda *all: found.append(by_parts(*all)) or found[-1])
    info, plain, _ = told(model, samples, base=model.base_parameters().values(1.01 * truth))
    usual = np.sqrt(np.mean(samples.dq**2, axis=0))
    for part, (change, variance) in zip(SLOW, found, strict=True):
        faster = replace(samples, mask=np.abs(samples.dq) >= part * usual)
        kept = sy.Information.from_samples(model, faster)
        again = sy.least_squares(kept, info.joint_weights("joint")).base
        assert change == pytest.approx(again - plain.base, rel=1e-6, abs=1e-9)
        assert np.all(variance >= 0.0)


def test_the_change_is_that_of_a_fit_with_two_more_columns(model, truth, monkeypatch):
    """Least squares of NumPy with these columns beside those of the model say the same."""
    samples = samples_of(model, truth, 1, breakaway=0.5, width=0.3)
    found, by_parts = [], near_standstill._with
    monkeypatch.setattr(near_standstill, "_with", lambda *all: found.append(by_parts(*all)) or found[-1])
    info, plain, errors = told(model, samples, base=model.base_parameters().values(1.01 * truth))
    (change, variance), (first, second) = found[0], info.joint_weights("joint")
    W = np.asarray(model.kernel("regressor", base=True)(samples.q, samples.dq, samples.ddq))
    parts = np.abs(samples.dq) / np.sqrt(np.mean(samples.dq**2, axis=0))
    still = parts < min(SLOW)
    falls = np.where(still | (parts >= near_standstill.FALLEN * FALL), 0.0, np.exp(-((parts / FALL) ** 2)))
    added = np.zeros((samples.count, 2, 4))
    for joint in range(2):
        added[:, joint, 2 * joint : 2 * joint + 2] = np.stack([still, falls], axis=2)[:, joint]
    added *= np.sign(samples.dq)[:, :, None]
    scale = np.array([first, second])
    columns = np.concatenate([W.reshape(samples.count, 2, -1), added], axis=2) * scale[:, None]
    again = np.linalg.lstsq(columns.reshape(2 * samples.count, -1), (samples.torque * scale).ravel(), rcond=None)[0]
    # Beside each other the columns of two joints change a little; here each joint's were added to the model alone.
    assert change == pytest.approx(again[: info.base_count] - plain.base, rel=0.02, abs=2e-3)
    assert np.all(variance > 0.0)
    assert np.all(errors**2 >= (change**2 - variance) * (1.0 - 1e-9))


@pytest.mark.slow
def test_its_variance_is_that_of_many_logs(model, truth, monkeypatch):
    changes, by_parts = [], near_standstill._without
    monkeypatch.setattr(near_standstill, "_without", lambda *all: changes.append(by_parts(*all)) or changes[-1])
    samples, random = samples_of(model, truth, 2), np.random.default_rng(3)
    exact = model.inverse_dynamics(samples.q, samples.dq, samples.ddq, truth)
    for every in (1, 3):
        changes.clear()
        for _ in range(100):
            told(model, replace(samples, torque=exact + NOISE * random.normal(size=exact.shape)), every)
        for level in range(len(SLOW)):
            sizes = np.array([change**2 for change, _ in changes[level :: len(SLOW)]]).mean(axis=0)
            said = np.array([variance for _, variance in changes[level :: len(SLOW)]]).mean(axis=0)
            # Student's width makes what is said a little larger; 100 squares have a standard error of 14 %.
            assert sizes == pytest.approx(said, rel=0.5)


@pytest.mark.slow
def test_a_model_that_is_right_keeps_its_intervals(model, truth):
    for every in (1, 3):
        found = np.array([widths(model, *told(model, samples_of(model, truth, seed), every)) for seed in range(30)])
        assert found.mean() < 1.08
        assert np.median(found) < 1.01


@pytest.mark.slow
@pytest.mark.parametrize("width", [0.05, 0.25])
def test_intervals_hold_the_truth_where_friction_near_standstill_is_another(model, truth, width):
    true_base, coulomb = model.base_parameters().values(truth), []
    for seed in range(40):
        info, plain, errors = told(model, samples_of(model, truth, seed, breakaway=0.3, width=width))
        places = [list(info.base_names).index(f"Fcj{joint}") for joint in (1, 2)]
        halves = 1.96 * np.asarray(plain.standard_error)[places]
        wider = np.hypot(halves, 0.0 if errors is None else 1.96 * errors[places])
        off = np.abs(plain.base - true_base)[places]
        coulomb.append((off <= halves, off <= wider))
    by_noise, with_standstill = np.mean(coulomb, axis=(0, 2))
    assert by_noise < 0.7
    assert with_standstill > 0.9


def test_nothing_is_told_of_joints_that_stand_still_or_rows_without_batch_means(model, truth):
    samples = samples_of(model, truth, 1)
    info = sy.Information.from_samples(model, samples, batch_means=False)
    plain = sy.least_squares(info)
    assert standstill_errors(model, info, plain, [(samples, samples.torque)], plain.base) is None
    still = replace(samples, dq=np.zeros_like(samples.dq))
    info = sy.Information.from_samples(model, samples)
    assert standstill_errors(model, info, plain, [(still, samples.torque)], plain.base) is None
    assert standstill_errors(model, info, plain, [], plain.base) is None


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["fit", "maximum_likelihood", "momentum"])
def test_the_answer_says_so_and_calls_fewer_numbers_measured(model, truth, estimator):
    def answer(breakaway):
        samples = samples_of(model, truth, 5, breakaway)
        return sy.identify(model, samples, estimator=estimator).parameters

    sound, other = answer(0.0), answer(0.5)
    assert not any("hardly move" in sentence for sentence in sound.sentences)
    assert any("Fcj" in sentence and "hardly move" in sentence for sentence in other.sentences)
    for joint in (1, 2):
        row = other[f"Fcj{joint}"]
        assert estimator != "fit" or row.lower <= 1.0 <= row.upper  # whitened rows trust steps of the torque more
        assert row.upper - row.lower > 1.5 * (sound[row.name].upper - sound[row.name].lower)


@pytest.mark.slow
def test_instrumental_variables_say_so_too(model, truth, tmp_path):
    """Their rows are single samples, too; here the motion itself, smooth as it is, is the instrument."""
    (tmp_path / "robot.toml").write_text(
        '[description]\nrows = [["pi/2", 0.0, 0.3, "q"], [0, 0.4, 0, "q"]]\n'
        + "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in ("viscous", "coulomb", "offset"))
        + "[processing]\ncutoff = 20.0\n"
    )
    for breakaway, wider in ((0.0, False), (0.5, True)):
        samples = samples_of(model, truth, 5, breakaway)
        log = {"t": samples.t, "q": samples.q, "tau": samples.torque}
        found = sy.identify(tmp_path / "robot.toml", log, estimator="instrumental_variables").parameters
        assert any("Fcj" in sentence and "hardly move" in sentence for sentence in found.sentences) is wider
