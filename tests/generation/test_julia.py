"""Generated Julia: run where Julia is installed, and read by an independent reader everywhere."""

import ast
import keyword
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from steelyard.generation import Project, files, generate

from .conftest import need, run
from .test_script_languages import check, fresh


class JuliaReader:
    """Reads the Julia that is generated, line by line, and evaluates it; knows nothing of how it is written."""

    LOCAL = re.compile(r"\(?(\w+(?:, \w+)*)\)? = (.+)")
    STORE = re.compile(r"(\w+)\[([\d, ]*)\] = (.+)")
    FILL = re.compile(r"(\w+) \.= ([\d.]+)")

    def __init__(self, text: str) -> None:
        text = re.sub(r'^@doc raw""".*?^"""$', "", text, flags=re.MULTILINE | re.DOTALL)
        lines = [line.strip() for line in text.splitlines() if line.strip() and not line.strip().startswith("#")]
        assert re.fullmatch(r"module [A-Z]\w*", lines[0])
        assert lines[-1] == "end"
        self.functions: dict[str, tuple[list[str], list[str]]] = {}
        self.constants: dict[str, float] = {}
        self.exported = [line.removeprefix("export ") for line in lines if line.startswith("export ")]
        position = 1
        while position < len(lines) - 1:
            line = lines[position]
            head = re.fullmatch(r"function (\w+!)\((.*)\)", line)
            if head:
                position = self._function(lines, position, head)
            elif line.startswith("const "):
                name, value = line.removeprefix("const ").split(" = ")
                self.constants[name] = float(value)
            else:
                assert line.startswith("export "), line
            position += 1

    def _function(self, lines: list[str], position: int, head: re.Match[str]) -> int:
        parameters = [p.split("::")[0] for p in re.split(r", (?=\w+::)", head[2])] if head[2] else []
        body, depth = [], 1
        while depth:
            position += 1
            depth += lines[position] == "@inbounds begin"
            depth -= lines[position] == "end"
            body.append(lines[position])
        self.functions[head[1]] = (parameters, body[:-1])
        return position

    def call(self, name: str, outputs: list[np.ndarray], inputs: list[np.ndarray]) -> None:
        parameters, body = self.functions[name]
        scope: dict[str, object] = dict(zip(parameters, [*outputs, *inputs], strict=True))
        for line in body:
            guard = re.fullmatch(r"(size|length)\((\w+)\) == (.+) \|\| throw\(.*\)", line)
            store, fill, local = self.STORE.fullmatch(line), self.FILL.fullmatch(line), self.LOCAL.fullmatch(line)
            if guard:
                found = scope[guard[2]].shape if guard[1] == "size" else len(scope[guard[2]])
                assert found == ast.literal_eval(guard[3])
            elif store:
                place = tuple(int(k) - 1 for k in store[2].split(",")) if store[2] else ()
                scope[store[1]][place] = self.value(store[3], scope)
            elif fill:
                scope[fill[1]][...] = float(fill[2])
            elif local:
                names, value = local[1].split(", "), self.value(local[2], scope)
                assert not set(names) & set(scope), "each local variable is set once"
                scope |= dict(zip(names, value if len(names) > 1 else [value], strict=True))
            else:
                assert line in ("@inbounds begin", "end", "return nothing") or line.startswith(
                    "Base.require_one_based_indexing("
                ), line

    def value(self, text: str, scope: dict[str, object]) -> object:
        functions = {"sin": np.sin, "cos": np.cos, "sign": np.sign, "sincos": lambda x: (np.sin(x), np.cos(x))}
        operators = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide}

        def at(node: ast.expr) -> object:
            match node:
                case ast.Constant(value=float() | int() as number):
                    assert isinstance(number, float), "an integer would make integer arithmetic"
                    return number
                case ast.Name(id=name):
                    return scope[name]
                case ast.Subscript(value=ast.Name(id=name), slice=ast.Constant(value=int() as index)):
                    return scope[name][index - 1]
                case ast.UnaryOp(op=ast.USub(), operand=operand):
                    return -at(operand)
                case ast.BinOp(left=left, op=operator, right=right):
                    return operators[type(operator)](at(left), at(right))
                case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
                    return functions[name](at(argument))
            raise AssertionError(f"not understood: {text}")

        # Words that Python keeps for itself are names in Julia.
        kept = re.compile(rf"\b({'|'.join(keyword.kwlist)})\b")
        scope = {kept.sub(r"\1_", name): value for name, value in scope.items()}
        return at(ast.parse(kept.sub(r"\1_", text), mode="eval").body)


@pytest.mark.parametrize("which", ["wam_generated", "odd_generated"])
def test_julia_read_by_an_independent_reader(which: str, request: pytest.FixtureRequest) -> None:
    project: Project = request.getfixturevalue(which)
    written = files(project, "julia")
    (source,) = (text for path, text in written.items() if path.startswith("src/"))
    manifest = tomllib.loads(written["Project.toml"])
    assert re.fullmatch(r"[0-9a-f-]{36}", manifest["uuid"])
    assert f"src/{manifest['name']}.jl" in written
    reader = JuliaReader(source)
    assert set(reader.exported) == {*reader.functions, *reader.constants}
    inputs = fresh(project)
    found = []
    for name, function, samples in zip(reader.functions, project.functions, inputs, strict=True):
        for arrays in samples:
            outputs = [np.full(output.shape, np.nan) for output in function.outputs]
            reader.call(name, outputs, arrays)
            found.append([output.ravel() for output in outputs])
    check(project, inputs, found)
    test = written["test/runtests.jl"]
    for name in reader.functions:
        assert f'@testset "{name}" begin' in test
    opened = len(re.findall(r"^\s*(?:let$|@testset .* begin$)", test, re.MULTILINE))
    assert opened == len(re.findall(r"^\s*end$", test, re.MULTILINE))


def test_julia_runs_where_it_is_installed(wam_generated: Project, tmp_path: Path) -> None:
    need("julia")
    generate(wam_generated, "julia", tmp_path)
    run(["julia", "--startup-file=no", "--project=.", "test/runtests.jl"], tmp_path)
