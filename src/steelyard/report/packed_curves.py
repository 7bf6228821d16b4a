"""Curves packed for a page: two bytes a number, differences of neighbours, deflated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .html_document import Markup, compressed

__all__ = ["PackedCurves", "extreme_rows"]

Array = NDArray[np.float64]
_LEVELS = 65_000  # of 65 536: one of the others stands for what is missing
_MISSING = -32_768


class PackedCurves:
    """Collects curves; the script ``curves.js`` reads them.

    A number is one of 65 000 between the least and the greatest of its curve, finer than any screen. In JSON these
    curves would be four times as large.

    Examples
    --------
    >>> import numpy as np
    >>> packed = PackedCurves()
    >>> packed.add(np.array([0.0, 1.0, np.nan, 0.5]))
    {'at': 0, 'n': 4, 'low': 0.0, 'step': 1.5384615384615384e-05}
    >>> packed.add(np.array([2.0, 2.5]))["at"]
    8
    """

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: Array) -> dict[str, float]:
        """Add a curve, and return where it stands and how its numbers are scaled."""
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
        step = (high - low) / _LEVELS or 1.0
        levels = np.full(len(values), _MISSING)
        known = np.isfinite(values)
        levels[known] = np.round((values[known] - low) / step).astype(int) - _LEVELS // 2
        differences = np.diff(levels.astype("<i2"), prepend=np.zeros(1, dtype="<i2")).astype("<i2").tobytes()
        place, self._size = self._size, self._size + len(differences)
        self._parts.append(differences)
        return {"at": place, "n": len(values), "low": low, "step": step}

    def markup(self, identifier: str) -> Markup:
        """Return the element that holds all the curves."""
        content = compressed(b"".join(self._parts))
        return Markup(f'<script type="text/plain" class="packed-curves" id="{identifier}">{content}</script>')


def extreme_rows(curves: Sequence[Array], rows: int) -> NDArray[np.intp]:
    """Return about so many rows, at most: of equal pieces those at which a curve is least or greatest, and both ends.

    The curves are (S,) each, and NaN is no extreme.

    Examples
    --------
    >>> import numpy as np
    >>> curve = np.zeros(1000)
    >>> curve[[123, 777]] = 1.0, -1.0
    >>> found = extreme_rows([curve], 40)
    >>> {123, 777, 0, 999} <= set(found.tolist()), len(found) <= 40
    (True, True)
    """
    count = len(curves[0])
    if count <= rows:
        return np.arange(count)
    pieces = max((rows - 2) // (2 * len(curves)), 1)
    edges = np.linspace(0, count, pieces + 1).round().astype(int)
    longest = int(np.diff(edges).max())
    places = np.minimum(edges[:-1, None] + np.arange(longest), edges[1:, None] - 1)
    found = [np.array([0, count - 1])]
    for curve in curves:
        pieced = curve[places]
        for extreme, worst in ((np.argmin, np.inf), (np.argmax, -np.inf)):
            best = extreme(np.where(np.isfinite(pieced), pieced, worst), axis=1)
            found.append(places[np.arange(pieces), best])
    return np.unique(np.concatenate(found))
