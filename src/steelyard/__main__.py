"""Runs the command line: ``python -m steelyard``, and the script ``steelyard``."""

import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line; Ctrl-C is told in a word also while it is loaded, which takes half a second."""
    try:
        from steelyard.cli import main as run
    except KeyboardInterrupt:
        print("steelyard: interrupted", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
