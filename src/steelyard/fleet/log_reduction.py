"""Logs become Informations where they lie; their sums are the same whatever ran where, and are kept on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from steelyard.dynamics import Model
from steelyard.dynamics.threads import TOGETHER
from steelyard.errors import InputError
from steelyard.files import tell
from steelyard.identification.log_reader import (
    JoinedSections,
    LogReader,
    LogTask,
    Progress,
    ReducedGroup,
    ReducedSection,
    SectionedLog,
)
from steelyard.recording import chunks
from steelyard.recording.formats import contents_of, unchanged
from steelyard.recording.formats.csv_file import CsvFile
from steelyard.recording.formats.hashes import LogContent
from steelyard.recording.formats.registry import log_format, split_source

from .checkpoints import Checkpoints, checkpoint_key, robot_content
from .executors import Cluster, Combine, Executor, Here, Leaf
from .packed import is_whole, packed, unpacked

__all__ = ["LogReduction", "run_in_order"]

GROUP, MANY = 8, 64
"""Logs whose batch means, nine tenths of an Information, are added where they were computed, and from how many on. Up
to that each log is a checkpoint by itself. Both follow from the logs alone, so that a run which began on one machine
ends on a cluster, and takes over what it had done."""


LARGE = 32_000_000
"""Bytes of a log from which on it is opened here, to be shared section by section; it may have three million rows."""
SHARED_PART = 0.25
"""The share of the bytes of all logs that a log must have to be opened here. Opening a text takes a fifth of what
reading and reducing it takes, and is done by this process alone: of four equal logs it takes as long as one worker
needs for one of them, and of more the other workers wait longer for it than for the last log."""
HEAD = 1 << 16  # bytes by which the rows of a text are guessed


class _Common:
    """The arguments that the reductions of all the logs have in common."""

    def __init__(self, reader: LogReader, reduced_by: Model) -> None:
        self.file, self.chunk_rows = reader.file, reader.chunk_rows
        self.processing, self.decided = reader.processing, reader.decided
        self.robots = reader.model.robot, reduced_by.robot
        self.models = reader.model, reduced_by

    def __getstate__(self) -> dict[str, Any]:
        # Compiled code stays where it was compiled.
        return {
            "state": (
                self.file,
                self.chunk_rows,
                self.processing,
                self.decided,
                self.robots,
                self.models[0] is self.models[1],
            )
        }

    def __setstate__(self, told: dict[str, Any]) -> None:
        self.file, self.chunk_rows, self.processing, self.decided, self.robots, same = told["state"]
        model = Model(self.robots[0])
        self.models = model, model if same else Model(self.robots[1])

    def reader(self) -> LogReader:
        reader = LogReader(self.file, self.models[0], self.chunk_rows)
        reader.processing, reader.decided = self.processing, self.decided
        return reader

    def key(self) -> str:
        """Name everything but the logs that the result follows from."""
        robots = [robot_content(model.robot) for model in self.models]
        kinds = [[type(term).__qualname__ for term in model.robot.terms] for model in self.models]
        log = self.file.section("log")
        return checkpoint_key(robots, kinds, log, self.processing.to_dict(), self.chunk_rows)


class SectionTask(NamedTuple):
    """A section of a long log that is to be reduced."""

    log: SectionedLog
    section: int


class HashedTask(NamedTuple):
    """A task, and the content of its log, as which alone it is read."""

    given: LogTask | SectionTask
    content: LogContent


def reduced_log(common: _Common, task: LogTask | SectionTask | HashedTask) -> bytes:
    """Reduce a log, or a section of one; see `LogReader`. Of a log that cannot be used it is told why."""
    given, contents = (task.given, [task.content]) if isinstance(task, HashedTask) else (task, [])
    try:
        with unchanged(contents):
            if isinstance(given, SectionTask):
                return packed(common.reader().reduced_section(given.log, given.section, common.models[1]))
            return packed(common.reader().reduced(given, common.models[1]))
    except InputError as error:  # which would end the run, and leave the other logs unread
        return _refused({str(_log_task(given).log): str(error)})


_UNUSABLE = b"unusable\n"


def _refused(reasons: Mapping[str, str]) -> bytes:
    """Return in place of what came of logs why they cannot be used."""
    return _UNUSABLE + packed(dict(reasons))


def _reasons(content: bytes) -> dict[str, str]:
    """Return why logs cannot be used; nothing where something came of them."""
    return dict(unpacked(content.removeprefix(_UNUSABLE))) if content.startswith(_UNUSABLE) else {}


def grouped(common: Any, results: Sequence[bytes]) -> bytes:
    """Join reduced logs, in order, to a group; add their batch means. A section stands alone."""
    unusable = {log: reason for one in results for log, reason in _reasons(one).items()}
    if unusable:
        return _refused(unusable)
    found = [unpacked(one) for one in results]
    if isinstance(found[0], ReducedSection):
        return results[0]
    group = ReducedGroup.of(found)
    return packed((list(group.logs), group.batch_means))


def hashed(common: Any, task: str) -> bytes:
    """Hash the files of a log."""
    return packed([tuple(one) for one in contents_of([task])])


def first_of(common: Any, results: Sequence[bytes]) -> bytes:
    """Return the only result of a group."""
    return results[0]


class LogReduction:
    """Reduces the logs of an identification in several processes or on a cluster, with checkpoints.

    Parameters
    ----------
    executor : Executor, optional
        Where: :class:`Workers` or :class:`Cluster`; in this process by default.
    checkpoints : Checkpoints, optional
        Where finished logs are kept, within its ``with`` block; what is there already is not computed again. They are
        known by the content of the logs, the robot, the options and the versions of what computes them.

    Notes
    -----
    The bytes of the result are those of one process, whatever the number of workers, which of them was slow or died,
    and however often the run was killed and begun again: each log is reduced by itself, and sums are formed in pairs,
    pairs of pairs and so on in the order of the logs. This holds on processors of one kind; linear algebra rounds
    differently on others.

    Examples
    --------
    >>> import numpy as np, tempfile, pathlib
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 0.3, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    >>> t, folder = np.arange(0.0, 8.0, 0.01), pathlib.Path(tempfile.mkdtemp())
    >>> for k in (1, 2):
    ...     q = 0.8 * np.sin(3 * t) + np.sin((1 + k / 10) * t)
    ...     acceleration = -7.2 * np.sin(3 * t) - (1 + k / 10) ** 2 * np.sin((1 + k / 10) * t)
    ...     table = np.column_stack([t, q, 0.6 * acceleration + 5.0 * np.cos(q)])
    ...     np.savetxt(folder / f"run{k}.csv", table, header="t,q1,tau1", delimiter=",", comments="")
    >>> with sy.fleet.Checkpoints(folder / "result") as kept:
    ...     reduction = sy.fleet.LogReduction(checkpoints=kept)
    ...     result = sy.identify(robot, str(folder / "run*.csv"), reduction=reduction)
    ...     len(kept.names), result.prediction.word
    (2, 'good')
    """

    def __init__(self, executor: Executor | None = None, checkpoints: Checkpoints | None = None) -> None:
        self.executor = executor
        self.checkpoints = checkpoints

    def __call__(
        self, reader: LogReader, tasks: Sequence[LogTask], model: Model, say: Progress
    ) -> Iterator[ReducedGroup]:
        """See `steelyard.identification.log_reader.LogReduction`."""
        common = _Common(reader, model)
        size = GROUP if len(tasks) > MANY else 1
        groups: list[list[LogTask | SectionTask]] = []
        least = max(LARGE, SHARED_PART * sum(_size(str(task.log)) for task in tasks if _is_path(task.log)))
        for start in range(0, len(tasks), size):
            log = None
            if size == 1 and tasks[start].log not in reader.unusable:
                with reader.unusable.noting(tasks[start].log, len(tasks), say):
                    log = self._sectioned(reader, tasks[start], model, say, least)
            if size == 1 and tasks[start].log in reader.unusable:
                continue  # as was found out here
            if log is None:
                groups.append(list(tasks[start : start + size]))
            else:
                groups += [[SectionTask(log, section)] for section in range(log.sections)]
        # What is in memory here is reduced here.
        local = [not all(_is_path(_log_task(task).log) for task in group) for group in groups]
        contents = self._contents(groups, local, say)
        keys = self._keys(common, groups, local, contents)
        hashed_groups = [[_with_content(task, contents) for task in group] for group in groups]
        say(f"reading {len(tasks)} log{'s' * (len(tasks) > 1)}")
        # Of whole logs one is in memory at a time.
        executor = self.executor or Here(1 if reader.processing.needs_whole_log else TOGETHER)
        done, joined = 0, None
        found_groups = run_in_order(
            reduced_log, grouped, common, hashed_groups, executor, keys, self.checkpoints, local, _is_usable
        )
        unusable = reader.unusable
        for (first, *_), content in zip(groups, found_groups, strict=True):
            for name, reason in _reasons(content).items():
                with unusable.noting(name, len(tasks), say):
                    raise InputError(self._whose + reason)
            if unusable:  # nothing comes of the set any more; the others are looked through, and kept
                continue
            if isinstance(first, SectionTask):
                joined = JoinedSections(first.log, model) if first.section == 0 or joined is None else joined
                joined.add(unpacked(content).for_model(model))
                if first.section + 1 < first.log.sections:
                    continue
                with unusable.noting(first.log.task.log, len(tasks), say):
                    found = ReducedGroup.of([joined.reduced()])
                if unusable:
                    continue
            else:
                logs, means = unpacked(content)
                found = ReducedGroup(tuple(log.for_model(model) for log in logs), means)
            done += len(found.logs)
            tell("reading logs", done, len(tasks), "logs")
            yield found
        unusable.refuse([task.log for task in tasks])

    @property
    def _whose(self) -> str:
        """What a reason begins with, for the machines of a cluster may have other files."""
        if isinstance(self.executor, Cluster):
            return f"On a worker of the cluster at {self.executor.address}: "
        return ""

    def _sectioned(
        self, reader: LogReader, task: LogTask, model: Model, say: Progress, least: float
    ) -> SectionedLog | None:
        """Open a log of so many bytes at least that may be so long that others can share its sections; None of others.

        What is opened follows from the logs alone, so that checkpoints serve any number of workers.
        """
        if not _is_path(task.log) or _size(str(task.log)) < least or not _may_be_shared(str(task.log)):
            return None
        say(f"opening {task.log}")
        log = reader.opened(task, model)
        return log if log is not None and log.opened.can_move else None

    def _contents(
        self, groups: Sequence[Sequence[LogTask | SectionTask]], local: Sequence[bool], say: Progress
    ) -> dict[str, LogContent]:
        """Hash the logs that are not in memory, where there are checkpoints."""
        if self.checkpoints is None:
            return {}
        apart = [group for group, here in zip(groups, local, strict=True) if not here]
        names = list(dict.fromkeys(str(_log_task(task).log) for group in apart for task in group))
        say(f"hashing {len(names)} log{'s' * (len(names) > 1)}")
        # Processes of this machine would take longer to start than files to be hashed.
        where = self.executor if isinstance(self.executor, Cluster) else Here(TOGETHER)
        hashes = run_in_order(hashed, first_of, None, [[name] for name in names], where)
        return {name: LogContent(*unpacked(one)[0]) for name, one in zip(names, hashes, strict=True)}

    def _keys(
        self,
        common: _Common,
        groups: Sequence[Sequence[LogTask | SectionTask]],
        local: Sequence[bool],
        contents: Mapping[str, LogContent],
    ) -> list[str | None]:
        """Name what each group of logs comes to; None of those that are in memory."""
        if self.checkpoints is None:
            return [None] * len(groups)
        shared = common.key()

        def told(given: LogTask | SectionTask) -> list[Any]:
            task = _log_task(given)
            what = [str(task.log), contents[str(task.log)].hashes, task.points, task.rows, task.logs, task.fitted]
            return [*what, given.section, given.log.sections] if isinstance(given, SectionTask) else what

        return [
            None if here else checkpoint_key(shared, [told(task) for task in group])
            for group, here in zip(groups, local, strict=True)
        ]


def _is_usable(content: bytes) -> bool:
    return not content.startswith(_UNUSABLE)


def _with_content(
    task: LogTask | SectionTask, contents: Mapping[str, LogContent]
) -> LogTask | SectionTask | HashedTask:
    content = contents.get(str(_log_task(task).log))
    return task if content is None else HashedTask(task, content)


def _log_task(task: LogTask | SectionTask) -> LogTask:
    return task.log.task if isinstance(task, SectionTask) else task


def _size(log: str) -> int:
    """Return the bytes of the files of a log; 0 where any of them is not on this machine."""
    if "://" in log:
        return 0
    try:
        return sum(Path(str(path)).stat().st_size for path in split_source(log))
    except OSError:
        return 0


def _may_be_shared(log: str) -> bool:
    """Whether the files of a log, none of them opened, are of formats that are read from the middle, and long."""
    paths = [Path(str(path)) for path in split_source(log)]
    kinds = [log_format(path.suffix) for path in paths]
    if not all(kind is not None and kind.may_have_places(path) for kind, path in zip(kinds, paths, strict=True)):
        return False
    return all(
        _rows_of_text(path) >= 1.5 * chunks.SECTION_ROWS
        for path, kind in zip(paths, kinds, strict=True)
        if kind is CsvFile
    )


def _rows_of_text(path: Path) -> float:
    """Guess the rows of a text from the lengths of its first lines, on the side of too many."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    lengths = [len(line) for line in head.splitlines(keepends=True)[:-1]]
    # A quarter of the lines may be shorter: a first line of names, and comments, are longer than rows.
    usual = sorted(lengths)[len(lengths) // 4] if lengths else 1
    return path.stat().st_size / usual


def _is_path(log: object) -> bool:
    return isinstance(log, (str, Path)) and str(log) != "-"


def run_in_order(
    leaf: Leaf,
    combine: Combine,
    common: Any,
    groups: Sequence[Sequence[Any]],
    executor: Executor,
    keys: Sequence[str | None] | None = None,
    checkpoints: Checkpoints | None = None,
    local: Sequence[bool] | None = None,
    keep: Callable[[bytes], bool] = lambda _: True,
) -> Iterator[bytes]:
    """Yield what groups of tasks come to, in their order; take what checkpoints have, and give them what is done.

    Parameters
    ----------
    leaf, combine, common, groups
        As in `Executor.run`.
    executor : Executor
    keys : sequence of str or None, optional
        Under which the results are kept; None for those that are not.
    checkpoints : Checkpoints, optional
    local : sequence of bool, optional
        Which groups are to run in this process.
    keep : callable, optional
        Whether a result is given to the checkpoints; all are by default.
    """
    if keys is None or checkpoints is None:
        keys = [None] * len(groups)
    local = [False] * len(groups) if local is None else local
    done = {n for n, key in enumerate(keys) if key is not None and is_whole(_kept(checkpoints, key))}
    elsewhere = [n for n in range(len(groups)) if n not in done and not local[n]]
    held: dict[int, bytes] = {}
    with closing(executor.run(leaf, combine, common, [groups[n] for n in elsewhere])) as running:
        for number, group in enumerate(groups):
            if local[number]:
                yield next(Here().run(leaf, combine, common, [group]))[1]
                continue
            while number not in done:
                place, content = next(running)
                found = elsewhere[place]
                done.add(found)
                key = keys[found]
                if key is None or checkpoints is None or not keep(content):
                    held[found] = content
                    continue
                checkpoints.put(key, content)
                if found == number:
                    held[found] = content  # others are read again when their turn comes: memory stays bounded
            key = keys[number]
            yield held.pop(number) if number in held or key is None else _kept(checkpoints, key)


def _kept(checkpoints: Checkpoints | None, key: str) -> bytes:
    return (checkpoints.get(key) if checkpoints is not None else None) or b""
