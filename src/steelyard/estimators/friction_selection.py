"""Selection of friction laws: laws are added joint by joint where the data calls for them, and refused elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise, zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table, text_table
from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.files import tell
from steelyard.once import cached_property
from steelyard.recording import Samples
from steelyard.regression.coloured_noise import correlation_sum, stretches_of
from steelyard.regression.parameter_covariance import NORMAL
from steelyard.regression.reduction import joint_rows, require_joints

from .friction_candidates import CANDIDATES, FrictionCandidate, JointMotion, Shape, lugre_is_passive
from .friction_numbers import MovableLaw, NumberedJoint, WhiteRows, numbers_together

__all__ = ["ChosenFriction", "FrictionData", "FrictionSelection", "FrictionTrial", "select_friction"]

Array = NDArray[np.float64]

SIGNIFICANCE = 0.002
"""Probability with which any law is added to a robot that has none of them, after Holm's correction. Laws that robots
have are at 1e-5 and below, and a test by forty blocks is not exact."""
LIKELY = 0.05
"""The level of significance at a joint, before any correction, of a law that was found at another joint."""
LEAST_GAIN = 0.02
"""Part by which the error of a joint on stretches that are left out must fall. Speeds from noisy encoders make a law
significant that explains less."""
NEGLIGIBLE = 2e-4
"""Part of the torque of a joint below which an error counts as this much. Torques without noise are explained to 1e-5,
which rounding and `RIDGE` decide, and springs with a stiffness of zero were added to a simulated arm."""
FOLDS = 8
"""Contiguous stretches that are left out in turn."""
SURE = 2.0
"""Standard errors by which a law must lower the logarithm of the error, each stretch counted alike. By squared errors a
few stretches with large ones outvote the others: on a real UR10 laws that lower these for sure raised the error of a
joint on further stretches by 18 and 40 %, and one that lowers all errors but two to a third was refused."""
MOST_BLOCKS, FEWEST_BLOCKS = 40, 16
"""Contiguous blocks that are left out, one after the other, to tell the standard error of a law."""
INDEPENDENT = 2.0
"""Independent rows, in the sense of the correlation of the residuals, that a block has at least."""
FREE = 16.0
"""Independent rows beyond the number of parameters below which a joint tells nothing of its friction."""
MOST_ROWS = 8_000
"""Rows of a joint by which laws are chosen: more tell shapes no better than the laws hold."""
MOST_NUMBERED = 40_000
"""Rows by which their numbers are found, and laws that are nearly alike told apart."""
DRIVING = 0.02
"""Part of the largest friction of a joint by which a law may drive it at some speed: noise moves Coulomb friction."""
RIDGE = 1e-10
"""Added to the squared lengths of columns, so that what a stretch does not show has a value."""
REACH = 1.4
"""Factor by which a shape may go beyond those that were tried first; its square in the search of one law alone."""
MANY_SHAPES, PROMISING = 3, 0.7
"""Numbers of a law's shape from which on the search begins at several shapes, and only where the best that was tried
first explains this part of what the best other law does."""
HOPEFUL = 0.01
"""Part of the squared residual that the best shape that was tried first explains at least where others are searched:
the error would fall by half of it."""
STARTS, STEPS = 2, 12
"""Shapes from which a search of so many numbers begins, with another last one each, since in between there are local
optima; and steps of Gauss and Newton that every search takes at most. Four starts found nothing better on 20 robots."""
FORGOTTEN = 0.25
"""Part of its range that a joint moves before rows of a log are used for laws with a state: what they
remember at the first row is not known. It is forgotten by the exponential of this over the presliding displacement.
With rows from the first on, the wrong first state cost as much as all the noise does."""
MOST_LAWS = 4
"""Laws that are added at most, one after the other."""
MOST_RISE = 1.05
"""Factor by which numbers that all joints tell together may raise the held-out error of a joint by itself. That error
is of rows that are not whitened: numbers of LuGre's friction that are nearer to the truth raise it by 2 % at times."""


