"""A picture of an identification in one look: the verdicts, and measured against predicted torque, as SVG."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.display import shortened
from steelyard.files import write_text
from steelyard.identification import Identification, Prediction

from .extent import default_log
from .html_document import escape, percent

__all__ = ["torque_picture", "torque_svg"]

Array = NDArray[np.float64]
WIDTH, HEIGHT, MARGIN = 1000, 420, 32
PANELS, POINTS = 3, 360
_TOP, _BOTTOM = 152, 352  # of the panels
_TEXT, _SOFT, _LINE = "#1d2023", "#5a6067", "#e3e3de"
_GOOD, _BAD, _OPEN = "#00604a", "#a33a00", "#5a4a00"
_CURVES = (
    ("measured", "measured", "#8b8b8b", 1.0),
    ("unconstrained", "least squares", "#e8963f", 4.5),
    ("feasible", "feasible", "#005f9e", 1.8),
)
_CHECK, _CROSS = "M1 8 6 13 15 2", "M2 2 14 14M14 2 2 14"


def torque_svg(identification: Identification) -> str:
    """Return the picture of the three joints with the largest torques, on the first validation log where there is one.

    Parameters
    ----------
    identification : Identification
        With at least one log.

    Returns
    -------
    str
        An SVG document, 1000 x 420, on a light card.
    """
    prediction = identification.predictions[default_log(identification)]
    strength = np.sqrt(np.nanmean(np.square(prediction.trace.measured), axis=0))
    chosen = sorted(np.argsort(-strength, kind="stable")[:PANELS].tolist())
    gap = 30.0
    width = (WIDTH - 2 * MARGIN - gap * (len(chosen) - 1)) / len(chosen)
    panels = "\n".join(
        _panel(identification, prediction, joint, MARGIN + place * (width + gap), width)
        for place, joint in enumerate(chosen)
    )
    title = f"{identification.model.robot.name}: measured and predicted torques"
    return f"""\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" role="img" \
aria-labelledby="title description" font-family="system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif">
<title id="title">{escape(title)}</title>
<desc id="description">{escape(" ".join(_words(identification, prediction)))}</desc>
<rect x="0.5" y="0.5" width="{WIDTH - 1}" height="{HEIGHT - 1}" rx="8" fill="#fdfdfb" stroke="#d5d5d0"/>
{_headlines(identification, prediction)}
{panels}
{_legend(prediction)}
</svg>
"""


def torque_picture(identification: Identification, target: str | Path) -> None:
    """Write the picture of `torque_svg`; the file appears whole or not at all.

    Parameters
    ----------
    identification : Identification
        With at least one log.
    target : str or Path
        An ``.svg`` file, replaced where it is there.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_text(torque_svg(identification), target)


def _words(identification: Identification, prediction: Prediction) -> tuple[str, str, str, str]:
    """Headline and reason of plain least squares, headline and reason of the answer."""
    verdict = identification.verdict
    before = {False: "An impossible robot", True: "A robot that can exist", None: "On the border of the possible"}
    worst = str(verdict.violations[0]) if verdict.violations else "no condition is violated"
    known = identification.estimate.parameters is not None
    mass = f"total mass {identification.total_mass:.3g} kg, " if known else ""
    return (
        before[verdict.feasible],
        f"{worst}; error {percent(prediction.unconstrained_error)} %",
        "A robot that can exist" if identification.possible else "Not proved to be possible",
        f"{mass}error {percent(prediction.feasible_error)} %",
    )


def _headlines(identification: Identification, prediction: Prediction) -> str:
    before, why, after, what = _words(identification, prediction)
    feasible = identification.verdict.feasible
    color = {False: _BAD, True: _GOOD, None: _OPEN}[feasible]
    good = after == "A robot that can exist"
    half = WIDTH / 2 + 15
    return _headline(
        MARGIN, half - 30, "Plain least squares", before, why, color, _CHECK if feasible else _CROSS
    ) + _headline(half, WIDTH - MARGIN, "Steelyard", after, what, _GOOD if good else _OPEN, _CHECK if good else _CROSS)


