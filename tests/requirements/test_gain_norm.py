"""Limits on the norm of the gain: blocks at alpha, brackets, closed forms, one fault at a time."""

import json
import math
from dataclasses import replace
from fractions import Fraction
from itertools import islice

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize

from polefence import (
    FixedGain,
    InputError,
    NotProvedError,
    Parameter,
    Scheduled,
    ScheduledGain,
    UncertainPlant,
    at_sample_time,
    load,
)
from polefence.base.errors import SpecError
from polefence.certify.bounds import best_bound, bounds_file, kept_bound, sampled
from polefence.certify.design import check
from polefence.cli.main import main
from polefence.examples import spec_path
from polefence.lmi.conditions.gain_norm import Norm, add_norm, tangents
from polefence.lmi.conditions.pencil import Builder
from polefence.plant.exact import file_plant
from polefence.plant.points import seeded
from polefence.plant.polynomial import Domain
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.work import FormatError
from polefence.region.text import digits_up
from polefence.requirements.gain_norm import GainNorm, levels
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.rms import Rms
from polefence.requirements.text import load_specifications, parse_specification
from polefence.requirements.weights import with_weights
from polefence.search.optimise import optimise
from support.commands import ran
from support.files import bounds_in
from support.once import searched_once  # noqa: F401
from support.paths import DOCS
from support.specs import ONE_STATE, TWO_STATES, rms

ROWS, COLUMNS = (4.0, 0.5), (0.25, 3.0, 1.0)


@pytest.fixture(scope="module")
def one():
    return loads(ONE_STATE)


@pytest.fixture(scope="module")
def two():
    return loads(TWO_STATES)


@pytest.fixture(scope="module")
def designed(two):
    return optimise(
        two, rms("x"), [rms("force", 3.0), GainNorm(2.5, (2.0,), (0.5, 1.0))], method="scheduled"
    )


def points(domain, count=3, seed=0):
    random = np.random.default_rng(seed)
    for _ in range(count):
        coordinates = np.concatenate([random.dirichlet(np.ones(size)) for size in domain.sizes])
        yield coordinates, domain.alpha(coordinates)


# --- the condition --------------------------------------------------------------------------------


@pytest.mark.parametrize("on", ["simplex", "box"])
@pytest.mark.parametrize(("degree", "elevation"), [(0, 0), (0, 2), (1, 0), (1, 1), (2, 0)])
@pytest.mark.parametrize("constant", [False, True])
@pytest.mark.parametrize("fixed", [False, True])
def test_blocks_are_the_inequality_at_alpha(on, degree, elevation, constant, fixed):
    random = np.random.default_rng(2)
    domain, n, m, r = Domain.of(on, 4), 3, 2, 0.7
    count = domain.count(degree)
    norm = Norm("norm", random.normal(size=(n, n)), random.normal(size=(m, m)), 1.7, fixed)
    near = random.normal(size=(1 if constant else count, n, n))
    pencil = Builder("test")
    W = [pencil.symmetric(f"W{k + 1}", n) for k in range(count)]
    Z = [pencil.full(f"Z{k + 1}", (m, n), "u") for k in range(count)]
    add_norm(pencil, W, Z, norm, near, domain, degree, elevation)
    pencil = pencil.build()
    x = random.normal(size=pencil.unknowns)
    values, found = pencil.unpack(x), pencil.matrices(x, r)
    s = values["s norm"].item()
    assert found.pop("s norm") == pytest.approx(r * s)
    order = domain.monomials(2 * degree + elevation)
    assert len(found) == len(order)
    G = np.linalg.inv(near.mean(axis=0))
    change = np.block([[G, np.zeros((n, m))], [np.zeros((m, n)), np.eye(m) / norm.level]])
    for coordinates, alpha in points(domain):

        def at(matrices, own=degree, alpha=alpha):
            return np.tensordot(domain.basis(alpha, own), np.array(matrices), 1)

        own_W, own_Z = (at([values[f"{name}{k + 1}"] for k in range(count)]) for name in "WZ")
        H, V = norm.C @ own_W, norm.R @ own_Z
        H0 = at(near, 0 if constant else degree)
        size = (1.0 if fixed else r) * s * norm.level**2
        square = H0.T @ H + H.T @ H0 - s * H0.T @ H0
        expected = change.T @ np.block([[square, V.T], [V, size * np.eye(m)]]) @ change
        weights = [np.prod(coordinates ** np.array(e)) for e in order]
        total = sum(w * M for w, M in zip(weights, found.values(), strict=True))
        assert np.allclose(total, expected, atol=1e-10 * np.abs(expected).max())
        # which suffices: what is asked for is no more than the square itself
        assert np.linalg.eigvalsh(H.T @ H - s * square).min() > -1e-9 * np.abs(H).max() ** 2


