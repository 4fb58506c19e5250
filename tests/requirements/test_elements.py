"""Sectors of static elements: against numbers and functions in them, and of every kind of plant."""

import json
from dataclasses import replace

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError, SpecError
from polefence.certify.bounds import best_bound, kept_bound, sampled
from polefence.certify.robust.elements import broken_elements
from polefence.cli.main import main
from polefence.law.laws import given_law
from polefence.law.structure import Structure
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.requirements.sector import SectorBound
from polefence.requirements.specification import limit_text
from polefence.requirements.text import load_specifications, parse_specification
from polefence.response.modes import Modes
from support.files import is_accepted
from support.specs import MASS_ON_SPRING

GAIN = np.array([[-20.0, -4.0]])
FUNCTIONS = MASS_ON_SPRING.replace("range = [80, 120]", "range = [0, 1]").replace(
    '"-k"', '"-90*cos(k)"'
)


def asked(signal="position", disturbance="push", sector=(-30, 50), at_least=1.0):
    return SectorBound.least(signal, disturbance, sector, at_least)


# --- what is proved, against elements ------------------------------------------------------------


def made(seed, count=1):
    """A stable family of two vertices with elements, as arrays."""
    random = np.random.default_rng(seed)
    n, m = 4, 1
    A = random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + random.uniform(0.3, 1)) * np.eye(n)
    As = [A, A + 0.1 * random.normal(size=(n, n))]
    Bs = [random.normal(size=(n, m))] * 2
    E = random.normal(size=(n, count + 1))
    Es = [E, E + 0.1 * random.normal(size=E.shape)]
    C, D = random.normal(size=(count, n)), 0.3 * random.normal(size=(count, m))
    signals = [Output(f"y{k + 1}", "", C=C[k], D=D[k]) for k in range(count)]
    K = 0.1 * random.normal(size=(m, n))
    plant = pf.UncertainPlant.from_vertices(As, Bs, Es)
    named = [f"w{k + 2}" for k in range(count)]
    ends = np.sort(random.normal(size=(count, 2)), axis=1)
    own = SectorBound(signals, disturbance=named, sector=ends.tolist())
    return (As, Bs, Es, C, D, K), plant, own, random


def sectors_proved(own, bound):
    ends = np.array(own.sector)
    middle, half = ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2
    return middle - half / bound.level, middle + half / bound.level


@pytest.mark.parametrize("seed", range(8))
def test_no_number_in_a_proved_sector_makes_a_loop_unstable(seed):
    count = 1 + seed % 2
    (As, Bs, Es, C, D, K), plant, own, random = made(seed, count)
    bound = best_bound(plant, pf.FixedGain(K), own)
    if bound is None:  # the loop with the centres is not stable
        assert np.isinf(sampled(plant, pf.FixedGain(K), own).worst)
        return
    low, high = sectors_proved(own, bound)
    for t in (0, 1, *random.random(20)):
        A, B, E = ((1 - t) * M[0] + t * M[1] for M in (As, Bs, Es))
        loop, shown = A + B @ K, C + D @ K
        for share in random.random((50, count)).round(random.integers(0, 3)):
            k = low + share * (high - low)
            assert np.linalg.eigvals(loop + (E[:, 1:] * k) @ shown).real.max() < 0


@pytest.mark.parametrize("seed", range(6))
def test_it_is_the_circle_criterion(seed):
    """Of one element the level is its radius times the gain of the loop with its centre."""
    (As, Bs, Es, C, D, K), plant, own, _ = made(seed)
    (a, b), w = own.sector[0], 1j * np.concatenate([[0], np.geomspace(1e-3, 1e3, 20000)])
    highest = 0.0
    for t in np.linspace(0, 1, 21):
        A, B, E = ((1 - t) * M[0] + t * M[1] for M in (As, Bs, Es))
        shown = C + D @ K
        loop = A + B @ K + (a + b) / 2 * E[:, 1:] @ shown
        if np.linalg.eigvals(loop).real.max() >= 0:
            highest = np.inf
            break
        G = shown @ np.linalg.solve(w[:, None, None] * np.eye(4) - loop, E[:, 1:].astype(complex))
        highest = max(highest, np.abs(G).max() * (b - a) / 2)
    bound = best_bound(plant, pf.FixedGain(K), own)
    assert (bound is None) is bool(np.isinf(highest))
    if bound is not None:
        assert highest * (1 - 1e-6) < bound.level < highest * 1.02


