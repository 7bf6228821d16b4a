"""Small pictures of intervals for the cells of tables; the numbers stand beside them."""

from __future__ import annotations

from .html_document import Markup

__all__ = ["BAR", "DRAWN", "across", "bar", "interval_bar"]

BAR = 120.0  # pixels, of a bar that stands for itself
DRAWN = Markup('<span class="hidden">Drawn</span>')
"""The head of a column of bars, for screen readers."""

_EDGE = 4.0  # pixels that are left at each end for a dot or an arrow


def across(value: float, scale: tuple[float, float], width: float) -> float:
    """Return pixels from the left of a bar; what lies beyond the ends of its scale stands at them.

    Examples
    --------
    >>> across(0.5, (0.0, 1.0), 90.0), across(7.0, (0.0, 1.0), 90.0)
    (45.0, 86.0)
    """
    low, high = scale
    return _EDGE + (width - 2.0 * _EDGE) * min(max((value - low) / (high - low), 0.0), 1.0)


def bar(drawn: str, width: float, height: int = 14, kind: str = "") -> Markup:
    """Return a picture of elements, hidden from screen readers, of a kind on which its colours depend."""
    return Markup(
        f'<svg class="{f"interval {kind}".rstrip()}" viewBox="0 0 {width:.0f} {height}" width="{width:.0f}" '
        f'height="{height}" aria-hidden="true">{drawn}</svg>'
    )


def interval_bar(interval: tuple[float, float], value: float, scale: tuple[float, float], kind: str) -> Markup:
    """Return the picture of an interval with a mark across it at zero, and a dot at a value."""
    begin, end, middle, at = (across(one, scale, BAR) for one in (*interval, 0.0, value))
    return bar(
        f'<path class="span" d="M{begin:.1f} 7H{end:.1f}"/><path class="cad" d="M{middle:.1f} 1V13"/>'
        f'<circle cx="{at:.1f}" cy="7" r="3.2"/>',
        BAR,
        kind=kind,
    )
