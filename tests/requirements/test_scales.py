"""Scales of opened loops, with leads: against responses, errors that do not vary, and faults."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import polefence as pf
from polefence.base.errors import InputError
from polefence.certify.bounds import best_bound, sampled
from polefence.certify.robust.breaking import broken
from polefence.cli.main import main
from polefence.law.laws import given_law
from polefence.law.structure import Structure
from polefence.plant.exact import file_plant
from polefence.plant.outputs import Output
from polefence.plant.points import seeded
from polefence.plant.spec import loads
from polefence.proof.claims.disk_margin import Loops
from polefence.proof.filters import Filter, in_turn
from polefence.proof.work import FormatError
from polefence.requirements import scales
from polefence.requirements.disk_margin import DiskMargin, Unmodelled
from polefence.requirements.slopes import Loops as ClosedLoops
from polefence.requirements.specification import claim_of, limit_text
from polefence.requirements.text import parse_specification
from polefence.requirements.worst_gain import WorstCaseGain
from polefence.response.modes import Modes
from polefence.response.peaks import response
from support.files import is_accepted
from support.specs import MASS_ON_SPRING

# An integrator whose model is off by a gain of 0.4, and a lag before it; a loop of -2 y.
ADDITIVE = """
name = "integrator with additive dynamics"
states = ["x", "command"]
inputs = ["u"]
disturbances = ["d", "additive"]
[matrices]
A = [[0, 1], [0, -50]]
B = [[0], [50]]
E = [[0, 0], [0, 0]]
[outputs]
"y" = {C = [1, 0], F = [1, 1]}
[law]
measured = ["y"]
schedule = []
"""


# v1 = 4/(s + 1) w2 and v2 = 4 s/(s + 10) w1: |v1 -> w1, v2 -> w2| is 16 |s|/(|s + 1| |s + 10|), at
# most 16/11, where a constant scale has the product of both peaks, 16.
CROSSED = """
name = "crossed"
states = ["x1", "x2"]
inputs = ["u"]
disturbances = ["w1", "w2"]
[matrices]
A = [[-1, 0], [0, -10]]
B = [[1], [0]]
E = [[0, 4], [4, 0]]
[outputs]
"v1" = {C = [1, 0]}
"v2" = {C = [0, -10], F = [4, 0]}
"""


def closed(seed, p=0, q=0, size=2, step=0.0):
    """Random stable loops from [w; w_k] to [z; v_k], one point."""
    random = np.random.default_rng(seed)
    A = random.normal(size=(4, 4))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(4)
    if step:
        A = (np.linalg.matrix_power(np.eye(4) + A * step / 64, 64) - np.eye(4)) / step
    E, C = random.normal(size=(4, q + size)), random.normal(size=(p + size, 4))
    F = 0.1 * random.normal(size=(p + size, q + size))
    return ClosedLoops(Modes(A[None], step), E[None], C[None], F[None])


def scaled_response(loops, scale, p, level, s):
    """D M D^-1, from the response itself."""
    M = response(loops.A, loops.E, loops.C, loops.F, s[None])[0]
    d, a, b = np.exp(scale.theta.T) if scale.leads else (np.exp(scale.theta[:, 0]), 1.0, 1.0)
    D = d * (s[:, None] + a) / (s[:, None] + b)
    q = M.shape[2] - len(scale.theta)
    out = np.concatenate([np.ones((len(s), p)), level * D], axis=1)
    into = np.concatenate([np.ones((len(s), q)), 1 / D], axis=1)
    return out[:, :, None] * M * into[:, None]


@pytest.mark.parametrize("step", [0.0, 0.05])
def test_scaled_loops_are_scaled_responses(step):
    random = np.random.default_rng(1)
    for seed in range(6):
        loops, p = closed(seed, p=2, q=1, step=step), 2
        scale = scales.Scale(random.normal(size=(2, 3)))
        wide = scales.scaled_loops(loops, scale, p, 1.7)
        w = np.geomspace(0.01, 60, 30)
        s = (np.exp(1j * w * step) - 1) / step if step else 1j * w
        found = response(wide.A, wide.E, wide.C, wide.F, s[None])[0]
        assert found == pytest.approx(scaled_response(loops, scale, p, 1.7, s), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("step", [0.0, 0.05])
@pytest.mark.parametrize("seed", range(8))
def test_leads_are_no_worse_and_what_is_said_of_them_holds_at_all_frequencies(seed, step):
    loops = closed(seed, size=3, step=step)
    plain, found = (scales.scaled(loops, 0, 1.0, leads=leads) for leads in (False, True))
    assert found.level <= plain.level * (1 + 1e-9)
    w = np.concatenate([[0], np.geomspace(1e-3, np.pi / step if step else 1e4, 4000)])
    s = (np.exp(1j * w * step) - 1) / step if step else 1j * w
    heights = np.linalg.norm(scaled_response(loops, found.scale, 0, 1.0, s), 2, axis=(1, 2))
    assert heights.max() <= found.level * (1 + 1e-6)
    assert heights.max() >= found.level * (1 - 2e-3)


def test_filters_in_turn_are_the_product_of_responses():
    random = np.random.default_rng(2)

    def made(n):
        a, b, c = (random.integers(-5, 5, size=shape) for shape in ((n, n), (n, 1), (1, n)))
        exact = (tuple([Fraction(int(x)) for x in row] for row in M) for M in (a, b, c))
        return Filter(*map(list, exact), "", Fraction(int(random.integers(1, 4))))

    def at(form, s):
        a, b, c = (np.array(M, dtype=float) for M in (form.a, form.b, form.c))
        return (c @ np.linalg.solve(s * np.eye(len(a)) - a, b))[0, 0] + float(form.d)

    one, other = made(2), made(3)
    whole, s = in_turn(one, other), 0.7 + 2j
    assert at(whole, s) == pytest.approx(at(one, s) * at(other, s))
    assert in_turn(None, one) is one
    assert in_turn(one, None) is one


# --- margins with leads --------------------------------------------------------------------------


def two_inputs(seed, step=0.0):
    random = np.random.default_rng(seed)
    A = random.normal(size=(4, 4))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(4)
    B, K = random.normal(size=(4, 2)), random.normal(size=(2, 4))
    while np.linalg.eigvals(A + B @ K).real.max() > -0.4:
        K /= 1.3
    plant = pf.UncertainPlant.from_vertices([A, A - 0.1 * np.eye(4)], [B, B])
    plant = pf.at_sample_time(plant, step) if step else plant
    return plant, given_law(plant, K)


@pytest.mark.parametrize("step", [0.0, 0.02])
def test_margins_of_what_does_not_vary_in_time_lie_between_those_of_all_and_one_that_fails(step):
    for seed in range(5):
        plant, law = two_inputs(seed, step)
        margins = [
            best_bound(plant, law, DiskMargin(["u1", "u2"], time_invariant=given))
            for given in (False, True)
        ]
        every, invariant = (1 / bound.level for bound in margins)
        assert invariant >= every * (1 - 1e-3)
        alpha = np.array([1.0, 0.0])
        fails = broken(plant, law, DiskMargin(["u1", "u2"]), [Fraction(1), Fraction(0)])
        if fails is not None:
            assert invariant <= float(fails.gain) * (1 + 1e-9)
        one = DiskMargin(["u1", "u2"], time_invariant=True)
        assert sampled(plant, law, one, alpha[None]).worst <= margins[1].level * (1 + 1e-6)


def crossed(time_invariant):
    return Unmodelled(["v1 -> w1", "v2 -> w2"], weight="1", time_invariant=time_invariant)


def test_leads_have_the_part_that_theory_says():
    plant = loads(CROSSED)
    law = given_law(plant, np.zeros((1, 2)))
    every, invariant = (best_bound(plant, law, crossed(given)).level for given in (False, True))
    assert 4.0 <= every < 4.0 * (1 + 1e-3)
    assert (16 / 11) ** 0.5 <= invariant < 1.3


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    plant, folder = loads(CROSSED), tmp_path_factory.mktemp("file")
    law, region = given_law(plant, np.zeros((1, 2))), pf.parse_region("half_plane(0)")
    pf.analyse(plant, law, region, limits=[crossed(True)]).design.save(folder)
    document = json.loads((folder / "design.json").read_text())
    (claim,) = (one for one in document["claims"] if one["kind"] == "unmodelled dynamics")
    assert claim["zeros"] != claim["poles"]
    assert is_accepted(document)
    return document


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("level", lambda x: 0.98 * x),
        ("zeros", lambda x: x[::-1]),
        ("zeros", lambda x: [-x[0], x[1]]),
        ("zeros", lambda x: [x[0], 10 * x[1]]),
        ("poles", lambda x: [x[0], 0]),
        ("poles", lambda x: [x[0], x[1] * 1e6]),
        ("poles", lambda x: x[:1]),
        ("poles", lambda _: None),
        ("weights", lambda x: [x[0], 3 * x[1]]),
        ("invariant", lambda _: False),
        ("invariant", lambda _: 1),
    ],
)
def test_one_fault_in_leads_and_it_is_not_proved(document, key, change):
    table = json.loads(json.dumps(document))
    claim = next(own for own in table["claims"] if own["kind"] == "unmodelled dynamics")
    claim[key] = change(claim[key])
    if claim[key] is None:
        del claim[key]
    assert not is_accepted(table)


def test_leads_of_samples_are_stable():
    good = ((Fraction(1), Fraction(30)),)
    Loops((0,), weights=(Fraction(1),), leads=good).require_leads(Fraction(1, 16))
    with pytest.raises(FormatError, match="above zero and below"):
        Loops((0,), weights=(Fraction(1),), leads=good).require_leads(Fraction(1, 15))


def test_a_statement_says_for_which_errors_it_is(tmp_path, capsys):
    plant, law = two_inputs(1)
    region = pf.parse_region("half_plane(0)")
    for given in (False, True):
        own = DiskMargin(["u1", "u2"], time_invariant=given)
        found = pf.analyse(plant, law, region, limits=[own])
        found.design.save(tmp_path)
        assert main(["check", str(tmp_path / "design.json")]) == 0
        assert ("(errors that do not vary in time)" in capsys.readouterr().out) is given


def test_a_claim_made_anew_is_the_one_that_is_proved_whatever_its_leads():
    plant, law = two_inputs(1)
    own = DiskMargin(["u1", "u2"], time_invariant=True)
    claim = best_bound(plant, law, own).claim
    evidence, on = claim.subject.evidence, claim.subject.on
    assert claim_of(plant, law.exact, on, own, evidence, claim.level).bare == claim.bare
    of_all = replace(own, time_invariant=False)
    assert claim_of(plant, law.exact, on, of_all, evidence, claim.level).bare != claim.bare


@pytest.mark.parametrize(
    "asked",
    [
        DiskMargin.least(["a", "b"], 0.5, 1.0, time_invariant=True),
        Unmodelled.least(["a -> b", "c"], "0.4*(s + 1)/(s + 2)", 1.0, time_invariant=True),
        WorstCaseGain("y", 2.0, inputs=["u -> w", "force"], weight="(s+1)/(s+4)"),
        WorstCaseGain("y", 2.0, inputs="u -> w", weight="0.4", time_invariant=True),
    ],
)
def test_limits_read_back_as_they_are(asked):
    assert parse_specification(limit_text(asked)) == asked


# --- dynamics from a signal to a disturbance -----------------------------------------------------


def test_a_published_worst_case_gain_of_additive_dynamics():
    """MathWorks' page of wcgain: a peak of about 5.1 at about 10.6 rad/s."""
    plant = loads(ADDITIVE)
    law = pf.PolynomialGain(((0,),), np.array([[[-2.0]]]), (plant.signal("y"),))
    own = WorstCaseGain("y", inputs="command -> additive", weight="0.4", disturbances=["d"])
    bound = best_bound(plant, law, own)
    seen = sampled(plant, law, own, np.ones((1, 1))).worst
    assert seen == pytest.approx(5.1042, rel=1e-4)
    assert seen <= bound.level < seen * 1.001
    assert own.worst_frequency(plant, law, np.ones(1)) == pytest.approx(10.54, abs=0.02)
    w = np.geomspace(0.1, 1e3, 4000)
    one = 1j * w
    most = 0.0
    for turn in np.exp(2j * np.pi * np.linspace(0, 1, 400)):
        loop = (1 / one + 0.4 * turn) * 2 / (0.02 * one + 1)
        most = max(most, np.abs(1 / (1 + loop)).max())
    assert seen == pytest.approx(most, rel=1e-3)


