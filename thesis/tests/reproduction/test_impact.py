"""What impossible parameters do: each claim against Pinocchio, NumPy or a possible arm made by hand."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.simulation import Status
from steelyard_thesis.reproduction.effects import (
    States,
    effects,
    guided,
    hangs_unstably,
    held,
    identities,
    reach,
    released,
)
from steelyard_thesis.reproduction.noisy_estimates import cases, random_subject


@pytest.fixture(scope="module")
def arm():
    return random_subject(3)


@pytest.fixture(scope="module")
def gross(arm):
    """Of some estimates of it from torques that are half noise, the one that is worst in most configurations."""
    states = States.random(arm, 100)
    found = [case for case in cases(arm, (1.0,), 6) if case.infeasible]
    return max(found, key=lambda case: effects(arm, case.estimate, states).indefinite)


def standard(subject, base):
    """Standard parameters with these base parameters, near the true ones, so that no mass is zero."""
    K = subject.model.base_parameters().K
    return subject.truth + np.linalg.pinv(K) @ (base - K @ subject.truth)


def in_pinocchio(subject, parameters):
    """Build the same chain of links; Pinocchio does not ask whether they are possible."""
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")
    model = pinocchio.Model()
    parent, fixed = 0, pinocchio.SE3.Identity()
    joints = subject.model.robot.joints
    for joint, columns in zip(joints, subject.model.link_columns, strict=True):
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), fixed * pinocchio.SE3(joint.before), joint.name)
        xx, xy, xz, yy, yz, zz, lx, ly, lz, m = parameters[columns]
        inertia = pinocchio.Inertia.FromDynamicParameters(np.array([m, lx, ly, lz, xx, xy, yy, xz, yz, zz]))
        fixed = pinocchio.SE3(joint.after)
        model.appendBodyToJoint(parent, inertia, fixed)
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    return pinocchio, model, model.createData()


@pytest.mark.slow
def test_effects_are_those_that_pinocchio_tells(arm, gross):
    states = States.random(arm, 200)
    delta = standard(arm, gross.estimate)
    pinocchio, model, data = in_pinocchio(arm, delta)
    _, true_model, true_data = in_pinocchio(arm, arm.truth)
    viscous = delta[[arm.model.parameter_names.index(f"Fvj{k + 1}") for k in range(arm.model.dof)]]
    zero = np.zeros(arm.model.dof)
    least, energy, error, weight, true_weight, swing, true_swing, power = ([] for _ in range(8))
    for q, dq, ddq, torque in zip(states.q, states.dq, states.ddq, states.torque, strict=True):
        matrix = pinocchio.crba(model, data, q)
        matrix = np.triu(matrix) + np.triu(matrix, 1).T
        least.append(np.linalg.eigvalsh(matrix)[0])
        energy.append(pinocchio.computeKineticEnergy(model, data, q, dq))
        bias = pinocchio.rnea(model, data, q, dq, zero)
        error.append(np.linalg.norm(np.linalg.solve(matrix, torque - bias - viscous * dq) - ddq))
        weight.append(pinocchio.computeGeneralizedGravity(model, data, q).copy())
        true_weight.append(pinocchio.computeGeneralizedGravity(true_model, true_data, q).copy())
        swing.append(bias - weight[-1])
        true_swing.append(pinocchio.rnea(true_model, true_data, q, dq, zero) - true_weight[-1])
        power.append(dq @ (viscous * dq))
    found = effects(arm, gross.estimate, states)
    unit = np.sqrt(np.mean(np.sum(states.ddq**2, axis=1)))
    assert found.indefinite == np.mean(np.array(least) < 0.0) > 0.5
    assert found.negative_energy == np.mean(np.array(energy) < 0.0) > 0.0
    assert found.driving_friction == np.mean(np.array(power) < 0.0)
    assert found.acceleration == pytest.approx(np.median(error) / unit, rel=1e-6)
    for value, ours, true in ((found.gravity, weight, true_weight), (found.coriolis, swing, true_swing)):
        expected = np.linalg.norm(np.array(ours) - true) / np.linalg.norm(true)
        assert value == pytest.approx(expected, rel=1e-6)


def test_the_true_parameters_have_no_effects(arm):
    found = effects(arm, arm.base, States.random(arm, 100))
    assert max(found.gravity, found.coriolis, found.torque, found.worst_acceleration) < 1e-9
    assert (found.indefinite, found.negative_energy, found.driving_friction) == (0.0, 0.0, 0.0)
    assert not hangs_unstably(arm, arm.base)


def test_a_possible_arm_has_the_same_gravity_torques(arm, gross):
    """Made by hand: heavy links, first moments that make up for them, and large inertias."""
    model, random = arm.model, np.random.default_rng(4)
    q = random.uniform(-np.pi, np.pi, (200, model.dof))
    zero = np.zeros_like(q)
    delta = standard(arm, gross.estimate)
    regressor = model.regressor(q, zero, zero).reshape(-1, model.parameter_count)
    moments = np.concatenate([columns[6:9] for columns in model.link_columns])
    made = np.zeros(model.parameter_count)
    for columns in model.link_columns:
        made[columns[9]] = 5.0
    made[moments] = np.linalg.lstsq(regressor[:, moments], regressor @ (delta - made), rcond=None)[0]
    for columns in model.link_columns:
        first = made[columns[6:9]]
        made[columns[[0, 3, 5]]] = 1.0 + first @ first  # far more than m |c|², and equal in all directions
        second = 0.5 * (1.0 + first @ first) * np.eye(3)
        pseudo = np.block([[second, first[:, None]], [first[None, :], np.array([[5.0]])]])
        assert np.linalg.eigvalsh(pseudo)[0] > 0.0
    np.testing.assert_allclose(regressor @ made, regressor @ delta, rtol=0, atol=1e-9 * np.abs(regressor @ delta).max())


def test_impossibility_reaches_inertia_and_coriolis_but_not_gravity(arm, gross):
    few = States.random(arm, 30)
    found, corrected = (reach(arm, base, few) for base in (gross.estimate, gross.corrected))
    assert found["gravity"] < 1e-9
    assert found["inertia"] > 0.05
    assert found["Coriolis and centripetal"] > 0.01
    assert max(corrected.values()) < 1e-4


def test_skew_symmetry_and_the_potential_say_nothing(arm, gross):
    assert max(identities(arm, gross.estimate, States.random(arm, 30))) < 1e-6


@pytest.mark.slow
def test_released_the_estimate_runs_away_at_constant_energy_and_its_correction_does_not(arm, gross):
    starts = np.random.default_rng(8).uniform(-np.pi, np.pi, (3, arm.model.dof))
    result = released(arm, [gross.estimate, gross.corrected], starts, 2.0)
    diverged = np.array([status is Status.DIVERGED for status in result.status])
    assert diverged[:3].any()
    assert not diverged[3:].any()
    for run in range(6):
        known = np.isfinite(result.energy[run])
        assert np.ptp(result.energy[run, known]) < 1e-3
        assert (result.kinetic_energy[run, known].min() < -1.0) == (run < 3)
    fastest = np.nanmax(np.linalg.norm(result.dq[3:], axis=-1))
    assert np.linalg.norm(result.final_dq[:3][diverged[:3]], axis=-1).min() > 100.0 * fastest


@pytest.mark.slow
def test_computed_torque_is_positive_feedback_where_the_matrix_is_not_positive_definite(arm, gross):
    """The closed loop about rest, by NumPy: e'' + M⁻¹ M̂ (Kd e' + Kp e) = 0."""
    n = arm.model.dof
    matrix = arm.model.kernel("total_inertia_matrix", base=True)
    q = np.random.default_rng(5).uniform(-np.pi, np.pi, (100, n))
    true_matrices = matrix(q, arm.base).reshape(-1, n, n)
    believed_matrices = [matrix(q, base).reshape(-1, n, n) for base in (gross.estimate, gross.corrected)]
    verdicts = []
    for true, believed in zip(np.tile(true_matrices, (2, 1, 1)), np.concatenate(believed_matrices), strict=True):
        ratio = np.linalg.solve(true, believed)
        loop = np.block([[np.zeros((n, n)), np.eye(n)], [-100.0 * ratio, -20.0 * ratio]])
        verdicts.append((np.linalg.eigvalsh(believed)[0] < 0.0, np.linalg.eigvals(loop).real.max() > 0.0))
    assert len(set(verdicts)) == 2
    assert all(indefinite == unstable for indefinite, unstable in verdicts)
    ended = held(arm, [gross.estimate, gross.corrected, arm.base], q[:2], 1.0)
    stopped = [status is Status.STOPPED for status in ended.status]
    assert any(stopped[:2])
    assert not any(stopped[2:])
    np.testing.assert_allclose(ended.final_q[4:], q[:2] + 0.05, atol=1e-3)


def test_carried_by_true_gravity_the_arm_stays(arm):
    q = np.random.default_rng(6).uniform(-np.pi, np.pi, (2, arm.model.dof))
    np.testing.assert_allclose(guided(arm, [arm.base], q, 1.0).final_q, q, atol=1e-6)


def check_study(result):
    """What the section must say, however it was computed."""
    reached, impossible, errors, uses, feedback, _ = result.tables
    for row in impossible.rows:
        assert all(str(cell).endswith(("→ 0 %", "→ 0")) for cell in row[5:])
    assert all(str(row[2]).endswith("→ 0 %") and str(row[5]).endswith("→ 0 %") for row in uses.rows)
    assert len(errors.rows) == len(uses.rows) == 8
    assert [row[2] for row in reached.rows] == ["0 %, at most 0 %"] * 2
    assert feedback.rows[0][2:] == ("0 %", "0 %")
    assert sum(int(row[1]) for row in feedback.rows) == 4 * sum(int(row[1]) for row in reached.rows)


@pytest.mark.slow
@pytest.mark.skipif(
    (Path(__file__).parents[4] / "shared" / "data").is_dir(),
    reason="test_everything_is_reproduced looks at this section, beside those that need the recordings",
)
def test_the_study_says_what_the_page_says():
    from steelyard_thesis.reproduction import Context
    from steelyard_thesis.reproduction.sections.impact import SECTION

    check_study(SECTION.compute(Context()))
