"""Worst-case gains: against dynamics in the loops, and of every kind of plant."""

import json
from dataclasses import replace

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError, SpecError
from polefence.certify.bounds import best_bound, kept_bound, sampled
from polefence.cli.main import main
from polefence.law.laws import given_law
from polefence.law.structure import Structure
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.plant.weights import shape_of
from polefence.requirements import worst_gain
from polefence.requirements.specification import claim_of, limit_text
from polefence.requirements.text import load_specifications, parse_specification
from polefence.requirements.worst_gain import WorstCaseGain
from polefence.response.modes import Modes
from support.files import is_accepted
from support.specs import MASS_ON_SPRING

WEIGHT = "(3*s + 18.5)/(s + 46.3)"
GAIN = np.array([[-20.0, -4.0]])
FUNCTIONS = MASS_ON_SPRING.replace("range = [80, 120]", "range = [0, 1]").replace(
    '"-k"', '"-90*cos(k)"'
)


def asked(*signals, inputs="force", weight=WEIGHT, at_most=None):
    return WorstCaseGain(
        signals if len(signals) > 1 else signals[0], at_most, inputs=inputs, weight=weight
    )


def loop(A, B, E, C, D, K, shape, deltas):
    """The closed loop with deltas, each a number or state space (a, b, c, d), at all inputs."""
    a, b, c, d = (np.array(M, dtype=float) for M in (shape.a, shape.b, shape.c, [[shape.d]]))
    n = len(B)
    rows = [(A + B @ K, E, C + D @ K)]
    big = rows[0][0].astype(complex)
    into, out = E.astype(complex), rows[0][2].astype(complex)
    for i, delta in enumerate(deltas):
        if np.isscalar(delta):
            delta = (np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[delta]]))
        # W then delta, in series from u_i to what is added there
        da, db, dc, dd = delta
        sa = np.block([[a, np.zeros((len(a), len(da)))], [db @ c, da]])
        sb, sc, sd = np.vstack([b, db @ d]), np.hstack([dd @ c, dc]), dd @ d
        k = len(big)
        wide = np.zeros((k + len(sa), k + len(sa)), complex)
        wide[:k, :k], wide[k:, k:] = big, sa
        row = np.zeros((1, k), complex)
        row[0, :n] = K[i]
        wide[:n, :k] += B[:, i : i + 1] @ sd @ row
        wide[:n, k:] = B[:, i : i + 1] @ sc
        wide[k:, :k] = sb @ row
        big, into = wide, np.vstack([into, np.zeros((len(sa), into.shape[1]))])
        straight = D[:, i : i + 1]
        out = np.hstack([out + straight @ sd @ row, straight @ sc])
    return big, into, out


def gain_at(loop, w):
    A, E, C = loop
    x = np.linalg.solve(1j * w[:, None, None] * np.eye(len(A)) - A, E.astype(complex))
    return float(np.linalg.norm(C @ x, 2, axis=(1, 2)).max())


def all_pass(random):
    """(a - s)/(a + s), or with the other sign: a stable system of gain one at all frequencies."""
    a, sign = np.exp(random.normal(1.5, 1.5)), random.choice([-1.0, 1.0])
    one = np.ones((1, 1))
    return -a * one, one, sign * 2 * a * one, -sign * one


def made(seed, m=1):
    random = np.random.default_rng(seed)
    A = random.normal(size=(3, 3))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(3)
    B, E, C = random.normal(size=(3, m)), random.normal(size=(3, 2)), random.normal(size=(2, 3))
    K = 0.3 * random.normal(size=(m, 3))
    while np.linalg.eigvals(A + B @ K).real.max() > -0.3:
        K /= 2
    plant, D = pf.UncertainPlant.from_vertices([A], [B], [E]), 0.3 * random.normal(size=(2, m))
    signals = [Output(f"z{k}", "", C=C[k], D=D[k]) for k in range(2)]
    return (A, B, E, C, D, K), plant, signals, random


