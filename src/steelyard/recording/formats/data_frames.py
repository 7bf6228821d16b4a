"""Columns of data frames of any library, by the Arrow C stream protocol, as NumPy arrays."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

__all__ = ["INDEX", "frame_arrays", "is_frame"]

INDEX = "__index_level_0__"  # what pandas calls an index without a name in an Arrow stream


def is_frame(data: object) -> bool:
    """Tell whether data is a data frame; pandas has the protocol only together with pyarrow."""
    return (
        hasattr(data, "__arrow_c_stream__") or _is_lazy(data) or (hasattr(data, "columns") and hasattr(data, "index"))
    )


def _is_lazy(data: object) -> bool:
    """Tell whether data is a LazyFrame of Polars."""
    return hasattr(type(data), "collect_schema") and hasattr(type(data), "lazy") and not hasattr(data, "write_csv")


def frame_arrays(frame: Any, name: str) -> dict[str, NDArray[Any]]:
    """Return the columns of a data frame: numbers, dates and texts (S,), and lists of numbers (S, M).

    An index of pandas is a column too; one of dates without a name is called ``time``.

    Parameters
    ----------
    frame : data frame
        Of Polars, pandas, PyArrow or any library that has the Arrow C stream protocol.
    name : str
        What messages call it.

    Raises
    ------
    InputError
        If two columns have one name, or the data frame cannot be read.
    """
    if _is_lazy(frame):
        frame = frame.collect()
    labels = _labels(frame)
    listed = [_name(label) for label in labels]
    twice = [key for key, count in Counter(listed).items() if count > 1]
    if twice:
        raise InputError(f"{name} has several columns named {twice[0]!r}; give each its own name.")
    try:
        of_tuples = any(isinstance(label, tuple) for label in labels)
        found = _by_pandas(frame, listed) if of_tuples else _by_arrow(frame)
    except Exception as error:  # whatever the library of the data frame raises
        if not hasattr(frame, "index") or not hasattr(frame, "columns"):
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"{name} cannot be read as a data frame ({type(error).__name__}: {reason}); give a mapping of arrays."
            ) from error
        found = _by_pandas(frame, listed)
    index = found.pop(INDEX, None)
    if index is not None:
        found["time" if index.dtype.kind in "mM" else "index"] = index
    return found


def _labels(frame: Any) -> list[Any]:
    # The attribute of that name of a PyArrow table holds the columns themselves.
    labels = frame.column_names if hasattr(frame, "column_names") else getattr(frame, "columns", ())
    return list(labels)


def _name(label: Any) -> str:
    """Name a column; those of pandas may have several levels, such as joint and signal."""
    return ".".join(str(part) for part in label if part != "") if isinstance(label, tuple) else str(label)


def _by_arrow(frame: Any) -> dict[str, NDArray[Any]]:
    import polars as pl

    if not isinstance(frame, pl.DataFrame):
        frame = pl.DataFrame(_Stream(frame))
    return {series.name: _array(series) for series in frame.iter_columns()}


class _Stream:
    """The Arrow stream of a data frame and nothing else: libraries that Polars knows go another way there."""

    def __init__(self, frame: Any) -> None:
        self._frame = frame

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self._frame.__arrow_c_stream__(requested_schema)


def _array(series: Any) -> NDArray[Any]:
    import polars as pl

    kind = series.dtype
    if kind == pl.List and kind.inner.is_numeric():
        widths = series.list.len().unique().to_list()
        if len(widths) == 1 and widths[0]:
            series = series.list.to_array(widths[0])
            kind = series.dtype
    if kind == pl.Array and len(kind.shape) == 1 and kind.inner.is_numeric():
        return np.asarray(series.cast(pl.Array(pl.Float64, kind.shape[0])).to_numpy())
    if kind in (pl.Int64, pl.UInt64) and not series.null_count():  # of which a float64 would not hold all digits
        return np.asarray(series.to_numpy())
    if kind.is_numeric() or kind == pl.Boolean:
        return np.asarray(series.cast(pl.Float64).fill_null(float("nan")).to_numpy())
    return np.asarray(series.to_numpy())


def _by_pandas(frame: Any, names: list[str]) -> dict[str, NDArray[Any]]:
    columns = [frame[key] for key in frame.columns]
    index = frame.index
    if index.name is not None or not type(index).__name__.startswith("Range"):
        names, columns = [*names, str(index.name or INDEX)], [*columns, index]
    return {name: _values(column) for name, column in zip(names, columns, strict=True)}


def _values(column: Any) -> NDArray[Any]:
    if str(column.dtype) in ("int64", "uint64"):  # without a missing value
        return np.asarray(column.to_numpy())
    if str(column.dtype).lower().startswith(("float", "int", "uint", "bool")):
        return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan))
    return np.asarray(column.to_numpy())
