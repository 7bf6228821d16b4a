"""The WAM's 37500 samples of seven joints from CSV to estimate.json, and the import, each in a fresh interpreter."""

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from steelyard.identification.wam import robot_toml, simulated_log, wam_model

ROUNDS = 5
IMPORT = "import time; t = time.perf_counter(); import steelyard; print(time.perf_counter() - t)"
IDENTIFY = """
import sys, time
import steelyard, numpy, scipy.signal, scipy.sparse, polars, clarabel, llvmlite.binding, lxml.etree
from steelyard.identification import identify
t = time.perf_counter()
identify(sys.argv[1], [sys.argv[2]]).estimate.save(sys.argv[3])
print(time.perf_counter() - t)
"""


def median(script: str, *arguments: str) -> float:
    """Run a script in fresh interpreters, the first not counted, and return the median of what it prints."""
    runs = [
        subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True)
        for _ in range(ROUNDS + 1)
    ]
    for run in runs:
        if run.returncode:
            sys.exit(run.stderr)
    return statistics.median(float(run.stdout) for run in runs[1:])


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "robot.toml").write_text(robot_toml())
        recording = simulated_log(wam_model(), "A", seed=1).save(place / "log.csv")
        seconds = median(IDENTIFY, str(place / "robot.toml"), str(recording), str(place / "estimate.json"))
    print(f"import steelyard                                     {median(IMPORT):6.3f} s")
    print(f"CSV of 37500 samples x 7 joints to estimate.json     {seconds:6.3f} s")


if __name__ == "__main__":
    main()
