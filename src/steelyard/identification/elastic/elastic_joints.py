"""Identification of robots with elastic joints: links, drives, and the stiffness of their transmissions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.estimators.joint_stiffness import (
    SIGNIFICANT,
    DeflectionRows,
    JointStiffness,
    Motion,
    estimate_joint_stiffness,
    torque_scale,
)
from steelyard.feasibility.constraints import Constraint, LinearBound
from steelyard.files import listed
from steelyard.recording import Processing, Samples
from steelyard.regression import Estimate
from steelyard.robot import Joint, RobotFile

from ..given import Data, GivenLog, GivenSamples, UnusableLogs, describes_masses, given_logs
from ..log_reader import Progress
from ..result import Identification
from .elastic_model import elastic_model
from .second_encoders import (
    SecondEncoders,
    TwoEncoders,
    at_later,
    log_columns,
    names_in,
    own_section,
    read_two_encoders,
    require_columns,
)
from .transmission_torques import Transmissions, unseen_motions

__all__ = ["Identify", "identified_with_motions", "link_motion", "links_of_logs", "motor_motion", "with_elastic_joints"]

Array = NDArray[np.float64]
Identify = Callable[..., Identification]
_ROUNDS = 3
_NEGLIGIBLE = 0.1
"""Change of a joint's torques by deflections, relative to what its model leaves unexplained, that is not worth a second
identification. On a KR300 it is 0.02, on simulated arms with good encoders 0.5 and more."""
_DESCRIBED_SCALE = 0.1
"""Relative standard error of the torque of links that a description (CAD) with masses is taken to have, to which the
fit then stays near. Payloads and cables that nobody drew make about this much."""
_APART = 0.1
"""Part of a joint's motion (rms about its mean) that the difference of its encoders may leave unexplained: noise and
eccentric encoders leave a thousandth, the encoder of another joint or a dead one all of it."""
_TOO_FAR = 0.01
"""rad or m, which it must be too: a joint that is held still moves no more than its encoders' noise."""


def with_elastic_joints(
    identify: Identify,
    file: RobotFile,
    data: Data,
    validate: Data | None = None,
    *,
    progress: Progress | None = None,
    **options: Any,
) -> Identification:
    """Identify a robot with elastic joints: links, drives, and the stiffness of its transmissions.

    The torques of the motors and the motion identify links and drives. The deflection, motor position less link
    position, is then a regression on the torque that each transmission carries: compliance and damping, the zero of the
    second encoder, its delay and, where they are significant, its errors are found together. Where deflections change
    the torques of the links by more than a tenth of what the model leaves unexplained, links and drives are identified
    anew, with the measured motion of the links, and with the friction and inertia of the motors at theirs.

    Parameters
    ----------
    identify : callable
        :func:`steelyard.identify`, which identifies links and drives.
    file : RobotFile
        With a section ``[elastic]``, see :class:`SecondEncoders`.
    data, validate
        Logs with the columns of both encoders; those of the validation need no second encoder.
    progress : callable, optional
        Called with a few words before each step.
    **options
        Further ones of `identify`.

    Raises
    ------
    InputError
        If a second encoder is missing, or the section cannot be used.
    """
    return identified_with_motions(identify, file, data, validate, progress=progress, **options)[0]


