"""Functions of the parameters: their texts, Taylor series and polynomials on parts of a box."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polefence.plant.evaluated import beyond, value_of
from polefence.proof import approximation
from polefence.proof.approximation import Functions, nodes
from polefence.proof.functions import Table, Tree, lift, parse, variable
from polefence.proof.intervals import ONE, NoValueError
from polefence.proof.polynomials import monomials
from polefence.proof.ranges import Range
from polefence.proof.work import FormatError

F = Fraction
SPRING = Table((F(0), F(1), F(2), F(4)), (F(0), F(1), F(5), F(6)))
SMOOTH = Table((F(0), F(1), F(2), F(4)), (F(0), F(1), F(5), F(6)), cubic=True)
TABLES = {"spring": SPRING, "smooth": SMOOTH}


def ranges(**ends):
    return tuple(
        Range(F(low), F(high), inverted, name)
        for name, (low, high, *[inverted]) in (
            (name, (*pair, False)[:3]) for name, pair in ends.items()
        )
    )


def sampled(functions, low, high, count=3000, seed=1):
    """Values of the functions in floats at random points of a part, and the points."""
    random, q = np.random.default_rng(seed), len(functions.ranges)
    t = random.uniform(0, 1, (count, q))
    t[: count // 2] = np.round(16 * t[: count // 2]) / 16  # corners and faces among them
    values = {}
    for k, r in enumerate(functions.ranges):
        ends = (1 / r.low, 1 / r.high) if r.inverted else (r.low, r.high)
        first, last = (float(ends[0] + (ends[1] - ends[0]) * at[k]) for at in (low, high))
        s = first + (last - first) * t[:, k]
        values[r.name] = 1 / s if r.inverted else s
    rows = [value_of(tree, values, functions.by_name) * np.ones(count) for tree in functions.trees]
    return t, rows


def polynomial(approximated, degree, t):
    """A function's polynomial at points."""
    q = t.shape[1]
    total = np.zeros(len(t))
    for at, value in zip(itertools.product((0, 1), repeat=q), approximated.corners, strict=True):
        total += float(value) * np.prod(np.where(at, t, 1 - t), axis=1)
    for e, value in zip(monomials((2,) * q, degree), approximated.curve, strict=True):
        upper = np.array(e[1::2])
        factor = [math.comb(degree, k) for k in upper]
        total += float(value) * np.prod(factor * t**upper * (1 - t) ** (degree - upper), axis=1)
    return total


CASES = [
    (["sqrt(133.6 - 16.8*r)", "1/sqrt(4.8*r - 8.6)"], ranges(r=(2, 7))),
    (["sin(t)", "cos(t)*exp(-t)", "log(4 + t)"], ranges(t=(-3, 3))),
    (["l**2*sin(t)/(1 + l)", "l*cos(t)/(0.2 + l**2)"], ranges(l=(F("0.1"), F("0.4")), t=(-1, 1))),
    (["1/(m*k - 0.2)", "k**1.5/m", "(1 + m)*(k - m)/k"], ranges(m=(1, 2), k=(1, 3))),
    (["m**3", "3/(2*m**2)"], ranges(m=(1, 2, True))),
    (["1/(m + k + c)", "m*k/c"], ranges(m=(1, 2), k=(1, 3), c=(1, 2))),
    (["spring(p)", "p*smooth(p)"], ranges(p=(0, 4))),
    (["k/m**2 - 4*sqrt(k)"], ranges(m=(1, 2, True), k=(1, 3))),
]


@pytest.mark.parametrize(("texts", "box"), CASES)
@pytest.mark.parametrize("part", ["whole", "quarter", "last"])
def test_polynomials_are_no_farther_off_than_they_say(texts, box, part):
    q = len(box)
    low, high = {
        "whole": ((F(0),) * q, (F(1),) * q),
        "quarter": ((F(1, 4),) * q, (F(1, 2),) * q),
        "last": ((F(7, 8),) * q, (F(1),) * q),
    }[part]
    names = [r.name for r in box]
    functions = Functions(
        box, tuple(parse(text, names, TABLES) for text in texts), tuple(TABLES.items())
    )
    degree, parts = functions.on_part(low, high)
    t, rows = sampled(functions, low, high)
    for text, known, true in zip(texts, parts, rows, strict=True):
        size, off = np.abs(true).max(), np.abs(polynomial(known, degree, t) - true).max()
        assert off <= float(known.error) + 1e-11 * size, text
        # on small parts nothing else is left, but of tables with a knot inside
        if part == "last" and "spring" not in text:
            assert known.error <= 1e-4 * size, text


