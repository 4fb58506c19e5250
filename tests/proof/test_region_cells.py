"""Regions proved in cells: matrices against numpy's, the same loop exactly, one fault at a time."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence.certify.candidates import Deadline
from polefence.certify.design import Design
from polefence.certify.evidence import Search, certificate_of, placeholder
from polefence.certify.margins.gain_scales import gain_claim
from polefence.law.laws import FixedGain
from polefence.plant.family import UncertainPlant
from polefence.plant.parameters import Parameter
from polefence.proof.claims.base import prove
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.rate import Rate
from polefence.proof.document import check, loads
from polefence.proof.laws import Evidence, Piece
from polefence.proof.work import FormatError
from polefence.region.regions import HalfPlane, Sector
from support.scheduled_masses import masses, poles, scheduled

ONE, HALF = Fraction(1), Fraction(1, 2)


@pytest.fixture(scope="module")
def certificate():
    """A decay rate and a damping ratio a hundredth inside what the poles have."""
    plant = masses()
    law = scheduled(plant)
    z = poles(plant, law)
    parts = HalfPlane(-0.99 * z.real.max()), Sector(0.99 * float((-z.real / np.abs(z)).min()))
    each = [Search(plant, law, part, Deadline()).in_parts() for part in parts]
    return certificate_of(plant, law, parts[0] & parts[1], each)


@pytest.fixture(scope="module")
def claim(certificate):
    return certificate.claim()


def with_cells(claim, cells, part=0):
    """The claim with other cells for a part of the region."""
    evidence = list(claim.evidence)
    evidence[part] = Evidence([], cells=tuple(cells))
    return replace(claim, evidence=tuple(evidence))


def test_files_keep_the_cells(certificate, claim):
    assert all(len(own.cells) > 1 for own in claim.evidence)
    verdict = prove(claim)
    assert verdict.proved
    most = max(len(own.cells) for own in claim.evidence)
    assert verdict.reason.endswith(f"in {most} parts of the box")
    read = loads(certificate.dumps())
    assert read.claims == (claim,)
    assert check(read).proved
    again = type(certificate).of(read)
    assert again.claim() == claim
    assert again.in_parts


def test_the_work_is_that_of_each_part_alone(claim):
    """Each inequality is counted once: cells of one part are none of another."""
    each = [
        replace(claim, region=(part,), evidence=(own,))
        for part, own in zip(claim.region, claim.evidence, strict=True)
    ]
    of_regions = [place for place, _ in claim.blocks() if place.inequality != "of X"]
    assert claim.count == len(of_regions) == sum(own.count for own in each)
    assert claim.least == sum(own.least for own in each)


def test_the_coefficients_are_those_of_the_loop_there(claim):
    """At a point of each cell, from numpy's own A + B K and X."""
    random = np.random.default_rng(1)
    A, B = (np.array(M, dtype=float) for M in (claim.A, claim.B))
    found = list(claim.inequalities())
    for part, evidence in zip(claim.region, claim.evidence, strict=True):
        for k, piece in enumerate(evidence.cells):
            own = [each for each in found if each.piece == f", cell {k + 1}"]
            F = next(each for each in own if each.name == part.kind)
            t = random.random()
            at = float(piece.low[0]) + t * float(piece.high[0] - piece.low[0])
            c = 2 * at - 1
            K = sum(
                np.array(K, dtype=float) * c ** e[0]
                for e, K in zip(claim.law.powers, claim.law.K, strict=True)
            )
            loop = (1 - at) * A[0] + at * A[1] + B[0] @ K
            d, X = piece.evidence.degree, np.array(piece.evidence.X, dtype=float)
            assert d <= 1  # in the file's order: the lower end first
            X = X[0] if d == 0 else (1 - t) * X[0] + t * X[1]
            (L, M), *_ = part.pairs
            L, M = np.array(L, dtype=float), np.array(M, dtype=float)
            N = loop @ X
            expected = -(np.kron(L, X) + np.kron(M, N) + np.kron(M.T, N.T))
            total = 0
            for place, matrix in F.blocks():
                power = np.prod(np.power([1 - t, t], place.powers))
                total = total + power * np.array(matrix, dtype=float)
            scale = np.trace(total) / np.trace(expected)
            assert scale > 0
            np.testing.assert_allclose(total / scale, expected, atol=1e-9 * np.abs(expected).max())


def test_the_loop_in_a_cell_is_the_same_loop():
    """Of one gain on a box of two parameters, and of a polynomial law, exactly."""
    random = np.random.default_rng(3)
    plant = UncertainPlant.from_expressions(
        [Parameter("p", 1, 2), Parameter("q", -1, 3)], [[0, 1], ["-p*q", "-p"]], [[0], ["q"]]
    )
    two = masses()
    one = FixedGain(np.array([[-1.5, 0.25]]))
    for plant_, law in ((plant, one), (two, scheduled(two))):
        claim = certificate_of(plant_, law, HalfPlane(0), [placeholder(plant_, law)]).claim()
        count = len(claim.sizes)
        low, high = (Fraction(1, 3),) * count, (Fraction(7, 9),) * count
        inside = claim.inside(Piece(low, high, claim.evidence[0]))
        for _ in range(3):
            t = [Fraction(int(x), 31) for x in random.integers(0, 32, count)]
            whole = [a + (b - a) * x for a, b, x in zip(low, high, t, strict=True)]
            loops = []
            for own, point in ((inside, t), (claim, whole)):
                alpha = [ONE]
                for x in point:
                    alpha = [a * w for a in alpha for w in (1 - x, x)]
                loops.append(own.closed_loop(alpha))
            assert loops[0] == loops[1]


