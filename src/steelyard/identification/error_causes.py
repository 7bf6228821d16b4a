"""What would take most of the remaining error away, tried on stretches of the logs that are left out in turn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Coulomb, Model, Offset, RotorInertia, Viscous
from steelyard.dynamics.threads import in_one_thread
from steelyard.estimators.friction_candidates import CANDIDATES, JointMotion
from steelyard.once import cached_property
from steelyard.recording import Samples
from steelyard.regression.reduction import joint_rows, residuals_of_rows

from .mistakes import TOO_MANY_JOINTS
from .result import Identification, Prediction, Trace

__all__ = ["FRICTION", "LOGS", "MOTION", "OSCILLATION", "RIPPLE", "ZERO", "ErrorCause", "error_causes"]

Array = NDArray[np.float64]

MOTION, FRICTION, ZERO, OSCILLATION, LOGS = "motion", "friction", "zero", "oscillation", "logs"
RIPPLE, SPRING = "cogging", "spring"
FOLDS = 8
"""Stretches of each log that are left out in turn."""
LEAST, SURE = 0.2, 3.0
"""Least part of the squared error that a cause takes away to be told, and standard errors by which it must; less than
that part changes the error by less than a tenth. Of 66 sound logs of three simulated arms, with white noise or noise
that lasts, five of 15 s show too little motion, and none has another cause."""
RIDGES = (1e-4, 1e-2, np.inf)
"""How firmly the answer is kept to while a cause is tried, as parts of what the data say of each base parameter. Each
joint takes the one by which the cause brings most, beside a fit without the cause that keeps to the answer as much:
rotors show only where links may give way, and where links are not determined they may not."""
ALIKE = 0.8
"""Part of what logs gain by parameters of their own with which a single cause says as much in fewer words."""
FEWEST, MOST_LOGS = 200, 12
"""Rows of all logs below which nothing is tried, and logs that take part."""
KNEES, TRAVELS = (0.05, 0.2), (0.003, 0.03)
"""Parts of the fastest speed within which friction is another near rest, and of the travel in which it turns."""
SMOOTH = 0.5
"""Octaves over which spectra are smoothed."""
BAND, IN_MOTION, ABOVE = 3.0, 0.99, 1.5
"""Ratio of the ends of the band of an oscillation; the part of the power of the velocities that is the motion; and how
far above its frequencies an oscillation must lie."""
_HELD = "_error_causes"
"""Under which what was found stands in an identification."""


@dataclass(frozen=True, eq=False)
class ErrorCause:
    """Something that a model lacks, or that disturbs a log, and how much of the error it explains.

    Attributes
    ----------
    kind : str
        ``"motion"`` (which did not show what the error is of), ``"logs"`` (each is that of a robot of its own),
        ``"oscillation"``, ``"zero"``, ``"friction"``, or the kind of the term that the model lacks.
    joint_shares : ndarray
        (N,) parts of the squared error of each joint that it takes away, 0 to 1.
    share, share_error : float
        Of the squared error of all joints, and the standard error, by stretches that were left out; NaN of a motion.
    band : tuple of float
        From and to which frequency an oscillation goes, Hz.
    cutoff : float
        Below which the motion is, Hz.
    slopes : dict from str to ndarray
        By log, how fast the zero of each joint's torque drifts, (N,) N·m/s or N/s.
    """

    kind: str
    joint_shares: Array
    share: float
    share_error: float
    band: tuple[float, float] = (np.nan, np.nan)
    cutoff: float = np.nan
    slopes: Mapping[str, Array] | None = None

    def left_of(self, error: float) -> tuple[float, float, float]:
        """Return what would be left of a relative error, and what it is one standard error of the share either way."""
        shares = np.clip(self.share + np.nan_to_num(self.share_error) * np.array([0.0, 1.0, -1.0]), 0.0, 1.0)
        left = error * np.sqrt(1.0 - shares)
        return float(left[0]), float(left[1]), float(left[2])


def error_causes(identification: Identification) -> tuple[ErrorCause, ...] | None:
    """Return what takes away much of the error on which the verdict rests, the most first.

    Each cause is tried by itself: its columns are fitted together with the base parameters to all stretches of the logs
    but one, which is then predicted. An oscillation is sought in the spectra of what the answer leaves.

    Returns
    -------
    tuple of ErrorCause or None
        Those that surely take away 20 % of the squared error at least, of which those before them take away no part.
        None where the logs are too short for it, or the robot has more than 20 joints.
    """
    held: dict[str, Any] = vars(identification)  # terminal and report both ask; a property of it would be a circle
    if _HELD not in held:
        held[_HELD] = _found(identification)
    causes: tuple[ErrorCause, ...] | None = held[_HELD]
    return causes


@in_one_thread
def _found(identification: Identification) -> tuple[ErrorCause, ...] | None:
    logs = [one for one in identification.predictions if one.samples is not None and one.samples.t is not None]
    judged = ([one for one in logs if one.role == "validation"] or logs)[:MOST_LOGS]
    others = [one for one in logs if one not in judged][: MOST_LOGS - len(judged)]
    told, model = identification.prediction, identification.model
    rows = sum(one.samples.count for one in judged if one.samples is not None)
    if rows < FEWEST or model.dof > TOO_MANY_JOINTS or len(told.joint_error) != model.dof:
        return None
    squares = np.nan_to_num(told.joint_error) ** 2
    trial = _Trial.of(identification, judged, others)
    causes = [*trial.causes(squares), *_oscillation(judged, squares)]
    # Of logs that are not of one robot each has another offset, another zero and another friction, which say a part.
    apart = next((one for one in causes if one.kind == LOGS), None)
    if apart and any(one.share > ALIKE * apart.share for one in causes if one is not apart):
        causes.remove(apart)
    elif apart:
        causes = [apart]
    kept, taken = [], np.zeros(len(squares))
    for cause in sorted(causes, key=lambda one: -one.share):
        more = np.maximum(cause.joint_shares - taken, 0.0)
        if np.sum(more * squares) > LEAST * squares.sum():  # and no other name for the same error
            kept.append(cause)
            taken = np.maximum(taken, cause.joint_shares)
    return tuple(kept)


class _Part(NamedTuple):
    """Rows of one stretch of a log: products of all columns, joint by joint, and which stretch and log it is.

    Or of that stretch of several logs, whose log is -1.
    """

    products: list[Array]
    counts: Array
    fold: int
    log: int
    judged: bool


@dataclass(frozen=True, eq=False)
class _Trial:
    """The columns of all causes beside the base regressor."""

    model: Model
    parts: list[_Part]
    names: list[str]
    groups: dict[str, list[NDArray[np.intp]]]
    logs: list[str]

    @classmethod
    def of(cls, identification: Identification, judged: Sequence[Prediction], others: Sequence[Prediction]) -> _Trial:
        model, predictions = identification.model, [*judged, *others]
        lacking, base = _lacking(identification), identification.estimate.base
        parts: list[_Part] = []
        for number, prediction in enumerate(predictions):
            samples = prediction.samples
            assert samples is not None
            assert samples.t is not None
            rows = [block for _, block in joint_rows(model, samples)]
            whole = [np.concatenate([block[j] for block in rows]) for j in range(model.dof)]
            left = residuals_of_rows(model, whole, base)
            time = np.zeros((samples.count, 2 * len(predictions)))
            time[:, 2 * number] = samples.t - samples.t.mean()
            time[:, 2 * number + 1] = 1.0
            own = _columns(model, samples, left, lacking, identification.friction is None)
            for k, rows_of_fold in enumerate(np.array_split(np.arange(samples.count), FOLDS)):
                products, counts = [], []
                for j in range(model.dof):
                    used = rows_of_fold if samples.mask is None else rows_of_fold[samples.mask[rows_of_fold, j]]
                    cause = [own[kind][j][used] for kind in own]
                    every = np.column_stack([whole[j][used, :-1], *cause, time[used], left[used, j]])
                    products.append(every.T @ every)
                    counts.append(len(used))
                parts.append(_Part(products, np.array(counts), k, number, prediction in judged))
        groups: dict[str, list[NDArray[np.intp]]] = {}
        for j, c in enumerate(model.base_columns.joints):  # all logs have the same columns
            first = len(c)
            for kind, columns in (own | {ZERO: [time] * model.dof}).items():
                groups.setdefault(kind, []).append(np.arange(first, first + columns[j].shape[1]))
                first += columns[j].shape[1]
        return cls(model, parts, list(lacking), groups, [one.name for one in predictions])

    def causes(self, squares: Array) -> Iterator[ErrorCause]:
        """Yield those that surely take a part of the squared errors (N,) of the verdict away."""
        weights = self._weights()
        counts = np.sum([part.counts for part in self.parts if part.judged], axis=0)
        whole = np.maximum(squares * counts, 1e-300)
        without = {ridge: self._squares([], weights, ridge) for ridge in RIDGES}
        together = min(without.values(), key=lambda one: float(one.sum()))
        before = together.sum(axis=0)
        # What is left where the same motion takes part in the fit is no fault of the motion.
        kind, left, error = MOTION, before, np.nan
        if len(self.logs) > 1:
            own = min((self._squares([], weights, one, own=True) for one in RIDGES), key=lambda one: float(one.sum()))
            ratio = own.sum() / together.sum()
            spread = np.sqrt(FOLDS) * np.std((own - ratio * together).sum(axis=1), ddof=1)  # of a ratio, linearised
            if 1.0 - ratio > max(LEAST, SURE * spread / together.sum()):
                kind, left, error = LOGS, own.sum(axis=0), float(spread / whole.sum())
        shares = np.clip(1.0 - left / whole, 0.0, 1.0)
        yield from _told(kind, shares, float(np.sum(shares * squares) / squares.sum()), error)
        unseen = any(part.judged for part in self.parts) and not all(part.judged for part in self.parts)
        friction = np.zeros((FOLDS, self.model.dof))
        for kind, places in self.groups.items():
            gains = np.zeros_like(friction)
            for ridge, others in without.items():
                # Fits that leave stretches out err as the verdict does, the answer itself as it does on its own data.
                of = before if unseen or np.isinf(ridge) else whole
                fallen = (others - self._squares(places, weights, ridge)) * of / np.maximum(others.sum(axis=0), 1e-300)
                sure = fallen.sum(axis=0) > SURE * np.sqrt(FOLDS) * np.std(fallen, axis=0, ddof=1)
                gains = np.where(sure & (fallen.sum(axis=0) > gains.sum(axis=0)), fallen, gains)
            fitted = self._fit(self._joined, places, weights, RIDGES[0])[1]
            if kind in self.names and kind != Offset.kind:
                gains = np.where([own[0] > 0.0 for own in fitted], gains, 0.0)
            if kind.startswith(FRICTION):  # one form at a joint
                friction = np.where(gains.sum(axis=0) > friction.sum(axis=0), gains, friction)
                continue
            slopes = None
            if kind == ZERO:
                told = np.array(fitted)[:, ::2] * (gains.sum(axis=0) > 0.0)[:, None]
                slopes = dict(zip(self.logs, told.T, strict=True))
            yield from _told(kind, *_shares(gains, whole), slopes=slopes)
        yield from _told(FRICTION, *_shares(friction, whole))

    @cached_property
    def _joined(self) -> list[_Part]:
        """The stretches of all judged logs as those of one, and of the others: most fits are of all together."""
        groups: dict[tuple[int, bool], list[_Part]] = {}
        for part in self.parts:
            groups.setdefault((part.fold, part.judged), []).append(part)
        return [
            _Part(
                [np.sum(one, axis=0) for one in zip(*(part.products for part in group), strict=True)],
                np.sum([part.counts for part in group], axis=0),
                fold,
                -1,
                judged,
            )
            for (fold, judged), group in groups.items()
        ]

    def _weights(self) -> Array:
        """1 over the mean square of what is left at each joint; weighted as the joints err."""
        squares = np.sum([[one[-1, -1] for one in part.products] for part in self.parts], axis=0)
        counts = np.sum([part.counts for part in self.parts], axis=0)
        mean = squares / np.maximum(counts, 1)
        return np.asarray(1.0 / np.maximum(mean, 1e-12 * mean.max(initial=0.0) + 1e-300))

    def _squares(self, places: Sequence[NDArray[np.intp]], weights: Array, ridge: float, *, own: bool = False) -> Array:
        """Squared errors (FOLDS, N) of the judged logs, of the answer as it changes with the columns of a cause.

        It changes with all logs together, or for each with its `own` rows alone.
        """
        squares = np.zeros((FOLDS, self.model.dof))
        parts = self.parts if own else self._joined
        for k in range(FOLDS):
            others = [one for one in parts if one.fold != k]
            together = None if own else self._fit(others, places, weights, ridge)
            for part in parts:
                if part.fold != k or not part.judged:
                    continue
                change, extra = together or self._fit(
                    [one for one in others if one.log == part.log], places, weights, ridge
                )
                for j, (c, products) in enumerate(zip(self.model.base_columns.joints, part.products, strict=True)):
                    left = np.zeros(len(products))
                    left[: len(c)], left[-1] = -change[c], 1.0
                    if places:
                        left[places[j]] = -extra[j]
                    squares[k, j] += max(float(left @ products @ left), 0.0)
        return squares

    def _fit(
        self, parts: Sequence[_Part], places: Sequence[NDArray[np.intp]], weights: Array, ridge: float
    ) -> tuple[Array, list[Array]]:
        """Return how the base parameters change with some stretches, and what multiplies the columns of each joint."""
        many = self.model.base_parameters().count
        width = len(places[0]) if places else 0
        size = many + self.model.dof * width
        matrix, right = np.zeros((size, size)), np.zeros(size)
        for j, c in enumerate(self.model.base_columns.joints):
            products = weights[j] * np.sum([one.products[j] for one in parts], axis=0)
            at = np.concatenate([c, many + j * width + np.arange(width)]).astype(int)
            of = np.concatenate([np.arange(len(c)), places[j] if places else []]).astype(int)
            matrix[np.ix_(at, at)] += products[np.ix_(of, of)]
            right[at] += products[of, -1]
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        matrix, right = matrix / np.outer(scale, scale), right / scale
        kept = np.ones(size, dtype=bool)
        if np.isinf(ridge):
            kept[:many] = False
        penalty = np.full(size, 1e-9)
        penalty[:many] = 0.0 if np.isinf(ridge) else ridge
        solution = np.zeros(size)
        if kept.any():
            own = (matrix + np.diag(penalty))[np.ix_(kept, kept)]
            solution[kept] = np.linalg.solve(own, right[kept])
        solution /= scale
        return solution[:many], list(solution[many:].reshape(self.model.dof, width))


def _lacking(identification: Identification) -> tuple[str, ...]:
    """The kinds of terms that most robots have and this model has not."""
    robot = identification.model.robot
    kinds = {law.kind for term in robot.terms for law in term.laws}
    if "motor_side" in kinds:  # which holds friction and rotors
        return ()
    return tuple(one.kind for one in (RotorInertia, Offset, Viscous, Coulomb) if one.kind not in kinds)


def _columns(
    model: Model, samples: Samples, left: Array, lacking: Sequence[str], tries_friction: bool
) -> dict[str, list[Array]]:
    """Return the columns of each cause at each joint, (S, k); `left` is what the answer leaves of the torques."""
    found: dict[str, list[Array]] = {}
    for j in range(model.dof):
        q, dq, ddq = samples.q[:, j], samples.dq[:, j], samples.ddq[:, j]
        own = left[:, j] if samples.mask is None else np.where(samples.mask[:, j], left[:, j], 0.0)
        motion = JointMotion(q, dq, samples.torque[:, j] - left[:, j])
        terms = {RotorInertia.kind: ddq, Offset.kind: np.ones_like(q), Viscous.kind: dq, Coulomb.kind: np.sign(dq)}
        for kind in lacking:
            found.setdefault(kind, []).append(terms[kind][:, None])
        if tries_friction and not {Viscous.kind, Coulomb.kind} & set(lacking):
            for form, columns in _friction(motion).items():
                found.setdefault(form, []).append(columns)
        if tries_friction:
            found.setdefault(RIPPLE, []).append(_ripple(motion, own))
        found.setdefault(SPRING, []).append(q[:, None] - q.mean())
    return found


def _friction(motion: JointMotion) -> dict[str, Array]:
    """Forms of friction beside viscous and Coulomb's: another one near rest and at speed, under load, after a turn."""
    sign, size = np.sign(motion.dq), np.abs(motion.dq) / max(motion.speed, 1e-300)
    presliding = next(one for one in CANDIDATES if one.kind == "dahl")
    travels = [(max(share * float(np.ptp(motion.q)), 1e-12),) for share in TRAVELS]
    return {
        f"{FRICTION} by speed": np.column_stack([*(sign * np.exp(-size / knee) for knee in KNEES), sign * size**2]),
        f"{FRICTION} by load": (sign * np.abs(motion.load))[:, None],
        f"{FRICTION} by travel": np.column_stack(presliding.columns(motion, travels)),
    }


