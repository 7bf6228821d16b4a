"""Random fits, well and badly conditioned, and their least residual by a formulation of its own in CVXPY."""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.dynamics import Coulomb, Model, MotorSide, Offset, RotorInertia, Viscous
from steelyard.feasibility import FeasibleSet, TotalMass
from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.robot import Robot

ANGLES = ("0", "pi/2", "-pi/2")


@dataclass(frozen=True, eq=False)
class RandomFit:
    """A robot, its true parameters, what a noisy motion shows of it, and what is asked."""

    seed: int
    model: Model
    truth: np.ndarray
    info: Information
    feasible: FeasibleSet
    weights: object
    options: dict
    words: str

    @property
    def reduced(self):
        return self.info.reduced(None if self.weights is None else self.info.joint_weights(self.weights))


def random_fit(seed: int) -> RandomFit:
    """1 to 8 joints, condition numbers from 1e1 to 1e10, still joints, mass bounds, coupled rotors, mimic joints."""
    random = np.random.default_rng([seed, 20])
    links = int(random.integers(1, 9))
    robot, said = _robot(random, links)
    model = Model(robot)
    truth = _parameters(random, model)
    if random.random() < 0.5:
        info, how = _from_motion(random, model, truth)
        weights = "joint" if random.random() < 0.7 else None
    else:
        info, how = _from_spectrum(random, model, truth)
        weights = None
    consistency = "full" if random.random() < 0.7 else "inertia"
    constraints = []
    total = float(truth[FeasibleSet(model).mass_indices].sum())
    if random.random() < 0.6:
        factor = float(10 ** random.uniform(0.0, 0.7))
        constraints.append(TotalMass(maximum=1.0001 * factor * total))
        said += f", total mass below {factor:.2f} of the true one"
    feasible = FeasibleSet(model, consistency, constraints)
    options = {"residual_slack": 0.0} if random.random() < 0.5 else {}
    return RandomFit(seed, model, truth, info, feasible, weights, options, f"{said}; {how}; {consistency}")


