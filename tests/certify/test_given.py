"""Given gains: answers against poles in floats, misfits named, certificates broken."""

import json
import re

import control
import numpy as np
import pytest

from polefence import (
    Design,
    Disk,
    FixedGain,
    HalfPlane,
    InputError,
    Parameter,
    Scheduled,
    ScheduledGain,
    Sector,
    UncertainPlant,
    analyse,
    check,
    place,
    worst_case,
)
from polefence.cli.main import main
from polefence.law.laws import given_law
from polefence.plant.points import values_at
from polefence.proof import work
from polefence.proof.claims.base import prove
from support.commands import ran, refused
from support.files import poles_in

# Leite & Peres (2005), Lemma 2 at (-40, 33.6): holds for the vertices as printed, on no real car.
PUBLISHED = [[52930, 59680, -5150, 2560, 181210]]
EYE = [[[0], [1]]] * 2


def random_family(seed):
    """A plant of up to five vertices and a gain, stabilising or not."""
    random = np.random.default_rng(seed)
    n, m, N = random.integers(2, 5), random.integers(1, 3), random.integers(1, 6)
    spread = random.choice([0.05, 0.3, 0.8])
    A, B = random.normal(size=(n, n)) - 1.5 * np.eye(n), random.normal(size=(n, m))
    As = [A + spread * random.normal(size=(n, n)) for _ in range(N)]
    Bs = [B + spread * random.normal(size=(n, m)) for _ in range(N)]
    return UncertainPlant.from_vertices(As, Bs), 0.3 * random.normal(size=(m, n))


def poles(plant, K, alpha):
    A, B = plant.at(np.asarray(alpha, dtype=float))
    return np.linalg.eigvals(A + B @ K)


def dense(N, count=1000):
    random = np.random.default_rng(7)
    parts = [random.dirichlet(np.full(N, p), count) for p in (0.2, 1.0)]
    return np.vstack([np.eye(N), *parts])


@pytest.mark.parametrize("seed", range(8))
def test_random_families_on_both_sides_of_the_worst_case(seed):
    """Proved just inside the sampled worst decay rate, refuted just beyond; poles agree."""
    plant, K = random_family(seed)
    N = len(plant.vertices)
    decay = -poles(plant, K, dense(N)).real.max()
    gap = 1e-3 * abs(decay)
    inside = analyse(plant, K, HalfPlane(decay - gap))
    assert inside.answer == "proved"
    assert check(inside.design).proved
    worst = worst_case(plant, K)
    assert (
        decay - 1e-4 * abs(decay) < worst.region.decay <= worst.bound * (1 + 1e-9 * np.sign(decay))
    )
    assert worst.bound <= decay + 1e-9 * abs(decay)
    beyond = analyse(plant, K, HalfPlane(decay + gap))
    assert beyond.answer == "refuted"
    assert beyond.certificate is None
    assert sum(beyond.alpha) == 1
    assert min(beyond.alpha) >= 0
    z = poles(plant, K, [float(a) for a in beyond.alpha])
    assert z.real.max() >= -(decay + gap)
    assert np.abs(z - beyond.pole).min() < 1e-9
    with pytest.raises(InputError, match="refuted; only a proved one"):
        _ = beyond.design


@pytest.mark.parametrize("of", ["disk", "half_plane", "sector"])
@pytest.mark.parametrize("method", ["quadratic", "scheduled"])
def test_worst_cases_of_the_cars_designs_are_bracketed(physical, method, of):
    design = place(physical, Disk(-40, 36), method)
    worst = worst_case(physical, design, of, -40 if of == "disk" else None)
    grid = [
        physical.alpha(m1=m1, beta=beta)
        for m1 in np.linspace(231.12, 346.68, 13)
        for beta in np.linspace(-10, 10, 13)
    ]
    z = design.poles(np.array(grid))
    sampled = {
        "disk": np.abs(z + 40).max(),
        "half_plane": (-z.real).min(),
        "sector": (-z.real / np.abs(z)).min(),
    }[of]
    name = {"disk": "radius", "half_plane": "decay", "sector": "damping"}[of]
    value, sign = worst.region.numbers[name], 1 if of == "disk" else -1
    # proved, sampled by the package, and sampled here: within 1e-3, and in this order
    assert sign * value >= sign * worst.bound - 1e-9 * abs(value)
    assert sign * worst.bound >= sign * sampled - 1e-9 * abs(value)
    assert abs(value - sampled) < 1e-3 * abs(value)
    assert check(worst.certificate).proved
    assert set(worst.values) == {"m1", "beta"}


