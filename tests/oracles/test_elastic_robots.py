"""Robots with elastic joints against MuJoCo with rotors and tendons, equations by hand, and the energy that is kept."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import steelyard as sy
from steelyard.dynamics import ByJoint, Cogging, Coulomb, LoadFriction, Spring, Stribeck, elastic_robot
from steelyard.robot.mjcf_motors import MjcfMotor, add_motors
from steelyard.simulation import MotorControl, at_rest

MJCF = """\
<mujoco model="crane">
  <compiler angle="radian" boundinertia="0.0001"/>
  <default><joint damping="0.4" armature="0.03" range="-2 2"/><tendon frictionloss="3"/></default>
  <worldbody>
    <body name="post" pos="0 0 0.5"><joint name="turn" axis="0 0 1"/>
      <inertial pos="0.1 0.05 0.1" mass="8" diaginertia="0.4 0.5 0.3"/>
      <body name="boom" pos="0.2 0 0.4" euler="0.3 0.1 0"><joint name="lift" axis="0 1 0.2" pos="0.05 0 0" ref="0.2"/>
        <inertial pos="0.3 0 0.02" mass="5" diaginertia="0.05 0.4 0.41"/>
        <body name="ram" pos="0.6 0 0"><joint name="reach" type="slide" axis="1 0 0.1"/>
          <inertial pos="0.1 0.01 0" mass="3" diaginertia="0.02 0.1 0.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="a" joint="turn"/><motor name="b" joint="lift"/><motor name="c" joint="reach"/></actuator>
  <keyframe><key name="home" qpos="0.1 0.5 -0.2" ctrl="1 2 3"/></keyframe>
