"""Logs of a set that cannot be used are told all at once, wherever they are read, and nothing else is lost by it."""

import os
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dask_cluster import dask_workers

import steelyard as sy
from steelyard.cli import main
from steelyard.fleet import Checkpoints, DataSet, LogReduction, Workers, log_reduction, reduce_data_sets
from steelyard.identification import log_reader, validate_estimate
from steelyard.identification.given import UnusableLogsError
from steelyard.recording import chunks

BAD: dict[str, Callable[[str], str]] = {
    "run2.csv": lambda text: "",
    "run4.csv": lambda text: text.replace(text.splitlines()[300], "nan,nan,nan,nan,nan"),
    "run5.csv": lambda text: "\n".join([*text.splitlines()[:1], *text.splitlines()[:0:-1]]),
}
TOLD = {"run2.csv": "is empty;", "run4.csv": "line 301", "run5.csv": "goes back in time"}


def damage(place: Path) -> dict[str, str]:
    """Damage three of the five logs; return what they were."""
    whole = {}
    for name, change in BAD.items():
        path = place / "logs" / name
        whole[name] = path.read_text()
        path.write_text(change(whole[name]))
    return whole


def require_all_told(error: UnusableLogsError, of: int = 5) -> None:
    head, *lines = error.lines
    assert head == f"3 of {of} logs cannot be used; mend them, or leave them out:"
    assert list(error.reasons) == [str(path) for path in sorted(map(Path, error.reasons))]
    assert len(lines) == len(TOLD)
    for line, (name, reason) in zip(lines, TOLD.items(), strict=True):
        assert line.count(name) == 1
        assert reason in line


@pytest.mark.parametrize("cutoff", ['"none"', "10.0", '"auto"'])
@pytest.mark.parametrize("kept", [False, True])
def test_identify_tells_all(place: Path, kept: bool, cutoff: str) -> None:
    (place / "robot.toml").write_text((place / "robot.toml").read_text().replace('"none"', cutoff))
    damage(place)
    said: list[str] = []
    with Checkpoints(place / "out") as checkpoints:
        reduction = LogReduction(checkpoints=checkpoints) if kept else None
        with pytest.raises(UnusableLogsError) as raised:
            sy.identify(place / "robot.toml", str(place / "logs"), reduction=reduction, progress=said.append)
    require_all_told(raised.value)
    assert sum("cannot be used; looking through the other logs" in one for one in said) == 1


@pytest.mark.parametrize("options", [{"friction": "auto"}, {"validate": "again"}])
def test_identify_tells_all_whatever_reads_first(place: Path, options: dict[str, Any]) -> None:
    damage(place)
    logs: Any = str(place / "logs")
    if "validate" in options:
        options = {"validate": [str(place / "logs" / name) for name in ("run4.csv", "run5.csv")]}
        logs = [str(place / "logs" / f"run{number}.csv") for number in (1, 2, 3)]
    with pytest.raises(UnusableLogsError) as raised:
        sy.identify(place / "robot.toml", logs, **options)
    require_all_told(raised.value)


@pytest.mark.slow
def test_reduce_and_validate_tell_all(place: Path) -> None:
    result = sy.identify(place / "robot.toml", str(place / "logs" / "run1.csv"))
    result.estimate.save(place / "estimate.json")
    damage(place)
    with pytest.raises(UnusableLogsError) as raised:
        next(reduce_data_sets([DataSet(place / "robot.toml", [place / "logs"])]))
    require_all_told(raised.value)
    with pytest.raises(UnusableLogsError) as raised:
        validate_estimate(place / "robot.toml", place / "estimate.json", str(place / "logs"))
    require_all_told(raised.value)


def test_one_log_is_refused_as_ever(place: Path) -> None:
    damage(place)
    for reduction in (None, LogReduction()):
        with pytest.raises(sy.errors.InputError, match=r"run5\.csv, line 3, goes back in time") as raised:
            sy.identify(place / "robot.toml", str(place / "logs" / "run5.csv"), reduction=reduction)
        assert not isinstance(raised.value, UnusableLogsError)
        assert raised.value.lines == (str(raised.value),)


