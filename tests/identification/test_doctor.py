"""What is wrong with a recording is found, and the lines that are told mend it."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification import examine, next_steps
from steelyard.recording.survey import LogSurvey
from steelyard.robot import RobotFile

T = np.arange(5000) / 250
"""The times of the sound log, s."""


@pytest.fixture(scope="module")
def arm(simulation, tmp_path_factory):
    """Return the robot file of an arm without [processing], its model, and a sound log with encoder steps and noise."""
    path = tmp_path_factory.mktemp("arm") / "robot.toml"
    path.write_text(simulation.robot_file.partition("[processing]")[0])
    model = sy.Model.load(path)
    random = np.random.default_rng(3)
    q, dq, ddq = simulation.trajectory(11).motion(T)
    torque = model.inverse_dynamics(q, dq, ddq, simulation.true_parameters(model))
    torque += 0.02 * torque.std(axis=0) * random.normal(size=q.shape)
    step = 2 * np.pi / 2**17
    return path, model, {"t": T, "q": np.round(q / step) * step, "tau": torque}


def written(log, path):
    """Write arrays as a CSV, as another program would."""
    columns, heads = [], []
    for name, values in log.items():
        many = values.ndim == 2
        columns += list(values.T) if many else [values]
        heads += [f"{name}{j + 1}" for j in range(values.shape[1])] if many else [name]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(heads), comments="", fmt="%.12g")
    return path


def mended(path, examination):
    """Return the robot file with what was told."""
    content = tomllib.loads(path.read_text())
    told = tomllib.loads(examination.toml)
    file = RobotFile.load(path)
    sections = {name: {**content.get(name, {}), **told.get(name, {})} for name in ("log", "processing")}
    return replace(file, sections={**file.sections, **sections})


def error(robot, log):
    """Return the relative error of the answer."""
    return sy.identify(robot, [log], prior=None, prefer="lightest").estimate.relative_error


def late(log, seconds):
    """Return the log with torques that come later."""
    torque = np.column_stack([np.interp(T - seconds, T, column) for column in log["tau"].T])
    return {**log, "tau": torque}


def without(log, rows):
    """Return the log without some rows."""
    return {name: np.delete(values, rows, axis=0) for name, values in log.items()}


def clipped(log):
    level = 0.7 * np.abs(log["tau"][:, 1]).max()
    torque = log["tau"].copy()
    torque[:, 1] = np.clip(torque[:, 1], -level, level)
    return {**log, "tau": torque}


def standing(log):
    """Return the log of a torque sensor that was not read for a second."""
    torque = log["tau"].copy()
    torque[1000:1250, 1] = torque[1000, 1]
    return {**log, "tau": torque}


def frozen(log):
    """Return the log of a logger that writes every tenth row twice."""
    found = {name: values.copy() for name, values in log.items()}
    for name in ("q", "tau"):
        found[name][10::10] = found[name][9:-1:10]
    return found


def with_holes(log):
    torque = log["tau"].copy()
    torque[1000:1010, 2] = np.nan
    return {**log, "tau": torque}


def with_velocities(log, factor):
    return {**log, "dq": factor * np.gradient(log["q"], T, axis=0)}


PLANTED = {
    "stamps rounded to 20 ms": (
        lambda log: {**log, "t": np.floor(T / 0.02) * 0.02},
        "repeated stamps",
        {"log": {"time": "t", "time_unit": "s", "rate": 250.0}},
    ),
    "stamps in ms": (
        lambda log: {**log, "t": 1e3 * T},
        "time unit",
        {"log": {"time_unit": "ms"}},
    ),
    "unsteady stamps": (
        lambda log: {**log, "t": T + 1e-3 * np.random.default_rng(2).uniform(size=T.shape)},
        "jitter",
        {"log": {"time": "t", "time_unit": "s", "rate": 250.0}},
    ),
    "missing rows": (
        lambda log: without(log, [1000, 1001, 2500, 2501, 2502]),
        "gaps",
        {"processing": {"longest_gap": pytest.approx(0.0162, rel=0.02)}},
    ),
    "missing torques": (with_holes, "missing values", {"log": {"missing": "fill"}}),
    "torque sensor that is stuck": (
        lambda log: {**log, "tau": log["tau"] * [1, 1, 0]},
        "stuck torque",
        {"processing": {"exclude_joints": [3]}},
    ),
    "clipped torques": (clipped, "saturation", {"processing": {"saturation": True}}),
    "a torque that stands still": (standing, "stuck_torque", {"processing": {"stuck_torque": True}}),
    "rows written twice": (frozen, "repeated", {"processing": {"repeated": True}}),
    "velocities in degrees": (
        lambda log: with_velocities(log, np.degrees(1.0)),
        "velocity unit",
        {"log": {"velocity_unit": "deg/s"}},
    ),
    "velocities of the other sign": (
        lambda log: with_velocities(log, -1.0),
        "measured velocity",
        {"log": {"velocity": "none"}},
    ),
}
"""Faults that are found without a robot."""


@pytest.mark.slow
@pytest.mark.parametrize("fault", PLANTED)
def test_a_planted_fault_is_found_without_a_robot_and_the_line_mends_it(fault, arm, tmp_path):
    plant, kind, remedy = PLANTED[fault]
    log = written(plant(arm[2]), tmp_path / "log.csv")
    found = examine(log)
    assert [one.kind for one in found.findings] == [kind]
    assert found.findings[0].remedy == remedy
    again = examine(log, mended(arm[0], found))
    # Of a joint without torques no motion shows the friction, so none is asked for.
    assert not again.findings


@pytest.mark.slow
@pytest.mark.parametrize("fault", [fault for fault in PLANTED if "stuck" not in fault])
def test_a_log_that_was_mended_is_identified_as_well_as_a_sound_one(fault, arm, tmp_path):
    log = written(PLANTED[fault][0](arm[2]), tmp_path / "log.csv")
    assert error(mended(arm[0], examine(log)), log) < 0.03  # there is 2 % of noise, and 2.05 % in the sound log


BY_THE_MODEL = {
    "degrees": (lambda log: {**log, "q": np.degrees(log["q"])}, "position_unit", "deg"),
    "torques in mN·m": (lambda log: {**log, "tau": 1e3 * log["tau"]}, "torque_unit", "mN·m"),
    "torque sign": (lambda log: {**log, "tau": log["tau"] * [1, -1, 1]}, "torque_sign", [1, -1, 1]),
    "order of torques": (lambda log: {**log, "tau": log["tau"][:, [1, 0, 2]]}, "torque", ["tau2", "tau1", "tau3"]),
    "late torques": (lambda log: late(log, 0.02), "delay", pytest.approx(0.02, abs=5e-4)),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault", [fault if fault == "degrees" else pytest.param(fault, marks=pytest.mark.slow) for fault in BY_THE_MODEL]
)
def test_a_planted_fault_is_found_by_the_model_and_the_line_mends_it(fault, arm, tmp_path):
    plant, key, value = BY_THE_MODEL[fault]
    log = written(plant(arm[2]), tmp_path / "log.csv")
    found = examine(log, arm[0])
    section = "processing" if key == "delay" else "log"
    assert found.remedies == {section: {key: value}}
    robot = mended(arm[0], found)
    assert examine(log, robot).findings == ()
    if fault != "degrees":
        assert error(robot, log) < (0.03 if "mN" in fault else 0.7 * error(arm[0], log))


@pytest.mark.slow
def test_a_sound_log_has_no_finding(arm, tmp_path):
    log = written(arm[2], tmp_path / "log.csv")
    alone, with_robot = examine(log), examine(log, arm[0])
    assert alone.findings == with_robot.findings == ()
    assert alone.remedies == {}
    assert "nothing is wrong" in repr(alone)
    # What was measured is what was made.
    assert alone.facts["rows"].startswith("5000, 19.996 s at 250 Hz")
    rows = {row[0]: dict(zip(alone.joint_heads, row, strict=True)) for row in alone.joint_rows}
    for j in range(3):
        travel = float(rows[f"joint {j + 1}"]["travel"])
        assert travel == pytest.approx(np.ptp(arm[2]["q"][:, j]), rel=1e-2)
        noise = float(rows[f"joint {j + 1}"]["its noise"])
        assert noise == pytest.approx(0.02 * arm[2]["tau"][:, j].std(), rel=0.1)


@pytest.mark.slow
def test_faults_are_all_found_at_once_the_most_harmful_first(arm, tmp_path):
    log = clipped(with_holes(arm[2]))
    path = written({**log, "t": 1e3 * T}, tmp_path / "log.csv")
    found = examine(path)
    assert {one.kind for one in found.findings} == {"time unit", "missing values", "saturation"}
    assert [one.harm for one in found.findings] == ["refused", "refused", "wrong"]
    assert examine(path, mended(arm[0], found)).findings == ()


@pytest.mark.slow
def test_what_the_robot_file_deals_with_is_no_finding(arm, tmp_path):
    log = written(clipped(arm[2]), tmp_path / "log.csv")
    own = tmp_path / "robot.toml"
    own.write_text(arm[0].read_text() + "[processing]\nsaturation = true\n")
    assert examine(log, own).findings == ()


@pytest.mark.slow
def test_a_joint_that_stands_still_is_locked(arm, simulation, tmp_path):
    """The line changes the description, so that it is tried in a file."""
    _, model, _ = arm
    q, dq, ddq = simulation.trajectory(11).motion(T)
    q[:, 2], dq[:, 2], ddq[:, 2] = 0.3, 0.0, 0.0
    torque = model.inverse_dynamics(q, dq, ddq, simulation.true_parameters(model))
    torque += 0.02 * torque.std(axis=0) * np.random.default_rng(1).normal(size=q.shape)
    log = written({"t": T, "q": q, "tau": torque}, tmp_path / "log.csv")
    found = examine(log, arm[0])
    held = next(one for one in found.findings if one.kind == "held joint")
    assert held.remedy == {
        "description": {"locked": {"joint3": 0.3}},
        "log": {"position": ["q1", "q2"], "torque": ["tau1", "tau2"]},
    }
    lines = held.toml.replace("[description]\n", "")
    own = tmp_path / "robot.toml"
    own.write_text(arm[0].read_text().replace("[description]\n", f"[description]\n{lines.partition('[log]')[0]}"))
    own.write_text(own.read_text() + "[log]" + lines.partition("[log]")[2])
    assert "held joint" not in [one.kind for one in examine(log, own).findings]
    assert sy.Model.load(own).dof == 2
    assert [one.advice != "" for one in examine(log).findings if one.kind == "held joint"] == [True]


def test_a_second_run_in_the_same_file_is_told_to_be_split_off(arm, tmp_path):
    log = {name: np.concatenate([values[:2000], values[:2000]]) for name, values in arm[2].items()}
    found = examine(written(log, tmp_path / "log.csv"))
    (one,) = found.findings
    assert (one.kind, one.harm, one.remedy) == ("stamps that go back", "refused", {})
    assert "line 2002" in one.statement
    assert "Split the log" in one.advice


@pytest.mark.slow
@pytest.mark.parametrize("stood", [0.0, 0.4])
def test_a_position_that_jumps_is_told_and_the_pieces_are_right(arm, simulation, stood, tmp_path):
    """The prediction stays good, whose stretches are all spoilt by what filters make of the jump."""
    path, model, log = arm
    q, jumped = log["q"].copy(), 2500
    if stood:
        still = slice(jumped - round(250 * stood), jumped)
        q[still, 1] = q[still.start, 1]
    else:
        q[jumped:, 1] += 0.25
    spoilt = written({**log, "q": q}, tmp_path / "log.csv")
    for robot in (None, path):
        found = examine(spoilt, robot)
        (one,) = [one for one in found.findings if one.kind == "position jumps"]
        assert one is found.findings[0]
        size = q[jumped, 1] - q[jumped - 1, 1]
        assert f"jumps by {size:.3g} at t = 10 s" in one.statement
        assert ("after it stood still for" in one.statement) == bool(stood)
        assert "Cut the log there" in one.advice
    speeds = [LogSurvey.of(sy.Recording(t=T, q=one, torque=log["tau"])).speed for one in (q, log["q"])]
    np.testing.assert_allclose(*speeds, rtol=0.01)  # so that no limit of a velocity is blamed

    result = sy.identify(path, [spoilt])
    assert any(step.action.startswith("Cut the log where a position jumps") for step in next_steps(result))
    begin = jumped - round(250 * stood)
    pieces = [{name: values[:begin] for name, values in log.items()}]
    pieces += [{name: values[jumped:] for name, values in log.items()}] if stood else []
    logs = [written({**piece}, tmp_path / f"piece{k}.csv") for k, piece in enumerate(pieces)]
    mended_result = sy.identify(path, logs)
    assert not any(step.action.startswith("Cut the log") for step in next_steps(mended_result))
    motion = simulation.trajectory(5).motion(T)
    true, *told = (
        one.inverse_dynamics(*motion, parameters)
        for one, parameters in [
            (model, simulation.true_parameters(model)),
            *((one.model, one.estimate.parameters) for one in (result, mended_result)),
        ]
    )
    errors = [np.linalg.norm(torque - true) for torque in told]
    assert errors[1] < 0.2 * errors[0]


def test_positions_that_were_read_as_degrees_are_not_told_to_be_so_again(tmp_path):
    """Milliradians go far beyond the limits, and would fit them as degrees of degrees."""
    log = {"t": T, "q": 1e3 * np.sin(np.outer(T, [1.0, 1.7])), "tau": np.cos(np.outer(T, [1.0, 1.7]))}
    recording = sy.Recording.read(written(log, tmp_path / "log.csv"), {"position_unit": "deg"}, 2)
    limits = [-3.0, -3.0], [3.0, 3.0], [9.0, 9.0]
    assert sum("beyond its limits of -3 and 3" in said for said in LogSurvey.of(recording).limit_remarks(*limits)) == 2


@pytest.mark.parametrize("pause", [3600.0, 1e6])
def test_a_pause_between_two_runs_is_no_slow_rate(arm, pause, tmp_path):
    """Taken for a rate of 1.4 Hz, an hour between them asked for another unit of time, with which nothing is read."""
    path, _, log = arm
    found = examine(written({**log, "t": np.where(T < 10.0, T, T + pause)}, tmp_path / "log.csv"), path)
    assert found.findings == ()
    assert found.facts["pauses"].startswith(f"Nothing was recorded for up to {pause:.4g} s in 1 pauses")
    assert f"{T[-1] - T[1]:.6g} s at" in found.facts["rows"]  # the pause is none of it
    speed, step = found.joint_heads.index("speed"), 25  # rows in 0.1 s
    fastest = np.abs(log["q"][step:] - log["q"][:-step]).max(axis=0) / 0.1
    np.testing.assert_allclose([float(row[speed]) for row in found.joint_rows], fastest, rtol=0.1)


@pytest.mark.slow
def test_coarse_encoders_and_loud_torques_are_told(arm, tmp_path):
    step = np.ptp(arm[2]["q"][:, 0]) / 100
    coarse = {**arm[2], "q": np.round(arm[2]["q"] / step) * step}
    assert "resolution" in [one.kind for one in examine(written(coarse, tmp_path / "coarse.csv")).findings]
    torque = arm[2]["tau"] + 0.8 * arm[2]["tau"].std(axis=0) * np.random.default_rng(5).normal(size=(5000, 3))
    loud = examine(written({**arm[2], "tau": torque}, tmp_path / "loud.csv"))
    assert {one.kind for one in loud.findings} == {"torque noise"}


@pytest.mark.slow
@pytest.mark.parametrize("rows", [1500, pytest.param(5000, marks=pytest.mark.slow)])
def test_a_motion_that_shows_little_is_told_with_the_weak_parameters(rows, arm, simulation, tmp_path):
    """All joints move alike, by little: a short log is overfitted, and much is not determined by either."""
    path, model, _ = arm
    t = T[:rows]
    q = np.outer(0.05 * np.sin(t), [1.0, 0.9, 1.1])
    dq, ddq = np.outer(0.05 * np.cos(t), [1.0, 0.9, 1.1]), -q
    torque = model.inverse_dynamics(q, dq, ddq, simulation.true_parameters(model))
    torque += 0.02 * torque.std(axis=0) * np.random.default_rng(1).normal(size=q.shape)
    found = examine(written({"t": t, "q": q, "tau": torque}, tmp_path / "log.csv"), path)
    one = next(one for one in found.findings if one.kind == "excitation")
    assert f"steelyard excite {path}" in one.advice
    # Numbers of the same regressor, made here; noise and the filter change the small singular values.
    base = model.regressor(q, dq, ddq).reshape(-1, model.parameter_count)[:, model.base_parameters().independent]
    values = np.linalg.svd(base / np.linalg.norm(base, axis=0), compute_uv=False)
    assert values[-1] < 1e-4 * values[0]
    assert found.information.condition_number > 1e4


def test_plain_data_holds_everything(arm, tmp_path):
    found = examine(written(clipped(arm[2]), tmp_path / "log.csv"), arm[0]).to_dict()
    assert [one["toml"] for one in found["findings"]] == ["[processing]\nsaturation = true"]
    assert found["remedies"] == {"processing": {"saturation": True}}
    assert [one["column"] for one in found["columns"]] == ["t", "q1", "q2", "q3", "tau1", "tau2", "tau3"]
    assert [one["joint"] for one in found["joints"]] == ["joint1", "joint2", "joint3"]


@pytest.mark.slow
def test_joints_of_a_description_that_the_log_lacks_are_locked(tmp_path):
    """A hand is described and not logged."""
    joint = (
        '<joint name="j{0}" type="continuous"><parent link="l{1}"/><child link="l{0}"/><origin xyz="0.3 0 0"/>'
        '<axis xyz="0 {2} 0"/></joint><link name="l{0}"><inertial><mass value="{0}"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
    )
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(
        f'<robot name="arm"><link name="l0"/>{"".join(joint.format(k, k - 1, 1) for k in (1, 2, 3))}</robot>'
    )
    t = T[::2]
    q = np.column_stack([np.sin(1.3 * t) + 0.3 * np.sin(4 * t), np.sin(2.1 * t) + 0.2 * np.cos(3.7 * t)])
    log = {"t": t, "q": q, "tau": 5 * np.cos(q) + 0.1 * np.random.default_rng(1).normal(size=q.shape)}
    found = examine(log, urdf)
    one = next(one for one in found.findings if one.kind == "joints without columns")
    assert one.remedy == {"description": {"locked": ["j3"]}}
    assert found.information.joint_names == ("j1", "j2")


def test_a_log_that_is_too_short_is_told(tmp_path):
    t = np.arange(20) / 100
    found = examine({"t": t, "q": np.sin(10 * t)[:, None], "tau": np.cos(10 * t)[:, None]})
    assert [(one.kind, one.harm) for one in found.findings] == [("too little motion", "refused")]


def test_a_torque_that_is_held_with_the_position_is_not_clipped():
    """A servo that answers to its encoder alone asks for the same torque as long as it does not move."""
    t = np.arange(3000) / 150
    q = np.sin(np.interp(t, [0, 8, 14, 20], [0.0, np.pi / 2, np.pi / 2, 2.0]))
    step = 1e-3
    held = {"t": t, "q": np.round(q / step)[:, None] * step, "tau": 3.0 * np.round(q / step)[:, None] * step}
    assert "saturation" not in [one.kind for one in examine(held).findings]
    moving = {**held, "tau": np.clip(3.0 * np.cos(2 * t), -2.0, 2.0)[:, None]}
    assert "saturation" in [one.kind for one in examine(moving).findings]


class TestLongLogs:
    """A long log is looked at in part, and what is found elsewhere is told with its rows."""

    @pytest.fixture(autouse=True)
    def few_rows_are_long(self, monkeypatch):
        from steelyard.recording import log_sample

        for name, rows in (("LONGEST_EXAMINED", 4000), ("IN_THE_MIDDLE", 2000), ("IN_A_STRETCH", 500)):
            monkeypatch.setattr(log_sample, name, rows)

    def examined(self, log, tmp_path, **changes):
        found = examine(written({**log, **changes}, tmp_path / "long.csv"))
        assert "looked at" in found.facts
        return found, {one.kind: one for one in found.findings}

    def test_nothing_is_wrong_with_a_sound_one(self, arm, tmp_path):
        found, kinds = self.examined(arm[2], tmp_path)
        assert not kinds
        assert found.facts["rows"].startswith("5000, 19.996 s at 250 Hz")
        assert found.facts["looked at"].startswith("rows 1501 to 3500 of 5000; ")
        assert found.recording.count == 2000

    @pytest.mark.slow
    def test_with_a_robot_the_model_is_fitted_to_the_part(self, arm, tmp_path):
        path, _, log = arm
        found = examine(written(log, tmp_path / "long.csv"), path)
        assert not found.findings
        assert 5400 < found.information.count <= 6000  # of three joints

    def test_faulty_rows_elsewhere_are_told_with_their_place(self, arm, tmp_path):
        torque = arm[2]["tau"].copy()
        peak = np.abs(torque[:500, 1]).max()
        torque[:500, 1] = np.clip(torque[:500, 1], -0.6 * peak, 0.6 * peak)
        _, kinds = self.examined(arm[2], tmp_path, tau=torque)
        assert list(kinds) == ["saturation"]
        assert kinds["saturation"].statement.endswith("(Seen in rows 1 to 500.)")
        assert kinds["saturation"].toml == "[processing]\nsaturation = true"

    @pytest.mark.slow
    def test_missing_numbers_and_stamps_of_all_rows_are_seen(self, arm, tmp_path):
        torque = arm[2]["tau"].copy()
        torque[4990, 0] = np.nan
        _, kinds = self.examined(arm[2], tmp_path, tau=torque)
        assert kinds["missing values"].statement.startswith("In 1 of the 5000 rows")
        assert kinds["missing values"].remedy == {"log": {"missing": "fill"}}
        _, kinds = self.examined(without(arm[2], slice(900, 905)), tmp_path)
        assert "5 rows are missing in 1 gaps" in kinds["gaps"].statement
        t = T.copy()
        t[4000:] -= 10.0
        _, kinds = self.examined(arm[2], tmp_path, t=t)
        assert "line 4002, goes back in time" in kinds["stamps that go back"].statement

    @pytest.mark.slow
    def test_units_of_time_count_for_all_stamps(self, arm, tmp_path):
        found, kinds = self.examined(arm[2], tmp_path, t=1e3 * T)
        assert kinds["time unit"].remedy == {"log": {"time_unit": "ms"}}
        assert found.facts["rows"].startswith("5000, 19.996 s at 250 Hz")


@pytest.mark.slow
def test_a_log_that_runs_into_a_stop_is_told_with_the_times(arm, tmp_path):
    path, _, log = arm
    torque = log["tau"].copy()
    for row in (1000, 3500):
        torque[row : row + 6, 1] += 8.0 * np.ptp(torque[:, 1]) * np.array([0.2, 0.7, 1.0, 0.6, 0.3, 0.1])
    found = examine(written({**log, "tau": torque}, tmp_path / "stop.csv"), path)
    (event,) = [finding for finding in found.findings if finding.kind == "few rows"]
    assert "at t = 4.0" in event.statement  # rows 1000 and 3500 at 250 Hz
    assert "14.0" in event.statement
    assert 'missing = "fill"' in event.advice


@pytest.mark.slow
def test_a_joint_of_which_no_torque_was_logged_is_excluded(arm, tmp_path):
    """As drivers leave the effort of a single joint NaN. What its torque alone tells asks for no better motion."""
    path, model, log = arm
    torque = log["tau"].copy()
    torque[:, 1] = np.nan
    examination = examine(written({**log, "tau": torque}, tmp_path / "silent.csv"), path)
    assert examination.remedies["log"]["missing"] == "fill"
    assert examination.remedies["processing"]["exclude_joints"] == [2]
    assert not any("Fvj2" in one.statement for one in examination.findings), examination
    result = sy.identify(mended(path, examination), [tmp_path / "silent.csv"])
    own = [name for name in result.unconstrained.base_names if name in ("Fvj2", "Fcj2", "Foj2", "Ia2")]
    assert own
    assert all(result.unconstrained.base[result.unconstrained.base_names.index(name)] == 0.0 for name in own)
    assert not any("Fvj2" in step.reason for step in next_steps(result))
    (told,) = (one for one in result.parameters.sentences if one.startswith("No motion shows"))
    assert f"the logs have no torque of {model.robot.joint_names[1]}, which alone tells them" in told


def test_what_to_do_about_a_missing_torque_is_said_by_those_who_ask_no_doctor(arm, tmp_path):
    path, _, log = arm
    torque = log["tau"].copy()
    torque[:, 1] = np.nan
    with pytest.raises(sy.InputError, match=r'`missing = "fill"` in \[log\] and `exclude_joints = \[2\]` in'):
        sy.identify(path, [written({**log, "tau": torque}, tmp_path / "silent.csv")])


TURN_AND_SLIDE = """<robot name="polar"><link name="base"/>
<link name="column"><inertial><mass value="4"/>
  <inertia ixx="0.4" ixy="0" ixz="0" iyy="0.4" iyz="0" izz="0.5"/></inertial></link>
