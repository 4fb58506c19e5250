"""Peaks under bounded disturbances: proved for all parameters, and attained."""

import json
import re

import numpy as np
import pytest
from scipy.linalg import expm

import polefence as pf
from polefence.base.errors import InputError
from polefence.certify import peak_to_peak
from polefence.certify.bounds import best_bound, kept_bound
from polefence.certify.foreseen import Foreseen
from polefence.cli.main import main
from polefence.plant.outputs import Output
from polefence.plant.spec import loads
from polefence.proof.claims.peak_to_peak import HALVINGS, _size
from polefence.proof.document import check, from_plain
from polefence.proof.work import FormatError
from polefence.requirements.peak_to_peak import PeakToPeak
from polefence.requirements.slopes import Loops
from polefence.response.modes import Modes
from support.specs import MASS_ON_SPRING
from support.truths import false

GAIN = np.array([[-20.0, -8.0]])


def family(seed, n, parameters, size, disturbances=1):
    """A stable family, what disturbs it, and a signal."""
    random = np.random.default_rng(seed)
    S = random.normal(size=(n, n))
    A = 4 * (S - S.T) + random.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.6) * np.eye(n)
    more = [size * random.normal(size=(n, n)) for _ in range(parameters)]
    corners = np.array(np.meshgrid(*[[-1, 1]] * parameters, indexing="ij")).reshape(parameters, -1)
    vertices = [A + np.tensordot(c, more, 1) for c in corners.T]
    E, C = random.normal(size=(n, disturbances)), random.normal(size=n)
    named = [pf.Parameter(f"p{k}", 0, 1) for k in range(parameters)] if parameters > 1 else ()
    B = [np.ones((n, 1))] * len(vertices)
    plant = pf.UncertainPlant.from_vertices(vertices, B, [E] * len(vertices), parameters=named)
    return plant, E, C, random


def weights(random, count, parameters):
    """Weights of the corners at so many points of the box, corners first."""
    shares = random.random((count, parameters))
    corners = np.array(np.meshgrid(*[[0, 1]] * parameters)).reshape(parameters, -1).T
    shares[: len(corners)] = corners
    alpha = np.ones((count, 1))
    for share in shares.T:
        pair = np.stack([1 - share, share], 1)
        alpha = (alpha[:, :, None] * pair[:, None]).reshape(count, -1)
    return alpha


def integral(A, E, C, apart=1e-3, count=15000):
    """The sum over disturbances of the integral of |C exp(A t) E|, of its values at times."""
    step, total = expm(A * apart), 0.0
    for _ in range(count):
        total += np.abs(C @ E).sum() * apart
        E = step @ E
    return total


# --- against theory ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("seed", "n", "parameters", "size", "disturbances"),
    [
        (0, 2, 1, 0.05, 1),
        (1, 3, 1, 0.1, 1),
        (2, 4, 1, 0.1, 2),
        pytest.param(4, 2, 2, 0.1, 1, marks=pytest.mark.slow),
        pytest.param(5, 3, 2, 0.1, 2, marks=pytest.mark.slow),
        pytest.param(8, 2, 3, 0.1, 1, marks=pytest.mark.slow),
    ],
)
def test_a_proved_bound_is_just_above_every_sample(seed, n, parameters, size, disturbances):
    """Never below one of 1000, within 2 % of the worst; and samples are what they should be."""
    plant, E, C, random = family(seed, n, parameters, size, disturbances)
    own, law = PeakToPeak(Output("y", "", C=C)), pf.FixedGain(np.zeros((1, n)))
    bound, alpha = best_bound(plant, law, own), weights(random, 1000, parameters)
    sampled = own.values(plant, law, alpha)
    assert sampled.max() <= bound.level <= 1.02 * sampled.max()
    A = np.tensordot(alpha[-1], np.stack([v.A for v in plant.vertices]), 1)
    assert sampled[-1] == pytest.approx(integral(A, E, C), rel=2e-3)


def test_a_disturbance_comes_as_near_to_the_bound_as_one_likes():
    """w = sign of h backwards from the end, of an oscillation and what passes through."""
    A, E, C, F = [[0, 1], [-25, -2]], [[0], [1]], [3.0, -1.0], [0.4]
    plant = pf.UncertainPlant.from_vertices([A], [[[0], [1]]], [E])
    y = Output("y", "", C=C, F=F)
    own, law = PeakToPeak(y, disturbances={"w1": 2.0}), pf.FixedGain([[0, 0]])
    bound = best_bound(plant, law, own)
    h, x, apart = [], np.array(E)[:, 0].astype(float), 1e-3
    step = expm(np.array(A) * apart)
    for _ in range(8000):
        h.append(np.array(C) @ x)
        x = step @ x
    w = 2.0 * np.sign(h[::-1])
    reached = 2.0 * 0.4 + (np.array(h[::-1]) * w).sum() * apart
    assert reached == pytest.approx(bound.level, rel=3e-3)
    assert bound.level >= own.values(plant, law, np.ones((1, 1)))[0]


