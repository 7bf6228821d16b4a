"""Broken robots, logs and options: each gives one clear sentence, exit code 2, and nothing half-written."""

import importlib
import json
import sys
import types

import numpy as np
import pytest

HEADER = "t,q1,q2,tau1,tau2\n"


def urdf(place, old, new):
    text = (place / "pair.urdf").read_text()
    assert old in text
    (place / "pair.urdf").write_text(text.replace(old, new))


def toml(place, text):
    path = place / "robot.toml"
    path.write_text(path.read_text() + text)


def rows(place, change):
    """Change the log's numbers: `change` takes and returns a table with columns t q1 q2 tau1 tau2 (and maybe more)."""
    path = place / "log.csv"
    header, *lines = path.read_text().splitlines()
    names = header.split(",")
    table = np.array([[float(v) for v in line.split(",")] for line in lines])
    columns = {name: table[:, k].copy() for k, name in enumerate(names)}
    columns = change(columns) or columns
    out = [",".join(columns), *(",".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True))]
    path.write_text("\n".join(out).replace("nan", "nan") + "\n")


def put(name, index, value):
    def change(columns):
        columns[name][index] = value

    return change


def without(name):
    return lambda columns: {k: v for k, v in columns.items() if k != name}


def degrees(columns):
    for name in ("q1", "q2"):
        columns[name] = np.degrees(columns[name])


def swapped_velocities(columns):
    rate = 200.0
    d1, d2 = np.gradient(columns["q1"]) * rate, np.gradient(columns["q2"]) * rate
    return columns | {"dq1": d2, "dq2": d1}


def one_more_joint(columns):
    return columns | {"q3": columns["q1"], "tau3": columns["tau1"]}


