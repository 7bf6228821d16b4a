"""What each command writes, prints and returns."""

import csv
import hashlib
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

import steelyard as sy
from steelyard.feasibility import verify_document


@pytest.mark.slow
def test_identify_writes_a_feasible_urdf(run, place):
    before = (place / "pair.urdf").read_bytes()
    code, out, _ = run(
        "identify",
        place / "robot.toml",
        place / "log.csv",
        "--validate",
        place / "log.csv",
        "--output",
        place / "result",
    )
    assert code == 0
    assert sorted(p.name for p in (place / "result").iterdir()) == [
        "estimate.json",
        "parameters.csv",
        "report.html",
        "robot.urdf",
        "run.json",
    ]
    assert (place / "pair.urdf").read_bytes() == before
    assert out.strip().splitlines()[-1] == f"Look at {place / 'result' / 'report.html'}"
    assert "shoulder" in out
    assert out.startswith("pair: The answer can exist and predicts well: ")

    estimate = sy.Estimate.load(place / "result" / "estimate.json")
    robot = sy.Robot.from_urdf(place / "result" / "robot.urdf")
    names = list(estimate.parameter_names)
    links = [names.index(name) for name in robot.parameter_names]
    np.testing.assert_allclose(robot.parameters, estimate.parameters[links], rtol=1e-9, atol=1e-12)
    assert [robot.joints[k].damping for k in range(2)] == pytest.approx(list(estimate.damping))
    assert [robot.joints[k].friction for k in range(2)] == pytest.approx(list(estimate.friction))
    assert robot.joints[0].damping == pytest.approx(0.1, abs=0.03)
    text = (place / "result" / "robot.urdf").read_text()
    assert "<!-- a comment that must survive -->" in text
    model = sy.Model(robot)
    assert sy.check(sy.FeasibleSet(model), parameters=robot.parameters).feasible

    record = json.loads((place / "result" / "run.json").read_text())
    assert record["logs"][0][0]["sha256"] == hashlib.sha256((place / "log.csv").read_bytes()).hexdigest()
    assert [entry["path"] for entry in record["robot"]] == [str(place / "robot.toml"), str(place / "pair.urdf")]
    assert record["versions"]["steelyard"] == sy.__version__
    assert record["options"]["prior"] == record["options"]["prefer"] == "auto"


def test_the_same_run_writes_the_same_bytes(run, place):
    for name in ("one", "two"):
        assert run("identify", place / "robot.toml", place / "log.csv", "-o", place / name)[0] == 0
    for file in ("estimate.json", "report.html", "robot.urdf", "run.json"):
        assert (place / "one" / file).read_bytes() == (place / "two" / file).read_bytes()


@pytest.mark.slow
def test_a_urdf_alone_is_enough(run, place):
    code, out, _ = run("identify", place / "pair.urdf", place / "log.csv", "--output", place / "result")
    assert code == 0
    assert "on 5 stretches of the logs, each left out in turn" in out.splitlines()[0]
    written = sy.Robot.from_urdf(place / "result" / "robot.urdf")
    assert written.joints[0].damping == pytest.approx(0.1, abs=0.03)  # friction is identified without being asked for
    assert written.joints[0].friction == pytest.approx(0.2, abs=0.05)
    assert run("check", place / "pair.urdf", place / "result" / "estimate.json")[0] == 0


def test_check_answers_with_its_exit_code(run, place):
    run("identify", place / "robot.toml", place / "log.csv", "--output", place / "result")
    estimate = place / "result" / "estimate.json"
    code, out, _ = run("check", place / "robot.toml", estimate)
    assert (code, out.startswith("Physically feasible")) == (0, True)
    document = json.loads(estimate.read_text())
    document["parameters"][document["parameter_names"].index("m2")] = -0.5
    estimate.write_text(json.dumps(document))
    code, out, _ = run("check", place / "robot.toml", estimate)
    assert code == 1
    assert "body of fore fails by" in out


