"""Designs at a sample time: proved of all samples of a plant, by another way than the project's.

A mass on a spring, both uncertain, pushed by the input and the disturbance; its samples are scipy's
matrix exponential at points between the vertices.
"""

import json
import math
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_lyapunov

from polefence import (
    Disk,
    EnergyPeak,
    FixedGain,
    Gain,
    HalfPlane,
    InitialPeak,
    RelativeRms,
    Rms,
    Scheduled,
    UncertainPlant,
    analyse,
    at_sample_time,
    observe,
    optimise,
    place,
    tightest,
)
from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound, dual_evidence, kept_bound
from polefence.certify.evidence import certificate_of, evidence_at
from polefence.lmi.solve.duals import DEGREES, _duals, in_parts
from polefence.plant.boxes import Box
from polefence.plant.delta import delta_form
from polefence.plant.samples import claim_of_samples
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.document import loads as read
from polefence.proof.laws import Evidence, Piece
from polefence.proof.remainder import Remainder
from polefence.proof.work import FormatError
from polefence.requirements.specification import claim_of
from polefence.search.observer import Observer
from support.specs import SPRING

T = 0.02
LAW = {0: np.array([[-30.0, -12.0]]), 1: np.array([[-30.0, -12.0, -0.2]])}


@pytest.fixture(scope="module")
def spring():
    return loads(SPRING)


@pytest.fixture(scope="module", params=[0, 1], ids=["prompt", "late"])
def plant(spring, request):
    return at_sample_time(spring, T, request.param)


def inside(count, seed=1):
    """Points of the box of two parameters."""
    pairs = np.random.default_rng(seed).random((count, 2))
    return np.array([np.kron([1 - a, a], [1 - b, b]) for a, b in pairs])


def samples(spring, alpha, T, delay):
    """[F, G, H] of the plant there, with an input on its way: scipy's exponential."""
    A, B = spring.at(alpha)
    E = np.tensordot(alpha, np.stack([v.E for v in spring.vertices]), 1)
    whole = expm(np.block([[A, B, E], [np.zeros((2, 4))]]) * T)
    F, G, H = whole[:2, :2], whole[:2, 2:3], whole[:2, 3:]
    if not delay:
        return F, G, H
    A = np.block([[F, G], [np.zeros((1, 3))]])
    return A, np.array([[0.0], [0], [1]]), np.vstack([H, [[0.0]]])


def near(plant, alpha):
    """The combination of the vertices there, with the curve."""
    return *plant.at(alpha), plant.driven(alpha)


@pytest.mark.parametrize(("T", "degree"), [(0.002, 1), (0.02, 1), (0.02, 3), (0.1, None)])
def test_all_samples_are_within_the_remainder_and_some_nearly_reach_it(spring, T, degree):
    for delay in (0, 1, 2):
        plant = at_sample_time(spring, T, delay, degree)
        assert prove(claim_of_samples(plant)).proved
        if delay == 2:
            continue
        entries, worst = np.array(plant.remainder.entries, dtype=float), 0.0
        for alpha in inside(300):
            pairs = zip(samples(spring, alpha, T, delay), near(plant, alpha), strict=True)
            off = np.abs(np.hstack([mine - other for mine, other in pairs]))
            assert np.all(off <= entries + 1e-15)
            worst = max(worst, float((off[entries > 0] / entries[entries > 0]).max()))
        assert worst > 0.5


def size(plant):
    return np.array(plant.remainder.entries, dtype=float).max()


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_the_remainder_falls_with_a_power_of_the_sample_time(spring, degree):
    sizes = [size(at_sample_time(spring, T, 0, degree)) for T in (0.02, 0.01, 0.005)]
    assert sizes[0] / sizes[1] >= 0.8 * 2 ** (degree + 1)
    assert sizes[1] / sizes[2] >= 0.8 * 2 ** (degree + 1)


