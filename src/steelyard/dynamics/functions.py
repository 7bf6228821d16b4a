"""The functions of a model, recorded as expression graphs and compiled when they are first used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard import graph
from steelyard.errors import InputError
from steelyard.graph import Argument, Graph, Kernel, Node

from . import newton_euler
from .coriolis_matrix import coriolis_matrix
from .inertia_matrix import inertia_matrix
from .layout import ParameterLayout

__all__ = ["BaseColumns", "CompiledFunctions"]

_LARGEST_DENSE = 1500  # outputs beyond which a regressor is compiled without its zeros


@dataclass(frozen=True)
class BaseColumns:
    """The base regressor without its structural zeros: one kernel, and what its outputs are.

    Attributes
    ----------
    kernel : Kernel
        Reads q, dq, ddq (S, N) each; writes the entries of each sample side by side.
    joints : tuple of ndarray
        For each joint, the base parameters on which its torque depends; the kernel's outputs follow in this order.
    """

    kernel: Kernel
    joints: tuple[NDArray[np.intp], ...]


class CompiledFunctions:
    """The kernels of one model.

    Parameters
    ----------
    layout : ParameterLayout
    """

    def __init__(self, layout: ParameterLayout) -> None:
        self.layout = layout
        self.robot = layout.robot
        self._kernels: dict[str, Kernel] = {}

    def kernel(self, function: str) -> Kernel:
        """Return the compiled function; see `operation_count` for the names."""
        if function not in self._kernels:
            builders: dict[str, Callable[[], Kernel]] = {
                "inverse_dynamics": self._inverse_dynamics_kernel,
                "regressor": self._regressor_kernel,
                "inertia_matrix": self._inertia_matrix_kernel,
                "gravity": self._gravity_kernel,
                "coriolis": self._coriolis_kernel,
                "coriolis_matrix": self._coriolis_matrix_kernel,
                "drive_torque": self._drive_torque_kernel,
            }
            if function not in builders:
                raise InputError(f"There is no function {function!r}; there are {', '.join(builders)}.")
            self._kernels[function] = builders[function]()
        return self._kernels[function]

    def _groups(self, *names: str) -> list[Argument]:
        widths = {"parameters": len(self.layout.names)}
        return [Argument(n, widths.get(n, self.robot.dof), uniform=n == "parameters") for n in names]

    def _inputs(self, graph_: Graph, *names: str) -> list[list[Node]]:
        return [graph_.inputs(group.name, group.width) for group in self._groups(*names)]

    def _add_terms(
        self, torques: list[Any], q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], parameters: Sequence[Any]
    ) -> list[Any]:
        for row, column, value in self.layout.terms(q, dq, ddq, graph):
            torques[row] = torques[row] + parameters[column] * value
        return torques

    def _inverse_dynamics_kernel(self) -> Kernel:
        g = Graph()
        q, dq, ddq, p = self._inputs(g, "q", "dq", "ddq", "parameters")
        torques = newton_euler.inverse_dynamics(self.robot, q, dq, ddq, self.layout.link_parameters(p), graph)
        outputs = [g.node(t) for t in self._add_terms(torques, q, dq, ddq, p)]
        return Kernel(self._groups("q", "dq", "ddq", "parameters"), outputs)

    def _gravity_kernel(self) -> Kernel:
        g = Graph()
        q, p = self._inputs(g, "q", "parameters")
        still = [0.0] * self.robot.dof
        torques = newton_euler.inverse_dynamics(self.robot, q, still, still, self.layout.link_parameters(p), graph)
        return Kernel(self._groups("q", "parameters"), [g.node(t) for t in torques])

    def _coriolis_kernel(self) -> Kernel:
        g = Graph()
        q, dq, p = self._inputs(g, "q", "dq", "parameters")
        still, weightless = [0.0] * self.robot.dof, (0.0, 0.0, 0.0)
        links = self.layout.link_parameters(p)
        torques = newton_euler.inverse_dynamics(self.robot, q, dq, still, links, graph, weightless)
        return Kernel(self._groups("q", "dq", "parameters"), [g.node(t) for t in torques])

    def _coriolis_matrix_kernel(self) -> Kernel:
        g = Graph()
        q, dq, p = self._inputs(g, "q", "dq", "parameters")
        matrix = coriolis_matrix(self.robot, q, dq, self.layout.link_parameters(p), graph)
        return Kernel(self._groups("q", "dq", "parameters"), [g.node(value) for row in matrix for value in row])

    def _drive_torque_kernel(self) -> Kernel:
        g = Graph()
        q, dq, ddq, p = self._inputs(g, "q", "dq", "ddq", "parameters")
        torques = self._add_terms([0.0] * self.robot.dof, q, dq, ddq, p)
        return Kernel(self._groups("q", "dq", "ddq", "parameters"), [g.node(t) for t in torques])

    def _inertia_matrix_kernel(self) -> Kernel:
        g = Graph()
        q, p = self._inputs(g, "q", "parameters")
        matrix = inertia_matrix(self.robot, q, self.layout.link_parameters(p), graph)
        rows, columns = np.tril_indices(self.robot.dof)
        outputs = [g.node(matrix[i][j]) for i, j in zip(rows, columns, strict=True)]
        return Kernel(self._groups("q", "parameters"), outputs)

    @property
    def regressor_is_sparse(self) -> bool:
        """Whether the regressor's kernel leaves out its zeros, because there would be too many."""
        return self.robot.dof * len(self.layout.names) > _LARGEST_DENSE

    @cached_property
    def regressor_nodes(self) -> dict[tuple[int, int], Node]:
        """The regressor's entries that are not zero, by (row, column)."""
        g = Graph()
        q, dq, ddq = self._inputs(g, "q", "dq", "ddq")
        entries = self.layout.regressor(q, dq, ddq, graph)
        nodes = {key: g.node(value) for key, value in entries.items()}
        return {key: node for key, node in nodes.items() if node is not g.zero}

    def _regressor_kernel(self) -> Kernel:
        nodes = self.regressor_nodes
        n, count = self.robot.dof, len(self.layout.names)
        if self.regressor_is_sparse:
            return Kernel(self._groups("q", "dq", "ddq"), [nodes[key] for key in sorted(nodes)])
        zero = next(iter(nodes.values())).graph.zero
        outputs = [nodes.get((row, column), zero) for row in range(n) for column in range(count)]
        return Kernel(self._groups("q", "dq", "ddq"), outputs)

    def base_columns(self, independent: NDArray[np.intp]) -> BaseColumns:
        """Compile the columns of the independent parameters."""
        position = {int(column): k for k, column in enumerate(independent)}
        by_joint: list[list[tuple[int, Node]]] = [[] for _ in range(self.robot.dof)]
        for (row, column), node in sorted(self.regressor_nodes.items()):
            if column in position and node is not node.graph.zero:
                by_joint[row].append((position[column], node))
        outputs = [node for entries in by_joint for _, node in entries]
        columns = tuple(np.array([k for k, _ in entries], dtype=np.intp) for entries in by_joint)
        return BaseColumns(Kernel(self._groups("q", "dq", "ddq"), outputs), columns)
