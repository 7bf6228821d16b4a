"""The search for the best motion: several random starts in parallel, of which the best are refined."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, SolverError
from steelyard.files import read_whole, tell

from .design_problem import COARSE, FINE, DesignProblem, Iterate, minimise
from .limit_margins import Margin, Verifier, keeps_all
from .motion_constraints import remedy_of
from .motion_limits import MotionLimits
from .workers import Flag, Pool, Shares, pool_of

__all__ = ["Candidate", "Minimiser", "Search", "SearchOptions", "SearchResult", "resting_configurations"]

Array = NDArray[np.float64]
# Function of a problem, the (N P,) initial coefficients, and a function that tells whether to stop; returns better
# coefficients.
Minimiser = Callable[[DesignProblem, Array, Callable[[], bool]], Array]
# Random configurations among which those in which the robot may rest are looked for. They are examined in blocks until
# there are enough, so that only robots in narrow surroundings need all of them.
_CONFIGURATIONS = 4000
_REFINED = 4  # one in so many starts is refined, which takes about as long as all the starts together
_BEGUN, _SLOW = 64, 1e-9
"""Configurations of rest in which slow motion is looked at; and its speed, rad/s or m/s: friction has its sign."""
_SIZES, _REPAIRED = tuple(0.9 * 0.6**k for k in range(14)), -0.1
"""Of smaller motions that are tried where a refined one passes a limit: rest, of which they have more and more, passes
none; joints without limits of position may have turned hundreds of times. What passes by more than this part of a
limit's scale is not repaired, which takes most of the time."""
_ROUNDS = 3  # of a refinement at most; violated instants are added to the checked ones before the next round


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Number of starts, duration and method of the search for the best motion.

    Attributes
    ----------
    minimiser : callable, optional
        A function that minimises from each start. It is called with the :class:`DesignProblem`, the (N P,) initial
        coefficients, and a function that tells whether to stop, and returns better coefficients. By default the search
        uses the gradient and refines the best results.
    starts, seed : int
        Number of random starts, and seed of the random numbers.
    workers : int, optional
        Number of starts that run in parallel; the number of processors by default.
    time_limit : float, optional
        Time after which the search ends with the best motion so far, s.

    Raises
    ------
    InputError
        If an option is out of its range.
    """

    minimiser: Minimiser | None = None
    starts: int = 8
    seed: int = 0
    workers: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        for name, least in (("starts", 1), ("workers", 1), ("seed", 0)):
            number = getattr(self, name)
            if number is not None:
                read_whole(number, name, least)
        if self.time_limit is not None and not (np.isfinite(self.time_limit) and self.time_limit > 0.0):
            raise InputError(f"time_limit must be positive, got {self.time_limit!r}.")

    @property
    def method(self) -> str:
        """Name of the method: ``"gradient"``, or the name of the given minimiser."""
        given = self.minimiser
        return "gradient" if given is None else getattr(given, "__name__", type(given).__name__)


def _processors() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


@dataclass(frozen=True, eq=False)
class Candidate:
    """The result of one start.

    Attributes
    ----------
    index : int
        Index of the start.
    iterate : Iterate
        Final state of the minimisation.
    x : ndarray or None
        (N P,) coefficients that keep every limit at 1 kHz; None where the repair failed.
    figure : float
        Value of the criterion, with the exact sign of Coulomb friction.
    worst : Margin
        The smallest margin before the repair.
    in_the_way : Margin or None
        Of a motion that was made smaller, the smallest margin of that of full size.
    """

    index: int
    iterate: Iterate
    x: Array | None
    figure: float
    worst: Margin
    in_the_way: Margin | None = None


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The best candidate, the number of starts that were finished, and how the search ended."""

    best: Candidate
    finished: int
    status: str


