"""The section on links that plain least squares makes impossible, in words and numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import SolverError
from steelyard.feasibility import explain_infeasibility
from steelyard.identification import Identification
from steelyard.robot import Inertia

from .html_document import Markup, bullets, escape, table

__all__ = ["defects", "impossible"]

Array = NDArray[np.float64]
_MOST_EXPLAINED = 120  # base parameters; the search for contradictions takes a second for 76, and grows with the cube


def defects(inertial: Array) -> list[str]:
    """Say in words why no body has these ten parameters, with the numbers; empty where one has.

    The parameters ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m`` are about the origin of the link's frame.

    Examples
    --------
    >>> import numpy as np
    >>> defects(np.array([1.0, 0, 0, 1.0, 0, 3.0, 0, 0, 0, 2.0]))
    ['its principal moments about the centre of mass break the triangle inequality: 1 + 1 < 3 kg·m²']
    >>> defects(np.array([1.0, 0, 0, 1.0, 0, 1.0, 0, 0, 0, -2.0]))
    ['its mass is negative, -2 kg']
    >>> defects(np.array([1.0, 0, 0, 1.0, 0, 1.5, 0, 0, 0, 2.0]))
    []
    """
    mass = float(inertial[9])
    if mass < 0.0:
        return [f"its mass is negative, {mass:.3g} kg"]
    if mass == 0.0:
        return ["it has no mass"]
    small, middle, large = np.linalg.eigvalsh(Inertia.from_parameters(inertial).about_com)
    found = []
    if small <= 0.0:
        count = int((np.array([small, middle, large]) <= 0.0).sum())
        what = "a principal moment" if count == 1 else f"{count} principal moments"
        numbers = ", ".join(f"{v:.3g}" for v in (small, middle, large)[:count])
        verb = "is" if count == 1 else "are"
        found.append(f"{what} of inertia about the centre of mass {verb} negative, {numbers} kg·m²")
    elif small + middle < large:
        found.append(
            "its principal moments about the centre of mass break the triangle inequality: "
            f"{small:.3g} + {middle:.3g} < {large:.3g} kg·m²"
        )
    return found


def impossible(identification: Identification) -> Markup:
    """Return the conditions that plain least squares violates, why in words, and by how much."""
    verdict = identification.verdict
    first = escape(verdict.sentences()[0])
    if not verdict.violations:
        return Markup(f"<p>{first} No link and no joint has to be corrected.</p>")
    words = _words(identification)
    rows = [(v.block, words.get(v.block, "–"), f"{v.amount:.3g}", v.unit or "SI") for v in verdict.violations]
    text = (
        f"<p>{first} Many sets of link parameters have these base parameters, and all are impossible. The words are of "
        "the one nearest to the answer; the amount is what would have to be added to the diagonal of the condition's "
        "matrix, with all that the motion does not show chosen as favourably as possible.</p>"
    )
    heads = ("Condition", "What is wrong", "Fails by", "Unit")
    parts = [
        text,
        table("What plain least squares makes impossible", heads, rows, identifier="violations", texts=[1, 3]),
    ]
    reasons = _reasons(identification)
    if reasons:
        parts.append(f"<p>Whatever the motion does not show, these combinations cannot be:</p>{bullets(reasons)}")
    return Markup("".join(parts))


def _words(identification: Identification) -> dict[str, str]:
    """Return what is wrong with each condition, for the parameters nearest to the answer with that base."""
    parameters, feasible_set = identification.estimate.parameters, identification.feasible_set
    if parameters is None:
        return {}
    change = identification.unconstrained.base - feasible_set.K @ parameters
    candidate = parameters + np.linalg.lstsq(feasible_set.K, change)[0]
    names, found = identification.model.parameter_names, {}
    for block in feasible_set.blocks:
        indices = np.asarray(block.indices)
        if block.kind == "link":
            told = defects(candidate[indices[:10]])
            found[block.name] = "; ".join(told) or "possible by itself, but not together with the others"
        elif block.kind == "term" and block.size == 1 and len(indices) == 1:
            value = float(candidate[indices[0]])
            if value < 0.0:
                found[block.name] = f"{names[indices[0]]} is negative, {value:.3g}"
    return found


def _reasons(identification: Identification) -> list[str]:
    """The combinations of base parameters that no robot has, each with the conditions that it breaks."""
    base = identification.unconstrained.base
    if identification.verdict.feasible is not False or len(base) > _MOST_EXPLAINED:
        return []
    try:
        told = explain_infeasibility(identification.feasible_set, base=base).reasons
    except SolverError:
        return []
    return [one[0].upper() + one[1:] for one in told]
