"""The observer's C: against numpy, in the loop with the law's C, and whatever it is given."""

import ctypes
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import linear_sum_assignment

from polefence import (
    Disk,
    HalfPlane,
    InputError,
    Parameter,
    Scheduled,
    Sector,
    UncertainPlant,
    load,
    observe,
    place,
)
from polefence.examples import family, spec_path
from polefence.export.observer import (
    check_sample_time,
    judge_sampled_loop,
    longest_sample_time,
    observer_sources,
    observer_step,
    sampled_output_loop,
)
from polefence.export.program import number, program
from polefence.export.sources import Texts, sources
from polefence.law.laws import FixedGain
from polefence.search.observer import Observer
from support.needed import need
from support.shapes_of_laws import FUZZ, SANITIZED, STRICT, run, weights

SERVO = spec_path("servo")
SENSORS = ("suspension deflection", "sprung-mass velocity", "integral of suspension deflection")
CALLS = 3000
NO_MEASUREMENT, NO_INPUT, RESTARTED = 4, 8, 16


@cache
def car() -> UncertainPlant:
    return family("quarter-car-physical")


@cache
def accelerometer(sample_time=None) -> UncertainPlant:
    """A mass on a spring of uncertain stiffness; what is measured depends on the stiffness."""
    step = 1 if sample_time is None else float(sample_time)
    A = [[0, 1], ["-k", "-k/5"]]
    if sample_time is not None:
        A = [[1, step], [f"-{step}*k", f"1-{step}*k/5"]]
    return UncertainPlant.from_expressions(
        [Parameter("k", 1, 4)],
        A=A,
        B=[[0], [step]],
        states=("x [m]", "v [m/s]"),
        sample_time=sample_time,
    )


@cache
def single() -> UncertainPlant:
    """A plant without uncertainty."""
    return UncertainPlant.from_vertices([[[0, 1], [-3, -1]]], [[[0, 1], [2, 0]]])


def of_car(method, radius=30):
    return lambda: observe(car(), SENSORS, Disk(-80, radius), method)


def of_rate(method, sample_time=None):
    def made() -> Observer:
        plant = accelerometer(sample_time)
        Cs = [[v.exact_A[1]] for v in plant.vertices]
        region = Disk(0, "0.9") if sample_time else HalfPlane(1) & Sector(0.3)
        return observe(plant, Cs, region, method)

    return made


@dataclass(frozen=True)
class Case:
    label: str
    make: Callable[[], Observer]
    sample_time: float | None
    bits: int = 64
    by_alpha: bool = False

    @cache  # noqa: B019  (the cases live as long as the tests)
    def observer(self) -> Observer:
        return self.make()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return () if self.by_alpha else self.observer().plant.parameters

    @property
    def texts(self) -> Texts:
        n, m = self.observer().plant.shape
        return Texts("law", self.label, (), tuple(f"x{i}" for i in range(n)), ("u",) * m)

    def write(self, folder: Path) -> Path:
        """Write the observer beside some law of the plant, and the bounds that it clamps to."""
        folder.mkdir(parents=True, exist_ok=True)
        form, plant = number(self.bits), self.observer().plant
        law = program(FixedGain(np.ones(plant.shape[::-1])), (), form)
        files = sources(law, self.texts) | observer_sources(
            self.observer(), form, self.texts, self.parameters, self.sample_time
        )
        ends = [(form.outward(p.low, False), form.outward(p.high, True)) for p in self.parameters]
        for key, k in (("LOW", 0), ("HIGH", 1)):
            values = ", ".join(form.text(each[k]) for each in ends)
            files["bounds.h"] = files.get("bounds.h", "") + f"#define {key} {{ {values} }}\n"
        for name, text in files.items():
            (folder / name).write_text(text)
        return folder


