"""Families whose entries are functions of the parameters: against the functions themselves."""

import json
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.linalg import solve_continuous_lyapunov

import polefence as pf
from polefence.base.errors import PlantError, SpecError
from polefence.certify.bounds import best_bound, bounds_file
from polefence.law.laws import given_law
from polefence.plant.outputs import rows_at
from polefence.plant.points import seeded, values_at
from polefence.plant.spec import dumps, loads
from polefence.proof.document import check as check_file
from polefence.proof.document import from_plain
from polefence.proof.work import FormatError
from polefence.region.regions import HalfPlane
from polefence.requirements.gain import Gain
from polefence.requirements.rms import Rms
from polefence.response.discrete import exponential
from polefence.response.samples import at_sample_time

PENDULUM = """
name = "pendulum with a spring that ages"
states = ["angle [rad]", "rate [rad/s]"]
inputs = ["torque [N m]"]
disturbances = ["push [N m]"]
[parameter.l]
range = [0.5, 1.0]
[parameter.th]
range = [-0.6, 0.6]
[definitions]
J = "0.2 + 1.5*l**2"
stiff = "14.715*l*cos(th)/J + 4*sqrt(l)/J"
[matrices]
A = [[0, 1], ["-stiff", "-0.8/J"]]
B = [[0], ["1/J"]]
E = [[0], ["1/J"]]
[outputs]
"acceleration [rad/s2]" = {C = ["-stiff", "-0.8/J"], D = ["1/J"]}
"""
NONE = [[0.0, 0.0]]


def matrices(length, angle):
    J = 0.2 + 1.5 * length**2
    stiff = 14.715 * length * np.cos(angle) / J + 4 * np.sqrt(length) / J
    return np.array([[0, 1], [-stiff, -0.8 / J]]), np.array([[0], [1 / J]])


@pytest.fixture(scope="module")
def pendulum():
    return loads(PENDULUM)


def test_floats_are_the_functions(pendulum):
    signal = [pendulum.signal("acceleration")]
    for length, angle in ((0.5, -0.6), (0.7, 0.3), (0.93, -0.1)):
        alpha = pendulum.alpha(l=length, th=angle)
        A, B = matrices(length, angle)
        own = pendulum.at(alpha)
        np.testing.assert_allclose(own[0], A, rtol=1e-12)
        np.testing.assert_allclose(own[1], B, rtol=1e-12)
        np.testing.assert_allclose(pendulum.driven(alpha), B, rtol=1e-12)
        C, D, F = rows_at(pendulum, signal, alpha[None])
        np.testing.assert_allclose(C[0, 0], A[1], rtol=1e-12)
        np.testing.assert_allclose([D[0, 0, 0], F[0, 0, 0]], [B[1, 0], 0], rtol=1e-12, atol=1e-12)


def test_bounds_are_above_the_worst_and_near_it(pendulum):
    law = given_law(pendulum, np.array([[-2.0, -1.0]]))
    rms, gain = 0.0, 0.0
    for length in np.linspace(0.5, 1, 41):
        for angle in np.linspace(-0.6, 0.6, 25):
            A, B = matrices(length, angle)
            closed = A + B @ [[-2.0, -1.0]]
            X = solve_continuous_lyapunov(closed, -0.05 * B @ B.T)
            rms = max(rms, math.sqrt(closed[1] @ X @ closed[1]))
            w = np.sqrt(-closed[1, 0]) * np.linspace(0.8, 1.2, 201)
            response = np.linalg.solve(1j * w[:, None, None] * np.eye(2) - closed, B[None])
            gain = max(gain, np.abs(response[:, 0, 0]).max())
    bound = best_bound(pendulum, law, Rms(("acceleration",), density=0.1))
    assert rms < bound.level < rms * 1.005
    bound = best_bound(pendulum, law, Gain(("angle",)))
    assert gain < bound.level < gain * 1.01


@pytest.mark.parametrize(("end", "answer"), [(1.0462, "proved"), (1.0482, "refuted")])
def test_the_threshold_of_stability_is_that_of_the_function(end, answer):
    """x'' + (cos p - 0.5) x' + (1 + p^2) x = u is stable for p < pi / 3 = 1.0472 alone."""
    spec = f"""
[parameter.p]
range = [0, {end}]
[matrices]
A = [[0, 1], ["-1 - p**2", "0.5 - cos(p)"]]
B = [[0], [1]]
"""
    plant = loads(spec)
    assert pf.analyse(plant, NONE, HalfPlane(0.0)).answer == answer


