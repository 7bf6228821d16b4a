"""The report says what the data says, and nothing in it comes from elsewhere or goes elsewhere."""

import base64
import importlib
import zlib
from dataclasses import replace
from pathlib import Path

import lxml.html
import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from steelyard.errors import InputError
from steelyard.identification import Identification
from steelyard.report import report_html, write_report

from .conftest import JOINTS, LINKS, LOGS, Reference, rows


@pytest.fixture(scope="module")
def text(identification: Identification) -> str:
    return report_html(identification)


@pytest.fixture(scope="module")
def page(text: str) -> lxml.html.HtmlElement:
    return lxml.html.fromstring(text)


def answer(identification: Identification) -> dict[str, float]:
    values = identification.estimate.parameters
    assert values is not None
    return dict(zip(identification.estimate.parameter_names, values.tolist(), strict=True))


@pytest.mark.parametrize("log", [0, 1])
def test_errors_are_those_of_plain_numpy(
    page: lxml.html.HtmlElement, identification: Identification, reference: Reference, log: int
) -> None:
    found = answer(identification)
    names = ("Lzz1", "lx1", "ly1", "m2", "Lzz2", "lx2", "ly2", "Fvj1", "Fcj1", "Fvj2", "Fcj2")
    feasible = reference.errors(log, np.array([found[name] for name in names]))
    table = rows(page, f"errors-{log}")
    assert [row[0] for row in table] == [*JOINTS, "All joints"]
    assert [float(row[1]) for row in table] == pytest.approx(reference.errors(log, reference.parameters), abs=0.0051)
    assert [float(row[2]) for row in table] == pytest.approx(feasible, abs=0.0051)
    caption = page.get_element_by_id(f"errors-{log}-caption").text_content()
    assert caption == f"{('Identification', 'Validation')[log]}: {LOGS[log]}, {2 * len(reference.torques[log])} rows"


def test_violation_is_the_negative_friction(page: lxml.html.HtmlElement, reference: Reference) -> None:
    ((condition, _, amount, _),) = rows(page, "violations")
    assert JOINTS[1] in condition
    assert float(amount) == pytest.approx(-reference.parameters[-1], rel=6e-3)


def test_first_screen_gives_verdicts_and_figures(
    page: lxml.html.HtmlElement, identification: Identification, reference: Reference
) -> None:
    verdicts = [p.text_content().split()[-1] for p in page.find_class("verdict")]
    assert verdicts == ["Feasible", "Good", "Infeasible"]
    assert page.find_class("lead")[0].text_content() == identification.headline
    figures = {dt.text_content(): dt.getnext().text_content() for dt in page.iter("dt")}
    assert float(figures["Error of the prediction"].split()[0]) == pytest.approx(
        100 * identification.prediction.relative_error, abs=0.0051
    )
    for log, title in enumerate(("Relative error, identification", f"Relative error, validation on {LOGS[1]}")):
        assert f"{reference.errors(log, reference.parameters)[2]:.2f}" in figures[title]
    found = answer(identification)
    assert float(figures["Total mass"].split()[0]) == pytest.approx(found["m1"] + found["m2"], rel=1e-3)
    singular = np.linalg.svd(reference.regressors[0].reshape(-1, 11), compute_uv=False)
    assert np.sum(singular > 1e-9 * singular[0]) == 10  # of the eleven, the mass of link 2 shows in no other way
    assert figures["Condition number"].endswith("the 10 base parameters")


def test_condition_number_is_that_of_the_base_regressor(page: lxml.html.HtmlElement, reference: Reference) -> None:
    base = np.delete(reference.regressors[0], 3, axis=2).reshape(-1, 10)  # without m2: columns Lzz1 and lx1 carry it
    figures = {dt.text_content(): dt.getnext().text_content() for dt in page.iter("dt")}
    shown = float(figures["Condition number"].split("how")[0])
    assert shown == pytest.approx(np.linalg.cond(base), rel=2e-3)


def test_links_follow_from_the_parameters(page: lxml.html.HtmlElement, identification: Identification) -> None:
    found = answer(identification)
    masses, centers, moments = (rows(page, identifier) for identifier in ("masses", "centers", "moments"))
    for number, name in enumerate(LINKS, start=1):
        mass, first = found[f"m{number}"], np.array([found[f"l{axis}{number}"] for axis in "xyz"])
        x, y, z = first / mass
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        tensor = np.array([[found[f"L{''.join(sorted(i + j))}{number}"] for j in "xyz"] for i in "xyz"])
        about_center = np.linalg.eigvalsh(tensor - mass * cross @ cross.T)
        assert masses[number - 1][0] == name
        assert float(masses[number - 1][1]) == pytest.approx(mass, rel=5e-4)
        its = slice(3 * number - 3, 3 * number)
        assert [float(row[1]) for row in centers[its]] == pytest.approx([x, y, z], abs=5.1e-5)
        assert [float(row[1]) for row in moments[its]] == pytest.approx(about_center, rel=6e-3)
    assert float(masses[-1][1]) == pytest.approx(found["m1"] + found["m2"], rel=5e-4)


