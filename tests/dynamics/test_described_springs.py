"""Springs and friction of higher powers, written into MJCF and URDF."""

import re

import numpy as np
import pytest
from mjcf_readings import EXACT

import steelyard as sy
from steelyard.dynamics import Offset, PolynomialFriction, Spring
from steelyard.robot import Drives
from steelyard.robot.mjcf_writer import write_mjcf

LIFT = """<mujoco><option><flag contact="disable"/></option><worldbody><body name="arm">
<joint name="turn" axis="0 1 0" damping="0.1" frictionloss="0.2"/><geom type="box" size="0.1 0.05 0.3" pos="0 0 0.3" mass="4"/>
<body name="slider" pos="0 0 0.6"><joint name="slide" type="slide" axis="1 0 0"/>
<geom type="box" size="0.3 0.04 0.04" pos="0.3 0 0" mass="1.5"/></body></body></worldbody></mujoco>"""  # noqa: E501
FOUND = {
    "Fcj1": 0.4,
    "Fvj1": 0.7,
    "Fv2j1": -0.1,
    "Fv3j1": 0.2,
    "Fvj2": 3.0,
    "Fv3j2": 0.5,
    "Ksj1": 12.0,
    "Ksj2": 40.0,
    "Foj1": -3.0,
    "Foj2": 8.0,
}


def estimate_of(robot):
    """An estimate with these numbers, as an identification makes one."""
    model = sy.Model(robot)
    values = {name: 0.0 if name[0] in "FK" else value for name, value in zip(
        model.parameter_names, np.nan_to_num(robot.parameters), strict=True)}  # fmt: skip
    parameters = np.array(list({name: FOUND.get(name, value) for name, value in values.items()}.values()))
    drives = model.drives(parameters)
    empty = np.zeros(0)
    return model, parameters, sy.Estimate(
        method="test", base_names=(), base_expressions=(), base=empty, standard_error=empty,
        joint_names=robot.joint_names,
        relative_error=0.0, row_count=0, condition_number=1.0, parameter_names=model.parameter_names,
        parameters=parameters, **drives.always_told(),
        description={"drives": {name: one.tolist() for name, one in drives.told_where_present().items()}},
    )  # fmt: skip


TERMS = (PolynomialFriction(powers=[0, 1, 2, 3], speed=3.0), Spring(rest=[0.3, -0.1]))


@EXACT
@pytest.mark.parametrize("terms", [TERMS, (*TERMS, Offset())])
def test_mujoco_moves_as_the_estimate_says(tmp_path, random, terms):
    """An offset is where the spring rests: MuJoCo knows no other constant torque."""
    import mujoco

    (tmp_path / "lift.xml").write_text(LIFT)
    model, parameters, estimate = estimate_of(sy.Robot.from_mjcf(tmp_path / "lift.xml").with_terms(*terms))
    estimate.write_description(tmp_path / "lift.xml", tmp_path / "weighed.xml")
    simulator = mujoco.MjModel.from_xml_path(str(tmp_path / "weighed.xml"))
    data = mujoco.MjData(simulator)
    for q, dq, ddq in random.uniform(-2.0, 2.0, (10, 3, 2)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(simulator, data)
        expected = model.inverse_dynamics(q, dq, ddq, parameters)
        np.testing.assert_allclose(data.qfrc_inverse, expected, rtol=1e-9, atol=1e-9)


def test_what_is_no_spring_holds_no_offset(tmp_path):
    (tmp_path / "lift.xml").write_text(LIFT)
    robot = sy.Robot.from_mjcf(tmp_path / "lift.xml")
    drives = Drives.unknown(2).with_known(spring_stiffness=[1e-6, 40.0], spring_rest=[0.0, 0.0], offset=[0.5, -12.0])
    write_mjcf(robot, robot.parameters, drives, tmp_path / "lift.xml", tmp_path / "weighed.xml")
    text = (tmp_path / "weighed.xml").read_text()
    assert 'name="steelyard:offset:turn" data="0.5"' in text
    assert 'stiffness="1e-06" springref="0.0"' in text
    assert 'stiffness="40.0" springref="0.3"' in text  # of a slide, in m
    assert 'name="steelyard:offset:slide" data="0.0"' in text


def test_a_urdf_holds_them_in_an_extension(tmp_path):
    text = """<robot name="lift"><link name="base"/><link name="arm"><inertial><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""
    (tmp_path / "lift.urdf").write_text(text)
    robot = sy.Robot.from_urdf(tmp_path / "lift.urdf").with_terms(PolynomialFriction(powers=[1, 3]), Spring(rest=0.3))
    estimate = estimate_of(robot)[2]
    estimate.write_description(tmp_path / "lift.urdf", tmp_path / "weighed.urdf")
    written = (tmp_path / "weighed.urdf").read_text()
    held = dict(re.findall(r'(\w+)="([^"]*)"', re.search(r"<steelyard:joint .*?/>", written)[0]))
    assert held.pop("name") == "turn"
    assert {key: round(float(value), 9) for key, value in held.items()} == {
        "spring_stiffness": 12.0, "spring_rest": 0.3, "cubic_damping": 0.2,
    }  # fmt: skip
    assert '<dynamics damping="0.7"' in written
    sy.Robot.from_urdf(tmp_path / "weighed.urdf")
