"""The linear matrix inequalities of each claim, one matrix a coefficient of its polynomial."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from polefence.proof.matrices import MAX_BITS, Integers, Rationals
from polefence.proof.performance.claims import (
    EnergyPeak,
    Gain,
    GainNorm,
    InitialPeak,
    Output,
    PerformanceClaim,
    RelativeRms,
    Subject,
)
from polefence.proof.performance.forms import Form, affine, bernstein, symmetric_blocks
from polefence.proof.placement import Law
from polefence.proof.polynomials import Exponent, _number

_ZERO, _ONE = Fraction(0), Fraction(1)


@dataclass(frozen=True)
class Inequality:
    """A symmetric matrix polynomial that is to be positive, raised to ``degree``.

    ``rows`` holds its blocks on the diagonal and to its right.
    """

    name: str
    rows: list[list[Form]]
    degree: int

    @property
    def size(self) -> int:
        """Number of rows of a coefficient."""
        return sum(row[0].shape[0] for row in self.rows)

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return _number(self.rows[0][0].sizes, self.degree)

    def blocks(self) -> Iterator[tuple[str, Integers]]:
        """Yield each coefficient's name, and it times a positive integer."""
        sizes = self.rows[0][0].sizes
        for e, matrix in symmetric_blocks(self.rows, self.degree):
            yield f"{self.name} at {_powers(e, sizes)}", matrix


def _powers(e: Exponent, sizes: tuple[int, ...]) -> str:
    if len(sizes) == 1:
        return " ".join(f"alpha{j + 1}^{p}" for j, p in enumerate(e) if p)
    places = [f"{'abcdefgh'[f]}{j + 1}" for f, size in enumerate(sizes) for j in range(size)]
    return " ".join(f"{place}^{p}" for place, p in zip(places, e, strict=True) if p)


def inequalities(claim: PerformanceClaim, sizes: tuple[int, ...]) -> list[Inequality]:
    """Return what proves the claim; all that is about its loop is raised to one degree."""
    if isinstance(claim, GainNorm):
        return [_gain_norm(claim, sizes)]
    X, N, Y = loop(claim.subject, claim.output, sizes)
    minus = (N + N.T).times(-_ONE)
    if isinstance(claim, Gain):
        rows = {"of X": [[X]], "of the gain": _bounded_real(claim, minus, Y)}
    elif isinstance(claim, InitialPeak):
        one = _number_of(_ONE, sizes)
        rows = {"of the decrease": [[minus]]}
        rows |= {name: [[one, x.T], [X]] for name, x in _starts(claim, sizes)}
        if claim.ellipsoid:
            X0 = affine([list(map(list, claim.ellipsoid))], sizes)
            rows["of the ellipsoid"] = [[X + X0.times(-_ONE)]]
        rows["of the output"] = [[_number_of(claim.level**2, sizes), Y], [X]]
    elif isinstance(claim, EnergyPeak):
        # the norm times Y: level / norm would not be there for a norm of zero
        driven = minus + _noise(claim.subject.E, -_ONE, sizes)
        corner = _number_of(claim.level**2, sizes)
        rows = {"of the noise": [[driven]], "of the output": [[corner, Y.times(claim.norm)], [X]]}
    else:
        driven = minus + _noise(claim.subject.E, -claim.intensity, sizes)
        corner = _number_of(claim.level**2, sizes)
        if isinstance(claim, RelativeRms):
            corner = _lower(claim, sizes).times(claim.level**2)
        rows = {"of the noise": [[driven]], "of the output": [[corner, Y], [X]]}
    needed = max(form.degree for blocks in rows.values() for row in blocks for form in row)
    degree = needed + claim.subject.evidence.elevation
    found = [Inequality(name, blocks, degree) for name, blocks in rows.items()]
    return found + (_of_baseline(claim, sizes) if isinstance(claim, RelativeRms) else [])


def _bounded_real(claim: Gain, minus: Form, Y: Form) -> list[list[Form]]:
    sizes = Y.sizes
    E = affine(claim.subject.E, sizes)
    q = E.shape[1]
    F = affine(list(claim.F) or [[[_ZERO] * q]], sizes)
    level = [[claim.level * (i == j) for j in range(q)] for i in range(q)]
    return [
        [minus, E.times(-_ONE), Y.T.times(-_ONE)],
        [affine([level], sizes), F.T.times(-_ONE)],
        [_number_of(claim.level, sizes)],
    ]