def moved(piece, **ends):
    return replace(piece, **{key: (value,) for key, value in ends.items()})


@pytest.mark.parametrize("part", [0, 1])
def test_cells_that_do_not_make_up_the_box(claim, part):
    cells = sorted(claim.evidence[part].cells, key=lambda own: own.low)
    second = cells[1]
    middle = (second.low[0] + second.high[0]) / 2
    for k in range(len(cells)):
        left = [*cells[:k], *cells[k + 1 :]]
        assert "do not fill" in prove(with_cells(claim, left, part)).reason
    shrunk = [cells[0], moved(second, low=middle), *cells[2:]]
    assert "do not fill" in prove(with_cells(claim, shrunk, part)).reason
    twice = [*cells, cells[0]]
    assert "overlap" in prove(with_cells(claim, twice, part)).reason
    wider = [moved(cells[0], high=middle), *cells[1:]]
    assert "overlap" in prove(with_cells(claim, wider, part)).reason
    assert prove(with_cells(claim, cells[::-1], part)).proved  # in any order


@pytest.mark.parametrize("part", [0, 1])
def test_evidence_of_another_cell_proves_nothing(claim, part):
    cells = sorted(claim.evidence[part].cells, key=lambda own: own.low)
    first, last = cells[0], cells[-1]
    swapped = [
        replace(first, evidence=last.evidence),
        *cells[1:-1],
        replace(last, evidence=first.evidence),
    ]
    verdict = prove(with_cells(claim, swapped, part))
    assert not verdict.proved
    assert "not positive definite" in verdict.reason
    assert ", cell 1" in str(verdict.place)
    X = first.evidence.X
    for bad, words in (
        ([[[-x for x in row] for row in Q] for Q in X], "not positive definite"),
        ([[[x + (i < j) for j, x in enumerate(r)] for i, r in enumerate(Q)] for Q in X], "not sym"),
    ):
        other = replace(first, evidence=replace(first.evidence, X=bad))
        assert words in prove(with_cells(claim, [other, *cells[1:]], part)).reason


def test_cells_that_do_not_belong_are_refused(claim):
    first, *rest = claim.evidence[0].cells
    own = first.evidence
    nested = replace(first, evidence=Evidence([], cells=(first, *rest)))
    bad = [
        moved(first, high=Fraction(2)),
        moved(first, low=first.high[0]),
        replace(first, low=(first.low[0],) * 2, high=(first.high[0],) * 2),
        nested,
        replace(first, evidence=replace(own, degree=own.degree + 1)),
        replace(first, evidence=replace(own, X=own.X[:-1])),
        replace(first, evidence=replace(own, multiple=(ONE,) * len(own.X))),
        replace(first, evidence=replace(own, dual=True)),
        replace(first, evidence=replace(own, elevation=17)),
        replace(first, evidence=replace(own, tau=ONE)),
    ]
    for cell in bad:
        with pytest.raises(FormatError):
            prove(with_cells(claim, [cell, *rest]))
    both = replace(claim.evidence[0], X=own.X)
    weighted = replace(claim, weights=(ONE, HALF))
    for other in (replace(claim, evidence=(both, claim.evidence[1])), weighted):
        with pytest.raises(FormatError, match="cells"):
            prove(other)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda e: e["parts"][0].update(cells=[]), "list of 1 to"),
        (lambda e: e["parts"][0].update(X=[[[1]]]), "unknown key"),
        (lambda e: e["parts"][0]["cells"][0].pop("X"), "X is missing"),
        (lambda e: e["parts"][0]["cells"][0].pop("low"), "low is missing"),
        (lambda e: e["parts"][0]["cells"][0].update(low=[0, 0]), "low"),
        (lambda e: e["parts"][0]["cells"][0].update(cells=[]), "unknown key"),
        (lambda e: e["parts"].pop(), "do not belong"),
    ],
)
def test_a_fault_in_a_file_of_cells_is_named(certificate, change, words):
    table = json.loads(certificate.dumps())
    change(table["claims"][0]["evidence"])
    with pytest.raises(FormatError, match=words):
        check(loads(json.dumps(table)))


def test_the_gains_error_is_proved_cell_by_cell(certificate):
    """More is not, nor with a cell left out; the other margins need one X for all."""
    largest, claim = gain_claim(Design(certificate), np.ones(1), np.ones(4), 0.0)
    assert largest > 0
    assert prove(claim).proved
    assert claim.error <= largest
    assert not prove(replace(claim, error=Fraction(largest * 1.2))).proved
    design = claim.subject.design
    left = with_cells(design, design.evidence[0].cells[1:])
    less = claim.mu[1:]
    fewer = replace(claim, subject=replace(claim.subject, design=left), mu=less)
    assert "do not fill" in prove(fewer).reason
    with pytest.raises(FormatError, match="mu must hold"):
        prove(replace(claim, mu=less))
    for other in (Estimate(claim.subject, (ONE,)), Rate(claim.subject, ONE, (ONE,))):
        with pytest.raises(FormatError, match="needs one X"):
            prove(other)
