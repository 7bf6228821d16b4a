"""Torques of another size than the robot's weight needs leave no error, and every mass is wrong by one factor."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import Spring
from steelyard.identification import examine
from steelyard.identification.next_steps import next_steps
from steelyard.identification.wrong_scale import link_torques

ROWS = [("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), (0, 0.35, 0, "q"), ("pi/2", 0, 0, "q")]
NAMES = ("link1", "link2", "link3", "link4")
CAD = {
    name: sy.Inertia.from_com(mass, com, np.diag([0.02, 0.03, 0.03]))
    for name, mass, com in zip(
        NAMES, (4.0, 3.0, 2.0, 1.0), ((0, 0, -0.1), (-0.2, 0, 0), (-0.15, 0, 0), (0, 0, 0.08)), strict=True
    )
}
TERMS = (sy.Viscous(), sy.Coulomb(), sy.Offset())
TOOL = sy.Inertia.from_com(4.0, (0.0, 0.02, 0.15), 0.01 * np.eye(3))


def robot_of(inertias):
    return sy.Robot.from_dh(ROWS, inertias=inertias, gravity=(0, 0, -9.81)).with_terms(*TERMS)


@pytest.fixture(scope="module")
def motion():
    t = np.arange(3000) / 200.0
    w = np.array([[1.1, 1.7, 2.3, 2.9]])
    phase = w * t[:, None] + [0.3, 1.1, 2.0, 0.1]
    return t, 0.9 * np.sin(phase), 0.9 * w * np.cos(phase), -0.9 * w**2 * np.sin(phase)


def samples_of(motion, factor=1.0, tool=None, weight=1.0):
    """What an arm whose masses are off those of CAD by up to 20 % shows, with its torques times a factor.

    Counterweights on strings would leave it a part of its weight.
    """
    t, q, dq, ddq = motion
    parts = zip(CAD.items(), (0.9, 1.2, 0.8, 1.1), strict=True)
    deviating = {name: sy.Inertia.from_parameters(part * body.parameters) for (name, body), part in parts}
    if tool is not None:
        deviating["link4"] = deviating["link4"] + tool
    model = sy.Model(robot_of(CAD))
    truth = np.array(model.robot.parameters, dtype=float)
    for columns, body in zip(model.link_columns, deviating.values(), strict=True):
        truth[columns] = body.parameters
    truth[np.isnan(truth)] = 0.3
    torque = model.inverse_dynamics(q, dq, ddq, truth, gravity=(0.0, 0.0, -9.81 * weight))
    torque += 0.05 * np.random.default_rng(3).normal(size=q.shape)
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=factor * torque, t=t)


@pytest.mark.slow
@pytest.mark.parametrize(
    "factor", [pytest.param(0.01, marks=pytest.mark.slow), pytest.param(0.3, marks=pytest.mark.slow), 5.0]
)
def test_one_factor_of_all_torques_is_the_first_thing_to_check(motion, factor):
    result = sy.identify(robot_of(CAD), samples_of(motion, factor))
    assert result.scale is not None
    assert result.scale.factor == pytest.approx(factor, rel=0.25)
    assert result.scale.sentence in result.remarks
    first, *others = next_steps(result)
    assert first.reason.startswith(result.scale.sentence)
    assert not others
    # The line mends it: masses are those of the description within what these are wrong by.
    (line,) = [float(one.strip(" []")) for one in first.code.split("gain = ")[1].split(",")][:1]
    assert line == pytest.approx(1.0 / factor, rel=0.25)
    assert result.to_dict()["wrong_scale"]["factor"] == result.scale.factor


@pytest.mark.parametrize("factor", [0.7, 1.0, pytest.param(1.5, marks=pytest.mark.slow)])
def test_masses_as_far_off_as_those_of_cad_are_no_scale(motion, factor):
    assert sy.identify(robot_of(CAD), samples_of(motion, factor)).scale is None


def links(motion, inertias=CAD, **made):
    return link_torques(sy.Model(robot_of(inertias)), [samples_of(motion, **made)])


def test_ratios_are_those_of_the_links_at_the_joints_that_carry_something(motion):
    """They lie between the least and the largest ratio of masses, here 0.8 to 1.2."""
    found = links(motion, factor=3.0)
    assert 1 <= len(found.gravity) <= 3  # nothing of the first axis, which is vertical
    for ratios in (found.gravity, found.inertia):
        assert np.all((ratios > 0.79 * 3) & (ratios < 1.21 * 3))
    assert found.left_by_scale < found.left_by_tool


@pytest.mark.parametrize("constant", [0.0, 0.1])
def test_a_joint_that_reports_no_torque_says_nothing(motion, constant):
    """Without it the others say the same; nothing is divided by what rounding leaves of a constant."""
    samples = samples_of(motion, 5.0)
    torque, used = samples.torque.copy(), np.ones(samples.torque.shape, dtype=bool)
    torque[:, 3], used[:, 3] = constant, False
    model, shown = sy.Model(robot_of(CAD)), {name: getattr(samples, name) for name in ("q", "dq", "ddq")}
    found = link_torques(model, [sy.Samples(torque=torque, **shown)])
    without = link_torques(model, [sy.Samples(torque=torque, mask=used, **shown)])
    np.testing.assert_allclose(found.gravity, without.gravity)
    assert found.left_by_scale == pytest.approx(without.left_by_scale)
    assert found.left_by_tool == pytest.approx(without.left_by_tool, rel=1e-6)


@pytest.mark.slow
def test_a_tool_is_no_scale(motion):
    found = links(motion, tool=TOOL)
    assert found.gravity.min() > 2.0
    assert found.left_by_tool < found.left_by_scale
    assert sy.identify(robot_of(CAD), samples_of(motion, tool=TOOL)).scale is None


def test_few_rows_and_thousands_of_logs_are_looked_at_alike(motion):
    """Of 40 rows nothing is told, and of many logs as much as of one."""
    model, samples = sy.Model(robot_of(CAD)), samples_of(motion, 3.0)
    few = sy.Samples(**{name: getattr(samples, name)[:40] for name in ("q", "dq", "ddq", "torque", "t")})
    found = link_torques(model, [few])
    assert (found.gravity, found.inertia) == (None, None)
    (one, many) = (link_torques(model, [samples] * count).gravity for count in (1, 40))
    assert many == pytest.approx(one, rel=0.02)


@pytest.mark.slow
def test_what_carries_the_links_is_no_scale(motion):
    found = links(motion, weight=0.3)
    assert found.gravity.max() < 0.5
    assert found.inertia.min() > 0.7
    assert sy.identify(robot_of(CAD), samples_of(motion, weight=0.3)).scale is None


@pytest.mark.slow
def test_links_without_masses_may_explain_what_is_too_large_only(motion):
    partly = {name: CAD[name] for name in NAMES[:3]}
    assert sy.identify(robot_of(partly), samples_of(motion, 20.0)).scale is None
    assert sy.identify(robot_of(partly), samples_of(motion, 0.05)).scale.factor < 0.1


def test_a_motion_that_hardly_shows_the_links_tells_no_scale(motion):
    t, *rest = motion
    q, dq, ddq = (0.002 * one for one in rest)
    found = links((t, q, dq, ddq), factor=0.05)
    assert found.gravity is None
    assert found.inertia is None


def test_gravity_that_a_spring_may_take_is_not_told_from_it(motion):
    model = sy.Model(robot_of(CAD).with_terms(*TERMS, Spring()))
    found = link_torques(model, [samples_of(motion, 0.05)])
    assert found.gravity is None or found.gravity == pytest.approx(0.05, rel=0.25)


def recorded(motion, folder, longer, rate=200.0):
    """A log whose rows are further apart than they were."""
    t, q, *_ = motion
    times = {} if rate is None else {"t": t * longer}
    columns = {**times, **{f"q{k + 1}": one for k, one in enumerate(q.T)}}
    torque = samples_of(motion).torque
    np.savez(folder / "log.npz", **columns, **{f"tau{k + 1}": one for k, one in enumerate(torque.T)})
    return folder / "log.npz"


@pytest.mark.slow
@pytest.mark.parametrize("measured", [False, True])
def test_velocities_that_were_measured_tell_a_light_description_from_wrong_times(motion, tmp_path, measured):
    """Moments of inertia that the description has too small take torques as accelerations do: the stamps are right."""
    t, q, dq, ddq = motion
    wide = {name: sy.Inertia.from_com(one.mass, one.com, 25.0 * one.about_com) for name, one in CAD.items()}
    model = sy.Model(robot_of(wide))
    truth = np.where(np.isnan(model.robot.parameters), 0.3, model.robot.parameters)
    torque = model.inverse_dynamics(q, dq, ddq, truth) + 0.05 * np.random.default_rng(3).normal(size=q.shape)
    log = sy.Recording(t=t, q=q, velocity=dq if measured else None, torque=torque).save(tmp_path / "log.csv")
    told = [one.statement for one in examine(log, robot_of(CAD)).findings if "the times look" in one.statement]
    assert len(told) == (not measured)


@pytest.mark.slow
@pytest.mark.parametrize("longer", [0.5, 2.0, 4.0])
def test_rows_that_are_closer_or_further_apart_are_the_first_thing_to_check(motion, tmp_path, longer):
    result = sy.identify(robot_of(CAD), [recorded(motion, tmp_path, longer)])
    assert result.scale.of == "times"
    assert result.scale.factor == longer
    first, *others = next_steps(result)
    assert first.code == f"# divide the times in the log by {longer:g}"
    assert not others
    assert f"{max(longer, 1 / longer):g} times too {'long' if longer > 1 else 'short'}" in first.reason
    (finding,) = [one for one in examine(tmp_path / "log.npz", robot_of(CAD)).findings if one.harm == "wrong"]
    assert finding.statement.startswith("The inertia of the links takes")


@pytest.mark.slow
def test_a_rate_that_is_stated_is_mended(motion, tmp_path):
    log = recorded(motion, tmp_path, 1.0, rate=None)
    result = sy.identify(robot_of(CAD), [log], columns=sy.LogColumns(rate=100.0))
    assert next_steps(result)[0].code == "[log]\nrate = 200"
    assert sy.identify(robot_of(CAD), [log], columns=sy.LogColumns(rate=200.0)).scale is None


@pytest.mark.slow
def test_without_gravity_torques_or_times_may_have_the_wrong_size(motion):
    """A SCARA: every axis is vertical."""
    rows = [("0", 0.4, 0.3, "q"), (0, 0.35, 0, "q")]
    bodies = {name: sy.Inertia.from_com(3.0, (-0.15, 0, 0), 0.02 * np.eye(3)) for name in NAMES[:2]}
    robot = sy.Robot.from_dh(rows, inertias=bodies, gravity=(0, 0, -9.81)).with_terms(*TERMS)
    model = sy.Model(robot)
    t, q, dq, ddq = motion
    q, dq, ddq = q[:, 1:3], dq[:, 1:3], ddq[:, 1:3]
    truth = np.where(np.isnan(model.robot.parameters), 0.3, model.robot.parameters)
    torque = 0.05 * (model.inverse_dynamics(q, dq, ddq, truth) + 0.02 * np.random.default_rng(5).normal(size=q.shape))
    result = sy.identify(robot, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t))
    assert result.scale.factor == pytest.approx(0.05, rel=0.1)
    assert "The inertia of the links takes 0.05" in result.scale.sentence
    assert "the times, which would be 4.5 times too short instead" in result.scale.sentence


def test_doctor_tells_it_and_states_nothing_of_it(motion, tmp_path):
    """As torques of motors in front of gears of 1:50 are."""
    t, q, *_ = motion
    log = sy.Recording(t=t, q=q, torque=samples_of(motion, 0.02).torque).save(tmp_path / "log.csv")
    (finding,) = [one for one in examine(log, robot_of(CAD)).findings if one.kind == "torque scale"]
    assert finding.harm == "wrong"
    assert "Gravity takes 0.019 times" in finding.statement
    assert "`gain = [" in finding.advice
    assert not finding.remedy  # the masses may be wrong instead
