"""Finding what the user meant by a name that does not exist."""

import difflib
from collections.abc import Iterable

__all__ = ["closest", "suggestion"]


def closest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is closest to another one, whatever its capitals; None where none is close."""
    by_lower = {candidate.lower(): candidate for candidate in reversed(list(known))}
    # "m3" and "m2" have a similarity of 0.5, and one is worth suggesting for the other.
    found = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.5)
    return by_lower[found[0]] if found else None


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the closest known name, or the first few known ones.

    Examples
    --------
    >>> suggestion("elbw", ["shoulder", "elbow"])
    'did you mean "elbow"?'
    >>> suggestion("x", ["shoulder", "elbow"])
    'known are "shoulder", "elbow".'
    """
    candidates = [str(candidate) for candidate in known]
    close = closest(name, candidates)
    if close is not None:
        return f'did you mean "{close}"?'
    if not candidates:
        return "there are none."
    listed = ", ".join(f'"{candidate}"' for candidate in candidates[:8])
    return f"known are {listed}" + (f" and {len(candidates) - 8} more." if len(candidates) > 8 else ".")
