"""Objects of object stores: copied when they are read, and told apart by what the store knows of their content."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from pathlib import Path
from threading import Lock
from typing import Any

from steelyard.errors import InputError, require_package
from steelyard.files import file_hash
from steelyard.files.reading import find_password
from steelyard.files.writing import kept_folder

__all__ = ["local_copy", "object_address", "object_store", "remote_identity"]

MOST_COPIES = 4
"""Copies that a process keeps beside those that an open log reads: a log is opened several times."""


class _Copies:
    """The copies of a process, the one that was used last at the end, in a folder that goes with it."""

    folder: Path | None = None
    paths: dict[tuple[str, str], Path]  # by address and content
    holders: dict[Path, weakref.WeakSet[Any]]  # what reads a copy, which stays as long as any of them
    count = 0
    lock = Lock()  # of all of it


_Copies.paths, _Copies.holders = {}, {}


def object_store(address: str) -> tuple[Any, str]:
    """Return the file system of fsspec for an address, and the path in it.

    Raises
    ------
    InputError
        Where fsspec, or what it needs for such addresses, is not installed; and for an address with a password, which
        would stand in messages and results.
    """
    if found := find_password(address):
        hidden = f"{address[: found.start]}…{address[found.stop :]}"
        raise InputError(
            f"{hidden} has a password, which would stand in all that is written; keep it in the settings of fsspec, as "
            "FSSPEC_SFTP_PASSWORD in the environment is for sftp://."
        )
    fsspec = require_package("fsspec", "Addresses of object stores need", "remote")
    try:
        system, path = fsspec.core.url_to_fs(address)
    except ImportError as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{address} needs a package that is not installed ({reason}); install it.") from None
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{address} cannot be opened ({reason}); check the address.") from None
    return system, str(path)


def object_address(system: Any, path: str, address: str) -> str:
    """Return the address of an object in a store that was reached by another address: one object has one."""
    _, chained, outer = address.partition("::")  # such as an archive, zip://run*.csv::file:///logs.zip
    return f"{system.unstrip_protocol(path)}{chained}{outer}"


def local_copy(address: str, holder: object = None) -> Path:
    """Copy an object to a temporary file, unless it was just done, and return the path.

    The copy stays as long as `holder` does, and for some copies after it.

    Raises
    ------
    InputError
        If it does not exist, cannot be read whole, or changes meanwhile.
    """
    system, path = object_store(address)
    known = _known(system, path, address)
    key = address, str(sorted(known.items()))
    with _Copies.lock:
        if key in _Copies.paths:
            _Copies.paths[key] = found = _Copies.paths.pop(key)
            return _held(found, holder)
        idle = [one for one, path in _Copies.paths.items() if not _Copies.holders.get(path)]
        for oldest in idle[: max(0, len(idle) - MOST_COPIES + 1)]:
            path_of_oldest = _Copies.paths.pop(oldest)
            _Copies.holders.pop(path_of_oldest, None)
            shutil.rmtree(path_of_oldest.parent, ignore_errors=True)
        _Copies.count += 1
        copy = _folder() / str(_Copies.count) / os.path.basename(path)
    copy.parent.mkdir()
    try:
        with system.open(path, "rb") as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target, 1 << 20)
        size = str(copy.stat().st_size)
        if size != known.get("size", size) or known != _known(system, path, address):
            raise InputError(f"{address} was not read whole, or was changed meanwhile; read it again.")
    except Exception as error:
        shutil.rmtree(copy.parent, ignore_errors=True)
        raise error if isinstance(error, InputError) else _unreadable(address, error) from None
    with _Copies.lock:
        return _held(_Copies.paths.setdefault(key, copy), holder)


def _held(copy: Path, holder: object) -> Path:
    """Take note of what reads a copy; the lock is held."""
    if holder is not None:
        _Copies.holders.setdefault(copy, weakref.WeakSet()).add(holder)
    return copy


def remote_identity(address: str) -> dict[str, str]:
    """Return address, size, and what tells the content of an object: the store's entity tag, or else its hash.

    Raises
    ------
    InputError
        If it does not exist or cannot be read.
    """
    system, path = object_store(address)
    known = _known(system, path, address)
    told = {"path": address, "size": known.get("size", "")}
    if "etag" in known:
        return {**told, "etag": known["etag"]}
    return {**told, "sha256": file_hash(local_copy(address))}


def _known(system: Any, path: str, address: str) -> dict[str, str]:
    """Return what a store says of an object that changes with its content."""
    try:
        system.invalidate_cache()
        info = system.info(path)
    except Exception as error:
        raise _unreadable(address, error) from None
    if info.get("type") == "directory":
        raise InputError(f"{address} is a folder; give the address of a log, or of a folder to `steelyard identify`.")
    lower = {str(name).lower(): value for name, value in info.items()}
    named = {"etag": "etag", "md5hash": "etag", "size": "size", "created": "created", "mtime": "mtime"}
    return {kind: str(lower[name]).strip('"') for name, kind in named.items() if lower.get(name) is not None}


def _unreadable(address: str, error: Exception) -> InputError:
    reason = "there is no such object" if isinstance(error, FileNotFoundError) else " ".join(str(error).split())[:200]
    return InputError(f"{address} cannot be read ({reason or type(error).__name__}); check the address and who may.")


def _folder() -> Path:
    if _Copies.folder is None:
        _Copies.folder, _ = kept_folder(_Copies, Path(tempfile.gettempdir()) / "steelyard-objects")
    return _Copies.folder
