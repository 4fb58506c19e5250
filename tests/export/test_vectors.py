"""Test vectors against the law, the C test that is made of them, and faults it must find."""

import re
from fractions import Fraction

import numpy as np
import pytest

from polefence import Disk, InputError, place
from polefence.export.program import number, program
from polefence.export.vectors import (
    ALLOWED,
    CLAMPED,
    LIMITED,
    NO_CONTROL,
    NOT_A_NUMBER,
    OK,
    Ends,
    Vectors,
    special,
    vectors,
)
from support.cortex import export, run


def made(design, bits=32, given="parameters"):
    parameters = design.plant.parameters if given == "parameters" else ()
    return program(design.law, parameters, number(bits))


def same(one: Vectors, other: Vectors) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("given", "x", "u", "scale", "flags")
    )


def test_vectors_follow_from_the_seed(car_designs):
    design = car_designs["scheduled"]
    first, again, other = (vectors(made(design), design.law, seed=seed) for seed in (3, 3, 4))
    assert same(first, again)
    assert not same(first, other)


@pytest.mark.parametrize("bits", [32, 64])
@pytest.mark.parametrize("given", ["parameters", "alpha"])
def test_vectors_are_inside_and_in_the_format(car_designs, bits, given):
    design = car_designs["scheduled"]
    found = vectors(made(design, bits, given), design.law, count=200)
    for values in (found.given, found.x):
        assert np.array_equal(values, number(bits).nearest(values))
    assert np.all(found.flags == OK)
    assert np.abs(found.x).max() / np.abs(found.x).min() > 1e6
    if given == "parameters":
        bounds = [(float(p.low), float(p.high)) for p in design.plant.parameters]
        for column, (low, high) in zip(found.given.T, bounds, strict=True):
            assert low - 1e-4 <= column.min() < low + 1e-4 * (high - low)
            assert high - 1e-4 * (high - low) < column.max() <= high + 1e-4
    else:
        assert np.all(found.given >= 0)
        assert np.abs(found.given.sum(axis=1) - 1).max() < 4 * 2.0 ** -(24 if bits == 32 else 53)
        assert found.given.max() == 1


@pytest.mark.parametrize("kind", ["scheduled", "degree 2", "fixed"])
def test_expected_values_are_those_of_the_law(car_designs, kind):
    design = car_designs[kind]
    found = vectors(made(design), design.law)
    given = found.given if kind != "fixed" else np.tile([288.9, 0.0], (len(found.x), 1))
    for (m1, beta), x, u, scale in zip(given, found.x, found.u, found.scale, strict=True):
        K = design.law.gain_at(clamp=True, m1=float(m1), beta=float(beta))
        assert scale == pytest.approx(np.abs(K) @ np.abs(x), rel=1e-10)
        assert np.all(np.abs(u - K @ x) <= 1e-11 * scale)


def test_expected_values_are_exact(car_designs):
    """Against elimination in rationals: the nearest double, which `law.gain` does not give."""
    design = car_designs["scheduled"]
    found = vectors(made(design, 64, "alpha"), design.law, count=8)
    for weights, x, u in zip(found.given, found.x, found.u, strict=True):
        alpha = [Fraction(w) / sum(map(Fraction, weights)) for w in weights]
        W, Z = (
            sum(
                a * np.vectorize(Fraction, otypes=[object])(each)
                for a, each in zip(alpha, coefficients, strict=True)
            )
            for coefficients in (design.law.W, design.law.Z)
        )
        right = Z @ eliminated(W, [Fraction(v) for v in x])
        assert u[0] == float(right[0])


def eliminated(W, x):
    table = [[*row, value] for row, value in zip(W, x, strict=True)]
    for i in range(len(table)):
        table[i] = [value / table[i][i] for value in table[i]]
        for k in set(range(len(table))) - {i}:
            table[k] = [a - table[k][i] * b for a, b in zip(table[k], table[i], strict=True)]
    return np.array([row[-1] for row in table])


def test_special_vectors_have_every_fault(car_designs):
    design = car_designs["scheduled"]
    found = special(made(design), design.law)
    assert set(found.flags) == {OK, CLAMPED, NOT_A_NUMBER, CLAMPED | NOT_A_NUMBER, NO_CONTROL}
    bad = ~np.isfinite(found.x)
    assert bad.any(axis=0).all()
    assert np.array_equal(bad.any(axis=1), found.flags == NO_CONTROL)
    assert not found.u[bad.any(axis=1)].any()
    nan = np.isnan(found.given).any(axis=1)
    assert np.array_equal(nan, (found.flags & NOT_A_NUMBER) > 0)
    # outside: as at the bound; NaN: as in the middle
    below = np.flatnonzero(found.given[:, 0] == -np.inf)[0]
    K = design.law.gain_at(m1=float(design.plant.parameters[0].low), beta=0.0)
    assert found.u[below] == pytest.approx(K @ found.x[below], rel=1e-9)


