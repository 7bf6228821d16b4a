"""Hashes of files are those of their contents, also where a file is written again; what is settled is read once."""

import hashlib
import os
from pathlib import Path

import pytest

from steelyard.recording.formats import hashed_log, hashes


def sha256(path: Path) -> str:
    [entry] = hashed_log(path)
    return entry["sha256"]


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files that are read for their hashes."""
    found: list[Path] = []

    def counted(path: Path, **options: str) -> str:
        found.append(path)
        return hashlib.sha256(path.read_bytes()).hexdigest()

    monkeypatch.setattr(hashes, "file_hash", counted)
    return found


def test_a_file_that_is_written_again_at_once_has_another_hash(tmp_path: Path, reads: list[Path]) -> None:
    path = tmp_path / "log.csv"
    for content in (b"1,2", b"1,3", b"1,4"):
        path.write_bytes(content)
        os.utime(path, (1e9, 1e9))  # as tools do that keep times
        assert sha256(path) == sha256(path) == hashlib.sha256(content).hexdigest()
    assert len(reads) == 6


def test_a_settled_file_is_read_once_until_it_is_written(
    tmp_path: Path, reads: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"1,2")
    written = max(path.stat().st_mtime, path.stat().st_ctime)
    monkeypatch.setattr("time.time", lambda: written + hashes.SETTLED + 1.0)
    assert sha256(path) == sha256(path)
    assert reads == [path]
    path.write_bytes(b"1,2,3")
    assert sha256(path) == hashlib.sha256(b"1,2,3").hexdigest()
    assert reads == [path, path]
