"""Logs that are read in pieces: the same numbers as whole logs, whatever the format and wherever the pieces end."""

import gzip
import os
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.files import watched
from steelyard.files.advance import ahead
from steelyard.recording import Processing, Recording, Samples, chunks, process_chunks
from steelyard.recording.formats import LogFiles, csv_file, decoded
from steelyard.recording.formats.csv_file import CsvFile

RATE, PIECE = 500.0, 2000
FILTERS: dict[str, dict[str, Any]] = {
    "none": {"cutoff": None},
    "butterworth": {"cutoff": 30.0, "order": 2, "trim": 0.1},
    "torques": {"cutoff": 40.0, "order": 4, "torque_cutoff": 60.0, "velocity_threshold": 0.3},
    "savitzky-golay": {"filter": {"kind": "savitzky_golay", "window": 0.15, "degree": 5}},
    "kalman": {"filter": {"kind": "kalman"}, "cutoff": 30.0},
    "measured": {"cutoff": 30.0, "velocity": "measured"},
    "decimated": {"cutoff": 30.0, "decimate": [3, 2], "trim": (0.05, 0.0)},
    "delayed": {"cutoff": 30.0, "delay": 0.0131},
    "saturated": {"cutoff": 30.0, "saturation": 1.2, "stiction": True, "repeated": True, "stuck_torque": True},
    "resampled": {"cutoff": 30.0, "resample": 620.0},
}


def recording(count: int) -> Recording:
    rng = np.random.default_rng(5)
    t = np.arange(count) / RATE
    angle = 2 * np.pi * np.array([[0.3, 0.4], [0.9, 0.7], [1.7, 1.4]]) * t[:, None, None] + rng.uniform(0, 6, (3, 2))
    velocity = (2 * np.pi * np.array([[0.3, 0.4], [0.9, 0.7], [1.7, 1.4]]) * np.cos(angle)).sum(axis=1)
    q = np.sin(angle).sum(axis=1) + 1e-4 * rng.normal(size=(count, 2))
    torque = np.cos(angle).sum(axis=1) + 0.1 * rng.normal(size=(count, 2))
    return Recording(t=t + 10.0, q=q, velocity=velocity, torque=torque)


def with_gaps(log: Recording) -> Recording:
    """Short and long gaps, some of them where a piece ends, and rows that are missing one by one."""
    rows = np.ones(log.count, dtype=bool)
    for start, stop in ((PIECE - 1, PIECE + 3), (2 * PIECE + 500, 2 * PIECE + 503), (3 * PIECE, 3 * PIECE + 200)):
        rows[start:stop] = False
    rows[[40, 7000, 7001]] = False
    return log.chosen(rows)


