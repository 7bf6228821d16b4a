"""What `[processing]` leaves to the data, decided once for all logs of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .cutoff import CutoffChoice, TorqueCutoffChoice, choose_cutoff, cutoff_by_torques
from .diagnosis.near_rest import velocity_noise, velocity_thresholds
from .filters import Butterworth
from .plan import Decision, Plan
from .samples import Samples

if TYPE_CHECKING:
    from steelyard.dynamics import Model

    from .processing import Processing
    from .recording import Recording

__all__ = ["DECISION_ROWS", "decide"]


DECISION_ROWS = 50_000
"""Rows in the middle of a log by which its processing is decided, whatever the size of the chunks it is read in."""
FEWEST_ROWS = 64
"""Without which nothing is decided by a log."""


def decide(processing: Processing, recordings: Sequence[Recording], model: Model | None) -> Decision:
    """Choose the cutoff and the velocity thresholds by recordings of one robot, where `processing` leaves them open.

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
    source = recordings[0].source if len(recordings) == 1 else f"{len(recordings)} logs"
    recordings = [_middle(one) for one in recordings if one.count >= FEWEST_ROWS] or [recordings[0]]
    few = recordings[0].count < FEWEST_ROWS
    decision = Decision(processing)
    open_rows = replace(processing, velocity_threshold=None, average=False, delay=0.0)
    if processing.cutoff == "auto" and processing.takes_cutoff:
        choice: CutoffChoice | TorqueCutoffChoice
        if model is None or few:
            choice = choose_cutoff(max(recordings, key=lambda one: one.duration), processing.order)
        else:
            unfiltered = Decision(replace(open_rows, cutoff=None, filter=Butterworth()))
            plans = [Plan.settled(unfiltered, one) for one in recordings]

            def filtered(cutoff: float, ends: float) -> list[Samples]:
                own = Butterworth(cutoff, processing.order)
                pairs = zip(plans, recordings, strict=True)
                return [replace(plan, filter=own).middle(one, ends) for plan, one in pairs]

            choice = cutoff_by_torques(recordings, filtered, model, processing.order, source)
        decided = replace(processing, cutoff=choice.cutoff)
        decision = Decision(decided, choice, remarks=(choice.remark(),))
    if processing.velocity_threshold == "auto" and few:
        decision = replace(decision, processing=replace(decision.processing, velocity_threshold=None))
    elif processing.velocity_threshold == "auto":
        settled = Decision(replace(open_rows, cutoff=decision.processing.cutoff))
        plans = [Plan.settled(settled, one) for one in recordings]
        pairs = list(zip(plans, recordings, strict=True))
        measured = processing.velocity == "measured"
        moved = [plan.middle(one) for plan, one in pairs]
        noise = np.max([velocity_noise(one, plan.filter, measured) for plan, one in pairs], axis=0)
        found = velocity_thresholds(moved, noise, model)
        decided = replace(decision.processing, velocity_threshold=tuple(found.thresholds.tolist()))
        said = (found.remark(),) if found.share.any() else ()
        decision = Decision(decided, decision.cutoff_choice, found, (*decision.remarks, *said))
    return decision


def _middle(recording: Recording) -> Recording:
    start = max(0, (recording.count - DECISION_ROWS) // 2)
    return recording if start == 0 else recording.rows(start, start + DECISION_ROWS)
