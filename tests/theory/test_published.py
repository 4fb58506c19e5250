"""Published examples: what others report of a plant, and what is proved here."""

from fractions import Fraction

import numpy as np
import pytest

from polefence import Disk, FixedGain, Gain, HalfPlane, UncertainPlant
from polefence.certify.bounds import best_bound, kept_bound
from polefence.certify.evidence import evidence_at
from polefence.certify.given import analyse
from polefence.plant.parameters import Parameter
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove

NO_LAW = FixedGain(np.zeros((1, 2)))
NOTHING = [[0], [Fraction(1, 1000)]]  # an input that no law uses


def oscillator(size, rate):
    """x' = (A + d B C) x, |d| <= size, G(s) = 0.8 / (s^2 + 0.21 s + 1) with d about it."""

    def matrices(d):
        A = [["-0.21", "-1"], [1, 0]]
        A = [[Fraction(x) for x in row] for row in A]
        A[0][1] = A[0][1] + Fraction("0.8") * d
        return A, NOTHING, [[Fraction("0.8")], [0]], {"w": {"C": [0, d]}}

    rate = rate if rate == "any" else (-Fraction(rate), Fraction(rate))
    own = Parameter("d", -Fraction(size), Fraction(size), rate=rate)
    return UncertainPlant.from_function(matrices, [own], disturbances=("f",))


@pytest.mark.parametrize(
    ("size", "rate"),
    [
        ("0.26", "any"),
        ("1", "0.1545"),  # published; and beyond
        ("1", "0.28"),
        ("0.311", "1"),
        ("0.4", "1"),
    ],
)
def test_the_slow_oscillator_of_iqc_beta(size, rate):
    """Megretski, Kao, Jonsson & Rantzer, IQCbeta: 0.26 at any rate, 0.1545 of d <= 1, 0.311."""
    assert analyse(oscillator(size, rate), NO_LAW, HalfPlane(0)).proved


@pytest.mark.parametrize(("size", "rate"), [("0.262", "any"), ("1", "0.46")])
def test_and_no_farther_than_it_is_stable(size, rate):
    """One Lyapunov matrix ends at 0.261; at d' of 0.46 it is unstable."""
    assert not analyse(oscillator(size, rate), NO_LAW, HalfPlane(0)).proved


def test_its_gain():
    """From f to w = d v, published as 25.7744 for |d| <= 1, |d'| <= 0.1."""
    bound = best_bound(oscillator(1, "0.1"), NO_LAW, Gain("w"))
    assert bound.level < 12.4


@pytest.mark.parametrize(
    ("rate", "least"), [("any", 1.0024), (Fraction("0.2"), 0.2), (Fraction("0.1"), 0.11)]
)
def test_the_commutator_of_lpvtools(rate, least):
    """d G - G d, G = 1 / (s + 1), |d| <= 1: 1.0024 at any rate, about 20 % at 0.2 (its manual)."""

    def matrices(d):
        return [[-1, 0], [0, -1]], NOTHING, [[1], [d]], {"e": {"C": [d, -1]}}

    own = Parameter("d", -1, 1, rate=rate if rate == "any" else (-rate, rate))
    plant = UncertainPlant.from_function(matrices, [own], disturbances=("w",))
    assert best_bound(plant, NO_LAW, Gain("e")).level < least


PI_LOOP = """
inputs = ["u"]
disturbances = ["d"]
[constants]
b = 0.25
[parameter.rho]
range = [2, 7]
rate = [-0.1, 0.1]
[parameter.Delta]
range = [-0.1, 0.1]
[definitions]
a = "1/48"
tau = "sqrt(133.6 - 16.8*rho)"
K = "sqrt(4.8*rho - 8.6)"
Kp = "(0.35*tau - 1)/K"
[matrices]
A = [["(-1 - (1 + Delta)*(0.35*tau - 1))/tau", "(1 + Delta)/tau", 0, "-2*(1 + Delta)*b/tau"],
     ["-0.0625*tau", 0, 0, 0],
     [0, 0, 0, 1],
     ["-(0.35*tau - 1)/a", "1/a", "-1/a", "-b/a"]]
B = [[0], [1], [0], [0]]
E = [["(1 + Delta)*(0.35 - 1/tau)/K"], ["0.0625*tau/K"], [0], ["Kp/a"]]
[outputs]
error = {C = ["-K", 0, 0, 0], F = [1]}
"""