def test_limits_cut_and_say_so(car_designs):
    design = car_designs["scheduled"]
    limit = 1000.0
    found = vectors(made(design), design.law, Ends((limit,)))
    free = vectors(made(design), design.law)
    assert np.array_equal(found.x, free.x)  # none near the limit
    cut = np.abs(free.u[:, 0]) > limit
    assert 0 < cut.sum() < len(cut)
    assert np.array_equal(found.flags == LIMITED, cut)
    assert np.array_equal(found.u, np.clip(free.u, -limit, limit))
    # where rounding would decide, x is another
    edge = float(np.abs(free.u[5, 0]))
    moved = vectors(made(design), design.law, Ends((edge,)))
    assert np.array_equal(moved.x[5], free.x[5] / 2)
    assert moved.flags[5] == OK


def test_another_law_is_refused(car_designs, small_designs):
    car = car_designs["scheduled"]
    for kind in ("scheduled", "quadratic"):
        with pytest.raises(InputError, match="is not the law of this code"):
            vectors(made(car), small_designs[kind].law)


def c_test(folder, *words, status=0):
    return run("make", "-s", "test", "CFLAGS=-O1 -Werror", *words, cwd=folder, status=status)


def test_the_c_test_of_many_laws_passes(host_compiler, car_designs, small_designs, tmp_path):
    cases = [(car_designs[kind], "parameters", ()) for kind in car_designs]
    cases += [(car_designs["degree 2"], "alpha", ()), (car_designs["scheduled"], "alpha", (800.0,))]
    cases += [(small_designs[kind], "alpha", (0.5, 2.0)) for kind in ("scheduled", "quadratic")]
    for k, (design, given, limits) in enumerate(cases):
        bits = (32, 64)[k % 2]
        folder = tmp_path / str(k)
        export(design, bits, folder, given, limits)
        lines = c_test(folder).splitlines()
        assert [line.split(": ")[-1] for line in lines] == ["passed (0 failed)"] * 2
        error = float(re.search(r"largest error (\S+) of", lines[0])[1])
        assert error < ALLOWED[bits]


FAULTS = {
    "a coefficient": (r"(W\[15\]\[TERMS\] = \{\n    \{ )", r"\g<1>0.001F + "),
    "a parameter not clamped": (r"result = low;", "result = value;"),
    "no flag": (r"\*flags \|= LAW_CLAMPED;", ";"),
    "NaN not replaced": (r"result = 0\.5F \* \(low \+ high\);", "result = value;"),
    "NaN gets through": (r"finite = false;", "finite = true;"),
    "a loop too short": (r"(static void substitute.*?)j > 0U", r"\1j > 1U"),
    "a sign": (r"sum -= rows\[i\]\[k\]", "sum += rows[i][k]"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_the_c_test_finds_faults(host_compiler, exported, tmp_path, fault):
    folder = exported("scheduled", 32).folder
    for name in ("law.h", "law_test.c", "Makefile"):
        (tmp_path / name).write_text((folder / name).read_text())
    code = (folder / "law.c").read_text()
    changed = re.sub(*FAULTS[fault], code, count=1, flags=re.S)
    assert changed != code
    (tmp_path / "law.c").write_text(changed)
    assert "FAILED" in c_test(tmp_path, status=2)


def test_the_makefile_can_be_told_the_tools(host_compiler, exported):
    folder = exported("scheduled", 32).folder
    c_test(folder)
    found = run("make", "-B", "-n", "test", "CC=other", "CFLAGS=-O3 -g", "RUN=emulate", cwd=folder)
    assert re.search(r"^other -std=c99 .*-Wdouble-promotion.* -O3 -g .*-c", found, re.M)
    assert "\nemulate build/law_test" in found
    assert "law_update" in run("make", "size", "SIZE=true", cwd=folder)
    run("make", "clean", cwd=folder)
    assert not (folder / "build").exists()


def test_a_law_of_many_vertices_keeps_its_vectors_small(make_random):
    """Faults of alpha are few, whatever the number of vertices."""
    design = place(make_random(1, 2, 1, 9, 0.01), Disk(-3, 2.9), "scheduled")
    found = special(made(design, given="alpha"), design.law)
    assert len(found.x) == 3 + 6 + 2 + 2
