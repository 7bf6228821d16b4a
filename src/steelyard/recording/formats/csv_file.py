"""Logs as text: columns under a line of names, separated in whichever way."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import IO, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import reading_table, shown, tell

from ..columns import LogColumns
from .decoded import DecodedColumns, decoded_once
from .log_file import COMPRESSED, Columns, LogFile, column_length, flattened, offset_of, regrouped_columns

__all__ = ["CsvFile"]

BLANKS = " "
"""Stands for any number of spaces and tabs between columns."""
SEPARATORS = (";", "\t", ",", "|", BLANKS)
COMMENTS = ("#", "%", "//")
NUMERIC = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?|nan|inf", re.IGNORECASE)
COUNTED = 1 << 24  # bytes in which rows are counted together
READ = (1 << 18, 1 << 24)
"""Bytes that are parsed together: few at first, where only a look at some rows is wanted, and twice as many each time.
With 4 MB Polars takes as long as with 16 MB, and with 64 MB half as long again."""
MOST_DIGITS, LONGEST_WHOLE, DECIMALS = 17, 19, 9
"""Digits with which any float64 is written; those of whole numbers that 64 bits hold; and decimals that count where a
number has more digits, ns of s."""
LONGEST_LINE = 1_000_000  # of the header and what stands above it
MOST_BLANK = 10_000  # lines between the first ones that are not
HEAD_LINES = 100
"""First lines by which the dialect is told."""
MISSING = ("", "na", "null", "none", "nan", "-nan", "+nan")
UNIT = re.compile(
    r"[\[(]?(s|ms|us|µs|ns|(rad|deg|°|rev|turns?|m|mm)(/s(²|\^?2)?)?|m?n[ ·*]?m|n|m?a|rpm|-|1)?[\])]?", re.IGNORECASE
)
"""What stands in a line of units below the names."""


@dataclass(frozen=True)
class Dialect:
    """The dialect of a text file: how its fields, numbers and comments are written."""

    separator: str
    width: int
    """Number of columns of most lines."""
    decimal_comma: bool
    ends_with_separator: bool
    """Whether lines of data end with a separator behind the last column, and the line of names does not."""

    def split(self, line: str) -> list[str]:
        """Return the fields of a line."""
        if self.separator == BLANKS:
            fields = next(csv.reader([" ".join(line.split())], delimiter=" "), [])
        else:
            fields = [field.strip() for field in next(csv.reader([line], delimiter=self.separator), [])]
        return fields[:-1] if self.ends_with_separator and fields and not fields[-1] else fields


class Line(NamedTuple):
    """A line, and the bytes at which it and the next one begin."""

    begin: int
    end: int
    text: str


@dataclass(frozen=True)
class Head:
    """The meaning of the first lines of a text."""

    names: tuple[str, ...]
    start: int
    """Byte at which the data begin."""
    dialect: Dialect
    comment: str
    first: tuple[str, ...] = ()
    """The first field of each column that is not empty, among the lines that were looked at."""


class CsvFile(LogFile):
    """A text log: a line of names, and one line for each row.

    Columns are separated by semicolon, tab, comma, bar or blanks, whichever makes the first lines a table of numbers;
    numbers may have a decimal comma unless they are separated by commas without quotes. Blank lines, lines that begin
    with ``#``, ``%`` or ``//``, and what stands above the names are passed over. A comment right above the data is
    taken for the names if it has as many fields (as `numpy.savetxt` writes it), and a line of units below the names is
    joined to them, as ``q1 [rad]``. What ``ros2 topic echo --csv`` writes of a JointState is known without names. The
    file may be compressed by gzip, bzip2, xz or zstd. The header is the names of all columns, for a file that has none.
    """

    saved_as = ".csv"

    def __init__(self, path: Path, header: tuple[str, ...] | None = None) -> None:
        super().__init__(path)
        self._dates: set[str] = set()
        self._told: tuple[tuple[int, int], ...] | None = None
        self._head = self._read_head(header)
        self._comment = self._head.comment.encode()
        self.names = self._head.names
        first = dict(zip(self.names, self._head.first, strict=False))
        self._offsets = {name: offset for name, text in first.items() if (offset := self._offset_of(text))}
        self._decimal = {name for name in self._offsets if not first[name].lstrip("+-").isdigit()}
        self._origins = {name: _origin_of(text) for name, text in first.items()}

    @classmethod
    def opened(cls, path: Path, columns: LogColumns) -> Self:
        """Open a file; `header` names the columns of one that does not."""
        return cls(path, columns.header)

    @property
    def _fields(self) -> int:
        """How many fields a line of data has."""
        return len(self.names) + self._head.dialect.ends_with_separator

    def _offset_of(self, text: str) -> int | Fraction:
        """Return what is taken off a column that begins with a number; see `LogFile.offset`.

        It is also taken off decimal numbers with more digits than any float64 has, as s with nine decimals since 1970.
        """
        if self._head.dialect.decimal_comma:
            text = text.replace(",", ".")
        whole, _, rest = text.lstrip("+-").partition(".")
        if not (len(whole) <= LONGEST_WHOLE and whole.isdecimal() and whole.isascii()):
            return 0
        sign = -1 if text.startswith("-") else 1
        if not rest:
            return offset_of(sign * int(whole))
        if not (rest.isdecimal() and rest.isascii() and int(whole) and len(f"{int(whole)}{rest}") > MOST_DIGITS):
            return 0
        return sign * Fraction(f"{whole}.{rest[:DECIMALS]}")

    def offset(self, name: str) -> int | Fraction:
        """See `LogFile.offset`."""
        return self._offsets.get(name, 0)

    def origin(self, name: str) -> int:
        """See `LogFile.origin`."""
        return self._origins.get(name, 0)

    def _open(self, start: int = 0) -> IO[bytes]:
        if _is_compressed(self.path):
            from .compressed_text import open_compressed  # others need none of it

            file = open_compressed(self.path)
        else:
            file = self.path.open("rb")
        file.seek(start)
        return file

    def _first_lines(self) -> list[Line]:
        """Return the first lines that are not blank."""
        lines: list[Line] = []
        with self._open() as file:
            place = blank = 0
            while len(lines) < HEAD_LINES:
                raw = file.readline(LONGEST_LINE)
                if place == 0 and raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
                    raise InputError(f"{self.path} is text in UTF-16; save it as UTF-8.")
                if not raw:
                    break
                if len(raw) == LONGEST_LINE:
                    raise InputError(f"{self.path} has a line of more than {LONGEST_LINE} bytes; expected a CSV.")
                if b"\x00" in raw:
                    raise InputError(f"{self.path} is not a text file; expected a CSV with a line of column names.")
                line = _decoded(raw, "utf-8-sig" if place == 0 else "utf-8").strip("\r\n")
                if "\r" in line and not lines and raw.count(b"\r") > 1:
                    raise InputError(
                        f"{self.path} has lines that end with CR alone; save it with LF or CR LF as line endings."
                    )
                begin, place = place, place + len(raw)
                if line.strip():
                    lines.append(Line(begin, place, line))
                    continue
                blank += 1
                if blank > MOST_BLANK:  # of a few bytes, compression makes hours of them
                    raise InputError(f"{self.path} begins with more than {MOST_BLANK} blank lines; expected a CSV.")
        return lines

    def _read_head(self, header: tuple[str, ...] | None) -> Head:
        lines = self._first_lines()
        marks = [mark for line in lines for mark in COMMENTS if line.text.lstrip().startswith(mark)]
        comment = marks[0] if marks else COMMENTS[0]
        table = [line for line in lines if not line.text.startswith(comment)]
        if not table:
            raise InputError(f"{self.path} holds no rows; expected a line of column names and one row per sample.")
        dialect = _dialect([line.text for line in table])
        rows = [dialect.split(line.text) for line in table]
        data = next((k for k, fields in enumerate(rows) if _is_data(fields, dialect.width)), len(rows))
        texts = [k for k in range(data) if not _is_data(rows[k])]
        wide = [k for k in texts if len(rows[k]) == dialect.width] or texts
        if data == len(rows):  # names, and no row of numbers near them
            wide = wide[:1]
        start = table[wide[-1]].end if wide else table[0].begin
        columns = zip(*(fields for fields in rows[data:] if len(fields) == dialect.width), strict=True)
        begin = tuple(next(filter(None, column), "") for column in columns)
        if header is not None:
            count = len(rows[data]) if data < len(rows) else len(header)
            if len(header) != count:
                raise InputError(
                    f"{self.path} has {count} columns but `header` in [log] names {len(header)}; name all of them."
                )
            return Head(header, start, dialect, comment, begin)
        if wide:
            return Head(_with_units([rows[k] for k in wide]), start, dialect, comment, begin)
        first = rows[0]
        above = [line.text for line in lines if line.begin < start]
        names = _names_in_comment(above, dialect, comment, len(first)) or _ros_names(first)
        if names is None:
            raise InputError(
                f"{self.path} has no line of column names (it begins with {table[0].text[:40]!r}); name its "
                f'{len(first)} columns with `header = ["t", "q1", …, "tau1", …]` in [log], or add a first line such as '
                "t,q1,q2,tau1,tau2."
            )
        return Head(tuple(names), start, dialect, comment, begin)

    @classmethod
    def write(cls, file: IO[bytes], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write the columns under a line of their names."""
        import polars as pl

        from steelyard.files import write_table  # whoever reads needs none of it

        write_table(pl.DataFrame(flattened(arrays)), file, ".csv")

    def count(self) -> int:
        """Count the rows that hold data."""
        if self.kept:
            return self._decoded(self.kept).count
        count = done = 0
        with self._open(self._head.start) as file:
            while block := file.read(COUNTED):
                block += file.readline()
                if self._is_regular(b"\n" + block):
                    lines = block.count(b"\n") + (not block.endswith(b"\n"))
                else:
                    lines = sum(not self._skipped(line) for line in block.split(b"\n"))
                count, done = count + lines, done + len(block)
                tell(f"counting the rows of {self.path.name}", 1e-6 * done, None, "MB")
        return count

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns."""
        parts = list(self._parsed(names))
        if names and not parts:
            raise InputError(f"{self.path} holds no rows; expected one row per sample under the column names.")
        return {name: np.concatenate([part[name] for part in parts]) for name in names}

    def blocks_from(self, start: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of `rows` rows, from row `start` on.

        What is to be kept is parsed once, and stands decoded in memory or in a temporary file from then on.
        """
        if self.begins:
            row, byte = max(place for place in self.begins if place[0] <= start)
            return regrouped_columns(self._parsed(names, row, byte), rows, start - row)
        if self.kept and set(names) <= set(self.kept):
            return self._decoded(self.kept).blocks(start, names, rows)
        return regrouped_columns(self._parsed(names), rows, start)

    @classmethod
    def may_have_places(cls, path: Path) -> bool:
        """See `LogFile.may_have_places`."""
        return not _is_compressed(path)

    def places(self) -> tuple[tuple[int, int], ...] | None:
        """See `LogFile.places`; those of a file that was parsed. Dates are told by the first rows of a file."""
        if _is_compressed(self.path) or not self.kept:
            return None
        if self._told is None:  # once: of many logs only the last are kept decoded
            parsed = self._decoded(self.kept)
            self._told = () if parsed.dates else tuple(parsed.places)
        return self._told or None

    def _decoded(self, names: tuple[str, ...]) -> _ParsedColumns:
        """Return columns that were parsed once."""
        options = (CsvFile, names, self._head)
        return decoded_once(self.path, options, lambda: _ParsedColumns(names, self._parsed, self._dates))

    def _parsed(
        self,
        names: Sequence[str],
        first_row: int = 0,
        place: int | None = None,
        begins: list[tuple[int, int]] | None = None,
    ) -> Iterator[Columns]:
        """Parse columns from a row, which begins at a byte, to the last, some megabytes at a time.

        Rows and bytes at which these megabytes begin are added to `begins`.
        """
        size, most = READ
        start, whole = self._head.start, self.path.stat().st_size
        place = start if place is None else place
        begins = [] if begins is None else begins
        with self._open(place) as file:
            while names and (data := self._lines(file, size)):
                # The rows of a compressed file cannot be guessed from its length.
                guessed = first_row and not _is_compressed(self.path)
                total = first_row * (whole - start) / (place - start) if guessed else None
                tell(f"decoding {self.path.name}", first_row, total, "rows")
                begins.append((first_row, place))
                place += len(data)
                parsed = self._parse(data, names, first_row)
                first_row += column_length(parsed)
                if column_length(parsed):
                    yield parsed
                size = min(2 * size, most)

    def _lines(self, file: IO[bytes], size: int) -> bytes:
        """Read so many bytes, the rest of the last line, and of a text in it that has several; nothing at the end."""
        data = self._whole_lines(file, size)
        # Where there are none, to look for one takes a tenth of the time in which they are counted.
        return data + _rest_of_text(file) if b'"' in data and data.count(b'"') % 2 else data

    def _whole_lines(self, file: IO[bytes], size: int) -> bytes:
        if _is_compressed(self.path):
            data = file.read(size)
            return data + self._rest_of_line(file) if data else data
        # Where the line ends is found first: two pieces would be copied into one.
        start = file.tell()
        file.seek(start + size)
        size += len(self._rest_of_line(file))
        file.seek(start)
        return file.read(size)

    def _rest_of_line(self, file: IO[bytes]) -> bytes:
        rest = file.readline(LONGEST_LINE)
        if len(rest) == LONGEST_LINE:
            raise InputError(f"{self.path} has a line of more than {LONGEST_LINE} bytes; expected a CSV.")
        return rest

    def texts(self, names: Sequence[str]) -> dict[str, set[str]]:
        """Texts that stand in columns, each once; none for columns of numbers."""
        found: dict[str, set[str]] = {name: set() for name in names}
        places = {name: self.names.index(name) for name in names}
        if not names:
            return found
        dialect = self._head.dialect
        with self._open(self._head.start) as raw, io.TextIOWrapper(raw, "utf-8", "replace", newline="") as file:
            lines = (line for line in file if not line.startswith(self._head.comment))
            if dialect.separator == BLANKS:
                lines = (" ".join(line.split()) for line in lines)
            rows = csv.reader(lines, delimiter=dialect.separator)
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
        with self._open() as file:
            place = seen = 0
            for number, line in enumerate(file, start=1):
                if place >= self._head.start and not self._skipped(line):
                    if seen == row:
                        return f"line {number}"
                    seen += 1
                place += len(line)
        return f"row {row + 1}"

    def _skipped(self, line: bytes) -> bool:
        return line.startswith(self._comment) or not line.strip()

    def _parse(self, data: bytes, names: Sequence[str], first_row: int) -> Columns:
        """Parse lines; the quick way first, and line by line where that meets something unusual."""
        if not names:
            return {}
        if data.isspace():  # compressed, they may be many
            return dict.fromkeys(names, np.empty(0))
        for name in names:
            if self.names.count(name) > 1:
                raise InputError(f"{self.path} has several columns named {name!r}; give each its own name.")
        if self._head.dialect.separator == BLANKS:
            data = _unpadded(data.replace(b"\r\n", b"\n"), None)
        columns = self._parse_quickly(data, names)
        if columns is None and (b" " in data or b"\t" in data):
            columns = self._parse_quickly(_unpadded(data, self._head.dialect.separator), names)
        return self._parse_carefully(data, names, first_row) if columns is None else columns

    def _parse_quickly(self, data: bytes, names: Sequence[str]) -> Columns | None:
        """Parse lines of numbers, and of dates where there were some; None where they hold anything else."""
        import polars as pl

        if not self._begins_with_a_row(data):
            return None
        # A search for the sign alone is the fastest, and there is none as a rule.
        comments = self._comment[:1] in data and b"\n" + self._comment in data
        try:
            with reading_table(self.path, "CSV"):
                frame = self._frame(data, names, (self._dates | self._decimal) & set(names), comments)
        except InputError:
            return None
        columns = {}
        for name in names:
            series = frame[str(self.names.index(name))]
            if name in self._dates:
                from .dates import seconds_of_dates  # few logs have dates

                series = seconds_of_dates(series.str.strip_chars(), self.origin(name))
            elif name in self._decimal:
                series = self._counted(series, name)
            elif offset := self.offset(name):
                series = (series - offset).cast(pl.Float64)
            if series.null_count():
                # In a line that holds nothing, nothing is missing; of texts what is missing is told apart line by line.
                if name in self._dates | self._decimal or not self._is_regular(data):
                    return None
                series = series.fill_null(float("nan"))
            columns[name] = series.to_numpy()
        return columns

    def _begins_with_a_row(self, data: bytes) -> bool:
        """Whether the first line has all columns: Polars takes as many fields of the others, and drops what is more."""
        first = data[: data.find(b"\n") + 1 or None]
        separators = first.count(self._head.dialect.separator.encode())
        return separators == self._fields - 1 and not self._skipped(first)

    def _is_regular(self, data: bytes) -> bool:
        """Return whether each line but the first is sure to be a row."""
        # A line that holds no data begins with one of these; searching for all such lines takes ten times as long.
        begins = (b"\n", b"\r", b" ", b"\t", b"\v", b"\f", self._comment)
        return not any(b"\n" + begin in data for begin in begins)

    def _frame(self, data: bytes, names: Sequence[str], texts: Collection[str], comments: bool) -> Any:
        """Return the columns of lines, of which some are wanted as texts and the others as numbers.

        Polars takes a quarter more time where it has to look for comments.
        """
        import polars as pl

        dialect = self._head.dialect
        wanted = {self.names.index(name) for name in names}
        numbers = {
            self.names.index(name): pl.Int64() if name in self._offsets else pl.Float64()
            for name in names
            if name not in texts
        }
        return pl.read_csv(
            data,
            has_header=False,
            separator=dialect.separator,
            comment_prefix=self._head.comment if comments else None,
            schema={str(i): numbers.get(i, pl.String()) for i in range(self._fields)},
            columns=sorted(wanted),
            decimal_comma=dialect.decimal_comma and dialect.separator != ",",
            encoding="utf8-lossy",
        )

    def _parse_carefully(self, data: bytes, names: Sequence[str], first_row: int) -> Columns:
        """Parse with blanks around numbers, blank lines and missing values; say which line cannot be read."""
        import polars as pl

        dialect = self._head.dialect
        lines = [line for line in data.splitlines(keepends=True) if not self._skipped(line)]
        if not lines:
            return dict.fromkeys(names, np.empty(0))
        separator, most = dialect.separator.encode(), self._fields
        for row, line in enumerate(lines):
            if b'"' not in line and line.count(separator) >= most:
                raise InputError(
                    f"{self.path}, {self.where(first_row + row)}, has {line.count(separator) + 1} fields "
                    f"but there are {len(self.names)} column names; mend or remove that line."
                )
        # Polars counts the columns in the first line.
        lines[0] = lines[0].rstrip(b"\r\n") + separator * (most - 1 - lines[0].count(separator)) + b"\n"
        try:
            with reading_table(self.path, "CSV"):
                frame = self._frame(b"".join(lines), names, names, comments=False)
        except InputError:
            odd = next((row for row, line in enumerate(lines) if line.count(b'"') % 2), None)
            if odd is None:
                raise
            raise self._open_quote(first_row + odd) from None
        columns = {}
        for name in names:
            text = frame[str(self.names.index(name))].fill_null("").str.strip_chars()
            if dialect.decimal_comma:
                text = text.str.replace(",", ".", literal=True)
            values = text.cast(pl.Float64, strict=False)
            if offset := self.offset(name):
                exact = self._counted(text, name)
                values = exact.zip_with(exact.is_not_null(), values - float(offset))
            unread = values.is_null() & ~text.str.to_lowercase().is_in(MISSING)
            if unread.any():
                from .dates import seconds_of_dates

                dates = seconds_of_dates(text, self.origin(name))
                values = values.zip_with(~unread, dates)
                if not dates.null_count():
                    self._dates.add(name)
            wrong = (unread & values.is_null()).to_numpy()
            if wrong.any():
                row = int(np.argmax(wrong))
                # Older versions of Polars take such a mark for a part of the field.
                if text[row].count('"') % 2:
                    raise self._open_quote(first_row + row)
                raise InputError(
                    f"{self.path}, {self.where(first_row + row)}, holds {shown(text[row])} in column {name!r}; "
                    "expected a number: mend that line, or name another column in [log]."
                )
            columns[name] = values.fill_null(float("nan")).to_numpy()
        return columns

    def _counted(self, texts: Any, name: str) -> Any:
        """Return decimal numbers less the offset of their column, up to nine decimals exactly; null for other texts."""
        import polars as pl

        parts = texts.str.extract_groups(r"^\s*(?<sign>[-+]?)(?<whole>\d+)(?:[.,](?<rest>\d*))?\s*$").struct.unnest()
        sign = pl.Series(np.where(parts["sign"].fill_null("") == "-", -1, 1))
        rest = parts["rest"].fill_null("").str.slice(0, DECIMALS).str.pad_end(DECIMALS, "0").cast(pl.Int64)
        offset, parts_of_one = self._offsets[name], 10**DECIMALS
        begin = int(offset)  # both parts of a negative number are negative
        whole = (sign * parts["whole"].cast(pl.Int64, strict=False) - begin).cast(pl.Float64)
        counted = whole * parts_of_one + (sign * rest - int((offset - begin) * parts_of_one)).cast(pl.Float64)
        # NumPy divides, and rounds once; Polars multiplies by the reciprocal.
        numbers = pl.Series(counted.fill_null(0.0).to_numpy() / parts_of_one)
        return numbers.zip_with(counted.is_not_null(), pl.Series([None], dtype=pl.Float64))

    def _open_quote(self, row: int) -> InputError:
        return InputError(
            f"{self.path}, {self.where(row)}, has a quotation mark that nothing closes; mend or remove that line."
        )


