"""A long log of the WAM, seven joints at 1 kHz, from its file to an estimate, beside Polars reading the same file.

    python benchmarks/long_logs.py [ROWS] [FORMAT ...]

ROWS is 20 million, and the formats are csv and parquet, by default; parquet:1048576 has groups of so many rows, as
pyarrow and pandas write them. Each figure is of a process of its own, and all import what they need before they are
timed; the ratio is that of the least times of ROUNDS runs that take turns. The peak memory is that of the whole process
that identifies, as the operating system counts it (`ru_maxrss`).

Timed are ``pl.read_csv`` or ``pl.read_parquet`` with all columns into memory; from the file to an `Information`
(`process_chunks` and `Information.from_chunks`); and `steelyard.identify` as a whole without a report: choice of the
cutoff, decision on what is kept to be drawn, batch means, cross-validation, feasible fit and verdicts.
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from steelyard.identification import wam

ROUNDS = 2
BLOCK = 100_000  # rows of a group of Parquet, as `Recording.save` writes them
TRACKING = 2e-4
"""rad, standard deviation of what the arm is off its trajectory: no period is like another, as in a real log."""
NAMES = ["t", *(f"q{k}" for k in range(1, 8)), *(f"tau{k}" for k in range(1, 8))]
BEGIN = """
import resource, sys, time
import numpy, polars, scipy.signal, scipy.sparse, scipy.interpolate, clarabel, llvmlite.binding, lxml.etree
import steelyard as sy
from steelyard.identification import identify
from steelyard.recording import Processing, process_chunks
from steelyard.identification.wam import wam_model
kind, robot, log = sys.argv[1:]
begin, spent = time.perf_counter(), time.process_time()
"""
END = """
seconds, spent = time.perf_counter() - begin, time.process_time() - spent
print(seconds, spent, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""
WORK = {
    "Polars": "frame = getattr(polars, f'read_{kind}')(log)",
    "to Information": """
options = Processing(cutoff=4.8, order=3, trim=0.5, velocity_threshold=0.05)
model = wam_model()
chunks = process_chunks(log, processing=options, joints=7)
estimate = sy.least_squares(sy.Information.from_chunks(model, chunks, batch_means=False))
""",
    "identify": "assert identify(robot, [log]).verdict is not None",
}


def blocks(rows: int) -> Iterator[NDArray[np.float64]]:
    """Yield a recording, block by block: encoder counts of a motion that is tracked, and torques with their noise."""
    model, random, parameters = wam.wam_model(), np.random.default_rng(1), wam.true_parameters()
    _, q, dq, ddq = wam.TRAJECTORIES["A"].sample(1000.0, 1.0)
    period = len(q) - len(q) % 2500
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    for start in range(0, rows, BLOCK):
        numbers = np.arange(start, min(start + BLOCK, rows))
        white = random.standard_normal((len(numbers), 7))
        off = TRACKING * lfilter([0.14], [1.0, -0.99], random.standard_normal((len(numbers), 7)), axis=0)
        place = numbers % period
        yield np.column_stack([numbers / 1000.0, *wam.measured(q[place] + off, torque[place], white, 1000.0)])


def write(rows: int, path: Path, group: int = BLOCK) -> None:
    """Write the recording in blocks, so that this script takes hardly more memory than what it measures."""
    import polars as pl

    frames = (pl.DataFrame(block, schema=NAMES) for block in blocks(rows))
    if path.suffix == ".csv":
        with path.open("wb") as file:
            for number, frame in enumerate(frames):
                frame.write_csv(file, include_header=number == 0)
        return
    from polars.io.plugins import register_io_source

    source = register_io_source(lambda *_: frames, schema=dict.fromkeys(NAMES, pl.Float64))
    source.sink_parquet(path, row_group_size=group)


def run(work: str, *arguments: str) -> tuple[float, float, float]:
    """Return time and processor time in s, and the peak memory in MB, of some work in a process of its own."""
    done = subprocess.run([sys.executable, "-c", BEGIN + work + END, *arguments], capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    seconds, spent, memory = map(float, done.stdout.split())
    return seconds, spent, memory


def main() -> None:
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000_000
    with tempfile.TemporaryDirectory(dir="/var/tmp" if Path("/var/tmp").is_dir() else None) as folder:
        robot = Path(folder) / "robot.toml"
        robot.write_text(wam.robot_toml())
        for given in sys.argv[2:] or ("csv", "parquet"):
            kind, _, group = given.partition(":")
            log = Path(folder) / f"log.{kind}"
            write(rows, log, int(group or BLOCK))
            print(f"{rows} rows of seven joints as {given}, {log.stat().st_size / 1e6:.0f} MB", flush=True)
            found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in WORK}
            for _ in range(ROUNDS):
                for name, work in WORK.items():
                    found[name].append(run(work, kind, str(robot), str(log)))
            least = {name: np.min(runs, axis=0) for name, runs in found.items()}
            for name, runs in found.items():
                (seconds, spent, _), ratios = least[name], least[name] / least["Polars"]
                print(
                    f"  {name:16} {seconds:8.2f} s, {ratios[0]:6.2f} times Polars; {spent:8.2f} s of the processors, "
                    f"{ratios[1]:6.2f} times; {max(memory for *_, memory in runs):6.0f} MB",
                    flush=True,
                )
            log.unlink()


if __name__ == "__main__":
    main()
