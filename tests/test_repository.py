"""What the repository says about itself: README, versions, documentation."""

import collections
import itertools
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import types
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from python_file import module_of_file

import steelyard
from steelyard.dynamics import Dahl

ROOT = Path(__file__).resolve().parent.parent
FENCE = re.compile(r"^```(?P<language>[a-z]*)[^\n]*\n(?P<text>.*?)^```", re.MULTILINE | re.DOTALL)
# Character classes keep these patterns from matching their own source.
FOREIGN = {
    "a path of one machine": re.compile(r"/[w]ork/|/[r]oot/|/[h]ome/[a-z]|/[t]mp/[a-z]"),
    "the host of a package registry": re.compile(
        r"py[p]i\.org|python[h]osted\.org|[d]eb\.debian\.org|[n]pmjs\.|[c]rates\.io"
    ),
}


def blocks(path: str, *languages: str) -> list[str]:
    text = (ROOT / path).read_text(encoding="utf-8")
    return [found["text"] for found in FENCE.finditer(text) if found["language"] in languages]


def tracked_files() -> list[Path]:
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    try:
        listing = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git work tree")
    return [path for name in listing.split("\0") if name and (path := ROOT / name).is_file()]


def test_readme_opens_with_picture_and_two_commands() -> None:
    first_screen = "\n".join((ROOT / "README.md").read_text(encoding="utf-8").splitlines()[:30])
    picture = re.search(r"!\[[^\]]+\]\((docs/images/[\w.-]+)\)", first_screen)
    assert picture is not None
    assert (ROOT / picture[1]).is_file()
    commands = [found["text"] for found in FENCE.finditer(first_screen)]
    assert commands == blocks("README.md", "sh", "bash")[:2]
    demonstrate, test = commands
    for command in commands:
        assert command.count("\n") == 1, "a command is one line"
        assert command.startswith("python3 -m venv .venv && .venv/bin/pip install ")
    assert demonstrate.endswith("steelyard demo\n")
    assert test.endswith("pytest\n")


def test_versions_agree() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert steelyard.__version__ == version
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r'^version: "?([^"\n]+)"?$', citation, re.MULTILINE) == [version]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## \[([^\]]+)\]", changelog, re.MULTILINE)
    assert headings
    assert headings[0] in ("Unreleased", version)