def identified_with_motions(
    identify: Identify,
    file: RobotFile,
    data: Data,
    validate: Data | None = None,
    *,
    progress: Progress | None = None,
    **options: Any,
) -> tuple[Identification, list[TwoEncoders]]:
    """Return what :func:`with_elastic_joints` returns, and the motions of both sides that were read of each log."""
    say = progress or (lambda _: None)
    logs, validation = given_logs(data, validate)
    settings, where = own_section(file)
    if settings.position is None and settings.side == "motor":
        # What shows a stiffness then is the fourth derivative of a position, whose noise makes joints look stiffer.
        raise InputError(
            f'{where}: side = "motor" needs the columns of the motors\' encoders, as position = ["motor2"]; from the '
            "positions of the links alone no stiffness can be found."
        )
    if settings.motor_inertia is not None and any(term["kind"] == "motor_side" for term in file.terms):
        raise InputError(
            f"{where}: motor_inertia is that of the term rotor_inertia, but these motors have the Iam of "
            "the term motor_side; leave motor_inertia out, and state Iam in [[constraints]] where it is known."
        )
    own = () if settings.position is None else settings.columns(file.robot.joint_names, where)
    columns = log_columns(file)
    unusable = UnusableLogs()
    for log in logs:  # which is refused before it is identified
        with unusable.noting(log, len(logs)):
            require_columns(log, names_in(log, columns), own, where)
    unusable.refuse(logs)
    rigid = replace(file, sections={**file.sections, "elastic": {}})
    # Unless links and rotors share what is stated of the rotors, no links go with the motors that a simulation needs.
    options["constraints"] = [*(options.get("constraints") or ()), *_stated_motors(file, settings, where)]
    say("links and drives")
    result = identify(rigid, data, validate, progress=progress, **options)
    model = result.model
    places = settings.indices(model.robot.joint_names, where)
    say("reading the second encoders" if own else "reading the motions again")
    decided: Any = result.options["decided"]
    processing = Processing.from_dict({**file.section("processing"), **decided})
    read_by_both = partial(read_two_encoders, file=file, model=model, processing=processing)
    read = [read_by_both(log, needs_second=bool(own)) for log in logs]
    held: list[TwoEncoders] = []

    def anew(joints: Sequence[JointStiffness], motions: Sequence[Motion]) -> Identification:
        """Identify links and drives with these motions of the links, and judge them by those of what is held out."""
        say("links and drives, with the motion of the links")
        transmissions = Transmissions.of(result)
        if not held:
            held.extend(read_by_both(log, needs_second=False) for log in validation)
        unseen = [held_out_link_motion(one, joints, transmissions) for one in held]
        samples = [
            _samples_of(one, joints, motion, transmissions)
            for one, motion in zip((*read, *held), (*motions, *unseen), strict=True)
        ]
        return _again(identify, rigid, result, samples, len(read), progress, options)

    if not own:
        say("stiffness of the joints, by the resonances that the torques show")
        joints = _by_one_encoder(settings, places, result, read)
        moved = all(joint.verdict == "measured" for joint in joints)
        if moved:
            transmissions = Transmissions.of(result)
            result = anew(joints, [unseen_motions(one, joints, transmissions)[0] for one in read])
            joints = _by_one_encoder(settings, places, result, read)
        return _with(result, settings, joints, [], link_motion=moved), read
    motions = [one.motion for one in read]
    joints = ()
    remarks: list[str] = []
    for round_number in range(_ROUNDS):
        say("stiffness of the joints")
        joints = _stiffnesses(settings, result, read, motions)
        if round_number == _ROUNDS - 1 or not (round_number or _matters(joints, result, read)):
            break
        motions = [link_motion(one, joints, k) for k, one in enumerate(read)]
        result = anew(joints, motions)
        if not remarks:
            remarks.append(
                "Deflections change the torques of the links, so that links were identified with their own motion, and "
                "motors with theirs."
            )
            if held:
                remarks.append(told_link_motion(held))
    return _with(result, settings, joints, remarks + _told(joints), link_motion=bool(remarks)), read


def _stated_motors(file: RobotFile, settings: SecondEncoders, where: str) -> list[Constraint]:
    """Return what [elastic] states of the motors, where the robot file has terms of their rotors."""
    if settings.motor_inertia is None or file.terms_are_default:
        return []
    if not any(term["kind"] == "rotor_inertia" for term in file.terms):
        return []
    driving = file.robot.driving_joints
    places = settings.indices(file.robot.joint_names, where)
    return [
        LinearBound(f"Ia{driving[place] + 1}", equal=inertia)
        for place, inertia in zip(places, settings.motor_inertia, strict=True)
    ]


def _again(
    identify: Identify,
    rigid: RobotFile,
    result: Identification,
    samples: Sequence[Samples],
    fitted: int,
    progress: Progress | None,
    options: dict[str, Any],
) -> Identification:
    """Identify from samples with the motion of the links, under the names of the logs; the first so many are fitted."""
    terms = tuple(term.to_dict() for term in result.model.robot.terms)
    given = replace(rigid, terms=terms, terms_are_default=False)
    kept = {name: value for name, value in options.items() if name != "reduction"}
    again = identify(given, list(samples[:fitted]), list(samples[fitted:]) or None, progress=progress, **kept)
    pairs = zip(again.predictions, result.predictions, strict=True)
    return replace(
        again,
        logs=result.logs,
        validation_logs=result.validation_logs,
        robot_file=result.robot_file,
        in_memory=result.in_memory,
        layouts=result.layouts,
        options=result.options,
        predictions=tuple(replace(one, name=before.name) for one, before in pairs),
    )