def test_base_parameters_and_weak_ones(identification: Identification) -> None:
    deviation = identification.unconstrained.standard_error.copy()
    deviation[1] = np.inf
    changed = replace(
        identification,
        unconstrained=replace(identification.unconstrained, standard_error=deviation),
        weak=(identification.unconstrained.base_expressions[1], identification.unconstrained.base_expressions[4]),
    )
    page = lxml.html.fromstring(report_html(changed))
    table = rows(page, "base-parameters")
    assert [float(row[1]) for row in table] == pytest.approx(identification.unconstrained.base, abs=5.1e-6, rel=5e-3)
    assert [float(row[3]) for row in table] == pytest.approx(identification.estimate.base, abs=5.1e-6, rel=5e-3)
    assert table[1][0].endswith("unidentifiable")
    assert table[1][2] == "∞"
    assert table[4][0].endswith("weak")
    assert [
        index for index, row in enumerate(page.get_element_by_id("base-parameters").iter("tr")) if row.get("class")
    ] == [
        2,
        5,
    ]


def test_friction(page: lxml.html.HtmlElement, identification: Identification) -> None:
    found = answer(identification)
    for number, row in enumerate(rows(page, "friction"), start=1):
        assert row[0] == JOINTS[number - 1]
        assert float(row[1]) == pytest.approx(found[f"Fvj{number}"], abs=5.1e-6)
        assert float(row[3]) == pytest.approx(found[f"Fcj{number}"], abs=5.1e-6)
        assert (row[2], row[4]) == ("N·m·s/rad", "N·m")


def test_names_stay_text(page: lxml.html.HtmlElement, text: str) -> None:
    scripts = list(page.iter("script"))
    assert {script.get("type") for script in scripts} == {"application/json", "text/plain", None}
    assert not any("alert(" in (script.text or "") for script in scripts if script.get("type") != "application/json")
    assert "<script>alert" not in text
    assert not list(page.iter("img", "b", "i"))
    assert not [name for element in page.iter() for name, _ in element.items() if name.startswith("on")]
    assert page.find(".//h1").text == "arm\\x1b[2J\\u202e <script>alert(3)</script>"
    assert not {"\x1b", "\u202e"} & set(text)


def test_plotly_is_in_the_page_compressed(page: lxml.html.HtmlElement, text: str) -> None:
    (script,) = page.xpath("//script[@id='plotly']")
    assert zlib.decompress(base64.b64decode(script.text)).decode() == get_plotlyjs()
    assert len(text.encode()) < 3e6


def test_plotly_is_compressed_once_a_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("STEELYARD_CACHE_DIR", str(tmp_path))
    module = importlib.import_module("steelyard.report.html_document")
    make = module._compressed_plotly.__wrapped__
    made = make()
    monkeypatch.delattr(module, "compressed")
    assert make() == made
    for file in tmp_path.iterdir():
        file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(NameError):  # what is damaged is made anew
        make()


def test_nothing_is_loaded_from_elsewhere(page: lxml.html.HtmlElement) -> None:
    references = [
        value for element in page.iter() for key, value in element.items() if key in ("src", "href", "srcset")
    ]
    assert references
    assert all(value.startswith("#") or value == "data:," for value in references)
    (style,) = page.iter("style")
    assert "url(" not in style.text
    assert "@import" not in style.text
    policy = page.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")[0]
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy


def test_every_reference_inside_the_page_resolves(page: lxml.html.HtmlElement) -> None:
    identifiers = page.xpath("//@id")
    assert len(identifiers) == len(set(identifiers))
    wanted = [value[1:] for value in page.xpath("//a/@href")]
    wanted += [one for value in page.xpath("//@aria-labelledby") for one in value.split()]
    assert set(wanted) <= set(identifiers)
    levels = [int(heading.tag[1]) for heading in page.iter("h1", "h2", "h3")]
    assert levels.count(1) == 1
    assert all(table.find("caption") is not None for table in page.iter("table"))


def test_same_input_gives_the_same_bytes(identification: Identification, text: str, tmp_path: Path) -> None:
    write_report(identification, tmp_path / "report.html")
    assert (tmp_path / "report.html").read_bytes() == text.encode()
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_feasible_least_squares_is_said_to_be_so(identification: Identification) -> None:
    verdict = replace(identification.verdict, feasible=True, status="feasible", violations=(), certificate=None)
    page = lxml.html.fromstring(report_html(replace(identification, verdict=verdict)))
    assert [p.text_content().split()[-1] for p in page.find_class("verdict")] == ["Feasible", "Good", "Feasible"]
    assert not page.xpath("//*[@id='violations']")


def test_an_answer_that_fails_the_check_is_not_called_feasible(identification: Identification) -> None:
    estimate = identification.estimate
    assert estimate.parameters is not None
    wrong = replace(identification, estimate=replace(estimate, parameters=-estimate.parameters))
    page = lxml.html.fromstring(report_html(wrong))
    assert [p.text_content().split()[-1] for p in page.find_class("verdict")] == ["Undecided", "Good", "Infeasible"]
    assert page.find_class("lead")[0].text_content().startswith("The answer is not proved to be possible, but ")


def test_a_place_that_cannot_be_written(identification: Identification, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_report(identification, tmp_path / "missing" / "report.html")
