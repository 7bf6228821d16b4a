"""What people and programs expect of a command line: JSON, quiet, -h, examples, completion, progress, and remedies."""

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer

import steelyard as sy
from steelyard.cli.main import COMMANDS, app
from steelyard.cli.terminal import _Guarded, how_far, progress
from steelyard.files import tell

GROUP = typer.main.get_command(app)
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "command-line.md"


@pytest.fixture(scope="module")
def results():
    """The files that an identification wrote, by name, once there was one."""
    return {}


@pytest.fixture
def identified(run, place, results):
    """The folder of a robot, a log, and the results of their identification."""
    if not results:
        code, _, _ = run("identify", place / "robot.toml", place / "log.csv", "--output", place / "result", "--quiet")
        assert code == 0
        results |= {path.name: path.read_bytes() for path in (place / "result").iterdir()}
    (place / "result").mkdir(exist_ok=True)
    for name, content in results.items():
        (place / "result" / name).write_bytes(content)
    return place


def document(out):
    """Read what stands on standard output, which must be one document in ASCII and nothing else."""
    assert out.isascii()
    return json.loads(out)


def test_identify_for_machines(run, place):
    code, out, err = run(
        "identify", place / "robot.toml", place / "log.csv", "-o", place / "result", "--json", "--quiet"
    )
    assert (code, err) == (0, "")
    told = document(out)
    estimate = sy.Estimate.load(place / "result" / "estimate.json")
    assert told["format"] == "steelyard-identification-1"
    assert told["prediction"]["word"] == "good"
    values = {row["name"]: row["value"] for row in told["parameters"]}
    np.testing.assert_array_equal([values[name] for name in estimate.parameter_names], estimate.parameters)
    assert told["possible"] is True
    assert {os.path.basename(path) for path in told["files"]} >= {"estimate.json", "report.html", "run.json"}


@pytest.mark.slow
def test_other_commands_for_machines(run, identified):
    robot, estimate, log = (identified / name for name in ("robot.toml", "result/estimate.json", "log.csv"))
    code, out, _ = run("validate", robot, identified / "result", log, "--json", "-q")
    assert code == 0
    assert document(out)["prediction"]["word"] == "good"
    code, out, _ = run("compare", estimate, estimate, "--robot", robot, "--json", "-q")
    assert code == 0
    assert document(out)["differs"] is False
    code, out, _ = run("check", robot, estimate, "--json")
    verdict = document(out)
    assert (code, verdict["feasible"], verdict["violations"]) == (0, True, [])
    code, out, _ = run("check", robot, estimate, "--output", identified / "proof.json", "--json")
    assert document(out)["proved"] is True
    code, out, _ = run("check", "--certificate", identified / "proof.json", "--json")
    assert (code, document(out)["valid"]) == (0, True)
    code, out, err = run("payload", robot, log, "--estimate", estimate, "--json", "--quiet")
    assert (code, err) == (0, "")
    assert abs(document(out)["mass"]) < 0.1
    code, out, _ = run("inspect", identified / "pair.urdf", "--json")
    told = document(out)
    masses = [joint["mass"] for joint in told["joints"]]
    assert (code, masses, told["verdict"]["feasible"]) == (0, [2.0, 1.0], True)
    assert told["base_parameters"] == list(sy.Model.load(identified / "pair.urdf").base_parameters().expressions)


def test_an_impossible_robot_is_told_to_machines(run, identified):
    text = json.loads((identified / "result" / "estimate.json").read_text())
    index = text["parameter_names"].index("m2")
    text["parameters"][index] = -1.0
    text["consistency"] = text["certificate"] = None
    (identified / "wrong.json").write_text(json.dumps(text))
    code, out, _ = run("check", identified / "robot.toml", identified / "wrong.json", "--json")
    told = document(out)
    assert (code, told["feasible"]) == (1, False)
    assert any("fore" in one["condition"] for one in told["violations"])


def test_an_error_is_a_document_too(run, place):
    code, out, err = run("identify", place / "robot.toml", place / "none.csv", "-o", place / "out", "--json", "-q")
    told = document(out)
    assert (code, told["exit_code"], told["format"]) == (2, 2, "steelyard-error-1")
    assert told["error"] in err


@pytest.mark.slow
def test_quiet_commands_say_the_answer_alone(run, identified):
    robot = identified / "robot.toml"
    code, out, err = run("identify", robot, identified / "log.csv", "-o", identified / "result", "-q")
    assert (code, err, len(out.splitlines())) == (0, "", 1)
    assert out.startswith("The answer can exist and predicts well")
    for words in (
        ("validate", robot, identified / "result", identified / "log.csv"),
        ("compare", identified / "result", identified / "result"),
        ("check", robot, identified / "result" / "estimate.json"),
    ):
        _, out, err = run(*words, "--quiet")
        assert err == ""
        assert len(out.splitlines()) == 1


