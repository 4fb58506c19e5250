"""How far ranges may grow: against closed forms and dense samples, from both sides."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

import polefence as pf
from polefence import Disk, Gain, HalfPlane, InputError, Parameter, Rms, UncertainPlant, robust
from polefence.certify.robust.attained import attained, root_down
from polefence.certify.robust.family import Growth, short
from polefence.certify.robust.reach import _Question
from polefence.law.laws import given_law
from polefence.plant.grown import grown
from polefence.plant.points import joint
from polefence.proof.functions import Table

NONE = [[0.0, 0.0]]


def oscillator(k=(1, 3), c=(1, 2), **more):
    """x'' + c x' + k x = u + w: stable for positive k and c."""
    return UncertainPlant.from_expressions(
        [Parameter("k", *k, **more), Parameter("c", *c)],
        [[0, 1], ["-k", "-c"]],
        [[0], [1]],
        [[0], [1]],
        outputs={"x": {"C": [1, 0]}},
    )


def spring(k, c="1.5", **more):
    """The same with a stiffness that alone is uncertain."""
    return UncertainPlant.from_expressions(
        [Parameter("k", *k, **more)],
        [[0, 1], ["-k", f"-{c}"]],
        [[0], [1]],
        [[0], [1]],
        outputs={"x": {"C": [1, 0]}},
    )


def between(reach, truth, close=2e-5):
    """Whether what is proved and what fails are about a truth, and near to it."""
    return float(reach.proved) <= truth * (1 + 1e-9) and truth * (1 - 1e-9) <= float(
        reach.refuted
    ) <= float(reach.proved) * (1 + close)


def test_stability_of_an_oscillator_ends_where_a_coefficient_is_zero():
    found = robust(oscillator(k=(1, 3), c=(1, 2)), NONE)
    assert between(found.alone["k"], 2.0, 2e-4)  # k = 2 - f
    assert between(found.alone["c"], 3.0, 2e-4)  # c = 1.5 - 0.5 f
    assert between(found.largest, 2.0, 2e-4)
    assert found.largest.exact
    assert found.proved


def test_a_decay_rate_of_a_factorised_loop():
    # poles of s^2 + c s + k to the left of -a: c > 2 a and k - a c + a^2 > 0
    a = 0.1
    found = robust(oscillator(k=(1, 1.5), c=(1, 1.5)), NONE, HalfPlane(a))
    # k = 1.25 - f / 4, c = 1.25 + f / 4 ends the second, c = 1.25 - f / 4 the first
    truth = min((1.25 - a * 1.25 + a * a) / (0.25 + a * 0.25), (1.25 - 2 * a) / 0.25)
    assert between(found.largest, truth)
    at = found.largest.values
    assert at["k"] < 1
    assert at["c"] > 1.5


@pytest.mark.parametrize("seed", range(4))
def test_random_plants_against_dense_samples(seed):
    random = np.random.default_rng(seed)
    n, count = 3, 2
    A0 = random.standard_normal((n, n)) - 4 * np.eye(n)
    more = [random.standard_normal((n, n)) for _ in range(count)]
    entries = [
        [f"{A0[i, j]:.4f} + {more[0][i, j]:.4f}*p + {more[1][i, j]:.4f}*q" for j in range(n)]
        for i in range(n)
    ]
    parameters = [Parameter("p", "-0.1", "0.3"), Parameter("q", "-0.2", "0.2")]
    plant = UncertainPlant.from_expressions(parameters, entries, [[1], [0], [0]])
    rounded = [np.round(M, 4) for M in (A0, *more)]
    found = robust(plant, np.zeros((1, n)))
    t = np.linspace(-1, 1, 41)
    edge = np.concatenate([[(s, x), (x, s)] for s in (-1, 1) for x in t])

    def unstable(f):
        p, q = 0.1 + 0.2 * f * edge[:, 0], 0.2 * f * edge[:, 1]
        A = rounded[0] + p[:, None, None] * rounded[1] + q[:, None, None] * rounded[2]
        return np.linalg.eigvals(A).real.max() >= 0

    steps = np.geomspace(0.05, 40, 400)
    first = next(f for f in steps if unstable(f))
    assert float(found.largest.refuted) <= first * (1 + 1e-6)
    assert float(found.largest.proved) >= 0.98 * float(found.largest.refuted)
    for f in steps[steps <= float(found.largest.proved)]:
        assert not unstable(f)
    # the plant that fails is one of the box, and fails
    values = {k: float(v) for k, v in found.largest.values.items()}
    reach = float(found.largest.refuted) * (1 + 1e-9)
    assert max(abs(values["p"] - 0.1), abs(values["q"])) <= 0.2 * reach
    A = rounded[0] + values["p"] * rounded[1] + values["q"] * rounded[2]
    assert np.linalg.eigvals(A).real.max() > -1e-9


