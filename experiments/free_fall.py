"""Thesis 5.1.2: free fall of the WAM with the columns of table 4.9, figures 5.1 to 5.4.

    python experiments/free_fall.py ../shared/thesis/tables --output free-fall

Writes a CSV for each column, one page with the figures, and prints what the thesis says beside what comes out here.
"""

import argparse
import csv
import time
from pathlib import Path

import numpy as np

from steelyard.identification.wam import wam_model
from steelyard.report import Chart, Curve, Section, charts_markup, html_document, write_text
from steelyard.report.markup import Markup, table
from steelyard.simulation import SimulationResult, simulate

COLUMNS = {
    "WLS": "weighted least squares",
    "WLS_corrected": "corrected (nearest feasible)",
    "WLS_feasible": "feasible fit",
    "WLS_feasible_extra": "feasible fit, centres of mass in boxes",
}
# Section 5.1.2 says at 0.041 s for the first; of the others, that they run as long as desired and lose energy.
PUBLISHED = {"WLS": "stops at 0.041 s"} | dict.fromkeys(list(COLUMNS)[1:], "runs 6 s, energy falls")
DURATION = 6.0
STILL = np.zeros(7)


def columns(folder: Path) -> dict[str, np.ndarray]:
    """Read the columns, (76,) each."""
    with (folder / "table_4_9_feasible_estimates.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in COLUMNS}


def joints(result: SimulationResult, title: str) -> Chart:
    """Draw the positions of the joints."""
    curves = tuple(Curve(f"joint {k + 1}", result.t, result.q[:, k]) for k in range(7))
    return Chart(title, "time, s", "position, rad", curves)


def main() -> None:
    """Simulate, print the table, write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tables", type=Path, help="folder of the thesis's tables")
    parser.add_argument("--output", type=Path, default=Path("free-fall"))
    parser.add_argument("--method", default="automatic")
    parser.add_argument("--sign-width", type=float, default=1e-3, help="rad/s")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    model, results, rows = wam_model(), {}, []
    for name, parameters in columns(options.tables).items():
        fine = {"rate": 20000.0} if name == "WLS" else {}
        begin = time.perf_counter()
        result = simulate(
            model,
            parameters,
            STILL,
            STILL,
            DURATION,
            base=True,
            method=options.method,
            sign_width=options.sign_width,
            **fine,
        )
        seconds = time.perf_counter() - begin
        results[name] = result
        result.save(options.output / f"{name}.csv")
        span = np.ptp(result.energy)
        rows.append(
            (
                name,
                PUBLISHED[name],
                f"{result.status} at {result.end_time:.4g} s",
                f"{result.energy[0]:.4f} → {result.energy[-1]:.4f}",
                f"{max(0.0, np.diff(result.energy).max() / span):.1e}",
                f"{np.abs(result.dq[-1]).max():.1e}",
                f"{seconds:.2f}",
            )
        )
    heads = ("column", "thesis 5.1.2", "here", "energy, J", "largest rise / span", "last speed, rad/s", "seconds")
    widths = [max(len(row[k]) for row in (heads, *rows)) for k in range(len(heads))]
    for row in (heads, *rows):
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)))
    print(results["WLS"].message)
    energies = tuple(Curve(COLUMNS[name], r.t, r.energy) for name, r in results.items() if name != "WLS")
    first = results["WLS"]
    charts = [
        joints(first, "Figure 5.1: positions, weighted least squares"),
        Chart("Figure 5.2: energy, weighted least squares", "time, s", "J", (Curve("total", first.t, first.energy),)),
        joints(results["WLS_feasible_extra"], "Figure 5.3: positions, feasible fit, centres of mass in boxes"),
        Chart("Figure 5.4: energy, the three feasible columns", "time, s", "J", energies),
    ]
    page = html_document(
        "Free fall of the WAM",
        "Steelyard experiment",
        "Free fall of the WAM (thesis 5.1.2)",
        Markup(f"<p>{first.message}.</p>"),
        [
            Section("figures", "Figures 5.1 to 5.4", charts_markup(charts, identifier="free-fall")),
            Section("table", "Beside the thesis", table("Free fall", heads, rows, identifier="runs", texts=(1, 2, 3))),
        ],
        script="charts.js",
    )
    write_text(page, options.output / "free_fall.html")
    print(f"Figures in {options.output / 'free_fall.html'}")


if __name__ == "__main__":
    main()
