"""Files of format 2 whose claim "sampled" says that a sampled loop decays: theory from the other
side, and every fault found.
"""

import math
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from polefence.certify.certificate import plant_of
from polefence.export import check_guarantee
from polefence.law.laws import law_of
from polefence.proof.claims.base import prove
from polefence.proof.claims.sampled import Off, Sampled, loop_claim
from polefence.proof.claims.steps import exponential, held_size, step_error
from polefence.proof.document import check, loads
from polefence.proof.work import FormatError

FILES = Path(__file__).parent / "format2"
TIME = 0.02
POLYNOMIALS = ("signals", "signals that vary")


@cache
def document(kind="box", delay=1):
    name = f"{kind.replace(' ', '-')}-{delay}.json"
    return loads((FILES / name).read_text())


class Loop:
    """The plant and the law of such a file, and its claim."""

    def __init__(self, kind, delay):
        self.claim = document(kind, delay).first(Sampled)
        self.plant = plant_of(document(kind, delay).plant)
        self.law = law_of(self.claim.design.law, self.plant, self.claim.design.sizes)


@cache
def proof(kind="box", delay=1):
    return Loop(kind, delay)


design = proof


CASES = [(kind, delay) for kind in ("box", *POLYNOMIALS) for delay in (0, 1)]
CASES += [("corners", 1), ("one gain", 1)]


@pytest.mark.parametrize(("kind", "delay"), CASES)
def test_the_file_is_proved(kind, delay):
    assert check(document(kind, delay)).proved


def test_the_folder_of_an_export_is_proved():
    assert check_guarantee(FILES / "export").proved


@pytest.mark.parametrize(("kind", "delay"), CASES)
def test_poles_by_expm_decay_as_claimed(kind, delay):
    own, claim = design(kind), proof(kind, delay).claim
    for a in points(kind, 40):
        z = np.linalg.eigvals(by_expm(own, a, TIME, delay))
        assert np.abs(z).max() < math.exp(-float(claim.decay) * TIME)


def points(kind, count):
    random = np.random.default_rng(1)
    if kind == "corners":
        return np.vstack([np.eye(3), random.dirichlet(np.ones(3), count)])
    share = np.vstack([[[0, 0], [1, 1]], random.random((count, 2))])
    pair = [np.stack([1 - s, s], axis=-1) for s in share.T]
    return np.einsum("ka,kb->kab", *pair).reshape(-1, 4)


def by_expm(own, alpha, time, delay):
    A, B = own.plant.at(alpha)
    K, n, m = own.law.gain(alpha), *own.plant.shape
    whole = np.zeros((n + m, n + m))
    whole[:n] = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * time)[:n]
    if not delay:
        return whole[:n, :n] + whole[:n, n:] @ K
    whole[n:, :n] = K
    return whole


@pytest.mark.parametrize("kind", ["box", "corners", *POLYNOMIALS])
def test_the_error_of_the_steps_is_bounded_and_not_by_far(kind):
    claim = proof(kind).claim
    bound = float(step_error(claim, loop_claim(claim).subject.design.sizes))
    T, S = np.array(claim.T, dtype=float), np.diag(np.array(claim.scale, dtype=float))
    steps, worst = np.array(claim.steps, dtype=float), 0.0
    for a in points(kind, 200):
        A, B = design(kind).plant.at(a)
        rates = np.hstack([T @ A @ np.linalg.inv(T), T @ B @ S])
        whole = expm(np.vstack([rates, np.zeros((1, 3))]) * TIME)[:2]
        worst = max(worst, float(np.linalg.norm(whole - np.tensordot(a, steps, 1))))
    assert worst < bound < 2 * worst


