"""Robots of one fleet that fall into two batches: told as such, by cause, robots and size; and only where there are."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import steelyard as sy
from steelyard.cli import main
from steelyard.fleet import (
    Cause,
    SiblingComparison,
    compare_siblings,
    gains_in_own_motion,
    identify_fleet,
    possible_causes,
    siblings,
    variations,
)
from steelyard.fleet.batches import find_heap, two_heaps
from steelyard.regression import ParameterCovariance, torque_gains

from .sibling_arms import Arms

Law = Callable[[np.random.Generator, int], np.ndarray]
LAWS: dict[str, Law] = {
    "normal": lambda random, count: random.normal(size=count),
    "heavy tails": lambda random, count: random.standard_t(3, size=count),
    "skewed": lambda random, count: np.exp(0.5 * random.normal(size=count)) / 0.5,
    "one-sided": lambda random, count: random.exponential(size=count),
    "bounded": lambda random, count: random.uniform(-1.7, 1.7, size=count),
}
ONE = Cause("Fc1", "term", "joint1", "Coulomb friction", "N·m", 1.0, np.eye(2)[:, :1])
OTHER = Cause("Fc2", "term", "joint2", "Coulomb friction", "N·m", 1.0, np.eye(2)[:, 1:])


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_one_heap_of_any_shape_is_not_split(law: str) -> None:
    random = np.random.default_rng(1)
    for count in (8, 12, 30, 100):
        assert [two_heaps(LAWS[law](random, count), 20) for _ in range(15)] == [None] * 15


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("count", "many"), [(40, 8), (100, 35), (100, 50)])
def test_two_heaps_are_told_apart(law: str, count: int, many: int) -> None:
    random = np.random.default_rng(2)
    for sign in (1.0, -1.0):
        values = LAWS[law](random, count)
        values[:many] += 16.0 * sign
        found = two_heaps(values, 20)
        assert found is not None
        _, robots, apart = found
        inside = set(robots.tolist())
        strayed = min(len(inside ^ set(range(many))), len(inside ^ set(range(many, count))))
        assert strayed <= 2 * (law == "heavy tails")  # as far out as the other heap
        inside_first = values[robots].mean() - np.delete(values, robots).mean()
        assert apart == pytest.approx(inside_first, rel=1e-9)


def test_amplitudes_that_nothing_tells_are_left_out() -> None:
    values = np.concatenate([[np.nan], np.random.default_rng(3).normal(size=20), [np.nan, np.nan], np.full(8, 20.0)])
    values[-8:] += np.random.default_rng(4).normal(size=8)
    found = two_heaps(values)
    assert found is not None
    assert found[1].tolist() == list(range(23, 31))
    assert two_heaps(np.full(30, np.nan)) is None
    assert two_heaps(np.ones(30)) is None


@pytest.mark.parametrize("size", [1e-200, 1.0, 1e200])
@pytest.mark.parametrize("noise", [0.0, 1e-12])
@pytest.mark.parametrize("alike", [30, 25])
def test_robots_that_are_exactly_alike_are_heaps_without_a_warning(size: float, noise: float, alike: int) -> None:
    """Their likelihood has no end: the search for the largest one divided by the scale that it had brought to zero."""
    around = np.random.default_rng(3).normal(size=40) * np.where(np.arange(40) < alike, noise, 1e-9)
    found = two_heaps(size * (np.repeat([0.0, 1.0], [30, 10]) + around))
    assert found is not None
    assert found[1].tolist() == list(range(30, 40))
    assert found[2] == pytest.approx(size)


def test_a_batch_is_the_difference_of_two_means() -> None:
    """In the balanced case, generalised least squares are the means of both heaps, and the error is that of theirs."""
    random = np.random.default_rng(5)
    bases = np.array([2.0, 5.0]) + 0.1 * random.normal(size=(60, 2))
    bases[:20, 0] += 1.5
    bases[4, 1] += 3.0  # one of them has something of its own
    covariances = np.broadcast_to(1e-4 * np.eye(2), (60, 2, 2))
    found = compare_siblings(bases, covariances, (ONE, OTHER), np.eye(2))
    [batch] = found.batches
    assert batch.robots == tuple(range(20))
    assert batch.deviation.cause is ONE
    assert batch.deviation.alternatives == ()
    others = np.delete(bases[:20, 0], 4)  # which counts less than others do
    assert batch.deviation.amplitude == pytest.approx(others.mean() - bases[20:, 0].mean(), abs=0.01)
    assert batch.deviation.lower < 1.5 < batch.deviation.upper
    assert [(one.robot, one.cause) for one in found.deviations] == [(4, OTHER)]
    assert found.mean == pytest.approx(bases[20:].mean(axis=0), abs=0.02)
    assert found.spread[0] == pytest.approx(0.1, rel=0.25)  # within each heap
    assert found.common[:20, 0] == pytest.approx(batch.deviation.amplitude, abs=1e-9)
    assert not found.common[20:].any()
    assert found.amplitude[:20, 0].mean() == pytest.approx(1.5, abs=0.1)
    assert found.shrunk[0][:20, 0].mean() == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize("batch", [False, True])
@pytest.mark.parametrize("still", [0.3, 0.5, 0.7])
def test_robots_whose_logs_show_nothing_of_a_part_are_no_heap(still: float, batch: bool) -> None:
    """Where a joint stands still, what its friction is said to be is what the others have, in each robot the same."""
    random = np.random.default_rng(8)
    bases = np.array([2.0, 5.0]) + 0.1 * random.normal(size=(60, 2))
    covariances = np.repeat(1e-4 * np.eye(2)[None], 60, axis=0)
    many = round(60 * still)
    planted = tuple(range(many, 60, 3)) if batch else ()
    bases[list(planted), 0] += 2.0
    bases[:many, 0], covariances[:many, 0, 0] = random.normal(scale=1e3, size=many), np.inf
    found = compare_siblings(bases, covariances, (ONE, OTHER), np.eye(2))
    assert [(one.robots, one.deviation.cause) for one in found.batches] == ([(planted, ONE)] if batch else [])
    assert found.differs == ()


def test_changes_are_told_robot_by_robot() -> None:
    """Of what changed in a third of the robots, no batch is told."""
    random = np.random.default_rng(6)
    before, changes = 1.0 + 0.1 * random.normal(size=(30, 2)), 0.1 * random.normal(size=(30, 2))
    changes[:8, 0] += 3.0
    covariances = np.broadcast_to(1e-4 * np.eye(2), (30, 2, 2))
    assert compare_siblings(changes, covariances, (ONE, OTHER), np.eye(2), before=before).batches == ()
    assert len(compare_siblings(changes, covariances, (ONE, OTHER), np.eye(2)).batches) == 1


def test_robots_that_are_out_of_order_in_several_ways_are_no_batch() -> None:
    """Six robots look alike in one part, and each of them has another one as well."""
    causes = tuple(
        Cause(f"Fc{k}", "term", f"joint{k}", "Coulomb friction", "N·m", 1.0, np.eye(8)[:, [k]]) for k in range(8)
    )
    random = np.random.default_rng(7)
    bases = 0.1 * random.normal(size=(60, 8))
    bases[:6, 0] += 1.5
    bases[range(6), [1, 2, 3, 4, 5, 6]] += [2.0, -3.0, 2.5, -2.0, 3.0, 2.0]
    covariances = np.broadcast_to(1e-4 * np.eye(8), (60, 8, 8))
    found = compare_siblings(bases, covariances, causes, np.eye(8))
    assert found.batches == ()
    assert set(range(6)) <= set(found.differs)


@pytest.mark.slow
def test_robots_of_which_each_has_its_own_heavier_link_are_no_batch() -> None:
    """A joint carries all links behind it: what is carried by the first is more for all ten, which are four kinds."""
    carried = np.zeros((40, 5))
    carried[0], carried[1:5, 1:] = 1.0, 0.4 * np.eye(4)
    causes = tuple(Cause(f"m{k}", "mass", f"link{k}", "mass", "kg", 1.0, carried[:, [k]]) for k in range(5))
    bases = 0.1 * np.random.default_rng(5).normal(size=(150, 40))
    odd = {robot: 1 + robot // 15 % 4 for robot in range(0, 150, 15)}
    for robot, link in odd.items():
        bases[robot] += 0.8 * carried[:, link]
    found = compare_siblings(bases, np.broadcast_to(1e-4 * np.eye(40), (150, 40, 40)), causes, np.eye(40))
    assert found.batches == ()
    assert {one.robot: one.cause.name for one in found.deviations} == {robot: f"m{link}" for robot, link in odd.items()}


def test_what_is_found_again_as_it_was_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where numbers are of a million times the size of what is known, so that taking them off changes nothing."""
    bases = 0.1 * np.random.default_rng(3).normal(size=(30, 2))
    bases[:8, 0] += 3.0
    told: list[object] = []

    def again(*given: Any) -> object:
        told.append(told[0] if told else find_heap(*given))
        assert len(told) < 10
        return told[0]

    monkeypatch.setattr(siblings, "find_heap", again)
    found = compare_siblings(bases, np.broadcast_to(1e-4 * np.eye(2), (30, 2, 2)), (ONE, OTHER), np.eye(2))
    assert [batch.robots for batch in found.batches] == [tuple(range(8))]


