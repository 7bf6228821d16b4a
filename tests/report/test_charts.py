"""Charts: what they hold, and that a real browser draws them."""

import json
from pathlib import Path

import lxml.html
import numpy as np
import pytest

import steelyard as sy
from steelyard.files import write_text
from steelyard.report import Chart, Curve, Section, charts_markup, html_document

from ..chromium import Page


def example() -> str:
    x = np.linspace(0.0, 10.0, 20_001)
    y = np.sin(x)
    y[12_345] = 40.0
    y[3] = np.nan
    charts = [
        Chart("One & only <peak>", "time, s", "rad", (Curve("q", x, y), Curve("reference", x, np.sin(x), "dashed", 0))),
        Chart("Decay", "links", "time, s", (Curve("a", [1, 2, 3], [1.0, 0.1, 0.001], "points"),), y_log=True),
    ]
    content = charts_markup(charts, identifier="some")
    return html_document(
        "t",
        "kind",
        "<Robot>",
        charts_markup([], identifier="none"),
        [Section("s", "S", content)],
        scripts=("charts.js",),
    )


def test_long_curves_keep_their_peaks_and_text_is_escaped() -> None:
    text = example()
    page = lxml.html.fromstring(text)
    assert page.xpath("//figcaption")[0].text == "One & only <peak>"
    data = json.loads(page.xpath('//script[@data-for="some"]')[0].text)
    first = data[0]["curves"][0]
    assert max(value for value in first["y"] if value is not None) == 40.0
    assert len(first["x"]) <= 1502
    assert (first["x"][0], first["x"][-1]) == (0.0, 10.0)
    assert data[0]["curves"][1]["color"] == 0
    assert data[1]["yLog"] is True


def test_names_are_no_markup_of_plotly() -> None:
    """Plotly draws links, bold text and breaks that stand in a name."""
    name = '<a href="https://example.org">elbow</a><br>\u202e &amp;'
    page = lxml.html.fromstring(charts_markup([Chart("q", "t", "rad", (Curve(name, [0, 1], [0, 1]),))], identifier="a"))
    [data] = json.loads(page.xpath("//script")[0].text)
    told = data["curves"][0]["name"]
    assert told == '&lt;a href="https://example.org"&gt;elbow&lt;/a&gt;&lt;br&gt;\\u202e &amp;amp;'


def test_what_cannot_be_drawn_is_refused(tmp_path: Path) -> None:
    with pytest.raises(sy.InputError, match="one shape"):
        Curve("q", [0.0, 1.0], [0.0])
    with pytest.raises(sy.InputError, match="style must be"):
        Curve("q", [0.0], [0.0], "dotted")
    with pytest.raises(sy.InputError, match="cannot be written"):
        write_text("x", tmp_path / "missing" / "page.html")


@pytest.mark.slow
def test_charts_are_drawn(tmp_path: Path, browser: Page) -> None:
    page = tmp_path / "page.html"
    write_text(example(), page)
    browser.open(page)
    browser.wait("document.documentElement.dataset.figures === 'drawn'")
    assert browser.console == []
    drawn = lxml.html.fromstring(browser.run("document.documentElement.outerHTML"))
    layer = ".//*[contains(@class, 'scatterlayer')]"
    lines = drawn.get_element_by_id("some-0").xpath(f"{layer}//*[contains(@class, 'js-line')]/@d")
    assert len(lines) == 2
    assert drawn.get_element_by_id("some-1").xpath(".//*[contains(@class, 'point')]")