@pytest.mark.parametrize("name", COMMANDS.own)
def test_every_help_page_has_examples_that_are_understood(name, run):
    short, long = run(name, "-h"), run(name, "--help")
    assert short == long
    assert short[0] == 0
    lines = re.findall(r"^    steelyard (.*)$", short[1].partition("Examples:")[2], re.MULTILINE)
    assert lines
    for line in lines:
        command, *words = line.split()
        assert command == name
        # Options exist, and values fit: what is parsed here is not run.
        GROUP.get_command(None, name).make_context(name, words, parent=None, resilient_parsing=False)


@pytest.mark.parametrize("name", COMMANDS.own)
def test_the_page_of_the_command_line_shows_the_examples(name, run):
    shown = {line.removeprefix("$ ") for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("$ ")}
    text = run(name, "-h")[1].partition("Examples:")[2]
    assert {f"steelyard {rest}" for rest in re.findall(r"^    steelyard (.*)$", text, re.MULTILINE)} <= shown


def test_shells_complete_commands():
    environment = {
        **os.environ,
        "_STEELYARD_COMPLETE": "complete_bash",
        "COMP_WORDS": "steelyard ide",
        "COMP_CWORD": "1",
    }
    code = "import sys; sys.argv = ['steelyard']; from steelyard.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.stdout.split() == ["identify"]


class TestLines:
    """Lines of robot.toml on the command line, which a plain description needs."""

    @pytest.mark.slow
    def test_a_line_is_that_of_the_file(self, run, place):
        text = (place / "log.csv").read_text()
        (place / "stamps.csv").write_text(text.replace("t,", "stamp_of_mine,", 1))
        code, _, err = run("identify", place / "pair.urdf", place / "stamps.csv", "-o", place / "out", "-q")
        assert code == 2
        assert "(pair.urdf has no such section: add --set log.time=..., or write a robot.toml with: " in err.replace(
            f"{place}/", ""
        )
        lines = ("--set", "log.time=stamp_of_mine", "--set", "processing.cutoff=10")
        code, _, _ = run("identify", place / "pair.urdf", place / "stamps.csv", "-o", place / "out", "-q", *lines)
        assert code == 0
        (place / "bare.toml").write_text('[description]\nurdf = "pair.urdf"\n[processing]\ncutoff = 10\n')
        run("identify", place / "bare.toml", place / "log.csv", "-o", place / "other", "-q")
        found = [sy.Estimate.load(place / name / "estimate.json").parameters for name in ("out", "other")]
        np.testing.assert_array_equal(*found)

    @pytest.mark.slow
    def test_remarks_name_what_a_description_has(self, run, place):
        _, out, _ = run("identify", place / "pair.urdf", place / "log.csv", "-o", place / "out", "--verbose")
        assert "set `cutoff` in [processing] to choose" in " ".join(out.split())
        assert "pair.urdf has no such sections: give such a line as --set SECTION.KEY=VALUE" in " ".join(out.split())
        _, out, _ = run("identify", place / "robot.toml", place / "log.csv", "-o", place / "out")
        assert "no such sections" not in out

    def test_a_robot_file_needs_no_other_remedy(self, run, place):
        text = (place / "log.csv").read_text()
        (place / "stamps.csv").write_text(text.replace("t,", "stamp_of_mine,", 1))
        code, _, err = run("identify", place / "robot.toml", place / "stamps.csv", "-o", place / "out", "-q")
        assert code == 2
        assert "--set" not in err

    @pytest.mark.parametrize(
        ("line", "words"),
        [
            ("rate", "is no line of robot.toml"),
            ("log.rate=", "is no line of robot.toml"),
            ("lgo.rate=5", 'did you mean "log"'),
            ("log.rtae=5", 'did you mean "rate"'),
            ("description.tip=tool", "cannot be set"),
        ],
    )
    def test_what_is_no_line_is_refused(self, run, place, line, words):
        code, _, err = run("identify", place / "pair.urdf", place / "log.csv", "-o", place / "out", "-q", "--set", line)
        assert code == 2
        assert words in err

    @pytest.mark.slow
    def test_values_are_those_of_toml(self, run, place):
        lines = ("--set", "log.torque_sign=[1, 1]", "--set", "constraints.total_mass={maximum = 2.5}")
        words = ("identify", place / "pair.urdf", place / "log.csv", "-o", place / "out", "-q", *lines, "--json")
        assert document(run(*words)[1])["total_mass"] <= 2.5 + 1e-6


class Screen(io.StringIO):
    """A terminal."""

    encoding = "utf-8"

    def isatty(self):
        return True


