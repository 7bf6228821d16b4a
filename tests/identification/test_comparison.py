"""Where estimates differ, on simulations by Pinocchio whose truth is known."""

import json
from dataclasses import replace

import lxml.etree
import lxml.html
import numpy as np
import pytest
from payload_logs import Payload, SimulatedArm
from pinocchio_oracle import pinocchio
from scipy.stats import false_discovery_control

import steelyard as sy
from steelyard.dynamics import ChannelFriction
from steelyard.errors import InputError
from steelyard.identification import compare_estimates, validate_estimate
from steelyard.identification.comparison import holm
from steelyard.identification.prediction_difference import difference_on_random_motion, random_motion
from steelyard.report import save_results

SETTINGS = "[processing]\ncutoff = 5.0\nvelocity_threshold = 0.005\n"


def estimate_of(arm, seed, target, payload=None):
    """Save what least squares makes of a log with a motion and a noise of its own."""
    samples = arm.log(np.random.default_rng(seed), payload).process(cutoff=5.0, velocity_threshold=0.005)
    sy.least_squares(sy.Information.from_samples(arm.model, samples)).save(target)
    return target


@pytest.fixture(scope="module")
def ur5(tmp_path_factory):
    """Estimates of a UR5 from two logs without anything, and from one with 1 kg in its hand."""
    folder = tmp_path_factory.mktemp("comparison")
    arm = SimulatedArm("ur5")
    (folder / "robot.toml").write_text(f'[description]\nurdf = "{arm.path}"\n{SETTINGS}')
    payload = Payload.random(np.random.default_rng(3), 1.0)
    estimate_of(arm, 1, folder / "one.json")
    estimate_of(arm, 2, folder / "two.json")
    estimate_of(arm, 3, folder / "loaded.json", payload)
    return folder, arm


@pytest.mark.slow
def test_a_payload_shows_in_the_last_link_and_in_nothing_else(ur5):
    folder, arm = ur5
    found = compare_estimates([folder / "one.json", folder / "loaded.json"], robot=folder / "robot.toml")
    assert found.differs
    differing = [one for one in found.differences if one.differs]
    # The columns of K tell which base parameters hold parameters of the last link.
    base = arm.model.base_parameters()
    holding = np.any(base.K[:, arm.model.link_columns[-1]] != 0.0, axis=1)
    names = {name for name, holds in zip(base.expressions, holding, strict=True) if holds}
    assert len(names) < len(holding)
    assert {one.name for one in differing} <= names
    assert len(differing) > 8
    assert found.explanations[0][2] == ("the link wrist_3_link",)
    assert "the link wrist_3_link alone explains all of this" in found.sentences[1]
    # Each difference is that of the truth, to its interval and what Holm's method adds.
    payload = Payload.random(np.random.default_rng(3), 1.0)
    change = np.zeros(arm.model.parameter_count)
    change[arm.model.link_columns[-1]] = payload.parameters
    truth = dict(zip(base.expressions, base.values(change), strict=True))
    errors = [(one.second_value - one.first_value - truth[one.name]) / one.half_width for one in found.differences]
    assert np.abs(errors).max() < 1.8
    assert np.mean(np.abs(errors) < 1.0) > 0.85


def test_two_logs_of_one_robot_differ_in_nothing(ur5, run, tmp_path):
    folder, _ = ur5
    files = (folder / "one.json", folder / "two.json")
    target = tmp_path / "comparison.json"
    code, out, _ = run("compare", *files, "--output", target)
    assert code == 0
    assert out.startswith("Nothing differs: none of 54 base parameters differs beyond its 95 % interval")
    assert "give it with --robot" in out
    document = json.loads(target.read_text())
    assert document["format"] == "steelyard-comparison-1"
    assert document["differs"] is False
    assert len(document["differences"]) == 54
    assert document["prediction"] is None
    code, out, _ = run("compare", *files, folder / "loaded.json")
    assert code == 1
    assert "of 108 base parameters (2 estimates, each against the first) differ beyond their 95 % intervals" in out
    found = compare_estimates([*files, folder / "loaded.json"])
    assert {one.second for one in found.differences if one.differs} == {str(folder / "loaded.json")}


