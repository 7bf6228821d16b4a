"""The plan of the house: which room may import which, and what no file may be."""

import ast
import graphlib
import html
import importlib
import inspect
import itertools
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import steelyard as sy

PACKAGE = Path(__file__).resolve().parent.parent / "src" / "steelyard"
ROOMS = (
    "files",
    "robot",
    "conic",
    "lmi",
    "graph",
    "codegen",
    "dynamics",
    "recording",
    "regression",
    "collision",
    "feasibility",
    "estimators",
    "excitation",
    "simulation",
    "control",
    "identification",
    "online",
    "fleet",
    "report",
    "cli",
)
ANYWHERE = {
    "display",
    "errors",
    "extensions",
    "first_use",
    "once",
    "__version__",
}  # what every room may take from the package itself
EMPTY_NAMES = {"utils", "util", "helpers", "helper", "common", "misc", "manager", "managers"}
FILES = sorted(PACKAGE.rglob("*.py"))
ENTRY_POINT = PACKAGE / "__main__.py"  # runs when it is imported


def imports_in(nodes: Iterable[ast.AST], module: str, is_package: bool) -> Iterator[tuple[int, str]]:
    """Yield line and full name of everything that these parts of a module import."""
    package = module if is_package else module.rpartition(".")[0]
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")
            parent = ".".join(parts[: len(parts) - node.level + 1]) if node.level else ""
            origin = ".".join(part for part in (parent, node.module) if part)
            yield from ((node.lineno, f"{origin}.{alias.name}") for alias in node.names)


def needed_at_import(tree: ast.Module) -> Iterator[ast.stmt]:
    """Yield the statements that run when a file is imported: not those in functions, nor those for type checkers."""
    waiting = list(tree.body)
    while waiting:
        node = waiting.pop()
        yield node
        if isinstance(node, ast.If) and "TYPE_CHECKING" not in ast.unparse(node.test):
            waiting += [*node.body, *node.orelse]


