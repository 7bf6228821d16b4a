"""The functions of a model: what each is called, reads and computes, over generic scalars.

A :class:`Scene` is a robot with scalars in the place of its motion and parameters; every function computes from one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard import graph
from steelyard.errors import InputError
from steelyard.graph import Node
from steelyard.once import cached_property
from steelyard.robot import Robot, Term
from steelyard.robot.robot import Scalars

from . import algorithms
from .algorithms.kinematics import ZERO, JointFrame, Matrix3, Vector3, add, joint_frames, link_poses, product, times
from .algorithms.newton_euler import body_wrench, inverse_dynamics, link_motions
from .algorithms.regressor import regressor
from .algorithms.regrouping import regrouped
from .layout import ParameterLayout, columns_of

__all__ = ["CATALOGUE", "Entry", "Scene", "Value", "forward_dynamics_function"]


@dataclass(frozen=True)
class Value:
    """One array that a function computes: elements in row-major order."""

    name: str
    shape: tuple[int, ...]
    elements: list[Any]
    description: str


@dataclass(frozen=True)
class Scene:
    """A robot with scalars in the place of its motion and parameters.

    Attributes
    ----------
    layout : ParameterLayout
    algebra : module
        Brings ``sin``, ``cos`` and ``sign`` for the scalars.
    scalars : mapping
        For the names of arguments (``"q"``, ``"parameters"``, …) their scalars.
    regroups : bool
        Whether mass may move along joint axes from link to link, see :mod:`.algorithms.regrouping`.
    link : int or None
        The moving link that a function is about.
    placement : sequence of sequence of float or None
        (4, 4) the frame that it is about in the frame of that link; None for the link's own.
    term : str or None
        The kind of the terms that a function is about; None for all.
    """

    layout: ParameterLayout
    algebra: Any
    scalars: Mapping[str, Sequence[Any]]
    regroups: bool = True
    link: int | None = None
    placement: Sequence[Sequence[float]] | None = None
    term: str | None = None

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.layout.robot

    @property
    def gravity(self) -> Vector3:
        """Acceleration of gravity in the base frame."""
        x, y, z = self.scalars.get("gravity") or [float(g) for g in self.robot.gravity]
        return (x, y, z)

    @cached_property
    def frames(self) -> list[JointFrame]:
        """The joints at their positions."""
        lengths = dict(zip(self.robot.lengths, self.scalars.get("lengths", ()), strict=False))
        return joint_frames(self.robot, self.scalars["q"], self.algebra, lengths)

    @cached_property
    def bodies(self) -> tuple[list[JointFrame], list[list[Any]]]:
        """Frames and the parameters of the links, mass moved where that is allowed."""
        links = self.layout.link_parameters(self.scalars["parameters"])
        return regrouped(self.frames, links) if self.regroups else (self.frames, links)

    @cached_property
    def still(self) -> list[Any]:
        """Zeros for the coordinates."""
        return [0.0 * x for x in self.scalars["q"]]

    @property
    def count(self) -> int:
        """Number N of coordinates."""
        return self.robot.dof

    def term_torques(self, q: Scalars, dq: Scalars, ddq: Scalars) -> list[Any]:
        """Return the N torques of the terms."""
        torques: list[Any] = [0.0] * self.count
        for row, column, value in self.layout.terms(q, dq, ddq, self.algebra, self.term, self.scalars.get("channels")):
            torques[row] = torques[row] + self.scalars["parameters"][column] * value
        return torques

    def term_inertias(self) -> list[list[Any]]:
        """Return what the terms add to the inertia matrix: rotors, coupled or not, (N, N)."""
        inertias: list[list[Any]] = [[0.0] * self.count for _ in range(self.count)]
        for k in range(self.count):
            for row, column, value in self.layout.term_inertias(self.scalars["q"], k, self.algebra):
                inertias[row][k] = inertias[row][k] + self.scalars["parameters"][column] * value
        return inertias


def _plus(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [x + y for x, y in zip(a, b, strict=True)]


def _torque(scene: Scene, elements: list[Any], description: str) -> list[Value]:
    return [Value("torque", (scene.count,), elements, f"{description}, N·m or N")]


def _matrix(name: str, rows: Sequence[Sequence[Any]], description: str) -> Value:
    return Value(name, (len(rows), len(rows[0])), [x for row in rows for x in row], description)


def _inverse_dynamics(scene: Scene) -> list[Value]:
    q, dq, ddq = (scene.scalars[name] for name in ("q", "dq", "ddq"))
    frames, links = scene.bodies
    torques = inverse_dynamics(frames, dq, ddq, links, scene.gravity)
    return _torque(scene, _plus(torques, scene.term_torques(q, dq, ddq)), "joint torques of links and terms")


def _gravity(scene: Scene) -> list[Value]:
    still = [0.0] * scene.count
    frames, links = scene.bodies
    return _torque(scene, inverse_dynamics(frames, still, still, links, scene.gravity), "torques that hold the links")


def _computed_torque(scene: Scene) -> list[Value]:
    frames, links = scene.bodies
    torques = inverse_dynamics(frames, scene.scalars["dq"], scene.scalars["ddq"], links, scene.gravity)
    return _torque(scene, torques, "torques of the links alone: M(q) ddq + C(q, dq) dq + g(q)")


def _coriolis(scene: Scene) -> list[Value]:
    frames, links = scene.bodies
    torques = inverse_dynamics(frames, scene.scalars["dq"], [0.0] * scene.count, links, ZERO)
    return _torque(scene, torques, "Coriolis and centripetal torques C(q, dq) dq")


def _coriolis_matrix(scene: Scene) -> list[Value]:
    frames, links = scene.bodies
    rows = algorithms.coriolis_matrix(frames, scene.scalars["dq"], links)
    return [_matrix("matrix", rows, "Coriolis matrix C(q, dq) of the Christoffel symbols, N·m·s/rad, N·s/rad or N·s/m")]


def _inertia_matrix(scene: Scene) -> list[Value]:
    rows = algorithms.inertia_matrix(*scene.bodies)
    return [_matrix("matrix", rows, "inertia matrix M(q) of the links, kg·m², kg·m or kg")]


def _total_inertia_matrix(scene: Scene) -> list[Value]:
    rows = [_plus(a, b) for a, b in zip(algorithms.inertia_matrix(*scene.bodies), scene.term_inertias(), strict=True)]
    return [_matrix("matrix", rows, "inertia matrix of links and rotors, kg·m², kg·m or kg")]


def _drive_torque(scene: Scene) -> list[Value]:
    torques = scene.term_torques(*(scene.scalars[name] for name in ("q", "dq", "ddq")))
    return _torque(scene, torques, "torques of the terms beyond the rigid links")


def _bias(scene: Scene) -> tuple[list[Any], list[Any]]:
    """Return the torques, less those of the terms, and the wrenches of the links, both at zero acceleration."""
    frames, links = scene.bodies
    dq, still = scene.scalars["dq"], scene.still
    motions = link_motions(frames, dq, [0.0] * scene.count, scene.gravity)
    terms = scene.term_torques(scene.scalars["q"], dq, still)
    free = [a - b for a, b in zip(scene.scalars["tau"], terms, strict=True)]
    return free, [body_wrench(motion, p) for motion, p in zip(motions, links, strict=True)]


def _acceleration(scene: Scene, elements: list[Any]) -> list[Value]:
    return [Value("acceleration", (scene.count,), elements, "joint accelerations, rad/s² or m/s²")]


def _forward_dynamics_by_solving(scene: Scene) -> list[Value]:
    frames, links = scene.bodies
    dq, none = scene.scalars["dq"], [0.0] * scene.count
    bias = _plus(
        inverse_dynamics(frames, dq, none, links, scene.gravity),
        scene.term_torques(scene.scalars["q"], dq, scene.still),
    )
    free = [a - b for a, b in zip(scene.scalars["tau"], bias, strict=True)]
    matrix = [_plus(a, b) for a, b in zip(algorithms.inertia_matrix(frames, links), scene.term_inertias(), strict=True)]
    return _acceleration(scene, algorithms.solve_inertia(matrix, free))


def _forward_dynamics_articulated(scene: Scene) -> list[Value]:
    frames, links = scene.bodies
    free, wrenches = _bias(scene)
    rotors = [row[k] for k, row in enumerate(scene.term_inertias())]
    return _acceleration(scene, algorithms.articulated_body(frames, wrenches, links, free, rotors))


def _regressor(scene: Scene) -> list[Value]:
    q, dq, ddq = (scene.scalars[name] for name in ("q", "dq", "ddq"))
    width = len(scene.layout.names)
    elements: list[Any] = [0.0] * (scene.count * width)
    for (row, column), value in scene.layout.with_links(regressor(scene.frames, dq, ddq, scene.gravity)).items():
        elements[row * width + column] = value
    for row, column, value in scene.layout.terms(q, dq, ddq, scene.algebra, None, scene.scalars.get("channels")):
        elements[row * width + column] = value
    return [Value("matrix", (scene.count, width), elements, "regressor H: torques are H times the parameters")]


def _momentum_regressor(scene: Scene) -> list[Value]:
    dq, width = scene.scalars["dq"], len(scene.layout.names)
    elements: list[Any] = [0.0] * (scene.count * width)
    entries = regressor(scene.frames, [0.0] * scene.count, dq, ZERO)
    for (row, column), value in scene.layout.with_links(entries).items():
        elements[row * width + column] = value
    for (row, column), value in scene.layout.term_momenta(scene.scalars["q"], dq, scene.algebra).items():
        elements[row * width + column] = value
    return [Value("matrix", (scene.count, width), elements, "the momentum M(q) dq is this times the parameters")]


def _energy_rows(scene: Scene, links: Sequence[Sequence[Any]]) -> list[Any]:
    elements: list[Any] = [0.0] * len(scene.layout.names)
    for columns, row in zip(scene.layout.links, links, strict=True):
        for column, value in zip(columns, row, strict=True):
            elements[int(column)] = value
    return elements


def _kinetic_row(scene: Scene) -> list[Any]:
    dq = scene.scalars["dq"]
    elements = _energy_rows(scene, algorithms.kinetic_energy_regressor(scene.frames, dq))
    for (row, column), value in scene.layout.term_momenta(scene.scalars["q"], dq, scene.algebra).items():
        elements[column] = elements[column] + 0.5 * (dq[row] * value)
    return elements


def _potential_row(scene: Scene) -> list[Any]:
    elements = _energy_rows(scene, algorithms.potential_energy_regressor(scene.frames, scene.gravity))
    for column, value in scene.layout.term_potentials(scene.scalars["q"], scene.algebra):
        elements[column] = elements[column] + value
    return elements


def _energy_regressor(scene: Scene) -> list[Value]:
    kinetic, potential = _kinetic_row(scene), _potential_row(scene)
    return [
        Value("kinetic", (len(kinetic),), kinetic, "the kinetic energy is this times the parameters"),
        Value("potential", (len(potential),), potential, "the potential energy is this times the parameters"),
    ]


def _weighted(scene: Scene, row: Sequence[Any]) -> Any:
    total: Any = 0.0
    for value, parameter in zip(row, scene.scalars["parameters"], strict=True):
        total = total + value * parameter
    return total


def _kinetic_energy(scene: Scene) -> list[Value]:
    return [Value("energy", (), [_weighted(scene, _kinetic_row(scene))], "kinetic energy of links and rotors, J")]


def _potential_energy(scene: Scene) -> list[Value]:
    text = "potential energy of the links, zero for mass at the origin of the base frame, and of springs, J"
    return [Value("energy", (), [_weighted(scene, _potential_row(scene))], text)]


def _momentum(scene: Scene) -> list[Value]:
    frames, links = scene.bodies
    dq = scene.scalars["dq"]
    elements = inverse_dynamics(frames, [0.0] * scene.count, dq, links, ZERO)
    for (row, column), value in scene.layout.term_momenta(scene.scalars["q"], dq, scene.algebra).items():
        elements[row] = elements[row] + scene.scalars["parameters"][column] * value
    return [Value("momentum", (scene.count,), elements, "generalised momentum of links and rotors, N·m·s or N·s")]


def _derivatives(scene: Scene) -> list[Value]:
    q, dq, ddq = (scene.scalars[name] for name in ("q", "dq", "ddq"))
    frames, links = scene.bodies
    of_links = algorithms.inverse_dynamics_derivatives(frames, dq, ddq, links, scene.gravity)
    torques = [t if isinstance(t, Node) else q[0].graph.node(t) for t in scene.term_torques(q, dq, ddq)]
    of_terms = [graph.jacobian(torques, inputs) for inputs in (q, dq, ddq)]
    blocks = zip(("by_q", "by_dq", "by_ddq"), (of_links.by_q, of_links.by_dq, of_links.by_ddq), of_terms, strict=True)
    units = {"by_q": "position", "by_dq": "velocity", "by_ddq": "acceleration"}
    return [
        _matrix(
            name,
            [_plus(a, b) for a, b in zip(links_, terms, strict=True)],
            f"derivatives of the joint torques (rows) by each joint's {units[name]} (columns)",
        )
        for name, links_, terms in blocks
    ]


_IDENTITY = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


def _chosen(scene: Scene) -> int:
    return len(scene.robot.links) - 1 if scene.link is None else scene.link


def _placed(scene: Scene) -> tuple[Matrix3, Vector3]:
    """Return rotation and position of the chosen frame in that of its moving link."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z) = (scene.placement or _IDENTITY)[:3]
    return ((a, b, c), (d, e, f), (g, h, i)), (x, y, z)


