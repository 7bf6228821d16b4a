"""What the terminal says of an identification: both verdicts first, what numbers rest on, and never more than a screen
or two."""

import re
from dataclasses import replace

import lxml.html
import numpy as np
import pytest

import steelyard as sy
from steelyard.cli import terminal
from steelyard.identification import Hypothesis, Identification, identify
from steelyard.identification.parameter_table import ParameterRow, ParameterTable
from steelyard.recording.correction import Correction
from steelyard.report import report_html

LINKS = ("upper", "fore")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Identification:
    """Two links in a vertical plane, with CAD, whose torques Newton's laws give."""
    folder = tmp_path_factory.mktemp("terminal")
    inertial = (
        '<inertial><origin xyz="0.25 0 0"/><mass value="{}"/>'
        '<inertia ixx="0.01" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    links = "".join(
        f'<link name="{name}">{inertial.format(mass)}</link>' for name, mass in zip(LINKS, (4, 3), strict=True)
    )
    joints = "".join(
        f'<joint name="j{k}" type="continuous"><parent link="{("base", *LINKS)[k]}"/><child link="{LINKS[k]}"/>'
        f'<origin xyz="{0.5 * k} 0 0"/><axis xyz="0 1 0"/></joint>'
        for k in range(2)
    )
    robot = folder / "arm.urdf"
    robot.write_text(f'<robot name="arm"><link name="base"/>{links}{joints}</robot>')
    t = np.arange(2000) / 100
    q = np.stack([np.sin(1.3 * t) + 0.4 * np.sin(3.1 * t), np.sin(2.2 * t + 1) + 0.3 * np.sin(4.3 * t)], axis=1)
    dq, ddq = (np.gradient(q, t, axis=0), np.gradient(np.gradient(q, t, axis=0), t, axis=0))
    model = sy.Model(sy.Robot.from_urdf(robot))
    truth = np.nan_to_num(np.asarray(model.robot.parameters))
    torque = model.inverse_dynamics(q, dq, ddq, truth) + np.random.default_rng(3).normal(0, 0.05, q.shape)
    sy.Recording(t=t, q=q, torque=torque, source="log").save(folder / "log.csv")
    return identify(robot, [folder / "log.csv"])


def shown(result: Identification, capsys: pytest.CaptureFixture[str], **options: bool) -> str:
    terminal.show_identification(result, **options)
    return capsys.readouterr().out


@pytest.mark.slow
def test_both_verdicts_come_first(result: Identification, capsys: pytest.CaptureFixture[str]) -> None:
    first = shown(result, capsys).splitlines()[0]
    assert first == f"arm: {result.headline}"
    assert "The answer can exist and predicts well" in first
    error = result.prediction.relative_error
    assert f"{error:.1%} error" in first


def test_noise_is_told_beside_the_error(result: Identification) -> None:
    # Noise of 0.05 N·m on both joints, and torques of known size.
    torque = np.hypot(*(np.sqrt(f.norm2 / f.count) for f in result.information.measured))
    assert result.prediction.relative_noise == pytest.approx(0.05 * np.sqrt(2) / torque, rel=0.1)


@pytest.mark.parametrize("word", ["poor", "wrong"])
def test_poor_predictions_are_not_joined_by_and(result: Identification, word) -> None:
    changed = replace(result, prediction=replace(result.prediction, word=word))
    assert re.match(r"The answer can exist, but (predicts poorly|does not predict this robot): ", changed.headline)


def test_answer_that_is_not_possible_is_not_said_to_exist(result: Identification) -> None:
    estimate = result.estimate
    assert estimate.parameters is not None
    changed = replace(result, estimate=replace(estimate, parameters=-estimate.parameters))
    assert changed.possible is False
    assert changed.headline.startswith("The answer is not proved to be possible, but it predicts well")


