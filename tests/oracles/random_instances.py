"""Random robots with base parameters of which it is known whether they are possible, without any solver."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

import steelyard as sy

KINDS = ("feasible", "barely feasible", "infeasible", "barely infeasible")


@dataclass(frozen=True)
class Instance:
    """Base parameters and what is known of them.

    `inside` is, for feasible ones, the smallest eigenvalue of the blocks at known parameters, each block with a
    diagonal of ones; for infeasible ones, the negative kinetic energy of a motion over what it was before.
    """

    seed: int
    kind: str
    links: int
    consistency: Literal["full", "inertia"]
    spread: int
    feasible: sy.FeasibleSet
    base: np.ndarray
    inside: float

    @property
    def possible(self) -> bool:
        return "infeasible" not in self.kind


def random_model(rng: np.random.Generator, links: int) -> sy.Model:
    """Rows of Denavit and Hartenberg with right, zero or arbitrary angles, some sliding joints; half have terms."""
    rows: list[tuple[object, object, object, object]] = []
    arbitrary = rng.random() < 0.2
    for _ in range(links):
        angle = float(np.round(rng.uniform(-3, 3), 3)) if arbitrary else str(rng.choice(["-pi/2", "pi/2", "0"]))
        length, offset = (float(np.round(value, 3)) for value in rng.uniform(0.0, 0.5, 2))
        rows.append((angle, length, "q", 0.0) if rng.random() < 0.15 else (angle, length, offset, "q"))
    robot = sy.Robot.from_dh(rows, name="random")
    if rng.random() < 0.5:
        robot = robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia())
    return sy.Model(robot)


def point_cloud(masses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Inertial parameters of point masses, by the definition of moments."""
    inertia = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    return np.concatenate([inertia[np.triu_indices(3)], masses @ points, [masses.sum()]])


def random_parameters(rng: np.random.Generator, model: sy.Model, spread: int, thickness: float) -> np.ndarray:
    """Parameters of bodies made of points; masses of links differ by up to 10**spread; flat to `thickness`."""
    values = np.zeros(model.parameter_count)
    names = {name: index for index, name in enumerate(model.parameter_names)}
    for link in range(len(model.robot.link_names)):
        masses = 10.0 ** rng.uniform(-spread / 2, spread / 2) * rng.uniform(0.1, 1.0, 8)
        points = 10.0 ** rng.uniform(-1.5, 0.0) * rng.normal(size=(8, 3)) * [1.0, 1.0, thickness]
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        body = point_cloud(masses, points @ rotation.T)
        symbols = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")
        for symbol, value in zip(symbols, body, strict=True):
            values[names[f"{symbol}{link + 1}"]] = value
    for name, index in names.items():
        if name.startswith(("Fv", "Fc", "Ia")):
            values[index] = 10.0 ** rng.uniform(-2, 0)
        elif name.startswith("Fo"):
            values[index] = rng.normal()
    return values


def unit_diagonal_eigenvalue(feasible: sy.FeasibleSet, parameters: np.ndarray) -> float:
    """Smallest eigenvalue of the links' blocks, scaled by congruence to a diagonal of ones."""
    smallest = np.inf
    for block in feasible.blocks:
        if block.kind == "link":
            value = block.evaluate(parameters)
            root = np.sqrt(np.diag(value))
            smallest = min(smallest, float(np.linalg.eigvalsh(value / np.outer(root, root))[0]))
    return smallest


def kinetic_energy_row(rng: np.random.Generator, model: sy.Model) -> np.ndarray:
    """y with y·β = 2 T, twice the kinetic energy of a random motion: not negative for any robot that can exist."""
    q, dq = rng.uniform(-np.pi, np.pi, model.robot.dof), rng.normal(size=model.robot.dof)
    rest = np.zeros_like(q)
    rows = model.regressor(q, rest, dq) - model.regressor(q, rest, rest)
    return np.asarray((dq @ rows)[model.base_parameters().independent])


def random_instance(seed: int, most_links: int = 20) -> Instance:
    """One of the four kinds in turn; links differ in mass by up to a million."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % 4]
    consistency: Literal["full", "inertia"] = "full" if rng.random() < 0.5 else "inertia"
    links, spread = int(rng.integers(1, most_links + 1)), int(rng.choice([0, 2, 4, 6]))
    model = random_model(rng, links)
    feasible = sy.FeasibleSet(model, consistency)
    # Flat bodies are on the boundary of "full" alone.
    thickness = 10.0 ** rng.uniform(-4.3, -2.0) if kind == "barely feasible" else 1.0
    parameters = random_parameters(rng, model, spread, thickness)
    base = feasible.K @ parameters
    inside = unit_diagonal_eigenvalue(feasible, parameters)
    if "infeasible" in kind:
        gap = 10.0 ** rng.uniform(-8.5, -3.0) if "barely" in kind else 10.0 ** rng.uniform(-2.0, 0.5)
        row = kinetic_energy_row(rng, model)
        # Change parameters in proportion to their size, so that small links stay what they are.
        size = np.maximum(np.abs(base), 1e-3 * np.abs(base).max())
        base = base - (1.0 + gap) * (row @ base) / (row**2 @ size) * (row * size)
        inside = -gap
    return Instance(seed, kind, links, consistency, spread, feasible, base, inside)
