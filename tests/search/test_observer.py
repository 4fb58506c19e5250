"""Observers by duality: poles against numpy, the car with and without its integral, separation."""

import doctest
import importlib.util
import json
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import polefence.search.observer as module
from polefence import (
    METHODS,
    Design,
    DesignFileError,
    Disk,
    InputError,
    NotProvedError,
    Parameter,
    Scheduled,
    UncertainPlant,
    check,
    load,
    observe,
    place,
)
from polefence.base.errors import ParameterValueError, UnobservableError
from polefence.cli.main import main
from polefence.examples import family, spec_path
from polefence.region.regions import HalfPlane, Sector
from polefence.search.observer import Observer
from support.commands import ran, refused
from support.files import rewritten
from support.paths import DOCS

SENSORS = (
    "suspension deflection",
    "sprung-mass velocity",
    "integral of suspension deflection [m s]",
)
OTHER_THIRD = (Fraction(1, 3), Fraction(1, 3), Fraction(1, 3), Fraction(0))


@pytest.fixture(scope="module")
def car() -> UncertainPlant:
    return family("quarter-car-physical")


@pytest.fixture(scope="module")
def car_observer(car) -> Observer:
    return observe(car, SENSORS, Disk(-80, 30))  # fixed gains reach 39.7 at the least


@pytest.fixture(scope="module")
def car_feedback(car) -> Design:
    return place(car, Disk(-40, 31))


def error_matrices(plant, observer, C, alpha):
    """A - L C from the plant's vertices and the C that was asked for; no dual, no design."""
    A = np.tensordot(alpha, np.stack([v.A for v in plant.vertices]), 1)
    return A - observer.gain(alpha) @ np.tensordot(alpha, C, 1)


@given(
    st.integers(0, 10_000), st.sampled_from(["quadratic", "slack", "scheduled"]), st.integers(1, 2)
)
@settings(max_examples=12)
def test_the_poles_of_a_random_family_stay_in_the_region(seed, method, p):
    random = np.random.default_rng(seed)
    A, C = random.normal(size=(3, 3)), random.normal(size=(p, 3))
    As = A + 0.1 * random.normal(size=(3, 3, 3))
    Cs = C + 0.1 * random.normal(size=(3, p, 3))
    plant = UncertainPlant.from_vertices(As, random.normal(size=(3, 3, 1)))
    observer = observe(plant, Cs, centre=-4, method=method)
    assert check(observer.design).proved
    assert np.array_equal(observer.C, Cs)
    alpha = np.vstack([np.eye(3), random.dirichlet(np.ones(3), 200)])
    z = np.linalg.eigvals(error_matrices(plant, observer, Cs, alpha))
    assert np.all(np.abs(z + 4) < observer.region.radius)
    # L is no idle number: without it, or with its sign turned, poles are elsewhere
    turned = np.linalg.eigvals(
        plant.at(alpha)[0] + observer.gain(alpha) @ np.tensordot(alpha, Cs, 1)
    )
    assert np.abs(turned + 4).max() > observer.region.radius


def test_a_rate_measured_through_the_parameters_is_a_C_for_each_vertex():
    """An accelerometer's row of C is the row of A, and varies with the load."""
    plant = UncertainPlant.from_expressions(
        [Parameter("k", 1, 4)],
        A=[[0, 1], ["-k", "-k/5"]],
        B=[[0], [1]],
        states=("x [m]", "v [m/s]"),
    )
    Cs = [[v.exact_A[1]] for v in plant.vertices]
    observer = observe(plant, Cs, HalfPlane(1) & Sector(0.3))
    assert observer.exact_C == tuple(tuple(C) for C in Cs)
    assert observer.exact_C[0][0][1] == Fraction(-1, 5)  # exactly, no double
    alpha = np.random.default_rng(0).dirichlet(np.ones(2), 300)
    floats = np.array(Cs, dtype=float)
    assert observer.region.contains(
        np.linalg.eigvals(error_matrices(plant, observer, floats, alpha))
    )
    L = observer.gain_at(k=2)
    assert np.array_equal(L, observer.gain(plant.alpha(k=2)))
    assert L.shape == (2, 1)


