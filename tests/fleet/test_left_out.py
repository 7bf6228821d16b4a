"""A log that cannot be used stops neither the others of its robot nor the other robots, and is told."""

import json
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


def test_where_no_log_can_be_used_nothing_comes_of_the_robot(place: Path) -> None:
    for number in (1, 2):
        (place / "logs" / f"run{number}.csv").write_text("")
    fleet = identify_fleet(manifest(place, ("A", logs(1, 2)), ("B", logs(3, 4)), ("C", logs(1))))
    assert [row.entry.id for row in fleet.failed] == ["A", "C"]
    assert "run" in fleet.failed[0].reason
    assert fleet.left_out == ()


def test_a_reduction_that_is_damaged_is_left_out_as_well(place: Path) -> None:
    model = sy.Model.load(place / "robot.toml")
    for number in (1, 3):
        sets = [sy.fleet.DataSet(place / "robot.toml", [place / log]) for log in logs(number)]
        [reduced] = sy.fleet.reduce_data_sets(sets)
        reduced.information.save(place / f"{number}.json")
    (place / "2.json").write_text("{")
    path = manifest(place, ("A", ["1.json", "2.json", "3.json"]), ("B", ["1.json", "3.json"]), key="informations")
    fleet = identify_fleet(path)
    np.testing.assert_array_equal(*(row.values["base"] for row in fleet.rows))
    assert [log for _, log, _ in fleet.left_out] == [str(place / "2.json")]
    assert model.dof == 2


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


def test_only_what_came_of_all_logs_is_kept(place: Path) -> None:
    (place / "logs" / "run2.csv").write_text("")
    path = manifest(place, ("A", logs(1, 2, 3)), ("B", logs(4, 5)))
    with Checkpoints(place / "out") as kept:
        identify_fleet(path, checkpoints=kept)
        assert len(kept.names) == 1
