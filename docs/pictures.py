"""Make every picture of the documentation anew, each from a run of Steelyard: ``python docs/pictures.py``.

``python docs/pictures.py NAME...`` makes some of them. With ``--check`` nothing is written: the runs are made again and
their figures compared with those inside the pictures, and what differs is told. Every run has its seeds, but processors
round differently. Rounding turns single counts of simulated encoders, from which on a log has other noise: numbers are
compared to five per cent. Searches of motions end elsewhere, and some numbers are mostly noise: their scatter stands
beside them.
"""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))
from drawing import (
    BLUE,
    COLORS,
    GOLD,
    GREEN,
    GREY,
    ORANGE,
    RED,
    SCATTER,
    SOFT,
    TEXT,
    Axes,
    Drawing,
    RobotView,
    bars,
    figures_of,
    intervals,
    metadata,
    scattering,
    span,
    terminal,
)

import steelyard as sy
from steelyard.identification.examples import EXAMPLES, write_example
from steelyard.report import robot_svg, torque_svg

Array = NDArray[np.float64]
IMAGES = Path(__file__).resolve().parent / "images"
BASIS = {"measured": BLUE, "bounded": GREEN, "assumed": GOLD, "unknown": GREY}
TOLERANCE = 0.05
ENDS = 0.05  # of the condition number: 15.9, 16.3 and 17.0 with AVX-512, AVX2 and SSE3
PICTURES: dict[str, Callable[[Runs], Drawing | str]] = {}


def picture(made: Callable[[Runs], Drawing | str]) -> Callable[[Runs], Drawing | str]:
    """Register a picture under the name of its function, with dashes."""
    PICTURES[made.__name__.replace("_", "-")] = made
    return made


class Runs:
    """The runs that pictures are drawn from, each made when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._examples: dict[str, tuple[sy.Identification, sy.Estimate]] = {}

    def written(self, name: str) -> Path:
        """Return the folder of an example."""
        place = self.folder / name
        return place if place.is_dir() else write_example(name, place)

    def example(self, name: str) -> tuple[sy.Identification, sy.Estimate]:
        """Identify an example, and return the result with the truth."""
        if name not in self._examples:
            place = self.written(name)
            found = sy.identify(place / "robot.toml", [place / "train.csv"], validate=[place / "validate.csv"])
            self._examples[name] = found, sy.Estimate.load(place / "truth.json")
        return self._examples[name]

    @cached_property
    def demo(self) -> sy.Identification:
        """The demonstration: a simulated WAM with wrong CAD."""
        from steelyard.identification import demonstrate

        return demonstrate(self.folder / "demo")

    @cached_property
    def panda(self) -> sy.Identification:
        """The example that most pages use."""
        return self.example("panda")[0]

    @cached_property
    def panda_log(self) -> sy.Recording:
        """The log that the Panda was identified with."""
        return sy.Recording.read(self.written("panda") / "train.csv", joints=7)

    @cached_property
    def loaded_panda(self) -> tuple[sy.Recording, sy.Recording]:
        """Logs of a Panda without and with a payload of 1.5 kg, in one motion."""
        panda, truth = self.example("panda")
        model, values = panda.model, np.asarray(truth.parameters)
        held = values.copy()
        held[model.link_columns[-1]] += sy.Inertia.from_com(1.5, [0.0, 0.02, 0.18], 0.004 * np.eye(3)).parameters
        sensors = sy.simulation.Sensors(encoder_resolution=2 * np.pi / 2**17, torque_noise=0.15)
        motion = sy.excitation.FourierTrajectory(
            a=np.random.default_rng(3).normal(size=(7, 4)) * 0.25,
            b=np.random.default_rng(4).normal(size=(7, 4)) * 0.25,
            center=self.panda_log.q.mean(axis=0),
            frequency=0.1,
        )
        unloaded, loaded = (
            sy.play(model, parameters, motion, rate=500.0, sensors=sensors, seed=k)
            for k, parameters in enumerate((values, held))
        )
        return unloaded, loaded

    @cached_property
    def two_links(self) -> tuple[sy.Model, Array, sy.excitation.ExcitationDesign, sy.Recording]:
        """An arm of two links, its truth, a designed motion, and its log."""
        from steelyard.excitation import SearchOptions

        robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], name="arm", gravity=(0, -9.81, 0))
        model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))
        truth = np.zeros(model.parameter_count)
        values = {"m1": 3.0, "lx1": -0.6, "Lzz1": 0.22, "m2": 2.0, "lx2": -0.4, "Lzz2": 0.12}
        values |= {"Fvj1": 0.4, "Fcj1": 0.8, "Fvj2": 0.2, "Fcj2": 0.3}
        for name, value in values.items():
            truth[model.parameter_names.index(name)] = value
        limits = {"lower": -2.0, "upper": 2.0, "velocity": 3.0, "acceleration": 10.0}
        search = SearchOptions(starts=2, workers=1)
        design = sy.design_excitation(model, limits, period=5.0, harmonics=4, search=search)
        sensors = sy.simulation.Sensors(encoder_resolution=2 * np.pi / 65536, torque_noise=0.2)
        return model, truth, design, sy.play(model, truth, design.trajectory, sensors=sensors, seed=1)


def with_figures(svg: str, result: sy.Identification) -> str:
    """Put the figures of a result into a picture that the report draws."""
    figures = {
        "error, %": round(100 * result.predictions[-1].feasible_error, 2),
        "mass, kg": round(result.total_mass, 3),
        "possible": str(result.verdict.feasible),
    }
    return re.sub(r"(<svg[^>]*>)", lambda found: f"{found[1]}{metadata(figures)}", svg, count=1)


def nearest_to_cad(result: sy.Identification) -> Array:
    """Return the parameters nearest to CAD with the base parameters of plain least squares, (n,)."""
    model = result.model
    cad = np.nan_to_num(np.asarray(model.robot.parameters))
    mapping = np.asarray(model.base_parameters().K, dtype=float)
    return np.asarray(cad + np.linalg.pinv(mapping) @ (result.unconstrained.base - mapping @ cad))


def bent(model: sy.Model, angles: tuple[float, ...]) -> Array:
    """Return a configuration near these angles, within the limits."""
    joints = [model.robot.joints[index] for index in model.robot.driving_joints]
    low = np.array([joint.lower if math.isfinite(joint.lower) else -math.pi for joint in joints])
    high = np.array([joint.upper if math.isfinite(joint.upper) else math.pi for joint in joints])
    asked = np.resize(np.asarray(angles), model.dof)
    return np.clip(asked, low + 0.1 * (high - low), high - 0.1 * (high - low))


PANDA_POSE = (0.4, -0.5, 0.0, -1.9, 0.0, 1.5, 0.7)


@picture
def story(runs: Runs) -> Drawing:
    """The README's: an impossible robot and a possible one, which predict the same torques."""
    result = runs.example("xarm7")[0]
    prediction = result.predictions[-1]
    drawing = Drawing(
        "An xArm 7 as plain least squares finds it, with impossible links, and as Steelyard finds it", 1000, 560
    )
    assert result.verdict.feasible is False, "the picture says that least squares is impossible, which must be proved"
    assert result.possible
    bad, answer = nearest_to_cad(result), np.asarray(result.estimate.parameters)
    cad = np.nan_to_num(np.asarray(result.model.robot.parameters))
    q = bent(result.model, (0.4, 0.5, 0.3))
    for left, label, verdict, color, parameters in (
        (30.0, "Plain least squares", "An impossible robot", RED, bad),
        (515.0, "Steelyard", "A robot that can exist", GREEN, answer),
    ):
        drawing.add(f'<path d="M{left:g} 26h455" stroke="{color}" stroke-width="3"/>')
        drawing.text(left, 50, label, 14, SOFT)
        drawing.text(left, 80, f"{'✗' if color == RED else '✓'}  {verdict}", 24, color, bold=True)
        view = RobotView(drawing, (left + 110, 176, 240, 216), result.model, q, azimuth=-60)
        view.frame(answer, cad)
        drawing.add(f'<clipPath id="at{left:g}"><path d="M{left:g} 114h455v312h-455Z"/></clipPath>')
        drawing.add(f'<g clip-path="url(#at{left:g})">')
        view.skeleton()
        if color == GREEN:
            view.bodies(cad, GREY, outline=True)
        impossible = view.bodies(parameters, BLUE)
        drawing.add("</g>")
        if color == RED:
            drawing.figures["some links are impossible"] = str(bool(impossible))  # noise decides which
            drawing.text(
                left, 104, f"No robot has these values: proved. Red: {len(impossible)} of {len(view.poses)} links", 14
            )
            words = "the parameters nearest to CAD that predict as least squares does"
        else:
            drawing.text(left, 104, "Every link is a possible body: proved, checked with integers", 14)
            words = "ellipsoids of the same inertia; CAD is dotted"
        drawing.text(left + 455, 440, words, 11.5, SOFT, "end")
    joint = int(np.argmax(np.sqrt(np.nanmean(np.square(prediction.trace.measured), axis=0))))
    trace = prediction.trace
    rows = trace.t <= trace.t[0] + 16.0
    for left, kind, color, error in (
        (66.0, "unconstrained", ORANGE, prediction.unconstrained_error),
        (551.0, "feasible", BLUE, prediction.feasible_error),
    ):
        values = getattr(trace, kind)[rows, joint]
        axes = Axes(
            drawing, (left, 466, 418, 58), span(trace.t[rows], room=0), span(trace.measured[rows, joint]), x_ticks=False
        )
        axes.curve(trace.t[rows], trace.measured[rows, joint], GREY, 4.5)
        axes.curve(trace.t[rows], values, color, 1.5)
        name = result.estimate.joint_names[joint]
        drawing.text(left, 546, f"{name}, N·m: measured in grey", 12, SOFT)
        drawing.text(left + 418, 546, f"error {100 * error:.1f} % on another motion", 12, TEXT, "end")
        drawing.figures[f"error of {kind}, %"] = round(100 * error, 2)
    return drawing