def test_additive_dynamics_are_borne_up_to_the_peak_of_what_they_see():
    plant = loads(ADDITIVE)
    law = pf.PolynomialGain(((0,),), np.array([[[-2.0]]]), (plant.signal("y"),))
    bound = best_bound(plant, law, Unmodelled("command -> additive", weight="0.4"))
    s = 1j * np.geomspace(0.01, 1e4, 20000)
    seen = 0.4 * np.abs(2 / (0.02 * s + 1) / (1 + 2 / (s * (0.02 * s + 1)))).max()
    assert seen <= bound.level < seen * (1 + 1e-3)
    said = bound.claim.statement(file_plant(plant))
    assert "of the loop from 'command' = x2 to 'additive' = w2 in multiples of '0.4'" in said


@pytest.mark.parametrize("seed", range(4))
def test_no_dynamics_between_signals_exceed_what_is_accepted(seed):
    """Random plants, laws of noisy signals, paths that pass straight through, and an input."""
    random = np.random.default_rng(seed)
    n, m, q, r = 3, 1, 3, 2
    A = random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 1.0) * np.eye(n)
    B, E = random.normal(size=(n, m)), 0.3 * random.normal(size=(n, q))
    C, F = random.normal(size=(r, n)), 0.3 * random.normal(size=(r, q))
    V, D, G = random.normal(size=n), 0.3 * random.normal(size=m), 0.2 * random.normal(size=q)
    Z, S, H = random.normal(size=n), 0.3 * random.normal(size=m), 0.3 * random.normal(size=q)
    K = 0.3 * random.normal(size=(m, r))
    while np.linalg.eigvals(A + B @ K @ C).real.max() > -0.5:
        K /= 2
    plant = pf.UncertainPlant.from_vertices([A], [B], [E])
    measured = [Output(f"y{k}", "", C=C[k], F=F[k]) for k in range(r)]
    signals = [Output("v", "", C=V, D=D, F=G), Output("z", "", C=Z, D=S, F=H)]
    plant = replace(
        plant, outputs=(*measured, *signals), disturbances=tuple(f"w{k}" for k in range(q))
    )
    law = pf.PolynomialGain(((0,),), K[None], tuple(measured))
    own = WorstCaseGain(
        "z", inputs=["u1", "v -> w2"], weight="0.2*(s + 1)/(s + 3)", disturbances=["w0", "w1"]
    )
    bound, seen = best_bound(plant, law, own), sampled(plant, law, own, np.ones((1, 1))).worst
    assert seen <= bound.level < 1.1 * seen
    closer = best_bound(plant, law, replace(own, time_invariant=True))
    assert seen <= closer.level <= bound.level * (1 + 1e-3)
    # u = K (C x + F w) + t1, w2 = t2, with t = delta W [K y; v]
    w = np.geomspace(0.02, 60, 150)
    most = 0.0
    for s in 1j * w:
        P = np.linalg.inv(s * np.eye(n) - A)
        weight = 0.2 * (s + 1) / (s + 3)
        for _ in range(60):
            d1, d2 = np.exp(2j * np.pi * random.random(2)) * weight
            # unknown [x, u, w2]: x = P (B u + E01 w + E2 w2)
            rows = np.zeros((n + 2, n + 2), dtype=complex)
            right = np.zeros((n + 2, 2), dtype=complex)
            rows[:n, :n], rows[:n, n], rows[:n, n + 1] = np.eye(n), -(P @ B)[:, 0], -P @ E[:, 2]
            right[:n] = P @ E[:, :2]
            rows[n, :n], rows[n, n] = -(1 + d1) * (K @ C)[0], 1.0
            rows[n, n + 1] = -(1 + d1) * (K @ F)[0, 2]
            right[n] = (1 + d1) * (K @ F)[0, :2]
            rows[n + 1, :n], rows[n + 1, n] = -d2 * V, -d2 * D[0]
            rows[n + 1, n + 1] = 1 - d2 * G[2]
            right[n + 1] = d2 * G[:2]
            x = np.linalg.solve(rows, right)
            z = Z @ x[:n] + S[0] * x[n] + H[2] * x[n + 1] + H[:2]
            most = max(most, float(np.linalg.norm(z)))
    assert most <= bound.level
    assert most > 0.9 * seen


