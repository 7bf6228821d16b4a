"""Texts that are compressed, read as streams: neither memory nor a disk holds them whole, whatever they unpack to."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import IO, Any, Protocol, cast

from steelyard.errors import InputError, require_package

from .unpacking import ZSTD, Unpacking

__all__ = ["open_compressed"]

LARGEST_WINDOW = 2**28
"""Bytes that unpacking xz may take; files of its highest preset take 65 MB. A header may ask for 4 GB."""
RATIO = 2000
"""Bytes that a byte may stand for, beyond those that any file may: gzip reaches 1032. Texts of a robot that stands
still reach 690 with xz, where they have 120 columns besides the time, 260 with 14; those of moving ones 5 to 15."""
READ = 1 << 20
"""Bytes that are asked of a stream at a time."""


class _Source(Protocol):
    def read(self, size: int, /) -> bytes: ...

    def close(self) -> object: ...


class _XzFile:
    """A file ``.xz`` or ``.lzma``: `lzma.open` does the same, without a limit of memory."""

    def __init__(self, path: Path) -> None:
        import lzma  # loaded for such files alone, and absent from some builds of Python

        self._path, self._library = path, lzma
        self._file = path.open("rb")
        self._decompressor = self._new()

    def _new(self) -> Any:
        return self._library.LZMADecompressor(memlimit=LARGEST_WINDOW)

    def read(self, size: int) -> bytes:
        while True:
            data = b""
            if self._decompressor.eof:  # another stream may follow, behind zeros that fill
                rest = self._decompressor.unused_data.lstrip(b"\0")
                while not rest and (more := self._file.read(READ)):
                    rest = more.lstrip(b"\0")
                if not rest:
                    return b""
                self._decompressor, data = self._new(), rest
            elif self._decompressor.needs_input:
                data = self._file.read(READ)
                if not data:
                    raise EOFError("it ends before its end was marked")
            try:
                content: bytes = self._decompressor.decompress(data, max_length=size)
            except self._library.LZMAError as error:
                if "Memory" not in str(error):
                    raise
                raise InputError(
                    f"{self._path} needs more than {LARGEST_WINDOW >> 20} MiB of memory to unpack; compress it again, "
                    "as with `xz -6`."
                ) from None
            if content:
                return content

    def close(self) -> None:
        self._file.close()


def _source(path: Path) -> _Source:
    suffix = path.suffix.lower()
    if suffix == ".bz2":
        import bz2  # each is loaded for its own files alone

        return bz2.open(path, "rb")
    if suffix in (".xz", ".lzma"):
        return _XzFile(path)
    need = "Files compressed by zstd are read with the module"
    return cast("_Source", require_package(ZSTD, need, "zstd").open(path, "rb"))


class _Unpacked(io.RawIOBase):
    """The content of a compressed file, within the bound that its size allows; see `Unpacking`.

    A few kB of bzip2, xz or zstd may stand for as many GB.
    """

    def __init__(self, path: Path, source: _Source) -> None:
        self._source, self._place = source, 0  # first, since what is not whole is closed, too
        self._path = path
        self._bound = Unpacking(path, path.stat().st_size, RATIO)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._place

    def seek(self, place: int, whence: int = os.SEEK_SET) -> int:
        place += self._place if whence == os.SEEK_CUR else 0
        if whence == os.SEEK_END:
            raise io.UnsupportedOperation("how long the content is, is not known")
        if place < self._place:
            self._source.close()
            self._source, self._place = _source(self._path), 0
        while self._place < place and self._read(min(place - self._place, READ)):
            pass
        return self._place

    def readinto(self, buffer: Any) -> int:
        content = self._read(len(buffer))
        buffer[: len(content)] = content
        return len(content)

    def _read(self, size: int) -> bytes:
        try:
            content = self._source.read(size)
        except (InputError, MemoryError):
            raise
        except Exception as error:  # each library has errors of its own for what is damaged
            reason = " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
            raise InputError(f"{self._path} cannot be unpacked ({reason}); compress it again.") from None
        self._bound.spend(len(content))
        self._place += len(content)
        return content

    def close(self) -> None:
        self._source.close()
        super().close()


def open_compressed(path: Path) -> IO[bytes]:
    r"""Open a file ``.gz``, ``.bz2``, ``.xz``, ``.lzma``, ``.zst`` or ``.zstd`` as a stream.

    Raises
    ------
    InputError
        Where it is damaged, and where it unpacks to far more than a text of its size does; when it is read.

    Examples
    --------
    >>> import bz2, tempfile
    >>> path = Path(tempfile.mkdtemp()) / "run.csv.bz2"
    >>> _ = path.write_bytes(bz2.compress(b"t,q1\n0,1\n"))
    >>> with open_compressed(path) as file:
    ...     file.readline(), file.read(), file.seek(2), file.read(2)
    (b't,q1\n', b'0,1\n', 2, b'q1')
    """
    if path.suffix.lower() == ".gz":  # which never comes near the bound, and takes half as long by itself
        import gzip

        return cast("IO[bytes]", gzip.open(path, "rb"))
    return io.BufferedReader(_Unpacked(path, _source(path)), READ)
