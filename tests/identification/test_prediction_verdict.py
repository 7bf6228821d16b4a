"""The second verdict on simulated logs whose noise and whose mistakes are known."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from simulated_arm import SimulatedArm, blurred, simulated_arm

import steelyard as sy
from steelyard.estimators import EntropicPrior
from steelyard.estimators.cross_validation import cross_validation, term_deviations
from steelyard.identification.identify import _held_out
from steelyard.identification.log_reader import DrawnLog
from steelyard.identification.mistakes import Hypothesis, find_mistakes
from steelyard.identification.next_steps import _events
from steelyard.identification.prediction_verdict import (
    FewRows,
    few_rows_of,
    prediction_verdict,
    white_noise,
)
from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks


def with_torque(arm: SimulatedArm, torque: np.ndarray) -> SimulatedArm:
    samples = Samples(q=arm.samples.q, dq=arm.samples.dq, ddq=arm.samples.ddq, torque=torque, t=arm.samples.t)
    blocks = TimeBlocks(empty_factors(arm.model))
    information = Information.from_chunks(arm.model, [samples], blocks=blocks)
    return replace(arm, samples=samples, information=information, stretches=information.stretches(blocks))


def verdict_of(arm: SimulatedArm, seed: int, validation=()):
    prior = EntropicPrior(blurred(arm, seed), term_deviations=term_deviations(arm.information, arm.feasible_set))
    validated = cross_validation(arm.information, arm.stretches, arm.feasible_set, prior)
    estimate = sy.fit(arm.information, arm.feasible_set, prior=prior, prior_weight=validated.weight)
    held_out = validated.joint_errors[validated.chosen_index]
    return prediction_verdict(
        arm.information, estimate.base, validation=validation, held_out_error=held_out, fold_count=len(arm.stretches)
    )


@pytest.mark.parametrize(("white", "lasting"), [(0.5, 0.0), (0.3, 0.3), (0.0, 0.4), (0.2, 1.0)])
def test_white_noise_is_told_from_errors_that_last(white: float, lasting: float) -> None:
    arm = simulated_arm(11, seconds=60.0, noise=0.0)
    random = np.random.default_rng(5)
    shape = arm.samples.torque.shape
    slow = lfilter([np.sqrt(1 - 0.99**2)], [1, -0.99], random.normal(size=shape), axis=0)
    noisy = with_torque(arm, arm.samples.torque + white * random.normal(size=shape) + lasting * slow)
    floor, whiteness = white_noise(noisy.information, sy.least_squares(noisy.information).base)
    # Errors that fade with a time constant of 100 samples are white to 7 % within eight of them.
    np.testing.assert_allclose(floor, np.hypot(white, 0.17 * lasting), atol=0.05 * (white + lasting))
    expected = white**2 / (white**2 + lasting**2)
    assert np.all(np.abs(whiteness - expected) < 0.12)


def test_sound_log_is_good_and_a_noisy_one_as_well() -> None:
    arm = simulated_arm(12, seconds=20.0)
    assert verdict_of(arm, 1).word == "good"
    random = np.random.default_rng(6)
    size = np.sqrt(np.mean(arm.samples.torque**2, axis=0))
    noisy = with_torque(arm, arm.samples.torque + 0.4 * size * random.normal(size=arm.samples.torque.shape))
    found = verdict_of(noisy, 1)
    assert found.relative_error > 0.3
    assert found.word == "good"
    np.testing.assert_allclose(found.noise_floor, 0.4 * size, rtol=0.1)


def test_errors_are_those_of_the_samples() -> None:
    arm, other = simulated_arm(13, seconds=20.0), simulated_arm(14)
    # The other log of the same robot.
    torque = arm.model.inverse_dynamics(other.samples.q, other.samples.dq, other.samples.ddq, arm.truth) + 0.5
    log = with_torque(replace(other, model=arm.model), torque)
    found = verdict_of(arm, 1, validation=[log.information])
    estimate = sy.fit(arm.information, arm.feasible_set)
    found = prediction_verdict(arm.information, estimate.base, validation=[log.information])
    predicted = arm.model.inverse_dynamics(other.samples.q, other.samples.dq, other.samples.ddq, estimate.parameters)
    error = np.sqrt(np.mean((torque - predicted) ** 2, axis=0))
    np.testing.assert_allclose(found.joint_error, error, rtol=1e-9)
    np.testing.assert_allclose(found.joint_relative_error, error / np.sqrt(np.mean(torque**2, axis=0)), rtol=1e-9)
    assert found.source == "the validation log"


def flipped(arm: SimulatedArm) -> SimulatedArm:
    torque = arm.samples.torque.copy()
    torque[:, 1] *= -1.0
    return with_torque(arm, torque)


def swapped(arm: SimulatedArm) -> SimulatedArm:
    return with_torque(arm, arm.samples.torque[:, [2, 1, 0]])


@pytest.mark.parametrize(
    ("mistake", "seed"),
    [
        pytest.param(mistake, seed, marks=() if (mistake, seed) == (swapped, 16) else pytest.mark.slow)
        for mistake in (flipped, swapped)
        for seed in (15, 16, 17)
    ],
)
def test_planted_mistakes_are_wrong_where_they_cost_a_fifth(mistake, seed: int) -> None:
    found = verdict_of(mistake(simulated_arm(seed, seconds=20.0)), seed)
    # A body whose other side hangs down explains most of a flipped sign.
    assert (found.word == "wrong") == (found.model_error > 0.2 or found.joint_relative_error.max() > 0.76)
    assert found.word != "good"
    assert mistake is flipped or found.word == "wrong"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mistake", "seed"),
    [(flipped, 15), (flipped, 16), (swapped, 15)],
)
def test_mistakes_that_are_found_are_wrong_where_they_cost_a_fifth(mistake, seed: int) -> None:
    """Of one joint as well: a body whose other side hangs down explains most of a flipped sign, but not all."""
    sound = simulated_arm(seed, seconds=20.0)
    spoilt = mistake(sound)
    robot = replace(
        spoilt.model.robot,
        links=tuple(
            replace(link, inertia=sy.Inertia.from_parameters(body))
            for link, body in zip(
                spoilt.model.robot.links, blurred(spoilt, seed)[spoilt.feasible_set.link_columns], strict=True
            )
        ),
    )
    found = find_mistakes(sy.Model(robot), spoilt.samples)
    assert found[0].kind == {flipped: "torque sign", swapped: "torque order"}[mistake]
    before = verdict_of(spoilt, seed)
    assert max(before.model_error, before.worst_joint_error) > 0.2
    after = before.with_mistakes([(), found])
    assert after.word == "wrong"
    assert "does not predict" in after.sentences[0]
    assert verdict_of(sound, seed).with_mistakes([()]).word == "good"


def test_a_small_mistake_leaves_the_word_as_it_is_and_a_wrong_unit_does_not() -> None:
    told = verdict_of(simulated_arm(12, seconds=20.0), 1)
    small = Hypothesis(
        "delay", "The torques look to be logged 3 ms later than the motion", None, 20.0, 0.06, 0.03, None, ""
    )
    assert told.with_mistakes([(small,)]) is told
    unit = replace(small, kind="torque unit", statement="The torques look a thousand times too large, as if in mN·m")
    assert told.with_mistakes([(unit,)]).word == "wrong"
    large = told.with_mistakes([(replace(small, error_before=0.21),)])
    assert large.word == "wrong"
    # A line that says "does not predict this robot" beside an error of a few per cent contradicts itself without it.
    assert large.model_error < 0.08
    assert large.clause.endswith(f", because of a mistake in a log or in the robot file ({small.statement})")
    assert "mistake" not in told.clause
    joint = told.joint_error**2 - np.minimum(told.noise_floor, told.joint_error) ** 2
    torque = told.joint_error / told.joint_relative_error
    np.testing.assert_allclose(told.joint_model_error, np.sqrt(joint) / torque)


def test_nothing_held_out_is_poor() -> None:
    arm = simulated_arm(18)
    found = prediction_verdict(arm.information, sy.least_squares(arm.information).base)
    assert found.word == "poor"
    assert found.sentences[1].startswith("Nothing was held out")
    # Nothing was seen to be predicted poorly.
    assert found.clause.startswith("is not tried on other data: ")
    assert found.sentences[0].startswith("The model is not tried on other data: ")


@pytest.mark.parametrize(
    ("amplitude", "word", "said"), [(0.8, "poor", "and more than 40%"), (0.35, "good", "but more than 15%")]
)
def test_joints_that_are_missed_by_much_more_than_all_are_named(amplitude: float, word: str, said: str) -> None:
    arm = simulated_arm(12, seconds=20.0)
    size = np.sqrt(np.mean(arm.samples.torque**2, axis=0))
    weakest = int(np.argmin(size))
    torque = arm.samples.torque.copy()
    torque[:, weakest] += amplitude * size[weakest] * np.sin(9.0 * np.arange(len(torque)) / len(torque))
    info = with_torque(arm, torque).information
    found = prediction_verdict(info, arm.truth @ arm.feasible_set.K.T, validation=[info])
    assert (found.word, found.model_error < 0.15) == (word, True)
    name = info.joint_names[weakest]
    assert re.search(rf", {said} at {name} \(\d\d%\)$", found.clause)
    assert "more than" not in verdict_of(arm, 1).clause


def test_of_a_joint_that_is_left_out_no_error_is_told() -> None:
    arm = simulated_arm(18)
    mask = np.ones_like(arm.samples.torque, dtype=bool)
    mask[:, 1] = False
    information = Information.from_chunks(arm.model, [replace(arm.samples, mask=mask)])
    found = prediction_verdict(information, arm.truth @ arm.feasible_set.K.T, units=("N·m", "N", "N·m"))
    assert np.isnan(found.joint_error).tolist() == [False, True, False]
    assert np.isnan(found.joint_relative_error).tolist() == [False, True, False]
    assert found.joint_model_error[1] == 0.0
    assert np.isfinite([found.model_error, found.relative_error, found.relative_noise]).all()
    assert str(found).splitlines()[-2].split() == [information.joint_names[1], "N"]
    cells = [f"<td>{information.joint_names[k]}</td>" for k in range(3)]
    units = [found._repr_html_().split(cell)[1].split("</tr>")[0].split("<td>")[4] for cell in cells]
    assert units == ["N·m</td>", "N</td>", "N·m</td>"]


def test_plain_data() -> None:
    arm = simulated_arm(19)
    found = verdict_of(arm, 1)
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert data["word"] == found.word
    assert len(data["noise_floor"]) == 3
    assert str(found).splitlines()[-1].split()[0] == arm.information.joint_names[-1]
    assert "<table>" in found._repr_html_()
    silent = prediction_verdict(replace(arm.information, batch_means=()), arm.truth @ arm.feasible_set.K.T)
    assert np.all(np.isnan(silent.noise_floor))
    json.dumps(silent.to_dict(), allow_nan=False)


def test_estimates_without_a_prior_are_tried_on_what_is_left_out() -> None:
    """Against least squares by NumPy on the rows of the other stretches, and torques by the recursion."""
    arm = simulated_arm(20, seconds=16.0)
    found = _held_out(arm.stretches, lambda data: sy.least_squares(data, None))
    samples = arm.samples
    regressor = arm.model.regressor(samples.q, samples.dq, samples.ddq)
    squares, start = np.zeros(3), 0
    for stretch in arm.stretches:
        rows = np.arange(start, start + stretch.count // 3)
        others = np.setdiff1d(np.arange(samples.count), rows)
        parameters = np.linalg.lstsq(
            regressor[others].reshape(-1, regressor.shape[2]), samples.torque[others].ravel(), rcond=1e-10
        )[0]
        predicted = arm.model.inverse_dynamics(samples.q[rows], samples.dq[rows], samples.ddq[rows], parameters)
        squares += np.sum((samples.torque[rows] - predicted) ** 2, axis=0)
        start += len(rows)
    np.testing.assert_allclose(found, np.sqrt(squares / samples.count), rtol=1e-6)
    assert _held_out(arm.stretches[:2], lambda data: sy.least_squares(data)) is None


@pytest.mark.parametrize(("own", "other"), [(0.05, 0.3), (0.3, 0.05)])
def test_noise_is_that_of_the_log_that_is_predicted(own: float, other: float) -> None:
    arm = simulated_arm(15, seconds=40.0, noise=0.0)
    random = np.random.default_rng(7)
    shape = arm.samples.torque.shape
    fitted = with_torque(arm, arm.samples.torque + own * random.normal(size=shape))
    log = with_torque(arm, arm.samples.torque + other * random.normal(size=shape))
    found = prediction_verdict(fitted.information, arm.truth @ arm.feasible_set.K.T, validation=[log.information])
    np.testing.assert_allclose(found.noise_floor, other, rtol=0.1)
    assert found.model_error < 0.4 * found.relative_error  # all that is left is white


def events_of(arm: SimulatedArm, log, estimate):
    drawn = DrawnLog(replace(log.samples, t=np.arange(log.samples.count) * 0.01), (), log.samples.count, 1)
    return few_rows_of("log.csv", "validation", log.information, arm.model, estimate.base, drawn)


@pytest.mark.parametrize("softness", [0.0, 0.6])
def test_friction_that_jumps_a_row_after_the_turn_is_no_event(monkeypatch: pytest.MonkeyPatch, softness: float) -> None:
    """Filtered positions turn a little before or after the joint, so that the Coulomb friction has the wrong sign.

    Or it changes in some steps, as that of a joint that sticks may be any between both.
    """
    arm, other = simulated_arm(13, seconds=20.0), simulated_arm(14)
    estimate = sy.fit(arm.information, arm.feasible_set)
    q, dq, ddq = other.samples.q, other.samples.dq, other.samples.ddq
    friction = arm.truth[[arm.model.parameter_names.index(f"Fcj{joint}") for joint in (1, 2, 3)]]
    late = (1.0 - softness) * friction * (np.sign(np.roll(dq, 2, axis=0)) - np.sign(dq))
    late[:2] = 0.0
    torque = arm.model.inverse_dynamics(q, dq, ddq, arm.truth) + late
    torque += 0.02 * np.random.default_rng(4).normal(size=torque.shape)
    log = with_torque(replace(other, model=arm.model), torque)
    with monkeypatch.context() as patch:
        patch.setattr("steelyard.identification.prediction_verdict.NEAR_TURN", -1.0)  # where no row is near a turn
        taken = events_of(arm, log, estimate)
    assert {one.count for one in taken} <= set(np.count_nonzero(late, axis=0))  # these rows and no others stand out
    assert taken
    assert events_of(arm, log, estimate) == ()
    # What the arm meets while it turns is still seen.
    turn = int(np.flatnonzero(late[:, 1])[0])
    hit = torque.copy()
    hit[turn : turn + 6, 1] += 10.0 * np.abs(friction[1])
    found = events_of(arm, with_torque(log, hit), estimate)
    assert [one.joint for one in found] == ["joint2"]
    assert found[0].times[0] == pytest.approx((0.01 * turn, 0.01 * (turn + 5)), abs=1e-9)


def test_events_in_many_logs_are_told_in_a_few_lines() -> None:
    one = FewRows("", "b", "identification", 1, 6, 1900, 4.0, 0.8, 0.2, 0.1, ((2.0, 2.02),), False)
    few = [replace(one, log=f"run{k}.csv") for k in range(1000)]
    (step,) = _events(SimpleNamespace(prediction=SimpleNamespace(few_rows=few)))  # type: ignore[arg-type]
    lines = step.code.splitlines()
    assert lines[2] == "# torques are empty in run0.csv at t = 1.90 to 2.12 s"
    assert lines[-1] == "# and in 992 more logs, which run.json names"
    assert len(lines) == 11


def test_what_few_rows_hold_is_no_white_noise() -> None:
    arm, other = simulated_arm(13, seconds=20.0), simulated_arm(14)
    size = np.sqrt(np.mean(other.samples.torque**2, axis=0))
    random = np.random.default_rng(4)
    torque = arm.model.inverse_dynamics(other.samples.q, other.samples.dq, other.samples.ddq, arm.truth)
    noise = 0.02 * size * random.normal(size=torque.shape)
    sound = with_torque(replace(other, model=arm.model), torque + noise)
    estimate = sy.fit(arm.information, arm.feasible_set)
    assert events_of(arm, sound, estimate) == ()

    spikes = np.zeros_like(torque)
    spikes[200:203, 1], spikes[700:703, 1] = 3.0 * size[1], -3.0 * size[1]  # two impacts, each of three rows
    spoiled = with_torque(replace(other, model=arm.model), torque + noise + spikes)
    found = events_of(arm, spoiled, estimate)
    assert [(one.joint, one.count) for one in found] == [("joint2", 6)]
    assert found[0].square == pytest.approx(np.sum(spikes**2), rel=0.1)
    np.testing.assert_allclose(found[0].times, [(2.0, 2.02), (7.0, 7.02)], atol=1e-9)
    before = prediction_verdict(arm.information, estimate.base, validation=[spoiled.information])
    after = prediction_verdict(arm.information, estimate.base, validation=[spoiled.information], few_rows=found)
    assert before.noise_floor[1] > 0.1 * size[1]  # they look white
    np.testing.assert_allclose(after.noise_floor, 0.02 * size, rtol=0.25)
    expected = np.sqrt(np.sum(spikes**2) / np.sum((torque + noise + spikes) ** 2))
    assert after.model_error == pytest.approx(expected, rel=0.1)
    assert "6 of" in after.sentences[-1]
    assert "joint joint2" in after.sentences[-1]
