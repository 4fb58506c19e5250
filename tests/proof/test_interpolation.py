"""Samples between nodes: how far the exponential is from its interpolation, against SciPy's."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, solve_discrete_lyapunov

from polefence import Disk, FixedGain, Rms, System, UncertainPlant, analyse, at_sample_time
from polefence.certify import interpolated
from polefence.certify.bounds import kept_bound
from polefence.certify.certificate import plant_of, with_nodes
from polefence.cli.check import _against
from polefence.plant.family import Parameter
from polefence.plant.larger import with_states
from polefence.plant.parts import node
from polefence.plant.samples import claim_of_samples
from polefence.proof.claims.base import prove
from polefence.proof.document import Document, check, from_plain
from polefence.proof.interpolation import ONE, bends, sample
from polefence.proof.plant import lattice
from polefence.proof.polynomials import bernstein
from polefence.proof.remainder import Remainder
from polefence.proof.work import FormatError
from polefence.response import samples
from support import truths
from support.every_file import quiet
from support.untrue import Run

WIDTH = 2  # columns of B and E
THIRDS = [Fraction(k, 3) for k in range(4)]


def rationals(M):
    return [[Fraction(x) for x in row] for row in M.tolist()]


def family(rng, n, count, size):
    """[A, B, E] T at the corners of a box, affine in each coordinate."""
    middle = rng.normal(size=(n, n + WIDTH))
    slopes = rng.normal(size=(count, n, n + WIDTH)) * rng.random(count)[:, None, None]
    corners = [middle + np.tensordot(t, slopes, 1) for t in product((-0.5, 0.5), repeat=count)]
    scale = size / max(np.abs(M).sum(axis=1).max() for M in corners)
    return np.array(corners) * scale


def between(corners, t):
    """The multi-affine combination of the corners of a box."""
    weights = np.ones(1)
    for x in t:
        weights = np.outer(weights, (1 - x, x)).ravel()
    return np.tensordot(weights, corners, 1)


def held(M):
    """The rows of exp M of the states."""
    n, width = M.shape
    return expm(np.vstack([M, np.zeros((width - n, width))]))[:n]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 3), st.floats(0.05, 3))
def test_no_sample_is_farther_off_than_its_bound(seed, n, count, size):
    rng = np.random.default_rng(seed)
    corners = family(rng, n, count, size)
    terms = 40
    found = bends([rationals(M) for M in corners], terms)
    along = np.array([[[float(x) for x in row] for row in C] for C in found.along])
    low = rng.random(count) * 0.9
    side = (1 - low) * rng.random(count)
    part = np.array([held(between(corners, low + side * t)) for t in product((0, 1), repeat=count)])
    allowed = np.tensordot(side**2, along, 1) / 8 + float(found.missing) + 1e-13
    for t in rng.random((20, count)):
        apart = held(between(corners, low + side * t)) - between(part, t)
        assert np.all(np.abs(apart) <= allowed)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 3), st.floats(0.05, 3))
def test_no_sample_is_farther_off_than_its_bound_with_nodes_in_the_middles(seed, n, count, size):
    """Against the parabolas of Lagrange, one axis after the other."""
    rng = np.random.default_rng(seed)
    corners = family(rng, n, count, size)
    terms = 40
    found = bends([rationals(M) for M in corners], terms)
    off = Fraction(1, 10**9)  # of the nodes themselves
    width = n + WIDTH
    zeros = ((Fraction(0),) * width,) * n
    remainder = Remainder.between(
        ((off + found.missing,) * width,) * n, [zeros] * count, [as_rows(D) for D in found.third]
    )
    low = rng.random(count) * 0.9
    high = low + (1 - low) * rng.random(count)
    ends = [tuple(map(Fraction, at)) for at in (low, high)]
    points = np.array(lattice(*ends, 2), dtype=float)
    known = np.array([held(between(corners, t)) for t in points])
    known += float(off) * rng.choice([-1, 1], size=known.shape)
    part = remainder.inside(*ends, [rationals(M) for M in known])
    assert part.degree == 2
    allowed = np.array(part.entries, dtype=float) + 1e-13
    plain = bernstein([rationals(known[k]) for k in _ends(count)], (2,) * count, 1)
    polynomial = part.curved(plain)
    for t in rng.random((20, count)):
        weights = np.ones(1)
        for x in t:
            parabolas = (2 * (x - 0.5) * (x - 1), 4 * x * (1 - x), 2 * x * (x - 0.5))
            weights = np.outer(weights, parabolas).ravel()
        interpolant = np.tensordot(weights, known, 1)
        ours = _value(polynomial, np.stack([1 - t, t], axis=1).ravel()).astype(float)
        assert np.allclose(ours, interpolant, rtol=0, atol=1e-12 * max(1, np.abs(known).max()))
        apart = held(between(corners, low + (high - low) * t)) - interpolant
        assert np.all(np.abs(apart) <= allowed)


def as_rows(M):
    return tuple(map(tuple, M))


def _ends(count):
    """Which of 3^count points are corners."""
    return [k for k, at in enumerate(product(range(3), repeat=count)) if 1 not in at]


def _value(P, coordinates):
    """A polynomial's value at coordinates of each simplex."""
    weights = {e: np.prod(np.power(coordinates, e)) for e in P.terms}
    return sum(weights[e] * (np.array(M, dtype=object) / P.whole) for e, M in P.terms.items())


