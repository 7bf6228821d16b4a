"""Finished reductions in the folder of the results, so that a run that was killed loses none and counts none twice."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import scipy

from steelyard import __version__
from steelyard.errors import InputError
from steelyard.files import plain, read_bytes, write_bytes
from steelyard.files.writing import SUFFIX, TRIES, has_locks, locked, lost, refusal, remove_leftovers
from steelyard.robot import Robot

__all__ = ["Checkpoints", "checkpoint_key", "has_checkpoints", "robot_content"]

_PREFIX, _ENDING = "reduced-", ".checkpoint"
_NAME = re.compile(re.escape(_PREFIX) + "[0-9a-f]{64}" + re.escape(_ENDING))
_LEFTOVER = re.compile(r"\.(reduced-.*)\.[0-9a-f]{16}" + re.escape(SUFFIX))


LARGEST = 500_000_000
"""Bytes of a file that is read; what came of a log has some MB, and what is larger is computed anew."""


def checkpoint_key(*parts: Any) -> str:
    """Return the name of a result by everything that it follows from, and by the versions that compute it.

    Parameters
    ----------
    parts
        Plain data: contents by their hashes, options, the robot.

    Examples
    --------
    >>> checkpoint_key("log", 1) == checkpoint_key("log", 1), len(checkpoint_key("log", 2))
    (True, 64)
    """
    versions = (__version__, np.__version__, scipy.__version__, sys.version.split()[0], sys.byteorder)
    text = json.dumps([versions, plain(parts)], sort_keys=True, ensure_ascii=True, default=repr)
    return hashlib.sha256(text.encode()).hexdigest()


def has_checkpoints(folder: Path) -> bool:
    """Tell whether a run that was killed left something in a folder, which goes with the next results."""
    return any(_NAME.fullmatch(name) or _LEFTOVER.fullmatch(name) for name in os.listdir(folder))


def robot_content(robot: Robot) -> dict[str, Any]:
    """Return what a robot is, as plain data, without where and with which remarks it was read."""
    return {**plain(robot), "source": None, "remarks": None}


def _heading(key: str) -> bytes:
    """What a file begins with, so that what came of one log is not taken for what came of another."""
    return f"{key}\n".encode()


class Checkpoints:
    """The finished parts of a run in a folder, which no other run uses at the same time.

    Within a ``with`` block the folder is locked. The lock is that of the system on the folder itself: it ends with the
    process, however that ends, and leaves no file.

    Parameters
    ----------
    folder : str or path
        Made where it is missing.

    Raises
    ------
    InputError
        On entering, if another run has the folder, or it cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with Checkpoints(folder) as checkpoints:
    ...         checkpoints.put(checkpoint_key("log.csv"), b"what came of it")
    ...     with Checkpoints(folder) as checkpoints:
    ...         checkpoints.get(checkpoint_key("log.csv")), checkpoints.get(checkpoint_key("other.csv"))
    (b'what came of it', None)
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self._handle: int | None = None
        self._made = False

    def __enter__(self) -> Self:
        try:
            for _ in range(TRIES):
                if self._opened():
                    break
                self._close()
            else:
                raise lost(self.folder)
        except OSError as error:
            self._close()
            raise refusal(self.folder, error) from None
        self._sweep()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._made and kind is not None:
            with contextlib.suppress(OSError):
                self.folder.rmdir()  # which fails where anything is in it
        self._close()  # last: as long as it is locked, no other run counts on the folder

    def _opened(self) -> bool:
        """Make, open and lock the folder; False where the run that had it until now removed it meanwhile."""
        try:
            self.folder.mkdir(parents=True)
            self._made = True
        except FileExistsError:
            if not self.folder.is_dir():
                raise
        if os.name != "posix":
            return True
        try:
            self._handle = os.open(self.folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except FileNotFoundError:
            return False
        if not locked(self._handle):
            has_none = not has_locks(self._handle)
            # Also where this run made the folder, which the other was faster to lock, it is the other's now.
            self._close()
            if has_none:
                raise InputError(
                    f"{self.folder}: the file system there has no locks, by which runs are kept apart; give an "
                    "--output on another one."
                )
            raise InputError(
                f"{self.folder}: another run is working in this folder; wait until it ends, or give another --output."
            )
        with contextlib.suppress(FileNotFoundError):
            return os.path.samestat(os.fstat(self._handle), self.folder.stat())
        return False

    def _close(self) -> None:
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def get(self, key: str) -> bytes | None:
        """Return what was kept under a key; None where nothing was, or a file was renamed or cut short, or is none."""
        try:
            found = read_bytes(self._path(key), largest=LARGEST)
        except InputError:
            return None
        own = _heading(key)
        return found[len(own) :] if found.startswith(own) else None

    def put(self, key: str, content: bytes) -> None:
        """Keep bytes under a key; the file is there whole or not at all."""
        write_bytes(_heading(key) + content, self._path(key), swept=True)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the files of all that is kept, also by earlier runs."""
        with contextlib.suppress(OSError):
            return tuple(sorted(name for name in os.listdir(self.folder) if _NAME.fullmatch(name)))
        return ()

    def _path(self, key: str) -> Path:
        return self.folder / f"{_PREFIX}{key}{_ENDING}"

    def _sweep(self) -> None:
        """Remove what writers that were killed have left."""
        with contextlib.suppress(OSError):
            for name in os.listdir(self.folder):
                found = _LEFTOVER.fullmatch(name)
                if found:
                    remove_leftovers(self.folder / found[1])
