"""Margins: the verifier's matrices against numpy's, and one fault after another."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, product

import numpy as np
import pytest

from polefence import Certificate, Parameter, Scheduled, UncertainPlant, place
from polefence.certify.margins import in_service
from polefence.law.laws import FixedGain, ScheduledGain
from polefence.plant.polynomial import Domain
from polefence.proof.claims.base import prove
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.margins import Subject, cells
from polefence.proof.claims.rate import Rate
from polefence.proof.document import loads
from polefence.proof.ranges import Range
from polefence.proof.work import FormatError
from polefence.region.regions import Disk, Ellipse, HalfPlane, Sector, VerticalStrip
from support.changes import changed
from support.files import is_proved

REGIONS = {
    "disk": Disk(-3, 2),
    "all": HalfPlane(1) & Sector(0.5) & VerticalStrip(-9, -1) & Ellipse(-4, 3, 2),
}
# (degree, on): -p2 is negative, p1 goes through 1/p1
LAWS = [(1, "simplex"), (2, "simplex"), (2, "box"), (0, "fixed")]


def plant_of(inverted: bool = True) -> UncertainPlant:
    parameters = [
        Parameter("p1", 1, 3, "kg", "1/p1" if inverted else "p1"),
        Parameter("p2", -2, "-1/2", "", "1/p2"),
    ]
    entry = "2/p1" if inverted else "2*p1"
    return UncertainPlant.from_expressions(
        parameters,
        [["1", entry], ["1/p2", f"-1 + {entry}/p2"]],
        [["0", "1"], [entry, "1/p2"]],
    )


def bare() -> UncertainPlant:
    """The same corners, without parameters."""
    plant = plant_of()
    pairs = [(v.exact_A, v.exact_B) for v in plant.vertices[:3]]
    return UncertainPlant.from_vertices([A for A, _ in pairs], [B for _, B in pairs])


def random_claim(plant: UncertainPlant, degree: int, on: str, region, seed: int = 3):
    """A claim with a law of no meaning: the algebra is what is looked at."""
    random = np.random.default_rng(seed)
    if on == "fixed":
        law = FixedGain(random.normal(size=(2, 2)))
        return Certificate(plant, region, "quadratic", law, {"W": spd(random)}), law
    domain = Domain.of(on, len(plant.vertices))
    count = domain.count(degree)
    W = np.array([spd(random) for _ in range(count)])
    Z = random.normal(size=(count, 2, 2))
    law = ScheduledGain(W, Z, plant.parameters, degree, domain.sizes)
    return Certificate(plant, region, "scheduled", law, {"tau": np.array(0.0)}), law


def spd(random) -> np.ndarray:
    half = random.normal(size=(2, 2))
    W = half @ half.T + np.eye(2)
    return (W + W.T) / 2


def law_at(certificate, law, alpha):
    if isinstance(law, FixedGain):
        W = certificate.evidence["W"]
        return W, law.K @ W
    basis = law.domain.basis(alpha, law.degree)
    return np.tensordot(basis, law.W, 1), np.tensordot(basis, law.Z, 1)


def subject_of(certificate, pieces, elevation=0) -> Subject:
    ranges = tuple(Range(p.low, p.high, p.inverted) for p in certificate.plant.parameters)
    return Subject(certificate.claim(), ranges, pieces, elevation)


def evaluated(claim, coordinates):
    """For each piece the value of every polynomial at these coordinates."""
    found = list(claim.inequalities())
    for cell in claim.cells() if isinstance(claim, Estimate) else cells(claim.subject):
        values = []
        while found and found[0].piece == cell.name:
            blocks = list(found.pop(0).blocks())
            weights = np.array(
                [np.prod(np.power(coordinates, place.powers)) for place, _ in blocks]
            )
            matrices = np.array([m for _, m in blocks], dtype=float)
            values.append(np.tensordot(weights, matrices, 1))
        yield values
    assert not found


def same_direction(mine, other):
    mine, other = mine / np.linalg.norm(mine), other / np.linalg.norm(other)
    assert np.allclose(mine, other, atol=1e-12)


def region_blocks(region, X, N):
    """-(L (x) X + M (x) N + M' (x) N'), and W first where a part is no disk."""
    values = [] if region.kind == "disk" else [X]
    for L, M in region.pairs():
        values.append(-(np.kron(L, X) + np.kron(M, N) + np.kron(M.T, N.T)))
    return values


TAU = np.array([0.3, 0.6])
ENDS_OF_TAU = np.stack([1 - TAU, TAU], axis=1).ravel()


def estimate_pairs(plant, errors, pieces):
    """At TAU of each piece the values of each parameter and of its estimate."""
    pairs = []
    for p, error, count, tau in zip(plant.parameters, errors, pieces, TAU, strict=True):
        low, high, own = float(p.low), float(p.high), []
        for sign in (-1, 1):
            bend = low + error if sign < 0 else high - error
            cuts = {*np.linspace(low, high, count + 1), *([bend] if low < bend < high else [])}
            for u, v in pairwise(sorted(cuts)):
                estimate = u + tau * (v - u)
                own.append((np.clip(estimate + sign * error, low, high), estimate))
        pairs.append(own)
    return list(product(*pairs))


@pytest.mark.parametrize(("degree", "on"), LAWS)
@pytest.mark.parametrize("region", REGIONS)
def test_estimates_are_the_matrices_at_p_and_its_estimate(degree, on, region):
    plant, region = plant_of(), REGIONS[region]
    certificate, law = random_claim(plant, degree, on, region)
    errors, pieces = (Fraction(1, 3), Fraction(2)), (2, 1)  # the second is more than its range
    claim = Estimate(subject_of(certificate, pieces, 1), errors)
    places = estimate_pairs(plant, (1 / 3, 2.0), pieces)
    assert len(places) == 12
    for (first, second), mine in zip(places, evaluated(claim, ENDS_OF_TAU), strict=True):
        A, B = plant.at(plant.alpha(p1=first[0], p2=second[0]))
        W, Z = law_at(certificate, law, plant.alpha(p1=first[1], p2=second[1]))
        expected = region_blocks(region, W, A @ W + B @ Z)
        for one, other in zip(mine, expected, strict=True):
            same_direction(one, other)


@pytest.mark.parametrize("degree", [1, 2])
def test_mislaid_weight(degree):
    plant, region = bare(), REGIONS["all"]
    certificate, law = random_claim(plant, degree, "simplex", region)
    claim = Estimate(subject_of(certificate, (), 1), (Fraction(1, 5),))
    a, v = np.array([0.2, 0.5, 0.3]), np.array([0.1, 0.3, 0.6])
    for u, mine in enumerate(evaluated(claim, np.concatenate([a, v]))):
        A, B = plant.at(0.8 * a + 0.2 * np.eye(3)[u])
        W, Z = law_at(certificate, law, 0.8 * a + 0.2 * v)
        for one, other in zip(mine, region_blocks(region, W, A @ W + B @ Z), strict=True):
            same_direction(one, other)
    assert u == 2


FACTORS = {"disk": (np.array([[1.0], [0]]), np.array([[0.0, 1]]))}


@pytest.mark.parametrize(("degree", "on"), LAWS)
@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("boxed", [True, False])
def test_gains_have_petersens_schur_complement(degree, on, region, boxed):
    if not boxed and on == "box":
        return
    plant, region = plant_of() if boxed else bare(), REGIONS[region]
    certificate, law = random_claim(plant, degree, on, region)
    rows, columns = (1.0, 0.5), (3.0, 0.25)
    mu = tuple(0.5 + k for k in range(len(region.pairs())))
    fractions = (tuple(map(Fraction, values)) for values in (rows, columns, mu))
    claim = GainError(
        subject_of(certificate, (2, 1) if boxed else (), 1), Fraction(1, 8), *fractions
    )
    if boxed:
        tau = np.array([0.3, 0.6])
        coordinates = np.stack([1 - tau, tau], axis=1).ravel()
        shares = [(tau[0] / 2, tau[1]), ((1 + tau[0]) / 2, tau[1])]
        alphas = [np.kron([1 - s, s], [1 - t, t]) for s, t in shares]
    else:
        coordinates = np.array([0.2, 0.5, 0.3])
        alphas = [coordinates]
    for alpha, mine in zip(alphas, evaluated(claim, coordinates), strict=True):
        A, B = plant.at(alpha)
        W, Z = law_at(certificate, law, alpha)
        N = A @ W + B @ Z
        expected = region_blocks(region, W, N)
        skip = len(expected) - len(region.pairs())
        for one, other in zip(mine[:skip], expected[:skip], strict=True):
            same_direction(one, other)
        for k, (_, M) in enumerate(region.pairs()):
            M1, M2 = FACTORS["disk"] if np.linalg.matrix_rank(M) < len(M) else (M, np.eye(len(M)))
            E = np.kron(M1, B @ np.diag(rows))
            H = 0.125 * np.kron(M2, np.diag(columns) @ W)
            other = expected[skip + k] - mu[k] * E @ E.T - H.T @ H / mu[k]
            d, block = len(other), mine[skip + k]
            corner = block[d:, d:]
            assert np.allclose(corner, corner[0, 0] * np.eye(len(corner)), rtol=1e-13)
            assert corner[0, 0] > 0
            schur = block[:d, :d] - block[:d, d:] @ np.linalg.solve(corner, block[d:, :d])
            # by absolute size too: the scale of the corner is mu's
            assert np.allclose(schur * mu[k] / corner[0, 0], other, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(("degree", "on"), LAWS)
@pytest.mark.parametrize("inverted", [True, False])
def test_rates_are_the_derivative_along_a_motion(degree, on, inverted):
    plant, region = plant_of(inverted), REGIONS["disk"]
    certificate, law = random_claim(plant, degree, on, region)
    rates, decay = (0.7, 0.4), 0.25
    exact_rates = tuple(Fraction(r) for r in rates)
    claim = Rate(subject_of(certificate, (2, 1), 1), Fraction(decay), exact_rates)
    tau = np.array([0.3, 0.6])
    coordinates = np.stack([1 - tau, tau], axis=1).ravel()
    for k, mine in enumerate(evaluated(claim, coordinates)):
        values = [
            value_of(p, share)
            for p, share in zip(plant.parameters, ((k + tau[0]) / 2, tau[1]), strict=True)
        ]
        W, moved = motion(plant, certificate, law, values, decay, rates)
        same_direction(mine[0], W)
        assert len(mine) == (5 if degree else 2)  # one W for all does not move
        found = [matrix / np.linalg.norm(matrix) for matrix in mine[1:]]
        for other in moved:
            gaps = [np.abs(one - other / np.linalg.norm(other)).max() for one in found]
            assert min(gaps) < 1e-8
        assert k < 2


def value_of(p, share):
    low, high = (float(p.scheduling(end)) for end in (p.low, p.high))
    s = low + share * (high - low)
    return 1 / s if p.inverted else s


def motion(plant, certificate, law, values, decay, rates):
    """W, and -(N + N' + 2 a W) + dW/dt by differences along p + t dp/dt, for all signs."""

    def at(p1, p2):
        alpha = plant.alpha(p1=p1, p2=p2)
        return (*law_at(certificate, law, alpha), *plant.at(alpha))

    W, Z, A, B = at(*values)
    N, h, moved = A @ W + B @ Z, 1e-5, []
    for signs in product((-1, 1), repeat=2):
        step = np.array(signs) * rates * h
        slope = (at(*(values + step))[0] - at(*(values - step))[0]) / (2 * h)
        moved.append(-(N + N.T + 2 * decay * W) + slope)
    return W, moved


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_rates_of_weight(degree):
    plant = bare()
    certificate, law = random_claim(plant, degree, "simplex", REGIONS["disk"])
    claim = Rate(subject_of(certificate, (), 0), Fraction(1, 4), (Fraction(1, 2),))
    a, h = np.array([0.2, 0.5, 0.3]), 1e-6
    (mine,) = evaluated(claim, a)
    A, B = plant.at(a)
    W, Z = law_at(certificate, law, a)
    N = A @ W + B @ Z
    same_direction(mine[0], W)
    found = [matrix / np.linalg.norm(matrix) for matrix in mine[1:]]
    assert len(found) == 6
    for j, k in ((0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)):
        step = h * (np.eye(3)[j] - np.eye(3)[k])
        slope = law_at(certificate, law, a + step)[0] - law_at(certificate, law, a - step)[0]
        other = -(N + N.T + 0.5 * W) + 0.5 * slope / (2 * h)
        gaps = [np.abs(one - other / np.linalg.norm(other)).max() for one in found]
        assert min(gaps) < 1e-8


# --- faults --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def proved():
    """A document for each kind of claim about one plant, each near the most that is proved."""
    parameters = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 1, 9, "N/m")]
    plant = UncertainPlant.from_expressions(
        parameters, [["0", "1"], ["-k/m", "-1/m"]], [["0"], ["1/m"]]
    )
    design = place(plant, Disk(-3, 2.2), Scheduled(1, 1, "box"))
    found = in_service(design, 0.1)
    assert found.proved
    return {margin.name: json.loads(found.file(margin).dumps()) for margin in found}


