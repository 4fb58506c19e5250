"""Dampers of one bent curve each: the passive damper of a comparison, its bound and its drives."""

import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from polefence import InputError, Rms, semi_active
from polefence.examples import spec_text
from polefence.plant.dampers import Damper
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.dampers import Curve
from polefence.proof.document import check
from polefence.proof.document import loads as read
from polefence.proof.sectors import regions_of
from polefence.proof.work import FormatError
from polefence.vehicle import velocity_density
from polefence.vehicle.concepts import _Task
from polefence.vehicle.suspensions import suspensions

DENSITY = velocity_density("C", 20)
LOW = [[-1, -350], [-0.1, -50], [0, 0], [0.1, 80], [1, 600]]
HIGH = [[-1, -1800], [-0.1, -600], [0, 0], [0.1, 900], [1, 3000]]
BENT = [[-1, -700], [0, 0], [1, 900]]
NAMES = ("damper force", "suspension deflection")
MEASURED = ("front suspension deflection", "rear suspension deflection")


@pytest.fixture(scope="module")
def task():
    """A half car with measured dampers on both axles, its load uncertain."""
    text = re.sub(r"\ndamper = .*", "\ndamper = 0", spec_text("half-car"))
    text = re.sub(r"\[parameter.age\].*\nrange.*\n", "", text).replace("*(1 + age)", "")
    plant = loads(text)
    ends = ("front", "rear")
    dampers = tuple(Damper(f"{k} force", f"{k} suspension deflection", LOW, HIGH) for k in ends)
    asked = Rms("driver acceleration", 1.0, DENSITY)
    return _Task(plant, asked, dampers, suspensions(plant), MEASURED)


def test_the_passive_row_has_the_dampers_own_curves(task):
    one = task.passive()
    v = np.linspace(-2, 2, 41)
    for damper, own, c in zip(one.dampers, task.dampers, task.others.coefficients, strict=True):
        (low, high), (same, other) = own.curves, damper.curves
        assert same == other
        least, most = float(low.ratios[0]), float(high.ratios[1])
        share = (c - least) / (most - least)
        for rate in map(Fraction, v):
            wanted = (1 - share) * float(low.at(rate)) + share * float(high.at(rate))
            assert float(same.at(rate)) == pytest.approx(wanted, abs=1e-3 * (1 + abs(wanted)))
    ridden = task.driven(one)
    # a Gaussian motion with the nearest line has as much, but for a percent or two
    assert ridden.cost == pytest.approx(task.others.passive, rel=0.03)
    assert ridden.cost < one.level
    assert ridden.power == 0


def test_one_curve_is_a_damper_only_where_it_is_bent():
    with pytest.raises(InputError, match="low below high"):
        Damper(*NAMES, 900, 900)
    assert Damper(*NAMES, BENT, BENT).low == Damper(*NAMES, BENT, BENT).high


@pytest.mark.parametrize("degree", [2, 4])
def test_one_curve_is_proved_whatever_is_demanded(degree):
    """Bends at zero alone: two pieces for a pair of vertices, and the rms of a line nearby."""
    plant = loads(spec_text("semi-active"))
    asked = Rms(["sprung-mass acceleration", "tyre share"], 1.0, DENSITY)
    damper = Damper(*NAMES, BENT, BENT)
    law = semi_active(plant, asked, [damper], degree, K=[[0.0, 0, -800, 800]])
    claim = law.claim
    assert check(read(law.file().dumps())).proved
    assert len(claim.pieces) == (0 if degree == 2 else 6)
    assert [len(region.lines) for region in regions_of(claim.dampers[0])] == [2, 2]
    rms = []
    for A, B, E in zip(plant.A, plant.B, np.array(claim.E, float), strict=True):
        loop = A + B * 800 @ [[0, 0, -1, 1]]
        X = solve_continuous_lyapunov(loop, -E @ E.T * DENSITY / 2)
        rms.append(np.sqrt(loop[2] @ X @ loop[2] + 1e4 * X[1, 1]))
    assert max(rms) < law.level < 1.1 * max(rms)
    if degree == 4:  # the forms of degree 2 know the demand, the pieces do not
        assert prove(replace(claim, K=[[-x for x in row] for row in claim.K])).proved
    low = claim.limit.level * Fraction("0.99")
    assert not prove(replace(claim, limit=replace(claim.limit, level=low))).proved
    wider = Curve(tuple((v, F * 2) for v, F in claim.dampers[0].high.points))
    other = replace(claim, dampers=(replace(claim.dampers[0], high=wider),))
    with pytest.raises(FormatError, match="pieces must be|a share for each pair"):
        prove(other)
