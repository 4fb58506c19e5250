"""Claims about vectors of outputs under chosen disturbances: inequalities, files, faults."""

from __future__ import annotations

import copy
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from polefence.plant.polynomial import Domain
from polefence.proof.claims import EnergyPeak, Gain, Output, Rms, Subject, prove
from polefence.proof.claims.signal import MAX_ENTRIES
from polefence.proof.document import from_plain, loads
from polefence.proof.laws import Evidence, Law
from polefence.proof.polynomials import bernstein, constant, symmetric
from polefence.proof.work import FormatError, counted

ROWS, N, SIZE, WAYS, INPUTS = 3, 4, 2, 2, 2


def several(matrices):
    return [[[Fraction(float(x)) for x in row] for row in matrix] for matrix in matrices]


class Example:
    """Matrices of no meaning, and what the inequalities are at alpha."""

    def __init__(self, kind, scheduled, on, scales=(), seed=1):
        random = np.random.default_rng(seed)
        self.kind, self.scheduled, self.domain = kind, scheduled, Domain.of(on, N)
        self.A, self.B, self.E, self.C, self.D, self.F = (
            random.normal(size=(N, *shape))
            for shape in (
                (SIZE, SIZE), (SIZE, INPUTS), (SIZE, WAYS), (ROWS, SIZE), (ROWS, INPUTS),
                (ROWS, WAYS),
            )
        )  # fmt: skip
        half = random.normal(size=(self.domain.count(1), SIZE, SIZE))
        self.W, self.Z = half + half.swapaxes(1, 2), random.normal(size=(N, INPUTS, SIZE))
        self.K, self.level, self.scales = random.normal(size=(INPUTS, SIZE)), Fraction(7, 3), scales
        law, evidence = Law(several([self.K])), Evidence(several(self.W), 1, 1)
        if scheduled:
            law = Law(None, several(self.W), several(self.Z), 1)
            evidence = Evidence([], 0, 1, (Fraction(3, 2),))
        subject = Subject(*(several(M) for M in (self.A, self.B, self.E)), law, evidence, on)
        F = several(self.F) if kind == "gain" else several(0 * self.F)
        outputs = tuple(
            Output(*([[M[j]] for M in several(own)] for own in (self.C, self.D)),
                   f"y{j}", tuple([M[j]] for M in F) if kind == "gain" else ())
            for j in range(ROWS)
        )  # fmt: skip
        make = {"gain": Gain, "rms": lambda *a, **k: Rms(*a, Fraction(5, 7), **k)}[kind]
        self.claim = make(subject, outputs, self.level, scales=tuple(map(Fraction, scales)))

    def expected(self, alpha):
        A, B, E, C, D, F, W, Z = (
            np.tensordot(self.domain.basis(alpha, 1), M, 1)
            for M in (self.A, self.B, self.E, self.C, self.D, self.F, self.W, self.Z)
        )
        K, X = (Z @ np.linalg.inv(W), 1.5 * W) if self.scheduled else (self.K, W)
        s = np.array(self.scales or (1.0,) * WAYS, dtype=float)
        E, F, g = E * s, F * s, float(self.level)
        N_, Y = (A + B @ K) @ X, (C + D @ K) @ X
        if self.kind == "gain":
            right = np.hstack([-E, -Y.T])
            corner = np.block([[g * np.eye(WAYS), -F.T], [-F, g * np.eye(ROWS)]])
            return {"of X": X, "of the gain": np.block([[-(N_ + N_.T), right], [right.T, corner]])}
        wide = Y.reshape(1, -1)
        output = np.block([[np.array([[g * g]]), wide], [wide.T, np.kron(np.eye(ROWS), X)]])
        return {"of the noise": -(N_ + N_.T) - 5 / 7 * E @ E.T, "of the output": output}


def at(inequality, alpha, domain):
    """An inequality's matrix at alpha, over that of its first entry; from its coefficients."""
    total = 0
    for place, matrix in inequality.blocks():
        start, weight = 0, 1.0
        for size in place.sizes:
            own = coordinates(alpha, domain)[start : start + size]
            weight *= np.prod(np.power(own, place.powers[start : start + size]))
            start += size
        total = total + weight * np.array(matrix, dtype=float)
    return total / total[0, 0]


