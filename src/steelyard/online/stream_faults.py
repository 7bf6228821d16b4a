"""What the newest samples tell of faults of the stream: torques out of step, of the wrong sign, noisy positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.identification.late_logs import FEWEST_ROWS, LateLog, late_hypotheses, late_log
from steelyard.identification.mistakes import wrong_torque_signs
from steelyard.recording import Samples
from steelyard.recording.diagnosis.late_torques import EARLIER, LATER
from steelyard.regression import Information, least_squares
from steelyard.regression.reduction import errors_of

__all__ = ["out_of_step", "said_of_late", "wrong_signs"]

Array = NDArray[np.float64]

OUT_OF_STEP = 5e-4
"""s that torques must surely be out of step with the motion. A controller that holds each torque for 1 ms makes them
early by as much."""

WRONG = 0.2
"""Part of the torque of a joint that the answer leaves, from which it is asked whether its sign is wrong, which takes
0.3 s: 0.3 to 1.2 where it is, since what is feasible does not brake backwards. Of 36 sound streams, eight of them real,
no sign is told wrong where it is asked of all."""


def out_of_step(
    model: Model,
    information: Information,
    weights: Array,
    stretches: Sequence[Samples],
    cutoff: float | None,
) -> LateLog | None:
    """Return which torques are logged later or earlier than the motion, so much that it matters to the numbers.

    The motion is filtered once more at half of the cutoff, which tells delays from what a filter makes of noise and of
    friction, so that smaller ones are told than of logs whose filter is not known.

    Parameters
    ----------
    model : Model
    information : Information
    weights : ndarray
        (N,), of the joints.
    stretches : sequence of Samples
    cutoff : float, optional
        Hz, of the filter of the positions; None where there was none.
    """
    stretches = [one for one in stretches if one.count >= FEWEST_ROWS]
    if not stretches:
        return None
    unconstrained = least_squares(information, weights=weights)
    errors = [(one, errors_of(model, one, unconstrained.base)) for one in stretches]
    least = (LATER, EARLIER) if cutoff is None else (OUT_OF_STEP, OUT_OF_STEP)
    name = "the newest samples"
    return late_log(name, model, information, information, unconstrained, errors, cutoff, least, twice=True)


def said_of_late(late: LateLog, stated: Array, joint_names: Sequence[str]) -> str:
    """Say it in a sentence, with the delays that mend it beside those (N,) by which torques were moved already, s."""
    ((found,),) = late_hypotheses([late], tuple(stated.tolist()), joint_names).values()
    delay: Any = found.settings["processing"]["delay"]
    return f"{found.statement}; {found.evidence}. Give `torque_delay={delay}` (s) if they are."


def wrong_signs(model: Model, information: Information, base: Array, stretches: Sequence[Samples]) -> tuple[str, ...]:
    """Say which torques look to have the wrong sign, where an answer (n_b,) leaves much of the torque of a joint."""
    if not stretches or not np.any(information.joint_relative_error(base) >= WRONG):
        return ()
    return tuple(
        f"{found.statement}: with the other one {found.evidence}. `steelyard doctor` examines a log of them."
        for found in wrong_torque_signs(model, Samples.joined(stretches))
    )
