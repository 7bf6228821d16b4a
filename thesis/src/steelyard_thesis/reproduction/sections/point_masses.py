"""Section 6.3.1: the point-mass method of Ayusawa and Nakamura (table 6.2)."""

from __future__ import annotations

from typing import Literal

import numpy as np

from steelyard.dynamics import Model
from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet, check
from steelyard.identification.wam import DH_ROWS, simulated_log, wam_model
from steelyard.regression import Estimate, Information, least_squares
from steelyard.robot import Robot
from steelyard_thesis.methods import Ayusawa2010

from ..published import rows
from ..section import Context, Section, SectionResult, Table
from .correction import boxes
from .identification import SEED
from .real_wam import real_wam

__all__ = ["SECTION", "links_alone"]

_REMARKS = (
    "The recordings of the thesis are not published. As there, only links are modelled, so that friction and "
    "motors are left in the errors, and the conditions are those of links alone. These numbers stand beside the "
    "published ones; they do not count as values that agree or not.",
    "What is minimised is the weighted error, and of that no method pays less than LMI-SDP; the plain error, "
    "which the thesis prints, may then go either way. The regression of the real arm cannot be weighted, since "
    "its joints are not known apart.",
    "Points lie in the boxes of table 4.8, 27 a link, or 125. The thesis also drew the masses to plain least "
    "squares, by weights that it does not tell; here the smallest masses win among those that fit alike.",
)


def links_alone(information: Information, model: Model) -> Information:
    """Return the regression without the columns of drive terms, which then belong to the residual.

    Parameters
    ----------
    information : Information
        Over all joints, as `Information.from_factor` takes it.
    model : Model
        Of the links alone.

    Returns
    -------
    Information
    """
    names = model.base_parameters().names
    kept = [information.base_names.index(name) for name in names]
    whole = information.reduced(None)
    triangle = np.asarray(np.linalg.qr(np.column_stack([whole.R[:, kept], whole.rho]), mode="r"))
    n = len(kept)
    residual2 = whole.residual2 + float(triangle[n, n] ** 2)
    return Information.from_factor(triangle[:n, :n], triangle[:n, n], residual2, information.count, names)


def _compute(context: Context) -> SectionResult:
    model = Model(Robot.from_dh(DH_ROWS, name="wam"))
    context.say("simulated arm")
    log = simulated_log(wam_model(), "A", SEED).process(cutoff=4.8, order=3, trim=0.5, velocity_threshold=None)
    data = {"simulated": Information.from_samples(model, log)}
    if context.data is not None:
        context.say("real arm")
        _, recorded = real_wam(context)
        data["real (2013)"] = links_alone(recorded, model)
    lines: list[tuple[str | float, ...]] = []
    for arm, information in data.items():
        lines += _lines(arm, information, FeasibleSet(model, "inertia"))
    columns = (
        "method",
        "arm",
        "published error, %",
        "error, %",
        "published increase",
        "weighted error, %",
        "its increase, points",
        "verdict",
    )
    table = Table("Relative error of the torques, as in table 6.2", columns, tuple(lines))
    return SectionResult(tables=(table,), remarks=_REMARKS)


def _lines(arm: str, information: Information, feasible_set: FeasibleSet) -> list[tuple[str | float, ...]]:
    weights: Literal["joint"] | None = "joint" if information.by_joint else None
    places = {box.link: (box.lower, box.upper) for box in boxes()}
    estimates: dict[str, Estimate] = {
        "WLS": least_squares(information, weights=weights),
        "LMI-SDP": fit(information, feasible_set, weights=weights, prefer=None),
        "point-mass (Ayusawa)": Ayusawa2010(boxes=places).fit(information, feasible_set, weights=weights),
    }
    more = Ayusawa2010(boxes=places, subdivisions=4).fit(information, feasible_set, weights=weights)
    published = {row["method"]: float(row["relative_error_percent"]) for row in rows("6.2")}
    estimates["point-mass, 125 points a link"] = more
    printed = published["WLS"]
    minimised = {name: _minimised(information, weights, estimate) for name, estimate in estimates.items()}
    return [
        (
            name,
            arm,
            published.get(name, ""),
            100.0 * estimate.relative_error,
            f"{published[name] - printed:.2f}" if name in published else "",
            100.0 * minimised[name],
            f"{100.0 * (minimised[name] - minimised['WLS']):.3f}",
            check(feasible_set, base=estimate.base).status,
        )
        for name, estimate in estimates.items()
    ]


def _minimised(information: Information, weights: Literal["joint"] | None, estimate: Estimate) -> float:
    """Return the relative error of the regression as it is weighted."""
    reduced = information.reduced(information.joint_weights(weights) if weights else None)
    squared = float(np.sum((reduced.R @ estimate.base - reduced.rho) ** 2)) + reduced.residual2
    return float(np.sqrt(squared / reduced.norm2))


SECTION = Section("6.3.1", "The point-mass method (table 6.2)", _compute)
