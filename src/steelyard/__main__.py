"""Runs the command line: ``python -m steelyard``, and the script ``steelyard``."""

import signal
import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line; Ctrl-C is told in a word also while it is loaded, which takes half a second."""
    # As batch systems end a run: workers end, and temporary files go, as after Ctrl-C.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        from steelyard.cli import main as run
    except KeyboardInterrupt:
        print("steelyard: interrupted", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
