"""Models written down by hand or from published tables, which give what the feasibility room asks of a model."""

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.optimize

from steelyard.lmi import AffineBlock

INERTIAL = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


def tensor(link):
    return np.array([[link[0], link[1], link[2]], [link[1], link[3], link[4]], [link[2], link[4], link[5]]])


def six_by_six(link):
    """Thesis (3.20)."""
    x, y, z = link[6:9]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.block([[tensor(link), cross.T], [cross, link[9] * np.eye(3)]])


def pseudo_inertia(link):
    inertia = tensor(link)
    first = np.asarray(link[6:9])[:, None]
    return np.block([[np.trace(inertia) / 2 * np.eye(3) - inertia, first], [first.T, np.array([[link[9]]])]])


@dataclass(frozen=True, eq=False)
class StandInBase:
    K: Any
    independent: Any
    dependent: Any


@dataclass(frozen=True, eq=False)
class StandInRobot:
    link_names: Sequence[str]
    parameters: Any


class StandInModel:
    """A model given by its parameter names and base parameters as sums of (coefficient, name)."""

    def __init__(self, names, combinations, links, nonnegative=(), cad=None):
        self.parameter_names = tuple(names)
        K = np.zeros((len(combinations), len(names)))
        for row, combination in zip(K, combinations, strict=True):
            for coefficient, name in combination:
                row[self.parameter_names.index(name)] += coefficient
        alone = np.count_nonzero(K, axis=0) == 1
        independent = [next(j for j in np.flatnonzero(row) if row[j] == 1 and alone[j]) for row in K]
        dependent = [j for j in range(len(names)) if j not in independent]
        self._base = StandInBase(K, np.array(independent, dtype=int), np.array(dependent, dtype=int))
        self.robot = StandInRobot(tuple(links), np.full(len(names), np.nan) if cad is None else np.asarray(cad))
        self.nonnegative = tuple(nonnegative)

    def base_parameters(self):
        return self._base

    def conditions(self, consistency):
        matrix = {"inertia": six_by_six, "full": pseudo_inertia}[consistency]
        coefficients = np.array([matrix(unit) for unit in np.eye(10)])
        size = coefficients.shape[1]
        found = []
        for i, link in enumerate(self.robot.link_names):
            indices = np.array([self.parameter_names.index(f"{symbol}{i + 1}") for symbol in INERTIAL])
            name = f"link {i + 1} ({link}): inertia"
            found.append(AffineBlock(name, np.zeros((size, size)), indices, coefficients, link=link))
        for j, name in enumerate(self.parameter_names):
            if name[:-1] in self.nonnegative:
                label = f"joint {name[-1]}: {name[:-1]} >= 0"
                one = np.ones((1, 1, 1))
                found.append(AffineBlock(label, np.zeros((1, 1)), np.array([j]), one, "term"))
        return tuple(found)


@dataclass(frozen=True, eq=False)
class StandInReduced:
    R: Any
    rho: Any
    residual2: float
    count: int
    norm2: float


def read_combination(text):
    """[(coefficient, name), ...] of text such as "Lyy1 - 1.1*ly3"."""
    terms = re.findall(r"([+-]?)\s*(?:([\d.]+)\*)?([A-Za-z]\w*)", text.replace(" ", ""))
    return [((-1.0 if sign == "-" else 1.0) * float(number or 1), name) for sign, number, name in terms]


@pytest.fixture(scope="session")
def inertial_symbols() -> tuple[str, ...]:
    return INERTIAL


@pytest.fixture(scope="session")
def stand_in() -> Callable[..., StandInModel]:
    return StandInModel


@pytest.fixture(scope="session")
def reduced_regression() -> Callable[..., StandInReduced]:
    return StandInReduced


@pytest.fixture(scope="session")
def thesis_wam(thesis_tables: Path) -> StandInModel:
    """The WAM of thesis 4.1 with its 76 base parameters."""
    with (thesis_tables / "table_4_2_wam_base_parameters.csv").open() as file:
        combinations = [read_combination(row["combination"]) for row in csv.DictReader(file)]
    terms = ("Fvj", "Fcj", "Foj", "Fvm", "Fcm", "Fom", "Iam")
    names = [f"{symbol}{link}" for link in range(1, 8) for symbol in (*INERTIAL, *terms)]
    nonnegative = ("Fvj", "Fcj", "Fvm", "Fcm", "Iam")
    return StandInModel(names, combinations, [f"link{i}" for i in range(1, 8)], nonnegative)


@pytest.fixture(scope="session")
def table_4_9(thesis_tables: Path) -> dict[str, np.ndarray]:
    """Columns of the table of feasible estimates."""
    with (thesis_tables / "table_4_9_feasible_estimates.csv").open() as file:
        rows = list(csv.DictReader(file))
    columns = ("WLS", "WLS_corrected", "WLS_feasible", "WLS_feasible_extra")
    return {column: np.array([float(row[column]) for row in rows]) for column in columns}


