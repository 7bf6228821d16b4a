"""The recursive search for virtual parameters (Yoshida and Khalil 2000; thesis 2.6.6, 6.2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.feasibility import FeasibilityCertificate, FeasibleSet
from steelyard.lmi.affine import is_positive_definite

from .link_regions import SMALL_MARGIN, Demand, regions_of_links
from .method import Progress

__all__ = ["VirtualParameterSearch", "Yoshida2000"]

Vector = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

ROUNDING = 1e-12
"""Relative accuracy of sums of floating-point numbers here."""

CANCELLED = 1e-7
"""Coefficients of parameters that are smaller than this, relative to the largest, have cancelled."""


@dataclass(frozen=True, eq=False)
class VirtualParameterSearch:
    """The result of a search for virtual parameters.

    Attributes
    ----------
    status : str
        ``"feasible"``, ``"infeasible"`` or ``"undecided"``.
    parameters : (n,) or None
        Virtual parameters, which prove that the base parameters are feasible.
    direction : (n_b,) or None
        Where infeasible: its product with the base parameters is negative, which it is with no feasible ones (but for
        constants of constraints). A result of floating point; `steelyard.check` gives a proof.
    tries : int
        Regions that were looked into.
    dimensions : tuple of int
        Unknowns of each link's region, from the tip to the base.
    reasons : tuple of str
        What happened, in sentences.
    """

    status: str
    parameters: Vector | None = field(repr=False)
    direction: Vector | None = field(repr=False)
    tries: int
    dimensions: tuple[int, ...]
    reasons: tuple[str, ...]

    @property
    def feasible(self) -> bool | None:
        """None where undecided."""
        return {"feasible": True, "infeasible": False}.get(self.status)

    def __str__(self) -> str:
        return "\n".join((f"{self.status.capitalize()} after {self.tries} regions.", *self.reasons))


@dataclass(frozen=True)
class Yoshida2000:
    """A feasibility test of base parameters: link by link from the tip, standard parameters that make them are sought.

    The base parameters of a link fix all its standard parameters but three (those that regroup to the links before:
    a mass, a first moment along the joint's axis, a moment of inertia), once those of the links beyond are chosen. The
    region of three dimensions in which the link is possible is looked into, a point is chosen, what it regroups is
    carried to the link before, and so on. If the base is reached, all links are possible, and so are the base
    parameters. If a region is empty, another point is chosen at a link before.

    The paper looks at graphs of the regions and leaves the choices to whoever does. Here the regions are solved as
    semidefinite programs in their few unknowns, which tell the largest margin of a region; the points chosen are light
    ones, since what is heavy must be carried by the links before.

    Parameters
    ----------
    learning : bool
        What happens at an empty region. False: trial and error as in the paper; other points of the links beyond are
        tried, `choices` at each. Then infeasibility is recognised only where a region is empty whatever was chosen
        before, and many estimates stay undecided. True, not of the paper: the dual of the empty region says which
        linear combination of the links beyond must not be negative, and that joins their conditions (nested cuts of
        Benders), until points are found or nothing is left of a region.
    tries : int
        Most regions to look into.
    choices : int
        Points to try in each region, without learning: the lightest, the middle, then halfway to random sides.
    seed : int
        Of those.

    See Also
    --------
    steelyard.check : Decides with a proof, for all links at once.

    Notes
    -----
    It fails honestly, with the status ``"undecided"``, where the number of tries is used up, where the base parameters
    are so close to the boundary that rounding decides, as published optima are, and where only parameters of tonnes
    could do, which it meets when it goes on and on learning.

    More than three unknowns are in a region where no torque depends on some parameters of the link, as with those at
    the base and of planar arms, and where drives have more parameters than can be told apart.

    References
    ----------
    K. Yoshida, W. Khalil, Verification of the positive definiteness of the inertial matrix of manipulators using base
    inertial parameters, International Journal of Robotics Research 19 (2000).

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> feasible_set = sy.FeasibleSet(model)
    >>> model.base_parameters().expressions[:3]
    ('Lzz1 - m1 - m2', 'lx1 + m1 + m2', 'ly1')
    >>> base = model.base_parameters().values([1.0, 0, 0, 1, 0, 1, 0, 0, 0, 3.0] * 2)
    >>> search = Yoshida2000().check(feasible_set, base)
    >>> search.status, search.dimensions
    ('feasible', (7, 7))
    >>> print(Yoshida2000().check(feasible_set, [1.0, 1.0, 0.0, -0.1, 0.0, 0.0]))
    Infeasible after 1 regions.
    The region of link 2 (link2) is empty, whatever the links beyond it are.
    """

    learning: bool = True
    tries: int = 500
    choices: int = 4
    seed: int = 0

    name: ClassVar[str] = "Yoshida and Khalil 2000"
    source: ClassVar[str] = (
        "K. Yoshida, W. Khalil, Verification of the positive definiteness of the inertial matrix of manipulators using "
        "base inertial parameters, International Journal of Robotics Research 19 (2000)."
    )

    def __post_init__(self) -> None:
        for name in ("tries", "choices"):
            if not (isinstance(getattr(self, name), int) and getattr(self, name) >= 1):
                raise InputError(f"{name} must be a positive integer, got {getattr(self, name)!r}.")

    def check(
        self, feasible_set: FeasibleSet, base: npt.ArrayLike, *, progress: Progress | None = None
    ) -> VirtualParameterSearch:
        """Look for virtual parameters.

        Parameters
        ----------
        feasible_set : FeasibleSet
            ``"inertia"`` is the paper's; without equations.
        base : (n_b,)
        progress : callable, optional
            Is told what happens.

        Returns
        -------
        VirtualParameterSearch

        Raises
        ------
        InputError
            If the base parameters do not fit the model, or the set has equations.
        """
        if feasible_set.equalities:
            raise InputError(
                f"the search for virtual parameters knows inequalities alone, but the set has the equation "
                f"{feasible_set.equalities[0].name}; leave it out, or use steelyard.check."
            )
        with one_thread():
            return _Search(self, feasible_set, feasible_set.as_base(base), progress).run()


class _Search:
    """One search, from the tip to the base and back."""

    def __init__(self, method: Yoshida2000, feasible_set: FeasibleSet, base: Vector, progress: Progress | None) -> None:
        self.method, self.feasible_set, self.base, self.progress = method, feasible_set, base, progress
        self.regions, self.known = regions_of_links(feasible_set)
        self.size = max(float(np.abs(base).max(initial=0.0)), 1e-300)
        self.unknowns = np.zeros(feasible_set.unidentifiable.shape[1])
        self.largest = self.unknowns
        self.demands: list[list[Demand]] = [[] for _ in self.regions]
        self.random = np.random.default_rng(method.seed)
        self.emptied: dict[str, int] = {}
        self.tries = 0

    def run(self) -> VirtualParameterSearch:
        """Go from link to link."""
        for block in self.known:
            matrix = block.evaluate(self.feasible_set.lift @ self.base)
            smallest = float(np.linalg.eigvalsh(matrix)[0])
            if smallest < -ROUNDING * float(np.abs(matrix).max()):
                vector = np.linalg.eigh(matrix)[1][:, 0]
                row = np.zeros(self.feasible_set.parameter_count)
                np.add.at(row, block.indices, np.einsum("kij,i,j->k", block.coefficients, vector, vector))
                text = f"{block.name} is determined by the base parameters and fails by {-smallest:.3g}."
                return self._answer("infeasible", [text], direction=row)
            if smallest < 0.0 or (block.size > 1 and not is_positive_definite(matrix)):
                return self._answer("undecided", [f"{block.name} is on the boundary of what is possible."])
        chosen = [0] * len(self.regions)
        stage = 0
        while stage < len(self.regions):
            if self.tries == self.method.tries:
                return self._answer("undecided", [f"No choice was found within {self.tries} tries.", *self._empty()])
            self.tries += 1
            region = self.regions[stage]
            if self.progress is not None:
                self.progress(f"try {self.tries}: {region.title}")
            margin, middle, demand = self._look(stage)
            if margin > 0.0:
                self.unknowns[region.columns] = self._choose(stage, margin, middle, chosen[stage])
                self.largest = np.maximum(self.largest, np.abs(self.unknowns))
                stage += 1
                continue
            if demand is None:
                return self._answer("undecided", [f"The region of {region.title} is too thin to be resolved."])
            self.emptied[region.title] = self.emptied.get(region.title, 0) + 1
            target = self._who_can_help(demand)
            if target is None:
                return self._refuted(demand, stage)
            if self.method.learning:
                self.demands[target].append(demand)
                stage = target
                continue
            stage = self._next_choice(chosen, stage)
            if stage < 0:
                return self._answer("undecided", ["All choices were tried; others may exist.", *self._empty()])
        return self._found()

    def _origin(self, stage: int) -> Vector:
        """δ with the unknowns of the links beyond, zeros from this one on."""
        unknowns = self.unknowns.copy()
        for region in self.regions[stage:]:
            unknowns[region.columns] = 0.0
        return np.asarray(self.feasible_set.lift @ self.base + self.feasible_set.unidentifiable @ unknowns)

    def _look(self, stage: int) -> tuple[float, Vector, Demand | None]:
        region = self.regions[stage]
        if not region.blocks and not self.demands[stage]:
            return 1.0, np.zeros(region.dimension), None
        return region.middle(self._origin(stage), self.demands[stage])

    def _choose(self, stage: int, margin: float, middle: Vector, choice: int) -> Vector:
        """A point of the region: the lightest, the middle, or halfway to a random side."""
        region = self.regions[stage]
        if choice == 1 or not region.dimension or not region.blocks:
            return middle
        dependent = np.asarray(self.feasible_set.model.base_parameters().dependent, dtype=np.intp)[region.columns]
        objective = np.isin(dependent, self.feasible_set.link_columns[:, [0, 3, 5, 9]]).astype(float)
        if choice > 1:
            objective = objective + self.random.normal(size=region.dimension) * 0.5
        kept = min(0.5 * margin, SMALL_MARGIN * self.size)
        side = region.extreme(self._origin(stage), self.demands[stage], kept, objective)
        if side is None:
            return middle
        return side if choice == 0 else 0.5 * (side + middle)

    def _who_can_help(self, demand: Demand) -> int | None:
        """Return the stage closest to the base whose unknowns occur in the demand; None where none does."""
        effects = demand.row @ self.feasible_set.unidentifiable
        position = next(k for k, region in enumerate(self.regions) if region.link == demand.link)
        scale = float(np.abs(demand.row).max())
        for stage in range(position - 1, -1, -1):
            columns = self.regions[stage].columns
            if len(columns) and float(np.abs(effects[columns]).max()) > CANCELLED * scale:
                return stage
        return None

    def _next_choice(self, chosen: list[int], stage: int) -> int:
        """Return, without learning, the last link beyond that has a choice left; -1 where none has."""
        for earlier in range(stage - 1, -1, -1):
            if self.regions[earlier].dimension and chosen[earlier] + 1 < self.method.choices:
                chosen[earlier] += 1
                chosen[earlier + 1 :] = [0] * (len(chosen) - earlier - 1)
                return earlier
        return -1

    def _refuted(self, demand: Demand, stage: int) -> VirtualParameterSearch:
        """Return the answer where no choice of the links beyond meets the demand: infeasible, if rounding allows it."""
        region = self.regions[stage]
        parameters = self._origin(stage)
        value = float(demand.row @ parameters + demand.constant)
        scale = float(np.abs(demand.row) @ np.abs(parameters)) + abs(demand.constant)
        # The value can be wrong by the coefficients that should have cancelled, times the unknowns met so far.
        error = 2.0 * float(np.abs(demand.row @ self.feasible_set.unidentifiable) @ self.largest)
        if value >= -error - ROUNDING * scale:
            text = f"{region.title} is closer to the boundary of what is possible than rounding tells."
            return self._answer("undecided", [text[0].upper() + text[1:]])
        if self.demands[stage]:
            before = sorted({self._title(d.link) for d in self.demands[stage]})
            text = f"Nothing in the region of {region.title} can meet the demands of {', '.join(before)}."
        else:
            text = f"The region of {region.title} is empty, whatever the links beyond it are."
        return self._answer("infeasible", [text], direction=demand.row)

    def _title(self, link: int) -> str:
        return next(region.title for region in self.regions if region.link == link)

    def _empty(self) -> list[str]:
        return [f"The region of {title} was empty {count} times." for title, count in self.emptied.items()]

    def _found(self) -> VirtualParameterSearch:
        parameters = self.feasible_set.lift @ self.base + self.feasible_set.unidentifiable @ self.unknowns
        if not FeasibilityCertificate(self.feasible_set, self.base, parameters).verify():
            return self._answer("undecided", ["The parameters found are closer to the boundary than can be proved."])
        reasons = [f"A point was found in the region of every link after {self.tries} tries."]
        return self._answer("feasible", reasons, parameters)

    def _answer(
        self, status: str, reasons: list[str], parameters: Vector | None = None, direction: Vector | None = None
    ) -> VirtualParameterSearch:
        independent = np.asarray(self.feasible_set.model.base_parameters().independent, dtype=np.intp)
        found = None if direction is None else direction[independent]
        dimensions = tuple(region.dimension for region in self.regions)
        return VirtualParameterSearch(status, parameters, found, self.tries, dimensions, tuple(reasons))