@pytest.mark.parametrize("method", ["quadratic", "slack", "scheduled", Scheduled(1, 1, "box")])
def test_the_car_is_observed_from_deflection_its_integral_and_one_velocity(car, method):
    fixed = method in ("quadratic", "slack")
    disk = Disk(-80, 60 if fixed else 30)
    observer = observe(car, SENSORS, disk, method)
    assert check(observer.design).proved
    alpha = np.random.default_rng(1).dirichlet(np.ones(4), 500)
    if method == Scheduled(1, 1, "box"):  # there alpha is a product
        alpha = np.array([car.alpha(m1=m, beta=b) for m in (232, 300, 346) for b in (-10, 3, 9)])
    C = np.eye(5)[[0, 2, 4]]
    z = np.linalg.eigvals(error_matrices(car, observer, np.stack([C] * 4), alpha))
    assert np.all(np.abs(z + 80) < disk.radius)
    assert observer.design.plant.inputs == tuple(car.states[i] for i in (0, 2, 4))
    assert np.allclose(observer.gain(alpha[0]), observer.gain(alpha[-1]), rtol=1e-12) == fixed
    if fixed:
        assert observer.gain().shape == (5, 3)


def test_without_the_integral_the_car_is_not_even_detectable(car):
    with pytest.raises(UnobservableError) as no:
        observe(car, SENSORS[:2], Disk(-80, 60))
    text = str(no.value)
    for part in (
        "quarter car, physical, vertex 1",
        "'suspension deflection [m]' and 'sprung-mass velocity [m/s]'",
        "4 of 5 state dimensions",
        "the eigenvalue 0,",
        "not even detectable",
        "for example also 'integral of suspension deflection [m s]'",
    ):
        assert part in text
    # what it says, in floats: no L moves the zero eigenvalue
    random = np.random.default_rng(2)
    for _ in range(5):
        A = car.at(np.eye(4)[0])[0] - random.normal(size=(5, 2)) @ np.eye(5)[[0, 2]]
        assert np.abs(np.linalg.eigvals(A)).min() < 1e-10
    assert len(observe(car, [*SENSORS[:2], SENSORS[2]], centre=-80).gain(np.eye(4)[0])) == 5


@pytest.mark.parametrize(
    ("A", "sample_time", "words"),
    [
        ([[-1, 0], [0, -2]], None, ("the eigenvalue -2,", "detectable only")),
        ([[-1, 0], [0, 2]], None, ("the eigenvalue 2,", "not even detectable")),
        ([["1/2", 0], [0, "-9/10"]], 1, ("the eigenvalue -0.9,", "detectable only")),
        ([["1/2", 0], [0, -1]], 1, ("the eigenvalue -1,", "not even detectable")),
        (
            [[-1, 0, 0], [0, -2, 3], [0, -3, -2]],
            None,
            ("1 of 3", "eigenvalues -2 +- 3j", "detectable only"),
        ),
    ],
)
def test_what_is_not_seen_is_said_to_be_detectable_or_not(A, sample_time, words):
    n = len(A)
    plant = UncertainPlant.from_vertices([A], [[[1]] * n], sample_time=sample_time)
    with pytest.raises(UnobservableError) as no:
        observe(plant, [[1] + [0] * (n - 1)], Disk(-0.2, 0.1))
    for part in (*words, f"sees 1 of {n}", "also 'x2'"):
        assert part in str(no.value)


def test_one_vertex_is_enough_to_be_refused_and_the_worst_is_named():
    stable, unstable, seen = [[-1, 0], [0, -2]], [[-1, 0], [0, 3]], [[-1, 1], [0, 3]]
    for As, name in (([seen, stable], "vertex 2"), ([stable, seen, unstable], "vertex 3")):
        plant = UncertainPlant.from_vertices(As, [[[1], [1]]] * len(As))
        with pytest.raises(UnobservableError, match=name):
            observe(plant, [[1, 0]], Disk(-6, 3))
    assert issubclass(UnobservableError, InputError)


def test_no_single_state_helps_where_two_are_missing():
    plant = UncertainPlant.from_vertices([np.diag([-1, -2, -3])], [[[1]] * 3])
    with pytest.raises(UnobservableError, match=r"measure more$"):
        observe(plant, [[1, 0, 0]], Disk(-6, 2))