def test_a_published_margin_of_three_parameters():
    """De Gaston and Safonov 1988: 3.4174, of p/(s (s + q)(s + r)) behind (s + 2)/(s + 10)."""
    parameters = [Parameter("p", 720, 880), Parameter("q", "3.8", "4.2")]
    plant = UncertainPlant.from_expressions(
        [*parameters, Parameter("r", "5.7", "6.3")],
        [[0, 1, 0, 0], [0, "-q", 1, 0], ["-p", 0, "-r", "p"], [8, 0, 0, -10]],
        [[0], [0], [1], [0]],
    )
    found = robust(plant, [[0.0] * 4])
    assert 3.41735 < float(found.largest.proved) < 3.41739 < float(found.largest.refuted) < 3.4174


def test_many_vertices_are_proved_by_a_matrix_of_each(tmp_path):
    """Where an LMI of degree 1 would have 672 unknowns."""
    parameters = [Parameter("k1", 9, 11), Parameter("k2", 9, 11), Parameter("k3", 9, 11)]
    plant = UncertainPlant.from_expressions(
        [*parameters, Parameter("c", "0.8", "1.2"), Parameter("m", "0.9", "1.1", "", "1/m")],
        [
            [0, 0, 0, 1, 0, 0],
            [0, 0, 0, 0, 1, 0],
            [0, 0, 0, 0, 0, 1],
            ["-k1 - k2", "k2", 0, "-c", 0.5, 0],
            ["k2", "-k2 - k3", "k3", 0.5, -1, 0.5],
            [0, "k3/m", "-k3/m", 0, "0.5/m", "-0.5/m"],
        ],
        [[0], [0], [0], [0], [0], ["1/m"]],
    )
    law = [[-4.0, 0.0, -1.0, -1.0, 0.0, -0.3]]
    growth = Growth(plant, given_law(plant, law))
    found = _Question(growth, HalfPlane(0), ()).reach(growth.names)
    assert found.exact
    assert found.proved > found.refuted / 2
    assert pf.check(found.design.save(tmp_path)).proved


def test_a_limit_on_a_gain_is_lost_where_its_closed_form_is():
    # the gain of 1 / (s^2 + c s + k) is 1 / k where c^2 >= 2 k
    plant = spring((0.5, 0.7), 2.5)
    found = robust(plant, NONE, limits=[Gain("x", at_most=2.5)])
    assert between(found.largest, 2.0)  # k = 0.6 - 0.1 f = 0.4
    assert found.largest.exact
    assert "gain of x <= 2.5" in found.largest.reason
    (worst,) = found.worst
    assert worst.exact
    assert 2 * (1 - 1e-4) <= worst.attained <= 2 <= worst.bound.level <= 2 * (1 + 1e-3)
    assert worst.values["k"] == pytest.approx(0.5)


def test_what_is_saved_is_proved_by_check(tmp_path):
    found = robust(oscillator(), NONE, HalfPlane(0.1), [Rms("x", 2.0, density=1.0)])
    path = found.save(tmp_path)
    checked = pf.check(path)
    assert checked.proved
    assert "rms of 'x'" in " ".join(checked.claims)
    plant = found.largest.design.plant
    own = plant.parameters[0]
    assert (own.low + own.high) / 2 == 2
    assert (own.high - own.low) / 2 == found.largest.proved


def test_it_ends_where_the_plant_does():
    plant = UncertainPlant.from_expressions(
        [Parameter("m", 1, 3, "kg", "1/m")], [[0, 1], ["-2/m", "-1/m"]], [[0], ["1/m"]]
    )
    found = robust(plant, NONE)
    assert found.largest.whole
    assert found.largest.refuted is None
    assert 1.999 <= float(found.largest.proved) < 2
    assert found.largest.end == "until m = 0, where the plant does not exist"
    assert found.largest.design.plant.parameters[0].low > 0


def test_a_table_ends_the_growth():
    table = Table(tuple(map(Fraction, (-1, 1, 4))), tuple(map(Fraction, (2, 3, 5))))
    plant = UncertainPlant.from_expressions(
        [Parameter("d", 0, 2)],
        [[0, 1], ["-stiff(d)", -1]],
        [[0], [1]],
        tables={"stiff": table},
    )
    found = robust(plant, NONE)
    assert found.largest.whole
    assert 1.999 <= float(found.largest.proved) <= 2  # d = 1 - f = -1
    assert "a table from -1 to 4" in found.largest.end


