"""Crossing a bump: proved for all parameters, against simulations; slopes, files, bad input."""

import json
from fractions import Fraction

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval
from scipy.linalg import expm

import polefence as pf
from polefence.base.errors import InputError, SpecError
from polefence.certify.bounds import best_bound, kept_bound, sampled
from polefence.cli.main import main
from polefence.examples import family
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.document import check, from_plain
from polefence.proof.drives import Bump
from polefence.proof.work import FormatError
from polefence.requirements.bump import BumpMeasure, BumpNearness
from polefence.requirements.slopes import Loops
from polefence.requirements.text import parse_specification
from polefence.response.modes import Modes
from polefence.vehicle import bump as road
from polefence.vehicle import drive, on_road
from support.specs import ONE_STATE

LAG = ONE_STATE.replace("[0.5, 2]", "[-2, -0.5]")
STEP = 2e-3
T = np.arange(0, 12, STEP)

# --- what drives it ------------------------------------------------------------------------------


@pytest.mark.parametrize("is_rate", [True, False])
@pytest.mark.parametrize(("low", "high"), [("1/10", "1/8"), ("1/5", "19/55"), ("1/10", "31/110")])
def test_a_drive_is_the_bump_within_what_it_says(low, high, is_rate):
    own = Bump(Fraction("0.05"), Fraction("0.1"), Fraction(3, 11), is_rate)
    low, high = Fraction(low), Fraction(high)
    w, off = own.on(low, high, 12, 60)
    s = np.linspace(-1, 1, 301)
    u = (float(low) + (s + 1) / 2 * float(high - low) - 0.1) * 11 / 3
    exact = (
        np.pi * 0.05 * 11 / 3 * np.sin(2 * np.pi * u) if is_rate else 0.05 * np.sin(np.pi * u) ** 2
    )
    found = np.abs(chebval(s, np.array([float(x) for x in w]) / 2.0**60) - exact).max()
    assert found <= float(off) + 1e-15
    assert float(off) < 1e-9 or found > 1e-3 * float(off)


def test_a_drive_is_zero_outside_and_refuses_steps_across_its_ends():
    own = Bump(Fraction(1), Fraction(1, 10), Fraction(1, 5), True)
    assert own.on(Fraction(0), Fraction(1, 10), 12, 60) == ((), 0)
    assert own.on(Fraction(3, 10), Fraction(2), 12, 60) == ((), 0)
    for low, high in ((0, "1/5"), ("1/5", "2/5"), (0, 1)):
        with pytest.raises(FormatError, match="no end where a bump begins or ends"):
            own.on(Fraction(low), Fraction(high), 12, 60)


# --- against simulations -------------------------------------------------------------------------


def crossed(seed):
    """A family of two to four states with two roads, one of them late; and its parts."""
    random = np.random.default_rng([seed, 53])
    n, count = int(random.integers(2, 5)), int(random.integers(1, 3))
    S = random.normal(size=(n, n))
    A = 4 * (S - S.T) + random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.6) * np.eye(n)
    E, C = random.normal(size=(n, 2)), random.normal(size=n)
    F = random.normal(size=2) * (seed % 2)
    more = 0.05 * random.normal(size=(count, n, n))
    terms = [(f"p{k}", M) for k, M in enumerate(more)]
    rows = [
        [" + ".join([repr(float(A[i, j])), *(f"{float(M[i, j])!r}*{p}" for p, M in terms)])
         for j in range(n)]
        for i in range(n)
    ]  # fmt: skip
    parameters = [pf.Parameter(p, -1, 1) for p, _ in terms]
    plant = pf.UncertainPlant.from_expressions(
        parameters, rows, np.ones((n, 1)), E=E, disturbances=["front [m/s]", "rear [m]"]
    )
    at = random.uniform(-1, 1, (60, count))
    at[:20] = np.sign(at[:20])
    signal = Output("y", "", C=C, F=F) if seed % 2 else Output("y", "", C=C)
    length, late = (
        float(np.round(random.uniform(0.3, 3), 2)),
        float(np.round(random.uniform(0, 1), 1)),
    )
    own = {"height": 0.5, "length": length, "speed": 2.0, "late": {"rear": late}}
    return plant, signal, A + np.tensordot(at, more, 1), E, C, F, own, random


