"""Output on a terminal: progress and results, as plain text without control sequences but this program's colours."""

from __future__ import annotations

import json as json_format
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TextIO

import numpy as np

from steelyard.errors import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from steelyard.dynamics import Model
    from steelyard.excitation import ExcitationDesign
    from steelyard.identification import Identification
    from steelyard.identification.preflight import Preflight
    from steelyard.online import SimulatedExcitation

SECTIONS = ("log", "processing", "constraints", "payload", "elastic", "controller")
"""Sections of robot.toml for which the command line may speak; the others are part of the robot."""

__all__ = [
    "LONGEST_SENTENCE",
    "SECTIONS",
    "echo",
    "guarded",
    "print_json",
    "progress",
    "sentence",
    "show",
    "show_excitation",
    "show_identification",
    "show_model",
    "show_on_the_fly",
    "show_preflight",
]


LONGEST_SENTENCE = 1500  # characters of a message; names in files may be of any length, and a screen has about 2000
_COLOUR = re.compile(r"(\x1b\[[0-9;]*m)")


def sentence(text: object) -> str:
    """Return a message as one line of limited length."""
    line = printable(" ".join(str(text).split()))
    if len(line) <= LONGEST_SENTENCE:
        return line
    half = LONGEST_SENTENCE // 2
    return f"{line[:half]} […] {line[-half:]}"


def echo(text: object) -> None:
    """Print a text on standard output."""
    print(printable(str(text)))


def print_json(document: object) -> None:
    """Print plain data as one JSON document, in ASCII, with null for numbers that are not finite."""
    from steelyard.files import plain

    print(json_format.dumps(plain(document), allow_nan=False, indent=1))


class _Result(Protocol):
    """The result that `show` prints and writes."""

    def to_dict(self) -> dict[str, Any]: ...

    def save(self, path: str | Path) -> None: ...


def show(result: _Result, output: Path | None, *, json: bool, quiet: bool) -> None:
    """Print a result, for people or as JSON, and write it where a file is given; of a quiet one the first line."""
    if json:
        print_json(result.to_dict())
    else:
        text = str(result)
        echo(text.splitlines()[0] if quiet else text)
    if output is not None:
        result.save(output)
        if not json and not quiet:
            echo(f"Written to {output}")


