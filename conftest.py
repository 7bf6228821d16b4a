"""What the tests of both packages share: fixtures, settings, and examples in docstrings that need an extra."""

import contextlib
import csv
import gc
import importlib
import importlib.metadata
import os
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import EntryPoints
from importlib.util import find_spec
from pathlib import Path
from typing import Any

# There are as many processes as cores: threads of each only wait for those of the others, a third of the time.
# NumPy reads this when it is imported, so that nothing may import it before.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Where Python may not keep compiled files beside their sources, each process of the tests compiled every file anew,
# and rewrote the assertions of every test: 18 s of the processor each. They are kept in pytest's own folder instead.
if sys.dont_write_bytecode:
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(Path(__file__).resolve().parent / ".pytest_cache" / "bytecode")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix

import pytest
from child_programs import run_here
from hypothesis import given, settings
from hypothesis.strategies import booleans
from stand_ins import factored as factored
from stand_ins import inertial_symbols as inertial_symbols
from stand_ins import least_by_descent as least_by_descent
from stand_ins import point_cloud_parameters as point_cloud_parameters
from stand_ins import real_wam as real_wam
from stand_ins import reduced_regression as reduced_regression
from stand_ins import stand_in as stand_in
from stand_ins import table_4_9 as table_4_9
from stand_ins import thesis_wam as thesis_wam
from stand_ins import two_links as two_links

SHARED = Path(__file__).resolve().parent.parent / "shared"

# Let the garbage collector look less often than every 700 objects: nearly all that tests make is freed without it.
gc.set_threshold(50_000, *gc.get_threshold()[1:])

# Property tests try the same examples every time; `--hypothesis-profile=random` looks for new ones, and `.ci/run` tries
# more of the same with the profile `many`.
settings.register_profile("steelyard", deadline=None, derandomize=True, database=None, max_examples=24)
settings.register_profile("many", settings.get_profile("steelyard"), max_examples=100)
# Its parent is named: where Hypothesis sees a build server (CI=true), its own default is the same examples every time.
settings.register_profile(
    "random", settings.get_profile("default"), deadline=None, derandomize=False, print_blob=True, max_examples=200
)
settings.load_profile("steelyard")


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over the modules and tests that are there to stay."""
    # What is passed over is no longer found as holding anything. When it is first used, Hypothesis looks for what holds
    # its generator of random numbers, and up to 6.120 at least it warned where it found nothing.
    given(booleans())(lambda value: None)()
    gc.collect()
    gc.freeze()


def pytest_configure() -> None:
    """Keep what happens to be imported out of the examples that are the same every time.

    Hypothesis draws from the constants of all modules that are loaded, which depends on the tests that ran before in
    the same process, and with several processes on chance.
    """
    if settings.default is not None and settings.default.derandomize:
        with contextlib.suppress(ImportError):  # older versions draw from nothing but chance
            providers = importlib.import_module("hypothesis.internal.conjecture.providers")
            providers.is_local_module_file = lambda path: False


# What the examples of a file, of the files of a folder, or of a function import.
NEEDS = {
    "casadi_function.py": "casadi",
    "jax_function.py": "jax",
    "symbolic_function.py": "sympy",
    "symbols.py": "sympy",
    "closed_form": "sympy",
    "from_mjcf": "mujoco",
    "mjcf_writer.py": "mujoco",
    "obstacles.py": "coal",
    "self_collision.py": "coal",
}

SLOW = {"identify_from_positions"}
"""Functions whose examples take more than a few seconds."""

# What takes minutes, for which the other processes would wait at the end. Tests that share what takes long stand beside
# each other, so that one process gets them.
LONGEST = (
    "test_no_picture_is_out_of_date",
    "test_what_must_come_out_of_an_example_comes_out",
    "test_everything_is_reproduced",
    "test_commands_run[docs/reference/command-line.md]",
    "test_the_study_says_what_the_page_says",
)


def _place_among_the_longest(item: pytest.Item) -> int:
    names = (item.name, getattr(item, "originalname", None))
    return next((place for place, name in enumerate(LONGEST) if name in names), len(LONGEST))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest, and mark what is slow and the examples whose extra is missing."""
    items.sort(key=_place_among_the_longest)
    for item in items:
        if not isinstance(item, pytest.DoctestItem):
            continue
        names = (item.path.name, item.path.parent.name, item.name.rpartition(".")[2])
        extra = next((NEEDS[name] for name in names if name in NEEDS), None)
        if extra is not None and find_spec(extra) is None:
            item.add_marker(pytest.mark.skip(reason=f"{extra} is not installed"))
        if names[-1] in SLOW:
            item.add_marker(pytest.mark.slow)


# Compiled code of the tests stays out of the user's cache. Processes side by side share one, which the first one made.
if "PYTEST_XDIST_WORKER" not in os.environ:
    _cache = tempfile.TemporaryDirectory(prefix="steelyard-cache-")
    os.environ["STEELYARD_CACHE_DIR"] = _cache.name


