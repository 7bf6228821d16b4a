"""Whether the default answer is one that an engineer believes: masses, errors on other motions, and intervals.

Arms of the package example-robot-data, whose descriptions are the truth, move weakly, ordinarily and richly; torques
have noise that lasts for twenty samples, and friction near standstill that the model does not have. What is told of
the arm is CAD wrong by 30 % a link at random, or its kinematics alone.

    python benchmarks/believable_answers.py                        # 12 arms, three motions, with and without CAD
    python benchmarks/believable_answers.py --arms panda,ur5 --seeds 5
"""

import argparse
import sys
import time
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import steelyard as sy
from steelyard.estimators import fit_reduced
from steelyard.estimators.physical_prior import physical_prior
from steelyard.estimators.plausible_fit import plausible_fit, tried_prior
from steelyard.identification.parameter_table import parameter_table
from steelyard.recording import Processing
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks

ARMS = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_link8"),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", "ee_link"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "ee_link"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "ee_link"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link7"),
    "z1": ("z1_description/urdf/z1.urdf", "link06"),
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_link_6"),
    "so101": ("so_arm_description/urdf/so101.urdf", None),
    "talos": ("talos_data/robots/talos_left_arm.urdf", None),
    "baxter": ("baxter_description/urdf/baxter.urdf", "left_wrist"),
    "tiago": ("tiago_description/robots/tiago_no_hand.urdf", "arm_tool_link"),
    "pr2": ("pr2_description/urdf/pr2.urdf", "r_wrist_roll_link"),
}
MOTIONS = {"rich": (0.8, 0.1, 5, 20.0), "ordinary": (0.5, 0.1, 3, 10.0), "weak": (0.15, 0.05, 2, 10.0)}
"""Amplitude relative to the range of the joint, Hz, harmonics, seconds."""
NOISE, BLUR, RATE = 0.02, 0.3, 100.0
WHITE, MEMORY = 0.7, 0.95
STRIBECK = 0.3  # of the size of the noise: what friction near standstill has and the model has not
"""Of the noise: its white part relative to what lasts, and the correlation of what lasts with the sample before."""


def description(name):
    """The path of the URDF of an arm in example-robot-data."""
    for place in sys.path:
        folder = Path(place, "cmeel.prefix", "share", "example-robot-data", "robots")
        if folder.is_dir():
            return folder / ARMS[name][0]
    raise SystemExit("This needs the arms of example-robot-data: pip install example-robot-data")


def described(name):
    """The arm as example-robot-data describes it."""
    return sy.Robot.from_urdf(description(name), tip=ARMS[name][1])


def blurred(robot, random):
    """The arm with CAD that is wrong: masses, centres of mass and moments of inertia of every link by 30 %."""
    links = []
    for link in robot.links:
        body = np.asarray(link.inertia.parameters)
        mass, com = body[9], body[6:9] / body[9]
        about = np.array([body[[0, 1, 2]], body[[1, 3, 4]], body[[2, 4, 5]]])
        about = about - mass * (com @ com * np.eye(3) - np.outer(com, com))
        factor = np.exp(BLUR * random.normal())
        com = com * (1.0 + BLUR * random.normal(size=3))
        inertia = sy.Inertia.from_com(mass * factor, com, about * factor * np.exp(BLUR * random.normal()))
        links.append(replace(link, inertia=inertia, own_inertia=inertia, attachments=()))
    return replace(robot, links=tuple(links), source=None)


def motion(robot, random, kind):
    """Time, positions, velocities and accelerations of random harmonics; weak ones leave some joints nearly still."""
    amplitude, frequency, harmonics, seconds = MOTIONS[kind]
    joints = [robot.joints[k] for k in robot.driving_joints]
    t = np.arange(0.0, seconds, 1.0 / RATE)
    q, dq, ddq = np.zeros((3, len(t), len(joints)))
    for k, joint in enumerate(joints):
        low, high = (edge if np.isfinite(edge) else side * 3.1 for edge, side in ((joint.lower, -1), (joint.upper, 1)))
        half = min(0.5 * (high - low), 1.5)
        for number in range(1, harmonics + 1):
            w = 2 * np.pi * frequency * number * (1 + 0.05 * k)
            a, b = random.normal(size=2) / np.sqrt(number)
            q[:, k] += a * np.sin(w * t) + b * np.cos(w * t)
            dq[:, k] += w * (a * np.cos(w * t) - b * np.sin(w * t))
            ddq[:, k] -= w * w * (a * np.sin(w * t) + b * np.cos(w * t))
        scale = amplitude * half / np.abs(q[:, k]).max()
        if kind == "weak" and random.random() < 0.25:
            scale *= 0.02
        for values in (q, dq, ddq):
            values[:, k] *= scale
        q[:, k] += 0.5 * (low + high) + random.uniform(-0.2, 0.2) * half
    return t, q, dq, ddq


