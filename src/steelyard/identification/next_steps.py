"""A summary of an identification in a sentence or two, and the next steps that are most worth taking."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from steelyard.display import capital, few_digits
from steelyard.dynamics import RotorInertia
from steelyard.excitation.motion_limits import MotionLimits
from steelyard.feasibility.constraints import MeasuredMass, TotalMass
from steelyard.files import listed
from steelyard.recording.diagnosis import remedy_of
from steelyard.recording.survey import JUMPED
from steelyard.regression import Information, least_squares

from .counterbalanced_joint import counterbalanced_joint
from .doubts import heavy_ends
from .error_causes import FRICTION, LEAST, LOGS, MOTION, OSCILLATION, RIPPLE, ZERO, ErrorCause, error_causes
from .mistakes import Hypothesis
from .parameter_table import parameter_sizes
from .prediction_verdict import POOR_JOINT, UNTESTED, WRONG, said_of
from .result import Identification
from .unlogged_torques import told_by_unlogged_torques

__all__ = ["NextStep", "excite_command", "found", "next_steps"]

MOST_STEPS = 3
MOST_NAMED = 3
LONGEST_NAME = 30  # characters of a sum of parameters
PATTERN = 0.5
"""Part of the mean square of the residuals that is white, below which most of what is left follows a pattern."""
LARGE = 0.08
"""Relative error of a joint, noise aside, above which its pattern is worth a term: as much as counts as good."""
SURE_DELAY = 30.0
"""Gain (logarithm of the odds) up to which a delay comes behind causes that make much of the error. Friction that a
model lacks near rest looked like a delay of 7.2 ± 3 ms in a simulated Z1, with a gain of 15; 40 ms gain 200."""
AROUND = 0.1
"""s before and after an event that are left out with it: filters spread what it does to the motion."""
MOST_SPANS = 8
MOST_LOGS = 8
EXPLAINED = 0.3
"""Part of the squared error of a joint that a cause must take away for the joint to count as explained."""
LIGHT = 0.01
"""Part of the described mass of the links that a branch may have before its being there twice is worth a step."""
NAMES = {
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "offset": "constant offsets of the torques",
    "rotor_inertia": "the inertia of rotors",
    "spring": "springs at the joints",
}


@dataclass(frozen=True)
class NextStep:
    """Something that is worth doing.

    Attributes
    ----------
    action : str
        What to do, a sentence.
    reason : str
        What was found that speaks for it, a sentence or more.
    code : str
        The command, or the lines of ``robot.toml``, that do it; words in capitals are to be filled in.
    language : {"console", "toml"}
        What `code` is.

    Examples
    --------
    >>> step = NextStep("Weigh it.", "Its mass is assumed.", "[constraints]", "toml")
    >>> print(step)
    Weigh it. Its mass is assumed.
      [constraints]
    """

    action: str
    reason: str
    code: str
    language: Literal["console", "toml"]

    def __str__(self) -> str:
        lines = self.code.splitlines()
        return "\n".join([f"{self.action} {self.reason}", *(f"  {line}" if line else "" for line in lines)])


def found(identification: Identification) -> tuple[str, ...]:
    """Return what was found about the robot, one sentence or two."""
    prediction, told = identification.prediction, identification.parameters
    if prediction.word == "wrong":
        return (
            "A robot with these numbers can exist, but it does not move like this one: do not use them before the "
            "cause is found.",
        )
    sentences = []
    if told is not None:
        total = told["total mass"]
        mass = f"The moving links weigh {few_digits(total.value)} kg in all"
        if told.confidence is None:
            sentences.append(f"{mass}; no number has an interval, because the torques were filtered.")
        else:
            ends = f", {total.interval}"
            by = "data and physics" if told.has_physics else "the data"
            sentences.append(
                f"{mass} ({total.basis}{ends if told.has_physics or np.isfinite(total.upper) else ''}): of "
                f"{len(told)} numbers {told.count('measured')} are measured by the data alone, "
                f"{told.count('bounded')} are bounded by {by}, and {told.count('assumed')} are assumed."
            )
        if identification.caveat:
            sentences.append(identification.caveat)
    verdict = identification.verdict
    before, after = identification.unconstrained.relative_error, identification.estimate.relative_error
    if verdict.feasible is False:
        names = [violation.block for violation in verdict.violations]
        which = f" ({listed(names, MOST_NAMED)})" if names else ""
        left = f"{after:.2%} of the torques of the same data unexplained"
        compared = f" instead of {before:.2%}" if f"{before:.2%}" != f"{after:.2%}" else ", just as much"
        sentences.append(
            f"Plain least squares found a robot that cannot exist{which}. One that can exist leaves {left}{compared}."
        )
    if identification.missed_by_description:
        sentences.append(identification.missed_by_description)
    return tuple(sentences)


def next_steps(identification: Identification) -> tuple[NextStep, ...]:
    """Return what is most worth doing next, at most three things, the most valuable first.

    A mistake comes first, since nothing else counts before it is mended; then what makes the prediction better; then
    what makes more numbers known; then what shows that the answer holds elsewhere, and what it is good for.

    Returns
    -------
    tuple of NextStep
        With the command or the lines of ``robot.toml`` that do it.
    """
    steps: list[NextStep] = []
    for step in _steps(identification):
        if step.code not in [other.code for other in steps]:
            steps.append(step)
        if len(steps) == MOST_STEPS:
            break
    return tuple(steps)


def _steps(identification: Identification) -> Iterator[NextStep]:
    other = list(_other_estimator(identification))
    yield from other
    yield from _changes(identification)
    yield from _springs(identification)
    mistakes = list(_mistakes(identification))
    sure, doubtful = ([step for is_sure, step in mistakes if is_sure is wanted] for wanted in (True, False))
    yield from sure
    yield from _scale(identification)
    yield from _jumps(identification)
    yield from _false_torques(identification)
    yield from _events(identification)
    yield from _drifts(identification)
    if identification.prediction.word == "wrong" or identification.changes or identification.scale:
        if sure or identification.changes or identification.scale or other:
            yield from doubtful
        else:
            yield from _remaining(identification, [], doubtful)
            yield _doctor(identification)
        return  # what the motion shows, and what is assumed, means nothing of a wrong model, or of none
    yield from _counterbalance(identification)
    yield from _left_out(identification)
    weak = list(_weak(identification))
    yield from _remaining(identification, weak, doubtful)
    yield from _intervals(identification)
    yield from _weighing(identification)
    if weak:
        yield _motion(identification, "; ".join(weak))
    yield from _confirmation(identification)


def _robot(identification: Identification) -> str:
    file = identification.robot_file or identification.model.robot.source
    return "ROBOT" if file is None else shlex.quote(str(file))


def _paths(identification: Identification, logs: Iterable[str]) -> list[str]:
    """Return the paths of the logs that are files, quoted for a shell."""
    return [shlex.quote(log) for log in logs if log not in identification.in_memory]


def _predicted(identification: Identification) -> Iterable[str]:
    """Return the logs of which the errors are."""
    has_others = "validation log" in identification.prediction.source
    return identification.validation_logs if has_others else identification.logs


def _doctor_command(identification: Identification, logs: Iterable[str]) -> str:
    """Examine the first of some logs."""
    (log, *_) = _paths(identification, logs) or ["LOG"]
    return f"steelyard doctor {log} {_robot(identification)}"


def _shares(identification: Identification, log: str, mistake: Hypothesis) -> bool:
    """Tell whether a log may have a mistake that was found in another one.

    What `[log]` says is of the columns, and false of a log without the mistake; the rest is of the robot, as which all
    logs are, however little some show of it.
    """
    own = identification.mistakes.get(log, ())
    return "log" not in mistake.settings or any(one.kind == mistake.kind for one in own)


def _changes(identification: Identification) -> Iterator[NextStep]:
    """A body that is there in one part of a log only, so that the answer is that of no robot."""
    for log, change in identification.changes.items():
        robot = _robot(identification)
        reason = f"{change.sentence(log)} The answer is that of neither part, whose friction it distorts as well."
        if len(identification.logs) + len(identification.validation_logs) == 1:
            yield NextStep(
                "Identify the part of the log before or after the change by itself.",
                f"{reason} These lines keep the longer one; {change.weighing(robot)}",
                f"[processing]\ntrim = {change.trim}",
                "toml",
            )
        else:
            yield NextStep(
                "Cut the log where the robot changes, and identify logs with and without the body apart.",
                f"{reason} The two parts, in files of their own, tell what was carried.",
                f"steelyard payload {robot} UNLOADED LOADED",
                "console",
            )


def _mistakes(identification: Identification) -> Iterator[tuple[bool, NextStep]]:
    """Yield mistakes of logs, and whether they come before all that a model may lack: small delays do not."""
    everything = (*identification.logs, *identification.validation_logs)
    for log, hypotheses in identification.mistakes.items():
        first, *others = hypotheses
        reason = f"{first.statement}, in {log}: mended, {first.evidence}."
        if others:
            reason += f" The log cannot tell it from: {'; '.join(other.statement for other in others[:MOST_NAMED])}."
        carrying = {
            log for log, found in identification.mistakes.items() if any(one.kind == "payload" for one in found)
        }
        empty = [one for one in dict.fromkeys(everything) if one not in carrying]
        if first.kind == "payload" and empty:
            # A line of robot.toml counts for every log: it would be false of those without the payload.
            words = ((empty[0], "UNLOADED"), (log, "LOADED"))
            unloaded, loaded = ((_paths(identification, [one]) or [word])[0] for one, word in words)
            step = NextStep(
                "Identify logs with and without the payload apart, and weigh what is carried.",
                f"{reason} No payload was found in {listed(empty, MOST_NAMED)}: these logs are not those of one robot.",
                f"steelyard payload {_robot(identification)} {unloaded} {loaded}",
                "console",
            )
        elif without := [one for one in dict.fromkeys(everything) if not _shares(identification, one, first)]:
            step = NextStep(
                "Mend that log, or robot.toml if it is so in all logs, and identify again.",
                f"{reason} It was not found in {listed(without, MOST_NAMED)}, and a line of robot.toml "
                "counts for every log.",
                first.toml.strip(),
                "toml",
            )
        elif first.toml:
            step = NextStep("Mend robot.toml, and identify again.", reason, first.toml.strip(), "toml")
        else:
            command = _doctor_command(identification, [log])
            step = NextStep("See whether it is so, and identify again.", reason, command, "console")
        yield first.kind != "delay" or first.gain > SURE_DELAY, step


def _scale(identification: Identification) -> Iterator[NextStep]:
    """Torques or times of another size than the robot needs, so that all masses or inertias are wrong by one factor."""
    scale = identification.scale
    if scale is not None:
        words = "GAIN is N·m per unit of the columns."
        if scale.of == "times":
            words = "No line of robot.toml mends the stamps of a log."
        mends = "With the line below the log agrees with the description." if scale.settings else words
        yield NextStep(
            f"Check the scale of the {scale.of}, and identify again.", f"{scale.sentence} {mends}", scale.toml, "toml"
        )


def _jumps(identification: Identification) -> Iterator[NextStep]:
    """Positions that jump, of which filters make a push that no torque explains."""
    for said in [remark for remark in identification.remarks if JUMPED in remark][:1]:
        yield NextStep(
            "Cut the log where a position jumps, and identify the pieces that are right as logs of their own.",
            said,
            _doctor_command(identification, [*identification.logs, *identification.validation_logs]),
            "console",
        )


def _false_torques(identification: Identification) -> Iterator[NextStep]:
    """Rows of torques that are clipped or stand still, which no model explains and an option leaves out.

    A torque that stood still for 1 s of 10 s changed the torques of an arm of three joints by 7 to 15 %.
    Of copied rows and of joints that stick the remarks tell: to leave out the 15 copies in a real log of a Kinova Gen3
    changes its error of 18.7 % by 0.1 %.
    """
    for option, which in (("stuck_torque", "whose torque stands still"), ("saturation", "of clipped torques")):
        said = [remark for remark in identification.remarks if remedy_of(remark) == option]
        if said and not (option == "saturation" and identification.prediction.word == "good"):
            more = f" The remarks name {len(said) - 1} more." if len(said) > 1 else ""
            yield NextStep(
                f"Leave out the rows {which}, and identify again.",
                f"{said[0]}{more}",
                f"[processing]\n{option} = true",
                "toml",
            )


def _events(identification: Identification) -> Iterator[NextStep]:
    """Rows of an impact, which are no motion of the robot alone."""
    few = identification.prediction.few_rows
    if not few:
        return
    lines = []
    logs = list(dict.fromkeys(one.log for one in few))
    for log in logs[:MOST_LOGS]:
        spans: list[list[float]] = []
        for begin, end in sorted(span for one in few if one.log == log for span in one.times):
            if spans and begin - AROUND <= spans[-1][1]:
                spans[-1][1] = max(spans[-1][1], end + AROUND)
            else:
                spans.append([begin - AROUND, end + AROUND])
        told = ", ".join(f"{begin:.2f} to {end:.2f}" for begin, end in spans[:MOST_SPANS])
        more = f" and {len(spans) - MOST_SPANS} more" if len(spans) > MOST_SPANS else ""
        lines.append(f"# torques are empty in {log} at t = {told} s{more}")
    if len(logs) > MOST_LOGS:
        lines.append(f"# and in {len(logs) - MOST_LOGS} more logs, which run.json names")
    yield NextStep(
        "Leave out the moments at which the arm met something or a sensor erred, and identify again.",
        f"{said_of(few[:1])} Empty torques are left out; in Python, steelyard.estimators.robust_information gives such "
        "rows less weight.",
        "\n".join(["[log]", 'missing = "fill"', *lines]),
        "toml",
    )


def _drifts(identification: Identification) -> Iterator[NextStep]:
    """Friction that changes with time, of which the answer has the mean."""
    if identification.drifts:
        yield NextStep(
            "Warm the robot up before the log begins, or let friction depend on a temperature.",
            f"{identification.drifts[0]} The friction of the answer is that of this log as a whole, not that of the "
            "cold or the warm robot. The term stands in the place of viscous and coulomb; where no temperature was "
            "logged, the column of time may stand for it.",
            "\n".join(
                [
                    "[[terms]]",
                    'kind = "friction_by_channel"',
                    'channel = "temperature"',
                    "range = [LOWEST, HIGHEST]",
                    "",
                    "[log]",
                    'channels = { temperature = "COLUMN" }',
                ]
            ),
            "toml",
        )


def _doctor(identification: Identification) -> NextStep:
    return NextStep(
        "Look for what is wrong with the log.",
        f"{identification.prediction.relative_error:.0%} of the torques are left unexplained, and no single mistake "
        "that was tried explains it.",
        _doctor_command(identification, _predicted(identification)),
        "console",
    )


def _other_estimator(identification: Identification) -> Iterator[NextStep]:
    """Return where the rows that an estimator made of the logs mislead, and the rows as measured do not."""
    rows, said = identification.information, identification.prediction
    if said.word not in ("poor", "wrong") or not rows.torque_factors:
        return
    plain = replace(
        Information.of(rows), factors=rows.torque_factors, torque_factors=(), covariance=None, batch_means=()
    )
    error = plain.relative_error(least_squares(plain).base)
    if error < 0.5 * said.relative_error:
        logs = " ".join(_paths(identification, identification.logs)) or "LOG"
        yield NextStep(
            "Take the default estimator.",
            f"Least squares of the rows as measured leave {error:.0%} of their torques unexplained, this answer "
            f"{said.relative_error:.0%}: the estimator's own rows give weight to errors of the model or of the motion.",
            f"steelyard identify {_robot(identification)} {logs} --output DIR",
            "console",
        )


def _weak(identification: Identification) -> Iterator[str]:
    """Return what the motion hides, a clause each."""
    unlogged = told_by_unlogged_torques(identification.model, identification.information)
    hidden = tuple(name for name in identification.information.unidentifiable if name not in unlogged)
    shown = _shown_to_be_small(identification)
    weak = [name for name in identification.weak if name not in (*hidden, *unlogged) and name not in shown]
    count = len(identification.unconstrained.base)
    if hidden:
        yield f"the logs do not show {len(hidden)} of {count} base parameters at all, {_named(hidden)}"
    if weak:
        are, their = ("are", "their standard errors") if len(weak) > 1 else ("is", "its standard error")
        yield f"{len(weak)} of {count} base parameters {are} smaller than twice {their}, {_named(weak)}"


def _shown_to_be_small(identification: Identification) -> set[str]:
    """Return base parameters whose intervals are narrower than what links and joints of such sizes have.

    An offset of zero, or a product of inertia of a symmetric link, is smaller than twice its standard error on every
    motion: the log has shown that it is small, and a better one would show it again.
    """
    estimate, told = identification.estimate, identification.unconstrained
    if estimate.parameters is None:
        return set()
    scales = None if identification.plausible is None else identification.plausible.term_deviations
    sizes = parameter_sizes(identification.feasible_set.link_columns, np.asarray(estimate.parameters), scales)
    own = sizes[[estimate.parameter_names.index(name) for name in told.base_names]]
    narrow = 2.0 * told.standard_error <= own
    return {expression for expression, small in zip(told.base_expressions, narrow, strict=True) if small}


def _motion(identification: Identification, reason: str) -> NextStep:
    return NextStep(
        "Record a motion that shows more.",
        f"{capital(reason)}.",
        excite_command(identification),
        "console",
    )


def excite_command(identification: Identification) -> str:
    """Return the command that designs a motion for the robot, with a file of limits where it asks for one.

    The torques of the motion are those of the answer, unless that is wrong: a description has no friction and may leave
    out a gripper. That of a Gen3 foretold 20 N·m at the second joint, of 39 that it may have; the answer has 30.
    """
    limits = "" if MotionLimits.suffice(identification.model.robot) else " --limits LIMITS.toml"
    is_known = identification.prediction.word != "wrong" and identification.estimate.parameters is not None
    estimate = " --estimate DIR" if is_known else ""
    return f"steelyard excite {_robot(identification)}{limits}{estimate} --output motion"


def _remaining(identification: Identification, weak: list[str], mistakes: Sequence[NextStep]) -> Iterator[NextStep]:
    """What takes most of the error away, where something surely does, and what to do where nothing that was tried does.

    A joint that makes up little of the error, and makes the verdict a poor one all the same, comes behind; so do
    mistakes that may be images of what the model lacks.
    """
    causes = error_causes(identification)
    told = identification.prediction
    if causes and told.word == "wrong":  # a model that is wrong of the motion of the fit, too, lacks no motion
        causes = tuple(one for one in causes if one.kind != MOTION or one.left_of(told.relative_error)[0] <= WRONG)
    steps = [(cause.share, _without(identification, cause, weak)) for cause in causes or ()]
    steps += [(LEAST, step) for step in mistakes]  # of which the numbers tell more than the error
    # Of a body that the description leaves out the numbers are wrong, whether or not the error shows it.
    steps += [(LEAST, step) for step in _carried(identification)]
    steps += _unexplained(identification, causes) if causes is not None else []
    yield from (step for _, step in sorted(steps, key=lambda one: -one[0]))


def _without(identification: Identification, cause: ErrorCause, weak: Sequence[str] = ()) -> NextStep:
    """How to take a cause of the error away, and how much that brings."""
    told = identification.prediction
    left, low, high = cause.left_of(told.relative_error)
    size = f"the error of {told.relative_error:.1%} would be some {left:.1%} ({low:.1%} to {high:.1%})"
    if cause.kind == MOTION:
        missed = (
            f"Where the same motion takes part in the fit, the error of {told.relative_error:.1%} is {left:.1%}: "
            "at best a motion that shows more takes the rest away"
        )
        return _motion(identification, "; ".join([missed, *weak]))
    by = told.joint_error**2 * cause.joint_shares
    most_first = [k for k in np.argsort(-np.nan_to_num(by), kind="stable") if cause.joint_shares[k] > 0.0]
    of_joints = [f"{told.joint_names[k]} ({cause.joint_shares[k]:.0%}" for k in most_first]
    whole = [f"{one}{'' if k else ' of its squared error'})" for k, one in enumerate(of_joints)]
    where = f"most of all at {listed(whole, MOST_NAMED)}"
    tried = "as fits say that leave out stretches of the logs in turn" if cause.kind != OSCILLATION else ""
    robot = _robot(identification)
    logs = " ".join(_paths(identification, identification.logs)) or "LOG..."
    if cause.kind == LOGS:
        return _apart(identification, f"{size}, {where}, {tried}")
    if cause.kind == OSCILLATION:
        lowest, highest = (few_digits(one, 2) for one in cause.band)
        return NextStep(
            "Keep an oscillation out of the torques, or stop it.",
            f"Torques swing at {lowest} to {highest} Hz, faster than the motion, and the positions, as they are "
            "filtered, do not explain it: a stand or a base may sway, or a joint give way. "
            f"Without that {size} or less, {where}. A stiff mounting or a calmer motion stops it; the line below "
            "filters the torques, and the model alike.",
            f"[processing]\ntorque_cutoff = {few_digits(cause.cutoff, 2)}",
            "toml",
        )
    if cause.kind == ZERO:
        slopes = cause.slopes or {}
        lines = [
            f"# the zero of {told.joint_names[k]} in {log} moves by {few_digits(float(own[k]), 2)} "
            f"{told.units[k]} a second"
            for log, own in slopes.items()
            for k in most_first
            if own[k] != 0.0
        ]
        return NextStep(
            "Take the drift of the torques' zero off the columns, and let sensors warm up before the next log.",
            f"Torques have a zero that moves with time: without that {size}, {where}, {tried}.",
            "\n".join(lines[:MOST_LOGS]),
            "toml",
        )
    if cause.kind in (FRICTION, RIPPLE):
        what = (
            "Friction of another form than viscous and Coulomb's"
            if cause.kind == FRICTION
            else "A ripple with position"
        )
        return NextStep(
            "Let the logs choose the friction.",
            f"{what} explains much of what is left: with it {size}, {where}, {tried}. The command adds the laws that "
            "stand in a fit of all joints together.",
            f"steelyard identify {robot} {logs} --friction auto --output DIR",
            "console",
        )
    why = identification.why_no_rotors if cause.kind == RotorInertia.kind else ""
    return NextStep(
        "Add a term to the model.",
        f"The model lacks {NAMES[cause.kind]}: with it {size}, {where}, {tried}. Where robot.toml states no terms yet, "
        "state viscous, coulomb and offset beside it."
        + (f" Before, it was tried and not taken: {why}." if why else ""),
        f'[[terms]]\nkind = "{cause.kind}"',
        "toml",
    )


def _apart(identification: Identification, size: str) -> NextStep:
    """What to do with logs that no robot explains together; the one that is predicted worst is set against the rest."""
    names = list(_predicted(identification))
    errors = {one.name: one.feasible_error for one in identification.predictions}
    odd = max(names, key=lambda name: errors.get(name, 0.0))
    rest = [name for name in identification.logs if name != odd]
    first, second = (" ".join(_paths(identification, own)) or "LOG..." for own in (rest, [odd]))
    robot = _robot(identification)
    return NextStep(
        "See what differs between the logs.",
        f"No robot explains {listed(rest, MOST_NAMED)} and {odd} together as well as one explains each: with "
        f"parameters of its own for each log {size}. One may have had a payload or a tool, colder gears or another "
        "zero of a sensor. The last command names the link or the joint that differs.",
        f"steelyard identify {robot} {first} --output first\nsteelyard identify {robot} {second} --output second\n"
        "steelyard compare first second",
        "console",
    )


def _unexplained(identification: Identification, causes: Sequence[ErrorCause]) -> list[tuple[float, NextStep]]:
    """Return the part of the squared error of a joint that nothing explains, and what to do; none if it is small."""
    told = identification.prediction
    if told.is_usable:  # noise that lasts, as of sound sensors, is no pattern of a joint
        return []
    explained = np.max([cause.joint_shares for cause in causes], axis=0, initial=0.0)
    errors = np.where(np.nan_to_num(told.whiteness, nan=1.0) < PATTERN, told.joint_model_error, 0.0)
    shares = np.nan_to_num(told.joint_error**2) / np.nansum(told.joint_error**2)
    matters = (explained < EXPLAINED) & (((shares > LEAST) & (errors > LARGE)) | (errors > POOR_JOINT))
    if not matters.any():
        return []
    worst = int(np.argmax(np.where(matters, shares, 0.0)))
    others = np.delete(told.joint_model_error, worst)
    far_better = others.size and np.all(others < 0.5 * errors[worst])
    alone = ", and the other joints are predicted far better" if far_better else ""
    step = NextStep(
        f"See whether the torques of {told.joint_names[worst]} are right.",
        f"What is left there is {errors[worst]:.0%} of its torques, {told.joint_error[worst]:.2g} "
        f"{told.units[worst]}, and follows a pattern ({told.whiteness[worst]:.0%} of it is white){alone}. Of all that "
        "was tried (other friction, rotors, springs, ripples, a moving zero, oscillations) nothing explains much of "
        "it. A known weight on the arm at rest, or the current of the motor beside the torque, shows what a sensor "
        "misses.",
        _doctor_command(identification, _predicted(identification)),
        "console",
    )
    return [(float(shares[worst]), step)]


def _counterbalance(identification: Identification) -> Iterator[NextStep]:
    """A counterbalance that a link took on as a weight."""
    found = counterbalanced_joint(identification)
    if found is None:
        return
    robot = identification.model.robot
    joint, link = robot.joint_names[found.joint], robot.link_names[found.link]
    what, instead = (
        f"{link} comes out at {found.found:.3g} kg where {found.known:.3g} kg are known beforehand",
        f"{link} would weigh {found.with_term:.3g} kg",
    )
    if found.turned:
        what = f"The weight of {link} comes out on the other side of the axis of {joint} than it is known to be"
        instead = f"{link} would have {found.with_term:.3g} kg on the side where it is known to have {found.known:.3g}"
    yield NextStep(
        f"State the counterbalance of {joint}, if it has one.",
        f"{what}. With a torque at "
        f"{joint} that goes as the sine of its position, up to {found.torque:.2g} N·m, as a spring, a gas spring or a "
        f"hydraulic counterbalance has it, {instead}. Fits with links that near to "
        f"what is known would leave {found.share:.0%} less of the squared error of {joint} with it than without, on "
        "stretches of the logs that are left out in turn. Where robot.toml states no terms yet, state viscous, coulomb "
        "and offset beside it.",
        f'[[terms]]\nkind = "counterbalance"\njoints = [{found.joint + 1}]\n'
        f"fixed = FIXED # m from the axis of {joint} to one of its ends\n"
        f"moving = MOVING # m from there to its other end\n"
        f"aligned = ALIGNED # rad, where its ends are nearest to each other; by these logs near {found.aligned:.1f}"
        " if it pulls",
        "toml",
    )


def _springs(identification: Identification) -> Iterator[NextStep]:
    """Springs of the description that the model leaves out, where it does not predict well: they look like mistakes."""
    robot = identification.model.robot
    sprung = [k for k, index in enumerate(robot.driving_joints, 1) if robot.joints[index].has_spring]
    if not sprung or identification.prediction.word == "good" or any(term.kind == "spring" for term in robot.terms):
        return
    several = len(sprung) > 1
    named = listed([robot.joint_names[k - 1] for k in sprung], MOST_NAMED)
    yield NextStep(
        f"Add the spring{'s' * several} of the description to the model.",
        f"The description has {'springs' if several else 'a spring'} at {named}, which the model leaves out and the "
        "robot may have. Where robot.toml states no terms yet, state viscous, coulomb and offset beside it, and "
        "rotor_inertia where the drives have gears; the offset says where the spring rests.",
        f'[[terms]]\nkind = "spring"\njoints = {sprung}',
        "toml",
    )


def _left_out(identification: Identification) -> Iterator[NextStep]:
    """Branches that the tip leaves out, whose mass would count twice in the description that is written."""
    robot = identification.model.robot
    described = sum(link.inertia.mass for link in robot.links if link.inertia is not None)
    branches = [one for one in robot.left_out if one.mass > LIGHT * described]
    if not branches:
        return
    joints = dict.fromkeys(name for one in branches for name in one.joints)
    carriers = listed(dict.fromkeys(one.carrier for one in branches), MOST_NAMED)
    yield NextStep(
        "Lock what the tip leaves out, if the robot carried it in the logs.",
        f"The tip {robot.read_with.get('tip')} leaves out {listed(joints, MOST_NAMED)} and what moves with them, "
        f"{few_digits(sum(one.mass for one in branches))} kg by the description. If {carriers} carried that in the "
        "logs, it is in what was identified, and who loads the written description has it twice.",
        "[description]\nlocked = { "
        + ", ".join(f"{json.dumps(name)} = 0.0" for name in joints)
        + " } # where they stood, rad or m",
        "toml",
    )


def _carried(identification: Identification) -> Iterator[NextStep]:
    """A link at the end of a chain that comes out far heavier than described."""
    table = identification.parameters
    if table is None:
        return
    for link, sentence in heavy_ends(identification.model, table, identification.prediction).items():
        if sentence in identification.remarks:
            yield NextStep(
                "Put what the arm carried into the description, or state its mass.",
                f"{sentence} Until then the description draws all links towards those of an arm without it.",
                f"[[constraints.measured_mass]]\nlinks = [{json.dumps(link)}]\nvalue = MASS",
                "toml",
            )


def _weighing(identification: Identification) -> Iterator[NextStep]:
    table = identification.parameters
    if table is None or table.confidence is None:
        return
    total = table["total mass"]
    constraints = identification.feasible_set.constraints
    stated = any(isinstance(one, (TotalMass, MeasuredMass)) and one.links is None for one in constraints)
    if total.basis == "assumed" and not stated:
        names = [link.name for link in table.links]
        why = "the data do not show it"
        if table.has_physics:
            drawn = not total.lower <= total.value <= total.upper
            why = f"the data and physics allow {few_digits(total.lower)} to {few_digits(total.upper)} kg"
            why += ", and the prior draws it out of that" if drawn else ""
        yield NextStep(
            "State what the moving links weigh.",
            f"Their mass, {total.value:.3g} kg, is assumed: {why}. A data sheet or a scale gives it (all from "
            f"{names[0]} on, without the base).",
            "[constraints]\ntotal_mass = { equal = MASS }",
            "toml",
        )


def _intervals(identification: Identification) -> Iterator[NextStep]:
    processing = identification.options.get("processing")
    given = processing if isinstance(processing, dict) else {}
    keys = [key for key in ("torque_cutoff", "decimate") if given.get(key) not in (None, 1)]
    if identification.parameters is not None and identification.parameters.confidence is None and keys:
        yield NextStep(
            "Identify without filtered torques, to see what each number rests on.",
            "Torques that are filtered or decimated are biased by more than noise explains, so that no interval holds.",
            "[processing]\n" + "\n".join(f"# without {key} = {given[key]}" for key in keys),
            "toml",
        )


def _confirmation(identification: Identification) -> Iterator[NextStep]:
    robot, logs = _robot(identification), " ".join(_paths(identification, identification.logs)) or "LOG..."
    if identification.prediction.source == UNTESTED:
        yield NextStep(
            "Try the model on a motion that it has not seen.",
            "Nothing was held out, since there are no three stretches of data to leave out in turn.",
            f"steelyard identify {robot} {logs} --validate OTHER_LOG --output DIR",
            "console",
        )
    elif _predicted(identification) is identification.logs:  # also where validation logs that were given are of the fit
        yield NextStep(
            "Try the model on another motion.",
            f"It was judged on {identification.prediction.source}; a log that it has not seen shows whether it holds "
            "elsewhere.",
            f"steelyard validate {robot} DIR OTHER_LOG",
            "console",
        )
    if identification.prediction.is_usable and identification.estimate.parameters is not None:
        yield NextStep(
            "Use it.",
            "A simulation shows what the robot does with these numbers; DIR is the folder of this report.",
            f"steelyard simulate {robot} DIR --output simulation",
            "console",
        )


def _named(names: Iterable[str]) -> str:
    """The shortest of some names; sums of ten terms say nothing in a sentence."""
    listed = list(names)
    shown = [name for name in listed if len(name) <= LONGEST_NAME][:MOST_NAMED] or sorted(listed, key=len)[:1]
    return f"{'such as ' if len(shown) < len(listed) else 'namely '}{', '.join(shown)}"
