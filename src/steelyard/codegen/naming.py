"""Names that a language gives to the functions of a project, to their arguments and outputs, and to their sizes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from steelyard.graph import Argument, Function

from .text import Names, identifier, number

if TYPE_CHECKING:
    from .project import Project

__all__ = [
    "C_RESERVED",
    "DEVICE_NAMES",
    "PROJECT_RESERVED",
    "NamedFunction",
    "Naming",
    "Size",
    "Sizes",
    "naming",
    "project_name",
    "shadowing",
    "shared_arguments",
]

# Names that no file can have on Windows, whatever its ending.
_PORTS = [f"{port}{digit}" for port in ("com", "lpt") for digit in range(10)]
DEVICE_NAMES = frozenset(["con", "prn", "aux", "nul", *_PORTS])

_C_KEYWORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while asm typeof
nullptr constexpr static_assert thread_local alignas alignof bool true false typeof_unqual fortran
"""

_CPP_KEYWORDS = """
and and_eq bitand bitor catch char8_t char16_t char32_t class compl concept consteval constinit const_cast co_await
co_return co_yield decltype delete dynamic_cast explicit export friend mutable namespace new noexcept not not_eq
operator or or_eq private protected public reinterpret_cast requires static_cast template this throw try typeid
typename using virtual wchar_t xor xor_eq final override import module std
"""

# What headers and compilers define as macros, and the functions that the generated source calls.
_MACROS = """
linux unix i386 near far interface small huge pascal cdecl min max NULL EOF NAN INFINITY HUGE_VAL HUGE_VALF HUGE_VALL
EDOM ERANGE EILSEQ errno stdin stdout stderr assert main sin cos sqrt exp log fabs printf isnan isinf signbit isfinite
fpclassify isnormal signgam complex imaginary I TRUE FALSE BUFSIZ
"""

C_RESERVED = frozenset(f"{_C_KEYWORDS} {_CPP_KEYWORDS} {_MACROS}".split())

