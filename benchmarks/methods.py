"""Thesis figures 6.2 and 6.3: every earlier method on the regression of 1 to 40 links, as ratios to `steelyard.fit`.

The problem is that of fit_scaling.py: a random regressor of 10000 rows with ten columns for each link. For each method
and number of links: the time over that of ``fit``, the error over that of plain least squares (figure 6.2 has this),
and the price of feasibility, i.e. that error less 1, over the price that ``fit`` pays. An asterisk: the answer is
infeasible. Each call runs in a process of its own and is stopped at the time limit; larger problems are then not tried
with that method. The feasible set is the thesis's own ("inertia"), or "full".

    python benchmarks/methods.py                                    # 1 to 40 links, all methods
    python benchmarks/methods.py --links 1 7 20 40 --limit 60 --consistency full
    python benchmarks/methods.py --methods Ayusawa2010 Rucker2022 --csv figures.csv
"""

import argparse
import csv
import multiprocessing
import os
from pathlib import Path

import numpy as np

from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet
from steelyard.regression import least_squares
from steelyard_thesis.methods import METHODS
from steelyard_thesis.reproduction.free_links import free_links_problem
from steelyard_thesis.reproduction.method_runs import run_method


def plain(information, feasible):
    return least_squares(information)


def ours(information, feasible):
    return fit(information, feasible)


def _answer(pipe, run, information, feasible):
    found = run_method(run, information, feasible)
    pipe.send(found and (found.relative_error, found.feasible, found.seconds))


def limited(run, information, feasible, limit):
    """As `run_method` in a process of its own, None where it is not done in time."""
    context = multiprocessing.get_context("fork" if hasattr(os, "fork") else "spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(there, run, information, feasible), daemon=True)
    process.start()
    there.close()
    try:
        found = here.recv() if here.poll(limit) else None
    except EOFError:
        found = None
    if process.is_alive() and found is None:
        process.terminate()
    process.join()
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--links", type=int, nargs="+", default=list(range(1, 41)), help="numbers of links")
    parser.add_argument("--limit", type=float, default=20.0, help="seconds for each method and number of links")
    parser.add_argument("--methods", nargs="+", help="names of classes; all where absent")
    parser.add_argument("--consistency", choices=("inertia", "full"), default="inertia", help="of the feasible set")
    parser.add_argument("--csv", type=Path, help="file to write all numbers to")
    options = parser.parse_args()
    chosen = [m for m in METHODS if not options.methods or m.__name__ in options.methods]
    print("for each method: time / time of fit, error / error of least squares, price / price of fit")
    print("links   fit ms  error/least squares  " + "  ".join(f"{m.__name__:>26s}" for m in chosen))
    stopped, rows, worst = {}, [], (0.0, "no method")
    for links in options.links:
        information, model = free_links_problem(links)
        feasible = FeasibleSet(model, options.consistency)
        least, _, seconds = limited(plain, information, feasible, 600.0)
        rows.append((links, "least squares", seconds, 1.0, False))
        error, _, seconds = limited(ours, information, feasible, 600.0)
        rows.append((links, "steelyard.fit", seconds, error / least, True))
        cells = []
        for method in chosen:
            name = method.__name__
            found = None if name in stopped else limited(method().fit, information, feasible, options.limit)
            if found is None:
                stopped.setdefault(name, links)
                cells.append(f"{'-':>26s}")
                continue
            other, proved, taken = found
            rows.append((links, name, taken, other / least, proved))
            price = (other / least - 1.0) / (error / least - 1.0) if error > least else np.nan
            mark = " " if proved else "*"
            cells.append(f"{taken / seconds:8.2f} {other / least:9.6f} {price:6.2f}{mark}")
            if proved and error / other - 1.0 > worst[0]:
                worst = (error / other - 1.0, f"{name} at {links} links")
        print(f"{links:5d} {1e3 * seconds:8.2f} {error / least:20.8f}  " + "  ".join(cells), flush=True)
        if options.csv:
            write(options.csv, rows)
    for name, links in stopped.items():
        print(f"{name}: stopped at {links} links, after {options.limit:g} s")
    print(f"error of fit above that of a feasible answer: at most {worst[0]:.1e}, relative ({worst[1]})")


def write(path, rows):
    """All numbers so far; the file appears whole or not at all."""
    part = path.with_name(path.name + ".part")
    with part.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("links", "method", "seconds", "error_over_least_squares", "feasible"))
        writer.writerows(rows)
    os.replace(part, path)


if __name__ == "__main__":
    main()