def test_functions_of_the_parameters_are_read_on_the_larger_range():
    # k = 2 + sin(p), c = 1.2 - p^2 / 2: at p = 0 + f the damping ends, at f^2 = 2.4
    plant = UncertainPlant.from_expressions(
        [Parameter("p", -1, 1)], [[0, 1], ["-2 - sin(p)", "-1.2 + p**2/2"]], [[0], [1]]
    )
    found = robust(plant, NONE)
    assert between(found.largest, np.sqrt(2.4), 2e-3)


def test_a_parameter_that_is_refuted_below_its_own_range_has_a_smaller_factor():
    found = robust(oscillator(k=(-1, 3), c=(1, 2)), NONE)  # k = 1 - 2 f
    assert between(found.largest, 0.5, 2e-3)
    assert not found.proved


def test_a_law_that_fails_at_the_centre_is_refuted_there():
    found = robust(oscillator(), [[5.0, 0.0]])
    assert found.refuted == "the pole 1.13746 is not in half_plane(0)"
    assert found.largest.proved is None
    with pytest.raises(InputError, match="nothing to save"):
        found.save("nowhere")


def test_a_scheduled_law_is_the_same_polynomial_beyond():
    plant = oscillator(k=(1, 2))
    law = [["-3 + 2*k", "-1"]]  # u = (2 k - 3) x - v: the stiffness is 3 - k
    found = robust(plant, law)
    assert between(found.largest, 3.0, 2e-4)  # k = 1.5 + f / 2 = 3
    assert found.largest.values["k"] >= 3


def test_a_quotient_of_polynomials_too(tmp_path):
    plant = oscillator(k=(1, 2))
    design = pf.place(plant, Disk(-3, 2.5))
    found = robust(plant, design)
    assert found.largest.proved > 1
    assert pf.check(found.save(tmp_path)).proved
    ends = Growth(plant, given_law(plant, design)).at({"k": Fraction(2), "c": Fraction(1)})
    x = [0.7, -0.2]
    inner = design.law.gain_at(k=1.5, c=1.2) @ x
    np.testing.assert_allclose(ends.law.gain_at(k=1.5, c=1.2) @ x, inner, rtol=1e-9)


def test_rates_stay_while_ranges_grow():
    moving = spring((2, 3), rate=(-0.01, 0.01))
    found = robust(moving, NONE)
    assert found.largest.design.plant.moving[0].rate == moving.moving[0].rate
    assert between(found.largest, 5.0, 0.1)  # k = 2.5 - f / 2


def test_ranges_that_are_proved_have_a_factor_of_one_at_least():
    # at any rate only one common quadratic function serves: at k up to 3.82 one does, little beyond
    plant = spring((0, "3.82"), 1, rate="any")
    shifted = [[-2.0, 0.0]]  # the stiffness is 2 + k
    assert pf.analyse(plant, shifted, HalfPlane(0)).proved
    assert 1 <= float(robust(plant, shifted).largest.proved) < 1.01


def test_an_own_state_and_samples_grow_with_the_plant(tmp_path):
    plant = pf.at_sample_time(spring((1, 1.2), "0.55"), 0.1)
    found = robust(plant, pf.Compensator([[0.5]], [[1]], [[0.1]], [[0]], sample_time=0.1,
                                         measured=["x1"]))  # fmt: skip
    reach = found.largest
    assert reach.proved > 1
    assert float(reach.refuted) <= float(reach.proved) * 1.01
    assert pf.check(found.save(tmp_path)).proved
    # the same loop by hand, at the plant that fails and just inside
    for factor, stable in ((1 - 1e-2, True), (1 + 1e-2, False)):
        middle = Fraction("1.1")
        k = float(middle + (reach.values["k"] - middle) * Fraction(factor))
        M = np.zeros((3, 3))
        M[:2, :2], M[1, 2] = [[0, 1], [-k, -0.55]], 1
        F = expm(0.1 * M)
        loop = np.block([[F[:2, :2], 0.1 * F[:2, 2:]], [np.array([[1.0, 0.0, 0.5]])]])
        assert (np.abs(np.linalg.eigvals(loop)).max() < 1) == stable


