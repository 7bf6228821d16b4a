"""Gradients in reverse against complex steps, closed forms and finite differences."""

import numpy as np
import pytest

from steelyard.excitation import MotionLimits
from steelyard.excitation.criterion import CRITERIA, Criterion, Spectrum, make_subset
from steelyard.excitation.motion_constraints import joint_limits, torque_limits
from steelyard.excitation.vjp import CompiledVjp, RegressorInformation


@pytest.fixture
def motion(random):
    return tuple(random.normal(size=(3, 15, 3)))


def test_regressor_by_complex_steps(arm, motion, random):
    function = arm.function("regressor", base=True, sign="smooth")
    width = np.array([0.05])
    back = CompiledVjp(function, {"sign_width": width}, sparse=True)
    known = {"sign_width": np.full((15, 1), 0.05)}
    values = function.evaluate(dict(zip(("q", "dq", "ddq"), motion, strict=True)) | known)
    flat = values["matrix"].reshape(15, -1)[:, back.places]
    np.testing.assert_allclose(back(*motion), flat, atol=1e-12)
    weights = random.normal(size=flat.shape)
    gradients = back.vjp(*motion, weights)
    for k, name in enumerate(("q", "dq", "ddq")):
        for joint in range(3):
            moved = [np.array(part, dtype=complex) for part in motion]
            moved[k][:, joint] += 1e-30j
            given = dict(zip(("q", "dq", "ddq"), moved, strict=True)) | known
            stepped = function.evaluate(given)["matrix"].reshape(15, -1)[:, back.places]
            np.testing.assert_allclose(
                gradients[k][:, joint], (weights * stepped.imag).sum(axis=1) / 1e-30, atol=1e-9, err_msg=name
            )


def test_torques_against_their_closed_form_derivatives(arm, arm_parameters, motion, random):
    function = arm.function("inverse_dynamics")
    weights = random.normal(size=(15, 3))
    ours = CompiledVjp(function, {"parameters": arm_parameters}).vjp(*motion, weights)
    derivatives = arm.inverse_dynamics_derivatives(*motion, arm_parameters)
    for mine, matrices in zip(ours, derivatives, strict=True):
        np.testing.assert_allclose(mine, np.einsum("si,sij->sj", weights, matrices), atol=1e-10)


def test_the_information_of_a_wide_motion_is_the_regressors_own(arm, motion):
    base = arm.base_parameters()
    matrix = arm.regressor(*motion)[:, :, base.independent]
    weights = np.array([1.0, 3.0, 0.2])
    theirs = np.einsum("ski,skj->ij", matrix * weights[:, None], matrix * weights[:, None])
    np.testing.assert_allclose(RegressorInformation.exact(arm, *motion, weights), theirs, atol=1e-10)
    smooth = RegressorInformation(arm, 1e-9, weights).information(*motion)[0]
    np.testing.assert_allclose(15 * smooth, theirs, atol=1e-6)


@pytest.mark.parametrize("kind", CRITERIA)
@pytest.mark.parametrize(
    ("subset", "nuisance"),
    [(None, "unknown"), ("joint3", "unknown"), ("payload", "known"), (("Fvj1", "Ia2"), "unknown")],
)
def test_criteria_by_finite_differences(arm, kind, subset, nuisance, random):
    motion = random.normal(size=(3, 60, 3))
    steps = random.normal(size=motion.shape)
    regressor = RegressorInformation(arm, 0.1, np.array([1.0, 2.0, 0.5]))
    criterion = Criterion(kind, make_subset(arm, subset, nuisance))

    def value(size):
        return criterion.evaluate(Spectrum.of(regressor.information(*(motion + size * steps))[0]), 6.0)[0]

    total, parts = regressor.information(*motion)
    gradients = regressor.vjp(*motion, parts, criterion.evaluate(Spectrum.of(total), 6.0)[1])
    ours = sum(float((g * s).sum()) for g, s in zip(gradients, steps, strict=True))
    h = 1e-4
    theirs = (8 * (value(h) - value(-h)) - (value(2 * h) - value(-2 * h))) / (12 * h)
    assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-9)


def test_limits_by_finite_differences(arm, arm_parameters, arm_limits, motion, random):
    limits = MotionLimits.of(arm.robot.joint_names, **arm_limits, torque=[20, np.inf, 5], power=30, total_power=40)
    constraints = (*joint_limits(limits), *torque_limits(arm, limits, arm_parameters))
    assert [c.name for c in constraints] == [
        "position", "velocity", "acceleration", "torque", "power", "total power",
    ]  # fmt: skip
    steps = random.normal(size=(3, 15, 3))
    for constraint in constraints:
        weights = random.normal(size=(15, len(constraint.labels)))

        def value(size, constraint=constraint, weights=weights):
            moved = [m + size * s for m, s in zip(motion, steps, strict=True)]
            return float((weights * constraint.clearance(*moved)).sum())

        gradients = constraint.vjp(*motion, weights)
        ours = sum(float((g * s).sum()) for g, s in zip(gradients, steps, strict=True))
        assert ours == pytest.approx((value(1e-6) - value(-1e-6)) / 2e-6, rel=1e-5, abs=1e-6), constraint.name
