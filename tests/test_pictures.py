"""The pictures of the documentation are those that the script makes, and stand where readers look."""

import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from python_file import module_of_file

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


@pytest.mark.slow
def test_no_picture_is_out_of_date() -> None:
    from steelyard import InputError
    from steelyard.identification.examples import EXAMPLES

    try:
        EXAMPLES["panda"].robot()
    except InputError as error:
        pytest.skip(str(error))
    done = subprocess.run(
        [sys.executable, DOCS / "pictures.py", "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
