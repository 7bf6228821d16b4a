"""What is said of real recordings is true by the README beside them, and sound simulated ones have no finding."""

from pathlib import Path

import numpy as np
import pytest
from kr300 import description, log_section

import steelyard as sy
from steelyard.identification import examine
from steelyard.identification.examples import EXAMPLES

ROBOTS = Path(__file__).resolve().parents[2] / "examples"
TERMS = "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in ("viscous", "coulomb", "offset", "rotor_inertia"))


def kinds(examination):
    return [one.kind for one in examination.findings]


# The turret of the UR10 moves so little that noise is half of what it shows.
SHOW_LITTLE = {("ur10", "train.csv"): (["torque noise"], ["torque noise"])}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_the_logs_of_the_examples_are_sound_but_for_joints_that_hardly_move(name, example):
    folder = example(name)
    for log in ("train.csv", "validate.csv"):
        alone, with_robot = SHOW_LITTLE.get((name, log), ([], []))
        assert kinds(examine(folder / log)) == alone
        found = examine(folder / log, folder / "robot.toml")
        assert kinds(found) == with_robot
        if "torque noise" in alone:
            torque = sy.Recording.read(folder / log).torque[:, 0]
            assert np.std(np.diff(torque)) / np.sqrt(2.0) > 0.45 * np.std(torque)
        first = sy.Model.load(folder / "robot.toml").robot.joint_names[0]
        for one in found.findings:
            assert f"joint '{first}'" in one.statement.lower()


@pytest.mark.slow
def test_a_cutoff_that_lets_noise_of_a_lift_through_is_told(example, tmp_path):
    """The lift of the Tiago moves by 0.1 m in 22 s, with steps of 48 µm: of all joints it limits the cutoff."""
    folder = example("tiago")
    text = (folder / "robot.toml").read_text().replace('"robot.urdf"', f'"{folder / "robot.urdf"}"')
    (tmp_path / "robot.toml").write_text(f"{text}\n[processing]\ncutoff = 17.0\n")
    (found,) = examine(folder / "train.csv", tmp_path / "robot.toml").findings
    assert found.kind == "position noise"
    assert "joint 'torso_lift_joint'" in found.statement


@pytest.mark.data
def test_the_ur10_is_sound(shared_data):
    log = shared_data / "ur10_unisa" / "exciting.csv"
    assert kinds(examine(log)) == []
    found = examine(log, ROBOTS / "ur10.toml")
    assert kinds(found) == []
    assert found.facts["rows"].startswith("3441, 27.52 s at 125 Hz")
    assert found.information.condition_number == pytest.approx(133, rel=0.1)


@pytest.mark.data
def test_the_coupled_wrist_of_the_tx40_is_found_and_the_line_mends_it(shared_data, tmp_path):
    """Motor 6 turns with dq5 + dq6; the sampling and the rest of the log are sound (README there)."""
    folder = shared_data / "staubli_tx40"
    robot = tmp_path / "robot.toml"
    robot.write_text(f'[description]\nurdf = "{folder / "tx40_mdh_modified.urdf"}"\n{TERMS}')
    assert kinds(examine(folder / "joint_500hz.csv")) == []
    found = examine(folder / "joint_500hz.csv", robot)
    (one,) = found.findings
    assert one.statement.startswith("The motor of joint_6 looks to turn with joint_6 plus joint_5")
    # Its last body is nearly round, so that the columns of the wrist might be coupled as well.
    assert "Or: joint_6 looks to be coupled with joint_5" in one.statement
    before = sy.identify(robot, folder / "joint_500hz.csv").estimate.relative_error
    robot.write_text(f"{robot.read_text()}\n{found.toml}\n")
    again = examine(folder / "joint_500hz.csv", robot)
    assert "joint_6" not in str(again.findings)
    assert sy.identify(robot, folder / "joint_500hz.csv").estimate.relative_error < 0.85 * before
    # With the right coupling from the motor side nothing is left to find.
    motors = f"{folder / 'raw_q_motor_5khz.csv'}+{folder / 'raw_tau_motor_5khz.csv'}"
    assert kinds(examine(motors, ROBOTS / "staubli_tx40.toml")) == []


@pytest.mark.data
def test_the_runs_of_the_gen3_are_short_and_one_sensor_is_dead(shared_data):
    """Short and poorly exciting, not full rank; in RunTrajectory1 the sensor of joint 1 reads 0 throughout."""
    folder = shared_data / "kinova_gen3"
    found = examine(folder / "RunTrajectory1.csv")
    assert [(one.kind, one.remedy) for one in found.findings] == [
        ("stuck torque", {"processing": {"exclude_joints": [1]}})
    ]
    for name in ("opti_traj_testing1", "opti_traj_testing2"):
        found = examine(folder / f"{name}.csv", folder / "gen3.urdf")
        assert sorted(kinds(found)) == ["excitation", "repeated"]
        raw = np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True)
        heads = [f"{what}{j}" for what in ("q", "tau") for j in range(1, 8)]
        same = np.all([raw[head][1:] == raw[head][:-1] for head in heads], axis=0)
        (statement,) = [one.statement for one in found.findings if one.kind == "repeated"]
        told = int(statement.split(": ")[1].split()[0])
        assert 0 < told <= same.sum()  # those at rest are no copies


@pytest.mark.data
@pytest.mark.parametrize("log", ["A", "B"])
def test_a_single_motion_of_the_kr300_shows_too_little(shared_data, tmp_path, log):
    """One motion alone overfits badly: 49.5 % on the other (README there)."""
    folder = shared_data / "kuka_kr300"
    robot = tmp_path / "robot.toml"
    robot.write_text(description(folder) + TERMS + log_section(folder))
    found = examine(folder / f"{log}.csv", robot)
    (one,) = found.findings
    assert one.kind == "excitation"
    # Rows taken for independent ones would call a tenth of the numbers weak.
    assert " of 58 base parameters are smaller than twice their standard error" in one.statement
    assert found.information.condition_number > 1300


@pytest.mark.data
def test_the_duty_of_a_servo_is_clipped_where_its_gain_is_high(shared_data, tmp_path):
    """The duty is limited to 1, which a gain of 100 never asks for; nothing is logged late."""
    robot = tmp_path / "robot.toml"
    robot.write_text(
        '[description]\nconvention = "standard"\nrows = [[0, 0.1, 0, "q"]]\ngravity = [9.81, 0, 0]\n'
        '[log]\nposition = "q"\nvelocity = "none"\ntorque = "duty"\n'
    )
    for log in sorted((shared_data / "payload_xl330").glob("*.csv")):
        found = kinds(examine(log, robot))
        raw = np.genfromtxt(log, delimiter=",", names=True)
        clipped = np.abs(raw["duty"]) > 0.999
        moves = np.gradient(raw["q"]) != 0.0
        if np.mean(clipped & moves) > 1e-3:
            assert "saturation" in found, log
        if not clipped.any():
            assert "saturation" not in found, log
        assert "delay" not in found
