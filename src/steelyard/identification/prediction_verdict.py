"""The second verdict: does the model predict torques that it has not seen?"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table, text_table
from steelyard.files import listed, plain
from steelyard.recording import Samples
from steelyard.regression import Information
from steelyard.regression.batch_means import BATCH_LENGTHS, LONG
from steelyard.regression.reduction import errors_of

if TYPE_CHECKING:
    from steelyard.dynamics import Model

    from .log_reader import DrawnLog
    from .mistakes import Hypothesis

__all__ = [
    "FewRows",
    "PredictionVerdict",
    "Word",
    "few_rows_of",
    "prediction_verdict",
    "said_of",
    "white_noise",
    "without_turns",
]

Array = NDArray[np.float64]
Word = Literal["good", "usable", "poor", "wrong"]

GOOD, USABLE, WRONG = 0.08, 0.15, 0.2
"""Largest error of the model, relative to the torques and without white noise, that counts as good and as usable, and
above which the model is wrong. Published identifications of industrial arms end at 3 to 8 %; feedforward with 15 % off
still helps a controller; above 20 %, models of sound logs are rare, and those of logs with a mistake common."""

POOR_JOINT, WRONG_JOINT = 0.4, 0.75
"""Errors of a single joint above which the model is poor, and wrong: wrists with small torques reach 30 % on sound
logs; a joint whose torques are those of another one comes near 100 %, while the joints with large torques keep the
whole small."""

UNSEEN = 0.5
"""Where the model explains its own data, an error on unseen data up to this is poor and not wrong: the motion did not
show enough, which is no mistake of the log."""

NEGLIGIBLE = 5e-3
"""Joints with less than this part of the largest torque are not judged by themselves: the last joint of the WAM, whose
torque is 0.35 % of the largest, has an error of 58 % in Sousa's identification (thesis table 4.7), which is sound."""

MOST_NAMED = 4
"""Joints named in a sentence."""

FEWEST_BATCHES = 20
"""The fewest batches of a joint: fewer do not tell which part of the residual is white."""

UNTESTED = "the data of the fit itself"
"""What was predicted where nothing could be held out."""

UNITS = ("torque unit", "position unit", "time unit")
"""Kinds of mistakes after which all numbers of the answer have another unit, though it predicts its own logs well."""

NORMAL_DEVIATION = 1.482602218505602
"""Ratio of the standard deviation of a normal distribution to its median absolute deviation."""

BEYOND = 8.0
"""Robust standard deviations beyond which a row is no noise: of normal noise one row in 10^15 is."""

FEW, MOST_OF_ERROR = 0.02, 0.5
"""Largest part of the rows that are few, and least part of the squared error that they hold. Of an arm that runs into a
stop 1 % of the rows hold 87 to 98 %. At the last joint of the UR10, whose friction the model misses where the motion
turns, 5 % hold 62 %; the next highest of the recordings of the UR10, TX40 and Gen3 is 38 %."""

MUCH = 0.2
"""The same of the extremes of a long log, which are one or two rows of an event of half a dozen: three impacts of six
rows on a log of 120 000 show 40 % of the squared error. Of sound noise none is beyond."""

LARGE_EVENT = 0.03
"""Least size of the errors in those rows beside the torques of the joint, root mean squares over all rows. Coulomb
friction that a filter rounds where the motion turns reaches 1.7 %, and harms nothing."""

NEAR_TURN = 0.03
"""s, before or after a turn of the positions in which friction may change its sign: filters move the turn by a row or a
few, and a joint that sticks turns its friction late. In eleven simulated arms it is 14 ms at most."""

PAUSE = 0.25
"""s between rows that belong to separate events."""

MOST_TIMES, MOST_SAID = 3, 3

_HEADS = ("joint", "error", "RMS", "noise", "unit", "white")
_SAID: dict[Word, str] = {
    "good": "predicts well",
    "usable": "predicts usably",
    "poor": "predicts poorly",
    "wrong": "does not predict this robot",
}


def _said(word: Word, model_error: float, tested: bool) -> str:
    """The word as a verb; of a model that explains its own data, and was tried on no other, that it was not tried."""
    return "is not tried on other data" if word == "poor" and not tested and model_error <= USABLE else _SAID[word]


