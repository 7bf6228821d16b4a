"""Logs of arms, simulated by Pinocchio, with one mistake in each, and what a right hypothesis does with them."""

from dataclasses import dataclass, replace

import numpy as np
from pinocchio_oracle import URDFS, pinocchio

import steelyard as sy
from steelyard.estimators.plausible_fit import plausible_fit, tried_prior
from steelyard.identification.prediction_verdict import prediction_verdict
from steelyard.recording.correction import Correction
from steelyard.regression.reduction import empty_factors
from steelyard.regression.time_blocks import TimeBlocks

ROBOTS = {
    "panda": ["panda_finger_joint1"],
    "ur10_robot": [],
    "kinova": [],
    "xarm7": [],
    "z1": ["jointGripper"],
    "tiago_no_hand": ["wheel_right_joint", "wheel_left_joint", "head_1_joint", "head_2_joint"],  # torso and arm
}
"""Files of example-robot-data, each with the joints that are held."""
MOTIONS = {"weak": (0.35, 3, 0.05), "ordinary": (0.7, 5, 0.07), "rich": (1.0, 6, 0.1)}
"""Share of the range of the joints, harmonics, and the fundamental in Hz."""
TERMS = (sy.Viscous(), sy.Coulomb(), sy.Offset())
RATE, DURATION = 50.0, 24.0
DEGREE = np.pi / 180.0


