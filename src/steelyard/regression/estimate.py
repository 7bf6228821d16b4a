"""An estimate: identified parameters, their standard errors, and how well they predict."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table
from steelyard.errors import InputError, faults_told
from steelyard.files import listed, plain, read_json, require_format, shown, write_json
from steelyard.robot.description import URDF, DescriptionFormat, UrdfFormat, description_format
from steelyard.robot.joint import Drives, differing_joint
from steelyard.robot.robot import Robot

from .factor import LARGEST

__all__ = ["Estimate"]

Array = NDArray[np.float64]
FORMAT = "steelyard-estimate-3"
ESTIMATE = "estimate.json"
"""The name that an estimate has in a folder of results."""

WEAK = 2.0
"""Standard errors below which a number might as well be zero. Of numbers that are not determined at all one in twenty
exceeds them, but one in three exceeds a single one, so that a robot of which nothing is seen would look half known. Of
641 numbers of eleven simulated arms 94 were between one and two: half of these are zero in truth, or of the other sign,
and of the 372 beyond two 4 %."""

_ARRAYS = (
    "base",
    "standard_error",
    "parameters",
    "weights",
    "joint_relative_error",
    "damping",
    "friction",
    "rotor_inertia",
    "offset",
    "unconstrained_base",
    "error_correlation",
)
_NAMES = ("base_names", "base_expressions", "joint_names", "parameter_names", "remarks")
_NUMBERS = {"relative_error": np.nan, "condition_number": np.inf}  # the meaning of null in a file
_LATER = ("rotor_inertia", "offset", "elastic_joints", "elastic_model")  # not in the files of the first version
_OPTIONAL = (*_ARRAYS[2:], "consistency", "certificate", "optimality_gap")


def estimate_file(given: str | Path) -> Path:
    """Return the file of an estimate that is given by itself, or as the folder of results that holds it."""
    inside = Path(given) / ESTIMATE
    return inside if inside.exists() else Path(given)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Identified parameters of a robot.

    Attributes
    ----------
    method : str
        How the parameters were found, in words.
    base_names, base_expressions : tuple of str
        The n_b base parameters.
    base : ndarray
        (n_b,), SI units.
    standard_error : ndarray
        (n_b,) of the base parameters, from `ParameterCovariance`: with the correlation of the residuals in time where
        the Information tells of it, otherwise each row an independent one (thesis eq. 4.27); where there is a
        `parameter_table`, with all errors on which its intervals rest. Infinite where the data says nothing.
    parameter_names : tuple of str
        The n standard parameters; empty where only base parameters are known.
    parameters : ndarray or None
        (n,), physically possible where `consistency` says so.
    joint_names : tuple of str
    weights : ndarray or None
        (N,) joint weights of the regression; None for all alike.
    relative_error : float
        ``|omega - W beta| / |omega|`` on the data of the regression (thesis eq. 4.37); 0.05 means 5 %.
    joint_relative_error : ndarray or None
        (N,).
    row_count : int
        Rows of the regression.
    condition_number : float
        Of the base regressor.
    consistency : str or None
        ``"full"`` or ``"inertia"``: in which sense the parameters are feasible; None where that was not asked.
    damping, friction : ndarray or None
        (N,) viscous and Coulomb friction of each joint moving alone, all terms together; NaN where not modelled.
    rotor_inertia, offset : ndarray or None
        (N,) inertia of the rotors as the joints feel it, and constant torques, likewise.
    certificate : mapping or None
        The proof of feasibility, as plain data.
    remarks : tuple of str
        What the user should know, a sentence each.
    description : mapping
        How the robot was read (``tip``, ``locked``), and the geometry of its ``joints``, for writing a URDF.
    filtered_torque : bool
        Whether torques were filtered and the dynamics were not, see `Samples`; the errors of the estimate then exceed
        its standard errors, and no interval of a base parameter holds.
    optimality_gap : float or None
        How far the squared residual of a feasible fit can be above the least possible one, as a part of it. It follows
        from a lower bound for all feasible parameters below the mass bound of the remarks, and below a thousand times
        what is typical of the robot. A gap of at most 1e-6 counts as the optimum; the remarks state a larger one. None
        for other methods, and where there is no useful bound.
    parameter_table : tuple of mapping
        What every number rests on, as plain data, see `steelyard.identification.ParameterTable`; empty where that was
        not asked. Nothing is computed from it.
    unconstrained_base : ndarray or None
        (n_b,) what plain least squares made of the same data. `standard_error` says how far the truth is from these;
        feasibility and a prior draw `base` away from them. None for plain least squares itself, or where not known.
    error_correlation : ndarray or None
        (n_b (n_b - 1) / 2,) of the errors of the base parameters with one another, the lower triangle row by row; zero
        for those of which the data says nothing. None where not known. See `covariance`.
    elastic_joints : tuple of mapping
        Stiffness, damping and second encoder of elastic joints as plain data, see
        `steelyard.estimators.JointStiffness`; empty where that was not asked.
    elastic_model : mapping
        Where a stiffness was measured: the parameters of the model with the coordinates of links and of motors (see
        `steelyard.dynamics.elastic_robot`), and the proof that they are feasible together, as plain data.

    Examples
    --------
    >>> import numpy as np
    >>> estimate = Estimate(
    ...     method="ordinary least squares", base_names=("m1",), base_expressions=("m1",), base=np.array([2.0]),
    ...     standard_error=np.array([0.1]), joint_names=("joint1",), relative_error=0.05, row_count=100,
    ...     condition_number=1.0,
    ... )
    >>> estimate.relative_standard_error.tolist()
    [0.05]
    """

    method: str
    base_names: tuple[str, ...]
    base_expressions: tuple[str, ...]
    base: Array
    standard_error: Array
    joint_names: tuple[str, ...]
    relative_error: float
    row_count: int
    condition_number: float
    joint_relative_error: Array | None = None
    weights: Array | None = None
    parameter_names: tuple[str, ...] = ()
    parameters: Array | None = None
    consistency: str | None = None
    damping: Array | None = None
    friction: Array | None = None
    certificate: Mapping[str, Any] | None = None
    remarks: tuple[str, ...] = ()
    description: Mapping[str, Any] = field(default_factory=dict)
    filtered_torque: bool = False
    optimality_gap: float | None = None
    parameter_table: tuple[Mapping[str, Any], ...] = ()
    unconstrained_base: Array | None = None
    error_correlation: Array | None = None
    rotor_inertia: Array | None = None
    offset: Array | None = None
    elastic_joints: tuple[Mapping[str, Any], ...] = ()
    elastic_model: Mapping[str, Any] = field(default_factory=dict)

    @property
    def covariance(self) -> Array:
        """(n_b, n_b) of the errors of the base parameters; zero where the data says nothing.

        Examples
        --------
        >>> from steelyard.regression import Information, least_squares
        >>> info = Information.from_factor([[2.0, 1.0], [0.0, 1.0]], [4.0, 3.0], 0.5, 100, ["a", "b"])
        >>> estimate = least_squares(info)
        >>> R = info.reduced(None).R
        >>> bool(np.allclose(estimate.covariance, 0.5 / 98 * np.linalg.inv(R.T @ R)))  # 0.5 / 98: of the residuals
        True
        """
        known = np.where(np.isfinite(self.standard_error), self.standard_error, 0.0)
        matrix = np.eye(len(known))
        if self.error_correlation is not None:
            rows, columns = np.tril_indices(len(known), -1)
            matrix[rows, columns] = matrix[columns, rows] = self.error_correlation
        return np.asarray(known[:, None] * matrix * known)

    def confidence_interval(self, level: float = 0.95) -> Array:
        """Return an interval for each base parameter, (n_b, 2), that covers it with a probability of `level`.

        It follows from `standard_error` for a normal distribution, and is infinite where torques were filtered. Errors
        of the model and of the processing are not included.

        Raises
        ------
        InputError
            Unless the level lies between 0 and 1.
        """
        from scipy.special import ndtri

        if not 0.0 < level < 1.0:
            raise InputError(f"level must lie between 0 and 1, such as 0.95, got {level!r}.")
        error = np.full_like(self.standard_error, np.inf) if self.filtered_torque else self.standard_error
        reach = float(ndtri(0.5 + 0.5 * level)) * error
        return np.column_stack([self.base - reach, self.base + reach])

    @property
    def relative_standard_error(self) -> Array:
        """`standard_error` over the size of each base parameter (thesis eq. 4.29), (n_b,); 0.05 means 5 %."""
        size = np.abs(self.base)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(size > 0.0, self.standard_error / size, np.inf))

    @property
    def weak(self) -> tuple[str, ...]:
        """Base parameters, in words, smaller than twice their standard error, or that the data does not determine."""
        pairs = zip(self.base_expressions, self.relative_standard_error, strict=True)
        return tuple(name for name, error in pairs if not WEAK * error < 1.0)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return the parameters (n,), so that functions of models take an estimate in their place.

        Raises
        ------
        InputError
            If the estimate has base parameters alone.
        """
        if self.parameters is None:
            raise InputError(
                f"The estimate ({self.method}) has base parameters alone, where the parameters of every link are "
                "needed: use steelyard.fit."
            )
        return np.array(self.parameters, dtype=dtype, copy=copy)

    def __repr__(self) -> str:
        feasible = f", feasible ({self.consistency})" if self.consistency else ""
        error = f"relative error {self.relative_error:.2%}"
        return f"Estimate({self.method}: {len(self.base)} base parameters, {error}{feasible})"

    def _repr_html_(self) -> str:
        relative = self.relative_standard_error
        rows = [
            (text, f"{value:.5g}", f"{100 * s:.3g} %")
            for text, value, s in zip(self.base_expressions, self.base, relative, strict=True)
        ]
        error = "" if np.isnan(self.relative_error) else f", relative error {self.relative_error:.2%}"
        feasible = f", feasible ({self.consistency})" if self.consistency else ""
        heads = ("base parameter", "value", "standard error")
        return html_table(f"{self.method}{error}{feasible}", heads, rows, self.remarks)

    def to_dict(self) -> dict[str, Any]:
        """Return the estimate as plain data, with None for numbers that are not finite."""
        return {**plain(self._document())}

    def _document(self) -> dict[str, Any]:
        return {"format": FORMAT, **{item.name: getattr(self, item.name) for item in fields(self)}}

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], where: str = "estimate", *, certified: bool = True) -> Estimate:
        """Build an estimate from what `to_dict` returned.

        Parameters
        ----------
        document : mapping
        where : str
            Named in messages.
        certified : bool
            Whether the numbers must be those that the certificate speaks of; False to judge numbers that are not.

        Raises
        ------
        InputError
            If something is missing or of a wrong size, a parameter is not a finite number, or the numbers are not those
            that the certificate speaks of; `where` is named in the message.
        """
        require_format(document.get("format"), FORMAT, where, "identify the robot anew")
        values: dict[str, Any] = {}
        for item in fields(cls):
            if item.name not in document:
                if item.name in _LATER:
                    continue
                raise InputError(f"{where}: lacks {item.name!r}; save the estimate anew.")
            values[item.name] = _read(item.name, document[item.name], where)
        estimate = cls(**values)
        base, joints = len(estimate.base_names), len(estimate.joint_names)
        sizes = {"base_expressions": base, "base": base, "standard_error": base, "unconstrained_base": base}
        sizes |= dict.fromkeys(("joint_relative_error", "damping", "friction", "rotor_inertia", "offset"), joints)
        sizes |= {"parameters": len(estimate.parameter_names), "error_correlation": base * (base - 1) // 2}
        for name, expected in sizes.items():
            given = getattr(estimate, name)
            if given is not None and len(given) != expected:
                raise InputError(f"{where}: {name!r} has {len(given)} values, expected {expected}.")
        for name, labels in (("base", estimate.base_expressions), ("parameters", estimate.parameter_names)):
            held: Array | None = getattr(estimate, name)
            missing = [] if held is None else np.flatnonzero(~np.isfinite(held)).tolist()
            if missing:
                raise InputError(
                    f"{where}: {name!r} has no finite number for {labels[missing[0]]}; save the estimate anew."
                )
        if estimate.consistency not in (None, "full", "inertia") or (
            estimate.consistency and estimate.parameters is None
        ):
            raise InputError(
                f"{where}: 'consistency' tells in which sense its parameters are feasible, and must be \"full\" or "
                f'"inertia", or null where there are none or they are not; got {shown(estimate.consistency)}.'
            )
        from .certified_numbers import certified_numbers_differ  # loaded where estimates are read

        different = certified_numbers_differ(document) if certified else ""
        if different:
            raise InputError(
                f'{where}: {different}; save the estimate anew, or set "consistency" and "certificate" to null in the '
                "file to use its numbers without a proof."
            )
        return estimate

    def save(self, path: str | Path) -> None:
        """Write the estimate as JSON; the file appears whole or not at all."""
        write_json(self._document(), path)

    @classmethod
    def load(cls, path: str | Path, *, certified: bool = True) -> Estimate:
        """Read what `save` wrote.

        Parameters
        ----------
        path : str or Path
            The file, or a folder of results that has it as `ESTIMATE`.
        certified : bool
            As in `from_dict`.

        Raises
        ------
        InputError
            If the file is missing or is something else.
        """
        path = estimate_file(path)
        document = read_json(path, remedy=f"give the {ESTIMATE} that steelyard saved, or the folder that holds it")
        if not isinstance(document, dict):
            raise InputError(f"{path}: holds no estimate, but a {type(document).__name__}.")
        return cls.from_dict(document, str(path), certified=certified)

    def write_urdf(self, source: str | Path, target: str | Path) -> None:
        """Write a copy of a URDF with the identified inertials, joint damping and friction.

        Everything else of the file stays as it is: comments, order, unknown tags.

        Parameters
        ----------
        source : str or Path
            The URDF of the robot; it is not changed.
        target : str or Path

        Raises
        ------
        InputError
            If the estimate has no parameters, or does not belong to this robot.
        """
        self._write(UrdfFormat(self.description.get("xacro_arguments")), Path(source), Path(target))

    def write_description(self, source: str | Path, target: str | Path) -> None:
        """Write a copy of a description with the identified parameters, in the format of its suffix.

        Parameters
        ----------
        source : str or Path
            The description of the robot; it is not changed.
        target : str or Path

        Raises
        ------
        InputError
            If the estimate has no parameters, does not belong to this robot, or the format is only read.
        """
        source = Path(source)
        chosen = description_format(source, self.description.get("xacro_arguments"))
        self._write(chosen or URDF, source, Path(target))

    def require_geometry(self, robot: Robot, where: str) -> None:
        """Make sure that the joints of a robot with the same names are where those of the identified robot were.

        Otherwise the inertias would stand in other frames. The place of the base counts for nothing, and estimates that
        do not tell the geometry of their robot fit any.

        Parameters
        ----------
        robot : Robot
        where : str
            Whose description it is, for the message.

        Raises
        ------
        InputError
            If a joint is elsewhere, or turns about another axis.
        """
        recorded = self.description.get("joints")
        try:
            joint = "" if recorded is None else differing_joint(recorded, robot.joints)
        except (TypeError, ValueError, KeyError):
            raise InputError(
                f"The 'joints' in 'description' of the estimate are damaged; save it anew ({where})."
            ) from None
        if joint:
            raise InputError(
                f"{where}: the origin, axis or motion of the joint {shown(joint)} is another than that of the robot "
                "of this estimate, so that inertias would stand in wrong frames; give the description with which it "
                "was identified."
            )

    def _of_transmissions(self, name: str) -> Array | None:
        """A number of the elastic joints whose stiffness was measured, (N,); NaN at others."""
        measured = {str(one["joint"]): one for one in self.elastic_joints if one.get("verdict") == "measured"}
        if not measured:
            return None
        return np.array([float(measured[j][name]) if j in measured else np.nan for j in self.joint_names])

    def _write(self, kind: DescriptionFormat, source: Path, target: Path) -> None:
        if self.parameters is None:
            raise InputError(
                "A description needs the parameters of every link, but this estimate has base parameters alone: "
                "use steelyard.fit."
            )
        told = faults_told(f"{source} cannot be read and written", "mend the package that does so")
        with contextlib.nullcontext() if isinstance(kind, UrdfFormat) else told:
            tip, locked = self.description.get("tip"), self.description.get("locked") or ()
            robot = kind.read(source, tip, locked, (0, 0, -9.81))
            names = list(robot.parameter_names)
            missing = [name for name in names if name not in self.parameter_names]
            if missing or tuple(robot.joint_names) != self.joint_names:
                raise InputError(
                    f"{source}: does not describe the robot of this estimate, whose joints are "
                    f"{listed(self.joint_names)}; it has {listed(robot.joint_names)}."
                )
            self.require_geometry(robot, str(source))
            index = {name: k for k, name in enumerate(self.parameter_names)}
            links = self.parameters[[index[name] for name in names]]
            drives = Drives.unknown(robot.dof).with_known(
                damping=self.damping,
                friction=self.friction,
                rotor_inertia=self.rotor_inertia,
                offset=self.offset,
                stiffness=self._of_transmissions("stiffness"),
                transmission_damping=self._of_transmissions("damping"),
                **self.description.get("drives", {}),
            )
            kind.write(robot, links, drives, source, target)


def _read(name: str, value: Any, where: str) -> Any:
    """Turn one field of an estimate file into what the estimate holds."""
    if value is None and name in _OPTIONAL:
        return None
    if name in _ARRAYS:
        return _numbers(name, value, where)
    if name in _NUMBERS and value is None:
        return _NUMBERS[name]
    if name in _NAMES:
        expected, good = "a list of strings", isinstance(value, list) and all(isinstance(v, str) for v in value)
        value = tuple(value) if good else value
    elif name in ("parameter_table", "elastic_joints"):
        expected, good = "a list of objects", isinstance(value, list) and all(isinstance(v, dict) for v in value)
        value = tuple(value) if good else value
    elif name in (*_NUMBERS, "row_count", "optimality_gap"):
        expected, good = "a number", isinstance(value, (int, float)) and not isinstance(value, bool)
    elif name == "filtered_torque":
        expected, good = "true or false", isinstance(value, bool)
    elif name in ("certificate", "description", "elastic_model"):
        expected, good = "an object", isinstance(value, dict)
    else:
        expected, good = "a string", isinstance(value, str)
    if not good:
        raise InputError(f"{where}: {name!r} must be {expected}, got {shown(value)}.")
    if isinstance(value, int | float) and not isinstance(value, bool) and not 0 <= value < np.inf:
        raise InputError(f"{where}: {name!r} must be finite and not negative, got {value!r}.")
    return value


def _numbers(name: str, value: Any, where: str) -> Array:
    """Turn a list of numbers into an array; None stands for what is not known, where that may be."""
    error = name == "standard_error"
    unknown = error or name in ("damping", "friction", "rotor_inertia", "offset", "joint_relative_error")
    allowed = (int, float, type(None)) if unknown else (int, float)
    if not isinstance(value, list) or not all(isinstance(v, allowed) and not isinstance(v, bool) for v in value):
        raise InputError(f"{where}: {name!r} must be a list of numbers, got {shown(value)}.")
    numbers = np.array([(np.inf if error else np.nan) if v is None else float(v) for v in value])
    if np.any(np.abs(numbers[np.isfinite(numbers)]) > LARGEST) or (not unknown and not np.all(np.isfinite(numbers))):
        raise InputError(f"{where}: {name!r} holds numbers beyond {LARGEST:g}, which no robot has.")
    if error and np.any(numbers < 0.0):
        raise InputError(f"{where}: {name!r} holds a negative number.")
    if name == "error_correlation" and np.any(np.abs(numbers) > 1.0):
        raise InputError(f"{where}: {name!r} holds numbers beyond 1.")
    if name == "weights" and not np.all(numbers > 0.0):
        raise InputError(f"{where}: {name!r} must be positive.")
    return numbers
