"""Executors, which run tasks in this process, in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import multiprocessing
import os
import signal
import socket
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from pathlib import Path
from typing import Any, Protocol, cast

from steelyard import __version__
from steelyard.dynamics.threads import in_one_thread, in_turns, serial
from steelyard.errors import InputError, SteelyardError, require_package
from steelyard.files.reading import shown

__all__ = ["Cluster", "Executor", "Here", "Workers"]

Leaf = Callable[[Any, Any], bytes]
Combine = Callable[[Any, Sequence[bytes]], bytes]
Task = Any
Results = Generator[tuple[int, bytes], None, None]
_Place = tuple[int, int]  # a group, and a task in it
_ATTEMPTS = 5
"""How often a task is tried whose process dies; one that needs more memory than there is dies every time."""
_IN_FLIGHT = 4
"""Tasks that wait for each worker of a cluster: enough that none is idle, few enough that no results pile up."""


class Executor(Protocol):
    """Something that runs functions of tasks."""

    def run(self, leaf: Leaf, combine: Combine, common: Any, groups: Sequence[Sequence[Task]]) -> Results:
        """Yield for each group its number and what `combine` makes of what `leaf` makes of its tasks, in any order.

        The results are functions of the tasks alone: neither the number of workers, nor which of them ran a task, how
        long it took, or how often it was tried changes a byte.

        Parameters
        ----------
        leaf : callable
            ``leaf(common, task) -> bytes``, a function of a module.
        combine : callable
            ``combine(common, results) -> bytes``, likewise, of the results in the order of the tasks.
        common : object
            What all tasks have in common; it is sent to each worker once.
        groups : sequence of sequence
            Tasks, in groups.
        """
        ...


@in_one_thread
def _leaf(leaf: Leaf, common: Any, task: Task) -> bytes:
    return leaf(common, task)


def _leaf_of_many(leaf: Leaf, common: Any, task: Task) -> bytes:
    """Run a task in a worker, of which there are as many as cores: its sums leave the cores of the others alone."""
    with serial():
        return leaf(common, task)


@in_one_thread
def _combined(combine: Combine, common: Any, *results: bytes) -> bytes:
    return combine(common, results)


def _given(common: Any) -> Any:
    return common


class Here:
    """Runs tasks in this process, so many groups of them at a time, where linear algebra may use as many threads."""

    def __init__(self, threads: int = 1) -> None:
        self.threads = threads

    def run(self, leaf: Leaf, combine: Combine, common: Any, groups: Sequence[Sequence[Task]]) -> Results:
        """See `Executor.run`."""

        def found(number: int) -> bytes:
            return _combined(combine, common, *(_leaf(leaf, common, task) for task in groups[number]))

        yield from enumerate(in_turns(found, len(groups), self.threads))

    def __repr__(self) -> str:
        return "Here()"


class Workers:
    """Runs tasks in processes of this machine.

    A process that dies is replaced, and its tasks are done again. All of them end with this process, however it ends.

    Parameters
    ----------
    count : int
        How many.

    Examples
    --------
    >>> Workers(2)
    Workers(2)
    """

    def __init__(self, count: int) -> None:
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= 1024:
            raise InputError(f"The number of workers must be a whole number from 1 to 1024, got {shown(count)}.")
        self.count = count

    def __repr__(self) -> str:
        return f"Workers({self.count})"

    def run(self, leaf: Leaf, combine: Combine, common: Any, groups: Sequence[Sequence[Task]]) -> Results:
        """See `Executor.run`."""
        results: list[list[bytes | None]] = [[None] * len(group) for group in groups]
        waiting = [(number, place) for number, group in enumerate(groups) for place in range(len(group))][::-1]
        attempts: Counter[_Place] = Counter()
        running: list[_Process] = []
        try:
            while waiting or any(one.place for one in running):
                begun = [_Process() for _ in range(min(self.count - len(running), len(waiting)))]
                for one in begun:  # when all of them load their modules
                    one.send((leaf, common))
                running += begun
                _give(running, waiting, groups)
                found: list[tuple[_Place, bytes]] = []
                for one in _answering(running):
                    place, one.place = one.place, None
                    assert place is not None
                    try:
                        result = one.receive()
                    except (EOFError, OSError):  # it died, perhaps in the midst of what it sent
                        running.remove(one)
                        one.end()
                        attempts[place] += 1
                        if attempts[place] == _ATTEMPTS:
                            raise InputError(
                                f"A process of the {self.count} workers ended by itself {_ATTEMPTS} times at the same "
                                "log, as the system ends those that take too much memory; give fewer workers, or "
                                "smaller --chunk-rows."
                            ) from None
                        waiting.append(place)
                        continue
                    if isinstance(result, BaseException):
                        raise result
                    found.append((place, result))
                _give(running, waiting, groups)  # before results are used, so that nobody waits for that
                for (number, index), result in found:
                    results[number][index] = result
                    whole = [each for each in results[number] if each is not None]
                    if len(whole) == len(groups[number]):
                        results[number] = []
                        yield number, _combined(combine, common, *whole)
        finally:
            for one in running:
                one.end()


class _Process:
    """A process of this machine that does one task after the other, at the other end of a pipe of its own.

    Those of `concurrent.futures.ProcessPoolExecutor` share a pipe and its lock: where one is killed in the midst of a
    result, as a system that lacks memory does, that reads for the rest of it for ever.

    Attributes
    ----------
    place : tuple of int, optional
        The group, and the place in it, of the task that it does.
    """

    place: _Place | None = None

    def __init__(self) -> None:
        # Each process begins anew: one that is forked from threads of BLAS and Polars may wait for ever.
        context = multiprocessing.get_context("spawn")
        self.connection, its_end = context.Pipe()
        with its_end, _begun_deaf():
            self._process = context.Process(target=_work, args=(its_end,), daemon=True)
            self._process.start()

    def send(self, what: Any) -> None:
        with contextlib.suppress(OSError):  # where it is dead, receiving says so
            self.connection.send(what)

    def receive(self) -> bytes | BaseException:
        return cast("bytes | BaseException", self.connection.recv())

    def end(self) -> None:
        self.connection.close()
        self._process.kill()
        self._process.join()


def _give(running: Sequence[_Process], waiting: list[_Place], groups: Sequence[Sequence[Task]]) -> None:
    """Give each process that has no task one of those that wait, if there are any."""
    for one in running:
        if waiting and one.place is None:
            one.place = waiting.pop()
            one.send(groups[one.place[0]][one.place[1]])


def _answering(running: Sequence[_Process]) -> list[_Process]:
    """Wait for results, or for ends, of processes that have a task."""
    ready = wait_for([one.connection for one in running if one.place is not None])
    return [one for one in running if one.connection in ready]


@contextlib.contextmanager
def _begun_deaf() -> Iterator[None]:
    """Let processes begin that Ctrl-C does not reach, which this one sees to: they would print traces as they load."""
    if os.name != "posix":
        yield
        return
    resource_tracker.ensure_running()  # which lets signals through once it has begun
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(connection: Connection) -> None:
    """Do the tasks that come through the connection, until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # which the parent sees to
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    with contextlib.suppress(EOFError, OSError):
        leaf, common = connection.recv()
        while True:
            connection.send(_done(leaf, common, connection.recv()))