class Arm:
    """A robot of a URDF, some joints of which are held, with Pinocchio's view of it."""

    def __init__(self, path, locked=()):
        self.path = path
        self.robot = sy.Robot.from_urdf(path, locked=locked)
        whole = pinocchio.buildModelFromUrdf(str(path))
        kept = [joint.name for joint in self.robot.joints]
        locked = [whole.getJointId(other) for other in whole.names[1:] if other not in kept]
        self.model = pinocchio.buildReducedModel(whole, locked, pinocchio.neutral(whole))
        self.ids = [self.model.getJointId(name) for name in kept]
        self.turning = np.array([joint.kind != "prismatic" for joint in self.robot.joints])

    @classmethod
    def named(cls, name):
        """Return one of ROBOTS."""
        return cls(next(path for path in URDFS if path.stem == name), ROBOTS[name])

    def torque(self, q, dq, ddq, gravity=(0.0, 0.0, -9.81), payload=None):
        """Return the torques of the bodies; a payload is (mass, centre of mass) at the last joint."""
        model = pinocchio.Model(self.model)
        model.gravity.linear = np.array(gravity, dtype=float)
        if payload is not None:
            mass, com = payload
            body = pinocchio.Inertia(mass, np.asarray(com), 0.003 * mass * np.eye(3))
            model.appendBodyToJoint(self.ids[-1], body, pinocchio.SE3.Identity())
        data, full = model.createData(), pinocchio.neutral(model)
        v, a, found = np.zeros(model.nv), np.zeros(model.nv), np.zeros_like(q)
        at = [model.joints[i].idx_v for i in self.ids]
        for row in range(len(q)):
            for value, i in zip(q[row], self.ids, strict=True):
                joint = model.joints[i]
                full[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
            v[at], a[at] = dq[row], ddq[row]
            found[row] = pinocchio.rnea(model, data, full, v, a)[at]
        return found

    def rotors(self):
        """Mean diagonal of the inertia matrix, kg·m², and a twentieth of the largest at least."""
        data, diagonals = self.model.createData(), []
        for seed in range(20):
            pinocchio.seed(seed)
            matrix = pinocchio.crba(self.model, data, pinocchio.randomConfiguration(self.model))
            diagonals.append(np.diag(matrix)[[self.model.joints[i].idx_v for i in self.ids]])
        mean = np.mean(diagonals, axis=0)
        return np.maximum(mean, 0.05 * mean.max())


def motion(arm, random, kind):
    """Return times, and a function from times to positions, velocities and accelerations."""
    share, harmonics, frequency = MOTIONS[kind]
    joints = arm.robot.joints
    low = np.array([max(joint.lower, -2.5) for joint in joints])
    high = np.array([min(joint.upper, 2.5) for joint in joints])
    numbers = np.arange(1, harmonics + 1)
    a, b = random.normal(size=(2, len(joints), harmonics)) / numbers**0.7
    speed = 2 * np.pi * frequency * numbers

    def raw(t):
        sine, cosine = np.sin(np.outer(t, speed)), np.cos(np.outer(t, speed))
        return (
            sine @ a.T + cosine @ b.T,
            (cosine * speed) @ a.T - (sine * speed) @ b.T,
            -(sine * speed**2) @ a.T - (cosine * speed**2) @ b.T,
        )

    largest = np.abs(raw(np.arange(0.0, 1.0 / frequency, 0.02))[0]).max(axis=0)
    half = 0.5 * (high - low)
    scale = share * half * random.uniform(0.6, 1.0, len(joints)) / largest
    center = 0.5 * (low + high) + 0.3 * (1.0 - share) * half * random.uniform(-1.0, 1.0, len(joints))

    def at(t):
        q, dq, ddq = raw(t)
        return q * scale + center, dq * scale, ddq * scale

    return np.arange(0.0, DURATION, 1.0 / RATE), at


def log(arm, random, kind, *, delay=0.0, offsets=0.05, rotors=False, motor=None, **physics):
    """Return samples of an arm with friction that the model has in part, with white and with coloured noise.

    Also returns (N,) whether bodies make at least half of what changes in the torque of a joint.
    """
    t, at = motion(arm, random, kind)
    q, dq, ddq = at(t)
    q_then, dq_then, ddq_then = at(t - delay)
    torque = rigid = arm.torque(q_then, dq_then, ddq_then, **physics)
    size = np.sqrt((torque**2).mean(axis=0))
    size, n = np.maximum(size, 0.05 * size.max()), len(size)
    coulomb, stribeck = random.uniform(0.05, 0.25, n) * size, random.uniform(0.0, 0.05, n) * size
    viscous = random.uniform(0.05, 0.25, n) * size / np.sqrt((dq**2).mean(axis=0))
    torque = rigid + (coulomb + stribeck * np.exp(-np.abs(dq_then) / 0.1)) * np.sign(dq_then) + viscous * dq_then
    torque += offsets * random.choice([-1.0, 1.0], n) * random.uniform(0.5, 1.5, n) * size
    if rotors:
        torque += random.uniform(0.5, 2.0, n) * arm.rotors() * ddq_then
    if motor is not None:  # its velocity in those of the joints: friction and rotor act on the joints likewise
        outer = int(np.flatnonzero(motor)[-1])
        dq_motor, ddq_motor = dq_then @ motor, ddq_then @ motor
        drag = random.uniform(0.2, 0.5) * size[outer] * np.sign(dq_motor)
        drag += random.uniform(0.2, 0.5) * size[outer] * dq_motor / np.sqrt((dq_motor**2).mean())
        drag += random.uniform(0.5, 2.0) * arm.rotors()[outer] * ddq_motor
        torque += drag[:, None] * motor
    coloured = random.normal(size=torque.shape)
    for row in range(1, len(coloured)):
        coloured[row] = 0.9 * coloured[row - 1] + np.sqrt(0.19) * coloured[row]
    torque += coloured * random.uniform(0.005, 0.03, n) * size + 0.01 * size * random.normal(size=torque.shape)
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t), rigid.std(axis=0) > 0.5 * torque.std(axis=0)