CASES = [
    Case("car, scheduled", of_car("scheduled"), 2e-3),
    Case("car, scheduled, single", of_car("scheduled"), 2e-3, 32),
    Case("car, scheduled, single, alpha", of_car("scheduled"), 9.9e-3, 32, True),
    Case("car, one gain, single", of_car("quadratic", 60), 1e-3, 32),
    Case("car, degree 2 on the box", of_car(Scheduled(2, 1, "box")), 5e-4),
    Case("servo", lambda: observe(load(SERVO), ["motor angle"], Disk(-20, 14)), 0.02, 32),
    Case("C of alpha, degree 2, given alpha", of_rate(Scheduled(2, 1)), 0.05, 64, True),
    Case("one vertex, two inputs", lambda: observe(single(), [[1, 0]], Disk(-5, 3)), 0.01),
    Case("discrete time", of_rate("scheduled", "0.1"), None),
    Case("discrete time, one gain, single", of_rate("quadratic", "0.1"), None, 32),
]
FUZZED = (
    "car, scheduled, single",
    "C of alpha, degree 2, given alpha",
    "one vertex, two inputs",
    "discrete time, one gain, single",
)
ANALYSED = FUZZED[:2]
BY_LABEL = {case.label: case for case in CASES}
labels = pytest.mark.parametrize("label", BY_LABEL)


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """For each case its folder, and what gcc said of the library and of the fuzz driver."""
    gcc, root = need("gcc"), tmp_path_factory.mktemp("observers")
    folders = [case.write(root / re.sub(r"\W+", "-", case.label)) for case in CASES]
    analysed, fuzzed = (
        [folder for folder, case in zip(folders, CASES, strict=True) if case.label in chosen]
        for chosen in (ANALYSED, FUZZED)
    )

    def build(folder: Path):
        include, code = f"-I{folder}", folder / "law_observer.c"
        library = ("-shared", "-fPIC", "-o", folder / "observer.so")
        options = [*STRICT, "-fanalyzer"] if folder in analysed else STRICT
        strict = run(gcc, *options, include, code, FUZZ / "observer_many.c", *library)
        if folder not in fuzzed:
            return folder, strict, None
        driver = ("-o", folder / "fuzz", "-lm")
        sanitized = run(gcc, *SANITIZED, include, code, FUZZ / "observer_fuzz.c", *driver)
        return folder, strict, sanitized

    with ThreadPoolExecutor(2) as pool:
        return dict(zip(BY_LABEL, pool.map(build, folders), strict=True))


@labels
def test_compiles_without_a_warning_and_passes_the_analyser(built, label):
    folder, strict, _ = built[label]
    assert (strict.returncode, strict.stderr) == (0, "")
    for name in ("law_observer.c", "law_observer.h"):
        text = (folder / name).read_text()
        assert "Undefined" not in text
        assert max(map(len, text.splitlines())) <= 110


@pytest.mark.parametrize("label", FUZZED)
def test_answers_as_documented_whatever_is_given(built, label):
    folder, _, sanitized = built[label]
    assert sanitized.returncode == 0, sanitized.stderr
    ran = run(folder / "fuzz", 1, 5000)
    assert ran.returncode == 0, ran.stdout + ran.stderr


FAULTS = {
    "half a measurement": ("finite ? values[i]", "is_finite(values[i]) ? values[i]"),
    "NaN goes on": ("copy[i] = finite ? values[i] : 0.0F", "copy[i] = values[i]"),
    "a restart unsaid": ("flags |= LAW_OBSERVER_RESTARTED;", ""),
    "no u unsaid": ("flags |= LAW_OBSERVER_NO_INPUT;", ""),
    "no y unsaid": ("flags |= LAW_OBSERVER_NO_MEASUREMENT;", ""),
    "reads beyond y": ("take(y, MEASURED, seen)", "take(y, MEASURED + 1U, seen)"),
    "reads beyond x": ("at->c[j][i] * x[i]", "at->c[j][i] * x[i + j + 2U]"),
    "a row too many": (
        "i < (STATES + MEASURED); i++) {\n            l",
        "i <= (STATES + MEASURED); i++) {\n            l",
    ),
}
SEEN_BY_SANITIZER = ("reads beyond y", "reads beyond x", "a row too many")