def test_paths_are_refused_in_a_line_where_there_are_none():
    plant = loads(ADDITIVE)
    own = WorstCaseGain("y", inputs="command -> nothing", weight="0.4")
    with pytest.raises(InputError, match="no disturbance 'nothing'"):
        own.require_fit(plant)
    with pytest.raises(InputError, match="nowhere"):
        Unmodelled("nowhere -> additive", weight="0.4").require_fit(plant)
    with pytest.raises(InputError, match="is constant"):
        Unmodelled("u", weight="0.4")
    with pytest.raises(InputError, match="is a path; ask for unmodelled dynamics"):
        DiskMargin("command -> additive").require_fit(plant)


@pytest.fixture(scope="module")
def additive(tmp_path_factory):
    plant, folder = loads(ADDITIVE), tmp_path_factory.mktemp("file")
    law = pf.PolynomialGain(((0,),), np.array([[[-2.0]]]), (plant.signal("y"),))
    limits = [
        WorstCaseGain("y", inputs="command -> additive", weight="0.4", disturbances=["d"]),
        Unmodelled("command -> additive", weight="0.4"),
    ]
    region = pf.parse_region("half_plane(0)")
    pf.analyse(plant, law, region, limits=limits).design.save(folder)
    document = json.loads((folder / "design.json").read_text())
    assert is_accepted(document)
    return document


