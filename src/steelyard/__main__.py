"""Runs the command line: ``python -m steelyard``."""

from .cli import main

main()