@pytest.mark.parametrize("seed", range(3))
def test_elements_that_switch_and_bend_come_to_rest(seed):
    (As, Bs, Es, C, D, K), plant, own, random = made(seed + 20, 2)
    bound = best_bound(plant, pf.FixedGain(K), own)
    assert bound is not None
    low, high = sectors_proved(own, bound)
    loops = [A + B @ K for A, B in zip(As, Bs, strict=True)]
    shown, step = C + D @ K, 2e-3
    for t in (0.0, 1.0, 0.4):
        A, E = ((1 - t) * M[0] + t * M[1] for M in (loops, Es))
        x = random.normal(size=(4, 30))
        first = np.linalg.norm(x)
        share = random.random((2, 30))
        for k in range(30000):
            if k % 150 == 0:
                share = random.integers(0, 2, (2, 30)) * 1.0

            def rate(x, share=share, A=A, E=E, t=t):
                y = shown @ x
                bent = np.abs(np.tanh(3 * y)) if t == 0.4 else 1.0  # of the amplitude too
                slope = low[:, None] + bent * share * (high - low)[:, None]
                return A @ x + E[:, 1:] @ (slope * y)

            x = x + step * rate(x + step / 2 * rate(x))
        assert np.linalg.norm(x) < (0.05 if t == 0.4 else 1e-3) * first


# G(s) = 4 / ((s + 1)(s/2 + 1)(s/3 + 1)) with u = -psi(y), Khalil, Nonlinear Systems, example 7.2
KHALIL = """
name = "three lags"
states = ["a", "b", "y"]
inputs = ["u"]
disturbances = ["w"]
[matrices]
A = [[-1, 0, 0], [2, -2, 0], [0, 3, -3]]
B = [[1], [0], [0]]
E = [[4], [0], [0]]
"""


@pytest.mark.parametrize(
    ("kept", "lost"),
    [
        ([-0.2499, 0.2499], [-0.2502, 0.2502]),  # |G| is at most 4
        ([-1.1644, 0], [-1.1647, 0]),  # the real part of G is at least -0.8588
    ],
)
def test_a_textbook_sector_is_bracketed(kept, lost):
    plant, law = loads(KHALIL), pf.FixedGain(np.zeros((1, 3)))
    assert kept_bound(plant, law, asked("y", "w", kept)) is not None
    assert kept_bound(plant, law, asked("y", "w", lost)) is None
    # a constant is only lost where the gain margin is: at 15/4
    number = broken_elements(plant, law, asked("y", "w", [-4, 0]), [1])
    assert prove(number).proved
    assert float(number.elements.sectors[0][0]) == pytest.approx(-2.5, rel=1e-4)


# --- every kind of plant -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "loose"),
    [
        (MASS_ON_SPRING, 1.01),
        (MASS_ON_SPRING.replace("E = [[0], [1]]", 'E = [[0], ["k/80"]]'), 1.01),
        (MASS_ON_SPRING.replace("120]", "120]\nrate = [-5, 5]"), 1.05),
        (MASS_ON_SPRING.replace("120]", '120]\nrate = "any"'), 1.4),
        (FUNCTIONS, 1.05),
        (FUNCTIONS.replace("E = [[0], [1]]", 'E = [[0], ["2 + sin(k)"]]'), 1.05),
        (
            MASS_ON_SPRING.replace("[parameter.k]", "sample_time = 0.01\n[parameter.k]")
            .replace('A = [[0, 1], ["-k", -2]]', 'A = [[1, 0.01], ["-0.01*k", 0.98]]')
            .replace("B = [[0], [1]]", "B = [[0], [0.01]]")
            .replace("E = [[0], [1]]", "E = [[0], [0.01]]"),
            1.01,
        ),
    ],
)
def test_sectors_of_every_kind_of_plant(text, loose):
    plant = loads(text)
    law, own = given_law(plant, GAIN), asked(at_least=None)
    bound = best_bound(plant, law, own)
    seen = sampled(plant, law, own, seeded(plant, 60)).worst
    assert seen * (1 - 1e-9) < bound.level < seen * loose
    assert "globally exponentially stable" in bound.claim.statement(file_of(plant))


def file_of(plant):
    from polefence.plant.exact import file_plant

    return file_plant(plant)


SENSED = MASS_ON_SPRING + (
    '[outputs]\naccelerometer = {C = ["-k", -2], D = [1], F = [1]}\n'
    "mixed = {C = [1, 0.5], F = [0.02]}\nsent = {C = [1, 0], D = [0.01]}\n"
)