def test_the_remainder_is_as_small_as_one_asks(spring):
    sizes = [size(at_sample_time(spring, 0.1, 1, degree)) for degree in range(1, 7)]
    assert all(less < 0.05 * more for more, less in pairwise(sizes))
    assert sizes[-1] < 1e-10
    # by default it is small beside what a sample changes, where that asks for no high degree
    assert at_sample_time(spring, 0.0003).remainder.degree == 1
    assert at_sample_time(spring, 0.01).remainder.degree == 2


@pytest.mark.parametrize("degree", [0, 9, 2.0, True])
def test_other_degrees_are_refused(spring, degree):
    with pytest.raises(InputError, match=r"degree = .* must be 1 to 8"):
        at_sample_time(spring, T, 0, degree)


def test_a_plant_that_is_combinations_of_its_samples_has_next_to_no_remainder():
    # A does not depend on m, so that exp(A T) B is multi-affine
    free = loads(SPRING.replace('"-k/m", "-2/m"', "0, 0").replace(K, ""))
    entries = np.array(at_sample_time(free, T).remainder.entries, dtype=float)
    assert entries.max() < 1e-8


K = '[parameter.k]\nrange = [80, 120]\nunit = "N/m"\n'


def changed(claim, what):
    """Return a claim of samples with one fault."""
    plant, share = claim.plant, Fraction(1, 2)
    entries = plant.remainder.entries
    if what == "remainder":
        less = tuple(tuple(x * share for x in row) for row in entries)
        return replace(
            claim, plant=replace(plant, remainder=replace(plant.remainder, entries=less))
        )
    if what in ("curve", "curve of what is exact"):
        curve = [[list(row) for row in M] for M in plant.remainder.curve]
        i, j = (1, 0) if what == "curve" else (2, 0)
        curve[4][i][j] += 10 * entries[1][0]
        bent = replace(plant.remainder, curve=tuple(tuple(map(tuple, M)) for M in curve))
        return replace(claim, plant=replace(plant, remainder=bent))
    if what == "vertex":
        A = [[list(row) for row in M] for M in plant.A]
        A[2][1][0] += 3 * entries[1][0]
        return replace(claim, plant=replace(plant, A=A))
    if what == "sample time":
        return replace(claim, plant=replace(plant, sample_time=plant.sample_time * 2))
    if what == "terms":
        return replace(claim, terms=2)
    if what == "E":
        E = [[[x * 2 for x in row] for row in M] for M in claim.E]
        return replace(claim, E=E)
    if what == "late":
        A = [[list(row) for row in M] for M in plant.A]
        A[0][2][1] = Fraction(1, 10**9)  # what the input on its way is not
        return replace(claim, plant=replace(plant, A=A))
    B = [[list(row) for row in M] for M in plant.B]
    B[1][0][0] += Fraction(1, 10**9)  # an input that acts at once
    return replace(claim, plant=replace(plant, B=B))


@pytest.mark.parametrize(
    "what",
    [
        "remainder",
        "curve",
        "curve of what is exact",
        "vertex",
        "sample time",
        "terms",
        "E",
        "late",
        "at once",
    ],
)
def test_a_fault_in_the_samples_is_found(spring, what):
    claim = claim_of_samples(at_sample_time(spring, T, 1, 2))
    assert prove(claim).proved
    assert not prove(changed(claim, what)).proved


def corners(plant, count, seed=3):
    """Plants of the family with all that they may be off by, at random signs."""
    rng = np.random.default_rng(seed)
    entries = np.array(plant.remainder.entries, dtype=float)
    n, m = plant.shape
    for alpha in np.vstack([np.eye(4), inside(count)]):
        R = entries * rng.choice([-1.0, 1.0], size=entries.shape)
        A, B, E = near(plant, alpha)
        yield A + R[:, :n], B + R[:, n : n + m], E + R[:, n + m :]


def wider(plant, times):
    """Return the plant with a remainder so many times as large."""
    entries = plant.remainder.entries
    more = tuple(tuple(times * x for x in row) for row in entries)
    return replace(plant, remainder=replace(plant.remainder, entries=more), sampling=None)