def _with(
    result: Identification,
    settings: SecondEncoders,
    joints: tuple[JointStiffness, ...],
    remarks: list[str],
    *,
    link_motion: bool,
) -> Identification:
    """Return the result with its elastic joints, and what is proved of the robot with them."""
    parameters = np.asarray(result.estimate.parameters)
    whole = elastic_model(result.model, parameters, joints, result.estimate.consistency or "full")
    if whole is not None:
        whole = replace(whole, link_motion=link_motion)
    saved = {} if whole is None else whole.to_dict()
    return replace(
        result,
        estimate=replace(result.estimate, elastic_joints=tuple(one.to_dict() for one in joints), elastic_model=saved),
        elastic_joints=joints,
        elastic_model=whole,
        remarks=tuple(dict.fromkeys((*result.remarks, *remarks))),
        options={**result.options, "elastic": settings.to_dict()},
    )


def _by_one_encoder(
    settings: SecondEncoders, places: Sequence[int], result: Identification, read: Sequence[TwoEncoders]
) -> tuple[JointStiffness, ...]:
    """Stiffnesses from the motion and the torques of the motors alone."""
    from steelyard.estimators.one_encoder import estimate_compliances  # loaded where no second encoder is named

    model, transmissions = result.model, Transmissions.of(result)
    known = [_known_inertia(settings, order, place, transmissions) for order, place in enumerate(places)]
    beyond = np.zeros(model.dof)
    for place, inertia in zip(places, known, strict=True):
        if inertia is not None:
            beyond[place] = inertia - transmissions.rotor(place)

    def links(q: Array, dq: Array, ddq: Array) -> Array:
        return transmissions.torques(q, dq, ddq) - beyond * ddq

    def drives(q: Array, dq: Array, ddq: Array) -> Array:
        return transmissions.drive_torques(q, dq, ddq) + beyond * ddq

    found = estimate_compliances(model, [one.first for one in read], links, drives, places)
    torques = np.concatenate([links(*one.motion) for one in read])
    joints = []
    for order, place in enumerate(places):
        compliance, error = float(found.values[order]), float(found.standard_error[order])
        joint = model.robot.joints[model.robot.driving_joints[place]]
        inertia = known[order]
        joints.append(
            replace(
                # Most joints show nothing to one encoder: at 1.96 errors one of forty of them is "measured", wrongly.
                JointStiffness.of_compliance(joint.name, compliance, error, _unit(joint), told_from=SIGNIFICANT),
                motor_inertia=transmissions.rotor(place) if inertia is None else inertia,
                deflection=float(np.std(compliance * torques[:, place])),
                unexplained=np.nan,
                count=len(torques),
            )
        )
    return tuple(joints)


def _unit(joint: Joint) -> str:
    return "N·m/rad" if joint.rotates else "N/m"


def _known_inertia(settings: SecondEncoders, order: int, place: int, transmissions: Transmissions) -> float | None:
    """The inertia of a joint's motor as [elastic] states it, or as the description tells; None where neither does."""
    if settings.motor_inertia is not None:
        return settings.motor_inertia[order]
    robot = transmissions.model.robot
    if any(one.symbol == "Iam" for term in robot.terms for one in term.parameters):
        return None  # the motors' inertias are identified under this name, and stand in no description beside it
    described = robot.joints[robot.driving_joints[place]].rotor_inertia
    return described if np.isfinite(described) and described > 0.0 else None


