"""A log that comes through the standard input."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from threading import Lock

from steelyard.errors import InputError
from steelyard.files.writing import kept_folder

from .decoded import large_files

__all__ = ["standard_input"]

_BEGINNINGS = {
    b"PAR1": ".parquet",
    b"ARROW1": ".arrow",
    b"\xff\xff\xff\xff": ".arrow",
    b"PK\x03\x04": ".npz",
    b"\x89HDF\r\n\x1a\n": ".h5",
    b"MATLAB ": ".mat",
    b"#ROSBAG": ".bag",
    b"SQLite format 3\0": ".db3",
    b"\x89MCAP0\r\n": ".mcap",
    b"\x1f\x8b": ".csv.gz",
    b"BZh": ".csv.bz2",
    b"\xfd7zXZ\0": ".csv.xz",
    b"\x28\xb5\x2f\xfd": ".csv.zst",
}
"""The first bytes of files, by which their format is told; everything else is a text."""


class _Spool:
    """The copy of the standard input, which is read many times, in a folder that goes with the process."""

    path: Path | None = None
    lock = Lock()


def standard_input() -> Path:
    """Copy the standard input to a temporary file, the first time, and return its path.

    Raises
    ------
    InputError
        Where nothing is piped into it.
    """
    with _Spool.lock:
        if _Spool.path is None:
            _Spool.path = _spooled()
        return _Spool.path


def _spooled() -> Path:
    stream = sys.stdin
    if stream is None or stream.closed or stream.isatty():
        raise InputError(
            "- stands for the standard input, and nothing is piped into it; give the path of a log, or pipe one, "
            "as in `ssh robot cat run.csv | steelyard identify robot.toml - -o result`."
        )
    place = large_files()
    folder, remove = kept_folder(_Spool, place / "steelyard-input")
    copy = folder / "copy"
    try:
        with copy.open("wb") as file:
            shutil.copyfileobj(stream.buffer, file)
    except OSError as error:
        remove()
        raise InputError(
            f"the standard input cannot be copied to {place} ({error.strerror or error}); make room there, set TMPDIR "
            "to another folder, or give the path of the log."
        ) from None
    with copy.open("rb") as file:
        begin = file.read(16)
    suffix = next((suffix for bytes_, suffix in _BEGINNINGS.items() if begin.startswith(bytes_)), ".csv")
    return copy.rename(folder / f"standard-input{suffix}")
