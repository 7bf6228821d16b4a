"""Parts of the report on the answer: whether it predicts, what its numbers rest on, and what its prior costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from steelyard.identification import Identification
from steelyard.identification.parameter_table import BASES, HEADS, ParameterRow, ParameterTable
from steelyard.robot import Robot

from .charts import Chart, Curve, charts_markup
from .html_document import Markup, bullets, escape, paragraphs, percent, table
from .interval_bars import DRAWN, across, bar

__all__ = ["has_price", "number_tables", "parameters", "prediction", "price", "prior"]

_BAR = 90.0  # pixels
_KEY = '<path class="span" d="M15 7H75"/><path class="cad" d="M30 1V13"/><circle cx="45" cy="7" r="3.2"/>'
_KNOWN_FROM = {"description": "the description", "shape": "its shape", "kinematics": "the kinematics"}


def prediction(identification: Identification) -> Markup:
    """Return how well each joint is predicted, beside the noise, and what the word means."""
    told = identification.prediction
    errors = (told.joint_relative_error, told.joint_error, told.noise_floor)
    columns = (told.joint_names, *errors, told.units, told.whiteness)
    rows = [
        (name, percent(error), f"{size:.3g}", _short(floor), unit, "–" if np.isnan(white) else f"{100 * white:.0f}")
        for name, error, size, floor, unit, white in zip(*columns, strict=True)
    ]
    rows.append(("All joints", percent(told.relative_error), "", "", "", ""))
    heads = ("Joint", "Error, %", "RMS of the error", "RMS of white noise", "Unit", "White, %")
    return Markup(
        "<p>Good is at most 8 % of the torques of all joints together without white noise, usable at most "
        "15 %, poor at most 20 %, and wrong more; up to 50 % on unseen data it is still poor if the data of the fit is "
        "explained to 20 %. A joint above 40 % makes it poor at best, one above 75 % on the data of the fit wrong; "
        "so does a mistake that explains more than 20 %, or one of unit. No model predicts the white noise. Where "
        "little of what is left is white, it follows a pattern that a better model would explain.</p>"
        + table(f"Predicted: {told.source}", heads, rows, identifier="prediction-joints", texts=[4], total=True)
    )


def _short(value: float, digits: int = 3) -> str:
    return "–" if np.isnan(value) else "open" if np.isinf(value) else f"{value:.{digits}g}"


def _short_value(value: float) -> str:
    return _short(value, 4)


def _length(value: float) -> str:
    """Metres to a tenth of a millimetre, without the sign of a zero."""
    return f"{round(value, 4) + 0.0:.4f}" if np.isfinite(value) else _short(value)


# What each number rests on


@dataclass(frozen=True)
class _Line:
    """A row of a table: its name, its number, and the ends of its bar."""

    name: str
    row: ParameterRow
    scale: tuple[float, float]


def parameters(identification: Identification) -> Markup:
    """Return values, intervals, CAD and what they rest on: of links and joints first, then of all the parameters."""
    told = identification.parameters
    if told is None:
        return Markup("<p>The estimate has base parameters alone, so that no link has numbers of its own.</p>")
    has_intervals = told.confidence is not None
    text = f"<p>{escape(told.counts)}</p>"
    if has_intervals:
        text += (
            "<p>Each interval holds the true value with a probability of 95 %, as far as the model is right: it counts "
            "noise, and everything that the motion does not show, within what is physically possible. "
            "<strong>Measured</strong>: the data alone determine the value, to about a fifth of its size. "
            f"<strong>Bounded</strong>: {'data and physics together' if told.has_physics else 'the data'} confine it "
            "to its size. <strong>Assumed</strong>: "
            "neither confines it, and the value was chosen near what is known beforehand; do not take it for that of "
            "the real robot.</p>"
            f'<p class="key">{bar(_KEY, _BAR)} '
            "dot: value, bar: interval, tick: CAD; an arrow says that the interval goes on. Bars of one table share "
            "their scale, but for that of all links together.</p>"
        )
    caveat = (identification.caveat,) if identification.caveat else ()
    parts = [text, paragraphs((*caveat, *told.sentences))]
    if has_intervals:
        boxes = "".join(
            f'<label><input type="checkbox" checked autocomplete="off" value="{basis}">{basis} '
            f"({told.count(basis)})</label>"
            for basis in BASES
            if told.count(basis)
        )
        parts.append(
            f'<div class="controls basis-filter" role="group" aria-label="Numbers that are shown" hidden>{boxes}</div>'
        )
    parts.append(number_tables(told, identification.model.robot))
    return Markup("".join(parts))


def number_tables(told: ParameterTable, robot: Robot) -> Markup:
    """Return the tables of links and joints, and that of all numbers, folded away."""
    has_intervals = told.confidence is not None
    links = told.links
    masses = [link.mass for link in links]
    scale = _scale(masses, at_zero=True)
    lines = [_Line(link.name, link.mass, scale) for link in links]
    lines.append(_Line("All links", told["total mass"], _scale([told["total mass"]], at_zero=True)))
    groups = [_group("Masses, kg", "Link", lines, "masses", has_intervals, _short_value)]
    scale = _scale([row for link in links for row in link.center])
    lines = [
        _Line(f"{link.name}, {axis}", row, scale)
        for link in links
        for axis, row in zip("xyz", link.center, strict=True)
    ]
    caption = "Centres of mass in the frames of the links, m"
    groups.append(_group(caption, "Link", lines, "centers", has_intervals, _length))
    scale = _scale([row for link in links for row in link.moments], at_zero=True)
    lines = [
        _Line(f"{link.name}, {place}", row, scale) for link in links for place, row in enumerate(link.moments, start=1)
    ]
    caption = "Principal moments of inertia about the centres of mass, kg·m²"
    groups.append(_group(caption, "Link", lines, "moments", has_intervals))
    groups += _terms(told, robot, has_intervals)
    everything = table(
        f"All {len(told)} numbers, as in parameters.csv",
        [head.capitalize() if head != "CAD" else head for head in HEADS],
        [
            (
                row.name,
                *(_short_value(v) for v in (row.resolved, row.lower, row.upper, row.cad)),
                row.unit,
                _badge(row),
                row.meaning,
            )
            for row in told
        ],
        identifier="all-parameters",
        texts=[5, 6, 7],
    )
    whole = f"<details><summary>All {len(told)} numbers</summary>{everything}</details>"
    return Markup(f'<div class="columns wide">{"".join(groups)}</div>{whole}')


def _terms(told: ParameterTable, robot: Robot, has_intervals: bool) -> list[Markup]:
    """A table for each parameter of the terms at the joints, such as viscous friction."""
    by_name = {row.name: row for row in told}
    found = []
    for parameter in [parameter for term in robot.terms for parameter in term.parameters]:
        named = []
        for joint, name in zip(robot.driving_joints, robot.joint_names, strict=True):
            row = by_name.get(f"{parameter.symbol}{joint + 1}")
            if row is not None:
                named.append((name if robot.joints[joint].rotates else f"{name} (sliding)", row))
        if not named:
            continue
        scale = _scale([row for _, row in named], with_zero=True)
        both = ((True, parameter.unit), (False, parameter.unit_prismatic))
        kinds = {robot.joints[joint].rotates for joint in robot.driving_joints}
        units = " or ".join(unit for rotates, unit in both if rotates in kinds)
        caption = f"{parameter.symbol}, {parameter.description}, {units}"
        lines = [_Line(name, row, scale) for name, row in named]
        found.append(_group(caption, "Joint", lines, f"terms-{parameter.symbol}", has_intervals))
    return found


def _group(
    caption: str,
    head: str,
    lines: Sequence[_Line],
    identifier: str,
    has_intervals: bool,
    written: Callable[[float], str] = _short,
) -> Markup:
    described = any(not np.isnan(line.row.cad) for line in lines)
    # What matters most stands first, so that a narrow screen shows it without scrolling.
    shown = (True, True, has_intervals, has_intervals, has_intervals, described)
    heads = (head, "Value", DRAWN, "Rests on", "95 % interval", "CAD")
    rows, muted = [], []
    for place, line in enumerate(lines):
        row = line.row
        interval = f"{written(row.lower)} … {written(row.upper)}"
        cells = (line.name, written(row.resolved), _bar(line), _badge(row), interval, written(row.cad))
        rows.append(tuple(compress(cells, shown)))
        if row.basis == "assumed":
            muted.append(place)
    columns = tuple(compress(heads, shown))
    texts = [index for index, name in enumerate(columns) if name in (DRAWN, "Rests on")]
    return table(caption, columns, rows, identifier=identifier, texts=texts, muted=muted)


def _badge(row: ParameterRow) -> Markup:
    return Markup(f'<span class="basis {row.basis}">{row.rests_on}</span>')


def _scale(rows: Sequence[ParameterRow], *, at_zero: bool = False, with_zero: bool = False) -> tuple[float, float]:
    """The ends of bars: half as much again as values and CAD span, lest one wide interval hide the others."""
    finite = [value for row in rows for value in (row.value, row.cad) if np.isfinite(value)] or [0.0]
    low, high = min(finite), max(finite)
    if at_zero or with_zero:
        low, high = min(low, 0.0), max(high, 0.0)
    margin = 0.5 * (high - low) or 1.0
    return (low if at_zero else low - margin), high + margin


def _bar(line: _Line) -> Markup:
    """Draw the interval with its value and CAD."""
    low, high = line.scale

    def place(value: float) -> float:
        return across(value, line.scale, _BAR)

    row = line.row
    begin, end = place(row.lower), place(row.upper)
    drawn = f'<path class="span" d="M{begin:.1f} 7H{end:.1f}"/>'
    if row.lower < low:
        drawn += f'<path class="end" d="M{begin + 4:.1f} 3L{begin:.1f} 7L{begin + 4:.1f} 11"/>'
    if row.upper > high:
        drawn += f'<path class="end" d="M{end - 4:.1f} 3L{end:.1f} 7L{end - 4:.1f} 11"/>'
    if np.isfinite(row.cad):
        drawn += f'<path class="cad" d="M{place(row.cad):.1f} 1V13"/>'
    if np.isfinite(row.value):
        drawn += f'<circle cx="{place(row.value):.1f}" cy="7" r="3.2"/>'
    return bar(drawn, _BAR, kind=row.basis)


# What is known beforehand, and what it costs


def prior(identification: Identification) -> Markup:
    """Return what the prior says, of every link where it is from, and its weight; nothing where there is none."""
    plausible = identification.plausible
    if plausible is None:
        return Markup("")
    weight = f"The weight of all this is {plausible.prior_weight:.4g}"
    if plausible.validation is None:
        weight += ", which was given, or follows from the length of logs that are too short to choose it."
    else:
        weight += (
            ": the largest with which stretches of the logs, left out in turn, are predicted as well as with the best, "
            "to one standard error."
        )
    told = identification.parameters
    found = [link.mass.value for link in told.links] if told is not None else []
    rows = []
    for index, link in enumerate(plausible.prior.links):
        source = "what was stated" if link.stated else _KNOWN_FROM[link.source]
        after = [_short_value(found[index])] if found else []
        rows.append((link.link, source, _short_value(float(link.parameters[9])), *after))
    heads = ("Link", "Known from", "Mass beforehand, kg", *(["Mass in the answer, kg"] if found else []))
    return Markup(
        f"{bullets(plausible.prior.sentences)}<p>{escape(weight)}</p>"
        + table("The links beforehand", heads, rows, identifier="prior-links", texts=[1])
    )


def has_price(identification: Identification) -> bool:
    """Return whether the price of plausibility is known, of which a chart is drawn."""
    return identification.plausible is not None and identification.plausible.price is not None


def price(identification: Identification) -> Markup:
    """Return errors over the weight of the prior, with the place of the answer; nothing where they are not known."""
    plausible = identification.plausible
    if plausible is None or plausible.price is None:
        return Markup("")
    told = plausible.price
    weights = told.prior_weights
    ends = weights[[0, -1]]
    at = weights[[told.chosen]]
    curves = (
        Curve("data of the fit", weights, 100 * told.training_error, color=0),
        Curve("stretches left out", weights, 100 * told.held_out_error, color=1),
        Curve("the answer, data of the fit", at, 100 * told.training_error[[told.chosen]], "points", color=0),
        Curve("the answer, stretches left out", at, 100 * told.held_out_error[[told.chosen]], "points", color=1),
        Curve("without a prior, data of the fit", ends, np.full(2, 100 * told.unrestricted_error), "dashed", color=0),
        Curve(
            "plain least squares, stretches left out",
            ends,
            np.full(2, 100 * told.least_squares_held_out_error),
            "dashed",
            color=1,
        ),
    )
    chart = Chart("Error over the weight of the prior", "weight of the prior", "error, %", curves, True, True)
    rows: list[tuple[str, ...]] = []
    for index, (weight, training, held_out) in enumerate(
        zip(weights, told.training_error, told.held_out_error, strict=True)
    ):
        marks = [word for word, place in (("least error", told.best), ("the answer", told.chosen)) if place == index]
        rows.append((f"{weight:.3g}", percent(training), percent(held_out), ", ".join(marks)))
    rows.append(("without a prior", percent(told.unrestricted_error), "–", ""))
    errors = (told.least_squares_error, told.least_squares_held_out_error)
    rows.append(("plain least squares", *(percent(error) for error in errors), ""))
    heads = ("Weight", "Data of the fit, %", "Stretches left out, %", "Mark")
    return Markup(
        f"<p>{escape(told.sentence)}</p>"
        + charts_markup([chart], identifier="price-chart")
        + "<details><summary>The errors for every weight</summary>"
        + table("Errors for every weight", heads, rows, identifier="price-table", texts=[3])
        + "</details>"
    )