def test_tangents_touch_the_square_or_give_back_w():
    random = np.random.default_rng(3)
    W = np.array([np.eye(3) + 0.1 * (M + M.T) for M in random.normal(size=(4, 3, 3))])
    norm = Norm("norm", random.normal(size=(3, 3)), np.eye(1), 1.0)
    H, mean, plain = tangents(norm, W)
    assert np.allclose(H, norm.C @ W)
    assert np.allclose(mean, norm.C @ W.mean(axis=0))
    assert np.allclose(np.swapaxes(plain, 1, 2) @ norm.C @ W, W)


# --- proofs of a given law ------------------------------------------------------------------------


def a_plant(N=4):
    random = np.random.default_rng(5)
    A, B = random.normal(size=(N, 3, 3)), random.normal(size=(N, 3, 2))
    return UncertainPlant.from_vertices(A, B)


def a_law(kind, spread=0.008):
    random = np.random.default_rng(6)
    if kind == "one":
        return FixedGain(random.normal(size=(2, 3)))
    degree, sizes = int(kind[-1]), (2, 2) if "box" in kind else (4,)
    count = Domain(sizes).count(degree)
    half = np.array([[2.0, 0, 0], [0.3, 0.7, 0], [-0.2, 0.1, 0.4]])
    W = np.array([half @ (np.eye(3) + spread * (M + M.T)) @ half.T for M in
                  random.normal(size=(count, 3, 3))])  # fmt: skip
    W = (W + W.swapaxes(1, 2)) / 2
    Z = random.normal(size=(1, 2, 3)) + 0.3 * random.normal(size=(count, 2, 3))
    return ScheduledGain(W, Z @ W, (), degree, sizes)


LAWS = ["one", "simplex 1", "simplex 2", "box 1", "box 2"]


@pytest.mark.parametrize("kind", LAWS)
def test_the_inequality_is_that_of_the_theorem(kind):
    plant, law, own = a_plant(), a_law(kind), GainNorm(3.0, ROWS, COLUMNS)
    bound = kept_bound(plant, law, replace(own, at_most=100.0))
    claim = replace(bound.claim, level=Fraction(7, 3))
    degree = 2 * getattr(law, "degree", 0)
    domain = Domain(getattr(law, "sizes", (4,)))
    found = [np.array(M, dtype=object) for _, M in claim.blocks()]
    order = domain.monomials(degree)
    assert len(found) == len(order)
    for coordinates, alpha in points(domain):
        W, Z = np.eye(3), getattr(law, "K", None)
        if kind != "one":
            W, Z = (np.tensordot(domain.basis(alpha, law.degree), M, 1) for M in (law.W, law.Z))
        H, V = np.diag(1 / np.array(COLUMNS)) @ W, np.diag(1 / np.array(ROWS)) @ Z
        expected = np.block([[H.T @ H, V.T], [V, 49 / 9 * np.eye(2)]])
        weights = [np.prod(coordinates ** np.array(e)) for e in order]
        value = sum(w * (M / 2**400).astype(float) for w, M in zip(weights, found, strict=True))
        mine, other = (M / np.linalg.norm(M) for M in (value, expected))
        assert np.allclose(mine, other, atol=1e-12)