@pytest.fixture(scope="session")
def faulty(tmp_path_factory):
    """For each fault what the fuzz run said of it."""
    gcc, root = need("gcc"), tmp_path_factory.mktemp("faults")
    case = BY_LABEL["car, scheduled, single"]
    folders = {fault: case.write(root / str(k)) for k, fault in enumerate(FAULTS)}

    def tried(fault: str) -> int:
        folder, (old, new) = folders[fault], FAULTS[fault]
        text = (folder / "law_observer.c").read_text()
        if text.count(old) != 1:
            return -1
        (folder / "law_observer.c").write_text(text.replace(old, new))
        code = folder / "law_observer.c"
        driver = (FUZZ / "observer_fuzz.c", "-o", folder / "fuzz", "-lm")
        options = SANITIZED if fault in SEEN_BY_SANITIZER else ("-std=c99", "-O0")
        made = run(gcc, *options, f"-I{folder}", code, *driver)
        return run(folder / "fuzz", 1, 5000).returncode if made.returncode == 0 else -2

    with ThreadPoolExecutor(2) as pool:
        return dict(zip(FAULTS, pool.map(tried, FAULTS), strict=True))


@pytest.mark.parametrize("fault", FAULTS)
def test_the_fuzz_run_finds_a_fault(faulty, fault):
    assert faulty[fault] == 1


def matrices(observer: Observer, alpha: np.ndarray):
    A, B = observer.plant.at(alpha)
    L = np.broadcast_to(observer.gain(alpha), (*A.shape[:-1], observer.C.shape[1]))
    return A, B, np.tensordot(alpha, observer.C, 1), L


def series(A, B, C, L, h):
    """The step by the definition: sum over k of (h M)^k / k!, of the equation with y and u held."""
    if h is None:
        return A - L @ C, B, L
    M = h * (A - L @ C)
    one = np.broadcast_to(np.eye(A.shape[-1]), A.shape)
    powers = [one, M, M @ M, M @ M @ M, M @ M @ M @ M]
    step = sum(p / f for p, f in zip(powers, (1, 1, 2, 6, 24), strict=True))
    input_ = h * sum(p / f for p, f in zip(powers[:4], (1, 2, 6, 24), strict=True))
    return step, input_ @ B, input_ @ L


def units(observer: Observer) -> np.ndarray:
    """Sizes of the states that belong together: those of the dual's W."""
    law = observer.design.law
    K = law.gain([1 / len(observer.plant.vertices)] * len(observer.plant.vertices))
    W = law.W.mean(axis=0) if law.W is not None else np.diag(1 + 0 * K[0])
    return 1 / np.sqrt(np.diagonal(W))


def drawn(case: Case):
    """Parameters, weights or nothing; u, y and estimates of a size that the plant has."""
    observer, random = case.observer(), np.random.default_rng(5)
    N, (_, m) = len(observer.plant.vertices), observer.plant.shape
    real = np.float32 if case.bits == 32 else np.float64
    x = (random.normal(size=(CALLS, len(units(observer)))) * units(observer)).astype(real)
    ends = np.array([[float(p.low), float(p.high)] for p in case.parameters]).T
    if case.parameters:
        inside = 1e-5 * np.array([[1], [-1]])
        given = random.uniform(*(ends + inside), (CALLS, len(case.parameters))).astype(real)
        alpha = weights(given.astype(float), case.parameters)
    else:
        given = random.dirichlet(np.ones(N), CALLS).astype(real)
        alpha = given.astype(float) / given.astype(float).sum(axis=1, keepdims=True)
    _, B, C, _ = matrices(observer, alpha)
    there = (random.normal(size=x.shape) * units(observer))[..., None]
    y = (C @ there)[..., 0].astype(real)
    force = 1 / ((case.sample_time or 1) * np.abs(B) / units(observer)[:, None]).max()
    u = (force * random.normal(size=(CALLS, m))).astype(real)
    return given, alpha, u, y, x


def stepped(folder: Path, case: Case, given, u, y, x):
    real = np.float32 if case.bits == 32 else np.float64
    arrays = [np.ascontiguousarray(a, real) for a in (given, u, y)]
    after, flags = np.array(x, real), np.zeros(len(x), np.uint32)
    library = ctypes.CDLL(str(folder / "observer.so"))
    pointers = (a.ctypes.data_as(ctypes.c_void_p) for a in (*arrays, after, flags))
    library.many(ctypes.c_uint32(len(x)), *pointers)
    return after.astype(float), flags


