"""Complete examples: folders with a robot, two logs of a simulated experiment, and what must come out of them."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.control.play import play
from steelyard.display import percent, text_table
from steelyard.dynamics import Coulomb, Model, Offset, RotorInertia, Viscous
from steelyard.errors import InputError, missing_extra
from steelyard.excitation import FourierTrajectory, RestToRestTrajectory
from steelyard.files import replaced_folder, suggestion, write_text
from steelyard.once import cached_property
from steelyard.recording import Recording
from steelyard.regression import Estimate
from steelyard.robot import Inertia, Robot, Term, TermParameter
from steelyard.simulation import Sensors

__all__ = ["EXAMPLES", "RECORDINGS", "Example", "PublicRecording", "deviating", "list_examples", "write_example"]

Array = NDArray[np.float64]

DEVIATION = 0.15
"""Standard deviation of what the description says of the links of the simulated robots, relative to the truth."""
RATE = 1000.0  # Hz, of the control loop
LOG_EVERY = 4  # samples of the loop for a row of the log, as drives report at 250 Hz
SECONDS = 20.0
HARMONICS = 5
ENCODER_COUNTS = 2**17  # a turn of the joint, as many arms have
TORQUE_NOISE = 0.02  # of the root mean square of each joint's torque; and what lasts
NOISE_LASTS = 0.01  # s; gears and cables deviate for longer than a sample
BREAKAWAY, BREAKAWAY_SPEED = 0.05, 0.03
"""Friction near standstill that the identified model does not have: a part of the Coulomb friction, and rad/s."""


class _Breakaway(Term):
    """Friction that falls off with speed, F sign(dq) / (1 + (dq / v)²): a Stribeck curve without its exponential."""

    kind = "breakaway"
    parameters = (TermParameter("Fb", "N·m", "N", "friction at standstill beyond Coulomb's", nonnegative=True),)

    def columns(self, k: int, q: Any, dq: Any, ddq: Any, algebra: Any) -> tuple[dict[int, Any], ...]:
        """Return the column of Fb."""
        speed = dq[k] * (1.0 / BREAKAWAY_SPEED)
        return ({k: algebra.sign(dq[k]) / (1.0 + speed * speed)},)

    def to_dict(self) -> dict[str, Any]:
        """Return the kind alone."""
        return {"kind": self.kind}


@dataclass(frozen=True)
class Example:
    """A robot of the package ``example-robot-data`` whose experiment is simulated.

    Attributes
    ----------
    title : str
        Maker and robot.
    urdf : str
        Path in the package.
    tip : str or None
        The link at which the arm ends.
    rotors : bool
        Whether the robot has gears, so that the motors' rotors count.
    seed : int
        Of the truth, the motions and the noise.
    """

    title: str
    urdf: str
    tip: str | None
    rotors: bool
    seed: int = 1

    def robot(self) -> Robot:
        """Read the robot's description from the package.

        Raises
        ------
        InputError
            If the package is not installed.
        """
        return Robot.from_urdf(_package_folder() / self.urdf, tip=self.tip)


EXAMPLES = {
    "panda": Example("Franka Emika Panda", "panda_description/urdf/panda.urdf", "panda_link8", False),
    "ur5": Example("Universal Robots UR5", "ur_description/urdf/ur5_robot.urdf", "ee_link", True),
    "xarm7": Example("UFACTORY xArm 7", "xarm_description/urdf/xarm7.urdf", "link7", True),
    "z1": Example("Unitree Z1", "z1_description/urdf/z1.urdf", "link06", True),
    "j2s6s200": Example("Kinova Jaco 2, 6 joints", "kinova_description/robots/kinova.urdf", "j2s6s200_link_6", True),
    "so101": Example("SO-101, a hobby arm", "so_arm_description/urdf/so101.urdf", None, True),
    "ur3": Example("Universal Robots UR3", "ur_description/urdf/ur3_robot.urdf", "ee_link", True),
    "ur10": Example("Universal Robots UR10", "ur_description/urdf/ur10_robot.urdf", "ee_link", True),
    "talos": Example("PAL Talos, left arm", "talos_data/robots/talos_left_arm.urdf", "arm_left_7_link", True),
    "tiago": Example("PAL Tiago, lift and arm", "tiago_description/robots/tiago.urdf", "arm_7_link", True),
    "go2": Example("Unitree Go2, one leg", "go2_description/urdf/go2.urdf", "FL_foot", True),
}
"""By the name that `steelyard example` takes."""


@dataclass(frozen=True)
class PublicRecording:
    """A real recording that others have published.

    Attributes
    ----------
    commit : str
        The hash of the commit that is meant, which determines every byte of the files.
    """

    robot: str
    repository: str
    commit: str
    folder: str
    licence: str


RECORDINGS = (
    PublicRecording(
        "Stäubli TX40", "github.com/thanhndv212/figaroh-plus", "c3b5172", "examples/staubli_TX40", "Apache-2.0"
    ),
    PublicRecording(
        "Universal Robots UR10",
        "github.com/unisa-acg/inverse-dynamics-solver",
        "41e196d",
        "ur10_inverse_dynamics_solver/bagfiles",
        "BSD-3-Clause",
    ),
    PublicRecording(
        "Kinova Gen3", "github.com/wissem01chiha/dynamic-identification", "3b3baef", "pyDynaMapp/data/kinova", "CC0-1.0"
    ),
)
"""Where recordings of real arms are to be had."""


def deviating(inertia: Inertia, deviation: float, random: np.random.Generator) -> Inertia:
    """Return an inertia that is off by a relative deviation, as that of CAD without cables or of an older motor is.

    The mass, and the inertia about the centre of mass once more, are multiplied by the exponential of a normal deviate,
    and the components of the centre of mass by one plus such a deviate. What was physically possible stays so.

    Parameters
    ----------
    inertia : Inertia
        With a mass above zero.
    deviation : float
        Standard deviation.
    random : numpy.random.Generator

    Examples
    --------
    >>> import numpy as np
    >>> ball = Inertia.from_com(2.0, [0.0, 0.0, 0.1], 0.01 * np.eye(3))
    >>> deviating(ball, 0.0, np.random.default_rng(0)).mass
    2.0
    """
    heavier, wider = np.exp(deviation * random.standard_normal(2))
    center = inertia.com * (1.0 + deviation * random.standard_normal(3))
    return Inertia.from_com(inertia.mass * heavier, center, inertia.about_com * heavier * wider)


@dataclass(frozen=True, eq=False)
class _Experiment:
    """The simulated robot of an example: its truth, and the logs of its experiments."""

    example: Example
    robot: Robot

    @cached_property
    def model(self) -> Model:
        """The model that is identified."""
        rotors = (RotorInertia(),) if self.example.rotors else ()
        return Model(self.robot.with_terms(Viscous(), Coulomb(), Offset(), *rotors))

    @cached_property
    def bodies(self) -> Array:
        """The true parameters of the links, with zeros for all others, (n,)."""
        model, random = self.model, np.random.default_rng(self.example.seed)
        values = np.nan_to_num(np.asarray(model.robot.parameters))
        for columns in model.link_columns:
            if values[columns[9]] > 0.0:
                body = Inertia.from_parameters(values[columns])
                values[columns] = deviating(body, DEVIATION, random).parameters
        values[np.setdiff1d(np.arange(len(values)), model.link_columns)] = 0.0
        return values

    def trajectory(self, log: int) -> RestToRestTrajectory:
        """A motion from rest to rest within the middle of each joint's range; one of its own for each log."""
        random = np.random.default_rng([self.example.seed, log])
        joints = [self.robot.joints[index] for index in self.robot.driving_joints]
        low = np.array([max(joint.lower, -np.pi) for joint in joints])
        high = np.array([min(joint.upper, np.pi) for joint in joints])
        a, b = random.standard_normal((2, len(joints), HARMONICS))
        frequency = 1.0 / SECONDS
        unit = FourierTrajectory(a=a, b=b, center=np.zeros(len(joints)), frequency=frequency)
        q, dq, _ = unit.motion(np.arange(0.0, SECONDS, 0.01))
        # 0.35 of the range to either side leaves room for what the offset of the series adds, 1.2 rad keeps arms from
        # reaching through themselves most of the time, and half of the speed is what a careful operator allows.
        most = np.minimum(0.35 * (high - low), 1.2) / np.abs(q).max(axis=0)
        speed = 0.5 * np.array([min(joint.velocity_limit, 4.0) for joint in joints]) / np.abs(dq).max(axis=0)
        size = np.minimum(most, speed)[:, None]
        series = FourierTrajectory(a=a * size, b=b * size, center=0.5 * (low + high), frequency=frequency)
        return RestToRestTrajectory(series, ramp_time=1.0)

    @cached_property
    def sizes(self) -> Array:
        """Root mean square of the torques that the links alone need in the first motion, (N,), none below a tenth."""
        t = np.arange(0.0, SECONDS, 0.02)
        torque = self.model.inverse_dynamics(*self.trajectory(0).motion(t), self.bodies)
        size = np.sqrt((torque**2).mean(axis=0))
        return np.asarray(np.maximum(size, 0.1 * size.max()))

    @cached_property
    def truth(self) -> Array:
        """The true parameters of the identified model, (n,)."""
        model, random = self.model, np.random.default_rng([self.example.seed, 1])
        values, places = self.bodies.copy(), {str(name): k for k, name in enumerate(model.parameter_names)}
        q = self.trajectory(0).motion(np.arange(0.0, SECONDS, 0.5))[0]
        inertia = np.diagonal(model.inertia_matrix(q, self.bodies), axis1=1, axis2=2).mean(axis=0)
        for joint, (size, mass) in enumerate(zip(self.sizes, inertia, strict=True), start=1):
            coulomb, viscous, offset, rotor = random.uniform((0.10, 0.05, -0.02, 0.2), (0.25, 0.15, 0.02, 0.6))
            for name, value in (("Fcj", coulomb), ("Fvj", viscous), ("Foj", offset)):
                values[places[f"{name}{joint}"]] = float(f"{value * size:.3g}")
            if f"Ia{joint}" in places:
                values[places[f"Ia{joint}"]] = float(f"{rotor * mass:.3g}")
        return values

    def log(self, number: int) -> Recording:
        """The log of an experiment, by a control loop with encoders and noisy torques."""
        model = Model(self.robot.with_terms(*self.model.robot.terms, _Breakaway()))
        parameters = np.zeros(model.parameter_count)
        places = {str(name): k for k, name in enumerate(model.parameter_names)}
        for name, value in zip(self.model.parameter_names, self.truth, strict=True):
            parameters[places[str(name)]] = value
            if str(name).startswith("Fcj"):
                parameters[places[f"Fb{str(name)[3:]}"]] = BREAKAWAY * value
        sensors = Sensors(
            encoder_resolution=2.0 * np.pi / ENCODER_COUNTS,
            torque_noise=TORQUE_NOISE * self.sizes,
            torque_time_constant=NOISE_LASTS,
        )
        played = play(
            model,
            parameters,
            self.trajectory(number),
            rate=RATE,
            sensors=sensors,
            sign_width=BREAKAWAY_SPEED / 10.0,
            seed=10 * self.example.seed + number,
        )
        rows = slice(None, None, LOG_EVERY)
        return Recording(t=played.t[rows], q=played.q[rows], torque=played.torque[rows], source=f"log {number}")

    def truth_estimate(self) -> Estimate:
        """The truth as an estimate, for `steelyard validate` and `steelyard compare`."""
        model, base = self.model, self.model.base_parameters()
        return Estimate(
            method="the truth of the simulation",
            base_names=base.names,
            base_expressions=base.expressions,
            base=base.values(self.truth),
            standard_error=np.zeros(base.count),
            joint_names=model.robot.joint_names,
            relative_error=np.nan,
            row_count=0,
            condition_number=np.inf,
            parameter_names=tuple(map(str, model.parameter_names)),
            parameters=self.truth,
            description={} if self.example.tip is None else {"tip": self.example.tip},
        )

    def error_of_truth(self, number: int, log: Recording) -> float:
        """What the true parameters miss of a log's torques, as a part of them: noise, and friction near standstill."""
        moved = self.trajectory(number).motion(log.t)
        missed = log.torque - self.model.inverse_dynamics(*moved, self.truth)
        return float(np.linalg.norm(missed) / np.linalg.norm(log.torque))