NAMES = ["estimate-m", "estimate-k", "estimate", "gain", "rate-m", "rate-k", "rate"]


@pytest.mark.parametrize("name", NAMES)
def test_what_is_proved_is_nearly_all_that_is(proved, name):
    document = proved[name]
    assert is_proved(document)
    table = document["claims"][0]
    key = {"estimate": "errors", "error of each gain": "error", "rate": "rates"}[table["kind"]]
    more = (lambda v: v * 1.01) if key == "error" else (lambda v: [x * 1.01 for x in v])
    less = (lambda v: v * 0.5) if key == "error" else (lambda v: [x * 0.5 for x in v])
    assert not is_proved(changed(document, "claims", 0, key, value=more))
    assert is_proved(changed(document, "claims", 0, key, value=less))


@pytest.mark.parametrize("name", NAMES)
def test_one_fault_in_the_design_at_a_time(proved, name):
    document = proved[name]
    law, vertex = ("law",), ("plant", "vertices", 3)
    tilted = changed(document, *law, "W", 0, 0, 1, value=lambda v: v * (1 + 1e-12))
    assert not is_proved(tilted)  # W is not symmetric
    for place_ in (
        (*law, "W", 0, 0, 0),
        (*law, "Z", 3, 0, 1),
        (*vertex, "A", 1, 1),
        (*vertex, "B", 1, 0),
    ):
        refused = [
            not is_proved(changed(document, *place_, value=lambda v, f=f: eval(str(v)) * f))
            for f in (-40, 0.2, 0.8, 1.25, 5, 40)
        ]
        assert any(refused), place_


