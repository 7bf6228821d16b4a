"""The section of the report on what was done to the logs."""

from __future__ import annotations

from steelyard.identification import Identification

from .markup import Markup, escape, table

__all__ = ["processing"]


def processing(identification: Identification) -> Markup:
    """Return how the logs were processed, with the evidence where the data decided."""
    options = identification.options.get("processing") or {}
    assert isinstance(options, dict)
    chosen = identification.cutoff_choices
    rows = [(str(name), str(value)) for name, value in options.items()]
    parts: list[str] = []
    if rows:
        parts.append(
            table("Options of [processing]", ("Option", "Value"), rows, identifier="processing-options", texts=[1])
        )
    else:
        parts.append("<p>The logs were processed with the defaults.</p>")
    for index, (log, choice) in enumerate(chosen):
        parts.append(
            f"<p>{escape(choice.explanation)}</p><p><b>{escape(log)}</b>: {escape(choice.remark)}</p>"
            f'<div class="plots">{choice.svg()}</div>'
            + table(f"Evidence: {log}", choice.titles, choice.table, identifier=f"cutoff-{index}")
        )
    return Markup("".join(parts))
