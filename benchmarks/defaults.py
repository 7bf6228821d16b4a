"""How far `identify` comes with its defaults: arms simulated by MuJoCo, whose true torque on a second motion is known.

Each arm follows a Fourier series of five harmonics that starts and ends in motion; the encoders have a noise of
1e-4 rad, the torques one of 1 %. `identify` is told nothing but the description and the log. Its model is then asked
for the torque of another motion, of which the truth is known.

usage: python benchmarks/defaults.py [--arms ur5 panda] [--logs plain tracked] [--seeds 1 2] [--set KEY=VALUE ...]
"""

import argparse
import sys
import sysconfig
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from lxml import etree

from steelyard import InputError
from steelyard.identification import identify
from steelyard.recording import Recording

ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
RATE, SECONDS = 500.0, 10.0
FINE = 10
"""Steps of the simulation of a tracked motion between two rows of the log."""
ENCODER, TORQUE, VELOCITY = 1e-4, 0.01, 1e-3


@dataclass(frozen=True)
class Arm:
    """A description, the joints beyond which nothing moves, and drives of a plausible size."""

    urdf: str
    joints: int
    coulomb: float  # of the largest gravity torque of the joint, at the first joint; falls towards the wrist


ARMS = {
    "ur5": Arm("ur_description/urdf/ur5_robot.urdf", 6, 8.0),
    "ur10": Arm("ur_description/urdf/ur10_robot.urdf", 6, 12.0),
    "ur3": Arm("ur_description/urdf/ur3_robot.urdf", 6, 3.0),
    "xarm7": Arm("xarm_description/urdf/xarm7.urdf", 7, 5.0),
    "kinova": Arm("kinova_description/robots/kinova.urdf", 6, 2.0),
    "panda": Arm("panda_description/urdf/panda.urdf", 7, 5.0),
    "z1": Arm("z1_description/urdf/z1.urdf", 6, 2.0),
}


