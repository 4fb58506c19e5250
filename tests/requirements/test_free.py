"""Free motions and envelopes: proved for all parameters, against simulations; slopes, files."""

import json

import numpy as np
import pytest
from scipy.linalg import expm

import polefence as pf
from polefence.base.errors import InputError, SpecError
from polefence.certify.bounds import best_bound, kept_bound
from polefence.cli.main import main
from polefence.plant.outputs import Output
from polefence.plant.spec import loads
from polefence.proof.claims.base import prove
from polefence.proof.document import check, from_plain
from polefence.proof.work import FormatError
from polefence.requirements.free import ImpulseNearness, InitialNearness
from polefence.requirements.slopes import Loops
from polefence.requirements.text import parse_specification
from polefence.response.modes import Modes
from support.specs import MASS_ON_SPRING

GAIN = np.array([[-20.0, -8.0]])
T = np.arange(0, 14, 2e-3)


def family(seed):
    """A plant of two to four states and one or two parameters, without a law; and its parts."""
    random = np.random.default_rng(seed)
    n, count = int(random.integers(2, 5)), int(random.integers(1, 3))
    S = random.normal(size=(n, n))
    A = 4 * (S - S.T) + random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.6) * np.eye(n)
    E, C = random.normal(size=(n, 1)), random.normal(size=n)
    more = 0.05 * random.normal(size=(count, n, n))
    terms = [(f"p{k}", M) for k, M in enumerate(more)]
    rows = [
        [" + ".join([repr(float(A[i, j])), *(f"{float(M[i, j])!r}*{p}" for p, M in terms)])
         for j in range(n)]
        for i in range(n)
    ]  # fmt: skip
    parameters = [pf.Parameter(p, -1, 1) for p, _ in terms]
    plant = pf.UncertainPlant.from_expressions(parameters, rows, np.ones((n, 1)), E=E)
    at = random.uniform(-1, 1, (60, count))
    at[:20] = np.sign(at[:20])
    return plant, Output("y", "", C=C), A + np.tensordot(at, more, 1), E[:, 0], random


def simulated(A, C, x0, b):
    """y at times T, by the exponential of each step, of many A at once."""
    count, n, _ = A.shape
    whole = np.zeros((count, n + 1, n + 1))
    whole[:, :n, :n], whole[:, :n, n] = A, b
    step = np.array([expm(T[1] * M) for M in whole])
    x, y = np.tile(np.append(x0, 1.0), (count, 1)), np.empty((count, len(T)))
    for k in range(len(T)):
        y[:, k] = x[:, :n] @ C
        x = np.einsum("kij,kj->ki", step, x)
    return y


def asked(kind, signal, start, **own):
    if kind == "initial":
        names = {f"x{k + 1}": float(x) for k, x in enumerate(start)}
        return pf.InitialMeasure(signal, start=names, **own)
    return (pf.ImpulseMeasure if kind == "impulse" else pf.StepMeasure)(signal, **own)


# --- against theory ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["initial", "impulse", "step"])
@pytest.mark.parametrize("seed", range(4))
def test_a_proved_measure_is_that_of_the_worst_plant(kind, seed):
    """Of 60 plants simulated otherwise: never below, within 2 % of them."""
    plant, signal, A, E, random = family(seed)
    start, none, C = random.normal(size=len(E)), 0 * E, np.ravel(signal.C).astype(float)
    begins = {"initial": (start, none), "impulse": (E, none), "step": (none, E)}[kind]
    y, law = simulated(A, C, *begins), pf.FixedGain(np.zeros((1, len(E))))
    size, middle, end = np.abs(y).max(), y.mean(axis=0), y[:, -1].mean() * (kind == "step")
    worst = {("peak", 0.0): size}
    if kind != "step":
        late = max(T[np.flatnonzero(np.abs(own) > 0.1 * size)[-1] + 1] for own in y)
        worst["settling", 2e-3] = late
    at = [0, 125, 250, 500, 1250]
    points = [(T[k], middle[k] - w, middle[k] + w) for k in at for w in [size * 0.4 / (1 + T[k])]]
    points.append((6.0, end - 0.2 * size, end + 0.2 * size))
    times, low, high = np.array(points).T
    low, high = np.interp(T, times, low), np.interp(T, times, high)
    worst["envelope", 0.0] = (np.abs(y - (low + high) / 2) / (high - low) * 2).max()
    for (measure, slack), value in worst.items():
        own = {"band": float(0.1 * size)} if measure == "settling" else {}
        own |= {"envelope": points} if measure == "envelope" else {}
        bound = best_bound(plant, law, asked(kind, signal, start, measure=measure, **own))
        assert prove(bound.claim).proved
        assert value * (1 - 1e-9) - slack <= bound.level <= 1.02 * value + slack