def _ripple(motion: JointMotion, left: Array) -> Array:
    """The ripple with position, among those that a selection of friction tries, that explains most of what is left."""
    ripples = next(one for one in CANDIDATES if one.kind == RIPPLE)
    shapes = ripples.shapes(motion)
    if not shapes:
        return np.zeros((len(left), 2))
    columns = np.stack(ripples.columns(motion, shapes))
    explained = np.sum((left @ np.linalg.qr(columns)[0]) ** 2, axis=1)
    return np.asarray(columns[np.argmax(explained)])


def _shares(gains: Array, whole: Array) -> tuple[Array, float, float]:
    """Return what gains (FOLDS, N) are of the squared errors (N,): of each joint, of all, and the latter's error."""
    error = float(np.sqrt(FOLDS) * np.std(gains.sum(axis=1), ddof=1) / whole.sum())
    return np.clip(gains.sum(axis=0) / whole, 0.0, 1.0), float(gains.sum() / whole.sum()), error


def _told(kind: str, shares: Array, share: float, error: float, **more: Any) -> Iterator[ErrorCause]:
    """Yield a cause where it takes enough away, and surely."""
    if share > LEAST and not share < SURE * error:
        yield ErrorCause(kind, shares, min(share, 1.0), error, **more)


def _oscillation(judged: Sequence[Prediction], squares: Array) -> Iterator[ErrorCause]:
    """A band, above the frequencies of the motion, that holds much of what is left."""
    stretches = [stretch for one in judged for stretch in _stretches(one.trace)]
    interval = min((one.trace.interval for one in judged), default=np.nan)
    motion = max((_motion_frequency(one.samples) for one in judged if one.samples is not None), default=np.nan)
    rows = sum(map(len, stretches))
    if not np.isfinite([interval, motion]).all() or rows < FEWEST:
        return
    nyquist = 0.5 / interval
    whole = np.maximum(squares * np.sum([np.count_nonzero(one, axis=0) for one in stretches], axis=0), 1e-300)
    f = np.concatenate([np.fft.rfftfreq(len(one), interval)[1:] for one in stretches])
    power = np.concatenate([2.0 * np.abs(np.fft.rfft(one, axis=0)[1:]) ** 2 / len(one) for one in stretches])
    starts = np.arange(np.log2(ABOVE * motion), np.log2(nyquist / BAND), 0.25)
    if not len(starts):
        return
    # At the frequencies of the motion the fit has taken a part of what was there. Each one stands for those around it.
    beyond = f + np.concatenate([np.full(len(one) // 2, 0.5 / (len(one) * interval)) for one in stretches]) >= motion
    f, power = f[beyond], power[beyond]
    standing = power * _standing_out(f, power.sum(axis=1))[:, None]

    def held(low: float) -> Array:
        """Squares (N,) within the band from there."""
        return np.asarray(standing[(f >= low) & (f < BAND * low)].sum(axis=0))

    low = float(2.0 ** max(starts, key=lambda one: float(held(2.0**one).sum())))
    parts: list[tuple[float, float]] = []
    for stretch in stretches:
        spectrum, of = np.fft.rfft(stretch, axis=0), np.fft.rfftfreq(len(stretch), interval)
        spectrum[(of < low) | (of >= BAND * low)] = 0.0
        band = np.fft.irfft(spectrum, len(stretch), axis=0)
        pieces = max(1, round(FOLDS / len(stretches)))
        pairs = zip(np.array_split(band, pieces), np.array_split(stretch, pieces), strict=True)
        parts += [(float(np.sum(a**2)), float(np.sum(b**2))) for a, b in pairs]
    inside, every = np.array(parts).T
    # The ratio of two sums over the stretches (the linearised error of a ratio).
    spread = np.std(inside - inside.sum() / every.sum() * every, ddof=1) if len(parts) > 1 else np.inf
    error = float(np.sqrt(len(parts)) * spread / whole.sum())
    shares = np.clip(held(low) / whole, 0.0, 1.0)
    share = float(np.sum(held(low)) / whole.sum())
    yield from _told(OSCILLATION, shares, share, error, band=(low, BAND * low), cutoff=float(low / np.sqrt(BAND)))


def _standing_out(f: Array, power: Array) -> Array:
    """Return the parts (F,) of a power that rise above what is there both at lower and at higher frequencies.

    White noise has a level spectrum, and noise that lasts, or friction where a motion turns, one that falls.
    """
    bins = np.floor(np.log2(f / f.min()) / SMOOTH).astype(int)
    count = np.bincount(bins)
    density = np.divide(np.bincount(bins, power), count, out=np.full(len(count), np.inf), where=count > 0)
    lower, higher = np.minimum.accumulate(density), np.minimum.accumulate(density[::-1])[::-1]
    parts = 1.0 - np.maximum(lower, higher) / np.maximum(density, 1e-300)
    return np.asarray(parts[bins])


def _stretches(trace: Trace) -> list[Array]:
    """What is left in neighbouring rows, (L, N) each; 0 where a row was not used."""
    if trace.piece_rows == 1:
        left = trace.measured - trace.feasible
        unused = None if trace.samples is None or trace.samples.mask is None else ~trace.samples.mask
        stretches = [left if unused is None else np.where(unused, 0.0, left)]
    else:
        stretches = [np.nan_to_num(one) for one in trace.residuals]
    return [one for one in stretches if len(one) >= FEWEST // FOLDS]


def _motion_frequency(samples: Samples) -> float:
    """The frequency in Hz below which the velocities have 99 % of their power; between those of a spectrum, too.

    Of a log of 1.7 s these are 0.6 Hz apart, and two rows more or less would choose another.
    """
    if samples.t is None or samples.count < FEWEST // FOLDS:
        return float("nan")
    dq = samples.dq - samples.dq.mean(axis=0)
    power = np.sum(np.abs(np.fft.rfft(dq / np.maximum(np.std(dq, axis=0), 1e-12), axis=0)) ** 2, axis=1)
    frequencies = np.fft.rfftfreq(samples.count, float(np.median(np.diff(samples.t))))
    return float(np.interp(IN_MOTION * power.sum(), np.cumsum(power), frequencies))
