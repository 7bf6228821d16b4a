"""Which friction a robot has: laws are added joint by joint where the data calls for them, and refused elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table, text_table
from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.files import tell
from steelyard.recording import Samples
from steelyard.regression.coloured_noise import correlation_sum
from steelyard.regression.reduction import joint_rows, require_joints

from .friction_candidates import CANDIDATES, FrictionCandidate, JointMotion, lugre_is_passive

__all__ = ["ChosenFriction", "FrictionData", "FrictionSelection", "FrictionTrial", "select_friction"]

Array = NDArray[np.float64]
Shape = tuple[float, ...]

SIGNIFICANCE = 0.01
"""Probability with which any law is added to a robot that has none of them, after Holm's correction."""
LIKELY = 0.05
"""The same of a joint, before any correction, of a law that was found at another."""
LEAST_GAIN = 0.02
"""Part by which the error of a joint on stretches that are left out must fall. Speeds from noisy encoders make a law
significant that explains less."""
LEAST_OF_WIDER = 0.1
"""Part by which a law must lower this error more than one that it contains. What is left of Dahl's friction by the
filters of the motion lets LuGre's lower it by 3 to 7 %; where there is LuGre friction it does so by a quarter."""
FOLDS = 8
"""Contiguous stretches that are left out in turn."""
MOST_BLOCKS, FEWEST_BLOCKS = 40, 16
"""Contiguous blocks over which the scores of a law are summed to tell its standard error."""
INDEPENDENT = 2.0
"""Independent rows, in the sense of the correlation of the residuals, that a block has at least."""
FREE = 16.0
"""Independent rows beyond the number of parameters below which a joint tells nothing of its friction."""
MOST_ROWS = 8_000
"""Rows of a joint that are used: more tell shapes no better than the laws hold."""
DRIVING = 0.02
"""Part of the largest friction of a joint by which a law may drive it at some speed: noise moves Coulomb friction."""
RIDGE = 1e-10
"""Added to the squared lengths of columns, so that what a stretch does not show has a value."""
REACH = 1.4
"""Factor by which a shape may go beyond those that were tried first."""
MANY_SHAPES, PROMISING = 3, 0.7
"""Shapes of a law from which on they are searched together, where the best that was tried first explains this part of
what the best other law does."""
SWEEPS = 4
"""Rounds in which the shapes of the laws that were chosen are moved, each with half the step of the one before."""
MOST_LAWS = 4
"""Laws that are added at most, one after the other."""


@dataclass(frozen=True, eq=False)
class FrictionData:
    """The rows of the regression of some logs, and the motion from which columns of further laws are computed.

    Attributes
    ----------
    model : Model
    rows : tuple of ndarray
        For each joint ``[W omega]``, (S, c + 1).
    used : ndarray of bool
        (S, N).
    motion : Samples
        Of all the logs, one after the other.
    starts : tuple of int
        Rows of `motion` at which a log begins.
    memory : float
        Rows over which errors are alike at least, since torques were filtered.
    """

    model: Model
    rows: tuple[Array, ...]
    used: NDArray[np.bool_]
    motion: Samples
    starts: tuple[int, ...]
    memory: float = 1.0

    @classmethod
    def of(cls, model: Model, samples: Samples | Sequence[Samples], memory: float = 1.0) -> FrictionData:
        """Take samples as they are, each of them one log."""
        parts = [samples] if isinstance(samples, Samples) else list(samples)
        if not parts:
            raise InputError("there are no samples to choose friction by; give at least one Samples.")
        for part in parts:
            require_joints(model, part)
        pieces = [rows for part in parts for _, rows in joint_rows(model, part)]
        starts = np.cumsum([0, *(part.count for part in parts[:-1])])
        motion = Samples.joined(parts)
        used = np.ones(motion.q.shape, dtype=bool) if motion.mask is None else motion.mask
        rows = tuple(np.vstack(own) for own in zip(*pieces, strict=True))
        return cls(model, rows, used, motion, tuple(int(start) for start in starts), memory)

    @cached_property
    def loads(self) -> Array:
        """(S, N) torques of the links alone, by least squares."""
        base = self.model.base_parameters()
        width = base.count
        normal, target = np.zeros((width, width)), np.zeros(width)
        for k, own in enumerate(self.model.base_columns.joints):
            rows = self.rows[k][self.used[:, k]]
            if not len(rows):
                continue
            left = rows[:, -1] - rows[:, :-1] @ np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=1e-9)[0]
            rows = rows / max(float(np.sqrt(np.mean(left**2))), 1e-9 * float(np.abs(rows).max()), 1e-300)
            normal[np.ix_(own, own)] += rows[:, :-1].T @ rows[:, :-1]
            target[own] += rows[:, :-1].T @ rows[:, -1]
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        found = np.linalg.lstsq(normal / np.outer(scale, scale), target / scale, rcond=1e-10)[0] / scale
        m = self.motion
        return np.asarray(self.model.computed_torque(m.q, m.dq, m.ddq, base.Pb @ found))

    def joint_motion(self, joint: int) -> JointMotion:
        """The motion of one joint."""
        m = self.motion
        return JointMotion(m.q[:, joint], m.dq[:, joint], self.loads[:, joint], self.starts)


