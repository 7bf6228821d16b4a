"""Charts of curves for a document, drawn in the browser by the script ``charts.js``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .html_document import WITHOUT_SCRIPTS, Markup, escape, plotly_text, script_data
from .packed_curves import extreme_rows

if TYPE_CHECKING:
    from steelyard.simulation import SimulationResult

__all__ = ["POINTS", "Chart", "Curve", "charts_markup", "motion_charts"]

POINTS = 1500  # of a curve; more cannot be seen at the width of a chart


@dataclass(frozen=True, eq=False)
class Curve:
    """One curve of a chart.

    Attributes
    ----------
    name : str
    x, y : ndarray
        (S,) each; what is not finite is left out.
    style : {"line", "dashed", "points"}
    color : int or None
        Number of the color, so that a curve and its reference may share one; by default in turn.

    Examples
    --------
    >>> Curve("torque", [0.0, 1.0], [2.0, 3.0]).y.tolist()
    [2.0, 3.0]
    """

    name: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    style: str = "line"
    color: int | None = None

    def __init__(self, name: str, x: ArrayLike, y: ArrayLike, style: str = "line", color: int | None = None) -> None:
        if style not in ("line", "dashed", "points"):
            raise InputError(f"style must be 'line', 'dashed' or 'points', got {style!r}.")
        for key, value in (("name", name), ("style", style), ("color", color)):
            object.__setattr__(self, key, value)
        object.__setattr__(self, "x", np.asarray(x, dtype=np.float64))
        object.__setattr__(self, "y", np.asarray(y, dtype=np.float64))
        if self.x.shape != self.y.shape or self.x.ndim != 1:
            raise InputError(
                f"x and y of the curve {name!r} must have one shape (S,), got {self.x.shape}, {self.y.shape}."
            )


@dataclass(frozen=True)
class Chart:
    """Curves over one axis.

    Attributes
    ----------
    title : str
    x_label, y_label : str
        With their units.
    curves : tuple of Curve
    x_log, y_log : bool
        Whether the axis is logarithmic.
    """

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    x_log: bool = False
    y_log: bool = False


def charts_markup(charts: Sequence[Chart], *, identifier: str) -> Markup:
    """Return the frames of charts and their data; the document must have the script ``charts.js``.

    Parameters
    ----------
    charts : sequence of Chart
    identifier : str
        Begins the ids of the elements, which must differ within a document.

    Examples
    --------
    >>> chart = Chart("Energy", "time, s", "J", (Curve("total", [0.0, 1.0], [2.0, 1.0]),))
    >>> 'id="energy-0"' in charts_markup([chart], identifier="energy")
    True
    """
    figures = "".join(
        f"<figure><figcaption>{escape(chart.title)}</figcaption>"
        f'<div class="chart" id="{identifier}-{index}" role="img" aria-label="{escape(_description(chart))}"></div>'
        "</figure>"
        for index, chart in enumerate(charts)
    )
    data = script_data([_data(chart) for chart in charts])
    return Markup(
        f'<div class="charts">{figures}</div>{WITHOUT_SCRIPTS}'
        f'<script type="application/json" class="chart-data" data-for="{identifier}">{data}</script>'
    )


def motion_charts(result: SimulationResult, position: str, velocity: str, torque: str) -> list[Chart]:
    """Return the charts of a simulated motion, joint by joint, with these units."""

    def curves(values: NDArray[np.float64]) -> tuple[Curve, ...]:
        return tuple(Curve(name, result.t, values[:, k]) for k, name in enumerate(result.joint_names))

    return [
        Chart("Positions", "time, s", position, curves(result.q)),
        Chart("Velocities", "time, s", velocity, curves(result.dq)),
        Chart("Torques of the motors", "time, s", torque, curves(result.torque)),
    ]


def _description(chart: Chart) -> str:
    names = ", ".join(curve.name for curve in chart.curves)
    return f"{chart.title}: {chart.y_label} over {chart.x_label}; curves: {names}"


def _data(chart: Chart) -> dict[str, object]:
    return {
        "x": chart.x_label,
        "y": chart.y_label,
        "xLog": chart.x_log,
        "yLog": chart.y_log,
        "curves": [
            {
                "name": plotly_text(curve.name),
                "style": curve.style,
                "color": number if curve.color is None else curve.color,
                **_points(curve),
            }
            for number, curve in enumerate(chart.curves)
        ],
    }


def _points(curve: Curve) -> dict[str, list[float | None]]:
    """Thin long curves out, but keep the least and the greatest of each piece, so that no peak is lost."""
    rows = extreme_rows([curve.y], POINTS)
    return {"x": _rounded(curve.x[rows], 7), "y": _rounded(curve.y[rows], 6)}


def _rounded(values: NDArray[np.float64], digits: int) -> list[float | None]:
    """Return numbers with so many digits, no more than can be seen: curves are most of the size of a document."""
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in values.tolist()]