<link name="boom"><inertial><mass value="2"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="column"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" velocity="9" effort="99"/></joint>
<joint name="reach" type="prismatic"><parent link="column"/><child link="boom"/><axis xyz="1 0 0"/>
  <limit lower="0" upper="0.6" velocity="9" effort="99"/></joint></robot>"""


def polar(folder, limits, rotor=0.0):
    """Write the description of a boom that turns and reaches out; return its path, a motion, and its torques.

    `rotor` is what the motor of the slide adds to its mass, kg.
    """
    path = folder / "polar.urdf"
    ends = 'lower="-2" upper="2"', 'lower="0" upper="0.6"'
    text = TURN_AND_SLIDE
    for end in () if limits else ends:
        text = text.replace(end, 'lower="-999999" upper="999999"')
    path.write_text(text)
    w = np.array([[0.7, 1.9, 3.1], [1.1, 2.3, 2.9]])
    a = np.array([[0.9, 0.3, 0.15], [0.12, 0.07, 0.04]])
    angle = w[None] * T[:, None, None]
    q = (a * np.sin(angle)).sum(axis=2) + np.array([0.0, 0.3])
    dq, ddq = (a * w * np.cos(angle)).sum(axis=2), -(a * w * w * np.sin(angle)).sum(axis=2)
    x, dx = q[:, 1], dq[:, 1]
    torque = np.stack(
        [(0.52 + 2.0 * x**2) * ddq[:, 0] + 4.0 * x * dx * dq[:, 0], 2.0 * (ddq[:, 1] - x * dq[:, 0] ** 2)], axis=1
    )
    torque += np.array([0.2, 0.5]) * np.sign(dq) + np.array([0.1, 0.8]) * dq
    torque[:, 1] += rotor * ddq[:, 1]
    return path, q, torque + 0.01 * torque.std(axis=0) * np.random.default_rng(5).normal(size=q.shape)


@pytest.mark.slow
@pytest.mark.parametrize("limits", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "units", [("deg", "mm"), *(pytest.param(units, marks=pytest.mark.slow) for units in (("deg", "m"), ("rad", "mm")))]
)
def test_units_of_joints_that_turn_and_of_those_that_slide_are_told_apart(tmp_path, units, limits):
    """By the limits where there are any, and by the model; both at once where both are wrong."""
    path, q, torque = polar(tmp_path, limits)
    scale = [{"rad": 1.0, "deg": 180.0 / np.pi, "m": 1.0, "mm": 1e3}[unit] for unit in units]
    log = {"t": T, "q1": q[:, 0] * scale[0], "q2": q[:, 1] * scale[1], "tau1": torque[:, 0], "tau2": torque[:, 1]}
    found = examine(log, path)
    told = tomllib.loads(found.toml)["log"]["position_unit"]
    of_their_kind = {"deg": ("deg", "m"), "mm": ("rad", "mm")}  # one unit is that of all joints that can have it
    assert told == list(units) or of_their_kind[told] == units
    robot = tmp_path / "robot.toml"
    robot.write_text(f'[description]\nurdf = "polar.urdf"\n{found.toml}')
    assert examine(log, robot).findings == ()


@pytest.mark.slow
def test_one_unit_for_all_is_that_of_its_kind_of_joint(tmp_path):
    """A slide whose metres were taken for degrees would weigh a thousand times as much, and predict as well."""
    _, q, torque = polar(tmp_path, False)
    log = {"t": T, "q1": np.degrees(q[:, 0]), "q2": q[:, 1], "tau1": torque[:, 0], "tau2": torque[:, 1]}
    robot = tmp_path / "robot.toml"
    robot.write_text('[description]\nurdf = "polar.urdf"\n[log]\nposition_unit = "deg"\n')
    np.testing.assert_allclose(examine(log, robot).recording.q, q, atol=1e-12)
    answer = sy.identify(robot, [log])
    masses = [row.value for row in answer.parameters if row.name == "m2"]
    assert masses == [pytest.approx(2.0, rel=0.02)]


@pytest.mark.slow
def test_gaps_are_neither_noise_nor_speed(arm, tmp_path):
    path, _, log = arm
    sound = examine(written(log, tmp_path / "sound.csv"), path)
    gaps = np.concatenate([np.arange(1000, 1150), np.arange(2600, 2720), np.arange(300, 5000, 61)])
    found = examine(written(without(log, gaps), tmp_path / "gaps.csv"), path)
    assert "position noise" not in {one.kind for one in found.findings}
    speed = sound.joint_heads.index("speed")
    fastest = [[float(row[speed]) for row in one.joint_rows] for one in (sound, found)]
    np.testing.assert_allclose(fastest[1], fastest[0], rtol=0.05)


def test_stamps_that_are_all_the_same_do_not_go_back(arm, tmp_path):
    path, _, log = arm
    alike = examine(written({**log, "t": np.full(len(T), 1.7e9)}, tmp_path / "run.csv"), path)
    (finding,) = alike.findings
    assert "repeats the time 1.7e+09 s of the row before (4999 rows do so)" in finding.statement
    assert "more digits" in finding.advice


@pytest.mark.slow
def test_rotors_that_identify_takes_in_unasked_are_no_fault(tmp_path):
    """A log of any arm with gears was faulty beside its bare description, for which the answer was right."""
    path, q, torque = polar(tmp_path, limits=True, rotor=3.0)
    log = {"t": T, "q": q, "tau": torque}
    found = examine(log, path)
    assert found.findings == ()
    assert "Ia2 = 3" in found.facts["rotors"]
    robot = tmp_path / "stated.toml"
    kinds = "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in ("viscous", "coulomb", "offset"))
    robot.write_text(f'{kinds}[description]\nurdf = "polar.urdf"\n')
    assert "lacks the inertia of the rotors" in examine(log, robot).findings[0].statement


@pytest.mark.slow
def test_a_joint_without_a_torque_that_moves_is_not_to_be_held_still(tmp_path):
    """The log was said to say nothing of it, and with it held the other joints were weighed wrongly."""
    path, q, torque = polar(tmp_path, limits=True)
    log = {"t": T, "turn_pos": q[:, 0], "reach_pos": q[:, 1], "reach_tau": torque[:, 1]}
    found = examine(log, path)
    assert not [one for one in found.findings if "locked" in one.toml]
    result = sy.identify(path, log)
    assert result.parameters["m2"].value == pytest.approx(2.0, rel=0.02)  # by what the turning asks of the slide
    assert np.isnan(result.prediction.joint_error[0])
    (told,) = [one for one in result.remarks if "No torque of turn was logged" in one]
    assert "the motion is used" in told


GANTRY = """<robot name="gantry"><link name="frame"/>
<link name="bridge"><inertial><mass value="90"/>
  <inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="ram"><inertial><mass value="40"/>
  <inertia ixx="4" iyy="4" izz="4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="prismatic"><parent link="frame"/><child link="bridge"/><axis xyz="1 0 0"/></joint>