@dataclass(frozen=True)
class FewRows:
    """Few rows of a log that hold most of the squared error of a joint.

    Attributes
    ----------
    role : str
        ``"identification"`` or ``"validation"``.
    index : int
        Of the joint, from 0.
    count, rows : int
        Rows that hold it, and rows of the joint that were used. Of logs of which not all rows are at hand (`partial`)
        the count, and what they hold, are lower bounds.
    square : float
        Sum of their squared errors, (N·m)² or N².
    share : float
        Part of the squared error of the joint that they hold, 0 to 1.
    relative_error : float
        Their root mean square over all rows of the joint, relative to that of its torques.
    noise : float
        Root mean square of the white noise in the other rows, N·m or N.
    times : tuple of (float, float)
        s, from and to which the events last.
    """

    log: str
    joint: str
    role: str
    index: int
    count: int
    rows: int
    square: float
    share: float
    relative_error: float
    noise: float
    times: tuple[tuple[float, float], ...]
    partial: bool

    def __str__(self) -> str:
        least = "at least " if self.partial else ""
        times = ", ".join(f"{begin:.2f}" for begin, _ in self.times[:MOST_TIMES])
        more = f" and {len(self.times) - MOST_TIMES} more" if len(self.times) > MOST_TIMES else ""
        when = f", at t = {times} s{more}" if times else ""
        return (
            f"{least}{self.count} of {self.rows} rows of joint {self.joint} in {self.log} hold {least}{self.share:.0%} "
            f"of its squared error, {self.relative_error:.0%} beside its torques{when}"
        )