@dataclass
class Planted:
    """Samples with a mistake, and without it, and the mistake's name.

    Attributes
    ----------
    samples, right : Samples
    terms : tuple of Term
        Of the model that identifies them.
    kind : str
        As `Hypothesis.kind` has it.
    correction : Correction
        What is looked for, as far as it does not show in `right`.
    weighed : ndarray of bool
        (N,) where bodies make at least half of what changes in the torque, not friction.
    """

    samples: sy.Samples
    right: sy.Samples
    terms: tuple
    kind: str
    correction: Correction
    weighed: np.ndarray

    def is_named_by(self, hypothesis):
        """Whether this hypothesis is right: that it says so, and that what it would do undoes the mistake."""
        found, wanted = hypothesis.correction, self.correction
        if hypothesis.kind not in self.kind.split(" or "):
            return False
        if (found.coupling is None) != (wanted.coupling is None):
            return False
        if wanted.coupling is not None:
            return np.array_equal(found.coupling, wanted.coupling)
        if found.terms != wanted.terms or (found.gravity is None) != (wanted.gravity is None):
            return False
        # Two degrees; an axis of the base is told exactly.
        near = 0.035 * 9.81 * (np.count_nonzero(wanted.gravity) > 1) if wanted.gravity is not None else 0.0
        if wanted.gravity is not None and not np.allclose(found.gravity, wanted.gravity, atol=max(near, 1e-8)):
            return False
        if abs(found.delay - wanted.delay) > 0.005 + 0.1 * abs(wanted.delay):
            return False
        if wanted.payload is not None:
            return found.payload is not None and abs(found.payload[1] / wanted.payload[1] - 1.0) < 0.3
        if wanted.delay:
            return True
        mended = found.apply(self.samples)
        # Factors are told only as well as the masses are known, and zeros as well as the centres of mass.
        near = 0.5 * np.abs(self.right.q - self.right.q.mean(axis=0)).mean(axis=0) if "offset" in self.kind else 0.05
        ratio = np.linalg.norm(mended.torque, axis=0) / np.linalg.norm(self.right.torque, axis=0)
        alike = np.einsum("sk,sk->k", mended.torque, self.right.torque) / (
            np.linalg.norm(mended.torque, axis=0) * np.linalg.norm(self.right.torque, axis=0)
        )
        loose = 1.3
        if "constants" in self.kind:
            # Friction has no size that is known: where it makes most of a torque, no log shows its factor. Without
            # masses in the description only ratios of the others can be told.
            ratio = ratio[self.weighed]
            ratio, loose = ratio / np.exp(np.median(np.log(ratio))), 2.0
        return bool(
            np.all(np.abs(mended.q - self.right.q).mean(axis=0) < np.maximum(near, 0.05))
            and np.allclose(mended.dq, self.right.dq, rtol=0.05, atol=0.05 * np.abs(self.right.dq).max())
            and np.all(alike > 0.99)
            and np.all((ratio < loose) & (ratio > 1.0 / loose))
        )


def _flip(n, which):
    return np.diag([-1.0 if k in which else 1.0 for k in range(n)])


def _is_vertical(joint):
    return abs(np.asarray(joint.before, dtype=float)[2, 2]) > 0.999  # joints turn about their z axes


def _factors(n, which, factor):
    return np.diag([factor if k in which else 1.0 for k in range(n)])