@pytest.fixture(scope="session", autouse=True)
def no_waiting_for_the_disk() -> Iterator[None]:
    """Nothing that tests write has to outlive a power failure, and the disk takes its time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda handle: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def packages_are_looked_through_once() -> Iterator[None]:
    """What packages offer is read from hundreds of files, and changes where a test puts a package on the path alone."""
    from steelyard import extensions

    known: dict[tuple[object, ...], EntryPoints] = {}

    def entry_points(**chosen: str) -> EntryPoints:
        key = (*sys.path, *chosen.items())
        if key not in known:
            known[key] = importlib.metadata.entry_points(**chosen)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(extensions, "entry_points", entry_points)
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings, or a skip where it is absent."""
    folder = SHARED / "data"
    if not folder.is_dir():
        pytest.skip("the real recordings (../shared/data) are not here")
    return folder


@pytest.fixture(scope="session")
def thesis_tables() -> Path:
    """The folder with the tables of the thesis as CSV, or a skip where it is absent."""
    folder = SHARED / "thesis" / "tables"
    if not folder.is_dir():
        pytest.skip("the tables of the thesis (../shared/thesis/tables) are not here")
    return folder


def table(path: Path) -> list[dict[str, str]]:
    """Read a CSV table as a list of rows."""
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="session")
def wam():
    """The WAM of thesis section 4.2, built from the thesis's own tables where they are here."""
    from steelyard.identification.wam import wam_model

    return wam_model()


@pytest.fixture(scope="session")
def example(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a function that tells the folder of an example, which the tests of all processes share and none changes.

    Simulating one takes longer than identifying the robot.
    """
    from steelyard import InputError
    from steelyard.identification.examples import write_example

    def written(name: str) -> Path:
        folder = Path(os.environ["STEELYARD_CACHE_DIR"]) / "examples" / name
        if not folder.is_dir():
            folder.parent.mkdir(exist_ok=True)
            try:
                made = write_example(name, tmp_path_factory.mktemp(name) / "made")
            except InputError as error:
                pytest.skip(str(error))
            with contextlib.suppress(OSError):  # another process was faster
                made.rename(folder)
            if not folder.is_dir():
                return made
        return folder

    return written


@pytest.fixture
def random():
    """A seeded generator."""
    import numpy as np

    return np.random.default_rng(20141129)


@pytest.fixture
def other_objects_aside() -> Iterator[None]:
    """Let the garbage collector look at what the test makes alone: all that modules hold takes it half a second."""
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture
def no_extensions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Begin without registered extensions and loaded ones, and end as it was before."""
    monkeypatch.setattr("steelyard.extensions._REGISTERED", {})
    monkeypatch.setattr("steelyard.extensions._LOADED", {})


@pytest.fixture
def meshes_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the program that reads meshes here."""
    monkeypatch.setattr("steelyard.collision.mesh_files.run_child", run_here)


@pytest.fixture(scope="session")
def _shapes_of_installed() -> dict[tuple[Any, ...], Any]:
    return {}


@pytest.fixture
def installed_shapes_once(monkeypatch: pytest.MonkeyPatch, _shapes_of_installed: dict[tuple[Any, ...], Any]) -> None:
    """Read meshes of robots that packages bring, which nobody changes, once: it takes longer than most uses of them."""
    from steelyard import collision

    known, read, packages = _shapes_of_installed, collision.shapes_of_moving_links, sysconfig.get_path("purelib")

    def once(robot: Any, path: Path, skipped: list[tuple[str, str]], largest: int) -> dict[Any, Any]:
        if not path.is_relative_to(packages):
            return read(robot, path, skipped, largest)
        # Of the robot only the joints that are held change what is read, which then belong to another link.
        key = (path, robot.joint_names, largest)
        if key not in known:
            told: list[tuple[str, str]] = []
            known[key] = read(robot, path, told, largest), told
        shapes, told = known[key]
        skipped += told
        return dict(shapes)

    monkeypatch.setattr(collision, "shapes_of_moving_links", once)


@pytest.fixture
def mujoco_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the program that compiles an MJCF here."""
    monkeypatch.setattr("steelyard.robot.mjcf_compiled.run_child", run_here)


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_extensions: None) -> Callable[..., None]:
    """Return a function that installs a package: its name, the text of its one file, and its entry points of one kind.

    The file of a package `name` is the module `of_name`.
    """

    def install(name: str, kind: str, entries: Mapping[str, str], text: str = "") -> None:
        place = tmp_path / f"site_{name}"
        metadata = place / f"{name}-1.0.dist-info"
        metadata.mkdir(parents=True)
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        lines = "\n".join(f"{entry} = {target}" for entry, target in entries.items())
        (metadata / "entry_points.txt").write_text(f"[steelyard.{kind}]\n{lines}\n")
        (place / f"of_{name}.py").write_text(text)
        monkeypatch.syspath_prepend(str(place))
        monkeypatch.delitem(sys.modules, f"of_{name}", raising=False)
        importlib.invalidate_caches()

    return install


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Return a function that runs ``steelyard`` and returns exit code, standard output and standard error."""

    from steelyard.cli import main

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["steelyard", *map(str, arguments)])
        capsys.readouterr()
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = int(stop.code or 0)
        output = capsys.readouterr()
        return code, output.out, output.err

    return run
