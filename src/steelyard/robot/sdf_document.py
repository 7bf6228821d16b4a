"""The models of an SDF file as links and joints: frames are resolved, nested and included models are taken in."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import suggestion

from .described_tree import ONE_DOF, DescribedJoint, DescribedLink, DescribedMimic, DescribedTree, with_extension
from .inertia import Inertia, inertia_tensor
from .placement import inverse, quaternion_rotation, rpy_rotation, snapped
from .references import find_reference
from .xml_document import SHORTEST_AXIS, XmlReader, line_of, parse_xml

if TYPE_CHECKING:
    from lxml import etree

__all__ = ["WORLD", "SdfFrame", "SdfReader"]

Matrix = NDArray[np.float64]

WORLD = "world"
OLDEST, NEWEST = (1, 4), (1, 12)
ENDLESS = 1e16
"""The limit that the format writes where there is none; a speed or effort of -1 means the same."""

MOST_INCLUDES = 200
"""Files that include each other twice would be exponentially many."""
LARGEST_INCLUDES = 10_000_000
"""Bytes of all included files together, each as often as it is included; they take 2.5 s and 600 MB."""

TENSOR = {"ixx": 1.0, "ixy": 0.0, "ixz": 0.0, "iyy": 1.0, "iyz": 0.0, "izz": 1.0}
"""What the format gives to elements that are not written; the mass is 1 kg."""


class SdfFrame:
    """A frame with a name: of a link, a joint, a model, the world, or a `<frame>`."""

    def __init__(
        self, kind: str, name: str, scope: _Scope, element: etree._Element | None, raw: Matrix, relative: str | None
    ) -> None:
        self.kind, self.name, self.scope, self.element = kind, name, scope, element
        self.raw, self.relative = raw, relative
        self.inner: _Scope | None = None  # of a model
        self.placement_frame: str | None = None

    def base(self) -> SdfFrame | None:
        """The frame in which the placement is given; None of the world."""
        if self.kind == "world":
            return None
        if self.relative:
            return self.scope.find(self.relative, self.element)
        if self.kind == "joint":
            return self.scope.find(self.scope.reader.end(self.element, "child", self.name), self.element)
        attached = None if self.kind != "frame" or self.element is None else self.element.get("attached_to")
        return self.scope.find(attached, self.element) if attached else self.scope.origin

    def placement(self) -> Matrix:
        """Its placement (4, 4) in the frame of `base`."""
        if self.inner is None or not self.placement_frame:
            return self.raw
        held = self.inner.find(self.placement_frame, self.element)
        return self.raw @ inverse(self.scope.reader.between(self, held))

    def body(self, followed: tuple[SdfFrame, ...] = ()) -> SdfFrame:
        """The link to which it is fixed, or the world."""
        if self.kind in ("link", "world"):
            return self
        if self in followed:
            raise self.scope.reader.circle(followed[followed.index(self) :])
        followed = (*followed, self)
        if self.kind == "joint":
            return self.scope.find(self.scope.reader.end(self.element, "child", self.name), self.element).body(followed)
        if self.kind == "frame":
            attached = "" if self.element is None else self.element.get("attached_to", "")
            target = self.scope.find(attached, self.element) if attached else self.scope.origin
            return target.body(followed)
        assert self.inner is not None
        return self.inner.canonical(self.element).body(followed)


class _Scope:
    """The names within a model or the world."""

    def __init__(self, reader: SdfReader, prefix: str, outer: _Scope | None) -> None:
        self.reader, self.prefix, self.outer = reader, prefix, outer
        self.names: dict[str, SdfFrame] = {}
        self.first_link: SdfFrame | None = None
        self.element: etree._Element | None = None
        self.origin = SdfFrame("world", WORLD, self, None, np.eye(4), None)

    def find(self, name: str, element: etree._Element | None) -> SdfFrame:
        """Return what has a name; `element` is where it stands, for messages."""
        if name == "__model__":
            return self.origin
        if name in self.names:
            return self.names[name]
        head, separator, rest = name.partition("::")
        inner = self.names[head].inner if head in self.names else None
        if separator and inner is not None:
            return inner.find(rest, element)
        if name == WORLD:
            return self.reader.world
        raise self.reader.said(element, f'there is no link, joint or frame "{name}"; {suggestion(name, self.names)}')

    def is_within(self, model: SdfFrame) -> bool:
        """Return whether the names are those of a model, or of one in it."""
        return self.origin is model or (self.outer is not None and self.outer.is_within(model))

    def canonical(self, element: etree._Element | None) -> SdfFrame:
        """The link to which the frame of the model is fixed."""
        named = None if self.element is None else self.element.get("canonical_link")
        if named:
            return self.find(named, element)
        if self.first_link is not None:
            return self.first_link
        inner = next((one for one in self.names.values() if one.inner is not None), None)
        if inner is None:
            raise self.reader.said(element, "the model has no link; give a complete SDF")
        return inner


class SdfReader(XmlReader):
    """Reads the elements of an SDF.

    Attributes
    ----------
    remarks : list of str
        What the file holds that a robot does not.
    included : set of str
        Names of links and joints that stand in other files.
    gravity : tuple of float
        That of the world, or 9.81 m/s² against z where it is not written; after `tree` in the frame of the root link.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.remarks: list[str] = []
        self.included: set[str] = set()
        self.gravity: tuple[float, ...] = (0.0, 0.0, -9.81)
        self.world = _Scope(self, "", None).origin
        self.files = [path]
        self.origins: dict[etree._Element, Path] = {}
        self.include_count = self.include_size = 0
        self.version = NEWEST
        self.links: list[SdfFrame] = []
        self.joints: list[SdfFrame] = []

    # The file

    def tree(self) -> DescribedTree:
        """Read the robot of the file: its only model, or the only one with joints."""
        root = self._parsed(self.path)
        self.version = self._version(root)
        worlds = self.children(root, "world")
        if len(worlds) > 1:
            raise self.error(worlds[1], f"there are {len(worlds)} worlds; keep one")
        place = worlds[0] if worlds else root
        self._read_world(place)
        if self.children(place, "joint"):
            raise self.error(
                self.children(place, "joint")[0], "a joint of the world joins models; put them into one model"
            )
        scope = self.world.scope
        models = [one for one in scope.names.values() if one.kind == "model"]
        moving = [one for one in models if self._moves(one)]
        if len(moving) > 1:
            names = ", ".join(one.name for one in moving[:6])
            raise InputError(f"{self.path}: it describes {len(moving)} robots ({names}); keep one in the file")
        if not moving:
            raise InputError(
                f"{self.path}: it describes {'no model' if not models else 'no model with a joint that moves'}; "
                "give an SDF of a robot"
            )
        robot = moving[0]
        left = [one.name for one in models if one is not robot]
        if left:
            self.remarks.append(f"Of {self.path.name} the models {', '.join(left[:6])}, without joints, are left out.")
        self.links = [one for one in self.links if one.scope.is_within(robot)]
        self.joints = [one for one in self.joints if one.scope.is_within(robot)]
        return self._described(robot)

    def _parsed(self, path: Path) -> etree._Element:
        root = parse_xml(path, "an SDF")
        self.origins[root] = path
        return root

    def _version(self, root: etree._Element) -> tuple[int, int]:
        if self.tag(root) != "sdf":
            raise self.error(root, f"an SDF begins with <sdf>, found <{self.tag(root)}>; give an SDF file")
        text = root.get("version", "")
        parts = text.strip().split(".")
        version = tuple(int(part) for part in parts[:2]) if all(part.isdecimal() for part in parts) else ()
        if len(version) != 2 or not OLDEST <= version <= NEWEST:
            known = " to ".join(f"{major}.{minor}" for major, minor in (OLDEST, NEWEST))
            raise self.error(root, f'versions {known} of SDF can be read, got "{text[:40]}"; convert the file')
        return version

    def _read_world(self, element: etree._Element) -> None:
        if self.tag(element) == "world":
            gravity = self.only(element, "gravity", "the world")
            if gravity is not None:
                self.gravity = self.words(gravity, "the world", 3)
        scope = self.world.scope
        self._read_entities(scope, element)

    def _moves(self, model: SdfFrame) -> bool:
        within = [one for one in self.joints if one.scope.is_within(model)]
        return any(one.element is not None and one.element.get("type") != "fixed" for one in within)

    # Models

    def _read_model(
        self, outer: _Scope, element: etree._Element, include: etree._Element | None, merged: bool = False
    ) -> None:
        """Take in a `<model>`; `include` is the element that names its file, where there is one."""
        given = element if include is None else include
        written = None if include is None else self.only(include, "name", "an <include>")
        if written is None:
            name = self.text(element, "name", "a model")
        else:
            name = self.one_line(written, (written.text or "").strip(), "the name of a model")
        pose, relative = self.pose(element, f'model "{name}"')
        if include is not None and self.children(include, "pose"):
            pose, relative = self.pose(include, f'model "{name}"')
        frame = SdfFrame("model", outer.prefix + name, outer, given, pose, relative)
        held = self.only(given, "placement_frame", f'model "{name}"')
        frame.placement_frame = element.get("placement_frame") if held is None else (held.text or "").strip()
        inner = _Scope(self, outer.prefix if merged else f"{outer.prefix}{name}::", outer)
        if outer is self.world.scope:
            inner.prefix = ""  # names of links do not begin with that of the robot
        inner.origin, inner.element, frame.inner = frame, element, inner
        self._take(outer, name, frame)
        for source in (element, include):
            static = None if source is None else self.only(source, "static", f'model "{name}"')
            if static is not None and self.truth(static, f'model "{name}"'):
                self._read_entities(inner, element, static=True)
                return
        self._read_entities(inner, element)
        if merged:
            for key, one in inner.names.items():
                self._take(outer, key, one)

    def _read_entities(self, scope: _Scope, element: etree._Element, static: bool = False) -> None:
        for child in element:
            tag = self.tag(child)
            if tag == "model":
                self._read_model(scope, child, None)
            elif tag == "include":
                self._read_include(scope, child)
            elif tag in ("link", "joint", "frame") and (scope is not self.world.scope or tag == "frame"):
                name = self.text(child, "name", f"a {tag}")
                pose, relative = self.pose(child, f'{tag} "{name}"')
                frame = SdfFrame(tag, scope.prefix + name, scope, child, pose, relative)
                self._take(scope, name, frame)
                if tag == "link":
                    scope.first_link = scope.first_link or frame
                if len(self.files) > 1:
                    self.included.add(frame.name)
                if not static and tag != "frame":
                    (self.links if tag == "link" else self.joints).append(frame)

    def _take(self, scope: _Scope, name: str, frame: SdfFrame) -> None:
        other = scope.names.get(name)
        if other is None:
            scope.names[name] = frame
            return
        # Until version 1.6 a link and a joint could have one name, by which the link was meant.
        if self.version < (1, 7) and other.kind != frame.kind:
            if frame.kind == "link":
                scope.names[name] = frame
            return
        line = f" on line {line_of(other.element)}" if other.element is not None else ""
        raise self.said(
            frame.element, f'the name "{name}" was already given to a {other.kind}{line}; names must differ'
        )

    def _read_include(self, scope: _Scope, element: etree._Element) -> None:
        uri = self.only(element, "uri", "an <include>")
        text = "" if uri is None else (uri.text or "").strip()
        if not text:
            raise self.error(element, "an <include> has no <uri>; name the model")
        try:
            path = find_reference(text, self.files[-1], what="model", folder=True)
            path = self._model_file(path) if path.is_dir() else path
        except InputError as error:
            raise self.error(element, str(error)) from None
        self.include_count += 1
        if self.include_count > MOST_INCLUDES:
            raise self.error(element, f"more than {MOST_INCLUDES} files are included; keep one robot")
        known = [one.resolve() for one in self.files]
        if path.resolve() in known:
            way = " -> ".join(one.name for one in (*self.files, path))
            raise self.error(element, f"the file includes itself ({way}); remove the <include>")
        self.include_size += path.stat().st_size if path.is_file() else 0
        if self.include_size > LARGEST_INCLUDES:
            raise self.error(
                element, f"the files that are included have more than {LARGEST_INCLUDES / 1e6:.0f} MB; keep one robot"
            )
        before = self.version
        root = self._parsed(path)
        self.files.append(path)
        self.version = self._version(root)
        models = self.children(root, "model")
        if len(models) != 1:
            raise self.error(root, f"an included file holds one model, found {len(models)}; keep one")
        self._read_model(scope, models[0], element, merged=element.get("merge") in ("1", "true"))
        self.files.pop()
        self.version = before

    def _model_file(self, folder: Path) -> Path:
        """Return the newest SDF that the model.config of a folder names."""
        config = folder / "model.config"
        if not config.is_file():
            raise InputError(f"{folder}: it has no model.config, which names the file of a model; name the file")
        found = []
        for one in parse_xml(config, "a model.config").iterfind(".//sdf"):
            parts = one.get("version", "0.0").split(".")
            number = tuple(int(part) if part.isdecimal() else 0 for part in parts)
            found.append((number, (one.text or "").strip()))
        fitting = [pair for pair in found if pair[0] <= NEWEST] or found
        if not fitting:
            raise InputError(f"{config}: it names no <sdf>; add one")
        return find_reference(max(fitting)[1], config, what="model")

    # Frames

    def chain(self, frame: SdfFrame) -> list[SdfFrame]:
        """The frames from this one to the world, each placed in the next."""
        found = {frame: None}
        while (base := next(reversed(found)).base()) is not None:
            if base in found:
                way = list(found)
                raise self.circle(way[way.index(base) :])
            found[base] = None
        return list(found)

    def circle(self, frames: Iterable[SdfFrame]) -> InputError:
        """Return an error that names frames which are placed relative to each other in a circle."""
        names = [one.name for one in frames]
        return self.said(
            None, f"the frames {' -> '.join([*names[:6], names[0]])} are placed in each other; place one in the model"
        )

    def between(self, first: SdfFrame, second: SdfFrame) -> Matrix:
        """Return the placement (4, 4) of the second frame in the first, without what both share."""
        ways = [self.chain(first), self.chain(second)]
        other = set(ways[1])
        common = next(one for one in ways[0] if one in other)
        placements = []
        for way in ways:
            placement = np.eye(4)
            for one in reversed(way[: way.index(common)]):
                placement = placement @ one.placement()
            placements.append(placement)
        # Placements relative to one model differ from those relative to the parent link by rounding, which must not
        # stay: the expression graph folds what is exactly 0 or ±1.
        return snapped(inverse(placements[0]) @ placements[1])

    # Links and joints

    def _described(self, robot: SdfFrame) -> DescribedTree:
        joints = {frame.name: self._joint(frame) for frame in self.joints}
        if robot.inner is not None and robot.inner.element is not None:
            joints = with_extension(joints, self.of_drives(robot.inner.element))
        links = {frame.name: self._link(frame) for frame in self.links}
        if WORLD not in links and any(joint.parent == WORLD for joint in joints.values()):
            links = {WORLD: DescribedLink(WORLD, 0, None), **links}
        self.gravity = self._gravity_in(robot, joints)
        return DescribedTree(
            str(self.path), robot.name, links, joints, self.path, unwritten_is_massless=False,
            remarks=tuple(self.remarks),
        )  # fmt: skip

    def _gravity_in(self, robot: SdfFrame, joints: dict[str, DescribedJoint]) -> tuple[float, ...]:
        """The gravity of the world in the frame of the root link."""
        ends = {joint.child for joint in joints.values()}
        placement = np.eye(4)
        if not any(joint.parent == WORLD for joint in joints.values()) or any(one.name == WORLD for one in self.links):
            placement = self.between(self.world, next((one for one in self.links if one.name not in ends), robot))
        return tuple((placement[:3, :3].T @ np.array(self.gravity) + 0.0).tolist())

    def _link(self, frame: SdfFrame) -> DescribedLink:
        element, owner = frame.element, f'link "{frame.name}"'
        assert element is not None
        inertial = self.only(element, "inertial", owner)
        if inertial is None:
            inertia: Inertia | None = Inertia.from_com(1.0, np.zeros(3), np.eye(3))  # which the format gives it
        elif inertial.get("auto") in ("1", "true"):
            self.remarks.append(
                f"The inertial of {frame.name} is to follow from its shape (auto); it counts as unknown."
            )
            inertia = None
        else:
            inertia = self._inertial(inertial, owner)
        return DescribedLink(frame.name, line_of(element), inertia)

    def _inertial(self, element: etree._Element, owner: str) -> Inertia:
        mass = self.value(element, "mass", owner, 1.0)
        tensor = self.only(element, "inertia", owner)
        elements = [
            default if tensor is None else self.value(tensor, key, owner, default) for key, default in TENSOR.items()
        ]
        placement, _ = self.pose(element, f"{owner}, <inertial>")
        return Inertia.from_inertial_frame(mass, placement, inertia_tensor(elements))

    def _joint(self, frame: SdfFrame) -> DescribedJoint:
        element, owner = frame.element, f'joint "{frame.name}"'
        assert element is not None
        kind = self.text(element, "type", owner)
        parent, child = (frame.scope.find(self.end(element, tag, frame.name), element) for tag in ("parent", "child"))
        above, below = parent.body(), child.body()
        if below.kind == "world":
            raise self.error(element, f"{owner}: the world cannot be its child; exchange parent and child")
        origin = self.between(above, frame)
        placed = self.between(frame, below)
        name, line = frame.name, line_of(element)
        if kind not in ONE_DOF:
            return DescribedJoint(name, line, kind, above.name, below.name, origin, child_placement=placed)
        axis_element = self.only(element, "axis", owner)
        if axis_element is None:
            raise self.error(element, f"{owner} has no <axis>; add one")
        axis = self._axis(frame, axis_element, owner)
        limit, dynamics = (self.only(axis_element, tag, owner) for tag in ("limit", "dynamics"))
        lower, upper = -math.inf, math.inf
        if limit is not None and kind != "continuous":
            lower = self._bound(limit, "lower", owner, -math.inf)
            upper = self._bound(limit, "upper", owner, math.inf)
        if lower > upper:
            raise self.error(
                element, f"{owner}: its lower limit {lower:g} is above its upper limit {upper:g}; exchange them"
            )
        velocity, effort = (
            math.inf if limit is None else self._most(limit, key, owner) for key in ("velocity", "effort")
        )
        damping, friction, stiffness = (
            math.nan if dynamics is None else self.value(dynamics, key, owner, math.nan)
            for key in ("damping", "friction", "spring_stiffness")
        )
        if stiffness > 0.0:
            self.remarks.append(
                f"The joint {name} has a spring of {stiffness:g} N m/rad or N/m in the description, which the model "
                "does not have."
            )
        mimic = self._mimic(frame, axis_element, owner)
        return DescribedJoint(
            name, line, kind, above.name, below.name, origin, axis, placed, mimic,
            lower, upper, velocity, effort, damping, friction, has_spring=stiffness > 0.0,
        )  # fmt: skip

    def _axis(self, frame: SdfFrame, element: etree._Element, owner: str) -> tuple[float, ...]:
        """The axis in the frame of the joint."""
        xyz = self.only(element, "xyz", owner)
        axis = (0.0, 0.0, 1.0) if xyz is None else self.words(xyz, owner, 3)
        if math.hypot(*axis) < SHORTEST_AXIS:
            given = " ".join(f"{value:g}" for value in axis)
            raise self.error(element, f'{owner}: its axis is "{given}"; give the direction of the motion')
        named = None if xyz is None else xyz.get("expressed_in")
        flag = self.only(element, "use_parent_model_frame", owner)
        if named:
            within = frame.scope.find(named, element)
        elif self.version < (1, 5) or (flag is not None and self.truth(flag, owner)):
            within = frame.scope.origin
        else:
            return axis
        turned = self.between(frame, within)[:3, :3] @ np.array(axis)
        return tuple((turned + 0.0).tolist())

    def _bound(self, limit: etree._Element, key: str, owner: str, default: float) -> float:
        value = self.value(limit, key, owner, default, infinite=True)
        return value if abs(value) < ENDLESS else math.copysign(math.inf, value)

    def _most(self, limit: etree._Element, key: str, owner: str) -> float:
        value = self.value(limit, key, owner, math.inf, infinite=True)
        return math.inf if value < 0.0 or value >= ENDLESS else value

    def _mimic(self, frame: SdfFrame, element: etree._Element, owner: str) -> DescribedMimic | None:
        mimic = self.only(element, "mimic", owner)
        if mimic is None:
            return None
        if mimic.get("axis", "axis") != "axis":
            raise self.error(mimic, f"{owner}: it mimics the second axis of a joint, which no joint that is read has")
        multiplier, offset, reference = (
            self.value(mimic, key, owner, default)
            for key, default in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
        )
        leader = frame.scope.find(self.text(mimic, "joint", f"{owner}, <mimic>"), mimic)
        return DescribedMimic(leader.name, multiplier, offset - multiplier * reference)

    # Elements

    def end(self, element: etree._Element | None, tag: str, joint: str) -> str:
        """The name that the `<parent>` or `<child>` of a joint holds."""
        assert element is not None
        found = self.only(element, tag, f'joint "{joint}"')
        text = "" if found is None else (found.text or "").strip()
        if not text:
            raise self.said(element, f'joint "{joint}" has no <{tag}>; add one with the name of a link')
        return self.one_line(element, text, f'the <{tag}> of joint "{joint}"')

    def pose(self, element: etree._Element, owner: str) -> tuple[Matrix, str | None]:
        """Read the `<pose>` of an element: the placement (4, 4), and the name of the frame in which it is."""
        pose = self.only(element, "pose", owner)
        if pose is None:
            return np.eye(4), None
        if pose.get("frame"):
            raise self.error(
                pose,
                f"{owner}: its pose is in the frame {pose.get('frame')!r} in the manner of version 1.6, which no "
                "simulator reads; write relative_to and version 1.7",
            )
        relative = pose.get("relative_to") or None
        if not (pose.text or "").split():
            return np.eye(4), relative
        form = pose.get("rotation_format", "euler_rpy")
        if form == "quat_xyzw":
            *shift, x, y, z, w = self.words(pose, owner, 7)
            norm = math.sqrt(x * x + y * y + z * z + w * w)
            if norm < SHORTEST_AXIS:
                raise self.error(pose, f"{owner}: the quaternion of its pose is zero; give a rotation")
            placement = np.eye(4)
            placement[:3, :3] = quaternion_rotation(w / norm, x / norm, y / norm, z / norm)
        elif form == "euler_rpy":
            *shift, roll, pitch, yaw = self.words(pose, owner, 6)
            unit = math.pi / 180.0 if pose.get("degrees") in ("1", "true") else 1.0
            placement = rpy_rotation(roll * unit, pitch * unit, yaw * unit)
        else:
            raise self.error(pose, f"{owner}: rotation_format must be euler_rpy or quat_xyzw, got {form!r}")
        placement[:3, 3] = shift
        return placement, relative

    def words(self, element: etree._Element, owner: str, count: int) -> tuple[float, ...]:
        """Return the text of an element as finite numbers, so many."""
        return self.numbers(element, "the text", element.text or "", owner, count)

    def value(self, element: etree._Element, key: str, owner: str, default: float, infinite: bool = False) -> float:
        """Return the text of a child as a number; the default where it is absent or empty."""
        child = self.only(element, key, owner)
        if child is None or not (child.text or "").strip():
            return default
        return self.numbers(child, "the text", child.text or "", owner, 1, infinite)[0]

    def truth(self, element: etree._Element, owner: str) -> bool:
        """Return the text of an element as true or false."""
        text = (element.text or "").strip().lower()
        if text not in ("1", "true", "0", "false", ""):
            raise self.error(element, f"{owner}: <{self.tag(element)}> must be true or false, got {text[:40]!r}")
        return text in ("1", "true")

    def said(self, element: etree._Element | None, message: str) -> InputError:
        """Return an error that names the file, and the line where it is known."""
        return InputError(f"{self.path}: {message}") if element is None else self.error(element, message)

    def file(self, element: etree._Element) -> Path:
        """Return the file that holds an element, which may be an included one."""
        return self.origins.get(element.getroottree().getroot(), self.path)

    def error(self, element: etree._Element, message: str) -> InputError:
        """Return an error that names the file, which may be an included one, and the line."""
        return InputError(f"{self.file(element)}, line {line_of(element)}: {message}")
