"""Choices that `[processing]` leaves to the data: the cutoff, velocity thresholds, the delay, levels and tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from . import cutoff as cutoffs
from . import diagnosis  # as those of `cutoff`, its names are imported when they are used
from .cutoff import CutoffChoice
from .diagnosis.detectors import saturation_levels, stiction_duration, stuck_torque_duration
from .diagnosis.rest import HeldJoints, VelocityThresholds, velocity_noise, velocity_thresholds
from .filters import Butterworth
from .measurements import Measurements
from .options import Processing
from .plan import Plan
from .samples import Samples

if TYPE_CHECKING:
    from steelyard.dynamics import Model


__all__ = ["DECISION_ROWS", "Decision", "decide", "settle"]

DECISION_ROWS = 50_000
"""Rows in the middle of a log by which its processing is decided, whatever the size of the chunks it is read in."""
FEWEST_ROWS = 64
"""Rows that a log needs for anything to be decided by it."""


@dataclass(frozen=True, eq=False)
class Decision:
    """The result of `decide`: processing options in which nothing is open that all logs of a robot decide together.

    Attributes
    ----------
    processing : Processing
        With numbers where "auto" stood for the cutoff and the velocity thresholds.
    cutoff_choice : CutoffChoice or None
        The evidence of the cutoff, where it was left open.
    thresholds : VelocityThresholds or None
        The evidence of the thresholds, where they were left open.
    remarks : tuple of str
        What was decided, a sentence each.
    """

    processing: Processing
    cutoff_choice: CutoffChoice | None = None
    thresholds: VelocityThresholds | None = None
    remarks: tuple[str, ...] = ()

    @property
    def reasons(self) -> dict[str, str]:
        """Why, by the key of ``[processing]``, without a full stop; thresholds that leave nothing out have none."""
        found = {} if self.cutoff_choice is None else {"cutoff": self.cutoff_choice.reason}
        if self.thresholds is not None and self.thresholds.share.any():
            found["velocity_threshold"] = self.thresholds.reason
        return found

    @property
    def near_rest(self) -> Processing:
        """The options by which rows near rest stay wherever the sign of their velocity is certain.

        Friction that remembers the motion explains what a plain model lacks there, and shows its numbers there.
        """
        if self.thresholds is None:
            return self.processing
        return replace(self.processing, velocity_threshold=tuple(self.thresholds.by_noise.tolist()))


def decide(processing: Processing, recordings: Sequence[Measurements], model: Model | None) -> Decision:
    """Choose the cutoff and the velocity thresholds by recordings of one robot, where the options leave them open.

    With a model, the torques decide both (see `cutoff_by_torques` and `velocity_thresholds`). Without one nothing says
    what a torque should be: the spectra of the positions then decide the cutoff (see `choose_cutoff`; of several
    recordings, the longest), and the noise of the velocities the thresholds.

    Parameters
    ----------
    processing : Processing
    recordings : sequence of Recording
        Evenly sampled: one log, or excerpts of all logs of the robot.
    model : Model or None

    Raises
    ------
    InputError
        Where the recordings do not tell.
    """
    model = None if model is None else model.without_logged_channels  # of which the decisions take no notice
    source = recordings[0].source if len(recordings) == 1 else f"{len(recordings)} logs"
    recordings = [_middle(one) for one in recordings if one.count >= FEWEST_ROWS] or [recordings[0]]
    few = recordings[0].count < FEWEST_ROWS
    decision = Decision(processing)
    open_rows = replace(processing, velocity_threshold=None, average=False, delay=0.0)
    if processing.cutoff == "auto" and processing.takes_cutoff:
        if model is None or few:
            choice = cutoffs.choose_cutoff(max(recordings, key=lambda one: one.duration), processing.order)
        else:
            unfiltered = Decision(replace(open_rows, cutoff=None, filter=Butterworth()))
            plans = [settle(unfiltered, one) for one in recordings]

            def filtered(cutoff: float, ends: float) -> list[Samples]:
                own = Butterworth(cutoff, processing.order)
                pairs = zip(plans, recordings, strict=True)
                return [replace(plan, filter=own).middle(one, ends).with_states(model) for plan, one in pairs]

            choice = cutoffs.cutoff_by_torques(recordings, filtered, model, processing.order, source)
        decided = replace(processing, cutoff=choice.cutoff)
        decision = Decision(decided, choice, remarks=(choice.remark,))
    if processing.velocity_threshold == "auto" and few:
        decision = replace(decision, processing=replace(decision.processing, velocity_threshold=None))
    elif processing.velocity_threshold == "auto":
        settled = Decision(replace(open_rows, cutoff=decision.processing.cutoff))
        plans = [settle(settled, one) for one in recordings]
        pairs = list(zip(plans, recordings, strict=True))
        measured = processing.velocity == "measured"
        moved = [plan.middle(one) for plan, one in pairs]
        moved = moved if model is None else [one.with_states(model) for one in moved]
        noise = np.max([velocity_noise(one, plan.filter, measured) for plan, one in pairs], axis=0)
        found = velocity_thresholds(moved, noise, model)
        decided = replace(decision.processing, velocity_threshold=tuple(found.thresholds.tolist()))
        said = (found.remark,) if found.share.any() else ()
        decision = Decision(decided, decision.cutoff_choice, found, (*decision.remarks, *said))
    return decision


def _middle(recording: Measurements) -> Measurements:
    start = max(0, (recording.count - DECISION_ROWS) // 2)
    return recording if start == 0 else recording.rows(start, start + DECISION_ROWS)


def settle(decision: Decision, recording: Measurements, model: Model | None = None) -> Plan:
    """Choose everything else by one recording, after `decide` has chosen the cutoff and the velocity thresholds.

    A delay is estimated with the model where there is one.

    Raises
    ------
    InputError
        Where the recording does not tell, or an option does not fit it.
    """
    processing = decision.processing
    cutoff, own = processing.cutoff, processing.filter
    joints = recording.joint_count
    if not processing.takes_cutoff:
        cutoff = None
    assert not isinstance(cutoff, str), "`decide` comes first"
    chosen = own.settled(cutoff, processing.order, "[processing]")
    stiction = levels = None
    if processing.stiction is not False:
        tolerance, duration = stiction_duration(recording)
        if processing.stiction is not True:
            duration = np.full(joints, processing.stiction)
        stiction = (tolerance, duration)
    if processing.saturation is True:
        levels = saturation_levels(recording.torque)
    elif processing.saturation is not False:
        given = processing.for_joints("saturation", recording, "levels")
        levels = np.column_stack([-given, given])
    stuck = stuck_torque_duration(recording) if processing.stuck_torque else None
    held = HeldJoints.of(recording)
    choice, remarks = decision.cutoff_choice, decision.remarks
    plan = Plan(processing, chosen, np.zeros(joints), stiction, levels, stuck, choice, remarks, held)
    plain = None if model is None else model.without_logged_channels
    return replace(_with_delay(plan, recording, plain), model=model)


def _with_delay(plan: Plan, recording: Measurements, model: Model | None) -> Plan:
    """Take the delay of the torques from the options, or estimate it."""
    processing = plan.processing
    if isinstance(processing.delay, str):
        even = replace(processing, trim=0.0, decimate=(), velocity_threshold=None, average=False, filter=Butterworth())
        # Noise of the accelerations would pull the estimate: the motion is filtered as the data asks for.
        own = Butterworth(cutoffs.choose_cutoff(recording, processing.order).cutoff, processing.order)
        samples, _ = replace(plan, processing=even, filter=own).rows(recording, 0, recording.count)
        found = diagnosis.estimate_delay(samples, model)
        by = "the signals show" if model is None else "the model shows"
        if not found.is_sure:
            remark = (
                f"Torques were not moved: the delay behind the motion that {by}, {1e3 * found.delay:.3g} ms, is "
                f"not significant with an uncertainty of {1e3 * found.standard_deviation:.2g} ms; set `delay` in "
                "[processing] if it is known."
            )
            return replace(plan, remarks=(*plan.remarks, remark))
        remark = (
            f"Torques were moved back by {1e3 * found.delay:.3g} ms (± {1e3 * found.standard_deviation:.2g} ms), "
            f"the delay behind the motion that {by}; set `delay` in [processing] to choose."
        )
        return replace(plan, delay=np.full(recording.joint_count, found.delay), remarks=(*plan.remarks, remark))
    return replace(plan, delay=processing.for_joints("delay", recording))
