"""Vectors of outputs, and disturbances that are chosen and scaled: against other theory."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

import polefence as pf
from polefence import FixedGain, InputError, Parameter, Scheduled, UncertainPlant
from polefence.certify.bounds import best_bound, kept_bound, sampled
from polefence.plant.outputs import Output
from polefence.requirements.energy_peak import EnergyPeak
from polefence.requirements.gain import Gain
from polefence.requirements.gain_norm import GainNorm
from polefence.requirements.initial_peak import InitialPeak
from polefence.requirements.relative_rms import RelativeRms
from polefence.requirements.rms import Rms
from polefence.requirements.specification import limit_text
from polefence.requirements.text import load_specifications, parse_specification
from polefence.requirements.weights import with_weights
from polefence.response.weighting import WE, WK
from polefence.search.optimise import optimise
from support.commands import refused

DENSITY = 0.5
MIXED = Output("mixed", "N", C=[1, 0, -0.5], D=[0.3])
THROUGH = Output("through", "N", C=[0, 1, 1], D=[0.1], F=[0.2, -0.4])


def single(seed=2):
    """One vertex, three states, two disturbances."""
    random = np.random.default_rng(seed)
    A, B, E = random.normal(size=(3, 3)), random.normal(size=(3, 1)), random.normal(size=(3, 2))
    return UncertainPlant.from_vertices(
        [A - 3 * np.eye(3)],
        [B],
        [E],
        states=("a [m]", "b [m]", "c [m/s]"),
        inputs=("u [N]",),
        disturbances=("road [m/s]", "wind [N]"),
        outputs=(MIXED, THROUGH),
    )


LAW = FixedGain([[0.1, 0.2, -0.3]])
VECTORS = [("a", "b"), ("c", "mixed", "u"), ("a", "b", "c", "mixed")]
CHANNELS = [None, {"road": 0.5, "wind": 20.0}, ["wind"]]


def loop(plant, own):
    """Closed loop, E diag(s), rows C + D K and F diag(s) of one vertex."""
    K, chosen = LAW.K, dict(own.disturbances or {"road": 1.0, "wind": 1.0})
    s = np.array([chosen.get("road", 0.0), chosen.get("wind", 0.0)])
    C, D, F = (
        np.vstack([M[0] for M in each])
        for each in zip(*(y.arrays(plant) for y in own.outputs(plant)), strict=True)
    )
    return plant.A[0] + plant.B[0] @ K, plant.vertices[0].E * s, C + D @ K, F * s


def h2_norm(A, E, C):
    """By the observability Gramian: the trace over the disturbances."""
    Q = solve_continuous_lyapunov(A.T, -C.T @ C)
    return float(np.sqrt(np.trace(E.T @ Q @ E)))


def hinf_norm(A, E, C, F):
    """By bisection on the imaginary eigenvalues of a Hamiltonian matrix (Boyd et al., 1989)."""

    def below(g):
        R, S = F.T @ F - g * g * np.eye(F.shape[1]), F @ F.T - g * g * np.eye(len(F))
        if np.linalg.eigvalsh(R).max() >= 0:
            return False
        shifted = A - E @ np.linalg.solve(R, F.T @ C)
        H = np.block([
            [shifted, -g * E @ np.linalg.solve(R, E.T)],
            [g * C.T @ np.linalg.solve(S, C), -shifted.T],
        ])  # fmt: skip
        poles = np.linalg.eigvals(H)
        return not np.any(np.abs(poles.real) < 1e-8 * np.abs(poles).max())

    low, high = 0.0, 1.0
    while not below(high):
        low, high = high, 2 * high
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if below(middle) else (middle, high)
    return high


# --- one vertex: bounds are equalities -----------------------------------------------------------


@pytest.mark.parametrize("channels", CHANNELS, ids=str)
@pytest.mark.parametrize("names", VECTORS, ids=str)
def test_the_rms_of_a_vector_is_the_h2_norm(names, channels):
    plant = single()
    own = Rms(names, None, DENSITY, disturbances=channels)
    A, E, C, _ = loop(plant, own)
    true = np.sqrt(DENSITY / 2) * h2_norm(A, E, C)
    level = best_bound(plant, LAW, own).level
    assert true < level < true * (1 + 1e-4)
    assert sampled(plant, LAW, own).worst == pytest.approx(true, rel=1e-9)
    assert kept_bound(plant, LAW, replace(own, at_most=true * (1 + 1e-4))) is not None
    assert kept_bound(plant, LAW, replace(own, at_most=true * (1 - 1e-4))) is None


@pytest.mark.parametrize("channels", CHANNELS, ids=str)
@pytest.mark.parametrize("names", [*VECTORS, ("a", "through", "u")], ids=str)
def test_the_gain_of_a_vector_is_the_h_infinity_norm(names, channels):
    plant = single()
    own = Gain(names, disturbances=channels)
    true = hinf_norm(*loop(plant, own))
    level = best_bound(plant, LAW, own).level
    assert true * (1 - 1e-9) < level < true * (1 + 2e-3)
    assert sampled(plant, LAW, own).worst == pytest.approx(true, rel=1e-4)
    assert kept_bound(plant, LAW, replace(own, at_most=true * 0.998)) is None


def test_entries_and_channels_add_as_theory_says():
    """Squares of rms values add, over entries and channels; no order of the entries counts."""
    plant = single()

    def level(names, channels=None, kind=Rms):
        own = kind(names, disturbances=channels)
        return best_bound(plant, LAW, own).level

    whole, names = level(("a", "c", "mixed")), ("a", "c", "mixed")
    assert whole**2 == pytest.approx(sum(level(name) ** 2 for name in names), rel=1e-5)
    apart = [level(names, [name]) ** 2 for name in ("road", "wind")]
    assert whole**2 == pytest.approx(sum(apart), rel=1e-5)
    scaled = level(names, {"road": 3.0, "wind": 0.25})
    assert scaled**2 == pytest.approx(9 * apart[0] + apart[1] / 16, rel=1e-5)
    for order in itertools.permutations(names):
        assert level(order) == pytest.approx(whole, rel=1e-6)
    # of one channel a scale multiplies
    one = level(names, ["wind"], Gain)
    assert level(names, {"wind": 7.5}, Gain) == pytest.approx(7.5 * one, rel=1e-5)
    # the largest gain of a part is no more than that of the whole, nor that less than any
    gains = [level(name, kind=Gain) for name in names]
    together = level(names, kind=Gain)
    assert max(gains) < together < np.sqrt(np.sum(np.square(gains)))


@pytest.mark.parametrize(
    "make",
    [
        lambda signal, w: Rms(signal, None, 2.0, disturbances=w),
        lambda signal, w: Gain(signal, disturbances=w),
        lambda signal, w: EnergyPeak(signal, None, 0.3, disturbances=w),
        lambda signal, w: InitialPeak(signal, impulse=0.2, disturbances=w),
        lambda signal, w: RelativeRms(signal, None, 2.0, disturbances=w),
    ],
)
def test_one_entry_and_all_disturbances_are_what_they_were(make):
    """To the last digit: the same inequalities."""
    plant = single()
    plain = best_bound(plant, LAW, make("c", None))
    for signal, channels in (
        (["c"], None),
        ("c", ["road", "wind"]),
        (("c",), {"wind": 1, "road": 1.0}),
    ):
        again = best_bound(plant, LAW, make(signal, channels))
        assert again.claim == plain.claim
        assert again.level == plain.level


@pytest.mark.parametrize("kind", ["energy peak", "initial peak", "relative rms"])
def test_other_kinds_of_chosen_disturbances(kind):
    """The plant with that column of E alone, times the scale, says the same."""
    plant = single()
    E = plant.vertices[0].E[:, 1:] * 3.0
    alone = UncertainPlant.from_vertices([plant.A[0]], [plant.B[0]], [E], states=plant.states)
    own = {
        "energy peak": EnergyPeak("c", None, 0.3),
        "initial peak": InitialPeak("c", impulse=0.2),
        "relative rms": RelativeRms("c", None, 2.0),
    }[kind]
    chosen = replace(own, disturbances={"wind": 3.0})
    level = best_bound(plant, LAW, chosen).level
    assert level == pytest.approx(best_bound(alone, LAW, own).level, rel=1e-5)
    assert level != pytest.approx(best_bound(plant, LAW, own).level, rel=1e-2)
    seen = sampled(plant, LAW, chosen).worst
    assert seen == pytest.approx(sampled(alone, LAW, own).worst, rel=1e-9)
    assert seen < level * (1 + 1e-9)


def test_noise_that_does_not_act_may_pass_straight_into_a_signal():
    """`y` has the wind in it, and a finite rms from the road alone."""
    plant = replace(single(), outputs=(Output("y", C=[1, 0, 1], F=[0, 0.5]),))
    for names in ("y", ("y", "a")):
        with pytest.raises(InputError, match="straight into 'y'"):
            best_bound(plant, LAW, Rms(names))
        own = Rms(names, disturbances=["road"])
        A, E, C, _ = loop(plant, own)
        true = np.sqrt(0.5) * h2_norm(A, E, C)
        assert true < best_bound(plant, LAW, own).level < true * (1 + 1e-4)
        assert sampled(plant, LAW, own).worst == pytest.approx(true, rel=1e-9)


# --- families ------------------------------------------------------------------------------------


def family():
    """A mass on a spring, pushed and shaken: four vertices."""
    parameters = [Parameter("m", 1, "5/4", "kg", "1/m"), Parameter("k", 4, 5, "N/m")]
    A = [["0", "1"], ["-k/m", "-1/m"]]
    plant = UncertainPlant.from_expressions(
        parameters, A, [["0"], ["1/m"]], [["1", "0"], ["1/2", "1/m"]],
        states=("place [m]", "speed [m/s]"), inputs=("force [N]",),
        disturbances=("road [m/s]", "wind [N]"),
    )  # fmt: skip
    return replace(plant, outputs=(pf.response.rate_of(plant, "speed", "acceleration"),))


ASKED = [
    Rms(("place", "force"), None, DENSITY),
    Rms(("place", "acceleration", "force"), None, DENSITY, disturbances={"road": 0.5}),
    Gain(("place", "speed")),
    Gain(("place", "acceleration", "force"), disturbances={"road": 0.1, "wind": 2.0}),
]


def alone(plant):
    """Without the wind, which passes straight into the acceleration; a car's road does not."""
    return replace(plant, outputs=tuple(replace(y, F=()) for y in plant.outputs))


