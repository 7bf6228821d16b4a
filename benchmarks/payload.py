"""Payloads and drive gains of simulated arms: how far from the truth, and how often the intervals hold it.

Pinocchio plays Fourier motions of 40 s on arms of example-robot-data, with joint friction, noise of 1.5 % on torques
(which lasts for some samples) and of 2e-5 rad on encoders. Each seed has another motion, payload and noise.

    python benchmarks/payload.py                        # UR5 and Panda, 0.5, 2 and 5 kg, 100 seeds each
    python benchmarks/payload.py --gains                # the drive gains, by payloads of known mass
    python benchmarks/payload.py --arms ur10 --masses 1 --seeds 20
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "oracles"))
from payload_logs import Payload, SimulatedArm

import steelyard as sy
from steelyard.estimators import CarriedBody, KnownPayload, estimate_drive_gains, estimate_payload

PROCESSING = {"cutoff": 5.0, "velocity_threshold": 0.005}


def informations(arm, random, payload, **options):
    """Of an unloaded and a loaded log."""
    motion = arm.motion(random)
    for held in (None, payload):
        samples = arm.log(random, held, motion=motion, **options).process(**PROCESSING)
        yield sy.Information.from_samples(arm.model, samples)


def payloads(name, mass, seeds, changes, load_friction):
    """Print how well payloads of one mass are found."""
    arm = SimulatedArm(name)
    body = CarriedBody(arm.model, len(arm.model.robot.links) - 1, changes=changes)
    errors, centers, covered, widths, begin = [], [], [], [], time.perf_counter()
    for seed in range(seeds):
        random = np.random.default_rng([seed, round(1000 * mass)])
        truth = Payload.random(random, mass)
        unloaded, loaded = informations(arm, random, truth, load_friction=load_friction)
        found = estimate_payload(body, loaded, unloaded)
        values = {"mass": truth.mass, **{f"c{a}": c for a, c in zip("xyz", truth.com, strict=True)}}
        for i, a in enumerate("xyz"):
            values |= {f"I{a}{b}": truth.about_com[i, j] for j, b in enumerate("xyz") if j >= i}
        errors.append(abs(found.mass / mass - 1.0))
        centers.append(np.linalg.norm(found.center_of_mass - truth.com) / np.linalg.norm(truth.com))
        covered.append([value in found[key] for key, value in values.items()])
        widths.append((found["mass"].upper - found["mass"].lower) / mass)
    covered = np.mean(covered, axis=0)
    print(
        f"{name:6s} {mass:4.1f} kg, friction {changes}, {100 * load_friction:.0f} % of load: "
        f"mass within 2 % in {np.mean(np.array(errors) < 0.02):.0%} (median {np.median(errors):.2%}, "
        f"worst {max(errors):.2%}); centre within 2 % in {np.mean(np.array(centers) < 0.02):.0%} "
        f"(median {np.median(centers):.2%}); inside: mass {covered[0]:.0%}, centre "
        f"{' '.join(f'{c:.0%}' for c in covered[1:4])}, inertia {' '.join(f'{c:.0%}' for c in covered[4:])}; "
        f"interval of the mass {np.median(widths):.2%} wide; {(time.perf_counter() - begin) / seeds:.1f} s each",
        flush=True,
    )


def gains(name, mass, seeds):
    """Print how well drive gains are found with a payload of known mass."""
    arm = SimulatedArm(name)
    truth = np.linspace(12.0, 6.0, arm.model.dof)
    body = CarriedBody(arm.model, len(arm.model.robot.links) - 1)
    errors, inside = [], []
    for seed in range(seeds):
        random = np.random.default_rng([seed, round(1000 * mass)])
        held = Payload.random(random, mass)
        unloaded, loaded = informations(arm, random, held, gains=truth)
        found = estimate_drive_gains(body, loaded, unloaded, KnownPayload(mass))
        errors.append(np.abs(found.gains / truth - 1.0))
        inside.append((found.lower <= truth) & (found.upper >= truth))
    worst = np.max(errors, axis=1)
    print(
        f"{name:6s} gains by {mass:4.1f} kg of which the mass is known: all within 3 % in {np.mean(worst < 0.03):.0%} "
        f"(worst joint: median {np.median(worst):.2%}, worst of all {worst.max():.2%}); inside "
        f"{' '.join(f'{c:.0%}' for c in np.mean(inside, axis=0))}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="+", default=["ur5", "panda"])
    parser.add_argument("--masses", nargs="+", type=float, default=[0.5, 2.0, 5.0])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--changes", default="friction")
    parser.add_argument("--load-friction", type=float, default=0.0)
    parser.add_argument("--gains", action="store_true", help="drive gains instead of payloads")
    options = parser.parse_args()
    for name in options.arms:
        for mass in options.masses:
            if options.gains:
                gains(name, mass, options.seeds)
            else:
                payloads(name, mass, options.seeds, options.changes, options.load_friction)


if __name__ == "__main__":
    main()
