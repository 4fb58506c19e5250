"""Weights and references: frequency responses against those of python-control's systems."""

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from polefence import (
    InputError,
    SpecError,
    UncertainPlant,
    at_sample_time,
    with_actuator,
    with_reference,
    with_sensor,
    with_weight,
)
from polefence.certify.certificate import file_plant, plant_of
from polefence.plant.delta import delta_form
from polefence.plant.outputs import Output, rows_at, states
from polefence.plant.spec import dumps, loads
from polefence.plant.weights import measurable, weights_poles
from support.specs import SPRING, TWO_STATES

SIGNALS = ("y1", "y2", "x2", "u1")
WEIGHTS = """
[reference.command]
signal = "x"
[[weight]]
signal = "error of x"
transfer = "(s + 50)/(s + 500)"
name = "performance [m]"
[[weight]]
signal = "force"
zeros = [-1]
poles = [-10, -20]
gain = 3
[[weight]]
signal = "w"
numerator = [2]
denominator = [1, 0.5]
"""
# Damping that is no polynomial, in A, B, E and an output.
CURVED = """
name = "curved"
disturbances = ["w"]
[parameter.p]
range = [0.5, 2]
[matrices]
A = [[0, 1], ["-1/p", "-sqrt(p)"]]
B = [[0], ["1/p"]]
E = [[0], ["sin(p)"]]
[outputs]
"y" = {C = ["sqrt(p)", 0], F = ["exp(-p)"]}
"""


def random_plant(seed: int, T: float | None = None) -> UncertainPlant:
    """Two vertices of three states, two inputs, two disturbances and two outputs with D and F."""
    random = np.random.default_rng(seed)
    As, Bs, Es = ([random.normal(size=(3, k)).round(3) for _ in range(2)] for k in (3, 2, 2))
    outputs = tuple(
        Output(f"y{i + 1}", "m", *(random.normal(size=(2, k)).round(2) for k in (3, 2, 2)))
        for i in range(2)
    )
    return UncertainPlant.from_vertices(As, Bs, Es, outputs=outputs, sample_time=T)


def random_weight(seed: int, letter: str = "s") -> tuple[str, control.TransferFunction]:
    """Return a proper and stable one as text, and what python-control makes of it."""
    random = np.random.default_rng(seed)
    terms, system = list[str](), control.tf(1, 1)
    for _ in range(int(random.integers(0, 4))):
        a, b, c = (float(x) for x in random.uniform(0.5, 9, 3).round(2))
        k = int(random.integers(0, 3))
        if letter == "z":
            a, b, c = a / 10, b / 10, c / 10
        terms.append(
            [f"({a:.3f}*{letter} + {b:.3f})/({letter} {'-' if letter == 'z' else '+'} {c:.3f})",
             f"{a:.3f}/({letter}**2 + {b / 5:.3f}*{letter} + {c / 10:.3f})",
             f"-{a:.3f}/(2*{letter} + {b:.3f})"][k]
        )  # fmt: skip
        top, bottom = (
            ([a, b], [1, -c if letter == "z" else c]),
            ([a], [1, b / 5, c / 10]),
            ([-a], [2, b]),
        )[k]
        rounded = ([round(x, 3) for x in row] for row in (top, bottom))
        system *= control.tf(*rounded)
    if letter == "z" and any(abs(system.poles()) >= 0.99):
        return random_weight(seed + 1000, letter)
    return " * ".join(terms) or "3/4", system if terms else control.tf(0.75, 1)


def responses(plant: UncertainPlant, s: complex, signal: str) -> np.ndarray:
    """From inputs and disturbances to a signal at a complex frequency, at each vertex."""
    every = []
    for j, own in enumerate(plant.vertices):
        C, D, F = (rows[j] for rows in plant.signal(signal).arrays(plant))
        into = np.hstack([own.B] if own.E is None else [own.B, own.E])
        through = C @ np.linalg.solve(s * np.eye(len(own.A)) - own.A, into)
        every.append(through + np.concatenate([D, F]))
    return np.array(every)