def _origin_of(text: str) -> int:
    """Return from when a column counts that begins with a text; see `LogFile.origin`."""
    if not text or NUMERIC.fullmatch(text):
        return 0
    from .dates import origin_of_dates  # few logs have dates

    return origin_of_dates([text])


class _ParsedColumns(DecodedColumns):
    """The columns of a CSV, where in it rows begin, and which columns were found to hold dates."""

    def __init__(self, names: tuple[str, ...], parsed: Callable[..., Iterator[Columns]], dates: set[str]) -> None:
        self.places: list[tuple[int, int]] = []
        self.dates = dates
        super().__init__(names, lambda: parsed(names, begins=self.places if not self.places else None))


def _decoded(raw: bytes, encoding: str) -> str:
    """Return a line as text, by Windows-1252 where it is not UTF-8: a degree sign or an umlaut of an older program."""
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _rest_of_text(file: IO[bytes]) -> bytes:
    """Read up to the line that closes a quotation mark; nothing where none that is near does."""
    start, size, lines = file.tell(), 0, []
    while size < LONGEST_LINE and (line := file.readline(LONGEST_LINE)):
        lines.append(line)
        if line.count(b'"') % 2:
            return b"".join(lines)
        size += len(line)
    file.seek(start)
    return b""


def _is_compressed(path: Path) -> bool:
    return path.suffix.lower().removeprefix(".") in COMPRESSED


