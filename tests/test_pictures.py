"""The pictures of the documentation are those that the script makes, and stand where readers look.

Most are drawn from the examples, which are identified here once: what must come out of them is looked at here too.
"""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from python_file import module_of_file

from steelyard.identification.examples import EXAMPLES

ROOT = Path(__file__).resolve().parent.parent
DOCS, IMAGES = ROOT / "docs", ROOT / "docs" / "images"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    path = list(sys.path)
    module = module_of_file(DOCS / "pictures.py")
    sys.path[:] = path
    return module


def test_every_picture_is_made_by_the_script_and_shown(script: ModuleType) -> None:
    made = {f"{name}.svg" for name in script.PICTURES}
    assert {path.name for path in IMAGES.iterdir()} == made
    pages = "".join(path.read_text(encoding="utf-8") for path in [ROOT / "README.md", *DOCS.rglob("*.md")])
    assert set(re.findall(r"images/([\w-]+\.svg)", pages)) == made
    assert sum(path.stat().st_size for path in IMAGES.iterdir()) < 3e6


def test_the_floors_of_the_house_are_its_rooms(script: ModuleType) -> None:
    rooms = {path.parent.name for path in (ROOT / "src" / "steelyard").glob("*/__init__.py")}
    assert {room for _, found in script.FLOORS for room in found} == rooms


@pytest.mark.parametrize("page", sorted(path.name for path in (DOCS / "how-to").glob("*.md")))
def test_every_how_to_page_has_a_picture(page: str) -> None:
    assert re.search(r"^!\[.{20,}\]\(\.\./images/", (DOCS / "how-to" / page).read_text(encoding="utf-8"), re.MULTILINE)


def test_figures_are_compared_and_not_pixels(script: ModuleType) -> None:
    figures = {"mass, kg": 10.6, "verdict": "good: 4.2 %", "links": 6}
    assert script.differences(figures, {"mass, kg": 10.61, "verdict": "good: 4.3 %", "links": 6}) == []
    told = script.differences(figures, {"mass, kg": 11.6, "verdict": "poor: 4.2 %", "links": 6})
    assert [sentence.split(":")[0] for sentence in told] == ["mass, kg", "verdict"]
    assert script.differences(figures, {**figures, "links": 5}) == ["links: 6 in the picture, 5 now"]
    scatter = {**figures, "± mass, kg": 1.0}
    assert script.differences(scatter, {**scatter, "mass, kg": 12.5}) == []
    assert script.differences(scatter, {**scatter, "mass, kg": 12.7}) == ["mass, kg: 10.6 in the picture, 12.7 now"]
    drawing = script.Drawing("a < b & c")
    drawing.figures.update(figures)
    assert script.figures_of(drawing.svg()) == figures


@pytest.fixture(scope="module")
def runs(script: ModuleType, example: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The runs of the pictures, whose examples are those of the other tests."""
    made = script.Runs(tmp_path_factory.mktemp("runs"))
    made.written = example
    return made


@pytest.mark.slow
def test_no_picture_is_out_of_date(
    script: ModuleType, runs: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(script, "Runs", lambda folder: runs)
    assert script.main(["--check"]) == 0, capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_what_must_come_out_of_an_example_comes_out(runs: Any, name: str) -> None:
    found, truth = runs.example(name)
    values = dict(zip(truth.parameter_names, truth.parameters, strict=True))
    rows = {row.name: row for row in found.parameters}
    told = [name for name in values if name in rows]
    inside = [name for name in told if rows[name].lower <= values[name] <= rows[name].upper]
    assert len(inside) >= 0.9 * len(told)
    mass = sum(value for name, value in values.items() if name[0] == "m" and name[1:].isdigit())
    assert rows["total mass"].value == pytest.approx(mass, rel=0.1)
    assert found.prediction.word == "good"