@pytest.mark.parametrize("measured", [("mixed", "velocity"), ("accelerometer without inputs",)])
def test_what_a_law_measures_has_the_force_of_the_element(measured):
    """Against the loop written out: u = K (C x + F w), w = k y."""
    plant = loads(SENSED)
    K = np.array([[-5.0, -2.0][: len(measured)]]) / (1 if len(measured) > 1 else 50)
    law = Structure(measured=measured, schedule=()).law(plant, K[None])
    own = asked(sector=(-30, 10), at_least=None)
    bound = best_bound(plant, law, own)
    seen = sampled(plant, law, own, seeded(plant, 60)).worst
    assert seen < bound.level < 1.02 * seen
    (low,), (high,) = sectors_proved(own, bound)
    highest = 0.0
    for k in np.linspace(80, 120, 5):
        A = np.array([[0.0, 1], [-k, -2]])
        rows = {"mixed": [1, 0.5], "velocity": [0, 1], "accelerometer without inputs": [-k, -2]}
        C = np.array([rows[name] for name in measured])
        F = np.array([[{"mixed": 0.02, "velocity": 0}.get(name, 1)] for name in measured])
        b = np.array([[0.0], [1]])
        for c in np.linspace(low, high, 9):
            y = np.array([[1.0, 0]])
            loop = A + b @ K @ (C + F * c @ y) + b * c @ y
            assert np.linalg.eigvals(loop).real.max() < 0
        c = (low + high) / 2
        loop, into = A + b @ K @ (C + F * c @ y) + b * c @ y, b + b @ K @ F
        s = 1j * np.linspace(0, 40, 8001)[:, None, None] * np.eye(2)
        highest = max(highest, np.abs(np.linalg.solve(s - loop, into.astype(complex))[:, 0]).max())
    assert 1 / highest == pytest.approx((high - low) / 2, rel=2e-2)


def test_a_signal_may_have_inputs_in_it_but_no_elements():
    plant, law = loads(SENSED), pf.FixedGain(GAIN)
    own = asked("sent", at_least=None)
    assert best_bound(plant, law, own).level > sampled(plant, law, own).worst * (1 - 1e-9)
    with pytest.raises(InputError, match="passes straight into 'accelerometer', which it depends"):
        asked("accelerometer").require_fit(plant)
    through = Structure(measured=("mixed",), schedule=()).law(plant, np.array([[[-5.0]]]))
    with pytest.raises(InputError, match="and the law into the element's signal"):
        best_bound(plant, through, own)
    assert own.readable(plant, ("mixed", "velocity")) == ("velocity",)
    assert asked().readable(plant, ("mixed", "velocity")) == ("mixed", "velocity")


# --- slopes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_slopes_are_those_of_central_differences(seed, count):
    """Of the highest value, while weights follow; and of what passes through a law."""
    (*_, K), plant, own, random = made(seed, count)
    alpha = np.array([[1.0, 0], [0, 1], [0.3, 0.7]])
    channel = own.channel(plant, alpha).in_units(np.array([1.0, 2.0, 0.5, 4.0]))
    channel = replace(channel, D=0 * channel.D)
    through = 0.3 * random.normal(size=(3, 1, plant.disturbance_count))

    def found(K, P=through):
        modes = Modes(channel.A + channel.B @ K[None])
        return own.slopes(channel.closed(np.broadcast_to(K, (3, *K.shape)), modes, P))

    first = found(K)
    top, most, size = int(first.values.argmax()), *((5e-2, 1e-3) if count > 1 else (1e-4, 1e-5))
    rows = np.eye(len(first.values)) if first.mixed is None else first.mixed
    dK = np.tensordot(rows[top], channel.slopes(first), 1)
    dP = np.zeros_like(through)
    np.add.at(dP, first.points, rows[top][:, None, None] * channel.passing_slopes(first))
    for _ in range(3):
        step = random.normal(size=K.shape)
        ahead, back = (found(K + s * size * step).values.max() for s in (1, -1))
        assert (ahead - back) / 2 / size == pytest.approx(
            (dK * step).sum(), abs=most * np.abs(dK).max()
        )
        step = random.normal(size=through.shape)
        ahead, back = (found(K, through + s * size * step).values.max() for s in (1, -1))
        assert (ahead - back) / 2 / size == pytest.approx(
            (dP * step).sum(), abs=most * np.abs(dP).max()
        )


