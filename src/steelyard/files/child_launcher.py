"""A program that runs the file of another one within limits, for `run_child`; it imports nothing of this package.

It is started with the bytes of the address space, the seconds of processor time, the path of the file, and the
arguments of that program.
"""

from __future__ import annotations

import contextlib
import os
import runpy
import sys

__all__ = ["main"]


def main() -> None:
    """Run the function ``main`` of the file."""
    memory, seconds = int(sys.argv[1]), int(sys.argv[2])
    # What libraries print must not mix with the answers.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        # The signal of the first limit tells that the time ran out; the second one ends a process that ignores it.
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    program = sys.argv[3]
    sys.argv = sys.argv[3:]
    runpy.run_path(program)["main"](answers)
    answers.flush()
    os._exit(0)  # without the cleanup of libraries, which may crash after a damaged file


if __name__ == "__main__":
    main()