@pytest.mark.slow
def test_what_was_read_is_kept_and_read_no_more(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (place / "robot.toml").write_text((place / "robot.toml").read_text() + "velocity_threshold = 0.0\n")
    undisturbed = sy.identify(place / "robot.toml", str(place / "logs"), reduction=LogReduction())
    whole = damage(place)
    read: list[str] = []
    reduced = log_reader.LogReader.reduced

    def counted(self: Any, task: Any, model: Any) -> Any:
        read.append(Path(str(task.log)).name)
        return reduced(self, task, model)

    monkeypatch.setattr(log_reader.LogReader, "reduced", counted)
    with Checkpoints(place / "out") as kept:
        with pytest.raises(UnusableLogsError):
            sy.identify(place / "robot.toml", str(place / "logs"), reduction=LogReduction(checkpoints=kept))
        assert sorted(read) == [f"run{number}.csv" for number in range(1, 6)]
        assert len(kept.names) == 2
        for name, text in whole.items():
            (place / "logs" / name).write_text(text)
        read.clear()
        again = sy.identify(place / "robot.toml", str(place / "logs"), reduction=LogReduction(checkpoints=kept))
    assert sorted(read) == list(BAD)
    np.testing.assert_array_equal(again.estimate.parameters, undisturbed.estimate.parameters)


def test_groups_of_many_logs_tell_all_of_theirs(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_reduction, "MANY", 1)
    monkeypatch.setattr(log_reduction, "GROUP", 3)
    damage(place)
    with Checkpoints(place / "out") as kept:
        with pytest.raises(UnusableLogsError) as raised:
            sy.identify(place / "robot.toml", str(place / "logs"), reduction=LogReduction(checkpoints=kept))
        assert not kept.names  # neither group is whole
    require_all_told(raised.value)


def test_sections_that_cannot_be_used_are_told_with_other_logs(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Long logs are opened in this process, and their sections are reduced in others."""
    monkeypatch.setattr(log_reduction, "LARGE", 1)
    monkeypatch.setattr(log_reduction, "SHARED_PART", 0.0)
    monkeypatch.setattr(log_reduction, "_rows_of_text", lambda path: 1e9)
    monkeypatch.setattr(chunks, "SECTION_ROWS", 100)
    damage(place)
    with pytest.raises(UnusableLogsError) as raised:
        sy.identify(place / "robot.toml", str(place / "logs"), reduction=LogReduction())
    require_all_told(raised.value)


ODD: dict[str, Callable[[Path], object]] = {
    "vanishes": lambda path: None,
    "pipe": lambda path: os.mkfifo(path),
    "link to itself": lambda path: path.symlink_to(path),
    "link to another": lambda path: path.symlink_to("run1.csv"),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
@pytest.mark.parametrize("kind", ODD)
def test_what_is_no_file_is_one_of_them(place: Path, kind: str) -> None:
    damage(place)
    (place / "logs" / "run4.csv").unlink()
    ODD[kind](place / "logs" / "run4.csv")
    logs = [str(place / "logs" / f"run{number}.csv") for number in range(1, 6)]
    with Checkpoints(place / "out") as kept, pytest.raises(UnusableLogsError) as raised:
        sy.identify(place / "robot.toml", logs, reduction=LogReduction(checkpoints=kept))
    assert ["run2.csv" in raised.value.lines[1], "run5.csv" in raised.value.lines[-1]] == [True, True]
    assert raised.value.count == len(logs)
    assert len(raised.value.reasons) == (2 if kind == "link to another" else 3)


def test_the_refusal_is_bounded_and_names_are_harmless() -> None:
    reasons = {f"a\n{number}\x1b[2J.csv": "9" * 5000 for number in range(1000)}
    error = UnusableLogsError(reasons, 2000)
    assert len(error.lines) == 12
    assert error.lines[0] == "1000 of 2000 logs cannot be used; mend them, or leave them out:"
    assert error.lines[-1] == "And 990 more."
    assert len(str(error)) <= 12_000
    assert "\x1b" not in str(error)
    same = pickle.loads(pickle.dumps(error))
    assert (str(same), same.reasons, same.count) == (str(error), reasons, 2000)
    assert UnusableLogsError({"a.csv": "it is empty."}, 3).lines[0].endswith("mend it, or leave it out:")


def test_the_command_tells_a_line_each(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    damage(place)
    command = ["identify", str(place / "robot.toml"), str(place / "logs"), "-q", "-o", str(place / "out")]
    monkeypatch.setattr("sys.argv", ["steelyard", *command])
    with pytest.raises(SystemExit) as ended:
        main()
    told = capsys.readouterr()
    assert (ended.value.code, told.out) == (2, "")
    head, *lines = told.err.splitlines()
    assert head == "steelyard: 3 of 5 logs cannot be used; mend them, or leave them out:"
    assert [name in line for name, line in zip(BAD, lines, strict=True)] == [True] * 3


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="as for the other clusters")
@pytest.mark.filterwarnings("ignore")
def test_processes_and_a_cluster_tell_the_same(place: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    damage(place)
    with pytest.raises(UnusableLogsError) as raised:
        sy.identify(place / "robot.toml", str(place / "logs"), reduction=LogReduction(Workers(2)))
    require_all_told(raised.value)
    with dask_workers(tmp_path, 2) as (address, _):
        reduction = LogReduction(sy.fleet.Cluster(address))
        with pytest.raises(UnusableLogsError) as raised:
            sy.identify(place / "robot.toml", str(place / "logs"), reduction=reduction)
        require_all_told(raised.value)
        (place / "robot.toml").write_text((place / "robot.toml").read_text() + "velocity_threshold = 0.0\n")
        with pytest.raises(UnusableLogsError) as raised:  # nothing was read here
            sy.identify(place / "robot.toml", str(place / "logs"), reduction=reduction)
        require_all_told(raised.value)
        on_worker = f"On a worker of the cluster at {address}: "
        assert all(line.startswith(on_worker) for line in raised.value.lines[1:])
        with pytest.raises(sy.errors.InputError, match=rf"^{re.escape(on_worker)}.*run5\.csv"):
            sy.identify(place / "robot.toml", str(place / "logs" / "run5.csv"), reduction=reduction)
