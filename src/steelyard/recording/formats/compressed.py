"""Texts that are compressed by gzip or zstd, read as a stream, so that neither memory nor a disk holds them whole."""

from __future__ import annotations

import gzip
import sys
from pathlib import Path
from typing import IO, cast

from steelyard.errors import require_package

__all__ = ["open_compressed"]


def open_compressed(path: Path) -> IO[bytes]:
    """Open a file ``.gz``, ``.zst`` or ``.zstd`` for reading what is in it."""
    if path.suffix.lower() == ".gz":
        return cast("IO[bytes]", gzip.open(path, "rb"))
    module = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    return cast(
        "IO[bytes]",
        require_package(module, "Files compressed by zstd are read with the module", "zstd").open(path, "rb"),
    )
