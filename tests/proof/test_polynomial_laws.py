"""Polynomial laws of files: their values, what they measure, and claims that refuse them."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from polefence import Parameter, UncertainPlant
from polefence.law.laws import PolynomialGain
from polefence.plant.exact import file_plant
from polefence.proof.claims import prove
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.margins import Subject
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.rate import Rate
from polefence.proof.document import check, loads
from polefence.proof.laws import Evidence, read_law
from polefence.proof.ranges import Range
from polefence.proof.reading import Table
from polefence.proof.regions import HalfPlane as ExactHalfPlane
from polefence.proof.work import FormatError
from support.duals import Case, rationals
from support.truths import false

ZERO, ONE = Fraction(0), Fraction(1)


def plant_of(varying=True):
    parameters = [Parameter("m", 1, 2, "kg", "1/m"), Parameter("k", 1, 9, "N/m")]
    rows = [["1", "0"], ["-k/m", "1"]] if varying else [["1", "0"], ["2", "1"]]
    outputs = {name: {"C": row} for name, row in zip(("force", "sum"), rows, strict=True)}
    return UncertainPlant.from_expressions(
        parameters, [["0", "1"], ["-k/m", "-1/m"]], [["0"], ["1/m"]], outputs=outputs
    )


def law_of(plant, measured, seed=0):
    random, powers = np.random.default_rng(seed), ((0, 0), (2, 0), (1, 1), (0, 3))
    outputs = tuple(plant.signal(name) for name in measured)
    gains = random.normal(size=(len(powers), 1, len(outputs) or 2))
    return PolynomialGain(powers, gains, outputs, plant.parameters)


@pytest.mark.parametrize("measured", [(), ("x2",), ("force",), ("sum", "x1")])
def test_the_file_s_law_is_python_s(measured):
    """As a form of coordinates, at exact points, once written and read, and by physical values."""
    plant = plant_of()
    law = law_of(plant, measured)
    exact, random = law.exact, np.random.default_rng(1)
    own = file_plant(plant)
    read, on = read_law(Table.of(json.loads(json.dumps(exact.write("box")))), own)
    assert (read, on) == (exact, "box")
    form = exact.form((2, 2))
    for m, k in random.uniform((1, 1), (2, 9), size=(6, 2)):
        t = ((1 / m - 1) / (1 / 2 - 1), (k - 1) / 8)
        at = [Fraction(float(w)) for x in t for w in (1 - x, x)]
        alpha = [a * b for a in at[:2] for b in at[2:]]
        K = law.gain_at(m=m, k=k)
        c = (2 * t[0] - 1, 2 * t[1] - 1)
        C = np.tensordot(np.array(alpha, dtype=float), law.C, 1) if len(law.C) > 1 else law.C[0]
        terms = zip(law.powers, law.gains, strict=True)
        expected = sum(c[0] ** e[0] * c[1] ** e[1] * g for e, g in terms) @ C
        np.testing.assert_allclose(K, expected, rtol=1e-9, atol=1e-12)
        found = np.array(read.gain(alpha, at), dtype=float)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
        powers = ((np.power(np.array(at, dtype=float), e), M) for e, M in form.terms.items())
        whole = sum(np.prod(x) * np.array(M, dtype=float) for x, M in powers) / form.whole
        np.testing.assert_allclose(whole[2:], expected, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(whole[:2], np.eye(2), atol=1e-12)


def document():
    case = Case("rms", ("measured", 2))
    return json.loads(case.document(case.worst * 1.1).dumps())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda law: law["terms"][0].update(powers=[0, -1]), "whole numbers"),
        (lambda law: law["terms"][0].update(powers=[0, 17]), "whole numbers"),
        (lambda law: law["terms"][0].update(powers=[16, 1]), "degree must be"),
        (lambda law: law["terms"][0].update(powers=[True, 0]), "whole numbers"),
        (lambda law: law["terms"][0].update(powers=[]), "1 to"),
        (lambda law: law["terms"][0].update(powers=[0]), "as many|one per parameter"),
        (lambda law: law["terms"][0].update(powers=[1, 0]), "belongs to one gain"),
        (lambda law: law["terms"].clear(), "1 to"),
        (lambda law: law["terms"][0].update(K=[[1, 2]]), "1 x 1"),
        (lambda law: law["terms"][0].update(L=1), "unknown key"),
        (lambda law: law.update(measured=["a", "a"]), "twice"),
        (lambda law: law.update(measured=["b"]), "is not a state or output"),
        (lambda law: law.update(measured=["u1"]), "is not a state or output"),
        (lambda law: law.update(measured="a"), "list"),
        (lambda law: law.update(on="simplex"), "evidence.Q holds"),
        (lambda law: law.pop("on"), "on is missing"),
        (lambda law: law.update(kind="fixed"), "K is missing"),
    ],
)
def test_a_fault_in_a_law_is_named(change, words):
    table = document()
    assert check(loads(json.dumps(table))).proved
    change(table["law"])
    with pytest.raises(FormatError, match=words):
        check(loads(json.dumps(table)))


def test_alpha_is_told_from_a_parameter():
    """Of two vertices without a parameter one exponent would be a coordinate that nobody named."""
    case = Case("rms", ("polynomial", 1))
    table = json.loads(case.document(case.worst * 1.1).dumps())
    assert check(loads(json.dumps(table))).proved
    table["plant"]["parameters"], table["law"]["on"] = [], "simplex"
    with pytest.raises(FormatError, match="one per parameter, or one per vertex"):
        loads(json.dumps(table))


def test_a_name_that_two_signals_have_is_none_to_measure():
    table = document()
    table["plant"]["states"] = ["a", "b"]
    with pytest.raises(FormatError, match="is not a state or output"):
        loads(json.dumps(table))


def test_what_moves_with_inputs_is_not_measured():
    table = document()
    table["plant"]["outputs"][0]["D"] = [[1]]
    with pytest.raises(FormatError, match="free of inputs"):
        loads(json.dumps(table))


def test_the_claim_says_what_is_measured():
    """A file may give any name to any rows: they are written out."""
    plant = plant_of(varying=False)
    outputs = tuple(plant.signal(name) for name in ("force", "sum"))
    law = PolynomialGain(((0, 0),), [[[-3.0, -3.0]]], outputs, plant.parameters)
    poles = Poles(
        "lyapunov",
        file_plant(plant).A,
        file_plant(plant).B,
        (ExactHalfPlane(ZERO),),
        law.exact,
        (Evidence([rationals(np.eye(2))]),),
        "box",
    )
    said = poles.statement(file_plant(plant))
    assert "'force' = x1" in said
    assert "'sum' = 2 x1 + x2" in said


@pytest.mark.parametrize(
    ("kind", "name"), [("rounding", "code/guarantee.json"), ("sampled", "earlier/sampled.json")]
)
def test_a_law_of_one_term_is_no_gain(kind, name, every_file):
    """c K is not K: what is proved of one gain's code, or of its samples, is refused."""
    table = json.loads((every_file / name).read_text())
    count = len(table["plant"]["parameters"])
    claims = [own for own in table["claims"] if own["kind"] == kind]
    assert claims
    table["claims"] = claims
    assert check(loads(json.dumps(table))).proved
    K = table["law"]["K"]
    term = {"powers": [1] + [0] * (count - 1), "K": K}
    table["law"] = {"kind": "polynomial", "on": "simplex", "terms": [term]}
    try:
        answer = check(loads(json.dumps(table)))
    except FormatError:
        return
    assert not answer.proved