@pytest.mark.slow
def test_a_folder_of_results_stands_for_the_estimate_in_it(run, place):
    robot, result = place / "robot.toml", place / "result"
    run("identify", robot, place / "log.csv", "--output", result)
    commands = [
        ("check", robot, result),
        ("explain", robot, result, "--quiet"),
        ("generate", robot, "--language", "python", "--estimate", result, "--output", place / "code"),
        ("simulate", robot, result, "--duration", 0.1, "--quiet", "--output", place / "simulation"),
    ]
    for command in commands:
        of_file = [result / "estimate.json" if one == result else one for one in command]
        assert run(*command)[:2] == run(*of_file)[:2], command
    assert run("check", robot, result)[0] == 0


def test_inspect_shows_the_robot(run, place):
    code, out, _ = run("inspect", place / "robot.toml")
    assert code == 0
    for text in ("shoulder", "revolute", "base parameters", "Fvj1", "inverse dynamics", "CAD: Physically feasible"):
        assert text in out


def test_inspect_says_what_is_wrong_with_the_cad(run, place):
    urdf = (place / "pair.urdf").read_text()
    (place / "pair.urdf").write_text(urdf.replace('izz="0.01"', 'izz="0.03"'))  # beyond the triangle inequality
    _, out, _ = run("inspect", place / "robot.toml")
    assert "body of fore fails by" in out
    _, out, _ = run("inspect", place / "robot.toml", "--consistency", "inertia")
    assert "CAD: Physically feasible" in out