def _gain_norm(claim: GainNorm, sizes: tuple[int, ...]) -> Inequality:
    """Return [ H' H, Z' ; Z, g^2 I ] > 0 of K = Z H^-1 in the units of rows and columns."""
    n, m = len(claim.columns), len(claim.rows)
    law = _law(claim.subject.law, n, sizes)
    H = _diagonal(claim.columns, sizes) * law.part(slice(n))
    Z = _diagonal(claim.rows, sizes) * law.part(slice(n, n + m))
    square, level = H.T * H, claim.level**2
    corner = affine([[[level * (i == j) for j in range(m)] for i in range(m)]], sizes)
    degree = square.degree + claim.subject.evidence.elevation
    return Inequality("of the gain's norm", [[square, Z.T], [corner]], degree)


def _diagonal(units: tuple[Fraction, ...], sizes: tuple[int, ...]) -> Form:
    """Return diag(units)^-1."""
    count = len(units)
    return affine([[[(i == j) / units[j] for j in range(count)] for i in range(count)]], sizes)


def _starts(claim: InitialPeak, sizes: tuple[int, ...]) -> Iterator[tuple[str, Form]]:
    """Yield the initial states, as columns."""
    for k, point in enumerate(claim.points):
        yield f"of point {k + 1}", affine([[[x] for x in point]], sizes)
    for k, size in enumerate(claim.impulses):
        if size:
            E = affine(claim.subject.E, sizes)
            yield f"of impulse {k + 1}", E.part(slice(None), slice(k, k + 1)).times(size)


def _lower(claim: RelativeRms, sizes: tuple[int, ...]) -> Form:
    """Return C P C' of the baseline, which is less than its mean square."""
    C, P = affine(claim.baseline.C, sizes), claim.baseline.covariance
    return C * bernstein(P.X, sizes, P.degree) * C.T


def _of_baseline(claim: RelativeRms, sizes: tuple[int, ...]) -> list[Inequality]:
    """Return that the baseline is stable, and that P is less than its covariance."""
    baseline = claim.baseline
    stability, covariance = baseline.stability, baseline.covariance
    A = affine(baseline.A, sizes)
    X, P = (bernstein(each.X, sizes, each.degree) for each in (stability, covariance))
    N, M = A * X, A * P
    found = [
        ("X", X, stability.elevation),
        ("decrease", (N + N.T).times(-_ONE), stability.elevation),
        ("noise", M + M.T + _noise(baseline.E, claim.intensity, sizes), covariance.elevation),
    ]
    return [Inequality(f"of the baseline's {k}", [[F]], F.degree + d) for k, F, d in found]


def _noise(E: list[Rationals], intensity: Fraction, sizes: tuple[int, ...]) -> Form:
    form = affine(E, sizes)
    return (form * form.T).times(intensity)


def _number_of(value: Fraction, sizes: tuple[int, ...]) -> Form:
    return affine([[[value]]], sizes)


def loop(subject: Subject, output: Output, sizes: tuple[int, ...]) -> tuple[Form, Form, Form]:
    """Return X, N = (A + B K) X and Y = (C + D K) X, all of one degree."""
    n, evidence = len(subject.A[0]), subject.evidence
    vertices = zip(subject.A, subject.B, output.C, output.D, strict=True)
    plant = bernstein(  # [A, B; C, D]
        [
            [left + right for left, right in zip([*A, *C], [*B, *D], strict=True)]
            for A, B, C, D in vertices
        ],
        sizes,
        1,
        MAX_BITS,
    )
    law = _law(subject.law, n, sizes)
    base, driven = law.part(slice(n)), plant * law
    if evidence.X:
        V = bernstein(evidence.X, sizes, evidence.degree)
        if subject.law.W is not None:
            V = V * base
            if evidence.multiple:
                V = V + _multiples(evidence.multiple, n, sizes, evidence.degree)
        X, NY = base * V, driven * V
    else:
        scale = evidence.multiple[0] if evidence.multiple else _ONE
        X, NY = base.times(scale), driven.times(scale)
    return X.raised(NY.degree), NY.part(slice(n)), NY.part(slice(n, n + 1))


def _law(law: Law, n: int, sizes: tuple[int, ...]) -> Form:
    """Return [I; K], or [W; Z]."""
    if law.K is None:
        pairs = zip(law.W or [], law.Z or [], strict=True)
        return bernstein([w + z for w, z in pairs], sizes, law.degree)
    eye = [[_ONE * (i == j) for j in range(n)] for i in range(n)]
    return bernstein([eye + k for k in law.K], sizes, int(len(law.K) > 1))


def _multiples(values: tuple[Fraction, ...], n: int, sizes: tuple[int, ...], degree: int) -> Form:
    eyes = [[[value * (i == j) for j in range(n)] for i in range(n)] for value in values]
    return bernstein(eyes, sizes, degree)