@pytest.mark.parametrize("times", [1, 10])
def test_regions_hold_for_all_that_is_near(plant, times):
    plant, K = wider(plant, times), LAW[plant.shape[0] - 2]
    poles = [np.abs(np.linalg.eigvals(A + B @ K)).max() for A, B, _ in corners(plant, 100)]
    worst, radius = max(poles), 0.0
    for radius in np.linspace(worst, 1, 60):
        evidence = evidence_at(plant, FixedGain(K), Disk(0, radius), (1, 0))
        if evidence is not None:
            break
    assert worst < radius < 1
    claim = certificate_of(plant, FixedGain(K), Disk(0, radius), [evidence]).claim()
    assert prove(claim).proved
    # every part of the evidence counts
    (own,) = claim.evidence
    less = [[x * Fraction(1, 2) for x in row] for row in own.spread.omega]
    for spread in (
        replace(own.spread, omega=less),
        replace(own.spread, rows=tuple(100 * x for x in own.spread.rows)),
    ):
        assert not prove(replace(claim, evidence=(replace(own, spread=spread),))).proved
    for spread, message in (
        (None, "a remainder has evidence of its own"),
        (replace(own.spread, rows=tuple(x / 2 for x in own.spread.rows)), "do not cover"),
        (replace(own.spread, kappa=Fraction(1)), "kappa"),
    ):
        with pytest.raises(FormatError, match=message):
            prove(replace(claim, evidence=(replace(own, spread=spread),)))


ASKED = [
    Rms("x", density=2.0),
    Rms(["x", "f"], density=2.0),
    EnergyPeak("x", norm=2.0),
    InitialPeak("x", points=[[1, 0]]),
    RelativeRms("x"),
]


def value(own, A, E, C, still):
    """What is bounded, of one loop; ``still`` is A without control."""
    if own.kind == "relative rms":
        rms = replace(ASKED[0], density=own.density)
        return value(rms, A, E, C, None) / value(rms, still, E, C, None)
    if own.kind in ("rms", "energy peak"):
        size = own.density / (2 * T) if own.kind == "rms" else own.norm**2 / T
        return np.sqrt(np.trace(C @ solve_discrete_lyapunov(A, size * E @ E.T) @ C.T))
    poles, V = np.linalg.eig(A)
    parts = (C @ V)[0] * np.linalg.solve(V, np.eye(len(A))[0])
    return np.abs(parts @ poles[:, None] ** np.arange(400)).max()


def rows_of(own, plant, K):
    """The signal's rows."""
    n = plant.shape[0]
    rows = {"x": np.eye(n)[:1], "f": K}
    return np.vstack([rows[y.name] for y in own.outputs(plant)])


@pytest.mark.parametrize("own", ASKED, ids=lambda own: own.title)
def test_bounds_hold_for_all_samples_and_for_all_that_is_near(spring, plant, own):
    delay = plant.shape[0] - 2
    K = LAW[delay]
    if own.kind == "initial peak":
        own = replace(own, points=[[1, 0] + [0] * delay])
    C = rows_of(own, plant, K)
    points = np.vstack([np.eye(4), inside(300)])
    true = max(
        value(own, A + B @ K, E, C, A)
        for A, B, E in (samples(spring, alpha, T, delay) for alpha in points)
    )
    off = max(value(own, A + B @ K, E, C, A) for A, B, E in corners(plant, 100))
    found = best_bound(plant, FixedGain(K), own)
    assert max(true, off) <= found.level
    assert found.level <= true * (1.7 if own.kind == "initial peak" else 1.05)
    assert prove(found.claim).proved
    whole = found.claim.subject.evidence
    first = whole.per_cell[0]
    spread = first.spread
    if first.storage:  # at all times, of the plant itself: faults are in tests/proof
        assert spread is None
        return

    def faulty(other):
        """The claim with another spread, of parts of the box in the first."""
        evidence = replace(first, spread=other)
        if whole.cells:
            own = replace(whole.cells[0], evidence=evidence)
            evidence = replace(whole, cells=(own, *whole.cells[1:]))
        subject = replace(found.claim.subject, evidence=evidence)
        return prove(replace(found.claim, subject=subject))

    rows = replace(spread, rows=tuple(10**5 * x for x in spread.rows))
    if spread.kappa:
        faults = [rows, replace(spread, kappa=spread.kappa / 2)]
    else:
        faults = [rows, replace(spread, omega=[[x / 2 for x in row] for row in spread.omega])]
    for fault in faults:
        assert not faulty(fault).proved
    with pytest.raises(FormatError, match="a remainder has evidence of its own"):
        faulty(None)


