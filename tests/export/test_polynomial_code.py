"""Polynomial laws, of states and of signals, as C99, as FMU and for MATLAB."""

import json
import re
from dataclasses import replace
from fractions import Fraction
from math import prod

import numpy as np
import pytest
from scipy.io import loadmat

from polefence import Disk, FixedGain, HalfPlane, InputError, NotProvedError, analyse, observe
from polefence.export import check_guarantee, export_c99
from polefence.export.fmu import variables
from polefence.export.matlab import mat
from polefence.export.program import number, program
from polefence.export.sources import context
from polefence.export.vectors import ALLOWED, special, vectors
from polefence.law.laws import PolynomialGain
from polefence.response.discrete import Sampling
from support.commands import ran
from support.cortex import export, run
from support.once import proved_once  # noqa: F401
from support.polynomials import KINDS, REGION, design

COUNT = 10_000


@pytest.mark.parametrize("kind", ["square", "one gain", "measured", "many", "varying", "alpha"])
def test_the_folder_is_proved_and_its_test_passes(host_compiler, kind, tmp_path, capsys):
    made = export_c99(design(kind), 32, limits=800.0)
    made.save(tmp_path)
    assert made.proved
    assert "as the float32 code computes it" in ran(capsys, "check", tmp_path)
    lines = run("make", "-s", "test", "CFLAGS=-O1 -Werror", cwd=tmp_path).splitlines()
    assert [line.split(": ")[-1] for line in lines] == ["passed (0 failed)"] * 2


def test_the_code_is_given_what_is_measured():
    """Names in the header; as many constants as there are terms and signals, in their order."""
    own = design("measured")
    files = {name: text.decode() for name, text in export_c99(own, 32).files.items()}
    header, source = files["law.h"], files["law.c"]
    assert "#define LAW_MEASURED 3U" in header
    assert "LAW_STATES" not in header + source + files["law_test.c"] + files["README.md"]
    for j, signal in enumerate(own.law.measured):
        assert f"y[{j}]  {signal.label}" in header
    assert "tyre deflection" not in header
    body = re.search(r"K\[3\]\[TERMS\] = \{(.*?)\};", source, re.DOTALL)[1]
    found = np.array([float(v) for v in re.findall(r"-?[\d.]+(?:e[+-]?\d+)?(?=F)", body)])
    assert np.array_equal(found.reshape(3, 3), np.float32(own.law.gains[:, 0]).astype(float).T)
    code = json.loads(files["guarantee.json"])["claims"][0]["code"]
    assert np.array_equal(np.array(code["terms"])[:, 0], found.reshape(3, 3).T)
    assert re.findall(r"/ \w+", source) == ["/ p0"]  # of 1/m1: nothing is factorised


def test_a_gain_of_signals_is_one_of_signals():
    files = export_c99(design("one gain"), 64).files
    assert b"u = K y, the same for every parameter value." in files["law.h"]
    assert b"static const law_real K[INPUTS][MEASURED]" in files["law.c"]
    assert b"p[" not in files["law.h"]


@pytest.mark.parametrize("change", ["law.c", "law.h", "guarantee.json"])
def test_changed_files_are_not_what_is_proved(change, tmp_path):
    export_c99(design("measured"), 32).save(tmp_path)
    text = (tmp_path / change).read_text()
    if change == "guarantee.json":
        table = json.loads(text)
        table["claims"][0]["code"]["terms"][1][0][0] *= 2  # of a float32 still
        (tmp_path / change).write_text(json.dumps(table))
    else:
        (tmp_path / change).write_text(text.replace("0.0F", "0.5F").replace("OK 0U", "OK 1U"))
    assert not check_guarantee(tmp_path).proved


def test_an_observer_beside_a_law_of_signals_is_refused():
    own = design("measured")
    seen = observe(own.plant, ["suspension deflection"], Disk(-80, 79))
    with pytest.raises(InputError, match="takes measured signals, not states"):
        export_c99(own, 32, observer=seen, sampling=Sampling(0.001))


@pytest.mark.parametrize(("kind", "late"), [("measured", True), ("varying", False)])
def test_the_sampled_loop_is_proved_with_the_rounding(kind, late):
    made = export_c99(design(kind), 32, sampling=Sampling(0.001, late))
    assert made.timing.proved
    proof = made.timing.proof
    assert 0.9 * proof.sampled < proof.decay < proof.sampled
    assert proof.rounded.claim.code == made.guarantee.claim.code


def exactly(law, alpha, y):
    """u in rationals, from the definition."""
    c = law.domain.coordinates(np.array(alpha, dtype=object))
    c = c[1::2] - c[::2] if law.parameters else c
    terms = [prod((x**p for x, p in zip(c, e, strict=True)), start=Fraction(1)) for e in law.powers]
    gains = np.vectorize(Fraction, otypes=[object])(law.gains)
    return np.tensordot(np.array(terms, dtype=object), gains, 1) @ [Fraction(v) for v in y]


@pytest.mark.parametrize("kind", KINDS)
def test_expected_values_are_exact(kind):
    own = design(kind)
    code = program(own.law, own.plant.parameters, number(64))
    found = vectors(code, own.law, count=8)
    for k, (y, u) in enumerate(zip(found.x, found.u, strict=True)):
        if kind == "one gain":
            alpha = [Fraction(1, 4)] * 4
        elif kind == "alpha":
            given = [Fraction(v) for v in found.given[k]]
            alpha = [v / sum(given) for v in given]
        else:
            m1, beta = map(float, found.given[k])
            alpha = own.plant.alpha(m1=m1, beta=beta, clamp=True)
        expected = np.array(exactly(own.law, alpha, y), dtype=float)
        exact = kind in ("one gain", "alpha")
        assert np.all(np.abs(u - expected) <= (0 if exact else 1e-13) * found.scale[k])
    assert set(special(code, own.law).flags) >= {0, 4}


