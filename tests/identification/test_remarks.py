"""What a log shows of wrong units, held joints and swapped columns reaches the answer; sound logs show none."""

import re
from dataclasses import replace
from types import SimpleNamespace

import lxml.html
import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.identification import examine
from steelyard.identification.doubts import heavy_ends
from steelyard.identification.first_robot_file import first_robot_file
from steelyard.identification.log_reader import against_limits
from steelyard.identification.next_steps import found, next_steps
from steelyard.recording.survey import LogSurvey

COUNT, RATE = 6000, 500.0
CHAIN = '<robot name="chain"><link name="l0"/>' + "".join(
    f'<link name="l{k}"/><joint name="j{k}" type="continuous"><parent link="l{k - 1}"/><child link="l{k}"/></joint>'
    for k in (1, 2, 3)
)
CHAIN += "</robot>"


@pytest.fixture(scope="module")
def arm(simulation, tmp_path_factory):
    """Return the robot file, its model, and a sound log of 12 s with measured velocities."""
    path = tmp_path_factory.mktemp("arm") / "robot.toml"
    path.write_text(simulation.robot_file)
    model = sy.Model.load(path)
    t, q, dq, ddq = simulation.trajectory(11).sample(RATE, 1.2)
    torque = model.inverse_dynamics(q, dq, ddq, simulation.true_parameters(model))
    torque += 0.05 * np.random.default_rng(1).normal(size=q.shape)
    return path, model, sy.Recording(t=t, q=q, torque=torque, velocity=dq, source="log")


def remarks(arm, folder, log, chunk_rows=200_000, **options):
    path = arm[0]
    result = sy.identify(path, [log.save(folder / "log.npz")], chunk_rows=chunk_rows, **options)
    return [remark for remark in result.remarks if "Positions were filtered" not in remark]


CHUNKS = [200_000, pytest.param(2000, marks=pytest.mark.slow)]

MISTAKES = {
    "degrees": (lambda log: replace(log, q=np.degrees(log.q), velocity=None), ['`position_unit = "deg"`', "gears"]),
    "positions of motors": (
        lambda log: replace(log, q=500 * log.q, velocity=None),
        ["those of the motors", "`position_matrix`"],
    ),
    "torques in mN·m": (
        lambda log: replace(log, torque=1e3 * log.torque),
        [
            "times too large, as if in",
            "mN·m (the description has no masses that tell by how much)",
            'with `torque_unit = "mN·m"` in [log] the error falls',
        ],
    ),
    "torques a hundredth": (lambda log: replace(log, torque=log.torque / 100), ["kg together", "`gain`"]),
    "held joint": (
        lambda log: replace(log, q=log.q * [1, 1, 0], velocity=log.velocity * [1, 1, 0]),
        ["joint 'joint3' is 0 throughout"],
    ),
}


@pytest.mark.parametrize("chunk_rows", CHUNKS)
def test_a_sound_log_is_not_remarked_on(arm, tmp_path, chunk_rows):
    assert remarks(arm, tmp_path, arm[2], chunk_rows) == []


@pytest.mark.slow
@pytest.mark.parametrize("bits", [12, 20])
def test_counts_of_encoders_are_refused_and_the_lines_that_are_named_mend_it(arm, simulation, tmp_path, bits):
    path, _, log = arm
    (path.parent / "chain.urdf").write_text(CHAIN)
    turn, zero = 2**bits, 2 ** (bits - 1)
    counts = np.rint(log.q / (2.0 * np.pi) * turn + zero)
    given = {"t": log.t, **{f"q{j + 1}": counts[:, j] for j in range(3)}}
    given |= {f"tau{j + 1}": log.torque[:, j] for j in range(3)}
    np.savez(tmp_path / "log.npz", **given)
    told = r"counts of encoders.*`position_matrix` in \[log\].*`position_offset`"
    (alone,) = examine(tmp_path / "log.npz").findings
    assert alone.harm == "wrong"
    assert re.search(told, alone.statement)
    speeds = given | {f"dq{j + 1}": log.velocity[:, j] for j in range(3)}  # rad/s, which are no counts
    for use in (
        lambda: examine(tmp_path / "log.npz", path),
        lambda: sy.identify(path, tmp_path / "log.npz"),
        lambda: sy.identify(path, speeds),
        lambda: sy.Recording.read(speeds),
        lambda: first_robot_file(path.parent / "chain.urdf", tmp_path / "log.npz"),
    ):
        with pytest.raises(InputError, match=told):
            use()
    columns = {
        "position_matrix": [[f"2*pi/{turn}" if i == j else 0 for j in range(3)] for i in range(3)],
        "position_offset": [-2.0 * np.pi * zero / turn] * 3,
    }
    result = sy.identify(path, tmp_path / "log.npz", columns=columns)
    assert result.prediction.word == "good"
    truth = dict(zip(result.parameter_names, simulation.true_parameters(arm[1]), strict=True))
    assert result.parameters["Fcj2"].lower <= truth["Fcj2"] <= result.parameters["Fcj2"].upper


