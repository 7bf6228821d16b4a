"""Choosing the cutoff by the torques: the one with which the model explains them best."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.threads import in_threads, one_thread
from steelyard.errors import InputError

from ..filters.zero_phase import motion_frequency
from ..measurements import Measurements
from ..samples import Samples
from .by_spectra import noise_share
from .evidence import Curve, CutoffChoice, Plot

if TYPE_CHECKING:
    from steelyard.dynamics import Model

__all__ = ["TorqueFit", "cutoff_by_torques"]

Array = NDArray[np.float64]
Process = Callable[[float, float], Sequence[Samples]]
ENDS = 2.2
"""Periods of the lowest candidate whose rows at either end are spoilt by it, and left out for all."""
RATIO = 1.4
"""From one candidate to the next; between them the residual is interpolated."""
HIGHEST = 0.2
"""The highest cutoff that is tried, as a share of the sample rate: beyond it, central differences take more than an
eighth off the accelerations."""
TOLERANCE = 0.01
"""The highest cutoff is taken whose residual is at most this part above the least. What a filter takes off the motion
is in step with it and biases every parameter; noise in the accelerations is not, averages out over the rows, and biases
by its square only. On a simulated UR5 (`benchmarks/defaults.py`, least squares) the lowest cutoff within the tolerance,
1.5 Hz, has an error of 0.19 %, the highest, 6 Hz, one of 0.15 %."""
NOISE = 0.01
"""Part of the accelerations' power, in the median of the joints, that may be noise of the positions. A controller
answers that noise with torques, so that the residual alone asks for more and more of it: on a slow motion (0.25 Hz)
with encoders of 17 bits at 250 Hz it chose 46 Hz, where 30 % of the power was noise, and rotor inertias came out at
half their size. The cutoffs that the residual chooses on real recordings have at most 1e-3."""
NEEDED = 2.0
"""Times the frequency of the motion below which cutoffs are tried whatever their noise."""
RULE = 10.0
"""Times the frequency of the motion from which the noise of each single joint counts like that of the median, unless
the joint shows more noise than motion there, as one that is held does. One joint with a coarse encoder spoils what the
others tell: on a simulated arm of seven joints whose prismatic one had steps of 48 µm, 17 % of its accelerations' power
was noise at the 43 Hz that the median allowed, and base parameters were wrong by up to sixteen standard errors."""
FAST = 0.3
"""Fraction of a joint's own root mean square velocity below which rows do not count. Near a reversal the residual shows
how friction turns its sign, and how the filter rounds that; with 0.1 it has several minima on arms that stick."""
REFERENCE = 4.0
"""The velocities that decide which rows are slow are filtered at this many times the frequency of the motion."""
ENOUGH, CLEARLY = 0.25, 0.5
"""Rise of the logarithm of the residual above its least, of two candidates, from which higher ones are not tried."""
BLOCK = 2048
"""Rows whose regressor is computed and used at a time: it stays in the processor's cache."""
MOST_ROWS = 4000
"""The most rows of all logs together from which the residual of a candidate is computed."""
ROUNDING = 1e-11
"""Eigenvalues of the products below this part of the largest, and squared residuals below this part of the squared
torques, are rounding of the sums of products."""