def product(M, v):
    return np.einsum("kij,kj->ki", M, v)


@labels
def test_computes_a_step_of_the_observer(built, label):
    folder, strict, _ = built[label]
    assert strict.returncode == 0
    case = BY_LABEL[label]
    given, alpha, u, y, x = drawn(case)
    A, B, C, L = matrices(case.observer(), alpha)
    tolerance = 1e-5 if case.bits == 32 else 1e-12
    for missing in (False, True):
        gain = 0 * L if missing else L
        seen = y + np.nan if missing else y
        Phi, G, H = series(A, B, C, gain, case.sample_time)
        terms = product(Phi, x), product(G, u), product(H, y)
        size = np.sqrt(sum((t / units(case.observer())) ** 2 for t in (x, *terms)).sum(axis=1))
        after, flags = stepped(folder, case, given, u, seen, x)
        bound = tolerance * size[:, None] * units(case.observer())
        error = np.abs(after - sum(terms))
        assert np.all(flags == (NO_MEASUREMENT if missing else 0))
        assert np.all(error <= bound)
        # each term is seen: without it the estimate is another
        for term in terms[: 2 if missing else 3]:
            assert np.mean(np.any(np.abs(term) > bound, axis=1)) > 0.9
    dark, flags = stepped(folder, case, given, u * np.inf, y, x)
    still, _ = stepped(folder, case, given, u * 0, y, x)
    assert np.all(flags == NO_INPUT)
    assert np.array_equal(dark, still)
    for bad in (np.nan, np.inf):
        lost, flags = stepped(folder, case, given, u, y, x * bad)
        assert np.all(flags == RESTARTED)
        assert not lost.any()


class Loop:
    """Plant, law and observer, the latter two in C; the parameters do not move."""

    def __init__(self, folder: Path, bits: int, sample_time: float, **values: float):
        self.observer, self.feedback, form = (
            BY_LABEL["car, scheduled"].observer(),
            law(),
            number(bits),
        )
        plant = car()
        files = sources(program(self.feedback.law, plant.parameters, form), texts())
        files |= observer_sources(self.observer, form, texts(), plant.parameters, sample_time)
        folder.mkdir()
        for name, text in files.items():
            (folder / name).write_text(text)
        code = [folder / name for name in files if name.endswith(".c")]
        options = ("-std=c99", "-O0", "-shared", "-fPIC", f"-I{folder}")
        made = run(need("gcc"), *options, *code, "-o", folder / "both.so")
        assert made.returncode == 0, made.stderr
        self.c, self.real = (
            ctypes.CDLL(str(folder / "both.so")),
            [np.float32, np.float64][bits > 32],
        )
        self.alpha, self.h = plant.alpha(**values), sample_time
        self.p = np.array([values[p.name] for p in plant.parameters], self.real)
        A, B, self.C, _ = matrices(self.observer, self.alpha)
        n, m = B.shape
        whole = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * sample_time)
        self.F, self.G = whole[:n, :n], whole[:n, n:]

    def control(self, estimate: np.ndarray) -> np.ndarray:
        u, x = np.zeros(1, self.real), np.array(estimate, self.real)
        assert (
            self.c.law_update(*(each.ctypes.data_as(ctypes.c_void_p) for each in (self.p, x, u)))
            == 0
        )
        return u.astype(float)

    def tick(self, x, estimate, u):
        """Let u act for a sample time, then measure and estimate."""
        x = self.F @ x + self.G @ u
        after = np.array(estimate, self.real)
        arrays = (after, self.p, np.array(u, self.real), np.array(self.C @ x, self.real))
        assert self.c.law_observer_update(*(a.ctypes.data_as(ctypes.c_void_p) for a in arrays)) == 0
        return x, after.astype(float)

    def run(self, x, duration: float) -> np.ndarray:
        estimate, rows = np.zeros(len(x)), []
        for _ in range(round(duration / self.h)):
            x, estimate = self.tick(x, estimate, self.control(estimate))
            rows.append(np.hstack([x, estimate]))
        return np.array(rows)

    def matrix(self, delay: int) -> np.ndarray:
        """The map from tick to tick, found by starting it from every direction."""
        n, m = self.G.shape
        columns = []
        for unit in np.eye(2 * n + delay * m):
            x, estimate, held = np.split(unit, [n, 2 * n])
            u = self.control(estimate)
            columns.append(
                np.hstack([*self.tick(x, estimate, held if delay else u), u][: 2 + delay])
            )
        return np.array(columns).T


