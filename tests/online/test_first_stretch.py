"""Robots that change before they are known: noticed when they are, looking back."""

import json
from pathlib import Path

import numpy as np
import pytest
from arm_at_work import NOISE, RATE, Work, deviations, never_and_often_stopped
from two_joint_arm import BODY, HELD, unstated_arm, unstated_parameters

import steelyard as sy
from steelyard.online import PickUp, simulated_pick_up


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return unstated_arm()


@pytest.mark.slow
@pytest.mark.parametrize("when", [0.7, 2.0, 3.5])
def test_what_is_picked_up_before_the_robot_is_known_is_noticed_and_weighed(model: sy.Model, when: float) -> None:
    """Taken for one robot, the intervals held the truth of neither, and nothing was said."""
    work = Work(model, [(when, 0.0), (9.0, 1.0)])
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    payload = sy.OnlinePayload(estimator)
    work.feed(estimator, 0.0, 5.0)
    if not estimator.changes:
        assert not estimator.is_of_one_robot
        assert "until then the estimate may be of two robots" in " ".join(estimator.remarks)
    work.feed(estimator, 5.0)
    (change,) = estimator.changes
    assert change.t == pytest.approx(when, abs=0.1)
    assert change.robots == (0, 1)
    for information, carried in ((change.before, 0.0), (estimator.information, 1.0)):
        rows = information.factors[1]
        left = rows.residual2(model.base_parameters().K @ unstated_parameters(carried))
        assert left == pytest.approx(NOISE**2 * rows.count, rel=0.2)
    assert estimator.factors()[1].count > RATE * 7.5
    assert deviations(estimator, unstated_parameters(1.0)).max() < 4.0
    told = payload.estimate()
    assert told is not None
    assert 1.5 in told["mass"]


@pytest.mark.slow
def test_a_robot_that_stays_as_it_is_is_known_to_be_one(model: sy.Model) -> None:
    work = Work(model, [(12.0, 0.0)])
    estimator, other = (sy.OnlineEstimator(model, rate=RATE, detect_changes=detect) for detect in (True, False))
    for end in range(1, 13):
        for one in (estimator, other):
            work.feed(one, end - 1.0, end)
        assert estimator.is_of_one_robot == (end > 8)
        assert any("may be of two robots" in remark for remark in estimator.remarks) == (end <= 8)
    assert estimator.changes == []
    assert not other.is_of_one_robot
    for one_joint, same in zip(estimator.factors(), other.factors(), strict=True):
        assert one_joint.count == same.count
        sums, wanted = (one.triangle.T @ one.triangle for one in (one_joint, same))
        np.testing.assert_allclose(sums, wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.slow
def test_what_is_left_of_more_changes_than_one_is_not_taken_for_one_robot(model: sy.Model) -> None:
    """The arm carried half of it, nothing, and then all of it: the payload's interval lay beside the truth."""
    work = Work(model, [(1.0, 0.5), (1.5, 0.0), (9.0, 1.0)])
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator)
    (change,) = estimator.changes
    assert change.t == pytest.approx(2.5, abs=0.1)
    assert change.before.count == 0
    assert change.robots == (0, 0)
    assert sy.OnlinePayload(estimator).estimate() is None
    assert deviations(estimator, unstated_parameters(1.0)).max() < 4.0
    assert "and nothing is known of the robot before" in estimator.remarks[-1]


@pytest.mark.slow
def test_a_push_at_the_beginning_does_not_keep_a_payload_from_being_weighed(model: sy.Model) -> None:
    """What is known of the arm alone is what came after the push."""
    work = Work(model, [(12.0, 0.0), (6.0, 1.0)])
    work.torque[(work.t >= 2.0) & (work.t < 2.8), 1] += 4.0
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    payload = sy.OnlinePayload(estimator)
    work.feed(estimator, 0.0, 12.0)
    assert [change.robots for change in estimator.changes] == [(0, 0)]
    assert payload.estimate() is None
    work.feed(estimator, 12.0)
    assert [change.robots for change in estimator.changes] == [(0, 0), (0, 1)]
    rows = estimator.changes[1].before.factors[1]
    left = rows.residual2(model.base_parameters().K @ unstated_parameters(0.0))
    assert left == pytest.approx(NOISE**2 * rows.count, rel=0.2)
    told = payload.estimate()
    assert told is not None
    assert 1.5 in told["mass"]
    assert told.mass == pytest.approx(1.5, rel=0.1)


@pytest.mark.slow
def test_of_a_robot_that_was_there_for_a_moment_nothing_is_told(model: sy.Model) -> None:
    """Any parameters explain it, those of samples with the payload, too."""
    work = Work(model, [(0.45, 0.0), (9.0, 1.0)])
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator)
    assert [change.before.count for change in estimator.changes] == [0]
    assert sy.OnlinePayload(estimator).estimate() is None
    assert deviations(estimator, unstated_parameters(1.0)).max() < 4.0


