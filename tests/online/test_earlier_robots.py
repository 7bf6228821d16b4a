"""Robots that come back: what is put down again, what is picked up again, and what was only pushed."""

from pathlib import Path

import numpy as np
import pytest
from arm_at_work import NOISE, RATE, Work, deviations, never_and_often_stopped
from two_joint_arm import unstated_arm, unstated_parameters

import steelyard as sy
from steelyard.online.earlier_robots import MOST_EARLIER


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return unstated_arm()


@pytest.mark.slow
def test_what_is_known_of_the_bare_arm_grows_with_each_time_that_something_is_put_down(model: sy.Model) -> None:
    """Before, all that was known was forgotten each time; and what was carried must not count."""
    work = Work(model, [(10.0, 0.0), *[(3.0, 1.0), (3.0, 0.0)] * 5])
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    payload, alone, rows = sy.OnlinePayload(estimator), [], []
    for end in np.arange(10.0, 41.0, 3.0):
        work.feed(estimator, end - 3.0 if end > 10.0 else 0.0, end)
        told = payload.estimate()
        bare = estimator.robot == 0
        assert bare == (told is None)
        if bare:
            alone.append(estimator.information.relative_error(estimator.estimate().base))
            rows.append(estimator.factors()[0].count)
            assert deviations(estimator, unstated_parameters(0.0)).max() < 4.0
        else:
            assert told is not None
            assert 1.5 in told["mass"]
            assert told.mass == pytest.approx(1.5, rel=0.05)
    assert [change.robots[1] for change in estimator.changes[1::2]] == [0] * 5
    assert len(rows) == 6
    assert np.diff(rows).min() > 1.5 * RATE  # of 3 s, in which the filter holds 0.22 s back
    sentences = [remark for remark in estimator.remarks if "back to what it was at first" in remark]
    assert len(sentences) == 1
    assert "the estimate goes on from what was known of it" in sentences[0]


@pytest.mark.slow
def test_what_counts_when_it_is_back_are_the_rows_of_the_bare_arm(model: sy.Model) -> None:
    """Less the second before each change was noticed, to a stretch."""
    work = Work(model, [(10.0, 0.0), (4.0, 1.0), (6.0, 0.0)])
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    q, dq, ddq = work.motion
    estimator.update(work.t, q, work.torque, dq, ddq)
    picked, put = (round(RATE * change.noticed) + 1 for change in estimator.changes)
    rows = np.r_[: picked - RATE - RATE // 20, put : len(work.t)]
    kept = sy.Samples(q=q[rows], dq=dq[rows], ddq=ddq[rows], torque=work.torque[rows], mask=np.abs(dq[rows]) >= 1e-3)
    expected = sy.Information.from_samples(model, kept)
    for found, factor in zip(estimator.information.factors, expected.factors, strict=True):
        assert found.count == factor.count
        sums, wanted = (one.triangle.T @ one.triangle for one in (found, factor))
        np.testing.assert_allclose(sums, wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.slow
@pytest.mark.parametrize("rate", [125, 250])
def test_rows_of_a_push_do_not_count_at_other_rates(model: sy.Model, rate: int) -> None:
    """A second is longer than twenty stretches of 0.05 s there, which are rounded to whole samples."""
    work = Work(model, [(14.0, 0.0)], rate=rate)
    work.torque[(work.t >= 10.0) & (work.t < 10.8), 1] += 12.0
    estimator = sy.OnlineEstimator(model, rate=rate, detect_changes=True)
    work.feed(estimator)
    assert [change.robots for change in estimator.changes] == [(0, 0)]
    rows = estimator.information.factors[1]
    assert rows.residual2(model.base_parameters().K @ unstated_parameters(0.0)) == pytest.approx(
        NOISE**2 * rows.count, rel=0.1
    )


@pytest.mark.slow
def test_a_payload_that_is_picked_up_again_is_known_again(model: sy.Model) -> None:
    work = Work(model, [(8.0, 0.0), (8.0, 1.0), (8.0, 0.0), (8.0, 1.0)])
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator)
    assert [change.robots for change in estimator.changes] == [(0, 1), (1, 0), (0, 1)]
    assert [change.known for change in estimator.changes] == [False, True, True]
    assert "the estimate goes on from what was known of it" in estimator.remarks[-1]  # that of both times
    assert estimator.factors()[0].count > 13.0 * RATE
    assert deviations(estimator, unstated_parameters(1.0)).max() < 4.0
    told = sy.OnlinePayload(estimator).estimate()
    assert told is not None
    assert 1.5 in told["mass"]
    # The arm without it is what was learned in both of its parts.
    assert estimator.first_robot is not None
    assert estimator.first_robot.factors[0].count > 13.0 * RATE


def test_a_joint_that_is_pushed_for_a_while_leaves_nothing_behind(model: sy.Model) -> None:
    work = Work(model, [(16.0, 0.0)])
    work.torque[(work.t >= 10.0) & (work.t < 10.8), 1] += 4.0
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator)
    assert [change.robots for change in estimator.changes] == [(0, 0)]
    assert estimator.changes[0].joint_names == ("joint2",)
    assert sy.OnlinePayload(estimator).estimate() is None
    rows = estimator.information.factors[1]
    assert rows.residual2(model.base_parameters().K @ unstated_parameters(0.0)) == pytest.approx(
        NOISE**2 * rows.count, rel=0.1
    )
    assert deviations(estimator, unstated_parameters(0.0)).max() < 4.0
    (told,) = (remark for remark in estimator.remarks if "joint2" in remark)
    assert "was not as predicted for a while" in told