def _headline(left: float, right: float, label: str, verdict: str, reason: str, color: str, mark: str) -> str:
    longest = int((right - left) / 7.2)  # characters of the small text that have room
    short = shortened(reason, longest)
    return (
        f'<path d="M{left:g} 26H{right:g}" stroke="{color}" stroke-width="3"/>'
        f'<text x="{left:g}" y="50" font-size="14" fill="{_SOFT}">{label}</text>'
        f'<path transform="translate({left:g} 63)" d="{mark}" fill="none" stroke="{color}" stroke-width="2.6"/>'
        f'<text x="{left + 25:g}" y="79" font-size="23" font-weight="650" fill="{color}">{verdict}</text>'
        f'<text x="{left:g}" y="104" font-size="14" fill="{_TEXT}">{escape(short)}</text>\n'
    )


def _panel(identification: Identification, prediction: Prediction, joint: int, left: float, width: float) -> str:
    trace, unit = prediction.trace, identification.model.robot.torque_units[joint]
    rows = slice(None, None, max(1, -(-len(trace.t) // POINTS)))
    t = trace.t[rows]
    curves = {kind: getattr(trace, kind)[rows, joint] for kind, *_ in _CURVES}
    values = np.concatenate(list(curves.values()))
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    room = 0.04 * (high - low) or 1.0
    low, high = low - room, high + room
    start, inner = left + 36, width - 36
    span = float(t[-1] - t[0]) or 1.0

    def height(value: float | Array) -> float | Array:
        return _BOTTOM - (value - low) / (high - low) * (_BOTTOM - _TOP)

    parts = [f'<text x="{start:g}" y="{_TOP - 8}" font-size="14" font-weight="600" fill="{_TEXT}">']
    name = escape(identification.estimate.joint_names[joint])
    parts.append(f'{name} <tspan font-weight="400" fill="{_SOFT}">{unit}</tspan></text>')
    for tick in round_ticks(low, high):
        y = height(tick)
        parts.append(f'<path d="M{start:g} {y:.1f}H{start + inner:g}" stroke="{_LINE}"/>')
        parts.append(
            f'<text x="{start - 6:g}" y="{y + 4:.1f}" font-size="12" text-anchor="end" fill="{_SOFT}">{tick:g}</text>'
        )
    x = start + (t - t[0]) / span * inner
    for kind, _, color, thickness in _CURVES:
        path = line_path(x, np.asarray(height(curves[kind])))
        parts.append(
            f'<path d="{path}" fill="none" stroke="{color}" stroke-width="{thickness:g}" stroke-linejoin="round"/>'
        )
    return "".join(parts)


def line_path(x: Array, y: Array) -> str:
    """Line through the points, broken where a value is missing."""
    words, pen = [], "M"
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if math.isfinite(a) and math.isfinite(b):
            words.append(f"{pen}{a:.1f} {b:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(words)


def round_ticks(low: float, high: float) -> list[float]:
    """Return two to five round numbers between two values."""
    raw = (high - low) / 4.0
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw)
    return [round(index * step, 12) for index in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _legend(prediction: Prediction) -> str:
    parts, left = [], float(MARGIN + 36)
    for _, label, color, thickness in _CURVES:
        parts.append(f'<path d="M{left:g} 389h26" stroke="{color}" stroke-width="{thickness:g}"/>')
        parts.append(f'<text x="{left + 34:g}" y="394" font-size="14" fill="{_TEXT}">{label}</text>')
        left += 34 + 7 * len(label) + 24
    seconds = prediction.trace.t[-1] - prediction.trace.t[0]
    note = (
        "a log that was not used in the regression" if prediction.role == "validation" else "the log of the regression"
    )
    place = f'x="{WIDTH - MARGIN}" y="394" font-size="14" text-anchor="end" fill="{_SOFT}"'
    parts.append(f"<text {place}>{seconds:.0f} s of {note}</text>")
    return "".join(parts)
