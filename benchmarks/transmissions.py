"""Gear ratio and backlash from the encoders at both ends of a transmission, on simulated joints with and without a gap.

A joint behind a spring with a gap is integrated in small steps by NumPy alone (tests/oracles/gap_logs.py): gravity,
Coulomb friction on both sides, viscous friction, rotor, a second encoder that is late by up to 10 ms, its zero and
noise. Sound joints have springs that harden by up to 30 %, too.

    python benchmarks/transmissions.py --seeds 50
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "oracles"))
from gap_logs import gap_log

from steelyard.recording.diagnosis.transmission import diagnose_transmission


def joint(seed, backlash):
    """Return what is found at one joint."""
    random = np.random.default_rng([seed, 7])
    options = {"stiffness": 10 ** random.uniform(4.0, 5.2), "delay": random.choice([0.0, 3e-3, 1e-2])}
    hardening = random.choice([0.0, 0.3])
    return diagnose_transmission(*gap_log(seed, backlash=backlash, hardening=hardening, **options))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    count = parser.parse_args().seeds
    sound = [joint(seed, 0.0) for seed in range(count)]
    alarms = sum(one.has_backlash for one in sound)
    ratios = sum(one.ratio_is_wrong for one in sound)
    bounds = np.array([one.bound for one in sound])
    bounds = f"median {np.median(bounds):.2g}, greatest {bounds.max():.2g} rad"
    print(f"sound: {alarms} gaps and {ratios} wrong ratios told in {count}; bounds {bounds}")
    for backlash in (3e-4, 1e-3, 3e-3):
        found = [joint(seed, backlash) for seed in range(count)]
        told = [one for one in found if one.has_backlash]
        off = np.array([abs(one.backlash / backlash - 1.0) for one in told])
        covered = np.count_nonzero([abs(one.backlash - backlash) < 2.0 * one.backlash_error for one in told])
        print(
            f"gap of {backlash:g} rad: told in {len(told)} of {count}, within 10 % in {np.count_nonzero(off < 0.1)}; "
            f"error median {np.median(off):.1%}, greatest {off.max():.1%}; "
            f"{covered} within two standard errors; "
            f"{sum(one.ratio_is_wrong for one in found)} wrong ratios"
        )


if __name__ == "__main__":
    main()