def _told(joints: Sequence[JointStiffness]) -> list[str]:
    found = []
    for one in joints:
        far = [zero for zero in one.zeros if abs(zero) > 10.0 * max(one.deflection, one.unexplained)]
        if far:
            zeros = ", ".join(f"{zero:.4g}" for zero in one.zeros)
            found.append(
                f"{one.joint}: motor less link position of the unloaded joint is {zeros} "
                f"{one.unit.rpartition('/')[2]}: the zeros of the encoders differ, which was taken into account."
            )
        if abs(one.delay) > 3.0 * one.delay_standard_error > 0.0:
            late = f"{1e3 * one.delay:.2f} ± {1e3 * one.delay_standard_error:.2f} ms"
            found.append(
                f"{one.joint}: its second encoder is logged {late} later than the first, which was taken into account."
            )
        if one.encoder_errors:
            errors = ", ".join(f"{name} {value:.2g}" for name, value in one.encoder_errors.items())
            # Links that were identified a little wrong leave them, too: 34 of 68 joints with sound encoders (MuJoCo).
            found.append(
                f"{one.joint}: beside the deflection the encoders differ as by errors of the second one ({errors}), "
                "which was taken into account; torques of the links that are slightly wrong look alike."
            )
        if not np.isfinite(one.motor_inertia_standard_error):
            continue
        if one.is_wide and not one.motor_inertia_standard_error < 0.5 * one.motor_inertia:
            found.append(
                f"{one.joint}: the log determines the inertia of its motor poorly, and with it the stiffness; state "
                "motor_inertia in [elastic] where it is known."
            )
    return found


def motor_motion(one: TwoEncoders) -> Motion:
    """The motion of the motors, on the joint side."""
    q, dq, ddq = map(np.array, one.motion)
    if one.settings.side == "motor" and one.second is not None:
        places = list(one.places)
        for values, other in ((q, one.second.q), (dq, one.second.dq), (ddq, one.second.ddq)):
            values[:, places] = other[:, places]
    return q, dq, ddq


def link_motion(one: TwoEncoders, joints: Sequence[JointStiffness], log: int) -> Motion:
    """The motion of the links as measured: on the link side, its delay and zero taken out."""
    q, dq, ddq = map(np.array, one.motion)
    if one.settings.side == "link" and one.second is not None:
        for place, joint in zip(one.places, joints, strict=True):
            zero = joint.zeros[log] if log < len(joint.zeros) else 0.0
            for values, other in ((q, one.second.q + zero), (dq, one.second.dq), (ddq, one.second.ddq)):
                values[:, place] = at_later(one.t, other[:, place], joint.delay)
    return q, dq, ddq


def held_out_link_motion(one: TwoEncoders, joints: Sequence[JointStiffness], transmissions: Transmissions) -> Motion:
    """The motion of the links in a log that was not fitted: as measured, or else as the stiffnesses predict it.

    What is predicted holds the fourth derivative of a position. With joints that resonate at 3 to 6 Hz its acceleration
    was off by as much as itself, and a model that leaves 0.1 % with the measured motion seemed to leave 12 %.
    """
    if one.second is None or one.settings.side == "motor":  # the first encoders of the latter are those of the links
        return unseen_motions(one, joints, transmissions)[0]
    later = [at_later(one.t, one.second.q[:, p], joint.delay) for p, joint in zip(one.places, joints, strict=True)]
    shown = [one.first.q[:, p] - own for p, own in zip(one.places, later, strict=True)]
    zeros = [float(np.mean(difference)) for difference in shown]
    for _ in range(2):  # gravity bends a joint by far less than it turns it: each round leaves a hundredth
        placed = tuple(replace(joint, zeros=(zero,)) for joint, zero in zip(joints, zeros, strict=True))
        torques = transmissions.torques(*link_motion(one, placed, 0))
        zeros = [
            float(np.mean(difference - joint.deflections(torques[:, place])))
            for place, joint, difference in zip(one.places, joints, shown, strict=True)
        ]
    for place, joint, difference, zero in zip(one.places, joints, shown, zeros, strict=True):
        left = float(np.std(difference - joint.deflections(torques[:, place]) - zero))
        _require_together(replace(joint, unexplained=left), [(one.first.q[:, place], one.second.q[:, place])], one)
    return link_motion(one, [replace(joint, zeros=(zero,)) for joint, zero in zip(joints, zeros, strict=True)], 0)


def told_link_motion(logs: Sequence[TwoEncoders]) -> str:
    """Say by what links were taken to move in logs that were not fitted; nothing where there are none."""
    if not logs:
        return ""
    unseen = [one.name for one in logs if one.second is None and one.settings.side == "link"]
    if not unseen:
        return "Joints are elastic: links were taken to move as their own encoders say."
    where = "" if len(unseen) == len(logs) else f"in {listed(unseen)}, without second encoders, "
    return (
        f"Joints are elastic: {where}links were taken to move as the motors do, less the deflections that the estimate "
        "predicts, so that the error holds that of this prediction, too."
    )