@dataclass(frozen=True, eq=False)
class PredictionVerdict:
    """The verdict on how well a model predicts torques that were not used to find it.

    Attributes
    ----------
    word : {"good", "usable", "poor", "wrong"}
        By `model_error`: at most 8 %, at most 15 %, at most 20 %, or more. Where the model explains its own data to
        20 %, it is ``"poor"`` up to 50 % on unseen data. ``"poor"`` at best where a joint has more than 40 %, or
        nothing could be held out; ``"wrong"`` where a joint has more than 75 % on the data of the fit itself, and where
        a mistake in a log explains more than 20 %, see `with_mistakes`.
    source : str
        What was predicted, in words.
    model_error : float
        Relative to the torques over all the joints, without what is white noise; 0.05 means 5 %.
    relative_error : float
        With the noise.
    joint_relative_error : ndarray
        (N,).
    joint_error : ndarray
        (N,) root mean square, N·m or N; NaN of a joint that was left out.
    noise_floor : ndarray
        (N,) root mean square of the white noise in the torques that were predicted, N·m or N: no model predicts that.
        NaN where it could not be told apart; that of the data of the fit where single logs are too short to tell. What
        `few_rows` hold is none of it.
    whiteness : ndarray
        (N,): the part of the mean square of the residuals of the fit that is white, 0 to 1. Little says that what is
        left follows a pattern, which a better model would explain.
    units : tuple of str
        Of the torque of each joint, ``"N·m"`` or ``"N"``; ``"N·m or N"`` where it is not known.
    few_rows : tuple of FewRows
        Few rows that hold most of the squared error of a joint, such as those of an impact.
    mistake : str
        What looks wrong with a log or the robot file where the word is ``"wrong"`` for that alone; else empty.
    """

    word: Word
    source: str
    model_error: float
    relative_error: float
    joint_names: tuple[str, ...]
    joint_relative_error: Array = field(repr=False)
    joint_error: Array = field(repr=False)
    noise_floor: Array = field(repr=False)
    whiteness: Array = field(repr=False)
    units: tuple[str, ...] = field(repr=False)
    sentences: tuple[str, ...] = field(default=(), repr=False)
    few_rows: tuple[FewRows, ...] = field(default=(), repr=False)
    mistake: str = field(default="", repr=False)

    @property
    def is_usable(self) -> bool:
        """Whether the model predicts well enough to be used: the word is good or usable."""
        return self.word in ("good", "usable")

    @property
    def relative_noise(self) -> float:
        """Size of the white noise relative to the torques over all the joints; NaN where it could not be told apart."""
        seen = np.isfinite(self.joint_error)
        if not seen.any() or np.isnan(self.noise_floor[seen]).any():
            return float("nan")
        return float(np.sqrt(max(self.relative_error**2 - self.model_error**2, 0.0)))

    @property
    def clause(self) -> str:
        """The word, the error and what noise leaves of it, to follow the name of what predicts."""
        noise = self.relative_noise
        aside = ""
        if not np.isnan(noise):
            aside = f" ({self.model_error:.1%} without white noise, which is {noise:.1%})"
        said = _said(self.word, self.model_error, self.source != UNTESTED)
        return f"{said}: {self.relative_error:.1%} error{aside} on {self.source}{self._because}"

    @property
    def _because(self) -> str:
        """What ends a clause: the mistake that alone makes the word, or the joints that are missed by far more than all
        of them together."""
        if self.mistake and self.model_error <= USABLE:  # which says by itself that the model predicts
            return f", because of a mistake in a log or in the robot file ({self.mistake})"
        most = USABLE if self.is_usable else POOR_JOINT
        joints = np.flatnonzero(self.joint_model_error > most)
        if self.model_error > USABLE or not len(joints):
            return ""
        errors = self.joint_model_error
        named = listed([f"{self.joint_names[joint]} ({errors[joint]:.0%})" for joint in joints], MOST_NAMED)
        return f", {'but' if self.is_usable else 'and'} more than {most:.0%} at {named}"

    def with_mistakes(self, mistakes: Iterable[Sequence[Hypothesis]]) -> PredictionVerdict:
        """Judge again, with what is probably wrong with the logs.

        An error between 20 % and 50 % on unseen data, or a large one of a single joint, says by itself that the motion
        showed too little, or that the model lacks something. Where a mistake explains it, the answer is of no robot. So
        it is where the numbers have a wrong unit, which errors do not show at all.

        Parameters
        ----------
        mistakes : iterable of sequence of Hypothesis
            Of each log, as `find_mistakes` returns them.

        Returns
        -------
        PredictionVerdict
            "wrong" where a mistake was found and the error of all joints or of one is above 20 %, or it is one of unit.
        """
        first = next((found[0] for found in mistakes if found and self._is_wrong_by(found[0])), None)
        if self.word == "wrong" or first is None:
            return self
        because = f"The model {_SAID['wrong']}, because of a mistake in a log or in the robot file: {first.statement}."
        return replace(self, word="wrong", sentences=(because, *self.sentences[1:]), mistake=first.statement)

    def _is_wrong_by(self, mistake: Hypothesis) -> bool:
        errors = (self.model_error, self.worst_joint_error, mistake.error_before)
        return mistake.kind in UNITS or max(errors) > WRONG

    @property
    def joint_model_error(self) -> Array:
        """(N,) relative errors of the joints without white noise; zero where a joint has next to no torque."""
        noise = np.minimum(np.nan_to_num(self.noise_floor), self.joint_error)
        with np.errstate(divide="ignore", invalid="ignore"):
            torque = np.nan_to_num(self.joint_error / self.joint_relative_error)
            found = np.sqrt(self.joint_error**2 - noise**2) / torque
        return np.where(torque > NEGLIGIBLE * torque.max(initial=0.0), np.nan_to_num(found), 0.0)

    @property
    def worst_joint_error(self) -> float:
        """The largest of `joint_model_error`."""
        return float(self.joint_model_error.max(initial=0.0))

    @property
    def missed(self) -> str:
        """What a model that does not predict well enough misses, and what rests on it, in words; else empty."""
        errors = self.joint_model_error
        joints = np.flatnonzero(errors > POOR_JOINT)
        if self.is_usable or not (len(joints) or self.model_error > USABLE):  # where nothing was held out
            return ""
        if not len(joints) or len(errors) == 1:
            return f"{self.model_error:.0%} of the torques of {self.source}: any number may lie outside"
        named = listed([f"{self.joint_names[joint]} ({errors[joint]:.0%})" for joint in joints], MOST_NAMED)
        several = len(joints) > 1
        what = "these joints and of what they carry" if several else "this joint and of what it carries"
        return f"the torque{'s' * several} of {named} on {self.source}: numbers of {what} may lie outside"

    def _rows(self) -> list[tuple[str, ...]]:
        def number(value: float, unit: str = "") -> str:
            return f"{value:.3g}{unit}" if np.isfinite(value) else ""

        errors = (self.joint_relative_error, self.joint_error, self.noise_floor)
        columns = (self.joint_names, *errors, self.units, self.whiteness)
        return [
            (name, number(100 * relative, " %"), number(error), number(floor), unit, number(100 * white, " %"))
            for name, relative, error, floor, unit, white in zip(*columns, strict=True)
        ]

    def __str__(self) -> str:
        return "\n".join((*self.sentences, text_table(_HEADS, self._rows(), numbers=(1, 2, 3, 5))))

    def _repr_html_(self) -> str:
        caption = f"{self.word}: {self.model_error:.1%} on {self.source}"
        return html_table(caption, _HEADS, self._rows(), self.sentences)

    def to_dict(self) -> dict[str, Any]:
        """As plain data for JSON; numbers that are not finite are None."""
        return {**plain(self)}


