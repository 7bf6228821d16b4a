"""A digest of the code that makes functions, so that machine code from another version is never used."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

__all__ = ["source_digest"]

_ROOMS = ("robot", "graph", "dynamics")


@cache
def source_digest() -> str | None:
    """Return a digest of the rooms that turn a description into machine code, or None where they cannot be read."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    try:
        for room in _ROOMS:
            files = sorted((package / room).rglob("*.py"))
            if not files:
                return None
            for path in files:
                content = path.read_bytes()
                digest.update(f"{path.relative_to(package).as_posix()} {len(content)}\n".encode() + content)
    except OSError:
        return None
    return digest.hexdigest()