def plant(arm, mistake, seed, kind):
    """Return a log with a mistake of this name (see MISTAKES), or a sound one ("none")."""
    random = np.random.default_rng(seed)
    n, turning = arm.robot.dof, np.flatnonzero(arm.turning)
    options, terms, wanted, name = {}, TERMS, Correction(), MISTAKES.get(mistake, "none")
    match mistake:
        case "gravity":
            directions = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, 0)]
            wanted = Correction(gravity=9.81 * np.array(directions[random.integers(6)], dtype=float))
            options["gravity"] = wanted.gravity
        case "tilted base":
            angle, side = np.radians(random.uniform(10.0, 50.0)), random.uniform(0.0, 2.0 * np.pi)
            tilted = np.sin(angle) * np.cos(side), np.sin(angle) * np.sin(side), -np.cos(angle)
            wanted = Correction(gravity=9.81 * np.array(tilted))
            options["gravity"] = wanted.gravity
        case "payload":
            mass = random.uniform(0.1, 0.25) * sum(link.inertia.mass for link in arm.robot.links)
            last = arm.robot.links[-1]
            options["payload"] = (mass, random.normal(size=3) * 0.05 + [0.0, 0.0, 0.1])
            wanted = Correction(payload=(last.name, last.inertia.mass + mass, 0.0))
        case "missing rotors":
            options["rotors"], wanted = True, Correction(terms=("rotor_inertia",))
        case "missing offsets":
            options["offsets"], wanted, terms = 0.5, Correction(terms=("offset",)), TERMS[:2]
        case "missing friction":
            wanted, terms = Correction(terms=("coulomb",)), (TERMS[0], TERMS[2])
        case "coupled motors":
            turned = np.flatnonzero(arm.turning[1:] == arm.turning[:-1])
            inner, wanted = int(random.choice(turned)), Correction(coupling=np.eye(n))
            wanted.coupling[inner, inner + 1] = random.choice([-1.0, 1.0])
            options["motor"] = wanted.coupling[:, inner + 1]
        case "delay":
            options["delay"] = float(random.choice([0.03, 0.05, 0.08, 0.12]))
            wanted = Correction(delay=options["delay"])
    right, weighed = log(arm, random, kind, **options)
    q, t = np.eye(n), np.eye(n)
    joint, pair = int(random.integers(n)), random.choice(n, 2, replace=False)
    swap = np.arange(n)
    swap[pair] = swap[pair[::-1]]
    order = random.permutation(n)
    coupling = np.eye(n)
    wrist = int(random.integers(n - 1))
    coupling[(wrist, wrist + 1) if random.integers(2) else (wrist + 1, wrist)] = random.choice([-1.0, 1.0])
    clock, zero = 1.0, np.zeros(n)
    match mistake:
        case "sign of a torque":
            t = _flip(n, [joint])
        case "signs of two torques":
            t = _flip(n, pair)
        case "signs of all torques":
            t = -t
        case "sign of a position":
            # Of the last joint it is exactly the wrong sign of its torque, with another last body.
            q = _flip(n, [min(joint, n - 2)])
        case "signs of two positions":
            q = _flip(n, pair)
        case "reversed axis":
            # Of the last joint it shows in nothing but products of inertia.
            q = t = _flip(n, [min(joint, n - 2)])
        case "two torques swapped":
            t = np.eye(n)[swap]
        case "two positions swapped":
            q = np.eye(n)[swap]
        case "two joints swapped":
            q = t = np.eye(n)[swap]
        case "torques in another order":
            t = np.eye(n)[order]
        case "positions in another order":
            q = np.eye(n)[order]
        case "joints in another order":
            q = t = np.eye(n)[order]
        case "mN·m":
            t = 1e3 * t
        case "mN·m at a joint":
            t = _factors(n, [joint], 1e3)
        case "torque before a gear":
            t = _factors(n, [joint], 1.0 / random.choice([10.0, 50.0, 100.0, 160.0]))
        case "currents":
            t = np.diag(np.exp(-random.uniform(np.log(2.0), np.log(20.0), n)))
        case "degrees":
            q = _factors(n, turning, 1.0 / DEGREE)
        case "milliradians":
            q = _factors(n, turning, 1e3)
        case "degrees at a joint":
            q = _factors(n, [random.choice(turning)], 1.0 / DEGREE)
        case "mm":
            q = _factors(n, [k for k in range(n) if k not in turning], 1e3)
        case "zero of a joint":
            # Of the last joint it is exactly another last body, and of a vertical first joint nothing at all.
            shown = [k for k in turning if k < n - 1 and not (k == 0 and _is_vertical(arm.robot.joints[0]))]
            zero[random.choice(shown)] = random.choice([np.pi / 2, -np.pi / 2, np.pi])
        case "ms":
            clock = 1e3
        case "gear ratio":
            q = _factors(n, [random.choice(turning)], random.choice([50.0, 80.0, 100.0, 101.0, 121.0, 160.0]))
        case "gear ratio of all joints":
            q = _factors(n, turning, random.choice([50.0, 80.0, 100.0, 121.0, 160.0]))
        case "coupled joints":
            q, t = coupling, np.linalg.inv(coupling).T
        case "coupled positions":
            q = coupling
        case "coupled torques":
            t = coupling
    spoilt = sy.Samples(
        q=right.q @ q.T - zero,
        dq=right.dq @ q.T / clock,
        ddq=right.ddq @ q.T / clock**2,
        torque=right.torque @ t.T,
        t=right.t * clock,
    )
    return Planted(spoilt, right, terms, name, wanted, weighed)


