"""Dates and times in columns of logs: as texts, and as NumPy's own, in seconds.

They are whole ns since 1970, more than a float64 counts: it would round them by 2.4e-7 s. So the first is taken off
before they become numbers of s.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "LONGEST_DATE",
    "PER_SECOND",
    "is_date",
    "origin_of_dates",
    "origin_of_times",
    "seconds_of_dates",
    "seconds_of_texts",
    "seconds_of_times",
]

LONGEST_DATE = 60
"""Characters of a text that may be a date."""
LATEST = 9_200_000_000
"""s since 1970 beyond which 64 bits hold no ns."""
PER_SECOND = {"s": 1, "ms": 1000, "us": 1_000_000, "ns": 1_000_000_000}
MISSING = ("", "NaT", "None", "nan")
CLOCK = r"(?<time>\d\d:\d\d:\d\d)"
FORMS = (
    (rf"(?<date>\d{{4}}-\d\d-\d\d)[T ]{CLOCK}", "%Y-%m-%d", "%H:%M:%S"),
    (rf"(?<date>\d{{4}}/\d\d/\d\d)[T ]{CLOCK}", "%Y/%m/%d", "%H:%M:%S"),
    (rf"(?<date>\d\d\.\d\d\.\d{{4}}),? {CLOCK}", "%d.%m.%Y", "%H:%M:%S"),
    (rf"(?<date>\d\d-[A-Za-z]{{3}}-\d{{4}}) {CLOCK}", "%d-%b-%Y", "%H:%M:%S"),
    (r"(?<date>\d{8})[T ](?<time>\d{6})", "%Y%m%d", "%H%M%S"),
    (rf"(?<date>){CLOCK}", "", "%H:%M:%S"),
)
"""Dates and times: ISO 8601, with slashes, with dots as in Germany, of MATLAB, without separators, and times of a day.
Where the month may stand before the day or behind it, as in 03/04/2026, nothing is guessed."""
REST = r"(?<fraction>[.,]\d+)?\s*(?:Z|UTC|(?<sign>[-+])(?<hours>\d\d):?(?<minutes>\d\d))?$"
_FORMS = tuple(re.compile(f"\\s*{form}{REST}".replace("(?<", "(?P<")) for form, *_ in FORMS)


def is_date(text: str) -> bool:
    """Tell whether a text is a date and a time, or a time.

    Examples
    --------
    >>> is_date("2026-11-22T14:05:07.25+01:00"), is_date("22-Nov-2026 14:05:07"), is_date("14.05")
    (True, True, False)
    """
    return len(text) <= LONGEST_DATE and any(form.match(text) for form in _FORMS)


def seconds_of_dates(texts: Any, origin: int = 0) -> Any:
    """Return dates and times, all in the form of the first, in seconds from an origin; null for other texts.

    Parameters
    ----------
    texts : polars.Series
        Of strings.
    origin : int
        ns since 1970, which are taken off before numbers are rounded: see `origin_of_dates`.

    Returns
    -------
    polars.Series
        Times of a day count from midnight.

    Examples
    --------
    >>> import polars as pl
    >>> seconds_of_dates(pl.Series(["1970-01-02 00:00:01.5", "1970-01-02T01:00:01,5+01:00", "soon"])).to_list()
    [86401.5, 86401.5, None]
    >>> dates = ["2026-11-22 14:05:07", "2026-11-22 14:05:07.000000003"]
    >>> seconds_of_dates(pl.Series(dates), origin_of_dates(dates)).to_list()
    [0.0, 3e-09]
    """
    import polars as pl

    whole = _nanoseconds(texts) - origin
    # NumPy divides, and rounds once; Polars multiplies by the reciprocal.
    seconds = pl.Series(texts.name, whole.cast(pl.Float64).fill_null(0.0).to_numpy() / 1e9)
    return seconds.zip_with(whole.is_not_null(), pl.Series([None], dtype=pl.Float64)) if whole.null_count() else seconds


def _nanoseconds(texts: Any) -> Any:
    """Return dates as whole ns since 1970; null for other texts, and beyond the year 2261, for 64 bits hold no more."""
    import polars as pl

    first = next((text for text in texts if text is not None and is_date(text)), None)
    if first is None:
        return pl.Series(texts.name, [None] * len(texts), dtype=pl.Int64)
    form, day, clock = next(one for one, found in zip(FORMS, _FORMS, strict=True) if found.match(first))
    parts = texts.str.extract_groups(rf"^\s*{form}{REST}").struct.unnest()
    zone = parts["hours"].cast(pl.Int64) * 3600 + parts["minutes"].cast(pl.Int64) * 60
    dated = parts["date"] if day else pl.Series(["1970-01-01"] * len(texts))
    whole = (dated + " " + parts["time"]).str.to_datetime(f"{day or '%Y-%m-%d'} {clock}", strict=False)
    # A float64 rounds it by less than half of a ns.
    fraction = ("0" + parts["fraction"].fill_null(".0").str.replace(",", ".", literal=True)).cast(pl.Float64)
    sign = pl.Series(np.where(parts["sign"].fill_null("+") == "-", -1, 1))
    seconds = whole.dt.epoch("s") - sign * zone.fill_null(0)
    counted = seconds * 1_000_000_000 + (1e9 * fraction).round().cast(pl.Int64)
    return counted.zip_with(seconds.abs() < LATEST, pl.Series([None], dtype=pl.Int64))


def origin_of_dates(texts: Iterable[Any]) -> int:
    """Return the first of some dates in ns since 1970, from which the others count; 0 for times of a day, and others.

    Examples
    --------
    >>> origin_of_dates(["", "1970-01-01 00:00:02", "1970-01-01 00:00:03"]), origin_of_dates(["14:05:07"])
    (2000000000, 0)
    """
    import polars as pl

    first = next((text for text in map(_text, texts) if text not in MISSING), "")
    if (
        not is_date(first)
        or next(day for (_, day, _), form in zip(FORMS, _FORMS, strict=True) if form.match(first)) == ""
    ):
        return 0
    return int(_nanoseconds(pl.Series([first]))[0] or 0)


def seconds_of_texts(array: NDArray[Any], origin: int = 0) -> NDArray[np.float64] | None:
    """Return texts (S,) that are dates in s from an origin, NaN where one is missing; None where they are others.

    Examples
    --------
    >>> seconds_of_texts(np.array([b"00:00:01.5", b"00:00:02", b""])), seconds_of_texts(np.array(["elbow"]))
    (array([1.5, 2. , nan]), None)
    """
    if array.ndim != 1 or not array.size:
        return None
    values = array.tolist()
    first = next((text for text in map(_text, values) if text not in MISSING), "")
    if not is_date(first):
        return None
    import polars as pl

    texts = [_text(value) for value in values]
    seconds = seconds_of_dates(pl.Series(texts, dtype=pl.String), origin)
    unread = np.flatnonzero(seconds.is_null().to_numpy())
    if any(texts[row] not in MISSING for row in unread):
        return None
    return np.asarray(seconds.fill_null(float("nan")).to_numpy())


def _text(value: Any) -> str:
    return (value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)).strip()


def seconds_of_times(array: NDArray[Any], origin: int = 0) -> NDArray[np.float64]:
    """Return NumPy's dates (since 1970) or durations in s from an origin in ns, NaN for those that are none.

    Examples
    --------
    >>> seconds_of_times(np.array(["1970-01-01T00:00:02.500", "NaT"], dtype="datetime64[ms]"))
    array([2.5, nan])
    """
    unit, count = np.datetime_data(array.dtype)
    per_second = PER_SECOND.get(unit)
    if per_second is None or count != 1:
        per_second, array = 1_000_000_000, array.astype(f"{array.dtype.kind}8[ns]")
    whole = array.astype(np.int64) - origin * per_second // 1_000_000_000
    return np.asarray(np.where(np.isnat(array), np.nan, whole.astype(np.float64) / per_second))


def origin_of_times(array: NDArray[Any]) -> int:
    """Return the first of NumPy's dates in ns since 1970, from which the others count; 0 for durations.

    Examples
    --------
    >>> origin_of_times(np.array(["NaT", "1970-01-01T00:00:02.500"], dtype="datetime64[ms]"))
    2500000000
    """
    if array.dtype.kind != "M" or (first := array[~np.isnat(array)][:1]).size == 0:
        return 0
    return int(first.astype("datetime64[ns]").astype(np.int64)[0])
