"""Folders, patterns, partitions and object stores stand for logs, in an order that follows from their names."""

import contextlib
import errno
import gc
import io
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

import steelyard as sy
from steelyard.excitation import design
from steelyard.files import file_hash
from steelyard.identification import saved_result
from steelyard.identification.given import given_logs
from steelyard.recording.formats import content_hash, hashed_log, remote, standard_input
from steelyard.recording.formats.log_sets import is_log_set, logs_in
from steelyard.recording.formats.registry import LogFiles
from steelyard.report import fleet_results, results
from steelyard.report.simulation import SIMULATION_FILES

LOG = "t,q1,tau1\n" + "".join(f"{k / 100},{np.sin(k / 20)},{np.cos(k / 20)}\n" for k in range(60))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with partitions of two robots, and with much that is no log."""
    for name in (
        "robot=2/day=1/part-0.csv",
        "robot=10/day=1/part-10.csv",
        "robot=10/day=1/part-9.csv",
        "robot=10/day=1/_metadata.csv",
        "robot=10/day=1/.part-9.csv.crc",
        "robot=10/_temporary/part-1.csv",
        "robot=10/notes.md",
        "robot=10/old.csv.gz",
        "robot=10/backup.json.gz",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(LOG)
    return tmp_path


ALL = [
    "robot=2/day=1/part-0.csv",
    "robot=10/day=1/part-9.csv",
    "robot=10/day=1/part-10.csv",
    "robot=10/old.csv.gz",
]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", ALL),
        ("**/*", ALL),
        ("robot=10", ALL[1:]),
        ("robot=*/day=1/part-*.csv", ALL[:3]),
        ("**/part-?.csv", ALL[:2]),
        ("robot=10/day=1/part-[0-9].csv", ALL[1:2]),
    ],
)
def test_a_set_is_found_in_the_order_of_its_names(folder: Path, text: str, found: list[str]) -> None:
    given = str(folder / text)
    assert is_log_set(given)
    assert [Path(log).relative_to(folder).as_posix() for log in logs_in(given)] == found


def test_a_bag_is_one_log_and_a_name_like_a_pattern_too(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("")
    (tmp_path / "bag" / "bag_0.db3").write_text("")
    (tmp_path / "run[1].csv").write_text(LOG)
    assert not is_log_set(str(tmp_path / "bag"))
    assert not is_log_set(str(tmp_path / "run[1].csv"))
    assert logs_in(str(tmp_path)) == [str(tmp_path / "bag"), str(tmp_path / "run[1].csv")]


@pytest.mark.parametrize("pattern", ["*.csv", "**/*.csv", "run?.csv", "run[12].csv"])
def test_a_folder_with_a_name_like_a_pattern_can_be_searched(tmp_path: Path, pattern: str) -> None:
    for name in ("day [3]/run1.csv", "day [3]/run2.csv", "day 3/run1.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(LOG)
    assert logs_in(str(tmp_path / "day [3]" / pattern)) == [str(tmp_path / "day [3]" / f"run{n}.csv") for n in (1, 2)]
    assert logs_in(str(tmp_path / "day [23]" / pattern)) == [str(tmp_path / "day 3" / "run1.csv")]


def test_a_log_that_a_set_finds_again_counts_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    first = "robot=2/day=1/part-0.csv"
    logs, _ = given_logs([first, "robot=2", "robot=*/day=1/*.csv"], None)
    assert [Path(str(log)).as_posix() for log in logs] == ALL[:3]
    assert given_logs([first, first], None)[0] == (first, first)  # which says so itself


@pytest.mark.parametrize("text", ["empty", "empty/*.csv", "notes/*"])
def test_a_set_without_logs_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "read.me").write_text("")
    with pytest.raises(sy.InputError, match="stands for no log"):
        logs_in(str(tmp_path / text))


@pytest.mark.parametrize("text", ["logs", "logs/**", "logs/**/*.*"])
def test_results_among_the_logs_are_no_logs(tmp_path: Path, text: str) -> None:
    """So that `steelyard identify robot.urdf . --output result` can be run twice."""
    tables = {
        f"logs/result/{saved_result.RECORD}": (results.TABLE,),
        "logs/simulation/simulation.json": SIMULATION_FILES,
        f"logs/motion/{design.RECORD}": design.MOTION_FILES,
        f"logs/{fleet_results.RECORD}": fleet_results.FLEET_FILES,
    }
    for record, names in tables.items():
        (tmp_path / record).parent.mkdir(parents=True, exist_ok=True)
        for name in (record, *(os.path.join(os.path.dirname(record), name) for name in names)):
            (tmp_path / name).write_text("{}")
    own = [tmp_path / "logs" / name for name in ("mine/parameters.csv", "result/run.csv")]
    for path in own:
        path.parent.mkdir(exist_ok=True)
        path.write_text(LOG)
    assert logs_in(str(tmp_path / text)) == list(map(str, own))
    (asked_for,) = logs_in(str(tmp_path / "**" / SIMULATION_FILES[0]))
    assert asked_for == str(tmp_path / "logs" / "simulation" / SIMULATION_FILES[0])


def test_installed_packages_are_looked_through_once_for_all_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes some milliseconds: for each of 100 000 files that would be minutes."""
    asked = []
    monkeypatch.setattr("steelyard.extensions.entry_points", lambda **options: asked.append(options) or ())
    for number in range(20):
        (tmp_path / f"run{number}.csv").write_text(LOG)
        (tmp_path / f"picture{number}.png").write_text("")
    assert len(logs_in(str(tmp_path))) == 20
    assert len(asked) == 1