def test_in_discrete_time_the_observer_is_discrete():
    As = [[[1, "1/10"], [0, 1]], [[1, "1/10"], ["-1/5", 1]]]
    plant = UncertainPlant.from_vertices(As, [[[0], ["1/10"]]] * 2, sample_time=Fraction(1, 10))
    observer = observe(plant, [[1, 0]], Disk(0.3, 0.4))
    assert observer.design.plant.sample_time == Fraction(1, 10)
    loop = observer.feedback(place(plant, Disk(0.6, 0.35)))
    alpha = np.random.default_rng(3).dirichlet(np.ones(2), 200)
    assert Disk(0.3, 0.4).contains(observer.poles(alpha))
    assert np.abs(loop.poles(alpha)).max() < 1
    assert loop.separation(alpha) < 1e-6
    # the difference equation itself: the error dies out
    Ac, Bc, Cc = loop.compensator(alpha[0])
    A, B = plant.at(alpha[0])
    x, xc = np.array([1.0, -2.0]), np.zeros(2)
    for _ in range(150):
        u, y = Cc @ xc, x[:1]
        x, xc = A @ x + B @ u, Ac @ xc + Bc @ y
    assert np.linalg.norm(x - xc) < 1e-9
    assert np.linalg.norm(x) < 1e-2
    with pytest.raises(InputError, match="discrete-time"):
        observe(plant, [[1, 0]], Disk(4, 3))


def test_the_loop_keeps_both_sets_of_poles_to_rounding(car_observer, car_feedback):
    """Separation at 1e-6 over the polytope, from the assembled 10 x 10 matrix."""
    loop = car_observer.feedback(car_feedback)
    alpha = np.vstack([np.eye(4), np.random.default_rng(4).dirichlet(np.ones(4), 500)])
    assert loop.separation(alpha) < 1e-6
    assert loop.separation([0.25] * 4) < 1e-6
    z = loop.poles(alpha)
    assert z.shape == (504, 10)
    assert np.all((np.abs(z + 40) < 31) | (np.abs(z + 80) < 30))
    Ac, Bc, Cc = loop.compensator(alpha)
    assert (Ac.shape, Bc.shape, Cc.shape) == ((504, 5, 5), (504, 5, 3), (504, 1, 5))
    one = loop.compensator(alpha[7])
    assert all(np.allclose(a, b[7], rtol=1e-12) for a, b in zip(one, (Ac, Bc, Cc), strict=True))


def test_the_loop_is_exactly_block_triangular(car_observer, car_feedback):
    loop = car_observer.feedback(car_feedback)
    for alpha in ((1, 0, 0, 0), OTHER_THIRD, [Fraction(k, 10) for k in (1, 2, 3, 4)]):
        assert loop.separates(alpha)


@pytest.mark.parametrize("fault", ["B", "sign", "C"])
def test_a_fault_in_the_compensator_is_seen_both_ways(
    car_observer, car_feedback, monkeypatch, fault
):
    """One fault at a time in the assembly: separation and the exact check must notice."""

    def wrong(A, B, C, K, L):
        Ac = {
            "B": lambda: A - L @ C,
            "sign": lambda: A + B @ K + L @ C,
            "C": lambda: A + B @ K - L @ C * 2,
        }[fault]()
        return Ac, L, K

    monkeypatch.setattr(module, "_compensator", wrong)
    loop = car_observer.feedback(car_feedback)
    assert loop.separation([0.25] * 4) > 1e-3
    assert not loop.separates(OTHER_THIRD)


def test_the_smallest_disk_about_a_centre(car):
    observer = observe(car, SENSORS, centre=-80, method="slack")
    assert check(observer.design).proved
    r = observer.region.radius
    with pytest.raises(NotProvedError) as no:
        observe(car, SENSORS, Disk(-80, 0.99 * r), "slack")
    best = no.value.best
    assert isinstance(best, Observer)
    assert best.region.radius == pytest.approx(r, rel=1e-4)
    assert best.region.contains(best.poles(np.eye(4)))


def test_an_observer_survives_its_file(car, car_observer, tmp_path):
    path = car_observer.save(tmp_path)
    assert check(tmp_path).proved
    document = json.loads(path.read_text())
    assert document["plant"]["name"] == "quarter car, physical"
    assert document["plant"]["states"] == list(car.states)
    again = Observer.load(path, car, SENSORS)
    alpha = np.random.default_rng(5).dirichlet(np.ones(4), 3)
    assert np.array_equal(again.gain(alpha), car_observer.gain(alpha))
    assert np.array_equal(again.gain_at(m1=300, beta=2), car_observer.gain_at(m1=300, beta=2))