@pytest.mark.parametrize("degree", range(1, 9))
def test_the_constants_of_interpolation_are_upper_bounds(degree):
    t, points = np.linspace(0, 1, 100_001), [float(x) for x in nodes(degree)]
    product = np.abs(np.prod([t - x for x in points], axis=0)).max()
    basis = [np.prod([(t - y) / (x - y) for y in points if y != x], axis=0) for x in points]
    lebesgue = np.abs(basis).sum(axis=0).max()
    assert product <= float(approximation.PRODUCT[degree - 1]) <= product * 1.005
    assert lebesgue <= float(approximation.LEBESGUE[degree - 1]) <= lebesgue * 1.002


def test_polynomials_are_exact():
    box = ranges(m=(F(1, 3), 2), k=(1, 3, True))
    functions = Functions(box, (parse("m**3 - m/k**2 + 2", ["m", "k"], {}),))
    degree, (known,) = functions.on_box
    assert degree == 3
    assert known.error == 0
    for t in itertools.product((F(0), F(1, 3), F(1)), repeat=2):
        m = F(1, 3) + F(5, 3) * t[0]
        k = 1 / (1 + (F(1, 3) - 1) * t[1])
        total = F(0)
        for at, value in zip(itertools.product((0, 1), repeat=2), known.corners, strict=True):
            total += value * math.prod(x if up else 1 - x for up, x in zip(at, t, strict=True))
        for e, value in zip(monomials((2, 2), 3), known.curve, strict=True):
            upper = e[1::2]
            total += value * math.prod(
                math.comb(3, j) * x**j * (1 - x) ** (3 - j) for j, x in zip(upper, t, strict=True)
            )
        assert total == m**3 - m / k**2 + 2


@pytest.mark.parametrize(("texts", "box"), [case for case in CASES if "spring" not in case[0][0]])
def test_ranges_of_derivatives_hold_differences(texts, box):
    names = [r.name for r in box]
    functions = Functions(box, tuple(parse(text, names, {}) for text in texts))
    h, q = 1e-3, len(box)
    for i in range(q):
        t = np.random.default_rng(3).uniform(2 * h, 1 - 2 * h, (500, q))
        values = []
        for k in (-2, -1, 0, 1, 2):
            moved = t.copy()
            moved[:, i] += k * h
            values.append(_values(functions, moved))
        a, b, c, d, e = values
        differences = (
            c,
            (d - b) / (2 * h),
            (d - 2 * c + b) / h**2,
            (e - 2 * d + 2 * b - a) / (2 * h**3),
        )
        for order, known in enumerate(differences):
            for row, along in zip(known, functions.derivatives, strict=True):
                low, high = (float(F(x, ONE)) for x in along[i][order])
                room = 1e-2 * max(abs(low), abs(high)) + 1e-4
                assert low - room <= row.min()
                assert row.max() <= high + room


def _values(functions, t):
    values = {}
    for k, r in enumerate(functions.ranges):
        ends = [float(1 / x if r.inverted else x) for x in (r.low, r.high)]
        s = ends[0] + (ends[1] - ends[0]) * t[:, k]
        values[r.name] = 1 / s if r.inverted else s
    rows = [value_of(tree, values, {}) for tree in functions.trees]
    return np.array([row * np.ones(len(t)) for row in rows])


def test_floats_less_the_corners_are_zero_at_the_corners():
    box = ranges(m=(1, 2, True), k=(1, 3))
    functions = Functions(box, (parse("k**2/m**3", ["m", "k"], {}), parse("sqrt(k)", ["k"], {})))
    assert np.abs(beyond(functions, np.eye(4))).max() < 1e-12
    middle = beyond(functions, np.full((1, 4), 0.25))[0]
    corners = [k**2 / m**3 for m in (1, 2) for k in (1, 3)]
    assert middle[0] == pytest.approx(2**2 * 0.75**3 - np.mean(corners))
    assert middle[1] == pytest.approx(math.sqrt(2) - (1 + math.sqrt(3)) / 2)


