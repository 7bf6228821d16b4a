"""Name the kernels of linear algebra that this processor can run and does not run by itself, one of each set.

usage: kernels.py; kernels.py --told (which kernels NumPy and SciPy tell to run)
"""

import os
import subprocess
import sys
from pathlib import Path

# OpenBLAS runs the kernels that it is told to, and dies where the processor has not got the instructions.
NEEDS: dict[str, set[str]] = {
    "Prescott": set(),
    "SkylakeX": {"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"},
    "Haswell": {"avx2", "fma"},
    "Zen": {"avx2", "fma"},
}
TOLD_AS = {"Zen": {"Haswell"}, "Prescott": {"Katmai"}}


def told() -> set[str]:
    """Names of the kernels of the libraries that NumPy and SciPy each bring, which may be called differently."""
    import numpy as np
    import scipy.linalg
    import threadpoolctl

    scipy.linalg.eigvalsh(np.eye(2))
    libraries = [entry["architecture"] for entry in threadpoolctl.threadpool_info() if "architecture" in entry]
    if len(libraries) < 2:
        sys.exit(f"kernels.py: expected OpenBLAS from NumPy and SciPy each, found {libraries}")
    return set(libraries)


def told_when_asked(name: str | None) -> set[str]:
    """What a process tells that starts with these kernels, or with those of this environment."""
    environment = dict(os.environ)
    if name is not None:
        environment["OPENBLAS_CORETYPE"] = name
    command = [sys.executable, __file__, "--told"]
    return set(subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout.split())


if sys.argv[1:] == ["--told"]:
    print(*sorted(told()))
    sys.exit()

words = set(Path("/proc/cpuinfo").read_text().split())
seen = {frozenset(told_when_asked(None)): "what runs unasked"}
print(f"unasked: {', '.join(*seen)}", file=sys.stderr)
for name, needs in NEEDS.items():
    if not needs <= words:
        print(f"{name}: not on this processor, without {', '.join(sorted(needs - words))}", file=sys.stderr)
        continue
    found = told_when_asked(name)
    if not found <= {name, *TOLD_AS.get(name, ())}:
        sys.exit(f"kernels.py: asked for {name}, found {', '.join(sorted(found))}")
    twin = seen.setdefault(frozenset(found), name)
    same = "" if twin == name else f", the same as {twin}"
    print(f"{name}: run by {', '.join(sorted(found))}{same}", file=sys.stderr)
    if twin == name:
        print(name)