@pytest.mark.parametrize("text", ["bags", "bags/**", "bags/**/*"])
def test_what_is_in_a_bag_that_was_found_does_not_count_again(tmp_path: Path, text: str) -> None:
    (tmp_path / "bags" / "bag").mkdir(parents=True)
    (tmp_path / "bags" / "bag" / "metadata.yaml").write_text("")
    (tmp_path / "bags" / "bag" / "bag_0.mcap").write_text("")
    assert logs_in(str(tmp_path / text)) == [str(tmp_path / "bags" / "bag")]


@pytest.mark.skipif(os.name != "posix", reason="links need rights elsewhere")
@pytest.mark.parametrize("text", ["day", "day/**", "day/**/*.csv", "d*/**/run.csv", "**/run.csv"])
def test_links_to_folders_are_followed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    for name in ("day/one/run.csv", "elsewhere/run.csv"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(LOG)
    (tmp_path / "day" / "two").symlink_to(tmp_path / "elsewhere")
    for place in ("day", "day/one"):
        for number in range(3):
            (tmp_path / place / f"up{number}").symlink_to(tmp_path)  # endless with one, and hours with three
    if text.startswith("**"):
        monkeypatch.chdir(tmp_path / "day")
        assert logs_in(text) == ["one/run.csv", "two/run.csv"]
        return
    assert logs_in(str(tmp_path / text)) == [str(tmp_path / "day" / place / "run.csv") for place in ("one", "two")]


@pytest.fixture
def store(request: pytest.FixtureRequest) -> str:
    """Return the address of a folder of objects in memory."""
    fsspec = pytest.importorskip("fsspec")
    system = fsspec.filesystem("memory")
    base = f"/{abs(hash(request.node.name))}"
    for number in (2, 10):
        rows = {"t": np.arange(50) / 100, "q1": np.sin(np.arange(50) / number), "tau1": np.cos(np.arange(50) / 9)}
        with system.open(f"{base}/logs/run{number}.parquet", "wb") as file:
            pl.DataFrame(rows).write_parquet(file)
    with system.open(f"{base}/logs/_SUCCESS", "wb") as file:
        file.write(b"")
    return f"memory:/{base}"


def test_objects_are_read_as_files_are(store: str) -> None:
    logs = logs_in(f"{store}/logs")
    assert logs == logs_in(f"{store}/logs/*.parquet")
    assert [log.rpartition("/")[2] for log in logs] == ["run2.parquet", "run10.parquet"]
    recording = sy.Recording.read(logs[0], joints=1)
    np.testing.assert_array_equal(recording.q[:, 0], np.sin(np.arange(50) / 2))
    [identity] = hashed_log(logs[0])
    assert identity["path"] == logs[0]
    assert int(identity["size"]) > 400
    assert len(content_hash(identity)) == 64  # a store without entity tags
    assert content_hash({"path": "s3://a/b", "etag": "9b"}) == "9b"


def test_logs_in_an_archive_are_found_and_read(tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    with zipfile.ZipFile(tmp_path / "logs.zip", "w") as archive:
        for number in (2, 10):
            archive.writestr(
                f"day/run{number}.csv",
                "t,q1,tau1\n" + "".join(f"{k / 100},{number + k * k / 100},{k}\n" for k in range(50)),
            )
    logs = logs_in(f"zip://day/*.csv::{tmp_path}/logs.zip")
    assert logs == [f"zip://day/run{number}.csv::{tmp_path}/logs.zip" for number in (2, 10)]
    assert [float(sy.Recording.read(log, joints=1).q[0, 0]) for log in logs] == [2.0, 10.0]


@pytest.mark.skipif(os.name != "posix", reason="links need rights elsewhere")
def test_a_link_to_nothing_says_where_it_leads(tmp_path: Path) -> None:
    (tmp_path / "run.csv").symlink_to(tmp_path / "gone.csv")
    with pytest.raises(sy.InputError, match=r"run.csv does not exist, as it is a link to .*gone.csv; give"):
        sy.Recording.read(tmp_path / "run.csv")


@contextlib.contextmanager
def unreadable(path: Path) -> Iterator[None]:
    """Take away the rights to a path; whoever may read everything is nobody meanwhile."""
    mode, is_root = path.stat().st_mode, os.geteuid() == 0
    path.chmod(0)
    if is_root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if is_root:
            os.seteuid(0)
        path.chmod(mode)


@pytest.mark.skipif(os.name != "posix", reason="rights are those of POSIX")
def test_what_nobody_may_read_is_refused_and_not_left_out() -> None:
    with tempfile.TemporaryDirectory() as place:  # those of pytest are closed to others
        folder, inner = Path(place), Path(place, "inner")
        folder.chmod(0o755)
        inner.mkdir()
        for one in (folder, inner):
            (one / "run.csv").write_text(LOG)
        assert len(logs_in(place)) == 2
        with unreadable(inner):
            for attempt in (lambda: logs_in(place), lambda: sy.Recording.read(inner / "run.csv")):
                with pytest.raises(sy.InputError, match="Permission denied"):
                    attempt()
        with unreadable(inner / "run.csv"), pytest.raises(sy.InputError, match="Permission denied"):
            file_hash(inner / "run.csv")


def test_messages_name_the_object(store: str) -> None:
    fsspec = pytest.importorskip("fsspec")
    with pytest.raises(sy.InputError, match=r"^memory://.*absent.csv cannot be read \(there is no such object\)"):
        sy.Recording.read(f"{store}/absent.csv")
    with pytest.raises(sy.InputError, match="does not exist"):
        logs_in(f"{store}/absent.csv")
    with pytest.raises(sy.InputError, match="stands for no log"):
        logs_in(f"{store}/absent/*.csv")
    with fsspec.open(f"{store}/damaged.parquet", "wb") as file:
        file.write(b"PAR1 and no more")
    with pytest.raises(sy.InputError, match=r"^memory://.*damaged\.parquet"):
        sy.Recording.read(f"{store}/damaged.parquet")
    with pytest.raises(sy.InputError, match="nosuch:"):
        logs_in("nosuch://bucket/x.csv")


def test_one_object_counts_once_whatever_its_address(store: str, tmp_path: Path) -> None:
    whole, short = logs_in(f"{store}/logs"), f"{store}/logs/run2.parquet"
    assert whole[0].replace("///", "//") == short != whole[0]
    assert given_logs([short, f"{store}/logs"], None)[0] == (short, whole[1])
    assert given_logs([f"{store}/logs", short], None)[0] == tuple(whole)
    path = tmp_path / "run.csv"
    path.write_text(LOG)
    assert given_logs([str(path), f"file://{path}", f"local://{path}"], None)[0] == (str(path),)


@pytest.mark.parametrize(
    ("address", "hidden"),
    [
        ("sftp://robot:s3cr3t@host/run.csv", "sftp://robot:…@host/run.csv"),
        ("sftp://robot:pa:s3cr3t@host/run.csv", "sftp://robot:…@host/run.csv"),
        ("sftp://robot@arm:s3cr3t@host/run.csv", "sftp://robot@arm:…@host/run.csv"),
        ("zip://*.csv::ftp://robot:s3@cr3t@host/a.zip", "zip://*.csv::ftp://robot:…@host/a.zip"),
        ("https://:s3cr3t@host/run.csv", "https://:…@host/run.csv"),
    ],
)
def test_passwords_in_addresses_are_refused_and_not_told(address: str, hidden: str) -> None:
    pytest.importorskip("fsspec")
    for read in (logs_in, sy.Recording.read, hashed_log):
        with pytest.raises(sy.InputError) as caught:
            read(address)
        assert str(caught.value).startswith(f"{hidden} has a password")
        assert "cr3t" not in str(caught.value)


def test_an_object_that_changes_is_read_again(store: str) -> None:
    fsspec = pytest.importorskip("fsspec")
    address = f"{store}/changing.csv"
    for rows in (50, 40):
        with fsspec.open(address, "wb") as file:
            file.write("\n".join(LOG.splitlines()[: rows + 1]).encode())
        assert sy.Recording.read(address).count == rows


@pytest.mark.parametrize("broken", ["shorter", "changed"])
def test_an_object_that_is_not_read_whole_is_refused(store: str, monkeypatch: pytest.MonkeyPatch, broken: str) -> None:
    # A connection that ends early gives a text of fewer rows, which is a log as well.
    fsspec = pytest.importorskip("fsspec")
    system, address = fsspec.filesystem("memory"), f"{store}/long.csv"
    system.pipe(address, LOG.encode())
    opened = type(system).open

    def read(self: Any, path: str, *arguments: Any, **options: Any) -> Any:
        content = opened(self, path, *arguments, **options).read()
        if broken == "changed":
            monkeypatch.undo()
            system.pipe(address, content + b"0.6,0,1\n")
            return io.BytesIO(content)
        return io.BytesIO(content[:-40])

    monkeypatch.setattr(type(system), "open", read)
    with pytest.raises(sy.InputError, match=r"^memory://.*long\.csv was not read whole, or was changed meanwhile"):
        sy.Recording.read(address, joints=1)
    monkeypatch.undo()
    assert sy.Recording.read(address, joints=1).count == 60 + (broken == "changed")


def test_what_an_open_log_reads_stays_however_many_are_open(store: str) -> None:
    fsspec = pytest.importorskip("fsspec")
    addresses = [f"{store}/{number}.csv" for number in range(remote.MOST_COPIES + 3)]
    for number, address in enumerate(addresses):
        with fsspec.open(address, "w") as file:
            file.write(LOG.replace("q1", f"q{number}", 1))
    opened = [LogFiles(address) for address in addresses]
    for number, log in enumerate(opened):
        (block,) = log.blocks([f"q{number}"], 1000)
        np.testing.assert_allclose(block[f"q{number}"], np.sin(np.arange(60) / 20))
    assert LogFiles(addresses).name == " + ".join(f"{number}.csv" for number in range(len(addresses)))
    del opened, log
    gc.collect()
    remote.local_copy(f"{store}/logs/run2.parquet")
    assert len(remote._Copies.paths) <= remote.MOST_COPIES


def test_threads_that_copy_at_once_have_copies_of_their_own(store: str, monkeypatch: pytest.MonkeyPatch) -> None:
    fsspec = pytest.importorskip("fsspec")
    both, folder = threading.Barrier(2, timeout=0.2), remote._folder

    def slow() -> Path:
        with contextlib.suppress(threading.BrokenBarrierError):
            both.wait()
        return folder()

    monkeypatch.setattr(remote, "_folder", slow)
    found: dict[str, str] = {}

    def read(name: str) -> None:
        with fsspec.open(f"{store}/{name}.csv", "w") as file:
            file.write(name)
        found[name] = remote.local_copy(f"{store}/{name}.csv").read_text()

    threads = [threading.Thread(target=read, args=(name,)) for name in ("one", "two")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == {"one": "one", "two": "two"}


READERS = {
    "standard input": "from steelyard.recording.formats.standard_input import standard_input; standard_input()",
    "MATLAB": "from steelyard.recording.formats.mat_file import MatFile, Path; kept = MatFile(Path('log.mat'))",
}


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="only there it is known which process still uses a folder")
@pytest.mark.parametrize("reader", READERS)
def test_nothing_is_left_of_a_log_whose_reader_was_killed(reader: str, tmp_path: Path) -> None:
    place = tmp_path / "temporary"
    place.mkdir()
    savemat(tmp_path / "log.mat", {"t": np.arange(50.0), "q": np.zeros((50, 1)), "tau": np.zeros((50, 1))})
    for killed in (True, False):
        program = f"{READERS[reader]}\nimport os, signal\nif {killed}: os.kill(os.getpid(), signal.SIGKILL)"
        options: dict[str, Any] = {"cwd": tmp_path, "env": {**os.environ, "TMPDIR": str(place)}}
        command = [sys.executable, "-c", program]
        done = subprocess.run(command, input=LOG.encode(), capture_output=True, check=False, **options)
        assert done.returncode == (-signal.SIGKILL if killed else 0), done.stderr
        left = list(place.iterdir())
        assert len(left) == killed
        if killed:  # nobody else reads what may be confidential
            assert left[0].stat().st_mode & 0o077 == 0


def test_the_standard_input_that_finds_no_room_is_one_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class Stream(io.BytesIO):
        def read(self, *size: int | None) -> bytes:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=Stream(), closed=False, isatty=lambda: False))
    monkeypatch.setattr(standard_input._Spool, "path", None)
    with pytest.raises(
        sy.errors.InputError, match=r"cannot be copied to .* \(No space left on device\); make room there"
    ):
        standard_input.standard_input()
    assert list(tmp_path.iterdir()) == []


