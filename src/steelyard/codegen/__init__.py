"""Code generation: functions of a graph become source code in many languages, or objects of SymPy, CasADi and JAX."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .assignments import Assignment as Assignment
    from .assignments import Listing as Listing
    from .assignments import OutputListing as OutputListing
    from .assignments import Syntax as Syntax
    from .assignments import listing as listing
    from .casadi import casadi_function as casadi_function
    from .jax import jax_function as jax_function
    from .project import Constant as Constant
    from .project import Project as Project
    from .project import files as files
    from .project import generate as generate
    from .project import languages as languages
    from .reference import Reference as Reference
    from .sympy import SymbolicFunction as SymbolicFunction
    from .sympy import sympy_function as sympy_function
    from .text import Names as Names

__all__ = import_at_first_use(__name__, __file__)
