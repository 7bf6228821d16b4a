"""The seven-joint WAM arm of thesis chapter 4, simulated with known parameters, and the demonstration of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.display import text_table
from steelyard.dynamics import Coulomb, Model, MotorSide, Offset, Viscous
from steelyard.excitation import FourierTrajectory
from steelyard.files import write_text
from steelyard.recording import Recording
from steelyard.robot import Inertia, Robot
from steelyard.robot.inertia import inertia_tensor

from .examples import deviating
from .identify import identify
from .parameter_table import ParameterTable
from .result import Identification

__all__ = [
    "ENCODER_COUNTS",
    "TRAJECTORIES",
    "beside_truth",
    "demonstrate",
    "measured",
    "robot_toml",
    "simulated_log",
    "true_parameters",
    "wam_model",
    "wrong_cad",
]

Array = NDArray[np.float64]

# Thesis table 4.1: standard Denavit-Hartenberg rows alpha, a, d, theta.
DH_ROWS: tuple[tuple[str | float, ...], ...] = (
    ("-pi/2", 0, 0, "q"),
    ("pi/2", 0, 0, "q"),
    ("-pi/2", 0.045, 0.55, "q"),
    ("pi/2", -0.045, 0, "q"),
    ("-pi/2", 0, 0.3, "q"),
    ("pi/2", 0, 0, "q"),
    (0, 0, 0.06, "q"),
)

# Thesis eq. 4.5 with n3 = 1.68 and n6 = 1, motor ratios set to one (4.12): the two differentials.
_N3 = 1.68
COUPLING: tuple[tuple[float, ...], ...] = (
    (-1, 0, 0, 0, 0, 0, 0),
    (0, 1, -1, 0, 0, 0, 0),
    (0, -1 / _N3, -1 / _N3, 0, 0, 0, 0),
    (0, 0, 0, 1, 0, 0, 0),
    (0, 0, 0, 0, 1, 1, 0),
    (0, 0, 0, 0, -1, 1, 0),
    (0, 0, 0, 0, 0, 0, -1),
)

# Mass (kg), centre of mass (m) and inertia about it (kg m²: xx xy xz yy yz zz) in the frames of the rows above, as the
# manufacturer gives them: the truth of the simulation.
_BODIES: tuple[tuple[float, tuple[float, ...], tuple[float, ...]], ...] = (
    (10.76769, (-0.00443, 0.12189, -0.00066), (0.134880, -0.002130, -0.000125, 0.113284, 0.000686, 0.090463)),
    (3.87494, (-0.00237, 0.03106, 0.01542), (0.021410, 0.000272, 0.000025, 0.013779, -0.001819, 0.015589)),
    (1.80228, (-0.03826, 0.20751, 0.00003), (0.059111, -0.002496, 0.000007, 0.003246, -0.000018, 0.059270)),
    (2.40017, (0.00499, -0.00023, 0.13272), (0.014917, 0.000017, -0.001506, 0.014829, -0.000021, 0.002945)),
    (0.12376, (0.00009, 0.00511, 0.00436), (0.000050, 0.0, 0.0, 0.000076, -0.000004, 0.000063)),
    (0.41797, (-0.00012, -0.01703, 0.02468), (0.000555, 0.000001, -0.000001, 0.000244, -0.000046, 0.000454)),
    (0.06865, (-0.00008, 0.00016, -0.00324), (0.000038, 0.0, 0.0, 0.000038, 0.0, 0.000074)),
)

# Friction and rotor inertia of the order of thesis table 4.9: Fvj Fcj Foj, then Fvm Fcm Fom Iam.
_DRIVES: tuple[tuple[float, ...], ...] = (
    (0.9, 1.0, -0.04, 0.73, 0.81, 0.02, 0.08),
    (0.65, 0.05, 0.45, 0.386, 0.755, -0.06, 0.0065),
    (0.34, 0.36, 0.03, 0.40, 0.70, -0.07, 0.064),
    (0.30, 0.28, -0.06, 0.277, 0.275, -0.058, 0.0050),
    (0.020, 0.005, -0.006, 0.0275, 0.0567, 0.003, 0.0025),
    (0.034, 0.037, 0.001, 0.0122, 0.0606, -0.002, 0.0010),
    (0.015, 0.010, -0.006, 0.0124, 0.0083, 0.0055, 0.0004),
)

# Thesis tables 4.4 and 4.5: for each joint a1 to a6, b1 to b6 (rad/s) and the constant (rad).
_SERIES: dict[str, tuple[tuple[float, ...], ...]] = {
    "A": (
        (0.53, -0.01, 0.17, 0.08, 0.60, 0.20, -0.38, -0.17, 0.21, 0.11, -0.35, 0.15, 0.50),
        (0.43, -0.19, 0.34, 0.24, 0.11, 0.05, -0.04, 0.19, -0.43, -0.19, -0.45, 0.36, -0.11),
        (0.00, 0.55, -0.12, 0.39, -0.13, -0.07, 0.38, 1.21, 0.27, 0.55, 0.06, -0.32, 0.54),
        (0.32, -0.20, -0.50, 0.17, 0.06, -0.15, -0.44, 0.00, 0.58, -0.10, 0.46, 0.01, 1.76),
        (0.06, -0.03, -0.41, -0.02, 0.65, 0.68, -0.36, 0.66, 0.43, -0.18, -0.14, -0.14, -1.28),
        (0.48, 0.03, 0.32, 0.13, 0.04, 0.20, -0.07, 0.55, 0.38, 0.19, 0.45, 0.15, -0.11),
        (0.79, 0.70, 0.08, 0.02, 1.22, -0.28, 0.40, -0.13, 0.31, 0.79, -0.09, 0.49, 0.42),
    ),
    "B": (
        (0.02, 0.55, 0.08, -0.30, 0.46, 0.14, -0.41, 0.26, 0.15, 0.50, -0.60, -0.21, 0.15),
        (-0.27, 0.41, -0.15, -0.30, 0.08, -0.15, 0.27, -0.47, -0.28, -0.51, 0.11, -0.34, -0.24),
        (0.01, -0.52, 0.62, -0.14, -0.46, 0.47, -0.02, -0.20, -0.15, -0.41, 0.73, 0.04, 0.39),
        (0.00, -0.16, 0.06, 0.39, 0.55, -0.04, 0.60, -0.06, 0.69, 0.25, -0.66, 0.12, 1.18),
        (-0.79, -1.34, 0.50, -0.62, -0.30, -0.55, -0.08, 0.01, -0.59, 0.42, -0.43, 0.43, -1.41),
        (0.07, 0.22, 0.39, 0.12, -0.45, 1.05, -0.39, -0.15, 0.51, 0.14, -0.20, 0.13, 0.02),
        (-0.12, -0.80, 0.29, 0.07, 0.99, -0.28, -0.64, -0.75, -0.55, 0.81, 0.36, -0.65, -0.07),
    ),
}

TRAJECTORIES = {
    name: FourierTrajectory(
        a=np.array([row[:6] for row in rows]),
        b=np.array([row[6:12] for row in rows]),
        center=np.array([row[12] for row in rows]),
        frequency=0.08,
    )
    for name, rows in _SERIES.items()
}

# Encoder counts a joint turn: 4096 on the motor times the ratio of thesis eq. 4.4.
ENCODER_COUNTS = 4096.0 * np.array([42.0, 28.25, 28.25, 18.0, 10.27, 10.27, 14.93])
# Deviation of the torques from the model, N·m: about the residuals of thesis tables 4.6 and 4.7. Cables and gears give
# it a time constant, so that it does not average out as white noise would.
_TORQUE_DEVIATION = np.array([0.45, 0.55, 0.30, 0.22, 0.05, 0.05, 0.03])
_TORQUE_TIME_CONSTANT = 0.02

CAD_ERROR = 0.3
"""Standard deviation of what the robot file says of the links, relative to the truth: CAD without cables, or with
another density or an older motor, is wrong by about as much."""
CAD_SEED = 2014
"""The seed of the errors of CAD; the first that was tried."""


def wam_model() -> Model:
    """Return the model of thesis section 4.2: 119 parameters, 76 base parameters (table 4.2)."""
    robot = Robot.from_dh(DH_ROWS, name="wam")
    return Model(robot.with_terms(Viscous(), Coulomb(), Offset(), MotorSide(coupling=COUPLING)))


def true_parameters() -> Array:
    """Return the 119 parameters of the simulated arm: its bodies, and friction of the order of table 4.9."""
    return np.concatenate([[*body.parameters, *drive] for body, drive in zip(_true_bodies(), _DRIVES, strict=True)])


def wrong_cad() -> dict[str, Inertia]:
    """Return what the robot file says of the links: their true inertias, each wrong by tens of percent.

    They are off by deviates of 0.3, see `steelyard.identification.examples.deviating`; always the same ones.
    """
    random = np.random.default_rng(CAD_SEED)
    return {f"link{k}": deviating(true, CAD_ERROR, random) for k, true in enumerate(_true_bodies(), start=1)}


def _true_bodies() -> list[Inertia]:
    return [Inertia.from_com(mass, com, inertia_tensor(elements)) for mass, com, elements in _BODIES]


def simulated_log(
    model: Model,
    trajectory: str,
    seed: int,
    rate: float = 1000.0,
    periods: float = 3.0,
    parameters: Array | None = None,
) -> Recording:
    """Return what a recording of a trajectory would hold: encoder positions and torques, both with their noise.

    The arm follows the reference perfectly; its torques come from inverse dynamics.

    Parameters
    ----------
    model : Model
        Of `wam_model`.
    trajectory : {"A", "B"}
        Thesis tables 4.4 and 4.5.
    seed : int
    rate : float
        Hz.
    periods : float
        Of 12.5 s.
    parameters : ndarray, optional
        (n,) of another arm than that of `true_parameters`.
    """
    generator = np.random.default_rng([seed, ord(trajectory)])
    t, q, dq, ddq = TRAJECTORIES[trajectory].sample(rate, periods)
    torque = model.inverse_dynamics(q, dq, ddq, true_parameters() if parameters is None else parameters)
    q, torque = measured(q, torque, generator.standard_normal(q.shape), rate)
    return Recording(t=t, q=q, torque=torque, source=f"simulated trajectory {trajectory}")


def measured(q: Array, torque: Array, white: Array, rate: float) -> tuple[Array, Array]:
    """Return what the arm tells of positions and torques: steps of its encoders, and what its model does not explain.

    The torques deviate from the model by noise with a time constant, which white noise (S, 7) is filtered to.
    """
    from scipy.signal import lfilter

    keep = np.exp(-1.0 / (_TORQUE_TIME_CONSTANT * rate))
    deviations = _TORQUE_DEVIATION * lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], white, axis=0)
    step = 2.0 * np.pi / ENCODER_COUNTS
    return np.round(q / step) * step, np.round(torque + deviations, 5)


def robot_toml() -> str:
    """Return the robot file of the arm."""
    rows = "\n".join(f"    {list(row)!r}," for row in DH_ROWS).replace("'", '"')
    coupling = "\n".join(f"    {[float(x) for x in row]!r}," for row in COUPLING)
    bodies = "".join(_inertial(name, inertia) for name, inertia in wrong_cad().items())
    return f"""\
