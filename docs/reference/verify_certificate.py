"""Verify a Steelyard certificate, or an estimate.json that holds one. Usage: python verify_certificate.py FILE"""

import json
import sys
from fractions import Fraction as Q
from pathlib import Path


def require(truth, otherwise):
    """Stop where something does not hold."""
    if not truth:
        sys.exit(f"Not a proof: {otherwise}.")


def number(text):
    """Read an integer, a decimal or a quotient."""
    require(isinstance(text, str), f"{text!r} is no text with a number")
    return Q(text)


def table(entries, count, read=number, indices=1):
    """Read [[index, value], ...] or [[row, column, value], ...] with row <= column, each place once and below count."""
    require(all(len(entry) == indices + 1 for entry in entries), "a place has too many indices, or too few")
    require(all(type(i) is int and 0 <= i < count for *place, _ in entries for i in place), "a place is outside")
    require(all(place == sorted(place) for *place, _ in entries), "a place is below the diagonal")
    found = {place[0] if indices == 1 else tuple(place): read(value) for *place, value in entries}
    require(len(found) == len(entries), "a place is there twice")
    return found


def matrix(entries, size):
    """Read the upper triangle of a symmetric matrix."""
    return table(entries, size, indices=2)


def definite(place, size, strict):
    """Tell by elimination whether a matrix is positive (semi)definite: beside a zero pivot there must be zeros."""
    rows = [[place.get((min(i, j), max(i, j)), Q(0)) for j in range(size)] for i in range(size)]
    for k, row in enumerate(rows):
        if row[k] < 0 or (row[k] == 0 and (strict or any(row[k:]))):
            return False
        for other in rows[k + 1 :] if row[k] else ():
            other[k:] = [a - other[k] / row[k] * b for a, b in zip(other[k:], row[k:], strict=True)]
    return True


def body(L, first, m, consistency):
    """Return m times the inertia about the centre of mass, or m times the second moments that it comes from."""
    J = {(i, j): m * L[i, j] + first[i] * first[j] - (i == j) * sum(v * v for v in first) for i, j in L}
    half = sum(J[i, i] for i in range(3)) / 2
    return J if consistency == "inertia" else {(i, j): half * (i == j) - value for (i, j), value in J.items()}


def once(pairs):
    """Make an object in which no key is there twice."""
    require(len(dict(pairs)) == len(pairs), "a key is there twice")
    return dict(pairs)


document = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"), object_pairs_hook=once)
certificate = document.get("certificate", document)
require(isinstance(certificate, dict), "the file holds no certificate")
require(certificate.get("format") == "steelyard-certificate-1", "its format is another")
statement, proof = certificate["statement"], certificate["proof"]
names, base = statement["parameter_names"], [number(value) for value in statement["base"]]
K, equations = [table(row, len(names)) for row in statement["base_map"]], statement["equations"]
parts = [  # of each condition: its constant matrix, and that of each parameter
    (matrix(c["constant"], c["size"]), table(c["coefficients"], len(names), lambda m, c=c: matrix(m, c["size"])))
    for c in statement["conditions"]
]
require(all(type(c[k]) is bool for c in statement["conditions"] for k in ("strict", "physical")), "true or false lack")
require(all(type(c["size"]) is int and c["size"] > 0 for c in statement["conditions"]), "a size is none")
require(all(number(e["tolerance"]) >= 0 for e in equations), "a tolerance is negative")
require(len(set(names)) == len(names), "two parameters share a name")
require(statement["consistency"] in ("full", "inertia"), "nothing defines its consistency")
if certificate["verdict"] == "feasible":
    delta = [number(value) for value in proof["parameters"]]
    dot = lambda row: sum(value * delta[i] for i, value in row.items())  # noqa: E731
    require(len(delta) == len(names) and [dot(row) for row in K] == base, "K δ = β does not hold")
    at, links = dict(zip(names, delta, strict=True)), [name[3:] for name in names if name.startswith("Lxx")]
    for k in links:
        L = {(i, j): at[f"L{'xyz'[i]}{'xyz'[j]}{k}"] for i in range(3) for j in range(i, 3)}
        mass, J = at[f"m{k}"], body(L, [at[f"l{axis}{k}"] for axis in "xyz"], at[f"m{k}"], statement["consistency"])
        require(mass > 0 and definite(J, 3, strict=True), f"body {k} cannot exist")
    require(links, "it is about no body")
    for c, (D, matrices) in zip(statement["conditions"], parts, strict=True):
        for index, elements in matrices.items():
            for place, value in elements.items():
                D[place] = D.get(place, 0) + value * delta[index]
        require(definite(D, c["size"], c["strict"]), f"{c['name']} does not hold")
    for e in equations:
        row, value, tolerance = table(e["coefficients"], len(names)), number(e["value"]), number(e["tolerance"])
        require(tolerance <= Q(1, 10**9) * max(map(abs, [value, *row.values()])), f"{e['name']} is loose")
        require(abs(dot(row) - value) <= tolerance, f"{e['name']} does not hold")
else:
    require(certificate["verdict"] == "infeasible", "its verdict is neither")
    y, multipliers = [number(v) for v in proof["direction"]], [number(v) for v in proof["multipliers"]]
    shift = number(proof["shift"])
    total, strict, left = sum(a * b for a, b in zip(y, base, strict=True)), False, [Q(0)] * len(names)
    for index, Z in table(proof["duals"], len(parts), list).items():
        c, (constant, matrices) = statement["conditions"][index], parts[index]
        Z = matrix(Z, c["size"])
        product = lambda m, Z=Z: sum(v * Z.get(p, 0) * (1 if p[0] == p[1] else 2) for p, v in m.items())  # noqa: E731
        added = {(i, i): Z.get((i, i), 0) + shift for i in range(c["size"])} if c["physical"] else {}
        require(definite(Z | added, c["size"], strict=False), f"the dual matrix of {c['name']} is not semidefinite")
        strict, total = strict or (c["strict"] and any(Z.values())), total + product(constant)
        for i, elements in matrices.items():
            left[i] += product(elements)
    for e, multiplier in zip(equations, multipliers, strict=True):
        total += abs(multiplier) * number(e["tolerance"]) - multiplier * number(e["value"])
        for i, value in table(e["coefficients"], len(names)).items():
            left[i] += multiplier * value
    for row, weight in zip(K, y, strict=True):
        for i, value in row.items():
            left[i] -= weight * value
    require(not any(left), "its dual point is not orthogonal to every parameter")
    require(total < 0 or (total == 0 and strict and not shift), "it contradicts nothing")
    require(0 <= shift * max(10**6, 10**4 * max(map(abs, base))) <= -total, "it does not reach far enough")
if document is not certificate:  # the numbers of an estimate are the doubles nearest to the exact ones
    require(certificate["verdict"] == "feasible", "it is about no feasible estimate")
    for name, exact in (("parameters", proof["parameters"]), ("base", statement["base"])):
        require(document[name] == [float(Q(value)) for value in exact], f"the estimate has another {name}")
    for name in ("parameter_names", "base_expressions", "consistency"):
        require(document[name] == statement[name], f"the estimate has another {name}")
print("Proved:", certificate["verdict"])
