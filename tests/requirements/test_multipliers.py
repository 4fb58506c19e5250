"""Elements that do not depend on time: Popov's criterion, against the criterion itself."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import linprog

import polefence as pf
from polefence.base.errors import InputError, SpecError
from polefence.certify.bounds import best_bound, kept_bound, sampled
from polefence.certify.robust.elements import broken_elements, factor_of
from polefence.cli.main import main
from polefence.law.structure import Structure
from polefence.plant.exact import file_plant
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.work import FormatError
from polefence.requirements import multipliers
from polefence.requirements.sector import SectorBound
from polefence.requirements.specification import limit_text
from polefence.requirements.text import load_specifications, parse_specification
from polefence.response.modes import Modes
from support.elements import with_elements
from support.files import is_accepted
from support.specs import MASS_ON_SPRING

GAIN = np.array([[-20.0, -4.0]])


def asked(signal="position", disturbance="push", sector=(-30, 50), at_least=1.0, invariant=True):
    return SectorBound.least(signal, disturbance, sector, at_least, time_invariant=invariant)


def lagging(poles, gain):
    """1 / ((s + a)(s + b)...) times a gain, as a chain whose last state is y."""
    n = len(poles)
    rows = [[0.0] * n for _ in poles]
    for i, a in enumerate(poles):
        rows[i][i] = -a
        if i:
            rows[i][i - 1] = a
    words = ", ".join(f'"x{i}"' for i in range(n - 1))
    return loads(
        f'name = "lags"\nstates = [{words}, "y"]\ninputs = ["u"]\ndisturbances = ["w"]\n'
        f"[matrices]\nA = {rows}\nB = {[[1], *[[0]] * (n - 1)]}\nE = {[[gain], *[[0]] * (n - 1)]}\n"
    )


# --- against theory ------------------------------------------------------------------------------


@pytest.mark.parametrize("invariant", [True, False])
def test_a_textbook_sector_is_bracketed(invariant):
    """G = 4 / ((s + 1)(s/2 + 1)(s/3 + 1)): numbers to 15/4, the circle to 1.1645 (Khalil, 7.2).

    Of third order with no zeros Popov's line touches the curve where it crosses the axis.
    """
    plant, law = lagging([1, 2, 3], 4), pf.FixedGain(np.zeros((1, 3)))
    edge = 2.5 if invariant else 1.16446
    for share, kept in ((0.9995, True), (1.0005, False)):
        own = asked("y", "w", [-share * edge, 0], invariant=invariant)
        assert (kept_bound(plant, law, own) is not None) is kept
    number = broken_elements(plant, law, asked("y", "w", [-2.4, 0]), [1])
    assert factor_of(number, plant, asked("y", "w", [-2.4, 0])) == pytest.approx(2.6 / 2.4)


def popov_edge(G, w):
    """The largest k of a sector [0, k] of w = -phi(y): Re (1 + jwq) G > -1/k for some q."""
    # least 1/k = t of t + Re G - q w Im G >= 0
    rows = np.stack([-np.ones(len(w)), w * G.imag], axis=1)
    found = linprog([1, 0], A_ub=rows, b_ub=G.real, bounds=[(0, None), (None, None)])
    return np.inf if found.fun == 0 else 1 / found.fun


@pytest.mark.parametrize("seed", range(5))
def test_it_is_popovs_criterion(seed):
    """Of one element in the sector [0, k]: Popov's line, by linear programming."""
    random = np.random.default_rng(seed)
    n = 4
    S = random.normal(size=(n, n))
    A = 2 * (S - S.T) + 0.3 * random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.4) * np.eye(n)
    E = random.normal(size=(n, 1))
    E[0] = 0
    w = np.concatenate([[0], np.geomspace(1e-3, 1e3, 6000), np.linspace(0.01, 12, 6000)])
    G = np.linalg.solve(1j * w[:, None, None] * np.eye(n) - A, -E.astype(complex))[:, 0, 0]
    edge, circle = popov_edge(-G, w), 1 / max(1e-9, (G.real).max())
    assert edge >= circle
    plant = pf.UncertainPlant.from_vertices([A], [np.ones((n, 1))], [E])
    law = pf.FixedGain(np.zeros((1, n)))
    y = Output("y", "", C=np.eye(1, n)[0])
    for invariant, k in ((True, edge), (False, circle)):
        for share, kept in ((0.998, True), (1.003, False)):
            own = SectorBound(
                y, 1.0, disturbance="w1", sector=[-share * k, 0], time_invariant=invariant
            )
            assert (kept_bound(plant, law, own) is not None) is kept


