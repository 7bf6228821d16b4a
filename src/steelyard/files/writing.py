"""Writing of files that appear whole or not at all, whatever happens and whoever else writes them."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import stat
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from steelyard.errors import InputError

if os.name == "posix":
    import fcntl

__all__ = [
    "beside",
    "locked",
    "plain",
    "refusal",
    "remove_leftovers",
    "replaced_file",
    "synchronise",
    "write_bytes",
    "write_json",
    "write_text",
]

SUFFIX = ".part"


@contextlib.contextmanager
def replaced_file(path: str | os.PathLike[str], *, durable: bool = True) -> Iterator[BinaryIO]:
    """Open a file beside another one, which takes its place when the block ends well and vanishes otherwise.

    The file beside has a name of its own, so that several may write the same file: the last one wins, and no reader
    sees half of either. A symbolic link is replaced, not followed. Leftovers of writers that were killed are removed.

    Parameters
    ----------
    path : str or path
        Of the file that is to appear; one that is there is replaced, and its permissions are kept.
    durable : bool
        Whether to wait until the disk has it, so that a loss of power leaves the old file or the new one.

    Raises
    ------
    InputError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with replaced_file(Path(folder) / "numbers.txt") as file:
    ...         _ = file.write(b"1 2 3")
    ...     [(one.name, one.read_text()) for one in Path(folder).iterdir()]
    [('numbers.txt', '1 2 3')]
    """
    target = Path(path)
    try:
        mode = _mode_of_regular(target)
        remove_leftovers(target)
        part, file = _created(target)
    except OSError as error:
        raise refusal(target, error) from None
    except InputError:
        raise
    except ValueError:  # the path holds a NUL, or half of a surrogate pair
        raise InputError(f"{str(target)!r}: is no path that can exist; give another place.") from None
    try:
        with file:
            yield file
            file.flush()
            if durable:
                os.fsync(file.fileno())
            if mode is not None:
                os.chmod(part, mode)
            if os.name == "posix":
                os.replace(part, target)
        if os.name != "posix":  # where an open file cannot be renamed
            os.replace(part, target)
        if durable:
            synchronise(target.parent)
    except OSError as error:
        raise refusal(target, error) from None
    finally:
        with contextlib.suppress(OSError):
            os.unlink(part)


def write_bytes(content: bytes, path: str | os.PathLike[str], *, durable: bool = True) -> None:
    """Write bytes as in `replaced_file`."""
    with replaced_file(path, durable=durable) as file:
        file.write(content)


def write_text(text: str, path: str | os.PathLike[str]) -> None:
    """Write a text in UTF-8 as in `replaced_file`; names of files in it need not be valid Unicode."""
    write_bytes(text.encode("utf-8", "replace"), path)


def write_json(document: Any, path: str | os.PathLike[str], *, indent: int | None = 1) -> None:
    """Write a document as JSON as in `replaced_file`; its values become those of `plain`."""
    write_text(json.dumps(plain(document), indent=indent, allow_nan=False, ensure_ascii=False) + "\n", path)


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: arrays and tuples as lists, objects by their fields, numbers as Python's own.

    JSON has neither infinity nor not-a-number, for which None stands.

    Examples
    --------
    >>> plain({"errors": np.array([1.0, np.inf]), "count": np.int64(3), 2: ("a", None)})
    {'errors': [1.0, None], 'count': 3, '2': ['a', None]}
    """
    if isinstance(value, np.ndarray):
        exact = value.dtype.kind != "f" or bool(np.all(np.isfinite(value)))
        return value.tolist() if exact else [plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    return value


def refusal(target: Path, error: OSError) -> InputError:
    """Say that a file or a folder cannot be written."""
    return InputError(f"{target}: cannot be written ({error.strerror or error}); give another place.")


def beside(target: Path) -> Path:
    """Return a path in the folder of another one, with a random part that no other process has."""
    # A name may have at most 255 bytes; the part of the target's name only helps people who list the folder.
    return target.with_name(f".{target.name.encode()[:80].decode(errors='ignore')}.{secrets.token_hex(8)}{SUFFIX}")


def remove_leftovers(target: Path) -> None:
    """Remove files beside a target that writers have left which were killed: those that no process holds locked."""
    for leftover in leftovers(target):
        with contextlib.suppress(OSError):
            if not stat.S_ISREG(leftover.lstat().st_mode):
                continue
            if os.name != "posix":
                leftover.unlink()  # which fails while it is open
                continue
            handle = os.open(leftover, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                if locked(handle):
                    leftover.unlink()
            finally:
                os.close(handle)


def leftovers(target: Path) -> list[Path]:
    """Return what may have been made by `beside` for a target."""
    begin, end = beside(target).name.rsplit(".", 2)[0] + ".", len(secrets.token_hex(8)) + len(SUFFIX)
    with contextlib.suppress(OSError):
        return [
            target.with_name(entry.name)
            for entry in os.scandir(target.parent)
            if entry.name.startswith(begin) and entry.name.endswith(SUFFIX) and len(entry.name) == len(begin) + end
        ]
    return []


def locked(handle: int) -> bool:
    """Lock an open file or folder until it is closed or the process ends; tell whether nobody else has."""
    if os.name != "posix":
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return False
    return True


def synchronise(folder: Path) -> None:
    """Have the names in a folder written to the disk, so that a rename outlives a loss of power."""
    if os.name != "posix":
        return
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _created(target: Path) -> tuple[Path, BinaryIO]:
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
    while True:
        part = beside(target)
        # The system takes the user's mask from these permissions.
        handle = os.open(part, flags | getattr(os, "O_BINARY", 0), 0o666)
        locked(handle)
        # Between these two calls another writer may have taken it for a leftover.
        if os.fstat(handle).st_nlink or os.name != "posix":
            return part, open(handle, "w+b")
        os.close(handle)


def _mode_of_regular(target: Path) -> int | None:
    """Return the permissions of a file that is to be replaced; refuse folders and devices, which would be lost."""
    try:
        status = target.stat()
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{target}: is a folder; give the path of a file.")
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{target}: is no regular file, and will not be replaced; give another place.")
    return stat.S_IMODE(status.st_mode)
