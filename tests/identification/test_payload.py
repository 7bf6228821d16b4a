"""Payloads and drive gains from files: what is read, written and said."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from payload_logs import Payload, SimulatedArm

import steelyard as sy
from steelyard.errors import InputError
from steelyard.estimators import CarriedBody, estimate_payload, gains_from_equations
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.constraints import LinearBound
from steelyard.identification import identify_drive_gains, identify_payload
from steelyard.identification.excite import excite

GAINS = np.array([12.0, 11.0, 10.0, 7.0, 7.5, 6.0])
PROCESSING = "[processing]\ncutoff = 5.0\nvelocity_threshold = 0.005\n"


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A folder with logs of a UR5 without and with 2.5 kg, as torques and as currents, and its truth."""
    folder = tmp_path_factory.mktemp("payload")
    arm = SimulatedArm("ur5")
    random = np.random.default_rng(5)
    truth = Payload.random(random, 2.5)
    motion = tuple(array[::2] for array in arm.motion(random))
    for name, held in (("unloaded", None), ("loaded", truth), ("again", None)):
        recording = arm.log(random, held, motion=motion)
        recording.save(folder / f"{name}.csv")
        currents = sy.Recording(t=recording.t, q=recording.q, torque=recording.torque / GAINS)
        currents.save(folder / f"currents_{name}.csv")
    (folder / "robot.toml").write_text(f'[description]\nurdf = "{arm.path}"\n{PROCESSING}')
    (folder / "currents.toml").write_text(
        f'[description]\nurdf = "{arm.path}"\n{PROCESSING}[log]\ntorque_unit = "A"\ngain = "find"\n'
    )
    return folder, truth, arm


def test_the_command_tells_the_payload(logs, run, tmp_path):
    folder, truth, _ = logs
    target = tmp_path / "payload.json"
    files = (folder / "robot.toml", folder / "unloaded.csv", folder / "loaded.csv")
    code, out, _ = run("payload", *files, "--output", target)
    assert code == 0
    assert out.startswith("The payload weighs 2.5")
    assert "frame wrist_3_link" in out
    assert "measured" in out
    document = json.loads(target.read_text())
    assert document["format"] == "steelyard-payload-1"
    assert abs(document["mass"] / truth.mass - 1.0) < 0.02
    np.testing.assert_allclose(document["center_of_mass"], truth.com, atol=2e-3)
    inside = {one["name"]: (one["lower"], one["upper"]) for one in document["quantities"]}
    assert inside["mass"][0] <= truth.mass <= inside["mass"][1]
    assert document["frame"] == "wrist_3_link"
    assert document["certificate"]["verdict"] == "feasible"
    assert [path.name for path in tmp_path.iterdir()] == ["payload.json"]


@pytest.mark.slow
def test_nothing_carried_is_said_first(logs, run, tmp_path):
    folder, _, _ = logs
    files = (folder / "robot.toml", folder / "unloaded.csv", folder / "again.csv")
    code, out, _ = run("payload", *files)
    assert code == 0
    assert out.startswith("The data do not show that anything is carried: it may weigh nothing, and up to 0.0")
    code, out, err = run("payload", *files, "--output", tmp_path)
    assert (code, out) == (2, "")
    assert "is a folder" in err


@pytest.mark.slow
def test_a_log_that_is_given_twice_is_told(logs):
    folder, truth, _ = logs
    found = identify_payload(folder / "robot.toml", folder / "loaded.csv", [folder / "unloaded.csv"] * 2)
    assert abs(found.estimate.parameters[9] / truth.mass - 1.0) < 0.02
    assert any("were given twice, and count twice" in remark for remark in found.remarks)