@pytest.mark.parametrize(("level", "kept"), [(1.001, True), (0.999, False)])
@pytest.mark.parametrize("measure", ["peak", "settling", "envelope"])
def test_limits_are_bracketed_from_both_sides(measure, level, kept):
    """x' = -a x from 2, 1 <= a <= 3: the slowest is 2 e^-t."""
    plant = loads(
        'name = "lag"\nstates = ["x"]\ninputs = ["u"]\n[parameter.a]\nrange = [1, 3]\n'
        '[matrices]\nA = [["-a"]]\nB = [[1]]\n'
    )
    own = {"measure": measure}
    if measure == "settling":
        own |= {"band": 2 / np.e}  # at 1 s
    most = {"peak": 2.0, "settling": 1.0, "envelope": 1.0}[measure]
    if measure == "envelope":
        own["envelope"] = [(0.0, -3.0, 2.5), (1.0, -2 / np.e, 2 / np.e)]
    limit = pf.InitialMeasure("x", most * level, start={"x": 2.0}, **own)
    assert (kept_bound(plant, pf.FixedGain([[0.0]]), limit) is not None) is kept


# --- slopes --------------------------------------------------------------------------------------

ENVELOPE = [(0.1, -1.0, 1.1), (0.5, -0.3, 0.8), (2.0, -0.1, 0.2)]
SLOPED = [
    pf.InitialMeasure("y", start={"x": 1.0}, measure="peak"),
    pf.InitialMeasure("y", start={"x": 1.0}, envelope=ENVELOPE),
    pf.ImpulseMeasure("y", envelope=ENVELOPE),
    pf.StepMeasure("y", envelope=ENVELOPE),
    InitialNearness("y", 1.0, start={"x": 1.0}, measure="settling", band=0.1, time=1.0),
    ImpulseNearness("y", 1.0, measure="settling", band=0.1, time=0.5),
]


@pytest.mark.parametrize("own", SLOPED)
@pytest.mark.parametrize("seed", [5, 6, 7])
def test_slopes_are_those_of_central_differences(own, seed):
    _, signal, A, E, random = family(seed)
    F = np.zeros((1, 2)) if own.kind != "step" else 0.1 * random.normal(size=(1, 2))
    C, E = np.ravel(signal.C)[None].astype(float), np.stack([E, -E / 3], axis=1)
    loop = {"A": A[30], "E": E, "C": C, "F": F}

    def found(**moved):
        M = {**loop, **moved}
        return own.slopes(Loops(Modes(M["A"][None]), *(M[key][None] for key in "ECF")))

    first = found()
    (turned,) = first.turned()
    k = first.values.argmax()
    for key, M in loop.items():
        if key == "F" and own.kind != "step":
            continue  # a disturbance that passes straight is refused
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


LIMITS = {
    "initial": pf.InitialMeasure(
        "velocity", 0.65, start={"position": 0.1}, measure="settling", band=0.05
    ),
    "impulse": pf.ImpulseMeasure(
        "position", 1.0, envelope=[(0.0, -0.02, 0.1), (0.5, -0.02, 0.06), (1.0, -0.02, 0.02)]
    ),
    "step": pf.StepMeasure(
        "position", 1.0, envelope=[(0, -0.002, 0.0125), (0.6, 0.006, 0.0112), (1, 0.0065, 0.0104)]
    ),
}  # fmt: skip


