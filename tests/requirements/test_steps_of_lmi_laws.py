"""Step responses of laws Z W^-1: proved as those of other laws are, against simulations."""

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import polefence as pf
from polefence.certify.bounds import best_bound
from polefence.cli.main import main
from polefence.plant.outputs import Output
from polefence.proof.document import check, from_plain
from polefence.proof.polynomials import affine
from polefence.proof.response import Centred, Follower, Series
from polefence.proof.work import FormatError
from polefence.requirements.step import StepMeasure
from support.specs import MASS_ON_SPRING

A = [[[0.0, 1.0], [-k, -c]] for k, c in ((2.0, 0.3), (5.0, 0.6))]
B = [[[0.0], [1.0]], [[0.3], [1.5]]]
E = np.array([[0.0], [1.0]])
POSITION = Output("position", "m", C=[1, 0])


@pytest.fixture(scope="module")
def placed():
    """A scheduled law of LMIs, and its plant."""
    plant = pf.UncertainPlant.from_vertices(A, B, [E.tolist()] * 2)
    law = pf.place(plant, pf.Disk(-4, 2.5), "scheduled").law
    assert np.abs(law.W[0] - law.W[1]).max() > 0.2 * np.abs(law.W).max()
    return plant, law


def closed(law, share):
    own, acting = ((1 - share) * np.array(M[0]) + share * np.array(M[1]) for M in (A, B))
    return own + acting @ law.gain(np.array([[1 - share, share]]))[0]


def simulated(law, share, t):
    loop = closed(law, share)
    run = solve_ivp(
        lambda _, x: loop @ x + E[:, 0], (0, t[-1]), [0, 0], t_eval=t, rtol=1e-10, atol=1e-12
    )
    return run.y[0], float(-np.linalg.solve(loop, E)[0, 0])


@pytest.mark.parametrize("measure", ["peak", "overshoot", "settling", "rise", "final"])
def test_a_proved_measure_is_that_of_the_worst_plant(placed, measure):
    plant, law = placed
    band = {"settling": 0.05, "rise": 0.1}.get(measure)
    bound = best_bound(plant, law, StepMeasure(POSITION, measure=measure, band=band))
    t, worst = np.linspace(0, 6, 6001), 0.0
    for share in np.linspace(0, 1, 21):
        y, final = simulated(law, share, t)
        values = {
            "peak": np.abs(y).max(),
            "overshoot": y.max() / final - 1,
            "settling": t[np.flatnonzero(np.abs(y - final) > 0.05 * final)[-1] + 1],
            "rise": t[np.flatnonzero(y >= 0.9 * final)[0]],
            "final": final,
        }
        worst = max(worst, values[measure])
    assert worst * (1 - 1e-6) - 2e-3 * (measure in ("settling", "rise")) <= bound.level
    assert bound.level <= max(1.005 * worst, 1.1e-3) + 2e-3 * (measure in ("settling", "rise"))


@pytest.fixture(scope="module")
def document(placed, tmp_path_factory):
    """A file with what is proved of a step."""
    (plant, law), folder = placed, tmp_path_factory.mktemp("file")
    asked = StepMeasure(POSITION, measure="settling", band=0.05)
    asked = replace(asked, at_most=best_bound(plant, law, asked).level)
    pf.analyse(plant, law, pf.HalfPlane(0), limits=[asked]).design.save(folder)
    return json.loads((folder / "design.json").read_text())


def is_proved(table):
    try:
        return check(from_plain(table)).proved
    except FormatError:
        return False


def test_the_file_proves_it(document):
    assert is_proved(document)


