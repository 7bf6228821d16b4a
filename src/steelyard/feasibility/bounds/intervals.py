"""Intervals of the values of parameters that are physically possible, given an estimate of the base parameters."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.display import few_digits, html_table, outward, percent, text_table
from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.files import listed, plain, shown, tell
from steelyard.regression import ParameterCovariance

from ..feasible_set import FeasibleSet
from .bound_finder import Bound, BoundFinder, given_by
from .quantities import Combination, Quantity, quantities

__all__ = ["ParameterInterval", "ParameterIntervals", "interval_of", "parameter_intervals"]

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ParameterInterval:
    """The values of one quantity among all physically possible robots with the given base parameters.

    Attributes
    ----------
    name : str
        Such as ``"m3"``.
    meaning : str
        Such as ``"mass of forearm"``.
    unit : str
    lower, upper : float
        Proved bounds: no robot has a smaller or larger value. Infinite if there is none.
    attained_lower, attained_upper : float
        Values that certain robots have; all values between them are possible.
    lower_parameters, upper_parameters : (n,) or None
        The parameters of those robots; they are very heavy if a bound is only approached as other masses grow.
    identifiable : bool
        Whether the base parameters determine the value.
    """

    name: str
    meaning: str
    unit: str
    lower: float
    upper: float
    attained_lower: float
    attained_upper: float
    lower_parameters: Vector | None = field(repr=False)
    upper_parameters: Vector | None = field(repr=False)
    identifiable: bool

    @property
    def width(self) -> float:
        """Upper minus lower end; 0 if identifiable."""
        return 0.0 if self.identifiable else self.upper - self.lower

    @property
    def relative_width(self) -> float:
        """The width over the largest size: 0 is identifiable; above 1 not even the sign is known."""
        size = max(abs(self.lower), abs(self.upper))
        if self.identifiable or size == 0.0:
            return 0.0
        return self.width / size if math.isfinite(size) else math.inf

    @property
    def bounded(self) -> bool:
        """Whether both ends are finite."""
        return math.isfinite(self.width)

    @property
    def tolerance(self) -> float:
        """Largest possible distance of the proved ends from the true ones."""
        ends = ((self.attained_lower, self.lower), (self.upper, self.attained_upper))
        return max((inner - outer for inner, outer in ends if math.isfinite(inner - outer)), default=0.0)

    def __contains__(self, value: float) -> bool:
        return self.lower <= value <= self.upper

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        name = self.meaning if self.meaning == self.name else f"{self.meaning} ({self.name})"
        subject = f"The {name}" if self.meaning != self.name else name
        if self.identifiable:
            return f"{subject} is {few_digits(self.attained_lower, 6)}{unit}: it is identifiable."
        low, high = outward(self.lower, self.upper)
        if self.bounded:
            return f"{subject} lies between {low} and {high}{unit}."
        if math.isfinite(self.lower):
            return f"{subject} is at least {low}{unit}; nothing bounds it from above."
        if math.isfinite(self.upper):
            return f"{subject} is at most {high}{unit}; nothing bounds it from below."
        return f"{subject} may have any value."

    def to_dict(self) -> dict[str, Any]:
        """Return the interval as plain data for JSON; infinite ends are None."""
        found: dict[str, Any] = plain(self)
        del found["lower_parameters"], found["upper_parameters"]
        return found


@dataclass(frozen=True, eq=False)
class ParameterIntervals:
    """The intervals of many quantities; ``intervals["m3"]`` is one of them.

    Attributes
    ----------
    intervals : tuple of ParameterInterval
    base : (n_b,)
    consistency : str
    confidence : float or None
        Probability of the region of base parameters; None for a point.
    distance : float
        Distance of the estimate from the set, relative to the size of the region; 0 if it is feasible.
    trace_bound : float
        The proofs hold for robots whose traces of all blocks (kg, kg m², ...) add up to less than this.
    """

    intervals: tuple[ParameterInterval, ...]
    base: Vector = field(repr=False)
    consistency: str
    confidence: float | None
    distance: float
    trace_bound: float

    def __getitem__(self, name: str) -> ParameterInterval:
        for interval in self.intervals:
            if interval.name == name:
                return interval
        raise InputError(f"there is no interval of {shown(name)}; these are {listed(i.name for i in self.intervals)}.")

    def __iter__(self) -> Iterator[ParameterInterval]:
        return iter(self.intervals)

    def __len__(self) -> int:
        return len(self.intervals)

    def sentences(self) -> tuple[str, ...]:
        """A summary of the table in sentences."""
        given = "these base parameters"
        if self.confidence is not None:
            given = f"base parameters in the {100 * self.confidence:g} % region of the estimate"
        identifiable = sum(i.identifiable for i in self.intervals)
        bounded = sum(i.bounded and not i.identifiable for i in self.intervals)
        found = [
            f'Possible values under "{self.consistency}" consistency, given {given}.',
            f"Of {len(self)} quantities, {identifiable} are identifiable, {bounded} more are bounded by what is "
            f"physically possible, and {len(self) - identifiable - bounded} are not bounded on one side at least.",
        ]
        if self.distance > 0:
            found.append(
                f"The estimate itself is infeasible; the nearest feasible one lies at {self.distance:.3g} of the way "
                "to the edge of the region."
            )
        return tuple(found)

    def _rows(self) -> list[tuple[str, ...]]:
        found: list[tuple[str, ...]] = []
        for i in self.intervals:
            low, high = outward(i.lower, i.upper) if not i.identifiable else (few_digits(i.attained_lower, 6),) * 2
            width = "open" if not i.bounded else percent(i.relative_width, 2)
            found.append((i.name, low, high, i.unit, "identifiable" if i.identifiable else width, i.meaning))
        return found

    def __str__(self) -> str:
        heads = ("name", "lower", "upper", "unit", "relative width", "meaning")
        return "\n".join((*self.sentences(), text_table(heads, self._rows(), numbers=(1, 2, 4))))

    def _repr_html_(self) -> str:
        return html_table(
            " ".join(self.sentences()), ("name", "lower", "upper", "unit", "relative width", "meaning"), self._rows()
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data for JSON."""
        return {
            "consistency": self.consistency,
            "confidence": self.confidence,
            "distance": self.distance,
            "trace_bound": self.trace_bound,
            "base": self.base.tolist(),
            "intervals": [interval.to_dict() for interval in self.intervals],
        }


