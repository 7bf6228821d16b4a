"""Rotors of which nobody says anything: taken in where a log shows them, and only there; what was saved says so."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification import (
    check_certificate,
    check_estimate,
    compare_estimates,
    identify_payload,
    model_of_estimate,
    validate_estimate,
)
from steelyard.identification.default_terms import _shown, model_with
from steelyard.identification.given import wider_model
from steelyard.identification.simulated import simulate_files
from steelyard.robot import RobotFile

ROTORS = (0.5, 0.3)
TRUE_MASS, TRUE_COM = (3.0, 2.0), (0.12, 0.16)
LINK = """<link name="{}"><inertial><origin xyz="{} 0 0"/><mass value="{}"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.02"/></inertial></link>"""
JOINT = """<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="4" effort="50"/></joint>"""
T = np.arange(1800) / 150
RATES, SIZES = np.array([[0.7, 1.9, 3.1], [1.1, 2.3, 2.9]]), np.array([[0.8, 0.3, 0.15], [0.7, 0.4, 0.2]])


def motion():
    angle = RATES[None] * T[:, None, None]
    q = (SIZES * np.sin(angle)).sum(axis=2)
    return q, (SIZES * RATES * np.cos(angle)).sum(axis=2), -(SIZES * RATES**2 * np.sin(angle)).sum(axis=2)


