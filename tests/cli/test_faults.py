"""What nobody thought of ends in a sentence too, and nothing but text reaches the terminal."""

import errno
import io
import json
import os
import shlex
import subprocess
import sys

import polars
import pytest

import steelyard as sy
from steelyard.cli import terminal
from steelyard.cli.terminal import guarded, progress
from steelyard.errors import printable

SEQUENCES = ("\x1b", "\x9b", "\x07", "\u202e", "\u2066", "\r")


def raising(error):
    def run(*_, **__):
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (TypeError("unhashable type: 'list'"), "a fault of steelyard itself, TypeError (unhashable type: 'list')"),
        (ZeroDivisionError(), "a fault of steelyard itself, ZeroDivisionError;"),
        (polars.exceptions.PanicException("called `Option::unwrap()`\non None"), "PanicException (called"),
        (MemoryError(), "there is not enough memory for this"),
        (RecursionError("maximum recursion depth exceeded"), "RecursionError"),
    ],
)
def test_a_fault_is_a_sentence_with_a_trace(run, place, monkeypatch, tmp_path, error, words):
    monkeypatch.setattr(sy.robot.RobotFile, "load", raising(error))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    code, out, err = run("inspect", place / "robot.toml")
    assert code == 70
    assert out == ""
    assert err.count("\n") == 1
    assert words in err
    assert "please report it" in err
    (trace,) = tmp_path.glob("steelyard-fault-*.txt")
    assert str(trace) in err
    assert os.name != "posix" or trace.stat().st_mode & 0o777 == 0o600
    text = trace.read_text()
    assert "Traceback" in text
    assert type(error).__name__ in text
    assert sy.__version__ in text
    assert "'inspect'" in text


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of addresses, as Linux keeps them")
@pytest.mark.parametrize("allowed", [400_000, 700_000])  # a damaged file, it seemed; and a run without end
def test_a_limit_that_libraries_do_not_survive_is_told_first(place, allowed):
    command = f"ulimit -v {allowed}; exec {shlex.quote(sys.executable)} -m steelyard inspect robot.toml"
    ran = subprocess.run(["sh", "-c", command], cwd=place, capture_output=True, text=True, timeout=60)
    assert ran.returncode == 2
    assert ran.stderr.count("\n") == 1
    assert f"allows a process {allowed // 1024} MiB of addresses" in ran.stderr
    assert "ulimit -v 2097152" in ran.stderr


def test_a_fault_without_a_place_for_its_trace(run, place, monkeypatch):
    monkeypatch.setattr(sy.robot.RobotFile, "load", raising(TypeError("odd")))
    monkeypatch.setattr("tempfile.mkstemp", raising(OSError("full")))
    code, _, err = run("inspect", place / "robot.toml")
    assert code == 70
    assert err.strip().endswith("its trace could not be saved")


def test_a_long_message_is_shortened(run, place, monkeypatch):
    monkeypatch.setattr(sy.robot.RobotFile, "load", raising(sy.InputError("begin " + 10_000 * "x" + "\nend")))
    code, _, err = run("inspect", place / "robot.toml")
    assert code == 2
    assert err.startswith("steelyard: begin xxx")
    assert err.endswith("xx end\n")
    assert err.count("\n") == 1
    assert len(err) < terminal.LONGEST_SENTENCE + 100