# The seven-joint WAM arm of C. D. Sousa's thesis (2014), chapter 4.
name = "wam"

[description]
convention = "standard" # thesis table 4.1
rows = [ # alpha, a, d, theta
{rows}
]

# CAD as it often is: each link wrong by tens of percent.
{bodies}
# Joint-side friction and offset, then what the motors add through the differentials (thesis eq. 4.10, 4.11).
[[terms]]
kind = "viscous"

[[terms]]
kind = "coulomb"

[[terms]]
kind = "offset"

[[terms]]
kind = "motor_side"
coupling = [ # thesis eq. 4.5 and 4.12
{coupling}
]

[log]
time = "t"
position = "q{{}}"
torque = "tau{{}}"

[processing] # thesis section 4.3.3
cutoff = 4.8
order = 3
trim = 0.5
"""


def _inertial(name: str, inertia: Inertia) -> str:
    """The table of a robot file that gives the inertia of a link."""
    elements = inertia.about_com[np.triu_indices(3)]
    numbers = [float(f"{value:.6g}") for value in elements + 0.0]
    return f"""\
[[description.inertials]]
link = "{name}"
mass = {inertia.mass:.5g}
center_of_mass = {inertia.com.round(6).tolist()}
inertia = {numbers}

"""


def demonstrate(
    folder: str | Path, *, seed: int = 2014, progress: Callable[[str], None] | None = None
) -> Identification:
    """Simulate recordings of the WAM on trajectories A and B, identify from A and validate on B.

    The robot file says of the links what `wrong_cad` does.

    Parameters
    ----------
    folder : str or Path
        Receives ``robot.toml``, ``trajectory-a.csv`` and ``trajectory-b.csv``.
    seed : int
        Of the noise.
    progress : callable, optional
        Called with a few words before each step.
    """
    say = progress or (lambda _: None)
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    robot_file = place / "robot.toml"
    write_text(robot_toml(), robot_file)
    model = wam_model()
    logs = []
    for name in ("A", "B"):
        say(f"simulating the arm on trajectory {name}")
        logs.append(place / f"trajectory-{name.lower()}.csv")
        simulated_log(model, name, seed).save(logs[-1])
    return identify(robot_file, logs[:1], validate=logs[1:], progress=progress)


HEAVY = 0.05
"""Part of the whole mass from which the centre of mass of a link is shown: lighter ones change torques little."""


def beside_truth(table: ParameterTable, symbols: str = "mtcFI") -> tuple[str, str]:
    """Compare an answer for the simulated arm with the parameters that it was simulated with.

    Parameters
    ----------
    table : ParameterTable
        Of `demonstrate`.
    symbols : str
        First letters of the names that the table shows, in this order: masses and their total ("m", "t"), centres of
        mass of links that are more than a twentieth of the arm ("c"), friction ("F") and rotor inertias ("I").

    Returns
    -------
    str
        A table: truth, CAD, answer, interval and what it rests on.
    str
        How many of all the intervals hold the truth, in a sentence.
    """
    truth = _true_values()
    shown, outside = [], []
    told = [row for row in table if row.name in truth and np.isfinite(row.value)]
    for row in told:
        true = truth[row.name]
        holds = row.lower <= true <= row.upper
        if not holds:
            outside.append(row.name)
        mass = truth.get(f"m{row.name[2:]}", 0.0) if row.name[0] == "c" else np.inf
        if row.name[0] in symbols and row.name[:2] != "Fo" and mass >= HEAVY * truth["total mass"]:
            numbers = (true, row.cad, row.value, row.lower, row.upper)
            cells = ("" if np.isnan(v) else "open" if np.isinf(v) else f"{v:.3g}" for v in numbers)
            shown.append((row.name, *cells, row.unit, row.rests_on, "" if holds else "missed"))
    heads = ("name", "truth", "CAD", "identified", "from", "to", "unit", "rests on", "")
    sentence = f"The truth lies in {len(told) - len(outside)} of {len(told)} intervals"
    missed = f", not in those of {', '.join(outside)}" if outside else ""
    shown.sort(key=lambda cells: symbols.index(cells[0][0]))
    return text_table(heads, shown, numbers=(1, 2, 3, 4, 5)), f"{sentence} of 95 %{missed}."


def _true_values() -> dict[str, float]:
    """The parameters of the simulated arm, masses and centres of mass, by the names of the table."""
    values, model = true_parameters(), wam_model()
    found = dict(zip(map(str, model.parameter_names), values.tolist(), strict=True))
    for number, columns in enumerate(model.link_columns, start=1):
        for axis, moment in zip("xyz", values[columns[6:9]], strict=True):
            found[f"c{axis}{number}"] = float(moment / values[columns[9]])
    found["total mass"] = sum(mass for mass, _, _ in _BODIES)
    return found
