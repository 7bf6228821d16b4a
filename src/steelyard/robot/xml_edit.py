"""Editing an XML file without touching what is not edited: every byte outside the edits stays as it was."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self, TypeVar
from xml.parsers import expat

from steelyard.errors import InputError

from .xml_document import with_known_version

__all__ = ["XmlEdit", "XmlElement", "attribute_text", "in_order", "number_text", "tag_text"]

# A start tag: quoted values may hold ">".
START_TAG = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""")
ATTRIBUTE = re.compile(rb"""([^\s=/>"'<]+)\s*=\s*("[^"]*"|'[^']*')""")
_MARKS = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&apos;"})


class _Parent(Protocol):
    @property
    def children(self) -> Sequence[Self]: ...


Element = TypeVar("Element", bound=_Parent)


def in_order(root: Element) -> Iterator[Element]:
    """Yield an element and everything in it, in the order of the document; elements may be nested to any depth."""
    waiting = [root]
    while waiting:
        element = waiting.pop()
        yield element
        waiting += reversed(element.children)


@dataclass(eq=False)
class XmlElement:
    """An element, and where it stands in the bytes of the file."""

    tag: str
    attributes: dict[str, str]
    start: int
    start_tag_end: int
    empty: bool
    end: int = -1
    children: list[XmlElement] = field(default_factory=list)

    def find(self, tag: str) -> XmlElement | None:
        """The first child of this tag."""
        return next(self.all(tag), None)

    def all(self, tag: str) -> Iterator[XmlElement]:
        """The children of this tag, in order."""
        return (child for child in self.children if child.tag == tag)

    def iterate(self) -> Iterator[XmlElement]:
        """The element and everything in it, in order."""
        return in_order(self)


