"""Gain and phase margins of one loop: proved beside what samples have, and one fault at a time."""

import json
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_are

import polefence as pf
from polefence.certify.bounds import best_bound, kept_bound
from polefence.law.laws import given_law
from polefence.plant.exact import file_plant
from polefence.proof.claims.base import prove
from polefence.proof.claims.factor_margin import (
    Place,
    closed_loop,
    grown,
    of_arc,
    of_gains,
    on_circle,
    tangent_up,
)
from polefence.proof.covers import COVERS
from polefence.proof.document import check, loads
from polefence.proof.laws import Evidence, read_law
from polefence.proof.ranges import corner_weights
from polefence.proof.reading import Table
from polefence.proof.work import FormatError
from polefence.requirements.text import parse_specification
from polefence.response.modes import Modes
from polefence.response.samples import at_sample_time

# k / (s (s + 1) (s + 2)) with k = 1: its phase is -180 deg at sqrt(2) rad/s, where it has 1/6.
A, B, K = [[0, 1, 0], [0, 0, 1], [0, -2, -3]], [[0], [0], [1]], [[-1.0, 0, 0]]


@pytest.fixture(scope="module")
def known():
    plant = pf.UncertainPlant.from_vertices([A], [B])
    return plant, given_law(plant, K)


def crossing_of_known():
    """Where w^2 = x solves x (x + 1) (x + 4) = 1."""
    return math.sqrt(max(np.roots([1, 5, 4, -1]).real))


def phase_of_known():
    w = crossing_of_known()
    return 90 - math.degrees(math.atan(w) + math.atan(w / 2))


@pytest.mark.parametrize("loop", ["u1", "x1"])
def test_margins_of_a_known_loop_from_both_sides(known, loop):
    plant, law = known
    for asked, true in (
        (pf.GainMargin.least(loop), 6.0),
        (pf.PhaseMargin.least(loop), phase_of_known()),
    ):
        bound = best_bound(plant, law, asked)
        assert true * (1 - 3e-5) < bound.number < true * (1 + 1e-5)
        assert kept_bound(plant, law, type(asked).least(loop, true * 0.999)) is not None
        assert kept_bound(plant, law, type(asked).least(loop, true * 1.001)) is None
        over = replace(bound.claim, level=bound.claim.level * Fraction(99, 100))
        assert not proved(over)


def proved(claim):
    try:
        return prove(claim).proved
    except FormatError:
        return False


