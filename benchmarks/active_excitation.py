"""How soon excitation on the fly knows a robot as well as trajectory A does, from no knowledge but the kinematics.

    python benchmarks/active_excitation.py [--seeds 20] [--criterion prediction] [--json FILE]
    python benchmarks/active_excitation.py --example ur5 [--seeds 20]

The seven-joint WAM of the thesis is simulated with random masses, friction and rotors. Trajectory A (thesis table 4.4)
takes 37.5 s. It is followed perfectly ("A"), as only a controller can that knows the robot, and beside it in closed
loop by the controller of the thesis (eq. 4.16 to 4.18), which knows the masses exactly and no friction ("A played").
Excitation on the fly starts at rest with the kinematics alone, is simulated in closed loop, and must stay within the
positions, velocities and accelerations that trajectory A itself has, and within the torques of the drives. All have the
same encoders, the same noise of the torques, the same filters and the same estimator: the feasible fit without a prior.

With `--example` the robot is that of `steelyard example`, with a velocity of 2.5 and an acceleration of 8, moved until
2 % of torque error are expected: its bodies deviate by 0.3 from those of the description (seed 0: they are those), it
has the friction of the description, and it begins within a tenth of the ranges about their middles (seed 0: there).
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

import steelyard as sy
from steelyard.control import FeedforwardTracking, FilteredDifference
from steelyard.excitation import MotionLimits, RestToRestTrajectory
from steelyard.identification import wam
from steelyard.identification.default_terms import model_of_estimate
from steelyard.identification.examples import deviating, write_example
from steelyard.identification.saved import parameters_of_description
from steelyard.online import ActiveExcitation
from steelyard.online.credible_robots import random_motions
from steelyard.recording import Recording
from steelyard.robot import RobotFile
from steelyard.simulation import Event, Sensors, simulate

TORQUE = (77.3, 160.6, 95.6, 29.4, 11.6, 11.6, 2.7)  # N·m, of the drives of the arm
DURATION = 37.5  # s, of trajectory A
TRIM = 0.5  # s
MEASURES = {
    "torque on trajectory B": "|tau - W beta| / |tau| over all joints on trajectory B, without noise",
    "mean of the joints on B": "mean over the joints of their relative errors on trajectory B",
    "torque on random motions": "|tau - W beta| / |tau| on random motions within the limits, without noise",
    "noise-weighted, random": "root mean square of the same errors, each joint in units of its noise",
    "base parameters": "|beta - truth| / |truth|",
}


def random_truth(seed: int) -> np.ndarray:
    """Bodies that deviate by 0.3 from those of the arm, friction and rotors by factors with a deviation of 0.4."""
    random = np.random.default_rng([seed, 8100])
    model = wam.wam_model()
    values = wam.true_parameters()
    found = values.copy()
    for columns in model.link_columns:
        columns = np.asarray(columns)
        found[columns] = deviating(sy.Inertia.from_parameters(values[columns]), 0.3, random).parameters
    links = set(np.asarray(model.link_columns).ravel().tolist())
    for column in set(range(len(values))) - links:
        found[column] *= np.exp(0.4 * random.standard_normal())
        if model.parameter_names[column].startswith("Fo"):
            found[column] *= random.choice([-1.0, 1.0])
    return found


class Judge:
    """Errors of an estimate, by motions that were not used for it."""

    def __init__(self, model: sy.Model, limits: MotionLimits, truth: np.ndarray) -> None:
        self.base = model.base_parameters().values(truth)
        self.noise = wam._TORQUE_DEVIATION
        kernel = model.kernel("regressor", base=True)
        trajectory_b = wam.TRAJECTORIES["B"].sample(20.0)[1:]
        self.rows = [
            np.asarray(kernel(*motion)).reshape(len(motion[0]), model.dof, -1)
            for motion in (trajectory_b, random_motions(limits, 1000, 77))
        ]

    def errors(self, base: np.ndarray) -> list[float]:
        on_b, on_random = (rows @ (base - self.base) for rows in self.rows)
        true_b, true_random = (rows @ self.base for rows in self.rows)
        norm = np.linalg.norm
        return [
            float(norm(on_b) / norm(true_b)),
            float(np.mean(norm(on_b, axis=0) / norm(true_b, axis=0))),
            float(norm(on_random) / norm(true_random)),
            float(np.sqrt(np.mean((on_random / self.noise) ** 2))),
            float(norm(base - self.base) / norm(self.base)),
        ]


def process(model: sy.Model, recording: Recording) -> sy.Samples:
    """The filters of the thesis (section 4.3.3), of torques and regressor too, without joints that stick."""
    return recording.process(model=model, cutoff=4.8, order=3, trim=TRIM, torque_cutoff=4.8, velocity_threshold=0.05)


def estimated(model: sy.Model, information: sy.Information) -> np.ndarray:
    return np.asarray(sy.fit(information, sy.FeasibleSet(model)).base)


def sensors() -> Sensors:
    return Sensors(
        encoder_resolution=2.0 * np.pi / wam.ENCODER_COUNTS,
        velocity="none",
        torque_noise=wam._TORQUE_DEVIATION,
        torque_time_constant=wam._TORQUE_TIME_CONSTANT,
    )


def played_a(model: sy.Model, truth: np.ndarray, seed: int) -> Recording:
    """Trajectory A in closed loop, with ramps that are left out; gains act through the true inertia matrix."""
    links = np.asarray(model.link_columns).ravel()
    known = np.zeros_like(truth)
    known[links] = truth[links]
    motion = RestToRestTrajectory(wam.TRAJECTORIES["A"], 2.0, 3)
    controller = FeedforwardTracking(
        model, known, motion, kp=2500.0, kd=80.0, coupled=True, velocity=FilteredDifference(60.0)
    )
    begin = motion.motion([0.0])[0][0]
    result = simulate(model, truth, begin, np.zeros(model.dof), 41.5, controller, sensors=sensors(), seed=seed)
    rows = slice(2000, 39500)
    return Recording(
        t=result.t[rows] - result.t[2000], q=result.measured.q[rows], torque=result.measured.torque[rows], source="A"
    )


def violations(result: object, limits: MotionLimits, excitation: ActiveExcitation) -> dict[str, float]:
    """Largest use of every limit, 1 at the limit: of the true states, and of the reference for accelerations."""
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    reference = np.array(excitation.played)
    change = np.diff(reference, 2, axis=0) / excitation.sample_time**2
    for time_, _ in excitation.interruptions:  # where the motion is broken off, it goes on from the measured state
        change[max(round(time_ / excitation.sample_time) - 3, 0) : round(time_ / excitation.sample_time) + 3] = 0.0
    return {
        "position": float((np.abs(result.q - middle) / half).max()),
        "velocity": float((np.abs(result.dq) / limits.velocity).max()),
        "torque": float((np.abs(result.torque) / limits.torque).max()),
        "reference acceleration": float((np.abs(change) / limits.acceleration).max()),
    }


def reach(table: np.ndarray, bounds: list[float]) -> list[list[float]]:
    """Times from which on the errors stay below bounds, and at which they were first below."""
    found = []
    for k, bound in enumerate(bounds):
        below = table[:, 1 + k] <= bound
        above = np.flatnonzero(~below)
        after = 0 if not len(above) else int(above[-1]) + 1
        first = int(np.argmax(below)) if below.any() else len(table)
        found.append([float(table[i, 0]) if i < len(table) else float("inf") for i in (after, first)])
    return found


def one(seed: int, criterion: str) -> dict[str, object]:
    began = time.perf_counter()
    model, truth = wam.wam_model(), random_truth(seed)
    limits = MotionLimits.envelope([wam.TRAJECTORIES["A"]], model.robot.joint_names, 1000.0).updated(
        {"torque": list(TORQUE)}
    )
    judge = Judge(model, limits, truth)
    of_a = process(model, wam.simulated_log(model, "A", seed, parameters=truth))
    info_a = sy.Information.from_samples(model, of_a)
    errors_a = judge.errors(estimated(model, info_a))

    info_played = sy.Information.from_samples(model, process(model, played_a(model, truth, seed)))
    errors_played = judge.errors(estimated(model, info_played))
    random = np.random.default_rng([seed, 1])
    half = 0.5 * (limits.upper - limits.lower)
    start = limits.lower + half * (1.0 + 0.2 * random.uniform(-1.0, 1.0, model.dof))
    # It would go on beyond: no motion ends at rest before.
    excitation = ActiveExcitation(model, limits, accuracy=1e-6, longest=2 * DURATION, criterion=criterion, seed=seed)
    result = simulate(model, truth, start, np.zeros(model.dof), DURATION, excitation, sensors=sensors(), seed=seed)
    whole, curve = excitation.recording, []
    for duration in np.arange(10.5, DURATION + 1e-9, 3.0):  # as if it had ended there
        rows = slice(0, int(1000 * duration))
        part = Recording(t=whole.t[rows], q=whole.q[rows], torque=whole.torque[rows], source="part")
        information = sy.Information.from_samples(model, process(model, part), batch_means=False)
        curve.append([duration, *judge.errors(estimated(model, information))])
    table = np.array(curve)
    reached, reached_played = reach(table, errors_a), reach(table, errors_played)
    return {
        "seed": seed,
        "status": result.status.value,
        "of A": errors_a,
        "condition of A": info_a.condition_number,
        "condition": information.condition_number,
        "of A played": errors_played,
        "reached": reached,
        "reached played": reached_played,
        "final": curve[-1][1:],
        "curve": curve,
        "used": violations(result, limits, excitation),
        "interruptions": excitation.interruptions,
        "expected": [(step.time, step.expected_error) for step in excitation.steps],
        "seconds": time.perf_counter() - began,
    }


def of_example(name: str, folder: Path, seed: int) -> dict[str, object]:
    """Excite a robot of the examples on the fly until 2 % are expected, for 60 s at most."""
    whole = model_of_estimate(None, RobotFile.load(folder / "robot.toml")).without_channels
    limits = MotionLimits.from_robot(whole.robot).updated({"velocity": 2.5, "acceleration": 8.0})
    links = tuple(replace(link, inertia=None, own_inertia=None) for link in whole.robot.links)
    model = sy.Model(replace(whole.robot, links=links))
    truth, random = parameters_of_description(whole), np.random.default_rng([seed, 8100])
    lower, upper = limits.ranges
    start = 0.5 * (lower + upper)
    if seed:
        for columns in map(np.asarray, model.link_columns):
            truth[columns] = deviating(sy.Inertia.from_parameters(truth[columns]), 0.3, random).parameters
        start = start + 0.1 * (upper - lower) * random.uniform(-1.0, 1.0, model.dof)
    motions = random_motions(limits, 400, 1)
    torques = np.asarray(model.inverse_dynamics(*motions, truth))
    noise = 0.01 * np.sqrt(np.mean(torques**2, axis=0))
    excitation = ActiveExcitation(model, limits, seed=seed)
    result = simulate(
        model,
        truth,
        start,
        np.zeros(model.dof),
        75.0,
        excitation,
        sensors=Sensors(encoder_resolution=2.0 * np.pi / 2**17, velocity="none", torque_noise=noise),
        events=(Event(lambda t, q, dq: max(t - excitation.end - 0.1, -1.0), "finished", direction=1),),
        seed=seed,
    )
    found = excitation.estimate
    assert found is not None
    errors = np.asarray(model.inverse_dynamics(*motions, found.parameters)) - torques
    return {
        "robot": name,
        "seed": seed,
        "status": result.status.value,
        "expected": excitation.expected_error,
        "error": float(np.linalg.norm(errors) / np.linalg.norm(torques)),
        "time": excitation.steps[-1].time,
        "used": violations(result, limits, excitation),
        "interruptions": excitation.interruptions,
    }


def examples(name: str, seeds: range, file: Path | None) -> None:
    runs = []
    with tempfile.TemporaryDirectory() as place:
        folder = write_example(name, Path(place) / name)
        for seed in seeds:
            runs.append(run := of_example(name, folder, seed))
            used = ", ".join(f"{limit} {share:.2f}" for limit, share in run["used"].items())
            print(
                f"{name} {seed:2d}: {run['expected']:.3%} expected, {run['error']:.3%} true after {run['time']:.1f} s; "
                f"used: {used}; broken off {len(run['interruptions'])} times",
                flush=True,
            )
            if file is not None:
                file.write_text(json.dumps(runs))
    for limit in runs[0]["used"]:
        most = [run["used"][limit] for run in runs]
        print(f"largest use of the limits of {limit}: {max(most):.3f} (1 is the limit), median {np.median(most):.3f}")
    for key in ("time", "error", "expected"):
        print(f"{key}: median {np.median([run[key] for run in runs]):.4g}, worst {max(run[key] for run in runs):.4g}")
    print("runs that were broken off:", sum(bool(run["interruptions"]) for run in runs), "of", len(runs))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--criterion", default="prediction")
    parser.add_argument("--example", help="a robot of `steelyard example`, such as ur5, in place of the WAM")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.seeds)
    # The fits are of small matrices, which several threads compute fifty times as slowly on a busy machine.
    with threadpool_limits(1, "blas"):
        if asked.example is not None:
            examples(asked.example, seeds, asked.json)
        else:
            arms(seeds, asked.criterion, asked.json)


def arms(seeds: range, criterion: str, file: Path | None) -> None:
    runs = []
    for seed in seeds:
        run = one(seed, criterion)
        runs.append(run)
        times = " ".join(f"{after:5.1f}" for after, _ in run["reached"])
        used = ", ".join(f"{name} {share:.2f}" for name, share in run["used"].items())
        print(
            f"seed {seed:2d}: reached for good at {times} s; used: {used}; condition {run['condition']:.0f} "
            f"(A {run['condition of A']:.0f}); broken off {len(run['interruptions'])} times; {run['seconds']:.0f} s",
            flush=True,
        )
        if file is not None:
            file.write_text(json.dumps(runs))
    print(f"\nTrajectory A takes {DURATION} s. Motion time until its error is reached, over {len(runs)} robots:")
    heads = ("A", "on the fly", "median s", "worst s", "first s", "sooner", "A played", "median s", "worst s", "sooner")
    print(f"{'measure':26}" + "".join(f"{head:>11}" for head in heads))
    for k, name in enumerate(MEASURES):
        ideal, played, final = (np.median([run[key][k] for run in runs]) for key in ("of A", "of A played", "final"))
        good, other = (np.array([run[key][k][0] for run in runs]) for key in ("reached", "reached played"))
        first = np.median([run["reached"][k][1] for run in runs])
        cells = [f"{ideal:.4f}", f"{final:.4f}", f"{np.median(good):.1f}", f"{good.max():.1f}", f"{first:.1f}"]
        cells += [f"{np.sum(good < DURATION)}/{len(runs)}", f"{played:.4f}", f"{np.median(other):.1f}"]
        cells += [f"{other.max():.1f}", f"{np.sum(other < DURATION)}/{len(runs)}"]
        print(f"{name:26}" + "".join(f"{cell:>11}" for cell in cells))
    for name in runs[0]["used"]:
        print(f"largest use of the limits of {name}: {max(run['used'][name] for run in runs):.3f} (1 is the limit)")
    print(
        "condition number, median: A",
        np.median([run["condition of A"] for run in runs]).round(1),
        "on the fly",
        np.median([run["condition"] for run in runs]).round(1),
    )
    for name, text in MEASURES.items():
        print(f"{name}: {text}")


if __name__ == "__main__":
    main()
