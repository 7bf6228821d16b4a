"""Section 6.4: reduction of the model until least squares are feasible (figure 6.4)."""

from __future__ import annotations

import numpy as np

from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet, check, correct
from steelyard.identification.wam import simulated_log, true_parameters, wam_model
from steelyard.regression import Information, least_squares
from steelyard.report import Chart, Curve
from steelyard_thesis.methods import DiazRodriguez2010, ReductionStep

from ..section import Context, Section, SectionResult, Table
from .identification import SEED
from .real_wam import real_wam

__all__ = ["SECTION"]

# The thesis in section 6.4; the errors in per cent.
_PUBLISHED = {"excluded": 36, "reduced": 4.66, "classical": 4.57, "feasible": 4.62}
_SEEDS = tuple(range(8))
_SHOWN = 5  # base parameters that the table of changes shows, those that change most
_REMARKS = (
    "The recordings of the thesis are not published; these numbers stand beside the published ones and do not "
    "count as values that agree or not. The parameter with the largest relative standard deviation is taken out, "
    "one after the other, and every reduced model is decided with a proof.",
    "On the thesis's recordings 36 reductions sufficed; on these data none does for certain, though they come "
    "near at about the same number. With some noise the reduced models end on the boundary itself, where a "
    "solver's answer is a matter of its tolerance: the last table lists them, and they count neither as feasible "
    "nor as infeasible.",
    "The reason: a parameter that the motion hardly shows is held at zero, and no body has a moment of inertia of "
    "zero beside a first moment that is not zero. Whether only parameters are taken out that may be zero depends on "
    "the noise; nothing in the method ensures it, as the thesis says.",
)


def _compute(context: Context) -> SectionResult:
    model = wam_model()
    cases = {"simulated arm": (_simulated(SEED), FeasibleSet(model, "inertia"))}
    if context.data is not None:
        real_model, information = real_wam(context)
        cases["real arm (2013), unweighted"] = (information, FeasibleSet(real_model, "inertia"))
    method = DiazRodriguez2010()
    paths, lines, near = {}, [], []
    for name, (information, feasible_set) in cases.items():
        weights = "joint" if information.by_joint else None
        context.say(f"reductions, {name}")
        path = method.path(information, feasible_set, weights=weights)
        paths[name] = path
        least = least_squares(information, weights=weights).relative_error
        best = fit(information, feasible_set, weights=weights).relative_error
        lines.append((name, *_ending(path), _percent(least), _percent(best)))
        near += [_nearest(name, path, feasible_set)]
    published = (
        "thesis",
        f"feasible with {_PUBLISHED['excluded']} of 76 excluded",
        *(f"{_PUBLISHED[key]:.2f}" for key in ("reduced", "classical", "feasible")),
    )
    columns = ("data", "outcome", "error of the reduced model, %", "error of least squares, %", "error of fit, %")
    tables = (
        Table("Final figures of section 6.4", columns, (published, *lines)),
        Table(
            "Where the reduced models came nearest to the feasible set, with half of the parameters left at least",
            ("data", "excluded", "error, %", "distance", "what fails there most"),
            tuple(near),
        ),
        _missing(paths["simulated arm"], cases["simulated arm"][1]),
        _noise_table(context),
    )
    return SectionResult(tables=tables, charts=_charts(paths), remarks=_REMARKS)


def _simulated(seed: int) -> Information:
    model = wam_model()
    return Information.from_samples(
        model, simulated_log(model, "A", seed).process(cutoff=4.8, order=3, trim=0.5, velocity_threshold=None)
    )


def _percent(error: float) -> str:
    return f"{100.0 * error:.3f}"


def _first(path: tuple[ReductionStep, ...]) -> ReductionStep | None:
    return next((step for step in path if step.feasible), None)


def _ending(path: tuple[ReductionStep, ...]) -> tuple[str, str]:
    first, count = _first(path), len(path[0].base)
    if first is None:
        return f"never feasible, up to {path[-1].excluded_count} of {count} excluded", "none"
    return f"feasible with {first.excluded_count} of {count} excluded", _percent(first.relative_error)


def _closest(path: tuple[ReductionStep, ...]) -> ReductionStep:
    """The nearest to the feasible set of the models with half of the parameters left at least."""
    return min((step for step in path if 2 * step.excluded_count <= len(path[0].base)), key=lambda step: step.distance)


def _nearest(name: str, path: tuple[ReductionStep, ...], feasible_set: FeasibleSet) -> tuple[str | float, ...]:
    step = _closest(path)
    verdict = check(feasible_set, base=step.base)
    fails = "; ".join(map(str, verdict.violations[:3])) or verdict.status
    return name, f"{step.excluded_count}", _percent(step.relative_error), step.distance, fails


def _missing(path: tuple[ReductionStep, ...], feasible_set: FeasibleSet) -> Table:
    """Return what the nearest feasible point changes in the reduced model that comes nearest."""
    step = _closest(path)
    nearest = correct(feasible_set, base=step.base).base
    model = wam_model()
    truth = model.base_parameters().values(true_parameters())
    names = model.base_parameters().expressions
    order = np.argsort(-np.abs(nearest - step.base))[:_SHOWN]
    columns = ("base parameter", "excluded", "reduced model", "nearest feasible", "truth")
    lines = tuple(
        (
            names[k],
            "yes" if names[k] in step.excluded else "no",
            float(step.base[k]),
            float(nearest[k]),
            float(truth[k]),
        )
        for k in order
    )
    title = f"Simulated arm, {step.excluded_count} excluded: what keeps the reduced model from being possible"
    return Table(title, columns, lines)


def _noise_table(context: Context) -> Table:
    """Return the table of reductions under other noise, which decides whether any reduction is feasible."""
    feasible_set = FeasibleSet(wam_model(), "inertia")
    lines = []
    for seed in _SEEDS:
        context.say(f"noise {seed}")
        path = DiazRodriguez2010().path(_simulated(seed), feasible_set, weights="joint", distances=False)
        undecided = ", ".join(
            f"{step.excluded_count} ({_percent(step.relative_error)} %)" for step in path if step.feasible is None
        )
        lines.append((f"{seed}", *_ending(path), undecided or "none"))
    columns = (
        "noise",
        "outcome",
        "error of the reduced model, %",
        "excluded where the boundary is too near to decide (error)",
    )
    return Table("The same on the simulated arm with other noise", columns, tuple(lines))


def _charts(paths: dict[str, tuple[ReductionStep, ...]]) -> tuple[Chart, ...]:
    errors, distances = [], []
    for name, path in paths.items():
        count = [step.excluded_count for step in path]
        errors.append(Curve(name, count, [100.0 * step.relative_error for step in path]))
        distances.append(Curve(name, count, [step.distance or np.nan for step in path]))
    label = "base parameters excluded"
    return (
        Chart("Figure 6.4: error of the reduced models", label, "relative error, %", tuple(errors), y_log=True),
        Chart(
            "Figure 6.4: distance to the feasible set (not drawn where feasible)",
            label,
            "distance",
            tuple(distances),
            y_log=True,
        ),
    )


SECTION = Section("6.4", "Comparison to model reduction (figure 6.4)", _compute)