def test_a_baseline_is_proved_of_all_samples_too(spring):
    """Its stability, and that its covariance is no less than the polynomial says."""
    plant = at_sample_time(spring, T)
    own = best_bound(plant, FixedGain(LAW[0]), RelativeRms("x")).claim
    assert prove(own).proved
    base = own.baseline

    def answer(**changes):
        return prove(replace(own, baseline=replace(base, **changes)))

    for key in ("stability", "covariance"):
        evidence = getattr(base, key)
        spread = evidence.spread
        half = [[x / 2 for x in row] for row in spread.omega]
        for fault in (
            replace(spread, omega=half),
            replace(spread, rows=tuple(10**4 * x for x in spread.rows)),
        ):
            assert not answer(**{key: replace(evidence, spread=fault)}).proved
        for fault, message in (
            (None, "for the baseline too"),
            (replace(spread, rows=tuple(x / 2 for x in spread.rows)), "do not cover"),
            (replace(spread, kappa=0 if spread.kappa else Fraction(1)), "kappa is a positive"),
        ):
            with pytest.raises(FormatError, match=message):
                answer(**{key: replace(evidence, spread=fault)})
    more = [[[x * Fraction(101, 100) for x in row] for row in P] for P in base.covariance.X]
    assert not answer(covariance=replace(base.covariance, X=more)).proved
    slower = [[[x * Fraction(99, 100) for x in row] for row in A] for A in base.A]
    with pytest.raises(FormatError, match="the baseline is the plant without control"):
        answer(A=slower)
    table = own.write()["baseline"]["covariance"]["remainder"]
    assert table.keys() == {"omega", "kappa", "rows", "columns"}


def signed(plant):
    """A plant of one vertex with all that it may be off by, at every sign of every entry."""
    entries, (n, m) = np.array(plant.remainder.entries, dtype=float), plant.shape
    own, off = np.hstack(near(plant, np.ones(1))), np.argwhere(entries)
    for signs in product((-1.0, 1.0), repeat=len(off)):
        M = own.copy()
        M[tuple(off.T)] += np.array(signs) * entries[tuple(off.T)]
        yield M[:, :n], M[:, n : n + m], M[:, n + m :]


def test_a_larger_remainder_costs_more_until_nothing_is_proved(spring, plant):
    delay = plant.shape[0] - 2
    law, own, plant = FixedGain(LAW[delay]), Rms("x"), at_sample_time(spring, T, delay, 1)
    (first, *_), entries = plant.vertices, plant.remainder.entries
    exact = UncertainPlant.from_vertices(
        [first.A],
        [first.B],
        [first.E],
        sample_time=plant.sample_time,
        disturbances=["w"],
        states=plant.states,
    )
    plant = replace(exact, remainder=Remainder(entries))
    levels = [best_bound(exact, law, own).level]
    for each in (plant, wider(plant, 10)):
        levels.append(best_bound(each, law, own).level)
        rows = np.eye(len(LAW[delay][0]))[:1]
        worst = max(value(own, A + B @ law.K, E, rows, A) for A, B, E in signed(each))
        assert worst <= levels[-1]
    assert levels == sorted(levels)
    assert levels[2] > 1.01 * levels[0]
    assert best_bound(wider(plant, 2000), law, own) is None
    assert not analyse(wider(plant, 2000), law, Disk(0, 1)).proved


def test_a_remainder_costs_what_the_worst_plant_does():
    """x(t + 1) = a x + w, a = 0.5 and what it may be off by."""
    law, own = FixedGain(np.zeros((1, 1))), Rms("x1", density=2.0)
    exact = UncertainPlant.from_vertices(
        [[[0.5]]], [[[1.0]]], [[[1]]], sample_time=1, disturbances=["w"]
    )
    for off in (0, 0.01, 0.05, 0.1, 0.51):
        plant = replace(exact, remainder=Remainder(((Fraction(off), Fraction(0), Fraction(0)),)))
        found, poles = best_bound(plant, law, own), analyse(plant, law, Disk(0, 1))
        if off < 0.5:
            least = 1 / math.sqrt(1 - (0.5 + off) ** 2)
            assert least <= found.level <= 1.02 * least
            assert poles.proved
        else:
            assert found is None
            assert not poles.proved


