"""The functions of a model that a controller calls each sample time, compiled and with memory in place."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.functions import given_parameters
from steelyard.errors import InputError
from steelyard.files.arguments import positive

__all__ = ["ModelPart"]

Array = NDArray[np.float64]


class ModelPart:
    """Functions of a model with given parameters, for one sample or a batch, in memory that is allocated once.

    Parameters
    ----------
    model : Model
        Friction that needs a channel beside the motion is that of `Model.without_channels`: a controller is given no
        temperature, and steady sliding is what it takes friction with presliding for.
    parameters : array_like
        (n,), or (n_b,) with `base`: the nominal parameters of the controller.
    functions : sequence of str
        Names of functions of the model.
    base : bool
        Whether `parameters` are base parameters.
    point : array_like
        (3,) point of the Jacobians in the link frame, m.
    sign_width : float
        Velocity within which Coulomb friction changes its sign smoothly, rad/s or m/s; 0 for the exact sign.

    Attributes
    ----------
    dof : int
        Number N of joints.

    Raises
    ------
    InputError
        If the number of parameters is wrong, some are not finite, or a function or link does not exist.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> delta = np.zeros(model.parameter_count)
    >>> delta[model.parameter_names.index("m1")] = 2.0
    >>> part = ModelPart(model, delta, ["gravity", "inertia_matrix"])
    >>> part("gravity", np.zeros(1)).round(9).tolist()
    [19.62]
    >>> part.matrix("inertia_matrix", (1, 1), np.zeros((4, 1))).shape
    (4, 1, 1)
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        functions: Sequence[str],
        *,
        base: bool = False,
        point: ArrayLike = (0.0, 0.0, 0.0),
        sign_width: float = 0.0,
    ) -> None:
        self.model = model.without_channels
        self.dof = self.model.dof
        self.base = bool(base)
        self.functions = tuple(functions)
        values = np.array(given_parameters(model, parameters, base=self.base))
        size = model.base_parameters().count if base else model.parameter_count
        kind = "base parameters" if base else "parameters"
        if values.shape != (size,):
            raise InputError(f"{model.robot.name} has {size} {kind}: expected shape ({size},), got {values.shape}.")
        if not np.isfinite(values).all():
            names = model.base_parameters().names if base else model.parameter_names
            bad = names[int(np.flatnonzero(~np.isfinite(values))[0])]
            raise InputError(
                f"A controller of {model.robot.name} needs a finite number for every one of its {kind}; {bad} has none."
            )
        self.parameters = values = model.parameters_without_channels(values, self.base)
        self._sign = "smooth" if positive(sign_width, "sign_width", "rad/s", zero=True) else "exact"
        self._kernels = {name: self.model.kernel(name, base=self.base, sign=self._sign) for name in self.functions}
        self._given: Mapping[str, Array] = {
            "parameters": values,
            "base_parameters": values,
            "point": np.array(point, dtype=np.float64),
            "sign_width": np.array([sign_width]),
        }
        self._calls: dict[tuple[str, tuple[int, ...]], Callable[..., Array]] = {}

    def __call__(self, name: str, *motion: Array) -> Array:
        """Return all outputs of one of `functions`, flattened and concatenated, (..., elements), as a new array.

        Its motion is positions, velocities and so on, (..., N) and all of one shape.
        """
        shape = motion[0].shape[:-1]
        call = self._calls.get((name, shape))
        if call is None:
            call = self._calls[name, shape] = self._prepared(name, shape)
        return call(*motion)

    def matrix(self, name: str, shape: tuple[int, int], *motion: Array) -> Array:
        """Return the output of a function with one output, a matrix of the given shape for each sample."""
        flat = self(name, *motion)
        return flat.reshape((*flat.shape[:-1], *shape))

    def configurations(self) -> Array:
        """Return 64 random configurations (64, N), the same in every call."""
        return np.random.default_rng(0).uniform(-np.pi, np.pi, (64, self.dof))

    def nominal(self, name: str, q: Array) -> Array:
        """Return a function whose output is a square matrix, (P, N, N), at configurations (P, N)."""
        found = self.model.kernel(name, base=self.base)(q, self.parameters)
        return np.asarray(found).reshape(len(q), self.dof, self.dof)

    def resistance(self, q: Array) -> tuple[Array, Array]:
        """Return the inertia matrices of links and rotors, and the viscous friction matrices, (P, N, N) each.

        Viscous friction is the slope of the drive torques between 1 and 2 rad/s (or m/s), beyond the jump of Coulomb
        friction. The negative part of its symmetric part, which would drive the joints, is left out:
        noise of an identification may cause it, and the check of the gains is not about it.
        """
        count, rows = self.dof, len(q)
        drive = self.model.kernel("drive_torque", base=self.base)
        still = np.zeros_like(q)
        columns = []
        for joint in range(count):
            speed = np.zeros_like(q)
            speed[:, joint] = 1.0
            columns.append(drive(q, 2.0 * speed, still, self.parameters) - drive(q, speed, still, self.parameters))
        slope = np.stack([column.reshape(rows, count) for column in columns], axis=-1)
        values, vectors = np.linalg.eigh(0.5 * (slope + np.swapaxes(slope, -1, -2)))
        friction = (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, -1, -2)
        return self.nominal("total_inertia_matrix", q), friction

    def generate(self, language: str, directory: str | Path, *, fixed: bool = False) -> tuple[Path, ...]:
        """Write the functions as source; see :meth:`steelyard.Model.generate`.

        Where they are fixed, the parameters are written as numbers, instead of being an argument.
        """
        parameters = self.parameters if fixed else None
        return self.model.generate(
            language, self.functions, directory=directory, base=self.base, sign=self._sign, parameters=parameters
        )

    def _prepared(self, name: str, shape: tuple[int, ...]) -> Callable[..., Array]:
        """Return a call with memory for batches of one shape, which holds the constant arguments already."""
        kernel = self._kernels[name]
        count = int(np.prod(shape, dtype=np.int64))
        places: list[Array] = []
        arguments: list[Array] = []
        for argument in kernel.arguments:
            if argument.name in self._given:
                arguments.append(self._given[argument.name].copy())
            else:
                arguments.append(np.empty((count, argument.width)))
                places.append(arguments[-1].reshape((*shape, argument.width)))
        out = np.empty((count, kernel.width))
        result = out.reshape((*shape, kernel.width))
        if count == 0:
            return lambda *motion: result.copy()
        compute = kernel.bound(*arguments, out)

        def call(*motion: Array) -> Array:
            for place, array in zip(places, motion, strict=True):
                place[...] = array
            compute()
            return result.copy()

        return call
