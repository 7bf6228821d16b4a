"""The impedance at the tool, measured from outside: known wrenches on Pinocchio's plant, and how the tool answers."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import steelyard as sy
from steelyard.control import ImpedanceControl, MeasuredVelocity, NumericalDifference, Tool
from steelyard.simulation import Measurement

STIFFNESS = np.array([600.0, 500.0, 800.0, 40.0, 50.0, 30.0])
DAMPING = np.array([60.0, 55.0, 70.0, 4.0, 5.0, 3.0])
INERTIA = np.array([4.0, 3.0, 5.0, 0.3, 0.4, 0.25])
SIZE = np.array([6.0, 6.0, 6.0, 0.4, 0.4, 0.4])  # of the wrenches, N and N·m
SPAN = 4.0  # s of the record, after what the start has left behind
SETTLING = 1.0


def lines(axis):
    """Frequencies (Hz) of one axis, apart from those of the others; whole periods in the span."""
    return np.array([2 + axis, 9 + axis, 18 + axis]) / SPAN


def wrench(t):
    phases = np.array([0.0, 2.0, 4.0])
    return np.array([SIZE[k] / 3 * np.sum(np.sin(2 * np.pi * lines(k) * t + phases)) for k in range(6)])


def deviations(plant, places, rest):
    found = []
    for q in places:
        pose = plant.pose(q)
        turn = Rotation.from_matrix(pose[:3, :3] @ rest[:3, :3].T).as_rotvec()
        found.append(np.concatenate((pose[:3, 3] - rest[:3, 3], turn)))
    return np.array(found)


def measured(plant, controller, q, rest):
    """Return stiffness, damping and inertia along each axis, by least squares over its spectral lines."""
    t, places, _ = plant.run(controller, q, 0 * q, SETTLING + SPAN, wrench=wrench, velocity=False)
    kept = slice(len(t) - round(SPAN / controller.sample_time) - 1, len(t) - 1)
    error, force = deviations(plant, places[kept], rest), np.array([wrench(x) for x in t[kept]])
    moved, pushed = np.fft.rfft(error, axis=0), np.fft.rfft(force, axis=0)
    result = []
    for axis in range(6):
        bins = np.round(lines(axis) * SPAN).astype(int)
        w = 2 * np.pi * lines(axis)
        ratio = pushed[bins, axis] / moved[bins, axis]
        (k, a), *_ = np.linalg.lstsq(np.column_stack((np.ones(3), -(w**2))), ratio.real, rcond=None)
        d = (ratio.imag @ w) / (w @ w)
        result.append((k, d, a))
    return np.array(result).T


@pytest.mark.slow
def test_stiffness_damping_and_inertia_are_those_designed(six, random, bent):
    model, parameters, plant, link = six
    q, _ = bent(model, random)
    rest = plant.pose(q)
    controller = ImpedanceControl(
        model, parameters, Tool(link), rest, stiffness=STIFFNESS, damping=DAMPING, inertia=INERTIA
    )
    stiffness, damping, inertia = measured(plant, controller, q, rest)
    np.testing.assert_allclose(stiffness, STIFFNESS, rtol=0.02)
    np.testing.assert_allclose(damping, DAMPING, rtol=0.02)
    np.testing.assert_allclose(inertia, INERTIA, rtol=0.02)


@pytest.mark.parametrize("arm", ["ur5", pytest.param("xarm7", marks=pytest.mark.slow)], indirect=True)
def test_a_steady_push_moves_the_tool_by_force_over_stiffness(arm, random, bent):
    """Without a sensor too."""
    model, parameters, plant, link = arm
    q, _ = bent(model, random)
    rest = plant.pose(q)
    push = np.array([6.0, -4.0, 5.0])
    controller = ImpedanceControl(
        model,
        parameters,
        Tool(link),
        rest,
        stiffness=STIFFNESS[:3],
        damping=2 * DAMPING[:3],
        axes="position",
        sample_time=0.002,
    )
    _, places, _ = plant.run(
        controller, q, 0 * q, 2.0, wrench=lambda t: np.array([*push, 0.0, 0.0, 0.0]), velocity=False
    )
    (moved,) = deviations(plant, places[-1:], rest)
    np.testing.assert_allclose(moved[:3], push / STIFFNESS[:3], rtol=0.01)


def test_without_a_sensor_the_inertia_is_that_of_the_arm(arm, random, bent):
    """The acceleration that a wrench causes at rest: (J M^-1 J')^-1 is the arm's own, by Pinocchio."""
    model, parameters, plant, link = arm
    q, _ = bent(model, random)
    push = random.normal(size=6)
    controller = ImpedanceControl(
        model, parameters, Tool(link), plant.pose(q), stiffness=STIFFNESS, damping=DAMPING, sample_time=2e-5
    )
    seen = Measurement(t=0.0, q=q, force=push)
    controller.start(seen)
    assert not controller.sensing
    ddq = plant.acceleration(q, 0 * q, controller.torque(seen), push)
    jacobian = plant.jacobian(q)
    expected = jacobian @ np.linalg.solve(plant.inertia_matrix(q), jacobian.T) @ push
    np.testing.assert_allclose(plant.tool_acceleration(q, 0 * q, ddq), expected, rtol=1e-7, atol=1e-9)


def test_full_matrices_along_the_axes_of_the_target(redundant, random, bent):
    """``A a + D v + K e = force`` in the target's axes, with Pinocchio's accelerations."""
    model, parameters, plant, link = redundant
    q, dq = bent(model, random)
    matrices = []
    for size in (4.0, 50.0, 500.0):
        root = random.normal(size=(6, 6))
        matrices.append(size * (root @ root.T + np.eye(6)))
    inertia, damping, stiffness = matrices
    turn = Rotation.from_rotvec([0.5, -0.4, 0.3]).as_matrix()
    rest = plant.pose(q)
    rest[:3, :3] = Rotation.from_rotvec([0.1, 0.05, -0.1]).as_matrix() @ rest[:3, :3]
    rest[:3, 3] += [0.02, 0.01, -0.03]
    push = random.normal(size=6)
    controller = ImpedanceControl(
        model,
        parameters,
        Tool(link),
        rest,
        stiffness=stiffness,
        damping=damping,
        inertia=inertia,
        frame="target",
        velocity=MeasuredVelocity(),
    )
    seen = Measurement(t=0.0, q=q, dq=dq, force=push)
    controller.start(seen)
    ddq = plant.acceleration(q, dq, controller.torque(seen), push)
    turn = np.kron(np.eye(2), rest[:3, :3].T)
    (e,) = deviations(plant, [q], rest)
    left = inertia @ turn @ plant.tool_acceleration(q, dq, ddq)
    left = left + damping @ turn @ plant.jacobian(q) @ dq + stiffness @ turn @ e
    np.testing.assert_allclose(left, turn @ push, rtol=1e-6, atol=1e-5)


@pytest.mark.slow
def test_velocity_estimators_do_not_change_the_stiffness(six, random, bent):
    model, parameters, plant, link = six
    q, _ = bent(model, random)
    rest = plant.pose(q)
    ends = []
    for velocity in (NumericalDifference(), NumericalDifference(steps=3)):
        controller = ImpedanceControl(
            model,
            parameters,
            Tool(link),
            rest,
            stiffness=STIFFNESS,
            damping=3 * DAMPING,
            inertia=2 * INERTIA,
            velocity=velocity,
            sample_time=0.002,
        )
        _, places, _ = plant.run(controller, q, 0 * q, 1.4, wrench=lambda t: SIZE, velocity=False)
        ends.append(deviations(plant, places[-1:], rest)[0])
    np.testing.assert_allclose(ends[0], SIZE / STIFFNESS, rtol=0.01)
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.01)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"stiffness": -1.0}, "stiffness must be positive semidefinite"),
        ({"damping": [1.0]}, "6 numbers"),
        ({"inertia": 0.0}, "inertia must be positive definite"),
        ({"frame": "tool"}, "'base' or 'target'"),
        ({"frame": "target", "axes": ("x", "y")}, "needs axes='pose'"),
    ],
)
def test_bad_input_is_refused(six, arguments, message):
    model, parameters, _, link = six
    given = {"stiffness": 1.0, "damping": 1.0} | arguments
    with pytest.raises(sy.InputError, match=message):
        ImpedanceControl(model, parameters, Tool(link), np.eye(4), **given)


def test_shaping_the_inertia_needs_a_sensor(six, random, bent):
    model, parameters, plant, link = six
    q, _ = bent(model, random)
    controller = ImpedanceControl(model, parameters, Tool(link), plant.pose(q), stiffness=1.0, damping=1.0, inertia=1.0)
    with pytest.raises(sy.InputError, match="force"):
        controller.start(Measurement(t=0.0, q=q))