@given(st.fractions(0, 4), st.fractions("0.001", "0.9"), st.fractions(0, 1))
def test_a_patch_holds_its_arc(first, step, share):
    last = (first + step) / (1 - first * step) if first * step < 1 else first + step
    patch = of_arc(first, last)
    x, y = on_circle(first + share * (last - first))
    z1, z2, outer1, outer2 = patch.corners
    ring = [z1, outer1, outer2, z2]  # convex, anticlockwise
    for (ax, ay), (bx, by) in zip(ring, [*ring[1:], ring[0]], strict=True):
        assert (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0
    assert patch.at([Fraction(0), Fraction(1)]) == z2
    assert patch.at([Fraction(1), Fraction(0)]) == outer1


@given(st.fractions("0.01", "179"))
def test_the_tangent_is_rounded_up(degrees):
    above, near = tangent_up(degrees), math.tan(math.radians(float(degrees)) / 2)
    assert near * (1 - 1e-12) < above < near * (1 + 1e-12)
    assert tangent_up(Fraction(90)) >= 1


def random_loop(random, n, sampled):
    """A plant of two vertices with one parameter, and a gain that keeps it stable."""
    while True:
        first = random.normal(size=(n, n)) / math.sqrt(n)
        off, b = 0.2 * random.normal(size=(n, n)), random.normal(size=(n, 1))
        k = random.normal(size=(1, n))
        family = [first - off - 0.6 * np.eye(n), first + off - 0.6 * np.eye(n)]
        if sampled:
            family = [np.eye(n) + 0.3 * M for M in family]
            b = 0.3 * b
        closed = [t * family[1] + (1 - t) * family[0] + b @ k for t in np.linspace(0, 1, 9)]
        values = [np.linalg.eigvals(M) for M in closed]
        if all((np.abs(v).max() < 0.97) if sampled else (v.real.max() < -0.05) for v in values):
            return [np.round(M, 3) for M in family], np.round(b, 3), np.round(k, 3)


def stable(M, sampled):
    values = np.linalg.eigvals(M)
    return np.abs(values).max() < 1 if sampled else values.real.max() < 0


def sampled_margin(family, b, k, row, factors, sampled):
    """The first of rising factors at which a loop of the family is unstable."""
    for f in factors:
        for t in np.linspace(0, 1, 41):
            M = t * family[1] + (1 - t) * family[0]
            own = k.astype(complex)
            own[:, row] = own[:, row] * f if row is not None else own[:, row]
            turned = own if row is not None else own * f
            if not stable(M + b @ turned, sampled):
                return f
    return None


@pytest.mark.parametrize("seed", range(16))
def test_random_loops_have_no_less_than_is_proved(seed):
    random = np.random.default_rng(seed)
    sampled, row = bool(seed % 4 == 3), (None if seed % 2 else 0)
    family, b, k = random_loop(random, 2 + seed % 2, sampled)
    parameter = pf.Parameter("p", 1, 2)
    plant = pf.UncertainPlant(
        tuple(pf.System(M, b, name=f"vertex {j}") for j, M in enumerate(family)),
        (parameter,),
        sample_time=Fraction(1, 10) if sampled else None,
    )
    loop = "u1" if row is None else "x1"
    law = given_law(plant, k)
    gain = best_bound(plant, law, pf.GainMargin.least(loop))
    assert gain is not None
    g = gain.number
    for factors in (np.geomspace(1, g, 60), np.geomspace(1, 1 / g, 60)):
        assert sampled_margin(family, b, k, row, factors, sampled) is None
    if g < 99:  # near what one plant has
        beyond = (np.geomspace(1, 1.01 * g, 60), np.geomspace(1, 1 / (1.01 * g), 60))
        found = [sampled_margin(family, b, k, row, f, sampled) for f in beyond]
        assert any(f is not None for f in found)
    phase = best_bound(plant, law, pf.PhaseMargin.least(loop))
    assert phase is not None
    angles = np.radians(np.linspace(0, phase.number, 60))
    assert sampled_margin(family, b, k, row, np.exp(1j * angles), sampled) is None
    if phase.number < 170:
        angles = np.radians(np.linspace(0, phase.number * 1.01, 90))
        assert sampled_margin(family, b, k, row, np.exp(1j * angles), sampled) is not None


@pytest.fixture(scope="module")
def document(known, tmp_path_factory):
    plant, law = known
    limits = [pf.GainMargin.least("u1", 4.0), pf.PhaseMargin.least("x1", 40.0)]
    done = pf.analyse(plant, law, pf.HalfPlane(0.0), limits=limits)
    assert done.proved
    return json.loads(done.save(tmp_path_factory.mktemp("margins")).read_text())


def faults(document):
    gain, phase = (document["claims"][k] for k in (1, 2))
    for level in ("1/5", "1/7"):
        yield 1, gain | {"level": level}
    yield 1, {key: x for key, x in gain.items() if key != "input"} | {"measured": 2}
    yield 2, phase | {"level": "1/60"}
    yield 2, phase | {"measured": 2}
    arcs = phase["evidence"]["arcs"]
    yield 2, phase | {"evidence": {"arcs": arcs[:-1] or [arcs[0] | {"to": "1/10"}]}}
    yield 2, phase | {"evidence": {"arcs": [arcs[0] | {"to": 5}]}}
    yield 2, phase | {"evidence": {"arcs": [arcs[0] | {"to": -1}]}}
    yield 1, gain | {"level": 1}
    yield 1, gain | {"level": 0}
    yield 1, gain | {"input": 2}
    yield 1, gain | {"measured": 1}
    yield 2, phase | {"level": "1/180"}


def test_one_fault_at_a_time_is_not_proved(document):
    assert check(loads(json.dumps(document))).proved
    tried = 0
    for number, claim in faults(document):
        claims = list(document["claims"])
        claims[number] = claim
        try:
            answer = check(loads(json.dumps(document | {"claims": claims}))).proved
        except FormatError:
            answer = False
        assert not answer, claim
        tried += 1
    assert tried == 13


def test_evidence_of_fewer_factors_is_not_enough(known):
    plant, law = known
    small = kept_bound(plant, law, pf.GainMargin.least("u1", 1.01)).claim
    assert not proved(replace(small, level=Fraction(1, 5)))
    assert of_gains(Fraction(2)).corners == ((Fraction(1, 2), 0), (Fraction(2), 0))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("gain margin of u1 >= 0.5", "a factor above 1 and below 100; write 2 for 6 dB"),
        ("phase margin of u1 >= 200", "write degrees, below 175"),
        ("gain margin of u1 >= 500", "below 100"),
        ("gain margin of u3 >= 2", "no loop at 'u3'"),
        ("gain margin of u1 <= 2", "is written >= NUMBER"),
        ("gain margin of [u1, x1] >= 2", "is a vector"),
        ("gain margin of u1 >= 2 with sigma 1", "unknown key sigma"),
    ],
)
def test_bad_lines_are_refused(known, line, said):
    plant, _ = known
    with pytest.raises(pf.InputError, match=said.replace("(", r"\(")):
        parse_specification(line).require_fit(plant)