@pytest.mark.parametrize("own", ASKED, ids=lambda own: own.title)
@pytest.mark.parametrize("scheduled", [False, True])
def test_a_bound_of_a_family_is_above_its_samples_and_near(own, scheduled):
    plant = alone(family())
    law = FixedGain([[-1.0, -0.5]])
    if scheduled:
        law = pf.place(plant, pf.Disk(-3, 2.6), Scheduled(1, 0, "box")).law
    level, worst = best_bound(plant, law, own).level, sampled(plant, law, own).worst
    assert worst < level < worst * (1.02 if own.kind == "rms" else 1.1)


@pytest.mark.parametrize(
    ("kind", "method"), [(Rms, "quadratic"), (Rms, Scheduled(1, 0, "box")), (Gain, "quadratic")]
)
def test_a_design_for_a_vector_is_better_than_those_for_its_entries(kind, method):
    plant, names = alone(family()), ("place", "force")
    limits = [Rms("speed", 2.0, DENSITY)]
    best = optimise(plant, kind(names), limits, method=method)
    assert best.bounds[0].level < 1.1 * best.shared
    for name in names:
        other = optimise(plant, kind(name), [*limits, kind("force", 50.0)], method=method)
        bound = best_bound(plant, other.law, kind(names))
        assert best.bounds[0].level < bound.level * (1 + 1e-3)
    assert sampled(plant, best.law, kind(names)).worst < best.bounds[0].level