@pytest.mark.parametrize("kind", ["box", *POLYNOMIALS])
@pytest.mark.parametrize("delay", [0, 1])
def test_the_loop_of_the_claim_is_that_of_design_and_steps(kind, delay):
    claim = proof(kind, delay).claim
    alpha = [Fraction(a) for a in ("1/5", "3/10", "1/5", "3/10")]
    exact = np.array(loop_claim(claim).subject.design.closed_loop(alpha), dtype=float)
    z = np.sort_complex(np.linalg.eigvals(exact))
    own = by_expm(design(kind), np.array(alpha, dtype=float), TIME, delay)
    # they differ by the steps' error, which is small
    assert np.abs(z - np.sort_complex(np.linalg.eigvals(own))).max() < 1e-3


@pytest.mark.parametrize("kind", ["box", *POLYNOMIALS])
def test_the_size_of_the_law_without_delay_is_a_bound(kind):
    claim, own = proof(kind, 0).claim, design(kind)
    T, S = np.array(claim.T, dtype=float), np.array(claim.scale, dtype=float)
    gains = own.law.gain(points("box", 300)) @ np.linalg.inv(T) / S[:, None]
    largest = np.sqrt(1 + np.linalg.norm(gains, 2, axis=(1, 2)).max() ** 2)
    assert largest * (1 - 1e-12) < float(held_size(claim)) < 3 * largest  # equal at a vertex


@pytest.mark.parametrize("x", [Fraction(0), Fraction(1, 7), Fraction(3), Fraction(20)])
def test_the_exponential_is_bounded_from_above(x):
    assert (
        math.exp(x) * (1 - 1e-15)
        <= float(exponential(x))
        <= math.exp(x) * (1 + (1e-12 if x < 5 else 1e-4))
    )


def test_an_error_of_the_gain_needs_room_of_its_own():
    columns = [[Fraction(2), Fraction(0)], [Fraction(1), Fraction(1, 2)]]
    off = Off(Fraction(1, 10), (Fraction(1),), columns)
    assert not prove(replace(proof("box").claim, off=off)).proved


# --- one fault at a time -------------------------------------------------------------------------


def matrix(entries, i, j, change):
    return [
        [v + change * ((a, b) == (i, j)) for b, v in enumerate(r)] for a, r in enumerate(entries)
    ]


def in_design(claim, **changes):
    return replace(claim, design=replace(claim.design, **changes))


def in_law(claim, **changes):
    return in_design(claim, law=replace(claim.design.law, **changes))


def in_evidence(claim, **changes):
    return replace(claim, evidence=replace(claim.evidence, **changes))


