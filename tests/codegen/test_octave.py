"""Generated Octave and MATLAB functions: run by Octave, and read for what MATLAB would not take."""

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from steelyard.codegen import Project, files, generate
from steelyard.graph import Argument, Function, Graph, Output

from .conftest import need, project_of, run
from .scripts import check, fresh, mutated, plain_project, project_with_names, several_functions

HEAD = re.compile(r"^function \[(?P<results>.*?)\] = (?P<name>\w+)\((?P<arguments>.*?)\) %#codegen$", re.MULTILINE)


def octave(script: str, folder: Path) -> list[str]:
    need("octave-cli")
    path = folder / "driver.m"
    path.write_text(script, encoding="utf-8")
    return run(["octave-cli", "--norc", "--no-history", path], folder).splitlines()


def names_of(project: Project) -> list[str]:
    """What the functions of a project are called, in its order, by their arguments and outputs."""
    heads = [found for text in files(project, "octave").values() if (found := HEAD.search(text))]
    names = []
    for function in project.functions:
        (name,) = {head["name"] for head in heads if head["name"].lower().endswith(f"_{function.name.lower()}")}
        names.append(name)
    return names


def row(values: Sequence[float]) -> str:
    return f"[{', '.join(map(repr, map(float, values)))}]" if len(values) else "[]"


@pytest.mark.slow
def test_functions_agree_at_fresh_inputs(wam_generated: Project, odd_generated: Project, tmp_path: Path) -> None:
    """All the functions of three projects in one start of Octave, and their self-tests."""
    projects = (wam_generated, odd_generated, several_functions())
    lines: list[str] = []
    for k, project in enumerate(projects):
        generate(project, "octave", tmp_path / str(k))
        lines.append(f"addpath('{tmp_path / str(k)}');")
        for name, function, samples in zip(names_of(project), project.functions, fresh(project), strict=True):
            for arrays in samples:
                results = ", ".join(f"r{j}" for j in range(len(function.outputs)))
                lines.append(f"[{results}] = {name}({', '.join(map(row, arrays))});")
                for j, output in enumerate(function.outputs):
                    shape = output.shape if len(output.shape) > 1 else (*output.shape, 1, 1)[:2]
                    while len(shape) > 2 and shape[-1] == 1:
                        shape = shape[:-1]
                    lines.append(f"assert(isequal(size(r{j}), {row(shape)}));")
                    lines.append(f"r = permute(r{j}, ndims(r{j}):-1:1); printf('%.17g ', r(:)); printf('\\n');")
    for k in range(len(projects)):
        (test,) = (tmp_path / str(k)).glob("*_self_test.m")
        lines.append(f"{test.stem}();")
    printed = octave("\n".join(lines), tmp_path)
    assert [line for line in printed if "agree" in line] == printed[-3:]
    rows = iter([[float(x) for x in line.split()] for line in printed[:-3]])
    for project in projects:
        inputs = fresh(project)
        found = [
            [np.array(next(rows)) for _ in function.outputs]
            for function, samples in zip(project.functions, inputs, strict=True)
            for _ in samples
        ]
        check(project, inputs, found)
    assert next(rows, None) is None


def test_help_sizes_and_refusals(tmp_path: Path) -> None:
    project = several_functions()
    generate(project, "octave", tmp_path)
    refused = ("zeros(2, 1)", "single(zeros(3, 1))", "[1i, 0, 0]", "'abc'", "int8([1, 2, 3])")
    lines = ["help elbow_jacobian", "sizes = elbow_sizes();", "printf('%d ', sizes.q_size, sizes.jacobian_columns);"]
    for wrong in refused:
        lines.append(f"try, elbow_jacobian({wrong}, [0; 0; 0]); printf('taken\\n');")
        lines.append("catch problem, printf('\\n%s %s', problem.identifier, problem.message); end")
    lines.append("r = elbow_jacobian([1, 2, 3], [0; 0; 0]); printf('\\nsize %d %d\\n', size(r));")
    lines.append("disp(isequal(r, elbow_jacobian([1; 2; 3], [0, 0, 0])));")
    printed = octave("\n".join(lines), tmp_path)
    text = re.sub(r"\s+", " ", " ".join(printed))
    function = project.functions[3]
    assert function.description in text
    for argument in function.arguments:
        for k, element in enumerate(argument.elements):
            assert f"{argument.name}({k + 1}): {element}" in text
    assert " 3 3 " in text
    assert text.count("elbow_jacobian:q q must be a real double array of 3 elements, not") == len(refused)
    assert "taken" not in text
    assert text.endswith("size 6 3 1")


def failures(folder: Path, changes: Sequence[tuple[str, str]]) -> list[bool]:
    """Whether the self-test fails after each change alone, all in one start of Octave."""
    lines = []
    source = folder / "plain_robot_torque.m"
    good = source.read_text(encoding="utf-8")
    for k, (pattern, replacement) in enumerate([("torque", "torque"), *changes]):
        changed = folder / f"changed_{k}"
        changed.mkdir()
        for path in folder.glob("*.m"):
            (changed / path.name).write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
        if k:
            mutated(changed / source.name, pattern, replacement)
            assert (changed / source.name).read_text(encoding="utf-8") != good
        lines.append(f"cd('{changed}'); clear all;")
        lines.append("try, plain_robot_self_test(); disp('passed'); catch problem, disp(problem.identifier); end")
    printed = [line for line in octave("\n".join(lines), folder) if "agree" not in line]
    assert printed[0] == "passed"
    return [line.startswith("self_test:") for line in printed[1:]]


