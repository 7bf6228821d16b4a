"""Excitation of the WAM within the envelope of trajectories A and B: gradients against the scheme of the thesis.

For each seed Steelyard's design, and then COBYLA with random starts and a penalty on the limits (thesis section 4.3.2),
given ten times the time that the design took. The condition number is that of the base regressor (76 columns) at 1 kHz
over one period of 12.5 s with 6 harmonics, with the exact sign of Coulomb friction.
"""

import argparse
import time

import numpy as np

import steelyard as sy
from steelyard.excitation import ExcitationDesign, MotionLimits, SearchOptions
from steelyard.identification.wam import TRAJECTORIES, wam_model
from steelyard_thesis import minimise_with_cobyla


def condition_number(model: sy.Model, motion: tuple[np.ndarray, ...]) -> float:
    """Return the condition number of the whole base regressor, by its singular values."""
    q, dq, ddq = motion
    base = model.base_parameters()
    regressor = model.regressor(q, dq, ddq)[:, :, base.independent].reshape(-1, base.count)
    return float(np.linalg.cond(regressor))


def within(limits: MotionLimits, design: ExcitationDesign) -> bool:
    """Tell whether the whole motion, ramp-up and ramp-down too, keeps the limits at 1 kHz."""
    _, q, dq, ddq = design.trajectory.sample(1000.0)
    inside = (q >= limits.lower) & (q <= limits.upper)
    inside &= (np.abs(dq) <= limits.velocity) & (np.abs(ddq) <= limits.acceleration)
    return bool(inside.all())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--no-cobyla", action="store_true")
    arguments = parser.parse_args()

    model = wam_model()
    limits = MotionLimits.envelope(list(TRAJECTORIES.values()), model.robot.joint_names, 1000.0)
    for name, trajectory in TRAJECTORIES.items():
        print(f"trajectory {name} of the thesis: {condition_number(model, trajectory.sample(1000.0)[1:]):.3f}")
    print(f"{'seed':>6}{'gradient':>12}{'seconds':>10}{'limits':>8}{'COBYLA':>12}{'seconds':>10}{'limits':>8}")
    found, beside = [], []
    for seed in range(arguments.seeds):
        begin = time.perf_counter()
        design = sy.design_excitation(model, limits, search=SearchOptions(seed=seed, starts=arguments.starts))
        seconds = time.perf_counter() - begin
        found.append((condition_number(model, design.sample(1000.0)[1:]), seconds))
        kept = "kept" if within(limits, design) else "PASSED"
        line = f"{seed:>6}{found[-1][0]:>12.3f}{seconds:>10.2f}{kept:>8}"
        if not arguments.no_cobyla:
            begin = time.perf_counter()
            search = SearchOptions(seed=seed, minimiser=minimise_with_cobyla, starts=1000, time_limit=10.0 * seconds)
            other = sy.design_excitation(model, limits, search=search)
            longer = time.perf_counter() - begin
            beside.append(condition_number(model, other.sample(1000.0)[1:]))
            kept = "kept" if within(limits, other) else "PASSED"
            line += f"{beside[-1]:>12.3f}{longer:>10.2f}{kept:>8}"
        print(line, flush=True)
    values = [value for value, _ in found]
    print(f"best {min(values):.3f}, worst {max(values):.3f}, at most {max(s for _, s in found):.2f} s", end="")
    print(f"; COBYLA best {min(beside):.3f}, worst {max(beside):.3f}" if beside else "")


if __name__ == "__main__":
    main()
