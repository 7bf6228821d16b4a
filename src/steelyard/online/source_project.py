"""The estimator for a controller: updates and feasible solutions as a project of C99 without allocation."""

from __future__ import annotations

import tempfile
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray

from steelyard import __version__
from steelyard.codegen.project import write_files
from steelyard.codegen.text import comment_lines, marker, number, number_lines
from steelyard.conic import Cone, ConicProblem, Rows, solve
from steelyard.errors import InputError, SolverError
from steelyard.estimators.prior import Prior
from steelyard.feasibility import FeasibleSet, correct
from steelyard.feasibility.constraints.constraint import solved_for_some
from steelyard.feasibility.nearest_point import FINE, UNIDENTIFIABLE_WEIGHT
from steelyard.feasibility.units import Units
from steelyard.lmi import AffineBlock

__all__ = ["generate_online"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

LARGEST_BLOCK = 12
"""Rows of a condition, at most: its matrices stand on the stack, eight of them at a time."""

RIDGE = 1e-6
"""Curvature in the robot's own units that every prior gets, so that what neither data nor prior tells has an end."""

ITERATIONS = 40
"""At most: 20 are usual, and one of 700 random base parameters of the seven-joint arm takes as many."""

ACCURACY = 1e-12
"""The accuracy of the objective, relative to it (but to `FINE` where less has to change). 1e-9 leaves errors of β of
5e-5 of its size where masses grow large, 1e-11 leaves 2e-6, and 1e-13 is no closer than 1e-12 and slower."""

PAIRS_BELOW = 1e-6
"""Gap, relative to the objective, from which on all sums of a step and its Newton system have twice the digits. With
doubles alone, answers are within 1e-4 of the exact ones, and a third of the searches do not end. From 1e-5 on the worst
time is half as long again without a closer answer; from 1e-8 on the worst error is 4e-5."""

PAIR_STEPS = 14
"""At most so many steps have twice the digits, because one takes four times as long as another (94 and 25 µs). Of
100 000 inputs 4 would take more, of which the one that takes 24 would be the only one above 2 ms."""

CONSTANTS: dict[str, float | int] = {
    "ROUNDING": 1e-15,
    "BLOCKED": 1e50,
    "LEAST_START": 1e-6,
    "STALL": 0.02,
    "REFINEMENTS": 1,
    "HALVINGS": 20,
    "LEAST_STEP": 1e-7,
    "EIGENVALUE_STEPS": 40,
    "ITERATIONS": ITERATIONS,
    "ACCURACY": ACCURACY,
    "DUAL_ACCURACY": 1e-8,
    "FAIR": 1e-6,
    "PAIRS_BELOW": PAIRS_BELOW,
    "PAIR_STEPS": PAIR_STEPS,
    "PULLS": 60,
    "FINE": FINE,
    "GREATEST": 1e12,
    "UNMEASURED_WEIGHT": UNIDENTIFIABLE_WEIGHT,
}
"""Numbers of the method, beside its code in `robot_online.c`."""


def generate_online(
    feasible_set: FeasibleSet, directory: str | Path, *, language: str = "c", prior: Prior | None = None
) -> tuple[Path, ...]:
    """Write what a controller needs to identify its robot while it moves, as C99 with a self-test.

    The source counts samples (one Givens update of the triangular factor of each joint, with forgetting), finds the
    possible parameters nearest to given base parameters, as :func:`steelyard.correct` does, and those that fit the
    samples best near a prior. It allocates nothing, keeps nothing, needs only `math.h`, and takes a bounded number of
    steps. Whatever comes in, the parameters that come out are possible: Cholesky factorizations prove each condition
    before they are handed out.

    Parameters
    ----------
    feasible_set : FeasibleSet
        With its constraints and margin.
    directory : str or Path
        Made where it is missing. A file that was not generated is never overwritten.
    language : str
        ``"c"``.
    prior : Prior, optional
        Of the fit: :class:`steelyard.estimators.EuclideanPrior` or
        :class:`steelyard.estimators.ConstantPullbackPrior`. By default small
        parameters in the robot's own units.

    Returns
    -------
    tuple of Path
        The files; `README.md` says how to build and call them.

    Raises
    ------
    InputError
        If the language or the prior cannot be written, a term needs a channel beside the motion, a condition is too
        large, the set has no room beyond its margin, or the directory cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import steelyard as sy
    >>> arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")], name="arm").with_terms(sy.Viscous())
    >>> feasible_set = sy.FeasibleSet(sy.Model(arm))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in sy.online.generate_online(feasible_set, folder)][:4]
    ['CMakeLists.txt', 'README.md', 'arm.c', 'arm.h']
    """
    if str(language).lower() not in ("c", "c99"):
        raise InputError(f'The estimator is generated as C99 alone, not as {language!r}; give language="c".')
    model: Any = feasible_set.model
    model.refuse_channels()
    with tempfile.TemporaryDirectory() as folder:
        made = model.generate("c", ["regressor"], directory=folder, base=True)
        texts = {path.name: path.read_text(encoding="utf-8") for path in made}
    name = next(path.removesuffix(".h") for path in texts if path.endswith(".h"))
    tables = _Tables(feasible_set, prior)
    texts |= _online_files(name, tables, feasible_set)
    texts["CMakeLists.txt"] = _with_estimator(texts["CMakeLists.txt"], name)
    texts["README.md"] += _guide(name)
    return write_files(dict(sorted(texts.items())), Path(directory))


class _Tables:
    """The feasible set and the objectives over unknowns y, δ = constant + N y, where the equations hold for every y."""

    def __init__(self, feasible_set: FeasibleSet, prior: Prior | None) -> None:
        n = feasible_set.parameter_count
        self.feasible_set = feasible_set
        self.constant, self.N = np.zeros(n), np.eye(n)
        if feasible_set.equalities:
            which, rest, value = solved_for_some(feasible_set.equation_matrix, feasible_set.equation_values)
            kept = np.setdiff1d(np.arange(n), which)
            self.N[which] = -rest
            self.N = self.N[:, kept]
            self.constant[which] = value
        self.count = self.N.shape[1]
        self.blocks = [block.substitute(self.N, self.constant) for block in feasible_set.blocks]
        large = next((block for block in self.blocks if block.size > LARGEST_BLOCK), None)
        if large is not None:
            raise InputError(
                f"The condition {large.name!r} has {large.size} rows; the generated solver takes {LARGEST_BLOCK} at "
                "most. Leave its constraint out, or write it as smaller ones."
            )
        self.scalars = [block for block in self.blocks if block.size == 1]
        self.matrices = [block for block in self.blocks if block.size > 1]
        self.is_cone = not self.constant.any() and not any(block.constant.any() for block in self.blocks)
        self.K = feasible_set.K @ self.N
        self.base_constant = feasible_set.K @ self.constant
        dependent = np.asarray(feasible_set.model.base_parameters().dependent, dtype=np.intp)
        self.dependent, self.dependent_constant = self.N[dependent], self.constant[dependent]
        units = Units.of(feasible_set).parameters
        curvature, reference = np.diag(RIDGE / units**2), np.zeros(n)
        if prior is None:
            curvature = np.diag(1.0 / units**2)
        else:
            prepared = prior.prepare(feasible_set)
            if prepared.metric is None:
                raise InputError(
                    f"The distance of {type(prior).__name__} is not quadratic, which the generated fit needs; give "
                    "ConstantPullbackPrior or EuclideanPrior."
                )
            curvature = curvature + prepared.curvature().toarray()
            reference = prepared.reference
        self.curvature, self.reference = curvature, reference
        self.interior = self._interior_point(units)

    def _interior_point(self, units: Array) -> Array:
        """A point y well inside the set: the smallest whose conditions hold by 1, or by as much as there is room."""
        feasible_set, m = self.feasible_set, self.count
        _, blocks = feasible_set.rows(self.N, self.constant)
        identity = -feasible_set.stack.identity[:, None]
        rows = Rows(sparse.csc_array(np.hstack([blocks.matrix.toarray(), -identity])), blocks.right, *blocks.cones)
        most = Rows(sparse.csc_array(([1.0], ([0], [m])), shape=(1, m + 1)), np.ones(1), Cone("nonnegative", 1))
        scaled = self.N / units[:, None]
        P = np.zeros((m + 1, m + 1))
        P[:m, :m] = 1e-9 * (scaled.T @ scaled)
        q = np.append(1e-9 * scaled.T @ (self.constant / units), -1.0)
        solution = solve(ConicProblem.from_rows(q, [rows, most], sparse.csc_array(P)))
        room = -np.inf
        if solution.usable:
            y = np.asarray(solution.primal[:m])
            eigenvalues = feasible_set.stack.smallest_eigenvalues(self.constant + self.N @ y)
            room = float(eigenvalues.min(initial=np.inf))
        if not room > 2.0 * feasible_set.margin:
            raise InputError(
                f"The feasible set has no room beyond twice its margin of {feasible_set.margin:g}, which the generated "
                "solver needs to begin; loosen the constraints, or give FeasibleSet a smaller margin."
            )
        # A cone is entered at a distance of 1: searches are in units of what was given.
        self.room = 1.0 if self.is_cone else room
        return y / room if self.is_cone else y


@dataclass(frozen=True)
class _Structure:
    """The pattern of a Newton matrix and its Cholesky factor, column by column in the order of elimination."""

    order: list[int]
    column_start: list[int]
    row: list[int]
    place: Indices
    entry: dict[tuple[int, int], int]

    @classmethod
    def of(cls, count: int, cliques: Sequence[Indices]) -> _Structure:
        """Eliminate next what adds the fewest elements; each clique is a set of unknowns that belong together."""
        near: list[set[int]] = [set() for _ in range(count)]
        for clique in cliques:
            members = {int(i) for i in clique}
            for i in members:
                near[i] |= members - {i}
        left, order, below = set(range(count)), [], []
        fill: dict[int, int] = {}
        while left:
            if all(len(near[v]) == len(left) - 1 for v in left):  # any order will do
                rest = sorted(left)
                order += rest
                below += [set(rest[i + 1 :]) for i in range(len(rest))]
                break
            fill |= {v: sum(len(near[v] - near[u]) - 1 for u in near[v]) for v in left - fill.keys()}
            chosen = min(left, key=lambda v: (fill[v], len(near[v]), v))
            order.append(chosen)
            below.append(near[chosen])
            left.discard(chosen)
            for u in near[chosen]:
                near[u] = (near[u] | near[chosen]) - {u, chosen}
            for v in {chosen}.union(near[chosen], *(near[u] for u in near[chosen])):  # the only ones that it concerns
                fill.pop(v, None)
        place = np.argsort(np.array(order, dtype=np.intp))
        starts, rows = [0], []
        for j, under in enumerate(below):
            rows += [j, *sorted(int(place[u]) for u in under)]
            starts.append(len(rows))
        entry = {(rows[p], j): p for j in range(count) for p in range(starts[j], starts[j + 1])}
        return cls(order, starts, rows, place, entry)

    def at(self, first: int, second: int) -> int:
        """Return where the element of two unknowns stands."""
        i, j = int(self.place[first]), int(self.place[second])
        return self.entry[max(i, j), min(i, j)]

    def tables(self, name: str, blocks: Sequence[AffineBlock]) -> dict[str, list[int]]:
        """Tables of the C source."""
        count = len(self.order)
        left: list[list[tuple[int, int]]] = [[] for _ in range(count)]
        for j in range(count):
            for p in range(self.column_start[j] + 1, self.column_start[j + 1]):
                left[self.row[p]].append((p, j))
        pairs = [
            self.at(int(b.indices[v]), int(b.indices[w]))
            for b in blocks
            for v in range(len(b.indices))
            for w in range(v + 1)
        ]
        return {
            f"{name}_order": self.order,
            f"{name}_column_start": self.column_start,
            f"{name}_row": self.row,
            f"{name}_left_start": _starts(len(each) for each in left),
            f"{name}_left_entry": [p for each in left for p, _ in each],
            f"{name}_left_column": [j for each in left for _, j in each],
            f"{name}_condition_entry": pairs,
        }


def _starts(lengths: Iterable[int]) -> list[int]:
    return [0, *(int(end) for end in np.cumsum(list(lengths)))]


def _sparse_rows(matrix: Array) -> tuple[list[int], list[int], list[float]]:
    """Starts, columns and values of the elements of a matrix that are not zero, row by row."""
    columns = [np.flatnonzero(row) for row in matrix]
    values = [float(v) for row, own in zip(matrix, columns, strict=True) for v in row[own]]
    return _starts(len(own) for own in columns), [int(j) for own in columns for j in own], values


def _lower(matrix: Array, structure: _Structure) -> tuple[list[int], list[float]]:
    """Places and values of the elements of a symmetric matrix that are not zero."""
    pairs = [(int(i), int(j)) for i, j in zip(*np.nonzero(np.tril(matrix)), strict=True)]
    return [structure.at(i, j) for i, j in pairs], [float(matrix[i, j]) for i, j in pairs]


def _condition_tables(tables: _Tables) -> tuple[dict[str, list[int]], dict[str, list[float]]]:
    scalars, matrices = tables.scalars, tables.matrices
    numbers, places, mirrors, values, starts = [], [], [], [], [0]
    for block in matrices:
        size = block.size
        for coefficient in block.coefficients:
            for i in range(size):
                for j in range(i, size):
                    if coefficient[i, j] != 0.0:
                        numbers.append(i * size - i * (i - 1) // 2 + j - i)
                        places.append(i * size + j)
                        mirrors.append(j * size + i)
                        values.append(float(coefficient[i, j]))
            starts.append(len(places))
    indices = {
        "scalar_start": _starts(len(block.indices) for block in scalars),
        "scalar_variable": [int(i) for block in scalars for i in block.indices],
        "matrix_size": [block.size for block in matrices],
        "matrix_place": _starts(block.size**2 for block in matrices),
        "matrix_start": _starts(len(block.indices) for block in matrices),
        "matrix_variable": [int(i) for block in matrices for i in block.indices],
        "element_start": starts,
        "element_number": numbers,
        "element_place": places,
        "element_mirror": mirrors,
    }
    reals = {
        "scalar_constant": [float(block.constant[0, 0]) for block in scalars],
        "scalar_value": [float(v) for block in scalars for v in block.coefficients[:, 0, 0]],
        "matrix_constant": [float(v) for block in matrices for v in block.constant.ravel()],
        "element_value": values,
    }
    return indices, reals


def _online_files(name: str, tables: _Tables, feasible_set: FeasibleSet) -> dict[str, str]:
    """The header, the source and the self-test of the estimator."""
    m = tables.count
    model: Any = feasible_set.model
    indices, reals = _condition_tables(tables)
    own = [*tables.scalars, *tables.matrices]
    cliques = [np.asarray(block.indices) for block in own]
    cliques += [np.flatnonzero(row) for row in (*tables.K, *tables.dependent)]
    nearest, whole = _Structure.of(m, cliques), _Structure.of(m, [np.arange(m)])
    indices |= nearest.tables("correct", own) | whole.tables("fit", own)
    indices["fit_place"] = [int(i) for i in whole.place]
    indices["base_start"], indices["base_variable"], reals["base_value"] = _sparse_rows(tables.K)
    reals["base_constant"] = tables.base_constant.tolist()
    rows = _sparse_rows(tables.N)
    indices["parameter_start"], indices["parameter_variable"], reals["parameter_value"] = rows
    reals["parameter_constant"] = tables.constant.tolist()
    indices["distance_entry"], reals["distance_value"] = _lower(2.0 * tables.K.T @ tables.K, nearest)
    unmeasured = tables.dependent.T @ tables.dependent
    indices["unmeasured_entry"], reals["unmeasured_curvature"] = _lower(unmeasured, nearest)
    reals["unmeasured_linear"] = (tables.dependent.T @ tables.dependent_constant).tolist()
    indices["independent"] = [int(i) for i in model.base_parameters().independent]
    offset = tables.constant - tables.reference
    indices["prior_entry"], reals["prior_curvature"] = _lower(tables.N.T @ tables.curvature @ tables.N, whole)
    reals["prior_linear"] = (tables.N.T @ (tables.curvature @ offset)).tolist()
    reals["interior_point"] = tables.interior.tolist()
    joints = [np.asarray(columns) for columns in model.base_columns.joints]
    indices["joint_start"] = _starts(len(columns) for columns in joints)
    indices["joint_column"] = [int(i) for columns in joints for i in columns]
    triangles = [(len(columns) + 1) * (len(columns) + 2) // 2 for columns in joints]
    indices["triangle_start"] = _starts(triangles)

    largest = max([block.size for block in tables.matrices], default=1)
    sizes: dict[str, int | float] = {
        "JOINT_COUNT": len(joints),
        "PARAMETER_COUNT": feasible_set.parameter_count,
        "BASE_COUNT": tables.K.shape[0],
        "TRIANGLE_SIZE": sum(triangles),
        "VARIABLES": m,
        "ENTRIES": len(nearest.row),
        "MOST_ENTRIES": len(whole.row),
        "SCALAR_PLACES": max(len(tables.scalars), 1),
        "ELEMENT_PLACES": max(sum(block.size**2 for block in tables.matrices), 1),
        "TRIANGLE": largest * (largest + 1) // 2,
    }
    further: dict[str, int | float] = {
        "LARGEST": largest,
        "SCALARS": len(tables.scalars),
        "MATRICES": len(tables.matrices),
        "ELEMENTS": sum(block.size**2 for block in tables.matrices),
        "ORDER": float(max(sum(block.size for block in own), 1)),
        "DISTANCE_ENTRIES": len(indices["distance_entry"]),
        "UNMEASURED": len(indices["unmeasured_entry"]),
        "PRIOR_ENTRIES": len(indices["prior_entry"]),
        "PRIOR_CONSTANT": float(0.5 * offset @ tables.curvature @ offset),
        "HAS_EQUATIONS": int(bool(feasible_set.equalities)),
        "IS_CONE": int(tables.is_cone),
        "MARGIN": feasible_set.margin,
        "LEAST_UNIT": max(
            1e3 * feasible_set.margin, 4.0 * feasible_set.margin / tables.room if tables.is_cone else 0.0
        ),
        **CONSTANTS,
    }
    index = _index_type(max(max(values, default=0) for values in indices.values()))
    first = f"/* {marker(__version__)} */"
    about = comment_lines([f"The estimator of the robot {model.robot.name!r}, {feasible_set!r}."], " * ")
    header, source = (_template(suffix, name) for suffix in (".h", ".c"))
    macro = f"{name}_online".upper()
    declared = [f"#define {macro}_{key} {value}" for key, value in sizes.items()]
    header_lines = [
        first,
        "/*",
        *about,
        " */",
        f"#ifndef {macro}_H",
        f"#define {macro}_H",
        "",
        *header.splitlines(),
        "",
    ]
    header_text = "\n".join([*header_lines, f"#endif /* {macro}_H */", ""]).replace("/*SIZES*/", "\n".join(declared))
    lines = [f"#define {macro}_{key} {_literal(value)}" for key, value in further.items()]
    lines += ["", f"typedef {index} {name}_online_index;", ""]
    for key, numbers in indices.items():
        texts = textwrap.wrap(", ".join(map(str, numbers)) or "0", 96)
        lines += [f"static const {name}_online_index {key}[{max(len(numbers), 1)}] = {{"]
        lines += [*(f"    {text}" for text in texts), "};"]
    for key, values in reals.items():
        lines += [
            f"static const double {key}[{max(len(values), 1)}] = {{",
            *number_lines(values or [0.0], "    "),
            "};",
        ]
    lines += [
        "",
        "/* Where a Newton matrix and its factor have elements. */",
        "typedef struct {",
        "    int32_t entries;",
    ]
    fields = ("order", "column_start", "row", "left_start", "left_entry", "left_column", "condition_entry")
    lines += [*(f"    const {name}_online_index *{field};" for field in fields), "} structure;", ""]
    for kind, entries in (("correct", len(nearest.row)), ("fit", len(whole.row))):
        lines += [f"static const structure {kind}_structure = {{", f"    {entries},"]
        lines += [*(f"    {kind}_{field}," for field in fields[:-1]), f"    {kind}_{fields[-1]}", "};"]
    begun = [first, f'#include "{name}_online.h"', "", "#include <float.h>"]
    source_text = "\n".join([*begun, source]).replace("/*TABLES*/", "\n".join(lines))
    return {
        f"{name}_online.h": header_text,
        f"{name}_online.c": source_text,
        f"{name}_online_test.c": _self_test(name, tables, feasible_set),
    }


def _index_type(greatest: int) -> str:
    """The type of the tables: half the memory where it suffices, and one that compiles without a warning otherwise."""
    return "uint16_t" if greatest < 2**16 else "int32_t"


def _literal(value: float) -> str:
    return str(value) if isinstance(value, int) else number(value)


def _template(suffix: str, name: str) -> str:
    """A template for a robot. What stands between two marks in pairs of numbers comes in doubles first."""
    text = Path(__file__).with_name(f"robot_online{suffix}").read_text(encoding="utf-8")
    parts = text.split("/*TWICE*/\n")
    parts[1::2] = [part.replace("robot_online_pair", "double").replace("pair", "double") + part for part in parts[1::2]]
    return "".join(parts).replace("robot_online", f"{name}_online").replace("ROBOT_ONLINE", f"{name}_online".upper())


def _with_estimator(text: str, name: str) -> str:
    """The CMake project with the estimator in its library, and its self-test."""
    text = text.replace(f"{name}.c {name}.h", f"{name}.c {name}.h {name}_online.c {name}_online.h")
    test = [
        f"  add_executable({name}_online_test {name}_online_test.c)",
        f"  target_link_libraries({name}_online_test PRIVATE {name})",
        f"  add_test(NAME {name}_online_reference_values COMMAND {name}_online_test)",
        "endif()",
    ]
    head, _, tail = text.rpartition("endif()")
    return head + "\n".join(test) + tail


def _guide(name: str) -> str:
    """Return what the README says of the estimator."""
    return f"""
## The estimator

`{name}_online.c` counts samples and finds physically possible parameters. It allocates nothing: the memory of a call is
a `{name}_online_workspace`, which is large and belongs in static memory, one for each thread. Do not compile it with
`-ffast-math`.

```c
#include "{name}.h"
#include "{name}_online.h"

static {name}_online_data data;
static {name}_online_workspace work;
static {name}_online_answer answer;

{name}_online_begin(&data);
/* for each sample: regressor by {name}_regressor(q, dq, ddq, regressor) */
{name}_online_update(&data, regressor, torque, 0.9999, &work);
/* joints at rest or with a clipped torque: {name}_online_update_joints(..., counted, ...) leaves them out */
/* in a slower task, on a copy of the data */
if ({name}_online_fit(&data, weights, 1.0, &work, &answer) == {name.upper()}_ONLINE_SOLVED) {{
    /* answer.parameters, answer.base */
}}
```

Whatever comes in, `answer.parameters` are possible. `{name.upper()}_ONLINE_STOPPED` says that they are not the best,
`{name.upper()}_ONLINE_REFUSED` that an argument was no number.
"""


def _reference_bases(tables: _Tables) -> Array:
    """Base parameters of the self-test: possible, impossible and far off ones, and zero."""
    random = np.random.default_rng(1)
    inside = tables.feasible_set.K @ (tables.constant + tables.N @ tables.interior)
    noise = random.normal(size=(4, len(inside)))
    return np.array([inside, inside + 0.3 * noise[0], inside + 3.0 * noise[1], 30.0 * noise[2], 0.0 * inside])


def _self_test(name: str, tables: _Tables, feasible_set: FeasibleSet) -> str:
    """The program that compares with Clarabel's answers, and with sums of squares that NumPy computed."""
    model: Any = feasible_set.model
    given, expected = [], []
    for base in _reference_bases(tables):
        try:
            found = correct(feasible_set, base=base)
        except SolverError:  # of the reference, not of what is tested
            continue
        given.append(base)
        expected.append(found.squared_distance)
    random = np.random.default_rng(2)
    N = model.dof
    motion = random.normal(size=(3, SAMPLES, N))
    regressor = np.asarray(model.kernel("regressor", base=True)(*motion)).reshape(SAMPLES, N, -1)
    truth = feasible_set.K @ (tables.constant + tables.N @ tables.interior)
    torque = regressor @ truth
    return _TEST.format(
        first=f"/* {marker(__version__)} */",
        name=name,
        upper=f"{name}_online".upper(),
        cases=len(given),
        bases=_rows(np.array(given)),
        expected=", ".join(map(number, expected)),
        samples=SAMPLES,
        regressors=_rows(regressor.reshape(SAMPLES, -1)),
        torques=_rows(torque),
        residuals=", ".join(number(v) for v in np.sum(torque**2, axis=0)),
        truth=", ".join(number(v) for v in truth),
    )


SAMPLES = 3
"""The number of samples in the self-test of the update; each regressor has as many numbers as joints times base
parameters."""


def _rows(matrix: Array) -> str:
    """Rows of numbers as an initializer."""
    return ",\n".join("\n".join(["    {", *number_lines(row, "        "), "    }"]) for row in matrix)


_TEST = """{first}
#include "{name}_online.h"

#include <math.h>
#include <stdio.h>

static const double bases[{cases}][{upper}_BASE_COUNT] = {{
{bases}
}};
/* Squared distances that another solver found. */
static const double distances[{cases}] = {{ {expected} }};
static const double regressors[{samples}][{upper}_JOINT_COUNT * {upper}_BASE_COUNT] = {{
{regressors}
}};
static const double torques[{samples}][{upper}_JOINT_COUNT] = {{
{torques}
}};
/* Base parameters that explain these torques, and the squares of the torques. */
static const double truth[{upper}_BASE_COUNT] = {{ {truth} }};
static const double squares[{upper}_JOINT_COUNT] = {{ {residuals} }};

static {name}_online_workspace work;
static {name}_online_answer answer;
static {name}_online_data data;

static int check(int holds, const char *what, int number)
{{
    if (!holds) {{
        printf("%s fails, number %d\\n", what, number);
    }}
    return holds ? 0 : 1;
}}

int main(void)
{{
    int count = 0;
    for (int i = 0; i < {cases}; ++i) {{
        const {name}_online_status status = {name}_online_correct(bases[i], &work, &answer);
        double size = 0.0;
        for (int k = 0; k < {upper}_BASE_COUNT; ++k) {{
            size += bases[i][k] * bases[i][k];
        }}
        const double error = fabs(answer.objective - distances[i]);
        count += check(status <= {upper}_UNCHANGED, "the end of a correction", i);
        count += check(error <= (1e-4 * distances[i]) + (1e-9 * size) + 1e-12, "a correction", i);
    }}
    double refused[{upper}_BASE_COUNT] = {{ 0.0 }};
    refused[0] = NAN;
    count += check({name}_online_correct(refused, &work, &answer) == {upper}_REFUSED, "a refusal", 0);

    {name}_online_begin(&data);
    for (int i = 0; i < {samples}; ++i) {{
        count += check({name}_online_update(&data, regressors[i], torques[i], 1.0, &work) ==
                           {upper}_SOLVED, "an update", i);
    }}
    double zero[{upper}_BASE_COUNT] = {{ 0.0 }};
    double found[{upper}_JOINT_COUNT];
    {name}_online_squared_residuals(&data, zero, found);
    for (int j = 0; j < {upper}_JOINT_COUNT; ++j) {{
        count += check(fabs(found[j] - squares[j]) <= 1e-9 * squares[j] + 1e-12, "a sum of squares", j);
    }}
    {name}_online_squared_residuals(&data, truth, found);
    for (int j = 0; j < {upper}_JOINT_COUNT; ++j) {{
        count += check(found[j] <= 1e-18 * squares[j] + 1e-18, "a squared residual", j);
    }}
    bool none[{upper}_JOINT_COUNT] = {{ false }};
    double before[{upper}_JOINT_COUNT];
    {name}_online_squared_residuals(&data, zero, before);
    count += check({name}_online_update_joints(&data, regressors[0], torques[0], none, 0.5, &work) ==
                       {upper}_SOLVED, "an update of no joint", 0);
    {name}_online_squared_residuals(&data, zero, found);
    for (int j = 0; j < {upper}_JOINT_COUNT; ++j) {{
        count += check(!(found[j] < before[j]) && !(found[j] > before[j]), "what is left out", j);
    }}
    double weights[{upper}_JOINT_COUNT];
    for (int j = 0; j < {upper}_JOINT_COUNT; ++j) {{
        weights[j] = 1.0;
    }}
    count += check({name}_online_fit(&data, weights, 1e-3, &work, &answer) == {upper}_SOLVED, "a fit", 0);
    if (count > 0) {{
        printf("%d checks fail\\n", count);
        return 1;
    }}
    printf("all corrections, updates and fits agree with the reference values\\n");
    return 0;
}}
"""
