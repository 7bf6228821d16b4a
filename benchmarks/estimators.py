"""Estimators side by side on logs of a closed loop with encoder noise and no careful filter: bias, spread and time.

An arm of three joints follows a motion of five harmonics below 0.5 Hz for 8 s under proportional and derivative control
at 500 Hz, with encoder noise of 0.1 mrad, which the controller turns into torques as well. Pinocchio simulates it with
a Runge-Kutta method of its own, Coulomb friction with an exact sign: the truth shares no code with the estimators. The
positions go through a filter at 60 Hz, a hundred times above the motion, and are derived by differences. Only the noise
is different from one log to the next.

Printed, of the certified answers of each estimator: the largest bias over the base parameters in standard errors, that
is the mean error over the logs over the mean standard error that the estimates tell; the same over the true spread of
the estimates; the share of 95 % intervals that hold the truth; the root mean square of the errors, relative to
instrumental variables; how many answers are proved feasible, and how many did not converge; and the median of the
processor time and its ratio to the first.

    python benchmarks/estimators.py --results estimators.jsonl      # 100 logs; a run that was stopped goes on
    python benchmarks/estimators.py --logs 10 --only "least squares" "instrumental variables"
"""

import argparse
import dataclasses
import json
import tempfile
import time
from functools import cached_property
from pathlib import Path

import numpy as np

import steelyard as sy
from steelyard.control import ClosedLoop, FilteredDifference, JointFeedback
from steelyard.control.closed_loop import without_standstill
from steelyard.estimators import (
    energy,
    energy_information,
    likelihood_information,
    maximum_likelihood,
    momentum,
    momentum_information,
    total_least_squares,
)
from steelyard.feasibility import verify_document

URDF = """<robot name="elbow"><link name="base"/>
<link name="shoulder"><inertial><origin xyz="0.01 -0.05 0.02"/><mass value="8"/>
  <inertia ixx="0.06" iyy="0.05" izz="0.05" ixy="0.002" ixz="0.001" iyz="-0.003"/></inertial></link>
<link name="upper"><inertial><origin xyz="0.18 0.02 0.03"/><mass value="6"/>
  <inertia ixx="0.02" iyy="0.09" izz="0.09" ixy="0.004" ixz="-0.002" iyz="0.001"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.15 -0.01 0.02"/><mass value="3"/>
  <inertia ixx="0.006" iyy="0.03" izz="0.03" ixy="0.001" ixz="0.0005" iyz="0.0003"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="shoulder"/><origin xyz="0 0 0.4"/>
  <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="900" velocity="90"/></joint>
<joint name="j2" type="revolute"><parent link="shoulder"/><child link="upper"/>
  <origin xyz="0 0.1 0.1" rpy="1.5707963267948966 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="900" velocity="90"/></joint>
<joint name="j3" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="900" velocity="90"/></joint></robot>"""
VISCOUS, COULOMB = np.array([3.0, 2.5, 1.2]), np.array([4.0, 3.0, 1.5])
KP, KD, VELOCITY_CUTOFF = np.array([2000.0, 2000.0, 400.0]), np.array([80.0, 80.0, 16.0]), 50.0
TICK, SUBSTEPS, DURATION, NOISE = 2e-3, 8, 8.0, 1e-4
CUTOFF, THRESHOLD = 60.0, 0.1
"""Hz, of the filter of the positions; rad/s, below which rows are left out: by the velocity of the simulated motion,
of balances, which have none, by the measured one."""


class Reference:
    """Five harmonics below 0.5 Hz in each joint, from rest, within 1.2 rad."""

    def __init__(self):
        random = np.random.default_rng(3)
        self.sines, self.cosines = random.normal(size=(2, 3, 5))
        self.speeds = 2 * np.pi * 0.1 * np.arange(1, 6)
        self.scale = 1.2 / np.abs(self._wave(np.arange(0.0, 10.0, 0.01))[0]).max(axis=0)

    def _wave(self, t, scale=1.0):
        angles = np.asarray(t, dtype=float)[..., None, None] * self.speeds
        sines, cosines = np.sin(angles), np.cos(angles)
        q = self.sines * sines + self.cosines * cosines
        dq = (self.sines * cosines - self.cosines * sines) * self.speeds
        ddq = -q * self.speeds**2
        return tuple(scale * part.sum(axis=-1) for part in (q, dq, ddq))

    @cached_property
    def ticks(self):
        """What `__call__` gives at each tick of the controller, which asks for one after the other."""
        return self(np.arange(round(DURATION / TICK) + 2) * TICK)

    def __call__(self, t):
        """q, dq and ddq, (..., 3) each: the wave, blended in within the first second."""
        if np.ndim(t) == 0 and t > 0.0:
            return tuple(part[round(t / TICK)] for part in self.ticks)
        t = np.asarray(t, dtype=float)
        (q, dq, ddq), (first, _, _) = self._wave(t, self.scale), self._wave(0.0, self.scale)
        r = np.clip(t, 0.0, 1.0)[..., None]
        rise, slope, bend = r**3 * (10 - 15 * r + 6 * r**2), 30 * r**2 * (1 - r) ** 2, 60 * r * (1 - r) * (1 - 2 * r)
        away = q - first
        return first + rise * away, rise * dq + slope * away, rise * ddq + 2 * slope * dq + bend * away


