"""Section 4.3.2: the excitation trajectories and their condition numbers."""

from __future__ import annotations

import numpy as np

from steelyard.identification.wam import TRAJECTORIES, wam_model
from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.report import Chart, Curve

from ..comparison import Comparison
from ..section import Context, Section, SectionResult, Table

__all__ = ["SECTION"]

# Of the recorded motion (section 4.3.3); the tables hold the references, to two decimals.
_RECORDED = {"A": 105.0, "B": 111.0}


def _compute(context: Context) -> SectionResult:
    model = wam_model()
    comparisons, charts = [], []
    bounds = []
    for name, trajectory in TRAJECTORIES.items():
        t, q, dq, ddq = trajectory.sample(1000.0)
        samples = Samples(q=q, dq=dq, ddq=ddq, torque=np.ones_like(q))
        condition = Information.from_samples(model, samples).condition_number
        comparisons.append(
            Comparison(
                f"condition number of trajectory {name}",
                _RECORDED[name],
                condition,
                0.5,
                "published for the recorded motion; ours is of the reference, whose coefficients are printed to 0.01",
            )
        )
        curves = tuple(Curve(f"joint {k + 1}", t[::10], q[::10, k]) for k in range(7))
        figure = {"A": "4.4", "B": "4.5"}[name]
        charts.append(Chart(f"Figure {figure}: references of trajectory {name}", "time, s", "rad", curves))
        bounds.append((q.min(axis=0), q.max(axis=0), np.abs(dq).max(axis=0), np.abs(ddq).max(axis=0)))
    low, high = np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)
    fast, strong = np.max([b[2] for b in bounds], axis=0), np.max([b[3] for b in bounds], axis=0)
    table = Table(
        "What the two trajectories reach together",
        ("joint", "least q, rad", "greatest q, rad", "greatest |dq|, rad/s", "greatest |ddq|, rad/s²"),
        tuple((f"{k + 1}", float(low[k]), float(high[k]), float(fast[k]), float(strong[k])) for k in range(7)),
    )
    return SectionResult(tuple(comparisons), (table,), tuple(charts))


SECTION = Section("4.3.2", "Excitation trajectories (tables 4.4 and 4.5)", _compute)
