"""Finds torque columns that were given to the wrong joints."""

from __future__ import annotations

import numpy as np

from steelyard.dynamics import Model
from steelyard.recording import Samples
from steelyard.regression import Estimate

__all__ = ["swapped_torques"]

_SUSPECT, _EXPLAINED = 0.5, 0.5


def swapped_torques(model: Model, samples: Samples, estimate: Estimate) -> tuple[str, ...]:
    """Name pairs of joints each of whose torques fits the other's dynamics far better than its own.

    Parameters
    ----------
    model : Model
    samples : Samples
        A few hundred are enough.
    estimate : Estimate
        Unconstrained, of the data as it was given.

    Returns
    -------
    tuple of str
        A sentence for each pair; empty where nothing is suspect.
    """
    errors = estimate.joint_relative_error
    if errors is None:
        return ()
    suspects = [int(k) for k in np.flatnonzero(errors > _SUSPECT)]
    if len(suspects) < 2:
        return ()
    columns = model.base_columns
    values = columns.kernel(samples.q, samples.dq, samples.ddq)
    blocks = np.split(values, np.cumsum([len(c) for c in columns.joints])[:-1], axis=1)
    own = {(i, j): _error(blocks[i], samples.torque[:, j]) for i in suspects for j in suspects}
    names = estimate.joint_names
    return tuple(
        f"The torque columns of {names[i]} and {names[j]} look swapped: each fits the other joint "
        f"({own[i, j]:.0%} and {own[j, i]:.0%} error instead of {own[i, i]:.0%} and {own[j, j]:.0%})."
        for i in suspects
        for j in suspects
        if i < j and own[i, j] < _EXPLAINED * own[j, j] and own[j, i] < _EXPLAINED * own[i, i]
    )


def _error(columns: np.ndarray, torque: np.ndarray) -> float:
    norm = float(np.linalg.norm(torque))
    solution = np.linalg.lstsq(columns, torque, rcond=1e-9)[0]
    return float(np.linalg.norm(columns @ solution - torque)) / norm if norm > 0.0 else 1.0
