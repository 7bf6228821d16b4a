"""Logs as text: columns separated by comma, semicolon or tab under a line of names."""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import reading_table, shown

from .log_file import Columns, LogFile, flattened

__all__ = ["CsvFile"]

SEPARATORS = (";", "\t", ",")
NUMERIC = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?|nan|inf", re.IGNORECASE)
LONGEST_LINE = 1_000_000  # of the header and what stands above it
MISSING = ("", "na", "null", "none", "nan", "-nan", "+nan")


class CsvFile(LogFile):
    """A text log. Lines that begin with "#" and blank lines are skipped; the first other line holds the names.

    Where that line is all numbers, the comment line right above it is taken for the names if it has as many fields
    (as `numpy.savetxt` writes it). A comma as decimal sign is understood in files separated by semicolons.
    """

    saved_as = ".csv"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._start = 0
        self._whole: tuple[tuple[tuple[str, ...], int], Columns] | None = None
        self._separator = ","
        self._decimal_comma = False
        self._read_header()

    def _read_header(self) -> None:
        comment = ""
        with self.path.open("rb") as file:
            while True:
                before = file.tell()
                raw = file.readline(LONGEST_LINE)
                if not raw:
                    raise InputError(
                        f"{self.path} holds no rows; expected a line of column names and one row per sample."
                    )
                if len(raw) == LONGEST_LINE:
                    raise InputError(f"{self.path} has a line of more than {LONGEST_LINE} bytes; expected a CSV.")
                if b"\x00" in raw:
                    raise InputError(f"{self.path} is not a text file; expected a CSV with a line of column names.")
                line = raw.decode("utf-8-sig" if before == 0 else "utf-8", errors="replace").strip()
                if line.startswith("#"):
                    comment = line.lstrip("#").strip()
                elif line:
                    break
            self._separator = next((mark for mark in SEPARATORS if mark in line), ",")
            fields = self._split(line)
            self._start = file.tell()
            if all(NUMERIC.fullmatch(field) for field in fields):
                above = self._split(comment)
                if len(fields) == 1 and re.search(r"\s", line):
                    self._refuse_spaces()
                if len(above) != len(fields) or any(NUMERIC.fullmatch(field) for field in above):
                    raise InputError(
                        f"{self.path} has no line of column names (it begins with {line[:40]!r}); add one as first "
                        "line, for example t,q1,q2,tau1,tau2."
                    )
                fields, self._start = above, before
            elif len(fields) == 1 and len(line.split()) > 1:
                self._refuse_spaces()
            if self._separator == ";":
                file.seek(self._start)
                first = next((row for row in file if not _skipped(row)), b"")
                self._decimal_comma = b"," in first and b"." not in first
        self.names = tuple(fields)

    def _refuse_spaces(self) -> None:
        raise InputError(f"{self.path} has columns separated by blanks; separate them by comma, semicolon or tab.")

    def _split(self, line: str) -> list[str]:
        return [field.strip() for field in next(csv.reader([line], delimiter=self._separator), [])]

    @classmethod
    def write(cls, file: IO[bytes], arrays: Mapping[str, NDArray[np.float64]]) -> None:
        """Write the columns under a line of their names."""
        import polars as pl

        pl.DataFrame(flattened(arrays)).write_csv(file)

    def count(self) -> int:
        """Count the rows that hold data."""
        with self.path.open("rb") as file:
            file.seek(self._start)
            return sum(1 for line in file if not _skipped(line))

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns."""
        with self.path.open("rb") as file:
            file.seek(self._start)
            return self._parse(file.read(), names, first_row=0)

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of `rows` rows."""
        first_row = 0
        if self._whole is not None and self._whole[0] == (tuple(names), rows):
            yield dict(self._whole[1])
            return
        with self.path.open("rb") as file:
            file.seek(self._start)
            lines = (line for line in file if not _skipped(line))
            while block := list(itertools.islice(lines, rows)):
                parsed = self._parse(b"".join(block), names, first_row)
                if first_row == 0 and len(block) < rows:  # a short log, which is looked at before it is processed
                    self._whole = (tuple(names), rows), dict(parsed)
                yield parsed
                first_row += len(block)

    def texts(self, names: Sequence[str]) -> dict[str, set[str]]:
        """Texts that stand in columns, each once; none for columns of numbers."""
        found: dict[str, set[str]] = {name: set() for name in names}
        places = {name: self.names.index(name) for name in names}
        if not names:
            return found
        with self.path.open(encoding="utf-8", errors="replace", newline="") as file:
            file.seek(self._start)
            rows = csv.reader((line for line in file if not line.startswith("#")), delimiter=self._separator)
            try:
                for fields in rows:
                    for name, place in places.items():
                        text = fields[place].strip() if place < len(fields) else ""
                        if text and not NUMERIC.fullmatch(text):
                            found[name].add(text)
            except csv.Error as error:
                raise InputError(f"{self.path} cannot be read as CSV: {error}; mend the file.") from None
        return found

    def where(self, row: int) -> str:
        """Say which line of the file holds row `row` (from 0)."""
        with self.path.open("rb") as file:
            header = file.read(self._start).count(b"\n")
            seen = -1
            for index, line in enumerate(file):
                seen += not _skipped(line)
                if seen == row:
                    return f"line {header + index + 1}"
        return f"row {row + 1}"

    def _parse(self, data: bytes, names: Sequence[str], first_row: int) -> Columns:
        """Parse lines; the quick way first, and line by line where that meets something unusual."""
        import polars as pl

        if not names:
            return {}
        for name in names:
            if self.names.count(name) > 1:
                raise InputError(f"{self.path} has several columns named {name!r}; give each its own name.")
        try:
            with reading_table(self.path, "CSV"):
                frame = self._frame(data, names, pl.Float64)
            usual = all(series.null_count() == 0 for series in frame.iter_columns())
        except InputError:
            usual = False
        if not usual:
            return self._parse_carefully(data, names, first_row)
        return {name: frame[str(self.names.index(name))].to_numpy() for name in names}

    def _frame(self, data: bytes, names: Sequence[str], kind: Any) -> Any:
        import polars as pl

        wanted = {self.names.index(name) for name in names}
        return pl.read_csv(
            data,
            has_header=False,
            separator=self._separator,
            comment_prefix="#",
            schema={str(i): kind if i in wanted else pl.String() for i in range(len(self.names))},
            columns=sorted(wanted),
            decimal_comma=self._decimal_comma,
            encoding="utf8-lossy",
        )

    def _parse_carefully(self, data: bytes, names: Sequence[str], first_row: int) -> Columns:
        """Parse with blanks around numbers, blank lines and missing values; say which line cannot be read."""
        import polars as pl

        lines = [line for line in data.splitlines(keepends=True) if not _skipped(line)]
        if not lines:
            raise InputError(f"{self.path} holds no rows; expected one row per sample under the column names.")
        separator = self._separator.encode()
        for row, line in enumerate(lines):
            if b'"' not in line and line.count(separator) >= len(self.names):
                raise InputError(
                    f"{self.path}, {self.where(first_row + row)}, has {line.count(separator) + 1} fields "
                    f"but there are {len(self.names)} column names; mend or remove that line."
                )
        with reading_table(self.path, "CSV"):
            frame = self._frame(b"".join(lines), names, pl.String)
        columns = {}
        for name in names:
            text = frame[str(self.names.index(name))].fill_null("").str.strip_chars()
            if self._decimal_comma:
                text = text.str.replace(",", ".", literal=True)
            values = text.cast(pl.Float64, strict=False)
            wrong = (values.is_null() & ~text.str.to_lowercase().is_in(MISSING)).to_numpy()
            if wrong.any():
                row = int(np.argmax(wrong))
                raise InputError(
                    f"{self.path}, {self.where(first_row + row)}, holds {shown(text[row])} in column {name!r}; "
                    "expected a number: mend that line, or name another column in [log]."
                )
            columns[name] = values.fill_null(float("nan")).to_numpy()
        return columns


def _skipped(line: bytes) -> bool:
    return line[:1] == b"#" or not line.strip()