class Laboratory:
    """The arm, its controller, and logs of it that Pinocchio simulates."""

    def __init__(self, duration=DURATION, threshold=THRESHOLD):
        self.threshold = threshold
        self.reference = Reference()
        self.times = np.arange(round(duration / TICK) + 1) * TICK
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "elbow.urdf"
            path.write_text(URDF)
            robot = sy.Robot.from_urdf(path).with_terms(sy.Viscous(), sy.Coulomb())
        self.model = sy.Model(robot)
        truth = np.array(robot.parameters)
        names = list(self.model.parameter_names)
        for joint in range(3):
            truth[names.index(f"Fvj{joint + 1}")] = VISCOUS[joint]
            truth[names.index(f"Fcj{joint + 1}")] = COULOMB[joint]
        self.base = self.model.base_parameters().values(truth)
        self.feasible_set = sy.FeasibleSet(self.model)

    def log(self, seed, noise=NOISE):
        """The measured positions and the torques that were commanded, (S, 3) each."""
        import pinocchio

        random = np.random.default_rng([seed, 7])
        arm = pinocchio.buildModelFromXML(URDF)
        data = arm.createData()
        wanted, speeds, _ = self.reference(self.times)
        q, dq, estimated, last = wanted[0].copy(), np.zeros(3), np.zeros(3), None
        keep, step = np.exp(-2 * np.pi * VELOCITY_CUTOFF * TICK), TICK / SUBSTEPS
        measured, torques = np.empty((2, len(self.times), 3))

        def acceleration(q, dq, torque):
            return pinocchio.aba(arm, data, q, dq, torque - VISCOUS * dq - COULOMB * np.sign(dq))

        for k in range(len(self.times)):
            seen = q + noise * random.normal(size=3)
            if last is not None:
                estimated = estimated + (1.0 - keep) * ((seen - last) / TICK - estimated)
            last = seen
            torque = KP * (wanted[k] - seen) + KD * (speeds[k] - estimated)
            measured[k], torques[k] = seen, torque
            for _ in range(SUBSTEPS):
                a1 = acceleration(q, dq, torque)
                v2 = dq + step / 2 * a1
                a2 = acceleration(q + step / 2 * dq, v2, torque)
                v3 = dq + step / 2 * a2
                a3 = acceleration(q + step / 2 * v2, v3, torque)
                v4 = dq + step * a3
                a4 = acceleration(q + step * v3, v4, torque)
                q, dq = q + step / 6 * (dq + 2 * v2 + 2 * v3 + v4), dq + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        return measured, torques

    def process(self, recording):
        """Torques that are held act half a sample later: at an instant, on average, those before and after it do."""
        torque = np.vstack([recording.torque[:1], 0.5 * (recording.torque[1:] + recording.torque[:-1])])
        options = {"cutoff": CUTOFF, "velocity_threshold": None, "trim": 0.25}
        return sy.Recording(t=recording.t, q=recording.q, torque=torque).process(**options)

    def samples(self, seed):
        """What a user has of a log."""
        q, torque = self.log(seed)
        return self.process(sy.Recording(t=self.times, q=q, torque=torque))

    @cached_property
    def loop(self):
        """The closed loop as our simulation makes it; without the noise."""
        velocity = FilteredDifference(VELOCITY_CUTOFF)
        controller = JointFeedback(self.reference, kp=KP, kd=KD, count=3, sample_time=TICK, velocity=velocity)
        start = self.reference(0.0)[0]
        return ClosedLoop(
            self.model,
            controller,
            self.times,
            start,
            process=self.process,
            velocity_threshold=self.threshold,
            position_noise=NOISE,
        )


def with_information(estimate):
    return lambda lab, samples: estimate(sy.Information.from_samples(lab.model, samples), lab.feasible_set)


# By name: from the laboratory and the samples of a log to an estimate. Each neighbour's estimator is a line here.
ESTIMATORS = {
    "least squares": with_information(sy.fit),
    "maximum likelihood": lambda lab, samples: maximum_likelihood(
        likelihood_information(lab.model, samples), lab.feasible_set
    ),
    "balance of momentum": lambda lab, samples: momentum(
        momentum_information(lab.model, without_standstill(samples, lab.threshold)), lab.feasible_set
    ),
    "balance of energy": lambda lab, samples: energy(energy_information(lab.model, samples), lab.feasible_set),
    "total least squares": with_information(total_least_squares),
    "instrumental variables": lambda lab, samples: sy.instrumental_variables(samples, lab.feasible_set, lab.loop),
    "the same, from the reference": lambda lab, samples: sy.instrumental_variables(
        samples, lab.feasible_set, lab.loop.reference_motion
    ),
    "output error, torques": lambda lab, samples: sy.output_error(samples, lab.feasible_set, lab.loop),
    "output error, positions": lambda lab, samples: sy.output_error(
        samples, lab.feasible_set, lab.loop, output="position"
    ),
}


