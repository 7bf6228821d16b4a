"""Drives from commands and positions alone, against MuJoCo, which simulates them, and against closed forms."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import steelyard as sy
from steelyard.errors import InputError
from steelyard.identification import DriveSettings, identify_from_positions
from steelyard.identification.encoders_only.drive_logs import read_drive_logs, refuse_still
from steelyard.identification.encoders_only.drive_remarks import (
    remarks_on_logs,
    remarks_on_missing_terms,
    remarks_on_rows,
    remarks_on_zeros,
)
from steelyard.identification.encoders_only.positions import _freed_inertials, _problem
from steelyard.identification.encoders_only.shooting import PositionLog
from steelyard.identification.given import given_robot
from steelyard.identification.saved_result import SavedResult
from steelyard.robot.inertia import pseudo_inertia
from steelyard.simulation.driven_joints import DRIVE_PARAMETERS, Directions, FrictionLaw, branches_of, drive

ARM = """<mujoco model="arm"><compiler angle="radian"/><option gravity="0 0 -9.81"/>
<worldbody><body name="upper"><joint name="shoulder" axis="0 1 0"/>
<inertial pos="0.02 0.01 -0.12" mass="1.1" diaginertia="6e-3 6e-3 9e-4"/>
<body name="lower" pos="0 0 -0.21"><joint name="elbow" axis="0 1 0"/>
<inertial pos="0.01 0 -0.14" mass="0.3" diaginertia="1.5e-3 1.5e-3 6e-5"/></body></body></worldbody></mujoco>"""
TRUTH = np.array([[0.02, 0.25, 0.3, 0.05], [0.035, 0.15, 0.5, -0.08]])  # armature, damping, friction, torque bias
DELAY = 4.3e-3
KP, KD = 20.0, 1.5


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    return path


def log_of(t, q, command):
    return {"t": t, "q1": q[:, 0], "q2": q[:, 1], "target1": command[:, 0], "target2": command[:, 1]}


def commands(t):
    """Triangles of falling periods about different middles."""
    turns = 2.2 * t + 0.25 * t**2
    triangle = 2.0 * np.abs(turns / 2.0 - np.floor(turns / 2.0 + 0.5))
    return np.stack([0.5 + 0.8 * triangle, -1.8 + 1.2 * triangle], axis=1)


def simulated(path, t, command, step=2e-5):
    """Positions that MuJoCo finds with the true drives."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (the oracle) is not installed")
    world = mujoco.MjModel.from_xml_path(str(path))
    world.opt.timestep = step
    world.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    world.dof_armature[:], world.dof_damping[:], world.dof_frictionloss[:] = TRUTH[:, 0], TRUTH[:, 1] + KD, TRUTH[:, 2]
    # what depends on the inertia at rest, friction's softness among it, is found anew
    state = mujoco.MjData(world)
    mujoco.mj_setConst(world, state)
    state.qpos[:] = command[0]
    count = round((t[1] - t[0]) / step)
    told = np.clip(np.searchsorted(t, np.arange(len(t) * count) * step - DELAY, side="right") - 1, 0, None)
    q = np.empty((len(t), 2))
    for k in range(len(t)):
        q[k] = state.qpos
        for place in told[k * count : (k + 1) * count]:
            state.qfrc_applied[:] = KP * (command[place] - state.qpos) + TRUTH[:, 3]
            mujoco.mj_step(world, state)
    return q


SETTINGS = {"command": "target{}", "kp": KP, "kd": KD}


