"""The dynamic model of a robot: compiled functions of motion and parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.codegen import generate
from steelyard.graph import Function, Kernel
from steelyard.robot import Robot, RobotFile

from .base_parameters import BaseParameters, model_base_parameters
from .catalogue import CATALOGUE
from .conditions import ModelCondition, model_conditions
from .evaluation import Evaluator
from .functions import BaseColumns, ModelFunctions
from .kinematics import joint_frames
from .layout import ParameterLayout
from .numeric import NumericFunctions
from .project import DEFAULT_FUNCTIONS, model_project
from .sampling import regressor_with_numpy
from .terms import term_from_dict
from .threads import one_thread

if TYPE_CHECKING:
    from steelyard.codegen import SymbolicFunction

__all__ = ["Model"]

Array = NDArray[np.float64]


class Model(NumericFunctions):
    """The dynamic model of a robot, linear in its parameters: ``H(q, dq, ddq) delta = tau`` (thesis eq. 2.22).

    Functions take one sample or any batch: arrays of positions, velocities and accelerations with shape (..., N).
    They are compiled for the robot at their first use.

    Parameters
    ----------
    robot : Robot
        With its terms.
    threads : int
        How many share a large batch; the result is the same.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> pendulum = sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous())
    >>> model = sy.Model(pendulum)
    >>> delta = np.zeros(model.parameter_count)
    >>> delta[model.parameter_names.index("m1")] = 2.0
    >>> bool(np.isclose(model.inverse_dynamics([0.0], [0.0], [0.0], delta)[0], 2.0 * 9.81 * 1.0))
    True
    """

    def __init__(self, robot: Robot, *, threads: int = 1) -> None:
        self.robot = robot
        self._layout = ParameterLayout(robot)
        self._functions = ModelFunctions(self._layout, self.base_parameters)
        self._call = Evaluator(self._functions, threads)

    def __repr__(self) -> str:
        return f"Model({self.robot.name}: {self.robot.dof} joints, {self.parameter_count} parameters)"

    @classmethod
    def load(cls, path: str | Path) -> Model:
        """Read a model from a ``robot.toml`` or a URDF; where no terms are stated, with friction and offset.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        Model

        Raises
        ------
        InputError
            If the file, the description or a term cannot be used.
        """
        return cls.from_file(RobotFile.load(path))

    @classmethod
    def from_file(cls, file: RobotFile) -> Model:
        """Build the model that a robot file describes."""
        terms = [term_from_dict(t, f"{file.path}: [[terms]] number {i + 1}") for i, t in enumerate(file.terms)]
        return cls(file.robot.with_terms(*terms) if terms else file.robot)

    @property
    def joint_count(self) -> int:
        """Number N of joints."""
        return self.robot.dof

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the n parameters: for each link ten, then those of the terms at its joint (thesis eq. 4.13)."""
        return self._layout.names

    @property
    def parameter_count(self) -> int:
        """Number n of parameters."""
        return len(self.parameter_names)

    # What the model is made of

    def base_parameters(self) -> BaseParameters:
        """Return the base parameters of links and terms together (thesis section 2.5.1)."""
        return self._base

    def conditions(self, consistency: str = "full") -> tuple[ModelCondition, ...]:
        """Return the matrices that must be positive semidefinite for the parameters to be physically possible.

        Parameters
        ----------
        consistency : {"full", "inertia"}
            See :class:`steelyard.FeasibleSet`.
        """
        return model_conditions(self.robot, consistency)

    def operation_count(self, function: str, *, base: bool = False) -> dict[str, int]:
        """Count the operations of one sample of a function.

        Parameters
        ----------
        function : str
            See `function`.
        base : bool
            In base parameters.

        Returns
        -------
        dict
            See :func:`steelyard.graph.operation_count`.
        """
        return self.function(function, base=base).operation_count

    def function(
        self,
        name: str,
        *,
        base: bool = False,
        gravity: str = "fixed",
        sign: str = "exact",
        parameters: ArrayLike | None = None,
    ) -> Function:
        """Return a function of the model as an expression graph, to print, differentiate or export.

        Parameters
        ----------
        name : str
            ``"inverse_dynamics"``, ``"regressor"`` and so on; `functions` names them all. Those of one link take its
            name in parentheses, ``"pose(link7)"``, and mean the last link without it; ``"drive_torque(viscous)"`` is
            the torque of one kind of term.
        base : bool
            In base parameters instead of standard ones.
        gravity : {"fixed", "argument"}
            The gravity of the robot, or an argument of the function.
        sign : {"exact", "smooth"}
            The sign of Coulomb friction: exact, or ``v / sqrt(v² + w²)``, for simulation and differentiation, with w
            (1,) as the argument ``sign_width`` of the functions that depend on it.
        parameters : array_like, optional
            (n,), or (n_b,) with `base`: numbers that stand in the function instead of an argument.

        Returns
        -------
        Function

        Raises
        ------
        InputError
            If there is no such function or link, or base parameters do not apply.
        """
        return self._functions.function(name, base=base, gravity=gravity, sign=sign, parameters=parameters)

    def generate(
        self,
        language: str,
        functions: Sequence[str] = DEFAULT_FUNCTIONS,
        *,
        directory: str | Path,
        base: bool = False,
        gravity: str = "fixed",
        sign: str = "exact",
        parameters: ArrayLike | None = None,
    ) -> tuple[Path, ...]:
        """Write functions of the model as source: a small project with documentation and a self-test.

        Parameters
        ----------
        language : str
            ``"c"``, ``"cpp"``, ``"python"``, ``"rust"``, ``"julia"``, ``"octave"`` (for MATLAB too), ``"casadi"`` or
            ``"jax"``.
        functions : sequence of str
            See `function`.
        directory : str or Path
            Where the files go; made where it is missing. A file that was not generated is never overwritten.
        base, gravity, sign, parameters
            See `function`; with `parameters` the source holds the numbers of one robot.

        Returns
        -------
        tuple of Path
            The files.

        Raises
        ------
        InputError
            If the language or a function is unknown, or the directory cannot be written.
        """
        project = model_project(self, functions, base=base, gravity=gravity, sign=sign, parameters=parameters)
        return generate(project, language, Path(directory))

    def symbolic(
        self,
        name: str,
        *,
        closed: bool = True,
        base: bool = False,
        gravity: str = "fixed",
        substitute: Mapping[str, float | str] | None = None,
    ) -> SymbolicFunction:
        """Return a function of the model as SymPy expressions.

        Parameters
        ----------
        name : str
            See `function`.
        closed : bool
            Single expressions; False keeps intermediate variables.
        base, gravity
            See `function`.
        substitute : mapping, optional
            Numbers or expressions for symbols by name, such as ``{"m1": 0, "lx2": "m2*c"}``.

        Returns
        -------
        SymbolicFunction

        Raises
        ------
        InputError
            If there is no such function or symbol, or a closed expression would be too long.
        MissingExtraError
            If SymPy is not installed.
        """
        from steelyard.codegen import sympy_function

        return sympy_function(
            self.function(name, base=base, gravity=gravity), closed=closed, substitute=substitute or {}
        )

    def casadi(self, name: str, *, base: bool = False, gravity: str = "fixed", sign: str = "exact") -> Any:
        """Return a function of the model as a ``casadi.Function``, which CasADi differentiates; see `function`."""
        from steelyard.codegen import casadi_function

        return casadi_function(self.function(name, base=base, gravity=gravity, sign=sign))

    def jax(self, name: str, *, base: bool = False, gravity: str = "fixed", sign: str = "exact") -> Any:
        """Return a function of the model for JAX, to compile, map and differentiate; see `function`."""
        from steelyard.codegen import jax_function

        return jax_function(self.function(name, base=base, gravity=gravity, sign=sign))

    @property
    def functions(self) -> tuple[str, ...]:
        """Names of all the functions of a model."""
        return tuple(CATALOGUE)

    def kernel(self, function: str, *, base: bool = False, gravity: str = "fixed", sign: str = "exact") -> Kernel:
        """Return a compiled function, for arrays that are laid out already; see `function` for the arguments."""
        return self._functions.kernel(function, base=base, gravity=gravity, sign=sign)

    @cached_property
    def base_columns(self) -> BaseColumns:
        """The kernel of the base regressor, which the regression reads joint by joint."""
        return self._functions.base_columns()

    @cached_property
    def _base(self) -> BaseParameters:
        joint_frames(self.robot, [0.0] * self.joint_count, np)  # refuses lengths without a value
        with one_thread():
            return model_base_parameters(self._layout, _sampled_regressor)

    @property
    def link_columns(self) -> tuple[NDArray[np.intp], ...]:
        """For each link the indices of its ten parameters ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m``."""
        return self._layout.links


def _sampled_regressor(layout: ParameterLayout) -> Array:
    """The regressor at random motions, stacked, with three rows for each parameter and some more."""
    joints, parameters = layout.robot.dof, len(layout.names)
    count = max(20, -(-(3 * parameters + 50) // joints))
    generator = np.random.default_rng(20140101)
    q = generator.uniform(-np.pi, np.pi, (count, joints))
    dq = generator.uniform(-3.0, 3.0, q.shape)
    ddq = generator.uniform(-9.0, 9.0, q.shape)
    return regressor_with_numpy(layout, q, dq, ddq).reshape(-1, parameters)
