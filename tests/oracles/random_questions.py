"""Random questions to `check` on robots of every kind, and the same questions put to CVXPY without this project's K."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from random_instances import random_parameters

import steelyard as sy

KINDS = ("couplings", "mimic", "nearly parallel", "tree", "constraints", "plain")
_SYMBOLS = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")
_SIGNED = ("Fo",)


@dataclass(frozen=True)
class Question:
    """Are these base parameters possible?"""

    seed: int
    kind: str
    feasible: sy.FeasibleSet
    base: np.ndarray

    @property
    def scale(self) -> float:
        return max(1.0, float(np.abs(self.base).max()))


def mimicking(robot: sy.Robot, joint: int, driver: int, multiplier: float) -> sy.Robot:
    """The robot with one joint driven by a joint before it."""
    joints = []
    for k, old in enumerate(robot.joints):
        if k == joint:
            name = robot.joints[driver].name
            joints.append(replace(old, coordinate=driver, multiplier=multiplier, offset=0.2, mimics=name))
        else:
            joints.append(replace(old, coordinate=k - (k > joint)))
    return replace(robot, joints=tuple(joints))


def _robot(rng: np.random.Generator, kind: str) -> sy.Robot:
    links = int(rng.integers(2, 6))
    rows: list[tuple[Any, ...]] = []
    for _ in range(links):
        angle: Any = rng.choice(["pi/2", "-pi/2", "0", "other"])
        if angle == "other":
            angle = float(np.round(rng.uniform(-3, 3), 2))
        if kind == "nearly parallel" and rng.random() < 0.7:
            angle = float(np.round(10.0 ** rng.uniform(-5.3, -2.0), 7))
        a, d = (float(np.round(x, 2)) for x in rng.uniform(-0.5, 0.5, 2))
        rows.append(
            (str(angle) if isinstance(angle, str) else angle, a, *(("q", d) if rng.random() < 0.25 else (d, "q")))
        )
    robot = sy.Robot.from_dh(rows, name=kind, gravity=((0, 0, -9.81), (0, -9.81, 0), (0, 0, 0))[int(rng.integers(3))])
    if kind == "tree":
        parents = [-1, *(int(rng.integers(-1, k)) for k in range(1, links))]
        joints = tuple(replace(joint, parent=parent) for joint, parent in zip(robot.joints, parents, strict=True))
        robot = replace(robot, joints=joints)
    if kind == "mimic":
        joint = int(rng.integers(1, links))
        robot = mimicking(robot, joint, int(rng.integers(0, joint)), float(rng.choice([1.0, -1.0, 0.5, 2.0, 0.7])))
    terms: list[sy.Term] = []
    if kind == "couplings":
        ratios = np.round(rng.choice([0.0, 0.5, 1.0, -1.0, 0.3], (links, links)), 2)
        terms = [sy.RotorInertia(), sy.MotorSide(np.eye(links) + np.triu(ratios, 1))]
    elif rng.random() < 0.5:
        terms = [sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia()]
    return robot.with_terms(*terms)


def _constraints(rng: np.random.Generator, robot: sy.Robot) -> list[Any]:
    link = str(rng.choice(robot.link_names))
    other = str(rng.choice(robot.link_names))
    size = float(np.round(rng.uniform(0.2, 2.0), 2))
    found: list[Any] = [sy.TotalMass(maximum=float(np.round(rng.uniform(0.5, 20.0), 1)))]
    if rng.random() < 0.6:
        found.append(sy.CenterOfMassBox(link, (-size,) * 3, (size,) * 3))
    if rng.random() < 0.4:
        found.append(sy.feasibility.SymmetricLink(other, plane="xz"))
    return found


def random_question(seed: int) -> Question:
    """Half from parameters of real bodies, moved a little or not; half from noise; scales from grams to tons."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    consistency: Literal["full", "inertia"] = "full" if rng.random() < 0.5 else "inertia"
    robot = _robot(rng, kind)
    model = sy.Model(robot)
    feasible = sy.FeasibleSet(model, consistency, _constraints(rng, robot) if kind == "constraints" else ())
    base = feasible.K @ random_parameters(rng, model, int(rng.choice([0, 2])), 1.0)
    noise = rng.normal(size=len(base))
    how = seed // len(KINDS) % 4
    if how == 0:
        base = -np.ones(len(base)) if rng.random() < 0.3 else noise * np.abs(base).max()
    elif how == 1:
        base = base + 10.0 ** rng.uniform(-4, 0) * np.abs(base) * noise
    elif how == 2:
        base = base + 10.0 ** rng.uniform(-4, -1) * np.abs(base).max() * noise
    return Question(seed, kind, feasible, base)


