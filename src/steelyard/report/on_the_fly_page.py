"""The folder of an excitation on the fly: the motion, what was measured, the estimate, and a page about them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from steelyard.excitation import QuinticTrajectory, save_trajectory
from steelyard.excitation.design import MOTION_FILES, RECORD
from steelyard.files import replaced_folder, write_json, write_text
from steelyard.online import SimulatedExcitation
from steelyard.regression.estimate import ESTIMATE
from steelyard.robot import RobotFile

from .charts import Chart, Curve, charts_markup, motion_charts
from .excitation_page import PAGE
from .html_document import Markup, Section, bullets, escape, html_document, number, table
from .sections import hashed_file, versions

__all__ = ["ON_THE_FLY_FILES", "on_the_fly_html", "save_on_the_fly"]

FORMAT = "steelyard-on-the-fly-1"
LOG = "log.csv"
ON_THE_FLY_FILES = (*MOTION_FILES, LOG, ESTIMATE, RECORD, PAGE)
KNOT = 0.01
"""s between the knots of the saved motion. Between them polynomials of degree five join positions, velocities and
accelerations: of a motion that is planned from splines 0.8 s apart nothing is lost, and the file stays small."""
_LIBRARIES = ("numpy", "scipy", "llvmlite")


def save_on_the_fly(done: SimulatedExcitation, file: RobotFile, folder: str | Path) -> tuple[Path, ...]:
    """Write the motion in the formats of a design, what was measured, the estimate, the record and a page.

    Parameters
    ----------
    file : RobotFile
        Of the robot.
    folder : str or Path
        Made where it is missing; files of the same names are replaced.

    Returns
    -------
    tuple of Path
        The files, the page last.
    """
    result, names = done.result, done.result.joint_names
    step = max(1, round(KNOT * done.options["rate"]))
    rows = slice(0, len(result.t), step)
    motion = QuinticTrajectory(result.t[rows] - result.t[0], result.q[rows], result.dq[rows], result.ddq[rows])
    with replaced_folder(folder, record=RECORD) as made:
        for name in MOTION_FILES:
            save_trajectory(motion, made / name, joint_names=names)
        done.excitation.recording.save(made / LOG)
        done.estimate.save(made / ESTIMATE)
        write_text(on_the_fly_html(done), made / PAGE)
        write_json(_record(done, file), made / RECORD, indent=2)
    return tuple(Path(folder) / name for name in ON_THE_FLY_FILES)


def _record(done: SimulatedExcitation, file: RobotFile) -> dict[str, Any]:
    excitation = done.excitation
    return {
        "format": FORMAT,
        "robot": excitation.model.robot.name,
        "joint_names": list(done.result.joint_names),
        "simulated_robot": done.truth,
        "duration": float(done.result.end_time),
        "expected_error": excitation.expected_error,
        "torque_error": done.torque_error,
        "reached": done.reached,
        "use_of_limits": done.use,
        "exceeded": list(done.exceeded),
        "torque_noise": done.noise.tolist(),
        "steps": [
            {
                "time": step.time,
                "stage": step.stage,
                "expected_error": step.expected_error,
                "joint_errors": step.joint_errors.tolist(),
                "bandwidth": step.bandwidth.tolist(),
                "torque_bound": [float(one) if np.isfinite(one) else None for one in step.torque_bound],
                "tracking_error": step.tracking_error.tolist(),
            }
            for step in excitation.steps
        ],
        "interruptions": [{"time": time, "reason": reason} for time, reason in excitation.interruptions],
        "unchecked": list(excitation.unchecked),
        "options": done.options,
        "inputs": [hashed_file(file.path)] if file.path.exists() else [],
        "versions": versions(_LIBRARIES),
    }


def on_the_fly_html(done: SimulatedExcitation) -> str:
    """Return the page: what was learned when, the motion, and the limits."""
    excitation, result = done.excitation, done.result
    names, robot = result.joint_names, excitation.model.robot
    steps = excitation.steps
    times = np.array([step.time for step in steps])

    motion = motion_charts(result, "rad or m", "rad/s or m/s", "N·m or N")
    # What is known changes when a motion takes over, and holds until the next.
    held = np.repeat(np.append(times, result.end_time), 2)[1:-1]
    error = np.repeat([step.expected_error for step in steps], 2)
    learned = Chart("Expected error of predicted torques", "time, s", "of the torques", (Curve("all", held, error),))
    rows = [
        (
            f"{step.time:.1f}",
            step.stage,
            f"{step.expected_error:.2%}",
            *(f"{one:.1%}" for one in step.joint_errors),
        )
        for step in steps
    ]
    columns = ("t, s", "stage", "expected error", *names)
    known = table("Expected error, of each joint too", columns, rows, identifier="steps", texts=(1,))
    use = table(
        "Largest part of each limit that was used",
        ("limit", "used"),
        [(name, f"{part:.1%}") for name, part in done.use.items()],
        identifier="use",
    )
    told = [f"At {time:.1f} s the motion was broken off: {reason}." for time, reason in excitation.interruptions]
    lead = Markup(
        f"<p>In the simulator, after {number(float(result.end_time), 1)} s: expected torque error "
        f"{excitation.expected_error:.2%}, true one {done.torque_error:.2%}.</p>"
        f"<p>The simulated robot is {escape(done.truth)}.</p>"
        + "".join(f'<p class="lead">{escape(sentence)}</p>' for sentence in done.exceeded)
    )
    sections = [
        Section("learned", "What was known when", Markup(charts_markup([learned], identifier="error") + known)),
        Section("motion", "The motion", Markup(charts_markup(motion, identifier="joints") + bullets(told))),
        Section("limits", "Limits", Markup(use + bullets(done.limit_notes))),
    ]
    title = f"{robot.name}: excitation on the fly"
    return html_document(title, "Steelyard excitation", robot.name, lead, sections, scripts=("charts.js",))