@pytest.mark.slow
def test_generated_c_holds_the_identified_robot(run, place):
    """From a log to a controller: identify, generate with the estimate, compile, and run the self-test."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    assert run("identify", place / "robot.toml", place / "log.csv", "--output", place / "result")[0] == 0
    estimate = place / "result" / "estimate.json"
    target = place / "code"
    options = (
        "--language",
        "c",
        "--estimate",
        estimate,
        "--output",
        target,
        "-f",
        "inverse_dynamics",
        "-f",
        "pose(fore)",
    )
    code, out, _ = run("generate", place / "robot.toml", *options)
    assert code == 0
    assert sorted(out.split()) == sorted(str(path) for path in target.iterdir())
    header = (target / "pair.h").read_text()
    assert "parameters[" not in header
    assert "pair_pose_fore" in header
    sources = sorted(target.glob("*.c"))
    strict = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
    subprocess.run([compiler, *strict, *sources, "-lm", "-o", target / "test"], check=True)
    subprocess.run([target / "test"], check=True, capture_output=True)
    model, values = sy.Model.load(place / "robot.toml"), sy.Estimate.load(estimate).parameters
    (target / "main.c").write_text(
        '#include "pair.h"\n#include <stdio.h>\nint main(void) { const double q[2] = {0.3, -0.5}, dq[2] = {1.0, 2.0}, '
        "ddq[2] = {-1.0, 0.5}; double torque[2]; pair_inverse_dynamics(q, dq, ddq, torque); "
        'printf("%.17g %.17g", torque[0], torque[1]); return 0; }\n'
    )
    main = [compiler, *strict, target / "pair.c", target / "main.c", "-lm", "-o", target / "main"]
    subprocess.run(main, check=True)
    printed = subprocess.run([target / "main"], check=True, capture_output=True, text=True).stdout
    torque = model.inverse_dynamics([0.3, -0.5], [1.0, 2.0], [-1.0, 0.5], values)
    np.testing.assert_allclose([float(x) for x in printed.split()], torque, rtol=1e-12)


def test_generate_lists_functions_and_refuses_foreign_files(run, place):
    code, out, _ = run("generate", place / "pair.urdf", "--function", "list")
    assert code == 0
    assert "inverse_dynamics_derivatives" in out.split()
    assert not (place / "x").exists()
    (place / "x").mkdir()
    (place / "x" / "pair.h").write_text("mine")
    code, _, err = run("generate", place / "pair.urdf", "--language", "c", "--output", place / "x")
    assert code == 2
    assert "pair.h" in err
    assert [path.name for path in (place / "x").iterdir()] == ["pair.h"]
    assert (place / "x" / "pair.h").read_text() == "mine"


@pytest.mark.slow
def test_demo_runs_and_tells_where_to_look(run, tmp_path):
    code, out, err = run("demo", "--output", tmp_path / "demo", "--seed", "7")
    assert code == 0
    assert out.strip().splitlines()[-1] == f"Look at {tmp_path / 'demo' / 'result' / 'report.html'}"
    assert "Plain least squares found a robot that cannot exist (body of link3" in out
    assert "validation" in out
    assert "feasible fit" in err
    estimate = sy.Estimate.load(tmp_path / "demo" / "result" / "estimate.json")
    assert estimate.relative_error < 0.06
    assert (tmp_path / "demo" / "result" / "report.html").stat().st_size > 10_000
    told = re.search(r"The truth lies in (\d+) of (\d+) intervals of 95 %", out)
    assert int(told[2]) == 141
    assert int(told[1]) >= 131
    assert "m4 " in out
    robot = sy.RobotFile.load(tmp_path / "demo" / "robot.toml").robot
    cad = np.array([link.inertia.mass for link in robot.links])
    true = np.array([10.76769, 3.87494, 1.80228, 2.40017, 0.12376, 0.41797, 0.06865])  # as the manufacturer says
    assert 0.2 < np.abs(np.log(cad / true)).max() < 1.0
    rows = csv.DictReader((tmp_path / "demo" / "result" / "parameters.csv").read_text().splitlines())
    found = {row["name"]: float(row["value"]) for row in rows}
    masses = np.array([found[f"m{number}"] for number in range(1, 8)])
    assert np.all((masses > 0.1 * cad) & (masses < 10.0 * cad))
    assert abs(masses.sum() / true.sum() - 1.0) < 0.3
    assert abs(masses[3] / true[3] - 1.0) < 0.15 < 0.5 < abs(cad[3] / true[3] - 1.0)  # which the motion shows


def test_version_and_help(run):
    assert run("--version")[1].strip() == f"steelyard {sy.__version__}"
    code, out, _ = run("identify", "--help")
    assert code == 0
    assert "--validate" in out


def pendulum(folder, base):
    """A pendulum's robot.toml and an estimate with these base parameters (Lzz1, lx1, ly1)."""
    robot = folder / "robot.toml"
    robot.write_text('name = "pendulum"\nterms = []\n[description]\nrows = [[0, 0, 0, "q"]]\ngravity = [0, -9.81, 0]\n')
    names = ("Lzz1", "lx1", "ly1")
    estimate = sy.Estimate(
        method="by hand",
        base_names=names,
        base_expressions=names,
        base=np.array(base),
        standard_error=np.array([0.1, 0.01, 0.0]),
        joint_names=("joint1",),
        relative_error=0.1,
        row_count=10,
        condition_number=1.0,
    )
    estimate.save(folder / "estimate.json")
    return robot, folder / "estimate.json"


def test_a_verdict_is_saved_and_verified(run, tmp_path):
    robot, estimate = pendulum(tmp_path, [-0.6, 1.0, 0.0])
    certificate = tmp_path / "certificate.json"
    code, out, _ = run("check", robot, estimate, "--output", certificate)
    assert code == 1
    assert "steelyard check --certificate" in out
    code, out, _ = run("check", "--certificate", certificate)
    assert (code, out) == (
        0,
        "Proved in exact arithmetic: no parameters with these base parameters satisfy the one condition stated.\n",
    )
    assert run("check", robot, estimate, "--certificate", certificate)[0] == 0
    code, out, _ = run("check", robot, "--certificate", certificate, "--consistency", "inertia")
    assert (code, "it speaks of something else" in out) == (1, True)
    (tmp_path / "other").mkdir()
    other = pendulum(tmp_path / "other", [0.6, 1.0, 0.0])
    assert run("check", *other, "--certificate", certificate)[0] == 1
    text = certificate.read_text().replace("-0.6", "0.6")
    certificate.write_text(text)
    code, out, _ = run("check", "--certificate", certificate)
    assert (code, out.startswith("Not a proof: ")) == (1, True)