<joint name="z" type="prismatic"><parent link="bridge"/><child link="ram"/><axis xyz="0 0 1"/></joint></robot>"""


def picks_and_places(folder):
    """Write the description of a gantry; return its path, and a log of moves of least jerk with rests between."""
    path = folder / "gantry.urdf"
    path.write_text(GANTRY)
    random = np.random.default_rng(4)
    masses, friction = np.array([130.0, 40.0]), np.array([40.0, 25.0])
    dq, ddq = np.zeros((len(T), 2)), np.zeros((len(T), 2))
    for j in range(2):
        at, place = 0.3, 0.0
        while at < 18.5:
            length, away = random.uniform(0.5, 1.2), random.uniform(-0.6, 0.6) - place
            s = np.clip((T - at) / length, 0.0, 1.0)
            dq[:, j] += away * 30.0 * (s * (1.0 - s)) ** 2 / length
            ddq[:, j] += away * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / length**2
            at, place = at + length + random.uniform(0.3, 0.9), place + away
    q = np.cumsum(dq, axis=0) / 250.0
    hold = np.where(dq == 0.0, 0.6 * np.sin(0.9 * T)[:, None], np.sign(dq))  # what holds a joint is anything
    torque = masses * ddq + [0.0, 40.0 * 9.81] + friction * hold + 20.0 * dq + random.normal(size=q.shape)
    return path, {"t": T, "q": np.round(q, 6), "tau": torque}


@pytest.mark.slow
def test_joints_that_wait_between_their_moves_are_no_fault_where_their_rows_are_left_out(tmp_path):
    """Each log of picks and places was faulty, and `doctor` ended with 1."""
    path, log = picks_and_places(tmp_path)
    found = examine(written(log, tmp_path / "log.csv"), path)
    assert found.findings == ()
    robot = tmp_path / "robot.toml"
    robot.write_text('[description]\nurdf = "gantry.urdf"\n[processing]\nvelocity_threshold = "none"\n')
    assert [one.kind for one in examine(tmp_path / "log.csv", robot).findings] == ["stiction"]


@pytest.mark.slow
def test_late_torques_of_picks_and_places_are_told(tmp_path):
    """The search for mistakes found them, the least residual was unsure, and what `identify` goes by was not asked."""
    path, log = picks_and_places(tmp_path)
    (found,) = examine(written(late(log, 0.02), tmp_path / "log.csv"), path).findings
    assert found.kind == "delay"
    assert found.remedy["processing"]["delay"] == pytest.approx(0.02, abs=2e-3)
