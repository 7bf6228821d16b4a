"""Formats of logs that others add: what they need, how they are found, and what is said where they fail."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from steelyard.errors import InputError
from steelyard.recording import LogFile, Processing, Recording, process_chunks, read_chunks, register_log_format
from steelyard.recording.formats import registry

T = np.arange(4000) / 200
Q = np.column_stack([np.sin(1.3 * T), np.cos(0.9 * T)])
TORQUE = np.column_stack([np.cos(T), np.sin(2.0 * T)])
MODULE = """
from scipy.io import loadmat
from steelyard.recording import LogFile

class MatLog(LogFile):
    suffixes = (".mat",)

    def __init__(self, path):
        super().__init__(path)
        self.names = ("t", "q1", "q2", "tau1", "tau2")
        self.rows = loadmat(path)["log"]

    def read(self, names):
        return {name: self.rows[:, self.names.index(name)] for name in names}
"""


@pytest.fixture(autouse=True)
def own_table() -> Iterator[None]:
    """Begin with our own formats, and leave the table as it was."""
    before = list(registry.FORMATS)
    registry.FORMATS[:] = [registry.CsvFile, registry.ParquetFile, registry.NpzFile]
    yield
    registry.FORMATS[:] = before


class RawLog(LogFile):
    """Rows of doubles t, q1, q2, tau1, tau2, with the least that a format must have."""

    suffixes = (".raw",)

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.names = ("t", "q1", "q2", "tau1", "tau2")

    def read(self, names):
        rows = np.fromfile(self.path).reshape(-1, 5)
        return {name: rows[:, self.names.index(name)] for name in names}


def install(folder: Path, monkeypatch: pytest.MonkeyPatch, target: str, source: str = MODULE) -> None:
    """Put a package that offers a format where Python finds it."""
    (folder / "mat_logs.py").write_text(source)
    info = folder / "mat_logs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mat-logs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[steelyard.log_formats]\nmat = {target}\n")
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, "mat_logs", raising=False)
    importlib.invalidate_caches()


def test_least_format_reads_whole_and_in_chunks(tmp_path: Path) -> None:
    register_log_format(RawLog)
    path = tmp_path / "log.RAW"
    np.column_stack([T, Q, TORQUE]).tofile(path)
    recording = Recording.read(path, joints=2)
    np.testing.assert_array_equal(recording.t, T)
    np.testing.assert_array_equal(recording.q, Q)
    np.testing.assert_array_equal(recording.torque, TORQUE)
    chunks = list(read_chunks(path, rows=700))
    np.testing.assert_array_equal(np.vstack([c.recording.torque[c.start : c.stop] for c in chunks]), TORQUE)
    processing = Processing(cutoff=10.0)
    whole = recording.process(processing)
    pieces = list(process_chunks(path, processing=processing, rows=900))
    np.testing.assert_allclose(np.vstack([piece.ddq for piece in pieces]), whole.ddq, atol=1e-8)


def test_beside_a_file_of_ours(tmp_path: Path) -> None:
    register_log_format(RawLog)
    np.column_stack([T, Q, TORQUE]).tofile(tmp_path / "log.raw")
    np.savez(tmp_path / "more.npz", dq=np.gradient(Q, T, axis=0))
    both = Recording.read([tmp_path / "log.raw", tmp_path / "more.npz"])
    np.testing.assert_array_equal(both.velocity, np.gradient(Q, T, axis=0))


def test_installed_package_adds_a_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"log": np.column_stack([T, Q, TORQUE])})
    with pytest.raises(InputError, match=r"suffix '\.mat'; logs are read from \.csv"):
        Recording.read(path)
    install(tmp_path, monkeypatch, "mat_logs:MatLog")
    np.testing.assert_array_equal(Recording.read(path).q, loadmat(path)["log"][:, 1:3])
    # It is only read.
    with pytest.raises(InputError, match=r"saved as \.csv, \.parquet or \.npz"):
        Recording.read(path).save(tmp_path / "again.mat")
    assert not (tmp_path / "again.mat").exists()


@pytest.mark.parametrize(
    ("target", "source", "phrase"),
    [
        ("mat_logs:Absent", MODULE, "package mat-logs adds, cannot be loaded"),
        ("mat_logs:MatLog", "raise RuntimeError('no licence')", "RuntimeError: no licence"),
        ("mat_logs:loadmat", MODULE, "no format of logs"),
    ],
)
def test_broken_package_is_named(target, source, phrase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, target, source)
    path = tmp_path / "log.mat"
    path.write_bytes(b"anything")
    with pytest.raises(InputError, match=phrase):
        Recording.read(path)
    # Logs of our formats are read all the same.
    saved = Recording(t=T, q=Q, torque=TORQUE).save(tmp_path / "log.csv")
    np.testing.assert_array_equal(Recording.read(saved).q, Q)


def test_saves_where_it_can_write(tmp_path: Path) -> None:
    @register_log_format
    class Written(RawLog):
        suffixes = (".raw2",)
        saved_as = ".raw2"

        @classmethod
        def write(cls, file, arrays):
            np.column_stack([arrays["t"], arrays["q"], arrays["tau"]]).tofile(file)

    path = Recording(t=T, q=Q, torque=TORQUE).save(tmp_path / "log.raw2")
    np.testing.assert_array_equal(np.fromfile(path).reshape(-1, 5)[:, 3:], TORQUE)
    np.testing.assert_array_equal(Recording.read(path).torque, TORQUE)


@pytest.mark.parametrize(
    ("read", "phrase"),
    [
        (lambda names: {}, "log.broken cannot be read .KeyError"),
        (lambda names: {name: np.zeros((5, 1)) for name in names}, r"Broken, gave columns of the shapes \(5, 1\)"),
        (lambda names: {name: np.zeros(5 + k) for k, name in enumerate(names)}, r"shapes \(5,\), \(6,\)"),
        (lambda names: {name: ["a"] for name in names}, "log.broken cannot be read .ValueError"),
        (lambda names: 1 / 0, "log.broken cannot be read .ZeroDivisionError"),
    ],
)
def test_what_a_format_does_wrong_is_said(read, phrase, tmp_path: Path) -> None:
    @register_log_format
    class Broken(LogFile):
        suffixes = (".broken",)

        def __init__(self, path):
            super().__init__(path)
            self.names = ("t", "q1", "tau1")

        def read(self, names):
            return read(names)

    path = tmp_path / "log.broken"
    path.write_bytes(b"1")
    with pytest.raises(InputError, match=phrase):
        Recording.read(path)
    with pytest.raises(InputError):
        list(read_chunks(path))


def test_classes_that_are_no_formats_are_refused() -> None:
    with pytest.raises(InputError, match="no format of logs"):
        register_log_format(dict)  # type: ignore[type-var]

    class Nameless(RawLog):
        suffixes = ()

    with pytest.raises(InputError, match="has the suffixes"):
        register_log_format(Nameless)

    class Csv(RawLog):
        suffixes = (".raw", ".csv")

    with pytest.raises(InputError, match=r"formats Csv and CsvFile both claim \.csv"):
        register_log_format(Csv)
    assert register_log_format(RawLog) is register_log_format(RawLog)
    assert registry.FORMATS.count(RawLog) == 1