def test_limits_on_the_same_signal_from_other_disturbances_are_other_limits():
    """Each has a source of its own; both are kept."""
    plant = family()
    limits = [
        Rms(("place", "force"), 0.9, DENSITY, disturbances=["road"]),
        Rms(("place", "force"), 0.6, DENSITY, disturbances=["wind"]),
    ]
    found = optimise(plant, Rms("speed", None, DENSITY), limits, method="quadratic")
    assert [bound.level for bound in found.bounds[1:]] == [0.9, 0.6]
    for own in limits:
        assert sampled(plant, found.law, own).worst < own.at_most
    # the one at 0.6 is no limit on what the road does, nor the other way round
    swapped = [replace(limits[0], at_most=0.05), replace(limits[1], at_most=0.6)]
    with pytest.raises(pf.NotProvedError):
        optimise(plant, Rms("speed", None, DENSITY), swapped, method="quadratic")


def test_a_weight_filters_each_entry():
    plant = single()
    own = Rms(("a", "c"), 9.0, DENSITY, weight="Wk")
    longer, (weighted,) = with_weights(plant, (own,))
    states = len(WK.state_space()[0])
    assert longer.shape[0] == 3 + 2 * states
    assert weighted.name == '["a, Wk", "c, Wk"]'
    squares = [
        sampled(longer, None, weighted.of(longer.signal(one))).worst ** 2
        for one in weighted.entries
    ]
    assert sampled(longer, None, weighted).worst ** 2 == pytest.approx(sum(squares))
    # each is what its own filter, and no other, makes of it
    for one, square in zip(("a", "c"), squares, strict=True):
        alone, (filtered,) = with_weights(plant, (replace(own, signal=one),))
        assert sampled(alone, None, filtered).worst ** 2 == pytest.approx(square)