def _robot(random, links):
    rows = []
    for _ in range(links):
        alpha = str(random.choice(ANGLES)) if random.random() < 0.8 else float(random.uniform(-1.5, 1.5))
        a, d = random.uniform(0.0, 0.6, 2) * (random.random(2) < 0.7)
        if random.random() < 0.15:
            rows.append((alpha, float(a), "q", 0.3))
        else:
            rows.append((alpha, float(a), float(d), "q"))
    robot = Robot.from_dh(rows)
    said = f"{links} links"
    if links > 2 and random.random() < 0.25:
        robot = _with_mimic(random, robot)
        said += ", a mimic joint"
    terms = [term for term in (Viscous(), Coulomb()) if random.random() < 0.8]
    if random.random() < 0.3:
        terms.append(Offset())
    if random.random() < 0.4:
        terms.append(RotorInertia())
    if random.random() < 0.4:
        count = robot.dof
        coupling = np.diag(random.uniform(0.5, 2.0, count))
        for _ in range(count // 2):
            i, j = random.integers(0, count, 2)
            if i < j:
                coupling[i, j] = random.uniform(-1.0, 1.0)
        terms.append(MotorSide(coupling=coupling))
        said += ", coupled rotors"
    return robot.with_terms(*terms), said


def _with_mimic(random, robot):
    """One joint follows another one that comes before it."""
    index = int(random.integers(1, len(robot.joints)))
    driver = robot.joints[int(random.integers(0, index))]
    joints = []
    for k, joint in enumerate(robot.joints):
        coordinate = joint.coordinate - (k > index)
        if k == index:
            factor = float(random.uniform(-2.0, 2.0))
            joint = replace(joint, mimics=driver.name, multiplier=factor, offset=0.1)
            coordinate = driver.coordinate
        joints.append(replace(joint, coordinate=coordinate))
    return replace(robot, joints=tuple(joints))


def _parameters(random, model):
    """Bodies of eight points; friction and rotors."""
    truth = np.zeros(model.parameter_count)
    sizes = 10 ** random.uniform(-1.0, 1.0)
    for names, body in zip(model.link_columns, range(len(model.link_columns)), strict=True):
        weights = random.uniform(0.1, 1.0, 8) * sizes * 0.7**body
        points = 0.1 * (random.normal(size=(8, 3)) + random.normal(size=3))
        moment = (weights[:, None, None] * points[:, :, None] * points[:, None, :]).sum(axis=0)
        inertia = np.trace(moment) * np.eye(3) - moment
        truth[names] = [*inertia[np.triu_indices(3)], *(weights @ points), weights.sum()]
    others = np.setdiff1d(np.arange(len(truth)), np.concatenate([np.asarray(c) for c in model.link_columns]))
    truth[others] = random.uniform(0.02, 1.0, len(others)) * sizes
    return truth


def _from_motion(random, model, truth):
    joints = model.dof
    count = 60 * joints
    amplitude = 10 ** (-random.uniform(0.0, 5.0, joints) * (random.random(joints) < 0.4))
    still = (random.random(joints) < 0.15) & (np.arange(joints) < joints - 1)
    amplitude[still] = 0.0
    q, dq, ddq = random.normal(size=(3, count, joints)) * np.array([1.0, 1.0, 3.0])[:, None, None] * amplitude
    q = q + random.uniform(-1.5, 1.5, joints)
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    noise = float(10 ** random.uniform(-4.0, -0.3))
    torque = torque + noise * random.normal(size=torque.shape) * np.maximum(torque.std(axis=0), 1e-3)
    info = Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    weak = int((amplitude < 0.1).sum() - still.sum())
    return info, f"motion: {still.sum()} joints still, {weak} hardly move, noise {noise:.1e}"


def _from_spectrum(random, model, truth):
    """The regressor of a motion, its singular values replaced by those of a condition number."""
    joints, count = model.dof, 60 * model.dof
    q, dq, ddq = random.normal(size=(3, count, joints)) * np.array([1.0, 1.0, 3.0])[:, None, None]
    W = model.regressor(q, dq, ddq).reshape(count * joints, -1)[:, np.asarray(model.base_parameters().independent)]
    lengths = np.linalg.norm(W, axis=0)
    _, _, right = np.linalg.svd(W / lengths, full_matrices=False)
    exponent = random.uniform(1.0, 10.0)
    n = len(lengths)
    values = np.sort(10 ** (-exponent * np.append(random.random(max(n - 2, 0)), [0.0, 1.0][: min(n, 2)])))[::-1]
    R = (values[:, None] * right) * np.sqrt(count) * lengths / np.linalg.norm(lengths) * np.sqrt(n)
    base = model.base_parameters().K @ truth
    noise = float(10 ** random.uniform(-4.0, -0.3))
    deviation = noise * float(np.linalg.norm(R @ base)) / np.sqrt(count * joints)
    rho = R @ base + deviation * random.normal(size=n)
    names = model.base_parameters().names
    info = Information.from_factor(R, rho, deviation**2 * max(count * joints - n, 1), count * joints, names)
    return info, f"condition number 1e{exponent:.1f}, noise {noise:.1e}"


def least_by_cvxpy(problem: RandomFit, solver="CLARABEL", **settings):
    """Parameters of least residual, from CVXPY: a density for every link, or a mass and an inertia about its centre.

    The links' matrices are variables of their own (nothing of this project's blocks), and the length of the residual
    is minimised, not its square. What the solver leaves outside is pulled towards the true parameters until every
    block is positive definite.

    Returns
    -------
    (n,) or None
    """
    import cvxpy as cp

    model, feasible = problem.model, problem.feasible
    reduced = problem.reduced
    units = np.ones(model.parameter_count)
    mass = max(float(problem.truth[feasible.mass_indices].max()), 1e-9)
    for columns in model.link_columns:
        units[columns] = mass * np.array([0.04] * 6 + [0.2] * 3 + [1.0])
    limits, pieces = [], {}
    for columns in model.link_columns:
        if feasible.consistency == "full":
            P = cp.Variable((4, 4), PSD=True)
            trace = P[0, 0] + P[1, 1] + P[2, 2]
            entries = [trace - P[0, 0], -P[0, 1], -P[0, 2], trace - P[1, 1], -P[1, 2], trace - P[2, 2]]
            entries += [P[0, 3], P[1, 3], P[2, 3], P[3, 3]]
        else:
            M = cp.Variable((6, 6), PSD=True)
            entries = [M[0, 0], M[0, 1], M[0, 2], M[1, 1], M[1, 2], M[2, 2], M[2, 4], M[0, 5], M[1, 3], M[3, 3]]
            limits += [M[4, 4] == M[3, 3], M[5, 5] == M[3, 3], M[3, 4] == 0, M[3, 5] == 0, M[4, 5] == 0]
            limits += [M[0, 3] == 0, M[1, 4] == 0, M[2, 5] == 0]
            limits += [M[1, 5] == -M[2, 4], M[2, 3] == -M[0, 5], M[0, 4] == -M[1, 3]]
        pieces.update(zip(np.asarray(columns).tolist(), entries, strict=True))
    rest = [k for k in range(model.parameter_count) if k not in pieces]
    other = cp.Variable(len(rest))
    signed = {int(c.indices[0]) for c in model.conditions("full") if c.size == 1}
    limits += [other[i] >= 0 for i, k in enumerate(rest) if k in signed]
    pieces.update({k: other[i] for i, k in enumerate(rest)})
    scaled = cp.hstack([pieces[k] for k in range(model.parameter_count)])
    masses = feasible.mass_indices
    for constraint in feasible.constraints:
        limits.append(cp.sum(scaled[masses]) <= constraint.maximum / mass)
    size = np.sqrt(reduced.norm2)
    W = np.asarray(reduced.R) @ (feasible.K * units) / size
    task = cp.Problem(cp.Minimize(cp.norm(W @ scaled - np.asarray(reduced.rho) / size)), limits)
    try:
        task.solve(solver=solver, **settings)
    except cp.error.SolverError:
        return None
    if scaled.value is None or not np.all(np.isfinite(scaled.value)):
        return None
    found = scaled.value * units
    for part in (0.0, *np.geomspace(1e-12, 1.0, 49)):
        point = found + part * (problem.truth - found)
        if feasible.contains(point):
            return point
    return None


def squared_residual(problem: RandomFit, parameters) -> float:
    """‖R K δ - ρ‖² + what no parameters change."""
    reduced = problem.reduced
    error = np.asarray(reduced.R) @ (problem.feasible.K @ parameters) - np.asarray(reduced.rho)
    return float(error @ error) + float(reduced.residual2)
