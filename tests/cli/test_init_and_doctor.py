"""From a bare description and a log to an answer in two commands, and what is said on the way."""

import json
import tomllib

import numpy as np
import pytest

import steelyard as sy

T = np.arange(3000) / 150


@pytest.fixture
def stranger(place):
    """Return the folder with ``pair.urdf`` and nothing else, and a motion with the torques of another arm."""
    model = sy.Model.load(place / "pair.urdf")
    for name in ("robot.toml", "log.csv"):
        (place / name).unlink()
    w = np.array([[0.7, 1.9, 3.1], [1.1, 2.3, 2.9]])
    a = np.array([[0.8, 0.3, 0.15], [0.7, 0.4, 0.2]])
    angle = w[None] * T[:, None, None]
    q, dq = (a * np.sin(angle)).sum(axis=2), (a * w * np.cos(angle)).sum(axis=2)
    ddq = -(a * w * w * np.sin(angle)).sum(axis=2)
    truth = np.nan_to_num(np.asarray(model.robot.parameters))
    truth[model.link_columns[1]] *= 1.5  # the forearm weighs 1.5 kg
    places = {name: k for k, name in enumerate(model.parameter_names)}
    for number in (1, 2):
        truth[[places[f"Fvj{number}"], places[f"Fcj{number}"]]] = 0.3, 0.5
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    torque += 0.02 * torque.std(axis=0) * np.random.default_rng(4).normal(size=q.shape)
    return place, q, torque


def write(path, heads, columns, separator=",", comma=False):
    rows = np.column_stack(columns)
    lines = [separator.join(heads), *(separator.join(f"{value:.9g}" for value in row) for row in rows)]
    text = "\n".join(lines)
    path.write_text(text.replace(".", ",") if comma else text)


def plain(path, q, torque):
    write(path, ["t", "q1", "q2", "tau1", "tau2"], [T, q, torque])


def plot_juggler(path, q, torque):
    """Write columns by the joints' names, in another order, with times since 1970."""
    joints = ("elbow", "shoulder")
    heads = [f"/joint_states/{joint}/{word}" for word in ("position", "effort") for joint in joints]
    write(path, ["__time", *heads], [1.7e9 + T, q[:, ::-1], torque[:, ::-1]])


def spreadsheet(path, q, torque):
    """Write degrees with a decimal comma, in ms, between semicolons."""
    heads = ["time_ms", *(f"Joint {j} {what}" for what in ("position [deg]", "torque [Nm]") for j in (1, 2))]
    write(path, heads, [1e3 * T, np.degrees(q), torque], ";", comma=True)


@pytest.mark.slow
@pytest.mark.parametrize("style", [plain, plot_juggler, spreadsheet])
def test_two_commands_lead_from_a_description_and_a_log_to_a_better_description(style, stranger, run):
    place, q, torque = stranger
    style(place / "log.csv", q, torque)
    code, out, _ = run("init", place / "pair.urdf", place / "log.csv", "-o", place / "robot.toml")
    assert code == 0
    assert f"Go on with: steelyard identify {place / 'robot.toml'} {place / 'log.csv'} --output result" in out
    code, out, _ = run("identify", place / "robot.toml", place / "log.csv", "-o", place / "result")
    assert (code, "predicts well" in out) == (0, True)
    robot = sy.Robot.from_urdf(place / "result" / "robot.urdf")
    estimate = sy.Estimate.load(place / "result" / "estimate.json")
    assert estimate.relative_error < 0.03
    # With two parallel axes the moment of the forearm is what the motion shows.
    assert robot.links[1].inertia.first_moment[0] == pytest.approx(0.15, rel=0.03)


def test_init_never_overwrites_unless_it_is_told_to(place, run):
    before = (place / "robot.toml").read_text()
    code, out, err = run("init", place / "pair.urdf", "-o", place / "robot.toml")
    assert (code, out) == (2, "")
    assert "exists and is not overwritten; give another place with --output, or --force." in err
    assert (place / "robot.toml").read_text() == before
    assert run("init", place / "pair.urdf", "-o", place / "robot.toml", "--force")[0] == 0
    assert tomllib.loads((place / "robot.toml").read_text())["limits"]["effort"] == [50.0, 50.0]


