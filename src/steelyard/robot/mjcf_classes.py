"""The default classes of an MJCF: what elements say with what their classes say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from steelyard.errors import InputError
from steelyard.files import suggestion

from .mjcf_document import JOINTS, MjcfDocument, MjcfElement

__all__ = ["ACTUATORS", "MAIN", "ORIENTATIONS", "DefaultClasses"]

MAIN = "main"
"""The class of what has none."""

ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
"""Attributes of orientations; the one of an element takes the place of that of its class."""

LISTS = frozenset(("size", "gear", "gainprm", "biasprm", "polycoef", "damping", "stiffness"))
"""Attributes that may hold fewer numbers than there are; the others are then those of the class."""

ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder")
"""Kinds of actuators that are one kind with other gains; their defaults are shared."""

Attributes = Mapping[str, str]


class DefaultClasses:
    """The classes of a description, each with what it has from the classes around it.

    Raises
    ------
    InputError
        If a class has no name, or one has a name for a second time.
    """

    def __init__(self, document: MjcfDocument) -> None:
        self.settings: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}
        self._parents: dict[str, str | None] = {MAIN: None}
        self._elements: dict[str, list[MjcfElement]] = {MAIN: []}
        for section in document.root.all("default"):
            # Older versions of MuJoCo let the outermost class have another name.
            name = section.attributes.get("class") or MAIN
            self.settings[name], self._parents[name] = self.settings[MAIN], None
            self._elements[name] = self._elements[MAIN]
            self._collect(section, name)

    def _collect(self, section: MjcfElement, name: str) -> None:
        settings = self.settings[name]
        self._elements[name].append(section)
        # A class within another one takes what that says also after it.
        for element in section.children:
            if element.tag != "default":
                self._set(settings, element)
        for inner in section.all("default"):
            label = inner.attributes.get("class")
            if not label:
                raise InputError(f"{inner.where}: a <default> within another one has no class; name it")
            if label in self.settings:
                raise InputError(f'{inner.where}: the default class "{label}" was already there; names must differ')
            self.settings[label] = {tag: dict(values) for tag, values in settings.items()}
            self._parents[label], self._elements[label] = name, []
            self._collect(inner, label)

    def _set(self, settings: dict[str, dict[str, str]], element: MjcfElement) -> None:
        if element.tag in ACTUATORS:
            settings["actuator"] = actuator_settings(element.tag, element.attributes, settings.get("actuator", {}))
        else:
            settings[element.tag] = merged(settings.get(element.tag, {}), element.attributes)

    def attributes(self, element: MjcfElement, inherited: str = MAIN, tag: str | None = None) -> dict[str, str]:
        """Return the attributes of an element with those of its class.

        Parameters
        ----------
        inherited : str
            The ``childclass`` of the body or frame around it.
        tag : str, optional
            Under which the classes have them; by default the tag of the element.

        Raises
        ------
        InputError
            If there is no such class.
        """
        of_class = self.settings[self.name(element, inherited)]
        if element.tag in ACTUATORS and tag is None:
            return actuator_settings(element.tag, element.attributes, of_class.get("actuator", {}))
        return merged(of_class.get(tag or element.tag, {}), element.attributes)

    def name(self, element: MjcfElement, inherited: str = MAIN, key: str = "class") -> str:
        """Return the class of an element; `key` is ``childclass`` for the one of what is in a body or frame."""
        name = element.attributes.get(key) or inherited
        if name not in self.settings:
            raise InputError(f'{element.where}: there is no default class "{name}"; {suggestion(name, self.settings)}')
        return name

    def holder(self, name: str, tag: str, key: str) -> tuple[str, MjcfElement] | None:
        """Return the class, this one or one around it, that sets an attribute, and the element with it."""
        current: str | None = name
        while current is not None:
            for section in reversed(self._elements[current]):
                found = [one for one in section.all(tag) if key in one.attributes]
                if found:
                    return current, found[-1]
            current = self._parents[current]
        return None

    def of_joints(self, document: MjcfDocument) -> Iterator[tuple[str, str]]:
        """Yield the names of the joints and their classes."""
        worlds = list(document.root.all("worldbody"))
        waiting = [(world, self.name(world, key="childclass")) for world in worlds]
        while waiting:
            element, inherited = waiting.pop()
            for child in element.children:
                if child.tag in JOINTS:
                    yield child.attributes.get("name", ""), self.name(child, inherited)
                elif child.tag in ("body", "frame"):
                    waiting.append((child, self.name(child, inherited, "childclass")))


def merged(base: Attributes, own: Attributes) -> dict[str, str]:
    """Return the attributes of a class with other ones over them.

    Examples
    --------
    >>> merged({"euler": "0 0 1", "size": "1 2 3"}, {"zaxis": "0 1 0", "size": "4"})
    {'size': '4 2 3', 'zaxis': '0 1 0'}
    """
    turned = any(key in own for key in ORIENTATIONS)
    found = {key: text for key, text in base.items() if not (turned and key in ORIENTATIONS)}
    for key, text in own.items():
        words = text.split()
        rest = base.get(key, "").split()[len(words) :] if key in LISTS else []
        found[key] = " ".join([*words, *rest]) if rest else text
    return found


def actuator_settings(tag: str, own: Attributes, base: Attributes) -> dict[str, str]:
    """Return the attributes of an actuator as one of the kind ``general``.

    Examples
    --------
    >>> actuator_settings("position", {"kp": "7", "joint": "elbow"}, {"gear": "2"})
    {'gear': '2', 'kp': '7', 'joint': 'elbow', 'kind': 'position', 'gainprm': '7', 'biasprm': '0 -7'}
    """
    found = {**merged(base, own), "kind": tag}
    # A gain of the class counts for actuators of the same kind.
    held = found.get("gainprm", "1").split()[0] if base.get("kind", "general") in ("general", tag) else "1"
    match tag:
        case "motor":
            found |= {"gainprm": "1", "biasprm": "0"}
        case "position" | "intvelocity":
            gain = own.get("kp", held)
            found |= {"gainprm": gain, "biasprm": f"0 {_negative(gain)}"}
        case "velocity":
            gain = own.get("kv", held)
            found |= {"gainprm": gain, "biasprm": f"0 0 {_negative(gain)}"}
        case "cylinder":
            found |= {"gainprm": own.get("area", held), "biasprm": "0"}
        case "damper":
            found |= {"gainprm": "0", "biasprm": "0"}
    return found


def _negative(text: str) -> str:
    return text.removeprefix("-") if text.startswith("-") else f"-{text}"
