"""Sections 4.4 to 4.6: classical and feasible identification, on the simulated arm."""

from __future__ import annotations

import numpy as np

from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet, TotalMass, check, correct
from steelyard.identification.wam import simulated_log, true_parameters, wam_model
from steelyard.regression import Information, ParameterCovariance, least_squares

from ..published import rows
from ..section import Context, Section, SectionResult, Table
from .correction import boxes

__all__ = ["SECTION", "SEED"]

SEED = 44  # of the simulated noise; any other gives similar numbers
_REMARK = (
    "The recordings of the thesis are not published. Here the arm is simulated on trajectories A and B, with CAD "
    "parameters and friction of the order of table 4.9 as the truth, and with errors of the torques of the order of "
    "tables 4.6 and 4.7. These numbers stand beside the published ones for comparison; they do not count as values "
    "that agree or not."
)
_NAMES = {
    "WLS": "WLS",
    "corrected": "WLS_corrected",
    "feasible": "WLS_feasible",
    "feasible, extra constraints": "WLS_feasible_extra",
    "feasible, full": "",
}


def _compute(context: Context) -> SectionResult:
    model = wam_model()
    context.say("simulated recordings")
    logs = {
        name: simulated_log(model, name, SEED).process(cutoff=4.8, order=3, trim=0.5, velocity_threshold=None)
        for name in ("A", "B")
    }
    information = {name: Information.from_samples(model, samples) for name, samples in logs.items()}
    data = information["A"]
    ols, wls = least_squares(data, weights=None), least_squares(data)
    independent = ParameterCovariance.of_reduced(data.reduced(None)).standard_error  # as the thesis takes the rows
    inertia, extra = FeasibleSet(model, "inertia"), FeasibleSet(model, "inertia", [TotalMass(maximum=27.0), *boxes()])
    context.say("feasible estimates")
    bases = {
        "WLS": wls.base,
        "corrected": correct(inertia, base=wls.base).base,
        "feasible": fit(data, inertia).base,
        "feasible, extra constraints": fit(data, extra).base,
        "feasible, full": fit(data, FeasibleSet(model, "full")).base,
    }
    truth = model.base_parameters().K @ true_parameters()
    names = model.base_parameters().names
    estimates = Table(
        "Base parameters as in tables 4.6 and 4.9: the truth and what is identified from A",
        ("base parameter", "truth", "OLS", "σ, %", *bases),
        tuple(
            (
                name,
                float(truth[k]),
                float(ols.base[k]),
                float(100.0 * independent[k] / abs(ols.base[k])),
                *(float(base[k]) for base in bases.values()),
            )
            for k, name in enumerate(names)
        ),
    )
    joints = Table(
        "Relative error of the torques per joint, per cent, as in table 4.7",
        ("joint", "OLS", "published", "WLS", "published"),
        tuple(
            (row["joint"], 100.0 * float(a), float(row["OLS_percent"]), 100.0 * float(b), float(row["WLS_percent"]))
            for row, a, b in zip(
                rows("4.7"), data.joint_relative_error(ols.base), data.joint_relative_error(wls.base), strict=True
            )
        ),
    )
    published = {row["data"]: row for row in rows("4.10")}
    errors = Table(
        "Relative error of the torques, per cent, as in table 4.10",
        ("estimate", "A", "published", "B, held out", "published", "verdict (full)", "distance to the truth"),
        tuple(
            (
                name,
                100.0 * information["A"].relative_error(base),
                float(published["A"][_NAMES[name]]) if _NAMES[name] else "",
                100.0 * information["B"].relative_error(base),
                float(published["B"][_NAMES[name]]) if _NAMES[name] else "",
                check(FeasibleSet(model, "full"), base=base).status,
                float(np.linalg.norm(base - truth)),
            )
            for name, base in bases.items()
        ),
    )
    return SectionResult(tables=(errors, joints, estimates), remarks=(_REMARK,))


SECTION = Section("4.4", "Identification of the simulated arm (tables 4.6, 4.7, 4.9 to 4.11)", _compute)