def made(seed, count=1):
    """A stable family of two vertices with elements that do not enter the rates of signals."""
    return with_elements(seed, count, entering=False, time_invariant=True)


def sectors_proved(own, bound):
    ends = np.array(own.sector)
    middle, half = ends.mean(axis=1), (ends[:, 1] - ends[:, 0]) / 2
    return middle - half / bound.level, middle + half / bound.level


@pytest.mark.parametrize("seed", [0, 1, 3, 5])
def test_what_is_proved_is_nearer_to_the_numbers_that_fail(seed):
    """Than the circle criterion, and no number in a proved sector fails."""
    count = 1 + seed % 2
    (As, Bs, E, K), plant, own, random = made(seed, count)
    law = pf.FixedGain(K)
    bound = best_bound(plant, law, own)
    circle = best_bound(plant, law, replace(own, time_invariant=False))
    assert bound.level < 0.99 * circle.level
    assert bound.level < 1.01 * sampled(plant, law, own, seeded(plant, 60)).worst
    fails = min(own.linear(plant, law, seeded(plant, 60))[0])
    assert 1 / circle.level < 1 / bound.level <= fails * (1 + 1e-6)
    low, high = sectors_proved(own, bound)
    shown = np.eye(count, len(E))
    for t in (0, 1, *random.random(10)):
        A, B = ((1 - t) * M[0] + t * M[1] for M in (As, Bs))
        for share in random.random((50, count)).round(random.integers(0, 3)):
            k = low + share * (high - low)
            assert np.linalg.eigvals(A + B @ K + (E[:, 1:] * k) @ shown).real.max() < 0


@pytest.mark.parametrize("sector", [(-60, 90), (-70, 10)])
def test_the_energy_falls_whatever_the_element_does(sector):
    """V of the docstring, of the file's own numbers, at random states and values in the sector."""
    plant = loads(MASS_ON_SPRING.replace("120]", '120]\nrate = "any"'))
    bound = kept_bound(plant, pf.FixedGain(GAIN), asked(sector=sector))
    (p,), level = map(float, bound.claim.elements.multipliers), float(bound.claim.level)
    c, rho = sum(sector) / 2, (sector[1] - sector[0]) / 2 / level
    random = np.random.default_rng(1)
    for k in (80, 100, 120):
        P = bound.lyapunov_at(k=k)
        A = np.array([[0, 1], [-k, -2]]) + [[0], [1]] @ GAIN
        x = random.normal(size=(4000, 2))
        y = x[:, 0]
        z = rho * y * random.choice([-1, -0.999, 0, 0.5, 1], size=y.shape)
        rate = x @ A.T
        rate[:, 1] += c * y + z
        quadratic = 2 * ((x @ P) * rate).sum(axis=1) / level  # of a supply over the level
        more = 2 * abs(p) * (rho * y + np.sign(p) * z) * rate[:, 0]
        assert (quadratic + more < 0).all()
        assert not (quadratic < 0).all()
        assert not (more < 0).all()


@pytest.mark.parametrize("seed", range(3))
def test_elements_that_bend_come_to_rest(seed):
    (As, Bs, E, K), plant, own, random = made(seed, 2)
    bound = best_bound(plant, pf.FixedGain(K), own)
    low, high = sectors_proved(own, bound)
    step = 2e-3
    for t in (0.0, 1.0):
        A = (1 - t) * (As[0] + Bs[0] @ K) + t * (As[1] + Bs[1] @ K)
        x = random.normal(size=(len(A), 30))
        first, bend = np.linalg.norm(x), random.uniform(-3, 3, (2, 30))

        def rate(x, A=A, bend=bend):
            y = x[:2]
            share = (1 + np.tanh(bend * y) * np.cos(7 * bend * y)) / 2  # not odd
            return A @ x + E[:, 1:] @ ((low[:, None] + share * (high - low)[:, None]) * y)

        for _ in range(20000):
            x = x + step * rate(x + step / 2 * rate(x))
        assert np.linalg.norm(x) < 0.02 * first


# --- every kind of plant -------------------------------------------------------------------------

