"""Kills of `identify` and `fleet` at random moments: after a run to the end the results must be those of a quiet run.

    python benchmarks/kills.py [KILLS] [SEED] [identify|fleet]       1000 kills of identify by default

Each time a run is killed (SIGKILL, together with its worker processes' parent) one to four times, and then run to its
end. All files of the output folder must be the bytes of a run that nobody disturbed, and neither the folder nor the one
around it may hold anything else. Every fourth run has two worker processes.
"""

import contextlib
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import scipy.interpolate
import scipy.linalg
import scipy.ndimage
import scipy.optimize
import scipy.signal
import scipy.sparse

import steelyard as sy
from steelyard import fleet, report
from steelyard.cli.main import main as command

LOADED = (scipy, sy.identify, fleet.LogReduction, report.save_results)  # once, and not by each of thousands of runs
LOGS, ROWS = 8, 1500
ROBOT = """\
[description]
convention = "standard"
rows = [["pi/2", 0, 0.3, "q"], [0, 0.5, 0, "q"]]

[processing]
cutoff = "none"
"""


def write_job(folder: Path, kind: str = "identify") -> list[str]:
    """Write a robot and logs; return the arguments that identify it, or a fleet of such robots, but for the output."""
    (folder / "logs").mkdir()
    (folder / "robot.toml").write_text(ROBOT)
    model = sy.Model.load(folder / "robot.toml")
    parameters = np.tile([0.4, 0.01, 0.02, 0.5, 0.03, 0.3, 0.2, 0.1, 0.3, 3.0, 0.8, 0.4, 0.1], 2)
    noise = np.random.default_rng(1)
    t = np.arange(ROWS) / 200.0
    for number in range(LOGS):
        rates = np.array([2.1 + 0.3 * number, 3.4 - 0.2 * number])
        phase = t[:, None] * rates
        q, dq, ddq = np.sin(phase), rates * np.cos(phase), -(rates**2) * np.sin(phase)
        torque = model.inverse_dynamics(q, dq, ddq, parameters) + noise.normal(0.0, 0.02, q.shape)
        table = np.column_stack([t, q, torque])
        name = folder / "logs" / f"run{number}.csv"
        np.savetxt(name, table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="", fmt="%.9g")
    robots = [f'[[robots]]\nid = "R{number}"\nlogs = ["logs/run{number}.csv"]\n' for number in range(LOGS)]
    (folder / "fleet.toml").write_text('robot = "robot.toml"\n' + "".join(robots))
    if kind == "fleet":
        return ["fleet", str(folder / "fleet.toml"), "--quiet"]
    return ["identify", str(folder / "robot.toml"), str(folder / "logs"), "--quiet"]


def started(arguments: list[str]) -> int:
    """Run a command in a process forked from this one, which has loaded but not used what it needs."""
    process = os.fork()
    if process:
        return process
    code = 70
    with contextlib.suppress(BaseException):
        os.setpgrp()
        silent = os.open(os.devnull, os.O_RDWR)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        sys.argv = ["steelyard", *arguments]
        try:
            command()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
    os._exit(code)


def ended(process: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def contents(folder: Path) -> dict[str, bytes]:
    return {str(one.relative_to(folder)): one.read_bytes() for one in sorted(folder.rglob("*")) if one.is_file()}


def main() -> None:
    given = [*sys.argv[1:], *["1000", "1", "identify"][len(sys.argv) - 1 :]]
    kills, seed, kind = int(given[0]), int(given[1]), given[2]
    dice = random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="big-kills-") as text:
        folder = Path(text)
        job = write_job(folder, kind)
        output = folder / "place" / "result"
        output.parent.mkdir()
        began = time.perf_counter()
        code = ended(started([*job, "--output", str(output)]))
        lasts = time.perf_counter() - began
        expected = contents(output.parent)
        print(f"a quiet run lasts {lasts:.1f} s, exits {code}, and leaves {', '.join(sorted(expected))}", flush=True)
        done = rounds = resumed = 0

        def told() -> str:
            return f"{done} kills, {rounds} runs to the end, {resumed} of them from checkpoints: all equal"

        while done < kills:
            for one in sorted(output.rglob("*"), reverse=True):
                one.unlink()
            output.rmdir()
            rounds += 1
            more = ["--workers", "2"] if rounds % 4 == 0 else []
            for _ in range(min(dice.randint(1, 4), kills - done)):
                process = started([*job, "--output", str(output), *more])
                time.sleep(dice.uniform(0.0, 1.2 * lasts) * (2.0 if more else 1.0))
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
                ended(process)
                done += 1
            resumed += bool(output.exists() and any(name.suffix == ".checkpoint" for name in output.iterdir()))
            again = ended(started([*job, "--output", str(output), *more]))
            found = contents(output.parent)
            if again != code or found != expected:
                kept = Path(tempfile.mkdtemp(prefix="big-kills-found-"))
                different = [n for n in {*found, *expected} if found.get(n) != expected.get(n)]
                for name in different:
                    (kept / name.replace("/", "-")).write_bytes(found.get(name, b""))
                sys.exit(f"after {done} kills: exit {again}, different: {sorted(different)}; see {kept}")
            if rounds % 20 == 0:
                print(told(), flush=True)
        print(f"{told()}, nothing left beside the results")


if __name__ == "__main__":
    main()
