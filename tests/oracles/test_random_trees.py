"""Random trees of joints, written as URDF, against Pinocchio."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import steelyard as sy

pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")

AXES = st.sampled_from(["1 0 0", "0 1 0", "0 0 -1", "0.3 -0.5 0.8", "0 0 1"])
KINDS = st.sampled_from(["revolute", "continuous", "prismatic", "fixed"])


@st.composite
def trees(draw):
    """A URDF of one to seven joints of every kind, with its text."""
    count = draw(st.integers(1, 7))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    text = ['<robot name="tree"><link name="base"/>']
    kinds = []
    for k in range(count):
        kind = draw(KINDS) if k else "revolute"
        kinds.append(kind)
        parent = "base" if k == 0 else draw(st.sampled_from(["base", *(f"link{i}" for i in range(k))]))
        numbers = random.normal(size=9)
        spread = random.uniform(0.01, 0.1, 3)
        inertia = sum(spread) - spread
        x = " ".join(map(repr, map(float, numbers[:3])))
        r = " ".join(map(repr, map(float, numbers[3:6])))
        c = " ".join(map(repr, map(float, numbers[6:])))
        axis = "" if kind == "fixed" else f'<axis xyz="{draw(AXES)}"/>'
        text.append(
            f'<link name="link{k}"><inertial><origin xyz="{c}" rpy="{r}"/><mass value="{random.uniform(0.1, 5)!r}"/>'
            f'<inertia ixx="{inertia[0]!r}" iyy="{inertia[1]!r}" izz="{inertia[2]!r}" '
            f'ixy="0.001" ixz="-0.002" iyz="0"/>'
            f'</inertial></link><joint name="joint{k}" type="{kind}"><parent link="{parent}"/><child link="link{k}"/>'
            f'<origin xyz="{x}" rpy="{r}"/>{axis}<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    return "".join([*text, "</robot>"]).replace("np.float64(", "").replace(")", "")


@settings(max_examples=3)
@given(trees(), st.integers(0, 1000))
def test_random_trees_agree(tmp_path_factory, text, seed):
    compare(tmp_path_factory, text, seed)


@pytest.mark.slow
@settings(max_examples=40)
@given(trees(), st.integers(0, 1000))
def test_many_random_trees_agree(tmp_path_factory, text, seed):
    compare(tmp_path_factory, text, seed)


def compare(tmp_path_factory, text, seed):
    path = tmp_path_factory.mktemp("tree") / "tree.urdf"
    path.write_text(text)
    robot = sy.Robot.from_urdf(path)
    model = sy.Model(robot)
    oracle = pinocchio.buildModelFromXML(text)
    data = oracle.createData()
    random = np.random.default_rng(seed)
    q, dq, ddq = random.normal(size=(3, robot.dof))
    parameters = np.asarray(robot.parameters)
    full, v, a = pinocchio.neutral(oracle), np.zeros(oracle.nv), np.zeros(oracle.nv)
    rows = []
    for k, name in enumerate(robot.joint_names):
        joint = oracle.joints[oracle.getJointId(name)]
        full[joint.idx_q : joint.idx_q + joint.nq] = q[k] if joint.nq == 1 else (np.cos(q[k]), np.sin(q[k]))
        v[joint.idx_v], a[joint.idx_v] = dq[k], ddq[k]
        rows.append(joint.idx_v)
    torque = pinocchio.rnea(oracle, data, full, v, a)[rows]
    inertia = pinocchio.crba(oracle, data, full)
    inertia = (np.triu(inertia) + np.triu(inertia, 1).T)[np.ix_(rows, rows)]
    size = max(1.0, float(np.max(np.abs(torque))))
    np.testing.assert_allclose(model.inverse_dynamics(q, dq, ddq, parameters), torque, rtol=1e-9, atol=1e-10 * size)
    np.testing.assert_allclose(model.regressor(q, dq, ddq) @ parameters, torque, rtol=1e-9, atol=1e-10 * size)
    np.testing.assert_allclose(model.inertia_matrix(q, parameters), inertia, rtol=1e-9, atol=1e-10)
    coriolis = pinocchio.computeCoriolisMatrix(oracle, data, full, v)[np.ix_(rows, rows)]
    ours = model.coriolis_matrix(q, dq, parameters)
    np.testing.assert_allclose(ours, coriolis, rtol=1e-9, atol=1e-10 * size)
    acceleration = model.forward_dynamics(q, dq, torque, parameters)
    np.testing.assert_allclose(acceleration, ddq, rtol=1e-6, atol=1e-6 * np.linalg.cond(inertia) ** 0.5)
    pinocchio.computeJointJacobians(oracle, data, full)
    pinocchio.updateFramePlacements(oracle, data)
    for k, link in enumerate(robot.link_names):
        frame = oracle.getFrameId(link)
        np.testing.assert_allclose(model.pose(q, k), data.oMf[frame].homogeneous, atol=1e-12)
        jacobian = pinocchio.getFrameJacobian(oracle, data, frame, pinocchio.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(model.jacobian(q, link), np.reshape(jacobian, (6, oracle.nv))[:, rows], atol=1e-12)
