"""Conic problems and the solvers that they are handed to."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .problem import Cone as Cone
    from .problem import ConicProblem as ConicProblem
    from .problem import ConicSolution as ConicSolution
    from .problem import Outcome as Outcome
    from .problem import Rows as Rows
    from .problem import stacked_triangle as stacked_triangle
    from .semidefinite_program import SemidefiniteProgram as SemidefiniteProgram
    from .solver import Solver as Solver
    from .solver import SolverTable as SolverTable
    from .solver import find_solver as find_solver
    from .solver import solve as solve
    from .solver import solver_table as solver_table

__all__ = import_at_first_use(__name__, __file__)