@picture
def torques(runs: Runs) -> str:
    """Measured and predicted torques of the demonstration."""
    return with_figures(torque_svg(runs.demo), runs.demo)


@picture
def recording(runs: Runs) -> Drawing:
    """Ten seconds of a terminal: the demonstration."""
    run = subprocess.run(
        [sys.executable, "-m", "steelyard", "demo", "--output", "steelyard-demo"],
        cwd=runs.folder,
        env={**os.environ, "COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"},
        capture_output=True,
        text=True,
        check=True,
        encoding="utf-8",
    )
    steps = [line.strip() for line in run.stderr.replace("\r", "\n").splitlines() if " s  " in line]
    told = [line.split(" s  ", 1)[1] for line in steps]
    lines = [line.rstrip() for line in run.stdout.splitlines()]
    rows: list[tuple[str, float, str]] = [("$ steelyard demo", 0.3, "#ffffff")]
    steps = [step for step in told if not step.startswith(("simulating:", "ends of"))][:9]
    rows += [(f"  {step}", 0.8 + 0.28 * k, "#8c98a4") for k, step in enumerate(steps)]
    first = next(k for k, line in enumerate(lines) if "can exist" in line)
    end = next(k for k, line in enumerate(lines) if line.strip().startswith("all "))
    wrapped = _wrapped(lines[first])
    at = 0.8 + 0.28 * len(steps) + 0.4
    rows += [(line, at, "#9fe0a0") for line in wrapped]
    rows += [(line, at + 0.5, "#dfe5ea") for line in lines[first + 1 : end + 1] if line.strip()]
    impossible = next(line for line in lines if line.startswith("Plain least squares"))
    rows += [(line, at + 1.6, "#f0a58a") for line in _wrapped(impossible)]
    truth = [line for line in lines if line.startswith(("The truth lies", "Look at"))]
    rows += [(part, at + 2.8, "#ffffff") for line in truth for part in _wrapped(line)]
    made = terminal("A recording of `steelyard demo` in a terminal", rows, 10.0)
    made.figures["verdict"] = lines[first]
    return made


def _wrapped(line: str, width: int = 100) -> list[str]:
    import textwrap

    return textwrap.wrap(line, width, subsequent_indent="  ")


@picture
def identified_torques(runs: Runs) -> str:
    """Measured and predicted torques of the Panda."""
    return with_figures(torque_svg(runs.panda), runs.panda)


@picture
def robot(runs: Runs) -> str:
    """The drawing of the report: what is known of each link."""
    result = runs.example("xarm7")[0]
    return with_figures(robot_svg(result, bent(result.model, (0.4, 0.5, 0.3))), result)


@picture
def parameter_table(runs: Runs) -> Drawing:
    """Masses and centres of mass with their intervals, coloured by what they rest on."""
    result = runs.panda
    drawing = Drawing("Intervals of masses and friction, and the values of CAD", 760, 360)
    names = [row for row in result.parameters if row.name in {"m2", "m4", "m5", "m6", "m7"}]
    rows = [
        (f"mass of link {row.name[1:]}", row.value, row.lower, row.upper, row.cad, BASIS[row.basis]) for row in names
    ]
    intervals(drawing, (130, 40, 600, 130), rows, "kg")
    friction = [row for row in result.parameters if row.name in {"Fcj2", "Fcj4", "Fcj6", "Fvj2", "Fvj4"}]
    rows = [
        (
            f"{'Coulomb' if row.name[1] == 'c' else 'viscous'}, joint {row.name[-1]}",
            row.value,
            row.lower,
            row.upper,
            math.nan,
            BASIS[row.basis],
        )
        for row in friction
    ]
    intervals(drawing, (130, 208, 600, 100), rows, "N·m, N·m·s/rad")
    drawing.legend(130, 22, [(name, BASIS[name]) for name in ("measured", "bounded", "assumed")])
    drawing.text(730, 22, "dot: value, bar: interval of 95 %, tick: CAD", 12, SOFT, "end")
    return drawing


@picture
def doctor(runs: Runs) -> Drawing:
    """Clipped torques that `steelyard doctor` finds."""
    from steelyard.identification import examine

    t = np.arange(4000) / 200
    q = np.column_stack([np.sin(2 * t), np.sin(3 * t)])
    torque = np.clip(8 * np.cos(5 * np.column_stack([t, 1.1 * t])), -6.0, 6.0)
    found = examine({"t": 1e3 * t, "q": q, "tau": torque})
    drawing = Drawing("A torque that is clipped at 6 N·m, as the doctor finds it", 760, 250)
    axes = Axes(drawing, (60, 40, 670, 150), (0, 4), (-9, 9), "t, s", "", "torque of joint 2, N·m")
    rows = t <= 4.0
    axes.curve(t[rows], 8 * np.cos(5.5 * t[rows]), GREY, 1.4, "4 3")
    axes.curve(t[rows], torque[rows, 1], BLUE, 2.2)
    for level in (6.0, -6.0):
        axes.level(level, RED)
    drawing.text(
        60,
        236,
        f"doctor: {', '.join(finding.kind for finding in found.findings)}; `{found.toml.split(chr(10))[-1]}` mends it",
        12,
        SOFT,
    )
    drawing.figures["findings"] = len(found.findings)
    return drawing


@picture
def mistakes(runs: Runs) -> Drawing:
    """The error of each joint with a wrong sign of one torque, and mended."""
    panda = runs.panda
    log = runs.panda_log
    torque = log.torque.copy()
    torque[:, 3] *= -1.0
    wrong = sy.identify(panda.model, sy.Recording(t=log.t, q=log.q, torque=torque, source="wrong.csv"))
    found = next(iter(wrong.mistakes.values()))[0]
    drawing = Drawing("Errors of the joints with a torque of the wrong sign, and without", 760, 320)
    before, after = wrong.predictions[0], panda.predictions[0]
    names = list(panda.estimate.joint_names)
    series = [
        ("as logged", 100 * before.joint_feasible_error, RED),
        ("mended", 100 * after.joint_feasible_error, BLUE),
    ]
    bars(drawing, (120, 46, 600, 225), names, series, unit=" %")
    drawing.legend(120, 26, [(name, color) for name, _, color in series])
    drawing.text(20, 304, f"identify says: {found.statement}, and names the line that mends it", 12.5)
    drawing.figures["statement"] = found.statement
    return drawing


@picture
def payload(runs: Runs) -> Drawing:
    """Torques without and with a payload, and what it weighs."""
    from steelyard.estimators import CarriedBody, estimate_payload

    model, (unloaded, loaded) = runs.panda.model, runs.loaded_panda
    found = estimate_payload(
        CarriedBody(model, model.dof - 1, changes="nothing"),
        sy.Information.from_samples(model, loaded.process(cutoff=8.0)),
        sy.Information.from_samples(model, unloaded.process(cutoff=8.0)),
    )
    drawing = Drawing(
        "The torque of a joint without and with a payload, and the payload that explains the difference", 760, 330
    )
    joint = 1
    axes = Axes(
        drawing,
        (60, 40, 410, 220),
        (0, 10),
        span(unloaded.torque[:, joint], loaded.torque[:, joint]),
        "t, s",
        "",
        "torque of joint 2, N·m",
    )
    axes.curve(unloaded.t, unloaded.torque[:, joint], GREY, 1.2)
    axes.curve(loaded.t, loaded.torque[:, joint], BLUE, 1.2)
    drawing.legend(60, 314, [("unloaded", GREY), ("loaded", BLUE)])
    drawing.text(520, 60, "payload", 13, TEXT, bold=True)
    for row, quantity in enumerate(found.quantities[:4]):
        drawing.text(520, 88 + 42 * row, quantity.meaning.capitalize(), 12, SOFT)
        drawing.text(
            520,
            106 + 42 * row,
            f"{quantity.value:.3f} {quantity.unit}  ({quantity.lower:.3f} to {quantity.upper:.3f})",
            13,
        )
    drawing.text(520, 270, "put on: 1.5 kg at (0, 0.02, 0.18) m", 12, GREEN)
    drawing.figures["mass, kg"] = round(found.mass, 3)
    return drawing


