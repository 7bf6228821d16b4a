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
import time
from pathlib import Path

import numpy as np
from fit_scaling import ROWS, AllIdentifiable, Condition, regression

from steelyard.dynamics.threads import one_thread
from steelyard.feasibility import FeasibleSet, fit
from steelyard.methods import METHODS
from steelyard.regression import Information, least_squares

QUICK, REPETITIONS = 1.0, 5
"""Calls that take less than so many seconds are repeated, and the fastest counts."""


def six_by_six():
    """Coefficients of the inertia about the origin, first moments and mass (thesis 3.20)."""
    found = np.zeros((10, 6, 6))
    for k, (i, j) in enumerate([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]):
        found[k, i, j] = found[k, j, i] = 1.0
    for k, (i, j, sign) in enumerate([(1, 2, -1.0), (2, 0, -1.0), (0, 1, -1.0)]):
        # Skew-symmetric matrix of the first moment, and its transpose.
        found[6 + k, 3 + i, j] = found[6 + k, j, 3 + i] = sign
        found[6 + k, 3 + j, i] = found[6 + k, i, 3 + j] = -sign
    found[9, 3:, 3:] = np.eye(3)
    return found


class FreeLinks(AllIdentifiable):
    """The same with the thesis's conditions too."""

    def conditions(self, consistency):
        if consistency == "full":
            return super().conditions(consistency)
        coefficients, zero = six_by_six(), np.zeros((6, 6))
        return [
            Condition(f"body of {name}", name, None, zero, np.arange(10 * link, 10 * link + 10), coefficients)
            for link, name in enumerate(self.robot.link_names)
        ]


def plain(information, feasible):
    return least_squares(information)


def ours(information, feasible):
    return fit(information, feasible)


def problem(links):
    """The Information of the regression, and the model."""
    W, omega = regression(links)
    triangle = np.linalg.qr(np.column_stack([W, omega]), mode="r")
    R, rho, residual2 = triangle[:-1, :-1], triangle[:-1, -1], float(triangle[-1, -1] ** 2)
    model = FreeLinks(links)
    return Information.from_factor(R, rho, residual2, ROWS, model.parameter_names), model


def timed(run, information, feasible):
    """Relative error, feasible or not, and the least seconds of a few calls."""
    with one_thread():
        seconds = []
        while not seconds or (seconds[0] < QUICK and len(seconds) < REPETITIONS):
            begin = time.perf_counter()
            estimate = run(information, feasible)
            seconds.append(time.perf_counter() - begin)
    return estimate.relative_error, estimate.consistency is not None, min(seconds)


def _answer(pipe, run, information, feasible):
    pipe.send(timed(run, information, feasible))


def limited(run, information, feasible, limit):
    """As `timed` in a process of its own, None where it is not done in time."""
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
        information, model = problem(links)
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