def test_values_are_more_than_a_limit_where_the_centre_is_not_stable():
    plant = loads(KHALIL)
    own = replace(asked("y", "w", [-8, 0]), at_most=3.0)
    channel = own.channel(plant, np.ones((1, 1)))
    K = np.zeros((1, 1, 3))
    assert own.slopes(channel.closed(K, Modes(channel.A))).values.max() > 3.0
    assert np.isinf(own.values(plant, pf.FixedGain(K[0]), np.ones((1, 1)))[0])


# --- commands and files --------------------------------------------------------------------------

SPEC = (
    MASS_ON_SPRING
    + "[law]\nschedule = []\n"
    + '[[specification]]\nkind = "rms"\nsignal = "force"\ndensity = 1\nminimise = true\n'
    + '[[specification]]\nkind = "sector"\nsignal = "position"\ndisturbance = "push"\n'
    + "sector = [-60, 90]\n"
)


def test_a_law_is_tuned_for_it_and_its_file_says_so(tmp_path, capsys):
    spec, out, said = (tmp_path / name for name in ("spring.toml", "out", "said.json"))
    spec.write_text(SPEC)
    passive = ["verify", str(spec), "--gain", "none", "--json", str(said)]
    assert main(passive) == 1
    assert main(["optimise", str(spec), "--json", str(said), "-o", str(out)]) == 0
    row = json.loads(said.read_text())["bounds"][1]
    assert row["kind"] == "sector"
    assert row["limit"] == row["proved"] == 1 < row["worst sampled"] < 1.01
    capsys.readouterr()
    assert main(["check", str(out), "--spec", str(spec)]) == 0
    text = capsys.readouterr().out
    assert "'push' = w1 = phi(t, y) in [-60, 90], y = 'position' = x1" in text
    assert "for every phi with y phi(t, y) between a y^2 and b y^2" in text
    other = tmp_path / "other.toml"
    other.write_text(SPEC.replace("E = [[0], [1]]", "E = [[0], [1.01]]"))
    assert main(["check", str(out), "--spec", str(other)]) == 1


def test_robust_finds_a_number_that_fails(tmp_path, capsys):
    """Of a spring k with damping d, a number above k fails, and one of the rate above d."""
    spec = tmp_path / "spring.toml"
    spec.write_text(SPEC)
    words = ["robust", str(spec), "--gain", "[[-20, -4]]", "-o", str(tmp_path / "out")]
    words += ["--limit", "sector of velocity with disturbance [push] with sector [-4, 4]"]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "1.500001 fails at k = 80, push = 6.000004 velocity" in said
    made = str(tmp_path / "out" / "margins.json")
    assert main(["check", made, "--spec", str(spec)]) == 0
    assert "with 'push' = w1 = 6.000004 y, y = 'velocity' = x2" in capsys.readouterr().out
    for old, new in (("E = [[0], [1]]", "E = [[0], [2]]"), ("velocity [m/s]", "speed [m/s]")):
        spec.write_text(SPEC.replace(old, new))
        assert main(["check", made, "--spec", str(spec)]) == 1


def test_what_is_not_proved_is_refuted_by_numbers_alone(tmp_path, capsys):
    spec = tmp_path / "lags.toml"
    spec.write_text(KHALIL)
    answers = []
    for low in (-1.1, -2.0, -2.6):
        limit = f"sector of y with disturbance [w] with sector [{low}, 0] >= 1"
        main(["verify", str(spec), "--gain", "none", "--limit", limit])
        answers.append(capsys.readouterr().out.splitlines()[1].partition(":")[0])
    assert answers == ["proved", "undecided", "refuted"]


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    plant, folder = loads(MASS_ON_SPRING), tmp_path_factory.mktemp("file")
    region = pf.parse_region("half_plane(0)")
    pf.analyse(plant, pf.FixedGain(GAIN), region, limits=[asked()]).design.save(folder)
    document = json.loads((folder / "design.json").read_text())
    assert is_accepted(document)
    return document


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("level", lambda x: x * 0.2),
        ("level", lambda _: 0),
        ("level", lambda x: -x),
        ("weights", lambda _: [0]),
        ("weights", lambda _: [-1]),
        ("weights", lambda _: [1, 1]),
        ("sectors", lambda _: [[-200, 50]]),
        ("sectors", lambda _: [[-30, 400]]),
        ("sectors", lambda _: [[50, -30]]),
        ("sectors", lambda _: [[10, 10]]),
        ("sectors", lambda _: [[-30, 50], [0, 1]]),
        ("disturbances", lambda _: [2]),
        ("disturbances", lambda _: [0]),
        ("disturbances", lambda _: [1, 1]),
        ("disturbances", lambda _: []),
        ("outputs", lambda x: [x[0] | {"C": [[20, 0]]}]),
        ("outputs", lambda x: [x[0] | {"name": "velocity"}]),
        ("outputs", lambda x: [x[0] | {"F": [[1]]}]),
        ("outputs", lambda x: [x[0] | {"D": [[9]]}]),
        ("outputs", lambda x: [x[0], x[0]]),
        ("outputs", lambda _: []),
    ],
)
def test_one_fault_in_a_file_and_it_is_not_proved(document, key, change):
    table = json.loads(json.dumps(document))
    claim = next(own for own in table["claims"] if own["kind"] == "sector")
    claim[key] = change(claim.get(key))
    assert not is_accepted(table)