@picture
def pick_up(runs: Runs) -> Drawing:
    """Mass, centre of mass and inertia of a payload, as they arrive while an arm moves."""
    from steelyard.online import simulated_pick_up, watch_pick_up

    run = watch_pick_up(simulated_pick_up(2014, when=25.0, duration=31.0))
    truth = run.simulated.payload
    drawing = Drawing(
        "Mass, centre of mass and inertia of a payload with their intervals, in the seconds after it was picked up",
        760,
        300,
    )
    panels = [
        ("mass, kg", ("mass",), (truth.mass,), (1.8, 2.2)),
        ("centre of mass, m", ("cx", "cy", "cz"), tuple(truth.com), (-0.05, 0.15)),
        ("inertia about it, kg m²", ("Ixx", "Iyy", "Izz"), tuple(np.diagonal(truth.about_com)), (0.0, 0.02)),
    ]
    shown = run.times <= 6.0
    for column, (label, names, true, limits) in enumerate(panels):
        axes = Axes(drawing, (50 + 245 * column, 40, 190, 200), (0, 6), limits, "s after the pick-up", "", label)
        for name, value, color in zip(names, true, (BLUE, GREEN, GOLD), strict=False):
            found = [one[name] for one in run.told]
            low, high, values = (
                np.clip([getattr(one, part) for one in found], *limits)[shown] for part in ("lower", "upper", "value")
            )
            axes.band(run.times[shown], low, high, color)
            axes.curve(run.times[shown], values, color, 1.8)
            axes.curve([0.0, 6.0], [value, value], color, 1.0, "4 3")
    drawing.legend(50, 288, [("x, or the mass", BLUE), ("y", GREEN), ("z", GOLD)])
    drawing.text(710, 288, "bands: 95 % intervals; dashed: the truth", 12, SOFT, "end")
    final = run.told[-1]
    drawing.figures["mass, kg"] = round(final.mass, 3)
    drawing.figures["changes"] = len(run.changes)
    return drawing


@picture
def currents(runs: Runs) -> Drawing:
    """Gains of drives, found from two logs of currents with a known payload."""
    from steelyard.estimators import CarriedBody, KnownPayload, estimate_drive_gains

    model, (unloaded, loaded) = runs.panda.model, runs.loaded_panda
    gains = np.array([11.7, 11.7, 9.9, 9.9, 3.1, 3.1, 2.9])
    logs = [
        sy.Information.from_samples(
            model, sy.Recording(t=log.t, q=log.q, torque=log.torque / gains).process(cutoff=8.0)
        )
        for log in (loaded, unloaded)
    ]
    body = CarriedBody(model, model.dof - 1, changes="nothing")
    found = estimate_drive_gains(body, *logs, KnownPayload(1.5, (0.0, 0.02, 0.18), 0.004 * np.eye(3)))
    drawing = Drawing("The gains of the drives that two logs of currents tell, and the true ones", 760, 300)
    columns = (model.robot.joint_names, found.gains, found.lower, found.upper, gains)
    rows = [(*row, BLUE) for row in zip(*columns, strict=True)]
    intervals(drawing, (130, 40, 600, 210), rows, "N·m per A", "truth")
    drawing.text(130, 24, "dot: found, bar: interval, tick: truth", 12, SOFT)
    return drawing


@picture
def validate(runs: Runs) -> Drawing:
    """Errors joint by joint on the data of the fit and on another motion."""
    panda = runs.panda
    drawing = Drawing("Errors of the joints on the data of the fit and on another motion", 760, 320)
    series = [
        ("data of the fit", 100 * panda.predictions[0].joint_feasible_error, GREY),
        ("another motion", 100 * panda.predictions[1].joint_feasible_error, BLUE),
    ]
    bars(drawing, (120, 46, 600, 235), list(panda.estimate.joint_names), series, unit=" %")
    drawing.legend(120, 26, [(name, color) for name, _, color in series])
    drawing.figures.update({name: round(float(values[1]), 2) for name, values, _ in series})
    return drawing


def _logs_of_two_links(runs: Runs, counts: list[int]) -> list[tuple[Path, sy.Information]]:
    """Logs of an arm of two links with so many rows, and the Information of each."""
    model, truth, design, _ = runs.two_links
    random, found = np.random.default_rng(5), []
    for number, count in enumerate(counts):
        t = np.arange(count) / 200.0
        q, dq, ddq = design.trajectory.motion(t % design.trajectory.duration)
        torque = model.inverse_dynamics(q, dq, ddq, truth) + 0.2 * random.normal(size=q.shape)
        path = runs.folder / f"two-links-{number}.csv"
        table = np.column_stack([t, q, torque])
        np.savetxt(path, table, fmt="%.9g", delimiter=",", header="t,q1,q2,tau1,tau2", comments="")
        samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)
        found.append((path, sy.Information.from_samples(model, samples, batch_means=False)))
    return found


@picture
def long_logs(runs: Runs) -> Drawing:
    """What a log takes, and what is left of it when it is reduced."""
    from steelyard.fleet.packed import packed

    counts = [1000, 4000, 16000, 64000]
    logs = _logs_of_two_links(runs, counts)
    sizes = {
        "the log as CSV": ([path.stat().st_size / 1e3 for path, _ in logs], GREY),
        "its Information": ([len(packed(information)) / 1e3 for _, information in logs], BLUE),
    }
    drawing = Drawing("A log grows with its length; what it is reduced to does not", 760, 290)
    axes = Axes(drawing, (70, 40, 660, 190), (800, 80000), (1, 6000), "rows", "", "kB", logarithmic="xy")
    for name, (values, color) in sizes.items():
        axes.curve(counts, values, color, 2.0)
        axes.dots(counts, values, color)
        drawing.figures[f"{name}, kB"] = values[-1]
    drawing.legend(70, 280, [(name, color) for name, (_, color) in sizes.items()])
    return drawing


def _tree(runs: Runs, places: list[tuple[str, str]], title: str) -> Drawing:
    """How four logs become one Information: each is reduced where `places` says (name, color), and pairs are added."""
    from steelyard.fleet.packed import packed

    logs = _logs_of_two_links(runs, [4000, 6000, 3000, 5000])
    drawing = Drawing(title, 760, 290)

    def box(x: float, y: float, words: str, more: str, color: str) -> None:
        drawing.add(
            f'<rect x="{x:g}" y="{y:g}" width="150" height="44" rx="6" fill="#eef2f5" stroke="{color}" '
            'stroke-width="1.6"/>'
        )
        drawing.text(x + 75, y + 19, words, 13, TEXT, "middle", bold=True)
        drawing.text(x + 75, y + 35, more, 11, SOFT, "middle")

    def arrow(x: float, y: float, to_x: float, to_y: float) -> None:
        drawing.add(f'<path d="M{x:g} {y:g}L{to_x:g} {to_y:g}" stroke="{GREY}" stroke-width="1.5"/>')

    tops = [14.0 + 68 * k for k in range(4)]
    for top, (path, information), (name, color) in zip(tops, logs, places, strict=True):
        number = path.stem[-1]
        drawing.text(20, top + 19, f"run{int(number) + 1}.csv", 13, TEXT, bold=True)
        drawing.text(20, top + 35, f"{path.stat().st_size / 1e3:.0f} kB{name}", 11, color if name else SOFT)
        arrow(148, top + 22, 178, top + 22)
        box(180, top, "Information", f"{len(packed(information)) / 1e3:.1f} kB", color)
    for k in (0, 2):
        middle = (tops[k] + tops[k + 1]) / 2
        box(400, middle, "sum", f"runs {k + 1} and {k + 2}", GREY)
        arrow(330, tops[k] + 22, 398, middle + 22)
        arrow(330, tops[k + 1] + 22, 398, middle + 22)
    total = sum((information for _, information in logs[1:]), logs[0][1])
    middle = (tops[0] + tops[3]) / 2
    for top in ((tops[0] + tops[1]) / 2, (tops[2] + tops[3]) / 2):
        arrow(550, top + 22, 598, middle + 22)
    box(600, middle, "sum", f"{len(packed(total)) / 1e3:.1f} kB, then the fit", BLUE)
    drawing.figures["kB"] = len(packed(total)) / 1e3
    return drawing


@picture
def many_logs(runs: Runs) -> Drawing:
    """Logs, what they are reduced to, and the order of the sums."""
    return _tree(runs, [("", BLUE)] * 4, "Each log is reduced by itself; sums are formed in the order of the logs")


@picture
def cluster(runs: Runs) -> Drawing:
    """The same, where two machines reduce the logs."""
    one, two = (", on machine 1", BLUE), (", on machine 2", ORANGE)
    return _tree(runs, [one, two, two, one], "Whichever machine reduces a log, the sums have one order")


