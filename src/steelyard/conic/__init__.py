"""Conic problems and the solvers that they are handed to."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

from . import provided  # noqa: F401  (the solvers are known from the start)

if TYPE_CHECKING:
    from .problem import Cone as Cone
    from .problem import ConicProblem as ConicProblem
    from .problem import ConicSolution as ConicSolution
    from .problem import Outcome as Outcome
    from .provided import PROVIDED as PROVIDED
    from .semidefinite_program import SemidefiniteProgram as SemidefiniteProgram
    from .solver import Solver as Solver
    from .solver import find_solver as find_solver
    from .solver import register_solver as register_solver
    from .solver import registered_solvers as registered_solvers
    from .solver import solve as solve
    from .solver import unregister_solver as unregister_solver
    from .table import SolverTable as SolverTable
    from .table import solver_table as solver_table

__all__ = import_at_first_use(__name__, __file__)
