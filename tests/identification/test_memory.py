"""A log larger than the memory that the process may use."""

import json
import subprocess
import sys

import numpy as np
import pytest

import steelyard as sy

resource = pytest.importorskip("resource", reason="memory limits are those of POSIX")

# Address space that is left for the work, beyond what the interpreter and its libraries have taken.
ALLOWED = 400 * 2**20

SCRIPT = """
import json, resource, sys
import steelyard, numpy, scipy.signal, scipy.sparse, polars, clarabel, llvmlite.binding, lxml.etree
from steelyard.identification import identify
from steelyard.recording import Recording

small, log, robot, limit = sys.argv[1:]
identify(robot, [small])  # threads, code and buffers that every run needs are there before the limit
taken = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (taken + int(limit),) * 2)
try:
    Recording.read(log, joints=3)
    whole = "fits"
except MemoryError:
    whole = "does not fit"
except BaseException as error:
    whole = "does not fit" if "memory" in str(error).lower() or "alloc" in str(error).lower() else repr(error)
result = identify(robot, [log], chunk_rows=100_000)
print(json.dumps({"whole": whole, "base": result.unconstrained.base.tolist(), "count": result.information.count}))
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_log_larger_than_memory_is_identified_in_chunks(elbow, simulation):
    path, model, folder = elbow
    path.write_text(path.read_text() + 'velocity_threshold = "none"\n')  # so that the rows can be counted
    small = simulation.record(model, folder / "small.csv", seed=11, noise=0.5)
    log = folder / "large.npz"
    t, q, dq, ddq = simulation.trajectory(11).sample(200.0, 1.0)
    repeats = 4000  # 8 million samples, 450 MB
    torque = model.inverse_dynamics(q, dq, ddq, simulation.true_parameters(model))
    torque += np.random.default_rng(11).normal(size=q.shape) * 0.5
    count = len(t) * repeats
    np.savez(log, t=np.arange(count) / 200.0, q=np.tile(q, (repeats, 1)), torque=np.tile(torque, (repeats, 1)))
    assert log.stat().st_size > ALLOWED
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(small), str(log), str(path), str(ALLOWED)], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr[-2000:]
    answer = json.loads(run.stdout)
    assert answer["whole"] == "does not fit"
    assert answer["count"] == 3 * (count - 200)
    once = sy.identify(path, [small]).unconstrained.base
    np.testing.assert_allclose(answer["base"], once, atol=0.05 * np.abs(once).max())
