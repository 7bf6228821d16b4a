"""Impedance shaping and adaptive force control of the simulated WAM (thesis sections 2.4.3 and 2.4.4).

Writes ``index.html``, and the measured impedances and the curves as CSV files.

    python experiments/impedance_and_force.py --output impedance-and-force
"""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.control import (
    AdaptiveForceControl,
    ForceControlOptions,
    ImpedanceControl,
    NullSpaceControl,
    NumericalDifference,
    StiffnessEstimator,
    Tool,
)
from steelyard.dynamics import Model
from steelyard.files import write_text
from steelyard.identification.wam import ENCODER_COUNTS, true_parameters, wam_model
from steelyard.report import Chart, Curve, Section, charts_markup, html_document, require_folder
from steelyard.report.html_document import Markup, table
from steelyard.simulation import ElasticContact, Measurement, Sensors, SimulationResult, simulate

Array = NDArray[np.float64]
CONFIGURATION = np.array([0.0, 0.6, 0.0, 1.8, 0.0, 0.5, 0.0])  # of impedance and force control, rad


def main() -> None:
    """Run everything and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("impedance-and-force"))
    folder = parser.parse_args().output
    require_folder(folder)
    model = wam_model()
    sections = [impedance(model, folder), force_control(model, folder)]
    text = html_document(
        "Impedance and force control",
        "Steelyard experiment",
        "Impedance and force control of the simulated WAM",
        Markup("<p>Thesis sections 2.4.3 and 2.4.4, in simulation.</p>"),
        sections,
        scripts=("charts.js",),
    )
    write_text(text, folder / "index.html")
    print(folder / "index.html")


def write_csv(path: Path, head: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write a table that appears whole or not at all."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    write_text(text.getvalue(), path)


# Section 2.4.3

DESIGNED = {  # along and about the axes of the base
    "stiffness": np.array([600.0, 500.0, 800.0, 3.0, 2.0, 0.8]),
    "damping": np.array([70.0, 60.0, 80.0, 0.3, 0.2, 0.06]),
    "inertia": np.array([5.0, 4.0, 6.0, 0.02, 0.015, 0.004]),
}
AXES = ("x", "y", "z", "about x", "about y", "about z")
SIZE = np.array([6.0, 6.0, 6.0, 0.02, 0.02, 0.02])  # N and N·m
SPAN, SETTLING = 4.0, 1.0  # s


class Pushed:
    """Known wrenches on the tool: a few frequencies along each axis, apart from those of the others."""

    link = "link7"
    point = (0.0, 0.0, 0.0)

    def wrench(self, t: Array | float, position: Array, rotation: Array, velocity: Array) -> Array:
        """Return the wrench at a time, whatever the robot does."""
        force = pushes(np.ravel(t))
        return np.broadcast_to(force if np.ndim(t) else force[0], velocity.shape)


def frequencies(axis: int) -> Array:
    """Return the frequencies of an axis, Hz; whole periods in the span."""
    return np.array([2.0 + axis, 9.0 + axis, 18.0 + axis]) / SPAN


def pushes(t: Array) -> Array:
    """Return wrenches (S, 6)."""
    phases = np.array([0.0, 2.0, 4.0])
    waves = [np.sin(2.0 * np.pi * np.outer(t, frequencies(k)) + phases).sum(axis=1) / 3.0 for k in range(6)]
    return SIZE * np.array(waves).T


def answered(model: Model, result: SimulationResult) -> dict[str, Array]:
    """Measure the impedance from wrenches and motion alone: least squares over the spectral lines of each axis."""
    from scipy.spatial.transform import Rotation

    count = round(SPAN * 1000.0)
    q, t = result.q[-count - 1 : -1], result.t[-count - 1 : -1]
    poses, rest = model.pose(q, "link7"), model.pose(CONFIGURATION, "link7")
    turns = Rotation.from_matrix(poses[:, :3, :3] @ rest[:3, :3].T).as_rotvec()
    moved = np.fft.rfft(np.column_stack((poses[:, :3, 3] - rest[:3, 3], turns)), axis=0)
    pushed = np.fft.rfft(pushes(t), axis=0)
    found = np.zeros((3, 6))
    for axis in range(6):
        bins, w = np.round(frequencies(axis) * SPAN).astype(int), 2.0 * np.pi * frequencies(axis)
        ratio = pushed[bins, axis] / moved[bins, axis]
        (k, a), *_ = np.linalg.lstsq(np.column_stack((np.ones(3), -(w**2))), ratio.real, rcond=None)
        found[:, axis] = k, (ratio.imag @ w) / (w @ w), a
    return dict(zip(DESIGNED, found, strict=True))


def impedance(model: Model, folder: Path) -> Section:
    """Shape the impedance of the tool and measure it."""
    tables, rows = [], []
    plants = {
        "links and rotors": ("Fv", "Fc", "Fo"),
        "with viscous friction, compensated": ("Fc",),
        "with all friction, compensated": (),
    }
    for number, (name, left_out) in enumerate(plants.items()):
        parameters = true_parameters()
        parameters[[k for k, label in enumerate(model.parameter_names) if label[:2] in left_out]] = 0.0
        controller = ImpedanceControl(
            model,
            parameters,
            Tool("link7"),
            model.pose(CONFIGURATION, "link7"),
            **DESIGNED,
            null_space=NullSpaceControl(CONFIGURATION, stiffness=100.0, damping=20.0),
            compensate_drives=True,
            velocity=NumericalDifference(order=2),
        )
        result = simulate(
            model,
            parameters,
            CONFIGURATION,
            np.zeros(7),
            SETTLING + SPAN,
            controller,
            environment=Pushed(),
            sign_width=0.01,
        )
        found = answered(model, result)
        off = {key: 100.0 * (found[key] / DESIGNED[key] - 1.0) for key in DESIGNED}
        print(f"impedance {name}: off by at most", {key: f"{np.abs(x).max():.2f} %" for key, x in off.items()})
        lines = []
        for axis, label in enumerate(AXES):
            pairs = [(DESIGNED[key][axis], found[key][axis], off[key][axis]) for key in DESIGNED]
            lines.append([label, *(text for a, b, c in pairs for text in (f"{a:g}", f"{b:.4g}", f"{c:+.2f} %"))])
            rows.append([name, label, *(f"{x:.6g}" for pair in pairs for x in pair[:2])])
        heads = [f"{key}{part}" for key in DESIGNED for part in (", designed", ", measured", " off by")]
        caption = f"Impedance at the tool, SI units: {name}"
        tables.append(table(caption, ["axis", *heads], lines, identifier=f"impedance-{number}"))
    head = ["plant", "axis", *(f"{key}_{part}" for key in DESIGNED for part in ("designed", "measured"))]
    write_csv(folder / "impedance.csv", head, rows)
    lead = (
        "<p>Known wrenches push the tool of the simulated arm; what it does gives its impedance, axis by axis, without "
        "the controller's own figures.</p>"
    )
    return Section("impedance", "Impedance shaping, section 2.4.3", Markup(lead + "".join(tables)))


# Section 2.4.4


class Watched:
    """A force controller, and what it estimated at each call."""

    def __init__(self, controller: AdaptiveForceControl) -> None:
        self.controller, self.sample_time = controller, controller.sample_time
        self.stiffness: list[float] = []

    def start(self, measurement: Measurement) -> None:
        """Begin."""
        self.controller.start(measurement)
        self.stiffness = []

    def torque(self, measurement: Measurement) -> Array:
        """Return the torques of the controller."""
        torque = self.controller.torque(measurement)
        self.stiffness.append(float(self.controller.stiffness))
        return torque


def environment(t: Array | float) -> Array:
    """Return the stiffness of the environment, N/m: tenfold from 4 s to 8 s."""
    return np.where((np.asarray(t) >= 4.0) & (np.asarray(t) < 8.0), 10_000.0, 1000.0)


def force_control(model: Model, folder: Path) -> Section:
    """Press on a wall whose stiffness changes tenfold."""
    pose = model.pose(CONFIGURATION, "link7")
    wanted: Callable[[float], float] = lambda t: 10.0 + 3.0 * np.sin(np.pi * t)  # noqa: E731
    charts, lines, rows = [], [], []
    for name, compensate_drives in (("friction compensated", True), ("friction left to the observer", False)):
        watched = Watched(
            AdaptiveForceControl(
                model,
                true_parameters(),
                Tool("link7"),
                wanted,
                normal=(0.0, 0.0, -1.0),
                reference=pose,
                kp=400.0,
                kd=40.0,
                options=ForceControlOptions(
                    stiffness=StiffnessEstimator(smallest_displacement=1e-4, smallest_force=1.0)
                ),
                compensate_drives=compensate_drives,
            )
        )
        wall = ElasticContact("link7", surface=(0.0, 0.0, pose[2, 3] - 0.005), normal=(0, 0, 1), stiffness=environment)
        result = simulate(
            model,
            true_parameters(),
            CONFIGURATION,
            np.zeros(7),
            12.0,
            watched,
            environment=wall,
            sensors=Sensors(encoder_resolution=2.0 * np.pi / ENCODER_COUNTS, force_noise=0.03),
            seed=1,
        )
        found = np.array(watched.stiffness)
        t = 0.001 * np.arange(len(found))
        force = np.interp(t, result.t, result.force[:, 2])
        for start, end in ((1.0, 4.0), (4.0, 8.0), (8.0, 12.0)):
            inside = (t >= start) & (t < end)
            truth = float(environment(start))
            wrong = np.flatnonzero(np.abs(found[inside] / truth - 1.0) > 0.05)
            until = 0.001 * (wrong[-1] + 1) if len(wrong) else 0.0
            settled = (t >= start + 0.5) & (t < end)
            error = np.sqrt(np.mean((force - np.array([wanted(x) for x in t]))[settled] ** 2))
            rest = found[settled] / truth - 1.0
            found_end, largest = f"{found[inside][-1]:.0f}", f"{100 * np.abs(rest).max():.1f} %"
            label = f"{name}, from {start:g} s"
            lines.append([label, f"{truth:g}", found_end, f"{until:.3f}", largest, f"{error:.2f}"])
            print("force control:", *lines[-1])
        charts += [
            Chart(
                f"Stiffness: {name}",
                "time, s",
                "N/m",
                (Curve("estimated", t[::5], found[::5]), Curve("true", t[::5], environment(t[::5]), "dashed")),
                y_log=True,
            ),
            Chart(
                f"Force: {name}",
                "time, s",
                "N",
                (
                    Curve("pressed", t[::5], force[::5]),
                    Curve("wanted", t[::5], np.array([wanted(x) for x in t[::5]]), "dashed"),
                ),
            ),
        ]
        rows += [
            [name, f"{a:.3f}", f"{b:.6g}", f"{c:.6g}"] for a, b, c in zip(t[::5], found[::5], force[::5], strict=True)
        ]
    write_csv(folder / "force_control.csv", ["plant", "t", "stiffness_estimated", "force"], rows)
    heads = [
        "",
        "true stiffness, N/m",
        "estimated at the end",
        "within 5 % after, s",
        "then off by at most",
        "rms force error, N",
    ]
    text = table("Adaptive force control on a wall whose stiffness changes tenfold", heads, lines, identifier="force")
    lead = (
        "<p>The wanted force is 10 N with a wave of 3 N at 0.5 Hz; the loop, whose poles are at 20 rad/s, follows it "
        "about 0.1 s later, which is most of the force error.</p>"
    )
    return Section(
        "force-control",
        "Adaptive force control, section 2.4.4",
        Markup(lead + text + charts_markup(charts, identifier="force")),
    )


if __name__ == "__main__":
    main()
