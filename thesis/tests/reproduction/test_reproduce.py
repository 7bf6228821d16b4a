"""The reproduction: what it counts, what it writes, and that it goes on where it stopped."""

import csv
import json

import lxml.html
import numpy as np
import pytest

import steelyard as sy
from steelyard.report import Chart, Curve
from steelyard_thesis.reproduction import Comparison, SectionResult, Table, all_sections, reproduce
from steelyard_thesis.reproduction.method_runs import run_method
from steelyard_thesis.reproduction.published import column, rows
from steelyard_thesis.reproduction.sections import constrained_methods, impact, real_robots

from .test_impact import check_study
from .test_real_robots import check_table_of_all_methods


def test_values_agree_within_their_printed_precision_only():
    assert Comparison("x", 4.57, 4.5749, 0.005).agrees
    assert not Comparison("x", 4.57, 4.5751, 0.005).agrees
    assert not Comparison("x", 4.57, float("nan"), 0.005).agrees
    assert not Comparison("x", "feasible", "undecided").agrees


def test_published_tables_are_those_of_the_thesis(thesis_tables):
    for path in thesis_tables.glob("table_*.csv"):
        number = ".".join(path.stem.split("_")[1:3])
        with path.open() as file:
            assert rows(number) == list(csv.DictReader(file))


def test_a_result_survives_json():
    chart = Chart("t", "x", "y", (Curve("c", [0.0, 1.0], [1.0, 2.0], "dashed", 3),), y_log=True)
    result = SectionResult(
        (Comparison("w", 1.0, 1.25, 0.5, "because"),), (Table("t", ("a", "b"), (("r", 2.0),)),), (chart,), ("remark",)
    )
    again = SectionResult.from_dict(json.loads(json.dumps(result.to_dict())))
    assert (again.comparisons, again.tables, again.remarks) == (result.comparisons, result.tables, result.remarks)
    (curve,) = again.charts[0].curves
    assert (curve.x.tolist(), curve.style, curve.color, again.charts[0].y_log) == ([0.0, 1.0], "dashed", 3, True)


def test_a_section_is_computed_once(tmp_path):
    said = []
    first = reproduce(tmp_path, ["4.2"], progress=said.append)
    assert (first.agreeing, first.published) == (78, 78)
    reproduce(tmp_path, ["4.2"], progress=said.append)
    kept = tmp_path / "section_4_2.json"
    kept.write_text(kept.read_text()[:100])  # as if it had been interrupted
    again = reproduce(tmp_path, ["4.2"], progress=said.append)
    assert [text.endswith("computed before") for text in said] == [False, True, False]
    assert again.results[0][1].to_dict() == first.results[0][1].to_dict()
    with (tmp_path / "section_4_2.csv").open() as file:
        written = list(csv.DictReader(file))
    assert (len(written), written[1]["published"], written[1]["agrees"]) == (78, "76.0", "True")
    page = lxml.html.fromstring((tmp_path / "reproduction.html").read_text())
    assert page.xpath('//p[@class="lead"]')[0].text_content().startswith("78 of 78 published values agree")


def test_what_cannot_be_computed_is_told(tmp_path):
    with pytest.raises(sy.InputError, match="There is no section '9'"):
        reproduce(tmp_path, ["9"])
    with pytest.raises(sy.InputError, match="no such folder of recordings"):
        reproduce(tmp_path, ["4.2"], data=tmp_path / "missing")
    result = reproduce(tmp_path, ["real WAM"])
    assert [(section.number, why) for section, why in result.missing] == [
        ("real WAM", "needs the real recordings (--data)")
    ]
    assert "Not computed" in (tmp_path / "reproduction.html").read_text()


def test_sections_are_told_apart():
    numbers = [section.number for section in all_sections()]
    assert len(set(numbers)) == len(numbers)


@pytest.mark.slow
def test_figure_6_1_rises_to_one(tmp_path):
    """The figure as the thesis describes it; the share at WLS is known from an independent trial (0.13)."""
    ((_, result),) = reproduce(tmp_path, ["6.1"]).results
    shares = result.charts[0].curves[0].y
    assert np.all(np.diff(shares) >= 0.0)
    assert shares[0] == pytest.approx(0.13, abs=0.01)
    assert shares[-1] == 1.0
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (2000, 7))
    from steelyard.identification.wam import wam_model

    model, beta = wam_model(), column("4.9", "WLS")
    zero = np.zeros_like(q)
    still = model.kernel("inverse_dynamics", base=True)
    columns = [still(q, zero, np.tile(e, (len(q), 1)), beta) - still(q, zero, zero, beta) for e in np.eye(7)]
    least = np.linalg.eigvalsh(np.stack(columns, axis=-1))[:, 0]
    assert np.mean(least > 0.0) == pytest.approx(shares[0], abs=0.03)


@pytest.mark.data
def test_the_real_arm_agrees(tmp_path, shared_data):
    result = reproduce(tmp_path, ["real WAM"], data=shared_data)
    assert result.agreeing == result.published == 62


def once(fit, information, feasible_set, **options):
    """Run a method once: what it finds is the same each time, and how long it takes is not looked at here."""
    return run_method(fit, information, feasible_set, **{**options, "repetitions": 1})


@pytest.mark.slow
@pytest.mark.data
def test_everything_is_reproduced(tmp_path, shared_data, monkeypatch):
    """All the sections in one run; those that differ are told on the page, each with its reason."""
    monkeypatch.setattr(constrained_methods, "run_method", once)
    result = reproduce(tmp_path, data=shared_data)
    assert result.missing == ()
    assert result.published == 361
    assert result.agreeing >= 335
    assert all(row.agrees or row.why for _, part in result.results for row in part.comparisons)
    parts = {section.title: part for section, part in result.results}
    check_study(parts[impact.SECTION.title])
    check_table_of_all_methods(parts[real_robots.SECTION.title])