def waves(own):
    """The rate of the road under the front wheel and its height under the rear one."""
    duration, late = own["length"] / own["speed"], own["late"]["rear"]
    u, v = T / duration, (T - late) / duration
    rate = np.pi * own["height"] / duration * np.sin(2 * np.pi * u) * (u <= 1)
    height = own["height"] * np.sin(np.pi * v) ** 2 * ((v >= 0) & (v <= 1))
    return np.stack([rate, height])


def simulated(A, E, C, F, w):
    """y at times T of many loops, w taken as linear between samples."""
    count, n, _ = A.shape
    whole = np.zeros((count, n + 4, n + 4))
    whole[:, :n, :n], whole[:, :n, n : n + 2] = A, E
    whole[:, n : n + 2, n + 2 :] = np.eye(2) / STEP
    step = np.array([expm(STEP * M) for M in whole])
    x, y = np.zeros((count, n)), np.empty((count, len(T)))
    for k in range(len(T)):
        y[:, k] = x @ C + F @ w[:, k]
        if k + 1 < len(T):
            z = np.concatenate(
                [x, np.tile([*w[:, k], *(w[:, k + 1] - w[:, k])], (count, 1))], axis=1
            )
            x = np.einsum("kij,kj->ki", step[:, :n], z)
    return y


@pytest.mark.parametrize("seed", range(8))
def test_a_proved_measure_is_that_of_the_worst_plant(seed):
    """Of 60 plants simulated otherwise: never below, within 2 % of them."""
    plant, signal, A, E, C, F, own, _ = crossed(seed)
    y, law = simulated(A, E, C, F, waves(own)), pf.FixedGain(np.zeros((1, len(E))))
    size = np.abs(y).max()
    bound = best_bound(plant, law, BumpMeasure(signal, **own))
    assert prove(bound.claim).proved
    assert size * (1 - 1e-4) <= bound.level <= 1.02 * size
    late = max(T[np.flatnonzero(np.abs(row) > 0.1 * size)[-1] + 1] for row in y)
    asked = BumpMeasure(signal, measure="settling", band=float(0.1 * size), **own)
    bound = best_bound(plant, law, asked)
    assert late - 3e-3 <= bound.level <= 1.02 * late + 3e-3
    middle, half = (y.max(axis=0) + y.min(axis=0)) / 2, 0.6 * size
    points = [(T[k], middle[k] - half, middle[k] + half) for k in (0, 200, 400, 1000)]
    times, low, high = np.array([*points, (6.0, -size, size)]).T
    asked = BumpMeasure(signal, envelope=[*points, (6.0, -size, size)], **own)
    low, high = np.interp(T, times, low), np.interp(T, times, high)
    worst = (np.abs(y - (low + high) / 2) / (high - low) * 2).max()
    assert worst * (1 - 1e-3) <= best_bound(plant, law, asked).level <= 1.02 * worst


@pytest.mark.parametrize(("level", "kept"), [(1.001, True), (0.999, False)])
def test_a_limit_is_bracketed(level, kept):
    """x' = -a x + w, 1/2 <= a <= 2, w the rate: the slowest is worst."""
    plant, law = loads(LAG), pf.FixedGain([[0.0]])
    own = {"height": 0.1, "length": 1.0, "speed": 2.0}
    a, duration, t = 0.5, 0.5, np.linspace(0, 0.5, 200_001)
    turn = 2 * np.pi / duration
    x = np.sin(turn * t) * a - turn * np.cos(turn * t) + turn * np.exp(-a * t)
    most = (np.pi * 0.1 / duration * x / (a**2 + turn**2)).max()
    limit = BumpMeasure("x", float(most * level), **own)
    assert (kept_bound(plant, law, limit) is not None) is kept
    assert sampled(plant, law, limit).worst == pytest.approx(most, rel=1e-8)