def simulated_and_held(path, t, command, period):
    """Positions that MuJoCo finds by Runge-Kutta steps of 50 µs with true drives that hold each torque for a period."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (the oracle) is not installed")
    world = mujoco.MjModel.from_xml_path(str(path))
    world.opt.timestep, world.opt.integrator = 5e-5, mujoco.mjtIntegrator.mjINT_RK4
    world.dof_armature[:], world.dof_damping[:], world.dof_frictionloss[:] = TRUTH[:, :3].T
    state = mujoco.MjData(world)
    mujoco.mj_setConst(world, state)
    state.qpos[:] = command[0]
    ticks = round((t[1] - t[0]) / period)
    told = np.clip((np.arange(len(t) * ticks) - round(0.004 / period)) // ticks, 0, None)
    q = np.empty((len(t), 2))
    for k in range(len(t)):
        q[k] = state.qpos
        for place in told[k * ticks : (k + 1) * ticks]:
            state.qfrc_applied[:] = KP * (command[place] - state.qpos) - KD * state.qvel + TRUTH[:, 3]
            mujoco.mj_step(world, state, nstep=round(period / 5e-5))
    return q


@pytest.mark.slow
@pytest.mark.parametrize("rate", [2000.0, 1000.0, 500.0])
def test_drives_that_hold_their_torques_are_found_with_their_friction(arm, rate):
    t = np.arange(1000) * 0.006
    command = commands(t)
    q = simulated_and_held(arm, t, command, 1.0 / rate)
    noisy = q + np.random.default_rng(3).normal(size=q.shape) * 5e-5
    log = log_of(t, noisy, command)
    found = identify_from_positions(sy.Robot.from_mjcf(arm), log, settings={**SETTINGS, "rate": rate})
    values = np.stack([found.rotor_inertia, found.viscous, found.coulomb], axis=1)
    np.testing.assert_allclose(values, TRUTH[:, :3], rtol=3e-3)
    assert abs(found.delay - 0.004) < 5e-5
    without = identify_from_positions(sy.Robot.from_mjcf(arm), log, settings=SETTINGS)
    np.testing.assert_allclose(without.rotor_inertia, TRUTH[:, 0] - 0.5 * KD / rate, rtol=1e-2)
    np.testing.assert_allclose(without.viscous, TRUTH[:, 1] - 0.5 * KP / rate, rtol=3e-2)


TURNTABLE = """<mujoco model="table"><compiler angle="radian"/><worldbody><body name="table">
<joint name="turn" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/></body></worldbody>
</mujoco>"""


def turned(t, command, kp, kd, inertia, viscous, period=0.0):
    """Exact positions of a turntable without friction of Coulomb: by matrix exponentials, commands held row by row.

    With a period its drive holds each torque, otherwise the law acts all the time.
    """
    step = t[1] - t[0]
    own = np.array([[0.0, 1.0, 0.0], [0.0, -viscous / inertia, 1.0 / inertia], [0.0, 0.0, 0.0]])  # under a held torque
    law = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-kp, -kd, 0.0]])
    if period:
        tick = expm(own * period) @ law
        given = np.append((expm(own * period) @ [0.0, 0.0, kp])[:2], 0.0)
    else:
        closed = own.copy()
        closed[1] += np.array([-kp, -kd, kp - 1.0]) / inertia
        tick, given = expm(closed * step), np.zeros(3)
    state, found = np.array([command[0], 0.0, 0.0]), []
    for target in command:
        found.append(state[0])
        for _ in range(round(step / period) if period else 1):
            state = tick @ np.append(state[:2], 0.0 if period else target) + given * target
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "stated"), [(None, None), (2000.0, 2000.0), (1000.0, 1000.0), (1000.0, None)])
def test_drives_that_hold_their_torques_are_told_from_those_of_which_the_law_acts_all_the_time(tmp_path, rate, stated):
    path = tmp_path / "table.xml"
    path.write_text(TURNTABLE)
    t = np.arange(600) * 0.005
    command = 0.5 * np.sin(6.0 * t + 3.0 * np.sin(2.0 * t))
    q = turned(t, command, 20.0, 1.5, 0.021, 0.3, 0.0 if rate is None else 1.0 / rate)
    noisy = q + 1e-4 * np.random.default_rng(1).normal(size=q.shape)
    settings = {"command": ["target"], "kp": 20.0, "kd": 1.5, "delay": 0.0, "bias": "none", "rate": stated}
    settings["find"] = ["rotor_inertia", "viscous"]
    found = identify_from_positions(
        sy.Robot.from_mjcf(path), {"t": t, "q": noisy, "target": command}, settings=settings
    )
    late = 0.0 if rate == stated else 0.5 / rate
    assert found.rotor_inertia == pytest.approx(0.02 - 1.5 * late, rel=5e-3)
    assert found.viscous == pytest.approx(0.3 - 20.0 * late, rel=5e-3)
    truth = {"rotor_inertia": 0.02, "viscous": 0.3}
    assert all(one.lower < truth[one.kind] < one.upper for one in found.values) is (rate == stated)
    assert any("rotor inertia of turn by 0.00075 kg·m² and" in remark for remark in found.remarks) is (stated is None)


@pytest.mark.slow
def test_steps_of_the_simulation_move_no_value_of_a_precise_log(tmp_path):
    """With steps of 0.625 ms both values are off by more than their intervals."""
    path = tmp_path / "table.xml"
    path.write_text(TURNTABLE)
    t = np.arange(1000) * 0.005
    command = 0.5 * np.sin(6.0 * t + 3.0 * np.sin(2.0 * t))
    noisy = turned(t, command, 100.0, 2.0, 0.021, 0.3) + 5e-6 * np.random.default_rng(2).normal(size=t.shape)
    settings = {"command": ["target"], "kp": 100.0, "kd": 2.0, "delay": 0.0, "bias": "none"}
    settings["find"] = ["rotor_inertia", "viscous"]
    found = identify_from_positions(
        sy.Robot.from_mjcf(path), {"t": t, "q": noisy, "target": command}, settings=settings
    )
    for one, true in zip(found.values, (0.02, 0.3), strict=True):
        assert one.lower < true < one.upper


@pytest.mark.slow
def test_drives_that_mujoco_simulates_are_found(arm):
    t = np.arange(600) * 0.005
    command = commands(t)
    q = simulated(arm, t, command)
    noisy = q + np.random.default_rng(3).normal(size=q.shape) * 2e-4
    robot = sy.Robot.from_mjcf(arm)
    found = identify_from_positions(robot, log_of(t, noisy, command), settings=SETTINGS)
    values = np.stack([found.rotor_inertia, found.viscous, found.coulomb], axis=1)
    np.testing.assert_allclose(values, TRUTH[:, :3], rtol=0.02)
    assert abs(found.delay - DELAY) < 0.2e-3
    assert found.settled
    truth = {**{("shoulder", k): TRUTH[0, i] for i, k in enumerate(("rotor_inertia", "viscous", "coulomb", "offset"))}}
    truth |= {("elbow", k): TRUTH[1, i] for i, k in enumerate(("rotor_inertia", "viscous", "coulomb", "offset"))}
    truth["all", "delay"] = DELAY
    covered = [value.lower <= truth[value.joint, value.kind] <= value.upper for value in found.values]
    assert sum(covered) >= 8  # of nine
    assert found.error.max() < 2.1e-4


LEVELS = np.array([[0.55, 0.30, 0.20], [0.35, 0.35, 0.35]])  # N·m at both ends and in the middle of the travel
LOAD, STIFFNESS = np.array([0.0, 0.30]), np.array([0.4, 0.0])


def simulated_with_more(path, t, command, step=1e-4):
    """As `simulated`, with friction that varies over the travel and grows with the load, and a spring."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (the oracle) is not installed")
    world = mujoco.MjModel.from_xml_path(str(path))
    world.opt.timestep = step
    world.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    world.dof_armature[:], world.dof_damping[:] = TRUTH[:, 0], TRUTH[:, 1] + KD
    state = mujoco.MjData(world)
    mujoco.mj_setConst(world, state)
    state.qpos[:] = command[0]
    mujoco.mj_forward(world, state)
    low, high = command.min(axis=0), command.max(axis=0)
    middle, inertial = 0.5 * (low + high), np.empty(2)
    count = round((t[1] - t[0]) / step)
    told = np.clip(np.searchsorted(t, np.arange(len(t) * count) * step - DELAY, side="right") - 1, 0, None)
    q = np.empty((len(t), 2))
    for k in range(len(t)):
        q[k] = state.qpos
        for place in told[k * count : (k + 1) * count]:
            friction = np.array(
                [
                    np.interp(x, (a, m, b), f)
                    for x, a, m, b, f in zip(state.qpos, low, middle, high, LEVELS, strict=True)
                ]
            )
            mujoco.mj_mulM(world, state, inertial, state.qacc)
            links = inertial - TRUTH[:, 0] * state.qacc + state.qfrc_bias
            world.dof_frictionloss[:] = friction + LOAD * np.abs(links)
            spring = STIFFNESS * (state.qpos - middle)
            state.qfrc_applied[:] = KP * (command[place] - state.qpos) + TRUTH[:, 3] - spring
            mujoco.mj_step(world, state)
    return q, low, high