@pytest.mark.parametrize("kind", LAWS)
def test_levels_are_bracketed_on_both_sides(kind):
    plant, law, own = a_plant(), a_law(kind), GainNorm(None, ROWS, COLUMNS)
    alpha = [a for _, a in points(Domain(getattr(law, "sizes", (4,))), 400)]
    alpha = np.vstack([np.eye(4), alpha])
    K = law.gain(alpha) * np.array(COLUMNS) / np.array(ROWS)[:, None]
    worst = max(np.linalg.svd(k)[1][0] for k in K)
    assert sampled(plant, law, own, alpha).worst == pytest.approx(worst)
    best = best_bound(plant, law, own)
    assert worst < best.level * (1 + 1e-12)
    assert best.level < worst * 1.05
    assert str(best).startswith("gain norm of the law <= ")
    for level, elevation in islice(levels(plant, law, own), 4):
        subject = best.claim.subject
        evidence = replace(subject.evidence, elevation=elevation)
        claim = replace(best.claim, subject=replace(subject, evidence=evidence))
        above, below = (replace(claim, level=Fraction(level * (1 + s))) for s in (1e-9, -1e-9))
        assert prove(above).proved
        assert not prove(below).proved
    assert kept_bound(plant, law, replace(own, at_most=worst * 0.999)) is None
    kept = kept_bound(plant, law, replace(own, at_most=best.level))
    assert kept.level == best.level


@pytest.mark.parametrize("kind", ["one", "simplex 1", "box 2"])
def test_one_fault_at_a_time(kind):
    claim = best_bound(a_plant(), a_law(kind), GainNorm(None, ROWS, COLUMNS)).claim
    assert prove(claim).proved
    law = claim.subject.law
    faults = [replace(claim, level=claim.level * Fraction(9, 10))]
    for key, factor in (("rows", Fraction(4, 5)), ("columns", Fraction(3, 2))):
        units = tuple(unit * factor for unit in getattr(claim, key))
        faults.append(replace(claim, **{key: units}))
    for letter, size in {"K": 5, "Z": 40, "W": Fraction(1, 3)}.items():
        matrices = getattr(law, letter)
        if matrices is not None:
            M = [[[value * size for value in row] for row in matrices[0]], *matrices[1:]]
            fault = replace(claim.subject, law=replace(law, **{letter: M}))
            faults.append(replace(claim, subject=fault))
    for fault in faults:
        verdict = prove(fault)
        assert not verdict.proved
        assert "of the gain's norm" in verdict.reason
    for units in ((Fraction(1),), (Fraction(1), Fraction(0)), (Fraction(1), Fraction(-1))):
        with pytest.raises(FormatError, match="rows must hold 2 positive numbers"):
            prove(replace(claim, rows=units))
    with pytest.raises(FormatError, match="columns must hold 3 positive numbers"):
        prove(replace(claim, columns=claim.columns[:2]))
    with pytest.raises(FormatError, match="level"):
        prove(replace(claim, level=Fraction(-1)))
    for change, message in (
        ({"elevation": 17}, "degrees must be"),
        ({"X": [[[Fraction(1)]]]}, "nothing but an elevation"),
        ({"multiple": (Fraction(1),)}, "one number for each W"),
    ):
        evidence = replace(claim.subject.evidence, **change)
        with pytest.raises(FormatError, match=message):
            prove(replace(claim, subject=replace(claim.subject, evidence=evidence)))
    if law.W is not None:
        short = replace(law, W=law.W[:-1])
        with pytest.raises(FormatError, match="missing"):
            prove(replace(claim, subject=replace(claim.subject, law=short)))
        uneven = [[list(row) for row in M] for M in law.W]
        uneven[0][0][1] += Fraction(1, 10**6)
        wrong = replace(claim.subject, law=replace(law, W=uneven))
        assert "not symmetric" in prove(replace(claim, subject=wrong)).reason


# --- of a W that varies much: numbers s below W ---------------------------------------------------


def varying(sizes=(2, 2)):
    """W from 100 to 0.01, turned from vertex to vertex: H'H has coefficients that are not > 0."""
    random = np.random.default_rng(7)
    turns = [np.linalg.qr(M)[0] for M in random.normal(size=(4, 3, 3))]
    sizes_of_W = [(100.0, 10.0, 1.0), (50.0, 2.0, 0.3), (1.0, 0.1, 0.01), (90.0, 5.0, 0.2)]
    W = np.array([q @ np.diag(d) @ q.T for q, d in zip(turns, sizes_of_W, strict=True)])
    W = (W + W.swapaxes(1, 2)) / 2
    return ScheduledGain(W, random.normal(size=(4, 2, 3)) @ W, (), 1, sizes)


