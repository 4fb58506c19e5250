"""Step responses: proved for all parameters, against simulations, slopes, files and commands."""

import json
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

import polefence as pf
from polefence.base.errors import InputError, SpecError
from polefence.certify import responses
from polefence.certify.bounds import best_bound, kept_bound
from polefence.cli.main import main
from polefence.plant.outputs import Output
from polefence.plant.spec import loads
from polefence.proof.document import check, from_plain
from polefence.proof.polynomials import affine, constant
from polefence.proof.response import Centred, Follower, Series, positive
from polefence.proof.work import FormatError
from polefence.requirements.slopes import Loops
from polefence.requirements.step import StepMeasure, StepNearness
from polefence.requirements.text import parse_specification
from polefence.response.modes import Modes
from support.commands import refused
from support.specs import MASS_ON_SPRING

GAIN = np.array([[-20.0, -8.0]])


def family(seed, n=4, count=1):
    """Vertices of a stable family, E and C with a final value of about one."""
    random = np.random.default_rng(seed)
    S = random.normal(size=(n, n))
    A = 4 * (S - S.T) + random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.6) * np.eye(n)
    E = random.normal(size=(n, 1))
    C = -np.linalg.solve(A, E).T
    more = [0.05 * random.normal(size=(n, n)) for _ in range(count)]
    corners = np.array(np.meshgrid(*[[-1, 1]] * count, indexing="ij")).reshape(count, -1).T
    return [A + np.tensordot(c, more, 1) for c in corners], E, C / (C @ C.T), random


def simulated(A, E, C, t):
    """y at times, by the exponential of each step."""
    n, h = len(A), t[1] - t[0]
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n:] = A, E
    step, x, y = expm(h * whole), np.eye(n + 1)[:, -1], []
    for _ in t:
        y.append(float((C @ x[:n])[0]))
        x = step @ x
    return np.array(y)


def measured(measure, t, y, final, band):
    s = np.sign(final)
    match measure:
        case "peak":
            return np.abs(y).max()
        case "overshoot":
            return (s * y).max() / abs(final) - 1
        case "undershoot":
            return -(s * y).min() / abs(final)
        case "settling":
            return t[np.flatnonzero(np.abs(y - final) > band * abs(final))[-1] + 1]
        case "rise":
            return t[np.flatnonzero(s * y >= (1 - band) * abs(final))[0]]
        case _:
            return abs(final)


# --- against theory ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "measure", ["peak", "overshoot", "undershoot", "settling", "rise", "final"]
)
@pytest.mark.parametrize("seed", [0, 3])
def test_a_proved_measure_is_that_of_the_worst_plant(measure, seed):
    """Of 40 plants simulated otherwise: never below, within 0.5 % of them."""
    vertices, E, C, random = family(seed)
    n, band = len(E), {"settling": 0.05, "rise": 0.1}.get(measure)
    plant = pf.UncertainPlant.from_vertices(vertices, [np.ones((n, 1))] * 2, [E] * 2)
    law = pf.FixedGain(np.zeros((1, n)))
    own = StepMeasure(Output("y", "", C=C[0]), measure=measure, band=band)
    bound = best_bound(plant, law, own)
    t, worst = np.arange(0, 14, 1e-3), 0.0
    for share in (0, 1, *random.random(38)):
        A = (1 - share) * vertices[0] + share * vertices[1]
        final = float((-C @ np.linalg.solve(A, E))[0, 0])
        worst = max(worst, measured(measure, t, simulated(A, E, C, t), final, band))
    assert bound.level >= worst * (1 - 1e-9) - 1e-3 * (measure in ("settling", "rise"))
    assert bound.level <= max(1.005 * worst, 1.1e-3) + 1e-3 * (measure in ("settling", "rise"))


def test_work_on_parts_is_bounded(monkeypatch):
    vertices, E, C, _ = family(0)
    plant = pf.UncertainPlant.from_vertices(vertices, [np.ones((4, 1))] * 2, [E] * 2)
    law, y = pf.FixedGain(np.zeros((1, 4))), Output("y", "", C=C[0])
    assert kept_bound(plant, law, StepMeasure(y, 1.7, measure="peak")) is not None
    tried, search = [], responses._part
    monkeypatch.setattr(responses, "_part", lambda *part: tried.append(part) or search(*part))
    monkeypatch.setattr(responses, "SOUGHT", 10**6)
    assert kept_bound(plant, law, StepMeasure(y, 1.7, measure="peak")) is None
    assert len(tried) == 1