def margin_by_cvxpy(question: Question, solver: str = "CLARABEL", **options: Any) -> tuple[float, str]:
    """Largest t such that every matrix of a link or a constraint, less t, is semidefinite and no friction is below t.

    β enters through the torques that it causes at random motions, not through K, and the matrices are written out here.
    """
    import cvxpy as cp

    feasible, model = question.feasible, question.feasible.model
    rng = np.random.default_rng(question.seed)
    q, dq, ddq = rng.normal(size=(3, 60 + 3 * model.parameter_count, model.robot.dof))
    rows = model.regressor(q, dq, ddq).reshape(-1, model.parameter_count)
    triangle = np.linalg.qr(rows, mode="r")
    torques = triangle[:, model.base_parameters().independent] @ question.base
    left, sizes, right = np.linalg.svd(triangle)
    rank = int(np.sum(sizes > 1e-13 * sizes[0]))
    x, t = cp.Variable(model.parameter_count), cp.Variable()
    names = {name: k for k, name in enumerate(model.parameter_names)}
    conditions = [right[:rank] @ x == (left[:, :rank].T @ torques) / sizes[:rank], t <= 1]
    masses = []
    for link, name in enumerate(model.robot.link_names, start=1):
        xx, xy, xz, yy, yz, zz, lx, ly, lz, m = (x[names[f"{symbol}{link}"]] for symbol in _SYMBOLS)
        masses.append(m)
        L = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        if feasible.consistency == "full":
            half = (xx + yy + zz) / 2
            upper = [[(half if i == j else 0) - L[i][j] for j in range(3)] for i in range(3)]
            matrix = cp.bmat([[*upper[i], (lx, ly, lz)[i]] for i in range(3)] + [[lx, ly, lz, m]])
        else:
            S = [[0, -lz, ly], [lz, 0, -lx], [-ly, lx, 0]]
            zero = 0 * m
            low = [[*(v + zero for v in S[i]), *(m if i == j else zero for j in range(3))] for i in range(3)]
            # [[L, S(l)'], [S(l), m 1]] with l x = S(l) x
            matrix = cp.bmat([[*L[i], *(-(S[i][j] + zero) for j in range(3))] for i in range(3)] + low)
        conditions.append(matrix - t * np.eye(matrix.shape[0]) >> 0)
        for constraint in feasible.constraints:
            if isinstance(constraint, sy.CenterOfMassBox) and constraint.link == name:
                size = float(np.asarray(constraint.upper)[0])
                conditions += [size * m - value >= t for value in (lx, ly, lz, -lx, -ly, -lz)]
            if isinstance(constraint, sy.feasibility.SymmetricLink) and constraint.link == name:
                conditions += [xy == 0, yz == 0, ly == 0]
    for constraint in feasible.constraints:
        if isinstance(constraint, sy.TotalMass):
            conditions.append(constraint.maximum - sum(masses) >= t)
    for name, k in names.items():
        if not name.startswith((*_SYMBOLS, *_SIGNED)):
            conditions.append(x[k] >= t)
    problem = cp.Problem(cp.Maximize(t), conditions)
    try:
        problem.solve(solver=solver, **options)
    except cp.error.SolverError:
        return np.nan, "failed"
    return (np.nan if t.value is None else float(t.value)), str(problem.status)
