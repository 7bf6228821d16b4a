"""Tables by which objects are printed: as text, and as HTML for notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

__all__ = ["html_table", "text_table"]


def text_table(heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """Return columns side by side, those with the indices `numbers` aligned to the right.

    Examples
    --------
    >>> print(text_table(("name", "kg"), [("arm", "1.5"), ("forearm", "12")], numbers=(1,)))
    name      kg
    arm      1.5
    forearm   12
    """
    table = [list(heads), *(list(row) for row in rows)]
    widths = [max(len(row[i]) for row in table) for i in range(len(heads))]
    lines = []
    for row in table:
        cells = [c.rjust(w) if i in numbers else c.ljust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def html_table(
    caption: str, heads: Sequence[str], rows: Iterable[Sequence[object]], remarks: Sequence[str] = ()
) -> str:
    """Return an HTML table with escaped cells, followed by a list of the remarks where there are any.

    Examples
    --------
    >>> html_table("arm & tool", ("link", "kg"), [("arm", 1.5)])
    '<table><caption>arm &amp; tool</caption><tr><th>link</th><th>kg</th></tr><tr><td>arm</td><td>1.5</td></tr></table>'
    """

    def line(cells: Sequence[object], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(str(cell))}</{tag}>" for cell in cells) + "</tr>" if cells else ""

    top = f"<caption>{escape(caption)}</caption>" if caption else ""
    notes = "".join(f"<li>{escape(remark)}</li>" for remark in remarks)
    body = "".join(line(row, "td") for row in rows)
    return f"<table>{top}{line(heads, 'th')}{body}</table>" + (f"<ul>{notes}</ul>" if notes else "")