FUNCTIONS = MASS_ON_SPRING.replace("range = [80, 120]", "range = [0, 1]").replace(
    '"-k"', '"-90*cos(k)"'
)
SENSED = MASS_ON_SPRING + (
    '[outputs]\n"mixed" = {C = [1, 0.5], F = [0.02]}\n"sent" = {C = [1, 0], D = [0.1]}\n'
    '"stretch" = {C = ["k", 0]}\naccelerometer = {C = ["-k", -2], D = [1], F = [1]}\n'
)


@pytest.mark.parametrize(
    "text",
    [
        MASS_ON_SPRING,
        MASS_ON_SPRING.replace("E = [[0], [1]]", 'E = [[0], ["k/80"]]'),
        MASS_ON_SPRING.replace("120]", "120]\nrate = [-5, 5]"),
        MASS_ON_SPRING.replace("120]", '120]\nrate = "any"'),
        FUNCTIONS,
        FUNCTIONS.replace("E = [[0], [1]]", 'E = [[0], ["2 + sin(k)"]]'),
    ],
)
def test_of_every_kind_of_plant_it_proves_more(text):
    """A position, whose rate is the velocity: the factor is that of numbers, k + c = 0."""
    plant, law = loads(text), pf.FixedGain(GAIN)
    bound = best_bound(plant, law, asked(at_least=None))
    circle = best_bound(plant, law, asked(at_least=None, invariant=False))
    assert any(bound.claim.elements.multipliers)
    assert bound.level < 0.9 * circle.level
    fails = asked().linear(plant, law, seeded(plant, 60))[0].min()
    assert 0.985 * fails < 1 / bound.level < fails * (1 + 1e-6)
    said = bound.claim.statement(file_plant(plant))
    assert "every phi with y phi(y) between" in said
    assert "that does not depend on time: 'push' = w1 = phi(y) in [" in said
    assert not any(bound.claim.bare.elements.multipliers)


@pytest.mark.parametrize(
    ("text", "signal"),
    [
        (MASS_ON_SPRING, "velocity"),  # whose rate has the force in it
        (SENSED, "sent"),  # a law's own input
        (SENSED, "stretch"),  # that depends on a parameter
        (
            MASS_ON_SPRING.replace("[parameter.k]", "sample_time = 0.01\n[parameter.k]")
            .replace('A = [[0, 1], ["-k", -2]]', 'A = [[1, 0.01], ["-0.01*k", 0.98]]')
            .replace("B = [[0], [1]]", "B = [[0], [0.01]]")
            .replace("E = [[0], [1]]", "E = [[0], [0.01]]"),
            "position",
        ),
    ],
)
def test_other_signals_have_no_multiplier_and_the_circle_criterion(text, signal):
    plant, law = loads(text), pf.FixedGain(GAIN)
    both = [
        best_bound(plant, law, asked(signal, "push", [-0.5, 0.5], None, invariant))
        for invariant in (True, False)
    ]
    assert not both[0].claim.elements.multipliers
    assert both[0].level == both[1].level
    assert both[0].claim.invariant
    assert not both[1].claim.invariant


@pytest.mark.parametrize("measured", [("mixed", "velocity"), ("accelerometer without inputs",)])
def test_what_a_law_measures_has_the_force_of_the_element(measured):
    plant = loads(SENSED)
    K = np.array([[-5.0, -2.0][: len(measured)]]) / (1 if len(measured) > 1 else 50)
    law = Structure(measured=measured, schedule=()).law(plant, K[None])
    own = asked(sector=(-30, 10), at_least=None)
    bound = best_bound(plant, law, own)
    assert any(bound.claim.elements.multipliers)
    assert bound.level < 0.8 * best_bound(plant, law, replace(own, time_invariant=False)).level
    fails = own.linear(plant, law, seeded(plant, 60))[0].min()
    assert 0.95 * fails < 1 / bound.level < fails * (1 + 1e-6)


# --- slopes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("restricted", [False, True])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_slopes_are_those_of_central_differences(seed, count, restricted):
    """Of the highest value, while multipliers follow."""
    (*_, K), plant, own, random = made(seed, count)
    own = replace(own, slope_restricted=restricted)
    channel = own.channel(plant, np.array([[1.0, 0], [0, 1], [0.3, 0.7]]))
    channel = channel.in_units(np.geomspace(0.5, 4, K.shape[1]))
    assert channel.rated == ((True,) * count, (restricted,) * count)

    def found(K):
        loops = channel.closed(np.broadcast_to(K, (3, *K.shape)), Modes(channel.A + channel.B @ K))
        return own.slopes(loops)

    first = found(K)
    rows = np.eye(len(first.values)) if first.mixed is None else first.mixed
    dK = np.tensordot(rows[int(first.values.argmax())], channel.slopes(first), 1)
    for _ in range(3):
        step, size = random.normal(size=K.shape), 1e-3
        ahead, back = (found(K + s * size * step).values.max() for s in (1, -1))
        near = (0.2 if restricted else 5e-2) * np.abs(dK).max()
        assert (ahead - back) / 2 / size == pytest.approx((dK * step).sum(), abs=near)


