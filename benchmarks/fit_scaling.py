"""The regression of thesis 6.3.2 for 1 to 40 links: time of a whole fit, against Clarabel's own and against CVXPY.

A random regressor of 10000 rows with ten columns for each link, all identifiable, and enough noise that plain least
squares is infeasible. ``fit`` gets the reduced regression; the time of the reduction (one QR factorisation) stands
beside it. CVXPY gets the problem as it is, and once more in the same reduced form. Both use Clarabel, on one thread.

    python benchmarks/fit_scaling.py                      # all of 1 to 40; CVXPY for 1, 7, 20 and 40
    python benchmarks/fit_scaling.py --links 7 40
"""

import argparse
import time

import numpy as np

import steelyard.feasibility.cone_program as program
from steelyard.dynamics.threads import one_thread
from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Information
from steelyard_thesis.reproduction.free_links import ROWS, free_links, random_regression

PEER = (1, 7, 20, 40)


class Spy:
    """Adds up what Clarabel says of its own time."""

    def __init__(self):
        self.seconds = 0.0
        self.statuses = []
        self._solve = program.solve
        program.solve = self

    def __call__(self, *arguments, **options):
        solution = self._solve(*arguments, **options)
        self.seconds += solution.seconds
        self.statuses.append(solution.status)
        return solution


def through_cvxpy(model, W, omega):
    """The same problem in CVXPY; seconds and the least squared residual."""
    import cvxpy as cp

    begin = time.perf_counter()
    delta = cp.Variable(len(model.parameter_names))
    constraints = []
    for condition in model.conditions("full"):
        matrix = sum(delta[int(k)] * C for k, C in zip(condition.indices, condition.coefficients, strict=True))
        constraints.append(matrix >> 1e-6 * np.eye(4))
    problem = cp.Problem(cp.Minimize(cp.sum_squares(W @ delta - omega)), constraints)
    problem.solve(solver="CLARABEL", max_threads=1)
    return time.perf_counter() - begin, problem.value


def measure(links, spy, repetitions, peer):
    W, omega = random_regression(links)
    model = free_links(links)
    begin = time.perf_counter()
    triangle = np.linalg.qr(np.column_stack([W, omega]), mode="r")
    reduction = time.perf_counter() - begin
    R, rho, residual2 = triangle[:-1, :-1], triangle[:-1, -1], float(triangle[-1, -1] ** 2)

    totals, owns = [], []
    for _ in range(repetitions):
        info = Information.from_factor(R, rho, residual2, ROWS, model.parameter_names)
        feasible = FeasibleSet(model)
        fit(info, feasible)  # what is made once for each set
        info = Information.from_factor(R, rho, residual2, ROWS, model.parameter_names)
        spy.seconds = 0.0
        begin = time.perf_counter()
        estimate = fit(info, feasible)
        totals.append(time.perf_counter() - begin)
        owns.append(spy.seconds)
    squared = residual2 + float(np.sum((R @ estimate.base - rho) ** 2))
    total, own = min(totals), min(owns)
    line = [f"{links:5d}", f"{1e3 * reduction:9.1f}", f"{1e3 * total:9.2f}", f"{1e3 * own:9.2f}"]
    line.append(f"{total / own:7.2f}" if own else "      -")
    line.append(f"{squared / residual2 - 1:11.3e}")
    if peer:
        whole, value = through_cvxpy(model, W, omega)
        lean, _ = min(through_cvxpy(model, R, rho) for _ in range(3))
        line += [f"{whole:9.3f}", f"{whole / (total + reduction):8.1f}", f"{1e3 * lean:9.1f}", f"{lean / total:8.1f}"]
        line.append(f"{squared / value - 1:10.1e}")
    print(" ".join(line), flush=True)
    return total


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--links", type=int, nargs="+", default=list(range(1, 41)), help="numbers of links")
    parser.add_argument("--repetitions", type=int, default=15, help="fits of which the fastest counts")
    parser.add_argument("--no-cvxpy", action="store_true", help="leave the peer out")
    options = parser.parse_args()
    spy = Spy()
    print("times in ms but for CVXPY on the whole regressor, in s; price: squared residual above plain least squares")
    print(
        "links reduction       fit  Clarabel   ratio       price    CVXPY, ratio to    CVXPY, ratio to difference\n"
        "                                                           whole  red.+fit   reduced      fit of optima"
    )
    measured = {}
    for links in options.links:
        peer = not options.no_cvxpy and (links in PEER or len(options.links) < 10)
        with one_thread():
            measured[links] = measure(links, spy, options.repetitions, peer)
    large = sorted(links for links in measured if links >= 5)
    if len(large) > 1:
        slope = np.polyfit(np.log(large), np.log([measured[links] for links in large]), 1)[0]
        print(
            f"time of a fit grows with about the power {slope:.2f} of the number of links ({large[0]} to {large[-1]})"
        )
    print("status of the solver:", ", ".join(sorted(set(spy.statuses))))


if __name__ == "__main__":
    main()
