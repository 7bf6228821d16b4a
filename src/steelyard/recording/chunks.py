"""Logs larger than memory, chunk by chunk, with the same samples as if they were read whole."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import shown
from steelyard.files.advance import ahead
from steelyard.files.reading import LARGEST_INTEGER

from .automatic import DECISION_ROWS, decide, settle
from .clock import CLOCK_ROWS, FEWEST_ROWS, ClockStatistics, clock_of, steady_clock, with_evidence
from .columns import LogColumns
from .conversion import checked_columns, clock_at, convert, log_columns, require_numbers, signals_fields, times
from .even import EvenClock, Part
from .filters.zero_phase import decimation_padding
from .formats import BLOCK_ROWS, Columns, LogFiles, Source
from .formats.log_file import column_length
from .formats.registry import split_source
from .measurements import check_order, check_period, rate_between_pauses
from .options import Processing
from .plan import KnownBristles
from .recognition import Joints, names_of
from .recording import Recording
from .samples import Samples, masking_remarks, nothing_left, regrouped
from .survey import LogSurvey

if TYPE_CHECKING:
    from steelyard.dynamics import Model

__all__ = [
    "Chunk",
    "LogStream",
    "OpenedLog",
    "SeenRows",
    "middle_of",
    "positive_rows",
    "process_chunks",
    "read_chunks",
    "read_middle",
]

CHUNK_ROWS = 200_000
"""Rows of a chunk where none are stated."""

PIECE_ROWS = 49_152
"""Rows that are processed together, at least; four times what the filters need around them, where that is more. A whole
number of those that are reduced together, which then need not be joined."""

LEAD = 2
"""Pieces that are read, and filtered, before they are asked for."""

SECTION_ROWS = 2_000_000
"""Rows of a section of a log, about: so few that two processes end at about the same time, so many that what each
section costs by itself, such as rows that are read twice, is nothing."""

CHOICE_ROWS = 200_000
"""Rows by which everything is chosen that the data decides: the same rows whatever the size of the chunks, since the
samples must not depend on it."""


@dataclass(frozen=True)
class Chunk:
    """A piece of a log with its surroundings.

    Parameters
    ----------
    recording
        The rows of the chunk and, before and after them, rows of its neighbours (padding), if there are any.
    start, stop
        The chunk's own rows are start:stop of `recording`.
    """

    recording: Recording
    start: int
    stop: int


class LogStream:
    """A log whose length and clock are known, read in overlapping spans with one pass over its files."""

    def __init__(self, source: Source, columns: LogColumns | dict[str, Any] | None, joints: Joints) -> None:
        self.source = source
        self.files = LogFiles(source, log_columns(columns))
        self.columns = self.files.columns
        self.layout = self.files.layout(joints)
        self.clock_origin = self.files.clock_origin(self.layout)
        self.joint_names = names_of(joints)
        self.count = self.files.count()
        if self.count < 3:
            raise InputError(
                f"{self.files.name} has {self.count} row{'s' * (self.count != 1)}; derivatives need three at least."
            )
        self.origin: float | None = None
        self.stated: ClockStatistics | None = None
        rate = self.columns.rate
        if rate is None:
            self.clock = clock_of(ahead(self._ordered_stamps(), LEAD))  # some are decoded meanwhile
            gaps, duration = np.ptp(self.clock.gaps, axis=1), float(np.ptp(self.clock.ticks[[0, -1]]))
            self.rate = rate_between_pauses(self.count, duration, gaps, self.clock.period)
            if self.count >= FEWEST_ROWS:
                rows = ((block.t, block.q) for block in self._recordings())
                self.clock = with_evidence(self.clock, rows)
            return
        self.rate = rate
        self.clock = steady_clock(self.count, 1.0 / rate)
        if self.layout.time is not None:
            stamps = self._stamps()
            first = next(stamps)
            self.origin = float(first[0])
            self.stated = clock_at(rate, itertools.chain([first], stamps)) if self.count >= FEWEST_ROWS else None
        if self.stated is not None:
            # What is left of the stamps is which rows are missing.
            ticks = np.array([0.0, self.stated.numbers(self.count - 1, self.count)[0] / rate])
            gaps, skipped = self.stated.gap_rows, self.stated.skipped
            self.clock = replace(self.clock, gap_rows=gaps, skipped=skipped, gaps=self.stated.gaps, ticks=ticks)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "files": (self.files.places(), self.files.offsets)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.files = LogFiles(self.source, self.columns)
        self.files.keep(self.layout.names)
        places, self.files.offsets = state["files"]
        self.files.use_places(places, self.count)

    def _stamps(self) -> Iterator[np.ndarray[Any, np.dtype[np.float64]]]:
        """Yield the stamps in s, block by block."""
        names, first = self.layout.stamps, 0
        for block in self.files.blocks(names, CLOCK_ROWS):
            require_numbers(block, names, self._where(first), self.files.name, names)
            yield self.layout.seconds(block)
            first += len(block[names[0]])

    def _ordered_stamps(self) -> Iterator[np.ndarray[Any, np.dtype[np.float64]]]:
        last, first = np.empty(0), 0
        for t in self._stamps():
            joined, before = np.concatenate([last, t]), first - len(last)
            check_order(joined, self._where(before), self.files.name)
            last, first = t[-1:], first + len(t)
            yield t

    def _recordings(self) -> Iterator[Recording]:
        first = 0
        for block in self.files.blocks(self.layout.names, CLOCK_ROWS):
            yield self._recording([self._checked(block, first)], first)
            first += column_length(block)

    def spans(self, spans: Iterable[tuple[int, int]]) -> Iterator[Recording]:
        """Read rows first:last of each span, which must be in ascending order; each comes as one recording."""
        held: list[tuple[int, Columns]] = []  # with the number of the first row of each
        blocks: Iterator[Columns] | None = None
        read = 0
        for start, stop in spans:
            held = [(first, block) for first, block in held if first + column_length(block) > start]
            if blocks is None or (not held and start > read + BLOCK_ROWS):
                read = start - start % BLOCK_ROWS  # so that blocks end where those of files do
                blocks = self.files.blocks_from(read, self.layout.names, BLOCK_ROWS)
            while read < stop:
                block = next(blocks, None)
                if block is None:
                    raise InputError(f"{self.files.name} became shorter while it was read; read it again.")
                held.append((read, self._checked(block, read)))
                read += column_length(block)
            parts = [
                {name: values[max(start - first, 0) : stop - first] for name, values in block.items()}
                for first, block in held
                if first < stop and start < first + column_length(block)
            ]
            yield self._recording(parts, start)

    def even(self, processing: Processing) -> EvenClock:
        """Return the clock on which the rows are placed for a processing."""
        return EvenClock(
            self.clock, processing.resample, processing.longest_gap, processing.needs_even_rows, self.files.name
        )

    def middle(self, even: EvenClock, rows: int = DECISION_ROWS) -> Recording:
        """Read the rows by which the processing is decided: those in the middle of the longest part between gaps."""
        longest = max(even.parts, key=lambda part: part.count)
        start = max(0, (longest.count - rows) // 2)
        return self.even_rows(even, longest, start, min(longest.count, start + rows))

    def even_rows(self, even: EvenClock, part: Part, start: int, stop: int) -> Recording:
        """Read the even rows start:stop of a part."""
        span = even.rows(part, start, stop)
        return even.placed(next(self.spans([span])), span[0], part, start, stop)

    def _checked(self, block: Columns, first: int) -> Columns:
        return checked_columns(block, self.layout, self.columns, self._where(first), self.files.name)

    def _where(self, first: int) -> Callable[[int], str]:
        """Return a function that says where a row stands, counted from row `first` of the log."""
        return lambda row: self.files.where(first + row)

    def _recording(self, parts: Sequence[Columns], first: int) -> Recording:
        signals = convert(parts, self.layout, self.columns, self.files.name)
        t, _ = times(signals, self.columns, self.files, first, self.origin, self.stated)
        return Recording(
            **signals_fields(signals, t, self.layout, self.files.name),
            source=self.files.name,
            joint_names=self.joint_names,
            stated_rate=self.rate,
            first_row=first,
            layout=self.layout,
            clock_origin=self.clock_origin,
        )


def read_chunks(
    source: Source,
    columns: LogColumns | dict[str, Any] | None = None,
    rows: int = CHUNK_ROWS,
    joints: Joints = None,
    padding_seconds: float = 0.0,
) -> Iterator[Chunk]:
    """Read a log chunk by chunk, as `Recording.read` would read it whole.

    The file is passed over once to count its rows and find its rate, then once to read it. CSV is read by blocks of
    lines, Parquet by groups of rows and their pages, NPZ by blocks of rows (arrays in Fortran order are read
    whole).

    Parameters
    ----------
    source, columns, joints
        As in `Recording.read`.
    rows
        Rows of a chunk, which bound the memory that is used.
    padding_seconds
        How much of its neighbours each chunk carries before and after its own rows.

    Yields
    ------
    Chunk
        Its recording has the rate of the whole log, and names rows of the file in messages.

    Raises
    ------
    InputError
        As in `Recording.read`. Remarks on the log stand in the last chunk.
    """
    rows = positive_rows(rows)
    if not padding_seconds >= 0.0:
        raise InputError(f"`padding_seconds` is {padding_seconds!r}; it must be a time in s, not negative.")
    stream = LogStream(source, columns, joints)
    check_period(stream.clock.period, stream.files.name)
    # One row at least, so that the order of the times is also checked from chunk to chunk.
    padding = max(1, round(padding_seconds * stream.rate))
    own = [(start, min(start + rows, stream.count)) for start in range(0, stream.count, rows)]
    spans = [(max(0, start - padding), min(stream.count, stop + padding)) for start, stop in own]
    survey = LogSurvey()
    for (start, stop), (first, _), recording in zip(own, spans, stream.spans(spans), strict=True):
        survey.add(recording, start - first, stop - first)
        if first == 0:
            survey.velocity_remarks()  # what is sure to be wrong is refused at once
        if stop == stream.count:
            recording = replace(recording, remarks=survey.remarks())
        yield Chunk(recording, start - first, stop - first)


def read_middle(
    source: Source,
    columns: LogColumns | dict[str, Any] | None = None,
    processing: Processing | None = None,
    rows: int = DECISION_ROWS,
    joints: Joints = None,
) -> Recording:
    """Read the rows in the middle of a log by which its processing is decided (see `decide`).

    Parameters
    ----------
    source, columns, joints
        As in `Recording.read`.
    processing
        How uneven rows are placed on an even clock.
    rows
        How many at most.

    Raises
    ------
    InputError
        As in `Recording.read`.
    """
    return middle_of(LogStream(source, columns, joints), Processing() if processing is None else processing, rows)


def middle_of(stream: LogStream, processing: Processing, rows: int) -> Recording:
    """Return what `read_middle` reads, of a log that is open."""
    check_period(stream.clock.period, stream.files.name)
    return stream.middle(stream.even(processing), positive_rows(rows))


def process_chunks(
    source: Source,
    columns: LogColumns | dict[str, Any] | None = None,
    processing: Processing | None = None,
    rows: int = PIECE_ROWS,
    joints: Joints = None,
    model: Model | None = None,
    look: Callable[[Recording], object] | None = None,
    survey: LogSurvey | None = None,
) -> Iterator[Samples]:
    """Process a log chunk by chunk; together the samples are those of the whole log (to about 1e-9).

    The log is processed in pieces whose ends do not depend on `rows`, so that the samples are the same numbers whatever
    the size of the chunks. Each piece is read with so many rows around it that the transients of the filters have died
    out where its own rows begin; the ends are trimmed and extended at the true ends (and at long gaps) only, and the
    decimation counts from the same row. Memory is bounded by `rows`, by the pieces of 49 152 rows and by the filters'
    transients, whatever the length of the log.

    Parameters
    ----------
    source, columns, joints
        As in `Recording.read`.
    processing
        What to do; what the data decides (`cutoff` and `velocity_threshold`, `delay = "automatic"`, the levels of
        `saturation`, the tolerance of `stiction`) is chosen by 50 000 rows in the middle of the log (of its longest
        part, where gaps split it), and said.
    rows
        Rows of the log in a chunk. By default those that are processed together, so that nothing is joined.
    model
        By which `delay = "automatic"` is estimated; without it by the signals.
    look
        Called once with the first 200 000 rows of the log as they were read.
    survey
        Where what is seen of the whole log is kept, for comparisons after the last chunk.

    Raises
    ------
    InputError
        As in `Recording.read` and `Recording.process`; and for the filter "fourier" and `average`, which need the log
        whole. That a torque is stuck, that nothing moves or that no row is left is only known, and said, at the end.
    """
    rows = positive_rows(rows)
    processing = Processing() if processing is None else processing
    if model is not None and processing.filters_torque:
        rows = min(rows, PIECE_ROWS)  # samples with their regressors take ten times the memory
    survey = LogSurvey() if survey is None else survey
    if processing.needs_whole_log:
        raise InputError(
            f"the filter {processing.filter.kind!r} in [processing] needs the log whole, in memory; read it with "
            "Recording.read and process it, or use another filter."
        )
    opened = OpenedLog(LogStream(source, columns, joints), processing, model, look)
    seen = SeenRows(survey)
    # Pieces are filtered while others are read, and those before them are used.
    pieces = ahead(itertools.chain.from_iterable(_sections(opened, seen)), 1)
    last: Samples | None = None
    used = False
    for chunk in regrouped(pieces, max(1, rows // processing.step)):
        if last is not None:
            yield last
        last = chunk
        used = used or chunk.mask is None or bool(chunk.mask.any())
    if last is not None:
        yield replace(last, remarks=(*last.remarks, *opened.ending(seen, used)))


def _sections(opened: OpenedLog, seen: SeenRows) -> Iterator[Iterator[Samples]]:
    """Yield the samples of each section, and return behind each what threads hold of free memory."""
    for section in range(opened.sections):
        if section:
            from steelyard.graph.large_arrays import return_free_memory  # only long logs need it

            return_free_memory()
        yield opened.samples(section, seen)


@dataclass
class SeenRows:
    """Statistics that are gathered of the rows of a log, or of a section of it, while they are processed.

    Attributes
    ----------
    masked : dict
        How many rows of each joint were masked, by the reason.
    """

    survey: LogSurvey = field(default_factory=LogSurvey)
    masked: dict[str, NDArray[np.intp]] = field(default_factory=dict)

    def mask(self, name: str, counts: NDArray[np.intp]) -> None:
        """Count rows that are masked for a reason."""
        self.masked[name] = self.masked[name] + counts if name in self.masked else counts


NOTHING = 1e-12
"""Weight below which an earlier state of presliding friction is nothing: rounding changes more."""


class OpenedLog:
    """A log of which everything is chosen that the data decides, in sections that can be processed one by one.

    Sections follow from the log alone. Any of them may be processed in another process, to which this object was sent,
    where `can_move`; its samples are the same numbers there.

    Parameters
    ----------
    stream : LogStream
        The log.
    processing, model, look
        As in `process_chunks`.

    Attributes
    ----------
    rate : float
        Of the rows that are filtered, Hz.
    remarks : tuple of str
        What was found and chosen; `samples` brings them with the first of the log.
    """

    def __init__(
        self, stream: LogStream, processing: Processing, model: Model | None, look: Callable[[Recording], object] | None
    ) -> None:
        self.processing = processing
        self.stream = stream
        check_period(stream.clock.period, stream.files.name)
        head = next(stream.spans([(0, min(CHOICE_ROWS, stream.count))]))
        LogSurvey.of(head).velocity_remarks()  # what is sure to be wrong is refused at once
        if look is not None:
            look(head)
        self.first = head.chosen(np.arange(head.count) == 0)
        self.even = even = stream.even(processing)
        self.rate = stream.rate if even.as_is else 1.0 / even.period
        sample = stream.middle(even)
        plan = settle(decide(processing, [sample], model), sample, model)
        if plan.held.mask.any() and sample.count < stream.count:  # they may move in other rows
            starts = range(0, stream.count, CHOICE_ROWS)
            plan = replace(
                plan, held=plan.held.among(stream.spans([(a, min(a + CHOICE_ROWS, stream.count)) for a in starts]))
            )
        self.plan = plan
        excerpt = any(part.count > sample.count == DECISION_ROWS for part in even.parts)
        note = f" (Chosen by {sample.count} of {stream.count} rows.)" if excerpt else ""
        chosen = (remark + note for remark in plan.remarks)
        self.remarks: tuple[str, ...] = (*stream.layout.guesses, *even.remarks, *chosen, *plan.held_remarks(sample))
        step = processing.step
        inner = decimation_padding(processing.decimate)
        inner += -inner % step
        outer = plan.padding(self.rate)
        size = max(PIECE_ROWS, 4 * outer)
        size = max(step, size - size % step)
        kept = plan.kept([part.count for part in even.parts], self.rate, stream.files.name)
        self.pieces = [
            Piece(part, start, min(start + size, end), begin, end, inner, outer)
            for part, (begin, end) in zip(even.parts, kept, strict=True)
            for start in range(begin, end, size)
        ]
        many = sum(piece.stop - piece.start for piece in self.pieces)
        count = max(1, min(round(many / SECTION_ROWS), len(self.pieces)))
        self._bounds = [len(self.pieces) * k // count for k in range(count + 1)]

    def __getstate__(self) -> dict[str, Any]:
        # The plan's model is compiled where it is used.
        return {**self.__dict__, "plan": replace(self.plan, model=None)}

    def use_model(self, model: Model) -> None:
        """Take the model with which the log was opened, as another process has it."""
        self.plan = replace(self.plan, model=model)

    @property
    def sections(self) -> int:
        """How many sections there are: one of a log of up to some three million rows."""
        return len(self._bounds) - 1

    @property
    def can_move(self) -> bool:
        """Whether another process can read a section without reading what is before it."""
        given = split_source(self.stream.source)
        return all(isinstance(one, str | Path) for one in given) and self.stream.files.places() is not None

    def count(self, sections: int | None = None) -> int:
        """Return how many samples so many sections have together; by default all of them."""
        stop = self._bounds[self.sections if sections is None else sections]
        return sum(-((piece.start - piece.stop) // self.processing.step) for piece in self.pieces[:stop])

    def samples(self, section: int, seen: SeenRows, lead: int = LEAD) -> Generator[Samples, None, None]:
        """Yield the samples of a section, piece by piece; what is seen on the way is added to `seen`.

        Rows are read before they are asked for, so many pieces of them; see `ahead`.
        """
        step, plan = self.processing.step, self.plan
        first_piece, stop = self._bounds[section : section + 2]
        pieces = self.pieces[first_piece:stop]
        spans = [self.even.rows(piece.part, piece.first, piece.last) for piece in pieces]
        remembers = plan.model is not None and plan.model.remembers
        known = self._bristles_at(first_piece) if remembers and pieces else None
        stream = ahead(self.stream.spans(spans), lead)
        for number, (piece, span, raw) in enumerate(zip(pieces, spans, stream, strict=True), first_piece):
            seen.survey.add(raw)
            recording = self.even.placed(raw, span[0], piece.part, piece.first, piece.last)
            begin, end = piece.kept
            trimmed = max(0, piece.begin - piece.first), min(piece.end - piece.first, recording.count)
            place = (begin - piece.first, end - piece.first, trimmed)
            if known is None:
                samples, flags = plan.rows(recording, *place)
            else:
                later: list[Callable[[int], KnownBristles]] = []
                samples, flags = plan.rows(recording, *place, known, later)
                known = self._bristles_behind(number, later[0]) if later else self._unknown_at(number + 1)
            first = (piece.start - begin) // step
            own = samples.rows(first, first - (piece.start - piece.stop) // step, with_remarks=number == 0)
            for name, flagged in flags.items():
                seen.mask(name, flagged[first : first + own.count].sum(axis=0))
            yield replace(own, remarks=self.remarks) if number == 0 else own

    def _settled(self, number: int) -> int:
        """Return the row of its part from which on the state of presliding friction in a piece goes on."""
        piece = self.pieces[number]
        return self.plan.settled(piece.first, piece.begin, self.rate)

    def _unknown_at(self, number: int) -> KnownBristles:
        """Return that nothing is known of presliding friction where a piece begins; of none behind the last."""
        if number == len(self.pieces):
            return KnownBristles(0)
        return KnownBristles(self._settled(number) - self.pieces[number].first)

    def _goes_on(self, number: int) -> bool:
        """Whether a piece goes on where the one before ends, with no gap and no trimmed rows between them."""
        return 0 < number < len(self.pieces) and self.pieces[number].start > self.pieces[number].begin

    def _bristles_behind(self, number: int, later: Callable[[int], KnownBristles]) -> KnownBristles:
        """Return what is known of presliding friction where the piece behind a piece begins."""
        if not self._goes_on(number + 1):
            return self._unknown_at(number + 1)
        row = self._settled(number + 1)
        return later(row - self.pieces[number].first)._replace(row=row - self.pieces[number + 1].first)

    def _bristles_at(self, number: int) -> KnownBristles:
        """Return what is known of presliding friction where a section begins, from as many pieces before as count.

        The state behind a piece is linear in that before it, so that each of them is read once, the last one first.
        """
        known, plan = self._unknown_at(number), self.plan
        state, weight = np.zeros(self.first.joint_count), np.ones(self.first.joint_count)
        moving = ~plan.held.mask
        if plan.model is not None:
            moving &= np.isin(np.arange(len(moving)), plan.model.bristles.joints)
        before = number
        while self._goes_on(before) and weight[moving].max(initial=0.0) > NOTHING:
            before -= 1
            piece = self.pieces[before]
            recording = self.stream.even_rows(self.even, piece.part, piece.first, piece.last)
            row = self._settled(before + 1) - piece.first
            found = plan.bristles_after(recording, self._unknown_at(before), row)
            assert found.state is not None
            state, weight = state + weight * found.state, weight * found.weight
        return known if before == number else KnownBristles(known.row, state, weight)

    def ending(self, seen: SeenRows, used: bool) -> tuple[str, ...]:
        """Return what is only known after the last row, and whether any of them is used.

        Raises
        ------
        InputError
            Where none is, a torque is stuck, or nothing moves.
        """
        survey = seen.survey
        if not used:
            rows = sum(part.count for part in self.even.parts)
            duration = float(np.ptp(self.stream.clock.ticks[[0, -1]]))
            raise nothing_left(self.stream.files.name, rows, duration, seen.masked, survey.first_row.joint_names)
        remarks = *survey.remarks(), *masking_remarks(seen.masked, survey.first_row.joint_names)
        low, high = survey.torque
        self.processing.check_torques(survey.first_row, low, high, survey.travel)
        return remarks


@dataclass(frozen=True)
class Piece:
    """Even rows start:stop of a part of a log, which become samples together.

    Trimming keeps the rows begin:end of the part. The piece is decimated with `inner` rows on either side, and filtered
    with `outer` more.
    """

    part: Part
    start: int
    stop: int
    begin: int
    end: int
    inner: int
    outer: int

    @property
    def kept(self) -> tuple[int, int]:
        """Rows begin:end that are decimated."""
        return max(self.begin, self.start - self.inner), min(self.end, self.stop + self.inner)

    @property
    def first(self) -> int:
        """The first row that is read."""
        return max(0, self.kept[0] - self.outer)

    @property
    def last(self) -> int:
        """The row behind the last one that is read."""
        return min(self.part.count, self.kept[1] + self.outer)


def positive_rows(rows: int, name: str = "rows") -> int:
    """Return a number of rows, which records can hold as 64 bits; refuse any other."""
    if not isinstance(rows, int) or isinstance(rows, bool) or not 1 <= rows < LARGEST_INTEGER:
        raise InputError(f"`{name}` is {shown(rows)}; it must be a whole number from 1.")
    return rows