@pytest.mark.parametrize("method", ["slack", "scheduled", Scheduled(2, 0)])
def test_a_designs_own_law_is_proved_at_its_own_disk(as_printed, method):
    design = place(as_printed, Disk(-40, 34.5), method)
    found = analyse(as_printed, design, Disk(-40, 34.5))
    assert found.proved
    assert found.certificate.method == "lyapunov"
    alpha = np.random.default_rng(0).dirichlet(np.ones(4), 20)
    product = np.einsum("ai,aj->aij", alpha[:, :2] + alpha[:, 2:], alpha[:, ::2] + alpha[:, 1::2])
    product = product.reshape(20, 4)  # laws of degree 1 are taken on the box
    assert np.allclose(found.poles(product), design.poles(product), rtol=1e-9)


def test_the_published_gain_fails_on_the_physical_car_and_not_as_printed(physical, as_printed):
    assert analyse(as_printed, PUBLISHED, Disk(-40, 33.6)).proved
    found = analyse(physical, PUBLISHED, Disk(-40, 33.6))
    assert found.answer == "refuted"
    assert found.values == {"m1": 231.12, "beta": 10}
    A, B = physical.at(physical.alpha(**found.values))
    z = np.linalg.eigvals(A + B @ np.array(PUBLISHED))
    assert z[np.argmax(np.abs(z + 40))] == pytest.approx(found.pole)
    assert "m1 = 231.12 kg, beta = 10" in found.reason
    assert "-109.502 is not in disk(-40, 33.6)" in found.reason


def oscillator(stiffest, damping=0.5):
    """x'' + damping x' + k x = 0 with k from 1 to ``stiffest``."""
    As = [[[0, 1], [-k, -damping]] for k in (1, stiffest)]
    return UncertainPlant.from_vertices(As, EYE)


def test_degree_matters():
    """One quadratic form for all k exists only if sqrt(k2) - sqrt(k1) < damping."""
    still = [[0, 0]]
    near = analyse(oscillator(2.2), still, HalfPlane(0), budget=0)
    assert near.proved
    assert near.certificate.evidence["parts"][0]["degree"] == 0
    alone = analyse(oscillator(9), still, HalfPlane(0), budget=0)
    assert alone.answer == "undecided"
    assert "up to degree 0, elevation 0" in alone.reason
    higher = analyse(oscillator(9), still, HalfPlane(0))
    assert higher.proved
    assert higher.certificate.evidence["parts"][0]["degree"] == 1
    # the form that degree 0 lacks, independently: X = [[1, b], [b, c]] over a dense grid
    assert common(oscillator(2.2), [half_plane(0)])
    assert not common(oscillator(9), [half_plane(0)])


def half_plane(decay):
    return lambda A, X: -(A @ X + X @ A.T + 2 * decay * X)


def sector(damping):
    t = np.sqrt(1 - damping**2) / damping

    def block(A, X):
        even, odd = t * (A @ X + X @ A.T), A @ X - X @ A.T
        rows = [np.concatenate(row, axis=-1) for row in ((even, odd), (-odd, even))]
        return -np.concatenate(rows, axis=-2)

    return block


def common(plant, blocks):
    """Whether some X = [[1, b], [b, c]] of a dense grid serves every vertex and part."""
    c, b = np.meshgrid(np.geomspace(0.05, 20, 201), np.linspace(-0.99, 0.99, 201))
    b, c = (b * np.sqrt(c)).ravel(), c.ravel()
    X = np.stack([np.ones_like(b), b, b, c], axis=-1).reshape(-1, 2, 2)
    least = [np.linalg.eigvalsh(f(A, X))[:, 0] for f in blocks for A in plant.A]
    return bool((np.min(least, axis=0) > 0).any())


