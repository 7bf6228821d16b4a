"""SymPy: a function as its expressions, with substitution, closed forms and LaTeX, and exact numbers and symbols."""

from __future__ import annotations

import ast
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from string import ascii_letters
from types import MappingProxyType
from typing import Any

from steelyard.errors import InputError, require_package
from steelyard.files import suggestion
from steelyard.graph import Argument, Function, Node
from steelyard.graph.expression import reachable

__all__ = [
    "SymbolicFunction",
    "exact_number",
    "import_sympy",
    "intermediate_prefix",
    "latex_name",
    "substitution",
    "sympy_function",
]


_MOST_OPERATIONS = 200_000  # of a closed form
_DEEPEST = 120  # levels of a closed form: SymPy walks expressions by recursion
_MOST_SHOWN = 300  # operations that a notebook shows
_MOST_LINES = 12  # of what is longer
_DOTS = r"\cdots"


@dataclass(frozen=True, eq=False)
class SymbolicFunction:
    """A function as SymPy expressions.

    Attributes
    ----------
    name : str
    arguments : mapping
        For each argument the SymPy symbols of its elements, all real: ``q1``, ``dq1``, ``ddq1``, ``tau1`` for the
        motion, ``Lxx1`` to ``m1`` and the names of the terms for parameters, ``beta1`` for base parameters, ``gx gy
        gz`` for gravity, ``px py pz`` for a point, the names in the description for lengths. Symbols that
        were substituted are gone; those that a substitution brought are in ``"substituted"``.
    assignments : tuple of (symbol, expression)
        Intermediate variables, each in terms of arguments and of those before it; none in closed form.
    outputs : mapping
        For each output an expression, an ImmutableMatrix (vectors are columns) or an ImmutableDenseNDimArray.

    Examples
    --------
    >>> import steelyard as sy
    >>> pendulum = sy.Robot.from_dh([(0, "a", 0, "q")], gravity=(0, -10, 0), name="pendulum")
    >>> gravity = sy.Model(pendulum).symbolic("gravity")
    >>> gravity.substitute({"lx1": 0, "ly1": 0}).outputs["torque"][0]
    10*a*m1*cos(q1)
    """

    name: str
    arguments: Mapping[str, tuple[Any, ...]]
    assignments: tuple[tuple[Any, Any], ...]
    outputs: Mapping[str, Any]

    def __post_init__(self) -> None:
        object.__setattr__(self, "arguments", MappingProxyType(dict(self.arguments)))
        object.__setattr__(self, "outputs", MappingProxyType(dict(self.outputs)))

    def __repr__(self) -> str:
        inputs = ", ".join(f"{name}[{len(row)}]" for name, row in self.arguments.items())
        count = len(self.assignments)
        form = f"{count} intermediate variables" if count else "closed form"
        return f"SymbolicFunction({self.name}: {inputs} -> {', '.join(self.outputs)}; {form})"

    def _repr_latex_(self) -> str:
        operations = sum(_measure(value, {})[0] for _, value in self._lines())
        text = self.latex() if operations <= _MOST_SHOWN else self._beginning(operations)
        return f"$\\displaystyle {text}$"

    @property
    def symbols(self) -> Mapping[str, Any]:
        """The symbols of all the arguments by name."""
        return {symbol.name: symbol for row in self.arguments.values() for symbol in row}

    def substitute(self, values: Mapping[Any, Any]) -> SymbolicFunction:
        """Put numbers or expressions in the place of symbols.

        Parameters
        ----------
        values : mapping
            From names to numbers, SymPy expressions, or texts such as ``"m2*c"``, all at once: expressions are in terms
            of what the symbols were before. Names that are no symbols here become new real symbols.

        Returns
        -------
        SymbolicFunction
            Without the intermediate variables that became numbers or single symbols, or that nothing needs.

        Raises
        ------
        InputError
            If there is no such symbol, a value is no number or expression, or something is divided by zero.
        """
        sympy = import_sympy()
        replaced, arguments = substitution(values, self.arguments)
        taken = {symbol.name for row in arguments.values() for symbol in row}
        prefix = intermediate_prefix(taken)
        assignments: list[tuple[Any, Any]] = []
        for symbol, old in self.assignments:
            value = self._defined(old.xreplace(replaced))
            if value.is_Atom or (-value).is_Atom:
                replaced[symbol] = value
                continue
            replaced[symbol] = sympy.Symbol(prefix + symbol.name.lstrip(ascii_letters), real=True)
            assignments.append((replaced[symbol], value))
        outputs = {name: self._defined(_replaced(value, replaced)) for name, value in self.outputs.items()}
        return SymbolicFunction(self.name, arguments, tuple(assignments), outputs).pruned()

    def closed(self) -> SymbolicFunction:
        """Return the same function without intermediate variables.

        Raises
        ------
        InputError
            If expressions would have more than 200000 operations or be nested more than 120 deep.
        """
        kept = self.pruned()
        known: dict[Any, tuple[int, int]] = {}
        for symbol, value in kept.assignments:
            known[symbol] = _measure(value, known)
        measures = [_measure(value, known) for value in kept.outputs.values()]
        operations, depth = sum(m[0] for m in measures), max(m[1] for m in measures)
        if operations > _MOST_OPERATIONS or depth > _DEEPEST:
            size = f"{operations:.3g} operations" if operations > _MOST_OPERATIONS else f"{depth} levels of nesting"
            raise InputError(
                f"{self.name} in closed form would have {size}; use closed=False, which keeps intermediate variables, "
                "or substitute numbers for parameters."
            )
        replaced: dict[Any, Any] = {}
        for symbol, value in kept.assignments:
            replaced[symbol] = value.xreplace(replaced)
        outputs = {name: _replaced(value, replaced) for name, value in kept.outputs.items()}
        return SymbolicFunction(self.name, self.arguments, (), outputs)

    def pruned(self) -> SymbolicFunction:
        """Return the same function without the intermediate variables that no output needs."""
        needed = {symbol for value in self.outputs.values() for symbol in value.free_symbols}
        kept = []
        for symbol, value in reversed(self.assignments):
            if symbol in needed:
                kept.append((symbol, value))
                needed |= value.free_symbols
        return SymbolicFunction(self.name, self.arguments, tuple(reversed(kept)), self.outputs)

    def latex(self) -> str:
        r"""Return the equations for LaTeX, intermediate variables first, in an ``aligned`` block.

        Returns
        -------
        str
            The text to put between ``\[`` and ``\]``; it needs the package amsmath.
        """
        sympy = import_sympy()
        names = self._latex_names()
        lines = [f"{names[symbol]} &= {sympy.latex(value, symbol_names=names)}" for symbol, value in self.assignments]
        for name, value in self.outputs.items():
            lines.append(f"{_output_name(name)} &= {sympy.latex(value, symbol_names=names)}")
        return _aligned(lines)

    def _latex_names(self) -> dict[Any, str]:
        symbols = {symbol for _, value in self._lines() for symbol in value.free_symbols}
        symbols |= {symbol for symbol, _ in self.assignments}
        return {symbol: latex_name(symbol.name) for symbol in symbols}

    def _lines(self) -> Iterator[tuple[str, Any]]:
        """Yield all that the function computes, element by element, with its name in LaTeX."""
        for symbol, value in self.assignments:
            yield latex_name(symbol.name), value
        for name, value in self.outputs.items():
            shape = getattr(value, "shape", ())
            if shape[1:] == (1,):
                shape = shape[:1]
            for place, element in zip(product(*map(range, shape)), _elements(value), strict=True):
                index = ",".join(str(k + 1) for k in place)
                yield _output_name(name) + (f"_{{{index}}}" if index else ""), element

    def _beginning(self, operations: int) -> str:
        """Return how much there is, and as much of it as fits a page."""
        sympy = import_sympy()
        count = len(self.assignments)
        size = f"{operations} operations" + (f", {count} intermediate variables" if count else "")
        lines = [f"&\\text{{{self.name.replace('_', ' ')}: {size}}}"]
        names, room = self._latex_names(), _MOST_SHOWN // 3
        for name, value in self._lines():
            terms, whole = [], True
            for term in value.args if value.is_Add else (value,):
                term_size = 1 + _measure(term, {})[0]
                whole = term_size <= room
                if not whole:
                    break
                terms.append(term)
                room -= term_size
            shown = [sympy.latex(sympy.Add(*terms), symbol_names=names)] if terms else []
            lines.append(f"{name} &= {' + '.join(shown if whole else [*shown, _DOTS])}")
            if len(lines) > _MOST_LINES:
                break
        return _aligned([*lines, r"&\;\;\vdots"])

    def _defined(self, value: Any) -> Any:
        sympy = import_sympy()
        if value.has(sympy.zoo, sympy.nan, sympy.oo):
            raise InputError(f"{self.name} divides by 0 with these numbers; substitute others.")
        return value


