"""Source projects from graph functions: C, C++, Rust, Python, Octave, Julia, JAX and CasADi."""

from .assignments import Assignment as Assignment
from .assignments import Listing as Listing
from .assignments import OutputListing as OutputListing
from .assignments import Syntax as Syntax
from .assignments import listing as listing
from .project import Constant as Constant
from .project import Project as Project
from .project import files as files
from .project import generate as generate
from .project import languages as languages
from .reference import Reference as Reference
from .text import Names as Names

__all__ = [
    "Assignment",
    "Constant",
    "Listing",
    "Names",
    "OutputListing",
    "Project",
    "Reference",
    "Syntax",
    "files",
    "generate",
    "languages",
    "listing",
]
