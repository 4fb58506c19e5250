"""Dead times: against exact transfer functions, thresholds on both sides, and faults in files."""

import json
from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound
from polefence.cli.main import main
from polefence.law.structure import Structure
from polefence.plant.dead_time import FLOOR, covering_of, with_dead_time
from polefence.plant.spec import dumps, loads
from polefence.plant.weights import measurable
from polefence.proof.dead_time import Covering
from polefence.proof.document import check as check_file
from polefence.proof.document import from_plain
from polefence.proof.work import FormatError
from polefence.region.regions import HalfPlane
from polefence.requirements.gain import Gain
from polefence.requirements.rms import Rms
from support.specs import MASS_ON_SPRING

SPRING = MASS_ON_SPRING + "[dead_time.force]\ntime = 0.05\n"
INTEGRATOR = """
states = ["x"]
inputs = ["u"]
disturbances = ["w"]
[matrices]
A = [[0]]
B = [[1]]
E = [[1]]
[dead_time.u]
time = TIME
decay = 0.01
order = ORDER
"""


def law_of(plant, *gains, measured=("position", "velocity")):
    return Structure(measured=measured, schedule=()).law(plant, np.array([[gains]]))


def frequencies():
    w = np.concatenate([np.linspace(0, 200, 200_001)[1:], np.geomspace(200, 1e5, 20_000)])
    return w, np.gradient(w)


def rms_of(k, T, K):
    """The exact rms of position and force under white noise of one-sided density one."""
    w, dw = frequencies()
    s = 1j * w
    plant = 1 / (s * s + 2 * s + k)
    control = K[0] + K[1] * s
    position = plant / (1 - plant * control * np.exp(-s * T))
    return [np.sqrt((abs(y) ** 2 * dw).sum() / (2 * np.pi)) for y in (position, control * position)]


def value(P, s):
    return sum(float(x) * s**k for k, x in enumerate(P))


@pytest.mark.parametrize("order", [1, 2, 4, 6, 8])
@pytest.mark.parametrize("shift", [Fraction(0), Fraction(1, 8), Fraction(1, 2)])
def test_what_an_approximation_leaves_out_is_covered_at_every_frequency(order, shift):
    covering = covering_of(order, shift)
    N, D = covering.pade
    w = np.concatenate([np.linspace(0, 100, 20_001), np.geomspace(100, 1e5, 1000)])
    s = -float(shift) + 1j * w
    left = np.abs(np.exp(-s) * value(D, s) - value(N, s))
    M = float(covering.gain * D[-1]) * np.abs(1j * w + float(FLOOR)) ** order
    assert np.all(left <= M * (1 + 1e-9) + 1e-14)
    assert np.max(left / M) > 0.99  # and by no more than is needed
    assert np.roots([float(x) for x in D[::-1]]).real.max() < -float(shift)
    assert not Covering(order, shift, FLOOR, covering.gain * Fraction(99, 100)).is_sound


def test_a_covering_of_other_poles_is_none():
    assert not Covering(3, Fraction(5), FLOOR, Fraction(10**6)).is_sound  # D has poles right of -5
    assert not Covering(2, Fraction(0), Fraction(1, 10**9), Fraction(1385, 1000)).is_sound


@pytest.mark.parametrize("order", [1, 3, 8])
def test_the_chain_has_the_transfer_functions(order):
    covering = covering_of(order, Fraction(1, 8))
    (N, D), (F, g, c, b) = covering.pade, covering.chain
    F, g, c, b = (np.array(x, dtype=float) for x in (F, g, c, b))
    for s in (0.3, 2.0 + 1.0j, 7.0j):
        z = np.linalg.solve(s * np.eye(order) - F, g)
        assert c @ z == pytest.approx(value(N, s) / value(D, s), rel=1e-9)
        moved = float(covering.gain * D[-1]) * (s + 0.25) ** order / value(D, s)
        assert b @ z + float(covering.gain) == pytest.approx(moved, rel=1e-9)


@pytest.mark.parametrize(
    ("T", "K"), [(0.05, (-52.1, -19.4)), (0.02, (-351.0, -32.7)), (0.2, (36.6, 0.24))]
)
def test_bounds_hold_for_the_exact_dead_time_and_are_near(T, K):
    plant = loads(SPRING.replace("0.05", str(T)))
    law = law_of(plant, *K)
    assert pf.analyse(plant, law, HalfPlane(0.1)).proved
    bounds = [best_bound(plant, law, Rms(name, density=1)) for name in ("position", "force")]
    exact = np.max([rms_of(k, T, K) for k in np.linspace(80, 120, 9)], axis=0)
    for bound, truth in zip(bounds, exact, strict=True):
        assert truth <= bound.level <= 1.03 * truth


def test_a_gain_holds_for_the_exact_dead_time():
    plant, K = loads(SPRING), (-52.1, -19.4)
    bound = best_bound(plant, law_of(plant, *K), Gain("position"))
    w, _ = frequencies()
    s, most = 1j * w, 0.0
    for k in np.linspace(80, 120, 9):
        loop = (K[0] + K[1] * s) * np.exp(-0.05 * s)
        most = max(most, np.abs(1 / (s * s + 2 * s + k - loop)).max())
    assert most <= bound.level <= 1.03 * most


