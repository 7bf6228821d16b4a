"""Parts of the report on drives: friction that was chosen, and elastic joints."""

from __future__ import annotations

from steelyard.identification import Identification

from .html_document import Markup, bullets, escape, paragraphs, table

__all__ = ["elastic_joints", "friction"]


def friction(identification: Identification) -> Markup:
    """Return which laws of friction were added, what became of the others, and the terms for a robot.toml."""
    choice = identification.friction
    if choice is None:
        return Markup("")
    selection, parts = choice.selection, [bullets(choice.sentences)]
    if selection.chosen:
        heads, rows = selection.chosen_table()
        parts.append(table("Laws that were added", heads, rows, identifier="friction-chosen", texts=range(len(heads))))
    if choice.presliding:
        heads, rows = selection.chosen_table(choice.presliding)
        title = "Presliding that is not in the model"
        parts.append(table(title, heads, rows, identifier="friction-presliding", texts=range(len(heads))))
    heads, rows = selection.table()
    parts.append(
        Markup(
            "<p>At each step the law that lowers the error most is added at the joints that call for it: where it is "
            "significant, for residuals that are correlated in time and after correction for the number of laws and "
            "joints, and where the error on stretches of the logs that are left out falls. Errors are those of each "
            "joint by itself.</p>"
        )
    )
    parts.append(table("Laws that were tried", heads, rows, identifier="friction-tried", texts=range(1, len(heads))))
    if selection.chosen:
        parts.append(Markup(f"<p>The terms, for a robot.toml:</p><pre>{escape(choice.toml)}</pre>"))
    return Markup("".join(parts))


def elastic_joints(identification: Identification) -> Markup:
    """Return stiffness, damping and second encoder of each elastic joint; nothing where there is none."""
    if not identification.elastic_joints:
        return Markup("")
    heads, rows = identification.elastic_table()
    sentences = [*(one.sentence for one in identification.elastic_joints), *identification.elastic_sentences]
    caption = "Stiffness with its interval of 95 %, on the joint side of the gears"
    return Markup(table(caption, heads, rows, identifier="elastic-joints", texts=[1, 5]) + paragraphs(sentences))