@pytest.mark.parametrize(("seed", "m"), [(0, 1), (1, 1), (2, 1), (3, 2), (4, 2)])
def test_no_dynamics_exceed_what_is_proved_and_some_come_near(seed, m):
    """Of all-pass ones, and of numbers of size one at a frequency, which stable ones are there."""
    matrices, plant, signals, random = made(seed, m)
    inputs, weight = [f"u{k + 1}" for k in range(m)], "0.5*(s + 1)/(s + 4)"
    own = WorstCaseGain(signals, inputs=inputs, weight=weight)
    law = given_law(plant, matrices[-1])
    bound = best_bound(plant, law, own)
    shape, w = shape_of(weight, "u"), np.geomspace(0.01, 100, 120)
    worst = 0.0
    for k in range(300):
        deltas = [all_pass(random) for _ in inputs]
        if k % 2:
            deltas = np.exp(2j * np.pi * random.random(m)).tolist()
        found = loop(*matrices, shape, deltas)
        assert np.linalg.eigvals(found[0]).real.max() < 0
        worst = max(worst, gain_at(found, w))
    seen = sampled(plant, law, own, np.ones((1, 1))).worst
    assert worst <= seen * (1 + 1e-3)
    assert worst > 0.97 * seen
    assert seen <= bound.level < 1.03 * seen


def test_dynamics_that_are_found_at_a_frequency_are_the_worst_there():
    random = np.random.default_rng(5)
    for _ in range(20):
        p, q = random.integers(1, 4, size=2)
        G = random.normal(size=(p + 1, q + 1)) + 1j * random.normal(size=(p + 1, q + 1))
        G[p, q] *= 0.9 / abs(G[p, q])
        phases = np.exp(2j * np.pi * np.linspace(0, 1, 4001))
        every = phases / (1 - phases * G[p, q])
        most = np.linalg.norm(
            G[:p, :q] + every[:, None, None] * (G[:p, q:] @ G[p:, :q]), 2, axis=(1, 2)
        ).max()
        assert worst_gain.worst_of_dynamics(G, p) == pytest.approx(most, rel=1e-3)
        G[p, q] *= 1.2
        assert worst_gain.worst_of_dynamics(G, p) == np.inf


def test_the_weight_of_a_demand_is_of_what_is_sent_and_other_signals_of_what_arrives():
    """With a weight of one at low frequencies a demand's gain is that without one."""
    weighed = '[[weight]]\nsignal = "force"\ntransfer = "1/(s/1e5 + 1)"\n'
    plant = loads(MASS_ON_SPRING.replace("[80, 120]", "[80, 80.0001]") + weighed)
    law = given_law(plant, [[-20.0, -4.0, 0.0]])
    sent = best_bound(plant, law, asked("force")).level
    assert best_bound(plant, law, asked("weighted force")).level == pytest.approx(sent, rel=1e-2)
    # what arrives is seen in the acceleration, which is that of the velocity
    arrived = loads(
        MASS_ON_SPRING.replace("[80, 120]", "[80, 80.0001]")
        + (
            '[outputs]\na = {C = ["-k", -2], D = [1]}\n[[weight]]\nsignal = "velocity"\n'
            'transfer = "s/(s/1e5 + 1)"\n'
        )
    )
    both = "a", "weighted velocity"
    law = given_law(arrived, [[-20.0, -4.0, 0.0]])
    own = WorstCaseGain("a", inputs="force", weight=WEIGHT)
    levels = [nearest(arrived, law, replace(own, signal=name)) for name in both]
    assert levels[0] == pytest.approx(levels[1], rel=1e-2)


def nearest(plant, law, own):
    return own.nearest(plant, law)


@pytest.mark.parametrize(
    ("text", "loose"),
    [
        (MASS_ON_SPRING, 0.04),
        (MASS_ON_SPRING.replace("120]", "120]\nrate = [-5, 5]"), 0.05),
        (FUNCTIONS, 0.05),
        (MASS_ON_SPRING + "[dead_time.force]\ntime = 0.002\n", 1.0),
    ],
)
def test_worst_case_gains_of_every_kind_of_plant(text, loose):
    plant = loads(text)
    K = np.zeros(plant.shape[::-1])
    K[0, :2] = GAIN
    weight = "0.5*(s + 4)/(s + 40)" if "dead_time" in text else WEIGHT
    law, own = given_law(plant, K), asked("position", "force", weight=weight)
    bound = best_bound(plant, law, own)
    seen = sampled(plant, law, own, seeded(plant, 60)).worst
    assert seen < bound.level < seen * (1 + loose)
    # without dynamics it is less
    assert best_bound(plant, law, pf.Gain(["position", "force"])).level < seen


