"""The same bytes, wherever logs are reduced, in whatever groups, and however often it was begun."""

import contextlib
import importlib
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dask_cluster import dask_workers, disturbed
from threadpoolctl import threadpool_limits

import steelyard as sy
from steelyard.fleet import Here, log_reduction
from steelyard.fleet.packed import packed, unpacked
from steelyard.identification.log_reader import LogReader, LogTask, one_by_one
from steelyard.regression.batch_means import BatchMeansTree
from steelyard.robot import RobotFile


def reduced(place: Path, reduction: Any) -> tuple[list[Any], Any]:
    """Reduce the logs of a folder; return what is kept of each and the batch means of all."""
    file = RobotFile.load(place / "robot.toml")
    model = sy.Model.from_file(file)
    reader = LogReader(file, model, 200_000)
    tasks = [LogTask(str(place / "logs" / f"run{n}.csv"), 100, 200, 5, n != 5) for n in range(1, 6)]
    tree, logs = BatchMeansTree(), []
    for group in reduction(reader, tasks, model, lambda _: None):
        tree.add(group.batch_means)
        logs += group.logs
    return logs, tree.total()


def same(found: tuple[list[Any], Any], expected: tuple[list[Any], Any]) -> bool:
    return bool(log_reduction.packed(found) == log_reduction.packed(expected))


