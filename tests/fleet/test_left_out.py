"""A log that cannot be used stops neither the others of its robot nor the other robots, and is told."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard as sy
from steelyard.cli import main
from steelyard.fleet import Checkpoints, identify_fleet

DAMAGES: dict[str, Callable[[str], str]] = {
    "empty": lambda text: "",
    "no text": lambda text: "\x00" * len(text),
    "no torques": lambda text: text.replace("tau1,tau2", "x,y"),
    "no number": lambda text: text.replace(text.splitlines()[300], "nan,nan,nan,nan,nan"),
}


def manifest(place: Path, *robots: tuple[str, list[str]], key: str = "logs") -> Path:
    path = place / "fleet.toml"
    entries = [f'[[robots]]\nid = "{name}"\n{key} = {json.dumps(logs)}\n' for name, logs in robots]
    path.write_text('robot = "robot.toml"\n' + "".join(entries), encoding="utf-8")
    return path


def logs(*numbers: int) -> list[str]:
    return [f"logs/run{number}.csv" for number in numbers]


@pytest.mark.slow
@pytest.mark.parametrize("damage", DAMAGES)
def test_the_estimate_is_that_of_the_other_logs(place: Path, damage: str) -> None:
    damaged = place / "logs" / "run2.csv"
    damaged.write_text(DAMAGES[damage](damaged.read_text()))
    fleet = identify_fleet(manifest(place, ("A", logs(1, 2, 3)), ("B", logs(1, 3))))
    assert not fleet.failed
    of_all, of_others = (row.values for row in fleet.rows)
    np.testing.assert_array_equal(of_all["base"], of_others["base"])
    [(row, log, reason)] = fleet.left_out
    assert row.entry.id == "A"
    assert log.endswith("run2.csv")
    assert "run2.csv" in reason
    assert any("run2.csv was left out: " in remark for remark in of_all["remarks"])
    assert "1 log was left out that cannot be used" in fleet.headline
    assert reason[:30] in str(fleet)


NO_FILES: dict[str, Callable[[Path], object]] = {
    "pipe": lambda path: os.mkfifo(path),
    "link to itself": lambda path: path.symlink_to(path),
    "folder without logs": Path.mkdir,
}


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
@pytest.mark.parametrize("kind", NO_FILES)
def test_what_is_no_file_is_left_out_whether_results_are_kept_or_not(place: Path, kind: str) -> None:
    odd = place / "logs" / "run2.csv"
    odd.unlink()
    NO_FILES[kind](odd)
    path = manifest(place, ("A", logs(1, 2, 3)), ("B", logs(1, 3)))
    with Checkpoints(place / "out") as kept:
        fleets = [identify_fleet(path), identify_fleet(path, checkpoints=kept), identify_fleet(path, checkpoints=kept)]
    for fleet in fleets:
        assert not fleet.failed
        np.testing.assert_array_equal(*(row.values["base"] for row in fleet.rows))
        assert [log for _, log, _ in fleet.left_out] == [str(odd)]


@pytest.mark.slow
@pytest.mark.parametrize("motion", [True, False])
def test_a_log_that_is_left_out_chooses_no_filter(place: Path, motion: bool) -> None:
    """That nothing drives a joint, or that none moves, is known only after the filter was chosen by all logs."""
    path = place / "logs" / "run2.csv"
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    table[:, [3, 4] if motion else [1, 2]] = 1.0
    np.savetxt(path, table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
    fleet = identify_fleet(manifest(place, ("A", logs(1, 2, 3)), ("B", logs(1, 3))))
    of_all, of_others = (row.values for row in fleet.rows)
    assert of_all["rows"] == of_others["rows"]
    for name in ("base", "parameters"):
        np.testing.assert_array_equal(of_all[name], of_others[name])


def test_where_no_log_can_be_used_nothing_comes_of_the_robot(place: Path) -> None:
    for number in (1, 2):
        (place / "logs" / f"run{number}.csv").write_text("")
    fleet = identify_fleet(manifest(place, ("A", logs(1, 2)), ("B", logs(3, 4)), ("C", logs(1))))
    assert [row.entry.id for row in fleet.failed] == ["A", "C"]
    assert "run" in fleet.failed[0].reason
    assert fleet.left_out == ()


@pytest.mark.slow
def test_a_reduction_that_is_damaged_or_of_another_robot_is_left_out_as_well(place: Path) -> None:
    for number in (1, 3):
        sets = [sy.fleet.DataSet(place / "robot.toml", [place / log]) for log in logs(number)]
        [reduced] = sy.fleet.reduce_data_sets(sets)
        reduced.information.save(place / f"{number}.json")
    other = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")]))
    motion = np.random.default_rng(0).normal(size=(9, 1))
    of_another = sy.Information.from_samples(other, sy.Samples(q=motion, dq=motion, ddq=motion, torque=motion))
    for damage in (lambda: (place / "2.json").write_text("{"), lambda: of_another.save(place / "2.json")):
        damage()
        for names in (["1.json", "2.json", "3.json"], ["2.json", "1.json", "3.json"]):
            path = manifest(place, ("A", names), ("B", ["1.json", "3.json"]), key="informations")
            fleet = identify_fleet(path)
            np.testing.assert_array_equal(*(row.values["base"] for row in fleet.rows))
            assert [log for _, log, _ in fleet.left_out] == [str(place / "2.json")]


@pytest.mark.slow
def test_the_more_informations_decide_whether_the_model_has_rotors(place: Path) -> None:
    """The first one did: it kept out two others, and its robot from its siblings."""
    for number, rotors in ((1, False), (2, True), (3, True), (4, False)):
        data = sy.fleet.DataSet(place / "robot.toml", [place / "logs" / f"run{number}.csv"], rotors=rotors)
        next(sy.fleet.reduce_data_sets([data])).information.save(place / f"{number}.json")
    robots = {"A": [1, 2, 3], "B": [2, 3], "C": [1, 2, 4], "D": [1, 4], "E": [1, 2], "F": [2]}
    given = [(name, [f"{number}.json" for number in numbers]) for name, numbers in robots.items()]
    fleet = identify_fleet(manifest(place, *given, key="informations"))
    for several, alone in ((0, 1), (2, 3), (4, 5)):
        np.testing.assert_array_equal(*(fleet.rows[k].values["base"] for k in (several, alone)))
    assert [(row.entry.id, Path(log).stem) for row, log, _ in fleet.left_out] == [("A", "1"), ("C", "2"), ("E", "1")]


@pytest.mark.slow
def test_the_command_tells_it_and_tries_again(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged = place / "logs" / "run2.csv"
    whole = damaged.read_text()
    damaged.write_text("")
    path = manifest(place, ("A", logs(1, 2, 3)), ("B", logs(4, 5)))

    def run() -> int:
        monkeypatch.setattr("sys.argv", ["steelyard", "fleet", str(path), "--output", str(place / "out")])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0)

    assert run() == 3
    assert "a log was left out, because" in capsys.readouterr().out
    [told] = json.loads((place / "out" / "fleet.json").read_text())["left_out"]
    assert told["robot"] == "A"
    assert told["reason"]
    assert "Logs that were left out" in (place / "out" / "fleet.html").read_text()
    assert pl.read_parquet(place / "out" / "robots.parquet")["left_out"].to_list() == [1, 0]
    damaged.write_text(whole)
    assert run() in (0, 1)
    assert json.loads((place / "out" / "fleet.json").read_text())["left_out"] == []


@pytest.mark.slow
def test_only_what_came_of_all_logs_is_kept(place: Path) -> None:
    (place / "logs" / "run2.csv").write_text("")
    path = manifest(place, ("A", logs(1, 2, 3)), ("B", logs(4, 5)))
    with Checkpoints(place / "out") as kept:
        identify_fleet(path, checkpoints=kept)
        assert len(kept.names) == 1
