"""Examination of a description before anything moves: each link is judged, with the probable cause of a fault."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.estimators.physical_prior import DENSITIES, reference_bodies
from steelyard.robot import Drives, Robot
from steelyard.robot.described_inertia import ROUNDING, DescribedBody, described_bodies, possible_body, standing_bodies
from steelyard.robot.description import URDF, description_format
from steelyard.robot.inertia import Inertia

__all__ = ["LinkReport", "Preflight", "preflight"]

Array = NDArray[np.float64]

IMPOSSIBLE = 40.0
"""Added to the mismatch of a body that no mass distribution has; a body with the shape's own moments has 0."""

GAIN = 9.0
"""By how much a cause must lower the mismatch, beyond its own cost, to be named."""

ALIKE = 0.2
"""The largest difference between the logarithms of volume and size of links that are alike: links that differ by less
are meant to be alike."""

SPREAD = {True: (0.7, 0.5, 0.6), False: (1.0, 0.8, 0.9)}
"""Standard deviations of the logarithm of the density, of the place of the centre of mass relative to the radius of
gyration, and of the logarithms of the second moments: with a shape, and with the body that spans the joints."""

CONTRADICTION = math.log(30.0)
"""The largest difference between the logarithms of the density of a link and of that of the others: masses of links
differ from shapes by 2 as a rule."""

REMEDIES = {
    "placeholder": "Weigh the link, or take its inertial from CAD; until then leave the inertial out.",
    "copied link": "Give the link an inertial of its own, from CAD or from a scale.",
    "shape contradicts mass": "Mend the mass, or the unit or scale of the mesh, whichever is wrong.",
    "rounding": "Write moments of inertia with more digits, as CAD has them.",
    "impossible": "The nearest possible body is a stand-in; take the inertial from CAD where there is one.",
}
"""What to do about causes that no other numbers of the link explain."""

SAME = 1e-9
ZERO = 1e-12
"""Second moments beside the square of the distance of the centre of mass, of which only rounding is left: that of a
point mass 0.1 m away is 1e-16."""
FEWEST_DIGITS, MOST_DIGITS = 3, 9  # of a number that a program has rounded; with fewer all may be rounding
TINY = 1e-3  # kg; frames and sensors have masses that mean nothing


@dataclass(frozen=True)
class _Body:
    """Mass, centre of mass and inertia about it, as a description states them."""

    mass: float
    com: Array
    tensor: Array

    @property
    def inertia(self) -> Inertia:
        return Inertia.from_com(self.mass, self.com, self.tensor)

    @property
    def covariance(self) -> Array:
        """Second central moments over the mass, (3, 3)."""
        return np.asarray((0.5 * np.trace(self.tensor) * np.eye(3) - self.tensor) / self.mass)