def test_as_the_sample_time_falls_bounds_are_those_of_continuous_time(spring):
    law, own = FixedGain(LAW[0]), Rms("x")
    known = best_bound(spring, law, own).level
    far, close = (best_bound(at_sample_time(spring, T), law, own).level for T in (0.002, 0.0005))
    assert close == pytest.approx(known, rel=3e-3)
    assert abs(close - known) < abs(far - known)


@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
def test_laws_are_designed_and_their_files_proved(tmp_path, spring, plant, method):
    region = HalfPlane(1.0)
    design = place(plant, region, method)
    path = design.save(tmp_path)
    document = read(path.read_text())
    assert all(prove(claim).proved for claim in document.claims)
    assert "samples every 20 ms" in document.claims[-1].statement(document.plant)
    delay = plant.shape[0] - 2
    for alpha in inside(200):
        A, B, _ = samples(spring, alpha, T, delay)
        z = np.linalg.eigvals(A + B @ design.law.gain(alpha))
        assert np.abs(z).max() < np.exp(-T)
    # without its remainder the file's plant is another claim's
    data = json.loads(path.read_text())
    del data["plant"]["remainder"]
    with pytest.raises(FormatError, match="remainder"):
        read(json.dumps(data))


def test_the_smallest_disk_is_near_the_worst_sample_and_that_of_the_method(spring, plant):
    exact = replace(plant, remainder=None, sampling=None)
    least, found = (tightest(each, 0.3, "quadratic") for each in (exact, plant))
    worst = 0.0
    for alpha in inside(200):
        A, B, _ = samples(spring, alpha, T, plant.shape[0] - 2)
        z = np.linalg.eigvals(A + B @ found.law.gain(alpha))
        worst = max(worst, np.abs(z - 0.3).max())
    assert 0.95 * found.region.radius < worst < found.region.radius < 1.001 * least.region.radius


def test_laws_are_optimised_at_a_sample_time(tmp_path, spring, plant):
    done = optimise(plant, Rms("x"), [Rms("f", 3.0)], method="quadratic")
    document = read(done.save(tmp_path).read_text())
    assert all(prove(claim).proved for claim in document.claims)
    exact = replace(plant, remainder=None, sampling=None)
    least = optimise(exact, Rms("x"), [Rms("f", 3.0)], method="quadratic").bounds[0].level
    assert least <= done.bounds[0].level <= 1.1 * least
    worst = 0.0
    for alpha in inside(300):
        A, B, E = samples(spring, alpha, T, plant.shape[0] - 2)
        K = done.law.gain(alpha)
        X = solve_discrete_lyapunov(A + B @ K, E @ E.T / (2 * T))
        worst = max(worst, X[0, 0] ** 0.5)
        assert (K @ X @ K.T).item() <= 9.0
    assert worst <= done.bounds[0].level <= 1.1 * worst


def test_a_late_input_is_a_state_and_outputs_follow_what_acts(spring):
    plant = at_sample_time(spring, T, 2)
    assert plant.states == ("x [m]", "v [m/s]", "f, 1 sample late [N]", "f, 2 samples late [N]")
    assert plant.shape == (4, 1)
    assert at_sample_time(spring, 0.02).sample_time == Fraction(1, 50)
    assert at_sample_time(spring, "1/30").sample_time == Fraction(1, 30)
    accelerated = loads(SPRING + '[outputs."a [m/s2]"]\nC = ["-k/m", "-2/m"]\nD = ["1/m"]\n')
    late = at_sample_time(accelerated, T, 1).signal("a").exact(at_sample_time(spring, T, 1))
    assert late[0][0][2] == accelerated.signal("a").exact(accelerated)[1][0][0]
    assert not any(map(any, late[1]))


