"""The condition that every body must satisfy, as a verifier writes it down for itself."""

from collections.abc import Sequence
from fractions import Fraction

from .statement import Matrix

__all__ = ["CONSISTENCIES", "bodies", "body_matrix"]

CONSISTENCIES = ("full", "inertia")

_SYMBOLS = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


def bodies(parameter_names: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """Return where the ten inertial parameters of each link stand, by the ending that their names share.

    Examples
    --------
    >>> bodies(["Fv1", "Lxx1", "Lxy1", "Lxz1", "Lyy1", "Lyz1", "Lzz1", "lx1", "ly1", "lz1", "m1"])
    {'1': (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)}
    """
    places = {name: index for index, name in enumerate(parameter_names)}
    endings = (name.removeprefix(_SYMBOLS[0]) for name in parameter_names if name.startswith(_SYMBOLS[0]))
    return {
        ending: tuple(places[symbol + ending] for symbol in _SYMBOLS)
        for ending in endings
        if all(symbol + ending in places for symbol in _SYMBOLS)
    }


def body_matrix(inertial: Sequence[Fraction], consistency: str) -> Matrix:
    """Return the matrix that is positive definite for a body that can exist.

    The pseudo-inertia ``[[tr(L)/2 - L, l], [l', m]]`` (Wensing et al. 2018, eq. 5) for ``"full"``; for ``"inertia"``
    ``[[L, S(l)'], [S(l), m 1]]`` (thesis 3.20).

    Parameters
    ----------
    inertial : sequence of Fraction
        ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m``.
    consistency : {"full", "inertia"}
    """
    xx, xy, xz, yy, yz, zz, x, y, z, m = inertial
    o = Fraction(0)
    if consistency == "full":
        half = (xx + yy + zz) / 2
        return [[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z], [x, y, z, m]]
    return [
        [xx, xy, xz, o, -z, y],
        [xy, yy, yz, z, o, -x],
        [xz, yz, zz, -y, x, o],
        [o, z, -y, m, o, o],
        [-z, o, x, o, m, o],
        [y, -x, o, o, o, m],
    ]