def test_the_third_derivative_is_nearly_attained_where_nothing_is_lost_in_it():
    found = bends([[[Fraction(0)]], [[Fraction(1, 10)]]], 12)
    assert float(found.third[0][0][0]) == pytest.approx(0.001 * np.exp(0.1), rel=1e-12)


def test_the_bound_is_nearly_attained_where_nothing_is_lost_in_it():
    # x' = a x, 0 <= a T <= 0.1: e^aT bends by (0.1)^2 e^aT
    found = bends([[[Fraction(0)]], [[Fraction(1, 10)]]], 12)
    assert float(found.along[0][0][0]) == pytest.approx(0.01 * np.exp(0.1), rel=1e-12)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 5), st.floats(0.01, 8))
def test_a_sample_is_that_of_the_exponential(seed, n, size):
    (M,) = family(np.random.default_rng(seed), n, 0, size)
    terms = int(np.ceil(4 * size)) + 10
    found = np.array(sample(rationals(M), terms), dtype=object) / ONE
    missing = float(bends([rationals(M)], terms).missing)
    off = np.abs(found.astype(float) + np.eye(n, n + WIDTH) - held(M))
    assert off.max() <= missing + 1e-12 * np.exp(size)


@pytest.fixture(scope="module", params=[1, 2])
def sampled(request):
    """A family of three parameters with samples between nodes, and its continuous one.

    Parts have nodes at their corners alone, as in files of before, or in the middles too.
    """
    rng = np.random.default_rng(4)
    names = ("a", "b", "c")
    corners = family(rng, 4, 3, 4.0)
    A = corners[:, :, :4] - 3 * np.eye(4)
    vertices = tuple(
        System(M, one[:, 4:5], one[:, 5:], f"vertex {k + 1}")
        for k, (M, one) in enumerate(zip(A, corners, strict=True))
    )
    parameters = tuple(Parameter(name, 0, 1) for name in names)
    plant = UncertainPlant(vertices, parameters=parameters, name="three")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(samples, "_with_remainder", _refused)
        if request.param == 1:
            patch.setattr(samples, "MOST_IN_MIDDLES", 0)
        found = at_sample_time(plant, 0.05, 1)
    assert found.parts_degree == request.param
    return plant, found


def _refused(*_):
    raise FormatError("the series has too many terms")


def test_a_long_series_makes_way_for_nodes(sampled, monkeypatch):
    plant, _ = sampled
    assert not at_sample_time(plant, 0.005, 1).bent
    monkeypatch.setattr(samples, "LONG", 1e5)
    found = at_sample_time(plant, 0.005, 1)
    assert found.bent
    assert prove(claim_of_samples(found)).proved
    assert not at_sample_time(plant, 0.005, 1, degree=1).bent  # as it was asked for


