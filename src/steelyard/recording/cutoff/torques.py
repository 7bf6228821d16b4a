"""The choice of the cutoff by the torques: with which motion the model explains them best."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError

from ..filtering import motion_frequency
from .drawing import Curve, picture

if TYPE_CHECKING:
    from steelyard.dynamics import Model

    from ..recording import Recording
    from ..samples import Samples

__all__ = ["TorqueCutoffChoice", "Torques", "cutoff_by_torques"]

Array = NDArray[np.float64]
Process = Callable[[float, float], "Sequence[Samples]"]
ENDS = 2.2
"""Periods of the lowest candidate whose rows at either end are spoilt by it, and left out for all."""
RATIO = 1.4
"""From one candidate to the next; between them the residual is interpolated."""
HIGHEST = 0.2
"""Of the sample rate: beyond it, central differences take more than a third off the accelerations."""
TOLERANCE = 0.01
"""The highest cutoff is taken whose residual is this little above the least. What a filter takes off the motion is in
step with it and biases every parameter; noise in the accelerations is not, averages out over the rows, and biases by
its square only. On a
simulated UR5 (`benchmarks/defaults.py`, least squares) the lowest cutoff within the tolerance, 1.5 Hz, has an error of
0.19 %, the highest, 6 Hz, one of 0.15 %."""
FAST = 0.3
"""Of a joint's own root mean square velocity: slower rows do not vote. Near a reversal the residual tells how friction
turns its sign, and how the filter rounds that; with a share of 0.1 it has several minima on arms that stick."""
REFERENCE = 4.0
"""The velocities by which rows are told slow are filtered at so many times the frequency of the motion."""
ENOUGH, CLEARLY = 0.25, 0.5
"""Rise of the logarithm of the residual above its least, of two candidates, from which higher ones are not tried."""
MOST_ROWS = 4000
"""Of all logs together, from which the residual of a candidate is computed."""
ROUNDING = 1e-11


class Torques:
    """Torques of some rows and what explains them, as sums of products: of fixed size, and they add."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.columns = model.base_columns
        size = model.base_parameters().count + 1
        self.products = np.zeros((len(self.columns.joints), size, size))
        self.counts = np.zeros(len(self.columns.joints))

    def parts(self, samples: Samples, rows: NDArray[np.intp]) -> list[Array]:
        """Return for each joint the columns of the base regressor (S, c) on which its torque depends."""
        motion = (np.ascontiguousarray(values[rows]) for values in (samples.q, samples.dq, samples.ddq))
        sizes = np.cumsum([len(own) for own in self.columns.joints])
        return np.split(self.columns.kernel(*motion), sizes[:-1], axis=1)

    def add(self, samples: Samples, rows: NDArray[np.intp], used: NDArray[np.bool_]) -> None:
        """Take up rows, of each joint those that are `used` (S, N)."""
        for k, columns in enumerate(self.parts(samples, rows)):
            own = used[:, k]
            both = np.column_stack([columns[own], samples.torque[rows, k][own]])
            places = np.append(self.columns.joints[k], len(self.products[k]) - 1)
            self.products[k][np.ix_(places, places)] += both.T @ both
            self.counts[k] += np.count_nonzero(own)

    def fitted(self) -> tuple[Array, Array]:
        """Return the base parameters, each joint weighted by its own residual, and the relative residuals (N,).

        The residual of a joint without rows, or without a torque, is NaN.
        """
        last = self.products.shape[1] - 1
        size = self.products[:, last, last]
        told = (self.counts > last) & (size > 0.0)
        least = np.maximum(ROUNDING * size, 1e-300)
        own = [_least(products) for products in self.products]
        weights = np.maximum(own, least)
        base = np.zeros(last)
        for _ in range(2):
            total = np.tensordot(np.where(told, self.counts / weights, 0.0), self.products, axes=1)
            base = _solved(total)
            vector = np.append(base, -1.0)
            weights = np.maximum(np.einsum("i,kij,j->k", vector, self.products, vector), least)
        relative = np.sqrt(weights / np.maximum(size, 1e-300))
        return base, np.where(told, relative, np.nan)


def _solved(products: Array) -> Array:
    """Solve normal equations in columns of length one, without the directions that rounding alone decides."""
    lengths = np.sqrt(np.diag(products)[:-1])
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    values, vectors = np.linalg.eigh(products[:-1, :-1] / np.outer(lengths, lengths))
    inside = values > ROUNDING * values[-1]
    along = vectors[:, inside].T @ (products[:-1, -1] / lengths)
    return np.asarray(vectors[:, inside] @ (along / values[inside]) / lengths)


def _least(products: Array) -> float:
    vector = np.append(_solved(products), -1.0)
    return float(vector @ products @ vector)


