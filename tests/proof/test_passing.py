"""Laws into whose signals disturbances pass straight, u = K (C x + F w): bounds, files, faults."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

import polefence as pf
from polefence.certify import bounds
from polefence.certify.given import analyse
from polefence.law.laws import FixedGain, PolynomialGain
from polefence.plant.family import UncertainPlant
from polefence.plant.outputs import Output
from polefence.plant.parameters import Parameter
from polefence.plant.spec import loads as load_text
from polefence.proof.claims.base import prove
from polefence.proof.claims.signal import Subject
from polefence.proof.document import check, loads
from polefence.proof.laws import Evidence
from polefence.proof.remainder import Spread
from polefence.proof.work import FormatError
from polefence.region.regions import HalfPlane
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.gain import Gain
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms
from polefence.requirements.saturation import Saturation
from support.truths import false

KINDS = {
    "rms": Rms("z2", density=2),
    "relative rms": RelativeRms("z2"),
    "energy peak": EnergyPeak("z2", norm=1),
    "gain": Gain(["z1", "z2"]),
    "initial peak": InitialPeak("z2", impulse=1),
}
FREE_OF_DIRECT_WAYS = 1  # of the two outputs


class Family:
    """A random plant of three states, all matrices of which vary, and a law of its signals."""

    def __init__(self, seed, count, degree=1):
        random, self.count = np.random.default_rng(seed), count
        self.signs = np.array(list(product((-1, 1), repeat=count))).reshape(2**count, count)

        def varying(*shape, about=None):
            about = random.normal(size=shape) if about is None else about
            return about + np.tensordot(self.signs, 0.1 * random.normal(size=(count, *shape)), 1)

        A = random.normal(size=(3, 3))
        A -= (np.linalg.eigvals(A).real.max() + 1) * np.eye(3)
        self.A, self.B, self.E = varying(3, 3, about=A), varying(3, 2), varying(3, 2)
        self.C, self.D, self.F = varying(2, 3), varying(2, 2), varying(2, 2)
        self.D[:, FREE_OF_DIRECT_WAYS] = self.F[:, FREE_OF_DIRECT_WAYS] = 0
        self.Cy, self.Fy = varying(2, 3), varying(2, 2)
        parameters = tuple(Parameter(f"p{k}", -1, 1) for k in range(count))
        shown = tuple(
            Output(f"z{i + 1}", "", self.C[:, i], self.D[:, i], self.F[:, i]) for i in range(2)
        )
        seen = tuple(Output(f"y{i + 1}", "", self.Cy[:, i], F=self.Fy[:, i]) for i in range(2))
        plant = UncertainPlant.from_vertices(list(self.A), list(self.B), list(self.E))
        self.plant = replace(plant, parameters=parameters, outputs=(*shown, *seen))
        self.powers = tuple((k, *(0,) * (count - 1)) for k in range(degree + 1)) if count else ((),)
        if not count:
            self.powers = ((0,),)
        self.gains = 0.12 * random.normal(size=(len(self.powers), 2, 2))
        measured = tuple(self.plant.signal(y.name) for y in seen)
        self.law = PolynomialGain(self.powers, self.gains, measured, parameters)

    def loops(self, steps=9):
        """A, E, C and F of the loop, and A, E, C without control, at a grid of the parameters."""
        for p in product(np.linspace(-1, 1, steps), repeat=self.count):
            weights = np.prod((1 + self.signs * np.array(p)) / 2, axis=1)
            pairs = zip(self.powers, self.gains, strict=True)
            K = sum(np.prod(np.power(p, e)) * G for e, G in pairs) if self.count else self.gains[0]
            A, B, E, C, D, F, Cy, Fy = (
                np.tensordot(weights, M, 1)
                for M in (self.A, self.B, self.E, self.C, self.D, self.F, self.Cy, self.Fy)
            )
            bare = A, E, C
            yield (A + B @ K @ Cy, E + B @ K @ Fy, C + D @ K @ Cy, F + D @ K @ Fy), bare

    def worst(self, kind):
        """What is bounded, by SciPy."""
        return max(measured(kind, *both) for both in self.loops())


def measured(kind, loop, bare):
    A, E, C, F = loop
    one = C[FREE_OF_DIRECT_WAYS]
    assert np.linalg.eigvals(A).real.max() < 0
    if kind == "gain":
        w = np.concatenate([[0.0], np.geomspace(1e-2, 1e3, 500)])
        away = 1j * w[:, None, None] * np.eye(len(A)) - A
        return np.linalg.norm(C @ np.linalg.solve(away, E + 0j) + F, 2, (1, 2)).max()
    if kind == "initial peak":
        step, x, most = expm(A * 0.02), E, 0.0
        for _ in range(400):
            most, x = max(most, np.abs(one @ x).max()), step @ x
        return most
    own = one @ solve_continuous_lyapunov(A, -E @ E.T) @ one
    if kind != "relative rms":
        return own**0.5
    A, E, C = bare
    other = C[FREE_OF_DIRECT_WAYS] @ solve_continuous_lyapunov(A, -E @ E.T)
    return (own / (other @ C[FREE_OF_DIRECT_WAYS])) ** 0.5


@pytest.mark.parametrize(("seed", "count", "degree"), [(3, 2, 1), (5, 1, 2), (7, 1, 1), (11, 0, 0)])
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_proved_is_near_the_worst_case_and_no_less(kind, seed, count, degree):
    family = Family(seed, count, degree)
    worst = family.worst(kind)
    bound = bounds.best_bound(family.plant, family.law, KINDS[kind])
    # one X for all starts is no closer to a peak in general
    most = 1.6 if kind == "initial peak" else 1.01
    assert worst * (1 - 1e-4) <= bound.level <= worst * most
    assert prove(bound.claim).proved
    assert not prove(replace(bound.claim, level=Fraction(worst * 0.999))).proved
    points = pf.certify.bounds.seeded(family.plant)[:200]
    assert KINDS[kind].values(family.plant, family.law, points).max() <= bound.level * (1 + 1e-6)


@pytest.mark.parametrize("kind", ["rms", "gain"])
def test_every_form_of_evidence_takes_it(kind):
    """By the transfer function, the dual form, its parts, and an LMI."""
    family = Family(3, 1, 2)
    worst, question = family.worst(kind), bounds._Question.of(family.plant, family.law, KINDS[kind])
    forms = bounds._by_transfer, bounds._dual_bounds, bounds._climbed
    for form in forms:
        every = list(form(question))
        assert every, form
        assert worst * (1 - 1e-4) <= min(bound.level for bound in every) <= worst * 1.1
    assert question.in_parts(worst * 1.02).level <= worst * 1.02
    assert question.in_parts(worst * 0.99) is None


def test_a_law_that_loses_what_passes_is_another():
    """Else nothing would be tested above: the same gain of the states alone has other bounds."""
    family = Family(11, 0)
    bare = FixedGain(family.gains[0] @ family.Cy[0])
    for own in KINDS.values():
        one, other = (bounds.best_bound(family.plant, law, own) for law in (family.law, bare))
        assert abs(one.level / other.level - 1) > 0.02


def test_parts_of_the_box_have_what_passes_there():
    family = Family(5, 2)
    low, high = (Fraction(1, 4), Fraction(0)), (Fraction(3, 4), Fraction(1, 2))
    whole, part = family.law.exact, family.law.exact.inside(low, high)
    for t in ((Fraction(1, 3), Fraction(1, 5)), (Fraction(1), Fraction(0))):
        there = [a + (b - a) * x for a, b, x in zip(low, high, t, strict=True)]
        for one, at in ((whole, there), (part, t)):
            alpha = [(1 - at[0], at[0])[i] * (1 - at[1], at[1])[j] for i in (0, 1) for j in (0, 1)]
            passing = one.passing((2, 2))
            ends = [1 - at[0], at[0], 1 - at[1], at[1]]
            value = (
                sum(
                    np.prod([float(x) ** p for x, p in zip(ends, e, strict=True)]) * np.array(M)
                    for e, M in passing.terms.items()
                )
                / passing.whole
            )
            expected = family.law.passing(np.array([float(a) for a in alpha]))
            if one is whole:
                known = value
                assert value == pytest.approx(expected)
        assert value == pytest.approx(known)


SIGNALS = ("z2", "u1")


@pytest.mark.parametrize(
    "own",
    [
        Rms(["z1", "z2"], density=1),
        EnergyPeak("u1", norm=1),
        InitialPeak("z1", impulse=1),
        RelativeRms("z1"),
    ],
    ids=lambda own: own.title,
)
def test_what_has_no_bound_is_refused(own):
    family = Family(11, 0)
    for bounded in (bounds.best_bound, bounds.kept_bound, bounds.sampled):
        with pytest.raises(pf.InputError, match="passes straight into"):
            bounded(family.plant, family.law, replace(own, at_most=100.0))


@pytest.fixture(scope="module")
def document(every_file):
    table = json.loads((every_file / "passing/design.json").read_text())
    assert check(loads(json.dumps(table))).proved
    assert not false(table)
    return table


def outcome(table):
    """Whether a file is proved; not where it is refused."""
    try:
        return check(loads(json.dumps(table))).proved
    except FormatError:
        return False


def seen(table, name):
    return next(y for y in table["plant"]["outputs"] if y["name"] == name)


@pytest.mark.parametrize(
    ("name", "times"),
    [("error", 0.9), ("error", 0.0), ("error", 4.0), ("error", -1.0), ("slip", 1.1), ("slip", 2.0),
     ("slip", -3.0), ("slip", 100.0)],
)  # fmt: skip
def test_another_F_of_what_is_measured_is_refused(document, name, times):
    """One signal at a time: more passes into the velocity, E + B K F = 1 - 3 / 2 + 4 / 4."""
    table = copy.deepcopy(document)
    rows = seen(table, name)["F"]
    seen(table, name)["F"] = [[times * x for x in row] for row in rows]
    assert false(table)
    assert not outcome(table)


@pytest.mark.parametrize("times", [0.999, 1.001, 1.1, 1.5])
def test_no_other_F_makes_a_false_file_proved(document, times):
    for name in ("error", "slip"):
        table = copy.deepcopy(document)
        rows = seen(table, name)["F"]
        seen(table, name)["F"] = [[times * x for x in row] for row in rows]
        assert not (false(table) and outcome(table))


@pytest.mark.parametrize("vertex", [0, 1])
def test_one_vertex_with_another_F_is_refused(document, vertex):
    table = copy.deepcopy(document)
    seen(table, "error")["F"] = [[1.5 if k == vertex else 0.5] for k in range(2)]
    assert false(table)
    assert not outcome(table)


def test_rows_of_F_that_do_not_fit_are_refused(document):
    for rows in ([[0.5]] * 3, [[0.5, 0]], [[]], [["x"]], 0.5):
        table = copy.deepcopy(document)
        seen(table, "error")["F"] = rows
        with pytest.raises(FormatError):
            loads(json.dumps(table))


def test_an_F_that_is_left_out_is_another_loop(document):
    """The poles are as they were, and what is bounded is not: here it is more."""
    table = copy.deepcopy(document)
    for name in ("error", "slip"):
        seen(table, name).pop("F")
    assert false(table)
    assert not outcome(table)


def test_the_file_says_what_passes(document):
    file = loads(json.dumps(document))
    assert "'error' = x1 + 0.5 w1" in file.claims[0].statement(file.plant)


def test_inputs_that_saturate_take_no_disturbance():
    family = Family(11, 0)
    own = Saturation("u1", norm=0.1, at_most=50)
    with pytest.raises(pf.InputError, match="passes straight into 'u1'"):
        bounds.best_bound(family.plant, family.law, own)
    assert analyse(family.plant, family.law, HalfPlane(0.05)).proved


FUNCTIONS = """name = "functions"
states = ["x", "v"]
inputs = ["u"]
disturbances = ["push", "noise"]
[parameter.k]
range = [1, 2]
[matrices]
A = [[0, 1], ["-sqrt(k)", -1]]
B = [[0], ["1/(1 + k)"]]
E = [[0, 0], ["exp(-k)", 0]]
[outputs]
"y" = {C = [1, 0], F = [0, 0.5]}
"z" = {C = [0, 1], F = [0.25, 0]}
"""


def of_functions(kind, k):
    """What is bounded of x, at a value of the parameter, by the functions themselves."""
    K = np.array([[-3, -4]]) + 2 * (k - 1.5) * np.array([[0.25, -0.5]])
    A, B = np.array([[0, 1], [-np.sqrt(k), -1]]), np.array([[0], [1 / (1 + k)]])
    A, E = A + B @ K, np.array([[0, 0], [np.exp(-k), 0]]) + B @ K @ np.array([[0, 0.5], [0.25, 0]])
    if kind != "gain":
        return solve_continuous_lyapunov(A, -E @ E.T)[0, 0] ** 0.5
    w = np.concatenate([[0.0], np.geomspace(1e-2, 1e2, 400)])
    away = 1j * w[:, None, None] * np.eye(2) - A
    return np.linalg.norm(np.linalg.solve(away, E + 0j)[:, :1], 2, (1, 2)).max()


@pytest.mark.parametrize(
    "own", [Rms("x", density=2), EnergyPeak("x", norm=1), Gain("x")], ids=lambda own: own.kind
)
def test_functions_of_the_parameters_are_off_by_what_passes_too(own):
    plant = load_text(FUNCTIONS)
    measured = plant.signal("y"), plant.signal("z")
    gains = [[[-3, -4]], [[0.25, -0.5]]]
    law = PolynomialGain(((0,), (1,)), gains, measured, plant.parameters)
    bound = bounds.best_bound(plant, law, own)
    worst = max(of_functions(own.kind, k) for k in np.linspace(1, 2, 41))
    assert worst * (1 - 1e-6) <= bound.level <= worst * 1.005
    assert not prove(replace(bound.claim, level=Fraction(worst * 0.999))).proved
    question = bounds._Question.of(plant, law, own)
    for form in (bounds._dual_bounds, bounds._climbed):
        for found in form(question):
            assert worst * (1 - 1e-6) <= found.level <= worst * 1.05
            assert found.claim.subject.remainder is not None


@pytest.mark.parametrize("seed", range(4))
def test_what_a_remainder_moves_is_bounded_by_its_columns(seed):
    """G'G <= diag(d)^2 for G = diag(columns) [K F; I] diag(scales), at many alphas."""
    family, random = Family(seed, 2, 2), np.random.default_rng(seed)
    columns = tuple(map(Fraction, random.uniform(0.1, 2, 7)))
    scales = tuple(map(Fraction, random.uniform(0.1, 2, 2)))
    evidence = Evidence([], spread=Spread([], (Fraction(1),) * 3, columns))
    matrices = ([M.tolist() for M in each] for each in (family.A, family.B, family.E))
    subject = Subject(*matrices, family.law.exact, evidence, "box")
    d = np.array(subject.off(scales), dtype=float)
    of_u, of_w = (np.array(part, dtype=float) for part in (columns[3:5], columns[5:]))
    nearest = np.inf
    for alpha in family.plant.domain.alpha(random.dirichlet([1, 1], (200, 2)).reshape(200, 4)):
        P = family.law.passing(alpha)
        G = np.vstack([of_u[:, None] * P, np.diag(of_w)]) * np.array(scales, dtype=float)
        least = np.linalg.eigvalsh(np.diag(d**2) - G.T @ G).min()
        assert least >= -1e-12
        nearest = min(nearest, least / (d**2).max())
    assert nearest < 0.5