def compared(arms: Arms, count: int, faults: dict[int, tuple[str, float]]) -> SiblingComparison:
    """Hold arms beside each other, of which some have faults; what others have is what friction is a part of."""
    told = []
    for number in range(count):
        info = arms.information(number, *faults.get(number, ("", 1.0)), duration=10.0)
        estimate = sy.least_squares(info)
        told.append((estimate.base, ParameterCovariance.of(info, estimate.base).matrix, torque_gains(info)))
    bases, covariances, gains = (np.array(one) for one in zip(*told, strict=True))
    others = [number for number in range(count) if number not in faults]
    usual = np.median(bases[others], axis=0), np.median(gains[others], axis=0)
    causes = possible_causes(arms.model, arms.usual, *usual)
    own = gains_in_own_motion(arms.model, causes, gains)
    return compare_siblings(bases, covariances, causes, variations(arms.model, causes), own=own)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "factor", "name"),
    [
        ("joint2", 1.5, "friction of joint2"),
        ("joint1", 0.6, "friction of joint1"),
        ("link3", 1.15, "mass of link3"),
        ("gain1", 0.9, "torque gain of joint1"),
        ("gain2", 1.1, "torque gain of joint2"),
    ],
)
def test_what_a_batch_has_in_common_is_named(fault: str, factor: float, name: str, tmp_path: Path) -> None:
    """Of fifty arms a third, and one of the others is out of order as well."""
    robots = tuple(range(1, 50, 3))
    found = compared(Arms(tmp_path), 50, {**dict.fromkeys(robots, (fault, factor)), 6: ("joint3", 2.0)})
    [batch] = found.batches
    assert batch.robots == robots
    assert batch.deviation.cause.name == name
    assert batch.deviation.lower < factor - 1.0 < batch.deviation.upper
    assert batch.deviation.upper - batch.deviation.lower < 0.12
    assert batch.apart > 4.0
    surest = {one.robot: one.cause.name for one in reversed(found.deviations)}
    assert surest[6] == "friction of joint3"
    assert len(set(surest) & set(robots)) <= 1  # nearly none of a batch is named for what all of it has


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "more"), [(1.2, 0.0), pytest.param(-1.0, 0.0, marks=pytest.mark.slow), (0.8, 1.5)])
def test_torques_of_a_batch_may_be_in_another_unit(factor: float, more: float, tmp_path: Path) -> None:
    """The joints were told one after the other, and the rest in batches of other robots."""
    robots = tuple(range(0, 30, 3))
    faults = dict.fromkeys(robots, ("gains", factor)) | ({7: ("joint2", more)} if more else {})
    found = compared(Arms(tmp_path, alike=True), 30, faults)
    [batch] = found.batches
    assert batch.robots == robots
    assert batch.deviation.cause.name == "torque gain of all joints"
    assert batch.deviation.amplitude == pytest.approx(factor - 1.0, abs=0.01)  # links vary by 1 %, friction by 5 %
    assert found.differs == ((7,) if more else ())


