"""Section 4.2: the base parameters of the WAM."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from steelyard.identification.wam import wam_model

from ..comparison import Comparison
from ..published import rows
from ..section import Context, Section, SectionResult

__all__ = ["SECTION"]

# Coefficients are printed with eight decimals.
_PRINTED = 5e-9


def _combination(text: str) -> dict[str, float]:
    found = re.findall(r"([+-])([\d.e-]+)\*(\w+)", text)
    return {name: float(size) * (-1.0 if sign == "-" else 1.0) for sign, size, name in found}


def _text(combination: Mapping[str, float]) -> str:
    return " ".join(f"{value:+.8g}*{name}" for name, value in combination.items())


def _compute(context: Context) -> SectionResult:
    model = wam_model()
    base, names = model.base_parameters(), model.parameter_names
    published = [_combination(row["combination"]) for row in rows("4.2")]
    comparisons = [
        Comparison("number of standard parameters (section 4.2)", 119.0, float(model.parameter_count)),
        Comparison("number of base parameters", 76.0, float(base.count)),
    ]
    for number, (row, expected) in enumerate(zip(base.K, published, strict=True), start=1):
        ours = {names[k]: float(row[k]) for k in np.flatnonzero(row)}
        same = set(ours) == set(expected) and all(abs(ours[key] - value) <= _PRINTED for key, value in expected.items())
        comparisons.append(
            Comparison(f"base parameter {number}", _text(expected), _text(expected) if same else _text(ours))
        )
    remark = (
        f"The model of table 4.1 and equations 4.5 to 4.15. The rank is read at a gap of {base.gap:.1e} between the "
        "last column that counts and the first that does not."
    )
    return SectionResult(tuple(comparisons), remarks=(remark,))


SECTION = Section("4.2", "Base parameters of the WAM (table 4.2)", _compute)
