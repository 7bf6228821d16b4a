"""The smooth sign of Coulomb friction, and the inertia of links and rotors, against formulas."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification.wam import true_parameters, wam_model

WIDTH = np.array([0.05])


@pytest.fixture(scope="module")
def wam():
    return wam_model()


@pytest.fixture(scope="module")
def motion():
    q, dq, ddq = np.random.default_rng(5).normal(size=(3, 40, 7))
    return q, dq, ddq


def test_friction_is_that_of_the_formula(wam, motion):
    """Thesis eq. 4.10 and 4.11, written once more, with v / sqrt(v² + w²) for the sign."""
    _, dq, ddq = motion
    delta = true_parameters()
    coupling = next(t for t in wam.robot.terms if t.kind == "motor_side").coupling
    of = {name: delta[wam.parameter_names.index(name)] for name in wam.parameter_names}
    column = {
        s: np.array([of[f"{s}{k}"] for k in range(1, 8)]) for s in ("Fvj", "Fcj", "Foj", "Fvm", "Fcm", "Fom", "Iam")
    }

    def smooth(v):
        return v / np.sqrt(v**2 + WIDTH**2)

    motor = dq @ coupling
    own = column["Fvj"] * dq + column["Fcj"] * smooth(dq) + column["Foj"]
    motors = column["Fvm"] * motor + column["Fcm"] * smooth(motor) + column["Fom"] + column["Iam"] * (ddq @ coupling)
    expected = own + motors @ coupling.T
    ours = wam.kernel("drive_torque", sign="smooth")(np.zeros_like(dq), dq, ddq, delta, WIDTH)
    np.testing.assert_allclose(ours, expected, rtol=1e-12, atol=1e-13)


def test_forward_dynamics_undoes_inverse_dynamics(wam, motion):
    q, dq, ddq = motion
    delta = true_parameters()
    tau = wam.kernel("inverse_dynamics", sign="smooth")(q, dq, ddq, delta, WIDTH)
    assert np.abs(tau - wam.inverse_dynamics(q, dq, ddq, delta)).max() > 1e-3
    back = wam.kernel("forward_dynamics", sign="smooth")(q, dq, tau, delta, WIDTH)
    np.testing.assert_allclose(back, ddq, rtol=1e-9, atol=1e-9)


def test_a_narrow_sign_is_the_exact_one(wam, motion):
    q, dq, ddq = motion
    delta = true_parameters()
    narrow = wam.kernel("inverse_dynamics", sign="smooth")(q, dq, ddq, delta, np.array([1e-9]))
    np.testing.assert_allclose(narrow, wam.inverse_dynamics(q, dq, ddq, delta), rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_derivative_by_velocity_holds_the_slope_of_the_sign(wam, motion):
    q, dq, ddq = (array[:3] for array in motion)
    delta = true_parameters()
    torque = wam.kernel("inverse_dynamics", sign="smooth")
    flat = wam.kernel("inverse_dynamics_derivatives", sign="smooth")(q, dq, ddq, delta, WIDTH)
    by_dq = flat.reshape(3, 3, 7, 7)[:, 1]
    step = 1e-6
    for k in range(7):
        move = step * np.eye(7)[k]
        difference = torque(q, dq + move, ddq, delta, WIDTH) - torque(q, dq - move, ddq, delta, WIDTH)
        np.testing.assert_allclose(by_dq[:, :, k], difference / (2.0 * step), rtol=1e-6, atol=1e-6)


def test_functions_without_friction_keep_their_arguments(wam):
    assert [a.name for a in wam.function("gravity", sign="smooth").arguments] == ["q", "parameters"]
    assert wam.function("regressor", sign="smooth").arguments[-1].name == "sign_width"
    with pytest.raises(sy.InputError, match="sign must be 'exact' or 'smooth', got 'tight'"):
        wam.function("regressor", sign="tight")


def test_total_inertia_is_what_torques_change_by(wam, motion):
    q, dq, ddq = (array[:5] for array in motion)
    delta = true_parameters()
    columns = [
        wam.inverse_dynamics(q, dq, ddq + unit, delta) - wam.inverse_dynamics(q, dq, ddq, delta) for unit in np.eye(7)
    ]
    np.testing.assert_allclose(wam.total_inertia_matrix(q, delta), np.stack(columns, axis=-1), atol=1e-11)


def test_a_link_of_the_base_does_not_move(tmp_path):
    text = """<robot name="door"><link name="wall"/><link name="frame"/><link name="leaf"/>
    <joint name="screw" type="fixed"><parent link="wall"/><child link="frame"/></joint>
    <joint name="hinge" type="revolute"><parent link="frame"/><child link="leaf"/><axis xyz="0 0 1"/></joint></robot>"""
    path = tmp_path / "door.urdf"
    path.write_text(text)
    model = sy.Model(sy.Robot.from_urdf(path))
    with pytest.raises(sy.InputError, match="'frame' of door does not move"):
        model.pose(np.zeros(1), "frame")
