"""The physical prior, which is what is known of each link before the robot moves: a body, and where its mass can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard import collision, feasibility  # their classes are imported when they are used
from steelyard.dynamics import Model
from steelyard.errors import InputError, MissingExtraError
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.constraints import Constraint
from steelyard.files.arguments import all_listed
from steelyard.once import cached_property
from steelyard.regression import Information
from steelyard.robot import Robot
from steelyard.robot.described_inertia import DescribedBody, described_bodies, possible_body
from steelyard.robot.inertia import moment_row, parameters_of_pseudo_inertia, pseudo_inertia, transformation

from .kinematic_bodies import SHORTEST_REACH, kinematic_bodies, lengths_beyond, reach_of

if TYPE_CHECKING:
    from steelyard.collision import PlacedShape
    from steelyard.collision.described_shapes import GeometryElement
    from steelyard.feasibility.constraints import MeasuredMass, SymmetricLink, TotalMass

__all__ = ["LinkPrior", "PhysicalPrior", "physical_prior", "reference_bodies"]

Array = NDArray[np.float64]
Source = Literal["description", "shape", "kinematics"]

SHAPE_DENSITY = 750.0
"""kg/m³ of the convex hulls of the links: the geometric mean of 12 arms, which lie between 311 and 1416."""

BODY_DENSITY = 300.0
"""kg/m³ of the bodies that span the joints: the geometric mean of 16 arms, which lie between 100 and 712."""

UNCERTAINTY = {"shape": 0.4, "kinematics": 0.6}
"""Standard deviations of the logarithm of the total mass at these densities, over 12 arms."""

TAPER_UNCERTAINTY = 0.7
"""Standard deviation of the power of the distance from the end of an arm by which masses differ from the assumed.

With 0.5 the total of a mobile robot with a lifting column, 0.36 to 0.45 times the true one, stays less; with 2 weak
motions bend the masses of others to twice the true ones."""

DENSITY_OF_UNSET_MATERIAL = 1000.0
"""kg/m³, with which CAD programs weigh a body without material."""

DENSITIES = (10.0, 25_000.0)
"""kg/m³ of the convex hull of a link, beyond which its mass is no mass of it: lighter than foam, heavier than osmium.

Between 155 and 11400 on 12 arms."""

SHAPE_SLACK, BODY_SLACK = 0.1, 0.25
"""How far a centre of mass may lie outside the box around its link, relative to the reach of the robot.

