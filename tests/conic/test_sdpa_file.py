"""The SDPA sparse format: what its manual and SDPLIB allow, and what is refused."""

import numpy as np
import pytest

from steelyard.conic import SemidefiniteProgram
from steelyard.conic.problem import least_distance
from steelyard.errors import InputError

# Example 1 of the SDPA user's manual, whose optimal value -41.9 it prints.
MANUAL = """"Example 1: mDim = 3, nBLOCK = 1, {2}"
   3  =  mDIM
   1  =  nBLOCK
   2  = bLOCKsTRUCT
{48, -8, 20}
0 1 1 1 -11
0 1 2 2  23
1 1 1 1  10
1 1 1 2   4
2 1 2 2  -8
3 1 1 2  -8
3 1 2 2  -2
"""

SMALL = "1\n2\n2 -2\n1.0\n0 1 1 2 1.5\n1 1 1 1 1\n1 1 2 2 1\n1 2 2 2 -3\n"


@pytest.fixture
def read(tmp_path):
    def reader(text):
        path = tmp_path / "file.dat-s"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return SemidefiniteProgram.read(path)

    return reader


def entries(program):
    parts = (program.matrix, program.block + 1, program.row + 1, program.column + 1, program.value)
    return sorted(tuple(float(value) for value in entry) for entry in zip(*parts, strict=True))


def test_example_of_the_manual(read):
    program = read(MANUAL)
    assert program.cost.tolist() == [48.0, -8.0, 20.0]
    F0, F1 = np.array([[-11.0, 0], [0, 23]]), np.array([[10.0, 4], [4, 0]])
    np.testing.assert_array_equal(program.evaluate([0, 0, 0])[0], -F0)
    np.testing.assert_array_equal(program.evaluate([1, 0, 0])[0], F1 - F0)
    assert program.solve().objective == pytest.approx(-41.9, abs=1e-6)


def test_diagonal_blocks_and_signs(read):
    program = read(SMALL)
    matrix, diagonal = program.evaluate([2.0])
    assert matrix.tolist() == [[2.0, -1.5], [-1.5, 2.0]]
    assert diagonal.tolist() == [0.0, -6.0]
    assert program.block_sizes == (2, -2)