@dataclass(frozen=True, eq=False)
class LinkReport:
    """The judgement of one link of the description.

    Attributes
    ----------
    described : Inertia
        As the description has it, in the frame of the link.
    margin : float
        Least principal second moment about the centre of mass over the largest: below 0 no body has it; NaN where all
        are zero, or there is no mass.
    cause : str
        The probable cause of what is wrong, such as "unit g for kg"; empty where nothing is.
    evidence : str
        What shows that something is wrong; empty where nothing is.
    is_guess : bool
        Whether the cause is the most probable one of several, which the evidence alone does not say.
    mended : Inertia or None
        As the link probably is, or the nearest possible body, in its own frame; None where it stays.
    """

    link: str
    described: Inertia
    margin: float
    cause: str = ""
    evidence: str = ""
    is_guess: bool = False
    mended: Inertia | None = field(default=None, repr=False)

    @property
    def mass(self) -> float:
        """The mass in the description, kg."""
        return self.described.mass

    @property
    def possible(self) -> bool:
        """Whether a body can have it, but for the rounding of the digits that are written."""
        return self.mass >= 0.0 and self.margin >= ROUNDING

    @property
    def sentence(self) -> str:
        """The finding: the evidence and the cause; empty where nothing is wrong."""
        return f"{self.evidence}; probably {self.cause}" if self.is_guess else self.evidence

    @property
    def remedy(self) -> str:
        """What would mend the description, as a sentence; empty where nothing is wrong."""
        if not self.evidence:
            return ""
        if self.mended is None:
            return REMEDIES.get(self.cause, "Weigh the link, or take its inertial from CAD.")
        repaired = f"Let --repair change its {self.change}"
        return f"{repaired} {REMEDIES[self.cause]}" if self.cause in REMEDIES else repaired

    @property
    def change(self) -> str:
        """What `mended` has otherwise than the description, in words; empty where it stays."""
        old, mended = self.described, self.mended
        if mended is None:
            return ""
        found = []
        if not np.isclose(old.mass, mended.mass, rtol=1e-9):
            found.append(f"mass from {old.mass:.4g} to {mended.mass:.4g} kg")
        if not np.allclose(old.com, mended.com, rtol=1e-9, atol=1e-12):
            found.append(f"centre of mass from {_listed(old.com)} to {_listed(mended.com)} m")
        before, after = (np.linalg.eigvalsh(one.about_com) for one in (old, mended))
        if not np.allclose(old.about_com, mended.about_com, rtol=1e-9, atol=0.0):
            found.append(f"principal moments of inertia from {_listed(before)} to {_listed(after)} kg m²")
        return (", ".join(found) or "no change") + "."


@dataclass(frozen=True, eq=False)
class Preflight:
    """The findings on a description.

    Attributes
    ----------
    links : tuple of LinkReport
        Every link of the description with an inertia; of the base and what is fixed to it those that no body can be.
    """

    robot: Robot
    links: tuple[LinkReport, ...]

    @property
    def findings(self) -> tuple[LinkReport, ...]:
        """The links of which something is wrong."""
        return tuple(one for one in self.links if one.sentence)

    def write(self, target: Path) -> tuple[tuple[str, str], ...]:
        """Write the description of the robot with the mended links, in its own format.

        Returns
        -------
        tuple of pairs of str
            Each link that is mended, and what changed.

        Raises
        ------
        InputError
            If the robot was not read from a description, or that cannot be written.
        """
        robot = self.robot
        if robot.source is None:
            raise InputError(f"{robot.name}: it was not read from a description, so there is none to repair.")
        kind = description_format(robot.source, robot.xacro_arguments or None) or URDF
        if refusal := kind.refusal(robot):
            raise InputError(refusal)
        still = {part.name for part in standing_bodies(robot)}
        mended = {one.link: one.mended for one in self.links if one.link in still and one.mended is not None}
        written = replace(robot, base_mended=mended)
        kind.write(written, self.repaired(), Drives.unknown(robot.dof), robot.source, target)
        return tuple((one.link, one.change) for one in self.links if one.mended is not None)

    def repaired(self) -> Array:
        """Parameters (n,) of the robot with the mended links."""
        mended = {one.link: one.mended for one in self.links if one.mended is not None}
        parameters = np.array(self.robot.parameters)
        bodies = described_bodies(self.robot)
        for link, start, parts in zip(self.robot.links, self.robot.link_starts, bodies, strict=True):
            if not {link.name, *link.absorbed} & mended.keys():
                continue
            total = np.zeros(10)
            for part in parts:
                inertia = mended.get(part.name, part.inertia)
                if inertia is not None:
                    total += inertia.moved(part.placement).parameters
            parameters[start : start + 10] = total
        return parameters


def _listed(values: NDArray[np.floating]) -> str:
    return f"({', '.join(f'{value:.3g}' for value in values)})"