@pytest.mark.parametrize(("order", "near"), [(4, 1.55), (6, 1.565)])
def test_the_delay_margin_of_an_integrator_is_bracketed(order, near):
    """x' = -x(t - T) is stable for T < pi / 2."""

    def answer(T):
        plant = loads(INTEGRATOR.replace("TIME", str(T)).replace("ORDER", str(order)))
        return pf.analyse(plant, law_of(plant, -1.0, measured=("x",)), HalfPlane(0.0)).answer

    assert answer(near) == "proved"
    assert answer(1.5708) != "proved"


def test_a_measured_signal_is_late_behind_its_sensor():
    text = SPRING.replace("[dead_time.force]", "[dead_time.velocity]")
    plant = loads(text + "[sensor.velocity]\nbandwidth = 50\n")
    K = -15.0
    law = law_of(plant, K, measured=("measured velocity",))
    bound = best_bound(plant, law, Rms("position", density=1))
    w, dw = frequencies()
    s, wide = 1j * w, 2 * np.pi * 50
    most = 0.0
    for k in (80, 100, 120):
        g = 1 / (s * s + 2 * s + k)
        position = g / (1 - g * K * s * np.exp(-0.05 * s) * wide / (s + wide))
        most = max(most, np.sqrt((abs(position) ** 2 * dw).sum() / (2 * np.pi)))
    assert most <= bound.level <= 1.03 * most


def test_an_interval_of_dead_times_holds_each_of_them():
    plant = loads(SPRING.replace("time = 0.05", "time = [0.02, 0.05]"))
    K = (-52.1, -19.4)
    bound = best_bound(plant, law_of(plant, *K), Rms("position", density=1))
    exact = max(rms_of(k, T, K)[0] for k in (80, 120) for T in (0.02, 0.03, 0.05))
    assert exact <= bound.level <= 1.03 * exact


def test_a_spec_says_a_plant_with_a_dead_time_again():
    plant = loads(SPRING)
    assert loads(dumps(plant)) == plant
    assert with_dead_time(loads(SPRING.split("[dead_time")[0]), "force", Fraction("0.05")) == plant


@pytest.fixture(scope="module")
def file():
    plant = loads(SPRING)
    law = law_of(plant, -52.1, -19.4)
    design = pf.analyse(plant, law, HalfPlane(0.1)).certificate
    bound = best_bound(plant, law, Rms("position", density=1))
    document = design.file([design.claim(), bound.claim])
    return json.loads(document.dumps())


def test_the_file_is_proved_and_says_what_is_late(file):
    answer = check_file(from_plain(file))
    assert answer.proved
    assert all("'force' 50 ms late" in text for text in answer.claims)


def delta(file):
    return next(p for p in file["plant"]["parameters"] if "dead_time" in p)


def faults():
    def with_entry(key, entry):
        def fault(file):
            delta(file)["dead_time"][key] = entry

        return fault

    def unbound(file):
        del delta(file)["rate"]

    def narrower(file):
        delta(file)["range"] = [-0.5, 0.5]

    def moving(file):
        file["plant"]["parameters"][0]["rate"] = [-1, 1]

    def faster(file):
        file["claims"][0]["region"]["decay"] = 3

    def disk(file):
        file["claims"][0]["region"] = {"kind": "disk", "centre": -100, "radius": 99}

    def coupled(file):
        file["plant"]["vertices"][1]["A"][0][2] = "1/7"

    def chain(file):
        for vertex in file["plant"]["vertices"]:
            vertex["A"][5][3] = -1

    def entering(file):
        for vertex in file["plant"]["vertices"]:
            vertex["B"][5][0] = 3

    def of_delta(file):
        X = file["claims"][1]["evidence"]["X"][-1]
        X[0][0] = str(Fraction(X[0][0]) * Fraction(101, 100))

    return {
        "gain": with_entry("gain", "16/10"),
        "time": with_entry("time", "1/10"),
        "order": with_entry("order", 3),
        "first": with_entry("first", 2),
        "floor": with_entry("floor", "1/1000"),
        "decay": with_entry("decay", 100),
        "signal": with_entry("signal", "position"),
        "rate": unbound,
        "range": narrower,
        "another moves": moving,
        "decay of the region": faster,
        "disk": disk,
        "coupling": coupled,
        "chain": chain,
        "entry": entering,
        "X depends on delta": of_delta,
    }