def _samples_of(
    one: TwoEncoders, joints: Sequence[JointStiffness], motion: Motion, transmissions: Transmissions
) -> Samples:
    """Samples with the motion of the links; what the motors do beside them is moved to the torque."""
    if one.settings.side == "motor" and one.second is None:
        motor = unseen_motions(one, joints, transmissions)[1]
    else:
        motor = motor_motion(one)
    measured, channels = one.first, one.first.channels
    beside = transmissions.drive_torques(*motor, channels) - transmissions.drive_torques(*motion, channels)
    for place, joint in zip(one.places, joints, strict=True):
        beside[:, place] += transmissions.missing_rotor(place, joint) * (motor[2] - motion[2])[:, place]
    return Samples(*motion, torque=measured.torque - beside, mask=measured.mask, t=measured.t, channels=channels)


def links_of_logs(
    file: RobotFile, model: Model, estimate: Estimate, logs: Sequence[GivenLog], processing: Processing | None
) -> tuple[list[GivenLog], str]:
    """Return logs as the motion of the links and their torques, as an estimate with elastic joints was fitted to.

    Beside them stands a sentence that says by what the links were taken to move, empty where all are samples.

    Links move as their own encoders say where a log has them, and else as the motors less the deflections that the
    estimate predicts. What friction and inertia of the motors do beside them is moved to the torque. Samples stay as
    they are.

    Parameters
    ----------
    file : RobotFile
        With a section ``[elastic]``.
    model : Model
        Of links and drives.
    logs : sequence of logs
    processing : Processing or None
        That of the fit.
    """
    joints = [JointStiffness.from_dict(one, own_section(file)[1]) for one in estimate.elastic_joints]
    transmissions = Transmissions(model, np.asarray(estimate.parameters))
    found: list[GivenLog] = []
    read = []
    for log in logs:
        if isinstance(log, GivenSamples):
            found.append(log)
            continue
        one = read_two_encoders(log, file, model, processing, needs_second=False)
        motion = held_out_link_motion(one, joints, transmissions)
        found.append(GivenSamples(_samples_of(one, joints, motion, transmissions), str(log)))
        read.append(one)
    return found, told_link_motion(read)


def _stiffnesses(
    settings: SecondEncoders, result: Identification, read: Sequence[TwoEncoders], motions: Sequence[Motion]
) -> tuple[JointStiffness, ...]:
    transmissions = Transmissions.of(result)
    torques = [transmissions.torques(*motion) for motion in motions]
    return tuple(
        _stiffness(settings, order, transmissions, read, motions, torques) for order in range(len(settings.joints))
    )


def _stiffness(
    settings: SecondEncoders,
    order: int,
    transmissions: Transmissions,
    read: Sequence[TwoEncoders],
    motions: Sequence[Motion],
    torques: Sequence[Array],
) -> JointStiffness:
    """Estimate one joint, with the second encoder moved by its delay until none is left."""
    robot, place = transmissions.model.robot, read[0].places[order]
    name = robot.joint_names[place]
    joint = robot.joints[robot.driving_joints[place]]
    own_inertia = transmissions.rotor(place)
    known = _known_inertia(settings, order, place, transmissions)
    inertia_error = transmissions.rotor_error(place) if known is None else 0.0
    inertia = own_inertia if known is None else known
    delay = 0.0 if settings.delay == "automatic" else float(settings.delay[order])
    change = own_inertia - inertia
    scale_error = _scale_error(place, transmissions, read, motions, torques, inertia_error == 0.0, change)
    found: JointStiffness | None = None
    for _ in range(3):
        parts = []
        for log, (one, motion, torque) in enumerate(zip(read, motions, torques, strict=True)):
            parts.append(_rows(one, motion, torque, place, delay, change, log))
        rows = _joined(parts)
        found = estimate_joint_stiffness(
            name,
            rows,
            motor_inertia=inertia,
            motor_inertia_error=inertia_error,
            encoder_errors=settings.encoder_errors,
            delay_is_given=settings.delay != "automatic",
            torque_scale_error=scale_error,
            unit=_unit(joint),
        )
        if settings.delay != "automatic":
            found = replace(found, delay_standard_error=0.0)
            break
        step = found.delay
        delay += step
        if abs(step) < 1e-7:
            break
    assert found is not None
    _require_together(found, [(one.first.q[:, place], one.second.q[:, place]) for one in read if one.second], read[0])
    return replace(found, delay=delay)


