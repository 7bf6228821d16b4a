"""Logs as Arrow's files, which Feather calls its second version, and as its streams."""

from __future__ import annotations

import glob
from typing import Any

from .table_file import TableFile

__all__ = ["ArrowFile"]


class ArrowFile(TableFile):
    """An Arrow file, of which blocks of rows are read, or a stream, which is read whole."""

    kind = "Arrow"

    def _scanned(self) -> Any:
        import polars as pl

        with self.path.open("rb") as file:
            is_file = file.read(6) == b"ARROW1"
        return pl.scan_ipc(glob.escape(str(self.path))) if is_file else pl.read_ipc_stream(self.path).lazy()
