"""What the report says of the answer: its prediction, what its numbers rest on, and the price of its prior."""

import json
from dataclasses import replace

import lxml.html
import numpy as np
import pytest

from steelyard.identification import Identification
from steelyard.identification.parameter_table import ParameterTable
from steelyard.report import report_html

from .conftest import JOINTS, Reference, rows


@pytest.fixture(scope="module")
def page(identification: Identification) -> lxml.html.HtmlElement:
    return lxml.html.fromstring(report_html(identification))


@pytest.mark.slow
def test_prediction_of_joints_is_that_of_plain_numpy(
    page: lxml.html.HtmlElement, identification: Identification, reference: Reference
) -> None:
    values = identification.estimate.parameters
    assert values is not None
    found = dict(zip(identification.estimate.parameter_names, values.tolist(), strict=True))
    names = ("Lzz1", "lx1", "ly1", "m2", "Lzz2", "lx2", "ly2", "Fvj1", "Fcj1", "Fvj2", "Fcj2")
    left = reference.torques[1] - reference.regressors[1] @ np.array([found[name] for name in names])
    table = rows(page, "prediction-joints")
    assert [row[0] for row in table] == [*JOINTS, "All joints"]
    for joint in range(2):
        assert float(table[joint][2]) == pytest.approx(np.sqrt(np.mean(left[:, joint] ** 2)), rel=6e-3)
        # White noise of 0.5 and 0.1 N·m was added.
        assert float(table[joint][3]) == pytest.approx((0.5, 0.1)[joint], rel=0.15)
        assert float(table[joint][5]) > 80


@pytest.mark.parametrize("word", ["poor", "wrong"])
def test_no_tick_where_the_prediction_is_poor_or_wrong(identification: Identification, word) -> None:
    changed = replace(identification, prediction=replace(identification.prediction, word=word))
    page = lxml.html.fromstring(report_html(changed))
    cards = page.find_class("card")
    assert not [card for card in cards if "good" in card.get("class").split()]
    assert "✓" not in page.text_content()
    assert word.capitalize() in cards[1].text_content()


def test_numbers_stand_with_interval_and_basis(page: lxml.html.HtmlElement, identification: Identification) -> None:
    table = identification.parameters
    assert table is not None
    heads = [cell.text_content() for cell in page.get_element_by_id("terms-Fcj").iter("th")][:5]
    for joint, row in enumerate(rows(page, "terms-Fcj"), start=1):
        cells = dict(zip(heads, row, strict=True))
        expected = table[f"Fcj{joint}"]
        low, high = cells["95 % interval"].split(" … ")
        assert (float(low), float(high)) == pytest.approx((expected.lower, expected.upper), rel=6e-3)
        assert cells["Rests on"] == expected.basis
    everything = rows(page, "all-parameters")
    assert [row[0] for row in everything] == [row.name for row in table]


def test_bars_stay_within_their_frames(page: lxml.html.HtmlElement) -> None:
    bars = page.xpath("//table//svg")
    assert len(bars) >= 2 + 1 + 6 + 6 + 4
    for bar in bars:
        assert bar.get("aria-hidden") == "true"
        for circle in bar.iter("circle"):
            assert 0.0 <= float(circle.get("cx")) <= 90.0
        begin, end = bar.xpath("./path[@class='span']/@d")[0][1:].split(" 7H")
        assert 0.0 <= float(begin) <= float(end) <= 90.0


def test_price_is_drawn_with_the_place_of_the_answer(
    page: lxml.html.HtmlElement, identification: Identification
) -> None:
    assert identification.plausible is not None
    price = identification.plausible.price
    assert price is not None
    (script,) = page.xpath("//script[@data-for='price-chart']")
    (chart,) = json.loads(script.text)
    curves = {curve["name"]: curve for curve in chart["curves"]}
    answer = curves["the answer, stretches left out"]
    assert answer["x"] == pytest.approx([identification.plausible.prior_weight], rel=1e-5)
    assert answer["y"] == pytest.approx([100 * price.held_out_error[price.chosen]], rel=1e-4)
    assert curves["without a prior, data of the fit"]["y"] == pytest.approx(
        [100 * price.unrestricted_error] * 2, rel=1e-4
    )
    assert len(rows(page, "price-table")) == len(price.prior_weights) + 2
    assert [row[0] for row in rows(page, "prior-links")] == [link.link for link in identification.plausible.prior.links]


def test_parts_that_are_not_known_are_left_out(identification: Identification) -> None:
    table = identification.parameters
    assert table is not None
    blind = tuple(replace(row, lower=np.nan, upper=np.nan, basis="unknown") for row in table)
    page = lxml.html.fromstring(report_html(replace(identification, plausible=None, parameters=ParameterTable(blind))))
    assert not page.xpath("//table//svg")
    assert not page.xpath("//*[@id='price' or @id='beforehand' or @href='#price']")
    assert "nan" not in page.get_element_by_id("masses").text_content()
    assert "None of the" in page.text_content()
    bare = replace(
        identification,
        plausible=None,
        parameters=None,
        estimate=replace(identification.estimate, parameters=None),
    )
    page = lxml.html.fromstring(report_html(bare))
    assert "base parameters alone" in page.find_class("lead")[0].text_content()
    assert not page.xpath("//*[@id='masses']")