def test_a_car_never_exceeds_it_when_it_is_driven(tmp_path):
    """Of 1000 loads and ages over the bump that `simulate` has."""
    car, law = family("quarter-car-ride"), pf.FixedGain([[0, 0, -1500.0, 0]])
    own = {"height": 0.05, "length": 2.0, "speed": 8.0}
    names = ("sprung-mass acceleration", "suspension deflection")
    levels = [best_bound(car, law, BumpMeasure(name, **own)).level for name in names]
    rode = drive(car, law, on_road(car, road(0.05, 2.0, after=20.0), 8.0, 2e-3), seeded(car, 1000))
    worst = np.abs(rode.response(names).values).max(axis=(0, 1))
    for most, level in zip(worst, levels, strict=True):
        assert 0.97 * level < most <= level


# --- slopes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["peak", "envelope", "nearness"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_slopes_are_those_of_central_differences(kind, seed):
    plant, signal, A, _, _, _, own, random = crossed(seed)
    asked = {
        "peak": BumpMeasure(signal, **own),
        "envelope": BumpMeasure(signal, envelope=[(0.1, -1, 1.1), (0.5, -0.3, 0.8)], **own),
        "nearness": BumpNearness(signal, 1.0, measure="settling", band=0.1, time=0.7, **own),
    }[kind]
    channel = asked.channel(plant, np.eye(len(plant.vertices))[:1])
    loop = {"A": A[30], **{key: getattr(channel, key)[0] for key in "ECF"}}

    def found(**moved):
        M = {**loop, **moved}
        return asked.slopes(Loops(Modes(M["A"][None]), *(M[key][None] for key in "ECF")))

    first = found()
    (turned,) = first.turned()
    k = first.values.argmax()
    for key, M in loop.items():
        along, size = random.normal(size=M.shape), 1e-6
        ahead, back = (found(**{key: M + sign * size * along}).values.max() for sign in (1, -1))
        slope = float((getattr(turned, key)[k] * along).sum())
        assert (ahead - back) / 2 / size == pytest.approx(slope, rel=1e-4, abs=1e-5)


# --- files and commands --------------------------------------------------------------------------

HALF = """
name = "one wheel behind another"
states = ["x [m]", "v [m/s]"]
inputs = ["force [N]"]
disturbances = ["front [m/s]", "rear [m/s]"]
[parameter.k]
range = [80, 120]
[matrices]
A = [[0, 1], ["-k", -6]]
B = [[0], [1]]
E = [[-1, 0.5], [2, -1]]
[[specification]]
kind = "bump"
signal = "x"
height = 0.05
length = 1
speed = 5
late = {rear = 0.25}
"""


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bump")
    spec, out, said = (folder / name for name in ("own.toml", "out", "said.json"))
    spec.write_text(
        HALF + 'at_most = 0.03\n[law]\nschedule = []\n[[specification]]\nkind = "rms"\n'
        'signal = "force"\ndensity = 1\nminimise = true\n'
    )
    assert main(["optimise", str(spec), "--json", str(said), "-o", str(out)]) == 0
    return spec, out, json.loads(said.read_text())


def test_a_law_is_tuned_for_a_bump(saved, capsys):
    spec, out, said = saved
    rows = said["bounds"]
    assert [row["kind"] for row in rows] == ["rms", "bump"]
    assert rows[1]["proved"] == 0.03
    assert rows[1]["worst sampled"] > 0.029
    assert rows[0]["proved"] > 0
    capsys.readouterr()
    assert main(["check", str(out), "--spec", str(spec)]) == 0
    text = capsys.readouterr().out
    assert (
        "peak of 'x' = x1 <= 0.03 over a bump of 0.05 m in 1 m at 5 m/s, where 'front' = w1 is "
        "its rate and 'rear' = w2 is its rate, 0.25 s later, on the simplex"
    ) in text


def is_proved(document):
    try:
        return check(from_plain(document)).proved
    except FormatError:
        return False


