"""The report in a real browser, without a network: figures are drawn, proofs are checked, and nothing complains."""

import base64
import json
import re
import zlib
from pathlib import Path

import numpy as np
import pytest

from steelyard.identification import Identification

from ..chromium import Page
from .conftest import pixels

pytestmark = pytest.mark.slow
DRAWN = "document.documentElement.dataset.torques === 'drawn'"
CHECKED = "document.querySelectorAll('[data-checked]').length === 2"


def count(picture: np.ndarray, color: str) -> int:
    """How many pixels have a color that is mostly this one; thin lines are mixed with what is behind them."""
    wanted = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)])
    return int((np.abs(picture.astype(int) - wanted).max(axis=2) <= 60).sum())


def shot(page: Page, identifier: str) -> np.ndarray:
    place = page.run(
        f"(() => {{ const e = document.getElementById('{identifier}'); e.scrollIntoView({{block: 'center'}}); "
        "const r = e.getBoundingClientRect(); "
        "return {x: r.x + scrollX, y: r.y + scrollY, width: r.width, height: r.height}; })()"
    )
    page.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    data = page.call("Page.captureScreenshot", clip=place | {"scale": 1}, captureBeyondViewport=True)["data"]
    return pixels(base64.b64decode(data))


@pytest.mark.parametrize("dark", [False, True])
def test_figures_are_drawn(browser: Page, report: Path, dark: bool) -> None:
    browser.console.clear()
    browser.size(1280, 900, dark=dark)
    browser.open(report)
    browser.wait(DRAWN)
    colors = ("#7cc4f5", "#f08cb8") if dark else ("#005f9e", "#a33a6b")
    picture = shot(browser, "torque-0")
    assert all(count(picture, color) > 300 for color in colors)
    band = browser.run("document.querySelectorAll('#torque-0 .shapelayer path').length")
    assert band == 1
    parts = shot(browser, "source-1")
    assert count(parts, colors[0]) > 200
    browser.run("document.querySelector('details.pattern').open = true")
    browser.wait("document.querySelector('details.pattern').dataset.drawn === 'yes'")
    assert count(shot(browser, "spectrum-0"), colors[1]) > 50
    assert count(shot(browser, "lags-0"), colors[1]) > 50
    assert "relative error" in browser.run("document.getElementById('torque-1').getAttribute('aria-label')")
    assert browser.console == []


def test_all_joints_show_one_span_which_the_keyboard_changes(browser: Page, report: Path) -> None:
    browser.size(1280, 900)
    browser.open(report)
    browser.wait(DRAWN)
    browser.run("document.querySelector('[data-zoom=in]').focus()")
    press = {"key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 13}
    browser.call("Input.dispatchKeyEvent", type="keyDown", text="\r", **press)
    browser.call("Input.dispatchKeyEvent", type="keyUp", **press)
    browser.wait("document.documentElement.dataset.span")
    spans = "JSON.stringify([0, 1].map(k => document.getElementById('torque-' + k).layout.xaxis.range))"
    browser.wait(f"new Set(JSON.parse({spans}).map(String)).size === 1")
    (low, high), other = json.loads(browser.run(spans))
    assert [low, high] == other
    assert high - low == pytest.approx(14.95 / 2, abs=0.05)
    box = browser.run(
        "(() => { const e = document.getElementById('torque-0'); e.scrollIntoView({block: 'center'});"
        "const r = e.querySelector('.xy .bg, .bglayer .bg, .nsewdrag').getBoundingClientRect();"
        "return [r.x, r.y, r.width, r.height]; })()"
    )
    browser.drag((box[0] + 0.25 * box[2], box[1] + 30), (box[0] + 0.5 * box[2], box[1] + 32))
    browser.wait(f"JSON.parse({spans})[1][1] - JSON.parse({spans})[1][0] < {0.6 * (high - low)}")
    first, second = json.loads(browser.run(spans))
    assert first == second
    browser.run("document.querySelector('[data-zoom=whole]').click()")
    browser.wait(f"JSON.parse({spans})[0][1] - JSON.parse({spans})[0][0] > 14")


def test_the_page_checks_its_proofs(browser: Page, report: Path, identification: Identification) -> None:
    browser.console.clear()
    browser.open(report)
    browser.wait(CHECKED)
    told = browser.run("Array.from(document.querySelectorAll('.proof')).map(p => [p.dataset.checked, p.textContent])")
    assert [one[0] for one in told] == ["valid", "valid"]
    assert "make 2 possible bodies" in told[0][1]
    numbers = [
        int(n) for n in browser.run("Array.from(document.querySelectorAll('.proof')).map(p => p.dataset.numbers)")
    ]
    base = len(identification.estimate.base)
    # Of the answer all base parameters, and all standard parameters that a table shows.
    assert numbers[0] >= base + len(identification.model.link_columns) * 10
    assert numbers[1] == base
    assert browser.console == []


@pytest.mark.parametrize("what", ["number", "verdict", "proof"])
def test_a_page_that_was_tampered_with_says_so(browser: Page, report: Path, tmp_path: Path, what: str) -> None:
    text = report.read_text(encoding="utf-8")
    if what == "number":
        rows = text.index('id="base-parameters"')
        place = re.compile(r'<td class="number">(\d)').search(text, rows)
        assert place is not None
        changed = text[: place.start(1)] + str((int(place[1]) + 1) % 10) + text[place.end(1) :]
    elif what == "verdict":
        changed = text.replace('data-verdict="infeasible"', 'data-verdict="feasible"')
    else:
        start = text.index('id="certificate-answer">') + len('id="certificate-answer">')
        end = text.index("<", start)
        content = json.loads(zlib.decompress(base64.b64decode(text[start:end])))
        content["proof"]["parameters"][9] = "-1"
        forged = base64.b64encode(zlib.compress(json.dumps(content).encode())).decode()
        changed = text[:start] + forged + text[end:]
    assert changed != text
    path = tmp_path / "forged.html"
    path.write_text(changed, encoding="utf-8")
    browser.open(path)
    browser.wait(CHECKED)
    told = browser.run("Array.from(document.querySelectorAll('.proof')).map(p => p.dataset.checked)")
    assert "refused" in told