def test_init_in_another_folder_finds_the_description(place, run):
    assert run("init", place / "pair.urdf", "-o", place / "deep" / "er" / "robot.toml")[0] == 0
    assert tomllib.loads((place / "deep" / "er" / "robot.toml").read_text())["description"]["urdf"] == "../../pair.urdf"
    assert sy.Model.load(place / "deep" / "er" / "robot.toml").dof == 2


def test_init_refuses_a_folder_that_cannot_be_before_it_reads_anything(place, run):
    (place / "taken").write_text("a file")
    code, _, err = run("init", place / "nowhere.urdf", "-o", place / "taken" / "robot.toml")
    assert (code, "is a file, but the results need a folder" in err, "nowhere.urdf" in err) == (2, True, False)


def test_init_writes_nothing_for_a_log_that_cannot_be_used(place, run):
    (place / "bad.csv").write_text("a,b\n1,2\n3,4\n")
    code, _, err = run("init", place / "pair.urdf", place / "bad.csv", "-o", place / "new.toml")
    assert code == 2
    assert "has no columns that look like positions" in err
    assert not (place / "new.toml").exists()


@pytest.mark.slow
def test_doctor_ends_with_what_it_found(stranger, run):
    place, q, torque = stranger
    plain(place / "sound.csv", q, torque)
    code, out, err = run("doctor", place / "sound.csv", place / "pair.urdf")
    assert (code, "nothing is wrong" in out) == (0, True)
    assert "reading the log" in err
    write(place / "sick.csv", ["t", "q1", "q2", "tau1", "tau2"], [1e3 * T, q, torque])
    code, out, _ = run("doctor", place / "sick.csv")
    assert code == 1
    assert 'time_unit = "ms"' in out.splitlines()
    code, out, _ = run("doctor", place / "sick.csv", "--json")
    assert code == 1
    assert json.loads(out)["remedies"] == {"log": {"time_unit": "ms"}}
    assert run("doctor", place / "nothing.csv")[0] == 2
    assert run("doctor", place / "sound.csv", place / "nothing.urdf")[0] == 2


def test_a_log_of_commands_leads_to_a_robot_file_without_the_log(stranger, run):
    """`init` refuses such a log as `identify` does, so that it is no remedy with it."""
    place, q, _ = stranger
    write(place / "log.csv", ["t", "q1", "q2", "q_des1", "q_des2"], [T, q, q])
    for command in (("identify",), ("init",)):
        out = place / command[0]
        code, _, err = run(*command, place / "pair.urdf", place / "log.csv", "-o", out)
        assert code == 2
        assert f"or write a robot.toml without the log: steelyard init {place / 'pair.urdf'})." in " ".join(err.split())
    code, _, _ = run("init", place / "pair.urdf", "-o", place / "robot.toml", "-q")
    assert code == 0
    assert "pair.urdf tells." in (place / "robot.toml").read_text()


@pytest.mark.slow
def test_init_takes_the_line_that_its_message_asks_for(stranger, run):
    place, q, torque = stranger
    write(place / "log.csv", ["moment_of_row", "q1", "q2", "tau1", "tau2"], [T, q, torque])
    code, _, err = run("init", place / "pair.urdf", place / "log.csv", "-o", place / "robot.toml")
    assert code == 2
    assert "has no such section: add --set log.time=...)." in err
    line = ("--set", "log.time=moment_of_row")
    code, _, _ = run("init", place / "pair.urdf", place / "log.csv", "-o", place / "robot.toml", "-q", *line)
    assert code == 0
    assert tomllib.loads((place / "robot.toml").read_text())["log"]["time"] == "moment_of_row"
    code, _, err = run("init", place / "pair.urdf", place / "log.csv", "--force", "--set", "payload.mass=2")
    assert code == 2
    assert "[payload] is not guessed by a log" in err


@pytest.mark.slow
def test_init_says_where_the_line_that_mends_a_log_stands(stranger, run):
    """The doctor prints it below the finding, and `init` has written it."""
    place, q, torque = stranger
    plain(place / "sign.csv", q, torque * [1.0, -1.0])
    code, out, _ = run("init", place / "pair.urdf", place / "sign.csv", "--output", place / "robot.toml")
    assert code == 0
    told = next(
        line for line in " ".join(out.split()).split("Of the log: ") if line.startswith("The sign of the torque")
    )
    assert "with what robot.toml says now the error" in told
    assert "torque_sign = [1, -1]" in (place / "robot.toml").read_text()