def coordinates(alpha, domain):
    if len(domain.sizes) == 1:
        return alpha
    square = np.reshape(alpha, domain.sizes)
    return np.concatenate([square.sum(axis=1), square.sum(axis=0)])


@pytest.mark.parametrize("scales", [(), (3, 0.25), (0, 2)])
@pytest.mark.parametrize("on", ["simplex", "box"])
@pytest.mark.parametrize("scheduled", [False, True])
@pytest.mark.parametrize("kind", ["rms", "gain"])
def test_the_coefficients_are_those_of_the_inequality(kind, scheduled, on, scales):
    example = Example(kind, scheduled, on, scales)
    random = np.random.default_rng(0)
    found = {own.name: own for own in example.claim.inequalities()}
    for _ in range(3):
        points = [random.dirichlet(np.ones(size)) for size in example.domain.sizes]
        alpha = points[0] if len(points) == 1 else np.outer(*points).ravel()
        expected = example.expected(alpha)
        assert set(found) == set(expected)
        for name, matrix in expected.items():
            own = at(found[name], alpha, example.domain)
            assert own.shape == matrix.shape
            assert found[name].size == len(matrix)
            assert np.allclose(own, matrix / matrix[0, 0], rtol=1e-9, atol=1e-9), name


@pytest.mark.parametrize("kind", ["rms", "gain"])
def test_one_of_a_vector_is_the_claim_about_a_signal(kind):
    """Its only entry's inequality, coefficient by coefficient, in whole numbers."""
    claim = Example(kind, True, "box").claim
    one = replace(claim, outputs=claim.outputs[:1])
    n, rows = SIZE, {"rms": SIZE + 1, "gain": SIZE + WAYS + 1}[kind]
    assert [own.size for own in one.inequalities()] == [n, rows]
    assert one.largest == SIZE + WAYS + 1


# --- a vector that is proved ---------------------------------------------------------------------


def document(kind, level, **more):
    """x' = -x + w1 + w2 / 2 twice over, with poles at -1 and -2: one vertex."""
    claim = {
        "kind": kind,
        "outputs": [
            {"name": "x", "C": [[1, 0]]},
            {"name": "sum", "C": [[1, 1]], "D": [[0]]},
        ],
        "level": level,
        "evidence": {"X": [[["1/2", 0], [0, "1/4"]]]},
    }
    plant = {
        "name": "two",
        "states": ["x [m]", "v"],
        "inputs": [],
        "disturbances": ["road [m]", "wind"],
        "outputs": [{"name": "sum", "unit": "m", "C": [[1, 1]]}],
        "parameters": [],
        "vertices": [
            {"A": [[-1, 0], [0, -2]], "B": [[0], [1]], "E": [[1, 0], [0, 1]]},
        ],
    }
    law = {"kind": "fixed", "K": [[0, 0]]}
    head = {"format": "polefence-proof", "version": 2}
    return head | {"plant": plant, "law": law, "claims": [claim | more]}


def larger(share):
    """Evidence: more than the covariance diag(1/2, 1/4) by a share."""
    return {"X": [[[0.5 * (1 + share), 0], [0, 0.25 * (1 + share)]]]}


def proved(plain):
    (claim,) = from_plain(plain).claims
    return prove(claim).proved


def test_a_vector_is_bracketed():
    """E z'z = 1/2 + (1/2 + 1/4) for w of unit intensity; with scales a sum of their squares."""
    true = 1.25**0.5
    assert proved(document("rms", true * (1 + 1e-5), evidence=larger(1e-6)))
    for share in (1e-9, 1e-6, 1e-3):
        assert not proved(document("rms", true * (1 - 1e-6), evidence=larger(share)))
    scaled = {"disturbances": [3, 0], "evidence": {"X": [[[4.5 * (1 + 1e-6), 0], [0, 1e-9]]]}}
    true = 9.0**0.5  # 9 (1/2 + 1/2)
    assert proved(document("rms", true * (1 + 1e-5), **scaled))
    assert not proved(document("rms", true * (1 - 1e-6), **scaled))


def test_what_is_read_is_what_is_written():
    for kind, more in (
        ("rms", {}),
        ("rms", {"disturbances": [0.5, 20]}),
        ("gain", {"disturbances": ["1/3", 0]}),
    ):
        plain = document(kind, 3, **more)
        if kind == "gain":
            plain["claims"][0]["outputs"][0]["F"] = [[0, "1/7"]]
        found = from_plain(plain)
        assert loads(found.dumps()) == found
        (claim,) = found.claims
        assert [own.name for own in claim.outputs] == ["x", "sum"]
        assert "output" not in found.write()["claims"][0]


