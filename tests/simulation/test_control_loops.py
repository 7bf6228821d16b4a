"""Controllers, sensors, actuators and stopping conditions in the loop."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.excitation import FourierTrajectory
from steelyard.simulation import Actuators, Measurement, Sensors, StoppingConditions, simulate


class Script:
    """Commands what a table says, and keeps what it was told."""

    def __init__(self, sample_time, commands):
        self.sample_time, self.commands = sample_time, np.asarray(commands, dtype=float)

    def start(self, measurement):
        self.seen, self.started = [], measurement

    def torque(self, measurement):
        self.seen.append(measurement)
        return self.commands[min(len(self.seen), len(self.commands)) - 1]


@pytest.fixture(scope="module")
def slide():
    """A free mass of 2 kg."""
    model = sy.Model(sy.Robot.from_dh([(0, 0, "q", 0)], name="slide", gravity=(0, 0, 0)))
    delta = np.zeros(10)
    delta[9] = 2.0
    return model, delta


@pytest.mark.parametrize("method", ["runge_kutta_4", "rosenbrock", "dormand_prince", "dop853", "radau"])
def test_torques_are_held_between_the_calls(slide, method):
    """A force of 2, -2, 0 N for 0.1 s each: exactly parabolas."""
    model, delta = slide
    controller = Script(0.1, [[2.0], [-2.0], [0.0]])
    result = simulate(model, delta, [0.0], [0.0], 0.35, controller, method=method)
    np.testing.assert_allclose(result.t, [0.0, 0.1, 0.2, 0.3, 0.35])
    np.testing.assert_allclose(result.q[:, 0], [0.0, 0.005, 0.01, 0.01, 0.01], atol=1e-10)
    np.testing.assert_allclose(result.dq[:, 0], [0.0, 0.1, 0.0, 0.0, 0.0], atol=1e-10)
    np.testing.assert_allclose(result.torque[:, 0], [2.0, -2.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(result.ddq[:, 0], [1.0, -1.0, 0.0, 0.0, 0.0])
    assert [m.t for m in controller.seen] == list(result.t)
    assert controller.started is controller.seen[0]
    assert controller.seen[0].q.shape == (1,)
    np.testing.assert_allclose(controller.seen[2].torque, [-2.0])


def test_samples_may_be_fewer_than_calls(slide):
    model, delta = slide
    every = simulate(model, delta, [0.0], [0.0], 1.0, Script(0.01, [[1.0], [-3.0], [2.0]]))
    some = simulate(model, delta, [0.0], [0.0], 1.0, Script(0.01, [[1.0], [-3.0], [2.0]]), rate=20.0)
    np.testing.assert_array_equal(some.q, every.q[::5])
    with pytest.raises(InputError, match="divided by a whole number, got 30 Hz"):
        simulate(model, delta, [0.0], [0.0], 1.0, Script(0.01, [[1.0]]), rate=30.0)


def test_encoders_round_and_velocities_are_differences(slide):
    model, delta = slide
    controller = Script(0.01, [[0.0]])
    simulate(model, delta, [0.0], [1.0], 0.5, controller, sensors=Sensors(encoder_resolution=0.003))
    q = np.array([m.q[0] for m in controller.seen])
    dq = np.array([m.dq[0] for m in controller.seen])
    t = np.array([m.t for m in controller.seen])
    np.testing.assert_allclose(q, np.round(t / 0.003) * 0.003, atol=1e-12)
    assert dq[0] == 1.0  # as if the sensors had been on before
    np.testing.assert_allclose(dq[1:], np.diff(q) / 0.01, atol=1e-9)
    simulate(model, delta, [0.0], [1.0], 0.1, controller, sensors=Sensors(velocity="none"))
    assert all(m.dq is None for m in controller.seen)


def test_sampled_sensors_hold_their_last_value(slide):
    model, delta = slide
    controller = Script(0.01, [[0.0]])
    simulate(model, delta, [0.0], [1.0], 0.2, controller, sensors=Sensors(rate=25.0))
    q = np.array([m.q[0] for m in controller.seen])
    np.testing.assert_allclose(q[:9], [0.0, 0, 0, 0, 0.04, 0.04, 0.04, 0.04, 0.08], atol=1e-12)
    np.testing.assert_allclose(controller.seen[9].dq, [1.0], atol=1e-9)


def test_the_torque_channel_lags(slide):
    model, delta = slide
    commands = np.random.default_rng(0).normal(size=(101, 1))
    result = simulate(model, delta, [0.0], [0.0], 1.0, Script(0.01, commands), sensors=Sensors(torque_delay=0.03))
    np.testing.assert_array_equal(result.measured.torque[3:], result.torque[:-3])
    np.testing.assert_array_equal(result.recording().torque, result.measured.torque)


@pytest.mark.slow
def test_noise_has_the_deviation_and_memory_it_should(slide):
    model, delta = slide
    for constant in (0.0, 0.02):
        sensors = Sensors(torque_noise=0.3, torque_time_constant=constant)
        result = simulate(model, delta, [0.0], [0.0], 100.0, Script(0.01, [[1.0]]), sensors=sensors)
        noise = result.measured.torque[:, 0] - 1.0
        assert abs(noise.std() / 0.3 - 1) < 0.03
        correlation = np.corrcoef(noise[1:], noise[:-1])[0, 1]
        assert abs(correlation - (np.exp(-0.5) if constant else 0.0)) < 0.03


def test_the_same_seed_gives_the_same_bytes(slide):
    model, delta = slide

    def torques(seed, own=None):
        sensors = Sensors(torque_noise=0.3, torque_time_constant=0.02, seed=own)
        return simulate(
            model, delta, [0.0], [0.0], 0.2, Script(0.01, [[1.0]]), sensors=sensors, seed=seed
        ).measured.torque.tobytes()

    assert torques(1) == torques(1)
    assert torques(1) != torques(2)
    assert torques(1, own=5) == torques(2, own=5)


def test_sensors_without_a_controller_only_look(pendulum):
    model, delta = pendulum
    result = simulate(model, delta, [1.0], [0.0], 1.0, sensors=Sensors(encoder_resolution=0.01, torque_noise=0.1))
    assert np.abs(result.measured.q - result.q).max() <= 0.005 + 1e-12
    assert len(np.unique(result.measured.q)) < 300
    assert abs(result.measured.torque.std() - 0.1) < 0.01
    assert not result.torque.any()


def test_drives_saturate_slew_and_quantise(slide):
    model, delta = slide
    commands = [[1.0], [9.0], [-9.0], [0.3]]

    def torques(**options):
        return simulate(model, delta, [0.0], [0.0], 0.03, Script(0.01, commands), actuators=Actuators(**options)).torque

    np.testing.assert_allclose(torques(saturation=4.0)[:, 0], [1.0, 4.0, -4.0, 0.3])
    np.testing.assert_allclose(torques(rate_limit=200.0)[:, 0], [1.0, 3.0, 1.0, 0.3])
    quantised = torques(torque_constant=2.0, current_range=3.5, current_bits=4)[:, 0]  # 7 levels of 1 N a side
    np.testing.assert_allclose(quantised, [1.0, 7.0, -7.0, 0.0])


@pytest.mark.parametrize(
    ("conditions", "words", "time"),
    [
        ({"velocity": 0.505}, "stopped at 0.51 s: joint 'joint1' moves at 0.51, the limit is 0.505", 0.51),
        ({"upper": 0.0799}, "joint 'joint1' is at 0.08, allowed are -inf to 0.0799", 0.4),
    ],
)
def test_the_stopping_conditions_name_joint_and_limit(slide, conditions, words, time):
    model, delta = slide
    name = model.robot.joint_names[0]
    result = simulate(
        model, delta, [0.0], [0.0], 1.0, Script(0.01, [[2.0]]), stopping_conditions=StoppingConditions(**conditions)
    )
    assert result.status == "stopped"
    assert words.replace("joint1", name) in result.message
    assert abs(result.end_time - time) < 1e-9
    assert result.t[-1] == result.end_time


def test_the_stopping_conditions_watch_the_reference(slide):
    model, delta = slide
    reference = FourierTrajectory(a=[[0.0]], b=[[0.0]], center=[0.0], frequency=1.0)
    result = simulate(
        model,
        delta,
        [0.0],
        [0.0],
        1.0,
        Script(0.01, [[2.0]]),
        stopping_conditions=StoppingConditions(tracking=0.1, reference=reference),
    )
    assert "away from its reference, the limit is 0.1" in result.message
    assert abs(result.end_time - 0.45) < 1e-9  # t² / 2 > 0.1
    with pytest.raises(InputError, match="tracking of StoppingConditions needs reference"):
        StoppingConditions(tracking=0.1)


def test_a_range_of_other_joints_is_refused(slide):
    model, delta = slide
    for side in ("lower", "upper"):
        conditions = StoppingConditions(**{side: [-1.0, 1.0]})
        with pytest.raises(InputError, match=rf"{side} of StoppingConditions must be .* each of 1 joints, got shape"):
            simulate(model, delta, [0.0], [0.0], 1.0, stopping_conditions=conditions)


def test_stopping_conditions_stop_a_robot_whose_motors_are_off(pendulum):
    model, delta = pendulum
    for method in ("dormand_prince", "runge_kutta_4"):
        result = simulate(
            model, delta, [2.0], [0.0], 2.0, method=method, stopping_conditions=StoppingConditions(velocity=3.0)
        )
        assert result.status == "stopped"
        assert np.abs(result.dq[-1, 0]) > 3.0 >= np.abs(result.dq[:-1, 0]).max()


@pytest.mark.slow
def test_a_batch_in_a_loop_is_its_runs(two_links):
    """Positions, parameters and the controller's state all differ from run to run."""
    model, delta = two_links

    class Servo:
        sample_time = 0.002

        def start(self, measurement):
            self.sum = np.zeros_like(measurement.q)

        def torque(self, measurement):
            assert isinstance(measurement, Measurement)
            self.sum = self.sum + measurement.q * self.sample_time
            return -30.0 * measurement.q - 8.0 * measurement.dq - 10.0 * self.sum

    random = np.random.default_rng(3)
    q0, parameters = random.normal(size=(5, 2)), delta * random.uniform(0.8, 1.2, (5, 1))
    for method in ("runge_kutta_4", "dormand_prince"):
        batch = simulate(model, parameters, q0, np.zeros(2), 0.5, Servo(), method=method)
        assert batch.q.shape == (5, 251, 2)
        for k in range(5):
            one = simulate(model, parameters[k], q0[k], np.zeros(2), 0.5, Servo(), method=method)
            np.testing.assert_allclose(batch.run(k).q, one.q, atol=1e-10)
            np.testing.assert_allclose(batch.run(k).energy, one.energy, atol=1e-9)


