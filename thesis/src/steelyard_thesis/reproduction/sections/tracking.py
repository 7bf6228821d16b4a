"""Section 5.2: model-based control with the columns of table 4.9, figures 5.6 to 5.8."""

from __future__ import annotations

import numpy as np

from steelyard.control import PositionTracking
from steelyard.identification.wam import ENCODER_COUNTS, TRAJECTORIES, wam_model
from steelyard.report import Chart, Curve
from steelyard.simulation import Sensors, Status, StoppingConditions, simulate

from ..comparison import Comparison
from ..published import column
from ..section import Context, Section, SectionResult, Table

__all__ = ["SECTION"]

_REFERENCE = TRAJECTORIES["B"]
_RUNS = (  # figure, what it is called, column of table 4.9, table of the gains
    ("5.6", "infeasible parameters (WLS)", "WLS", "5.1"),
    ("5.7", "feasible parameters (WLS*)", "WLS_feasible", "5.1"),
    ("5.8", "feasible parameters, tight gains", "WLS_feasible", "5.2"),
    ("", "corrected parameters (WLS')", "WLS_corrected", "5.1"),
    ("", "feasible with extra constraints (WLS*e)", "WLS_feasible_extra", "5.1"),
)
_CONTROL, _MOTION = 2.0, 4.0  # s: the controller is turned on, and the reference moves
_LARGEST_SPEED = 10.0  # rad/s, of the safety stop
_LEAD = (
    "Gravity and Coriolis torques from 0 s, PD control through the inertia matrix from 2 s, the reference moves from "
    "4 s (eq. 5.8). The plant is the arm with the feasible column of table 4.9, friction and rotors included, and "
    "encoders like those of the WAM; the controller has one column of the table and compensates neither. Positions are "
    "the only reference, so that a joint lags by about Kd/Kp. The thesis prints the recorded motion as figures."
)


def _compute(context: Context) -> SectionResult:
    model = wam_model()
    sensors = Sensors(encoder_resolution=2.0 * np.pi / ENCODER_COUNTS)
    comparisons, rows, charts = [], [], []
    for figure, name, parameters, gains in _RUNS:
        context.say(name)
        controller = PositionTracking(
            model,
            column("4.9", parameters),
            _REFERENCE,
            kp=column(gains, "Kp"),
            kd=column(gains, "Kd"),
            control_start=_CONTROL,
            reference_start=_MOTION,
            base=True,
        )
        result = simulate(
            model,
            column("4.9", "WLS_feasible"),
            _REFERENCE.motion([0.0])[0][0],
            np.zeros(7),
            _MOTION + _REFERENCE.duration,
            controller,
            base=True,
            sensors=sensors,
            stopping_conditions=StoppingConditions(velocity=_LARGEST_SPEED),
        )
        wanted = np.array([controller.wanted(t) for t in result.t])
        tracked = result.status is Status.FINISHED
        error = (result.q - wanted)[result.t >= _MOTION]
        rms: list[str | float] = [float(x) for x in np.sqrt(np.mean(error**2, axis=0))] if tracked else [""] * 7
        rows.append((name, gains, "tracks to the end" if tracked else str(result.message), *rms))
        if figure:
            published = "stopped by the safety module" if parameters == "WLS" else "tracks"
            ours = "tracks" if tracked else "stopped by the safety module"
            comparisons.append(Comparison(f"figure {figure}: {name}", published, ours))
            curves = []
            for joint in range(7):
                curves.append(Curve(f"joint {joint + 1}", result.t[::10], result.q[::10, joint], color=joint))
                curves.append(Curve(f"reference {joint + 1}", result.t[::10], wanted[::10, joint], "dashed", joint))
            charts.append(Chart(f"Figure {figure}: {name}", "time, s", "position, rad", tuple(curves)))
    heads = ("controller's parameters", "gains, table", "how it ended", *(f"joint {k + 1}" for k in range(7)))
    table = Table("Tracking of trajectory B: rms error from 4 s on, rad", heads, tuple(rows))
    return SectionResult(tuple(comparisons), (table,), tuple(charts), (_LEAD,))


SECTION = Section("5.2", "Model-based control (figures 5.6 to 5.8)", _compute)
