"""Compiled object code, and what else takes long to make, kept on disk: a robot is compiled once a machine."""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import sys
from pathlib import Path

from steelyard.errors import InputError
from steelyard.files import write_bytes

__all__ = ["ObjectCache", "pack", "unpack"]

_MAGIC = b"steelyard-object-2\n"


class ObjectCache:
    """A folder of files, most of them of object code, named by the hash of what they were made from.

    A file holds a hash of its key and its content, so that a damaged or misplaced one is recognised and made again.
    Files are written beside and renamed, so that two processes may write the same one. The environment variable
    ``STEELYARD_CACHE=off`` turns the cache off; ``STEELYARD_CACHE_DIR`` moves it. A folder that others may write is
    not used, because object code from it would run.

    Parameters
    ----------
    folder : Path or None
        None keeps nothing.

    Examples
    --------
    >>> ObjectCache(None).read("0123") is None
    True
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def __repr__(self) -> str:
        return f"ObjectCache({str(self.folder) if self.folder else 'off'})"

    @classmethod
    def default(cls) -> ObjectCache:
        """Return the user's cache, or one that keeps nothing where it is turned off or no safe folder exists."""
        if os.environ.get("STEELYARD_CACHE", "").strip().lower() in ("off", "0", "no", "false"):
            return cls(None)
        folder = _user_folder()
        return cls(folder if folder is not None and _private(folder) else None)

    def read(self, key: str) -> bytes | None:
        """Return the content kept under `key`, or None where there is none or it is damaged."""
        if self.folder is None:
            return None
        try:
            content = (self.folder / f"{key}.o").read_bytes()
        except OSError:
            return None
        if not content.startswith(_MAGIC):
            return None
        digest, code = content[len(_MAGIC) : len(_MAGIC) + 32], content[len(_MAGIC) + 32 :]
        return code if _digest(key, code) == digest else None

    def write(self, key: str, code: bytes) -> None:
        """Keep `code` under `key`; a folder that cannot be written is no error."""
        if self.folder is None:
            return
        with contextlib.suppress(InputError):
            write_bytes(_MAGIC + _digest(key, code) + code, self.folder / f"{key}.o", durable=False)


def _digest(key: str, code: bytes) -> bytes:
    return hashlib.sha256(key.encode() + b"\0" + code).digest()


def pack(description: str, code: bytes) -> bytes:
    """Join machine code and what describes it into the content of one entry."""
    text = description.encode()
    return len(text).to_bytes(8, "little") + text + code


def unpack(content: bytes | None) -> tuple[str, bytes] | None:
    """Return description and code of an entry, or None where there is no entry or it is not one."""
    if content is None or len(content) < 8:
        return None
    end = 8 + int.from_bytes(content[:8], "little")
    if end > len(content):
        return None
    try:
        return content[8:end].decode(), content[end:]
    except UnicodeDecodeError:
        return None


def _user_folder() -> Path | None:
    chosen = os.environ.get("STEELYARD_CACHE_DIR")
    if chosen:
        return Path(chosen)
    try:
        home = Path.home()
    except RuntimeError:
        return None
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", home / "AppData" / "Local")) / "steelyard" / "cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "steelyard"
    chosen = os.environ.get("XDG_CACHE_HOME", "")
    # The specification of these folders has relative paths ignored: they would mean another folder in each folder.
    return (Path(chosen) if os.path.isabs(chosen) else home / ".cache") / "steelyard"


def _private(folder: Path) -> bool:
    """Make the folder where it is missing; tell whether only this user can write there."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except OSError:
        return False
    if sys.platform == "win32":
        return True
    return status.st_uid == os.getuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
