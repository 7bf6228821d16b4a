"""Vector-Jacobian products of model functions: gradients of weighted sums of outputs by q, dq and ddq.

A function of the model is a graph. The weighted sum of its outputs is a graph with the weights as inputs, and its
gradient, by reverse accumulation, costs a few times the function itself, whatever the number of outputs (Griewank and
Walther 2008, section 3.2).
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.graph import Argument, Function, Kernel, Output, gradient

__all__ = ["CompiledVjp", "RegressorInformation", "vjp_function"]

Array = NDArray[np.float64]
_MOTION = ("q", "dq", "ddq")


def vjp_function(function: Function, elements: NDArray[np.intp]) -> Function:
    """Return the function that computes the gradients of a weighted sum of outputs.

    Parameters
    ----------
    function : Function
        A function of q, dq, ddq and possibly other arguments.
    elements : ndarray of int
        Flat indices of the outputs in the weighted sum.

    Returns
    -------
    Function
        It has the further argument ``weights`` and the outputs ``by_q``, ``by_dq``, ``by_ddq``, (N,) each.
    """
    nodes = function.nodes
    graph = nodes[0].graph
    total = graph.zero
    for weight, k in zip(graph.inputs("weights", len(elements)), elements, strict=True):
        total = total + weight * nodes[int(k)]
    width = next(a.width for a in function.arguments if a.name == "q")
    inputs = [node for name in _MOTION for node in graph.inputs(name, width)]
    slopes = gradient(total, inputs)
    outputs = tuple(
        Output(f"by_{name}", (width,), tuple(slopes[k * width : (k + 1) * width])) for k, name in enumerate(_MOTION)
    )
    arguments = (*function.arguments, Argument("weights", len(elements)))
    return Function(f"{function.name}_vjp", arguments, outputs)


class CompiledVjp:
    """A function of the model and its vector-Jacobian product, both compiled.

    Parameters
    ----------
    uniform : mapping
        The values of each argument besides q, dq and ddq.
    sparse : bool
        Whether outputs that are always 0 are left out.

    Attributes
    ----------
    places : ndarray of int
        Flat indices of the outputs that are computed, in their order.
    """

    def __init__(self, function: Function, uniform: Mapping[str, Array], *, sparse: bool = False) -> None:
        self._forward = Kernel(function, compact=sparse)
        self.places: NDArray[np.intp] = self._forward.places
        self._reverse = Kernel(vjp_function(function, self.places))
        self._uniform = uniform
        self._names = tuple(a.name for a in function.arguments)

    def _arguments(self, motion: tuple[Array, Array, Array]) -> list[Array]:
        known = dict(zip(_MOTION, motion, strict=True)) | dict(self._uniform)
        return [known[name] for name in self._names]

    def __call__(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the outputs, (S, n)."""
        return self._forward(*self._arguments((q, dq, ddq)))

    def vjp(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) by q, dq and ddq of ``sum(weights * outputs)``, weights (S, n)."""
        flat = self._reverse(*self._arguments((q, dq, ddq)), np.ascontiguousarray(weights))
        first, second, third = np.split(flat, 3, axis=1)
        return first, second, third


class RegressorInformation:
    """The information matrix ``W'W`` of the base regressor of some samples, and its gradient by the motion.

    Parameters
    ----------
    sign_width : float
        Velocity at which the smooth sign of Coulomb friction is 0.707, rad/s or m/s.
    joint_weights : ndarray
        (N,) factors by which the rows of each joint are multiplied.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")]).with_terms(sy.Coulomb()))
    >>> regressor = RegressorInformation(model, 0.01, np.ones(2))
    >>> regressor.information(*np.random.default_rng(1).normal(size=(3, 20, 2)))[0].shape
    (6, 6)
    """

    def __init__(self, model: Model, sign_width: float, joint_weights: Array) -> None:
        function = model.function("regressor", base=True, sign="smooth")
        uniform = {"sign_width": np.array([sign_width])}
        self._regressor = CompiledVjp(
            function, {a.name: uniform[a.name] for a in function.arguments if a.uniform}, sparse=True
        )
        self._count = model.base_parameters().count
        joints, columns = np.divmod(self._regressor.places, self._count)
        self._joints = [(np.flatnonzero(joints == k), columns[joints == k]) for k in range(model.dof)]
        self._squares = np.asarray(joint_weights, dtype=np.float64) ** 2

    def weighted(self, joint_weights: Array) -> RegressorInformation:
        """Return the same with other weights (N,) of the joints, without compiling anew."""
        found = copy.copy(self)
        found._squares = np.asarray(joint_weights, dtype=np.float64) ** 2
        return found

    def information(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, list[Array]]:
        """Return the mean of the information of the samples, (n_b, n_b), and the parts that `vjp` needs."""
        values = self._regressor(q, dq, ddq)
        total = np.zeros((self._count, self._count))
        parts = []
        for (places, columns), weight in zip(self._joints, self._squares, strict=True):
            rows = values[:, places[0] : places[-1] + 1] if len(places) else values[:, :0]
            parts.append(rows)
            total[np.ix_(columns, columns)] += (weight / len(q)) * (rows.T @ rows)
        return total, parts

    def factor(self, parts: list[Array]) -> Array:
        """Return a factor (n_b, n_b) of the mean information, from the parts that `information` returned."""
        rows = [
            _spread(values, columns, self._count) * np.sqrt(weight / len(values))
            for values, (_, columns), weight in zip(parts, self._joints, self._squares, strict=True)
        ]
        return np.asarray(np.linalg.qr(np.vstack(rows), mode="r"))

    def vjp(self, q: Array, dq: Array, ddq: Array, parts: list[Array], adjoint: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(adjoint * information)`` by q, dq and ddq; adjoint symmetric."""
        weights = [
            rows @ ((2.0 * weight / len(q)) * adjoint[np.ix_(columns, columns)])
            for rows, (_, columns), weight in zip(parts, self._joints, self._squares, strict=True)
        ]
        return self._regressor.vjp(q, dq, ddq, np.hstack(weights))

    @staticmethod
    def exact(model: Model, q: Array, dq: Array, ddq: Array, joint_weights: Array) -> Array:
        """Return the sum of the information of the samples, (n_b, n_b), with the exact sign of Coulomb friction."""
        count = model.base_parameters().count
        total = np.zeros((count, count))
        for parts in _exact_rows(model, q, dq, ddq, joint_weights):
            for own, rows in parts:
                total[np.ix_(own, own)] += rows.T @ rows
        return total

    @staticmethod
    def exact_factor(model: Model, q: Array, dq: Array, ddq: Array, joint_weights: Array) -> Array:
        """Return a factor (n_b, n_b) of what `exact` returns, without the rounding errors of the squares."""
        count = model.base_parameters().count
        total = np.zeros((0, count))
        for parts in _exact_rows(model, q, dq, ddq, joint_weights):
            block = [_spread(rows, own, count) for own, rows in parts]
            total = np.asarray(np.linalg.qr(np.vstack([total, *block]), mode="r"))
        return total


def _exact_rows(
    model: Model, q: Array, dq: Array, ddq: Array, joint_weights: Array
) -> Iterator[list[tuple[NDArray[np.intp], Array]]]:
    """Yield for each block of samples the nonzero columns of each joint and its weighted rows in these columns."""
    columns = model.base_columns.joints
    splits = np.cumsum([len(c) for c in columns])[:-1]
    for start in range(0, len(q), 2048):
        part = slice(start, start + 2048)
        values = np.split(model.base_columns.kernel(q[part], dq[part], ddq[part]), splits, axis=1)
        yield [(own, weight * rows) for own, rows, weight in zip(columns, values, joint_weights, strict=True)]


def _spread(rows: Array, columns: NDArray[np.intp], count: int) -> Array:
    """Return rows with all columns, which are zero outside `columns`."""
    whole = np.zeros((len(rows), count))
    whole[:, columns] = rows
    return whole