@pytest.mark.parametrize("seed", range(3))
def test_what_is_followed_is_as_near_as_it_says(seed):
    """Two parameters, a mode 50 times as fast, and steps much longer than it lasts."""
    vertices, E, _, random = family(seed, count=2)
    n, shape = len(E), [[300.0, 0, 0, 0]]
    vertices = [A - np.pad(shape, ((0, 3), (0, 0))) for A in vertices]
    exact = [[[Fraction(x) for x in row] for row in A.tolist()] for A in vertices]
    b = [[Fraction(x) for x in row] for row in E.tolist()]
    sizes = (2, 2)
    A, b = Centred.of(affine(exact, sizes)), Centred.of(constant(b, sizes))
    worst = max(np.linalg.eigvalsh(M + M.T).max() for M in vertices) / 2
    if worst > -0.1:  # |e| itself is to fade
        vertices = [M - (worst + 0.1) * np.eye(n) for M in vertices]
        exact = [[[Fraction(x) for x in row] for row in M.tolist()] for M in vertices]
        A = Centred.of(affine(exact, sizes))
    one = Follower(A, b, Series(12, 4, 80), sizes, (Fraction(1),) * n, Fraction(1, 20))
    lengths = [Fraction(1, 128)] * 3 + [Fraction(1, 64)] * 3 + [Fraction(1, 16)] * 12
    steps = list(one.steps({}, lengths))
    for g in ((-0.5, -0.5), (0.5, -0.5), (0, 0), *random.uniform(-0.5, 0.5, (3, 2))):
        weights = [(0.5 - g[0]) * (0.5 - g[1]), (0.5 - g[0]) * (0.5 + g[1])]
        weights += [(0.5 + g[0]) * (0.5 - g[1]), (0.5 + g[0]) * (0.5 + g[1])]
        M = np.tensordot(weights, vertices, 1)
        for step in steps[::5]:
            x = np.linalg.solve(M, expm(M * float(step.end)) - np.eye(n)) @ E[:, 0]
            near = sum(
                np.array([float(Fraction(c, 2**80)) for c in v]) * g[0] ** e[0] * g[1] ** e[1]
                for e, v in step.last.items()
            )
            assert np.linalg.norm(x - near) <= float(step.error) + 1e-12
    assert float(steps[-1].error) < 1e-4


def test_an_error_is_counted_whatever_the_forms_are():
    """The residual of forms that were spoilt is as much larger."""
    vertices, E, _, _ = family(1)
    exact = [[[Fraction(x) for x in row] for row in A.tolist()] for A in vertices]
    b = Centred.of(constant([[Fraction(x) for x in row] for row in E.tolist()], (2,)))
    one = Follower(
        Centred.of(affine(exact, (2,))), b, Series(8, 3, 60), (2,), (Fraction(1),) * 4, Fraction(1)
    )
    h = Fraction(1, 64)
    forms = list(one.solved({}, h))
    good = one.residual(forms, h)
    forms[3] = {**forms[3], (1,): [x + 2**40 for x in forms[3].get((1,), [0] * 4)]}
    # X' moves by 6 and 3 times as much in T_2 and T_0, of four states and |g| <= 1/2
    assert one.residual(forms, h) > good + Fraction(2**40, 2**60) * 4 * 4


