"""The package as such: its names, its command, and what it says of itself."""

import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
import typer.main

import steelyard
import steelyard_thesis
from steelyard.cli import main

PLACE = Path(__file__).resolve().parents[1]
ROOT = PLACE.parent
PROJECT = tomllib.loads((PLACE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
# Who may import whom inside: each what stands before it.
ROOMS = ("tabulated_model", "cobyla", "closed_form", "methods", "reproduction", "command")


@pytest.fixture
def run(monkeypatch, capsys):
    """Return a function that runs ``steelyard`` as it is where this package is installed."""
    ((name, target),) = PROJECT["entry-points"]["steelyard.commands"].items()
    entry = EntryPoint(name, target, "steelyard.commands")
    monkeypatch.setattr("steelyard.extensions.entry_points", lambda group, name=None: [entry])

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["steelyard", *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
        output = capsys.readouterr()
        return code, output.out, output.err

    return run


def test_every_name_is_there():
    assert [name for name in steelyard_thesis.__all__ if not hasattr(steelyard_thesis, name)] == []
    assert set(steelyard_thesis.__all__) > {method.__name__ for method in steelyard_thesis.METHODS}


def test_version_and_licence_are_those_of_steelyard():
    assert steelyard_thesis.__version__ == PROJECT["version"] == steelyard.__version__
    assert f"steelyard=={steelyard.__version__}" in PROJECT["dependencies"]
    assert (PLACE / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()


def test_files_import_what_stands_before_them():
    package = PLACE / "src" / "steelyard_thesis"
    assert {path.stem for path in package.iterdir()} - {"__init__", "__pycache__", "py"} == set(ROOMS)
    for path in package.rglob("*.py"):
        room = path.relative_to(package).with_suffix("").parts[0]
        taken = re.findall(
            r"^\s*(?:from|import) steelyard_thesis\.(\w+)", path.read_text(encoding="utf-8"), re.MULTILINE
        )
        assert [name for name in taken if ROOMS.index(name) > ROOMS.index(room)] == [], path


def test_the_command_says_what_it_can_without_heavy_libraries(run):
    code, out, err = run("--help")
    assert (code, err) == (0, "")
    assert re.search(r"^  reproduce +Compute the tables and figures", out, re.MULTILINE)
    command = "import steelyard_thesis.command, sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
    assert {"scipy", "polars", "plotly", "clarabel"}.isdisjoint(done.stdout.split())


def test_documented_options_are_those_of_the_command():
    from steelyard_thesis.command import reproduce

    app = typer.Typer(add_completion=False)
    app.command()(reproduce)
    text = (ROOT / "docs" / "thesis" / "index.md").read_text(encoding="utf-8")
    options = {o for p in typer.main.get_command(app).params for o in p.opts if o.startswith("--") and o != "--help"}
    assert set(re.findall(r"^\| `(--[\w-]+)", text, re.MULTILINE)) == options


def test_a_section_is_reproduced_by_the_command(run, tmp_path):
    code, out, _ = run("reproduce", "4.2", "--output", tmp_path)
    assert code == 0
    agreeing, published = map(int, re.search(r"^(\d+) of (\d+) published values agree", out, re.MULTILINE).groups())
    assert agreeing == published > 0
    assert (tmp_path / "reproduction.html").is_file()
    code, _, err = run("reproduce", "12.7", "--output", tmp_path)
    assert code == 2
    assert err.count("\n") == 1
    assert "12.7" in err


@pytest.mark.slow
def test_each_wheel_holds_one_package(tmp_path):
    wheel = pytest.importorskip("hatchling.builders.wheel", reason="wheels are made by hatchling")
    for place, package in ((ROOT, "steelyard"), (PLACE, "steelyard_thesis")):
        archive = next(iter(wheel.WheelBuilder(str(place)).build(directory=str(tmp_path), versions=["standard"])))
        with zipfile.ZipFile(archive) as file:
            names = {name.partition("/")[0] for name in file.namelist()}
            kept = {name for name in file.namelist() if name.startswith(f"{package}/")}
        assert {name for name in names if not name.endswith(".dist-info")} == {package}
        assert f"{package}/py.typed" in kept
        assert len([name for name in kept if name.endswith(".csv")]) == (16 if package == "steelyard_thesis" else 0)