def test_of_vertices_disk_margins_are_proved():
    plant = pf.UncertainPlant.from_vertices([A, np.array(A) * 0.9], [B, B])
    with pytest.raises(pf.InputError, match="given by its vertices; ask for a disk margin"):
        pf.GainMargin.least("u1", 2.0).require_fit(plant)


def families():
    """Claims about loops: of one plant, of a box, and of samples with a curve between them."""
    one = pf.UncertainPlant.from_vertices([A], [B])
    yield one, given_law(one, K)
    spring = pf.UncertainPlant.from_expressions(
        [pf.Parameter("k", 1, 2), pf.Parameter("c", 1, 3)],
        [["0", "1"], ["-k", "-c"]],
        [["0"], ["k"]],
    )
    yield spring, given_law(spring, [[-1.5, -2.0]])
    sampled = at_sample_time(spring, Fraction(1, 5), 0)
    yield sampled, given_law(sampled, [[-0.5, -0.3]])


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("measured", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_a_family_with_factors_is_the_loops_with_them(number, measured, turned):
    plant, law = list(families())[number]
    random = np.random.default_rng(number)
    known = file_plant(plant)
    exact = read_law(Table.of(law.document(), "law"), known)[0]
    own = closed_loop(known, exact)
    patch = of_arc(Fraction(1, 5), Fraction(3, 4)) if turned else of_gains(Fraction(3))
    place = Place(1 if measured else 0, measured)
    wide = grown(own, place, patch)
    blank = (Evidence([]),)
    own, wide = replace(own, evidence=blank), replace(wide, evidence=blank)
    assert bool(wide.remainder and wide.remainder.curve) is (number == 2)
    for _ in range(5):
        at = [Fraction(int(x), 16) for x in random.integers(0, 17, len(plant.parameters))]
        more = [Fraction(int(x), 16) for x in random.integers(0, 17, 2 if turned else 1)]
        f = complex(*map(float, patch.at(more)))
        first = np.array(own.closed_loop(corner_weights(at)), dtype=float)
        none = np.array(
            replace(own, law=replace(own.law, K=[[[Fraction(0)] * len(first)]])).closed_loop(
                corner_weights(at)
            ),
            dtype=float,
        )
        row = np.ones(len(first), complex)
        row[1] = f
        told = none + (first - none) * (row if measured else f)
        if turned:
            told = np.block([[told.real, -told.imag], [told.imag, told.real]])
        found = np.array(wide.closed_loop(corner_weights([*at, *more])), dtype=float)
        assert np.allclose(found, told.real, rtol=1e-12, atol=1e-12)


def test_a_delay_margin_is_near_what_a_known_loop_has(known):
    """It is late by its phase margin at the frequency at which the loop has the size one."""
    plant, law = known
    bound = best_bound(plant, law, pf.DelayMargin.least("u1"))
    true = math.radians(phase_of_known()) / crossing_of_known()
    assert 0.998 * true < bound.number < true
    for late in np.linspace(0, bound.number, 20):  # by a Pade approximant of order 3
        n, d = pade(late)
        closed = np.polyadd(np.polymul([1, 3, 2, 0], d), n)
        assert np.roots(closed).real.max() < 0
    assert kept_bound(plant, law, pf.DelayMargin.least("u1", 1.0)) is not None
    assert kept_bound(plant, law, pf.DelayMargin.least("u1", true * 1.01)) is None
    assert not proved(replace(bound.claim, level=bound.claim.level / 2))


def crossing_delay(A, B, K):
    """The shortest delay of a stable loop of one input that is on the edge, by its response."""
    w = np.geomspace(1e-3, 1e4, 400_000)
    poles, V = np.linalg.eig(A)
    share = (K @ V)[0] * np.linalg.solve(V, B)[:, 0]
    L = (share / (1j * w[:, None] - poles)).sum(axis=1)  # u = L exp(-j w t) u
    size = np.abs(L) - 1
    at = np.flatnonzero(size[:-1] * size[1:] < 0)
    return min(np.angle(L[at]) % (2 * np.pi) / w[at], default=np.inf)


@pytest.mark.parametrize("seed", [2, 3, 5, 7, 9])
def test_delay_margins_of_random_loops_are_nearly_whole(seed):
    """Of optimal laws of random plants: more than 95 % of the least between two vertices."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 5))
    A, B = random.normal(size=(n, n)), random.normal(size=(n, 1))
    K = -B.T @ solve_continuous_are(A, B, np.eye(n), np.eye(1))
    As = [A, A + 0.02 * random.normal(size=(n, n))]
    plant = pf.UncertainPlant.from_vertices(As, [B, B])
    bound = best_bound(plant, pf.FixedGain(K), pf.DelayMargin.least("u1"))
    true = min(crossing_delay((1 - x) * As[0] + x * As[1], B, K) for x in np.linspace(0, 1, 9))
    assert 0.95 * true < bound.number < true
    # one fault at a time: another cover, a longer delay, a filter that is not that of the level
    claim = bound.claim
    assert proved(claim)
    for cover in range(len(COVERS)):
        assert cover == claim.cover or not proved(replace(claim, cover=cover))
    assert not proved(replace(claim, level=claim.level * Fraction(9, 10)))
    (own,) = claim.filters
    assert not proved(replace(claim, filters=(replace(own, d=own.d * Fraction(9, 10)),)))


def pade(late):
    """Numerator and denominator of exp(-s late)."""
    x = [late**3, 12 * late**2, 60 * late, 120]
    return [-x[0], x[1], -x[2], x[3]], x


def test_a_delay_margin_at_samples_is_of_whole_ones(known):
    """Of 1/(s (s + 1) (s + 2)) at samples: stable at each delay up to it, unstable soon after."""
    plant, law = known
    sampled = at_sample_time(plant, Fraction(1, 10), 0)
    bound = best_bound(sampled, law, pf.DelayMargin.least("u1"))
    steps = round(bound.number / 0.1)
    assert bound.claim.margin == Fraction(steps, 10)
    A, B = (M[0] for M in sampled.at(np.ones((1, 1))))
    K, n = np.asarray(law.gain(np.ones((1, 1)))).reshape(1, -1), len(A)
    found = []
    for late in range(steps + 4):
        Z = np.zeros((n + late, n + late))
        Z[:n, :n] = A
        if late:
            Z[:n, n], Z[-1, :n] = B[:, 0], K[0]
            Z[n:-1, n + 1 :] = np.eye(late - 1)
        else:
            Z = A + B @ K
        found.append(np.abs(np.linalg.eigvals(Z)).max() < 1)
    first = found.index(False)
    assert steps < first <= steps + 2
    assert f"{bound.claim.margin * 10} s" not in bound.claim.statement(file_plant(sampled))
    assert "whole samples of 100 ms" in bound.claim.statement(file_plant(sampled))
    kept = kept_bound(sampled, law, pf.DelayMargin.least("u1", 1.03))
    assert kept.claim.margin == 1
    assert not proved(replace(kept.claim, level=Fraction(1, 3)))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("step", [0.0, 0.05])
def test_slopes_of_a_delay_margin_are_those_of_central_differences(seed, step):
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(4, 4)), random.normal(size=(4, 2))
    K = -B.T @ solve_continuous_are(A, B, np.eye(4), np.eye(2))
    alpha = np.array([[1, 0], [0, 1], [0.3, 0.7]])
    own, plant = pf.DelayMargin.least("u1"), pf.UncertainPlant.from_vertices([A, 1.02 * A], [B, B])
    channel = own.channel(plant, alpha)

    def found(K):
        each = np.broadcast_to(K, (len(alpha), *K.shape))
        return own.slopes(channel.closed(each, Modes(channel.A + channel.B @ each, step)))

    slopes, size = channel.slopes(found(K)), 1e-3  # peaks are found to 1e-6
    most = np.zeros(len(alpha))
    np.maximum.at(most, found(K).points, found(K).values)
    true = own.values(plant, pf.FixedGain(K), alpha)
    assert step or np.all(most >= true * (1 - 1e-6))  # it bears no more than the loop does
    for _ in range(3):
        turn = random.normal(size=K.shape)
        ahead, back = (found(K + sign * size * turn).values for sign in (1, -1))
        along = (slopes * turn).sum(axis=(1, 2))
        difference = (ahead - back) / (2 * size)
        assert np.abs(difference - along).max() <= 2e-2 * max(np.abs(slopes).max(), 1e-3)


def test_a_law_of_the_largest_delay_margin(known):
    """Of x'' = u with |x| of at most some rms: later and later, and within the limit."""
    A, B, E = [[0, 1], [0, 0]], [[0], [1]], [[0], [1]]
    plant = pf.UncertainPlant.from_vertices([A], [B], [E])
    within = [pf.Rms("x1", limit, 1) for limit in (1.0, 2.0)]
    short, long = (pf.optimise(plant, pf.DelayMargin.least("u1"), [own]) for own in within)
    margins = [1 / done.bounds[0].level for done in (short, long)]
    assert margins[1] > 1.1 * margins[0] > 0
    for done, own in zip((short, long), within, strict=True):
        assert done.bounds[1].level <= own.at_most
        true = 1 / pf.DelayMargin.least("u1").values(plant, done.law, np.ones((1, 1)))[0]
        assert 0.9 * true < 1 / done.bounds[0].level < true


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("delay margin of x1 >= 0.1", "is no input; name one"),
        ("delay margin of u9 >= 0.1", "no loop at 'u9'"),
        ("delay margin of u1 >= 0", "must be a positive number"),
    ],
)
def test_bad_delays_are_refused(known, line, said):
    plant, _ = known
    with pytest.raises(pf.InputError, match=said):
        parse_specification(line).require_fit(plant)
    with pytest.raises(pf.InputError, match="of whole samples; ask for 0.1 s or more"):
        pf.DelayMargin.least("u1", 0.09).require_fit(at_sample_time(plant, Fraction(1, 10), 0))


def test_a_phase_margin_above_a_right_angle_is_proved_and_not_tuned_for():
    """5 / (s + k) has a phase margin of 101.5 deg at k = 1, more than any disk implies."""
    plant = pf.UncertainPlant.from_expressions([pf.Parameter("k", 1, 2)], [["-k"]], [["1"]])
    asked = pf.PhaseMargin.least("u1", 98.0)
    asked.require_fit(plant)
    law = given_law(plant, [[-5.0]])
    true = 180 - math.degrees(math.atan(math.sqrt(24)))  # size one at sqrt(25 - k^2) rad/s
    assert kept_bound(plant, law, asked) is not None
    assert kept_bound(plant, law, pf.PhaseMargin.least("u1", true + 0.1)) is None
    with pytest.raises(pf.InputError, match="a law is tuned for less than 90 deg"):
        pf.optimise(plant, None, [asked])
