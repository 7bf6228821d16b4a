"""Drawings of things in space as SVG, which the script ``drawing.js`` turns by the same projection.

Each element of the picture carries its places in space, in metres with z upwards, in an attribute: ``data-line`` the
two ends of a line, ``data-point`` where a mark stands, ``data-disc`` the centre and two conjugate radii of a flat
ellipse, ``data-ball`` the centre and three conjugate radii of an ellipsoid. The projection is parallel, in which both
are ellipses again, so that every curve is the unit circle under a matrix.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .html_document import Markup, escape

__all__ = ["LOOKS", "Drawing", "View", "turnable"]

Array = NDArray[np.float64]

LINE_OF_TEXT = 13.0  # px between numbers that would lie on each other
_SIGNIFICANT = 5  # digits of places in space, a hundredth of a pixel

LOOKS = Markup(
    "".join(
        f'<button type="button" data-look="{name}">{label}</button>'
        for name, label in (("front", "Front"), ("side", "Side"), ("top", "Top"), ("Home", "Reset"))
    )
)
"""Buttons that turn a drawing to where one mostly looks from."""


def turnable(picture: str, what: str, controls: str = "", beside: str = "") -> Markup:
    """Return a picture with what a reader needs to turn it; the document must have ``drawing.js`` and ``drawing.css``.

    Parameters
    ----------
    picture : str
        What `Drawing.svg` returned.
    what : str
        What is drawn, in words, as HTML.
    controls : str
        Further controls, which are shown where scripts may run.
    beside : str
        What stands beside it.
    """
    shown = f'<div class="controls-of-drawing" hidden>{controls}</div>' if controls else ""
    return Markup(
        '<div class="drawing"><div><div class="ground-of-drawing" tabindex="0" role="application" '
        f'aria-label="Drawing of {what}: arrow keys turn it, plus and minus change its size, Home puts it back">'
        f"{picture}</div>{shown}</div>{beside}</div>"
    )


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection onto a picture.

    Attributes
    ----------
    azimuth, elevation : float
        rad: from where one looks, z upwards.
    center : ndarray
        (3,) m: what lies in the middle of the picture.
    scale : float
        Pixels a metre.
    width, height : float
        Pixels.

    Examples
    --------
    From the front, that is against the x axis, y is to the right and z upwards:

    >>> View(0.0, 0.0, np.zeros(3), 100.0, 640.0, 480.0).project([1.0, 0.5, 0.2]).tolist()
    [370.0, 220.0]
    """

    azimuth: float
    elevation: float
    center: Array
    scale: float
    width: float
    height: float

    @property
    def rows(self) -> Array:
        """Directions (3, 3) to the right, downwards, and towards the reader."""
        ca, sa = np.cos(self.azimuth), np.sin(self.azimuth)
        ce, se = np.cos(self.elevation), np.sin(self.elevation)
        return np.array([[-sa, ca, 0.0], [se * ca, se * sa, -ce], [ce * ca, ce * sa, se]])

    def vector(self, directions: ArrayLike) -> Array:
        """Pixels to the right and downwards (..., 2) of directions (..., 3) in m."""
        return np.asarray(self.scale * (np.asarray(directions, dtype=float) @ self.rows[:2].T))

    def project(self, places: ArrayLike) -> Array:
        """Places (..., 2) in the picture of places (..., 3) in space."""
        return self.vector(np.asarray(places, dtype=float) - self.center) + 0.5 * np.array([self.width, self.height])

    def depth(self, place: ArrayLike) -> float:
        """Return how near to the reader a place is, m."""
        return float(self.rows[2] @ np.asarray(place, dtype=float))


def _numbers(values: ArrayLike) -> str:
    return " ".join(f"{value:.{_SIGNIFICANT}g}" for value in (np.ravel(values) + 0.0).tolist())


def _pixels(values: Iterable[float]) -> list[str]:
    return [f"{value + 0.0:.2f}" for value in values]


def _matrix(first: Array, second: Array, center: Array) -> str:
    return f"matrix({' '.join(_pixels([*first, *second, *center]))})"


