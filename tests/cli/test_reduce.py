"""``steelyard reduce``: logs become a file of sums, and the files of days add up."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard as sy
from steelyard.recording import Processing, process_chunks


@pytest.fixture
def days(place):
    """Return the folder with a second log, of other rows."""
    rows = (place / "log.csv").read_text().splitlines(keepends=True)
    (place / "second.csv").write_text("".join([rows[0], *rows[len(rows) // 2 :]]))
    return place


def test_days_add_up_to_the_regression_of_all_their_rows(days, run):
    for name in ("log", "second"):
        code, out, _ = run("reduce", days / "robot.toml", days / f"{name}.csv", "-o", days / f"{name}.json", "-q")
        assert code == 0
        assert out.startswith("1 log: ")
        assert len(out.splitlines()) == 1
    code, out, _ = run(
        "reduce", days / "robot.toml", days / "log.json", days / "second.json", "-o", days / "both.json", "--json"
    )
    told = json.loads(out)
    both = sy.Information.load(days / "both.json")
    assert (code, told["rows"], told["not_shown"]) == (0, both.count, [])
    model = sy.Model.load(days / "robot.toml")
    Pb, rows, torques = model.base_parameters().Pb, [], []
    for name in ("log", "second"):
        for samples in process_chunks(days / f"{name}.csv", processing=Processing(cutoff=10.0), joints=2, model=model):
            used = samples.used_rows.ravel()
            rows.append((model.regressor(samples.q, samples.dq, samples.ddq) @ Pb).reshape(-1, Pb.shape[1])[used])
            torques.append(samples.torque.ravel()[used])
    assert sum(map(len, torques)) == both.count
    base = np.linalg.lstsq(np.concatenate(rows), np.concatenate(torques), rcond=None)[0]
    np.testing.assert_allclose(sy.least_squares(both, None).base, base, rtol=1e-8, atol=1e-10)


def test_what_logs_decide_is_told(days, run):
    (days / "robot.toml").write_text((days / "robot.toml").read_text().replace("cutoff = 10.0", ""))
    code, out, _ = run("reduce", days / "robot.toml", days / "log.csv", "-o", days / "log.json")
    assert code == 0
    assert "These logs decided `cutoff`, `velocity_threshold`, and" in out
    assert any("Positions were filtered at" in remark for remark in sy.Information.load(days / "log.json").remarks)


def test_no_log_counts_twice(days, run):
    def reduce(*logs):
        return run("reduce", days / "robot.toml", *(days / one for one in logs), "-o", days / f"{len(logs)}.json", "-q")

    assert reduce("log.csv")[0] == 0
    shutil.copy(days / "1.json", days / "day.json")
    shutil.copy(days / "1.json", days / "copy.json")
    # One name twice is one file, as one log is.
    assert reduce("day.json", "day.json")[1].startswith("1 log: ")
    assert "copy.json: has rows that" in reduce("day.json", "copy.json")[2]
    shutil.copy(days / "log.csv", days / "same.csv")
    assert "same.csv: has rows that" in reduce("day.json", "same.csv")[2]
    assert "same.csv: has rows that" in reduce("log.csv", "same.csv")[2]
    assert "log.csv: has rows that" in reduce("log.csv", "log.csv")[2]
    assert reduce("day.json", "second.csv")[0] == 0
    shutil.copy(days / "2.json", days / "both.json")
    assert "second.csv: has rows that" in reduce("both.json", "second.csv")[2]
    assert len(sy.Information.load(days / "both.json").contents) == 2
    with pytest.raises(sy.InputError, match="would count twice"):
        sy.Information.load(days / "both.json") + sy.Information.load(days / "day.json")
    # The same rows in another form are told by their sums.
    sy.Recording.read(days / "log.csv", joints=2).save(days / "same.parquet")
    assert reduce("day.json", "same.parquet")[0] == 0
    assert "were given twice" in " ".join(sy.Information.load(days / "2.json").remarks)


@pytest.mark.slow
def test_identify_adds_days_to_its_logs(days, run):
    robot = days / "robot.toml"
    assert run("reduce", robot, days / "second.csv", "-o", days / "day.json", "-q")[0] == 0
    for name, beside in (("added", "day.json"), ("read", "second.csv")):
        assert run("identify", robot, days / "log.csv", days / beside, "-o", days / name, "-q")[0] == 0
    added, read = (sy.Estimate.load(days / name) for name in ("added", "read"))
    np.testing.assert_allclose(added.unconstrained_base, read.unconstrained_base, rtol=1e-7, atol=1e-9)
    # Stretches that are left out are others.
    np.testing.assert_allclose(added.base, read.base, rtol=0.02, atol=0.02 * np.abs(read.base).max())
    record = json.loads((days / "added" / "run.json").read_text())
    assert [Path(one["path"]).name for one in record["informations"]] == ["day.json"]
    assert "in the fit, and not looked at" in " ".join(record["remarks"])
    assert f"{days / 'log.csv'} {days / 'day.json'} --" in (days / "added" / "report.html").read_text()
    # What was reduced has been seen, whichever file it comes from.
    told = run("validate", robot, days / "added", days / "second.csv")[1]
    assert told.startswith("No log was predicted")
    assert "The model" not in told  # no word on how well it predicts


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["day.json", "--validate", "day.json"], "wrote is data of a fit"),
        (["day.json", "--validate", "second.csv"], "has rows that"),
        (["log.csv", "day.json", "--friction", "auto"], "holds no rows, which"),
        (["log.csv", "day.json", "--estimator", "momentum"], "holds no rows, which"),
        (["second.csv", "day.json"], "has rows that"),
        (["log.csv", "day.json", "--validate", "second.csv"], "has rows that"),
        (["log.csv", "other.json"], "of another robot or of other terms"),
    ],
)
def test_what_identify_cannot_add_is_one_sentence(days, run, given, told):
    robot = days / "robot.toml"
    assert run("reduce", robot, days / "second.csv", "-o", days / "day.json", "-q")[0] == 0
    sy.Information.empty(sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")]))).save(days / "other.json")
    paths = [days / one if "." in one else one for one in given]
    code, _, err = run("identify", robot, *paths, "-o", days / "result", "-q")
    assert (code, len(err.splitlines())) == (2, 1)
    assert told in err
    assert not (days / "result").exists()


def test_all_that_identify_cannot_add_is_told_at_once(days, run):
    robot = days / "robot.toml"
    for name in ("empty.json", "torn.json"):
        (days / name).write_text("" if name[0] == "e" else '{"kind": "informat')
    for length in (1.0, 2.0):
        alien = sy.Model(sy.Robot.from_dh([(0, length, 0, "q")] * 2))
        sy.Information.empty(alien).save(days / f"alien{length:.0f}.json")
    for names in (("empty.json", "torn.json"), ("alien1.json", "alien2.json")):
        paths = [days / "log.csv", *(days / name for name in names)]
        code, _, err = run("identify", robot, *paths, "-o", days / "result", "-q")
        first, *lines = err.splitlines()
        assert (code, first) == (2, "steelyard: 2 of 2 logs cannot be used; mend them, or leave them out:")
        assert [line.split(":")[0].split()[0] for line in lines] == [str(days / name) for name in names]
    assert not (days / "result").exists()


@pytest.mark.slow
def test_identify_needs_no_rows(days, run):
    rows, robot = (days / "log.csv").read_text().splitlines(keepends=True), days / "robot.toml"
    parts = [f"part{k}" for k in range(3)]
    for k, name in enumerate(parts):
        (days / f"{name}.csv").write_text("".join([rows[0], *rows[1 + k * len(rows) // 3 : (k + 1) * len(rows) // 3]]))
        assert run("reduce", robot, days / f"{name}.csv", "-o", days / f"{name}.json", "-q")[0] == 0
    for name, given, options in (
        ("read", [f"{name}.csv" for name in parts], []),
        ("added", [f"{name}.json" for name in parts], []),
        ("one", ["part0.json"], []),
        ("tried", ["part0.json"], ["--validate", days / "part2.csv"]),
    ):
        assert run("identify", robot, *(days / one for one in given), *options, "-o", days / name, "-q")[0] == 0
    added, read = (sy.Estimate.load(days / name) for name in ("added", "read"))
    np.testing.assert_allclose(added.unconstrained_base, read.unconstrained_base, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(added.base, read.base, rtol=0.02, atol=0.02 * np.abs(read.base).max())
    model, feasible = sy.Model.load(robot), sy.Estimate.load(days / "one").parameters
    assert feasible is not None
    masses = np.array([feasible[columns[9]] for columns in model.link_columns])
    assert (masses > 0.0).all()
    said = {
        name: json.loads((days / name / "run.json").read_text())["prediction"] for name in ("added", "one", "tried")
    }
    assert said["added"]["source"] == "3 stretches of the logs, each left out in turn"
    assert said["one"]["source"] == "the data of the fit itself"
    assert said["tried"]["source"] == "the validation log"
    page = (days / "one" / "report.html").read_text()
    assert "no three stretches of logs, or files of steelyard reduce" in page
    assert "Columns of the logs" not in page
    assert "Columns of the logs" in (days / "tried" / "report.html").read_text()
    with pytest.raises(sy.InputError, match="identify with a log beside them"):
        sy.report.torque_svg(sy.identify(robot, days / "part0.json"))


def test_a_fleet_takes_the_files_in_the_place_of_logs(days, run):
    # Terms that nobody stated: rotors belong to the model, as `fleet` reduces logs.
    (days / "fleet.toml").write_text(
        'robot = "pair.urdf"\n[[robots]]\nid = "A"\nlogs = ["log.csv"]\n'
        '[[robots]]\nid = "B"\ninformations = ["B.json"]\n'
    )
    assert run("reduce", days / "pair.urdf", days / "log.csv", "-o", days / "B.json", "-q")[0] == 0
    code, _, _ = run("fleet", days / "fleet.toml", "-o", days / "result", "--json")
    assert code in (0, 1)
    table = pl.read_parquet(days / "result" / "parameters.parquet").filter(pl.col("kind") == "base")
    first, second = (table.filter(pl.col("robot") == name)["value"].to_numpy() for name in "AB")
    assert len(first) == len(second) > 10
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["log.json", "-o", "log.json"], "would replace it"),
        (["nothing.json", "-o", "x.json"], "correct its path"),
        (["none*.json", "-o", "x.json"], "no file has such a name"),
        (["robot.toml", "-o", "x.json"], "suffix"),
        (["strange.json", "-o", "x.json"], "expected 'steelyard-information-"),
        (["other.json", "-o", "x.json"], "of another robot or of other terms"),
        (["log.csv", "--set", "elastic.joints=['elbow']", "-o", "x.json"], r"table \[elastic\]"),
        (["log.csv", "--set", "log.gain='find'", "-o", "x.json"], "drive gains are to be found"),
    ],
)
def test_what_cannot_be_reduced_or_added_is_one_sentence(days, run, given, told):
    model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")]))
    sy.Information.empty(model).save(days / "other.json")
    (days / "strange.json").write_text('{"format": "something"}')
    assert run("reduce", days / "robot.toml", days / "log.csv", "-o", days / "log.json", "-q")[0] == 0
    paths = [days / one if "." in one and "=" not in one else one for one in given]
    code, _, err = run("reduce", days / "robot.toml", *paths, "-q")
    assert (code, len(err.splitlines())) == (2, 1)
    assert re.search(told, err), err
    assert not (days / "x.json").exists()
