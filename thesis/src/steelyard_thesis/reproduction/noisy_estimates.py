"""Robots with known parameters, and the least squares estimates that noisy torques give of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model, Viscous
from steelyard.feasibility import FeasibleSet, check, correct
from steelyard.identification.wam import TRAJECTORIES, true_parameters, wam_model
from steelyard.recording import Samples
from steelyard.regression import Information, least_squares
from steelyard.robot import Robot

__all__ = ["Case", "Subject", "cases", "random_subject", "wam_subject"]

Array = NDArray[np.float64]
_POINTS = 8  # masses that make a random link: enough for an inertia of full rank


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot with known parameters and a motion to identify it with.

    Attributes
    ----------
    name : str
    model : Model
    truth : (n,)
        Standard parameters.
    samples : Samples
        The motion with its torques, without noise.
    """

    name: str
    model: Model
    truth: Array
    samples: Samples

    @property
    def base(self) -> Array:
        """True base parameters."""
        return np.asarray(self.model.base_parameters().K @ self.truth)


@dataclass(frozen=True, eq=False)
class Case:
    """An estimate, and the nearest one that is possible.

    Attributes
    ----------
    subject : Subject
    noise : float
        Standard deviation of the torques' noise, as a part of the rms torque of each joint.
    estimate : (n_b,)
        Weighted least squares.
    corrected : (n_b,)
        The nearest under full consistency, in the data's own metric; the estimate where that is feasible.
    infeasible : bool
        What `check` proves of the estimate.
    distance : float
        From the estimate to the corrected one: rms of what changes in the torques of the motion, as a part of their
        rms.
    """

    subject: Subject
    noise: float
    estimate: Array
    corrected: Array
    infeasible: bool
    distance: float


def wam_subject() -> Subject:
    """Return the simulated arm of chapter 4 on trajectory A, one period at 40 Hz."""
    model = wam_model()
    _, q, dq, ddq = TRAJECTORIES["A"].sample(40.0)
    return _subject("WAM", model, true_parameters(), q, dq, ddq)


def random_subject(seed: int) -> Subject:
    """Return a random arm of three to six turning joints, with links of random point masses, on a random motion.

    Examples
    --------
    >>> random_subject(3).model.dof in (3, 4, 5, 6)
    True
    """
    random = np.random.default_rng([81, seed])
    count = int(random.integers(3, 7))
    rows = [
        (random.choice([-np.pi / 2, 0.0, np.pi / 2]), random.uniform(0.0, 0.4), random.uniform(-0.2, 0.4), "q")
        for _ in range(count)
    ]
    model = Model(Robot.from_dh(rows, name=f"random{seed}").with_terms(Viscous()))
    truth: list[float] = []
    for link in range(count):
        truth += [*_random_link(random, 8.0 * 0.6**link), random.uniform(0.1, 1.0) * 0.6**link]
    t = np.linspace(0.0, 2.0 * np.pi, 400)[:, None, None]
    harmonics = np.arange(1.0, 5.0)
    a, b = random.normal(0.0, 0.5, (2, count, 4))
    angle = harmonics * t
    q = np.sum(a / harmonics * np.sin(angle) - b / harmonics * np.cos(angle), axis=-1) + random.uniform(-1, 1, count)
    dq = np.sum(a * np.cos(angle) + b * np.sin(angle), axis=-1)
    ddq = np.sum(harmonics * (b * np.cos(angle) - a * np.sin(angle)), axis=-1)
    return _subject(model.robot.name, model, np.array(truth), q, dq, ddq)


def _random_link(random: np.random.Generator, mass: float) -> Array:
    """Return the ten parameters of a few point masses in a box."""
    masses = mass * random.dirichlet(np.ones(_POINTS))
    places = random.uniform(-1.0, 1.0, (_POINTS, 3)) * [0.2, 0.06, 0.06] + random.normal(0.0, 0.05, 3)
    second = np.einsum("p,pi,pj->ij", masses, places, places)
    inertia = np.trace(second) * np.eye(3) - second
    rows, columns = np.triu_indices(3)
    return np.concatenate([inertia[rows, columns], masses @ places, [mass]])


def _subject(name: str, model: Model, truth: Array, q: Array, dq: Array, ddq: Array) -> Subject:
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    return Subject(name, model, truth, Samples(q=q, dq=dq, ddq=ddq, torque=torque))


def cases(subject: Subject, noises: tuple[float, ...], draws: int) -> Iterator[Case]:
    """Identify a subject with more and more noise, several times each.

    Parameters
    ----------
    subject : Subject
    noises : tuple of float
        As parts of the rms torque of each joint.
    draws : int

    Yields
    ------
    Case
    """
    feasible_set = FeasibleSet(subject.model, "full")
    samples = subject.samples
    rms = np.sqrt(np.mean(samples.torque**2, axis=0))
    for level, noise in enumerate(noises):
        for draw in range(draws):
            random = np.random.default_rng([subject.model.dof, level, draw])
            torque = samples.torque + noise * rms * random.standard_normal(samples.torque.shape)
            noisy = Samples(q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=torque)
            data = Information.from_samples(subject.model, noisy, batch_means=False)
            estimate = least_squares(data, weights="joint").base
            infeasible = check(feasible_set, base=estimate).feasible is False
            corrected, distance = estimate, 0.0
            if infeasible:
                found = correct(feasible_set, base=estimate, metric=data)
                corrected = found.base
                distance = float(np.sqrt(found.squared_distance / np.sum(torque**2)))
            yield Case(subject, noise, estimate, corrected, infeasible, distance)