def test_samples_between_nodes_are_proved_and_hold(sampled):
    plant, found = sampled
    assert found.bent
    assert prove(claim_of_samples(found)).proved
    remainder = np.array(found.remainder.entries, dtype=float)
    for t in np.random.default_rng(5).random((30, 3)):
        alpha = between(np.eye(8), t)
        A, B = plant.at(alpha)
        exact = held(np.hstack([A, B, plant.driven(alpha)]) * 0.05)
        A, B = found.at(alpha)
        off = np.abs(exact[:, :4] - A[:4, :4])
        assert np.all(off <= remainder[:4, :4] + 1e-15)


def test_a_loop_is_proved_in_parts_and_no_further_than_its_samples(sampled):
    _, found = sampled
    law = FixedGain(np.zeros((1, 5)))
    alpha = found.domain.nodes(6)
    radius = np.abs(np.linalg.eigvals(found.at(alpha)[0])).max()
    kept = analyse(found, law, Disk(0, radius * (1 + 1e-3)))
    assert kept.proved
    assert kept.certificate.in_parts
    assert not analyse(found, law, Disk(0, radius * (1 - 1e-3))).proved


@pytest.fixture(scope="module")
def kept(sampled):
    """The file of a region that is proved in parts."""
    _, found = sampled
    radius = np.abs(np.linalg.eigvals(found.at(found.domain.nodes(6))[0])).max()
    law = FixedGain(np.zeros((1, 5)))
    return analyse(found, law, Disk(0, radius * (1 + 1e-3))).certificate.file()


CHANGES = 25  # of a file with nodes
FAULTS = ["node", "vertex", "bend", "third", "rounding", "terms", "place"]


@pytest.mark.parametrize("fault", FAULTS)
def test_one_fault_in_samples_between_nodes_is_seen(kept, fault):
    claim = next(own for own in kept.claims if own.kind == "samples")
    assert claim.plant.nodes
    assert prove(claim).proved
    if fault != "third" or claim.plant.remainder.third:
        assert not _proved(_with_fault(claim, fault))


