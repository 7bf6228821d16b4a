"""A small fleet from its manifest to its tables and its page: planted faults, drift, bad entries, the same bytes."""

from __future__ import annotations

import errno
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from dask_cluster import dask_workers, disturbed

import steelyard as sy
from steelyard.cli import main
from steelyard.fleet import (
    Cause,
    Checkpoints,
    Deviation,
    FleetEntry,
    FleetManifest,
    RobotRow,
    identify_fleet,
    robot_estimate,
)
from steelyard.fleet.checkpoints import checkpoint_key
from steelyard.fleet.executors import Here
from steelyard.fleet.fleet import _history, _since, sentence
from steelyard.report import fleet_html, save_fleet

from .sibling_arms import Arms, Factor

DATES = ("2026-01-01", "2026-04-01", "2026-07-01")


Called = Callable[..., tuple[int, str]]


@pytest.fixture
def arms(tmp_path: Path) -> Arms:
    return Arms(tmp_path)


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Called:
    def run(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["steelyard", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        told = capsys.readouterr()
        return int(ended.value.code or 0), told.out + told.err

    return run


def entries(arms: Arms, number: int, *faults: tuple[str, Factor]) -> list[str]:
    """Save what one robot shows with each of some faults, one date after the other, and return its rows."""
    found = []
    for epoch, (fault, factor) in enumerate(faults):
        path = arms.folder / f"{number}-{epoch}.json"
        arms.information(number, fault, factor, epoch).save(path)
        found.append(f"R{number},{DATES[epoch]},{path.name}")
    return found


@pytest.fixture
def rows(arms: Arms) -> list[str]:
    """Thirty arms: 4 has a worn second joint, 9 a heavy third link, 17 wears out in time; 30 has no file."""
    found = []
    for number in range(30):
        for epoch, date in enumerate(DATES if number < 12 or number == 17 else DATES[-1:]):
            fault = {4: ("joint2", 1.6), 9: ("link3", 1.15)}.get(number, ("", 1.0))
            if number == 17 and epoch:
                fault = ("joint3", 1.0 + 0.35 * epoch)
            arms.information(number, *fault, epoch=epoch).save(arms.folder / f"{number}-{epoch}.json")
            found.append(f"R{number},{date},{number}-{epoch}.json")
    return [*found, "R30,2026-07-01,none.json"]


@pytest.mark.slow
def test_planted_faults_are_found_and_named(arms: Arms, rows: list[str], called: Called) -> None:
    manifest, folder = arms.manifest(rows), arms.folder
    code, said = called("fleet", manifest, "--output", folder / "one", "--quiet")
    assert code == 3, said  # nothing came of one entry
    document = json.loads((folder / "one" / "fleet.json").read_text(encoding="utf-8"))
    assert document["failed"][0]["robot"] == "R30"
    assert "none.json" in document["failed"][0]["reason"]
    parts = {(one["kind"], one["robot"]): one for one in reversed(document["findings"])}
    assert parts["siblings", "R4"]["part"] == "joint2"
    assert parts["siblings", "R9"]["cause"] == "mass of link3"
    assert parts["siblings", "R9"]["change"] == pytest.approx(0.15, rel=0.2)  # its own mass varies by 1 %
    assert "The link link3 is 15 % heavier than that of its siblings" in parts["siblings", "R9"]["sentence"]
    assert parts["siblings", "R17"]["part"] == "joint3"
    assert parts["drift", "R17"]["part"] == "joint3"
    assert parts["drift", "R17"]["since"] == DATES[1]
    assert parts["drift", "R17"]["ratio"] == pytest.approx(1.7, abs=0.1)
    assert {robot for _, robot in parts} == {"R4", "R9", "R17"}

    robots = pl.read_parquet(folder / "one" / "robots.parquet")
    assert robots.height == len(rows)
    assert robots.filter(pl.col("differs"))["robot"].to_list() == ["R4", "R9", "R17"]
    assert robots["possible"].drop_nulls().all()
    table = pl.read_parquet(folder / "one" / "parameters.parquet")
    base = table.filter((pl.col("kind") == "base") & (pl.col("robot") == "R3") & (pl.col("date") == DATES[0]))
    estimate = sy.least_squares(sy.Information.load(folder / "3-0.json"))
    assert np.allclose(base["value"], estimate.base, rtol=1e-9, atol=1e-12)
    assert np.allclose(base["upper"] - base["lower"], 2 * 1.959963984540054 * estimate.standard_error, rtol=1e-6)

    # Two processes, and another order of finishing, change no byte; nor does a run that goes on where one was killed.
    assert called("fleet", manifest, "--output", folder / "two", "--workers", "2", "--quiet")[0] == 3
    (folder / "three").mkdir()
    with Checkpoints(folder / "three") as kept:
        first = replace(FleetManifest.load(manifest), entries=FleetManifest.load(manifest).entries[:20])
        identify_fleet(first, checkpoints=kept)
        assert len(kept.names) == 20
    assert called("fleet", manifest, "--output", folder / "three", "--quiet")[0] == 3
    names = sorted(path.name for path in (folder / "one").iterdir())
    assert names == ["findings.parquet", "fleet.html", "fleet.json", "parameters.parquet", "robots.parquet"]
    for other in ("two", "three"):
        assert sorted(path.name for path in (folder / other).iterdir()) == names
        for name in names:
            assert (folder / other / name).read_bytes() == (folder / "one" / name).read_bytes(), name

    fleet = identify_fleet(manifest)
    many = replace(fleet, rows=fleet.rows * 40)
    assert len(many.rows) > 2000
    assert len(fleet_html(many)) < 250_000
    assert "all-robots" in fleet_html(many)


@pytest.mark.slow
def test_a_fleet_without_siblings_says_so(arms: Arms) -> None:
    for number in range(2):
        arms.information(number).save(arms.folder / f"{number}.json")
    manifest = arms.manifest(["A,2026-01-01,0.json", "B,2026-01-01,1.json"])
    fleet = identify_fleet(manifest)
    assert fleet.headline == "2 robots, of which none has siblings to compare it with."
    assert "siblings are compared where there are 3 or more" in fleet.remarks[0]
    save_fleet(fleet, arms.folder / "result")
    assert pl.read_parquet(arms.folder / "result" / "findings.parquet").height == 0
    assert pl.read_parquet(arms.folder / "result" / "robots.parquet")["differs"].null_count() == 2


@pytest.mark.slow
def test_what_changed_in_all_robots_is_a_part_of_what_was(arms: Arms) -> None:
    """Half of the friction is gone in each: -50 % of what it was, and not -100 %, as of what is left."""
    rows = []
    for number in range(6):
        rows += entries(arms, number, ("joint2", 1.0), ("joint2", 0.5))
    [told] = [one for one in identify_fleet(arms.manifest(rows)).remarks if "on average" in one]
    value, lower, upper = map(float, re.findall(r"([+-][0-9.]+) %", told))
    assert "friction of joint2" in told
    assert lower <= value <= upper
    assert value == pytest.approx(-50.0, abs=4.0)


def test_a_winter_between_the_dates_is_no_part_of_how_a_joint_wore() -> None:
    """Friction that grows evenly to 1.6 times, of a robot whose siblings are 30 % stiffer at two of five dates."""
    rows, several = [], []
    for robot in range(4):
        for place, winter in enumerate((1.0, 1.0, 1.3, 1.0, 1.3)):
            wear = 1.0 + 0.15 * place if robot == 0 else 1.0
            date = f"2025-0{2 * place + 1}-01"
            entry = FleetEntry(f"R{robot}", "", date, Path("robot.toml"))
            rows.append(RobotRow(entry, "", {"base": np.array([wear + winter - 1.0])}))
        several.append(list(range(5 * robot, 5 * robot + 5)))
    friction = Cause("Fc1", "term", "joint1", "Coulomb friction", "N·m", 1.0, np.ones((1, 1)))
    one = Deviation(0, friction, 0.6, 0.05, 0.5, 0.7, 12.0, 1e-20, (), np.ones(1))
    told = _history(rows, several, several[0], one, np.array([0.3]))
    assert [value for _, value in told] == pytest.approx([0.15, 0.3, 0.45, 0.6])
    assert _since(told) == ("2025-05-01", False)
    assert "half of it or more since" in sentence(one, "drift", when="2025-01-01", since="2025-05-01", evenly=True)


@pytest.mark.slow
def test_tables_have_no_number_that_is_none(arms: Arms) -> None:
    """A link as a whole has no size: NaN, which Polars takes for the largest number, is left out."""
    rows = [one for k in range(12) for one in entries(arms, k, ("payload", 3.0) if k == 4 else ("", 1.0))]
    save_fleet(identify_fleet(arms.manifest(rows)), arms.folder / "result")
    found = pl.read_parquet(arms.folder / "result" / "findings.parquet")
    assert found["cause"].to_list() == ["link3"]
    assert found.select("change", "lower", "upper", "ratio").row(0) == (None,) * 4
    beside = pl.read_parquet(arms.folder / "result" / "parameters.parquet").filter(pl.col("kind") == "beside siblings")
    units = dict(beside.select("parameter", "unit").unique().iter_rows())
    assert (units["Fvj1"], units["Fcj2"], units["mass of link3"]) == ("N·m·s/rad", "N·m", "")
    assert units["friction of joint1"] == units["torque gain of all joints"] == ""


@pytest.mark.slow
def test_all_that_changed_in_all_robots_is_told(arms: Arms) -> None:
    """In the warm, viscous friction of three joints is less by 30 %, and Coulomb friction by 16 %: six changes."""
    rows = []
    for number in range(8):
        rows += entries(arms, number, ("warm", 1.0), ("warm", 0.7))
    [told] = [one for one in identify_fleet(arms.manifest(rows)).remarks if "on average" in one]
    number = r"([+-][0-9.]+) %"
    parts = re.findall(rf"the (\w+ friction of \w+) by {number} \({number} to {number}\)", told)
    found = {name: tuple(map(float, numbers)) for name, *numbers in parts}
    assert list(found) == [f"{what} friction of joint{k}" for k in (1, 2, 3) for what in ("viscous", "Coulomb")]
    assert "the friction of" not in told
    for name, (value, lower, upper) in found.items():
        true = -30.0 if name.startswith("viscous") else 100.0 * (0.7**0.5 - 1.0)
        assert lower - 1.0 <= value <= upper + 1.0  # two digits are told
        assert value == pytest.approx(true, abs=4.0)


@pytest.mark.slow
def test_a_robot_that_was_unusual_is_held_against_what_it_was_itself(arms: Arms) -> None:
    """Friction that was twice that of the siblings, and is three times theirs, has grown by a half."""
    rows = []
    for number in range(8):
        before, now = (2.0, 3.0) if number == 5 else (1.0, 1.0)
        rows += entries(arms, number, ("joint2", before), ("joint2", now))
    fleet = identify_fleet(arms.manifest(rows))
    found = {(row["kind"], row["robot"]): row for row in reversed(fleet.finding_rows())}
    assert set(found) == {("siblings", "R5"), ("drift", "R5")}
    assert found["siblings", "R5"]["ratio"] == pytest.approx(3.0, rel=0.15)  # that of each varies by 5 %
    assert found["drift", "R5"]["ratio"] == pytest.approx(1.5, abs=0.1)
    assert " is 1.5" in found["drift", "R5"]["sentence"] or " is 1.4" in found["drift", "R5"]["sentence"]


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "before", "now"), [("joint2", 4.0, 1.0), ("joint3", 4.0, 1.0), ("joint2", 1.0, 4.0)])
def test_a_gearbox_that_was_exchanged_has_less_friction(arms: Arms, fault: str, before: float, now: float) -> None:
    """Three times what siblings have is gone, which a gearbox that was as worn may lose, and no other."""
    rows = []
    for number in range(8):
        factors = (before, now) if number == 5 else (1.0, 1.0)
        rows += entries(arms, number, *((fault, factor) for factor in factors))
    [one] = [one for one in identify_fleet(arms.manifest(rows)).findings if one.kind == "drift"]
    assert (one.robot, one.deviation.cause.name) == ("R5", f"friction of joint{fault[5:]}")
    assert one.ratio == pytest.approx(now / before, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "factor"), [(1, 0.5), (1, 2.0), (2, 2.0), (3, 1.5)])
