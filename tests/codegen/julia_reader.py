"""Reads and evaluates generated Julia by the rules of the language, knowing nothing of how it is written.

It takes the part of Julia that a function of plain arithmetic needs, and refuses everything else.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Value = Any
Expression = Callable[[dict[str, Value]], Value]

_TOKEN = re.compile(
    r"""
    (?P<comment>\#(?!=)[^\n]*)
  | (?P<raw>raw\"\"\".*?\"\"\")
  | (?P<string>"[^"\\$\n]*")
  | (?P<number>(?:\d+\.\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?(?![A-Za-z_(]))
  | (?P<name>[A-Za-z_][A-Za-z_0-9]*!?)
  | (?P<operator>::|==|\|\||\.=|[-+*/=()\[\]{},.@])
  | (?P<newline>\n)
  | (?P<space>[ \t]+)
    """,
    re.VERBOSE | re.DOTALL,
)
# The short functions of a self-test, which the reader has in Python.
_HELPERS = """
elements(x::Ref) = [x[]]
elements(x::AbstractArray) = vec(permutedims(x, ndims(x):-1:1))
agrees(x, y, tolerance) = length(x) == length(y) && all(abs.(x .- y) .<= tolerance)
""".strip()
_BINDING = {"+": 10, "-": 10, "*": 20, "/": 20}


class JuliaError(Exception):
    """The text is not Julia of the kind that is understood."""


class DimensionMismatchError(Exception):
    """A check of sizes failed."""


@dataclass
class JuliaFunction:
    parameters: list[tuple[str, str]]
    documentation: str
    body: list[Callable[[dict[str, Value]], None]] = field(default_factory=list)


@dataclass
class JuliaModule:
    name: str
    constants: dict[str, float] = field(default_factory=dict)
    exported: list[str] = field(default_factory=list)
    functions: dict[str, JuliaFunction] = field(default_factory=dict)

    def call(self, name: str, *arguments: Value) -> None:
        """Run a function; its first arguments are overwritten."""
        function = self.functions[name]
        scope: dict[str, Value] = dict(self.constants)
        for (parameter, kind), argument in zip(function.parameters, arguments, strict=True):
            dimensions = {"Ref{Float64}": 0, "AbstractVector{Float64}": 1, "AbstractMatrix{Float64}": 2}
            found = re.fullmatch(r"AbstractArray\{Float64,(\d+)\}", kind)
            assert argument.ndim == (int(found[1]) if found else dimensions[kind])
            scope[parameter] = argument
        for statement in function.body:
            statement(scope)


class Reader:
    """A recursive-descent parser over tokens."""

    def __init__(self, text: str) -> None:
        self.tokens: list[tuple[str, str]] = []
        depth, position = 0, 0
        while position < len(text):
            match = _TOKEN.match(text, position)
            if match is None:
                raise JuliaError(f"not understood: {text[position : position + 40]!r}")
            position = match.end()
            kind, token = str(match.lastgroup), match[0]
            depth += {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}.get(token, 0)
            if kind not in ("comment", "space") and not (kind == "newline" and depth):
                self.tokens.append((kind, token))
        self.tokens.append(("end", ""))
        self.position = 0

    @classmethod
    def of_self_test(cls, text: str) -> "Reader":
        """Read ``test/runtests.jl``."""
        assert text.count(_HELPERS) == 1
        return cls(text.replace(_HELPERS, ""))

    # Tokens

    @property
    def kind(self) -> str:
        return self.tokens[self.position][0]

    @property
    def token(self) -> str:
        return self.tokens[self.position][1]

    def take(self, kind: str = "", token: str = "") -> str:
        if (kind and self.kind != kind) or (token and self.token != token):
            raise JuliaError(f"expected {token or kind}, found {self.token!r}")
        self.position += 1
        return self.tokens[self.position - 1][1]

    def found(self, token: str) -> bool:
        if self.token != token or self.kind == "string":
            return False
        self.position += 1
        return True

    def skip_lines(self) -> None:
        while self.kind == "newline":
            self.position += 1

    def end_of_line(self) -> None:
        if self.kind != "end":
            self.take("newline")
        self.skip_lines()

    # Modules and functions

    def module(self) -> JuliaModule:
        self.skip_lines()
        self.take("name", "module")
        module = JuliaModule(self.take("name"))
        self.end_of_line()
        documentation = ""
        while not self.found("end"):
            if self.found("export"):
                module.exported.append(self.take("name"))
            elif self.found("const"):
                name = self.take("name")
                self.take(token="=")
                module.constants[name] = self.expression()({})
            elif self.found("@"):
                self.take("name", "doc")
                documentation = self.take("raw")
            else:
                self.take("name", "function")
                name = self.take("name")
                assert name not in module.functions
                assert documentation, f"{name} has no documentation"
                module.functions[name] = JuliaFunction(self.parameters(), documentation)
                self.end_of_line()
                self.body(module.functions[name])
                documentation = ""
            self.end_of_line()
        self.skip_lines()
        self.take("end")
        return module

    def parameters(self) -> list[tuple[str, str]]:
        result = []
        self.take(token="(")
        while not self.found(")"):
            name = self.take("name")
            self.take(token="::")
            kind = self.take("name") + self.take(token="{")
            while not self.found("}"):
                kind += self.take()
            result.append((name, kind + "}"))
            if not self.found(","):
                self.take(token=")")
                break
        assert len({name for name, _ in result}) == len(result)
        return result

    def body(self, function: JuliaFunction) -> None:
        defined = {name for name, _ in function.parameters}
        while not self.found("end"):
            if self.found("return"):
                self.take("name", "nothing")
            elif self.found("@"):
                self.take("name", "inbounds")
                self.take("name", "begin")
                self.end_of_line()
                while not self.found("end"):
                    function.body.append(self.assignment(defined))
                    self.end_of_line()
            elif self.found("Base"):
                self.take(token=".")
                self.take("name", "require_one_based_indexing")
                self.take(token="(")
                while not self.found(")"):
                    assert self.take("name") in defined
                    self.found(",")
            else:
                function.body.append(self.check())
            self.end_of_line()

    def check(self) -> Callable[[dict[str, Value]], None]:
        left = self.expression()
        self.take(token="==")
        right = self.expression()
        self.take(token="||")
        for token in ("throw", "(", "DimensionMismatch", "("):
            self.take(token=token)
        message = self.take("string")
        self.take(token=")")
        self.take(token=")")

        def run(scope: dict[str, Value]) -> None:
            if left(scope) != right(scope):
                raise DimensionMismatchError(message)

        return run

    def assignment(self, defined: set[str]) -> Callable[[dict[str, Value]], None]:
        if self.found("("):
            names = [self.take("name")]
            while self.found(","):
                names.append(self.take("name"))
            self.take(token=")")
            self.take(token="=")
            values = self.expression()
            assert not defined & set(names), "a local variable is set once"
            defined |= set(names)
            return lambda scope: scope.update(zip(names, values(scope), strict=True))
        name = self.take("name")
        if self.found(".="):
            fill = self.expression()
            return lambda scope: scope[name].fill(fill(scope))
        if self.found("["):
            places = self.sequence("]")
            self.take(token="=")
            value = self.expression()

            def store(scope: dict[str, Value]) -> None:
                indices = [place(scope) for place in places]
                assert len(indices) == scope[name].ndim
                assert all(type(i) is int and i >= 1 for i in indices)
                scope[name][tuple(i - 1 for i in indices)] = value(scope)

            return store
        self.take(token="=")
        assert name not in defined, "a local variable is set once"
        value = self.expression()
        defined.add(name)
        return lambda scope: scope.update({name: value(scope)})

    # Expressions

    def sequence(self, closing: str) -> list[Expression]:
        items: list[Expression] = []
        while not self.found(closing):
            items.append(self.expression())
            if not self.found(","):
                self.take(token=closing)
                break
        return items

    def expression(self, least: int = 0) -> Expression:
        left = self.operand()
        while self.kind == "operator" and _BINDING.get(self.token, -1) > least:
            operator = self.take()
            left = _binary(operator, left, self.expression(_BINDING[operator]))
        return left

    def operand(self) -> Expression:
        if self.found("-"):
            inner = self.expression(20)  # binds more than * and /
            return lambda scope: -inner(scope)
        if self.found("("):
            first = self.expression()
            if self.found(","):
                rest = self.sequence(")")
                return lambda scope: tuple(item(scope) for item in (first, *rest))
            self.take(token=")")
            return first
        if self.found("["):
            items = self.sequence("]")
            return lambda scope: np.array([item(scope) for item in items], dtype=np.float64)
        if self.kind == "number":
            text = self.take()
            number = int(text) if re.fullmatch(r"\d+", text) else float(text)
            return lambda scope: number
        name = self.take("name")
        while self.found("."):
            name += "." + self.take("name")
        if self.found("("):
            arguments = self.sequence(")")
            return lambda scope: _call(name, [argument(scope) for argument in arguments], scope)
        if self.found("["):
            places = self.sequence("]")
            return lambda scope: _element(scope, name, [place(scope) for place in places])
        return lambda scope: np.nan if name == "NaN" else scope[name]

    # The self-test

    def run_self_test(self, module: JuliaModule) -> dict[str, list[bool]]:
        """Run ``test/runtests.jl``; return what each test of each set found."""
        verdicts: dict[str, list[bool]] = {}
        self.skip_lines()
        while self.kind != "end":
            if self.found("using"):
                assert self.take("name") in ("Test", module.name)
            elif self.found("@"):
                self.take("name", "testset")
                name = self.take("string").strip('"')
                self.take("name", "begin")
                self.end_of_line()
                verdicts[name] = []
                while not self.found("end"):
                    self.take("name", "let")
                    self.end_of_line()
                    self.block(module, verdicts[name])
                    self.end_of_line()
            else:
                raise JuliaError(f"not understood: {self.token!r}")
            self.end_of_line()
        return verdicts

    def block(self, module: JuliaModule, verdicts: list[bool]) -> None:
        scope: dict[str, Value] = {f"{module.name}.{name}": module for name in module.functions}
        while not self.found("end"):
            if self.found("@"):
                self.take("name", "test")
                verdicts.append(self.expression()(scope))
            elif self.tokens[self.position + 1][1] == "=":
                name = self.take("name")
                self.take(token="=")
                scope[name] = self.expression()(scope)
            else:
                self.expression()(scope)
            self.end_of_line()


def _binary(operator: str, left: Expression, right: Expression) -> Expression:
    functions = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}

    def run(scope: dict[str, Value]) -> Value:
        a, b = left(scope), right(scope)
        assert isinstance(a, float), "an integer would make integer arithmetic"
        assert isinstance(b, float), "an integer would make integer arithmetic"
        return functions[operator](a, b)

    return run


def _element(scope: dict[str, Value], name: str, places: list[Value]) -> Value:
    if name == "Float64":
        assert not places
        return np.zeros(0)
    (place,) = places
    assert type(place) is int
    assert 1 <= place <= len(scope[name])
    return scope[name][place - 1]


def _call(name: str, arguments: list[Value], scope: dict[str, Value]) -> Value:
    if name in scope:  # a function of the module that is tested
        scope[name].call(name.partition(".")[2], *arguments)
        return None
    functions: dict[str, Callable[..., Value]] = {
        "sin": np.sin,
        "cos": np.cos,
        "sign": np.sign,
        "sqrt": np.sqrt,
        "exp": np.exp,
        "log": np.log,
        "sincos": lambda x: (np.sin(x), np.cos(x)),
        "length": len,
        "size": np.shape,
        "fill": lambda value, *shape: np.full(shape, value),
        "Ref": lambda value: np.array(value),
        "elements": np.ravel,
        "agrees": lambda x, y, tolerance: len(x) == len(y) and bool(np.all(np.abs(x - y) <= tolerance)),
    }
    return functions[name](*arguments)