def hostile(place, mark):
    """Rename joint, link, robot and column so that a terminal would obey them."""
    name = f"elbow{mark}[2J"
    rows = '[["pi/2", 0, 0.3, "q"], [0, 0.5, 0, "q"]]'
    text = f"name = {json.dumps(name)}\n[description]\nrows = {rows}\n"
    (place / "hostile.toml").write_text(text, encoding="utf-8")
    if mark == "\x9b":  # the only one that XML allows
        text = (place / "pair.urdf").read_text().replace('"elbow"', f'"{name}"').replace('"fore"', f'"fore{mark}31m"')
        (place / "pair.urdf").write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    "mark", [mark if mark == "\x1b" else pytest.param(mark, marks=pytest.mark.slow) for mark in SEQUENCES]
)
def test_names_do_not_speak_to_the_terminal(run, place, mark):
    hostile(place, mark)
    log = place / f"log{mark}[31m.csv"
    log.write_text((place / "log.csv").read_text().replace("q2", f"x{mark}2"))
    commands = [
        ("inspect", place / "hostile.toml"),
        ("inspect", place / "robot.toml"),
        ("identify", place / "robot.toml", log, "-o", place / "out"),
        ("check", place / "robot.toml", place / f"none{mark}.json"),
        ("simulate", place / "robot.toml", "--initial", f"0,{mark}", "-o", place / "out"),
        (f"none{mark}",),
        ("inspect", place / "robot.toml", f"--none{mark}"),
    ]
    for command in commands:
        _, out, err = run(*command)
        assert out + err
        for one in SEQUENCES:
            assert one not in out + err.replace("\r\n", "\n"), command
    assert printable(mark) in err or mark == "\r"


class Screen(io.StringIO):
    encoding = "ascii"

    def __init__(self, terminal):
        super().__init__()
        self.terminal = terminal

    def isatty(self):
        return self.terminal


@pytest.mark.parametrize("terminal", [True, False])
def test_colours_are_for_terminals_and_other_encodings_are_written_out(terminal, monkeypatch):
    stream = Screen(terminal)
    monkeypatch.setattr(sys, "stdout", stream)
    with guarded():
        print("\x1b[1mN·m\x1b[0m \x1b[2J\x1b]0;title\x07")
    colour = ("\x1b[1m", "\x1b[0m") if terminal else ("\\x1b[1m", "\\x1b[0m")
    assert stream.getvalue() == f"{colour[0]}N\\xb7m{colour[1]} \\x1b[2J\\x1b]0;title\\x07\n"
    assert sys.stdout is stream


@pytest.mark.parametrize("command", [["--help"]])
def test_a_reader_that_goes_away_is_no_fault(place, command):
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as pipe:
        command = [sys.executable, "-m", "steelyard", *command]
        done = subprocess.run(command, cwd=place, stdout=pipe, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full here")
@pytest.mark.parametrize(
    ("line", "code", "out", "err"),
    [
        ("--version >&-", 0, "", ""),
        ("--version <&- >&- 2>&-", 0, "", ""),
        ("--version 2>/dev/full", 0, "steelyard", ""),
        ("--version >/dev/full", 2, "", "steelyard: the system: No space left on device.\n"),
        pytest.param("inspect no.urdf 2>&-", 2, "", "", marks=pytest.mark.slow),
        pytest.param(
            "inspect no.urdf --json 2>/dev/full", 2, '{\n "format": "steelyard-error-1"', "", marks=pytest.mark.slow
        ),
        pytest.param(
            "inspect no.urdf --json >/dev/full",
            2,
            "",
            "steelyard: no.urdf: cannot be read (No such file",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_streams_that_are_closed_or_full(line, code, out, err):
    """What nobody wants to read is not told; an answer that is lost is."""
    command = f"{shlex.quote(sys.executable)} -m steelyard {line}"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    assert done.returncode == code
    for found, begin in ((done.stdout, out), (done.stderr, err)):
        assert found.startswith(begin)
        assert bool(found) == bool(begin)


def test_no_work_is_lost_for_progress_that_cannot_be_written(monkeypatch):
    class Full(io.StringIO):
        def write(self, text):
            raise OSError(errno.ENOSPC, "No space left on device")

        def flush(self):
            self.write("")

    monkeypatch.setattr(sys, "stderr", Full())
    with guarded(), progress() as say:
        say("reading")
        print("a warning of a library", file=sys.stderr, flush=True)
        sys.stderr.overwrite("reading: 50 %")


@pytest.mark.parametrize("home", ["relative/cache", "", "."])
def test_a_relative_cache_home_is_ignored(home, tmp_path, monkeypatch):
    from steelyard.graph import cache

    if sys.platform in ("win32", "darwin"):
        pytest.skip("the variable is of other systems")
    monkeypatch.delenv("STEELYARD_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", home)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache._user_folder() == tmp_path / ".cache" / "steelyard"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    assert cache._user_folder() == tmp_path / "own" / "steelyard"