def torque_of(rotors):
    """Torques of a planar arm by its energies (Lagrange), with friction, rotors and noise."""
    q, dq, ddq = motion()
    (m1, m2), (c1, c2), length, about, g = TRUE_MASS, TRUE_COM, 0.4, 0.03, 9.81
    between, turned = m2 * length * c2 * np.cos(q[:, 1]), m2 * length * c2 * np.sin(q[:, 1])
    inner, outer = about + m1 * c1**2 + m2 * length**2, about + m2 * c2**2
    # A positive angle about the y axis lowers the arm.
    hand, shoulder = -m2 * g * c2 * np.cos(q.sum(axis=1)), -g * (m1 * c1 + m2 * length) * np.cos(q[:, 0])
    first = (inner + outer + 2 * between) * ddq[:, 0] + (outer + between) * ddq[:, 1] + shoulder + hand
    first -= turned * dq[:, 1] * (2 * dq[:, 0] + dq[:, 1])
    second = (outer + between) * ddq[:, 0] + outer * ddq[:, 1] + turned * dq[:, 0] ** 2 + hand
    torque = np.column_stack([first, second]) + 0.6 * dq + 0.9 * np.sign(dq) + 0.1 + np.array(rotors) * ddq
    return torque + 0.02 * torque.std(axis=0) * np.random.default_rng(4).normal(size=torque.shape)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The description of the arm, whose first mass is a tenth off, and logs with and without rotors."""
    folder = tmp_path_factory.mktemp("arm")
    links = [LINK.format("upper", TRUE_COM[0], 1.1 * TRUE_MASS[0]), LINK.format("fore", TRUE_COM[1], TRUE_MASS[1])]
    joints = [JOINT.format("shoulder", "base", "upper", 0), JOINT.format("elbow", "upper", "fore", 0.4)]
    (folder / "arm.urdf").write_text(f'<robot name="arm"><link name="base"/>{"".join(links + joints)}</robot>')
    for name, rotors in (("rotors", ROTORS), ("none", (0.0, 0.0))):
        table = np.column_stack([T, motion()[0], torque_of(rotors)])
        path = folder / f"{name}.csv"
        np.savetxt(path, table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
    return folder


@pytest.fixture(scope="module")
def found(place):
    """The arm with rotors identified from its URDF and log alone, and saved."""
    result = sy.identify(place / "arm.urdf", place / "rotors.csv")
    result.save(place / "out")
    return result


def principal_moments(row):
    """About the centre of mass."""
    mass, center = row[9], row[6:9] / row[9]
    about_origin = np.array([row[[0, 1, 2]], row[[1, 3, 4]], row[[2, 4, 5]]])
    return np.linalg.eigvalsh(about_origin - mass * (center @ center * np.eye(3) - np.outer(center, center)))


@pytest.mark.slow
def test_rotors_that_a_log_shows_do_not_end_in_the_links(found):
    places = {str(name): value for name, value in zip(found.parameter_names, found.estimate.parameters, strict=True)}
    # Of the shoulder, rotor and link turn together: the description tells them apart.
    assert [places["Ia1"], places["Ia2"]] == pytest.approx(ROTORS, rel=0.2)
    for columns, mass in zip(found.model.link_columns, TRUE_MASS, strict=True):
        row = found.estimate.parameters[columns]
        assert row[9] == pytest.approx(mass, rel=0.15)
        assert np.all(principal_moments(row) < 3 * np.array([0.02, 0.02, 0.03]))
    (said,) = [remark for remark in found.remarks if "inertia of a rotor at every joint" in remark]
    assert "arm.urdf says nothing" in said
    assert "Ia2 = " in said
    assert found.options["terms"] == ["viscous", "coulomb", "offset", "rotor_inertia"]
    assert any("no place for" in remark and "rotor inertia" in remark for remark in found.remarks)
    assert not found.mistakes


@pytest.mark.parametrize("rows", [8, 13])
def test_a_few_rows_in_one_stretch_decide_nothing(place, rows):
    """Rows that are fast enough may all lie in one stretch; the verdict says what such an answer is worth."""
    speed = np.sort(
        np.abs(sy.Recording.read(place / "none.csv").process(cutoff=8.0, velocity_threshold=None).dq), axis=0
    )
    processing = {"cutoff": 8.0, "velocity_threshold": (0.5 * (speed[-rows] + speed[-rows - 1])).tolist()}
    result = sy.identify(place / "arm.urdf", place / "none.csv", processing=processing)
    assert result.options["terms"] == ["viscous", "coulomb", "offset"]
    assert result.prediction.word in ("poor", "wrong")


def test_rotors_that_are_not_stated_do_not_decide_the_filter(place):
    """Without them in the model a cutoff near the frequencies of the motion made up for a part of their torques."""
    rotors = (0.2, 0.12)
    table = np.column_stack([T, np.round(motion()[0] / 5e-5) * 5e-5, torque_of(rotors)])
    np.savetxt(place / "small.csv", table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
    found = sy.identify(place / "arm.urdf", place / "small.csv")
    assert found.options["decided"]["cutoff"] > 8.0 * RATES.max() / (2.0 * np.pi)
    assert "rotor_inertia" in found.options["terms"]
    rows = {row.name: row for row in found.parameters}
    assert rows["Ia2"].lower < rotors[1] < rows["Ia2"].upper
    assert rows["Lyy2"].lower < 0.03 + TRUE_MASS[1] * TRUE_COM[1] ** 2 < rows["Lyy2"].upper


@pytest.mark.slow
def test_stated_terms_are_taken_as_stated(place, found):
    described = '[description]\nurdf = "arm.urdf"\n'
    kinds = ("viscous", "coulomb", "offset", "rotor_inertia")
    tables = [f'[[terms]]\nkind = "{kind}"\n' for kind in kinds]
    (place / "stated.toml").write_text(described + "".join(tables))
    (place / "fewer.toml").write_text(described + "".join(tables[:3]))
    stated = sy.identify(place / "stated.toml", place / "rotors.csv")
    np.testing.assert_allclose(stated.estimate.parameters, found.estimate.parameters, rtol=1e-6, atol=1e-9)
    assert not any("rotor at every joint" in remark for remark in stated.remarks)
    fewer = RobotFile.load(place / "fewer.toml")
    assert wider_model(fewer, sy.Model.from_file(fewer)) is None


@pytest.mark.parametrize(
    ("log", "name", "truth"), [("rotors", "Ia2", ROTORS[1]), pytest.param("none", "Fvj2", 0.6, marks=pytest.mark.slow)]
)
def test_filtered_torques_keep_their_intervals(place, log, name, truth):
    """The regressor goes through the filter of the torques, whichever terms are chosen in the end."""
    (place / "filtered.toml").write_text('[description]\nurdf = "arm.urdf"\n[processing]\ntorque_cutoff = 20.0\n')
    result = sy.identify(place / "filtered.toml", place / f"{log}.csv")
    assert result.options["terms"][3:] == (["rotor_inertia"] if log == "rotors" else [])
    assert not result.estimate.filtered_torque
    row = result.parameters[name]
    assert row.lower < truth < row.upper
    assert row.basis == "measured"
    (prediction,) = result.predictions
    errors = prediction.trace.measured - prediction.trace.feasible
    sizes = np.linalg.norm(errors, axis=0) / np.linalg.norm(prediction.trace.measured, axis=0)
    np.testing.assert_allclose(sizes, prediction.joint_feasible_error, rtol=0.01)


@pytest.mark.slow
def test_without_rotors_everything_stays(place):
    """A model is taken as it is, so that it tells what comes out where nothing is asked about rotors."""
    robot = sy.Robot.from_urdf(place / "arm.urdf")
    asked = sy.identify(robot, place / "none.csv")
    plain = sy.identify(sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset())), place / "none.csv")
    assert asked.options["terms"] == ["viscous", "coulomb", "offset"]
    assert asked.options["decided"] == plain.options["decided"]
    np.testing.assert_allclose(asked.estimate.parameters, plain.estimate.parameters, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(asked.unconstrained.standard_error, plain.unconstrained.standard_error, rtol=1e-8)
    assert asked.remarks == plain.remarks


@pytest.mark.slow
def test_a_saved_estimate_and_the_bare_description_belong_together(place, found, run):
    estimate, urdf, log = place / "out" / "estimate.json", place / "arm.urdf", place / "rotors.csv"
    assert json.loads((place / "out" / "run.json").read_text())["options"]["terms"][-1] == "rotor_inertia"
    assert check_estimate(urdf, estimate).feasible
    validation = validate_estimate(urdf, estimate, [log])
    assert validation.prediction.relative_error == pytest.approx(found.predictions[0].feasible_error, rel=1e-6)
    assert validation.prediction.joint_relative_error == pytest.approx(
        found.predictions[0].joint_feasible_error, rel=1e-6
    )
    simulated = simulate_files(urdf, estimate, duration=0.02)
    assert simulated.model.parameter_names == found.parameter_names
    options = ("--language", "c", "--function", "gravity", "--output", place / "code")
    code, _, told = run("generate", urdf, "--estimate", estimate, *options)
    assert code == 0, told
    payload = identify_payload(urdf, log, estimate=estimate)
    assert abs(payload.estimate.mass) < 0.1
    compared = compare_estimates([place / "out", place / "out"], robot=urdf)
    assert not any(one.differs for one in compared.differences)
    certificate = place / "certificate.json"
    certificate.write_text(json.dumps(json.loads(estimate.read_text())["certificate"]))
    assert check_certificate(certificate, urdf)


def test_the_model_of_an_estimate_follows_its_parameters(place, found):
    file = RobotFile.load(place / "arm.urdf")
    plain = sy.Model.from_file(file)
    assert model_with(plain.parameter_names, file).parameter_names == plain.parameter_names
    assert model_with(found.parameter_names, file).parameter_names == found.parameter_names
    assert model_of_estimate(found.unconstrained, file).parameter_names == found.parameter_names
    assert model_of_estimate(None, file).parameter_names == plain.parameter_names
    # A rotor that turns with its link alone stands in a sum.
    assert model_with(["Lyy1 + Ia1"], file).parameter_names == found.parameter_names
    assert model_with(["Iam1", "Lyy1"], file).parameter_names == plain.parameter_names


@pytest.mark.parametrize(("kind", "unit"), [("q", "kg·m²"), ("slide", "kg")])
def test_rotors_of_sliding_joints_have_a_mass(kind, unit):
    last = (0, 0.3, 0, "q") if kind == "q" else (0, 0, "q", 0)
    robot = sy.Robot.from_dh([("pi/2", 0, 0, "q"), last])
    info = sy.Information.from_factor(np.eye(2), [0.4, 0.1], 0.1, 10**5, ["Ia2", "Ia1"])
    assert f"Ia2 = 0.4 ± 0.001 {unit} (standard error)" in _shown(sy.Model(robot), sy.least_squares(info))


@pytest.mark.parametrize("rotor", [0.5, pytest.param(0.0, marks=pytest.mark.slow)])
def test_a_rotor_that_turns_with_its_link_alone(tmp_path, rotor):
    """Only the description tells them apart: the data shows the sum, of which the link would have 17 times its own."""
    joint = JOINT.format("hinge", "base", "rod", 0)
    (tmp_path / "rod.urdf").write_text(
        f'<robot name="rod"><link name="base"/>{LINK.format("rod", 0.15, 2)}{joint}</robot>'
    )
    q, dq, ddq = (one[:, 0] for one in motion())
    torque = (0.03 + 2 * 0.15**2 + rotor) * ddq - 9.81 * 2 * 0.15 * np.cos(q) + 0.6 * dq + 0.9 * np.sign(dq) + 0.1
    torque = torque + 0.02 * torque.std() * np.random.default_rng(0).normal(size=len(T))
    result = sy.identify(tmp_path / "rod.urdf", {"t": T, "q1": q, "tau1": torque})
    assert ("rotor_inertia" in result.options["terms"]) is (rotor > 0.0)
    assert principal_moments(result.estimate.parameters[:10]) == pytest.approx([0.02, 0.02, 0.03], rel=0.1)
    if rotor:
        assert result.estimate.rotor_inertia == pytest.approx([rotor], rel=0.05)
        assert model_of_estimate(result.unconstrained, RobotFile.load(tmp_path / "rod.urdf")).parameter_count == 14


@pytest.mark.slow
@pytest.mark.parametrize("name", ["z1", "so101"])
def test_rotors_that_only_the_description_tells_from_links(name, example, tmp_path):
    """Least squares show no rotor of these arms for sure; without rotors a link had 36 and 30 times its moment."""
    folder = Path(shutil.copytree(example(name), tmp_path / name))
    text = (folder / "robot.toml").read_text()
    bare = folder / "bare.toml"
    bare.write_text("\n\n".join(part for part in text.split("\n\n") if not part.startswith("[[terms]]")))
    result = sy.identify(bare, folder / "train.csv")
    truth = sy.Estimate.load(folder / "truth.json")
    assert result.options["terms"][-1] == "rotor_inertia"
    assert result.parameter_names == truth.parameter_names
    for columns in result.model.link_columns:
        mine, true = result.estimate.parameters[columns], truth.parameters[columns]
        if true[9] > 1e-6:
            assert mine[9] == pytest.approx(true[9], rel=0.4)
            ratio = principal_moments(mine) / principal_moments(true)
            assert 0.4 < ratio.min() <= ratio.max() < 2.5