</mujoco>
"""
NAMES = ("turn", "lift", "reach")
MOTORS = {"turn": MjcfMotor(900.0, 2.0, 0.7, 1.5), "reach": MjcfMotor(4e4, 60.0, 12.0, 30.0)}


@pytest.fixture(scope="module")
def crane(tmp_path_factory):
    """The model in MuJoCo, and ours with its parameters; the second joint stays rigid."""
    folder = tmp_path_factory.mktemp("crane")
    (folder / "rigid.xml").write_text(MJCF)
    robot = sy.Robot.from_mjcf(folder / "rigid.xml").with_terms(sy.Viscous(), sy.RotorInertia())
    add_motors(folder / "rigid.xml", folder / "elastic.xml", MOTORS)
    rigid, model = sy.Model(robot), sy.Model(elastic_robot(robot, list(MOTORS)))
    values = dict(zip(rigid.parameter_names, np.asarray(robot.parameters), strict=True))
    for number, motor in ((1, MOTORS["turn"]), (3, MOTORS["reach"])):
        place = {1: 4, 3: 5}[number]
        values |= {f"Kej{number}": motor.stiffness, f"Dej{number}": motor.transmission_damping}
        values |= {f"Ia{place}": motor.rotor_inertia, f"Fvj{place}": motor.damping}
    delta = np.array([values.get(name, 0.0) for name in model.parameter_names])
    return mujoco.MjModel.from_xml_path(str(folder / "elastic.xml")), model, delta


def test_accelerations_are_those_of_mujoco(crane):
    theirs, model, delta = crane
    assert [theirs.joint(k).name for k in range(5)] == list(model.robot.joint_names)
    data, random = mujoco.MjData(theirs), np.random.default_rng(2)
    for _ in range(20):
        q, dq = random.uniform(-1.0, 1.0, (2, 5))
        q[3:] = q[[0, 2]] + random.uniform(-0.02, 0.02, 2)
        drive = random.uniform(-30.0, 30.0, 3)
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, dq, drive
        mujoco.mj_forward(theirs, data)
        torque = np.array([0.0, drive[1], 0.0, drive[0], drive[2]])  # those of elastic joints act at their motors
        found = model.forward_dynamics(q, dq, torque, delta)
        np.testing.assert_allclose(found, data.qacc, rtol=1e-7, atol=1e-6)
        np.testing.assert_allclose(model.inverse_dynamics(q, dq, data.qacc, delta), torque, atol=1e-5)


def test_laws_of_friction_and_ripple_act_at_motors_and_springs_at_links_also_where_one_term_has_all_of_them():
    laws = ByJoint([Stribeck(0.2, joints=[1]), Cogging([3.0], joints=[1]), Spring(joints=[2]), Coulomb(), sy.Viscous()])
    robot = sy.Robot.from_dh([(0, 0.3, 0, "q"), (0, 0.2, 0, "q")]).with_terms(laws)
    model = sy.Model(elastic_robot(robot, ["joint1", "joint2"]))
    numbers = {"Fsj3": 2.0, "Fcj3": 1.0, "Fvj3": 0.5, "Fcj4": 0.7, "Ksj2": 8.0, "Tc1j3": 0.4, "Ts1j3": 0.2}
    assert set(numbers) <= set(model.parameter_names)
    delta = [numbers.get(name, 0.0) for name in model.parameter_names]
    q, dq = np.array([0.3, -0.4, 0.5, 0.1]), np.array([0.2, 0.1, 0.15, -0.3])
    ripple = 0.4 * np.cos(3 * 0.5) + 0.2 * np.sin(3 * 0.5)
    motor = 0.5 * 0.15 + 1.0 + 2.0 * np.exp(-((0.15 / 0.2) ** 2)) + ripple
    found = model.inverse_dynamics(q, dq, np.zeros(4), delta)
    np.testing.assert_allclose(found, [0.0, 8.0 * -0.4, motor, -0.7], atol=1e-12)


def test_friction_by_the_load_acts_at_the_motor_by_the_weight_of_the_links():
    link = sy.Inertia.from_com(mass=2.0, com=(0.2, 0.0, 0.0), about_com=0.01 * np.eye(3))
    robot = sy.Robot.from_dh([(0, 0.3, 0, "q")], gravity=(0, -9.81, 0), inertias={"link1": link})
    model = sy.Model(elastic_robot(robot.with_terms(LoadFriction()), ["joint1"]))
    delta = [0.1 * (name == "Flj2") for name in model.parameter_names]
    found = model.inverse_dynamics([0.5, 0.6], [0.3, -0.2], [0.0, 0.0], delta)
    np.testing.assert_allclose(found, [0.0, -0.1 * 2.0 * 9.81 * 0.5 * np.cos(0.6)], atol=1e-12)


def test_a_keyframe_has_its_motors_where_their_joints_are(crane):
    theirs, _, _ = crane
    np.testing.assert_array_equal(theirs.key_qpos[0], [0.1, 0.5, -0.2, 0.1, -0.2])
    np.testing.assert_array_equal(theirs.key_ctrl[0], [1, 2, 3])


def test_a_motor_begins_where_its_joint_does_and_has_the_bound_of_its_force(tmp_path):
    """Both stand in a class here: a spring that is bent at first, or a drive without bound, is another robot."""
    text = (
        '<mujoco><default><joint ref="10" actuatorfrcrange="-5 5"/></default><worldbody><body name="leaf">'
        '<joint name="hinge"/><inertial pos="0.3 0 0" mass="2" diaginertia="0.1 0.1 0.1"/></body></worldbody>'
        '<actuator><motor joint="hinge"/></actuator><sensor><jointactuatorfrc joint="hinge"/></sensor></mujoco>'
    )
    (tmp_path / "rigid.xml").write_text(text)
    add_motors(tmp_path / "rigid.xml", tmp_path / "elastic.xml", {"hinge": MjcfMotor(500.0, 1.0, 0.1)})
    found = []
    for name in ("rigid", "elastic"):
        theirs = mujoco.MjModel.from_xml_path(str(tmp_path / f"{name}.xml"))
        data = mujoco.MjData(theirs)
        data.ctrl[:] = 100.0
        mujoco.mj_forward(theirs, data)
        found.append((data.sensordata[0], data.qfrc_actuator[-1], data.qpos.tolist()))
        assert np.all(data.qfrc_passive == 0.0)
    (rigid, one, (start,)), (elastic, other, starts) = found
    assert (rigid, one) == (elastic, other) == (5.0, 5.0)
    np.testing.assert_allclose(starts, start, rtol=1e-14)


@pytest.mark.slow
def test_energy_is_kept_without_damping_and_lost_with_it(crane):
    _, model, delta = crane
    names = list(model.parameter_names)
    kept = np.where([name.startswith(("Dej", "Fvj")) for name in names], 0.0, delta)
    start = at_rest(model, kept, [0.1, -0.4, 0.05])
    swing = sy.simulate(model, kept, start, np.array([1.0, 0.5, 0.1, -1.0, 0.0]), 2.0)
    assert np.ptp(swing.energy) < 1e-6 * np.ptp(swing.kinetic_energy)
    assert np.ptp(swing.q[:, 0] - swing.q[:, 3]) > 0.01  # the joint bends
    lost = sy.simulate(model, delta, start, np.array([1.0, 0.5, 0.1, -1.0, 0.0]), 2.0, rate=4000.0)
    assert lost.energy[-1] < lost.energy[0] - 0.1
    np.testing.assert_allclose(lost.energy + lost.dissipated, lost.energy[0], atol=2e-3 * np.ptp(lost.energy))


def test_a_swing_is_that_of_the_equations_of_two_masses_and_of_a_pendulum():
    """Spong's equations of one joint, written by hand and integrated by SciPy."""
    inertia, weight, stiffness, damping, rotor, viscous, spring = 0.6, 5.0, 700.0, 1.5, 0.3, 0.8, 40.0
    robot = sy.Robot.from_dh([(0, 0.0, 0, "q")], gravity=(0, -9.81, 0))
    model = sy.Model(elastic_robot(robot.with_terms(sy.Viscous(), Spring(rest=0.2)), [1]))
    values = {"Lzz1": inertia, "lx1": weight / 9.81, "m1": 1.0, "Kej1": stiffness, "Dej1": damping, "Ksj1": spring}
    values |= {"Fvj2": viscous, "Ia2": rotor}
    delta = np.array([values.get(name, 0.0) for name in model.parameter_names])

    def rate(t, state):
        q, theta, dq, dtheta = state
        carried = stiffness * (theta - q) + damping * (dtheta - dq)
        link = (carried - weight * np.cos(q) - spring * (q - 0.2)) / inertia  # the spring holds the link
        return [dq, dtheta, link, (3.0 * np.sin(9.0 * t) - viscous * dtheta - carried) / rotor]

    start = at_rest(model, delta, [0.3])
    np.testing.assert_allclose(start[1] - 0.3, (weight * np.cos(0.3) + spring * 0.1) / stiffness, rtol=1e-9)
    t = np.linspace(0.0, 1.5, 16)
    wanted = solve_ivp(rate, (0.0, 1.5), [*start, 0.0, 0.0], t_eval=t, rtol=1e-10, atol=1e-12).y.T
    found = sy.simulate(
        model, delta, start, [0.0, 0.0], 1.5, lambda t, q, dq: np.array([0.0, 3.0 * np.sin(9.0 * t)]), rate=10.0
    )
    np.testing.assert_allclose(np.column_stack([found.q, found.dq]), wanted, atol=1e-5)