def white_noise(info: Information, base: ArrayLike) -> tuple[Array, Array]:
    """Root mean square of the white noise of each joint, and its part of the mean square of the residuals, (N,) each.

    Of residuals that are the sum of white noise, of variance w, and of errors that stay for eight samples, of variance
    s, single ones have the variance w + s, and sums of eight neighbours have eight times w + 8 s. Of long data whose
    neighbouring rows were combined the sums are over 64, so that what lasts for less counts as white in part, and both
    parts of the mean square are told to a few hundredths of it only.

    Parameters
    ----------
    info : Information
        With `batch_means`.
    base : (n_b,)
        At which the residuals are taken.

    Returns
    -------
    noise_floor : (N,)
        N·m or N; NaN where the data is too short, or holds no batch means.
    whiteness : (N,)
        0 to 1; NaN likewise.
    """
    beta = np.asarray(base, dtype=float)
    count = len(info.factors)
    unknown = np.full(count, np.nan)
    if not info.batch_means or not info.by_joint:
        return unknown, unknown.copy()
    length = BATCH_LENGTHS[0]
    floors, shares = unknown, unknown.copy()
    for joint, (single, sums) in enumerate(zip(info.factors, info.batch_means[0], strict=True)):
        if sums.count < FEWEST_BATCHES or single.count == 0:
            continue
        variance = single.residual2(beta) / single.count
        of_sums = sums.residual2(beta) / single.count
        # How many sums there are tells which part of the rows is in long ones: none but where they were combined.
        combined = (1.0 - length * sums.count / single.count) * LONG / (LONG - length)
        mean = length + (LONG - length) * min(max(combined, 0.0), 1.0)
        lasting = min(max((of_sums - variance) / (mean - 1.0), 0.0), variance)
        floors[joint] = np.sqrt(variance - lasting)
        shares[joint] = 1.0 - lasting / variance if variance > 0.0 else 1.0
    return floors, shares


def said_of(few: Sequence[FewRows]) -> str:
    """Say it of all of them, one at least, in a sentence or two."""
    more = f"; and {len(few) - MOST_SAID} more" if len(few) > MOST_SAID else ""
    return (
        f"Few rows hold much of the error: {'; '.join(map(str, few[:MOST_SAID]))}{more}. Noise is not "
        "like that; it happens where an arm meets a stop or another body, or a sensor has spikes."
    )


def beyond_noise(errors: Array) -> float:
    """Return the size of an error, of some errors (S,) that are finite, from which it is no noise."""
    return BEYOND * NORMAL_DEVIATION * float(np.median(np.abs(errors)))


