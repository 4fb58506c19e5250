"""Performance files: what they say is what is proved, and each malformed one is named."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from polefence import Disk, Parameter, Scheduled, UncertainPlant, place
from polefence.proof.claims.base import prove
from polefence.proof.document import loads
from polefence.proof.work import FormatError
from support.changes import changed
from support.files import bounds_in


def lyapunov(A, Q):
    n = len(A)
    eye = np.eye(n)
    X = np.linalg.solve(np.kron(A, eye) + np.kron(eye, A), -Q.ravel()).reshape(n, n)
    return (X + X.T) / 2


@pytest.fixture(scope="module")
def designs():
    """A mass on a spring, with the integral of its place as third state; E varies with 1/m."""
    parameters = [Parameter("m", 1, "11/10", "kg", "1/m"), Parameter("k", 4, "9/2", "N/m")]
    A = [["0", "1", "0"], ["-k/m", "-1/m", "0"], ["1", "0", "0"]]
    plant = UncertainPlant.from_expressions(
        parameters, A, [["0"], ["1/m"], ["0"]], [["0"], ["1/m"], ["0"]]
    )
    laws = {"scheduled": Scheduled(1, 1, "box"), "quadratic": "quadratic"}
    return {name: place(plant, Disk(-3, 2.6), law) for name, law in laws.items()}


def specification(kind, level, evidence, **more):
    output = {"C": [[0, 1, 0]], "D": [["1/8"]]}
    own = {
        "rms": {"intensity": 0.5},
        "energy peak": {"norm": 2},
        "initial peak": {"points": [[0.1, 0, 0]], "impulses": [-1]},
        "gain": {},
        "relative rms": {"intensity": 2, "baseline": baseline()},
    }[kind]
    if kind == "gain":
        output |= {"F": [["-1/16"]]}
    head = {"kind": kind, "name": kind.upper(), "output": output, "level": level}
    return head | {"evidence": evidence} | own | more


def baseline():
    """The passive spring at the middle: its Lyapunov matrix, and less than its covariance."""
    A, E = np.array([[0, 1], [-4.25 / 1.05, -1 / 1.05]]), np.array([[0], [1 / 1.05]])
    X = lyapunov(A, np.eye(2))
    P = lyapunov(A, 2 * E @ E.T - 0.3 * np.eye(2))
    stability = {"X": [X.tolist()]}
    return {
        "states": [1, 2],
        "stability": stability,
        "covariance": {"P": [P.tolist()], "elevation": 1},
    }


KINDS = ["rms", "energy peak", "initial peak", "gain", "relative rms"]


def document_of(design, *specifications):
    """A file of the design's plant and law, and of claims about signals alone."""
    return design.certificate.document() | {"claims": list(specifications)}


def answers(document):
    claims = bounds_in(json.dumps(document))
    return [prove(claim).proved for claim in claims]


def proves(design, kind, level, scale):
    evidence = with_own(design, scale)
    return answers(document_of(design, specification(kind, level, evidence))) == [True]


def with_own(design, scale, elevation=0):
    """The design's own W times a number, as evidence."""
    if design.method == "scheduled":
        return {"own": True, "scale": scale, "elevation": elevation}
    return {"X": [(scale * design.certificate.evidence["W"]).tolist()], "elevation": elevation}


def own(design, kind, level=300.0):
    """The least power of two by which the design's own W proves a level, if any does."""
    scales = (2.0**power for power in range(-10, 12))
    return next((s for s in scales if proves(design, kind, level, s)), None)


def least(holds, value):
    """Nearly the least number for which something holds."""
    step = 0.75
    for _ in range(60):
        if holds(value * (1 - step)):
            value *= 1 - step
        elif step < 2e-3:
            return value
        else:
            step /= 4
    raise AssertionError("it holds for anything")


