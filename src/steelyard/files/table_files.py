"""Tables of CSV and Parquet, read and written; and what a Parquet file says of its pages, before Polars believes it."""

from __future__ import annotations

import mmap
import os
import re
import struct
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

from .reading import reading_table, require_file

__all__ = ["check_parquet", "read_table", "write_table"]

MARK = b"PAR1"
GROUP_ROWS = 100_000
_OF_SYSTEM = re.compile(r"\(os error (\d+)\)")
LARGEST_FOOTER = 2**28
"""Bytes; that of a table of a hundred million numbers, written as Polars does, has a few hundred thousand."""

# Thrift's compact protocol, https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md, and the
# numbers of the fields of https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift.
TRUE, FALSE, BYTE, SHORT, INTEGER, LONG, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
NUMBERED = frozenset((SHORT, INTEGER, LONG, BINARY))  # each begins with an integer
ROW_GROUPS, COLUMNS, ROWS = 4, 1, 3
FILE, META_DATA, ENCRYPTED = 1, 3, 8  # of a column chunk
VALUES, COMPRESSED, DATA_PAGE, DICTIONARY = 5, 7, 9, 11  # of its metadata
SIZES = (2, 3)  # of a page, decoded and as it stands
COUNTS = {5: (1,), 7: (1,), 8: (1, 2, 3, 5, 6)}
"""Of what a page holds, by the field of its header: values; values of a dictionary; values, nulls, rows and lengths."""


def read_table(path: str | Path, remedy: str, *, text: bool = False) -> Any:
    """Return a table as a data frame of Polars.

    Parameters
    ----------
    path : str or Path
        A ``.parquet`` file, or CSV.
    remedy : str
        What to do where there is no file; ends the message.
    text : bool
        Whether the cells of CSV are taken as they are written.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    import polars

    require_file(path, remedy)
    parquet = Path(path).suffix.lower() == ".parquet"
    with reading_table(path, "Parquet" if parquet else "CSV"):
        if parquet:
            check_parquet(path)
            return polars.read_parquet(path, glob=False)
        return polars.read_csv(path, glob=False, infer_schema=not text)


def write_table(frame: Any, file: IO[bytes], suffix: str) -> None:
    """Write a data frame of Polars as CSV, or as Parquet in row groups that are small enough to be read one by one.

    Parameters
    ----------
    frame : polars.DataFrame
    file : binary file
        As `replaced_file` opens it, which tells why it cannot be written.
    suffix : str
        ``".csv"``, or that of Parquet.

    Raises
    ------
    OSError
        If the system refuses it, as where a disk is full.
    """
    from polars.exceptions import PolarsError

    try:
        if suffix == ".csv":
            frame.write_csv(file)
        else:
            frame.write_parquet(file, row_group_size=GROUP_ROWS)
    except (OSError, PolarsError) as error:  # whose words are those of the library, and wrong
        code = _OF_SYSTEM.search(str(error))
        if code is None:
            raise
        raise OSError(int(code[1]), os.strerror(int(code[1]))) from None


def check_parquet(path: str | Path) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Make sure that the pages of a Parquet file hold no more values than its columns, and none of less than none.

    Polars makes room for as many values as the header of a page says. Where one damaged byte makes them negative, or
    many more than memory holds, it does not raise an error but ends the process.

    Returns
    -------
    groups, pages : ndarray of int
        The rows at which groups of rows and, within them, pages begin, with the number of all rows at their ends.
        Where columns have pages of different lengths, the pages of the one that has most.

    Raises
    ------
    InputError
        If the file or one of its pages is damaged.
    """
    state = Path(path).stat()
    if not state.st_size:  # an empty file cannot be mapped; Polars says what it is
        return (np.zeros(1, dtype=np.int64),) * 2
    return _check_parquet(str(path), (state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns))


