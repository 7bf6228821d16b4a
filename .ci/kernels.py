"""Name the kernels of linear algebra that this processor can run, or check that the one asked for does run.

usage: kernels.py; OPENBLAS_CORETYPE=NAME kernels.py --check
"""

import os
import sys
from pathlib import Path

import numpy as np
import scipy.linalg
import threadpoolctl

# OpenBLAS runs the kernels that it is told to, and dies where the processor has not got the instructions.
NEEDS = {
    "Haswell": {"avx2", "fma"},
    "Zen": {"avx2", "fma"},
    "SkylakeX": {"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"},
    "Prescott": set(),
}
# Kernels that are one in the libraries which NumPy and SciPy bring; the first name is the one that they tell.
SAME = {"Zen": {"Haswell"}, "Prescott": {"Katmai"}}

if sys.argv[1:] != ["--check"]:
    words = set(Path("/proc/cpuinfo").read_text().split())
    print(*(name for name, needs in NEEDS.items() if needs <= words))
    sys.exit()

scipy.linalg.eigvalsh(np.eye(2))  # NumPy and SciPy each bring a library of their own
told = {
    entry["filepath"]: entry["architecture"] for entry in threadpoolctl.threadpool_info() if "architecture" in entry
}
asked = os.environ["OPENBLAS_CORETYPE"]
if len(told) < 2 or any(name not in {asked, *SAME.get(asked, ())} for name in told.values()):
    sys.exit(f"kernels.py: asked for {asked}, found {told}")
print(f"asked for {asked}, run by {', '.join(sorted(set(told.values())))} in {len(told)} libraries")
