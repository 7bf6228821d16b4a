"""The tables of the thesis, as they are printed."""

from __future__ import annotations

import csv
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

__all__ = ["column", "rows"]


def rows(table: str) -> list[dict[str, str]]:
    """Return a table, each row by the names of the columns.

    Parameters
    ----------
    table : str
        Number, such as ``"4.9"``.

    Raises
    ------
    InputError
        If there is no such table.

    Examples
    --------
    >>> rows("6.2")[0]
    {'method': 'WLS', 'relative_error_percent': '19.64'}
    """
    begin = f"table_{table.replace('.', '_')}_"
    for file in (resources.files(__package__) / "published").iterdir():
        if file.name.startswith(begin):
            return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
    raise InputError(f"There is no table {table} among the published ones.")


def column(table: str, name: str) -> NDArray[np.float64]:
    """Return a column of numbers; NaN where nothing is printed.

    Examples
    --------
    >>> column("4.9", "WLS")[:2].tolist()
    [0.3712, 1.6481]
    """
    return np.array([float(row[name]) if row[name] else np.nan for row in rows(table)])
