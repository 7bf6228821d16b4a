"""Section 5.1: free fall with the columns of table 4.9, figures 5.1 to 5.4."""

from __future__ import annotations

import numpy as np

from steelyard.identification.wam import wam_model
from steelyard.report import Chart, Curve
from steelyard.simulation import SimulationResult, Status, simulate

from ..comparison import Comparison
from ..published import column
from ..section import Context, Section, SectionResult, Table

__all__ = ["SECTION"]

_NAMES = {
    "WLS": "weighted least squares",
    "WLS_corrected": "corrected (nearest feasible)",
    "WLS_feasible": "feasible fit",
    "WLS_feasible_extra": "feasible fit, centres of mass in boxes",
}
_DURATION, _STOPPED = 6.0, 0.041  # s
_RISE = 1e-6  # of the span of the energy, which integration may add


def _compute(context: Context) -> SectionResult:
    model, still = wam_model(), np.zeros(7)
    results: dict[str, SimulationResult] = {}
    for name, words in _NAMES.items():
        context.say(words)
        rate = 20_000.0 if name == "WLS" else 1000.0
        results[name] = simulate(model, column("4.9", name), still, still, _DURATION, base=True, rate=rate)
    first = results["WLS"]
    comparisons = [
        Comparison(
            "WLS: how the simulation ends", "diverges", "diverges" if first.status is Status.DIVERGED else "runs"
        ),
        Comparison(
            "WLS: simulated time at which integration stops, s",
            _STOPPED,
            float(first.end_time),
            5e-4,
            "where integration gives up depends on the sigmoid that stands for the sign, which is not published",
        ),
    ]
    rows: list[tuple[str | float, ...]] = []
    for name, result in results.items():
        rise = max(0.0, float(np.diff(result.energy).max())) / float(np.ptp(result.energy))
        rows.append(
            (_NAMES[name], str(result.status), float(result.end_time), rise, float(np.abs(result.dq[-1]).max()))
        )
        if name != "WLS":
            passive = result.status is Status.FINISHED and rise <= _RISE
            comparisons.append(
                Comparison(
                    f"{name}: 6 s of free fall", "runs, energy falls", "runs, energy falls" if passive else "fails"
                )
            )
    heads = ("parameters", "status", "until, s", "largest rise of the energy, of its span", "last speed, rad/s")
    energies = tuple(Curve(_NAMES[name], r.t, r.energy) for name, r in results.items() if name != "WLS")
    charts = (
        _joints(first, "Figure 5.1: positions, weighted least squares"),
        Chart("Figure 5.2: energy, weighted least squares", "time, s", "J", (Curve("total", first.t, first.energy),)),
        _joints(results["WLS_feasible_extra"], "Figure 5.3: positions, feasible fit, centres of mass in boxes"),
        Chart("Figure 5.4: energy, the three feasible columns", "time, s", "J", energies),
    )
    return SectionResult(tuple(comparisons), (Table("Free fall", heads, tuple(rows)),), charts)


def _joints(result: SimulationResult, title: str) -> Chart:
    curves = tuple(Curve(f"joint {k + 1}", result.t, result.q[:, k]) for k in range(7))
    return Chart(title, "time, s", "position, rad", curves)


SECTION = Section("5.1", "Simulation with infeasible and feasible parameters (figures 5.1 to 5.4)", _compute)