def lyapunov(case, X=None):
    """A claim of the half-plane about the loop, with constant X."""
    plant = case.plant
    X = rationals(np.eye(2)) if X is None else X
    return Poles(
        "lyapunov", plant.A, plant.B, (ExactHalfPlane(ZERO),), case.law, (Evidence([X]),), case.on
    )


def test_estimates_of_parameters_leave_what_is_measured_as_it_is():
    """u = K(q) C(p) x, not K(q) C(q) x: rows that vary are refused."""
    case = Case("rms", ("measured", 2))
    ranges = case.plant.ranges
    subject = Subject(lyapunov(case), ranges, (1, 1))
    with pytest.raises(FormatError, match="outputs must not vary"):
        prove(Estimate(subject, (ZERO, ZERO)))
    same = replace(case.law, C=(case.law.C[0],) * 4)
    steady = replace(subject, design=replace(subject.design, law=same))
    assert prove(Estimate(steady, (ZERO, ZERO))).answer in ("proved", "undecided")


@pytest.mark.parametrize("powers", [((0, 0), (1, 0)), ((0, 0), (2, 0), (1, 1))])
def test_a_constant_x_holds_at_any_rate(powers):
    """Its own rate of change is zero, whatever the degrees of the law in each parameter."""
    case = Case("rms", ("polynomial", 1), 0)
    plant = plant_of(varying=False)
    own = file_plant(plant)
    gains = 0.01 * np.random.default_rng(0).normal(size=(len(powers), 1, 2))
    law = PolynomialGain(powers, gains, (), plant.parameters).exact
    A = [rationals(-np.eye(2) + 0.1 * np.array(A, dtype=float) / 9) for A in own.A]
    ranges = (Range(ONE, Fraction(2), True, "m"), Range(ONE, Fraction(9), False, "k"))
    design = replace(lyapunov(case), A=A, B=own.B, law=law, on="box")
    assert prove(design).proved
    for rates in ((Fraction(1000), Fraction(1000)), (ZERO, ONE)):
        claim = Rate(Subject(design, ranges, (1, 1)), Fraction(1, 10), rates)
        assert prove(claim).proved
        assert not prove(replace(claim, decay=Fraction(2))).proved


@pytest.mark.parametrize("form", list(product(("polynomial",), (0, 1))) + [("measured", 2)])
def test_no_changed_law_is_proved_that_samples_contradict(form):
    case, random = Case("rms", form), np.random.default_rng(3)
    text = case.document(case.worst * 1.1).dumps()
    proved = 0
    for _ in range(12):
        table = json.loads(text)
        term = table["law"]["terms"][random.integers(len(table["law"]["terms"]))]
        place = random.integers(len(term["K"][0]))
        term["K"][0][place] += float(random.normal() * 10 ** random.uniform(-3, 0.5))
        found = check(loads(json.dumps(table))).proved
        proved += found
        assert not (found and false(table))
    assert 0 < proved < 12
