"""The whole experiment in software: what is put in as the truth comes out of the identification."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.control import ComputedTorque
from steelyard.control.play import play
from steelyard.excitation import QuinticTrajectory
from steelyard.identification.wam import TRAJECTORIES, true_parameters, wam_model
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
    return sy.excitation.FourierTrajectory(a=[[1.0, 0.4]], b=[[0.5, -0.7]], center=[0.2], frequency=0.5)


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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_robot_that_cannot_follow_is_told(pendulum):
    model, delta = pendulum
    impossible = -delta
    with pytest.raises(sy.InputError, match="'joint1' feels is not positive"):
        play(model, impossible, wave())
    with pytest.raises(sy.InputError, match="periods must be positive"):
        play(model, delta, wave(), periods=0.0)
    weak = Actuators(saturation=1.0)
    with pytest.raises(sy.InputError, match=r"joint1 by up to .* saturation of the actuators, joint 'joint1' for 100%"):
        play(model, delta, wave(), actuators=weak)
    log = play(model, delta, wave(), actuators=weak, tolerance=np.inf)
    assert np.abs(log.torque).max() <= 1.0
    assert np.abs(log.q - wave().motion(log.t)[0]).max() > 0.5
    with pytest.raises(sy.InputError, match="tolerance must be above 0"):
        play(model, delta, wave(), tolerance=0.0)
    with pytest.raises(sy.InputError, match=r"rate must be positive, got 0 Hz"):
        play(model, delta, wave(), rate=0)
    two = sy.excitation.FourierTrajectory(a=np.ones((2, 1)), b=np.ones((2, 1)), center=np.zeros(2), frequency=1.0)
    with pytest.raises(sy.InputError, match="moves 2 joints"):
        play(model, delta, two)
    once = QuinticTrajectory.point_to_point([[0.0], [1.0]], [1.0])
    with pytest.raises(sy.InputError, match="does not end as it begins"):
        play(model, delta, once, periods=2)


ENCODERS = Sensors(encoder_resolution=2 * np.pi / 65536, torque_noise=0.1)


def frictionless(file):
    """A robot of a URDF without friction, and the same in Pinocchio."""
    oracle = pytest.importorskip("pinocchio_oracle", reason="Pinocchio (the oracle) is not installed")
    path = next((p for p in oracle.URDFS if p.name == file), None)
    if path is None:
        pytest.skip(f"example-robot-data with {file} is not installed")
    robot = sy.Robot.from_urdf(path)
    links = np.array([name[0] in "Llm" for name in sy.Model(robot).parameter_names])
    return sy.Model(robot), np.where(links, robot.parameters, 0.0), oracle.Oracle(path, robot)


def lively(count, seed=0):
    random = np.random.default_rng(seed)
    a, b = random.uniform(-0.8, 0.8, (2, count, 3))
    return sy.excitation.FourierTrajectory(a=a, b=b, center=random.uniform(-0.5, 0.5, count), frequency=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("file", ["panda.urdf", "talos_left_arm.urdf", "xarm7.urdf"])
@pytest.mark.parametrize(("rate", "sensors"), [(1000.0, None), (1000.0, ENCODERS), (200.0, None), (200.0, ENCODERS)])
def test_arms_without_friction_follow(file, rate, sensors):
    """Nothing but the controller damps them; their links weigh a thousand times more at the base than at the wrist."""
    model, delta, oracle = frictionless(file)
    motion = lively(model.dof)
    log = play(model, delta, motion, rate=rate, sensors=sensors)
    assert np.abs(log.q - motion.motion(log.t)[0]).max() < 0.02
    if sensors is None:
        ideal = motion.motion(log.t[::50])
        needed = np.array([oracle.torque(*row) for row in zip(*ideal, strict=True)])
        assert np.abs(log.torque[::50] - needed).max() < 0.1 * np.abs(needed).max()
        information = sy.Information.from_samples(
            model, sy.Samples(q=log.q, dq=log.velocity, ddq=log.acceleration, torque=log.torque)
        )
        # Torques of another motion, since base parameters take rounded placements of a URDF as they are.
        found = sy.least_squares(information).base
        other = [np.ascontiguousarray(x[::50]) for x in lively(model.dof, seed=1).motion(log.t)]
        expected = np.array([oracle.torque(*row) for row in zip(*other, strict=True)])
        predicted = model.kernel("inverse_dynamics", base=True)(*other, found).reshape(expected.shape)
        assert np.abs(predicted - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("file", ["panda.urdf", pytest.param("talos_left_arm.urdf", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("rate", "exact"), [pytest.param(500.0, True, marks=pytest.mark.slow), (500.0, False), (200.0, False)]
)
def test_the_default_controller_holds_the_robot_of_pinocchio(file, rate, exact):
    """The same controller on a plant of its own: Pinocchio's inverse dynamics solved for the accelerations."""
    from importlib import import_module

    from steelyard.control import FilteredDifference, MeasuredVelocity, TrajectoryReference
    from steelyard.simulation import Measurement

    model, delta, oracle = frictionless(file)
    motion = lively(model.dof)
    reference = TrajectoryReference(motion, sample_time=1.0 / rate)
    velocity = MeasuredVelocity() if exact else FilteredDifference(30.0)
    default = import_module("steelyard.control.play")._default_controller
    controller, frequency = default(model, delta, delta, reference, False, 1.0 / rate, velocity)
    assert frequency > 10.0
    q, dq, _ = reference.at(0.0)
    dq = dq + 0.1  # something to be taken away
    step = 0.25 / rate
    for k in range(round(0.4 * rate)):
        seen = Measurement(t=k / rate, q=q.copy(), dq=dq.copy())
        if k == 0:
            controller.start(seen)
        torque = controller.torque(seen)
        for _ in range(4):
            free = torque - oracle.torque(q, dq, 0.0 * q)
            dq = dq + step * np.linalg.solve(oracle.inertia_matrix(q), free)
            q = q + step * dq
    assert np.abs(q - reference.at(0.4)[0]).max() < 0.02


@pytest.mark.slow
def test_a_rate_that_is_too_low_is_the_cause_that_is_told():
    model, delta, _ = frictionless("panda.urdf")
    with pytest.raises(sy.InputError, match=r"control loop of 10 Hz .* natural frequency of no more than") as found:
        play(model, delta, lively(model.dof), rate=10.0, sensors=ENCODERS)
    assert "parameters" not in str(found.value)
    with pytest.raises(sy.InputError, match=r"believed to be 0.01 to 0.01 times the true one"):
        play(model, delta, lively(model.dof), nominal=0.01 * delta)