def _elements(value: Any) -> list[Any]:
    """Return the elements of an output in row-major order."""
    shape = getattr(value, "shape", ())
    if not shape:
        return [value]
    return list(value if len(shape) == 2 else value.reshape(len(value)))


def _replaced(value: Any, replaced: Mapping[Any, Any]) -> Any:
    if hasattr(value, "applyfunc"):
        return value.applyfunc(lambda element: element.xreplace(replaced))
    return value.xreplace(replaced)


def _measure(value: Any, known: Mapping[Any, tuple[int, int]]) -> tuple[int, int]:
    """Return operations and depth of an expression with intermediate variables written out."""
    operations, depth = 0, 0
    stack = [(element, 1) for element in _elements(value)]
    while stack:
        node, level = stack.pop()
        if node in known:
            more, deeper = known[node]
            operations += more
            depth = max(depth, level + deeper)
            continue
        depth = max(depth, level)
        if node.args:
            operations += max(1, len(node.args) - 1)
            stack.extend((argument, level + 1) for argument in node.args)
    return operations, depth


def _aligned(lines: list[str]) -> str:
    separator = " \\\\\n"
    return f"\\begin{{aligned}}\n{separator.join(lines)}\n\\end{{aligned}}"


def _output_name(name: str) -> str:
    escaped = name.replace("_", r"\_")
    return f"\\mathrm{{{escaped}}}"