def few_rows_of(
    log: str,
    role: str,
    information: Information,
    model: Model,
    base: Array,
    drawn: DrawnLog,
    known: tuple[Array, Sequence[Array]] | None = None,
) -> tuple[FewRows, ...]:
    """Find where few rows of a log hold most of the squared error of a joint.

    A row counts where its error is beyond 8 times the standard deviation that the median of the errors tells, which
    the few do not change.

    Parameters
    ----------
    information : Information
        Of all rows of the log.
    base : (n_b,)
        At which the errors are taken.
    drawn : DrawnLog
        Rows of the log that are drawn, in which turns are no events. Where these are not all of its rows, stretches of
        neighbouring ones tell how large errors usually are.
    known : tuple, optional
        The errors (S, N) of these rows, and those of each stretch, where they are there already.

    Returns
    -------
    tuple of FewRows
        The largest share first.
    """
    factors = information.measured
    joint_names, samples = model.robot.joint_names, drawn.samples
    if len(factors) != len(joint_names) or not information.has_joint_errors:
        return ()
    assert samples.t is not None
    every, stretches = known or (errors_of(model, samples, base), None)
    errors = without_turns(model, samples, base, every)
    whole = errors
    if len(errors) < drawn.seen and drawn.windows:
        whole = np.vstack(stretches or [errors_of(model, window, base) for window in drawn.windows])
    partial = len(whole) < drawn.seen
    least = NEGLIGIBLE**2 * max((factor.norm2 / max(factor.count, 1) for factor in factors), default=0.0)
    found = []
    for joint, factor in enumerate(factors):
        sizes = np.abs(whole[:, joint][np.isfinite(whole[:, joint])])
        total = factor.residual2(base)
        if not len(sizes) or not total > 0.0 or not factor.norm2 > least * factor.count:
            continue
        limit = beyond_noise(sizes)
        if np.mean(sizes > limit) > FEW:
            continue
        apart = np.abs(errors[:, joint]) > limit  # not where it is NaN
        # Of a long log the extremes alone are sure to be there, at which an event shows if not in its whole length.
        held = np.abs(errors[apart, joint]) if partial else sizes[sizes > limit]
        square = min(float(np.sum(held**2)), total)
        if square < (MUCH if partial else MOST_OF_ERROR) * total or square < LARGE_EVENT**2 * factor.norm2:
            continue
        times = samples.t[apart]
        events = np.split(times, np.flatnonzero(np.diff(times) > PAUSE) + 1) if len(times) else []
        found.append(
            FewRows(
                log,
                joint_names[joint],
                role,
                joint,
                len(held),
                factor.count,
                square,
                square / total,
                float(np.sqrt(square / factor.norm2)),
                _white_noise_of_rows(np.where(np.abs(whole[:, joint]) <= limit, whole[:, joint], np.nan)),
                tuple((float(event[0]), float(event[-1])) for event in events),
                partial,
            )
        )
    return tuple(sorted(found, key=lambda one: -one.share))


def without_turns(model: Model, samples: Samples, base: Array, errors: Array) -> Array:
    """Return errors (S, N) with NaN where a row was not used, or where a joint turns and friction is not that of its
    velocity: these are errors of the model that return with every turn, and no events.

    Friction jumps where the motion turns, by twice the Coulomb friction. A row whose error is noise with the velocity
    of its joint reversed belongs to the other side of the turn. One whose error has then the other sign has a friction
    between both, as a joint that sticks. So has the soft friction of MuJoCo, which takes 17 ms to turn. *Measured* on
    20 sound logs of 10 s of it: in 14 such rows were told as impacts, now in none, and with a planted impact of 16 ms,
    as large as the torques of its joint, it is told in all 20 as before.
    """
    left = errors.copy() if samples.mask is None else np.where(samples.mask, errors, np.nan)
    if samples.regressor is not None:  # which went through the filters of the torques, as their jumps did
        return left
    turning = np.abs(samples.dq) <= NEAR_TURN * np.abs(samples.ddq)
    for joint in range(left.shape[1]):
        own = left[:, joint]
        known = own[np.isfinite(own)]
        if not len(known):
            continue
        limit = beyond_noise(known)
        rows = np.flatnonzero((np.abs(own) > limit) & turning[:, joint])
        if not len(rows):
            continue
        dq = samples.dq[rows]
        dq[:, joint] *= -1.0
        channels = None if samples.channels is None else {name: one[rows] for name, one in samples.channels.items()}
        other = Samples(samples.q[rows], dq, samples.ddq[rows], samples.torque[rows], channels=channels)
        opposite = errors_of(model, other, base)[:, joint]
        own[rows[(np.abs(opposite) <= limit) | (opposite * own[rows] < 0.0)]] = np.nan
    return left