def random_family(seed):
    """Two states, two parameters; entries of all kinds, and the same in floats."""
    random = np.random.default_rng(seed)
    a, b, c, d = random.uniform(0.5, 2, 4).round(3)
    low = random.uniform(0.3, 1, 2).round(3)
    high = low + random.uniform(0.2, 1.2, 2).round(3)
    texts = [
        [f"-{a} - p**2/(q + {b})", f"{c}*sin(p*q)"],
        [f"-{d}*exp(-p)*q", f"-{b} - sqrt(q)/(1 + p)"],
    ]
    spec = f"""
disturbances = ["w"]
[parameter.p]
range = [{low[0]}, {high[0]}]
[parameter.q]
range = [{low[1]}, {high[1]}]
[matrices]
A = {json.dumps(texts)}
B = [[0], ["1/(p + q)"]]
E = [["cos(q)"], ["q**1.5"]]
[outputs]
"y" = {{C = ["p**3", "log(1 + q)"]}}
"""

    def true(p, q):
        A = [[-a - p**2 / (q + b), c * np.sin(p * q)]]
        A += [[-d * np.exp(-p) * q, -b - np.sqrt(q) / (1 + p)]]
        return np.array(A), np.array([[np.cos(q)], [q**1.5]]), np.array([[p**3, np.log(1 + q)]])

    return loads(spec), true, (low, high)


@pytest.mark.parametrize("seed", range(8))
def test_no_random_bound_is_false(seed):
    plant, true, (low, high) = random_family(seed)
    law, worst = given_law(plant, np.zeros((1, 2))), 0.0
    for p in np.linspace(low[0], high[0], 15):
        for q in np.linspace(low[1], high[1], 15):
            A, E, C = true(p, q)
            assert np.linalg.eigvals(A).real.max() < 0
            X = solve_continuous_lyapunov(A, -E @ E.T / 2)
            worst = max(worst, math.sqrt((C @ X @ C.T)[0, 0]))
    bound = best_bound(plant, law, Rms(("y",)))
    assert worst * (1 - 1e-9) <= bound.level <= worst * 1.03


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("delay", [0, 1, 0.5])
def test_samples_are_within_the_remainder(seed, delay):
    plant, true, _ = random_family(seed)
    T = 0.05
    sampled = at_sample_time(plant, T, delay)
    known = sampled.remainder
    for alpha in seeded(plant, 12):
        values = values_at(plant, alpha)
        A, E, _ = true(**values)
        B = np.array([[0], [1 / (values["p"] + values["q"])]])
        whole = exponential(T * np.block([[A, B, E], [np.zeros((2, 4))]]))[:2]
        F, _ = sampled.at(alpha)
        off = np.array(known.entries, dtype=float)[:2, :2]
        assert (np.abs(F[:2, :2] - whole[:, :2]) <= off + 1e-12).all()


def test_parts_of_the_box_are_near_enough(pendulum):
    from polefence.plant.parts import inside

    sizes = []
    for side in (Fraction(1), Fraction(1, 4), Fraction(1, 16)):
        part = inside(pendulum, (Fraction(0),) * 2, (side,) * 2)
        sizes.append(max(map(max, part.remainder.entries)))
        corner = part.vertices[-1].A
        A, _ = matrices(0.5 + 0.5 * float(side), -0.6 + 1.2 * float(side))
        np.testing.assert_allclose(corner, A, rtol=1e-10)
    # of the lowest degree that is good enough
    assert max(sizes) < 18 * 2**-17


def test_specs_are_written_as_they_were(pendulum):
    again = loads(dumps(pendulum))
    assert again == pendulum
    assert again.digest == pendulum.digest
    other = loads(PENDULUM.replace("4*sqrt(l)", "4*sqrt(l**1.001)"))
    assert other.digest != pendulum.digest


@pytest.fixture(scope="module")
def proved(pendulum):
    """A file of an rms, as a table."""
    law = given_law(pendulum, np.array([[-2.0, -1.0]]))
    bound = best_bound(pendulum, law, Rms(("acceleration",), density=0.1))
    analysis = pf.analyse(pendulum, [[-2.0, -1.0]], HalfPlane(0.0))
    document = bounds_file(analysis.certificate, [bound.claim])
    return document.write()


def test_the_file_is_checked(proved):
    assert check_file(from_plain(json.loads(json.dumps(proved)))).proved


def test_what_is_said_of_an_output_tells_of_its_functions(proved):
    said = check_file(from_plain(proved)).claims[1]
    assert "at vertex 4, by functions of l and th between" in said


def _texts(table):
    return {k: item["text"] for k, item in enumerate(table["plant"]["functions"]["functions"])}