@pytest.fixture(scope="module", params=LIMITS)
def saved(request, tmp_path_factory):
    plant, folder, limit = (
        loads(MASS_ON_SPRING),
        tmp_path_factory.mktemp("f"),
        LIMITS[request.param],
    )
    law = pf.FixedGain(GAIN)
    assert kept_bound(plant, law, limit) is not None
    pf.analyse(plant, law, pf.parse_region("half_plane(0)"), limits=[limit]).design.save(folder)
    document = json.loads((folder / "design.json").read_text())
    assert is_proved(document)
    return request.param, document


def moved(points, k, j, by):
    rows = [list(row) for row in points]
    rows[k][j] = by
    return rows


FAULTS = {
    "initial": {
        "level": [0.1, 0.6, 0.649],
        "band": [0.01, 0, -1, None],
        "start": [[1, 0], [0.2, 0], [0.1], [0.1, 0, 0], None],
        "measure": ["peak", "overshoot", "rise", "final", "envelope", "calm"],
        "envelope": [[[0, -1, 1]]],
    },
    "impulse": {
        "level": [0.5, 0],
        "envelope": [
            [], None, [[0, 0.1, -0.02]], [[0, -0.02, 0.1]], [[-1, -1, 1], [0, -0.02, 0.1]],
            [[0, -0.02, 0.1, 1]], [[1, -0.02, 0.1], [0.5, -0.02, 0.1]], [[0, 0, 0]],
        ],
        "measure": ["peak", "settling", "overshoot"],
        "disturbances": [[10], [-1], [0]],
    },
    "step": {"level": [0.5], "disturbances": [[0.5], [2]], "measure": ["final", "rise", "peak"]},
}  # fmt: skip
CHANGES = {
    "initial": [],
    "impulse": [(0, 2, 0.04), (0, 1, 0.001), (1, 1, -0.005), (0, 0, 0.05), (2, 2, 5e-4), (2, 1, 0)],
    "step": [(0, 1, 0.001), (1, 1, 0.007), (1, 2, 0.0099), (2, 1, 0.0072), (2, 2, 0.0099)],
}


def test_one_fault_in_a_file_and_it_is_not_proved(saved):
    kind, document = saved
    faults = [(key, x) for key, values in FAULTS[kind].items() for x in values]
    claims = document["claims"]
    place = next(k for k, own in enumerate(claims) if own["kind"] == kind)
    faults += [("envelope", moved(claims[place]["envelope"], *own)) for own in CHANGES[kind]]
    following = claims[place]["following"][0]
    for own in ({"rate": 1000}, {"reach": "1/1000000"}, {"lengths": following["lengths"][:1]}):
        faults.append(("following", [following | own]))
    for key, value in faults:
        table = json.loads(json.dumps(document))
        if value is None:
            table["claims"][place].pop(key)
        else:
            table["claims"][place][key] = value
        assert not is_proved(table), (key, value)