def _require_together(found: JointStiffness, positions: Sequence[tuple[Array, Array]], log: TwoEncoders) -> None:
    """Refuse encoders of which one is that of another joint, or dead."""
    spread = max(float(np.std(one)) for pair in positions for one in pair)
    if found.unexplained > max(_APART * spread, _TOO_FAR):
        raise InputError(
            f'{log.name}: the two encoders of "{found.joint}" differ by {found.unexplained:.2g} (rms) that no spring '
            f"explains, where the joint moves by {spread:.2g}: they are not those of one joint, or one of them stands "
            "still; correct `position` in [elastic], or take the joint out of it."
        )


def _scale_error(
    place: int,
    transmissions: Transmissions,
    read: Sequence[TwoEncoders],
    motions: Sequence[Motion],
    torques: Sequence[Array],
    given: bool,
    inertia_change: float,
) -> float:
    """How well the scale of what a transmission carries is known, from the torques of its motor and the description."""
    columns = []
    for log, (one, motion, torque) in enumerate(zip(read, motions, torques, strict=True)):
        motor = motor_motion(replace(one, places=(place,)))
        drives = transmissions.drive_torques(*motor, one.first.channels)[:, place]
        change = inertia_change * motion[2][:, place]
        links, rest = torque[:, place] + change, one.first.torque[:, place] - drives + change
        rows = (links, rest, motor[1][:, place], motor[2][:, place], np.full(one.first.count, float(log)))
        columns.append(np.column_stack(rows)[one.first.used_rows[:, place]])
    links, rest, speed, acceleration, log_of = np.concatenate(columns).T
    is_described = describes_masses(transmissions.model)
    if len(links) < 100:
        return _DESCRIBED_SCALE if is_described else np.inf
    scale, found = torque_scale(links, rest, speed, None if given else acceleration, log_of.astype(np.intp))
    # What the scale is off by more than its noise explains: a prior has drawn the parameters of the links that far.
    drawn = np.sqrt(max((scale - 1.0) ** 2 - found**2, 0.0)) if np.isfinite(found) else 0.0
    if is_described:
        found = 1.0 / float(np.hypot(1.0 / max(found, 1e-12), 1.0 / _DESCRIBED_SCALE))
        drawn = min(drawn, _DESCRIBED_SCALE)
    return float(np.hypot(found, drawn))


def _rows(
    one: TwoEncoders,
    motion: Motion,
    torques: Array,
    place: int,
    delay: float,
    inertia_change: float,
    log: int,
) -> DeflectionRows:
    assert one.second is not None
    t = one.t
    second = at_later(t, one.second.q[:, place], delay)
    acceleration = motion[2][:, place]
    torque = torques[:, place] + inertia_change * acceleration
    end = int(np.ceil(abs(delay) / max(float(np.median(np.diff(t))), 1e-12))) + 1
    kept = slice(end, len(t) - end)
    return DeflectionRows(
        deflection=(one.settings.sign * (one.first.q[:, place] - second))[kept],
        velocity=(one.settings.sign * one.second.dq[:, place])[kept],
        acceleration=acceleration[kept],
        position=motion[0][kept, place],
        torque=torque[kept],
        torque_rate=np.gradient(torque, t)[kept],
        log=np.full(len(t), log)[kept],
    )


def _joined(parts: Sequence[DeflectionRows]) -> DeflectionRows:
    def all_of(name: str) -> Any:
        return np.concatenate([getattr(part, name) for part in parts])

    return DeflectionRows(*(all_of(item.name) for item in fields(DeflectionRows)))


def _matters(joints: Sequence[JointStiffness], result: Identification, read: Sequence[TwoEncoders]) -> bool:
    """Whether torques of the motions that the two sides have differ from those of one motion by more than noise."""
    transmissions = Transmissions.of(result)
    noise = result.information.joint_rms_error(np.asarray(result.estimate.base))
    for one in read:
        links, motors = unseen_motions(one, joints, transmissions)
        change = transmissions.torques(*links) - transmissions.torques(*one.motion)
        change += transmissions.drive_torques(*motors) - transmissions.drive_torques(*one.motion)
        if np.any(np.sqrt(np.mean(change**2, axis=0)) > _NEGLIGIBLE * noise):
            return True
    return False