def truth_of(robot, model, torque_sizes, random):
    """The parameters of the description, with friction of some per cent of the torques."""
    values = np.asarray(sy.Model(robot.with_terms(*model.robot.terms)).robot.parameters).copy()
    joints = model.dof
    own = np.setdiff1d(np.arange(len(values)), model.link_columns)
    for index in own:
        name = str(model.parameter_names[index])
        joint = int("".join(c for c in name if c.isdigit())) - 1
        size = 0.15 * np.sqrt(torque_sizes.max() * torque_sizes[joint % joints])
        values[index] = 0.2 * size * random.normal() if name.startswith("Fo") else size * random.uniform(0.3, 1.5)
    return values


def noise_sizes(torque):
    """Standard deviation of what lasts in the noise of each joint; the white part is `WHITE` times as large."""
    return NOISE * (np.sqrt((torque**2).mean(axis=0)) + 0.05 * np.sqrt((torque**2).mean()))


def recorded(model, truth, moved, random, memory=MEMORY, processing=None, rows=None, standstill=0.0, stribeck=STRIBECK):
    """An Information of a motion, and its stretches; with options of processing, that of a log of its positions.

    Rows slower than `standstill` are left out; `rows` makes both from samples, as an estimator with rows of its own.
    """
    t, q, dq, ddq = moved
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    size = noise_sizes(torque)
    lasting = lfilter([np.sqrt(1 - memory**2)], [1, -memory], random.normal(size=torque.shape), axis=0)
    torque = torque + size * (WHITE * random.normal(size=torque.shape) + lasting)
    torque += stribeck * size * np.sign(dq) * np.exp(-((dq / 0.1) ** 2))
    blocks = TimeBlocks(empty_factors(model))
    mask = np.abs(dq) > standstill if standstill else None
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t, mask=mask)
    if processing is not None:
        options = {"cutoff": 0.2 * RATE, "velocity_threshold": "none", **processing}
        samples = sy.Recording(t=t, q=q, torque=torque).process(Processing.from_dict(options, "processing"), model)
    if rows is not None:
        return rows(model, samples)
    info = sy.Information.from_chunks(model, [samples], blocks=blocks)
    return info, info.stretches(blocks)


class Experiment:
    """An arm, what is told of it, what is true, and a log of a motion."""

    def __init__(
        self, name, kind, knowledge, seed, memory=MEMORY, processing=None, rows=None, standstill=0.0, stribeck=STRIBECK
    ):
        key = {"rich": 0, "ordinary": 1, "weak": 2}[kind]
        self.random = random = np.random.default_rng([seed, zlib.crc32(name.encode()), key])
        robot = described(name)
        self.given = given = blurred(robot, random)
        if knowledge == "kinematics":
            links = tuple(replace(link, inertia=None, own_inertia=None) for link in given.links)
            self.given = given = replace(given, links=links)
        terms = (sy.Viscous(), sy.Coulomb(), sy.Offset())
        self.model = sy.Model(given.with_terms(*terms))
        true_model = sy.Model(robot.with_terms(*terms))
        self.moved = motion(given, random, kind)
        bodies = np.nan_to_num(np.asarray(true_model.robot.parameters))
        sizes = np.sqrt((true_model.inverse_dynamics(*self.moved[1:], bodies) ** 2).mean(axis=0)) + 1e-3
        self.truth = truth_of(robot, self.model, sizes, random)
        self.info, self.stretches = recorded(
            self.model, self.truth, self.moved, random, memory, processing, rows, standstill, stribeck
        )


