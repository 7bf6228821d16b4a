"""Signs that a log was read wrongly: mistakes that would explain its torques, and masses that no robot has."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from steelyard.display import few_digits
from steelyard.dynamics import Model
from steelyard.estimators.marginal_likelihood import body_priors
from steelyard.estimators.physical_prior import PhysicalPrior
from steelyard.feasibility.constraints import Constraint
from steelyard.recording import LogColumns, Samples
from steelyard.recording.correction import correction_settings
from steelyard.recording.formats import LogFiles
from steelyard.recording.recognition import Layout
from steelyard.regression import Information
from steelyard.regression.body_change import BodyChange, body_change
from steelyard.regression.time_blocks import TimeBlocks
from steelyard.robot import RobotFile

from .given import GivenLog, GivenSamples
from .log_reader import LogReader
from .mistakes import MOTION_UNITS, TOO_MANY_JOINTS, Hypothesis, find_mistakes
from .parameter_table import MANY_PARAMETERS, ParameterTable
from .wrong_scale import masses

__all__ = ["change_in_log", "copies_among", "heavy_ends", "mistakes_in_logs", "told_by_rows"]

SHORTEST_DRIFT = 60.0
"""s of a log below which no drift of friction is looked for: gears warm up in minutes, and what changes in seconds is
the motion."""
_SEARCHED = 3
"""Logs for which all hypotheses are tried; for the others only those that were found in these. A search takes a second
or two, and logs of one robot mostly share their mistakes."""
_WORST = 12
"""Logs that are looked at, the worst predicted of all: a look takes 10 ms where nothing is wrong."""
_DENSE_ROWS = 4000
"""Rows in the middle of a log by which a delay is told where the samples at hand are too far apart."""


def copies_among(
    logs: Sequence[tuple[str, str, Information]], contents: Mapping[str, Hashable] = MappingProxyType({})
) -> dict[int, str]:
    """Find logs that hold the very rows of one before them, and say of each what that does to the answer.

    Parameters
    ----------
    logs : sequence of (str, str, Information)
        Name, role and reduction of each log, those of the fit first. Sums of products that are the same to ten digits
        are those of the same rows: noise alone makes others different.
    contents : mapping, optional
        What tells the contents of logs, by name; logs of the same contents are copies as well. Logs that were
        processed for themselves may have other rows left out, which changes their sums.

    Returns
    -------
    dict
        The sentence by the index of the log.
    """
    first: dict[Hashable, int] = {}
    found = {}
    for index, (name, role, information) in enumerate(logs):
        rows = told_by_rows(information)
        keys = [rows, contents[name]] if name in contents else [rows]
        before = min(first.setdefault(key, index) for key in keys)
        if before == index or not information.count:
            continue
        other, other_role, _ = logs[before]
        same = "the rows of this log" if other == name else f"the rows of {other}"
        if role != other_role:
            found[index] = f"{name}: {same} were used in the fit, so that its error is no test of a prediction."
        else:
            harm = "twice, so that intervals are too narrow" if role == "identification" else "once"
            found[index] = f"{name}: {same} were given twice, and count {harm}."
    return found


def told_by_rows(information: Information) -> Hashable:
    """Return what is the same for Informations of the very same rows, and for no others where there is noise."""
    # Sums of squares of one mixture of all columns; the last digits depend on how blocks were joined.
    mixed = [factor.triangle @ np.linspace(1.0, 2.0, len(factor.triangle)) for factor in information.factors]
    return tuple((f.count, f"{one @ one:.9e}") for f, one in zip(information.factors, mixed, strict=True))


def mistakes_in_logs(
    reader: LogReader,
    file: RobotFile,
    constraints: Sequence[Constraint],
    logs: Mapping[str, GivenLog],
    samples: Mapping[str, Samples],
    errors: Mapping[str, float],
    say: Callable[[str], None],
    predicted_well: Collection[str] = (),
    known: PhysicalPrior | None = None,
) -> dict[str, tuple[Hypothesis, ...]]:
    """Look for mistakes in logs, those that are predicted worst first.

    Parameters
    ----------
    reader : LogReader
        That has read them.
    file : RobotFile
    constraints : sequence of Constraint
        Those of the user.
    logs : mapping from str to GivenLog
        By their names.
    samples : mapping from str to Samples
        Of each log, thinned out.
    errors : mapping from str to float
        How badly each of them is predicted: the largest relative error of its joints.
    say : callable
        Told when a search begins.
    predicted_well : collection of str
        Logs on which only what costs little is tried.
    known : PhysicalPrior, optional
        What is known of the robot with these constraints; gathered by default.

    Returns
    -------
    dict from str to tuple of Hypothesis
        What is probably wrong with a log, with what robot.toml must say; logs without a finding are not in it.
    """
    model, names = reader.model, list(reader.model.robot.joint_names)
    if model.dof > TOO_MANY_JOINTS:
        return {}
    shared: list[Hypothesis] = []
    found: dict[str, tuple[Hypothesis, ...]] = {}
    searches, priors = 0, body_priors(model, constraints, known)
    for log in sorted(errors, key=lambda name: -errors[name])[:_WORST]:

        def dense(log: str = log) -> Samples | None:
            return reader.dense(logs[log], _DENSE_ROWS)

        def begin(log: str = log) -> bool:
            nonlocal searches
            if log in predicted_well:
                return False
            searches += 1
            if searches <= _SEARCHED:
                say(f"what may be wrong with {log}?")
            return searches <= _SEARCHED

        mistakes = find_mistakes(model, samples[log], dense=dense, known=shared, begin=begin, priors=priors)
        # A motion that no robot makes says nothing else.
        if not mistakes or (reader.units_are_suspect and mistakes[0].kind not in MOTION_UNITS):
            continue
        shared.extend(hypothesis for hypothesis in mistakes if hypothesis not in shared)
        layout = _layout(logs[log], reader.columns, model)
        mended = [replace(one, settings=correction_settings(one.correction, file, names, layout)) for one in mistakes]
        stated = tuple(one for one in mended if one.settings)  # what no line mends is no mistake that anybody makes
        if stated:
            found[log] = stated
    return {log: found[log] for log in errors if log in found}


def _layout(log: GivenLog, columns: LogColumns, model: Model) -> Layout | None:
    if isinstance(log, GivenSamples):
        return None
    layout = LogFiles(log, columns).layout(list(model.robot.joint_names))
    return layout.of_joints(model.robot.position_units)


_HEAVY_END, _NOTICEABLE = 2.0, 0.05
"""Ratio of the mass of a link that carries no other to the description's, and how much more that is of the mass of all
links, from which it is told: of none of 72 simulated answers of twelve arms, with CAD wrong by 30 % a link."""


def heavy_ends(model: Model, table: ParameterTable) -> tuple[str, ...]:
    """Say which links at the end of a chain come out far heavier than described, as those do that carry a tool.

    Parameters
    ----------
    model : Model
    table : ParameterTable
        Of the answer.

    Returns
    -------
    tuple of str
        A sentence for each.
    """
    described = masses(model, model.robot.parameters)
    found, links = [], table.links
    for k in model.robot.end_links:
        link = links[k]
        row, more = link.mass, link.mass.value - described[k]
        if not row.value > _HEAVY_END * described[k] > 0.0 or more < _NOTICEABLE * described.sum():
            continue
        surely = "" if np.isnan(row.lower) else f" ({few_digits(row.lower)} to {few_digits(row.upper)} kg, {row.basis})"
        found.append(
            f"{link.name} comes out at {few_digits(row.value)} kg{surely} where the description has "
            f"{few_digits(described[k])} kg: if it carried a gripper or a tool, put that into the description."
        )
    return tuple(found)


def change_in_log(model: Model, blocks: TimeBlocks, kept: Samples) -> BodyChange | None:
    """Tell whether a link at the end of a chain picks up or puts down a body in the course of a log.

    Parameters
    ----------
    model : Model
    blocks : TimeBlocks
        Of the rows of the log, with the base parameters of the model.
    kept : Samples
        Rows of all the log.
    """
    if kept.t is None or not len(kept.t) or model.parameter_count > MANY_PARAMETERS:
        return None
    base, robot = model.base_parameters(), model.robot
    ends = {robot.link_names[k]: base.K[:, np.asarray(model.link_columns[k])] for k in robot.end_links}
    return body_change(blocks, base.names, ends, float(np.min(kept.t)), float(np.max(kept.t)))
