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
    told = "".join(f"<p>{escape(one.sentence)}</p>" for one in identification.elastic_joints)
    return Markup(
        table("Stiffness with its interval of 95 %, SI units", heads, rows, identifier="elastic-joints", texts=[1])
        + told
    )