def test_each_part_has_its_own_evidence():
    """One X serves each part at both vertices, and none serves both: still proved at degree 0."""
    As = [[[-1.75, 0.96], [-0.25, -1.31]], [[-0.11, 0.21], [-1.08, -0.83]]]
    plant = UncertainPlant.from_vertices(As, EYE)
    parts = half_plane(0.32), sector(0.735)
    assert common(plant, parts[:1])
    assert common(plant, parts[1:])
    assert not common(plant, parts)
    found = analyse(plant, [[0, 0]], HalfPlane(0.32) & Sector(0.735), budget=0)
    assert found.proved
    one, other = found.certificate.evidence["parts"]
    assert (one["degree"], other["degree"]) == (0, 0)
    # neither matrix does for the other part
    swapped = zip(parts, (other, one), strict=True)
    least = [np.linalg.eigvalsh(f(A, e["X"][0]))[0] for f, e in swapped for A in plant.A]
    assert min(least[:2]) < 0 > min(least[2:])


def test_discrete_time():
    As = [[[1, 0.1], [0, 1]], [[1, 0.1], [-0.2, 1]]]
    plant = UncertainPlant.from_vertices(As, [[[0], [0.1]]] * 2, sample_time=0.1)
    K = [[-2, -3]]
    worst = worst_case(plant, K, "disk", 0.8)
    z = poles(plant, K, dense(2))
    assert np.abs(z - 0.8).max() <= worst.region.radius < np.abs(z - 0.8).max() * 1.001
    assert analyse(plant, K, worst.region).proved
    smaller = analyse(plant, K, Disk(0.8, 0.99 * worst.bound))
    assert smaller.answer == "refuted"
    decay = -np.log(np.abs(z).max()) / 0.1
    assert analyse(plant, K, HalfPlane(0.99 * decay)).proved
    assert analyse(plant, K, HalfPlane(1.01 * decay)).answer == "refuted"
    with pytest.raises(InputError, match="is in discrete time, where half_plane has no direct"):
        worst_case(plant, K)
    # poles beyond the unit circle: nothing to prove, and no error
    lost = worst_case(plant, [[40, 3]], "disk", 0.8)
    assert lost.region is None
    assert lost.bound > 0.2
    # all poles at zero: a dead beat
    double = UncertainPlant.from_vertices([[[1, 0.1], [0, 1]]], [[[0.005], [0.1]]], sample_time=0.1)
    assert analyse(double, [[-100, -15]], Disk(0, 0.01)).proved


def test_poles_on_the_boundary_are_refuted_exactly():
    plant = UncertainPlant.from_vertices([[[0, 1], [-1, 0]]], [[[0], [1]]])
    assert analyse(plant, [[0, -2]], HalfPlane(1)).answer == "refuted"  # a double pole at -1
    assert analyse(plant, [[0, -2]], HalfPlane(0.99)).proved
    worst = worst_case(plant, [[0, -2]], "sector")
    assert worst.region.damping == pytest.approx(1, abs=1e-4)
    assert worst_case(plant, [[0, 0]], "sector").region is None


def test_a_law_that_is_singular_somewhere_is_refuted():
    A, B = [[[-1]]] * 2, [[[1]], [[1]]]
    plant = UncertainPlant.from_vertices(A, B)
    law = ScheduledGain(np.array([[[1.0]], [[-1.0]]]), np.array([[[0.5]], [[0.5]]]))
    found = analyse(plant, law, HalfPlane(0.1))
    assert found.answer == "refuted"


def test_values_belong_to_alpha_exactly_where_it_is_a_product(physical):
    plant = UncertainPlant.from_expressions(
        [Parameter("p", -4, -1, "kg", "1/p"), Parameter("q", 1, 3)], [["q/p"]], [[1]]
    )
    for p, q in ((-4, 1), (-1, 3), (-2.5, 1.75)):
        found = values_at(plant, plant.alpha(p=p, q=q))
        assert found == pytest.approx({"p": p, "q": q})
    assert values_at(plant, [0.5, 0, 0, 0.5]) is None
    assert values_at(oscillator(2), [0.5, 0.5]) is None