def test_a_torque_that_reads_right_again_is_told_as_such(arms: Arms, joint: int, factor: float) -> None:
    """One that read twice too much was told as another link, by how it would spread over the links now."""
    rows = []
    for number in range(10):
        rows += entries(arms, number, (f"gain{joint}", factor if number == 5 else 1.0), ("", 1.0))
    [one] = [one for one in identify_fleet(arms.manifest(rows)).findings if one.kind == "drift"]
    assert (one.robot, one.deviation.cause.name) == ("R5", f"torque gain of joint{joint}")
    assert 1.0 + one.deviation.lower < 1.0 / factor < 1.0 + one.deviation.upper
    assert one.ratio == pytest.approx(1.0 / factor, rel=0.03)


@pytest.mark.slow
def test_a_torque_of_another_gain_is_named_in_words(arms: Arms) -> None:
    """One arm has always read 8 % too little at its first joint; of another the second joint reads 10 % less since."""
    sound, low, lower = ("", 1.0), ("gain1", 0.92), ("gain2", 0.9)
    rows = []
    for number in range(12):
        rows += entries(arms, number, *{5: (low, low), 8: (sound, lower)}.get(number, (sound, sound)))
    fleet = identify_fleet(arms.manifest(rows))
    found = {(row["kind"], row["robot"]): row for row in reversed(fleet.finding_rows())}
    assert set(found) == {("siblings", "R5"), ("siblings", "R8"), ("drift", "R8")}
    for (_, robot), row in found.items():
        joint, factor = {"R5": ("joint1", 0.92), "R8": ("joint2", 0.9)}[robot]
        assert (row["cause"], row["part"]) == (f"torque gain of {joint}", joint)
        assert 1.0 + row["lower"] < factor < 1.0 + row["upper"]
        assert row["ratio"] == pytest.approx(factor, abs=0.03)
        assert row["sentence"].startswith(f"The torque measured at {joint} for the same motion is ")
        assert "as with a sensor of another scale or another motor constant" in row["sentence"]
    assert "torque gain of joint3" in fleet_html(fleet)