@cache
def law():
    return place(car(), Disk(-40, 31))


def texts() -> Texts:
    return Texts("law", "car", (), tuple(car().states), tuple(car().inputs))


START = np.array([0.05, 0.005, 0.1, -0.3, 0.0])


def test_the_loop_in_c_tends_to_the_continuous_one(tmp_path):
    errors = []
    for k, h in enumerate((1e-3, 5e-4, 2.5e-4)):
        loop = Loop(tmp_path / str(k), 64, h, m1=280.0, beta=4.0)
        output = loop.observer.feedback(loop.feedback)
        exact = expm(output.closed_loop(loop.alpha) * 0.1) @ np.hstack([START, 0 * START])
        errors.append((loop.run(START, 0.1)[-1] - exact) / np.tile(units(loop.observer), 2))
    sizes = np.linalg.norm(errors, axis=1)
    assert np.linalg.norm(exact / np.tile(units(loop.observer), 2)) > 100 * sizes[-1]
    # y and u are held: the error is of first order in the sample time
    assert sizes[:-1] / sizes[1:] == pytest.approx(2, abs=0.2)


def test_single_precision_follows_double(tmp_path):
    runs = [
        Loop(tmp_path / str(bits), bits, 2e-3, m1=280.0, beta=4.0).run(START, 0.5)
        for bits in (32, 64)
    ]
    size = np.abs(runs[1]).max(axis=0)
    assert np.all(np.abs(runs[0] - runs[1]) <= 1e-5 * size)


def test_the_sampled_loops_eigenvalues_are_those_of_the_c(tmp_path):
    loop = Loop(tmp_path / "c", 64, 5e-3, m1=250.0, beta=-7.0)
    for delay in (0, 1):
        check_eigenvalues(loop, delay)


def check_eigenvalues(loop: Loop, delay: int) -> None:
    found = np.linalg.eigvals(loop.matrix(delay))
    said = sampled_output_loop(loop.feedback, loop.observer, loop.alpha, 5e-3, delay=delay)
    cost = np.abs(found[:, None] - said[None, :])
    assert len(found) == len(said) == 10 + delay
    assert cost[linear_sum_assignment(cost)].max() < 1e-8
    other = sampled_output_loop(loop.feedback, loop.observer, loop.alpha, 5e-3, delay=1 - delay)
    assert np.abs(found[:, None] - other[None, :]).min(axis=1).max() > 1e-3


def test_the_slowest_decay_over_the_family():
    observer = BY_LABEL["car, scheduled"].observer()
    found = judge_sampled_loop(law(), observer, 5e-3)
    assert found.stable
    eigenvalues = sampled_output_loop(law(), observer, found.alpha, 5e-3)
    assert np.abs(eigenvalues).max() == pytest.approx(found.largest, rel=1e-12)
    assert found.decay == pytest.approx(-np.log(found.largest) / 5e-3)
    assert found.points > 1000
    random = np.random.default_rng(6)
    others = np.array(
        [
            car().alpha(m1=m, beta=b)
            for m, b in zip(random.uniform(232, 346, 50), random.uniform(-10, 10, 50), strict=True)
        ]
    )
    sizes = np.abs(sampled_output_loop(law(), observer, others, 5e-3)).max(axis=1)
    assert sizes.max() <= found.largest + 1e-3
    # a step's delay at 8 ms is too much, and it is not the region that says so
    slow = judge_sampled_loop(law(), observer, 8e-3, delay=1)
    assert not slow.stable
    assert slow.decay < 0
    assert judge_sampled_loop(law(), observer, 8e-3).stable
    # at short steps the decay is that of the continuous loop
    loop = observer.feedback(law())
    assert judge_sampled_loop(law(), observer, 1e-4).decay == pytest.approx(
        -loop.poles(found.alpha).real.max(), rel=0.02
    )