@pytest.mark.parametrize("name", faults())
def test_one_fault_is_refused(file, name):
    wrong = json.loads(json.dumps(file))
    faults()[name](wrong)
    with pytest.raises(FormatError, match=r"dead.time|moves at any rate"):
        check_file(from_plain(wrong))


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("[dead_time.forc]\ntime = 0.05", "dead time of 'forc'.*no signal"),
        ("[dead_time.force]\ntime = 0", "must be positive"),
        ("[dead_time.force]\ntime = [0.05, 0.02]", "the smaller bound first"),
        ("[dead_time.force]\ntime = 0.05\norder = 9", "order = 9 must be 1 to 8"),
        ("[dead_time.force]\ntime = 0.05\ndecay = 100", "decay = 100 must be 0 to 10 1/s"),
        ("[dead_time.force]\norder = 2", "time is missing"),
        ("[dead_time.force]\ntime = 0.05\n[dead_time.position]\ntime = 0.1", "one is provided for"),
    ],
)
def test_bad_dead_times_are_refused_in_a_line(table, said):
    with pytest.raises(InputError, match=said) as error:
        loads(SPRING.split("[dead_time")[0] + table)
    assert "\n" not in str(error.value)


def test_what_is_not_proved_with_a_dead_time_is_refused_before_any_work():
    plant = loads(SPRING)
    law = law_of(plant, -52.1, -19.4)
    with pytest.raises(InputError, match="infinitely many poles"):
        pf.analyse(plant, law, pf.parse_region("half_plane(0.1) & sector(0.2)"))
    with pytest.raises(InputError, match="at most 2.5 1/s"):
        pf.analyse(plant, law, HalfPlane(3))
    with pytest.raises(InputError, match="no smallest region is sought"):
        pf.tightest(plant, of="half_plane")
    for of in ("half_plane", "sector"):
        with pytest.raises(InputError, match="ask about half_plane"):
            pf.worst_case(plant, law, of)
    moving = SPRING.replace("range = [80, 120]", "range = [80, 120]\nrate = [-1, 1]")
    with pytest.raises(InputError, match="k moves; leave out its rate"):
        loads(moving)


HARDWARE = """
[actuator.force]
bandwidth = 8
[sensor.velocity]
bandwidth = 20
noise = 0.01
[outputs]
acceleration = {C = ["-k", -2], D = [1], F = [1]}
"""


@pytest.mark.parametrize("more", ["", HARDWARE])
def test_samples_hold_a_dead_time_as_a_delay(more):
    late = loads(SPRING + more)
    plain = loads(SPRING.split("[dead_time")[0] + more)
    for step, delay in [("0.02", 0), ("0.02", "0.5"), ("0.05", 1)]:
        asked = Fraction(delay) + Fraction("0.05") / Fraction(step)
        one = pf.at_sample_time(late, step, delay)
        other = pf.at_sample_time(plain, step, asked)
        assert one == other
        assert one.sampling.late == asked
    assert pf.at_sample_time(late, "0.05", 1) != pf.at_sample_time(plain, "0.05", 1)


@pytest.mark.parametrize(
    ("was", "by", "said"),
    [
        ("time = 0.05", "time = [0.01, 0.05]", "not an interval; give a number"),
        ("[dead_time.force]", "[dead_time.velocity]", "samples hold that of the only input"),
        ("time = 0.05", "time = 5", "500 samples late; at most"),
    ],
)
def test_dead_times_that_samples_do_not_hold_are_refused(was, by, said):
    with pytest.raises(InputError, match=said) as error:
        pf.at_sample_time(loads(SPRING.replace(was, by)), 0.01)
    assert "\n" not in str(error.value)


def test_one_late_input_of_two_is_refused_at_samples():
    two = SPRING.replace('["force [N]"]', '["force [N]", "other [N]"]').replace(
        "B = [[0], [1]]", "B = [[0, 0], [1, 1]]"
    )
    with pytest.raises(InputError, match="that of the only input"):
        pf.at_sample_time(loads(two), 0.01)


def test_a_file_is_compared_with_the_dead_time_of_a_spec(tmp_path, capsys):
    spec, plain = tmp_path / "late.toml", tmp_path / "plain.toml"
    spec.write_text(SPRING)
    plain.write_text(SPRING.split("[dead_time")[0])
    gain = ["--gain", "[[-20, -8]]", "--sample-time", "0.05", "--region", "disk(0, 1)"]
    for name, delay, differs in [("enough", "1.5", False), ("less", "0.5", True)]:
        out = tmp_path / name
        given = [str(plain), *gain, "--delay", delay, "-o", str(out)]
        assert main(["analyse", *given]) == 0
        assert main(["check", str(out), "--spec", str(spec)]) == int(differs)
        assert ("less than the 50 ms of dead_time late" in capsys.readouterr().out) is differs


def test_a_signal_that_is_late_needs_a_sensor():
    plant = loads(SPRING.replace("[dead_time.force]", "[dead_time.velocity]"))
    with pytest.raises(InputError, match=r'give it \[sensor."velocity"\]'):
        Structure(measured=("late velocity",), schedule=()).require_fit(plant)


def test_a_law_measures_no_state_of_it_and_is_not_scheduled_on_it():
    plant = loads(SPRING)
    assert measurable(plant) == ("position", "velocity")
    assert Structure().powers(plant) == Structure(schedule=("k",)).powers(plant)
    with pytest.raises(InputError, match="no sensor knows it"):
        Structure(schedule=("delta",)).powers(plant)
    with pytest.raises(InputError, match="take quadratic"):
        pf.place(plant, HalfPlane(0.1), "scheduled")