@pytest.mark.slow
def test_a_controller_sees_motors_and_drives_them(crane):
    """A motor that is held lets its link swing by the transmission alone."""
    _, model, delta = crane

    class Holder:
        sample_time = 0.0005

        def start(self, measurement):
            self.at = measurement.q.copy()
            assert measurement.q.shape == (3,)

        def torque(self, measurement):
            return [3e4, 3e4, 3e6] * (self.at - measurement.q) - [3e2, 3e2, 1e4] * measurement.dq

    start = at_rest(model, delta, [0.1, -0.4, 0.05])
    start[0] += 0.05
    held = sy.simulate(model, delta, start, np.zeros(5), 3.0, MotorControl(Holder(), model))
    assert np.ptp(held.q[:, 3]) < 0.004
    swings = np.diff(np.sign(held.q[:, 0] - held.q[-200:, 0].mean()))
    assert np.count_nonzero(swings) > 4
    assert np.all(held.torque[:, [0, 2]] == 0.0)


def test_what_is_no_elastic_robot_is_refused(crane):
    _, model, delta = crane
    with pytest.raises(sy.InputError, match="has elastic joints already"):
        elastic_robot(model.robot, ["lift"])
    rigid = sy.Robot.from_dh([(0, 0.3, 0, "q")])
    with pytest.raises(sy.InputError, match="'elbow' is no joint of robot that could be elastic"):
        elastic_robot(rigid, ["elbow"])
    with pytest.raises(sy.InputError, match="must be named, each once"):
        elastic_robot(rigid, [1, "joint1"])
    soft = np.where([name.startswith("Kej") for name in model.parameter_names], 0.0, delta)
    with pytest.raises(sy.InputError, match="Kej1 must be positive"):
        at_rest(model, soft, np.zeros(3))