def test_a_controller_cannot_change_the_motion_by_writing_to_what_it_sees(slide):
    model, delta = slide

    class Vandal:
        sample_time = 0.01

        def start(self, measurement):
            measurement.q[:] = 100.0

        def torque(self, measurement):
            measurement.q[:] = measurement.dq[:] = 100.0
            return np.zeros(1)

    result = simulate(model, delta, [0.0], [1.0], 0.1, Vandal())
    np.testing.assert_allclose(result.q[:, 0], result.t, atol=1e-12)


def test_wrong_controllers_are_refused(slide):
    model, delta = slide
    with pytest.raises(InputError, match=r"torque must return an array of shape \(1,\), got \(2,\)"):
        simulate(model, delta, [0.0], [0.0], 1.0, Script(0.01, [[1.0, 2.0]]))
    with pytest.raises(InputError, match=r"torque must be None .* got int"):
        simulate(model, delta, [0.0], [0.0], 1.0, 5)
    with pytest.raises(InputError, match=r"works at a sample time of 0.01 s, but sample_time is 0.02"):
        simulate(model, delta, [0.0], [0.0], 1.0, Script(0.01, [[1.0]]), sample_time=0.02)
    with pytest.raises(InputError, match="actuators act on torques that are held"):
        simulate(model, delta, [0.0], [0.0], 1.0, lambda t, q, dq: q, actuators=Actuators())
    with pytest.raises(InputError, match="need torque_constant, current_range and current_bits together"):
        Actuators(torque_constant=1.0)
    with pytest.raises(InputError, match="velocity of Sensors must be one of exact, numerical, none, got 'guess'"):
        Sensors(velocity="guess")
    with pytest.raises(InputError, match=r"torque_noise must be a number, or one for each of 1 joints"):
        simulate(model, delta, [0.0], [0.0], 1.0, sensors=Sensors(torque_noise=[1.0, 2.0]))