@pytest.mark.slow
def test_rows_that_two_logs_share_are_told(logs, tmp_path):
    folder, _, _ = logs
    header, *rows = (folder / "unloaded.csv").read_text().splitlines()
    for name, part in (("first", rows[: 2 * len(rows) // 3]), ("second", rows[len(rows) // 3 :])):
        (tmp_path / f"{name}.csv").write_text("\n".join([header, *part]))
    parts = [tmp_path / "first.csv", tmp_path / "second.csv"]
    found = identify_payload(folder / "robot.toml", folder / "loaded.csv", parts)
    assert any("are rows of" in remark and "count twice" in remark for remark in found.remarks)


@pytest.mark.slow
def test_a_payload_that_is_mounted_elsewhere_is_told(logs):
    """Wherever it is said to be, some body comes out, with intervals that know of no wrong place."""
    folder, _, _ = logs
    files = (folder / "robot.toml", folder / "loaded.csv", folder / "unloaded.csv")
    found = identify_payload(*files, frame="forearm_link")
    (told,) = (remark for remark in found.remarks if "mounted elsewhere" in remark)
    assert "fixed to wrist_3_link" in told
    assert "tool0" in told
    right = identify_payload(*files)
    assert f"to {right.estimate.loaded_error:.2%} and not {found.estimate.loaded_error:.2%}" in told
    assert not [remark for remark in right.remarks if "mounted elsewhere" in remark]


@pytest.mark.slow
@pytest.mark.parametrize("changed", ["unit", "order"])
def test_logs_that_a_payload_does_not_explain_are_doubted(logs, tmp_path, changed):
    folder, _, _ = logs
    read = sy.Recording.read(folder / "loaded.csv")
    torque = 1000.0 * read.torque if changed == "unit" else read.torque[:, [0, 1, 2, 4, 3, 5]]
    sy.Recording(t=read.t, q=read.q, torque=torque).save(tmp_path / "loaded.csv")
    found = identify_payload(folder / "robot.toml", tmp_path / "loaded.csv", folder / "unloaded.csv")
    assert found.remarks[0].startswith("More than a payload differs between the logs")
    right = identify_payload(folder / "robot.toml", folder / "loaded.csv", folder / "unloaded.csv")
    assert not [remark for remark in right.remarks if "More than a payload" in remark]


@pytest.mark.slow
@pytest.mark.parametrize("role", ["loaded", pytest.param("unloaded", marks=pytest.mark.slow)])
def test_a_log_that_is_loaded_in_one_part_only_is_told(logs, run, tmp_path, role):
    """Of 2.5 kg that are held from the middle on a mass comes out that neither part has; nothing said so."""
    folder, truth, _ = logs
    before, after = (sy.Recording.read(folder / f"{name}.csv") for name in ("unloaded", "loaded"))
    middle = float(before.t.mean())
    torque = np.where(before.t[:, None] < middle, before.torque, after.torque)
    sy.Recording(t=before.t[::2], q=before.q[::2], torque=torque[::2]).save(tmp_path / "part.csv")
    given = {"unloaded": folder / "again.csv", "loaded": folder / "loaded.csv", role: tmp_path / "part.csv"}
    files = (folder / "robot.toml", given["unloaded"], given["loaded"])
    code, out, _ = run("payload", *files)
    assert code == 0
    told, answer, *_ = out.splitlines()
    seen = re.search(r"between ([\d.]+) and [\d.]+ s: wrist_3_link looks to pick up a body of ([\d.]+)", told)
    assert seen
    begin, found = seen.groups()
    assert abs(float(begin) - middle) < 3.0
    assert abs(float(found) - truth.mass) < 0.1
    assert answer.startswith("The payload comes out at ")
    assert re.search(rf"recorded {'after' if role == 'loaded' else 'before'} [\d.]+ s alone\.$", told)


@pytest.mark.slow
@pytest.mark.parametrize("geared", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_rotors_of_which_nobody_speaks_are_taken_in_where_the_logs_show_them(logs, tmp_path, geared):
    """As `identify` does: without them, the interval of the mass was four times as wide."""
    folder, truth, arm = logs
    random = np.random.default_rng(8)
    motion = tuple(array[::4] for array in arm.motion(random))
    rotors = np.array([0.6, 0.6, 0.4, 0.06, 0.06, 0.06]) * geared
    for name, held in (("unloaded", None), ("loaded", truth)):
        recording = arm.log(random, held, motion=motion)
        torque = recording.torque + rotors * motion[3]
        sy.Recording(t=recording.t, q=recording.q, torque=torque).save(tmp_path / f"{name}.csv")
    found = identify_payload(folder / "robot.toml", tmp_path / "loaded.csv", tmp_path / "unloaded.csv")
    assert any("inertia of a rotor at every joint" in remark for remark in found.remarks) == geared
    assert truth.mass in found.estimate["mass"]
    assert found.estimate["mass"].upper - found.estimate["mass"].lower < 0.03
    assert not found.doubts


@pytest.mark.slow
def test_the_mounting_frame_stands_in_the_robot_file(logs):
    folder, truth, arm = logs
    text = (folder / "robot.toml").read_text()
    (folder / "mounted.toml").write_text(
        f'{text}[payload]\nframe = "tool0"\nplacement = {{ xyz = [0.0, 0.0, 0.1] }}\nmass = 2.5\nchanges = "nothing"\n'
    )
    found = identify_payload(folder / "mounted.toml", folder / "loaded.csv", folder / "unloaded.csv")
    assert found.frame == "tool0"
    assert found.estimate.friction_names == ()
    place = arm.model.robot.frame("tool0")[1]
    center = place[:3, :3] @ (found.estimate.center_of_mass + np.array([0, 0, 0.1])) + place[:3, 3]
    np.testing.assert_allclose(center, truth.com, atol=2e-3)
    assert "The mass of 2.5 kg that [payload] states lies within the interval." in found.sentences()


@pytest.mark.slow
def test_one_log_with_an_estimate(logs, run):
    folder, truth, _ = logs
    samples = sy.Recording.read(folder / "unloaded.csv").process(cutoff=5.0, velocity_threshold=0.005)
    model = sy.Model.load(folder / "robot.toml")
    information = sy.Information.from_samples(model, samples)
    sy.least_squares(information).save(folder / "estimate.json")
    files = (folder / "robot.toml", folder / "loaded.csv", "--estimate", folder / "estimate.json")
    code, out, _ = run("payload", *files)
    assert code == 0
    found = identify_payload(folder / "robot.toml", folder / "loaded.csv", estimate=folder / "estimate.json")
    assert str(found.estimate) in out
    assert truth.mass in found.estimate["mass"]
    # The covariance of the estimate says as much as the rows of the unloaded log; standard errors alone say less.
    better = identify_payload(folder / "robot.toml", folder / "loaded.csv", information)
    alone = replace(sy.least_squares(information), error_correlation=None)
    coarse = identify_payload(folder / "robot.toml", folder / "loaded.csv", estimate=alone)
    widths = [one.estimate["mass"].upper - one.estimate["mass"].lower for one in (found, better, coarse)]
    assert 0.8 < widths[0] / widths[1] < 1.2
    assert widths[2] > 1.2 * widths[0]
    assert found.estimate.mass == pytest.approx(better.estimate.mass, abs=0.3 * widths[1])
    read = sy.Recording.read(folder / "loaded.csv")
    sy.Recording(t=read.t, q=read.q, torque=100.0 * read.torque).save(folder / "another_unit.csv")
    heavy = identify_payload(folder / "robot.toml", folder / "another_unit.csv", estimate=folder / "estimate.json")
    assert heavy.remarks[0].startswith("The payload would weigh more than all the moving links")
    assert not [remark for remark in found.remarks if "moving links" in remark]
    other = sy.Model(model.robot.with_terms(sy.Viscous()))
    wrong = sy.least_squares(sy.Information.from_samples(other, samples))
    with pytest.raises(InputError, match="another robot or of other terms"):
        identify_payload(folder / "robot.toml", folder / "loaded.csv", estimate=wrong)


@pytest.mark.slow
def test_a_heavy_payload_whose_mass_does_not_show_weighs_at_least_something(tmp_path):
    """On a pan-tilt head only the first moments show; it was told that it weighs nan kg."""
    path = tmp_path / "head.urdf"
    inertial = '<inertial><origin xyz="0.01 0 0.02"/><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" '
    inertial += 'ixy="0" ixz="0" iyz="0"/></inertial>'
    text = '<robot name="head"><link name="base"/>'
    for name, parent, axis, height in (("pan", "base", "0 0 1", 0.03), ("tilt", "pan", "0 1 0", 0.06)):
        text += f'<link name="{name}">{inertial}</link><joint name="j_{name}" type="revolute"><parent link="{parent}"/>'
        text += f'<child link="{name}"/><origin xyz="0 0 {height}"/><axis xyz="{axis}"/>'
        text += '<limit lower="-2" upper="2" effort="5" velocity="5"/></joint>'
    path.write_text(text + "</robot>")
    robot = sy.Robot.from_urdf(path).with_terms(sy.Viscous(), sy.Coulomb())
    model, t, random = sy.Model(robot), np.arange(0.0, 20.0, 0.01), np.random.default_rng(1)
    w = np.array([1.9, 2.6])
    q, dq, ddq = (w**n * np.sin(np.outer(t, w) + n * np.pi / 2) for n in range(3))
    empty = np.nan_to_num(np.array(robot.parameters, dtype=float))
    empty[-2:] = 0.01, 0.03
    full = empty.copy()
    full[model.link_columns[1][[0, 3, 5, 6, 8, 9]]] += 6e-3, 6e-3, 1e-3, 0.01, 0.05, 0.7
    for name, own in (("unloaded", empty), ("loaded", full)):
        torque = model.inverse_dynamics(q, dq, ddq, own) + 1e-3 * random.normal(size=q.shape)
        sy.Recording(t=t, q=q, torque=torque).save(tmp_path / f"{name}.csv")
    found = identify_payload(path, tmp_path / "loaded.csv", tmp_path / "unloaded.csv")
    assert np.isnan(found.estimate.mass)
    (said,) = (remark for remark in found.remarks if "moving links" in remark)
    assert said.startswith("The payload would weigh more than all the moving links, at least 0.")


@pytest.mark.slow
def test_the_command_finds_drive_gains(logs, run, tmp_path):
    folder, _, _ = logs
    files = (folder / "currents.toml", folder / "currents_unloaded.csv", folder / "currents_loaded.csv")
    target = tmp_path / "gains.json"
    code, out, _ = run("payload", *files, "--mass", 2.5, "-o", target)
    assert code == 0
    document = json.loads(target.read_text())
    np.testing.assert_allclose(document["gains"], GAINS, rtol=0.03)
    lower, upper = np.array(document["lower"]), np.array(document["upper"])
    assert ((lower <= GAINS) & (upper >= GAINS)).sum() >= 5
    # The line that it prints makes a robot file with which the currents are torques.
    line = next(one for one in out.splitlines() if "gain = [" in one).split(": ")[1]
    known = folder / "known.toml"
    known.write_text((folder / "currents.toml").read_text().replace('gain = "find"', line))
    found = identify_payload(known, files[2], files[1])
    assert found.estimate.mass == pytest.approx(2.5, rel=0.02)


@pytest.mark.slow
def test_some_gains_are_known(logs):
    folder, _, _ = logs
    text = (folder / "currents.toml").read_text()
    (folder / "some.toml").write_text(
        text.replace('"find"', '["find", 11.0, "find", "find", 7.5, "find"]') + "[payload]\nmass = 2.5\n"
    )
    found = identify_drive_gains(folder / "some.toml", folder / "currents_loaded.csv", folder / "currents_unloaded.csv")
    assert found.gains[[1, 4]].tolist() == [11.0, 7.5]
    np.testing.assert_allclose(found.gains, GAINS, rtol=0.03)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("robot.toml", "loaded.csv"), "needs ROBOT UNLOADED LOADED, or ROBOT LOADED with --estimate, got 1 log"),
        (("robot.toml", "loaded.csv", "unloaded.csv"), "a mass of -2.5"),
        (("robot.toml", "unloaded.csv", "unloaded.csv"), "the same rows are given without and with the payload"),
        (("robot.toml", "unloaded.csv", "loaded.csv", "--mass", "2"), "does not ask for any"),
        (("robot.toml", "unloaded.csv", "loaded.csv", "--frame", "tol0"), 'no link "tol0"; did you mean "tool0"?'),
        (("currents.toml", "currents_unloaded.csv", "currents_loaded.csv"), "needs a payload of known mass"),
        (("currents.toml", "currents_unloaded.csv", "currents_loaded.csv", "--mass", "-1"), "a positive number of kg"),
    ],
)
def test_wrong_arguments_are_told_in_one_sentence(logs, run, arguments, message):
    folder, _, _ = logs
    places = [folder / one if one.endswith((".toml", ".csv")) else one for one in arguments]
    code, out, err = run("payload", *places)
    assert code == 2
    assert out == ""
    assert message in err.splitlines()[-1]


def test_identify_asks_for_the_gains_first(logs):
    folder, _, _ = logs
    with pytest.raises(InputError, match=r"currents alone are no torques; .*find them with `steelyard payload"):
        sy.identify(folder / "currents.toml", [folder / "currents_unloaded.csv"])
    text = (folder / "currents.toml").read_text()
    (folder / "matrix.toml").write_text(text + f"torque_matrix = {np.eye(6).tolist()}\n")
    with pytest.raises(InputError, match="torque_matrix and asks for drive gains"):
        sy.identify(folder / "matrix.toml", [folder / "currents_unloaded.csv"])


@pytest.mark.slow
def test_a_motion_designed_for_the_payload_shows_it(tmp_path):
    """`excite` takes the link of [payload] for the word payload; the motion makes all of it measured."""
    (tmp_path / "robot.toml").write_text(
        '[description]\nrows = [["pi/2", 0, 0.3, "q"], [0, 0.4, 0, "q"], ["pi/2", 0.3, 0, "q"]]\n'
        "[limits]\nlower = -1.5\nupper = 1.5\nvelocity = 2.0\n[payload]\nframe = 'link3'\n"
    )
    objective = sy.excitation.ExcitationObjective(criterion="a", subset=["payload"], nuisance="known")
    search = sy.excitation.SearchOptions(starts=1)
    design = excite(tmp_path / "robot.toml", objective=objective, search=search, harmonics=3, rate=100.0)
    assert design.subset[:3] == ("Lxx3", "Lxy3", "Lxz3")
    model = sy.Model.load(tmp_path / "robot.toml")
    _, q, dq, ddq = design.trajectory.sample(100.0)
    body = sy.Inertia.from_com(2.0, [-0.1, 0, 0], 0.02 * np.eye(3)).parameters
    held = sy.Inertia.from_com(1.0, [0.0, 0.05, 0.1], 0.01 * np.eye(3)).parameters
    parameters = np.zeros(model.parameter_count)
    for columns in model.link_columns:
        parameters[columns] = body
    loaded = parameters.copy()
    loaded[model.link_columns[-1]] += held
    random = np.random.default_rng(1)
    both = []
    for one in (parameters, loaded):
        torque = model.inverse_dynamics(q, dq, ddq, one)
        torque = torque + 0.01 * np.sqrt(np.mean(torque**2, axis=0)) * random.normal(size=torque.shape)
        both.append(sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)))
    found = estimate_payload(CarriedBody(model, 2), both[1], both[0])
    assert {one.standing for one in found.quantities[:4]} == {"measured"}
    assert 1.0 in found["mass"]


