"""Logs as Parquet."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import reading_table

from .log_file import Columns, LogFile, flattened

__all__ = ["ParquetFile"]


class ParquetFile(LogFile):
    """A Parquet file of numeric columns; a column of dates and times counts as seconds since 1970."""

    saved_as = ".parquet"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with self._reading():
            import polars as pl

            self._scan = pl.scan_parquet(path, glob=False)
            self._schema = dict(self._scan.collect_schema())
        self.names = tuple(self._schema)

    def _reading(self) -> contextlib.AbstractContextManager[None]:
        return reading_table(self.path, "Parquet")

    @classmethod
    def write(cls, file: IO[bytes], arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Write the columns in row groups small enough to be read one by one."""
        import polars as pl

        pl.DataFrame(flattened(arrays)).write_parquet(file, row_group_size=100_000)

    def count(self) -> int:
        """Count the rows."""
        import polars as pl

        with self._reading():
            return int(self._scan.select(pl.len()).collect().item())

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns."""
        return self._numbers(self._scan, names)

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in slices of `rows` rows; a row group is decoded whole, so keep row groups small."""
        for start in range(0, self.count(), rows):
            yield self._numbers(self._scan.slice(start, rows), names)

    def texts(self, names: Sequence[str]) -> dict[str, set[str]]:
        """Texts that stand in columns, each once; none for columns of numbers."""
        import polars as pl

        columns = [name for name in names if self._schema[name] == pl.String]
        with self._reading():
            return {
                name: set(self._scan.select(pl.col(name).drop_nulls().unique()).collect()[name].to_list())
                for name in columns
            }

    def _numbers(self, scan: Any, names: Sequence[str]) -> Columns:
        import polars as pl

        if not names:
            return {}
        chosen = []
        for name in names:
            kind = self._schema[name]
            if kind.is_temporal() and kind != pl.Date:
                chosen.append(pl.col(name).to_physical().cast(pl.Float64) * _seconds(kind))
            elif kind.is_numeric():
                chosen.append(pl.col(name).cast(pl.Float64))
            else:
                raise InputError(f"{self.path} has values of type {kind} in column {name!r}; expected numbers.")
        with self._reading():
            frame = scan.select(chosen).collect()
        return {name: frame[name].fill_null(float("nan")).to_numpy() for name in names}


def _seconds(kind: Any) -> float:
    return {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}[getattr(kind, "time_unit", "ns")]