# Graph functions as SymPy expressions.

_LARGEST_INLINE = 24  # operations of an expression beyond which it gets a name, so that nothing is nested deeply
_NAMED = re.compile(r"([A-Za-z][A-Za-z0-9_]*)(?:: | = )")
_LENGTH = re.compile(r"length ([A-Za-z][A-Za-z0-9_]*), m$")
_AXES = {"gravity": ("gx", "gy", "gz"), "point": ("px", "py", "pz")}


def sympy_function(
    function: Function, *, closed: bool = True, substitute: Mapping[Any, Any] | None = None
) -> SymbolicFunction:
    """Return a graph function as SymPy expressions.

    Constants that are whole numbers become integers, those that are dyadic fractions with a denominator of at most
    1024 (0.5, 0.125) become rationals, and all others floats of the same 53 bits, so that 9.81 stays what the
    computer knows of it.

    Parameters
    ----------
    function : Function
    closed : bool
        Single expressions; False keeps intermediate variables, which is fast for any robot.
    substitute : mapping, optional
        Numbers, SymPy expressions or texts such as ``"m2*c"`` for symbols by name; zeros vanish before
        expressions grow.

    Raises
    ------
    InputError
        If a name to substitute does not exist, or a closed expression would be too long to be of use.
    MissingExtraError
        If SymPy is not installed.

    Examples
    --------
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> q = Graph().inputs("q", 2)
    >>> f = Function("f", (Argument("q", 2),), (Output("height", (), (0.5 * sin(q[0]) * q[1],)),))
    >>> sympy_function(f).outputs["height"]
    q2*sin(q1)/2
    >>> sympy_function(f, substitute={"q2": 4}).outputs["height"]
    2*sin(q1)
    """
    sympy = import_sympy()
    arguments = {
        a.name: tuple(sympy.Symbol(n, real=True) for n in names)
        for a, names in zip(function.arguments, _names(function.arguments), strict=True)
    }
    values, remaining = substitution(substitute or {}, arguments)
    inputs = {
        f"{name}[{k}]": values.get(symbol, symbol) for name, row in arguments.items() for k, symbol in enumerate(row)
    }
    taken = {symbol.name for value in inputs.values() for symbol in value.free_symbols}
    assignments, elements = _expressions(function, inputs, intermediate_prefix(taken), sympy)
    outputs: dict[str, Any] = {}
    for output in function.outputs:
        row = [elements[node.index] for node in output.nodes]
        if len(output.shape) == 0:
            outputs[output.name] = row[0]
        elif len(output.shape) <= 2:
            rows, columns = (*output.shape, 1)[:2]
            outputs[output.name] = sympy.ImmutableMatrix(rows, columns, row)
        else:
            outputs[output.name] = sympy.ImmutableDenseNDimArray(row, output.shape)
    result = SymbolicFunction(function.name, remaining, tuple(assignments), outputs)
    return result.closed() if closed else result.pruned()