def servo(shared_data, kp):
    """The samples of a servo with a pendulum, its duty times the nominal voltage in the place of torques."""
    parts = []
    for run in ("sin_sin", "up_and_down", "sin_time_square"):
        with (shared_data / "payload_xl330" / f"kp{kp}_{run}.csv").open() as file:
            rows = list(csv.DictReader(file))
        t, q, duty = (np.array([float(row[key]) for row in rows]) for key in ("t", "q", "duty"))
        recording = sy.Recording(t=t, q=q[:, None], torque=7.4 * duty[:, None])
        parts.append(recording.process(cutoff=8.0, velocity_threshold=None, resample=200.0))
    return sy.Samples.joined(parts)


@pytest.mark.data
def test_a_known_pendulum_tells_the_gain_of_a_real_servo(shared_data):
    """0.49 kg at 0.1 m; the published least squares of these runs have R / kt = 13.6 V/(N·m), and 10.6, 11.9 and 15.6
    by the gain of the position loop, since friction grows with the load."""
    robot = sy.Robot.from_dh([(0, 0, 0, "q")], gravity=(9.81, 0, 0))
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    known = FeasibleSet(model, constraints=[LinearBound("lx1", equal=0.049)])
    by_loop = {kp: sy.Information.from_samples(model, servo(shared_data, kp)) for kp in (100, 400, 800)}
    total = by_loop[100] + by_loop[400] + by_loop[800]
    found = gains_from_equations(total, known)
    assert 1.0 / found.gains[0] == pytest.approx(13.6, rel=0.02)
    for kp, expected in ((100, 10.6), (400, 11.9), (800, 15.6)):
        assert 1.0 / gains_from_equations(by_loop[kp], known).gains[0] == pytest.approx(expected, rel=0.02)
    # The other way round: with that gain the pendulum weighs what it weighs.
    weighed = sy.least_squares(total).base[list(model.base_parameters().names).index("lx1")] / 13.6 / 0.1
    assert weighed == pytest.approx(0.49, rel=0.03)


