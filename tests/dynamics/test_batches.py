"""Batches of kernels and of a model's methods, every argument against every other, beside samples computed alone."""

import numpy as np
import pytest
from batches import drawn, leading_shapes, one_by_one, small_model

import steelyard as sy
from steelyard.graph import Kernel

MODEL = small_model()
METHODS = {
    "inverse_dynamics": MODEL.inverse_dynamics,
    "forward_dynamics": lambda *given: MODEL.forward_dynamics(*given, method="inertia_matrix"),
    "forward_dynamics_articulated": lambda *given: MODEL.forward_dynamics(*given, method="articulated_body"),
    "computed_torque": MODEL.computed_torque,
    "inertia_matrix": MODEL.inertia_matrix,
    "total_inertia_matrix": MODEL.total_inertia_matrix,
    "coriolis_matrix": MODEL.coriolis_matrix,
    "coriolis": MODEL.coriolis,
    "gravity": MODEL.gravity,
    "drive_torque": lambda q, dq, ddq, parameters: MODEL.drive_torque(dq, ddq, parameters, q),
    "momentum": MODEL.momentum,
    "kinetic_energy": MODEL.kinetic_energy,
    "potential_energy": MODEL.potential_energy,
    "regressor": MODEL.regressor,
    "momentum_regressor": MODEL.momentum_regressor,
    "energy_regressor": MODEL.energy_regressor,
    "inverse_dynamics_derivatives": MODEL.inverse_dynamics_derivatives,
    "pose": lambda q: MODEL.pose(q, 1),
    "jacobian": lambda q, point: MODEL.jacobian(q, 1, point),
    "jacobian_rate": lambda q, dq, point: MODEL.jacobian_rate(q, dq, 1, point),
}


def test_every_function_has_its_method():
    assert set(METHODS) == set(MODEL.functions)


@pytest.mark.parametrize("name", MODEL.functions)
def test_methods(name, random):
    """Parameters and points are one for all the samples, so a batch of them is refused."""
    function = MODEL.function(name)
    for shapes in leading_shapes(function.arguments):
        arrays = drawn(function.arguments, shapes, random)
        if any(shape and argument.uniform for shape, argument in zip(shapes, function.arguments, strict=True)):
            with pytest.raises(sy.InputError, match="expected shape"):
                METHODS[name](*arrays)
            continue
        found = METHODS[name](*arrays)
        for value, wanted in zip(
            found if isinstance(found, tuple) else (found,), one_by_one(function, arrays), strict=True
        ):
            assert np.shape(value) == wanted.shape, shapes
            np.testing.assert_allclose(value, wanted, rtol=1e-11, atol=1e-12 * (1.0 + np.abs(wanted).max()))


@pytest.mark.parametrize("name", MODEL.functions)
def test_kernels(name, random):
    """Whose batches are rows of all the arguments that are not the same for all samples."""
    function = MODEL.function(name, gravity="argument")
    kernel = Kernel(function)
    sizes = {1, 5, *(argument.width for argument in function.arguments)}
    for size in sizes:
        shapes = tuple(() if argument.uniform else (size,) for argument in function.arguments)
        arrays = drawn(function.arguments, shapes, random)
        wanted = np.concatenate([a.reshape(size, -1) for a in one_by_one(function, arrays)], axis=1)
        np.testing.assert_allclose(kernel(*arrays), wanted, rtol=1e-11, atol=1e-12 * np.abs(wanted).max())