def statements(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield all statements, those in others as well; expressions hold none, and are most of a file."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            waiting += getattr(node, part, ())


class Imports(NamedTuple):
    """Line and full name of what a module imports: anywhere, and at once when it is imported itself."""

    all: list[tuple[int, str]]
    at_once: list[tuple[int, str]]


@cache  # several tests look at every file
def imports_of(source: str, module: str, is_package: bool) -> Imports:
    tree = ast.parse(source)
    parts = (statements(tree), needed_at_import(tree))
    return Imports(*(list(imports_in(nodes, module, is_package)) for nodes in parts))


def violations(source: str, module: str, is_package: bool = False) -> list[str]:
    """Say which imports of a module break the order of the rooms."""
    inside = module.split(".")[1:]
    if inside in ([], ["__main__"]):
        return []  # the package itself may name every room
    found = []
    for line, name in imports_of(source, module, is_package).all:
        first, *rest = name.split(".")
        if first == "pickle":
            found.append(f"line {line}: pickle")
        if first == "steelyard_thesis":
            found.append(f"line {line}: the package beside this one")
        if first != "steelyard":
            continue
        target = rest[0] if rest else "the whole package"
        if target in ANYWHERE or target == inside[0] or (inside[0] in ANYWHERE and target == ROOMS[0]):
            continue
        if target not in ROOMS or inside[0] not in ROOMS or ROOMS.index(target) > ROOMS.index(inside[0]):
            found.append(f"line {line}: {inside[0]} imports {target}")
    return found


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def files_of(place: str) -> list[Path]:
    """The files of a room, or those beside the rooms."""
    found = [path for path in FILES if path.relative_to(PACKAGE).parts[0] == place]
    assert found
    return found


# A room or a file at a time: a test of each file would take longer to hand out than to run.
PLACES = sorted({path.relative_to(PACKAGE).parts[0] for path in FILES})


def test_the_documentation_shows_the_rooms_in_their_order() -> None:
    pages = PACKAGE.parent.parent / "docs"
    table = (pages / "explanation" / "how-it-works.md").read_text(encoding="utf-8")
    assert tuple(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == ROOMS
    picture = (pages / "images" / "rooms.svg").read_text(encoding="utf-8")
    (told,) = re.findall(r"<metadata>(.*)</metadata>", picture)
    assert tuple(json.loads(html.unescape(told))["rooms"].split()) == ROOMS


def test_the_page_that_follows_an_identification_names_files_that_exist() -> None:
    page = PACKAGE.parent.parent / "docs" / "explanation" / "one-identification.md"
    named = re.findall(r"`(\w+/(?:\w+/)*(?:\w+\.py)?)`", page.read_text(encoding="utf-8"))
    assert len(named) > 40
    assert [place for place in named if not (PACKAGE / place).exists()] == []


@pytest.mark.parametrize("place", PLACES)
def test_files_keep_to_the_plan(place: str) -> None:
    for path in files_of(place):
        source = path.read_text(encoding="utf-8")
        assert "steelyard_thesis" not in source, f"{path}: the package beside this one knows it, and not the reverse"
        assert violations(source, module_of(path), path.name == "__init__.py") == [], path
        assert path.stem not in EMPTY_NAMES, f"{path}: a module is named by what it is about"


def homes_of(package: Path) -> dict[str, str]:
    """For the names that packages hand out, the modules that they come from."""
    found = {}
    for path in package.rglob("__init__.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level == 1 and node.module:
                place = module_of(path)
                found.update({f"{place}.{alias.name}": f"{place}.{node.module}" for alias in node.names})
    return found


def imports_of_files(at_once: bool) -> dict[str, set[str]]:
    """Tell for each file which others it imports, directly or as what a package hands out."""
    homes, paths = homes_of(PACKAGE), {module_of(path): path for path in FILES if path.name != "__init__.py"}

    def home_of(name: str) -> str:
        home = homes.get(name, name)
        while home not in paths and f"{home}.{name.rpartition('.')[2]}" in homes:  # handed on by another package
            home = homes[f"{home}.{name.rpartition('.')[2]}"]
        return home if home in paths else home.rpartition(".")[0]

    found = {}
    for module, path in paths.items():
        imports = imports_of(path.read_text(encoding="utf-8"), module, False)
        names = {home_of(name) for _, name in (imports.at_once if at_once else imports.all)}
        found[module] = names & paths.keys() - {module}
    return found


def test_imports_are_found_wherever_a_statement_may_stand() -> None:
    """As a walk over everything finds them, in the order of the lines."""
    source = (
        "import a\nif x:\n  import b\nelse:\n  import c\nfor _ in x:\n  import d\nelse:\n  import e\ntry:\n  import f\n"
        "except A:\n  import g\nelse:\n  import h\nfinally:\n  import i\nwith x:\n  import j\nmatch x:\n  case 1:\n"
        "    import k\nclass C:\n  async def m(self):\n    while x:\n      from . import l\n"
    )
    walked = sorted(imports_in(ast.walk(ast.parse(source)), "p.q", False))
    assert sorted(imports_of(source, "p.q", False).all) == walked
    assert len(walked) == 12


def test_no_files_import_each_other_in_a_circle() -> None:
    """Annotations and imports within functions included."""
    list(
        graphlib.TopologicalSorter(imports_of_files(at_once=False)).static_order()
    )  # names the circle where there is one


def test_a_circle_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that leads through a package, and one that only a type checker sees."""
    room = tmp_path / "steelyard" / "room"
    room.mkdir(parents=True)
    (room / "__init__.py").write_text("from .a import A as A")
    (room / "a.py").write_text("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .b import B")
    (room / "b.py").write_text("from steelyard.room import A")
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path / "steelyard")
    monkeypatch.setitem(globals(), "FILES", sorted(room.glob("*.py")))
    assert imports_of_files(at_once=True) == {"steelyard.room.a": set(), "steelyard.room.b": {"steelyard.room.a"}}
    with pytest.raises(graphlib.CycleError):
        list(graphlib.TopologicalSorter(imports_of_files(at_once=False)).static_order())


def test_the_longest_chain_of_imports_is_short() -> None:
    """From what identifies a robot down to what needs nothing: who reads one file must not have to read twenty."""
    needs = imports_of_files(at_once=True)
    lengths: dict[str, int] = {}
    for module in graphlib.TopologicalSorter(needs).static_order():
        lengths[module] = 1 + max((lengths[needed] for needed in needs[module]), default=0)
    assert 5 < lengths["steelyard.identification.identify"] <= 15


def test_no_two_files_have_one_name() -> None:
    # A command has the name of what it calls.
    counts = Counter(path.stem for path in FILES if path.stem != "__init__" and path.parent.name != "cli")
    assert [name for name, count in counts.items() if count > 1] == []


WRITERS = {"write_text", "write_bytes", "replace", "rename", "mkstemp", "mkdtemp", "NamedTemporaryFile"}
# These write into a temporary folder that one program reads, the copy of what is piped in, and the trace of a fault.
SCRATCH = {"external_solver.py", "standard_input.py", "cli/main.py"}


def written_without_care(source: str) -> list[str]:
    """Say where a module writes or renames files by itself."""
    found: list[str] = []
    if not re.search(r"write_text|write_bytes|\b(os|shutil|tempfile)\b", source):
        return found  # most files, without a look at their syntax
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in WRITERS:
            owner = node.func.value.id if isinstance(node.func.value, ast.Name) else ""
            if node.func.attr in ("write_text", "write_bytes") or owner in ("os", "tempfile", "shutil"):
                found.append(f"line {node.lineno}: {node.func.attr}")
    return found


@pytest.mark.parametrize("place", PLACES)
def test_files_are_written_in_one_room(place: str) -> None:
    for path in files_of(place):
        if place == "files" or path.name in SCRATCH or str(path.relative_to(PACKAGE)) in SCRATCH:
            continue
        assert written_without_care(path.read_text(encoding="utf-8")) == [], f"{path}: use steelyard.files"


def test_careless_writing_is_found() -> None:
    assert len(written_without_care("import os\nos.replace(a, b)\n(a / b).write_text('')\n'x'.replace('x', 'y')")) == 2


def test_every_folder_is_a_room() -> None:
    folders = {path.relative_to(PACKAGE).parts[0] for path in FILES if path.parent != PACKAGE}
    assert folders <= set(ROOMS)
    assert {p.name for p in PACKAGE.glob("*.py")} == {
        "__init__.py",
        "__main__.py",
        "display.py",
        "errors.py",
        "extensions.py",
        "first_use.py",
        "once.py",
    }


@pytest.mark.parametrize("place", [place for place in PLACES if place != ENTRY_POINT.name])
def test_exported_names_exist(place: str) -> None:
    for module in map(module_of, files_of(place)):
        loaded = importlib.import_module(module)
        names = list(loaded.__all__)
        assert len(names) == len(set(names)), module
        assert [name for name in names if not hasattr(loaded, name)] == [], module


@pytest.mark.parametrize(
    ("source", "module"),
    [
        ("from steelyard.cli import main", "steelyard.robot.joint"),
        ("import steelyard.feasibility.check", "steelyard.regression.factor"),
        ("from steelyard import dynamics", "steelyard.graph.kernel"),
        ("from ..report import html", "steelyard.identification.identify"),
        ("def late():\n    from steelyard.regression import Estimate", "steelyard.recording.samples"),
        ("from steelyard import Robot", "steelyard.estimators.fit"),
        ("import steelyard", "steelyard.cli.main"),
        ("from steelyard.robot import Robot", "steelyard.attic.box"),
        ("from steelyard.attic import box", "steelyard.cli.main"),
        ("import pickle", "steelyard.recording.saving"),
        ("def late():\n    from steelyard_thesis import METHODS", "steelyard.cli.main"),
    ],
)
def test_violations_are_found(source: str, module: str) -> None:
    assert len(violations(source, module)) == 1


@pytest.mark.parametrize(
    ("source", "module", "is_package"),
    [
        ("from steelyard.robot import Robot", "steelyard.dynamics.model", False),
        ("from .joint import Joint", "steelyard.robot", True),
        ("from .cache import ObjectCache", "steelyard.graph.kernel", False),
        ("from . import kinematics", "steelyard.dynamics.model", False),
        ("from ..errors import InputError", "steelyard.robot.dh", False),
        ("from steelyard import __version__, graph", "steelyard.dynamics.model", False),
        ("import numpy.linalg", "steelyard.robot.dh", False),
    ],
)
def test_proper_imports_pass(source: str, module: str, is_package: bool) -> None:
    assert violations(source, module, is_package) == []


def test_the_way_from_a_fit_to_the_solver_is_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """At most four steps from one file to the next, as `docs/explanation/one-identification.md` tells it."""
    cone_program = importlib.import_module("steelyard.feasibility.cone_program")
    solve, ways = cone_program.solve, set()

    def traced(*arguments: Any, **options: Any) -> Any:
        files = [Path(frame.filename) for frame in inspect.stack()]
        # `in_one_thread`, which sets the threads of what it decorates, is no step on the way.
        ours = [path.stem for path in reversed(files) if PACKAGE in path.parents and path.stem != "threads"]
        ways.add(tuple(stem for stem, _ in itertools.groupby(ours)))
        return solve(*arguments, **options)

    monkeypatch.setattr(cone_program, "solve", traced)
    model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    names = model.base_parameters().names
    info = sy.Information.from_factor([[10.0, 0, 0], [0, 10, 0], [0, 0, 10]], [-0.1, 5.0, 0.0], 0.02, 100, names)
    sy.fit(info, sy.FeasibleSet(model))
    assert ways == {("fit", "reduced_fit", "fitting_problems", "cone_program")}  # and from there to the solver
    page = (PACKAGE.parent.parent / "docs" / "explanation" / "one-identification.md").read_text(encoding="utf-8")
    assert "`fit`, `reduced_fit`, `fitting_problems`, `cone_program`, `solver`" in page