def parameter_intervals(
    feasible_set: FeasibleSet,
    base: npt.ArrayLike | None = None,
    *,
    info: Any = None,
    covariance: npt.ArrayLike | ParameterCovariance | None = None,
    confidence: float = 0.95,
    weights: Any = "joint",
    names: Sequence[str] | None = None,
    combinations: Mapping[str, Combination] | None = None,
    solver: str = "clarabel",
) -> ParameterIntervals:
    """Find the interval of physically possible values of every parameter, given an estimate (thesis 8.1).

    Motion determines base parameters only, but not all standard parameters that have these are physically possible. So
    the mass of a link may be known to within a few per cent even though it is not identifiable.

    Parameters
    ----------
    feasible_set : FeasibleSet
        Its constraints narrow the intervals; a `TotalMass` bounds many of them.
    base : (n_b,), optional
        Base parameters β. Without `info` or `covariance` they are exact and must be feasible. With `info`
        the default is the least-squares solution.
    info : Information, optional
        The data: β may then be anywhere in the confidence region of the estimate, which accounts for correlation of the
        residuals in time if the Information has batch means.
    covariance : (n_b, n_b) or ParameterCovariance, optional
        Covariance of the base parameters, instead of `info`.
    confidence : float
        Probability that this region contains all base parameters together.
    weights : "joint", None or (N,)
        Weights of the joints in `info`, as in `least_squares`.
    names : sequence of str, optional
        The quantities: standard parameters, ``"total mass"``, and ``"cx2"``, ``"cy2"``, ``"cz2"``, the centre of
        mass of the second link in its own frame. By default all of them.
    combinations : mapping, optional
        Further quantities by name: rows (n,), or mappings from parameters to coefficients.
    solver : str
        As in `solve`.

    Returns
    -------
    ParameterIntervals
        The ends are proved by dual points and rounded outward; `attained_lower` and `attained_upper` are values of
        parameters inside the set.

    Raises
    ------
    InputError
        If no physically possible robot has these base parameters, or none within the region; or for a bad argument.
    SolverError
        If no parameters satisfy all conditions.

    See Also
    --------
    lightest_robot : The smallest masses only.

    Notes
    -----
    With K δ = β substituted into the conditions, c·δ is minimised and maximised over D(δ) ⪰ 0 (with a second-order
    cone for the region). A quotient such as a centre of mass is made linear after Charnes and Cooper
    (1962). All blocks are scaled by their own values at the analytic center, so that links of very different sizes do
    not disturb each other. A bound that is only approached as other masses grow without limit is found by facial
    reduction (Borwein and Wolkowicz 1981).

    Examples
    --------
    The motion of a pendulum determines its moment of inertia Lzz about the axis and its first moments lx and ly, but
    not its mass. It is at least (lx² + ly²) / Lzz, the mass of a pendulum that is a single point:

    >>> from steelyard.dynamics import Model
    >>> from steelyard.feasibility import FeasibleSet
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> model.base_parameters().names
    ('Lzz1', 'lx1', 'ly1')
    >>> print(parameter_intervals(FeasibleSet(model), base=[0.5, 1.0, 0.0])["m1"])
    The mass of link1 (m1) is at least 2 kg; nothing bounds it from above.
    """
    chosen = quantities(feasible_set, names, combinations)
    with one_thread():
        given = given_by(feasible_set, base, info, covariance, weights, confidence, solver)
        found = []
        for number, quantity in enumerate(chosen):
            tell("ends of the interval of each parameter", number, len(chosen), "intervals")
            found.append(interval_of(given.finder, quantity))
    return ParameterIntervals(
        tuple(found), given.base, feasible_set.consistency, given.confidence, given.distance, given.finder.trace_bound
    )


def interval_of(finder: BoundFinder, quantity: Quantity) -> ParameterInterval:
    """The interval of one quantity."""
    rows = (quantity.row,) if quantity.mass is None else (quantity.row, quantity.mass)
    identifiable = all(finder.center.slice.is_identifiable(row) for row in rows)
    if quantity.mass is None:
        low, high = finder.least(quantity.row), finder.least(-quantity.row)
    else:
        low = finder.least_ratio(quantity.row, quantity.mass, quantity.moments)
        high = finder.least_ratio(-quantity.row, quantity.mass, quantity.moments)
    return _interval(quantity, low, high, identifiable)


def _interval(quantity: Quantity, low: Bound, high: Bound, identifiable: bool) -> ParameterInterval:
    lower = max(low.proved, 0.0) if quantity.never_negative else low.proved
    return ParameterInterval(
        name=quantity.name,
        meaning=quantity.meaning,
        unit=quantity.unit,
        lower=min(lower, low.attained),
        upper=-high.proved,
        attained_lower=low.attained,
        attained_upper=-high.attained,
        lower_parameters=low.parameters,
        upper_parameters=high.parameters,
        identifiable=identifiable,
    )