def preflight(robot: Robot) -> Preflight:
    """Look at the inertias of a description: possible or not, and the probable cause of what is wrong.

    Every link is compared with its shape, or where it has none with a body that spans its joints, if it has several
    that turn, at the density that the other links have beside theirs. Causes that are tried: masses in grams, lengths
    in millimetres, a decimal slip, the sign of products of inertia, swapped axes, inertia about the origin of the
    frame, inertia in the axes of another frame; then copies, placeholders, and shapes that contradict the mass.

    Examples
    --------
    >>> body = Inertia.from_com(2.0, (0.2, 0, 0), np.diag([0.002, 0.02, 0.03]))
    >>> other = Inertia.from_com(1.5, (0.2, 0, 0), np.diag([0.002, 0.02, 0.021]))
    >>> arm = Robot.from_dh([(0, 0.4, 0, "q"), (0, 0.4, 0, "q")], inertias={"link1": body, "link2": other})
    >>> preflight(arm).links[0].possible, preflight(arm).links[0].sentence.partition("; ")[2]
    (False, 'probably decimal slip of ixx')
    """
    still = [_standing(part) for part in standing_bodies(robot)]
    bodies = described_bodies(robot)
    if all(part.inertia is None for parts in bodies for part in parts):
        return Preflight(robot, tuple(still))
    # Without numbers for its lengths a robot has no size to compare with.
    references = [{} for _ in robot.links] if robot.lengths else reference_bodies(robot)
    frames = _axes_of_base(robot)
    # A carriage is not as long as its way, and nothing tells where a last link ends: bodies that span their joints say
    # nothing of them.
    parents = {joint.parent for joint in robot.joints}
    sliding = [index for index, joint in enumerate(robot.joints) if not joint.rotates]
    along = {one for index in sliding for one in (index, robot.joints[index].parent)}
    unspanned = {link.name for index, link in enumerate(robot.links) if index in along or index not in parents}
    found: list[tuple[DescribedBody, _Body, tuple[Array, bool] | None, Array]] = []
    reports: list[LinkReport] = []
    for index, parts in enumerate(bodies):
        for part in parts:
            if part.inertia is None:
                continue
            mass = part.inertia.mass
            if not mass > 0.0:
                if part.problem and (mass < 0.0 or np.abs(part.inertia.parameters).max() > 0.0):
                    reports.append(LinkReport(part.name, part.inertia, np.nan, "placeholder", part.problem))
                continue
            body = _Body(mass, part.inertia.com, part.inertia.about_com)
            reference = references[index].get(part.name)
            if reference is not None:
                back = np.linalg.inv(part.placement)
                reference = back @ reference[0] @ back.T, reference[1]
            axes = frames[index] @ part.placement[:3, :3]
            found.append((part, body, reference, axes))
    # Whether each link is compared with a shape (True), with a body that spans its joints (False), or with nothing.
    # Such bodies are far thicker or thinner than shapes of links, so that each kind has its own density.
    kinds = [
        None
        if reference is None or body.mass <= TINY or (part.name in unspanned and not reference[1])
        else reference[1]
        for part, body, reference, _ in found
    ]
    densities = [0.0 if ref is None else math.log(body.mass / ref[0][3, 3]) for _, body, ref, _ in found]
    copies = _copies([body for _, body, _, _ in found], [reference for _, _, reference, _ in found])
    for index, (part, body, reference, axes) in enumerate(found):
        others = [densities[k] for k, kind in enumerate(kinds) if kind == kinds[index] and k != index]
        density = None if kinds[index] is None else float(np.median(others)) if others else math.log(500.0)
        alike = [found[other][0].name for other in np.flatnonzero(copies[index])]
        reports.append(_judged(part, body, reference, axes, density, alike))
    return Preflight(robot, (*reports, *still))


def _standing(part: DescribedBody) -> LinkReport:
    assert part.inertia is not None
    body = _Body(part.inertia.mass, part.inertia.com, part.inertia.about_com)
    return _judged(part, body, None, np.eye(3), None, [])


