"""Logs whose torques are late or early: whether that matters to the numbers of an answer, and what is said of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import percent
from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.recording import Samples
from steelyard.recording.correction import Correction, Settings
from steelyard.recording.diagnosis.late_torques import EARLIER, LATER, SURE, LateTorques, is_certain, late_torques
from steelyard.recording.filters.zero_phase import low_pass
from steelyard.regression import Estimate, Information, least_squares
from steelyard.regression.parameter_covariance import NORMAL, inverse_root_of
from steelyard.regression.reduction import errors_of

from .given import GivenLog, GivenSamples
from .log_reader import LogReader, ReducedLog
from .mistakes import Hypothesis

__all__ = ["MATTERS", "LateLog", "in_half_widths", "late_hypotheses", "late_log", "late_logs"]

Array = NDArray[np.float64]
MATTERS = 0.5
"""Half-widths of the interval of a base parameter by which a delay, a tilt of the base, or noise of the
positions must move it to be told."""
LOWER = 0.5
"""Part of the cutoff of the positions at which the motion is filtered once more before a delay is told: what noise of
the encoders, and friction that the model lacks, look like depends on the cutoff, and a delay does not."""
DENSE_ROWS = 20_000
"""Rows that are read again of a long log, of which no stretch is kept that is long enough."""
ENOUGH_ROWS, FEWEST_ROWS = 4096, 100
"""Rows of stretches together that are enough, and of one that count at all."""
MOST_LOGS = 4
"""Logs that are looked at, evenly spread: those of one robot have the same delay mostly."""


@dataclass(frozen=True, eq=False)
class LateLog:
    """A log whose torques are logged later or earlier than the motion, so much that it matters.

    Attributes
    ----------
    name : str
    delays, deviations : ndarray
        (N,) s, of each joint, and their standard deviations; zero of joints that are not late.
    change : ndarray
        (n_b,) by how much the base parameters of a regression over all logs are off because of it, and of as many rows
        of logs that were not looked at as it stands for.
    largest : float
        The largest change by all the logs that are late, in half-widths of the interval of 95 % of the parameter.
    errors : (float, float)
        Relative error of the torques of the log, and what is left of it without the delay.
    explained : ndarray of bool
        (N,) which joints are late by themselves, so that most of their error is left without the delay.
    looked_at : (int, int)
        How many logs were looked at, and how many there are.
    alike : bool
        Whether it stands for all of them, of which it has the name of the first.
    """

    name: str
    delays: Array
    deviations: Array
    change: Array
    largest: float
    errors: tuple[float, float]
    explained: NDArray[np.bool_]
    looked_at: tuple[int, int] = (1, 1)
    alike: bool = False


def late_logs(
    reader: LogReader,
    logs: Sequence[GivenLog],
    reduced: Sequence[ReducedLog],
    information: Information,
    errors: Sequence[Sequence[Array]],
    unconstrained: Estimate,
) -> list[LateLog]:
    """Return those of some logs whose torques are late; none where `delay` is found by the logs anyway.

    What a delay does to the numbers depends on how many logs have it. Where those that are looked at have one together,
    each of them stands for as large a part of all rows as it is of theirs.

    Parameters
    ----------
    reader : LogReader
        That has read them.
    logs : sequence of GivenLog
    reduced : sequence of ReducedLog
        The same, and perhaps others behind them.
    information : Information
        Of all logs together.
    errors : sequence of sequence of (L, N)
        What is left of the torques in the stretches of each, see `errors_of`.
    unconstrained : Estimate
        Least squares of all logs.
    """
    model, processing = reader.model, reader.processing
    if isinstance(processing.delay, str) or not logs:
        return []
    chosen = np.unique(np.linspace(0, len(logs) - 1, MOST_LOGS).round().astype(int))
    stretches: dict[int, list[tuple[Samples, Array]]] = {}
    for number in chosen.tolist():
        log, one = logs[number], reduced[number]
        if one.information.count == 0 or (isinstance(log, GivenSamples) and log.samples.t is None):
            continue
        stretches[number] = list(zip(one.drawn.windows, errors[number], strict=True))
        if sum(window.count for window in one.drawn.windows) < min(one.drawn.seen, ENOUGH_ROWS):
            try:
                dense = reader.dense(log, DENSE_ROWS)
            except InputError:  # a stretch by itself, which may be at rest
                dense = None
            stretches[number] = [] if dense is None else [(dense, errors_of(model, dense, unconstrained.base))]
    if not stretches:
        return []

    looked_at, every, stands_for = (len(stretches), len(logs)), None, 1.0
    if len(stretches) > 1:
        # Short logs tell together what none tells by itself. What their delay does to numbers that rest on them is what
        # it does to those of all logs, which have other motions.
        of_these = Information.total([reduced[number].information for number in stretches])
        rows = [stretch for own in stretches.values() for stretch in own]
        every = late_log(reduced[0].name, model, of_these, of_these, unconstrained, rows, processing.cutoff)
        stands_for = 1.0 if every is None else information.count / of_these.count
    found = []
    for number, rows in stretches.items():
        name, own = reduced[number].name, reduced[number].information
        one = late_log(name, model, information, own, unconstrained, rows, processing.cutoff, stand_for=stands_for)
        if one is not None:
            found.append(replace(one, looked_at=looked_at if stands_for > 1.0 else (1, 1)))
    if every is not None and all(_agree(one, every) for one in found):
        return [replace(every, looked_at=looked_at, alike=True)]
    change = np.sum([one.change for one in found], axis=0, initial=0.0)
    largest = in_half_widths(change, unconstrained.standard_error) if found else 0.0
    return [replace(one, largest=largest) for one in found if largest >= MATTERS or one.explained.any()]


def _agree(one: LateLog, other: LateLog) -> bool:
    """Whether the delays of a log may be those of others."""
    difference = np.abs(one.delays - other.delays)
    return bool(np.all(difference <= SURE * np.hypot(one.deviations, other.deviations)))


def late_log(
    name: str,
    model: Model,
    information: Information,
    own: Information,
    unconstrained: Estimate,
    stretches: Sequence[tuple[Samples, Array]],
    cutoff: object = None,
    least: tuple[float, float] = (LATER, EARLIER),
    twice: bool = False,
    stand_for: float = 1.0,
) -> LateLog | None:
    """Tell whether the torques of a log are late, so much that the numbers of the answer say something else.

    One joint that is late by itself is told however wide the intervals are, for its delay makes most of its error and
    so the intervals wide.

    Parameters
    ----------
    name : str
    model : Model
    information, own : Information
        Of all logs together, and of this one, in the base parameters of the model.
    unconstrained : Estimate
        Least squares of all logs.
    stretches : sequence of (Samples, ndarray)
        Neighbouring rows of the log, and what is left of their torques, see `errors_of`.
    cutoff : float, optional
        Hz, of the filter of the positions, where that is known.
    least : (float, float)
        See `late_torques`.
    twice : bool
        Whether a joint that is late by itself must be so at the lower cutoff, too. *Measured*: joint 4 of a KR300,
        whose counterbalance the model lacks, is late by 61 and 71 ms in 10 s of its logs, and by 87 and by nothing at
        the lower cutoff; single joints of a WAM that are late by 30 or 60 ms differ by 0.3 ms.
    stand_for : float
        How many times as many rows are as late.
    """
    stretches = [(samples, errors) for samples, errors in stretches if samples.count >= FEWEST_ROWS]
    predicted = [(samples, samples.torque - errors) for samples, errors in stretches]
    found = late_torques(model, predicted, least)
    if found is None or not found.told.any():
        return None
    change = stand_for * _change(found, found.told, model, information, own, unconstrained)
    if not (in_half_widths(change, unconstrained.standard_error) >= MATTERS or found.explained.any()):
        return None
    delays, deviations, alone = found.told, found.told_deviations, found.explained
    if isinstance(cutoff, int | float):
        slower = [_slower(samples, LOWER * cutoff) for samples, _ in stretches]
        again = late_torques(model, [(one, one.torque - errors_of(model, one, unconstrained.base)) for one in slower])
        if again is None:
            return None
        whole = len(set(delays.tolist())) == 1
        others = np.full_like(delays, again.delay) if whole else again.joint_delays
        of_others = np.full_like(delays, again.standard_deviation) if whole else again.joint_deviations
        deviations = np.where(delays != 0.0, np.hypot(deviations, others - delays), 0.0)
        # Neither is certain where a joint does not tell.
        certain = is_certain(delays, deviations, least) & (np.abs(others) >= SURE * of_others)
        if not twice:
            deviations, certain = np.where(alone, found.told_deviations, deviations), certain | alone
        alone = alone & certain
        delays, deviations = np.where(certain, delays, 0.0), np.where(certain, deviations, 0.0)
        sizes = np.hypot(delays, deviations) * np.sign(delays)
        change = stand_for * _change(found, sizes, model, information, own, unconstrained)
    largest = in_half_widths(change, unconstrained.standard_error)
    if not (largest >= MATTERS or alone.any()):
        return None
    before = own.relative_error(unconstrained.base)
    errors = before, before * _part_left(model, stretches, delays, unconstrained)
    return LateLog(name, delays, deviations, change, largest, errors, alone)


def _change(
    found: LateTorques,
    delays: Array,
    model: Model,
    information: Information,
    own: Information,
    unconstrained: Estimate,
) -> Array:
    """Return by how much delays (N,) move base parameters, to first order: each joint with its weight and its rows."""
    weights = information.joint_weights(unconstrained.weights)
    sums = np.zeros(information.base_count)
    for k, columns in enumerate(model.base_columns.joints):
        sums[columns] += weights[k] ** 2 * own.factors[k].count * delays[k] * found.changes[k]
    inverse, _, unknown = inverse_root_of(information, weights)
    return np.where(unknown, 0.0, inverse @ (inverse.T @ sums))


def _part_left(
    model: Model, stretches: Sequence[tuple[Samples, Array]], delays: Array, unconstrained: Estimate
) -> float:
    """Return what part of the error of rows is left where they are reduced again with each torque moved in time."""
    from steelyard.recording.diagnosis import advanced  # few logs are late

    left: list[float] = []
    for delayed in (np.zeros_like(delays), delays):
        moved = []
        for samples, _ in stretches:
            assert samples.t is not None
            interval = float(np.median(np.diff(samples.t)))
            columns = [advanced(own, delay / interval) for own, delay in zip(samples.torque.T, delayed, strict=True)]
            torque, known = (np.column_stack(parts) for parts in zip(*columns, strict=True))
            shifted = replace(samples, torque=torque, mask=samples.used_rows & known)
            moved.append(Information.from_samples(model, shifted))
        together = sum(moved[1:], moved[0])
        left.append(together.relative_error(least_squares(together, unconstrained.weights).base))
    return left[1] / max(left[0], 1e-300)


def in_half_widths(change: Array, standard_error: ArrayLike) -> float:
    """Return the largest change of a base parameter (n_b,) over the half-width of its interval of 95 %."""
    halves = NORMAL * np.asarray(standard_error)
    told = np.isfinite(halves) & (halves > 0.0)
    return float(np.max(np.abs(change[told]) / halves[told], initial=0.0))


def _slower(samples: Samples, cutoff: float) -> Samples:
    """Return samples whose motion is filtered once more."""
    assert samples.t is not None
    rate = 1.0 / float(np.median(np.diff(samples.t)))
    if not 2.0 * cutoff < rate:
        return samples
    motion = (low_pass(one, rate, cutoff, 3, "the samples") for one in (samples.q, samples.dq, samples.ddq))
    q, dq, ddq = motion
    return replace(samples, q=q, dq=dq, ddq=ddq, regressor=None, regressor_model=None)


def late_hypotheses(
    late: Iterable[LateLog], stated: Any, joint_names: Sequence[str]
) -> dict[str, tuple[Hypothesis, ...]]:
    """Say it of each log as a mistake in it, with one line of robot.toml that mends them all.

    Parameters
    ----------
    late : iterable of LateLog
    stated : float or sequence of float
        The delay that robot.toml states, s.
    joint_names : sequence of str
    """
    logs = tuple(late)
    if not logs:
        return {}
    settings = _settings(logs, stated)
    told: dict[str, tuple[Hypothesis, ...]] = {}
    for one in logs:
        largest = int(np.argmax(np.abs(one.delays)))
        delay, deviation = float(one.delays[largest]), float(one.deviations[largest])
        evidence = (
            f"numbers of the answer move by up to {one.largest:.2g} times the half-width that noise alone gives their "
            "intervals of 95 %"
        )
        seen, count = one.looked_at
        if seen < count:
            evidence += f"; {seen} of {count} logs were looked at, and stand for all"
        if one.explained.any():
            evidence = f"the error falls from {percent(one.errors[0], 2)} to {percent(one.errors[1], 2)}"
        gain = 0.5 * (delay / max(deviation, 1e-9)) ** 2
        told[one.name] = (
            Hypothesis(
                "delay",
                _statement(one, joint_names),
                Correction(delay=delay),
                gain,
                *one.errors,
                None,
                evidence,
                settings,
            ),
        )
    return told


def _statement(late: LateLog, joint_names: Sequence[str]) -> str:
    """Say by how much the torques of which joints are late, a sentence without a full stop."""
    delays = late.delays
    of_all = " of all logs" if late.alike else ""
    if len(set(delays.tolist())) == 1:
        return f"The torques{of_all} look to be logged {_said(delays[0], late.deviations[0])}"
    told = zip(joint_names, delays, late.deviations, late.explained, strict=True)
    parts = [
        f"{name}'s {_said(delay, deviation)}{' (or its positions later)' if alone and delay < 0.0 else ''}"
        for name, delay, deviation, alone in told
        if delay
    ]
    return f"Torques{of_all} look to be logged later or earlier than the motion: {', '.join(parts)}"


def _said(delay: float, deviation: float) -> str:
    when = "later" if delay > 0.0 else "earlier"
    size, half = 1e3 * abs(delay), 2e3 * deviation
    return f"{size:.{1 if size < 10.0 else 0}f} ± {half:.{1 if half < 1.0 else 0}f} ms {when} than the motion"


def _settings(late: Sequence[LateLog], stated: Any) -> Settings:
    """Return what robot.toml must say: the delay of these logs on average, beside the one that it states."""
    weights = np.array([np.where(one.deviations > 0.0, one.deviations, np.inf) ** -2.0 for one in late])
    sums = weights.sum(axis=0)
    mean = np.sum(weights * [one.delays for one in late], axis=0) / np.where(sums > 0.0, sums, 1.0)
    whole = [float(f"{value:.3g}") for value in np.asarray(stated, dtype=float) + mean]
    return {"processing": {"delay": whole[0] if len(set(whole)) == 1 else whole}}
