"""A long log, section by section: the same numbers wherever and in whatever order its sections are reduced."""

import pickle
import threading
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from threadpoolctl import threadpool_limits

import steelyard as sy
from steelyard.fleet import log_reduction
from steelyard.identification.log_reader import LogReader, LogTask, ReducedGroup, one_by_one
from steelyard.recording import Processing, chunks
from steelyard.recording.formats import csv_file, decoded
from steelyard.recording.formats.csv_file import CsvFile
from steelyard.regression import reduction
from steelyard.robot import RobotFile

ROWS = 40_000
ROBOT = """
[description]
convention = "standard"
rows = [["pi/2", 0, 0.3, "q"]]

[[terms]]
kind = "viscous"

[[terms]]
kind = "coulomb"

[processing]
cutoff = 8.0
velocity_threshold = 0.05
"""


class Elsewhere:
    """Sends tasks as to other processes, and returns the last result first."""

    def __init__(self) -> None:
        self.tasks = 0

    def run(self, leaf: Any, combine: Any, common: Any, groups: Any) -> Any:
        self.tasks += len(groups)
        for number, group in reversed(list(enumerate(groups))):
            given, tasks = pickle.loads(pickle.dumps((common, group)))
            yield number, combine(given, [leaf(given, task) for task in tasks])


@pytest.fixture
def frame() -> pl.DataFrame:
    random = np.random.default_rng(3)
    t = np.arange(ROWS) / 1000.0
    q = 0.8 * np.sin(3 * t) + np.sin(1.1 * t) + 0.3 * np.sin(0.71 * t)
    dq = 2.4 * np.cos(3 * t) + 1.1 * np.cos(1.1 * t) + 0.213 * np.cos(0.71 * t)
    ddq = -7.2 * np.sin(3 * t) - 1.21 * np.sin(1.1 * t) - 0.15123 * np.sin(0.71 * t)
    tau = 0.6 * ddq + 0.4 * dq + 0.7 * np.sign(dq) + 0.05 * random.standard_normal(ROWS)
    t[17_300:] += 2.5  # a long gap, at which the log is split
    return pl.DataFrame({"t": t, "q1": q + 1e-5 * random.standard_normal(ROWS), "tau1": tau})


@pytest.fixture(autouse=True)
def short_sections(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "SECTION_ROWS", 13_000)
    monkeypatch.setattr(chunks, "PIECE_ROWS", 3_000)
    monkeypatch.setattr(reduction, "EXACT", 8192)
    monkeypatch.setattr(log_reduction, "LARGE", 1)
    monkeypatch.setattr(csv_file, "READ", (1 << 16, 1 << 18))