LIMITED = CHAIN.replace("continuous", "revolute").replace(
    "</joint>", '<limit lower="-6" upper="6" effort="9" velocity="6"/></joint>'
)


@pytest.mark.slow
@pytest.mark.parametrize("described", [CHAIN, LIMITED], ids=["continuous", "limited"])
@pytest.mark.parametrize("turn", [36_000, 360_000, 1_000_000, 2**31], ids=str)
def test_positions_in_a_unit_of_their_own_are_refused_and_the_line_that_is_named_mends_it(
    arm, simulation, tmp_path, described, turn
):
    path, _, log = arm
    (tmp_path / "chain.urdf").write_text(described)
    q = log.q / (2.0 * np.pi) * turn + 0.37
    given = {
        "t": log.t,
        **{f"q{j + 1}": q[:, j] for j in range(3)},
        **{f"tau{j + 1}": log.torque[:, j] for j in range(3)},
    }
    np.savez(tmp_path / "log.npz", **given)
    told = r"positions of .*joint.*, taken in rad, are those of no robot: .* revolutions .*`position_matrix` in \[log\]"
    speeds = given | {f"dq{j + 1}": log.velocity[:, j] for j in range(3)}
    for use in (
        lambda: examine(tmp_path / "log.npz", tmp_path / "chain.urdf"),
        lambda: sy.identify(tmp_path / "chain.urdf", tmp_path / "log.npz"),
        lambda: sy.identify(tmp_path / "chain.urdf", speeds),
        lambda: first_robot_file(tmp_path / "chain.urdf", tmp_path / "log.npz"),
    ):
        with pytest.raises(InputError, match=told):
            use()
    (alone,) = [one for one in examine(tmp_path / "log.npz").findings if one.harm == "wrong"]
    assert re.search(told, f"the {alone.statement.removeprefix('The ')}")
    matrix = [[f"2*pi/{turn}" if i == j else 0 for j in range(3)] for i in range(3)]
    offset = [-0.37 * 2.0 * np.pi / turn] * 3
    mended = sy.identify(path, given, columns={"position_matrix": matrix, "position_offset": offset})
    assert mended.prediction.word == "good"
    truth = dict(zip(mended.parameter_names, simulation.true_parameters(arm[1]), strict=True))
    assert mended.parameters["Fcj2"].lower <= truth["Fcj2"] <= mended.parameters["Fcj2"].upper


def test_slides_in_micrometres_are_refused(tmp_path):
    (tmp_path / "chain.urdf").write_text(CHAIN.replace("continuous", "prismatic"))
    t = np.arange(3000) * 0.01
    log = {"t": t} | {f"q{k}": 1e5 * np.sin(k * t) for k in (1, 2, 3)} | {f"tau{k}": np.cos(k * t) for k in (1, 2, 3)}
    with pytest.raises(InputError, match=r"taken in m, are those of no robot: .*`position_matrix` in \[log\].*1e-6"):
        sy.identify(tmp_path / "chain.urdf", log)