def test_what_is_said_says_each_entry_and_each_disturbance():
    plain = document("rms", 1.2, disturbances=["1/3", 20])
    plant, (claim,) = from_plain(plain).plant, from_plain(plain).claims
    said = claim.statement(plant)
    assert said == (
        "rms of ['x' = x1, 'sum' = x1 + x2] <= 1.2 at density 2 from 'road' = w1 times 0.333333 "
        "and 'wind' = w2 times 20, on the simplex"
    )
    # less of a disturbance moves less: rounded down
    more = replace(claim, scales=(Fraction("0.99999999"), Fraction(0)))
    assert "from 'road' = w1 times 0.999999 alone" in more.statement(plant)
    one = replace(claim, scales=(Fraction(0), Fraction(1)))
    assert "from 'wind' = w2 alone" in one.statement(plant)
    bare = replace(plant, disturbances=())
    assert " from w2 alone" in one.statement(bare)
    # no name of a file leaves its quotes
    forged = "x' = x1] <= 1, on the box; proved: ['y"
    outputs = (replace(claim.outputs[0], name=forged), claim.outputs[1])
    text = replace(claim, outputs=outputs).statement(plant)
    assert repr(forged) in text
    assert "(as the file defines it) = x1" in text
    hostile = replace(plant, disturbances=("road' alone, on all\n", "w"))
    assert "\n" not in claim.statement(hostile)


def test_an_entry_with_the_name_of_another_signal_is_a_fault():
    plain = document("rms", 2)
    plain["claims"][0]["outputs"][1]["C"] = [[1, 2]]
    found = from_plain(plain)
    assert "'sum' is another" in found.claims[0].fault_in(found.plant, found.claims)
    plain = document("rms", 2)
    found = from_plain(plain)
    assert found.claims[0].fault_in(found.plant, found.claims) == ""


CLAIM = ("claims", 0)
WRONG = {
    "level": ((*CLAIM, "level"), 1.1),
    "C": ((*CLAIM, "outputs", 1, "C"), [[1, 1.2]]),
    "first C": ((*CLAIM, "outputs", 0, "C"), [[1.1, 0]]),
    "D": ((*CLAIM, "outputs", 0, "D"), [[2]]),
    "another": (
        (*CLAIM, "outputs"),
        [{"name": "x", "C": [[1, 0]]}, {"C": [[1, 1]]}, {"C": [[0.1, 0]]}],
    ),
    "scale": ((*CLAIM, "disturbances"), [1.1, 1]),
    "other scale": ((*CLAIM, "disturbances"), [1, 1.1]),
    "E": (("plant", "vertices", 0, "E", 1, 0), 1),
    "A": (("plant", "vertices", 0, "A", 1, 1), -1.5),
    "X": ((*CLAIM, "evidence", "X", 0, 0, 0), 0.49),
    "asymmetric": ((*CLAIM, "evidence", "X", 0, 0, 1), 0.01),
    "K": (("law", "K"), [[0, 0.5]]),
}


def changed(plain, path, value):
    found = copy.deepcopy(plain)
    node = found
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    return found


@pytest.mark.parametrize("fault", WRONG)
def test_one_fault_at_a_time(fault):
    """D with K = 0 is the one thing that does not matter, until K is there too."""
    sharp = document("rms", 1.25**0.5 * (1 + 1e-4), evidence=larger(1e-5))
    assert proved(sharp)
    path, value = WRONG[fault]
    if fault == "D":
        sharp = changed(sharp, ("law", "K"), [[-1e-9, 0]])
        assert proved(sharp)
        sharp = changed(sharp, ("law", "K"), [[-0.2, 0]])
    assert not proved(changed(sharp, path, value))


