"""Problems for every method: free links, random arms, and the real WAM."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steelyard.dynamics import Coulomb, Model, Offset, Viscous
from steelyard.dynamics.threads import one_thread
from steelyard.lmi import AffineBlock
from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.robot import Robot

SYMBOLS = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


def points(random, length=0.3, mass=1.0):
    """Inertial parameters of eight points, by the definition of moments."""
    masses, places = mass * random.uniform(0.1, 1.0, 8), length * random.normal(size=(8, 3))
    tensor = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, places, strict=True))
    return np.array([*tensor[np.triu_indices(3)], *(masses @ places), masses.sum()])


def six_by_six(link):
    """Thesis (3.20)."""
    x, y, z = link[6:9]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    tensor = link[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
    return np.block([[tensor, cross.T], [cross, link[9] * np.eye(3)]])


def pseudo_inertia(link):
    tensor, first = link[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3), link[6:9, None]
    return np.block([[np.trace(tensor) / 2 * np.eye(3) - tensor, first], [first.T, np.array([[link[9]]])]])


@dataclass(frozen=True, eq=False)
class Base:
    K: Any
    independent: Any
    dependent: Any


@dataclass(frozen=True, eq=False)
class Links:
    link_names: tuple[str, ...]
    parameters: Any


class WrittenModel:
    """A model of links of which K is written down; parameters called fv and fc must not be negative."""

    def __init__(self, names, K, links):
        self.parameter_names = tuple(names)
        alone = np.count_nonzero(K, axis=0) == 1
        independent = [next(j for j in np.flatnonzero(row) if row[j] == 1 and alone[j]) for row in K]
        dependent = [j for j in range(len(names)) if j not in independent]
        self._base = Base(K, np.array(independent, dtype=int), np.array(dependent, dtype=int))
        self.robot = Links(tuple(f"link{k + 1}" for k in range(links)), np.full(len(names), np.nan))

    def base_parameters(self):
        return self._base

    def conditions(self, consistency):
        matrix = {"inertia": six_by_six, "full": pseudo_inertia}[consistency]
        coefficients = np.array([matrix(unit) for unit in np.eye(10)])
        zero, found = np.zeros(coefficients.shape[1:]), []
        for k, name in enumerate(self.robot.link_names):
            indices = np.array([self.parameter_names.index(f"{symbol}{k + 1}") for symbol in SYMBOLS])
            found.append(AffineBlock(f"body of {name}", zero, indices, coefficients, link=name))
        for j, name in enumerate(self.parameter_names):
            if name[:-1] in ("fv", "fc"):
                place = np.array([j])
                found.append(AffineBlock(name, np.zeros((1, 1)), place, np.ones((1, 1, 1)), "term"))
        return tuple(found)


@pytest.fixture(scope="session")
def free_links():
    """The regression of thesis 6.3.2: a random regressor of ten parameters a link; model, truth, Information."""

    def make(links, seed=0, noise=0.5, rows=1000):
        random = np.random.default_rng(seed)
        names = [f"{symbol}{k + 1}" for k in range(links) for symbol in SYMBOLS]
        truth = np.concatenate([points(random) for _ in range(links)])
        W = random.normal(size=(rows, 10 * links))
        omega = W @ truth + noise * np.linalg.norm(truth) * random.normal(size=rows)
        with one_thread():
            triangle = np.linalg.qr(np.column_stack([W, omega]), mode="r")
        information = Information.from_factor(
            triangle[:-1, :-1], triangle[:-1, -1], float(triangle[-1, -1] ** 2), rows, names
        )
        return WrittenModel(names, np.eye(10 * links), links), truth, information

    return make


@pytest.fixture(scope="session")
def random_arm():
    """An arm with friction and offsets that moves at random; model, truth, Information of each joint's rows."""

    def make(links, seed=0, noise=0.0):
        random = np.random.default_rng(seed)
        rows = [(str(random.choice(["-pi/2", "pi/2", "0"])), *random.uniform(0.1, 0.5, 2), "q") for _ in range(links)]
        robot = Robot.from_dh([(a, float(x), float(y), q) for a, x, y, q in rows])
        model = Model(robot.with_terms(Viscous(), Coulomb(), Offset()))
        truth = np.concatenate([[*points(random), *random.uniform(0.1, 1.0, 2), random.normal()] for _ in range(links)])
        q, dq, ddq = random.normal(size=(3, 60 * links, links)) * np.array([1.5, 1.5, 4.0])[:, None, None]
        torque = model.inverse_dynamics(q, dq, ddq, truth)
        torque = torque + noise * torque.std(axis=0) * random.normal(size=torque.shape)
        return model, truth, Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=torque))

    return make


@pytest.fixture(scope="session")
def real_wam(shared_data: Path):
    """The model and the Information of the real WAM's reduced regression."""
    data = np.load(shared_data / "wam7" / "iros2013_reduced_regression.npz", allow_pickle=False)
    names = [f"{symbol}{k}" for k in range(1, 8) for symbol in (*SYMBOLS, "fv", "fc")]
    K = np.zeros((len(data["base_expressions"]), len(names)))
    for row, expression in zip(K, data["base_expressions"], strict=True):
        plain = re.sub(r"\b(L|l|m|fv|fc)_(\d)(\w*)", r"\1\3\2", str(expression)).replace(" ", "")
        for sign, number, name in re.findall(r"([+-]?)(?:([\d.]+)\*)?([A-Za-z]\w*)", plain):
            row[names.index(name)] += (-1.0 if sign == "-" else 1.0) * float(number or 1)
    information = Information.from_factor(
        data["R1"],
        data["rho1"],
        float(data["rho2_norm_sqr"]),
        int(data["n_rows"]),
        [str(e) for e in data["base_expressions"]],
    )
    return WrittenModel(names, K, 7), information
