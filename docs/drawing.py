"""Drawings in SVG for the documentation: charts, robots with the ellipsoids of their links, and terminals."""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard import Inertia, Model
from steelyard.report.html_document import escape
from steelyard.report.picture import line_path, round_ticks

Array = NDArray[np.float64]
TEXT, SOFT, LINE, PAPER = "#1d2023", "#5a6067", "#e3e3de", "#fdfdfb"
GREY, ORANGE, BLUE, GREEN, RED, GOLD = "#8b8b8b", "#d97a1d", "#005f9e", "#00604a", "#a33a00", "#8a6d00"
COLORS = (BLUE, ORANGE, GREEN, "#a33a72", "#7a5fc0", GOLD, "#4f6d8a", "#b0413e")
SCATTER = "± "
"""Before the name of a figure: how far noise, or where a search ends, moves the figure to either side."""
POINTS = 240  # of a curve: more are not seen on 700 pixels


class Drawing:
    """An SVG document on a light card, with the figures that it shows as JSON inside.

    Parameters
    ----------
    title : str
        What is seen, in a sentence, for those who do not see it.
    width, height : float
    """

    def __init__(self, title: str, width: float = 760, height: float = 300) -> None:
        self.title, self.width, self.height = title, width, height
        self.figures: dict[str, float | str] = {}
        self.style = ""
        self.parts: list[str] = []

    def add(self, markup: str) -> None:
        """Append an element."""
        self.parts.append(markup)

    def text(
        self,
        x: float,
        y: float,
        words: str,
        size: float = 13,
        color: str = TEXT,
        anchor: str = "start",
        bold: bool = False,
    ) -> None:
        """Write words with their baseline at y."""
        weight = ' font-weight="650"' if bold else ""
        self.add(
            f'<text x="{x:.5g}" y="{y:.5g}" font-size="{size:g}" fill="{color}" text-anchor="{anchor}"{weight}>'
            f"{escape(words)}</text>"
        )

    def legend(self, x: float, y: float, entries: Sequence[tuple[str, str]]) -> None:
        """Write coloured names in a row."""
        for name, color in entries:
            self.add(f'<path d="M{x:g} {y - 4:g}h22" stroke="{color}" stroke-width="3"/>')
            self.text(x + 28, y, name, 12)
            x += 28 + 6.4 * len(name) + 22

    def svg(self) -> str:
        """Return the document."""
        body = "\n".join(self.parts)
        style = f"<style>{self.style}</style>\n" if self.style else ""
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width:g} {self.height:g}" '
            f'width="{self.width:g}" height="{self.height:g}" role="img" aria-labelledby="title" '
            "font-family=\"system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif\">\n"
            f'<title id="title">{escape(self.title)}</title>\n{metadata(self.figures)}\n{style}'
            f'<rect x="0.5" y="0.5" width="{self.width - 1:g}" height="{self.height - 1:g}" rx="8" fill="{PAPER}" '
            f'stroke="#d5d5d0"/>\n{body}\n</svg>\n'
        )