def test_what_is_probably_wrong_follows_the_verdicts(
    result: Identification, capsys: pytest.CaptureFixture[str]
) -> None:
    words = {"kind": "torque sign", "statement": "The sign of j1 looks wrong", "evidence": "the error falls"}
    numbers = {"gain": 50.0, "error_before": 0.5, "error_after": 0.05, "joint": "j1"}
    probable = Hypothesis(**words, **numbers, correction=Correction(), settings={"log": {"torque_sign": [-1, 1]}})
    log = result.logs[0]
    changed = replace(result, mistakes={log: (probable,)})
    (told,) = changed.mistake_sentences
    changed = replace(changed, remarks=(*result.remarks, told))
    lines = shown(changed, capsys).splitlines()
    assert "The sign of j1 looks wrong" in told
    (step,) = (line for line in lines if line.startswith("1. Mend robot.toml"))
    assert "The sign of j1 looks wrong" in step
    assert shown(changed, capsys, verbose=True).splitlines().count(told) == 1
    assert sum("The sign of j1" in line for line in lines) == 1
    page = lxml.html.fromstring(report_html(changed))
    assert "The sign of j1 looks wrong" in page.find_class("steps")[0][0].text_content()
    assert page.text_content().count("The sign of j1") == 1
    assert "The sign of j1" in changed._repr_html_()


def test_links_have_interval_cad_and_basis(result: Identification, capsys: pytest.CaptureFixture[str]) -> None:
    text = shown(result, capsys, verbose=True)
    table = result.parameters
    assert table is not None
    (line,) = (line for line in text.splitlines() if line.startswith("  fore "))
    cells = line.split()
    row = table["m2"]
    assert cells[1:6] == [f"{row.value:.4g}", f"{row.lower:.4g}", f"{row.upper:.4g}", "3", row.basis]
    assert [float(cell.strip(",")) for cell in cells[6:9]] == pytest.approx([0.25, 0, 0], abs=0.03)
    assert f"{table.count('measured')} are measured" in text


def test_whole_table_only_when_asked(result: Identification, capsys: pytest.CaptureFixture[str]) -> None:
    assert "Lxx1" not in shown(result, capsys).split("Of these")[0]
    whole = shown(result, capsys, whole_table=True)
    assert result.parameters is not None
    for row in result.parameters:
        assert re.search(rf"^{re.escape(row.name)} ", whole, re.MULTILINE)


def test_without_intervals_prior_or_standard_parameters(
    result: Identification, capsys: pytest.CaptureFixture[str]
) -> None:
    table = result.parameters
    assert table is not None
    rows = tuple(replace(row, lower=np.nan, upper=np.nan, basis="unknown") for row in table)
    blind = replace(result, parameters=ParameterTable(rows), plausible=None)
    text = shown(blind, capsys)
    assert "nan" not in text
    assert "rests on" not in text
    assert "has an interval" in text
    nothing = replace(result, parameters=None, plausible=None, estimate=replace(result.estimate, parameters=None))
    text = shown(nothing, capsys, whole_table=True)
    assert "no link can be checked" in text.splitlines()[0]
    assert "mass kg" not in text


def test_many_links_and_joints_stay_on_a_screen_or_two(
    result: Identification, capsys: pytest.CaptureFixture[str]
) -> None:
    count = 300
    table = result.parameters
    assert table is not None
    rows = [
        replace(table[f"{part}1"], name=f"{part}{link}", meaning=f"mass of link{link}")
        for link in range(1, count + 1)
        for part in ("m", "cx", "cy", "cz", "J1_", "J2_", "J3_")
    ]
    size = np.arange(1.0, count + 1)
    verdict = replace(
        result.prediction,
        joint_names=tuple(f"joint{k}" for k in range(count)),
        joint_relative_error=size / count,
        joint_error=size,
        noise_floor=size,
        whiteness=size,
        units=("N·m",) * count,
    )
    many = replace(result, parameters=ParameterTable((*rows, table["total mass"])), prediction=verdict)
    assert len(shown(many, capsys).splitlines()) < 50
    text = shown(many, capsys, verbose=True)
    assert len(text.splitlines()) < 110
    assert "joint299" in text
    assert "joint10 " not in text
    assert "275 more; parameters.csv has all" in text


def test_notebook_shows_both_verdicts_and_the_links(result: Identification) -> None:
    page = result._repr_html_()
    assert result.headline.split(":")[0] in page
    assert page.count("<table>") == 2
    assert "<td>fore</td>" in page
    hostile = replace(result.prediction, source="<b>log</b>")
    assert "<b>log" not in replace(result, prediction=hostile)._repr_html_()


def test_row_of_a_link_without_mass() -> None:
    names = ("m1", "cx1", "cy1", "cz1", "J1_1", "J2_1", "J3_1")
    row = ParameterRow("", "mass of rod", "kg", float("nan"), -np.inf, np.inf, float("nan"), "assumed")
    table = ParameterTable(tuple(replace(row, name=name) for name in names))
    assert table.link_table()[1] == [("rod", "", "open", "open", "assumed", "-, -, -", "assumed")]
