"""Conic problems and the solvers that they are handed to."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

from .clarabel_solver import CLARABEL
from .file_solver import EXTERNAL_SOLVERS
from .scs_solver import SCS
from .solver import register_solver as register_solver

if TYPE_CHECKING:
    from .problem import Cone as Cone
    from .problem import ConicProblem as ConicProblem
    from .problem import ConicSolution as ConicSolution
    from .problem import Outcome as Outcome
    from .problem import Rows as Rows
    from .semidefinite_program import SemidefiniteProgram as SemidefiniteProgram
    from .solver import Solver as Solver
    from .solver import SolverTable as SolverTable
    from .solver import find_solver as find_solver
    from .solver import registered_solvers as registered_solvers
    from .solver import solve as solve
    from .solver import solver_table as solver_table
    from .solver import unregister_solver as unregister_solver

for _solver in (CLARABEL, SCS, *EXTERNAL_SOLVERS):
    register_solver(_solver)

__all__ = import_at_first_use(__name__, __file__)
