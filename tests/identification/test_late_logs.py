"""A delay of the torques that matters to the numbers is told with the line that mends it; sound logs have none."""

from dataclasses import replace

import numpy as np
import pytest
from payload_logs import SimulatedArm

import steelyard as sy
from steelyard.identification import examine
from steelyard.identification.next_steps import next_steps
from steelyard.identification.wam import robot_toml, simulated_log, true_parameters, wam_model
from steelyard.recording.diagnosis import advanced


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The robot file of the simulated WAM, and a sound log of it."""
    path = tmp_path_factory.mktemp("wam") / "robot.toml"
    path.write_text(robot_toml())
    return path, simulated_log(wam_model(), "A", 2014)


@pytest.fixture(scope="module")
def sound(arm):
    """What the sound log is identified as."""
    return sy.identify(*arm)


def late(log, delay, joints=slice(None)):
    torque = log.torque.copy()
    torque[:, joints] = advanced(log.torque, -delay * log.rate)[0][:, joints]
    return replace(log, torque=torque)


def missed(result):
    """Numbers that are called measured, and how many of their intervals do not hold the truth."""
    truth = dict(zip(map(str, wam_model().parameter_names), true_parameters(), strict=True))
    told = [row for row in result.parameters if row.basis == "measured" and row.name in truth]
    return len(told), sum(not row.lower <= truth[row.name] <= row.upper for row in told)


@pytest.mark.slow
def test_a_sound_log_is_not_told_to_be_late(sound):
    assert sound.mistakes == {}
    assert "delay" not in " ".join(sound.remarks)


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.012, -0.012])
def test_a_late_log_is_told_with_the_line_that_mends_it(arm, sound, delay):
    path, log = arm
    result = sy.identify(path, late(log, delay))
    assert result.prediction.word == "good"  # errors alone do not show it
    ((found,),) = result.mistakes.values()
    assert found.kind == "delay"
    stated = found.settings["processing"]["delay"]
    assert stated == pytest.approx(delay, abs=0.004)
    assert ("later" if delay > 0 else "earlier") in found.statement
    first = next_steps(result)[0]
    assert (first.language, first.code) == ("toml", f"[processing]\ndelay = {stated}")
    assert any("logged" in remark and f"`delay = {stated}`" in remark for remark in result.remarks)
    mended = sy.identify(path, late(log, delay), processing={"delay": stated})
    assert mended.mistakes == {}
    # What the delay moves is told less surely, and what is measured holds.
    wider = [
        (result.parameters[row.name].upper - result.parameters[row.name].lower) / (row.upper - row.lower)
        for row in sound.parameters
        if row.basis == "measured"
    ]
    assert np.median(wider) > 1.05
    assert max(wider) > 1.25
    assert missed(result)[0] <= missed(sound)[0]
    assert missed(result)[1] <= 1


@pytest.mark.slow
def test_the_doctor_tells_the_same(arm):
    path, log = arm
    found = [one for one in examine(late(log, 0.012), path).findings if one.kind == "delay"]
    assert found[0].remedy["processing"]["delay"] == pytest.approx(0.012, abs=0.002)


@pytest.mark.slow
def test_rows_of_a_long_log_are_read_again(arm, tmp_path):
    """Of the rows that are drawn of it no stretch is long enough."""
    path, _ = arm
    log = simulated_log(wam_model(), "A", 2014, periods=20.0)
    file = late(log, 0.012).save(tmp_path / "log.npz")
    reader_rows = sy.identify(path, file, chunk_rows=20_000)
    ((found,),) = reader_rows.mistakes.values()
    assert found.settings["processing"]["delay"] == pytest.approx(0.012, abs=0.004)


@pytest.fixture(scope="module")
def many():
    """The robot file of a UR5, and logs that Pinocchio plays."""
    arm, random = SimulatedArm("ur5"), np.random.default_rng(5)
    return arm, [arm.log(random) for _ in range(10)]


@pytest.mark.slow
def test_a_delay_of_many_logs_is_told_once_and_counts_as_that_of_all(many, tmp_path):
    """Of ten logs four are looked at; intervals counted the delay of these alone, two fifths of it at most."""
    arm, logs = many
    (tmp_path / "robot.toml").write_text(f'[description]\nurdf = "{arm.path}"\n[processing]\ncutoff = 8.0\n')
    for number, log in enumerate(logs):
        late(log, 0.006).save(tmp_path / f"run{number}.csv")
    result = sy.identify(tmp_path / "robot.toml", [str(tmp_path / f"run{number}.csv") for number in range(10)])
    ((found,),) = result.mistakes.values()
    assert found.statement.startswith("The torques of all logs look to be logged")
    assert found.evidence.endswith("4 of 10 logs were looked at, and stand for all")
    assert found.settings["processing"]["delay"] == pytest.approx(0.006, abs=0.001)
    truth = {}
    for joint in range(6):
        values = (arm.viscous, arm.coulomb, arm.offset)
        truth.update({f"{name}j{joint + 1}": one[joint] for name, one in zip(("Fv", "Fc", "Fo"), values, strict=True)})
    held = [row.lower <= truth[row.name] <= row.upper for row in result.parameters if row.name in truth]
    assert sum(held) >= len(held) - 1


@pytest.mark.slow
def test_one_late_log_among_others_is_told_by_itself(many, tmp_path):
    arm, logs = many
    (tmp_path / "robot.toml").write_text(f'[description]\nurdf = "{arm.path}"\n[processing]\ncutoff = 8.0\n')
    given = [logs[0], late(logs[1], 0.02), logs[2]]
    names = [str(log.save(tmp_path / f"run{number}.csv")) for number, log in enumerate(given)]
    result = sy.identify(tmp_path / "robot.toml", names)
    ((name, (found,)),) = result.mistakes.items()
    assert name == names[1]
    assert found.settings["processing"]["delay"] == pytest.approx(0.02, abs=0.004)


def test_one_joint_that_is_late_is_named():
    from steelyard.identification.late_logs import LateLog, late_hypotheses

    alone = np.zeros(2, dtype=bool)
    one = LateLog("a.csv", np.array([0.0, 0.012]), np.array([0.0, 0.001]), np.zeros(3), 1.7, (0.05, 0.04), alone)
    ((found,),) = late_hypotheses([one], (0.001, 0.002), ["shoulder", "elbow"]).values()
    assert "elbow's 12 ± 2 ms later" in found.statement
    assert found.settings == {"processing": {"delay": [0.001, 0.014]}}
    # By itself alone, late positions look like torques that are early.
    early = replace(one, delays=-one.delays, explained=np.array([False, True]))
    ((found,),) = late_hypotheses([early], 0.0, ["shoulder", "elbow"]).values()
    assert "elbow's 12 ± 2 ms earlier than the motion (or its positions later)" in found.statement
    assert found.evidence == "the error falls from 5 % to 4 %"
    assert late_hypotheses([], 0.0, ["shoulder", "elbow"]) == {}


@pytest.mark.slow
def test_one_joint_that_is_late_by_far_is_told(arm):
    """Its error widens all intervals, and errors by themselves are still called good."""
    path, log = arm
    spoilt = late(log, 0.06, joints=1)
    result = sy.identify(path, spoilt)
    ((found,),) = result.mistakes.values()
    stated = found.settings["processing"]["delay"]
    assert stated[1] == pytest.approx(0.06, abs=0.003)
    assert np.count_nonzero(stated) == 1
    assert "the error falls from" in found.evidence
    mended = sy.identify(path, spoilt, processing={"delay": stated})
    assert mended.mistakes == {}
    assert mended.prediction.relative_error < 0.9 * result.prediction.relative_error
