"""The compiled functions of a simulation: accelerations, whole integration steps, energies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any
from weakref import WeakKeyDictionary, ref

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.algorithms.forward_dynamics import solve_inertia
from steelyard.dynamics.catalogue import forward_dynamics_function
from steelyard.graph import (
    Argument,
    Function,
    Graph,
    Kernel,
    Node,
    Output,
    cos,
    evaluate_over,
    exp,
    gradient,
    jacobian,
    log,
    sign,
    sin,
    sqrt,
)
from steelyard.graph.kernel import source_digest

__all__ = ["DAMPING", "MotionFunctions", "motion_functions", "rosenbrock", "runge_kutta_4"]

# Coefficient of the velocity in `rosenbrock`: the larger root of g² - 2 g + 1/2, which makes the method L-stable. The
# smaller root would do so as well, but with it a step overshoots the point where a joint sticks, and Coulomb friction
# chatters.
DAMPING = 1.0 + np.sqrt(0.5)
# Coefficient of the position: the smaller root. For an undamped oscillator the map of a step then has determinant one,
# so that energy neither grows nor decays.
POSITION = 1.0 - np.sqrt(0.5)

Acceleration = Callable[[float, Any, Any], Any]


def runge_kutta_4(acceleration: Acceleration, q: Any, dq: Any, step: Any) -> tuple[Any, Any]:
    """Make a step of the classical Runge-Kutta method of order 4.

    Parameters
    ----------
    acceleration : callable
        Function of the elapsed fraction of the step, q and dq that returns the acceleration.
    q, dq : array
        (..., N) at the beginning of the step.
    step : scalar
        Length of the step, s.

    Returns
    -------
    q, dq : array
        At the end of the step.

    Examples
    --------
    >>> q, dq = runge_kutta_4(lambda fraction, q, dq: -q, np.array([1.0]), np.array([0.0]), 0.1)
    >>> float(abs(q[0] - np.cos(0.1))) < 1e-7
    True
    """
    half = step * 0.5
    a1 = acceleration(0.0, q, dq)
    v2 = dq + a1 * half
    a2 = acceleration(0.5, q + dq * half, v2)
    v3 = dq + a2 * half
    a3 = acceleration(0.5, q + v2 * half, v3)
    v4 = dq + a3 * step
    a4 = acceleration(1.0, q + v3 * step, v4)
    sixth = step * (1.0 / 6.0)
    return q + (dq + (v2 + v3) * 2.0 + v4) * sixth, dq + (a1 + (a2 + a3) * 2.0 + a4) * sixth


def rosenbrock(
    damped: Callable[[Any, Any, Any], tuple[Any, Callable[[Any], Any]]],
    acceleration: Acceleration,
    q: Any,
    dq: Any,
    step: Any,
) -> tuple[Any, Any]:
    """Make a step of the Rosenbrock-W method ROS2 of order 2 (Verwer et al. 1999, SIAM J. Sci. Comput. 20(4)).

    A W-method keeps its order with any approximation of the Jacobian. Here the approximation contains only the damping
    D of friction, ``dv/dt = -M⁻¹ D v``. For the smooth sign the damping is its slope ``w² / (v² + w²)^(3/2)``. Where an
    explicit step would reverse a velocity, the secant ``1 / sqrt(v² + w²)`` is used instead: the slope at the velocity
    of a moving joint does not show the friction near rest, while the secant brings the joint to rest within a few
    steps, however large they are.

    Parameters
    ----------
    damped : callable
        Function of q, dq and the factor ``g step`` that returns the acceleration with the inertia ``M + g step D``, and
        the function ``x -> (M + g step D)⁻¹ M x`` with the same M and D.
    acceleration : callable
        Function of the elapsed fraction of the step, q and dq that returns the acceleration.
    q, dq : array
        (..., N) at the beginning of the step.
    step : scalar
        Length of the step, s.

    Returns
    -------
    q, dq : array
        At the end of the step.

    Examples
    --------
    >>> damped = lambda q, dq, factor: (-1e6 * dq / (1 + 1e6 * factor), lambda x: x / (1 + 1e6 * factor))
    >>> q, dq = rosenbrock(damped, lambda fraction, q, dq: -1e6 * dq, np.zeros(1), np.ones(1), 1e-3)
    >>> float(abs(dq[0])) < 0.01
    True
    """
    position = step * POSITION
    a1, filtered = damped(q, dq, step * DAMPING)
    v1 = dq + a1 * position
    v2 = dq + a1 * step
    a2 = filtered(acceleration(1.0, q + v1 * step, v2) - a1 * 2.0)
    half = step * 0.5
    return q + (v1 + v2 + a2 * position) * half, dq + (a1 * 3.0 + a2) * half


# A whole step is compiled as one function up to this number of operations. Compiling takes about 0.1 s for 1000 of them
# (a Runge-Kutta step of the WAM has 5900), so that larger steps are made of compiled accelerations instead.
LARGEST_STEP = 25_000
Nodes = NDArray[Any]


class MotionFunctions:
    """The compiled functions of states ``[q dq]``, torques and parameters that a simulation calls.

    Each function reads ``state`` (2 N), ``torque`` (N), ``parameters``, ``sign_width`` (1) and ``step`` (1), in this
    order, and is compiled when it is first used.

    Parameters
    ----------
    base : bool
        Whether the parameters are base parameters.
    smooth : bool
        Whether Coulomb friction has the smooth sign.
    each : bool
        Whether every run has its own parameters.
    """

    def __init__(self, model: Model, base: bool, smooth: bool, each: bool) -> None:
        self._model = ref(model)  # a strong reference would keep the model, and with it these functions, alive
        self.base, self.smooth, self.each = base, smooth, each
        self.count = model.dof
        self.parameter_count = model.base_parameters().count if base else model.parameter_count
        self._dynamics = forward_dynamics_function(model.robot, "automatic")
        self._kernels: dict[str, Kernel] = {}

    @property
    def model(self) -> Model:
        """The model."""
        model = self._model()
        assert model is not None
        return model

    def kernel(self, name: str) -> Kernel:
        """Return ``"acceleration"``, ``"damped"``, ``"runge_kutta_4"``, ``"rosenbrock"`` or ``"energy"``, compiled."""
        if name not in self._kernels:
            self._kernels[name] = Kernel(lambda: self._function(name), identity=self._identity(name))
        return self._kernels[name]

    def derivatives(self) -> Kernel:
        """Return the derivatives of inverse dynamics, with the same sign function."""
        sign = "smooth" if self.smooth else "exact"
        return self.model.kernel("inverse_dynamics_derivatives", base=self.base, sign=sign)

    def fits_one_piece(self, name: str) -> bool:
        """Return whether a whole step of a method is small enough to be compiled as one function."""
        count = self._part(self._dynamics).operation_count
        return sum(count.values()) * {"runge_kutta_4": 4, "rosenbrock": 3}[name] <= LARGEST_STEP

    def _part(self, name: str) -> Function:
        return self.model.function(name, base=self.base, sign="smooth" if self.smooth else "exact")

    def _identity(self, name: str) -> str | None:
        known = self.model.kernel(self._dynamics, base=self.base, sign="smooth" if self.smooth else "exact").identity
        sources = source_digest(__file__)
        return None if known is None or sources is None else f"{name} {self.each} {sources} {known}"

    def _function(self, name: str) -> Function:
        """Compose a function from functions of the model."""
        recorder, count = Graph(), self.count
        arguments = (
            Argument("state", 2 * count),
            Argument("torque", count),
            Argument("parameters", self.parameter_count, not self.each),
            Argument("sign_width", 1, True),
            Argument("step", 1, True),
        )
        given = {a.name: recorder.inputs(a.name, a.width) for a in arguments}
        outputs = getattr(self, f"_{name}")(_Composer(self, recorder, given), given["step"][0])
        named = tuple(
            Output(label, np.shape(value), tuple(recorder.node(x) for x in np.ravel(value)))
            for label, value in outputs.items()
        )
        return Function(name, arguments, named, f"{name} of a simulation")

    @staticmethod
    def _acceleration(scene: _Composer, step: Node) -> dict[str, Nodes]:
        return {"acceleration": scene.acceleration(0.0, scene.q, scene.dq)}

    @staticmethod
    def _damped(scene: _Composer, step: Node) -> dict[str, Nodes]:
        acceleration, filtered = scene.damped(scene.q, scene.dq, step * DAMPING)
        columns = [filtered(column) for column in np.eye(len(scene.q))]
        return {"acceleration": acceleration, "filter": np.stack(columns, axis=1)}

    @staticmethod
    def _runge_kutta_4(scene: _Composer, step: Node) -> dict[str, Nodes]:
        return {"next": np.concatenate(runge_kutta_4(scene.acceleration, scene.q, scene.dq, step))}

    @staticmethod
    def _rosenbrock(scene: _Composer, step: Node) -> dict[str, Nodes]:
        return {"next": np.concatenate(rosenbrock(scene.damped, scene.acceleration, scene.q, scene.dq, step))}

    @staticmethod
    def _energy(scene: _Composer, step: Node) -> dict[str, Nodes]:
        rows = scene.outputs("energy_regressor", {"q": scene.q, "dq": scene.dq}, exact=True)
        kinetic, potential = (sum((x * p for x, p in zip(row, scene.parameters, strict=True)), 0.0) for row in rows)
        torques = [t - s for t, s in zip(scene.friction(scene.q, scene.dq), scene.stored(potential), strict=True)]
        friction = sum(t * v for t, v in zip(torques, scene.dq, strict=True))
        rest = scene.friction(scene.q, np.zeros(len(scene.q)))
        return {"energy": np.array([kinetic, potential, friction, *rest], dtype=object)}


class _Composer:
    """Evaluates functions of the model at nodes of one graph."""

    def __init__(self, functions: MotionFunctions, recorder: Graph, given: Mapping[str, Sequence[Node]]) -> None:
        self._functions = functions
        self._recorder = recorder
        state = np.array(given["state"], dtype=object)
        self.q, self.dq = np.split(state, 2)
        self.torque = given["torque"]
        self.parameters = given["parameters"]
        self.width = given["sign_width"][0]

    def outputs(self, name: str, motion: Mapping[str, Any], exact: bool = False) -> tuple[list[Any], ...]:
        """Return the outputs of a model function, with the smooth or the exact sign."""
        model, base = self._functions.model, self._functions.base
        function = model.function(name, base=base) if exact else self._functions._part(name)
        elements = {**motion, "sign_width": [self.width]}
        elements["base_parameters" if base else "parameters"] = self.parameters
        used = {a.name: [self._recorder.node(x) for x in elements[a.name]] for a in function.arguments}
        return evaluate_over(function, used, _UNARY, self._recorder.node)

    def acceleration(self, fraction: float, q: Nodes, dq: Nodes) -> Nodes:
        motion = {"q": q, "dq": dq, "tau": self.torque}
        return np.array(self.outputs(self._functions._dynamics, motion)[0], dtype=object)

    def friction(self, q: Nodes, dq: Nodes) -> list[Any]:
        """Return the torques of the terms at zero acceleration."""
        still = [self._recorder.zero] * len(q)
        return self.outputs("drive_torque", {"q": q, "dq": dq, "ddq": still})[0]

    def stored(self, potential: Any) -> list[Any]:
        """Return the torques of the terms that store energy, such as springs: what they take they give back."""
        robot, zero = self._functions.model.robot, self._recorder.zero
        places = np.linspace(0.3, 0.7, robot.dof).tolist()
        energies = (e for term in robot.terms for k in range(robot.dof) for e in term.potential(k, places, np))
        if not any(np.any(np.asarray(energy) != 0.0) for energy in energies):
            return [zero] * robot.dof
        gravity = self.outputs("gravity", {"q": self.q}, exact=True)[0]
        slopes = gradient(self._recorder.node(potential), list(self.q))
        return [slope - g for slope, g in zip(slopes, gravity, strict=True)]

    def damped(self, q: Nodes, dq: Nodes, factor: Node) -> tuple[Nodes, Callable[[Any], Nodes]]:
        count = len(q)
        still = [self._recorder.zero] * count
        needed = self.outputs("inverse_dynamics", {"q": q, "dq": dq, "ddq": still})[0]
        inertia = np.array(self.outputs("total_inertia_matrix", {"q": q})[0], dtype=object).reshape(count, count)
        free = [a - b for a, b in zip(self.torque, needed, strict=True)]
        plain = np.array(solve_inertia(inertia.tolist(), free), dtype=object)
        heavy = inertia + self.damping(q, dq, dq + plain * (factor * (1.0 / DAMPING))) * factor
        rows = heavy.tolist()

        def filtered(x: Any) -> Nodes:
            right = [sum((inertia[i, j] * x[j] for j in range(count)), self._recorder.zero) for i in range(count)]
            return np.array(solve_inertia(rows, right), dtype=object)

        return np.array(solve_inertia(rows, free), dtype=object), filtered

    def damping(self, q: Nodes, dq: Nodes, ahead: Nodes) -> Nodes:
        """Return the damping matrix of the terms (N, N): derivatives by dq, with the slopes of signs by `_slope`."""
        recorder, count = Graph(), len(q)
        widths = {"q": count, "dq": count, "parameters": self._functions.parameter_count}
        inputs = {name: recorder.inputs(name, width) for name, width in widths.items()}
        inner: list[Node] = []  # what signs are taken of; those of a polygon depend on signs before them
        signs: list[Node] = []

        def taken(x: Node) -> Node:
            inner.append(x)
            signs.append(recorder.input(f"sign[{len(signs)}]"))
            return signs[-1]

        function = self._functions.model.function("drive_torque", base=self._functions.base)
        elements = {**inputs, "base_parameters": inputs["parameters"], "ddq": [recorder.zero] * count}
        used = {a.name: elements[a.name] for a in function.arguments}
        (torques,) = evaluate_over(function, used, {**_UNARY, "sign": taken}, recorder.node)
        now, then = ({"q": q, "dq": v, "parameters": self.parameters, "sign": list[Any]()} for v in (dq, ahead))
        slopes = []
        for x in inner:
            here, there = self._substituted([x], now)[0], self._substituted([x], then)[0]
            slopes.append(self._slope(here, there))
            for values, at in ((now, here), (then, there)):
                values["sign"] = [*values["sign"], at / sqrt(at * at + self.width * self.width)]
        outputs = [*(recorder.node(t) for t in torques), *inner]
        rows = jacobian(outputs, [*inputs["dq"], *signs])
        flat = self._substituted([node for row in rows for node in row], now)
        partial: Nodes = np.array(flat, dtype=object).reshape(len(outputs), count + len(signs))
        # The chain rule, one sign after the other.
        total = partial[:, :count]
        for place, slope in enumerate(slopes):
            total = total + partial[:, count + place, None] * (total[count + place] * slope)
        return np.asarray(total[:count])

    def _slope(self, now: Node, ahead: Node) -> Node:
        """Return the slope of the smooth sign at a velocity, or its secant where an explicit step would reverse it."""
        square = now * now + self.width * self.width
        secant = 1.0 / sqrt(square)
        slope = secant * (self.width * self.width / square)
        reverses = 0.5 * (1.0 - sign(now) * sign(ahead))
        return slope + reverses * (secant - slope)

    def _substituted(self, nodes: Sequence[Node], values: Mapping[str, Any]) -> list[Any]:
        """Return nodes of another graph with values of this graph put in for their inputs."""
        arguments = tuple(Argument(name, len(value)) for name, value in values.items() if len(value))
        function = Function("part", arguments, (Output("part", (len(nodes),), tuple(nodes)),))
        elements = {name: [self._recorder.node(x) for x in value] for name, value in values.items()}
        return evaluate_over(function, elements, _UNARY, self._recorder.node)[0]


_UNARY: Mapping[str, Callable[[Any], Any]] = {
    "sin": sin,
    "cos": cos,
    "sign": sign,
    "sqrt": sqrt,
    "exp": exp,
    "log": log,
}
_KNOWN: WeakKeyDictionary[Model, dict[tuple[bool, bool, bool], MotionFunctions]] = WeakKeyDictionary()


def motion_functions(model: Model, *, base: bool, smooth: bool, each: bool) -> MotionFunctions:
    """Return the functions of a model, which are kept as long as the model exists.

    The flags are those of :class:`MotionFunctions`.
    """
    known = _KNOWN.setdefault(model, {})
    key = (base, smooth, each)
    if key not in known:
        known[key] = MotionFunctions(model, base, smooth, each)
    return known[key]