@pytest.mark.parametrize("sizes", [(4,), (2, 2)])
def test_a_law_whose_w_varies_much_keeps_a_wide_limit(sizes):
    plant, law, own = a_plant(), varying(sizes), GainNorm(None, ROWS, COLUMNS)
    alpha = np.vstack([np.eye(4), *(a for _, a in points(Domain(sizes), 400))])
    K = law.gain(alpha) * np.array(COLUMNS) / np.array(ROWS)[:, None]
    worst = np.linalg.norm(K, 2, axis=(1, 2)).max()
    assert not any(np.isfinite(level) for level, _ in levels(plant, law, own))
    best = best_bound(plant, law, own)
    spread = max(
        np.linalg.cond(W / np.outer(COLUMNS, COLUMNS)) for W in (np.array(w) for w in law.W)
    )
    assert worst < best.level < 2 * math.sqrt(spread) * worst
    assert kept_bound(plant, law, replace(own, at_most=1e9)).level == 1e9
    claim = best.claim
    assert prove(claim).proved
    assert not prove(replace(claim, level=claim.level * Fraction(99, 100))).proved
    for k, times, where in ((0, 1.01, "less a multiple"), (1, 0, "gain's norm")):
        s = [*claim.subject.evidence.multiple]
        s[k] *= Fraction(times)
        for other, _ in enumerate(s):
            s[other] *= Fraction(times)
        evidence = replace(claim.subject.evidence, multiple=tuple(s))
        verdict = prove(replace(claim, subject=replace(claim.subject, evidence=evidence)))
        assert not verdict.proved
        assert where in verdict.reason


def test_both_inequalities_are_those_of_the_page():
    plant, law, own = a_plant(), varying(), GainNorm(1e6, ROWS, COLUMNS)
    claim = kept_bound(plant, law, own).claim
    s = np.array(claim.subject.evidence.multiple, dtype=float)
    first, second = claim.inequalities()
    domain, R, C2 = Domain((2, 2)), np.array(ROWS), np.diag(np.square(COLUMNS))
    order = domain.monomials(1)
    for inequality, expected in (
        (first, lambda W, _, t: W - t * C2),
        (second, lambda W, V, t: np.block([[W, V.T], [V, 1e12 * t * np.eye(2)]])),
    ):
        found = [np.array(M, dtype=object) for _, M in inequality.blocks()]
        for coordinates, alpha in points(domain):
            W, Z, t = (np.tensordot(domain.basis(alpha, 1), M, 1) for M in (law.W, law.Z, s))
            weights = [np.prod(coordinates ** np.array(e)) for e in order]
            value = sum(w * (M / 2**400).astype(float) for w, M in zip(weights, found, strict=True))
            other = expected(W, Z / R[:, None], t)
            assert np.allclose(value / np.linalg.norm(value), other / np.linalg.norm(other), 1e-9)


def test_a_limit_that_does_not_bind_costs_nothing(monkeypatch):
    """Of a lightly damped plant, whose scheduled law, of the LMI, has a W that varies much."""
    plant = UncertainPlant.from_expressions(
        [Parameter("p", -1, 1), Parameter("q", -1, 1)],
        [
            ["-0.62 - 0.14*p - 0.36*q", "0.0925 + 0.23*p + 0.075*q"],
            ["-0.0625 - 0.155*p - 0.17*q", "-0.61 + 0.205*p - 0.345*q"],
        ],
        [[-1.1], [1.3]],
        [[-0.8], [-1.52]],
        states=("x1", "x2"),
        inputs=("u1",),
    )
    limits = [Rms("u1", 1.85, density=2.0), Rms("x2", 4.875, density=2.0)]
    free, wide = (
        optimise(plant, Rms("x1", density=2.0), each, method="scheduled")
        for each in (limits, [*limits, GainNorm(1e9)])
    )
    # two searches, each of which ends where a step is worth less than 1e-5
    assert wide.bounds[0].level == pytest.approx(free.bounds[0].level, rel=3e-5)
    claims = [own.claim for own in wide.bounds]
    text = bounds_file(wide.design.certificate, claims).dumps()
    assert bounds_in(text) == claims
    # of the LMI's law it is proved by the numbers s alone
    monkeypatch.setattr("polefence.search.optimise._best_tuned", lambda *_: None)
    asked = plant, Rms("x1", density=2.0), [*limits, GainNorm(1e9)]
    rational = optimise(*asked, method="scheduled")
    assert rational.bounds[-1].claim.subject.evidence.multiple


