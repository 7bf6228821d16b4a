"""Instrumental variables and output error through identify: what [controller] tells, and what it lacks."""

from dataclasses import replace

import numpy as np
import polars
import pytest

import steelyard as sy
from steelyard.control import ClosedLoop, JointFeedback
from steelyard.errors import InputError, SolverError
from steelyard.feasibility import verify_document
from steelyard.identification.known_controller import ControllerSettings
from steelyard.recording import LogColumns

ROBOT = """
[[terms]]
kind = "viscous"
[description]
rows = [["pi/2", 0, 0, "q"]]
gravity = [0, 0, 0]
[processing]
cutoff = 60.0
velocity_threshold = "none"
"""
LAW = "kp = 400.0\nkd = 40.0\n"


def wave(t):
    return [1 - np.cos(2 * t)], [2 * np.sin(2 * t)], [4 * np.cos(2 * t)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A log of a rotor of 0.5 kg m² with viscous friction of 0.8 at 500 Hz, with 0.1 mrad of noise in the positions.

    The torque of a sample is the mean of those that act before and after it.
    """
    place = tmp_path_factory.mktemp("controlled")
    (place / "description.toml").write_text(ROBOT)
    model = sy.Model.load(place / "description.toml")
    t = np.arange(0.0, 6.0, 0.002)
    controller = JointFeedback(wave, kp=400.0, kd=40.0, count=1, sample_time=0.002)
    truth = sy.simulate(model, [0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0.8], [0.0], [0.0], 6.0, controller)
    noise = 1e-4 * np.random.default_rng(3).normal(size=len(t))
    torque = truth.torque[: len(t), 0]
    columns = {"t": t, "q1": truth.q[: len(t), 0] + noise, "tau1": torque, "wanted1": wave(t)[0][0]}
    columns["tau1"] = np.concatenate([torque[:1], 0.5 * (torque[1:] + torque[:-1])])
    polars.DataFrame(columns).write_csv(place / "log.csv")
    return place


def identified(folder, controller, estimator):
    path = folder / "robot.toml"
    path.write_text(ROBOT + f"[controller]\n{controller}")
    return sy.identify(path, folder / "log.csv", estimator=estimator, prior=None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "estimator"),
    [
        ('reference = "wanted{}"\n' + LAW, "instrumental_variables"),
        ('reference = "wanted{}"\n' + LAW, "output_error"),
    ],
)
def test_identify_with_a_motion_without_noise(folder, controller, estimator):
    found = identified(folder, controller, estimator)
    truth = np.array([0.5, 0.8])
    measured = replace(found.information, factors=found.information.torque_factors)
    assert abs(sy.least_squares(measured).base[0] / truth[0] - 1.0) > 0.05
    assert np.abs(found.estimate.base / truth - 1.0).max() < 0.01
    assert verify_document(found.estimate.certificate).valid
    assert any("The motion without noise is" in remark for remark in found.remarks)
    assert found.options["estimator"] == estimator
    told = [remark for remark in found.estimate.remarks if "up to 0.0001 rad or m, was simulated, too" in remark]
    assert len(told) == (estimator == "output_error")  # by the fourth differences of the log


def shaken(random, runs, noise, coulomb):
    """Mean positions that noisy encoders read of a rotor with friction, (S,), stepped here with an exact sign."""
    t = np.arange(0.0, 4.0, 0.002)
    wanted, speed = wave(t)[0][0], wave(t)[1][0]
    q, dq, last, read = np.zeros(2 * runs), np.zeros(2 * runs), None, []
    step = 0.002 / 40
    for k in range(len(t)):
        drawn = noise * random.normal(size=runs)
        seen = q + np.concatenate([drawn, -drawn])
        slope = np.zeros(2 * runs) if last is None else (seen - last) / 0.002
        last = seen
        read.append(seen.mean())
        torque = 400.0 * (wanted[k] - seen) + 40.0 * (speed[k] - slope)
        for _ in range(40):
            free = dq + step / 0.5 * (torque - 0.8 * dq)
            dq = np.sign(free) * np.maximum(np.abs(free) - step / 0.5 * coulomb, 0.0)
            q = q + step * dq
    return np.array(read)


@pytest.mark.slow
@pytest.mark.parametrize("coulomb", [0.0, 3.0])
def test_expected_readings_are_the_mean_of_noisy_loops(coulomb):
    robot = sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)).with_terms(sy.Viscous(), sy.Coulomb())
    model, noise = sy.Model(robot), 1e-3
    controller = JointFeedback(wave, kp=400.0, kd=40.0, count=1, sample_time=0.002)
    times = np.arange(0.0, 4.0, 0.002)
    loop = ClosedLoop(model, controller, times, [0.0], position_noise=noise)
    base = np.array([0.5, 0.8, coulomb])
    assert model.base_parameters().names[1:] == ("Fvj1", "Fcj1")
    silent, noisy = loop(base).q[:, 0], loop.expected(base).q[:, 0]
    if not coulomb:
        assert np.abs(noisy - silent).max() < 1e-9  # what a linear loop makes of noise is as often up as down
        return
    random = np.random.default_rng(1)
    truth = shaken(random, 400, noise, coulomb) - shaken(random, 1, 0.0, coulomb)
    assert np.abs(truth).max() > 2e-4
    assert np.std(noisy - silent - truth) < 0.3 * np.std(truth)


def test_output_error_asks_for_the_gains(folder):
    with pytest.raises(InputError, match=r"lacks 'kp'.*reference.*instrumental_variables"):
        identified(folder, 'reference = "wanted{}"', "output_error")


@pytest.mark.slow
def test_stamps_since_1970_change_nothing_and_gaps_are_refused(folder):
    """Every second row, so that a trim of 18 rows is 0.072 s, which such stamps do not hold exactly."""
    path = folder / "since.toml"
    table = f'[controller]\nreference = "wanted{{}}"\nrate = 500.0\n{LAW}'
    path.write_text(ROBOT.replace("cutoff = 60.0", "cutoff = 40.0") + table)
    log = polars.read_csv(folder / "log.csv")[::2]
    found = []
    for begin in (0.0, 1.7e9):
        log.with_columns(t=log["t"] + begin).write_csv(folder / "since.csv")
        found.append(
            sy.identify(path, folder / "since.csv", estimator="instrumental_variables", prior=None).estimate.base
        )
    assert np.allclose(*found, rtol=1e-4)
    polars.concat([log[:1000], log[1200:]]).write_csv(folder / "since.csv")
    with pytest.raises(InputError, match="has a gap too long to be filled, over which no motion without noise"):
        sy.identify(path, folder / "since.csv", estimator="instrumental_variables")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "message"),
    [
        ('reference = "nothing{}"', "no column 'nothing1'.*`reference` in .controller. names"),
        ('reference = "wanted{}"\nkp = [1.0, 2.0]', r"kp has 2 values, but .* has 1 joints"),
        ('reference = "wanted{}"\nkp = 0.0', "a joint has neither `kp` nor `kd`"),
        ('reference = "wanted{}"\nrate = 700.0\n' + LAW, "rate is 700 Hz; it must be a whole multiple"),
    ],
)
def test_what_does_not_fit_the_log_is_told(folder, controller, message):
    with pytest.raises(InputError, match=message):
        identified(folder, controller, "instrumental_variables")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"gain": 1.0}, "'gain' is not known here"),
        ({"kp": -1.0}, "kp.*at least 0"),
        ({"rate": "fast"}, "rate"),
        ({"reference": 3}, "list of column names"),
        ({"reference_velocity": 1}, "true or false"),
    ],
)
def test_settings_are_checked(table, message):
    with pytest.raises(InputError, match=message):
        ControllerSettings.from_dict(table)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"start": [0.0, 0.0]}, "start must be a number, or one for each of 1 joints"),
        ({"start": np.nan}, "start must be finite"),
        ({"start_velocity": [1.0, 2.0]}, "start_velocity must be a number, or one for each of 1 joints"),
        ({"velocity_threshold": -1.0}, "velocity_threshold must be at least 0"),
        ({"seed": -1}, "seed must be a whole number of at least 0, got -1"),
        ({"times": [0.0, 0.02, 0.01]}, "at least two finite, increasing numbers"),
    ],
)
def test_a_loop_that_cannot_be_simulated_is_refused_before_it_is(given, told):
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)))
    controller = JointFeedback(lambda t: ([0.0], [0.0], [0.0]), kp=400.0, kd=40.0, count=1)
    with pytest.raises(sy.InputError, match=told):
        ClosedLoop(**{"model": model, "controller": controller, "times": [0.0, 0.01], "start": [-0.1], **given})


@pytest.mark.parametrize("many", [False, True])
def test_a_simulated_robot_that_does_not_move_is_no_fault_of_the_log(many):
    """What a held joint hides may be anything in the first estimate, such as a rotor of 1e15 kg m² that no drive moves.

    Instrumental variables then keep the reference as instruments, which they do for a SolverError.
    """
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)))
    controller = JointFeedback(wave, kp=400.0, kd=40.0, count=1, sample_time=0.002)
    loop = ClosedLoop(
        model,
        controller,
        np.arange(0.0, 3.0, 0.002),
        [0.0],
        process=lambda recording: recording.process(cutoff=40.0, velocity_threshold=None),
        position_noise=1e-5 if many else 0.0,
    )
    assert np.ptp(loop.expected([0.5]).q) > 1.5
    with pytest.raises(SolverError, match="no samples can be made of the simulated motion"):
        loop.expected([1e15])


@pytest.mark.parametrize("table", ['[controller]\nreference = "qd{}"\n', '[drive]\ncommand = ["qd1"]\n'])
def test_columns_that_are_said_to_be_a_reference_are_no_velocities(tmp_path, table):
    """`qd` is the velocity in many logs, and the desired position in others, beside `dq`."""
    (tmp_path / "robot.toml").write_text(ROBOT + 'velocity = "measured"\n' + table)
    t = np.arange(0.0, 6.0, 0.002)
    q, dq, ddq = (np.array(one[0]) for one in wave(t))
    log = {"t": t, "q1": q, "dq1": dq, "tau1": 0.5 * ddq + 0.8 * dq, "qd1": q}
    found = sy.identify(tmp_path / "robot.toml", log)
    assert found.estimate.base == pytest.approx([0.5, 0.8], rel=2e-3)
    (layout,) = found.layouts.values()
    assert layout.velocity == ("dq1",)
    with pytest.raises(InputError, match="several groups of columns for velocity"):
        sy.identify(tmp_path / "robot.toml", log, columns={"unread": []})


def test_patterns_that_are_left_unread_are_checked():
    with pytest.raises(InputError, match="key 'unread', is 3; it must be a list of column names"):
        LogColumns.from_dict({"unread": 3})


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "told"), [(1.0, ""), (1.05, ""), (1.3, "30%"), (0.5, "50%")])
def test_gains_that_are_not_those_of_the_robot_are_told(folder, factor, told):
    """The law is linear in its gains, so that its commands for the motion of the log are off by the same factor."""
    law = f'reference = "wanted{{}}"\nkp = {400.0 * factor}\nkd = {40.0 * factor}\n'
    found = identified(folder, law, "instrumental_variables")
    remarks = [remark for remark in found.remarks if "the law of [controller] commands torques that differ" in remark]
    assert len(remarks) == (1 if told else 0)
    assert all(f"by {told} at joint" in remark for remark in remarks)
