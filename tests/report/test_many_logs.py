"""Thousands of logs: what is shown stays as much as can be read, and the numbers are those of all of them."""

import re
from dataclasses import replace

import numpy as np
import pytest

from steelyard import least_squares
from steelyard.cli import terminal
from steelyard.identification import identify
from steelyard.regression.batch_means import BATCH_LENGTHS
from steelyard.report import report_html
from steelyard.report.extent import MOST_LOGS, MOST_REMARKS, gathered, shown_logs

COUNT = 2000


@pytest.fixture(scope="module")
def many(identification):
    """The demonstration as if its log were one of two thousand, each with an error and remarks of its own."""
    first, validation = identification.predictions
    rng = np.random.default_rng(5)
    errors = first.feasible_error * rng.uniform(0.5, 2.0, COUNT)
    names = tuple(f"day{k // 100}/log{k:04d}.csv" for k in range(COUNT))
    predictions = [replace(first, name=name, feasible_error=e) for name, e in zip(names, errors, strict=True)]
    predictions.append(validation)
    remarks = [f"{name}: Jitters." for name in names] + [
        f"{name}: Late by {e} s." for name, e in zip(names, errors, strict=True)
    ]
    return replace(identification, predictions=tuple(predictions), logs=names, remarks=tuple(remarks)), errors


@pytest.mark.slow
def test_the_report_is_bounded(many, identification):
    result, errors = many
    text = report_html(result)
    assert len(text.encode()) < 3_000_000
    assert len(set(re.findall(r'id="errors-(\d+)"', text))) == MOST_LOGS + 1
    worst = np.argsort(-errors)[:5]
    for index in worst:
        assert f"log{index:04d}.csv" in text
    assert f"Of {COUNT + 1} logs {MOST_LOGS + 1} are shown" in text
    assert "The 500 logs of the largest errors" in text


def test_the_terminal_is_bounded(many, capsys):
    terminal.show_identification(many[0])
    assert len(capsys.readouterr().out.splitlines()) < 40
    terminal.show_identification(many[0], verbose=True)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 140
    assert (
        sum(bool(re.search(r"  (identification|validation) +[\d.]+% +[\d.]+%", line)) for line in lines)
        == MOST_LOGS + 1
    )
    notes = [line for line in lines if line.startswith("Note: ")]
    assert len(notes) == MOST_REMARKS
    assert any(line == "Note: day0/log0000.csv, day0/log0001.csv and 1998 more: Jitters." for line in notes)
    assert re.fullmatch(r"Note: There are \d+ more remarks; run.json holds all of them.", notes[-1])


def test_the_first_and_the_worst_are_shown(many):
    result, errors = many
    shown = shown_logs(result)
    assert shown[0] == 0
    assert set(shown[1:-1]) == set(np.argsort(-errors[1:])[: MOST_LOGS - 1] + 1)
    assert shown[-1] == COUNT  # the validation


def test_few_logs_are_shown_whole(identification):
    assert shown_logs(identification) == [0, 1]
    assert "logs are shown" not in report_html(identification)
    assert gathered(["b: x", "a: y", "b: x", "z: x"], ["a", "b"]) == ("b: x", "a: y", "z: x")


@pytest.mark.slow
def test_many_logs_keep_little_and_give_what_each_gives(folder):
    """Per log neither block factors nor long traces are kept; the intervals are those of the sum."""
    robot, names = folder / "stated.toml", sorted(path for path in folder.glob("*.csv"))
    # What the data decides is decided by all logs together, and so is not that of each.
    robot.write_text((folder / "robot.toml").read_text() + 'trim = 0\nvelocity_threshold = "none"\n')
    said = []
    result = identify(robot, [*names * 30], progress=said.append)
    assert sum(text.startswith("reading") for text in said) <= 30
    assert len(result.predictions[0].trace.t) == 1500
    assert sum(len(p.trace.t) for p in result.predictions) <= 120_000
    assert all(p.samples.count <= 2 * 24_000 / 60 for p in result.predictions[1:])
    assert len(result.information.batch_means) == len(BATCH_LENGTHS)
    parts = [identify(robot, [name]).information for name in names] * 30
    expected = parts[0]
    for part in parts[1:]:
        expected = expected + part
    np.testing.assert_allclose(result.information.reduced().R, expected.reduced().R, rtol=1e-8, atol=1e-8)
    # Thirty copies of two logs tell no more than these, which only all together show.
    alone = replace(result.information, returning=())
    ours, theirs, copies = (least_squares(one).standard_error for one in (alone, expected, result.information))
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    assert np.all(copies > 1.5 * theirs)
