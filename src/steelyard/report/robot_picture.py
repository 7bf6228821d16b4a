"""The robot of an identification as a drawing: links, centres of mass, equivalent ellipsoids, and CAD's beside."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files import write_text
from steelyard.identification import Identification
from steelyard.identification.parameter_table import LinkRows, weakest
from steelyard.robot import Robot

from .drawing import Drawing, View
from .html_document import Markup, escape, package_text
from .link_bodies import LinkBody, link_body
from .robot_scene import RobotScene, robot_scene

__all__ = ["KEY", "PlacedRobot", "drawing_of_links", "drawn_links", "ground", "robot_picture", "robot_svg", "skeleton"]

Array = NDArray[np.float64]

WIDTH, HEIGHT = 720.0, 560.0
FAR = 3.0
"""Centres of mass farther away than so many radii of the robot are named and not drawn: the robot would be a speck. The
frames of a robot without a tool tell nothing of its last link, which may be as long as the others: twice is near."""
LONGEST_INTERVAL = 0.5  # of the radius of the robot; longer lines hide each other
_AZIMUTHS = np.deg2rad(np.arange(-165.0, 181.0, 15.0))
_ELEVATIONS = np.deg2rad([20.0, 35.0])
_STEPS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)


@dataclass(frozen=True, eq=False)
class DrawnLink:
    """A link with what is drawn of it.

    Attributes
    ----------
    number : int
        From 1, as in the names of parameters.
    rows : LinkRows or None
        What its numbers rest on.
    body, cad : LinkBody or None
        Of the answer and of the description, in the frame of the link; None where there is no mass.
    cad_mass : float
        kg; NaN where the description says nothing.
    reference : str
        What `cad` is called in words: another estimate may stand in its place.
    """

    number: int
    name: str
    rows: LinkRows | None
    body: LinkBody | None
    cad: LinkBody | None
    cad_mass: float
    reference: str = "CAD"

    @property
    def cad_is_impossible(self) -> bool:
        """Whether the description gives the link an inertia that no body has."""
        return not np.isnan(self.cad_mass) and (self.cad is None or not self.cad.possible)

    @property
    def sentence(self) -> str:
        """Masses, and what they rest on."""
        told = []
        if self.body is not None:
            basis = "" if self.rows is None or self.rows.mass.basis == "unknown" else f", {self.rows.mass.basis}"
            told.append(f"{self.body.mass:.3g} kg{basis}")
        if not np.isnan(self.cad_mass):
            told.append(
                f"{self.reference} {self.cad_mass:.3g} kg{', which no body has' if self.cad_is_impossible else ''}"
            )
        return f"{self.name}: {'; '.join(told) or 'nothing is known of its mass'}"


def drawn_links(identification: Identification) -> list[DrawnLink]:
    """Return what can be drawn of each moving link."""
    model, told = identification.model, identification.parameters
    found, described = identification.estimate.parameters, np.asarray(model.robot.parameters, dtype=float)
    rows = told.links if told is not None else ()
    links = []
    for index, (link, columns) in enumerate(zip(model.robot.links, model.link_columns, strict=True)):
        cad = described[columns]
        known = bool(np.isfinite(cad).all())
        links.append(
            DrawnLink(
                index + 1,
                link.name,
                rows[index] if index < len(rows) else None,
                None if found is None else link_body(found[columns]),
                link_body(cad),
                float(cad[9]) if known else np.nan,
            )
        )
    return links


def robot_svg(identification: Identification, q: ArrayLike | None = None) -> Markup:
    """Return a still picture of the robot, an SVG document on a light card that needs nothing else.

    Parameters
    ----------
    identification : Identification
    q : (N,), optional
        The configuration, rad or m; zeros by default.
    """
    rectangle = f'<rect width="{WIDTH:g}" height="{HEIGHT:g}" rx="8" fill="#fdfdfb"/>'
    card = f"<style>{package_text('drawing.css')}</style>{rectangle}"
    picture = drawing_of_links(identification.model.robot, drawn_links(identification), q, before=card)
    return Markup(picture.replace("<svg ", f'<svg width="{WIDTH:g}" height="{HEIGHT:g}" ', 1))


def robot_picture(identification: Identification, target: str | Path, q: ArrayLike | None = None) -> None:
    """Write the picture of `robot_svg`; the file appears whole or not at all.

    Parameters
    ----------
    identification : Identification
    target : str or Path
        An ``.svg`` file, replaced where it is there.
    q : (N,), optional
        The configuration, rad or m; zeros by default.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_text(robot_svg(identification, q), target)


