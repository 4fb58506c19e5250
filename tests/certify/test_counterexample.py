"""Counterexamples: found where they exist, exact, and never where the claim is true."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence import Disk, FixedGain, ScheduledGain, UncertainPlant, check
from polefence.certify.certificate import Certificate
from polefence.certify.counterexample import counterexample, first_worst, worst_points
from polefence.show import paper


def test_a_pole_that_leaves_inside_an_edge_is_found():
    """Stable at both vertices, not between them: A(alpha) rotates through an unstable shear."""
    A = [[[-1, 9], [0, -1]], [[-1, 0], [9, -1]]]
    plant = UncertainPlant.from_vertices(A, [[[0], [1]]] * 2)
    certificate = Certificate(
        plant, Disk(-1, 1), "quadratic", FixedGain(np.zeros((1, 2))), {"W": np.eye(2)}
    )
    answer = check(certificate)
    assert answer.answer == "refuted"
    a, b = answer.alpha
    assert a + b == 1
    assert 9 * float(np.sqrt(float(a * b))) > 1  # the pole -1 + 9 sqrt(ab) leaves the disk
    assert not certificate.claim().poles_inside(list(answer.alpha))


@pytest.mark.parametrize("key", ["lemma1", "lemma2"])
def test_published_gains_on_the_physical_car_are_refuted(physical, key):
    """The paper's fixed gains meet their disks on the printed vertices only."""
    case = paper.published()["fixed_gains"][key]
    region, law = Disk(case["centre"], case["radius"]), FixedGain([case["K"]])
    certificate = Certificate(physical, region, "quadratic", law, {"W": np.eye(5)})
    assert check(certificate).answer == "refuted"


def test_true_claims_are_never_refuted(small_designs):
    for design in small_designs.values():
        assert counterexample(design.certificate.claim()) is None


def test_a_true_claim_with_a_useless_certificate_is_undecided(small_designs):
    design = small_designs["quadratic"]
    wider = replace(
        design.certificate,
        region=Disk(design.region.centre, 1.2 * design.region.radius),
        evidence={"W": np.diag([1.0, 1e9])},
    )
    answer = check(wider)
    assert answer.answer == "undecided"
    assert "not positive definite" in answer.reason


def test_a_law_that_is_singular_somewhere_is_refuted(small_designs):
    """W(alpha) = 0 at equal weights: K(alpha) has no value there."""
    plant = UncertainPlant.from_vertices([[[0]], [[0]]], [[[1]], [[1]]])
    law = ScheduledGain([[[1.0]], [[-1.0]]], [[[-2.0]], [[2.0]]])
    certificate = Certificate(plant, Disk(-2, 1), "scheduled", law, {"tau": np.array(0.0)})
    claim = certificate.claim()
    assert not claim.poles_inside([Fraction(1, 2), Fraction(1, 2)])
    answer = check(certificate)
    assert answer.answer == "refuted"
    assert not claim.poles_inside(list(answer.alpha))


@pytest.mark.parametrize("seed", range(3))
def test_of_points_that_rounding_tells_apart_the_first_is_named(seed):
    """A measure that is flat but for its last bits: the first corner, whichever these favour."""
    A = [[[-1.0, k], [0.0, -2.0]] for k in range(3)]
    plant = UncertainPlant.from_vertices(A, [[[0.0], [1.0]]] * 3)
    claim = Certificate(
        plant, Disk(-2, 1.9), "quadratic", FixedGain([[0.0, 0.0]]), {"W": np.eye(2)}
    ).claim()
    random = np.random.default_rng(seed)

    def measure(poles):
        return np.real(poles).max(axis=-1) * (1 + 1e-14 * random.normal(size=poles.shape[:-1]))

    point, worst = first_worst(worst_points(claim, measure))
    assert point.tolist() == [1, 0, 0]
    assert worst == pytest.approx(-1)
