"""The head of the report: both verdicts, what was found, what to do next, and the figures that matter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from steelyard.display import few_digits
from steelyard.files import listed
from steelyard.identification import Identification
from steelyard.identification.next_steps import NextStep, found, next_steps

from .extent import gathered, short_names, shown_logs
from .html_document import Markup, bullets, escape, figures, paragraphs, percent

__all__ = ["card", "head", "remarks"]

NOTIONS = {
    "full": "every link has positive mass, and a distribution of mass with its moments exists",
    "inertia": "every link has positive mass and positive moments of inertia about its centre of mass",
}
_MARKS = {"good": "✓", "bad": "✕", "open": "!"}


def head(identification: Identification) -> Markup:
    """Return both verdicts, what was found, what to do next, and the figures that matter."""
    cards = (_verdict_of_answer, _verdict_of_prediction, _verdict_of_least_squares)
    steps = "".join(f"<li>{_step(step)}</li>" for step in next_steps(identification))
    return Markup(
        f'<p class="lead">{escape(identification.headline)}</p>\n'
        f'<div class="verdicts">{"".join(write(identification) for write in cards)}</div>\n'
        f'<div class="outcome"><section aria-labelledby="found"><h2 id="found">What was found</h2>'
        f"{paragraphs(found(identification))}</section>"
        f'<section aria-labelledby="next"><h2 id="next">What to do next</h2><ol class="steps">{steps}</ol></section>'
        "</div>\n"
        f'<dl class="figures" aria-label="Key figures">{figures(_figures(identification))}</dl>\n'
    )


def _step(step: NextStep) -> str:
    return f"<strong>{escape(step.action)}</strong> {escape(step.reason)}<pre><code>{escape(step.code)}</code></pre>"


def remarks(identification: Identification) -> Markup:
    """Return what is to be known about data and fit, without repetition; nothing where there is nothing."""
    told = set(identification.told_first)
    said = [*identification.estimate.remarks, *identification.unconstrained.remarks, *identification.remarks]
    logs = (*identification.logs, *identification.validation_logs)
    return bullets(gathered([one for one in said if one not in told], logs))


def card(title: str, kind: str, word: str, lines: Sequence[str]) -> str:
    """Return a verdict: its title, one of good, bad, open and plain, the word, and sentences."""
    mark = f'<span aria-hidden="true">{_MARKS[kind]}</span> ' if kind in _MARKS else ""
    verdict = f'<p class="verdict">{mark}{escape(word)}</p>'
    return f'<section class="card {kind}"><h2>{escape(title)}</h2>{verdict}{paragraphs(lines)}</section>'


def _verdict_of_answer(identification: Identification) -> str:
    title, feasible_set = "Can the answer exist?", identification.feasible_set
    lines = [f"Under “{feasible_set.consistency}” consistency: {NOTIONS[feasible_set.consistency]}."]
    match identification.possible:
        case None:
            return card(title, "open", "Undecided", ["It has base parameters alone, so that no link can be checked."])
        case False:
            lines.append("Checked again for this report: not all conditions hold strictly.")
            return card(title, "open", "Undecided", lines)
        case _:
            count = len(feasible_set.blocks)
            lines.append(f"Checked again for this report: all {count} conditions on links, joints and limits hold.")
            # A tick beside a model that does not predict would be taken for a model that can be used.
            return card(title, "good" if identification.is_usable else "plain", "Feasible", lines)


def _verdict_of_prediction(identification: Identification) -> str:
    told = identification.prediction
    kind = {"good": "good", "usable": "good", "poor": "open", "wrong": "bad"}[told.word]
    scale, word, sentences = identification.scale, told.word.capitalize(), list(told.sentences)
    if scale is not None:  # an error does not tell it
        sentences.insert(0, scale.sentence)
        if kind == "good":
            kind, word = "open", f"{word}, at a doubtful scale"
    return card("Does it predict?", kind, word, sentences)


def _verdict_of_least_squares(identification: Identification) -> str:
    verdict = identification.verdict
    first = {
        True: "A real robot can have the base parameters of plain least squares.",
        False: "No real robot has the base parameters of plain least squares.",
        None: "Too close to the boundary for floating point to tell.",
    }[verdict.feasible]
    lines = [first]
    if verdict.violations:
        names = [violation.block for violation in verdict.violations]
        lines.append(f"Impossible: {listed(names, 4)}.")
    if verdict.feasible is False and verdict.certificate is not None:
        lines.append("Proved, and the proof verified in exact arithmetic.")
    word = {True: "Feasible", False: "Infeasible", None: "Undecided"}[verdict.feasible]
    return card("For comparison: plain least squares", "plain", word, lines)


def _figures(identification: Identification) -> list[tuple[str, str, str]]:
    unconstrained, estimate, told = identification.unconstrained, identification.estimate, identification.prediction
    noise = "white noise could not be separated"
    if not np.isnan(told.relative_noise):
        noise = f"noise floor {percent(told.relative_noise)} %; on {told.source}"
    error = Markup(f"{percent(told.relative_error)} <small>%</small>")
    entries: list[tuple[str, str, str]] = [("Error of the prediction", error, noise)]
    entries.append(("Relative error, identification", *_change(unconstrained.relative_error, estimate.relative_error)))
    names = short_names(identification)
    for index in shown_logs(identification):
        name, prediction = names[index], identification.predictions[index]
        if prediction.role == "validation":
            change = _change(prediction.unconstrained_error, prediction.feasible_error)
            entries.append((f"Relative error, validation on {name}", *change))
    table = identification.parameters
    if table is not None:
        total = table["total mass"]
        note = "of all moving links"
        if table.confidence is not None:
            note = total.basis
            if table.has_physics or np.isfinite(total.upper):
                note += f"; {total.interval} at 95 %"
        entries.append(("Total mass", Markup(f"{few_digits(total.value)} <small>kg</small>"), note))
        if table.confidence is not None:
            note = f"of {len(table)} numbers; {table.count('bounded')} bounded, {table.count('assumed')} assumed"
            entries.append(("Measured", Markup(str(table.count("measured"))), note))
    condition = identification.information.condition_number
    text = f"{condition:.4g}" if np.isfinite(condition) else "∞"
    count = len(unconstrained.base)
    entries.append(("Condition number", Markup(text), f"how evenly the motion shows the {count} base parameters"))
    return entries


def _change(before: float, after: float) -> tuple[Markup, str]:
    # A line may break between the two numbers alone: three digits on either side are wider than a narrow column.
    arrow = '<span aria-hidden="true"> →</span></span><span class="hidden"> to</span>'
    text = (
        f'<span class="change">{percent(before)}{arrow} <span class="change">{percent(after)} <small>%</small></span>'
    )
    return Markup(text), "from least squares to feasible"