@pytest.mark.parametrize("kind", ["worst-case gain", "unmodelled dynamics"])
@pytest.mark.parametrize(
    "change",
    [
        lambda paths: paths | {"disturbances": [3]},
        lambda paths: paths | {"disturbances": [0]},
        lambda paths: paths | {"disturbances": []},
        lambda paths: paths | {"outputs": []},
        lambda paths: paths | {"outputs": [{"name": "command", "C": [[0, 3]]}]},
        lambda _: None,
    ],
)
def test_one_fault_in_paths_and_it_is_not_proved(additive, kind, change):
    table = json.loads(json.dumps(additive))
    claim = next(own for own in table["claims"] if own["kind"] == kind)
    claim["paths"] = change(claim["paths"])
    if claim["paths"] is None:
        del claim["paths"]
    assert not is_accepted(table)


# --- of every kind of plant ---------------------------------------------------------------------

FUNCTIONS = MASS_ON_SPRING.replace("range = [80, 120]", "range = [0, 1]").replace(
    '"-k"', '"-90*cos(k)"'
)
MOVING = MASS_ON_SPRING.replace("range = [80, 120]", "range = [80, 120]\nrate = [-5, 5]")
LATE = MASS_ON_SPRING + "[dead_time.force]\ntime = 0.01\n"


