"""Drives from commands and encoders alone: a real leg robot beside ``mujoco.sysid``, its simulated twins, and a servo.

    python benchmarks/encoders_only.py [sweeps] [twins] [servo] [--twins 100] [--gains] [--data ../shared/data]

``sweeps``: a Unitree Go2 with its legs in the air. Trained on sweeps 1, 2, 9 and 10; the error of positions on sweeps 3
and 4, simulated from the commands alone, for parameters of ours and of ``mujoco.sysid`` (extra ``mujoco[sysid]``) with
the same model, data and parameters: rotor inertia, damping, friction loss and torque bias of each joint, and a delay.
``twins``: legs with random drives that MuJoCo simulates from the commands of these sweeps by Runge-Kutta steps of
50 µs, with 0.2 mrad of noise: errors, how often the intervals hold the truth, and, where an error is above 2 %, the
least standard error that any unbiased estimator can have. ``servo``: a Dynamixel XL330 with a known pendulum, also with
friction that grows with the load.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import mujoco
import mujoco.rollout
import numpy as np
from numpy.typing import NDArray

import steelyard as sy
from steelyard.files import write_json
from steelyard.identification import identify_from_positions

Array = NDArray[np.float64]
KP, KD = 20.0, 1.5
SETTINGS = {"command": "target{}", "kp": KP, "kd": KD}
KINDS = ("rotor_inertia", "viscous", "coulomb", "offset")
TWIN_STEP, NOISE = 5e-5, 2e-4  # s, rad
SPLIT = 5.8  # s, where sweep 3 begins


def read(path: Path) -> tuple[Array, Array, Array]:
    """Times, positions and commands of a file of sweeps."""
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    return table[:, 0], table[:, 1:13], table[:, 13:25]


def log_of(t: Array, q: Array, command: Array) -> dict[str, Array]:
    """The same as the mapping that `identify_from_positions` takes."""
    count = q.shape[1]
    columns = {f"q{k + 1}": q[:, k] for k in range(count)} | {f"target{k + 1}": command[:, k] for k in range(count)}
    return {"t": t, **columns}


def driven(path: Path, step: float, integrator: str = "IMPLICITFAST") -> mujoco.MjSpec:
    """The robot of an MJCF with position drives on its joints."""
    spec = mujoco.MjSpec.from_file(str(path))
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for joint in spec.joints:
        drive = spec.add_actuator(name=f"{joint.name}_drive", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.gaintype, drive.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        drive.gainprm[0] = KP
        drive.biasprm[:3] = (0.0, -KP, -KD)
        spec.add_sensor(
            name=f"{joint.name}_q",
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint.name,
        )
    spec.option.timestep = step
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    return spec


def with_values(spec: mujoco.MjSpec, values: Array) -> mujoco.MjModel:
    """The model with armature, damping, friction loss and torque bias (N, 4)."""
    for joint, actuator, (armature, damping, friction, bias) in zip(spec.joints, spec.actuators, values, strict=True):
        joint.armature, joint.frictionloss = armature, friction
        joint.damping = np.r_[damping, 0.0, 0.0] if np.ndim(joint.damping) else damping
        actuator.biasprm[0] = bias
    return spec.compile()


def held(t: Array, command: Array, times: Array) -> Array:
    """Commands at times, each held until the next."""
    return command[np.clip(np.searchsorted(t, times + 1e-9, side="right") - 1, 0, len(t) - 1)]


def rolled_out(model: mujoco.MjModel, t: Array, q0: Array, command: Array, delay: float) -> Array:
    """Positions at times t from commands alone."""
    step = model.opt.timestep
    count = round((t[-1] - t[0]) / step) + 1
    told = held(t, command, t[0] + np.arange(count) * step + 0.5 * step - delay)
    data = mujoco.MjData(model)
    data.qpos[:] = q0
    start = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states, _ = mujoco.rollout.rollout(model, data, start[np.newaxis], told[np.newaxis])
    whole = np.concatenate([q0[np.newaxis], states[0][:, 1 : 1 + len(q0)]])
    at = t[0] + np.arange(len(whole)) * step
    return np.stack([np.interp(t, at, column) for column in whole.T], axis=1)


def stepped(model: mujoco.MjModel, found: Any, t: Array, q0: Array, command: Array) -> Array:
    """Positions at times t from commands alone, with friction that varies over the travel and with the load.

    MuJoCo has one friction loss for a joint: it is set anew before each step.
    """
    model.jnt_stiffness.reshape(model.njnt, -1)[:, 0] = found.stiffness
    low, high = found.travel
    model.qpos_spring[:] = 0.5 * (low + high)
    data = mujoco.MjData(model)
    data.qpos[:] = q0
    mujoco.mj_forward(model, data)
    step, inertial = model.opt.timestep, np.empty(model.nv)
    count = round((t[-1] - t[0]) / step) + 1
    told = held(t, command, t[0] + np.arange(count) * step + 0.5 * step - found.delay)
    whole = [q0]
    for row in told:
        along = np.clip(2.0 * (data.qpos - low) / (high - low) - 1.0, -1.0, 1.0)
        ends = np.where(along < 0.0, found.coulomb_by_position[0], found.coulomb_by_position[2])
        mujoco.mj_mulM(model, data, inertial, data.qacc)
        links = inertial - model.dof_armature * data.qacc + data.qfrc_bias
        friction = found.coulomb_by_position[1] + np.abs(along) * (ends - found.coulomb_by_position[1])
        model.dof_frictionloss[:] = friction + found.load_friction * np.abs(links)
        data.ctrl[:] = row
        mujoco.mj_step(model, data)
        whole.append(data.qpos.copy())
    at = t[0] + np.arange(len(whole)) * step
    return np.stack([np.interp(t, at, column) for column in np.array(whole).T], axis=1)


def rms(values: Array) -> float:
    """Root of the mean square, in mrad."""
    return 1e3 * float(np.sqrt(np.mean(values**2)))


def sweeps(folder: Path) -> None:
    """The real robot: ours, and the peer."""
    t, q, command = read(folder / "sweeps_1_4.csv")
    more = read(folder / "sweeps_9_10.csv")
    early = t <= SPLIT
    train = [(t[early], q[early], command[early]), more]
    spec = driven(folder / "go2_fixed_base.xml", 1e-3)

    def told(name: str, values: Array, delay: float, seconds: float, found: Any = None) -> None:
        def simulated(a: Array, b: Array, c: Array) -> Array:
            model = with_values(driven(folder / "go2_fixed_base.xml", 1e-3), values)
            return rolled_out(model, a, b[0], c, delay) if found is None else stepped(model, found, a, b[0], c)

        error = simulated(t, q, command) - q
        fitted = np.concatenate([simulated(*one) - one[1] for one in train])
        again = simulated(t[~early], q[~early], command[~early]) - q[~early]
        each = " ".join(f"{rms(column):5.1f}" for column in error[~early].T)
        print(
            f"{name:34s} {rms(fitted):7.3f} {rms(error[~early]):9.3f} {rms(again):9.3f} {1e3 * delay:7.2f} "
            f"{seconds:7.1f}  {each}",
            flush=True,
        )

    print("Simulated in MuJoCo (1 ms) from the commands alone, from the first row of the file, and begun at sweep 3;")
    print("mrad, rms. The held-out sweeps are 3 and 4. The processor's time.")
    print(
        f"{'parameters':34s} {'fitted':>7s} {'held out':>9s} {'begun':>9s} {'delay':>6s} {'s':>7s}  joints, sweeps 3, 4"
    )
    told("no friction, no rotors", np.zeros((12, 4)), 0.0, 0.0)
    told("the source's defaults", np.tile([0.01, 0.6, 0.2, 0.0], (12, 1)), 0.0, 0.0)
    robot = sy.Robot.from_urdf(folder / "go2.urdf")
    for friction, law, weights in (
        (None, "mujoco", "equal"),
        (None, "coulomb", "equal"),
        (None, "mujoco", "joint"),
        ("auto", "mujoco", "equal"),
        ("auto", "mujoco", "joint"),
    ):
        begin = time.process_time()
        found = identify_from_positions(
            robot,
            [log_of(*one) for one in train],
            settings={**SETTINGS, "friction": law},
            weights=weights,
            friction=friction,
        )
        seconds = time.process_time() - begin
        values = np.stack([getattr(found, kind) for kind in KINDS], axis=1)
        chosen = "" if friction is None else ", friction auto"
        told(f"ours, {law}, {weights}{chosen}", values, found.delay, seconds, found if friction else None)
        if found.choice is not None:
            print("   ", *(one for one in found.remarks if one.startswith(("Added", "No term"))))
    begin = time.process_time()
    values, delay = peer(spec, train)
    told("mujoco.sysid", values, delay, time.process_time() - begin)


def peer(spec: mujoco.MjSpec, train: list[tuple[Array, Array, Array]]) -> tuple[Array, float]:
    """What `mujoco.sysid` finds, by its default optimiser, of plain differences of positions."""
    from mujoco import sysid

    model = spec.compile()
    step = model.opt.timestep
    names = [joint.name for joint in spec.joints]
    params = sysid.ParameterDict()
    ranges = {
        "armature": (0.01, 0.0, 0.2),
        "damping": (0.3, 0.0, 2.0),
        "friction": (0.2, 0.0, 3.0),
        "bias": (0.0, -1.0, 1.0),
    }
    for name in names:
        for kind, (start, low, high) in ranges.items():

            def modifier(one: mujoco.MjSpec, parameter: Any, name: str = name, kind: str = kind) -> None:
                joint, value = one.joint(name), float(parameter.value[0])
                if kind == "armature":
                    joint.armature = value
                elif kind == "friction":
                    joint.frictionloss = value
                elif kind == "damping":
                    joint.damping = np.r_[value, 0.0, 0.0] if np.ndim(joint.damping) else value
                else:
                    one.actuator(f"{name}_drive").biasprm[0] = value

            params.add(sysid.Parameter(f"{name}_{kind}", start, low, high, modifier=modifier))
    params.add(sysid.Parameter("delay", 1e-3, 0.0, 0.05))
    starts, controls, measured = [], [], []
    for t, q, command in train:
        t = t - t[0]  # states begin at time 0
        times = np.arange(round(t[-1] / step) + 1) * step
        starts.append(sysid.create_initial_state(model, q[0]))
        controls.append(sysid.TimeSeries.from_control_names(times, held(t, command, times + 0.5 * step), model))
        measured.append(sysid.TimeSeries.from_names(t, q, model))
    sequences = [
        sysid.ModelSequences(f"go2_{k}", spec, f"sweeps_{k}", *one)
        for k, one in enumerate(zip(starts, controls, measured, strict=True))
    ]

    def differences(
        params: Any, predicted: Any, truth: Any, model: Any, everything: bool, *, state: Array, **_: Any
    ) -> Any:
        # A late command is a late motion, since all that happens before the first command is rest.
        at = np.clip(truth.times - params["delay"].value[0], state[0, 0], None)
        q = np.stack([np.interp(at, state[:, 0], column) for column in state[:, 1:13].T], axis=1)
        return truth.data - q, truth, truth

    residual = sysid.build_residual_fn(models_sequences=sequences, modify_residual=differences)

    def together(x: Array, params: Any, **options: Any) -> Any:
        found, *rest = residual(x, params, **options)
        return [np.reshape(one, (-1, one.shape[-1]) if x.ndim > 1 else -1) for one in found], *rest

    best, _ = sysid.optimize(params, together, optimizer="mujoco", verbose=False, max_iters=15)
    values = np.array([[best[f"{name}_{kind}"].value[0] for kind in ranges] for name in names])
    return values, float(best["delay"].value[0])


def leg_of(path: Path, prefix: str, step: float) -> mujoco.MjSpec:
    """One leg of the robot; the other integrators of MuJoCo are of order one, as far off at 20 µs as the noise."""
    spec = driven(path, step, "RK4")
    for actuator in list(spec.actuators):
        if not actuator.name.startswith(prefix):
            spec.delete(actuator)
    for sensor in list(spec.sensors):
        if not sensor.name.startswith(prefix):
            spec.delete(sensor)
    for body in list(spec.body("base").bodies):
        if not body.name.startswith(prefix):
            spec.delete(body)
    return spec


def drawn(seed: int) -> tuple[str, slice, Array, float, np.random.Generator]:
    """A leg, its columns, its drives (3, 4) and its delay."""
    random = np.random.default_rng(seed)
    leg = seed % 4
    prefix, own = ("FL", "FR", "RL", "RR")[leg], slice(3 * leg, 3 * leg + 3)
    truth = random.uniform((0.01, 0.1, 0.15, -0.1), (0.05, 0.5, 0.9, 0.1), (3, 4))
    return prefix, own, truth, float(random.integers(10, 180)) * TWIN_STEP, random


def least_errors(folder: Path, seed: int) -> dict[str, Any]:
    """Least standard errors of drives (3, 4), and of the delay, for the noise of a twin and a start that is known.

    The bound of Cramér and Rao, of central differences of motions that MuJoCo simulates in steps of 0.5 ms.
    """
    prefix, own, truth, delay, _ = drawn(seed)
    values, steps = np.append(truth.ravel(), delay), np.append(np.full(12, 1e-3), 1e-3)
    columns = []
    for k, step in enumerate(steps):
        sides = []
        for sign in (1.0, -1.0):
            changed = values + sign * step * (np.arange(13) == k)
            model = with_values(leg_of(folder / "go2_fixed_base.xml", prefix, 5e-4), changed[:12].reshape(3, 4))
            parts = (read(folder / name) for name in ("sweeps_1_4.csv", "sweeps_9_10.csv"))
            sides.append(
                np.concatenate([rolled_out(model, t, q[0, own], c[:, own], changed[12]).ravel() for t, q, c in parts])
            )
        columns.append((sides[0] - sides[1]) / (2.0 * step))
    jacobian = np.stack(columns, axis=1)
    errors = NOISE * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return {"drives": errors[:12].reshape(3, 4).tolist(), "delay": float(errors[12])}


def twin(folder: Path, seed: int, work: Path, gains: bool = False) -> dict[str, Any]:
    """One leg with random drives: what was found, and what is true; with gains that are found, too, if asked for."""
    prefix, own, truth, delay, random = drawn(seed)
    model = with_values(leg_of(folder / "go2_fixed_base.xml", prefix, TWIN_STEP), truth)
    source = work / f"{prefix}.xml"
    source.write_text(leg_of(folder / "go2_fixed_base.xml", prefix, 1e-3).to_xml())
    data = []
    for t, q, command in (read(folder / name) for name in ("sweeps_1_4.csv", "sweeps_9_10.csv")):
        measured = rolled_out(model, t, q[0, own], command[:, own], delay)
        data.append(log_of(t, measured + random.normal(size=measured.shape) * NOISE, command[:, own]))
    begin = time.process_time()
    settings = {**SETTINGS, "kp": "find", "kd": "find"} if gains else SETTINGS
    found = identify_from_positions(sy.Robot.from_mjcf(source), data, settings=settings)
    seconds = time.process_time() - begin
    names = found.robot.joint_names

    def true(kind: str, joint: str) -> float:
        if kind in ("delay", "kp"):
            return delay if kind == "delay" else KP
        drive = truth[names.index(joint)]
        if kind == "kd":  # all that brakes, less the damping of the description
            place = found.robot.driving_joints[names.index(joint)]
            return float(KD + drive[1] - found.robot.joints[place].damping)
        return float(drive[KINDS.index(kind)])

    values = [(one.kind, one.value, one.lower, one.upper, true(one.kind, one.joint)) for one in found.values]
    return {"seed": seed, "settled": found.settled, "seconds": seconds, "values": values}


def twins(folder: Path, count: int, work: Path, gains: bool = False) -> None:
    """Legs with random drives; each is kept in a file of its own, so that a run that was stopped goes on."""
    work.mkdir(parents=True, exist_ok=True)
    legs = []
    for seed in range(count):
        kept = work / f"twin{'_gains' if gains else ''}_{seed}.json"
        if not kept.exists():
            write_json(twin(folder, seed, work, gains), kept)
        legs.append(json.loads(kept.read_text()))
    spent = np.mean([leg["seconds"] for leg in legs])
    failed = sum(not leg["settled"] for leg in legs)
    print(f"{count} legs, {spent:.1f} s of the processor each, {failed} searches that did not settle")
    rows = [(*row, leg["seed"]) for leg in legs for row in leg["values"]]
    for kind in dict.fromkeys(row[0] for row in rows):
        value, lower, upper, true, seeds = np.array([row[1:] for row in rows if row[0] == kind]).T
        inside = (lower <= true) & (true <= upper)
        # 2 % of themselves, of 0.1 N·m for what may be zero; a delay to 0.2 ms
        unit, size, scale, most = {
            "delay": ("ms", 1.0, 1e3, 2e-4),
            "offset": ("N·m", 1.0, 1.0, 2e-3),
        }.get(kind, ("%", true, 100.0, 0.02))
        error = np.abs(value - true) / size
        near = error <= most
        # the values of one leg depend on each other, the legs do not
        by_leg = np.array([inside[seeds == seed].mean() for seed in np.unique(seeds)])
        print(
            f"{kind:14s} in the interval {inside.sum()} of {len(inside)}, {100 * inside.mean():5.1f} ± "
            f"{100 * by_leg.std() / np.sqrt(len(by_leg)):.1f} %; within {scale * most:g} {unit}: "
            f"{near.sum()}, {100 * near.mean():.1f} %; error: median {scale * np.median(error):.4f}, "
            f"0.95 quantile {scale * np.quantile(error, 0.95):.4f}, largest {scale * error.max():.4f} {unit}"
        )
        if gains:
            continue
        for seed in np.unique(seeds[~near]).astype(int):
            kept = work / f"least_{seed}.json"
            if not kept.exists():
                write_json(least_errors(folder, int(seed)), kept)
            least = json.loads(kept.read_text())
            of = seeds == seed
            bound = np.array([least["delay"]] if kind == "delay" else least["drives"])
            bound = bound if kind == "delay" else bound[:, KINDS.index(kind)]
            told = ", ".join(
                f"{scale * e:.3f} (least standard error {scale * b:.3f})"
                for e, b in zip(error[of], bound / (size[of] if np.ndim(size) else size), strict=True)
                if e > most
            )
            print(f"    leg {seed}: off by {told} {unit}")
    inside = np.array([lower <= true <= upper for _, _, lower, upper, true, _ in rows])
    print(f"all together    in the interval {inside.sum()} of {len(inside)}, {100 * inside.mean():5.1f} %")


PENDULUM = """<robot name="servo"><link name="base"/><link name="arm">
<inertial><origin xyz="0 0 {z}"/><mass value="{m}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="hinge" type="continuous">
<parent link="base"/><child link="arm"/><axis xyz="0 -1 0"/></joint></robot>"""


def servo(folder: Path, work: Path) -> None:
    """The servo with the known pendulum: R / kt from tracking, inertia from free swings."""
    work.mkdir(parents=True, exist_ok=True)
    path = work / "pendulum.urdf"
    path.write_text(PENDULUM.format(z=-0.1, m=0.49, i=1e-7))
    robot = sy.Robot.from_urdf(path)
    tracking: dict[int, list[dict[str, Array]]] = {}
    free = []
    for kp in (100, 400, 800):
        for run in ("sin_sin", "up_and_down", "sin_time_square", "lift_and_drop"):
            table = np.genfromtxt(folder / f"kp{kp}_{run}.csv", delimiter=",", names=True)
            on = table["enabled"] > 0.5
            columns = {name: table[name] for name in ("t", "q", "duty", "voltage")}
            if run == "lift_and_drop":
                first = int(np.argmax(~on)) + 2
                free.append((f"kp{kp}", {name: values[first:] for name, values in columns.items()}))
            else:
                tracking.setdefault(kp, []).append(columns)
    print(
        "free swings: inertia at the joint (m l² + armature), viscous, Coulomb; README: 0.0067 to 0.0071, 0.007, 0.010"
    )
    off = {"law": "signal", "command": ["duty"], "gain": 1.0, "delay": 0.0, "friction": "coulomb", "bias": "encoder"}
    swings = [{**log, "duty": np.zeros(len(log["t"]))} for _, log in free]
    for name, logs in [(name, [log]) for (name, _), log in zip(free, swings, strict=True)] + [("all", swings)]:
        show(name, identify_from_positions(robot, logs, settings=off), "")
    print("tracking: gain kt / R in N·m / V (README: R / kt 10.6, 11.9, 15.6 by gain, 13.6 all), and the same")
    on_settings = {**off, "scale": "voltage", "gain": "find", "delay": "find", "longest_delay": 0.02}
    loaded = {**on_settings, "find": ["rotor_inertia", "viscous", "coulomb", "coulomb_by_load"]}
    for name, own in (("", on_settings), (" load", loaded)):
        for kp, logs in [*tracking.items(), ("all", [log for some in tracking.values() for log in some])]:
            show(f"kp {kp}{name}", identify_from_positions(robot, logs, settings=own), "R / kt")


def show(name: str, found: Any, gain: str) -> None:
    """One line of the servo."""
    values = {value.kind: value for value in found.values}
    told = [f"{name:8s} error {rms(found.error):6.1f} mrad"]
    rotor = values["rotor_inertia"]
    told.append(f"inertia {0.0049 + rotor.value:.5f} [{0.0049 + rotor.lower:.5f}, {0.0049 + rotor.upper:.5f}]")
    told += [
        f"{kind} {values[kind].value:.4f} [{values[kind].lower:.4f}, {values[kind].upper:.4f}]" for kind in KINDS[1:3]
    ]
    if gain:
        one = values["gain"]
        told.append(f"R/kt {1 / one.value:.2f} [{1 / one.upper:.2f}, {1 / one.lower:.2f}]")
        told.append(f"delay {1e3 * found.delay:.1f} ms")
    if "load_friction" in values:
        load = values["load_friction"]
        told.append(f"friction by load {load.value:.3f} [{load.lower:.3f}, {load.upper:.3f}]")
    told.append(f"encoder bias {values['encoder'].value:.4f}")
    print("; ".join(told), "" if found.settled else "(not settled)")


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=["sweeps", "twins", "servo"])
    parser.add_argument("--twins", type=int, default=100)
    parser.add_argument("--gains", action="store_true", help="of the twins, find the gains as well")
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    parser.add_argument(
        "--work",
        type=Path,
        default=Path("encoders_only"),
        help="folder where twins are kept, so that a run can go on later",
    )
    options = parser.parse_args()
    if "sweeps" in options.parts:
        sweeps(options.data / "go2_encoder_only")
    if "twins" in options.parts:
        twins(options.data / "go2_encoder_only", options.twins, options.work, options.gains)
    if "servo" in options.parts:
        servo(options.data / "payload_xl330", options.work)


if __name__ == "__main__":
    main()