def test_entries_may_have_weights_of_their_own():
    plant = single()
    own = Rms(("a", "c", "b"), 9.0, DENSITY, weight=["Wk", "none", "We"])
    longer, (weighted,) = with_weights(plant, (own,))
    assert longer.shape[0] == 3 + len(WK.state_space()[0]) + len(WE.state_space()[0])
    assert weighted.name == '["a, Wk", c, "b, We"]'
    total = 0.0
    for signal, weight in (("a", "Wk"), ("c", None), ("b", "We")):
        one = Rms(signal, None, DENSITY, weight=weight)
        alone, (filtered,) = with_weights(plant, (one,))
        total += sampled(alone, None, filtered).worst ** 2
    assert sampled(longer, None, weighted).worst ** 2 == pytest.approx(total)
    assert parse_specification(
        "rms of [a, c, b] <= 9 with weight [Wk, none, We] with density 3"
    ) == Rms(("a", "c", "b"), 9.0, 3.0, weight=["Wk", "none", "We"])
    assert Rms(("a", "c"), weight=["none", "none"]).weight is None
    for weight, said in (
        (["Wk"], "weight names 1 for 2 entries"),
        (["Wk", "Wx"], "weight = 'Wx' is unknown"),
        ("none", "weight = 'none' is unknown"),
    ):
        with pytest.raises(InputError, match=said):
            Rms(("a", "c"), weight=weight)


# --- what is written -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "own",
    [
        Rms(("a", "b"), 2.5),
        Rms("a", 0.1, disturbances=["wind"]),
        Gain(("a", "b, the second", "3 * c"), 7.0, disturbances={"road": 0.1, "side [x]": 1e-5}),
        Gain(("a", 'in "quotes"')),
        EnergyPeak("a", 2.0, disturbances={"road": 20.0, "wind": 1.0}),
    ],
    ids=limit_text,
)
def test_a_line_reads_back(own):
    more = " with density 1" if isinstance(own, Rms) else ""
    again = parse_specification(limit_text(own) + more)
    assert again == own
    assert limit_text(again) == limit_text(own)


def test_units_of_a_vector():
    plant = single()
    assert Rms(("a", "b")).unit(plant) == "m"
    assert Rms(("a", "u", "c")).unit(plant) == "mixed units: m, N, m/s"
    assert Gain(("a", "b"), disturbances=["wind"]).unit(plant) == "m per N"
    assert Gain(("a", "b")).unit(plant) == "m per unit"