@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
def test_observers_are_proved_of_all_samples(tmp_path, spring, plant, method):
    delay, asked = plant.shape[0] - 2, HalfPlane(3.0)
    observer = observe(plant, ["x"], asked, method)
    text = observer.save(tmp_path).read_text()
    document = read(text)
    assert all(prove(claim).proved for claim in document.claims)
    assert Observer.load(tmp_path / "design.json", plant, ["x"]).design.proved
    for alpha in inside(200):
        A, _, _ = samples(spring, alpha, T, delay)
        L = observer.gain(alpha[None])[0]
        error = np.linalg.eigvals(A - L @ np.eye(len(A))[:1])
        assert np.abs(error).max() < np.exp(-3 * T)
    (claim,) = document.claims[:1]
    (own,) = claim.dual.evidence
    less = replace(own.spread, rows=tuple(1000 * x for x in own.spread.rows))
    fault = replace(claim.dual, evidence=(replace(own, spread=less),))
    assert not prove(replace(claim, dual=fault)).proved
    with pytest.raises(FormatError, match="a remainder has evidence of its own"):
        prove(replace(claim, dual=replace(claim.dual, remainder=None)))
    # of the samples of another plant it is none
    with pytest.raises(InputError, match="other matrices or parameters"):
        Observer(at_sample_time(spring, T, delay, 3), observer.design)


def test_what_is_not_proved_with_a_remainder_is_refused(spring, plant):
    with pytest.raises(InputError, match="in discrete time already, every 0.02 s"):
        at_sample_time(plant, T)
    for wrong, message in (
        (-1, "must be positive"),
        (0, "must be positive"),
        ("soon", "sample_time"),
        (3.0, "take a shorter sample time"),
    ):
        with pytest.raises(InputError, match=message):
            at_sample_time(spring, wrong)
    for wrong in (-1, 65, -0.5, "late"):
        with pytest.raises(InputError, match="must be (0 to 64, in|a number of) samples"):
            at_sample_time(spring, T, wrong)


def of_one(**more):
    """The file of a plant x' = -x + u + w, u = 0, with a bound on the gain in its dual form."""
    evidence = {"Q": [[[1]]], "degree": 0, "elevation": 0, "on": "simplex"}
    return {
        "format": "polefence-proof",
        "version": 2,
        "plant": {
            "name": "lag",
            "states": ["x"],
            "inputs": ["u"],
            "disturbances": ["w"],
            "parameters": [],
            "vertices": [{"A": [[-1]], "B": [[1]], "E": [[1]]}],
        },
        "law": {"kind": "fixed", "K": [[0]]},
        "claims": [
            {
                "kind": "gain",
                "name": "x",
                "output": {"C": [[1]]},
                "level": "11/10",
                "evidence": evidence | more,
            }
        ],
    }


def test_a_gain_in_continuous_time_counts_its_remainder():
    plain = of_one()
    assert prove(read(json.dumps(plain)).claims[0]).proved
    for entry, level in ((0.25, 1.1), (0.5, 1.9), (5, 1.1)):
        # the gain is 1 / (1 - entry), infinite where that is not positive
        own = {"kappa": 0.5, "rows": [0.7], "columns": [entry / 0.69, 0, 0]}
        data = of_one(remainder=own)
        data["plant"]["remainder"] = [[entry, 0, 0]]
        data["claims"][0]["level"] = level
        assert not prove(read(json.dumps(data)).claims[0]).proved


def bent(middle, *, E=1, through=0):
    """x(t + 1) = a x + e w: a and e are 0.5 and E at both ends, and go through a parabola."""
    zero = Fraction(0)
    peak, none = ((Fraction(middle), zero, Fraction(through)),), ((zero, zero, zero),)
    plant = UncertainPlant.from_vertices(
        [[[0.5]]] * 2, [[[1.0]]] * 2, [[[E]]] * 2, sample_time=1, disturbances=["w"]
    )
    curve = tuple(peak if e == (1, 1) else none for e in plant.domain.monomials(2))
    return replace(plant, remainder=Remainder(((Fraction(1, 10**9),) * 3,), curve, 2))