@labels
def test_the_step_in_numpy_is_of_order_four(label):
    case = BY_LABEL[label]
    observer, h = case.observer(), case.sample_time
    N = len(observer.plant.vertices)
    alpha = np.vstack([np.eye(N), np.full(N, 1 / N)])
    parts = matrices(observer, alpha)
    for missing in (False, True):
        own = (*parts[:3], 0 * parts[3] if missing else parts[3])
        wanted = series(*own, h)
        given = observer_step(observer, alpha, h, measured=not missing)
        for one, other in zip(wanted, given, strict=True):
            assert np.allclose(one, other, rtol=1e-12, atol=1e-13 * (1 + np.abs(one).max()))
    if h is not None:
        M = (parts[0] - parts[3] @ parts[2])[-1]
        errors = [
            np.abs(observer_step(observer, alpha[-1], step)[0] - expm(M * step)).max()
            for step in (h, h / 2)
        ]
        assert errors[0] / errors[1] == pytest.approx(32, rel=0.25)


def test_a_discrete_loop_is_the_one_of_the_design():
    observer = BY_LABEL["discrete time"].observer()
    feedback = place(observer.plant, Disk(0, "0.95"))
    alpha = observer.plant.alpha(k=2)
    said = np.sort_complex(sampled_output_loop(feedback, observer, alpha))
    assert np.allclose(said, np.sort_complex(observer.feedback(feedback).poles(alpha)), atol=1e-7)
    assert judge_sampled_loop(feedback, observer).largest < 0.951
    assert len(sampled_output_loop(feedback, observer, alpha, delay=1)) == 5


def test_a_sample_time_that_the_step_does_not_bear_is_refused():
    observer = BY_LABEL["car, scheduled"].observer()
    longest = longest_sample_time(observer)
    sizes = np.abs(observer.poles(np.eye(4)))
    assert 0.9 < longest * sizes.max() <= 1  # a vertex need not have the fastest pole
    assert longest * np.abs(observer.poles(np.full(4, 0.25))).max() <= 1
    assert check_sample_time(observer, longest) == longest
    with pytest.raises(
        InputError, match=r"too long for the observer: the observer has a pole"
    ) as no:
        observer_sources(observer, number(32), texts(), car().parameters, 1.001 * longest)
    assert "\n" not in str(no.value)
    advice = float(re.search(r"use at most ([\d.e-]+) s$", str(no.value))[1])
    assert 0.98 * longest < check_sample_time(observer, advice) <= longest
    # fast states that the observer slows down, and the plant alone has where y is missing
    plant = UncertainPlant.from_vertices([[[-1000]]], [[[1]]])
    slowed = observe(plant, [[1]], Disk(-80, 30))
    assert longest_sample_time(slowed) == pytest.approx(2.6e-3)
    with pytest.raises(InputError, match=r"where y is missing, has a pole of magnitude 1e\+03 1/s"):
        check_sample_time(slowed, 5e-3)