KEY = (
    '<span class="robot-drawing key-of-drawing"><svg width="34" height="16" aria-hidden="true">'
    '<ellipse class="ball {0}" cx="17" cy="8" rx="14" ry="7"/>'
    '<ellipse class="outline {0}" cx="17" cy="8" rx="14" ry="7"/><circle '
    'class="center {0}" cx="17" cy="8" r="3.5"/></svg> {0}</span>'
)
"""The sample of a basis, with its name in the place of ``{0}``."""


def drawing_of_links(robot: Robot, links: list[DrawnLink], q: ArrayLike | None = None, *, before: str = "") -> Markup:
    """Return the drawing of a robot with what is given of each of its links, for a document with ``drawing.css``.

    Parameters
    ----------
    robot : Robot
        Its lengths are numbers.
    q : (N,), optional
        rad or m; zeros by default.
    before : str
        What stands before its elements.
    """
    if q is not None and np.shape(q) != (robot.dof,):
        raise InputError(
            f"{robot.name} has {robot.dof} joints, so q must have the shape ({robot.dof},), got {np.shape(q)}."
        )
    scene = robot_scene(robot, q)
    placed = PlacedRobot(scene, links)
    drawing = Drawing(placed.view())
    drawing.parts += [ground(drawing, placed), skeleton(drawing, placed), _bodies(drawing, placed)]
    drawing.parts.append("".join(_numbers(drawing, placed)))
    where = "with all joints at zero" if q is None else "in the configuration that was asked for"
    words = ". ".join(link.sentence for link in links[:30])
    more = f". And {len(links) - 30} more links" if len(links) > 30 else ""
    return drawing.svg(f"{robot.name} {where}", f"{words}{more}.", before)


class PlacedRobot:
    """The scene with z upwards, and the bodies in it; `further` places (K, 3) of the base frame are to be seen, too."""

    def __init__(self, scene: RobotScene, links: list[DrawnLink], further: Array | None = None) -> None:
        self.scene, self.links = scene, links
        self.turn = _upright(scene.up)
        self.further = np.zeros((0, 3)) if further is None else further @ self.turn.T
        self.bodies = [self._body(index, link.body) for index, link in enumerate(links)]
        self.cads = [self._body(index, link.cad) for index, link in enumerate(links)]
        middle = self.turn @ scene.middle
        reach = [scene.size]
        reach += [
            float(np.linalg.norm(center - middle) + np.abs(radii).max())
            for center, radii in filter(None, (*self.bodies, *self.cads))
            if np.linalg.norm(center - middle) <= FAR * scene.size
        ]
        self.middle, self.reach = middle, min(max(reach), FAR * scene.size)
        if len(self.further):
            places = self.points()
            self.middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
            self.reach = float(np.linalg.norm(places - self.middle, axis=1).max())
        self.step = next((step for step in _STEPS if step >= self.reach / 4.0), _STEPS[-1])

    def _body(self, index: int, body: LinkBody | None) -> tuple[Array, Array] | None:
        """Centre and conjugate radii (3, 3) in rows; what is imaginary is drawn flat."""
        if body is None:
            return None
        placement = self.scene.links[index].placement
        center = placement[:3, :3] @ body.center + placement[:3, 3]
        radii = (placement[:3, :3] @ (body.axes * np.nan_to_num(body.semi_axes))).T
        return self.turn @ center, radii @ self.turn.T

    def is_near(self, place: Array) -> bool:
        """Return whether it lies within the picture."""
        return float(np.linalg.norm(place - self.middle)) <= FAR * self.scene.size

    def point(self, place: Array) -> Array:
        """A place of the base frame."""
        return np.asarray(self.turn @ place)

    def points(self) -> Array:
        """Joints, ends and centres of mass."""
        places = [self.point(place) for link in self.scene.links for place in (link.joint_origin, *link.ends)]
        places += [body[0] for body in self.bodies if body is not None and self.is_near(body[0])]
        return np.array([np.zeros(3), *places, *self.further])

    def view(self) -> View:
        """From where the robot spreads most in the picture."""
        points = self.points() - self.middle

        def spread(view: View) -> float:
            flat = view.vector(points)
            width, height = flat.max(axis=0) - flat.min(axis=0)
            return float((width + self.reach) * (height + self.reach))

        scale = 0.47 * HEIGHT / self.reach
        views = [View(a, e, self.middle, 1.0, WIDTH, HEIGHT) for e in _ELEVATIONS for a in _AZIMUTHS]
        # The first of those that are as good for all that rounding tells.
        best = max(views, key=lambda view: round(spread(view) / self.reach**2, 6))
        return View(best.azimuth, best.elevation, self.middle, scale, WIDTH, HEIGHT)


