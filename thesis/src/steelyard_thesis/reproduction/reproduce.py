"""Runs the sections, keeps what they gave, and writes the page."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import steelyard
from steelyard.errors import InputError
from steelyard.files import write_text
from steelyard.report import Section as Part
from steelyard.report import html_document, require_folder
from steelyard.report.html_document import Markup

from .page import reproduction_page, section_markup
from .section import Context, Section, SectionResult

__all__ = ["Reproduction", "all_sections", "reproduce"]

# In the order of the page; each module has a SECTION.
_MODULES = (
    "base_parameters",
    "excitation",
    "identification",
    "correction",
    "free_fall",
    "tracking",
    "inertia_matrices",
    "yoshida",
    "point_masses",
    "constrained_methods",
    "model_reduction",
    "generated_code",
    "real_wam",
    "real_robots",
    "impact",
)


@dataclass(frozen=True)
class Reproduction:
    """The results of a reproduction.

    Attributes
    ----------
    results : tuple of (Section, SectionResult)
    missing : tuple of (Section, str)
        Sections that could not be computed, and why.
    page : Path
        ``reproduction.html``.
    """

    results: tuple[tuple[Section, SectionResult], ...]
    missing: tuple[tuple[Section, str], ...]
    page: Path

    @property
    def published(self) -> int:
        """Number of published values that were computed again."""
        return sum(len(result.comparisons) for _, result in self.results)

    @property
    def agreeing(self) -> int:
        """Number of those that agree."""
        return sum(row.agrees for _, result in self.results for row in result.comparisons)

    def __repr__(self) -> str:
        return f"Reproduction({self.agreeing} of {self.published} published values agree, {self.page.name})"


def all_sections() -> tuple[Section, ...]:
    """Return all the sections, in the order of the thesis."""
    return tuple(import_module(f"steelyard_thesis.reproduction.sections.{name}").SECTION for name in _MODULES)


def reproduce(
    folder: str | Path,
    numbers: Sequence[str] = (),
    *,
    data: str | Path | None = None,
    fresh: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Reproduction:
    """Compute sections of the thesis again and write them beside its values.

    A section that was computed before, by the same code from the same recordings, is read and not computed.

    Parameters
    ----------
    folder : str or Path
        For ``reproduction.html``, and for each section a CSV of its comparisons, its tables as CSV, an HTML page and
        its whole result as JSON.
    numbers : sequence of str
        Such as ``["4.2", "6"]``: these sections and those within them; all of them where there is none.
    data : str or Path, optional
        Folder of the real recordings.
    fresh : bool
        Compute everything anew.
    progress : callable, optional
        Takes a few words before each step.

    Returns
    -------
    Reproduction

    Raises
    ------
    InputError
        If there is no such section, or a folder cannot be used.
    """
    say = progress or (lambda _: None)
    place = Path(folder)
    require_folder(place)
    recordings = None if data is None else Path(data)
    if recordings is not None and not recordings.is_dir():
        raise InputError(f"{recordings}: no such folder of recordings.")
    known = all_sections()
    chosen = _chosen(known, numbers)
    mark = _fingerprint(recordings)
    results: list[tuple[Section, SectionResult]] = []
    missing: list[tuple[Section, str]] = []
    for section in chosen:
        if section.needs_data and recordings is None:
            missing.append((section, "needs the real recordings (--data)"))
            continue
        kept = place / f"section_{section.key}.json"
        result = None if fresh else _kept(kept, mark)
        if result is None:
            say(section.heading)
            result = section.compute(Context(recordings, _prefixed(say, section.number)))
            _keep(place, section, result, mark)
        else:
            say(f"{section.heading}: computed before")
        results.append((section, result))
    page = place / "reproduction.html"
    write_text(reproduction_page(results, missing), page)
    return Reproduction(tuple(results), tuple(missing), page)


def _prefixed(say: Callable[[str], None], number: str) -> Callable[[str], None]:
    return lambda text: say(f"{number}: {text}")


def _chosen(known: Sequence[Section], numbers: Sequence[str]) -> list[Section]:
    for number in numbers:
        if not any(_within(section, number) for section in known):
            names = ", ".join(section.number for section in known)
            raise InputError(f"There is no section {number!r} to reproduce; there are {names}.")
    return [section for section in known if not numbers or any(_within(section, number) for number in numbers)]


def _within(section: Section, number: str) -> bool:
    return section.number == number or section.number.startswith(f"{number}.")


def _fingerprint(recordings: Path | None) -> str:
    """Return a text that changes with the code or the recordings."""
    state = hashlib.sha256(steelyard.__version__.encode())
    for package in (Path(steelyard.__file__).parent, Path(__file__).parents[1]):
        for file in sorted(package.rglob("*.py")):
            state.update(file.relative_to(package).as_posix().encode() + b"\0" + file.read_bytes())
    if recordings is not None:
        for file in sorted(path for path in recordings.rglob("*") if path.is_file()):
            state.update(f"{file.relative_to(recordings).as_posix()} {file.stat().st_size}".encode())
    return state.hexdigest()


def _kept(path: Path, mark: str) -> SectionResult | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return SectionResult.from_dict(content["result"]) if content["made_by"] == mark else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _keep(place: Path, section: Section, result: SectionResult, mark: str) -> None:
    name = f"section_{section.key}"
    rows = [("value", "published", "ours", "tolerance", "agrees", "why")]
    rows += [(r.what, r.published, r.ours, r.tolerance, r.agrees, r.why) for r in result.comparisons]  # type: ignore[misc]
    write_text(_csv(rows), place / f"{name}.csv")
    for number, item in enumerate(result.tables, start=1):
        write_text(_csv([item.columns, *item.rows]), place / f"{name}_table_{number}.csv")
    title = section.heading
    part = Part("result", title, section_markup(section, result))
    scripts = ("charts.js",) if result.charts else ()
    page = html_document(title, "Steelyard reproduction", title, Markup(""), [part], scripts=scripts)
    write_text(page, place / f"{name}.html")
    content = {"format": "steelyard-reproduction-1", "made_by": mark, "result": result.to_dict()}
    write_text(json.dumps(content), place / f"{name}.json")


def _csv(rows: Sequence[Sequence[object]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
