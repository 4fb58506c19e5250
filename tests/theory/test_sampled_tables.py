"""Samples of plants with tables: knots inside the range, against exponentials in floats."""

import json
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from scipy.linalg import expm

import polefence as pf
from polefence.certify.evaluation import rounding_share
from polefence.plant.parts import inside
from polefence.plant.samples import claim_of_samples
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.document import check as check_file
from polefence.proof.document import from_plain
from polefence.proof.remainder import Kinks, Remainder
from polefence.proof.work import FormatError
from polefence.region.regions import Disk
from polefence.response.samples import at_sample_time

T = 0.05
SPEC = """
disturbances = ["w"]
[parameter.m]
range = [2, 5]
through = "1/m"
[parameter.q]
range = [0, 1]
[table.spring]
arguments = {knots}
values = {values}
interpolation = "{kind}"
[matrices]
A = [[0, 1], ["-spring(m)/m", "-(1 + q)/m"]]
B = [[0], ["1/m"]]
E = [[0], ["1/m"]]
[outputs]
force = {{C = ["spring(m)", 0]}}
"""


def family(seed, kind):
    random = np.random.default_rng(seed)
    knots = [2, *np.sort(random.uniform(2.2, 4.8, 2)).round(2).tolist(), 5]
    values = random.uniform(5, 40, 4).round(1).tolist()
    return loads(SPEC.format(knots=knots, values=values, kind=kind)), knots, values


def exact(plant, t):
    """[F, G, H] at shares of the box, from the plant in floats."""
    at = [Fraction(x) for x in t]
    A, B = plant.at(weights(at))
    rates = np.vstack([np.hstack([A, B, plant.driven(weights(at))]), np.zeros((2, 4))])
    return expm(rates * T)[:2]


def weights(t):
    return np.array([float(np.prod(own)) for own in product(*((1 - x, x) for x in t))])


@pytest.mark.parametrize("kind", ["linear", "cubic"])
@pytest.mark.parametrize("seed", range(4))
def test_samples_in_parts_are_within_their_remainder(seed, kind):
    plant, knots, values = family(seed, kind)
    found, random = at_sample_time(plant, T), np.random.default_rng(seed)
    assert prove(claim_of_samples(found)).proved
    largest = 0.0
    for _ in range(30):
        low = [Fraction(int(x), 64) for x in random.integers(0, 60, 2)]
        side = Fraction(1, 2 ** int(random.integers(0, 5)))
        high = [min(x + side, Fraction(1)) for x in low]
        part = inside(found, tuple(low), tuple(high))
        allowed = np.array(part.remainder.entries, dtype=float)
        for t in random.random((20, 2)):
            own = exact(plant, np.array(low, float) + np.subtract(high, low).astype(float) * t)
            A, B = part.at(weights(t))
            off = np.abs(own - np.hstack([A, B, part.driven(weights(t))]))
            assert np.all(off <= allowed * (1 + 1e-6) + 1e-13)
            largest = max(largest, float((off[1, 0] - 1e-13) / allowed[1, 0]))
    assert largest > 0.02  # some of it is needed
    if kind == "linear":  # and the plant in floats is that of the table
        alpha = plant.alpha(m=3.3, q=0.4)
        np.testing.assert_allclose(
            plant.at(alpha)[0][1, 0], -np.interp(3.3, knots, values) / 3.3, rtol=1e-12
        )


def test_a_part_between_knots_goes_by_middles_and_one_with_a_knot_by_corners():
    plant = loads(SPEC.format(knots=[2, 3, 5], values=[5, 20, 21], kind="linear"))
    found = at_sample_time(plant, T)
    knot = Fraction(1, 2) - Fraction(1, 3), Fraction(1, 2) - Fraction(1, 5)
    place = knot[0] / knot[1]  # of m = 3 along 1/m from 1/2 to 1/5
    near = (place - Fraction(1, 100), Fraction(0)), (place + Fraction(1, 100), Fraction(1, 50))
    beside = (place, Fraction(0)), (place + Fraction(1, 50), Fraction(1, 50))
    across, between = (inside(found, *ends).remainder for ends in (near, beside))
    assert between.middles
    assert not across.middles
    assert across.entries[1][0] > 100 * between.entries[1][0]


def test_without_the_kink_the_bound_would_be_false():
    plant = loads(SPEC.format(knots=[2, 3, 5], values=[5, 40, 12], kind="linear"))
    found = at_sample_time(plant, T)
    bends = [np.array(M, dtype=float) for M in found.remainder.bends]
    low, high = (Fraction(35, 64), Fraction(0)), (Fraction(37, 64), Fraction(1, 32))
    place = (Fraction(1, 2) - Fraction(1, 3)) / (Fraction(1, 2) - Fraction(1, 5))
    assert low[0] < place < high[0]
    part, t = inside(found, low, high), (place - low[0]) / (high[0] - low[0])
    own = exact(plant, [float(place), 0.0])
    off = np.abs(own[:, :2] - part.at(weights([float(t), 0.0]))[0])
    assert off[1, 0] > sum(M[1, 0] for M in bends) / 32**2 / 8
    assert off[1, 0] < float(part.remainder.entries[1][0])


