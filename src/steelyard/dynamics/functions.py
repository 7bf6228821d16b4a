"""The functions of a model: recorded as expression graphs, compiled at their first use, and called with arrays."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard import graph
from steelyard.errors import InputError
from steelyard.files import shown, suggestion
from steelyard.files.arguments import real_array
from steelyard.graph import Argument, Function, Graph, Kernel, Node, Output, operation_count
from steelyard.graph.expression import reachable
from steelyard.once import cached_property
from steelyard.robot.robot import PRESLIDING

from .base_parameters import BaseParameters
from .catalogue import CATALOGUE, Entry, Scene, forward_dynamics_function
from .layout import ParameterLayout
from .terms import is_known_term

__all__ = [
    "DEFAULT_FUNCTIONS",
    "BaseColumns",
    "Call",
    "Evaluator",
    "ModelFunctions",
    "SmoothSign",
    "given_parameters",
    "parameter_values",
]

DEFAULT_FUNCTIONS = ("inverse_dynamics", "forward_dynamics", "inertia_matrix", "coriolis", "gravity", "regressor")
"""The functions of which source is generated where none are named; ``presliding_step`` as well where friction has a
state."""


class SmoothSign:
    """The functions of an algebra of graph nodes, with ``x / sqrt(x² + w²)`` for the sign of x.

    At x = w the value is 0.707, at 10 w it is 0.995; the slope at zero is 1 / w. Thesis section 5.1.2 asks for a tight
    sigmoid; this one needs no exponential, and friction stays passive, because x times it is never negative. The width
    w is positive; rad/s or m/s, of the joint or of the motor.

    Examples
    --------
    >>> from steelyard.graph import Graph, evaluate
    >>> v, w = Graph().inputs("x", 2)
    >>> [float(s) for s in evaluate([SmoothSign(w).sign(v)], {"x[0]": 3.0, "x[1]": 4.0})]
    [0.6]
    """

    def __init__(self, width: graph.Node) -> None:
        self._square = width * width

    sin, cos = staticmethod(graph.sin), staticmethod(graph.cos)
    exp, log, sqrt = staticmethod(graph.exp), staticmethod(graph.log), staticmethod(graph.sqrt)

    def sign(self, x: Any) -> Any:
        """Return the smooth sign."""
        return x / graph.sqrt(x * x + self._square)


# The functions of a model: recorded as expression graphs, and compiled when they are first used.

GRAVITIES = ("fixed", "argument")
SIGNS = ("exact", "smooth")
RESIDUE_VELOCITY, RESIDUE_ACCELERATION = 1e-9, 1e-6
"""rad/s and rad/s² (m/s, m/s²): less is what rounding leaves of a joint at rest once its positions were filtered and
differentiated (5e-12 and 7e-10 at 1 kHz, a hundred times that at 10 kHz), and no motion that a torque shows. Its sign
would pass for Coulomb friction, and columns of such numbers would be taken for information, however small, since
columns are compared in units of their own lengths."""
_LARGEST_DENSE = 20_000
"""Elements of a regressor beyond which its kernel leaves the zeros out, which are then added by NumPy. Measured,
microseconds a sample with the zeros in the kernel and without: 0.8 and 3.4 for a chain of 12 joints (1728 elements),
4.0 and 21 for 24 joints (6912), 24 and 22 for a tree of 35 (14700), 46 and 37 for a tree of 72 (62208)."""


@dataclass(frozen=True)
class BaseColumns:
    """The base regressor without its structural zeros: one kernel, and what its outputs are.

    Attributes
    ----------
    kernel : Kernel
        Reads q, dq, ddq (S, N) each; writes the entries of each sample side by side.
    joints : tuple of ndarray
        For each joint, the base parameters on which its torque depends; the kernel's outputs follow in this order.
    uneven_kernel : Kernel
        Computes those outputs alone that may jump or bend while the motion is smooth, see `uneven`.
    """

    kernel: Kernel
    joints: tuple[NDArray[np.intp], ...]
    uneven_kernel: Kernel

    @cached_property
    def uneven(self) -> NDArray[np.intp]:
        """Which entries are more than polynomials, sines and cosines of the motion, such as those of friction, (U,)."""
        return np.searchsorted(self.kernel.places, self.uneven_kernel.places)

    def entries(
        self,
        q: NDArray[np.float64],
        dq: NDArray[np.float64],
        ddq: NDArray[np.float64],
        channels: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return what the kernel writes, (S, C); what rounding leaves of a joint at rest counts as no motion.

        `channels` (S, K N) are those of `Model.channel_values`, where the robot has terms that need them.
        """
        return self.of_motion(q, *self.moving(dq, ddq), channels)

    def moving(
        self, dq: NDArray[np.float64], ddq: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return velocities and accelerations without what rounding leaves of a joint at rest."""
        still, even = np.abs(dq) < RESIDUE_VELOCITY, np.abs(ddq) < RESIDUE_ACCELERATION
        return np.where(still, 0.0, dq) if still.any() else dq, np.where(even, 0.0, ddq) if even.any() else ddq

    def of_motion(
        self,
        q: NDArray[np.float64],
        dq: NDArray[np.float64],
        ddq: NDArray[np.float64],
        channels: NDArray[np.float64] | None = None,
        out: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return what the kernel writes, for a motion that `moving` returned."""
        if channels is not None:
            return self.kernel(q, dq, ddq, channels, out=out)
        if len(self.kernel.arguments) > 3:
            raise InputError(
                "The terms of this robot need channels beside the motion, such as a temperature or the state of "
                "friction with presliding, which were not given; hold them at one value (`held` in [[terms]]; "
                "`sliding = true` for presliding), or leave these terms out."
            )
        return self.kernel(q, dq, ddq, out=out)

    def by_joint(self, entries: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Split them into the columns of each joint."""
        return np.split(entries, np.cumsum([len(own) for own in self.joints])[:-1], axis=1)


class ModelFunctions:
    """The functions of one model by name.

    Parameters
    ----------
    layout : ParameterLayout
    base : callable
        Returns the base parameters, when they are needed.
    """

    def __init__(self, layout: ParameterLayout, base: Callable[[], BaseParameters]) -> None:
        self.layout = layout
        self.robot = layout.robot
        self.base_parameters = base
        self._kernels: dict[tuple[str, bool, str, str], Kernel] = {}
        self._functions: dict[tuple[str, bool, str, str], Function] = {}

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_kernels": {}, "_functions": {}}

    def kernel(self, name: str, *, base: bool = False, gravity: str = "fixed", sign: str = "exact") -> Kernel:
        """Return a compiled function, see :meth:`function`."""
        key = (name, base, gravity, sign)
        if key not in self._kernels:
            entry, _ = self._entry(name, base, gravity, sign)
            self._refuse_lengths()
            elements = self.robot.dof * len(self.layout.names)
            self._kernels[key] = Kernel(
                lambda: self.function(name, base=base, gravity=gravity, sign=sign),
                identity=self._identity(name, base, gravity, sign),
                compact=entry.by_parameter and elements > _LARGEST_DENSE,
            )
        return self._kernels[key]

    def base_columns(self) -> BaseColumns:
        """Compile the columns of the independent parameters."""
        self._refuse_lengths()
        kernel = Kernel(
            lambda: self.function("regressor", base=True),
            identity=self._identity("regressor", True, "fixed", "exact"),
            compact=True,
        )
        identity = self._identity("regressor", True, "fixed", "exact")
        uneven = Kernel(
            lambda: _uneven_part(self.function("regressor", base=True)),
            identity=None if identity is None else f"uneven {identity}",
            compact=True,
        )
        rows, columns = np.divmod(kernel.places, self.base_parameters().count)
        return BaseColumns(kernel, tuple(columns[rows == joint] for joint in range(self.robot.dof)), uneven)

    def function(
        self,
        name: str,
        *,
        base: bool = False,
        gravity: str = "fixed",
        sign: str = "exact",
        parameters: ArrayLike | None = None,
    ) -> Function:
        """Return a function of the catalogue as an expression graph.

        Parameters
        ----------
        name : str
            As in the catalogue; those of one link or term take its name in parentheses, ``"pose(link7)"`` or
            ``"drive_torque(viscous)"``.
        base : bool
            In base parameters instead of standard ones.
        gravity : {"fixed", "argument"}
            Gravity of the robot, or an argument of the functions that depend on it.
        sign : {"exact", "smooth"}
            The sign of Coulomb friction, see :class:`SmoothSign`; its width is then an argument.
        parameters : array_like, optional
            (n,), or (n_b,) with `base`: numbers in the place of the argument.

        Raises
        ------
        InputError
            If there is no such function or link, or base parameters do not apply.
        """
        if parameters is not None:
            return self._built(name, base, gravity, sign, self._numbers(parameters, base))
        key = (name, base, gravity, sign)
        if key not in self._functions:
            self._functions[key] = self._built(name, base, gravity, sign, None)
        return self._functions[key]

    def _entry(self, name: str, base: bool, gravity: str, sign: str) -> tuple[Entry, dict[str, Any]]:
        """Return an entry of the catalogue, and the fields of the scene for the link or term in parentheses."""
        match = re.fullmatch(r"([^()]*)(?:\((.*)\))?", name, flags=re.DOTALL)
        kind, subject = (match[1], match[2]) if match else (name, None)
        if kind not in CATALOGUE:
            raise InputError(f"There is no function {name!r}; {suggestion(kind, CATALOGUE)}")
        entry = CATALOGUE[kind]
        if entry.remembers and PRESLIDING not in self.robot.channels:
            raise InputError(
                f"{self.robot.name} has no friction with a state, which {kind!r} would step; terms of the kinds "
                "'dahl' and 'lugre' have one."
            )
        if subject is not None and not entry.subject:
            raise InputError(f"The function {kind!r} is about the whole robot; leave out ({subject}).")
        if kind == "forward_dynamics_articulated":
            forward_dynamics_function(self.robot, "articulated_body")
        if gravity not in GRAVITIES:
            raise InputError(f"gravity must be 'fixed' or 'argument', got {gravity!r}.")
        if sign not in SIGNS:
            raise InputError(f"sign must be 'exact' or 'smooth', got {sign!r}.")
        if base and gravity == "argument":
            raise InputError(
                "Base parameters hold for the robot's own gravity; with gravity as an argument use standard parameters."
            )
        if subject is None:
            return entry, {}
        if entry.subject == "term":
            kinds = [term.kind for term in self.robot.terms]
            if subject not in kinds:
                raise InputError(f"{self.robot.name} has no term {subject!r}; it has {', '.join(kinds) or 'none'}.")
            return entry, {"term": subject}
        link, placement = self.robot.frame(subject)
        if link < 0:
            raise InputError(f"The link {subject!r} of {self.robot.name} does not move; name one that a joint moves.")
        if subject in self.robot.link_names:
            return entry, {"link": link}
        return entry, {"link": link, "placement": [[float(x) for x in row] for row in placement]}

    def _numbers(self, parameters: ArrayLike, base: bool) -> list[float]:
        names = self.base_parameters().expressions if base else self.layout.names
        values = parameter_values(parameters, names, self.robot.name, base=base)
        size = len(names)
        if values.shape != (size,) or not np.isfinite(values).all():
            kind = "base parameters" if base else "parameters"
            raise InputError(
                f"{self.robot.name} has {size} {kind}: expected so many finite numbers, got shape {values.shape}"
                f"{'' if np.isfinite(values).all() else ' with some that are not finite'}."
            )
        return [float(value) for value in values]

    def _refuse_lengths(self) -> None:
        if self.robot.lengths:
            names = ", ".join(self.robot.lengths)
            raise InputError(
                f"{self.robot.name} has lengths without a value: {names}; give them with robot.with_lengths "
                "or as lengths in [description] of robot.toml, or generate code, where they are arguments."
            )

    def _arguments(self, entry: Entry, base: bool, gravity: str, sign: str) -> list[Argument]:
        robot = self.robot
        names = [n for n in entry.arguments if not (base and n == "parameters")]
        result = [self._motion_argument(name) for name in names if name in _MOTION_UNITS]
        if robot.channels and entry.drives:
            result.append(self._channel_argument())
        if "presliding_before" in entry.arguments:
            joints = [robot.joints[k].name for k in robot.driving_joints]
            texts = tuple(f"earlier state of presliding at joint {joint!r}" for joint in joints)
            result.append(Argument("presliding_before", robot.dof, False, "earlier states of presliding", texts))
        if "parameters" in entry.arguments:
            if base:
                expressions = self.base_parameters().expressions
                texts = tuple(f"beta{i + 1} = {text}" for i, text in enumerate(expressions))
                result.append(Argument("base_parameters", len(texts), True, "base parameters, SI units", texts))
            else:
                texts = self.layout.descriptions
                result.append(Argument("parameters", len(texts), True, "standard parameters, SI units", texts))
        if "point" in entry.arguments:
            texts = tuple(f"{axis} of the point in the link frame, m" for axis in "xyz")
            result.append(Argument("point", 3, True, "a point of the link, m", texts))
        if gravity == "argument" and entry.weighs:
            texts = tuple(f"{axis} of gravity in the base frame, m/s²" for axis in "xyz")
            result.append(Argument("gravity", 3, True, "acceleration of gravity in the base frame, m/s²", texts))
        if sign == "smooth" and entry.drives:
            text = "velocity at which the smooth sign of Coulomb friction is 0.707, rad/s or m/s"
            result.append(Argument("sign_width", 1, True, text, (text,)))
        if robot.lengths:
            texts = tuple(f"length {name}, m" for name in robot.lengths)
            result.append(Argument("lengths", len(texts), True, "lengths of the robot, m", texts))
        return result

    def _channel_argument(self) -> Argument:
        joints = [self.robot.joints[k].name for k in self.robot.driving_joints]
        texts = tuple(f"{name} at joint {joint!r}" for name in self.robot.channels for joint in joints)
        return Argument("channels", len(texts), False, f"{', '.join(self.robot.channels)} of each joint", texts)

    def _motion_argument(self, name: str) -> Argument:
        what, turning, sliding = _MOTION_UNITS[name]
        texts = []
        for k in self.robot.driving_joints:
            joint = self.robot.joints[k]
            texts.append(f"{what} of joint {joint.name!r}, {turning if joint.rotates else sliding}")
        plural = f"{what[:-1]}ies" if what.endswith("y") else f"{what}s"
        *earlier, noun = plural.split()
        return Argument(name, self.robot.dof, False, " ".join([*earlier, "joint", noun]), tuple(texts))

    def _built(self, name: str, base: bool, gravity: str, sign: str, numbers: list[float] | None) -> Function:
        entry, subject = self._entry(name, base, gravity, sign)
        recorder = Graph()
        arguments = self._arguments(entry, base, gravity, sign)
        if numbers is not None:
            arguments = [a for a in arguments if a.name not in ("parameters", "base_parameters")]
        scalars: dict[str, Any] = {a.name: recorder.inputs(a.name, a.width) for a in arguments}
        if "parameters" in entry.arguments:
            given = numbers or scalars.pop("base_parameters" if base else "parameters")
            own: list[Any] = [0.0] * len(self.layout.names)
            for k, value in zip(self.base_parameters().independent if base else range(len(own)), given, strict=True):
                own[k] = value
            scalars["parameters"] = own
        algebra: Any = SmoothSign(scalars["sign_width"][0]) if "sign_width" in scalars else graph
        scene = Scene(self.layout, algebra, scalars, **subject)
        candidates = [scene, replace(scene, regroups=False)] if "parameters" in entry.arguments else [scene]
        outputs = min((self._outputs(entry, s, recorder, base) for s in candidates), key=_operations)
        kind, *named = (re.sub(r"[^A-Za-z0-9]+", "_", part).strip("_") for part in name.split("(", 1))
        if named and not named[0]:
            named = [f"link{subject['link'] + 1}" if "link" in subject else "term"]  # no letter that all languages have
        identifier = "_".join([kind, *named])
        description = entry.description
        if entry.subject == "link":
            link = name.partition("(")[2].removesuffix(")") or self.robot.link_names[-1]
            description += f" Link: {link!r}."
        return Function(identifier, tuple(arguments), outputs, description)

    def _outputs(self, entry: Entry, scene: Scene, recorder: Graph, base: bool) -> tuple[Output, ...]:
        result = []
        width = len(self.layout.names)
        for value in entry.build(scene):
            shape, elements = value.shape, value.elements
            if base and entry.by_parameter:
                kept = self.base_parameters().independent
                shape = (*shape[:-1], len(kept))
                elements = [elements[start + k] for start in range(0, len(elements), width) for k in kept]
            nodes = tuple(recorder.node(element) for element in elements)
            description = value.description
            if entry.by_parameter:
                columns = self.base_parameters().expressions if base else self.layout.names
                description += f"; the columns belong, in order, to {', '.join(columns)}"
            result.append(Output(value.name, shape, nodes, description))
        return tuple(result)

    def _identity(self, name: str, base: bool, gravity: str, sign: str) -> str | None:
        """Return a text that determines a function; None where the robot has a term of a user."""
        robot = self.robot
        if not all(is_known_term(term) for term in robot.terms):
            return None
        joints = [
            [
                j.kind,
                j.parent,
                np.asarray(j.before).tolist(),
                np.asarray(j.after).tolist(),
                j.coordinate,
                j.multiplier,
                j.offset,
            ]
            for j in robot.joints
        ]
        content = {
            "function": name,
            "links": list(robot.link_names) if "(" in name else len(robot.links),
            "frame": self._entry(name, base, gravity, sign)[1],
            "sign": sign,
            "gravity": [gravity, np.asarray(robot.gravity).tolist()],
            "terms": [term.identity for term in robot.terms],
            "joints": joints,
            "base": self.base_parameters().independent.tolist() if base else None,
        }
        return json.dumps(content)


_MOTION_UNITS = {
    "q": ("position", "rad", "m"),
    "dq": ("velocity", "rad/s", "m/s"),
    "ddq": ("acceleration", "rad/s²", "m/s²"),
    "tau": ("torque", "N·m", "N"),
    "q_before": ("earlier position", "rad", "m"),
    "dq_before": ("earlier velocity", "rad/s", "m/s"),
}


def _uneven_part(function: Function) -> Function:
    """Return a function with zeros for all elements that are polynomials, sines and cosines of the motion."""
    uneven: set[int] = set()
    for node in reachable(function.nodes):  # arguments first
        if node.operation == "input":
            own = str(node.value).partition("[")[0] not in _MOTION_UNITS
        elif node.operation == "div":
            own = node.arguments[1].operation != "constant"
        else:
            own = node.operation not in ("constant", "add", "sub", "mul", "neg", "sin", "cos")
        if own or any(argument.index in uneven for argument in node.arguments):
            uneven.add(node.index)
    outputs = [
        replace(output, nodes=tuple(n if n.index in uneven else n.graph.zero for n in output.nodes))
        for output in function.outputs
    ]
    return replace(function, name=f"uneven_{function.name}", outputs=tuple(outputs))


def _operations(outputs: tuple[Output, ...]) -> int:
    nodes: list[Node] = [node for output in outputs for node in output.nodes]
    count = operation_count(nodes)
    return count["mul"] + count["add"] + count["div"]


# Calls the compiled functions of a model with whatever arrays a user has.

Array = NDArray[np.float64]


def parameter_values(parameters: ArrayLike, names: Sequence[str], robot_name: str, *, base: bool = False) -> Array:
    """Return parameters as an array; an estimate in their place must be one of the same robot and terms.

    Parameters
    ----------
    parameters : array_like
        Or an object that is converted to one and names them, such as an Estimate or an Identification.
    names : sequence of str
        Of the parameters of the model; with `base`, the expressions of its base parameters.
    robot_name : str
        For messages.
    base : bool
        Take the base parameters of an estimate.

    Raises
    ------
    InputError
        If the estimate belongs to another robot, or has base parameters alone.
    """
    own = getattr(parameters, "base_expressions" if base else "parameter_names", ())
    if own and tuple(own) != tuple(names):
        raise InputError(
            f"The estimate has the parameters of another robot or of other terms than {robot_name} has "
            f"({len(own)} of them, where the model has {len(names)}); give the model that it was identified with."
        )
    if own and base:
        return np.asarray(parameters.base, dtype=np.float64)  # type: ignore[union-attr]
    expected = f"one number for each of {len(names)} names, or an estimate"
    return real_array(parameters, f"The parameters of {robot_name}", expected)


def given_parameters(model: Any, parameters: ArrayLike, *, base: bool = False) -> Array:
    """Return parameters of a model as an array, of whatever shape; an estimate must be one of its robot and terms.

    Parameters
    ----------
    model : Model
    parameters : array_like
        As `parameter_values` takes them.
    base : bool
        Whether they are base parameters.

    Raises
    ------
    InputError
        As `parameter_values`.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> given_parameters(model, [2, 1, 0], base=True).tolist()
    [2.0, 1.0, 0.0]
    """
    names = model.base_parameters().expressions if base else model.parameter_names
    return parameter_values(parameters, names, model.robot.name, base=base)


# Calls from which on machine code looks at the arrays. It saves 4 µs a call, and takes 1 ms to bring into memory, or 20
# where it is compiled for the first time.
_CALLS = 100


class Call:
    """A compiled function, and what is looked up once instead of at every call.

    Attributes
    ----------
    shape : tuple of int
        Of what one sample gives; several outputs of one shape are stacked.
    direct : callable
        See :meth:`steelyard.graph.Kernel.direct`. It computes nothing at the first calls, where there is no such thing,
        and for batches until there were some.
    """

    def __init__(self, kernel: Kernel) -> None:
        shapes = [shape for _, shape in kernel.signature.outputs]
        self.kernel = kernel
        self.shape = shapes[0] if len(shapes) == 1 else (len(shapes), *shapes[0])
        self.direct: Callable[..., Array | None] = _nothing
        self.several = False
        self._calls = count(2), count(2)

    def method(self, otherwise: Callable[..., Any]) -> Callable[..., Any] | None:
        """Return what takes the place of a method of a model, see :meth:`steelyard.graph.Kernel.direct`."""
        return self.kernel.direct(self.shape, several=self.several, otherwise=otherwise)

    @cached_property
    def most(self) -> int:
        """Numbers in the first argument up to which `direct` computes a batch."""
        return self.kernel.most * self.kernel.arguments[0].width

    @cached_property
    def small(self) -> int:
        """Numbers in the first argument up to which `direct` makes an array for the result."""
        return self.kernel.most_small * self.kernel.arguments[0].width

    def again(self, given: tuple[Any, ...], out: Array | None) -> Array | None:
        """Compute into an array that is made for it what `direct` did not, or nothing; count such calls."""
        first = given[0]
        if type(first) is not np.ndarray:
            return None
        several = first.ndim > 1
        if several and first.size > self.most:
            return None
        if next(self._calls[several]) == _CALLS and not self.kernel.compact and not self.several:
            self.several = several
            self.direct = self.kernel.direct(self.shape, several=several) or _nothing
        if out is not None or first.size <= self.small or self.direct is _nothing:
            return None
        return self.direct(*given, self.kernel.empty(first.shape[:-1] + self.shape))


def _nothing(*_: Any) -> None:
    """Compute nothing, as a direct call does that finds something unusual."""


class Evaluator:
    """Checks shapes, flattens batches for the kernels, and shapes what they return.

    Parameters
    ----------
    threads : int
        How many share a large batch.
    called_often : callable, optional
        Given the name of a function, with the gravity of the robot, and its `Call`, where a new direct call was made.
    """

    def __init__(
        self, functions: ModelFunctions, threads: int = 1, called_often: Callable[[str, Call], None] = _nothing
    ) -> None:
        if not isinstance(threads, int) or threads < 1:
            raise InputError(f"threads must be a positive integer, got {threads!r}.")
        self._threads = threads
        self._functions = functions
        self._robot = functions.robot
        self._parameter_names = functions.layout.names
        self._called_often = called_often
        self._calls: dict[str, Call] = {}
        self._calls_with_gravity: dict[str, Call] = {}

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_calls": {}, "_calls_with_gravity": {}}

    def compute(
        self, function: str, given: tuple[Any, ...], gravity: ArrayLike | None = None, out: Array | None = None
    ) -> Array:
        """Return the outputs of a function of the catalogue, (..., *shape); several of one shape are stacked.

        Parameters
        ----------
        given : tuple of array_like
            The arguments of the function in its order: motions (..., N) each, then parameters (n,) or a point (3,).
        gravity : array_like, optional
            (3,).
        out : ndarray, optional
            What the outputs are written into.

        Raises
        ------
        InputError
            If an array has the wrong shape, or `out` cannot be written as it is.
        """
        calls = self._calls
        if gravity is not None:
            given, calls = (*given, gravity), self._calls_with_gravity
        call = calls.get(function)
        if call is None:
            kernel = self._functions.kernel(function, gravity="fixed" if gravity is None else "argument")
            call = calls[function] = Call(kernel)
        # The usual case: plain arrays that fit, which machine code finds out much sooner than Python does.
        result = call.direct(*given, out)
        if result is None:
            before = call.direct
            result = call.again(given, out)
            if call.direct is not before and gravity is None:
                self._called_often(function, call)
        return self._compute_with_care(call, given, out) if result is None else result

    def _compute_with_care(self, call: Call, given: tuple[Any, ...], out: Array | None) -> Array:
        """Compute any batch of any arrays, or say what does not fit."""
        kernel = call.kernel
        motions = sum(not argument.uniform for argument in kernel.arguments)
        arrays, lead = self._motion(given[:motions], [argument.width for argument in kernel.arguments[:motions]])
        for argument, values in zip(kernel.arguments[motions:], given[motions:], strict=True):
            if argument.name == "parameters":
                values = parameter_values(values, self._parameter_names, self._robot.name)
            arrays.append(self._vector(values, argument.width, _VECTORS[argument.name]))
        shape = (*lead, *call.shape)
        if out is not None:
            _check_out(out, shape, arrays)
        elements = kernel.signature.size
        if not kernel.compact:
            target = None if out is None else out.reshape(-1, elements)
            flat = kernel(*arrays, out=target, threads=self._threads)
            return flat.reshape(shape) if out is None else out
        flat = kernel(*arrays, threads=self._threads)
        result = kernel.empty(shape) if out is None else out
        full = result.reshape(-1, elements)
        full[...] = 0.0
        full[:, kernel.places] = flat
        return result

    def _motion(self, arrays: Sequence[ArrayLike], widths: Sequence[int]) -> tuple[list[Array], tuple[int, ...]]:
        converted = [real_array(a, f"The motion of {self._robot.name}") for a in arrays]
        for array, n in zip(converted, widths, strict=True):
            if array.ndim == 0 or array.shape[-1] != n:
                raise InputError(
                    f"{self._robot.name} has {n} joints: expected arrays of shape (..., {n}), got {array.shape}."
                )
        lead = converted[0].shape[:-1]
        pairs = list(zip(converted, widths, strict=True))
        if all(array.shape[:-1] == lead for array in converted):  # the usual case, where broadcasting would cost time
            return [np.ascontiguousarray(array).reshape(-1, n) for array, n in pairs], lead
        try:
            lead = np.broadcast_shapes(*(a.shape[:-1] for a in converted))
        except ValueError:
            raise InputError(f"Motion arrays do not fit each other: {[a.shape for a in converted]}.") from None
        return [np.ascontiguousarray(np.broadcast_to(a, (*lead, n))).reshape(-1, n) for a, n in pairs], lead

    def _vector(self, values: ArrayLike, size: int, what: str) -> Array:
        vector = real_array(values, f"The {what} of {self._robot.name}")
        if vector.shape != (size,):
            raise InputError(f"{self._robot.name} has {size} {what}: expected shape ({size},), got {vector.shape}.")
        return np.ascontiguousarray(vector)


_VECTORS = {"parameters": "parameters", "point": "coordinates of a point", "gravity": "elements of gravity"}


def _check_out(out: Any, shape: tuple[int, ...], arrays: Sequence[Array]) -> None:
    """Refuse what outputs of some shape cannot be written into while the arrays are read."""
    wanted = f"out must be a C-contiguous float64 array of shape {shape} that can be written"
    if not isinstance(out, np.ndarray):
        raise InputError(f"{wanted}, got {shown(out)}; make one with numpy.empty({shape}).")
    if out.shape != shape or out.dtype != np.float64 or not out.flags.carray:
        found = f"{out.dtype} of shape {out.shape}"
        if not out.flags.c_contiguous:
            found += ", not C-contiguous"
        elif not out.flags.writeable:
            found += ", read-only"
        elif not out.flags.aligned:
            found += ", not aligned"
        elif not out.dtype.isnative:
            found += ", in another byte order"
        raise InputError(f"{wanted}, got {found}; make one with numpy.empty({shape}).")
    if any(np.may_share_memory(out, array) for array in arrays):
        raise InputError("out shares memory with an array that is read; give one of its own.")