def test_a_counterexample_that_no_parameters_have_says_so(physical):
    """Degree 2 on the simplex: there the whole simplex is asked about."""
    design = place(physical, Disk(-40, 33), Scheduled(2, 1))
    z = design.poles(dense(4))
    radius = np.abs(z + 40).max()
    grid = [physical.alpha(m1=m, beta=b) for m in (231.12, 280, 346.68) for b in (-10, 0, 10)]
    assert np.abs(design.poles(np.array(grid)) + 40).max() <= radius
    found = analyse(physical, design, Disk(-40, 0.9999 * radius))
    assert found.answer == "refuted"
    assert (found.values is None) == ("no parameter values have" in found.reason)


def test_python_control_gains(physical):
    system = control.ss(physical.A[0], physical.B[0], np.eye(5), np.zeros((5, 1)))
    K, _, _ = control.lqr(system, 10 * np.diag([1e4, 1e3, 1, 1, 1e6]), [[1e-4]])
    region = HalfPlane(3)
    ours = analyse(physical, -K, region)
    assert ours.proved
    static = analyse(physical, control.ss([], [], [], -K), region)
    assert static.proved
    assert np.array_equal(static.law.K, -K)
    assert analyse(physical, K, region).answer == "refuted"  # the sign of u = -K x
    with pytest.raises(InputError, match="the law measures 1 signal"):
        analyse(physical, control.tf([1], [1, 1]), region)


@pytest.mark.parametrize(
    ("gain", "message"),
    [
        ([[1, 2, 3]], "gain is 1 x 3; quarter car, physical needs 1 x 5"),
        (np.ones((5, 1)), "gain is 5 x 1"),
        ([1, 2, 3, 4, 5], "must be 1 x 5 finite numbers, a list of rows"),
        ([[1, 2, 3, 4, float("nan")]], "finite numbers"),
        ([[1, 2, 3, 4, float("inf")]], "finite numbers"),
        ([[1, 2, 3, 4, 10**400]], "finite numbers"),
        ([[1, 2], [3]], "finite numbers"),
        ("law.json", "unknown name 'law' in the law; known are the parameters"),
        (None, "finite numbers"),
        (FixedGain(np.ones((2, 5))), "gain is 2 x 5"),
        (ScheduledGain(np.ones((3, 5, 5)), np.ones((3, 1, 5))), "has 3 vertices; .* has 4"),
        (ScheduledGain(np.ones((4, 4, 4)), np.ones((4, 1, 4))), "gain is 1 x 4"),
    ],
)
def test_gains_that_do_not_fit(physical, gain, message):
    for call in (lambda: analyse(physical, gain, HalfPlane(1)), lambda: worst_case(physical, gain)):
        with pytest.raises(InputError, match=message) as no:
            call()
        assert "\n" not in str(no.value)


def test_a_law_of_other_parameters_is_refused(physical):
    design = place(physical, Disk(-40, 31))
    assert analyse(physical, design, Disk(-40, 31)).proved
    heavier = Parameter("m1", 232, 346.68, "kg", "1/m1")
    other = UncertainPlant(physical.vertices, (heavier, physical.parameters[1]))
    with pytest.raises(InputError, match="parameters, or their ranges, are not those of plant"):
        given_law(other, design)