@pytest.mark.parametrize("name", NAMES)
def test_the_ranges_are_part_of_the_claim(proved, name):
    """Other intervals, or 1/m in place of m, make other numbers of the same claim."""
    document, kind = proved[name], proved[name]["claims"][0]["kind"]
    parameters = ("plant", "parameters")
    narrow = changed(document, *parameters, 0, "range", value=[1, 1.2])
    narrow = changed(narrow, *parameters, 1, "range", value=[1, 1.2])
    number, through = (0, "m") if name.endswith("m") else (1, "1/k")
    flipped = changed(document, *parameters, number, "through", value=through)
    if kind == "error of each gain":  # which is about alpha alone
        assert is_proved(narrow)
        assert is_proved(flipped)
        return
    # a given error or rate is a larger share of a narrower range
    assert not is_proved(narrow)
    if name in ("estimate-m", "rate-k"):
        assert not is_proved(flipped)


def test_faults_of_single_claims(proved):
    gain, rate, estimate = proved["gain"], proved["rate"], proved["estimate"]
    for factor in (0.01, 100):
        mu = changed(gain, "claims", 0, "mu", value=lambda v, f=factor: (np.array(v) * f).tolist())
        assert not is_proved(mu)
    for j in range(2):
        wider = changed(gain, "claims", 0, "sizes", 0, j, value=lambda v: v * 1.5)
        assert not is_proved(wider)
        narrower = changed(gain, "claims", 0, "sizes", 0, j, value=0)  # one that is not off
        assert is_proved(narrower)
    assert not is_proved(changed(rate, "claims", 0, "decay", value=3))
    assert not is_proved(changed(gain, "claims", 0, "region", "radius", value=2.0))
    assert not is_proved(changed(estimate, "claims", 0, "region", "radius", value=2.0))
    with pytest.raises(FormatError, match="radius"):
        is_proved(changed(estimate, "claims", 0, "region", "radius", value=-1))
    assert is_proved(
        changed(rate, "claims", 0, "region", "radius", value=2.0)
    )  # rates are of motion
    wide, narrow = ({"kind": "disk", "centre": -3, "radius": r} for r in (2.5, 2.0))
    for document in (gain, estimate):
        assert is_proved(changed(document, "claims", 0, value=lambda t: t | {"region": wide}))
        assert not is_proved(changed(document, "claims", 0, value=lambda t: t | {"region": narrow}))


