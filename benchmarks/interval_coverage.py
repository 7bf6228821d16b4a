"""Whether intervals hold the truth, and whether those of measured numbers are as narrow as the data allows.

Arms of the package example-robot-data, whose descriptions are the truth, as in `believable_answers.py`: CAD wrong by
30 % a link, torques with white noise and noise that lasts for twenty samples, friction near standstill that the model
does not have. Each experiment has a motion, friction, CAD and noise of its own; motions are rich, ordinary and weak in
turn. Standard parameters, centres of mass and the total mass are counted. Intervals of measured numbers are compared
with the bound of Cramér and Rao for the noise as it was made, with its correlation in time: unbiased estimates from
data alone have no narrower ones. Coulomb friction stands by itself: what is known of the noise tells it from single
steps of the torque, for noise that lasts has none; least squares do not, and what friction really does near standstill
is no step.

    python benchmarks/interval_coverage.py                                # four arms, 18 experiments each
    python benchmarks/interval_coverage.py --arms ur5,z1 --experiments 200
    python benchmarks/interval_coverage.py --estimator maximum_likelihood --standstill 0.2
    python benchmarks/interval_coverage.py --memory 0 --stribeck 0        # white noise, and a model that is right
    python benchmarks/interval_coverage.py --processing 'torque_cutoff = 10.0'    # or 'decimate = [5]'
"""

import argparse
import sys
import time
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz

sys.path.insert(0, str(Path(__file__).resolve().parent))
from believable_answers import ARMS, MEMORY, MOTIONS, STRIBECK, WHITE, Experiment, noise_sizes

import steelyard as sy
from steelyard.estimators.estimator import find_estimator
from steelyard.estimators.physical_prior import physical_prior
from steelyard.estimators.plausible_fit import plausible_fit, tried_prior
from steelyard.feasibility.bounds.quantities import quantities
from steelyard.identification.parameter_table import parameter_table

NORMAL = 1.959963984540054


@cache
def correlation(count, memory):
    """Of the noise of two samples, and its triangular root, (count, count) each."""
    found = toeplitz(memory ** np.arange(count) + WHITE**2 * (np.arange(count) == 0))
    return found, cholesky(found, lower=True)


def least_deviations(experiment, slopes, memory, standstill=0.0):
    """Standard deviations of combinations (k, n_b): the bound of Cramér and Rao, and those of least squares, (k,).

    Where rows near standstill are left out, the second are the bound of the rows that are kept.
    """
    model, (t, *motion) = experiment.model, experiment.moved
    regressor = model.regressor(*motion) @ model.base_parameters().Pb
    sizes = noise_sizes(model.inverse_dynamics(*motion, experiment.truth))
    matrix, root = correlation(len(t), memory)
    told, plain, middle, of_kept = np.zeros((4, regressor.shape[2], regressor.shape[2]))
    for joint, size in enumerate(sizes):
        own = regressor[:, joint] / size
        rows = solve_triangular(root, own, lower=True)
        told += rows.T @ rows
        plain += own.T @ own
        middle += own.T @ matrix @ own
        if standstill:
            kept = np.abs(motion[1][:, joint]) > standstill
            rows = solve_triangular(cholesky(matrix[np.ix_(kept, kept)], lower=True), own[kept], lower=True)
            of_kept += rows.T @ rows
    inverse = inverted(plain)
    second = inverted(of_kept) if standstill else inverse @ middle @ inverse
    return [np.sqrt(np.einsum("ki,ij,kj->k", slopes, m, slopes)) for m in (inverted(told), second)]


