"""What an answer cannot tell of itself: mistakes of logs, another size of torques or times, and impossible masses."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from steelyard.display import few_digits
from steelyard.dynamics import Model
from steelyard.estimators.marginal_likelihood import BodyPrior
from steelyard.recording import Samples
from steelyard.recording.correction import correction_settings
from steelyard.regression import Estimate
from steelyard.robot import RobotFile

from .given import GivenLog
from .mistakes import MOTION_UNITS, POOR, TOO_MANY_JOINTS, Hypothesis, find_mistakes, sentence
from .parameter_table import ParameterTable
from .prediction_verdict import PredictionVerdict
from .wrong_scale import WrongScale, masses, wrong_scale

if TYPE_CHECKING:
    from .log_reader import LogReader, Progress
    from .reduced_logs import ReducedLogs
    from .result import Prediction

__all__ = ["Doubts", "doubts_of", "heavy_ends", "mistakes_in_logs"]

_SEARCHED = 3
"""Logs for which all hypotheses are tried; for the others only those that were found in these. A search takes a second
or two, and logs of one robot mostly share their mistakes."""
_WORST = 12
"""Logs that are looked at, the worst predicted of all: a look takes 10 ms where nothing is wrong."""
_SAMPLES = 1200
"""Rows of a log, or up to twice as many, by which mistakes are sought where those at hand have filtered torques."""
_DENSE_ROWS = 4000
"""Rows in the middle of a log by which a delay is told where the samples at hand are too far apart."""


@dataclass(frozen=True, eq=False)
class Doubts:
    """What is probably wrong with the logs of an answer.

    Attributes
    ----------
    mistakes : dict from str to tuple of Hypothesis
        By log, the delays of torques among them.
    of_log : bool
        Whether there are others than such delays, so that the answer is of no robot.
    prediction : PredictionVerdict
        The verdict with the mistakes.
    remarks : tuple of str
        A sentence for each doubt.
    """

    mistakes: dict[str, tuple[Hypothesis, ...]]
    of_log: bool
    scale: WrongScale | None
    prediction: PredictionVerdict
    remarks: tuple[str, ...]


def doubts_of(
    reader: LogReader,
    read: ReducedLogs,
    predictions: Sequence[Prediction],
    prediction: PredictionVerdict,
    late: Mapping[str, tuple[Hypothesis, ...]],
    priors: tuple[BodyPrior, ...],
    free: Callable[[], Estimate],
    say: Progress,
) -> Doubts:
    """Look for what is wrong with logs, by what the answer leaves of them and by what it makes of the robot.

    Parameters
    ----------
    predictions : sequence of Prediction
        Of each log.
    late : mapping from str to tuple of Hypothesis
        Delays of the torques, see `late_hypotheses`.
    priors : tuple of BodyPrior
        See `body_priors`.
    free : callable
        Returns an estimate that no mass of the description holds.
    say : callable
    """
    # Of a model that predicts well, mostly only cheap explanations are tried on the logs that it predicts.
    well = {p.name for p in predictions if prediction.word == "good" and p.feasible_error <= POOR}
    # Half of a log with a body looks like many a mistake.
    errors = {name: error for name, error in _worst_errors(predictions).items() if name not in read.changes}
    samples = {log.name: log.samples for log in read.logs}
    mistakes = mistakes_in_logs(reader, reader.file, priors, read.given, samples, errors, say, well)
    scale: WrongScale | None = None
    seen = [log.samples for log in read.logs if log.fitted]
    if seen and not read.changes and not reader.units_are_suspect:
        layout = reader.layouts.get(read.logs[0].name)
        scale = wrong_scale(reader.model, lambda: None if mistakes else free(), seen, reader.file, layout)
    # Of several logs, one alone may have another unit than all the others.
    if scale is not None and (len(seen) == 1 or len(mistakes) > 1):
        mistakes = {name: found for name, found in mistakes.items() if not scale.outweighs(found[0])}
    scale = None if mistakes else scale
    told = mistakes
    if all(found[0].kind == "delay" for found in mistakes.values()):  # which it tells by few rows
        told = mistakes | dict(late)
    remarks = [change.sentence(log) for log, change in read.changes.items()]
    remarks += [f"{log}: {sentence(found)}" for log, found in told.items()]
    if scale is not None:
        remarks.append(scale.sentence)
    return Doubts(told, bool(mistakes), scale, prediction.with_mistakes(mistakes.values()), tuple(remarks))


def _worst_errors(predictions: Sequence[Prediction]) -> dict[str, float]:
    """The largest relative error of any joint, by log."""
    found: dict[str, float] = {}
    for prediction in predictions:
        errors = prediction.joint_feasible_error
        error = float(np.max(errors[np.isfinite(errors)], initial=prediction.feasible_error))
        found[prediction.name] = max(found.get(prediction.name, 0.0), error)
    return found


def mistakes_in_logs(
    reader: LogReader,
    file: RobotFile,
    priors: tuple[BodyPrior, ...],
    logs: Mapping[str, GivenLog],
    samples: Mapping[str, Samples],
    errors: Mapping[str, float],
    say: Callable[[str], None],
    predicted_well: Collection[str] = (),
) -> dict[str, tuple[Hypothesis, ...]]:
    """Look for mistakes in logs, those that are predicted worst first.

    Parameters
    ----------
    reader : LogReader
        That has read them.
    priors : tuple of BodyPrior
        See `body_priors`.
    logs : mapping from str to GivenLog
        By their names.
    samples : mapping from str to Samples
        Of each log, thinned out.
    errors : mapping from str to float
        How badly each of them is predicted: the largest relative error of its joints.
    say : callable
        Told when a search begins.
    predicted_well : collection of str
        Logs on which only what costs little is tried, unless that says that the torques of a joint have a wrong factor.

    Returns
    -------
    dict from str to tuple of Hypothesis
        What is probably wrong with a log, with what robot.toml must say; logs without a finding are not in it.
    """
    model, names = reader.model, list(reader.model.robot.joint_names)
    if model.dof > TOO_MANY_JOINTS:
        return {}
    measured = _torques_as_measured(reader)
    shared: list[Hypothesis] = []
    found: dict[str, tuple[Hypothesis, ...]] = {}
    searches = 0
    for log in sorted(errors, key=lambda name: -errors[name])[:_WORST]:

        def dense(log: str = log) -> Samples | None:
            return (measured or reader).dense(logs[log], _DENSE_ROWS)

        def begin(strained: bool, log: str = log) -> bool:
            nonlocal searches
            if log in predicted_well and not strained:
                return False
            searches += 1
            if searches <= _SEARCHED:
                say(f"what may be wrong with {log}?")
            return searches <= _SEARCHED

        seen = samples[log] if measured is None else measured.thinned(logs[log], _SAMPLES).samples
        mistakes = find_mistakes(model, seen, dense=dense, known=shared, begin=begin, priors=priors)
        # A motion that no robot makes says nothing else.
        if not mistakes or (reader.units_are_suspect and mistakes[0].kind not in MOTION_UNITS):
            continue
        shared.extend(hypothesis for hypothesis in mistakes if hypothesis not in shared)
        layout = reader.layouts.get(log)
        mended = [replace(one, settings=correction_settings(one.correction, file, names, layout)) for one in mistakes]
        stated = tuple(one for one in mended if one.settings)  # what no line mends is no mistake that anybody makes
        if stated:
            found[log] = stated
    return {log: found[log] for log in errors if log in found}


def _torques_as_measured(reader: LogReader) -> LogReader | None:
    """Return a reader that does not filter torques, where the robot file has them filtered.

    The regressor of an answer goes through the filter as the torques do; that of a search for mistakes cannot, since it
    moves signs, orders and times of the columns. With filtered torques alone a real Gen3, which is sound, looked as if
    all its torques were 23 times too large.
    """
    if reader.processing.torque_cutoff is None:
        return None
    own = reader.unwritten()
    own.processing = replace(reader.processing, torque_cutoff=None)
    return own


_HEAVY_END, _NOTICEABLE = 2.0, 0.05
"""Ratio of the mass of a link that carries no other to the description's, and how much more that is of the mass of all
links, from which it is told: of none of 72 simulated answers of twelve arms, with CAD wrong by 30 % a link."""


def heavy_ends(model: Model, table: ParameterTable, prediction: PredictionVerdict) -> dict[str, str]:
    """Say which links at the end of a chain come out far heavier than described, as those do that carry a tool.

    Parameters
    ----------
    table : ParameterTable
        Of the answer.
    prediction : PredictionVerdict
        Of the model, on which intervals rest.

    Returns
    -------
    dict from str to str
        A sentence for each, by its name.
    """
    described = masses(model, model.robot.parameters)
    found: dict[str, str] = {}
    links, by = table.links, " by a model that does not predict well" if prediction.missed else ""
    for k in model.robot.end_links:
        link = links[k]
        row, more = link.mass, link.mass.value - described[k]
        if not row.value > _HEAVY_END * described[k] > 0.0 or more < _NOTICEABLE * described.sum():
            continue
        surely = "" if np.isnan(row.lower) else f" ({row.interval}, {row.basis}{'' if row.basis == 'assumed' else by})"
        found[link.name] = (
            f"{link.name} comes out at {few_digits(row.value)} kg{surely} where the description has "
            f"{few_digits(described[k])} kg: if it carried a gripper or a tool, put that into the description."
        )
    return found