def _names(arguments: Sequence[Argument]) -> list[tuple[str, ...]]:
    """Return the names of the elements of all the arguments, no two of them equal."""
    taken: set[str] = set()
    result = []
    for argument in arguments:
        names, stem = _own_names(argument), argument.name
        while taken & set(names) or len(set(names)) < len(names):
            names = tuple(f"{stem}{k + 1}" for k in range(argument.width))
            stem += "_"
        taken |= set(names)
        result.append(names)
    return result


def _own_names(argument: Argument) -> tuple[str, ...]:
    if argument.name in _AXES and argument.width == 3:
        return _AXES[argument.name]
    pattern = _LENGTH if argument.name == "lengths" else _NAMED
    if argument.name in ("parameters", "base_parameters", "lengths"):
        found = [match[1] for text in argument.elements if (match := pattern.match(text))]
        if len(found) == argument.width:
            return tuple(found)
    return tuple(f"{argument.name}{k + 1}" for k in range(argument.width))


def _expressions(
    function: Function, inputs: Mapping[str, Any], prefix: str, sympy: Any
) -> tuple[list[tuple[Any, Any]], dict[int, Any]]:
    """Walk the graph once; what is used more than once, or grows long, gets a name."""
    nodes = reachable(function.nodes)
    uses = Counter(argument.index for node in nodes for argument in node.arguments)
    results: dict[int, Any] = {}
    sizes: dict[int, int] = {}
    assignments: list[tuple[Any, Any]] = []
    for node in nodes:
        value = _value(node, results, inputs, function.name, sympy)
        size = 1 + sum(sizes[a.index] for a in node.arguments)
        if value.is_Atom or (-value).is_Atom:
            size = 0
        elif uses[node.index] and (uses[node.index] > 1 or size > _LARGEST_INLINE):
            symbol = sympy.Symbol(f"{prefix}{len(assignments) + 1}", real=True)
            assignments.append((symbol, value))
            value, size = symbol, 0
        results[node.index], sizes[node.index] = value, size
    return assignments, results


def _value(node: Node, results: Mapping[int, Any], inputs: Mapping[str, Any], name: str, sympy: Any) -> Any:
    if node.operation == "constant":
        return exact_number(float(node.value))
    if node.operation == "input":
        if node.value not in inputs:
            raise InputError(f"function {name!r} reads {node.value}, which is no argument of it; add one.")
        return inputs[str(node.value)]
    first, *rest = (results[a.index] for a in node.arguments)
    match node.operation:
        case "add":
            return first + rest[0]
        case "sub":
            return first - rest[0]
        case "mul":
            return first * rest[0]
        case "div":
            if rest[0].is_zero:
                raise InputError(f"function {name!r} divides by 0 with these numbers; substitute others.")
            return first / rest[0]
        case "neg":
            return -first
    return getattr(sympy, node.operation)(first)


