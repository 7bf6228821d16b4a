"""Property tests try the same examples whatever ran before; a profile of their own looks for new ones."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

DRAWS = """
import hypothesis
from hypothesis import given, settings
from hypothesis import strategies as st

found = []

@given(st.integers(0, 2**40))
def test_draws(number):
    found.append(number)

def test_tells():
    with open("found.txt", "w") as file:
        print(settings.default.derandomize, settings.default.database is None, *found, file=file)
"""
# A file that is no test and is loaded before the draws: Hypothesis would try its numbers.
NUMBERS = f"NUMBERS = {[10**11 + 7919 * k for k in range(500)]}\n"
BEFORE = "import loaded\n\ndef test_before():\n    assert loaded.NUMBERS\n"


def examples(folder: Path, *options: str) -> list[str]:
    """Run a property test under the settings of these tests, and return settings and examples."""
    (folder / "conftest.py").write_text((Path(__file__).parents[1] / "conftest.py").read_text())
    (folder / "test_draws.py").write_text(DRAWS)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options]
    # Hypothesis has a profile of its own for build servers, which is not to decide for ours.
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent / "oracles"), "CI": "true"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    return (folder / "found.txt").read_text().split()


@pytest.mark.slow
def test_examples_do_not_depend_on_what_ran_before(tmp_path: Path) -> None:
    alone, after = tmp_path / "alone", tmp_path / "after"
    alone.mkdir()
    after.mkdir()
    (after / "loaded.py").write_text(NUMBERS)
    (after / "test_before.py").write_text(BEFORE)
    first = examples(alone)
    assert first[:2] == ["True", "True"]
    assert len(first) > 20
    assert examples(after) == first


@pytest.mark.slow
def test_random_profile(tmp_path: Path) -> None:
    first, second = (examples(tmp_path, "--hypothesis-profile=random") for _ in range(2))
    assert first[:2] == ["False", "False"]
    assert first != second