# A project gives its name to files, build targets and macros: a header must not hide one of the standard library
# (math.h), a target must not be one of the build system's, and a macro must not be one of a standard header (DBL_MAX).
_HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg stdatomic
stdbit stdbool stdckdint stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype unistd
"""
_TARGETS = """
all clean help install test m c edit_cache rebuild_cache package package_source depend list_install_components
"""
_MACRO_PREFIXES = """
int8 int16 int32 int64 intmax intptr uint uintmax uintptr ptrdiff size wint fp dbl flt ldbl rand sig seek huge
"""

PROJECT_RESERVED = C_RESERVED | DEVICE_NAMES | frozenset(f"{_HEADERS} {_TARGETS} {_MACRO_PREFIXES}".split())


@dataclass(frozen=True)
class NamedFunction:
    """A function and its names in a language.

    Attributes
    ----------
    names : dict
        From the names of arguments and outputs to those in the language.
    scope : Names
        The names that are visible inside the function.
    """

    function: Function
    name: str
    names: dict[str, str]
    scope: Names

    @property
    def argument_names(self) -> list[str]:
        """The arguments in the language, in order."""
        return [self.names[argument.name] for argument in self.function.arguments]

    @property
    def output_names(self) -> list[str]:
        """The outputs in the language, in order."""
        return [self.names[output.name] for output in self.function.outputs]


def project_name(project: Project, reserved: frozenset[str]) -> str:
    """Return the name of a project in lower case, as the prefix, namespace or package that holds all the others.

    Names that are reserved get ``_robot`` behind them.
    """
    name = identifier(project.name).lower()
    return f"{name}_robot" if name in reserved else name


@dataclass(frozen=True)
class Size:
    """A named number in the generated source."""

    name: str
    value: int | float
    description: str

    @property
    def literal(self) -> str:
        """The number as all languages write it."""
        return number(self.value) if isinstance(self.value, float) else str(self.value)


@dataclass(frozen=True)
class Sizes:
    """The named numbers of a project.

    Attributes
    ----------
    declared : tuple of Size
        The project's constants, then the sizes of arguments and outputs, with rows and columns of matrices.
    of : dict
        The name of the size, by the name of the function and of its argument or output.
    """

    declared: tuple[Size, ...]
    of: dict[tuple[str, str], str]


@dataclass(frozen=True)
class Naming:
    """All the names of a project in a language."""

    functions: tuple[NamedFunction, ...]
    sizes: Sizes


def naming(project: Project, scope: Names, *, prefix: str = "", style: Callable[[str], str] = str.lower) -> Naming:
    """Name functions, then constants and sizes, then the arguments and outputs inside each function.

    Parameters
    ----------
    project : Project
    scope : Names
        Holds what the language reserves; takes the names of functions and sizes.
    prefix : str
        Stands before the name of each function and, in `style`, of each size.
    style : callable
        From words joined by underscores to a constant's name, such as ``str.upper``.

    Examples
    --------
    >>> import numpy as np
    >>> from steelyard.codegen import Project
    >>> from steelyard.graph import Argument, Function, Graph, Output
    >>> x = Graph().inputs("int", 2)
    >>> f = Function("f", (Argument("int", 2),), (Output("y", (), (x[0],)),))
    >>> found = naming(Project("r", (f,), "", (), {}, ""), Names({"int"}), prefix="r_", style=str.upper)
    >>> found.functions[0].name, found.functions[0].names
    ('r_f', {'int': 'int_', 'y': 'y'})
    >>> [(size.name, size.value) for size in found.sizes.declared]
    [('R_INT_SIZE', 2), ('R_F_Y_SIZE', 1)]
    """
    names = [scope.take(prefix + function.name) for function in project.functions]
    found = _sizes(project, scope, lambda words: style(prefix + words))
    functions = []
    for function, name in zip(project.functions, names, strict=True):
        inner = scope.inner()
        wanted = [argument.name for argument in function.arguments] + [output.name for output in function.outputs]
        taken = {item: inner.take(item) for item in wanted}
        functions.append(NamedFunction(function, name, taken, inner))
    return Naming(tuple(functions), found)


def _sizes(project: Project, scope: Names, style: Callable[[str], str]) -> Sizes:
    """Name constants and sizes; an argument that means the same in all the functions has one size for all."""
    declared = [Size(scope.take(style(c.name)), c.value, c.description) for c in project.constants]
    of: dict[tuple[str, str], str] = {}
    shared = {argument.name: "" for argument in shared_arguments(project)}

    def declare(words: str, value: int) -> str:
        name = scope.take(style(words))
        declared.append(Size(name, value, "" if of else "Numbers of elements, rows and columns."))
        return name

    for function in project.functions:
        for argument in function.arguments:
            if argument.name not in shared:
                words = f"{function.name}_{argument.name}_size"
                of[function.name, argument.name] = declare(words, argument.width)
                continue
            if not shared[argument.name]:
                shared[argument.name] = declare(f"{argument.name}_size", argument.width)
            of[function.name, argument.name] = shared[argument.name]
        for output in function.outputs:
            words = output.name if output.name == function.name else f"{function.name}_{output.name}"
            of[function.name, output.name] = declare(f"{words}_size", output.size)
            if len(output.shape) == 2:
                declare(f"{words}_rows", output.shape[0])
                declare(f"{words}_columns", output.shape[1])
    return Sizes(tuple(declared), of)


def shared_arguments(project: Project) -> tuple[Argument, ...]:
    """Return the arguments that mean the same in all the functions that have them: documented once for all.

    Returns
    -------
    tuple of Argument
        In order of appearance.
    """
    found: dict[str, Argument] = {}
    different: set[str] = set()
    for function in project.functions:
        for argument in function.arguments:
            if _meaning(found.setdefault(argument.name, argument)) != _meaning(argument):
                different.add(argument.name)
    return tuple(argument for name, argument in found.items() if name not in different)


def _meaning(argument: Argument) -> tuple[object, ...]:
    return (argument.width, argument.description, argument.elements)


# Names inside functions for languages where an argument may hide a function of the same name.


def shadowing(found: Naming, reserved: Iterable[str]) -> tuple[NamedFunction, ...]:
    """Name arguments and outputs anew: they may have names of functions, but not of sizes or reserved words.

    So ``gravity`` is the argument of ``inverse_dynamics`` also where there is a function ``gravity``. What the bodies
    of the functions use is `reserved`.

    Examples
    --------
    >>> from steelyard.codegen import Project
    >>> from steelyard.codegen.naming import naming
    >>> from steelyard.graph import Argument, Function, Graph, Output
    >>> g = Graph().inputs("gravity", 3)
    >>> gravity = Function("gravity", (Argument("gravity", 3),), (Output("class", (), (g[0],)),))
    >>> found = naming(Project("r", (gravity,), "", (), {}, ""), Names({"class"}), style=str.upper)
    >>> found.functions[0].names, shadowing(found, {"class"})[0].names
    ({'gravity': 'gravity_2', 'class': 'class_'}, {'gravity': 'gravity', 'class': 'class_'})
    """
    words = {*reserved, *(size.name for size in found.sizes.declared)}
    functions = []
    for named in found.functions:
        scope = Names(words)
        function = named.function
        wanted = [a.name for a in function.arguments] + [o.name for o in function.outputs]
        names = {item: scope.take(item) for item in wanted}
        functions.append(NamedFunction(function, named.name, names, scope))
    return tuple(functions)
