"""The whole experiment in software: what is put in as the truth comes out of the identification."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.control import ComputedTorque
from steelyard.laboratory import play
from steelyard.laboratory.wam import TRAJECTORIES, true_parameters, wam_model
from steelyard.motion import QuinticTrajectory
from steelyard.simulation import Actuators, Sensors

SYMBOLS = (
    "Lxx",
    "Lxy",
    "Lxz",
    "Lyy",
    "Lyz",
    "Lzz",
    "lx",
    "ly",
    "lz",
    "m",
    "Fvj",
    "Fcj",
    "Foj",
    "Fvm",
    "Fcm",
    "Fom",
    "Iam",
)


@pytest.fixture(scope="module")
def wam():
    return wam_model()


@pytest.fixture
def pendulum():
    """A point mass of 2 kg at 1 m, with friction, whose parameters are written down by hand."""
    robot = sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous(), sy.Coulomb())
    model = sy.Model(robot)
    delta = np.zeros(model.parameter_count)
    for name, value in (("m1", 2.0), ("Fvj1", 0.3), ("Fcj1", 0.5)):
        delta[model.parameter_names.index(name)] = value
    return model, delta


def wave():
    return sy.FourierTrajectory(a=[[1.0, 0.4]], b=[[0.5, -0.7]], center=[0.2], frequency=0.5)


@pytest.mark.slow
def test_the_wam_is_recovered(wam):
    """Trajectory A, no noise: each base parameter to 1e-6 of the largest of its kind."""
    delta = true_parameters()
    log = play(wam, delta, TRAJECTORIES["A"])
    samples = sy.Samples(q=log.q, dq=log.velocity, ddq=log.acceleration, torque=log.torque)
    information = sy.Information.from_samples(wam, samples)
    estimate = sy.least_squares(information)
    base = wam.base_parameters()
    truth = base.K @ delta
    kinds = np.array([SYMBOLS.index(name.rstrip("0123456789")) for name in base.names])
    for kind in set(kinds):
        same = kinds == kind
        assert np.abs(estimate.base - truth)[same].max() <= 1e-6 * np.abs(truth[same]).max()
    reference = TRAJECTORIES["A"].motion(log.t)[0]
    assert np.abs(log.q - reference)[:, :4].max() < 0.05  # it does follow the trajectory
    assert (log.count, log.rate) == (12500, pytest.approx(1000.0))


def test_torques_are_those_of_the_motion(pendulum):
    """The log of a pendulum against its equation of motion, written by hand."""
    model, delta = pendulum
    log = play(model, delta, wave())
    q, dq, ddq = log.q[:, 0], log.velocity[:, 0], log.acceleration[:, 0]
    expected = 2.0 * ddq + 2.0 * 9.81 * np.cos(q) + 0.3 * dq + 0.5 * np.sign(dq)
    np.testing.assert_allclose(log.torque[:, 0], expected, atol=1e-9)


def test_sensors_are_seeded_and_periods_are_counted(pendulum):
    model, delta = pendulum
    sensors = Sensors(encoder_resolution=1e-3, torque_noise=0.1)
    logs = [play(model, delta, wave(), periods=2, sensors=sensors, seed=seed) for seed in (1, 1, 2)]
    assert logs[0].count == 4000
    np.testing.assert_array_equal(logs[0].torque, logs[1].torque)
    assert np.abs(logs[0].torque - logs[2].torque).max() > 0.1
    np.testing.assert_allclose(logs[0].q / 1e-3, np.round(logs[0].q / 1e-3), atol=1e-6)
    assert logs[0].acceleration is None


def test_a_controller_of_ones_own(pendulum):
    model, delta = pendulum

    def controller(reference):
        return ComputedTorque(model, delta, reference, kp=900.0, kd=60.0)

    log = play(model, delta, wave(), controller=controller)
    assert np.abs(log.q - wave().motion(log.t)[0]).max() < 0.01


def test_a_robot_that_cannot_follow_is_told(pendulum):
    model, delta = pendulum
    impossible = -delta
    with pytest.raises(sy.InputError, match="'joint1' feels is not positive"):
        play(model, impossible, wave())
    with pytest.raises(sy.InputError, match="periods must be positive"):
        play(model, delta, wave(), periods=0.0)
    weak = play(model, delta, wave(), actuators=Actuators(saturation=1.0))
    assert np.abs(weak.torque).max() <= 1.0
    assert np.abs(weak.q - wave().motion(weak.t)[0]).max() > 0.5
    assert any("did not follow the trajectory: joint1 by up to" in remark for remark in weak.remarks)
    with pytest.raises(sy.InputError, match=r"rate must be positive, got 0 Hz"):
        play(model, delta, wave(), rate=0)
    two = sy.FourierTrajectory(a=np.ones((2, 1)), b=np.ones((2, 1)), center=np.zeros(2), frequency=1.0)
    with pytest.raises(sy.InputError, match="moves 2 joints"):
        play(model, delta, two)
    once = QuinticTrajectory.point_to_point([[0.0], [1.0]], [1.0])
    with pytest.raises(sy.InputError, match="does not end as it begins"):
        play(model, delta, once, periods=2)