@pytest.mark.parametrize(
    ("text", "step", "loose"),
    [
        (MASS_ON_SPRING, 0.0, 1.001),
        (MASS_ON_SPRING, 0.01, 1.001),
        (FUNCTIONS, 0.0, 1.005),
        (FUNCTIONS, 0.01, 1.005),
        (MOVING, 0.0, 1.02),
        (LATE, 0.0, 2.2),
    ],
)
def test_plants_of_every_kind(text, step, loose):
    plant = loads(text)
    plant = pf.at_sample_time(plant, step) if step else plant
    law = given_law(plant, np.array([[-20.0, -4.0]]))
    weight = "0.05*(z - 0.2)/(z - 0.8)" if step else "0.05*(s + 2)/(s + 8)"
    alpha = seeded(plant, 60)
    for own in (
        Unmodelled("position -> push", weight="10"),
        Unmodelled(["force", "position -> push"], weight=weight, time_invariant=True),
        WorstCaseGain(
            ["position", "force"],
            inputs=["position -> push", "force"],
            weight=weight,
            time_invariant=True,
        ),
    ):
        seen = sampled(plant, law, own, alpha).worst
        assert seen <= best_bound(plant, law, own).level < seen * loose


# --- samples -------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_dynamics_of_samples_are_as_those_in_time(seed):
    """Against numbers of size one in the place of delta, at each frequency of the samples."""
    random = np.random.default_rng(seed)
    n, T = 3, 0.05
    A = random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 1.0) * np.eye(n)
    A = np.linalg.matrix_power(np.eye(n) + A * T / 64, 64)
    B, E, C = random.normal(size=(n, 1)), random.normal(size=(n, 1)), random.normal(size=n)
    K = 0.2 * random.normal(size=(1, n))
    while np.abs(np.linalg.eigvals(A + B @ K)).max() > 0.99:
        K /= 2
    plant = pf.UncertainPlant.from_vertices([A], [B], [E], sample_time=T)
    plant = replace(plant, outputs=(Output("y", "", C=C),))
    law, weight = given_law(plant, K), "0.1*(z - 0.5)/(z - 0.9)"
    own = WorstCaseGain("y", inputs="u1", weight=weight)
    bound, seen = best_bound(plant, law, own), sampled(plant, law, own, np.ones((1, 1))).worst
    z = np.exp(1j * np.linspace(1e-3, np.pi, 3000))
    inner = np.linalg.inv(z[:, None, None] * np.eye(n) - A - B @ K)
    W = 0.1 * (z - 0.5) / (z - 0.9)
    y_w, y_u = ((C @ inner @ M)[:, 0] for M in (E, B))
    u_w, u_u = ((K @ inner @ M)[:, 0, 0] for M in (E, B))
    most = 0.0
    for delta in np.exp(2j * np.pi * np.linspace(0, 1, 200)):
        most = max(most, np.abs(y_w + y_u * delta * W * u_w / (1 - delta * W * u_u)).max())
    assert seen == pytest.approx(most, rel=2e-3)
    assert seen <= bound.level < 1.05 * seen
    assert ", at samples every" in bound.claim.statement(file_plant(plant))
    borne = best_bound(plant, law, Unmodelled("u1", weight=weight)).level
    assert borne == pytest.approx(np.abs(W * u_u).max(), rel=2e-3)
    fails = broken(plant, law, Unmodelled("u1", weight=weight), [Fraction(1)])
    assert 1 / borne <= float(fails.gain) < 1.002 / borne