KINDS = {
    # robots
    "robot missing": (lambda p: (p / "robot.toml").unlink(), "robot.toml: cannot be read"),
    "toml broken": (lambda p: (p / "robot.toml").write_text("[description\n"), "not valid TOML"),
    "toml section unknown": (lambda p: toml(p, "[procesing]\ncutoff = 1\n"), "'procesing' is no section"),
    "toml key unknown": (lambda p: toml(p, "cutof = 1\n"), "cutof"),
    "urdf missing": (lambda p: (p / "pair.urdf").unlink(), "pair.urdf"),
    "urdf malformed": (lambda p: urdf(p, "</robot>", ""), "pair.urdf"),
    "urdf joint kind": (lambda p: urdf(p, 'name="elbow" type="revolute"', 'name="elbow" type="planar"'), "elbow"),
    "urdf axis zero": (lambda p: urdf(p, '<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>'), "axis"),
    "urdf loop": (lambda p: urdf(p, '<parent link="base"/>', '<parent link="fore"/>'), "pair.urdf"),
    "urdf link unknown": (lambda p: urdf(p, '<child link="fore"/>', '<child link="four"/>'), '"four"'),
    "urdf mass not a number": (lambda p: urdf(p, '<mass value="1"/>', '<mass value="one"/>'), "one"),
    "term unknown": (lambda p: toml(p, '[[terms]]\nkind = "stribeck"\n'), "stribeck"),
    "coupling size": (lambda p: toml(p, '[[terms]]\nkind = "motor_side"\ncoupling = [[1]]\n'), "1 x 1"),
    "constraint on no link": (
        lambda p: toml(p, '[[constraints.center_of_mass_box]]\nlink = "hand"\nlower = [0, 0, 0]\nupper = [1, 1, 1]\n'),
        "hand",
    ),
    "constraints contradict": (
        lambda p: toml(p, "[constraints]\ntotal_mass = { maximum = -1.0 }\n"),
        "TotalMass must have a positive maximum",
    ),
    "cutoff beyond the rate": (lambda p: toml(p, "order = 3\ntorque_cutoff = 5000.0\n"), "5000"),
    # logs
    "log missing": (lambda p: (p / "log.csv").unlink(), "log.csv"),
    "log empty": (lambda p: (p / "log.csv").write_text(""), "log.csv"),
    "log without rows": (lambda p: (p / "log.csv").write_text(HEADER), "log.csv"),
    "log without header": (
        lambda p: (p / "log.csv").write_text("0,1,2,3,4\n0.005,1,2,3,4\n"),
        "no line of column names",
    ),
    "log with text": (
        lambda p: (p / "log.csv").write_text(HEADER + "0,1,2,3,4\n0.005,x,2,3,4\n0.01,1,2,3,4\n"),
        "line 3, holds 'x' in column 'q1'",
    ),
    "log not a number": (lambda p: rows(p, put("q1", 100, np.nan)), "q1"),
    "log infinite": (lambda p: rows(p, put("tau2", 7, np.inf)), "tau2"),
    "log times repeat": (lambda p: rows(p, put("t", 5, 0.02)), "log.csv"),
    "log column missing": (lambda p: rows(p, without("q2")), "q"),
    "log of another robot": (lambda p: rows(p, one_more_joint), "3"),
    "log in degrees": (lambda p: rows(p, degrees), "degrees"),
    "log velocities swapped": (lambda p: rows(p, swapped_velocities), "swapped"),
    "log torque stuck": (
        lambda p: rows(p, lambda c: c | {"tau1": 0 * c["tau1"] + 1.0}),
        "torque of joint 'shoulder' is 1 throughout",
    ),
    "log too short": (lambda p: rows(p, lambda c: {k: v[:5] for k, v in c.items()}), "log.csv"),
    "log of another kind": (lambda p: (p / "log.csv").write_bytes(bytes(range(256)) * 20), "log.csv"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_one_sentence_and_nothing_half_written(run, place, kind):
    break_it, phrase = KINDS[kind]
    break_it(place)
    code, _, err = run("identify", place / "robot.toml", place / "log.csv", "--output", place / "result")
    *steps, message = err.strip().splitlines()
    assert code == 2, err
    assert message.startswith("steelyard: ")
    assert phrase in message
    assert all(step.split()[1:2] == ["s"] for step in steps), err  # nothing but progress above the sentence
    assert "Traceback" not in err
    assert not (place / "result").exists()


@pytest.mark.parametrize("output", [("-o", ""), ("--output", ""), ("--output=",)])
def test_an_empty_place_is_not_the_current_folder(run, place, monkeypatch, output):
    """As `--output "$OUT"` is where no such variable is set."""
    monkeypatch.chdir(place)
    before = sorted(place.iterdir())
    code, _, err = run("identify", "robot.toml", "log.csv", *output)
    assert code == 2
    assert "--output is empty" in err
    assert sorted(place.iterdir()) == before


def test_a_description_in_the_folder_of_the_results_is_not_replaced(run, place):
    text = (place / "pair.urdf").read_text()
    (place / "robot.urdf").write_text(text)
    code, _, err = run("identify", place / "robot.urdf", place / "log.csv", "--output", place)
    assert code == 2
    assert err.strip().endswith("robot.urdf: is read, and the results would replace it; give another --output.")
    assert (place / "robot.urdf").read_text() == text


@pytest.mark.slow
def test_no_input_is_replaced(run, place):
    """Of each command that writes a file, whatever it is asked to write to."""
    _, _, err = run("identify", place / "robot.toml", place / "log.csv", "--output", place / "result")
    (place / "parameters.csv").write_text((place / "log.csv").read_text())
    robot, log, estimate = place / "robot.toml", place / "log.csv", place / "result" / "estimate.json"
    (place / "link.csv").symlink_to(log)
    commands = [
        ("correct", robot, estimate, "-o", place / "pair.urdf"),
        ("correct", robot, estimate, "-o", estimate),
        ("correct", robot, estimate, "-o", robot),
        ("validate", robot, estimate, place / "link.csv", "-o", log),
        ("validate", robot, estimate, f"{log}+{place / 'link.csv'}", "-o", log),
        ("explain", robot, estimate, "-o", estimate),
        ("compare", estimate, estimate, "-o", estimate),
        ("compare", estimate, estimate, "--page", estimate),
        ("payload", robot, log, "--estimate", estimate, "-o", log),
        ("deflections", robot, estimate, log, "--samples", log),
        ("inspect", robot, "--repair", "-o", place / "pair.urdf"),
        ("init", place / "pair.urdf", log, "--force", "-o", log),
        ("identify", robot, place / "parameters.csv", "-o", place),
        ("check", robot, estimate, "-o", estimate),
        ("check", robot, estimate, "-o", robot),
        ("simulate", robot, "--torque", place / "simulation.csv", "-o", place),
        ("excite", robot, "--limits", place / "excite.json", "-o", place),
        ("excite", robot, "--prior-information", place / "trajectory.csv", "-o", place),
        ("excite", robot, "--on-the-fly", "--estimate", place / "result", "-o", place / "result"),
    ]
    commands += [  # a folder of results stands for the estimate in it
        tuple(place / "result" if one == estimate and k != len(command) - 1 else one for k, one in enumerate(command))
        for command in commands
        if estimate in command[2:-1]
    ]
    for name in ("simulation.csv", "trajectory.json", "trajectory.csv", "excite.json"):
        (place / name).write_text(log.read_text())
    files = [path for path in place.rglob("*") if path.is_file()]
    before = [path.read_bytes() for path in files]
    for command in commands:
        code, _, err = run(*command)
        assert code == 2, command
        assert err.strip().endswith(": is read, and the results would replace it; give another --output."), command
    assert [path.read_bytes() for path in files] == before


OPTIONS = {
    "no log": (("identify", "{robot}", "--output", "{out}"), "LOG"),
    "no output": (("identify", "{robot}", "{log}"), "--output"),
    "unknown option": (("identify", "{robot}", "{log}", "--outptu", "{out}"), "--outptu"),
    "unknown consistency": (("identify", "{robot}", "{log}", "-o", "{out}", "--consistency", "ful"), "ful"),
    "negative slack": (("identify", "{robot}", "{log}", "-o", "{out}", "--residual-slack", "-1"), "residual-slack"),
    "output is a file": (("identify", "{robot}", "{log}", "-o", "{robot}"), "is a file"),
    "output of 300 letters": (("identify", "{robot}", "{log}", "-o", "{out}" + 300 * "e"), "give another --output"),
    "unknown command": (("identfy",), "identfy"),
    "robot of no known kind": (("inspect", "{log}"), "csv"),
    "estimate missing": (("check", "{robot}", "{out}"), "cannot be read"),
    "estimate is something else": (("check", "{robot}", "{robot}"), "is not JSON"),
    "seed negative": (("demo", "--seed", "-1"), "seed"),
    "cad preference without cad": (
        ("identify", "{dh}", "{log}", "-o", "{out}", "--prefer", "cad"),
        "needs inertial parameters in the robot description",
    ),
}


@pytest.mark.parametrize("kind", OPTIONS)
def test_bad_options(run, place, kind):
    arguments, phrase = OPTIONS[kind]
    (place / "dh.toml").write_text('[description]\nrows = [["pi/2", 0, 0, "q"], [0, 0.4, 0, "q"]]\n')
    names = {"robot": place / "robot.toml", "log": place / "log.csv", "out": place / "result", "dh": place / "dh.toml"}
    code, _, err = run(*(a.format(**names) for a in arguments))
    assert code == 2, err
    assert phrase in err
    assert "Traceback" not in err


@pytest.mark.slow
def test_an_estimate_of_another_robot(run, place):
    run("identify", place / "robot.toml", place / "log.csv", "--output", place / "result")
    (place / "dh.toml").write_text('[description]\nrows = [["pi/2", 0, 0, "q"], [0, 0.4, 0, "q"]]\n')
    code, _, err = run("check", place / "dh.toml", place / "result" / "estimate.json")
    assert code == 2
    assert "parameters of another robot" in err


def test_a_failure_keeps_earlier_results(run, place):
    assert run("identify", place / "robot.toml", place / "log.csv", "--output", place / "result")[0] == 0
    before = {p.name: p.read_bytes() for p in (place / "result").iterdir()}
    (place / "log.csv").write_text(HEADER)
    assert run("identify", place / "robot.toml", place / "log.csv", "--output", place / "result")[0] == 2
    assert {p.name: p.read_bytes() for p in (place / "result").iterdir()} == before
    assert json.loads(before["run.json"])["format"] == "steelyard-run-1"


def test_an_interrupt_while_the_command_line_is_loaded_is_told(monkeypatch, capsys):
    class Interrupted(types.ModuleType):
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "steelyard.cli", Interrupted("steelyard.cli"))
    with pytest.raises(SystemExit, match="130"):
        importlib.import_module("steelyard.__main__").main()
    assert capsys.readouterr() == ("", "steelyard: interrupted\n")


@pytest.mark.parametrize("cause", ["a log that says nothing", "an interrupt"])
def test_no_empty_folder_is_left_behind(run, place, monkeypatch, cause):
    (place / "short.csv").write_text("t,q1,q2,tau1,tau2\n0,0,0,0,0\n0.1,0,0,0,0\n")
    if cause == "an interrupt":

        def interrupted(*_, **__):
            raise KeyboardInterrupt

        monkeypatch.setattr("steelyard.identification.identify", interrupted)
    new, there = place / "new" / "result", place / "there"
    there.mkdir()
    for output in (new, there):
        code, _, err = run("identify", place / "robot.toml", place / "short.csv", "--output", output)
        assert code == (130 if cause == "an interrupt" else 2), err
        assert cause != "an interrupt" or err.endswith("steelyard: interrupted\n")
    assert not new.parent.exists()
    assert there.is_dir()
