"""A robot in the browser: shapes, inertia, what is known of it, and motions with their torques, drawn by viser."""

from __future__ import annotations

import contextlib
import io
import ipaddress
import logging
import math
import queue
import socket
import time
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from steelyard.collision.configurations import place_links, upward
from steelyard.collision.shapes import Box, Capsule, Cylinder, Mesh, PlacedShape, Shape, Sphere
from steelyard.errors import InputError, require_package
from steelyard.files import Meanwhile

from .html_document import escape, number
from .link_bodies import LinkBody
from .playback import Nearness, Playback
from .viewed_robot import KNOWN_OF, TOO_LARGE, KnownOf, ViewedRobot, basis_of

__all__ = ["BASIS_COLORS", "Viewer", "view_robot"]

Array = NDArray[np.float64]
Color = tuple[int, int, int]

# They differ in hue and in lightness, so that they are told apart without the difference of red and green.
BASIS_COLORS: dict[str, Color] = {
    "measured": (47, 143, 208),
    "bounded": (240, 184, 60),
    "assumed": (181, 68, 110),
    "unknown": (150, 150, 150),
}
PLAIN, OF_CAD, TOO_NEAR = (170, 178, 186), (90, 96, 103), (225, 38, 28)
FRAME_RATE = 30.0  # Hz
CHART_RATE = 4.0  # Hz, at which the mark in the chart and the sliders follow a motion; each costs thousands of bytes
CHART_POINTS = 600
MOST_TRIANGLES = 150_000  # of one mesh, beyond which its hull is sent: a browser slows down at a million in all
SPEEDS = {"a tenth": 0.1, "half": 0.5, "real": 1.0, "double": 2.0, "tenfold": 10.0}
CURVES = {"measured": "#8b8b8b", "identified": "#2f8fd0", "CAD": "#b5446e"}
_PRINTING_NOTHING = Meanwhile(lambda: contextlib.redirect_stdout(io.StringIO()))