FAULTS = {
    "decay too fast": lambda c: replace(c, decay=c.decay + Fraction(1, 10)),
    "radius too large": lambda c: replace(c, radius=c.radius + Fraction(1, 100)),
    "radius too small": lambda c: replace(c, radius=c.radius - Fraction(1, 50)),
    "another sample time": lambda c: replace(c, sample_time=c.sample_time * Fraction(9, 10)),
    "a step off": lambda c: replace(c, steps=(matrix(c.steps[0], 0, 0, 3 * c.error), *c.steps[1:])),
    "the input's step off": lambda c: replace(
        c, steps=(*c.steps[:-1], matrix(c.steps[-1], 1, 2, 3 * c.error))
    ),
    "too few terms": lambda c: replace(c, terms=2),
    "less error than there is": lambda c: replace(c, error=c.error / 2, mu=c.mu / 2),
    "more error than is tolerated": lambda c: replace(c, error=20 * c.error, mu=20 * c.mu),
    "mu too large": lambda c: replace(c, mu=c.mu * 10**6),
    "mu too small": lambda c: replace(c, mu=c.mu / 10**6),
    "X not symmetric": lambda c: in_evidence(
        c, X=[matrix(c.evidence.X[0], 0, 1, Fraction(1, 10**9)), *c.evidence.X[1:]]
    ),
    "X too small": lambda c: in_evidence(
        c, X=[matrix(x, 2, 2, -abs(x[2][2]) - 1) for x in c.evidence.X]
    ),
    "multiples too small": lambda c: in_evidence(
        c, multiple=tuple(v - 2 for v in c.evidence.multiple)
    ),
    "another A": lambda c: in_design(
        c, A=[matrix(c.design.A[0], 1, 0, Fraction(1)), *c.design.A[1:]]
    ),
    "another B": lambda c: in_design(
        c, B=[*c.design.B[:-1], matrix(c.design.B[-1], 1, 0, Fraction(1, 10))]
    ),
    "vertices in another order": lambda c: in_design(c, A=c.design.A[::-1], B=c.design.B[::-1]),
    "another Z": lambda c: in_law(
        c, Z=[[[2 * v for v in row] for row in z] for z in c.design.law.Z]
    ),
    "W not symmetric": lambda c: in_law(
        c, W=[matrix(c.design.law.W[0], 0, 1, Fraction(1, 10**9)), *c.design.law.W[1:]]
    ),
    "other coordinates": lambda c: replace(c, T=matrix(c.T, 0, 0, c.T[0][0] / 20)),
    "singular coordinates": lambda c: replace(c, T=[[Fraction(1)] * 2] * 2),
    "another scale": lambda c: replace(c, scale=(c.scale[0] * Fraction(21, 20),)),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_found(name):
    claim = proof("box").claim
    assert prove(claim).proved
    assert not prove(FAULTS[name](claim)).proved


OF_POLYNOMIALS = {
    "another gain": lambda c: in_law(
        c, K=[*c.design.law.K[:-1], [[10 * v for v in row] for row in c.design.law.K[-1]]]
    ),
    "another power": lambda c: in_law(c, powers=((0, 1), (0, 0))),
    "other signals": lambda c: in_law(c, C=c.design.law.C[::-1]),
    "another A": FAULTS["another A"],
}


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("name", OF_POLYNOMIALS)
def test_a_fault_of_a_polynomial_law_is_found(name, delay):
    claim = proof("signals that vary", delay).claim
    assert prove(claim).proved
    assert not prove(OF_POLYNOMIALS[name](claim)).proved


REFUSED = {
    "delay": lambda c: replace(c, delay=2),
    "no delay": lambda c: replace(c, delay=0),
    "terms": lambda c: replace(c, terms=0),
    "many terms": lambda c: replace(c, terms=10**9),
    "decay": lambda c: replace(c, decay=Fraction(-1)),
    "radius of one": lambda c: replace(c, radius=Fraction(1), decay=Fraction(0)),
    "long samples": lambda c: replace(c, sample_time=Fraction(1000)),
    "no samples": lambda c: replace(c, sample_time=Fraction(0)),
    "shape": lambda c: replace(c, T=[[Fraction(1)]]),
    "steps": lambda c: replace(c, steps=c.steps[:-1]),
    "narrow steps": lambda c: replace(c, steps=tuple([row[:2] for row in s] for s in c.steps)),
    "scale": lambda c: replace(c, scale=(Fraction(0),)),
    "scales": lambda c: replace(c, scale=c.scale * 2),
    "mu": lambda c: replace(c, mu=Fraction(0)),
    "error": lambda c: replace(c, error=Fraction(0)),
    "weight": lambda c: replace(c, weight=Fraction(0)),
    "evidence": lambda c: in_evidence(c, X=c.evidence.X[1:]),
    "weights": lambda c: in_design(c, weights=(Fraction(1),) * 4),
    "parameters": lambda c: replace(c, ranges=c.ranges[1:]),
    "off": lambda c: replace(c, off=Off(Fraction(-1), (Fraction(1),), c.T)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_fit_is_refused(name):
    with pytest.raises(FormatError):
        prove(REFUSED[name](proof("box").claim))


WITHOUT = {
    "smallest": lambda c: replace(c, smallest=2 * c.smallest),
    "energy": lambda c: replace(c, energy=c.energy / 2),
    "none": lambda c: replace(c, smallest=Fraction(0)),
    "law": lambda c: in_law(c, Z=[[[2 * v for v in row] for row in z] for z in c.design.law.Z]),
}


@pytest.mark.parametrize("name", WITHOUT)
def test_a_fault_without_delay_is_found(name):
    claim = proof("box", 0).claim
    assert not prove(WITHOUT[name](claim)).proved
