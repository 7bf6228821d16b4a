"""What writes the source of a project in one language."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .project import Project

__all__ = ["SourceWriter"]


class SourceWriter(ABC):
    """Writes the source of one project; its `write` is what a language is.

    Parameters
    ----------
    project : Project
    """

    def __init__(self, project: Project) -> None:
        self.project = project

    @classmethod
    def write(cls, project: Project) -> dict[str, str]:
        """Return the files of a project by relative path."""
        return cls(project).files()

    @abstractmethod
    def files(self) -> dict[str, str]:
        """Return the files of the project by relative path."""
