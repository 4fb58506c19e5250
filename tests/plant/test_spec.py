"""Spec files: what they mean, and that they survive being written."""

from fractions import Fraction

from polefence.examples import family
from polefence.plant.spec import loads

VERTICES = """
name = "two masses"
[[vertex]]
A = [[0.0, 1.0], [-2.0, -0.3]]
B = [[0.0], [1.0]]
E = [[0.0], [1.0]]
[[vertex]]
A = [[0, 1], ["-7/3", -0.1]]
B = [[0], [1e-1]]
E = [[0], [1]]
"""


def test_decimals_are_exact():
    plant = loads(VERTICES)
    assert plant.vertices[0].exact_A[1][1] == Fraction(-3, 10)
    assert plant.vertices[1].exact_A[1][0] == Fraction(-7, 3)
    assert plant.vertices[1].exact_B[1][0] == Fraction(1, 10)


def test_vertex_order_is_first_parameter_slowest():
    car = family("quarter-car-as-printed")
    masses = [1 / v.exact_B[2][0] for v in car.vertices]
    assert masses == [Fraction("231.12")] * 2 + [Fraction("346.68")] * 2
    stiffness = [v.exact_A[2][0] / v.exact_B[2][0] for v in car.vertices]
    assert stiffness == [Fraction("231.12"), Fraction("346.68")] * 2


def test_definitions_may_use_each_other_in_any_order():
    plant = loads(
        """
        [parameter.p]
        range = [1, 2]
        [definitions]
        a = "2*b"
        b = "p + 1"
        [matrices]
        A = [["a"]]
        B = [[1]]
        """
    )
    assert [v.exact_A[0][0] for v in plant.vertices] == [4, 6]
