"""The real WAM: its published reduced regression and identification (Sousa and Cortesão, IROS 2013 and IJRR 2014)."""

from __future__ import annotations

import csv
import json

import numpy as np

from steelyard.dynamics import Coulomb, Model, Viscous
from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet, check
from steelyard.regression import Information, least_squares
from steelyard.robot import Robot

from ..comparison import Comparison, printed_precision
from ..section import Context, Section, SectionResult, Table

__all__ = ["SECTION", "real_wam"]

_NOT_ATTAINED = "the least residual is not attained, so that solvers stop at various points"


def real_wam(context: Context) -> tuple[Model, Information]:
    """Return the model with 84 parameters of the real arm and its reduced regression."""
    assert context.data is not None
    folder = context.data / "wam7"
    links = json.loads((folder / "dh.json").read_text(encoding="utf-8"))["rows"]
    model = Model(Robot.from_dh(links, name="wam").with_terms(Viscous(), Coulomb()))
    data = np.load(folder / "iros2013_reduced_regression.npz")
    information = Information.from_factor(
        data["R1"],
        data["rho1"],
        float(data["rho2_norm_sqr"]),
        int(data["n_rows"]),
        model.base_parameters().names,
    )
    return model, information


def _squared(information: Information, base: np.ndarray) -> float:
    problem = information.reduced(None)
    return float(np.sum((problem.R @ base - problem.rho) ** 2) + problem.residual2)


def _compute(context: Context) -> SectionResult:
    assert context.data is not None
    model, information = real_wam(context)
    ols = least_squares(information)
    with (context.data / "wam7" / "base_parameters_iros2013.csv").open(encoding="utf-8") as file:
        printed = list(csv.DictReader(file))
    comparisons = [
        Comparison("condition number", 48.3946416, information.condition_number, 5e-8),
        Comparison("relative error of OLS", 0.0561657801, ols.relative_error, 5e-11),
    ]
    key = next(name for name in printed[0] if "ols" in name.lower())
    for row, name, value in zip(printed, model.base_parameters().names, ols.base, strict=True):
        text = row[key]
        comparisons.append(
            Comparison(f"OLS base parameter {name}", float(text), float(value), max(printed_precision(text), 1e-9))
        )
    objectives = (
        ("inertia", False, 61647.79, "links feasible"),
        ("inertia", True, 61699.62, "links feasible, friction positive"),
        ("full", True, 62707.1, "triangle inequality too (optimum of another program)"),
    )
    table = []
    for consistency, terms, published, what in objectives:
        context.say(what)
        feasible_set = FeasibleSet(model, "full" if consistency == "full" else "inertia", terms=terms)
        estimate = fit(information, feasible_set, weights=None, prefer=None)
        squared = _squared(information, estimate.base)
        comparisons.append(
            Comparison(
                f"squared residual, {what}", published, squared, 1e-3 * published, f"within 0.1 %: {_NOT_ATTAINED}"
            )
        )
        verdict = check(feasible_set, base=estimate.base)
        table.append((what, 100.0 * estimate.relative_error, verdict.status, float(squared), published))
    columns = ("conditions", "relative error, %", "verdict", "squared residual", "published")
    remark = f"Where conditions are imposed {_NOT_ATTAINED}: see the decisions of the documentation."
    return SectionResult(tuple(comparisons), (Table("Constrained fits", columns, tuple(table)),), remarks=(remark,))


SECTION = Section("real WAM", "The real arm of the thesis, as published in 2013", _compute, needs_data=True)