FAULTS = ["sizes", "gone", "other", "none"]


@pytest.mark.parametrize("fault", FAULTS)
def test_one_fault_in_kinks_is_seen(fault):
    plant = loads(SPEC.format(knots=[2, 3, 5], values=[5, 20, 21], kind="linear"))
    claim = claim_of_samples(at_sample_time(plant, T))
    remainder = claim.plant.remainder
    kinks = remainder.kinks
    if fault == "sizes":  # of spring(m)/m, one entry a little smaller
        k = max(range(2), key=lambda k: sum(map(sum, kinks.sizes[k])))
        M = [list(row) for row in kinks.sizes[k]]
        M[1][0] *= Fraction(98, 100)
        sizes = tuple(tuple(map(tuple, M)) if j == k else N for j, N in enumerate(kinks.sizes))
        kinks = replace(kinks, sizes=sizes)
    elif fault == "gone":
        kinks = None
    elif fault == "other":  # a table that is nearly straight
        (name, table), *_ = kinks.functions.tables
        values = (Fraction(5), Fraction(52, 5), Fraction(21))
        other = replace(kinks.functions, tables=((name, replace(table, values=values)),))
        kinks = Kinks(other, kinks.sizes)
    changed = Remainder.between(remainder.rounding, remainder.bends, remainder.third, kinks)
    claim = replace(claim, plant=replace(claim.plant, remainder=changed))
    assert prove(claim).proved == (fault == "none")


def test_kinks_where_no_knot_is_change_nothing():
    plant = loads(SPEC.format(knots=[2, 5], values=[5, 21], kind="linear"))
    claim = claim_of_samples(at_sample_time(plant, T))
    remainder, known = claim.plant.remainder, claim.source.functions
    assert remainder.kinks is None
    none = tuple((Fraction(0),) * 4 for _ in range(2))
    more = Remainder.between(
        remainder.rounding, remainder.bends, remainder.third, Kinks(known, (none,) * 2)
    )
    assert more.entries == remainder.entries
    assert prove(replace(claim, plant=replace(claim.plant, remainder=more))).proved


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_poles_and_bounds_are_proved_up_to_the_worst_and_files_say_so(kind):
    """The loop is slowest at the knot, where the spring is softest."""
    plant = loads(SPEC.format(knots=[2, 3, 5], values=[20, 8, 21], kind=kind))
    found = at_sample_time(plant, T)
    K = [[0.0, 0.0]]
    radius = max(
        np.abs(np.linalg.eigvals(exact(plant, t)[:, :2])).max()
        for t in [*np.random.default_rng(1).random((400, 2)), (5 / 9, 0.0), (1.0, 0.0)]
    )
    assert not pf.analyse(found, K, Disk(0, radius * (1 - 1e-4))).proved
    kept = pf.analyse(found, K, Disk(0, radius * (1 + 1e-3)))
    assert kept.proved
    assert rounding_share(kept.certificate) < 1e-3  # of the loops that there are in its parts
    table = json.loads(kept.certificate.file().dumps())
    assert check_file(from_plain(table)).proved
    functions, sizes = table["plant"]["functions"]["functions"], table["plant"]["bends"]["kinks"]
    assert len(functions) == len(sizes) == 2
    assert [] in [own["entries"] for own in functions]  # the samples are of it, no entry is
    for change in (_without, _short, _negative):
        again = json.loads(json.dumps(table))
        change(again["plant"])
        with pytest.raises(FormatError):
            check_file(from_plain(again))


def _without(plant):
    del plant["functions"]
    plant["outputs"] = []


def _short(plant):
    plant["bends"]["kinks"] = plant["bends"]["kinks"][:1]


def _negative(plant):
    plant["bends"]["kinks"][0][1][0] = "-1"


@pytest.mark.parametrize(("low", "high"), [(280, 620), (0.3, 0.7), (0.1428571, 0.9)])
def test_a_table_may_end_where_the_range_of_an_inverted_parameter_does(low, high):
    text = SPEC.format(knots=[low, high], values=[5, 6], kind="linear")
    text = text.replace("range = [2, 5]", f"range = [{low}, {high}]")
    plant = loads(text)
    assert plant.at(plant.alpha(m=low, q=0))[0][1, 0] == pytest.approx(-5 / low)