@pytest.mark.slow
def test_a_torque_that_reads_half_of_what_it_did_has_halved(arms: Arms) -> None:
    """One arm has read 1.4 times too much and now reads half of that; of another the torque reads half since."""
    rows = []
    for number in range(10):
        factors = {3: (1.4, 0.7, 0.7), 6: (1.0, 0.75, 0.5)}.get(number, (1.0, 1.0, 1.0))
        rows += entries(arms, number, *(("gain2", factor) for factor in factors))
    found = {(one.kind, one.robot): one for one in reversed(identify_fleet(arms.manifest(rows)).findings)}
    assert set(found) == {(kind, robot) for kind in ("siblings", "drift") for robot in ("R3", "R6")}
    for (kind, robot), one in found.items():
        factor = 0.7 if (kind, robot) == ("siblings", "R3") else 0.5
        assert one.deviation.cause.name == "torque gain of joint2"
        assert 1.0 + one.deviation.lower < factor < 1.0 + one.deviation.upper
        assert one.deviation.amplitude == pytest.approx(factor - 1.0, abs=0.03)
    assert found["drift", "R3"].ratio == pytest.approx(0.5, abs=0.02)
    assert [value for _, value in found["drift", "R6"].history] == pytest.approx([-0.25, -0.5], abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["gain2", "gains"])
def test_half_of_a_fleet_whose_torques_have_the_other_sign_is_told(fault: str, arms: Arms, called: Called) -> None:
    """Of one joint, or of all: with no majority, nothing was said of them."""
    rows = []
    for number in range(8):
        rows += entries(arms, number, (fault, -1.0 if number % 2 else 1.0))
    code, said = called("fleet", arms.manifest(rows), "--output", arms.folder / "result")
    assert code == 1, said
    turned = ["R1", "R3", "R5", "R7"]
    robots = pl.read_parquet(arms.folder / "result" / "robots.parquet")
    assert robots.filter(pl.col("unexplained"))["robot"].to_list() == turned
    assert robots.filter(pl.col("differs").is_null())["robot"].to_list() == turned
    document = json.loads((arms.folder / "result" / "fleet.json").read_text(encoding="utf-8"))
    assert document["findings"] == []
    [remark] = [one for one in document["remarks"] if "explain the data of" in one]
    assert all(f"{robot} (" in remark for robot in turned)
    page = (arms.folder / "result" / "fleet.html").read_text(encoding="utf-8")
    assert page.count("not explained") == 4  # in the table of all robots
    assert "<dt>Not explained</dt><dd>4" in page