@pytest.mark.parametrize(
    ("described", "q"),
    [
        (CHAIN, lambda t: 80.0 * t + np.sin(t)),  # a wheel, 5 minutes long
        (LIMITED, lambda t: 80.0 * t + np.sin(t)),  # and one with the limits of an arm
        (LIMITED, lambda t: 160.0 * 3.0 * np.sin(3.0 * t)),  # of motors in front of gears
        (CHAIN, lambda t: 3e6 + np.sin(3.0 * t)),  # far from zero
        (CHAIN, lambda t: np.where(np.arange(len(t)) % 1000 < 20, 1e6, np.sin(3.0 * t))),  # wild readings
        (LIMITED, lambda t: np.where(np.arange(len(t)) % 1000 < 20, 65535.0, np.sin(3.0 * t))),
        (LIMITED.replace('"6"', '"1.7e308"').replace('"-6"', '"-1.7e308"'), lambda t: np.sin(3.0 * t)),
        (CHAIN, lambda t: np.sin(3e4 * t)),  # an alias, or another unit of time
        (CHAIN.replace("continuous", "prismatic"), lambda t: 900.0 * np.sin(3.0 * t)),  # millimetres
    ],
)
def test_joints_that_turn_many_times_are_not_refused(tmp_path, described, q):
    (tmp_path / "chain.urdf").write_text(described)
    t = np.arange(30_000) * 0.01
    log = sy.Recording(t=t, q=np.column_stack([q(t)] * 3), torque=np.cos(t)[:, None] * np.ones(3), source="log")
    robot = sy.Robot.from_urdf(tmp_path / "chain.urdf")
    found = (*log.checked().remarks, *against_limits(LogSurvey.of(log), robot))
    assert not any("no robot" in one for one in found)


def test_a_wild_reading_of_a_short_log_does_not_make_its_positions_those_of_no_robot(tmp_path):
    (tmp_path / "chain.urdf").write_text(LIMITED)
    t, robot = np.arange(20) * 0.01, sy.Robot.from_urdf(tmp_path / "chain.urdf")
    for wild, refused in ((t == 0.1, False), (t >= 0.0, True)):
        q = np.where(wild, 65535.4 * t, t)[:, None] * np.ones(3)
        log = sy.Recording(t=t, q=q, torque=np.cos(t)[:, None] * np.ones(3), source="log")
        try:
            found = against_limits(LogSurvey.of(log), robot)
        except InputError as error:
            found = (str(error),)
        assert any("no robot" in one for one in found) == refused


@pytest.mark.parametrize(
    "q",
    [
        lambda q: np.rint(np.degrees(q)),  # degrees without digits
        lambda q: 300.0 * q,  # of motors in front of gears
        lambda q: 4096.0 + q,  # far from zero
        lambda q: np.where(np.arange(len(q))[:, None] % 3, 1000.0 * q, np.rint(1000.0 * q)),
    ],
)
def test_what_is_no_count_is_not_taken_for_one(arm, q):
    found = replace(arm[2], q=q(arm[2].q), velocity=None).checked().remarks
    assert not any("counts of encoders" in remark for remark in found)


def test_whole_millimetres_of_slides_are_no_counts(tmp_path):
    """A rail of two metres that is logged in millimetres without digits keeps the line that mends it."""
    limits = '<limit lower="-1" upper="1" effort="9" velocity="3"/></joint>'
    sliding = CHAIN.replace("continuous", "prismatic").replace("</joint>", limits)
    (tmp_path / "rails.urdf").write_text(sliding)
    t = np.arange(3000) * 0.01
    table = {"t": t} | {f"q{k}": np.rint(900.0 * np.sin(k * t)) for k in (1, 2, 3)}
    table |= {f"tau{k}": np.cos(k * t) for k in (1, 2, 3)}
    with pytest.raises(InputError, match=r'position_unit = \["mm", "mm", "mm"\]'):
        sy.identify(tmp_path / "rails.urdf", table)


@pytest.mark.slow
@pytest.mark.parametrize("chunk_rows", CHUNKS)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_said(arm, tmp_path, mistake, chunk_rows):
    change, words = MISTAKES[mistake]
    found = remarks(arm, tmp_path, change(arm[2]), chunk_rows)
    assert any(all(word in remark for word in words) for remark in found), found


