"""Files and folders are written whole or not at all: into a temporary one beside, which is then renamed."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import json
import math
import os
import secrets
import shutil
import stat
import sys
import weakref
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from steelyard.errors import InputError, printable

__all__ = ["plain", "replaced_file", "replaced_folder", "require_unread", "write_bytes", "write_json", "write_text"]

if os.name == "posix":
    import fcntl

SUFFIX = ".part"
TRIES = 100
"""How often a file or a folder is made anew that is gone, or another one, once it is locked. Another process removes it
between the two calls at most; on a file system that tells another number of it each time, this would never end."""


@contextlib.contextmanager
def replaced_file(path: str | os.PathLike[str], *, durable: bool = True, swept: bool = False) -> Iterator[BinaryIO]:
    """Open a file beside another one, which takes its place when the block ends well and vanishes otherwise.

    The file beside has a name of its own, so that several may write the same file: the last one wins, and no reader
    sees half of either. A symbolic link is replaced, not followed. Leftovers of writers that were killed are removed.

    Parameters
    ----------
    path : str or path
        Of the file that is to appear; one that is there is replaced, and its permissions are kept.
    durable : bool
        Whether to wait until the disk has it, so that a loss of power leaves the old file or the new one.
    swept : bool
        Whether the folder was looked through for leftovers before, which takes the longer the more files it has.

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
    with _refusals_told(target):
        mode = _mode_of_regular(target)
        if not swept:
            remove_leftovers(target)
        part, file = _created(target)
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


def write_bytes(content: bytes, path: str | os.PathLike[str], *, durable: bool = True, swept: bool = False) -> None:
    """Write bytes as in `replaced_file`."""
    with replaced_file(path, durable=durable, swept=swept) as file:
        file.write(content)


def write_text(text: str, path: str | os.PathLike[str]) -> None:
    """Write a text in UTF-8 as in `replaced_file`; names of files in it need not be valid Unicode."""
    write_bytes(text.encode("utf-8", "replace"), path)


def write_json(document: Any, path: str | os.PathLike[str], *, indent: int | None = 1) -> None:
    """Write a document as JSON as in `replaced_file`; its values become those of `plain`."""
    write_text(json.dumps(plain(document), indent=indent, allow_nan=False, ensure_ascii=False) + "\n", path)


_PLAIN = frozenset([str, int, bool, type(None)])


