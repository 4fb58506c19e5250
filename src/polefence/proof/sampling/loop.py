"""The sampled loop as a family of its own, in the coordinates of a claim.

With y = T x, u = S v and one step of delay the states are (y, v):

    y[k + 1] = F(alpha) y[k] + G(alpha) v[k] + r[k],    v[k + 1] = K'(alpha) y[k],

K' = S^-1 K T^-1 = Z' W'^-1 with W' = T W T', Z' = S^-1 Z T'. F and G are convex combinations of the
vertices' own; what these leave out is r = E (y, v), E small: an error of the gain of n inputs whose
gain is zero. Without delay the state is y, v = K' y, and r = E (y, K' y).
"""

from __future__ import annotations

from fractions import Fraction

from polefence.proof.matrices import Rationals, right_divide, scaled
from polefence.proof.matrices import rational_product as product
from polefence.proof.placement import Claim, Law
from polefence.proof.regions import Part
from polefence.proof.sampling.claims import Sampled
from polefence.proof.service.claims import Gain, Subject
from polefence.proof.work import FormatError

ZERO, ONE = Fraction(0), Fraction(1)


def loop_claim(claim: Sampled) -> Gain:
    """Return the claim that the loop's poles lie in the disk, |E| being at most the error given.

    Raises
    ------
    FormatError
        If T is singular.
    """
    n, m = len(claim.T), len(claim.scale)
    disk = (Part("disk", (ZERO, claim.radius)),)
    family = Claim(
        "lyapunov",
        [_stacked(step, n, m, claim.delay) for step in claim.steps],
        [_inputs(step, n, m, claim.delay) for step in claim.steps],
        disk,
        _law(claim),
        (claim.evidence,),
        domain(claim),
    )
    pieces = (1,) * len(claim.ranges)
    subject = Subject(family, claim.ranges, pieces, claim.elevation)
    columns = (ONE,) * len(family.A[0])
    return Gain(subject, claim.error, rows(claim) + (ONE,) * n, columns, (claim.mu,))


def domain(claim: Sampled) -> str:
    """Return where alpha lives: with parameters on their box, where the law can be told there."""
    law = claim.design.law
    if claim.ranges and (law.K is not None or law.degree == 1):
        return "box"  # at products a law of degree one is multi-affine in the box's coordinates
    return claim.design.on


def rows(claim: Sampled) -> tuple[Fraction, ...]:
    """Return the scales of errors of v."""
    own = claim.off.rows if claim.off else claim.scale
    return tuple(claim.weight * row / s for row, s in zip(own, claim.scale, strict=True))


def _stacked(step: Rationals, n: int, m: int, delay: int) -> Rationals:
    if not delay:
        return [row[:n] for row in step]
    return [*step, *([ZERO] * (n + m) for _ in range(m))]


def _inputs(step: Rationals, n: int, m: int, delay: int) -> Rationals:
    """Return B: of v first, of the remainder r after it."""
    if not delay:
        return [row[n:] + unit for row, unit in zip(step, identity(n), strict=True)]
    upper = [[ZERO] * m + row for row in identity(n)]
    return upper + [row + [ZERO] * n for row in identity(m)]


def _law(claim: Sampled) -> Law:
    n, m = len(claim.T), len(claim.scale)
    law = claim.design.law
    if law.K is not None:
        return Law([_widened(transformed_gain(claim), n, m, claim.delay)])
    W, Z = transformed(claim)
    if claim.delay:
        eye = identity(m)
        W = [[row + [ZERO] * m for row in w] + [[ZERO] * n + row for row in eye] for w in W]
    return Law(None, W, [_widened(z, n, m, claim.delay) for z in Z], law.degree)


def _widened(gain: Rationals, n: int, m: int, delay: int) -> Rationals:
    """Add no gain of v, and of none the remainder."""
    width = n + m if delay else n
    return [row + [ZERO] * (width - n) for row in gain] + [[ZERO] * width for _ in range(n)]


def transformed(claim: Sampled) -> tuple[list[Rationals], list[Rationals]]:
    """Return W' and Z'."""
    law, T = claim.design.law, claim.T
    right = [list(column) for column in zip(*T, strict=True)]
    W = [product(product(T, w), right) for w in law.W or []]
    return W, [scaled(product(z, right), claim.scale) for z in law.Z or []]


def transformed_gain(claim: Sampled) -> Rationals:
    """Return K' of a fixed gain."""
    (K,) = claim.design.law.K or [[]]
    return scaled(product(K, inverse(claim.T)), claim.scale)


def vertices(claim: Sampled) -> list[Rationals]:
    """Return [T A T^-1, T B S] of every vertex."""
    back, found = inverse(claim.T), list[Rationals]()
    for A, B in zip(claim.design.A, claim.design.B, strict=True):
        left, right = product(product(claim.T, A), back), product(claim.T, B)
        found.append(
            [
                a + [x * s for x, s in zip(b, claim.scale, strict=True)]
                for a, b in zip(left, right, strict=True)
            ]
        )
    return found


def inverse(T: Rationals) -> Rationals:
    """Return T^-1."""
    found = right_divide(identity(len(T)), T)
    if found is None:
        raise FormatError("sampling.T is singular")
    return found


def identity(n: int) -> Rationals:
    """Return I."""
    return [[ONE if i == j else ZERO for j in range(n)] for i in range(n)]
