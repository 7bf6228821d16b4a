"""Friction that the logs choose for a robot with elastic joints: at the motors, beside the stiffness."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from steelyard.recording import Samples
from steelyard.recording.chunks import CHUNK_ROWS
from steelyard.robot import RobotFile

from ..chosen_friction import choose_friction
from ..given import Data, GivenSamples, given_logs
from ..log_reader import LogReader, Progress
from ..result import Identification
from .elastic_joints import Identify, identified_with_motions, link_motion, motor_motion, with_elastic_joints
from .second_encoders import TwoEncoders
from .transmission_torques import Transmissions, unseen_motions

__all__ = ["with_chosen_friction"]


def with_chosen_friction(
    identify: Identify,
    file: RobotFile,
    data: Data,
    validate: Data | None = None,
    *,
    progress: Progress | None = None,
    **options: Any,
) -> Identification:
    """Identify a robot with elastic joints whose friction the logs choose.

    Friction acts at the motors. So the robot is identified with the friction that is stated, laws are chosen by the
    motion of the motors, and where laws were added all is identified anew with them. Where deflections matter, what the
    links ask for by their own motion beside that of the motors is moved to the torques by which laws are chosen. The
    arguments are those of :func:`with_elastic_joints`.
    """
    say = progress or (lambda _: None)
    first, motions = identified_with_motions(identify, file, data, validate, progress=progress, **options)
    model = first.model
    samples = [
        GivenSamples(_at_motors(one, first, number), str(log))
        for number, (log, one) in enumerate(zip(given_logs(data, None)[0], motions, strict=True))
    ]
    reader = LogReader(file, model, options.get("chunk_rows", CHUNK_ROWS))
    choice = choose_friction(reader, samples, model, model, say, adds_presliding=False)
    found = first
    if choice.selection.chosen:
        terms = tuple(term.to_dict() for term in choice.terms)
        stated = replace(file, terms=terms, terms_are_default=False)
        found = with_elastic_joints(identify, stated, data, validate, progress=progress, **options)
        description = {**found.estimate.description, "terms": list(terms)}
        found = replace(found, estimate=replace(found.estimate, description=description))
    return replace(
        found,
        friction=choice,
        remarks=tuple(dict.fromkeys((*found.remarks, *choice.remarks))),
        options={**found.options, "friction": "auto"},
    )


def _at_motors(one: TwoEncoders, result: Identification, log: int) -> Samples:
    """Samples with the motion of the motors; what links ask for by a motion of their own is moved to the torque."""
    joints, measured = result.elastic_joints, one.first
    motors = motor_motion(one)
    torque = measured.torque
    if result.elastic_model is not None and result.elastic_model.link_motion:
        transmissions = Transmissions.of(result)
        seen = one.second is not None
        links = link_motion(one, joints, log) if seen else unseen_motions(one, joints, transmissions)[0]
        torque = torque + transmissions.torques(*motors) - transmissions.torques(*links)
        for place, joint in zip(one.places, joints, strict=True):  # of which the links of the fit hold a part
            torque[:, place] -= transmissions.missing_rotor(place, joint) * (motors[2] - links[2])[:, place]
    return Samples(*motors, torque=torque, mask=measured.mask, t=measured.t, channels=measured.channels)