def _pose(scene: Scene) -> list[Value]:
    link_turn, link_place = link_poses(scene.frames)[_chosen(scene)]
    own_turn, own_place = _placed(scene)
    turn, place = product(link_turn, own_turn), add(link_place, times(link_turn, own_place))
    rows = [[*row, place[i]] for i, row in enumerate(turn)] + [[0.0, 0.0, 0.0, 1.0]]
    return [_matrix("pose", rows, "pose of the link frame in the base frame: rotation and position, m")]


def _point(scene: Scene) -> Vector3:
    x, y, z = scene.scalars["point"]
    turn, place = _placed(scene)
    return add(place, times(turn, (x, y, z)))


def _jacobian(scene: Scene) -> list[Value]:
    rows = algorithms.jacobian(scene.frames, _chosen(scene), _point(scene))
    return [_matrix("jacobian", rows, "velocity (rows 1 to 3, m/s) and angular velocity (rad/s) per joint velocity")]


def _jacobian_rate(scene: Scene) -> list[Value]:
    rows = algorithms.jacobian_rate(scene.frames, scene.scalars["dq"], _chosen(scene), _point(scene))
    return [_matrix("jacobian_rate", rows, "time derivative of the Jacobian")]


def _presliding_step(scene: Scene) -> list[Value]:
    from .bristles import Bristles, bristle_step  # few models have any

    moves = zip(scene.scalars["q_before"], scene.scalars["q"], strict=True)
    moved = [after - before for before, after in moves]
    bristles = Bristles(scene.robot)
    states: list[Any] = [0.0] * scene.count
    for k, (d, r, v) in zip(bristles.joints.tolist(), bristles.shapes.T.tolist(), strict=True):
        ratios = [scene.scalars[name][k] / v for name in ("dq_before", "dq")]
        first, last = (1.0 + r * scene.algebra.exp(-(x * x)) for x in ratios)
        _, kept, pulled = bristle_step(moved[k], 0.5 * (first + last), d, scene.algebra)
        states[k] = kept * scene.scalars["presliding_before"][k] + pulled
    text = "state of presliding now, for `channels`; zero at joints without such friction"
    return [Value("presliding", (scene.count,), states, text)]