class TorqueFit:
    """A regression of torques on base parameters, as sums of products of fixed size to which rows are added."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.columns = model.base_columns
        size = model.base_parameters().count + 1
        self.products = np.zeros((len(self.columns.joints), size, size))
        self.counts = np.zeros(len(self.columns.joints))

    def _parts(self, samples: Samples, rows: NDArray[np.intp]) -> Iterator[tuple[slice, list[Array]]]:
        """For some rows at a time, the columns of the base regressor (S, c) on which each joint's torque depends."""
        for start in range(0, len(rows), BLOCK):
            part = slice(start, start + BLOCK)
            own = rows[part]
            q, dq, ddq = (np.ascontiguousarray(values[own]) for values in (samples.q, samples.dq, samples.ddq))
            logged = samples.channels_for(self.model, own)
            yield part, self.columns.by_joint(self.columns.of_motion(q, dq, ddq, logged))

    def add(self, samples: Samples, rows: NDArray[np.intp], used: NDArray[np.bool_]) -> None:
        """Add rows, of each joint those that are `used` (S, N)."""
        for part, columns in self._parts(samples, rows):
            self._add(columns, samples.torque[rows[part]], used[part])

    def _add(self, columns: list[Array], torques: Array, used: NDArray[np.bool_]) -> None:
        def add(k: int) -> None:
            # `compress` takes half the time of an index.
            kept, torque = np.compress(used[:, k], columns[k], axis=0), torques[used[:, k], k]
            joints, products = self.columns.joints[k], self.products[k]
            products[np.ix_(joints, joints)] += kept.T @ kept
            along = torque @ kept
            products[joints, -1] += along
            products[-1, joints] += along
            products[-1, -1] += torque @ torque
            self.counts[k] += len(torque)

        in_threads(add, range(len(columns)))

    def predicted(self, samples: Samples, rows: NDArray[np.intp], base: Array) -> Array:
        """Return the torques (S, N) of base parameters that `fitted` found, in some rows.

        A torque is NaN where the rows that were added tell it less surely than one row of the joint would, as where a
        joint stands elsewhere than in any of them: there a fit has any torque.
        """
        found = np.empty((len(rows), len(self.counts)))
        total, of_joints = self._weighted(base)
        root = _inverse_root(total[:-1, :-1])
        for part, columns in self._parts(samples, rows):
            for k, (own, joints) in enumerate(zip(columns, self.columns.joints, strict=True)):
                variances = of_joints[k] * np.sum((own @ root[joints]) ** 2, axis=1)
                found[part, k] = np.where(variances < 1.0, own @ base[joints], np.nan)
        return found

    def _weighted(self, base: Array) -> tuple[Array, Array]:
        """Return the sum of the products and the weights of the joints (N,), by what base parameters leave of each."""
        vector = np.append(base, -1.0)
        sizes = self.products[:, -1, -1]
        left = np.maximum(np.einsum("i,kij,j->k", vector, self.products, vector), np.maximum(ROUNDING * sizes, 1e-300))
        weights = np.where((self.counts > len(base)) & (sizes > 0.0), self.counts / left, 0.0)
        return np.tensordot(weights, self.products, axes=1), weights

    def fitted(self) -> tuple[Array, Array]:
        """Return the base parameters, each joint weighted by its own residual, and the relative residuals (N,).

        The residual of a joint without rows, or without a torque, is NaN.
        """
        last = self.products.shape[1] - 1
        size = self.products[:, last, last]
        told = (self.counts > last) & (size > 0.0)
        least = np.maximum(ROUNDING * size, 1e-300)
        # The torque of a joint of a tree depends on few of the parameters; eigenvalues of all would take far longer.
        places = [np.append(own, last) for own in self.columns.joints]
        own = [_least(products[np.ix_(at, at)]) for products, at in zip(self.products, places, strict=True)]
        weights = np.maximum(own, least)
        base = np.zeros(last)
        for _ in range(2):
            total = np.tensordot(np.where(told, self.counts / weights, 0.0), self.products, axes=1)
            base = _solved(total)
            vector = np.append(base, -1.0)
            weights = np.maximum(np.einsum("i,kij,j->k", vector, self.products, vector), least)
        relative = np.sqrt(weights / np.where(told, size, 1.0))
        return base, np.where(told, relative, np.nan)


def _inverse_root(products: Array) -> Array:
    """Return a square root of the inverse, with columns of length one; what rounding alone decides counts as that."""
    lengths = np.sqrt(np.diag(products))
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    values, vectors = np.linalg.eigh(products / np.outer(lengths, lengths))
    return np.asarray(vectors / np.sqrt(np.maximum(values, ROUNDING * max(values[-1], 1e-300))) / lengths[:, None])