Of 80 links of 12 arms with shapes, nine have their centre of mass outside the box around collision and visual
elements, by at most 0.054 of the reach; of 106 links of 16 arms five outside the box around the body that spans their
joints, by at most 0.137. A last link, which may hold a tool that the description does not show, gets twice as much."""

MASS_RANGE = {"description": 10.0, "shape": 30.0, "kinematics": 30.0}
"""By which factor a mass may differ from the prior's. Masses that were assumed without the description were 0.11 to 9.4
times the true ones on 12 arms, after the data had scaled them."""

TOOL = 0.5
"""Share of the mass of all links that a last link may have in any case: tools are not in most descriptions, and many
last links are a flange of some 0.2 kg. Arms carry a tenth to a half of their own mass. With ten times the flange of a
UR5 as its limit, a tool of 4 kg came out at 1.88 kg, in an interval that ended there, with 1.7 kg of it in the link
before."""

LEAST_ALLOWANCE = 0.01
"""kg that every link may have: feasible sets keep a margin of 1e-6, in which frames that weigh next to nothing in the
description would have no room."""

SCALE_RANGE = 30.0
"""By which factor the data may change the common density."""

LEAST_SCATTER = 0.01
"""The least share of the torques that is left unexplained: no assumed distribution of mass explains them better,
whatever a simulation without noise says."""

LEAST_SHARE = 0.05
"""The least share of the assumed mass: where what is fixed to a link without inertial weighs less, it is not the mass
of the link."""

VIRTUAL = 0.01
"""Mass of a link without shape between two axes that meet, relative to that of a body there: the joints of a wrist or a
hip are often modelled one after the other, with links between them that weigh nothing."""

NEGLIGIBLE = 0.01  # of the mass of a link, what is fixed to it

LARGEST_MESH = 50_000_000  # bytes; a file of this size takes 6 s

FARTHEST = 3.0
"""Times the reach of the robot: a centre of mass that the description puts farther away is a mistake, often in
millimetres. Where no shape tells how long a link is, a shorter distance may be right."""

HEAVIEST = 1000.0
"""Times the mass of a body that spans the joints of the link: masses of arms are at most 10 times that."""

HEAVIEST_BESIDE = 30.0
"""The same where another link of the description is heavier than it can be: a description has one unit of mass, and a
foot of 60 g that stands in it as 60 kg is 600 times such a body."""

SMALLEST_SHAPE = 0.005  # times the reach of the robot; below, it stands for nothing
LARGEST_LINK = 20.0  # times the reach of the robot; beyond, the mesh is in another unit


@dataclass(frozen=True, eq=False)
class LinkPrior:
    """The prior knowledge of one link.

    Attributes
    ----------
    link : str
    source : {"description", "shape", "kinematics"}
        Where its distribution of mass comes from.
    fixed : (10,)
        The part of its ten parameters that is known.
    free : (10,)
        The part that the common density scales.
    lower, upper : (3,)
        Corners of the box in which its centre of mass lies, in the frame of the link, m; infinite where nothing is
        known.
    farthest : float
        How far beyond that box its mass may reach, m.
    stated : bool
        Whether constraints of the user state its mass.
    """

    link: str
    source: Source
    fixed: Array = field(repr=False)
    free: Array = field(repr=False)
    lower: Array
    upper: Array
    farthest: float
    stated: bool = False

    @property
    def parameters(self) -> Array:
        """The ten parameters, (10,)."""
        return self.fixed + self.free


@dataclass(frozen=True, eq=False)
class PhysicalPrior:
    """Parameters that the robot probably has, what they rest on, and what the links can have at all.

    Attributes
    ----------
    model : Model
    links : tuple of LinkPrior
    sentences : tuple of str
        What is used, and why, for the report and the terminal.
    user_constraints : tuple of Constraint
        Those of the user that it was made to agree with.
    """

    model: Model = field(repr=False)
    links: tuple[LinkPrior, ...]
    sentences: tuple[str, ...]
    user_constraints: tuple[Constraint, ...] = field(default=(), repr=False)

    @property
    def parameters(self) -> Array:
        """δ₀, (n,): the inertial parameters of every link, each a positive definite pseudo-inertia; NaN for terms.

        Friction and rotor inertia are not taken from the description, where they are settings of a simulator as a rule.
        """
        found = np.full(len(self.model.parameter_names), np.nan)
        for columns, link in zip(self.model.link_columns, self.links, strict=True):
            found[np.asarray(columns)] = link.parameters
        return found

    @property
    def masses(self) -> Array:
        """The masses of the links, (links,), kg."""
        return np.array([link.parameters[9] for link in self.links])

    @property
    def sources(self) -> tuple[Source, ...]:
        """For each link where it is known from."""
        return tuple(link.source for link in self.links)

    @property
    def scale_is_free(self) -> bool:
        """Whether a density that several links have in common is not known, so that the data may scale it."""
        return any(link.free[9] > 0.0 for link in self.links)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """Conditions of the default feasible set, beside those of the user.

        For every link: its centre of mass within a box, its mass within an ellipsoid around that box that reaches
        farther by the reach of the robot (so that second moments are finite, and yet may hold the inertia of a rotor
        that the model does not have), and its mass within a factor of the prior's. What the user states of a link is
        not stated again.
        """
        placed = {getattr(one, "link", None) for one in self.user_constraints if _bounds_center_of_mass(one)}
        weighed = _links_with_stated_mass(self.model, self.user_constraints)
        found: list[Constraint] = []
        robot = self.model.robot
        last = {robot.link_names[index] for index in robot.end_links}
        tool = TOOL * float(sum(link.parameters[9] for link in self.links))
        for link in self.links:
            if np.isfinite(link.lower).all() and link.link not in placed:
                center, half = (link.lower + link.upper) / 2.0, (link.upper - link.lower) / 2.0
                semi_axes = np.sqrt(3.0) * half + link.farthest
                found.append(feasibility.CenterOfMassBox(link.link, link.lower.tolist(), link.upper.tolist()))
                found.append(feasibility.DensityInEllipsoid(link.link, center.tolist(), semi_axes.tolist()))
            if link.link not in weighed:
                mass, factor = float(link.parameters[9]), MASS_RANGE[link.source]
                most = max(mass * factor, LEAST_ALLOWANCE, tool if link.link in last else 0.0)
                found.append(feasibility.TotalMass(minimum=mass / factor, maximum=most, links=(link.link,)))
        return tuple(found)

    def scaled(self, factors: float | ArrayLike) -> PhysicalPrior:
        """Multiply the masses that are not known.

        Parameters
        ----------
        factors : float or (links,)
        """
        each = np.broadcast_to(np.asarray(factors, dtype=float), (len(self.links),))
        links = [replace(link, free=factor * link.free) for factor, link in zip(each.tolist(), self.links, strict=True)]
        return replace(self, links=_with_masses(links, self.user_constraints, exactly=False))

    def scaled_to(self, info: Information, feasible_set: FeasibleSet) -> PhysicalPrior:
        """Multiply the masses that are not known so that they explain the data best, together with friction.

        By a common factor, and by a power of how far a link is from the end of the arm, since some arms taper more than
        others. The assumed masses count as an observation with its own uncertainty, so that they stay as they are as
        far as the data say nothing of them.

        Parameters
        ----------
        info : Information
        feasible_set : FeasibleSet
            Of the same model.
        """
        factors = _best_factors(self, info, feasible_set) if self.scale_is_free else None
        if factors is None:
            return self
        found = self.scaled(factors)
        before, after = (sum(link.free[9] for link in one.links) for one in (self, found))
        said = (
            f"By the data they weigh {after:.3g} kg (assumed: {before:.3g} kg), all links {found.masses.sum():.3g} kg."
        )
        return replace(found, sentences=(*self.sentences, said))


def physical_prior(model: Model, constraints: Sequence[Constraint] = ()) -> PhysicalPrior:
    """Gather what is known of the links of a robot before it moves.

    In this order: the inertials of the description; where they are missing, impossible or placeholders, the shape of
    the link, from visual or else collision elements, at uniform density; where there is no shape, a body that spans the
    joints of the link. Masses that the user states and symmetries are used as they are.

    Parameters
    ----------
    model : Model
    constraints : sequence of Constraint
        Those of the user, such as `MeasuredMass`, `TotalMass` and `SymmetricLink`.

    Raises
    ------
    InputError
        When lengths of the robot are symbols.

    Notes
    -----
    Of a mesh the convex hull counts. On 12 arms the masses of hulls at one density differ from the true ones by a
    standard deviation of 0.70 (of the logarithm), those of the volumes within closed meshes by 0.78, since meshes that
    are shells or not closed stand beside solid ones. The mass of a link with a shape is the geometric mean of that of
    its shape and that of the body that spans its joints, both at the mean density of arms; it differs by 0.48.

    Examples
    --------
    >>> from steelyard.robot import Robot
    >>> prior = physical_prior(Model(Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")])))
    >>> prior.sources, prior.scale_is_free
    (('kinematics', 'kinematics'), True)
    >>> prior.masses.round(1).tolist()
    [0.3, 2.0]
    """
    return _Gathering(model, tuple(constraints)).prior()


def reference_bodies(robot: Robot) -> list[dict[str, tuple[Array, bool]]]:
    """Return what the links of a robot look like, at a density of 1 kg/m³.

    Returns
    -------
    list of dict
        For each moving link, by the names of the links of the source that belong to it: moments (4, 4) in the frame of
        the moving link, and whether they are those of a shape. Without a shape the moving link itself has the body that
        spans its joints, and what is fixed to it is left out.
    """
    gathering = _Gathering(Model(robot), ())
    found = []
    for index, link in enumerate(robot.links):
        bodies: dict[str, tuple[Array, bool]] = {}
        for name in (link.name, *link.absorbed):
            solid = gathering._solid(index, name)
            if solid is not None:
                bodies[name] = solid, True
        if link.name not in bodies and gathering.reach > SHORTEST_REACH:
            bodies[link.name] = np.asarray(gathering.bodies[index].moments), False
        found.append(bodies)
    return found


class _Gathering:
    """Gathers the bodies of the links, and what is to be said of them."""

    def __init__(self, model: Model, constraints: tuple[Constraint, ...]) -> None:
        robot = model.robot
        if robot.lengths:
            raise InputError(
                f'robot "{robot.name}": the lengths {", ".join(robot.lengths)} are symbols; give numbers, since the '
                "size of the links is needed"
            )
        self.model, self.robot, self.constraints = model, robot, constraints
        self.sentences: list[str] = []
        self.reasons: dict[tuple[str, str], list[str]] = {}
        self.reach = reach_of(robot)
        self.bodies = kinematic_bodies(robot)
        self.shapes = self._shapes()
        self.described = described_bodies(robot)

    # Where the shapes are

    def _shapes(self) -> dict[GeometryElement, list[PlacedShape]]:
        """Shapes of the moving links, by the kind of element."""
        found: dict[GeometryElement, list[PlacedShape]] = {"visual": [], "collision": []}
        if self.robot.source is not None:
            skipped: list[tuple[str, str]] = []
            try:
                found = collision.shapes_of_moving_links(self.robot, self.robot.source, skipped, LARGEST_MESH)
            except MissingExtraError as error:
                self.sentences.append(f"The shapes of the links are not used: {error}")
            except InputError:  # the file has changed since the robot was read
                text = f"The shapes of the links are not used: {self.robot.source} cannot be read again."
                self.sentences.append(text)
            links = list(dict.fromkeys(link for link, _ in skipped))
            if links:
                why = skipped[0][1].rstrip(".")
                self.sentences.append(f"Some shapes of {_listed(links)} cannot be used: {why}.")
        for kind, shapes in found.items():
            found[kind] = [one for one in shapes if self._has_size(one)]
        return found

    def _has_size(self, one: PlacedShape) -> bool:
        lower, upper = one.box
        volume = float(one.moments[3, 3])
        size = float(np.max(np.abs([lower, upper])))
        if self.reach > SHORTEST_REACH and size > LARGEST_LINK * self.reach:
            in_millimetres = 100.0 * self.reach < size < 5000.0 * self.reach
            unit = "it seems to be in millimetres" if in_millimetres else "it is in another place or unit"
            self.sentences.append(
                f"A shape of `{one.link}` is not used, because it reaches to {size:.3g} m on a robot that reaches "
                f"{self.reach:.3g} m: {unit}."
            )
            return False
        extent = float(np.linalg.norm(upper - lower))
        return volume > 1e-6 * extent**3 and extent > SMALLEST_SHAPE * self.reach

    # One link

    def prior(self) -> PhysicalPrior:
        factor = self._common_factor()
        unset = self._material_is_unset()
        links = []
        for index in range(len(self.robot.links)):
            link = self._link(index, factor)
            if unset and link.source == "description":
                link = replace(link, fixed=np.zeros(10), free=link.parameters)
            links.append(link)
        stated = _with_stated(tuple(links), self.constraints)
        self._tell(stated, unset)
        return PhysicalPrior(self.model, stated, tuple(self.sentences), self.constraints)

    def _link(self, index: int, factor: float) -> LinkPrior:
        name = self.robot.links[index].name
        solid = self._solid(index)
        stand_in = self.bodies[index].moments if solid is None else solid
        mass = factor * self._mass(index, solid)
        # A plate of no thickness, as it is drawn, is no body.
        assumed, _ = possible_body(mass / stand_in[3, 3] * parameters_of_pseudo_inertia(stand_in), stand_in)
        lower, upper = self._box(index, solid is not None)
        fixed, free = np.zeros(10), np.zeros(10)
        own, *others = self._judged(index)
        for part in (own, *others):
            if part.is_usable:
                fixed += part.parameters
        for part in others:
            if self._counts(part, fixed[9]):
                of_part = self._part(index, part.name, factor)
                free += of_part
                what = "the shape at uniform density takes its place" if of_part[9] > 0.0 else "it is left out"
                self._because(part.name, f"the inertial {part.problem}; {what}", f", fixed to `{name}`")
        source: Source = "description"
        if not own.is_usable and own.inertia is not None and 0.0 < own.inertia.mass <= NEGLIGIBLE * fixed[9]:
            fixed += own.parameters
        elif not own.is_usable:
            of_own = self._part(index, own.name, factor)
            if fixed[9] < LEAST_SHARE * assumed[9]:
                fixed, free = np.zeros(10), assumed
                source = "kinematics" if solid is None else "shape"
            else:
                free += of_own
                source = "shape" if free[9] > fixed[9] else "description"
            instead = "a body that spans the joints is used"
            if source == "description":
                instead = "what is fixed to it counts alone"
            if of_own[9] > 0.0 or source == "shape":
                instead = "the shape at uniform density is used"
            why = f"the inertial of the description {own.problem}" if own.problem else "the description has no inertial"
            self._because(name, f"{why}, so {instead}")
        if fixed[9] > 0.0:
            if solid is None:
                com = fixed[6:9] / fixed[9]
                slack = self._slack(index, False)
                if np.all((com > lower - FARTHEST * self.reach) & (com < upper + FARTHEST * self.reach)):
                    lower, upper = np.minimum(lower, com - slack), np.maximum(upper, com + slack)
            # By itself, so that the sum is a body whatever the data make of the other part.
            if np.isfinite(lower).all():
                fixed = self._corrected(name, fixed, stand_in, (lower, upper), solid is not None)
            else:
                fixed = self._possible(name, fixed, stand_in)
        return LinkPrior(name, source, fixed, free, lower, upper, max(self.reach, SHORTEST_REACH))

    def _part(self, index: int, part: str, factor: float) -> Array:
        """The shape of a link of the source at the assumed density, (10,); zero where it has none."""
        solid = self._solid(index, part)
        return np.zeros(10) if solid is None else factor * SHAPE_DENSITY * parameters_of_pseudo_inertia(solid)

    def _counts(self, part: DescribedBody, mass: float) -> bool:
        """Return whether what is fixed to a link has a placeholder that matters: many frames weigh next to nothing."""
        return part.inertia is not None and bool(part.problem) and part.inertia.mass > NEGLIGIBLE * mass

    def _judged(self, index: int) -> list[DescribedBody]:
        """Return what the description says, with what the size of the link contradicts."""
        found = []
        name = self.robot.links[index].name
        heaviest = self._heaviest * BODY_DENSITY * float(self.bodies[index].moments[3, 3])
        for part in self.described[index]:
            if part.is_usable and part.inertia is not None:
                mass, solid = part.inertia.mass, self._solid(index, name) if part.name == name else None
                density = None if solid is None else mass / solid[3, 3]
                if density is not None and not DENSITIES[0] <= density <= DENSITIES[1]:
                    problem = f"gives the shape a density of {density:.2g} kg/m³ ({mass:.3g} kg)"
                    part = replace(part, problem=problem)
                elif self.reach > SHORTEST_REACH and mass > heaviest:
                    part = replace(part, problem=f"gives it {mass:.3g} kg, more than a link of its length can have")
            found.append(part)
        return found

    @cached_property
    def _heaviest(self) -> float:
        """How many times the mass of a body that spans its joints a link may have."""
        for index, link in enumerate(self.robot.links):
            most = HEAVIEST * BODY_DENSITY * float(self.bodies[index].moments[3, 3])
            own = (part.inertia for part in self.described[index] if part.name == link.name and part.is_usable)
            if any(inertia is not None and inertia.mass > most for inertia in own):
                return HEAVIEST_BESIDE
        return HEAVIEST

    def _corrected(
        self,
        name: str,
        total: Array,
        stand_in: Array,
        box: tuple[Array, Array],
        has_shape: bool,
    ) -> Array:
        """The nearest possible body: its centre of mass within its box, its second moments those of a body."""
        lower, upper = box
        com = total[6:9] / total[9]
        where = "shape" if has_shape else "body that spans the joints"
        if not (np.all(com >= lower) and np.all(com <= upper)):
            # Half of the slack away from the boundary, on which barriers are infinite.
            slack = 0.25 * np.minimum(self.reach * SHAPE_SLACK, upper - lower)
            inside = np.clip(com, lower + slack, upper - slack)
            shift = np.eye(4)
            shift[:3, 3] = inside - com
            total = transformation(shift) @ total
            text = f"the centre of mass of the description is outside the {where}; the nearest place is used"
            self._because(name, text)
        body = self._possible(name, total, stand_in)
        center, half = (lower + upper) / 2.0, (upper - lower) / 2.0
        ellipsoid = feasibility.DensityInEllipsoid(name, center.tolist(), (np.sqrt(3.0) * half + self.reach).tolist())
        if float(moment_row(ellipsoid.quadratic) @ body) < 0.1 * body[9]:
            about = stand_in / stand_in[3, 3]
            second = about[:3, :3] - np.outer(about[:3, 3], about[:3, 3])
            matrix = pseudo_inertia(body)
            first = matrix[:3, 3] / body[9]
            matrix[:3, :3] = body[9] * (second + np.outer(first, first))
            body, _ = possible_body(parameters_of_pseudo_inertia(matrix), stand_in)
            text = "the moments of inertia of the description are those of a body larger than the robot"
            self._because(name, f"{text}; those of the {where} are used")
        return body

    def _possible(self, name: str, total: Array, stand_in: Array) -> Array:
        body, problem = possible_body(total, stand_in)
        if problem:
            text = f"the moments of inertia of the description {problem}; the nearest possible ones are used"
            self._because(name, text)
        return body

    # Shapes and boxes

    def _of_link(self, kind: GeometryElement, index: int, part: str | None = None) -> list[PlacedShape]:
        return [one for one in self.shapes[kind] if one.body == index and part in (None, one.link)]

    def _solid(self, index: int, part: str | None = None) -> Array | None:
        """Moments of the shape of a link, or of a link of the source that belongs to it; None without a shape."""
        for kind in self.shapes:
            shapes = self._of_link(kind, index, part)
            if shapes:
                return np.asarray(sum(one.moments for one in shapes))
        return None

    def _slack(self, index: int, has_shape: bool) -> float:
        slack = (SHAPE_SLACK if has_shape else BODY_SLACK) * self.reach
        if index not in self.robot.end_links:
            return slack
        return max(2.0 * slack, 0.0 if has_shape else self.reach / max(len(self.robot.links) - 1, 1))

    def _box(self, index: int, has_shape: bool) -> tuple[Array, Array]:
        """The box of the centre of mass; infinite where the robot shows no size at all."""
        shapes = (
            [one for kind in self.shapes for one in self._of_link(kind, index)] if has_shape else [self.bodies[index]]
        )
        if self.reach < SHORTEST_REACH and not has_shape:
            return np.full(3, -np.inf), np.full(3, np.inf)
        boxes = np.array([one.box for one in shapes])
        lower, upper = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        slack = self._slack(index, has_shape)
        if self.reach < SHORTEST_REACH:
            slack = SHAPE_SLACK * float(np.linalg.norm(upper - lower))
        return lower - slack, upper + slack

    # Densities

    def _mass(self, index: int, solid: Array | None) -> float:
        """Mass of a link at the assumed densities: of its shape and of the body that spans its joints, their mean.

        On 12 arms the masses of shapes at one density differ from the true ones by a standard deviation of the
        logarithm of 0.70, those of the bodies by 0.67, their geometric means by 0.48: one is wrong where shapes are
        covers or small parts, the other where a link is thicker or thinner than its length and place suggest.
        """
        body = BODY_DENSITY * float(self.bodies[index].moments[3, 3])
        if solid is None and self._is_virtual(index):
            return VIRTUAL * body
        return body if solid is None else float(np.sqrt(body * SHAPE_DENSITY * solid[3, 3]))

    def _is_virtual(self, index: int) -> bool:
        """Return whether a link only joins two axes that meet, in a description that has masses for others."""
        points = [joint.before[:3, 3] for joint in self.robot.joints if joint.parent == index]
        own = self.described[index][0].inertia
        if not points or np.abs(points).max() > SHORTEST_REACH or (own is not None and own.mass != 0.0):
            return False
        return any(part.is_usable for parts in self.described for part in parts)

    def _common_factor(self) -> float:
        """Return how much heavier than assumed the described links of this robot are, by the median."""
        found = []
        for index in range(len(self.robot.links)):
            own, *others = self._judged(index)
            if own.is_usable:
                mass = sum(part.parameters[9] for part in (own, *others) if part.is_usable)
                found.append(np.log(mass / self._mass(index, self._solid(index))))
        return float(np.exp(np.median(found))) if found else 1.0

    def _material_is_unset(self) -> bool:
        """Return whether all masses are those of water within the meshes."""
        weighed = 0
        for index, link in enumerate(self.robot.links):
            own = self.described[index][0]
            if not own.is_usable or own.inertia is None:
                continue
            volumes = []
            for kind in self.shapes:
                shapes = [one.shape for one in self._of_link(kind, index, link.name)]
                meshes = [one for one in shapes if isinstance(one, collision.Mesh) and len(one.triangles)]
                if meshes and len(meshes) == len(shapes):
                    volumes.append(
                        sum(abs(collision.moments_of_surface(one.vertices, one.triangles)[3, 3]) for one in meshes)
                    )
            masses = [DENSITY_OF_UNSET_MATERIAL * volume for volume in volumes]
            if not any(abs(own.inertia.mass - mass) <= 0.01 * mass for mass in masses):
                return False
            weighed += 1
        return weighed > 1

    # Sentences

    def _because(self, name: str, text: str, place: str = "") -> None:
        self.reasons.setdefault((place, text), []).append(name)

    def _tell(self, links: tuple[LinkPrior, ...], unset: bool) -> None:
        found = []
        described = [link.link for link in links if link.source == "description"]
        if described:
            which = f"all {len(links)}" if len(described) == len(links) else f"{len(described)} of {len(links)}"
            many = f"{which} links" if len(links) > 1 else "the link"
            found.append(f"The description's inertials are used for {many}.")
        found += [f"{_listed(names)}{place}: {text}." for (place, text), names in self.reasons.items()]
        if unset:
            found.append(
                f"All masses of the description are those of the meshes at {DENSITY_OF_UNSET_MATERIAL:g} kg/m³, as CAD "
                "programs write them where no material is set, so the data may scale them together."
            )
        free = [link for link in links if link.free[9] > 0.0]
        if free and not unset:
            mass = sum(link.free[9] for link in free)
            found.append(
                f"What the description does not tell is taken to weigh {mass:.3g} kg, as links of this size and shape "
                "do on average; the data may scale it."
            )
        stated = [link.link for link in links if link.stated]
        if stated:
            found.append(f"The constraints state the mass of {_listed(stated)}.")
        if self.reach > SHORTEST_REACH:
            shape, body = SHAPE_SLACK * self.reach, BODY_SLACK * self.reach
            found.append(
                f"Each centre of mass stays in a box around its link, {shape:.2g} m wider on each side than the shape, "
                f"or {body:.2g} m than what spans the joints where there is no shape; twice as much at an arm's end."
            )
        else:
            found.append("The joints meet in one point, so that the size of links without a shape is not known.")
        self.sentences[:0] = found


def _listed(names: Sequence[str]) -> str:
    shown = [f"`{name}`" for name in names[:6]]
    if len(names) > 6:
        return f"{', '.join(shown)} and {len(names) - 6} more"
    return all_listed(shown)


# What the user states


def _links_with_stated_mass(model: Model, constraints: Sequence[Constraint]) -> frozenset[str]:
    """Links whose masses the user's constraints speak of, but for bounds of a total."""
    names = model.robot.link_names
    found: set[str] = set()
    for one in constraints:
        if isinstance(one, feasibility.MeasuredMass) or (
            isinstance(one, feasibility.TotalMass) and _exact(one) is not None
        ):
            found.update(one.links or names)
        elif not (isinstance(one, (feasibility.TotalMass, feasibility.SymmetricLink)) or _bounds_center_of_mass(one)):
            touched = {int(index) for block in one.blocks(model) for index in block.indices}
            touched |= {int(index) for equality in one.equalities(model) for index in equality.indices}
            found.update(n for n, columns in zip(names, model.link_columns, strict=True) if int(columns[9]) in touched)
    return frozenset(found)


def _bounds_center_of_mass(one: Constraint) -> bool:
    """Tell whether a constraint says where the mass of one link lies."""
    names = ("CenterOfMassBox", "CenterOfMassSphere", "CenterOfMassHull", "DensityInBox", "DensityInEllipsoid")
    return isinstance(one, tuple(getattr(feasibility, name) for name in names))


def _exact(one: MeasuredMass | TotalMass) -> float | None:
    if isinstance(one, feasibility.MeasuredMass):
        return float(one.value)
    if one.equal is not None:
        return float(one.equal)
    return float(one.maximum) if one.maximum is not None and one.maximum == one.minimum else None


def _with_stated(links: tuple[LinkPrior, ...], constraints: Sequence[Constraint]) -> tuple[LinkPrior, ...]:
    """Links with the symmetries and the masses that the user states."""
    found = {link.link: link for link in links}
    for one in constraints:
        if isinstance(one, feasibility.SymmetricLink) and one.link in found:
            found[one.link] = _symmetric(found[one.link], one)
    return _with_masses(list(found.values()), constraints, exactly=True)


def _with_masses(links: Sequence[LinkPrior], constraints: Sequence[Constraint], exactly: bool) -> tuple[LinkPrior, ...]:
    """Multiply links by factors until sums of masses are what is stated: the nearest in relative entropy."""
    statements: list[tuple[set[str], float, float]] = []
    stated: set[str] = set()
    for one in constraints:
        if isinstance(one, (feasibility.MeasuredMass, feasibility.TotalMass)):
            names, value = set(one.links or [link.link for link in links]), _exact(one)
            if value is not None:
                stated |= names
                statements.append((names, value, value))
            elif isinstance(one, feasibility.TotalMass):
                statements.append((names, one.minimum or 0.0, np.inf if one.maximum is None else float(one.maximum)))
    factors = {link.link: 1.0 for link in links}
    masses = {link.link: float(link.parameters[9]) for link in links}
    for _ in range(200 if len(statements) > 1 else 1):
        for names, least, most in statements:
            total = sum(factors[name] * masses[name] for name in names if name in masses)
            if total > 0.0 and not least <= total <= most:
                target = least if total < least else most
                factors.update({name: factors[name] * target / total for name in names if name in factors})
    found = []
    for link in links:
        factor = factors[link.link]
        fixed, free = factor * link.fixed, factor * link.free
        if exactly and link.link in stated:
            fixed, free = fixed + free, np.zeros(10)
        found.append(replace(link, fixed=fixed, free=free, stated=link.stated or link.link in stated))
    return tuple(found)


def _symmetric(link: LinkPrior, constraint: SymmetricLink) -> LinkPrior:
    """The mean of a body and its images under the symmetries, so often that all of them leave it as it is."""
    average = np.eye(10)
    for _, matrix in constraint.symmetries():
        average = 0.5 * (np.eye(10) + transformation(matrix)) @ average
    average = np.linalg.matrix_power(average, 128)  # a quarter turn halves the square of what is left
    return replace(link, fixed=average @ link.fixed, free=average @ link.free)


# The common density that the data tell


def _best_factors(prior: PhysicalPrior, info: Information, feasible_set: FeasibleSet) -> Array | None:
    """Factor of the assumed mass of each link, by nonnegative least squares on a common one and the terms.

    What a wrong distribution of mass leaves over is no noise, and a torso or a column that moves up and down shows its
    weight as an offset. So each joint counts as one observation with the scatter that is left over, beside the assumed
    density with its own uncertainty, and terms of the size of the joint's torque.

    Robots differ in how much heavier their links are near the base, where the motion does not show all of the mass. So
    the factor of a link is a common one times a power of its distance from the end of the arm, which is tried on a
    grid. On 12 arms with three kinds of motion the total mass of bodies that span joints is then 0.39 to
    1.6 times the true one (all but a mobile robot with a lifting column above 0.5), that of shapes 0.72 to 1.6 times;
    without the power 0.29 to 2.8 and 0.50 to 1.9 times.
    """
    problem = info.reduced("joint")
    matrix = problem.R @ feasible_set.K
    columns = np.asarray(prior.model.link_columns)
    fixed, free = (np.array([getattr(link, part) for link in prior.links]) for part in ("fixed", "free"))
    target = problem.rho - matrix[:, columns.ravel()] @ fixed.ravel()
    by_link = np.einsum("rlk,lk->rl", matrix[:, columns], free)
    if not by_link.any() or not target.any():
        return None
    terms = np.setdiff1d(np.arange(matrix.shape[1]), columns.ravel())
    signs = nonnegative_terms(prior.model)[terms]
    joints = len(prior.model.robot.joint_names)
    sizes = _torque_sizes(info, joints).repeat(len(terms) // joints)
    of_terms = np.hstack([matrix[:, terms] * sizes, -(matrix[:, terms] * sizes)[:, ~signs]])
    uncertainty = max(UNCERTAINTY["kinematics" if link.source == "kinematics" else "shape"] for link in prior.links)
    distances = _distances_from_end(prior)
    powers = TAPER_UNCERTAINTY * np.linspace(-3.0, 3.0, 25) if distances.any() else np.zeros(1)

    trials = [np.exp(power * distances) for power in powers]
    systems = [np.column_stack([by_link @ trial, of_terms]) for trial in trials]
    scatter = min(_nonnegative_least_squares(system, target)[1] ** 2 for system in systems) + problem.residual2
    scatter = max(scatter, LEAST_SCATTER**2 * (float(target @ target) + problem.residual2))
    weight = np.sqrt(joints / scatter)
    assumed = np.eye(systems[0].shape[1])
    assumed[0, 0] /= uncertainty
    known = np.append(weight * target, assumed[0])
    best, found = np.inf, np.ones(len(prior.links))
    for power, trial, system in zip(powers, trials, systems, strict=True):
        solution, left = _nonnegative_least_squares(np.vstack([weight * system, assumed]), known)
        loss = left**2 + (power / TAPER_UNCERTAINTY) ** 2
        if loss < best:
            best, found = loss, np.clip(solution[0], 1.0 / SCALE_RANGE, SCALE_RANGE) * trial
    return np.asarray(found)


def _nonnegative_least_squares(matrix: Array, target: Array) -> tuple[Array, float]:
    from scipy.optimize import nnls

    solution, left = nnls(matrix, target, maxiter=50 * matrix.shape[1])
    return np.asarray(solution), float(left)


def _distances_from_end(prior: PhysicalPrior) -> Array:
    """Logarithms of the distances of the links from the end of the arm, less their mean; zero for described links."""
    beyond = lengths_beyond(prior.model.robot)
    logarithms = np.log(beyond / max(float(beyond.max()), SHORTEST_REACH) + 0.2)
    assumed = np.array([link.source != "description" for link in prior.links])
    return np.asarray(np.where(assumed, logarithms - logarithms[assumed].mean() if assumed.any() else 0.0, 0.0))


def _torque_sizes(info: Information, joints: int) -> Array:
    """Root mean square of the torque of each joint, or of all where their rows are not known apart, (joints,)."""
    factors = info.torque_factors or info.factors
    found = [float(np.linalg.norm(factor.triangle[:, -1]) / np.sqrt(max(factor.count, 1))) for factor in factors]
    sizes = np.array(found) if len(found) == joints else np.full(joints, max(found))
    return np.asarray(np.maximum(sizes, 1e-6 * max(float(sizes.max()), 1e-12)))


def nonnegative_terms(model: Model) -> NDArray[np.bool_]:
    """(n,) which parameters physics does not let be negative each by itself: those of friction and rotor inertia."""
    found = np.zeros(model.parameter_count, dtype=bool)
    for block in model.conditions("full"):
        if block.size == 1 and len(block.indices) == 1 and block.coefficients[0, 0, 0] > 0.0:
            found[block.indices] = True
    return found
