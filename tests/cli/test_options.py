"""One option has one name, one default and one meaning in all commands, and the default of the function behind it."""

import inspect
from collections import defaultdict
from pathlib import Path

import pytest
import typer

import steelyard as sy
from steelyard.cli.main import app

GROUP = typer.main.get_command(app)
OWN = (
    "demo",
    "inspect",
    "generate",
    "excite",
    "identify",
    "payload",
    "check",
    "correct",
    "explain",
    "simulate",
    "example",
)
SHARED = ("consistency", "weights", "chunk_rows", "allow_extensions")
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "command-line.md"


def options_of(name):
    return {option.name: option for option in GROUP.get_command(None, name).params}


def default_of(option):
    value = getattr(option.default, "value", option.default)
    return None if value == "none" else value


@pytest.mark.parametrize("shared", SHARED)
def test_an_option_is_the_same_in_every_command(shared):
    found = defaultdict(list)
    for name in OWN:
        if shared in options_of(name):
            option = options_of(name)[shared]
            found[(tuple(option.opts), default_of(option), option.help)].append(name)
    assert len(found) == 1, dict(found)
    assert len(next(iter(found.values()))) > 1


def test_every_command_with_a_robot_may_run_its_extensions():
    with_robot = {name for name in OWN if "robot" in options_of(name)}
    assert "identify" in with_robot
    assert {name for name in with_robot if "allow_extensions" not in options_of(name)} == set()


def test_defaults_are_those_of_the_function():
    parameters = inspect.signature(sy.identify).parameters
    options = options_of("identify")
    for name in ("consistency", "weights", "residual_slack", "chunk_rows", "estimator"):
        assert default_of(options[name]) == parameters[name].default, name


@pytest.mark.parametrize("name", OWN)
def test_the_page_lists_the_options(name):
    section = PAGE.read_text(encoding="utf-8").partition(f"## steelyard {name}\n")[2].partition("\n## ")[0]
    options = [option for option in options_of(name).values() if option.param_type_name == "option"]
    missing = [option.opts[0] for option in options if option.name != "help" and f"`{option.opts[0]}`" not in section]
    assert missing == []