@pytest.mark.slow
def test_slow_motion_that_hides_a_payload_does_not_tell_that_it_was_put_down() -> None:
    """Without gravity in its joints, an arm that moves at a fortieth of its speed feels nearly no inertia."""
    rows = [(0, 0.4, 0, "q"), (0, 0.4, 0, "q")]
    robot = sy.Robot.from_dh(rows, name="scara", gravity=(0, 0, -9.81)).with_terms(sy.Viscous(), sy.Coulomb())
    scara = sy.Model(robot)
    for begin in (13.3, 13.7, 14.1):
        work = Work(scara, [(10.0, 0.0), (8.0, 1.0)], rest=(begin, 30.0), slowest=0.1)
        estimator = sy.OnlineEstimator(scara, rate=RATE, detect_changes=True)
        work.feed(estimator)
        assert estimator.robot == 1


@pytest.mark.slow
def test_an_arm_that_rests_when_it_has_put_something_down_is_known_when_it_moves_again(model: sy.Model) -> None:
    work = Work(model, [(8.0, 0.0), (4.0, 1.0), (14.0, 0.0)], rest=(12.5, 21.0))
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator)
    assert [change.robots for change in estimator.changes] == [(0, 1), (1, 0)]
    assert deviations(estimator, unstated_parameters(0.0)).max() < 4.0


@pytest.mark.slow
def test_another_payload_is_another_robot_and_the_first_one_is_never_forgotten(model: sy.Model) -> None:
    shares = (1.0, 0.5, 2.0, 0.25, 1.5, 0.75)
    work = Work(model, [(8.0, 0.0), *[(6.0, share) for share in shares], (8.0, 0.0)])
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator)
    assert [change.robots[1] for change in estimator.changes] == [1, 2, 3, 4, 5, 6, 0]
    assert len(estimator._earlier) <= MOST_EARLIER
    assert deviations(estimator, unstated_parameters(0.0)).max() < 4.0


@pytest.mark.slow
def test_a_robot_of_which_little_is_known_is_not_taken_for_the_one_that_is_there(model: sy.Model) -> None:
    """Its data allow nearly any torque, so that nearly any robot agrees with them."""
    work = Work(model, [(8.0, 0.0), (2.6, 1.0), (6.0, 0.5)])
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator)
    assert [change.robots[1] for change in estimator.changes] == [1, 2]


@pytest.mark.slow
def test_a_robot_of_which_nothing_is_known_is_not_kept(model: sy.Model) -> None:
    """No torques came from the change on; then the robot shook."""
    work = Work(model, [(8.0, 0.0), (6.0, 1.0)])
    late = work.t >= 8.126 + 2.2
    work.torque[(work.t >= 8.126) & ~late] = np.nan
    work.torque[late] += 200.0 * np.sign(np.sin(90.0 * work.t[late]))[:, None]
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator)
    assert [change.robots[1] for change in estimator.changes][:2] == [1, 2]
    assert estimator.changes[1].before.count == 0
    assert 1 not in [one.number for one in estimator._earlier]
    assert estimator.first_robot is not None
    assert estimator.first_robot.count > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_earlier_robots_go_on_after_a_night(model: sy.Model, tmp_path: Path, seed: int) -> None:
    """At any time, also within the second in which one is known again: files are the same to the last byte."""
    work = Work(model, [(7.0, 0.0), *[(2.5, 1.0), (2.5, 0.0)] * 3])
    stops = np.append(np.sort(np.random.default_rng(seed).uniform(0.0, 22.0, 40)), 22.0)
    never, stopped = never_and_often_stopped(model, work, stops, tmp_path / "arm.npz")
    assert stopped.remarks == never.remarks
    assert {change.robots[1] for change in stopped.changes[1::2]} == {0}


@pytest.mark.slow
@pytest.mark.parametrize("saved", [9.9, 10.3, 13.3])
def test_what_goes_on_with_other_conditions_changes_and_comes_back_as_well(
    model: sy.Model, tmp_path: Path, saved: float
) -> None:
    """The last answer lies outside of them, so that there is none when the next change comes."""
    work, path = Work(model, [(10.0, 0.0), (3.0, 1.0), (5.0, 0.0)]), tmp_path / "arm.npz"
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator, 0.0, saved)
    estimator.save(path)
    light = sy.FeasibleSet(model, constraints=[sy.TotalMass(maximum=4.0)])
    estimator = sy.OnlineEstimator.load(path, model, light)
    work.feed(estimator, saved)
    assert estimator.changes
    assert light.contains(estimator.estimate().parameters)