@pytest.mark.slow
def test_groups_and_checkpoints_change_no_byte(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = reduced(place, one_by_one)
    assert [log.information.count for log in plain[0]] == [1184] * 5
    assert same(reduced(place, sy.fleet.LogReduction()), plain)
    monkeypatch.setattr(log_reduction, "MANY", 1)
    for size in (2, 8):
        monkeypatch.setattr(log_reduction, "GROUP", size)
        assert same(reduced(place, sy.fleet.LogReduction()), plain)
    with sy.fleet.Checkpoints(place / "result") as kept:
        for _ in range(2):
            assert same(reduced(place, sy.fleet.LogReduction(checkpoints=kept)), plain)
        assert len(kept.names) == 1


@pytest.mark.parametrize("threads", [1, 2])
def test_two_logs_at_a_time_change_no_byte(place: Path, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    plain, where = reduced(place, one_by_one), set[int]()
    begun = LogReader.begun
    monkeypatch.setattr(LogReader, "begun", lambda *given: where.add(threading.get_ident()) or begun(*given))
    with threadpool_limits(threads, "blas"):
        for reduction in (one_by_one, sy.fleet.LogReduction()):
            where.clear()
            assert same(reduced(place, reduction), plain)
            assert len(where) == threads


@pytest.mark.slow
def test_a_log_that_changed_is_read_again(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    leaf = log_reduction.reduced_log
    monkeypatch.setattr(
        log_reduction, "reduced_log", lambda common, task: read.append(task.given.log) or leaf(common, task.given)
    )
    with sy.fleet.Checkpoints(place / "result") as kept:
        reduction = sy.fleet.LogReduction(checkpoints=kept)
        reduced(place, reduction)
        path = place / "logs" / "run3.csv"
        path.write_text("\n".join(path.read_text().splitlines()[:-50]) + "\n")
        logs, _ = reduced(place, reduction)
        (place / "robot.toml").write_text((place / "robot.toml").read_text() + "trim = 0.5\n")
        reduced(place, reduction)
    names = [Path(log).name for log in read]
    every = [f"run{n}.csv" for n in range(1, 6)]
    assert [sorted(names[:5]), names[5], sorted(names[6:])] == [every, "run3.csv", every]
    assert [log.information.count for log in logs] == [1184, 1184, 1084, 1184, 1184]


@pytest.mark.slow
def test_what_is_kept_of_a_log_is_of_the_content_by_which_it_is_known(place: Path) -> None:
    """A log that is another one when it is read, and afterwards what it was when it was hashed."""
    path = place / "logs" / "run3.csv"
    own, expected = path.read_bytes(), reduced(place, one_by_one)

    class Meanwhile(Here):
        def run(self, leaf: Any, combine: Any, common: Any, groups: Any) -> Any:
            if leaf is log_reduction.reduced_log:
                path.write_bytes((place / "logs" / "run4.csv").read_bytes())
            return super().run(leaf, combine, common, groups)

    with sy.fleet.Checkpoints(place / "result") as kept:
        with pytest.raises(sy.InputError, match=r"run3\.csv is not what it was when the run began"):
            reduced(place, sy.fleet.LogReduction(Meanwhile(), kept))
        path.write_bytes(own)
        assert same(reduced(place, sy.fleet.LogReduction(checkpoints=kept)), expected)


@pytest.mark.slow
def test_what_is_kept_of_one_log_is_not_that_of_another(place: Path) -> None:
    """Copying programs, and people, rename files; whole ones as well."""
    expected = reduced(place, one_by_one)
    with sy.fleet.Checkpoints(place / "result") as kept:
        reduction = sy.fleet.LogReduction(checkpoints=kept)
        reduced(place, reduction)
        first, *others = (place / "result" / name for name in kept.names)
        for other in others:
            other.write_bytes(first.read_bytes())
        assert same(reduced(place, reduction), expected)


def test_what_is_in_memory_is_reduced_here() -> None:
    robot = sy.Robot.from_dh([(0, 0.3, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    t = np.arange(400) / 100.0
    q = np.sin(3.0 * t)
    data = {"t": t, "q1": q, "tau1": 5.0 * np.cos(q) - 5.4 * np.sin(3.0 * t)}
    file = RobotFile.of(robot)
    model = sy.Model.from_file(file)
    tasks = [LogTask(log, 50, 100, 1, True) for log in sy.identification.given.given_logs(data, None)[0]]
    [group] = sy.fleet.LogReduction(sy.fleet.Cluster("tcp://127.0.0.1:1"))(
        LogReader(file, model, 1000), tasks, model, lambda _: None
    )
    assert group.logs[0].information.count == 360  # of 400, trimmed


def test_the_tree_of_sums_is_that_of_pairs_in_order() -> None:
    model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    parts = []
    for seed in range(7):
        q, dq, ddq, torque = np.random.default_rng(seed).normal(size=(4, 2000, 1))
        parts.append(sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)).batch_means)
    tree = BatchMeansTree()
    for part in parts:
        tree.add(part)
    # By the normal equations, which are sums in no order at all.
    for level, of_level in enumerate(tree.total()):
        gram = sum(part[level][0].triangle.T @ part[level][0].triangle for part in parts)
        np.testing.assert_allclose(of_level[0].triangle.T @ of_level[0].triangle, gram, rtol=1e-10)
        assert of_level[0].count == sum(part[level][0].count for part in parts)


@pytest.mark.slow
def test_a_cluster_that_is_not_there_is_named() -> None:
    pytest.importorskip("distributed")
    with socket.create_server(("127.0.0.1", 0)) as freed:
        port = freed.getsockname()[1]
    cluster, begin = sy.fleet.Cluster(f"127.0.0.1:{port}"), time.monotonic()
    with pytest.raises(sy.InputError, match=rf"No scheduler of Dask answers at tcp://127.0.0.1:{port} \(.*refused"):
        next(cluster.run(log_reduction.hashed, log_reduction.first_of, None, [["x"]]))
    assert time.monotonic() - begin < 0.5 * cluster.TIMEOUT  # for which Dask would have tried
    for tls, told in (({}, "ca_file and cert are missing"), ({"ca_file": __file__}, "cert is missing")):
        with pytest.raises(sy.InputError, match=told):
            list(sy.fleet.Cluster("tls://127.0.0.1:1", tls).run(len, len, None, [[1]]))
    secure = sy.fleet.Cluster("tls://127.0.0.1:1", {"cert": "absent.pem"})
    with pytest.raises(sy.InputError, match="does not exist"):
        next(secure.run(log_reduction.hashed, log_reduction.first_of, None, [["x"]]))


@pytest.mark.slow
def test_a_web_server_in_the_place_of_a_scheduler_is_told() -> None:
    """Such as the dashboard of Dask, whose port is given for that of the scheduler; its answer is no lack of memory."""
    pytest.importorskip("distributed")

    def answer(server: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = server.accept()
                connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
                connection.close()

    with socket.create_server(("127.0.0.1", 0)) as web:
        threading.Thread(target=answer, args=(web,), daemon=True).start()
        cluster = sy.fleet.Cluster(f"tcp://127.0.0.1:{web.getsockname()[1]}")
        with pytest.raises(sy.InputError, match=r"No scheduler of Dask answers at .* \(what answers there is not Dask"):
            next(cluster.run(log_reduction.hashed, log_reduction.first_of, None, [["x"]]))


@pytest.mark.slow
def test_what_answers_and_is_no_scheduler_is_told(tmp_path: Path) -> None:
    """Dask's client waits for ever for a server that is silent, and leaves a traceback where a worker answers."""
    pytest.importorskip("distributed")
    with socket.create_server(("127.0.0.1", 0)) as silent, dask_workers(tmp_path, 1) as (address, _):
        import distributed

        with distributed.Client(address, set_as_default=False) as client:
            [worker] = client.scheduler_info()["workers"]
        for there, told in ((f"tcp://127.0.0.1:{silent.getsockname()[1]}", "no answer"), (worker, "a worker of Dask")):
            cluster = sy.fleet.Cluster(there)
            cluster.TIMEOUT = 3.0
            begin = time.monotonic()
            with pytest.raises(sy.InputError, match=rf"No scheduler of Dask answers at {there} \({told}"):
                next(cluster.run(log_reduction.hashed, log_reduction.first_of, None, [["x"]]))
            assert time.monotonic() - begin < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["worker", "scheduler"])
def test_a_cluster_that_is_lost_on_the_way_is_told(tmp_path: Path, lost: str) -> None:
    """Dask waits for workers for ever."""
    distributed = pytest.importorskip("distributed")
    with dask_workers(tmp_path, 1) as (address, workers):
        with distributed.Client(address, set_as_default=False) as client:
            process = workers[0].pid if lost == "worker" else client.run_on_scheduler(os.getpid)
        cluster = sy.fleet.Cluster(address)
        cluster.TIMEOUT = 6.0
        told = "lost its last worker" if lost == "worker" else "went away"
        begin = time.monotonic()
        with pytest.raises(sy.InputError, match=f"The cluster at {address} {told}"):
            next(cluster.run(os.kill, log_reduction.first_of, process, [[signal.SIGKILL]]))  # type: ignore[arg-type]
        assert time.monotonic() - begin < 40.0


@pytest.mark.slow
@pytest.mark.parametrize("module", ["steelyard", "clarabel"])
def test_workers_without_the_package_are_told(tmp_path: Path, module: str) -> None:
    pytest.importorskip("distributed")
    (tmp_path / "steelyard").mkdir()
    fault = f"raise ModuleNotFoundError(\"No module named '{module}'\", name='{module}')"
    (tmp_path / "steelyard" / "__init__.py").write_text(fault)
    with dask_workers(tmp_path, 1, PYTHONPATH=str(tmp_path)) as (address, _):
        told = "have no Steelyard" if module == "steelyard" else "cannot load Steelyard .*clarabel"
        with pytest.raises(sy.InputError, match=told):
            next(sy.fleet.Cluster(address).run(log_reduction.hashed, log_reduction.first_of, None, [["x"]]))


@pytest.mark.parametrize("count", [0, True, 1.5, 5000])
def test_a_number_of_workers_is_a_whole_one(count: Any) -> None:
    with pytest.raises(sy.InputError, match="whole number"):
        sy.fleet.Workers(count)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_processes_begin_deaf_to_an_interrupt() -> None:
    """A terminal sends Ctrl-C to all processes; those that still load their modules would print traces."""
    workers, blocked = sy.fleet.Workers(1), signal.pthread_sigmask(signal.SIG_BLOCK, [])
    leaf: Any = signal.pthread_sigmask  # returns what is blocked where it runs
    assert list(workers.run(leaf, log_reduction.first_of, signal.SIG_BLOCK, [[[]]])) == [(0, {signal.SIGINT})]
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == blocked


HALF = """
import os, signal
from multiprocessing.connection import Connection
from pathlib import Path

def die_in_the_midst_of_a_result(seen, task):
    marker = Path(seen, str(task))
    if task == 0 and not marker.exists():
        def half(self, buffer, write=os.write):
            write(self.fileno(), bytes(buffer)[: len(buffer) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
        Connection._send = half
    marker.touch()
    return bytes([task]) * 100_000
"""


@pytest.mark.timeout(60)
@pytest.mark.skipif(os.name != "posix", reason="kills of POSIX")
@pytest.mark.parametrize("workers", [1, 2])
def test_a_process_that_is_killed_in_the_midst_of_a_result_is_replaced(
    workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where processes share a pipe and its lock, the run waited for the rest of it for ever."""
    (tmp_path / "half_a_result.py").write_text(HALF)
    monkeypatch.syspath_prepend(tmp_path)
    leaf = importlib.import_module("half_a_result").die_in_the_midst_of_a_result
    results = dict(sy.fleet.Workers(workers).run(leaf, log_reduction.first_of, str(tmp_path), [[0], [1], [2]]))
    assert results == {task: bytes([task]) * 100_000 for task in range(3)}


def test_a_cluster_without_dask_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(sy.MissingExtraError, match="pip install 'dask"):
        next(sy.fleet.Cluster("tcp://127.0.0.1:1").run(log_reduction.hashed, log_reduction.first_of, None, [["x"]]))


@pytest.mark.slow
def test_processes_give_the_same_bytes_and_outlive_a_kill(place: Path) -> None:
    plain = reduced(place, one_by_one)
    ended = threading.Event()

    def kill_one() -> None:
        import multiprocessing

        while not ended.is_set():
            for child in multiprocessing.active_children():
                time.sleep(1.0)  # while it starts, or works
                child.kill()
                return
            time.sleep(0.01)

    thread = threading.Thread(target=kill_one, daemon=True)
    thread.start()
    assert same(reduced(place, sy.fleet.LogReduction(sy.fleet.Workers(2))), plain)
    ended.set()
    thread.join()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="processes are stopped by signals of POSIX")
@pytest.mark.filterwarnings("ignore")  # of Dask about workers that are lost
def test_a_cluster_with_a_killed_and_a_slow_worker_gives_the_same_bytes(place: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    plain = reduced(place, one_by_one)
    with dask_workers(tmp_path, 2) as (address, workers):
        cluster = sy.fleet.Cluster(address)
        assert same(reduced(place, sy.fleet.LogReduction(cluster)), plain)
        with disturbed(workers, 0.3, 0.1):
            assert same(reduced(place, sy.fleet.LogReduction(cluster)), plain)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills and locks of POSIX")
def test_killed_runs_leave_nothing_and_lose_nothing(place: Path) -> None:
    """Four kills at random moments; `benchmarks/kills.py` makes a thousand."""
    output = place / "out" / "result"
    command = [sys.executable, "-m", "steelyard", "identify", str(place / "robot.toml"), str(place / "logs"), "-q"]
    command += ["--output", str(output), "--force"]

    def contents() -> dict[str, bytes]:
        return {p.name: p.read_bytes() for p in (place / "out").rglob("*") if p.is_file()}

    began = time.perf_counter()
    code = subprocess.run(command, capture_output=True).returncode
    lasts = time.perf_counter() - began
    assert code in (0, 3)
    expected = contents()
    assert "estimate.json" in expected
    dice = random.Random(5)
    for _ in range(2):
        for one in output.iterdir():
            one.unlink()
        for _ in range(2):
            with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
                time.sleep(dice.uniform(0.3, 1.1) * lasts)
                run.kill()
        assert subprocess.run(command, capture_output=True).returncode == code
        assert contents() == expected
        assert [path.name for path in (place / "out").iterdir()] == ["result"]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_run_that_a_batch_system_ends_says_so_and_keeps_what_it_has(place: Path) -> None:
    """It died at once, and a library warned on the terminal of what its processes had shared."""
    command = [sys.executable, "-m", "steelyard", "identify", "robot.toml", "logs", "--workers", "2", "-o", "out"]
    with subprocess.Popen(command, cwd=place, stderr=subprocess.PIPE, text=True) as run:
        while not (kept := list(place.glob("out/reduced-*.checkpoint"))):
            assert run.poll() is None
            time.sleep(0.005)
        os.kill(run.pid, signal.SIGTERM)
        said = run.communicate()[1].splitlines()  # which ends when the last process has closed it
        assert (run.returncode, said[-1]) == (143, "steelyard: ended by SIGTERM"), said
    assert {*kept} <= {*place.glob("out/*")}
    assert not list(place.glob("out/.*"))


def test_an_array_that_is_kept_keeps_no_others_alive() -> None:
    """Of thousands of logs the rows that are drawn are kept, and not the sums of batches beside them."""
    many, few = unpacked(packed([np.zeros(1_000_000), np.ones(3)]))
    assert few.base is None
    assert not few.flags.writeable
    assert many.nbytes == 8_000_000
