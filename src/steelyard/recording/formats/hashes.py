"""Hashes of logs, by which a log is known again."""

from __future__ import annotations

import hashlib
from pathlib import Path

from steelyard.files import file_hash

from .registry import STANDARD_INPUT, split_source
from .standard_input import standard_input

__all__ = ["hashed_log"]


def hashed_log(source: str | Path) -> list[dict[str, str]]:
    """Return the path and the SHA-256 hash of each file of a log that exists; for a bag's folder that of all its files.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "log.csv"
    >>> _ = path.write_text("t,q1,tau1")
    >>> [entry["sha256"][:8] for entry in hashed_log(path)]
    ['2cb94f02']
    """
    files = [path for path in split_source(source) if isinstance(path, Path)]
    paths = [path for path in files if str(path) == STANDARD_INPUT or path.exists()]
    return [{"path": str(path), "sha256": _hash(path)} for path in paths]


def _hash(path: Path) -> str:
    if str(path) == STANDARD_INPUT:
        path = standard_input()
    if path.is_dir():
        digest = hashlib.sha256()
        for one in sorted(path.iterdir()):
            if one.is_file():
                digest.update(f"{one.name}\0{_hash(one)}\0".encode())
        return digest.hexdigest()
    return file_hash(path)