@pytest.mark.slow
@pytest.mark.parametrize(("count", "larger", "factor"), [(12, 6, 1000.0), (3, 2, 1000.0), (4, 2, 0.01)])
def test_torques_of_half_a_fleet_in_another_unit_are_told_by_both(
    count: int, larger: int, factor: float, arms: Arms, called: Called
) -> None:
    """Each unit is as usual as the other: robots varied by as much as from one to the other, and none differed."""
    rows = [
        row for number in range(count) for row in entries(arms, number, ("gains", factor if number < larger else 1))
    ]
    code, said = called("fleet", arms.manifest(rows), "--output", arms.folder / "result")
    assert code == 1, said
    document = json.loads((arms.folder / "result" / "fleet.json").read_text(encoding="utf-8"))
    large, small = (
        [f"R{n} (2026-01-01)" for n in range(count) if ((n < larger) is (factor > 1)) is b] for b in (True, False)
    )
    fewer = large if len(large) <= len(small) else small
    assert document["unexplained"] == fewer
    [remark] = [one for one in document["remarks"] if "torque_unit" in one]
    units = ["mN·m", "N·m"] if factor == 1000.0 else ["N·cm", "N·m"]
    theirs, others = units if fewer is large else units[::-1]
    assert f"entries ({', '.join(fewer)}) are" in remark
    assert f"as where theirs are in {theirs} and those of the others in {others}" in remark
    told = float(re.search(r"are ([\d.]+) times", remark)[1])  # type: ignore[index]
    assert abs(np.log(told)) == pytest.approx(abs(np.log(factor)), abs=0.02)
    assert (told > 1.0) is (fewer is large)


@pytest.mark.slow
def test_torques_of_some_in_other_units_make_no_other_robot_differ(arms: Arms, called: Called) -> None:
    """Of eight, three in mN·m made eight batches of the others, and three in lb·in named what was not different."""
    units = {0: 1000.0, 1: 8.85, 2: 8.85, 3: 8.85}
    rows = [row for number in range(9) for row in entries(arms, number, ("gains", units.get(number, 1.0)))]
    code, said = called("fleet", arms.manifest(rows), "--output", arms.folder / "result")
    assert code == 1, said
    document = json.loads((arms.folder / "result" / "fleet.json").read_text(encoding="utf-8"))
    assert document["findings"] == []
    assert document["unexplained"] == [f"R{number} (2026-01-01)" for number in units]
    told = [float(one) for remark in document["remarks"] for one in re.findall(r"are ([\d.]+) times", remark)]
    assert told == pytest.approx([8.85, 1000.0], rel=0.05)


