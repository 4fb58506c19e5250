"""The exact checker: its algebra against numpy, its refusals, and alone with a bare Python."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence import build
from polefence.cli.check import archive
from polefence.proof import matrices as definite
from polefence.proof import regions, work
from polefence.proof.document import loads
from polefence.proof.roots import _schur_cohn

integers = st.integers(-9, 9)


@given(st.lists(st.lists(integers, min_size=4, max_size=4), min_size=4, max_size=4))
def test_positive_definiteness_agrees_with_leading_minors(rows):
    R = np.array(rows)
    M = R @ R.T - 3 * np.eye(4, dtype=int)
    minors = [round(np.linalg.det(M[:k, :k])) for k in range(1, 5)]
    assert definite.is_positive_definite(M.tolist()) == all(minor > 0 for minor in minors)


def test_a_semidefinite_matrix_is_not_positive_definite():
    assert not definite.is_positive_definite([[1, 1], [1, 1]])
    assert not definite.is_positive_definite([[0]])
    assert definite.is_positive_definite([[10**40, 10**40 - 1], [10**40 - 1, 10**40]])


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled", "right-hand sides"])
def test_blocks_are_those_of_the_condition_up_to_scale(small_designs, method):
    """The checker's own blocks against the pencil's: two builders that share no line."""
    design = small_designs[method]
    certificate, law = design.certificate, design.law
    region, plant = design.region, design.plant
    N = len(plant.vertices)
    if design.method == "scheduled":
        values = {f"{x}{j + 1}": getattr(law, x)[j] for x in "WZ" for j in range(N)}
        values["tau"] = certificate.evidence["tau"].reshape(1, 1)
    elif design.method == "quadratic":
        W = certificate.evidence["W"]
        values = {"W": W, "Z": law.K @ W}
    else:
        G = certificate.evidence["G"]
        values = {f"P{j + 1}": certificate.evidence["P"][j] for j in range(N)}
        values |= {"G": G, "L": law.K @ G}
    from polefence import Scheduled

    kind = Scheduled(right_hand_sides=True) if method == "right-hand sides" else design.method
    pencil = build(kind, plant.A, plant.B, region.sigma)
    theirs = pencil.matrices(pencil.pack(values), region.radius)
    theirs.pop("tau", None)
    ours = list(certificate.claim().blocks())
    assert len(ours) == len(theirs)
    for (_, mine), other in zip(ours, theirs.values(), strict=True):
        mine = np.array(mine, dtype=float)
        assert np.allclose(mine / mine[0, 0], other / other[0, 0], rtol=1e-9, atol=1e-12)


@given(st.lists(st.fractions(-2, 2, max_denominator=8), min_size=1, max_size=6))
def test_schur_cohn_decides_where_the_roots_are(roots):
    """Real roots known exactly, boundary included."""
    polynomial = [Fraction(1)]
    for root in roots:
        polynomial = [
            a - root * b
            for a, b in zip([*polynomial, Fraction(0)], [Fraction(0), *polynomial], strict=True)
        ]
    whole = math.lcm(*(a.denominator for a in polynomial))
    integers = [int(a * whole) for a in polynomial]
    inside = definite.is_positive_definite(_schur_cohn(integers))
    assert inside == all(abs(root) < 1 for root in roots)


def test_poles_inside_agrees_with_eigenvalues(small_designs):
    random = np.random.default_rng(0)
    for name, design in small_designs.items():
        claim = design.certificate.claim()
        for a in random.dirichlet(np.ones(3), 5):
            alpha = [Fraction(round(w * 1000), 1000) for w in a]
            alpha[0] += 1 - sum(alpha)
            poles = design.poles(np.array(alpha, dtype=float))
            worst = np.abs(poles - design.region.centre).max()
            for factor, inside in ((1.001, True), (0.999, False)):
                radius = Fraction(float(worst * factor))
                centre = claim.region[0].numbers[0]
                tried = replace(claim, region=(regions.Disk(centre, radius),))
                assert tried.poles_inside(alpha) is inside, name


def test_alpha_must_be_on_the_simplex(small_designs):
    claim = small_designs["slack"].certificate.claim()
    for alpha in ([Fraction(1)], [Fraction(1), Fraction(1), Fraction(-1)], [Fraction(1, 4)] * 3):
        with pytest.raises(ValueError, match="simplex"):
            claim.poles_inside(alpha)


def test_the_right_hand_sides_form_is_nonnegative_on_the_simplex():
    """sum a_j^3 >= (sum a_j^2 a_k + 6 sum a_j a_k a_l) / (N-1)^2, equal at equal weights."""
    random = np.random.default_rng(1)
    for N in (2, 3, 4, 6):
        for a in (*random.dirichlet(np.ones(N), 200), np.full(N, 1 / N)):
            cubes, total = (a**3).sum(), a.sum()
            squares = (a**2).sum() * total - cubes
            triples = (total**3 - 3 * total * (a**2).sum() + 2 * cubes) / 6
            form = cubes - (squares + 6 * triples) / (N - 1) ** 2
            assert form >= -1e-15
        assert abs(form) < 1e-15


def test_alone_with_a_bare_python(small_designs, tmp_path):
    """The application is run by an isolated interpreter."""
    (tmp_path / "polefence-check.pyz").write_bytes(archive())
    for name, design in small_designs.items():
        design.save(tmp_path / name)
        done = run(tmp_path, f"{name}/design.json")
        assert (done.returncode, ": proved: " in done.stdout) == (0, True), done
    path = tmp_path / "slack" / "design.json"
    document = json.loads(path.read_text())
    document["claims"][0]["region"]["radius"] *= 0.999
    path.write_text(json.dumps(document))
    done = run(tmp_path, "slack/design.json")
    assert done.returncode == 1
    assert ": not proved: " in done.stdout
    path.write_text(path.read_text()[:500])
    done = run(tmp_path, "slack/design.json")
    assert done.returncode == 2
    assert "cut short" in done.stderr
    assert run(tmp_path).returncode == run(tmp_path, "none.json").returncode == 2


def run(folder, *words):
    command = [sys.executable, "-I", "-S", "polefence-check.pyz", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def edit(document, *keys, value):
    place = document
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    return document


FAULTS = {
    "later version": (("version",), 3, "format version 3"),
    "other format": (("format",), "x", "not a file of proofs"),
    "method": (("claims", 0, "method"), "cubic", "must be one of"),
    "law of another method": (("law", "kind"), "scheduled", "law.W is missing"),
    "no region": (
        (
            "claims",
            0,
            "region",
        ),
        3,
        "region must be a table",
    ),
    "region kind": (("claims", 0, "region", "kind"), "square", "must be"),
    "truth": (("claims", 0, "region", "radius"), True, "finite number"),
    "word": (("claims", 0, "region", "radius"), "31", None),
    "expression": (("claims", 0, "region", "radius"), "1+1", "finite number"),
    "zero denominator": (("claims", 0, "region", "radius"), "1/0", "finite number"),
    "infinite": (("claims", 0, "region", "radius"), float("inf"), "not a finite number"),
    "nan": (("claims", 0, "region", "radius"), float("nan"), "not a finite number"),
    "huge": (("claims", 0, "region", "radius"), 10**301, "finite number"),
    "no vertices": (("plant", "vertices"), [], "1 to 256"),
    "vertex no table": (("plant", "vertices", 0), 3, "must be a table"),
    "ragged": (("plant", "vertices", 0, "A"), [[1, 2], [3]], "ragged"),
    "rows": (("plant", "vertices", 0, "A"), [1, 2], "must be a list"),
    "shape of A": (("plant", "vertices", 1, "A"), [[1]], "is 1 x 1, not 2 x 2"),
    "shape of K": (("law", "K"), [[1, 2, 3]], "is 1 x 3, not 2 x 2"),
    "count of P": (("claims", 0, "evidence", "P"), [[[1, 0], [0, 1]]], "holds 1 matrices"),
    "no G": (
        (
            "claims",
            0,
            "evidence",
        ),
        {"P": []},
        "holds|1 to ",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_malformed_file_is_named(small_designs, fault):
    keys, value, message = FAULTS[fault]
    document = edit(json.loads(small_designs["slack"].certificate.dumps()), *keys, value=value)
    if message is None:
        loads(json.dumps(document))  # an exact string is a number
        return
    with pytest.raises(work.FormatError, match=message):
        loads(json.dumps(document))


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", "[" * 100_000, '{"format": 1, "format": 1}']
)
def test_what_is_no_document_is_refused(text):
    with pytest.raises(work.FormatError):
        loads(text)
