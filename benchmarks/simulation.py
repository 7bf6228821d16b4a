"""Simulation: a control loop at 1 kHz beside MuJoCo, batches, and the methods at a given accuracy.

Every figure is the least of several rounds in which all take turns, on one thread.
"""

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import time

import numpy as np

import steelyard as sy
from steelyard.dynamics.threads import one_thread
from steelyard.identification.wam import TRAJECTORIES, true_parameters, wam_model
from steelyard.simulation import Measurement, simulate

SECONDS = 10.0
KP = np.array([156.3] * 4 + [123.5] * 3)
KD = np.array([25.0] * 4 + [22.2] * 3)


class ComputedTorque:
    """Thesis eq. 5.8 with trajectory B, friction fed forward at the reference's velocity."""

    sample_time = 1e-3

    def __init__(self, model: sy.Model, parameters: np.ndarray) -> None:
        self.reference = TRAJECTORIES["B"].motion(np.arange(round(SECONDS / self.sample_time) + 2) * self.sample_time)
        self.links = model.kernel("computed_torque").sample
        self.drives = model.kernel("drive_torque", sign="smooth").sample
        self.parameters, self.width, self.step = parameters, np.array([0.01]), 0

    def start(self, measurement: object) -> None:
        self.step = 0

    def command(self, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        wanted, speed, acceleration = (row[self.step] for row in self.reference)
        self.step += 1
        a = acceleration + KD * (speed - dq) + KP * (wanted - q)
        return self.links(q, dq, a, self.parameters) + self.drives(q, speed, a, self.parameters, self.width)

    def torque(self, measurement: Measurement) -> np.ndarray:
        return self.command(measurement.q, measurement.dq)


def mujoco_world(model: sy.Model, parameters: np.ndarray) -> object:
    """Build the arm in MuJoCo: same joints, links and joint friction; rotors and coupled friction left out."""
    import mujoco

    robot, spec = model.robot, mujoco.MjSpec()
    spec.option.gravity, spec.option.timestep = robot.gravity, 1e-3
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    body = spec.worldbody
    after = np.eye(4)
    for joint, columns in zip(robot.joints, model.link_columns, strict=True):
        place = after @ np.asarray(joint.before)
        body = body.add_body(pos=place[:3, 3], quat=_quaternion(place[:3, :3]))
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], damping=[0.5], frictionloss=0.2, armature=0.01)
        after = np.asarray(joint.after)
        xx, xy, xz, yy, yz, zz, *first, mass = parameters[columns]
        com = np.array(first) / mass
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * (
            com @ com * np.eye(3) - np.outer(com, com)
        )
        com, about = after[:3, :3] @ com + after[:3, 3], after[:3, :3] @ about @ after[:3, :3].T
        body.mass, body.ipos, body.explicitinertial = mass, com, True
        body.fullinertia = [about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2]]
    return spec.compile()


def _quaternion(matrix: np.ndarray) -> np.ndarray:
    import mujoco

    result = np.empty(4)
    mujoco.mju_mat2Quat(result, np.ascontiguousarray(matrix).ravel())
    return result


def in_mujoco(world: object, controller: ComputedTorque, q: np.ndarray, dq: np.ndarray) -> None:
    import mujoco

    data = mujoco.MjData(world)
    data.qpos[:], data.qvel[:] = q, dq
    controller.start(None)
    for _ in range(round(SECONDS / 1e-3)):
        data.qfrc_applied[:] = controller.command(data.qpos, data.qvel)
        mujoco.mj_step(world, data)


def least(rounds: int, **jobs) -> dict[str, float]:
    """Time jobs in turns, after one round that compiles."""
    times = dict.fromkeys(jobs, np.inf)
    for round_ in range(rounds + 1):
        for name, job in jobs.items():
            begin = time.perf_counter()
            job()
            if round_:
                times[name] = min(times[name], time.perf_counter() - begin)
    return times


def loop(rounds: int) -> None:
    model, parameters = wam_model(), true_parameters()
    controller = ComputedTorque(model, parameters)
    q, dq, _ = (row[0] for row in controller.reference)

    def ours(method: str, **options):
        return lambda: simulate(model, parameters, q, dq, SECONDS, controller, method=method, **options)

    def alone() -> None:
        controller.start(None)
        for _ in range(round(SECONDS / 1e-3)):
            controller.command(q, dq)

    jobs = {
        "rosenbrock, 4 steps a period": ours("rosenbrock"),
        "rosenbrock, 1 step a period": ours("rosenbrock", step=1e-3),
        "runge_kutta_4, 1 step a period": ours("runge_kutta_4"),
        "the controller alone": alone,
    }
    try:
        world = mujoco_world(model, parameters)
        jobs["MuJoCo, implicitfast, 1 step a period"] = lambda: in_mujoco(world, controller, q, dq)
    except ImportError:
        print("MuJoCo is not installed; it is left out.")
    times = least(rounds, **jobs)
    best = times["rosenbrock, 4 steps a period"]
    print(f"\n{SECONDS:g} s of the WAM under computed torque at 1 kHz, one thread")
    for name, seconds in times.items():
        print(f"  {name:40s} {seconds:7.3f} s   {SECONDS / seconds:7.1f} x real time   ratio {seconds / best:5.2f}")


def accuracy() -> None:
    model, parameters = wam_model(), true_parameters()
    controller = ComputedTorque(model, parameters)
    q, dq, _ = (row[0] for row in controller.reference)
    exact = simulate(model, parameters, q, dq, 2.5, controller, method="radau", sign_width=1e-4)
    print("\n2.5 s of the same loop, sign_width 1e-4: largest error of a position against radau")
    for method in ("rosenbrock", "runge_kutta_4"):
        for step in (1e-3, 2.5e-4, 1e-4):
            found = simulate(model, parameters, q, dq, 2.5, controller, method=method, step=step, sign_width=1e-4)
            print(f"  {method:16s} {step * 1e3:5.2f} ms   {np.abs(found.q - exact.q).max():.1e} rad")


def batches(rounds: int) -> None:
    model, parameters = wam_model(), true_parameters()
    smooth = np.zeros_like(parameters)
    for columns in model.link_columns:
        smooth[columns] = parameters[columns]
    random = np.random.default_rng(0)
    print("\n1 s of free fall from random positions: ms for each run")
    for name, values, methods in (
        ("without friction", smooth, ("dormand_prince", "dop853", "runge_kutta_4")),
        ("with friction", parameters, ("rosenbrock", "radau", "lsoda")),
    ):
        for runs in (1, 16, 256):
            q0 = random.uniform(-1.0, 1.0, (runs, 7))
            used = [m for m in methods if runs < 256 or m not in ("dop853", "radau", "lsoda")]

            def job(method, q0=q0, values=values):
                return lambda: simulate(model, values, q0, np.zeros(7), 1.0, method=method, rate=100.0)

            times = least(rounds, **{m: job(m) for m in used})
            text = ", ".join(f"{m} {seconds / runs * 1e3:.2f}" for m, seconds in times.items())
            print(f"  {name:17s} {runs:4d} runs: {text}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    with one_thread():
        loop(arguments.rounds)
        accuracy()
        batches(arguments.rounds)