@pytest.fixture(scope="module", params=["scheduled", "quadratic"])
def tight(request, designs):
    """Design, and a specification of each kind with nearly the least level and multiple of W."""
    design, found = designs[request.param], {}
    for kind in KINDS:
        level = 300.0
        scale = own(design, kind)
        while kind == "gain" and (better := own(design, kind, level / 2)):
            scale, level = better, level / 2
        if kind != "gain":  # the least multiple of W there; for gains there is one between others
            scale = least(lambda s, kind=kind, level=level: proves(design, kind, level, s), scale)
        level = least(lambda v, kind=kind, scale=scale: proves(design, kind, v, scale), level)
        found[kind] = specification(kind, level, with_own(design, scale))
    return design, found


def test_all_specifications_of_one_file(tight):
    design, found = tight
    document = document_of(design, *found.values())
    assert answers(document) == [True] * 5
    claims = bounds_in(json.dumps(document))
    assert [claim.outputs[0].name for claim in claims] == [kind.upper() for kind in found]
    for spec in document["claims"]:
        spec["level"] *= 0.99
    assert answers(document) == [False] * 5


def test_the_numbers_mean_what_they_say(tight):
    """Against the truth at the corners; the proofs are conservative by the design's own W."""
    design, found = tight
    for kind in ("rms", "energy peak", "gain"):
        level, worst = found[kind]["level"], 0.0
        for alpha in np.eye(4):
            A, B = design.plant.at(alpha)
            K = design.law.gain(alpha)
            E = np.tensordot(alpha, [v.E for v in design.plant.vertices], 1)
            Y = np.array([[0, 1, 0]]) + K / 8
            rms = np.sqrt((Y @ lyapunov(A + B @ K, E @ E.T) @ Y.T).item())
            if kind == "gain":
                w = np.geomspace(1e-2, 1e3, 300)[:, None, None]
                states = np.linalg.solve(1j * w * np.eye(3) - A - B @ K, E.astype(complex))
                worst = max(worst, np.abs(Y @ states - 1 / 16).max())
            else:
                worst = max(worst, rms * (2 if kind == "energy peak" else np.sqrt(0.5)))
        assert worst < level < 12 * worst, kind


def weaker(evidence):
    """The same evidence of a smaller X."""
    if "own" in evidence:
        return evidence | {"scale": evidence["scale"] / 1.5}
    return evidence | {"X": [[[x / 1.5 for x in row] for row in X] for X in evidence["X"]]}


# what makes each claim more than is proved
WRONG = {
    "rms": {("intensity",): 0.6},
    "energy peak": {("norm",): 2.1},
    "initial peak": {("points",): [[5, 0, 0]], ("impulses",): [1.2]},
    "gain": {("output", "F"): [[-1]]},
    "relative rms": {
        ("baseline", "states"): [1, 2, 3],
        ("baseline", "K"): [[-2, -2, 0]],
        ("baseline", "stability", "X", 0, 0, 0): -1,
        ("baseline", "covariance", "P", 0, 1, 1): 50,
        ("intensity",): 20,
    },
}


@pytest.mark.parametrize("kind", KINDS)
def test_one_fault_at_a_time(tight, kind):
    design, found = tight
    document = document_of(design, found[kind])
    spec = ("claims", 0)
    faults = {(*spec, *key): value for key, value in WRONG[kind].items()} | {
        (*spec, "output", "C"): [[0, 1.1, 0], [0, 9, 0], [0, 9, 0], [0, 9, 0]],
        (*spec, "output", "D"): [[-1]],
        (*spec, "evidence"): weaker,
        ("plant", "vertices", 3, "E", 1, 0): 5,
        ("plant", "vertices", 2, "A", 1, 1): 3,
        ("plant", "vertices", 1, "B", 1, 0): -3,
    }
    if found[kind]["evidence"] and design.method == "scheduled":
        faults |= {("law", letter, 0, 0, 0): lambda v: v + 40 for letter in "WZ"}
    for keys, value in faults.items():
        fault = changed(document, *keys, value=value)
        try:
            assert answers(fault) == [False], keys
        except FormatError:
            assert keys[-1] == "states", keys  # some baselines are refused


