"""Defects planted into descriptions, one at a time: whether `steelyard inspect` names the right cause.

    python benchmarks/planted_defects.py [--list]

Fifteen defects in two arms of example-robot-data whose inertials are good (Unitree Z1, UFactory xArm 7), each in the
link where it matters most, since the sign of a product that is almost zero changes nothing. Then all the robots of the
package as they are: what is found, and how many causes are named.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "oracles"))
from planted_defects import DEFECTS, ROBOTS, installed, named, planted

import steelyard as sy
from steelyard.identification.preflight import preflight


def main() -> None:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    arguments.add_argument("--list", action="store_true", help="print each robot")
    given = arguments.parse_args()
    right = 0
    for name in ROBOTS:
        for defect in DEFECTS:
            robot, link = planted(installed() / name, defect)
            found = {one.link: one.cause for one in preflight(robot).findings}
            good = named(found.get(link, ""), defect)
            right += good
            word, others = "right" if good else "WRONG", len(found) - (link in found)
            print(f"{Path(name).stem:8s} {defect:26s} {link:12s} {word} {found.get(link, '-')} (+{others})")
    print(f"{right} of {len(ROBOTS) * len(DEFECTS)} causes are right")
    links, causes = 0, Counter()
    for path in sorted(installed().rglob("*.urdf")):
        try:
            report = preflight(sy.Robot.from_urdf(path))
        except sy.InputError:
            continue
        links += len(report.links)
        causes.update(one.cause.split(":")[0] for one in report.findings)
        if given.list:
            for one in report.findings:
                print(f"{path.stem}: {one.link}: {one.sentence}")
    print(f"as they are: {links} links; {dict(causes.most_common())}")


if __name__ == "__main__":
    main()