@pytest.mark.slow
def test_noise_alone_differs_in_nothing(ur5, tmp_path):
    _, arm = ur5
    quiet = 0
    times = []
    for seed in range(20):
        pair = [estimate_of(arm, 1000 + 2 * seed + k, tmp_path / f"{k}.json") for k in range(2)]
        found = compare_estimates(pair)
        quiet += not found.differs
        times += [one.times for one in found.differences]
    assert quiet >= 18
    assert 0.93 < np.mean(np.array(times) < 1.0) < 0.98


def test_predictions_differ_as_in_pinocchio(ur5):
    """Without terms, base parameters of two descriptions predict what Pinocchio's two models do."""
    _, arm = ur5
    model = sy.Model(sy.Robot.from_urdf(arm.path))
    parameters = np.array(model.robot.parameters)
    parameters[model.link_columns[2]] *= 1.5
    bases = [model.base_parameters().values(p) for p in (np.asarray(model.robot.parameters), parameters)]
    found = difference_on_random_motion(model, ("light", "heavy"), bases, count=300, seed=4)
    q, dq, ddq = random_motion(model.robot, 300, 4)
    assert np.all(q >= arm.pin.lowerPositionLimit)
    assert np.all(q <= arm.pin.upperPositionLimit)
    assert np.all(np.abs(dq) <= arm.pin.velocityLimit)
    assert np.ptp(q, axis=0).min() > 0.9 * np.min(arm.pin.upperPositionLimit - arm.pin.lowerPositionLimit)
    other = arm.pin.copy()
    body = other.inertias[3]
    other.inertias[3] = pinocchio.Inertia(1.5 * body.mass, body.lever, 1.5 * body.inertia)
    torques = []
    for pin in (arm.pin, other):
        data = pin.createData()
        torques.append(np.array([pinocchio.rnea(pin, data, *row) for row in zip(q, dq, ddq, strict=True)]))
    difference = np.sqrt(np.mean((torques[1] - torques[0]) ** 2, axis=0))
    np.testing.assert_allclose(found.joint_torque, np.sqrt(np.mean(torques[0] ** 2, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(found.joint_difference[0], difference, rtol=1e-9, atol=1e-9)
    relative = np.linalg.norm(torques[1] - torques[0]) / np.linalg.norm(torques[0])
    assert found.relative_difference[0] == pytest.approx(relative, rel=1e-9)
    assert found.sentences[0].endswith(" N·m).")
    assert "Root mean squares, N·m:" in str(found)
    again = difference_on_random_motion(model, ("light", "heavy"), bases, count=300, seed=5)
    assert again.relative_difference[0] != found.relative_difference[0]


@pytest.mark.slow
def test_predictions_on_a_log(ur5, run, tmp_path):
    folder, arm = ur5
    recording = arm.log(np.random.default_rng(9))
    recording.save(tmp_path / "log.csv")
    files = (folder / "one.json", folder / "loaded.json")
    options = ("--robot", folder / "robot.toml", "--log", tmp_path / "log.csv")
    code, out, _ = run("compare", *files, *options)
    assert code == 1
    assert "error of A" in out
    found = compare_estimates(files, robot=folder / "robot.toml", logs=[tmp_path / "log.csv"]).prediction
    samples = recording.process(cutoff=5.0, velocity_threshold=0.005)
    pick = arm.model.base_parameters().Pb
    torques = [
        arm.model.inverse_dynamics(samples.q, samples.dq, samples.ddq, pick @ sy.Estimate.load(file).base)
        for file in files
    ]
    used = np.ones(samples.torque.shape, dtype=bool) if samples.mask is None else samples.mask
    for k in range(6):
        rows = used[:, k]
        difference = np.sqrt(np.mean((torques[1] - torques[0])[rows, k] ** 2))
        errors = [np.sqrt(np.mean((samples.torque - torque)[rows, k] ** 2)) for torque in torques]
        assert found.joint_difference[0, k] == pytest.approx(difference, rel=1e-8)
        np.testing.assert_allclose(found.joint_error[:, k], errors, rtol=1e-8)
    assert found.relative_error[0] < 0.02 < 0.1 < found.relative_error[1]


def test_what_least_squares_found_is_compared_and_not_what_a_prior_made_of_it(ur5, tmp_path):
    folder, _ = ur5
    one = sy.Estimate.load(folder / "one.json")
    drawn = replace(one, base=one.base + 5.0 * one.standard_error, unconstrained_base=one.base)
    drawn.save(tmp_path / "drawn.json")
    assert not compare_estimates([folder / "two.json", tmp_path / "drawn.json"]).differs
    hidden = replace(drawn, unconstrained_base=None)
    hidden.save(tmp_path / "hidden.json")
    assert compare_estimates([folder / "two.json", tmp_path / "hidden.json"]).differs


def test_numbers_of_links_are_compared_by_the_intervals_of_the_tables(ur5, tmp_path):
    folder, _ = ur5
    rows = [
        {"name": "m6", "meaning": "mass of the hand", "unit": "kg", "value": 1.0, "lower": 0.9, "upper": 1.1},
        {"name": "m5", "meaning": "mass of the wrist", "unit": "kg", "value": 1.0, "lower": 0.0, "upper": 4.0},
        {"name": "m4", "meaning": "mass of the arm", "unit": "kg", "value": 1.0, "lower": 0.5, "upper": None},
        {"name": "J1_3", "meaning": "moment", "unit": "kg m²", "value": 1.0, "lower": 0.9, "upper": 1.1},
    ]
    rows = [{**row, "cad": None, "basis": "measured"} for row in rows]
    heavier = [{**rows[0], "lower": 1.9, "upper": 2.1}, *({**row, "value": 2.0} for row in rows[1:])]
    for name, table in (("one", rows), ("loaded", heavier)):
        replace(sy.Estimate.load(folder / f"{name}.json"), parameter_table=tuple(table)).save(tmp_path / f"{name}.json")
    found = compare_estimates([tmp_path / "one.json", tmp_path / "loaded.json"])
    assert [(one.name, one.differs) for one in found.link_differences] == [("m6", True), ("m5", False)]
    assert found.link_differences[0].half_width == pytest.approx(0.1 * np.sqrt(2.0) * 2.042 / 1.960, rel=1e-3)
    assert "mass of the hand (1 and 2 kg)" in found.sentences[-1]
    for broken in ({**rows[0], "lower": "low"}, {**rows[0], "lower": 3.0}, {"lower": 0.0, "upper": 1.0}):
        estimate = replace(sy.Estimate.load(folder / "one.json"), parameter_table=(broken,))
        estimate.save(tmp_path / "broken.json")
        with pytest.raises(InputError, match=r"broken\.json"):
            compare_estimates([tmp_path / "broken.json", tmp_path / "loaded.json"])


def test_bad_input_is_one_sentence(ur5, run, tmp_path):
    folder, arm = ur5
    one = sy.Estimate.load(folder / "one.json")
    replace(one, filtered_torque=True).save(tmp_path / "filtered.json")
    replace(one, joint_names=tuple(f"other_{k}" for k in range(6))).save(tmp_path / "joints.json")
    model = sy.Model(sy.Robot.from_urdf(arm.path).with_terms(sy.Viscous()))
    samples = arm.samples(np.random.default_rng(0))
    sy.least_squares(sy.Information.from_samples(model, samples)).save(tmp_path / "terms.json")
    (tmp_path / "empty.json").write_text("{}")
    log = ("--log", tmp_path / "log.csv")
    cases = (
        ((folder / "one.json",), "Two or more results"),
        ((folder / "one.json", tmp_path / "terms.json"), "only"),
        ((folder / "one.json", tmp_path / "joints.json"), "only"),
        ((folder / "one.json", tmp_path / "filtered.json"), "nothing can be compared"),
        ((folder / "one.json", tmp_path / "empty.json"), "format"),
        ((folder / "one.json", tmp_path), "estimate.json"),
        ((folder / "one.json", folder / "two.json", *log), "give --robot"),
        ((folder / "one.json", folder / "two.json", "--robot", folder / "robot.toml", *log), "log.csv"),
    )
    for arguments, expected in cases:
        code, _, err = run("compare", *arguments)
        assert code == 2, arguments
        told = err.strip().splitlines()[-1]
        assert told.startswith("steelyard: ")
        assert expected in told
        assert "Traceback" not in err


def test_exact_estimates_that_are_the_same_differ_in_nothing(ur5, tmp_path):
    folder, _ = ur5
    exact = replace(sy.Estimate.load(folder / "one.json"), standard_error=np.zeros(54))
    exact.save(tmp_path / "a.json")
    replace(exact, base=exact.base * (1.0 + 1e-15)).save(tmp_path / "b.json")
    replace(exact, base=exact.base * (1.0 + 1e-6)).save(tmp_path / "c.json")
    assert not compare_estimates([tmp_path / "a.json", tmp_path / "b.json"]).differs
    assert compare_estimates([tmp_path / "a.json", tmp_path / "c.json"]).differs


def test_what_the_data_does_not_show_is_not_called_the_same(ur5, tmp_path):
    folder, _ = ur5
    one = sy.Estimate.load(folder / "one.json")
    errors = one.standard_error.copy()
    errors[[3, 7]] = np.inf
    hidden = replace(one, standard_error=errors)
    hidden.save(tmp_path / "hidden.json")
    found = compare_estimates([folder / "two.json", tmp_path / "hidden.json"])
    assert len(found.differences) == 52
    assert "none of 52 base parameters" in found.sentences[0]
    expected = f"hidden.json does not show 2 base parameters, which could not be compared: {one.base_expressions[3]}; "
    assert any(expected in remark for remark in found.remarks)
    assert {one.base_expressions[3], one.base_expressions[7]}.isdisjoint(d.name for d in found.differences)


@pytest.mark.slow
def test_holm_rejects_a_true_hypothesis_in_one_of_twenty():
    """Among true and false hypotheses of any number, and never more than the method of Benjamini and Hochberg."""
    random = np.random.default_rng(8)
    wrong = 0
    for _ in range(2000):
        probabilities = np.concatenate([random.uniform(size=30), random.uniform(size=10) * 1e-6])
        rejected = holm(probabilities, 0.05)
        assert rejected[30:].all()
        wrong += rejected[:30].any()
        assert np.all(false_discovery_control(probabilities)[rejected] <= 0.05)
    assert 0.03 < wrong / 2000 < 0.065


def test_a_description_is_compared_as_exact_numbers(ur5, tmp_path):
    """Pinocchio simulated the arm of this very description: it differs in nothing, one link in a copy does."""
    folder, arm = ur5
    found = compare_estimates([arm.path, folder / "one.json"])
    assert not found.differs
    assert 30 < len(found.differences) < 54  # friction stands in the others, of which the description says nothing
    assert found.prediction.relative_difference[0] < 0.02
    assert any("is a description: its inertials are taken as exact" in remark for remark in found.remarks)
    tree = lxml.etree.parse(arm.path)
    for dynamics in tree.xpath("//joint/dynamics"):  # nothing of friction is compared, as is said
        dynamics.set("damping", "50")
    rubbing = tmp_path / "rubbing.urdf"
    tree.write(rubbing)
    again = compare_estimates([rubbing, folder / "one.json"])
    assert not again.differs
    assert any("inertials are taken as exact, and are all that is compared" in remark for remark in again.remarks)
    (mass,) = tree.xpath("//link[@name='forearm_link']/inertial/mass")
    mass.set("value", str(2.0 * float(mass.get("value"))))
    heavy = tmp_path / "heavy.urdf"
    tree.write(heavy)
    found = compare_estimates([heavy, folder / "one.json"])
    assert found.differs
    assert found.explanations[0][2][0] == "the link forearm_link"
    moved = tmp_path / "moved.urdf"
    (origin,) = tree.xpath("//joint[@name='elbow_joint']/origin")
    origin.set("xyz", "0 -0.1 0.5")
    tree.write(moved)
    with pytest.raises(InputError, match=r"moved\.urdf: is of another robot than .*one\.json"):
        compare_estimates([moved, folder / "one.json"])
    with pytest.raises(InputError, match="are descriptions, of which no errors are known"):
        compare_estimates([heavy, arm.path])


@pytest.mark.parametrize(
    "how",
    [
        pytest.param('tip = "wrist_1_link"', marks=pytest.mark.slow),
        "locked = { wrist_3_joint = 0.7, elbow_joint = 0.4 }",
    ],
)
def test_a_copy_of_the_description_is_read_as_the_robot_of_the_estimate_was(ur5, tmp_path, how):
    """Of a shorter chain, or one that is held bent, the same file tells the same numbers."""
    _, arm = ur5
    (tmp_path / "robot.toml").write_text(f'[description]\nurdf = "{arm.path}"\n{how}\n')
    model = sy.Model.from_file(sy.RobotFile.load(tmp_path / "robot.toml"))
    base = model.base_parameters()
    described = base.values(np.nan_to_num(np.array(model.robot.parameters)))
    sy.Estimate(
        method="weights and lengths", base_names=base.names, base_expressions=base.expressions, base=described,
        standard_error=np.full(base.count, 1e-6), joint_names=tuple(model.robot.joint_names), relative_error=0.01,
        row_count=1000, condition_number=10.0,
    ).save(tmp_path / "one.json")  # fmt: skip
    (tmp_path / "copy.urdf").write_bytes(arm.path.read_bytes())
    found = compare_estimates([tmp_path / "one.json", tmp_path / "copy.urdf"], robot=tmp_path / "robot.toml")
    assert not found.differs
    assert found.prediction.relative_difference[0] < 1e-6


def test_the_page_shows_what_differs(ur5, run, tmp_path):
    folder, arm = ur5
    page = tmp_path / "page.html"
    code, out, _ = run("compare", arm.path, folder / "one.json", folder / "loaded.json", "--page", page)
    assert code == 1
    assert out.strip().endswith(f"Look at {page}")
    document = lxml.html.parse(page).getroot()
    assert document.find_class("lead")[0].text_content() in out
    rows = [[cell.text_content() for cell in row] for row in document.xpath("//table[@id='base-differences']/tbody/tr")]
    found = compare_estimates([arm.path, folder / "one.json", folder / "loaded.json"])
    assert len(rows) == len(found.differences)
    names = dict(zip(found.names, "ABC", strict=True))
    for row, one in zip(rows, found.differences, strict=True):
        assert row[:4] == [one.name, names[one.second], f"{one.first_value:.4g}", f"{one.second_value:.4g}"]
        assert row[-1] == ("yes" if one.differs else "")
    assert len(document.xpath("//table[@id='predicted']/tbody/tr")) == 6
    assert not document.xpath("//*[@src]")


@pytest.mark.slow
def test_folders_of_results_tell_their_robot_and_their_processing(elbow, simulation):
    """With a prior, answers are further apart than their standard errors; what the data says is not."""
    path, model, folder = elbow
    for name, seed in (("monday", 0), ("friday", 1)):
        simulation.record(model, folder / f"{name}.csv", seed, noise=0.2, periods=2.0)
        save_results(sy.identify(path, [folder / f"{name}.csv"]), folder / name)
    found = compare_estimates([folder / "monday", folder / "friday"])
    assert not found.differs
    assert found.prediction is not None  # the robot file stands in the record
    assert found.prediction.relative_difference[0] < 0.1
    answers = [sy.Estimate.load(folder / name / "estimate.json") for name in ("monday", "friday")]
    truth = model.base_parameters().values(simulation.true_parameters(model))
    for answer in answers:
        assert np.abs((answer.unconstrained_base - truth) / answer.standard_error).max() < 4.0
    for log, seen in (("friday.csv", False), ("monday.csv", True)):
        validated = validate_estimate(path, folder / "monday", [folder / log])
        assert validated.prediction.word == "good"
        assert any("was used to make" in remark for remark in validated.remarks) == seen
        assert validated.processing["cutoff"] == 10.0
        decided = json.loads((folder / "monday" / "run.json").read_text())["options"]["decided"]
        np.testing.assert_array_equal(validated.processing["velocity_threshold"], decided["velocity_threshold"])
    path.write_text(path.read_text() + "\n")
    changed = compare_estimates([folder / "monday", folder / "friday"])
    assert changed.prediction is None
    assert any("was changed" in remark for remark in changed.remarks)


def test_friction_by_a_signal_is_compared_at_its_reference():
    """On a joint without inertia, of which friction is all there is."""
    robot = sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0))
    model = sy.Model(robot.with_terms(ChannelFriction("temperature", range=[15, 60], reference=25)))
    place = [model.base_parameters().expressions.index(name) for name in ("Fcj1", "Fcsj1")]
    one, slope, twice = np.zeros((3, model.base_parameters().count))
    one[place] = 1.0, 0.0
    slope[place] = 1.0, 0.2
    twice[place] = 2.0, 0.0
    found = difference_on_random_motion(model, ["one", "slope", "twice"], [one, slope, twice])
    np.testing.assert_allclose(found.relative_difference, [0.0, 1.0], atol=1e-12)
