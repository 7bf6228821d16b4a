"""Measured against predicted torque, one small figure for each joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.identification import Identification, Prediction

from .charts import POINTS, rounded
from .extent import shared_words, short_names, shown_logs
from .html_document import Markup, escape, percent, script_data

__all__ = ["default_log", "torque_data", "torque_figures"]

Array = NDArray[np.float64]
_CURVES = (("measured", "measured"), ("unconstrained", "least squares"), ("feasible", "feasible"))


def default_log(identification: Identification) -> int:
    """Return which of the logs that are shown comes first: the first one for validation, or else the first."""
    roles = [identification.predictions[index].role for index in shown_logs(identification)]
    return roles.index("validation") if "validation" in roles else 0


def torque_figures(identification: Identification) -> Markup:
    """Return the frames of the figures, the choice of log, the legend and the data."""
    if not identification.predictions:
        return Markup("<p>There is no log to show.</p>")
    chosen = default_log(identification)
    selected = {True: " selected", False: ""}
    names, shown = short_names(identification), shown_logs(identification)
    options = "".join(
        f'<option value="{place}"{selected[place == chosen]}>'
        f"{escape(f'{names[index]} ({identification.predictions[index].role})')}</option>"
        for place, index in enumerate(shown)
    )
    legend = "".join(
        f'<label class="curve {kind}"><input type="checkbox" checked value="{kind}">'
        f'<svg width="26" height="8" aria-hidden="true"><path d="M0 4H26"/></svg>{escape(label)}</label>'
        for kind, label in _CURVES
    )
    figures = "".join(
        f'<figure><figcaption>{escape(name)} <span class="error" id="torque-{index}-error"></span></figcaption>'
        f'<div class="plot" id="torque-{index}" role="img"></div></figure>'
        for index, name in enumerate(identification.estimate.joint_names)
    )
    return Markup(
        "<p>Where the two predictions agree, the feasible one lies on top of the other. The figures beside the names "
        "are the relative errors, least squares → feasible. Drag to zoom into a span of time in all the joints, "
        f"double-click to see the whole again. {escape(shared_words(identification.predictions, shown))}</p>"
        f'<div class="controls"><label>Log <select id="log-choice" autocomplete="off">{options}</select></label>'
        f'<span class="legend" role="group" aria-label="Curves">{legend}</span></div>'
        "<noscript><p>The figures are drawn by a script, and scripts are turned off here.</p></noscript>"
        f'<div class="plots">{figures}</div>'
        f'<script type="application/json" id="torque-data">{torque_data(identification)}</script>'
    )


def torque_data(identification: Identification) -> str:
    """Return the curves as JSON that may stand in a script element."""
    robot = identification.model.robot
    units = ["N·m" if robot.joints[index].rotates else "N" for index in robot.driving_joints]
    joints, names = identification.estimate.joint_names, short_names(identification)
    logs = [_log(identification.predictions[k], names[k], joints, units) for k in shown_logs(identification)]
    return script_data(logs)


def _log(prediction: Prediction, log: str, names: tuple[str, ...], units: list[str]) -> dict[str, object]:
    trace = prediction.trace
    rows = slice(None, None, -(-len(trace.t) // POINTS) or 1)
    joints = []
    for index, (name, unit) in enumerate(zip(names, units, strict=True)):
        before, after = prediction.joint_unconstrained_error[index], prediction.joint_feasible_error[index]
        measured = trace.measured[:, index]
        finite = measured[np.isfinite(measured)]
        span = f"measured from {finite.min():.3g} to {finite.max():.3g} {unit}, " if len(finite) else ""
        joints.append(
            {
                "label": f"Torque of {name} over time on {log}: {span}relative error {percent(before)} % with least "
                f"squares, {percent(after)} % feasible",
                "error": f"{percent(before)} % → {percent(after)} %",
                "unit": unit,
                **{kind: rounded(getattr(trace, kind)[rows, index], 5) for kind, _ in _CURVES},
            }
        )
    # Times count from the first row, because stamps since 1970 would all be equal in the digits that are kept.
    return {"t": rounded((trace.t - trace.t[:1])[rows], 7), "joints": joints}