class Axes:
    """Two axes in a drawing.

    Parameters
    ----------
    drawing : Drawing
    place : (left, top, width, height)
        Of the area of the curves.
    x, y : (2,)
        The ends of the axes.
    x_title, y_title, title : str
    logarithmic : str
        ``"x"``, ``"y"`` or both letters.
    """

    def __init__(
        self,
        drawing: Drawing,
        place: tuple[float, float, float, float],
        x: ArrayLike,
        y: ArrayLike,
        x_title: str = "",
        y_title: str = "",
        title: str = "",
        logarithmic: str = "",
        x_ticks: bool = True,
        y_ticks: bool = True,
    ) -> None:
        self.drawing, self.logarithmic = drawing, logarithmic
        self.left, self.top, self.width, self.height = place
        self.ends = {"x": self._scaled(x, "x"), "y": self._scaled(y, "y")}
        low, high = self.ends["y"]
        for value in self._ticks("y", low, high) if y_ticks else ():
            at = float(self.up(value))
            drawing.add(f'<path d="M{self.left:g} {at:.1f}h{self.width:g}" stroke="{LINE}"/>')
            drawing.text(self.left - 6, at + 4, f"{value:g}", 11, SOFT, "end")
        if x_ticks:
            for value in self._ticks("x", *self.ends["x"]):
                at = float(self.along(value))
                drawing.add(f'<path d="M{at:.1f} {self.top + self.height:g}v5" stroke="{GREY}"/>')
                drawing.text(at, self.top + self.height + 18, f"{value:g}", 11, SOFT, "middle")
        if title:
            drawing.text(self.left, self.top - 9, title, 13, TEXT, bold=True)
        if x_title:
            drawing.text(self.left + self.width, self.top + self.height + 34, x_title, 12, SOFT, "end")
        if y_title:
            drawing.text(self.left + self.width, self.top - 9, y_title, 12, SOFT, "end")

    def _scaled(self, values: ArrayLike, axis: str) -> Array:
        found = np.asarray(values, dtype=float)
        return np.log10(found) if axis in self.logarithmic else found

    def _ticks(self, axis: str, low: float, high: float) -> list[float]:
        if axis in self.logarithmic:
            step = max(1, math.ceil((high - low) / 6))
            return [10.0**power for power in range(math.ceil(low), math.floor(high) + 1, step)]
        return round_ticks(float(low), float(high))

    def along(self, values: ArrayLike) -> Array:
        """Return pixels from left."""
        low, high = self.ends["x"]
        return np.asarray(self.left + (self._scaled(values, "x") - low) / (high - low) * self.width)

    def up(self, values: ArrayLike) -> Array:
        """Return pixels from the top."""
        low, high = self.ends["y"]
        return np.asarray(self.top + self.height - (self._scaled(values, "y") - low) / (high - low) * self.height)

    def curve(self, x: ArrayLike, y: ArrayLike, color: str, thickness: float = 1.6, dash: str = "") -> None:
        """Draw a curve through points, thinned out."""
        rows = slice(None, None, max(1, -(-len(np.asarray(x)) // POINTS)))
        path = line_path(self.along(x)[rows], np.clip(self.up(y)[rows], self.top - 3, self.top + self.height + 3))
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self.drawing.add(
            f'<path d="{path}" fill="none" stroke="{color}" stroke-width="{thickness:g}" '
            f'stroke-linejoin="round"{dashed}/>'
        )

    def band(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, color: str) -> None:
        """Fill what lies between two curves."""
        across = np.concatenate([self.along(x), self.along(x)[::-1]])
        upward = np.concatenate([self.up(low), self.up(high)[::-1]])
        self.drawing.add(f'<path d="{line_path(across, upward)}Z" fill="{color}" fill-opacity="0.18"/>')

    def dots(self, x: ArrayLike, y: ArrayLike, color: str, radius: float = 3.0) -> None:
        """Draw the points that lie within the axes."""
        for across, upward in zip(np.ravel(self.along(x)), np.ravel(self.up(y)), strict=True):
            if not (0 <= across - self.left <= self.width and -2 <= upward - self.top <= self.height + 2):
                continue
            self.drawing.add(f'<circle cx="{across:.1f}" cy="{upward:.1f}" r="{radius:g}" fill="{color}"/>')

    def upright(self, x: float, color: str, words: str = "") -> None:
        """Draw a dashed vertical line, with words at its top."""
        at = float(self.along(x))
        self.drawing.add(f'<path d="M{at:.1f} {self.top:g}v{self.height:g}" stroke="{color}" stroke-dasharray="5 4"/>')
        if words:
            late = at > self.left + 0.8 * self.width
            self.drawing.text(at - 5 if late else at + 5, self.top + 12, words, 12, color, "end" if late else "start")

    def level(self, y: float, color: str, words: str = "") -> None:
        """Draw a dashed horizontal line, with words above its right end."""
        at = float(self.up(y))
        self.drawing.add(f'<path d="M{self.left:g} {at:.1f}h{self.width:g}" stroke="{color}" stroke-dasharray="5 4"/>')
        if words:
            self.drawing.text(self.left + self.width - 4, at - 5, words, 12, color, "end")


def span(*curves: ArrayLike, room: float = 0.06) -> tuple[float, float]:
    """Return the ends of an axis that holds all values, with some room."""
    values = np.concatenate([np.ravel(np.asarray(curve, dtype=float)) for curve in curves])
    values = values[np.isfinite(values)]
    low, high = float(values.min()), float(values.max())
    margin = room * (high - low) or 1.0
    return low - margin, high + margin


def bars(
    drawing: Drawing,
    place: tuple[float, float, float, float],
    names: Sequence[str],
    series: Sequence[tuple[str, ArrayLike, str]],
    title: str = "",
    unit: str = "",
) -> None:
    """Draw groups of horizontal bars, each with its value at its end.

    Parameters
    ----------
    drawing : Drawing
    place : (left, top, width, height)
        Of the bars; names stand left of it.
    names : (G,) of str
        Of the groups.
    series : (name, (G,) values, color)
    title, unit : str
    """
    left, top, width, height = place
    values = np.array([np.asarray(found, dtype=float) for _, found, _ in series])
    most = float(np.nanmax(values))
    if title:
        drawing.text(left, top - 9, title, 13, TEXT, bold=True)
    group = height / len(names)
    thick = min(16.0, 0.8 * group / len(series))
    for row, name in enumerate(names):
        middle = top + (row + 0.5) * group
        drawing.text(left - 8, middle + 4, name, 12, TEXT, "end")
        for index, (_, _, color) in enumerate(series):
            y = middle + (index - len(series) / 2) * thick
            size = values[index, row] / most * (width - 70)
            drawing.add(f'<path d="M{left:g} {y:.1f}h{size:.1f}v{thick - 1.5:.1f}h{-size:.1f}Z" fill="{color}"/>')
            drawing.text(left + size + 5, y + thick / 2 + 3.4, f"{values[index, row]:.3g}{unit}", 11, SOFT)


def intervals(
    drawing: Drawing,
    place: tuple[float, float, float, float],
    rows: Sequence[tuple[str, float, float, float, float, str]],
    unit: str = "",
    marks: str = "CAD",
) -> None:
    """Draw intervals with their values, one below the other: name, value, lower, upper, mark, colour."""
    left, top, width, height = place
    inner = [v for _, value, _, _, mark, _ in rows for v in (value, mark) if np.isfinite(v)]
    low, high = min(*inner, 0.0), max(inner) * 1.6
    axes = Axes(drawing, (left, top, width, height), (low, high), (0.0, 1.0), unit, y_ticks=False)
    step = height / len(rows)
    for row, (name, value, lower, upper, mark, color) in enumerate(rows):
        y = top + (row + 0.5) * step
        drawing.add(f'<rect x="{left:g}" y="{y - step / 2:.1f}" width="{width:g}" height="{step:.1f}" fill="{PAPER}"/>')
        drawing.text(left - 8, y + 4, name, 12, TEXT, "end")
        ends = np.clip(axes.along([lower, upper]), left, left + width)
        drawing.add(
            f'<path d="M{ends[0]:.1f} {y:.1f}H{ends[1]:.1f}" stroke="{color}" stroke-width="5" stroke-opacity="0.35"/>'
        )
        if not upper <= high:
            drawing.add(f'<path d="M{left + width - 7:g} {y - 6:.1f}l8 6l-8 6" fill="none" stroke="{color}"/>')
        axes.drawing.add(f'<circle cx="{float(axes.along(value)):.1f}" cy="{y:.1f}" r="4.5" fill="{color}"/>')
        if np.isfinite(mark):
            at = float(axes.along(mark))
            drawing.add(f'<path d="M{at:.1f} {y - 8:.1f}v16" stroke="{TEXT}" stroke-width="1.6"/>')
    part = max(abs(value) for _, value, *_ in rows) / 20.0  # numbers near zero are mostly noise
    for name, value, lower, upper, *_ in rows:
        scattering(drawing, name, round(value, 6), min(upper - value, value - lower, part))
    drawing.figures["mark"] = marks


def second_moments(body: Inertia) -> Array:
    """Return the second moments of a body about its centre of mass, (3, 3) kg m²."""
    return np.asarray(0.5 * np.trace(body.about_com) * np.eye(3) - body.about_com)


class RobotView:
    """A robot seen along a direction, in a rectangle of a drawing.

    Parameters
    ----------
    drawing : Drawing
    place : (left, top, width, height)
    model : Model
    q : (N,)
        The configuration.
    azimuth, elevation : float
        Of the eye, degrees.
    """

    def __init__(
        self,
        drawing: Drawing,
        place: tuple[float, float, float, float],
        model: Model,
        q: ArrayLike,
        azimuth: float = 50.0,
        elevation: float = 14.0,
    ) -> None:
        self.drawing, self.model, self.q = drawing, model, np.asarray(q, dtype=float)
        turn, tilt = np.radians([azimuth, elevation])
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        toward = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])
        self.view = np.array([right, np.cross(toward, right)])
        self.poses = [np.asarray(model.pose(self.q, link)) for link in model.robot.link_names]
        points = np.array([np.zeros(3), *(pose[:3, 3] for pose in self.poses)])
        flat = points @ self.view.T
        self.corners = (flat.min(axis=0), flat.max(axis=0))
        self.place = place

    def frame(self, *bodies: Array) -> None:
        """Choose the scale so that the joints, and the bodies of these parameters, are seen."""
        low, high = self.corners
        for parameters in bodies:
            for pose, columns in zip(self.poses, self.model.link_columns, strict=True):
                flat = self._ellipse(pose, parameters[columns])
                if flat is not None:
                    center, spread = flat
                    reach = np.sqrt(np.abs(np.diag(spread)))
                    low, high = np.minimum(low, center - reach), np.maximum(high, center + reach)
        left, top, width, height = self.place
        self.scale = min(width / (high[0] - low[0]), height / (high[1] - low[1])) * 0.94
        middle = 0.5 * (low + high)
        self.origin = np.array([left + width / 2, top + height / 2]) + np.array([-middle[0], middle[1]]) * self.scale

    def _ellipse(self, pose: Array, parameters: Array) -> tuple[Array, Array] | None:
        """Return the middle and the spread of a body as seen: of its ellipsoid of uniform density."""
        if not abs(parameters[9]) > 1e-9:
            return None
        body = Inertia.from_parameters(parameters)
        center = self.view @ (pose[:3, :3] @ body.com + pose[:3, 3])
        values, axes = np.linalg.eigh(second_moments(body) / body.mass)
        look = self.view @ pose[:3, :3] @ axes
        return center, 5.0 * (look * np.abs(values)) @ look.T

    def pixel(self, flat: Array) -> Array:
        """Return where a point of the view stands in the drawing."""
        return np.asarray(self.origin + np.array([1.0, -1.0]) * flat * self.scale)

    def skeleton(self, thickness: float = 11.0) -> None:
        """Draw the links as rods between the origins of their frames."""
        robot = self.model.robot
        ends = [self.pixel(self.view @ pose[:3, 3]) for pose in self.poses]
        base = self.pixel(np.zeros(2))
        rods = []
        for index, joint in enumerate(robot.joints):
            start = base if joint.parent < 0 else ends[joint.parent]
            rods.append(f"M{start[0]:.1f} {start[1]:.1f}L{ends[index][0]:.1f} {ends[index][1]:.1f}")
        style = 'fill="none" stroke-linecap="round" stroke-linejoin="round"'
        for color, thick in (("#c9ced3", thickness), ("#eef0f2", thickness - 3.0)):
            self.drawing.add(f'<path d="{"".join(rods)}" stroke="{color}" stroke-width="{thick:g}" {style}/>')
        for x, y in [base, *ends]:
            self.drawing.add(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{thickness * 0.42:.2g}" fill="#fff" stroke="#9aa1a8"/>'
            )

    def bodies(self, parameters: Array, color: str, *, outline: bool = False) -> list[str]:
        """Draw the ellipsoid of each link, and return the links that no body can have.

        An impossible body, of negative mass or of a negative second moment, is red and dashed; where the second moment
        along an axis is negative, the axis is as long as that of its size.
        """
        impossible = []
        names = self.model.robot.link_names
        for name, pose, columns in zip(names, self.poses, self.model.link_columns, strict=True):
            flat = self._ellipse(pose, parameters[columns])
            if flat is None:
                continue
            body = Inertia.from_parameters(parameters[columns])
            fails = body.mass < 0.0 or float(np.linalg.eigvalsh(second_moments(body)).min()) < 0.0
            impossible += [name] if fails and not outline else []
            center, spread = flat
            values, axes = np.linalg.eigh(spread)
            radii = np.maximum(np.sqrt(np.abs(values)) * self.scale, 1.0)
            angle = -math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
            x, y = self.pixel(center)
            moved = f'transform="translate({x:.1f} {y:.1f}) rotate({angle:.1f})"'
            shape = f'<ellipse rx="{radii[1]:.1f}" ry="{radii[0]:.1f}" {moved} '
            if outline:
                self.drawing.add(f'{shape}fill="none" stroke="{GREY}" stroke-dasharray="2 3"/>')
                continue
            own = RED if fails else color
            dash = ' stroke-dasharray="6 4"' if fails else ""
            self.drawing.add(f'{shape}fill="{own}" fill-opacity="0.22" stroke="{own}" stroke-width="1.6"{dash}/>')
            self.drawing.add(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.6" fill="{own}"/>')
        return impossible


def terminal(title: str, rows: Sequence[tuple[str, float, str]], seconds: float, columns: int = 100) -> Drawing:
    """Return a recording of a terminal whose rows appear one after the other, again and again.

    Parameters
    ----------
    title : str
    rows : (text, time, color)
        What is printed, when, s, and its colour.
    seconds : float
        How long a round takes.
    columns : int
    """
    size, step, width = 12.5, 17.5, 7.52
    drawing = Drawing(title, round(columns * width + 40), len(rows) * step + 62)
    drawing.style = (
        f"text{{white-space:pre}} .r{{animation-duration:{seconds:g}s;animation-iteration-count:infinite;"
        "animation-timing-function:steps(1,end)} @media (prefers-reduced-motion:reduce){.r{animation:none}} "
        "@media print{.r{animation:none}}"
    )
    drawing.add(
        f'<rect x="0.5" y="0.5" width="{drawing.width - 1:g}" height="{drawing.height - 1:g}" rx="8" fill="#1b2127"/>'
    )
    drawing.add(
        "".join(
            f'<circle cx="{22 + 18 * k}" cy="19" r="5.5" fill="{c}"/>'
            for k, c in enumerate(("#e0675c", "#e3b74f", "#6bb86b"))
        )
    )
    times = sorted({time for _, time, _ in rows})
    for index, time in enumerate(times):
        part = 100.0 * time / seconds
        frames = f"0%{{opacity:0}}{part:.2f}%{{opacity:1}}100%{{opacity:1}}"
        drawing.style += f"@keyframes k{index}{{{frames}}}.k{index}{{animation-name:k{index}}}"
    mono = "font-family=\"ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace\""
    for number, (words, time, color) in enumerate(rows):
        y = 50 + number * step
        fitted = f' textLength="{len(words) * width:.1f}" lengthAdjust="spacingAndGlyphs"' if words.strip() else ""
        drawing.add(
            f'<text class="r k{times.index(time)}" x="20" y="{y:g}" font-size="{size:g}" fill="{color}" '
            f'xml:space="preserve" {mono}{fitted}>'
            f"{escape(words)}</text>"
        )
    return drawing


def scattering(drawing: Drawing, name: str, value: float, scatter: float) -> None:
    """Note a figure that noise, or where a search ends, decides about by `scatter` to either side."""
    drawing.figures[name] = value
    drawing.figures[f"{SCATTER}{name}"] = float(f"{scatter:.3g}")


def metadata(figures: dict[str, Any]) -> str:
    """Return the element that holds the figures of a drawing."""
    return f"<metadata>{escape(json.dumps(figures, ensure_ascii=False))}</metadata>"


def figures_of(svg: str) -> dict[str, Any]:
    """Return the figures that a drawing holds."""
    found = re.search(r"<metadata>(.*?)</metadata>", svg, re.DOTALL)
    return dict(json.loads(html.unescape(found[1]))) if found else {}
