"""The report in a real browser without a network: what is seen, turned, pressed, read aloud and printed.

Pictures are left in ``build/report``. axe-core is looked for in ``build/axe-core``, where `.ci/run` puts it.
"""

import io
import unicodedata
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from steelyard.identification import Identification

from ..chromium import Page
from .conftest import JOINTS, LINKS, pixels

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "build" / "report"
AXE = ROOT / "build" / "axe-core" / "package" / "axe.min.js"
SIZES = {"desktop": (1280, 800), "phone": (390, 844)}
LATEST = 1000.0  # ms until the largest part of the first screen is painted


@pytest.fixture
def page(browser: Page, report: Path) -> Iterator[Page]:
    browser.console.clear()
    browser.size(*SIZES["desktop"])
    browser.open(report)
    yield browser
    assert browser.console == []


def box(page: Page, selector: str) -> tuple[float, float, float, float]:
    """Left, top, width and height of an element in the window, px."""
    found = page.run(
        f"(r => [r.x, r.y, r.width, r.height])(document.querySelector({selector!r}).getBoundingClientRect())"
    )
    left, top, width, height = (float(value) for value in found)
    return left, top, width, height


def drawing(page: Page) -> np.ndarray:
    """The pixels of the drawing of the robot."""
    page.run("document.querySelector('.ground-of-drawing').scrollIntoView({block: 'center', behavior: 'instant'})")
    page.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done())))")
    left, top, width, height = (round(value) for value in box(page, ".ground-of-drawing"))
    return pixels(page.picture())[max(top, 0) : top + height, left : left + width]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_both_verdicts_are_seen_without_scrolling(page: Page, report: Path, size: str, dark: bool) -> None:
    width, height = SIZES[size]
    page.size(width, height, dark=dark, touch=size == "phone")
    page.open(report)
    for place in (1, 2):
        left, top, wide, high = box(page, f".verdicts > :nth-child({place}) .verdict")
        assert left >= 0.0
        assert left + wide <= width
        assert top >= 0.0
        assert top + high <= height
    assert page.run("scrollY") == 0
    assert page.run("document.documentElement.scrollWidth <= innerWidth")
    page.picture(PICTURES / f"{size}{'-dark' if dark else ''}.png")


@pytest.mark.parametrize("width", [360, 768, 1920, 3840])
def test_nothing_is_wider_than_the_window(page: Page, report: Path, width: int) -> None:
    page.size(width, 2160 if width > 2000 else 1000)
    page.open(report)
    assert page.run("document.documentElement.scrollWidth") <= width
    page.picture(PICTURES / f"width-{width}.png")


def test_the_first_screen_is_painted_soon(page: Page, report: Path) -> None:
    painted = []
    for _ in range(3):  # a machine that does other things, too, delays one of them
        page.open(report)
        painted.append(
            page.run(
                "new Promise(done => new PerformanceObserver("
                "list => done(Math.max(...list.getEntries().map(e => e.startTime)))"
                ").observe({type: 'largest-contentful-paint', buffered: true}))"
            )
        )
    assert min(painted) < LATEST


def test_the_drawing_is_not_empty_and_turns(page: Page) -> None:
    page.size(1280, 1000)
    before = drawing(page)
    ground = before[5, 5]
    drawn = np.abs(before - ground).sum(axis=2) > 60
    assert 0.01 < drawn.mean() < 0.9
    rows, columns = np.nonzero(drawn)
    assert np.ptp(columns) > 0.3 * before.shape[1]
    assert np.ptp(rows) > 0.15 * before.shape[0]
    left, top, width, height = box(page, ".ground-of-drawing")
    middle = (left + width / 2, top + height / 2)
    page.drag(middle, (middle[0] + 120, middle[1] + 40))
    turned = drawing(page)
    assert np.abs(turned - before).sum(axis=2).astype(bool).mean() > 0.005
    page.picture(PICTURES / "drawing-turned.png")
    page.run("document.querySelector('.ground-of-drawing').focus()")
    page.key("ArrowLeft")
    by_key = drawing(page)
    assert (np.abs(by_key - turned).sum(axis=2) > 60).mean() > 0.002
    page.key("Home")
    page.run("document.activeElement.blur()")
    assert (np.abs(drawing(page) - before).sum(axis=2) > 60).mean() < 0.002


