"""Measured and predicted torques as a Plotly figure, for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from steelyard.errors import InputError
from steelyard.files import listed, suggestion
from steelyard.identification import Identification, Prediction

from .extent import default_log, short_names
from .html_document import percent, plotly_text

if TYPE_CHECKING:
    import plotly.graph_objects as go

__all__ = ["torque_plot"]

_CURVES = (
    ("measured", "measured", "#8b8b8b", 1.0),
    ("unconstrained", "least squares", "#e8963f", 3.5),
    ("feasible", "answer", "#2f8fd0", 1.6),
)
"""Colours that can be told apart on a light and on a dark ground."""
_ROW, _MARGIN = 170, 90  # pixels


def torque_plot(
    identification: Identification, log: str | int | None = None, joints: Sequence[str] | None = None
) -> go.Figure:
    """Return the torques of one log as measured and as both estimates predict them, a row for each joint.

    Parameters
    ----------
    identification : Identification
    log : str or int, optional
        Its name or its number among the predictions; by default the first for validation, or else the first.
    joints : sequence of str, optional
        Names of those that are shown; all by default.

    Raises
    ------
    InputError
        If there is no such log or joint.
    """
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    prediction, name = _chosen(identification, log)
    known = identification.estimate.joint_names
    shown = list(known) if joints is None else [joints] if isinstance(joints, str) else list(joints)
    for joint in shown:
        if joint not in known:
            raise InputError(f"{identification.model.robot.name} has no joint {joint!r}; {suggestion(joint, known)}")
    if not shown:
        raise InputError(f"no joint is to be shown; name some of {listed(known)}.")
    robot = identification.model.robot
    indices = [known.index(joint) for joint in shown]
    before, after = prediction.joint_unconstrained_error, prediction.joint_feasible_error
    titles = [f"{plotly_text(known[k])}: {percent(before[k])} % → {percent(after[k])} %" for k in indices]
    figure = make_subplots(
        rows=len(shown), cols=1, shared_xaxes=True, vertical_spacing=0.25 / len(shown), subplot_titles=titles
    )
    trace = prediction.trace
    for row, index in enumerate(indices, start=1):
        for attribute, label, color, width in _CURVES:
            curve = go.Scatter(
                x=trace.t,
                y=getattr(trace, attribute)[:, index],
                name=label,
                legendgroup=attribute,
                showlegend=row == 1,
                line={"color": color, "width": width},
                hovertemplate="%{y:.4g}",
            )
            figure.add_trace(curve, row=row, col=1)
        figure.update_yaxes(title_text=robot.torque_units[index], row=row, col=1)
    figure.update_xaxes(title_text="time, s", row=len(shown), col=1)
    figure.update_layout(
        title=f"{plotly_text(f'{robot.name}, {name}')} ({prediction.role}): relative errors, least squares → answer",
        height=_ROW * len(shown) + _MARGIN,
        hovermode="x unified",
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        font={"color": "#808080"},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 1.0, "xanchor": "right"},
    )
    figure.update_xaxes(gridcolor="rgba(128,128,128,0.25)", zerolinecolor="rgba(128,128,128,0.5)")
    figure.update_yaxes(gridcolor="rgba(128,128,128,0.25)", zerolinecolor="rgba(128,128,128,0.5)")
    return figure


def _chosen(identification: Identification, log: str | int | None) -> tuple[Prediction, str]:
    """Return the prediction of a log, and a short name for it."""
    predictions, names = identification.predictions, short_names(identification)
    if log is None:
        index = default_log(identification)
    elif isinstance(log, str):
        found = [k for k, one in enumerate(predictions) if log in (one.name, names[k])]
        if not found:
            raise InputError(f"there is no log {log!r}; {suggestion(log, names)}")
        index = found[0]
    elif -len(predictions) <= log < len(predictions):
        index = log
    else:
        raise InputError(f"there are {len(predictions)} logs, counted from 0, got {log!r}.")
    return predictions[index], names[index]