def _upright(up: Array) -> Array:
    """The least rotation (3, 3) that makes a direction the z axis."""
    z = np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(up, z), float(up @ z)
    if cosine < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    x, y, w = axis
    cross = np.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine)) + 0.0


def ground(drawing: Drawing, placed: PlacedRobot) -> str:
    """Draw the ground and the axes of the base."""
    step, lowest = placed.step, float(placed.points()[:, 2].min())
    count = max(1, int(np.ceil(0.7 * placed.reach / step)))
    x, y = (step * round(float(value) / step) for value in placed.middle[:2])
    parts: list[str] = []
    for index in range(-count, count + 1):
        for first, second in (((index, -count), (index, count)), ((-count, index), (count, index))):
            ends = [[x + step * a, y + step * b, lowest] for a, b in (first, second)]
            parts.append(drawing.line(ends, "ground"))
    origin = placed.point(np.zeros(3))
    for name, direction in zip("xyz", np.eye(3), strict=True):
        tip = origin + 0.5 * step * placed.point(direction)
        parts.append(
            drawing.line([origin, tip], f"axis {name}") + drawing.mark(tip, f'<text x="4" y="4">{name}</text>')
        )
    return f'<g aria-hidden="true">{"".join(parts)}</g>'


def skeleton(drawing: Drawing, placed: PlacedRobot) -> str:
    """Draw links as lines between joints, and joints as discs and squares."""
    scene, size = placed.scene, 0.035 * placed.reach
    spans: list[str] = []
    joints: list[str] = []
    for index, link in enumerate(scene.links):
        origin = placed.point(link.joint_origin)
        number = index + 1
        if link.parent < 0:
            spans.append(drawing.line([np.zeros(3), origin], "span-of-link"))
        spans += [
            f'<g data-link="{number}">{drawing.line([origin, placed.point(end)], "span-of-link")}</g>'
            for end in link.ends
        ]
        x, y, z = (placed.point(axis) for axis in link.joint_frame.T)
        axis = drawing.line([origin - 2.0 * size * z, origin + 2.0 * size * z], "joint-axis")
        shape = drawing.disc if link.rotates else drawing.square
        symbol = shape(origin, [size * x, size * y], "joint")
        kind = "turns" if link.rotates else "slides"
        joints.append(f"<g><title>{escape(f'{link.joint_name} {kind}')}</title>{axis}{symbol}</g>")
    return "".join(spans) + "".join(joints)