def requirements(*extras: str) -> set[Requirement]:
    """What the package needs with these extras and to be built, with what they name in turn."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    optional = settings["project"]["optional-dependencies"]
    texts = [*settings["build-system"]["requires"], *settings["project"]["dependencies"]]
    texts += [text for extra in extras for text in optional[extra]]
    found: set[Requirement] = set()
    for text in texts:
        one = Requirement(text)
        found |= requirements(*one.extras) if one.name == "steelyard" else {one}
    return found


def test_the_locked_versions_are_those_that_are_asked_for() -> None:
    text = (ROOT / ".ci" / "lock.txt").read_text(encoding="utf-8")
    locked: dict[str, set[str]] = {}
    for name, version in re.findall(
        r"^([\w.-]+)==([\w.+-]+)[^\n]*\\\n    --hash=sha256:[0-9a-f]{64}", text, re.MULTILINE
    ):
        locked.setdefault(canonicalize_name(name), set()).add(version)
    assert sum(map(len, locked.values())) == len(re.findall(r"^\S+==", text, re.MULTILINE))
    for one in requirements("test", "oracles", "lint", "docs"):
        versions = locked.get(canonicalize_name(one.name), set())
        assert any(version in one.specifier for version in versions), f"{one}: run .ci/lock"


def test_the_checks_build_the_site_so_that_warnings_stop_them():
    """`--quiet` hides warnings from `--strict` as well: 29 of them passed, and broken links would have."""
    lines = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    (command,) = (line for line in lines if "mkdocs build" in line)
    assert "--strict" in command
    assert not re.search(r"--quiet|-q\b", command)


def test_every_library_that_users_install_is_named_as_trusted() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = set(settings["project"]["optional-dependencies"]) - {"test", "oracles", "lint", "docs"}
    page = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]+) \|", page.partition("## What is trusted")[2], re.MULTILINE)
    named = {name.strip() for row in rows for name in row.split(",")}
    assert {one.name for one in requirements(*extras)} - {"hatchling"} <= named
    assert f"for version {settings['project']['version']}." in page


def test_files_speak_of_the_project_alone() -> None:
    found = []
    for path in tracked_files():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        for what, pattern in FOREIGN.items():
            found += [f"{path.relative_to(ROOT)}: {what}: {hit[0]}" for hit in pattern.finditer(text)]
    assert found == []


@pytest.mark.parametrize(
    "text", ["see /" + "work/x", "/" + "root/.cache", "/" + "tmp/plan/notes", "https://py" + "pi.org/simple"]
)
def test_foreign_words_are_recognised(text: str) -> None:
    assert any(pattern.search(text) for pattern in FOREIGN.values())


def test_links_in_the_documentation_lead_somewhere() -> None:
    broken = []
    pages = [*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")]
    for page in pages:
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if "://" not in target and not (page.parent / target).exists():
                broken.append(f"{page.relative_to(ROOT)}: {target}")
    assert broken == []


def test_documented_options_are_those_of_the_command_line() -> None:
    import typer.main

    from steelyard.cli.main import COMMANDS, app

    text = (ROOT / "docs" / "reference" / "command-line.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## steelyard (\w+)\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL))
    group = typer.main.get_command(app)
    assert sorted(sections) == sorted(COMMANDS.own)
    for name in COMMANDS.own:
        options = {o for p in group.get_command(None, name).params for o in p.opts if o.startswith("--")}
        assert set(re.findall(r"^\| `(--[\w-]+)", sections[name], re.MULTILINE)) == options - {"--help"}, name


def test_documented_functions_are_those_of_a_model() -> None:
    robot = steelyard.Robot.from_dh([(0, 1, 0, "q")])
    model = steelyard.Model(robot.with_terms(Dahl(displacement=0.01)))
    text = (ROOT / "docs" / "reference" / "functions.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| ([\w, ]+) \|", text, re.MULTILINE))
    assert tuple(rows) == model.functions
    for name, arguments in rows.items():
        read = [argument.name for argument in model.function(name).arguments]
        assert arguments.split(", ") == [one for one in read if one != "channels"], name  # of which a sentence tells


def publication() -> types.ModuleType:
    """The hook that writes the metadata of the package."""
    pytest.importorskip("hatchling", reason="the metadata is made by hatchling")
    return module_of_file(ROOT / "hatch_build.py")


@pytest.mark.parametrize("repository", ["", "https://forge.example/team/steelyard"])
def test_links_of_the_published_readme_lead_somewhere(repository: str) -> None:
    text = publication().published_readme((ROOT / "README.md").read_text(encoding="utf-8"), repository, "main")
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    assert all(target.startswith(("https://", "http://", "#")) for target in targets), targets
    assert ("docs/images/story.svg" in text) == bool(repository)
    assert ("[Start in five minutes](" in text) == bool(repository)
    assert "Start in five minutes" in text


def test_the_address_of_the_project_stands_in_one_place() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert set(settings["tool"]["steelyard"]["publication"]) == {"repository", "branch", "issues", "documentation"}
    assert "urls" in settings["project"]["dynamic"]
    assert "urls" not in settings["project"]


def test_every_benchmark_is_described_with_its_command() -> None:
    text = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    scripts = sorted(path.name for path in (ROOT / "benchmarks").glob("*.py") if path.name != "peers.py")
    assert re.findall(r"^\| `(\w+\.py)` \|", text, re.MULTILINE).count("peers.py") == 0
    assert sorted(set(re.findall(r"^\| `(\w+\.py)` \|", text, re.MULTILINE))) == scripts
    assert [name for name in scripts if f"python benchmarks/{name}" not in text] == []


def test_the_changelog_names_every_command() -> None:
    from steelyard.cli.main import COMMANDS

    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert [name for name in COMMANDS.own if f"`{name}`" not in text and f"steelyard {name}" not in text] == []


def test_examples_say_where_their_data_is_to_be_had() -> None:
    for path in (ROOT / "examples").glob("*.toml"):
        text = path.read_text(encoding="utf-8")
        assert "shared/data" not in text or re.search(r"It is public: \w+\.com/", text), path.name


@pytest.mark.slow
def test_the_tests_of_a_source_distribution_pass(tmp_path: Path) -> None:
    """What is published can be tested by who unpacks it: pages, settings and scripts that tests read are there."""
    sdist = pytest.importorskip("hatchling.builders.sdist", reason="the archive is made by hatchling")
    archive = next(iter(sdist.SdistBuilder(str(ROOT)).build(directory=str(tmp_path))))
    with tarfile.open(archive) as file:
        file.extractall(tmp_path, filter="data")
    (unpacked,) = (path for path in tmp_path.iterdir() if path.is_dir())
    environment = {**os.environ, "PYTHONPATH": str(unpacked / "src")}
    tests = [
        "tests/test_repository.py",
        "tests/test_layering.py",
        "tests/test_public_names.py",
        "tests/test_documentation.py",
    ]
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(command, cwd=unpacked, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:]


@pytest.mark.parametrize("name", ["CHANGELOG.md", "docs/decisions.md", "benchmarks/README.md"])
def test_pages_that_everybody_adds_to_hold_nothing_twice(name: str) -> None:
    """Merging both sides of a conflict leaves lines twice, and headings that follow text without a blank line."""
    lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
    twice = [line for line, count in collections.Counter(lines).items() if count > 1 and len(line) > 60]
    assert twice == []
    assert [line for before, line in itertools.pairwise(lines) if line.startswith("#") and before.strip()] == []


def test_decisions_stand_under_the_rooms_that_the_page_names() -> None:
    text = (ROOT / "docs" / "decisions.md").read_text(encoding="utf-8")
    introduction, *rest = text.split("\n## ")
    named = re.findall(r"\[[^\]]+\]\(#([\w-]+)\)", introduction)
    rooms = [re.sub(r"[^\w -]", "", room.split("\n", 1)[0]).lower().replace(" ", "-") for room in rest]
    assert named == rooms
    entries = re.findall(r"(?m)^### (.+)$", text)
    assert [entry for entry, count in collections.Counter(entries).items() if count > 1] == []