def _done(leaf: Leaf, common: Any, task: Task) -> bytes | Exception:
    try:
        return _leaf_of_many(leaf, common, task)
    except (SteelyardError, OSError, MemoryError) as error:
        return error
    except Exception:  # which may not stand being sent
        return RuntimeError("In a process of the workers:\n" + traceback.format_exc())


def _end_with(sentinel: int) -> None:
    wait_for([sentinel])
    os._exit(1)


class Cluster:
    """Runs tasks on a Dask cluster: each where its log can be read, and the sums of groups on the workers, too.

    A worker that dies, or is slow, changes no result: Dask gives its tasks to others. Dask's protocol runs whatever it
    is sent: it belongs between machines that trust each other, and across any other network inside TLS.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``"tcp://10.0.0.7:8786"`` or ``"tls://10.0.0.7:8786"``.
    tls : mapping from str to str or path, optional
        The files ``"ca_file"``, ``"cert"`` and ``"key"``, in PEM, of a scheduler that asks for them.

    Raises
    ------
    InputError
        On use, where Dask is not installed, no scheduler answers at the address, it has no workers, or these have
        another version of Steelyard.

    Examples
    --------
    >>> Cluster("tcp://10.0.0.7:8786")
    Cluster('tcp://10.0.0.7:8786')
    """

    TIMEOUT = 20.0
    """s until a scheduler must have answered, and until it must have a worker, also where it had some before."""
    PAUSE = 2.0
    """s after which it is asked again, where nothing is finished, whether it has any worker."""

    def __init__(self, address: str, tls: Mapping[str, str | os.PathLike[str]] | None = None) -> None:
        if not isinstance(address, str) or not address.strip():
            raise InputError(f"The address of a cluster is such as tcp://10.0.0.7:8786, got {shown(address)}.")
        self.address = address.strip() if "://" in address else f"tcp://{address.strip()}"
        self.tls = dict(tls or {})

    def __repr__(self) -> str:
        return f"Cluster({self.address!r})"

    def run(self, leaf: Leaf, combine: Combine, common: Any, groups: Sequence[Sequence[Task]]) -> Results:
        """See `Executor.run`."""
        if not groups:
            return
        distributed = require_package("distributed", "A cluster needs", "cluster")
        client = self._client(distributed)
        told = logging.getLogger("distributed.client")
        level = told.level
        told.setLevel(logging.CRITICAL)  # what ends a run is said once, in a sentence of ours
        try:
            workers = self._workers(client)
            # Not scattered: what a scheduler does not know how to make is lost with the worker that holds it.
            everywhere = client.submit(_given, common, pure=False, retries=_ATTEMPTS)
            running: dict[Any, int] = {}
            attempts = [0] * len(groups)
            following = iter(range(len(groups)))
            gathered = distributed.as_completed(loop=client.loop)

            def submit(number: int) -> None:
                # Tasks are told apart by their places, not by a hash of what they hold.
                options = {"pure": False, "retries": _ATTEMPTS, "priority": -number}
                leaves = [client.submit(_leaf_of_many, leaf, everywhere, task, **options) for task in groups[number]]
                node = client.submit(_combined, combine, everywhere, *leaves, **options)
                running[node] = number
                gathered.add(node)

            for number in islice(following, _IN_FLIGHT * workers):
                submit(number)
            for node, result in self._results(client, gathered):
                number = running.pop(node)
                try:
                    if isinstance(result, BaseException):
                        raise result
                except InputError as error:  # such as that of a worker which has no such file
                    raise InputError(f"On a worker of the cluster at {self.address}: {error}") from None
                except SteelyardError:
                    raise
                except CancelledError as error:  # lost with its worker in a way that Dask does not mend by itself
                    if client.status != "running" and client.status != "connecting":
                        raise self._gone("no scheduler answers any more") from None
                    attempts[number] += 1
                    if attempts[number] == _ATTEMPTS:
                        raise InputError(
                            f"The cluster at {self.address} lost the results of one log {_ATTEMPTS} times ({error}); "
                            "see why its workers end, and run again."
                        ) from None
                    submit(number)
                    continue
                except distributed.KilledWorker as error:
                    raise InputError(
                        f"The cluster at {self.address}: {error.args[0] if error.args else error} ended each worker "
                        "that ran it, as happens where one takes too much memory; give them more, or smaller "
                        "--chunk-rows."
                    ) from None
                del node
                yield number, result
                for further in islice(following, 1):
                    submit(further)
        except (OSError, distributed.comm.CommClosedError) as error:
            raise self._gone(str(error)) from None
        finally:
            client.close(timeout=self.TIMEOUT)
            told.setLevel(level)

    def _results(self, client: Any, gathered: Any) -> Iterator[tuple[Any, bytes | BaseException]]:
        """Yield what is finished with its result, or with what went wrong.

        Dask waits for workers for ever, also for a result that was finished and was lost with its worker. Here a run
        ends where none has been there for some time.
        """
        asked = seen = time.monotonic()

        def watch() -> None:
            nonlocal asked, seen
            now = time.monotonic()
            if now - asked < self.PAUSE:
                return
            asked = now
            if client.status != "running":  # Dask connects again, or cancels what was asked for
                seen = now
                return
            with contextlib.suppress(OSError):  # likewise
                if client.nthreads():
                    seen = now
            if now - seen > self.TIMEOUT:
                raise InputError(
                    f"The cluster at {self.address} lost its last worker {now - seen:.0f} s ago; start some with "
                    f"`dask worker {self.address}`, and run again."
                )

        while not gathered.is_empty():
            while not gathered.has_ready():
                with gathered.thread_condition:
                    gathered.thread_condition.wait(0.1)
                watch()
            node = next(gathered)
            found: bytes | BaseException | None = None
            while found is None:
                try:
                    found = node.result(timeout=self.PAUSE)
                except (Exception, CancelledError) as error:
                    if isinstance(error, TimeoutError) and node.status != "error":
                        watch()
                    else:
                        found = error
            yield node, found

    def _gone(self, reason: str) -> InputError:
        return InputError(f"The cluster at {self.address} went away ({reason}); start it, and run again.")

    def _client(self, distributed: Any) -> Any:
        options: dict[str, Any] = {}
        if self.tls:
            files = {"tls_ca_file": "ca_file", "tls_client_cert": "cert", "tls_client_key": "key"}
            named = {option: str(self.tls[key]) for option, key in files.items() if key in self.tls}
            for path in named.values():
                if not Path(path).is_file():
                    raise InputError(f"{path} does not exist; give the PEM file of the cluster's TLS.")
            options["security"] = distributed.Security(require_encryption=True, **named)
        missing = [key for key in ("ca_file", "cert") if key not in self.tls]
        if missing and (self.tls or self.address.startswith("tls://")):
            # Dask's client would try for a minute, and end in a traceback.
            raise InputError(
                f"{self.address} needs TLS, of which {' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} "
                "missing; give the PEM files by --tls ca_file=ca.pem --tls cert=cert.pem --tls key=key.pem."
            )
        try:
            # A client that was given an address of no scheduler would wait for it when it goes.
            protocol = distributed.comm.parse_address(self.address)[0]
            distributed.comm.registry.get_backend(protocol)
            place = distributed.comm.get_address_host_port(self.address, strict=True)
            if protocol in ("tcp", "tls"):  # Dask would try again until its time is over, also where it was refused
                socket.create_connection(place, self.TIMEOUT).close()
            self._require_scheduler(distributed, options.get("security"))
            return distributed.Client(self.address, timeout=self.TIMEOUT, set_as_default=False, **options)
        except (OSError, ValueError, TypeError) as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise InputError(
                f"No scheduler of Dask answers at {self.address} ({reason}); start one with `dask scheduler`, and "
                "workers with `dask worker`."
            ) from None

    def _require_scheduler(self, distributed: Any, security: Any) -> None:
        """Ask who is there, since Dask's client waits for ever for an answer that is none of Dask's."""

        async def asked() -> str:
            options = {} if security is None else {"connection_args": security.get_connection_args("client")}
            async with distributed.core.rpc(self.address, **options) as there:
                return str((await there.identity())["type"])

        def answer() -> str:
            return asyncio.run(asyncio.wait_for(asked(), self.TIMEOUT))

        with ThreadPoolExecutor(1) as apart:  # notebooks have a loop of their own in this thread
            try:
                kind = apart.submit(answer).result()
            except TimeoutError as error:
                raise OSError(str(error) or f"no answer of Dask within {self.TIMEOUT:g} s") from None
            except MemoryError:  # for as many bytes as the words "HTTP/1.1" are, read as a number
                raise OSError("what answers there is not Dask; its dashboard has an address of its own") from None
        if kind != "Scheduler":
            raise OSError(f"a {kind.lower()} of Dask is there")

    def _workers(self, client: Any) -> int:
        try:
            client.wait_for_workers(1, timeout=self.TIMEOUT)
        except TimeoutError:
            raise InputError(
                f"The cluster at {self.address} has no worker; start some with `dask worker {self.address}`."
            ) from None
        try:
            versions = client.run(_version)
        except OSError:
            raise
        except Exception as error:  # whatever went wrong as it was imported, which Dask wraps or not
            if "No module named 'steelyard'" in str(error):
                raise InputError(
                    f"Workers of the cluster at {self.address} have no Steelyard; install {__version__} there."
                ) from None
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise InputError(
                f"Workers of the cluster at {self.address} cannot load Steelyard ({reason}); install {__version__} "
                "there, with what it needs."
            ) from None
        others = sorted(set(versions.values()) - {__version__})
        if others:
            raise InputError(
                f"Workers of the cluster at {self.address} have Steelyard {', '.join(others)}, and this is "
                f"{__version__}; install the same version everywhere."
            )
        return len(versions)


def _version() -> str:
    return __version__