def case(name, kind, knowledge, seed):
    """One identification: figures of what must hold."""
    experiment = Experiment(name, kind, knowledge, seed)
    given, model, truth, random = experiment.given, experiment.model, experiment.truth, experiment.random
    info, stretches = experiment.info, experiment.stretches
    other = [recorded(model, truth, motion(given, random, k), random)[0] for k in ("rich", kind)]
    feasible_set = sy.FeasibleSet(model)
    unconstrained = sy.least_squares(info)
    start = time.perf_counter()
    prior = physical_prior(model)
    tried = tried_prior(info, stretches, feasible_set, unconstrained, prior=prior)
    found = plausible_fit(info, feasible_set, unconstrained, tried)
    table = parameter_table(info, found.plausible_set, found.estimate, unconstrained, term_scales=found.term_deviations)
    seconds = time.perf_counter() - start
    free = fit_reduced(info.reduced("joint"), feasible_set)
    known = sy.fit(
        info,
        found.plausible_set,
        prior=sy.estimators.EntropicPrior(found.prior.parameters, term_deviations=found.term_deviations),
        prior_weight=1e9,
    )
    masses = found.estimate.parameters[feasible_set.mass_indices]
    true_masses = truth[feasible_set.mass_indices]
    references = np.array([link.inertia.mass for link in given.links]) if knowledge == "cad" else true_masses
    names = {str(n): v for n, v in zip(model.parameter_names, truth, strict=True)}
    inside = [row.lower <= names[row.name] <= row.upper for row in table if row.name in names]
    errors = {
        what: [o.relative_error(base) for o in other]
        for what, base in (
            ("ours", found.estimate.base),
            ("ls", unconstrained.base),
            ("free", free.base),
            ("prior", known.base),
        )
    }
    com = [bool(row.lower <= row.value <= row.upper) for row in table if row.name.startswith("c")]
    return {
        "errors": errors,
        "total": masses.sum() / (references.sum() if knowledge == "cad" else true_masses.sum()),
        "total_true": masses.sum() / true_masses.sum(),
        "ratios": masses / references,
        "inside": float(np.mean(inside)),
        "measured": [table.count(b) for b in ("measured", "bounded", "assumed")],
        "seconds": seconds,
        "com": all(com),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", default=",".join(ARMS))
    parser.add_argument("--knowledge", default="cad,kinematics")
    parser.add_argument("--seeds", type=int, default=1)
    options = parser.parse_args()
    for knowledge in options.knowledge.split(","):
        worse, totals, extremes, inside, above = [], [], [], [], []
        print(f"\n{knowledge}: error on a rich and on a like motion, % (ours, least squares, feasible, prior)")
        for name in options.arms.split(","):
            for kind in MOTIONS:
                for seed in range(options.seeds):
                    found = case(name, kind, knowledge, seed)
                    errors = found["errors"]
                    ratio = [errors["ours"][k] / min(errors[w][k] for w in ("ls", "free", "prior")) for k in (0, 1)]
                    worse.append(ratio)
                    totals.append(found["total"])
                    extremes.append((found["ratios"].min(), found["ratios"].max()))
                    inside.append(found["inside"])
                    if kind == "rich":
                        above.append(100 * (errors["ours"][0] - errors["ls"][0]))
                    row = "  ".join(
                        f"{100 * errors[w][0]:8.3g}/{100 * errors[w][1]:<6.3g}" for w in ("ours", "ls", "free", "prior")
                    )
                    low, high = extremes[-1]
                    print(
                        f"{name:7}{kind:9}{row} ratio {ratio[0]:.2f} {ratio[1]:.2f}  total {found['total']:.2f}"
                        f"  links {low:.2f} to {high:.2f}  inside {100 * found['inside']:.0f} %"
                        f"  m/b/a {found['measured']}  {found['seconds']:.2f} s",
                        flush=True,
                    )
        worse = np.array(worse)
        of = "CAD" if knowledge == "cad" else "the truth"
        print(
            f"{knowledge}: held-out error over the best: median {np.median(worse[:, 0]):.2f} on rich and "
            f"{np.median(worse[:, 1]):.2f} on like motions, worst {worse[:, 0].max():.2f} and "
            f"{worse[:, 1].max():.2f};\n"
            f"total mass {min(totals):.2f} to {max(totals):.2f} of {of}, links "
            f"{min(e[0] for e in extremes):.2f} to {max(e[1] for e in extremes):.2f};\n"
            f"above least squares on rich motions by at most {max(above):.2f} points; "
            f"intervals hold {100 * np.mean(inside):.1f} % of the parameters."
        )


if __name__ == "__main__":
    main()
