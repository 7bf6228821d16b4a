"""Tries every reader on thousands of damaged files, each in a process with bounds on memory and time.

A file may be read, or refused with one of Steelyard's own errors. Everything else is told: other exceptions, warnings,
words on the terminal, hangs, deaths of the process, and numbers that are not finite but were accepted.

    python benchmarks/damaged_files.py [--count 3000] [--seed 0] [--processes 2] [KIND ...]
    python benchmarks/damaged_files.py --total 1000000
"""

import argparse
import collections
import math
import os
import random
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "oracles"))
TIME, MEMORY = 5.0, 2**30  # s and bytes for one file
ADDRESSES = 4 * 2**30  # the address space of a process, much of which libraries only reserve
Part = tuple[str, int, int]
"""A kind, the number of its first file, and the one behind the last."""


def work(place: Path, seed: int, parts: list[Part]) -> None:
    """Read damaged files one after the other; print each one's kind and number, and what is wrong with it."""
    import resource

    import mutations  # all readers, before the limits

    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("error")
    for kind, first, last in parts:
        work_on(mutations, kind, place / kind, first, last, seed)
    print("# end", flush=True)


def work_on(mutations: ModuleType, kind: str, folder: Path, first: int, last: int, seed: int) -> None:
    """Read damaged files of one kind."""
    from steelyard.errors import SteelyardError

    content = (folder / kind).read_bytes()
    together = 8 if kind in mutations.MESHES else 1  # one process reads all meshes that are asked for at once
    for begin in range(first, last, together):
        print("#", kind, begin, flush=True)
        places = []
        for number in range(begin, min(begin + together, last)):
            places.append(folder / f"damaged{number - begin}-{kind}")
            places[-1].write_bytes(mutations.damaged(content, kind, random.Random(f"{kind} {seed} {number}")))
        for read in mutations.READERS[kind]:
            before = spent()
            Path("/proc/self/clear_refs").write_text("5")  # forgets the peak so far
            try:
                read(*places)
            except* SteelyardError as refused:
                for message in map(str, leaves(refused)):
                    if "\n" in message or len(message) > 1000:
                        print("!", f"a message of {len(message)} characters: {message[:100]!r}", flush=True)
            except* (KeyboardInterrupt, SystemExit):
                raise
            except* BaseException as others:
                for error in leaves(others):
                    frames = [f for f in traceback.extract_tb(error.__traceback__) if "steelyard" in f.filename]
                    where = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "?"
                    text = " ".join(str(error).split())[:150]
                    print("!", f"{type(error).__name__} at {where}: {text}", flush=True)
            if spent() - before > TIME:
                print("!", f"slow: {spent() - before:.1f} s in {read.__name__}", flush=True)
            if (most := peak()) > MEMORY:
                print("!", f"memory: {most / 2**20:.0f} MiB in {read.__name__}", flush=True)


def leaves(group: BaseExceptionGroup[BaseException]) -> Iterator[BaseException]:
    """Yield the exceptions of a group and of the groups in it."""
    for error in group.exceptions:
        yield from leaves(error) if isinstance(error, BaseExceptionGroup) else (error,)


def spent() -> float:
    """Processor time of this process and of those that it started, in s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def peak() -> int:
    """Most memory that this process held since the peak was forgotten, or any of its children ever, in bytes."""
    import resource

    (own,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return 1024 * max(int(own.split()[1]), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)


def used(process: int) -> float:
    """Processor time of another process and its children so far, in s; 0 of one that has ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK") + sum(used(int(child)) for child in children)


def watch(place: Path, kinds: dict[str, int], seed: int) -> int:
    """Let processes read so many damaged files of some kinds; tell what went wrong, and return how often."""
    found: dict[str, collections.Counter[str]] = {kind: collections.Counter() for kind in kinds}
    examples: dict[tuple[str, str], int] = {}
    parts = [(kind, 0, count) for kind, count in kinds.items()]
    kind, number, _ = parts[0]

    def wrong(text: str) -> None:
        found[kind][text] += 1
        examples.setdefault((kind, text), number)

    while parts:
        command = [sys.executable, __file__, "--work", str(place), str(seed)]
        command += [str(word) for part in parts for word in part]
        with (
            tempfile.TemporaryFile() as errors,
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as process,
        ):
            ended = False
            assert process.stdout is not None
            hung = False
            begun = before = 0.0
            while True:
                ready, _, _ = select.select([process.stdout], [], [], 6 * TIME)
                if not ready:
                    # Beside other work a process waits for a processor longer than it computes: it hangs if it
                    # computes for long without an end, or if it waits for something else than a processor.
                    last, before = before, used(process.pid)
                    if before > last and before - begun < 2 * TIME:
                        continue
                    hung = True
                    process.send_signal(signal.SIGKILL)
                    break
                line = process.stdout.readline()
                if not line:
                    break
                mark, _, text = line.rstrip("\n").partition(" ")
                if line.startswith("# end"):
                    ended = True
                elif mark == "#":
                    kind, _, text = text.rpartition(" ")
                    number, begun = int(text), used(process.pid)
                else:
                    wrong(text)
            process.wait()
            errors.seek(0)
            said = errors.read().decode(errors="replace").strip()
            if said:
                wrong(f"on the terminal: {said.splitlines()[0][:150]} … ({len(said.splitlines())} lines)")
        if ended:
            break
        wrong("hangs" if hung else f"ends with {process.returncode}")
        number += 1  # on with the file behind the one at which it ended
        names = list(kinds)
        rest = names[names.index(kind) + (number >= kinds[kind]) :]
        parts = [(name, number if name == kind else 0, kinds[name]) for name in rest]
        if parts:
            kind, number, _ = parts[0]
    for name, count in kinds.items():
        print(f"{name}: {count} files, {sum(found[name].values())} faults", flush=True)
        for text, times in found[name].most_common():
            print(f"  {times:5d}  {text}  (number {examples[name, text]})", flush=True)
    return sum(sum(faults.values()) for faults in found.values())


def main() -> None:
    if sys.argv[1:2] == ["--work"]:
        place, seed, *words = sys.argv[2:]
        parts = zip(words[::3], map(int, words[1::3]), map(int, words[2::3]), strict=True)
        work(Path(place), int(seed), list(parts))
        return
    from mutations import READERS, TAKES_LONG, is_readable, write_samples

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=", ".join(READERS))
    parser.add_argument("--count", type=int, default=3000, help="files of each kind; a tenth of those that take long")
    parser.add_argument("--total", type=int, help="files in all, instead of --count")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    shares = {kind: 0.1 if kind in TAKES_LONG else 1.0 for kind in options.kinds or filter(is_readable, READERS)}
    each = options.count if options.total is None else options.total / sum(shares.values())
    counts = {kind: math.ceil(share * each) for kind, share in shares.items()}
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(options.processes) as threads:
        write_samples(samples := Path(place, "samples"))
        for kind in counts:  # some readers put a second file beside the damaged one
            shutil.copytree(samples, Path(place, kind))
        # Starting a process takes as long as reading a hundred files, so that some kinds share one.
        shared = [dict(list(counts.items())[k :: 4 * options.processes]) for k in range(4 * options.processes)]
        total = sum(threads.map(lambda kinds: watch(Path(place), kinds, options.seed), filter(None, shared)))
    print(f"{sum(counts.values())} files of {len(counts)} kinds in {time.monotonic() - begin:.0f} s")
    print(f"{total} faults")
    sys.exit(total > 0)


if __name__ == "__main__":
    main()
