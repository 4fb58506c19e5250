"""Laws u = K(alpha) x and Lyapunov polynomials X(alpha) of their loops, as polynomials.

With W = I and Z = K for a gain, and K = Z W^-1 for a scheduled law, X is W V, so that [X; K X] is
[W; Z] V, a polynomial too: V = 1 where X is the law's own W, else Q for a gain, and for a scheduled
law multiple + Q W.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from polefence.proof.matrices import Rationals, identity
from polefence.proof.polynomials import Polynomial, Sizes, bernstein, count_of
from polefence.proof.reading import Table, plain
from polefence.proof.work import FormatError

DOMAINS = ("simplex", "box")


@dataclass(frozen=True)
class Law:
    """K constant (``K`` alone); one K a corner, multi-affine between; or Z(alpha) W(alpha)^-1.

    Coefficients of W and Z are those of Bernstein polynomials: of ``degree`` in each simplex, in
    the order of `monomials`.
    """

    K: list[Rationals] | None = None
    W: list[Rationals] | None = None
    Z: list[Rationals] | None = None
    degree: int = 0

    @property
    def fixed(self) -> bool:
        """Whether it is made of gains alone."""
        return self.K is not None and self.W is None and self.Z is None

    @property
    def scheduled(self) -> bool:
        """Whether it is made of W and Z alone."""
        return self.K is None and self.W is not None and self.Z is not None

    def form(self, sizes: Sizes) -> Polynomial:
        """Return [I; K], or [W; Z]."""
        if self.K is None:
            pairs = zip(self.W or [], self.Z or [], strict=True)
            return bernstein([w + z for w, z in pairs], sizes, self.degree)
        eye = identity(len(self.K[0][0]))
        return bernstein([eye + k for k in self.K], sizes, int(len(self.K) > 1))

    def write(self, on: str) -> dict[str, Any]:
        """Return it as a file has it; ``on`` is the domain of a scheduled law."""
        if self.K is not None:
            return {"kind": "fixed", "K": plain(self.K[0])}
        table: dict[str, Any] = {"kind": "scheduled", "W": plain(self.W), "Z": plain(self.Z)}
        table |= {"degree": self.degree} if self.degree != 1 else {}
        return table | ({"on": on} if on == "box" else {})


def read_law(table: Table, n: int, m: int) -> tuple[Law, str]:
    """Read a law; return the domain of a scheduled one too, "" for a gain, which has none."""
    if table.word("kind", ("fixed", "scheduled")) == "fixed":
        return Law([table.matrix("K", m, n)]), ""
    W, Z = table.matrices("W", n, n), table.matrices("Z", m, n)
    if len(W) != len(Z):
        raise FormatError(f"{table.path('Z')} holds {len(Z)} matrices; W holds {len(W)}")
    return Law(None, W, Z, table.whole("degree", 1)), table.word("on", DOMAINS, "simplex")


@dataclass(frozen=True)
class Evidence:
    """A Lyapunov polynomial, and what a method needs besides.

    ``X`` its Bernstein coefficients, or those of Q for a scheduled law (none where it is the law's
    own W, times ``multiple`` if that holds one number), ``degree`` its degree, ``elevation`` the d
    of (sum of alpha)^d; ``multiple`` (as many as X) for scheduled laws given; ``G`` and ``epsilon``
    for slack; ``tau`` for right-hand sides.
    """

    X: list[Rationals]
    degree: int = 0
    elevation: int = 0
    multiple: tuple[Fraction, ...] = ()
    G: Rationals | None = None
    epsilon: Fraction = Fraction(0)
    tau: Fraction = Fraction(0)

    def write(self, letter: str = "X") -> dict[str, Any]:
        """Return the polynomial as a file has it."""
        table: dict[str, Any] = {letter: plain(self.X), "degree": self.degree}
        table |= {"multiple": plain(self.multiple)} if self.multiple else {}
        return table | {"elevation": self.elevation}


def read_evidence(
    table: Table, n: int, sizes: Sizes, letter: str = "X", degree: int = 0, multiple: bool = False
) -> Evidence:
    """Read a Lyapunov polynomial, of this degree where the file does not say.

    ``multiple`` is whether multiples belong to it.
    """
    X = table.matrices(letter, n, n)
    degree = table.whole("degree", degree)
    if len(X) != count_of(sizes, degree):
        raise FormatError(
            f"{table.path(letter)} holds {len(X)} matrices; its degree needs "
            f"{count_of(sizes, degree)}"
        )
    values: tuple[Fraction, ...] = ()
    if multiple and "multiple" in table:
        values = table.numbers("multiple", most=len(X))
        if len(values) != len(X):
            raise FormatError(f"{table.path('multiple')} must hold one number a matrix")
    return Evidence(X, degree, table.whole("elevation", 0), values)


def lifted(law: Law, evidence: Evidence, sizes: Sizes) -> Polynomial:
    """Return [X; K X]."""
    form = law.form(sizes)
    if not evidence.X:
        return form.times(evidence.multiple[0] if evidence.multiple else 1)
    V = bernstein(evidence.X, sizes, evidence.degree)
    if law.K is None:
        n = form.shape[1]
        V = V * form.part(slice(n))
        if evidence.multiple:
            eye = identity(n)
            multiples = [[[m * x for x in row] for row in eye] for m in evidence.multiple]
            V = V + bernstein(multiples, sizes, evidence.degree)
    return form * V


def degree_of(law: Law, evidence: Evidence) -> int:
    """Return the degree of [X; K X]."""
    if law.K is not None:
        return evidence.degree + int(len(law.K) > 1)
    return evidence.degree + 2 * law.degree if evidence.X else law.degree
