"""Part of the report on elastic joints."""

from __future__ import annotations

from steelyard.identification import Identification

from .html_document import Markup, escape, table

__all__ = ["elastic_joints"]


def elastic_joints(identification: Identification) -> Markup:
    """Return stiffness, damping and second encoder of each elastic joint; nothing where there is none."""
    if not identification.elastic_joints:
        return Markup("")
    heads, rows = identification.elastic_table()
    sentences = [*(one.sentence for one in identification.elastic_joints), *identification.elastic_sentences]
    told = "".join(f"<p>{escape(one)}</p>" for one in sentences)
    caption = "Stiffness with its interval of 95 %, on the joint side of the gears"
    return Markup(table(caption, heads, rows, identifier="elastic-joints", texts=[1, 5]) + told)
