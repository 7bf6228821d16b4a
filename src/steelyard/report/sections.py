"""The parts of the report: the first screen with its verdicts, the sections of tables, and the figures of torques."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from functools import cache
from importlib import metadata
from pathlib import Path
from platform import python_version

import numpy as np
from numpy.typing import NDArray

from steelyard import __version__
from steelyard.errors import InputError
from steelyard.files import file_hash, listed
from steelyard.identification import Identification
from steelyard.identification.missed_terms import undescribed_kinds
from steelyard.recording.formats import content_hash, hashed_log

from .extent import MOST_LOGS, shared_words, short_names, shown_logs
from .html_document import Markup, escape, number, paragraphs, percent, table

__all__ = ["base_parameters", "errors", "hashed_file", "joints", "processing", "provenance", "versions"]

Array = NDArray[np.float64]
MOST_ROWS = 500  # of the table of all logs, which a browser still shows at once
_LIBRARIES = ("numpy", "scipy", "clarabel", "llvmlite", "polars", "lxml", "plotly")


def errors(identification: Identification) -> Markup:
    """Return one table of relative errors for each log."""
    tables = []
    names, shown = short_names(identification), shown_logs(identification)
    for index in shown:
        name, prediction = names[index], identification.predictions[index]
        joints = zip(
            identification.estimate.joint_names,
            prediction.joint_unconstrained_error,
            prediction.joint_feasible_error,
            strict=True,
        )
        rows = [(joint, percent(before), percent(after)) for joint, before, after in joints]
        rows.append(("All joints", percent(prediction.unconstrained_error), percent(prediction.feasible_error)))
        caption = f"{prediction.role.capitalize()}: {name}, {prediction.row_count} rows"
        columns = ("Joint", "Least squares, %", "Feasible, %")
        tables.append(table(caption, columns, rows, identifier=f"errors-{index}", total=True))
    words = escape(shared_words(identification.predictions, shown))
    return Markup(
        "<p>The part of the measured torque that the model leaves unexplained, |τ − τ̂| / |τ|. "
        f"Validation logs were not used in the regression. {words}</p>"
        f'<div class="columns">{"".join(tables)}</div>{_all_logs(identification, names, shown)}'
    )


def _all_logs(identification: Identification, names: Sequence[str], shown: Sequence[int]) -> str:
    """One row for each log, where not all of them have a table of their own."""
    predictions = identification.predictions
    if len(shown) == len(predictions):
        return ""
    order = sorted(range(len(predictions)), key=lambda index: -predictions[index].feasible_error)[:MOST_ROWS]
    rows = [
        (names[k], p.role, str(p.row_count), percent(p.unconstrained_error), percent(p.feasible_error))
        for k, p in ((k, predictions[k]) for k in order)
    ]
    most = len(order) < len(predictions)
    caption = f"The {len(order)} logs of the largest errors" if most else f"All {len(order)} logs by their error"
    columns = ("Log", "Role", "Rows", "Least squares, %", "Feasible, %")
    body = table(caption, columns, rows, identifier="all-logs", texts=[1])
    return f"<details><summary>{caption}</summary>{body}</details>"


def base_parameters(identification: Identification) -> Markup:
    """Return the table of base parameters, weak ones marked."""
    before, after = identification.unconstrained, identification.estimate
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = after.standard_error / np.abs(before.base)
    told = not before.filtered_torque
    rows, muted = [], []
    for index, (name, expression) in enumerate(zip(before.base_names, before.base_expressions, strict=True)):
        unidentifiable = not np.isfinite(before.standard_error[index])
        weak = unidentifiable or expression in identification.weak or name in identification.weak
        mark = f' <span class="mark">{"unidentifiable" if unidentifiable else "weak"}</span>' if weak else ""
        if weak:
            muted.append(index)
        row = [Markup(f"<code>{escape(expression)}</code>{mark}"), number(before.base[index])]
        error = ["∞" if unidentifiable else percent(relative[index])] if told else []
        rows.append([*row, *error, number(after.base[index])])
    columns = ["Base parameter", "Least squares", *(["± %"] if told else []), "Feasible"]
    text = (
        "<p>The combinations of parameters that the motion shows (SI units; symbols: L moment of inertia about the "
        "origin of the link frame, l first moment, m mass, the number is the link's; then those of the joint terms). "
        "± is the standard error relative to the value; it allows for residuals that are correlated in time, so that "
        "twice it covers the truth in 95 of 100 cases where the model is right. Those marked weak or unidentifiable "
        "may have quite different values: a motion that excites them more would show them.</p>"
    )
    caption = f"The {len(rows)} base parameters"
    return Markup(text + table(caption, columns, rows, identifier="base-parameters", muted=muted))


def joints(identification: Identification) -> Markup:
    """Return joint friction, and the values of all the terms at the joints."""
    robot, estimate = identification.model.robot, identification.estimate
    driving = [robot.joints[index] for index in robot.driving_joints]
    absent = np.full(len(driving), np.nan)
    damping = absent if estimate.damping is None else estimate.damping
    friction = absent if estimate.friction is None else estimate.friction
    rows = []
    for joint, name, viscous, coulomb in zip(driving, estimate.joint_names, damping, friction, strict=True):
        units = ("N·m·s/rad", "N·m") if joint.rotates else ("N·s/m", "N")
        rows.append((name, number(viscous), units[0], number(coulomb), units[1]))
    heads = ("Joint", "Damping", "Unit", "Friction", "Unit")
    text = "Viscous damping and Coulomb friction of each joint moving alone, all terms together; – is not modelled."
    if beyond := undescribed_kinds(robot):
        text += f" Friction of other laws ({', '.join(beyond)}) is not counted here; the table of parameters holds it."
    return Markup(
        f"<p>{escape(text)}</p>" + table("Friction of each joint", heads, rows, identifier="friction", texts=[2, 4])
    )


def provenance(identification: Identification) -> Markup:
    """Return the inputs with their hashes, options, versions, and the command that makes the result again."""
    robot = identification.model.robot
    rows: list[tuple[str, str]] = []
    if identification.robot_file is not None:
        rows.append(("Robot file", _hashed(identification.robot_file)))
    if robot.source is not None and robot.source != identification.robot_file:
        rows.append(("Robot description", _hashed(robot.source)))
    rows.append(("Joints, links", f"{robot.dof}, {len(robot.links)}"))
    rows.append(("Terms at the joints", ", ".join(term.kind for term in robot.terms) or "none"))
    for what, logs in (("identification", identification.logs), ("validation", identification.validation_logs)):
        rows += [(f"Log for {what}", _with_hashes(log, identification)) for log in logs[:MOST_LOGS]]
        if len(logs) > MOST_LOGS:
            rows.append((f"Logs for {what}", f"{len(logs) - MOST_LOGS} more, which run.json names with their hashes"))
    rows += [("Reduced before", _hashed(Path(path))) for path in identification.informations[:MOST_LOGS]]
    rows.append(("Least squares", identification.unconstrained.method))
    rows.append(("Answer", identification.estimate.method))
    rows += _flat("Option", identification.options)
    rows += [(name.capitalize() if name in ("steelyard", "python") else name, v) for name, v in versions().items()]
    command = escape(_again(identification))
    return Markup(
        "<p>The hashes are SHA-256 of the files as they are while this page is written; <code>run.json</code> beside "
        "it holds them, and all the options, for programs. The same inputs, options and versions give the same "
        f"numbers. Again:</p><pre><code>{command}</code></pre>"
        + table("Where this comes from", ("What", "Value"), rows, identifier="provenance", texts=[1])
    )


def _hashed(path: Path) -> Markup:
    try:
        digest = hashed_file(path)["sha256"]
    except (OSError, InputError):
        return escape(f"{path}, which is no longer there")
    return Markup(f'{escape(path)} <code class="hash">{digest}</code>')


def _with_hashes(log: str, identification: Identification) -> Markup:
    """A log, each of whose files has a hash, or which was in memory."""
    if log in identification.in_memory:
        return Markup(f'{escape(log)} <code class="hash">{identification.in_memory[log]}</code> (in memory)')
    try:
        files = hashed_log(log)
        told = (f'{escape(one["path"])} <code class="hash">{escape(content_hash(one))}</code>' for one in files)
        return Markup("<br>".join(told))
    except (OSError, InputError):
        return escape(f"{log}, which is no longer there")


def _again(identification: Identification) -> str:
    """The command that makes this result again, or what does where inputs were in memory."""
    robot = identification.robot_file or identification.model.robot.source
    logs = (*identification.logs, *identification.validation_logs)
    if robot is None or any(log in identification.in_memory for log in logs):
        return "steelyard.identify(robot, data, ...)  # the inputs were in memory; the options are below"
    words = ["steelyard", "identify", str(robot), *identification.logs[:MOST_LOGS], *identification.informations]
    more = len(identification.logs) > MOST_LOGS or len(identification.validation_logs) > MOST_LOGS
    for log in identification.validation_logs[:MOST_LOGS]:
        words += ["--validate", log]
    options = identification.options
    if options.get("estimator", "fit") != "fit":
        words += ["--estimator", str(options["estimator"])]
    if identification.plausible is None:
        words += [] if options.get("prior") == "auto" else ["--prior", "none"]
        for name, default in (("prefer", "auto"), ("residual_slack", 5e-4)):
            if options.get(name, default) not in (default, None):
                words += [f"--{name.replace('_', '-')}", str(options[name])]
    elif identification.plausible.validation is None:
        words += ["--prior-weight", repr(float(identification.plausible.prior_weight))]
    words += ["--weights", "none"] if options.get("weights", "joint") is None else []
    words += ["--friction", "auto"] if options.get("friction") == "auto" else []
    words += ["--consistency", str(options["consistency"])] if options.get("consistency") not in (None, "full") else []
    words += ["--output", "result"]
    return shlex.join(words) + ("  # and the other logs, which run.json names" if more else "")


def versions(libraries: Sequence[str] = _LIBRARIES) -> dict[str, str]:
    """Return the versions of Steelyard, of Python and of libraries, by name; by default those of an identification."""
    return {
        "steelyard": __version__,
        "python": python_version(),
        **{name: _version(name) for name in libraries},
    }


@cache  # read from files, of which a process has imported what they tell
def _version(library: str) -> str:
    return metadata.version(library)


def hashed_file(path: Path) -> dict[str, str]:
    """Return the path of a file and the SHA-256 hash of its content."""
    return {"path": str(path), "sha256": file_hash(path)}


def _flat(prefix: str, options: dict[str, object]) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for name, value in options.items():
        if isinstance(value, dict):
            rows += _flat(f"{prefix} {name}", value)
        else:
            rows.append((f"{prefix} {name}", "none" if value is None else str(value)))
    return rows


def columns(identification: Identification) -> Markup:
    """Return what the columns of the logs were understood to be."""
    parts: list[str] = []
    for index, (layout, logs) in enumerate(identification.columns()):
        title = f"Columns of {listed(logs, MOST_LOGS)}"
        rows = layout.rows()
        parts.append(table(title, layout.heads, rows, identifier=f"columns-{index}", texts=range(len(layout.heads))))
        parts.append(paragraphs(layout.guesses))
    return Markup("".join(parts) or "<p>The data was in memory, without names of columns.</p>")


def processing(identification: Identification) -> Markup:
    """Return how the logs were processed, with the evidence where the data decided."""
    options = identification.options.get("processing") or {}
    assert isinstance(options, dict)
    chosen = identification.cutoff_choices
    rows = [(str(name), str(value)) for name, value in options.items()]
    parts: list[str] = []
    if rows:
        parts.append(
            table("Options of [processing]", ("Option", "Value"), rows, identifier="processing-options", texts=[1])
        )
    else:
        parts.append("<p>The logs were processed with the defaults.</p>")
    for index, (log, choice) in enumerate(chosen):
        parts.append(
            f"<p>{escape(choice.explanation)}</p><p><b>{escape(log)}</b>: {escape(choice.remark)}</p>"
            f'<div class="plots">{choice.svg()}</div>'
            + table(f"Evidence: {log}", choice.titles, choice.table, identifier=f"cutoff-{index}")
        )
    return Markup("".join(parts))