def test_correct_writes_the_nearest_possible_estimate(run, tmp_path):
    robot, estimate = pendulum(tmp_path, [-0.6, 0.0, 0.2])
    before = estimate.read_bytes()
    target = tmp_path / "corrected.json"
    code, out, _ = run("correct", robot, estimate, "--output", target)
    assert (code, "Corrected to be feasible" in out) == (0, True)
    corrected = sy.Estimate.load(target)
    assert corrected.base[0] > 0
    # ly1 is known exactly, so that the moment of inertia is what changes.
    assert corrected.base[2] == pytest.approx(0.2, abs=1e-4)
    assert verify_document(dict(corrected.certificate))
    assert np.isnan(corrected.relative_error)
    assert run("check", robot, target)[0] == 0
    assert estimate.read_bytes() == before
    assert run("correct", robot, target, "--output", tmp_path / "again.json", "--metric", "euclidean")[0] == 0
    code, _, err = run("correct", robot, estimate, "--output", estimate)
    assert (code, "give another --output" in err) == (2, True)


@pytest.mark.parametrize("arguments", [[], ["robot.toml"], ["--certificate", "a.json", "--output", "b.json"]])
def test_check_says_what_it_needs(run, arguments):
    code, _, err = run("check", *arguments)
    assert code == 2
    assert err.count("\n") == 1


@pytest.mark.slow
def test_an_identified_estimate_carries_its_proof(run, place):
    run("identify", place / "robot.toml", place / "log.csv", "--output", place / "result")
    estimate = place / "result" / "estimate.json"
    code, out, _ = run("check", "--certificate", estimate)
    assert (code, "are feasible" in out) == (0, True)
    assert run("check", place / "robot.toml", estimate, "--certificate", estimate)[0] == 0
    document = json.loads(estimate.read_text())
    index = document["parameter_names"].index("m2")
    document["certificate"]["proof"]["parameters"][index] = "-0.5"
    estimate.write_text(json.dumps(document))
    assert run("check", "--certificate", estimate)[0] == 1


def test_explain_tells_intervals_or_reasons(run, tmp_path):
    robot, estimate = pendulum(tmp_path, [0.5, 1.0, 0.0])
    target = tmp_path / "explanation.json"
    code, out, _ = run("explain", robot, estimate, "--output", target)
    assert code == 0
    # Lzz m >= lx², so that with Lzz = 0.5 and lx = 1 the pendulum weighs at least 2 kg (thesis 3.3).
    document = json.loads(target.read_text())
    (mass,) = [entry for entry in document["intervals"]["intervals"] if entry["name"] == "m1"]
    assert mass["lower"] == pytest.approx(2.0, rel=1e-4)
    assert mass["upper"] is None
    assert "mass of link1" in out
    robot, estimate = pendulum(tmp_path, [-0.5, 1.0, 0.0])
    code, out, _ = run("explain", robot, estimate)
    assert (code, "is infeasible" in out) == (1, True)


def test_generate_holds_the_description_and_a_smooth_sign(run, place):
    code, _, err = run("generate", place / "pair.urdf", "--language", "c")
    assert (code, "--output" in err) == (2, True)
    options = ("--language", "python", "-o", place / "cad", "-f", "inverse_dynamics", "--cad", "--sign", "smooth")
    code, _, err = run("generate", place / "pair.urdf", *options)
    assert code == 0, err
    written = "".join(path.read_text() for path in (place / "cad").rglob("*.py"))
    assert "sign_width" in written
    assert "parameters:" not in written
    both = ("--cad", "--estimate", place / "x.json", "--language", "c", "-o", place / "y")
    code, _, err = run("generate", place / "pair.urdf", *both)
    assert (code, "either an estimate or --cad" in err) == (2, True)


