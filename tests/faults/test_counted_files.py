"""However many claims a file holds, they are proved under one count of the work."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from polefence import UncertainPlant
from polefence.base.errors import DesignFileError, InputError
from polefence.certify import counterexample
from polefence.certify.design import check
from polefence.proof import document as check_module
from polefence.proof import polynomials, work
from polefence.proof.claims import estimate
from polefence.proof.claims.base import prove
from polefence.proof.claims.cells import Axis, Interpolated
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.margins import Subject, form, unit_rows
from polefence.proof.claims.poles import Poles
from polefence.proof.document import from_plain
from polefence.proof.laws import Evidence, Law
from polefence.proof.matrices import mix, quotient
from polefence.proof.polynomials import bernstein
from polefence.proof.reading import MAX_ENTRIES, parse
from polefence.proof.regions import HalfPlane
from polefence.proof.work import FormatError
from polefence.search.limits import READING, sweep

PLANT = {
    "name": "one",
    "states": ["x"],
    "inputs": ["u"],
    "disturbances": ["w"],
    "parameters": [],
    "vertices": [{"A": [[-1]], "B": [[1]], "E": [[1]]}],
}
LAW = {"kind": "fixed", "K": [[0]]}
POLES = {
    "kind": "region",
    "region": {"kind": "half_plane", "decay": 0},
    "method": "quadratic",
    "evidence": {"W": [[1]]},
}
RMS = {"kind": "rms", "name": "", "output": {"C": [[1]]}, "level": 2, "evidence": {"X": [[[1]]]}}


def performance(count):
    head = {"format": "polefence-proof", "version": 2, "plant": PLANT, "law": LAW}
    return json.dumps(head | {"claims": [POLES, *[RMS] * count]})


def spent(path):
    with work.counted() as count:
        assert check(path).proved
    return count.spent


def test_claims_of_one_file_share_one_count(tmp_path, monkeypatch):
    path = tmp_path / "performance.json"
    path.write_text(performance(8))
    whole = spent(path)
    path.write_text(performance(1))
    assert whole > 3 * spent(path)
    path.write_text(performance(8))
    enough, little = limited(whole), limited(whole // 2)
    monkeypatch.setattr(check_module, "counted", little)
    with pytest.raises(DesignFileError, match="to be checked here"):
        check(path)
    monkeypatch.setattr(check_module, "counted", enough)
    assert check(path).proved


def limited(most):
    """The count of a file, which allows other work than it does."""
    own = work.counted
    return lambda *_: own(most)


def test_rows_of_a_sweep_that_nobody_asked_for_share_one_count(tmp_path, monkeypatch):
    plant = UncertainPlant.from_vertices([[[-1]]], [[[1]]])
    path = tmp_path / "rows.json"
    sweep(plant, [-3.0, -4.0, -5.0], ["quadratic"], path)
    asked = [-3.0, -4.0, -5.0]
    with work.counted() as count:
        sweep(plant, asked, ["quadratic"], path, resume=True)
    monkeypatch.setattr(work, "counted", limited(count.spent // 2))
    assert len(sweep(plant, asked, ["quadratic"], path, resume=True)) == 3
    with pytest.raises(InputError, match="to be checked here"):
        sweep(plant, [-9.0], ["quadratic"], path, resume=True)


def test_the_plant_is_counted_for_each_row_that_is_read(tmp_path, monkeypatch):
    plant = UncertainPlant.from_vertices([[[-1]]], [[[1]]])
    path, spent = tmp_path / "rows.json", []
    sweep(plant, [-3.0, -4.0], ["quadratic"], path)
    for reading in (0, READING):
        monkeypatch.setattr("polefence.search.limits.READING", reading)
        with work.counted() as count:
            sweep(plant, [-3.0, -4.0], ["quadratic"], path, resume=True)
        spent.append(count.spent)
    assert spent[1] - spent[0] == 2 * READING * 2 * work.cost(0)


def test_mixing_is_the_sum_and_is_counted():
    source = np.random.default_rng(2)
    weights = [Fraction(x) for x in source.normal(size=5).tolist()] + [Fraction(0), Fraction(1, 3)]
    matrices = [[[Fraction(x, 7) for x in (k, 1, -k)]] for k in range(7)]
    wanted = [[sum(w * M[0][j] for w, M in zip(weights, matrices, strict=True)) for j in range(3)]]
    with work.counted() as count:
        assert mix(weights, matrices) == wanted
    with work.counted(count.spent - 1), pytest.raises(FormatError, match="to be checked"):
        mix(weights, matrices)


def test_points_of_cells_are_counted():
    axis = Axis("p", Fraction(0), Fraction(1), False, (Fraction(0), Fraction(1)))
    A, B, K = [[[Fraction(-1)]]] * 4, [[[Fraction(1)]]] * 4, [[[Fraction(0)]]] * 4
    table = Interpolated(A, B, (axis, axis), K)
    short, long = Fraction(1, 3), Fraction(1, 3**500)
    with work.counted() as few:
        table.loop((short, short))
    with work.counted() as many:
        table.loop((long, long))
    assert many.spent > 2 * few.spent > 0


def test_many_entries_are_refused_before_they_are_rationals():
    with pytest.raises(FormatError, match="entries of lists"):
        parse("[" + "0," * MAX_ENTRIES + "0,0]")


@pytest.mark.parametrize(("size", "degree"), [(1, 3), (2, 4), (4, 3), (7, 2)])
def test_monomials_come_in_the_file_s_order(size, degree):
    found = polynomials.monomials((size,), degree)
    assert len(set(found)) == len(found) == polynomials.count_of((size,), degree)
    assert all(sum(e) == degree for e in found)

    def rank(e):
        order = sorted((j for j in range(size) if e[j]), key=lambda j: (-e[j], j))
        return len(order), [-e[j] for j in order], order

    assert found == sorted(found, key=rank)


def test_exponents_of_many_vertices_are_counted():
    """65,536 sums of 256 exponents each take longer than their products of numbers."""
    P = bernstein([[[Fraction(1)], [Fraction(1)]]] * 64, (64,), 1)
    with work.counted() as count:
        P.T * P
    assert count.spent > 64**2 * 64 // polynomials.COORDINATES * work.CALL


def test_evidence_that_overflows_is_no_warning(recwarn):
    tiny = Fraction(1e-320)
    loop = quotient([[Fraction(0), tiny], [Fraction(2), Fraction(1)]])
    list(counterexample.evidence(loop, (HalfPlane(Fraction(0)),)))
    assert not recwarn.list


def mislaid(N, degree, elevation=0):
    """A claim that weights are mislaid, of a plant of one state with N vertices."""
    A, B = [[[Fraction(-2)]]] * N, [[[Fraction(1)]]] * N
    region, one, none = (HalfPlane(Fraction(1)),), [[Fraction(1)]], [[Fraction(0)]]
    if degree:
        law = Law(None, [one] * N, [none] * N, degree)
        design = Poles("scheduled", A, B, region, law, (Evidence([]),))
    else:
        law = Law([none])
        design = Poles("quadratic", A, B, region, law, (Evidence([one]),))
    return Estimate(Subject(design, (), (), elevation), (Fraction(1, 8),))


@pytest.mark.parametrize(("N", "degree", "most"), [(32, 0, 3 * 32), (6, 1, 2 * 6 + 6 * (2 * 6))])
def test_coordinates_of_mislaid_weights_are_few(monkeypatch, N, degree, most):
    """N^3 of 2 N numbers each were a gigabyte for 256 vertices."""
    held = []

    class Recorded(estimate.Cell):
        def __init__(self, *given):
            super().__init__(*given)
            held.append(sum(len(form.terms) for form in (*self.plant, *self.law)))

    monkeypatch.setattr(estimate, "Cell", Recorded)
    assert prove(mislaid(N, degree)).proved
    assert len(held) == N
    assert max(held) <= most


def test_composing_with_long_exponents_is_counted():
    """The exponents of N vertices count as they do in a product."""
    N = 32
    forms = [form(0, row, (N,)) for row in unit_rows(N)]
    P = bernstein([[[Fraction(1)]]] * N, (N,), 1)
    sums = [sum(forms[1:], forms[0])] * N
    with work.counted() as count:
        P.composed(sums, (N,))
    products = N * N * N // polynomials.COORDINATES * work.CALL
    assert count.spent > 2 * products  # what is multiplied, and what is added up


def test_a_baseline_is_counted_as_it_is_read():
    """A + B K of another loop is formed for every vertex, before anything is proved."""
    proof = {"X": [[[1]]]}
    baseline = {"K": [[0]], "stability": proof, "covariance": {"P": [[[1]]]}}
    relative = RMS | {"kind": "relative rms", "baseline": baseline}
    head = {"format": "polefence-proof", "version": 2, "law": LAW, "claims": [relative]}
    spent = []
    for count in (1, 50):
        plant = PLANT | {"vertices": PLANT["vertices"] * count}
        with work.counted() as own:
            from_plain(head | {"plant": plant})
        spent.append(own.spent)
    assert spent[1] - spent[0] > 49 * work.RATIONAL * work.CALL
    with work.counted(spent[1] - 1), pytest.raises(FormatError, match="to be checked here"):
        from_plain(head | {"plant": PLANT | {"vertices": PLANT["vertices"] * 50}})