def test_another_law_is_refused():
    one, other = design("affine"), design("measured")
    code = program(one.law, one.plant.parameters, number(32))
    for law in (other.law, design("one gain").law):
        with pytest.raises(InputError, match="is not the law of this code"):
            vectors(code, law)


@pytest.mark.parametrize(
    ("kind", "bits", "given"),
    [
        ("square", 32, "parameters"),
        ("measured", 64, "parameters"),
        ("varying", 32, "alpha"),
        ("one gain", 32, "parameters"),
        ("alpha", 32, "alpha"),
    ],
)
def test_code_equals_the_law_on_host_and_target(emulator, kind, bits, given, tmp_path):
    made = export(design(kind), bits, tmp_path, given)
    host = made.answers(made.host("many.c", f"-DCOUNT={COUNT}U"), COUNT, "host")
    target = made.answers(made.target("many.c", f"-DCOUNT={COUNT}U"), COUNT, "target")
    assert host.tobytes() == target.tobytes()
    assert max(made.errors(host)) < ALLOWED[bits]


def test_a_polynomial_costs_less_than_a_scheduled_law(emulator, exported, tmp_path):
    """No factorisation: the same plant, as many terms, all states."""
    own = export(design("affine"), 32, tmp_path)
    counts, _ = own.counted("-O2")
    assert np.ptp(counts) <= 8
    assert counts.max() < exported("scheduled", 32).counted("-O2")[0].min() / 2


def law_gain(law, alpha):
    """The function of that name in the documentation, of polynomials."""
    powers, c = law["powers"], alpha
    if law["parameters"].size:
        N, q = len(alpha), powers.shape[1]
        high = [alpha[np.arange(N) >> (q - f) & 1 == 1].sum() for f in range(1, q + 1)]
        c = 2 * np.array(high) - 1
    terms = np.prod(c**powers, axis=1)
    K = np.sum(law["gains"] * terms.reshape(1, 1, -1), axis=2)
    C = law["C"]
    C = C[:, :, 0] if C.shape[2] == 1 else np.sum(C * alpha, axis=2)
    return K @ C


@pytest.mark.parametrize("kind", KINDS)
def test_the_file_for_matlab_gives_the_gain(kind, tmp_path):
    own = design(kind)
    law = loadmat(mat(own, tmp_path / "law.mat"))
    law["C"] = law["C"].reshape(*law["C"].shape[:2], -1)
    law["gains"] = law["gains"].reshape(*law["gains"].shape[:2], -1)
    random = np.random.default_rng(1)
    for _ in range(20):
        s, t = random.uniform(size=2)
        alpha = np.kron([1 - s, s], [1 - t, t])
        assert np.allclose(law_gain(law, alpha), own.law.gain(alpha), rtol=1e-12, atol=1e-9)
    names = [cell.item() for cell in law["measured"][0]]
    assert names == ([y.label for y in own.law.measured] or list(own.plant.states))


def test_an_fmu_has_the_signals_as_inputs():
    made = export_c99(design("varying"), 64)
    found = variables(made.program, made.texts, context(made.program, made.texts))
    names = [each.name for each in found["inputs"]]
    assert names == ["spring_force", "sprung_mass_velocity", "unsprung_mass_velocity", "m1", "beta"]
    assert found["inputs"][0].unit == "kN"
    assert "y not finite" in found["flags"].description


def test_too_many_terms_and_numbers_out_of_range_are_refused():
    own = design("affine").law
    many = [(k, j) for k in range(23) for j in range(23)]
    with pytest.raises(InputError, match="529 coefficients"):
        program(PolynomialGain(many, np.ones((529, 1, 4)), (), own.parameters), (), number(32))
    with pytest.raises(InputError, match="too large for the code"):
        program(replace(own, gains=own.gains * 1e20), (), number(32))


def test_where_rounding_may_break_the_region_the_export_is_refused():
    """A region at the loop's own slowest pole leaves no room for rounding in float32."""
    own = design("measured")
    slowest = -own.poles(np.eye(4)).real.max()  # at a vertex
    reach = analyse(own.plant, own.law, HalfPlane(slowest - 1e-6))
    with pytest.raises(NotProvedError, match="rounding in float32"):
        export_c99(reach.design, 32)
    assert export_c99(reach.design, 64).proved


def subset():
    """One gain of plain states that leaves one out, as `design --measured` saves it."""
    own = design("one gain")
    K = own.law.gain(np.full(4, 0.25))
    assert np.array_equal(K != 0, [[True, False, True, True]])
    return analyse(own.plant, FixedGain(K), REGION).design


def test_one_gain_that_leaves_out_states_is_given_the_others(tmp_path):
    own = subset()
    made = export_c99(own, 32, sampling=Sampling(0.001))
    assert made.proved
    made.save(tmp_path)
    assert check_guarantee(tmp_path).proved
    header, other = made.files["law.h"], export_c99(design("one gain"), 32).files["law.h"]
    assert b"LAW_MEASURED 3U" in header
    assert header.split(b"uint32_t law_update")[1] == other.split(b"uint32_t law_update")[1]
    assert b"with y measured" in header
    # an observer has all states
    seen = observe(own.plant, ["suspension deflection"], Disk(-80, 79))
    both = export_c99(own, 32, observer=seen, sampling=Sampling(0.001)).files
    assert b"LAW_STATES 4U" in both["law.h"]
