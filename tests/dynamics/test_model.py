"""The model against independent mechanics: energy, an explicit DH recursion, MuJoCo, and its own shapes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import steelyard as sy


def dh_transform(alpha, a, d, theta, convention):
    ca, sa, ct, s = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    if convention == "standard":
        return np.array([[ct, -s * ca, s * sa, a * ct], [s, ct * ca, -ct * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
    return np.array([[ct, -s, 0, a], [s * ca, ct * ca, -sa, -sa * d], [s * sa, ct * sa, ca, ca * d], [0, 0, 0, 1]])


def lagrangian(rows, kinds, convention, parameters, gravity):
    """Return energies and momenta by the textbook, with finite differences of DH transforms (no recursion of ours)."""

    def poses(q):
        pose, result = np.eye(4), []
        for (alpha, a, d, theta), kind, value in zip(rows, kinds, q, strict=True):
            row = (alpha, a, d + value, theta) if kind == "prismatic" else (alpha, a, d, theta + value)
            pose = pose @ dh_transform(*row, convention)
            result.append(pose)
        return result

    def masses():
        for p in parameters:
            xx, xy, xz, yy, yz, zz, lx, ly, lz, m = p
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            pseudo = np.zeros((4, 4))
            pseudo[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor
            pseudo[:3, 3] = pseudo[3, :3] = (lx, ly, lz)
            pseudo[3, 3] = m
            yield pseudo

    pseudos = list(masses())

    def mass_matrix(q, h=1e-6):
        """M_ij = sum tr(dT/dq_i J dT/dq_j'), with J the pseudo-inertia (Uicker; Paul 1981)."""
        n = len(q)
        derivatives = []
        for i in range(n):
            e = np.eye(n)[i] * h
            derivatives.append([(b - a) / (2 * h) for a, b in zip(poses(q - e), poses(q + e), strict=True)])
        return np.array(
            [
                [sum(np.trace(x @ J @ y.T) for x, J, y in zip(di, pseudos, dj, strict=True)) for dj in derivatives]
                for di in derivatives
            ]
        )

    def potential(q):
        down = np.append(np.asarray(gravity, dtype=float), 0.0)
        return -sum(down @ pose @ J[:, 3] for pose, J in zip(poses(q), pseudos, strict=True))

    return mass_matrix, potential


@settings(max_examples=settings.default.max_examples // 4)
@given(
    st.lists(
        st.tuples(
            st.floats(-1.5, 1.5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.sampled_from(["revolute", "prismatic"])
        ),
        min_size=1,
        max_size=4,
    ),
    st.sampled_from(["standard", "modified"]),
    st.integers(0, 1000),
)
def test_dh_robots_agree_with_the_lagrangian_textbook(joints, convention, seed):
    random = np.random.default_rng(seed)
    kinds = [kind for *_, kind in joints]
    numeric = [(alpha, a, 0.0, d) if kind == "prismatic" else (alpha, a, d, 0.0) for alpha, a, d, kind in joints]
    rows = [(alpha, a, "q", d) if kind == "prismatic" else (alpha, a, d, "q") for alpha, a, d, kind in joints]
    gravity = (0.5, -3.0, -9.0)
    model = sy.Model(sy.Robot.from_dh(rows, convention=convention, gravity=gravity))
    parameters = random.normal(size=(len(rows), 10))
    mass_matrix, potential = lagrangian(numeric, kinds, convention, parameters, gravity)
    q = random.normal(size=len(rows))
    delta = parameters.ravel()
    size = np.abs(parameters).sum()
    np.testing.assert_allclose(model.inertia_matrix(q, delta), mass_matrix(q), atol=1e-7 * size)
    h = 1e-5
    slope = [(potential(q + e) - potential(q - e)) / (2 * h) for e in np.eye(len(rows)) * h]
    np.testing.assert_allclose(model.gravity(q, delta), slope, atol=1e-6 * size)
    # Along any motion the power of the torques is the rate of the energy.
    dq, ddq = random.normal(size=(2, len(rows)))

    def energy(t):
        at, speed = q + dq * t + ddq * t**2 / 2, dq + ddq * t
        return speed @ model.inertia_matrix(at, delta) @ speed / 2 + potential(at)

    rate = (energy(h) - energy(-h)) / (2 * h)
    assert model.inverse_dynamics(q, dq, ddq, delta) @ dq == pytest.approx(rate, abs=1e-5 * size)


def test_parts_add_up_to_the_whole(wam, random):
    q, dq, ddq = random.normal(size=(3, 50, 7))
    parameters = random.normal(size=wam.parameter_count)
    whole = wam.inverse_dynamics(q, dq, ddq, parameters)
    inertial = np.einsum("sij,sj->si", wam.inertia_matrix(q, parameters), ddq)
    parts = inertial + wam.coriolis(q, dq, parameters) + wam.gravity(q, parameters)
    parts += wam.drive_torque(dq, ddq, parameters)
    np.testing.assert_allclose(whole, parts, atol=1e-11)
    np.testing.assert_allclose(whole, wam.regressor(q, dq, ddq) @ parameters, atol=1e-11)


def test_coriolis_matrix_is_the_christoffel_one(wam, random):
    q, dq = random.normal(size=(2, 5, 7))
    parameters = random.normal(size=wam.parameter_count)
    matrix = wam.coriolis_matrix(q, dq, parameters)
    np.testing.assert_allclose(np.einsum("sij,sj->si", matrix, dq), wam.coriolis(q, dq, parameters), atol=1e-11)
    h = 1e-6
    rate = (wam.inertia_matrix(q + h * dq, parameters) - wam.inertia_matrix(q - h * dq, parameters)) / (2 * h)
    skew = rate - 2.0 * matrix
    np.testing.assert_allclose(skew, -np.swapaxes(skew, 1, 2), atol=1e-7)
    # C is linear in dq, and the torques are symmetric in two velocities: both hold for Christoffel symbols alone.
    other = random.normal(size=dq.shape)
    there = np.einsum("sij,sj->si", wam.coriolis_matrix(q, other, parameters), dq)
    np.testing.assert_allclose(np.einsum("sij,sj->si", matrix, other), there, atol=1e-11)


def test_forward_dynamics_undoes_inverse_dynamics(wam, random):
    """Rotors, coupled ones too, belong to the inertia that torques accelerate."""
    from steelyard.identification.wam import true_parameters

    q, dq, ddq = random.normal(size=(3, 20, 7))
    torque = wam.inverse_dynamics(q, dq, ddq, true_parameters())
    np.testing.assert_allclose(wam.forward_dynamics(q, dq, torque, true_parameters()), ddq, atol=1e-8)
    with pytest.raises(sy.InputError, match="inertia matrix of wam is singular"):
        wam.forward_dynamics(q, dq, torque, np.zeros(wam.parameter_count))
    unknown = wam.forward_dynamics(q, dq, torque, true_parameters(), gravity=[np.nan, 0.0, 0.0])
    assert np.isnan(unknown).any()  # not the fault of the parameters


def test_shapes_of_one_sample_and_of_batches(wam):
    q = np.zeros((2, 3, 7))
    parameters = np.zeros(wam.parameter_count)
    assert wam.inverse_dynamics(q, q, q, parameters).shape == (2, 3, 7)
    assert wam.inverse_dynamics(q[0, 0], q[0, 0], q[0, 0], parameters).shape == (7,)
    assert wam.regressor(q, q[0, 0], q[0]).shape == (2, 3, 7, 119)
    assert wam.inertia_matrix(q, parameters).shape == (2, 3, 7, 7)
    assert wam.pose(q, "link7").shape == (2, 3, 4, 4)
    assert wam.inverse_dynamics(q[:0], q[:0], q[:0], parameters).shape == (0, 3, 7)


@pytest.mark.parametrize(
    ("call", "phrase"),
    [
        (
            lambda m: m.gravity(np.zeros(6), np.zeros(119)),
            "wam has 7 joints: expected arrays of shape (..., 7), got (6,)",
        ),
        (lambda m: m.gravity(np.zeros(7), np.zeros(118)), "wam has 119 parameters: expected shape (119,), got (118,)"),
        (lambda m: m.gravity(np.zeros(7) + 1e-20j, np.zeros(119)), "wam must be real numbers, got an array of complex"),
        (lambda m: m.gravity(np.zeros(7), 1j * np.zeros(119)), "or an estimate, got an array of complex128"),
        (lambda m: m.gravity(["0"] * 7, np.zeros(119)), "The motion of wam must be real numbers, got ['0', '0'"),
        (lambda m: m.jacobian(np.zeros(7), 0, "xyz"), "coordinates of a point of wam must be real numbers, got 'xyz'"),
        (lambda m: m.pose(np.zeros(7), "hand"), '"wam" has no link "hand"'),
        (lambda m: m.jacobian(np.zeros(7), 7), "wam has moving links 0 to 6, got 7"),
        (lambda m: m.operation_count("mass"), "There is no function 'mass'"),
        (lambda m: m.function("gravity", base=True, gravity="argument"), "hold for the robot's own gravity"),
        (lambda m: m.function("gravity(link1)"), "is about the whole robot"),
        (lambda m: m.function("gravity", gravity="none"), "must be 'fixed' or 'argument', got 'none'"),
        (lambda m: m.function("inverse_dynamic"), 'did you mean "inverse_dynamics"'),
        (lambda m: m.conditions("weak"), "must be 'full' or 'inertia', got 'weak'"),
        (lambda m: m.regressor(np.zeros((2, 7)), np.zeros((3, 7)), np.zeros(7)), "do not fit each other"),
    ],
)
def test_wrong_arguments_are_told(wam, call, phrase):
    with pytest.raises(sy.InputError) as caught:
        call(wam)
    assert phrase in str(caught.value)


def test_fewer_operations_than_sympybotics(wam):
    """SymPyBotics, squares counted: inverse dynamics 1051, regressor 2301 for the rigid WAM."""
    rigid = sy.Model(wam.robot.with_terms())
    inverse, regressor = rigid.operation_count("inverse_dynamics"), rigid.operation_count("regressor")
    assert inverse["mul"] + inverse["add"] < 0.75 * 1051
    assert regressor["mul"] + regressor["add"] < 0.70 * 2301
    assert rigid.operation_count("regressor", base=True)["mul"] < regressor["mul"]


def test_mimic_joints_follow(tmp_path):
    """A parallel gripper: two sliding fingers on one coordinate weigh twice as much as one."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo (the oracle) is not installed")
    finger = (
        '<link name="{0}"><inertial><mass value="0.3"/><origin xyz="0.01 0 0.02"/>'
        '<inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    text = (
        '<robot name="gripper"><link name="base"/>'
        + finger.format("left")
        + finger.format("right")
        + '<joint name="a" '
        'type="prismatic"><parent link="base"/><child link="left"/><axis xyz="1 0 0"/><limit lower="0" upper="1" '
        'effort="1" velocity="1"/></joint><joint name="b" type="prismatic"><parent link="base"/><child link="right"/>'
        '<axis xyz="-1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>'
        '<mimic joint="a" multiplier="2" offset="0.1"/></joint></robot>'
    )
    path = tmp_path / "gripper.urdf"
    path.write_text(text)
    robot = sy.Robot.from_urdf(path)
    model = sy.Model(robot)
    assert (robot.dof, len(robot.links)) == (1, 2)
    assert model.inertia_matrix([0.2], robot.parameters)[0, 0] == pytest.approx(0.3 + 4 * 0.3)
    world = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(world)
    data.qpos[:] = [0.2, 0.5]
    mujoco.mj_forward(world, data)
    np.testing.assert_allclose(model.pose([0.2], "left")[:3, 3], data.body("left").xpos, atol=1e-12)
    np.testing.assert_allclose(model.pose([0.2], "right")[:3, 3], data.body("right").xpos, atol=1e-12)
