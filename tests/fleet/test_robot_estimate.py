"""What paths of a manifest stand for."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steelyard.fleet import Checkpoints, DataSet, Fleet, Here, identify_fleet, reduce_data_sets
from steelyard.recording.formats import hashes, log_sets


def fleet_of(place: Path, *, kept: Checkpoints | None = None, **lists: list[str]) -> Fleet:
    path = place / "fleet.toml"
    keys = "".join(f"{key} = {json.dumps(value)}\n" for key, value in lists.items())
    path.write_text(f'robot = "robot.toml"\n[[robots]]\nid = "A"\n{keys}', encoding="utf-8")
    return identify_fleet(path, checkpoints=kept)


@pytest.mark.slow
def test_a_store_is_asked_once_what_a_pattern_stands_for(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And what two patterns find counts once."""
    system = pytest.importorskip("fsspec").filesystem("memory")
    asked: Counter[str] = Counter()
    for number in (1, 2, 3):
        system.pipe(f"/A/run{number}.csv", (place / "logs" / f"run{number}.csv").read_bytes())
    found_in = log_sets._objects_in

    def counted(text: str, *others: Any) -> Any:
        asked[text] += 1
        return found_in(text, *others)

    monkeypatch.setattr(log_sets, "_objects_in", counted)
    patterns = ["memory://A/run[12].csv", "memory://A/run[23].csv", "memory://B/*.csv"]
    with Checkpoints(place / "out") as kept:
        [row] = fleet_of(place, kept=kept, logs=patterns).rows
    assert asked == dict.fromkeys(patterns, 1)
    assert "memory://B/*.csv" in row.values["left_out"]
    [local] = fleet_of(place, logs=["logs/run[123].csv"]).rows
    np.testing.assert_array_equal(row.values["base"], local.values["base"])


@pytest.mark.slow
def test_validation_is_of_folders_and_patterns_as_logs_are(place: Path) -> None:
    (place / "checks").mkdir()
    for number in (4, 5):
        (place / "logs" / f"run{number}.csv").rename(place / "checks" / f"run{number}.csv")
    given = (["checks/run4.csv", "checks/run5.csv"], ["checks"], ["checks/*.csv"])
    rows = [fleet_of(place, logs=["logs"], validate=one).rows[0] for one in given]
    assert not any(row.reason for row in rows)
    assert len({row.values["model_error"] for row in rows}) == 1
    assert rows[0].values["source"] != fleet_of(place, logs=["logs"]).rows[0].values["source"]
    assert "stands for no log" in fleet_of(place, logs=["logs"], validate=["checks/*.parquet"]).rows[0].reason


def test_logs_are_hashed_once_and_where_they_are_read(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process that asks a cluster read each log to hash it, and the worker hashed it once more when it was done."""
    read: list[str] = []
    away: list[bool] = []
    hashed = hashes.file_hash

    def counted(path: Path, **options: str) -> str:
        assert away
        read.append(path.name)
        return hashed(path, **options)

    class Elsewhere(Here):
        def run(self, leaf: Any, combine: Any, common: Any, groups: Any) -> Any:
            for number, group in enumerate(groups):
                away.append(True)
                done = combine(common, [leaf(common, task) for task in group])
                away.clear()
                yield number, done

    monkeypatch.setattr(hashes, "file_hash", counted)
    with Checkpoints(place / "out") as kept:
        path = place / "fleet.toml"
        path.write_text('robot = "robot.toml"\n[[robots]]\nid = "A"\nlogs = ["logs"]\n', encoding="utf-8")
        fleet = identify_fleet(path, executor=Elsewhere(), checkpoints=kept)
    assert not fleet.failed
    assert sorted(read) == [f"run{number}.csv" for number in range(1, 6)]


@pytest.mark.slow
def test_a_log_whose_time_is_in_another_unit_is_told_beside_what_differs(place: Path) -> None:
    """Of a log at 5 kHz, whose stamps are milliseconds, the friction was 900 times that of siblings, and no more."""
    t = np.arange(20_000) / 5000.0
    rates = np.array([2.1, 3.4])
    phase = t[:, None] * rates
    q, ddq = np.sin(phase), -(rates**2) * np.sin(phase)
    torque = np.column_stack([0.3 * ddq[:, 0], 0.5 * ddq[:, 1] + 9.81 * np.cos(q[:, 1])])
    for name, unit in (("A", 1.0), ("B", 1000.0)):
        noise = np.random.default_rng(len(name)).normal(0.0, 0.05, q.shape)
        table = np.column_stack([unit * t, q, torque + noise])
        np.savetxt(place / f"{name}.csv", table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
    path = place / "fleet.toml"
    robots = "".join(f'[[robots]]\nid = "{name}"\nlogs = ["{name}.csv"]\n' for name in ("A", "B"))
    path.write_text(f'robot = "robot.toml"\n{robots}', encoding="utf-8")
    fleet = identify_fleet(path)
    assert not fleet.failed
    [told] = [remark for remark in fleet.remarks if "seem to be in other units" in remark]
    assert "the logs of B seem" in told


@pytest.mark.slow
def test_logs_that_share_rows_are_told(place: Path) -> None:
    """By a fleet and by the sums of a day, as `identify` tells it: parts of one recording that overlap."""
    rows = (place / "logs" / "run1.csv").read_text().splitlines(keepends=True)
    for name, first, stop in (("a", 1, 401), ("b", 251, 601), ("c", 401, 601)):
        (place / "logs" / f"part-{name}.csv").write_text("".join([rows[0], *rows[first:stop]]))

    def told(remarks: Sequence[str]) -> list[str]:
        return [remark for remark in remarks if "are rows of" in remark]

    def of_fleet(*parts: str, **options: Any) -> list[str]:
        [row] = fleet_of(place, logs=[f"logs/part-{name}.csv" for name in parts], **options).rows
        return told(row.values["remarks"])

    (remark,) = of_fleet("a", "b")
    assert "part-b.csv: rows from t = 1.2" in remark
    assert "part-a.csv, too, and count twice, so that intervals are too narrow" in remark
    assert of_fleet("a", "c") == []
    (remark,) = of_fleet("a", validate=["logs/part-b.csv"])
    assert "part-a.csv, too, and were used in the fit" in remark
    for names, count in ((("a", "b"), 1), (("a", "c"), 0)):
        logs = [place / "logs" / f"part-{name}.csv" for name in names]
        [reduced] = reduce_data_sets([DataSet(place / "robot.toml", logs)])
        assert len(told(reduced.remarks)) == count


@pytest.mark.slow
def test_what_a_folder_holds_beside_logs_is_told(place: Path) -> None:
    (place / "logs" / "run9.csv.7z").write_bytes(b"7z")
    [row] = fleet_of(place, logs=["logs"]).rows
    [reduced] = reduce_data_sets([DataSet(place / "robot.toml", [place / "logs"])])
    for remarks in (row.values["remarks"], reduced.remarks):
        assert sum("run9.csv.7z was passed over" in remark for remark in remarks) == 1
