"""Service claims about given laws: X and K X of each part, and one fault after another."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from test_margins import (
    ENDS_OF_TAU,
    REGIONS,
    bare,
    estimate_pairs,
    plant_of,
    region_blocks,
    same_direction,
    spd,
    subject_of,
    value_of,
)

from polefence import Certificate, Parameter, Scheduled, UncertainPlant, place
from polefence.certify.given import analyse
from polefence.certify.margins import in_service
from polefence.law.laws import FixedGain, ScheduledGain
from polefence.plant.polynomial import Domain
from polefence.proof.claims.base import prove
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.margins import cells
from polefence.proof.claims.rate import Rate
from polefence.proof.work import FormatError
from polefence.region.regions import Disk
from support.changes import changed
from support.files import first, is_proved

# law's degree (None: one gain), domain, degrees of the parts' own polynomials
GIVEN = [
    (None, "simplex", (0, 1, 2, 0)),
    (None, "box", (2, 0, 1, 1)),
    (1, "simplex", (0, 1, 0, 0)),
    (1, "box", (1, 0, 0, 2)),
    (2, "box", (0, 0, 1, 0)),
]


def given_claim(plant, degree, on, degrees, region, seed=5):
    """A law of no meaning with evidence of no meaning, for each part."""
    random, N = np.random.default_rng(seed), len(plant.vertices)
    domain, parts = Domain.of(on, N), []
    if degree is None:
        law = FixedGain(random.normal(size=(2, 2)))
    else:
        count = domain.count(degree)
        W = np.array([spd(random) for _ in range(count)])
        Z = random.normal(size=(count, 2, 2))
        law = ScheduledGain(W, Z, plant.parameters, degree, domain.sizes)
    for d in degrees[: len(region.parts)]:
        X = np.array([spd(random) for _ in range(domain.count(d))])
        own = {"X": X, "degree": d, "elevation": 0}
        if degree is not None:
            own["multiple"] = random.uniform(0.5, 2, len(X))
        parts.append(own)
    evidence = {"parts": tuple(parts)} | ({"on": on} if degree is None else {})
    return Certificate(plant, region, "lyapunov", law, evidence), domain


def law_at(certificate, domain, part, alpha):
    """X and K X of one part at one alpha."""
    law, own = certificate.law, certificate.evidence["parts"][part]
    basis = domain.basis(alpha, own["degree"])
    Q = np.tensordot(basis, own["X"], 1)
    if isinstance(law, FixedGain):
        return Q, law.K @ Q
    W, Z = (np.tensordot(domain.basis(alpha, law.degree), M, 1) for M in (law.W, law.Z))
    V = basis @ own["multiple"] * np.eye(2) + Q @ W
    return W @ V, Z @ V


def evaluated(claim, coordinates):
    """For each part and piece the number of the part, and the values of its polynomials."""
    found, subject = list(claim.inequalities()), claim.subject
    for number, (part,) in subject.parts:
        if isinstance(claim, Rate) and number != claim.part:
            continue
        for cell in claim.cells() if isinstance(claim, Estimate) else cells(subject):
            kinds = (part.kind != "disk") + len(part.pairs)
            if isinstance(claim, Rate):
                kinds = 1 + (4 if subject.degree(number) else 1)
            values = []
            for _ in range(kinds):
                mine = found.pop(0)
                assert mine.piece == cell.name
                blocks = list(mine.blocks())
                weights = [np.prod(np.power(coordinates, place.powers)) for place, _ in blocks]
                matrices = np.array([m for _, m in blocks], dtype=float)
                values.append(np.tensordot(weights, matrices, 1))
            yield number, values
    assert not found


@pytest.mark.parametrize(("degree", "on", "degrees"), GIVEN)
@pytest.mark.parametrize("region", REGIONS)
def test_estimates_are_the_matrices_at_p_and_its_estimate(degree, on, degrees, region):
    plant, region = plant_of(), REGIONS[region]
    certificate, domain = given_claim(plant, degree, on, degrees, region)
    claim = Estimate(subject_of(certificate, (2, 1), 1), (Fraction(1, 3), Fraction(2)))
    places = estimate_pairs(plant, (1 / 3, 2.0), (2, 1))
    found = list(evaluated(claim, ENDS_OF_TAU))
    assert len(found) == len(places) * len(region.parts)
    for k, (number, mine) in enumerate(found):
        first, second = places[k % len(places)]
        A, B = plant.at(plant.alpha(p1=first[0], p2=second[0]))
        X, KX = law_at(certificate, domain, number, plant.alpha(p1=first[1], p2=second[1]))
        expected = region_blocks(region.parts[number], X, A @ X + B @ KX)
        for one, other in zip(mine, expected, strict=True):
            same_direction(one, other)


@pytest.mark.parametrize(("degree", "degrees"), [(None, (1, 0, 2, 0)), (1, (0, 1, 0, 0))])
def test_mislaid_weight(degree, degrees):
    plant, region = bare(), REGIONS["all"]
    certificate, domain = given_claim(plant, degree, "simplex", degrees, region)
    claim = Estimate(subject_of(certificate, (), 1), (Fraction(1, 5),))
    a, v = np.array([0.2, 0.5, 0.3]), np.array([0.1, 0.3, 0.6])
    found = list(evaluated(claim, np.concatenate([a, v])))
    assert len(found) == 3 * len(region.parts)
    for k, (number, mine) in enumerate(found):
        A, B = plant.at(0.8 * a + 0.2 * np.eye(3)[k % 3])
        X, KX = law_at(certificate, domain, number, 0.8 * a + 0.2 * v)
        expected = region_blocks(region.parts[number], X, A @ X + B @ KX)
        for one, other in zip(mine, expected, strict=True):
            same_direction(one, other)


@pytest.mark.parametrize(("degree", "on", "degrees"), GIVEN)
@pytest.mark.parametrize("part", [0, 1])
def test_rates_are_the_derivative_along_a_motion(degree, on, degrees, part):
    plant = plant_of()
    certificate, domain = given_claim(plant, degree, on, degrees, REGIONS["all"])
    rates, decay, h = (0.7, 0.4), 0.25, 1e-5
    claim = Rate(
        subject_of(certificate, (2, 1), 1), Fraction(decay), tuple(map(Fraction, rates)), part
    )
    for k, (number, mine) in enumerate(evaluated(claim, ENDS_OF_TAU)):
        assert number == part
        values = [
            value_of(p, share)
            for p, share in zip(plant.parameters, ((k + 0.3) / 2, 0.6), strict=True)
        ]

        def at(p1, p2):
            alpha = plant.alpha(p1=p1, p2=p2)
            return (*law_at(certificate, domain, part, alpha), *plant.at(alpha))

        X, KX, A, B = at(*values)
        same_direction(mine[0], X)
        N = A @ X + B @ KX
        for signs in product((-1, 1), repeat=2):
            step = np.array(signs) * rates * h
            slope = (at(*(values + step))[0] - at(*(values - step))[0]) / (2 * h)
            other = -(N + N.T + 2 * decay * X) + slope
            other = other / np.linalg.norm(other)
            gaps = [np.abs(one / np.linalg.norm(one) - other).max() for one in mine[1:]]
            assert min(gaps) < 1e-8


# --- faults --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def proved():
    """Documents of all kinds of claims about a law that was given, each near the most."""
    parameters = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 1, 9, "N/m")]
    plant = UncertainPlant.from_expressions(
        parameters, [["0", "1"], ["-k/m", "-1/m"]], [["0"], ["1/m"]]
    )
    design = place(plant, Disk(-3, 2.2), Scheduled(1, 1, "box"))
    found = in_service(analyse(plant, design.law, design.region).design, 0.1)
    assert found.proved
    return {margin.name: json.loads(found.file(margin).dumps()) for margin in found}


NAMES = ["estimate-m", "estimate-k", "estimate", "rate-m", "rate-k", "rate"]


@pytest.mark.parametrize("name", NAMES)
def test_what_is_proved_is_nearly_all_that_is(proved, name):
    document = proved[name]
    assert is_proved(document)
    key = {"estimate": "errors", "rate": "rates"}[document["claims"][0]["kind"]]
    assert not is_proved(changed(document, "claims", 0, key, value=lambda v: [x * 1.01 for x in v]))
    assert is_proved(changed(document, "claims", 0, key, value=lambda v: [x * 0.5 for x in v]))


@pytest.mark.parametrize("name", NAMES)
def test_one_fault_in_the_design_at_a_time(proved, name):
    document = proved[name]
    law, own = ("law",), ("claims", 0, "evidence", "parts", 0)
    for tilted in ((*law, "W", 0, 0, 1), (*own, "X", 0, 0, 1)):
        # no longer symmetric
        assert not is_proved(changed(document, *tilted, value=lambda v: v * (1 + 1e-9) + 1e-12))
    for place_ in (
        (*law, "W", 0, 0, 0),
        (*law, "Z", 3, 0, 1),
        ("plant", "vertices", 3, "A", 1, 1),
        ("plant", "vertices", 3, "B", 1, 0),
    ):
        refused = [
            not is_proved(changed(document, *place_, value=lambda v, f=f: eval(str(v)) * f))
            for f in (-40, 0.2, 0.8, 1.25, 5, 40)
        ]
        assert any(refused), place_
    # the evidence itself: large where it is added to W, negative where it leads
    for key, factors in (("X", (-1e9, 1e9)), ("multiple", (-40.0, -1.0))):
        refused = [
            not is_proved(changed(document, *own, key, 0, value=lambda v, f=f: scaled(v, f)))
            for f in factors
        ]
        assert any(refused), key


def scaled(value, factor):
    if isinstance(value, list):
        return [scaled(v, factor) for v in value]
    return value * factor


def test_decays_and_parts_belong_to_the_claim(proved):
    document = proved["rate-m"]
    assert not is_proved(changed(document, "claims", 0, "decay", value=1.5))
    for part in (0, 2, "1", 1.0, True):
        with pytest.raises(FormatError, match="part must be"):
            is_proved(changed(document, "claims", 0, value=lambda t, p=part: t | {"part": p}))
    # no constant Lyapunov matrix: not any rate
    with pytest.raises(FormatError, match="any rate"):
        is_proved(changed(document, "claims", 0, "rates", value="any"))
    with pytest.raises(FormatError, match="unknown key"):
        is_proved(changed(proved["estimate"], "claims", 0, value=lambda t: t | {"part": 1}))


def test_a_part_is_taken_of_the_region_that_is_kept(proved):
    """The evidence of another region proves nothing that it does not prove there."""
    document = proved["estimate-m"]
    for radius, holds in ((2.3, True), (2.0, False)):
        region = {"kind": "disk", "centre": -3, "radius": radius}
        kept = changed(document, "claims", 0, value=lambda t, r=region: t | {"region": r})
        assert is_proved(kept) is holds
    two = {"kind": "intersection", "parts": [region, {"kind": "half_plane", "decay": 0.1}]}
    with pytest.raises(FormatError, match="law and evidence"):
        is_proved(changed(document, "claims", 0, value=lambda t: t | {"region": two}))


def test_slack_itself_has_no_proofs(proved):
    claim = json.loads(json.dumps(proved["rate"]))
    assert first(claim)["method"] == "lyapunov"
    certificate, _ = given_claim(plant_of(), None, "simplex", (0,), REGIONS["disk"])
    design = replace(certificate.claim(), method="slack")
    subject = replace(subject_of(certificate, (1, 1)), design=design)
    with pytest.raises(FormatError, match="margins are not proved for the method slack"):
        prove(Rate(subject, Fraction(0), None))