@pytest.mark.parametrize("seed", range(5))
def test_polynomials_are_positive_where_they_are(seed):
    """Of Chebyshev polynomials and powers, by values on a grid."""
    random = np.random.default_rng(seed)
    q = {(i, e): int(x) for i in range(6) for e in range(4) for x in [random.integers(-99, 99)]}
    s, g = np.meshgrid(np.linspace(-1, 1, 201), np.linspace(-0.5, 0.5, 101))
    values = sum(x * np.cos(i * np.arccos(s)) * g**e for (i, e), x in q.items())
    low = int(np.floor(values.min()))
    for more, answer in ((-low + 3 + abs(low) // 4, True), (-low - 3 - abs(low) // 50, False)):
        moved = {**q, (0, 0): q[0, 0] + more}
        assert positive(moved, [Fraction(1, 2)], 9) is answer


# --- slopes --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "own",
    [
        StepMeasure("y", measure="peak"),
        StepMeasure("y", measure="overshoot"),
        StepMeasure("y", measure="undershoot"),
        StepMeasure("y", measure="final"),
        StepNearness("y", 1.0, measure="settling", time=2.0),
        StepNearness("y", 1.0, measure="rise", time=0.3),
    ],
)
@pytest.mark.parametrize("seed", [5, 6])
def test_slopes_are_those_of_central_differences(own, seed):
    (A, _), E, C, random = family(seed)
    loop = {"A": A, "E": np.hstack([E, -E / 3]), "C": C, "F": 0.1 * random.normal(size=(1, 2))}

    def found(**moved):
        M = {**loop, **moved}
        return own.slopes(Loops(Modes(M["A"][None]), *(M[key][None] for key in "ECF")))

    first = found()
    (turned,) = first.turned()
    k = first.values.argmax()
    for key, M in loop.items():
        along, size = random.normal(size=M.shape), 1e-6
        ahead, back = (found(**{key: M + sign * size * along}).values.max() for sign in (1, -1))
        slope = float((getattr(turned, key)[k] * along).sum())
        assert (ahead - back) / 2 / size == pytest.approx(slope, rel=1e-4, abs=1e-5)


# --- files and commands --------------------------------------------------------------------------


def is_proved(document):
    try:
        return check(from_plain(document)).proved
    except FormatError:
        return False


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    plant, folder = loads(MASS_ON_SPRING), tmp_path_factory.mktemp("file")
    law, limit = pf.FixedGain(GAIN), StepMeasure("position", 0.7, measure="settling", band=0.05)
    assert kept_bound(plant, law, limit) is not None
    pf.analyse(plant, law, pf.parse_region("half_plane(0)"), limits=[limit]).design.save(folder)
    document = json.loads((folder / "design.json").read_text())
    assert is_proved(document)
    return document


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("level", lambda _: 0.35),
        ("level", lambda _: 0.6999),
        ("band", lambda _: 0.01),
        ("band", lambda _: 0),
        ("band", lambda _: 1),
        ("measure", lambda _: "calm"),
        ("following", lambda _: []),
        ("following", lambda x: [x[0] | {"lengths": x[0]["lengths"][:-1]}]),
        ("following", lambda x: [x[0] | {"lengths": [[0.5, 4]]}]),
        ("following", lambda x: [x[0] | {"lengths": [[10**6, 1]]}]),
        ("following", lambda x: [x[0] | {"rate": 1000}]),
        ("following", lambda x: [x[0] | {"rate": -1}]),
        ("following", lambda x: [x[0] | {"reach": 0}]),
        ("following", lambda x: [x[0] | {"reach": "1/1000000"}]),
        ("following", lambda x: [x[0] | {"terms": 2}]),
        ("following", lambda x: [x[0] | {"degree": 0}]),
        ("following", lambda x: [x[0] | {"bits": 4}]),
        ("following", lambda x: [x[0], x[0]]),
    ],
)
def test_one_fault_in_a_file_and_it_is_not_proved(document, key, change):
    table = json.loads(json.dumps(document))
    claim = next(own for own in table["claims"] if own["kind"] == "step")
    claim[key] = change(claim.get(key))
    assert not is_proved(table)


def test_a_law_is_tuned_for_settling_and_overshoot(tmp_path, capsys):
    spec, out, said = (tmp_path / name for name in ("own.toml", "out", "said.json"))
    spec.write_text(
        MASS_ON_SPRING + '[law]\nschedule = []\n[[specification]]\nkind = "rms"\n'
        'signal = "force"\ndensity = 1\nminimise = true\n[[specification]]\nkind = "step"\n'
        'signal = "position"\nmeasure = "settling"\nat_most = 0.6\n[[specification]]\n'
        'kind = "step"\nsignal = "position"\nmeasure = "overshoot"\nat_most = 0.05\n'
    )
    assert main(["optimise", str(spec), "--json", str(said), "-o", str(out)]) == 0
    rows = json.loads(said.read_text())["bounds"]
    assert [row["kind"] for row in rows] == ["rms", "step", "step"]
    assert rows[1]["proved"] == 0.6
    assert rows[2]["proved"] == 0.05
    assert 0.5 < rows[1]["worst sampled"] <= 0.6
    assert 0.045 < rows[2]["worst sampled"] <= 0.05
    capsys.readouterr()
    assert main(["check", str(out)]) == 0
    text = capsys.readouterr().out
    assert "settling time to within 0.02 of its final value of 'position' = x1 <= 0.6" in text


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("step of position with measure calm", "measure = 'calm'"),
        ("step of position with measure peak with band 0.1", "band = 0.1: it is of settling"),
        ("step of position with measure settling with band 2", "must be above 0 and below 1"),
    ],
)
def test_bad_lines_say_what_is_wrong(line, why):
    with pytest.raises((InputError, SpecError), match=why):
        parse_specification(line)


def test_two_envelopes_of_one_signal_are_to_be_one(tmp_path, capsys):
    table = '[[specification]]\nkind = "step"\nsignal = "position"\nenvelope = [[0, -1, {}]]\n'
    spec = tmp_path / "mass.toml"
    spec.write_text(MASS_ON_SPRING + table.format(1) + table.format(2))
    error = refused(capsys, "optimise", spec)
    assert "two limits on step of position with measure envelope; write one envelope that" in error