@pytest.mark.parametrize("own", [Rms("x1", density=2.0), Gain("x1"), EnergyPeak("x1")])
def test_what_is_between_the_vertices_counts(own):
    """Half of the middle's Bernstein coefficient is added there, and no proof needs it whole."""

    def bound(a, e=1):
        return e / (1 - a) if own.kind == "gain" else e / math.sqrt(1 - a * a)

    def kept(plant, most, least):
        """What proves that a bound is at most so much; it must not prove less than what is."""
        found = kept_bound(plant, law, replace(own, at_most=most))
        assert prove(found.claim).proved
        assert not prove(replace(found.claim, level=Fraction(0.999 * least))).proved
        return found.claim

    law = FixedGain(np.zeros((1, 1)))
    for middle in (0.0, 0.2, 0.4):
        least, most = bound(0.5 + middle / 2), 1.001 * bound(0.5 + 0.7 * middle)
        claim = kept(bent(middle), most, least)
        # with a plant that bends more, the same evidence proves nothing
        more = replace(claim.subject, remainder=bent(middle + 0.1).remainder)
        assert not prove(replace(claim, subject=more)).proved
    assert best_bound(bent(1.02), law, own) is None
    # what drives it bends too: from one to three
    kept(bent(0.0, through=4), bound(0.5, 5), bound(0.5, 3))


def test_poles_between_the_vertices_count():
    law = FixedGain(np.zeros((1, 1)))
    assert analyse(bent(0.4), law, Disk(0, 0.5 + 0.7 * 0.4)).proved
    assert not analyse(bent(0.4), law, Disk(0, 0.699)).proved
    assert analyse(bent(0.7), law, Disk(0, 1)).proved
    out = analyse(bent(1.02), law, Disk(0, 1))
    assert (out.answer, out.alpha) == ("refuted", (Fraction(1, 2), Fraction(1, 2)))
    assert out.reason.endswith("of the samples to within their interpolation error")
    assert abs(out.pole) == pytest.approx(1.01)
    # the combination of the vertices alone leaves it, the samples do not
    assert analyse(bent(-0.2), law, Disk(0, 0.501)).proved
    claim = analyse(bent(0.4), law, Disk(0, 0.8)).certificate.claim()
    assert prove(claim).proved
    assert not prove(replace(claim, remainder=bent(0.7).remainder)).proved


def test_a_part_of_the_box_has_its_part_of_the_curve(spring):
    whole = at_sample_time(spring, 0.1, 1, 3)
    ends = (Fraction(1, 4), Fraction(2, 3)), (Fraction(1), Fraction(3, 4))
    part = replace(whole, remainder=whole.remainder.inside(*ends), sampling=None)
    low, high = (np.array(own, dtype=float) for own in ends)
    for s in np.random.default_rng(1).random((20, 2)):
        t = low + (high - low) * s
        mine, other = (np.kron(*((1 - x, x) for x in own)) for own in (s, t))
        assert np.allclose(part._beyond(mine), whole._beyond(other), rtol=1e-12, atol=1e-15)
    assert part.remainder.entries == whole.remainder.entries


def test_bounds_in_parts_of_the_box_hold_and_each_part_counts(spring):
    plant, law, own = at_sample_time(spring, 0.08, 0, 2), FixedGain(np.zeros((1, 2))), Rms("x")
    problem = own.dual(delta_form(plant), law)
    worst = best_bound(plant, law, own).level
    cells = in_parts(problem, worst * 1.001)
    assert cells is not None
    parts = divided_in_four(problem, worst * 1.001)
    evidence = Evidence([], dual=True, cells=parts)
    claim = claim_of(plant, law.exact, "box", own, evidence, Fraction(worst * 1.001))
    assert prove(claim).proved
    for k in range(4):
        spread = replace(parts[k].evidence.spread, kappa=parts[k].evidence.spread.kappa / 2)
        fault = replace(parts[k], evidence=replace(parts[k].evidence, spread=spread))
        other = replace(evidence, cells=(*parts[:k], fault, *parts[k + 1 :]))
        subject = replace(claim.subject, evidence=other)
        assert not prove(replace(claim, subject=subject)).proved
    more = replace(
        plant.remainder,
        curve=tuple(tuple(tuple(3 * x for x in row) for row in M) for M in plant.remainder.curve),
    )
    subject = replace(claim.subject, remainder=more.over(plant.sample_time))
    assert not prove(replace(claim, subject=subject)).proved