@pytest.mark.parametrize("seed", range(3))
def test_a_level_is_the_gain_of_the_loop_that_is_accepted(seed):
    """Of d^-1 (z - p y') to d (r y + level p y'), on a fine grid."""
    (*_, K), plant, own, _ = made(seed, 2)
    channel = own.channel(plant, np.eye(2))
    loops = channel.closed(np.stack([K, K]), Modes(channel.A + channel.B @ K))
    (best,) = multipliers.found(loops, (True, True))
    m, L = best.multipliers, best.level
    w = np.concatenate([[0], np.geomspace(1e-2, 1e2, 4000)])
    s, d, highest = 1j * w[:, None, None], np.exp(m.d), 0.0
    for A, own_E, C in zip(loops.A, loops.E, loops.C, strict=True):
        G = C @ np.linalg.solve(s * np.eye(len(A)) - A, own_E.astype(complex))
        out = d[:, None] * (G + L * np.abs(m.t)[:, None] * s * G)
        into = (np.eye(2) - m.t[:, None] * s * G) / d[:, None]
        # sup |out z| / |into z| with into = d^-1..., weighed by d on both sides
        into = d[:, None] ** 2 * into
        highest = max(highest, np.linalg.svd(out @ np.linalg.inv(into))[1].max())
    assert highest == pytest.approx(L, rel=1e-3)


# --- files ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    plant, folder = loads(MASS_ON_SPRING), tmp_path_factory.mktemp("file")
    region = pf.parse_region("half_plane(0)")
    limit = asked(sector=[-60, 90])
    law = pf.FixedGain(GAIN)
    assert kept_bound(plant, law, replace(limit, time_invariant=False)) is None
    pf.analyse(plant, law, region, limits=[limit]).design.save(folder)
    document = json.loads((folder / "design.json").read_text())
    assert is_accepted(document)
    return document


def p_of(x):
    return float(Fraction(x[0]))


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("level", lambda x: float(Fraction(x)) * 0.5),
        ("level", lambda _: 0),
        ("level", lambda _: -1),
        ("multipliers", lambda x: [-p_of(x)]),
        ("multipliers", lambda x: [0.1 * p_of(x)]),
        ("multipliers", lambda _: [0]),
        ("multipliers", lambda x: [x[0], x[0]]),
        ("multipliers", lambda _: ["nan"]),
        ("multipliers", lambda _: None),
        ("invariant", lambda _: False),
        ("invariant", lambda _: None),
        ("invariant", lambda _: 1),
        ("weights", lambda _: [-1]),
        ("sectors", lambda _: [[-101, 90]]),
        ("sectors", lambda _: [[-60, 400]]),
        ("disturbances", lambda _: [2]),
        ("outputs", lambda x: [x[0] | {"C": [[0, 1]]}]),
        ("outputs", lambda x: [x[0] | {"C": [[3, 0]]}]),
        ("outputs", lambda x: [x[0] | {"C": [[1, 0.01]]}]),
        ("outputs", lambda x: [x[0] | {"D": [[0.01]]}]),
    ],
)
def test_one_fault_in_a_file_and_it_is_not_proved(document, key, change):
    table = json.loads(json.dumps(document))
    claim = next(own for own in table["claims"] if own["kind"] == "sector")
    value = change(claim.get(key))
    claim[key] = value
    if value is None:
        del claim[key]
    assert not is_accepted(table)


def test_one_fault_in_the_plant_and_it_is_not_proved(document):
    """An element that enters the rate of its signal, of one vertex alone; another spring."""
    for i, j, x in ((0, 0, 0.01), (1, 0, 30)):
        table = json.loads(json.dumps(document))
        table["plant"]["vertices"][1]["E"][i][j] = x
        assert not is_accepted(table)