def quaternion(rotation: Array) -> tuple[float, float, float, float]:
    """Return (w, x, y, z) of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return float(w), float(x), float(y), float(z)


def triangles_of(shape: Shape) -> tuple[Array, NDArray[np.intp]]:
    """Return vertices (k, 3), m, and triangles (t, 3) that show a shape."""
    import trimesh

    match shape:
        case Mesh():
            whole = shape.exact and len(shape.triangles) <= MOST_TRIANGLES
            return (shape.vertices, shape.triangles) if whole else shape.hull
        case Sphere():
            made = trimesh.creation.icosphere(subdivisions=3, radius=shape.radius)
        case Cylinder():
            made = trimesh.creation.cylinder(radius=shape.radius, height=shape.length, sections=48)
        case Capsule():
            made = trimesh.creation.capsule(radius=shape.radius, height=shape.length, count=(24, 24))
            made.apply_translation(-made.bounds.mean(axis=0))
        case Box():
            made = trimesh.creation.box(extents=shape.size)
        case _:
            raise InputError(f"a shape of the type {type(shape).__name__} cannot be drawn.")
    return np.asarray(made.vertices), np.asarray(made.faces, dtype=np.intp)


def bars_html(names: Sequence[str], values: dict[str, Array], largest: Array, units: Sequence[str]) -> str:
    """Return bars of torques, one row a joint: what was measured, and below it each prediction.

    Parameters
    ----------
    names, units : sequence of str
        (N,)
    values : dict
        (N,) each; NaN where nothing is known.
    largest : ndarray
        (N,) what the full width stands for.
    """
    rows = []
    for k, name in enumerate(names):
        bars = []
        for key, torques in values.items():
            value = float(torques[k])
            part = 0.0 if not math.isfinite(value) or not largest[k] > 0.0 else min(abs(value) / float(largest[k]), 1.0)
            start = 50.0 - 50.0 * part if value < 0.0 else 50.0
            bars.append(
                '<div style="position:relative;height:7px;background:rgba(128,128,128,.15);margin:1px 0">'
                f'<div style="position:absolute;height:7px;left:{start:.2f}%;width:{50.0 * part:.2f}%;'
                f'background:{CURVES[key]}"></div></div>'
            )
        said = ", ".join("–" if np.isnan(torques[k]) else f"{torques[k]:.3g}" for torques in values.values())
        rows.append(
            f'<div style="margin:.35em 0;font-size:.8em"><div style="display:flex;justify-content:space-between">'
            f"<span>{escape(name)}</span><span>{said} {escape(units[k])}</span></div>{''.join(bars)}</div>"
        )
    keys = "".join(
        f'<span style="margin-right:1em"><span style="color:{CURVES[key]}">■</span> {escape(key)}</span>'
        for key in values
    )
    return f'<div style="padding:0 .8em"><div style="font-size:.8em">{keys}</div>{"".join(rows)}</div>'


class Viewer:
    """A robot on a server of viser; `run` serves it until it is told to stop.

    Parameters
    ----------
    server : viser.ViserServer
    remarks : sequence of str
        Shown in the page.

    Notes
    -----
    What a visitor does arrives on threads of the server. It is put in a queue, and one thread draws, so that nothing
    needs a lock.
    """

    def __init__(
        self,
        viewed: ViewedRobot,
        server: Any,
        motion: Playback | None = None,
        nearness: Nearness | None = None,
        remarks: Sequence[str] = (),
    ) -> None:
        self.viewed, self.server, self.motion, self.nearness = viewed, server, motion, nearness
        self.robot = viewed.model.robot
        self.q = viewed.neutral.copy() if motion is None else motion.configuration(0.0)
        self.time, self.playing = 0.0, False
        self._asked: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._setting = False  # whether a slider is moved by this program, and not by a visitor
        self._layers: dict[str, list[Any]] = {}
        self._colored: list[tuple[int, Any]] = []
        self._shown_near: frozenset[int] = frozenset()
        self._near_lines: Any = None
        self._last_chart = -math.inf
        self.size = viewed.extent[1]
        self._prepare_scene()
        self._draw_robot()
        self._make_panel(remarks)
        self.place()

    # What is drawn.

    def _prepare_scene(self) -> None:
        scene = self.server.scene
        up = upward(self.robot)
        scene.set_up_direction(tuple(up.tolist()))
        middle, size = self.viewed.extent
        if self.motion is not None:  # what slides may go far from where it is drawn first
            rows = np.unique(np.linspace(0, len(self.motion.t) - 1, 100).astype(int))
            places = place_links(self.robot, self.motion.q[rows]).positions.reshape(-1, 3)
            low = np.minimum(places.min(axis=0), middle - size / 2.0)
            high = np.maximum(places.max(axis=0), middle + size / 2.0)
            middle, size = (low + high) / 2.0, max(size, float(np.linalg.norm(high - low)) / 2.0)
        across = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
        across /= np.linalg.norm(across)
        ahead = np.cross(across, up)
        camera = self.server.initial_camera
        camera.position = tuple((middle + size * (1.6 * ahead + 0.9 * across + 0.5 * up)).tolist())
        camera.look_at = tuple(middle.tolist())
        camera.up = tuple(up.tolist())
        turn = np.column_stack([ahead, np.cross(up, ahead), up])
        scene.add_grid(
            "/ground", width=4.0 * size, height=4.0 * size, cell_size=0.1 if size < 3.0 else size / 10.0,
            section_size=0.5 if size < 3.0 else size / 2.0, plane="xy", wxyz=quaternion(turn),
        )  # fmt: skip

    def _draw_robot(self) -> None:
        scene = self.server.scene
        self.frames = [scene.add_frame("/robot/base", show_axes=False)]
        self.frames += [scene.add_frame(f"/robot/{k}", show_axes=False) for k in range(len(self.robot.links))]
        shaped = {one.body for one in self.viewed.shapes}
        for count, one in enumerate(self.viewed.shapes):
            self._draw_shape(count, one)
        self._draw_rods(shaped)
        center_size = 0.02 * self.size
        bodies = {
            "identified": self.viewed.bodies(self.viewed.identified),
            "CAD": self.viewed.bodies(self.viewed.described),
        }
        for of, found in bodies.items():
            for index, body in enumerate(found):
                if body is not None:
                    self._draw_body(index, body, of, center_size)
        for index in range(len(self.robot.links)):
            length = 0.12 * self.size
            axes = scene.add_frame(
                f"{self._place(index)}/axes", axes_length=length, axes_radius=0.03 * length, visible=False
            )
            self._layers.setdefault("frames", []).append(axes)

    def _place(self, body: int) -> str:
        return "/robot/base" if body < 0 else f"/robot/{body}"

    def _draw_shape(self, count: int, one: PlacedShape) -> None:
        vertices, faces = triangles_of(one.shape)
        handle = self.server.scene.add_mesh_simple(
            f"{self._place(one.body)}/shape{count}", vertices, faces, color=PLAIN, flat_shading=True, side="double",
            wxyz=quaternion(one.placement[:3, :3]), position=tuple(one.placement[:3, 3].tolist()),
        )  # fmt: skip
        self._layers.setdefault("shapes", []).append(handle)
        self._colored.append((one.body, handle))

    def _draw_rods(self, shaped: set[int]) -> None:
        """Draw links without shapes as rods between their joints, and the others so when it is asked for."""
        import trimesh

        radius = 0.018 * self.size
        for count, (body, start, end) in enumerate(self.viewed.rods):
            if np.linalg.norm(end - start) > 1e-9:
                made = trimesh.creation.cylinder(radius=radius, segment=np.array([start, end]), sections=24)
            else:
                made = trimesh.creation.icosphere(subdivisions=2, radius=1.3 * radius)
                made.apply_translation(start)
            handle = self.server.scene.add_mesh_simple(
                f"{self._place(body)}/rod{count}", np.asarray(made.vertices), np.asarray(made.faces), color=PLAIN,
                visible=body not in shaped,
            )  # fmt: skip
            self._layers.setdefault("rods" if body in shaped else "shapes", []).append(handle)
            self._colored.append((body, handle))
        for index in range(len(self.robot.links)):
            starts = [start for body, start, _ in self.viewed.rods if body == index]
            if starts:
                name = f"{self._place(index)}/joint"
                ball = self.server.scene.add_icosphere(
                    name, radius=1.5 * radius, subdivisions=2, color=OF_CAD, position=tuple(starts[0].tolist()),
                    visible=index not in shaped,
                )  # fmt: skip
                self._layers.setdefault("rods" if index in shaped else "shapes", []).append(ball)

    def _draw_body(self, index: int, body: LinkBody, of: str, center_size: float) -> None:
        scene, place = self.server.scene, f"{self._place(index)}/{of}"
        wire = of == "CAD"
        pose = {"wxyz": quaternion(body.axes), "position": tuple(body.center.tolist())}
        color = OF_CAD if wire else PLAIN
        on = {f"{of} ellipsoids": of == "identified" or self.viewed.identified is None, f"{of} boxes": False}
        if body.possible:
            thinnest = 1e-3 * self.size  # a rod has none, and nothing would be seen
            semi_axes = tuple(np.maximum(body.semi_axes, thinnest).tolist())
            sides = tuple(np.maximum(body.sides, thinnest).tolist())
            look: dict[str, Any] = {"color": color, "wireframe": wire, **pose}
            if not wire:
                look["opacity"] = 0.75
            made = [
                scene.add_icosphere(
                    f"{place}_ellipsoid", scale=semi_axes, subdivisions=2 if wire else 4,
                    visible=on[f"{of} ellipsoids"], cast_shadow=False, **look,
                ),
                scene.add_box(f"{place}_box", dimensions=sides, visible=False, cast_shadow=False, **look),
            ]  # fmt: skip
            layers = list(on)
            if self.viewed.is_too_large(body):
                layers[0], made[0].visible = TOO_LARGE, False
            for layer, handle in zip(layers, made, strict=True):
                self._layers.setdefault(layer, []).append(handle)
                if not wire:
                    self._colored.append((index, handle))
        self._layers.setdefault(f"{of} centres of mass", []).append(
            scene.add_icosphere(
                f"{place}_center", radius=center_size, subdivisions=2, color=(20, 20, 20) if not wire else OF_CAD,
                wireframe=wire, position=pose["position"], cast_shadow=False,
            )
        )  # fmt: skip

    # What a visitor can do.

    def _make_panel(self, remarks: Sequence[str]) -> None:
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label(f"steelyard view: {self.robot.name}"[:80])
        gui.add_html(self._head(remarks))
        if self.motion is not None:
            self._motion_panel(self.motion)
        self.near_words = None
        if self.nearness is not None:
            with gui.add_folder("Distances between links"):
                self.near_words = gui.add_html("")
        with gui.add_folder("Joints"):
            self._joint_panel()
        with gui.add_folder("Show"):
            self._layer_panel()
        if self.viewed.known:
            with gui.add_folder("Links", expand_by_default=False):
                gui.add_html(self._link_table())

    def _layer_panel(self) -> None:
        gui = self.server.gui
        self.layers: dict[str, Any] = {}
        for layer, handles in self._layers.items():
            box = gui.add_checkbox(layer, initial_value=handles[0].visible)
            self.layers[layer] = box
            self._when(box, partial(self._switch, layer))
        if "shapes" in self._layers:
            clear = bool(self._layers.get("identified ellipsoids") or self._layers.get("CAD ellipsoids"))
            self.opacity = gui.add_slider("opacity of shapes", 0.0, 1.0, 0.05, 0.55 if clear else 1.0)
            self._when(self.opacity, lambda: self._fade(self.opacity.value))
            self._fade(self.opacity.value)
        if self.viewed.known:
            self.known_of = gui.add_dropdown("colours: known of", KNOWN_OF, initial_value="mass")
            self._when(self.known_of, self.color)
        self.color()

    def _joint_panel(self) -> None:
        gui = self.server.gui
        self.sliders: list[Any] = []
        for k, index in enumerate(self.robot.driving_joints):
            joint = self.robot.joints[index]
            widest = math.pi if joint.rotates else 0.5
            low = joint.lower if math.isfinite(joint.lower) else min(-widest, float(self.q[k]))
            high = joint.upper if math.isfinite(joint.upper) else max(widest, float(self.q[k]))
            if self.motion is not None:  # a log may pass the limits of the description
                low = min(low, float(self.motion.q[:, k].min()))
                high = max(high, float(self.motion.q[:, k].max()))
            unit = "rad" if joint.rotates else "m"
            low, high = float(low), float(max(high, low))
            step = max((high - low) / 1000.0, 1e-9)
            start = min(max(float(self.q[k]), low), high)
            slider = gui.add_slider(f"{joint.name}, {unit}", low, high, step, start)
            self.sliders.append(slider)
            self._when(slider, partial(self._slide, k))
        self._when(gui.add_button("back to the start"), self.go_back, click=True)

    def _motion_panel(self, motion: Playback) -> None:
        gui = self.server.gui
        names = self.robot.joint_names
        self.units = self.robot.torque_units
        self._largest = np.zeros(self.robot.dof)
        for values in motion.torques.values():
            with np.errstate(all="ignore"):
                self._largest = np.fmax(self._largest, np.nanmax(np.abs(values), axis=0, initial=0.0))
        with gui.add_folder("Motion"):
            self.play_button = gui.add_button("play")
            self._when(self.play_button, self.toggle, click=True)
            self.clock = gui.add_slider("time, s", 0.0, motion.duration, max(motion.duration / 2000.0, 1e-4), 0.0)
            self._when(self.clock, lambda: self.seek(self.clock.value))
            self.speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="real")
            self.bars = gui.add_html("")
            if motion.torques:
                self.chosen = gui.add_dropdown("torque of", names, initial_value=names[0])
                self._chart_rows = np.unique(np.linspace(0, len(motion.t) - 1, CHART_POINTS).astype(int))
                series: list[dict[str, Any]] = [{"label": "time, s"}]
                series += [{"label": key, "stroke": CURVES[key], "width": 2} for key in motion.torques]
                series += [{"label": "now", "stroke": "#e1261c", "points": {"show": True, "size": 9}, "width": 0}]
                self.chart = gui.add_uplot(
                    self._chart_data(), tuple(series), scales=self._chart_scales(), height=220,
                    axes=({"label": "time, s"}, {"label": self.units[0]}),
                )  # fmt: skip
                self._when(self.chosen, self.draw_chart)

    def _when(self, handle: Any, done: Callable[[], None], *, click: bool = False) -> None:
        """Do something in the thread that draws when a visitor uses a control."""

        def used(_: Any) -> None:
            if not self._setting:
                self._asked.put(done)

        (handle.on_click if click else handle.on_update)(used)

    @contextlib.contextmanager
    def _own(self) -> Iterator[None]:
        """Move controls without taking that for the wish of a visitor."""
        self._setting = True
        try:
            yield
        finally:
            self._setting = False

    def show_layer(self, layer: str, visible: bool) -> None:
        """Show or hide what belongs to a layer."""
        for handle in self._layers[layer]:
            handle.visible = visible

    def _switch(self, layer: str) -> None:
        self.show_layer(layer, self.layers[layer].value)

    def _slide(self, k: int) -> None:
        self.move_joint(k, self.sliders[k].value)

    def move_joint(self, k: int, value: float) -> None:
        """Put one joint at a position, rad or m; a motion that plays stops."""
        self.pause()
        self.q[k] = value
        self.place()

    def go_back(self) -> None:
        """Put the robot where it was at first."""
        self.pause()
        self.time = 0.0
        self.q = self.viewed.neutral.copy() if self.motion is None else self.motion.configuration(0.0)
        self._follow()
        self.place()

    def toggle(self) -> None:
        """Play, or stop playing; from the beginning where the end was reached."""
        if self.playing:
            self.pause()
            return
        if self.motion is not None and self.time >= self.motion.duration:
            self.time = 0.0
        self.playing = True
        self.play_button.label = "pause"

    def pause(self) -> None:
        """Stop playing."""
        if self.playing:
            self.playing = False
            self.play_button.label = "play"
            self._follow()

    def seek(self, to: float) -> None:
        """Go to a time of the motion, s."""
        if self.motion is not None:
            self.time = min(max(to, 0.0), self.motion.duration)
            self.q = self.motion.configuration(self.time)
            self.place()
            if not self.playing:
                self._follow()

    def color(self) -> None:
        """Colour the links by what is known of them, and by what they come too near to."""
        of: KnownOf = self.known_of.value if self.viewed.known else "mass"
        for body, handle in self._colored:
            known = body >= 0 and bool(self.viewed.known)
            color = BASIS_COLORS[basis_of(self.viewed.known[body], of)] if known else PLAIN
            handle.color = TOO_NEAR if body in self._shown_near else color

    def _fade(self, opacity: float) -> None:
        for handle in self._layers["shapes"]:
            with contextlib.suppress(AttributeError):
                handle.opacity = None if opacity >= 1.0 else opacity

    # Time.

    def place(self) -> None:
        """Draw the robot in its configuration, with torques and near pairs."""
        places = place_links(self.robot, self.q[None])
        with self.server.atomic():
            for index, frame in enumerate(self.frames[1:]):
                frame.wxyz = quaternion(places.rotations[index, 0])
                frame.position = tuple(places.positions[index, 0].tolist())
            self._show_near()
            if self.motion is not None:
                at = self.motion.index(self.time)
                values = {key: torques[at] for key, torques in self.motion.torques.items()}
                self.bars.content = bars_html(self.robot.joint_names, values, self._largest, self.units)

    def _show_near(self) -> None:
        if self.nearness is None or self.near_words is None:
            return
        pairs = self.nearness.near(self.q)
        bodies: frozenset[int] = frozenset().union(*(pair.bodies for pair in pairs if pair.too_near))
        if bodies != self._shown_near:
            self._shown_near = bodies
            self.color()
        if self._near_lines is not None:
            self._near_lines.remove()
            self._near_lines = None
        lines = [pair for pair in pairs if len(pair.points)]
        if lines:
            ends = np.array([pair.points for pair in lines])
            colors = np.array([[TOO_NEAR if pair.too_near else (240, 184, 60)] * 2 for pair in lines])
            self._near_lines = self.server.scene.add_line_segments("/near", ends, colors, line_width=4.0)
        said = [f"<b>{escape(self.nearness.words())}</b>"] if len(self.nearness.t) else []
        said += [
            f'<span style="color:{"#e1261c" if pair.too_near else "inherit"}">{escape(pair.label)}: '
            f"{1000.0 * pair.distance:.0f} mm</span>"
            for pair in pairs[:8]
        ]
        if not pairs:
            said.append("Here no two links are near each other.")
        self.near_words.content = f'<div style="padding:0 .8em;font-size:.85em">{"<br>".join(said)}</div>'

    def _follow(self) -> None:
        """Let clock, sliders and chart show where the motion is."""
        with self._own(), self.server.atomic():
            if self.motion is not None:
                self.clock.value = self.time
            for slider, value in zip(self.sliders, self.q.tolist(), strict=True):
                slider.value = min(max(value, slider.min), slider.max)
        self.draw_chart()

    def _chart_data(self) -> tuple[Array, ...]:
        assert self.motion is not None
        joint = self.robot.joint_names.index(self.chosen.value)
        rows, at = self._chart_rows, self.motion.index(self.time)
        at = int(np.clip(np.searchsorted(rows, at), 0, len(rows) - 1))
        curves = [values[rows, joint] for values in self.motion.torques.values()]
        now = np.full(len(rows), np.nan)
        now[at] = curves[0][at] if np.isfinite(curves[0][at]) else 0.0
        return (self.motion.t[rows], *curves, now)

    def _chart_scales(self) -> dict[str, Any]:
        """The range of the torque is given: uPlot finds none where values are missing."""
        assert self.motion is not None
        joint = self.robot.joint_names.index(self.chosen.value)
        values = np.concatenate([torques[:, joint] for torques in self.motion.torques.values()])
        low, high = float(np.nanmin(values, initial=0.0)), float(np.nanmax(values, initial=0.0))
        spare = 0.05 * (high - low) or 1.0
        return {"x": {"time": False}, "y": {"range": (low - spare, high + spare)}}

    def draw_chart(self) -> None:
        """Draw the torque of the chosen joint, and where the motion is."""
        if self.motion is not None and self.motion.torques:
            unit = self.units[self.robot.joint_names.index(self.chosen.value)]
            if self.chart.axes[1]["label"] != unit:
                self.chart.axes = ({"label": "time, s"}, {"label": unit})
            scales = self._chart_scales()
            if self.chart.scales != scales:
                self.chart.scales = scales
            self.chart.data = self._chart_data()

    def advance(self, seconds: float) -> None:
        """Do what visitors asked for, and play so many seconds of their time."""
        while not self._asked.empty():
            self._asked.get_nowait()()
        if self.playing and self.motion is not None:
            self.time += seconds * SPEEDS[self.speed.value]
            ended = self.time >= self.motion.duration
            self.seek(self.time)
            now = time.monotonic()
            if ended:
                self.pause()
            elif now - self._last_chart > 1.0 / CHART_RATE:
                self._last_chart = now
                self._follow()

    def run(self) -> NoReturn:
        """Serve until Ctrl-C."""
        last = time.monotonic()
        while True:
            time.sleep(max(0.0, 1.0 / FRAME_RATE - (time.monotonic() - last)))
            now = time.monotonic()
            self.advance(now - last)
            last = now

    # Words.

    def _head(self, remarks: Sequence[str]) -> str:
        viewed = self.viewed
        what = "values of the description (CAD)" if viewed.result is None else f"identified: {viewed.result.name}"
        parts = [f"<b>{escape(self.robot.name)}</b><br>{escape(what)}"]
        if self.motion is not None:
            parts.append(f"Motion: {escape(self.motion.name)}, {self.motion.duration:.4g} s")
        if viewed.known:
            keys = [
                f'<span style="margin-right:.8em"><span style="color:rgb{BASIS_COLORS[basis]}">■</span> {basis}</span>'
                for basis in ("measured", "bounded", "assumed")
            ]
            parts.append("".join(keys))
        if any(body is not None for body in viewed.bodies(viewed.described)):
            parts.append("Wire: the description (CAD)." if viewed.identified is not None else "Wire: inertia in CAD.")
        shown = list(dict.fromkeys((*viewed.remarks, *remarks)))
        if shown:
            listed = "".join(f"<li>{escape(remark)}</li>" for remark in shown[:8])
            more = f"<li>and {len(shown) - 8} more, on the terminal</li>" if len(shown) > 8 else ""
            parts.append(
                f"<details><summary>{len(shown)} remark{'s' * (len(shown) > 1)}</summary>"
                f'<ul style="padding-left:1.2em;overflow-wrap:anywhere">{listed}{more}</ul></details>'
            )
        return f'<div style="padding:0 .8em;font-size:.85em;line-height:1.5">{"<br>".join(parts)}</div>'

    def _link_table(self) -> str:
        rows = []
        for known in self.viewed.known:
            mass = known.mass
            span = "" if np.isnan(mass.lower) else f"{number(mass.lower, 3)} to {number(mass.upper, 3)}"
            cells = (known.name, number(mass.value, 3), span, number(mass.cad, 3), mass.rests_on)
            color = BASIS_COLORS[mass.basis]
            tags = "".join(f'<td style="padding:.1em .5em .1em 0">{escape(cell)}</td>' for cell in cells)
            rows.append(f'<tr style="border-left:4px solid rgb{color}">{tags}</tr>')
        heads = "".join(f'<th style="text-align:left">{head}</th>' for head in ("link", "kg", "95 %", "CAD", ""))
        return (
            '<div style="padding:0 .8em;font-size:.78em;overflow-x:auto"><table style="border-collapse:collapse">'
            f"<tr>{heads}</tr>{''.join(rows)}</table></div>"
        )


def require_free(host: str, port: int) -> None:
    """Make sure that a server can listen there.

    Raises
    ------
    InputError
        If it cannot.
    """
    try:
        kind = socket.AF_INET6 if ":" in host else socket.AF_INET
        with socket.socket(kind, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"nothing can listen at {host}, port {port} ({reason}); give another --port, 0 for any that is free, or "
            "another --host."
        ) from None


def is_loopback(host: str) -> bool:
    """Tell whether an address reaches this machine alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def view_robot(
    viewed: ViewedRobot,
    motion: Playback | None = None,
    nearness: Nearness | None = None,
    *,
    remarks: Sequence[str] = (),
    host: str = "127.0.0.1",
    port: int = 8080,
    open_browser: bool = True,
    ready: Callable[[str], None] | None = None,
) -> None:
    """Serve a robot to a browser until Ctrl-C.

    Parameters
    ----------
    nearness : Nearness, optional
        Pairs of links that are watched.
    remarks : sequence of str
        Shown in the page.
    host : str
        Address at which the server listens; by default it is reached from this machine alone.
    port : int
        0 for any that is free.
    ready : callable, optional
        Called with the address of the page once it is served.

    Raises
    ------
    InputError
        If nothing can listen at the address.
    MissingExtraError
        If viser is not installed (extra ``view``).
    """
    viser = require_package("viser", "The 3D view needs the package", "view")
    if not 0 <= port <= 65535:
        raise InputError(f"a port is a number from 0 to 65535, got {port}.")
    require_free(host, port)
    # Browsers open connections that they do not use; each would print a traceback of the server's library.
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    with _PRINTING_NOTHING:  # a frame with the address, which `ready` is told
        server = viser.ViserServer(host=host, port=port, label="steelyard view", verbose=False)
    try:
        viewer = Viewer(viewed, server, motion, nearness, remarks)
        shown = f"[{host}]" if ":" in host else "127.0.0.1" if host == "0.0.0.0" else host
        address = f"http://{shown}:{server.get_port()}"
        if ready is not None:
            ready(address)
        if open_browser:
            webbrowser.open(address)
        with contextlib.suppress(KeyboardInterrupt):
            viewer.run()
    finally:
        with _PRINTING_NOTHING:  # viser says that it stopped, which the user knows
            server.stop()