@pytest.mark.slow
def test_friction_by_position_and_load_and_springs_are_found_where_they_are(arm, tmp_path):
    """And only there: the choice by stretches that are left out; the answer means in MuJoCo what it means here."""
    t = np.arange(900) * 0.005
    command = commands(t)
    q, low, high = simulated_with_more(arm, t, command)
    noisy = q + np.random.default_rng(5).normal(size=q.shape) * 2e-4
    robot = sy.Robot.from_mjcf(arm)
    log = log_of(t, noisy, command)
    found = identify_from_positions(robot, log, settings=SETTINGS, friction="auto")
    assert "coulomb_by_position" in found.choice.terms[0]
    assert "spring" in found.choice.terms[0]
    assert "coulomb_by_load" in found.choice.terms[1]
    np.testing.assert_array_less(found.choice.error, 0.5 * found.choice.plain_error)
    np.testing.assert_allclose(found.rotor_inertia, TRUTH[:, 0], rtol=0.04)
    # The travel is that of the positions, which do not reach the ends of the commands.
    middle = 0.5 * (low[0] + high[0])
    places = found.travel[0, 0], found.travel[:, 0].mean(), found.travel[1, 0]
    for place, level in zip(places, found.coulomb_by_position[:, 0], strict=True):
        truth = np.interp(place, (low[0], middle, high[0]), LEVELS[0])
        assert level == pytest.approx(truth, abs=0.02)
    assert found.load_friction[1] == pytest.approx(LOAD[1], abs=0.03)
    assert found.stiffness[0] == pytest.approx(STIFFNESS[0], abs=0.03)
    assert any(remark.startswith("Added: Coulomb friction that varies over the travel") for remark in found.remarks)
    plain = identify_from_positions(robot, log, settings=SETTINGS)
    (told,) = (one for one in plain.remarks if one.startswith("The simulation misses"))
    assert "shoulder by" in told
    assert "--friction auto" in told
    found.save(tmp_path / "result")
    joint = json.loads((tmp_path / "result" / "drives.json").read_text())["joints"]["shoulder"]
    assert joint["frictionloss_by_position"]["frictionloss"] == pytest.approx(found.coulomb_by_position[:, 0])
    assert joint["frictionloss"] == pytest.approx(np.average(found.coulomb_by_position[:, 0], weights=(1, 2, 1)))
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (the oracle) is not installed")
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "result" / "arm.xml"))
    assert np.ravel(written.joint("shoulder").stiffness)[0] == pytest.approx(found.stiffness[0])
    assert written.qpos_spring[0] == pytest.approx(found.travel.mean(axis=0)[0])


@pytest.mark.slow
def test_no_friction_is_added_that_is_not_there(arm):
    t = np.arange(700) * 0.005
    command = commands(t)
    q = simulated(arm, t, command, 1e-4)
    noisy = q + np.random.default_rng(8).normal(size=q.shape) * 2e-4
    found = identify_from_positions(
        sy.Robot.from_mjcf(arm), log_of(t, noisy, command), settings=SETTINGS, friction="auto"
    )
    assert found.choice.terms == (frozenset(), frozenset())
    assert found.remarks[-1].startswith("No term of friction was added") or any(
        remark.startswith("No term of friction was added") for remark in found.remarks
    )
    assert found.drives[DRIVE_PARAMETERS.index("load_friction")].tolist() == [0.0, 0.0]
    assert not any(one.startswith("The simulation misses") for one in found.remarks)


def test_logs_that_are_too_short_choose_no_friction(arm):
    t = np.arange(15) * 0.005
    command = commands(t)
    log = log_of(t, command - 0.1 * np.sin(60.0 * t)[:, None], command)
    with pytest.raises(InputError, match="15 rows, too few to choose friction"):
        identify_from_positions(sy.Robot.from_mjcf(arm), log, settings=SETTINGS, friction="auto")


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_gains_that_are_off_by_a_factor_of_two_are_told(arm, factor):
    """The simulation misses 1 to 9 mrad then, a few percent of the motion, which friction alone may leave as well."""
    t = np.arange(400) * 0.005
    command = commands(t)
    q = simulated(arm, t, command, 2.5e-4)
    noisy = q + np.random.default_rng(2).normal(size=q.shape) * 2e-4
    robot, log = sy.Robot.from_mjcf(arm), log_of(t, noisy, command)
    sound = identify_from_positions(robot, log, settings=SETTINGS)
    assert not any("Do not believe" in remark for remark in sound.remarks)
    wrong = identify_from_positions(robot, log, settings={**SETTINGS, "kp": factor * KP, "kd": factor * KD})
    assert "other position gains explain the motion far better" in wrong.remarks[0]
    for joint in ("shoulder", "elbow"):
        told = wrong.remarks[0].split(f"{joint}: ")[1]
        assert float(told.split(" instead")[0]) == pytest.approx(KP, rel=0.03)
        assert f"instead of {factor * KP:g}" in told


@pytest.mark.slow
def test_stretches_side_by_side_are_one_simulation(arm):
    """And where they are not joined, rows follow one another."""
    t = np.arange(150) * 0.005
    command = commands(t)
    log = PositionLog(t, command - 0.05 * np.sin(3.0 * t)[:, np.newaxis], command)
    robot = sy.Robot.from_mjcf(arm)
    settings = DriveSettings.from_dict({**SETTINGS, "delay": 0.0})
    problem = _problem(robot, branches_of(robot), settings, [log], [frozenset()] * 2)
    values = np.array([0.02, 0.25, 0.3, 0.05, 0.035, 0.15, 0.5, -0.08])
    states = problem.start_states()
    (joined,), passed = problem.simulate(values, states)
    own = np.stack(states)
    (plain,) = problem._row_by_row([0], values, own)
    np.testing.assert_allclose(joined, plain[:, 0], rtol=0, atol=1e-8)
    np.testing.assert_allclose(passed[0], own[0], rtol=0, atol=1e-7)
    assert len(passed[0]) == 3
    assert np.abs(states[0] - passed[0]).max() > 1e-3  # what was guessed was no motion


