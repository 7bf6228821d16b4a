"""What a description cannot hold is said, with what a simulation without it would miss; every format is written."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.cli.terminal import show_identification
from steelyard.identification.next_steps import found
from steelyard.report import save_results
from steelyard.report.head import head, remarks
from steelyard.robot import RobotFile

BODY = """<inertial><mass value="{}"/><origin xyz="0.2 0.01 0"/>
<inertia ixx=".02" ixy="0" ixz="0" iyy=".06" iyz="0" izz=".06"/></inertial>"""
URDF = f"""<robot name="arm"><link name="base"/>
<link name="upper">{BODY.format(3)}</link><link name="fore">{BODY.format(2)}</link>
<joint name="one" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="two" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
</joint></robot>"""
INERTIAL = """<inertial><pose>0.2 0.01 0 0 0 0</pose><mass>{}</mass><inertia><ixx>.02</ixx><iyy>.06</iyy><izz>.06</izz>
</inertia></inertial>"""
SDF = f"""<sdf version="1.6"><model name="arm"><link name="base"/>
<link name="upper">{INERTIAL.format(3)}</link><link name="fore"><pose>0.4 0 0 0 0 0</pose>{INERTIAL.format(2)}</link>
<joint name="one" type="revolute"><parent>base</parent><child>upper</child><axis><xyz>0 1 0</xyz></axis></joint>
<joint name="two" type="revolute"><parent>upper</parent><child>fore</child><axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>"""
TERMS = "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in ("viscous", "coulomb", "offset", "rotor_inertia"))


@pytest.mark.parametrize(("suffix", "text"), [("urdf", URDF), pytest.param("sdf", SDF, marks=pytest.mark.slow)])
def test_what_a_simulation_would_miss_is_said(tmp_path, suffix, text, capsys):
    (tmp_path / f"arm.{suffix}").write_text(text)
    (tmp_path / "robot.toml").write_text(f'[description]\nfile = "arm.{suffix}"\n{TERMS}')
    model = sy.Model.load(tmp_path / "robot.toml")
    truth = dict(zip(model.parameter_names, model.robot.parameters, strict=True))
    truth |= {"Fvj1": 0.5, "Fvj2": 0.3, "Fcj1": 0.4, "Fcj2": 0.2, "Foj1": 1.5, "Foj2": -0.8, "Ia1": 0.4, "Ia2": 0.3}
    parameters = np.array(list(truth.values()))
    t = np.arange(0.0, 20.0, 0.005)
    phase = t[:, None] * np.array([2.0, 3.1])
    q = np.sin(phase) + 0.4 * np.sin(2.3 * phase)
    rate = np.array([2.0, 3.1])
    dq = rate * (np.cos(phase) + 0.92 * np.cos(2.3 * phase))
    ddq = -(rate**2) * (np.sin(phase) + 0.4 * 2.3**2 * np.sin(2.3 * phase))
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    torque += np.random.default_rng(2).normal(scale=0.02, size=torque.shape)
    log = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "tau1": torque[:, 0], "tau2": torque[:, 1]}
    result = sy.identify(tmp_path / "robot.toml", log)
    (said,) = [remark for remark in result.remarks if "has no place for" in remark]
    assert f"The format of arm.{suffix} has no place for rotor inertia and torque offsets" in said
    # Rotors and offsets are known apart, so that the share is that of the true ones.
    lost = np.where([name[:2] in ("Fo", "Ia") for name in truth], parameters, 0.0)
    missed = model.inverse_dynamics(q, dq, ddq, lost)
    share = np.sqrt((missed**2).sum() / (torque**2).sum())
    told = float(said.partition("misses ")[2].partition("%")[0])
    assert told == pytest.approx(100 * share, rel=0.15)
    # Of joint two its link has 0.06 + 2 · 0.2² kg·m², and its rotor 0.3; of joint one the links have more than half.
    kept = said.partition("part of their inertia (two ")[2].partition("%)")[0]
    assert float(kept) == pytest.approx(100 * 0.14 / 0.44, abs=2.0)
    # It is more than 5 % of the torques, so that it stands where everybody looks, and once.
    assert share > 0.1
    assert found(result)[-1] == said
    page = str(head(result)) + str(remarks(result))
    assert page.count("has no place for rotor inertia") == 1
    show_identification(result)
    assert capsys.readouterr().out.count("has no place for rotor inertia") == 1
    save_results(result, tmp_path / "result", force=True)
    again = RobotFile.load(tmp_path / "result" / f"robot.{suffix}")
    values = dict(zip(result.estimate.parameter_names, result.estimate.parameters, strict=True))
    assert [joint.rotor_inertia for joint in again.robot.joints] == [values["Ia1"], values["Ia2"]]
    assert [joint.torque_offset for joint in again.robot.joints] == [values["Foj1"], values["Foj2"]]
    assert {"kind": "rotor_inertia"} in again.terms
    assert f'offset="{float(values["Foj2"])!r}"' in (tmp_path / "result" / f"robot.{suffix}").read_text()


COUPLING = [[1.0, 0.6], [0.0, 1.0]]
DIRECTIONS = '[[terms]]\nkind = "coulomb_by_direction"\n[[terms]]\nkind = "viscous_by_direction"\n'


@pytest.mark.parametrize(
    ("terms", "values", "told"),
    [
        (
            DIRECTIONS,
            {"Fcpj": (2.0, 1.0), "Fcnj": (1.0, 1.6), "Fvpj": (0.5, 0.3), "Fvnj": (0.9, 0.3)},
            "all that coulomb_by_direction and viscous_by_direction can say",
        ),
        (
            f'[[terms]]\nkind = "motor_side"\ncoupling = {COUPLING}\n',
            {"Fvm": (0.5, 0.4), "Fcm": (0.7, 1.0), "Fom": (0.3, -0.2), "Iam": (0.2, 0.3)},
            "rotor inertia and torque offsets and all that motor_side can say",
        ),
    ],
)
def test_what_directions_and_couplings_say_beyond_a_joint_alone_is_missed(tmp_path, terms, values, told):
    """Beside the friction of each joint moving alone, by the formulas of the terms in NumPy."""
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "robot.toml").write_text(f'[description]\nfile = "arm.urdf"\n{terms}')
    model = sy.Model.load(tmp_path / "robot.toml")
    truth = dict(zip(model.parameter_names, model.robot.parameters, strict=True))
    truth |= {f"{name}{k + 1}": value for name, each in values.items() for k, value in enumerate(each)}
    t = np.arange(0.0, 20.0, 0.01)
    rate = np.array([2.0, 3.1])
    phase = t[:, None] * rate
    q, dq, ddq = np.sin(phase), rate * np.cos(phase), -(rate**2) * np.sin(phase)
    torque = model.inverse_dynamics(q, dq, ddq, np.array(list(truth.values())))
    torque += np.random.default_rng(2).normal(scale=0.01, size=torque.shape)
    v = {name: np.array(each) for name, each in values.items()}
    if "Fcpj" in v:
        sign = np.where(dq > 0.0, 1.0, -1.0)
        whole = np.where(dq > 0.0, v["Fcpj"] + v["Fvpj"] * dq, -v["Fcnj"] + v["Fvnj"] * dq)
        alone = (v["Fcpj"] + v["Fcnj"]) / 2 * sign + (v["Fvpj"] + v["Fvnj"]) / 2 * dq
    else:
        ratio = np.array(COUPLING)
        motor, turning = dq @ ratio, ddq @ ratio
        whole = (v["Fvm"] * motor + v["Fcm"] * np.sign(motor) + v["Fom"] + v["Iam"] * turning) @ ratio.T
        alone = (ratio**2 @ v["Fvm"]) * dq + (np.abs(ratio) @ v["Fcm"]) * np.sign(dq)
    result = sy.identify(tmp_path / "robot.toml", sy.Samples(q, dq, ddq, torque, t=t))
    (said,) = [remark for remark in result.remarks if "has no place for" in remark]
    assert f"The format of arm.urdf has no place for {told}:" in said
    share = np.sqrt(((whole - alone) ** 2).sum() / (torque**2).sum())
    assert float(said.partition("misses ")[2].partition("%")[0]) == pytest.approx(100 * share, rel=0.03)


@pytest.mark.slow
def test_presliding_leaves_coulomb_friction_in_a_description(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    laws = '[{kind = "dahl", displacement = 0.2}, {kind = "viscous"}]'
    (tmp_path / "robot.toml").write_text(
        f'[description]\nfile = "arm.urdf"\n[[terms]]\nkind = "by_joint"\nlaws = {laws}\n'
    )
    model = sy.Model.load(tmp_path / "robot.toml")
    truth = dict(zip(model.parameter_names, model.robot.parameters, strict=True))
    parameters = np.array(list((truth | {"Fvj1": 0.5, "Fvj2": 0.3, "Fcj1": 4.0, "Fcj2": 2.0}).values()))
    t = np.arange(0.0, 20.0, 0.005)
    rate = np.array([2.0, 3.1])
    phase = t[:, None] * rate
    q, dq, ddq = np.sin(phase), rate * np.cos(phase), -(rate**2) * np.sin(phase)
    u = model.presliding(q, dq)
    torque = model.inverse_dynamics(q, dq, ddq, parameters, channels={"presliding": u})
    torque += np.random.default_rng(2).normal(scale=0.02, size=torque.shape)
    result = sy.identify(tmp_path / "robot.toml", sy.Samples(q, dq, ddq, torque, t=t))
    (said,) = [remark for remark in result.remarks if "has no place for" in remark]
    assert "The format of arm.urdf has no place for dahl" in said
    missed = (u - np.sign(dq)) * np.array([4.0, 2.0])
    told = float(said.partition("misses ")[2].partition("%")[0])
    assert told == pytest.approx(100 * np.sqrt((missed**2).sum() / (torque**2).sum()), rel=0.05)
    save_results(result, tmp_path / "result", force=True)
    again = RobotFile.load(tmp_path / "result" / "robot.urdf").robot
    assert [joint.friction for joint in again.joints] == pytest.approx([4.0, 2.0], rel=0.05)