def _bodies(drawing: Drawing, placed: PlacedRobot) -> str:
    groups = []
    for index, link in enumerate(placed.links):
        body, cad = placed.bodies[index], placed.cads[index]
        inner = ""
        if cad is not None and placed.is_near(cad[0]):
            inner += _cad(drawing, link, cad)
        elif link.cad is None and link.cad_is_impossible:
            origin = placed.point(placed.scene.links[index].placement[:3, 3])
            inner += f'<g class="drawn-cad impossible">{drawing.mark(origin, _CROSS)}</g>'
        if body is not None and placed.is_near(body[0]):
            if cad is not None and placed.is_near(cad[0]):
                inner += f'<g class="drawn-cad">{drawing.line([body[0], cad[0]], "leader")}</g>'
            inner += _answer(drawing, placed, index, body)
        if inner:
            title = f"<title>{escape(f'{link.number} {link.sentence}')}</title>"
            place = body[0] if body is not None else cad[0] if cad is not None else placed.middle
            groups.append((place, f'<g data-link="{link.number}">{title}{inner}</g>'))
    return drawing.by_depth(groups)


_CROSS = '<path class="cad-center" d="M-4.5 -4.5L4.5 4.5M-4.5 4.5L4.5 -4.5"/>'


def _cad(drawing: Drawing, link: DrawnLink, body: tuple[Array, Array]) -> str:
    center, radii = body
    kind = "drawn-cad impossible" if link.cad_is_impossible else "drawn-cad"
    return f'<g class="{kind}">{drawing.ball(center, radii, "cad")}{drawing.mark(center, _CROSS)}</g>'


def _answer(drawing: Drawing, placed: PlacedRobot, index: int, body: tuple[Array, Array]) -> str:
    center, radii = body
    rows = placed.links[index].rows
    mass, moments, place = "unknown", "unknown", "unknown"
    intervals = ""
    if rows is not None:
        mass, moments, place = rows.mass.basis, weakest(rows.moments), weakest(rows.center)
        frame = placed.turn @ placed.scene.links[index].placement[:3, :3]
        longest = LONGEST_INTERVAL * placed.scene.size
        for row, axis in zip(rows.center, frame.T, strict=True):
            if row.basis in ("measured", "bounded"):
                ends = [center + np.clip(end - row.value, -longest, longest) * axis for end in (row.lower, row.upper)]
                intervals += drawing.line(ends, f"interval-of-center {row.basis}")
    rings = "".join(drawing.disc(center, np.delete(radii, axis, axis=0), f"principal {moments}") for axis in range(3))
    return (
        f'<g class="drawn-answer">{drawing.ball(center, radii, f"ball {mass}")}{rings}'
        f"{drawing.ball(center, radii, f'outline {moments}')}{intervals}"
        + drawing.mark(center, f'<circle class="center {place}" r="4"/>')
        + "</g>"
    )


def _numbers(drawing: Drawing, placed: PlacedRobot) -> Iterator[str]:
    for index, link in enumerate(placed.links):
        body = placed.bodies[index] or placed.cads[index]
        if body is not None and placed.is_near(body[0]):
            yield f'<g class="numbers" data-link="{link.number}">{drawing.label(body[0], str(link.number))}</g>'


def remarks_on_drawing(links: list[DrawnLink], scene: RobotScene) -> list[str]:
    """Say what is not drawn, and what of the description no body can be."""
    said = []
    for link in links:
        placement = scene.links[link.number - 1].placement
        for what, body in (("", link.body), ("CAD's ", link.cad)):
            if body is None:
                continue
            center = placement[:3, :3] @ body.center + placement[:3, 3]
            distance = float(np.linalg.norm(center - scene.middle))
            if distance > FAR * scene.size:
                said.append(
                    f"{what or 'The '}centre of mass of {link.name} lies {distance:.3g} m from the middle of the "
                    "robot, outside the picture."
                )
        if link.cad_is_impossible:
            why = "no positive mass" if link.cad is None else "moments of inertia that no body has, drawn flat"
            said.append(f"CAD gives {link.name} {why}.")
    return said
