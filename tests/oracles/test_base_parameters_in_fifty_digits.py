"""Base parameters against the energies of the links, in fifty digits and from the numbers in the table.

Torques come from the kinetic and the potential energy, which are linear in the parameters; what leaves both as they
are leaves the torques. Nothing of Steelyard's kinematics is used, and no rotation is rounded to floating point.
"""

import numpy as np
import pytest

import steelyard as sy

mpmath = pytest.importorskip("mpmath")
mp = mpmath.mp.clone()
mp.dps = 50

GRAVITY = (0, 0, "-9.81")


def elementary(angle, axis):
    c, s = mp.cos(angle), mp.sin(angle)
    turn = mp.eye(4)
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    turn[i, i] = turn[j, j] = c
    turn[i, j], turn[j, i] = -s, s
    return turn


def shift(value, axis):
    matrix = mp.eye(4)
    matrix[axis, 3] = value
    return matrix


def generator(rotates):
    matrix = mp.zeros(4)
    if rotates:
        matrix[0, 1], matrix[1, 0] = -1, 1
    else:
        matrix[2, 3] = 1
    return matrix


def number(cell):
    return {"pi/2": mp.pi / 2, "-pi/2": -mp.pi / 2}.get(cell) or mp.mpf(cell)


def moments(matrix):
    """Coefficients of tr(A S) by Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m, with S = [[tr(L)/2 - L, l], [l', m]]."""
    trace = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 2
    return [
        trace - matrix[0, 0],
        -(matrix[0, 1] + matrix[1, 0]),
        -(matrix[0, 2] + matrix[2, 0]),
        trace - matrix[1, 1],
        -(matrix[1, 2] + matrix[2, 1]),
        trace - matrix[2, 2],
        matrix[0, 3] + matrix[3, 0],
        matrix[1, 3] + matrix[3, 1],
        matrix[2, 3] + matrix[3, 2],
        matrix[3, 3],
    ]


def energies(rows, q, dq):
    """Kinetic energy, and rate of the potential one, of a motion (twice the former), by the parameters."""
    pose, rate = mp.eye(4), mp.zeros(4)
    kinetic, potential = [], []
    for (alpha, a, d, theta), x, v in zip(rows, q, dq, strict=True):
        rotates = theta == "q"
        before = shift(0 if d == "q" else number(d), 2) * elementary(0 if rotates else number(theta), 2)
        motion = elementary(x, 2) if rotates else shift(x, 2)
        after = shift(number(a), 0) * elementary(number(alpha), 0)
        base = pose * before
        rate = (rate * before + base * generator(rotates) * v) * motion * after
        pose = base * motion * after
        kinetic += moments(rate.T * rate)
        rise = [-sum(mp.mpf(GRAVITY[i]) * rate[i, j] for i in range(3)) for j in range(4)]
        potential += [*[mp.mpf(0)] * 6, *rise]
    return kinetic, potential


def eliminated(matrix):
    """Left-most independent columns of a list of rows, and the others in terms of them."""
    rows = [list(row) for row in matrix]
    pivots = []
    for column in range(len(rows[0])):
        done = len(pivots)
        place = max(range(done, len(rows)), key=lambda i: abs(rows[i][column]), default=None)
        if place is None or abs(rows[place][column]) < mp.mpf("1e-32"):
            continue
        rows[done], rows[place] = rows[place], rows[done]
        factor = rows[done][column]
        rows[done] = [value / factor for value in rows[done]]
        for i, row in enumerate(rows):
            if i != done and row[column]:
                rows[i] = [x - row[column] * y for x, y in zip(row, rows[done], strict=True)]
        pivots.append(column)
    return pivots, rows[: len(pivots)]


def sampled(rows, seed):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(6 * len(rows) + 6):
        q, dq = (list(map(mp.mpf, rng.uniform(-3, 3, len(rows)))) for _ in range(2))
        found += energies(rows, q, dq)
    return found


ROBOTS = {
    "parallel": [("0", "0.3", "0.1", "q"), ("0", "0.4", "0", "q"), ("0", "0.2", "0.1", "q")],
    "1e-3 off": [("1e-3", "0.3", "0.1", "q"), ("0", "0.4", "0", "q")],
    "1e-5 off": [("1e-5", "0.3", "0.1", "q"), ("0", "0.4", "0", "q"), ("1e-5", "0.2", "0.1", "q")],
    "1e-6 off": [("0", "0.3", "0.1", "q"), ("1e-6", "0.4", "0", "q"), ("0", "0.2", "0.1", "q")],
    "gantry": [("pi/2", "0", "q", "0"), ("pi/2", "0.1", "q", "pi/2"), ("0", "0.2", "0.1", "q")],
    "gantry 1e-5 off": [("1e-5", "0.3", "q", "0.2"), ("0", "0.1", "0.2", "q")],
    "short offset": [("pi/2", "0", "0.1", "q"), ("0", "1e-5", "0", "q"), ("pi/2", "0.2", "0", "q")],
    "oblique": [("0.3", "0.2", "0.1", "q"), ("0.7", "0", "q", "0.4")],
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name not in ("1e-6 off", "gantry", "oblique") else ())
        for name in ROBOTS
    ],
)
def test_rank_and_map_of_the_energies(name):
    rows = ROBOTS[name]
    cells = [tuple(c if c in ("q", "pi/2", "-pi/2") else float(c) for c in row) for row in rows]
    base = sy.Model(sy.Robot.from_dh(cells)).base_parameters()
    matrix = sampled(rows, 1)
    assert base.count == len(eliminated(matrix)[0])
    # The map: dependent columns are what it says of independent ones. What differs is rounding of the elements of K.
    for row in matrix[:20]:
        shown = [row[k] for k in base.independent]
        for column, coefficients in zip(base.dependent, base.Kd.T, strict=True):
            parts = [mp.mpf(float(c)) * x for c, x in zip(coefficients, shown, strict=True) if c]
            rounding = 3e-15 * float(abs(row[column]) + sum(map(abs, parts)) + max(map(abs, shown)))
            assert abs(row[column] - sum(parts, mp.mpf(0))) <= rounding


@pytest.mark.parametrize(
    ("written", "meant"), [("1.5708", False), ("1.570796", False), ("3.1416", True), ("-3.14159", True)]
)
def test_rounded_right_angles_stand_for_them(written, meant):
    """Axes that are parallel but for what four digits leave of pi show two more parameters, by 7e-6 of others.

    Where the rank does not depend on the rounding the robot is the one that is written, and K is right to rounding.
    """
    exact = str(np.pi / 2) if written[0] == "1" else str(np.sign(float(written)) * np.pi)
    first, second = (
        sy.Model(sy.Robot.from_dh([(float(a), 0.3, 0.1, "q"), (float(a), 0.2, "q", 0.0)])).base_parameters()
        for a in (exact, written)
    )
    assert second.names == first.names
    np.testing.assert_allclose(second.Kd, first.Kd, atol=0.0 if meant else 1e-4)
    assert first.error < 1e-14
    assert (first.meant, second.meant) == (False, meant)
    assert (1e-8 < second.error < 1e-4) if meant else second.error < 1e-14
