"""The weight of a prior by cross-validation: its fits against the conic solver, its losses against the samples."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from simulated_arm import blurred, simulated_arm

import steelyard as sy
from steelyard.errors import InputError, SolverError
from steelyard.estimators import ConstantPullbackPrior, EntropicPrior
from steelyard.estimators.cross_validation import cross_validation, term_deviations
from steelyard.estimators.plausible_fit import tried_prior
from steelyard.feasibility import FeasibleSet, SymmetricLink, TotalMass

MOTION = ("q", "dq", "ddq", "torque")
ARM = simulated_arm(3)
CAD = blurred(ARM, 3)


@pytest.fixture(scope="module")
def found():
    prior = EntropicPrior(CAD, term_deviations=term_deviations(ARM.information, ARM.feasible_set))
    return prior, cross_validation(ARM.information, ARM.stretches, ARM.feasible_set, prior)


@pytest.mark.parametrize("kind", [EntropicPrior, ConstantPullbackPrior])
def test_fits_are_those_of_the_conic_solver(kind) -> None:
    prior = kind(CAD, term_deviations=term_deviations(ARM.information, ARM.feasible_set))
    weights = [1.0, 1e3, 1e5]
    ours = cross_validation(ARM.information, ARM.stretches, ARM.feasible_set, prior, prior_weights=weights)
    for weight, parameters in zip(weights, ours.parameters, strict=True):
        theirs = sy.fit(ARM.information, ARM.feasible_set, prior=prior, prior_weight=weight)
        # The barrier moves what the data says little of by less than its standard error.
        error = theirs.standard_error
        assert np.all(np.abs(ARM.feasible_set.K @ parameters - theirs.base) < 0.2 * error)
        np.testing.assert_allclose(parameters[9], theirs.parameters[9], rtol=0.02)


def test_losses_are_those_of_the_samples(found) -> None:
    prior, validation = found
    fold, weight = 2, validation.chosen_index
    others = [s for k, s in enumerate(ARM.stretches) if k != fold]
    training = others[0]
    for stretch in others[1:]:
        training = training + stretch
    # The fit of the others by the conic solver, its torques by the recursion, and the rows of the fold by their order.
    scale = ARM.information.joint_weights("joint")
    fit = sy.fit(training, ARM.feasible_set, weights=scale, prior=prior, prior_weight=validation.weight)
    start = sum(s.count for s in ARM.stretches[:fold]) // 3
    rows = slice(start, start + ARM.stretches[fold].count // 3)
    samples = ARM.samples
    predicted = ARM.model.inverse_dynamics(samples.q[rows], samples.dq[rows], samples.ddq[rows], fit.parameters)
    loss = np.sum((scale * (samples.torque[rows] - predicted)) ** 2)
    reduced = ARM.information.reduced(scale)
    variance = reduced.residual2 / (reduced.count - len(reduced.rho))
    assert validation.losses[fold, weight] == pytest.approx(loss / variance, rel=2e-3)
    assert validation.joint_errors.shape == (15, 3)
    squares = np.sum(validation.joint_errors[weight] ** 2 * scale**2) * samples.count / variance
    assert squares == pytest.approx(validation.losses[:, weight].sum(), rel=1e-6)


def test_largest_weight_within_one_standard_error(found) -> None:
    _, validation = found
    totals = validation.losses.sum(axis=0)
    best, chosen = validation.best_index, validation.chosen_index
    assert totals[best] == totals.min()
    assert chosen >= best
    for index in range(chosen, len(totals)):
        above = validation.losses[:, index] - validation.losses[:, best]
        error = np.std(above, ddof=1) * np.sqrt(len(above))
        assert (totals[index] - totals[best] <= error) == (index == chosen)


@pytest.mark.slow
def test_held_out_error_is_no_worse_than_the_best_of_others() -> None:
    """Against least squares, feasible parameters without a prior, and the prior, on data of another motion."""
    ratios = []
    for seed in range(4, 10):
        arm, other = simulated_arm(seed, size=0.3), simulated_arm(seed, seconds=12.0)
        prior = EntropicPrior(blurred(arm, seed), term_deviations=term_deviations(arm.information, arm.feasible_set))
        weight = cross_validation(arm.information, arm.stretches, arm.feasible_set, prior).weight
        ours = sy.fit(arm.information, arm.feasible_set, prior=prior, prior_weight=weight)
        rivals = (
            sy.least_squares(arm.information).base,
            sy.fit(arm.information, arm.feasible_set).base,
            sy.fit(arm.information, arm.feasible_set, prior=prior, prior_weight=1e9).base,
        )
        best = min(other.information.relative_error(base) for base in rivals)
        ratios.append(other.information.relative_error(ours.base) / best)
    assert np.median(ratios) < 1.1
    assert max(ratios) < 1.3


@pytest.mark.slow
def test_joint_that_stands_still_keeps_no_friction() -> None:
    arm = simulated_arm(5, still=(1,))
    prior = EntropicPrior(blurred(arm, 5), term_deviations=term_deviations(arm.information, arm.feasible_set))
    validation = cross_validation(arm.information, arm.stretches, arm.feasible_set, prior)
    fit = sy.fit(arm.information, arm.feasible_set, prior=prior, prior_weight=validation.weight)
    names = list(arm.model.parameter_names)
    # Nothing speaks for friction of a joint that does not move.
    assert abs(fit.parameters[names.index("Fvj2")]) < 0.1
    masses = fit.parameters[arm.feasible_set.mass_indices]
    assert np.all((masses > 0.5) & (masses < 15.0))


def test_constraints_and_equations_hold() -> None:
    constraints = [TotalMass(minimum=11.0, maximum=12.0), SymmetricLink("link3", "xy")]
    feasible_set = FeasibleSet(ARM.model, constraints=constraints)
    prior = EntropicPrior(2.0 * CAD, term_deviations=term_deviations(ARM.information, feasible_set))
    validation = cross_validation(ARM.information, ARM.stretches, feasible_set, prior, prior_weights=[1.0, 1e3])
    for parameters in validation.parameters:
        assert 11.0 < parameters[feasible_set.mass_indices].sum() < 12.0
        assert feasible_set.satisfies_equations(feasible_set.project_on_equations(parameters))


def test_what_cannot_be_used_is_said() -> None:
    prior = EntropicPrior(CAD)
    with pytest.raises(InputError, match="at least 3 stretches"):
        cross_validation(ARM.information, ARM.stretches[:2], ARM.feasible_set, prior)
    with pytest.raises(InputError, match="positive numbers"):
        cross_validation(ARM.information, ARM.stretches, ARM.feasible_set, prior, prior_weights=[-1.0])
    with pytest.raises(InputError, match="term_deviations must be positive"):
        cross_validation(
            ARM.information, ARM.stretches, ARM.feasible_set, replace(prior, term_deviations=np.zeros(len(CAD)))
        )


def test_table_marks_the_choice(found) -> None:
    _, validation = found
    lines = str(validation).splitlines()
    assert sum("chosen" in line for line in lines) == 1
    assert "held out" in lines[0]


@pytest.mark.slow
def test_a_prior_that_the_data_contradict_slows_no_fit() -> None:
    """Wrists with a thousand times the moments of the prior, as old descriptions of UR arms have them.

    From the prior itself, a hundred Newton steps ended where lighter weights left more residual than heavier ones.
    """
    rows = [("pi/2", 0, 0.09, "q"), (0, -0.43, 0, "q"), (0, -0.39, 0, "q"), ("pi/2", 0, 0.11, "q")]
    rows += [("-pi/2", 0, 0.09, "q"), (0, 0, 0.08, "q")]
    model = sy.Model(sy.Robot.from_dh(rows).with_terms(sy.Viscous(), sy.Coulomb()))
    bodies = [
        (masses, (0.2 if length else 0.0, 0.0, 0.02), radius)
        for masses, length, radius in zip(
            (2.0, 6.0, 3.0, 1.0, 1.0, 0.5), (0, 1, 1, 0, 0, 0), (0.06, 0.12, 0.1, 0.01, 0.01, 0.01), strict=True
        )
    ]
    given = np.full(model.parameter_count, np.nan)
    truth = np.full(model.parameter_count, 0.5)
    for columns, (mass, com, radius) in zip(model.link_columns, bodies, strict=True):
        about_com = mass * radius**2 * np.eye(3)
        given[columns] = sy.Inertia.from_com(mass, com, about_com).parameters
        truth[columns] = sy.Inertia.from_com(mass, com, about_com if radius > 0.01 else 0.1 * np.eye(3)).parameters
    random = np.random.default_rng(1)
    t, speeds = np.arange(1000)[:, None] / 50.0, 2 * np.pi * 0.1 * np.arange(1, 4)[:, None] * (1 + 0.05 * np.arange(6))
    waves = speeds * t[:, None] + random.uniform(0, 6, (3, 6))
    q, dq, ddq = (
        0.5 * wave.sum(axis=1) for wave in (np.sin(waves), speeds * np.cos(waves), -(speeds**2) * np.sin(waves))
    )
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    torque += 0.02 * np.sqrt(np.mean(torque**2, axis=0)) * random.normal(size=torque.shape)
    stretches = [
        sy.Information.from_samples(model, sy.Samples(q=q[r], dq=dq[r], ddq=ddq[r], torque=torque[r]))
        for r in (slice(start, start + 200) for start in range(0, 1000, 200))
    ]
    information, feasible_set = sum(stretches[1:], start=stretches[0]), FeasibleSet(model)
    prior = EntropicPrior(given, term_deviations=term_deviations(information, feasible_set))
    weights = np.geomspace(0.06, 600, 9)
    found = cross_validation(information, stretches, feasible_set, prior, prior_weights=weights)
    assert np.all(np.diff(found.training_losses) > -1e-3 * found.training_losses[:-1])
    theirs = sy.fit(information, feasible_set, prior=prior, prior_weight=weights[0])
    ours = information.relative_error(feasible_set.K @ found.parameters[0])
    assert ours == pytest.approx(theirs.relative_error, rel=1e-3)


@pytest.mark.slow
def test_accelerations_that_are_a_million_times_too_great_leave_no_fit_and_are_told(tmp_path) -> None:
    """As of times in s that are taken for ms. Whether rounding leaves a fit depends on how much too great they are."""
    link = """<link name="l{k}"><inertial><origin xyz="0.1 0.01 0.03"/><mass value="{m}"/>
      <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.05" iyz="0.002" izz="0.05"/></inertial></link>
      <joint name="j{k}" type="continuous"><parent link="{parent}"/><child link="l{k}"/><origin xyz="{x} 0 0.2"/>
      <axis xyz="{axis}"/></joint>"""
    of_links = ((1, 3.2, "base", 0, "0 0 1"), (2, 2.4, "l1", 0, "0 1 0"), (3, 1.2, "l2", 0.4, "0 1 0"))
    links = [link.format(k=k, m=m, parent=parent, x=x, axis=axis) for k, m, parent, x, axis in of_links]
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm"><link name="base"/>{"".join(links)}</robot>')
    robot = sy.Robot.from_urdf(path).with_terms(sy.Viscous(), sy.Coulomb())
    model = sy.Model(robot)
    t, random = np.arange(1500) / 75, np.random.default_rng(1)
    pace, size = np.array([[0.6, 1.9, 3.1], [1.3, 2.2, 2.9], [0.9, 2.5, 3.0]]), random.normal(size=(2, 3, 3)) * 0.4
    angle = pace * t[:, None, None]
    q = (size[0] * np.sin(angle) + size[1] * np.cos(angle)).sum(axis=2)
    dq = (pace * (size[0] * np.cos(angle) - size[1] * np.sin(angle))).sum(axis=2)
    ddq = (-(pace**2) * (size[0] * np.sin(angle) + size[1] * np.cos(angle))).sum(axis=2)
    torque = model.inverse_dynamics(q, dq, ddq, np.nan_to_num(np.asarray(robot.parameters)) * 1.25) + dq + np.sign(dq)
    torque += 0.02 * torque.std(axis=0) * random.normal(size=torque.shape)
    for factor in (1000.0, 1500.0, 2000.0, 3000.0):
        samples = sy.Samples(q=q, dq=factor * dq, ddq=factor**2 * ddq, torque=torque)
        stretches = [
            sy.Information.from_samples(
                model, replace(samples, **{n: getattr(samples, n)[a : a + 300] for n in MOTION})
            )
            for a in range(0, len(t), 300)
        ]
        information = stretches[0]
        for one in stretches[1:]:
            information = information + one
        with suppress(SolverError):  # and nothing else
            tried = tried_prior(information, stretches, FeasibleSet(model), sy.least_squares(information))
            assert tried.validation is not None
            assert np.isfinite(tried.validation.losses).all()
