"""Section 6.1: the share of configurations with a positive definite inertia matrix."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from steelyard.identification.wam import wam_model
from steelyard.report import Chart, Curve

from ..published import column
from ..section import Context, Section, SectionResult, Table

__all__ = ["SECTION", "definite_share"]

CONFIGURATIONS = 10_000


def definite_share(base: np.ndarray, q: np.ndarray) -> float:
    """Return the share of configurations (S, N) whose inertia matrix of links and rotors is positive definite."""
    kernel = wam_model().kernel("total_inertia_matrix", base=True)
    matrices = kernel(q, base).reshape(len(q), 7, 7)
    return float(np.mean(np.linalg.eigvalsh(matrices)[:, 0] > 0.0))


def _compute(context: Context) -> SectionResult:
    infeasible, feasible = column("4.9", "WLS"), column("4.9", "WLS_feasible")
    q = np.random.default_rng(61).uniform(-np.pi, np.pi, (CONFIGURATIONS, 7))
    weights = np.linspace(0.0, 1.0, 41)
    shares = [definite_share((1.0 - w) * infeasible + w * feasible, q) for w in weights]
    monotonic = all(b >= a for a, b in pairwise(shares))
    first = next(float(w) for w, share in zip(weights, shares, strict=True) if share == 1.0)
    table = Table(
        "What the curve says",
        ("", "value"),
        (
            ("share at WLS", shares[0]),
            ("share at the feasible solution", shares[-1]),
            ("least λ with all configurations positive definite", first),
            ("rises everywhere", "yes" if monotonic else "no"),
        ),
    )
    chart = Chart(
        "Figure 6.1: share of positive definite inertia matrices",
        "λ, from WLS (0) to the feasible solution (1)",
        "share",
        (Curve(f"{CONFIGURATIONS} random configurations", weights, shares),),
    )
    remark = (
        "The thesis prints the curve only as a figure. Estimates near the feasible set look right at almost all "
        "configurations, and are not: only a verdict with a proof tells."
    )
    return SectionResult(tables=(table,), charts=(chart,), remarks=(remark,))


SECTION = Section("6.1", "Feasible and infeasible solutions (figure 6.1)", _compute)
