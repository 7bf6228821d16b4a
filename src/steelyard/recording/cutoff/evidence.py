"""A cutoff that the data chose, with its evidence as numbers, a table and pictures."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table, shortened

__all__ = ["Curve", "CutoffChoice", "Plot"]

Array = NDArray[np.float64]
WIDTH, HEIGHT = 520, 300
LEFT, RIGHT, TOP, BOTTOM = 64, 12, 12, 62
COLORS = ("#005f9e", "#c8680e", "#2c7d59", "#a33a72", "#7a5fc0", "#8a6d00", "#4f6d8a", "#b0413e")
POINTS = 300  # of a curve in a plot 444 pixels wide


class Curve(NamedTuple):
    """A named curve of positive values."""

    name: str
    x: Array
    y: Array


class Plot(NamedTuple):
    """Curves over logarithmic axes, of which the upper `decades` are drawn."""

    curves: Sequence[Curve]
    x_title: str
    y_title: str
    decades: int = 16


@dataclass(frozen=True, eq=False)
class CutoffChoice:
    """A cutoff chosen from the data, and its evidence; `choose_cutoff` and `cutoff_by_torques` return it.

    Attributes
    ----------
    cutoff : float
        Hz, of a Butterworth filter of `order` forwards and backwards.
    order : int
    source : str
        The log, or the logs.
    joint_names : tuple of str
    candidates : ndarray
        (C,) Hz.
    joint_errors : ndarray
        (C, N) relative error that is expected of the acceleration of each joint (`choose_cutoff`), or that was found in
        its torque (`cutoff_by_torques`); NaN for joints that do not tell, such as joints at rest.
    error : ndarray
        (C,) the same for all joints together.
    rule : float
        Hz, for comparison: ten times the frequency of the motion (Gautier 1997).
    reason : str
        What was chosen and why, without a full stop.
    explanation : str
        What the table and the pictures show.
    titles : tuple of str
        Of the columns of the table.
    table : list of tuple of str
        One row for each joint.
    plots : tuple of Plot
    """

    cutoff: float
    order: int
    source: str
    joint_names: tuple[str, ...]
    candidates: Array
    joint_errors: Array
    error: Array
    rule: float
    reason: str
    explanation: str
    titles: tuple[str, ...]
    table: list[tuple[str, ...]]
    plots: tuple[Plot, ...]

    @property
    def remark(self) -> str:
        """One sentence that says what was chosen and why, and how to choose."""
        return f"{self.reason}; set `cutoff` in [processing] to choose."

    @property
    def joint_cutoffs(self) -> Array:
        """(N,) Hz, what each joint would choose for itself; NaN for joints that do not tell."""
        told = np.isfinite(self.joint_errors).all(axis=0)
        own = self.candidates[np.argmin(np.where(told, self.joint_errors, 0.0), axis=0)]
        return np.where(told, own, np.nan)

    def __repr__(self) -> str:
        return f"CutoffChoice({self.source!r}: {self.cutoff:.4g} Hz, order {self.order})"

    def figure(self) -> dict[str, Any]:
        """Return the plots as one plotly figure, as plain data, with a dotted line at the choice."""
        line = {"type": "line", "x0": self.cutoff, "x1": self.cutoff, "y0": 0, "y1": 1, "line": {"dash": "dot"}}
        traces: list[dict[str, Any]] = []
        layout: dict[str, Any] = {"shapes": []}
        width = 1.0 / len(self.plots)
        for index, plot in enumerate(self.plots):
            number = "" if index == 0 else str(index + 1)
            domain = [index * width + 0.04 * (index > 0), (index + 1) * width - 0.04 * (index + 1 < len(self.plots))]
            x, y = f"x{number}", f"y{number}"
            layout[f"xaxis{number}"] = {"type": "log", "domain": domain, "title": {"text": plot.x_title}, "anchor": y}
            layout[f"yaxis{number}"] = {"type": "log", "title": {"text": plot.y_title}, "anchor": x}
            layout["shapes"].append({**line, "xref": x, "yref": f"{y} domain"})
            for name, along, up in plot.curves:
                places = {"x": along.tolist(), "y": up.tolist(), "xaxis": x, "yaxis": y}
                traces.append({"type": "scatter", "name": name, **places})
        return {"data": traces, "layout": layout}

    def svg(self) -> str:
        """Return the plots as pictures in SVG, without scripts."""
        return "".join(_picture(plot, self.cutoff) for plot in self.plots)

    def _repr_html_(self) -> str:
        table = html_table(repr(self), self.titles, self.table)
        return f"<p>{html.escape(self.remark)}</p>{self.svg()}{table}"


def _picture(plot: Plot, mark: float) -> str:
    """Draw a plot as SVG, with a dotted line at x = mark."""
    thinned = [_thinned(curve) for curve in plot.curves]
    x = np.concatenate([c.x for c in thinned])
    y = np.concatenate([c.y for c in thinned])
    top = float(np.log10(y.max(initial=1e-300)))
    bottom = max(float(np.log10(max(y.min(initial=np.inf), 1e-300))), top - plot.decades)
    low, high = float(np.log10(x.min())), float(np.log10(x.max()))
    width, height = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def across(value: float) -> float:
        return LEFT + width * float(np.log10(value) - low) / max(high - low, 1e-9)

    def up(value: float) -> float:
        place = float(np.log10(max(value, 1e-300)) - bottom) / max(top - bottom, 1e-9)
        return TOP + height * (1.0 - min(max(place, 0.0), 1.0))

    parts = []
    for decade in range(int(np.ceil(low)), int(np.floor(high)) + 1):
        place = across(10.0**decade)
        parts.append(
            f'<path d="M{place:.1f} {TOP}V{TOP + height}" stroke="currentColor" opacity=".15"/>'
            f'<text x="{place:.1f}" y="{TOP + height + 15}" text-anchor="middle">{10.0**decade:g}</text>'
        )
    every = max(1, round((top - bottom) / 6))
    for decade in range(int(np.ceil(bottom)), int(np.floor(top)) + 1):
        if decade % every == 0:
            place = up(10.0**decade)
            parts.append(
                f'<path d="M{LEFT} {place:.1f}H{LEFT + width}" stroke="currentColor" opacity=".15"/>'
                f'<text x="{LEFT - 6}" y="{place + 4:.1f}" text-anchor="end">1e{decade}</text>'
            )
    for index, curve in enumerate(thinned):
        color = COLORS[index % len(COLORS)]
        points = " ".join(f"{across(a):.1f},{up(b):.1f}" for a, b in zip(curve.x, curve.y, strict=True))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="1.4"/>')
    if low <= np.log10(mark) <= high:
        parts.append(
            f'<path d="M{across(mark):.1f} {TOP}V{TOP + height}" stroke="currentColor" stroke-width="1.5" '
            'stroke-dasharray="3 3"/>'
        )
    step = width / max(len(thinned), 1)
    for index, curve in enumerate(thinned):
        place = LEFT + index * step
        parts.append(
            f'<path d="M{place:.1f} {HEIGHT - 8}h12" stroke="{COLORS[index % len(COLORS)]}" stroke-width="2"/>'
            f'<text x="{place + 16:.1f}" y="{HEIGHT - 4}">{html.escape(_short(curve.name, step))}</text>'
        )
    label = html.escape(f"{plot.y_title} over {plot.x_title}; the dotted line is at {mark:.4g} Hz")
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" style="max-width:100%;height:auto" role="img" '
        f'aria-label="{label}" font-family="system-ui, sans-serif" font-size="11" fill="currentColor">'
        f"{''.join(parts)}"
        f'<text x="{LEFT + width / 2:.0f}" y="{TOP + height + 31}" text-anchor="middle">'
        f"{html.escape(plot.x_title)}</text>"
        f'<text transform="translate(14 {TOP + height / 2:.0f}) rotate(-90)" text-anchor="middle">'
        f"{html.escape(plot.y_title)}</text></svg>"
    )


def _thinned(curve: Curve) -> Curve:
    """Return at most 300 points evenly spaced in the logarithm, each the mean of those around it."""
    good = (curve.x > 0.0) & (curve.y > 0.0)
    x, y = curve.x[good], curve.y[good]
    if len(x) <= POINTS:
        return Curve(curve.name, x, y)
    cells = np.floor(POINTS * np.log(x / x[0]) / np.log(x[-1] / x[0]) * 0.999999).astype(int)
    starts = np.flatnonzero(np.diff(cells, prepend=-1))
    counts = np.diff(np.append(starts, len(x)))
    return Curve(curve.name, np.add.reduceat(x, starts) / counts, np.add.reduceat(y, starts) / counts)


def _short(name: str, width: float) -> str:
    most = max(1, int((width - 18) / 6.2))
    return shortened(name, most)
