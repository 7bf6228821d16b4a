"""Excitation on the fly of robots that are far lighter or heavier than their kinematics suggest keeps its limits."""

from dataclasses import replace

import numpy as np
import pytest

import steelyard as sy
from steelyard.estimators.physical_prior import physical_prior
from steelyard.excitation import MotionLimits
from steelyard.identification.default_terms import model_of_estimate
from steelyard.identification.examples import EXAMPLES
from steelyard.identification.saved import parameters_of_description
from steelyard.online import ActiveExcitation
from steelyard.robot import RobotFile
from steelyard.simulation import Measurement, Sensors, simulate

slow = pytest.mark.slow
FACTORS = [1 / 30, 30.0, *(pytest.param(one, marks=slow) for one in (0.1, 0.33, 1.0, 3.0, 10.0))]


def planar_arm(first: float = 0.5, second: float = 0.4) -> sy.Model:
    """Two links in a vertical plane, whose weight acts about both joints."""
    arm = sy.Robot.from_dh([(0, first, 0, "q"), (0, second, 0, "q")], gravity=(0, -9.81, 0))
    return sy.Model(arm.with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia()))


def limits(velocity: float = 2.0) -> dict[str, object]:
    """Torques that a robot of thirty times the masses needs, too."""
    return {"lower": -2.0, "upper": 2.0, "velocity": velocity, "acceleration": 6.0, "torque": [2000.0, 1000.0]}


def truth(factor: float) -> np.ndarray:
    """A third of the masses that the kinematics of the arm suggest, times a factor."""
    upper = sy.Inertia.from_com(3.0, [-0.2, 0.02, 0.0], 0.02 * np.eye(3)).parameters
    lower = sy.Inertia.from_com(1.2, [-0.15, -0.01, 0.0], 0.006 * np.eye(3)).parameters
    return factor * np.concatenate([upper, [0.06, 0.09, 0.005], lower, [0.03, 0.04, 0.002]])


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("start", [[0.2, -0.3], pytest.param([-1.2, 0.6], marks=slow)])
def test_a_robot_of_any_mass_keeps_its_limits(factor: float, start: list[float]) -> None:
    """Until after the first estimate, by which the feedback passes over to another model."""
    excitation = ActiveExcitation(planar_arm(), limits(), starts=1)
    sensors = Sensors(encoder_resolution=2e-5, velocity="none", seed=1)
    result = simulate(planar_arm(), truth(factor), start, [0.0, 0.0], 3.6, excitation, sensors=sensors)
    assert result.status.value == "finished"
    assert np.abs(result.dq).max() <= 2.0
    assert np.abs(result.q).max() <= 2.0
    assert excitation.interruptions == []


@slow
@pytest.mark.parametrize("seed", range(6))
def test_random_arms_of_random_masses_are_caught(seed: int) -> None:
    random = np.random.default_rng([seed, 40])
    model = planar_arm(*random.uniform(0.2, 0.7, 2))
    excitation = ActiveExcitation(model, limits(), starts=1)
    true = truth(float(np.exp(random.uniform(-np.log(30.0), np.log(30.0)))))
    sensors = Sensors(encoder_resolution=2e-5, velocity="none", seed=seed)
    result = simulate(model, true, random.uniform(-1.2, 1.2, 2), [0.0, 0.0], 2.0, excitation, sensors=sensors)
    assert np.abs(result.dq).max() <= 2.0
    assert np.abs(result.q).max() <= 2.0


@pytest.mark.parametrize("factor", [1 / 30, pytest.param(1.0, marks=slow), 30.0])
def test_slow_limits_add_no_swinging_to_the_first_fall(factor: float) -> None:
    """A link that nothing holds falls faster than 0.05 rad/s; feedback that caught it and was doubled swung at 4 rad/s.

    Free, the second link would have 20 rad/s after a second.
    """
    excitation = ActiveExcitation(planar_arm(), limits(0.05), starts=1)
    sensors = Sensors(encoder_resolution=2e-5, velocity="none", seed=1)
    result = simulate(planar_arm(), truth(factor), [0.2, -0.3], [0.0, 0.0], 6.5, excitation, sensors=sensors)
    assert result.status.value == "finished"
    assert np.abs(result.dq[result.t <= 0.3]).max() <= 1.2
    assert np.abs(result.dq[result.t > 0.3]).max() <= 0.1
    # What is learnt of so slow a motion is said to be little: the 2 % that were asked for are far away.
    assert excitation.expected_error > 0.05