@picture
def fleet(runs: Runs) -> Drawing:
    """Thirty arms beside each other; in two a joint runs hard, in two a link is heavier."""
    from steelyard.fleet import compare_siblings, possible_causes, variations
    from steelyard.regression import ParameterCovariance

    rows = [("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), (0, 0.35, 0, "q")]
    model = sy.Model(sy.Robot.from_dh(rows, name="arm").with_terms(sy.Viscous(), sy.Coulomb()))
    usual = np.zeros(model.parameter_count)
    for mass, columns in zip((5.0, 4.0, 2.5), model.link_columns, strict=True):
        body = sy.Inertia.from_com(mass, [-0.15, 0.01, 0.02], 0.015 * mass * np.diag([0.5, 1.0, 1.0]))
        usual[columns] = body.parameters
        usual[columns[-1] + 1 : columns[-1] + 3] = 0.2 * mass, 0.3 * mass
    faults = {4: ("Fvj2", "Fcj2", 1.5), 11: ("Fvj3", "Fcj3", 1.4), 17: (2, 1.1), 23: (1, 1.1)}
    t, told = np.arange(0.0, 30.0, 0.01)[:, None], []
    for number in range(30):
        random = np.random.default_rng(number)
        values = usual.copy()
        for columns in model.link_columns:
            values[columns] *= 1.0 + 0.01 * random.normal()
            values[columns[-1] + 1 : columns[-1] + 3] *= 1.0 + 0.05 * random.normal(size=2)
        *where, factor = faults.get(number, (1.0,))
        for place in where:
            at = [model.parameter_names.index(place)] if isinstance(place, str) else model.link_columns[int(place)]
            values[at] *= factor
        w, phase = 2.0 * np.pi * np.array([0.15, 0.22, 0.31]), random.uniform(0.0, 6.0, 3)
        q = np.sin(w * t + phase) + 0.4 * np.cos(2.0 * w * t)
        dq, ddq = np.gradient(q, 0.01, axis=0), np.gradient(np.gradient(q, 0.01, axis=0), 0.01, axis=0)
        torque = model.inverse_dynamics(q, dq, ddq, values) + 0.3 * random.normal(size=q.shape)
        info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
        estimate = sy.least_squares(info)
        told.append((estimate.base, ParameterCovariance.of(info, estimate.base, estimate.weights).matrix))
    bases, covariances = (np.array(part) for part in zip(*told, strict=True))
    causes = possible_causes(model, usual, np.median(bases, axis=0))
    found = compare_siblings(bases, covariances, causes, variations(model, causes))
    names = ["friction of joint1", "friction of joint2", "friction of joint3", "mass of link2", "mass of link3"]
    chosen = [next(k for k, cause in enumerate(causes) if cause.name == name) for name in names]
    drawing = Drawing("How far each robot of a simulated fleet is from its siblings, part by part", 760, 290)
    place = (190.0, 20.0, 540.0, 200.0)
    axes = Axes(drawing, place, (-4.0, 12.0), (-0.5, len(names) - 0.5), "standard deviations", y_ticks=False)
    named = {(one.robot, one.cause.name): one for one in found.deviations}
    for line, (name, k) in enumerate(zip(names, chosen, strict=True)):
        level = len(names) - 1 - line
        drawing.text(180, float(axes.up(level)) + 4, name, 12.5, TEXT, "end")
        scores = found.amplitude[:, k] / found.error[:, k]
        others = np.array([score for robot, score in enumerate(scores) if robot not in found.differs])
        axes.dots(others, np.full(len(others), float(level)), GREY)
        out = [one.deviations for (_, cause), one in named.items() if cause == name]
        axes.dots(np.array(out), np.full(len(out), float(level)), RED, 5.0)
    drawing.figures["named"] = sorted(f"{robot}: {cause}" for robot, cause in named)
    return drawing


@picture
def excite(runs: Runs) -> Drawing:
    """A designed motion within its limits, from rest to rest."""
    design = runs.two_links[2]
    t = np.linspace(0.0, design.trajectory.duration, 600)
    q, dq, ddq = design.trajectory.motion(t)
    drawing = Drawing("A designed motion of two joints within its limits", 760, 380)
    for row, (values, limit, title) in enumerate(
        ((q, 2.0, "position, rad"), (dq, 3.0, "velocity, rad/s"), (ddq, 10.0, "acceleration, rad/s²"))
    ):
        axes = Axes(
            drawing,
            (60, 40 + 112 * row, 670, 76),
            (0, t[-1]),
            (-1.15 * limit, 1.15 * limit),
            "t, s" if row == 2 else "",
            "",
            title,
            x_ticks=row == 2,
        )
        for joint in range(2):
            axes.curve(t, values[:, joint], COLORS[joint])
        axes.level(limit, RED)
        axes.level(-limit, RED)
    drawing.text(730, 24, f"condition number {design.condition_number:.3g}; dashed: limits", 12, SOFT, "end")
    scattering(drawing, "condition number", round(design.condition_number, 3), ENDS * design.condition_number)
    return drawing


@picture
def on_the_fly(runs: Runs) -> Drawing:
    """Excitation on the fly of an arm of two joints: the motion, what is known, and the gains."""
    from steelyard.online import ActiveExcitation
    from steelyard.simulation import Sensors

    robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], name="arm", gravity=(0, -9.81, 0))
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))
    bodies = [(3.0, [-0.2, 0.02, 0.0], 0.02, [0.6, 0.9]), (1.2, [-0.15, -0.01, 0.0], 0.006, [0.3, 0.4])]
    truth = np.concatenate(
        [[*sy.Inertia.from_com(m, c, i * np.eye(3)).parameters, *drive] for m, c, i, drive in bodies]
    )
    limits = {"lower": -2.0, "upper": 2.0, "velocity": 2.0, "acceleration": 6.0, "torque": [60.0, 30.0]}
    excitation = ActiveExcitation(model, limits, accuracy=0.01, longest=18.0, cutoff=8.0)
    sensors = Sensors(velocity="none", torque_noise=[0.3, 0.15], torque_time_constant=0.02)
    run = sy.simulate(model, truth, [0.2, -0.3], [0.0, 0.0], 20.0, excitation, sensors=sensors)
    times = np.array([step.time for step in excitation.steps])
    drawing = Drawing("Excitation on the fly: motion, expected error, bandwidth of the feedback", 760, 400)
    axes = Axes(drawing, (60, 40, 670, 110), (0, 20), (-2.2, 2.2), "", "", "position, rad", x_ticks=False)
    for joint in range(2):
        axes.curve(run.t[::20], run.q[::20, joint], COLORS[joint])
    axes.level(2.0, RED)
    axes.level(-2.0, RED)
    errors = np.array([step.expected_error for step in excitation.steps])
    axes = Axes(drawing, (60, 190, 670, 70), (0, 20), (0.005, 5.0), "", "", "expected torque error", "y", x_ticks=False)
    axes.curve(np.repeat(times, 2)[1:], np.repeat(errors, 2)[:-1], BLUE, 1.6)
    axes = Axes(drawing, (60, 300, 670, 60), (0, 20), (0.0, 60.0), "t, s", "", "bandwidth, rad/s")
    for joint in range(2):
        widths = np.array([step.bandwidth[joint] for step in excitation.steps])
        axes.curve(np.repeat(times, 2)[1:], np.repeat(widths, 2)[:-1], COLORS[joint], 1.6)
    drawing.figures["expected error"] = round(float(errors[-1]), 4)
    drawing.figures["largest speed"] = round(float(np.abs(run.dq).max()), 3)
    return drawing


@picture
def collision_free(runs: Runs) -> Drawing:
    """Distances of an arm from a table and of its links from each other during a designed motion."""
    from steelyard import collision
    from steelyard.excitation import SearchOptions

    rows = [("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), (0, 0.4, 0, "q")]
    robot = sy.Robot.from_dh(rows, name="arm")
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))
    box = collision.WorkspaceBox(robot, "link3", lower=(-0.8, -0.8, 0.1), upper=(0.8, 0.8, 1.2))
    limits = {"lower": -1.5, "upper": 1.5, "velocity": 2.0, "acceleration": 6.0}
    drawing = Drawing("How far the tool stays above a table, in a motion designed with and without it", 760, 270)
    axes = Axes(drawing, (60, 40, 670, 165), (0, 6), (-0.5, 1.3), "t, s", "", "height of the tool, m")
    for name, constraints, color in (("without the constraint", (), ORANGE), ("with it", (box,), BLUE)):
        design = sy.design_excitation(
            model, limits, period=6.0, harmonics=3, constraints=constraints, search=SearchOptions(starts=1, workers=1)
        )
        t, q, _, _ = design.sample(50.0)
        height = np.array([model.pose(one, "link3")[2, 3] for one in q])
        axes.curve(t, height, color, 2.0)
        drawing.figures[f"lowest {name}, m"] = round(float(height.min()), 2)
    axes.level(0.1, RED, "lower side of the workspace")
    drawing.legend(60, 256, [("designed without the constraint", ORANGE), ("designed with it", BLUE)])
    return drawing


@picture
def cutoff(runs: Runs) -> Drawing:
    """The error of the torques over the cutoff of the filter."""
    (_, choice), *_ = runs.panda.cutoff_choices
    drawing = Drawing("The error of the torques over the cutoff of the position filter", 760, 280)
    error = 100 * np.asarray(choice.error)
    axes = Axes(
        drawing,
        (60, 40, 670, 180),
        (choice.candidates[0], choice.candidates[-1]),
        span(error, room=0.1),
        "cutoff, Hz",
        "",
        "error of the torques, %",
        "x",
    )
    axes.curve(choice.candidates, error, BLUE, 2.2)
    axes.dots(choice.candidates, error, BLUE, 2.4)
    axes.upright(choice.cutoff, RED, f"chosen: {choice.cutoff:.3g} Hz")
    drawing.text(60, 266, "too low cuts the motion", 12, SOFT)
    drawing.text(250, 266, "too high lets noise become accelerations", 12, SOFT)
    drawing.figures["cutoff, Hz"] = round(choice.cutoff, 2)
    return drawing


