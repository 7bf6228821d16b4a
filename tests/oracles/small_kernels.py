"""Small functions to compile, what they must give, and arrays of every kind."""

import numpy as np

from steelyard.graph import Argument, Function, Graph, Kernel, ObjectCache, Output, cos, sign, sin, sqrt

NO_CACHE = ObjectCache(None)


def kernel_of(arguments, nodes, **options):
    function = Function("f", tuple(arguments), (Output("y", (len(nodes),), tuple(nodes)),))
    return Kernel(function, **({"cache": NO_CACHE} | options))


def outputs_of(graph, width):
    """Return `width` outputs of every kind of operation, some of them constant or repeated."""
    x, p = graph.inputs("x", 3), graph.inputs("p", 2)
    some = [
        sin(x[0]) * p[0],
        cos(x[0]) - x[1],
        sign(x[1]),
        graph.zero,
        x[2] * x[2] + p[1],
        -x[0],
        graph.constant(2.5),
        sin(x[1] + x[2]),
        x[1],
        p[1] * 1.0,
        sqrt(x[0] * x[0] + p[1] * p[1]),
        sqrt(p[0] * p[0]),
    ]
    return [some[k % len(some)] for k in range(width)]


def pendulum():
    """Return the torque and the energy of a pendulum."""
    g = Graph()
    q, dq, ddq = (g.input(f"motion[{k}]") for k in range(3))
    mass, length = g.inputs("parameters", 2)
    weight = mass * length * 9.81
    outputs = (
        Output("torque", (), (mass * length * length * ddq + weight * sin(q),)),
        Output("energy", (), (mass * length * length * dq * dq * 0.5 - weight * cos(q),)),
    )
    return Function("pendulum", (Argument("motion", 3), Argument("parameters", 2, uniform=True)), outputs)


PARAMETERS = np.array([2.0, 0.5])


def motions(count, seed=0):
    return np.random.default_rng(seed).normal(size=(count, 3))


def expected(motion):
    return np.stack(
        [
            0.5 * motion[:, 2] + 9.81 * np.sin(motion[:, 0]),
            0.25 * motion[:, 1] ** 2 - 9.81 * np.cos(motion[:, 0]),
        ],
        axis=1,
    )


def unusual(array):
    """Yield the same numbers as arrays that are not contiguous rows of doubles of this machine."""
    yield array.tolist()
    yield np.asfortranarray(array)
    yield array.astype(">f8")
    yield np.repeat(array, 2, axis=0)[::2]
    fixed = array.copy()
    fixed.flags.writeable = False
    yield fixed
    yield np.frombuffer(b"\0" + array.tobytes(), dtype=np.float64, offset=1).reshape(array.shape)  # not aligned
    yield array.view(type("Special", (np.ndarray,), {}))