@pytest.fixture(scope="session")
def real_wam(shared_data: Path) -> tuple[StandInModel, StandInReduced]:
    """The real WAM's reduced regression and the model that it is of."""
    data = np.load(shared_data / "wam7" / "iros2013_reduced_regression.npz", allow_pickle=False)
    combinations = []
    for text in data["base_expressions"]:
        names = re.sub(r"\bL_(\d)(\w\w)", r"L\2\1", str(text))
        names = re.sub(r"\bl_(\d)(\w)", r"l\2\1", names)
        combinations.append(read_combination(re.sub(r"\b(m|fv|fc)_(\d)", r"\1\2", names)))
    names = [f"{symbol}{link}" for link in range(1, 8) for symbol in (*INERTIAL, "fv", "fc")]
    model = StandInModel(names, combinations, [f"link{i}" for i in range(1, 8)], ("fv", "fc"))
    norm2, residual2 = float(data["omega_norm_sqr"]), float(data["rho2_norm_sqr"])
    return model, StandInReduced(data["R1"], data["rho1"], residual2, int(data["n_rows"]), norm2)


@pytest.fixture(scope="session")
def two_links(stand_in) -> StandInModel:
    """A planar arm of two links, 1 m each, about parallel vertical axes: Lzz1 + m2, Lzz2, lx2, ly2 and friction."""
    names = [f"{symbol}{link}" for link in (1, 2) for symbol in (*INERTIAL, "Fvj")]
    combinations = [
        [(1.0, "Lzz1"), (1.0, "m2")],
        [(1.0, "Fvj1")],
        [(1.0, "Lzz2")],
        [(1.0, "lx2")],
        [(1.0, "ly2")],
        [(1.0, "Fvj2")],
    ]
    return stand_in(names, combinations, ("upper arm", "forearm"), ("Fvj",))


@pytest.fixture(scope="session")
def point_cloud_parameters() -> Callable[..., np.ndarray]:
    """Inertial parameters of point masses, by the definition of moments."""

    def parameters(masses: np.ndarray, points: np.ndarray) -> np.ndarray:
        inertia = sum(
            mass * (point @ point * np.eye(3) - np.outer(point, point))
            for mass, point in zip(masses, points, strict=True)
        )
        upper = inertia[np.triu_indices(3)]
        return np.concatenate([upper, masses @ points, [masses.sum()]])

    return parameters


def _factored(unknowns, margin):
    """Feasible parameters of two links from free factors: pseudo-inertia F Fᵀ + margin, friction s² + margin."""
    delta = np.zeros(22)
    for link in range(2):
        factor = unknowns[17 * link : 17 * link + 16].reshape(4, 4)
        pseudo = factor @ factor.T + margin * np.eye(4)
        inertia = np.trace(pseudo[:3, :3]) * np.eye(3) - pseudo[:3, :3]
        place = 11 * link
        delta[place : place + 6] = inertia[np.triu_indices(3)]
        delta[place + 6 : place + 9] = pseudo[:3, 3]
        delta[place + 9] = pseudo[3, 3]
        delta[place + 10] = unknowns[17 * link + 16] ** 2 + margin
    return delta


@cache
def _second_derivatives():
    """(22, 34, 34) of `_factored`, which is a quadratic function of the factors: differences are exact."""
    unit = np.eye(34)
    pairs = [[_factored(a + b, 0.0) - _factored(a - b, 0.0) for b in unit] for a in unit]
    return 0.5 * np.array(pairs).transpose(2, 0, 1)


def _least_by_descent(feasible, residual):
    """The least of ‖residual(δ)‖² over the factored set, from several starts: no cones, no duality.

    The residual is an affine function of δ.
    """
    rng = np.random.default_rng(9)
    at_zero = residual(np.zeros(22))
    slope = np.column_stack([residual(unit) - at_zero for unit in np.eye(22)])
    runs = [
        scipy.optimize.least_squares(
            lambda unknowns: residual(_factored(unknowns, feasible.margin)),
            rng.normal(size=34),
            jac=lambda unknowns: slope @ (_second_derivatives() @ unknowns),
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-12,
        )
        for _ in range(4)
    ]
    best = min(runs, key=lambda run: run.cost)
    return _factored(best.x, feasible.margin), 2 * best.cost


@pytest.fixture(scope="session")
def factored() -> Callable[..., np.ndarray]:
    return _factored


@pytest.fixture(scope="session")
def least_by_descent() -> Callable[..., tuple[np.ndarray, float]]:
    return _least_by_descent
