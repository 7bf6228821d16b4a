"""Printing of objects: tables as text and as HTML for notebooks, and numbers and weighted sums as text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from html import escape

from steelyard.errors import printable

__all__ = [
    "capital",
    "combination",
    "few_digits",
    "html_sentences",
    "html_table",
    "joint_label",
    "outward",
    "percent",
    "shortened",
    "text_table",
]


def text_table(heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """Return columns side by side, those with the indices `numbers` aligned to the right, and a line for each row.

    Examples
    --------
    >>> print(text_table(("name", "kg"), [("arm", "1.5"), ("fore\\narm", "12")], numbers=(1,)))
    name       kg
    arm       1.5
    fore arm   12
    """
    # Names of files may be anything.
    table = [[printable(" ".join(cell.splitlines())) for cell in row] for row in (heads, *rows)]
    widths = [max(len(row[i]) for row in table) for i in range(len(heads))]
    lines = []
    for row in table:
        cells = [c.rjust(w) if i in numbers else c.ljust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


SHOWN, FOLDED = 24, 500
"""Rows of a table in HTML that are shown, and that are folded away below them; sentences are shown as many."""
LONGEST = 300
"""Characters of a cell; names in files may be of any length."""


def html_table(
    caption: str, heads: Sequence[str], rows: Iterable[Sequence[object]], remarks: Sequence[str] = ()
) -> str:
    """Return an HTML table with escaped cells, followed by a list of the remarks where there are any.

    It sets no colours, so that it is read on light and on dark pages. Of a long table the beginning is shown, and the
    rest can be unfolded.

    Examples
    --------
    >>> html_table("arm & tool", ("link", "kg"), [("arm", 1.5)])
    '<table><caption>arm &amp; tool</caption><tr><th>link</th><th>kg</th></tr><tr><td>arm</td><td>1.5</td></tr></table>'
    """
    lines = [_html_row(row, "td") for row in rows]
    top, head = f"<caption>{_html_text(caption)}</caption>" if caption else "", _html_row(heads, "th")
    if len(lines) <= SHOWN + 1:
        return f"<table>{top}{head}{''.join(lines)}</table>{_html_list(remarks)}"
    rest = len(lines) - SHOWN
    kept = lines[SHOWN : SHOWN + FOLDED]
    which = f"{rest} more" if rest == len(kept) else f"{rest} more, of which {len(kept)} stand here"
    return (
        f"<table>{top}{head}{''.join(lines[:SHOWN])}</table>"
        f"<details><summary>and {which}</summary><table>{head}{''.join(kept)}</table></details>{_html_list(remarks)}"
    )


def html_sentences(first: str, below: Sequence[str] = (), *, strong: bool = False) -> str:
    """Return a sentence, strong where it is a verdict, and those below it as a list, all escaped.

    Examples
    --------
    >>> html_sentences("Feasible.", ["m1 > 0"], strong=True)
    '<p><strong>Feasible.</strong></p><ul><li>m1 &gt; 0</li></ul>'
    """
    text = _html_text(first)
    return f"<p>{f'<strong>{text}</strong>' if strong else text}</p>{_html_list(below)}"


def _html_list(sentences: Sequence[str]) -> str:
    items = [f"<li>{_html_text(one, 10 * LONGEST)}</li>" for one in sentences[:SHOWN]]
    if len(sentences) > SHOWN:
        items.append(f"<li>and {len(sentences) - SHOWN} more</li>")
    return f"<ul>{''.join(items)}</ul>" if items else ""


def _html_row(cells: Sequence[object], tag: str) -> str:
    inner = "".join(f"<{tag}>{_html_text(cell)}</{tag}>" for cell in cells)
    return f"<tr>{inner}</tr>" if cells else ""


def _html_text(value: object, longest: int = LONGEST) -> str:
    text = printable(str(value))
    return escape(text if len(text) <= longest else f"{text[:longest]}…")


def shortened(text: str, most: int) -> str:
    """A text of at most so many characters, of which the last shows where more was left out.

    Examples
    --------
    >>> shortened("elbow", 5), shortened("shoulder", 5)
    ('elbow', 'shou…')
    """
    return text if len(text) <= most else f"{text[: most - 1]}…"


def joint_label(index: int, names: Sequence[str] | None) -> str:
    """Name a joint (from 0) in a sentence: by its name where it has one, and by its number, from 1, otherwise.

    Numbers of parameters count joints that no log has, too, such as those that follow another one, so that a number
    beside a name would be read as that of other parameters.

    Examples
    --------
    >>> joint_label(2, None), joint_label(2, ("shoulder", "elbow", "joint4"))
    ('joint 3', "joint 'joint4'")
    """
    return f"joint {index + 1}" if names is None else f"joint {shortened(names[index], LONGEST)!r}"


def capital(sentence: str) -> str:
    """A sentence with its first letter as a capital, and all others as they are.

    Examples
    --------
    >>> capital("joint 'J3' rests.")
    "Joint 'J3' rests."
    """
    return sentence[:1].upper() + sentence[1:]


def few_digits(value: float, digits: int = 4) -> str:
    """A number with a few digits, below ten million without a power of ten; infinity as ∞.

    Examples
    --------
    >>> few_digits(0.000123456), few_digits(12634.2), few_digits(float("-inf"))
    ('0.0001235', '12630', '-∞')
    """
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    text = f"{value + 0.0:.{digits}g}"
    return f"{float(text):.0f}" if "e+0" in text and abs(value) < 1e7 else text


def percent(share: float, digits: int = 3) -> str:
    """A share in per cent with about `digits` digits.

    Examples
    --------
    >>> percent(0.9996), percent(0.01234, 2), percent(-0.00001234, 2)
    ('100 %', '1.2 %', '-0.0012 %')
    """
    value = 100.0 * share + 0.0
    if not math.isfinite(value):
        return f"{few_digits(value)} %"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if abs(value) >= 1e-4 else 0
    text = f"{value:.{decimals}f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def outward(lower: float, upper: float) -> tuple[str, str]:
    """Both ends of an interval, rounded outward to about a thousandth of its width.

    Examples
    --------
    >>> outward(1.689123, 2.433012)
    ('1.6891', '2.4331')
    >>> outward(2.0 - 1e-9, float("inf"))
    ('2', '∞')
    """
    width = upper - lower
    finite = [abs(value) for value in (lower, upper) if math.isfinite(value)]
    size = max(finite, default=0.0)
    unit = width if math.isfinite(width) else size
    unit = max(unit, 1e-9 * size)
    if unit <= 0:
        return few_digits(lower), few_digits(upper)
    step = Decimal(1).scaleb(math.floor(math.log10(unit)) - 3)
    return _rounded(lower, step, ROUND_FLOOR), _rounded(upper, step, ROUND_CEILING)


def _rounded(value: float, step: Decimal, direction: str) -> str:
    if math.isinf(value):
        return few_digits(value)
    # Values may be off by a thousandth of the last digit, which must not change that digit.
    inward = Decimal("0.001") if direction == ROUND_FLOOR else Decimal("-0.001")
    number = (Decimal(value) / step + inward).to_integral_value(rounding=direction) * step
    text = f"{number:f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    if len(text.lstrip("-0.")) > 0 and abs(value) < 1e-4:
        return f"{number.normalize():e}".replace("e-0", "e-")
    return text if text not in ("-0", "") else "0"


def combination(weights: Iterable[float], names: Sequence[str], most: int | None = None, digits: int = 3) -> str:
    """A weighted sum as text, with the terms in the given order; "..." stands for terms that are left out.

    Examples
    --------
    >>> combination([1.0, -0.25, 0.0], ["Lzz1", "lx1 + m2", "ly1"])
    'Lzz1 - 0.25 (lx1 + m2)'
    """
    text = ""
    shown = 0
    for weight, name in zip(weights, names, strict=True):
        if weight == 0.0:
            continue
        if most is not None and shown == most:
            return text + " ..."
        size = few_digits(abs(float(weight)), digits)
        single = f"({name})" if " " in name and (size != "1" or weight < 0) else name
        term = single if size == "1" else f"{size} {single}"
        text += f"{'-' if weight < 0 else ''}{term}" if not text else f" {'-' if weight < 0 else '+'} {term}"
        shown += 1
    return text or "0"
