"""Options of the commands that read many logs: checkpoints, processes, and a cluster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from steelyard.errors import InputError

if TYPE_CHECKING:
    from steelyard.fleet import Checkpoints, Executor, LogReduction

__all__ = ["Kept", "executor_of", "many_logs"]


class Kept(NamedTuple):
    """The checkpoints of a run, and what reduces its logs with them."""

    checkpoints: Checkpoints
    reduction: LogReduction


def executor_of(workers: int, cluster: str | None, tls: Sequence[str] | None) -> Executor | None:
    """Return where the options say that logs are reduced; None in this process.

    Raises
    ------
    InputError
        If they contradict each other.
    """
    if tls and cluster is None:
        raise InputError(
            "--tls secures the connection to a cluster, and none is given; give its address with --cluster."
        )
    if cluster is None and workers == 1:
        return None
    from steelyard.fleet import Cluster, Workers

    if cluster is None:
        return Workers(workers)
    if workers != 1:
        raise InputError("--workers are processes of this machine, and --cluster has its own; give one or the other.")
    pairs = dict(one.partition("=")[::2] for one in tls or ())
    if not set(pairs) <= {"ca_file", "cert", "key"} or not all(pairs.values()):
        raise InputError(
            f"--tls must be ca_file=, cert= or key= and the path of a PEM file, got {' '.join(tls or ())}."
        )
    return Cluster(cluster, pairs)


def many_logs(
    output: Path, logs: Sequence[str], workers: int, cluster: str | None, tls: Sequence[str] | None
) -> AbstractContextManager[Kept] | None:
    """Return what reduces logs with checkpoints in the folder of the results; None for one log in this process."""
    executor = executor_of(workers, cluster, tls)
    from steelyard.fleet.checkpoints import has_checkpoints
    from steelyard.identification.given import may_be_several

    one = len(logs) == 1 and not may_be_several(logs[0])
    if executor is None and one and not has_checkpoints(output):
        return None
    return _many_logs(output, executor)


@contextmanager
def _many_logs(output: Path, executor: Executor | None) -> Iterator[Kept]:
    from steelyard.fleet import Checkpoints, LogReduction

    with Checkpoints(output) as checkpoints:
        yield Kept(checkpoints, LogReduction(executor, checkpoints))