@dataclass(eq=False)
class Search:
    """Runs the starts in parallel and refines the best results.

    Attributes
    ----------
    problem : DesignProblem
    verifier : Verifier
    figure : callable
        Returns the criterion, with the exact sign of Coulomb friction, for coefficients x.
    limits : MotionLimits
    options : SearchOptions
    say : callable
        Called with a short text after each step.
    """

    problem: DesignProblem
    verifier: Verifier
    figure: Callable[[Array], float]
    limits: MotionLimits
    options: SearchOptions
    say: Callable[[str], None]
    _halt: Flag = field(default_factory=Flag)
    _deadline: float = float("inf")
    _stage: str = ""
    _shares: Shares = field(default_factory=lambda: Shares(0))

    def run(self, configurations: Sequence[Array]) -> SearchResult:
        """Run the search.

        Parameters
        ----------
        configurations : sequence of ndarray
            (N,) each, configurations in which the robot may rest; each start moves about one of them.

        Raises
        ------
        SolverError
            If no start leads to a motion that keeps every limit.
        KeyboardInterrupt
            If the user interrupts the search before such a motion was found.
        """
        if self.options.time_limit is not None:
            self._deadline = time.monotonic() + self.options.time_limit
        found: dict[int, Candidate] = {}
        status = "finished"
        workers = min(self.options.workers or _processors(), self.options.starts)
        self._compile()
        self._shares = Shares(self.options.starts)
        with pool_of(self._work, workers) as pool:
            try:
                tasks = {k: (k, configurations[k % len(configurations)], None) for k in range(self.options.starts)}
                self._collect(pool, tasks, found)
                if self.options.minimiser is None and not self._stopped():
                    self._stage = "refining the best, "
                    for candidate in found.values():
                        self._shares.put(candidate.index, 0.0)
                    chosen = sorted(found.values(), key=self._rank)[: -(-self.options.starts // _REFINED)]
                    places = {c.index: configurations[c.index % len(configurations)] for c in chosen}
                    self._collect(pool, {c.index: (c.index, places[c.index], c) for c in chosen}, found)
            except KeyboardInterrupt:
                self._halt.set()
                status = "interrupted"
            except BrokenExecutor:
                raise SolverError(
                    "A process of the search was killed, perhaps because memory ran out; try workers=1."
                ) from None
        if status == "finished" and self._stopped():
            status = "time limit"
        if not found:
            raise KeyboardInterrupt
        best = min(found.values(), key=self._rank)
        if best.x is None:
            if status == "interrupted":
                raise KeyboardInterrupt
            margin = best.worst
            otherwise = "widen this limit, or give the motion more time (a longer period)"
            remedy = remedy_of(self.problem.constraints, margin.name, margin.label, otherwise)
            raise SolverError(
                f"No motion was found that keeps every limit: in the best of {len(found)} attempts {margin.name}, "
                f"{margin.label}, is passed by {-margin.clearance:.4g} at {margin.time:.3f} s; {remedy}, or try "
                "more starts."
            )
        return SearchResult(best, len(found), status)

    def _collect(self, pool: Pool, tasks: Mapping[int, tuple[Any, ...]], found: dict[int, Candidate]) -> None:
        """Run tasks in the pool, and keep results that are better than those found before."""
        waiting: dict[Future[Candidate | None], int] = {pool.submit(*task): k for k, task in tasks.items()}
        try:
            while waiting:
                done, _ = wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED)
                under_way = len(tasks) - len(waiting) + sum(self._shares.get(k) for k in waiting.values())
                tell(f"{self._stage}searching", under_way, len(tasks), "starts")
                for future in sorted(done, key=lambda f: waiting[f]):
                    self._keep(future, waiting.pop(future), found, len(tasks) - len(waiting), len(tasks))
        except KeyboardInterrupt:
            self._halt.set()
            for future in waiting:
                future.cancel()
            for future, k in waiting.items():
                if not future.cancelled():
                    self._keep(future, k, found, 0, 0)
            raise

    def _keep(
        self, future: Future[Candidate | None], k: int, found: dict[int, Candidate], number: int, total: int
    ) -> None:
        candidate = future.result()
        if candidate is None:
            return
        if k not in found or self._rank(candidate) < self._rank(found[k]):
            found[k] = candidate
        if number:
            best = min(found.values(), key=self._rank)
            ours = "limits not kept" if candidate.x is None else f"{candidate.figure:.5g}"
            known = "none yet" if best.x is None else f"{best.figure:.5g}"
            self.say(f"{self._stage}{number} of {total}: {self.problem.criterion.kind} {ours}, best {known}")

    def _rank(self, candidate: Candidate) -> tuple[bool, float, int]:
        if candidate.x is None:
            return True, -candidate.worst.fraction, candidate.index
        return False, self.problem.criterion.loss(candidate.figure), candidate.index

    def _stopped(self) -> bool:
        return self._halt.is_set() or time.monotonic() > self._deadline

    def _compile(self) -> None:
        """Call every function that is compiled at its first use, so that the workers share the compiled code."""
        problem = self.problem
        x = np.zeros(problem.unknowns)
        motion = problem.motion(x)
        problem.objective(motion, 1.0)
        for constraint in problem.constraints:
            constraint.vjp(*motion, np.zeros((len(motion[0]), len(constraint.labels))))
        self.figure(x)

    # One start

    def _work(self, k: int, configuration: Array, found: Candidate | None) -> Candidate | None:
        if found is not None:
            refined = self._refined(found)
            return refined if refined.x is not None else self._smaller(refined, configuration)
        if self._stopped() and k > 0:
            return None
        x = self._start(k, configuration)
        if self.options.minimiser is not None:
            return self._judged(k, Iterate(self.options.minimiser(self.problem, x, self._stopped), []))
        advance = partial(self._shares.put, k)
        made = self._judged(k, minimise(self.problem, Iterate(x, []), COARSE, self._stopped, advance))
        # Where the time is over, nothing will be refined; who interrupts a search does not wait.
        is_last = made.x is None and self._stopped() and not self._halt.is_set()
        return self._smaller(made, configuration) if is_last else made

    def _refined(self, candidate: Candidate) -> Candidate:
        problem, iterate = self.problem, candidate.iterate
        best = candidate
        rounds = FINE
        for _ in range(_ROUNDS):
            iterate = minimise(problem, iterate, rounds, self._stopped, partial(self._shares.put, candidate.index))
            found = self._judged(candidate.index, iterate)
            if self._rank(found) < self._rank(best):
                best = found
            if best.x is not None or self._stopped():
                break
            violated = [m.time for m in self.verifier.margins(problem, iterate.x) if m.clearance < 0.0]
            problem = problem.with_times(np.array(violated))
            rounds = FINE[-2:]
        return best

    def _smaller(self, candidate: Candidate, configuration: Array) -> Candidate:
        """Return the best of smaller motions about the configuration that keep every limit.

        Smaller than what the search came to, or than its start, of which joints without limits have not gone astray.
        """
        still, start = self._still(configuration), self._start(candidate.index, configuration)
        best = candidate
        sizes = _SIZES[3::3] if self._stopped() else _SIZES
        for whole in (candidate.iterate.x, start):
            for size in sizes:
                if self._halt.is_set():
                    return best
                x = still + size * (whole - still)
                if min(margin.fraction for margin in self.verifier.margins(self.problem, x)) < _REPAIRED:
                    continue
                found = self._judged(candidate.index, Iterate(x, []))
                if found.x is not None:
                    best = min(best, replace(found, in_the_way=candidate.worst), key=self._rank)
                    break
        return best

    def _judged(self, k: int, iterate: Iterate) -> Candidate:
        margins = self.verifier.margins(self.problem, iterate.x)
        worst = min(margins, key=lambda m: m.fraction)
        x = self.verifier.repaired(self.problem, iterate.x)
        if x is not None and not keeps_all(self.verifier.margins(self.problem, x)):
            x = None
        return Candidate(k, iterate, x, float("nan") if x is None else self.figure(x), worst)

    def _start(self, k: int, configuration: Array) -> Array:
        """Return random coefficients about a configuration, scaled so that the motion is mostly within its limits."""
        problem, still, random = self.problem, self._still(configuration), np.random.default_rng([self.options.seed, k])
        moving = random.standard_normal(problem.unknowns)
        if problem.family.name == "fourier":
            moving = (moving.reshape(problem.scale.shape) * (problem.family.constant == 0.0)).ravel()
        whole, rest = (problem.clearances(problem.motion(v)) for v in (still + moving, still))
        size = 1.0
        for after, before in zip(whole, rest, strict=True):
            fall = np.maximum(before - after, 1e-12)
            size = min(size, float(np.min(np.maximum(before, 0.02) / fall)))
        return np.asarray(still + max(size, 0.02) * moving)

    def _still(self, configuration: Array) -> Array:
        """Return the coefficients of rest in a configuration."""
        problem = self.problem
        return ((configuration - problem.center)[:, None] * problem.family.constant / problem.scale).ravel()


def resting_configurations(
    problem: DesignProblem, limits: MotionLimits, seed: int, count: int
) -> tuple[tuple[Array, ...], tuple[str, str, str] | None]:
    """Return configurations (N,) in which the robot can rest within all limits, and begin to move either way.

    The middle of the ranges comes first, where the robot can rest in it. The others are random; those with the largest
    margins come first. Friction that takes all of a drive's torque shows where a joint begins to move.

    Parameters
    ----------
    count : int
        Largest number of configurations.

    Returns
    -------
    configurations : tuple of ndarray
        Empty where no such configuration was found.
    obstacle : tuple of str or None
        In this case "rest" or "move slowly", and name and label of the constraint that the fewest configurations keep.
    """
    half = 0.5 * (limits.upper - limits.lower)
    half = np.where(np.isfinite(half), half, np.pi)
    random = np.random.default_rng([seed, 2**31])
    q = problem.center + np.vstack(
        [np.zeros_like(half), random.uniform(-0.9, 0.9, (_CONFIGURATIONS, len(half))) * half]
    )
    room = np.full(len(q), np.inf)
    fewest = (len(q) + 1, "", "")
    for begin in range(0, len(q), 500):  # until enough configurations are found
        part = slice(begin, begin + 500)
        room[part], name, label, kept = _room(problem, q[part], 0.0)
        if begin == 0:
            fewest = (kept, name, label)
        if (room[: begin + 500] >= 0.0).sum() >= count:
            room[begin + 500 :] = -1.0
            break
    free = np.flatnonzero(room >= 0.0)
    if not len(free):
        return (), ("rest", *fewest[1:])
    best = free[np.argsort(-room[free], kind="stable")][:_BEGUN]
    chosen = np.unique(np.concatenate([free[free == 0], best]))
    ways = [_room(problem, q[chosen], speed) for speed in (_SLOW, -_SLOW)]
    moving = np.minimum(*(way[0] for way in ways))
    if not (moving >= 0.0).any():
        _, name, label, _ = min(ways, key=lambda way: way[3])
        return (), ("move slowly", name, label)
    found = chosen[moving >= 0.0]
    first = [0] if found[0] == 0 else []
    order = [int(k) for k in best if k > 0 and k in found]
    return tuple(q[k] for k in [*first, *order][:count]), None


def _room(problem: DesignProblem, q: Array, speed: float) -> tuple[Array, str, str, int]:
    """Return the least clearance of each configuration, relative to its scale, where all joints have a speed.

    And name and label of the constraint that the fewest configurations keep, and how many do.
    """
    own = np.ascontiguousarray(q)
    still = np.zeros_like(own)
    room, fewest = np.full(len(own), np.inf), (len(own) + 1, "", "")
    for constraint in problem.constraints:
        if not len(constraint.labels):
            continue
        fractions = np.asarray(constraint.clearance(own, still + speed, still)) / np.asarray(constraint.scale)
        column = int(np.argmin((fractions >= 0.0).sum(axis=0)))
        kept = int((fractions[:, column] >= 0.0).sum())
        if kept < fewest[0]:
            fewest = (kept, constraint.name, constraint.labels[column])
        room = np.minimum(room, fractions.min(axis=1))
    return room, fewest[1], fewest[2], fewest[0]
