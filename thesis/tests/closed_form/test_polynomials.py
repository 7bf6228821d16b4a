"""The polynomials of feasibility, against eigenvalues and against the thesis as printed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard_thesis import feasibility_polynomials

sympy = pytest.importorskip("sympy", reason="polynomials need sympy")

LINK = sympy.symbols("Lxx1 Lxy1 Lxz1 Lyy1 Lyz1 Lzz1 lx1 ly1 lz1 m1", real=True)


@pytest.fixture(scope="module")
def elbow() -> sy.Model:
    rows = [("-pi/2", 0, 0.25, "q"), (0, 0.5, 0, "q")]
    return sy.Model(sy.Robot.from_dh(rows, name="elbow").with_terms(sy.Viscous(), sy.RotorInertia()))


@pytest.fixture(scope="module")
def single() -> sy.Model:
    return sy.Model(sy.Robot.from_dh([(0, 1, 0, "q")]))


def test_the_polynomials_of_the_thesis_as_printed(single: sy.Model) -> None:
    """Thesis 3.3 and 3.4 are right as printed; 3.5 repeats lines and loses squares, so it is checked by its meaning."""
    xx, xy, xz, yy, yz, zz, x, y, z, m = LINK
    mass, first, second, third = (condition.polynomial for condition in feasibility_polynomials(single))
    assert mass == m
    assert first == xx * m**2 - y**2 * m - z**2 * m
    assert second == (
        xx * yy * m**2
        - xx * x**2 * m
        - xx * z**2 * m
        - xy**2 * m**2
        - 2 * xy * x * y * m
        - yy * y**2 * m
        - yy * z**2 * m
        + x**2 * z**2
        + y**2 * z**2
        + z**4
    )
    # The lines of 3.5 that are printed once and whole.
    printed = xx * yy * zz * m**2 - xx * yy * x**2 * m - xx * yy * y**2 * m + xx * x**2 * y**2 - xy**2 * zz * m**2
    terms = set(sympy.Add.make_args(third))
    assert set(sympy.Add.make_args(printed)) <= terms
    cross = sympy.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    about_com = sympy.Matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - cross.T * cross / m  # thesis 3.17
    assert sympy.expand(m**2 * about_com.det(method="berkowitz")) == third
    assert all(condition.polynomial.is_polynomial(*LINK) for condition in feasibility_polynomials(single))


def random_link(generator: np.random.Generator, spread: float) -> np.ndarray[Any, Any]:
    """Mass points, then disturbed: some of them feasible, some not."""
    points, masses = generator.normal(size=(6, 3)), generator.uniform(0.1, 1.0, 6)
    moments = np.einsum("k,ki,kj->ij", masses, points, points)
    tensor = np.trace(moments) * np.eye(3) - moments
    row = [tensor[0, 0], tensor[0, 1], tensor[0, 2], tensor[1, 1], tensor[1, 2], tensor[2, 2]]
    link = np.array([*row, *(masses @ points), masses.sum()])
    return link + spread * generator.normal(size=10) * np.abs(link)


def eigenvalues(link: np.ndarray[Any, Any], consistency: str) -> np.ndarray[Any, Any]:
    xx, xy, xz, yy, yz, zz, *first, m = link
    tensor, first = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), np.array(first)
    about_com = tensor - (first @ first * np.eye(3) - np.outer(first, first)) / m
    inertia = np.linalg.eigvalsh(about_com)
    if consistency == "full":  # the triangle inequality of the principal moments
        inertia = np.append(inertia, inertia.sum() - 2 * inertia.max())
    return np.append(inertia, m)


@pytest.mark.parametrize("consistency", ["inertia", "full"])
def test_signs_agree_with_eigenvalues(consistency: Any, single: sy.Model) -> None:
    polynomials = [c.polynomial for c in feasibility_polynomials(single, consistency)]
    evaluate = sympy.lambdify(LINK, polynomials, "numpy")
    generator = np.random.default_rng(5)
    verdicts = []
    for k in range(400):
        link = random_link(generator, (0.05, 0.3, 1.5)[k % 3])
        expected = bool(np.all(eigenvalues(link, consistency) > 0))
        assert all(value > 0 for value in evaluate(*link)) == expected
        verdicts.append(expected)
    assert 50 < sum(verdicts) < 350


def test_triangle_inequality_is_what_full_adds(single: sy.Model) -> None:
    rod = dict(zip(LINK, [1, 0, 0, 1, 0, 3, 0, 0, 0, 1], strict=True))  # 1 + 1 < 3
    values = {c: [p.polynomial.xreplace(rod) for p in feasibility_polynomials(single, c)] for c in ("inertia", "full")}
    assert min(values["inertia"]) > 0
    assert min(values["full"]) < 0


def test_names_tell_links_and_joints_apart(elbow: sy.Model) -> None:
    found = feasibility_polynomials(elbow)
    names = [condition.name for condition in found]
    assert names[:4] == ["m1", "P11", "P21", "P31"]
    assert {"m2", "P12", "P22", "P32"} <= set(names)
    assert {c.link for c in found} == {"link1", "link2", None}
    terms = {c.name: str(c.polynomial) for c in found if c.joint == "joint2"}
    assert sorted(terms.values()) == ["Fvj2", "Ia2"]
    assert found[1]._repr_latex_() == r"$\displaystyle L_{xx,1} m_1^{2} - l_{y,1}^{2} m_1 - l_{z,1}^{2} m_1 > 0$"
    assert [c.name for c in feasibility_polynomials(elbow, "full")][:4] == ["J11", "J21", "J31", "J41"]


def test_terms_with_matrices_give_their_minors() -> None:
    class Coupled(sy.dynamics.Viscous):  # type: ignore[name-defined, misc]
        kind = "coupled"
        parameters = tuple(
            sy.robot.TermParameter(s, "", "", s, nonnegative=False)  # type: ignore[attr-defined]
            for s in ("A", "B")
        )

        def columns(self, k: int, q: Any, dq: Any, ddq: Any, algebra: Any) -> Any:
            return ({k: dq[k]}, {k: q[k]})

        def conditions(self) -> Any:
            flip = np.array([[0.0, 1.0], [1.0, 0.0]])
            return (sy.robot.Condition("A is above |B|", 2, np.zeros((2, 2)), {"A": np.eye(2), "B": flip}),)  # type: ignore[attr-defined]

    model = sy.Model(sy.Robot.from_dh([(0, 1, 0, "q")]).with_terms(Coupled()))
    a, b = sympy.symbols("A1 B1", real=True)
    assert [c.polynomial for c in feasibility_polynomials(model)][-2:] == [a, a**2 - b**2]


def test_base_dependent_polynomials_have_the_same_values(elbow: sy.Model) -> None:
    """Thesis 3.15, with base parameters computed from the standard ones by NumPy."""
    base = elbow.base_parameters()
    delta = np.random.default_rng(7).uniform(0.1, 2.0, elbow.parameter_count)
    beta = delta[base.independent] + base.Kd @ delta[base.dependent]
    names = list(elbow.parameter_names)
    numbers = {sympy.Symbol(n, real=True): v for n, v in zip(names, delta, strict=True)}
    dependent = {sympy.Symbol(names[k], real=True): delta[k] for k in base.dependent}
    mapped = {sympy.Symbol(f"beta{k + 1}", real=True): v for k, v in enumerate(beta)} | dependent
    for consistency in ("inertia", "full"):
        plain = feasibility_polynomials(elbow, consistency)  # type: ignore[arg-type]
        moved = feasibility_polynomials(elbow, consistency, base_dependent=True)  # type: ignore[arg-type]
        for one, other in zip(plain, moved, strict=True):
            assert other.name == one.name
            assert other.polynomial.free_symbols <= set(mapped)
            expected = float(one.polynomial.xreplace(numbers))
            assert float(other.polynomial.xreplace(mapped)) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_unknown_consistency_is_explained(elbow: sy.Model) -> None:
    with pytest.raises(InputError, match='did you mean "inertia"'):
        feasibility_polynomials(elbow, "inertial")  # type: ignore[arg-type]
