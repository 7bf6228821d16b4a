"""The page of a motion before anyone moves the robot: where it goes, how near its limits, and what it will show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.collision.configurations import place_links
from steelyard.dynamics import Model
from steelyard.excitation import ExcitationDesign, RestToRestTrajectory
from steelyard.excitation.design import MOTION_FILES, RECORD
from steelyard.identification.default_terms import model_of_estimate
from steelyard.identification.given import given_constraints
from steelyard.identification.predicted_intervals import PredictedIntervals, predicted_intervals
from steelyard.identification.saved import matching_estimate
from steelyard.robot import Robot, RobotFile

from .answer_sections import number_tables
from .charts import Chart, Curve, charts_markup
from .drawing import LOOKS, Drawing, turnable
from .head import card
from .html_document import Markup, Section, bullets, escape, html_document, number, paragraphs, table
from .link_bodies import link_body
from .robot_picture import PlacedRobot, ground, skeleton
from .robot_scene import robot_scene
from .sections import versions

__all__ = ["EXCITATION_FILES", "excitation_html", "save_excitation"]

Array = NDArray[np.float64]

PAGE = "excite.html"
EXCITATION_FILES = (*MOTION_FILES, RECORD, PAGE)
RATE = 100.0  # Hz, of charts and path; the margins in the table are those of the whole motion at 1 kHz
PATH_POINTS = 240
INSTANTS = 4  # at which the robot is drawn, beside the start
MOST_PAIRS = 6  # whose distances are drawn, the nearest
_LIBRARIES = ("numpy", "scipy", "llvmlite", "clarabel")


@dataclass(frozen=True, eq=False)
class _Motion:
    """The whole motion at `RATE`, with the torques that are predicted; NaN where they are not known."""

    t: Array
    q: Array
    dq: Array
    ddq: Array
    torque: Array


def save_excitation(
    design: ExcitationDesign,
    file: RobotFile,
    folder: str | Path,
    *,
    estimate: str | Path | None = None,
    noise: ArrayLike | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[Path, ...]:
    """Write a motion in all its formats, and a page about it.

    Parameters
    ----------
    file : RobotFile
        The robot that it was designed for.
    folder : str or Path
        Made where it is missing; files of the same names are replaced.
    estimate : str or Path, optional
        Of an identification before, whose parameters and errors are expected again.
    noise : (N,) or float, optional
        Standard deviation of the torques from the model, N·m or N.
    progress : callable, optional
        Called with a few words before each step.

    Returns
    -------
    tuple of Path
        The files.
    """
    say = progress or (lambda _: None)
    whole = model_of_estimate(estimate, file)
    before, model = None if estimate is None else matching_estimate(whole, estimate), whole.without_channels
    say("what the motion will show")
    expected = predicted_intervals(
        model, design.trajectory, estimate=before, noise=noise, rate=design.rate, constraints=given_constraints(file)
    )
    say("writing the page")
    return design.save_all(folder, {PAGE: excitation_html(design, model, expected)})


def excitation_html(design: ExcitationDesign, model: Model, expected: PredictedIntervals) -> str:
    """Return the page about a motion, an HTML document without references to anything outside.

    Parameters
    ----------
    model : Model
        Of the robot that it was designed for.
    expected : PredictedIntervals
        What is to be expected of an identification with it.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], name="arm", gravity=(0, -9.81, 0)))
    >>> limits = {"lower": -1.5, "upper": 1.5, "velocity": 2.0, "acceleration": 6.0}
    >>> quick = sy.excitation.SearchOptions(starts=1, workers=1)
    >>> design = sy.design_excitation(model, limits, period=4.0, harmonics=2, search=quick)
    >>> text = excitation_html(design, model, predicted_intervals(model, design.trajectory))
    >>> "Where it starts" in text, "src=" in text
    (True, False)
    """
    t, q, dq, ddq = design.trajectory.sample(RATE)
    torque = np.full_like(q, np.nan)
    if expected.base is not None:
        torque = model.inverse_dynamics(q, dq, ddq, model.base_parameters().Pb @ expected.base)
    motion = _Motion(t, q, dq, ddq, torque)
    parts = [
        ("start", "Where it starts", _start(design, model.robot)),
        ("space", "The motion in space", _space(design, model.robot, motion)),
        ("limits", "Joints and their limits", _limits(design, model.robot, motion)),
        ("distances", "Distances", _distances(design, motion)),
        ("shows", "What it will show", _shows(model, expected)),
        ("combinations", "Combinations that the motion shows", _combinations(expected)),
        ("sources", "How it was designed", _sources(design)),
    ]
    return html_document(
        f"{design.robot_name}: motion for identification",
        "Steelyard excitation",
        design.robot_name,
        _lead(design, expected),
        [Section(key, title, content) for key, title, content in parts],
        plain_scripts=("drawing.js",),
        scripts=("charts.js",),
        styles=("drawing.css",),
    )


def _lead(design: ExcitationDesign, expected: PredictedIntervals) -> Markup:
    shows = "It can identify what was asked" if design.identifies else "It cannot identify what was asked"
    told = [] if expected.table is None else [expected.table.counts]
    least = design.nearest()
    keeps = [
        f"{margin.name}, {margin.label}: {margin.clearance:.3g} left at {margin.time:.2f} s"
        for margin in least[:3]
        if not margin.beyond
    ]
    checked = "No collision was checked" if len(design.unchecked) > 1 else "Not all collisions were checked"
    cards = [
        card("Does it show the parameters?", "good" if design.identifies else "bad", shows, told),
        card("Does it keep the limits?", "good", "It keeps every limit at 1 kHz", keeps),
    ]
    if design.unchecked:
        cards.append(card("What was not checked?", "open", checked, design.unchecked))
    together = design.combined_condition_number
    both = "" if together is None else f", {together:.4g} together with what is known already"
    words = (
        f"A {design.family} motion of {design.trajectory.duration:.4g} s; condition number "
        f"{design.condition_number:.4g}{both}. Nobody has moved the robot yet: look at the start and at the path first."
    )
    return Markup(f'<p class="lead">{escape(words)}</p>\n<div class="verdicts">{"".join(cards)}</div>\n')


def _start(design: ExcitationDesign, robot: Robot) -> Markup:
    rows = []
    for k, (joint, place) in enumerate(design.start.items()):
        unit = robot.position_units[k]
        low, high = design.limits.lower[k], design.limits.upper[k]
        rows.append(
            (joint, f"{place:.4f}", unit, f"{np.rad2deg(place):.2f}" if unit == "rad" else "–", _reach(low, high))
        )
    heads = ("Joint", "Position", "Unit", "Degrees", "Limits")
    text = "<p>Move the robot here before the motion starts, along a way of which you know that it is free.</p>"
    return Markup(text + table("Start configuration", heads, rows, identifier="start-table", texts=(2, 4)))


def _reach(low: float, high: float) -> str:
    if not (np.isfinite(low) or np.isfinite(high)):
        return "none"
    return f"{low:.4g} … {high:.4g}".replace("-inf", "open").replace("inf", "open")


def _first_round(design: ExcitationDesign, t: Array) -> int:
    """Return how many of these instants go through all of the path: periods, slow passages and ramps repeat it."""
    trajectory = design.trajectory
    if not isinstance(trajectory, RestToRestTrajectory):
        return len(t)
    return int(np.searchsorted(t, trajectory.ramp_time + trajectory.period, side="right"))


def _space(design: ExcitationDesign, robot: Robot, motion: _Motion) -> Markup:
    if robot.lengths:
        return Markup("<p>The robot has lengths that are symbols, so that it has no place in space.</p>")
    tips = _tips(robot)
    rows = np.unique(np.linspace(0, _first_round(design, motion.t) - 1, PATH_POINTS).astype(int))
    places = place_links(robot, motion.q)
    whole = [places.of(link, placement)[1] for link, placement in tips.values()]
    paths = [path[rows] for path in whole]
    instants = np.linspace(0.0, motion.t[-1], INSTANTS + 2)[1:-1]
    later = [robot_scene(robot, motion.q[int(np.searchsorted(motion.t, at))]) for at in instants]
    ends = [end for scene in later for link in scene.links for end in (link.joint_origin, *link.ends)]
    placed = PlacedRobot(robot_scene(robot, motion.q[0]), [], np.vstack([*paths, *ends]))
    drawing = Drawing(placed.view())
    drawing.parts.append(ground(drawing, placed))
    for scene in later:
        lines = [(link.joint_origin, end) for link in scene.links for end in link.ends]
        inner = "".join(drawing.line([placed.point(a), placed.point(b)], "span-of-link") for a, b in lines)
        drawing.parts.append(f'<g class="later">{inner}</g>')
    for path in paths:
        points = [placed.point(point) for point in path]
        strokes = [drawing.line(pair, "path") for pair in pairwise(points)]
        drawing.parts.append(f'<g class="path-of-tool">{"".join(strokes)}</g>')
    drawing.parts.append(skeleton(drawing, placed))
    for path, name in zip(paths, tips, strict=True):
        drawing.parts.append(drawing.mark(placed.point(path[0]), '<circle class="start-of-path" r="5"/>'))
        drawing.parts.append(drawing.label(placed.point(path[0]), f"{name}, start"))
    described = f"Path of {', '.join(tips)} over {motion.t[-1]:.4g} s, and the robot at the start"
    picture = drawing.svg(f"{robot.name} in the motion", described)
    when = ", ".join(f"{at:.1f}" for at in instants)
    text = (
        f"The thick line is the robot at the start, pale lines the robot at {when} s, and the thin line the path of "
        f"{', '.join(tips)}. Turn the picture with the mouse or the arrow keys; steelyard view ROBOT --motion FOLDER "
        "plays the motion with the shapes of the links."
    )
    extents = []
    for name, path in zip(tips, whole, strict=True):
        low, high = path.min(axis=0), path.max(axis=0)
        extents.append((name, *(f"{a:.3f} … {b:.3f}" for a, b in zip(low, high, strict=True))))
    extent = table(
        "Where the ends go, m in the base frame", ("Link", "x", "y", "z"), extents, identifier="extent-table"
    )
    # Below, not beside: there the heights, which tell of the table, would stand where one has to scroll to.
    return Markup(f"<p>{escape(text)}</p>{turnable(picture, 'the motion', LOOKS)}{extent}")


def _tips(robot: Robot) -> dict[str, tuple[int, Array]]:
    """Return the ends of the robot: last links, or what is fixed to them farthest away; of a hand the first two."""
    found = {}
    scene = robot_scene(robot)
    for index in robot.end_links:
        link = robot.links[index]
        fixed = [(one.name, one.placement) for one in link.attachments]
        name, placement = max([(link.name, np.eye(4)), *fixed], key=lambda one: float(np.linalg.norm(one[1][:3, 3])))
        body = None if link.inertia is None else link_body(link.inertia.parameters)
        at = scene.links[index].placement @ placement
        if body is not None and np.linalg.norm(at[:3, 3] - scene.links[index].joint_origin) < 1e-6:
            # The frame does not leave the joint, and would not show how the link moves.
            name, placement = f"centre of mass of {link.name}", np.eye(4)
            placement[:3, 3] = body.center
        found[name] = (index, np.asarray(placement))
    return dict(list(found.items())[:4])


def _limits(design: ExcitationDesign, robot: Robot, motion: _Motion) -> Markup:
    limits, charts, rows = design.limits, [], []
    for k, joint in enumerate(design.joint_names):
        low, high = float(limits.lower[k]), float(limits.upper[k])
        parts = [
            ("velocity", motion.dq[:, k], float(limits.velocity[k]), f"{robot.position_units[k]}/s"),
            ("acceleration", motion.ddq[:, k], float(limits.acceleration[k]), f"{robot.position_units[k]}/s²"),
            ("torque", motion.torque[:, k], float(limits.torque[k]), robot.torque_units[k]),
        ]
        curves = []
        if np.isfinite([low, high]).all() and high > low:
            curves.append(Curve("position", motion.t, (2.0 * motion.q[:, k] - low - high) / (high - low), color=0))
        for place, (name, values, most, _) in enumerate(parts, start=1):
            if np.isfinite(most) and most > 0.0 and np.isfinite(values).any():
                curves.append(Curve(name, motion.t, values / most, color=place))
        if curves:
            first, last = motion.t[0], motion.t[-1]
            sides = [1.0, 1.0, np.nan, -1.0, -1.0]
            curves.append(Curve("limit", [first, last, last, first, last], sides, "dashed", 6))
            charts.append(Chart(joint, "time, s", "part of the limit", tuple(curves)))
        cells = [f"{motion.q[:, k].min():.4g} … {motion.q[:, k].max():.4g}", _reach(low, high)]
        for _, values, most, _ in parts:
            largest = float(np.abs(values).max())
            cells += [f"{largest:.4g}" if np.isfinite(largest) else "–", f"{most:.4g}" if np.isfinite(most) else "none"]
        rows.append((joint, *cells))
    heads = ("Joint", "Position", "limits", "Velocity", "limit", "Acceleration", "limit", "Torque", "limit")
    text = "Largest values of the whole motion, in SI units, and the limits that the design kept."
    if not np.isfinite(motion.torque).any():
        text += " Torques are not predicted, since the inertia of the links is not known."
    figures = (
        charts_markup(charts, identifier="joint") if charts else Markup("<p>No joint has limits to compare with.</p>")
    )
    return Markup(f"<p>{escape(text)}</p>{table('Largest values', heads, rows, identifier='limits-table')}{figures}")


def _distances(design: ExcitationDesign, motion: _Motion) -> Markup:
    parts = []
    for place, constraint in enumerate(design.geometry):
        clearance = np.asarray(constraint.clearance(motion.q, motion.dq, motion.ddq))
        order = np.argsort(clearance.min(axis=0))[:MOST_PAIRS]
        curves = tuple(Curve(constraint.labels[k], motion.t, 1000.0 * clearance[:, k]) for k in order)
        ends = [motion.t[0], motion.t[-1]]
        chart = Chart(
            constraint.name,
            "time, s",
            "left beyond the margin, mm",
            (*curves, Curve("limit", ends, [0.0, 0.0], "dashed", 6)),
        )
        left = clearance.shape[1] - len(order)
        more = f" {left} more pairs stay farther apart." if left > 0 else ""
        horizon = getattr(constraint, "horizon", None)
        beyond = "" if horizon is None else f" What is farther apart than {1000.0 * horizon:.0f} mm counts as so far."
        parts.append(
            f"<p>{escape(f'The nearest of {clearance.shape[1]}.{more}{beyond}')}</p>"
            + charts_markup([chart], identifier=f"distance{place}")
        )
    parts.append(bullets(design.unchecked))
    return Markup("".join(parts) or "<p>No distances were asked for.</p>")


def _shows(model: Model, expected: PredictedIntervals) -> Markup:
    told = bullets(expected.sentences)
    intro = f"<p>What an identification with this motion alone is expected to tell, without a prior:</p>{told}"
    if expected.table is None:
        return Markup(intro)
    basis = (
        "<p>Each bar is the interval that is expected to hold the true value with a probability of 95 %. What will be "
        "<strong>measured</strong> the data alone tells, to about a fifth of its size; what will be "
        "<strong>bounded</strong> data and physics confine to its size; what will be <strong>assumed</strong> this "
        "motion does not show.</p>"
    )
    found = expected.table
    return Markup(
        f"{intro}{paragraphs([found.counts])}{basis}{paragraphs(found.sentences)}{number_tables(found, model.robot)}"
    )


def _combinations(expected: PredictedIntervals) -> Markup:
    """The base parameters, those that are least certain beside their size first."""
    values = np.full(len(expected.half_width), np.nan) if expected.base is None else expected.base
    with np.errstate(all="ignore"):
        relative = expected.half_width / np.abs(values)
    order = np.argsort(-np.nan_to_num(relative, nan=0.0, posinf=np.inf), kind="stable")
    rows = [
        (
            expected.expressions[k],
            number(float(values[k])),
            number(float(expected.half_width[k])),
            "–" if not np.isfinite(relative[k]) else f"{100.0 * relative[k]:.3g}",
        )
        for k in order
    ]
    heads = ("Combination", "Assumed value", "± 95 %", "± in % of it")
    everything = table("Base parameters, the least certain first, SI units", heads, rows, identifier="base-table")
    weak = [expected.expressions[k] for k in order if not np.isfinite(expected.half_width[k])]
    words = f"This motion says nothing of {', '.join(weak[:5])}{' and more' if len(weak) > 5 else ''}." if weak else ""
    text = f"<p>{escape(words)}</p>" if words else ""
    return Markup(f"{text}<details><summary>All {len(rows)} combinations</summary>{everything}</details>")


def _playing(design: ExcitationDesign) -> str:
    slow = f", slow passages of {design.slow_time:g} s" if design.slow_time else ""
    return f"{design.excitation.duration:g} s, {design.ramp_time:g} s to start and as much to stop{slow}"


def _sources(design: ExcitationDesign) -> Markup:
    margins = [(m.name, m.label, *m.cells) for m in design.nearest()]
    options = [
        ("family", design.family),
        ("criterion", f"{design.criterion}, {design.figure:.5g}"),
        ("what is to be shown", design.shown),
        ("terms", ", ".join(design.terms) or "none"),
        ("parameters", f"{design.parameter_count}, {design.base_count} base parameters"),
        ("period", _playing(design)),
        ("rate of the recording", f"{design.rate:g} Hz"),
        (
            "search",
            f"{design.method}, {design.finished_starts} of {design.starts} starts, seed {design.seed}, {design.status}",
        ),
    ]
    options += [(name, version) for name, version in versions(_LIBRARIES).items()]
    remarks = bullets(one for one in design.remarks if one not in design.warnings)
    nearest = table(
        "The nearest part of each limit",
        ("Limit", "Part", "Margin", "At, s"),
        margins,
        identifier="margins",
        texts=(1,),
    )
    how = table("Options and versions", ("", ""), options, identifier="options", texts=(1,))
    return Markup(f"{nearest}{remarks}{how}")
