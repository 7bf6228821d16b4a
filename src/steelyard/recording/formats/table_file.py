"""Logs as tables of typed columns that Polars reads: what Parquet and Arrow have in common."""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import reading_table, shown

from .data_frames import INDEX
from .dates import PER_SECOND, origin_of_dates
from .log_file import Columns, LogFile, offset_of, regrouped_columns

__all__ = ["TableFile"]

MOST_ELEMENTS = 1000
"""Numbers in a list of one row; more are a picture."""
READ_NUMBERS = 1_500_000
"""Numbers of all columns that are read together, if that is more than one block."""


class TableFile(LogFile):
    """A table of columns of numbers, of texts, of times, and of lists of as many numbers in each row.

    A column of times counts in s from the first row. A list `q` makes the columns ``q_0``, ``q_1`` and so on, or
    ``q[elbow]`` where LeRobot's ``meta/info.json`` names the joints.
    """

    kind: ClassVar[str]
    """What such a file is called in messages."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with self._reading():
            self._scan = self._scanned()
            self._schema = dict(self._scan.collect_schema())
            if self._schema.get(INDEX) is not None and self._schema[INDEX].is_temporal() and "time" not in self._schema:
                self._scan = self._scan.rename({INDEX: "time"})
                self._schema = dict(self._scan.collect_schema())
        self._elements: dict[str, tuple[str, int]] = {}
        self._firsts: dict[str, Any] = {}
        self._widths: dict[str, int] = {}
        names: list[str] = []
        for name, kind in self._schema.items():
            width = self._width(name, kind)
            if width is None:
                names.append(name)
                continue
            self._widths[name] = width
            elements = _element_names(path, name, width) if 0 < width <= MOST_ELEMENTS else []
            self._elements.update({element: (name, index) for index, element in enumerate(elements)})
            names += elements
        self.names = tuple(names)

    @abstractmethod
    def _scanned(self) -> Any:
        """Open the file as a lazy frame."""

    def _reading(self) -> contextlib.AbstractContextManager[None]:
        return reading_table(self.path, self.kind)

    def _width(self, name: str, kind: Any) -> int | None:
        """Return how many numbers the lists of a column hold; None where it is no column of lists of numbers."""
        import polars as pl

        inner = getattr(kind, "inner", None)
        if inner is None or not inner.is_numeric():
            return None
        if isinstance(kind, pl.Array):
            return kind.size if len(kind.shape) == 1 else 0
        with self._reading():
            first = self._scan.select(pl.col(name).drop_nulls().head(1).list.len()).collect()[name]
        return int(first[0]) if len(first) else 0

    def count(self) -> int:
        """Count the rows."""
        import polars as pl

        with self._reading():
            return int(self._scan.select(pl.len()).collect().item())

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns."""
        return self._numbers(self._scan, names)

    def blocks_from(self, start: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of rows, from row `start` on."""
        together = rows * max(1, READ_NUMBERS // (rows * max(1, len(names))))
        return regrouped_columns(self._parts(start, names, together), rows)

    def _parts(self, first: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns from a row on, about so many rows at a time."""
        for scan in self._scans(first, names, rows):
            yield self._numbers(scan, names)

    def _scans(self, first: int, names: Sequence[str], rows: int) -> Iterator[Any]:
        """Yield lazy frames of about so many rows, which follow one another from a row on."""
        count = self.count()
        while first < count:
            stop = self._part_end(first, count, rows)
            yield self._scan.slice(first, stop - first)
            first = stop

    def _part_end(self, first: int, count: int, rows: int) -> int:
        """Return where a part of about so many rows from `first` on is best to end; there are `count` rows."""
        return min(count, (first // rows + 1) * rows)

    @classmethod
    def may_have_places(cls, path: Path) -> bool:
        """See `LogFile.may_have_places`."""
        return True

    def places(self) -> tuple[tuple[int, int], ...] | None:
        """See `LogFile.places`; rows are found by their numbers."""
        return ()

    def texts(self, names: Sequence[str]) -> dict[str, set[str]]:
        """Texts that stand in columns, each once; none for columns of numbers."""
        import polars as pl

        columns = [name for name in names if self._schema.get(name) == pl.String]
        with self._reading():
            return {
                name: set(self._scan.select(pl.col(name).drop_nulls().unique()).collect()[name].to_list())
                for name in columns
            }

    def _numbers(self, scan: Any, names: Sequence[str]) -> Columns:
        import polars as pl

        if not names:
            return {}
        chosen, per_second, texts = [], {}, []
        for name in names:
            if name in self._elements:
                chosen.append(self._element(name))
                continue
            kind = self._schema[name]
            if _is_time(kind):
                # Since 1970 there are more ns than a float64 counts; the difference is a whole number of them, and is
                # divided by NumPy, which rounds once: Polars multiplies by the reciprocal.
                chosen.append((pl.col(name).to_physical() - self._first(name)).cast(pl.Float64))
                per_second[name] = _per_second(kind)
            elif offset := self.offset(name):
                chosen.append((pl.col(name).cast(pl.Int64, strict=False) - offset).cast(pl.Float64))
            elif kind.is_numeric():
                chosen.append(pl.col(name).cast(pl.Float64))
            elif isinstance(kind, pl.String | pl.Categorical | pl.Enum):
                chosen.append(pl.col(name).cast(pl.String))
                texts.append(name)
            else:
                raise InputError(f"{self.path} has values of type {kind} in column {name!r}; expected numbers.")
        lists = {self._elements[name][0] for name in names if name in self._elements}
        lengths = [pl.col(name).list.len().alias(f"{name} length") for name in lists if not self._is_fixed(name)]
        with self._reading():
            frame = scan.select([*chosen, *lengths]).collect()
        for name in lists:
            if not self._is_fixed(name):
                self._require_width(name, frame[f"{name} length"].drop_nulls().to_numpy())
        read = {name: self._dates(frame[name]) if name in texts else frame[name] for name in names}
        # To fill in what is not missing takes a fifth as long as decoding.
        filled = {name: one.fill_null(float("nan")) if one.null_count() else one for name, one in read.items()}
        columns = {name: one.to_numpy() for name, one in filled.items()}
        return columns | {name: columns[name] / scale for name, scale in per_second.items()}

    def _dates(self, texts: Any) -> Any:
        """Return a column of texts as times in s; only dates can be used as numbers."""
        from .dates import seconds_of_dates

        seconds = seconds_of_dates(texts, self.origin(texts.name))
        unread = texts.filter(seconds.is_null() & texts.is_not_null())
        if len(unread):
            raise InputError(f"{self.path} holds {shown(unread[0])} in column {texts.name!r}; expected numbers.")
        return seconds

    def _is_fixed(self, name: str) -> bool:
        import polars as pl

        return isinstance(self._schema[name], pl.Array)

    def _element(self, name: str) -> Any:
        import polars as pl

        column, index = self._elements[name]
        lists = pl.col(column)
        value = lists.arr.get(index) if self._is_fixed(column) else lists.list.get(index, null_on_oob=True)
        return value.cast(pl.Float64).alias(name)

    def _require_width(self, name: str, lengths: NDArray[Any]) -> None:
        wrong = lengths[lengths != self._widths[name]]
        if wrong.size:
            raise InputError(
                f"{self.path} has lists of {self._widths[name]} and of {wrong[0]} numbers in column {shown(name)}; "
                "each row needs one number for each joint."
            )

    def offset(self, name: str) -> int:
        """See `LogFile.offset`."""
        import polars as pl

        return offset_of(self._first(name)) if self._schema.get(name) in (pl.Int64, pl.UInt64) else 0

    def origin(self, name: str) -> int:
        """See `LogFile.origin`."""
        import polars as pl

        kind = self._schema.get(name)
        if kind is None:
            return 0
        if isinstance(kind, pl.String | pl.Categorical | pl.Enum):
            return origin_of_dates([self._first(name)])
        return self._first(name) * (1_000_000_000 // _per_second(kind)) if _is_time(kind) else 0

    def _first(self, name: str) -> Any:
        """Return the first value of a column, of a time in whole numbers of its own unit; 0 where none is there."""
        import polars as pl

        if name not in self._firsts:
            column = pl.col(name).to_physical() if _is_time(self._schema[name]) else pl.col(name)
            with self._reading():
                first = self._scan.select(column.drop_nulls().head(1)).collect()[name]
            self._firsts[name] = first[0] if len(first) else 0
        return self._firsts[name]


def _is_time(kind: Any) -> bool:
    import polars as pl

    return bool(kind.is_temporal() and kind != pl.Date)


def _per_second(kind: Any) -> int:
    return PER_SECOND[getattr(kind, "time_unit", "ns")]


def _element_names(path: Path, name: str, width: int) -> list[str]:
    joints = _lerobot_names(path, name) if "." in name or name == "action" else []
    if len(joints) != width or len(set(joints)) != width:
        return [f"{name}_{index}" for index in range(width)]
    if all("." in joint for joint in joints) and not all(joint.endswith(".pos") for joint in joints):
        return [f"{name}/{joint}" for joint in joints]  # quantities of their own, as `elbow.vel`
    return [f"{name}[{joint.removesuffix('.pos')}]" for joint in joints]


def _lerobot_names(path: Path, name: str) -> list[str]:
    """Return the names of the numbers in a list, from the file in which LeRobot describes a data set."""
    from steelyard.files import read_json

    for folder in path.absolute().parents[:4]:
        described = folder / "meta" / "info.json"
        if described.is_file():
            content = read_json(described)
            features = content.get("features") if isinstance(content, dict) else None
            feature = features.get(name) if isinstance(features, dict) else None
            names = feature.get("names") if isinstance(feature, dict) else None
            if isinstance(names, dict):
                names = next(iter(names.values()), None) if len(names) == 1 else list(names)
            return names if isinstance(names, list) and all(isinstance(one, str) for one in names) else []
    return []