@pytest.mark.parametrize(
    "text",
    [
        SMALL.replace("\n", "\r\n"),
        SMALL.replace("\n", "\r"),
        "* a comment\n" + SMALL.replace("2 -2", "(2, -2)").replace("1.0\n", "{+1.0e+00}\n"),
        "\n\n" + SMALL.replace("\n", "\n\n"),
        SMALL.replace("1\n2\n", "1 = mDIM\n2=nBLOCK\n", 1),
        SMALL.replace("2 -2", "2,\n-2 = bLOCKsTRUCT"),
        SMALL.replace("1.5", "+1.5E+00").replace("-3", "-.3D1"),
        SMALL.replace("0 1 1 2 1.5", "0 1 2 1 1.5"),
        SMALL + "0 1 2 1 1.5\n",
        SMALL.replace("1 2 2 2 -3", "{1, 2, 2, 2, -3}"),
        SMALL.replace("1 1 1 1 1\n", "1.0 1. +1 1.0e0 1\n"),
        SMALL + "1 2 1 2 0\n1 2 1 1 0.0\n",
        SMALL.rstrip("\n"),
        "\ufeff" + SMALL,
    ],
    ids=[
        "CRLF",
        "CR",
        "punctuation",
        "blank lines",
        "text after numbers",
        "sizes over two lines",
        "signs and exponents",
        "lower triangle",
        "whole matrix",
        "braces around entries",
        "integers as floats",
        "zeros",
        "no last line end",
        "byte order mark",
    ],
)
def test_same_program_written_otherwise(read, text):
    program, expected = read(text), read(SMALL)
    assert entries(program) == entries(expected)
    assert program.block_sizes == expected.block_sizes
    assert program.cost.tolist() == expected.cost.tolist()


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "the file ends"),
        ("* only comments\n", 2, "the file ends"),
        ("x\n", 1, "the number of variables expected 1 number"),
        ("1 2\n2\n", 1, "2 were found"),
        ("1.5\n", 1, "whole number of at least 1, got '1.5'"),
        ("0\n1\n1\n\n", 1, "at least 1"),
        ("-3\n", 1, "at least 1"),
        ("1\n2\n2\n", 4, "block sizes expected 2 numbers and 1 were found"),
        ("1\n2\n2 two\n", 3, "after 1 came 'two'"),
        ("1\n2\n2 0\n1\n", 3, "block 2 has size 0"),
        ("1\n1\n99999999999\n1\n", 3, "within 31 bits"),
        ("999999999\n1\n1\n1 2 3\n", 5, "999999999 numbers and 3 were found"),
        ("1\n1\n2\n1e999\n", 4, "beyond the range"),
        ("1\n1\n2\nnan\n", 4, "'nan'"),
        ("1\n1\n2\n1 2\n", 4, "expected 1 number, but 2"),
        (SMALL + "1 1 1\n", 9, "five numbers"),
        (SMALL + "1 1 1 1 1 1\n", 9, "got 6 numbers"),
        (SMALL + "1 1 1 1 one\n", 9, "4 numbers and then 'one'"),
        (SMALL + "2 1 1 1 1\n", 9, "the matrix of an entry must be a whole number from 0 to 1, got '2'"),
        (SMALL + "1 3 1 1 1\n", 9, "the block of an entry"),
        (SMALL + "1 1 3 1 1\n", 9, "the row of an entry of block 1 must be a whole number from 1 to 2"),
        (SMALL + "1 1 1 0 1\n", 9, "the column of an entry of block 1"),
        (SMALL + "1 2 1 2 7\n", 9, "block 2 is diagonal"),
        (SMALL + "1 1 1 1 1\n", 9, "given in line 6 already"),
        (SMALL + "0 1 2 1 1.6\n", 9, "given in line 5 already"),
        (SMALL + "1 1 1 2 1_000\n", 9, "five numbers"),
        (SMALL + "1 1 1 2 0x10\n", 9, "five numbers"),
        (SMALL + "1 1 1 2 ٣\n", 9, "five numbers"),
        (SMALL + "1 1 1 2 " + "9" * 400 + "\n", 9, "beyond the range"),
    ],
)
def test_broken_files_name_the_line(read, text, line, words):
    with pytest.raises(InputError) as caught:
        read(text)
    assert f"file.dat-s, line {line}: " in str(caught.value)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_matrices_of_texts_are_refused():
    with pytest.raises(
        InputError, match=r"a block of F1 of a semidefinite program must be real numbers, got \[\['x'\]\]"
    ):
        SemidefiniteProgram.from_matrices([1.0], [[[[1.0]]], [[["x"]]]])


def test_files_that_cannot_be_opened(tmp_path):
    with pytest.raises(InputError, match=r"absent\.dat-s: cannot be read \(No such file"):
        SemidefiniteProgram.read(tmp_path / "absent.dat-s")
    with pytest.raises(InputError, match="is a folder"):
        SemidefiniteProgram.read(tmp_path)
    with pytest.raises(InputError, match="cannot be written"):
        SemidefiniteProgram.from_matrices([1.0], [[[1.0]], [[1.0]]]).write(tmp_path / "no" / "x.dat-s")


def test_large_claims_cost_nothing(read):
    # A block of two thousand million rows that holds one number is a problem, but cannot be unfolded.
    program = read("1\n2\n2000000000 -2000000000\n1\n1 1 5 1999999999 1\n1 2 7 7 1\n")
    assert len(program.value) == 2
    with pytest.raises(InputError, match="split them into smaller ones"):
        program.to_conic()
    long = read("1\n1\n1\n1\n1 1 1 1 " + "1" * 300 + "\n")
    assert long.value[0] == float("1" * 300)


