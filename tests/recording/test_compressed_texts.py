"""Texts that are compressed in any way that Python unpacks are read as the text itself, and never fill the memory."""

import bz2
import gzip
import io
import json
import lzma
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.recording import Recording, read_chunks
from steelyard.recording.formats import compressed_text, standard_input, unpacking
from steelyard.recording.formats.compressed_text import open_compressed
from steelyard.recording.formats.log_sets import logs_in

S = 3000
T = np.arange(S) / 250.0
ROWS = [",".join(map(repr, row)) for row in np.column_stack([T, np.sin(T), np.cos(3 * T)]).tolist()]
TEXT = ("t,q1,tau1\n" + "\n".join(ROWS) + "\n").encode()


def zstd(data: bytes) -> bytes:
    return bytes(pytest.importorskip(unpacking.ZSTD).compress(data))


COMPRESS: dict[str, Callable[[bytes], bytes]] = {
    "gz": gzip.compress,
    "bz2": bz2.compress,
    "xz": lzma.compress,
    "lzma": lambda data: lzma.compress(data, lzma.FORMAT_ALONE),
    "zst": zstd,
}


@pytest.fixture(params=COMPRESS)
def suffix(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_the_text_is_read_as_it_is_without(suffix: str, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_bytes(TEXT)
    path = tmp_path / f"run.csv.{suffix}"
    path.write_bytes(COMPRESS[suffix](TEXT))
    plain, found = Recording.read(tmp_path / "run.csv"), Recording.read(path)
    for name in ("t", "q", "torque"):
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name))
    chunks = [chunk.recording.q[chunk.start : chunk.stop] for chunk in read_chunks(path, rows=700)]
    np.testing.assert_array_equal(np.concatenate(chunks), plain.q)
    assert [Path(log).name for log in logs_in(str(tmp_path))] == ["run.csv", path.name]


def test_the_line_of_a_fault_is_told(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run.csv.{suffix}"
    path.write_bytes(COMPRESS[suffix](TEXT.replace(ROWS[2000].encode(), b"8.0,later,1")))
    with pytest.raises(InputError, match=r"line 2002, holds 'later' in column 'q1'"):
        Recording.read(path)


@pytest.mark.parametrize("suffix", ["gz", "bz2", "xz", "zst"])
def test_streams_that_follow_each_other_are_one(suffix: str, tmp_path: Path) -> None:
    """Loggers append, and parallel programs cut what they compress."""
    cut = TEXT.index(b"\n", 20_000) - 7
    joined = COMPRESS[suffix](TEXT[:cut]) + (b"\0" * 8 if suffix == "xz" else b"") + COMPRESS[suffix](TEXT[cut:])
    (tmp_path / f"run.csv.{suffix}").write_bytes(joined)
    assert Recording.read(tmp_path / f"run.csv.{suffix}").count == S


def test_what_is_cut_short_or_damaged_is_one_sentence(suffix: str, tmp_path: Path) -> None:
    whole = COMPRESS[suffix](TEXT)
    random, refused = np.random.default_rng(0), []
    for trial in range(20):
        damaged = bytearray(whole[: int(0.3 * len(whole)) + 100 * trial] if trial % 2 else whole)
        for place in random.integers(0, len(damaged), 3 * (trial % 2 == 0)):
            damaged[place] ^= 1 << int(random.integers(8))
        path = tmp_path / f"run{trial}.csv.{suffix}"
        path.write_bytes(damaged)
        try:
            Recording.read(path)
        except InputError as error:
            refused.append(str(error))
    for message in refused:
        assert f".csv.{suffix}" in message
        assert message.endswith(".")
        assert len(message.splitlines()) == 1
    assert len(refused) >= 15  # what follows the last row may be damaged, or a bit that nothing needs


def test_a_place_in_front_is_found_again(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run.csv.{suffix}"
    path.write_bytes(COMPRESS[suffix](TEXT))
    with open_compressed(path) as file:
        for place in (100, 70_000, 30, len(TEXT) - 5, 0, len(TEXT) + 10):
            file.seek(place)
            assert file.read(50) == TEXT[place : place + 50]


@pytest.mark.parametrize("suffix", [suffix for suffix in COMPRESS if suffix != "gz"])  # which makes 1032 bytes of one
def test_a_few_bytes_do_not_stand_for_gigabytes(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpacking, "LEAST", 2**20)
    monkeypatch.setattr(compressed_text, "RATIO", 10)
    path = tmp_path / f"run.csv.{suffix}"
    rows = b"".join(b"%d,0,0\n" % k for k in range(100)) + b"100,0,0\n" * 150_000
    path.write_bytes(COMPRESS[suffix](b"t,q1,tau1\n" + rows))
    with pytest.raises(InputError, match="unpacks to far more than a recording of its size holds"):
        Recording.read(path)


def test_a_header_does_not_ask_for_gigabytes(tmp_path: Path) -> None:
    data = bytearray(COMPRESS["lzma"](TEXT))
    data[1:5] = (2**31).to_bytes(4, "little")
    (tmp_path / "run.csv.lzma").write_bytes(data)
    with pytest.raises(InputError, match="needs more than 256 MiB of memory to unpack; compress it again"):
        Recording.read(tmp_path / "run.csv.lzma")


@pytest.mark.parametrize("suffix", ["gz", "bz2", "xz", "zst"])
def test_the_standard_input_may_be_compressed(suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class Stream:
        closed = False
        buffer = io.BytesIO(COMPRESS[suffix](TEXT))

        def isatty(self) -> bool:
            return False

    monkeypatch.setattr(standard_input._Spool, "path", None)
    monkeypatch.setattr("sys.stdin", Stream())
    assert Recording.read("-").count == S


READER = """
import json, resource, sys
from pathlib import Path
from steelyard.errors import SteelyardError
from steelyard.recording.chunks import LogStream
Path("/proc/self/clear_refs").write_text("5")
try:
    LogStream(sys.argv[1], None, 1)
    said = "it was read"
except SteelyardError as error:
    said = str(error)
(peak,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
print(json.dumps([said, 1024 * int(peak.split()[1])]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "content"), [("bz2", "rows"), ("xz", "one line"), ("zst", "blank lines")])
@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="nothing tells the peak of memory")
def test_a_bomb_is_refused_in_little_memory(suffix: str, content: str, tmp_path: Path) -> None:
    """A GB from some kB; with more of them it would be any number."""
    head = b"t,q1,tau1\n" + b"".join(b"%d,0,0\n" % k for k in range(200))
    part = {"rows": b"200,0,0\n", "one line": b"0", "blank lines": b"\n"}[content]
    many = COMPRESS[suffix](part * (2**25 // len(part)))
    path = tmp_path / f"run.csv.{suffix}"
    path.write_bytes(COMPRESS[suffix](head) + many * 40)
    environment: dict[str, Any] = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2] / "src")}
    done = subprocess.run(
        [sys.executable, "-c", READER, str(path)],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
        timeout=300,
    )
    said, peak = json.loads(done.stdout)
    assert "run.csv" in said
    assert said.endswith(".")
    assert peak < 2**30