FAULTS = {
    "twice": (lambda: Rms(("a", "a")), "'a' is given twice"),
    "none": (lambda: Rms(()), "must be a name, an Output or a list"),
    "number": (lambda: Gain(("a", 3)), "must be a name, an Output or a list"),
    "many": (lambda: Gain([f"x{k}" for k in range(17)]), "at most 16"),
    "peak": (lambda: EnergyPeak(("a", "b")), "takes one signal"),
    "initial": (lambda: InitialPeak(("a", "b"), impulse=1.0), "takes one signal"),
    "relative": (lambda: RelativeRms(("a", "b")), "takes one signal"),
    "scale": (lambda: Gain("a", disturbances={"road": 0}), "'road' times 0: give a positive"),
    "minus": (lambda: Gain("a", disturbances={"road": -1.0}), "give a positive number"),
    "infinite": (lambda: Gain("a", disturbances={"road": np.inf}), "give a positive number"),
    "no channel": (lambda: Rms("a", disturbances=[]), "must be names"),
    "channel twice": (lambda: Rms("a", disturbances=["road", "road"]), "'road' is given twice"),
    "channel": (lambda: Rms("a", disturbances=7), "must be names"),
    "law": (lambda: GainNorm(3.0, disturbances=["road"]), "takes no disturbances"),
    "unknown": (lambda: Rms("a", disturbances=["rod"]).scales(single()), "did you mean 'road'"),
    "unknown signal": (lambda: Rms(("a", "bb")).outputs(single()), "no signal 'bb'"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_makes_no_sense_is_named(fault):
    make, message = FAULTS[fault]
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


LINES = {
    "gain of [a,, b]": "cannot read",
    "gain of []": "cannot read",
    "gain of [a, b,]": "cannot read",
    "gain of [a * 2, b]": "signals have no scales",
    "gain of [a, a]": "given twice",
    "gain of a from []": "cannot read",
    "gain of a from [road * x]": "cannot read",
    "gain of a from [road * -1]": "positive",
    "gain of a from [road, road]": "given twice",
    "gain of a with disturbances road": r"from \[NAME\]",
    "energy peak of [a, b]": "takes one signal",
    "gain norm of the law from [road] <= 3": "unknown key disturbances",
    "saturation of [a, b] <= [4, 40]": r"one number; write <= 1 with limits \[4, 40\], or",
    "saturation of a <= [4]": r"write <= 1 with limits \[4\]",
    "saturation of [a, b] <= 1 with limits 4,40": r"limits = '4,40' must be a list.*\[4, 40\]",
    "rms of [a, b] <= [1, 2]": "bounds all entries of a vector together; for one each, ask",
    "gain of [a, b] <= 4, 40": "'4, 40' behind <=; a limit is a number alone, in the signal's",
    "gain of a <= 4 N": "a number alone, in the signal's unit",
    "gain of a ≤ 4": "'≤ 4' at its end; a limit is written <= NUMBER",
    "initial peak of a <= 3 with points [1, 2]": r"write it there, in a \[\[specification\]\]",
    "gain of a with at_most 3": "give the limit by <=",
}


@pytest.mark.parametrize("line", LINES)
def test_a_line_that_cannot_be_read_says_why(line):
    with pytest.raises(InputError, match=LINES[line]) as caught:
        parse_specification(line)
    assert "\n" not in str(caught.value)


def test_what_is_told_of_limits_that_are_a_list_is_read():
    told = "saturation of [a, b] <= 1 with limits [4, 40]"
    assert parse_specification(f"{told} with norm 2").limits == (4.0, 40.0)


SPEC = """
states = ["a [m]", "b [m]"]
disturbances = ["road", "wind"]
[[vertex]]
A = [[-1, 0], [1, -2]]
B = [[0], [1]]
E = [[1, 0], [0, 1]]
[[specification]]
kind = "rms"
signal = ["a", "b"]
density = 2
disturbances = {road = 0.5, wind = 20}
minimise = true
[[specification]]
kind = "gain"
signal = ["a"]
disturbances = ["wind"]
at_most = 3
"""


def test_a_spec_says_vectors_and_disturbances(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(SPEC)
    least, limits = load_specifications(path)
    assert least == Rms(("a", "b"), None, 2.0, disturbances={"road": 0.5, "wind": 20})
    assert limits == (Gain("a", 3.0, disturbances=["wind"]),)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('["a", "b"]', '["a", 3]', r"signal\[2\] = 3 must be text; name a state"),
        ('["a", "b"]', "[]", "signal = "),
        ('["a", "b"]', '["a", "a"]', "given twice"),
        ("{road = 0.5, wind = 20}", '{road = "x"}', "disturbances.road = 'x' must be a finite"),
        ("{road = 0.5, wind = 20}", "{road = -1}", "positive"),
        ("{road = 0.5, wind = 20}", "{}", "name one"),
        ("{road = 0.5, wind = 20}", "3", "a list of names"),
        ('["wind"]', "[1]", "a list of names"),
        ('kind = "gain"', 'kind = "gain norm"', "a gain norm is of the law"),
        ("at_most = 3", "at_most = [3, 40]", r"at_most = \[3, 40\] must be one number; it bounds"),
        (
            'kind = "gain"\nsignal = ["a"]\ndisturbances = ["wind"]\nat_most = 3',
            'kind = "saturation"\nsignal = ["a", "b"]\nnorm = 2\nat_most = [4, 0.5]',
            r"limits = \[4, 0.5\] in place of at_most",
        ),
    ],
)
def test_a_spec_that_makes_no_sense_is_one_line(tmp_path, old, new, message, capsys):
    path = tmp_path / "two.toml"
    assert old in SPEC
    path.write_text(SPEC.replace(old, new))
    with pytest.raises(InputError, match=message):
        load_specifications(path)
    assert "two.toml" in refused(capsys, "optimise", path)


@pytest.mark.parametrize("scale", [10**400, 1e200, 1e-200])
def test_a_scale_is_a_number_that_doubles_square(scale):
    with pytest.raises(InputError, match="disturbance 'road' times .*: give a"):
        Rms("a", disturbances={"road": scale})


def test_a_number_beyond_doubles_is_no_limit():
    for make in (lambda x: Gain("a", x), lambda x: Rms("a", density=x)):
        with pytest.raises(InputError, match="must be a positive number"):
            make(10**400)


def test_disturbances_of_a_peak_from_initial_states_are_refused():
    with pytest.raises(InputError, match="disturbances only apply together with an impulse"):
        InitialPeak("a", points=[[1, 0, 0]], disturbances=["wind"])
    assert InitialPeak("a", points=[[1, 0, 0]], impulse=1.0, disturbances=["wind"]).points


def test_initial_states_that_python_hashes_alike_are_two():
    """hash(-1.0) is hash(-2.0): each bound is of its own initial state, given as a list or not."""
    plant = single()
    near, far = (InitialPeak("a", 50.0, points=[[x, 0, 0]]) for x in (-1.0, -2.0))
    sources = {own.source(plant, None).name for own in (near, far)}
    assert len(sources) == 2
    done = optimise(plant, Rms(("b", "u")), [near, far], method="quadratic")
    assert [bound.specification for bound in done.bounds[1:3]] == [near, far]
    with pytest.raises(InputError, match="points must be a list of initial states"):
        InitialPeak("a", points=[1, 0, 0])


def test_what_passes_straight_through_is_said_with_file_and_remedy(tmp_path, capsys):
    path = tmp_path / "through.toml"
    outputs = '[outputs]\n"t" = {C = [1, 0], F = [1, 0]}\n[[vertex]]'
    path.write_text(SPEC.replace("[[vertex]]", outputs).replace('["a", "b"]', '["a", "t"]'))
    err = refused(capsys, "optimise", path)
    assert f"{path}: a disturbance passes straight into 't'; bound its gain" in err