MISTAKES = {
    "sign of a torque": "torque sign",
    "signs of two torques": "torque sign",
    "signs of all torques": "torque sign",
    "sign of a position": "position sign",
    "signs of two positions": "position sign",
    "reversed axis": "axis direction",
    "two torques swapped": "torque order",
    "two positions swapped": "position order",
    "two joints swapped": "joint order",
    "torques in another order": "torque order",
    "positions in another order": "position order",
    "joints in another order": "joint order",
    "mN·m": "torque unit",
    "mN·m at a joint": "torque unit",
    "torque before a gear": "torque scale",
    "currents": "torque constants",
    "degrees": "position unit",
    "degrees at a joint": "position unit",
    "mm": "position unit",
    "ms": "time unit",
    "gear ratio": "gear ratio",
    "gear ratio of all joints": "gear ratio",
    "gravity": "gravity",
    "delay": "delay",
    "coupled joints": "coupled joints",
    "coupled positions": "coupled joints",
    "coupled torques": "coupled joints",
    "zero of a joint": "position offset",
    "missing rotors": "missing term",
    "missing offsets": "missing term",
    "missing friction": "missing term",
    "payload": "payload",
    "tilted base": "gravity",
    "coupled motors": "coupled motors",
    "milliradians": "position unit",
}
"""Names of mistakes, and the kind of hypothesis that finds each."""


def described(robot, seed, spread=0.3):
    """Return the robot with masses, moments and centres of mass that are wrong by so much, each link by itself."""
    random = np.random.default_rng(seed)
    links = []
    for link in robot.links:
        mass, more = np.exp(spread * random.normal(size=2))
        com = link.inertia.com * (1.0 + spread / 3.0 * random.normal(size=3))
        body = sy.Inertia.from_com(
            mass=link.inertia.mass * mass, com=com, about_com=link.inertia.about_com * mass * more
        )
        links.append(replace(link, inertia=body))
    return replace(robot, links=tuple(links))


def undescribed(robot):
    """Return the robot without any body."""
    return replace(robot, links=tuple(replace(link, inertia=None, own_inertia=None) for link in robot.links))


def cases(count):
    """Yield (mistake, robot, motion, with CAD, seed) for so many logs: every kind on robots and motions in turn."""
    names, robots, motions = list(MISTAKES), list(ROBOTS), list(MOTIONS)
    for seed in range(count):
        turn, kind = divmod(seed, len(names))
        mistake, robot = names[kind], robots[(kind + turn) % len(robots)]
        if mistake == "mm":
            robot = "tiago_no_hand"
        # Without masses in the description a payload is a part of the last link.
        cad = (turn // 3 + kind) % 2 == 0 or mistake == "payload"
        yield mistake, robot, motions[(turn + turn // 3 + kind // 2) % 3], cad, seed


def verdicts(model, samples, found):
    """Return the verdict on the prediction by its errors alone, and with the mistakes that were found."""
    blocks = TimeBlocks(empty_factors(model))
    info = sy.Information.from_chunks(model, [samples], blocks=blocks)
    stretches = info.stretches(blocks)
    feasible_set, unconstrained = sy.FeasibleSet(model), sy.least_squares(info)
    fit = plausible_fit(info, feasible_set, unconstrained, tried_prior(info, stretches, feasible_set, unconstrained))
    told = prediction_verdict(info, fit.estimate.base, held_out_error=fit.held_out_error, fold_count=len(stretches))
    return told, told.with_mistakes([found])