def _numbers(value, path=()):
    """Every number of a document, by its path."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _numbers(each, (*path, key))
    elif isinstance(value, list):
        for i, each in enumerate(value):
            yield from _numbers(each, (*path, i))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, value


def test_a_file_with_one_number_changed_is_refused_or_another_observer(car, car_observer, tmp_path):
    """No changed number passes unseen: not proved, other plant or sensors, other L or region."""
    path = car_observer.save(tmp_path)
    with rewritten(path) as document:
        for key in ("outputs", "vehicle"):  # which say of the vertices what they are
            del document["plant"][key]
    # no observer's claim is about B and E
    numbers = [p for p in _numbers(document) if p[0][0] != "version"]
    places = [p for p in numbers if not {"B", "E"} & {*p[0]}]
    chosen = np.random.default_rng(6).choice(len(places), 40, replace=False)
    wanted = [
        i for i, (p, _) in enumerate(places) if p[0] == "claims" and {"region", "evidence"} & {*p}
    ]
    outcomes = set()
    for index in {*chosen.tolist(), *wanted}:
        keys, value = places[index]
        mutated = json.loads(path.read_text())
        inner = mutated
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = value * 1.25 + 0.5
        (tmp_path / "mutated.json").write_text(json.dumps(mutated))
        try:
            other = Observer.load(tmp_path / "mutated.json", car, SENSORS)
        except (NotProvedError, InputError) as error:
            outcomes.add(type(error).__name__)
            continue
        corners = np.eye(4)
        same = np.array_equal(other.gain(corners), car_observer.gain(corners))
        assert not same or other.region != car_observer.region, keys
        outcomes.add("another")
    assert {"NotProvedError", "InputError"} <= outcomes


@pytest.mark.parametrize("place_of", [("A", "not an observer's"), ("C", "other measurements")])
def test_a_proved_file_of_other_matrices_is_refused(car, car_observer, tmp_path, place_of):
    """Changed so little that the proof still holds: then it is about something else."""
    letter, message = place_of
    path = car_observer.save(tmp_path)
    with rewritten(path) as document:
        for key in ("outputs", "vehicle"):  # which say of the vertices what they are
            del document["plant"][key]
        (claim,) = document["claims"]
        entry = claim["C"][0] if letter == "C" else document["plant"]["vertices"][2][letter]
        i, j = next((i, j) for i, row in enumerate(entry) for j, e in enumerate(row) if e == 1)
        entry[i][j] = 1.0000001
    assert check(path).proved
    with pytest.raises(InputError, match=f"{path}: .*{message}"):
        Observer.load(path, car, SENSORS)


def test_a_state_feedback_is_no_observer(car, car_feedback, car_observer, tmp_path):
    with pytest.raises(InputError, match="a law, not an observer"):
        Observer(car, car_feedback)
    with pytest.raises(InputError, match="a law, not an observer"):
        Observer.load(car_feedback.save(tmp_path), car, SENSORS)
    with pytest.raises(InputError, match="other measurements"):
        Observer.load(car_observer.save(tmp_path), car, ["integral of suspension deflection"])
    with pytest.raises(DesignFileError, match="cannot be read"):
        Observer.load(tmp_path / "none.json", car, SENSORS)


def test_another_plants_feedback_is_refused(car_observer, placed):
    with pytest.raises(InputError, match="another plant .quarter car, as printed"):
        car_observer.feedback(placed)
    with pytest.raises(InputError, match="takes a Design, not str"):
        car_observer.feedback("car/design.json")
    # the same vertices under other parameter ranges mean another alpha
    parts = [Parameter("p", 1, 2)], [[0, 1], ["-p", 0]], [[0], [1]]
    plant = UncertainPlant.from_expressions(*parts)
    other = UncertainPlant(plant.vertices, (Parameter("p", 1, 3),))
    assert plant.digest == other.digest
    observer = observe(plant, [[1, 0]], Disk(-4, 3))
    with pytest.raises(InputError, match="another plant"):
        observer.feedback(place(other, Disk(-4, 3.5)))


@pytest.mark.parametrize(
    ("measured", "message"),
    [
        (["suspension deflektion"], "unknown signal 'suspension deflektion'; did you mean 'susp"),
        (["suspension deflection [mm]"], "unknown signal"),
        (["suspension deflection", "suspension deflection [m]"], "named twice"),
        (["suspension deflection", [0, 0, 0, 0, 1]], "among names"),
        ([], "names nothing"),
        (None, "names nothing"),
        (np.array(1.0), "names nothing"),
        ([[np.array(1.0), 0, 0, 0, 0]], r"C\[1\]\[1\]"),
        ([1, 0, 0, 0, 0], "not a list of rows"),
        ([[1, 0, 0, 0]], "C has 4 columns"),
        ([[1, 0, 0, 0, 0], [1, 0]], "ragged"),
        ([[0, 0, 0, 0, 0]], "C is zero"),
        ([[1, 0, 0, 0, float("nan")]], r"C\[1\]\[5\]"),
        ([[1, 0, 0, 0, "one"]], r"C\[1\]\[5\]"),
        (np.ones((3, 1, 5)), "3 matrices C"),
        ([[[1, 0, 0, 0, 0]]] * 3 + [[[0] * 5]], "C of vertex 4 is zero"),
        ([[[1, 0, 0, 0, 0]]] * 3 + [[[1] * 5] * 2], "C of vertex 4 has 2 rows"),
        ([[]], "empty"),
    ],
)
def test_what_cannot_be_measured_is_named(car, measured, message):
    with pytest.raises(InputError, match=message) as no:
        observe(car, measured, Disk(-80, 60))
    assert "\n" not in str(no.value)


def test_other_misuse_is_named(car, car_observer):
    nameless = UncertainPlant.from_vertices([[[-1]]], [[[1]]])
    twins = UncertainPlant.from_vertices(
        [[[-1, 0], [0, -1]]], [[[1], [1]]], states=("x [m]", "x [ft]")
    )
    for call, message in (
        (lambda: observe("car.toml", SENSORS, Disk(-80, 60)), "must be of type UncertainPlant"),
        (lambda: observe(car, SENSORS), "region, or a centre"),
        (lambda: observe(car, SENSORS, Disk(-80, 60), centre=-80), "region, or a centre"),
        (lambda: observe(car, SENSORS, (-80, 60)), "must be of type Region"),
        (lambda: observe(car, SENSORS, Disk(-80, 60), "kalman"), "kalman"),
        (lambda: observe(nameless, "x", Disk(-3, 1)), "did you mean 'x1'"),
        (lambda: observe(twins, "x", Disk(-3, 1)), "names 2 signals"),
        (lambda: observe(nameless, [[1]], Disk(-3, 1), Scheduled(1, 1, "box")), "parameters"),
        (lambda: car_observer.gain(), "alpha must be 4"),
        (lambda: car_observer.poles([1, 0, 0]), "alpha must be 4"),
        (lambda: car_observer.gain_at(m1=300), "missing: beta"),
    ):
        with pytest.raises(InputError, match=message):
            call()
    with pytest.raises(ParameterValueError, match="off the simplex"):
        car_observer.gain([0.5, 0.6, 0, 0])
    assert car_observer.gain([0.5, 0.6, 0, 0], clamp=True).shape == (5, 3)
    assert "proved" in repr(car_observer)


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("example", DOCS / "examples" / "observer.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    return example


@pytest.fixture(scope="module")
def servo_designs(example):
    return example.designs()


def test_the_servo_is_the_published_one():
    """The published poles of the position servomechanism: 0, -9.79, -0.705 +- 7.31j."""
    servo = load(spec_path("servo"))
    z = np.sort_complex(np.linalg.eigvals(servo.at(servo.alpha(JL=25))[0]))
    assert np.allclose(z, [-9.79, -0.705 - 7.31j, -0.705 + 7.31j, 0], atol=6e-3)


def test_the_page_says_what_the_example_does(example, servo_designs, tmp_path, capsys, monkeypatch):
    page = (DOCS / "observers.md").read_text()
    feedback, observer = servo_designs
    monkeypatch.setattr(example, "designs", lambda: servo_designs)
    example.main(tmp_path)
    out = capsys.readouterr().out
    picture = (tmp_path / "observer.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 20_000
    for line in out.splitlines()[:2]:
        assert line in page
    assert check(feedback).proved
    assert check(observer.design).proved
    loads = np.linspace(12.5, 50, 200)
    alpha = np.array([observer.plant.alpha(JL=inertia) for inertia in loads])
    assert Disk(-20, 14).contains(observer.poles(alpha))
    assert Disk(-6, 5).contains(feedback.poles(alpha))
    bound = float(re.search(r"agree to\s+([\d.e-]+)", page)[1])
    assert observer.feedback(feedback).separation(alpha) < bound <= 1e-6
    late = float(re.search(r"after (0\.\d+) s", page)[1]) <= example.SECONDS
    limit = float(re.search(r"below (\d+) mrad", page)[1])
    for inertia in example.LOADS:
        error = 1000 * example.twist_error(feedback, observer, inertia)
        assert error[0] == pytest.approx(50)
        assert np.abs(error[late]).max() < limit
    # told the wrong load, the loop is unstable where state feedback alone would not be
    assert "is unstable" in page
    assert example.mistaken(feedback, observer, 50, 25).real.max() > 0
    A, B = observer.plant.at(observer.plant.alpha(JL=50))
    K = feedback.law.gain_at(JL=25)
    assert np.linalg.eigvals(A + B @ K).real.max() < -1


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # its last folder
def test_the_page_does_what_it_shows(monkeypatch):
    monkeypatch.chdir(DOCS.parent)
    result = doctest.testfile(
        str(DOCS / "observers.md"), module_relative=False, optionflags=doctest.ELLIPSIS
    )
    assert result.attempted > 7
    assert result.failed == 0


def test_the_pages_table_of_radii(car):
    page = (DOCS / "observers.md").read_text()
    for line, sensors in (("suspension deflection, its", SENSORS[::2]), ("these and", SENSORS)):
        row = re.search(rf"^\| {line}.*\|", page, re.MULTILINE)[0]
        for method, text in zip(METHODS, row.split("|")[2:-1], strict=True):
            r = observe(car, sensors, centre=-80, method=method).region.radius
            assert r == pytest.approx(float(text), rel=1e-4), (line, method)


def test_the_command_of_the_page(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    spec = str(spec_path("servo"))
    words = ["observe", spec, "--measured", "motor angle", "--disk", "-20", "14"]
    out = ran(capsys, *words, "-o", "servo-observer", "--json", "summary.json").splitlines()
    page = (DOCS / "observers.md").read_text()
    assert out[0] in page
    assert out[1] in page
    assert main(["check", "servo-observer"]) == 0
    summary = json.loads(Path("summary.json").read_text())
    servo = load(spec)
    observer = Observer.load("servo-observer", servo, "motor angle [rad]")
    assert summary["gains"]["L at vertex 2"] == observer.gain([0, 1]).tolist()
    assert summary["measured"] == ["motor angle [rad]"]
    assert summary["region"] == {"kind": "disk", "centre": -20.0, "radius": 14.0}
    assert main([*words, "--method", "slack", "--json", "none.json"]) == 1
    assert "smallest radius found there is 15.7" in capsys.readouterr().err
    assert not Path("none.json").exists()


def test_the_command_with_a_region_and_a_fixed_gain(tmp_path, capsys):
    spec = str(spec_path("servo"))
    words = ["observe", spec, "--measured", "motor angle", "--measured", "motor speed [rad/s]"]
    region = ["--region", "disk(-20, 19) & half_plane(2)", "--json", str(tmp_path / "s.json")]
    assert "  L = [" in ran(capsys, *words, *region, "--method", "quadratic")
    L = np.array(json.loads((tmp_path / "s.json").read_text())["gains"]["L"])
    servo, C = load(spec), np.eye(4)[2:]
    z = np.linalg.eigvals(servo.A - L @ C)
    assert z.real.max() < -2
    assert np.abs(z + 20).max() < 19
    assert "the error need not die out" in ran(capsys, *words, "--disk", "-5", "50", "--on", "box")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--measured", "load speed"], "not observable"),
        (["--measured", "motor angel"], "did you mean 'motor angle'"),
        (["--measured", "motor angle", "--method", "quadratic", "--degree", "2"], "--degree"),
    ],
)
def test_the_command_refuses_in_one_line(words, message, capsys):
    spec = str(spec_path("servo"))
    err = refused(capsys, "observe", spec, "--disk", "-20", "14", *words)
    assert message in err
