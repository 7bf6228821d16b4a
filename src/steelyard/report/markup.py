"""Pieces of HTML: escaped text, numbers as a report writes them, tables."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence

__all__ = ["Markup", "escape", "number", "percent", "table"]


class Markup(str):
    """Text that is HTML already, and is not escaped again.

    Examples
    --------
    >>> escape("a < b"), escape(Markup("<b>bold</b>"))
    ('a &lt; b', '<b>bold</b>')
    """

    __slots__ = ()


def escape(text: object) -> Markup:
    """Return text as it may stand in an element or between the quotes of an attribute."""
    return text if isinstance(text, Markup) else Markup(html.escape(str(text), quote=True))


def number(value: float, decimals: int = 5) -> str:
    """Return a number with fixed decimals, so that columns align; small and large ones with an exponent.

    Examples
    --------
    >>> number(0.123456789), number(-2.5e-5), number(41234.5), number(0.0), number(float("nan"))
    ('0.12346', '-2.50e-05', '4.12e+04', '0.00000', '–')
    """
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    size = abs(value)
    if size >= 1e4 or 0.0 < size < 10.0 ** (1 - decimals):
        return f"{value:.2e}"
    return f"{value:.{decimals}f}"


def percent(fraction: float) -> str:
    """Return a fraction as a number of per cent.

    Examples
    --------
    >>> percent(0.04531), percent(12.0), percent(float("inf"))
    ('4.53', '1200', '∞')
    """
    if not math.isfinite(fraction):
        return number(fraction)
    return f"{100.0 * fraction:.2f}" if abs(fraction) < 10.0 else f"{100.0 * fraction:.0f}"


def table(
    caption: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    identifier: str,
    texts: Sequence[int] = (),
    muted: Sequence[int] = (),
    total: bool = False,
) -> Markup:
    """Return a table whose first column heads its rows; the others are numbers.

    Parameters
    ----------
    caption : str
    columns : sequence of str
    rows : iterable of sequence of str
    identifier : str
        The element's id.
    texts : sequence of int
        Further columns that hold text and not numbers.
    muted : sequence of int
        Rows that matter less.
    total : bool
        Whether the last row sums up the others.
    """

    def cells(row: Sequence[str]) -> str:
        first, *others = row
        tags = [f'<th scope="row">{escape(first)}</th>']
        for index, cell in enumerate(others, start=1):
            tags.append(f"<td>{escape(cell)}</td>" if index in texts else f'<td class="number">{escape(cell)}</td>')
        return "".join(tags)

    def heads() -> Iterable[str]:
        for index, title in enumerate(columns):
            kind = "" if index == 0 or index in texts else ' class="number"'
            yield f'<th scope="col"{kind}>{escape(title)}</th>'

    opening = {True: '<tr class="muted">', False: "<tr>"}
    lines = [f"{opening[index in muted]}{cells(row)}</tr>" for index, row in enumerate(rows)]
    foot = f"<tfoot>{lines.pop()}</tfoot>" if total and lines else ""
    body = "\n".join(lines)
    return Markup(
        f'<div class="scroll" role="region" tabindex="0" aria-labelledby="{identifier}-caption">'
        f'<table id="{identifier}"><caption id="{identifier}-caption">{escape(caption)}</caption>'
        f"<thead><tr>{''.join(heads())}</tr></thead>\n<tbody>{body}</tbody>{foot}</table></div>"
    )
