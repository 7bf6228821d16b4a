"""Saved estimates on logs that they have not seen, against simulations of Pinocchio."""

import hashlib
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from payload_logs import Payload, SimulatedArm

import steelyard as sy
from steelyard.errors import InputError
from steelyard.identification import examine, validate_estimate
from steelyard.identification.next_steps import next_steps
from steelyard.identification.saved_result import SavedResult
from steelyard.recording import Recording
from steelyard.recording.formats import remote

SETTINGS = "[processing]\ncutoff = 5.0\nvelocity_threshold = 0.005\n"


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Three logs of a UR5, one of them with 2 kg in its hand, and an estimate from the first."""
    folder = tmp_path_factory.mktemp("validation")
    arm = SimulatedArm("ur5")
    (folder / "robot.toml").write_text(f'[description]\nurdf = "{arm.path}"\n{SETTINGS}')
    random = np.random.default_rng(21)
    payload = Payload.random(random, 2.0)
    for name, held in (("one", None), ("two", None), ("loaded", payload)):
        arm.log(random, held).save(folder / f"{name}.csv")
    samples = Recording.read(folder / "one.csv").process(cutoff=5.0, velocity_threshold=0.005)
    sy.least_squares(sy.Information.from_samples(arm.model, samples)).save(folder / "estimate.json")
    return folder, arm


def test_errors_are_those_of_the_samples(logs):
    folder, arm = logs
    found = validate_estimate(folder / "robot.toml", folder / "estimate.json", [folder / "two.csv"])
    base = sy.Estimate.load(folder / "estimate.json").base
    samples = Recording.read(folder / "two.csv").process(cutoff=5.0, velocity_threshold=0.005)
    W = arm.model.kernel("regressor", base=True)(samples.q, samples.dq, samples.ddq)
    residuals = samples.torque - (np.asarray(W).reshape(samples.count, arm.model.dof, -1) @ base)
    used = np.ones(residuals.shape, dtype=bool) if samples.mask is None else samples.mask
    rms = np.array([np.sqrt(np.mean(residuals[used[:, k], k] ** 2)) for k in range(6)])
    torque = np.array([np.sqrt(np.mean(samples.torque[used[:, k], k] ** 2)) for k in range(6)])
    np.testing.assert_allclose(found.prediction.joint_error, rms, rtol=1e-9)
    np.testing.assert_allclose(found.prediction.joint_relative_error, rms / torque, rtol=1e-9)
    assert found.prediction.word == "good"
    # The noise of the simulation is 1.5 % of the torque of each joint.
    np.testing.assert_allclose(found.prediction.joint_relative_error, 0.015, rtol=0.15)
    # Eq. 4.37: over all rows of all joints, of which slow rows leave each joint another number.
    assert len(set(used.sum(axis=0))) > 1
    whole = np.linalg.norm(residuals[used]) / np.linalg.norm(samples.torque[used])
    assert found.prediction.relative_error == pytest.approx(whole, rel=1e-9)
    assert found.logs[0].relative_error == pytest.approx(whole, rel=1e-9)
    assert any("No run.json stands beside" in remark for remark in found.remarks)


def test_a_joint_that_runs_harder_is_told_though_the_prediction_is_good(logs, tmp_path):
    folder, arm = logs
    fitted = sy.Information.from_samples(
        arm.model, Recording.read(folder / "one.csv").process(cutoff=5.0, velocity_threshold=0.005)
    )
    sy.least_squares(fitted, weights="joint").save(tmp_path / "estimate.json")
    recording = Recording.read(folder / "two.csv")
    torque = recording.torque.copy()
    torque[:, 2] += 0.08 * torque[:, 2].std() * np.sign(np.gradient(recording.q[:, 2], recording.t))
    harder = replace(recording, torque=torque).save(tmp_path / "harder.csv")
    sound, found = (
        validate_estimate(folder / "robot.toml", tmp_path / "estimate.json", [log])
        for log in (folder / "two.csv", harder)
    )
    assert {sound.prediction.word, found.prediction.word} == {"good"}
    assert not any("Far more is left" in one for one in sound.remarks)
    (told,) = [one for one in found.remarks if one.startswith("Far more is left")]
    left = found.prediction.joint_error[2]
    assert f"the fit: {left:.3g} N·m at elbow_joint (" in told
    times = float(re.search(r"\((.*) times\)", told)[1])
    noise = 0.015 * Recording.read(folder / "one.csv").torque[:, 2]  # of the simulation
    assert times == pytest.approx(left / np.sqrt(np.mean(noise**2)), rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("moves", [True, False])
def test_a_joint_that_is_locked_in_the_robot_file_and_moves_in_the_log_is_told(logs, run, tmp_path, moves):
    folder, arm = logs
    robot = tmp_path / "robot.toml"
    columns = '[log]\nposition = "q{}"\nvelocity = "none"\ntorque = "tau{}"\n'
    robot.write_text(f'[description]\nurdf = "{arm.path}"\nlocked = ["wrist_3_joint"]\n{columns}{SETTINGS}')
    recording = Recording.read(folder / "two.csv")
    log = replace(recording, q=recording.q * [1, 1, 1, 1, 1, moves]).save(tmp_path / "log.csv")
    model = sy.Model.load(robot)
    samples = recording.process(cutoff=5.0, velocity_threshold=0.005)
    five = sy.Samples(*(getattr(samples, name)[:, :5] for name in ("q", "dq", "ddq", "torque")))
    sy.least_squares(sy.Information.from_samples(model, five)).save(tmp_path / "estimate.json")
    _, out, _ = run("validate", robot, tmp_path / "estimate.json", log)
    told = [line for line in out.splitlines() if "locked in the robot file move" in line]
    assert len(told) == moves
    low, high = recording.q[:, 5].min(), recording.q[:, 5].max()
    for line in told:
        begin, end = map(float, re.search(r"wrist_3_joint \(from (\S+) to (\S+), 'q6'\)", line).groups())
        assert low <= begin < low + 0.1 * (high - low) < high - 0.1 * (high - low) < end <= high
    kinds = {one.kind for one in examine(log, robot).findings}
    assert ("locked joint" in kinds) == moves


def test_a_payload_is_what_the_estimate_cannot_predict(logs, run, tmp_path):
    folder, _ = logs
    place = (folder / "robot.toml", folder / "estimate.json")
    target = tmp_path / "found.json"
    code, out, _ = run("validate", *place, folder / "loaded.csv", "-o", target)
    document = json.loads(target.read_text())
    assert document["format"] == "steelyard-validation-1"
    assert document["prediction"]["model_error"] > 0.15
    assert document["prediction"]["word"] == "poor"
    assert code == 0
    assert "or the robot is no longer the same" in out
    # Of 2 kg, which the search for mistakes finds in this log alone.
    told = re.search(r"loaded.csv: wrist_3_link looks to carry a payload of (\S+) ± (\S+) kg", document["remarks"][-1])
    assert abs(float(told[1]) - 2.0) < float(told[2]) < 2.0


@pytest.mark.slow
def test_a_wrong_sign_in_one_of_two_logs_is_not_stated_of_both(logs, tmp_path):
    folder, _ = logs
    good, turned, sign = folder / "one.csv", tmp_path / "turned.csv", np.array([1, -1, 1, 1, 1, 1])
    recording = Recording.read(folder / "two.csv")
    sy.Recording(t=recording.t, q=recording.q, torque=sign * recording.torque).save(turned)
    robot = tmp_path / "robot.toml"
    robot.write_text((folder / "robot.toml").read_text())
    first = next_steps(sy.identify(robot, [good, turned]))[0]
    assert f"in {turned}: mended" in first.reason
    assert f"It was not found in {good}, and a line of robot.toml counts for every log." in first.reason
    assert first.action == "Mend that log, or robot.toml if it is so in all logs, and identify again."
    steps = next_steps(sy.identify(robot, [turned]))
    assert steps[0].action == "Mend robot.toml, and identify again."


@pytest.mark.slow
@pytest.mark.usefixtures("meshes_in_this_process")
@pytest.mark.parametrize("role", ["identification", "validation"])
def test_a_payload_in_one_of_two_logs_is_weighed_and_not_stated_of_the_robot(logs, run, role):
    folder, _ = logs
    robot, empty, loaded = folder / "robot.toml", folder / "one.csv", folder / "loaded.csv"
    given = {"validate": [loaded]} if role == "validation" else {}
    result = sy.identify(robot, [empty] if given else [empty, loaded], **given)
    first = next_steps(result)[0]
    assert first.code == f"steelyard payload {robot} {empty} {loaded}"
    assert f"No payload was found in {empty}" in first.reason
    assert not any("measured_mass" in step.code for step in next_steps(result))
    code, out, _ = run(*first.code.split()[1:], "--json")
    assert code == 0
    assert json.loads(out)["mass"] == pytest.approx(2.0, rel=0.02)


@pytest.mark.slow
def test_a_wrong_prediction_exits_with_3(logs, run, tmp_path):
    folder, _ = logs
    recording = Recording.read(folder / "two.csv")
    torque = recording.torque * np.array([1, -1, 1, 1, 1, 1])
    sy.Recording(t=recording.t, q=recording.q, torque=torque).save(tmp_path / "flipped.csv")
    place = (folder / "robot.toml", folder / "estimate.json", tmp_path / "flipped.csv", folder / "two.csv")
    code, out, _ = run("validate", *place)
    assert code == 3
    assert out.startswith("The model does not predict this robot")
    assert "two.csv" in out  # each log is told
    found = [line for line in out.splitlines() if line.startswith(f"Note: {tmp_path / 'flipped.csv'}: ")]
    assert len(found) == 1
    assert "shoulder_lift_joint" in found[0]
    assert "sign" in found[0]


def test_a_log_of_the_fit_is_no_prediction(logs, run, tmp_path):
    """It is said in the first line, which is all that a quiet command prints."""
    folder, _ = logs
    shutil.copy(folder / "estimate.json", tmp_path)
    hashed = hashlib.sha256((folder / "one.csv").read_bytes()).hexdigest()
    options = {"processing": {"cutoff": 5.0, "velocity_threshold": 0.005}, "decided": {}}
    record = {"format": "steelyard-run-1", "robot": [], "logs": [[{"path": "one.csv", "sha256": hashed}]]}
    (tmp_path / "run.json").write_text(json.dumps({**record, "options": options}))
    one, two = folder / "one.csv", folder / "two.csv"
    code, out, _ = run("validate", folder / "robot.toml", tmp_path, one, "--quiet")
    assert code == 0
    assert out == f"No log was predicted: {one} made this estimate; give one that it has not seen.\n"
    both = validate_estimate(folder / "robot.toml", tmp_path, [one, two])
    assert both.seen == (str(one),)
    assert str(both).startswith("The model predicts well")
    assert f"Note: {one}: was used to make" in str(both)


def test_logs_are_processed_as_those_of_the_fit(logs, tmp_path):
    folder, _ = logs
    result = tmp_path / "result"
    result.mkdir()
    shutil.copy(folder / "estimate.json", result)
    record = {
        "format": "steelyard-run-1",
        "robot": [],
        "logs": [[{"path": "one.csv", "sha256": "0"}]],
        "options": {
            "processing": {"cutoff": "auto", "velocity_threshold": 0.005},
            "decided": {"cutoff": 2.0},
        },
    }
    (result / "run.json").write_text(json.dumps(record))
    found = validate_estimate(folder / "robot.toml", result, [folder / "two.csv"])
    assert found.processing["cutoff"] == 2.0
    assert found.remarks == ()
    samples = Recording.read(folder / "two.csv").process(cutoff=2.0, velocity_threshold=0.005)
    information = sy.Information.from_samples(sy.Model.load(folder / "robot.toml"), samples)
    base = sy.Estimate.load(result / "estimate.json").base
    assert found.logs[0].relative_error == pytest.approx(information.relative_error(base), rel=1e-9)
    record["options"]["processing"]["cutoff"] = "high"
    record["options"]["decided"] = {}
    (result / "run.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"run\.json, options\.processing.*'cutoff'"):
        validate_estimate(folder / "robot.toml", result, [folder / "two.csv"])
    for broken in ("[]", '{"format": "steelyard-run-1"}', '{"format": "steelyard-run-1", "logs": [[3]]}', "{"):
        (result / "run.json").write_text(broken)
        with pytest.raises(InputError, match=r"run\.json"):
            validate_estimate(folder / "robot.toml", result, [folder / "two.csv"])


def test_bad_input_is_one_sentence(logs, run, tmp_path):
    folder, arm = logs
    other = tmp_path / "other.toml"
    other.write_text(f'terms = []\n[description]\nurdf = "{arm.path}"\n')
    (tmp_path / "short.csv").write_text("\n".join((folder / "two.csv").read_text().splitlines()[:40]))
    estimate, log = folder / "estimate.json", folder / "two.csv"
    cases = (
        ((other, estimate, log), "has the parameters of another robot or of other terms"),
        ((folder / "robot.toml", tmp_path, log), "estimate.json"),
        ((folder / "robot.toml", estimate, folder / "robot.toml"), "robot.toml"),
        ((folder / "robot.toml", estimate, tmp_path / "short.csv"), "short.csv"),
        ((folder / "robot.toml", log, log), "two.csv"),
    )
    for arguments, expected in cases:
        code, _, err = run("validate", *arguments)
        assert code == 2, arguments
        told = err.strip().splitlines()[-1]
        assert told.startswith("steelyard: ")
        assert expected in told
        assert "Traceback" not in err


@pytest.mark.slow
def test_a_result_of_logs_in_an_object_store_is_judged(logs, tmp_path, monkeypatch):
    fsspec = pytest.importorskip("fsspec")
    folder, _ = logs
    system, known = fsspec.filesystem("memory"), remote._known
    for name in ("one", "two"):
        system.put(str(folder / f"{name}.csv"), f"/judged/{name}.csv")
    # A store such as S3 tells the content of an object by a tag, from which no hash follows.
    monkeypatch.setattr(remote, "_known", lambda *given: {**known(*given), "etag": f"of {given[2]}"})
    sy.identify(folder / "robot.toml", "memory://judged/one.csv").save(tmp_path / "result")
    result = SavedResult.load(tmp_path / "result")
    assert result.has_seen("memory://judged/one.csv")
    assert not result.has_seen("memory://judged/two.csv")
    found = validate_estimate(folder / "robot.toml", tmp_path / "result", ["memory://judged/two.csv"])
    assert found.prediction.word == "good"
