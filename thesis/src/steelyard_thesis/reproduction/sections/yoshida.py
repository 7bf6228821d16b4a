"""Section 6.2: the robot of three links of Yoshida and Khalil (table 6.1)."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from steelyard.feasibility import FeasibleSet, InfeasibilityCertificate, TotalMass, Verdict, check, correct
from steelyard.report import Chart, Curve
from steelyard_thesis.methods import Yoshida2000
from steelyard_thesis.tabulated_model import TabulatedModel

from ..comparison import Comparison, printed_precision
from ..published import column, rows
from ..section import Context, Section, SectionResult, Table

__all__ = ["SECTION", "yoshida_model"]

Vector = NDArray[np.float64]

_DISTANCE = "1.65e-3"
_DECIMALS = 5e-7  # the corrected column has six decimals in every row
# Margin of the set for the correction: what the thesis's own solver kept from the boundary is not known.
_MARGIN = 1e-8
# How far from the estimate towards the nearest feasible point a proof of infeasibility is asked for.
_NEARLY = 0.998
_MASSES = (20.0, 30.0, 40.0, 54.5, 75.0, 100.0, 200.0, 500.0, 1000.0)
_POINTS = {"β_t1": "beta_t1", "β_t2": "beta_t2", "β'_t2 as printed": "beta_t2_corrected"}
# Changes of the printed digits that stay within their rounding.
_WITHIN_ROUNDING = 4e-7


def yoshida_model() -> TabulatedModel:
    """Return the robot, of which nothing but the combinations of table 6.1 is known.

    Examples
    --------
    >>> yoshida_model()
    TabulatedModel(Yoshida: 3 links, 15 base parameters)
    >>> yoshida_model().base_parameters().expressions[1]
    'Lxx2 - Lyy2 - m3'
    """
    return TabulatedModel(
        ["link1", "link2", "link3"], [_combination(row["combination"]) for row in rows("6.1")], "Yoshida"
    )


def _combination(text: str) -> dict[str, float]:
    """Read ``"L2xz-l3z"``: the number of the link comes before the axes."""
    terms = re.findall(r"([+-]?)([Llm])(\d)([xyz]*)", text)
    return {f"{symbol}{axes}{link}": -1.0 if sign == "-" else 1.0 for sign, symbol, link, axes in terms}


def _compute(context: Context) -> SectionResult:
    model = yoshida_model()
    feasible_set = FeasibleSet(model, "inertia", margin=_MARGIN)
    context.say("verdicts and the search for virtual parameters")
    verdicts = {name: check(feasible_set, base=column("6.1", key)) for name, key in _POINTS.items()}
    comparisons = [
        Comparison("β_t1 (proved exactly)", "feasible", _proved(verdicts["β_t1"])),
        Comparison("β_t2 (proved exactly)", "infeasible", _proved(verdicts["β_t2"])),
        Comparison("β_t1, by the search for virtual parameters", "feasible", _search("beta_t1")),
        Comparison("β_t2, by the search for virtual parameters", "infeasible", _search("beta_t2")),
    ]
    context.say("the nearest feasible point")
    given = column("6.1", "beta_t2")
    nearest = correct(feasible_set, base=given)
    distance = float(np.sqrt(nearest.squared_distance))
    comparisons.append(
        Comparison("distance of β_t2 to the feasible set", float(_DISTANCE), distance, printed_precision(_DISTANCE))
    )
    printed = verdicts["β'_t2 as printed"]
    alike, heavy = _alike(feasible_set, printed)
    outside = _proved_distance(printed, column("6.1", "beta_t2_corrected"))
    comparisons.append(
        Comparison(
            "corrected β'_t2, within the rounding of its six decimals (proved exactly)",
            "feasible",
            alike,
            why=f"the printed digits themselves are infeasible, outside by {outside:.1e} at least (proved exactly too)",
        )
    )
    mass = float(nearest.parameters[feasible_set.mass_indices].sum())
    why = (
        f"the nearest point is reached by endless masses only: ours stops at {mass:.0f} kg in all, the printed one is "
        "where another solver stopped"
    )
    for row, ours in zip(rows("6.1"), nearest.base, strict=True):
        value = float(row["beta_t2_corrected"])
        differs = abs(value - float(ours)) > _DECIMALS
        comparisons.append(
            Comparison(
                f"corrected base parameter {row['combination']}", value, float(ours), _DECIMALS, why if differs else ""
            )
        )
    weights = _distances(context, model, given)
    evidence = _evidence(feasible_set, given, nearest.base, mass, heavy)
    chart = Chart(
        "Distance of β_t2 to robots of bounded total mass",
        "greatest total mass, kg",
        "distance",
        (
            Curve("nearest robot", [m for m, _ in weights], [d for _, d in weights]),
            Curve("printed: 1.65e-3", [weights[0][0], weights[-1][0]], [float(_DISTANCE)] * 2, "dashed"),
        ),
        x_log=True,
    )
    columns = ("greatest total mass, kg", "distance of β_t2")
    tables = (
        _verdict_table(verdicts),
        evidence,
        Table("What the distance costs in mass", columns, tuple((f"{m:g}", d) for m, d in weights)),
    )
    return SectionResult(tuple(comparisons), tables, (chart,), _remarks(weights))


def _remarks(weights: list[tuple[float, float]]) -> tuple[str, ...]:
    bound, moderate = next((m, d) for m, d in weights if m > 50.0)
    return (
        "Of the robot nothing but the combinations of table 6.1 is known, and that is all that these questions need. "
        "Verdicts are certificates that were verified in rational arithmetic; the conditions are those of the thesis "
        "(positive mass and inertia about the centre of mass).",
        f"The printed distance holds, but only since masses are free: with at most {bound:g} kg in all, the nearest "
        f"robot is {moderate:.3g} away, and what is nearer weighs more and more.",
    )


def _proved(verdict: Verdict) -> str:
    """Return the status, if its certificate is verified."""
    proof = verdict.certificate
    return verdict.status if proof is not None and bool(proof.verify()) else f"{verdict.status}, not proved"


def _search(key: str) -> str:
    return Yoshida2000().check(FeasibleSet(yoshida_model(), "inertia"), column("6.1", key)).status


def _verdict_table(verdicts: dict[str, Verdict]) -> Table:
    feasible_set = FeasibleSet(yoshida_model(), "inertia")
    full = FeasibleSet(yoshida_model(), "full")
    lines: list[tuple[str | float, ...]] = []
    for name, key in _POINTS.items():
        base = column("6.1", key)
        plain, learning = Yoshida2000(learning=False).check(feasible_set, base), Yoshida2000().check(feasible_set, base)
        lines.append(
            (
                name,
                _proved(verdicts[name]),
                verdicts[name].margin,
                f"{plain.status}, {plain.tries} regions",
                f"{learning.status}, {learning.tries} regions",
                _proved(check(full, base=base)),
            )
        )
    columns = (
        "estimate",
        "check",
        "margin",
        "Yoshida and Khalil, trial and error",
        "the same, learning from empty regions",
        "check, triangle inequality too",
    )
    return Table("Verdicts", columns, tuple(lines))


def _proved_distance(verdict: Verdict, base: Vector) -> float:
    """Return what the proof of infeasibility says of the distance to the feasible set; NaN without one.

    A direction y with y'β >= 0 of all feasible β keeps them all at least -y'base / |y| away.
    """
    proof = verdict.certificate
    if not isinstance(proof, InfeasibilityCertificate) or not proof.verify():
        return np.nan
    return float(-proof.direction @ base / np.linalg.norm(proof.direction))


def _alike(feasible_set: FeasibleSet, printed: Verdict) -> tuple[str, float]:
    """Return the status of a point that prints as the corrected one, and the mass of the links that prove it."""
    proof = printed.certificate
    if not isinstance(proof, InfeasibilityCertificate):
        return _proved(printed), np.nan
    verdict = check(feasible_set, base=printed.base + _WITHIN_ROUNDING * np.sign(proof.direction))
    mass = np.nan if verdict.parameters is None else float(verdict.parameters[feasible_set.mass_indices].sum())
    return _proved(verdict), mass


def _evidence(feasible_set: FeasibleSet, given: Vector, nearest: Vector, mass: float, heavy: float) -> Table:
    """Bounds of the distance from both sides, each with its proof."""
    almost = given + _NEARLY * (nearest - given)
    printed = float(np.linalg.norm(column("6.1", "beta_t2_corrected") - given))
    lines = (
        ("nothing feasible is nearer to β_t2 than", _proved_distance(check(feasible_set, base=almost), given)),
        ("a point proved feasible is as near as", float(np.linalg.norm(nearest - given))),
        ("total mass of the links that prove it, kg", mass),
        ("the printed β'_t2 is as near as", printed),
        ("total mass of links that prove that a point which prints alike is feasible, kg", heavy),
    )
    return Table("The distance, bounded from both sides by proofs", ("", "value"), lines)


def _distances(context: Context, model: TabulatedModel, given: Vector) -> list[tuple[float, float]]:
    found = []
    for mass in _MASSES:
        context.say(f"nearest robot of at most {mass:g} kg")
        bounded = FeasibleSet(model, "inertia", [TotalMass(maximum=mass)], margin=_MARGIN)
        found.append((mass, float(np.sqrt(correct(bounded, base=given).squared_distance))))
    return found


SECTION = Section("6.2", "Comparison to Yoshida and Khalil (table 6.1)", _compute)
