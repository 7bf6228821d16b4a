"""Findings about transmissions: wrong ratios and backlash between two encoders, and commands in other units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from steelyard.display import capital
from steelyard.errors import InputError
from steelyard.files import suggestion
from steelyard.recording import LogColumns, Recording
from steelyard.recording.correction import Settings
from steelyard.recording.diagnosis.transmission import ALIKE, Transmission, diagnose_transmission
from steelyard.recording.even import longest_part
from steelyard.recording.formats import LogFiles
from steelyard.robot import Robot, RobotFile

from ..elastic.second_encoders import SecondEncoders, with_positions
from ..examination import Finding
from .drive_settings import DriveSettings

__all__ = ["transmission_findings"]

OFF = 0.2
"""By which commands and positions must differ in scale to be told: a soft position loop sags by some percent."""


def transmission_findings(
    log: Any, file: RobotFile, columns: LogColumns, recording: Recording, names: Sequence[str]
) -> tuple[list[Finding], dict[str, str]]:
    """Look at the second encoders of [elastic] and at the commands of [drive].

    Parameters
    ----------
    log : path or LogFile
        As it was recorded.
    columns : LogColumns
        With which the log is read.
    recording : Recording
        The log, read with them.
    names : sequence of str
        Of the joints.
    """
    findings: list[Finding] = []
    facts: dict[str, str] = {}
    if file.section("elastic").get("position") is not None:
        findings, facts = _second_encoders(log, file, columns, recording, names)
    if file.section("drive").get("command") is not None:
        findings += _commands(log, file, columns, recording)
    return findings, facts


def _second_encoders(
    log: Any, file: RobotFile, columns: LogColumns, recording: Recording, names: Sequence[str]
) -> tuple[list[Finding], dict[str, str]]:
    where = f"{file.path}, [elastic]"
    settings = SecondEncoders.from_dict(file.section("elastic"), where)
    layout = recording.layout
    if layout is None or layout.has_matrix:
        return [], {}
    own, places = settings.columns(names, where), settings.indices(names, where)
    there = list(LogFiles(log, columns).names)
    missing = [one for one in own if one not in there]
    if missing:
        statement = f"The log has no column {missing[0]!r}, which [elastic] names as a second encoder."
        advice = f"Correct `position` in [elastic]: {suggestion(missing[0], there)}."
        return [Finding("second encoder", statement, "refused", advice=advice)], {}
    others = dict(zip(places, own, strict=True))
    recording, beside = _beside(log, columns, recording, file.robot, others, settings.position_unit)
    scales = list(settings.scale or [1.0] * len(own))
    findings: list[Finding] = []
    facts: dict[str, str] = {}
    told: list[tuple[int, Transmission]] = []
    for order, place in enumerate(places):
        first, second = recording.q[:, place], scales[order] * beside.q[:, place]
        motor, link = (first, second) if settings.side == "link" else (second, first)
        found = diagnose_transmission(motor, link, recording.torque[:, place], recording.rate)
        joint = recording.joint_label(place)
        label, fact = capital(joint), f"backlash, {joint}"
        unit = file.robot.position_units[place]
        if np.array_equal(first, second):
            statement = (
                f"{label}: its second encoder {own[order]} reads exactly what the first one does: it is a copy, and "
                "shows no deflection."
            )
            advice = "Name the column of the encoder itself in `position` of [elastic], or take the joint out."
            findings.append(Finding("second encoder", statement, "wrong", advice=advice))
            continue
        if not np.isfinite(found.correlation):
            facts[fact] = "not told: the log is too short, or the joint rests"
            continue
        if abs(found.correlation) < ALIKE:
            statement = (
                f"{label}: its second encoder {own[order]} does not follow the first (correlation "
                f"{found.correlation:.2f}); they are not encoders of one joint."
            )
            advice = "Name the columns of `position` in [elastic] in the order of its `joints`."
            findings.append(Finding("second encoder", statement, "wrong", advice=advice))
            continue
        if found.ratio_is_wrong:
            told.append((order, found))
            continue
        delay = 1e3 * found.delay if settings.side == "link" else -1e3 * found.delay
        late = f"second encoder {abs(delay):.2g} ms {'late' if delay > 0.0 else 'early'}"
        if abs(delay) < 0.1:
            late = "both encoders in step to 0.1 ms"
        if found.has_backlash:
            findings.append(_gap(found, label, unit, late, settings))
        elif np.isfinite(found.bound):
            facts[fact] = f"at most {found.bound:.2g} {unit}, {late}"
        elif np.isfinite(found.backlash):
            facts[fact] = (
                "not told: the difference of both positions steps against the torque; check `torque_sign` in [log] and "
                "`side` in [elastic]"
            )
        else:
            facts[fact] = "not told: the torque that it carries does not change its sign, or only with the velocity"
    causes = [found.cause for _, found in told]
    for (order, _), (_, ratio) in zip(told, causes, strict=True):
        scales[order] *= float(f"{ratio if settings.side == 'link' else 1.0 / ratio:.7g}")
    remedy: Settings = {"elastic": {"scale": scales}}
    if len(told) == len(own) and all(words == f"degrees on the {settings.side}'s side" for words, _ in causes):
        remedy = {"elastic": {"position_unit": "deg"}}
    for (order, found), (words, _) in zip(told, causes, strict=True):
        statement = (
            f"{capital(recording.joint_label(places[order]))}: the position of the motor is {found.ratio:.6g} ± "
            f"{2.0 * found.ratio_error:.2g} times that of the link ({own[order]} is the second encoder), where 1 was "
            f"expected; delay and elasticity are taken out{f'. That fits {words}' if words else ''}. If the first "
            "encoder is right, the line below mends it."
        )
        findings.append(Finding("gear ratio", statement, "wrong", abs(found.ratio - 1.0), remedy))
    return findings, facts


def _gap(found: Transmission, label: str, unit: str, late: str, settings: SecondEncoders) -> Finding:
    statement = (
        f"{label}: its transmission has a backlash of {found.backlash:.3g} ± {2.0 * found.backlash_error:.2g} {unit}: "
        f"where the torque that it carries changes its sign the link falls back by so much, which takes out "
        f"{found.gain:.0%} of what elasticity, friction and delay leave of the deflection ({late})."
    )
    if settings.encoder_errors == "none":
        return Finding("backlash", statement, "worse", found.backlash, {"elastic": {"encoder_errors": "automatic"}})
    advice = (
        "No line of robot.toml mends it: have the gear adjusted, or record about a posture where gravity keeps the "
        "transmission loaded on one side."
    )
    return Finding("backlash", statement, "worse", found.backlash, advice=advice)


def _commands(log: Any, file: RobotFile, columns: LogColumns, recording: Recording) -> list[Finding]:
    """Compare commanded with measured positions."""
    settings, layout = DriveSettings.from_dict(file.section("drive"), f"{file.path}, [drive]"), recording.layout
    if settings.law != "position" or settings.scale is not None or layout is None or layout.has_matrix:
        return []
    files = LogFiles(log, columns)
    own = settings.command_columns(file.robot, files.names)
    if not set(files.names).issuperset(own):
        return []  # which `identify --from positions` refuses
    recording, beside = _beside(log, columns, recording, file.robot, dict(enumerate(own)), None)
    findings = []
    for j, name in enumerate(own):
        found = diagnose_transmission(beside.q[:, j], recording.q[:, j], recording.torque[:, j], recording.rate)
        if not abs(found.correlation) >= ALIKE or not found.ratio_is_wrong or abs(found.ratio - 1.0) < OFF:
            continue
        words = found.cause[0].replace("on the motor's side", "in the commands")
        words = words.replace("degrees on the link's side", "measured positions in degrees")
        statement = (
            f"{capital(recording.joint_label(j))}: its commands {name} are {found.ratio:.4g} ± "
            f"{2.0 * found.ratio_error:.2g} times the measured positions{f': {words}' if words else ''}."
        )
        advice = f"Write {name} in the unit, sign and gearing of the measured positions: divided by {found.ratio:.4g}."
        findings.append(Finding("command unit", statement, "wrong", 1.0, advice=advice))
    return findings


def _beside(
    log: Any,
    columns: LogColumns,
    recording: Recording,
    robot: Robot,
    own: dict[int, str],
    unit: str | None,
) -> tuple[Recording, Recording]:
    """Return the longest stretch of the log without gaps, and the same with other columns as positions of joints."""
    layout = recording.layout
    assert layout is not None
    others = replace(with_positions(columns, layout, own, unit), position_offset=None)
    first, second = longest_part(recording), longest_part(Recording.read(log, others, robot))
    if first.count != second.count:
        raise InputError("The two encoders have values in other rows; record both in the same rows.")
    return first, second