def _unpadded(data: bytes, separator: str | None) -> bytes:
    """Return lines without blanks at their ends and beside separators; blanks in between become one.

    Examples
    --------
    >>> _unpadded(b"  1.0 ;\t 2.0\\n 3.0; 4 5 \\n", ";"), _unpadded(b" 1.0\t  2.0 \\n", None)
    (b'1.0;2.0\\n3.0;4 5\\n', b'1.0 2.0\\n')
    """
    beside = [b"\n", b"\r\n"] if separator is None else [b"\n", b"\r\n", separator.encode()]
    if separator != "\t":
        data = data.replace(b"\t", b" ")
    while b"  " in data:
        data = data.replace(b"  ", b" ")
    for edge in beside:
        data = data.replace(b" " + edge, edge).replace(edge + b" ", edge)
    return data.strip(b" ")


def _is_data(fields: Sequence[str], width: int | None = None) -> bool:
    """Return whether any field is a number, and there are so many fields; a line of names has no number."""
    return width in (None, len(fields)) and any(NUMERIC.fullmatch(field) for field in fields)


def _dialect(lines: Sequence[str]) -> Dialect:
    """Tell how a text is written: by which separator most lines have as many numbers as each other."""
    best, dialect = (0.0, False, 0), Dialect(",", 1, False, False)
    for separator in SEPARATORS:
        plain = Dialect(separator, 0, False, False)
        try:
            rows = [plain.split(line) for line in lines]
        except csv.Error:
            continue
        data = [fields for fields in rows if _is_data(fields)] or rows
        lengths = [len(fields) for fields in data]
        width = max(lengths, key=lengths.count)
        regular = [fields for fields in data if len(fields) == width]
        numbers = [field for fields in regular for field in fields if NUMERIC.fullmatch(field)]
        share = (len(numbers) + sum(not field for fields in regular for field in fields)) / (width * len(data))
        names = [len(fields) for fields in rows if not _is_data(fields)]
        score = share, width in names, width
        if width > 1 and score > best:
            comma = any("," in number for number in numbers) and not any("." in number for number in numbers)
            ends = width - 1 in names and all(not fields[-1] for fields in regular)
            best, dialect = score, Dialect(separator, width - ends, comma, ends)
    return dialect