def outline(radii: Array) -> tuple[Array, Array]:
    """Return conjugate radii (2,) of the outline of an ellipsoid whose conjugate radii (3, 2) are projected.

    They are the columns of the symmetric root of E = RᵀR: a point R'u with a unit vector u goes farthest so.

    Examples
    --------
    >>> [root.tolist() for root in outline(np.array([[3.0, 0.0], [0.0, 2.0], [4.0, 0.0]]))]
    [[5.0, 0.0], [0.0, 2.0]]
    """
    shape = radii.T @ radii
    determinant = float(np.sqrt(max(shape[0, 0] * shape[1, 1] - shape[0, 1] ** 2, 0.0)))
    whole = float(np.sqrt(shape[0, 0] + shape[1, 1] + 2.0 * determinant))
    if whole == 0.0:
        return np.zeros(2), np.zeros(2)
    root = (shape + determinant * np.eye(2)) / whole
    return root[0], root[1]


@dataclass(eq=False)
class Drawing:
    """A picture that is put together from behind to the front.

    Attributes
    ----------
    parts : list of str
        The elements so far.
    """

    view: View
    parts: list[str] = field(default_factory=list)
    _labels: list[Array] = field(default_factory=list)

    def line(self, ends: ArrayLike, kind: str) -> Markup:
        """A line between two places (2, 3)."""
        (x1, y1), (x2, y2) = (_pixels(end) for end in self.view.project(ends))
        return Markup(f'<line class="{kind}" data-line="{_numbers(ends)}" x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}"/>')

    def _flat(self, center: ArrayLike, radii: ArrayLike) -> tuple[Array, str]:
        places = np.vstack([np.asarray(center, dtype=float), np.asarray(radii, dtype=float)])
        first, second = self.view.vector(places[1:])
        return places, _matrix(first, second, self.view.project(places[0]))

    def disc(self, center: ArrayLike, radii: ArrayLike, kind: str) -> Markup:
        """A flat ellipse with two conjugate radii (2, 3)."""
        places, matrix = self._flat(center, radii)
        return Markup(f'<circle class="{kind}" r="1" data-disc="{_numbers(places)}" transform="{matrix}"/>')

    def square(self, center: ArrayLike, radii: ArrayLike, kind: str) -> Markup:
        """A parallelogram about a center whose sides are twice two vectors (2, 3)."""
        places, matrix = self._flat(center, radii)
        corners = "-1,-1 1,-1 1,1 -1,1"
        return Markup(
            f'<polygon class="{kind}" points="{corners}" data-disc="{_numbers(places)}" transform="{matrix}"/>'
        )

    def ball(self, center: ArrayLike, radii: ArrayLike, kind: str) -> Markup:
        """The outline of an ellipsoid with three conjugate radii (3, 3)."""
        places = np.vstack([np.asarray(center, dtype=float), np.asarray(radii, dtype=float)])
        matrix = _matrix(*outline(self.view.vector(places[1:])), self.view.project(places[0]))
        return Markup(f'<circle class="{kind}" r="1" data-ball="{_numbers(places)}" transform="{matrix}"/>')

    def mark(self, place: ArrayLike, content: str) -> Markup:
        """Something that keeps its size and direction, such as a dot."""
        x, y = _pixels(self.view.project(place))
        return Markup(f'<g data-point="{_numbers(place)}" transform="translate({x} {y})">{content}</g>')

    def label(self, place: ArrayLike, text: str) -> Markup:
        """A word beside a place, moved upwards where another one is."""
        at = self.view.project(place)
        while any(abs(at[0] - x) < LINE_OF_TEXT and abs(at[1] - y) < LINE_OF_TEXT for x, y in self._labels):
            at = at - [0.0, LINE_OF_TEXT]
        self._labels.append(at)
        x, y = _pixels(at)
        inner = f'<text x="8" y="-7">{escape(text)}</text>'
        return Markup(f'<g data-label="{_numbers(place)}" transform="translate({x} {y})">{inner}</g>')

    def by_depth(self, groups: Sequence[tuple[ArrayLike, str]]) -> Markup:
        """Groups of elements, each with the place that decides which lies before which."""
        ordered = sorted(groups, key=lambda group: self.view.depth(group[0]))
        inner = "".join(f'<g data-depth="{_numbers(place)}">{content}</g>' for place, content in ordered)
        return Markup(f'<g class="by-depth">{inner}</g>')

    def svg(self, title: str, description: str, before: str = "") -> Markup:
        """Return the picture; `before` is what stands before its elements, such as a style."""
        view = self.view
        places = _numbers([*view.center, view.scale, view.azimuth, view.elevation])
        return Markup(
            '<svg xmlns="http://www.w3.org/2000/svg" class="robot-drawing" '
            f'viewBox="0 0 {view.width:g} {view.height:g}" role="img" aria-label="{escape(title)}" '
            f'data-view="{places}"><desc>{escape(description)}</desc>{before}{"".join(self.parts)}</svg>'
        )