def test_self_test_notices_changes(tmp_path: Path) -> None:
    generate(plain_project(), "octave", tmp_path)
    changes = [
        (r"sin\(", "cos("),
        (r"parameters\(2\) \*", "parameters(1) *"),
        (r" - q\(1\)", ""),
        (r"tau\(2\) = .*;", "tau(2) = nan;"),
        (r"zeros\(2, 1\)", "zeros(3, 1)"),
    ]
    assert failures(tmp_path, changes) == [True] * len(changes)


def test_a_failing_self_test_ends_octave_with_an_error(tmp_path: Path) -> None:
    need("octave-cli")
    generate(plain_project(), "octave", tmp_path)
    mutated(tmp_path / "plain_robot_torque.m", r"sin\(", "cos(")
    command = ["octave-cli", "--norc", "--no-history", "--eval", "plain_robot_self_test"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "element 1 of tau of plain_robot_torque" in done.stderr


@pytest.mark.slow
def test_keywords_are_no_names(tmp_path: Path) -> None:
    """The list of Octave itself."""
    words = [word for word in octave("printf('%s\\n', iskeyword(){:});", tmp_path) if re.fullmatch(r"[a-z]\w*", word)]
    assert {"end", "endfunction", "endspmd"} <= set(words)
    generate(project_with_names(words), "octave", tmp_path)
    assert "agree" in octave(f"cd('{tmp_path}'); words_self_test();", tmp_path)[-1]


# Statements of both languages: these, and comments.
NAME = r"[A-Za-z]\w*"
STATEMENT = re.compile(
    rf"function (?:\[?[\w, ]*\]? = )?{NAME}\([\w, ]*\)(?: %#codegen)?"
    rf"|if ~\(isa\({NAME}, ''\) && isreal\({NAME}\) && numel\({NAME}\) == \d+\)"
    rf"|if numel\({NAME}\) ~= numel\({NAME}\)"
    rf"|if ~\(abs\({NAME}\(k\) - {NAME}\(k\)\) <= {NAME}\)"
    rf"|for k = 1:numel\({NAME}\)"
    rf"|(?:error|fprintf|compare|test_\d+)\([^;]*\);"
    rf"|(?:{NAME}|\[[\w, ]*\]|{NAME}\([\d, :]*\)|sizes\.{NAME}) = [^;=~!&|#\"@{{}}]*;"
    r"|end"
)


def test_files_are_matlab_too(wam_generated: Project, odd_generated: Project) -> None:
    """Every statement is of a form that both languages have, and nothing is written as in Octave alone."""
    for project in (wam_generated, odd_generated, several_functions(), plain_project()):
        for path, text in files(project, "octave").items():
            if not path.endswith(".m"):
                continue
            assert len(path.removesuffix(".m")) <= 63
            assert re.fullmatch(NAME, path.removesuffix(".m"))
            code = re.sub(r"\.\.\.\n\s*", "", text)
            lines = [line.strip() for line in code.splitlines()]
            lines = [re.sub(r"'[^'\n]*'", "''", line) for line in lines if line and not line.startswith("%")]
            assert [line for line in lines if not STATEMENT.fullmatch(line)] == []
            code = "\n".join(lines).replace("%#codegen", "").replace("fprintf(", "")
            for foreign in ("#", '"', "!", "+=", "-=", "*=", "++", "--", "endfunction", "endif", "printf(", "**", "%"):
                assert foreign not in code, (path, foreign)
            opened = sum(line.startswith(("function ", "if ", "for ")) for line in lines)
            assert opened == lines.count("end"), path
            (function,) = (line for line in lines if line.startswith("function ") and path.removesuffix(".m") in line)
            assert lines[0] == function, "the first function has the name of the file"
            assert text.startswith(f"% {path.removesuffix('.m')}. Generated by Steelyard")


def test_octave_only_statements_are_recognised() -> None:
    for line in (
        "x += 1;",
        'x = "a";',
        "x = !y;",
        "printf('a');",
        "endif",
        "x = 3 # three",
        "if (x) y = 1; end",
        "x++;",
    ):
        assert not STATEMENT.fullmatch(re.sub(r"'[^'\n]*'", "''", line)), line


def test_long_and_equal_names_become_different_files() -> None:
    functions = []
    for name in ("pose_" + "x" * 80, "pose_" + "x" * 80 + "y", "Pose", "pose"):
        x = Graph().inputs("x", 1)
        functions.append(Function(name, (Argument("x", 1),), (Output("y", (), (x[0] + 1.0,)),)))
    paths = [
        path for path in files(project_of("A robot with a long name " * 5, functions), "octave") if path[-2:] == ".m"
    ]
    assert len({path.lower() for path in paths}) == 6
    assert max(map(len, paths)) <= 65
