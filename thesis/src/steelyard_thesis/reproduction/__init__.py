"""The thesis, section by section: its published values beside ours."""

from .comparison import Comparison as Comparison
from .reproduce import Reproduction as Reproduction
from .reproduce import all_sections as all_sections
from .reproduce import reproduce as reproduce
from .section import Context as Context
from .section import Section as Section
from .section import SectionResult as SectionResult
from .section import Table as Table

__all__ = [
    "Comparison",
    "Context",
    "Reproduction",
    "Section",
    "SectionResult",
    "Table",
    "all_sections",
    "reproduce",
]