@pytest.mark.slow
def test_a_fleet_that_the_model_does_not_predict_is_not_said_to_be_sound(arms: Arms, called: Called) -> None:
    """All logs have the other sign at one joint: none differed, and the exit code was 0."""
    rows = [row for number in range(4) for row in entries(arms, number, ("gain2", -1.0))]
    code, said = called("fleet", arms.manifest(rows), "--output", arms.folder / "result", "--quiet")
    assert code == 1
    assert "the model does not predict the torques of 4 of 4 entries" in said
    document = json.loads((arms.folder / "result" / "fleet.json").read_text(encoding="utf-8"))
    assert any("does not predict the torques of 4 of 4 entries: R" in one for one in document["remarks"])
    assert "<dt>Not predicted</dt><dd>4" in (arms.folder / "result" / "fleet.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_what_is_told_beside_the_factor_of_all_torques_says_so(arms: Arms) -> None:
    """Of torques 1.25, 1.43 and 2 times as large that of the first joint was said to be 0.88 times its siblings'."""
    true = np.array([1.25, 1.43, 2.0])
    rows = [row for number in range(12) for row in entries(arms, number, ("gains", true if number == 5 else 1.0))]
    found = {one.deviation.cause.part: one for one in identify_fleet(arms.manifest(rows)).findings}
    assert {one.robot for one in found.values()} == {"R5"}
    whole = found.pop("all joints")
    factors = np.full(3, 1.0 + whole.deviation.amplitude)
    for part, one in found.items():
        factors[int(part.removeprefix("joint")) - 1] *= 1.0 + one.deviation.amplitude
        assert one.sentence.startswith("Beyond that factor of all its torques, the torque measured at joint")
    np.testing.assert_allclose(factors, true, rtol=0.05)
    assert whole.sentence.startswith("The torque measured at all joints")


@pytest.mark.slow
def test_a_log_that_no_robot_of_this_kind_made_is_not_told_as_a_worn_one(arms: Arms, called: Called) -> None:
    """One log is in degrees, one has its joints in reverse order: neither is a link that lost all its mass or more."""
    t = np.arange(0.0, 20.0, 0.01)[:, None]
    for number in range(8):
        random = np.random.default_rng([number, 7])
        w, phase = 2 * np.pi * np.array([0.2, 0.31, 0.43]), random.uniform(0.0, 6.0, 3)
        q = np.sin(w * t + phase)
        values = arms.usual * (1.0 + 0.01 * random.normal(size=len(arms.usual)))
        torque = arms.model.inverse_dynamics(q, w * np.cos(w * t + phase), -(w**2) * q, values)
        torque += 0.2 * random.normal(size=q.shape)
        q, torque = {6: (np.degrees(q), torque), 7: (q[:, ::-1], torque[:, ::-1])}.get(number, (q, torque))
        header = "t,q1,q2,q3,tau1,tau2,tau3"
        table = np.hstack([t, q, torque])
        np.savetxt(arms.folder / f"{number}.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    manifest = arms.folder / "fleet.toml"
    entries = "".join(f'[[robots]]\nid = "R{number}"\nlogs = ["{number}.csv"]\n' for number in range(8))
    manifest.write_text(f'robot = "robot.toml"\n{entries}', encoding="utf-8")
    code, said = called("fleet", manifest, "--output", arms.folder / "result", "--quiet")
    assert code == 1, said
    document = json.loads((arms.folder / "result" / "fleet.json").read_text(encoding="utf-8"))
    assert not {one["robot"] for one in document["findings"]} & {"R6", "R7"}
    assert document["unexplained"] == ["R6", "R7"]
    assert "no parameters like those of siblings explain the data of 2" in document["headline"]
    assert any("R6 (" in one and "R7 (" in one for one in document["remarks"])


@pytest.mark.slow
def test_what_is_wrong_with_one_robot_is_its_row(arms: Arms) -> None:
    """Another robot's Information, a damaged file, too few rows, a missing robot: each has its reason, others go on."""
    folder = arms.folder
    for number in range(3):
        arms.information(number).save(folder / f"{number}.json")
    other = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    sy.Information.empty(other).save(folder / "other.json")
    sy.Information.empty(arms.model).save(folder / "empty.json")
    (folder / "zero.csv").symlink_to("/dev/zero")
    (folder / "damaged.json").write_text("{", encoding="utf-8")
    rows = [*(f"R{k},,{k}.json" for k in range(3)), "X,,other.json", "Y,,damaged.json", "Z,,empty.json"]
    endless = '[[robots]]\nid = "W"\nlogs = ["zero.csv"]\n[[robots]]\nid = "V"\nlogs = ["' + 5000 * "v" + '"]\n'
    with Checkpoints(folder / "out") as kept:  # they need hashes of the files
        fleet = identify_fleet(arms.manifest(rows, more=endless), checkpoints=kept)
    reasons = {row.entry.id: row.reason for row in fleet.failed}
    assert set(reasons) == {"V", "W", "X", "Y", "Z"}
    assert "is a device and no regular file" in reasons["W"]
    assert "is longer than a path can be" in reasons["V"]
    assert "is of another robot or of other terms" in reasons["X"]
    assert "damaged.json" in reasons["Y"]
    assert "0 rows do not suffice" in reasons["Z"]
    assert fleet.groups[0].siblings is not None


@pytest.mark.slow
def test_a_joint_that_stands_still_in_most_robots_makes_no_difference(arms: Arms) -> None:
    for number in range(5):
        arms.information(number, still=1 if number < 3 else None).save(arms.folder / f"{number}.json")
    fleet = identify_fleet(arms.manifest([f"R{k},,{k}.json" for k in range(5)]))
    assert fleet.differing == ()
    siblings = fleet.groups[0].siblings
    assert siblings is not None
    [usual] = [cause.nominal for cause in siblings.causes if cause.name == "Fcj2"]
    assert usual == pytest.approx(1.5, rel=0.1)  # as those have it whose joint moves


@pytest.mark.slow
def test_what_no_robot_shows_is_said_and_makes_nothing_sure(arms: Arms) -> None:
    """Masses were said to vary by less than a millionth, and a change of 0.03 % to be seen, where they vary by 1 %."""
    arms.trembling = 0.0
    for number in range(20):
        arms.information(number, duration=60.0, still=2).save(arms.folder / f"{number}.json")
    fleet = identify_fleet(arms.manifest([f"R{number},,{number}.json" for number in range(20)]))
    assert fleet.findings == ()
    [compared] = [group.siblings for group in fleet.groups if group.siblings is not None]
    spread = dict(zip([cause.name for cause in compared.causes], compared.spread, strict=True))
    assert 0.005 < spread["mass of link2"] < 0.02
    told = "show the viscous friction of joint3 and the Coulomb friction of joint3: what is usual there is not known"
    assert any(told in remark for remark in fleet.remarks)
    columns = fleet.parameter_columns()
    beside = {
        name for kind, name in zip(columns["kind"], columns["parameter"], strict=True) if kind == "beside siblings"
    }
    assert {"Fcj1", "Fcj2"} <= beside
    assert "Fcj3" not in beside
    page = sy.report.fleet_html(fleet)
    assert "Fcj2: Coulomb friction" in page
    assert "Fcj3: Coulomb friction" not in page


@pytest.mark.slow
def test_robots_of_other_lengths_are_no_siblings(arms: Arms) -> None:
    """Their base parameters have the same names, and are other combinations of those of the links."""
    for number in range(3):
        arms.information(number).save(arms.folder / f"{number}.json")
    rows = [f"R{k},robot.toml,{k}.json" for k in range(3)]
    (arms.folder / "longer").mkdir()
    longer = Arms(arms.folder / "longer", reach=1.5)
    assert longer.model.base_parameters().names == arms.model.base_parameters().names
    for number in range(2):
        longer.information(number).save(longer.folder / f"{number}.json")
        rows.append(f"L{number},longer/robot.toml,longer/{number}.json")
    manifest = arms.folder / "robots.csv"
    manifest.write_text("\n".join(["id,robot,informations", *rows]) + "\n", encoding="utf-8")
    fleet = identify_fleet(manifest)
    assert [group.latest for group in fleet.groups] == [(0, 1, 2), (3, 4)]
    assert fleet.differing == ()
    assert fleet.remarks[0].startswith("With 3 robots like R0 in the fleet, what is usual")
    assert fleet.remarks[1].startswith("The fleet has 2 robots like L0 of which something came")
    assert fleet.remarks[2].startswith("The fleet has robots of 2 models")
    page = fleet_html(fleet)  # where nobody could tell pictures and tables of two models apart
    assert "<h3>Beside siblings, robots like R0</h3>" in page
    assert "3 robots like R0" in page


@pytest.mark.slow
def test_a_log_that_is_too_short_for_its_noise_to_be_known_is_not_compared(arms: Arms) -> None:
    for number in range(5):
        arms.information(number, duration=20.0 if number else 0.6).save(arms.folder / f"{number}.json")
    fleet = identify_fleet(arms.manifest([f"R{k},,{k}.json" for k in range(5)]))
    assert fleet.differing == fleet.drifted == ()
    assert fleet.groups[0].latest == (1, 2, 3, 4)
    assert next(remark for remark in fleet.remarks if "too short" in remark).endswith(
        "no interval holds: R0. They are left out of the comparison of siblings; give longer logs."
    )
    assert [row["differs"] for row in fleet.robot_rows()] == [None, False, False, False, False]


@pytest.mark.slow
def test_one_log_that_is_given_for_several_robots_is_compared_once(arms: Arms) -> None:
    """Six robots with one log among them would not vary, and a sound one would differ from them."""
    for number in range(4):
        arms.information(number).save(arms.folder / f"{number}.json")
    names = [0, 0, 0, 0, 0, 0, 1, 2, 3]
    fleet = identify_fleet(arms.manifest([f"R{k},,{name}.json" for k, name in enumerate(names)]))
    assert fleet.differing == ()
    assert fleet.groups[0].latest == (0, 6, 7, 8)
    [told] = [remark for remark in fleet.remarks if "same data" in remark]
    assert told.startswith("The same data was given for R0 and R1, R0 and R2, R0 and R3, R0 and R4, R0 and R5:")
    sound = identify_fleet(arms.manifest([f"R{k},,{k}.json" for k in range(4)]))
    assert not any("same data" in remark for remark in sound.remarks)


@pytest.mark.slow
def test_a_log_that_a_pattern_finds_for_another_robot_too_is_told(arms: Arms) -> None:
    """The pattern R1*.json, meant for the robot R1, finds R10.json."""
    for name in (0, 1, 10, 2):
        arms.information(name).save(arms.folder / f"R{name}.json")
    rows = [f"R{k},,R{k}.json" for k in (0, 10, 2)]
    fleet = identify_fleet(arms.manifest([*rows, "R1,,R1.json;R10.json"]))
    [told] = [remark for remark in fleet.remarks if "A log was given for two entries" in remark]
    assert "R10 and R1:" in told
    assert not any("A log was" in remark for remark in identify_fleet(arms.manifest([*rows, "R1,,R1.json"])).remarks)


@pytest.mark.slow
def test_what_failed_is_tried_again(arms: Arms, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that was full in the run that was killed may have room in the next one."""
    for number in range(3):
        arms.information(number).save(arms.folder / f"{number}.json")
    manifest = arms.manifest([f"R{k},,{k}.json" for k in range(3)])
    load = sy.Information.load

    def refused(path: str) -> sy.Information:
        if path.endswith("1.json"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return load(path)

    with Checkpoints(arms.folder / "out") as kept:
        monkeypatch.setattr(sy.Information, "load", refused)
        assert [row.entry.id for row in identify_fleet(manifest, checkpoints=kept).failed] == ["R1"]
        monkeypatch.undo()
        assert len(kept.names) == 2
        assert identify_fleet(manifest, checkpoints=kept).failed == ()


@pytest.mark.slow
def test_remarks_are_those_of_the_robots_own_log(arms: Arms) -> None:
    """Also where its content is that of another robot, whose estimate is there already."""
    t = np.arange(0.0, 12.0, 0.01)
    w = 2 * np.pi * np.array([0.2, 0.31, 0.43])
    q = np.sin(w * t[:, None])
    torque = arms.model.inverse_dynamics(q, w * np.cos(w * t[:, None]), -(w**2) * q, arms.usual)
    torque += 0.002 * torque.std(axis=0) * np.random.default_rng(1).normal(size=torque.shape)
    torque[500:504, 1] += np.ptp(torque[:, 1])  # an impact, which a remark names
    for name in ("one", "two"):
        sy.Recording(t=t, q=q, torque=torque, source="log").save(arms.folder / f"{name}.csv")
    manifest = arms.folder / "fleet.toml"
    text = "".join(f'[[robots]]\nid = "{name}"\nlogs = ["{name}.csv"]\n' for name in ("one", "two"))
    manifest.write_text('robot = "robot.toml"\n' + text, encoding="utf-8")
    with Checkpoints(arms.folder / "out") as kept:
        for _ in range(2):
            for row in identify_fleet(manifest, checkpoints=kept).rows:
                [told] = [remark for remark in row.values["remarks"] if "at t = 5.0" in remark]
                assert f"{row.entry.id}.csv" in told


@pytest.mark.slow
def test_an_arm_that_met_a_stop_is_not_said_to_predict_as_well_as_its_noise(arms: Arms) -> None:
    random = np.random.default_rng(2)
    t = np.arange(0.0, 20.0, 0.01)
    w = 2 * np.pi * np.array([0.2, 0.31, 0.43])
    q = np.sin(w * t[:, None])
    torque = arms.model.inverse_dynamics(q, w * np.cos(w * t[:, None]), -(w**2) * q, arms.usual)
    torque = torque + 0.002 * torque.std(axis=0) * random.normal(size=torque.shape)
    impact = np.zeros_like(torque)
    for row in (500, 1400):
        impact[row : row + 4, 1] = np.ptp(torque[:, 1]) * np.array([0.8, 1.6, 1.2, 0.6])
    for name, own in (("sound", torque), ("struck", torque + impact)):
        sy.Recording(t=t, q=q, torque=own, source="log").save(arms.folder / f"{name}.csv")
    path: Path = arms.folder / "fleet.toml"
    text = "".join(f'[[robots]]\nid = "{name}"\nlogs = ["{name}.csv"]\n' for name in ("sound", "struck"))
    path.write_text('robot = "robot.toml"\n' + text, encoding="utf-8")
    fleet = identify_fleet(path)
    sound, struck = (row.values for row in fleet.rows)
    assert sound["model_error"] < 0.01
    part = float(np.sqrt(np.sum(impact**2) / np.sum((torque + impact) ** 2)))
    assert struck["model_error"] == pytest.approx(part, rel=0.2)
    assert any("at t = 5.0" in remark and "14.0" in remark for remark in struck["remarks"])
    assert not any("hold no rows" in remark for remark in fleet.remarks)
    # An Information does not hold the rows that tell an impact from noise; the fleet says so.
    [reduced] = sy.fleet.reduce_data_sets([sy.fleet.DataSet(arms.folder / "robot.toml", [arms.folder / "struck.csv"])])
    reduced.information.save(arms.folder / "struck.json")
    path.write_text('robot = "robot.toml"\n[[robots]]\nid = "A"\ninformations = ["struck.json"]\n', encoding="utf-8")
    blind = identify_fleet(path)
    assert blind.rows[0].values["model_error"] < 0.7 * part
    assert any(remark.startswith("1 entry gives Informations, which hold no rows") for remark in blind.remarks)


@pytest.mark.slow
def test_logs_are_reduced_on_the_way(arms: Arms) -> None:
    """From logs of three robots; the estimate is that of their reduction by hand."""
    random = np.random.default_rng(1)
    t = np.arange(0.0, 12.0, 0.01)
    for number in range(3):
        w = 2 * np.pi * np.array([0.2, 0.31, 0.43])
        q = np.sin(w * t[:, None] + number)
        torque = arms.model.inverse_dynamics(q, w * np.cos(w * t[:, None] + number), -(w**2) * q, arms.usual)
        torque = torque + 0.1 * random.normal(size=torque.shape)
        sy.Recording(t=t, q=q, torque=torque, source="log").save(arms.folder / f"log{number}.csv")
    text = 'robot = "robot.toml"\n' + "".join(f'[[robots]]\nid = "R{k}"\nlogs = ["log{k}.csv"]\n' for k in range(3))
    path: Path = arms.folder / "fleet.toml"
    path.write_text(text, encoding="utf-8")
    fleet = identify_fleet(path)
    assert fleet.failed == ()
    [reduced] = sy.fleet.reduce_data_sets([sy.fleet.DataSet(arms.folder / "robot.toml", [arms.folder / "log1.csv"])])
    assert np.array_equal(fleet.rows[1].values["base"], sy.least_squares(reduced.information).base)


@pytest.mark.slow
def test_a_log_of_several_is_no_validation_of_their_fit(arms: Arms) -> None:
    """By itself it would be filtered otherwise than beside one whose encoders are coarse."""
    random = np.random.default_rng(1)
    t = np.arange(0.0, 12.0, 0.01)
    for number, step in enumerate((0.004, 1e-6, 1e-6)):
        w = 2 * np.pi * np.array([0.2, 0.31, 0.43])
        q = np.sin(w * t[:, None] + number)
        torque = arms.model.inverse_dynamics(q, w * np.cos(w * t[:, None] + number), -(w**2) * q, arms.usual)
        torque = torque + 0.1 * random.normal(size=torque.shape)
        sy.Recording(t=t, q=step * np.round(q / step), torque=torque, source="log").save(arms.folder / f"{number}.csv")
    path: Path = arms.folder / "fleet.toml"
    text = "".join(
        f'[[robots]]\nid = "{name}"\nlogs = ["0.csv", "1.csv"]\nvalidate = ["{name}.csv"]\n' for name in ("1", "2")
    )
    path.write_text('robot = "robot.toml"\n' + text, encoding="utf-8")
    seen, new = (row.values for row in identify_fleet(path).rows)
    told = "1.csv: the rows of this log were used in the fit, so that its error is no test of a prediction."
    assert [sum(told in remark for remark in one["remarks"]) for one in (seen, new)] == [1, 0]
    assert new["source"] == "the validation log" != seen["source"]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="processes are stopped by signals of POSIX")
def test_a_cluster_with_a_killed_and_a_slow_worker_writes_the_same_bytes(arms: Arms, tmp_path: Path) -> None:
    """The command, with a scheduler and two workers of Dask as processes; some robots come of logs."""
    pytest.importorskip("distributed")
    rows = []
    t = np.arange(0.0, 8.0, 0.01)
    for number in range(6):
        arms.information(number).save(arms.folder / f"{number}.json")
        rows.append(f"R{number},,{number}.json,")
    w = 2 * np.pi * np.array([0.2, 0.31, 0.43])
    for number in range(6, 9):
        q = np.sin(w * t[:, None] + number)
        torque = arms.model.inverse_dynamics(q, w * np.cos(w * t[:, None] + number), -(w**2) * q, arms.usual)
        torque = torque + np.random.default_rng(number).normal(0.0, 0.1, torque.shape)
        sy.Recording(t=t, q=q, torque=torque, source="log").save(arms.folder / f"log{number}.csv")
        rows.append(f"R{number},,,log{number}.csv")
    manifest = arms.manifest(rows)
    (arms.folder / "robots.csv").write_text("\n".join(["id,date,informations,logs", *rows]) + "\n", encoding="utf-8")

    def told(name: str, *options: str) -> dict[str, bytes]:
        command = [sys.executable, "-m", "steelyard", "fleet", str(manifest), "-q", "-o", str(arms.folder / name)]
        ended = subprocess.run([*command, *options], capture_output=True, text=True, timeout=300)
        assert ended.returncode in (0, 1), ended.stderr
        return {path.name: path.read_bytes() for path in (arms.folder / name).iterdir()}

    expected = told("one")
    assert len(pl.read_parquet(arms.folder / "one" / "robots.parquet")) == 9
    place = tmp_path / "dask"
    place.mkdir()
    with dask_workers(place, 2) as (address, workers):
        begin = time.monotonic()
        assert told("cluster", "--cluster", address) == expected
        with disturbed(workers, 0.5 * (time.monotonic() - begin), 0.2):
            assert told("disturbed", "--cluster", address) == expected
        assert workers[0].wait(60) < 0


def test_the_manifest_is_not_replaced_by_results(arms: Arms, called: Called) -> None:
    frame = pl.DataFrame({"id": ["A"], "robot": ["robot.toml"], "informations": ["a.json"]})
    frame.write_parquet(arms.folder / "robots.parquet")
    before = (arms.folder / "robots.parquet").read_bytes()
    code, said = called("fleet", arms.folder / "robots.parquet", "--output", arms.folder)
    assert code == 2
    assert "is read, and the results would replace it" in said
    assert (arms.folder / "robots.parquet").read_bytes() == before


@pytest.mark.parametrize("element", ["visual", "collision", "constraint"])
def test_what_was_kept_is_not_that_of_other_meshes(tmp_path: Path, element: str) -> None:
    def key(size: float) -> str:
        corners = size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        faces = "".join(
            "facet normal 0 0 0\nouter loop\n"
            + "".join(f"vertex {x} {y} {z}\n" for x, y, z in np.delete(corners, k, axis=0))
            + "endloop\nendfacet\n"
            for k in range(4)
        )
        (tmp_path / "link.stl").write_text(f"solid link\n{faces}endsolid link\n")
        description = robot_estimate.description_of(str(tmp_path / "robot.toml"))
        entry = FleetEntry("A", "", "", tmp_path / "robot.toml")
        return checkpoint_key(*robot_estimate.inputs_of(robot_estimate.task_of(entry, description, "base")))

    shape = f'<{element}><geometry><mesh filename="link.stl"/></geometry></{element}>'
    (tmp_path / "arm.urdf").write_text(
        f'<robot name="arm"><link name="base"/><link name="upper">{shape if element != "constraint" else ""}</link>'
        '<joint name="one" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>'
    )
    hull = '[[constraints.center_of_mass_hull]]\nlink = "upper"\nmesh = "link.stl"\n'
    (tmp_path / "robot.toml").write_text(
        f'[description]\nurdf = "arm.urdf"\n{hull if element == "constraint" else ""}', encoding="utf-8"
    )
    assert key(0.1) == key(0.1) != key(0.2)


def pendulums(folder: Path) -> Path:
    """Write logs of three rods of 2 kg and 0.5 m, which move otherwise, and return the path of their manifest."""
    t = np.arange(1000) / 100.0
    lines = ['robot = "robot.toml"']
    for number in range(3):
        rate = 2.0 + 0.3 * number
        q, dq, ddq = np.sin(rate * t), rate * np.cos(rate * t), -(rate**2) * np.sin(rate * t)
        torque = 0.5 * ddq + 9.81 * np.cos(q) + 0.4 * dq + np.random.default_rng(number).normal(0.0, 0.02, t.shape)
        table = np.column_stack([t, q, torque])
        np.savetxt(folder / f"run{number}.csv", table, delimiter=",", header="t,q1,tau1", comments="")
        lines += ["[[robots]]", f'id = "R{number}"', f'logs = ["run{number}.csv"]']
    (folder / "fleet.toml").write_text("\n".join(lines))
    described(folder, "viscous")
    return folder / "fleet.toml"


def described(folder: Path, *terms: str) -> None:
    text = "[description]\nrows = [[0.0, 0.5, 0.0, 'q']]\ngravity = [0, -9.81, 0]\n"
    (folder / "robot.toml").write_text(text + "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in terms))


def test_the_next_fleet_reads_the_description_anew(tmp_path: Path) -> None:
    """A notebook, and each process of a cluster, estimates many fleets, and remembers descriptions."""
    manifest = pendulums(tmp_path)
    assert [len(row.values["base"]) for row in identify_fleet(manifest).rows] == [4] * 3  # inertia, two of gravity, one
    described(tmp_path, "viscous", "coulomb")
    with Checkpoints(tmp_path / "result") as kept:
        assert [len(row.values["base"]) for row in identify_fleet(manifest, checkpoints=kept).rows] == [5] * 3


class Meanwhile:
    """An executor of this process, before which somebody writes a file."""

    def __init__(self, write: Callable[[], object]) -> None:
        self.write = write

    def run(self, leaf: Any, combine: Any, common: Any, groups: Any) -> Any:
        if leaf is robot_estimate.robot_estimate:
            self.write()
        return Here().run(leaf, combine, common, groups)


def test_a_description_that_is_edited_meanwhile_is_told(tmp_path: Path) -> None:
    manifest = pendulums(tmp_path)
    found = identify_fleet(manifest, executor=Meanwhile(lambda: described(tmp_path, "viscous", "coulomb")))
    assert [row.reason for row in found.rows] == [found.rows[0].reason] * 3
    assert "was changed after the run began" in found.rows[0].reason


@pytest.mark.slow
def test_what_was_kept_of_a_robot_is_of_the_log_by_which_it_is_known(tmp_path: Path) -> None:
    """Rows of a log that was another one for a while, when it was read, are not taken for its own afterwards."""
    manifest = pendulums(tmp_path)
    expected = [row.values["base"].tolist() for row in identify_fleet(manifest).rows]
    path = tmp_path / "run1.csv"
    own = path.read_bytes()
    with Checkpoints(tmp_path / "result") as kept:
        other = Meanwhile(lambda: path.write_bytes((tmp_path / "run2.csv").read_bytes()))
        found = identify_fleet(manifest, executor=other, checkpoints=kept)
        assert ["is not what it was when the run began" in row.reason for row in found.rows] == [False, True, False]
        path.write_bytes(own)
        found = identify_fleet(manifest, checkpoints=kept)
    assert [row.values["base"].tolist() for row in found.rows] == expected
