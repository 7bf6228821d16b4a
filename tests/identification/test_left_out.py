"""What the tip leaves out of a description is in the estimate of the link that carried it, and in what is written."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification.next_steps import next_steps

BODY = """<inertial><mass value="{}"/><origin xyz="0.2 0.01 0"/>
<inertia ixx=".02" ixy="0" ixz="0" iyy=".06" iyz="0" izz=".06"/></inertial>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>
<axis xyz="0 1 0"/></joint>"""
URDF = f"""<robot name="arm"><link name="base"/>
<link name="upper">{BODY.format(3)}</link><link name="fore">{BODY.format(2)}</link>
<link name="tool">{BODY.format(1)}</link>
{JOINT.format("one", "base", "upper", 0)}{JOINT.format("two", "upper", "fore", 0.4)}
{JOINT.format("held", "upper", "tool", 0.3)}</robot>"""


@pytest.mark.slow
def test_what_is_left_out_and_was_there_is_to_be_locked(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    whole = sy.Robot.from_urdf(tmp_path / "arm.urdf", locked=["held"])
    terms = (sy.Viscous(), sy.Coulomb(), sy.Offset())
    truth = sy.Model(whole.with_terms(*terms))
    t = np.arange(0.0, 20.0, 0.005)
    rate = np.array([2.0, 3.1])
    phase = t[:, None] * rate
    q = np.sin(phase) + 0.4 * np.sin(2.3 * phase)
    dq = rate * (np.cos(phase) + 0.92 * np.cos(2.3 * phase))
    ddq = -(rate**2) * (np.sin(phase) + 0.4 * 2.3**2 * np.sin(2.3 * phase))
    parameters = np.nan_to_num(np.array(truth.robot.parameters))
    torque = truth.inverse_dynamics(q, dq, ddq, parameters)
    torque += np.random.default_rng(2).normal(scale=0.02, size=torque.shape)
    log = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "tau1": torque[:, 0], "tau2": torque[:, 1]}
    of_terms = "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in ("viscous", "coulomb", "offset"))
    gravity = {}
    for name, line in {"tip": 'tip = "fore"', "locked": "locked = { held = 0.0 }"}.items():
        (tmp_path / "robot.toml").write_text(f'[description]\nfile = "arm.urdf"\n{line}\n{of_terms}')
        result = sy.identify(tmp_path / "robot.toml", log)
        steps = [step for step in next_steps(result) if "tip leaves out" in step.action]
        assert len(steps) == (name == "tip")
        if steps:
            assert "held and what moves with them, 1 kg" in steps[0].reason
            assert '[description]\nlocked = { "held" = 0.0 }' in steps[0].code
        result.estimate.write_urdf(tmp_path / "arm.urdf", tmp_path / "out.urdf")
        written = sy.Robot.from_urdf(tmp_path / "out.urdf", locked=["held"])
        gravity[name] = sy.Model(written).gravity(np.zeros(2), written.parameters)[0]
    right = sy.Model(whole).gravity(np.zeros(2), whole.parameters)[0]
    tool = 9.81 * 1.0 * (0.3 + 0.2)
    assert abs(gravity["locked"]) == pytest.approx(abs(right), rel=0.01)
    assert abs(gravity["tip"]) == pytest.approx(abs(right) + tool, rel=0.01)  # of which the step warns


MJCF = """<mujoco><worldbody><body name="upper"><inertial pos="0.2 0.01 0" mass="3" diaginertia=".02 .06 .06"/>
<joint name="one" axis="0 1 0"/><body name="fore" pos="0.4 0 0"><inertial pos="0.2 0.01 0" mass="2"
diaginertia=".02 .06 .06"/><joint name="two" axis="0 1 0" stiffness="20" springref="10"/>
</body></body></worldbody></mujoco>"""


@pytest.mark.slow
def test_springs_of_the_description_are_no_mistake_of_the_log(tmp_path):
    (tmp_path / "arm.xml").write_text(MJCF)
    model = sy.Model(sy.Robot.from_mjcf(tmp_path / "arm.xml"))
    assert [joint.has_spring for joint in model.robot.joints] == [False, True]
    t = np.arange(0.0, 20.0, 0.005)
    rate = np.array([2.0, 3.1])
    phase = t[:, None] * rate
    q = np.sin(phase) + 0.4 * np.sin(2.3 * phase)
    dq = rate * (np.cos(phase) + 0.92 * np.cos(2.3 * phase))
    ddq = -(rate**2) * (np.sin(phase) + 0.4 * 2.3**2 * np.sin(2.3 * phase))
    torque = model.inverse_dynamics(q, dq, ddq, np.array(model.robot.parameters))
    torque[:, 1] += 30.0 * (q[:, 1] - 0.3)
    torque += np.random.default_rng(2).normal(scale=0.02, size=torque.shape)
    log = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "tau1": torque[:, 0], "tau2": torque[:, 1]}
    first = next_steps(sy.identify(tmp_path / "arm.xml", log))[0]
    assert "a spring at two, which the model leaves out" in first.reason
    kinds = "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in ("viscous", "coulomb", "offset"))
    (tmp_path / "robot.toml").write_text(f'[description]\nfile = "arm.xml"\n{kinds}{first.code}\n')
    mended = sy.identify(tmp_path / "robot.toml", log)
    assert mended.prediction.word == "good"
    assert not any("spring" in step.action for step in next_steps(mended))
    told = dict(zip(mended.parameter_names, np.asarray(mended), strict=True))
    assert (told["Ksj2"], told["Foj2"]) == pytest.approx((30.0, -9.0), rel=0.02)