# --- designs --------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
@pytest.mark.parametrize("limit", [2.5, 40.0])
def test_one_state_has_its_closed_form(one, method, limit):
    """u = -k x, k <= limit: x^2 = 1 / (2 (k - a)), a = 2 at the worst."""
    least = 1 / math.sqrt(2 * (limit - 2))
    done = optimise(one, rms("x"), [GainNorm(limit)], method=method)
    assert least * (1 - 1e-12) < done.bounds[0].level < least * (1 + 1e-3)
    # in other units the same
    other = optimise(one, rms("x"), [GainNorm(limit / 20, (100.0,), (5.0,))], method=method)
    assert other.bounds[0].level == pytest.approx(done.bounds[0].level, rel=1e-4)


@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
def test_the_least_gain_that_is_stable_is_bracketed(one, method, lmi_alone):
    found = optimise(one, None, [GainNorm(2.002)], method=method)
    assert found.bounds[0].level == 2.002
    with pytest.raises(NotProvedError, match=r"gain norm of the law <= 1.998"):
        optimise(one, None, [GainNorm(1.998)], method=method)
    # as small as can be for an rms: k >= 2 + 1 / (2 * 0.5^2)
    least = optimise(one, GainNorm(), [rms("x", 0.5)], method=method).bounds[0].level
    assert 4 * (1 - 1e-9) < least < 4 * (1 + 1e-3)


def test_one_vertex_has_the_best_gain_in_the_circle():
    A, B, E = np.array([[0, 1.0], [1.5, -0.2]]), np.array([[0], [1.0]]), np.array([[0.3], [1.0]])
    plant = UncertainPlant.from_vertices([A], [B], [E], states=("x", "v"), inputs=("u",))

    def worst(k):
        closed = A + B @ np.array([k])
        if np.linalg.eigvals(closed).real.max() >= 0:
            return 1e3
        return math.sqrt(solve_continuous_lyapunov(closed, -E @ E.T)[0, 0])

    limit, columns = 6.0, np.array([0.5, 2.0])
    inside = {"type": "ineq", "fun": lambda k: limit**2 - np.sum((k * columns) ** 2)}
    best = min(
        minimize(worst, start, constraints=[inside], method="SLSQP").fun
        for start in ([-9.0, -0.5], [-4.0, -2.0])
    )
    done = optimise(plant, rms("x"), [GainNorm(limit, None, tuple(columns))], method="quadratic")
    assert best * (1 - 1e-6) < done.bounds[0].level < best * (1 + 2e-3)
    assert np.linalg.norm(done.law.K * columns) <= limit


@pytest.mark.parametrize("method", ["quadratic", Scheduled(1, 0, "box"), Scheduled(2, 0, "box")])
def test_a_lower_limit_is_kept_and_costs(two, method):
    free = optimise(two, rms("x"), [rms("force", 3.0)], method=method)
    before = best_bound(two, free.law, GainNorm()).level
    alpha, last = seeded(two, 300), free.bounds[0].level
    for share in (0.7, 0.4) if method == "quadratic" else (0.7,):
        done = optimise(two, rms("x"), [rms("force", 3.0), GainNorm(share * before)], method=method)
        assert done.bounds[0].level > last
        last = done.bounds[0].level
        worst = np.linalg.norm(done.law.gain(alpha), 2, axis=(1, 2)).max()
        # kept, and made use of
        assert 0.9 * share * before < worst < done.bounds[2].level == share * before


def test_the_study_is_as_the_page_says():
    plant = load(spec_path("quarter-car-ride"))
    least, limits = load_specifications(spec_path("quarter-car-ride"))
    page = " ".join((DOCS / "ride.md").read_text().split())
    units = (1000.0,), (0.03, 0.01, 0.5, 1.0)
    free = optimise(plant, least, limits, method="quadratic")
    norm = np.linalg.norm(free.law.K * units[1] / units[0], 2)
    assert f"The one gain has a norm of {norm:.1f}" in page.replace("the one", "The one")
    asked = (("quadratic", 0.297, 1.2391, 0.003), (None, 0.397, 1.0284, 0.01))
    for method, limit, cost, inside in asked:
        assert f"limit of {limit} gives {cost}" in page
        done = optimise(plant, least, (*limits, GainNorm(limit, *units)), method=method)
        assert done.bounds[0].level == pytest.approx(cost, rel=5e-4)
        worst = sampled(plant, done.law, done.bounds[-1].specification).worst
        assert f"its limit to {inside} %" in page or f"a scheduled law to {inside} %" in page
        assert 1 - worst / limit == pytest.approx(inside / 100, abs=1e-4)
        # no law of a smaller gain by a fifth is as good to a thousandth
        assert done.closer is None


