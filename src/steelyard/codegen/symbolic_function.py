"""A function as SymPy expressions: substitution, closed forms and LaTeX."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from string import ascii_letters
from types import MappingProxyType
from typing import Any

from steelyard.errors import InputError

from .symbols import import_sympy, intermediate_prefix, latex_name, substitution

__all__ = ["SymbolicFunction"]

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
            To stand between ``\[`` and ``\]``; needs the package amsmath.
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