@pytest.mark.slow
def test_clipped_torques_are_to_be_left_out_before_anything_else(arm, simulation, tmp_path):
    path, model, log = arm
    most = 0.5 * np.abs(log.torque).max(axis=0)
    clipped = replace(log, torque=np.clip(log.torque, -most, most)).save(tmp_path / "log.npz")
    found = sy.identify(path, [clipped])
    assert found.prediction.word != "good"
    first = next_steps(found)[0]
    assert first.code == "[processing]\nsaturation = true"
    assert "where the torque is clipped" in first.reason
    # The advice is worth it: of the true torques of another motion hardly anything is left.
    _, *motion = simulation.trajectory(12).sample(RATE, 1.0)
    torque = model.inverse_dynamics(*motion, simulation.true_parameters(model))
    mended = sy.identify(path, [clipped], processing={"saturation": True, "cutoff": 10.0, "trim": 0.5})
    errors = [model.inverse_dynamics(*motion, one.estimate.parameters) - torque for one in (found, mended)]
    before, after = (np.linalg.norm(error) / np.linalg.norm(torque) for error in errors)
    assert after < 0.01 < 0.1 < before
    assert not any("saturation" in step.code for step in next_steps(mended))


@pytest.mark.slow
def test_torques_that_stand_still_are_to_be_left_out_and_then_the_answer_is_right(arm, simulation, tmp_path):
    path, model, log = arm
    torque, second = log.torque.copy(), slice(int(4 * log.rate), int(5 * log.rate))
    torque[second, 1] = torque[second.start, 1]
    stuck = replace(log, torque=torque).save(tmp_path / "log.npz")
    found = sy.identify(path, [stuck])
    first = next_steps(found)[0]
    assert first.code == "[processing]\nstuck_torque = true"
    assert f"{round(log.rate)} rows in 1 intervals are of a torque that stands still" in first.reason
    _, *motion = simulation.trajectory(12).sample(RATE, 1.0)
    true = model.inverse_dynamics(*motion, simulation.true_parameters(model))
    mended = sy.identify(path, [stuck], processing={"stuck_torque": True, "cutoff": 10.0, "trim": 0.5})
    errors = [model.inverse_dynamics(*motion, one.estimate.parameters) - true for one in (found, mended)]
    before, after = (np.linalg.norm(error) / np.linalg.norm(true) for error in errors)
    assert after < 0.01 < 0.05 < before
    assert not any("stuck_torque" in step.code for step in next_steps(mended))


@pytest.mark.slow
@pytest.mark.parametrize("chunk_rows", CHUNKS)
def test_stamps_in_ms_at_5_khz_are_said(arm, tmp_path, chunk_rows):
    """The motion is ten times as fast here as at 500 Hz."""
    path, _, log = arm
    slow = replace(log, t=np.arange(COUNT) / 5.0, velocity=None)
    with pytest.raises(sy.InputError, match=r"sampled at 5 Hz.* correct `time_unit`"):
        remarks(arm, tmp_path, slow, chunk_rows)
    free = tmp_path / "robot.toml"
    free.write_text(path.read_text().split("[processing]")[0])
    found = remarks((free,), tmp_path, slow, chunk_rows)
    assert any('5000 Hz with `time_unit = "ms"`' in remark for remark in found)
    with pytest.raises(sy.InputError, match='the times are in ms: state `time_unit = "ms"`'):
        remarks((free,), tmp_path, replace(slow, velocity=10.0 * log.velocity), chunk_rows)


@pytest.mark.slow
@pytest.mark.parametrize("chunk_rows", CHUNKS)
def test_limits_are_those_of_the_whole_log(arm, tmp_path, chunk_rows):
    """Beyond a position and a velocity limit after more than a chunk."""
    path, _, log = arm
    q, moving = log.q.copy(), np.arange(COUNT) > 4000
    q[:, 0] *= 0.2
    q[:, 0] += 4.0 * moving * np.sin(0.5 * np.pi * (log.t - log.t[4000]) / 2.0) ** 4
    strict = tmp_path / "robot.toml"
    strict.write_text(path.read_text() + "[limits]\nlower = -3.2\nupper = 3.2\nvelocity = 2.5\n")
    found = remarks((strict,), tmp_path, replace(log, q=q, velocity=None), chunk_rows)
    assert any("position of joint 'joint1' goes" in remark and "beyond its limits" in remark for remark in found)
    assert any("Joint 'joint1' moves at" in remark for remark in found)


