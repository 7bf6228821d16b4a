"""Stiffness of elastic joints: on simulated arms against the truth, and on a KUKA KR300 with secondary encoders.

Pinocchio's equations of motion of arms of example-robot-data, with springs, dampers, rotors and friction, are
integrated by SciPy; encoders of 1e-5 rad on motors and links, those of the links late by 0.9 to 2.6 ms and with other
zeros, torques with noise of 1 %, masses up to 20 % beside their description. Each seed has another arm, motion and
noise.

    python benchmarks/elastic_joints.py                     # UR5 and Panda, 10 seeds each
    python benchmarks/elastic_joints.py --arms ur5 --seeds 30 --free    # inertia of the motors not stated
    python benchmarks/elastic_joints.py --motors            # by the encoders of the motors alone
    python benchmarks/elastic_joints.py --friction          # motors with other friction, which `auto` finds
    python benchmarks/elastic_joints.py --friction --motors # the same by the encoders of the motors alone
    python benchmarks/elastic_joints.py --kr300 ../shared/data/kuka_kr300 [--friction]
"""

import argparse
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "oracles"))

import steelyard as sy
from steelyard.identification import predict_deflections


def arms(name, seeds, first, stated, motors):
    """Print how near stiffnesses are to the truth, and how often intervals hold it."""
    from elastic_logs import ElasticArm

    errors, inside, measured, delays, heres, widths, damped, begin = [], [], [], [], [], [], [], time.perf_counter()
    for seed in range(first, first + seeds):
        random = np.random.default_rng([seed, 5])
        arm = ElasticArm(name, random)
        log = arm.log(random)
        with tempfile.TemporaryDirectory() as folder:
            found = sy.identify(arm.robot_file(Path(folder), inertia=stated, second=not motors), log).elastic_joints
        for k, joint in enumerate(found):
            low, high = joint.stiffness_interval
            truth = arm.stiffness[k]
            measured.append(joint.verdict == "measured")
            errors.append(joint.stiffness / truth - 1.0)
            inside.append(low <= truth <= high)
            widths.append((high - low) / (2 * truth))
            heres.append(k)
            delays.append(joint.delay - arm.delay[k])
            damped.append(arm.damping[k] <= joint.damping_bound)
    errors, inside, measured, widths = np.array(errors), np.array(inside), np.array(measured), np.array(widths)
    size = np.abs(errors[measured]) if measured.any() else np.array([np.nan])
    seconds = (time.perf_counter() - begin) / seeds
    parts = (
        f"{name}, {seeds} arms, {len(errors)} joints, motor inertia {'stated' if stated else 'not stated'}",
        f"{measured.sum()} stiffnesses measured, {np.mean(size < 0.03):.1%} of them within 3 %",
        f"median {np.median(size):.2%}, worst {size.max():.2%}",
        f"intervals hold the truth in {inside[measured].mean():.1%} of the measured and {inside.mean():.1%} of all",
        f"half of the median interval {np.median(widths[measured]):.2%}",
        f"dampings below their bounds in {np.mean(damped):.1%}",
        "no delays" if motors else f"delays within {1e6 * np.abs(delays).max():.1f} µs",
        f"{seconds:.0f} s each with the simulation",
    )
    print("; ".join(parts), flush=True)
    for k in sorted(set(heres)):
        own = (np.array(heres) == k) & measured
        worst = f"{np.abs(errors[own]).max():.2%}" if own.any() else "-"
        print(f"   joint {k + 1}: {own.sum()} measured, worst {worst}", flush=True)


RIGHT = {"coulomb": set(), "stribeck": {"stribeck"}, "polynomial": {"friction_polynomial"}}
"""The laws that ``friction = "auto"`` should add to viscous and Coulomb friction."""


