"""The section of the report on what was done to the logs."""

from __future__ import annotations

from steelyard.identification import Identification

from .extent import MOST_LOGS
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
    if chosen:
        parts.append(
            "<p>The cutoff of the position filter was chosen from the data. Left, the spectrum of each joint's "
            "acceleration: it falls beyond the motion and rises again where noise dominates. Right, what each cutoff "
            "is expected to cost: what it takes from the motion, and the noise that it leaves. The dotted line is the "
            "choice.</p>"
        )
    if len(chosen) > MOST_LOGS:
        parts.append(f"<p>The first {MOST_LOGS} of {len(chosen)} logs are shown.</p>")
    for index, (log, choice) in enumerate(chosen[:MOST_LOGS]):
        titles = ("Joint", "Noise dominates from, Hz", "Best cutoff of this joint, Hz", "Residual analysis, Hz")
        parts.append(
            f"<p><b>{escape(log)}</b>: {escape(choice.remark())}</p>"
            f'<div class="plots">{choice.svg()}</div>'
            + table(f"Evidence: {log}", titles, choice.table(), identifier=f"cutoff-{index}")
        )
    return Markup("".join(parts))
