"""Prove a design file in exact arithmetic: ``python exact.py design.json`` needs nothing else.

This file uses integers and the standard library only, imports nothing of its project and may be
copied out of it. It reads the plant's vertices, the disk, the law and the certificate; rebuilds
every linear matrix inequality of the theorem named; and tests each for positive definiteness by
fraction-free elimination. Numbers in the file are doubles, hence rationals; "p/q" is exact.

What is proved: for every alpha in the simplex, all eigenvalues of A(alpha) + B(alpha) K(alpha) lie
in the open disk |z - centre| < radius. With sigma = -centre, r = radius, X(alpha) > 0 the Lyapunov
matrix, it is enough (discrete-time Lyapunov inequality of (A + BK + sigma I) / r) that

    quadratic   [ r W, M_j ; M_j', r W ] > 0                 M_j = (A_j + B_j K + sigma I) W
    slack       [ r P_j, M_j ; M_j', r (G + G' - P_j) ] > 0  M_j = (A_j + B_j K + sigma I) G
    scheduled   every coefficient of the cubic form in alpha of [ r W, M ; M', r W ](alpha),
                M(alpha) = A(alpha) W(alpha) + B(alpha) Z(alpha) + sigma W(alpha), is > 0, but for
                tau times a form that is nonnegative on the simplex (Leite & Peres 2005, (15)-(17)).

Exit status: 0 proved, 1 not proved, 2 the file cannot be read.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, permutations
from typing import Any

FORMAT, VERSION = "polefence-design", 1
METHODS = ("quadratic", "slack", "scheduled")
MAX_BYTES, MAX_SIZE, MAX_VERTICES = 32_000_000, 60, 256
# Bounds on the work that a file can ask for: digits of the common denominators, and operations.
LARGEST, MAX_BITS, MAX_WORK = 10**300, 20_000, 5 * 10**8

Rationals = list[list[Fraction]]
Integers = list[list[int]]


class FormatError(ValueError):
    """The file is not a design file that this version reads; the message says where."""


@dataclass(frozen=True)
class Claim:
    """All poles of every plant of the family lie in the disk, by this law and certificate.

    ``K`` is the fixed gain (quadratic, slack); ``X`` the Lyapunov matrices: one W, or a P or W for
    each vertex; ``G`` the slack matrix; ``Z`` with ``X`` the scheduled law; ``tau`` the weight of
    the paper's right-hand sides.
    """

    method: str
    A: list[Rationals]
    B: list[Rationals]
    sigma: Fraction
    r: Fraction
    X: list[Rationals]
    K: Rationals | None = None
    G: Rationals | None = None
    Z: list[Rationals] | None = None
    tau: Fraction = Fraction(0)


@dataclass(frozen=True)
class Verdict:
    """Whether the claim is proved; ``reason`` names the inequality that fails, or counts them."""

    proved: bool
    reason: str


def prove(claim: Claim) -> Verdict:
    """Decide whether the certificate proves the claim. False says nothing about the poles.

    Raises
    ------
    FormatError
        If the claim is incomplete or inconsistent, or asks for work out of all proportion.
    """
    _require_consistent(claim)
    if claim.r <= 0:
        return Verdict(False, "the radius is not positive")
    if claim.sigma <= 0:
        return Verdict(False, "the centre is not in the left half-plane")
    if claim.tau < 0:
        return Verdict(False, "tau is negative")
    for k, X in enumerate(claim.X):
        if any(X[i][j] != X[j][i] for i in range(len(X)) for j in range(i)):
            return Verdict(False, f"Lyapunov matrix {k + 1} is not symmetric")
    count = 0
    for name, matrix in blocks(claim):
        if not is_positive_definite(matrix):
            return Verdict(False, f"inequality {name} is not positive definite")
        count += 1
    return Verdict(True, f"{count} inequalities positive definite in exact arithmetic")


def _require_consistent(claim: Claim) -> None:
    N, several = len(claim.A), claim.method in ("slack", "scheduled")
    law = (claim.K is not None, claim.G is not None, claim.Z is not None)
    expected = {
        "quadratic": (True, False, False),
        "slack": (True, True, False),
        "scheduled": (False, False, True),
    }
    if law != expected.get(claim.method):
        raise FormatError(f"law and evidence do not belong to method {claim.method!r}")
    counts = {len(claim.B), N, len(claim.X) if several else N}
    counts |= {len(claim.Z)} if claim.Z is not None else set()
    if counts != {N} or N == 0 or not claim.X:
        raise FormatError("matrices are missing: one A, B (and P, or W and Z) a vertex")
    blocks = N + N * (N - 1) + N * (N - 1) * (N - 2) // 6 if claim.method == "scheduled" else N
    if blocks * (2 * len(claim.A[0])) ** 3 > MAX_WORK:
        raise FormatError(f"{blocks} inequalities of this size are more than is checked here")


def is_positive_definite(matrix: Integers) -> bool:
    """Sylvester's criterion by fraction-free (Bareiss) elimination: all pivots are minors > 0."""
    common = math.gcd(*(entry for row in matrix for entry in row)) or 1
    # Upper triangle only: the Schur complements stay symmetric.
    rows = [[entry // common for entry in row[i:]] for i, row in enumerate(matrix)]
    previous = 1
    while rows:
        first, *rest = rows
        pivot = first[0]
        if pivot <= 0:
            return False
        rows = [
            [
                (pivot * entry - first[i + 1] * first[i + 1 + j]) // previous
                for j, entry in enumerate(row)
            ]
            for i, row in enumerate(rest)
        ]
        previous = pivot
    return True


def blocks(claim: Claim) -> Iterator[tuple[str, Integers]]:
    """Yield each inequality's name and its matrix, times a positive integer."""
    scaled = _scaled(claim)
    if claim.method == "scheduled":
        yield from _scheduled(scaled, len(claim.A))
        return
    n = len(claim.A[0])
    for j in range(len(claim.A)):
        if claim.method == "quadratic":
            M = scaled.product(j, 0)
            left = right = _times(scaled.r, scaled.X[0])
        else:
            M = scaled.product(j, 0)
            P, G = scaled.P[j], scaled.X[0]
            left = _times(scaled.r, P)
            right = [[scaled.r * (G[i][k] + G[k][i] - P[i][k]) for k in range(n)] for i in range(n)]
        yield f"at vertex {j + 1}", _join(left, M, right)


@dataclass(frozen=True)
class _Scaled:
    """Integers: A, B, sigma, r over one denominator; X, Z (and P, tau) over another."""

    A: list[Integers]
    B: list[Integers]
    sigma: int
    r: int
    X: list[Integers]
    Z: list[Integers]
    P: list[Integers]
    tau: int

    def product(self, j: int, k: int) -> Integers:
        """M_jk = A_j X_k + B_j Z_k + sigma X_k."""
        A, B, X, Z = self.A[j], self.B[j], self.X[k], self.Z[k]
        n = len(X)
        columns = [[row[c] for row in X] + [row[c] for row in Z] for c in range(n)]
        return [
            [
                sum(map(int.__mul__, A[i] + B[i], columns[c])) + self.sigma * X[i][c]
                for c in range(n)
            ]
            for i in range(n)
        ]


def _scaled(claim: Claim) -> _Scaled:
    plant = _denominator([*claim.A, *claim.B, [[claim.sigma, claim.r]]])
    P: list[Rationals] = []
    if claim.Z is not None:
        X, Z = claim.X, claim.Z
    else:
        X = [claim.X[0]] if claim.G is None else [claim.G]
        Z = [
            [
                [
                    sum((k * x for k, x in zip(row, column, strict=True)), Fraction(0))
                    for column in zip(*X[0], strict=True)
                ]
                for row in claim.K or []
            ]
        ]
        P = claim.X if claim.method == "slack" else []
    law = _denominator([*X, *Z, *P, [[claim.tau / plant]]], 2 * MAX_BITS)
    return _Scaled(
        [_integers(a, plant) for a in claim.A],
        [_integers(b, plant) for b in claim.B],
        int(claim.sigma * plant),
        int(claim.r * plant),
        [_integers(x, law) for x in X],
        [_integers(z, law) for z in Z],
        [_integers(p, law) for p in P],
        int(claim.tau * plant * law),
    )


def _scheduled(scaled: _Scaled, N: int) -> Iterator[tuple[str, Integers]]:
    """Coefficients of alpha_j^3, alpha_j^2 alpha_k and alpha_j alpha_k alpha_l: (15), (16), (17).

    tau I is taken from (15) and tau I / (N-1)^2, 6 tau I / (N-1)^2 given to (16), (17), in the
    first block: together tau times sum a_j^3 - (sum a_j^2 a_k + 6 sum a_j a_k a_l) / (N-1)^2 >= 0.
    """
    square = max(N - 1, 1) ** 2
    M = {(j, k): scaled.product(j, k) for j in range(N) for k in range(N)}

    def block(W: Integers, m: Integers, floor: int) -> Integers:
        # everything times (N-1)^2, so that the right-hand sides stay integers
        left = _times(square * scaled.r, W)
        right = [row[:] for row in left]
        for i, row in enumerate(left):
            row[i] -= floor * scaled.tau
        return _join(left, _times(square, m), right)

    W = scaled.X
    for j in range(N):
        yield f"(15) j={j + 1}", block(W[j], M[j, j], square)
    for j, k in permutations(range(N), 2):
        yield (
            f"(16) j={j + 1} k={k + 1}",
            block(_sum([W[j], W[j], W[k]]), _sum([M[j, j], M[j, k], M[k, j]]), -1),
        )
    for triple in combinations(range(N), 3):
        w = _times(2, _sum([W[j] for j in triple]))
        m = _sum([M[pair] for pair in permutations(triple, 2)])
        yield (
            "(17) " + " ".join(f"{n}={j + 1}" for n, j in zip("jkl", triple, strict=True)),
            block(w, m, -6),
        )


def _join(left: Integers, M: Integers, right: Integers) -> Integers:
    transposed = [list(column) for column in zip(*M, strict=True)]
    upper = [a + b for a, b in zip(left, M, strict=True)]
    return upper + [a + b for a, b in zip(transposed, right, strict=True)]


def _times(factor: int, matrix: Integers) -> Integers:
    return [[factor * entry for entry in row] for row in matrix]


def _sum(matrices: list[Integers]) -> Integers:
    return [
        [sum(entries) for entries in zip(*rows, strict=True)]
        for rows in zip(*matrices, strict=True)
    ]


def _denominator(matrices: list[Rationals], limit: int = MAX_BITS) -> int:
    common = 1
    for entry in (entry for M in matrices for row in M for entry in row):
        common = math.lcm(common, entry.denominator)
        if common.bit_length() > limit:
            raise FormatError("the numbers' common denominator is out of all proportion")
    return common


def _integers(matrix: Rationals, denominator: int) -> Integers:
    return [[e.numerator * (denominator // e.denominator) for e in row] for row in matrix]


# --- counterexamples -----------------------------------------------------------------------------


def poles_inside(claim: Claim, alpha: list[Fraction]) -> bool:
    """Decide exactly whether all poles at one alpha lie in the open disk.

    The Schur-Cohn matrix of det(z I - (A + BK + sigma I) / r) is positive definite if and only if
    all roots lie in the open unit disk. A law that is undefined at alpha keeps no pole anywhere.

    Raises
    ------
    ValueError
        If alpha is not a point of the simplex.
    """
    if len(alpha) != len(claim.A) or min(alpha) < 0 or sum(alpha) != 1:
        raise ValueError("alpha is not a point of the simplex")
    if claim.r <= 0:
        return False
    A, B = _mix(alpha, claim.A), _mix(alpha, claim.B)
    K = claim.K
    if claim.method == "scheduled" and claim.Z is not None:
        K = _right_divide(_mix(alpha, claim.Z), _mix(alpha, claim.X))
    if K is None:
        return False
    n = len(A)
    closed = [
        [
            (
                A[i][j]
                + sum((B[i][q] * K[q][j] for q in range(len(K))), Fraction(0))
                + (claim.sigma if i == j else 0)
            )
            / claim.r
            for j in range(n)
        ]
        for i in range(n)
    ]
    return is_positive_definite(_schur_cohn(_characteristic(closed)))


def _mix(alpha: list[Fraction], matrices: list[Rationals]) -> Rationals:
    return [
        [
            sum((a * e for a, e in zip(alpha, entries, strict=True)), Fraction(0))
            for entries in zip(*rows, strict=True)
        ]
        for rows in zip(*matrices, strict=True)
    ]


def _right_divide(Z: Rationals, W: Rationals) -> Rationals | None:
    """Return Z W^-1 by Gauss-Jordan elimination on columns, None where W is singular."""
    n = len(W)
    table = [[W[i][j] for i in range(n)] + [row[j] for row in Z] for j in range(n)]
    for p in range(n):
        pivot = next((i for i in range(p, n) if table[i][p]), None)
        if pivot is None:
            return None
        table[p], table[pivot] = table[pivot], table[p]
        table[p] = [e / table[p][p] for e in table[p]]
        for i in range(n):
            factor = table[i][p]
            if i != p and factor:
                table[i] = [a - factor * b for a, b in zip(table[i], table[p], strict=True)]
    return [[table[i][n + q] for i in range(n)] for q in range(len(Z))]


def _characteristic(matrix: Rationals) -> list[Fraction]:
    """Coefficients of det(z I - matrix), highest power first (Faddeev-LeVerrier)."""
    n = len(matrix)
    coefficients = [Fraction(1)]
    power = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    for k in range(1, n + 1):
        columns = list(zip(*power, strict=True))
        power = [
            [
                sum((a * b for a, b in zip(row, column, strict=True)), Fraction(0))
                for column in columns
            ]
            for row in matrix
        ]
        coefficients.append(-sum((power[i][i] for i in range(n)), Fraction(0)) / k)
        for i in range(n):
            power[i][i] += coefficients[-1]
    return coefficients


def _schur_cohn(polynomial: list[Fraction]) -> Integers:
    """T1 T1' - T2 T2' of the polynomial's triangular Toeplitz matrices, as integers."""
    n = len(polynomial) - 1
    denominator = math.lcm(*(c.denominator for c in polynomial))
    a = [int(c * denominator) for c in polynomial]
    return [
        [
            sum(a[i - k] * a[j - k] - a[n - i + k] * a[n - j + k] for k in range(min(i, j) + 1))
            for j in range(n)
        ]
        for i in range(n)
    ]


# --- reading -------------------------------------------------------------------------------------

_RATIONAL = re.compile(r"-?[0-9]{1,300}(/[1-9][0-9]{0,300})?")


def read(text: str) -> tuple[Claim, dict[str, Any]]:
    """Parse a design file; return its claim and the whole document.

    Raises
    ------
    FormatError
        If it is no JSON, cut short, of another format or version, or its shapes do not fit.
    """
    if len(text) > MAX_BYTES:
        raise FormatError("the file is too long to be a design file")
    try:
        document = json.loads(text, parse_constant=_refuse, object_pairs_hook=_unique)
    except FormatError:
        raise
    except (ValueError, RecursionError) as error:
        raise FormatError(f"no design.json: not valid JSON, or cut short: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise FormatError(f'not a design file: "format" must be "{FORMAT}"')
    if type(document.get("version")) is not int or document["version"] != VERSION:
        raise FormatError(
            f"format version {document.get('version')!r} is not {VERSION}, the one read here; "
            "use a later release of polefence"
        )
    return _claim(document), document


def _claim(document: dict[str, Any]) -> Claim:
    vertices = _list(_at(document, "plant", "vertices"), "plant.vertices", MAX_VERTICES)
    A = [_matrix(_at(v, "A"), f"vertex {j + 1}: A") for j, v in enumerate(vertices)]
    B = [_matrix(_at(v, "B"), f"vertex {j + 1}: B") for j, v in enumerate(vertices)]
    n, m, N = len(A[0]), len(B[0][0]), len(A)
    for j in range(N):
        _shape(A[j], n, n, f"vertex {j + 1}: A")
        _shape(B[j], n, m, f"vertex {j + 1}: B")
    _denominator([*A, *B])
    if _at(document, "region", "kind") != "disk":
        raise FormatError('region.kind must be "disk"')
    centre = read_number(_at(document, "region", "centre"), "region.centre")
    radius = read_number(_at(document, "region", "radius"), "region.radius")
    method, kind = _at(document, "method"), _at(document, "law", "kind")
    if method not in METHODS:
        raise FormatError(f"method {method!r} is not one of {', '.join(METHODS)}")
    if kind != ("scheduled" if method == "scheduled" else "fixed"):
        raise FormatError(f"law.kind {kind!r} does not belong to method {method!r}")
    _only(document, "region", {"kind", "centre", "radius"})
    _only(document, "law", {"kind", "W", "Z"} if method == "scheduled" else {"kind", "K"})
    evidence = {"quadratic": {"W"}, "slack": {"P", "G"}, "scheduled": {"tau"}}
    _only(document, "certificate", evidence[method])

    def several(section: str, key: str, rows: int, count: int) -> list[Rationals]:
        where = f"{section}.{key}"
        values = _list(_at(document, section, key), where, MAX_VERTICES)
        if len(values) != count:
            raise FormatError(f"{where} holds {len(values)} matrices; the plant needs {count}")
        found = [_matrix(v, f"{where}[{k + 1}]") for k, v in enumerate(values)]
        for k, each in enumerate(found):
            _shape(each, rows, n, f"{where}[{k + 1}]")
        return found

    def one(section: str, key: str, rows: int) -> Rationals:
        found = _matrix(_at(document, section, key), f"{section}.{key}")
        _shape(found, rows, n, f"{section}.{key}")
        return found

    if method == "scheduled":
        tau = read_number(_at(document, "certificate", "tau"), "certificate.tau")
        W, Z = several("law", "W", n, N), several("law", "Z", m, N)
        return Claim(method, A, B, -centre, radius, X=W, Z=Z, tau=tau)
    K = one("law", "K", m)
    if method == "quadratic":
        return Claim(method, A, B, -centre, radius, X=[one("certificate", "W", n)], K=K)
    P, G = several("certificate", "P", n, N), one("certificate", "G", n)
    return Claim(method, A, B, -centre, radius, X=P, K=K, G=G)


def _refuse(text: str) -> Any:
    raise FormatError(f"{text} is not a finite number")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        raise FormatError(f"a key is given twice among {', '.join(k for k, _ in pairs)[:80]}")
    return table


def _at(value: Any, *keys: str) -> Any:
    for i, key in enumerate(keys):
        if not isinstance(value, dict) or key not in value:
            raise FormatError(f"{'.'.join(keys[: i + 1])} is missing")
        value = value[key]
    return value


def _only(document: dict[str, Any], section: str, known: set[str]) -> None:
    table = document.get(section)
    for key in table if isinstance(table, dict) else ():
        if key not in known:
            raise FormatError(
                f"unknown key {section}.{key[:40]}; known: {', '.join(sorted(known))}"
            )


def _list(value: Any, where: str, limit: int) -> list[Any]:
    if not isinstance(value, list) or not 1 <= len(value) <= limit:
        raise FormatError(f"{where} must be a list of 1 to {limit} entries")
    return value


def _matrix(value: Any, where: str) -> Rationals:
    rows = [_list(row, where, MAX_SIZE) for row in _list(value, where, MAX_SIZE)]
    if any(len(row) != len(rows[0]) for row in rows):
        raise FormatError(f"{where} is ragged")
    return [
        [read_number(entry, f"{where}[{i + 1}][{j + 1}]") for j, entry in enumerate(row)]
        for i, row in enumerate(rows)
    ]


def _shape(matrix: Rationals, rows: int, columns: int, where: str) -> None:
    if (len(matrix), len(matrix[0])) != (rows, columns):
        raise FormatError(f"{where} is {len(matrix)} x {len(matrix[0])}, not {rows} x {columns}")


def read_number(value: Any, where: str) -> Fraction:
    """Return a number of the file: a double is the rational it is, a string "p/q" is exact."""
    number = None
    if isinstance(value, str) and _RATIONAL.fullmatch(value):
        number = Fraction(value)
    elif isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST:
        number = Fraction(value)  # nan fails the comparison; integers are compared exactly
    if number is not None and abs(number) < LARGEST:
        return number
    raise FormatError(f'{where} = {str(value)[:40]!r} is not a finite number or "p/q"')


def main(arguments: list[str]) -> int:
    """Check one design file; see the module's text."""
    if len(arguments) != 1:
        print("usage: python exact.py design.json", file=sys.stderr)
        return 2
    try:
        with open(arguments[0], encoding="utf-8") as file:
            claim, _ = read(file.read(MAX_BYTES + 1))
    except (OSError, UnicodeDecodeError, FormatError) as error:
        print(f"{arguments[0]}: {error}", file=sys.stderr)
        return 2
    verdict = prove(claim)
    disk = f"disk centre {-float(claim.sigma):.17g}, radius {float(claim.r):.17g}"
    print(
        f"{'proved' if verdict.proved else 'not proved'}: {claim.method}, {disk}: {verdict.reason}"
    )
    return 0 if verdict.proved else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