# --- the file, the text, the command --------------------------------------------------------------


def test_a_file_holds_what_was_proved(designed, tmp_path):
    claims = [bound.claim for bound in designed.bounds]
    text = bounds_file(designed.design.certificate, claims).dumps()
    assert bounds_in(text) == claims
    designed.save(tmp_path)
    answer = check(tmp_path)
    assert answer.proved
    units = "states in units of 0.5, 1 and inputs in units of 2"
    said = f"gain norm of the law <= 2.5, {units}"
    assert answer.claims[3] == claims[2].statement(file_plant(designed.design.plant)) == said
    document = json.loads(text)
    own = document["claims"][3]
    assert set(own) == {"kind", "name", "level", "rows", "columns", "evidence"}
    faults = {
        "rows": ([1, 2], "must hold 1 numbers"),
        "columns": ([1, "x"], "not a finite number"),
        "output": ({}, "unknown key .*output"),
        "evidence": ({"X": []}, "unknown key .*X"),
        "level": (-1, "zero or more"),
    }
    for key, (value, message) in faults.items():
        document["claims"][3] = own | {key: value}
        with pytest.raises(FormatError, match=message):
            [prove(claim) for claim in bounds_in(json.dumps(document))]
    for key, value in {"level": 2.2, "rows": [1.5], "columns": [1, 1]}.items():
        document["claims"][3] = own | {key: value}
        (tmp_path / "design.json").write_text(json.dumps(document))
        answer = check(tmp_path / "design.json")
        assert answer.answer == "undecided"
        assert "gain norm of the law" in answer.claims[0]


def test_one_gain_is_written_with_its_domain(one, tmp_path):
    done = optimise(one, rms("x"), [GainNorm(5.0)], method="quadratic")
    claims = [bound.claim for bound in done.bounds]
    text = bounds_file(done.design.certificate, claims).dumps()
    assert bounds_in(text) == claims
    done.save(tmp_path)
    poles, rms_of_x, norm = check(tmp_path).claims
    assert poles.startswith("poles in half_plane(0), of A + B K with one gain K, on the ")
    assert rms_of_x.startswith("rms of 'x' = x1 <= 0.40")
    assert norm == "gain norm of the law <= 5"


STEPWISE = ONE_STATE.replace('[["a"]]', '[["1 + a/20"]]').replace("[[1]]", "[[0.05]]")
PLANTS = {
    "in discrete time": lambda: loads("sample_time = 0.05" + STEPWISE),
    "at a sample time": lambda: at_sample_time(loads(ONE_STATE), 0.05),
    "a sample late": lambda: at_sample_time(loads(ONE_STATE), 0.05, delay=1),
    "moving": lambda: loads(ONE_STATE.replace("[0.5, 2]", "[0.5, 2]\nrate = [-0.1, 0.1]")),
}


@pytest.mark.parametrize("name", PLANTS)
def test_its_file_is_proved_whatever_the_plant(name, tmp_path):
    plant = PLANTS[name]()
    done = optimise(plant, GainNorm(), [rms("x", 0.5)], method="quadratic")
    size = np.linalg.norm(done.law.K, 2)
    assert size <= done.bounds[0].level <= size * (1 + 1e-3)
    answer = check(done.save(tmp_path))
    assert answer.proved
    said = f"gain norm of the law <= {digits_up(done.bounds[0].level)}"
    assert any(claim.startswith(said) for claim in answer.claims)