def test_the_bounds_of_a_step_are_what_is_said_of_them():
    """In the left half-plane: 1 % of the state and 2 % of the pole at 1, stable at 2.6."""
    z = np.exp(1j * np.linspace(np.pi / 2, np.pi, 400))
    z = (np.linspace(0.01, 1, 100)[:, None] * z).ravel()
    step = 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24
    assert 0.008 < np.abs(step - np.exp(z)).max() < 0.01
    assert 0.018 < np.abs(np.log(step) / z - 1).max() < 0.02
    z = 2.6 * np.exp(1j * np.linspace(np.pi / 2, np.pi, 400))
    assert np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24).max() < 1
    z *= 2.7 / 2.6
    assert np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24).max() > 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"sample_time": None}, "sample_time = None must be a positive number of seconds"),
        ({"sample_time": 0.0}, "sample_time = 0.0 must be"),
        ({"sample_time": -1e-3}, "sample_time = -0.001 must be"),
        ({"sample_time": float("nan")}, "sample_time = nan must be"),
        ({"sample_time": "1e-3"}, "sample_time = '1e-3' must be"),
        ({"name": "a" * 21}, "is too long for the functions of an observer; use at most 20"),
        ({"name": "int"}, "cannot begin C names"),
        ({"states": ("x",)}, "1 states and 1 inputs are named; the observer's plant has 5 and 1"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(change, says):
    observer = BY_LABEL["car, scheduled"].observer()
    given = {"sample_time": 1e-3} | {k: v for k, v in change.items() if k == "sample_time"}
    own = {k: v for k, v in change.items() if k != "sample_time"}
    named = Texts(**(vars(texts()) | own))
    with pytest.raises(InputError, match=re.escape(says)) as no:
        observer_sources(observer, number(64), named, car().parameters, given["sample_time"])
    assert "\n" not in str(no.value)


def test_designs_delays_and_times_that_do_not_belong_are_refused():
    observer, alpha = BY_LABEL["car, scheduled"].observer(), np.full(4, 0.25)
    servo = place(load(SERVO), Disk(-6, 5))
    with pytest.raises(InputError, match="of another plant"):
        sampled_output_loop(servo, observer, alpha, 1e-3)
    with pytest.raises(InputError, match="delay = 2 must be 0 or 1"):
        sampled_output_loop(law(), observer, alpha, 1e-3, delay=2)
    with pytest.raises(InputError, match=r"is in discrete time, and its own is 0.1 s"):
        check_sample_time(BY_LABEL["discrete time"].observer(), 0.05)
    large = UncertainPlant.from_vertices([[[-1, "1e20"], [0, -2]]], [[[0], [1]]])
    huge = observe(large, [[1, 0], [0, 1]], Disk(-5, 4.5))
    named = Texts("law", "large", (), ("x", "y"), ("u",))
    with pytest.raises(InputError, match="numbers reach 1e[+]20, too large for the code"):
        observer_sources(huge, number(32), named, (), 1e-3)


def test_a_header_of_cpp(tmp_path):
    gcc, gpp = need("gcc"), need("g++")
    folder = BY_LABEL["one vertex, two inputs"].write(tmp_path)
    (folder / "main.cpp").write_text(
        '#include "law_observer.h"\n#include "law.h"\n#include "law_observer.h"\n'
        "int main() {\n"
        "    const law_real u[LAW_INPUTS] = {}, x[LAW_STATES] = {};\n"
        "    const law_real y[LAW_OBSERVER_MEASURED] = {};\n"
        "    law_observer observer;\n"
        "    law_observer_start(&observer, x);\n"
        "    return static_cast<int>(law_observer_update(&observer, u, y) - LAW_OBSERVER_OK);\n"
        "}\n"
    )
    code = ("-c", folder / "law_observer.c", "-o", folder / "observer.o")
    made = run(gcc, "-std=c99", *code)
    warnings = ("-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
    linked = run(gpp, *warnings, folder / "main.cpp", folder / "observer.o", "-o", folder / "main")
    assert (made.returncode, linked.returncode) == (0, 0), made.stderr + linked.stderr
    assert run(folder / "main").returncode == 0
    for option in ("-ffast-math", "-ffinite-math-only"):
        refused = run(gcc, "-std=c99", "-O2", option, "-fsyntax-only", folder / "law_observer.c")
        assert refused.returncode != 0
        assert "#error" in refused.stderr


def test_findings_of_cppcheck_are_those_of_the_law(tmp_path):
    """Tables of one function, functions for others to call, flags that nobody need read."""
    folder = BY_LABEL["car, scheduled, single"].write(tmp_path)
    options = ("-q", "--std=c99", "--enable=all", "--addon=misra", "--template={id}")
    hidden = "--suppress=missingIncludeSystem"
    ran = run(need("cppcheck"), *options, hidden, f"-I{folder}", folder / "law_observer.c")
    assert ran.returncode == 0, ran.stderr
    lines = [line.strip() for line in ran.stderr.splitlines() if re.fullmatch(r"[\w.-]+", line)]
    assert set(lines) == {"misra-c2012-8.9", "misra-c2012-2.5", "unusedFunction"}