def chosen_friction(name, seeds, first, law, motors):
    """Print which laws are chosen for motors with friction of a law, and how near stiffnesses are with and without."""
    from elastic_logs import ElasticArm

    right, joints, errors, inside, torques = 0, 0, {None: [], "auto": []}, [], {None: [], "auto": []}
    others: dict[str, int] = {}
    begin = time.process_time()
    for seed in range(first, first + seeds):
        random = np.random.default_rng([seed, 5])
        arm = ElasticArm(name, random, law)
        log = arm.log(random)
        with tempfile.TemporaryDirectory() as folder:
            file = arm.robot_file(Path(folder), second=not motors)
            found = {asked: sy.identify(file, log, friction=asked) for asked in errors}
        for asked, result in found.items():
            torques[asked].append(result.predictions[0].feasible_error)
            for joint, truth in zip(result.elastic_joints, arm.stiffness, strict=True):
                low, high = joint.stiffness_interval
                if joint.verdict == "measured":
                    errors[asked].append(abs(joint.stiffness / truth - 1.0))
                if asked == "auto":
                    inside.append(low <= truth <= high)
        chosen = found["auto"].friction.selection.chosen
        for k in range(len(arm.stiffness)):
            kinds = {one.kind for one in chosen if one.joint == k}
            joints, right = joints + 1, right + (kinds == RIGHT[law])
            if kinds != RIGHT[law]:
                told = " and ".join(sorted(kinds)) or "nothing"
                others[told] = others.get(told, 0) + 1
    seconds = (time.process_time() - begin) / seeds
    print(
        f"{name}, {seeds} arms, {joints} joints with {law} friction, encoders of the "
        f"{'motors alone' if motors else 'motors and links'}: the right laws at {right} joints; otherwise {others}; "
        f"intervals of auto hold the truth in {np.mean(inside):.1%}; {seconds:.0f} s of the processor each",
        flush=True,
    )
    for asked, own in errors.items():
        size = np.array(own)
        error = f"error of the torques {np.mean(torques[asked]):.2%}"
        print(f"   friction {asked}: {error}; {len(size)} stiffnesses measured", end="")
        if len(size):
            near = f"{np.mean(size < 0.03):.1%} within 3 %, median {np.median(size):.2%}, worst {size.max():.2%}"
            print(f", {near}", end="")
        print()
    sys.stdout.flush()


def counterbalance_of(about):
    """Return the term of the KR300's counterbalance: anchor points, piston and gas are the source's.

    It read 162 bar where the spring is shortest; 5 % of that are a standard deviation.
    """
    gas = about["hydraulic_counterbalance_of_the_source"]
    area = np.pi * (gas["piston_diameter_m"] ** 2 - gas["rod_diameter_m"] ** 2) / 4
    pull = 1e5 * min(gas["pressure_read_on_the_robot_bar"]["p"]) * area
    text = f'[[terms]]\nkind = "counterbalance"\nfixed = {gas["D_m"]}\nmoving = {gas["k_m"]}\njoints = [2]\n'
    text += f"aligned = {-np.deg2rad(5.0)}\nlength = {gas['l_m']}\ngas = {2 * 0.00048 / area}\n"
    text += f'[[constraints.confidence_interval]]\nexpression = "Pcj2"\nvalue = {pull}\n'
    text += f"standard_deviation = {0.05 * pull}\n"
    return text + '[[constraints.linear_bound]]\nexpression = "Kcj2"\nmaximum = 1.0\n'


def kr300(source, friction):
    """Print delays, stiffnesses, deflections of A and B, and the error of the torque on B."""
    from kr300 import about, elastic_robot

    a, b = source / "A.csv", source / "B.csv"
    for counterbalance in (True, False):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "kr300.toml"
            file.write_text(elastic_robot(source, counterbalance_of(about(source)) if counterbalance else ""))
            begin = time.perf_counter()
            result = sy.identify(file, a, b, friction=friction)
            took = time.perf_counter() - begin
            print(
                f"\nKR300 {'with' if counterbalance else 'without'} a counterbalance term, fitted to A in {took:.0f} s"
            )
            for one in result.predictions:
                print(f"  {one.role}: {one.feasible_error:.1%} (least squares {one.unconstrained_error:.1%})")
            for sentence in () if result.friction is None else result.friction.sentences:
                print(f"  {sentence}")
            heads, rows = result.elastic_table()
            print("  " + " | ".join(heads))
            for row in rows:
                print("  " + " | ".join(row))
            for log in predict_deflections(file, result, [a, b]).logs:
                print(log)


def main():
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="*", default=["ur5", "panda"])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--free", action="store_true", help="do not state the inertia of the motors")
    parser.add_argument("--friction", action="store_true", help="motors with other friction, which auto is to find")
    parser.add_argument("--motors", action="store_true", help="no encoders of the links, and so no delays")
    parser.add_argument("--kr300", type=Path, help="folder of the recordings, in place of the simulated arms")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.kr300:
        kr300(given.kr300, "auto" if given.friction else None)
        return
    for name in given.arms:
        if given.friction:
            for law in RIGHT:
                chosen_friction(name, given.seeds, given.first, law, given.motors)
            continue
        arms(name, given.seeds, given.first, not given.free, given.motors)


if __name__ == "__main__":
    main()
