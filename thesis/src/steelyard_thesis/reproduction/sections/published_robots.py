"""Published results of the real robots of the data folder, beside ours."""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Coulomb, Model, Offset, RotorInertia, Viscous
from steelyard.feasibility import FeasibleSet, check, correct
from steelyard.regression import Information, least_squares
from steelyard.robot import Robot

from ..comparison import Comparison, printed_precision
from ..recordings import staubli_tx40
from ..section import Context

__all__ = ["combination", "tx40_comparisons", "wam_2014_comparisons"]

_TX40 = (
    "tolerance: one published standard deviation; the same log, but how its publishers filtered and differentiated it "
    "is not known in detail"
)


def combination(expression: str) -> frozenset[tuple[str, float]]:
    """Return the sum of standard parameters that an expression is, without regard to their order.

    Notation is brought to ours: ``Izz1`` and ``L_1zz`` are ``Lzz1``, ``mx1`` and ``l_1x`` are ``lx1``.

    Examples
    --------
    >>> combination("Izz1 + 1.0*Ia1 - 0.07*mz3") == combination("Lzz1 - 0.07*lz3 + Ia1")
    True
    """
    found: Counter[str] = Counter()
    for sign, factor, name in re.findall(r"([+-]?)\s*(?:([\d.e-]+)\*)?([A-Za-z_]\w*)", expression):
        value = float(factor or 1.0) * (-1.0 if sign == "-" else 1.0)
        found[_ours(name)] += value  # type: ignore[assignment]
    return frozenset((name, round(value, 9)) for name, value in found.items())


def _ours(name: str) -> str:
    for pattern, text in (
        (r"I([xyz]{2})(\d)", r"L\1\2"),
        (r"m([xyz])(\d)", r"l\1\2"),
        (r"([Ll])_(\d)([xyz]+)", r"\1\3\2"),
        (r"Iam(\d)", r"Ia\1"),
        (r"m_(\d)", r"m\1"),
        (r"Ia_(\d)", r"Ia\1"),
        (r"f([vco])_(\d)", r"F\1j\2"),
    ):
        if re.fullmatch(pattern, name):
            return re.sub(pattern, text, name)
    return name


def tx40_comparisons(context: Context) -> Iterator[Comparison]:
    """Compare the base parameters and the friction of the Stäubli TX40 with those that its publishers found."""
    data = cast("Path", context.data)
    published = _table(data / "staubli_tx40" / "published_base_parameters.csv")
    model, samples = staubli_tx40(data)
    base = model.base_parameters()
    yield Comparison("Stäubli TX40: number of base parameters", len(published), base.count)
    theirs = {combination(row["expression"]) for row in published if re.match(r"[Im]", row["expression"])}
    same = len(theirs & {combination(name) for name in base.expressions})
    # Rotor inertias 5 and 6 are coupled in the wrist; the publishers call the second one Iam6.
    yield Comparison("Stäubli TX40: base parameters of links and rotors that are the same sums", len(theirs), same)
    information = Information.from_samples(model, samples, batch_means=False)
    for kind, weights in (("ols", None), ("wls", "joint")):
        estimate = least_squares(information, weights=weights)
        values = dict(zip(estimate.base_expressions, estimate.base, strict=True))
        for row in published:
            name = row["expression"]
            ours = _tx40_friction(values, name)
            if ours is None:
                continue
            value = float(row[kind])
            tolerance = abs(value) * float(row[f"{kind}_std_pct"]) / 100.0
            yield Comparison(f"Stäubli TX40, {kind.upper()}: {name}", value, ours, tolerance, _TX40)


def _tx40_friction(values: dict[str, float], name: str) -> float | None:
    """Return friction as the publishers define it: that of motor 6 acts on joint 5 too where it is viscous."""
    match = re.fullmatch(r"f([vs])(m?)(\d)", name)
    if match is None or (match[3] == "6" and not match[2]):
        return None
    letter = {"v": "v", "s": "c"}[match[1]]
    if match[2]:
        return float(values[f"F{letter}m6"])
    joint = float(values[f"F{letter}j{match[3]} + F{letter}m{match[3]}"])
    return joint + float(values["Fvm6"]) if name == "fv5" else joint