def test_a_finger_turns_the_drawing(page: Page, report: Path) -> None:
    page.size(*SIZES["phone"], touch=True)
    page.open(report)
    page.run("document.querySelector('.ground-of-drawing').scrollIntoView({block: 'center', behavior: 'instant'})")
    left, top, width, height = box(page, ".ground-of-drawing")
    before = page.run("document.querySelector('.robot-drawing [data-ball]').getAttribute('transform')")
    page.drag((left + 0.3 * width, top + 0.5 * height), (left + 0.8 * width, top + 0.5 * height), touch=True)
    page.wait(f"document.querySelector('.robot-drawing [data-ball]').getAttribute('transform') !== {before!r}")
    page.size(*SIZES["desktop"])


def test_the_script_projects_as_the_picture_was_drawn(page: Page) -> None:
    """Two programs, in two languages: one has drawn the picture, the other draws it again."""
    read = (
        "Array.from(document.querySelectorAll('.ground-of-drawing svg *')).map(e => [e.getAttribute('class') || '', "
        "...['transform', 'x1', 'y1', 'x2', 'y2'].map(n => e.getAttribute(n) || '')].join(' ').replace(/[()]/g, ' '))"
    )
    before = page.run(read)
    page.run("document.querySelector('[data-look=\"Home\"]').click()")
    page.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done())))")
    after = page.run(read)
    assert len(before) == len(after) > 40

    def numbers(text: str) -> list[float]:
        return [float(word) for word in text.split() if word.lstrip("-").replace(".", "", 1).isdigit()]

    differences = [
        np.abs(np.subtract(numbers(one), numbers(other))).max(initial=0.0)
        for one, other in zip(before, after, strict=True)
    ]
    assert sum(len(numbers(text)) for text in before) > 150
    assert max(differences) < 0.1


def test_links_are_singled_out_and_layers_hidden(page: Page) -> None:
    whole = drawing(page)
    page.run("document.querySelector('button[data-number=\"2\"]').click()")
    assert page.run("document.querySelector('button[data-number=\"2\"]').getAttribute('aria-pressed')") == "true"
    single = drawing(page)
    assert (np.abs(single - whole).sum(axis=2) > 30).any()
    page.run("document.querySelector('button[data-number=\"2\"]').click()")
    page.run("document.querySelector('[data-shows=\"answer\"]').click()")
    without = drawing(page)
    assert (np.abs(without - whole).sum(axis=2) > 30).mean() > 0.01


def test_rows_are_filtered_by_what_they_rest_on(page: Page, identification: Identification) -> None:
    assert identification.parameters is not None
    shown = "document.querySelectorAll('#all-parameters tbody tr:not(.filtered)').length"
    everything = page.run(shown)
    page.run("document.querySelector('.basis-filter input[value=\"assumed\"]').click()")
    assert page.run(shown) == everything - identification.parameters.count("assumed")


