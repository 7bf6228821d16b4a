"""The thesis's and the real WAM's problems through every solver: one table of values, differences and times.

usage: python benchmarks/solvers.py [--shared ../shared] [--solvers clarabel scs csdp dsdp sdpa]

Table 4.9: squared distance from the least-squares estimate to the feasible set (thesis 4.5.3). Real WAM: least squared
residual within the set, with and without a bound of 27 kg on the total mass.
"""

import argparse
import csv
import json
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import steelyard as sy
from steelyard.conic import solver_table
from steelyard.errors import SteelyardError
from steelyard.estimators import fit_reduced
from steelyard.feasibility import TotalMass
from steelyard.identification.wam import wam_model

Run = Callable[[str], tuple[float, str]]


def corrections(tables: Path) -> Iterator[tuple[str, Run]]:
    """Squared distance of the least-squares estimate of table 4.9."""
    with (tables / "table_4_9_feasible_estimates.csv").open() as file:
        base = np.array([float(row["WLS"]) for row in csv.DictReader(file)])
    model = wam_model()
    for consistency in ("inertia", "full"):
        feasible = sy.FeasibleSet(model, consistency)

        def run(solver: str, feasible: sy.FeasibleSet = feasible) -> tuple[float, str]:
            correction = sy.correct(feasible, base=base, solver=solver)
            return correction.squared_distance, correction.outcome.value

        yield f"table 4.9, {consistency}", run


def fits(folder: Path) -> Iterator[tuple[str, Run]]:
    """Squared residuals of the real WAM's reduced regression."""
    rows = json.loads((folder / "dh.json").read_text())["rows"]
    model = sy.Model(sy.Robot.from_dh(rows, name="wam").with_terms(sy.Viscous(), sy.Coulomb()))
    data = np.load(folder / "iros2013_reduced_regression.npz", allow_pickle=False)
    information = sy.Information.from_factor(
        data["R1"], data["rho1"], float(data["rho2_norm_sqr"]), int(data["n_rows"]), model.base_parameters().names
    )
    reduced = information.reduced(None)
    for label, consistency, terms in (
        ("links", "inertia", False),
        ("inertia", "inertia", True),
        ("full", "full", True),
    ):
        for bound in (None, 27.0):
            constraints = [] if bound is None else [TotalMass(maximum=bound)]
            feasible = sy.FeasibleSet(model, consistency, constraints=constraints, terms=terms)

            def run(solver: str, feasible: sy.FeasibleSet = feasible) -> tuple[float, str]:
                found = fit_reduced(reduced, feasible, prefer=None, solver=solver)
                return found.squared_residual, ", ".join(sorted(set(getattr(found, "statuses", ())))) or "solved"

            yield f"real WAM, {label}{'' if bound is None else f', {bound:g} kg'}", run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    shared = Path(__file__).resolve().parent.parent.parent / "shared"
    parser.add_argument("--shared", type=Path, default=shared, help="folder with thesis/tables and data/wam7")
    parser.add_argument("--solvers", nargs="+", default=["clarabel", "scs", "csdp", "dsdp", "sdpa"])
    options = parser.parse_args()
    print(solver_table(), end="\n\n")
    problems: list[tuple[str, Run]] = []
    for folder, build in (
        (options.shared / "thesis" / "tables", corrections),
        (options.shared / "data" / "wam7", fits),
    ):
        if folder.is_dir():
            problems += build(folder)
        else:
            print(f"{folder} is not here; its problems are left out\n")
    print(f"{'problem':26} {'solver':9} {'value':>17} {'difference':>11} {'seconds':>8}  status")
    for label, run in problems:
        first = None
        for solver in options.solvers:
            start = time.perf_counter()
            try:
                value, status = run(solver)
            except SteelyardError as error:
                print(f"{label:26} {solver:9} {'':17} {'':11} {time.perf_counter() - start:8.2f}  {error}", flush=True)
                continue
            seconds = time.perf_counter() - start
            first = value if first is None else first
            print(
                f"{label:26} {solver:9} {value:17.10g} {value / first - 1:11.1e} {seconds:8.2f}  {status}", flush=True
            )


if __name__ == "__main__":
    main()
