"""One table of all solvers: what each can do, and whether it is here."""

import html
from dataclasses import dataclass

from .solver import FEATURES, Solver, registered_solvers

__all__ = ["SolverTable", "solver_table"]

_HEADINGS = ("solver", "method", "access", *FEATURES, "proof", "here", "otherwise install with")


@dataclass(frozen=True)
class SolverTable:
    """What the registered solvers can do.

    A feature is taken as it is (``yes``), rewritten as semidefinite blocks first (``rewritten``), or not at all
    (``no``). ``proof`` says whether an infeasible problem comes back with a direction that proves it.

    Attributes
    ----------
    solvers : tuple of Solver
    """

    solvers: tuple[Solver, ...]

    @property
    def headings(self) -> tuple[str, ...]:
        """Of the columns."""
        return _HEADINGS

    @property
    def rows(self) -> tuple[tuple[str, ...], ...]:
        """One tuple of texts for each solver."""
        return tuple(_row(solver) for solver in self.solvers)

    def __str__(self) -> str:
        lines = [self.headings, *self.rows]
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.headings))]
        texts = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines]
        texts.insert(1, "  ".join("-" * width for width in widths))
        return "\n".join(text.rstrip() for text in texts)

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        def line(cells: tuple[str, ...], tag: str) -> str:
            return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

        return f"<table>{line(self.headings, 'th')}{''.join(line(row, 'td') for row in self.rows)}</table>"


def _row(solver: Solver) -> tuple[str, ...]:
    installed = solver.installed()
    version = solver.version() if installed else ""
    here = f"yes, {version}" if version else ("yes" if installed else "no")
    features = (
        "yes" if feature in solver.native else "rewritten" if feature in solver.rewritten else "no"
        for feature in FEATURES
    )
    remedy = "" if installed else solver.remedy
    proof = "yes" if solver.certificates else "no"
    return (solver.name, solver.description, solver.access, *features, proof, here, remedy)


def solver_table() -> SolverTable:
    """What every solver can do, whether it is on this machine, and how to install it otherwise.

    Returns
    -------
    SolverTable
        Prints as one table, also in a notebook.

    Examples
    --------
    >>> table = solver_table()
    >>> [row[0] for row in table.rows][:5]
    ['clarabel', 'scs', 'csdp', 'dsdp', 'sdpa']
    >>> table.headings[3:9]
    ('quadratic', 'zero', 'nonnegative', 'second-order', 'semidefinite', 'exponential')
    """
    return SolverTable(registered_solvers())
