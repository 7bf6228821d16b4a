"""Commands of other packages: found, listed, called, and in nobody's way where they cannot be had."""

import re
import tomllib
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "extend.md"
COMMAND = "def joints() -> None:\n    'Count.'\n    print('two')\n"


def test_the_example_of_the_documentation_is_a_command(run, place, install):
    text = PAGE.read_text(encoding="utf-8").partition("\n## A command\n")[2].partition("\n## ")[0]
    (project,) = re.findall(r"^```toml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    (module,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    entries = tomllib.loads(project)["project"]["entry-points"]["steelyard.commands"]
    assert entries == {"joints": "names.command:joints"}
    install("names", "commands", {"joints": "of_names:joints"}, module)
    assert run("joints", place / "pair.urdf") == (0, "shoulder elbow\n", "")
    code, out, err = run("joints", place / "absent.urdf")
    assert (code, out) == (2, "")
    assert err.startswith("steelyard: ")
    assert "absent.urdf" in err
    code, out, err = run("--help")
    assert (code, err) == (0, "")
    assert re.search(r"^  joints +Print the names of a robot's joints", out, re.MULTILINE)
    assert "Usage: steelyard joints" in run("joints", "--help")[1]


def test_a_package_may_bring_commands_of_its_own(run, install):
    text = (
        "import typer\napp = typer.Typer()\n@app.command()\ndef one(): print(1)\n@app.command()\ndef two(): print(2)\n"
    )
    install("several", "commands", {"several": "of_several:app"}, text)
    assert run("several", "two") == (0, "2\n", "")


BROKEN = {
    "absent": ("of_absent:joints", "import no_such_module_anywhere\n", "ModuleNotFoundError: No module named"),
    "nameless": ("of_nameless:joints", "", "AttributeError"),
    "faulty": ("of_faulty:joints", "1 / 0\n", "ZeroDivisionError: division by zero"),
    "ended": ("of_ended:joints", "raise SystemExit(3)\n", "SystemExit: 3"),
    "number": ("of_number:joints", "joints = 3\n", "TypeError: expected a function with the annotations of Typer"),
    "untyped": ("of_untyped:joints", "def joints(a: int | str): ...\n", "cannot be loaded (AssertionError"),
}


@pytest.mark.parametrize(
    "name",
    [name if name == "faulty" else pytest.param(name, marks=pytest.mark.slow) for name in BROKEN],
)
def test_a_package_that_cannot_be_had_is_named_and_in_nobodys_way(run, place, install, name):
    target, text, reason = BROKEN[name]
    install(name, "commands", {"joints": target}, text)
    install("sound", "commands", {"sound": "of_sound:joints"}, COMMAND)
    assert run("inspect", place / "pair.urdf")[0::2] == (0, "")  # not a word
    assert run("sound") == (0, "two\n", "")
    code, out, err = run("joints")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert err.startswith(f"steelyard: The command `joints` of {name} ")
    assert reason in err
    code, out, told = run("--help")
    assert (code, told) == (0, err)
    assert re.search(r"^  sound +Count\.$", out, re.MULTILINE)
    assert "  joints" not in out


def test_a_fault_is_that_of_the_package(run, install, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    entries = {"joints": "of_faulty:joints", "inspect": "of_faulty:joints"}
    install("faulty", "commands", entries, "def joints(): 1 / 0\n")
    code, out, err = run("joints")
    assert (code, out) == (70, "")
    assert err.startswith("steelyard: a fault of faulty, ZeroDivisionError (division by zero)")
    monkeypatch.setattr("steelyard.robot.RobotFile.load", None)
    assert run("inspect", "arm.urdf")[2].startswith("steelyard: a fault of steelyard itself, TypeError")


def test_a_command_of_ones_own_cannot_be_taken(run, place, install):
    install("thief", "commands", {"inspect": "of_thief:joints"}, COMMAND)
    assert "shoulder" in run("inspect", place / "pair.urdf")[1]
    code, out, err = run("--help")
    assert code == 0
    assert out.count("  inspect ") == 1
    assert err == "steelyard: The command `inspect` of thief is left out: steelyard has one of that name.\n"


def test_two_packages_with_one_command_are_both_named(run, install):
    install("first", "commands", {"joints": "of_first:joints"}, COMMAND)
    install("second", "commands", {"joints": "of_second:joints"}, COMMAND)
    told = "steelyard: The command `joints` is offered by first and second: uninstall all of them but one.\n"
    assert run("joints") == (2, "", told)
    assert run("--help")[2] == told


def test_without_its_package_reproduce_says_how_to_get_it(run, monkeypatch):
    monkeypatch.setattr("steelyard.extensions.entry_points", lambda **which: ())
    code, out, err = run("reproduce", "4.2", "--output", "anywhere")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "steelyard-thesis" in err
    assert "`pip install ./thesis`" in err
    assert "reproduce" not in run("--help")[1]


def test_an_unknown_command_is_refused_as_before(run):
    code, _, err = run("weight")
    assert code == 2
    assert "No such command 'weight'" in err


def test_a_mistyped_command_of_a_package_is_suggested_without_importing_it(run, install):
    install("faulty", "commands", {"joints": "of_faulty:joints"}, "1 / 0\n")
    code, out, err = run("jonts")
    assert (code, out) == (2, "")
    assert "No such command 'jonts'. Did you mean 'joints'?" in err
    assert "Did you mean 'identify'" in run("idenfity")[2]
    assert "No such command 'weight'.\n" in run("weight")[2]
