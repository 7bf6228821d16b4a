"""Delays that are planted in torques of known motions come out, whatever friction does, and sound torques have none."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import steelyard as sy
from steelyard.recording.diagnosis.late_torques import late_torques
from steelyard.regression.reduction import residuals

RATE = 250.0
T = np.arange(0.0, 40.0, 1.0 / RATE)
FREQUENCIES = 2.0 * np.pi * np.array([0.1, 0.23, 0.41, 0.7])


def motion(t):
    random = np.random.default_rng(4)
    a, b = random.normal(size=(2, 3, 4)) / np.arange(1, 5)
    sine, cosine = np.sin(np.outer(t, FREQUENCIES)), np.cos(np.outer(t, FREQUENCIES))
    return (
        sine @ a.T + cosine @ b.T,
        (cosine * FREQUENCIES) @ a.T - (sine * FREQUENCIES) @ b.T,
        -(sine * FREQUENCIES**2) @ a.T - (cosine * FREQUENCIES**2) @ b.T,
    )


@pytest.fixture(scope="module")
def model():
    rows = [("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.1, 0, "q")]
    return sy.Model(sy.Robot.from_dh(rows).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))


def samples(model, delays, seed=0, stribeck=0.0, noise=0.1):
    """Rows of the arm, with friction near rest that the model lacks, and noise that lasts for 20 ms."""
    random = np.random.default_rng(seed)
    parameters = np.zeros(model.parameter_count)
    for columns in model.link_columns:
        body = sy.Inertia.from_com(mass=3.0, com=[0.1, -0.05, 0.08], about_com=np.diag([0.03, 0.04, 0.05]))
        parameters[columns] = body.parameters
    for place, name in enumerate(map(str, model.parameter_names)):
        if name.startswith(("Fv", "Fc")):
            parameters[place] = 0.4
    torque = np.empty((len(T), 3))
    for k, delay in enumerate(np.broadcast_to(delays, 3)):
        q, dq, ddq = motion(T - delay)
        torque[:, k] = model.inverse_dynamics(q, dq, ddq, parameters)[:, k]
        torque[:, k] += stribeck * np.sign(dq[:, k]) * np.exp(-np.abs(dq[:, k]) / 0.05)
    white = random.normal(size=torque.shape)
    torque += noise * lfilter([np.sqrt(1.0 - 0.82**2)], [1.0, -0.82], white, axis=0)
    q, dq, ddq = motion(T)
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=T)


def told(model, rows):
    """As after an identification of the rows themselves, in two stretches."""
    base = sy.least_squares(sy.Information.from_samples(model, rows)).base
    predicted = rows.torque - np.concatenate([part for _, part in residuals(model, rows, base)])
    half = rows.count // 2
    parts = [slice(0, half), slice(half, rows.count)]
    return late_torques(model, [(rows.rows(part.start, part.stop), predicted[part]) for part in parts])


@pytest.mark.parametrize("delay", [-0.008, 0.0, 0.001, 0.004, 0.015])
@pytest.mark.parametrize("stribeck", [0.0, 0.1])
def test_the_delay_of_all_joints_comes_out(model, delay, stribeck):
    found = told(model, samples(model, delay, stribeck=stribeck))
    assert abs(found.delay - delay) < 3.0 * found.standard_deviation
    assert found.standard_deviation < 1.2e-3
    if abs(delay) >= 0.008:
        np.testing.assert_allclose(found.told, found.delay)
    if abs(delay) <= 0.001:
        assert not found.told.any()


@pytest.mark.slow
def test_deviations_are_as_large_as_the_errors_are(model):
    pulls = [
        (found.delay - 0.005) / found.standard_deviation
        for found in (told(model, samples(model, 0.005, seed)) for seed in range(20))
    ]
    assert 0.4 < np.sqrt(np.mean(np.square(pulls))) < 1.5


def test_one_joint_that_is_late_by_itself_is_told(model):
    found = told(model, samples(model, [0.0, 0.012, 0.0]))
    assert found.told[1] == pytest.approx(0.012, abs=0.002)
    assert not found.told[[0, 2]].any()


@pytest.mark.parametrize("delay", [-0.1, 0.06, 0.09])
def test_one_joint_that_is_late_by_far_is_told(model, delay):
    found = told(model, samples(model, [0.0, delay, 0.0], stribeck=0.1))
    assert found.told[1] == pytest.approx(delay, abs=0.004)
    assert found.explained.tolist() == [False, True, False]
    assert not found.told[[0, 2]].any()


@pytest.mark.parametrize("lacking", [(sy.Coulomb(), sy.Offset()), (sy.Viscous(), sy.Offset()), ()])
def test_what_a_model_lacks_of_a_drive_is_no_delay_of_one_joint(model, lacking):
    """Viscous friction that is missing moves the torque of a weight as a delay does."""
    less = sy.Model(replace(model.robot, terms=()).with_terms(*lacking))
    found = told(less, samples(model, 0.0, stribeck=0.3))
    assert not found.explained.any()


def test_too_few_rows_tell_nothing(model):
    rows = samples(model, 0.01)
    assert late_torques(model, [(rows.rows(0, 200), rows.torque[:200])]) is None
    assert late_torques(model, []) is None