def write_example(name: str, folder: str | Path, *, progress: Callable[[str], None] | None = None) -> Path:
    """Write a complete example: a robot, two logs of a simulated experiment with it, and what must come out.

    The robot is one of the package ``example-robot-data``. What is simulated is not the robot of its description:
    masses, centres of mass and inertias of the links deviate from it by 15 %, and there are friction and rotors. The
    log has the resolution of encoders, noisy torques, and friction near standstill that the identified model lacks.

    Parameters
    ----------
    name : str
        A key of `EXAMPLES`.
    folder : str or Path
        Receives ``robot.urdf``, ``robot.toml``, ``train.csv``, ``validate.csv``, ``truth.json`` (an estimate that
        holds the true parameters) and ``README.md``.
    progress : callable, optional
        Called with a few words before each step.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    InputError
        For an unknown name, or where the package is not installed.
    """
    if name not in EXAMPLES:
        raise InputError(f"There is no example {name!r}; {suggestion(name, EXAMPLES)}.")
    say = progress or (lambda _: None)
    example = EXAMPLES[name]
    experiment = _Experiment(example, example.robot())
    errors = []
    with replaced_folder(folder) as made:
        shutil.copyfile(_package_folder() / example.urdf, made / "robot.urdf")
        for number, log in enumerate(("train.csv", "validate.csv")):
            say(f"simulating {log}")
            recording = experiment.log(number)
            recording.save(made / log)
            errors.append(experiment.error_of_truth(number, recording))
        write_text(_robot_toml(name, example), made / "robot.toml")
        experiment.truth_estimate().save(made / "truth.json")
        write_text(_read_me(experiment, errors), made / "README.md")
    return Path(folder)