def test_units_and_scales_of_disturbances_change_nothing():
    plant = loads(MASS_ON_SPRING)
    law, own = given_law(plant, GAIN), asked("position")
    level = best_bound(plant, law, own).level
    twice = WorstCaseGain("position", inputs="force", weight=WEIGHT, disturbances={"push": 2})
    assert best_bound(plant, law, twice).level == pytest.approx(2 * level, rel=2e-3)


NOISY = (
    MASS_ON_SPRING.replace(
        'disturbances = ["push [N]"]', 'disturbances = ["push [N]", "noise"]'
    ).replace("E = [[0], [1]]", "E = [[0, 0], [1, 0]]")
    + """
[outputs]
sensor = {C = [1, 0], F = [0, 0.1]}
rate = {C = [0, 1], F = [0, 0.2]}
accelerometer = {C = ["-k", -2], D = [1], F = [0, 0.3]}
"""
)


@pytest.mark.parametrize(
    "measured", [("sensor", "rate"), ("accelerometer without inputs", "sensor")]
)
def test_noise_straight_in_what_is_measured(measured):
    plant = loads(NOISY)
    structure = Structure(measured=measured, schedule=())
    law = structure.law(plant, np.array([[[-0.5, -2.0]]]))
    own = asked("position", "force", weight="0.3*(s + 5)/(s + 50)")
    bound = best_bound(plant, law, own)
    seen = sampled(plant, law, own, seeded(plant, 40)).worst
    assert seen < bound.level < 1.05 * seen
    assert best_bound(plant, law, pf.Gain(["position", "force"])).level < seen


@pytest.mark.parametrize(
    ("at_most", "m", "more"),
    [
        (None, 1, {}),
        (None, 2, {}),
        (3.0, 2, {}),
        (None, 2, {"time_invariant": True}),
        (3.0, 1, {"time_invariant": True}),
        (None, 1, {"paths": ["x1 -> w2", "z1 -> w1"]}),
        (None, 1, {"paths": ["z1 -> w1"], "time_invariant": True}),
    ],
)
def test_slopes_are_those_of_central_differences(at_most, m, more):
    """Of the highest row, while scales follow."""
    (A, B, _, _, _, K), plant, signals, random = made(3, m)
    plant = replace(plant, outputs=tuple(signals))
    inputs = [f"u{k + 1}" for k in range(m)] + more.get("paths", [])
    known = {"weight": "0.4*(s + 1)/(s + 4)", "time_invariant": "time_invariant" in more}
    own = WorstCaseGain(signals, at_most, inputs=inputs, **known)
    channel = own.channel(plant, np.ones((1, 1)))

    def found(K):
        return own.slopes(channel.closed(K[None], Modes(A[None] + B @ K[None])))

    first = found(K)
    top = int(first.values.argmax())
    slopes = np.tensordot(first.mixed[top], channel.slopes(first), 1)
    for _ in range(3):
        step = random.normal(size=K.shape)
        ahead, back = (found(K + s * 1e-3 * step).values.max() for s in (1, -1))
        along = (slopes * step).sum()
        assert (ahead - back) / 2e-3 == pytest.approx(along, abs=2e-2 * np.abs(slopes).max())


SPEC = (
    MASS_ON_SPRING
    + "[law]\nschedule = []\n"
    + '[[specification]]\nkind = "rms"\nsignal = "force"\ndensity = 1\nat_most = 3\n'
    + '[[specification]]\nkind = "worst-case gain"\nsignal = ["position", "velocity"]\n'
    + f'inputs = ["force"]\nweight = "{WEIGHT}"\nminimise = true\n'
)


