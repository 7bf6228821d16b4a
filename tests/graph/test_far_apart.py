"""Machine code whose parts find no room beside each other."""

import platform
import struct
import subprocess
import sys

import llvmlite.binding as llvm
import pytest

from steelyard.graph import machine as machine_module
from steelyard.graph.instructions import support_source
from steelyard.graph.machine import Machine

# A reservation of 8 GiB, with every gap above it taken but for a few pages, stands for a program that allocates: what
# asks for memory gets those pages while it fits, and the rest lies beyond the reservation.
CROWDED = """
import ctypes, mmap
import numpy as np
from steelyard.graph import Argument, Function, Graph, Kernel, ObjectCache, Output, sin
from steelyard.graph.machine import batch_lanes, host_machine

libc = ctypes.CDLL(None)
libc.mmap.restype = ctypes.c_void_p
libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long]
libc.munmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
PRIVATE_ANONYMOUS_UNRESERVED = 0x2 | 0x20 | 0x4000

def take(size):
    return libc.mmap(None, size, 0, PRIVATE_ANONYMOUS_UNRESERVED, -1, 0)

def crowd(pages):
    free = take(mmap.PAGESIZE * pages)
    barrier = take(8 << 30)
    for size in (1 << 30, 1 << 24, 1 << 18, mmap.PAGESIZE):
        while (place := take(size)) > barrier:
            pass
        libc.munmap(place, size)
    libc.munmap(free, mmap.PAGESIZE * pages)

x = Graph().inputs("x", 2)
motion = np.array([[0.5, 2.0], [0.7, 3.0]])
assert host_machine(1).support is host_machine(batch_lanes()).support
support = host_machine(1).support
kernels = []
for pages in range(1, 9):
    output = Output("y", (), (sin(x[0]) * x[1] * (0.1 + pages),))
    kernel = Kernel(Function("f", (Argument("x", 2),), (output,)), cache=ObjectCache(None))
    crowd(pages)
    values = kernel(motion)[:, 0]
    assert np.allclose(values, np.sin(motion[:, 0]) * motion[:, 1] * (0.1 + pages), rtol=1e-14), values
    crowd(pages)
    assert np.allclose(kernel.sample(motion[1]), values[1], rtol=1e-14)
    kernels.append(kernel)
places = [code.addresses["kernel"] for kernel in kernels for code in kernel._loaded.values()]
print(*(abs(place - support.addresses["clear"]) for place in places))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="fills the memory of a process by Linux's own calls")
def test_memory_that_is_crowded_between_loads():
    done = subprocess.run([sys.executable, "-c", CROWDED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    distances = [int(word) for word in done.stdout.split()]
    assert len(distances) == 16
    assert max(distances) > 2**36  # so that the reservations did lie between


def coff_relocations(code):
    """Return the types of all relocations of an object file in Windows's format (Microsoft PE/COFF)."""
    sections = struct.unpack_from("<H", code, 2)[0]
    types = []
    for k in range(sections):
        start, _, count = struct.unpack_from("<IIH", code, 20 + 40 * k + 24)
        types += [struct.unpack_from("<H", code, start + 10 * n + 8)[0] for n in range(count)]
    return types


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="LLVM knows this processor alone")
def test_code_for_windows_holds_whole_addresses(monkeypatch):
    machine = Machine(4)  # LLVM knows its targets from here on
    triple = "x86_64-pc-windows-msvc"
    monkeypatch.setattr(llvm, "get_process_triple", lambda: triple)
    monkeypatch.setattr(llvm, "get_host_cpu_name", lambda: "haswell")
    monkeypatch.setattr(llvm, "get_host_cpu_features", llvm.FeatureMap)
    found = {}
    for whole in (False, True):
        monkeypatch.setattr(machine_module, "_WHOLE_ADDRESSES", whole)
        machine = Machine(4)
        found[whole] = set(coff_relocations(machine.compile(support_source(4, triple))))
    assert found == {False: {4}, True: {1}}  # IMAGE_REL_AMD64_REL32 and IMAGE_REL_AMD64_ADDR64
