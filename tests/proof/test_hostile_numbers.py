"""Small files whose numbers, or sizes, ask for hours are refused by counted work."""

from __future__ import annotations

import random
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from polefence.certify.certificate import check_claim
from polefence.proof import matrices, roots, work
from polefence.proof.claims.base import prove
from polefence.proof.claims.cells import Axis, Cell, Cells, Interpolated
from polefence.proof.claims.poles import Poles
from polefence.proof.laws import Evidence, Law
from polefence.proof.regions import Disk, HalfPlane
from polefence.proof.work import FormatError

DISK = (Disk(Fraction(-40), Fraction(31)),)
ZERO, ONE = Fraction(0), Fraction(1)


def coprime(count, seed=0):
    """Denominators of 290 digits without common factors, nearly surely."""
    source = random.Random(seed)
    return [Fraction(1, source.randrange(10**289, 10**290) | 1) for _ in range(count)]


def diagonal(n, value):
    return [[value if i == j else ZERO for j in range(n)] for i in range(n)]


def fixed(A, K, X):
    """The claim that u = K x places all poles of one plant with B = [1, 0, ...]'."""
    B = [[ONE if i == 0 else ZERO] for i in range(len(A))]
    return Poles("quadratic", [A], [B], DISK, Law([K]), (Evidence([X]),))


def long_numbers(n):
    """An honest claim with coprime denominators in plant, gain and certificate."""
    A, X, K = diagonal(n, Fraction(-40)), diagonal(n, ONE), [[ZERO] * n]
    for k, value in enumerate(coprime(18, 1)):
        A[k % n][(5 * k + 1) % n] += value
    for k, value in enumerate(coprime(30, 2)):
        X[k % n][k % n] += value
    for k, value in enumerate(coprime(n, 3)):
        K[0][k] = value
    return fixed(A, K, X)


def test_coprime_denominators_are_proved_at_the_cost_of_their_length():
    claim = long_numbers(12)
    with work.counted() as count:
        assert prove(claim).proved
    short = fixed(diagonal(12, Fraction(-40)), [[ZERO] * 12], diagonal(12, ONE))
    with work.counted() as other:
        assert prove(short).proved
    assert count.spent > 100 * other.spent


def test_a_file_of_long_numbers_that_is_too_much_work_is_refused_before_it_is_done():
    claim = long_numbers(12)
    with work.counted() as count:
        prove(claim)
    with work.counted(count.spent - 1) as less, pytest.raises(FormatError, match="too long, to be"):
        prove(claim)
    assert less.spent < count.spent


def test_a_singular_inequality_of_long_numbers_is_not_eliminated():
    """No digits decide it but all; their elimination is what would take hours."""
    n = 40
    rows = [
        [Fraction(random.Random(n * i + j).getrandbits(900)) for j in range(3)] for i in range(n)
    ]
    matrix = [[int(sum(a * b for a, b in zip(x, y, strict=True))) for y in rows] for x in rows]
    with work.counted(), pytest.raises(FormatError, match="round the numbers"):
        matrices.is_positive_definite(matrix)


@pytest.mark.parametrize("scheduled", [False, True])
def test_sixty_states_of_doubles_are_refuted(scheduled):
    source = np.random.default_rng(4)
    n = 60
    A = (3 * source.normal(size=(n, n)) - 10 * np.eye(n)).tolist()
    A = [[Fraction(x) for x in row] for row in A]
    K = [[Fraction(x) for x in source.normal(size=n).tolist()]]
    if scheduled:
        W = [[Fraction(int(i == j)) + Fraction(0.01) for j in range(n)] for i in range(n)]
        B = [[ONE if i == 0 else ZERO] for i in range(n)]
        law = Law(None, [W], [K], 1)
        claim = Poles("scheduled", [A], [B], DISK, law, (Evidence([]),))
    else:
        claim = fixed(A, K, diagonal(n, ONE))
    assert check_claim(claim).answer == "refuted"


def test_refuted_cells_without_evidence_are_counted_before_the_first_is_decided(monkeypatch):
    """A thousand of them in 20 states: hours of characteristic polynomials."""
    n = 20
    source = random.Random(7)
    A = [[Fraction(source.random()) for _ in range(n)] for _ in range(n)]
    B = [[ONE] for _ in range(n)]
    axis = Axis("p", ZERO, ONE, False, (ZERO, ONE))
    K = [[Fraction(source.random()) for _ in range(n)]]
    table = Interpolated([A, A], [B, B], (axis,), [K, K])
    ends = [Fraction(k, 1009) for k in range(1010)]
    found = [Cell((a,), (b,), "refuted", point=((a + b) / 2,)) for a, b in pairwise(ends)]
    region = (HalfPlane(ONE),)

    def never(*_):
        raise AssertionError("work was begun")

    monkeypatch.setattr(roots, "characteristic", never)
    with pytest.raises(FormatError, match="to be checked"):
        prove(Cells(table, region, tuple(found)))


def test_many_large_inequalities_are_refused_before_any_work(monkeypatch):
    n, N = 60, 256
    matrix, B = diagonal(n, Fraction(-40)), [[ONE]] * n
    claim = Poles(
        "quadratic", [matrix] * N, [B] * N, DISK, Law([[[ZERO] * n]]), (Evidence([matrix]),)
    )
    monkeypatch.setattr(Poles, "inequalities", lambda claim: 1 / 0)
    with pytest.raises(FormatError, match="256 inequalities of this size"):
        prove(claim)