@slow
@pytest.mark.parametrize(("name", "factor"), [("panda", 1 / 30), ("z1", 1 / 30), ("z1", 1 / 3), ("ur5", 30.0)])
def test_arms_of_many_joints_keep_their_limits(name: str, factor: float) -> None:
    """Joints whose inertias are coupled: feedback that grew without bound swung a Panda at 79 times its limit."""
    whole = model_of_estimate(None, RobotFile.of(EXAMPLES[name].robot())).without_channels
    bounds = MotionLimits.from_robot(whole.robot)
    bounds = bounds.updated({"velocity": 2.5, "acceleration": 8.0, "torque": list(bounds.torque * max(1, 2 * factor))})
    links = tuple(replace(link, inertia=None, own_inertia=None) for link in whole.robot.links)
    model = sy.Model(replace(whole.robot, links=links))
    excitation = ActiveExcitation(model, bounds, starts=1)
    true = factor * parameters_of_description(whole)
    start = 0.5 * np.add(*bounds.ranges)
    sensors = Sensors(encoder_resolution=2 * np.pi / 2**17, velocity="none", seed=1)
    result = simulate(model, true, start, np.zeros(model.dof), 5.0, excitation, sensors=sensors)
    assert result.status.value == "finished"
    assert np.all(np.abs(result.dq) <= bounds.velocity)
    assert np.all((result.q >= bounds.lower) & (result.q <= bounds.upper))


@pytest.mark.parametrize("factor", FACTORS)
def test_mujoco_agrees_that_a_robot_of_any_mass_is_caught(factor: float) -> None:
    mujoco = pytest.importorskip("mujoco")
    inertias = [f"{size * factor} {size * factor} {size * factor}" for size in (0.02, 0.006)]
    text = f"""<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0" timestep="0.0005" integrator="implicit"/>
    <worldbody><body><joint name="a" axis="0 0 1" damping="{0.06 * factor}" armature="{0.005 * factor}"/>
    <inertial pos="0.3 0.02 0" mass="{3.0 * factor}" diaginertia="{inertias[0]}"/>
    <body pos="0.5 0 0"><joint name="b" axis="0 0 1" damping="{0.03 * factor}" armature="{0.002 * factor}"/>
    <inertial pos="0.25 -0.01 0" mass="{1.2 * factor}" diaginertia="{inertias[1]}"/>
    </body></body></worldbody></mujoco>"""
    robot = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(robot)
    data.qpos[:] = 0.2, -0.3
    excitation, fastest = ActiveExcitation(planar_arm(), limits(), starts=1), 0.0
    for k in range(2000):
        measured = 2e-5 * np.round(data.qpos / 2e-5)
        data.qfrc_applied[:] = excitation.torque(Measurement(0.001 * k, measured, None, None))
        mujoco.mj_step(robot, data, nstep=2)
        fastest = max(fastest, float(np.abs(data.qvel).max()))
    assert 0.0 < fastest <= 2.0
    assert np.abs(data.qpos).max() <= 2.0
    assert excitation.interruptions == []


def test_axes_of_a_gantry_whose_strokes_are_not_told_are_no_grams(tmp_path) -> None:
    """A bridge carries what slides on it; by its kinematics it weighs no less, and is said to be assumed."""
    text = '<robot name="gantry"><link name="base"/>'
    for name, parent, axis in (
        ("bridge", "base", "1 0 0"),
        ("carriage", "bridge", "0 1 0"),
        ("ram", "carriage", "0 0 1"),
    ):
        text += f"""<link name="{name}"/><joint name="to_{name}" type="prismatic"><parent link="{parent}"/>
        <child link="{name}"/><axis xyz="{axis}"/><limit velocity="1" effort="900"/></joint>"""
    (tmp_path / "gantry.urdf").write_text(text + "</robot>")
    prior = physical_prior(sy.Model(sy.Robot.from_urdf(tmp_path / "gantry.urdf")))
    bridge, carriage, ram = prior.masses
    assert bridge >= carriage >= ram > 0.05
    assert set(prior.sources) == {"kinematics"}