@given(
    st.recursive(
        st.sampled_from(["p", "q", "2", "0.25", "1/3"]),
        lambda inner: st.one_of(
            st.tuples(inner, st.sampled_from("+-*/"), inner).map(
                lambda x: f"({x[0]} {x[1]} {x[2]})"
            ),
            st.tuples(st.sampled_from(["sin", "exp", "cos", "sqrt"]), inner).map(
                lambda x: f"{x[0]}({x[1]})"
            ),
            st.tuples(inner, st.integers(-3, 3)).map(lambda x: f"({x[0]})**({x[1]})"),
        ),
        max_leaves=8,
    )
)
def test_texts_read_back_as_they_are(text):
    try:
        tree = parse(text, ["p", "q"], {})
    except FormatError:
        return  # it divides by zero
    assert parse(tree.text, ["p", "q"], {}) == tree
    values = {"p": np.asarray(0.7), "q": np.asarray(1.3)}
    with np.errstate(all="ignore"):
        known = {"sin": np.sin, "cos": np.cos, "exp": np.exp, "sqrt": np.sqrt, "p": 0.7, "q": 1.3}
        try:
            true = eval(text, {}, known)
        except ZeroDivisionError:
            return
        found = float(value_of(tree, values, {}))
    if np.isfinite(true) and abs(true) < 1e6:
        assert found == pytest.approx(float(true), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("__import__('os')", "something else"),
        ("p.real", "something else"),
        ("sin(p, q)", "something else"),
        ("tan(p)", "something else"),
        ("sin(x)", "something else"),
        ("p if q else 1", "something else"),
        ("p**q", "a number"),
        ("p**99", "from -32 to 32"),
        ("1e999", "out of range"),
        ("sin(" * 70 + "p" + ")" * 70, "nested"),
        ("p + " * 1200 + "p", "longer|nested"),
        ("1/(p - p)", "denominator"),
    ],
)
def test_what_is_no_function_is_refused(text, why):
    with pytest.raises(FormatError, match=why):
        Functions(ranges(p=(1, 2), q=(1, 2)), (parse(text, ["p", "q"], {}),)).on_box  # noqa: B018


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("1/(p*q - 4)", "p about (1.9|2).*q about (1.9|2)"),
        ("log(p - 1)", "p about 1.0"),
        ("sqrt(q - 1.5)", "q about 1"),
        ("spring(3*p)", "a table from 0 to 4"),
    ],
)
def test_where_a_value_is_missing_is_said(text, where):
    functions = Functions(
        ranges(p=(1, 2), q=(1, 2)), (parse(text, ["p", "q"], TABLES),), tuple(TABLES.items())
    )
    with pytest.raises(NoValueError, match=where):
        functions.on_box  # noqa: B018


def test_intervals_alone_refuse_no_function():
    """In one interval the denominator has a zero, in smaller ones it has none."""
    functions = Functions(ranges(p=(1, 2)), (parse("1/(p**2 - 2*p + 1.1)", ["p"], {}),))
    assert functions.on_box[1][0].error < 1


def test_cubic_tables_do_not_overshoot():
    x = np.linspace(0, 4, 401)
    y = value_of(variable("p").called("smooth"), {"p": x}, TABLES)
    assert np.diff(y).min() >= -1e-12
    at = [float(a) for a in SMOOTH.arguments]
    known = value_of(variable("p").called("smooth"), {"p": np.array(at)}, TABLES)
    np.testing.assert_allclose(known, [float(v) for v in SMOOTH.values], atol=1e-12)


def test_a_factor_is_taken_out():
    tree = parse("3*(-sin(p))*2", ["p"], {})
    assert tree.factored == (F(-6), Tree("call", (variable("p"),), "sin"))
    assert lift(2).factored == (F(1), lift(2))


@pytest.mark.parametrize("cubic", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_knots_anywhere_are_no_fault_of_the_bound(seed, cubic):
    """Knots at ends of the pieces on which derivatives are bounded, and elsewhere."""
    random = np.random.default_rng(seed)
    inner = (
        [F(1, 4), F(1, 2), F(3, 4)]
        if seed == 0
        else sorted(map(F, random.integers(1, 64, 5) * 2**-6))
    )
    knots = (F(0), *dict.fromkeys(inner), F(1))
    table = Table(knots, tuple(F(int(x), 8) for x in random.integers(-16, 16, len(knots))), cubic)
    texts = ["f(p)", "p*f(p)", "sin(3*f(p))", "q*f(p)", "f(p*q/2)"]
    box = ranges(p=(0, 1), q=(F(1, 2), 2))
    tree = tuple(parse(text, ["p", "q"], {"f": table}) for text in texts)
    functions = Functions(box, tree, (("f", table),))
    for low, high in (((F(0), F(0)), (F(1), F(1))), ((F(1, 4), F(0)), (F(1, 2), F(1, 2)))):
        degree, parts = functions.on_part(low, high)
        t, rows = sampled(functions, low, high)
        for text, known, true in zip(texts, parts, rows, strict=True):
            off = np.abs(polynomial(known, degree, t) - true).max()
            assert off <= float(known.error) + 1e-10, text