def test_every_control_is_reached_and_seen_by_keyboard(page: Page) -> None:
    """Tab reaches what can be pressed, in the order of the page, and the place is marked."""
    page.run("document.querySelectorAll('details').forEach(d => d.open = true)")
    wanted = page.run(
        "Array.from(document.querySelectorAll('a[href], button, input, select, summary, [tabindex=\"0\"]'))"
        ".filter(e => e.offsetParent !== null).length"
    )
    reached, outlined = [], 0
    for _ in range(wanted):
        page.key("Tab")
        index, has_outline = page.run(
            "[Array.from(document.querySelectorAll('*')).indexOf(document.activeElement), "
            "getComputedStyle(document.activeElement).outlineStyle !== 'none']"
        )
        reached.append(index)
        outlined += bool(has_outline)
    assert reached == sorted(reached)
    assert len(set(reached)) == wanted
    assert outlined == wanted


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [360, 1280])
def test_axe_finds_nothing(page: Page, report: Path, dark: bool, width: int) -> None:
    if not AXE.exists():
        pytest.skip(f"axe-core is not in {AXE.relative_to(ROOT)}; npm pack axe-core brings it")
    page.size(width, 800, dark=dark)
    page.open(report)
    page.run("document.querySelectorAll('details').forEach(d => d.open = true)")
    page.run(AXE.read_text(encoding="utf-8"))
    violations = page.run(
        "axe.run(document, {runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice']})"
        ".then(r => r.violations.map(v => v.id + ': ' + v.nodes.slice(0, 3).map(n => n.html.slice(0, 200))))"
    )
    assert violations == []
    # It has looked at colours at all.
    passed = page.run("axe.run(document, {runOnly: ['color-contrast']}).then(r => r.passes[0].nodes.length)")
    assert passed > 50


def test_axe_would_find_something(page: Page) -> None:
    if not AXE.exists():
        pytest.skip(f"axe-core is not in {AXE.relative_to(ROOT)}; npm pack axe-core brings it")
    worse = '<p style="color:#ccc">pale</p><select></select>'
    page.run(f"document.querySelector('main').insertAdjacentHTML('beforeend', {worse!r})")
    page.run(AXE.read_text(encoding="utf-8"))
    found = page.run("axe.run(document).then(r => r.violations.map(v => v.id))")
    assert {"color-contrast", "select-name"} <= set(found)


def printable(text: str) -> str:
    return unicodedata.normalize("NFKC", " ".join(text.split()))


def test_nothing_is_wider_than_the_paper(page: Page) -> None:
    page.size(700, 1000)
    page.call("Emulation.setEmulatedMedia", media="print")
    try:
        page.run("document.querySelectorAll('details').forEach(d => d.open = true)")
        assert page.run("document.documentElement.scrollWidth") <= 700
        page.picture(PICTURES / "print.png", whole=True)
    finally:
        page.call("Emulation.setEmulatedMedia", media="")


def test_the_print_is_complete(page: Page, identification: Identification) -> None:
    """Every section, every folded table, the drawing and the figures are on paper."""
    pypdf = pytest.importorskip("pypdf", reason="pypdf is not installed, which reads printed pages")
    printed = page.pdf()
    PICTURES.mkdir(parents=True, exist_ok=True)
    (PICTURES / "report.pdf").write_bytes(printed)
    sheets = pypdf.PdfReader(io.BytesIO(printed)).pages
    # Without ligatures, which fonts put in the place of two letters.
    text = unicodedata.normalize("NFKC", " ".join(" ".join(sheet.extract_text() for sheet in sheets).split()))
    for title in page.run("Array.from(document.querySelectorAll('h2')).map(h => h.textContent)"):
        assert printable(title) in text
    assert identification.parameters is not None
    everything = page.run("document.querySelectorAll('#all-parameters tbody tr').length")
    assert everything == len(identification.parameters)
    for row in identification.parameters:  # they are folded away on the screen
        assert printable(row.meaning) in text
    for name in (*JOINTS, *LINKS):
        assert printable(name) in text
    # Not a sheet is empty, and the drawing is there: curves of ellipses.
    assert all(len(sheet.extract_text()) > 40 or b" c\n" in sheet.get_contents().get_data() for sheet in sheets)
    assert page.run("document.querySelectorAll('details[open]').length") == 0


def test_pages_without_scripts_show_the_drawing(browser: Page, report: Path) -> None:
    browser.size(1280, 1000)
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.call("Page.navigate", url=report.as_uri())
        while browser._next().get("method") != "Page.loadEventFired":
            pass
        image = pixels(browser.picture(whole=True))
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)
    assert (np.abs(image - image[2, 2]).sum(axis=2) > 60).mean() > 0.02
