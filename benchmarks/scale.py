"""What robots by the hundred thousand cost, by stages: their Informations packed, read, added, estimated and compared.

The robots are those of `fleet.py`, in sites of 1000. Nobody can simulate 10^5 minutes here: two dozen robots of a site
move and are reduced, and the others are made of them. A regressor depends on the motion alone, so that other parameters
change only the last column of a triangular factor, by the factor times the difference; their noise is that of the robot
that moved. What is done with an Information does not depend on where it came from.

    python benchmarks/scale.py                          # 10^5 robots; an hour of processor time
    python benchmarks/scale.py --robots 4000
"""

import argparse
import os
import resource
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent))

import numpy as np

import steelyard as sy
from fleet import SimulatedFleet, judged, part_of
from steelyard.fleet import compare_siblings, gains_in_own_motion, possible_causes, variations
from steelyard.fleet.packed import packed, unpacked
from steelyard.identification.wam import wam_model
from steelyard.regression import ParameterCovariance, torque_gains

SITE, MOVED, DAYS = 1000, 24, 2
EACH = 5  # robots of a site with each of the two faults
FRICTION, LINK = 0.5, 0.1


def shifted(information, change):
    """The Information of the same motion and noise, with base parameters that differ by `change`, (n_b,)."""

    def moved(factor):
        triangle = factor.triangle.copy()
        triangle[:, -1] += triangle[:, :-1] @ change[factor.columns]
        return replace(factor, triangle=triangle)

    def all_moved(value):
        return tuple(map(all_moved, value)) if isinstance(value, tuple) else moved(value)

    return replace(information, factors=all_moved(information.factors), batch_means=all_moved(information.batch_means))


def site(number, seed):
    """Estimate and compare the robots of a site; return seconds by stage, bytes, findings, memory and the mean."""
    fleet = SimulatedFleet("ur5", seed)
    reduced = fleet.model.base_parameters().K
    spent, size = Counter(), Counter()
    planted = {(number * 7919 + robot) % SITE: fault for robot, fault in fleet.planted(SITE, EACH).items()}
    begin = time.process_time()

    def lap(stage):
        nonlocal begin
        spent[stage] += time.process_time() - begin
        begin = time.process_time()

    first = number * SITE
    moved = [[fleet.robot(first + one, epoch=day) for day in range(DAYS)] for one in range(MOVED)]
    truths = [reduced @ fleet.parameters(first + one)[0] for one in range(MOVED)]
    lap("simulated, and reduced (two dozen)")
    bases, covariances, gains = [], [], []
    for robot in range(SITE):
        fault = planted.get(robot)
        amount = 0.0 if fault is None else FRICTION if fault[0] == "gearbox" else LINK
        base = reduced @ fleet.parameters(first + robot, fault, amount)[0]
        days = [shifted(one, base - truths[robot % MOVED]) for one in moved[robot % MOVED]]
        lap("made of those that moved")
        stored = [packed(one) for one in days]
        size["an Information with batch means"] += len(stored[0])
        size["an Information without"] += len(packed(replace(days[0], batch_means=()))) if robot == 0 else 0
        lap("packed")
        read = [unpacked(one) for one in stored]
        lap("unpacked, and held against the hash")
        total = sy.Information.total(read)
        lap("added")
        estimate = sy.least_squares(total)
        bases.append(estimate.base)
        covariances.append(ParameterCovariance.of(total, estimate.base, estimate.weights).matrix)
        gains.append(torque_gains(total, estimate.weights))
        lap("estimated, with its covariance")
    kept = bases[0].nbytes + covariances[0].nbytes + gains[0].nbytes
    size["base parameters, covariance and changes with gains"] = SITE * kept
    size["an Information without"] *= SITE
    bases = np.array(bases)
    causes = possible_causes(fleet.model, fleet.usual, np.median(bases, axis=0), np.median(gains, axis=0))
    own = gains_in_own_motion(fleet.model, causes, gains)
    found = compare_siblings(bases, np.array(covariances), causes, variations(fleet.model, causes), own=own)
    lap("compared with its siblings")
    told, false = judged(fleet, planted, [(one.robot, part_of(one.cause), ()) for one in found.deviations])
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return spent, size, told, len(false), memory, found.mean, found.mean_covariance


def of_the_wam():
    """Return the bytes of an Information of the WAM, seven joints with drives, with batch means and without.

    They depend on neither the motion nor the length of a log, beyond the rows that the longest batches need.
    """
    model = wam_model()
    q, dq, ddq, torque = np.random.default_rng(1).normal(size=(4, 20_000, model.robot.dof))
    one = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    return len(packed(one)), len(packed(replace(one, batch_means=())))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    sites, begin = max(options.robots // SITE, 1), time.perf_counter()
    spent, size, told, false, memory, means, errors = Counter(), Counter(), Counter(), 0, 0, [], []
    with ProcessPoolExecutor(options.workers) as pool:
        for seconds, octets, found, wrong, most, mean, error in pool.map(site, range(sites), [options.seed] * sites):
            spent.update(seconds)
            size.update(octets)
            for kind, numbers in found.items():
                names = ((kind, "found"), (kind, "named"), (kind, "named second"), (kind, "planted"))
                told.update(dict(zip(names, numbers, strict=True)))
            false, memory = false + wrong, max(memory, most)
            means.append(mean)
            errors.append(error)
    robots = sites * SITE
    print(f"{robots} robots in {sites} sites, {time.perf_counter() - begin:.0f} s with {options.workers} processes")
    print("\n| stage | ms of one processor a robot |\n| --- | --- |")
    for stage, seconds in spent.items():
        print(f"| {stage} | {1e3 * seconds / robots:.3g} |")
    print("\n| what is kept | bytes a robot |\n| --- | --- |")
    for what, octets in size.items():
        print(f"| {what} | {octets / robots:.0f} |")
    both, alone = of_the_wam()
    print(f"| an Information of the WAM, with drives, with batch means | {both} |")
    print(f"| an Information of the WAM, with drives, without | {alone} |")
    print(f"\nmost memory of a process: {memory / 2**20:.0f} MiB")
    for kind in ("gearbox", "link"):
        print(f"{kind}: {told[kind, 'found']} of {told[kind, 'planted']} found, {told[kind, 'named']} named")
    print(f"false alarms: {false}")
    if sites >= 3:
        # The sites were drawn alike: their means may differ by chance alone.
        fleet = SimulatedFleet("ur5", options.seed)
        begin = time.process_time()
        causes = possible_causes(fleet.model, fleet.usual, np.median(means, axis=0))
        found = compare_siblings(means, errors, causes, variations(fleet.model, causes))
        print(f"sites beside each other: {time.process_time() - begin:.2f} s, {len(found.deviations)} differ")


if __name__ == "__main__":
    main()
