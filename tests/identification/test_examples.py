"""The examples run, and their robot files say what they promise."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(path, id=path.stem, marks=pytest.mark.slow if path.stem == "experiment_in_software" else ())
        for path in sorted(EXAMPLES.glob("*.py"))
    ],
)
def test_script_ends_with_a_feasible_robot(script, capsys):
    names = runpy.run_path(str(script))
    out = capsys.readouterr().out
    assert "Physically feasible" in out
    assert names["error"] < 0.1


def test_every_robot_file_of_the_examples_is_tested():
    tested = (Path(__file__).parent / "test_real_robots.py").read_text()
    files = sorted(p.name for p in EXAMPLES.glob("*.toml"))
    assert files
    assert all(f'"{name}"' in tested for name in files)