def require_same(parts: list[Samples], whole: Samples, tolerance: float = 1e-9) -> None:
    joined = Samples.joined(parts)
    for name in ("q", "dq", "ddq", "torque"):
        expected = getattr(whole, name)
        np.testing.assert_allclose(getattr(joined, name), expected, rtol=0, atol=tolerance * np.abs(expected).max())
    assert joined.t is not None
    np.testing.assert_allclose(joined.t, whole.t, rtol=0, atol=1e-9)
    assert (joined.mask is None) == (whole.mask is None)
    if whole.mask is not None:
        np.testing.assert_array_equal(joined.mask, whole.mask)


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let logs of seconds have borders inside: pieces, blocks and reads end at places that are no multiples."""
    monkeypatch.setattr(chunks, "PIECE_ROWS", PIECE)
    monkeypatch.setattr(chunks, "BLOCK_ROWS", 777)
    monkeypatch.setattr(csv_file, "READ", (997, 40_000))
    monkeypatch.setattr(decoded, "STORED_ROWS", 501)
    monkeypatch.setattr(decoded, "IN_MEMORY", 0)


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize(
    "case",
    [name if name == "butterworth" else pytest.param(name, marks=pytest.mark.slow) for name in FILTERS],
)
def test_filters_do_not_see_where_a_piece_ends(case: str, tmp_path: Path) -> None:
    """The last piece has a single row where nothing is trimmed; gaps lie across borders."""
    options = Processing.from_dict(FILTERS[case])
    log = recording(4 * PIECE + 1)
    for one in (log, with_gaps(log)):
        path = one.save(tmp_path / "log.csv")
        whole = Recording.read(path).process(options)
        require_same(list(process_chunks(path, processing=options, rows=1234)), whole)


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.slow
@pytest.mark.parametrize("rows", [1, 2, PIECE - 1, PIECE, PIECE + 1])
def test_samples_do_not_depend_on_the_size_of_the_chunks(rows: int, tmp_path: Path) -> None:
    log = with_gaps(recording(4 * PIECE + 1))
    options = Processing(cutoff=30.0, trim=0.0)
    path = log.save(tmp_path / "log.csv")
    parts = list(process_chunks(path, processing=options, rows=rows))
    assert {part.count for part in parts[:-1]} <= {rows}
    (reference,) = process_chunks(path, processing=options, rows=10**9)
    joined = Samples.joined(parts)
    for name in ("q", "dq", "ddq", "torque"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(reference, name))
    require_same(parts, Recording.read(path).process(options))


def formats() -> list[Any]:
    def fortran(log: Recording, path: Path, save: Callable[..., None] = np.savez) -> None:
        save(path, t=log.t, q=np.asfortranarray(log.q), dq=log.velocity, tau=np.asfortranarray(log.torque))

    def hdf5(log: Recording, path: Path) -> None:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            for name, values in log.arrays().items():
                file.create_dataset(name, data=values, chunks=True, compression="gzip" if name == "q" else None)

    def mat(log: Recording, path: Path) -> None:
        from scipy.io import savemat

        savemat(path, {name: np.atleast_2d(values.T) for name, values in log.arrays().items()}, do_compression=True)

    def zipped(log: Recording, path: Path) -> None:
        path.write_bytes(gzip.compress(log.save(path.with_name("plain.csv")).read_bytes(), 1))

    def arrow(log: Recording, path: Path) -> None:
        import polars as pl

        pl.read_parquet(log.save(path.with_suffix(".parquet"))).write_ipc(path)

    def saved(log: Recording, path: Path) -> None:
        log.save(path)

    slow = pytest.mark.slow
    return [
        pytest.param("log.npz", fortran, id="npz-fortran"),
        pytest.param("log.npz", lambda log, path: fortran(log, path, np.savez_compressed), id="npz-fortran-deflate"),
        pytest.param("log.h5", hdf5, id="hdf5", marks=slow),
        pytest.param("log.mat", mat, id="mat", marks=slow),
        pytest.param("log.csv.gz", zipped, id="csv.gz", marks=slow),
        pytest.param("log.feather", arrow, id="arrow", marks=slow),
        pytest.param("log.npz", saved, id="npz", marks=slow),
        pytest.param("log.parquet", saved, id="parquet", marks=slow),
    ]


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize(("name", "write"), formats())
def test_formats_are_read_in_parts(name: str, write: Callable[[Recording, Path], object], tmp_path: Path) -> None:
    log = recording(3 * PIECE + 1)
    path = tmp_path / name
    write(log, path)
    columns = {"velocity": "none"}
    options = Processing(cutoff=30.0, trim=0.2)
    require_same(
        list(process_chunks(path, columns, options, rows=1500)), replace(log, velocity=None).process(options), 1e-8
    )
    files = LogFiles(path)
    names = files.layout(2).names
    whole = files.read(names)
    for start in (0, 1, 776, 3 * PIECE):
        blocks = list(files.blocks_from(start, names, 777))
        assert {len(block[names[0]]) for block in blocks[:-1]} <= {777}
        for column in names:
            np.testing.assert_array_equal(np.concatenate([block[column] for block in blocks]), whole[column][start:])


@pytest.mark.parametrize("by_columns", [False, True])
def test_no_place_within_an_archive_is_sought(
    by_columns: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python 3.12.0 to 3.12.8, 3.13.0 and 3.13.1 then read the bytes of another array, see CPython's issue 127847."""

    def seek(*_: Any) -> int:
        raise AssertionError("a place within an archive was sought")

    log, path = recording(5000), tmp_path / "log.npz"
    np.savez(path, t=log.t, q=np.asarray(log.q, order="F" if by_columns else "C"), tau=log.torque)
    monkeypatch.setattr(zipfile.ZipExtFile, "seek", seek)
    found = next(LogFiles(path).blocks_from(3000, ["t", "q2", "tau1"], 100))
    for own, expected in zip(found.values(), (log.t, log.q[:, 1], log.torque[:, 0]), strict=True):
        np.testing.assert_array_equal(own, expected[3000:3100])