@pytest.mark.parametrize(
    ("rate", "most"),
    [("[-0.1, 0.1]", 1.8925), ('"any"', 23.0)],
)
def test_the_loop_of_tan_hang_and_chai(rate, most):
    """Pfifer & Seiler (2014), at six points: 1.8925 at a rate of 0.1; at any 20.1476 to 63.8659."""
    plant = loads(PI_LOOP.replace("[-0.1, 0.1]\n[parameter.Delta]", f"{rate}\n[parameter.Delta]"))
    bound = kept_bound(plant, FixedGain(np.zeros((1, 4))), Gain("error", at_most=most))
    assert bound is not None
    assert prove(bound.claim).proved


TURNING = """
inputs = ["v1", "v2"]
disturbances = ["w1", "w2"]
[parameter.omega]
range = [-10, 10]
rate = [-20, 20]
[matrices]
A = [[0.75, 2, 1, 0, 0, 0], [0, 0.5, 0, 1, 0, 0],
     [0, 0, -10, "omega", 0, 0], [0, 0, "-omega", -10, 0, 0],
     [0, 0, 0, 0, -0.2, 0], [0, 0, 0, 0, 0, -0.2]]
B = [[0, 0], [0, 0], [10, 0], [0, 10], [0, 0], [0, 0]]
E = [[0, 0], [0, 0], [0, 0], [0, 0], [4, 0], [0, 4]]
[outputs]
e1 = {C = [1, 0, 0, 0, -5, 0]}
e2 = {C = [0, 1, 0, 0, 0, -5]}
u1 = {C = [0, 0, 0, 0, 0, 0], D = ["1/280", 0]}
u2 = {C = [0, 0, 0, 0, 0, 0], D = [0, "1/280"]}
"""


def test_the_turning_actuator_of_wu_yang_packard_and_becker():
    """Their example of 1996 in axes that turn with it, omega for dtheta/dt: u = R(theta)'K e."""
    plant = loads(TURNING)
    errors = [[1, 0, 0, 0, -5, 0], [0, 1, 0, 0, 0, -5]]
    law = FixedGain(np.array([[-179.8, -21.1], [-22.5, -101.5]]) @ errors)
    bound = best_bound(plant, law, Gain(("e1", "e2", "u1", "u2")))
    assert bound.level < 3.01
    assert kept_bound(plant, law, Gain(("e1", "e2", "u1", "u2"), at_most=2.8)) is None


# --- discrete time -------------------------------------------------------------------------------

ROWS = (["0.8", "-0.25", "0", "1"], ["1", "0", "0", "0"], ["0", "0", "0.2", "0.03"],
        ["0", "0", "1", "0"])  # fmt: skip


def uncertain(size):
    """A0 + a b c, |a| <= size, of de Oliveira, Bernussou & Geromel (1999)."""
    vertices = []
    for sign in (-1, 1):
        A = [[Fraction(x) for x in row] for row in ROWS]
        c = [Fraction("0.8"), Fraction("-0.5"), 0, 1]
        A[2] = [x + sign * Fraction(size) * y for x, y in zip(A[2], c, strict=True)]
        vertices.append(A)
    B = [[0], [0], [Fraction(1, 1000)], [0]]
    return UncertainPlant.from_vertices(vertices, [B, B], sample_time=1)


def test_de_oliveiras_stability_test():
    """One matrix reaches 0.4279, theirs 0.4619 (their example)."""
    none, unit = FixedGain(np.zeros((1, 4))), Disk(0, 1)
    quadratic, affine = (0, 0), (1, 0)
    assert evidence_at(uncertain("0.4278"), none, unit, quadratic) is not None
    assert evidence_at(uncertain("0.4280"), none, unit, quadratic) is None
    assert evidence_at(uncertain("0.4619"), none, unit, affine) is not None
    assert analyse(uncertain("0.4620"), none, unit).answer == "refuted"


def test_two_matrices_of_rolmips_manual():
    """Stable by an affine Lyapunov matrix (section 7.1), and not by one."""
    As = [[["0.1", "0.9"], ["0", "0.1"]], [["0.5", "0"], ["1", "0.5"]]]
    As = [[[Fraction(x) for x in row] for row in A] for A in As]
    plant = UncertainPlant.from_vertices(As, [NOTHING, NOTHING], sample_time=1)
    assert evidence_at(plant, NO_LAW, Disk(0, 1), (1, 0)) is not None
    assert analyse(plant, NO_LAW, Disk(0, 1)).proved