@lru_cache(maxsize=256)  # of 3000 columns it takes 0.3 s, and an identification opens a log several times
def _check_parquet(path: str, state: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    groups, pages = [0], [0]
    try:
        with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            for rows, columns in _groups(content):
                if rows < 0:
                    raise ValueError(f"a group of it has {rows} rows")
                counts = [_values_of_pages(content, rows, column) for column in columns]
                _forget(content)
                groups.append(rows)
                # Of a column of lists it is not told how many rows a page has.
                longest: list[int] = max((one for one in counts if sum(one) == rows), key=len, default=[rows])
                pages += longest
    except (ValueError, IndexError, KeyError, TypeError, OverflowError, RecursionError, struct.error) as error:
        reason = str(error) if type(error) is ValueError else "its metadata is damaged"
        raise InputError(f"{path} cannot be read as Parquet: {reason}; save it again.") from None
    return np.cumsum(groups), np.cumsum(pages)


def _forget(content: mmap.mmap) -> None:
    """Take what was seen of a file out of the memory of this process: 64 kB around each header, a GB of small pages."""
    if hasattr(mmap, "MADV_DONTNEED"):  # not on Windows
        content.madvise(mmap.MADV_DONTNEED)


def _groups(content: mmap.mmap) -> list[tuple[int, list[dict[int, Any]]]]:
    """The rows of each row group, and the metadata of its columns whose pages are in this file, to be read."""
    if len(content) < 12 or content[-4:] != MARK:
        return []  # what is no Parquet, or encrypted, Polars refuses by itself
    (length,) = struct.unpack("<I", content[-8:-4])
    if length > min(LARGEST_FOOTER, len(content) - 12):
        raise ValueError(f"its metadata would take {length} bytes")
    footer, _ = _read_struct(content[-8 - length : -8], 0)
    return [
        (group[ROWS], [one[META_DATA] for one in group[COLUMNS] if FILE not in one and ENCRYPTED not in one])
        for group in footer[ROW_GROUPS]
    ]


def _values_of_pages(content: mmap.mmap, rows: int, column: dict[int, Any]) -> list[int]:
    """Return how many values each page of a column has, whose pages follow one another, with sizes that can be.

    A row has one value at least, also where that is null or an empty list. Some writers tell fewer bytes of a column
    than its pages take, so that these are followed until all values are there.
    """
    left: int = column[VALUES]
    found: list[int] = []
    begins = [place for place in (column[DATA_PAGE], column.get(DICTIONARY, 0)) if place > 0]
    if begins:
        place = min(begins)
        end = place + column[COMPRESSED]
        sound = place <= end <= len(content) and 0 <= rows <= left
        while sound and (left > 0 or place < end):
            page, place = _read_struct(content, place)
            counts = [page[kind][field] for kind, fields in COUNTS.items() if kind in page for field in fields]
            values = sum(page[kind][1] for kind in (5, 8) if kind in page)
            sound = min(*counts, *(page[field] for field in SIZES)) >= 0 and values <= left
            found += [values] * (values > 0)  # a dictionary has none
            left -= values
            place += page[SIZES[1]]
        sound = sound and not left and place <= len(content)
    else:
        sound = not rows and not left
    if not sound:
        raise ValueError("the header of a page is damaged")
    return found


def _read_struct(content: bytes | mmap.mmap, place: int) -> tuple[dict[int, Any], int]:
    """Return the fields of a struct by their numbers, and where it ends."""
    found: dict[int, Any] = {}
    number = 0
    while head := content[place]:
        place += 1
        if head >> 4:
            number += head >> 4
        else:
            number, place = _read_integer(content, place)
        kind = head & 15
        if kind in (TRUE, FALSE):
            found[number] = kind == TRUE
        elif kind in NUMBERED and (value := content[place]) < 128:  # most of all, for which a call takes as long
            place += 1
            found[number] = None if kind == BINARY else (value >> 1) ^ -(value & 1)
            place += value * (kind == BINARY)
        else:
            found[number], place = _read_value(content, place, kind)
    return found, place + 1


def _read_value(content: bytes | mmap.mmap, place: int, kind: int) -> tuple[Any, int]:
    if kind in (SHORT, INTEGER, LONG):
        return _read_integer(content, place)
    if kind == BINARY:
        length, place = _read_varint(content, place)
        return None, place + length  # names and statistics, which nothing here needs
    if kind == STRUCT:
        return _read_struct(content, place)
    if kind in (LIST, SET):
        head, place = content[place], place + 1
        count, inner = head >> 4, head & 15
        if count == 15:
            count, place = _read_varint(content, place)
        found = []
        for _ in range(count):
            one, place = _read_value(content, place, inner)
            if place > len(content):
                raise ValueError("its metadata is damaged")
            found.append(one)
        return found, place
    if kind in (TRUE, FALSE, BYTE):  # elements of a list
        return content[place], place + 1
    if kind == DOUBLE:
        return None, place + 8
    raise ValueError("its metadata is damaged")


def _read_integer(content: bytes | mmap.mmap, place: int) -> tuple[int, int]:
    value, place = _read_varint(content, place)
    return (value >> 1) ^ -(value & 1), place


def _read_varint(content: bytes | mmap.mmap, place: int) -> tuple[int, int]:
    value = shift = 0
    while (byte := content[place]) & 0x80:
        value |= (byte & 0x7F) << shift
        shift, place = shift + 7, place + 1
        if shift > 63:
            raise ValueError("its metadata is damaged")
    return value | byte << shift, place + 1