def _robot_toml(name: str, example: Example) -> str:
    rotors = '\n[[terms]]\nkind = "rotor_inertia"\n' if example.rotors else ""
    tip = "" if example.tip is None else f'tip = "{example.tip}"\n'
    return f"""\
# {example.title}, as the package example-robot-data describes it.
name = "{name}"

[description]
urdf = "robot.urdf"
{tip}
[[terms]]
kind = "viscous"

[[terms]]
kind = "coulomb"

[[terms]]
kind = "offset"
{rotors}
[log]
time = "t"
position = "q{{}}"
torque = "tau{{}}"
"""


def _read_me(experiment: _Experiment, errors: list[float]) -> str:
    """Return what the folder holds, what to run, and what must come out."""
    model, truth = experiment.model, experiment.truth
    described = np.nan_to_num(np.asarray(model.robot.parameters))
    rows = []
    for link, columns in zip(model.robot.link_names, model.link_columns, strict=True):
        cad, true = (values[columns] for values in (described, truth))
        if true[9] > 0.0:
            centers = [" ".join(f"{v:.3f}" for v in values[6:9] / values[9]) for values in (cad, true)]
            rows.append((link, f"{cad[9]:.3f}", f"{true[9]:.3f}", *centers))
    masses = [float(values[[columns[9] for columns in model.link_columns]].sum()) for values in (described, truth)]
    head = ("link", "CAD, kg", "truth, kg", "centre of mass in CAD, m", "in truth, m")
    places = {str(parameter): value for parameter, value in zip(model.parameter_names, truth, strict=True)}
    kinds = ("Fvj", "Fcj", "Foj", *(("Ia",) if experiment.example.rotors else ()))
    drives = [
        (joint, *(f"{places[f'{kind}{number}']:.3g}" for kind in kinds))
        for number, joint in enumerate(model.robot.joint_names, start=1)
    ]
    kept = " and rotors" if experiment.example.rotors else ""
    return f"""\
# {experiment.example.title}: a simulated experiment

    steelyard identify robot.toml train.csv --validate validate.csv --output result
    steelyard compare result truth.json
    steelyard validate robot.toml truth.json validate.csv

`robot.urdf` is the description in the package example-robot-data; its meshes stay there. The robot that was simulated
is another one: the masses, centres of mass and inertias of its links deviate by {percent(DEVIATION)}, and it has
friction{kept}. It followed two motions from rest to rest of {SECONDS + 2:g} s under a controller at {RATE:g} Hz. These
motions keep the limits of the joints, but nothing else: do not play them on a real robot.

The logs have {RATE / LOG_EVERY:g} rows a second, positions in steps of an encoder of {ENCODER_COUNTS} counts a turn,
and torques with noise of {percent(TORQUE_NOISE)} of each joint's torque, or of the arm's where a joint has little. Near
standstill the friction rises by {percent(BREAKAWAY)} of the Coulomb friction, which the identified model does not have.

## What must come out

- The total mass is {masses[1]:.3g} kg; the description says {masses[0]:.3g} kg.
- The true parameters miss {percent(errors[0], 2)} of the torques of `train.csv` and {percent(errors[1], 2)} of those of
  `validate.csv`, unfiltered. No model can do much better on a motion that it was not identified from.
- The intervals of 95 % hold the truth for at least nine in ten parameters.

The truth is in `truth.json`, in the format of estimates:

{_markdown(head, rows)}

{_markdown(("joint", *(f"{kind} ({_UNITS[kind]})" for kind in kinds)), drives)}
"""


_UNITS = {"Fvj": "viscous, N·m·s/rad", "Fcj": "Coulomb, N·m", "Foj": "offset, N·m", "Ia": "rotor, kg·m²"}


def _markdown(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def list_examples() -> str:
    """Return a table of the examples, and where real recordings are to be had."""
    table = text_table(("name", "robot"), [(name, example.title) for name, example in EXAMPLES.items()])
    real = text_table(
        ("robot", "repository", "commit", "folder", "licence"),
        [(r.robot, r.repository, r.commit, r.folder, r.licence) for r in RECORDINGS],
    )
    return f"{table}\n\nReal recordings that others have published:\n{real}"


def _package_folder() -> Path:
    """The folder of robots in the package example-robot-data; told to be missing where that is not installed."""
    for place in sys.path:
        folder = Path(place, "cmeel.prefix", "share", "example-robot-data", "robots")
        if folder.is_dir():
            return folder
    raise missing_extra(
        "The examples need the robots of the package example-robot-data, which is not installed", "examples"
    )
