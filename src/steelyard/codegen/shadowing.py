"""Names inside functions for languages where an argument may hide a function of the same name."""

from __future__ import annotations

from collections.abc import Iterable

from .naming import NamedFunction, Naming
from .text import Names

__all__ = ["shadowing"]


def shadowing(found: Naming, reserved: Iterable[str]) -> tuple[NamedFunction, ...]:
    """Name arguments and outputs anew: they may be called like functions, but not like sizes and reserved words.

    So ``gravity`` is the argument of ``inverse_dynamics`` also where there is a function ``gravity``.

    Parameters
    ----------
    found : Naming
    reserved : iterable of str
        What the bodies of the functions use.

    Returns
    -------
    tuple of NamedFunction

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