@pytest.mark.slow
def test_what_is_hung_on_a_robot_that_never_moved_is_noticed_when_it_has() -> None:
    """Its gears have no friction, so that samples at rest count; they are of the robot alone."""
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")]))
    t, pace = np.arange(24 * 250)[:, None] / 250, np.array([3.0, 4.0])
    begins = np.clip(t - 14.0, 0.0, 1.0)
    share = begins**2 * (3.0 - 2.0 * begins)
    phase = pace * np.cumsum(share, axis=0) / 250
    q, dq = np.sin(phase), pace * share * np.cos(phase)
    alone, loaded = (np.concatenate([BODY, BODY + held * HELD]) for held in (0.0, 1.0))
    motion = q, dq, np.gradient(dq, 1 / 250, axis=0)
    torque = np.where(t < 9.0, *(model.inverse_dynamics(*motion, one) for one in (alone, loaded)))
    torque += NOISE * np.random.default_rng(1).normal(size=q.shape)
    estimator = sy.OnlineEstimator(model, rate=250, detect_changes=True)
    estimator.update(t[:, 0], q, torque)
    (change,) = estimator.changes
    assert change.t < 9.0
    assert estimator.is_of_one_robot
    assert deviations(estimator, loaded).max() < 4.0


def test_a_robot_whose_torques_are_none_is_not_known_to_be_one(model: sy.Model) -> None:
    """A drive that is switched on late tells nothing of the time before."""
    work = Work(model, [(12.0, 0.0)])
    work.torque[work.t < 10.0] = 0.0
    estimator = sy.OnlineEstimator(model, rate=RATE, detect_changes=True)
    work.feed(estimator, 0.0, 10.0)
    assert not estimator.is_of_one_robot


def watched(run: PickUp) -> sy.OnlineEstimator:
    estimator = sy.OnlineEstimator(run.model, detect_changes=True)
    for start in range(0, len(run.t), 50):
        rows = slice(start, start + 50)
        estimator.update(run.t[rows], run.q[rows], run.torque[rows])
    return estimator


@pytest.mark.slow
def test_an_alarm_that_an_early_change_raises_late_is_no_change_of_that_time() -> None:
    """What was learned until then is of both robots; taken for the arm alone, it weighs 2 kg wrongly."""
    estimator = watched(simulated_pick_up(14, when=1.5, duration=6.0))
    (change,) = estimator.changes
    assert change.noticed < 8.0
    assert change.t == pytest.approx(1.5, abs=0.1)
    assert not estimator.is_of_one_robot
    told = sy.OnlinePayload(estimator).estimate()
    assert told is not None
    assert 2.0 in told["mass"]
    assert told.mass == pytest.approx(2.0, abs=0.2)


@pytest.mark.slow
def test_two_robots_are_answered_from_within_what_they_can_be() -> None:
    """From the answer to both of them at once, which lies in a corner, searches end before they find either."""
    (change,) = watched(simulated_pick_up(13, when=2.5, duration=8.6)).changes
    assert change.t == pytest.approx(2.5, abs=0.1)


@pytest.mark.data
@pytest.mark.parametrize("log", ["A", "B"])
def test_a_robot_that_its_model_describes_in_part_did_not_change(shared_data: Path, log: str) -> None:
    """The halves of 10 s of a KR300, whose counterbalance the model lacks, have other least squares."""
    folder = shared_data / "kuka_kr300"
    told = json.loads((folder / "robot.json").read_text())
    robot = sy.Robot.from_dh(told["rows"], gravity=told["gravity_base_frame"])
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia()))
    columns = np.genfromtxt(folder / f"{log}.csv", delimiter=",", names=True)
    q, torque = (np.column_stack([columns[f"{name}{k}"] for k in range(1, 7)]) for name in ("q", "tau_m"))
    estimator = sy.OnlineEstimator(model, rate=250, detect_changes=True)
    for start in range(0, len(q), 50):
        rows = slice(start, start + 50)
        estimator.update(columns["t"][rows], q[rows], torque[rows] * told["gear_ratio"])
    assert estimator.changes == []
    assert estimator.is_of_one_robot


@pytest.mark.slow
def test_an_early_change_goes_on_after_a_night(model: sy.Model, tmp_path: Path) -> None:
    """At any time: files are the same to the last byte."""
    work, stops = Work(model, [(2.5, 0.0), (8.0, 1.0)]), np.random.default_rng(1).uniform(0.0, 10.5, 20)
    _, stopped = never_and_often_stopped(model, work, np.append(np.sort(stops), 10.5), tmp_path / "arm.npz")
    assert [change.robots for change in stopped.changes] == [(0, 1)]
    assert stopped.is_of_one_robot