@dataclass(frozen=True)
class ChosenFriction:
    """A law that was added at a joint.

    Attributes
    ----------
    joint : int
    kind : str
    shape : dict from str to float
        What it depends on nonlinearly.
    coefficients : tuple of float
        What its columns are multiplied by.
    p_value : float
        That it is not there, for correlated residuals, after Holm's correction.
    gain : float
        Part by which it lowers the error of the joint on stretches that are left out.
    """

    joint: int
    kind: str
    shape: dict[str, float]
    coefficients: tuple[float, ...]
    p_value: float
    gain: float


@dataclass(frozen=True)
class FrictionTrial:
    """What became of a law that was tried over all the joints.

    Attributes
    ----------
    step : int
        How many laws had been added before.
    kind, words : str
    joints : tuple of str
        At which it is significant and lowers the error.
    p_value : float
        The least over the joints, after Holm's correction.
    gain : float
        Part by which the error on stretches that are left out falls, over all joints where the law would be added (or
        of the joint where it falls most, where there is none).
    verdict : str
        ``"chosen"``, ``"refused"``, or ``"another is better"``; ``"taken back"`` where it was no longer needed.
    """

    step: int
    kind: str
    words: str
    joints: tuple[str, ...]
    p_value: float
    gain: float
    verdict: str