@picture
def experiment(runs: Runs) -> Drawing:
    """An experiment in software: the motion that was designed, the log of the simulated robot."""
    model, truth, design, log = runs.two_links
    found = sy.fit(sy.Information.from_samples(model, log.process(cutoff="auto")), sy.FeasibleSet(model))
    base = model.base_parameters()
    drawing = Drawing("Base parameters found from a simulated log, and the truth that was put in", 760, 300)
    rows = [
        (name, value, value - 2 * error, value + 2 * error, true, BLUE)
        for name, value, error, true in zip(
            base.names, found.base, found.standard_error, base.values(truth), strict=True
        )
    ]
    intervals(drawing, (130, 40, 600, 215), rows, "SI units", "truth")
    drawing.text(130, 24, "dot: found, bar: two standard errors, tick: what was put in", 12, SOFT)
    scattering(drawing, "condition number", round(design.condition_number, 3), ENDS * design.condition_number)
    return drawing


@picture
def free_fall(runs: Runs) -> Drawing:
    """A free fall of a possible robot, and of an impossible one."""
    from steelyard.identification.wam import true_parameters, wam_model

    model, parameters = wam_model(), true_parameters()
    still = np.zeros(7)
    drawing = Drawing("Speeds in free fall of a possible robot and of an impossible one", 760, 280)
    impossible = parameters.copy()
    impossible[model.parameter_names.index("Lzz7")] = -0.002
    good = sy.simulate(model, parameters, still, still, 3.0)
    bad = sy.simulate(model, impossible, still, still, 3.0)
    axes = Axes(drawing, (60, 40, 670, 180), (0, 3), (0.01, 10000), "t, s", "", "largest speed of a joint, rad/s", "y")
    for run, color in ((good, BLUE), (bad, RED)):
        axes.curve(run.t, np.maximum(np.abs(run.dq).max(axis=1), 0.011), color, 2.0)
    drawing.legend(60, 268, [("possible", BLUE), (f"impossible: {bad.status} at {bad.end_time:.2g} s", RED)])
    drawing.figures["status"] = str(bad.status)
    return drawing


@picture
def control(runs: Runs) -> Drawing:
    """The errors of a joint under computed torque, with and without the friction of the model."""
    from steelyard.control import ComputedTorque
    from steelyard.identification.wam import TRAJECTORIES, true_parameters, wam_model

    model, parameters = wam_model(), true_parameters()
    motion = TRAJECTORIES["B"]
    start, speed, _ = (x[0] for x in motion.motion([0.0]))
    drawing = Drawing("Tracking errors with and without compensation of the drives", 760, 280)
    curves = []
    for compensate, color in ((False, ORANGE), (True, BLUE)):
        controller = ComputedTorque(model, parameters, motion, kp=400.0, kd=40.0, compensate_drives=compensate)
        run = sy.simulate(model, parameters, start, speed, 4.0, controller)
        curves.append((run.t, 1e3 * np.abs(run.q - motion.motion(run.t)[0]).max(axis=1), color))
    axes = Axes(drawing, (60, 40, 670, 180), (0, 4), (0.01, 1000.0), "t, s", "", "largest error of a joint, mrad", "y")
    for t, error, color in curves:
        axes.curve(t[1:], np.maximum(error[1:], 0.011), color, 1.6)
        drawing.figures["compensated" if color == BLUE else "not compensated"] = round(float(np.median(error)), 3)
    drawing.legend(60, 268, [("links alone in the model", ORANGE), ("friction and rotors too", BLUE)])
    return drawing


@picture
def base_parameters(runs: Runs) -> Drawing:
    """The largest base parameters with their standard errors."""
    result = runs.panda
    drawing = Drawing("Base parameters of a Panda with their standard errors", 760, 320)
    order = np.argsort(-np.abs(result.unconstrained.base))[:8]
    rows = [
        (result.unconstrained.base_names[k], value, value - 2 * error, value + 2 * error, math.nan, BLUE)
        for k in order
        for value, error in [(abs(result.unconstrained.base[k]), result.unconstrained.standard_error[k])]
    ]
    intervals(drawing, (100, 40, 630, 240), rows, "size, SI units")
    drawing.text(100, 24, "the first term of each combination; bar: two standard errors", 12, SOFT)
    return drawing


@picture
def l_curve(runs: Runs) -> Drawing:
    """Residual over the distance from the prior, with the corner."""
    result = runs.panda
    prior = sy.estimators.EntropicPrior(result.plausible.prior.parameters)
    curve = sy.estimators.l_curve(result.information, result.feasible_set, prior)
    drawing = Drawing("The L-curve: what staying near the prior costs", 760, 300)
    x, y = np.asarray(curve.distances), np.sqrt(np.asarray(curve.squared_residuals))
    keep = x > 0
    axes = Axes(
        drawing,
        (70, 40, 660, 200),
        (x[keep].min() * 0.8, x[keep].max() * 1.3),
        span(y, room=0.1),
        "distance from the prior",
        "",
        "residual",
        "x",
    )
    axes.curve(x[keep], y[keep], BLUE, 2.0)
    axes.dots(x[keep], y[keep], BLUE)
    corner = curve.corner_index
    axes.dots([x[corner]], [y[corner]], RED, 6)
    drawing.text(
        float(axes.along(x[corner])) + 10, float(axes.up(y[corner])) - 8, f"corner: weight {curve.corner:.3g}", 12, RED
    )
    drawing.text(70, 286, "left: all prior; right: all data", 12, SOFT)
    drawing.figures["corner"] = round(float(np.log10(curve.corner)), 2)
    return drawing


@picture
def generated_code(runs: Runs) -> Drawing:
    """Operations of the functions of a Panda, in the generated code."""
    model = runs.panda.model
    drawing = Drawing("Multiplications and additions of the generated functions", 760, 270)
    names = ("gravity", "inertia_matrix", "inverse_dynamics", "forward_dynamics", "regressor")
    counts = [model.operation_count(name) for name in names]
    series = [
        (kind, [count[key] for count in counts], color)
        for kind, key, color in (("multiplications", "mul", BLUE), ("additions", "add", ORANGE))
    ]
    bars(drawing, (150, 46, 580, 205), [name.replace("_", " ") for name in names], series)
    drawing.legend(150, 26, [(name, color) for name, _, color in series])
    drawing.figures.update({name: count["mul"] for name, count in zip(names, counts, strict=True)})
    return drawing


@picture
def operation_counts(runs: Runs) -> Drawing:
    """Operations of the regressor over the number of joints."""
    drawing = Drawing("Operations of inverse dynamics and regressor over the number of joints", 760, 280)
    joints = np.arange(1, 8)
    counts: dict[str, list[int]] = {"inverse_dynamics": [], "regressor": []}
    for count in joints:
        model = sy.Model(sy.Robot.from_dh([("pi/2", 0.1, 0.3, "q")] * int(count)))
        for name, found in counts.items():
            operations = model.operation_count(name)
            found.append(operations["mul"] + operations["add"])
    axes = Axes(
        drawing,
        (70, 40, 660, 185),
        (0.8, 7.2),
        (0, max(counts["regressor"]) * 1.08),
        "joints",
        "",
        "multiplications and additions",
    )
    for (name, found), color in zip(counts.items(), (BLUE, ORANGE), strict=True):
        axes.curve(joints, found, color, 2.0)
        axes.dots(joints, found, color)
        drawing.figures[name] = found[-1]
    drawing.legend(70, 268, [("inverse dynamics", BLUE), ("regressor", ORANGE)])
    return drawing


@picture
def own_term(runs: Runs) -> Drawing:
    """Friction that rises near standstill: what is left by Coulomb friction, and by a term of one's own."""
    t = np.arange(0.0, 20.0, 0.005)
    q = np.sin(1.3 * t) + 0.4 * np.sin(3.1 * t + 1.0)
    dq, ddq = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    random = np.random.default_rng(7)
    torque = (
        0.5 * ddq + 0.4 * dq + np.sign(dq) * (1.0 + 0.8 / (1.0 + (dq / 0.2) ** 2)) + 0.05 * random.normal(size=len(t))
    )
    columns = [ddq, dq, np.sign(dq)]
    richer = [*columns, np.sign(dq) / (1.0 + (dq / 0.2) ** 2)]
    drawing = Drawing(
        "Friction over speed, as measured, with Coulomb friction alone, and with a term of one's own", 760, 290
    )
    rows = slice(None, None, 16)
    axes = Axes(drawing, (60, 40, 670, 195), (-2.2, 2.2), (-3.2, 3.2), "speed, rad/s", "", "friction, N·m")
    axes.dots(dq[rows], (torque - 0.5 * ddq)[rows], "#c9ced3", 1.6)
    speeds = np.linspace(-2.2, 2.2, 221)
    for matrix, extra, color in ((columns, False, ORANGE), (richer, True, BLUE)):
        found, *_ = np.linalg.lstsq(np.column_stack(matrix), torque, rcond=None)
        friction = found[1] * speeds + found[2] * np.sign(speeds)
        friction = friction + (found[3] * np.sign(speeds) / (1.0 + (speeds / 0.2) ** 2) if extra else 0.0)
        axes.curve(speeds, friction, color, 2.2)
        left = torque - np.column_stack(matrix) @ found
        drawing.figures["with the term" if extra else "without"] = round(float(np.sqrt(np.mean(left**2))), 4)
    drawing.legend(60, 280, [("viscous and Coulomb", ORANGE), ("with a term that falls off with speed", BLUE)])
    return drawing


