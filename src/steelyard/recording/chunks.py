"""Logs larger than memory, chunk by chunk, with the same samples as if they were read whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.errors import InputError
from steelyard.recording.checks import measured_velocity
from steelyard.recording.columns import TIME_UNITS, LogColumns
from steelyard.recording.conversion import Signals, convert
from steelyard.recording.filtering import decimation_padding
from steelyard.recording.header import resolve
from steelyard.recording.log_file import BLOCK_ROWS, LogFiles
from steelyard.recording.plan import Plan, said
from steelyard.recording.processing import Processing
from steelyard.recording.recording import Recording, Source, log_columns, names_of, signals_fields, times
from steelyard.recording.samples import Samples
from steelyard.recording.timing import check_even, check_period

if TYPE_CHECKING:
    from steelyard.dynamics import Model

__all__ = ["Chunk", "process_chunks", "read_chunks"]

CHUNK_ROWS = 200_000


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


@dataclass(frozen=True)
class Span:
    """Rows start:stop of a log, read with the rows from `first` to `last` (excluded) around them."""

    first: int
    start: int
    stop: int
    last: int


class LogStream:
    """A log whose length and rate are known, read in overlapping spans with one pass over its files."""

    def __init__(
        self, source: Source, columns: LogColumns | dict[str, Any] | None, joints: int | Sequence[str] | None
    ) -> None:
        self.columns = log_columns(columns)
        self.files = LogFiles(source)
        self.layout = resolve(self.files.names, self.columns, joints, self.files.name)
        self.joint_names = names_of(joints)
        self.count = self.files.count()
        if self.count < 3:
            raise InputError(f"{self.files.name} has {self.count} rows; derivatives need three at least.")
        self.origin: float | None = None
        if self.layout.time is not None:
            first, last = (end * TIME_UNITS[self.layout.time_unit] for end in self.files.ends(self.layout.time))
            self.origin = first
        if self.columns.rate is not None:
            self.rate = self.columns.rate
        else:
            if not last > first:
                raise InputError(
                    f"{self.files.name} begins at {first:.9g} s and ends at {last:.9g} s; the times must increase: "
                    "sort the rows, or split the log where a new run begins."
                )
            self.rate = (self.count - 1) / (last - first)

    def spans(self, spans: Sequence[Span]) -> Iterator[Recording]:
        """Read the spans, which must be in ascending order; each comes as one recording, surroundings included."""
        blocks = self.files.blocks(self.layout.names, BLOCK_ROWS)
        held: Signals | None = None
        first = read = 0
        for span in spans:
            if held is not None:
                held, first = held.rows(span.first - first, read - first), span.first
            while read < span.last:
                block = next(blocks, None)
                if block is None:
                    raise InputError(f"{self.files.name} became shorter while it was read; read it again.")
                fresh = self._converted(block, read)
                count = fresh.q.shape[0]
                # What lies before the first span is never needed again.
                unused = min(max(span.first - read, 0), count) if held is None or held.q.shape[0] == 0 else 0
                if held is None or held.q.shape[0] == 0:
                    held, first = fresh.rows(unused, count), read + unused
                else:
                    held = held.joined(fresh)
                read += count
            assert held is not None
            yield self._recording(held.rows(span.first - first, span.last - first), span.first)

    def _converted(self, block: Any, first: int) -> Signals:
        where = lambda row: self.files.where(first + row)  # noqa: E731
        return convert(block, self.layout, self.columns, where, self.files.name)

    def _recording(self, signals: Signals, first: int) -> Recording:
        t, _ = times(signals, self.columns, self.files, first, self.origin)
        return Recording(
            **signals_fields(signals, t, self.files.name),
            source=self.files.name,
            joint_names=self.joint_names,
            stated_rate=self.rate,
            first_row=first,
        )


def read_chunks(
    source: Source,
    columns: LogColumns | dict[str, Any] | None = None,
    joints: int | Sequence[str] | None = None,
    rows: int = CHUNK_ROWS,
    padding_seconds: float = 0.0,
) -> Iterator[Chunk]:
    """Read a log chunk by chunk, as `Recording.read` would read it whole.

    The file is passed over once to count its rows and find its rate, then once to read it. CSV is read by blocks of
    lines, Parquet by slices (a row group is decoded whole), NPZ by blocks of rows (arrays in Fortran order are read
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
        As in `Recording.read`; measured velocities are compared with the positions in the first chunk only.
    """
    rows = _positive_rows(rows)
    if not padding_seconds >= 0.0:
        raise InputError(f"`padding_seconds` is {padding_seconds!r}; it must be a time in s, not negative.")
    stream = LogStream(source, columns, joints)
    # One row at least, so that the order of the times is also checked from chunk to chunk.
    padding = max(1, round(padding_seconds * stream.rate))
    spans = [
        _padded(start, min(start + rows, stream.count), padding, 0, stream.count)
        for start in range(0, stream.count, rows)
    ]
    for span, recording in zip(spans, stream.spans(spans), strict=True):
        if span.start == 0:
            check_period(recording.t, recording.source)
            recording = replace(recording, remarks=measured_velocity(recording))
        yield Chunk(recording, span.start - span.first, span.stop - span.first)


def process_chunks(
    source: Source,
    columns: LogColumns | dict[str, Any] | None = None,
    processing: Processing | None = None,
    rows: int = CHUNK_ROWS,
    joints: int | Sequence[str] | None = None,
    model: Model | None = None,
    look: Callable[[Recording], object] | None = None,
) -> Iterator[Samples]:
    """Process a log chunk by chunk; together the samples are those of the whole log (to about 1e-9).

    Each chunk is read with so many rows around it that the transients of the filters have died out where its own rows
    begin; the ends are trimmed and extended at the true ends only, and the decimation counts from the same row. Memory
    is bounded by `rows` and the filters' transients, whatever the length of the log.

    Parameters
    ----------
    source, columns, joints
        As in `Recording.read`.
    processing
        What to do; what the data decides (`cutoff = "automatic"` or "auto", `delay = "automatic"`, the levels of
        `saturation`, the tolerance of `stiction`) is chosen by the first `rows` rows of the log, and said.
    rows
        Rows of the log in a chunk.
    model
        By which `delay = "automatic"` is estimated; without it by the signals.
    look
        Called once with the first `rows` rows of the log as they were read.

    Raises
    ------
    InputError
        As in `Recording.read` and `Processing.apply`; and for `resample`, the filter "fourier" and `average`, which
        need the log whole. That a torque is stuck or that nothing moves is only known, and said, at the end.
    """
    rows = _positive_rows(rows)
    processing = Processing() if processing is None else processing
    if processing.resample is not False:
        raise InputError("`resample` in [processing] needs the log whole; read it whole, or resample it beforehand.")
    if processing.needs_whole_log:
        raise InputError(
            f"the filter {processing.filter.kind!r} in [processing] needs the log whole, in memory; read it with "
            "Recording.read and process it, or use another filter."
        )
    stream = LogStream(source, columns, joints)
    begin, end = processing.kept_rows(stream.count, stream.rate, stream.files.name)
    head = next(stream.spans([Span(0, 0, 0, min(rows, stream.count))]))
    check_period(head.t, head.source)
    if look is not None:
        look(head)
    plan = Plan.settled(processing, head, model)
    chosen = tuple(f"{remark} (Chosen by the first {head.count} rows.)" for remark in plan.remarks)
    remarks = (*measured_velocity(head), *chosen)
    inner = decimation_padding(processing.decimate)
    inner += -inner % processing.step
    outer = plan.padding(stream.rate)
    step = processing.step
    size = max(step, rows - rows % step)
    own = [(start, min(start + size, end)) for start in range(begin, end, size)]
    kept = [(max(begin, start - inner), min(end, stop + inner)) for start, stop in own]
    spans = [_padded(first, last, outer, 0, stream.count) for first, last in kept]
    extremes = _Extremes()
    counts: dict[str, Any] = {}
    even = not plan.filter.takes_uneven_times or bool(processing.decimate) or processing.torque_cutoff is not None
    even = even or bool(np.any(plan.delay != 0.0))
    for (start, stop), span, recording in zip(own, spans, stream.spans(spans), strict=True):
        extremes.add(recording)
        notes = (*remarks, *(check_even(recording) if even else ()))
        samples, flags = plan.rows(recording, span.start - span.first, span.stop - span.first)
        remarks = ()
        cut = slice((start - span.start) // step, (start - span.start) // step + -(-(stop - start) // step))
        for name, flagged in flags.items():
            counts[name] = counts.get(name, 0) + flagged[cut].sum(axis=0)
        if stop == end:
            notes = (*notes, *said(counts))
        yield Samples(
            q=samples.q[cut],
            dq=samples.dq[cut],
            ddq=samples.ddq[cut],
            torque=samples.torque[cut],
            mask=None if samples.mask is None else samples.mask[cut],
            t=None if samples.t is None else samples.t[cut],
            remarks=notes,
            cutoff_choice=samples.cutoff_choice if start == begin else None,
        )
    extremes.judge(processing, head)


class _Extremes:
    """Extremes of torques and positions over all chunks."""

    def __init__(self) -> None:
        self.torque = self.q = np.empty((2, 0))

    def add(self, recording: Recording) -> None:
        self.torque = self._widened(self.torque, recording.torque)
        self.q = self._widened(self.q, recording.q)

    def judge(self, processing: Processing, recording: Recording) -> None:
        travel = self.q[1] - self.q[0]
        if not travel.any():
            raise InputError(f"{recording.source}: no joint moves; check `position` in [log], or record a motion.")
        processing.check_torques(recording, self.torque[0], self.torque[1], travel)

    @staticmethod
    def _widened(extremes: np.ndarray[Any, Any], values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        low, high = values.min(axis=0), values.max(axis=0)
        if extremes.shape[1]:
            low, high = np.minimum(low, extremes[0]), np.maximum(high, extremes[1])
        return np.stack([low, high])


def _padded(start: int, stop: int, padding: int, first: int, last: int) -> Span:
    return Span(max(first, start - padding), start, stop, min(last, stop + padding))


def _positive_rows(rows: int) -> int:
    if not isinstance(rows, int) or isinstance(rows, bool) or rows < 1:
        raise InputError(f"`rows` is {rows!r}; it must be a whole number from 1.")
    return rows