def test_a_multiplier_of_what_has_none_is_refused():
    """Each for its own reason, whatever the evidence."""
    law = pf.FixedGain(GAIN)
    cases = (
        (MASS_ON_SPRING, "velocity", "a rate that an element enters"),
        (SENSED, "sent", "on inputs"),
        (SENSED, "stretch", "depends on parameters"),
        (FUNCTIONS.replace("[0, 1], [", '["0.01*cos(k)", 1], ['), "position", "a function of"),
    )
    for text, signal, why in cases:
        plant = loads(text)
        own = asked(signal, "push", [-0.5, 0.5], None)
        claim = best_bound(plant, law, own).claim
        wrong = replace(claim, elements=replace(claim.elements, multipliers=(Fraction(1),)))
        with pytest.raises(FormatError, match=why):
            wrong.require()
    both = MASS_ON_SPRING.replace("E = [[0], [1]]", 'E = [[0], ["k/80"]]')
    both = both.replace("[0, 1], [", '[0, "k/100"], [')
    claim = best_bound(loads(both), law, asked(at_least=None)).claim
    assert not claim.elements.multipliers
    wrong = replace(claim, elements=replace(claim.elements, multipliers=(Fraction(1),)))
    with pytest.raises(FormatError, match="that both depend on parameters"):
        wrong.require()


# --- commands ------------------------------------------------------------------------------------

STOP = """
name = "mass with a bump stop"
states = ["travel [m]", "velocity [m/s]"]
inputs = ["force [N]"]
disturbances = ["wind [N]", "stop force [N]"]
[parameter.k]
range = [80, 120]
[matrices]
A = [[0, 1], ["-k", -1]]
B = [[0], [1]]
E = [[0, 0], [1, -1]]
[law]
schedule = []
[[specification]]
kind = "rms"
signal = "travel"
disturbances = ["wind"]
density = 1
minimise = true
[[specification]]
kind = "rms"
signal = "force"
disturbances = ["wind"]
density = 1
at_most = 0.5
[[specification]]
kind = "sector"
signal = "travel"
disturbance = "stop force"
sector = [0, 1e4]
"""


def test_a_law_is_tuned_for_a_stop_that_stays_as_it_is(tmp_path, capsys):
    """For one that changes in time it takes a force of 4.5 N, and no law at all for this one."""
    spec, out, said = (tmp_path / name for name in ("stop.toml", "out", "said.json"))
    spec.write_text(STOP + "time_invariant = true\n")
    assert main(["optimise", str(spec), "--json", str(said), "-o", str(out)]) == 0
    row = json.loads(said.read_text())["bounds"][2]
    assert row["kind"] == "sector"
    assert row["limit"] == row["proved"] == 1 <= row["worst sampled"]
    capsys.readouterr()
    assert main(["check", str(out), "--spec", str(spec)]) == 0
    assert "that does not depend on time: 'stop force' = w2 = phi(y)" in capsys.readouterr().out
    other = tmp_path / "other.toml"
    other.write_text(spec.read_text().replace("[1, -1]", "[1, -1.1]"))
    assert main(["check", str(out), "--spec", str(other)]) == 1
    capsys.readouterr()
    limit, answers = "sector of travel with disturbance [stop force] with sector [0, 10000]", []
    for line in (limit, f"{limit} with time_invariant true"):
        main(["verify", str(spec), "--gain", "none", "--limit", f"{line} >= 1"])
        answers.append(capsys.readouterr().out.splitlines()[1].partition(":")[0])
    assert answers == ["undecided", "proved"]
    words = ["robust", str(spec), "--gain", "none", "--limit", f"{limit} with time_invariant true"]
    assert main([*words, "-o", str(tmp_path / "robust")]) == 0
    assert "stop force = -80" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "robust" / "margins.json"), "--spec", str(spec)]) == 0


def test_it_reads_as_it_is_written(tmp_path):
    path = tmp_path / "stop.toml"
    path.write_text(STOP + "time_invariant = true\n")
    *_, own = load_specifications(path)[1]
    assert own == asked("travel", "stop force", [0, 1e4])
    assert limit_text(own).endswith("with time_invariant true >= 1")
    assert parse_specification(limit_text(own)) == own
    assert own.surely.time_invariant
    path.write_text(STOP + "time_invariant = 1\n")
    with pytest.raises(SpecError, match="time_invariant = 1 of a sector must be true or false"):
        load_specifications(path)
    with pytest.raises(InputError, match="true or false"):
        asked(invariant="yes")
