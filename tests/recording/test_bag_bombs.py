"""Bags of a few kB that ask for gigabytes or hours are refused in one sentence, with little memory."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Timer
from typing import IO

import pytest
from bombs import BOMBS

pytest.importorskip("rosbags", reason="bags are read with rosbags")
pytest.importorskip("mcap", reason="MCAP files are read with mcap")
pytestmark = pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="nothing tells the peak of memory")

WAIT, MEMORY = 120.0, 2**30  # s and bytes
READER = """
import json, resource, sys
from pathlib import Path
import steelyard as sy
from steelyard.errors import SteelyardError
resource.setrlimit(resource.RLIMIT_AS, (4 * 2**30, 4 * 2**30))
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
for line in sys.stdin:
    Path("/proc/self/clear_refs").write_text("5")  # forgets the peak so far
    try:
        sy.Recording.read(line.strip(), joints=1)
        said = "it was read"
    except SteelyardError as error:
        said = str(error)
    (peak,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    print(json.dumps([said, 1024 * int(peak.split()[1])]), flush=True)
"""
"""A process that reads the logs that it is told, and says what came of it, and in how many bytes."""


class Reader:
    """Reads logs in a process with limits, a new one where it has ended."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def read(self, path: Path) -> tuple[str, int]:
        """Return what is said of a log, and the peak of the memory; one that takes far too long fails the test.

        Each is refused within some seconds, on whatever machine; what they ask for would take hours.
        """
        if self._process is None or self._process.poll() is not None:
            source = str(Path(__file__).parents[2] / "src")
            self._process = subprocess.Popen(
                [sys.executable, "-c", READER],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env={**os.environ, "PYTHONPATH": source},
            )
        told: IO[str] | None = self._process.stdin
        answers: IO[str] | None = self._process.stdout
        assert told is not None
        assert answers is not None
        print(path, file=told, flush=True)
        guard = Timer(WAIT, self._process.kill)
        guard.start()
        try:
            answer = answers.readline()
        finally:
            guard.cancel()
        assert answer, f"the process that reads {path.name} ended with {self._process.wait()}, or took {WAIT:g} s"
        said, peak = json.loads(answer)
        return said, peak

    def end(self) -> None:
        if self._process is not None:
            self._process.communicate()


@pytest.fixture(scope="module")
def reader() -> Iterator[Reader]:
    reader = Reader()
    yield reader
    reader.end()


TOO_LARGE = "unpack to more than 128 MiB; write it again in smaller chunks, or without compression."
LYING = "a chunk does not unpack to the 5000 bytes that it states;"
TOO_MUCH = "unpacks to far more than a recording of its size holds; record it again"
NOTHING = "is of a type that holds nothing;"
REFUSED = {
    "honest_lz4.mcap": TOO_LARGE,
    "honest_zstd.mcap": TOO_LARGE,
    "lying_lz4.mcap": LYING,
    "lying_zstd.mcap": LYING,
    "unindexed_zstd.mcap": TOO_LARGE,
    "messages.mcap": TOO_MUCH,
    "chunks.mcap": TOO_MUCH,
    "overlapping.mcap": "has too many chunks that begin before others end;",
    "again.mcap": TOO_MUCH,
    "channels.mcap": TOO_MUCH,
    "in_summary.mcap": TOO_LARGE,
    "objects.mcap": "no message of /joint_states",
    "empty_fields.mcap": NOTHING,
    "brackets.mcap": "computes with brackets or shifts;",
    "shifts.mcap": "computes with brackets or shifts;",
    "comments.mcap": "cannot be read as MCAP:",
    "names.mcap": "in 4 ways with more than 10000 names;",
    "honest_lz4.bag": TOO_LARGE,
    "honest_bz2.bag": TOO_LARGE,
    "lying_lz4.bag": LYING,
    "lying_bz2.bag": LYING,
    "alternating_bz2.bag": TOO_MUCH,
    "alternating_lz4.bag": TOO_MUCH,
    "header.bag": TOO_MUCH,
    "again_bz2.bag": TOO_MUCH,
    "index.bag": "its index lists more messages than it holds;",
    "empty_fields.bag": NOTHING,
    "file": TOO_MUCH,
    "message": TOO_LARGE,
    "one_name": "names a file twice;",
    "merges": "merges mappings;",
    "aliases": "is not that of a bag;",
    "folder_zstd": TOO_LARGE,
    "folder_message": TOO_LARGE,
    "computed.db3": "its table messages is computed, not recorded;",
    "shared_pages.db3": TOO_MUCH,
    "searched.db3": TOO_MUCH,
    "endless.db3": "its table message_definitions is computed, not recorded;",
}
TAKES_LONG = {
    "file",
    "messages.mcap",
    "again_bz2.bag",
    "lying_bz2.bag",
    "honest_bz2.bag",
    "alternating_bz2.bag",
    "chunks.mcap",
    "one_name",
    "names.mcap",
    "alternating_lz4.bag",
    "header.bag",
    "shared_pages.db3",
}
"""What takes seconds to pack, or to read until it is refused."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in TAKES_LONG)) for name in REFUSED]
)
def test_a_bag_of_a_few_kB_does_not_fill_the_memory(name: str, reader: Reader, tmp_path: Path) -> None:
    path = BOMBS[name](tmp_path / name)
    said, peak = reader.read(path)
    assert REFUSED[name] in said
    assert said.endswith(".")
    assert "\n" not in said
    assert len(said) < 1000
    assert peak < MEMORY


def test_every_bomb_is_tried() -> None:
    assert REFUSED.keys() == BOMBS.keys()
