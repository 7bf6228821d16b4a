"""Springs, counterbalances, ripple, tendons and screws: against MuJoCo, closed forms and their own energies."""

import json

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import Cogging, Counterbalance, Screw, Spring, Tendon, term_from_dict
from steelyard.dynamics.terms import is_known_term

CRANE = """<mujoco><option><flag contact="disable"/></option><worldbody><body name="mast">
<joint name="turn" axis="0 1 0" stiffness="12" springref="20" damping="0.3" frictionloss="0.7" armature="0.05"/>
<geom type="box" size="0.1 0.05 0.3" pos="0 0 0.3" mass="4"/>
<body name="jib" pos="0 0 0.6">
<joint name="slide" type="slide" axis="1 0 0" stiffness="60" springref="0.1" damping="2"/>
<geom type="box" size="0.3 0.04 0.04" pos="0.3 0 0" mass="1.5"/>
<body name="hook" pos="0.6 0 0"><joint name="swing" axis="0 1 0" damping="0.05"/>
<geom type="box" size="0.02 0.02 0.1" pos="0 0 -0.1" mass="0.8"/></body></body></body></worldbody>
<tendon><fixed name="cable" stiffness="150" springlength="0.05" damping="3" frictionloss="1.5">
<joint joint="turn" coef="0.2"/><joint joint="slide" coef="-0.5"/></fixed>
<fixed name="belt" damping="0.4"><joint joint="slide" coef="0.3"/><joint joint="swing" coef="0.1"/></fixed></tendon>
</mujoco>"""
VALUES = {
    "Fvj1": 0.3,
    "Fvj2": 2.0,
    "Fvj3": 0.05,
    "Fcj1": 0.7,
    "Ia1": 0.05,
    "Ksj1": 12.0,
    "Ksj2": 60.0,
    "Kt1": 150.0,
    "Fvt1": 3.0,
    "Fct1": 1.5,
    "Fvt2": 0.4,
}
TENDON = Tendon(arms=[[0.2, -0.5, 0.0], [0.0, 0.3, 0.1]], rest=[0.05, 0.0])
CONSERVATIVE = [
    Spring(rest=[0.1, -0.2, 0.3]),
    Counterbalance(fixed=0.8, moving=0.2, aligned=0.3, length=0.5, joints=[1, 3]),
    Counterbalance(fixed=0.3, moving=0.1, gas=-0.4),
    Cogging(harmonics=[2, 7.5], joints=[2]),
    TENDON,
]


