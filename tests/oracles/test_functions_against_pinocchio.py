"""Every function of the catalogue against Pinocchio, for robots of 1 to 43 joints, and against complex steps."""

from pathlib import Path

import numpy as np
import pytest
from pinocchio_oracle import URDFS, Oracle, pinocchio

import steelyard as sy

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="bob"><inertial><origin xyz="0.1 -0.2 0.4"/>
<mass value="2"/><inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="bob"/><origin xyz="0.1 0.2 0.3" rpy="0.5 -1 2"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
# An arm, one with mimic joints and a prismatic one, trees, and up to 43 joints.
FAST = (
    "TwoDofs",
    "finger_edu",
    "ur5_robot",
    "xarm7",
    "solo12",
    "tiago_no_hand",
)
SLOW = (
    "baxter",
    "tiago_pro",
    "human",
    "g1_29dof_with_hand_rev_1_0",
)
POINT = np.array([0.1, -0.2, 0.3])
EXACT = 1e-9


def urdf(name, folder):
    if name == "pendulum.urdf":
        path = Path(folder) / name
        path.write_text(PENDULUM)
        return path
    found = [path for path in URDFS if path.name == name]
    if not found:
        pytest.skip(f"{name} of example-robot-data is not installed")
    return found[0]


class Case:
    """A robot at a random state, and Pinocchio's view of it."""

    def __init__(self, path):
        self.robot = sy.Robot.from_urdf(path)
        self.model = sy.Model(self.robot)
        self.oracle = Oracle(path, self.robot)
        random = np.random.default_rng(7)
        self.q, self.dq, self.ddq = random.normal(size=(3, self.robot.dof))
        self.parameters = np.nan_to_num(np.asarray(self.robot.parameters))
        self.tau = self.oracle.torque(self.q, self.dq, self.ddq)
        self.inertia = self.oracle.inertia_matrix(self.q)
        self.full, self.v, self.a = self.oracle.state(self.q, self.dq, self.ddq)

    def reduced(self, matrix):
        velocity, driving = self.oracle.velocity, self.oracle.matrix
        return driving.T @ matrix[np.ix_(velocity, velocity)] @ driving

    def values(self, name, **options):
        """Outputs of a function at the state, by the graph's interpreter: what kernels compile and languages print."""
        function = self.model.function(name, **options)
        given = {
            "q": self.q,
            "dq": self.dq,
            "ddq": self.ddq,
            "tau": self.tau,
            "parameters": self.parameters,
            "point": POINT,
            "gravity": self.robot.gravity,
        }
        if options.get("base"):
            given["base_parameters"] = self.model.base_parameters().values(self.parameters)
        outputs = function.evaluate({a.name: given[a.name] for a in function.arguments})
        return next(iter(outputs.values())) if len(outputs) == 1 else outputs


@pytest.fixture(
    scope="module",
    params=["pendulum", *FAST, *(pytest.param(name, marks=pytest.mark.slow) for name in ("panda", *SLOW))],
)
def case(request, tmp_path_factory):
    return Case(urdf(f"{request.param}.urdf", tmp_path_factory.mktemp("urdf")))


def close(ours, theirs):
    return np.abs(ours - theirs).max() <= EXACT * max(1.0, np.abs(theirs).max())


def test_inverse_dynamics_with_gravity_as_an_argument_and_in_base_parameters(case):
    assert close(case.values("inverse_dynamics"), case.tau)
    assert close(case.values("inverse_dynamics", gravity="argument"), case.tau)
    assert close(case.values("inverse_dynamics", base=True), case.tau)
    assert close(case.values("regressor") @ case.parameters, case.tau)
    base = case.model.base_parameters().values(case.parameters)
    assert close(case.values("regressor", base=True) @ base, case.tau)