@pytest.mark.slow
def test_all_that_a_batch_has_in_common_is_told_each_beside_the_others(tmp_path: Path) -> None:
    """A third of the arms is warm: viscous friction by 0.3, and Coulomb friction by 0.55."""
    warm, held = tuple(range(0, 40, 3)), []
    found = compared(Arms(tmp_path), 40, dict.fromkeys(warm, ("warm", 0.3)))
    assert {batch.deviation.cause.name for batch in found.batches} == {f"F{a}j{k}" for a in "vc" for k in (1, 2, 3)}
    for batch in found.batches:
        factor = 0.3 if batch.deviation.cause.name.startswith("Fv") else 0.3**0.5
        assert batch.robots == warm
        assert batch.deviation.amplitude == pytest.approx(factor - 1.0, abs=0.06)
        held.append(batch.deviation.lower < factor - 1.0 < batch.deviation.upper)
    assert sum(held) >= 5
    assert found.differs == ()


@pytest.mark.slow
@pytest.mark.parametrize("fault", [("joint3", 1.6), ("link2", 1.2), ("payload", 1.0), ("gain2", 1.2)])
def test_what_one_batch_has_makes_no_other(fault: tuple[str, float], tmp_path: Path) -> None:
    """What a torque's gain does was found with it; without it, half of the others had another gain, or friction."""
    for count, step in ((24, 4), (60, 10)):
        robots = tuple(range(0, count, step))
        found = compared(Arms(tmp_path, alike=True), count, dict.fromkeys(robots, fault))
        assert [batch.robots for batch in found.batches] in ([robots], [])
        assert found.batches or set(found.differs) == set(robots)