def test_torques_are_those_of_mujoco(tmp_path, random):
    """Springs, damping, friction loss and armature of joints, and tendons, in inverse dynamics."""
    mujoco = pytest.importorskip("mujoco")
    path = tmp_path / "crane.xml"
    path.write_text(CRANE)
    terms = (sy.Viscous(), sy.Coulomb(), sy.RotorInertia(), Spring(rest=[np.radians(20.0), 0.1, 0.0]), TENDON)
    model = sy.Model(sy.Robot.from_mjcf(path).with_terms(*terms))
    parameters = np.array(
        [VALUES.get(name, 0.0 if name[0] in "FKIP" else value)
         for name, value in zip(model.parameter_names, model.robot.parameters, strict=True)]
    )  # fmt: skip
    simulator = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(simulator)
    for q, dq, ddq in random.uniform(-1.0, 1.0, (10, 3, 3)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(simulator, data)
        np.testing.assert_allclose(
            model.inverse_dynamics(q, dq, ddq, parameters), data.qfrc_inverse, rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("term", CONSERVATIVE, ids=repr)
def test_torques_are_the_slopes_of_energies(term, random):
    """By complex steps of the energies by each position."""
    still = [0.0] * 3
    for k in range(3):
        q = random.uniform(-1.0, 1.0, 3)
        columns = term.columns(k, q, still, still, np)
        for row in range(3):
            moved = q + 1e-30j * np.eye(3)[row]
            slopes = [float(np.imag(energy)) / 1e-30 for energy in term.potential(k, moved, np)]
            for parameter, column, slope in zip(term.parameters, columns, slopes, strict=True):
                if parameter.symbol not in ("Fvt", "Fct"):
                    assert float(column.get(row, 0.0)) == pytest.approx(slope, rel=1e-12, abs=1e-14)


def test_the_energy_of_a_model_has_that_of_its_terms(random):
    robot = sy.Robot.from_dh([("pi/2", 0.3, 0, "q")] * 3).with_terms(*CONSERVATIVE[:2], *CONSERVATIVE[3:])
    model = sy.Model(robot)
    parameters = random.uniform(0.5, 2.0, model.parameter_count)
    q, step = random.uniform(-1.0, 1.0, 3), 1e-6
    slopes = [
        (model.potential_energy(q + e, parameters) - model.potential_energy(q - e, parameters)) / (2.0 * step)
        for e in step * np.eye(3)
    ]
    own = np.array([0.0 if name[:2] in ("Fv", "Fc") else 1.0 for name in model.parameter_names]) * parameters
    np.testing.assert_allclose(slopes, model.inverse_dynamics(q, [0.0] * 3, [0.0] * 3, own), rtol=1e-6, atol=1e-8)


def test_a_counterbalance_is_the_force_between_two_points(random):
    """The moment of a force along the line between two points, by their positions in the plane."""
    term = Counterbalance(fixed=0.8, moving=0.2, aligned=0.3, length=0.6)
    for q in random.uniform(-3.0, 3.0, 20):
        fixed = 0.8 * np.array([np.cos(0.3), np.sin(0.3)])
        moving = 0.2 * np.array([np.cos(q), np.sin(q)])
        line = fixed - moving
        length = np.linalg.norm(line)
        pull, stiffness = 300.0, 900.0
        force = (pull + stiffness * (length - 0.6)) * line / length  # on the moving point
        moment = moving[0] * force[1] - moving[1] * force[0]  # drives the joint; the motor holds against it
        columns = term.columns(0, [q], [0.0], [0.0], np)
        assert pull * columns[0][0] + stiffness * columns[1][0] == pytest.approx(-moment, rel=1e-12)


def test_the_counterbalance_of_a_heavy_arm(shared_data):
    """The hydraulic cylinder of the KUKA KR300 by the equations of its source, and its 632 N m at rest."""
    source = json.loads((shared_data / "kuka_kr300" / "robot.json").read_text())[
        "hydraulic_counterbalance_of_the_source"
    ]
    area = np.pi * (source["piston_diameter_m"] ** 2 - source["rod_diameter_m"] ** 2) / 4.0
    volume, energy = 2 * 0.00048, 1.01 * 296.8 * 328.0 * 2 * 0.0795  # of the gas; Z R T m
    term = Counterbalance(
        fixed=source["D_m"], moving=source["k_m"], aligned=np.radians(-5.0), length=source["l_m"], gas=volume / area
    )
    q = np.radians(np.linspace(-60.0, 60.0, 25))
    column = term.columns(0, [q], [0.0 * q], [0.0 * q], np)[0][0]
    delta = q + np.radians(5.0)
    s = np.sqrt(0.8**2 + 0.2**2 - 2.0 * 0.8 * 0.2 * np.cos(delta)) - 0.6
    torque = 0.8 * 0.2 * np.sin(delta) / (s + 0.6) * energy / (volume - s * area) * area
    np.testing.assert_allclose(energy / volume * area * column, torque, rtol=1e-12)
    assert torque[12] == pytest.approx(632.0, abs=1.0)


def test_a_screw_is_a_motor_behind_its_ratio(random):
    robot = sy.Robot.from_dh([(0, 0, "q", 0), ("pi/2", 0.3, "q", 0)])
    pitch = np.array([0.02, -0.01])
    screw = sy.Model(robot.with_terms(Screw(pitch=pitch)))
    motor = sy.Model(robot.with_terms(sy.MotorSide(coupling=np.diag(2.0 * np.pi / pitch))))
    parameters = random.uniform(0.1, 1.0, screw.parameter_count)
    dq, ddq = random.normal(size=(2, 2))
    np.testing.assert_allclose(
        screw.drive_torque(dq, ddq, parameters), motor.drive_torque(dq, ddq, parameters), rtol=1e-12
    )


def test_shapes_of_springs_are_kept_and_refused():
    for term in (*CONSERVATIVE, Screw(pitch=0.01)):
        assert term_from_dict(term.to_dict()) == term
        assert is_known_term(term)
    assert Counterbalance(0.8, 0.2).with_shape(aligned=0.1) == Counterbalance(0.8, 0.2, 0.1)
    robot = sy.Robot.from_dh([(0, 0, "q", 0), (0, 0.3, 0, "q")])
    for section, phrase in (
        ({"kind": "counterbalance", "fixed": 0.5, "moving": 0.5}, "same distance from the axis"),
        ({"kind": "counterbalance", "fixed": 0.8, "moving": 0.2, "gas": 0.3}, "must have a volume at every position"),
        ({"kind": "counterbalance", "fixed": 0.8, "moving": 0.2}, "but joint1 slides"),
        ({"kind": "screw", "pitch": 0.0}, "pitch of a screw must not be 0"),
        ({"kind": "screw", "pitch": 0.1}, "but joint2 turns"),
        ({"kind": "cogging", "harmonics": [3, 3]}, "no two of them equal"),
        ({"kind": "tendon", "arms": [[0.0, 0.0]]}, "not all of them 0"),
        ({"kind": "tendon", "arms": [[0.1]]}, "given for 1 joints, but robot has 2"),
    ):
        with pytest.raises(sy.InputError) as caught:
            robot.with_terms(term_from_dict(section))
        assert phrase in str(caught.value)
