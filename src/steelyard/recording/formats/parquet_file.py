"""Logs as Parquet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import install_command, is_installed
from steelyard.files import check_parquet, write_table

from .data_frames import INDEX
from .log_file import flattened
from .table_file import TableFile

__all__ = ["ParquetFile"]

PAGED_GROUP, LARGE_GROUP = 500_000, 4_000_000
"""Rows of groups that are read page by page, which pyarrow can and which takes a sixth off a log with groups of a
million; and of those of which the bytes, 32 MB a column before compression, are not to stand in memory twice."""
PAGES_BYTES = 2**20
"""Bytes of each column that are read together where pages are."""
LONGEST_PART = 4
"""Times as many rows as otherwise may be read together where they are decoded together."""


class ParquetFile(TableFile):
    """A Parquet file, also one of LeRobot's data sets.

    Polars reads all bytes of the groups of rows that a part touches, and decodes the pages. So parts are whole groups
    or whole pages where these are small enough. Larger groups are read page by page where pyarrow is installed.
    """

    kind = "Parquet"
    saved_as = ".parquet"

    def _scanned(self) -> Any:
        import polars as pl

        self._groups, self._pages = check_parquet(self.path)
        return pl.scan_parquet(self.path, glob=False)

    @property
    def _largest_group(self) -> int:
        return int(np.diff(self._groups).max(initial=0))

    def _scans(self, first: int, names: Sequence[str], rows: int) -> Iterator[Any]:
        if self._largest_group <= PAGED_GROUP or not is_installed("pyarrow"):
            yield from super()._scans(first, names, rows)
            return
        import polars as pl
        from pyarrow import parquet

        wanted = {self._elements[name][0] if name in self._elements else name for name in names}
        group = int(np.searchsorted(self._groups, first, "right")) - 1
        before = first - int(self._groups[group])
        with self._reading(), parquet.ParquetFile(self.path, buffer_size=PAGES_BYTES, pre_buffer=False) as file:
            columns = [name if name in file.schema_arrow.names else INDEX for name in wanted]
            for batch in file.iter_batches(rows, range(group, file.num_row_groups), columns):
                if before < batch.num_rows:
                    frame = pl.DataFrame(pl.from_arrow(batch.slice(before)))
                    yield frame.lazy().rename({INDEX: "time"} if INDEX in columns else {})
                before = max(0, before - batch.num_rows)

    def notes(self) -> tuple[str, ...]:
        """See `LogFile.notes`."""
        if self._largest_group <= LARGE_GROUP or is_installed("pyarrow"):
            return ()
        return (
            f"{self._largest_group} rows of {self.path.name} stand in one group, which takes memory and time as a "
            f"whole; {install_command('parquet')} lets it be read page by page.",
        )

    def _part_end(self, first: int, count: int, rows: int) -> int:
        if self._groups[-1] != count:  # what is encrypted was not looked at
            return super()._part_end(first, count, rows)
        group = int(np.searchsorted(self._groups, first, "right"))
        end, most = int(self._groups[group]), LONGEST_PART * rows
        size = end - int(self._groups[group - 1])
        if size > LARGE_GROUP:
            rows = most
        ends = self._groups if size <= rows else self._pages
        last = int(np.searchsorted(ends, first + rows, "right")) - 1
        stop = int(ends[last] if ends[last] > first else ends[last + 1])
        return min(stop, first + most, end if size > rows else stop)

    def places(self) -> tuple[tuple[int, int], ...] | None:
        """See `LogFile.places`; none in large groups, of which pages are read from the beginning."""
        return super().places() if self._largest_group <= LARGE_GROUP else None

    @classmethod
    def write(cls, file: IO[bytes], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write the columns in row groups small enough to be read one by one."""
        import polars as pl

        write_table(pl.DataFrame(flattened(arrays)), file, ".parquet")