def _judged(
    part: DescribedBody,
    body: _Body,
    reference: tuple[Array, bool] | None,
    axes: Array,
    density: float | None,
    copies: list[str],
) -> LinkReport:
    values = np.linalg.eigvalsh(body.covariance)
    # Moments about the centre of mass come from those about the origin: of zeros their rounding is left, whose ratios
    # say nothing.
    none = float(np.abs(values).max()) <= ZERO * float(body.com @ body.com)
    margin = np.nan if none else float(values[0] / values[-1]) if values[-1] > 0.0 else -1.0
    possible = margin >= ROUNDING
    stand_in = np.eye(4) if reference is None else reference[0]
    nearest = None if possible else Inertia.from_parameters(possible_body(body.inertia.parameters, stand_in)[0])
    wrong = "no body has these moments of inertia"
    wrong = "" if possible else f"{wrong} (the least second moment is {margin:.2g} of the largest)"
    wrong = "its moments of inertia are zero" if none else wrong

    def report(cause: str, evidence: str, mended: Inertia | None = nearest, is_guess: bool = False) -> LinkReport:
        assert part.inertia is not None
        return LinkReport(part.name, part.inertia, margin, cause, evidence, is_guess, mended)

    if part.problem:
        return report("placeholder", part.problem)
    if copies:
        text = f"it has the inertial of {', '.join(copies[:3])}, to the last digit, and another shape"
        return report("copied link", f"{wrong}; {text}" if wrong else text)
    digits = 0 if possible or none else _too_few_digits(body)
    if digits:
        return report("rounding", f"{wrong}, which rounding to {digits} digits does to flat bodies and rods")
    if reference is not None and density is not None and not none:
        before = _mismatch(body, reference, density)
        tried = [
            (before - _mismatch(mended, reference, density) - cost, cause, mended)
            for cause, cost, mended in _causes(body, axes)
            # What leaves a body that cannot be explains nothing, though it may be less far from the shape: a tensor
            # from which the offset of the centre of mass was taken twice was called a decimal slip.
            if _is_possible(mended)
        ]
        gain, cause, mended = max(tried, key=lambda one: one[0], default=(0.0, "", body))
        if gain >= GAIN:
            is_body = np.linalg.eigvalsh(mended.covariance)[0] > 0.0
            evidence = wrong or _evidence(body, reference)
            return report(cause, evidence, mended.inertia if is_body else nearest, is_guess=True)
        away = math.log(body.mass / reference[0][3, 3]) - density
        if reference[1] and abs(away) > CONTRADICTION:
            many = "heavier" if away > 0.0 else "lighter"
            text = f"{math.exp(abs(away)):.0f} times {many} than the other links for its size"
            return report("shape contradicts mass", f"its shape contradicts its mass: {text}")
        actual = body.mass / reference[0][3, 3]
        if reference[1] and not DENSITIES[0] <= actual <= DENSITIES[1]:
            return report("shape contradicts mass", f"its shape contradicts its mass: {actual:.3g} kg/m³")
    return report("impossible" if wrong else "", wrong)


def _too_few_digits(body: _Body) -> int:
    """Return to how many digits moments are rounded, where that may have made a possible body impossible; else 0.

    Half a unit of the last digit of each moment changes a second moment by half of their sum at most, and that of each
    product by as much as itself.
    """
    numbers = body.tensor[np.triu_indices(3)]
    shown = numbers[np.abs(numbers) > SAME * np.abs(numbers).max()]
    orders = np.floor(np.log10(np.abs(shown))) + 1.0
    for digits in range(1, MOST_DIGITS + 1):
        units = 10.0 ** (orders - digits)
        if np.all(np.abs(shown / units - np.rint(shown / units)) < 1e-6):
            scale = np.where(np.eye(3, dtype=bool)[np.triu_indices(3)], 0.5, 1.0)
            scale = scale[np.abs(numbers) > SAME * np.abs(numbers).max()]
            least = body.mass * float(np.linalg.eigvalsh(body.covariance)[0])
            return digits if digits >= FEWEST_DIGITS and -least <= 0.5 * float(scale @ units) else 0
    return 0


