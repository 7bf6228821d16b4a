"""Writing of folders whose files belong together: all of them change at once, or none does."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import stat
import sys
from collections.abc import Collection, Iterator
from pathlib import Path

from steelyard.errors import InputError

from .writing import beside, leftovers, locked, refusal, synchronise

__all__ = ["replaced_folder"]

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
    try:
        target = Path(os.path.realpath(folder))
        target.parent.mkdir(parents=True, exist_ok=True)
        inside = target / "results"  # what is made inside the folder gets a name that begins with this
        _remove_leftovers(target)
        _remove_leftovers(inside)
        exchanged = _may_be_exchanged(target)
        if not exchanged:
            target.mkdir(exist_ok=True)
        part, handle = _created(target if exchanged else inside)
    except OSError as error:
        raise refusal(Path(folder), error) from None
    except InputError:
        raise
    except ValueError:  # the path holds a NUL, or half of a surrogate pair
        raise InputError(f"{str(folder)!r}: is no path that can exist; give another place.") from None
    try:
        yield part
        _require_folders(part, target)
        _synchronise_all(part)
        if not (exchanged and _exchanged(part, target, stale)):
            _moved(part, target, record, stale)
        synchronise(target.parent)
    except OSError as error:
        raise refusal(Path(folder), error) from None
    finally:
        if handle is not None:
            os.close(handle)
        shutil.rmtree(part, ignore_errors=True)


def _require_folders(part: Path, target: Path) -> None:
    """Refuse to put a folder where a file is, which would be lost."""
    for made in part.iterdir():
        place = target / made.name
        if made.is_dir() and os.path.lexists(place) and not place.is_dir():
            raise InputError(f"{place}: cannot be written (a file is where a folder has to be); give another place.")


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


def _created(target: Path) -> tuple[Path, int | None]:
    """Make a folder beside a target, locked for as long as the handle is open."""
    while True:
        part = beside(target)
        os.mkdir(part)
        if os.name != "posix":
            return part, None
        handle = os.open(part, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        locked(handle)
        with contextlib.suppress(FileNotFoundError):
            # Between these calls another writer may have taken it for a leftover.
            if part.stat().st_ino == os.fstat(handle).st_ino:
                return part, handle
        os.close(handle)


def _remove_leftovers(target: Path) -> None:
    for leftover in leftovers(target):
        with contextlib.suppress(OSError):
            if not stat.S_ISDIR(leftover.lstat().st_mode):
                continue
            if os.name != "posix":
                continue  # nobody knows whether it is still written
            handle = os.open(leftover, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                if locked(handle):
                    shutil.rmtree(leftover, ignore_errors=True)
            finally:
                os.close(handle)


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