def test_a_dead_time_stays_as_it_is():
    plain = UncertainPlant.from_expressions(
        [Parameter("k", 2, 3)], [[0, 1], ["-k", -1]], [[0], [1]], [[0], [1]]
    )
    late = pf.with_dead_time(plain, "u1", 0.05, order=1)
    growth = Growth(late, given_law(late, [[-1.0, -1.0, 0.0]]))
    assert growth.names == ("k",)
    family = growth.at({"k": Fraction(2)})
    assert family.plant.parameters[1] == late.parameters[1]
    assert family.plant.parameters[0].low == Fraction(3, 2)


def test_grown_is_what_the_same_expressions_say():
    def plant(k, m):
        return UncertainPlant.from_expressions(
            [Parameter("k", *k), Parameter("m", *m, "", "1/m")],
            [[0, 1], ["-k/m", "-0.3*k"]],
            [[0], ["1/m"]],
            [["k"], [0]],
            outputs={"a": {"C": ["-k/m", 0], "D": ["1/m"], "F": ["k"]}, "x": {"C": [1, 0]}},
        )

    k, m = (Fraction(-1), Fraction(7)), (Fraction(1, 3), Fraction(9))
    assert grown(plant((1, 2), (2, 4)), {"k": k, "m": m}) == plant(k, m)


@pytest.mark.parametrize("step", [None, Fraction(1, 10)])
def test_what_is_attained_is_below_the_truth_and_near_it(step):
    if step is None:
        plant = oscillator(k=(1, 3), c=(0.2, 0.4))
        k, c = Fraction(3), Fraction(1, 5)
        truth = 1 / (0.2 * np.sqrt(3 - 0.01))  # of 1 / (s^2 + c s + k), lightly damped
    else:
        plant = UncertainPlant.from_expressions(
            [Parameter("k", "0.1", "0.9"), Parameter("c", 1, 2)],
            [["k", 0], [0, "0.1*c"]],
            [[1], [1]],
            [[1], [0]],
            sample_time=step,
            outputs={"x": {"C": [1, 0]}},
        )
        k, c = Fraction(9, 10), Fraction(1)
        truth = 10.0  # of 1 / (z - 0.9) at z = 1
    law = given_law(plant, NONE)
    alpha = joint([p.weights(v) for p, v in zip(plant.parameters, (k, c), strict=True)])
    value = root_down(attained(plant, law, Gain("x"), alpha))
    assert truth * (1 - 1e-6) <= value <= truth * (1 + 1e-12)
    if step is None:  # the variance of white noise of intensity 1/2 is 1 / (4 c k)
        value = root_down(attained(plant, law, Rms("x", density=1.0), alpha))
        assert value == pytest.approx(np.sqrt(1 / (4 * 0.2 * 3)), rel=1e-12)


TABLE = pf.GainTable(oscillator().parameters, {"k": [1, 3], "c": [1, 2]}, np.zeros((2, 2, 1, 2)))


def test_factors_are_short_and_on_their_side():
    for x in (Fraction(1, 3), Fraction(20000001, 7), Fraction(1, 70000)):
        low, high = short(x, up=False), short(x, up=True)
        assert low <= x <= high
        assert high - low <= x * Fraction(1, 10**6)
    assert short(Fraction(5, 2), up=True) == short(Fraction(5, 2), up=False) == Fraction(5, 2)


@pytest.mark.parametrize(
    ("plant", "law", "said"),
    [
        (UncertainPlant.from_vertices([[[-1]], [[-2]]], [[[1]], [[1]]]), [[0.0]], "by vertices"),
        (UncertainPlant.from_vertices([[[-1]]], [[[1]]]), [[0.0]], "by one vertex"),
        (
            oscillator(),
            pf.GainTable(
                oscillator().parameters, {"k": [1, 3], "c": [1, 2]}, np.zeros((2, 2, 1, 2))
            ),
            "ends at its outer knots",
        ),
    ],
)
def test_what_cannot_grow_is_refused_in_one_line(plant, law, said):
    with pytest.raises(InputError, match=said) as refused:
        robust(plant, law)
    assert "\n" not in str(refused.value)


def test_a_law_in_the_weights_of_vertices_is_refused():
    plant = oscillator()
    law = pf.PolynomialGain(np.eye(4, dtype=int).tolist(), np.zeros((4, 1, 2)))
    with pytest.raises(InputError, match="weights of the vertices"):
        robust(plant, law)


def test_an_unknown_limit_is_refused():
    with pytest.raises(InputError, match="no signal 'y'"):
        robust(oscillator(), NONE, limits=[Gain("y")])
