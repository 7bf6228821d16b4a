"""Samples of the posterior beside Laplace's approximation: within the set, and at its boundary.

Inside: arms of example-robot-data with CAD wrong by 30 % a link, rich motions and noise that lasts, as in
`believable_answers.py`; the prior is the entropic distance from CAD. Printed are the widths of Laplace's 95 % intervals
over those of the samples, of base parameters and of all quantities, and what the chains are worth.

At the boundary: the arm of `likelihood.py` with white noise, of which the viscous friction of the last joint is zero,
or as small as noise makes it. Printed is how often each interval holds the truth, and how wide it is.

    python benchmarks/posterior.py
    python benchmarks/posterior.py --arms ur5 --weights 100 --seeds 20
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from believable_answers import Experiment
from likelihood import arm, motion, noise_of

import steelyard as sy
from steelyard.estimators import EntropicPrior, posterior, term_deviations
from steelyard.feasibility.bounds.profile_intervals import profile_intervals
from steelyard.feasibility.bounds.quantities import quantities
from steelyard.regression import ParameterCovariance


def inside(name, weight, steps):
    """Print the ratios of one arm."""
    experiment = Experiment(name, "rich", "cad", 0)
    feasible_set = sy.FeasibleSet(experiment.model)
    prior = EntropicPrior(term_deviations=term_deviations(experiment.info, feasible_set))
    combinations = {f"base {k + 1}": row for k, row in enumerate(feasible_set.K)}
    begun = time.process_time()
    found = posterior(experiment.info, feasible_set, prior, weight, combinations=combinations, steps=steps)
    seconds = time.process_time() - begun
    print(f"{name}, weight {weight:g}: {found.sentence} {100 * found.inside:.1f} % of Laplace's distribution inside;")
    for what, chosen in (("base parameters", True), ("other quantities", False)):
        ratios = np.array([row.laplace_ratio for row in found if row.name.startswith("base") is chosen])
        print(
            f"  {len(ratios)} {what}: Laplace's width over that of samples {ratios.min():.3f} to {ratios.max():.3f}, "
            f"median {np.median(ratios):.3f}, {100 * np.mean(np.abs(ratios - 1.0) <= 0.1):.0f} % within a tenth"
        )
    print(f"  accepted {100 * found.acceptance:.0f} %, {seconds:.1f} s", flush=True)


def boundary(seeds, steps):
    """Print coverage and widths where the viscous friction of the last joint is zero, or near it."""
    model, truth = arm()
    index = [str(name) for name in model.parameter_names].index("Fvj3")
    feasible_set = sy.FeasibleSet(model)
    t, q, dq, ddq = motion(model)
    links = truth.copy()
    for errors in (0.0, 1.0, 3.0):
        counted = []
        for seed in range(seeds):
            random = np.random.default_rng([seed, 2])
            if not counted:
                truth[index] = 0.0
                torque = model.inverse_dynamics(q, dq, ddq, truth) + noise_of("white", random, len(t))
                info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t))
                row = feasible_set.K[:, index]
                alone = sy.least_squares(info).standard_error[int(np.flatnonzero(row)[0])]
                truth[index] = errors * alone
            torque = model.inverse_dynamics(q, dq, ddq, truth) + noise_of("white", random, len(t))
            info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t))
            prior = EntropicPrior(links * (np.abs(truth) > 0), term_deviations=term_deviations(info, feasible_set))
            whole = posterior(info, feasible_set, prior, 10.0, names=["Fvj3"], steps=steps, seed=seed)
            found, plain, value = whole["Fvj3"], sy.least_squares(info), truth[index]
            covariance = ParameterCovariance.of(info, plain.base, plain.weights)
            asked = quantities(feasible_set, ["Fvj3"])
            profile = profile_intervals(feasible_set, plain.base, covariance, asked, whole.mode)
            low, high = float(profile.lower[0]), float(profile.upper[0])
            counted.append(
                [
                    found.lower <= value <= found.upper,
                    found.laplace_lower <= value <= found.laplace_upper,
                    low <= value <= high,
                    found.upper - found.lower,
                    found.laplace_upper - found.laplace_lower,
                    high - low,
                    found.laplace_lower < 0.0,
                    found.lower == 0.0,
                    found.mean / alone,
                    found.mode / alone,
                ]
            )
        mean = np.mean(counted, axis=0)
        print(
            f"true friction {errors:g} standard errors from zero: intervals hold it in {100 * mean[0]:.0f} % "
            f"(samples), {100 * mean[1]:.0f} % (Laplace), {100 * mean[2]:.0f} % (profile); widths "
            f"{mean[3] / alone:.2f}, {mean[4] / alone:.2f}, {mean[5] / alone:.2f} standard errors;\n"
            f"  Laplace's reach below zero in {100 * mean[6]:.0f} %, those of samples begin at zero in "
            f"{100 * mean[7]:.0f} %; mean {mean[8]:.2f}, mode {mean[9]:.2f} standard errors",
            flush=True,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", default="ur5,panda,z1")
    parser.add_argument("--weights", default="11,100")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--seeds", type=int, default=100)
    options = parser.parse_args()
    for name in filter(None, options.arms.split(",")):
        for weight in options.weights.split(","):
            inside(name, float(weight), options.steps)
    boundary(options.seeds, 300)


if __name__ == "__main__":
    main()