@dataclass(frozen=True, eq=False)
class FrictionData:
    """The rows of the regression of some logs, and the motion from which columns of further laws are computed.

    Attributes
    ----------
    rows : tuple of ndarray
        For each joint ``[W omega]``, (S, c + 1).
    used : ndarray of bool
        (S, N).
    near_rest : ndarray of bool
        (S, N) rows by which numbers of laws with a state are found: with those near rest at which a plain model has
        more friction than the torques show, which such laws explain, where they are given.
    motion : Samples
        Of all the logs, one after the other.
    starts : tuple of int
        Rows of `motion` at which a log begins.
    memory : float
        Rows over which errors are alike at least, since torques were filtered.
    breaks : tuple of int
        Rows that do not follow the row before in time: those of `starts`, and those behind gaps.
    """

    model: Model
    rows: tuple[Array, ...]
    used: NDArray[np.bool_]
    near_rest: NDArray[np.bool_]
    motion: Samples
    starts: tuple[int, ...]
    memory: float = 1.0
    breaks: tuple[int, ...] = (0,)

    @classmethod
    def of(
        cls,
        model: Model,
        samples: Samples | Sequence[Samples],
        memory: float = 1.0,
        near_rest: Samples | Sequence[Samples] | None = None,
    ) -> FrictionData:
        """Take samples as they are, each of them one log; and the same ones with a mask that leaves rows near rest."""
        parts = _logs(model, samples)
        if not parts:
            raise InputError("there are no samples to choose friction by; give at least one Samples.")
        for part in parts:
            require_joints(model, part)
        pieces = [rows for part in parts for _, rows in joint_rows(model, part)]
        starts = np.cumsum([0, *(part.count for part in parts[:-1])])
        breaks = [
            int(start) + stretch.start
            for part, start in zip(parts, starts, strict=True)
            for stretch in stretches_of(part)
        ]
        motion = Samples.joined(parts)
        used = motion.used_rows
        slow = used if near_rest is None else Samples.joined(_logs(model, near_rest)).used_rows
        rows = tuple(np.vstack(own) for own in zip(*pieces, strict=True))
        return cls(model, rows, used, slow, motion, tuple(int(start) for start in starts), memory, tuple(breaks))

    @cached_property
    def loads(self) -> Array:
        """(S, N) torques of the links alone, by least squares."""
        return _loads(self.model, self.motion, self.parameters)

    @cached_property
    def gravity(self) -> Array:
        """(S, N) those of gravity."""
        q, still = self.motion.q, np.zeros_like(self.motion.q)
        return np.asarray(self.model.computed_torque(q, still, still, self.parameters))

    @cached_property
    def parameters(self) -> Array:
        """Parameters of the model whose torques are those of least squares; they need not be those of bodies."""
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
        return np.asarray(base.Pb @ found)

    def joint_motion(self, joint: int) -> JointMotion:
        """The motion of one joint."""
        m = self.motion
        logged = {name: values[:, joint] for name, values in (m.channels or {}).items()}
        own = (m.q[:, joint], m.dq[:, joint], self.loads[:, joint])
        return JointMotion(*own, self.starts, self.gravity[:, joint], logged)


