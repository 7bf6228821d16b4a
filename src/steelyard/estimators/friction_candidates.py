"""Friction laws that a selection tries: their regressor columns for given shapes, and the shapes that are tried."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.bristles import BristleStates, bristle_states

__all__ = ["BY_GRAVITY", "CANDIDATES", "FrictionCandidate", "JointMotion", "Shape", "by_channel", "lugre_is_passive"]

Array = NDArray[np.float64]
Shape = tuple[float, ...]

FRACTIONS = np.geomspace(0.01, 0.6, 14)
"""The shares of the fastest speed of a joint that are tried as Stribeck velocities, knees and widths,
each 1.37 times the one before; a search between neighbours follows."""
KNEES = np.append(FRACTIONS, FRACTIONS[-1] ** 2 / FRACTIONS[-2])
"""Those that are tried as knees, which joints have near their full speed, too; one at the end is refused."""
TRAVELS = np.geomspace(1e-4, 0.3, 14)
"""The shares of the range of a joint that are tried as presliding displacements."""
MOST_HARMONICS = 64
"""Periods in a turn (or in a metre over 2 π) of a ripple that are tried; a ripple must be seen at two samples a
period, and over one period at least."""


class JointMotion(NamedTuple):
    """Motion of one joint, row by row.

    Attributes
    ----------
    q, dq : ndarray
        (S,) rad or m, and per s.
    load : ndarray
        (S,) N·m or N: what the links alone ask of the joint, by a preliminary fit.
    starts : tuple of int
        Rows at which a log begins, so that nothing is remembered from the row before.
    gravity : ndarray, optional
        (S,) N·m or N: the part of it that the joint feels at rest; zero where it is not given.
    channels : mapping
        (S,) of each name, what was logged beside the motion.
    """

    q: Array
    dq: Array
    load: Array
    starts: tuple[int, ...] = (0,)
    gravity: Array | None = None
    channels: Mapping[str, Array] = {}

    @property
    def speed(self) -> float:
        """The fastest speed, leaving out one row in a hundred."""
        return float(np.quantile(np.abs(self.dq), 0.99))


@dataclass(frozen=True, eq=False)
class FrictionCandidate:
    """A law of friction (or of a drive) that may be added to that of a model.

    Attributes
    ----------
    words : str
        What it is.
    shape_names : tuple of str
        Of the parameters on which it depends nonlinearly.
    columns : callable
        Motion and shapes -> one array (S, c) for each shape: what its c linear parameters multiply.
    shapes : callable
        Motion -> the shapes that are tried first.
    nonnegative : tuple of bool
        Which of its linear parameters cannot be negative, since friction would then drive the joint.
    replaces : str
        Kind of the term that it stands in place of; empty where it is added.
    changes : tuple of str
        Kinds of the terms of which it is another form; one law at a joint changes each at most.
    has_state : bool
        Whether its columns remember the motion: they are those of a term with the state as a channel.
    is_friction : bool
        Whether it must dissipate, with the viscous and the Coulomb friction of the joint.
    steps : tuple of (str, tuple of float)
        Shapes that take these values alone.
    """

    kind: str
    words: str
    columns: Callable[[JointMotion, Sequence[Shape]], list[Array]]
    shapes: Callable[[JointMotion], list[Shape]]
    nonnegative: tuple[bool, ...]
    shape_names: tuple[str, ...] = ()
    replaces: str = ""
    changes: tuple[str, ...] = ()
    has_state: bool = False
    is_friction: bool = True
    steps: tuple[tuple[str, tuple[float, ...]], ...] = ()

    @property
    def parameter_count(self) -> int:
        """Linear parameters and shapes together."""
        return len(self.nonnegative) + len(self.shape_names)

    @property
    def free_names(self) -> list[str]:
        """The numbers of its shape that take any value."""
        fixed = {name for name, _ in self.steps}
        return [name for name in self.shape_names if name not in fixed]


def _plain(function: Callable[[JointMotion], list[Array]]) -> Callable[[JointMotion, Sequence[Shape]], list[Array]]:
    return lambda motion, shapes: [np.column_stack(function(motion))] * len(shapes)


def _shaped(
    function: Callable[[JointMotion, Shape], list[Array]],
) -> Callable[[JointMotion, Sequence[Shape]], list[Array]]:
    return lambda motion, shapes: [np.column_stack(function(motion, shape)) for shape in shapes]


def _no_shape(_: JointMotion) -> list[Shape]:
    return [()]


def _speeds(motion: JointMotion) -> list[Shape]:
    return [(float(f * motion.speed),) for f in FRACTIONS] if motion.speed > 0.0 else []


def _knees(motion: JointMotion) -> list[Shape]:
    return [(float(f * motion.speed),) for f in KNEES] if motion.speed > 0.0 else []


def _stribeck_shapes(motion: JointMotion) -> list[Shape]:
    return [(v, exponent) for (v,) in _speeds(motion) for exponent in (1.0, 2.0)]


def _travels(motion: JointMotion) -> list[Shape]:
    extent = float(np.ptp(motion.q)) if len(motion.q) else 0.0
    return [(float(f * extent),) for f in TRAVELS] if extent > 0.0 else []


def _lugre_shapes(motion: JointMotion) -> list[Shape]:
    speeds = [v for (v,) in _speeds(motion)][3::3]
    return [(d, ratio, v) for (d,) in _travels(motion)[3::2] for ratio in (0.3, 0.9) for v in speeds]


def _harmonics(motion: JointMotion) -> list[Shape]:
    extent = float(np.ptp(motion.q)) if len(motion.q) else 0.0
    step = float(np.quantile(np.abs(np.diff(motion.q)), 0.95)) if len(motion.q) > 1 else 0.0
    if not (extent > 0.0 and step > 0.0):
        return []
    # The first harmonics of a joint that turns are those of gravity.
    return [(float(h),) for h in range(2, MOST_HARMONICS + 1) if h * extent > 2.0 * np.pi and h * step < 0.5 * np.pi]


def _bristles(motion: JointMotion, shapes: Sequence[Shape]) -> BristleStates:
    numbers = zip(*shapes, strict=True)
    return bristle_states(motion.q[:, None], motion.dq[:, None], *numbers, starts=motion.starts)


def _dahl(motion: JointMotion, shapes: Sequence[Shape]) -> list[Array]:
    return [state[:, None] for state in _bristles(motion, shapes).states.T]


def _lugre(motion: JointMotion, shapes: Sequence[Shape]) -> list[Array]:
    found = _bristles(motion, shapes)
    return [np.column_stack(pair) for pair in zip(found.states.T, found.rates.T, strict=True)]


def lugre_is_passive(damping: float, viscous: float, ratio: float) -> bool:
    """Return whether LuGre friction dissipates in every motion: ``viscous >= ratio * damping``.

    Parameters
    ----------
    damping, viscous : float
        Of the bristles, and viscous friction, N·m·s/rad or N·s/m.
    ratio : float
        What breaks away above Coulomb friction, relative to that.

    References
    ----------
    N. Barahanov and R. Ortega, Necessary and sufficient conditions for passivity of the LuGre friction model, IEEE
    Transactions on Automatic Control 45, 2000.

    Examples
    --------
    >>> lugre_is_passive(1.0, 0.6, 0.5), lugre_is_passive(1.0, 0.4, 0.5)
    (True, False)
    """
    return viscous >= ratio * damping


def _stribeck(motion: JointMotion, shape: Shape) -> list[Array]:
    speed, exponent = shape
    return [np.sign(motion.dq) * np.exp(-np.minimum((np.abs(motion.dq) / speed) ** exponent, 700.0))]


CANDIDATES: tuple[FrictionCandidate, ...] = (
    FrictionCandidate(
        "viscous_by_direction",
        "viscous friction that is another in each direction",
        _plain(lambda motion: [np.abs(motion.dq)]),
        _no_shape,
        (False,),
        changes=("viscous",),
    ),
    FrictionCandidate(
        "spring",
        "a spring",
        _plain(lambda motion: [motion.q]),
        _no_shape,
        (True,),
        is_friction=False,
    ),
    FrictionCandidate(
        "load",
        "Coulomb friction that grows with the load",
        _plain(lambda motion: [np.abs(motion.load) * np.sign(motion.dq)]),
        _no_shape,
        (True,),
    ),
    FrictionCandidate(
        "coulomb_smooth",
        "Coulomb friction that turns its sign smoothly",
        _shaped(lambda motion, shape: [np.tanh(motion.dq / shape[0])]),
        _speeds,
        (True,),
        ("velocity",),
        replaces="coulomb",
        changes=("coulomb",),
    ),
    FrictionCandidate(
        "friction_polynomial",
        "viscous friction with a square and a cube",
        _plain(lambda motion: [motion.dq * np.abs(motion.dq), motion.dq**3]),
        _no_shape,
        (False, False),
        changes=("viscous",),
    ),
    FrictionCandidate(
        "friction_piecewise",
        "viscous friction with a knee",
        _shaped(lambda motion, shape: [np.sign(motion.dq) * np.maximum(np.abs(motion.dq) - shape[0], 0.0)]),
        _knees,
        (False,),
        ("speed",),
        changes=("viscous",),
    ),
    FrictionCandidate(
        "stribeck",
        "Coulomb friction that is another near rest (Stribeck)",
        _shaped(_stribeck),
        _stribeck_shapes,
        (False,),
        ("velocity", "exponent"),
        steps=(("exponent", (1.0, 2.0)),),
        changes=("coulomb",),
    ),
    FrictionCandidate(
        "cogging",
        "a ripple with position",
        _shaped(lambda motion, shape: [np.cos(shape[0] * motion.q), np.sin(shape[0] * motion.q)]),
        _harmonics,
        (False, False),
        ("harmonic",),
        is_friction=False,
    ),
    FrictionCandidate(
        "dahl",
        "friction with presliding (Dahl)",
        _dahl,
        _travels,
        (True,),
        ("displacement",),
        replaces="coulomb",
        has_state=True,
        changes=("coulomb",),
    ),
    FrictionCandidate(
        "lugre",
        "friction with presliding that is another near rest (LuGre)",
        _lugre,
        _lugre_shapes,
        (True, True),
        ("displacement", "ratio", "velocity"),
        replaces="coulomb",
        has_state=True,
        changes=("coulomb", "viscous"),  # by which its condition of passivity is told
    ),
)
"""In the order in which, of equally good ones, the first is taken: fewest parameters first."""


def _by_gravity(motion: JointMotion) -> list[Array]:
    return [(np.abs(motion.gravity) if motion.gravity is not None else np.zeros_like(motion.dq)) * np.sign(motion.dq)]


BY_GRAVITY = FrictionCandidate(
    "friction_by_load",
    "Coulomb friction that grows with the torque of gravity",
    _plain(_by_gravity),
    _no_shape,
    (True,),
    changes=("coulomb", "viscous"),
)
"""What the term of that name is, where friction by the torque of all links would need their accelerations."""


def by_channel(name: str) -> FrictionCandidate:
    """Friction that changes with a channel that was logged beside the motion, such as a temperature.

    Examples
    --------
    >>> still, speeds = np.zeros(3), np.array([-1.0, 1.0, 1.0])
    >>> motion = JointMotion(still, speeds, still, channels={"temperature": np.array([20.0, 30.0, 40.0])})
    >>> by_channel("temperature").columns(motion, [()])[0][:, 0].tolist()
    [10.0, 0.0, 10.0]
    """

    def columns(motion: JointMotion) -> list[Array]:
        signal = motion.channels.get(name, np.zeros_like(motion.dq))
        beyond = signal - (float(np.mean(signal)) if len(signal) else 0.0)
        return [beyond * np.sign(motion.dq), beyond * motion.dq]

    return FrictionCandidate(
        f"friction_by_channel {name}",
        f"friction that changes with {name}",
        _plain(columns),
        _no_shape,
        (False, False),
        changes=("coulomb", "viscous"),
        is_friction=False,
    )