@pytest.mark.parametrize("seed", range(6))
def test_no_integral_is_more_than_that_of_coefficients(seed):
    """Of Bernstein polynomials with changes of sign, and nearly it after halvings."""
    random = np.random.default_rng(seed)
    c = [int(x) for x in random.integers(-1000, 1000, size=9)]
    u = (np.arange(20000) + 0.5) / 20000
    basis = [u**0]
    for _ in range(8):  # (u + (1 - u)) times the last
        up = [np.zeros_like(u), *basis]
        basis = [a * u + b * (1 - u) for a, b in zip(up, [*basis, 0 * u], strict=True)]
    exact = np.abs(sum(x * b for x, b in zip(c, basis, strict=True))).mean()
    found = [_size(c, k) / 9 / 2.0 ** (9 * k) for k in (0, 2, HALVINGS)]
    assert found[0] >= found[1] >= found[2] >= exact * (1 - 1e-6)
    assert found[2] <= exact * 1.01


def test_parts_of_the_box_are_proved_apart():
    plant, _, C, random = family(7, 4, 2, 0.1)
    own, law = PeakToPeak(Output("y", "", C=C)), pf.FixedGain(np.zeros((1, 4)))
    worst = own.values(plant, law, weights(random, 200, 2)).max()
    assert kept_bound(plant, law, PeakToPeak(own.signal, 0.99 * worst)) is None
    found = kept_bound(plant, law, PeakToPeak(own.signal, 1.01 * worst))
    assert found is not None
    assert len(found.claim.subject.evidence.cells) > 1


@pytest.mark.parametrize(("n", "parameters", "disturbances"), [(3, 1, 2), (2, 2, 1)])
def test_floats_foresee_what_is_proved(n, parameters, disturbances):
    plant, _, C, random = family(3, n, parameters, 0.1, disturbances)
    F = random.normal(size=disturbances)
    own, law = PeakToPeak(Output("y", "", C=C, F=F)), pf.FixedGain(np.zeros((1, n)))
    claim = best_bound(plant, law, own).claim
    assert not claim.subject.evidence.cells
    size, off = map(float, claim.bound())
    seen = Foreseen.of(claim).bound(claim.following[0], claim.subject.evidence.X)
    assert seen[0] == pytest.approx(size, rel=1e-5)
    assert 0.5 * off < seen[1] < 1.1 * off < 1.1 * peak_to_peak.WARY * seen[1]


# --- slopes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_slopes_are_those_of_central_differences(seed):
    plant, E, C, random = family(seed, 4, 1, 0.1, 2)
    loop = {"A": plant.vertices[0].A, "E": E, "C": C[None], "F": 0.1 * random.normal(size=(1, 2))}
    own = PeakToPeak("y")

    def found(**moved):
        M = {**loop, **moved}
        return own.slopes(Loops(Modes(M["A"][None]), *(M[key][None] for key in "ECF")))

    first = found()
    (turned,) = first.turned()
    assert first.values[0] == pytest.approx(
        integral(loop["A"], E, C) + np.abs(loop["F"]).sum(), rel=2e-3
    )
    for key, M in loop.items():
        along, size = random.normal(size=M.shape), 1e-6
        ahead, back = (found(**{key: M + sign * size * along}).values[0] for sign in (1, -1))
        slope = float((getattr(turned, key)[0] * along).sum())
        assert (ahead - back) / 2 / size == pytest.approx(slope, rel=1e-5, abs=1e-6)


def test_a_pole_of_several_without_as_many_modes_has_slopes():
    A = np.array([[-1.0, 1, 0], [0, -1, 1], [0, 0, -1]])
    loops = Loops(Modes(A[None]), np.eye(3)[None, :, 2:], np.eye(3)[None, :1], np.zeros((1, 1, 1)))
    found = PeakToPeak("y").slopes(loops)
    assert found.values[0] == pytest.approx(1.0, rel=1e-5)  # of t^2 / 2 e^-t
    (turned,) = found.turned()
    assert turned.C[0, 0] == pytest.approx([1, 1, 1], rel=1e-3)


# --- files and commands --------------------------------------------------------------------------