@dataclasses.dataclass
class Tally:
    """What one estimator said of all logs."""

    errors: list = dataclasses.field(default_factory=list)
    deviations: list = dataclasses.field(default_factory=list)
    seconds: list = dataclasses.field(default_factory=list)
    proved: int = 0
    unfinished: int = 0

    def add(self, trial):
        self.errors.append(trial["error"])
        self.deviations.append(trial["standard_error"])
        self.seconds.append(trial["seconds"])
        self.proved += trial["proved"]
        self.unfinished += trial["unfinished"]


def tried(laboratory, samples, name):
    """What one estimator said of a log, as plain numbers."""
    start = time.process_time()
    estimate = ESTIMATORS[name](laboratory, samples)
    seconds = time.process_time() - start
    return {
        "error": (estimate.base - laboratory.base).tolist(),
        "standard_error": np.asarray(estimate.standard_error).tolist(),
        "seconds": seconds,
        "proved": verify_document(estimate.certificate).valid,
        "unfinished": any("did not converge" in remark for remark in estimate.remarks),
    }


def figures(tally):
    """Bias over standard errors, over the spread, of the mean; coverage."""
    errors, deviations = np.array(tally.errors), np.array(tally.deviations)
    bias, told, spread = errors.mean(axis=0), deviations.mean(axis=0), errors.std(axis=0, ddof=min(1, len(errors) - 1))
    return {
        "bias": bias / told,
        "bias over spread": bias / np.where(spread > 0.0, spread, np.inf),
        "covered": float(np.mean(np.abs(errors) <= 1.96 * deviations)),
        "size": np.sqrt(np.mean(errors**2, axis=0)),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=100)
    parser.add_argument("--threshold", type=float, default=THRESHOLD, help="rad/s, of the rows that are left out")
    parser.add_argument("--first", type=int, default=1, help="seed of the first log")
    parser.add_argument("--only", nargs="*", choices=list(ESTIMATORS), default=list(ESTIMATORS))
    parser.add_argument("--results", type=Path, help="where results are kept, so that a run can go on later")
    arguments = parser.parse_args()
    laboratory, tallies = Laboratory(threshold=arguments.threshold), {name: Tally() for name in arguments.only}
    laboratory.loop(laboratory.base)  # compiles, which is not part of the times
    kept = arguments.results
    lines = kept.read_text().splitlines() if kept is not None and kept.exists() else []
    done = {(one["name"], one["seed"], one["threshold"]): one for one in map(json.loads, lines)}
    for seed in range(arguments.first, arguments.first + arguments.logs):
        missing = [name for name in tallies if (name, seed, arguments.threshold) not in done]
        samples = laboratory.samples(seed) if missing else None
        for name in missing:
            key = {"name": name, "seed": seed, "threshold": arguments.threshold}
            done[tuple(key.values())] = key | tried(laboratory, samples, name)
            if kept is not None:
                with kept.open("a") as file:
                    file.write(json.dumps(done[tuple(key.values())]) + "\n")
        for name, tally in tallies.items():
            tally.add(done[name, seed, arguments.threshold])
        if seed % 10 == 0:
            print(f"{seed} logs", flush=True)
    told = {name: figures(tally) for name, tally in tallies.items()}
    names = laboratory.model.base_parameters().expressions
    first, beside = (
        next(iter(tallies)),
        next((n for n in tallies if n == "instrumental variables"), next(iter(tallies))),
    )
    quickest = np.median(tallies[first].seconds)
    print(
        f"{'':30} {'bias / s.e.':>12} {'/ spread':>9} {'covered':>8} {'error':>7} {'proved':>9} {'unfinished':>10} "
        f"{'time':>8} {'ratio':>6}"
    )
    for name, tally in tallies.items():
        found, count = told[name], len(tally.errors)
        worst = int(np.argmax(np.abs(found["bias"])))
        seconds = float(np.median(tally.seconds))
        size = float(np.median(found["size"] / told[beside]["size"]))
        print(
            f"{name:30} {found['bias'][worst]:12.2f} {np.abs(found['bias over spread']).max():9.2f} "
            f"{found['covered']:8.1%} {size:7.2f} {tally.proved:5}/{count:<3} {tally.unfinished:10} {seconds:7.2f}s "
            f"{seconds / quickest:6.1f}   {names[worst][:40]}"
        )
    print("bias of each base parameter, in standard errors, in the order of the table:")
    for index, name in enumerate(names):
        row = " ".join(f"{found['bias'][index]:8.2f}" for found in told.values())
        print(f"{name[:44]:44} {laboratory.base[index]:9.4f} {row}")


if __name__ == "__main__":
    main()
