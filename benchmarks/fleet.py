"""A fleet with planted faults: which robots `steelyard fleet` finds and names, how many wrongly, and how long it takes.

Arms of the package example-robot-data. Robots of one kind differ: links by 0.5 % (mass, centre of mass and inertia),
friction of each joint by 4 % as a whole and Coulomb and viscous friction by 4 % each, offsets by 2 % of the torques,
and friction near standstill, which the model does not have, by 30 %. A worn gearbox has more Coulomb and viscous
friction; a heavier link is so in all its parts; a joint of another gain reads all its torques, noise included, too
large by one factor. Each robot moves for one minute, in one of eight motions; torques have
white noise and noise that lasts for twenty samples. No differential equation is solved: torques follow from the motion
by the regressor. The logs are reduced to Informations, which is what the manifest names.

Gearboxes of all joints are worn in turn. The links that become heavier are those whose mass by itself shows: the
second to the fifth of the UR5. The first turns about the vertical, and a tenth of the last is 19 g.

    python benchmarks/fleet.py                                  # 1000 robots; 10 with a worn gearbox, 10 heavier
    python benchmarks/fleet.py --compare --seeds 2 3 4          # the comparison of siblings alone, without the fits
    python benchmarks/fleet.py --sizes --robots 300             # how detection falls with the size of the fault
    python benchmarks/fleet.py --gains --robots 100 --each 6    # torque gains of all joints in turn, of six sizes
    python benchmarks/fleet.py --drift --robots 100             # two dates; some robots change between them
    python benchmarks/fleet.py --batches --robots 100 --seeds 1 2 3    # a part of the robots has something in common
    python benchmarks/fleet.py --programmes --robots 12 --seeds 1 2 3  # a ripple that returns with the motion
    python benchmarks/fleet.py --batch 350                      # by the command, 350 of 1000 with another gearbox
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).resolve().parent))
from believable_answers import ARMS, described, description

import steelyard as sy
from steelyard.fleet import compare_siblings, gains_in_own_motion, possible_causes, variations
from steelyard.identification.examples import deviating
from steelyard.regression import ParameterCovariance, torque_gains
from steelyard.regression.parameter_covariance import NORMAL
from steelyard.regression.repeated_motion import MotionSums

RATE, SECONDS, MOTIONS = 100.0, 60.0, 8
LINKS, TOGETHER, SINGLE, OFFSET = 0.005, 0.04, 0.04, 0.02
NOISE, WHITE, MEMORY = 0.02, 0.7, 0.95
STANDSTILL, STANDSTILL_SPEED = 0.05, 0.03
"""Friction that falls off with speed: part of the Coulomb friction, and rad/s."""


RIPPLE, ORDERS = 0.03, (6.0, 9.6, 15.6, 25.2, 40.8)
"""A ripple that goes with the position: part of the torques of a joint, and periods in a radian times 2 pi."""

BATCH = ("gearbox", 2), 0.3
BATCHES = {"gearbox": 0.3, "rotor": 0.3, "link": 0.1, "gain": 0.1}
LINKS_THAT_SHOW = (2, 3, 4, 5)
DATES = ("2026-01-01", "2026-07-01")


class SimulatedFleet:
    """Robots of one kind, their motions, and what was planted in which."""

    def __init__(self, arm="ur5", seed=1, friction=TOGETHER, links=LINKS):
        robot = described(arm)
        self.model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia()))
        self.seed, self.friction, self.links = seed, friction, links
        random = np.random.default_rng([seed, 0])
        t = np.arange(0.0, SECONDS, 1.0 / RATE)
        self.motions = [self._motion(t, random) for _ in range(MOTIONS)]
        self.names = [str(name) for name in self.model.parameter_names]
        self.usual = self._usual()

    def _motion(self, t, random):
        n = self.model.dof
        w = 2.0 * np.pi * 0.1 * np.arange(1, 6)
        a, phase = random.uniform(0.3, 1.0, (5, n)) / w[:, None], random.uniform(0.0, 2.0 * np.pi, (5, n))
        angle = w[:, None] * t[:, None, None] + phase
        q, dq, ddq = (a * np.sin(angle), a * w[:, None] * np.cos(angle), -a * w[:, None] ** 2 * np.sin(angle))
        q, dq, ddq = (one.sum(axis=1) for one in (q, dq, ddq))
        scale = np.minimum(1.5 / np.abs(q).max(axis=0), 1.8 / np.abs(dq).max(axis=0))
        return q * scale, dq * scale, ddq * scale

    def _usual(self):
        """Links as described; friction of the size of a tenth of the torques of each joint; rotors."""
        model = self.model
        values = np.nan_to_num(np.asarray(model.robot.parameters))
        size = np.sqrt(np.mean(model.inverse_dynamics(*self.motions[0], values) ** 2, axis=0))
        size = np.maximum(size, 0.1 * size.max())
        mass = np.diagonal(model.inertia_matrix(self.motions[0][0][::50], values), axis1=1, axis2=2).mean(axis=0)
        for k in range(model.dof):
            for symbol, value in (("Fcj", 0.15 * size[k]), ("Fvj", 0.1 * size[k]), ("Ia", 0.4 * mass[k])):
                values[self.names.index(f"{symbol}{k + 1}")] = value
        self.sizes = size
        return values

    def parameters(self, number, fault=None, size=0.0):
        """The true parameters of a robot, what its friction near standstill is, and what its other draws come from."""
        model, names = self.model, self.names
        random = np.random.default_rng([self.seed, 1, number])
        values = self.usual.copy()
        for columns in model.link_columns:
            values[columns] = deviating(sy.Inertia.from_parameters(values[columns]), self.links, random).parameters
        standstill = STANDSTILL * np.exp(0.3 * random.normal(size=model.dof))
        for k in range(model.dof):
            together = np.exp(self.friction * random.normal())
            for symbol in ("Fcj", "Fvj"):
                values[names.index(f"{symbol}{k + 1}")] *= together * np.exp(SINGLE * random.normal())
            values[names.index(f"Foj{k + 1}")] = OFFSET * self.sizes[k] * random.normal()
        if fault is not None and fault[0] == "gearbox":
            for symbol in ("Fcj", "Fvj"):
                values[names.index(f"{symbol}{fault[1]}")] *= 1.0 + size
        elif fault is not None and fault[0] == "rotor":
            values[names.index(f"Ia{fault[1]}")] *= 1.0 + size
        elif fault is not None and fault[0] == "link":
            values[model.link_columns[fault[1] - 1]] *= 1.0 + size
        return values, standstill, random

    def robot(self, number, fault=None, size=0.0, epoch=0):
        """The Information of a robot's minute.

        `fault` is None or ("gearbox", joint), ("rotor", joint), ("link", link) or ("gain", joint), from one.
        """
        model, names = self.model, self.names
        values, standstill, random = self.parameters(number, fault, size)
        motion = self.motions[int(random.integers(MOTIONS))]
        torque = model.inverse_dynamics(*motion, values)
        dq = motion[1]
        coulomb = np.array([values[names.index(f"Fcj{k + 1}")] for k in range(model.dof)])
        torque = torque + standstill * coulomb * np.sign(dq) / (1.0 + (dq / STANDSTILL_SPEED) ** 2)
        noise = np.random.default_rng([self.seed, 2, number, epoch])
        lasting = lfilter([np.sqrt(1.0 - MEMORY**2)], [1.0, -MEMORY], noise.normal(size=torque.shape), axis=0)
        torque = torque + NOISE * self.sizes * (lasting + WHITE * noise.normal(size=torque.shape))
        if fault is not None and fault[0] == "gain":
            torque[:, fault[1] - 1] *= 1.0 + size
        q, dq, ddq = motion
        return sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))

    def programmed(self, number, odd, own):
        """The Information of a sound robot with a ripple, all robots but one in one motion, and its true parameters.

        The ripple is the same in all of them, or its `own`.
        """
        values, _, _ = self.parameters(number)
        q, dq, ddq = self.motions[int(number == odd)]
        torque = self.model.inverse_dynamics(q, dq, ddq, values)
        noise = np.random.default_rng([self.seed, 2, number])
        lasting = lfilter([np.sqrt(1.0 - MEMORY**2)], [1.0, -MEMORY], noise.normal(size=torque.shape), axis=0)
        torque += NOISE * self.sizes * (lasting + WHITE * noise.normal(size=torque.shape))
        ripple = np.random.default_rng([self.seed, 5, number if own else 0])
        for order in ORDERS:
            for wave in (np.cos, np.sin):
                amplitude = ripple.normal(size=q.shape[1]) / np.sqrt(len(ORDERS))
                torque += RIPPLE * self.sizes * amplitude * wave(order * q)
        samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=np.arange(len(q)) / RATE)
        return sy.Information.from_chunks(self.model, [samples], motion=MotionSums()), values

    def planted(self, count, each, kinds=("gearbox", "link")):
        """Which of the robots have which fault: (kind, number of the joint or link)."""
        chosen = np.random.default_rng([self.seed, 3]).permutation(count)[: len(kinds) * each]
        faults = []
        for kind in kinds:
            places = LINKS_THAT_SHOW if kind == "link" else range(1, 1 + self.model.dof)
            faults += [(kind, places[k % len(places)]) for k in range(each)]
        return dict(zip(map(int, chosen), faults, strict=True))

    def part(self, fault):
        """The name of the joint or link of a fault, and whether it is a gain."""
        kind, number = fault
        parts = self.model.robot.links if kind == "link" else self.model.robot.joints
        return parts[number - 1].name, kind == "gain"


def part_of(cause):
    """The same of what was found."""
    return cause.part, cause.kind == "gain"


def judged(fleet, planted, findings):
    """Of findings (robot, part, others that explain it as well), the surest of each robot first.

    Returns how many faults are found, named, and told among the others; false alarms.
    """
    first = {}
    for robot, part, others in findings:
        first.setdefault(robot, (part, others))
    told = {}
    for kind in dict.fromkeys(fault[0] for fault in planted.values()):
        own = {robot: fleet.part(fault) for robot, fault in planted.items() if fault[0] == kind}
        found = [robot for robot in own if robot in first]
        named = sum(first[robot][0] == own[robot] for robot in found)
        beside = sum(own[robot] in first[robot][1] and first[robot][0] != own[robot] for robot in found)
        told[kind] = (len(found), named, beside, len(own))
    return told, sorted(set(first) - set(planted))


def line(told, false):
    parts = [
        f"{kind}: {found} of {count} found, {named} named" + f", {beside} named second" * bool(beside)
        for kind, (found, named, beside, count) in told.items()
    ]
    return f"{', '.join(parts)}; false alarms: {len(false)}"


def by_command(arguments, seed, folder):
    """Write the fleet, call `steelyard fleet`, and judge its findings."""
    fleet = SimulatedFleet(arguments.arm, seed)
    planted = fleet.planted(arguments.robots, arguments.each)
    batch = [number for number in range(arguments.robots) if number not in planted][: arguments.batch]
    shutil.copy(description(arguments.arm), folder / "robot.urdf")
    terms = "".join(f'\n[[terms]]\nkind = "{term.kind}"\n' for term in fleet.model.robot.terms)
    (folder / "robot.toml").write_text(f'[description]\nurdf = "robot.urdf"\ntip = "{ARMS[arguments.arm][1]}"\n{terms}')
    rows, begin = ["id,informations,date"], time.perf_counter()
    for number in range(arguments.robots):
        fault = planted.get(number)
        for epoch, date in enumerate(DATES if arguments.drift else DATES[:1]):
            planted_now = fault if epoch == int(arguments.drift) else None
            size = 0.0 if fault is None else arguments.friction if fault[0] == "gearbox" else arguments.link
            if number in batch:
                planted_now, size = BATCH
            fleet.robot(number, planted_now, size, epoch).save(folder / f"{number}-{epoch}.json")
            rows.append(f"{number},{number}-{epoch}.json,{date}")
    (folder / "robots.csv").write_text("\n".join(rows) + "\n")
    (folder / "fleet.toml").write_text('name = "Simulated fleet"\nrobot = "robot.toml"\ntable = "robots.csv"\n')
    print(f"seed {seed}: {arguments.robots} robots made in {time.perf_counter() - begin:.0f} s", flush=True)
    command = [sys.executable, "-m", "steelyard", "fleet", str(folder / "fleet.toml"), "--quiet"]
    begin = time.perf_counter()
    done = subprocess.run(
        [*command, "--output", str(folder / "result"), "--workers", str(arguments.workers)],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        check=False,
    )
    seconds = time.perf_counter() - begin
    document = json.loads((folder / "result" / "fleet.json").read_text())
    kind = "drift" if arguments.drift else "siblings"
    found = [
        (int(one["robot"]), (one["part"], one["what"] == "torque gain"), ())
        for one in document["findings"]
        if one["kind"] == kind
    ]
    told, false = judged(fleet, planted, found)
    for one in document["findings"]:
        if one["kind"] == "batch":
            strayed = len(set(map(int, one["robots"])) ^ set(batch))
            print(f"a batch, with {strayed} robots of the wrong one: {one['sentence']}")
    page = (folder / "result" / "fleet.html").stat().st_size
    print(f"exit {done.returncode}, {seconds:.0f} s with {arguments.workers} workers, page {page / 1e3:.0f} kB")
    print(f"seed {seed}, {kind}: {line(told, false)}", flush=True)
    for one in document["findings"]:
        fault = planted.get(int(one["robot"] or -1))
        if one["kind"] == kind and (fault is None or arguments.verbose):
            print(f"    {one['robot']} {fault or 'nothing planted'}: {one['sentence']}")


@cache
def simulated(arm, seed, number, fault, size):
    """What the data of a robot tells: base parameters, their covariance, and how they change with gains."""
    info = fleets(arm, seed).robot(number, fault, size)
    estimate = sy.least_squares(info)
    covariance = ParameterCovariance.of(info, estimate.base, estimate.weights)
    return estimate.base, covariance.matrix, torque_gains(info, estimate.weights)


@cache
def fleets(arm, seed):
    return SimulatedFleet(arm, seed)


def by_comparison(arguments, seed, **sizes):
    """Hold the robots beside each other, without the fits; the true parameters stand for those of the answers."""
    fleet = fleets(arguments.arm, seed)
    planted = fleet.planted(arguments.robots, arguments.each, tuple(sizes))
    told = []
    for number in range(arguments.robots):
        fault = planted.get(number)
        told.append(simulated(arguments.arm, seed, number, fault, 0.0 if fault is None else sizes[fault[0]]))
    bases, covariances, gains = map(np.array, zip(*told, strict=True))
    causes = possible_causes(fleet.model, fleet.usual, np.median(bases, axis=0), np.median(gains, axis=0))
    own = gains_in_own_motion(fleet.model, causes, gains)
    found = compare_siblings(bases, covariances, causes, variations(fleet.model, causes), own=own)
    findings = [(one.robot, part_of(one.cause), [*map(part_of, one.alternatives)]) for one in found.deviations]
    return judged(fleet, planted, findings)


def programmes(arguments, seed):
    """Sound robots of which one has another programme: whether it is named, and how often intervals hold the truth."""
    fleet = fleets(arguments.arm, seed)
    for own in (False, True):
        made = [fleet.programmed(number, 0, own) for number in range(arguments.robots)]
        for counted in (False, True):
            told = []
            for info, values in made:
                used = info if counted else replace(info, returning=())
                estimate = sy.least_squares(used)
                covariance = ParameterCovariance.of(used, estimate.base, estimate.weights)
                away = (estimate.base - fleet.model.base_parameters().values(values)) / covariance.standard_error
                gains = torque_gains(used, estimate.weights)
                told.append((estimate.base, covariance.matrix, gains, covariance.degrees_of_freedom, away))
            bases, covariances, gains, freedoms, away = map(np.array, zip(*told, strict=True))
            causes = possible_causes(fleet.model, fleet.usual, np.median(bases, axis=0), np.median(gains, axis=0))
            directions = variations(fleet.model, causes)
            beside = gains_in_own_motion(fleet.model, causes, gains)
            found = compare_siblings(bases, covariances, causes, directions, own=beside, freedoms=freedoms)
            print(
                f"seed {seed}, {'each its own' if own else 'all the same'} ripple, periods "
                f"{'together' if counted else 'as independent'}: {len(found.differs)} of {len(bases)} named, "
                f"{np.mean(np.abs(away) < NORMAL):.0%} of the intervals hold",
                flush=True,
            )


def batches(arguments, seed):
    """How a part of the robots is told that has another gearbox, rotor, link or gain: cause, robots and size."""
    fleet, count = fleets(arguments.arm, seed), arguments.robots
    order = np.random.default_rng([seed, 4]).permutation(count)
    for share in (0.05, 0.1, 0.2, 0.35, 0.5):
        for kind, size in BATCHES.items():
            places = LINKS_THAT_SHOW if kind == "link" else range(1, 1 + fleet.model.dof)
            results = []
            for place in places:
                inside = {*map(int, order[: round(share * count)])}
                faults = {number: ((kind, place), size) if number in inside else (None, 0.0) for number in range(count)}
                told = [simulated(arguments.arm, seed, number, *faults[number]) for number in range(count)]
                results.append(told_batch(fleet, told, inside, (kind, place), size))
            told, right, strayed, held = map(sum, zip(*results, strict=True))
            print(
                f"seed {seed}, {share:.0%} with {kind} {size:+.0%}: {told} of {len(results)} told, {right} by the "
                f"right cause, {strayed} robots in the wrong heap, {held} of {right} in the interval",
                flush=True,
            )


def told_batch(fleet, told, inside, fault, size):
    """Whether a batch is told, and by the right cause, robots in the wrong heap, and whether the interval holds."""
    bases, covariances, gains = map(np.array, zip(*told, strict=True))
    usual = np.ones(len(bases), dtype=bool)
    for _ in range(2):  # as identify_fleet does: sizes are parts of what the others have
        medians = np.median(bases[usual], axis=0), np.median(gains[usual], axis=0)
        causes = possible_causes(fleet.model, fleet.usual, *medians)
        own = gains_in_own_motion(fleet.model, causes, gains)
        found = compare_siblings(bases, covariances, causes, variations(fleet.model, causes), own=own).batches
        if not found:
            return False, False, 0, False
        usual[list(found[0].robots)] = False
    one, robots = found[0].deviation, set(found[0].robots)
    kind, number = fault
    right = one.cause.name == f"Ia{number}" if kind == "rotor" else part_of(one.cause) == fleet.part(fault)
    others = set(range(len(bases))) - robots
    turned = len(others ^ inside) < len(robots ^ inside)
    true = -size / (1.0 + size) if turned else size
    return True, right, len((others if turned else robots) ^ inside), right and one.lower <= true <= one.upper


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arm", default="ur5", choices=ARMS)
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--each", type=int, default=10, help="robots with each fault")
    parser.add_argument("--friction", type=float, default=0.5, help="of a worn gearbox, beyond the usual")
    parser.add_argument("--link", type=float, default=0.1, help="of a heavier link, beyond the usual")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--folder", type=Path, help="for the fleet and its results; kept")
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--sizes", action="store_true")
    parser.add_argument("--gains", action="store_true")
    parser.add_argument("--drift", action="store_true")
    parser.add_argument("--programmes", action="store_true")
    parser.add_argument("--batch", type=int, default=0, help="robots with another gearbox, by the command")
    parser.add_argument("--batches", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    arguments = parser.parse_args()
    for seed in arguments.seeds:
        if arguments.compare:
            found = line(*by_comparison(arguments, seed, gearbox=arguments.friction, link=arguments.link))
            print(f"seed {seed}: {found}", flush=True)
        elif arguments.sizes:
            for friction, link in ((0.1, 0.02), (0.2, 0.03), (0.3, 0.05), (0.4, 0.07), (0.5, 0.1), (1.0, 0.15)):
                found = line(*by_comparison(arguments, seed, gearbox=friction, link=link))
                print(f"seed {seed}, friction +{friction:.0%}, link +{link:.0%}: {found}", flush=True)
        elif arguments.programmes:
            programmes(arguments, seed)
        elif arguments.batches:
            batches(arguments, seed)
        elif arguments.gains:
            for gain in (0.03, -0.03, 0.05, -0.05, 0.1, -0.1):
                print(f"seed {seed}, gain {gain:+.0%}: {line(*by_comparison(arguments, seed, gain=gain))}", flush=True)
        elif arguments.folder is not None:
            arguments.folder.mkdir(parents=True, exist_ok=True)
            by_command(arguments, seed, arguments.folder)
        else:
            with tempfile.TemporaryDirectory() as folder:
                by_command(arguments, seed, Path(folder))


if __name__ == "__main__":
    main()
