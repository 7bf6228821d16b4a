"""The folder of results holds one run, and what the user put there."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.identification import Identification
from steelyard.report import save_results
from steelyard.report.sections import _again


def without_urdf(identification: Identification) -> Identification:
    robot = replace(identification.model.robot, source=None)
    model = type(identification.model)(robot)
    return replace(identification, model=model)


def test_the_command_that_makes_the_result_again_names_estimator_and_weights(identification: Identification) -> None:
    options = {**identification.options, "weights": "joint"}
    command = _again(replace(identification, robot_file=Path("robot.toml"), options=options))
    assert "--estimator" not in command
    assert "--weights" not in command
    options = {**options, "estimator": "momentum", "weights": None}
    command = _again(replace(identification, robot_file=Path("robot.toml"), options=options))
    assert "--estimator momentum" in command
    assert "--weights none" in command


def test_a_second_run_leaves_no_file_of_the_first(identification: Identification, tmp_path: Path) -> None:
    folder = tmp_path / "results"
    save_results(identification, folder)
    names = {"estimate.json", "parameters.csv", "report.html", "robot.urdf", "run.json"}
    assert {path.name for path in folder.iterdir()} == names
    assert set(json.loads((folder / "run.json").read_text())["files"]) == names
    (folder / "notes.txt").write_text("mine")
    save_results(without_urdf(identification), folder)
    assert {path.name for path in folder.iterdir()} == names - {"robot.urdf"} | {"notes.txt"}
    assert (folder / "notes.txt").read_text() == "mine"


def test_a_robot_of_the_user_stays(identification: Identification, tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text("mine")
    (tmp_path / "run.json").write_text('{"format": "steelyard-run-1", "files": ["notes.txt", 7]}')
    (tmp_path / "notes.txt").write_text("mine")
    save_results(without_urdf(identification), tmp_path)
    assert (tmp_path / "robot.urdf").read_text() == "mine"
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_robot_of_the_user_is_not_replaced(identification: Identification, tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text("mine")
    with pytest.raises(InputError, match=r"robot\.urdf: is no result of an earlier identification"):
        save_results(identification, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["robot.urdf"]
    assert (tmp_path / "robot.urdf").read_text() == "mine"
    (tmp_path / "robot.urdf").unlink()
    for _ in range(2):
        assert tmp_path / "robot.urdf" in save_results(identification, tmp_path)


def test_the_description_itself_is_never_replaced(identification: Identification, tmp_path: Path) -> None:
    source = identification.model.robot.source
    assert source is not None
    text = source.read_bytes()
    mine = tmp_path / "robot.urdf"
    mine.write_bytes(text)
    robot = replace(identification.model.robot, source=mine)
    with pytest.raises(InputError, match=r"robot.urdf: is read, and the results would replace it"):
        save_results(replace(identification, model=type(identification.model)(robot)), tmp_path)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("robot.urdf", text)]


def test_a_description_that_cannot_take_the_estimate_costs_no_other_result(
    identification: Identification, tmp_path: Path
) -> None:
    """As where an estimator of the user found a damping that no joint has."""
    estimate = replace(identification.estimate, damping=-np.ones(identification.model.dof))
    folder = tmp_path / "results"
    with pytest.raises(InputError, match=r"its damping is -1.*; all other results are in"):
        save_results(replace(identification, estimate=estimate), folder)
    names = {"estimate.json", "parameters.csv", "report.html", "run.json"}
    assert {path.name for path in folder.iterdir()} == names
    assert set(json.loads((folder / "run.json").read_text())["files"]) == names


def test_a_failure_leaves_the_results_of_before(
    identification: Identification, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "results"
    save_results(identification, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}

    def fail(*_: object) -> None:
        raise RuntimeError

    monkeypatch.setattr("steelyard.report.results.write_report", fail)
    with pytest.raises(RuntimeError):
        save_results(identification, folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["results"]