def _is_possible(body: _Body) -> bool:
    values = np.linalg.eigvalsh(body.covariance)
    return bool(values[-1] > 0.0 and values[0] >= ROUNDING * values[-1])


def _evidence(body: _Body, reference: tuple[Array, bool]) -> str:
    moments, has_shape = reference
    volume = moments[3, 3]
    place = np.linalg.norm(body.com - moments[:3, 3] / volume)
    size = math.sqrt(np.trace(_covariance(moments)))
    gyration = math.sqrt(max(np.trace(body.covariance), 0.0))
    what = "its shape" if has_shape else "what spans its joints"
    return (
        f"it does not fit {what} (density {body.mass / volume:.3g} kg/m³, radius of gyration {gyration:.3g} m beside "
        f"{size:.3g} m, centre of mass {place:.3g} m away)"
    )


def _covariance(moments: Array) -> Array:
    center = moments[:3, 3] / moments[3, 3]
    return np.asarray(moments[:3, :3] / moments[3, 3] - np.outer(center, center))


def _mismatch(body: _Body, reference: tuple[Array, bool], density: float) -> float:
    """Return how far a body is from its reference, in squared standard deviations."""
    moments, has_shape = reference
    of_density, of_place, of_moments = SPREAD[has_shape]
    around = _covariance(moments)
    size = math.sqrt(np.trace(around))
    around = around + (0.02 * size) ** 2 * np.eye(3)
    found = ((math.log(body.mass / moments[3, 3]) - density) / of_density) ** 2
    found += float(np.sum((body.com - moments[:3, 3] / moments[3, 3]) ** 2)) / (of_place * size) ** 2
    root = np.linalg.inv(np.linalg.cholesky(around))
    ratios = np.linalg.eigvalsh(root @ body.covariance @ root.T)
    largest = max(float(np.abs(ratios).max()), 1e-12)
    found += IMPOSSIBLE if ratios[0] < ROUNDING * largest else 0.0
    ratios = np.maximum(ratios, 1e-3 * largest)
    found += float(np.sum(np.log(ratios) ** 2)) / of_moments**2
    return min(found, 1e6)