@dataclass(frozen=True)
class Entry:
    """A function of the catalogue.

    Attributes
    ----------
    arguments : tuple of str
        What it reads, in this order.
    build : callable
        From a scene to what it computes.
    subject : str
        What may be named in parentheses: ``"link"`` as in ``"pose(link7)"``, ``"term"`` as in
        ``"drive_torque(viscous)"``, or nothing.
    drives : bool
        Whether the torques of the terms are in it, so that the sign of Coulomb friction matters.
    by_parameter : bool
        Whether the last index of the outputs counts parameters.
    remembers : bool
        Whether it is about the state of friction, so that only robots whose friction has one have this function.
    weighs : bool
        Whether gravity is in it, so that it may be an argument.
    """

    arguments: tuple[str, ...]
    description: str
    build: Callable[[Scene], list[Value]]
    subject: str = ""
    by_parameter: bool = False
    drives: bool = False
    remembers: bool = False
    weighs: bool = False


_MOTION = ("q", "dq", "ddq")
CATALOGUE: dict[str, Entry] = {
    "inverse_dynamics": Entry(
        (*_MOTION, "parameters"),
        "Inverse dynamics: the joint torques of a motion (thesis eq. 2.7).",
        _inverse_dynamics,
        weighs=True,
        drives=True,
    ),
    "forward_dynamics": Entry(
        ("q", "dq", "tau", "parameters"),
        "Forward dynamics: the accelerations that torques cause, by factors of the inertia matrix (thesis eq. 5.1).",
        _forward_dynamics_by_solving,
        weighs=True,
        drives=True,
    ),
    "forward_dynamics_articulated": Entry(
        ("q", "dq", "tau", "parameters"),
        "Forward dynamics: the joint accelerations that torques cause, with the articulated-body algorithm.",
        _forward_dynamics_articulated,
        weighs=True,
        drives=True,
    ),
    "computed_torque": Entry(
        (*_MOTION, "parameters"),
        "The torques that the links alone need for a motion: M ddq + C dq + g (thesis eq. 5.8).",
        _computed_torque,
        weighs=True,
    ),
    "inertia_matrix": Entry(("q", "parameters"), "The inertia matrix of the links.", _inertia_matrix),
    "total_inertia_matrix": Entry(
        ("q", "parameters"), "The inertia matrix of links and rotors (thesis eq. 5.5, 5.6).", _total_inertia_matrix
    ),
    "coriolis_matrix": Entry(
        ("q", "dq", "parameters"),
        "The Coriolis matrix with the Christoffel symbols: dM/dt - 2 C is skew-symmetric.",
        _coriolis_matrix,
    ),
    "coriolis": Entry(("q", "dq", "parameters"), "Coriolis and centripetal torques of the links.", _coriolis),
    "gravity": Entry(("q", "parameters"), "The torques that hold the links against gravity.", _gravity, weighs=True),
    "drive_torque": Entry(
        (*_MOTION, "parameters"),
        "The torques of friction, rotors and other terms.",
        _drive_torque,
        subject="term",
        drives=True,
    ),
    "momentum": Entry(("q", "dq", "parameters"), "The generalised momentum.", _momentum),
    "kinetic_energy": Entry(("q", "dq", "parameters"), "The kinetic energy.", _kinetic_energy),
    "potential_energy": Entry(("q", "parameters"), "The potential energy.", _potential_energy, weighs=True),
    "regressor": Entry(
        _MOTION,
        "The regressor of inverse dynamics (thesis eq. 2.22).",
        _regressor,
        weighs=True,
        by_parameter=True,
        drives=True,
    ),
    "momentum_regressor": Entry(
        ("q", "dq"), "The regressor of the generalised momentum.", _momentum_regressor, by_parameter=True
    ),
    "energy_regressor": Entry(
        ("q", "dq"),
        "The regressors of kinetic and potential energy.",
        _energy_regressor,
        by_parameter=True,
        weighs=True,
    ),
    "inverse_dynamics_derivatives": Entry(
        (*_MOTION, "parameters"),
        "The partial derivatives of inverse dynamics by positions, velocities and accelerations.",
        _derivatives,
        weighs=True,
        drives=True,
    ),
    "pose": Entry(("q",), "The pose of the frame of a link in the base frame.", _pose, subject="link"),
    "jacobian": Entry(
        ("q", "point"), "The Jacobian of a point of a link in the base frame.", _jacobian, subject="link"
    ),
    "jacobian_rate": Entry(
        ("q", "dq", "point"), "The time derivative of the Jacobian of a point.", _jacobian_rate, subject="link"
    ),
    "presliding_step": Entry(
        ("q_before", "q", "dq_before", "dq", "presliding_before"),
        "One step of the state of friction with presliding, from one sample of a motion to the next.",
        _presliding_step,
        remembers=True,
    ),
}