TEXTS = {
    "blanks": "t, q1 ,tau1\n 0.0,  1.5 ,\t2.0\n 0.1, 1.6 , 2.1 \n 0.2 ,1.7,2.2\n",
    "decimal comma": "t;q1;tau1\n0,0;1,5;2,0\n0,1;1,6;2,1\n0,2;1,7;2,2\n",
    "columns of blanks": "t  q1   tau1\r\n 0.0  1.5   2.0\r\n 0.1\t1.6   2.1  \r\n 0.2  1.7 2.2\r\n",
    "missing": "t,q1,tau1\n0.0,,2.0\n0.1,1.6,nan\n0.2,NA,2.2\n0.3,1.5\n",
    "first row is short": "t,q1,tau1\n0.0,1.5\n0.1,1.6,2.1\n0.2,1.7,2.2\n",
    "blank lines and comments": "t,q1,tau1\n0.0,1.5,2.0\n\n# stop\n0.1,,2.1\n   \n0.2,1.7,2.2\n\n",
    "dates": "t,q1,tau1\n2026-11-22 14:05:07.0,1.5,2.0\n2026-11-22 14:05:07.1,,2.1\n2026-11-22 14:05:07.2,1.7,2.2\n",
    "texts of several lines": 't,q1,tau1,note\n0.0,1.5,2.0,"a\nb"\n0.1,1.6,2,c\n0.2,1,2,"d\n\n, ""e"" "\n0.3,1,2,f\n',
    "quotes": 't,q1,tau1\n"0.0","1.5","2.0"\n"0.1","1.6","2.1"\n0.2,1.7,2.2\n',
}