def _causes(body: _Body, axes: Array) -> Iterator[tuple[str, float, _Body]]:
    """Return what the body would be without a mistake: the mistake, what it costs to assume it, and the body."""
    mass, com, tensor = body.mass, body.com, body.tensor

    def scaled(of_mass: float, of_length: float, of_tensor: float) -> _Body:
        return _Body(mass * of_mass, com * of_length, tensor * of_tensor)

    yield "unit: mass in g, not kg", 2.0, scaled(1e-3, 1.0, 1.0)
    yield "unit: mass and inertia in g, not kg", 2.0, scaled(1e-3, 1.0, 1e-3)
    yield "unit: lengths in mm, not m", 2.0, scaled(1.0, 1e-3, 1e-6)
    yield "unit: centre of mass in mm, not m", 2.0, scaled(1.0, 1e-3, 1.0)
    yield "unit: inertia in kg mm², not kg m²", 2.0, scaled(1.0, 1.0, 1e-6)
    yield "unit: inertia in kg cm², not kg m²", 3.0, scaled(1.0, 1.0, 1e-4)
    yield "unit: inertia in g m² or of a mass in g", 2.0, scaled(1.0, 1.0, 1e-3)
    yield "unit: inertia in g mm², not kg m²", 2.0, scaled(1.0, 1.0, 1e-9)
    yield "unit: g and mm, not kg and m", 2.0, scaled(1e-3, 1e-3, 1e-9)
    yield "unit: mass in t, not kg", 4.0, scaled(1e3, 1.0, 1.0)
    for factor in (0.1, 10.0, 0.01, 100.0):
        cost = 4.0 if factor in (0.1, 10.0) else 6.0
        yield "decimal slip of the mass", cost, scaled(factor, 1.0, 1.0)
        yield "decimal slip of the inertia", cost, scaled(1.0, 1.0, factor)
        for axis in range(3):
            moved = com.copy()
            moved[axis] *= factor
            yield f"decimal slip of the centre of mass along {'xyz'[axis]}", cost + 1.0, _Body(mass, moved, tensor)
            slipped = tensor.copy()
            slipped[axis, axis] *= factor
            letter = "xyz"[axis]
            yield f"decimal slip of i{letter}{letter}", cost + 1.0, _Body(mass, com, slipped)
    for row, column in ((0, 1), (0, 2), (1, 2)):
        pair = "xyz"[row] + "xyz"[column]
        flipped = tensor.copy()
        flipped[row, column] = flipped[column, row] = -tensor[row, column]
        yield f"sign of i{pair}", 4.0, _Body(mass, com, flipped)
        for factor in (0.1, 0.01):
            slipped = tensor.copy()
            slipped[row, column] = slipped[column, row] = factor * tensor[row, column]
            yield f"decimal slip of i{pair}", 6.0, _Body(mass, com, slipped)
    yield "sign of all products of inertia", 3.0, _Body(mass, com, 2.0 * np.diag(np.diagonal(tensor)) - tensor)
    for axis in range(3):
        moved = com.copy()
        moved[axis] = -com[axis]
        yield f"sign of the centre of mass along {'xyz'[axis]}", 4.0, _Body(mass, moved, tensor)
    for order in permutations(range(3)):
        if order != (0, 1, 2):
            turned = tensor[np.ix_(order, order)]
            yield "swapped axes of the inertia", 4.0, _Body(mass, com, turned)
            yield "swapped axes of centre of mass and inertia", 5.0, _Body(mass, com[list(order)], turned)
            yield "swapped axes of the centre of mass", 5.0, _Body(mass, com[list(order)], tensor)
    steiner = mass * (com @ com * np.eye(3) - np.outer(com, com))
    yield "inertia about the origin of the frame, not the centre of mass", 3.0, _Body(mass, com, tensor - steiner)
    if not np.allclose(axes, np.eye(3), rtol=0.0, atol=1e-6):
        yield "inertia in the axes of the base", 4.0, _Body(mass, com, axes.T @ tensor @ axes)
        yield "inertia in the axes of the base, not of the link", 4.0, _Body(mass, axes.T @ com, axes.T @ tensor @ axes)


def _copies(bodies: Sequence[_Body], references: Sequence[tuple[Array, bool] | None]) -> NDArray[np.bool_]:
    """Tell of each two links, (L, L), whether they have one body to the last digit but look different.

    Bodies that are the same by symmetry are no copies, and the legs of a quadruped are alike for a reason.
    """
    numbers = np.array([body.inertia.parameters for body in bodies])
    telling = np.array([body.mass > TINY and np.abs(body.com).max() > 0.0 for body in bodies])
    # Logarithms of size and volume, of shapes and of bodies that span joints; what is not known does not differ.
    looks = np.full((len(bodies), 4), np.nan)
    for look, reference in zip(looks, references, strict=True):
        if reference is not None:
            moments, has_shape = reference
            first = 2 * int(has_shape)
            look[first : first + 2] = math.log(np.trace(_covariance(moments))), math.log(moments[3, 3])
    found = np.zeros((len(bodies), len(bodies)), bool)
    for index in np.flatnonzero(telling):
        same = (np.abs(numbers - numbers[index]) <= SAME * np.abs(numbers)).all(axis=1)
        found[index] = same & (np.abs(looks - looks[index]) > ALIKE).any(axis=1)
    return found


def _axes_of_base(robot: Robot) -> list[Array]:
    """The axes of each moving link in the frame of the base, (3, 3), at q = 0."""
    found: list[Array] = []
    for joint in robot.joints:
        above = np.eye(3) if joint.parent < 0 else found[joint.parent]
        found.append(above @ joint.placement(0.0)[:3, :3])
    return found