@pytest.mark.parametrize(("count", "fault", "factor"), [(8, "gains", 1000.0), (11, "gain2", 2.0)])
def test_three_robots_beyond_all_others_draw_none_into_a_batch(
    count: int, fault: str, factor: float, tmp_path: Path
) -> None:
    """Of eight, three in mN·m made twelve batches of the others; of eleven, a sound one made a batch of three others.

    So the sound one was named, and the others were not.
    """
    found = compared(Arms(tmp_path), count, dict.fromkeys(range(3), (fault, factor)))
    assert found.batches == ()
    assert found.differs == (0, 1, 2)


@pytest.mark.slow
def test_the_heap_is_told_whose_torque_reads_wrong(tmp_path: Path) -> None:
    """It is the larger one here: what a wrong scale does depends on each robot's motion, and the others are alike."""
    robots = tuple(number for number in range(40) if number % 10 > 2)
    [batch] = compared(Arms(tmp_path), 40, dict.fromkeys(robots, ("gain2", 1.1))).batches
    assert batch.robots == robots
    assert batch.deviation.cause.name == "torque gain of joint2"
    assert batch.deviation.lower < 0.1 < batch.deviation.upper


@pytest.mark.slow
def test_the_smaller_heap_is_told_beside_robots_that_show_it_poorly(tmp_path: Path) -> None:
    """Of the twelve whose last joint moves, eight have more friction; Coulomb's is seen in the trembling of the others.

    Of the twelve the other four are the smaller heap, which those join then.
    """
    arms, robots = Arms(tmp_path), tuple(f"R{number}" for number in range(40) if number % 10 in (7, 9))
    for number in range(40):
        fault, still = ("joint3", None) if f"R{number}" in robots else ("", 2 if number % 10 < 7 else None)
        arms.information(number, fault, 1.6, duration=6.0, still=still).save(tmp_path / f"{number}.json")
    [batch] = identify_fleet(arms.manifest([f"R{k},,{k}.json" for k in range(40)])).batches
    assert batch.robots == robots
    assert batch.deviation.cause.name == "friction of joint3"
    assert batch.deviation.lower < 0.6 < batch.deviation.upper


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty arms, of which half have a second joint of 1.5 times the friction, and one of these twice that."""
    place = tmp_path_factory.mktemp("batches")
    arms, rows = Arms(place), []
    for number in range(40):
        factor = 3.0 if number == 9 else 1.5 if number % 2 else 1.0
        arms.information(number, "joint2", factor, duration=10.0).save(place / f"{number}.json")
        rows.append(f"R{number},,{number}.json")
    arms.manifest(rows)
    return place


@pytest.mark.slow
def test_a_batch_is_one_finding_of_the_fleet(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["steelyard", "fleet", str(folder / "fleet.toml"), "-o", str(folder / "result")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    said = capsys.readouterr().out
    assert "40 robots: 20 are of another batch, 1 differs from its siblings." in said
    assert "20 of 40 robots are of another batch, as after a change of a supplier: R" in said
    assert "The friction of joint2 is " in said
    assert "R9: Beyond what its batch has in common, the friction of joint2 is " in said

    document = json.loads((folder / "result" / "fleet.json").read_text(encoding="utf-8"))
    [batch] = document["batches"]
    more = batch == [f"R{k}" for k in range(1, 40, 2)]  # which half is told as the other is open
    assert more or batch == [f"R{k}" for k in range(0, 40, 2)]
    assert document["differing"] == ["R9"]
    findings = pl.read_parquet(folder / "result" / "findings.parquet").to_dicts()
    assert [(one["kind"], one["robot"], one["cause"]) for one in findings] == [
        ("batch", "", "friction of joint2"),
        ("siblings", "R9", "friction of joint2"),
    ]
    assert findings[0]["robots"].split(", ") == batch == document["findings"][0]["robots"]
    factor = 1.5 if more else 1.0 / 1.5
    assert 1.0 + findings[0]["lower"] < factor < 1.0 + findings[0]["upper"]
    assert findings[0]["ratio"] == pytest.approx(factor, rel=0.05)
    assert findings[1]["ratio"] == pytest.approx(2.0, rel=0.15)  # its own friction varies by 4 %

    robots = pl.read_parquet(folder / "result" / "robots.parquet")
    assert robots.filter(pl.col("batch") == "friction of joint2")["robot"].to_list() == batch
    assert robots.filter(pl.col("differs"))["robot"].to_list() == ["R9"]
    beside = pl.read_parquet(folder / "result" / "parameters.parquet").filter(
        (pl.col("kind") == "beside siblings") & (pl.col("parameter") == "friction of joint2")
    )
    heap, others = (beside.filter(pl.col("robot").is_in(batch) == inside)["value"].median() for inside in (True, False))
    assert set(beside["unit"]) == {""}  # parts of what the others have
    assert heap == pytest.approx(factor - 1.0, abs=0.05)  # with what it has in common with its batch
    assert others == pytest.approx(0.0, abs=0.03)

    page = (folder / "result" / "fleet.html").read_text(encoding="utf-8")
    assert '<h2 id="batches">' in page
    assert page.count('class="batch"') >= 4  # bars of the picture of two heaps
    assert ">20 others</text>" in page
    assert ">20 of this batch</text>" in page
    assert "friction of joint2 of 40 robots, beside that of the others" in page
    assert ", ".join(batch) in page


@pytest.mark.slow
def test_the_picture_leaves_out_robots_whose_logs_do_not_show_the_part(folder: Path) -> None:
    fleet = identify_fleet(folder / "fleet.toml")
    [group] = fleet.groups
    assert group.siblings is not None
    [batch] = group.siblings.batches
    error = group.siblings.error.copy()
    others = [number for number in range(40) if number not in batch.robots]
    error[others[:15], group.siblings.causes.index(batch.deviation.cause)] *= 1e4
    hidden = replace(fleet, groups=(replace(group, siblings=replace(group.siblings, error=error)),))
    assert ">5 others</text>" in sy.report.fleet_html(hidden)


@pytest.mark.slow
def test_no_number_depends_on_the_order_of_the_manifest(folder: Path) -> None:
    told = []
    for order in (range(40), np.random.default_rng(1).permutation(40)):
        lines = ["id,group,robot,informations", *(f"R{k},line 2,robot.toml,{k}.json" for k in order)]
        (folder / "ordered.csv").write_text("\n".join(lines), encoding="utf-8")
        fleet = identify_fleet(folder / "ordered.csv")
        told.append((fleet.to_dict(), sorted(map(str, fleet.robot_rows()))))
    assert told[0] == told[1]
    assert "20 of 40 robots of the group line 2 are of another batch" in told[0][0]["findings"][0]["sentence"]
    assert told[0][0]["findings"][0]["robots"][:6] in ([f"R{k}" for k in range(n, 12 + n, 2)] for n in (0, 1))


@pytest.mark.slow
def test_a_batch_within_a_batch_is_told_beside_what_both_share(tmp_path: Path) -> None:
    """Three heaps of the same friction: of fifteen robots that have more, four have more than the others of these."""
    arms, most = Arms(tmp_path), tuple(f"R{k}" for k in (1, 15, 22, 29))
    for k in range(42):
        factor = 1.6 if k % 4 == 0 else 2.6 if f"R{k}" in most else 1.0
        arms.information(k, "joint2", factor, duration=6.0).save(tmp_path / f"{k}.json")
    fleet = identify_fleet(arms.manifest([f"R{k},,{k}.json" for k in range(42)]))
    larger, smaller = fleet.batches
    assert len(larger.robots) == 15
    assert smaller.robots == most
    assert "Beyond what they share with a larger batch, the friction of joint2 is " in smaller.sentence
    together = (1.0 + larger.deviation.amplitude) * (1.0 + smaller.deviation.amplitude)
    assert together == pytest.approx(2.6, rel=0.1)
    page = sy.report.fleet_html(fleet)
    assert larger.sentence in page
    assert smaller.sentence in page


@pytest.mark.slow
def test_a_fleet_without_batches_says_nothing_of_them(tmp_path: Path) -> None:
    arms = Arms(tmp_path)
    for number in range(12):
        arms.information(number, duration=10.0).save(tmp_path / f"{number}.json")
    fleet = identify_fleet(arms.manifest([f"R{k},,{k}.json" for k in range(12)]))
    assert fleet.batches == ()
    assert "batch" not in fleet.headline
    assert {row["batch"] for row in fleet.robot_rows()} == {None}
    assert '<h2 id="batches">' not in sy.report.fleet_html(fleet)


class Pendulums:
    """Double pendulums, whose friction varies by as much as is told and whose links vary by 2 %."""

    def __init__(self) -> None:
        robot = sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 0.5, 0, "q")], gravity=(0, -9.81, 0))
        self.model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))
        self.usual = np.array([0, 0, 0, 0, 0, 0.3, 0.5, 0, 0, 1, 0.1, 2] * 2)
        self.K = self.model.base_parameters().K
        self.covariance = np.diag((0.01 * np.abs(self.K @ self.usual) + 1e-3) ** 2)

    def compared(self, own: np.ndarray, random: np.random.Generator) -> SiblingComparison:
        bases = own @ self.K.T + random.multivariate_normal(np.zeros(len(self.K)), self.covariance, size=len(own))
        causes = possible_causes(self.model, self.usual)
        covariances = np.broadcast_to(self.covariance, (len(own), *self.covariance.shape))
        return compare_siblings(bases, covariances, causes, variations(self.model, causes))


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_sound_fleets_have_no_batch(law: str) -> None:
    """Whatever the shape of what siblings vary by, and with ten robots out of order in some part."""
    pendulums, told = Pendulums(), 0
    for seed in range(100):
        random = np.random.default_rng([seed, 1])
        count = int(random.choice([12, 30, 100]))
        shape = np.stack([LAWS[law](random, count) for _ in pendulums.usual], axis=1)
        own = pendulums.usual * np.maximum(1.0 + 0.03 * random.choice([0.5, 1.0, 3.0]) * shape, 0.1)
        if seed % 2 and count == 100:
            for number in range(10):
                own[number, random.choice([9, 10, 11, 21, 22, 23])] *= 1.5
        told += bool(pendulums.compared(own, random).batches)
    assert told <= 4  # as 0.01 of 100 come to more than 4 with a probability of 0.3 %


@pytest.mark.slow
@pytest.mark.parametrize(("count", "many"), [(20, 8), (100, 10), (100, 35)])
def test_intervals_of_batches_hold_what_was_planted(count: int, many: int) -> None:
    pendulums, held = Pendulums(), []
    for seed in range(100):
        random = np.random.default_rng([seed, 2])
        own = pendulums.usual * (1.0 + 0.02 * random.normal(size=(count, len(pendulums.usual))))
        own[:many, [10, 11]] *= 1.4
        found = pendulums.compared(own, random).batches
        assert [batch.robots for batch in found] == [tuple(range(many))]
        one = found[0].deviation
        assert one.cause.name == "friction of joint1"
        held.append(one.lower < 0.4 < one.upper)
    assert np.mean(held) > 0.88  # 0.95 less three standard errors