class _Guarded:
    """A stream that replaces control characters, and characters that its encoding does not have, by escapes."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text; colours stay where the stream is a terminal."""
        parts = _COLOUR.split(text) if self._stream.isatty() else [text]
        safe = "".join(part if index % 2 else printable(part) for index, part in enumerate(parts))
        encoding = self._stream.encoding or "utf-8"
        self._put(safe.encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def _put(self, text: str) -> None:
        self._stream.write(text)

    def overwrite(self, text: str, *, back: bool = False) -> None:
        """Write a text in the place of the line that the cursor is in, and leave the cursor at its begin or its end."""
        self._put("\r")
        self.write(text)
        if back:
            self._put("\r")
        self.flush()

    def writelines(self, lines: Any) -> None:
        """Write several texts."""
        for line in lines:
            self.write(line)


class _Said(_Guarded):
    """Standard error, which nobody may be able to read: no work is lost for a line of progress."""

    def _put(self, text: str) -> None:
        try:
            self._stream.write(text)
        except OSError:
            _discard(self._stream)

    def flush(self) -> None:
        """Write what waits to be written."""
        try:
            self._stream.flush()
        except OSError:
            _discard(self._stream)


@contextmanager
def guarded() -> Iterator[None]:
    """Guard standard output and standard error, also against what libraries print."""
    output, errors = (_opened(name) for name in ("stdout", "stderr"))
    sys.stdout, sys.stderr = _Guarded(output), _Said(errors)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = output, errors
        for stream in (output, errors):
            try:
                stream.flush()
            except OSError:  # its reader has gone, or a disk is full: Python would print one more error when it exits
                _discard(stream)


def _opened(name: Literal["stdout", "stderr"]) -> TextIO:
    """Return a standard stream; where the caller closed it, what is written there goes nowhere.

    Its number is taken then, too: the next file that is opened would have it, and receive what libraries print.
    """
    stream: TextIO | None = getattr(sys, name)
    if stream is not None:
        return stream
    number = {"stdout": 1, "stderr": 2}[name]
    try:
        os.fstat(number)
    except OSError:
        _lead_nowhere(number)
    return open(os.devnull, "w", encoding="utf-8")


def _discard(stream: TextIO) -> None:
    """Let what is written to a stream, and what waits to be written, go nowhere."""
    with suppress(OSError):
        _lead_nowhere(stream.fileno())


def _lead_nowhere(number: int) -> None:
    """Let a file descriptor stand for the null device."""
    nothing = os.open(os.devnull, os.O_WRONLY)
    if nothing != number:
        os.dup2(nothing, number)
        os.close(nothing)


# Those of a chain of 44 joints. With more the graph of the regressor takes seconds; for 300 joints it takes minutes and
# gigabytes.
_MOST_BLOCKS = 1000
_MOST_ROWS = 25  # of a table; what is longer stands in files
_MOST_VIOLATIONS = 4


@contextmanager
def progress(*, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Show each step with the time it began, on standard error, and how far it has come where it takes over a second.

    Nothing is shown where that is to be quiet.
    """
    if quiet:
        yield lambda text: None
        return
    from steelyard.files import watched

    steps = _Steps()
    with watched(steps.watch):
        try:
            yield steps.say
        finally:
            steps.clear()


_UNSEEN = 1.0  # s that a step takes before it is told how far it has come
_AGAIN = (0.2, 10.0)  # s until that is told again: on a terminal, where the line is overwritten, and elsewhere


class _Steps:
    """The steps of a command, and a line below them that tells how far the last one has come."""

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(stderr=True, highlight=False)
        self._begin = time.perf_counter()
        self._what, self._since, self._first, self._next, self._width = "", 0.0, 0.0, 0.0, 0
        self._done = 0.0
        self._overwrites = isinstance(sys.stderr, _Guarded) and sys.stderr.isatty()

    def say(self, text: str) -> None:
        self.clear()
        self._console.print(f"[dim]{time.perf_counter() - self._begin:6.2f} s[/dim]  ", end="")
        _say(self._console, text)

    def watch(self, what: str, done: float, total: float | None, unit: str) -> None:
        now = time.perf_counter()
        again = done < self._done  # the same once more
        self._done = done
        if what != self._what or again:
            self._what, self._since, self._first, self._next = what, now, done, now + _UNSEEN
        if now < self._next:
            return
        self._next = now + _AGAIN[not self._overwrites]
        line = f"{'':10}{how_far(what, done, total, unit, now - self._since, done - self._first)}"
        if self._overwrites:
            self._line(line[: max(self._console.width - 1, 20)])
        else:
            _say(self._console, line)

    def clear(self) -> None:
        if self._width:
            self._line("")

    def _line(self, text: str) -> None:
        assert isinstance(sys.stderr, _Guarded)
        sys.stderr.overwrite(text.ljust(self._width) if text else " " * self._width, back=not text)
        self._width = len(text)


def how_far(what: str, done: float, total: float | None, unit: str, seconds: float, since: float) -> str:
    """Say how far something has come, how fast it goes, and how long the rest takes at this pace.

    Parameters
    ----------
    done, total : float
        How much of how much; None where the whole is not known.
    seconds : float
        Since it is watched.
    since : float
        What was done in this time.

    Examples
    --------
    >>> how_far("reading run.csv", 500_000, 2_000_000, "rows", 2.5, 500_000)
    'reading run.csv: 25 %, 200 000 rows/s, 8 s left'
    >>> how_far("counting", 64.0, None, "MB", 2.0, 60.0)
    'counting: 64 MB, 30 MB/s'
    """
    rate = since / seconds if seconds > 0.0 else 0.0
    parts = [f"{done:,.0f} {unit}".replace(",", " ") if not total else f"{100 * min(done / total, 1.0):.0f} %"]
    if rate > 0.0:
        shown = f"{rate:,.0f}".replace(",", " ") if rate >= 10.0 else f"{rate:.2g}"
        parts.append(f"{shown} {unit}/s")
        if total:
            left = max(total - done, 0.0) / rate
            parts.append(f"{left:.0f} s left" if left < 100.0 else f"{left / 60.0:.0f} min left")
    return f"{what}: {', '.join(parts)}"


def _text(words: str) -> Text:
    from rich.text import Text

    return Text(printable(words))


def _say(console: Console, words: str) -> None:
    """Print a sentence, whose lines the terminal breaks."""
    console.print(_text(words), soft_wrap=True)


def _table(*columns: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    for number, name in enumerate(columns):
        table.add_column(name, justify="left" if number == 0 else "right")
    return table


def _show(console: Console, table: Table) -> None:
    """Print a table as wide as its words are: names stay whole on narrow terminals and in pipes."""
    from rich.measure import Measurement

    width = console.width
    console.width = max(width, Measurement.get(console, console.options.update(max_width=10_000), table).maximum)
    console.print(table)
    console.width = width


def _bounded(console: Console, heads: Sequence[str], rows: Sequence[Sequence[str]], place: str) -> None:
    """Print at most `_MOST_ROWS` rows, and say where the others are; what is no number stands at the left."""
    from rich.markup import escape

    table = _table(*heads)
    for column, head in zip(table.columns, heads, strict=True):
        if head in ("role", "joint", "verdict", "quantity", "unit", "told by", "rests on"):
            column.justify = "left"
    for row in rows[:_MOST_ROWS]:
        table.add_row(*(escape(printable(cell)) for cell in row))
    _show(console, table)
    if len(rows) > _MOST_ROWS:
        console.print(f"  and {len(rows) - _MOST_ROWS} more; {place}.")


def show_identification(result: Identification, *, whole_table: bool = False, verbose: bool = False) -> None:
    """Print both verdicts, how well joints are predicted, what was found and what to do next: one screen.

    Parameters
    ----------
    whole_table : bool
        Print the table of all the parameters as well.
    verbose : bool
        Print errors of logs, masses and what they rest on, what was known beforehand, columns and all remarks as well.
    """
    from rich.console import Console

    from steelyard.identification.next_steps import found, next_steps
    from steelyard.report.extent import gathered

    console = Console(highlight=False)

    _say(console, f"{result.model.robot.name}: {result.headline}")
    heads, (*rows, whole) = result.joint_table()
    if len(rows) > _MOST_ROWS - 1:  # those of the largest error are what matters
        order = np.argsort(-np.nan_to_num(result.prediction.joint_error), kind="stable")[: _MOST_ROWS - 1]
        _say(console, f"The {len(order)} of {len(rows)} joints whose error is largest (report.html has all):")
        rows = [rows[index] for index in sorted(order)]
    _bounded(console, heads, [*rows, whole], "report.html has all")
    if result.elastic_joints:
        _bounded(console, *result.elastic_table(), "report.html has all")
        for sentence in result.elastic_sentences:
            _say(console, sentence)
    for sentence in found(result):
        _say(console, sentence)
    if result.friction is not None:
        _show_friction(result, console, verbose)
    steps = next_steps(result)
    for number, step in enumerate(steps, 1):
        _say(console, f"{number}. {step}")
    told = (remark for remark in (*result.estimate.remarks, *result.remarks) if remark not in result.told_first)
    remarks = gathered(told, _all_logs(result))
    if verbose:
        _show_more(result, console, remarks)
    else:
        for layout, of in result.columns():
            if layout.guesses:
                _say(console, f"Columns of {_and_more(of)}, as they were understood:")
                _bounded(console, *layout.brief(), "run.json has all")
                for guess in layout.guesses:
                    _say(console, guess)
    file = result.robot_file
    said = [*(remarks if verbose else ()), *(f"{step.reason} {step.code}" for step in steps)]
    if file is not None and file.suffix.lower() != ".toml" and _names_sections(said):
        _say(
            console,
            f"{file} has no such sections: give such a line as --set SECTION.KEY=VALUE, or write a robot.toml with: "
            f"steelyard init {file} LOG",
        )
    if not verbose:
        count = f"{len(remarks)} remarks" if len(remarks) != 1 else "a remark"
        _say(console, f"--verbose prints the links, the logs, the columns and {count}; report.html shows all.")
    if whole_table and result.parameters is not None:
        print(printable(str(result.parameters)), file=console.file)  # thousands of rows: the console takes seconds


def _show_friction(result: Identification, console: Console, verbose: bool) -> None:
    """Print which laws of friction were chosen, and with `verbose` what became of the others."""
    choice = result.friction
    assert choice is not None
    for sentence in choice.sentences:
        _say(console, sentence)
    if choice.selection.chosen:
        _bounded(console, *choice.selection.chosen_table(), "report.html has all")
    if verbose:
        _bounded(console, *choice.selection.table(), "report.html has all")


def _all_logs(result: Identification) -> tuple[str, ...]:
    return (*result.logs, *result.validation_logs)


def _and_more(names: Sequence[str]) -> str:
    more = len(names) - 1
    return f"{names[0]} and {more} more log{'s' if more > 1 else ''}" if more else names[0]


def _show_more(result: Identification, console: Console, remarks: Sequence[str]) -> None:
    """Print what the first screen leaves out."""
    from steelyard.display import few_digits
    from steelyard.report.extent import gathered, shared_words, short_names, shown_logs

    for sentence in (*gathered(result.mistake_sentences, _all_logs(result)), *result.prediction.sentences[1:]):
        _say(console, sentence)
    console.print("Relative errors of the torques of each log:")
    shown, names = shown_logs(result), short_names(result)
    logs = [(names[index], result.predictions[index]) for index in shown]
    lines = [(name, one.role, f"{one.unconstrained_error:.2%}", f"{one.feasible_error:.2%}") for name, one in logs]
    _bounded(console, ("log", "role", "least squares", "answer"), lines, "report.html has all")
    if len(shown) < len(result.predictions):
        _say(console, shared_words(result.predictions, shown))
    verdict, *others = result.verdict.sentences()
    _say(console, "Plain least squares: " + verdict)
    for sentence in others[:_MOST_VIOLATIONS]:
        _say(console, f"  {sentence}")
    if len(others) > _MOST_VIOLATIONS:
        _say(console, f"  and {len(others) - _MOST_VIOLATIONS} more; report.html has all.")
    table = result.parameters
    if table is not None:
        _bounded(console, *table.link_table(), "parameters.csv has all")
        total = table["total mass"]
        spread = "" if table.confidence is None else f", {total.basis}: {total.interval}"
        _say(console, f"Total moving mass {few_digits(total.value)} kg{spread}. {table.counts}")
        for sentence in table.sentences:
            _say(console, sentence)
    if result.plausible is not None:
        for sentence in result.plausible.prior.sentences:
            _say(console, f"Known beforehand: {sentence}")
        if result.plausible.price is not None:
            _say(console, result.plausible.price.sentence)
    for remark in remarks:
        _say(console, f"Note: {remark}")
    for layout, of in result.columns():
        _say(console, f"Columns of {_and_more(of)}:")
        _bounded(console, layout.heads, layout.rows(), "run.json has all")


def _names_sections(sentences: Sequence[str]) -> bool:
    """Tell whether sentences speak of lines of robot.toml that the command line may give."""
    return any(f"in [{section}]" in sentence for sentence in sentences for section in SECTIONS)


def _regressor_blocks(model: Model) -> int:
    """Return how many pairs of a joint and a link that it moves there are."""
    depths: list[int] = []
    for joint in model.robot.joints:
        depths.append(1 + (depths[joint.parent] if joint.parent >= 0 else 0))
    return sum(depths)


def show_model(model: Model, consistency: Literal["full", "inertia"]) -> None:
    """Print joints, parameters, base parameters, operation counts and the verdict on the CAD."""
    from rich.console import Console

    from steelyard.feasibility import FeasibleSet, check
    from steelyard.robot import INERTIA_SYMBOLS

    console = Console(highlight=False)
    robot, base = model.robot, model.base_parameters()
    _say(console, f"{robot.name}: {robot.dof} joints, {len(robot.links)} moving links")
    rotors = any(np.isfinite(joint.rotor_inertia) for joint in robot.joints)
    heads = ("joint", "kind", "moves", "mass kg", "lower", "upper", "damping", "friction")
    table = _table(*heads, *(["rotor inertia"] if rotors else []))
    for joint, link in zip(robot.joints, robot.links, strict=True):
        mass = "unknown" if link.inertia is None else f"{link.inertia.mass:.5g}"
        numbers = (joint.lower, joint.upper, joint.damping, joint.friction, *([joint.rotor_inertia] if rotors else []))
        name = joint.name if joint.mimics is None else f"{joint.name} (mimics {joint.mimics})"
        cells = [f"{x:.4g}" if np.isfinite(x) else "-" for x in numbers]
        table.add_row(_text(name), joint.kind, _text(link.name), mass, *cells)
    _show(console, table)
    for remark in robot.remarks:
        _say(console, remark)
    _say(console, f"Terms: {', '.join(t.kind for t in robot.terms) or 'none'}")
    symbols = (*INERTIA_SYMBOLS, *(p.symbol for term in robot.terms for p in term.parameters))
    _say(console, f"Parameters of each link and its joint, with its number: {' '.join(symbols)}")
    _say(console, f"{model.parameter_count} parameters, {base.count} base parameters")
    if base.meant:
        _say(
            console,
            "Angles such as 1.5708 count as the right angles that they stand for; the base parameters leave out "
            f"{base.error:.1e} of a column of the regressor that way.",
        )
    listed = "\n".join(
        f"  {number:3d}  {printable(expression)}" for number, expression in enumerate(base.expressions, 1)
    )
    print(listed, file=console.file)  # thousands of lines, for which the console takes seconds
    console.print("Operations a sample")
    table = _table("function", "multiplications", "additions", "sines and cosines")
    blocks = _regressor_blocks(model)
    counted = [("inverse dynamics", "inverse_dynamics", False)]
    if blocks <= _MOST_BLOCKS:
        counted += [("regressor", "regressor", False), ("base regressor", "regressor", True)]
    for label, function, in_base in counted:
        count = model.operation_count(function, base=in_base)
        table.add_row(label, str(count["mul"]), str(count["add"]), str(count["sin"] + count["cos"]))
    _show(console, table)
    if blocks > _MOST_BLOCKS:
        _say(
            console,
            f"The regressor has {blocks} blocks of a joint and a link beyond it, too many to count its operations.",
        )
    parameters = np.asarray(robot.parameters)
    links = np.concatenate([np.arange(c[0], c[0] + 10) for c in model.link_columns])
    if np.isnan(parameters[links]).any():
        _say(console, "CAD: the description gives no inertia for some links, so there is nothing to check.")
        return
    feasible_set = FeasibleSet(model, consistency, terms=False)
    _say(console, "CAD: " + str(check(feasible_set, parameters=np.nan_to_num(parameters))))


def show_preflight(found: Preflight) -> None:
    """Print how far each link of a description is from an impossible one, and what is probably wrong."""
    from rich.console import Console

    console = Console(highlight=False)
    if found.links:
        rows = [
            (one.link, f"{one.mass:.4g}", "-" if np.isnan(one.margin) else f"{one.margin:.2g}", one.cause or "-")
            for one in found.links
        ]
        console.print("Links of the description (margin: least second moment over the largest, below 0 impossible):")
        _bounded(console, ("link", "mass kg", "margin", "probable cause"), rows, "--json has all")
    for one in found.findings[:_MOST_ROWS]:
        _say(console, f"{one.link}: {one.sentence}.")
    if len(found.findings) > _MOST_ROWS:
        console.print(f"  and {len(found.findings) - _MOST_ROWS} more; --json has all.")


def show_excitation(design: ExcitationDesign) -> None:
    """Print the warnings of a design, its condition number, how near it comes to its limits, and where it starts."""
    from rich.console import Console

    console = Console(highlight=False)

    if design.warnings:
        _say(console, " ".join(design.warnings))
    table = _table("limit", "nearest part", "margin", "at s")
    for margin in design.nearest():
        table.add_row(_text(margin.name), _text(margin.label), *margin.cells)
    _show(console, table)
    if design.criterion != "condition" or design.subset:
        about = f" of {design.shown}" if design.subset else ""
        _say(console, f"Criterion {design.criterion}{about}: {design.figure:.5g}.")
    together = design.combined_condition_number
    known = "" if together is None else f", {together:.4g} together with the prior information"
    lead = f", {design.ramp_time:.4g} s of it to start and as much to stop" if design.ramp_time else ""
    _say(
        console,
        f"{design.robot_name}: {design.family} motion of {design.trajectory.duration:.4g} s{lead}; condition number "
        f"{design.condition_number:.4g}{known}; every limit above is kept at 1 kHz.",
    )
    _say(
        console,
        f"Model: rigid links with {', '.join(design.terms) or 'no terms'}; {design.parameter_count} parameters, "
        f"{design.base_count} base parameters.",
    )
    _say(
        console,
        "Start at " + ", ".join(f"{joint} {place:.4f}" for joint, place in design.start.items()) + " (rad or m).",
    )
    for remark in design.remarks:
        if remark not in design.warnings:
            _say(console, f"Note: {remark}")


def show_on_the_fly(done: SimulatedExcitation) -> None:
    """Print what an excitation on the fly knew when, how good that is, and what went wrong."""
    from rich.console import Console

    console = Console(highlight=False)
    excitation = done.excitation
    _say(console, f"{excitation.model.robot.name}, simulated; the robot is {done.truth}.")
    for note in done.limit_notes:
        _say(console, note)
    rows = [
        (
            f"{step.time:.1f}",
            step.stage,
            f"{step.expected_error:.2%}",
            f"{np.max(step.joint_errors):.2%}",
            f"{np.mean(step.bandwidth):.3g}",
            f"{np.max(step.tracking_error):.3f}",
        )
        for step in excitation.steps
    ]
    heads = ("at s", "stage", "expected error", "worst joint", "bandwidth rad/s", "tracking rad or m")
    _bounded(console, heads, rows, "excite.json has all")
    for when, reason in excitation.interruptions[:_MOST_ROWS]:
        _say(console, f"Broken off at {when:.1f} s: {reason}.")
    used = ", ".join(f"{part:.0%} of {name}" for name, part in done.use.items())
    _say(console, f"Largest use of limits by the true motion: {used}.")
    for sentence in done.exceeded:
        _say(console, sentence)
    end = "reached" if done.reached else f"not reached within {excitation.longest:g} s (--longest)"
    _say(
        console,
        f"Expected error {excitation.expected_error:.2%} after {excitation.steps[-1].time:.1f} s, asked for "
        f"{excitation.accuracy:.2%}: {end}. True error of torques over random motions {done.torque_error:.2%}.",
    )
