"""Many logs on processes of this machine and on a Dask cluster of real workers: time, memory, and the same bytes.

    python benchmarks/cluster.py [LOGS] [ROWS]      20 logs of 1 000 000 rows, or 1 of 20 000 000, take 2.5 GB of disk

Prints the time of one process, of one and of two workers of Dask and of two processes, the largest memory of a worker,
and whether the results are the same bytes, also where one of two workers is killed in mid-run and the other is stopped
half of the time. Each worker of Dask has a core of its own.
"""

import contextlib
import hashlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "oracles"))
from dask_cluster import dask_workers, disturbed

import steelyard as sy
from steelyard.identification.wam import robot_toml, simulated_log, wam_model

FILES = ("estimate.json", "parameters.csv", "report.html", "robot.urdf")


def write_logs(folder: Path, logs: int, rows: int) -> Path:
    """Write logs of the WAM, each the same three periods again and again with noise of its own, in partitions."""
    recording = simulated_log(wam_model(), "A", seed=1)
    random = np.random.default_rng(7)
    turns = -(-rows // recording.count)
    t = np.arange(rows) / recording.rate
    for number in range(logs):
        place = folder / "logs" / f"robot=7/part={number}"
        place.mkdir(parents=True)
        columns = {"t": t}
        for name, values, noise in (("q", recording.q, 1e-6), ("tau", recording.torque, 0.02)):
            for joint, one in enumerate(values.T):
                columns[f"{name}{joint + 1}"] = np.tile(one, turns)[:rows] + random.normal(0.0, noise, rows)
        pl.DataFrame(columns).write_parquet(place / "log.parquet", row_group_size=100_000, compression="uncompressed")
    (folder / "robot.toml").write_text(robot_toml())
    return folder / "logs"


@contextlib.contextmanager
def cluster(workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Start a scheduler and workers, each on a core: by itself one would take a part of a second one to read ahead."""
    cores = sorted(os.sched_getaffinity(0))
    settings = {"OPENBLAS_NUM_THREADS": "1", "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "false"}
    with (
        tempfile.TemporaryDirectory() as place,
        dask_workers(Path(place), workers, ("--memory-limit", "1GiB"), cores, **settings) as started,
    ):
        yield started


class Peak:
    """The largest memory that processes had, looked at while they run."""

    def __init__(self, processes: list[subprocess.Popen[bytes]]) -> None:
        self.processes, self.bytes = processes, 0
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self._look, daemon=True)
        self.thread.start()

    def _look(self) -> None:
        while not self.stop.wait(0.05):
            for process in self.processes:
                with contextlib.suppress(OSError, ValueError, IndexError):  # of a process that has ended
                    status = Path(f"/proc/{process.pid}/status").read_text()
                    self.bytes = max(self.bytes, int(status.split("VmHWM:")[1].split()[0]) * 1024)


def identify(folder: Path, logs: Path, name: str, executor: sy.fleet.Executor | None) -> tuple[float, float, str]:
    """Identify into a folder; return the time of the reduction and of all, and the hash of the results."""
    began = time.perf_counter()
    steps: list[float] = []

    def say(words: str) -> None:
        if words == "least squares" or words.startswith("have the rotors"):
            steps.append(time.perf_counter() - began)

    with sy.fleet.Checkpoints(folder / name) as kept:
        reduction = sy.fleet.LogReduction(executor, kept)
        result = sy.identify(folder / "robot.toml", str(logs), reduction=reduction, progress=say)
        result.save(folder / name, stale=kept.names)
    told = hashlib.sha256()
    for file in FILES:
        if (folder / name / file).exists():
            told.update((folder / name / file).read_bytes())
    return steps[0], time.perf_counter() - began, told.hexdigest()[:16]


def main() -> None:
    logs, rows = (int(text) for text in (sys.argv[1:] or ["20", "100000"]))
    with tempfile.TemporaryDirectory(prefix="big-cluster-") as text:
        folder = Path(text)
        place = write_logs(folder, logs, rows)
        print(f"{logs} logs of {rows} rows of seven joints")
        print(f"{'where':44} {'reading':>9} {'all':>9}  {'memory of a worker':>19}  results")

        def show(where: str, found: tuple[float, float, str], peak: int = 0) -> None:
            memory = f"{peak / 2**20:.0f} MiB" if peak else ""
            print(f"{where:44} {found[0]:7.1f} s {found[1]:7.1f} s  {memory:>19}  {found[2]}", flush=True)

        warm = write_logs(folder / "warm", 4, 20_000)  # each worker loads its code before the clock starts
        identify(folder, warm, "warmed", None)
        show("one process", identify(folder, place, "one", None))
        times = {}
        for count in (1, 2):
            with cluster(count) as (address, workers):
                executor = sy.fleet.Cluster(address)
                identify(folder, warm, "warmed", executor)
                peak = Peak(workers)
                found = identify(folder, place, f"dask-{count}", executor)
                times[count] = found[0]
                show(f"Dask, {count} worker{'s' * (count > 1)}", found, peak.bytes)
        print(f"two workers of Dask are {times[1] / times[2]:.2f} times as fast as one (reading and reducing)")
        show("2 processes of this machine", identify(folder, place, "processes", sy.fleet.Workers(2)))
        with cluster(2) as (address, workers):
            executor = sy.fleet.Cluster(address)
            with disturbed(workers, times[2] / 2, 0.2):
                show("Dask, one of 2 killed, the other slow", identify(folder, place, "hard", executor))
        left = sorted({path.name for path in folder.rglob("*") if path.suffix in (".part", ".checkpoint")})
        print(f"files left beside the results: {left or 'none'}")


if __name__ == "__main__":
    main()
