"""What `mkdocs build` does besides: formulas become MathML, names in code become links, and names get their examples.

Formulas stand between dollar signs and are turned into MathML while the site is built, which browsers draw without a
script. Code such as ``sy.fit`` or ``FeasibleSet`` becomes a link to the entry of the reference.
"""

from __future__ import annotations

import html
import importlib
import inspect
import os
import re
import types
from functools import cache
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
PACKAGES = ("steelyard", "steelyard_thesis")
_ENTRY = re.compile(r"^::: (\S+)$", re.MULTILINE)
_PYTHON = re.compile(r"^```python[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
# Links and headings hold no further links, and blocks of code stay as they are.
_LINKABLE = re.compile(
    r"<pre.*?</pre>|<a\b.*?</a>|<h[1-6].*?</h[1-6]>|<autoref.*?</autoref>|<code>(?P<name>[A-Za-z_][\w.]*)(?P<call>\(\))?</code>",
    re.DOTALL,
)


@cache
def pages() -> dict[Path, str]:
    """Return the text of every page of the site, by its path."""
    return {path: path.read_text(encoding="utf-8") for path in sorted(DOCS.rglob("*.md"))}


@cache
def entries() -> dict[str, Path]:
    """Return the page of the reference on which each name is described, by the name with its package."""
    return {name: page for page, text in pages().items() for name in _ENTRY.findall(text)}


def described(name: str) -> Any:
    """Return the object that a name with its package means.

    Some functions have the name of the file that defines them, so that the object that is there comes before the file.
    """
    owner, _, last = name.rpartition(".")
    try:
        found = importlib.import_module(owner)
    except ModuleNotFoundError:  # a member of a class
        found = described(owner)
    return getattr(found, last) if hasattr(found, last) else importlib.import_module(name)


@cache
def public_names() -> dict[str, Any]:
    """Return every public object of the rooms, by the first name with which it can be imported from one.

    The command line has no names for others, and `files` none that are described.
    """
    found: dict[str, Any] = {}
    seen: set[int] = set()
    rooms = sorted(p.parent.name for p in (ROOT / "src" / "steelyard").glob("*/__init__.py"))
    for room in [*(room for room in rooms if room not in ("cli", "files")), "extensions", "errors"]:
        module = importlib.import_module(f"steelyard.{room}")
        for name in module.__all__:
            value = getattr(module, name)
            key = id(value)
            if not isinstance(value, types.ModuleType) and key not in seen:
                seen.add(key)
                found[f"steelyard.{room}.{name}"] = value
    return found


def own_example(value: Any) -> bool:
    """Whether the docstring of an object, or of one of its methods, has an example."""
    methods = vars(value).values() if inspect.isclass(value) else ()
    texts = [inspect.getdoc(one) or "" for one in (value, *methods)]
    return any(">>>" in text for text in texts)


@cache
def _words_of_pages() -> dict[Path, frozenset[str]]:
    """Return the words in the blocks of Python of each page."""
    return {page: frozenset(re.findall(r"\w+", "\n".join(_PYTHON.findall(text)))) for page, text in pages().items()}


@cache
def _words_of(name: str) -> tuple[frozenset[str], frozenset[str]]:
    """Return the words in the examples of a described object, and those in the types that it takes, returns and is."""
    value = described(name)
    members = [value, *(vars(value).values() if inspect.isclass(value) else ())]
    lines = [line for one in members for line in (inspect.getdoc(one) or "").splitlines()]
    example = "\n".join(line for line in lines if line.startswith((">>>", "...")))
    types = [base.__name__ for base in getattr(value, "__mro__", ())]
    for one in members:
        function = one.fget if isinstance(one, property) else getattr(one, "__func__", one)
        types += [str(annotation) for annotation in getattr(function, "__annotations__", {}).values()]
    return frozenset(re.findall(r"\w+", example)), frozenset(re.findall(r"\w+", " ".join(types)))


@cache
def _shown() -> dict[str, int]:
    """Return the described objects that are seen in use, and over how many others.

    0: in an example of its own or on a page; 1: by an object of the level 0, and so on.
    """
    left = set(entries())
    found = {name: 0 for name in left if own_example(described(name)) or _pages_with(name)}
    level = 0
    while True:
        left -= found.keys()
        seen = [name for name, at in found.items() if at == level]
        words = frozenset().union(*(_words_of(name)[0] | _words_of(name)[1] for name in seen))
        more = {name for name in left if name.rpartition(".")[2] in words}
        if not more:
            return found
        level += 1
        found |= dict.fromkeys(more, level)


def _pages_with(name: str) -> list[Path]:
    return [page for page, words in _words_of_pages().items() if name.rpartition(".")[2] in words]


def uses(name: str) -> tuple[list[Path], list[str]]:
    """Return the pages whose Python uses an object, and the described objects that are nearer to an example and use it.

    An object uses another one where its example names it, where it takes or returns it, holds it as an attribute, or
    is a subclass of it.
    """
    short, shown = name.rpartition(".")[2], _shown()
    level = shown.get(name, 0)
    others = [
        other
        for other in sorted(shown, key=lambda other: (shown[other], other))
        if other != name and shown[other] < max(level, 1) and short in _words_of(other)[0] | _words_of(other)[1]
    ]
    return _pages_with(name), others


def on_startup(**_: Any) -> None:
    """Let attributes that are computed once be described as attributes, as those of `functools` are."""
    import griffe

    griffe.stdlib_decorators["steelyard.once.cached_property"] = {"cached", "property"}


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Add to the entries without an example of their own where they are used."""

    def extended(found: re.Match[str]) -> str:
        name = found[1]
        if not name.startswith("steelyard.") or own_example(described(name)):
            return found[0]
        shown, others = uses(name)
        here = DOCS / page.file.src_path
        links = [f"[{_title(path)}]({os.path.relpath(path, here.parent)})" for path in shown if path != here]
        links += [f"[`{other.rpartition('.')[2]}`][{other}]" for other in others]
        return f"{found[0]}\n\nIn use: {', '.join(links[:4])}." if links else found[0]

    return _ENTRY.sub(extended, markdown)


def _title(path: Path) -> str:
    return pages()[path].splitlines()[0].removeprefix("# ")


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """Turn formulas into MathML, and names in code into links."""
    return _LINKABLE.sub(_linked, _FORMULA.sub(_typeset, content))


def _typeset(found: re.Match[str]) -> str:
    from latex2mathml.converter import convert

    return str(convert(html.unescape(found[2]).strip(), display="block" if found[1] == "div" else "inline"))


@cache
def _by_short_name() -> dict[str, str]:
    """Return the full name of what a name means that no two entries share."""
    full: dict[str, set[str]] = {}
    for name in entries():
        full.setdefault(name.rpartition(".")[2], set()).add(name)
    return {short: names.pop() for short, names in full.items() if len(names) == 1}


def _linked(found: re.Match[str]) -> str:
    name = found["name"]
    if name is None:
        return found[0]
    prefixed = name.startswith(("sy.", "steelyard."))
    short, _, member = re.sub(r"^(sy|steelyard)\.([a-z_]+\.(?=[A-Za-z]))?", "", name).partition(".")
    target = _by_short_name().get(short)
    # A plain word may mean a command or an option of the same name.
    plain = short.islower() and "_" not in short
    if target is None or (plain and not (prefixed or found["call"])):
        return found[0]
    if not member:
        return f'<autoref identifier="{target}">{found[0]}</autoref>'
    return f'<autoref identifier="{target}.{member}" optional>{found[0]}</autoref>'
