"""Processes of a search end with the program that started them, whatever ended it."""

import os
import signal
import subprocess
import sys
import time

import pytest

# A program that was started by nohup does not hear of a hang-up, and would run to its end.
PROGRAM = """
import os, signal, time
from steelyard.excitation.workers import pool_of

signal.signal(signal.SIGHUP, signal.SIG_DFL)

def work(seconds):
    os.write(1, f"{{os.getpid()}}\\n".encode())  # in one piece, so that two processes do not mix their lines
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        sum(range(10000))

with pool_of(work, 2) as pool:
    tasks = [pool.submit({seconds}) for _ in range(2)]
    [task.result() for task in tasks]
print("done")
"""


def alive(process: int) -> bool:
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are branched off on Linux alone")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_workers_end_with_the_program(number: signal.Signals) -> None:
    command = [sys.executable, "-c", PROGRAM.format(seconds=60)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        workers = [int(program.stdout.readline()) for _ in range(2)]
        assert len(set(workers)) == 2
        assert program.pid not in workers
        assert all(alive(worker) for worker in workers)
        os.kill(program.pid, number)
        program.wait()
        end = time.monotonic() + 20.0
        while any(alive(worker) for worker in workers) and time.monotonic() < end:
            time.sleep(0.02)
        left = [worker for worker in workers if alive(worker)]
        for worker in left:
            os.kill(worker, signal.SIGKILL)
    assert left == []


def test_workers_finish_their_work() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(seconds=0.05)], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "done"
    assert done.stderr == ""


def test_workers_are_warned_as_the_program_is() -> None:
    """They are forked while the program mutes its warnings of forks."""
    program = """
import warnings
from steelyard.excitation.workers import pool_of

def filters():
    return [str(one) for one in warnings.filters]

with pool_of(filters, 2) as pool:
    print(pool.submit().result() == filters())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stdout == "True\n", done.stderr
