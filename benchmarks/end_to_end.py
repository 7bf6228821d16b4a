"""The WAM's 37500 samples of seven joints from CSV to estimate.json, and the import, each in a fresh interpreter.

Start-up is what comes before the clock: the interpreter, the imports, and a first identification in the same process,
which compiles the robot's kernels or takes them from the cache. The split is that of the best round.
"""

import json
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
import steelyard, numpy, scipy.sparse, polars, clarabel, llvmlite.binding, lxml.etree
from steelyard.identification import identify
t = time.perf_counter()
identify(sys.argv[1], [sys.argv[2]]).estimate.save(sys.argv[3])
print(time.perf_counter() - t)
"""
FIRST = """
import sys, time
import steelyard
steelyard.identify(sys.argv[1], [sys.argv[2]]).estimate.save(sys.argv[3])
print(time.process_time())
"""
SPLIT = """
import json, sys, time
from steelyard.identification import identify
module = sys.modules["steelyard.identification.identify"]
rounds = []
for _ in range(4):
    def note(name, function):
        def timed(*arguments, **options):
            begin = time.perf_counter(), time.process_time()
            found = function(*arguments, **options)
            own = time.perf_counter() - begin[0], time.process_time() - begin[1]
            taken[name] = [a + b for a, b in zip(taken.get(name, (0, 0)), own)]
            return found
        return timed
    taken = {}
    kept = {}
    for name in ("reduced_logs", "check", "tried_prior", "plausible_fit", "parameter_table", "doubts_of", "_predict"):
        kept[name] = getattr(module, name)
        setattr(module, name, note(name, kept[name]))
    decide = module.LogReader.decide
    module.LogReader.decide = note("decide", decide)
    estimate = note("all", identify)(sys.argv[1], [sys.argv[2]]).estimate
    note("save", estimate.save)(sys.argv[3])
    module.LogReader.decide = decide
    for name, function in kept.items():
        setattr(module, name, function)
    taken["all"] = [a + b for a, b in zip(taken["all"], taken["save"])]
    rounds.append(taken)
print(json.dumps(min(rounds, key=lambda one: one["all"][0])))
"""
STEPS = {
    "decide": "filter and columns decided by the middle of the log",
    "reduced_logs": "decoding, filters, regressor, reduction",
    "check": "is least squares possible",
    "tried_prior": "weight of the prior by cross-validation",
    "plausible_fit": "feasible fit and the price of the prior",
    "parameter_table": "intervals of all parameters",
    "_predict": "predictions of both estimates",
    "doubts_of": "mistakes and scale of the log",
    "save": "estimate.json",
    "all": "all of it",
}


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


def split(*arguments: str) -> None:
    """Print elapsed and processor time of each step, once everything is loaded."""
    run = subprocess.run([sys.executable, "-c", SPLIT, *arguments], capture_output=True, text=True)
    if run.returncode:
        sys.exit(run.stderr)
    taken = json.loads(run.stdout)
    if missing := STEPS.keys() - taken.keys():
        sys.exit(f"identify does not pass through {', '.join(sorted(missing))} any more")
    print("beyond start-up: elapsed and processor time")
    for name, what in STEPS.items():
        elapsed, processor = taken[name]
        print(f"  {what:51s}{elapsed:6.3f} s {processor:6.3f} s")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "robot.toml").write_text(robot_toml())
        recording = simulated_log(wam_model(), "A", seed=1).save(place / "log.csv")
        split(str(place / "robot.toml"), str(recording), str(place / "estimate.json"))
        arguments = [str(place / "robot.toml"), str(recording), str(place / "estimate.json")]
        seconds, first = median(IDENTIFY, *arguments), median(FIRST, *arguments)
    print(f"import steelyard                                     {median(IMPORT):6.3f} s")
    print(f"CSV of 37500 samples x 7 joints to estimate.json     {seconds:6.3f} s")
    print(f"processor time of the whole of such a process        {first:6.3f} s")


if __name__ == "__main__":
    main()