@given(st.integers(0, 99), st.sampled_from(SIGNALS), st.floats(0.1, 30), st.booleans())
@settings(max_examples=40, deadline=None)
def test_a_weighted_signal_is_the_weight_times_the_signal(seed, name, rate, discrete):
    plant = random_plant(seed, 0.1 if discrete else None)
    text, W = random_weight(seed, "z" if discrete else "s")
    s = np.exp(0.1j * rate) if discrete else 1j * rate
    larger = with_weight(plant, name, text)
    before = responses(plant, s, name)
    assert np.allclose(responses(larger, s, f"weighted {name}"), W(s) * before, rtol=1e-7)
    for known in SIGNALS:  # nothing else changes
        same = responses(plant, s, known)
        assert np.allclose(responses(larger, s, known), same, rtol=1e-8, atol=1e-9)
    assert larger.shape[0] == plant.shape[0] + len(W.poles())
    assert measurable(larger) == tuple(x.name for x in states(plant))


@given(st.integers(0, 99), st.sampled_from(["w1", "w2"]), st.floats(0.1, 30), st.booleans())
@settings(max_examples=40, deadline=None)
def test_a_disturbances_weight_stands_before_it(seed, name, rate, discrete):
    plant = random_plant(seed, 0.1 if discrete else None)
    text, W = random_weight(seed, "z" if discrete else "s")
    s, j = np.exp(0.1j * rate) if discrete else 1j * rate, 2 + int(name == "w2")
    larger, factors = with_weight(plant, name, text), np.ones(4, dtype=complex)
    factors[j] = W(s)
    for known in SIGNALS:
        wanted = factors * responses(plant, s, known)
        assert np.allclose(responses(larger, s, known), wanted, rtol=1e-7, atol=1e-9)
    acts = responses(larger, s, f"weighted {name}")
    assert np.allclose(acts, W(s) * np.eye(4)[j])
    assert [d.name for d in larger.signals if d.name == name] == []  # it is the disturbance still


def test_all_forms_say_one_weight():
    plant, system = random_plant(1), control.tf([2, 6], [1, 3.5, 2.5])
    every = [
        "2*(s + 3)/((s + 1)*(s + 2.5))",
        {"numerator": [2, 6], "denominator": [1, 3.5, 2.5]},
        {"zeros": [-3], "poles": [-1, "-2.5"], "gain": 2},
        system,
    ]
    first, *others = (with_weight(plant, "y1", form) for form in every)
    assert all(first == other for other in others)
    pair = {"zeros": [], "poles": ["-1+2j", "-1-2j"], "gain": 5}
    assert with_weight(plant, "y1", pair) == with_weight(plant, "y1", "5/(s**2 + 2*s + 5)")


