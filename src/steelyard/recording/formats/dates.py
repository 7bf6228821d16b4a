"""Dates and times in columns of logs: as texts, and as NumPy's own, in seconds."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..columns import TIME_UNITS

__all__ = ["LONGEST_DATE", "is_date", "seconds_of_dates", "seconds_of_texts", "seconds_of_times"]

LONGEST_DATE = 60
"""Characters of a text that may be a date."""
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


def seconds_of_dates(texts: Any) -> Any:
    """Return dates and times, all in the form of the first, in seconds since 1970; null for other texts.

    Parameters
    ----------
    texts : polars.Series
        Of strings.

    Returns
    -------
    polars.Series
        Times of a day count from midnight.

    Examples
    --------
    >>> import polars as pl
    >>> seconds_of_dates(pl.Series(["1970-01-02 00:00:01.5", "1970-01-02T01:00:01,5+01:00", "soon"])).to_list()
    [86401.5, 86401.5, None]
    """
    import polars as pl

    first = next((text for text in texts if text is not None and is_date(text)), None)
    if first is None:
        return pl.Series(texts.name, [None] * len(texts), dtype=pl.Float64)
    form, day, clock = next(one for one, found in zip(FORMS, _FORMS, strict=True) if found.match(first))
    parts = texts.str.extract_groups(rf"^\s*{form}{REST}").struct.unnest()
    offset = parts["hours"].cast(pl.Float64) * 3600.0 + parts["minutes"].cast(pl.Float64) * 60.0
    dated = parts["date"] if day else pl.Series(["1970-01-01"] * len(texts))
    whole = (dated + " " + parts["time"]).str.to_datetime(f"{day or '%Y-%m-%d'} {clock}", strict=False)
    fraction = ("0" + parts["fraction"].fill_null(".0").str.replace(",", ".", literal=True)).cast(pl.Float64)
    sign = pl.Series(np.where(parts["sign"].fill_null("+") == "-", -1.0, 1.0))
    return whole.dt.epoch("s").cast(pl.Float64) + fraction - sign * offset.fill_null(0.0)


def seconds_of_texts(array: NDArray[Any]) -> NDArray[np.float64] | None:
    """Return texts (S,) that are dates in s, NaN where one is missing; None where they are something else.

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
    seconds = seconds_of_dates(pl.Series(texts, dtype=pl.String))
    unread = np.flatnonzero(seconds.is_null().to_numpy())
    if any(texts[row] not in MISSING for row in unread):
        return None
    return np.asarray(seconds.fill_null(float("nan")).to_numpy())


def _text(value: Any) -> str:
    return (value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)).strip()


def seconds_of_times(array: NDArray[Any]) -> NDArray[np.float64]:
    """Return NumPy's dates (since 1970) or durations in s, NaN for those that are none.

    Examples
    --------
    >>> seconds_of_times(np.array(["1970-01-01T00:00:02.500", "NaT"], dtype="datetime64[ms]"))
    array([2.5, nan])
    """
    unit, count = np.datetime_data(array.dtype)
    if unit not in TIME_UNITS or count != 1:
        unit, array = "ns", array.astype(f"{array.dtype.kind}8[ns]")
    seconds = array.astype(np.int64).astype(np.float64) * TIME_UNITS[unit]
    return np.asarray(np.where(np.isnat(array), np.nan, seconds))