def test_a_law_is_tuned_for_motions_and_envelopes(tmp_path, capsys):
    spec, out, said = (tmp_path / name for name in ("own.toml", "out", "said.json"))
    spec.write_text(
        MASS_ON_SPRING + '[law]\nschedule = []\n[[specification]]\nkind = "rms"\n'
        'signal = "force"\ndensity = 1\nminimise = true\n[[specification]]\nkind = "initial"\n'
        'signal = "position"\nstart = {position = 0.1}\nmeasure = "settling"\nband = 0.005\n'
        'at_most = 0.6\n[[specification]]\nkind = "impulse"\nsignal = "position"\n'
        "envelope = [[0, -0.01, 0.1], [0.5, -0.01, 0.03], [1, -0.005, 0.005]]\n"
    )
    assert main(["optimise", str(spec), "--json", str(said), "-o", str(out)]) == 0
    rows = json.loads(said.read_text())["bounds"]
    assert [row["kind"] for row in rows] == ["rms", "initial", "impulse"]
    assert [row["proved"] for row in rows[1:]] == [0.6, 1.0]
    assert max(row["worst sampled"] / row["proved"] for row in rows[1:]) > 0.95
    capsys.readouterr()
    assert main(["check", str(out)]) == 0
    text = capsys.readouterr().out
    assert "settling time to within 0.005 of zero of 'position' = x1 <= 0.6 from x(0) =" in text
    assert "impulse response of 'position' = x1 within -0.01 to 0.1 at 0 s, -0.01 to 0.03" in text
    assert "and ever after, after an impulse" in text


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("initial of position", "give the states that are not zero at first"),
        ("initial of position from [position * 0.1] with measure final", "measure = 'final'"),
        ("initial of position from [position * 0]", "that are not zero at first"),
        ("impulse of position with measure settling", "must be a number above 0, in the signal's"),
        ("impulse of position with measure peak with band 0.1", "band = 0.1: it is of settling"),
        ("impulse of position with measure envelope", "give envelope = "),
        ("impulse of position with envelope 3", "envelope is for a spec's tables"),
        ("initial of position with start 3", r"name states by from \[NAME \* 0.1\]"),
    ],
)
def test_bad_lines_say_what_is_wrong(line, why):
    with pytest.raises((InputError, SpecError), match=why):
        parse_specification(line)


TABLES = {
    "envelope = 3": "envelope must be a list of times, lower and upper numbers",
    "envelope = [[0, 1]]": "point 1 must be three numbers",
    "envelope = [[0, 1, -1]]": "point 1 is from 1 to -1; the first is to be the lower",
    "envelope = [[-1, -1, 1]]": "point 1 is at -1 s; times begin at 0",
    "envelope = [[0, -1, 1], [0, -1, 1]]": "point 2 is at 0 s, after 0 s; times must rise",
    "envelope = [[0, 1, 2], [1, 0, 1]]": "from 1 to 2 at 0 s, and the response begins at 0.1;",
    'envelope = [[0, -1, 2]]\nmeasure = "peak"': "an envelope go together",
    "envelope = [[0, -1, 2]]\nband = 1": "band = 1.0: it is of settling",
    "start = {height = 1}": "no state 'height'",
    "start = 1": "start = 1 must be a table of states and numbers",
    'start = {position = "a"}': "start.position = 'a' must be a finite number",
    'disturbances = ["push"]': "unknown key disturbances",
}


@pytest.mark.parametrize("keys", TABLES)
def test_bad_tables_say_what_is_wrong(keys, tmp_path, capsys):
    start = "" if "start" in keys else "start = {position = 0.1}\n"
    limit = "" if "envelope" in keys else "at_most = 1\n"
    spec = tmp_path / "own.toml"
    spec.write_text(
        f'{MASS_ON_SPRING}[[specification]]\nkind = "initial"\nsignal = "position"\n'
        f"{start}{limit}{keys}\n"
    )
    assert main(["optimise", str(spec), "--minimise", "rms of force with density 1"]) == 2
    said = capsys.readouterr().err
    assert TABLES[keys] in said
    assert said.count("\n") == 1


def test_what_passes_straight_has_no_impulse_response():
    plant = loads(
        'name = "lag"\nstates = ["x"]\ninputs = ["u"]\ndisturbances = ["w"]\n[outputs]\n'
        '"d" = {C = [1], F = [1]}\n[matrices]\nA = [[-1]]\nB = [[1]]\nE = [[1]]\n'
    )
    law = pf.FixedGain([[0.0]])
    with pytest.raises(InputError, match="a disturbance passes straight into 'd'"):
        best_bound(plant, law, pf.ImpulseMeasure("d"))
    bound = best_bound(plant, law, pf.InitialMeasure("d", start={"x": 1.0}))
    assert prove(bound.claim).proved
    assert 1 <= bound.level <= 1.002
