"""A published value beside ours."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

__all__ = ["Comparison", "printed_precision"]


@dataclass(frozen=True)
class Comparison:
    """One published value beside ours.

    Attributes
    ----------
    what : str
        What it is, in a few words, with its unit.
    published : float or str
        As printed in the thesis.
    ours : float or str
    tolerance : float
        Half of the last printed digit, or what else numbers may differ by; 0 for texts.
    why : str
        Where they differ: why, or what differs in the conditions.

    Examples
    --------
    >>> Comparison("condition number of A", 107.94, 107.938, 0.005).agrees
    True
    >>> Comparison("verdict", "feasible", "infeasible").agrees
    False
    """

    what: str
    published: float | str
    ours: float | str
    tolerance: float = 0.0
    why: str = ""

    @property
    def agrees(self) -> bool:
        """Whether ours is the published value within the tolerance."""
        if isinstance(self.published, str) or isinstance(self.ours, str):
            return self.published == self.ours
        slack = 1e-9 * max(1.0, abs(self.published))  # of decimals in binary
        return math.isfinite(self.ours) and abs(self.ours - self.published) <= self.tolerance + slack

    @property
    def difference(self) -> float:
        """Ours less the published value; NaN for texts."""
        if isinstance(self.published, str) or isinstance(self.ours, str):
            return math.nan
        return self.ours - self.published

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data, for JSON."""
        return {
            "what": self.what,
            "published": self.published,
            "ours": self.ours,
            "tolerance": self.tolerance,
            "agrees": self.agrees,
            "why": self.why,
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Comparison:
        """Build a comparison from what `to_dict` returned."""
        return cls(*(content[name] for name in ("what", "published", "ours", "tolerance", "why")))


def printed_precision(text: str) -> float:
    """Return half a unit of the last digit of a printed number.

    Examples
    --------
    >>> printed_precision("4.57"), printed_precision("-0.0004"), printed_precision("105"), printed_precision("1.65e-3")
    (0.005, 5e-05, 0.5, 5e-06)
    """
    mantissa, _, exponent = text.strip().lower().partition("e")
    digits = len(mantissa.partition(".")[2])
    return float(f"0.5e{int(exponent or 0) - digits}")