def wam_2014_comparisons(context: Context) -> Iterator[Comparison]:
    """Compare with what Sousa and Cortesão published of the WAM (IJRR 2014), as far as their numbers are there."""
    folder = cast("Path", context.data) / "wam7"
    rows = json.loads((folder / "dh.json").read_text(encoding="utf-8"))["rows"]
    robot = Robot.from_dh(rows, name="wam").with_terms(RotorInertia(), Viscous(), Coulomb(), Offset())
    model = Model(robot)
    base = model.base_parameters()
    published = _table(folder / "base_parameters_ijrr2014.csv")
    yield Comparison("WAM 2014: number of base parameters", len(published), base.count)
    order = _order(base.expressions, (row["expression"] for row in published))
    yield Comparison("WAM 2014: base parameters that are the same sums", len(published), int(np.sum(order >= 0)))
    if np.any(order < 0):
        return
    content = json.loads((folder / "delta_star_e_ijrr2014.json").read_text(encoding="utf-8"))["delta"]
    standard = np.array([content[_theirs(name)] for name in model.parameter_names])
    ours = base.values(standard)
    for row, index in zip(published, order, strict=True):
        text = row["beta_star_e"]
        yield Comparison(
            f"WAM 2014, base parameters of β*e from its standard parameters: {base.names[index]}",
            float(text),
            float(ours[index]),
            printed_precision(text),
        )
    plain = np.empty(base.count)
    plain[order] = [float(row["beta_ols"]) for row in published]
    yield Comparison("WAM 2014: OLS", "infeasible", check(FeasibleSet(model, "inertia"), base=plain).status)
    found = correct(FeasibleSet(model, "inertia", margin=1e-6), base=plain)
    rounding = sum(printed_precision(row["beta_ols"]) ** 2 for row in published)
    yield Comparison(
        "WAM 2014: squared distance of OLS to the feasible set",
        0.004053727498753654,
        found.squared_distance,
        # To first order, for errors of the printed values that all point away from the set.
        float(2.0 * np.sqrt(found.squared_distance * rounding) + rounding),
        "within what the four printed digits of OLS leave open",
    )
    q = np.random.default_rng(2014).uniform(0.0, 1.0, (10_000, 7))
    matrices = model.kernel("total_inertia_matrix", base=True)
    for name, beta, count in (("OLS", plain, 4416), ("β*e", ours, 10_000)):
        definite = np.linalg.eigvalsh(matrices(q, beta).reshape(-1, 7, 7))[:, 0] > 0.0
        yield Comparison(
            f"WAM 2014: configurations of 10000 with a positive definite inertia matrix, {name}",
            count,
            int(np.sum(definite)),
            # Three standard deviations of the difference of two random draws.
            float(3.0 * np.sqrt(2.0 * count * (1.0 - count / 10_000))),
            "configurations are random in [0, 1) rad, and those of the paper are not published",
        )


def _theirs(name: str) -> str:
    match = re.fullmatch(r"([Ll])([xyz]+)(\d)|m(\d)|Ia(\d)|F([vco])j(\d)", name)
    assert match is not None, name
    if match[1]:
        return f"{match[1]}_{match[3]}{match[2]}"
    if match[4]:
        return f"m_{match[4]}"
    return f"Ia_{match[5]}" if match[5] else f"f{match[6]}_{match[7]}"


def _order(ours: Iterable[str], theirs: Iterable[str]) -> NDArray[np.intp]:
    """Return for each of their expressions the index of ours, -1 where there is none."""
    places = {combination(name): k for k, name in enumerate(ours)}
    return np.array([places.get(combination(name), -1) for name in theirs], dtype=np.intp)


def _table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))
