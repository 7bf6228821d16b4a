"""Section 4.5: which published estimates are feasible, and the correction of the one that is not."""

from __future__ import annotations

import numpy as np

from steelyard.dynamics import Model
from steelyard.feasibility import CenterOfMassBox, FeasibleSet, TotalMass, check, correct
from steelyard.identification.wam import wam_model

from ..comparison import Comparison, printed_precision
from ..published import column, rows
from ..section import Context, Section, SectionResult, Table

__all__ = ["SECTION", "boxes"]

COLUMNS = ("WLS", "WLS_corrected", "WLS_feasible", "WLS_feasible_extra")
# 76 values rounded to 1e-4: what rounding alone may add to a squared distance.
_ROUNDING = 76 * 5e-5**2


def boxes() -> list[CenterOfMassBox]:
    """Return the boxes of table 4.8, with the links of `wam_model`."""
    return [
        CenterOfMassBox(
            f"link{row['link']}",
            [float(row[f"{axis}_min_m"]) for axis in "xyz"],
            [float(row[f"{axis}_max_m"]) for axis in "xyz"],
        )
        for row in rows("4.8")
    ]


def _compute(context: Context) -> SectionResult:
    model = wam_model()
    thesis = FeasibleSet(model, "inertia", margin=1e-6)
    wls = column("4.9", "WLS")
    verdict = check(FeasibleSet(model, "inertia"), base=wls)
    comparisons = [Comparison("WLS (section 4.5.1)", "infeasible", verdict.status)]
    correction = correct(thesis, base=wls)
    comparisons.append(
        Comparison(
            "squared distance of WLS to the feasible set, u' (section 4.5.2)", 0.0077, correction.squared_distance, 5e-5
        )
    )
    names = model.base_parameters().names
    printed = [row["WLS_corrected"] for row in rows("4.9")]
    for number, (name, text, ours) in enumerate(zip(names, printed, correction.base, strict=True), start=1):
        comparisons.append(
            Comparison(
                f"corrected base parameter {number} ({name})",
                float(text),
                float(ours),
                printed_precision(text),
                "the published column starts from more digits of WLS than are printed; its solver stopped at 1e-6",
            )
        )
    comparisons += _published_columns(model)
    full = FeasibleSet(model, "full")
    table = Table(
        'With the triangle inequality of inertias as well ("full")',
        ("estimate", "verdict", "squared distance to the feasible set"),
        tuple(_with_full(full, name) for name in COLUMNS),
    )
    remark = (
        "Every verdict has a certificate that was verified in exact rational arithmetic. The thesis asks that inertias "
        "are positive definite; its feasible columns do not meet the triangle inequality, part of full consistency."
    )
    return SectionResult(tuple(comparisons), (table,), remarks=(remark,))


def _published_columns(model: Model) -> list[Comparison]:
    """Compare the published feasible columns with the set; they lie in it, up to their four decimals."""
    plain = FeasibleSet(model, "inertia")
    extra = FeasibleSet(model, "inertia", [TotalMass(maximum=27.0), *boxes()])
    result = []
    for name, feasible_set in (("WLS_corrected", plain), ("WLS_feasible", plain), ("WLS_feasible_extra", extra)):
        squared = correct(feasible_set, base=column("4.9", name)).squared_distance
        inside = "feasible" if squared <= _ROUNDING else f"outside by {np.sqrt(squared):.2g}"
        result.append(Comparison(f"{name} of table 4.9, within rounding", "feasible", inside))
    status = check(extra, base=column("4.9", "WLS_feasible")).status
    result.append(Comparison("WLS_feasible with the extra constraints of table 4.8", "infeasible", status))
    return result


def _with_full(feasible_set: FeasibleSet, name: str) -> tuple[str | float, ...]:
    base = column("4.9", name)
    verdict = check(feasible_set, base=base)
    assert verdict.certificate is None or verdict.certificate.verify()
    return name, verdict.status, correct(feasible_set, base=base).squared_distance


SECTION = Section("4.5", "Feasibility and correction of the estimates (table 4.9)", _compute)