@dataclass(frozen=True, eq=False)
class FrictionSelection:
    """Which laws of friction were added to a model, and what became of the others.

    Attributes
    ----------
    joint_names : tuple of str
    chosen : tuple of ChosenFriction
    trials : tuple of FrictionTrial
        In the order of the steps, the best law of each step first.
    errors, plain_errors : ndarray
        (N,) root mean square on stretches that are left out, N·m or N, each joint by itself: with the laws that were
        added, and without.
    remarks : tuple of str
    """

    joint_names: tuple[str, ...]
    chosen: tuple[ChosenFriction, ...]
    trials: tuple[FrictionTrial, ...]
    errors: Array
    plain_errors: Array
    remarks: tuple[str, ...] = ()

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds that were added at any joint, in the order in which they were."""
        return tuple(dict.fromkeys(one.kind for one in self.chosen))

    def without_laws(self) -> FrictionSelection:
        """Return the selection with all its laws taken back."""
        trials = [replace(one, verdict="taken back") if one.verdict == "chosen" else one for one in self.trials]
        return replace(self, chosen=(), trials=tuple(trials), errors=self.plain_errors)

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Heads and rows of the table of laws that were tried."""
        rows: list[tuple[str, ...]] = [
            (
                str(one.step + 1),
                one.words,
                ", ".join(one.joints) or "-",
                f"{-one.gain:+.1%}",
                f"{one.p_value:.1g}" if one.p_value > 1e-99 else "0",
                one.verdict,
            )
            for one in self.trials
        ]
        return ("step", "law", "joints", "held-out error", "p", "verdict"), rows

    def chosen_table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Heads and rows of the table of laws that were added."""
        rows: list[tuple[str, ...]] = [
            (
                self.joint_names[one.joint],
                one.kind,
                ", ".join(f"{name} {value:.3g}" for name, value in one.shape.items()) or "-",
                ", ".join(f"{value:.3g}" for value in one.coefficients),
                f"{-one.gain:+.1%}",
                f"{one.p_value:.1g}" if one.p_value > 1e-99 else "0",
            )
            for one in self.chosen
        ]
        return ("joint", "law", "shape", "coefficients", "held-out error", "p"), rows

    def to_dict(self) -> dict[str, Any]:
        """Return the selection as plain data."""
        return {
            "chosen": [
                {
                    "joint": self.joint_names[one.joint],
                    "kind": one.kind,
                    "shape": one.shape,
                    "coefficients": list(one.coefficients),
                    "p_value": one.p_value,
                    "gain": one.gain,
                }
                for one in self.chosen
            ],
            "trials": [
                {
                    "step": one.step + 1,
                    "kind": one.kind,
                    "joints": list(one.joints),
                    "p_value": one.p_value,
                    "gain": one.gain,
                    "verdict": one.verdict,
                }
                for one in self.trials
            ],
            "joints": [
                {"joint": name, "held_out_error": float(after), "plain_held_out_error": float(before)}
                for name, after, before in zip(self.joint_names, self.errors, self.plain_errors, strict=True)
            ],
            "remarks": list(self.remarks),
        }

    def __str__(self) -> str:
        return "\n".join([text_table(*self.table(), numbers=(0, 3, 4)), *self.remarks])

    def __repr__(self) -> str:
        return f"FrictionSelection({', '.join(self.kinds) or 'nothing added'})"

    def _repr_html_(self) -> str:
        return html_table(repr(self), *self.table(), self.remarks)


def select_friction(
    model: Model,
    samples: Samples | Sequence[Samples] | FrictionData,
    *,
    candidates: Sequence[FrictionCandidate] = CANDIDATES,
    significance: float = SIGNIFICANCE,
    least_gain: float = LEAST_GAIN,
) -> FrictionSelection:
    """Choose which laws of friction are added to those of a model, joint by joint.

    The rows of each joint are regressed by themselves: what the model has is eliminated once, and a law is tried by
    what its columns explain of the rest, so that its shapes (velocities, exponents, harmonics) are searched at little
    cost (variable projection). One law at a time is added, at all the joints at once where

    - it is significant: the test sums scores over contiguous blocks, so that it holds where residuals are correlated in
      time, counts every shape that was tried, and is corrected for the number of joints and laws (Holm);
    - and the error on contiguous stretches that are left out in turn falls by more than one standard error and by
      `least_gain`.

    Of several the one that lowers this error most is taken, unless beside a simpler one it lowers it by less than that.
    A law that is there for sure at one joint is added at others where it is likely (5 %, uncorrected) and lowers the
    error by twice `least_gain`. In the end each law is taken back that the others make needless.

    Parameters
    ----------
    model : Model
        With the terms that are there in any case, such as viscous and Coulomb friction.
    samples : Samples, sequence of Samples or FrictionData
        Each Samples one log, with its rows in the order of time.
    candidates : sequence of FrictionCandidate
        Simple ones first.
    significance : float
    least_gain : float

    Returns
    -------
    FrictionSelection

    Raises
    ------
    InputError
        If the samples have another number of joints than the model.

    References
    ----------
    G. H. Golub and V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems whose
    variables separate, SIAM Journal on Numerical Analysis 10, 1973. S. Holm, A simple sequentially rejective multiple
    test procedure, Scandinavian Journal of Statistics 6, 1979.

    Examples
    --------
    A joint with friction that rises by half near rest:

    >>> import numpy as np
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0))
    >>> model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))
    >>> t = np.arange(0.0, 30.0, 0.01)[:, None]
    >>> q, dq, ddq = np.sin(t) + 0.3 * np.sin(4 * t), np.cos(t) + 1.2 * np.cos(4 * t), -np.sin(t) - 4.8 * np.sin(4 * t)
    >>> torque = ddq + 9.0 * np.cos(q) + 0.5 * dq + np.sign(dq) * (2.0 + np.exp(-((dq / 0.2) ** 2)))
    >>> torque += 0.05 * np.random.default_rng(1).normal(size=torque.shape)
    >>> found = select_friction(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque), candidates=CANDIDATES[:7])
    >>> found.kinds, round(found.chosen[0].shape["velocity"], 2)
    (('stribeck',), 0.2)
    """
    data = samples if isinstance(samples, FrictionData) else FrictionData.of(model, samples)
    joints = [_Joint(data, k) for k in range(model.dof)]
    names = tuple(model.robot.joint_names)
    trials: list[FrictionTrial] = []
    accepted: list[_Trial] = []
    for step in range(MOST_LAWS):
        tell("laws of friction that are tried", step, MOST_LAWS, "steps")
        tried = [
            (candidate, [joint.tried(candidate) for joint in joints])
            for candidate in candidates
            if candidate.kind not in [one.candidate.kind for one in accepted]
        ]
        _correct([trial for _, of_joints in tried for trial in of_joints if trial is not None])
        told = [_Told(candidate, of_joints, significance, least_gain) for candidate, of_joints in tried]
        best = _best(told, least_gain)
        for one in sorted(told, key=lambda one: (one is not best, -one.total)):
            trials.append(one.trial(step, names, one is best))
        if best is None:
            break
        for trial in best.taken:
            trial.joint.add(trial)
            accepted.append(trial)
    for trial in accepted:
        if not trial.joint.needs(trial, least_gain):
            trial.joint.remove(trial)
    for joint in joints:
        joint.refine()
    chosen = [one for k, joint in enumerate(joints) for one in joint.chosen(k)]
    kept = {one.kind for one in chosen}
    trials = [
        replace(one, verdict="taken back") if one.verdict == "chosen" and one.kind not in kept else one
        for one in trials
    ]
    remarks = []
    silent = [name for name, joint in zip(names, joints, strict=True) if not joint.tells]
    if silent:
        remarks.append(
            f"What friction {', '.join(silent)} has cannot be told: it stands still, the log is too short, or its "
            "torques are filtered too much."
        )
        if not chosen and len(silent) < len(names):
            remarks.append("The other joints call for no friction beyond that of the terms.")
    return FrictionSelection(
        names,
        tuple(sorted(chosen, key=lambda one: one.joint)),
        tuple(trials),
        np.array([joint.error(joint.laws) for joint in joints]),
        np.array([joint.error([]) for joint in joints]),
        tuple(remarks),
    )


@dataclass(eq=False)
class _Trial:
    """A law at a joint, with the best of its shapes."""

    joint: _Joint
    candidate: FrictionCandidate
    shape: Shape
    columns: Array  # (used rows, c), of length one
    lengths: Array
    p_value: float
    losses: Array  # (folds,) with the law
    before: Array  # (folds,) without it
    corrected: float = 1.0
    explained: float = 0.0

    @property
    def gain(self) -> float:
        """Part by which the held-out error of the joint falls."""
        before = float(self.before.sum())
        return 1.0 - float(np.sqrt(self.losses.sum() / before)) if before > 0.0 else 0.0

    @property
    def speaks_for_itself(self) -> bool:
        """Whether the law is likely at this joint alone; by the held-out error where the log is short for the test."""
        if self.joint.tells:
            return self.p_value < LIKELY
        falls = self.before - self.losses
        return bool(float(falls.sum()) > 2.0 * np.sqrt(len(falls)) * float(falls.std(ddof=1)))

    @property
    def is_sure(self) -> bool:
        """Whether the held-out error falls by more than one standard error."""
        falls = self.before - self.losses
        return bool(float(falls.sum()) > np.sqrt(len(falls)) * float(falls.std(ddof=1)))


class _Told:
    """A law over all the joints."""

    def __init__(
        self, candidate: FrictionCandidate, trials: Sequence[_Trial | None], significance: float, least_gain: float
    ) -> None:
        self.candidate = candidate
        self.trials = [trial for trial in trials if trial is not None]
        self.taken = [
            one for one in self.trials if one.corrected < significance and one.gain > least_gain and one.is_sure
        ]
        if self.taken:
            # A law that is there for sure at one joint needs no such proof at the others.
            self.taken = [
                one
                for one in self.trials
                if one in self.taken or (one.gain > 2.0 * least_gain and one.is_sure and one.speaks_for_itself)
            ]
        # By logarithms, so that joints with large torques count as others do.
        self.falls = sum((_fall(one) for one in self.taken), np.zeros(FOLDS))

    @property
    def total(self) -> float:
        return float(self.falls.sum())

    def trial(self, step: int, names: Sequence[str], is_best: bool) -> FrictionTrial:
        best = self.taken or sorted(self.trials, key=lambda one: -one.gain)[:1]
        before = sum(float(np.log(one.before.sum())) for one in best)
        after = sum(float(np.log(max(one.losses.sum(), 1e-300))) for one in best)
        gain = 1.0 - float(np.exp(0.5 * (after - before) / len(best))) if best else 0.0
        return FrictionTrial(
            step,
            self.candidate.kind,
            self.candidate.words,
            tuple(names[one.joint.number] for one in self.taken),
            min((one.corrected for one in self.trials), default=1.0),
            gain,
            "chosen" if is_best else "another is better" if self.taken else "refused",
        )


def _fall(trial: _Trial) -> Array:
    """By how much the logarithm of the held-out loss of a joint falls, shared out over the folds."""
    total = float(trial.before.sum())
    share = max(1.0 - float(trial.losses.sum()) / total, 1e-12)
    whole = -2.0 * np.log(max(1.0 - trial.gain, 1e-12))
    return np.asarray((trial.before - trial.losses) / total * (whole / share))


def _best(told: Sequence[_Told], least_gain: float) -> _Told | None:
    """The law that lowers the held-out error most, or a simpler one beside which it does not lower it enough."""
    helpful = [one for one in told if one.taken]
    if not helpful:
        return None
    best = max(helpful, key=lambda one: one.total)
    for one in sorted(helpful, key=lambda one: (one.candidate.parameter_count, -one.total)):
        if one.candidate.parameter_count >= best.candidate.parameter_count:
            break
        contained = one.candidate.kind in best.candidate.contains
        short = best.falls - one.falls
        least = -2.0 * np.log(1.0 - (LEAST_OF_WIDER if contained else least_gain)) * len(best.taken)
        error = 0.0 if contained else np.sqrt(len(short)) * float(short.std(ddof=1))
        if float(short.sum()) <= max(least, error):
            return one
    return best


def _correct(trials: Sequence[_Trial]) -> None:
    """Correct p-values for their number (Holm)."""
    largest = 0.0
    ordered = sorted(trials, key=lambda one: one.p_value)
    for place, trial in enumerate(ordered):
        largest = max(largest, min(1.0, (len(ordered) - place) * trial.p_value))
        trial.corrected = largest


class _Joint:
    """The rows of one joint, with what its model has eliminated."""

    def __init__(self, data: FrictionData, number: int) -> None:
        self.data, self.number = data, number
        self.motion = data.joint_motion(number)
        used = np.flatnonzero(data.used[:, number])
        self.rows = used[:: max(1, -(-len(used) // MOST_ROWS))]
        own = data.rows[number][self.rows]
        self.regressor, self.torque = own[:, :-1], own[:, -1]
        self.viscous, self.coulomb = (_place(data.model, number, kind) for kind in ("viscous", "coulomb"))
        place = self.coulomb
        rest = self.regressor if place is None else np.delete(self.regressor, place, axis=1)
        self.rest = _orthonormal(rest)
        self.sign = np.zeros((len(own), 0)) if place is None else _scaled(self.regressor[:, [place]])[0]
        self.laws: list[_Trial] = []
        self.folds = _stretches(len(own), FOLDS)
        self.moves = self.rest.shape[1] + self.sign.shape[1] > 0 and len(own) > 2 * MOST_BLOCKS
        self.independent = 0.0  # rows, as the best law left them
        self._kept: dict[str, tuple[_Trial | None, tuple[_Trial, ...]]] = {}
        self._known: dict[tuple[_Trial, ...], tuple[Array, Array]] = {}
        self._bases: dict[tuple[object, ...], Array] = {}
        self._states: dict[str, list[tuple[Array, Array]]] = {}

    @property
    def tells(self) -> bool:
        """Whether there are independent rows enough to tell anything of the friction."""
        return self.moves and self.independent - self.rest.shape[1] >= FREE

    def _matrix(self, laws: Sequence[_Trial], keep_sign: bool = False) -> Array:
        replaced = any(law.candidate.replaces for law in laws) and not keep_sign
        sign = self.sign[:, :0] if replaced else self.sign
        return np.hstack([self.rest, sign, *(law.columns for law in laws)])

    def _basis(self, laws: Sequence[_Trial], keep_sign: bool = False) -> Array:
        """An orthonormal basis of what the model and some laws explain."""
        key = (keep_sign, *laws)
        if key not in self._bases:
            matrix = self._matrix(laws, keep_sign)[:, self.rest.shape[1] :]
            self._bases[key] = _with_columns(self.rest, matrix)
        return self._bases[key]

    @staticmethod
    def _nonnegative(laws: Sequence[_Trial], count: int) -> NDArray[np.bool_]:
        flags = [flag for law in laws for flag in law.candidate.nonnegative]
        found = np.zeros(count, dtype=bool)
        if flags:
            found[-len(flags) :] = flags
        return found

    def _columns(self, candidate: FrictionCandidate, shapes: Sequence[Shape]) -> list[tuple[Array, Array]]:
        """Columns of length one at the rows that are used, and their lengths."""
        found = candidate.columns(self.motion, shapes)
        return [_scaled(columns[self.rows]) for columns in found]

    def _first_columns(self, candidate: FrictionCandidate, shapes: Sequence[Shape]) -> list[tuple[Array, Array]]:
        if not candidate.has_state:
            return self._columns(candidate, shapes)
        if candidate.kind not in self._states:  # of which to integrate the states takes most of the time
            self._states[candidate.kind] = self._columns(candidate, shapes)
        return self._states[candidate.kind]

    def tried(self, candidate: FrictionCandidate) -> _Trial | None:
        """Try a law beside those that were added, with the shape that explains most; None where nothing is told."""
        kept = self._kept.get(candidate.kind)
        if kept is None or kept[1] != tuple(self.laws):
            kept = self._kept[candidate.kind] = (self._tried(candidate), tuple(self.laws))
        return kept[0]

    def _tried(self, candidate: FrictionCandidate) -> _Trial | None:
        if not self.moves or any(law.candidate.changes == candidate.changes != "" for law in self.laws):
            return None
        shapes = candidate.shapes(self.motion)
        if not shapes or (candidate.replaces and not self.sign.shape[1]):
            return None
        # What takes the place of a term explains what the term does, too.
        without = self._basis(self.laws)
        basis = self.rest if candidate.replaces else without
        if candidate.replaces:
            for law in self.laws:
                basis = _with_columns(basis, law.columns)
        left = self.torque - basis @ (basis.T @ self.torque)
        found = [
            _explained(basis, left, columns, candidate.nonnegative)
            for columns, _ in self._first_columns(candidate, shapes)
        ]
        best, most = shapes[int(np.argmax(found))], max(found)
        if not most > 0.0:
            return None
        if len(candidate.shape_names) < MANY_SHAPES:
            best = self._polished(candidate, best, shapes, basis, left, SWEEPS - 1)
        elif most > PROMISING * self._most(candidate):
            # From the best with each value of the last shape: in between, others are local optima.
            pairs = list(zip(found, shapes, strict=True))
            starts = [max(pair for pair in pairs if pair[1][-1] == v)[1] for v in {one[-1]: None for one in shapes}]
            best, most = max(
                (self._searched(candidate, start, shapes, basis, left) for start in starts), key=lambda one: one[1]
            )
        ((columns, lengths),) = self._columns(candidate, [best])
        before = self._held_out(self.laws)
        trial = _Trial(self, candidate, best, columns, lengths, 1.0, before, before, explained=most)
        if self._dissipates([*self.laws, trial]) or self._is_passive_undamped([*self.laws, trial]):
            trial.losses = self._held_out([*self.laws, trial])
            trial.p_value = min(1.0, len(shapes) * self._p_value(trial))
        return trial

    def _p_value(self, trial: _Trial) -> float:
        """Of the law's coefficients being zero, by the variance of its scores over blocks of neighbouring rows."""
        from scipy.special import fdtrc

        without = self._basis(self.laws, keep_sign=True)
        columns = trial.columns - without @ (without.T @ trial.columns)
        lengths = np.linalg.norm(columns, axis=0)
        columns = columns[:, lengths > 1e-6]
        count = columns.shape[1]
        if not count:
            return 1.0
        target = self.torque - without @ (without.T @ self.torque)
        coefficients = np.linalg.lstsq(columns, target, rcond=1e-10)[0]
        left = target - columns @ coefficients
        independent = len(left) / max(_correlation_length(left), self.data.memory)
        self.independent = max(self.independent, independent)
        free = independent - without.shape[1] - count
        if free < FREE:
            return 1.0
        blocks = int(np.clip(independent / INDEPENDENT, FEWEST_BLOCKS, MOST_BLOCKS))
        scores = np.array([columns[part].T @ left[part] for part in _stretches(len(left), blocks)])
        # Parameters that were fitted make the residuals smaller than the noise.
        middle = scores.T @ scores * blocks / (blocks - 1) * independent / free
        normal = columns.T @ columns
        covariance = np.linalg.solve(normal, np.linalg.solve(normal, middle).T)
        statistic = float(coefficients @ np.linalg.lstsq(covariance, coefficients, rcond=1e-12)[0]) / count
        statistic *= (blocks - count) / (blocks - 1)
        return float(fdtrc(count, blocks - count, max(statistic, 0.0)))

    def _grams(self, laws: Sequence[_Trial]) -> Array:
        """The Gram matrix of columns of the model, of laws, and the torque, of each stretch, (folds, m + 1, m + 1)."""
        known = tuple(laws[:-1])
        if not laws or known not in self._known:
            matrix = np.column_stack([self._matrix(known), self.torque])
            self._known = {known: (matrix, np.array([matrix[part].T @ matrix[part] for part in self.folds]))}
        if not laws:
            return np.asarray(self._known[known][1])
        matrix, grams = self._known[known]
        columns, size = laws[-1].columns, matrix.shape[1] - 1
        width = columns.shape[1]
        result: Array = np.empty((len(grams), size + width + 1, size + width + 1))
        old = [*range(size), size + width]
        for place, part in enumerate(self.folds):
            result[place][np.ix_(old, old)] = grams[place]
            cross = matrix[part].T @ columns[part]
            result[place][old, size : size + width] = cross
            result[place][size : size + width, old] = cross.T
            result[place][size : size + width, size : size + width] = columns[part].T @ columns[part]
        if laws[-1].candidate.replaces:  # the columns of the model are those of all its terms here
            place = self.rest.shape[1]
            kept = [k for k in range(result.shape[1]) if not place <= k < place + self.sign.shape[1]]
            result = result[np.ix_(range(len(result)), kept, kept)]
        return np.asarray(result)

    def _held_out(self, laws: Sequence[_Trial]) -> Array:
        """Squared residuals of each stretch, of the fit of the others."""
        grams = self._grams(laws)
        found = _solved(grams.sum(axis=0) - grams, self._nonnegative(laws, grams.shape[1] - 1))
        errors = np.concatenate([found, np.full((len(found), 1), -1.0)], axis=1)
        return np.asarray(np.maximum(np.einsum("fi,fij,fj->f", errors, grams, errors), 0.0))

    def error(self, laws: Sequence[_Trial]) -> float:
        """Root mean square on stretches that are left out."""
        if not len(self.torque):
            return float("nan")
        return float(np.sqrt(self._held_out(laws).sum() / len(self.torque)))

    def _coefficients(self, laws: Sequence[_Trial]) -> tuple[float, float, list[Array]]:
        """Viscous and Coulomb friction, and the coefficients of each law."""
        matrix = self._matrix(laws)
        rows = np.column_stack([matrix, self.torque])
        found = _solved(rows.T @ rows, self._nonnegative(laws, matrix.shape[1]))
        width = sum(law.columns.shape[1] for law in laws)
        ends = np.cumsum([law.columns.shape[1] for law in laws])[:-1]
        of_laws = np.split(found[len(found) - width :], ends) if laws else []
        # What the laws leave is told by what the model has, one column for each of its parameters.
        left = self.torque - matrix[:, matrix.shape[1] - width :] @ found[len(found) - width :]
        scaled, lengths = _scaled(self.regressor)
        own = np.linalg.lstsq(scaled, left, rcond=1e-9)[0] / lengths
        replaced = any(law.candidate.replaces for law in laws)
        return (
            0.0 if self.viscous is None else float(own[self.viscous]),
            0.0 if self.coulomb is None or replaced else float(own[self.coulomb]),
            [own / law.lengths for law, own in zip(laws, of_laws, strict=True)],
        )

    def _dissipates(self, laws: Sequence[_Trial]) -> bool:
        """Whether the friction of the joint brakes it at all speeds of the motion, both ways."""
        if self.viscous is None:
            return True
        viscous, coulomb, of_laws = self._coefficients(laws)
        fastest = self.motion.speed
        speeds = np.concatenate([np.linspace(-fastest, 0.0, 50)[:-1], np.linspace(0.0, fastest, 50)[1:]])
        motion = JointMotion(np.zeros_like(speeds), speeds, np.zeros_like(speeds), ())
        torque = viscous * speeds + coulomb * np.sign(speeds)
        for law, own in zip(laws, of_laws, strict=True):
            if law.candidate.kind == "lugre" and not lugre_is_passive(own[1], viscous, law.shape[1]):
                return False
            if law.candidate.has_state:
                torque = torque + own[0] * np.sign(speeds)
            elif law.candidate.is_friction:
                torque = torque + law.candidate.columns(motion, [law.shape])[0] @ own
        braking = torque * np.sign(speeds)
        return bool(braking.min() >= -DRIVING * np.abs(braking).max())

    def _is_passive_undamped(self, laws: Sequence[_Trial]) -> bool:
        """Leave the damping of the bristles out of the last law, LuGre's, and tell whether friction dissipates so."""
        if laws[-1].candidate.kind != "lugre":
            return False
        laws[-1].columns[:, 1] = 0.0
        return self._dissipates(laws)

    def add(self, trial: _Trial) -> None:
        self.laws.append(trial)

    def remove(self, trial: _Trial) -> None:
        self.laws.remove(trial)

    def needs(self, trial: _Trial, least_gain: float) -> bool:
        """Whether the error rises where a law is left out, with the others in place."""
        if len(self.laws) < 2:
            return True
        trial.before = self._held_out([law for law in self.laws if law is not trial])
        trial.losses = self._held_out(self.laws)
        return trial.gain > least_gain and trial.is_sure

    def refine(self) -> None:
        """Search the shapes of the laws that were added, with all of them in place."""
        for law in self.laws:
            basis = self.rest if law.candidate.replaces else _with_columns(self.rest, self.sign)
            for other in self.laws:
                if other is not law:
                    basis = _with_columns(basis, other.columns)
            left = self.torque - basis @ (basis.T @ self.torque)
            shapes = law.candidate.shapes(self.motion)
            if len(law.candidate.shape_names) < MANY_SHAPES:
                law.shape = self._polished(law.candidate, law.shape, shapes, basis, left, SWEEPS)
            else:
                law.shape, _ = self._searched(law.candidate, law.shape, shapes, basis, left)
            ((law.columns, law.lengths),) = self._columns(law.candidate, [law.shape])
            if law.candidate.kind == "lugre" and not self._dissipates(self.laws):
                law.columns[:, 1] = 0.0
        self._known, self._bases, self._kept = {}, {}, {}

    def _most(self, candidate: FrictionCandidate) -> float:
        """What the best of the laws that were tried before explains, beside those that were added."""
        known = [trial for trial, laws in self._kept.values() if trial is not None and laws == tuple(self.laws)]
        own = [one.explained for one in known if one.candidate is not candidate]
        return max(own, default=0.0)

    def _searched(
        self, candidate: FrictionCandidate, shape: Shape, shapes: Sequence[Shape], basis: Array, left: Array
    ) -> tuple[Shape, float]:
        """Search several shapes together, from one of those that were tried, and what they explain (Nelder, Mead)."""
        from scipy.optimize import minimize

        tried = np.log(np.array(shapes))
        reach = 2.0 * np.log(REACH)
        bounds = np.column_stack([tried.min(axis=0) - reach, tried.max(axis=0) + reach])
        start = np.clip(np.log(np.array(shape)), *bounds.T)

        def cost(logarithms: Array) -> float:
            ((columns, _),) = self._columns(candidate, [tuple(float(one) for one in np.exp(logarithms))])
            return -_explained(basis, left, columns, candidate.nonnegative)

        found = minimize(
            cost,
            start,
            method="Nelder-Mead",
            bounds=list(bounds),
            options={
                "initial_simplex": np.clip(np.vstack([start, start + 0.4 * np.eye(len(start))]), *bounds.T),
                "xatol": 2e-3,
                "fatol": 1e-6 * float(left @ left),
                "maxfev": 100,
            },
        )
        return tuple(float(one) for one in np.exp(found.x)), -float(found.fun)

    def _polished(
        self,
        candidate: FrictionCandidate,
        shape: Shape,
        shapes: Sequence[Shape],
        basis: Array,
        left: Array,
        sweeps: int,
    ) -> Shape:
        """Move a shape to where it explains most: parabolas in the logarithm of each of its numbers in turn."""
        fixed = {name for name, _ in candidate.steps}
        free = [k for k, name in enumerate(candidate.shape_names) if name not in fixed]
        tried = np.log(np.array([[one[k] for k in free] for one in shapes]).reshape(len(shapes), len(free)))
        here = np.log(np.array(shape)) if shape else np.zeros(0)

        def explained(logarithms: Array) -> float:
            ((columns, _),) = self._columns(candidate, [tuple(float(one) for one in np.exp(logarithms))])
            return _explained(basis, left, columns, candidate.nonnegative)

        most = explained(here) if free else 0.0
        steps = [_spacing(tried[:, column], here[k]) / 2.0 for column, k in enumerate(free)]
        for _ in range(sweeps):
            for column, k in enumerate(free):
                ends = [here.copy(), here.copy()]
                ends[0][k] -= steps[column]
                ends[1][k] += steps[column]
                below, above = explained(ends[0]), explained(ends[1])
                curvature = below - 2.0 * most + above
                vertex = here.copy()
                if curvature < 0.0:
                    vertex[k] += np.clip(0.5 * (below - above) / curvature, -2.0, 2.0) * steps[column]
                reach = np.log(REACH)
                vertex[k] = np.clip(vertex[k], tried[:, column].min() - reach, tried[:, column].max() + reach)
                for place, value in ((ends[0], below), (ends[1], above), (vertex, explained(vertex))):
                    if value > most:
                        here, most = place, value
                steps[column] /= 2.0
        return tuple(float(one) for one in np.exp(here))

    def chosen(self, number: int) -> list[ChosenFriction]:
        """The laws that were added, with their coefficients."""
        _, _, of_laws = self._coefficients(self.laws)
        return [
            ChosenFriction(
                number,
                law.candidate.kind,
                dict(zip(law.candidate.shape_names, law.shape, strict=True)),
                tuple(map(float, own)),
                law.corrected,
                law.gain,
            )
            for law, own in zip(self.laws, of_laws, strict=True)
        ]