def test_a_law_is_tuned_for_it_and_its_file_says_so(tmp_path, capsys):
    spec, out = tmp_path / "spring.toml", tmp_path / "out"
    spec.write_text(SPEC)
    assert main(["optimise", str(spec), "--json", str(tmp_path / "said.json"), "-o", str(out)]) == 0
    row = json.loads((tmp_path / "said.json").read_text())["bounds"][0]
    assert row["kind"] == "worst-case gain"
    assert row["worst sampled"] <= row["proved"] <= 1.15 * row["worst sampled"]
    capsys.readouterr()
    assert main(["check", str(out), "--spec", str(spec)]) == 0
    said = capsys.readouterr().out
    assert "for all unmodelled dynamics of the loop at 'force' = u1 within" in said
    other = tmp_path / "other.toml"
    other.write_text(SPEC.replace("18.5", "18.6"))
    assert main(["check", str(out), "--spec", str(other)]) == 1


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    plant, folder = loads(MASS_ON_SPRING), tmp_path_factory.mktemp("file")
    own = asked("position", "force")
    region = pf.parse_region("half_plane(0)")
    pf.analyse(plant, pf.FixedGain(GAIN), region, limits=[own]).design.save(folder)
    document = json.loads((folder / "design.json").read_text())
    assert is_accepted(document)
    return document


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("level", lambda x: x * 0.99),
        ("weights", lambda x: [x[0] / 3]),
        ("weights", lambda x: [0]),
        ("weights", lambda x: [*x, *x]),
        ("inputs", lambda _: [2]),
        ("inputs", lambda _: []),
        ("inputs", lambda _: [1, 1]),
        ("filters", lambda _: []),
        ("filters", lambda _: [{}]),
        ("filters", lambda x: [x[0] | {"d": 6}]),
        ("filters", lambda x: [x[0] | {"c": [[100]]}]),
        ("filters", lambda x: [x[0] | {"a": [[1]]}]),
        ("disturbances", lambda _: [3]),
        ("disturbances", lambda _: [1, 1]),
        ("disturbances", lambda _: [-1]),
        ("outputs", lambda x: [x[0] | {"C": [[2, 0]]}, x[1]]),
        ("outputs", lambda x: [x[0] | {"F": [[1]]}, x[1]]),
    ],
)
def test_one_fault_in_a_file_and_it_is_not_proved(document, key, change):
    table = json.loads(json.dumps(document))
    claim = next(own for own in table["claims"] if own["kind"] == "worst-case gain")
    claim[key] = change(claim.get(key))
    assert not is_accepted(table)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('inputs = ["force"]', "weight is missing"),
        (f'weight = "{WEIGHT}"', "inputs is missing"),
        (f'inputs = []\nweight = "{WEIGHT}"', "inputs = an empty list must name inputs"),
        (f'inputs = 3\nweight = "{WEIGHT}"', "must name inputs, each once"),
        (f'inputs = ["force", "force"]\nweight = "{WEIGHT}"', "each once"),
        ('inputs = ["force"]\nweight = "0.5"', "is constant"),
        ('inputs = ["force"]\nweight = "1/(s - 1)"', "is not stable"),
        (f'inputs = ["force"]\nweight = "{WEIGHT}"\nloops = ["force"]', "unknown key loops"),
    ],
)
def test_bad_ones_are_refused_in_a_line(tmp_path, keys, said):
    path = tmp_path / "bad.toml"
    table = f'kind = "worst-case gain"\nsignal = "position"\nat_most = 1\n{keys}\n'
    path.write_text(MASS_ON_SPRING + f"[[specification]]\n{table}")
    with pytest.raises(SpecError, match=said) as error:
        load_specifications(path)
    assert "\n" not in str(error.value)


def test_it_is_of_inputs_in_continuous_time_and_of_laws_that_are_tuned():
    plant = loads(MASS_ON_SPRING)
    with pytest.raises(InputError, match="'position' is no input"):
        asked("position", inputs="position").require_fit(plant)
    with pytest.raises(InputError, match="write the weight in z"):
        asked("position").require_fit(pf.at_sample_time(plant, 0.01))
    with pytest.raises(InputError, match="so that a law is tuned"):
        pf.optimise(plant, asked("position"), [], method="quadratic")
    own = asked("position", "force", at_most=2.0)
    assert parse_specification(limit_text(own)) == own


def test_there_is_none_where_dynamics_make_the_loop_unstable():
    plant = loads(MASS_ON_SPRING)
    law, own = given_law(plant, GAIN), asked("position", weight="9*(s + 5)/(s + 50)")
    assert best_bound(plant, law, own) is None
    assert kept_bound(plant, law, asked("position", weight=own.weight, at_most=5.0)) is None
    assert sampled(plant, law, own, seeded(plant, 20)).worst == np.inf


def test_a_claim_made_anew_is_the_one_that_is_proved_whatever_its_weights():
    plant, own = loads(MASS_ON_SPRING), asked("position", "force")
    law = given_law(plant, GAIN)
    claim = best_bound(plant, law, own).claim
    evidence, on = claim.subject.evidence, claim.subject.on
    again = claim_of(plant, law.exact, on, own, evidence, claim.level)
    assert again.bare == claim.bare
    assert claim_of(plant, law.exact, on, own, evidence, claim.level * 2).bare != claim.bare