FAULTS = {
    "level": [0.02, 0.0299, 0],
    "height": [0.06, 0, -1, None],
    "length": [0.5, 2, 0, None],
    "speed": [20, 0, None],
    "acts": [["rate"], ["rate", "way"], [], None],
    "late": [[0, 0.1], [0], [0, -1], None],
    "disturbances": [[1.1, 1], [2, 1]],
    "measure": ["settling", "envelope", "overshoot", "final"],
}


def test_one_fault_in_a_file_and_it_is_not_proved(saved):
    document = json.loads((saved[1] / "design.json").read_text())
    assert is_proved(document)
    place = next(k for k, own in enumerate(document["claims"]) if own["kind"] == "bump")
    following = document["claims"][place]["following"]
    faults = [(key, x) for key, values in FAULTS.items() for x in values]
    others = ({"rate": 1000}, {"reach": "1/1000000"}, {"lengths": [[1, 1]]})
    faults += [("following", [each | own for each in following]) for own in others]
    for key, value in faults:
        table = json.loads(json.dumps(document))
        if value is None:
            table["claims"][place].pop(key)
        else:
            table["claims"][place][key] = value
        assert not is_proved(table), (key, value)


def test_a_line_is_of_the_specs_wheels(saved):
    spec = saved[0]
    plant = pf.load(spec)
    from polefence.requirements.asked import promised

    line = "bump of v <= 9 with height 0.05 with length 1 with speed 5"
    (own,) = promised(plant, spec, [line], "--limit")
    assert own.late == (("rear", 0.25),)
    assert parse_specification(f"{own.title} <= 9").in_units_of(own) == own


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("bump of x", r"height is missing; write height = 0.05"),
        ("bump of x with height 0.1 with length 2", r"speed is missing; write speed = 10"),
        ("bump of x with height 0 with length 2 with speed 3", r"height = 0.* must be above zero"),
        ("bump of x with height 1 with length 2 with speed -3", r"speed = -3.* must be above"),
        ("bump of x with height 1 with length 2 with speed 3 with acts up", 'acts = .*"rate" or'),
        (
            "bump of x with height 1 with length 2 with speed 3 with measure rise",
            "measure = 'rise'",
        ),
    ],
)
def test_bad_lines_say_what_is_wrong(line, why):
    with pytest.raises((InputError, SpecError), match=why):
        parse_specification(line)


TABLES = {
    "late = 3": "late = 3 must be a table of disturbances and times",
    "late = {rear = -1}": "late: 'rear' = -1.0 must be zero or more",
    "late = {back = 1}": "late: no disturbance 'back'; known: front, push, rear",
    "disturbances = ['push']": "'push' is in N, and a road in m/s or m",
}


@pytest.mark.parametrize("keys", TABLES)
def test_bad_tables_say_what_is_wrong(keys, tmp_path, capsys):
    text = HALF.replace("late = {rear = 0.25}", keys) + "at_most = 1\n"
    text = text.replace(
        '["front [m/s]", "rear [m/s]"]', '["front [m/s]", "rear [m/s]", "push [N]"]'
    )
    spec = tmp_path / "own.toml"
    spec.write_text(text.replace("[[-1, 0.5], [2, -1]]", "[[-1, 0.5, 0], [2, -1, 1]]"))
    assert main(["optimise", str(spec), "--minimise", "rms of force with density 1"]) == 2
    said = capsys.readouterr().err
    assert TABLES[keys] in said
    assert said.count("\n") == 1


def test_a_plant_without_units_is_told_what_its_disturbance_is():
    plant = loads(LAG.replace("w [m/s]", "w"))
    law, own = pf.FixedGain([[0.0]]), {"height": 0.1, "length": 1.0, "speed": 2.0}
    with pytest.raises(InputError, match=r'no disturbance of .* is in m/s or m.*acts = "rate"'):
        best_bound(plant, law, BumpMeasure("x", **own))
    rate, height = (
        best_bound(plant, law, BumpMeasure("x", acts=w, **own)) for w in ("rate", "height")
    )
    assert rate.level > 2 * height.level > 0
