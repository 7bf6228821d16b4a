"""The filters by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from steelyard.errors import InputError

from ..section import suggestion
from .butterworth import Butterworth
from .fourier import FourierFit
from .kalman import KalmanSmoother
from .motion_filter import MotionFilter
from .savitzky_golay import SavitzkyGolay

__all__ = ["FILTERS", "filter_from"]

FILTERS: dict[str, type[MotionFilter]] = {
    one.kind: one for one in (Butterworth, SavitzkyGolay, KalmanSmoother, FourierFit)
}


def filter_from(value: Any, where: str) -> MotionFilter:
    """Return the filter that a name, a table with a `kind`, or a filter itself stands for.

    Raises
    ------
    InputError
        For an unknown kind or key; `where` is named.

    Examples
    --------
    >>> filter_from({"kind": "savitzky_golay", "window": 0.1}, "[processing]")
    SavitzkyGolay(window=0.1, degree=4, cutoff=None)
    """
    if isinstance(value, MotionFilter):
        return value
    table = {"kind": value} if isinstance(value, str) else value
    if not isinstance(table, Mapping) or not isinstance(table.get("kind"), str):
        raise InputError(
            f"{where} is {value!r}; it must be one of {', '.join(FILTERS)}, or a table whose `kind` is one of them."
        )
    kind = table["kind"]
    if kind not in FILTERS:
        raise InputError(f"{where} is {kind!r}; {suggestion(kind, FILTERS)}the filters are {', '.join(FILTERS)}.")
    rest = {key: entry for key, entry in table.items() if key != "kind"}
    return FILTERS[kind].from_dict(rest, where.rstrip(","))