def _place(model: Model, joint: int, kind: str) -> int | None:
    """Where the column of a term of one parameter stands among the base parameters of a joint; None where it is not."""
    for term in model.robot.terms:
        if term.kind == kind:
            name = f"{term.parameters[0].symbol}{joint + 1}"
            expressions = model.base_parameters().expressions
            own = [expressions[column] for column in model.base_columns.joints[joint]]
            return own.index(name) if name in own else None
    return None


def _stretches(count: int, parts: int) -> list[slice]:
    ends = np.linspace(0, count, parts + 1).astype(int)
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def _scaled(columns: Array) -> tuple[Array, Array]:
    lengths = np.linalg.norm(columns, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    return columns / lengths, lengths


def _orthonormal(matrix: Array) -> Array:
    """An orthonormal basis of the columns, without those that hardly differ from others."""
    scaled, _ = _scaled(matrix)
    if not scaled.shape[1]:
        return scaled
    vectors, values, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(vectors[:, values > 1e-6 * values[0]])


def _with_column(basis: Array, column: Array) -> Array:
    """An orthonormal basis with one more column, unless it hardly differs from what is there."""
    length = float(np.linalg.norm(column))
    for _ in range(2):
        column = column - basis @ (basis.T @ column)
    beyond = float(np.linalg.norm(column))
    return np.column_stack([basis, column / beyond]) if beyond > 1e-6 * length else basis


def _with_columns(basis: Array, columns: Array) -> Array:
    for column in columns.T:
        basis = _with_column(basis, column)
    return basis


def _spacing(values: Array, here: float) -> float:
    """How far the nearest other of some values is."""
    others = np.abs(np.unique(values.round(12)) - here)
    others = others[others > 1e-9]
    return float(others.min()) if len(others) else 0.1


def _explained(basis: Array, left: Array, columns: Array, nonnegative: Sequence[bool]) -> float:
    """What columns explain of the squared residual, with coefficients of the right sign."""
    beyond = columns - basis @ (basis.T @ columns)
    if np.any(np.linalg.norm(beyond, axis=0) < 1e-5):
        return 0.0
    flags = np.array(nonnegative)
    gram, target = beyond.T @ beyond, beyond.T @ left
    rows = np.zeros((len(target) + 1, len(target) + 1))
    rows[:-1, :-1], rows[:-1, -1], rows[-1, :-1] = gram, target, target
    found = _solved(rows, flags)
    return float(2.0 * found @ target - found @ gram @ found)


def _solved(grams: Array, nonnegative: NDArray[np.bool_]) -> Array:
    """Least squares from Gram matrices (..., m + 1, m + 1) of ``[X y]`` with columns of about length one, (..., m).

    Coefficients that would have the wrong sign are zero.
    """
    size = grams.shape[-1] - 1
    stacked = grams.reshape(-1, size + 1, size + 1)
    normal = stacked[:, :size, :size] + RIDGE * np.eye(size)
    found = np.linalg.solve(normal, stacked[:, :size, size:])[..., 0]
    for place in np.flatnonzero(((found < 0.0) & nonnegative).any(axis=1)):
        active = np.ones(size, dtype=bool)
        while True:
            wrong = active & nonnegative & (found[place] < 0.0)
            if not wrong.any():
                break
            active &= ~wrong
            found[place] = 0.0
            kept = np.ix_(active, active)
            found[place, active] = np.linalg.solve(normal[place][kept], stacked[place, :size, size][active])
    return np.asarray(found.reshape(*grams.shape[:-2], size))


def _correlation_length(errors: Array) -> float:
    """Rows to which one independent row corresponds: one and twice the autocorrelations until they vanish."""
    count = len(errors)
    return 1.0 if count < 4 else 1.0 + 2.0 * correlation_sum(errors, count // 2 - 1)
