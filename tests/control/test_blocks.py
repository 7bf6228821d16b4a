"""What holds for every controller: batches, forgetting, and the generated source of its model part."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

import steelyard as sy
from steelyard.control import (
    AdaptiveForceControl,
    ComputedTorque,
    FeedforwardTracking,
    GravityCompensation,
    ImpedanceControl,
    PositionTracking,
    TaskSpaceControl,
    Tool,
)
from steelyard.simulation import Controller, Measurement

GAINS = {"kp": 30.0, "kd": 8.0}


def wave(t):
    return 0.5 + 0.1 * np.sin(t) * np.ones(6), 0.1 * np.cos(t) * np.ones(6), -0.1 * np.sin(t) * np.ones(6)


def blocks(model, parameters, link, pose, **options):
    tool = Tool(link, [0.0, 0.02, 0.1])
    return {
        "gravity": GravityCompensation(model, parameters, coriolis=True, damping=1.0, **options),
        "feedforward": FeedforwardTracking(model, parameters, wave, **GAINS, **options),
        "computed_torque": ComputedTorque(model, parameters, wave, **GAINS, ki=3.0, tool=tool, **options),
        "position": PositionTracking(model, parameters, wave, **GAINS, **options),
        "task_space": TaskSpaceControl(model, parameters, tool, pose, **GAINS, sensing=True, **options),
        "impedance": ImpedanceControl(
            model, parameters, tool, pose, stiffness=90.0, damping=20.0, inertia=2.0, frame="target", **options
        ),
        "stiffness": ImpedanceControl(model, parameters, tool, pose, stiffness=90.0, damping=20.0, **options),
        "force": AdaptiveForceControl(
            model, parameters, tool, 5.0, normal=(0, 0, -1), reference=pose, **GAINS, **options
        ),
    }


NAMES = (
    "gravity",
    "feedforward",
    "computed_torque",
    "position",
    "task_space",
    "impedance",
    "stiffness",
    "force",
)


@pytest.fixture(scope="module")
def every(six):
    model, parameters, plant, link = six
    return blocks(model, parameters, link, plant.pose(np.array([0.2, -0.7, 0.9, 0.3, 0.9, 0.1])))


def measurements(shape, steps=25):
    """A motion of each run that goes in and out of contact."""
    random = np.random.default_rng(9)
    center = np.array([0.2, -0.7, 0.9, 0.3, 0.9, 0.1]) + random.uniform(-0.2, 0.2, (*shape, 6))
    rate = random.uniform(-0.5, 0.5, (*shape, 6))
    press = random.uniform(3.0, 12.0, (*shape, 1))
    found = []
    for k in range(steps):
        t = 0.001 * k
        force = np.zeros((*shape, 6))
        force[..., 2:3] = np.maximum(press * np.sin(0.3 * k), 0.0)
        found.append(Measurement(t=t, q=center + rate * t, force=force))
    return found


def answers(controller, given):
    controller.start(given[0])
    return np.array([controller.torque(one).copy() for one in given])


@pytest.mark.parametrize("name", NAMES)
def test_runs_of_a_batch_are_controlled_as_each_alone(every, name):
    controller = every[name]
    together = answers(controller, measurements((3,)))
    assert together.shape == (25, 3, 6)
    grid = answers(controller, measurements((1, 3)))
    np.testing.assert_allclose(grid[:, 0], together, rtol=1e-9, atol=1e-9)
    for run in range(3):
        alone = [Measurement(t=m.t, q=m.q[run], force=m.force[run]) for m in measurements((3,))]
        np.testing.assert_allclose(answers(controller, alone), together[:, run], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_start_forgets(every, name):
    controller = every[name]
    given = measurements(())
    first = answers(controller, given)
    np.testing.assert_array_equal(answers(controller, given), first)
    assert np.ptp(first, axis=0).max() > 0.0


@pytest.mark.parametrize("name", NAMES)
def test_a_block_is_a_controller_that_says_what_it_is(every, name):
    controller = every[name]
    assert isinstance(controller, Controller)
    assert controller.sample_time == 0.001
    assert repr(controller) == f"{type(controller).__name__}(ur5: 6 joints, every 0.001 s)"


@pytest.mark.slow
def test_base_parameters_serve_as_well(six):
    """Links are seen through their effect alone, so that both kinds of parameters command the same."""
    model, parameters, plant, link = six
    pose = plant.pose(np.array([0.2, -0.7, 0.9, 0.3, 0.9, 0.1]))
    base = model.base_parameters().values(parameters)
    given = measurements((2,))
    standard, reduced = (blocks(model, p, link, pose, base=b) for p, b in ((parameters, False), (base, True)))
    for name in NAMES:
        expected = answers(standard[name], given)
        np.testing.assert_allclose(answers(reduced[name], given), expected, rtol=1e-6, atol=1e-6)


def compiled(controller, directory, fixed):
    """Return the generated functions by the model's names, as calls from arrays to their outputs side by side."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc, which compiles the generated source, is not installed")
    files = controller.generate("c", directory, fixed=fixed)
    source = next(f for f in files if f.suffix == ".c" and not f.stem.endswith("_test"))
    library = directory / "controller.so"
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, str(source), "-lm", "-o", str(library)], check=True, timeout=120)
    subprocess.run(
        ["gcc", *flags[:-2], *map(str, directory.glob("*.c")), "-lm", "-o", str(directory / "self_test")],
        check=True,
        timeout=120,
    )
    subprocess.run([str(directory / "self_test")], check=True, timeout=60, capture_output=True)
    loaded = ctypes.CDLL(str(library))

    def call_of(name):
        kernel = controller._part.model.function(name)
        function = getattr(loaded, f"ur5_{kernel.name}")

        def call(*arrays):
            out = [np.zeros(o.size) for o in kernel.outputs]
            function(*(ctypes.c_void_p(np.ascontiguousarray(a).ctypes.data) for a in (*arrays, *out)))
            return np.concatenate(out)

        return call

    return {name: call_of(name) for name in controller.functions}