def reduced(log: Path, reduction: Any) -> ReducedGroup:
    """Reduce a log; return what is kept of it."""
    settings = log.with_name("robot.toml")
    settings.write_text(ROBOT)
    file = RobotFile.load(settings)
    model = sy.Model.from_file(file)
    (group,) = reduction(LogReader(file, model, 200_000), [LogTask(str(log), 500, 2000, 1, True)], model, print)
    return group


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param("csv", marks=pytest.mark.slow), "parquet"])
def test_sections_are_the_same_numbers_elsewhere(
    frame: pl.DataFrame, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, executor = tmp_path / f"log.{kind}", Elsewhere()
    if kind == "csv":
        frame.write_csv(log)
    else:
        frame.write_parquet(log, row_group_size=7_777)
    here, elsewhere = reduced(log, one_by_one), reduced(log, sy.fleet.LogReduction(executor))
    assert executor.tasks == 3
    assert log_reduction.packed(tuple(here)) == log_reduction.packed(tuple(elsewhere))
    # Sections change no row, and hardly any digit.
    monkeypatch.setattr(chunks, "SECTION_ROWS", 10**9)
    ((one,), (whole,)) = here.logs, reduced(log, one_by_one).logs
    assert one.remarks == whole.remarks
    assert np.array_equal(one.samples.t, whole.samples.t)
    assert one.information.count == whole.information.count
    found, expected = sy.least_squares(one.information), sy.least_squares(whole.information)
    np.testing.assert_allclose(found.base, expected.base, rtol=1e-6)
    np.testing.assert_allclose(found.standard_error, expected.standard_error, rtol=1e-5)


@pytest.mark.slow
def test_sections_side_by_side_are_those_of_one_thread(
    frame: pl.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame.write_parquet(tmp_path / "log.parquet", row_group_size=7_777)
    seen, own = set(), LogReader.reduced_section

    def watched(*given: Any) -> Any:
        seen.add(threading.current_thread())
        return own(*given)

    monkeypatch.setattr(LogReader, "reduced_section", watched)
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads, "blas"):
            found.append(log_reduction.packed(tuple(reduced(tmp_path / "log.parquet", one_by_one))))
        assert len(seen) == [1, 3][threads - 1]  # the main one, and two others
    assert found[0] == found[1]


def test_sections_end_where_one_of_them_fails(
    frame: pl.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame.write_parquet(tmp_path / "log.parquet")
    own = LogReader.reduced_section

    def torn(self: LogReader, log: Any, section: int, *given: Any) -> Any:
        if section == 1:
            raise sy.InputError("the disk was pulled out")
        return own(self, log, section, *given)

    monkeypatch.setattr(LogReader, "reduced_section", torn)
    with threadpool_limits(2, "blas"), pytest.raises(sy.InputError, match="pulled out"):
        reduced(tmp_path / "log.parquet", one_by_one)
    names = [one.name for one in threading.enumerate()]
    assert not [name for name in names if name.startswith(("steelyard reading ahead", "steelyard-in-turns"))]


@pytest.mark.parametrize("name", ["log.csv.gz", "log.npz", "log.mcap"])
def test_what_is_read_whole_is_not_opened_here(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class ReachedError(Exception):
        pass

    class Refuses:
        def run(self, leaf: Any, combine: Any, common: Any, groups: Any) -> Any:
            raise ReachedError(groups)

    (tmp_path / name).write_bytes(b"not read")
    monkeypatch.setattr(LogReader, "opened", None)
    with pytest.raises(ReachedError, match=name):
        reduced(tmp_path / name, sy.fleet.LogReduction(Refuses()))


def test_a_log_that_was_sent_on_is_filtered_with_the_model(frame: pl.DataFrame, tmp_path: Path) -> None:
    frame.head(6_000).write_csv(tmp_path / "log.csv")
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q")]))
    options = Processing(cutoff=8.0, torque_cutoff=20.0, velocity_threshold=None)
    opened = chunks.OpenedLog(chunks.LogStream(tmp_path / "log.csv", {}, 1), options, model, None)
    sent = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(opened))))
    sent.use_model(model)
    (here, *_), (there, *_) = (one.samples(0, chunks.SeenRows()) for one in (opened, sent))
    assert there.regressor is not None
    assert np.array_equal(here.regressor, there.regressor)


def test_csv_is_read_from_its_middle(frame: pl.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame.write_csv(tmp_path / "log.csv")
    whole, part = CsvFile(tmp_path / "log.csv"), CsvFile(tmp_path / "log.csv")
    whole.keep(("t", "tau1"))
    part.keep(("t", "tau1"))
    places = whole.places()
    assert places is not None
    assert len(places) > 4
    part.use_places(places)
    monkeypatch.setattr(decoded, "_DECODED", {})  # as where many logs were read since
    monkeypatch.setattr(whole, "_parsed", None)
    assert whole.places() == places
    for start in (0, 1, 29_999, ROWS - 1):
        block = next(part.blocks_from(start, ["tau1"], 100))
        assert np.array_equal(block["tau1"], frame["tau1"].to_numpy()[start : start + 100])


def test_logs_that_have_one_section_or_many_siblings_are_not_opened_here(
    frame: pl.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Opening takes this process a fifth of a log's time, one after the other; it pays where others would be idle."""
    (tmp_path / "robot.toml").write_text(ROBOT)
    file = RobotFile.load(tmp_path / "robot.toml")
    model, opened = sy.Model.from_file(file), []
    whole = LogReader.opened
    monkeypatch.setattr(LogReader, "opened", lambda *given: opened.append(given[1].log) or whole(*given))

    def asked(rows: int, count: int) -> int:
        tasks = []
        for number in range(count):
            log = tmp_path / f"{rows}-{count}-{number}.csv"
            frame.head(rows).write_csv(log)
            tasks.append(LogTask(str(log), 500, 2000, count, True))
        opened.clear()
        waits = sy.fleet.LogReduction(Stops())(LogReader(file, model, 200_000), tasks, model, lambda _: None)
        with pytest.raises(StopsError):
            next(waits)
        return len(opened)

    assert asked(18_000, 1) == 0  # one section of 13 000 rows and a part
    assert asked(30_000, 1) == 1
    assert asked(30_000, 3) == 3
    assert asked(30_000, 5) == 0


class StopsError(Exception):
    """What `Stops` answers."""


class Stops:
    """An executor that runs nothing, so that what was opened before is seen."""

    def run(self, *_: Any) -> Any:
        raise StopsError