@picture
def no_inertias(runs: Runs) -> Drawing:
    """Masses found from a description without inertias, and the truth."""
    _, truth = runs.example("panda")
    place = runs.written("panda")
    bare = runs.folder / "bare"
    bare.mkdir(exist_ok=True)
    urdf = (place / "robot.urdf").read_text(encoding="utf-8")
    (bare / "robot.urdf").write_text(re.sub(r"<inertial>.*?</inertial>", "", urdf, flags=re.DOTALL), encoding="utf-8")
    (bare / "robot.toml").write_text((place / "robot.toml").read_text(encoding="utf-8"), encoding="utf-8")
    found = sy.identify(bare / "robot.toml", [place / "train.csv"], validate=[place / "validate.csv"])
    values = dict(zip(truth.parameter_names, truth.parameters, strict=True))
    drawing = Drawing("Masses that were found without any inertia in the description, and the truth", 760, 290)
    chosen = [found.parameters["total mass"], *(found.parameters[f"m{k}"] for k in range(3, 8))]
    total = sum(v for n, v in values.items() if n[0] == "m" and n[1:].isdigit())
    rows = [
        (
            row.name if row.name[0] == "t" else f"mass of link {row.name[1:]}",
            row.value,
            row.lower,
            row.upper,
            total if row.name[0] == "t" else values[row.name],
            BASIS[row.basis],
        )
        for row in chosen
    ]
    intervals(drawing, (130, 40, 600, 195), rows, "kg", "truth")
    drawing.text(
        130,
        24,
        f"dot: found, bar: interval, tick: truth; error on new data {100 * found.predictions[-1].feasible_error:.1f} %",
        12,
        SOFT,
    )
    drawing.figures["error, %"] = round(100 * found.predictions[-1].feasible_error, 2)
    return drawing


@picture
def log_as_recorded(runs: Runs) -> Drawing:
    """A log with a gap and unsteady stamps, and what is made of it."""
    log = runs.panda_log
    random = np.random.default_rng(2)
    keep = np.ones(log.count, dtype=bool)
    keep[1500:1560] = False
    t = log.t + 0.0006 * random.normal(size=log.count)
    rows = keep & (log.t > 4.0) & (log.t < 9.0)
    drawing = Drawing(
        "Rows of a bag: their steps of time, with jitter and a gap, and the even rows that are made of them", 760, 300
    )
    steps = 1e3 * np.diff(t[rows])
    axes = Axes(drawing, (60, 40, 670, 80), (4, 9), (0.0, 12.0), "", "", "step of the stamps, ms", x_ticks=False)
    axes.dots(t[rows][1:][::3], np.minimum(steps, 11.5)[::3], GREY, 1.4)
    low = Axes(drawing, (60, 162, 670, 90), (4, 9), span(log.q[rows, 3]), "t, s", "", "position of joint 4, rad")
    gap = np.flatnonzero(np.diff(np.flatnonzero(rows)) > 1)[0]
    at = t[rows]
    low.curve(at[: gap + 1], log.q[rows, 3][: gap + 1], BLUE, 2.0)
    low.curve(at[gap + 1 :], log.q[rows, 3][gap + 1 :], BLUE, 2.0)
    for axis in (axes, low):
        axis.upright(float(at[gap]), RED, "a gap: the log is cut here" if axis is low else "")
    drawing.figures["rows"] = int(rows.sum())
    return drawing


@picture
def mujoco_user(runs: Runs) -> Drawing:
    """What changes in a MuJoCo model: masses before and after."""
    result = runs.panda
    truth = runs.example("panda")[1]
    values = dict(zip(truth.parameter_names, truth.parameters, strict=True))
    drawing = Drawing(
        "Joint torques that a model with the masses of its description and the identified model need for one motion",
        760,
        300,
    )
    trace = result.predictions[-1].trace
    cad = np.nan_to_num(np.asarray(result.model.robot.parameters))
    log = sy.Recording.read(runs.written("panda") / "validate.csv", joints=7)
    samples = log.process(cutoff=10.0)
    described = result.model.inverse_dynamics(samples.q, samples.dq, samples.ddq, cad)
    identified = result.model.inverse_dynamics(samples.q, samples.dq, samples.ddq, result.estimate)
    errors = [
        100 * np.linalg.norm(found - samples.torque, axis=0) / np.linalg.norm(samples.torque, axis=0)
        for found in (described, identified)
    ]
    series = [("description", errors[0], GREY), ("identified", errors[1], BLUE)]
    bars(drawing, (120, 46, 600, 220), list(result.estimate.joint_names), series, unit=" %")
    drawing.legend(120, 26, [(name, color) for name, _, color in series])
    drawing.text(730, 26, "error of the torques on another motion", 12, SOFT, "end")
    drawing.figures["m7"] = round(float(values["m7"]), 3)
    drawing.figures["samples"] = len(trace.t) > 0
    return drawing


@picture
def ros2_control(runs: Runs) -> Drawing:
    """Torques of feed-forward and of feedback, with the described and the identified model."""
    from steelyard.control import FeedforwardTracking

    result, truth = runs.example("panda")
    model, true = result.model, np.asarray(truth.parameters)
    cad = np.nan_to_num(np.asarray(model.robot.parameters))
    motion = sy.excitation.FourierTrajectory(
        a=np.random.default_rng(3).normal(size=(7, 3)) * 0.2,
        b=np.zeros((7, 3)),
        center=bent(model, PANDA_POSE),
        frequency=0.2,
    )
    start, speed, _ = (x[0] for x in motion.motion([0.0]))
    drawing = Drawing("Feedback torques of a controller with the described model and with the identified one", 760, 280)
    axes = Axes(drawing, (60, 40, 670, 180), (0, 5), (-16, 16), "t, s", "", "torque that feedback adds at joint 2, N·m")
    for parameters, name, color in (
        (cad, "description", ORANGE),
        (np.asarray(result.estimate.parameters), "identified", BLUE),
    ):
        controller = FeedforwardTracking(
            model, parameters, motion, kp=400.0, kd=40.0, coupled=True, compensate_drives=True
        )
        run = sy.simulate(model, true, start, speed, 5.0, controller)
        ahead = model.inverse_dynamics(*motion.motion(run.t), parameters)
        axes.curve(run.t, run.torque[:, 1] - ahead[:, 1], color, 1.8)
        added = float(np.sqrt(np.mean((run.torque[:, 1] - ahead[:, 1]) ** 2)))
        scattering(drawing, name, round(added, 3), 0.01)
    drawing.legend(60, 268, [("model of the description", ORANGE), ("identified model", BLUE)])
    return drawing


@picture
def poor_fit(runs: Runs) -> Drawing:
    """What is left of a torque where the model lacks something: white noise, or a pattern."""
    panda, log = runs.panda, runs.panda_log
    bare = sy.Model(panda.model.robot.with_terms(sy.Viscous()))
    samples = log.process(cutoff=15.0)
    info = sy.Information.from_samples(bare, samples)
    lacking = sy.least_squares(info)
    whole = panda.model.inverse_dynamics(samples.q, samples.dq, samples.ddq, panda.estimate)
    mapping = np.linalg.pinv(np.asarray(bare.base_parameters().K, dtype=float)) @ lacking.base
    less = bare.inverse_dynamics(samples.q, samples.dq, samples.ddq, mapping)
    drawing = Drawing("Residuals of a joint over its speed: with a pattern, and without", 760, 300)
    joint, rows = 3, slice(None, None, 23)
    for left, found, title, color in (
        (60, less, "without Coulomb friction: a step", ORANGE),
        (430, whole, "with it: noise", BLUE),
    ):
        left_over = samples.torque[:, joint] - found[:, joint]
        axes = Axes(drawing, (left, 46, 310, 190), (-1.1, 1.1), (-4, 4), "speed of joint 4, rad/s", "", title)
        axes.dots(samples.dq[rows, joint], np.clip(left_over[rows], -4, 4), color, 1.3)
        drawing.figures[title] = round(float(np.sqrt(np.nanmean(left_over**2))), 3)
    drawing.text(
        60,
        288,
        "residual, N·m. Look at the residual over speed, acceleration and position: a pattern names what is missing",
        12,
        SOFT,
    )
    return drawing


def _pendulum() -> tuple[sy.Model, sy.FeasibleSet]:
    robot = sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0))
    model = sy.Model(robot)
    return model, sy.FeasibleSet(model)