def test_a_product_that_is_not_affine_is_refused():
    both = MASS_ON_SPRING.replace("E = [[0], [1]]", 'E = [[0], ["k/80"]]') + (
        '[outputs]\n"spring force" = {C = ["k", 0]}\n'
    )
    with pytest.raises(InputError, match="both depend on parameters"):
        asked("spring force").require_fit(loads(both))
    functions = both.replace("[80, 120]", "[0, 1]").replace('"k/80"', '"2 + sin(k)"')
    with pytest.raises(InputError, match="both depend on parameters"):
        asked("spring force").require_fit(loads(functions))


def test_samples_and_dead_times_are_refused():
    plant = loads(MASS_ON_SPRING)
    with pytest.raises(InputError, match="leave out the sample time"):
        asked().require_fit(pf.at_sample_time(plant, 0.01))
    with pytest.raises(InputError, match="with a dead time"):
        asked().require_fit(loads(MASS_ON_SPRING + "[dead_time.force]\ntime = 0.002\n"))
    with pytest.raises(InputError, match="so that a law is tuned"):
        pf.optimise(plant, asked(at_least=None), [], method="quadratic")


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("sector = [0, 1]", "disturbance is missing"),
        ('disturbance = "push"', "sector is missing"),
        ('disturbance = "push"\nsector = [1, 1]', "must be two numbers, the smaller first"),
        ('disturbance = "push"\nsector = [[0, 1], [0, 1]]', "must be two numbers"),
        ('disturbance = "push"\nsector = 3', "must be two numbers"),
        ('disturbance = ["push", "push"]\nsector = [0, 1]', "one for each signal"),
        ("disturbance = 3\nsector = [0, 1]", "must name one for each signal"),
        ('disturbance = "push"\nsector = [0, 1]\nat_most = 1', "at_most is for other kinds"),
        ('disturbance = "push"\nsector = [0, 1]\nat_least = 0', "positive number"),
        ('disturbance = "push"\nsector = [0, 1]\nloops = ["force"]', "unknown key loops"),
        ('disturbance = "push"\nsector = [0, 1]\nat_least = 2\nmaximise = true', "one of them"),
    ],
)
def test_bad_ones_are_refused_in_a_line(tmp_path, keys, said):
    path = tmp_path / "bad.toml"
    path.write_text(
        MASS_ON_SPRING + f'[[specification]]\nkind = "sector"\nsignal = "position"\n{keys}\n'
    )
    with pytest.raises(SpecError, match=said) as error:
        load_specifications(path)
    assert "\n" not in str(error.value)


def test_it_reads_as_it_is_written(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(
        MASS_ON_SPRING.replace('["push [N]"]', '["push [N]", "drag [N]"]').replace(
            "E = [[0], [1]]", "E = [[0, 0], [1, 1]]"
        )
        + '[[specification]]\nkind = "sector"\nsignal = ["position", "velocity"]\n'
        + 'disturbance = ["push", "drag"]\nsector = [[-30, 50], [-0.5, 2]]\nat_least = 1.25\n'
        + '[[specification]]\nkind = "sector"\nsignal = "position"\ndisturbance = "push"\n'
        + "sector = [0, 1]\nmaximise = true\n"
    )
    least, (both,) = load_specifications(path)
    assert least == asked(sector=[0, 1], at_least=None)
    assert both == asked(
        ["position", "velocity"], ["push", "drag"], [[-30, 50], [-0.5, 2]], at_least=1.25
    )
    assert both.limit == 1.25
    assert parse_specification(limit_text(both)) == both
    with pytest.raises(InputError, match="no disturbance 'wind'"):
        asked(disturbance="wind").require_fit(loads(MASS_ON_SPRING))
