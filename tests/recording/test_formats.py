"""Formats of logs that others add: what they need, how they are found, and what is said where they fail."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from steelyard.errors import InputError
from steelyard.extensions import register
from steelyard.recording import LogFile, Processing, Recording, process_chunks, read_chunks
from steelyard.recording.formats.registry import LOG_FORMATS

T = np.arange(4000) / 200
Q = np.column_stack([np.sin(1.3 * T), np.cos(0.9 * T)])
TORQUE = np.column_stack([np.cos(T), np.sin(2.0 * T)])
MODULE = """
from scipy.io import loadmat
from steelyard.recording import LogFile

class MatLog(LogFile):
    def __init__(self, path):
        super().__init__(path)
        self.names = ("t", "q1", "q2", "tau1", "tau2")
        self.rows = loadmat(path)["log"]

    def read(self, names):
        return {name: self.rows[:, self.names.index(name)] for name in names}
"""


@pytest.fixture(autouse=True)
def own_table(no_extensions: None) -> None:
    """Begin with our own formats."""


class RawLog(LogFile):
    """Rows of doubles t, q1, q2, tau1, tau2, with the least that a format must have."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.names = ("t", "q1", "q2", "tau1", "tau2")

    def read(self, names):
        rows = np.fromfile(self.path).reshape(-1, 5)
        return {name: rows[:, self.names.index(name)] for name in names}


def test_least_format_reads_whole_and_in_chunks(tmp_path: Path) -> None:
    register("log_formats", "raw", RawLog)
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
    register("log_formats", "raw", RawLog)
    np.column_stack([T, Q, TORQUE]).tofile(tmp_path / "log.raw")
    np.savez(tmp_path / "more.npz", dq=np.gradient(Q, T, axis=0))
    both = Recording.read([tmp_path / "log.raw", tmp_path / "more.npz"])
    np.testing.assert_array_equal(both.velocity, np.gradient(Q, T, axis=0))


def test_installed_package_adds_a_format(tmp_path: Path, install: Callable[..., None]) -> None:
    path = tmp_path / "log.ROWS"
    savemat(path, {"log": np.column_stack([T, Q, TORQUE])}, appendmat=False)
    with pytest.raises(InputError, match=r"suffix '\.ROWS'; logs are read from \.csv"):
        Recording.read(path)
    install("logs", "log_formats", {"rows": "of_logs:MatLog", "sick": "nowhere:Format"}, MODULE)  # one ill, one well
    np.testing.assert_array_equal(Recording.read(path).q, loadmat(path)["log"][:, 1:3])
    # It is only read.
    with pytest.raises(InputError, match=r"saved as \.csv, \.parquet or \.npz"):
        Recording.read(path).save(tmp_path / "again.rows")
    assert not (tmp_path / "again.rows").exists()


@pytest.mark.parametrize(
    ("target", "source", "phrase"),
    [
        ("of_logs:Absent", MODULE, "The format of logs `rows` of logs cannot be loaded .AttributeError"),
        ("of_logs:MatLog", "raise RuntimeError('no licence')", "RuntimeError: no licence"),
        ("of_logs:loadmat", MODULE, "TypeError: expected a class derived from steelyard.recording.LogFile"),
    ],
)
def test_broken_package_is_named(target, source, phrase, tmp_path: Path, install: Callable[..., None]) -> None:
    install("logs", "log_formats", {"rows": target}, source)
    path = tmp_path / "log.rows"
    path.write_bytes(b"anything")
    with pytest.raises(InputError, match=phrase):
        Recording.read(path)
    # Logs of our formats are read all the same.
    saved = Recording(t=T, q=Q, torque=TORQUE).save(tmp_path / "log.csv")
    np.testing.assert_array_equal(Recording.read(saved).q, Q)


def test_saves_where_it_can_write(tmp_path: Path) -> None:
    class Written(RawLog):
        saved_as = ".raw2"

        @classmethod
        def write(cls, file, arrays):
            np.column_stack([arrays["t"], arrays["q"], arrays["tau"]]).tofile(file)

    register("log_formats", "raw2", Written)
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
    class Broken(LogFile):
        def __init__(self, path):
            super().__init__(path)
            self.names = ("t", "q1", "tau1")

        def read(self, names):
            return read(names)

    register("log_formats", "broken", Broken)
    path = tmp_path / "log.broken"
    path.write_bytes(b"1")
    with pytest.raises(InputError, match=phrase):
        Recording.read(path)
    with pytest.raises(InputError):
        list(read_chunks(path))


def test_classes_that_are_no_formats_are_refused() -> None:
    with pytest.raises(InputError, match="format of logs `raw` cannot be registered: expected a class derived from"):
        register("log_formats", "raw", dict)
    with pytest.raises(InputError, match=r"must be one word in lower case, got ''"):
        register("log_formats", "", RawLog)
    with pytest.raises(InputError, match="format of logs `csv` is one of Steelyard's own"):
        register("log_formats", "csv", RawLog)
    register("log_formats", "raw", RawLog)
    register("log_formats", "raw", RawLog)  # as when a cell of a notebook is run again
    assert list(LOG_FORMATS.names()).count("raw") == 1