def require_unread(place: Path | None, *inputs: str | Path | None) -> None:
    """Make sure that what is written replaces nothing of what is read.

    Parameters
    ----------
    place : Path or None
        What is written.
    *inputs : str, Path or None
        What is read; logs that belong together are joined by ``+``.

    Raises
    ------
    InputError
        If the place is one of them, also by another name.
    """
    if place is None:
        return
    for one in inputs:
        for name in () if one is None else {str(one), *str(one).split("+")}:
            try:
                is_read = os.path.samefile(name, place)
            except (OSError, ValueError):  # there is no such file
                continue
            if is_read:
                raise InputError(f"{place}: is read, and the results would replace it; give another --output.")


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: arrays and tuples as lists, objects by their fields, numbers as Python's own.

    JSON has neither infinity nor not-a-number, for which None stands.

    Examples
    --------
    >>> plain({"errors": np.array([1.0, np.inf]), "count": np.int64(3), 2: ("a", None)})
    {'errors': [1.0, None], 'count': 3, '2': ['a', None]}
    """
    kind = type(value)
    if kind is float:
        return value if math.isfinite(value) else None
    if value is None or kind is str or kind is bool or kind is int:
        return value
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
        if set(map(type, value)) <= _PLAIN:
            return list(value)
        return [plain(item) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    return value


def refusal(target: Path, error: OSError) -> InputError:
    """Say that a file or a folder cannot be written."""
    return InputError(f"{target}: cannot be written ({error.strerror or error}); give another place.")


@contextlib.contextmanager
def _refusals_told(target: Path) -> Iterator[None]:
    """Say that a file or a folder cannot be written, or that there can be no such path."""
    try:
        yield
    except OSError as error:
        raise refusal(target, error) from None
    except InputError:
        raise
    except ValueError:  # the path holds a NUL, or half of a surrogate pair
        raise InputError(f"{str(target)!r}: is not a valid path; give another place.") from None


@contextlib.contextmanager
def temporary_folder(target: Path) -> Iterator[Path]:
    """Make a folder beside a path, which is removed when the block ends; remove those of processes that were killed.

    Only this user can look into it.
    """
    with _refusals_told(target):
        remove_leftovers(target, folders=True)
        folder, handle = _created_folder(target, 0o700)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if handle is not None:
            os.close(handle)


def kept_folder(owner: object, target: Path) -> tuple[Path, Callable[[], object]]:
    """Make a `temporary_folder` that is removed with an object or this process, or before by the second value."""
    stack = contextlib.ExitStack()
    remove = weakref.finalize(owner, stack.close)
    return stack.enter_context(temporary_folder(target)), remove


def beside(target: Path) -> Path:
    """Return a path in the folder of another one, with a random part that no other process has."""
    # A name may have at most 255 bytes; the part of the target's name only helps people who list the folder. Bytes of
    # it that are not UTF-8 are left out.
    name = target.name.encode(errors="ignore")[:80].decode(errors="ignore")
    return target.with_name(f".{name}.{secrets.token_hex(8)}{SUFFIX}")


def remove_leftovers(target: Path, *, folders: bool = False) -> None:
    """Remove files, or folders, beside a target that killed writers have left: those that no process holds locked."""
    for leftover in leftovers(target):
        with contextlib.suppress(OSError):
            mode = leftover.lstat().st_mode
            if not (stat.S_ISDIR(mode) if folders else stat.S_ISREG(mode)):
                continue
            if os.name != "posix":
                if not folders:  # of which nobody knows whether they are still written
                    leftover.unlink()  # which fails while it is open
                continue
            flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC
            handle = os.open(leftover, flags | (os.O_DIRECTORY if folders else os.O_NONBLOCK))
            try:
                if not locked(handle):
                    continue
                if folders:
                    shutil.rmtree(leftover, ignore_errors=True)
                else:
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


def lost(path: Path) -> OSError:
    """Return what is raised of a file or folder that is gone, or another one, each time that it was made and locked."""
    return OSError(errno.ESTALE, "it is another one as soon as it is made, as on a network file system", str(path))


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


def has_locks(handle: int) -> bool:
    """Tell of an open file or folder that could not be locked whether others can lock it, so that one of them has."""
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # such as ENOSYS of a Lustre that was mounted without them
        return False
    return True


def remove_unused_folder(folder: Path) -> None:
    """Remove an empty folder, unless another run has locked it.

    Raises
    ------
    OSError
        If anything is in it, or it is gone.
    """
    if os.name != "posix":
        folder.rmdir()
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        if locked(handle):
            folder.rmdir()
    finally:
        os.close(handle)


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
    for _ in range(TRIES):
        part = beside(target)
        # The system takes the user's mask from these permissions.
        handle = os.open(part, flags | getattr(os, "O_BINARY", 0), 0o666)
        locked(handle)
        # Between these two calls another writer may have taken it for a leftover.
        if os.fstat(handle).st_nlink or os.name != "posix":
            return part, open(handle, "w+b")
        os.close(handle)
        with contextlib.suppress(OSError):
            part.unlink()
    raise lost(part)


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


_EXCHANGE = 2  # RENAME_EXCHANGE of Linux, and RENAME_SWAP of macOS
_HERE = -100  # AT_FDCWD of Linux


@contextlib.contextmanager
def replaced_folder(
    folder: str | os.PathLike[str], *, record: str | None = None, stale: Collection[str] = ()
) -> Iterator[Path]:
    """Make an empty folder, whose files are in `folder` when the block ends well.

    All of them appear at once: the new folder is made beside the old one, gets links to the other files of the old one,
    and one call of the system exchanges the two. So nobody sees files of two runs together, and a process that is
    killed leaves the one or the other, and at most a hidden folder that the next writer removes.

    Some folders are not exchanged, because something other than their files depends on them: a folder with folders in
    it, the current folder, a folder of another user, a mount point, and any folder on a system without that call. There
    the files are moved one by one. Whether all were moved can be told from `record`, which is removed first and moved
    last.

    Parameters
    ----------
    folder : str or path
        Made where it is missing. Other files in it stay.
    record : str, optional
        Name of the file that describes the others.
    stale : collection of str
        Names of files of an earlier run, which are removed unless the block makes a file of that name.

    Raises
    ------
    InputError
        If the folder cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place:
    ...     _ = (Path(place) / "notes.txt").write_text("mine")
    ...     with replaced_folder(place) as made:
    ...         _ = (made / "result.json").write_text("{}")
    ...     sorted(path.name for path in Path(place).iterdir())
    ['notes.txt', 'result.json']
    """
    with _refusals_told(Path(folder)):
        target = Path(os.path.realpath(folder))
        target.parent.mkdir(parents=True, exist_ok=True)
        inside = target / "results"  # what is made inside the folder gets a name that begins with this
        remove_leftovers(target, folders=True)
        remove_leftovers(inside, folders=True)
        exchanged = _may_be_exchanged(target)
        if not exchanged:
            target.mkdir(exist_ok=True)
        part, handle = _created_folder(target if exchanged else inside)
    try:
        yield part
        _require_folders(part, target)
        _synchronise_all(part)
        if not (exchanged and _exchanged(part, target, stale)):
            _moved(part, target, record, stale)
        synchronise(target.parent)
    except OSError as error:
        raise refusal(Path(folder), error) from None
    except InputError as error:  # of a file in the folder that is made, of which the user knows nothing
        raise InputError(str(error).replace(printable(str(part)), str(folder))) from None
    finally:
        if handle is not None:
            os.close(handle)
        shutil.rmtree(part, ignore_errors=True)


def _require_folders(part: Path, target: Path) -> None:
    """Refuse folders in the place of files, which would be lost, and files in that of folders, before any is moved."""
    for made in part.iterdir():
        place = target / made.name
        if made.is_dir() and os.path.lexists(place) and not place.is_dir():
            raise InputError(f"{place}: cannot be written (a file is where a folder has to be); give another place.")
        if not made.is_dir() and place.is_dir() and not place.is_symlink():
            raise InputError(f"{place}: cannot be written (a folder is where a file has to be); give another place.")


def _may_be_exchanged(target: Path) -> bool:
    """Tell whether nothing but its files depends on a folder."""
    if os.name != "posix" or not os.access(target.parent, os.W_OK | os.X_OK):
        return False
    try:
        status = target.stat()
    except FileNotFoundError:
        return True
    if not stat.S_ISDIR(status.st_mode):
        raise InputError(f"{target}: is a file, but the results need a folder; give another place.")
    if status.st_uid != os.geteuid() or os.path.ismount(target):
        return False
    with contextlib.suppress(OSError):
        here = Path(os.path.realpath(os.getcwd()))
        if here == target or target in here.parents:
            return False
    with os.scandir(target) as entries:
        return all(entry.is_file(follow_symlinks=False) for entry in entries)


def _exchanged(part: Path, target: Path, stale: Collection[str]) -> bool:
    """Put a folder in the place of another one, in one call; False where that cannot be done and nothing happened."""
    try:
        status = target.stat()
    except FileNotFoundError:
        os.rename(part, target)
        return True
    own = set(os.listdir(part))
    try:
        for name in set(os.listdir(target)) - own - set(stale):
            os.link(target / name, part / name, follow_symlinks=False)
        os.chmod(part, stat.S_IMODE(status.st_mode))
        if part.stat().st_gid != status.st_gid:
            os.chown(part, -1, status.st_gid)
        handle = os.open(target, os.O_RDONLY | os.O_CLOEXEC)
    except (OSError, NotImplementedError):
        _unlink(part, set(os.listdir(part)) - own)
        return False
    try:
        locked(handle)  # the folder at `target` will be at `part`; without a lock others would take it for a leftover
        if not _exchange(part, target):
            _unlink(part, set(os.listdir(part)) - own)
            return False
        # Move over what other processes have put into the old folder between the two calls.
        for name in set(os.listdir(part)) - own - set(stale):
            with contextlib.suppress(OSError):
                if not (target / name).exists() or not (part / name).samefile(target / name):
                    os.replace(part / name, target / name)
    finally:
        os.close(handle)
    return True


def _moved(part: Path, target: Path, record: str | None, stale: Collection[str]) -> None:
    """Move the files of a folder into another one, one by one."""
    names = sorted(os.listdir(part), key=lambda name: (name == record, name))
    _unlink(target, [*([record] if record is not None else []), *(set(stale) - set(names))])
    for name in names:
        for path in sorted((part / name).rglob("*")) if (part / name).is_dir() else [part / name]:
            place = target / path.relative_to(part)
            if not path.is_dir():
                place.parent.mkdir(parents=True, exist_ok=True)
                os.replace(path, place)
    synchronise(target)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two paths in one call; False where the system or the file system has none."""
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "darwin":
            return bool(library.renamex_np(os.fsencode(one), os.fsencode(other), _EXCHANGE) == 0)
        return bool(library.renameat2(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0)
    except (OSError, AttributeError):
        return False


def _unlink(folder: Path, names: Collection[str]) -> None:
    for name in names:
        with contextlib.suppress(FileNotFoundError, IsADirectoryError):
            os.unlink(folder / name)


def _created_folder(target: Path, mode: int = 0o777) -> tuple[Path, int | None]:
    """Make a folder beside a target, locked for as long as the handle is open."""
    for _ in range(TRIES):
        part = beside(target)
        os.mkdir(part, mode)
        if os.name != "posix":
            return part, None
        handle = os.open(part, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        locked(handle)
        with contextlib.suppress(FileNotFoundError):
            # Between these calls another writer may have taken it for a leftover.
            if part.stat().st_ino == os.fstat(handle).st_ino:
                return part, handle
        os.close(handle)
        with contextlib.suppress(OSError):
            part.rmdir()
    raise lost(part)


def _synchronise_all(folder: Path) -> None:
    if os.name != "posix":
        return
    for place, _, names in os.walk(folder):
        for name in names:
            handle = os.open(os.path.join(place, name), os.O_RDONLY | os.O_CLOEXEC)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
        synchronise(Path(place))