def test_tables_and_lines(tmp_path):
    spec = tmp_path / "s.toml"
    spec.write_text(TWO_STATES + '[[specification]]\nkind = "gain norm"\nat_most = 2\n')
    assert load_specifications(spec) == (None, (GainNorm(2.0),))
    more = 'signal = "the law"\nrows = [2]\ncolumns = [0.5, 1]\n'
    spec.write_text(spec.read_text() + more)
    assert load_specifications(spec)[1] == (GainNorm(2.0, (2.0,), (0.5, 1.0)),)
    assert parse_specification("gain norm of the law <= 3") == GainNorm(3.0)
    with pytest.raises(SpecError, match="a gain norm is of the law; leave it out"):
        parse_specification("gain norm of x <= 3")
    with pytest.raises(InputError, match="rows is for a spec's tables"):
        parse_specification("gain norm of the law <= 3 with rows 2")
    for text, message in {
        "rows = 2": "rows = 2 must be a list of numbers",
        "columns = [0, 1]": "must be positive numbers",
        "points = [[1, 2]]": "unknown key points",
    }.items():
        spec.write_text(
            TWO_STATES + f'[[specification]]\nkind = "gain norm"\nat_most = 2\n{text}\n'
        )
        with pytest.raises(SpecError, match=message):
            load_specifications(spec)


def test_the_command_keeps_it(tmp_path, capsys):
    spec = tmp_path / "s.toml"
    table = '[[specification]]\nkind = "gain norm"\nat_most = 6\ncolumns = [1, 2]\n'
    least = '[[specification]]\nkind = "rms"\nsignal = "x"\ndensity = 2\nminimise = true\n'
    spec.write_text(TWO_STATES + table + least)
    folder = tmp_path / "new"
    one = ["optimise", str(spec), "--method", "quadratic", "-o", str(folder)]
    out = ran(capsys, *one, "--json", tmp_path / "j")
    assert "gain norm of the law" in out
    bound = json.loads((tmp_path / "j").read_text())["bounds"][1]
    assert (bound["kind"], bound["limit"], bound["proved"]) == ("gain norm", 6, 6)
    assert 5.9 < bound["worst sampled"] < 6
    assert main(["check", str(folder), "--spec", str(spec)]) == 0
    assert "gain norm of the law <= 6, states in units of 1, 2" in capsys.readouterr().out
    # a line is in the units of the table
    line = "gain norm of the law <= 5"
    assert main([*one, "--limit", line]) == 0
    assert "gain norm of the law <= 5, states in units of 1, 2" in ran(capsys, "check", folder)
    sweep = ["--over", "gain norm of the law", "--value", "6", "--method", "quadratic"]
    assert main(["tradeoff", str(spec), *sweep, "--json", str(tmp_path / "t")]) == 0
    (row,) = json.loads((tmp_path / "t").read_text())["rows"]
    swept = [own for own in row["bounds"] if own["specification"].startswith("gain norm")]
    assert 5.9 < swept[0]["sampled"] < swept[0]["proved"] <= 6
    capsys.readouterr()
    spec.write_text(TWO_STATES + table.replace("[1, 2]", "[1]") + least)
    assert main(["optimise", str(spec)]) == 2
    assert "columns of the gain norm holds 1 numbers; two states needs 2" in capsys.readouterr().err


def test_what_does_not_fit_is_refused(two):
    for value in ((), (0.0,), (-1.0, 1.0), (math.inf,), 3.0, "ab", (True,)):
        with pytest.raises(InputError, match="of the gain norm must be positive numbers"):
            GainNorm(1.0, value)
    with pytest.raises(InputError, match="must be a positive number"):
        GainNorm(0)
    with pytest.raises(InputError, match="rows of the gain norm holds 2 numbers"):
        optimise(two, rms("x"), [GainNorm(1.0, (1.0, 2.0))], method="scheduled")
    # a law that is no longer the plant's own: filters' states are in units of one
    plant, (_, norm) = with_weights(two, (Rms("v", None, 2.0, "Wk"), GainNorm(1.0, None, (2, 3))))
    assert norm.columns == (2, 3, *(1.0,) * (plant.shape[0] - 2))


def test_plants_without_disturbance_are_taken(two):
    bare = loads(
        TWO_STATES.replace("E = [[0], [1]]", "").replace('disturbances = ["w [m/s2]"]', "")
    )
    start = InitialPeak("x", 1.2, ((1.0, 0.0),))
    done = optimise(bare, GainNorm(), [start], method="quadratic")
    assert sampled(bare, done.law, GainNorm(), seeded(bare, 50)).worst <= done.bounds[0].level
