"""What enclosing functions of the parameters takes of a bound."""

from dataclasses import replace

import numpy as np
import pytest

from polefence.certify.bounds import _Question, best_bound
from polefence.cli.lines import errors_text
from polefence.law.laws import given_law
from polefence.lmi.solve.duals import least_in
from polefence.plant.boxes import Box
from polefence.plant.spec import loads
from polefence.requirements.gain import Gain
from polefence.requirements.rms import Rms

SPEC = """
disturbances = ["w"]
[parameter.p]
range = [0.5, 2]
[matrices]
A = [[0, 1], ["STIFFNESS", -1]]
B = [[0], [1]]
E = [[0], [1]]
"""


def bound(stiffness, kind, moving=False):
    spec = SPEC.replace("STIFFNESS", stiffness)
    spec = spec.replace("2]\n[matrices]", "2]\nrate = [-1, 1]\n[matrices]") if moving else spec
    plant = loads(spec)
    return best_bound(plant, given_law(plant, np.zeros((1, 2))), kind(("x1",)))


@pytest.mark.parametrize("kind", [Rms, Gain])
@pytest.mark.parametrize("moving", [False, True])
def test_polynomials_are_exact(kind, moving):
    found = bound("-4 - p**3/4", kind, moving)
    assert found.errors is not None
    assert found.errors < 1e-5
    assert errors_text(found).endswith("enclosing the functions takes under 0.001 % of it")


def test_nothing_is_said_where_there_are_no_functions():
    found = bound("-4 - p", Rms)
    assert found.errors is None
    assert not errors_text(found)


@pytest.mark.parametrize("kind", [Rms, Gain])
def test_without_errors_a_straight_line_stands_for_a_table(kind):
    """With a knot inside, a linear table is the line between its ends, which is a plant too."""
    table = "[table.f]\narguments = [0.5, 1, 2]\nvalues = [0, 1, 1.5]\n"
    law = np.zeros((1, 2))
    levels = []
    for text in (SPEC.replace("STIFFNESS", "-4 - f(p)") + table,
                 SPEC.replace("STIFFNESS", "-4 - (p - 0.5)")):  # fmt: skip
        plant = loads(text)
        question = _Question.of(plant, given_law(plant, law), kind(("x1",)))
        whole = Box.whole(question.problem.domain)
        problem = replace(question.problem, errors=False)
        levels.append(least_in(problem, [(whole, 2)], question.worst))
    assert levels[0] == pytest.approx(levels[1], rel=2e-3)


def test_along_a_motion_there_is_a_share():
    found = bound("-4 - 0.1*sqrt((p - 1)**2 + 1e-4)", Gain, moving=True)
    assert 1e-5 < found.errors < 1e-2
    assert f"{100 * found.errors:.1g}"[:3] in errors_text(found)


def test_an_output_that_is_a_function_has_errors_too():
    """The loop is a polynomial, which is exact; the output is none."""
    plant = loads(
        SPEC.replace("STIFFNESS", "-4 - p**2/4") + '[outputs]\ny = {C = ["sqrt(p)", 0]}\n'
    )
    found = best_bound(plant, given_law(plant, np.zeros((1, 2))), Rms(("y",)))
    assert found.claim.subject.evidence.cells == ()
    assert 0 < found.errors < 1e-3
