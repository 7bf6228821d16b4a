"""Verdicts of `check` on random robots of which the answer is known: right, undecided, proved, and how fast.

usage: python benchmarks/verdicts.py [--count 10000] [--first 0] [--processes 2]
"""

import argparse
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "oracles"))
from random_instances import random_instance

from steelyard import check
from steelyard.feasibility import verify_document

BAND = 1e-9


def judge(seed: int) -> tuple[int, str, str, bool, float, str]:
    instance = random_instance(seed)
    start = time.perf_counter()
    verdict = check(instance.feasible, base=instance.base)
    seconds = time.perf_counter() - start
    if verdict.feasible is None:
        outcome = "undecided" if abs(instance.inside) > BAND else "undecided in the band"
    else:
        outcome = "right" if verdict.feasible == instance.possible else "WRONG"
    proved = verdict.certificate is not None and bool(verify_document(verdict.certificate.to_dict()))
    details = f"{instance.links} links, {instance.consistency}, spread 1e{instance.spread}, {instance.inside:.1e}"
    return seed, instance.kind, outcome, proved, seconds, details


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    counts: Counter[tuple[str, str]] = Counter()
    seconds, unproved = [], 0
    with ProcessPoolExecutor(options.processes) as pool:
        seeds = range(options.first, options.first + options.count)
        for seed, kind, outcome, proved, time_taken, details in pool.map(judge, seeds, chunksize=10):
            counts[kind, outcome] += 1
            seconds.append(time_taken)
            unproved += not proved and not outcome.startswith("undecided")
            if outcome in ("WRONG", "undecided"):
                print(f"seed {seed}: {kind}, {outcome} ({details})", flush=True)
    print(f"{'kind':20} {'right':>7} {'wrong':>7} {'undecided':>10} {'of these in the band':>21}")
    for kind in sorted({kind for kind, _ in counts}):
        band = counts[kind, "undecided in the band"]
        print(
            f"{kind:20} {counts[kind, 'right']:7} {counts[kind, 'WRONG']:7} "
            f"{counts[kind, 'undecided'] + band:10} {band:21}"
        )
    print(f"verdicts without a verified certificate: {unproved}")
    print(f"seconds a verdict: median {np.median(seconds):.3f}, largest {max(seconds):.2f}")


if __name__ == "__main__":
    main()