def test_a_sector_is_what_its_damping_says(proved):
    sector = Sector(0.05).document()
    claimed = changed(proved["estimate"], "claims", 0, value=lambda t: t | {"region": sector})
    assert is_proved(claimed)
    for damping in (0.01, 0.99):
        with pytest.raises(FormatError, match="slope"):
            is_proved(changed(claimed, "claims", 0, "region", "damping", value=damping))


def test_finer_proofs_prove_more():
    """Pieces and elevation never lose a claim, and at times win one."""
    plant, won = plant_of(), 0
    for seed in range(4):
        reached = {}
        for fineness in ((1, 0), (3, 0), (1, 2)):
            low, high = -200.0, 0.0
            for _ in range(8):
                middle = (low + high) / 2
                certificate, _ = random_claim(plant, 2, "box", HalfPlane(middle), seed)
                subject = subject_of(certificate, (fineness[0],) * 2, fineness[1])
                claim = Estimate(subject, (Fraction(0), Fraction(0)))
                low, high = (middle, high) if prove(claim).proved else (low, middle)
            reached[fineness] = low
        assert reached[3, 0] >= reached[1, 0] <= reached[1, 2]
        won += reached[3, 0] > reached[1, 0]
    assert won


FAULTS = {
    "kind": (("claims", 0, "kind"), "delay", "must be one of"),
    "other kind": (("claims", 0, "kind"), "gain error", "is missing|unknown key"),
    "unknown key": (("claims", 0, "margin"), 1, "unknown key .*margin"),
    "unknown top": (("note",), 1, "unknown key note"),
    "version": (("version",), 3, "version 3"),
    "format": (("format",), "polefence-service", "polefence-proof|polefence 0.1"),
    "no design": (("plant",), None, "plant must be a table"),
    "law of another kind": (("law", "kind"), "x", "must be"),
    "errors missing": (("claims", 0, "errors"), [0], "errors must hold 2"),
    "negative": (("claims", 0, "errors"), [0, -1], "zero or more"),
    "word": (("claims", 0, "errors"), [0, "x"], "not a finite number"),
    "pieces": (("claims", 0, "pieces"), [1], "list of 2 entries"),
    "no pieces": (("claims", 0, "pieces"), [0, 1], "1 to 64"),
    "many pieces": (("claims", 0, "pieces"), [65, 1], "1 to 64"),
    "half a piece": (("claims", 0, "pieces"), [1.5, 1], "whole numbers"),
    "work": (("claims", 0), None, "too many, or too large"),
    "elevation": (("claims", 0, "elevation"), 17, "0 to 16"),
    "parameters": (("plant", "parameters"), [], "parameters holds 0"),
    "range": (("plant", "parameters", 0, "range"), [2, 1], "empty"),
    "zero": (("plant", "parameters", 0, "range"), [-1, 1], "touches zero"),
    "one bound": (("plant", "parameters", 0, "range"), [1], "list of 2 entries"),
    "through": (("plant", "parameters", 0, "through"), "m**2", "through"),
    "name": (("plant", "parameters", 0, "name"), "k", "through"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_malformed_file_is_named(proved, fault):
    keys, value, message = FAULTS[fault]
    if fault == "work":
        large = {"pieces": [64, 64], "elevation": 16}
        document = changed(proved["estimate"], "claims", 0, value=lambda t: t | large)
    else:
        holder = copy.deepcopy(proved["estimate"])
        place_ = holder
        for key in keys[:-1]:
            place_ = place_[key]
        place_[keys[-1]] = value
        document = holder
    with pytest.raises(FormatError, match=message):
        is_proved(document)


def test_claims_that_do_not_fit_together(proved):
    rate, gain = proved["rate"], proved["gain"]
    with pytest.raises(FormatError, match="only one W"):
        is_proved(changed(rate, "claims", 0, "rates", value="any"))
    for value, message in (
        ([[1, 1], [1, 1]], "sizes is 2 x 2, not 1 x 2"),
        ([[0, 0]], "not all zero"),
        ([[1, -1]], "zero or more"),
    ):
        with pytest.raises(FormatError, match=message):
            is_proved(changed(gain, "claims", 0, "sizes", value=value))
    with pytest.raises(FormatError, match="mu must be positive"):
        is_proved(changed(gain, "claims", 0, "mu", 0, 0, 0, value=0))
    with pytest.raises(FormatError, match="mu must hold 1 matrices"):
        is_proved(changed(gain, "claims", 0, "mu", value=lambda v: v * 2))
    with pytest.raises(FormatError, match="continuous time"):
        is_proved(changed(rate, "plant", value=lambda t: t | {"sample_time": 0.1}))
    with pytest.raises(FormatError, match="margins are not proved for"):
        slack, _ = random_claim(plant_of(), 0, "fixed", REGIONS["disk"])
        claim = replace(slack.claim(), method="slack")
        prove(Rate(Subject(claim), Fraction(0), None))
    with pytest.raises(FormatError, match="cut short"):
        loads(json.dumps(rate)[:-9])