@picture
def feasible_region(runs: Runs) -> Drawing:
    """What a pendulum can be: inertia over first moment, for a mass bound."""
    drawing = Drawing(
        "The possible pendulums over first moment and inertia, noisy estimates, and the nearest possible one",
        860,
        380,
    )
    axes = Axes(drawing, (70, 40, 400, 290), (-1.2, 1.2), (-0.25, 1.0), "first moment l, kg m", "", "inertia L, kg m²")
    moment = np.linspace(-1.2, 1.2, 121)
    axes.band(moment, moment**2 / 2.0, np.full(121, 1.0), GREEN)
    axes.curve(moment, moment**2 / 2.0, GREEN, 2.0)
    truth = np.array([0.6, 0.22])
    random = np.random.default_rng(12)
    found = truth + random.multivariate_normal([0, 0], [[0.012, -0.004], [-0.004, 0.016]], size=60)
    possible = found[:, 1] >= found[:, 0] ** 2 / 2.0
    axes.dots(found[possible, 0], found[possible, 1], BLUE, 2.6)
    axes.dots(found[~possible, 0], found[~possible, 1], RED, 2.6)
    axes.dots([truth[0]], [truth[1]], TEXT, 5)
    worst = found[np.argmin(found[:, 1] - found[:, 0] ** 2 / 2.0)]
    line = np.linspace(0.2, 1.2, 2001)
    near = np.argmin((line - worst[0]) ** 2 + (line**2 / 2.0 - worst[1]) ** 2)
    axes.curve([worst[0], line[near]], [worst[1], line[near] ** 2 / 2.0], RED)
    axes.dots([line[near]], [line[near] ** 2 / 2.0], GREEN, 5)
    for row, (words, color) in enumerate(
        (
            ("green: what a body of 2 kg at most can be", GREEN),
            ("black: the truth, inside", TEXT),
            ("blue: estimates from noisy logs, possible", BLUE),
            ("red: estimates that no body can have", RED),
            ("line: correct moves to the nearest possible", RED),
        )
    ):
        drawing.text(500, 90 + 28 * row, words, 13, color)
    drawing.text(500, 260, f"{int((~possible).sum())} of 60 estimates are impossible,", 13)
    drawing.text(500, 280, "though the noise is small and the truth inside", 13)
    drawing.figures["impossible"] = int((~possible).sum())
    return drawing


@picture
def price_of_nothing(runs: Runs) -> Drawing:
    """Errors of plain least squares and of the feasible answer over all the examples."""
    drawing = Drawing(
        "Errors on another motion of plain least squares and of the feasible answer, over the robots of the gallery",
        760,
        400,
    )
    names = ["panda", "ur5", "xarm7", "z1", "j2s6s200", "so101", "ur3", "ur10", "talos", "tiago", "go2"]
    values = [runs.example(name)[0].predictions[-1] for name in names]
    series = [
        ("plain least squares", [100 * v.unconstrained_error for v in values], ORANGE),
        ("feasible", [100 * v.feasible_error for v in values], BLUE),
    ]
    bars(drawing, (110, 46, 620, 330), names, series, unit=" %")
    drawing.legend(110, 26, [(name, color) for name, _, color in series])
    drawing.figures.update({name: round(100 * v.feasible_error, 2) for name, v in zip(names, values, strict=True)})
    return drawing


@picture
def what_motions_show(runs: Runs) -> Drawing:
    """Singular values of the base regressor for a good and a timid motion."""
    model, _, design, _ = runs.two_links
    drawing = Drawing(
        "Singular values of the base regressor for a designed motion and for a slow one of one joint", 860, 290
    )
    t, q, dq, ddq = design.sample(100.0)
    slow = np.column_stack([0.5 * np.sin(0.6 * t), np.zeros_like(t)])
    rate = np.column_stack([0.3 * np.cos(0.6 * t), np.zeros_like(t)])
    gain = np.column_stack([-0.18 * np.sin(0.6 * t), np.zeros_like(t)])
    base = np.asarray(model.base_parameters().Pb, dtype=float)
    axes = Axes(
        drawing,
        (70, 40, 400, 190),
        (0.5, base.shape[1] + 0.5),
        (1e-3, 1e3),
        "combination, from best shown to least",
        "",
        "singular value",
        "y",
    )
    for moved, color, name in (((q, dq, ddq), BLUE, "designed"), ((slow, rate, gain), ORANGE, "one joint, slowly")):
        matrix = model.regressor(*moved).reshape(-1, model.parameter_count) @ base
        values = np.linalg.svd(matrix, compute_uv=False)
        axes.dots(np.arange(1, len(values) + 1), np.maximum(values, 1.2e-3), color, 5)
        drawing.figures[f"shown by {name}"] = int((values > 1e-6).sum())
    drawing.legend(70, 282, [("designed motion", BLUE), ("one joint, slowly", ORANGE)])
    for row, words in enumerate(
        (
            f"of {base.shape[1]} combinations the designed motion",
            "shows {shown by designed}, the slow one {shown by one joint, slowly}".format(**drawing.figures),
            "",
            "what lies at the bottom is not shown:",
            "no filter and no estimator finds it",
        )
    ):
        drawing.text(495, 90 + 24 * row, words, 13)
    return drawing


@picture
def prior_pull(runs: Runs) -> Drawing:
    """What a prior does: errors on data of the fit and on data left out, over its weight."""
    price = runs.panda.plausible.price
    drawing = Drawing("Errors over the weight of the prior, on the data of the fit and on data left out", 760, 290)
    x = np.asarray(price.prior_weights)
    errors = [100 * np.asarray(price.training_error), 100 * np.asarray(price.held_out_error)]
    keep = x > 0
    axes = Axes(
        drawing,
        (70, 40, 660, 190),
        (x[keep].min(), x[keep].max()),
        (min(e[keep].min() for e in errors) * 0.95, np.percentile(errors[1][keep], 80) * 1.3),
        "weight of the prior",
        "",
        "error, %",
        "x",
    )
    for error, color in zip(errors, (ORANGE, BLUE), strict=True):
        axes.curve(x[keep], error[keep], color, 2.2)
    axes.upright(float(x[price.chosen]), RED, "chosen")
    drawing.legend(70, 282, [("data of the fit", ORANGE), ("stretches left out", BLUE)])
    scattering(drawing, "chosen", round(float(np.log10(x[price.chosen])), 2), 0.25)  # half a step of the weights
    return drawing


@picture
def separating_proof(runs: Runs) -> Drawing:
    """A proof that an estimate is impossible: a line between it and everything that is possible."""
    drawing = Drawing("A line that separates an impossible estimate from all possible ones", 860, 350)
    axes = Axes(drawing, (70, 40, 400, 260), (0.0, 1.2), (-0.2, 0.8), "first moment l, kg m", "", "inertia L, kg m²")
    moment = np.linspace(0.0, 1.2, 121)
    axes.band(moment, moment**2 / 2.0, np.full(121, 0.8), GREEN)
    axes.curve(moment, moment**2 / 2.0, GREEN, 2.0)
    estimate = np.array([0.9, 0.1])
    slope = 0.62  # of the tangent at l = 0.62
    axes.curve(moment, slope * moment - slope**2 / 2.0, RED, 2.0, "7 4")
    axes.dots([estimate[0]], [estimate[1]], RED, 6)
    value = float(estimate[1] - slope * estimate[0] + slope**2 / 2.0)
    for row, (words, color) in enumerate(
        (
            ("green: all that is possible", GREEN),
            ("red point: the estimate", RED),
            ("dashed: a line on whose upper side", RED),
            ("everything possible lies", RED),
            (f"the estimate is {-value:.3f} below it", TEXT),
            ("", TEXT),
            ("Three numbers make the line. Anybody can", TEXT),
            ("check both statements with a pencil:", TEXT),
            ("that is what a certificate holds.", TEXT),
        )
    ):
        drawing.text(500, 80 + 25 * row, words, 13, color)
    drawing.figures["below"] = round(-value, 4)
    return drawing


@picture
def interval_coverage(runs: Runs) -> Drawing:
    """How often intervals hold the truth, with and without the correlation of the residuals."""
    model, truth, design, _ = runs.two_links
    base = model.base_parameters()
    true = base.values(truth)
    held = {"plain": 0, "corrected": 0}
    total = 0
    sensors = sy.simulation.Sensors(encoder_resolution=2 * np.pi / 65536, torque_noise=0.3, torque_time_constant=0.05)
    logs = 12
    for seed in range(logs):
        log = sy.play(model, truth, design.trajectory, sensors=sensors, seed=seed)
        info = sy.Information.from_samples(model, log.process(cutoff=15.0))
        for name, data in (("plain", replace(info, batch_means=())), ("corrected", info)):
            found = sy.least_squares(data, "joint")
            held[name] += int((np.abs(found.base - true) <= 1.96 * found.standard_error).sum())
        total += len(true)
    drawing = Drawing("How many intervals of 95 % hold the truth", 760, 190)
    shares = [100 * held["plain"] / total, 100 * held["corrected"] / total]
    bars(
        drawing,
        (290, 40, 420, 90),
        ["each row an independent one", "residuals correlated in time"],
        [("share", shares, BLUE)],
        unit=" %",
    )
    drawing.text(290, 165, f"{total} intervals of simulated logs whose truth is known; 95 % are asked for", 12, SOFT)
    for name, share in zip(held, shares, strict=True):  # what one log's intervals hold, they mostly hold together
        scattering(drawing, name, round(share, 1), math.sqrt(share * (100.0 - share) / logs))
    return drawing