@pytest.mark.parametrize("fault", ["none", "gone", "moved", "degree", "bounds", "short", "corners"])
def test_one_fault_in_a_file_with_nodes_is_seen(kept, fault):
    table = json.loads(kept.dumps())
    bends, nodes = table["plant"]["bends"], table["plant"]["nodes"]
    if fault == "none":
        assert _checked(table)
        return
    if fault == "gone":
        del nodes[len(nodes) // 2]
    elif fault == "moved":
        nodes[0]["at"][0] = "1/7"
    elif fault == "degree":
        bends["degree"] = 3
    elif "third" not in bends:
        bends["degree"] = 2  # without the bounds that belong to it
    elif fault == "bounds":
        del bends["third"]
    elif fault == "short":
        del bends["third"][-1]
    else:  # a middle that is no sample of the plant
        middle = next(node for node in nodes if Fraction(1, 4) in map(Fraction, node["at"]))
        middle["A"][0][0] = 2
    assert not _checked(table)


def test_no_change_makes_a_false_claim_proved(kept):
    """A few of those that benchmarks/untrue.py tries with samples between nodes."""
    run = Run({"nodes": json.loads(kept.dumps())})
    counts = run.of("nodes", CHANGES)
    assert not run.faults, run.faults[0][0]
    assert counts["refused"]
    assert counts["accepted"]


def test_files_of_margins_and_of_code_have_the_nodes_of_their_design(sampled, tmp_path):
    """Each is proved by its file alone."""
    plant, K = sampled[1], np.array([[0.1, 0.0, -0.1, 0.0, 0.05]])
    A, B = plant.at(plant.domain.nodes(6))
    radius = np.abs(np.linalg.eigvals(A + B @ K)).max()
    kept = analyse(plant, FixedGain(K), Disk(0, radius * (1 + 1e-3)))
    (tmp_path / "design.json").write_text(kept.certificate.dumps())
    for words, made in (("export", "guarantee.json"), ("service", "gain.json")):
        assert quiet([words, str(tmp_path / "design.json"), "-o", str(tmp_path / words)])[0] == 0
        table = json.loads((tmp_path / words / made).read_text())
        assert table["plant"]["nodes"]
        assert _checked(table)


@pytest.mark.parametrize("letter", ["A", "B"])
def test_a_node_does_not_change_what_is_not_sampled(sampled, letter):
    """The state of a law moves at a node as it does at the vertices, or nothing is proved of it."""
    wide = with_states(sampled[1], 1)
    K = np.zeros(wide.shape[::-1])
    K[-1, -1] = -10.0
    radius = np.abs(np.linalg.eigvals(sampled[1].at(wide.domain.nodes(6))[0])).max()
    kept = analyse(wide, FixedGain(K), Disk(0, radius * (1 + 1e-3)))
    claim = next(own for own in kept.certificate.file().claims if own.kind == "samples")
    assert prove(claim).proved
    first, *rest = claim.plant.nodes
    M = [list(row) for row in getattr(first, letter)]
    M[-1][-1] += Fraction(1, 3)
    forged = replace(claim.plant, nodes=(replace(first, **{letter: M}), *rest))
    assert not prove(replace(claim, plant=forged)).proved


def test_a_law_with_states_has_inputs_two_samples_late(line):
    """The inputs on their way move on, whatever other inputs the law's states have."""
    wide = with_states(at_sample_time(line, 0.1, 2), 1)
    assert prove(claim_of_samples(wide)).proved


def test_a_weighted_signal_is_proved_in_parts_and_no_further_than_its_samples(sampled):
    """The filter stands behind the samples at a node too, as behind those at the vertices."""
    plant, law = sampled[1], FixedGain(np.zeros((1, 5)))
    claim = kept_bound(plant, law, Rms("x1", 0.031, density=2.0, weight="Wk")).claim
    assert claim.subject.nodes
    assert len(claim.subject.evidence.cells) > 2 - plant.parts_degree
    reached = max(_weighted(claim, node(plant, at)) for at in product(THIRDS, repeat=3))
    assert reached < float(claim.level) < 1.1 * reached
    assert not prove(replace(claim, level=Fraction(reached))).proved


def _weighted(claim, point):
    """The rms of a state behind the filter of a claim, at one point."""
    A, E = (np.array(M, dtype=float) for M in (point.A, point.E))
    C = np.eye(1, len(A))
    table, T = claim.write(), float(claim.subject.step)
    A, E, C, _ = truths.behind(table, (A, E, C, np.zeros((1, E.shape[1]))), T)
    P = solve_discrete_lyapunov(A, float(claim.intensity) / T * E @ E.T)
    return float(np.sqrt(C @ P @ C.T).item())


@pytest.fixture(scope="module")
def line():
    """x' = a x + 5 u + w, a from -1 to 1."""
    vertices = tuple(System([[a]], [[5]], [[1]], f"a = {a}") for a in (-1, 1))
    return UncertainPlant(vertices, parameters=(Parameter("a", -1, 1),), name="line")


@pytest.fixture(scope="module")
def line_file(line):
    """A file that says of which plant its samples are, with nodes at a third and two thirds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(samples, "_with_remainder", _refused)
        bent = at_sample_time(line, 0.1)
    claim = claim_of_samples(bent)
    plant = with_nodes(claim.plant, bent, [(Fraction(k, 3),) for k in (1, 2)])
    return Document(plant, None, (replace(claim, plant=plant),))


def test_an_observer_is_not_proved_with_the_nodes_of_the_plant(line_file):
    """x - L y of y = x: in the middle a pole is at -0.62, but with B in place of C' it is not."""
    table, one = line_file.write(), [[1]]
    ends, gains = ["0", "1/3", "2/3", "1"], [-1, -1, -1, -3, -1, -1, -1]
    spread = {"omega": [["1/100"]], "rows": ["1/30"], "columns": ["1/30", 0]}
    evidence = {"X": [one], "degree": 0, "elevation": 6, "remainder": spread}
    cells = [{"low": [a], "high": [b]} | evidence for a, b in pairwise(ends)]
    table["claims"].append(
        {
            "kind": "observer",
            "C": [one],
            "law": {"kind": "scheduled", "on": "box", "degree": 6}
            | {"W": [one] * 7, "Z": [[[z]] for z in gains]},
            "region": {"kind": "disk", "centre": 0, "radius": 0.5},
            "method": "lyapunov",
            "evidence": {"parts": [{"cells": cells}]},
        }
    )
    assert check(line_file).proved
    assert not _checked(table)


@pytest.mark.parametrize("count", [1, 2])
def test_bends_belong_to_parameters(line_file, count):
    table = line_file.write()
    table["plant"] |= {"parameters": [], "vertices": table["plant"]["vertices"][:count]}
    table["claims"][0]["vertices"] = table["claims"][0]["vertices"][:count]
    del table["plant"]["nodes"]
    assert not _checked(table)


def test_samples_between_nodes_are_not_those_of_a_plant_in_discrete_time(line_file):
    """Between its vertices that is their combination; a part's remainder is smaller than that."""
    plant = plant_of(line_file.plant)
    alone = replace(plant, remainder=None, sampling=None)
    assert _against(line_file, alone, "other.toml") == (
        "its plant is no function of the parameters that a spec says"
    )


def _checked(table):
    try:
        return check(from_plain(json.loads(json.dumps(table)))).proved
    except FormatError:
        return False


def _with_fault(claim, fault):
    plant, remainder = claim.plant, claim.plant.remainder
    if fault == "terms":
        return replace(claim, terms=3)
    if fault == "bend":
        C = [list(map(list, M)) for M in remainder.bends]
        C[1][2][1] /= 2
        bends = tuple(tuple(map(tuple, M)) for M in C)
        changed = Remainder.between(remainder.rounding, bends, remainder.third)
        return replace(claim, plant=replace(plant, remainder=changed))
    if fault == "third":
        D = [list(map(list, M)) for M in remainder.third]
        D[1][2][1] /= 2
        changed = replace(remainder, third=tuple(tuple(map(tuple, M)) for M in D))
        return replace(claim, plant=replace(plant, remainder=changed))
    if fault == "rounding":
        none = tuple(tuple(x / 2**30 for x in row) for row in remainder.rounding)
        changed = Remainder.between(none, remainder.bends, remainder.third)
        return replace(claim, plant=replace(plant, remainder=changed))
    if fault == "vertex":
        A = [list(map(list, M)) for M in plant.A]
        A[3][1][2] += Fraction(1, 2**40)
        return replace(claim, plant=replace(plant, A=A))
    first, *rest = plant.nodes
    if fault == "node":
        A = list(map(list, first.A))
        A[0][1] += Fraction(1, 2**40)
        return replace(claim, plant=replace(plant, nodes=(replace(first, A=A), *rest)))
    at = tuple(x / 2 if x else x + Fraction(1, 8) for x in first.at)
    return replace(claim, plant=replace(plant, nodes=(replace(first, at=at), *rest)))


def _proved(claim):
    try:
        return prove(claim).proved
    except FormatError:
        return False


def test_a_wider_part_is_proved_where_the_inequality_is_multiplied(sampled, monkeypatch):
    """Its coefficients of a higher degree say more: fewer parts, proved in exact arithmetic too."""
    _, found = sampled
    radius = np.abs(np.linalg.eigvals(found.at(found.domain.nodes(6))[0])).max()
    region, law = Disk(0, radius * (1 + 1e-4)), FixedGain(np.zeros((1, 5)))
    counts = []
    for elevations in ((0,), (0, 1, 2)):
        monkeypatch.setattr(interpolated, "ELEVATIONS", elevations)
        kept = analyse(found, law, region).certificate
        assert kept.prove().proved
        cells = kept.claim().evidence[0].cells
        assert {piece.evidence.elevation for piece in cells} <= set(elevations)
        counts.append(len(cells))
    assert counts[1] <= counts[0]
    if found.parts_degree == 2:
        assert counts[1] < counts[0]