@dataclass(frozen=True, eq=False)
class TorqueCutoffChoice:
    """A cutoff chosen by the torques, and its evidence.

    Attributes
    ----------
    cutoff : float
        Hz, of a Butterworth filter of `order` forwards and backwards.
    order : int
    source : str
        The logs.
    joint_names : tuple of str
    candidates : ndarray
        (C,) Hz.
    residuals : ndarray
        (C, N) relative error of the torque of each joint in a regression on the motion filtered with each candidate;
        NaN for joints that do not tell.
    """

    titles: ClassVar[tuple[str, ...]] = ("Joint", "Least error, %", "at, Hz", "Error at the choice, %")
    explanation: ClassVar[str] = (
        "The cutoff of the position filter was chosen by the torques: for every candidate, the motion was filtered and "
        "the torques regressed on it. The picture shows the error that remains, over its least. Too low a cutoff takes "
        "off motion, too high a one lets noise into the accelerations. The dotted line is the choice."
    )

    cutoff: float
    order: int
    source: str
    joint_names: tuple[str, ...]
    candidates: Array
    residuals: Array

    @property
    def error(self) -> Array:
        """(C,) geometric mean of the residuals over the joints that tell."""
        told = np.isfinite(self.residuals).all(axis=0)
        return np.asarray(np.exp(np.mean(np.log(self.residuals[:, told]), axis=1)))

    def remark(self) -> str:
        """One sentence that says what was chosen and why."""
        error = self.error
        best = int(np.argmin(error))
        return (
            f"Positions were filtered at {self.cutoff:.4g} Hz, chosen by the torques of {self.source}: the error of "
            f"the model, {100.0 * error[best]:.3g} %, is least at {self.candidates[best]:.3g} Hz and stays within "
            f"{100.0 * TOLERANCE:g} % of that up to the choice; set `cutoff` in [processing] to choose."
        )

    def __repr__(self) -> str:
        return f"TorqueCutoffChoice({self.source!r}: {self.cutoff:.4g} Hz, order {self.order})"

    def svg(self) -> str:
        """Draw the residual of each joint over the cutoff, without scripts."""
        told = np.flatnonzero(np.isfinite(self.residuals).all(axis=0))
        curves = [
            Curve(self.joint_names[j], self.candidates, self.residuals[:, j] / self.residuals[:, j].min()) for j in told
        ]
        curves.append(Curve("all", self.candidates, self.error / self.error.min()))
        return picture(curves, "cutoff, Hz", "error of the torques over the least", self.cutoff)

    def table(self) -> list[tuple[str, ...]]:
        """For each joint its name, least residual, the cutoff of that, and the residual at the choice."""
        rows: list[tuple[str, ...]] = []
        for name, residual in zip(self.joint_names, self.residuals.T, strict=True):
            if not np.isfinite(residual).all():
                rows.append((name, "–", "–", "–"))
                continue
            best = int(np.argmin(residual))
            at = float(np.interp(self.cutoff, self.candidates, residual))
            rows.append((name, f"{100 * residual[best]:.3g}", f"{self.candidates[best]:.3g}", f"{100 * at:.3g}"))
        return rows

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{title}</th>" for title in self.titles)
        rows = "".join(
            "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in self.table()
        )
        return (
            f"<p>{html.escape(self.remark())}</p>{self.svg()}"
            f"<table><caption>{html.escape(repr(self))}</caption><tr>{head}</tr>{rows}</table>"
        )


def cutoff_by_torques(
    recordings: Sequence[Recording], process: Process, model: Model, order: int, source: str
) -> TorqueCutoffChoice:
    """Choose one cutoff for recordings of one robot, by how well its model explains the torques.

    For candidates from half the frequency of the motion upwards, the motion is filtered, and the torques regressed on
    it with the model, all logs together and each joint weighted by its own residual. Too low a cutoff takes off motion
    that the torques have answered to, too high a one lets noise into the accelerations; both raise the residual, by as
    much as they matter to the torques of this robot. The highest cutoff is taken at which the geometric mean of the
    joints' residuals is within 1 % of its least.

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
    candidates = lowest * RATIO ** np.arange(count)
    votes = _votes(process(min(2.0 * REFERENCE * lowest, highest), ENDS / lowest))
    residuals: list[Array] = []
    means: list[float] = []
    with one_thread():
        for candidate in candidates:
            torques = Torques(model)
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
    error, tried = np.array(means), candidates[: len(means)]
    limit = error.min() + np.log(1.0 + TOLERANCE)
    last = int(np.flatnonzero(error <= limit)[-1])
    cutoff = float(tried[last])
    if last + 1 < len(error):
        cutoff *= RATIO ** float((limit - error[last]) / (error[last + 1] - error[last]))
    names = recordings[0].joint_names or tuple(f"joint {j + 1}" for j in range(recordings[0].joint_count))
    return TorqueCutoffChoice(
        cutoff, order, source, names, np.asarray(tried, dtype=np.float64), np.array(residuals, dtype=np.float64)
    )


def _votes(found: Sequence[Samples]) -> list[tuple[NDArray[np.intp], NDArray[np.bool_]]]:
    """Rows that are looked at of each recording, and of which joints (S, N)."""
    every = max(1, -(-sum(samples.count for samples in found) // MOST_ROWS))
    usual = np.sqrt(sum((samples.dq**2).sum(axis=0) for samples in found) / sum(samples.count for samples in found))
    votes = []
    for samples in found:
        rows = np.arange(0, samples.count, every)
        used = np.abs(samples.dq[rows]) >= FAST * usual
        votes.append((rows, used if samples.mask is None else used & samples.mask[rows]))
    return votes
