"""Terms: the WAM's additional dynamics against equation 4.9 in matrices, open terms, and refusals."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import term_from_dict


def test_motor_side_is_equation_4_9(wam, random):
    """Evaluate h = f_j + T (f_m(T' dq) + I T' ddq) with plain matrices, and compare."""
    from steelyard.identification.wam import COUPLING

    T = np.array(COUPLING)
    dq, ddq = random.normal(size=(2, 7))
    values = random.uniform(0.1, 1.0, (7, 7))  # row: joint; column: Fvj Fcj Foj Fvm Fcm Fom Iam
    parameters = np.zeros(wam.parameter_count)
    symbols = ("Fvj", "Fcj", "Foj", "Fvm", "Fcm", "Fom", "Iam")
    for k in range(7):
        for symbol, value in zip(symbols, values[k], strict=True):
            parameters[wam.parameter_names.index(f"{symbol}{k + 1}")] = value
    fvj, fcj, foj, fvm, fcm, fom, iam = values.T
    motor = T.T @ dq
    expected = fvj * dq + fcj * np.sign(dq) + foj
    expected += T @ (fvm * motor + fcm * np.sign(motor) + fom + iam * (T.T @ ddq))
    np.testing.assert_allclose(wam.drive_torque(dq, ddq, parameters), expected, rtol=1e-12)
    q = random.normal(size=7)
    np.testing.assert_allclose(wam.inverse_dynamics(q, dq, ddq, parameters), expected, rtol=1e-12)


def test_friction_of_a_joint_that_moves_alone(wam, random):
    parameters = np.zeros(wam.parameter_count)
    names = wam.parameter_names
    parameters[names.index("Fvj2")], parameters[names.index("Fvm2")], parameters[names.index("Fvm3")] = 0.5, 0.2, 0.1
    parameters[names.index("Fcj3")], parameters[names.index("Fcm3")], parameters[names.index("Foj3")] = 0.4, 0.3, 9.0
    drives = wam.drives(parameters)
    damping, friction = drives.damping, drives.friction
    # Thesis table 4.2: joint 2 feels Fvj2 + Fvm2 + Fvm3, joint 3 feels Fvj3 + (Fvm2 + Fvm3) / 1.68².
    assert damping[1] == pytest.approx(0.5 + 0.2 + 0.1)
    assert damping[2] == pytest.approx(0.3 / 1.68**2)
    assert friction[2] == pytest.approx(0.4 + 0.3 / 1.68)
    bare = sy.Model(sy.Robot.from_dh([(0, 0, 0, "q")]))
    assert np.isnan(bare.drives(np.zeros(10)).damping).all()
    assert np.isnan(bare.drives(np.zeros(10)).friction).all()


class Spring(sy.Term):
    """A torsion spring, as a user would write it."""

    kind = "spring"
    parameters = (sy.TermParameter("K", "N·m/rad", "N/m", "stiffness", nonnegative=True),)

    def columns(self, k, q, dq, ddq, algebra):
        return ({k: q[k]},)


def test_a_term_of_the_user_works_everywhere(random):
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")]).with_terms(Spring())
    model = sy.Model(robot)
    assert model.parameter_names[10] == "K1"
    assert "K2" in model.base_parameters().names
    parameters = np.zeros(model.parameter_count)
    parameters[10], parameters[21] = 2.0, 3.0
    q, dq, ddq = random.normal(size=(3, 20, 2))
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    np.testing.assert_allclose(torque, q * [2.0, 3.0], atol=1e-14)
    parameters[10] = -2.0
    verdict = sy.check(sy.FeasibleSet(model), parameters=parameters)
    assert any("K >= 0" in violation.block for violation in verdict.violations)


@pytest.mark.parametrize(
    ("section", "phrase"),
    [
        ({"kind": "viscos"}, 'did you mean "viscous"'),
        ({}, "kind is None"),
        ({"kind": "viscous", "value": 1}, "'value' is no key of it; there are none"),
        ({"kind": "motor_side"}, "lacks 'coupling'; give coupling"),
        ({"kind": "motor_side", "coupling": [[1, 0]]}, "square matrix"),
        ({"kind": "motor_side", "coupling": [[1, 1], [1, 1]]}, "singular"),
        ({"kind": "motor_side", "coupling": [["a", 1], [1, 1]]}, "matrix of numbers"),
    ],
)
def test_what_is_no_term_is_refused(section, phrase):
    with pytest.raises(sy.InputError) as caught:
        term_from_dict(section)
    assert phrase in str(caught.value)


def test_a_coupling_of_another_size_is_refused():
    robot = sy.Robot.from_dh([(0, 0.3, 0, "q")] * 3)
    with pytest.raises(sy.InputError, match="2 x 2, but robot has 3 joints"):
        robot.with_terms(sy.MotorSide(coupling=np.eye(2)))


def test_terms_survive_the_robot_file():
    term = sy.MotorSide(coupling=[[1, 1], [0, 2]])
    assert term_from_dict(term.to_dict()) == term
    assert term_from_dict(sy.Coulomb().to_dict()) == sy.Coulomb()
