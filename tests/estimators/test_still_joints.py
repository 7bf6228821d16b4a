"""Joints that stand still in all the data keep the friction and the rotors of their description."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.feasibility.constraints import LinearBound

ARM = """<mujoco model="arm"><worldbody>
<body name="upper"><inertial pos="0 0 -0.2" mass="3" diaginertia="0.05 0.05 0.01"/>
<joint name="shoulder" axis="0 1 0" damping="0.1" frictionloss="0.2" armature="0.05"/>
<body name="fore" pos="0 0 -0.4"><inertial pos="0.05 0 -0.1" mass="1" diaginertia="0.01 0.01 0.002"/>
<joint name="elbow" axis="0 1 0" damping="0.45" frictionloss="0.3" armature="0.013"/></body></body></worldbody></mujoco>
"""
TRUE = {"Fvj1": 2.0, "Fcj1": 1.0, "Ia1": 0.3, "Fvj2": 0.7, "Fcj2": 0.5, "Ia2": 0.02}


def identified(source, *constraints):
    """An arm of which only the shoulder moves."""
    model = sy.Model(sy.Robot.from_mjcf(source).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia()))
    truth = np.nan_to_num(np.array(model.robot.parameters))
    for name, value in TRUE.items():
        truth[model.parameter_names.index(name)] = value
    t = np.arange(0.0, 10.0, 0.02)
    q, dq, ddq = (np.column_stack([one, 0 * one]) for one in (np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t)))
    torque = model.inverse_dynamics(q, dq, ddq, truth) + 0.05 * np.random.default_rng(1).normal(size=q.shape)
    info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    return sy.fit(info, sy.FeasibleSet(model, constraints=constraints))


def test_what_no_data_shows_stays_as_it_is_described(tmp_path):
    source, target = tmp_path / "arm.xml", tmp_path / "weighed.xml"
    source.write_text(ARM, encoding="utf-8")
    estimate = identified(source)
    estimate.write_description(source, target)
    shoulder, elbow = sy.Robot.from_mjcf(target).joints
    assert (elbow.damping, elbow.friction, elbow.rotor_inertia) == (0.45, 0.3, 0.013)
    assert (shoulder.damping, shoulder.friction) == pytest.approx((2.0, 1.0), rel=0.05)
    assert 'name="elbow" axis="0 1 0" damping="0.45" frictionloss="0.3" armature="0.013"' in target.read_text("utf-8")
    assert any("Fvj2, Fcj2, Ia2 as in the description" in remark for remark in estimate.remarks)


def test_what_the_user_knows_comes_first(tmp_path):
    source = tmp_path / "arm.xml"
    source.write_text(ARM, encoding="utf-8")
    estimate = identified(source, LinearBound("Fvj2", minimum=0.6, maximum=0.8))
    told = dict(zip(estimate.parameter_names, estimate.parameters, strict=True))
    assert 0.6 <= told["Fvj2"] <= 0.8
    assert told["Fcj2"] == 0.3
