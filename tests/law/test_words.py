"""What a polynomial law is called: a formula that gives its gain, evaluated as it is written."""

import re

import numpy as np
import pytest

from polefence import Parameter
from polefence.law.laws import PolynomialGain
from support.polynomials import KINDS, design

P = (Parameter("m", 2, 6, "kg"), Parameter("k", "0.5", 2, "N/m", "1/k"), Parameter("z", -3, 3))


def evaluated(law, values):
    """The sum in the formula's brackets, with what the definitions say of c."""
    names = dict(values)
    for line in law.definitions:
        if line.startswith("c"):
            name, text = line.split(" = ", 1)
            names[name] = eval(text.split(":")[0], {}, dict(values))
    text = re.search(r"\((.*)\)", law.formula)[1].replace("^", "**")
    text = re.sub(r"(K\d+|c\d+(?:\*\*\d+)?) (?=c)", r"\1 * ", text)
    text = re.sub(r"(K\d+|c\d+(?:\*\*\d+)?) (?=c)", r"\1 * ", text)
    return eval(text, {}, names | law.named_gains())


def test_the_formula_as_written_is_the_gain():
    random = np.random.default_rng(0)
    powers = [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 1, 1), (2, 0, 1)]
    law = PolynomialGain(powers, random.normal(size=(5, 2, 3)), (), P)
    for _ in range(10):
        values = {p.name: random.uniform(float(p.low), float(p.high)) for p in P}
        assert np.allclose(evaluated(law, values), law.gain_at(**values), rtol=1e-4, atol=1e-5)
    assert len([line for line in law.definitions if line.startswith("c")]) == 3


def test_coordinates_that_the_law_does_not_have_are_not_explained():
    law = PolynomialGain([(0, 0, 0), (0, 1, 0)], np.ones((2, 1, 2)), (), P)
    assert law.formula == "u = (K0 + K1 c2) x"
    (line,) = law.definitions
    assert line == "c2 = (1.25 - 1/k)/0.75: -1 at k = 0.5, 1 at 2 [N/m]"


@pytest.mark.parametrize("kind", KINDS)
def test_signals_are_named(kind):
    law = design(kind).law
    assert law.formula.endswith("y" if law.measured else "x")
    assert len(law.named_gains()) == len(law.powers)
    if law.measured:
        assert law.definitions[0] == "y = " + ", ".join(own.label for own in law.measured)