@pytest.mark.slow
@pytest.mark.parametrize("fixed", [False, True])
def test_generated_c_is_the_model_part(every, six, random, tmp_path, fixed):
    """Against the block's own calls, and against Pinocchio."""
    _, parameters, plant, link = six
    calls = {}
    for name in ("gravity", "task_space"):
        calls |= compiled(every[name], tmp_path / name, fixed)
    assert set(calls) == {
        "gravity",
        "coriolis",
        "inertia_matrix",
        "computed_torque",
        f"pose({link})",
        f"jacobian({link})",
        f"jacobian_rate({link})",
    }
    delta = () if fixed else (parameters,)
    point = np.array([0.0, 0.02, 0.1])
    pin, data = plant.pin, plant.data
    for _ in range(3):
        q, dq, ddq = random.uniform(-2.0, 2.0, (3, 6))
        still = pin.computeGeneralizedGravity(plant.model, data, q)
        step = 1e-6
        rate = (plant.jacobian(q + step * dq, point) - plant.jacobian(q - step * dq, point)) / (2 * step)
        expected = {
            "gravity": ((q, *delta), still, 1e-10),
            "coriolis": ((q, dq, *delta), pin.nonLinearEffects(plant.model, data, q, dq) - still, 1e-10),
            "inertia_matrix": ((q, *delta), plant.inertia_matrix(q), 1e-10),
            "computed_torque": ((q, dq, ddq, *delta), pin.rnea(plant.model, data, q, dq, ddq), 1e-10),
            f"pose({link})": ((q,), plant.pose(q), 1e-10),
            f"jacobian({link})": ((q, point), plant.jacobian(q, point), 1e-10),
            f"jacobian_rate({link})": ((q, dq, point), rate, 1e-8),
        }
        for name, (arguments, wanted, tolerance) in expected.items():
            found = calls[name](*arguments)
            np.testing.assert_allclose(found, np.ravel(wanted), atol=tolerance * max(1.0, np.abs(wanted).max()))
            block = every["gravity"] if name in ("gravity", "coriolis") else every["task_space"]
            own = block._part(name, *[a for a in arguments if a is not parameters and a is not point])
            np.testing.assert_allclose(found, own, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(own).max()))


def test_an_unknown_language_is_refused(every, tmp_path):
    with pytest.raises(sy.InputError, match="fortran"):
        every["gravity"].generate("fortran", tmp_path)