@pytest.mark.parametrize(("key", "share"), [("W", "1.02"), ("Z", "0.98")])
def test_of_a_slower_law_it_is_not_proved(document, key, share):
    table = json.loads(json.dumps(document))
    own = table["law"][key][0]
    own[-1][-1] = float(Fraction(own[-1][-1]) * Fraction(share))
    assert not is_proved(table)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_followed_is_as_near_as_it_says(seed):
    """x = W z of random W, where x' = M z + b."""
    random, n = np.random.default_rng([81, seed]), 3
    turning = [3 * np.eye(n) + 0.2 * (S + S.T) for S in random.normal(size=(2, n, n))]
    middle = random.normal(size=(n, n)) - 4 * np.eye(n)
    more = 0.2 * random.normal(size=(2, n, n))
    moved = [(middle + S) @ W for S, W in zip(more, turning, strict=True)]
    E = random.normal(size=(n, 1))
    exact = [
        [[[Fraction(x) for x in row] for row in M.tolist()] for M in every]
        for every in (moved, [E, E], turning)
    ]
    M, b, W = (Centred.of(affine(own, (2,))) for own in exact)
    follower = Follower(M, b, Series(12, 7, 80), (2,), (Fraction(1),) * n, Fraction(1, 10), W)
    steps = list(follower.steps({}, [Fraction(1, 16)] * 24))
    for share in (0.0, 0.4, 1.0):
        w, m = ((1 - share) * own[0] + share * own[1] for own in (turning, moved))
        loop, g = m @ np.linalg.inv(w), share - 0.5
        for step in steps[::4]:
            x = np.linalg.solve(loop, expm(float(step.end) * loop) - np.eye(n)) @ E[:, 0]
            z = sum(
                np.array([float(Fraction(c, 2**80)) for c in v]) * g ** e[0]
                for e, v in step.last.items()
            )
            assert np.linalg.norm(x - w @ z) <= float(step.error) + 1e-12
    assert float(steps[-1].error) < 1e-4


def test_a_signal_that_comes_back_to_zero_has_no_settling_time(tmp_path, capsys):
    spec = tmp_path / "own.toml"
    spec.write_text(MASS_ON_SPRING)
    asked = ["--gain", "[[-20, -8]]", "--limit", "step of velocity with measure settling"]
    assert main(["verify", str(spec), *asked]) != 0
    said = capsys.readouterr().out
    assert "sampled never (of a final value of zero ask for an envelope)" in said


@pytest.mark.parametrize("kind", ["initial", "impulse"])
@pytest.mark.parametrize("measure", ["peak", "settling"])
def test_free_motions_too(placed, kind, measure):
    plant, law = placed
    band, x0 = 0.001 if measure == "settling" else None, np.array([0.3, -1.0])
    asked = pf.ImpulseMeasure(POSITION, measure=measure, band=band)
    if kind == "initial":
        start = {"x1": 0.3, "x2": -1.0}
        asked = pf.InitialMeasure(POSITION, measure=measure, band=band, start=start)
    else:
        x0 = np.array([0.0, 1.0])
    bound, t, worst = best_bound(plant, law, asked), np.linspace(0, 6, 6001), 0.0
    for share in np.linspace(0, 1, 21):
        loop = closed(law, share)
        step, x, y = expm(loop * t[1]), x0, []
        for _ in t:
            y.append(abs(x[0]))
            x = step @ x
        y = np.array(y)
        late = t[:-1][y[:-1] > 0.001] + t[1]
        value = y.max() if measure == "peak" else late.max(initial=0.0)
        worst = max(worst, value)
    assert worst > 0.01
    assert worst * (1 - 1e-6) - 1e-3 * (measure == "settling") <= bound.level
    assert bound.level <= 1.005 * worst + 1e-3 * (measure == "settling")


def test_how_far_a_start_is_off_is_counted(placed):
    """z of degree two is nearly a start of x = W z: |x(0) - W z| is at most what is said."""
    claim = best_bound(*placed, pf.ImpulseMeasure(POSITION)).claim
    cells = claim.subject.evidence.cells
    one = claim.inside(cells[0]) if cells else claim
    one = replace(one, following=(replace(one.following[0], degree=2),))
    run = one.run
    form, off = run.start
    bits = one.following[0].bits
    norm = np.array([float(x) for x in run.follower.norm])
    for g in (-0.5, 0.5):
        terms = run.W.terms.items()
        W = sum(np.array(M, dtype=float) * g ** e[0] for e, M in terms) / run.W.whole
        z = sum(np.array(v, dtype=float) * g ** e[0] for e, v in form.items()) / 2.0**bits
        assert 1e-4 < norm @ np.abs([0, 1] - W @ z) <= float(off)
