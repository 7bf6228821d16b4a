"""The first screen of the report: whether the robot is possible, how well it predicts, and what is uncertain."""

from __future__ import annotations

import numpy as np

from steelyard.identification import Identification

from .extent import gathered, short_names, shown_logs
from .html_document import Markup, escape, percent

__all__ = ["NOTIONS", "is_proved", "summary"]

NOTIONS = {
    "full": "every link has positive mass, and a distribution of mass with its moments exists",
    "inertia": "every link has positive mass and positive moments of inertia about its centre of mass",
}
_VERDICTS = {True: ("good", "✓", "Feasible"), False: ("bad", "✕", "Infeasible"), None: ("open", "?", "Undecided")}
_SAME = 5e-4  # errors closer than this are called the same


def is_proved(identification: Identification) -> bool:
    """Return whether the answer's parameters meet all the conditions, tried once more and not taken from the result."""
    parameters = identification.estimate.parameters
    return parameters is not None and identification.feasible_set.contains(parameters)


def summary(identification: Identification) -> Markup:
    """Return the verdicts, the figures that matter and the remarks."""
    remarks = [*identification.estimate.remarks, *identification.unconstrained.remarks, *identification.remarks]
    logs = (*identification.logs, *identification.validation_logs)
    items = "".join(f"<li>{escape(remark)}</li>" for remark in gathered(remarks, logs))
    notes = (
        f'<section aria-labelledby="remarks"><h2 id="remarks">Remarks</h2><ul>{items}</ul></section>' if items else ""
    )
    return Markup(
        f'<p class="lead">{_lead(identification)}</p>\n'
        f'<div class="verdicts">{_verdict_of_least_squares(identification)}{_verdict_of_answer(identification)}</div>\n'
        f'<dl class="figures" aria-label="Key figures">{_figures(identification)}</dl>\n{notes}'
    )


def _lead(identification: Identification) -> Markup:
    before, after = identification.unconstrained.relative_error, identification.estimate.relative_error
    error = (
        "the same error" if abs(after - before) < _SAME else f"{percent(after)} % error instead of {percent(before)} %"
    )
    match identification.verdict.feasible:
        case False:
            start = "Plain least squares describes a robot that cannot exist."
        case True:
            start = "Plain least squares already describes a robot that can exist."
        case None:
            start = "Plain least squares describes a robot on the border of what can exist."
    if not is_proved(identification):
        return escape(f"{start} Steelyard's answer, with {error}, is not proved to be possible.")
    return escape(f"{start} Steelyard's answer can exist, and predicts the measured torques with {error}.")


def _card(title: str, feasible: bool | None, lines: list[str]) -> str:
    kind, mark, word = _VERDICTS[feasible]
    body = "".join(f"<p>{escape(line)}</p>" for line in lines)
    return (
        f'<section class="card {kind}"><h2>{escape(title)}</h2>'
        f'<p class="verdict"><span aria-hidden="true">{mark}</span> {word}</p>{body}</section>'
    )


def _verdict_of_least_squares(identification: Identification) -> str:
    verdict = identification.verdict
    first = {
        True: "A real robot can have these base parameters.",
        False: "No real robot has these base parameters.",
        None: "Too close to the boundary for floating point to tell.",
    }[verdict.feasible]
    lines = [first]
    if verdict.violations:
        names = [violation.block for violation in verdict.violations]
        more = f" and {len(names) - 4} more" if len(names) > 4 else ""
        lines.append(f"Impossible: {', '.join(names[:4])}{more}.")
    if verdict.feasible is False and verdict.certificate is not None:
        lines.append("Proved, and the proof verified in exact arithmetic.")
    return _card("Plain least squares", verdict.feasible, lines)


def _verdict_of_answer(identification: Identification) -> str:
    estimate, feasible_set = identification.estimate, identification.feasible_set
    if estimate.parameters is None:
        return _card("Steelyard's answer", None, ["It has base parameters alone, so that no link can be checked."])
    proved = is_proved(identification)
    lines = [f"Under “{feasible_set.consistency}” consistency: {NOTIONS[feasible_set.consistency]}."]
    if proved:
        count = len(feasible_set.blocks)
        lines.append(f"Checked again for this report: all {count} conditions on links, joints and limits hold.")
    else:
        lines.append("Checked again for this report: not all conditions hold strictly.")
    return _card("Steelyard's answer", True if proved else None, lines)


def _figures(identification: Identification) -> str:
    unconstrained, estimate = identification.unconstrained, identification.estimate
    figures = [("Relative error, identification", *_change(unconstrained.relative_error, estimate.relative_error))]
    names = short_names(identification)
    for index in shown_logs(identification):
        name, prediction = names[index], identification.predictions[index]
        if prediction.role == "validation":
            change = _change(prediction.unconstrained_error, prediction.feasible_error)
            figures.append((f"Relative error, validation on {name}", *change))
    if estimate.parameters is not None:
        links = len(identification.model.robot.links)
        note = f"of the {links} moving links" if links != 1 else "of the moving link"
        figures.append(("Total mass", Markup(f"{identification.total_mass:.4g} <small>kg</small>"), note))
    condition = identification.information.condition_number
    text = f"{condition:.4g}" if np.isfinite(condition) else "∞"
    figures.append(
        ("Condition number", Markup(text), "of the base regressor: how evenly the motion shows all parameters")
    )
    figures.append(_base_parameters(identification))
    return "".join(
        f"<div><dt>{escape(term)}</dt><dd>{value}<span>{escape(note)}</span></dd></div>"
        for term, value, note in figures
    )


def _change(before: float, after: float) -> tuple[Markup, str]:
    arrow = '<span aria-hidden="true"> → </span><span class="hidden"> to </span>'
    text = f'<span class="change">{percent(before)}{arrow}{percent(after)} <small>%</small></span>'
    return Markup(text), "from least squares to feasible"


def _base_parameters(identification: Identification) -> tuple[str, Markup, str]:
    count, weak = len(identification.unconstrained.base), len(identification.weak)
    unidentifiable = int(np.sum(~np.isfinite(identification.unconstrained.standard_error)))
    if not weak and not unidentifiable:
        note = "all shown by the data"
    else:
        note = f"{weak} weak: standard error larger than the value"
        if unidentifiable:
            note += f"; {unidentifiable} unidentifiable"
    return "Base parameters", Markup(str(count)), note