@pytest.mark.slow
def test_swapped_columns_are_looked_for_in_every_log(arm, tmp_path):
    path, _, log = arm
    swapped = replace(log, torque=log.torque[:, [1, 0, 2]], velocity=None)
    logs = [log.save(tmp_path / "first.npz"), swapped.save(tmp_path / "second.npz")]
    (remark,) = [one for one in sy.identify(path, logs).remarks if "look swapped" in one]
    assert remark.startswith(f"{logs[1]}: The torque columns of joint1 and joint2")
    (remark,) = [one for one in sy.identify(path, logs[:1], validate=logs[1:]).remarks if "look swapped" in one]
    assert remark.startswith(str(logs[1]))


@pytest.mark.slow
def test_filled_values_are_said_chunk_by_chunk(arm, tmp_path):
    path, _, log = arm
    q = log.q.copy()
    q[5000:5003, 1] = np.nan
    columns = {"t": log.t, **{f"q{j + 1}": q[:, j] for j in range(3)}}
    np.savez(tmp_path / "log.npz", **columns, **{f"tau{j + 1}": log.torque[:, j] for j in range(3)})
    filling = tmp_path / "robot.toml"
    filling.write_text(path.read_text() + '[log]\nmissing = "fill"\n')
    found = sy.identify(filling, [tmp_path / "log.npz"], chunk_rows=2000).remarks
    assert any("3 positions are missing" in remark for remark in found)


@pytest.mark.slow
def test_a_tool_that_the_description_leaves_out_is_asked_for():
    """The log is that of an arm with a tool of 3 kg."""
    body = sy.Inertia.from_com(2.0, [0.2, 0.0, 0.0], np.diag([0.01, 0.02, 0.02]))
    tool = sy.Inertia.from_com(3.0, [0.5, 0.0, 0.0], np.diag([0.01, 0.01, 0.01]))
    rows = [("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")]
    robot = sy.Robot.from_dh(rows, inertias={"link1": body, "link2": body}, gravity=(0, 0, -9.81))
    model = sy.Model(robot)
    t = np.arange(1200)[:, None] / 100.0
    w = np.array([2.0, 3.1])
    q, dq, ddq = np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)
    random = np.random.default_rng(1)

    def said(*bodies):
        truth = np.concatenate([one.parameters for one in bodies])
        torque = model.inverse_dynamics(q, dq, ddq, truth) + 0.05 * random.normal(size=q.shape)
        result = sy.identify(robot, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t[:, 0]))
        return heavy_ends(model, result.parameters, result.prediction)

    [remark] = said(body, body + tool).values()
    assert remark.startswith("link2 comes out at")
    assert "where the description has 2 kg" in remark
    assert not said(body, body)


@pytest.mark.slow
def test_numbers_of_a_joint_that_is_not_predicted_rest_on_a_model_that_is_wrong(arm, simulation):
    """The drag of joint 3 grows with the cube of its speed, for which the model has viscous friction alone."""
    path, model, log = arm
    truth = dict(zip(model.parameter_names, simulation.true_parameters(model), strict=True))
    drag = log.velocity[:, 2] ** 3
    drag *= log.torque[:, 2].std() / drag.std()
    sound, misled = (
        sy.identify(path, replace(log, torque=log.torque + of_cube * drag[:, None] * [0.0, 0.0, 1.0]))
        for of_cube in (0.0, 1.0)
    )
    row = misled.parameters["Fvj3"]
    assert row.basis == "assumed"
    assert not row.lower <= truth["Fvj3"] <= row.upper
    assert "the torque of joint3 (" in misled.caveat
    assert "joint1" not in misled.caveat  # whose torques are predicted to 1 %
    assert misled.caveat in found(misled)
    assert lxml.html.fromstring(misled.report()).text_content().count(misled.caveat) == 2  # and beside the numbers
    assert sound.parameters["Fvj3"].lower <= truth["Fvj3"] <= sound.parameters["Fvj3"].upper
    assert sound.caveat == ""


def test_a_model_that_misses_no_joint_by_much_is_doubted_as_a_whole(arm, simulation):
    """Errors of 20 % that last, in all joints: no single joint is to blame, and none is named."""
    path, _, log = arm
    slow = np.cumsum(np.random.default_rng(4).normal(size=log.torque.shape), axis=0)
    slow = (slow - slow.mean(axis=0)) / slow.std(axis=0)
    size = 0.2 * np.sqrt(np.mean(log.torque**2, axis=0))
    result = sy.identify(path, replace(log, torque=log.torque + size * slow))
    assert result.prediction.word == "poor"
    assert (
        f"misses {result.prediction.model_error:.0%} of the torques of {result.prediction.source}: any number may lie "
        "outside."
    ) in result.caveat