def test_the_standard_input_is_read_once_by_all_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    both = threading.Barrier(2, timeout=0.2)

    class Stream(io.BytesIO):
        def read(self, *size: int | None) -> bytes:
            with contextlib.suppress(threading.BrokenBarrierError):
                both.wait()
            return super().read(*size)

    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=Stream(LOG.encode()), closed=False, isatty=lambda: False))
    monkeypatch.setattr(standard_input._Spool, "path", None)
    found: list[Path] = []
    threads = [threading.Thread(target=lambda: found.append(standard_input.standard_input())) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found[0] == found[1]
    assert found[0].read_text() == LOG


def test_the_name_of_the_standard_input_is_read_like_its_sign(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = SimpleNamespace(buffer=io.BytesIO(LOG.encode()), closed=False, isatty=lambda: False)
    monkeypatch.setattr(sys, "stdin", stream)
    monkeypatch.setattr(standard_input._Spool, "path", None)
    assert sy.Recording.read("/dev/stdin").count == 60


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes in folders")
@pytest.mark.parametrize("name", ["pipe", "pipe.csv"])
def test_a_pipe_is_refused_with_the_way_to_read_it(tmp_path: Path, name: str) -> None:
    """A shell names one for the output of another command, as in `identify robot.urdf <(zcat run.gz)`."""
    os.mkfifo(tmp_path / name)
    with pytest.raises(sy.InputError, match=r"is a pipe, .* pipe it into the command and give -"):
        sy.Recording.read(tmp_path / name)


def test_addresses_without_fsspec_say_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(sy.MissingExtraError, match="pip install 'fsspec"):
        logs_in("s3://bucket/logs")


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="folders are locked by POSIX")
def test_copies_of_a_killed_process_go_with_the_next_one(tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    read = (
        "import sys, time, fsspec, steelyard as sy\n"
        "with fsspec.open('memory://a.csv', 'w') as file: file.write(sys.argv[1])\n"
        "print(sy.Recording.read('memory://a.csv').count, flush=True)\n"
        "time.sleep(float(sys.argv[2]))"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen([sys.executable, "-c", read, LOG, "60"], stdout=subprocess.PIPE, env=environment) as run:
        assert run.stdout is not None
        assert run.stdout.readline() == b"60\n"
        run.kill()
    time.sleep(0.1)
    assert len(list(tmp_path.iterdir())) == 1
    subprocess.run([sys.executable, "-c", read, LOG, "0"], env=environment, check=True, capture_output=True)
    assert list(tmp_path.iterdir()) == []


PACKED = ("run1.csv.7z", "run2.mat.gz", "run3.csv.Z", "day.zip", "day.tar")


@pytest.mark.parametrize("text", ["", "*", "**/*"])
def test_what_may_hold_logs_and_is_passed_over_is_told(tmp_path: Path, text: str) -> None:
    for name in (
        "run.csv",
        "run.csv.xz",
        "readme.md",
        "robot.urdf",
        "_old.zip",
        "notes.txt.md",
        "plot.png",
        "meta.json.gz",
    ):
        (tmp_path / name).write_text(LOG)
    told: list[str] = []
    assert [Path(log).name for log in logs_in(str(tmp_path / text), told)] == ["run.csv", "run.csv.xz"]
    assert told == []
    for name in PACKED:
        (tmp_path / name).write_text(LOG)
    assert len(logs_in(str(tmp_path / text), told)) == 2
    (sentence,) = told
    assert all(name in sentence for name in PACKED)
    assert (
        "were passed over, since of compressed logs only texts are read (.gz, .bz2, .xz, .lzma, .zst, .zstd)"
        in sentence
    )
    for name in ("run.csv", "run.csv.xz", *PACKED[1:]):
        (tmp_path / name).unlink()
    with pytest.raises(sy.InputError, match=r"for no log; \S*run1\.csv\.7z was passed over, .*; unpack it where"):
        logs_in(str(tmp_path / text))
