"""Formats of log files, one a file."""

__all__: list[str] = []
