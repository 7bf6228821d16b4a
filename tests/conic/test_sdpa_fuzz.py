"""Mutated SDPA files give a problem or one clear sentence, nothing else."""

import random
from pathlib import Path

import numpy as np
import pytest

from steelyard.conic import SemidefiniteProgram
from steelyard.errors import InputError

SEEDS = (
    '"Example"\n   3  =  mDIM\n   1  =  nBLOCK\n   2  = bLOCKsTRUCT\n{48, -8, 20}\n0 1 1 1 -11\n0 1 2 2  23\n'
    "1 1 1 1  10\n1 1 1 2   4\n2 1 2 2  -8\n3 1 1 2  -8\n3 1 2 2  -2\n",
    "* two blocks\n2\n3\n(2, -3, 1)\n+1.0e+00 2\n0 1 1 1 1.0\n0 1 1 2 0.5\n0 2 1 1 1\n0 2 3 3 -10\n1 1 1 1 1.0\n"
    "1 2 1 1 1.0\n2 2 3 3 -1.0\n2 3 1 1 .5\n",
    '* variable 1: "mass of link 1"\n* block 1: "link 1"\n1\r\n1\r\n4\r\n1.0\r\n0 1 1 4 1e-3\r\n1 1 2 3 1\r\n'
    "1 1 4 4 1\r\n",
)
TOKENS = (
    "0", "1", "-1", "2", "3", "4", "1e308", "1e-320", "-1e400", "nan", "inf", "-inf", "1e", ".", "+", "-", "1.0.0",
    "99999999999999999999", "2147483647", "2147483648", "-2147483648", "1000000000", "9" * 5000, "0x1F", "1_0", "½",
    "٣", "{", "}", "(", ")", ",", "=", "*", '"', "* variable 1: ", '"\\ud83d"', "\x00", "\x1b", "\u2028", "\x85",
    "\ufeff", "\r", "\n", "\t", "\f", " " * 2000, "1 " * 500, "mDIM", "é", "e5", "1D3", "[" * 300,
)  # fmt: skip


def mutated(generator):
    """One of the seeds, changed in one to six places: bytes, tokens, lines, cuts and joins."""
    data = bytearray(generator.choice(SEEDS).encode())
    for _ in range(generator.randint(1, 6)):
        kind = generator.randrange(9)
        place = generator.randrange(len(data) + 1)
        end = min(len(data), place + generator.randint(1, 12))
        if kind == 0 and data:
            data[min(place, len(data) - 1)] = generator.randrange(256)
        elif kind == 1:
            data[place:place] = bytes(generator.randrange(256) for _ in range(generator.randint(1, 8)))
        elif kind == 2:
            del data[place:end]
        elif kind == 3:
            data[place:place] = data[place:end] * generator.randint(1, 50)
        elif kind == 4:
            data[place:place] = generator.choice(TOKENS).encode("utf-8", "surrogatepass")
        elif kind in (5, 6):
            words = bytes(data).split(b" ")
            words[generator.randrange(len(words))] = generator.choice(TOKENS).encode("utf-8", "surrogatepass")
            data = bytearray(b" ".join(words))
        elif kind == 7:
            lines = bytes(data).split(b"\n")
            generator.shuffle(lines)
            data = bytearray(b"\n".join(lines))
        else:
            other = generator.choice(SEEDS).encode()
            data = data[:place] + bytearray(other[generator.randrange(len(other)) :])
    return bytes(data)


@pytest.fixture
def path(tmp_path, monkeypatch):
    """A file whose name is short, so that the messages can be looked at."""
    monkeypatch.chdir(tmp_path)
    return Path("mutated.dat-s")


def survive(path, seed, count):
    """Read that many mutated files; the number that still were problems."""
    generator = random.Random(seed)
    problems = 0
    for _ in range(count):
        data = mutated(generator)
        path.unlink(missing_ok=True)  # a file that is written over goes to the disk before the next
        path.write_bytes(data)
        try:
            program = SemidefiniteProgram.read(path)
        except InputError as error:
            text = str(error)
            assert text.startswith("mutated.dat-s, line "), data
            assert len(text) < 400, data
            assert text.isprintable(), data
            continue
        problems += 1
        # What was read is a problem that holds together, and no larger than its file.
        assert len(program.cost) <= len(data)
        assert len(program.block_sizes) <= len(data)
        assert len(program.value) <= len(data)
        if sum(size * size if size > 0 else -size for size in program.block_sizes) < 1000:
            with np.errstate(over="ignore", invalid="ignore"):
                assert len(program.evaluate(np.zeros(len(program.cost)))) == len(program.block_sizes)
        assert repr(program).isprintable()
    return problems


@pytest.mark.parametrize("count", [500, pytest.param(2_000, marks=pytest.mark.slow)])
def test_mutated_files(path, count):
    assert survive(path, 1, count) > 0.03 * count


@pytest.mark.slow
def test_10000_mutated_files(path):
    assert survive(path, 2, 10_000) > 300


def test_what_was_read_is_written_and_read_again(path):
    generator = random.Random(99)
    again = 0
    while again < 20:
        path.write_bytes(mutated(generator))
        try:
            program = SemidefiniteProgram.read(path)
        except InputError:
            continue
        twin = SemidefiniteProgram.read(program.write("again.dat-s"))
        assert twin.block_sizes == program.block_sizes
        np.testing.assert_array_equal(twin.cost, program.cost)
        np.testing.assert_array_equal(twin.value, program.value)
        assert twin.variable_names == program.variable_names
        again += 1