def test_evidence_of_its_own(designs):
    """An X beside W: Q and multiples for a scheduled law, X for a gain; on the box or not."""
    for name, design in designs.items():
        scale = own(design, "rms")
        if name == "scheduled":
            X = np.zeros((4, 3, 3)).tolist()
            beside = {"X": X, "degree": 1, "multiple": [scale] * 4, "elevation": 0}
            forms = [beside]
        else:
            W = (scale * design.certificate.evidence["W"]).tolist()
            forms = [
                {"X": [W]},
                {"X": [W], "on": "box", "elevation": 1},
                {"X": [W] * 10, "degree": 2},
            ]
        for form in forms:
            document = document_of(design, specification("rms", 300.0, form))
            assert answers(document) == [True], (name, form)
            document["claims"][0]["intensity"] = 1e9
            assert answers(document) == [False]
        lost = changed(document, "plant", "parameters", value=[])
        if "on" in forms[-1]:
            with pytest.raises(FormatError, match="spans|span"):
                answers(lost)


S = ("claims", 0)
EVIDENCE = {"X": [[[1, 0, 0], [0, 1, 0], [0, 0, 1]]]}
FAULTS = {
    "format": ("rms", ("format",), "polefence-performance", "polefence 0.1"),
    "version": ("rms", ("version",), 3, "version 3"),
    "note": ("rms", ("note",), 1, "unknown key note"),
    "plant": ("rms", ("plant",), None, "plant must be a table"),
    "law": ("rms", ("law", "W"), [], "law.W must be a list"),
    "discrete": ("rms", ("plant", "sample_time"), 0, "plant.sample_time must be positive"),
    "E of one": ("rms", ("plant", "vertices", 1, "E"), [[1]], "vertex 2: E is 1 x 1"),
    "E": ("rms", ("plant", "vertices", 1, "E"), [["x"]] * 3, "not a finite number"),
    "none": ("rms", ("claims",), [], "1 to 100"),
    "no table": ("rms", S, 3, "must be a table"),
    "kind": ("rms", (*S, "kind"), "peak", "kind must be one of region"),
    "kinds": ("rms", (*S, "kind"), ["rms"], "kind must be one of region"),
    "other kind": ("rms", (*S, "kind"), "gain", "unknown key .*intensity"),
    "key": ("rms", (*S, "unit"), "m", "unknown key .*unit"),
    "name": ("rms", (*S, "name"), 3, "name must be text"),
    "level": ("rms", (*S, "level"), -1, "level must be zero or more"),
    "level text": ("rms", (*S, "level"), "1.5", "level = '1.5'"),
    "level nan": ("rms", (*S, "level"), float("nan"), "NaN is not a finite"),
    "intensity": ("rms", (*S, "intensity"), "-1/2", "zero or more"),
    "norm": ("energy peak", (*S, "norm"), -1, "zero or more"),
    "F": ("rms", (*S, "output", "F"), [[1]], "passes straight into"),
    "F of an impulse": ("initial peak", (*S, "output", "F"), [[1]], "passes straight into"),
    "F wide": ("gain", (*S, "output", "F"), [[1, 2]], "output.F is 1 x 2, not 1 x 1"),
    "C": ("rms", (*S, "output", "C"), [[1, 2]], "output.C is 1 x 2, not 1 x 3"),
    "rows": ("rms", (*S, "output", "C"), [[0, 1, 0]] * 3, "one row, or 4: one per vertex"),
    "no C": ("rms", (*S, "output"), {"D": [[1]]}, "output.C is missing"),
    "output": ("rms", (*S, "output"), [[0, 1, 0]], "output must be a table"),
    "own": ("rms", (*S, "evidence", "own"), 1, "own must be true"),
    "own and X": ("rms", (*S, "evidence", "X"), [], "unknown key .*X"),
    "scale": ("rms", (*S, "evidence", "scale"), None, "not a finite number"),
    "elevation": ("rms", (*S, "evidence", "elevation"), 17, "0 to 16"),
    "elevated": ("rms", (*S, "evidence", "elevation"), 1.0, "whole number"),
    "nothing": ("rms", (*S, "evidence"), {}, "evidence.X is missing"),
    "list": ("rms", (*S, "evidence"), [], "evidence must be a table"),
    "on": ("rms", (*S, "evidence", "on"), "box", "unknown key .*on"),
    "X": ("rms", (*S, "evidence"), {"X": [[[1]]]}, r"X\[1\] is 1 x 1"),
    "X few": ("rms", (*S, "evidence"), EVIDENCE | {"degree": 1}, "its degree needs 4"),
    "multiple": ("rms", (*S, "evidence"), EVIDENCE | {"multiple": [1, 2]}, "list of 1 entries"),
    "points": ("initial peak", (*S, "points"), [[1, 2]], "points is 1 x 2"),
    "impulses": ("initial peak", (*S, "impulses"), [1, 2], "must hold 1 numbers"),
    "baseline": ("relative rms", (*S, "baseline"), 1, "baseline must be a table"),
    "baseline key": ("relative rms", (*S, "baseline", "A"), 1, "unknown key .*A"),
    "states": ("relative rms", (*S, "baseline", "states"), [1.0], "whole numbers"),
    "states out": ("relative rms", (*S, "baseline", "states"), [1, 4], "some of the 3"),
    "states left": ("relative rms", (*S, "baseline", "states"), [2], "left out"),
    "K": ("relative rms", (*S, "baseline", "K"), [[1, 2]], "baseline.K is 1 x 2"),
    "P": ("relative rms", (*S, "baseline", "covariance", "X"), 1, "unknown key .*X"),
    "P many": ("relative rms", (*S, "baseline", "covariance", "degree"), 1, "needs 4"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_malformed_file_is_named(designs, fault):
    kind, keys, value, message = FAULTS[fault]
    evidence = {"own": True, "scale": 1}
    document = document_of(designs["scheduled"], specification(kind, 300.0, evidence))
    with pytest.raises(FormatError, match=message):
        answers(changed(document, *keys, value=value))


def test_what_a_plant_must_have(designs):
    specs = [specification(kind, 300.0, {"own": True}) for kind in KINDS]
    for spec in specs:
        document = document_of(designs["scheduled"], spec)
        for vertex in document["plant"]["vertices"]:
            del vertex["E"]
        with pytest.raises(FormatError, match="no E"):
            answers(document)
    del spec  # the last one
    points = specification("initial peak", 1e6, {"own": True, "scale": 1e3})
    del points["impulses"]
    document["claims"] = [points]
    assert answers(document) == [True]
    del points["points"]
    with pytest.raises(FormatError, match="no initial state"):
        answers(document)
    text = json.dumps(document)
    with pytest.raises(FormatError, match="cut short"):
        loads(text[:-9])
    fixed = document_of(designs["quadratic"], specification("rms", 1, {"own": True}))
    with pytest.raises(FormatError, match="and the law scheduled"):
        answers(fixed)


def test_rational_strings_are_exact(designs):
    """A third is a third: a bound that holds at 1/3 and not at the next double below it."""
    spec = specification("initial peak", "1/3", {"own": True}, points=[["1/3", 0, 0]])
    claims = bounds_in(json.dumps(document_of(designs["scheduled"], spec)))
    assert claims[0].level == Fraction(1, 3)
    assert claims[0].points == ((Fraction(1, 3), Fraction(0), Fraction(0)),)
    assert claims[0].impulses == (Fraction(-1),)
    assert {D[0][0] for D in claims[0].outputs[0].D} == {Fraction(1, 8)}
