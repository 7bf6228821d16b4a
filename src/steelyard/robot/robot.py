"""The robot: a tree of one-degree-of-freedom joints and rigid links, and the terms that its drives add."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table
from steelyard.errors import InputError
from steelyard.files import shown, suggestion
from steelyard.once import cached_property

from .inertia import INERTIA_SYMBOLS, Inertia
from .joint import Attachment, Joint, LeftOut, Link
from .placement import frozen

__all__ = ["Condition", "Robot", "Term", "TermParameter"]

Matrix = NDArray[np.float64]
Scalars = Sequence[Any]
"""A scalar of any type for each coordinate."""
Channels = Mapping[str, Scalars]
"""What is logged beside the motion, by name."""
Columns = tuple[dict[int, Any], ...]
"""Of a regressor, one for each parameter of a term: row -> scalar, where it is not 0."""

PRESLIDING = "presliding"
"""The channel that is the state of the bristles of friction; it is not logged but follows from the motion before."""


@dataclass(frozen=True)
class TermParameter:
    """One parameter that a term has for each coordinate.

    Parameters
    ----------
    symbol : str
        Symbol without the joint's number, such as "Fv".
    unit, unit_prismatic : str
        Unit at a revolute and at a prismatic joint.
    description : str
        What it is, in a few words.
    nonnegative : bool
        Whether a negative value is physically impossible.
    described_as : str, optional
        As what a robot description may hold it: "damping" (torque by velocity), "friction" (torque against the
        velocity), "rotor_inertia" (torque by acceleration), "offset" (a constant torque), "stiffness" (torque by
        position), "quadratic_damping" or "cubic_damping" (torque by a power of the velocity). What joints feel of all
        such parameters is written into descriptions, see `Drives`; parameters without it stand in the estimate alone.

    Examples
    --------
    >>> TermParameter("Fv", "N·m·s/rad", "N·s/m", "viscous friction", nonnegative=True).symbol
    'Fv'
    """

    symbol: str
    unit: str
    unit_prismatic: str
    description: str
    nonnegative: bool
    described_as: (
        Literal["damping", "friction", "rotor_inertia", "offset", "stiffness", "quadratic_damping", "cubic_damping"]
        | None
    ) = None


@dataclass(frozen=True, eq=False)
class Condition:
    """An affine matrix of a term's parameters that is positive semidefinite where the term is physically possible.

    The matrix is `constant + sum(value[symbol] * coefficients[symbol])`.

    Parameters
    ----------
    name : str
        What must hold, in a few words.
    size : int
        Order d of the matrix.
    constant : (d, d) array
        Constant part.
    coefficients : mapping from symbol to (d, d) array
        Symmetric coefficient of each parameter.

    Examples
    --------
    >>> Condition("Fv <= 5", 1, np.array([[5.0]]), {"Fv": np.array([[-1.0]])}).name
    'Fv <= 5'
    """

    name: str
    size: int
    constant: Matrix
    coefficients: Mapping[str, Matrix]


class Term(ABC):
    """A part of the joint torques that is linear in parameters of its own.

    A subclass sets `kind` (its name in robot.toml) and `parameters` (those that it has for *each* coordinate), and
    gives its regressor columns over generic scalars.

    Examples
    --------
    >>> class Spring(Term):
    ...     kind = "spring"
    ...     parameters = (TermParameter("Ks", "N·m/rad", "N/m", "stiffness of a spring at q = 0", nonnegative=True),)
    ...
    ...     def columns(self, k, q, dq, ddq, algebra):
    ...         return ({k: q[k]},)
    >>> Spring().columns(0, [0.5], [0.0], [0.0], None)
    ({0: 0.5},)
    >>> [condition.name for condition in Spring().conditions()]
    ['Ks >= 0']
    """

    kind: ClassVar[str]
    parameters: tuple[TermParameter, ...]

    @property
    def speeds(self) -> tuple[float, ...]:
        """Speeds (rad/s or m/s) at which the columns change, such as a Stribeck velocity; none as a rule.

        Which parameters a motion can show at all is found at random motions, some of them as slow or fast as these.
        """
        return ()

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of what is logged beside the motion and the columns need, such as a temperature; none as a rule.

        `columns` then has one more argument, a mapping from these names to N scalars each, one for each joint.
        """
        return ()

    @property
    def laws(self) -> tuple[Term, ...]:
        """The terms of which this one is made, such as those of single joints: itself, as a rule."""
        return (self,)

    @property
    def stands_for(self) -> frozenset[str]:
        """What friction of a description it is, "damping" or "friction", of which a joint has that of one law alone."""
        told = (parameter.described_as for parameter in self.parameters)
        return frozenset(one for one in told if one in ("damping", "friction"))

    def acts_at(self, k: int) -> bool:
        """Whether the term acts at joint `k`, from 0; where it does not, its parameters of the joint have no effect."""
        return True

    def check_channel(self, name: str, values: Matrix) -> None:
        """Raise InputError where a channel has values for which the term was not made."""
        return

    def without_channels(self) -> Term | None:
        """Return a term that comes near to this one and needs no channels; None where there is none."""
        return None if self.channels else self

    def bristles(self, k: int) -> tuple[float, float, float] | None:
        """Return what tells the state that the friction of coordinate `k` needs as the channel ``presliding``.

        Displacement, ratio and velocity, as of :class:`steelyard.dynamics.LuGre`; None as a rule, where it has none.
        """
        return None

    def on(self, robot: Robot) -> Term:
        """Return the term as it acts on a robot: itself, unless its columns depend on the robot's links."""
        return self

    @property
    def identity(self) -> Mapping[str, Any]:
        """What determines the columns for a given robot; as a rule the term as it stands in robot.toml."""
        return self.to_dict()

    @abstractmethod
    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        """Regressor columns of coordinate `k`: for each parameter, torque row -> scalar (absent rows are 0).

        Parameters
        ----------
        k : int
            Index of the coordinate.
        q, dq, ddq : sequence of N scalars
            Coordinates (rad or m), speeds and accelerations; any type with + - *.
        algebra : object
            Functions that operators do not give, over the same scalars (`sin`, `cos`, `sign`, ...).
        """

    def nominal(self, joint: Joint) -> tuple[float, ...]:
        """Values that the description gives at the driving joint, one a parameter; NaN where unknown."""
        return (np.nan,) * len(self.parameters)

    def potential(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Potential energy (J) of coordinate `k` for each parameter at the value 1; empty where it stores no energy.

        A subclass that stores energy, such as a spring, overrides this.
        """
        return (0.0,) * len(self.parameters)

    def conditions(self) -> tuple[Condition, ...]:
        """Conditions on the parameters of one coordinate; by default each nonnegative parameter is at least 0."""
        return tuple(
            Condition(f"{parameter.symbol} >= 0", 1, np.zeros((1, 1)), {parameter.symbol: np.ones((1, 1))})
            for parameter in self.parameters
            if parameter.nonnegative
        )

    def conditions_at(self, k: int) -> tuple[Condition, ...]:
        """Conditions on the parameters of coordinate `k`, from 0; as a rule those of all."""
        return self.conditions()

    def check(self, robot: Robot) -> None:
        """Raise InputError where the term does not fit the robot (a matrix of another size, for example)."""
        return

    def to_dict(self) -> dict[str, Any]:
        """The term as it stands in robot.toml."""
        return {"kind": self.kind}


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A robot: its joints and links, gravity, and the terms of its model.

    Use `Robot.from_urdf` or `Robot.from_dh`; the plain constructor is for code that makes robots.

    Parameters
    ----------
    name : str
        Name of the robot.
    joints : tuple of Joint
        `joints[i]` moves `links[i]`; parents come before their children. Coordinates are numbered in the order of the
        driving joints (those that mimic no other).
    links : tuple of Link
        The moving links.
    gravity : (3,) array
        Acceleration of gravity in the base frame, m/s².
    terms : tuple of Term
        Terms beyond the rigid links (friction, rotor inertia, ...), in the order of their parameters.
    base_link : str
        Name of the link that does not move.
    base_attachments : tuple of Attachment
        Links of the source that are fixed to the base.
    base_inertia : Inertia or None
        CAD inertia of `base_link` alone, of which no motion tells anything.
    base_mended : mapping of str to Inertia
        Other inertias for the base and links fixed to it, each in its own frame, that writers take.
    source : Path or None
        The description that the robot was read from.
    remarks : tuple of str
        What the description holds that the robot does not, and how it was read.
    read_with : mapping
        What of the description was read: its `tip` and its `locked` joints, where there are any.
    described_joints : tuple of str
        Where joints are locked, the names of these and of the driving joints, in the order of the description, in which
        a controller numbers them; empty where none are.
    xacro_arguments : mapping
        With which the description was expanded.
    left_out : tuple of LeftOut
        Branches of the description that moving links carry, and that its tip leaves out.

    Raises
    ------
    InputError
        When the parts do not fit together: no joint, a parent after its child, names used twice, coordinates out of
        order.

    Examples
    --------
    >>> robot = Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q - pi/2")], name="elbow")
    >>> robot
    Robot 'elbow': 2 coordinates, 2 links on 'base', gravity (0, 0, -9.81) m/s²
      1  joint1  revolute  base -> link1  mass unknown
      2  joint2  revolute  link1 -> link2  mass unknown
    >>> robot.parameter_names[:3], len(robot.parameter_names)
    (('Lxx1', 'Lxy1', 'Lxz1'), 20)
    """

    name: str
    joints: tuple[Joint, ...]
    links: tuple[Link, ...]
    gravity: Matrix = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    terms: tuple[Term, ...] = ()
    base_link: str = "base"
    base_attachments: tuple[Attachment, ...] = ()
    base_inertia: Inertia | None = None
    base_mended: Mapping[str, Inertia] = field(default_factory=dict)
    source: Path | None = None
    remarks: tuple[str, ...] = ()
    read_with: Mapping[str, Any] = field(default_factory=dict)
    described_joints: tuple[str, ...] = ()
    xacro_arguments: Mapping[str, str] = field(default_factory=dict)
    left_out: tuple[LeftOut, ...] = ()

    def __post_init__(self) -> None:
        try:
            gravity = frozen(self.gravity, (3,))
        except (ValueError, TypeError):
            raise InputError(
                f'robot "{self.name}": gravity must be three numbers in m/s², got {self.gravity!r}'
            ) from None
        if not np.isfinite(gravity).all():
            raise InputError(f'robot "{self.name}": gravity must be finite, got {gravity.tolist()}')
        object.__setattr__(self, "gravity", gravity)
        for name in ("joints", "links", "terms", "base_attachments", "remarks"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        self._check_tree()

    def _check_tree(self) -> None:
        if not self.joints:
            raise InputError(f'robot "{self.name}" has no moving joint; nothing can be identified')
        if len(self.joints) != len(self.links):
            raise InputError(
                f'robot "{self.name}": each joint moves one link, got {len(self.joints)} joints '
                f"and {len(self.links)} links"
            )
        driving: dict[str, Joint] = {}
        for index, joint in enumerate(self.joints):
            if not -1 <= joint.parent < index:
                raise InputError(
                    f'joint "{joint.name}": its parent must be -1 (base) or a link before {index}, got {joint.parent}'
                )
            if joint.mimics is None:
                if joint.coordinate != len(driving) or joint.multiplier != 1.0 or joint.offset != 0.0:
                    raise InputError(
                        f'joint "{joint.name}": a driving joint must have coordinate {len(driving)} (the next one), '
                        f"multiplier 1 and offset 0, got {joint.coordinate}, {joint.multiplier:g} and {joint.offset:g}"
                    )
                driving[joint.name] = joint
        for joint in self.joints:
            if joint.mimics is not None and (
                joint.mimics not in driving or driving[joint.mimics].coordinate != joint.coordinate
            ):
                raise InputError(
                    f'joint "{joint.name}" mimics "{joint.mimics}", which is no driving joint of '
                    f"coordinate {joint.coordinate}"
                )
        for what, names in (
            ("joint", [joint.name for joint in self.joints]),
            ("link", [self.base_link, *(link.name for link in self.links)]),
        ):
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise InputError(f'robot "{self.name}": the {what} name "{twice}" is used twice; names must differ')

    @classmethod
    def from_dh(
        cls,
        rows: Sequence[Sequence[float | str]],
        convention: str = "standard",
        name: str = "robot",
        gravity: ArrayLike = (0, 0, -9.81),
        inertias: Mapping[str, Inertia] | None = None,
        locked: Iterable[str] | Mapping[str, float] = (),
    ) -> Robot:
        """A serial robot from Denavit-Hartenberg rows (thesis 2.1).

        Parameters
        ----------
        rows : sequence of (alpha, a, d, theta)
            Numbers (rad, m) or strings such as "-pi/2", "q", "q1", "q+pi/2"; exactly one of d (prismatic joint) and
            theta (revolute joint) holds q. In a and d any other name, as in "a2" or "0.1 - d4", is a symbolic length
            (m), see `with_lengths`.
        convention : {"standard", "modified"}
            "standard": Rz(theta) Tz(d) Tx(a) Rx(alpha). "modified" (Craig, Khalil): Rx(alpha) Tx(a) Rz(theta) Tz(d).
        name : str
            Name of the robot.
        gravity : (3,) array
            Acceleration of gravity in the base frame, m/s².
        inertias : mapping from name of a link to Inertia, optional
            What CAD says, in the frame of the link.
        locked : iterable of names, or mapping from name to position
            Joints held still, at q = 0 or at the given position (rad or m), whose lengths are numbers. Their links are
            merged into those that carry them.

        Returns
        -------
        Robot
            Joints "joint1", ... and links "link1", ..., whose inertia is unknown where none is given; the base is
            "base".

        Raises
        ------
        InputError
            When a row cannot be understood; the message names the row and the column. When an inertia is given for
            what is no link, or no joint has the name of one that is locked.

        Examples
        --------
        >>> Robot.from_dh([("-pi/2", 0, 0, "q1"), (0, 0, "q2", "pi/2")]).joints[1].kind
        'prismatic'
        """
        from .described_tree import robot_parts  # a format is loaded when it is read
        from .dh import dh_tree

        tree = dh_tree(rows, convention, name, inertias=inertias)
        return cls(**robot_parts(tree, None, locked), gravity=np.asarray(gravity, dtype=object))

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        tip: str | None = None,
        locked: Iterable[str] | Mapping[str, float] = (),
        gravity: ArrayLike = (0, 0, -9.81),
        xacro_arguments: Mapping[str, str] | None = None,
    ) -> Robot:
        """A robot from a URDF file.

        Fixed and locked joints are merged, with the inertia moved into the link that carries them (or dropped with the
        base). Joints come depth first, in the order of the document.

        Parameters
        ----------
        path : str or Path
            The URDF, or a xacro, which is expanded.
        tip : str, optional
            Keep only the chain from the root to this link. Links fixed to the chain are kept; moving side branches are
            not.
        locked : iterable of names, or mapping from name to position
            Joints held still, at 0 or at the given position (rad or m). Joints of more than one degree of freedom can
            only be locked at 0.
        gravity : (3,) array
            Acceleration of gravity in the frame of the root link, m/s².
        xacro_arguments : mapping, optional
            Values of the arguments of a xacro.

        Raises
        ------
        MissingExtraError
            When the file is a xacro, and the package xacro is not installed (extra ``xacro``).
        InputError
            When the file cannot be read or does not describe a tree of one-degree-of-freedom joints.

        Examples
        --------
        >>> import tempfile
        >>> text = '''<robot name="door"><link name="frame"/><link name="leaf"/>
        ... <joint name="hinge" type="revolute"><parent link="frame"/><child link="leaf"/><axis xyz="0 0 1"/></joint>
        ... </robot>'''
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "door.urdf"
        ...     _ = path.write_text(text)
        ...     robot = Robot.from_urdf(path)
        >>> robot.joint_names, robot.link_names, robot.base_link
        (('hinge',), ('leaf',), 'frame')
        """
        from .described_tree import robot_parts  # a format is loaded when it is read
        from .urdf_document import read_document

        given = dict(xacro_arguments or {})
        parts = robot_parts(read_document(path, given), tip, locked)
        return cls(**parts, gravity=np.asarray(gravity, dtype=object), xacro_arguments=given)

    @classmethod
    def from_sdf(
        cls,
        path: str | Path,
        tip: str | None = None,
        locked: Iterable[str] | Mapping[str, float] = (),
        gravity: ArrayLike | None = None,
    ) -> Robot:
        """A robot from an SDF file, versions 1.4 to 1.12.

        The file holds one model with joints, in a world or not; models without joints are left out. Nested models and
        those that it includes belong to the robot, their links and joints are named as ``model::link``. Frames are
        resolved: ``relative_to``, ``expressed_in``, ``attached_to``, ``use_parent_model_frame``. Joints come depth
        first, in the order of the document.

        Parameters
        ----------
        path : str or Path
        tip, locked
            As in `from_urdf`.
        gravity : (3,) array, optional
            Acceleration of gravity in the frame of the root link, m/s²; by default that of the world, (0, 0, -9.81)
            where it is not written, turned as the root link stands in the world.

        Raises
        ------
        InputError
            When the file cannot be read or does not describe a tree of one-degree-of-freedom joints.

        Examples
        --------
        >>> import tempfile
        >>> text = '''<sdf version="1.9"><model name="door"><link name="frame"/>
        ... <link name="leaf"><pose relative_to="hinge"/></link>
        ... <joint name="hinge" type="revolute"><pose relative_to="frame">0 0.1 0 0 0 0</pose>
        ... <parent>frame</parent><child>leaf</child><axis><xyz>0 0 1</xyz></axis></joint></model></sdf>'''
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "door.sdf"
        ...     _ = path.write_text(text)
        ...     robot = Robot.from_sdf(path)
        >>> robot.joint_names, robot.joints[0].placement(0.0)[:3, 3].tolist()
        (('hinge',), [0.0, 0.1, 0.0])
        """
        from .described_tree import robot_parts  # a format is loaded when it is read
        from .sdf_document import SdfReader

        reader = SdfReader(Path(path))
        parts = robot_parts(reader.tree(), tip, locked)
        return cls(**parts, gravity=np.asarray(reader.gravity if gravity is None else gravity, dtype=object))

    @classmethod
    def from_mjcf(
        cls,
        path: str | Path,
        tip: str | None = None,
        locked: Iterable[str] | Mapping[str, float] = (),
        gravity: ArrayLike | None = None,
    ) -> Robot:
        """A robot from an MJCF file; MuJoCo reads inertias of meshes, and copies (extra ``mjcf``).

        The world is the base; bodies without joints are merged into what carries them. A body with several joints is a
        link after as many joints, with links of no mass between them. Couplings of one joint to another
        (``<equality>``) make the one mimic the other. Joint values are those of MuJoCo's ``qpos``.

        Parameters
        ----------
        path : str or Path
        tip : str, optional
            Keep only the chain from the world to this body.
        locked : iterable of names, or mapping from name to position
            Joints held still, at 0 or at the given position (rad or m). Free and ball joints can only be locked at 0,
            where the body is as the file has it. A joint without a name has that of its body and ``_joint``.
        gravity : (3,) array, optional
            In the frame of the world, m/s²; that of the file where it is not given.

        Raises
        ------
        InputError
            When the file cannot be read, or does not describe a tree of joints with one degree of freedom.
        MissingExtraError
            When it takes MuJoCo to read the file, which is not installed.

        Examples
        --------
        >>> import tempfile
        >>> text = '''<mujoco model="door"><worldbody><body name="leaf"><joint name="hinge" damping="0.4"/>
        ... <geom type="box" size="0.4 0.02 1" pos="0.4 0 1" mass="12"/></body></worldbody></mujoco>'''
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "door.xml"
        ...     _ = path.write_text(text)
        ...     robot = Robot.from_mjcf(path)
        >>> robot.joint_names, robot.links[0], robot.joints[0].damping
        (('hinge',), Link('leaf', 12 kg), 0.4)
        """
        from .mjcf_tree import mjcf_parts

        parts = mjcf_parts(path, tip, locked)
        if gravity is not None:
            parts["gravity"] = np.asarray(gravity, dtype=object)
        return cls(**parts)

    def with_terms(self, *terms: Term) -> Robot:
        """Return the same robot with these terms in place of its own.

        Raises
        ------
        InputError
            When a term does not fit the robot, or two parameters would have the same name.
        """
        for term in terms:
            if not isinstance(term, Term) or not all(isinstance(one, TermParameter) for one in term.parameters):
                raise InputError(
                    f'robot "{self.name}": a term must be derived from Term, with TermParameter as its parameters, '
                    f"got {term!r}"
                )
            term.check(self)
        terms = tuple(term.on(self) for term in terms)
        symbols = [*INERTIA_SYMBOLS, *(parameter.symbol for term in terms for parameter in term.parameters)]
        twice = next((symbol for symbol in symbols if symbols.count(symbol) > 1), None)
        if twice is not None:
            owners = ["the links"] if twice in INERTIA_SYMBOLS else []
            owners += [
                f"the term {one.kind}" for one in terms for parameter in one.parameters if parameter.symbol == twice
            ]
            raise InputError(
                f'robot "{self.name}": the parameter "{twice}" is one of {" and of ".join(owners)}; give each term '
                "once, or rename its symbol; terms that act at different joints may be the laws of one term of kind "
                "'by_joint'"
            )
        return replace(self, terms=terms)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Names of what is logged beside the motion and is needed by terms, each once."""
        return tuple(dict.fromkeys(name for term in self.terms for name in term.channels))

    @cached_property
    def lengths(self) -> tuple[str, ...]:
        """Names of the symbolic lengths, in the order in which the joints first use them."""
        joints = self.joints
        return tuple(dict.fromkeys(name for j in joints for name in (*j.before_lengths, *j.after_lengths)))

    def with_lengths(self, values: Mapping[str, float]) -> Robot:
        """Return the same robot with numbers for symbolic lengths.

        Parameters
        ----------
        values : mapping
            From name to length, m; those not named stay symbols.

        Raises
        ------
        InputError
            When the robot has no such length, or a value is not finite.

        Examples
        --------
        >>> arm = Robot.from_dh([(0, "a1", 0, "q"), (0, "a2", 0, "q")])
        >>> arm.lengths, arm.with_lengths({"a1": 0.4}).lengths
        (('a1', 'a2'), ('a2',))
        """
        for name, value in values.items():
            if name not in self.lengths:
                known = ", ".join(self.lengths) or "none"
                raise InputError(f'robot "{self.name}" has no symbolic length "{name}"; it has {known}')
            if not np.isfinite(value):
                raise InputError(f'robot "{self.name}": the length "{name}" must be finite, got {value!r}')
        return replace(self, joints=tuple(joint.with_lengths(values) for joint in self.joints))

    @cached_property
    def dof(self) -> int:
        """Number of coordinates N."""
        return len(self.driving_joints)

    @cached_property
    def driving_joints(self) -> tuple[int, ...]:
        """For each coordinate, the index of the joint that it drives directly."""
        return tuple(index for index, joint in enumerate(self.joints) if joint.mimics is None)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names (N,) of the driving joints, in the order of the coordinates."""
        return tuple(self.joints[index].name for index in self.driving_joints)

    @cached_property
    def position_units(self) -> tuple[str, ...]:
        """Units (N,) of the positions: rad, or m where a joint slides."""
        return tuple("rad" if self.joints[index].rotates else "m" for index in self.driving_joints)

    @cached_property
    def position_limits(self) -> tuple[Matrix, Matrix]:
        """Lower and upper limits (N,) of the positions, rad or m; limits of joints that mimic others count, too."""
        lower, upper = np.full(self.dof, -np.inf), np.full(self.dof, np.inf)
        for joint in self.joints:
            if joint.multiplier != 0.0:
                k, ends = joint.coordinate, ((x - joint.offset) / joint.multiplier for x in (joint.lower, joint.upper))
                low, high = sorted(ends)
                lower[k], upper[k] = max(lower[k], low), min(upper[k], high)
        return frozen(lower, (self.dof,)), frozen(upper, (self.dof,))

    @cached_property
    def torque_units(self) -> tuple[str, ...]:
        """Units (N,) of the torques: N·m, or N where a joint slides."""
        return tuple("N·m" if self.joints[index].rotates else "N" for index in self.driving_joints)

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Names of the moving links."""
        return tuple(link.name for link in self.links)

    @cached_property
    def end_links(self) -> tuple[int, ...]:
        """Numbers of the links at the ends of the chains, which carry no other."""
        carrying = {joint.parent for joint in self.joints}
        return tuple(index for index in range(len(self.links)) if index not in carrying)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names (n,) of the parameters, in the order of thesis eq. 4.13: for each link its ten, then its terms'."""
        names: list[str] = []
        for number, joint in enumerate(self.joints, start=1):
            names += [f"{symbol}{number}" for symbol in INERTIA_SYMBOLS]
            if joint.mimics is None:
                names += [f"{parameter.symbol}{number}" for term in self.terms for parameter in term.parameters]
        return tuple(names)

    @cached_property
    def link_starts(self) -> tuple[int, ...]:
        """For each link, the index of its Lxx in the parameters; its ten parameters are the ten from there."""
        positions = {name: index for index, name in enumerate(self.parameter_names)}
        return tuple(positions[f"Lxx{number}"] for number in range(1, len(self.links) + 1))

    @cached_property
    def parameters(self) -> Matrix:
        """Values (n,) from the CAD data of the description, NaN where it says nothing."""
        values: list[float] = []
        felt = {joint.name: joint for joint in self.felt_joints}
        for joint, link in zip(self.joints, self.links, strict=True):
            values += [np.nan] * 10 if link.inertia is None else link.inertia.parameters.tolist()
            if joint.mimics is None:
                for term in self.terms:
                    values += term.nominal(felt[joint.name])
        return frozen(values, (len(self.parameter_names),))

    @cached_property
    def felt_joints(self) -> tuple[Joint, ...]:
        """The driving joints (N,), with what they feel of the drives of joints that mimic them."""
        felt = []
        for index in self.driving_joints:
            driver = self.joints[index]
            together = [joint for joint in self.joints if driver.name in (joint.name, joint.mimics)]

            def total(name: str, power: int, together: list[Joint] = together, signed: bool = False) -> float:
                ratios = [one.multiplier if signed else abs(one.multiplier) for one in together]
                parts = [getattr(one, name) * ratio**power for one, ratio in zip(together, ratios, strict=True)]
                known = [part for part in parts if not np.isnan(part)]
                return float(sum(known)) if known else np.nan

            felt.append(
                replace(
                    driver,
                    damping=total("damping", 2),
                    friction=total("friction", 1),
                    rotor_inertia=total("rotor_inertia", 2),
                    torque_offset=total("torque_offset", 1, signed=True),
                )
                if len(together) > 1
                else driver
            )
        return tuple(felt)

    def frame(self, name: str) -> tuple[int, Matrix]:
        """Return where a link of the description lies; it may be one that was merged into another.

        Returns
        -------
        link : int
            Index of the moving link that carries it, -1 for the base.
        placement : (4, 4) array
            Its frame in the frame of that link.

        Raises
        ------
        InputError
            When the robot has no link of this name.
        """
        carriers = [(-1, self.base_link, self.base_attachments)]
        carriers += [(index, link.name, link.attachments) for index, link in enumerate(self.links)]
        for index, carrier, attachments in carriers:
            if name == carrier:
                return index, np.eye(4)
            for attachment in attachments:
                if name == attachment.name:
                    return index, attachment.placement
        known = [carrier for _, carrier, _ in carriers] + [one.name for _, _, held in carriers for one in held]
        raise InputError(f'robot "{self.name}" has no link "{shown(name)[1:-1]}"; {suggestion(name, known)}')

    def _rows(self) -> list[tuple[str, ...]]:
        names = (*self.link_names, self.base_link)
        rows: list[tuple[str, ...]] = []
        for number, (joint, link) in enumerate(zip(self.joints, self.links, strict=True), start=1):
            kind = joint.kind if joint.mimics is None else f"{joint.kind} (mimics {joint.mimics})"
            mass = "mass unknown" if link.inertia is None else f"{link.inertia.mass:.6g} kg"
            rows.append((str(number), joint.name, kind, f"{names[joint.parent]} -> {link.name}", mass))
        return rows

    def _title(self) -> str:
        gravity = ", ".join(f"{value:g}" for value in self.gravity)
        terms = f", terms {', '.join(term.kind for term in self.terms)}" if self.terms else ""
        return (
            f"Robot {self.name!r}: {self.dof} coordinate{'s' * (self.dof != 1)}, {len(self.links)} "
            f"link{'s' * (len(self.links) != 1)} on {self.base_link!r}, gravity ({gravity}) m/s²{terms}"
        )

    if not TYPE_CHECKING:  # with this, types would have every attribute

        def __getattr__(self, name: str) -> Any:
            # Called for what a robot does not have: it is often given in the place of its model.
            told = "" if name.startswith("_") else "; its dynamics are those of steelyard.Model(robot)"
            raise AttributeError(f"a Robot has no attribute {name!r}{told}", name=name, obj=self)

    def __repr__(self) -> str:
        rows = self._rows()
        widths = [max(len(row[column]) for row in rows) for column in range(3)]
        lines = [
            "  " + "  ".join([row[0].rjust(widths[0]), row[1].ljust(widths[1]), row[2].ljust(widths[2]), *row[3:]])
            for row in rows
        ]
        return "\n".join([self._title(), *lines])

    def _repr_html_(self) -> str:
        return html_table(self._title(), ("", "joint", "kind", "links", "mass"), self._rows())
