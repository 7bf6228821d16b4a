"""Fits of random robots, well and badly conditioned: the measured gap, and the least residual that CVXPY finds.

Robots of 1 to 8 joints, some sliding, with mimic joints, coupled rotors, joints that stand still or hardly move, mass
bounds, and condition numbers from 1e1 to 1e10. The peer is a formulation of its own (`tests/oracles/random_fits.py`);
what its solver leaves outside the set is pulled inside, so that its residual is one that a feasible robot has.

    python benchmarks/random_fits.py                      # 1000 fits
    python benchmarks/random_fits.py --count 100 --first 1000 --solver SCS
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "oracles"))
from random_fits import least_by_cvxpy, random_fit, squared_residual

from steelyard.errors import SteelyardError
from steelyard.estimators import fit_reduced

GAP, ABOVE = 1e-6, 1e-5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--solver", default="CLARABEL")
    options = parser.parse_args()
    gaps, choices, above, seconds = [], [], [], []
    untold, refused, unattained = 0, 0, 0
    for seed in range(options.first, options.first + options.count):
        problem = random_fit(seed)
        start = time.perf_counter()
        try:
            fit = fit_reduced(problem.reduced, problem.feasible, **problem.options)
        except SteelyardError as error:
            refused += 1
            print(f"seed {seed}: {error} ({problem.words})", flush=True)
            continue
        seconds.append(time.perf_counter() - start)
        gaps.append(fit.optimality_gap)
        unattained += not fit.attained
        if fit.tie_break_gap is not None:
            choices.append(fit.tie_break_gap)
        told = any("not proved to be the least" in remark for remark in fit.remarks)
        untold += fit.optimality_gap > GAP and not told
        if fit.optimality_gap > GAP:
            print(f"seed {seed}: gap {fit.optimality_gap:.1e} ({problem.words})", flush=True)
        peer = least_by_cvxpy(problem, options.solver)
        # Below a mass bound that the peer does not have, the residual may be larger.
        if peer is not None and fit.attained:
            above.append(fit.best_squared_residual / squared_residual(problem, peer) - 1.0)
            if above[-1] > ABOVE:
                print(f"seed {seed}: {above[-1]:.1e} above {options.solver} ({problem.words})", flush=True)
    count = len(gaps)
    print(f"{count} fits, {refused} refused, {unattained} stopped by the mass bound, which they say")
    print(f"measured gap: {np.sum(np.array(gaps) <= GAP)} at most {GAP:g}, largest {max(gaps):.1e}; untold {untold}")
    print(f"choice among equals: {np.mean(np.array(choices) <= 1e-3):.1%} within 1e-3 of the preferred one")
    higher, lower = np.sum(np.array(above) > ABOVE), np.sum(np.array(above) < -ABOVE)
    print(f"against {options.solver} through CVXPY, {len(above)} of its answers usable, beyond {ABOVE:g}:")
    print(f"  {higher} above it, worst {max(above):.1e}; {lower} below it, most {-min(above):.1e}")
    print(f"seconds a fit: median {np.median(seconds):.3f}, largest {max(seconds):.2f}")


if __name__ == "__main__":
    main()