def test_every_digit_survives(tmp_path):
    rng = np.random.default_rng(5)
    blocks = []
    for _ in range(4):
        matrix = rng.normal(size=(3, 3)) * 10.0 ** rng.integers(-300, 300, size=(3, 3))
        blocks.append([np.triu(matrix) + np.triu(matrix, 1).T, rng.normal(size=5)])
    names = ["Lxx1", 'a "quoted" name\nof two lines', "ü, {braces}"]
    program = SemidefiniteProgram.from_matrices(rng.normal(size=3), blocks, names, ["link 1", "rest"])
    again = SemidefiniteProgram.read(program.write(tmp_path / "all.dat-s"))
    for part in ("cost", "matrix", "block", "row", "column", "value"):
        np.testing.assert_array_equal(getattr(again, part), getattr(program, part))
    assert again.variable_names == tuple(names)
    assert again.block_names == ("link 1", "rest")
    assert [path.name for path in tmp_path.iterdir()] == ["all.dat-s"]


def test_names_in_comments_that_do_not_fit_are_left_out(read):
    assert read('* variable 0: "zero"\n' + SMALL).variable_names == ()
    assert read('* variable 2: "two"\n' + SMALL).variable_names == ()
    assert read('* variable 1: "half \\ud800"\n' + SMALL).variable_names == ()
    assert read('* variable 1: "open\n' + SMALL).variable_names == ()
    assert read('* variable 1: "mass"\n' + SMALL).variable_names == ("mass",)


def test_conic_form_and_back(read):
    for text in (MANUAL, SMALL):
        program = read(text)
        conic = program.to_conic()
        again = SemidefiniteProgram.from_conic(conic)
        assert again.block_sizes == program.block_sizes
        np.testing.assert_allclose(entries(again), entries(program), rtol=1e-15)
        x = np.arange(1.0, 1.0 + len(program.cost))
        values = program.evaluate(x)
        smallest = min(float(np.linalg.eigvalsh(v)[0] if v.ndim == 2 else v.min()) for v in values)
        assert least_distance(conic.cones, conic.b - conic.A @ x) == pytest.approx(smallest)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([1.0], [[[1.0]]]), "1 variables need 2 matrices"),
        (([1.0], [[[1.0]], [[1.0, 2.0]]]), "other shapes"),
        (([1.0], [[np.eye(2)], [np.array([[0.0, 1.0], [0.0, 0.0]])]]), "block 1 of F1 is not symmetric"),
        (([np.nan], [[[1.0]], [[1.0]]]), "finite"),
        (([1.0], [[[]], [[]]]), "size 0"),
        (([1.0], [[[1.0]], [[1.0]]], ["a", "b"]), "2 names"),
    ],
)
def test_matrices_that_do_not_fit(arguments, words):
    with pytest.raises(InputError, match=words):
        SemidefiniteProgram.from_matrices(*arguments)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"matrix": [2]}, "does not exist"),
        ({"block": [1]}, "does not exist"),
        ({"row": [1], "column": [0]}, "upper triangle"),
        ({"column": [2]}, "upper triangle"),
        ({"value": [np.inf]}, "finite"),
        ({"value": [1.0, 2.0]}, "alike"),
        (
            {
                name: [value] * 2
                for name, value in (("matrix", 0), ("block", 0), ("row", 0), ("column", 0), ("value", 1))
            },
            "twice",
        ),
    ],
)
def test_entries_that_do_not_fit(change, words):
    parts = {"matrix": [0], "block": [0], "row": [0], "column": [0], "value": [1.0]} | change
    arrays = {k: np.array(v, dtype=float if k == "value" else np.intp) for k, v in parts.items()}
    with pytest.raises(InputError, match=words):
        SemidefiniteProgram(cost=np.ones(1), block_sizes=(2,), **arrays)


def test_nothing_to_write_is_said(tmp_path):
    with pytest.raises(InputError, match="at least one variable and one block"):
        SemidefiniteProgram.from_matrices(np.zeros(0), [[[1.0]]]).write(tmp_path / "x.dat-s")