@pytest.mark.parametrize("case", TEXTS)
def test_the_quick_way_through_a_text_is_the_careful_one(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the quick way takes, it takes as line by line; and wherever the bytes are cut."""
    path = tmp_path / "log.csv"
    path.write_bytes(TEXTS[case].encode())
    names = ("t", "q1", "tau1")
    with monkeypatch.context() as only:
        only.setattr(CsvFile, "_parse_quickly", lambda *_: None)
        careful = CsvFile(path).read(names)
    for size in (1, 30, 10_000):
        monkeypatch.setattr(csv_file, "READ", (size, size))
        file = CsvFile(path)
        for _ in range(2):  # what it learns of dates does not change what it reads
            read = file.read(names)
            for name in names:
                np.testing.assert_array_equal(read[name], careful[name])


def test_a_bad_line_is_named_wherever_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.csv"
    lines = ["t,q1,tau1", "# by hand", *(f"{k / 10},{k},1.0" for k in range(40))]
    for number, wrong, said in ((3, "0.0,abc,1.0", "'abc'"), (37, "3.4,34,1.0,7", "4 fields"), (42, "3.9,x,1", "'x'")):
        path.write_text("\n".join([*lines[: number - 1], wrong, *lines[number:]]) + "\n")
        for size in (1, 50, 200, 10_000):  # with 1, each line is the first of what is parsed
            monkeypatch.setattr(csv_file, "READ", (size, size))
            with pytest.raises(InputError, match=rf"line {number}, .*{said}"):
                list(process_chunks(path, processing=Processing(cutoff=1.0), joints=1))


def test_decoded_columns_are_the_same_without_room_for_them(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"t": np.arange(100.0), "q": np.arange(100.0) ** 2}

    def decode() -> Iterator[dict[str, np.ndarray]]:
        yield from ({name: array[a : a + 33] for name, array in values.items()} for a in range(0, 100, 33))

    def no_room(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(decoded, "STORED_ROWS", 7)
    in_memory = decoded.DecodedColumns(["t", "q"], decode)
    monkeypatch.setattr(decoded, "IN_MEMORY", 0)
    in_file = decoded.DecodedColumns(["t", "q"], decode)
    monkeypatch.setattr(decoded, "_write", no_room)
    nowhere = decoded.DecodedColumns(["t", "q"], decode)
    for one in (in_memory, in_file, nowhere):
        assert one.count == 100
        for start in (0, 1, 7, 50, 99):
            for names in (["t"], ["q", "t"]):
                blocks = list(one.blocks(start, names, 10))
                for name in names:
                    found = np.concatenate([block[name] for block in blocks])
                    np.testing.assert_array_equal(found, values[name][start:])


class Shared(dict[object, object]):
    """A dictionary from which other threads take the oldest entry whenever something is put into it."""

    def __setitem__(self, key: object, value: object) -> None:
        super().__setitem__(key, value)
        del self[next(super().__iter__())]

    def __iter__(self) -> Iterator[object]:
        return iter(["what another thread took meanwhile", *super().__iter__()])


def test_threads_may_take_each_others_decoded_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoded, "_DECODED", Shared())
    monkeypatch.setattr(decoded, "MOST_DECODED", 1)
    for number in range(3):
        assert decoded.decoded_once(tmp_path, number, lambda found=number: [found]) == [number]  # type: ignore[misc]


def test_a_forked_process_decodes_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would read from the file of its parent, which has one place for both."""
    first = decoded.decoded_once(tmp_path, "rows", list)
    assert decoded.decoded_once(tmp_path, "rows", list) is first
    monkeypatch.setattr(os, "getpid", lambda: -1)
    assert decoded.decoded_once(tmp_path, "rows", list) is not first


def test_what_reads_ahead_stops_with_its_consumer() -> None:
    done = []

    def items() -> Iterator[int]:
        try:
            yield from range(1000)
        finally:
            done.append(threading.current_thread().name)

    reading = ahead(items(), 2)
    assert [next(reading), next(reading)] == [0, 1]
    reading.close()  # type: ignore[attr-defined]
    assert done == ["steelyard reading ahead"]
    assert "steelyard reading ahead" not in {thread.name for thread in threading.enumerate()}

    def broken() -> Iterator[int]:
        yield 1
        raise InputError("row 2 is wrong")

    with pytest.raises(InputError, match="row 2"):
        list(ahead(broken(), 2))


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("what", ["decoding log.csv", "reading log.csv"])
def test_nothing_is_left_of_what_is_interrupted(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setenv("TMPDIR", str(place))
    monkeypatch.setattr(decoded.tempfile, "tempdir", str(place))
    path = recording(2 * PIECE).save(tmp_path / "log.csv")
    before = path.read_bytes()

    def stop(step: str, done: float, total: float | None, unit: str) -> None:
        if step == what and done > 100:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), watched(stop):
        list(process_chunks(path, processing=Processing(cutoff=30.0), rows=500))
    assert os.listdir(place) == []
    assert sorted(os.listdir(tmp_path)) == ["log.csv", "temporary"]
    assert path.read_bytes() == before
    assert "steelyard reading ahead" not in {thread.name for thread in threading.enumerate()}


MEASURE = """
import resource, sys
import numpy as np, polars, scipy.signal, scipy.interpolate
from steelyard.recording import Processing, Recording, process_chunks
small, log, resample = sys.argv[1:]
options = Processing(cutoff=5.0, trim=0.5, resample=float(resample) if resample else True)
peaks = []
for path in (small, log):
    count = sum(samples.count for samples in process_chunks(path, processing=options, rows=50_000))
    peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
print(count, *peaks)
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts resident memory in KiB")
@pytest.mark.parametrize("kind", ["csv", "parquet", "npz", "fortran", "deflate", "resampled"])
def test_memory_stays_that_of_some_pieces(kind: str, tmp_path: Path) -> None:
    """Of four times as many rows, 3.2 million of three joints or 180 MB, the peak is hardly higher.

    The shorter one is so long that everything is at work at the same time, and allocators keep what they do.
    """
    paths = []
    for count in (800_000, 3_200_000):
        t = np.arange(count) / 1000.0
        q = np.sin(t[:, None] * [1.0, 1.7, 2.3])
        log = {"t": t, "q": q, "tau": np.cos(t[:, None] * [1.0, 1.7, 2.3])}
        suffix = {"fortran": "npz", "deflate": "npz", "resampled": "parquet"}.get(kind, kind)
        path = tmp_path / f"{count}.{suffix}"
        if kind in ("fortran", "deflate"):
            arrays = {name: np.asfortranarray(values) for name, values in log.items()}
            (np.savez if kind == "fortran" else np.savez_compressed)(path, **arrays)
        else:
            Recording(t=t, q=q, torque=log["tau"]).save(path)
        paths.append(str(path))
    resample = "1250" if kind == "resampled" else ""
    done = subprocess.run([sys.executable, "-c", MEASURE, *paths, resample], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    count, small, large = map(float, done.stdout.split())
    assert count == pytest.approx(3_200_000 * (1.25 if resample else 1.0), rel=2e-3)
    assert large < small + 60.0, (small, large)
