"""Linear matrix inequalities as objects: affine symmetric matrices and stacks of them."""

from .affine import AffineBlock as AffineBlock
from .affine import AffineStack as AffineStack
from .affine import is_positive_definite as is_positive_definite
from .affine import symmetric_to_vector as symmetric_to_vector
from .affine import vector_to_symmetric as vector_to_symmetric

__all__ = ["AffineBlock", "AffineStack", "is_positive_definite", "symmetric_to_vector", "vector_to_symmetric"]