def test_terms_that_the_description_does_not_state_are_named(run, place):
    """The joint "elbow" of the URDF has no <dynamics>."""
    options = ("--language", "c", "-o", place / "cad", "-f", "inverse_dynamics", "--cad")
    for robot, terms in (("robot.toml", ""), ("pair.urdf", "; offset of all joints")):
        said = f"viscous of elbow; coulomb of elbow{terms}"
        assert f"which are 0 in the source: {said}. State" in run("generate", place / robot, *options)[1]
        assert "which are 0" not in run("generate", place / robot, *options, "--quiet")[1]
        run("simulate", place / robot, "--duration", 0.1, "-o", place / "simulation")
        whose = json.loads((place / "simulation" / "simulation.json").read_text())["parameters"]
        assert whose == f"the description (CAD), with 0 for the terms that it does not state: {said}"
    urdf = (place / "pair.urdf").read_text()
    (place / "pair.urdf").write_text(
        urdf.replace('velocity="5"/></joint>', 'velocity="5"/><dynamics damping="0" friction="0"/></joint>')
    )
    assert "which are 0" not in run("generate", place / "robot.toml", *options)[1]


def test_inspect_keeps_long_names_whole(run, tmp_path):
    name = "the_left_shoulder_joint_of_a_robot_with_many_long_names"
    path = tmp_path / "long.urdf"
    path.write_text(
        f'''<robot name="long"><link name="base"/><link name="{name}_link"/>
        <joint name="{name}" type="revolute"><parent link="base"/><child link="{name}_link"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'''
    )
    code, out, err = run("inspect", path)
    assert code == 0, err
    assert any(f"{name} " in line and f"{name}_link" in line for line in out.splitlines())


@pytest.mark.slow
def test_a_designed_motion_is_simulated_and_identified(run, place):
    """What `excite` writes `simulate` follows to its end, and what `simulate` writes `identify` takes."""
    folder = place / "excitation"
    limits = place / "limits.toml"
    limits.write_text("velocity = 2.0\nacceleration = 8.0\n")
    options = ("--period", 5, "--harmonics", 3, "--starts", 1)
    code, out, err = run("excite", place / "robot.toml", "--limits", limits, *options, "-o", folder)
    assert code == 0, err
    designed = sy.load_trajectory(folder / "trajectory.json")
    assert designed.duration == pytest.approx(25 / 3)  # no multiple of a millisecond
    for file in ("trajectory.json", "trajectory.csv"):
        target = place / f"simulation of {file}"
        code, out, err = run("simulate", place / "robot.toml", "--follow", folder / file, "-o", target)
        assert (code, "finished" in out) == (0, True), err
        log = np.genfromtxt(target / "simulation.csv", delimiter=",", names=True)
        assert np.ptp(np.diff(log["t"])) < 1e-9
        assert designed.duration <= log["t"][-1] < designed.duration + 0.0011
        assert abs(log["dq1"][-1]) < 1e-3  # at rest, at the end of the whole motion
        code, out, err = run("identify", place / "robot.toml", target / "simulation.csv", "-o", place / "again")
        assert code == 0, err
        found = sy.Estimate.load(place / "again" / "estimate.json")
        assert found.relative_error < 0.02


@pytest.mark.slow
def test_generate_online_writes_the_estimator_with_the_constraints_of_the_file(run, place):
    with (place / "robot.toml").open("a") as file:
        file.write("\n[constraints]\ntotal_mass = { maximum = 30.0 }\n")
    code, out, _ = run("generate", place / "robot.toml", "--online", "--output", place / "estimator")
    assert code == 0
    written = sorted(path.name for path in (place / "estimator").iterdir())
    assert [place / "estimator" / name for name in written] == [type(place)(line) for line in out.split()]
    source = (place / "estimator" / "pair_online.c").read_text()
    assert re.search(r"scalar_constant\[\d+\] = \{[^}]*\b30\.0", source)
    assert run("generate", place / "robot.toml", "--online")[0] == 2
    assert run("generate", place / "robot.toml", "--online", "--base", "--output", place / "other")[0] == 2