def divided_in_four(problem, level):
    """Evidence of the level on the quarters of the box."""
    found = []
    for a, b in product((0.0, 0.5), repeat=2):
        box = Box((a, b), (a + 0.5, b + 0.5))
        dual = next(own for own in _duals(problem.inside(box), level, DEGREES) if own.level < level)
        ends = (tuple(map(Fraction, own)) for own in (box.low, box.high))
        found.append(Piece(*ends, dual_evidence(dual)))
    return tuple(found)


def test_a_curve_that_does_not_fit_is_refused(tmp_path, spring):
    path = place(at_sample_time(spring, T, 0, 2), HalfPlane(1), "quadratic").save(tmp_path)
    data = json.loads(path.read_text())
    assert prove(read(path.read_text()).claims[0]).proved
    curve = data["plant"]["curve"]
    for key, value, said in (
        ("degree", 1, "degree"),
        ("degree", 3, "16 are needed here"),
        ("degree", 9, "degree"),
        ("coefficients", curve["coefficients"][:-1], "9 are needed here"),
        ("coefficients", [M[:-1] for M in curve["coefficients"]], "not 2 x 4"),
        ("more", 1, "more"),
    ):
        wrong = {**data, "plant": {**data["plant"], "curve": {**curve, key: value}}}
        with pytest.raises(FormatError, match=said):
            read(json.dumps(wrong))
    # a curve that no claim is about would let vertices stand for another plant
    alone = {**data, "claims": data["claims"][:1]}
    with pytest.raises(FormatError, match="a claim of kind samples has to say"):
        read(json.dumps(alone))
    # a law that is found on the simplex of alpha is written, and proved, as one on the box
    found = place(at_sample_time(spring, T, 0, 2), HalfPlane(1), Scheduled(1, 0, "simplex"))
    assert found.law.domain.on == "box"
    assert prove(read(found.save(tmp_path / "box").read_text()).claims[0]).proved


def test_samples_of_other_numbers_of_vertices_are_refused(spring):
    claim = claim_of_samples(at_sample_time(spring, T, 0, 1))
    fewer = replace(
        claim,
        plant=replace(claim.plant, A=claim.plant.A[:3], B=claim.plant.B[:3], E=claim.plant.E[:3]),
        A=claim.A[:3],
        B=claim.B[:3],
        E=claim.E[:3],
    )
    with pytest.raises(FormatError, match="not those of the parameters"):
        prove(fewer)
    assert claim.statement(claim.plant).endswith("on the box of 2 parameters")


def test_numbers_of_a_remainder_out_of_proportion_are_refused():
    data = of_one(remainder={"kappa": 1, "rows": [1], "columns": [1, 1, 1]})
    data["plant"]["vertices"][0] = {
        "A": np.eye(24).tolist(),
        "B": np.ones((24, 1)).tolist(),
        "E": np.ones((24, 1)).tolist(),
    }
    rows = [[f"1/{10**290 + 26 * i + j}" for j in range(26)] for i in range(24)]
    data["plant"]["states"], data["plant"]["remainder"] = [], rows
    with pytest.raises(FormatError, match="common denominator is too large"):
        read(json.dumps(data))


def test_a_decay_rate_is_kept_beside_limits(spring):
    plant = at_sample_time(spring, T, 1)
    done = optimise(plant, Rms("x"), [Rms("f", 3.0)], HalfPlane(2.0), "quadratic")
    for alpha in inside(100):
        A, B, _ = samples(spring, alpha, T, 1)
        z = np.linalg.eigvals(A + B @ done.law.gain(alpha))
        assert np.abs(z).max() < np.exp(-2 * T)
    assert str(done.design.region).startswith("disk(0, 0.96")
