"""The regression of thesis 6.3.2: links of which all ten parameters are identifiable, a random regressor, noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.threads import one_thread
from steelyard.regression import Information
from steelyard_thesis.tabulated_model import TabulatedModel

__all__ = ["ROWS", "free_links", "free_links_problem", "random_regression"]

ROWS = 10_000
"""1000 points of ten rows each."""

Array = NDArray[np.float64]


def free_links(links: int) -> TabulatedModel:
    """Return a model of links whose base parameters are all of their parameters.

    Examples
    --------
    >>> free_links(2)
    TabulatedModel(free links: 2 links, 20 base parameters)
    """
    names = [f"link{link}" for link in range(1, links + 1)]
    parameters = TabulatedModel(names, []).parameter_names
    return TabulatedModel(names, [{name: 1.0} for name in parameters], "free links")


def random_regression(links: int, seed: int = 0) -> tuple[Array, Array]:
    """Return W (10000, 10 N) and ω (10000,).

    The elements of W are standard normal. The true links consist of eight points each, and the noise is so strong that
    plain least squares are mostly infeasible, as the thesis has it.

    Examples
    --------
    >>> W, omega = random_regression(3)
    >>> W.shape, omega.shape
    ((10000, 30), (10000,))
    """
    random = np.random.default_rng(seed)
    truth: list[float] = []
    for _ in range(links):
        masses, points = random.uniform(0.1, 1.0, 8), 0.3 * random.normal(size=(8, 3))
        tensor = np.sum([m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True)], axis=0)
        truth += [*tensor[np.triu_indices(3)], *(masses @ points), masses.sum()]
    W = random.normal(size=(ROWS, 10 * links))
    noise = (2.0 + 0.5 * links) * np.linalg.norm(truth) / np.sqrt(links)
    return W, W @ np.array(truth) + noise * random.normal(size=ROWS)


def free_links_problem(links: int, seed: int = 0) -> tuple[Information, TabulatedModel]:
    """Return the reduced regression and its model.

    Examples
    --------
    >>> information, model = free_links_problem(1)
    >>> information.base_count, information.count
    (10, 10000)
    """
    W, omega = random_regression(links, seed)
    with one_thread():
        triangle = np.asarray(np.linalg.qr(np.column_stack([W, omega]), mode="r"))
    model = free_links(links)
    R, rho, residual2 = triangle[:-1, :-1], triangle[:-1, -1], float(triangle[-1, -1] ** 2)
    return Information.from_factor(R, rho, residual2, ROWS, model.parameter_names), model