def test_questions_that_are_incomplete(physical):
    for call, message in (
        (lambda: worst_case(physical, PUBLISHED, "disk"), "needs a centre"),
        (lambda: worst_case(physical, PUBLISHED, "sector", -40), "needs a centre"),
        (lambda: worst_case(physical, PUBLISHED, "ellipse"), "'ellipse' is unknown"),
        (lambda: worst_case(physical, PUBLISHED, "disk", 40), "left half-plane"),
        (lambda: analyse("car.toml", PUBLISHED, HalfPlane(1)), "must be of type UncertainPlant"),
        (lambda: analyse(physical, PUBLISHED, (-40, 31)), "must be of type Region"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_an_answer_is_shown(physical):
    found = analyse(physical, PUBLISHED, HalfPlane(4))
    assert repr(found) == "<Analysis of 'quarter car, physical': half_plane(4), proved>"
    assert found.values is None
    assert "sampled>" in repr(worst_case(physical, PUBLISHED))


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A proved analysis of two parts, of degree 1 in one of them, as a file."""
    found = analyse(oscillator(9), [[0, 0]], HalfPlane(0.24) & Sector(0.08))
    return json.loads(found.design.save(tmp_path_factory.mktemp("analysis")).read_text())


MUTATIONS = {
    "decay": lambda d: d["claims"][0]["region"]["parts"][0].update(decay=0.26),
    "damping": lambda d: d["claims"][0]["region"]["parts"][1].update(Sector(0.2).document()),
    "K": lambda d: d["law"]["K"][0].__setitem__(1, 0.5),
    "A": lambda d: d["plant"]["vertices"][1]["A"][1].__setitem__(1, 0.5),
    "X": lambda d: d["claims"][0]["evidence"]["parts"][0]["X"][0][0].__setitem__(0, -1),
    "asymmetric": lambda d: d["claims"][0]["evidence"]["parts"][0]["X"][0][0].__setitem__(1, 9),
    "swapped": lambda d: d["claims"][0]["evidence"]["parts"].reverse(),
    "degree": lambda d: d["claims"][0]["evidence"]["parts"][0].update(degree=2),
    "elevation": lambda d: d["claims"][0]["evidence"]["parts"][0].update(elevation=-1),
    "missing part": lambda d: d["claims"][0]["evidence"]["parts"].pop(),
    "extra part": lambda d: d["claims"][0]["evidence"]["parts"].append(
        d["claims"][0]["evidence"]["parts"][0]
    ),
    "extra key": lambda d: d["claims"][0]["evidence"].update(W=[[1]]),
    "key of a part": lambda d: d["claims"][0]["evidence"]["parts"][0].update(tau=1),
    "multiple": lambda d: d["claims"][0]["evidence"]["parts"][0].update(multiple=[1, 1]),
    "method": lambda d: d.update(method="quadratic"),
    "domain": lambda d: d["claims"][0]["evidence"].update(on="ball"),
    "nan": lambda d: d["claims"][0]["evidence"]["parts"][0]["X"][0][0].__setitem__(0, float("nan")),
}


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_certificate_with_one_fault_is_refused(saved, name):
    text = json.dumps(saved)
    claim = poles_in(text)
    assert prove(claim).proved
    broken = json.loads(text)
    MUTATIONS[name](broken)
    try:
        claim = poles_in(json.dumps(broken))
        proved = prove(claim).proved
    except work.FormatError:
        proved = False
    assert not proved


def test_evidence_about_a_scheduled_law_with_one_fault_is_refused():
    design = place(oscillator(2.2), Disk(-2, 1.5), "scheduled")
    found = analyse(oscillator(2.2), design, Disk(-2, 1.5))
    text = found.certificate.dumps()
    assert prove(poles_in(text)).proved
    for keys, change in (
        (("law", "Z", 0, 0, 0), lambda z: z + 10),
        (("law", "W", 1, 0, 0), lambda w: -w),
        (("claims", 0, "evidence", "parts", 0, "multiple", 0), lambda s: s - 100),
        (("claims", 0, "evidence", "parts", 0, "X", 0, 0, 0), lambda x: x - 1e3),
        (("claims", 0, "evidence", "parts", 0, "X", 0, 0, 1), lambda x: x + 1),
        (("claims", 0, "region", "radius"), lambda r: r / 3),
    ):
        broken = json.loads(text)
        place_of = broken
        for key in keys[:-1]:
            place_of = place_of[key]
        place_of[keys[-1]] = change(place_of[keys[-1]])
        assert not prove(poles_in(json.dumps(broken))).proved, keys


@pytest.fixture
def car_spec(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car.toml").write_text(ran(capsys, "example", "quarter-car-physical"))
    return tmp_path


def test_the_command_answers(car_spec, capsys):
    gain = ["analyse", "car.toml", "--gain", json.dumps(PUBLISHED)]
    results = ["--json", "answer.json", "-o", "car"]
    first = [*gain, "--region", "disk(-40, 33.6)", "--plot", "poles.png"]
    assert main([*first, *results]) == 1
    out, err = capsys.readouterr()
    assert out.startswith("refuted: at m1 = 231.12 kg, beta = 10")
    assert "not saved" in out
    assert not err
    answer = json.loads((car_spec / "answer.json").read_text())
    assert (answer["answer"], answer["alpha"]) == ("refuted", ["0", "1", "0", "0"])
    assert answer["values"] == {"m1": 231.12, "beta": 10}
    assert answer["pole"] == pytest.approx([-109.5015, 0], abs=1e-4)
    assert not (car_spec / "car").exists()
    assert (car_spec / "poles.png").read_bytes().startswith(b"\x89PNG")
    assert main([*gain, "--region", "disk(-40, 69.6)", *results]) == 0
    assert capsys.readouterr().out.startswith("proved: all poles of")
    assert main(["check", "car", "--spec", "car.toml"]) == 0
    assert Design.load("car").method == "lyapunov"
    # a saved design's law is a gain as well, by its file and by its folder
    for what in ("car", "car/design.json"):
        assert main(["analyse", "car.toml", "--gain", what, "--region", "half_plane(4)"]) == 0
    capsys.readouterr()
    assert main([*gain, "--of", "disk", "--centre", "-40", *results]) == 0
    proved, sampled, *saved = capsys.readouterr().out.splitlines()
    assert saved == ["saved: car/design.json", "saved: answer.json"]
    assert proved.startswith("proved: radius 69.50")
    assert sampled.startswith("sampled: radius 69.50")
    worst = json.loads((car_spec / "answer.json").read_text())
    assert worst["proved"] >= worst["sampled"] == pytest.approx(69.5015, abs=1e-4)
    unstable = ["analyse", "car.toml", "--gain", "[[0, 0, 1e5, 0, 0]]", "--of"]
    assert main([*unstable, "sector", "--json", "answer.json"]) == 1
    assert "undecided: no damping ratio" in capsys.readouterr().out
    assert json.loads((car_spec / "answer.json").read_text())["proved"] is None
    assert "does not stabilise" in ran(capsys, *unstable, "half-plane")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--gain", "[[1, 2"], "not valid JSON"),
        (["--gain", "[[NaN, 0, 0, 0, 0]]"], "NaN is not a finite number"),
        (["--gain", "[[1e999, 0, 0, 0, 0]]"], "finite numbers"),
        (["--gain", "[" * 5000], "not valid JSON"),
        (["--gain", "[[1, 2, 3]]"], "1 x 3"),
        (["--gain", "[" + " " * 200000 + "]"], "write a file"),
        (["--gain", "none.json"], "none.json: cannot be read"),
        (["--gain", "bad.json"], "bad.json: .*grid"),
        (["--gain", "design.json"], "design.json: .*is missing"),
        (["--gain", "car.toml"], "car.toml: not valid JSON"),
        (["--of", "disk"], "--of disk needs --centre"),
        (["--of", "sector", "--centre", "-4"], "other --of take none"),
        (["--budget", "-1"], "zero or more"),
        (["--plot", "poles.txt"], "ends in .png"),
        (["--limit", "gain"], "--limit"),
        (["--of", "sector", "--limit", "gain of x1"], "leave --limit and --lyapunov out"),
        (["--region", "disk(-40)"], "takes 2 numbers"),
        (["--json", "a.json", "--plot", "a.json/b.png"], "cannot be written|Not a directory"),
    ],
)
def test_bad_input_is_one_line(car_spec, capsys, arguments, message):
    (car_spec / "bad.json").write_text('{"gain": [[1, 2, 3, 4, 5]]}')
    (car_spec / "design.json").write_text('{"format": "polefence-proof", "version": 2}')
    (car_spec / "a.json").write_text("")
    gain = [] if "--gain" in arguments else ["--gain", json.dumps(PUBLISHED)]
    assert re.search(message, refused(capsys, "analyse", "car.toml", *gain, *arguments))