def _solved(products: Array) -> Array:
    """Solve normal equations, with columns scaled to length one and without directions that rounding alone decides."""
    lengths = np.sqrt(np.diag(products)[:-1])
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    values, vectors = np.linalg.eigh(products[:-1, :-1] / np.outer(lengths, lengths))
    inside = values > ROUNDING * values[-1]
    along = vectors[:, inside].T @ (products[:-1, -1] / lengths)
    return np.asarray(vectors[:, inside] @ (along / values[inside]) / lengths)


def _least(products: Array) -> float:
    vector = np.append(_solved(products), -1.0)
    return float(vector @ products @ vector)


def cutoff_by_torques(
    recordings: Sequence[Measurements], process: Process, model: Model, order: int, source: str
) -> CutoffChoice:
    """Choose one cutoff for recordings of one robot, by how well its model explains the torques.

    For candidates from half the frequency of the motion upwards, the motion is filtered, and the torques regressed on
    it with the model, all logs together and each joint weighted by its own residual. Too low a cutoff takes off motion
    that the torques have answered to, too high a one lets noise into the accelerations; both raise the residual, by as
    much as they matter to the torques of this robot. The highest cutoff is taken at which the geometric mean of the
    joints' residuals is within 1 % of its least. Cutoffs that leave noise of the positions as more than 1 % of the
    power of the accelerations are not tried, because that noise makes inertias too small, and a controller answers it
    with torques.

    Parameters
    ----------
    recordings : sequence of Recording
        Evenly sampled.
    process : callable
        Returns the samples of each recording for a cutoff in Hz, slow rows included, without what stands within a time
        in s of the ends.
    model : Model
    order : int
        Of the Butterworth filter that is applied twice.
    source : str
        What the recordings are called in messages.

    Raises
    ------
    InputError
        Where no joint moves, or there are too few rows.
    """
    frequency = max(motion_frequency(recording.q, recording.rate) for recording in recordings)
    duration = max(recording.duration for recording in recordings)
    highest = HIGHEST * min(recording.rate for recording in recordings)
    if frequency == 0.0:
        raise InputError(
            f"{source} shows too little motion in its {sum(r.count for r in recordings)} rows to choose a cutoff by; "
            "state `cutoff` in [processing], in Hz."
        )
    lowest = min(max(0.5 * frequency, 3.0 / duration), highest)
    count = int(np.floor(np.log(highest / lowest) / np.log(RATIO) + 1e-9)) + 1
    candidates = np.asarray(lowest * RATIO ** np.arange(count), dtype=np.float64)
    too_high = _noisy(recordings, candidates, order, frequency)
    candidates = candidates[: max(1, len(candidates) - np.count_nonzero(np.maximum.accumulate(too_high)))]
    votes = _votes(process(min(2.0 * REFERENCE * lowest, highest), ENDS / lowest))
    residuals: list[Array] = []
    means: list[float] = []
    with one_thread():
        for candidate in candidates:
            torques = TorqueFit(model)
            for samples, (rows, used) in zip(process(float(candidate), ENDS / lowest), votes, strict=True):
                torques.add(samples, rows, used)
            _, relative = torques.fitted()
            told = np.isfinite(relative)
            if not told.any():
                raise InputError(
                    f"{source} leaves too few rows to choose a cutoff by; state `cutoff` in [processing], in Hz, or "
                    "record a longer motion."
                )
            residuals.append(relative)
            means.append(float(np.mean(np.log(relative[told]))))
            least = min(means)
            if means[-1] > least + CLEARLY and means[-2] > least + ENOUGH:
                break
    error, tried = np.array(means), np.asarray(candidates[: len(means)], dtype=np.float64)
    limit = error.min() + np.log(1.0 + TOLERANCE)
    last = int(np.flatnonzero(error <= limit)[-1])
    cutoff = float(tried[last])
    if last + 1 < len(error):
        cutoff *= RATIO ** float((limit - error[last]) / (error[last + 1] - error[last]))
    limited = last + 1 == len(candidates) < count
    return _choice(cutoff, order, source, recordings, tried, np.array(residuals), frequency, limited)