def _with_units(above: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return the names that stand above the data, with a line of units joined to them."""
    names = above[-1]
    if len(above) > 1 and len(above[-2]) == len(names) and all(UNIT.fullmatch(field) for field in names):
        pairs = zip(above[-2], names, strict=True)
        return tuple(f"{name} [{unit.strip('[]()')}]" if unit.strip("[]()-1") else name for name, unit in pairs)
    return tuple(names)


def _names_in_comment(above: Sequence[str], dialect: Dialect, comment: str, count: int) -> list[str] | None:
    """Return the names in the comment right above the data; None where there are none."""
    if not above:
        return None
    names = dialect.split(above[-1].lstrip().removeprefix(comment).lstrip(comment[0]).strip())
    return names if len(names) == count and not _is_data(names) else None


def _ros_names(fields: Sequence[str]) -> list[str] | None:
    """Return the names of what ``ros2 topic echo --csv`` writes of a JointState; None for other lines.

    Examples
    --------
    >>> _ros_names(["17", "250000000", "", "elbow", "0.5", "0.1", "7.0"])[2:]
    ['header.frame_id', 'name[0]', 'position[0]', 'velocity[0]', 'effort[0]']
    >>> _ros_names(["17", "250000000", "base", "elbow", "wrist", "0.5", "0.1", "", "7.0", "8.0"])[5:]
    ['position[0]', 'position[1]', 'velocity', 'effort[0]', 'effort[1]']
    """
    numbers = [bool(NUMERIC.fullmatch(field)) for field in fields]
    if numbers[:3] != [True, True, False]:
        return None
    joints = [*numbers[3:], True].index(True)
    if joints == 0:
        return None
    names = ["header.stamp.sec", "header.stamp.nanosec", "header.frame_id", *(f"name[{k}]" for k in range(joints))]
    for kind in ("position", "velocity", "effort"):
        place = len(names)
        if fields[place : place + 1] == [""]:  # an empty list
            names.append(kind)
        elif all(numbers[place : place + joints]):
            names += [f"{kind}[{k}]" for k in range(joints)]
    return names if len(names) == len(fields) else None