class XmlEdit:
    """The bytes of an XML file, its elements, and the edits to make.

    Parameters
    ----------
    data : bytes
        The file; in an encoding that extends ASCII.
    path : Path
        Its name, for messages.

    Raises
    ------
    InputError
        When the file is not well-formed, or in UTF-16 or UTF-32.

    Examples
    --------
    >>> edit = XmlEdit(b'<a  x = "1"><!-- kept --><b/></a>', Path("a.xml"))
    >>> edit.set_attributes(edit.root, {"x": "2", "y": "3"})
    >>> edit.insert_last(edit.root, "<c/>")
    >>> edit.result()
    b'<a  x = "2" y="3"><!-- kept --><b/><c/></a>'
    """

    def __init__(self, data: bytes, path: Path) -> None:
        self.data = data
        self.newline = "\r\n" if b"\r\n" in data else "\n"
        self._edits: list[tuple[int, int, bytes]] = []
        self._line_ends = [match.start() for match in re.finditer(b"\n", data)]
        if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:4]:
            raise InputError(f"{path}: UTF-16 and UTF-32 files cannot be edited in place; save the file as UTF-8")
        stack: list[XmlElement] = []
        roots: list[XmlElement] = []
        parser = expat.ParserCreate()

        def begin(tag: str, attributes: dict[str, str]) -> None:
            start = parser.CurrentByteIndex
            match = START_TAG.match(data, start)
            if match is None:
                raise InputError(f"{path}: cannot find the element <{tag}> at byte {start}; save the file as UTF-8")
            element = XmlElement(tag, attributes, start, match.end(), match[0].endswith(b"/>"))
            (stack[-1].children if stack else roots).append(element)
            stack.append(element)

        def finish(_tag: str) -> None:
            element = stack.pop()
            element.end = element.start_tag_end if element.empty else data.index(b">", parser.CurrentByteIndex) + 1

        def refuse(*_: object) -> None:
            # None of the formats needs one, and entities are ways to harm whoever opens the file.
            raise InputError(f"{path}: it has a DOCTYPE declaration, which a description does not need; remove it")

        parser.StartElementHandler = begin
        parser.EndElementHandler = finish
        parser.StartDoctypeDeclHandler = refuse
        try:
            parser.Parse(with_known_version(data), True)
        except (expat.ExpatError, ValueError, LookupError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{path}: cannot be read as XML ({error}); mend the file and save it as UTF-8") from None
        self.root = roots[0]

    @property
    def edited(self) -> bool:
        """Whether there is an edit."""
        return bool(self._edits)

    def line(self, element: XmlElement) -> int:
        """The line on which an element begins, from 1."""
        return bisect_left(self._line_ends, element.start) + 1

    def set_attributes(self, element: XmlElement, values: Mapping[str, str]) -> None:
        """Give attributes these (ASCII) values; new ones come after the old ones."""
        missing = dict(values)
        last = element.start_tag_end - (2 if element.empty else 1)
        for match in ATTRIBUTE.finditer(self.data, element.start, element.start_tag_end):
            value = missing.pop(match[1].decode("ascii", "replace"), None)
            if value is not None:
                self._edits.append((match.start(2) + 1, match.end(2) - 1, value.encode("ascii", "xmlcharrefreplace")))
        if missing:
            while self.data[last - 1 : last].isspace():
                last -= 1
            text = "".join(f' {key}="{value}"' for key, value in missing.items())
            self._edits.append((last, last, text.encode("ascii", "xmlcharrefreplace")))

    def remove_attributes(self, element: XmlElement, names: Collection[str]) -> None:
        """Take out attributes, with the white space before them; those that are not there are passed over."""
        for match in ATTRIBUTE.finditer(self.data, element.start, element.start_tag_end):
            if match[1].decode("ascii", "replace") in names:
                start = match.start()
                while self.data[start - 1 : start].isspace():
                    start -= 1
                self._edits.append((start, match.end(), b""))

    def replace(self, element: XmlElement, text: bytes) -> None:
        """Put other bytes in the place of an element."""
        self._edits.append((element.start, element.end, text))

    def take(self, element: XmlElement) -> bytes:
        """Take an element out, and return it as it is after the edits in it."""
        inside = [edit for edit in self._edits if edit[1] > element.start and edit[0] < element.end]
        outside = [edit for edit in self._edits if edit not in inside]
        self._edits = inside
        text = self._edited(element.start, element.end)
        self._edits = outside
        self.remove(element)
        return text

    def insert_at_start(self, parent: XmlElement, text: str) -> None:
        """Put a text after the start tag of an element that is not empty, before what else is put there."""
        self._edits.insert(0, (parent.start_tag_end, parent.start_tag_end, text.encode("ascii", "xmlcharrefreplace")))

    def insert_at_end(self, parent: XmlElement, text: str) -> None:
        """Put a text before the end tag of an element that is not empty."""
        place = self._closing(parent)
        self._edits.append((place, place, text.encode("ascii", "xmlcharrefreplace")))

    def text(self, element: XmlElement) -> str:
        """The text of an element without children, as it stands in the file; white space around it is left out."""
        if element.empty:
            return ""
        return self.data[element.start_tag_end : self._closing(element)].decode("utf-8", "replace").strip()

    def set_text(self, element: XmlElement, text: str) -> None:
        """Give an element without children another text; white space around the old one stays."""
        if element.empty:
            start_tag = self.data[element.start : element.start_tag_end - 2].rstrip()
            place = element.start + len(start_tag), element.end
            self._edits.append((*place, f">{text}</{element.tag}>".encode("ascii", "xmlcharrefreplace")))
            return
        begin, end = element.start_tag_end, self._closing(element)
        old = self.data[begin:end]
        begin += len(old) - len(old.lstrip())
        end -= len(old) - len(old.rstrip()) if old.strip() else 0
        self._edits.append((min(begin, end), end, text.encode("ascii", "xmlcharrefreplace")))

    def _closing(self, element: XmlElement) -> int:
        """Return where the end tag of an element begins."""
        return self.data.rindex(b"</", element.start_tag_end, element.end)

    def remove(self, element: XmlElement) -> None:
        """Take an element out, with the line break and indentation before it."""
        start = element.start
        indentation = self._line_start(start)
        if indentation is not None and indentation > 0:
            start = indentation - (2 if self.data[indentation - 2 : indentation] == b"\r\n" else 1)
        self._edits.append((start, element.end, b""))

    def insert_first(self, parent: XmlElement, *lines: str) -> None:
        """Put a new element, given by its (ASCII) lines, before the other children."""
        self._insert(parent, parent.start_tag_end, lines)

    def insert_last(self, parent: XmlElement, *lines: str) -> None:
        """Put a new element, given by its (ASCII) lines, after the other children."""
        self._insert(parent, parent.children[-1].end if parent.children else parent.start_tag_end, lines)

    def _insert(self, parent: XmlElement, place: int, lines: tuple[str, ...]) -> None:
        own = self._line_start(parent.start)
        first = self._line_start(parent.children[0].start) if parent.children else own
        if own is None or first is None:
            text = "".join(line.strip() for line in lines)
            closing = ""
        else:
            outer = self.data[own : parent.start].decode("ascii")
            inner = outer + "  "
            if parent.children:
                inner = self.data[first : parent.children[0].start].decode("ascii")
            text = "".join(f"{self.newline}{inner}{line}" for line in lines)
            closing = self.newline + outer
        if parent.empty:
            # <link name="x"/> is opened to hold the new element.
            start_tag = self.data[parent.start : parent.start_tag_end - 2].rstrip()
            begin = parent.start + len(start_tag)
            self._edits.append(
                (begin, parent.end, f">{text}{closing}</{parent.tag}>".encode("ascii", "xmlcharrefreplace"))
            )
            return
        if not parent.children and self.data[place : place + 2] == b"</":
            text += closing
        self._edits.append((place, place, text.encode("ascii", "xmlcharrefreplace")))

    def _line_start(self, position: int) -> int | None:
        """Return where the line of this position begins, if only white space stands before it; None otherwise."""
        begin = self.data.rfind(b"\n", 0, position) + 1
        return begin if not self.data[begin:position].strip() else None

    def result(self) -> bytes:
        """The bytes with all edits made."""
        return self._edited(0, len(self.data))

    def content(self) -> bytes:
        """Return what is inside the root element, with all edits made."""
        if self.root.empty:
            return b""
        return self._edited(self.root.start_tag_end, self._closing(self.root))

    def _edited(self, position: int, last: int) -> bytes:
        pieces = []
        for start, end, text in sorted(self._edits, key=lambda edit: edit[:2]):
            if position <= start and end <= last:
                pieces += [self.data[position:start], text]
                position = end
        return b"".join([*pieces, self.data[position:last]])


def number_text(value: float) -> str:
    """Return a number as it is written, so that it is read again as the same.

    Examples
    --------
    >>> number_text(0.1), number_text(-0.0)
    ('0.1', '0.0')
    """
    return repr(float(value) + 0.0)


def attribute_text(text: str) -> str:
    """Return a text as it stands between quotes of either kind."""
    return text.translate(_MARKS)


def tag_text(tag: str, values: Mapping[str, str]) -> str:
    """Return an element without content; the values are texts as they stand between quotes.

    Examples
    --------
    >>> tag_text("mass", {"value": number_text(2)})
    '<mass value="2.0"/>'
    """
    return f"<{tag}{''.join(f' {key}={chr(34)}{value}{chr(34)}' for key, value in values.items())}/>"
