"""Check of all limits over the whole motion, at 1 kHz or finer: margins, and the repair of violations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from steelyard.conic import Cone, ConicProblem, Outcome, Rows, solve
from steelyard.errors import InputError
from steelyard.once import cached_property

from .design_problem import DesignProblem
from .family import Basis, Family, FourierFamily
from .motion_constraints import MotionConstraint

__all__ = ["Margin", "Verifier", "keeps_all", "margins_of"]

Array = NDArray[np.float64]
RATE = 1000.0  # Hz, at least
# Instants in one of the family's steps, and in a ramp, where 1 kHz would be fewer. So many miss 2e-5 of a peak between
# them; with 1 kHz alone, accelerations in a ramp of 1 ms were 600 times their limit.
_IN_STEP, _IN_RAMP = 12, 300
_MOST = 5e7  # instants times coefficients, which take 1.2 GB; with six harmonics an hour
_BLOCK = 2000  # samples in one call of a constraint, which bounds the memory
_ROUNDS = 12  # linearisations of a repair at most
# Part of the scale of a limit that a repair keeps free, because the motion between samples is not checked.
_SPARE = 2e-5
_NEAR = 0.05  # parts of a motion whose margin is below this part of the scale are constraints of the repair
_LONGEST_STEP = 1.0  # of a repair, in the 2-norm of the scaled coefficients


@dataclass(frozen=True)
class Margin:
    """The margin of a motion to one limit.

    Attributes
    ----------
    name : str
        The constraint, such as ``"velocity"`` or ``"table plane"``.
    label : str
        The part of the constraint, such as a joint and its limit.
    clearance : float
        The smallest distance from the limit, in the unit of the limit; negative where it is violated.
    fraction : float
        The clearance relative to the scale of the constraint.
    time : float
        Time of the smallest distance, s.
    beyond : bool
        Whether it is never nearer than what the constraint tells apart: the clearance is a lower bound of the smallest
        one then, and the time says nothing.
    """

    name: str
    label: str
    clearance: float
    fraction: float
    time: float
    beyond: bool = False

    @property
    def cells(self) -> tuple[str, str]:
        """The clearance and its time, for a table."""
        if self.beyond:
            return f"over {self.clearance:.4g}", "-"
        return f"{self.clearance:.4g}", f"{self.time:.3f}"

    def __str__(self) -> str:
        if self.beyond:
            return f"{self.name}, {self.label}: keeps over {self.clearance:.4g}"
        verb = "keeps" if self.clearance >= 0.0 else "passes its limit by"
        return f"{self.name}, {self.label}: {verb} {abs(self.clearance):.4g} at {self.time:.3f} s"


def margins_of(
    constraints: Sequence[MotionConstraint], t: Array, motion: tuple[Array, Array, Array]
) -> tuple[Margin, ...]:
    """Return the margin of every part of every constraint over sampled motion, (S, N) at times (S,)."""
    return _margins(constraints, t, [_in_blocks(c, motion) for c in constraints])


def _margins(constraints: Sequence[MotionConstraint], t: Array, clearances: Sequence[Array]) -> tuple[Margin, ...]:
    result = []
    for constraint, clearance in zip(constraints, clearances, strict=True):
        scale = np.broadcast_to(np.asarray(constraint.scale, dtype=np.float64), clearance.shape[1:])
        farthest = getattr(constraint, "farthest", None)
        for column, label in enumerate(constraint.labels):
            k = int(np.argmin(clearance[:, column]))
            least = float(clearance[k, column])
            beyond = farthest is not None and bool(least >= farthest[column])
            result.append(Margin(constraint.name, label, least, least / float(scale[column]), float(t[k]), beyond))
    return tuple(result)


def keeps_all(margins: Sequence[Margin]) -> bool:
    """Return whether no limit is violated."""
    return all(m.clearance >= 0.0 for m in margins)


def _in_blocks(constraint: MotionConstraint, motion: tuple[Array, Array, Array]) -> Array:
    count = len(motion[0])
    parts = [slice(k, k + _BLOCK) for k in range(0, count, _BLOCK)]
    return np.vstack([np.asarray(constraint.clearance(*(m[part] for m in motion))) for part in parts])


class Verifier:
    """Checks the motion, and repairs violations by the smallest change of the coefficients.

    It is checked at 1 kHz, and at more instants where it changes faster than 1 kHz shows.

    What repeats the first period (`telling` of Fourier series with slow passages) is left out: it would take most of
    the time where links are kept from each other. The motion that is returned in the end is checked as a whole.

    Parameters
    ----------
    whole : bool
        Whether repetitions count, too. Their samples lie between those of the first period, where fast motions pass a
        limit by more than a repair keeps free.

    Raises
    ------
    InputError
        If the motion is so long that its instants do not fit into the memory.
    """

    def __init__(self, family: Family, whole: bool = False) -> None:
        rate = max(RATE, _IN_STEP / family.step)
        if family.duration * rate * family.size > _MOST:
            raise InputError(
                f"A motion of {family.duration:g} s with {family.size} coefficients of each joint is too long for its "
                f"limits to be checked at {rate:g} Hz; give a shorter period, or fewer periods, harmonics or points."
            )
        times = np.arange(int(np.ceil(family.duration * rate - 1e-9)) + 1) / rate
        if isinstance(family, FourierFamily):
            times = times if whole else times[family.telling(times)]
            if family.ramp_time * rate < _IN_RAMP:
                ramps = [np.linspace(begin, end, _IN_RAMP + 1) for begin, end in family.ramps]
                times = np.unique(np.concatenate([times, *ramps]))
        self.family, self.times = family, times
        self._known: tuple[bytes, list[Array]] = (b"", [])

    @cached_property
    def basis(self) -> Basis:
        """The basis at `times`."""
        return self.family.basis(self.times)

    def margins(self, problem: DesignProblem, x: Array) -> tuple[Margin, ...]:
        """Return the margins of the motion with coefficients x."""
        return _margins(problem.constraints, self.times, self._clearances(problem, x))

    def _clearances(self, problem: DesignProblem, x: Array) -> list[Array]:
        """Return the clearances of every constraint over the whole motion; the last result is kept."""
        key = x.tobytes()
        known = self._known
        if known[0] != key:
            motion = problem.motion(x, self.basis)
            self._known = known = (key, [_in_blocks(c, motion) for c in problem.constraints])
        return known[1]

    def repaired(self, problem: DesignProblem, x: Array) -> Array | None:
        """Return coefficients near `x` that keep every limit at 1 kHz, or None where the repair does not succeed.

        Each round linearises the constraints that are violated or nearly violated, and takes the smallest change with
        which they hold, the solution of a convex quadratic programme (the Gauss-Newton method for inequalities).
        """
        now = x
        for _ in range(_ROUNDS):
            rows, needed = self._active(problem, now)
            if not len(rows) or needed.max() <= 0.0:
                return now
            change = _least_change(rows, needed + _SPARE)
            if change is None:
                return None
            now = now + change * min(1.0, _LONGEST_STEP / max(float(np.linalg.norm(change)), 1e-300))
        return now if keeps_all(self.margins(problem, now)) else None

    def _active(self, problem: DesignProblem, x: Array) -> tuple[Array, Array]:
        """Return the gradients (rows, N P) of small clearances, and the increases that they need, scaled."""
        motion = problem.motion(x, self.basis)
        rows: list[Array] = []
        needed: list[Array] = []
        for constraint, clearance in zip(problem.constraints, self._clearances(problem, x), strict=True):
            scale = np.broadcast_to(np.asarray(constraint.scale, dtype=np.float64), (len(constraint.labels),))
            fractions = clearance / scale
            for column in range(fractions.shape[1]):
                places = _lowest(fractions[:, column])
                if not len(places):
                    continue
                own = tuple(np.ascontiguousarray(m[places]) for m in motion)
                weights = np.zeros((len(places), fractions.shape[1]))
                weights[:, column] = 1.0 / scale[column]
                slopes = constraint.vjp(own[0], own[1], own[2], weights)
                gradient = sum(
                    slope[:, :, None] * b[places][:, None, :] for slope, b in zip(slopes, self.basis, strict=True)
                )
                rows.append((np.asarray(gradient) * problem.scale).reshape(len(places), -1))
                needed.append(_SPARE * 0.5 - fractions[places, column])
        if not rows:
            return np.zeros((0, problem.unknowns)), np.zeros(0)
        return np.vstack(rows), np.concatenate(needed)


def _lowest(values: Array) -> NDArray[np.intp]:
    """Return for each interval of small values the index of the least one, and some others in the interval."""
    near = values < _NEAR
    if not near.any():
        return np.zeros(0, dtype=np.intp)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(np.int8)))
    places: set[int] = set()
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        lowest = begin + int(np.argmin(values[begin:end]))
        step = max(1, (end - begin) // 8)
        places.update(k for k in range(lowest % step + begin - begin % step, end, step) if k >= begin)
        places.add(lowest)
    return np.array(sorted(places), dtype=np.intp)


def _least_change(rows: Array, needed: Array) -> Array | None:
    """Return the smallest vector d with ``rows d >= needed``, or None where there is none."""
    size = rows.shape[1]
    limits = Rows(-rows, -needed, Cone("nonnegative", len(rows)))
    squares = sparse.csc_array(sparse.eye_array(size))
    found = solve(ConicProblem.from_rows(np.zeros(size), [limits], squares, balanced=True))
    return found.primal if found.outcome in (Outcome.SOLVED, Outcome.ALMOST_SOLVED) else None
