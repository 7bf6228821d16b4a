"""Verdicts of `check` on random robots of every kind: undecided, unproved, and beside CVXPY with two other set-ups.

usage: python benchmarks/random_verdicts.py [--count 2000] [--first 0] [--compare 200]

Robots have coupled motors, mimic joints, sliding joints, axes 5e-6 to 1e-2 rad from parallel, branches, or constraints.
CVXPY gets the conditions written out anew, and the base parameters through the torques that they cause: no K of
ours. A margin counts as clear beyond 1e-6 of the largest base parameter (at least 1).
"""

import argparse
import sys
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "oracles"))
from random_questions import KINDS, Question, margin_by_cvxpy, random_question

from steelyard import check
from steelyard.feasibility import Verdict, verify_document

CLEAR = 1e-6


def compared(question: Question, verdict: Verdict) -> tuple[str, float]:
    """Whether CVXPY comes to the same answer, and the relative difference of the margins."""
    margin, status = margin_by_cvxpy(question)
    if status == "infeasible" and verdict.feasible is False:
        return "same", 0.0
    if status != "optimal" or abs(margin) <= CLEAR * question.scale:
        return "not solved or not clear", 0.0
    same = (margin > 0) == verdict.feasible
    if not same:  # a second opinion: near-parallel axes are beyond the accuracy of the first solver
        margin, status = margin_by_cvxpy(question, "SCS", eps=1e-9, max_iters=50_000)
        if abs(margin) <= 1e-4 * question.scale or not status.startswith("optimal"):
            return "not solved or not clear", 0.0
        same = (margin > 0) == verdict.feasible
    return ("same" if same else "DIFFERENT"), abs(margin - verdict.margin) / max(abs(margin), CLEAR)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--compare", type=int, default=200)
    options = parser.parse_args()
    warnings.filterwarnings("ignore", module="cvxpy")
    warnings.filterwarnings("ignore", message="Solution may be inaccurate")
    counts: Counter[tuple[str, str]] = Counter()
    others: Counter[str] = Counter()
    differences, seconds, unproved = [], [], 0
    for seed in range(options.first, options.first + options.count):
        question = random_question(seed)
        start = time.perf_counter()
        verdict = check(question.feasible, base=question.base)
        seconds.append(time.perf_counter() - start)
        outcome = verdict.status
        if verdict.feasible is None:
            clear = abs(verdict.margin) > CLEAR * question.scale
            outcome = "UNDECIDED" if clear else "undecided in the band"
            print(f"seed {seed}: {question.kind}, {outcome}, margin {verdict.margin:.3g}", flush=True)
        elif not verify_document(verdict.certificate.to_dict()):
            unproved += 1
        counts[question.kind, outcome] += 1
        if seed - options.first < options.compare and verdict.feasible is not None:
            same, difference = compared(question, verdict)
            others[same] += 1
            differences += [difference] if same == "same" else []
            if same == "DIFFERENT":
                print(f"seed {seed}: {question.kind}, {verdict.status}, CVXPY differs", flush=True)
    outcomes = ("feasible", "infeasible", "UNDECIDED", "undecided in the band")
    print(f"{'kind':18}" + "".join(f"{name:>23}" for name in outcomes))
    for kind in KINDS:
        print(f"{kind:18}" + "".join(f"{counts[kind, name]:23}" for name in outcomes))
    print(f"verdicts without a verified certificate: {unproved}")
    print(f"beside CVXPY: {dict(others)}")
    if differences:
        print(
            f"relative difference of the margins: median {np.median(differences):.1e}, largest {max(differences):.1e}"
        )
    print(f"seconds a verdict: median {np.median(seconds):.3f}, largest {max(seconds):.2f}")


if __name__ == "__main__":
    main()
