"""Logs with one mistake each: how often the first hypothesis is the right one, and what sound logs are accused of.

Six arms of example-robot-data, simulated by Pinocchio, on weak, ordinary and rich motions, with friction that the model
has in part, white and coloured noise, and a description whose masses, centres of mass and moments of inertia are wrong
by 30 % a link, or that has none.

    python benchmarks/planted_mistakes.py                 # 300 logs with mistakes, 100 sound ones
    python benchmarks/planted_mistakes.py --count 32 --sound 6
"""

import argparse
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "oracles"))
from planted_mistakes import MOTIONS, ROBOTS, Arm, cases, described, plant, undescribed

import steelyard as sy
from steelyard.identification.marginal_likelihood import body_priors, likeliest_robot, moments
from steelyard.identification.mistakes import find_mistakes

LARGE = 0.2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--sound", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verbose", action="store_true", help="print every log whose first hypothesis is wrong")
    options = parser.parse_args()
    arms = {name: Arm.named(name) for name in ROBOTS}

    def search(mistake, name, motion, cad, seed):
        arm = arms[name]
        planted = plant(arm, mistake, 1000 * options.seed + seed, motion)
        robot = described(arm.robot, seed) if cad else undescribed(arm.robot)
        model = sy.Model(robot.with_terms(*planted.terms))
        begun = time.process_time()
        found = find_mistakes(model, planted.samples)
        spent = time.process_time() - begun
        given, none = moments(model, planted.samples), np.zeros(model.parameter_count, dtype=bool)
        fits = [likeliest_robot(given, prior, none) for prior in body_priors(model)]
        fit = min(fits, key=lambda fit: fit.cost)
        return planted, found, spent, fit.error > LARGE or fit.errors.max() > LARGE

    table, seconds = defaultdict(Counter), []
    first, named, large, of_large, missed = (Counter() for _ in range(5))
    for mistake, name, motion, cad, seed in cases(options.count):
        planted, found, spent, is_large = search(mistake, name, motion, cad, seed)
        seconds.append(spent)
        right = [planted.is_named_by(one) for one in found]
        table[mistake][found[0].kind if found else "nothing"] += 1
        first[mistake] += bool(right[:1] == [True])
        named[mistake] += any(right)
        large[mistake] += is_large
        of_large[mistake] += is_large and right[:1] == [True]
        missed[mistake] += is_large and not found
        if options.verbose and right[:1] != [True]:
            said = " | ".join(f"{one.statement} ({one.gain:.0f}; {one.evidence})" for one in found) or "nothing"
            print(f"  {mistake}, {name}, {motion}, {'CAD' if cad else 'no CAD'}, {seed}: {said}", flush=True)
    print("named: right, or told as one of those that the log cannot tell apart")
    print(f"large: the error of all joints or of one is above {LARGE:.0%}; right: first, of these; missed: nothing")
    print(f"{'mistake':28} {'logs':>4} {'first':>5} {'named':>5} {'large':>5} {'right':>5} {'missed':>6}  first")
    for mistake, kinds in table.items():
        said = ", ".join(f"{kind} {count}" for kind, count in kinds.most_common())
        counts = f"{first[mistake]:5} {named[mistake]:5} {large[mistake]:5} {of_large[mistake]:5} {missed[mistake]:6}"
        print(f"{mistake:28} {sum(kinds.values()):4} {counts}  {said}")
    total = sum(sum(kinds.values()) for kinds in table.values())
    if total:
        counts = " ".join(f"{sum(count.values()):5}" for count in (first, named, large, of_large, missed))
        print(f"{'all':28} {total:4} {counts}")
        print(f"seconds of a processor: median {np.median(seconds):.2f}, longest {max(seconds):.2f}")
    accused, seconds = [], []
    for number in range(options.sound):
        name, motion = list(ROBOTS)[number % 6], list(MOTIONS)[number // 2 % 3]
        _, found, spent, _ = search("none", name, motion, number % 4 < 2, 10_000 + number)
        seconds.append(spent)
        accused += [f"{name}, {motion}: {found[0]}"] if found else []
    if seconds:
        print(f"sound logs: {len(accused)} of {options.sound} accused; median {np.median(seconds):.3f} s")
        print(*accused, sep="\n")


if __name__ == "__main__":
    main()