def test_gravity_and_coriolis(case):
    gravity = case.oracle.torque(case.q, 0 * case.q, 0 * case.q)
    assert close(case.values("gravity"), gravity)
    matrix = pinocchio.computeCoriolisMatrix(case.oracle.model, case.oracle.data, case.full, case.v)
    assert close(case.values("coriolis_matrix"), case.reduced(matrix))
    assert close(case.values("coriolis"), case.reduced(matrix) @ case.dq)


def test_the_rate_of_the_inertia_matrix_less_twice_the_coriolis_matrix_is_skew(case):
    assert close(case.values("inertia_matrix"), case.inertia)
    function = case.model.function("inertia_matrix")
    step = {"q": case.q + 1e-30j * case.dq, "parameters": case.parameters}
    rate = function.evaluate(step)["matrix"].imag / 1e-30
    difference = rate - 2.0 * case.values("coriolis_matrix")
    assert np.abs(difference + difference.T).max() <= 1e-10 * max(1.0, np.abs(difference).max())


def test_forward_dynamics_by_both_methods(case):
    if np.linalg.cond(case.inertia) > 1e6:
        # Rounding in the torques alone moves such accelerations: compare the torques that they need.
        achieved = case.inertia @ (case.values("forward_dynamics") - case.ddq)
        assert np.abs(achieved).max() < EXACT * np.abs(case.tau).max()
        return
    assert close(case.values("forward_dynamics"), case.ddq)
    if len(case.robot.joints) == case.robot.dof:
        assert close(case.values("forward_dynamics_articulated"), case.ddq)
    else:
        with pytest.raises(sy.InputError, match="mimic joints"):
            case.values("forward_dynamics_articulated")


def test_derivatives_of_inverse_dynamics(case):
    by_q, by_dq, _ = pinocchio.computeRNEADerivatives(case.oracle.model, case.oracle.data, case.full, case.v, case.a)
    ours = case.values("inverse_dynamics_derivatives")
    assert close(ours["by_q"], case.reduced(by_q))
    assert close(ours["by_dq"], case.reduced(by_dq))
    assert close(ours["by_ddq"], case.inertia)


def test_derivatives_by_complex_step(case):
    function = case.model.function("inverse_dynamics")
    ours = case.values("inverse_dynamics_derivatives")
    given = {"q": case.q, "dq": case.dq, "ddq": case.ddq, "parameters": case.parameters}
    for name in ("q", "dq", "ddq"):
        steps = given | {name: given[name] + 1e-30j * np.eye(case.robot.dof)}
        assert close(ours[f"by_{name}"], function.evaluate(steps)["torque"].imag.T / 1e-30)


def test_energies_and_momentum(case):
    oracle, data = case.oracle.model, case.oracle.data
    kinetic = pinocchio.computeKineticEnergy(oracle, data, case.full, case.v)
    potential = pinocchio.computePotentialEnergy(oracle, data, case.full)
    assert close(case.values("kinetic_energy"), np.array(kinetic))
    assert close(case.values("potential_energy"), np.array(potential))
    rows = case.values("energy_regressor")
    assert close(rows["kinetic"] @ case.parameters, np.array(kinetic))
    assert close(rows["potential"] @ case.parameters, np.array(potential))
    base = case.model.base_parameters().values(case.parameters)
    assert close(case.values("energy_regressor", base=True)["kinetic"] @ base, np.array(kinetic))
    there = case.oracle.state(2 * case.q, case.dq, case.ddq)[0]
    rise = pinocchio.computePotentialEnergy(oracle, data, there) - potential
    function = case.model.function("energy_regressor", base=True)
    rows = [function.evaluate({"q": q, "dq": case.dq})["potential"] @ base for q in (case.q, 2 * case.q)]
    assert close(rows[1] - rows[0], np.array(rise))
    momentum = case.inertia @ case.dq
    assert close(case.values("momentum"), momentum)
    assert close(case.values("momentum_regressor") @ case.parameters, momentum)
    assert close(case.values("momentum_regressor", base=True) @ base, momentum)


