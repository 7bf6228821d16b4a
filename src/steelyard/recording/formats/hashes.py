"""Hashes of logs, by which a log is known again."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from steelyard.errors import InputError
from steelyard.files import file_hash

from .registry import REMEDY, STANDARD_INPUT, split_source, written_meanwhile, written_states
from .standard_input import standard_input

__all__ = ["LogContent", "content_hash", "content_hashes", "contents_of", "hashed_log", "unchanged"]

SETTLED = 2.0
"""s since a file was last written, after which it is read for its hash once in a process, as long as its size and times
stay the same. What is written meanwhile has other times then, also where a file system tells them to the second: git
takes files of its index for unchanged by this rule."""


def hashed_log(source: str | Path) -> list[dict[str, str]]:
    """Return the path and the SHA-256 hash of each file of a log that exists; for a bag's folder that of all its files.

    Of an object in an object store also its size, and its entity tag in place of the hash where the store has one.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "log.csv"
    >>> _ = path.write_text("t,q1,tau1")
    >>> [entry["sha256"][:8] for entry in hashed_log(path)]
    ['2cb94f02']
    """
    if "://" in str(source):
        from .remote import remote_identity  # what is not asked for is not loaded

        return [remote_identity(str(source))]
    files = [path for path in split_source(source) if isinstance(path, Path)]
    paths = [path for path in files if str(path) == STANDARD_INPUT or os.path.exists(path)]
    return [{"path": str(path), "sha256": _hash(path)} for path in paths]


def content_hash(entry: Mapping[str, str]) -> str:
    """Return what tells the content of a file that `hashed_log` found: its hash, or what an object store has for one.

    Examples
    --------
    >>> content_hash({"path": "s3://robots/run1.parquet", "size": "12", "etag": "9b2c"})
    '9b2c'
    """
    return entry["sha256"] if "sha256" in entry else entry["etag"]


def content_hashes(log: str) -> tuple[str, ...]:
    """Return what tells the contents of the files of a log, see `content_hash`."""
    return tuple(map(content_hash, hashed_log(log)))


class LogContent(NamedTuple):
    """What a log holds, and what tells without reading it that it still does.

    Attributes
    ----------
    hashes : tuple of str
        What `content_hash` tells of each of its files.
    state : str
        Changes when one of its files is written; of an object in an object store, when its content is another.
    """

    log: str
    hashes: tuple[str, ...]
    state: str


def contents_of(logs: Iterable[str]) -> list[LogContent]:
    """Return what logs hold now; of one that cannot be read nothing, as its reader says why."""
    return [_content(log) for log in logs]


def _content(log: str) -> LogContent:
    try:
        if "://" in log:  # what an object store tells of an object is its state, too; each question is a request
            entries = hashed_log(log)
            return LogContent(log, tuple(map(content_hash, entries)), _state_of_objects(entries))
        state = _state(log)  # first: what is written while it is hashed has another state afterwards
        return LogContent(log, content_hashes(log), state)
    except (InputError, OSError):
        return LogContent(log, (), "")


@contextmanager
def unchanged(contents: Iterable[LogContent]) -> Iterator[None]:
    """Make sure that logs which are read in a ``with`` block hold what they did when they were hashed.

    What is made of a log is kept under its hash: rows of another content would be taken for its own by all later runs.
    A log is hashed again only where its state is another one, as that of a copy on another machine is.

    Raises
    ------
    InputError
        If one does not; on leaving, if one was written meanwhile. What was removed meanwhile, was read.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "log.csv"
    >>> _ = path.write_text("t,q1,tau1")
    >>> with unchanged(contents_of([str(path)])):
    ...     _ = path.write_text("t,q1,tau1,tau2")
    Traceback (most recent call last):
    steelyard.errors.InputError: ...log.csv was written while it was read, as are logs of a robot that still moves; ...
    """
    before = []
    for one in contents:
        state = _state(one.log)
        before.append((one.log, state))
        # Where there is none now, its reader says so.
        if state and state != one.state and _content(one.log).hashes != one.hashes:
            raise InputError(
                f"{one.log} is not what it was when the run began: it was written meanwhile, or workers have other "
                "files of this name; wait until it is complete, give each the same files, and run again."
            )
    yield
    for log, state in before:
        if _state(log) not in (state, ""):
            raise written_meanwhile(log)


def _state(log: str) -> str:
    if "://" not in log:
        state = written_states([log])[log]
        return "" if state is None else repr(state)
    try:
        return _state_of_objects(hashed_log(log))
    except InputError:
        return ""


def _state_of_objects(entries: Iterable[Mapping[str, str]]) -> str:
    return repr([sorted(entry.items()) for entry in entries])


def _hash(path: Path) -> str:
    if str(path) == STANDARD_INPUT:
        path = standard_input()
    if path.is_dir():
        digest = hashlib.sha256()
        for one in sorted(path.iterdir()):
            if one.is_file():
                digest.update(f"{one.name}\0{_hash(one)}\0".encode())
        return digest.hexdigest()
    known = path.stat()
    if time.time() - max(known.st_mtime, known.st_ctime) < SETTLED:
        return file_hash(path, remedy=REMEDY)
    return _hash_of_settled(path, known.st_ino, known.st_size, known.st_mtime_ns, known.st_ctime_ns)


@lru_cache(maxsize=100_000)
def _hash_of_settled(path: Path, *unchanged: int) -> str:
    return file_hash(path, remedy=REMEDY)