def prediction_verdict(
    info: Information,
    base: ArrayLike,
    *,
    validation: Sequence[Information] = (),
    held_out_error: ArrayLike | None = None,
    fold_count: int = 0,
    fit_error: float | None = None,
    joint_fit_error: ArrayLike | None = None,
    few_rows: Sequence[FewRows] = (),
    units: Sequence[str] = (),
) -> PredictionVerdict:
    """Judge how well base parameters predict: validation logs where there are any, else what cross-validation held out.

    Parameters
    ----------
    info : Information
        The data of the fit; all of `validation` together where that is gone.
    base : (n_b,)
        The answer.
    validation : sequence of Information
        Of logs that were not used.
    held_out_error : (N,), optional
        Root mean square of the held-out residuals of each joint, as `CrossValidation.joint_errors` tells for the weight
        that was chosen.
    fold_count : int
        Of the cross-validation.
    fit_error : float, optional
        Relative error over all the joints on the data of the fit, where `info` is not that data.
    joint_fit_error : (N,), optional
        The same of each joint. Its noise is not known, so that a joint counts as wrong where the validation logs, noise
        aside, say so as well.
    few_rows : sequence of FewRows
        Short events in these logs. They look white, but a model of a robot is not excused for them as for noise: what
        they hold is not taken off the error.
    units : sequence of str
        Those of the torques of the joints, as `Robot.torque_units` tells them; none where they are not known.
    """
    beta = np.asarray(base, dtype=float)
    names = info.joint_names if info.has_joint_errors else ("all",)
    training, own_torque, counts = _root_mean_squares([info], beta)
    torque = own_torque
    floor, white = white_noise(info, beta)
    if len(floor) != len(names):
        floor = white = np.full(len(names), np.nan)
    tested = True
    floor = _without(few_rows, "identification", floor)
    own_noise = np.minimum(np.nan_to_num(floor), training)
    if validation:
        count = len(validation)
        error, torque, counts = _root_mean_squares(validation, beta)
        # Logs differ in their noise: that of faster motions, of another day or another sensor is another one.
        floor = _without(few_rows, "validation", _white_noise_of_all(validation, beta, floor))
        source = f"{count} validation logs" if count > 1 else "the validation log"
    elif held_out_error is not None:
        error = np.asarray(held_out_error, dtype=float)
        source = f"{fold_count} stretches of the logs, each left out in turn"
    else:
        error, tested = training, False
        source = UNTESTED
    of_all = np.sqrt(counts * torque**2)  # over all rows of all joints, as `Information.relative_error`
    whole = float(np.linalg.norm(np.sqrt(counts) * error) / np.linalg.norm(of_all))
    own = info.relative_error(beta)
    if fit_error is not None and np.isfinite(fit_error):
        own = float(fit_error)
    noise = np.minimum(np.nan_to_num(floor), error)
    model = float(np.sqrt(np.sum(counts * (error**2 - noise**2))) / np.linalg.norm(of_all))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(torque > 0.0, error / torque, np.nan)
        held_out = np.nan_to_num(np.sqrt(error**2 - noise**2) / torque)
        of_fit = np.nan_to_num(np.sqrt(training**2 - own_noise**2) / own_torque)
    if joint_fit_error is not None and len(np.asarray(joint_fit_error)) == len(of_fit):
        of_fit = np.fmin(held_out, np.asarray(joint_fit_error, dtype=float))
    of_joint = tuple(units) if len(units) == len(names) else ("N·m or N",) * len(names)
    shown = torque > NEGLIGIBLE * torque.max(initial=0.0)
    worst = float(held_out[shown].max(initial=0.0)), float(of_fit[shown].max(initial=0.0))
    word = _word(model, own, *worst, tested)
    saved = fit_error is not None
    sentences = list(_sentences(word, model, own, source, tested, saved))
    limits = [
        (of_fit, WRONG_JOINT, "the data of the fit", training, own_torque),
        (held_out, POOR_JOINT, source, error, torque),
    ]
    # The noise in the data of the fit is not known of a saved estimate.
    for errors, limit, data, size, whole_size in limits[saved:]:
        # How large that is in all tells whether it matters: wrists have small torques.
        beyond = [
            f"{names[joint]} ({errors[joint]:.0%}, {size[joint]:.2g} beside {whole_size[joint]:.2g} {of_joint[joint]})"
            for joint in np.flatnonzero(shown & (errors > limit))
        ]
        if beyond and word in ("poor", "wrong"):
            above = listed(beyond, MOST_NAMED)
            sentences.insert(1, f"Above {limit:.0%} of the torque of a joint, noise aside, on {data}: {above}.")
            break
    if few_rows:
        sentences.append(said_of(few_rows))
        white[[one.index for one in few_rows]] = np.nan  # short events look white
    told = tuple(sentences)
    seen = np.where((torque > 0.0) | (error > 0.0), error, np.nan)  # of a joint that was left out nothing is known
    return PredictionVerdict(
        word, source, model, whole, tuple(names), relative, seen, floor, white, of_joint, told, tuple(few_rows)
    )