def test_pose_and_jacobians_of_a_point_of_the_last_and_of_a_middle_link(case):
    for index in {len(case.robot.links) - 1, len(case.robot.links) // 2}:
        name = case.robot.links[index].name
        oracle = case.oracle.model.copy()
        frame = oracle.frames[oracle.getFrameId(name)]
        place = frame.placement * pinocchio.SE3(np.eye(3), POINT)
        target = oracle.addFrame(
            pinocchio.Frame("target", frame.parentJoint, 0, place, pinocchio.FrameType.OP_FRAME), False
        )
        data = oracle.createData()
        pinocchio.computeJointJacobiansTimeVariation(oracle, data, case.full, case.v)
        pinocchio.updateFramePlacements(oracle, data)
        along = pinocchio.LOCAL_WORLD_ALIGNED
        columns, driving = case.oracle.velocity, case.oracle.matrix
        jacobian = pinocchio.getFrameJacobian(oracle, data, target, along).reshape(6, -1)[:, columns] @ driving
        rate = pinocchio.getFrameJacobianTimeVariation(oracle, data, target, along).reshape(6, -1)[:, columns] @ driving
        assert close(case.values(f"pose({name})"), data.oMf[oracle.getFrameId(name)].homogeneous)
        assert close(case.values(f"jacobian({name})"), jacobian)
        assert close(case.values(f"jacobian_rate({name})"), rate)


def test_pose_and_jacobian_of_a_frame_that_is_fixed_to_a_link(case):
    names = [a.name for link in case.robot.links for a in link.attachments]
    if not names:
        pytest.skip(f"{case.robot.name} has no link that is fixed to a moving one")
    oracle, data = case.oracle.model, case.oracle.model.createData()
    for name in {names[0], names[-1]}:
        frame = oracle.getFrameId(name)
        pinocchio.computeJointJacobians(oracle, data, case.full)
        pinocchio.updateFramePlacements(oracle, data)
        along = data.oMf[frame].rotation @ POINT
        of_origin = pinocchio.getFrameJacobian(oracle, data, frame, pinocchio.LOCAL_WORLD_ALIGNED).reshape(6, -1)
        linear = of_origin[:3] - pinocchio.skew(along) @ of_origin[3:]
        jacobian = np.vstack([linear, of_origin[3:]])[:, case.oracle.velocity] @ case.oracle.matrix
        assert close(case.values(f"pose({name})"), data.oMf[frame].homogeneous)
        assert close(case.values(f"jacobian({name})"), jacobian)


def test_computed_torque_is_that_of_the_links(case):
    assert close(case.values("computed_torque"), case.tau)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [{}, {"gravity": "argument", "sign": "smooth"}, {"gravity": "argument"}, {"sign": "smooth"}],
    ids=["plain", "both", "gravity", "sign"],
)
def test_compiled_functions_are_those_of_the_graph(options):
    """The kernels, one robot for all: numbers of the interpreter above."""
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), ("-pi/2", 0.1, 0.1, "q"), (0, 0, "q", 0)])
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia()))
    random = np.random.default_rng(3)
    q, dq, ddq, tau = random.normal(size=(4, 11, 4))
    parameters = np.abs(random.normal(size=model.parameter_count)) + 1.0
    point, gravity = random.normal(size=(2, 3))
    given = {"q": q, "dq": dq, "ddq": ddq, "tau": tau, "parameters": parameters, "point": point, "gravity": gravity}
    given["sign_width"] = np.array([0.1])
    for name in model.functions:
        function = model.function(name, **options)
        expected = function.evaluate({a.name: given[a.name] for a in function.arguments})
        flat = np.concatenate([np.reshape(v, (11, -1)) for v in expected.values()], axis=1)
        ours = model.kernel(name, **options)(*(given[a.name] for a in function.arguments))
        assert np.abs(ours - flat).max() <= 1e-12 * np.abs(flat).max(), name
