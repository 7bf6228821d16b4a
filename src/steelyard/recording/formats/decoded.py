"""Files that are expensive to decode, kept decoded for whoever opens them again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, TypeVar, cast

__all__ = ["decoded_once"]

MOST_DECODED = 4
"""Files that stay decoded, in temporary files: an identification opens its log two times or more. Decoding takes 30 to
90 µs a message of a bag, 1.4 µs a date of an HDF5 file, and another process for a file of MATLAB."""
Decoded = TypeVar("Decoded")
_DECODED: dict[Hashable, Any] = {}


def decoded_once(path: Path, options: Hashable, decode: Callable[[], Decoded]) -> Decoded:
    """Return what `decode` makes of a file, or made of it as long as the file, or one in the folder, is not written.

    Parameters
    ----------
    path : Path
        A file or folder.
    options : hashable
        What else the outcome depends on.
    decode : callable
        Its outcome is used by several, none of which changes it.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "log.txt"
    >>> for text in ("one", "one", "three"):
    ...     _ = path.write_text(text) if not path.exists() or path.read_text() != text else None
    ...     decoded_once(path, "lengths", lambda: print("decoding") or len(path.read_text()))
    decoding
    3
    3
    decoding
    5
    """
    key = (str(path), options, _state(path))
    if key not in _DECODED:
        found = decode()
        while len(_DECODED) >= MOST_DECODED:
            del _DECODED[next(iter(_DECODED))]
        _DECODED[key] = found
    return cast("Decoded", _DECODED[key])


def _state(path: Path) -> Hashable:
    """Return what changes when a file, or one in a folder, is written again."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return tuple((file.name, status.st_size, status.st_mtime_ns) for file in files for status in [file.stat()])
