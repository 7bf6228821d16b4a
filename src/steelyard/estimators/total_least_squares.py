"""Total least squares: noise in the regressor as in the torque, of a size that is known relative to the columns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.regression import Estimate, Factor, Information, triangular
from steelyard.regression.factor import combined, eigenvectors

from .fit import fit

__all__ = ["total_least_squares"]

ROUNDING = 1e-12
"""Part of the largest eigenvalue below which those of the corrected Gram matrix count as zero."""


@in_one_thread
def total_least_squares(
    info: Information,
    feasible_set: FeasibleSet,
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    noise: npt.ArrayLike | None = None,
    **options: Any,
) -> Estimate:
    """Estimate feasible parameters by total least squares, which take noise in the regressor into account.

    The least change of regressor and torque together, after which they agree: with the singular value decomposition of
    ``[W ω]`` in columns over their noise, whose least singular value is σ, ``β = (W'W - σ² D²)⁻¹ W' ω`` for the noise D
    of the columns. This is right where the noise of all columns is independent from row to row and its relative size is
    known. For robots neither holds: columns of positions have next to no noise, those of accelerations have all of it,
    and the same noise in several. It stands here for comparison; use `instrumental_variables` instead.

    Parameters
    ----------
    info : Information
        Data of the same model as `feasible_set`.
    feasible_set : FeasibleSet
    weights : "joint", None or (N,)
        As in `fit`.
    noise : (n_b + 1,), optional
        Standard deviation of the noise of each column of the weighted base regressor and of the weighted torque, up to
        a common factor; zero for columns without. By default each column has the same noise relative to its length.
    **options
        Those of `fit`: `prefer`, `residual_slack`, `prior`, `prior_weight`, `solver`.

    Raises
    ------
    InputError
        If the noise is of another length or negative, or the torque has none.

    References
    ----------
    S. Van Huffel, J. Vandewalle, The total least squares problem, SIAM, 1991.
    M. Gautier, P. Vandanjon, C. Presse, Identification of inertial and drive gain parameters of robots, Proc. IEEE
    Conference on Decision and Control, 1994.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)))
    >>> random = np.random.default_rng(1)
    >>> ddq = random.normal(size=(4000, 1))
    >>> torque = 2.0 * ddq + 0.5 * random.normal(size=ddq.shape)
    >>> noisy = sy.Samples(q=ddq, dq=ddq, ddq=ddq + 0.5 * random.normal(size=ddq.shape), torque=torque)
    >>> info = sy.Information.from_samples(model, noisy)
    >>> plain = sy.fit(info, sy.FeasibleSet(model), None)
    >>> total = total_least_squares(info, sy.FeasibleSet(model), None, noise=[0.5, 0.5])
    >>> plain.base.round(1).tolist(), total.base.round(1).tolist()
    ([1.6], [2.0])
    """
    used = info.joint_weights(weights)
    count = info.base_count
    triangle = combined(info.factors, used, count)
    sizes = np.sqrt(np.sum(triangle**2, axis=0)) if noise is None else np.asarray(noise, dtype=np.float64)
    if sizes.shape != (count + 1,) or not np.all(np.isfinite(sizes)) or np.any(sizes < 0.0) or sizes[-1] == 0.0:
        raise InputError(
            f"noise must be {count + 1} numbers of at least 0, one for each base parameter and a positive one for the "
            f"torque, got {noise if noise is not None else 'a log without torques'}."
        )
    noisy = np.flatnonzero(sizes > 0.0)
    exact = np.flatnonzero(sizes == 0.0)
    # Columns without noise are taken out first: what is left is orthogonal to them (Golub, Hoffman and Stewart 1987).
    ordered = triangular(triangle[:, [*exact, *noisy]])[len(exact) :, len(exact) :]
    least = float(np.linalg.svd(ordered / sizes[noisy], compute_uv=False)[-1])
    measured = triangle[:, :count].T @ triangle[:, :count]
    gram = measured - least**2 * np.diag(sizes[:count] ** 2)
    lengths = np.sqrt(np.maximum(np.diag(measured), 0.0))
    scale = np.where(lengths > 0.0, lengths, 1.0)
    values, vectors = eigenvectors(gram / np.outer(scale, scale))
    kept = values > ROUNDING * values.max(initial=0.0)
    root = np.sqrt(values[kept])[:, None] * vectors[:, kept].T * scale
    target = triangle[:, :count].T @ triangle[:, count]
    aim = (vectors[:, kept].T @ (target / scale)) / np.sqrt(values[kept])
    base = (vectors[:, kept] / np.sqrt(values[kept])) @ aim / scale
    # What is left over is that of the measured rows, from which the variance of the errors follows.
    left = triangle[:, :count] @ base - triangle[:, count]
    rows = np.zeros((len(root) + 1, count + 1))
    rows[:-1, :count], rows[:-1, count], rows[-1, count] = root, aim, np.linalg.norm(left)
    whole = np.arange(count)

    def together(factors: tuple[Factor, ...]) -> Factor:
        return Factor(None, whole, combined(factors, used, count), sum(factor.count for factor in factors))

    corrected = replace(
        Information.of(info),
        factors=(Factor(None, whole, triangular(rows), info.count),),
        torque_factors=info.measured,
        covariance=None,
        batch_means=tuple((together(level),) for level in info.batch_means),
    )
    estimate = fit(corrected, feasible_set, None, **options)
    told = None if not info.is_weighted(weights) else used
    return replace(estimate, method="feasible total least squares", weights=told, unconstrained_base=base)
