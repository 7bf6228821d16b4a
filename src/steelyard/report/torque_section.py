"""Measured against predicted torque of each joint, what is left of it, and where the prediction comes from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.identification import Identification, Prediction

from .extent import default_log, shared_words, short_names, shown_logs
from .html_document import WITHOUT_SCRIPTS, Markup, escape, percent, script_data, table
from .packed_curves import PackedCurves, extreme_rows
from .residual_patterns import autocorrelation, spectrum
from .torque_sources import shares, torque_sources

__all__ = ["TORQUE_SCRIPTS", "drawn_logs", "sources", "torques"]

Array = NDArray[np.float64]
TORQUE_SCRIPTS = ("curves.js",)

_ALL_ROWS = 32_000
"""Rows of curves in a page, of all its logs and joints together, of 11 bytes each once they are packed: a third
of a megabyte, so that a page with Plotly, 1.96 MB, stays below three for a humanoid of 29 joints, too."""
_MOST_ROWS, _FEWEST_ROWS = 2400, 600
"""Rows of a joint that are drawn: four for each of 600 pixels, or of 150, below which fewer logs are drawn."""
_SOURCE_ROWS = 20_000  # of the curves of all the joints together in the figures of sources
_CURVES = (("measured", "measured"), ("unconstrained", "least squares"), ("feasible", "answer"))
_STEPS = (
    ("in", "Zoom in"),
    ("out", "Zoom out"),
    ("earlier", "← Earlier"),
    ("later", "Later →"),
    ("whole", "Whole log"),
)


def drawn_logs(identification: Identification) -> list[int]:
    """Return the predictions of which curves are drawn: those that are shown, as many as leave each enough rows."""
    shown = shown_logs(identification)
    most = max(_ALL_ROWS // (_FEWEST_ROWS * max(len(identification.model.robot.torque_units), 1)), 1)
    if len(shown) <= most:
        return shown
    first = default_log(identification)
    heads = [next((k for k in shown if identification.predictions[k].role == role), first) for role in _ROLES]
    rest = sorted(shown, key=lambda k: -identification.predictions[k].feasible_error)
    return sorted(list(dict.fromkeys([first, *heads, *rest]))[:most])


_ROLES = ("validation", "identification")


# The torques of every joint


def torques(identification: Identification) -> Markup:
    """Return the frames of the figures, the choice of log, the legend, the buttons and the data."""
    if not identification.predictions:
        return Markup("")
    drawn, names = drawn_logs(identification), short_names(identification)
    first = drawn.index(default_log(identification))
    groups = []
    for role, title in (("validation", "Validation: not used in the fit"), ("identification", "Data of the fit")):
        options = "".join(
            f'<option value="{place}"{" selected" if place == first else ""}>{escape(names[index])}</option>'
            for place, index in enumerate(drawn)
            if identification.predictions[index].role == role
        )
        groups.append(f'<optgroup label="{title}">{options}</optgroup>' if options else "")
    legend = "".join(
        f'<label class="curve {kind}"><input type="checkbox" checked autocomplete="off" data-curve="{kind}">'
        '<svg viewBox="0 0 32 6" width="32" height="6" aria-hidden="true"><path d="M1 3H31"/></svg>'
        f"{label}</label>"
        for kind, label in _CURVES
    )
    figures = "".join(
        f'<figure class="joint"><figcaption>{escape(name)} <span class="error" id="torque-{index}-error"></span>'
        f"</figcaption>{_frame('plot', f'torque-{index}', f'Torque of {name} over time')}"
        f'<details class="pattern" data-joint="{index}"><summary>Spectrum and autocorrelation of the residual of '
        f'{escape(name)}</summary><div class="pair">'
        f"{_frame('small', f'spectrum-{index}', f'Spectrum of the residual of {name}')}"
        f"{_frame('small', f'lags-{index}', f'Autocorrelation of the residual of {name}')}</div></details></figure>"
        for index, name in enumerate(identification.estimate.joint_names)
    )
    packed = PackedCurves()
    told = [_log(identification, index, names[index], packed, len(drawn)) for index in drawn]
    words = shared_words(identification.predictions, drawn)
    return Markup(
        "<p>Above, the torque as it was measured and as it is predicted; below it on the same axis of time the "
        "<strong>residual</strong>, measured less predicted by the answer, in its own scale. The grey band is the "
        "<strong>noise floor</strong>: 2 RMS of the white noise, within which 95 of 100 residuals of a perfect model "
        "would lie. What leaves it in a pattern, a better model would explain. Beside the names stand the relative "
        "errors, least squares → answer.</p>"
        f"<p>Drag in a figure to zoom into a span of time in all the joints, double-click to see the whole. {words}</p>"
        '<div class="controls"><label>Log <select id="log-choice" autocomplete="off">'
        f"{''.join(groups)}</select></label>"
        f'<span class="legend" role="group" aria-label="Curves">{legend}</span>{_buttons()}</div>'
        '<p class="thinned" id="torque-rows" aria-live="polite"></p>'
        f'{WITHOUT_SCRIPTS}<div class="plots">{figures}</div>'
        f'<script type="application/json" id="torque-data">{script_data(told)}</script>{packed.markup("torque-curves")}'
    )


def _frame(kind: str, identifier: str, label: str) -> str:
    """The place of a chart, with words for those who cannot see it, also before it is drawn."""
    return f'<div class="{kind}" id="{identifier}" role="img" aria-label="{escape(label)}"></div>'


def _buttons() -> str:
    steps = "".join(f'<button type="button" data-zoom="{step}">{label}</button>' for step, label in _STEPS)
    return f'<span class="zoom" role="group" aria-label="Span of time">{steps}</span>'


def _noise(identification: Identification) -> list[float | None]:
    """The root mean square of the white noise of each joint, None where it is not known."""
    told, count = identification.prediction, len(identification.model.robot.torque_units)
    floor = np.asarray(told.noise_floor, dtype=float)
    if len(floor) != count:
        return [None] * count
    return [float(f"{value:.4g}") if np.isfinite(value) else None for value in floor]


def _log(identification: Identification, index: int, log: str, packed: PackedCurves, logs: int) -> dict[str, Any]:
    prediction = identification.predictions[index]
    trace, units = prediction.trace, identification.model.robot.torque_units
    used = None if trace.samples is None else trace.samples.mask
    residual = trace.measured - trace.feasible
    if used is not None:
        residual = np.where(used, residual, np.nan)
    # Times count from the first row, because stamps since 1970 would all be equal in the digits that are kept.
    t = trace.t - trace.t[0] if len(trace.t) else trace.t
    most = min(max(_ALL_ROWS // (logs * len(units)), 100), _MOST_ROWS)
    patterns = _patterns(prediction)
    joints = []
    noise = _noise(identification)
    for joint, (name, unit) in enumerate(zip(identification.estimate.joint_names, units, strict=True)):
        before, after = prediction.joint_unconstrained_error[joint], prediction.joint_feasible_error[joint]
        measured = trace.measured[:, joint]
        rows = extreme_rows([measured, residual[:, joint]], most) if len(measured) else np.zeros(0, dtype=int)
        left = residual[np.isfinite(residual[:, joint]), joint]
        span = f"measured from {measured.min():.3g} to {measured.max():.3g} {unit}, " if len(measured) else ""
        size = f"residual at most {np.abs(left).max():.3g} {unit}, " if len(left) else ""
        floor = "" if noise[joint] is None else f"noise floor {noise[joint]:.3g} {unit}, "
        joints.append(
            {
                "label": f"Torque of {name} over time on {log}: {span}{size}{floor}relative error {percent(before)} % "
                f"with least squares, {percent(after)} % of the answer",
                "error": f"{percent(before)} % → {percent(after)} %",
                "unit": unit,
                "noise": noise[joint],
                "t": packed.add(t[rows]),
                "residual": packed.add(residual[rows, joint]),
                **{kind: packed.add(getattr(trace, kind)[rows, joint]) for kind, _ in _CURVES},
                **_pattern(patterns, joint, packed),
            }
        )
    seen = "Validation, not used in the fit. " if prediction.role == "validation" else "Data of the fit. "
    told = _thinned(trace.log_rows or len(t), len(t), most, trace.piece_rows, used)
    return {"rows": seen + told, "joints": joints}


def _thinned(rows: int, kept: int, most: int, piece: int, used: NDArray[np.bool_] | None) -> str:
    """Say which rows are drawn."""
    if kept <= most and piece == 1:
        text = f"All {rows} rows are drawn."
    else:
        pieces = max((min(most, kept) - 2) // 4, 1)
        text = (
            f"The log has {rows} rows. Of each of about {pieces} pieces of it those are drawn at which the measured "
            "torque and the residual are least and greatest, so that no peak is lost; between them lines are straight."
        )
        if piece > 1:
            text += " While a log of this length is read, a preliminary fit tells where the residual is greatest."
    if used is not None:
        text += " The residual has gaps where a row was not used in the fit."
    return text


def _patterns(prediction: Prediction) -> tuple[Array, ...] | None:
    windows, interval = prediction.trace.residuals, prediction.trace.interval
    if not windows or max(len(one) for one in windows) < 64 or not (np.isfinite(interval) and interval > 0.0):
        return None
    return (*spectrum(windows, interval), *autocorrelation(windows, interval))


def _pattern(found: tuple[Array, ...] | None, joint: int, packed: PackedCurves) -> dict[str, Any]:
    if found is None:
        return {}
    frequency, density, lag, correlation, bound = found
    with np.errstate(divide="ignore"):
        decibels = np.log10(density[:, joint])
    return {
        # Logarithms, of which two bytes are enough on a logarithmic axis.
        "frequency": packed.add(np.log10(frequency)),
        "density": packed.add(decibels),
        "lag": packed.add(lag),
        "correlation": packed.add(correlation[:, joint]),
        "bound": float(f"{bound[joint]:.3g}"),
        "nyquist": float(f"{frequency[-1]:.6g}"),
    }


# Where the predicted torque comes from


def sources(identification: Identification) -> Markup:
    """Return the parts of the predicted torque of each joint, as figures and as a table of their sizes and shares."""
    parameters, predictions = identification.estimate.parameters, identification.predictions
    if parameters is None or not predictions:
        return Markup("")
    index = default_log(identification)
    prediction, names = predictions[index], short_names(identification)
    trace, even = prediction.trace, prediction.samples
    if trace.samples is None or even is None or not even.count:
        return Markup("")
    units, joints = identification.model.robot.torque_units, identification.estimate.joint_names
    sizes, parts = shares(torque_sources(identification.model, parameters, even))
    drawn = torque_sources(identification.model, parameters, trace.samples)
    packed = PackedCurves()
    t = trace.t - trace.t[0]
    most = max(_SOURCE_ROWS // (len(units) * (len(drawn) + 1)), 60)
    data = []
    for joint, unit in enumerate(units):
        rows = extreme_rows([trace.feasible[:, joint]], most)
        data.append(
            {
                "unit": unit,
                "label": f"Parts of the predicted torque of {joints[joint]} over time on {names[index]}: "
                + ", ".join(f"{name} {_share(parts[name][joint])}" for name in drawn),
                "t": packed.add(t[rows]),
                "total": packed.add(trace.feasible[rows, joint]),
                "parts": [packed.add(one[rows, joint]) for one in drawn.values()],
            }
        )
    largest = np.max(list(sizes.values()), axis=0)
    lines = [
        (name, *(_part(sizes[one][joint], parts[one][joint], largest[joint]) for one in drawn), units[joint])
        for joint, name in enumerate(joints)
    ]
    heads = ("Joint", *(name[0].upper() + name[1:] for name in drawn), "Unit")
    legend = "".join(
        f'<label class="curve"><input type="checkbox" checked autocomplete="off" data-source="{place}">'
        '<svg viewBox="0 0 32 6" width="32" height="6" aria-hidden="true">'
        f'<path class="source-{place}" d="M1 3H31"/></svg>'
        f"{escape(name)}</label>"
        for place, name in enumerate(("all together", *drawn))
    )
    figures = "".join(
        f"<figure><figcaption>{escape(name)}</figcaption>"
        f"{_frame('plot', f'source-{joint}', f'Sources of the torque of {name} over time')}</figure>"
        for joint, name in enumerate(joints)
    )
    return Markup(
        "<p>What the answer says of the torque of each joint, in parts that add up to the prediction: gravity, what "
        "the acceleration of the links takes (inertia), what their speed takes (Coriolis and centrifugal), and the "
        f"terms at the joints. On {escape(names[index])}. The table gives the root mean square of each part, and in "
        "brackets its share in the mean square of the whole: shares of a joint add up to 100 %, and a negative one is "
        "of a part that mostly acts against the others. A part that is small here is hardly shown by this motion.</p>"
        + table(
            f"Where the torque comes from, {names[index]}",
            heads,
            lines,
            identifier="torque-parts",
            texts=[len(heads) - 1],
        )
        + f'<div class="controls"><span class="legend" role="group" aria-label="Parts">{legend}</span></div>'
        f'<div class="plots">{figures}</div>'
        '<script type="application/json" id="source-data">'
        f"{script_data({'names': list(drawn), 'joints': data})}</script>"
        f"{packed.markup('source-curves')}"
    )


def _part(size: float, share: float, largest: float) -> str:
    """The size of a part with its share; rounding errors of what is nothing are not shown."""
    return "0" if size <= 1e-9 * largest else f"{size:.3g} ({_share(share)})"


def _share(value: float) -> str:
    if not np.isfinite(value):
        return "–"
    rounded = round(100.0 * value) + 0
    return f"{rounded} %" if rounded or value == 0.0 else "< 1 %"