def test_long_steps_tell_how_far_they_have_come(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("steelyard.cli.terminal.time.perf_counter", lambda: now[0])

    def work():
        with progress() as say:
            say("reading run.csv")
            for done in range(0, 2_000_001, 50_000):
                tell("reading run.csv", done, 2_000_000, "rows")
                now[0] += 0.25
            say("done")

    elsewhere = io.StringIO()
    monkeypatch.setattr(sys, "stderr", elsewhere)
    work()
    told = [line.strip() for line in elsewhere.getvalue().splitlines()]
    # Nothing in the first second, then now and then: a file that keeps the output is not filled.
    assert told[1:3] == ["reading run.csv: 10 %, 200 000 rows/s, 9 s left", "10.25 s  done"]
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", _Guarded(screen))
    now[0] = 0.0
    work()
    text = screen.getvalue()
    assert text.count("\r") > 30
    assert "reading run.csv: 50 %, 200 000 rows/s, 5 s left" in text
    # The line is gone before the next one is printed.
    assert re.search(r"\r +\r[^\r]*done", text)


def test_short_steps_tell_nothing(capsys):
    with progress():
        for done in range(100):
            tell("reading", done, 100, "rows")
    assert capsys.readouterr().err == ""


def test_steps_and_the_line_below_them_do_not_disturb_each_other(monkeypatch):
    """A search says what each start found, while the line goes on counting the starts."""
    now = [0.0]
    monkeypatch.setattr("steelyard.cli.terminal.time.perf_counter", lambda: now[0])
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", _Guarded(screen))
    with progress() as say:
        for half in range(16):
            tell("searching", half / 2, 8, "starts")
            now[0] += 2.0
            if half % 2:
                say(f"start {half // 2}")
        tell("searching", 0, 8, "starts")  # once more from the beginning
        now[0] += 4.0
        tell("searching", 1, 8, "starts")
    assert "searching: 75 %, 0.25 starts/s, 8 s left" in screen.getvalue()
    assert "searching: 12 %, 0.25 starts/s, 28 s left" in screen.getvalue()


@pytest.mark.slow
def test_long_commands_tell_how_far_they_have_come(run, identified, monkeypatch):
    monkeypatch.setattr("steelyard.cli.terminal._UNSEEN", 0.0)
    monkeypatch.setattr("steelyard.cli.terminal._AGAIN", (0.0, 0.0))
    robot, estimate = identified / "robot.toml", identified / "result" / "estimate.json"
    text = json.loads(estimate.read_text())
    text["base"][0] = -0.05
    text["parameters"] = text["consistency"] = text["certificate"] = None
    (identified / "wrong.json").write_text(json.dumps(text))
    short = ("--period", 5, "--starts", 1, "--harmonics", 3)
    for words, code, told in (
        (
            ("generate", robot, "--language", "c", "-o", identified / "c"),
            0,
            r"recording the functions .*: \d+ %, .*left",
        ),
        (
            ("explain", robot, identified / "wrong.json"),
            1,
            r"changing one base parameter after the other: \d+ %, .*left",
        ),
        (("explain", robot, estimate), 0, r"ends of the interval of each parameter: \d+ %, .*left"),
        (("simulate", robot, "-o", identified / "fall"), 0, r"simulating: \d+ %, .*left"),
        (("excite", robot, "-o", identified / "motion", *short), 0, r"searching: \d+ %"),
    ):
        found = run(*words)
        assert found[0] == code, found
        assert re.search(told, found[2]), found[2]
        quiet = run(*words, "--quiet")
        assert quiet[::2] == (code, ""), quiet
        assert quiet[1].count("\n") < found[1].count("\n") or words[0] == "generate"


def test_the_pace_is_told_in_words():
    assert how_far("simulating", 5.0, 60.0, "s", 2.0, 4.0) == "simulating: 8 %, 2 s/s, 28 s left"
    assert how_far("trying", 30.0, None, "mistakes", 2.0, 30.0) == "trying: 30 mistakes, 15 mistakes/s"
    assert how_far("reading", 1.0, 1e6, "rows", 10.0, 1.0).endswith("0.1 rows/s, 166666 min left")
    assert how_far("reading", 0.0, 100.0, "rows", 2.0, 0.0) == "reading: 0 %"


def test_reading_a_log_is_told(place):
    from steelyard.files import watched

    told = []
    with watched(lambda *one: told.append(one)):
        sy.identify(place / "robot.toml", place / "log.csv")
    reading = [(done, total) for what, done, total, unit in told if what == "reading log.csv" and unit == "rows"]
    assert reading
    assert {total for _, total in reading} == {2000}
    assert any(what == "decoding log.csv" and unit == "rows" for what, *_, unit in told)