def inverted(matrix):
    """Of a positive semidefinite matrix; columns that are zero stay so."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-13, hermitian=True) / np.outer(scale, scale)


def experiment_of(name, kind, knowledge, seed, memory, processing, rows, standstill, stribeck):
    """For each number with a known truth: its name, basis, whether the interval holds it, its half-width over both."""
    experiment = Experiment(name, kind, knowledge, seed, memory, processing, rows, standstill, stribeck)
    model, info, truth = experiment.model, experiment.info, experiment.truth
    feasible_set = sy.FeasibleSet(model)
    unconstrained = sy.least_squares(info)
    tried = tried_prior(info, experiment.stretches, feasible_set, unconstrained, prior=physical_prior(model))
    found = plausible_fit(info, feasible_set, unconstrained, tried)
    table = parameter_table(info, found.plausible_set, found.estimate, unconstrained, term_scales=found.term_deviations)
    asked = quantities(feasible_set)
    slopes = np.array([quantity.slope(truth) for quantity in asked]) @ np.linalg.pinv(feasible_set.K)
    counted = []
    for quantity, *deviations in zip(asked, *least_deviations(experiment, slopes, memory, standstill), strict=True):
        row, ratios = table[quantity.name], (np.nan, np.nan)
        if row.basis == "measured":
            ratios = 0.5 * (row.upper - row.lower) / (NORMAL * np.array(deviations))
        counted.append((quantity.name, row.basis, row.lower <= quantity.value(truth) <= row.upper, *ratios))
    return counted


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", default="ur5,panda,z1,kinova")
    parser.add_argument("--knowledge", choices=("cad", "kinematics"), default="cad")
    parser.add_argument("--motions", default=",".join(MOTIONS))
    parser.add_argument("--memory", type=float, default=MEMORY, help="correlation of the noise with the sample before")
    parser.add_argument("--processing", help="options of a log that is processed, such as 'torque_cutoff = 10.0'")
    parser.add_argument("--estimator", default="fit", help="fit, or one with rows of its own")
    parser.add_argument("--standstill", type=float, default=0.0, help="rows that are left out, rad/s")
    parser.add_argument("--stribeck", type=float, default=STRIBECK, help="friction near standstill, of the noise")
    parser.add_argument("--experiments", type=int, default=18)
    parser.add_argument("--first", type=int, default=0, help="number of the first experiment")
    parser.add_argument("--verbose", action="store_true", help="print the numbers that are held least often")
    options = parser.parse_args()
    unknown = set(options.arms.split(",")) - set(ARMS)
    if unknown:
        parser.error(f"unknown arms: {', '.join(sorted(unknown))}")
    motions = options.motions.split(",")
    processing = None if options.processing is None else tomllib.loads(options.processing)
    rows = getattr(find_estimator(options.estimator), "rows", None)
    against = "the bound of the rows that are kept" if options.standstill else "least squares"
    print("inside: share of true values in their 95 % intervals, of all numbers and of those that rest on each basis")
    print(
        "width: of intervals of measured numbers over that of the bound of Cramér and Rao, and over that of the exact"
    )
    print(f"standard deviation of least squares, of which the noise is known here; here the last is {against}")
    for name in options.arms.split(","):
        begun, counted = time.process_time(), []
        for number in range(options.first, options.first + options.experiments):
            kind = motions[number % len(motions)]
            settings = (options.memory, processing, rows, options.standstill, options.stribeck)
            found = experiment_of(name, kind, options.knowledge, number, *settings)
            counted += [(kind, *row) for row in found]
        inside = np.array([row[3] for row in counted])
        widths = np.array([row[4:] for row in counted])

        def share(chosen, inside=inside):
            chosen = np.array(chosen)
            return f"{100 * inside[chosen].mean():.1f} % of {chosen.sum()}" if chosen.any() else "none"

        bases = [
            f"{basis} {share([row[2] == basis for row in counted])}" for basis in ("measured", "bounded", "assumed")
        ]
        kinds = [f"{kind} {share([row[0] == kind for row in counted])}" for kind in motions]
        print(f"{name}: inside {share(np.full(len(inside), True))}; {', '.join(bases)}; {', '.join(kinds)}")
        friction = np.array([row[1].startswith("Fc") for row in counted])
        for what, numbers in (("measured", ~friction), ("measured Coulomb friction", friction)):
            known = widths[np.isfinite(widths[:, 0]) & numbers]
            if len(known):
                low, middle, high = np.quantile(known[:, 0], (0.05, 0.5, 0.95))
                print(
                    f"  {len(known)} {what}: width over the bound {low:.2f} (5 %), {middle:.2f} (median), {high:.2f} "
                    f"(95 %), {100 * np.mean(known[:, 0] <= 2.0):.1f} % at most 2; over {against} "
                    f"{np.median(known[:, 1]):.2f}, {100 * np.mean(known[:, 1] <= 2.0):.1f} % at most 2"
                )
        print(f"  {(time.process_time() - begun) / options.experiments:.2f} s each", flush=True)
        if options.verbose:
            outside = Counter((row[1], row[2]) for row in counted if not row[3])
            print("  outside:", ", ".join(f"{n} ({basis}) {count}" for (n, basis), count in outside.most_common(15)))
            wide = Counter((row[1], row[0]) for row in counted if row[4] > 2.0)
            print("  wide:", ", ".join(f"{n} ({kind}) {count}" for (n, kind), count in wide.most_common(15)))


if __name__ == "__main__":
    main()