# Dyadic fractions with larger denominators are measured numbers, whose exact form would only lengthen expressions.
_LARGEST_DENOMINATOR = 1024
_LARGEST_INTEGER = 2.0**53  # a larger float is not known to be a whole number
_FUNCTIONS = ("sin", "cos", "tan", "sqrt")
_ALLOWED = (
    ast.Expression,
    ast.BinOp,
    ast.UnaryOp,
    ast.Add,
    ast.Sub,
    ast.Mult,
    ast.Div,
    ast.Pow,
    ast.USub,
    ast.UAdd,
    ast.Name,
    ast.Load,
    ast.Constant,
    ast.Call,
)
_GREEK = (
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu"),
    *("nu", "xi", "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega"),
)
_DERIVATIVES = {"d": r"\dot", "dd": r"\ddot"}


def import_sympy() -> Any:
    """Return the module sympy.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    return require_package("sympy", "Symbolic expressions need the package", "sympy")


def exact_number(value: float) -> Any:
    """Return a float as a SymPy number of the same value.

    Parameters
    ----------
    value : float
        Finite.

    Returns
    -------
    sympy.Number
        An integer or a dyadic rational where it is one with a denominator of at most 1024, otherwise a float of 53
        bits.

    Examples
    --------
    >>> exact_number(0.375), exact_number(-2.0), exact_number(9.81)
    (3/8, -2, 9.81000000000000)
    """
    sympy = import_sympy()
    if abs(value) < _LARGEST_INTEGER:
        fraction = Fraction(value)
        if fraction.denominator <= _LARGEST_DENOMINATOR:
            return sympy.Rational(fraction.numerator, fraction.denominator)
    return sympy.Float(value)


def substitution(
    given: Mapping[Any, Any], arguments: Mapping[str, tuple[Any, ...]]
) -> tuple[dict[Any, Any], dict[str, tuple[Any, ...]]]:
    """Read the substitutions of a user.

    Parameters
    ----------
    given : mapping
        From names (or symbols) to numbers, texts or SymPy expressions.
    arguments : mapping
        The symbols that can be substituted, by argument.

    Returns
    -------
    values : dict
        From symbols to expressions.
    arguments : dict
        The symbols that remain; those that the expressions bring are the argument ``"substituted"``.

    Raises
    ------
    InputError
        For an unknown name or a value that is no expression.
    """
    known = {symbol.name: symbol for row in arguments.values() for symbol in row}
    values: dict[Any, Any] = {}
    for key, value in given.items():
        name = str(key)
        if name not in known:
            raise InputError(f"There is no symbol {name!r} to substitute; {suggestion(name, known)}")
        values[known[name]] = _expression(name, value, known)
    own = set(known.values())
    brought = {symbol for value in values.values() for symbol in value.free_symbols}
    remaining = {
        name: tuple(symbol for symbol in row if symbol not in values or symbol in brought)
        for name, row in arguments.items()
    }
    added = sorted(brought - own, key=str)
    if added:
        remaining["substituted"] = (*remaining.get("substituted", ()), *added)
    return values, remaining


def _expression(name: str, value: Any, known: Mapping[str, Any]) -> Any:
    sympy = import_sympy()
    if isinstance(value, str):
        return _parsed(name, value, known)
    if isinstance(value, sympy.Expr):
        ours = {symbol: known[symbol.name] for symbol in value.free_symbols if symbol.name in known}
        return value.xreplace(ours)
    if isinstance(value, Fraction):
        return sympy.Rational(value.numerator, value.denominator)
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool) or not math.isfinite(number):
        raise InputError(f"{name} must be a finite number or an expression such as 'm2*c', got {value!r}.")
    return exact_number(number)


def _parsed(name: str, text: str, known: Mapping[str, Any]) -> Any:
    """Read an expression; only arithmetic is accepted, because SymPy's own parser runs any Python."""
    sympy = import_sympy()
    message = f"{name} cannot be {text!r}; an expression of numbers, names, + - * / ** and {', '.join(_FUNCTIONS)}"
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(f"{message} was expected.") from None
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    names: dict[str, Any] = {"pi": sympy.pi} | {function: getattr(sympy, function) for function in _FUNCTIONS}
    for node in ast.walk(tree):
        allowed = isinstance(node, _ALLOWED)
        if isinstance(node, ast.Name):
            if id(node) in called:
                allowed = node.id in _FUNCTIONS
            elif node.id in known:
                names[node.id] = known[node.id]
            elif node.id in _FUNCTIONS:
                allowed = False
            elif node.id not in names:
                names[node.id] = sympy.Symbol(node.id, real=True)
        if isinstance(node, ast.Constant):
            allowed = type(node.value) in (int, float)
        if not allowed:
            raise InputError(f"{message} was expected.")
    return _evaluated(tree.body, names, message)