def _white_noise_of_rows(errors: Array) -> float:
    """Return the root mean square of the white noise in errors (S,); NaN where a row does not count.

    As `white_noise` tells it from an Information: what lasts for eight rows is in their sums, white noise is not.
    """
    length = BATCH_LENGTHS[0]
    count = max(int(np.isfinite(errors).sum()), 1)
    rows = np.pad(np.nan_to_num(errors), (0, -len(errors) % length)).reshape(-1, length)
    variance = float(np.sum(rows**2)) / count
    lasting = (float(np.sum(rows.sum(axis=1) ** 2)) / count - variance) / (length - 1)
    return float(np.sqrt(variance - min(max(lasting, 0.0), variance)))


def _white_noise_of_all(data: Sequence[Information], base: Array, otherwise: Array) -> Array:
    """Return the white noise of each joint in all data, root mean square (N,); `otherwise` where one is unknown."""
    floors = np.array([white_noise(information, base)[0] for information in data])
    if floors.shape[1:] != otherwise.shape:
        return otherwise
    counts = np.array([[factor.count for factor in information.factors] for information in data], dtype=float)
    together = np.sqrt((counts * floors**2).sum(axis=0) / np.maximum(counts.sum(axis=0), 1.0))
    return np.where(np.isnan(together), otherwise, together)


def _without(few: Sequence[FewRows], role: str, floor: Array) -> Array:
    """Return white noise (N,) without what few rows hold of the data of a role: that of their logs' other rows."""
    least = np.zeros(len(floor))
    for one in few:
        if one.role == role:
            least[one.index] = max(least[one.index], one.noise)
    return np.asarray(np.where(least > 0.0, np.minimum(floor, least), floor))


def _root_mean_squares(data: Sequence[Information], base: Array) -> tuple[Array, Array, Array]:
    """Return those of the residuals and of the torques of each joint over all data together, and how many rows."""
    groups = [information.measured for information in data]
    counts = np.maximum(np.sum([[f.count for f in factors] for factors in groups], axis=0), 1)
    residuals = np.sum([[f.residual2(base) for f in factors] for factors in groups], axis=0)
    torques = np.sum([[f.norm2 for f in factors] for factors in groups], axis=0)
    return np.sqrt(residuals / counts), np.sqrt(torques / counts), counts


def _word(model: float, own: float, worst: float, worst_of_fit: float, tested: bool) -> Word:
    if worst_of_fit > WRONG_JOINT or (model > WRONG and not (own <= WRONG and model <= UNSEEN)):
        return "wrong"
    if not tested or model > USABLE or worst > POOR_JOINT:
        return "poor"
    return "good" if model <= GOOD else "usable"


def _sentences(word: Word, model: float, own: float, source: str, tested: bool, saved: bool) -> tuple[str, ...]:
    said = _said(word, model, tested)
    found = [f"The model {said}: {model:.1%} of the torques of {source} are left unexplained, noise aside."]
    if not tested:
        found.append(
            "Nothing was held out, since there are no three stretches of logs, or files of steelyard reduce, to leave "
            "out in turn; record a longer motion, or give --validate LOG."
        )
    elif word in ("poor", "wrong") and own <= 0.5 * model and saved:
        found.append(
            f"It explains the data of its fit to {own:.1%}, noise included: that motion showed too little for this "
            "one, or the robot is no longer the same, or these logs are wrong. Identify them, and steelyard compare "
            "tells what differs."
        )
    elif word in ("poor", "wrong") and own <= 0.5 * model:
        found.append(
            f"It explains the data of the fit to {own:.1%}: their motion shows too little for others, or the "
            "others hold what no model of this robot explains."
        )
    return tuple(found)
