"""The page that shows what differs between results: robots beside each other, links, base parameters, predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.files import write_text
from steelyard.identification import Comparison
from steelyard.identification.comparison import ParameterDifference
from steelyard.identification.prediction_difference import labels

from .drawing import turnable
from .html_document import Markup, Section, bullets, escape, html_document, paragraphs, percent, table
from .interval_bars import BAR, DRAWN, across, bar, interval_bar
from .link_bodies import link_body
from .robot_picture import DrawnLink, drawing_of_links
from .sections import hashed_file, versions

__all__ = ["comparison_html", "write_comparison"]

MOST_DRAWN = 6  # robots; each takes half a screen
MOST_ROWS = 200  # of base parameters; what differs comes first
_REACH = 3.0  # intervals of the difference that a bar shows


def comparison_html(comparison: Comparison) -> str:
    """Return the page of a comparison, an HTML document without references to anything outside.

    Parameters
    ----------
    comparison : Comparison
        What :func:`steelyard.identification.compare_estimates` returned.

    Examples
    --------
    >>> import tempfile
    >>> from dataclasses import replace
    >>> import numpy as np, steelyard as sy
    >>> from steelyard.identification import compare_estimates
    >>> one = sy.Estimate(
    ...     method="ordinary least squares", base_names=("m1", "lx1"), base_expressions=("m1", "lx1"),
    ...     base=np.array([2.0, 0.5]), standard_error=np.array([0.1, 0.01]), joint_names=("joint1",),
    ...     relative_error=0.05, row_count=100, condition_number=1.0,
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     first, second = Path(folder) / "a.json", Path(folder) / "b.json"
    ...     one.save(first)
    ...     replace(one, base=np.array([2.1, 0.6])).save(second)
    ...     text = comparison_html(compare_estimates([first, second]))
    >>> "1 of 2 base parameters differs beyond its 95 % interval: lx1." in text
    True
    """
    first, *others = comparison.sentences
    lead = Markup(f'<p class="lead">{escape(first)}</p>{paragraphs(others)}{_results(comparison)}')
    parts = (
        ("robot", "The robots", _robots(comparison)),
        ("links", "Links and joints", _links(comparison)),
        ("base", "What the data says", _base_parameters(comparison)),
        ("elastic", "Elastic joints", _compliances(comparison)),
        ("prediction", "What they predict", _prediction(comparison)),
        ("remarks", "Remarks", bullets(comparison.remarks)),
        ("sources", "Provenance", _sources(comparison)),
    )
    name = "Results" if comparison.model is None else comparison.model.robot.name
    return html_document(
        f"{name}: comparison",
        "Steelyard comparison",
        f"{name}: {', '.join(labels(len(comparison.names)))}",
        lead,
        [Section(key, title, content) for key, title, content in parts if content],
        plain_scripts=("drawing.js",),
        styles=("drawing.css",),
    )


def write_comparison(comparison: Comparison, target: str | Path) -> None:
    """Write the page of a comparison; the file appears whole or not at all.

    Parameters
    ----------
    comparison : Comparison
    target : str or Path
        An ``.html`` file, replaced where it is there.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_text(comparison_html(comparison), target)


def _results(comparison: Comparison) -> Markup:
    rows = []
    for label, result in zip(labels(len(comparison.names)), comparison.results, strict=True):
        estimate = result.estimate
        total = next((row for row in estimate.parameter_table if row["name"] == "total mass"), None)
        rows.append(
            (
                label,
                result.name,
                "–" if result.is_description else f"{percent(estimate.relative_error)}",
                "–" if result.is_description else f"{estimate.row_count}",
                "–" if total is None else _interval(total),
            )
        )
    heads = ("", "Result", "Error on its own data, %", "Rows", "Total mass, kg (95 %)")
    return table("What is compared", heads, rows, identifier="results", texts=(1, 4))


def _interval(row: Mapping[str, Any]) -> str:
    value = f"{_number(row.get('value'))}"
    low, high = row.get("lower"), row.get("upper")
    if low is None or high is None or low == high:
        return value
    return f"{value} ({_number(low)} to {_number(high)})"


def _number(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, (int, float)) and np.isfinite(value) else "–"


def _robots(comparison: Comparison) -> Markup:
    """Each result beside the first one."""
    model = comparison.model
    if model is None or not all(isinstance(one.estimate.parameters, np.ndarray) for one in comparison.results):
        return Markup("")
    short = labels(len(comparison.names))
    values = [np.asarray(one.estimate.parameters) for one in comparison.results]
    parts = []
    for label, own in list(zip(short, values, strict=True))[1 : MOST_DRAWN + 1]:
        links = [
            DrawnLink(
                index + 1, link.name, None, link_body(own[columns]), link_body(values[0][columns]),
                float(values[0][columns][9]), short[0],
            )
            for index, (link, columns) in enumerate(zip(model.robot.links, model.link_columns, strict=True))
        ]  # fmt: skip
        title = f"{label} beside {short[0]}"
        parts.append(f"<h3>{title}</h3>{turnable(drawing_of_links(model.robot, links), title)}")
    more = len(values) - 1 - len(parts)
    text = (
        "All joints are at zero. Each ellipsoid is the solid one of uniform density with the mass, centre of mass and "
        f"moments of inertia of a link; thin black ellipses and crosses are those of {short[0]}."
        + (f" {more} more are not drawn." if more else "")
    )
    return Markup(f"<p>{escape(text)}</p>{''.join(parts)}")


def _links(comparison: Comparison) -> Markup:
    """Masses, centres of mass and terms of all the results, with their intervals."""
    tables = [{row["name"]: row for row in one.estimate.parameter_table} for one in comparison.results]
    names = [row["name"] for row in max(tables, key=len).values() if _is_told(row["name"])] if any(tables) else []
    if not names:
        return Markup("")
    marked = {one.name for one in comparison.link_differences if one.differs}
    short, rows = labels(len(tables)), []
    for name in names:
        found = [told.get(name) for told in tables]
        known = next(row for row in found if row is not None)
        cells = ["–" if row is None else _interval(row) for row in found]
        what = f"{known.get('meaning', name)}, {known.get('unit', '')}".rstrip(", ")
        rows.append((what, *cells, _bars(found), "yes" if name in marked else ""))
    heads = ("Number", *short, DRAWN, "Differs")
    text = (
        "Values and 95 % intervals as each result tells them; bars are in the order of the results, from the top. A "
        "number differs where its interval of the difference, all numbers taken together, leaves zero out."
    )
    texts = tuple(range(1, len(heads)))
    drawn = table("Links and joints", heads, rows, identifier="link-numbers", texts=texts)
    return Markup(f"<p>{text}</p>{drawn}")


def _is_told(name: str) -> bool:
    """Masses, centres of mass, friction and rotors: what people ask for first. The rest is in parameters.csv."""
    return not name.startswith(("L", "l", "J"))


def _bars(rows: Sequence[Mapping[str, Any] | None]) -> Markup:
    """Intervals one below the other, on one scale."""
    values = [float(row["value"]) for row in rows if row is not None and _is_number(row.get("value"))]
    if not values:
        return Markup("")
    low, high = min(values), max(values)
    widest = [
        float(row["upper"] - row["lower"])
        for row in rows
        if row is not None and _is_number(row.get("lower")) and _is_number(row.get("upper"))
    ]
    margin = max(high - low, min((w for w in widest if w > 0.0), default=0.0)) or abs(high) or 1.0
    low, high = low - margin, high + margin

    def place(value: float) -> float:
        return across(value, (low, high), BAR)

    drawn, height = "", 9 * len(rows) + 3
    for index, row in enumerate(rows):
        y = 6 + 9 * index
        if row is None:
            continue
        if _is_number(row.get("lower")) and _is_number(row.get("upper")):
            begin, end = place(row["lower"]), place(row["upper"])
            drawn += f'<path class="span" d="M{begin:.1f} {y}H{end:.1f}"/>'
        if _is_number(row.get("value")):
            drawn += f'<circle cx="{place(row["value"]):.1f}" cy="{y}" r="2.8"/>'
    return bar(drawn, BAR, height)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and bool(np.isfinite(value))


def _base_parameters(comparison: Comparison) -> Markup:
    left = len(comparison.differences) - MOST_ROWS
    text = (
        "Base parameters are what the data tells; those of plain least squares are compared, which no prior draws. "
        "± is the 95 % interval of the difference; the grey band is that interval, the dot the difference."
        + (f" {left} more differ less." if left > 0 else "")
    )
    caption = "Base parameters, those that differ most first"
    drawn = _differences(comparison, comparison.differences[:MOST_ROWS], "Base parameter", caption, "base-differences")
    return Markup(f"<p>{text}</p>{drawn}")


def _compliances(comparison: Comparison) -> Markup:
    if not comparison.elastic_differences:
        return Markup("")
    text = "Compliances, the inverses of stiffnesses, are compared: it is their errors that are normal."
    caption = "Compliances of elastic joints"
    drawn = _differences(comparison, comparison.elastic_differences, "Number", caption, "elastic-differences")
    return Markup(f"<p>{text}</p>{drawn}")


def _differences(
    comparison: Comparison, shown: Sequence[ParameterDifference], what: str, caption: str, identifier: str
) -> Markup:
    """A table of numbers that are compared, each with its interval and a bar."""
    several = len(comparison.names) > 2
    short = dict(zip(comparison.names, labels(len(comparison.names)), strict=True))
    rows = [
        (
            f"{one.name}, {one.unit}" if one.unit else one.name,
            *((short[one.second],) if several else ()),
            f"{one.first_value:.4g}",
            f"{one.second_value:.4g}",
            f"{one.half_width:.2g}",
            _difference_bar(one),
            "yes" if one.differs else "",
        )
        for one in shown
    ]
    values = ("Other", "A", "Value") if several else ("A", "B")
    heads = (what, *values, "±", DRAWN, "Differs")
    texts = (*((1,) if several else ()), len(heads) - 2, len(heads) - 1)
    return table(caption, heads, rows, identifier=identifier, texts=texts)


def _difference_bar(one: ParameterDifference) -> Markup:
    times = one.times if one.second_value >= one.first_value else -one.times
    kind = "assumed" if one.differs else "measured"
    return interval_bar((-1.0, 1.0), times, (-_REACH, _REACH), kind)


def _prediction(comparison: Comparison) -> Markup:
    told = comparison.prediction
    if told is None:
        return Markup("")
    heads, rows = told.table()
    heads[:2] = ["Joint", "Torque"]
    sentences = "".join(f"<p>{escape(sentence)}</p>" for sentence in told.sentences)
    drawn = table(told.caption, heads, rows, identifier="predicted")
    return Markup(f"{sentences}{drawn}")


def _sources(comparison: Comparison) -> Markup:
    rows = [(one.name, hashed_file(one.path)["sha256"]) for one in comparison.results]
    rows += list(versions().items())
    return table("Files with their SHA-256, and versions", ("", ""), rows, identifier="run", texts=(1,))