def _logs(model: Model, samples: Samples | Sequence[Samples]) -> list[Samples]:
    parts = [samples] if isinstance(samples, Samples) else list(samples)
    return [part.with_presliding(model) for part in parts]


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
        That it is not there, for correlated residuals: after Holm's correction, and without it where the law is there
        for sure at another joint.
    gain : float
        Part by which it lowers the error of the joint on stretches that are left out.
    beside : tuple of float
        Viscous and Coulomb friction of the joint beside its laws.
    shape_errors, coefficient_errors
        Standard errors of `shape` and `coefficients`, by all joints together with noise that lasts; infinite where
        they are not known, since all joints together tell numbers that no friction has.
    """

    joint: int
    kind: str
    shape: dict[str, float]
    coefficients: tuple[float, ...]
    p_value: float
    gain: float
    beside: tuple[float, float] = (0.0, 0.0)
    shape_errors: dict[str, float] = field(default_factory=dict)
    coefficient_errors: tuple[float, ...] = ()

    def errors_to_dict(self) -> dict[str, Any]:
        """Return the standard errors as plain data, None where they are not known."""
        return {
            "shape_errors": {name: _known(error) for name, error in self.shape_errors.items()},
            "coefficient_errors": [_known(error) for error in self.coefficient_errors],
        }

    @property
    def uncertainty(self) -> float:
        """The largest standard error of its numbers, relative; of a ripple relative to its amplitude."""
        sizes = np.abs(self.coefficients)
        if self.kind == "cogging":
            sizes = np.full(len(sizes), np.linalg.norm(sizes))
        pairs = [(error, self.shape[name]) for name, error in self.shape_errors.items()]
        pairs += list(zip(self.coefficient_errors, map(float, sizes), strict=True))
        # A coefficient of zero is one that was left out, as the damping of bristles.
        return max((error / abs(value) for error, value in pairs if value), default=0.0)


@dataclass(frozen=True)
class FrictionTrial:
    """The result of trying one law at all the joints.

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
    """The laws of friction that were added to a model, and the results of those that were tried in vain.

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

    def with_laws(self, kept: Sequence[ChosenFriction]) -> FrictionSelection:
        """Return the selection with some of its laws, the others taken back.

        Errors of joints that lose laws become those without any.
        """
        joints = {one.joint for one in kept}
        errors = [self.errors[k] if k in joints else self.plain_errors[k] for k in range(len(self.joint_names))]
        return replace(self, chosen=tuple(kept), trials=_taken_back(self.trials, kept), errors=np.array(errors))

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

    def chosen_table(
        self, laws: Sequence[ChosenFriction] | None = None
    ) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Heads and rows of the table of laws that were added, or of other laws at the same joints.

        Numbers stand with half of their interval of 95 %, where that is known.
        """
        rows: list[tuple[str, ...]] = [
            (
                self.joint_names[one.joint],
                one.kind,
                ", ".join(
                    f"{name} {_with_interval(value, one.shape_errors.get(name, 0.0))}"
                    for name, value in one.shape.items()
                )
                or "-",
                ", ".join(
                    _with_interval(value, error)
                    for value, error in zip_longest(one.coefficients, one.coefficient_errors, fillvalue=0.0)
                ),
                f"{-one.gain:+.1%}",
                f"{one.p_value:.1g}" if one.p_value > 1e-99 else "0",
            )
            for one in (self.chosen if laws is None else laws)
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
                    **one.errors_to_dict(),
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


@in_one_thread
def select_friction(
    model: Model,
    samples: Samples | Sequence[Samples] | FrictionData,
    *,
    candidates: Sequence[FrictionCandidate] = CANDIDATES,
) -> FrictionSelection:
    """Choose which laws of friction are added to those of a model, joint by joint.

    The rows of each joint are regressed by themselves: what the model has is eliminated once, and a law is tried by
    what its columns explain of the rest, so that its shapes (velocities, exponents, harmonics) are searched at little
    cost (variable projection). One law at a time is added, at all the joints at once where

    - it is significant: the test leaves out contiguous blocks in turn (a jackknife), so that it holds where residuals
      are correlated in time, counts every shape that was tried, and is corrected for the number of joints and laws
      (Holm);
    - the error on contiguous stretches that are left out in turn falls by 2 %, and its logarithm by more than
      two standard errors, so that it falls on most stretches and not on a few only;
    - and its velocities, displacements and harmonics are within those that are tried: one at their end says that
      another law is meant, or that a few rows decide.

    Of several the one that lowers this error most is taken, unless beside a simpler one it lowers it by less than that;
    of equally simple ones that are so near, the one of the greatest likelihood with noise that lasts. A law that is
    there for sure at one joint is added at others where it is likely (5 %, uncorrected) and lowers the error by 4 %.
    Laws with a state are judged by the rows at which it is known, and so is what they are compared with;
    they are added only where no other law lowers the error of the joint more. In the end each law is taken back that
    the others make needless, and the numbers of the others are found by all joints together, with the rows of each made
    white (`numbers_together`).

    Parameters
    ----------
    model : Model
        With the terms that are there in any case, such as viscous and Coulomb friction.
    samples : Samples, sequence of Samples or FrictionData
        Each Samples one log, with its rows in the order of time.
    candidates : sequence of FrictionCandidate
        Simple ones first.

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
    # What a law with a state says of the first rows is not known: it is judged by the others, and so are its rivals.
    moved = [_Joint(data, k, forgets=True) for k in range(model.dof)] if any(c.has_state for c in candidates) else []
    names = tuple(model.robot.joint_names)
    trials: list[FrictionTrial] = []
    accepted: list[str] = []
    for step in range(MOST_LAWS):
        tell("laws of friction that are tried", step, MOST_LAWS, "steps")
        left = [one for one in candidates if one.kind not in accepted]
        told = _judged(left, joints, moved)
        best = _best_of(told, moved)
        for one in sorted(told, key=lambda one: (one is not best, -one.total)):
            trials.append(one.trial(step, names, one is best))
        if best is None:
            break
        accepted.append(best.candidate.kind)
        for trial in best.taken:
            k = trial.joint.number
            if trial.candidate.has_state:
                joints[k] = moved[k]
            elif moved and joints[k] is not moved[k]:
                moved[k].laws.append(moved[k].likewise(trial))
            trial.joint.laws.append(trial)
    for joint in joints:
        for trial in tuple(joint.laws):
            if not joint.needs(trial):
                joint.laws.remove(trial)
    for joint in joints:
        joint.refine()
    _number_together(model, joints)
    chosen = [one for k, joint in enumerate(joints) for one in joint.chosen(k)]
    remarks = []
    silent = [name for name, joint in zip(names, joints, strict=True) if not joint.tells]
    if silent:
        remarks.append(
            f"The friction of {', '.join(silent)} cannot be found: it stands still, the log is too short, or its "
            "torques are filtered too much."
        )
        if not chosen and len(silent) < len(names):
            remarks.append("At the other joints none of the laws that were tried makes the model significantly better.")
    return FrictionSelection(
        names,
        tuple(sorted(chosen, key=lambda one: one.joint)),
        _taken_back(trials, chosen),
        np.array([joint.error(joint.laws) for joint in joints]),
        np.array([joint.error([]) for joint in joints]),
        tuple(remarks),
    )


def _taken_back(trials: Sequence[FrictionTrial], kept: Sequence[ChosenFriction]) -> tuple[FrictionTrial, ...]:
    """Return trials of which those that were chosen, and are not kept at any joint, are taken back."""
    kinds = {one.kind for one in kept}
    return tuple(
        replace(one, verdict="taken back") if one.verdict == "chosen" and one.kind not in kinds else one
        for one in trials
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
    by_another: bool = False  # likely at this joint, and there for sure at another one

    @property
    def gain(self) -> float:
        """Part by which the held-out error of the joint falls."""
        least = NEGLIGIBLE**2 * float(self.joint.torque @ self.joint.torque)
        before, after = (max(float(losses.sum()), least) for losses in (self.before, self.losses))
        return 1.0 - float(np.sqrt(after / before)) if before > 0.0 else 0.0

    @property
    def speaks_for_itself(self) -> bool:
        """Whether the law is likely at this joint alone; by the held-out error where the log is short for the test."""
        if self.joint.tells:
            return self.p_value < LIKELY
        falls = self.before - self.losses
        return bool(float(falls.sum()) > 2.0 * np.sqrt(len(falls)) * float(falls.std(ddof=1)))

    @property
    def is_sure(self) -> bool:
        """Whether the held-out error falls, and on most stretches."""
        return falls_surely(self.before, self.losses)


def _judged(candidates: Sequence[FrictionCandidate], joints: Sequence[_Joint], moved: Sequence[_Joint]) -> list[_Told]:
    """Try laws at all the joints: by all rows, and those with a state by the rows at which it is known."""
    tried = [
        (candidate, [joint.tried(candidate) for joint in (moved if candidate.has_state else joints)])
        for candidate in candidates
    ]
    _correct([trial for _, of_joints in tried for trial in of_joints if trial is not None])
    return [_Told(candidate, of_joints) for candidate, of_joints in tried]


def _best_of(told: Sequence[_Told], moved: Sequence[_Joint]) -> _Told | None:
    """The best law; one with a state where it is the best by the rows at which its state is known.

    It leaves those joints to other laws at which they gain more: what gains little there would hide them, since two
    laws that change the same friction exclude each other.
    """
    plain = [one for one in told if not one.candidate.has_state]
    with_state = [one for one in told if one.candidate.has_state and one.taken]
    if with_state:
        rivals = [one.by_rows_of(moved) for one in plain]
        for one in with_state:
            one.leave([trial for rival in rivals for trial in rival.taken])
        best = _best([*rivals, *with_state])
        if best in with_state:
            return best
    return _best(plain)


class _Told:
    """A law over all the joints."""

    def __init__(self, candidate: FrictionCandidate, trials: Sequence[_Trial | None]) -> None:
        self.candidate = candidate
        self.trials = [trial for trial in trials if trial is not None]
        self.taken = [
            one for one in self.trials if one.corrected < SIGNIFICANCE and one.gain > LEAST_GAIN and one.is_sure
        ]
        if self.taken:
            # A law that is there for sure at one joint needs no such proof at the others.
            for one in self.trials:
                if one not in self.taken and one.gain > 2.0 * LEAST_GAIN and one.is_sure and one.speaks_for_itself:
                    one.by_another = True
            self.taken = [one for one in self.trials if one in self.taken or one.by_another]

    @property
    def falls(self) -> Array:
        """(folds,) by how much the errors fall; by logarithms, so that joints with large torques count as others do."""
        return sum((_fall(one) for one in self.taken), np.zeros(FOLDS))

    @property
    def total(self) -> float:
        return float(self.falls.sum())

    def by_rows_of(self, joints: Sequence[_Joint]) -> _Told:
        """Return the law as other rows of the joints where it would be added tell what it gains."""
        other = copy(self)
        tried = [joints[one.joint.number].tried(self.candidate) for one in self.taken]
        other.trials = other.taken = [one for one in tried if one is not None]
        return other

    def leave(self, rivals: Sequence[_Trial]) -> None:
        """Leave the joints to others, at which any of them gains more."""
        self.taken = [
            one for one in self.taken if all(one.joint is not rival.joint or one.gain > rival.gain for rival in rivals)
        ]

    def trial(self, step: int, names: Sequence[str], is_best: bool) -> FrictionTrial:
        best = self.taken or sorted(self.trials, key=lambda one: -one.gain)[:1]
        before = sum(float(np.log(max(one.before.sum(), 1e-300))) for one in best)
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


def falls_surely(before: Array, after: Array) -> bool:
    """Return whether squared errors (folds,) on stretches that are left out fall by more than chance lets them.

    Examples
    --------
    One stretch that gains much does not speak for the others:

    >>> falls_surely(np.array([1.0, 1.1, 9.0, 1.0]), np.array([0.5, 0.6, 4.0, 0.6]))
    True
    >>> falls_surely(np.array([1.0, 1.1, 9.0, 1.0]), np.array([1.2, 1.3, 0.5, 1.2]))
    False
    """
    parts = np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300))
    error = np.sqrt(len(parts)) * float(parts.std(ddof=1))
    return bool(after.sum() < before.sum() and float(parts.sum()) > SURE * error)


def _fall(trial: _Trial) -> Array:
    """Return by how much the logarithm of the held-out loss of a joint falls, shared out over the folds."""
    total = float(trial.before.sum())
    share = 1.0 - float(trial.losses.sum()) / total
    whole = -2.0 * np.log(max(1.0 - trial.gain, 1e-12))
    # Both are negative where the loss rises, as it may by rows other than those by which a law was taken.
    scale = whole / share if abs(share) > 1e-12 else 1.0
    return np.asarray((trial.before - trial.losses) / total * scale)


def _best(told: Sequence[_Told]) -> _Told | None:
    """The law that lowers the held-out error most, or a simpler one beside which it does not lower it enough."""
    helpful = [one for one in told if one.taken]
    if not helpful:
        return None
    best = max(helpful, key=lambda one: one.total)
    found, least = best, -2.0 * np.log(1.0 - LEAST_GAIN) * len(best.taken)
    for one in sorted(helpful, key=lambda one: (one.candidate.parameter_count, -one.total)):
        if one.candidate.parameter_count >= best.candidate.parameter_count:
            break
        short = best.falls - one.falls
        if float(short.sum()) <= max(least, np.sqrt(len(short)) * float(short.std(ddof=1))):
            found = one
            break
    alike = [one for one in helpful if one.candidate.parameter_count == found.candidate.parameter_count]
    rivals = [one for one in alike if one.total >= found.total - least]
    return found if len(rivals) == 1 else _likeliest(rivals)


def _likeliest(rivals: Sequence[_Told]) -> _Told:
    """The law of the greatest likelihood with noise that lasts, at the joints where any of some laws would be added.

    Where speeds are mostly slow and noise lasts, a knee and a polynomial leave residuals of nearly the same size; those
    of the wrong law differ in what changes fast.
    """
    joints = list(dict.fromkeys(trial.joint for one in rivals for trial in one.taken))
    lost = np.zeros(len(rivals))
    for joint in joints:
        laws = [[*joint.laws, *(trial for trial in one.trials if trial.joint is joint)] for one in rivals]
        left = [joint.residuals(own) for own in laws]
        sizes = [float(np.linalg.norm(one[joint.grid_used])) for one in left]
        white = joint.white(left[int(np.argmin(sizes))])
        lost += [joint.loss(own, white) for own in laws]
    return rivals[int(np.argmin(lost))]


def _loads(model: Model, motion: Samples, parameters: Array) -> Array:
    """(S, N) torques of the links alone."""
    return np.asarray(model.computed_torque(motion.q, motion.dq, motion.ddq, parameters))


def _number_together(model: Model, joints: Sequence[_Joint]) -> None:
    """Let all joints together tell the numbers of the laws that were added, where that is no worse for any joint."""
    if not any(joint.laws for joint in joints):
        return
    told, base = [joint for joint in joints if joint.moves], model.base_parameters()
    found = numbers_together([joint.numbered() for joint in told], base.count)
    if any(law.candidate.kind == "load" for joint in joints for law in joint.laws):
        # The loads were those of a fit without friction by load, which took a part of it for links.
        loads = _loads(model, joints[0].data.motion, np.asarray(base.Pb @ found.base))
        for joint in joints:
            joint.motion = joint.motion._replace(load=loads[:, joint.number])
        found = numbers_together([joint.numbered() for joint in told], base.count)
    for place, joint in enumerate(told):
        if joint.laws:
            own = found.base[list(model.base_columns.joints[joint.number])]
            joint.take(found.shapes[place], found.coefficients[place], own)
            if joint.told is not None:
                joint.coefficient_errors = found.coefficient_errors[place]
                joint.free_errors = found.free_errors[place]


def _correct(trials: Sequence[_Trial]) -> None:
    """Correct p-values for their number (Holm)."""
    largest = 0.0
    ordered = sorted(trials, key=lambda one: one.p_value)
    for place, trial in enumerate(ordered):
        largest = max(largest, min(1.0, (len(ordered) - place) * trial.p_value))
        trial.corrected = largest


class _Joint:
    """The rows of one joint, with what its model has eliminated."""

    def __init__(self, data: FrictionData, number: int, forgets: bool = False) -> None:
        self.data, self.number = data, number
        self.motion = data.joint_motion(number)
        moved = _moved(self.motion) if forgets else np.ones(len(data.used), dtype=bool)
        used = np.flatnonzero(data.used[:, number] & moved)
        self.rows = used[:: max(1, -(-len(used) // MOST_ROWS))]
        own = data.rows[number][self.rows]
        self.regressor, self.torque = own[:, :-1], own[:, -1]
        # Of rows that follow each other evenly, as noise that lasts is told by.
        every = max(1, -(-len(data.motion.q) // MOST_NUMBERED))
        self.grid = np.arange(0, len(data.motion.q), every)
        self.grid_used = (data.used[:, number] & moved)[self.grid]
        self.grid_near_rest = (data.near_rest[:, number] & moved)[self.grid]
        self.grid_breaks = [-(-one // every) for one in data.breaks]
        self.told: tuple[float, float, list[Array]] | None = None  # by all joints together
        self.coefficient_errors: list[Array] | None = None
        self.free_errors: list[Array] | None = None
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
        self._states: dict[str, list[tuple[Array, Array]]] = {}

    @cached_property
    def _inverse(self) -> Array:
        """What gives the parameters of the model from torques, by least squares."""
        scaled, lengths = _scaled(self.regressor)
        return np.asarray(np.linalg.pinv(scaled, rcond=1e-9) / lengths[:, None])

    @property
    def tells(self) -> bool:
        """Whether there are independent rows enough to tell anything of the friction."""
        return self.moves and self.independent - self.rest.shape[1] >= FREE

    def _matrix(self, laws: Sequence[_Trial], keep_sign: bool = False) -> Array:
        replaced = any(law.candidate.replaces for law in laws) and not keep_sign
        sign = self.sign[:, :0] if replaced else self.sign
        return np.hstack([self.rest, sign, *(law.columns for law in laws)])

    def _basis(self, keep_sign: bool = False) -> Array:
        """An orthonormal basis of what the model and the laws that were added explain."""
        return _with_columns(self.rest, self._matrix(self.laws, keep_sign)[:, self.rest.shape[1] :])

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

    def _grid_regressor(self, laws: Sequence[_Trial]) -> Array:
        own = self.data.rows[self.number][self.grid]
        return (
            own
            if self.coulomb is None or not any(law.candidate.replaces for law in laws)
            else np.delete(own, self.coulomb, axis=1)
        )

    def _grid_columns(self, law: _Trial, shapes: Sequence[Shape]) -> list[Array]:
        columns = [own[self.grid] for own in law.candidate.columns(self.motion, shapes)]
        undamped = ~law.columns.any(axis=0)
        if undamped.any():
            columns = [np.where(undamped, 0.0, own) for own in columns]
        return columns

    def residuals(self, laws: Sequence[_Trial], white: WhiteRows | None = None) -> Array:
        """Return what least squares leave of the torque, at rows that follow each other, whitened or as they are."""
        rows = np.column_stack([*(self._grid_columns(law, [law.shape])[0] for law in laws), self._grid_regressor(laws)])
        if white is not None:
            rows = white.of(rows)
        matrix = _scaled(np.where(self.grid_used[:, None], rows[:, :-1], 0.0))[0]
        basis = _orthonormal(matrix)
        return np.asarray(rows[:, -1] - basis @ (basis.T @ np.where(self.grid_used, rows[:, -1], 0.0)))

    def white(self, left: Array) -> WhiteRows:
        """Return the filter that whitens the rows of a fit, made from its residuals."""
        return WhiteRows(left, self.grid_used, self.grid_breaks)

    def loss(self, laws: Sequence[_Trial], white: WhiteRows) -> float:
        """Minus twice the logarithm of the likelihood of some laws, save a constant."""
        count = int(np.count_nonzero(self.grid_used))
        return count * float(np.log(max(float(np.sum(self.residuals(laws, white) ** 2)), 1e-300)))

    def numbered(self) -> NumberedJoint:
        """The rows of the joint and its laws, for a fit of all joints."""
        if any(law.candidate.has_state for law in self.laws):
            self.grid_used = self.grid_near_rest
        rows = self._grid_regressor(self.laws)
        own = list(self.data.model.base_columns.joints[self.number])
        if rows.shape[1] <= len(own):  # a law takes the place of Coulomb friction
            own = [place for k, place in enumerate(own) if k != self.coulomb]
        laws = []
        for law in self.laws:
            shapes = law.candidate.shapes(self.motion)
            tried = np.array(shapes).reshape(len(shapes), len(law.shape))
            names = law.candidate.shape_names
            free = tuple(names.index(name) for name in law.candidate.free_names)
            lower, upper = tried.min(axis=0) / REACH, tried.max(axis=0) * REACH
            columns = partial(self._grid_columns, law)
            laws.append(MovableLaw(columns, law.shape, free, tuple(lower), tuple(upper)))
        return NumberedJoint(self.white(self.residuals(self.laws)), rows[:, :-1], rows[:, -1], own, tuple(laws))

    def take(self, shapes: Sequence[Shape], coefficients: Sequence[Array], base: Array) -> None:
        """Take numbers that a fit of all joints found, unless its friction is none or the joint's error rises."""
        old, before = [(law.shape, law.columns, law.lengths) for law in self.laws], self.error(self.laws)
        viscous = 0.0 if self.viscous is None else float(base[self.viscous])
        replaced = any(law.candidate.replaces for law in self.laws)
        coulomb = 0.0 if self.coulomb is None or replaced else float(base[self.coulomb])
        flags = [flag for law in self.laws for flag in law.candidate.nonnegative]
        self.told = (viscous, coulomb, list(coefficients))
        for law, shape in zip(self.laws, shapes, strict=True):
            undamped = ~law.columns.any(axis=0)
            law.shape = shape
            ((law.columns, law.lengths),) = self._columns(law.candidate, [shape])
            law.columns[:, undamped] = 0.0
        self._kept = {}
        good = (
            all(value >= 0.0 for value, flag in zip(np.concatenate(coefficients), flags, strict=True) if flag)
            and all(_is_within(law.candidate, law.shape, law.candidate.shapes(self.motion)) for law in self.laws)
            and self._dissipates(self.laws, self.told)
            and self.error(self.laws) <= MOST_RISE * before
        )
        if not good:
            self.told = None
            for law, kept in zip(self.laws, old, strict=True):
                law.shape, law.columns, law.lengths = kept
            self._kept = {}

    def tried(self, candidate: FrictionCandidate) -> _Trial | None:
        """Try a law beside those that were added, with the shape that explains most; None where nothing is told."""
        kept = self._kept.get(candidate.kind)
        if kept is None or kept[1] != tuple(self.laws):
            kept = self._kept[candidate.kind] = (self._tried(candidate), tuple(self.laws))
        return kept[0]

    def _tried(self, candidate: FrictionCandidate) -> _Trial | None:
        if not self.moves or any(set(law.candidate.changes) & set(candidate.changes) for law in self.laws):
            return None
        shapes = candidate.shapes(self.motion)
        if not shapes or (candidate.replaces and not self.sign.shape[1]):
            return None
        # What takes the place of a term explains what the term does, too.
        without = self._basis()
        basis = self.rest if candidate.replaces else without
        if candidate.replaces:
            for law in self.laws:
                basis = _with_columns(basis, law.columns)
        left = self.torque - basis @ (basis.T @ self.torque)
        found = _explained(
            basis, left, [columns for columns, _ in self._first_columns(candidate, shapes)], candidate.nonnegative
        )
        best, most = shapes[int(np.argmax(found))], max(found)
        if not most > 0.0:
            return None
        rest = self.torque - without @ (without.T @ self.torque)
        plain = float(left @ left) - float(rest @ rest)  # what the term explains whose place it takes
        if most - plain < HOPEFUL * float(rest @ rest):
            pass  # no shape will do
        elif len(candidate.shape_names) < MANY_SHAPES:
            best, _ = self._searched(candidate, best, shapes, basis, left)
        elif most - plain > PROMISING * self._most(candidate):
            pairs = list(zip(found, shapes, strict=True))
            starts = [max(pair for pair in pairs if pair[1][-1] == v) for v in {one[-1]: None for one in shapes}]
            starts = sorted(starts, reverse=True)[:STARTS]
            best, most = max(
                (self._searched(candidate, start, shapes, basis, left) for _, start in starts), key=lambda one: one[1]
            )
        ((columns, lengths),) = self._columns(candidate, [best])
        before = self._held_out(self.laws)
        trial = _Trial(self, candidate, best, columns, lengths, 1.0, before, before, explained=most - plain)
        if not _is_within(candidate, best, shapes):
            return trial  # another law is meant, or a few rows at the end of the range of speeds decide
        if self._dissipates([*self.laws, trial]) or self._is_passive_undamped([*self.laws, trial]):
            trial.losses = self._held_out([*self.laws, trial])
            trial.p_value = min(1.0, len(shapes) * self._p_value(trial))
        return trial

    def _p_value(self, trial: _Trial) -> float:
        """Return the p-value of the law's coefficients being zero, by a jackknife over blocks of neighbouring rows.

        Unlike sums of scores over blocks, this jackknife holds where single blocks decide, such as those in which the
        joint is slow.
        """
        from scipy.special import fdtrc

        without = self._basis(keep_sign=True)
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
        rows = np.column_stack([without, columns, self.torque])
        grams = np.array([rows[part].T @ rows[part] for part in _stretches(len(rows), blocks)])
        anywhere = np.zeros(rows.shape[1] - 1, dtype=bool)
        left_out = _solved(grams.sum(axis=0) - grams, anywhere)[:, -count:]
        changes = left_out - left_out.mean(axis=0)
        covariance = changes.T @ changes * (blocks - 1) / blocks
        statistic = float(coefficients @ np.linalg.lstsq(covariance, coefficients, rcond=1e-12)[0]) / count
        statistic *= (blocks - count) / (blocks - 1)
        return float(fdtrc(count, blocks - count, max(statistic, 0.0)))

    def _grams(self, laws: Sequence[_Trial]) -> Array:
        """The Gram matrix of columns of the model, of laws, and the torque, of each stretch, (folds, m + 1, m + 1)."""
        rows = np.column_stack([self._matrix(laws), self.torque])
        return np.array([rows[part].T @ rows[part] for part in self.folds])

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
        own = self._inverse @ left
        replaced = any(law.candidate.replaces for law in laws)
        return (
            0.0 if self.viscous is None else float(own[self.viscous]),
            0.0 if self.coulomb is None or replaced else float(own[self.coulomb]),
            [own / law.lengths for law, own in zip(laws, of_laws, strict=True)],
        )

    def _dissipates(self, laws: Sequence[_Trial], numbers: tuple[float, float, list[Array]] | None = None) -> bool:
        """Return whether the friction of the joint brakes it at all speeds of the motion, both ways."""
        if self.viscous is None:
            return True
        viscous, coulomb, of_laws = self._coefficients(laws) if numbers is None else numbers
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

    def likewise(self, trial: _Trial) -> _Trial:
        """Return a law that was added by other rows of the joint, for these."""
        ((columns, lengths),) = self._columns(trial.candidate, [trial.shape])
        before = self._held_out(self.laws)
        own = replace(trial, joint=self, columns=columns, lengths=lengths, before=before, losses=before)
        own.losses = self._held_out([*self.laws, own])
        return own

    def needs(self, trial: _Trial) -> bool:
        """Return whether the error rises where a law is left out, with the others in place."""
        if len(self.laws) < 2:
            return True
        trial.before = self._held_out([law for law in self.laws if law is not trial])
        trial.losses = self._held_out(self.laws)
        return trial.gain > LEAST_GAIN and trial.is_sure

    def refine(self) -> None:
        """Search the shapes of the laws that were added, with all of them in place."""
        for law in self.laws:
            basis = self.rest if law.candidate.replaces else _with_columns(self.rest, self.sign)
            for other in self.laws:
                if other is not law:
                    basis = _with_columns(basis, other.columns)
            left = self.torque - basis @ (basis.T @ self.torque)
            shapes = law.candidate.shapes(self.motion)
            law.shape, _ = self._searched(law.candidate, law.shape, shapes, basis, left)
            ((law.columns, law.lengths),) = self._columns(law.candidate, [law.shape])
            if law.candidate.kind == "lugre" and not self._dissipates(self.laws):
                law.columns[:, 1] = 0.0
        self._kept = {}

    def _most(self, candidate: FrictionCandidate) -> float:
        """Return what the best of the laws that were tried before explains, beside those that were added."""
        known = [trial for trial, laws in self._kept.values() if trial is not None and laws == tuple(self.laws)]
        own = [one.explained for one in known if one.candidate is not candidate]
        return max(own, default=0.0)

    def _searched(
        self, candidate: FrictionCandidate, shape: Shape, shapes: Sequence[Shape], basis: Array, left: Array
    ) -> tuple[Shape, float]:
        """Search the numbers of a shape together, from one of those that were tried, and what they explain."""
        from scipy.optimize import least_squares

        free = [candidate.shape_names.index(name) for name in candidate.free_names]
        logarithms = np.log([[one[k] for k in free] for one in shapes])
        reach = 2.0 * np.log(REACH)

        def unexplained(moved: Array) -> Array:
            ((columns, _),) = self._columns(candidate, [at(moved)])
            beyond = columns - basis @ (basis.T @ columns)
            rows = np.column_stack([beyond, left])
            return np.asarray(left - beyond @ _solved(rows.T @ rows, np.array(candidate.nonnegative)))

        def at(moved: Array) -> Shape:
            numbers = dict(zip(free, np.exp(moved).tolist(), strict=True))
            return tuple(numbers.get(k, number) for k, number in enumerate(shape))

        if not free:
            return shape, float(left @ left) - float(np.sum(unexplained(np.zeros(0)) ** 2))
        found = least_squares(
            unexplained,
            np.log([shape[k] for k in free]),
            bounds=(logarithms.min(axis=0) - reach, logarithms.max(axis=0) + reach),
            diff_step=np.full(len(free), 1e-3),
            xtol=1e-4,
            ftol=1e-6,
            max_nfev=STEPS,
        )
        return at(found.x), float(left @ left) - 2.0 * float(found.cost)

    def chosen(self, number: int) -> list[ChosenFriction]:
        """The laws that were added, with their coefficients."""
        viscous, coulomb, of_laws = self._coefficients(self.laws) if self.told is None else self.told
        free = [law.candidate.free_names for law in self.laws]
        of_shapes = self.free_errors or [np.full(len(names), np.inf) for names in free]
        of_coefficients = self.coefficient_errors or [np.full(len(own), np.inf) for own in of_laws]
        return [
            ChosenFriction(
                number,
                law.candidate.kind,
                dict(zip(law.candidate.shape_names, law.shape, strict=True)),
                tuple(map(float, own)),
                law.p_value if law.by_another else law.corrected,
                law.gain,
                (viscous, coulomb),
                {
                    name: float(error) * law.shape[law.candidate.shape_names.index(name)]
                    for name, error in zip(*shape, strict=True)
                },
                tuple(map(float, errors)),
            )
            for law, own, shape, errors in zip(
                self.laws, of_laws, zip(free, of_shapes, strict=True), of_coefficients, strict=True
            )
        ]


def _known(error: float) -> float | None:
    return float(error) if np.isfinite(error) else None


def _with_interval(value: float, error: float) -> str:
    return f"{value:.3g} ± {NORMAL * error:.2g}" if 0.0 < error < np.inf else f"{value:.3g}"


def _is_within(candidate: FrictionCandidate, shape: Shape, shapes: Sequence[Shape]) -> bool:
    """Return whether no number of a shape is nearest to the first or the last of those that were tried first."""
    if len(candidate.shape_names) >= MANY_SHAPES:  # of which few values are tried, and the search goes further
        return True
    for k, name in enumerate(candidate.shape_names):
        tried = np.unique([one[k] for one in shapes])
        nearest = int(np.argmin(np.abs(np.log(tried / shape[k]))))
        if name in candidate.free_names and len(tried) > 2 and nearest in (0, len(tried) - 1):
            return False
    return True


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
    lengths = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    return columns / lengths, lengths


def _orthonormal(matrix: Array) -> Array:
    """An orthonormal basis of the columns, without those that hardly differ from others."""
    scaled, _ = _scaled(matrix)
    if not scaled.size:
        return scaled[:, :0]
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


def _explained(basis: Array, left: Array, columns: Sequence[Array], nonnegative: Sequence[bool]) -> list[float]:
    """What the columns of each of some shapes explain of the squared residual, with coefficients of the right sign."""
    flags, width = np.array(nonnegative), len(nonnegative)
    beside = np.hstack(list(columns))
    inside, targets = basis.T @ beside, left @ beside
    found = []
    for place, own in enumerate(columns):
        part = slice(place * width, (place + 1) * width)
        gram = own.T @ own - inside[:, part].T @ inside[:, part]
        target = targets[part]
        if np.any(np.diag(gram) < 1e-10):  # of columns of length one
            found.append(0.0)
            continue
        rows = np.zeros((width + 1, width + 1))
        rows[:-1, :-1], rows[:-1, -1], rows[-1, :-1] = gram, target, target
        solved = _solved(rows, flags)
        found.append(float(2.0 * solved @ target - solved @ gram @ solved))
    return found


def _moved(motion: JointMotion) -> NDArray[np.bool_]:
    """Rows from where on a joint has moved so far that what it remembers of before its log does not count."""
    path = np.cumsum(np.abs(np.diff(motion.q, prepend=motion.q[:1])))
    starts = list(motion.starts)
    begun = path[starts][np.searchsorted(starts, np.arange(len(path)), side="right") - 1]
    return np.asarray(path - begun >= FORGOTTEN * np.ptp(motion.q)) if len(path) else np.ones(0, dtype=bool)


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
