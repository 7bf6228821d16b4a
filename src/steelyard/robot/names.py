"""Finding what the user meant by a name that does not exist."""

import difflib
from collections.abc import Iterable

__all__ = ["suggestion"]


def suggestion(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: the closest known name, or the first few of them.

    Examples
    --------
    >>> suggestion("elbw", ["shoulder", "elbow"])
    'did you mean "elbow"?'
    >>> suggestion("x", ["shoulder", "elbow"])
    'known are "shoulder", "elbow"'
    """
    candidates = [str(candidate) for candidate in known]
    by_lower = {candidate.lower(): candidate for candidate in reversed(candidates)}
    close = difflib.get_close_matches(name.lower(), by_lower, n=1)
    if close:
        return f'did you mean "{by_lower[close[0]]}"?'
    if not candidates:
        return "there are none"
    listed = ", ".join(f'"{candidate}"' for candidate in candidates[:8])
    return f"known are {listed}" + (f" and {len(candidates) - 8} more" if len(candidates) > 8 else "")
