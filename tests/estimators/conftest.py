"""Arms with bodies made of points, and what random motion shows of them."""

import numpy as np
import pytest

from steelyard.dynamics import Coulomb, Model, Viscous
from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.robot import Robot


@pytest.fixture(scope="session")
def random_arm(point_cloud_parameters):
    """A model, its true parameters, and the Information of a noisy motion."""

    def make(seed, links, masses, lengths, noise, rows=None):
        random = np.random.default_rng(seed)
        lengths = np.exp(random.uniform(*np.log(lengths), links))
        masses = np.exp(random.uniform(*np.log(masses), links))
        table = [
            (str(random.choice(["-pi/2", "pi/2", "0"])), random.uniform() * length, random.uniform() * length, "q")
            for length in lengths
        ]
        model = Model(
            Robot.from_dh([(a, float(x), float(y), q) for a, x, y, q in table]).with_terms(Viscous(), Coulomb())
        )
        truth = []
        for mass, length in zip(masses, lengths, strict=True):
            weights = random.uniform(0.1, 1.0, 8)
            points = 0.3 * length * (random.normal(size=(8, 3)) + random.normal(size=3))
            truth += [*point_cloud_parameters(weights * mass / weights.sum(), points)]
            truth += [*(mass * length**2 * random.uniform(0.1, 2.0, 2))]
        truth = np.array(truth)
        count = rows or 30 * links
        q, dq, ddq = random.normal(size=(3, count, links)) * np.array([1.5, 1.5, 4.0])[:, None, None]
        torque = model.inverse_dynamics(q, dq, ddq, truth)
        torque = torque + noise * random.normal(size=torque.shape) * torque.std(axis=0)
        return model, truth, Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=torque))

    return make


@pytest.fixture(scope="session")
def all_identifiable(stand_in, reduced_regression, inertial_symbols, point_cloud_parameters):
    """The regression of thesis 6.3.2: a random regressor of 10 parameters a link, of which all are base parameters."""

    def make(links, seed=0, rows=1000, noise=0.5):
        random = np.random.default_rng(seed)
        names = [f"{symbol}{link + 1}" for link in range(links) for symbol in inertial_symbols]
        model = stand_in(names, [[(1.0, name)] for name in names], [f"link{i}" for i in range(links)])
        truth = np.concatenate(
            [point_cloud_parameters(random.uniform(0.1, 1, 8), 0.3 * random.normal(size=(8, 3))) for _ in range(links)]
        )
        W = random.normal(size=(rows, 10 * links))
        omega = W @ truth + noise * np.linalg.norm(truth) * random.normal(size=rows)
        triangle = np.linalg.qr(np.column_stack([W, omega]), mode="r")
        R, rho, residual2 = triangle[:-1, :-1], triangle[:-1, -1], float(triangle[-1, -1] ** 2)
        return model, reduced_regression(R, rho, residual2, rows, float(omega @ omega)), (W, omega)

    return make
