"""The solvers that are known from the start."""

from functools import partial

from .clarabel_solver import solve_with_clarabel
from .csdp import CSDP, csdp_version
from .dsdp import DSDP
from .file_solver import solve_with_program
from .scs_solver import scs_is_installed, scs_version, solve_with_scs
from .sdpa import SDPA, sdpa_version
from .solver import FEATURES, Solver, register_solver

__all__ = ["PROVIDED"]

_LINEAR = frozenset({"nonnegative", "semidefinite"})
_REWRITTEN = frozenset({"quadratic", "zero", "second-order"})


def _clarabel_version() -> str:
    import clarabel

    return str(clarabel.__version__)


PROVIDED = (
    Solver(
        name="clarabel",
        title="Clarabel",
        description="interior point, default",
        run=solve_with_clarabel,
        native=frozenset(FEATURES),
        version=_clarabel_version,
        remedy="pip install clarabel",
    ),
    Solver(
        name="scs",
        title="SCS",
        description="first order",
        run=solve_with_scs,
        native=frozenset(FEATURES),
        installed=scs_is_installed,
        version=scs_version,
        remedy="pip install 'steelyard[scs]'",
    ),
    *(
        Solver(
            name=program.executable if program is not DSDP else "dsdp",
            title=program.title,
            description=description,
            run=partial(solve_with_program, program),
            native=_LINEAR,
            rewritten=_REWRITTEN,
            access="SDPA file",
            installed=program.installed,
            version=version,
            remedy=program.remedy,
            is_package=False,
        )
        for program, description, version in (
            (CSDP, "interior point", csdp_version),
            (DSDP, "interior point, dual scaling", lambda: ""),
            (SDPA, "interior point", sdpa_version),
        )
    ),
)
"""Clarabel, SCS, CSDP, DSDP and SDPA, in this order."""

for _solver in PROVIDED:
    register_solver(_solver)
