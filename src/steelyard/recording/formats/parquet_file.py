"""Logs as Parquet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.files import check_parquet, write_table

from .log_file import flattened
from .table_file import TableFile

__all__ = ["ParquetFile"]


class ParquetFile(TableFile):
    """A Parquet file, also one of LeRobot's data sets."""

    kind = "Parquet"
    saved_as = ".parquet"

    def _scanned(self) -> Any:
        import polars as pl

        check_parquet(self.path)
        return pl.scan_parquet(self.path, glob=False)

    @classmethod
    def write(cls, file: IO[bytes], arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Write the columns in row groups small enough to be read one by one."""
        import polars as pl

        write_table(pl.DataFrame(flattened(arrays)), file, ".parquet")
