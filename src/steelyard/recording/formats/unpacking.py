"""Bounds for what a log unpacks to: a few kB may stand for any number of bytes and of messages."""

from __future__ import annotations

import sys
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

from steelyard.errors import InputError, require_package

__all__ = ["BAGS", "ZSTD", "Unpacking"]

BAGS = "bags"
"""The extra that brings the packages for bags and MCAP."""
ZSTD = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
PACKAGES = {"bz2": "bz2", "lz4": "lz4.frame", "zstd": "zstandard"}
AT_ONCE = 2**27
"""Bytes that anything may unpack to; chunks have 1 to 4 MB, or the size of the one image in them."""
TIMES = 4
"""Times its own size that a larger chunk may unpack to; measured values and images do so 1.5 to 3 times."""
LARGEST_MESSAGE = 2**16
"""Bytes of the largest message that is decoded. Joint states have some hundred, those of 500 joints in JSON 50 000;
objects of Python take up to a hundred times the bytes that they are made of."""
RECORD, MESSAGE, DECODED = 2**9, 2**14, 2**6
"""Bytes that are unpacked in the time in which a record is passed over, a message is decoded, and each byte of it."""
LEAST, RATIO = 2**28, 8000
"""Bytes that may be unpacked of any file, and further ones for each byte of it. The bag of a simulated robot that
stands still takes a thousand for each, by its messages; black images take some thousand."""


class Unpacking:
    """What is unpacked of one log while it is open: each part, and all that is made of it together, has a bound.

    Parameters
    ----------
    path : Path
        The bag, for messages.
    size : int
        Bytes of its files.
    ratio : int
        Bytes that may be unpacked for each of them, beyond those of any file.

    Attributes
    ----------
    decoders : dict
        What decodes messages, by their definitions, none of which is read twice.

    Examples
    --------
    >>> import bz2
    >>> Unpacking(Path("run.bag"), 10**6).unpacked("bz2", bz2.compress(bytes(9)), 9)
    b'\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00\\x00'
    """

    def __init__(self, path: Path, size: int, ratio: int = RATIO) -> None:
        self.path = path
        self.decoders: dict[Hashable, Callable[[bytes], Any]] = {}
        self._left = LEAST + ratio * size

    def spend(self, work: int) -> None:
        """Take note of work, in bytes that are unpacked in its time.

        Raises
        ------
        InputError
            Where the file has asked for more than its size explains.
        """
        self._left -= work
        if self._left < 0:
            raise InputError(
                f"{self.path} unpacks to far more than a recording of its size holds; record it again, or write it "
                "without compression if it is sound."
            )

    def takes(self, message: bytes) -> bool:
        """Return whether a message may be a joint state, by its size, and take note of it."""
        is_small = len(message) <= LARGEST_MESSAGE
        self.spend(MESSAGE + DECODED * len(message) if is_small else len(message))
        return is_small

    def unpacked(self, compression: str, data: bytes, size: int | None = None) -> bytes:
        """Unpack a chunk, which states its size, or a message, which may not.

        Raises
        ------
        InputError
            Where it is larger than what is held in memory.
        ValueError
            Where it has another size, or is packed in an unknown way.
        """
        self.spend(len(data))  # of what is not packed, too: a chunk may be asked for again and again
        if compression in ("", "none"):
            return data
        if compression not in PACKAGES:
            raise ValueError(f"a chunk is packed by {compression[:20]!r}, which is not known")
        library = require_package(PACKAGES[compression], "Compressed bags are read with the module", BAGS)
        if size is None and compression == "zstd":
            stated = library.frame_content_size(data)
            size = None if stated < 0 else stated
        most = max(AT_ONCE, TIMES * len(data))
        if size is None or size <= most:
            self.spend(size or 0)
            # One byte more than is allowed tells a chunk that has more from one that ends there.
            content = _first_bytes(library, data, (most if size is None else size) + 1)
            if size is None:
                self.spend(len(content))
            elif len(content) != size:
                raise ValueError(f"a chunk does not unpack to the {size} bytes that it states")
            if len(content) <= most:
                return content
        raise InputError(
            f"{self.path} holds {len(data)} bytes that unpack to more than {most >> 20} MiB; write it again in smaller "
            "chunks, or without compression."
        )


def _first_bytes(library: Any, data: bytes, count: int) -> bytes:
    """Return so many bytes, or fewer where it has no more, of what a library unpacks."""
    content: bytes
    if library.__name__ == "zstandard":  # half as long as that of Python, which joins small parts
        content = library.ZstdDecompressor().stream_reader(data).read(count)
    else:
        kind = library.BZ2Decompressor if library.__name__ == "bz2" else library.LZ4FrameDecompressor
        content = kind().decompress(data, max_length=count)
    return content
