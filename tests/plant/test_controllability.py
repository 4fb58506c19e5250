"""Modes that no gain moves, against plants whose modes are known, and what is refused for them."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polefence import Disk, HalfPlane, Sector, UncertainPlant, observe, place, tightest
from polefence.base.errors import PlantError, UncontrollableError, UnobservableError
from polefence.certify.checks import require_movable
from polefence.plant import controllability
from polefence.plant.controllability import PRIME, fixed_modes, surely_controllable
from polefence.requirements.gain_norm import GainNorm
from polefence.search.limits import limits
from polefence.search.optimise import optimise


def exact_matrix(rows):
    return tuple(tuple(Fraction(e) for e in row) for row in rows)


def hidden(controlled, fixed, seed=0):
    """(A, B) with a controllable block, a fixed one, and both mixed by a unimodular matrix."""
    random = np.random.default_rng(seed)
    n, d = len(controlled) + len(fixed), len(fixed)
    A = [[Fraction(0)] * n for _ in range(n)]
    for i, row in enumerate(controlled):
        A[i] = [*map(Fraction, row), *(Fraction(int(random.integers(-3, 4))) for _ in range(d))]
    for i, row in enumerate(fixed):
        A[n - d + i][n - d :] = map(Fraction, row)
    B = [[Fraction(int(i == n - d - 1))] for i in range(n)]
    for _ in range(3 * n):  # x := T x by row operations, A := T A T^-1
        i, j = random.permutation(n)[:2]
        c = int(random.integers(-2, 3))
        A[i] = [a + c * b for a, b in zip(A[i], A[j], strict=True)]
        B[i] = [a + c * b for a, b in zip(B[i], B[j], strict=True)]
        for row in A:
            row[j] -= c * row[i]
    return exact_matrix(A), exact_matrix(B)


CHAIN = [[0, 1, 0], [0, 0, 1], [5, -2, Fraction(1, 3)]]


@settings(deadline=None)
@given(
    st.lists(st.fractions(-9, 9, max_denominator=60), min_size=0, max_size=3), st.integers(0, 99)
)
def test_the_modes_that_were_hidden_are_found(roots, seed):
    fixed = [[roots[i] * (i == j) for j in range(len(roots))] for i in range(len(roots))]
    found = fixed_modes(*hidden(CHAIN, fixed, seed))
    assert found.count == len(roots)
    polynomial = [Fraction(1)]
    for root in roots:
        polynomial = [a - root * b for a, b in zip([*polynomial, 0], [0, *polynomial], strict=True)]
    assert [Fraction(c, found.whole**k) for k, c in enumerate(found.polynomial)] == polynomial


def test_a_pair_of_modes_is_printed_once():
    found = fixed_modes(*hidden(CHAIN, [[-1, 2], [-2, -1]]))
    assert str(found) == "-1 +- 2j"


def test_one_in_ten_to_the_hundred_is_seen():
    tiny = Fraction(1, 10**100)
    B = exact_matrix([[1], [1]])
    assert not fixed_modes(exact_matrix([[1, 0], [0, 1 + tiny]]), B).count
    assert str(fixed_modes(exact_matrix([[1, 0], [0, 1]]), B)) == "1"


def test_a_prime_that_divides_a_denominator_is_passed_over():
    p = 2**31 - 1
    assert next(controllability._primes()) == p
    A = exact_matrix([[Fraction(1, p), 1], [0, -2]])
    found = fixed_modes(A, exact_matrix([[1], [0]]))
    assert [Fraction(c, found.whole**k) for k, c in enumerate(found.polynomial)] == [1, 2]


def test_a_prime_at_which_the_rank_drops_does_not_mislead():
    p = 2**31 - 1
    # rank 2 modulo p: a column is a multiple of p; 3 of 4 in truth
    A = exact_matrix([[0, 0, 0, 0], [1, 0, 0, 0], [0, p, 0, 0], [0, 0, 0, -7]])
    found = fixed_modes(A, exact_matrix([[1], [0], [0], [0]]))
    assert (found.count, str(found)) == (1, "-7")


def test_primes_are_primes():
    primes = controllability._primes()
    assert [next(primes) for _ in range(4)] == [2147483647, 2147483629, 2147483587, 2147483579]


def test_sixty_states_of_long_rationals_take_one_prime(monkeypatch):
    random = np.random.default_rng(1)
    entries = [Fraction(int(a), int(b)) for a, b in random.integers(1, 2**60, (3600, 2))]
    A = exact_matrix([entries[60 * i : 60 * i + 60] for i in range(60)])
    B = exact_matrix([[int(i == 0)] for i in range(60)])
    monkeypatch.setattr(controllability, "MOST_PRIMES", 1)
    assert not fixed_modes(A, B).count


def test_entries_too_long_to_say_are_refused(monkeypatch):
    A, B = hidden(CHAIN, [[Fraction(10**200 + 1, 3)]])
    assert fixed_modes(A, B).count == 1
    monkeypatch.setattr(controllability, "MOST_PRIMES", 9)
    with pytest.raises(PlantError, match="round them"):
        fixed_modes(A, B)


@pytest.fixture(scope="module")
def lagging():
    """A double integrator beside a mode at -3 (at -4 at the second vertex) that u does not move."""
    A = [[[0, 1, 1], [0, 0, 0], [0, 0, -a]] for a in (3, 4)]
    return UncertainPlant.from_vertices(
        A, [[[0], [1], [0]]] * 2, [[[1], [0], [1]]] * 2, states=("x", "v", "lag"), name="cart"
    )


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled"])
def test_a_fixed_mode_in_the_region_is_no_obstacle(lagging, method):
    for region in (Disk(-3, 2.5), HalfPlane(1) & Sector(0.3)):
        design = place(lagging, region, method)
        assert design.proved
        assert region.contains(design.poles([0.5, 0.5]))
    best = tightest(lagging, -3, method)
    assert best.proved
    assert 1 <= best.region.radius < 1.2  # the mode at -4 is what keeps it from less
    (row,) = limits(lagging, -3, method)
    assert abs(row.radius - best.region.radius) < 1e-3


def test_a_fixed_mode_outside_is_named_with_its_vertex_and_pole(lagging):
    with pytest.raises(UncontrollableError, match=r"cart, vertex 2.*2 of 3.*pole -4, not in disk"):
        place(lagging, Disk(-3, 0.9))
    with pytest.raises(UncontrollableError, match=r"vertex 1.*pole -3, not in half_plane\(3.5\)"):
        optimise(lagging, GainNorm(), region=HalfPlane(3.5), method="scheduled")
    with pytest.raises(UncontrollableError, match="vertex 1.*pole -3"):
        tightest(lagging, of="sector", within=HalfPlane(3.2))


def test_the_limit_is_the_mode_itself(lagging):
    """Thresholds from both sides, and the boundary: a region is open."""
    for radius in (1 - 1e-9, 1.0):
        with pytest.raises(UncontrollableError, match="pole -4"):
            require_movable(lagging, Disk(-3, radius))
    require_movable(lagging, Disk(-3, 1 + 1e-9))


def test_unstable_modes_are_refused_by_the_searches_without_a_region():
    plant = UncertainPlant.from_vertices([[[0, 1], [0, 2]]], [[[1], [0]]])
    for call in (
        lambda: tightest(plant, -1, "quadratic"),
        lambda: limits(plant, -1, "quadratic"),
        lambda: tightest(plant, of="half_plane"),
    ):
        with pytest.raises(UncontrollableError, match="pole 2, not stable"):
            call()


def test_an_unseen_mode_in_the_region_is_no_obstacle_to_an_observer(lagging):
    A = [[[0, 1, 0], [0, 0, 0], [1, 0, -a]] for a in (3, 4)]
    plant = UncertainPlant.from_vertices(A, [[[0], [1], [0]]] * 2, states=("x", "v", "lag"))
    found = observe(plant, ["x"], Disk(-3, 2.5))
    assert Disk(-3, 2.5).contains(found.design.poles([0.5, 0.5]))
    with pytest.raises(UnobservableError, match="eigenvalue -4, and the pair is detectable only"):
        observe(plant, ["x"], Disk(-3, 0.9))


def test_it_is_computed_once_for_a_plant(monkeypatch):
    """Of one whose residues do not tell, A[0][1] being zero modulo the prime, by more primes."""
    calls, others = [], []

    def counted(*pairs):
        calls.append(pairs)
        return surely_controllable(*pairs)

    def counted_alone(A, B):
        others.append(A)
        return fixed_modes(A, B)

    monkeypatch.setattr("polefence.plant.family.surely_controllable", counted)
    monkeypatch.setattr("polefence.plant.system.fixed_modes", counted_alone)
    plant = UncertainPlant.from_vertices([[[0, 1], [0, -a]] for a in (1, 2)], [[[0], [1]]] * 2)
    place(plant, Disk(-3, 2))
    tightest(plant, -3, "quadratic")
    assert (len(calls), len(others)) == (1, 0)
    untold = UncertainPlant.from_vertices([[[0, PRIME], [0, -a]] for a in (1, 2)], [[[0], [1]]] * 2)
    for _ in range(2):
        require_movable(untold)
    assert (len(calls), len(others)) == (2, 2)


@pytest.mark.parametrize("seed", range(4))
def test_many_pairs_are_told_apart_at_once(seed):
    """Pairs without and with a fixed mode, and one that is controllable but modulo the prime."""
    pairs = [hidden(CHAIN, [], seed), hidden(CHAIN, [[-1]], seed), hidden(CHAIN, [[2]], seed)]
    pairs += [(exact_matrix([[0, PRIME], [0, 0]]), exact_matrix([[0], [1]]))]
    told = [
        surely_controllable(
            *(np.array([[[int(3 * e) % PRIME for e in row] for row in M]] * 3) for M in own)
        )
        for own in pairs
    ]
    assert [own.tolist() for own in told] == [[True] * 3, *[[False] * 3] * 3]
    assert [fixed_modes(*own).count for own in pairs] == [0, 1, 1, 0]


def test_several_inputs_may_reach_together_what_none_does_alone():
    A = np.array([np.zeros((2, 2)), np.zeros((2, 2)), np.eye(2)], dtype=np.int64)
    B = np.array([np.eye(2), [[1, 2], [2, 4]], np.eye(2)], dtype=np.int64)
    assert surely_controllable(A, B).tolist() == [True, False, True]


@pytest.mark.parametrize("words", [1, 2, 5])
def test_residues_are_those_of_the_numbers(words):
    prime = 2**31 - 1
    long = Fraction(3**37, 2 ** (60 * words - 30)) if words > 1 else Fraction(-7, 2)
    plant = UncertainPlant.from_vertices([[[long, -1], [-long, 3]]], [[[1], [-5]]])
    assert plant.words[2] >= words - 1
    common = int.from_bytes(plant.words[1], "little", signed=True)
    rows = [[long, -1, 1], [-long, 3, -5]]
    assert plant.residues.tolist() == [[[int(e * common) % prime for e in row] for row in rows]]
