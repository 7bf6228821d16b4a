"""A scheduler and workers of Dask as processes of their own, of which one may be killed and one may be slow."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any


@contextlib.contextmanager
def dask_workers(
    folder: Path, count: int, options: Sequence[str] = (), cores: Sequence[int] = (), **environment: str
) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Start a scheduler and workers in a folder, the workers with further options and in turn on these cores."""
    import distributed

    file = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    silent = subprocess.DEVNULL
    quiet: dict[str, Any] = {"stdout": silent, "stderr": silent, "cwd": folder, "env": os.environ | environment}
    scheduler = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    worker = ["worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard", *options]
    started = [subprocess.Popen([*dask, *scheduler], **quiet)]
    try:
        while not file.exists():
            assert started[0].poll() is None
            time.sleep(0.05)
        for number in range(count):
            pinned = ["taskset", "--cpu-list", str(cores[number % len(cores)])] if cores else []
            started.append(subprocess.Popen([*pinned, *dask, *worker], **quiet))
        with distributed.Client(scheduler_file=str(file), set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)
            address = client.scheduler.address
        yield address, started[1:]
    finally:
        for process in started:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGCONT)
            process.kill()
            process.wait()


@contextlib.contextmanager
def disturbed(workers: Sequence[subprocess.Popen[bytes]], delay: float, pause: float) -> Iterator[None]:
    """Kill one worker after a while, and stop the other half of the time, by turns of so many seconds."""
    over = threading.Event()

    def disturb() -> None:
        time.sleep(delay)
        workers[0].kill()
        while not over.wait(pause):
            workers[1].send_signal(signal.SIGSTOP)
            time.sleep(pause)
            workers[1].send_signal(signal.SIGCONT)

    thread = threading.Thread(target=disturb, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