FAULTS = {
    "a larger function": lambda t: _set(t, 0, "text", lambda x: x.replace("4*", "9*")),
    "another function": lambda t: _set(t, 2, "text", lambda x: x.replace("1.5", "0.5")),
    "more of it": lambda t: t["plant"]["functions"]["functions"][0]["entries"][0].update(times=1.3),
    "another column": lambda t: t["plant"]["functions"]["functions"][2]["entries"][0].update(
        of="A", column=2
    ),
    "an output without it": lambda t: _without_output(t),
    "a wider range": lambda t: t["plant"]["parameters"][0].update(range=[0.3, 1]),
    "no functions": lambda t: t["plant"].pop("functions"),
}


def _set(table, k, key, change):
    item = table["plant"]["functions"]["functions"][k]
    changed = change(item[key])
    assert changed != item[key]
    item[key] = changed


def _without_output(table):
    for item in table["plant"]["functions"]["functions"]:
        item["entries"] = [x for x in item["entries"] if x["of"] in "ABE"]


@pytest.mark.parametrize("fault", FAULTS)
def test_one_fault_in_the_file_is_no_proof(proved, fault):
    table = json.loads(json.dumps(proved))
    FAULTS[fault](table)
    try:
        answer = check_file(from_plain(table))
    except FormatError:
        return
    assert not answer.proved


BROKEN = {
    "text": ("sin(p, 2)", "something else"),
    "of": ("G", "one of"),
    "row": (3, "whole number"),
    "column": (7, "whole number|no such column"),
    "times": ("x", "finite number"),
}


@pytest.mark.parametrize("key", BROKEN)
def test_what_is_no_function_of_the_plant_is_refused(proved, key):
    table = json.loads(json.dumps(proved))
    value, why = BROKEN[key]
    item = table["plant"]["functions"]["functions"][0]
    (item if key == "text" else item["entries"][0])[key] = value
    with pytest.raises(FormatError, match=why):
        from_plain(table)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("0.2 + 1.5*l**2", "0.5 - l**2", r"A\[2\]\[1\].*zero.*l about 0\.7"),
        ("sqrt(l)", "sqrt(l - 0.7)", "negative.*l about 0"),
        ("sqrt(l)", "squrt(l)", "neither a function nor a table.*sqrt"),
        ("sqrt(l)", "sqrt(l, 2)", "one argument"),
        ("l**2", "l**th", "a power.*not a number"),
        ("cos(th)", "spring(th)", "neither a function nor a table"),
    ],
)
def test_bad_specs_say_where(old, new, why):
    with pytest.raises((SpecError, PlantError), match=why):
        loads(PENDULUM.replace(old, new))


TABLE = """
[parameter.p]
range = [0, 3]
[table.spring]
arguments = ARGUMENTS
values = VALUES
[matrices]
A = [[0, 1], ["-spring(p)", -1]]
B = [[0], [1]]
"""


@pytest.mark.parametrize(
    ("arguments", "values", "why"),
    [
        ("[0, 2, 1, 3]", "[1, 2, 3, 4]", "table spring: arguments must rise; number 3"),
        ("[0, 1, 2]", "[1, 2, 3, 4]", "as many"),
        ("[0, 1, 2]", "[1, 2, 3]", "a table from 0 to 2 may be asked for"),
        ("[0]", "[1]", "2 to"),
        ('"x"', "[1]", "list of numbers"),
    ],
)
def test_bad_tables_say_why(arguments, values, why):
    text = TABLE.replace("ARGUMENTS", arguments).replace("VALUES", values)
    with pytest.raises((SpecError, PlantError), match=why):
        loads(text)


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_tables_are_proved(kind):
    """The least of the spring is at the knot p = 2: stable while it is above zero."""
    text = TABLE.replace("ARGUMENTS", "[0, 1, 2, 4]") + f'[table.spring]\ninterpolation = "{kind}"'
    text = TABLE.replace("values =", f'interpolation = "{kind}"\nvalues =').replace(
        "ARGUMENTS", "[0, 1, 2, 4]"
    )
    for least, answer in ((0.02, "proved"), (-0.02, "refuted")):
        plant = loads(text.replace("VALUES", f"[5, 2, {least}, 4]"))
        assert pf.analyse(plant, NONE, HalfPlane(0.0)).answer == answer