@pytest.mark.data
def test_a_payload_on_a_real_arm(shared_data):
    """Two runs of a real Gen3, and the torques of a payload that Pinocchio adds to the second.

    The runs are short, and the model misses 5 to 15 % of their torques, which is said; the mass comes out to 0.4 kg.
    """
    pinocchio = pytest.importorskip("pinocchio")
    folder = shared_data / "kinova_gen3"
    robot = sy.Robot.from_urdf(folder / "gen3.urdf")
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia()))
    options = {"cutoff": 3.0, "order": 3, "trim": 0.0, "velocity_threshold": None}
    names = ("opti_traj_testing1.csv", "opti_traj_testing2.csv")
    alone, other = (sy.Recording.read(folder / name).process(**options) for name in names)
    arm = pinocchio.buildModelFromUrdf(str(folder / "gen3.urdf"))
    held = Payload.random(np.random.default_rng(1), 3.0)
    loaded = arm.copy()
    body = pinocchio.Inertia(held.mass, held.com, held.about_com)
    loaded.appendBodyToJoint(loaded.njoints - 1, body, pinocchio.SE3.Identity())
    both = [(one, one.createData()) for one in (arm, loaded)]
    added = np.zeros_like(other.torque)
    for row, (q, dq, ddq) in enumerate(zip(other.q, other.dq, other.ddq, strict=True)):
        full = pinocchio.neutral(arm)
        for k, value in enumerate(q):
            joint = arm.joints[k + 1]
            pair = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            full[joint.idx_q : joint.idx_q + joint.nq] = pair
        first, second = (pinocchio.rnea(one, data, full, dq, ddq) for one, data in both)
        added[row] = second - first
    with_it = sy.Samples(q=other.q, dq=other.dq, ddq=other.ddq, torque=other.torque + added, mask=other.mask)
    informations = [sy.Information.from_samples(model, one) for one in (alone, with_it)]
    found = estimate_payload(CarriedBody(model, 6), informations[1], informations[0])
    assert abs(found.mass - 3.0) < 0.4
    assert found.loaded_error < 0.1 < 0.4 < found.robot_alone_error
    assert any("too narrow" in remark for remark in found.remarks)