# Joints up to which factoring the inertia matrix takes fewer operations than articulated bodies: 1327 and 1470 for the
# seven joints of the WAM, 12784 and 12429 for a humanoid of 32 joints.
_FEW_JOINTS = 8


def forward_dynamics_function(robot: Robot, method: str) -> str:
    """Return the function of the catalogue that is a method of forward dynamics.

    Parameters
    ----------
    method : {"automatic", "inertia_matrix", "articulated_body"}

    Raises
    ------
    InputError
        If the method is something else, or articulated bodies do not apply.
    """
    if method not in ("automatic", "inertia_matrix", "articulated_body"):
        raise InputError(f"method must be 'automatic', 'inertia_matrix' or 'articulated_body', got {method!r}.")
    coupled = len(robot.joints) > robot.dof or not all(_acts_alone(term, robot) for term in robot.terms)
    if method == "articulated_body" and coupled:
        raise InputError(
            f"{robot.name} has mimic joints or coupled motors, which articulated bodies do not allow; "
            "use the function 'forward_dynamics', or method='inertia_matrix'."
        )
    articulated = method == "articulated_body" or (method == "automatic" and not coupled and robot.dof > _FEW_JOINTS)
    return "forward_dynamics_articulated" if articulated else "forward_dynamics"


def _acts_alone(term: Term, robot: Robot) -> bool:
    """Tell whether a term of a coordinate acts on that coordinate only."""
    zeros = [0.0] * robot.dof
    logged = dict.fromkeys(term.channels, zeros)
    return all(
        row == k
        for k in range(robot.dof)
        for column in columns_of(term, k, (zeros, zeros, zeros), np, logged)
        for row in column
    )