def test_python_functions_may_use_numpy():
    def plant(p, q):
        return [[-1 - p**2, np.sin(q)], [0, -np.exp(p) / q]], [[0], [1]], [[1], [np.sqrt(q)]]

    parameters = [pf.Parameter("p", 0, 1), pf.Parameter("q", 1, 2)]
    family = pf.UncertainPlant.from_function(plant, parameters)
    A, _ = family.at(family.alpha(p=0.3, q=1.7))
    np.testing.assert_allclose(A, [[-1.09, np.sin(1.7)], [0, -np.exp(0.3) / 1.7]], rtol=1e-12)
    np.testing.assert_allclose(family.driven(family.alpha(p=0.3, q=1.7))[1], np.sqrt(1.7))


def test_moving_parameters_are_kept(pendulum):
    moving = replace(
        pendulum,
        parameters=(replace(pendulum.parameters[0], rate=("-1", "1")), pendulum.parameters[1]),
    )
    assert loads(dumps(moving)) == moving


SURFACE = """
disturbances = ["w"]
[parameter.mach]
range = [0.4, 0.9]
[parameter.angle]
range = [0, 12]
[table.stiff]
arguments = [[0.2, 0.6, 1.0], [0, 5, 10, 15]]
values = [[4, 5, 5.5, 5.2], [5, 6, 7, 7.5], [4.5, 7, 9, 8]]
[matrices]
A = [[0, 1], ["-stiff(mach, angle)", "-0.5 - mach"]]
B = [[0], [1]]
E = [[0], [1]]
"""


@pytest.mark.parametrize("kind", [Rms, Gain])
def test_a_table_of_two_arguments_is_proved(kind):
    """It is that of an independent interpolation, bounds near the worst of its plants."""
    plant = loads(SURFACE)
    knots, values = [[0.2, 0.6, 1.0], [0, 5, 10, 15]], [[4, 5, 5.5, 5.2], [5, 6, 7, 7.5],
                                                        [4.5, 7, 9, 8]]  # fmt: skip
    known, alpha = RegularGridInterpolator(knots, values), seeded(plant, 300)
    worst = 0.0
    for point, A in zip(alpha, plant.at(alpha)[0], strict=True):
        at = values_at(plant, tuple(point))
        assert -A[1, 0] == pytest.approx(known([at["mach"], at["angle"]])[0])
        k, c = -A[1, 0], -A[1, 1]  # x" + c x' + k x = w, of density 1 over positive frequencies
        peak = 1 / (c * np.sqrt(k - c**2 / 4)) if c**2 < 2 * k else 1 / k
        worst = max(worst, np.sqrt(1 / (4 * c * k)) if kind is Rms else peak)
    bound = best_bound(plant, given_law(plant, NONE), kind(("x1",)))
    assert worst < bound.level < worst * 1.005
    again = loads(dumps(plant))
    assert again.functions == plant.functions
    assert bound.errors < 0.005


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("stiff(mach, angle)", "stiff(mach)", "stiff in .* takes two arguments"),
        ("[0.2, 0.6, 1.0],", "[0.2, 0.6],", "values must have 2 rows of 4"),
        ("5.5, 5.2]", "5.5]", "values must have 3 rows of 4"),
        ("[0, 5, 10, 15]", "[0, 5, 3, 15]", "arguments must rise; number 3"),
        ("[0, 5, 10, 15]]", "[0, 5, 10, 15], [0, 1]]", "two lists of them"),
        ("values =", 'interpolation = "cubic"\nvalues =', "and is 'linear'"),
        ("[0, 12]", "[0, 16]", "a table from 0 to 15 may be asked for"),
        ("[matrices]", "[constants]\nstiff_row_1 = 2\n[matrices]", "'stiff_row_1' is given twice"),
    ],
)
def test_bad_tables_of_two_arguments_say_why(old, new, why):
    with pytest.raises((SpecError, PlantError), match=why):
        loads(SURFACE.replace(old, new))


def test_a_table_of_two_arguments_in_python():
    surface = pf.Surface([0, 1, 3], [0, 2], [[1, 2], [2, 3], [5, 4]])
    plant = pf.UncertainPlant.from_expressions(
        [pf.Parameter("p", 0, 3), pf.Parameter("q", 0, 2)],
        [[0, 1], ["-f(p, q)", -1]],
        [[0], [1]],
        tables={"f": surface},
    )
    weights = np.kron([1 / 3, 2 / 3], [0.25, 0.75])  # p = 2, q = 1.5
    assert plant.at(weights[None])[0][0, 1, 0] == pytest.approx(-(0.25 * 3.5 + 0.75 * 3.5))
    with pytest.raises(PlantError, match="first = .* must be finite numbers"):
        pf.Surface([0, float("inf")], [0, 1], [[0, 0], [0, 0]])
