"""Drive gains: the torque that a unit of current makes, found together with the robot from something that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import few_digits, html_table, outward, text_table
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.constraints import Equality
from steelyard.feasibility.nearest_point import nearest_in_region
from steelyard.files import read_number
from steelyard.lmi import AffineBlock
from steelyard.once import cached_property
from steelyard.regression import Information, ParameterCovariance
from steelyard.regression.parameter_covariance import NORMAL
from steelyard.robot import INERTIA_SYMBOLS, Inertia

from .carried_body import CarriedBody, CarryingModel, OfTheRobot
from .pooling import Share, pooled

__all__ = ["DriveGains", "KnownPayload", "estimate_drive_gains", "gains_from_equations"]

Array = NDArray[np.float64]

STEPS = 50
"""The most steps of the search; ten are usual."""

SETTLED = 1e-10
"""Relative change of the squared residual with which they have converged."""

NOISE_FREE = 1e-9
"""The least noise of the currents, relative to them: joints without noise would get an infinite weight."""

NOT_THE_PAYLOAD = 1.5
"""Ratio of the errors with and without regard to physics from which the payload cannot be the one that is stated; equal
logs, and swapped ones, reach ten and more, while a robot on the boundary of what is possible costs a few per cent."""

LEAST_ERROR = 1e-3
"""Smaller errors without regard to physics count as this one."""

PASSES = 4
"""Passes of the linear start, each with the weights of the one before."""


@dataclass(frozen=True, eq=False)
class KnownPayload:
    """A payload of which some values are known, in the mounting frame.

    Parameters
    ----------
    mass : float
        kg.
    center_of_mass : (3,) array_like, optional
        m.
    about_com : (3, 3) array_like, optional
        Inertia about the centre of mass, kg m²; needs the centre.

    Examples
    --------
    >>> KnownPayload(2.0, (0, 0, 0.1)).known
    {'m': 2.0, 'lx': 0.0, 'ly': 0.0, 'lz': 0.2}
    """

    mass: float
    center_of_mass: ArrayLike | None = None
    about_com: ArrayLike | None = None

    def __post_init__(self) -> None:
        read_number(self.mass, "the mass of the known payload", "a positive number of kg", above=0.0)
        for name, shape in (("center_of_mass", (3,)), ("about_com", (3, 3))):
            value = getattr(self, name)
            if value is None:
                continue
            array = np.asarray(value, dtype=float)
            if array.shape != shape or not np.all(np.isfinite(array)):
                raise InputError(f"{name} of the known payload must be {shape} finite numbers, got {value!r}.")
        if self.about_com is not None and self.center_of_mass is None:
            raise InputError("The inertia of a known payload is about its centre of mass: give center_of_mass, too.")

    @property
    def known(self) -> dict[str, float]:
        """Values of those of its ten parameters that follow."""
        found = {"m": float(self.mass)}
        if self.center_of_mass is None:
            return found
        center = np.asarray(self.center_of_mass, dtype=float)
        found |= {f"l{axis}": float(self.mass * value) for axis, value in zip("xyz", center, strict=True)}
        if self.about_com is not None:
            body = Inertia.from_com(self.mass, center, np.asarray(self.about_com, dtype=float))
            found |= dict(zip(INERTIA_SYMBOLS[:6], body.parameters[:6].tolist(), strict=True))
        return found


@dataclass(frozen=True, eq=False)
class _Given:
    """A known payload as a constraint on the parameters of robot and payload."""

    payload: KnownPayload
    number: int

    def blocks(self, model: Any) -> tuple[AffineBlock, ...]:
        return ()

    def equalities(self, model: Any) -> tuple[Equality, ...]:
        names = list(model.parameter_names)
        return tuple(
            Equality(f"{symbol} of the payload", np.array([names.index(f"{symbol}{self.number}")]), np.ones(1), value)
            for symbol, value in self.payload.known.items()
        )


@dataclass(frozen=True, eq=False)
class DriveGains:
    """Drive gains, N·m (or N) in a unit of the logs, with 95 % intervals.

    Attributes
    ----------
    joint_names : tuple of str
    gains : ndarray
        (N,); 1 where they were not asked for. Those that fit the currents best with a possible robot.
    lower, upper : ndarray
        (N,) 95 % intervals; infinite on one side where the data do not tell a gain from a larger one.
    found : ndarray of bool
        (N,) which were asked for.
    parameters : ndarray
        Of robot and payload, or of the robot alone: feasible, and what the gains belong to.
    distance : float
        How far from what the data say the nearest possible robot is, in standard deviations.
    relative_error : float
        Of the currents, over all joints of equal weight; 0.05 means 5 %.
    remarks : tuple of str
    """

    joint_names: tuple[str, ...]
    gains: Array
    lower: Array
    upper: Array
    found: NDArray[np.bool_]
    parameters: Array = field(repr=False)
    distance: float
    relative_error: float
    remarks: tuple[str, ...] = ()

    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for name, gain, low, high, asked in zip(
            self.joint_names, self.gains, self.lower, self.upper, self.found, strict=True
        ):
            ends = outward(float(low), float(high)) if asked else ("", "")
            rows.append((name, few_digits(float(gain)) if asked else "given", *ends))
        return rows

    def __str__(self) -> str:
        return text_table(("joint", "gain", "from", "to"), self._rows(), numbers=(1, 2, 3))

    def _repr_html_(self) -> str:
        return html_table("Drive gains, 95 % intervals", ("joint", "gain", "from", "to"), self._rows(), self.remarks)


@in_one_thread
def estimate_drive_gains(
    body: CarriedBody,
    loaded: Information,
    unloaded: Information,
    payload: KnownPayload,
    find: Sequence[bool] | None = None,
    *,
    consistency: Any = "full",
    constraints: Sequence[Any] = (),
    solver: str = "clarabel",
) -> DriveGains:
    """Find drive gains from the currents of a robot without and with a payload that is known.

    Currents alone tell a robot's parameters up to the gains, and the gains only beside each other, since heavier links
    with stronger drives need the same currents. A known payload in one of two logs sets the scale (Gautier and Briot
    2011). It is enough to know its mass.

    Parameters
    ----------
    body : CarriedBody
        Where the payload is mounted.
    loaded, unloaded : Information
        Of logs that hold currents in the place of torques, or torques at joints whose gains are known.
    payload : KnownPayload
    find : sequence of bool, optional
        (N,) which gains are to be found; all where absent.
    consistency, constraints
        Of the robot, see :class:`steelyard.FeasibleSet`; link masses and other equations that constraints state help to
        set the scale.
    solver : str

    Raises
    ------
    InputError
        If the data do not fit the model, or what is known does not tell the scale of the gains.

    Notes
    -----
    The noise is in the currents. With the currents as regressors, as in equation 18 of the paper, least squares return
    gains that are too small by the square of noise over what the payload adds; the paper takes total least squares
    against that. Here the currents stay on the left: ``i_k = W_k x / g_k + noise``, which is linear in x and in 1 / g_k
    by itself, and is solved by Gauss-Newton from that linear start. All of it works on the triangular factors, and the
    covariance of the linearised regression is corrected for residuals that are correlated in time.

    References
    ----------
    M. Gautier and S. Briot, New method for global identification of the joint drive gains of robots using a known
    payload mass, IEEE/RSJ International Conference on Intelligent Robots and Systems, 2011.

    Examples
    --------
    >>> import steelyard as sy
    >>> arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.3, 0, "q")])
    >>> model = sy.Model(arm)
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 400, 3))
    >>> links = np.tile(sy.Inertia.from_com(2.0, [-0.1, 0, 0], 0.02 * np.eye(3)).parameters, 3)
    >>> held = sy.Inertia.from_com(0.5, [0, 0, 0.1], 0.001 * np.eye(3)).parameters
    >>> both = (links, links + np.concatenate([np.zeros(20), held]))
    >>> currents = [model.inverse_dynamics(q, dq, ddq, parameters) / [9, 8, 5] for parameters in both]
    >>> alone, loaded = (
    ...     sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=one)) for one in currents
    ... )
    >>> estimate_drive_gains(CarriedBody(model, 2), loaded, alone, KnownPayload(0.5)).gains.round(4).tolist()
    [9.0, 8.0, 5.0]
    """
    model = CarryingModel(body)
    base = model.base_parameters()
    alone, carrying = model.maps
    currents = pooled([Share(unloaded, [alone]), Share(loaded, [carrying])], base.names, base.expressions)
    kept = [OfTheRobot(constraint, body.model) for constraint in constraints]
    known = _Given(payload, len(body.model.robot.links) + 1)
    feasible_set = FeasibleSet(model, consistency, [*kept, known])
    return gains_from_equations(currents, feasible_set, find, solver=solver)


def gains_from_equations(
    currents: Information, feasible_set: FeasibleSet, find: Sequence[bool] | None = None, *, solver: str = "clarabel"
) -> DriveGains:
    """Find drive gains where equations of the feasible set say something of the base parameters.

    Parameters
    ----------
    currents : Information
        About the base parameters of the set, with each joint's rows apart.
    feasible_set : FeasibleSet
        Its equations, such as those of a `TotalMass` or a `LinearBound`, set the scale.
    find, solver
        As in `estimate_drive_gains`.

    Raises
    ------
    InputError
        If joints are not apart, or the equations do not tell the scale of the gains.
    """
    count = len(currents.joint_names)
    asked = np.ones(count, dtype=bool) if find is None else np.asarray(find, dtype=bool)
    if asked.shape != (count,) or not asked.any():
        raise InputError(f"find must say of each of the {count} joints whether its gain is to be found; got {find!r}.")
    if not currents.by_joint:
        raise InputError("Drive gains need the rows of each joint apart: leave out the covariance across the joints.")
    if asked.all() and not np.any(feasible_set.base_equations[1]):
        raise InputError(
            "All drive gains are to be found, but nothing that is known sets their scale; give the mass of the "
            "payload, its centre of mass as well where the joints do not tell one from the other, or equations in "
            "[constraints] of which the motion tells something."
        )
    return _Search(currents, feasible_set, asked).found(solver)


class _Search:
    """The currents ``ρ_k = h_k R_k x`` of all joints, with x = origin + directions ξ and h = 1 / g.

    The h of the joints that are `asked`, (N,), are unknown; the others are 1.
    """

    def __init__(self, currents: Information, feasible_set: FeasibleSet, asked: NDArray[np.bool_]) -> None:
        self.currents, self.feasible_set, self.asked = currents, feasible_set, asked
        left, right = feasible_set.base_equations
        self.origin = np.linalg.lstsq(left, right)[0] if len(left) else np.zeros(currents.base_count)
        rank = int(np.linalg.matrix_rank(left)) if len(left) else 0
        self.directions = np.linalg.svd(left)[2][rank:].T if rank else np.eye(currents.base_count)
        self.R = []
        self.rho = []
        for factor in currents.factors:
            full = np.zeros((len(factor.triangle), currents.base_count))
            full[:, factor.columns] = factor.triangle[:, :-1]
            self.R.append(full)
            self.rho.append(factor.triangle[:, -1])
        self.counts = np.array([max(factor.count, 1) for factor in currents.factors])
        silent = [n for n, r, a in zip(currents.joint_names, self.rho, asked, strict=True) if a and not np.any(r)]
        if silent:
            raise InputError(f"The gain of {silent[0]} is to be found, but the logs hold no current of it.")

    @cached_property
    def sizes(self) -> Array:
        """Lengths of the currents, (N,)."""
        return np.array([max(float(np.linalg.norm(one)), 1e-300) for one in self.rho])

    @cached_property
    def noise(self) -> Array:
        """Standard deviations of the currents' noise, from each joint by itself, which needs no gain, (N,)."""
        floor = NOISE_FREE * self.sizes / np.sqrt(self.counts)
        freedom = np.maximum(self.counts - np.array([len(f.columns) for f in self.currents.factors]), 1)
        # The last element of a triangle is no residual where columns before it depend on each other.
        left = [rho - R @ _least_squares(R, rho) for R, rho in zip(self.R, self.rho, strict=True)]
        lost = np.array([float(np.linalg.norm(one)) for one in left])
        return np.asarray(np.maximum(lost / np.sqrt(freedom), floor))

    def started(self, corrected: bool = True) -> tuple[Array, Array]:
        """ξ and h of the linear regression ``g_k ρ_k = R_k x``.

        Parameters
        ----------
        corrected : bool
            Whether what the noise of the currents adds to their squares is taken from them. Otherwise gains are too
            small, and the search may end with those of weak joints at nothing.
        """
        free, (columns,) = self.directions.shape[1], np.nonzero(self.asked)
        gains = np.ones(len(self.rho))
        for _ in range(PASSES):
            weights = 1.0 / (np.abs(gains) * self.noise)
            rows, targets, excess = [], [], np.zeros(free + len(columns))
            for k, (R, rho, weight) in enumerate(zip(self.R, self.rho, weights, strict=True)):
                row = np.zeros((len(R), free + len(columns)))
                row[:, :free] = -R @ self.directions
                target = R @ self.origin
                if self.asked[k]:
                    place = free + int(np.searchsorted(columns, k))
                    row[:, place] = rho
                    excess[place] = self.counts[k] * (weight * self.noise[k]) ** 2
                else:
                    target = target - rho
                rows.append(weight * row)
                targets.append(weight * target)
            matrix, target = np.vstack(rows), np.concatenate(targets)
            normal = matrix.T @ matrix - np.diag(excess if corrected else 0.0 * excess)
            lengths = np.linalg.norm(matrix, axis=0)
            scale = np.where(lengths > 0.0, lengths, 1.0)
            inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-13, hermitian=True)
            solution = (inverse @ ((matrix.T @ target) / scale)) / scale
            gains[columns] = solution[free:]
            largest = float(np.abs(gains[columns]).max()) or 1.0
            gains[columns] = np.where(np.abs(gains[columns]) > 1e-6 * largest, gains[columns], 1e-3 * largest)
        return solution[:free], 1.0 / gains

    def residuals(self, x: Array, h: Array) -> list[Array]:
        """``ρ_k - h_k R_k x``."""
        return [rho - scale * (R @ x) for rho, scale, R in zip(self.rho, h, self.R, strict=True)]

    def settled(self) -> tuple[Array, Array, Array]:
        """x and h of the least weighted residual, and the weights of the joints."""
        from scipy.optimize import least_squares

        (columns,) = np.nonzero(self.asked)
        xi, h = self.started()
        free, values, weights = len(xi), np.concatenate([xi, h[columns]]), 1.0 / self.noise

        def unknowns(values: Array) -> tuple[Array, Array]:
            h = np.ones(len(self.rho))
            h[columns] = values[free:]
            return self.origin + self.directions @ values[:free], h

        def weighted(values: Array) -> Array:
            return np.concatenate([w * r for w, r in zip(weights, self.residuals(*unknowns(values)), strict=True)])

        def slopes(values: Array) -> Array:
            x, h = unknowns(values)
            found = [np.zeros((len(R), len(values))) for R in self.R]
            for k, (own, R) in enumerate(zip(found, self.R, strict=True)):
                own[:, :free] = -weights[k] * h[k] * (R @ self.directions)
                if self.asked[k]:
                    own[:, free + int(np.searchsorted(columns, k))] = -weights[k] * (R @ x)
            return np.vstack(found)

        for _ in range(2):  # with weights of each joint by itself, then with those of the common residuals
            found = least_squares(
                weighted, values, slopes, x_scale="jac", ftol=SETTLED, xtol=None, gtol=None, max_nfev=STEPS
            )
            values = found.x
            x, h = unknowns(values)
            errors = [float(r @ r) / n for r, n in zip(self.residuals(x, h), self.counts, strict=True)]
            weights = 1.0 / np.maximum(np.sqrt(errors), NOISE_FREE * self.sizes / np.sqrt(self.counts))
        return x, h, weights

    def linearised(self, x: Array, h: Array) -> Information:
        """The regression of small changes of ξ and h."""
        (columns,) = np.nonzero(self.asked)
        free = self.directions.shape[1]
        maps = []
        for k, scale in enumerate(h):
            matrix = np.zeros((len(x), free + len(columns)))
            matrix[:, :free] = scale * self.directions
            if self.asked[k]:
                matrix[:, free + int(np.searchsorted(columns, k))] = x
            maps.append(matrix)
        names = [*(f"change {number}" for number in range(free)), *(self.currents.joint_names[k] for k in columns)]
        return pooled([Share(self.currents, maps, [scale * x for scale in h])], names)

    def found(self, solver: str) -> DriveGains:
        """Gains, intervals, and the nearest possible robot."""
        x, h, weights = self.settled()
        (columns,) = np.nonzero(self.asked)
        free = self.directions.shape[1]
        changes = self.linearised(x, h)
        covariance = ParameterCovariance.of(changes, np.zeros(changes.base_count), weights)
        errors = covariance.standard_error[free:]
        names = [self.currents.joint_names[k] for k in columns]
        open_ones = [name for name, error in zip(names, errors, strict=True) if not np.isfinite(error)]
        # Equal logs leave errors that are infinite but for rounding, and then no gain has an interval with two ends.
        if not np.any(NORMAL * errors < np.abs(h[columns])):
            open_ones = names
        if open_ones:
            raise InputError(
                f"The data do not tell the drive gain of {', '.join(open_ones)}: the payload does not change its "
                "current in a way that nothing else does; move it more, fix the payload further out, or give the gain."
            )
        lower, upper = np.full(len(h), np.nan), np.full(len(h), np.nan)
        for k, error in zip(columns, errors, strict=True):
            lower[k], upper[k] = _inverted(float(h[k]), NORMAL * float(error))
        nearest = nearest_in_region(
            self.feasible_set,
            x,
            self.directions @ covariance.root[:free],
            self.directions @ covariance.unidentifiable[:free],
            solver,
        )
        possible = self.feasible_set.K @ nearest.parameters
        gains = np.ones(len(h))
        for k in columns:
            predicted = self.R[k] @ possible
            gains[k] = float(predicted @ predicted) / float(predicted @ self.rho[k])
        alone, both = (self._relative_error(*one) for one in ((x, h), (possible, 1.0 / gains)))
        if both > NOT_THE_PAYLOAD * max(alone, LEAST_ERROR):
            raise InputError(
                f"No possible robot has these currents with this payload: they are explained to {both:.1%}, by any "
                f"gains and parameters to {alone:.1%}. Check which log is which, what is known of the payload and "
                "where it is mounted, and which gains are stated."
            )
        # Gains of a possible robot, where the nearest one lies at a distance, are beside those of the data alone.
        lower[columns] = np.minimum(lower[columns], gains[columns])
        upper[columns] = np.maximum(upper[columns], gains[columns])
        remarks = list(self.currents.remarks)
        turned = [self.currents.joint_names[k] for k in columns if gains[k] < 0]
        if turned:
            remarks.append(
                f"The gain of {', '.join(turned)} is negative: positive current turns the joint against its positive "
                "direction; set torque_sign in [log]."
            )
        unsure = [self.currents.joint_names[k] for k in columns if not np.isfinite(upper[k] - lower[k])]
        if unsure:
            remarks.append(
                f"The gain of {', '.join(unsure)} is known to be no smaller, but may be as large as any: the payload "
                "hardly shows in its current; fix it further out, or move that joint more."
            )
        return DriveGains(
            joint_names=tuple(self.currents.joint_names),
            gains=gains,
            lower=lower,
            upper=upper,
            found=self.asked,
            parameters=nearest.parameters,
            distance=nearest.distance,
            relative_error=both,
            remarks=tuple(remarks),
        )

    def _relative_error(self, x: Array, h: Array) -> float:
        """Return the relative error of the currents, over all joints of equal weight."""
        pairs = zip(self.residuals(x, h), self.sizes, strict=True)
        return float(np.sqrt(np.mean([float(r @ r) / size**2 for r, size in pairs])))


def _inverted(h: float, half: float) -> tuple[float, float]:
    """The interval of 1 / h where h is known to ± half."""
    ends = [h - half, h + half]
    if ends[0] <= 0.0 <= ends[1]:
        return (1.0 / ends[1], np.inf) if h > 0 else (-np.inf, 1.0 / ends[0])
    low, high = sorted(1.0 / end for end in ends)
    return low, high


def _least_squares(matrix: Array, target: Array) -> Array:
    """Least squares with columns of length one."""
    lengths = np.linalg.norm(matrix, axis=0)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    return np.asarray(np.linalg.lstsq(matrix / scale, target, rcond=1e-10)[0] / scale)