def is_proved(document):
    try:
        return check(from_plain(document)).proved
    except FormatError:
        return False


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    plant, folder = loads(MASS_ON_SPRING), tmp_path_factory.mktemp("file")
    law, own = pf.FixedGain(GAIN), PeakToPeak("position", disturbances={"push": 3.0})
    worst = own.values(plant, law, np.eye(2)).max()
    limit = PeakToPeak("position", 1.005 * worst, disturbances={"push": 3.0})
    pf.analyse(plant, law, pf.parse_region("half_plane(0)"), limits=[limit]).design.save(folder)
    document = json.loads((folder / "design.json").read_text())
    assert is_proved(document)
    return document, worst


FOLLOWED = [
    ("following", lambda _: []),
    ("following", lambda x: [x[0] | {"lengths": [x[0]["lengths"][0]]}]),
    ("following", lambda x: [x[0] | {"lengths": [[10**6, 1]]}]),
    ("following", lambda x: [x[0] | {"lengths": [[0.5, 4]]}]),
    ("following", lambda x: [x[0] | {"rate": 1000}]),
    ("following", lambda x: [x[0] | {"rate": -1}]),
    ("following", lambda x: [x[0] | {"reach": 0}]),
    ("following", lambda x: [x[0] | {"reach": "1/1000000"}]),
    ("following", lambda x: [x[0] | {"terms": 2}]),
    ("following", lambda x: [x[0] | {"degree": 0}]),
    ("following", lambda x: [x[0] | {"bits": 4}]),
    ("following", lambda x: [x[0] | {"unit": 1}]),
    ("following", lambda x: [x[0], x[0]]),
    ("disturbances", lambda _: [4]),
    ("disturbances", lambda _: [0]),
]


@pytest.mark.parametrize(("key", "change"), FOLLOWED)
def test_one_fault_in_a_file_and_it_is_not_proved(document, key, change):
    table = json.loads(json.dumps(document[0]))
    claim = next(own for own in table["claims"] if own["kind"] == "peak to peak")
    claim[key] = change(claim.get(key))
    assert not is_proved(table)


def test_a_level_below_the_worst_plant_is_not_proved(document):
    table, worst = json.loads(json.dumps(document[0])), document[1]
    claim = next(own for own in table["claims"] if own["kind"] == "peak to peak")
    for level, proved in ((worst * 0.9999, False), (worst * 1.005, True)):
        claim["level"] = level
        assert is_proved(table) is proved
    claim["level"] = worst * 0.99
    assert false(table)  # and samples of another program see it


def test_a_law_is_tuned_for_a_bounded_disturbance(tmp_path, capsys):
    spec, out, said = (tmp_path / name for name in ("own.toml", "out", "said.json"))
    spec.write_text(
        MASS_ON_SPRING + '[law]\nschedule = []\n[[specification]]\nkind = "rms"\n'
        'signal = "force"\ndensity = 1\nminimise = true\n[[specification]]\nkind = "peak to peak"\n'
        'signal = "position"\ndisturbances = {push = 3}\nat_most = 0.05\n'
    )
    assert main(["optimise", str(spec), "--json", str(said), "-o", str(out)]) == 0
    rows = json.loads(said.read_text())["bounds"]
    assert [row["kind"] for row in rows] == ["rms", "peak to peak"]
    assert rows[1]["proved"] == 0.05
    assert 0.047 < rows[1]["worst sampled"] <= 0.05
    capsys.readouterr()
    assert main(["check", str(out)]) == 0
    text = capsys.readouterr().out
    assert "peak to peak of 'position' = x1 <= 0.05 from rest for all |'push' = w1| <= 3" in text


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (lambda plant: pf.at_sample_time(plant, 0.01), "are not proved at a sample time"),
        (
            lambda _: loads(MASS_ON_SPRING.replace("120]", "120]\nrate = [-1, 1]")),
            "are not proved while parameters move",
        ),
    ],
)
def test_other_plants_are_refused_in_one_line(changed, why):
    plant = changed(loads(MASS_ON_SPRING))
    with pytest.raises(InputError, match=re.escape(why)):
        best_bound(plant, pf.FixedGain(GAIN), PeakToPeak("position"))


def test_a_law_of_an_lmi_is_refused_in_one_line():
    plant = loads(MASS_ON_SPRING)
    law = pf.place(plant, pf.HalfPlane(1), method="scheduled").law
    for asked in (best_bound, kept_bound):
        with pytest.raises(
            InputError, match=r"are not proved of a law Z W\^-1; run 'polefence optimise'"
        ):
            asked(plant, law, PeakToPeak("position", 1.0))
