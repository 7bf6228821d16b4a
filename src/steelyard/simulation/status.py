"""How a simulation ended."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Status"]


class Status(StrEnum):
    """How a run ended.

    Attributes
    ----------
    FINISHED
        At the end of its duration.
    EVENT
        At an event that ends runs.
    DIVERGED
        Nothing could be computed beyond, a joint became absurdly fast, or the energy of a passive robot grew beyond
        reason.
    STOPPED
        By a stopping condition.

    Examples
    --------
    >>> Status.DIVERGED == "diverged"
    True
    """

    FINISHED = "finished"
    EVENT = "event"
    DIVERGED = "diverged"
    STOPPED = "stopped"
