"""Logs with one mistake each: how often the first hypothesis is the right one, and what sound logs are accused of.

Six arms of example-robot-data, simulated by Pinocchio, on weak, ordinary and rich motions, with friction that the model
has in part, white and coloured noise, and a description whose masses, centres of mass and moments of inertia are wrong
by 30 % a link, or that has none.

    python benchmarks/planted_mistakes.py                 # 300 logs with mistakes, 100 sound ones
    python benchmarks/planted_mistakes.py --verdicts      # and what identify makes of each: its word, and so its exit
    python benchmarks/planted_mistakes.py --count 32 --sound 6
"""

import argparse
import sys
import time
from collections import Counter, defaultdict
from itertools import islice
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "oracles"))
from planted_mistakes import MOTIONS, ROBOTS, Arm, cases, described, plant, undescribed, verdicts

import steelyard as sy
from steelyard.estimators.marginal_likelihood import body_priors, likeliest_robot, moments
from steelyard.identification.mistakes import find_mistakes

LARGE = 0.2


def largest(told):
    """The error of all joints, or of the worst, noise aside."""
    return max(told[0].model_error, told[0].worst_joint_error)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="number of the first log with a mistake")
    parser.add_argument("--sound", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verdicts", action="store_true", help="identify each log, and print the words")
    parser.add_argument("--verbose", action="store_true", help="print every log whose first hypothesis is wrong")
    options = parser.parse_args()
    arms = {name: Arm.named(name) for name in ROBOTS}

    def search(mistake, name, motion, cad, seed):
        arm = arms[name]
        planted = plant(arm, mistake, 1000 * options.seed + seed, motion)
        robot = described(arm.robot, seed) if cad else undescribed(arm.robot)
        model = sy.Model(robot.with_terms(*planted.terms))
        begun = time.process_time()
        priors = body_priors(model)
        found = find_mistakes(model, planted.samples, priors=priors)
        spent = time.process_time() - begun
        given, none = moments(model, planted.samples), np.zeros(model.parameter_count, dtype=bool)
        fits = [likeliest_robot(given, prior, none) for prior in priors]
        fit = min(fits, key=lambda fit: fit.cost)
        told = verdicts(model, planted.samples, found) if options.verdicts else None
        return planted, found, spent, fit.error > LARGE or fit.errors.max() > LARGE, told

    table, seconds, words = defaultdict(Counter), [], []
    first, named, large, of_large, missed = (Counter() for _ in range(5))
    for mistake, name, motion, cad, seed in islice(cases(options.first + options.count), options.first, None):
        planted, found, spent, is_large, told = search(mistake, name, motion, cad, seed)
        seconds.append(spent)
        right = [planted.is_named_by(one) for one in found]
        table[mistake][found[0].kind if found else "nothing"] += 1
        first[mistake] += bool(right[:1] == [True])
        named[mistake] += any(right)
        large[mistake] += is_large
        of_large[mistake] += is_large and right[:1] == [True]
        missed[mistake] += is_large and not found
        if told is not None:
            words.append(told)
            if largest(told) > LARGE and told[1].word != "wrong":
                print(
                    f"  {told[1].word}: {mistake}, {name}, {motion}, {'CAD' if cad else 'no CAD'}, {seed}: error "
                    f"{told[0].model_error:.0%}, of the worst joint {told[0].worst_joint_error:.0%}, "
                    f"{found[0] if found else 'nothing'}",
                    flush=True,
                )
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
    for what, chosen in (
        ("of all joints", [told for told in words if told[0].model_error > LARGE]),
        ("of all joints or of one", [told for told in words if largest(told) > LARGE]),
    ):
        if words:
            before, after = (sum(told[k].word == "wrong" for told in chosen) for k in (0, 1))
            print(
                f"error {what} above {LARGE:.0%}, noise aside: {len(chosen)} logs; wrong by the error alone {before}, "
                f"with what was found {after}"
            )
    if words:
        print("words:", ", ".join(f"{word} {count}" for word, count in Counter(told[1].word for told in words).items()))
    accused, seconds, words = [], [], []
    for number in range(options.sound):
        name, motion = list(ROBOTS)[number % 6], list(MOTIONS)[number // 2 % 3]
        _, found, spent, _, told = search("none", name, motion, number % 4 < 2, 10_000 + number)
        words += [told[1].word] if told else []
        seconds.append(spent)
        accused += [f"{name}, {motion}: {found[0]}"] if found else []
    if seconds:
        print(f"sound logs: {len(accused)} of {options.sound} accused; median {np.median(seconds):.3f} s")
        print(*accused, sep="\n")
        if words:
            print("words:", ", ".join(f"{word} {count}" for word, count in Counter(words).items()))


if __name__ == "__main__":
    main()
