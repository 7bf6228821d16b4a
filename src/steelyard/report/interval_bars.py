"""Small pictures of intervals for the cells of tables; the numbers stand beside them."""

from __future__ import annotations

from .html_document import Markup

__all__ = ["across", "bar"]

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