@pytest.mark.parametrize(
    ("before", "said"),
    [
        (0.03261, "3.26% of the torques of the same data unexplained, just as much."),
        (0.0312, "3.26% of the torques of the same data unexplained instead of 3.12%."),
    ],
)
def test_errors_that_print_alike_are_not_said_to_differ(before, said):
    result = SimpleNamespace(
        prediction=SimpleNamespace(word="good"),
        parameters=None,
        verdict=SimpleNamespace(feasible=False, violations=[]),
        unconstrained=SimpleNamespace(relative_error=before),
        estimate=SimpleNamespace(relative_error=0.03264),
        missed_by_description="",
    )
    (told,) = found(result)
    assert told.endswith(said)


@pytest.mark.slow
def test_a_body_that_is_picked_up_within_a_log_is_told_before_all_else(arm, simulation, tmp_path):
    path, model, log = arm
    t, q, dq, ddq = simulation.trajectory(11).sample(RATE, 1.2)
    body = np.zeros(model.parameter_count)
    box = sy.Inertia.from_com(2.0, [0.0, 0.02, 0.08], 0.004 * np.eye(3))
    body[np.asarray(model.link_columns[-1])] = box.parameters
    pick = 0.4 * t[-1]
    loaded = log.torque + (t > pick)[:, None] * model.inverse_dynamics(q, dq, ddq, body)
    recorded = replace(log, torque=loaded).save(tmp_path / "log.npz")
    result = sy.identify(path, [recorded])
    (change,) = result.changes.values()
    assert change.mass == pytest.approx(2.0, abs=3.0 * change.standard_error)
    assert change.earliest - 0.2 < pick < change.latest + 0.2
    first = next_steps(result)[0]
    assert "looks to pick up a body of" in first.reason
    assert change.sentence(str(recorded)) in result.remarks
    assert first.code == f"[processing]\ntrim = {change.trim}"
    assert not any("friction" in step.code for step in next_steps(result))
    (finding,) = [one for one in examine(recorded, path).findings if one.kind == "robot changes"]
    assert finding.toml.strip() == first.code
    robot = tmp_path / "robot.toml"
    robot.write_text(simulation.robot_file.replace("trim = 0.5", f"trim = {change.trim}"))
    again = sy.identify(robot, [recorded])
    assert str(change.trim) in robot.read_text()
    assert not again.changes
    assert again.estimate.relative_error < 0.5 * result.estimate.relative_error


@pytest.mark.parametrize(("rate", "told"), [(15.0, True), (25.0, False)])
def test_few_samples_for_a_motion_are_told_by_what_differences_take_off(rate: float, told: bool) -> None:
    """What they take is that of the differences of a sine, whose derivatives are known, and viscous friction is right.

    Differences of second order left it 15 and 6 standard errors wrong.
    """
    robot = sy.Robot.from_dh([(0, 0.3, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))
    t, w = np.arange(0.0, 30.0, 1.0 / rate)[:, None], 2.0 * np.pi * 0.7
    q, dq, ddq = np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)
    link = sy.Inertia.from_com(2.0, [-0.1, 0.0, 0.0], 0.02 * np.eye(3)).parameters
    torque = model.inverse_dynamics(q, dq, ddq, [*link, 0.3, 0.4])
    torque += 0.01 * np.random.default_rng(1).normal(size=q.shape)
    result = sy.identify(model, sy.Recording(t=t[:, 0], q=q, torque=torque))
    viscous = result.estimate.base_names.index("Fvj1")
    deviation = np.sqrt(result.unconstrained.covariance[viscous, viscous])
    assert abs(result.unconstrained.base[viscous] - 0.3) < 3.0 * deviation
    said = [remark for remark in result.remarks if "samples a second are few" in remark]
    assert len(said) == told
    if told:
        step = w / rate
        taken = 1.0 - ((8.0 * np.sin(step) - np.sin(2.0 * step)) / (6.0 * step)) ** 2
        assert float(re.search(r"take ([\d.]+)% off", said[0]).group(1)) == pytest.approx(100.0 * taken, rel=0.1)