FLOORS = (
    ("groundwork", {"files": "reading, writing", "robot": "joints, links, descriptions"}),
    (
        "mathematics",
        {
            "conic": "cone programs, solvers",
            "lmi": "matrix inequalities",
            "graph": "expressions, machine code",
            "codegen": "source in many languages",
        },
    ),
    (
        "model and data",
        {
            "dynamics": "physics, terms, Model",
            "recording": "logs to Samples",
            "regression": "Information, Estimate",
        },
    ),
    (
        "feasible answers",
        {
            "collision": "what a motion keeps clear of",
            "feasibility": "sets, proofs, diagnosis",
            "estimators": "feasible fit, priors",
        },
    ),
    (
        "robots that move",
        {
            "excitation": "motions that show parameters",
            "simulation": "the robot in software",
            "control": "model-based controllers",
        },
    ),
    (
        "results",
        {
            "identification": "the main jobs",
            "online": "while it moves",
            "fleet": "many robots",
            "report": "pages, figures",
            "cli": "commands",
        },
    ),
)


@picture
def rooms(runs: Runs) -> Drawing:
    """The rooms of the code, floor by floor."""
    drawing = Drawing("The rooms of the code, each importing only from those above it", 880, 516)
    for floor, (name, found) in enumerate(FLOORS):
        top = 18.0 + 82 * floor
        drawing.text(16, top + 34, name, 12.5, SOFT)
        width = (702.0 - 14 * (len(found) - 1)) / len(found)
        for place, (room, words) in enumerate(found.items()):
            left = 164 + place * (width + 14)
            drawing.add(
                f'<rect x="{left:g}" y="{top:g}" width="{width:.4g}" height="58" rx="6" fill="#eef2f5" '
                'stroke="#546e7a"/>'
            )
            drawing.text(left + width / 2, top + 25, room, 15, TEXT, "middle", bold=True)
            drawing.text(left + width / 2, top + 45, words, 11.5, SOFT, "middle")
        if floor < len(FLOORS) - 1:
            arrow = f"M515 {top + 61:g}v14m-5 -6l5 6l5 -6"
            drawing.add(f'<path d="{arrow}" fill="none" stroke="{GREY}" stroke-width="1.5"/>')
    drawing.figures["rooms"] = " ".join(room for _, found in FLOORS for room in found)
    return drawing


@picture
def badges(runs: Runs) -> Drawing:
    """What holds of the project, as its settings and its folders say."""
    import tomllib

    root = IMAGES.parent.parent
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    project = settings["project"]
    assert settings["tool"]["mypy"]["strict"] is True
    assert settings["tool"]["pytest"]["ini_options"]["filterwarnings"] == ["error"]
    # The estimator for controllers is written from a text in C, which is not compiled here.
    sources = {path.suffix for path in (root / "src").rglob("*.*") if path.stem != "robot_online"}
    assert not sources & {".c", ".cpp", ".pyx", ".rs"}, "the package would need a compiler"
    found = {
        "Python": project["requires-python"].replace(">=", "") + " or later",
        "licence": project["license"],
        "types": "mypy strict",
        "warnings in tests": "errors",
        "compiler": "not needed",
    }
    drawing = Drawing("; ".join(f"{name}: {value}" for name, value in found.items()), 880, 26)
    drawing.parts.clear()
    left = 3.0
    for name, value in found.items():
        widths = [6.5 * len(words) + 14 for words in (name, value)]
        drawing.add(f'<path d="M{left:g} 3h{widths[0]:g}v20h-{widths[0]:g}Z" fill="#4b545c"/>')
        drawing.add(f'<path d="M{left + widths[0]:g} 3h{widths[1]:g}v20h-{widths[1]:g}Z" fill="{GREEN}"/>')
        drawing.text(left + widths[0] / 2, 17, name, 11, "#ffffff", "middle")
        drawing.text(left + widths[0] + widths[1] / 2, 17, value, 11, "#ffffff", "middle")
        left += sum(widths) + 6
    drawing.width = left
    drawing.figures.update(found)
    return drawing


GALLERY_POSES = {
    "panda": PANDA_POSE,
    "ur5": (0.4, -1.2, 1.4, -0.6, 0.8, 0.0),
    "ur3": (0.4, -1.2, 1.4, -0.6, 0.8, 0.0),
    "ur10": (0.4, -1.2, 1.4, -0.6, 0.8, 0.0),
    "wam": (0.3, 0.6, 0.0, 1.4, 0.0, 0.6, 0.0),
}


def _gallery(runs: Runs, name: str) -> Drawing:
    """One robot: its drawing, and three figures."""
    if name == "wam":
        from steelyard.identification.wam import true_parameters

        result, title = runs.demo, "Barrett WAM"
        true = dict(zip(map(str, result.model.parameter_names), true_parameters(), strict=True))
    else:
        result, truth = runs.example(name)
        title = EXAMPLES[name].title
        true = dict(zip(truth.parameter_names, truth.parameters, strict=True))
    model = result.model
    answer = np.asarray(result.estimate.parameters)
    cad = np.nan_to_num(np.asarray(model.robot.parameters))
    drawing = Drawing(f"{title}: the ellipsoids of its identified links, and those of CAD", 380, 330)
    view = RobotView(
        drawing, (20, 54, 340, 198), model, bent(model, GALLERY_POSES.get(name, (0.4, 0.5, 0.3))), azimuth=-60
    )
    view.frame(answer, cad)
    view.skeleton(8.0)
    view.bodies(cad, GREY, outline=True)
    view.bodies(answer, BLUE)
    rows = {row.name: row for row in result.parameters}
    told = [n for n in true if n in rows]
    inside = sum(rows[n].lower <= true[n] <= rows[n].upper for n in told)
    mass = sum(v for n, v in true.items() if n[0] == "m" and n[1:].isdigit())
    error = 100 * result.predictions[-1].feasible_error
    drawing.text(20, 26, title, 15, TEXT, bold=True)
    plain = {
        False: "plain least squares: impossible",
        True: "plain least squares: possible",
        None: "plain least squares: undecided",
    }
    drawing.text(20, 44, plain[result.verdict.feasible], 11.5, RED if result.verdict.feasible is False else SOFT)
    for column, (value, words) in enumerate(
        (
            (f"{error:.1f} %", "error on new data"),
            (
                f"{result.total_mass:.3g} kg",
                f"truth {mass:.3g}, CAD {cad[[c[9] for c in model.link_columns]].sum():.3g}",
            ),
            (f"{inside} of {len(told)}", "intervals hold truth"),
        )
    ):
        at = (66, 190, 316)[column]
        drawing.text(at, 286, value, 18, BLUE, "middle", bold=True)
        drawing.text(at, 306, words, 10.5, SOFT, "middle")
    drawing.figures.update(
        {"error, %": round(error, 2), "mass, kg": round(result.total_mass, 3), "inside": int(inside), "told": len(told)}
    )
    return drawing


for _name in ("wam", *EXAMPLES):
    PICTURES[f"gallery-{_name}"] = lambda runs, name=_name: _gallery(runs, name)


def differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return which figures of a picture are others than those of a new run."""
    told = []
    for name in sorted(name for name in before.keys() | now.keys() if not name.startswith(SCATTER)):
        old, new = before.get(name), now.get(name)
        if isinstance(old, (int, float)) and isinstance(new, (int, float)):
            scatter = sum(figures.get(f"{SCATTER}{name}", 0.0) for figures in (before, now))
            same = abs(old - new) <= max(TOLERANCE * max(abs(old), abs(new)) + 1e-3, scatter)
        else:
            same = type(old) is type(new) and (not isinstance(old, str) or _words(old) == _words(new))
        if not same:
            told.append(f"{name}: {old} in the picture, {new} now")
    return told


def _words(text: str) -> str:
    """A sentence without its digits: they are compared where they stand by themselves."""
    return "".join(letter for letter in text if not letter.isdigit() and letter != ".")


def main(arguments: list[str]) -> int:
    """Make or check the pictures that are named, or all."""
    check = "--check" in arguments
    names = [argument for argument in arguments if argument != "--check"] or list(PICTURES)
    stale = 0
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(Path(folder))
        for name in names:
            drawn = PICTURES[name](runs)
            svg = drawn if isinstance(drawn, str) else drawn.svg()
            target = IMAGES / f"{name}.svg"
            if not check:
                target.write_text(svg, encoding="utf-8")
                print(f"{target.name}: {len(svg) / 1000:.0f} kB")
                continue
            told = (
                differences(figures_of(target.read_text(encoding="utf-8")), figures_of(svg))
                if target.exists()
                else ["missing"]
            )
            for sentence in told:
                print(f"{name}.svg is out of date: {sentence}")
            stale += bool(told)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
