"""A section of the reproduction, its inputs, and its result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from steelyard.report import Chart, Curve

from .comparison import Comparison

__all__ = ["Context", "Section", "SectionResult", "Table"]


@dataclass(frozen=True)
class Table:
    """Numbers and texts in rows.

    Attributes
    ----------
    title : str
    columns : tuple of str
    rows : tuple of tuple of str or float
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float, ...], ...]


@dataclass(frozen=True)
class SectionResult:
    """The result of a section.

    Attributes
    ----------
    comparisons : tuple of Comparison
        Published values beside ours.
    tables : tuple of Table
        Further tables and figures.
    charts : tuple of Chart
    remarks : tuple of str
    """

    comparisons: tuple[Comparison, ...] = ()
    tables: tuple[Table, ...] = ()
    charts: tuple[Chart, ...] = ()
    remarks: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, for JSON."""
        return {
            "comparisons": [row.to_dict() for row in self.comparisons],
            "tables": [{"title": t.title, "columns": t.columns, "rows": t.rows} for t in self.tables],
            "charts": [_chart_to_dict(chart) for chart in self.charts],
            "remarks": list(self.remarks),
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> SectionResult:
        """Build a result from what `to_dict` returned."""
        return cls(
            tuple(Comparison.from_dict(row) for row in content["comparisons"]),
            tuple(
                Table(t["title"], tuple(t["columns"]), tuple(tuple(row) for row in t["rows"]))
                for t in content["tables"]
            ),
            tuple(_chart_from_dict(chart) for chart in content["charts"]),
            tuple(content["remarks"]),
        )


def _chart_to_dict(chart: Chart) -> dict[str, Any]:
    curves = [
        {"name": c.name, "x": c.x.tolist(), "y": c.y.tolist(), "style": c.style, "color": c.color} for c in chart.curves
    ]
    content = {name: getattr(chart, name) for name in ("title", "x_label", "y_label", "x_log", "y_log")}
    return {**content, "curves": curves}


def _chart_from_dict(content: dict[str, Any]) -> Chart:
    return Chart(**{**content, "curves": tuple(Curve(**curve) for curve in content["curves"])})


@dataclass(frozen=True)
class Context:
    """The services that a section may use.

    Attributes
    ----------
    data : Path or None
        Folder of the real recordings; None where there is none.
    say : callable
        Takes a few words on what is being done.
    """

    data: Path | None = None
    say: Callable[[str], None] = field(default=lambda _: None)


@dataclass(frozen=True)
class Section:
    """A section of the thesis and how it is computed again.

    Attributes
    ----------
    number : str
        As in the thesis, ``"4.3.2"``, or a word for what is not there.
    title : str
    compute : callable
        From a Context to a SectionResult; the same numbers every time, times aside.
    needs_data : bool
        Whether there is nothing to compute without the recordings.
    """

    number: str
    title: str
    compute: Callable[[Context], SectionResult]
    needs_data: bool = False

    @property
    def heading(self) -> str:
        """Number and title."""
        between = " " if self.number[0].isdigit() else ": "
        return f"{self.number[0].upper()}{self.number[1:]}{between}{self.title}"

    @property
    def key(self) -> str:
        """The number as part of file names."""
        return self.number.replace(".", "_").replace(" ", "_")