def _evaluated(node: Any, names: Mapping[str, Any], message: str) -> Any:
    try:
        match node:
            case ast.Constant(value=value):
                return exact_number(value) if isinstance(value, float) else import_sympy().Integer(value)
            case ast.Name(id=name):
                return names[name]
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
                return names[name](_evaluated(argument, names, message))
            case ast.UnaryOp(op=operator, operand=operand):
                inner = _evaluated(operand, names, message)
                return -inner if isinstance(operator, ast.USub) else inner
            case ast.BinOp(left=left, op=operator, right=right):
                a, b = _evaluated(left, names, message), _evaluated(right, names, message)
                match operator:
                    case ast.Add():
                        return a + b
                    case ast.Sub():
                        return a - b
                    case ast.Mult():
                        return a * b
                    case ast.Div() if not b.is_zero:
                        return a / b
                    case ast.Pow() if b.is_Integer and abs(b) <= 100:
                        return a**b
    except RecursionError:
        pass
    raise InputError(f"{message} was expected.")


def intermediate_prefix(taken: set[str]) -> str:
    """Return what the names of intermediate variables begin with: x, or another letter where other symbols do so."""
    letters = iter("xyzuvw")
    prefix = next(letters)
    while any(re.fullmatch(prefix + r"_?\d+", name) for name in taken):
        prefix = next(letters, prefix + "x")
    return prefix


def latex_name(name: str) -> str:
    r"""Return a symbol's name for LaTeX: a letter with its index.

    Examples
    --------
    >>> print(*map(latex_name, ("dq1", "Lxx12", "Fvj1", "m1", "beta1", "gx", "forearm")))
    \dot{q}_1 L_{xx,12} F_{vj,1} m_1 \beta_1 g_x \mathrm{forearm}
    """
    motion = re.fullmatch(r"(d{1,2})q(\d*)", name)
    if motion:
        return f"{_DERIVATIVES[motion[1]]}{{q}}{_subscript(motion[2])}"
    stem, number = re.fullmatch(r"(.*?)_?(\d*)", name).groups()  # type: ignore[union-attr]
    if stem in _GREEK:
        return f"\\{stem}{_subscript(number)}"
    if re.fullmatch(r"[A-Z][a-z]{1,3}|l[xyz]|[gp][xyz]", stem):
        index = f"{stem[1:]},{number}" if number else stem[1:]
        return f"{stem[0]}{_subscript(index)}"
    if len(stem) == 1 and stem.isalpha():
        return f"{stem}{_subscript(number)}"
    stem = stem.replace("_", r"\_")
    return f"\\mathrm{{{stem}}}{_subscript(number)}"


def _subscript(text: str) -> str:
    if not text:
        return ""
    return f"_{text}" if len(text) == 1 else f"_{{{text}}}"