@pytest.mark.parametrize(
    ("given", "at", "level"),
    [
        ([100, 2, "0.1"], 2, 1),
        ([0.01, 300, 20], 300, 1),
        ([4, [7, 2], 0.5], 7, 2),
        ([8, 3, 0], 3, 1),
    ],
)
def test_makeweight_has_its_gains(given, at, level):
    plant = replace(random_plant(2), outputs=(Output("y", C=[1, 0, 0]),))
    larger = with_weight(plant, "y", {"makeweight": given})

    def gain(rate):
        s = 1j * rate
        pair = (responses(own, s, name)[0, 0] for own, name in
                ((larger, "weighted y"), (plant, "y")))  # fmt: skip
        weighted, bare = pair
        return abs(weighted / bare)

    assert gain(1e-7) == pytest.approx(float(given[0]), rel=1e-6)
    assert gain(at) == pytest.approx(level, rel=1e-9)
    assert gain(1e7) == pytest.approx(float(given[2]), rel=1e-3, abs=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_a_reference_enters_the_error_alone(seed):
    plant, s = random_plant(seed), 2j
    larger = with_reference(plant, "r [m]", ["y1", "x2"])
    assert larger.disturbances == ("w1", "w2", "r [m]")
    for name in ("y1", "x2"):
        bare = responses(plant, s, name)
        assert np.allclose(responses(larger, s, name)[:, :4], bare)
        assert not responses(larger, s, name)[:, 4].any()
        error = responses(larger, s, f"error of {name}")
        assert np.allclose(error[:, :4], -bare)
        assert np.allclose(error[:, 4], 1)


def test_a_first_disturbance_may_be_a_reference():
    plant = UncertainPlant.from_vertices([[[-1]]], [[[1]]])
    larger = with_reference(plant, "r", "x1")
    assert np.array_equal(larger.vertices[0].E, [[0]])
    assert responses(larger, 1j, "error of x1")[0] == pytest.approx([-1 / (1j + 1), 1])


def test_a_spec_says_the_same_as_the_verbs():
    plant = loads(TWO_STATES + WEIGHTS)
    bare = with_reference(loads(TWO_STATES), "command", "x")
    bare = with_weight(bare, "error of x", "(s + 50)/(s + 500)", "performance [m]")
    bare = with_weight(bare, "force", {"zeros": [-1], "poles": [-10, -20], "gain": 3})
    assert plant == with_weight(bare, "w", "2/(s + 0.5)")
    assert plant.states[2:] == (
        "weight state 1 of performance", "weight state 1 of force", "weight state 2 of force",
        "weight state 1 of w",
    )  # fmt: skip
    assert {k: sorted(p.real) for k, p in weights_poles(plant).items()} == {
        "performance": [-500], "force": pytest.approx([-20, -10]), "w": [-0.5],
    }  # fmt: skip
    assert loads(dumps(plant)) == plant
    assert plant_of(file_plant(plant)) == plant
    assert plant.digest != loads(TWO_STATES).digest


def test_weights_go_around_hardware():
    text = SPRING + "[actuator.f]\nbandwidth = 3\n[sensor.x]\nbandwidth = 20\nnoise = 0.1\n"
    text += '[reference.r]\nsignal = ["x", "measured x"]\n'
    text += '[[weight]]\nsignal = "demand of f"\ntransfer = "1/(s + 1)"\n'
    text += '[[weight]]\nsignal = "noise of x"\ntransfer = "9/(s + 3)"\n'
    text += '[[weight]]\nsignal = "error of measured x"\ntransfer = "(s + 2)/(s + 9)"\n'
    plant, s = loads(text), 2j
    bare = with_sensor(with_actuator(loads(SPRING), "f", 3), "x", 20, "0.1")
    seen = responses(bare, s, "measured x") * [1, 1, 9 / (s + 3)]
    wanted = (s + 2) / (s + 9) * np.hstack([-seen, np.ones((4, 1))])
    assert np.allclose(responses(plant, s, "weighted error of measured x"), wanted)
    assert np.allclose(responses(plant, s, "weighted demand of f")[:, 0], 1 / (s + 1))
    assert plant.physical == (True, False, True)


@pytest.mark.parametrize("p", [0.5, 0.8, 1.3, 2])
def test_functions_of_the_parameters_are_weighted_too(p):
    s, bare = 1.5j, loads(CURVED)
    plant = with_weight(with_reference(bare, "r", "y"), "error of y", "(s + 3)/(s + 7)")
    plant = with_weight(plant, "w", "(s + 2)/(s + 1)")
    alpha = plant.alpha(p=p)
    A, B = plant.at(alpha)
    E = plant.driven(alpha)
    C, D, F = (M[0] for M in rows_at(plant, [plant.signal("weighted error of y")], alpha))
    found = C @ np.linalg.solve(s * np.eye(len(A)) - A, np.hstack([B, E])) + np.hstack([D, F])
    own = np.array([[0, 1], [-1 / p, -np.sqrt(p)]])
    into = np.array([[0, 0], [1 / p, np.sin(p)]])
    y = np.array([[np.sqrt(p), 0]]) @ np.linalg.solve(s * np.eye(2) - own, into)
    y = (y[0] + [0, np.exp(-p)]) * [1, (s + 2) / (s + 1)]
    assert np.allclose(found, (s + 3) / (s + 7) * np.array([*-y, 1]), rtol=1e-6)


def test_a_weighted_plant_is_sampled_with_its_weights():
    """Held inputs leave a weight's states where the exponential says, for each mass."""
    plant = with_weight(loads(TWO_STATES), "x", "(s + 1)/(s + 4)")
    sampled = at_sample_time(plant, 0.02)
    assert sampled.outputs[-1].name == "weighted x"
    for vertex, own in zip(sampled.vertices, plant.vertices, strict=True):
        A, *_ = cont2discrete((own.A, own.B, np.eye(3), np.zeros((3, 1))), 0.02)
        assert np.allclose(vertex.A[:3, :3], A, atol=1e-5)
    with pytest.raises(InputError, match="is sampled already; add it to the plant in continuous"):
        with_weight(sampled, "x", "3")
    for other in (sampled, delta_form(replace(random_plant(3), sample_time=1))):
        with pytest.raises(InputError, match="is sampled already"):
            with_reference(other, "r", "x1" if other is not sampled else "x")


def test_an_integrator_may_be_measured():
    plant = with_weight(loads(TWO_STATES), "x", "(s + 1)/(s*s)")
    assert [p.real for p in weights_poles(plant)["x"]] == [0, 0]
    assert with_weight(replace(random_plant(3), sample_time=1), "y1", "1/(z - 1)").shape[0] == 4


WRONG = {
    "no such signal": ("xx", "1/s", "no signal or disturbance 'xx'; did you mean 'x'?"),
    "improper": ("x", "s**2/(s + 1)", "the numerator has degree 2, the denominator 1; divide by"),
    "unstable": ("x", "1/(s - 1)", "weight of 'x': the pole 1 is not stable; move it to the left"),
    "undamped": ("x", "1/(s**2 + 4)", "the pole 0 +- 2j is not stable"),
    "a hair right": ("x", "1/(s**2 - s/10**30 + 1)", "is not stable"),
    "integrator before": ("w", "1/s", "which no law moves: the pole 0 is not stable"),
    "other name": ("x", "1/(p + 1)", "unknown name 'p'"),
    "z": ("x", "1/(z - 0.5)", "transfer is in z, and the plant in continuous time; write it in s"),
    "call": ("x", "exp(s)", "exp"),
    "zero": ("x", "0", "weight of 'x' is zero; give it a gain"),
    "number": ("x", 3, "weight of 'x': give transfer = "),
    "two forms": ("x", {"transfer": "1", "poles": [1]}, "transfer beside poles; give one, as"),
    "none": ("x", {}, "no transfer function; give one"),
    "half": ("x", {"numerator": [1]}, "denominator is missing; give numerator, denominator"),
    "no conjugate": ("x", {"zeros": [], "poles": ["-1+2j"], "gain": 1}, "has no conjugate"),
    "makeweight, flat": ("x", {"makeweight": [2, 5, 3]}, "must rise or fall through 1 at a"),
    "makeweight, two": ("x", {"makeweight": [2, 5]}, "must be [DC, CROSSOVER, HF]"),
    "makeweight, zero": ("x", {"makeweight": [2, 0, 0]}, "at a frequency above zero"),
    "several": ("x", control.tf([[[1], [1]]], [[[1, 1], [1, 2]]]), "several inputs or outputs"),
}  # fmt: skip


@pytest.mark.parametrize(("signal", "weight", "said"), WRONG.values(), ids=WRONG)
def test_what_is_no_weight_is_said(signal, weight, said):
    with pytest.raises(InputError) as caught:
        with_weight(loads(TWO_STATES), signal, weight)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_that_are_taken_are_refused():
    plant = with_weight(loads(TWO_STATES), "x", "1/(s + 1)")
    with pytest.raises(InputError, match="has a signal 'weighted x' already"):
        with_weight(plant, "x", "2")
    assert with_weight(plant, "x", "2", "twice x").outputs[-1].name == "twice x"
    with pytest.raises(InputError, match="reference 'r': no signal 'speed'"):
        with_reference(plant, "r", "speed")
    with pytest.raises(InputError, match="has a disturbance 'w' already"):
        with_reference(plant, "w", "x")
    with pytest.raises(InputError, match="has a signal 'v' already"):
        with_reference(plant, "v", "x")


def test_a_text_calls_makeweight_with_its_numbers():
    plant = random_plant(1)
    named = with_weight(plant, "y1", {"makeweight": ["0.4", 15, 3]})
    for text in ("makeweight(0.4, 15, 3)", " makeweight( .4,1.5e1,3. ) "):
        assert with_weight(plant, "y1", text) == named
    for text in ("makeweight(0.4, 15)", "makeweight(0.4, 15, 3, 1)", "makeweight(a, 15, 3)"):
        with pytest.raises((InputError, SpecError)):
            with_weight(plant, "y1", text)