class Plant:
    """An arm in MuJoCo: its links, and drives with viscous friction, smooth Coulomb friction and rotor inertias."""

    def __init__(self, arm: Arm, folder: Path, epsilon: float, armature: bool) -> None:
        tree = etree.parse(str(ROBOTS / arm.urdf))
        root = tree.getroot()
        for tag in ("visual", "collision"):
            for element in list(root.iter(tag)):
                element.getparent().remove(element)
        moving = [j for j in root.iter("joint") if j.get("type") in ("revolute", "continuous", "prismatic")]
        for joint in moving[arm.joints :]:
            joint.set("type", "fixed")
        for mimic in list(root.iter("mimic")):
            mimic.getparent().remove(mimic)
        self.urdf = folder / "robot.urdf"
        tree.write(str(self.urdf))
        for joint in moving:
            for limits in joint.findall("limit"):
                joint.remove(limits)
            if joint.get("type") == "revolute":
                joint.set("type", "continuous")
        extension = etree.SubElement(root, "mujoco")
        etree.SubElement(extension, "compiler", balanceinertia="true", discardvisual="true", fusestatic="false")
        self.model = mujoco.MjModel.from_xml_string(etree.tostring(root).decode())
        self.joints = n = self.model.nv
        if n != arm.joints:
            sys.exit(f"{arm.urdf}: {n} joints")
        size = 0.6 ** np.arange(n)
        self.coulomb, self.viscous = arm.coulomb * size, 0.8 * arm.coulomb * size
        self.epsilon = epsilon
        self.model.dof_armature[:] = 0.1 * arm.coulomb * size if armature else 0.0
        self.model.dof_damping[:] = self.model.dof_frictionloss[:] = 0.0
        self.data = mujoco.MjData(self.model)

    def friction(self, dq: np.ndarray, smooth: bool = True) -> np.ndarray:
        return self.viscous * dq + self.coulomb * (np.tanh(dq / self.epsilon) if smooth else np.sign(dq))

    def rigid(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """(S, N) torques without friction."""
        torque = np.empty_like(q)
        for k in range(len(q)):
            self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = q[k], dq[k], ddq[k]
            mujoco.mj_inverse(self.model, self.data)
            torque[k] = self.data.qfrc_inverse
        return torque

    def tracked(self, motion: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        """Follow a motion on the fine grid, with a controller that knows the links and no friction.

        Motion and torque are those of the rows of the log, at the same instant, as the plant had them.
        """
        count = (len(motion[0]) - 1) // FINE + 1
        out = np.empty((4, count, self.joints))
        model, data = self.model, self.data
        step = 1.0 / (RATE * FINE)
        mass = np.zeros((self.joints, self.joints))

        def torque_and_acceleration(k: float, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            wanted = [m[int(k)] if k == int(k) else 0.5 * (m[int(k)] + m[min(int(k) + 1, len(m) - 1)]) for m in motion]
            data.qpos[:], data.qvel[:] = q, dq
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, mass)
            torque = mass @ (wanted[2] + 60.0 * (wanted[1] - dq) + 900.0 * (wanted[0] - q)) + data.qfrc_bias
            return torque, np.linalg.solve(mass, torque - self.friction(dq) - data.qfrc_bias)

        q, dq = motion[0][0].copy(), motion[1][0].copy()
        for k in range(len(motion[0])):
            torque, one = torque_and_acceleration(k, q, dq)
            if k % FINE == 0:
                out[:, k // FINE] = q, dq, one, torque
            _, two = torque_and_acceleration(k + 0.5, q + 0.5 * step * dq, dq + 0.5 * step * one)
            q, dq = q + step * (dq + 0.5 * step * one), dq + step * two
        return tuple(out)


def series(joints: int, seed: int, t: np.ndarray, top: float) -> tuple[np.ndarray, ...]:
    """A Fourier series of five harmonics up to `top` Hz in each joint, up to 1.5 rad and 2 rad/s."""
    random = np.random.default_rng(seed)
    w = 2.0 * np.pi * top * np.arange(1, 6) / 5.0
    size, phase = random.uniform(0.2, 1.0, (2, 5, joints)) * np.array([1.0, 2.0 * np.pi])[:, None, None]
    size /= w[:, None]
    angle = w[:, None] * t[:, None, None] + phase[None]
    q = np.einsum("hj,shj->sj", size, np.sin(angle))
    dq = np.einsum("hj,shj->sj", w[:, None] * size, np.cos(angle))
    ddq = -np.einsum("hj,shj->sj", w[:, None] ** 2 * size, np.sin(angle))
    scale = np.minimum(1.5 / np.abs(q).max(axis=0), 2.0 / np.abs(dq).max(axis=0))
    return q * scale, dq * scale, ddq * scale


def logs(plant: Plant, kind: str, seed: int, top: float, folder: Path) -> tuple[Path, tuple[np.ndarray, ...]]:
    """Write the log to identify from; return it, and the second motion with its true torque."""
    fine = FINE if kind == "tracked" else 1
    t = np.arange(round(RATE * SECONDS * fine) + 1) / (RATE * fine)
    motion = series(plant.joints, seed, t, top)
    if kind == "tracked":
        q, dq, ddq, torque = plant.tracked(motion)
    else:
        q, dq, ddq = motion
        torque = plant.rigid(q, dq, ddq) + plant.friction(dq)
    random = np.random.default_rng(1000 + seed)
    noisy = torque + TORQUE * np.sqrt(np.mean(torque**2, axis=0)) * random.normal(size=torque.shape)
    velocity = dq + VELOCITY * random.normal(size=q.shape) if kind == "velocity" else None
    stamps = np.arange(len(q)) / RATE
    measured = q + ENCODER * random.normal(size=q.shape)
    path = Recording(t=stamps, q=measured, torque=noisy, velocity=velocity).save(folder / "log.csv")
    return path, series(plant.joints, 500 + seed, stamps, top)


def error(plant: Plant, urdf: Path, log: Path, second: tuple[np.ndarray, ...]) -> tuple[float, object, float]:
    start = time.perf_counter()
    result = identify(urdf, [log])
    seconds = time.perf_counter() - start
    q, dq, ddq = second
    true = plant.rigid(q, dq, ddq) + plant.friction(dq, smooth=False)
    model = result.model.inverse_dynamics(q, dq, ddq, result.estimate.parameters)
    return float(np.linalg.norm(model - true) / np.linalg.norm(true)), result, seconds


TERMS = "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in ("viscous", "coulomb", "offset", "rotor_inertia"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", nargs="+", default=["ur5", "ur10", "ur3", "xarm7", "kinova", "panda"], choices=ARMS)
    parser.add_argument("--logs", nargs="+", default=["plain"], choices=["plain", "velocity", "tracked"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--epsilon", type=float, default=0.01, help="rad/s within which friction turns its sign")
    parser.add_argument("--top", type=float, default=0.5, help="Hz, the highest frequency of the motion")
    parser.add_argument("--armature", action="store_true", help="rotor inertias too, told by a robot.toml")
    parser.add_argument("--set", nargs="*", default=[], help="lines of [processing] in a robot.toml")
    parser.add_argument("--remarks", action="store_true")
    arguments = parser.parse_args()
    print(f"{'arm':8} {'log':9} {'seed':>4} {'error':>9} {'s':>6}")
    for name in arguments.arms:
        for kind in arguments.logs:
            for seed in arguments.seeds:
                with tempfile.TemporaryDirectory() as place:
                    folder = Path(place)
                    plant = Plant(ARMS[name], folder, arguments.epsilon, arguments.armature)
                    log, second = logs(plant, kind, seed, arguments.top, folder)
                    robot = plant.urdf
                    if arguments.armature or arguments.set:
                        robot = folder / "robot.toml"
                        terms = (
                            TERMS if arguments.armature else TERMS.replace('[[terms]]\nkind = "rotor_inertia"\n', "")
                        )
                        options = "\n".join(["[processing]", *arguments.set])
                        robot.write_text(f'[description]\nurdf = "robot.urdf"\n{terms}{options}\n')
                    try:
                        found, result, seconds = error(plant, robot, log, second)
                    except InputError as problem:
                        print(f"{name:8} {kind:9} {seed:4d} {problem}")
                        continue
                    print(f"{name:8} {kind:9} {seed:4d} {100 * found:8.3f} % {seconds:6.2f}", flush=True)
                    if arguments.remarks:
                        print(*(f"    {remark}" for remark in result.remarks), sep="\n")


if __name__ == "__main__":
    main()