def test_a_weight_is_written_in_the_time_of_the_plant():
    plant = loads(ADDITIVE)
    at_samples = pf.at_sample_time(plant, 0.01)
    with pytest.raises(InputError, match="write the weight in z"):
        Unmodelled("u", weight="(s + 1)/(s + 4)").require_fit(at_samples)
    with pytest.raises(InputError, match="write the weight in s"):
        WorstCaseGain("y", inputs="u", weight="0.1/(z - 0.5)").require_fit(plant)
    with pytest.raises(InputError, match="is not stable"):
        Unmodelled("u", weight="1/(z - 1.5)")
    WorstCaseGain("x", inputs="x -> d", weight="0.1").require_fit(at_samples)


# --- searched for --------------------------------------------------------------------------------


def test_a_law_is_tuned_with_its_leads():
    """No worse than one that is tuned for all dynamics, and proved again by its file."""
    plant = loads(MASS_ON_SPRING)
    own = WorstCaseGain(
        "position", inputs=["force", "position -> push"], weight="0.5*(s + 1)/(s + 9)"
    )
    limit = pf.Rms("force", 1.0, density=1.0)
    levels = []
    for given in (False, True):
        asked = replace(own, time_invariant=given)
        done = pf.optimise(plant, asked, [limit], structure=Structure(schedule=()))
        levels.append(done.bounds[0].level)
        seen = sampled(plant, done.law, asked, seeded(plant, 60)).worst
        assert seen <= levels[-1] < 1.01 * seen
    assert levels[1] <= levels[0] * (1 + 1e-3)
