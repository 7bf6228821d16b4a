"""Section 6.3.2: constrained regression with 1 to 40 links, by every method (figures 6.2 and 6.3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet, check
from steelyard.regression import Estimate, Information, least_squares
from steelyard.report import Chart, Curve
from steelyard_thesis.methods import (
    Ayusawa2010,
    DiazRodriguez2010,
    Farhat2008,
    Gautier2013,
    Mata2005,
    Method,
    Nakanishi2008,
    NakanishiCorrected,
    Rucker2022,
    Ting2006,
)

from ..comparison import Comparison
from ..free_links import free_links_problem
from ..method_runs import MethodRun, run_method
from ..section import Context, Section, SectionResult, Table

__all__ = ["SECTION", "scaling"]

LINKS = tuple(range(1, 41))
LEAST, OURS = "least squares", "steelyard.fit"
# Seconds for one call. It is there for slow machines: what is stopped depends on the machine, and nothing else does.
LIMIT = 20.0
# "it always finds the optimal solution (up to a 1e-6 error)"
_CLOSE = 1e-6
_ZOOM = 17

METHODS: dict[str, dict[str, Method]] = {
    "inertia": {
        "Mata 2005": Mata2005(),
        "Farhat 2008": Farhat2008(),
        "Ting 2006": Ting2006(),
        "Nakanishi 2008": Nakanishi2008(),
        "Nakanishi, corrected": NakanishiCorrected(),
        "Ayusawa 2010": Ayusawa2010(),
        "Rucker 2022": Rucker2022(),
        "Díaz-Rodríguez 2010": DiazRodriguez2010(),
        "Gautier 2013": Gautier2013(),
    },
    # Those that know the triangle inequality, or can be told of it.
    "full": {
        "Mata 2005, with the triangle inequality": Mata2005(triangle_inequality=True),
        "Farhat 2008, with the triangle inequality": Farhat2008(triangle_inequality=True),
        "Nakanishi, corrected": NakanishiCorrected(),
        "Ayusawa 2010": Ayusawa2010(),
        "Rucker 2022": Rucker2022(),
    },
}
SHOWN = (OURS, *(name for name in METHODS["inertia"] if name not in ("Díaz-Rodríguez 2010", "Gautier 2013")))
_REMARKS = (
    "As in the thesis: a random regressor of 1000 points of ten rows, ten parameters a link, all of them "
    "identifiable, and noise. Its numbers are random, so that figures agree in kind. All methods get the same "
    "reduced regression and one thread, with analytic derivatives. Mata and Farhat run SciPy's SQP; the thesis's "
    "own, on Sylvester's criterion as Farhat's, came sometimes near the optimum and sometimes stayed far from it, "
    "and so does ours.",
    "The figures show the methods whose answers keep to the set; those that reduce the model (Díaz-Rodríguez, "
    "Gautier) are in the tables. Answers of Rucker and Ayusawa always meet the triangle inequality too, which the "
    'thesis\'s conditions ("inertia") do not ask: there it costs them error; under "full" all have the same '
    "conditions. The thesis finds that point masses pay about twice what the optimum does.",
    "Good starts and exact second derivatives make the descents over free numbers (Nakanishi, Rucker) as exact "
    "and as fast here, where every parameter is identifiable. What they lack is a proof: their answers lie on the "
    "boundary, or nothing says that they are the best.",
)

Runs = dict[int, dict[str, MethodRun | None]]


def scaling(
    links: Sequence[int] = LINKS, *, limit: float = LIMIT, say: Callable[[str], None] = lambda _: None
) -> dict[str, tuple[Runs, dict[int, str]]]:
    """Run all methods.

    Parameters
    ----------
    links : sequence of int
        Numbers of links.
    limit : float
        Seconds for one call. A method that was stopped is not tried with more links.
    say : callable

    Returns
    -------
    dict
        For each consistency: for each number of links the run of each method, None for what was stopped; and the
        verdict on plain least squares.
    """
    results: dict[str, tuple[Runs, dict[int, str]]] = {kind: ({}, {}) for kind in METHODS}
    for count in links:
        say(f"{count} links" if count != 1 else "1 link")
        information, model = free_links_problem(count)
        for kind, (runs, verdicts) in results.items():
            feasible_set = FeasibleSet(model, "full" if kind == "full" else "inertia")
            stopped = {name for found in runs.values() for name, run in found.items() if run is None}
            verdicts[count] = check(feasible_set, base=least_squares(information).base).status
            runs[count] = {
                LEAST: run_method(_least_squares, information, feasible_set),
                OURS: run_method(fit, information, feasible_set, repetitions=3),
            }
            for name, method in METHODS[kind].items():
                runs[count][name] = (
                    None
                    if name in stopped
                    else run_method(method.fit, information, feasible_set, limit=limit, quick=0.2, repetitions=3)
                )
    return results


def _least_squares(information: Information, _: FeasibleSet) -> Estimate:
    return least_squares(information)


def _excess(runs: dict[str, MethodRun | None]) -> tuple[float, str]:
    """Return how far our error is above the least of the feasible answers of others, relative, and whose that is."""
    ours = runs[OURS]
    assert ours is not None
    others = {n: r.relative_error for n, r in runs.items() if n != OURS and r is not None and r.feasible}
    if not others:
        return -np.inf, "nobody"
    name = min(others, key=others.__getitem__)
    return ours.relative_error / others[name] - 1.0, name


def _compute(context: Context) -> SectionResult:
    results = scaling(say=context.say)
    comparisons, lines = [], []
    for kind, (runs, verdicts) in results.items():
        worst, name, where = max((*_excess(runs[n]), n) for n in runs)
        said = f"above {name} by {worst:.1e} at {where} links"
        published = f"the least, up to {_CLOSE:g}, at every N"
        if kind == "inertia":
            comparisons.append(
                Comparison(
                    "error of fit beside every other feasible answer, N = 1 to 40 (section 6.3.2)",
                    published,
                    published if worst <= _CLOSE else said,
                    why=f"greatest excess: {said}",
                )
            )
        infeasible = sum(status == "infeasible" for status in verdicts.values())
        lines.append((f'"{kind}"', worst, f"{name}, {where} links", f"{infeasible} of {len(runs)}"))
    columns = ("conditions", "at most, relative", "beside", "least squares infeasible (proved)")
    claims = Table("Error of fit above that of any other feasible answer, at all N from 1 to 40", columns, tuple(lines))
    runs = results["inertia"][0]
    tables = [claims]
    last = LINKS[-1]
    for kind, (found, verdicts) in results.items():
        tables.append(_last_table(kind, last, found[last], verdicts[last]))
    tables.append(_error_table(*results["inertia"]))
    return SectionResult(tuple(comparisons), tuple(tables), _charts(runs), remarks=_REMARKS)


def _last_table(kind: str, links: int, runs: dict[str, MethodRun | None], verdict: str) -> Table:
    ours, least = runs[OURS], runs[LEAST]
    assert ours is not None
    assert least is not None
    price = ours.relative_error / least.relative_error - 1.0
    lines: list[tuple[str | float, ...]] = []
    for name, run in runs.items():
        if run is None:
            lines.append((name, f"stopped ({LIMIT:g} s)", *("",) * 5))
            continue
        above = run.relative_error / least.relative_error - 1.0
        lines.append(
            (
                name,
                1e3 * run.seconds,
                run.seconds / ours.seconds,
                f"{run.relative_error / ours.relative_error:.8f}",
                f"{100.0 * above:.4f}",
                f"{above / price:.3f}",
                verdict if name == LEAST else "proved" if run.feasible else "not proved",
            )
        )
    columns = (
        "method",
        "time, ms",
        "time / ours",
        "error / ours",
        "error above least squares, %",
        "the same / ours",
        "feasible",
    )
    title = f'{links} links, "{kind}": each method beside ours (times differ from run to run)'
    return Table(title, columns, tuple(lines))


def _error_table(runs: Runs, verdicts: dict[int, str]) -> Table:
    lines = []
    for count, found in runs.items():
        least = found[LEAST]
        assert least is not None
        cells = []
        for name in SHOWN:
            run = found[name]
            above = np.nan if run is None else 100.0 * (run.relative_error / least.relative_error - 1.0)
            cells.append("stopped" if run is None else f"{above:.5f}{'' if run.feasible else ' *'}")
        lines.append((str(count), verdicts[count], *cells))
    title = 'Figure 6.2 in numbers: error above least squares, %, under "inertia" (* not proved feasible)'
    return Table(title, ("links", "least squares", *SHOWN), tuple(lines))


def _charts(runs: Runs) -> tuple[Chart, ...]:

    def curves(value: Callable[[MethodRun, MethodRun], float], which: Sequence[str], last: int) -> tuple[Curve, ...]:
        counts = [count for count in runs if count <= last]
        result = []
        for name in which:
            pairs = [(runs[count][name], runs[count][LEAST]) for count in counts]
            y = [np.nan if run is None or least is None else value(run, least) for run, least in pairs]
            # Several curves are one within the width of a line: ours shows through as points.
            result.append(Curve(name, counts, y, "points" if name == OURS else "line"))
        return tuple(result)

    def above(run: MethodRun, least: MethodRun) -> float:
        return 100.0 * (run.relative_error / least.relative_error - 1.0)

    def milliseconds(run: MethodRun, _: MethodRun) -> float:
        return 1e3 * run.seconds

    label, error = "links", "error above least squares, %"
    return (
        Chart("Figure 6.2: errors beside that of least squares", label, error, curves(above, SHOWN, LINKS[-1])),
        Chart(f"Figure 6.2: the first {_ZOOM}", label, error, curves(above, SHOWN, _ZOOM)),
        Chart(
            "Figure 6.3: times (differ from run to run)",
            label,
            "time, ms",
            curves(milliseconds, (LEAST, *SHOWN), LINKS[-1]),
            y_log=True,
        ),
    )


SECTION = Section("6.3.2", "Constrained regression with 1 to 40 links (figures 6.2 and 6.3)", _compute)
