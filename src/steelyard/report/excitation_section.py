"""The section on excitation: singular values, combinations that the motion hides, and a motion that shows them."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from steelyard.display import combination
from steelyard.identification import Identification
from steelyard.identification.next_steps import excite_command
from steelyard.regression import ParameterCovariance

from .html_document import Markup, escape, table

__all__ = ["excitation", "weak_combinations"]

Array = NDArray[np.float64]
_MOST = 5  # weak combinations in the table
_WEAK = 0.2
"""Relative standard error from which a combination is called weak; its interval then has a half-width of 0.4."""
_MOTIONS = (
    (r"L[xyz][xyz]", "accelerate {joint} harder, in other configurations of the joints behind it"),
    (r"l[xyz]|m", "bring {joint} through a wider range, so that gravity acts on it from more directions"),
    (r"Fv", "move {joint} both slowly and near its greatest speed"),
    (r"Fc", "move {joint} at slow constant speeds in both directions, with many reversals"),
    (r"I", "accelerate {joint} harder while the joints beside it rest"),
    (r"Fo", "hold {joint} in different configurations and move it in both directions"),
)


def weak_combinations(identification: Identification) -> list[tuple[Array, float]]:
    """Return the combinations of base parameters that the data tells worst, with their relative standard errors.

    They are the eigenvectors of the covariance of the base parameters, each measured in its own size (that of the
    answer, or a hundredth of the largest of its kind where it is smaller), so that kilograms and newton metres can be
    compared.

    Returns
    -------
    list of ((n_b,), float)
        Weights, of which the largest is 1 in units of the sizes; infinite where the data does not tell the combination.
    """
    covariance, scale = ParameterCovariance.of(identification.information), _sizes(identification)
    found = []
    for direction in covariance.unidentifiable.T:
        found.append((direction / np.linalg.norm(direction), np.inf))
    if not found:
        values, vectors = np.linalg.eigh(covariance.matrix / np.outer(scale, scale))
        for place in np.argsort(values)[::-1]:
            found.append((vectors[:, place], float(np.sqrt(max(values[place], 0.0)))))
    return [(weights / weights[np.abs(weights).argmax()], error) for weights, error in found[:_MOST]]


def _sizes(identification: Identification) -> Array:
    base = np.abs(identification.estimate.base)
    kinds = [re.sub(r"\d+R?$", "", name)[:2] for name in identification.estimate.base_names]
    largest = {kind: max(size for one, size in zip(kinds, base, strict=True) if one == kind) for kind in set(kinds)}
    return np.array([max(size, 0.01 * largest[kind], 1e-12) for kind, size in zip(kinds, base, strict=True)])


def excitation(identification: Identification) -> Markup:
    """Return singular values, weak combinations in names and words, and the command of a motion that shows them."""
    information, names = identification.information, list(identification.estimate.base_expressions)
    values = np.asarray(np.linalg.svd(information.reduced(None).R, compute_uv=False), dtype=np.float64)
    condition = information.condition_number
    said = f"{condition:.4g}" if np.isfinite(condition) else "∞"
    first = (
        f"<p>The motion shows {len(values)} combinations of parameters. The singular values of the regressor say how "
        f"strongly: the strongest is {values[0]:.3g}, the weakest {values[-1]:.3g}, and their quotient, the condition "
        f"number, is {said}.</p>"
    )
    found = [(weights, error) for weights, error in weak_combinations(identification) if error > _WEAK]
    scale = _sizes(identification)
    if not found:
        weak = "<p>No combination of the base parameters is weak: each is known to a fifth of its size or better.</p>"
        return Markup(first + _bars(values) + weak)
    rows = []
    for weights, error in found:
        order = [k for k in np.argsort(-np.abs(weights)) if abs(weights[k]) > 0.15]
        unit = scale if np.isfinite(error) else np.ones(len(scale))  # what is unknown has no size
        parts = [weights[k] / unit[k] * unit[order[0]] for k in order]
        text = combination(parts, [names[k] for k in order], most=3)
        told = f"± {100 * error:.3g} %" if np.isfinite(error) else "not at all"
        motion = _motion(identification, names[order[0]])
        rows.append((Markup(f"<code>{escape(text)}</code>"), told, motion))
    command = excite_command(identification)
    heads = ("Combination", "Known to", "What would show it")
    return Markup(
        first
        + _bars(values)
        + "<p>These combinations are the weakest, in units of the size of each parameter. A base parameter can look "
        "well known by itself and still be mixed with its neighbours in one of them.</p>"
        + table("What the motion hardly shows", heads, rows, identifier="weak-combinations", texts=[2])
        + "<p>A motion that shows them as well as the limits of the robot allow is designed by</p>"
        f"<pre><code>{escape(command)}</code></pre>"
    )


def _motion(identification: Identification, expression: str) -> str:
    """Return what the joint of a base parameter has to do so that it shows."""
    model = identification.model
    match = re.match(r"(?:[\d.]+\s*\*?\s*)?\(?([A-Za-z]+?)(\d+)", expression)
    names = identification.estimate.joint_names
    if match is None:
        return "a motion with more speed, acceleration and range"
    symbol, number = match[1], int(match[2])
    joint = model.robot.driving_joints.index(number - 1) if number - 1 in model.robot.driving_joints else None
    name = names[joint] if joint is not None and joint < len(names) else f"joint {number}"
    samples = identification.predictions[0].samples if identification.predictions else None
    for pattern, words in _MOTIONS:
        if re.match(pattern, symbol):
            text = words.format(joint=name)
            if samples is not None and joint is not None and samples.count:
                unit = ("rad/s", "rad/s²") if model.robot.joints[number - 1].rotates else ("m/s", "m/s²")
                speed, push = (float(np.abs(one[:, joint]).max()) for one in (samples.dq, samples.ddq))
                text += f" (so far at most {speed:.2g} {unit[0]} and {push:.2g} {unit[1]})"
            return text
    return f"move {name} with more speed, acceleration and range"


def _bars(values: Array) -> str:
    """The singular values as bars on a logarithmic scale; the numbers stand in the text of the picture."""
    width, height = 6.0, 90.0
    positive = values[values > 0.0]
    low, high = np.log10(positive.min()) - 0.3, np.log10(positive.max())
    span = max(high - low, 1e-9)
    sizes = [height * max((np.log10(v) - low) / span, 0.0) if v > 0.0 else 0.0 for v in values]
    bars = "".join(
        f'<rect x="{k * (width + 2):.0f}" y="{height - size:.1f}" width="{width:.0f}" height="{max(size, 1):.1f}"/>'
        for k, size in enumerate(sizes)
    )
    whole = len(values) * (width + 2)
    told = ", ".join(f"{v:.3g}" for v in values)
    return (
        '<figure class="singular"><figcaption>Singular values of the base regressor, logarithmic</figcaption>'
        f'<svg viewBox="0 0 {whole:.0f} {height:.0f}" role="img" aria-label="Singular values: {told}" '
        f'style="width:min(100%,{1.4 * whole:.0f}px)">{bars}</svg></figure>'
    )