def test_commands_that_are_missing_hold_and_rows_without_positions_go(arm, tmp_path):
    """Commands that come less often than positions leave cells empty; a second without positions parts a log."""
    (tmp_path / "arm.toml").write_text(
        '[description]\nfile = "arm.xml"\n[log]\nmissing = "fill"\n[drive]\ncommand = "target{}"\nkp = 20.0\n'
    )
    t = np.arange(400) * 0.005
    command = commands(t)
    log = log_of(t, command - 0.1, command)
    slow = np.arange(400) % 6 != 0
    for name in ("target1", "target2"):
        log[name] = np.where(slow, np.nan, log[name])
    log["q1"][200:260] = np.nan
    file, _ = given_robot(tmp_path / "arm.toml")
    settings = DriveSettings.from_dict(file.section("drive"))
    (first, second), held_out, remarks = read_drive_logs(file, settings, log, ())
    assert not held_out
    assert not remarks
    np.testing.assert_array_equal(first.command, command[np.arange(200) // 6 * 6])
    np.testing.assert_array_equal(second.command, command[np.arange(260, 400) // 6 * 6])
    assert (first.begin, second.begin) == (0.0, pytest.approx(1.3))
    log["q2"][5:] = np.nan
    with pytest.raises(InputError, match="log 1 has 5 rows with all positions and commands"):
        read_drive_logs(file, settings, log, ())
    log["target2"][:] = np.nan
    with pytest.raises(InputError, match='no command of joint "elbow" in any row'):
        read_drive_logs(file, settings, log, ())


def test_positions_and_commands_in_degrees_are_told(arm, tmp_path):
    """Without limits as a guess; where limits are described, which only degrees fit, they are refused."""
    t = np.arange(100) * 0.005
    command = commands(t)
    degrees = log_of(t, np.degrees(command - 0.1), np.degrees(command))
    file, _ = given_robot(arm)
    settings = DriveSettings.from_dict(SETTINGS)
    (_,), _, (remark,) = read_drive_logs(file, settings, degrees, ())
    assert "log 1: Positions go through many turns of a joint" in remark
    assert 'in degrees (`position_unit = "deg"` in [log])' in remark
    assert not read_drive_logs(file, settings, log_of(t, command - 0.1, command), ())[2]
    limited = tmp_path / "limited.xml"
    limited.write_text(ARM.replace("<joint ", '<joint range="-2 2" '))
    file, _ = given_robot(limited)
    assert not read_drive_logs(file, settings, log_of(t, command - 0.1, command), ())[2]
    with pytest.raises(InputError, match=r"all joints fit theirs as degrees; state `position_unit = \"deg\"`"):
        read_drive_logs(file, settings, degrees, ())


@pytest.mark.parametrize("law", ["position", "signal"])
def test_the_lines_that_counts_are_refused_with_mend_them(arm, tmp_path, law):
    """Commands are in counts as positions are, but not the signals of drives."""
    t = np.arange(100) * 0.005
    command = commands(t)
    path, turn, zero = tmp_path / "arm.toml", 4096, np.array([2048.0, 1000.0])
    drive = '[drive]\ncommand = "target{}"\n' + ("kp = 20.0\n" if law == "position" else 'law = "signal"\ngain = 1.0\n')
    counted = np.rint((command - 0.1) / (2.0 * np.pi) * turn + zero)
    told = command / (2.0 * np.pi) * turn + zero if law == "position" else command
    log = log_of(t, counted, told)

    def read(lines=""):
        path.write_text(f'[description]\nfile = "arm.xml"\n[log]\n{lines}{drive}')
        file, _ = given_robot(path)
        return read_drive_logs(file, DriveSettings.from_dict(file.section("drive")), log, ())

    with pytest.raises(InputError, match=r'State `position_matrix` .* with "2\*pi/COUNTS".*`position_offset`'):
        read()
    turns = f"2*pi/{turn}"
    offset = f'position_offset = ["-pi", {-2.0 * np.pi * 1000 / turn}]\n'
    (one,), _, remarks = read(f'position_matrix = [["{turns}", 0], [0, "{turns}"]]\n{offset}')
    assert not remarks
    np.testing.assert_allclose(one.q, command - 0.1, atol=np.pi / turn)
    np.testing.assert_allclose(one.command, command, atol=1e-12)
    with pytest.raises(InputError, match="makes joints of several motors"):
        read(f'position_matrix = [["{turns}", 0], ["{turns}", "{turns}"]]\n')


def test_noise_of_an_encoder_is_no_motion(arm):
    noise = 4e-4 * np.random.default_rng(4).normal(size=(2000, 2))
    t = np.arange(2000) * 0.005
    moving = noise + np.sin(t)[:, np.newaxis] * [1.0, 0.0]
    with pytest.raises(InputError, match='joint "elbow" stands still'):
        refuse_still(sy.Robot.from_mjcf(arm), [PositionLog(t, moving, moving)])


def test_what_spoils_values_at_times_is_told_with_its_time(tmp_path):
    """A burst of errors, a stop, a drive at its limit, a joint without commands and a zero that is off."""
    path = tmp_path / "arm.xml"
    path.write_text(
        ARM.replace('"shoulder" axis', '"shoulder" actuatorfrclimited="true" actuatorfrcrange="-3 3" axis').replace(
            '"elbow" axis', '"elbow" limited="true" range="-1 1" axis'
        )
    )
    robot, settings = sy.Robot.from_mjcf(path), DriveSettings.from_dict(SETTINGS)
    t = np.arange(1000) * 0.01
    q = np.stack([np.sin(t), np.maximum(np.sin(t), -1.0)], axis=1)
    command = np.stack([q[:, 0] + 0.2, 1.2 * np.sin(t)], axis=1)
    drives = np.zeros((len(DRIVE_PARAMETERS), 2))
    drives[DRIVE_PARAMETERS.index("kp")] = KP
    both, log = np.array([True, True]), PositionLog(t, q, command, "log 1", 5.0)
    stop, limit = remarks_on_logs(robot, settings, [log], drives, both)
    assert "elbow in " in stop
    assert "limits of the description" in stop
    assert "shoulder for more than 3 N·m in 100% of the rows" in limit
    assert remarks_on_logs(robot, settings, [log], drives, ~both) == []
    rest = PositionLog(t, q, np.where([True, False], command, 0.0))
    assert remarks_on_logs(robot, settings, [rest], drives, ~both)[0].startswith("The commands of elbow never change")
    drives[DRIVE_PARAMETERS.index("offset")] = [1.0, 14.0]
    (zero,) = remarks_on_zeros(robot, drives)
    assert "elbow by 0.7 rad" in zero
    assert "shoulder" not in zero
    residuals = 1e-4 * np.random.default_rng(6).normal(size=(1000, 2))
    assert remarks_on_rows(robot, [log], [residuals], both) == []
    residuals[400:420, 1] += 0.02
    (burst,) = remarks_on_rows(robot, [log], [residuals], both)
    assert "elbow, most of all from 9" in burst
    assert "shoulder" not in burst
    error = 0.01 * np.std(log.q, axis=0) * [1.0, 0.1]  # the latter may be steps and friction near standstill
    (missed,) = remarks_on_missing_terms(robot, [log], error, both, chosen=False)
    assert f"misses shoulder by {1e3 * error[0]:.2g} mrad" in missed
    assert "--friction auto" in missed
    assert remarks_on_missing_terms(robot, [log], error, ~both, chosen=False) == []


@pytest.mark.parametrize(
    ("law", "load", "loss"),
    [
        pytest.param(FrictionLaw.mujoco(), 0.3, 0.0, marks=pytest.mark.slow),
        (FrictionLaw.coulomb(), 0.0, 0.0),
        pytest.param(FrictionLaw.mujoco(), 0.3, 0.01, marks=pytest.mark.slow),
    ],
)
def test_sensitivities_to_all_that_is_found_are_those_of_differences(arm, law, load, loss):
    """Of positions, by every parameter of the drives, encoders and links, while joints slip."""
    (branch,) = branches_of(sy.Robot.from_mjcf(arm))
    links = np.array(sy.Robot.from_mjcf(arm).parameters)[:20]
    drives = np.array([0.03, 0.2, 0.3, 0.2, 0.4, load, 0.5, 0.1, 20.0, 1.0, 0.0, loss, 0.0])
    drives = np.repeat(drives[None, :, None], 2, axis=2)
    count = 12 * 2 + 2 + 20
    unit = np.eye(count)
    directions = Directions(
        np.concatenate([unit[:24].reshape(12, 2, count), np.zeros((1, 2, count))]), unit[24:26], unit[26:]
    )
    rows = 24

    def moved(changes, with_directions=None):
        """Of as many robots side by side as there are changes, (B, count)."""
        many = len(changes)
        command = np.linspace(0.8, 1.5, rows * 4)[:, None, None, None] * np.ones((1, many, 1, 2))
        return drive(
            [branch] * many,
            list(links + changes[:, 26:]),
            drives + np.concatenate([changes[:, :24].reshape(many, 12, 2), np.zeros((many, 1, 2))], axis=1),
            changes[:, 24:26],
            np.tile([[-0.2, -0.3], [1.2, 1.4]], (many, 1, 1)),
            np.tile([0.1, -0.2, 3.0, 3.0], (many, 1, 1)),
            np.full((rows, 1), 0.005),
            command,
            np.zeros_like(command),
            law,
            substeps=4,
            period=1e-3,
            directions=with_directions,
        )

    found = moved(np.zeros((1, count)), [directions]).by_parameters[:, 0, 0]
    ahead, behind = (moved(sign * 1e-6 * unit).q[:, :, 0] for sign in (1.0, -1.0))
    for k in range(count):
        difference = (ahead[:, k] - behind[:, k]) / 2e-6
        # What Newton's method leaves of a step, 1 % by the second encoder: it acts by gravity and friction alone.
        np.testing.assert_allclose(found[..., k], difference, rtol=0, atol=0.02 * np.abs(difference).max() + 1e-9)


@pytest.mark.slow
def test_a_drive_whose_torque_falls_behind_its_voltage_is_told_from_one_with_another_gain():
    """A weighed pendulum behind a servo, integrated by SciPy; without the loss the gain is that of a weaker motor."""
    weight, inertia, gain, back_emf, loss = 0.48, 0.0068, 0.12, 0.05, 0.35
    t = np.arange(800) * 0.005
    voltage = 5.0 * np.sin(2.2 * t) + 2.0 * np.sin(9.0 * t + 0.4)

    def rate(_, state, volts):
        law = gain * volts - back_emf * state[1]
        return [state[1], (law * (1.0 - loss * abs(law)) - weight * np.sin(state[0])) / inertia]

    state, q = np.zeros(2), [0.0]
    for volts in voltage[:-1]:  # held until the next row
        state = solve_ivp(rate, (0.0, 0.005), state, args=(volts,), rtol=1e-8, atol=1e-10).y[:, -1]
        q.append(state[0])
    noise = 2e-4 * np.random.default_rng(1).normal(size=t.size)
    body = sy.Inertia.from_com(mass=weight / 0.981, com=(0.0, 0.0, 0.0), about_com=1e-9 * np.eye(3))
    robot = sy.Robot.from_dh([(0, 0.1, 0, "q")], gravity=(9.81, 0, 0), inertias={"link1": body})  # 0.1 m from the axis
    log = {"t": t, "q1": np.array(q) + noise, "u": voltage}
    stated = {"law": "signal", "command": ["u"], "kd": "find", "delay": 0.0, "bias": "none"}
    found = identify_from_positions(robot, log, settings={**stated, "find": ["rotor_inertia", "torque_loss"]})
    plain = identify_from_positions(robot, log, settings={**stated, "find": ["rotor_inertia"]})
    assert found.torque_loss[0] == pytest.approx(loss, rel=0.02)
    assert found.gain[0] == pytest.approx(gain, rel=0.01)
    assert found.kd[0] == pytest.approx(back_emf, rel=0.02)
    assert found.error[0] < 3e-4
    assert plain.error[0] > 10 * found.error[0]
    assert plain.gain[0] < 0.9 * gain
    assert found.to_dict()["joints"]["joint1"]["torque_loss"] == found.torque_loss[0]
    # A voltage less a position is nothing, and errors have their unit.
    head, row = str(found).split("\n\n")[1].splitlines()
    assert head.split() == ["joint", "error", "unit"]
    assert row.split()[2] == "mrad"
    assert float(row.split()[1]) == pytest.approx(1e3 * found.error[0], rel=0.01)


@pytest.mark.slow
def test_what_is_written_moves_in_mujoco_as_it_was_measured(arm, tmp_path, run):
    """The command line: gains that are unknown, a held-out log, and the MJCF that comes out."""
    t = np.arange(500) * 0.005
    command = commands(t)
    q = simulated(arm, t, command, 2.5e-4)
    for name, rows in (("fit", slice(0, 350)), ("rest", slice(350, 500))):
        columns = log_of(t[rows], q[rows], command[rows])
        lines = [",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in zip(*columns.values(), strict=True))]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines))
    text = f'[description]\nfile = "{arm.name}"\n[drive]\ncommand = "target{{}}"\nkp = "find"\nkd = "find"\n'
    (tmp_path / "arm.toml").write_text(text + 'bias = "torque"\n')
    code, out, error = run(
        "identify", tmp_path / "arm.toml", tmp_path / "fit.csv", "--validate", tmp_path / "rest.csv",
        "--from", "positions", "--output", tmp_path / "result",
    )  # fmt: skip
    assert code == 0, error
    assert "Kd and viscous friction brake alike" in out
    document = json.loads((tmp_path / "result" / "drives.json").read_text())
    for row, joint in zip(TRUTH, document["joints"].values(), strict=True):
        assert joint["kp"] == pytest.approx(KP, rel=0.03)
        assert joint["kd"] == pytest.approx(KD + row[1], rel=0.03)
        assert joint["armature"] == pytest.approx(row[0], rel=0.08)
        assert joint["validation_error"] < 2e-3
    written = sy.Robot.from_mjcf(tmp_path / "result" / "arm.xml")
    rotors = [joint.rotor_inertia for joint in written.joints]
    assert rotors == pytest.approx([joint["armature"] for joint in document["joints"].values()])


def test_freed_inertias_are_possible_and_their_derivatives_those_of_differences():
    link = sy.robot.Inertia.from_com(0.5, [0.02, -0.01, 0.1], np.diag([3e-3, 2.5e-3, 1e-3])).parameters
    values = np.random.default_rng(1).normal(size=10) * 2.0
    parameters, derivatives = _freed_inertials([link, link], [False, True], values)
    np.testing.assert_array_equal(parameters[:10], link)
    assert np.linalg.eigvalsh(pseudo_inertia(parameters[10:])).min() > 0.0
    for k, direction in enumerate(np.eye(10)):
        ahead, behind = (
            _freed_inertials([link, link], [False, True], values + e * direction)[0] for e in (1e-6, -1e-6)
        )
        np.testing.assert_allclose((ahead - behind) / 2e-6, derivatives[:, k], rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(
    ("settings", "changed", "message"),
    [
        ({"kp": 0.0}, {}, r"'kp', is 0\.0; it must be positive"),
        ({"kp": [20.0, 20.0, 20.0]}, {}, "has 3 numbers, but arm has 2 joints"),
        ({"command": "goal{}"}, {}, "no column 'goal1', which \\[drive\\] names for the commands; it has t, q1"),
        ({"command": ["target1"]}, {}, "names 1 columns of commands, but arm has 2 joints"),
        ({"free": ["lowr"]}, {}, 'did you mean "lower"'),
        ({}, {"target2": "q2"}, 'the commands of joint "elbow" are its measured positions'),
        ({}, {"q2": None}, 'joint "elbow" stands still'),
        ({}, {"t": 0.2 * np.arange(200)}, r"log 1 has 200 rows, 0\.2 s apart, and nowhere 10 in a row without a gap"),
        ({"scale": "volts"}, {"volts": np.full(200, np.nan)}, "no finite number in column 'volts' in 200 of 200 rows"),
        ({"also": ["other.xml"]}, {}, r"other\.xml: cannot be read"),
        ({"also": ["copies/arm.xml"]}, {}, r"two descriptions are called arm\.xml"),
        ({"free": ["lower"]}, {}, "'lower', whose mass and inertia in the description are those of no body"),
    ],
)
def test_useless_logs_and_settings_are_told(arm, settings, changed, message):
    t = np.arange(200) * 0.005
    command = commands(t)
    log = log_of(t, command - 0.1 * np.sin(t)[:, None], command)
    for name, other in changed.items():
        log[name] = np.zeros(200) if other is None else log[other].copy() if isinstance(other, str) else other
    if "free" in settings:  # a rod, which has no inertia about its axis
        arm.write_text(ARM.replace("1.5e-3 1.5e-3 6e-5", "1.5e-3 1.5e-3 0"))
    with pytest.raises(InputError, match=message):
        identify_from_positions(sy.Robot.from_mjcf(arm), log, settings={**SETTINGS, **settings})


def test_results_do_not_replace_the_description_that_was_read(arm, tmp_path, run):
    (tmp_path / "arm.toml").write_text(
        f'[description]\nfile = "{arm.name}"\n[drive]\ncommand = "target{{}}"\nkp = 20.0\n'
    )
    code, _, error = run("identify", tmp_path / "arm.toml", tmp_path / "l.csv", "--from", "positions", "-o", tmp_path)
    assert code == 2
    assert "arm.xml: is read, and the results would replace it" in error
    for option in (["--force"], ["--table"], ["--verbose"], ["--chunk-rows", "5000"]):
        code, _, error = run(
            "identify", tmp_path / "arm.toml", tmp_path / "l.csv", "--from", "positions", "-o", tmp_path / "r", *option
        )
        assert code == 2
        assert f"{option[0]} belongs to identification from torques" in error


@pytest.mark.slow
def test_a_log_of_the_fit_is_not_held_out(arm):
    """Given again it tests nothing, nor does it tell anything twice."""
    t = np.arange(300) * 0.005
    log = log_of(t, simulated(arm, t, commands(t)), commands(t))
    other = log_of(t + 7.0, *(np.column_stack([log[f"{kind}{k}"] for k in (1, 2)]) for kind in ("q", "target")))
    body = sy.Robot.from_mjcf(arm)
    once = identify_from_positions(body, log, settings=SETTINGS)
    again = identify_from_positions(body, [log, other], validate=log, settings=SETTINGS)
    assert again.validation_error is None
    assert "in the logs of the fit" in again.headline
    assert [value.upper for value in again.values] == [value.upper for value in once.values]
    assert sum("used in the fit" in remark for remark in again.remarks) == 1
    assert sum("given twice" in remark for remark in again.remarks) == 1


def test_a_folder_of_drives_is_told_from_one_of_estimates(tmp_path):
    (tmp_path / "drives.json").write_text("{}")
    with pytest.raises(InputError, match=r"holds drives that were identified from positions \(drives\.json\)"):
        SavedResult.load(tmp_path)


def test_a_recording_without_commands_is_refused(arm):
    zeros = np.zeros((20, 2))
    recording = sy.Recording(np.arange(20.0), zeros, zeros)
    with pytest.raises(InputError, match="A Recording does not hold the commands"):
        identify_from_positions(sy.Robot.from_mjcf(arm), recording, settings=SETTINGS)


def test_a_pattern_stands_for_logs_as_it_does_with_torques(arm, tmp_path):
    """Told by a joint that stands still in all of them, before anything is fitted."""
    t = np.arange(40) * 0.005
    q = np.stack([np.sin(t), 0.0 * t], axis=1)
    for name, ahead in (("one", 0.1), ("two", 0.2)):
        columns = log_of(t, q, q + ahead)
        np.savetxt(
            tmp_path / f"{name}.csv", np.stack(list(columns.values()), axis=1), "%.9g", ",",
            header=",".join(columns), comments="",
        )  # fmt: skip
    with pytest.raises(InputError, match=r'^one\.csv, two\.csv: joint "elbow" stands still'):
        identify_from_positions(sy.Robot.from_mjcf(arm), tmp_path / "*.csv", settings=SETTINGS)


def test_settings_that_say_nothing_are_told():
    with pytest.raises(InputError, match="lacks command"):
        DriveSettings.from_dict({"kp": 1.0})
    with pytest.raises(InputError, match="lacks kp"):
        DriveSettings.from_dict({"command": "q_des{}"})
    with pytest.raises(InputError, match=r"from 0 to 1 s"):
        DriveSettings.from_dict({"command": "q_des{}", "kp": 1.0, "delay": -0.01})
    with pytest.raises(InputError, match="leaves nothing to be found"):
        DriveSettings.from_dict({"command": "q_des{}", "kp": 1.0, "delay": 0.0, "find": [], "bias": "none"})
    with pytest.raises(InputError, match='gives gain, which belongs to law = "signal"'):
        DriveSettings.from_dict({"command": "q_des{}", "kp": 1.0, "gain": 2.0})
    with pytest.raises(InputError, match=r"key 'rate', must be 500 Hz or more"):
        DriveSettings.from_dict({"command": "q_des{}", "kp": 1.0, "rate": 100})
    with pytest.raises(InputError, match="gives rate, which is that of a position loop"):
        DriveSettings.from_dict({"command": "u{}", "law": "signal", "rate": 1000.0})
    backwards = DriveSettings.from_dict({"command": "u{}", "law": "signal", "gain": -2.0, "free": ["rod", "rod"]})
    assert (backwards.gain, backwards.free) == ((-2.0,), ("rod",))


HINGE = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.2"/>
<mass value="0.5"/><inertia ixx="2e-3" iyy="2e-3" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.mark.slow
def test_a_xacro_takes_results_with_the_arguments_that_it_was_read_with(tmp_path):
    """Without them it is another robot, whose joint has another name."""
    pytest.importorskip("xacro", reason="xacro (pip install 'steelyard[xacro]') is not installed")
    path = tmp_path / "pendulum.urdf.xacro"
    head = (
        '<robot name="pendulum" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="joint" default="hinge"/>'
    )
    path.write_text(head + HINGE.removeprefix('<robot name="pendulum">').replace('"hinge"', '"$(arg joint)"'))
    robot = sy.Robot.from_urdf(path, xacro_arguments={"joint": "elbow"})
    t = np.arange(100) * 0.005
    log = {"t": t, "q": 0.3 * np.sin(9.0 * t), "target": 0.4 * np.sin(9.0 * t + 0.2)}
    found = identify_from_positions(robot, log, settings={"command": ["target"], "kp": 6.0, "delay": 0.0})
    found.save(tmp_path / "result")
    written = sy.Robot.from_urdf(tmp_path / "result" / path.name)
    assert written.joint_names == ("elbow",)
    assert written.joints[0].damping == pytest.approx(found.viscous[0])


@pytest.mark.slow
def test_commands_of_the_wrong_sign_are_not_believed(tmp_path):
    """A motion that is a solution of the pendulum's equation; then the same with commands of the other sign."""
    path = tmp_path / "pendulum.urdf"
    path.write_text(HINGE)
    t = np.arange(300) * 0.005

    def motion(t):
        return 0.6 * np.sin(5.0 * t) + 0.2 * np.sin(11.0 * t)

    def target_at(t):
        speed = 3.0 * np.cos(5.0 * t) + 2.2 * np.cos(11.0 * t)
        acceleration = -15.0 * np.sin(5.0 * t) - 24.2 * np.sin(11.0 * t)
        torque = (2e-3 + 0.5 * 0.2**2 + 0.015) * acceleration + 0.4 * speed + 0.5 * 9.81 * 0.2 * np.sin(motion(t))
        return motion(t) + torque / 6.0

    q, target = motion(t), target_at(t + 0.0025)  # a command holds until the next
    settings = {"command": ["target"], "kp": 6.0, "kd": 0.3, "delay": 0.0, "bias": "none", "friction": "coulomb"}
    robot = sy.Robot.from_urdf(path)
    sound, wrong = (
        identify_from_positions(robot, {"t": t, "q": q, "target": sign * target}, settings=settings)
        for sign in (1.0, -1.0)
    )
    assert not any("Do not believe" in remark for remark in sound.remarks)
    assert sound.rotor_inertia[0] == pytest.approx(0.015, rel=0.03)
    assert wrong.remarks[0].startswith("Do not believe the values")
    assert "hinge by" in wrong.remarks[0]
    assert "so many times as far as the joints: hinge -" in wrong.remarks[0]
    with pytest.raises(InputError, match=r"pendulum\.urdf: is what was read, and the results would replace it"):
        sound.save(tmp_path)
    assert path.read_text() == HINGE


@pytest.mark.slow
def test_a_delay_of_commands_that_do_not_change_is_not_seen(tmp_path):
    """A step response in closed form, without gravity: the delay stayed at its start and was called measured."""
    path = tmp_path / "turntable.urdf"
    path.write_text(HINGE.replace('xyz="0 1 0"', 'xyz="0 0 1"'))
    inertia, damping, stiffness = 1e-4 + 0.015, 0.05, 6.0
    t = np.arange(200) * 0.005
    decay = damping / (2.0 * inertia)
    speed = np.sqrt(stiffness / inertia - decay**2)
    q = 0.8 * (1.0 - np.exp(-decay * t) * (np.cos(speed * t) + decay / speed * np.sin(speed * t)))
    log = {"t": t, "q": q, "target": np.full(200, 0.8)}
    settings = {"command": ["target"], "kp": stiffness, "kd": damping, "find": ["rotor_inertia"], "bias": "none"}
    found = identify_from_positions(sy.Robot.from_urdf(path), log, settings=settings)
    rotor, delay = found.values
    assert rotor.word == "measured"
    assert rotor.value == pytest.approx(0.015, rel=0.01)
    assert delay.word == "not seen"
    assert (delay.lower, delay.upper) == (0.0, 0.05)
    found.save(tmp_path / "result")


@pytest.mark.slow
def test_a_joint_may_stand_still_in_one_of_the_logs(arm):
    """One joint after the other, as legs are often recorded: only a joint that never moves is refused."""
    t = np.arange(120) * 0.005
    both = np.stack([0.3 * np.sin(9.0 * t), 0.4 * np.sin(7.0 * t)], axis=1)
    logs = []
    for moving in (0, 1):
        q = np.where(np.arange(2) == moving, both, 0.1)
        logs.append(log_of(t, q, q + 0.1 * np.cos(9.0 * t)[:, None]))
    robot = sy.Robot.from_mjcf(arm)
    with pytest.raises(InputError, match='log 1: joint "elbow" stands still'):
        identify_from_positions(robot, logs[0], settings=SETTINGS)
    assert len(identify_from_positions(robot, logs, settings=SETTINGS).logs) == 2


@pytest.mark.data
@pytest.mark.slow
def test_sweeps_of_a_real_leg_robot_are_predicted_from_commands(shared_data):
    """Least squares on differentiated positions, simulated, leaves 6.4 mrad; no friction and rotors 32."""
    folder = shared_data / "go2_encoder_only"
    names = np.genfromtxt(folder / "sweeps_1_4.csv", delimiter=",", max_rows=1, dtype=str)
    one, two = (np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1) for name in ("sweeps_1_4", "sweeps_9_10"))
    parts = [one[one[:, 0] <= 5.8], two, one[one[:, 0] > 5.8]]
    logs = [dict(zip(names.tolist(), part.T, strict=True)) for part in parts]
    settings = {"command": "q_des{}", "kp": 20.0, "kd": 1.5}
    robot = sy.Robot.from_urdf(folder / "go2.urdf")
    found = identify_from_positions(robot, logs[:2], validate=logs[2:], settings=settings, weights="equal")
    assert np.sqrt(np.mean(found.validation_error**2)) < 6.3e-3
    # What its friction leaves is neither of wrong gains nor of a few rows.
    assert not any(remark.startswith(("Do not believe", "Most of what")) for remark in found.remarks)
    # Friction of the calves differs along their travel, which two sweeps tell of two others.
    chosen = identify_from_positions(
        robot, logs[:2], validate=logs[2:], settings=settings, weights="equal", friction="auto"
    )
    assert np.sqrt(np.mean(chosen.validation_error**2)) < 3e-3
    assert all("coulomb_by_position" in chosen.choice.terms[k] for k in (2, 8, 11))
    thighs = found.coulomb[1::3]
    assert ((thighs > 0.15) & (thighs < 0.3)).all()


@pytest.mark.slow
@pytest.mark.parametrize(("every", "told"), [(1, False), (2, True)])
def test_commands_that_changed_between_rows_are_told(arm, monkeypatch, every, told):
    """Of every second command the rotor inertia comes out a fifth too small."""
    monkeypatch.setattr(f"{__name__}.DELAY", 0.0)
    t = np.arange(500) * 0.005
    command = commands(t)
    q = simulated(arm, t, command, step=1e-4)
    q += np.random.default_rng(3).normal(size=q.shape) * 2e-4
    log = log_of(t[::every], q[::every], command[::every])
    found = identify_from_positions(sy.Robot.from_mjcf(arm), log, settings=SETTINGS)
    assert any("commands that pass in lines" in one for one in found.remarks) == told
    assert (abs(found.rotor_inertia[0] / TRUTH[0, 0] - 1.0) > 0.1) == told
