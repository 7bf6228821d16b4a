"""Linear matrix inequalities as objects: expressions, affine symmetric matrices and stacks of them."""

from typing import TYPE_CHECKING

from steelyard.first_use import import_at_first_use

if TYPE_CHECKING:
    from .affine import AffineBlock as AffineBlock
    from .affine import AffineStack as AffineStack
    from .affine import is_positive_definite as is_positive_definite
    from .affine import symmetric_to_vector as symmetric_to_vector
    from .affine import vector_to_symmetric as vector_to_symmetric
    from .base_dependent import base_variable_names as base_variable_names
    from .base_dependent import to_base_dependent as to_base_dependent
    from .base_dependent import to_standard as to_standard
    from .inequality import LinearMatrixInequality as LinearMatrixInequality
    from .inequality import block_diagonal as block_diagonal
    from .inequality import inequality_of_program as inequality_of_program
    from .linear_expression import LinearExpression as LinearExpression
    from .linear_expression import as_expression as as_expression
    from .linear_expression import parse_expression as parse_expression
    from .linear_expression import variables as variables
    from .residual_inequality import distance_inequality as distance_inequality
    from .residual_inequality import residual_inequality as residual_inequality

__all__ = import_at_first_use(__name__, __file__)