REFUSED = {
    "empty": ((*CLAIM, "outputs"), [], "1 to 16 entries"),
    "many": ((*CLAIM, "outputs"), [{"C": [[1, 0]]}] * (MAX_ENTRIES + 1), "1 to 16 entries"),
    "no list": ((*CLAIM, "outputs"), {}, "1 to 16 entries"),
    "no table": ((*CLAIM, "outputs", 0), 3, r"outputs\[1\] must be a table"),
    "no C": ((*CLAIM, "outputs", 0), {"D": [[0]]}, r"outputs\[1\].C is missing"),
    "C": ((*CLAIM, "outputs", 1, "C"), [[1]], r"outputs\[2\].C is 1 x 1"),
    "key": ((*CLAIM, "outputs", 1, "G"), 1, "unknown key .*G"),
    "name": ((*CLAIM, "outputs", 1, "name"), 1, "name must be text"),
    "both": ((*CLAIM, "output"), {"C": [[1, 0]]}, "unknown key .*output"),
    "head": ((*CLAIM, "name"), "x", "unknown key .*name"),
    "F": ((*CLAIM, "outputs", 1, "F"), [[0, 1]], "passes straight into"),
    "F wide": ((*CLAIM, "outputs", 1, "F"), [[0]], "is 1 x 1, not 1 x 2"),
    "few": ((*CLAIM, "disturbances"), [1], "disturbances must hold 2 numbers"),
    "none": ((*CLAIM, "disturbances"), [0, 0], "not all zero"),
    "minus": ((*CLAIM, "disturbances"), [1, -1], "zero or more"),
    "text": ((*CLAIM, "disturbances"), ["a", 1], "not a finite number"),
    "table": ((*CLAIM, "disturbances"), {"road": 1}, "must be a list"),
    "peak": ((*CLAIM, "kind"), "energy peak", "output is missing|unknown key"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_a_malformed_vector_is_named(fault):
    path, value, message = REFUSED[fault]
    with pytest.raises(FormatError, match=message):
        proved(changed(document("rms", 2), path, value))


def test_what_does_not_fit_is_refused_of_a_claim_too():
    (claim,) = from_plain(document("rms", 2, evidence=larger(0.1))).claims
    assert prove(claim).proved
    F = ([[Fraction(1), Fraction(0)]],)
    driven = (replace(claim.outputs[0], F=F), claim.outputs[1])
    for fault, message in (
        ({"outputs": ()}, "1 to 16 outputs"),
        ({"outputs": claim.outputs * 9}, "1 to 16 outputs"),
        ({"outputs": (replace(claim.outputs[0], C=[]), claim.outputs[1])}, "C holds 0"),
        ({"outputs": driven}, "passes straight"),
        ({"outputs": driven, "scales": (Fraction(1), Fraction(0))}, "passes straight"),
        ({"scales": (Fraction(1),) * 3}, "2 numbers"),
        ({"scales": (Fraction(0),) * 2}, "not all zero"),
    ):
        with pytest.raises(FormatError, match=message):
            prove(replace(claim, **fault))
    # what does not act may pass
    assert prove(replace(claim, outputs=driven, scales=(Fraction(0), Fraction(1)))).proved
    peak = EnergyPeak(claim.subject, claim.outputs, Fraction(9))
    with pytest.raises(FormatError, match="1 to 1 outputs"):
        prove(peak)


def test_each_entry_is_part_of_the_work():
    """Rows grow with the entries, and are refused before anything is multiplied."""
    plain = document("rms", 99, evidence={"X": [[[1, 0], [0, 1]]], "on": "simplex"})
    plain["plant"]["vertices"] *= 60
    few = changed(plain, (*CLAIM, "evidence", "elevation"), 2)
    (claim,) = from_plain(few).claims
    one = replace(claim, outputs=claim.outputs[:1])
    one.require()
    with pytest.raises(FormatError, match="to be checked here"):
        replace(claim, outputs=claim.outputs * 8).require()


def test_what_stands_in_many_places_is_raised_once():
    """X once an entry, and zeros between them: the work does not grow with their number."""
    example = Example("rms", False, "simplex")
    X = bernstein(several(example.W), (N,), 1)
    zero = constant(several([np.zeros((SIZE, SIZE))])[0], (N,))

    def spent(rows):
        with counted() as work:
            blocks = list(symmetric(rows, (5,)))
        return work.spent, blocks

    (alone, blocks), (nothing, _) = spent([[X]]), spent([[zero]])
    work, several_blocks = spent([[X, zero, zero], [X, zero], [X]])
    assert work < alone + nothing
    for (e, one), (f, own) in zip(blocks, several_blocks, strict=True):
        assert e == f
        assert np.array_equal(np.array(own), np.kron(np.eye(3, dtype=int), np.array(one)))