def _noisy(recordings: Sequence[Measurements], candidates: Array, order: int, frequency: float) -> NDArray[np.bool_]:
    """Say for which candidates (C,) noise of the positions is too large a part of the accelerations in some log."""
    noisy = np.zeros(len(candidates), dtype=bool)
    for recording in recordings:
        by_rule = min(RULE * frequency, HIGHEST * recording.rate)
        share = noise_share(recording.q, recording.rate, [*candidates, by_rule], order)
        share = share[:, np.isfinite(share[0])]
        if share.size:
            share, there = share[:-1], share[-1]
            most = np.where(there < 0.5, share, 0.0).max(axis=1)
            noisy |= (np.median(share, axis=1) > NOISE) & (candidates > NEEDED * frequency)
            noisy |= (most > NOISE) & (candidates > RULE * frequency)
    return noisy


def _choice(
    cutoff: float,
    order: int,
    source: str,
    recordings: Sequence[Measurements],
    tried: Array,
    residuals: Array,
    frequency: float,
    limited: bool,
) -> CutoffChoice:
    """Return the choice with its evidence: the residuals (C, N) of the joints at the cutoffs (C,) that were tried.

    The choice is `limited` where noise of the positions kept higher cutoffs from being tried.
    """
    names = recordings[0].column_labels
    told = np.asarray(np.isfinite(residuals).all(axis=0))
    error = np.asarray(np.exp(np.mean(np.log(residuals[:, told]), axis=1)))
    best = int(np.argmin(error))
    curves: list[Curve] = []
    table: list[tuple[str, ...]] = []
    for j, (name, own) in enumerate(zip(names, residuals.T, strict=True)):
        if not told[j]:
            table.append((name, "–", "–", "–"))
            continue
        curves.append(Curve(name, tried, own / own.min()))
        least, at = int(np.argmin(own)), float(np.interp(cutoff, tried, own))
        table.append((name, f"{100 * own[least]:.3g}", f"{tried[least]:.3g}", f"{100 * at:.3g}"))
    curves.append(Curve("all", tried, error / error.min()))
    return CutoffChoice(
        cutoff=cutoff,
        order=order,
        source=source,
        joint_names=names,
        candidates=tried,
        joint_errors=residuals,
        error=error,
        rule=min(RULE * frequency, HIGHEST * min(recording.rate for recording in recordings)),
        reason=(
            f"Positions were filtered at {cutoff:.4g} Hz, chosen by the torques of {source}: the mean error "
            f"of joints in fast motion, {100.0 * error[best]:.3g} %, is least at {tried[best]:.3g} Hz and stays within "
            f"{100.0 * TOLERANCE:g} % of that up to the choice"
            + (
                f"; beyond it, more than {100.0 * NOISE:g} % of the accelerations' power, of a joint or of half of "
                "them, would be noise of the positions, which makes inertias too small"
                if limited
                else ""
            )
        ),
        explanation=(
            "The cutoff of the position filter was chosen by the torques: for every candidate, the motion was filtered "
            "and the torques regressed on it. The picture shows the error that remains, over its least. Too low a "
            "cutoff takes off motion, too high a one lets noise into the accelerations. The dotted line is the choice."
        ),
        titles=("Joint", "Least error, %", "at, Hz", "Error at the choice, %"),
        table=table,
        plots=(Plot(curves, "cutoff, Hz", "error of the torques over the least"),),
    )


def _votes(found: Sequence[Samples]) -> list[tuple[NDArray[np.intp], NDArray[np.bool_]]]:
    """Return for each recording the rows that are compared, and of which joints (S, N)."""
    every = max(1, -(-sum(samples.count for samples in found) // MOST_ROWS))
    usual = np.sqrt(sum((samples.dq**2).sum(axis=0) for samples in found) / sum(samples.count for samples in found))
    votes = []
    for samples in found:
        rows = np.arange(0, samples.count, every)
        votes.append((rows, samples.used_rows[rows] & (np.abs(samples.dq[rows]) >= FAST * usual)))
    return votes
